"""Controllers: their law against independent integrations of it, in all methods, sampled, delayed and at their limits."""

from __future__ import annotations

import re
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

J, C, K, T_END = 0.1, 0.05, 2.0, 2.0
PLANT = f"""&body name='arm' kind='rigid' mass=1.0 inertia={J} angular_velocity=1.0 /
&joint name='j' type='revolute' body_a='arm' /
&spring name='k' type='torsional' body_a='arm' stiffness={K} damping={C} free_angle=0.0 /
&sensor name='a' quantity='angle' body='arm' /
&sensor name='v' quantity='angular_velocity' body='arm' /
&history name='r' kind='sine' amplitude=1.0 frequency=1.0 phase=0.5 /
&force name='m' type='torque' body='arm' moment=2.0 controller='pid' /
&sensor name='c' quantity='controller' controller='pid' /
"""


def reference(t):
    """Return the reference and its rate."""
    return np.sin(2 * np.pi * t + 0.5), 2 * np.pi * np.cos(2 * np.pi * t + 0.5)


class Pid:
    """A continuous controller as its equations stand in text books, states I, filter, delay."""

    def __init__(
        self, argument="a", kp=0.0, ki=0.0, kd=0.0, filter=0.0, lower=-np.inf, upper=np.inf, windup_time=np.inf, delay=0.0
    ):
        self.argument, self.kp, self.ki, self.kd, self.filter = argument, kp, ki, kd, filter
        self.lower, self.upper, self.windup_time, self.delay = lower, upper, windup_time, delay

    def start(self, angle, rate):
        """Return the states at the start."""
        y = angle if self.argument == "a" else rate
        return [0.0, reference(0.0)[0] - y, y / 120, 0.0, 0.0]

    def law(self, t, angle, rate, x, side=None):
        """Return the output, its error, the rates of the states and the wish; side: 1, -1 at a limit, 0 free, none: by the wish."""
        y, yd = (angle, rate) if self.argument == "a" else (rate, np.nan)
        rates = np.zeros(5)
        if self.delay:
            rates[2:] = np.array([x[3], x[4], y - 120 * x[2] - 60 * x[3] - 12 * x[4]]) / self.delay
            y, yd = 240 * x[2] + 24 * x[4] - y, 240 * rates[2] + 24 * rates[4] - yd
        r, rd = reference(t)
        error = r - y
        wish = self.kp * error + x[0]
        if self.filter:
            rates[1] = (error - x[1]) / self.filter
            wish += self.kd * rates[1]
        elif self.kd:
            wish += self.kd * (rd - yd)
        out = min(max(wish, self.lower), self.upper) if side is None else (self.lower, wish, self.upper)[side + 1]
        rates[0] = self.ki * error + (out - wish) / self.windup_time
        return out, error, rates, wish


@cache
def truth(name, rows):
    """Return angle, rate, output and error at rows over T_END, by an eighth-order method from one limit to the next."""
    pid, times = Pid(**LAWS[name]), np.linspace(0.0, T_END, rows)
    y = np.array([0.0, 1.0, *pid.start(0.0, 1.0)])
    t, side, found = 0.0, 0, [y]

    def motion(t, y):
        out, _, rates, _ = pid.law(t, y[0], y[1], y[2:], side)
        return [y[1], (2.0 * out - C * y[1] - K * y[0]) / J, *rates]

    def above(t, y):
        return pid.law(t, y[0], y[1], y[2:], side)[3] - min(pid.upper, 1e9)

    def below(t, y):
        return pid.law(t, y[0], y[1], y[2:], side)[3] - max(pid.lower, -1e9)

    above.terminal = below.terminal = True
    side = int(above(0.0, y) > 0) - int(below(0.0, y) < 0)
    while t < T_END:
        above.direction, below.direction = (1, -1) if side == 0 else (-1, 1)
        watched = [above, below] if side == 0 else [above] if side > 0 else [below]
        part = solve_ivp(motion, (t, T_END), y, "DOP853", dense_output=True, events=watched, rtol=1e-12, atol=1e-13, max_step=0.02)
        found += [part.sol(at) for at in times[(times > t) & (times <= part.t[-1])]]
        t, y = part.t[-1], part.y[:, -1]
        side = 0 if side else int(len(part.t_events[0]) > 0) - int(len(part.t_events[1]) > 0) if part.status else 0
    output = [pid.law(t, *x[:2], x[2:])[:2] for t, x in zip(times, found)]
    return {
        "a": np.array(found)[:, 0],
        "v": np.array(found)[:, 1],
        "c.out": np.array(output)[:, 0],
        "c.error": np.array(output)[:, 1],
    }


def group(**values):
    """Return the deck's &controller."""
    return "&controller name='pid' history='r' " + " ".join(f"{k}={v!r}" for k, v in values.items()) + " /\n"


LIMITED = {"argument": "a", "kp": 8.0, "ki": 20.0, "kd": 0.4, "lower": -1.2, "upper": 1.5, "windup_time": 0.2}
LAWS = {
    "pid at limits": LIMITED,
    "filtered": {**LIMITED, "filter": 0.01},
    "delayed": {**LIMITED, "kp": 2.0, "ki": 4.0, "kd": 0.2, "delay": 0.03},
    "of a rate": {
        "argument": "v",
        "kp": 0.3,
        "ki": 2.0,
        "kd": 0.01,
        "filter": 0.02,
        "lower": -0.12,
        "upper": 0.1,
        "windup_time": 0.1,
    },
    "winding up": {k: v for k, v in LIMITED.items() if k != "windup_time"},
    "integral alone": {"argument": "a", "ki": 3.0},
}


@pytest.mark.parametrize("name", LAWS)
def test_a_controller_follows_its_law(run_deck, name):
    """Every column within 1e-8 of its range at a tolerance of 1e-10, through at least five saturations."""
    deck = PLANT + group(**LAWS[name]) + f"&transient t_end={T_END} method='dopri5' tolerance=1e-10 output_step=0.02 /\n"
    h = run_deck(deck).history
    expected = truth(name, len(h.time))
    for column, values in expected.items():
        np.testing.assert_allclose(h[column], values, rtol=0, atol=1e-8 * np.ptp(values), err_msg=column)
    if "lower" in LAWS[name]:
        assert sum(a != b for a, b in pairwise(h["c.limited"])) >= 5
        np.testing.assert_array_equal(
            h["c.limited"], (h["c.out"] >= LAWS[name]["upper"]) * 1.0 - (h["c.out"] <= LAWS[name]["lower"])
        )


@pytest.mark.parametrize(("method", "order"), [("rk4", 4), ("dopri5", 5), ("radau", 5), ("generalized_alpha", 2)])
@pytest.mark.parametrize("name", ["pid at limits", "delayed"])
def test_methods_keep_their_order_across_saturations(run_deck, method, order, name):
    deck = PLANT + group(**LAWS[name]) + "&transient t_end={} method='{}' step={} output_step=0.25 /\n"
    expected = truth(name, 9)
    errors = []
    for step in {"rk4": (2e-3, 1e-3), "generalized_alpha": (1e-3, 5e-4)}.get(method, (1e-2, 5e-3)):
        h = run_deck(deck.format(T_END, method, step), name=f"s{step}").history
        errors.append(max(np.abs(h[column] - values).max() / np.ptp(values) for column, values in expected.items()))
    assert errors[1] < errors[0] / 2 ** (order - 0.5) or errors[1] < 1e-9
    assert errors[1] < 1e-4


def test_a_jump_of_the_reference_leads_to_a_limit_at_once(run_deck):
    """A pulse: the output is at its limit from the jump on, in one step of each method, and comes back between."""
    law = {"argument": "a", "kp": 8.0, "kd": 0.8, "filter": 0.02, "lower": -1.2, "upper": 1.5}
    deck = PLANT.replace(
        "kind='sine' amplitude=1.0 frequency=1.0 phase=0.5", "kind='pulse' value=1.0 start=0.3 finish=0.9"
    ) + group(**law)
    ends = []
    for method, how in [("dopri5", "tolerance=1e-9"), ("radau", "tolerance=1e-9"), ("rk4", "step=1e-3")]:
        h = run_deck(deck + f"&transient t_end=1.2 method='{method}' {how} output_step=0.005 /\n", name=method).history
        limited = h["c.limited"]
        assert not limited[h.time < 0.2975].any()
        assert limited[np.searchsorted(h.time, 0.3025)] == 1.0
        assert limited[np.searchsorted(h.time, 0.9025)] == -1.0
        assert (limited == 0.0)[(h.time > 0.35) & (h.time < 0.89)].any()
        ends.append([h[c][-1] for c in ("a", "v", "c.out")])
    np.testing.assert_allclose(ends[1:], [ends[0]] * 2, rtol=0, atol=1e-7)
    end = run_deck(deck + "&transient t_end=1.2 method='generalized_alpha' step=1e-3 output_step=0.6 /\n", name="alpha").history
    assert end["a"][-1] == pytest.approx(ends[0][0], abs=2e-5)  # a step that ends at the jump sees what was before it


@pytest.mark.parametrize("method", ["rk4", "dopri5", "radau", "generalized_alpha"])
def test_a_sampled_controller_changes_at_its_samples_alone(run_deck, method):
    """The plant between samples exactly, the controller by its recursion: held output, Euler's integral, backward filter.

    Rows are at samples, where 3 k 0.007 and k 0.021 differ by rounding: they show what was held before, at 0 the first output.
    """
    kp, ki, kd, filter_time, upper, windup, h = 4.0, 10.0, 0.3, 0.015, 1.0, 0.1, 0.007
    law = {"kp": kp, "ki": ki, "kd": kd, "filter": filter_time, "lower": -upper, "upper": upper, "windup_time": windup, "sample": h}
    march = {"rk4": "step=1e-3", "generalized_alpha": "step=1e-4"}.get(method, "tolerance=1e-10")
    deck = PLANT + group(argument="a", **law) + f"&transient t_end=1.617 method='{method}' {march} output_step=0.021 /\n"
    found = run_deck(deck).history
    a = np.array([[0.0, 1.0], [-K / J, -C / J]])
    values, vectors = np.linalg.eig(a)
    x, integral, smooth, held = np.array([0.0, 1.0]), 0.0, reference(0.0)[0], 0.0
    for k in range(3 * len(found.time) - 2):
        before = held
        error = reference(k * h)[0] - x[0]
        wish = kp * error + integral + kd * (error - smooth) / (filter_time + h)
        held = min(max(wish, -upper), upper)
        smooth = (filter_time * smooth + h * error) / (filter_time + h)
        integral += h * (ki * error + (held - wish) / windup)
        if k % 3 == 0:
            shown = before if k else held
            assert found["c.out"][k // 3] == pytest.approx(shown, abs=1e-7 if method != "generalized_alpha" else 5e-3)
            assert found["a"][k // 3] == pytest.approx(x[0], abs=1e-8 if method != "generalized_alpha" else 2e-4)
        rest = np.array([2.0 * held / K, 0.0])
        x = rest + np.real(vectors @ (np.exp(h * values) * np.linalg.solve(vectors, x - rest)))
    if method == "dopri5":  # a thousand events are no fault of a run that is long enough
        many = deck.replace("'dopri5' tolerance=1e-10 output_step=0.021", "'dopri5' tolerance=1e-4 output_step=0.77")
        many = many.replace(f"sample={h}", "sample=1.4e-3").replace("t_end=1.617", "t_end=1.54")
        assert many.count("sample=1.4e-3") == many.count("output_step=0.77") == 1
        run_deck(many, name="many")


STILL = "&history name='r' kind='polynomial' coefficients=0.0 /\n"


def test_a_filtered_derivative_is_a_maxwell_spring(run_deck):
    """3 k tau s/(1 + tau s) of the angle, as a term of the spring or by a controller: radau takes the same steps."""
    spring = "&body name='b' mass=1 inertia=.1 angle=.3 angular_velocity=2 /\n&joint name='j' type='revolute' body_a='b' /\n"
    spring += "&sensor name='a' quantity='angle' body='b' /\n&transient t_end=2 method='radau' tolerance=1e-7 output_step=.5 /\n"
    spring += "&spring name='k' type='torsional' body_a='b' stiffness=4 free_angle=0 damping=.02 {} /\n"
    controlled = spring.format("") + STILL + group(argument="a", kd=0.6, filter=0.05)
    controlled += "&force name='f' type='torque' body='b' moment=1 controller='pid' /\n"
    runs = run_deck(spring.format("prony_alpha=3 prony_tau=.05"), name="spring"), run_deck(controlled)
    assert runs[0].transient["steps"] == runs[1].transient["steps"]
    np.testing.assert_allclose(runs[1].history["a"], runs[0].history["a"], rtol=1e-9)


def chain(seed):
    """Return a chain of discs whose loop joins two of them, its matrices, and the state space of the loop opened at the force."""
    dice = np.random.default_rng(seed)
    n, inertia, stiffness, damping = 4, *((10 ** dice.uniform(-1, 1, 4)).tolist() for _ in range(3))
    text, k, c = "", np.zeros((4, 4)), np.zeros((4, 4))
    for i in range(n):
        text += f"&body name='b{i}' kind='rigid' mass=1.0 inertia={inertia[i]!r} /\n"
        text += f"&joint name='j{i}' type='revolute' body_a='b{i}' /\n"
        text += f"&spring name='k{i}' type='torsional' body_a='b{i}' " + (f"body_b='b{i - 1}' " if i else "")
        text += f"stiffness={10 * stiffness[i]!r} damping={0.02 * damping[i]!r} free_angle=0.0 /\n"
        side = np.eye(n)[i] - (np.eye(n)[i - 1] if i else 0.0)
        k, c = k + 10 * stiffness[i] * np.outer(side, side), c + 0.02 * damping[i] * np.outer(side, side)
    seen, acts = dice.integers(n), dice.integers(n)
    law = {
        "kp": dice.uniform(-1, 1),
        "ki": dice.uniform(-1, 1),
        "kd": dice.uniform(-0.2, 0.2),
        "filter": 0.01 + 0.1 * dice.random(),
    }
    law |= {"delay": 0.02 + 0.1 * dice.random()} if dice.random() < 0.5 else {}
    rate = dice.random() < 0.3
    law["argument"] = "v" if rate else "a"
    text += f"&sensor name='a' quantity='angle' body='b{seen}' /\n&sensor name='v' quantity='angular_velocity' body='b{seen}' /\n"
    text += f"&force name='m' type='torque' body='b{acts}' moment=2.0 controller='pid' /\n"
    pid = Pid(**law)
    states = 2 * n + 5

    def motion(y):
        r = reference(0.0)[0]  # a constant reference: differences from the rest are the linear system
        out, _, rates, _ = pid.law(0.0, y[seen], y[n + seen], y[2 * n :])
        accelerations = (-k @ y[:n] - c @ y[n : 2 * n] + 2.0 * np.eye(n)[acts] * out) / np.array(inertia)
        assert r
        return np.concatenate([y[n : 2 * n], accelerations, rates])

    a = np.array([motion(row) for row in np.eye(states)]) - motion(np.zeros(states))
    kept = [*range(2 * n + 2), *(range(2 * n + 2, states) if pid.delay else [])]
    return text, law, a.T[np.ix_(kept, kept)]


def poles_of(run):
    """Return the rows of poles.txt as complex numbers."""
    rows = np.atleast_2d(np.loadtxt(run.folder / "poles.txt"))
    return rows[:, 2] + 1j * rows[:, 3]


@pytest.mark.parametrize("seed", [pytest.param(seed, marks=[pytest.mark.long] * (seed >= 4)) for seed in range(100)])
def test_poles_of_loops_are_all_found(run_deck, seed):
    """Loops that sense one disc and act on another, with filters and delays: every pole within 1e-9 of a dense eigenvalue."""
    text, law, a = chain(seed)
    run = run_deck(text + STILL + group(**law) + "&modal modes=2 /\n")
    every = np.linalg.eigvals(a)
    expected = every[every.imag >= 0.0]
    found = poles_of(run)
    assert len(found) == len(expected)
    for pole in expected:
        assert np.abs(found - pole).min() < 1e-9 * abs(pole) + 1e-12 * np.abs(expected).max()
    assert run.figures["closed_loops"]["growing"] == (every.real > 1e-9).sum()


def open_loop(text, law, omega):
    """Return the open loop of a chain at frequencies, from its deck's numbers and the textbook's transfer functions."""
    n = 4
    inertia = np.array([float(x) for x in re.findall(r"inertia=(\S+)", text)])
    k, c = np.zeros((n, n)), np.zeros((n, n))
    for i, (stiff, damps) in enumerate(re.findall(r"stiffness=(\S+) damping=(\S+)", text)):
        side = np.eye(n)[i] - (np.eye(n)[i - 1] if i else 0.0)
        k, c = k + float(stiff) * np.outer(side, side), c + float(damps) * np.outer(side, side)
    seen, acts = (int(re.search(words + r" body='b(\d)'", text)[1]) for words in ("quantity='angle'", "type='torque'"))
    s = 1j * np.atleast_1d(omega)[:, None, None]
    motion = np.linalg.solve(s**2 * np.diag(inertia) + s * c + k, np.broadcast_to(np.eye(n)[:, [acts]], (s.size, n, 1)))[:, seen, 0]
    s, x = s[:, 0, 0], s[:, 0, 0] * law.get("delay", 0.0)
    pid = law["kp"] + law["ki"] / s + law["kd"] * s / (law["filter"] * s + 1)
    late = (120 - 60 * x + 12 * x**2 - x**3) / (120 + 60 * x + 12 * x**2 + x**3)
    return 2.0 * pid * late * motion * (s if law["argument"] == "v" else 1.0)


@pytest.mark.parametrize("seed", [pytest.param(seed, marks=[pytest.mark.long] * (seed >= 4)) for seed in range(60)])
def test_margins_are_those_of_the_open_loop(run_deck, seed):
    """Crossings of the open loop on a fine grid: the gain nearest to 1, the least lag to -1. Unstable loops have none."""
    text, law, a = chain(seed)
    margins = run_deck(text + STILL + group(**law) + "&modal modes=2 /\n").figures["closed_loops"]["margins"]
    assert len(margins) == (np.linalg.eigvals(a).real.max() < 1e-9)
    if not margins:
        return
    (told,) = margins
    omega = np.geomspace(1e-4, 1e4, 40001)
    loop = open_loop(text, law, omega)

    def crossings(of):
        at = np.flatnonzero(np.sign(of(loop[:-1])) != np.sign(of(loop[1:])))
        roots = [brentq(lambda w: of(open_loop(text, law, w))[0], omega[i], omega[i + 1], xtol=1e-14, rtol=1e-13) for i in at]
        return np.array(roots), open_loop(text, law, roots) if roots else np.zeros(0, complex)

    _, real = crossings(np.imag)
    gains = -1 / real[real.real < 0].real
    _, unit = crossings(lambda x: np.abs(x) - 1)
    phases = np.degrees(np.angle(-unit)) % 360
    assert ("gain_margin" in told) == bool(gains.size)
    assert ("phase_margin" in told) == bool(phases.size)
    if gains.size:
        assert told["gain_margin"] == pytest.approx(gains[np.abs(np.log(gains)).argmin()], rel=1e-8)
    if phases.size:
        assert told["phase_margin"] == pytest.approx(phases.min(), rel=1e-7, abs=1e-7)


SLED = """&body name='a' mass=1 inertia=1 /
&joint name='g' type='prismatic' body_a='a' /
&sensor name='x' quantity='position' body='a' /
&history name='r' kind='polynomial' coefficients=1.0 /
&force name='f' type='force' body='a' fx=1 controller='pid' /
&sensor name='o' quantity='controller' controller='pid' /
"""


def test_a_limit_at_the_start_hides_no_loop(run_deck):
    """The reference is far off: the output is at its limit. Poles and responses are those without it, and the limit is told."""
    kp, kd, delay = 100.0, 1.0, 0.1
    deck = SLED + group(argument="x.x", kp=kp, kd=kd, delay=delay, lower=-5, upper=5)
    run = run_deck(deck + "&modal modes=1 /\n&frequency_response from=0.5 to=5 points=3 input='f' /\n")
    late = np.poly1d([-(delay**3), 12 * delay**2, -60 * delay, 120]), np.poly1d([delay**3, 12 * delay**2, 60 * delay, 120])
    poles = (np.poly1d([1, 0, 0]) * late[1] + np.poly1d([kd, kp]) * late[0]).roots
    np.testing.assert_allclose(np.sort_complex(poles_of(run)), np.sort_complex(poles[poles.imag >= 0]), rtol=1e-9)
    assert run.figures["closed_loops"]["growing"] == 2
    assert run.figures["closed_loops"]["margins"] == []
    assert "at a limit in the present state: controllers pid" in run.stderr
    assert "2 of the poles grow" in run.stderr
    response = np.loadtxt(run.folder / "frequency_response.txt")
    s = 2j * np.pi * response[:, 0]
    exact = 1 / (s**2 + (kd * s + kp) * late[0](s) / late[1](s))
    np.testing.assert_allclose(response[:, 1] + 1j * response[:, 2], exact, rtol=1e-9)


def test_a_derivative_without_a_filter_damps(run_deck):
    """s^2 + kd s + kp: a fifth of critical damping."""
    run = run_deck(SLED + group(argument="x.x", kp=100.0, kd=4.0) + "&modal modes=1 /\n")
    np.testing.assert_allclose(poles_of(run), [-2 + np.sqrt(96) * 1j], rtol=1e-9)


def test_a_delay_begins_with_what_stands_still(run_deck):
    """A sled held at 0.25 m before its controller begins: the delayed position is that, not 0, and no transient starts."""
    deck = SLED.replace("inertia=1 /", "inertia=1 position=0.25,0 /").replace("&joint name='g'", "&joint point_b=0.25,0 name='g'")
    deck = deck.replace("coefficients=1.0", "coefficients=0.25")
    deck += group(argument="x.x", kp=2.0, delay=0.1)
    run = run_deck(deck + "&transient t_end=0.3 method='rk4' step=1e-3 output_step=0.1 /\n")
    np.testing.assert_allclose(run.history["o.out"], 0.0, atol=1e-12)


@pytest.mark.parametrize("law", [{"kp": 1.0}, {"kp": 1.0, "ki": 2.0, "delay": 0.1}])
def test_a_controller_where_nothing_is_free(run_deck, law):
    """A drive turns the only body by t, the reference: the output is 0, and so is what the loop needs of the drive."""
    deck = """&body name='b' mass=1 inertia=1 /
&joint name='j' type='revolute' body_a='b' /
&history name='r' kind='polynomial' coefficients=0,1 /
&drive name='d' type='rotation' body_a='b' history='r' /
&sensor name='a' quantity='angle' body='b' /
&force name='f' type='torque' body='b' moment=1 controller='pid' /
&sensor name='o' quantity='controller' controller='pid' /
"""
    run = run_deck(deck + group(argument="a", **law) + "&modal modes=1 /\n&transient t_end=0.5 /\n")
    late = law.get("delay", 0.0)
    np.testing.assert_allclose(run.history["o.error"][-1], late, rtol=0, atol=1e-3 * (late or 1e-9))
    assert run.figures["closed_loops"]["states"] == sum(n for key, n in {"ki": 1, "delay": 3}.items() if key in law)
    assert len(run.figures["closed_loops"]["margins"]) == 1


def test_a_loop_grows_beyond_its_critical_gain(run_deck):
    """The gain margin multiplies all gains to where a pole stands on the axis, within 1e-6; a transient agrees, and warns.

    About a spinning body the velocity of a point, -a sin(w t) w, depends on the angle, too.
    """
    radius, angle, spin, gain = 0.3, 0.5, 8.0, -2.0
    deck = PLANT.replace("mass=1.0", f"mass=1.0 angle={angle}").replace("angular_velocity=1.0", f"angular_velocity={spin}")
    deck += f"&sensor name='p' quantity='velocity' body='arm' point={radius},0.0 /\n" + group(argument="p.x", kp=gain)
    turned = run_deck(deck + "&modal modes=1 /\n", name="spinning")
    by_angle, by_rate = (2.0 * gain * radius * part for part in (-spin * np.cos(angle), -np.sin(angle)))
    (expected,) = (root for root in np.roots([J, C + by_rate, K + by_angle]) if root.imag > 0.0)
    assert poles_of(turned) == pytest.approx(np.array([expected]), rel=1e-9)
    (told,) = turned.figures["closed_loops"]["margins"]
    (crossing,) = (x**0.5 for x in np.roots([J**2, C**2 - 2 * J * K - by_rate**2, K**2 - by_angle**2]) if x > 0)
    at = (by_angle + 1j * crossing * by_rate) / (K - J * crossing**2 + 1j * crossing * C)
    assert told["phase_margin"] == pytest.approx(np.degrees(np.angle(-at)) % 360, rel=1e-7)
    text, law, _ = chain(3)
    law = {"argument": "a", "kp": 0.02, "ki": 0.005, "kd": 0.01, "filter": 0.02, "delay": 0.05}

    def loop(factor):
        return group(**{**law, **{name: factor * law[name] for name in ("kp", "ki", "kd")}})

    run = run_deck(text + STILL + loop(1.0) + "&modal modes=2 /\n")
    assert run.figures["closed_loops"]["growing"] == 0
    critical = run.figures["closed_loops"]["margins"][0]["gain_margin"]
    growth = {}
    for factor in (1 - 1e-6, 1 + 1e-6):
        poles = poles_of(run_deck(text + STILL + loop(factor * critical) + "&modal modes=2 /\n", name="modes"))
        growth[factor] = poles.real.max()
    assert growth[1 - 1e-6] * growth[1 + 1e-6] < 0.0
    push = "&history name='p' kind='pulse' value=1.0 start=0.0 finish=0.1 /\n"
    push += "&force name='p' type='torque' body='b0' moment=1.0 history='p' /\n"
    push += "&transient t_end=60.0 method='dopri5' tolerance=1e-6 /\n"
    for factor in (0.25, 4.0):
        deck = text + STILL + push + loop(factor * critical)
        told = run_deck(deck.replace("t_end=60.0", "t_end=600.0"), "--check", name="run").stderr
        assert ("controllers make a vibration of" in told) == (factor > 1.0)
        h = run_deck(deck, name="run").history
        early, late = (np.ptp(h["a"][(h.time > start) & (h.time < start + 15.0)]) for start in (15.0, 45.0))
        assert (late > 1.1 * early) == (factor > 1.0)
        assert (late < 0.9 * early) == (factor < 1.0)
