"""Rigid stops: impacts, chatter that ends, closed stops, several at once; closed forms, an independent hybrid program."""

import numpy as np
import pytest
from conftest import ROOT
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

BALL = """&scene gravity=0.0,-9.81 /
&body name='ball' mass=2.0 inertia=1.0 position=0.0,1.0 /
&stop name='floor' type='position' body_a='ball' direction={{pi/2}} lower=0.0 restitution={e} /
&sensor name='y' quantity='position' body='ball' /
&sensor name='floor' quantity='stop' stop='floor' /
&transient t_end=3.0 method={method} output_step=0.05 /
"""


def events_of(run):
    """Return (time, stop, from, to, speed) of each line of events.txt."""
    lines = (run.folder / "events.txt").read_text(encoding="utf-8").splitlines()
    words = [line.split() for line in lines if not line.startswith("#")]
    return [(float(t), stop, before, after, float(speed)) for t, stop, before, after, speed in words]


METHODS = ["'rk4' step=0.01", "'dopri5' tolerance=1e-10", "'radau' tolerance=1e-10", "'generalized_alpha' step=0.0005"]


@pytest.mark.parametrize("method", METHODS)
def test_a_ball_bounces_until_it_lies(run_deck, method):
    """Flights of 2 v/g between speeds e v; the last of endlessly many at t0 (1+e)/(1-e), and then the weight rests on the floor."""
    e, first = 0.7, np.sqrt(2 / 9.81)
    run = run_deck(BALL.format(e=e, method=method))
    *impacts, end = events_of(run)
    speeds = 9.81 * first * e ** np.arange(len(impacts))
    times = first + 2 * first * np.cumsum(np.r_[0, e ** np.arange(1, len(impacts))])
    near = 1e-6 if "alpha" in method else 1e-9
    assert len(impacts) > 30
    assert np.abs(np.array([t for t, *_ in impacts]) - times).max() < near
    assert np.abs(np.array([speed for *_, speed in impacts]) - speeds).max() < 10 * near
    assert {(before, after) for _, _, before, after, _ in impacts} == {("open", "lower_rebound")}
    assert end[2:4] == ("open", "lower")
    assert end[0] == pytest.approx(2.558633965586, abs=near)
    h = run.history
    lies = h["t"] > 2.57
    assert h["floor.f"][lies] == pytest.approx(2 * 9.81, rel=1e-12)
    assert np.abs(h["y.y"][lies]).max() < 1e-13
    assert h["y.y"].min() > -1e-13
    assert run.transient["stops"][0]["lost"] == pytest.approx(2 * 9.81, rel=1e-9 if near < 1e-8 else 1e-6)
    assert run.energy["residual"] == pytest.approx(0.0, abs=1e-6 if near > 1e-8 else 1e-8)


def test_an_impact_oscillator_has_the_orbit_of_its_closed_form(run_deck):
    """Of x'' + w2 x = f cos(W t) with a stop at x = g there is an orbit of one impact a period, started just after one."""
    w, big, f, g, e = 10.0, 15.0, 30.0, 0.05, 0.8
    period, p = 2 * np.pi / big, f / (w**2 - big**2)
    # v: speed at impact; D = -(1+e) v/(2w), P sin = -(1-e) v/(2W), P cos = g + (1+e) v cot(wT/2)/(2w)
    s, c = -(1 - e) / (2 * big), (1 + e) / np.tan(w * period / 2) / (2 * w)
    v = np.roots([s**2 + c**2, 2 * g * c, g**2 - p**2]).max()
    phase = np.arctan2(s * v / p, (g + c * v) / p)
    run = run_deck(f"""&body name='m' mass=1.0 inertia=1.0 position={g},0.0 velocity={-e * v:.17g},0.0 /
&joint name='rail' type='prismatic' body_a='m' /
&spring name='k' type='linear' body_a='m' point_b=-1.0,0.0 stiffness={w**2} free_length=1.0 /
&history name='h' kind='sine' amplitude={f} frequency={big / (2 * np.pi):.17g} phase={phase + np.pi / 2:.17g} /
&force name='f' body='m' fx=1.0 history='h' /
&stop name='s' type='position' body_a='m' upper={g} restitution={e} /
&sensor name='x' quantity='position' body='m' /
&transient t_end={5.5 * period:.17g} method='dopri5' tolerance=1e-12 output_step=0.1 /
""")
    impacts = events_of(run)
    assert [words[3] for words in impacts] == 5 * ["upper_rebound"]
    assert np.abs(np.array([words[0] for words in impacts]) - period * np.arange(1, 6)).max() < 1e-9
    assert np.abs(np.array([words[4] for words in impacts]) - v).max() < 1e-8


def test_impulses_of_joints_and_drives_work(run_deck):
    """An impact at the forearm changes the upper arm's energy by what the elbow's impulse does; a drive takes the rest."""
    run = run_deck("""&body name='base' mass=1.0 inertia=1.0 /
&body name='arm' mass=0.7 inertia=0.01 com=0.2,0.05 angle=0.4 angular_velocity=2.0 /
&body name='fore' mass=0.5 inertia=0.004 com=0.15,0.0 position={0.4*cos(0.4)},{0.4*sin(0.4)} angle=-0.3 angular_velocity=-6.0 /
&joint name='o' type='revolute' body_a='base' /
&history name='h' kind='polynomial' coefficients=0.0,0.5 /
&drive name='d' body_a='base' history='h' /
&joint name='s' type='revolute' body_a='arm' body_b='base' point_b=0.0,0.0 /
&joint name='e' type='revolute' body_a='fore' body_b='arm' point_b=0.4,0.0 /
&stop name='f' type='position' body_a='fore' point_a=0.3,0.0 direction={pi/2} lower=0.05 restitution=0.6 /
&stop name='l' type='rotation' body_a='arm' body_b='base' upper=0.6 restitution=0.5 /
&sensor name='e' quantity='work' joint='e' /
&sensor name='s' quantity='work' joint='s' /
&sensor name='d' quantity='work' drive='d' /
&sensor name='arm' quantity='energy' body='arm' /
&sensor name='fore' quantity='energy' body='fore' /
&transient t_end=0.6 method='dopri5' tolerance=1e-12 output_step=0.01 /
""")
    h = run.history
    lost = {stop["name"]: stop["lost"] for stop in run.transient["stops"]}
    assert min(lost.values()) > 1e-3
    assert np.abs(h["fore.kinetic"] - h["fore.kinetic"][0] - h["e"])[-1] == pytest.approx(lost["f"], rel=1e-9)
    assert np.ptp(h["d"]) > 1e-3
    assert h["d"] == pytest.approx(run.energy["work"], abs=1e-13)


class Linkage:
    """The two links of input/bouncing_linkage.nml by their angles: DOP853 between impacts, impulses by the 2 x 2 mass matrix."""

    m1, i1, l1, c1, m2, i2, l2, c2 = 1.2, 0.03, 0.5, 0.25, 0.8, 0.015, 0.4, 0.2
    restitution = (0.6, 0.5)

    def mass(self, q):
        """Return the matrix."""
        x = self.m2 * self.l1 * self.c2 * np.cos(q[0] - q[1])
        return np.array([[self.i1 + self.m1 * self.c1**2 + self.m2 * self.l1**2, x], [x, self.i2 + self.m2 * self.c2**2]])

    def force(self, q, v):
        """Return what acts beside the stops."""
        s = self.m2 * self.l1 * self.c2 * np.sin(q[0] - q[1])
        weight = 9.81 * np.array([(self.m1 * self.c1 + self.m2 * self.l1) * np.cos(q[0]), self.m2 * self.c2 * np.cos(q[1])])
        return np.array([-s * v[1] ** 2 - 4.0 * (q[0] - 0.5) - 0.15 * v[0], s * v[0] ** 2]) - weight

    def gaps(self, q):
        """Return the distances to the floor and to the limit of the elbow."""
        return np.array([self.l1 * np.sin(q[0]) + self.l2 * np.sin(q[1]) + 0.45, q[1] - q[0] - 0.1])

    def gradient(self, q):
        """Return their derivatives."""
        return np.array([[self.l1 * np.cos(q[0]), self.l2 * np.cos(q[1])], [-1.0, 1.0]])

    def bias(self, q, v):
        """Return their accelerations by the velocities."""
        return np.array([-self.l1 * np.sin(q[0]) * v[0] ** 2 - self.l2 * np.sin(q[1]) * v[1] ** 2, 0.0])

    def accelerations(self, q, v, closed):
        """Return those and the forces of the closed stops."""
        m, j = self.mass(q), self.gradient(q)[closed]
        a = np.linalg.solve(m, self.force(q, v))
        if not closed:
            return a, np.zeros(0)
        push = np.linalg.solve(j @ np.linalg.solve(m, j.T), -(j @ a + self.bias(q, v)[closed]))
        return a + np.linalg.solve(m, j.T @ push), push

    def run(self, q, v, end, rows):
        """Return the events and the states at rows."""
        t, closed, events, states = 0.0, [], [], []
        while True:

            def slope(_, y, closed=tuple(closed)):
                return np.r_[y[2:], self.accelerations(y[:2], y[2:], list(closed))[0]]

            def root(k, closed=tuple(closed)):
                def value(_, y):
                    if k in closed:
                        return self.accelerations(y[:2], y[2:], list(closed))[1][closed.index(k)]
                    return self.gaps(y[:2])[k]

                value.terminal, value.direction = True, -1
                return value

            roots = [root(0), root(1)]
            options = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-14, "max_step": 0.02, "first_step": 1e-7}
            found = solve_ivp(slope, (t, end), np.r_[q, v], events=roots, dense_output=True, **options)
            states += [np.r_[r, found.sol(r)] for r in rows if t <= r < found.t[-1]]
            t, q, v = found.t[-1], found.y[:2, -1], found.y[2:, -1]
            if found.status != 1:
                return events, np.array(states)
            k = [len(times) > 0 for times in found.t_events].index(True)
            if k in closed:
                closed.remove(k)
                events.append((t, k, "open"))
                continue
            events.append((t, k, "rebound"))
            m, j = self.mass(q), self.gradient(q)
            held = [k, *closed]
            while True:
                w = j[held] @ np.linalg.solve(m, j[held].T)
                impulse = np.linalg.solve(w, np.r_[-(1 + self.restitution[k]) * (j @ v)[k], np.zeros(len(held) - 1)])
                if impulse.min() >= 0.0:
                    break
                closed = []
                events.append((t, held.pop(), "open"))
            v = v + np.linalg.solve(m, j[held].T @ impulse)
            u, a = (j @ v)[k], (j @ self.accelerations(q, v, closed)[0] + self.bias(q, v))[k]
            if a < 0 and u**2 < -2 * a * 1e-11 * (0.5, 1.0)[k]:
                closed = [*closed, k]
                events.append((t - 2 * u / a / (1 - self.restitution[k]), k, "closed"))
                j = j[closed]
                v = v - np.linalg.solve(m, j.T @ np.linalg.solve(j @ np.linalg.solve(m, j.T), j @ v))


@pytest.mark.parametrize("method", ["'dopri5' tolerance=1.0e-10", "'radau' tolerance=1.0e-10"])
def test_a_bouncing_linkage_against_an_independent_program(run_deck, method):
    """Impacts, chatter, sliding on the floor, a release by the impact of another stop: 150 events in 3 s."""
    deck = (ROOT / "input" / "bouncing_linkage.nml").read_text(encoding="utf-8").replace("'dopri5' tolerance=1.0e-10", method)
    run = run_deck(deck)
    h = run.history
    events, states = Linkage().run(np.array([0.2, 0.9]), np.zeros(2), 3.0, h["t"])
    found = [(t, ["floor", "ligament"].index(stop), word) for t, stop, _, word, _ in events_of(run)]
    names = {"lower_rebound": "rebound", "lower": "closed", "open": "open"}
    assert [(k, names[word]) for _, k, word in found] == [(k, word) for _, k, word in events]
    assert len(found) > 100
    assert np.abs(np.array([t for t, *_ in found]) - [t for t, *_ in events]).max() < 1e-9
    away = np.array([min(abs(t - event) for event, *_ in events) > 1e-8 for t in states[:, 0]])
    for k, name in enumerate(("upper", "fore")):
        assert np.abs(h[name][: len(states)] - states[:, 1 + k])[away].max() < 2e-9
    assert np.abs(h["rates"][: len(states)] - states[:, 4])[away].max() < 1e-7
    assert np.abs(run.energy["residual"]).max() < 1e-8
    assert h["tip.y"].min() > -0.45 - 1e-13


@pytest.mark.parametrize("supports", [(-1.0, 0.5), (-0.8, 0.0, 0.8), (-1.0, 0.2, 0.7)])
@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_a_bar_that_falls_flat_onto_several_supports(run_deck, supports, e):
    """All are met at once. A body over two outer ones does not turn: it rebounds flat, and is left with e times its speed."""
    stops = "".join(
        f"&stop name='s{k}' type='position' body_a='bar' point_a={x},0.0 direction={{pi/2}} lower=0.0 restitution={e} /\n"
        f"&sensor name='s{k}' quantity='stop' stop='s{k}' /\n"
        for k, x in enumerate(supports)
    )
    run = run_deck(f"""&scene gravity=0.0,-10.0 /
&body name='bar' mass=3.0 inertia=0.5 position=0.0,0.8 /
{stops}&sensor name='v' quantity='velocity' body='bar' /
&sensor name='w' quantity='angular_velocity' body='bar' /
&transient t_end=0.45 method='dopri5' tolerance=1e-10 output_step=0.05 /
""")
    h = run.history
    assert h["v.y"][-1] == pytest.approx(4 * e - 0.5 if e else 0.0, abs=1e-9)
    assert np.abs(h["w"]).max() < 1e-12
    struck = [words for words in events_of(run) if words[2] == "open"]
    assert [(words[0], words[4]) for words in struck] == [pytest.approx((0.4, 4.0), rel=1e-12)] * len(supports)
    assert sum(stop["lost"] for stop in run.transient["stops"]) == pytest.approx(1.5 * 16 * (1 - e**2), rel=1e-11, abs=1e-11)
    if not e:
        carried = [h[f"s{k}.f"][-1] for k in range(len(supports))]
        assert min(carried) >= 0.0
        assert sum(carried) == pytest.approx(30.0)
        assert np.dot(carried, supports) == pytest.approx(0.0, abs=1e-12)
        assert all(h[f"s{k}.gap"][-1] == pytest.approx(0.0, abs=1e-13) for k in range(len(supports)))


RESTING = """&scene gravity=0.0,-10.0 /
&body name='a' mass=2.0 inertia=0.1 com=0.5,0.0 /
&body name='b' mass=1.0 inertia=0.02 com=0.3,0.0 position=1.0,0.0 angle={-pi/2} /
&joint name='p' type='revolute' body_a='a' /
&joint name='q' type='revolute' body_a='b' body_b='a' point_b=1.0,0.0 /
&spring name='s' type='torsional' body_a='a' stiffness=5.0 free_angle=0.1 /
&spring name='t' type='torsional' body_a='b' stiffness=1.0 free_angle={-pi/2} /
&stop name='low' type='rotation' body_a='a' lower=-0.1 upper=0.3 restitution=0.5 /
&sensor name='low' quantity='stop' stop='low' /
&force name='f' type='torque' body='b' moment=1.0 /
"""


def test_a_stop_is_closed_in_statics_modes_and_responses(run_deck):
    """The arm lies on its limit with the moment of its weight less that of the spring; what hangs from it swings alone."""
    deck = RESTING.replace("moment=1.0", "moment=1.0 stage='transient' history='none'")
    deck += "&history name='none' kind='polynomial' coefficients=0.0 /\n&static /\n&modal modes=1 /\n"
    deck += "&frequency_response from=1.0 to=2.0 points=2 input='f' /\n"
    run = run_deck(deck + "&transient t_end=0.1 method='rk4' step=0.01 /\n")
    moment = (2 * 10 * 0.5 + 10 * 1.0) * np.cos(0.1) - 5 * 0.2
    assert run.history["low.f"] == pytest.approx(moment, rel=1e-12)
    assert run.summary.count('rigid stops that are closed: "low"') == 2
    table = np.loadtxt(run.folder / "modes.txt", ndmin=2)
    assert table[0, 3] == pytest.approx(np.sqrt((1 + 10 * 0.3) / (0.02 + 0.3**2)) / (2 * np.pi), rel=1e-12)


def test_a_stop_that_the_last_load_step_enters_is_closed(run_deck):
    """A mass sinks on a spring onto a stop just above where it would hang: 0.4905 m for 0.47 m."""
    deck = "&scene gravity=0.0,-9.81 /\n&body name='b' mass=1.0 inertia=1.0 /\n"
    deck += "&joint name='g' type='prismatic' body_a='b' direction={pi/2} /\n&static /\n"
    deck += "&spring name='k' body_a='b' point_b=0.0,2.0 stiffness=20.0 free_length=2.0 /\n"
    deck += "&stop name='s' type='position' body_a='b' direction={pi/2} lower=-0.47 restitution=0.5 /\n"
    run = run_deck(deck + "&sensor name='y' quantity='position' body='b' /\n&sensor name='s' quantity='stop' stop='s' /\n")
    last = np.loadtxt(run.folder / "static.txt")[-1]
    assert last[[4, 5, 7]] == pytest.approx([-0.47, 9.81 - 20.0 * 0.47, -1.0], rel=1e-12)


def test_what_no_rigid_stop_can_hold_is_told(run_deck):
    arm = "&body name='a' mass=2.0 inertia=0.1 com=0.5,0.0 angle={} /\n&joint name='p' type='revolute' body_a='a' /\n"
    arm += "&stop name='wall' type='rotation' body_a='a' upper=0.3 restitution=0.5 /\n"
    arm += "&sensor name='a' quantity='angle' body='a' /\n"
    drive = "&history name='h' kind='polynomial' coefficients=0.0,1.0 /\n&drive name='m' type='rotation' body_a='a' history='h' /\n"
    transient = "&transient t_end=1.0 method='dopri5' tolerance=1e-8 /\n"
    said = run_deck(arm.format(0) + drive + transient, expect=1).stderr
    assert 'stop "wall" is rigid, and what presses on it at t = 3.000000E-01 s cannot give way: it is moved by drive "m"' in said
    said = run_deck(arm.format(0.5) + transient, expect=2).stderr
    assert 'stop "wall": it is rigid, and it begins beyond its limit: it measures 0.5 rad, allowed is up to 0.3' in said


ARM = """&scene gravity=0.0,-9.81 /
&body name='arm' mass=1.6 inertia=0.05 position=0.35,0.0 angular_velocity=4.0 /
&joint name='p' type='revolute' body_a='arm' point_a=-0.35,0.0 point_b=0.0,0.0 /
&stop name='low' type='rotation' body_a='arm' lower=-0.5 upper=0.3 restitution=0.9 /
&spring name='s' type='torsional' body_a='arm' stiffness=20.0 free_angle=0.0 /
&sensor name='a' quantity='position' body='arm' point=0.2,0.0 /
&sensor name='v' quantity='velocity' body='arm' point=0.2,0.0 /
&sensor name='acc' quantity='acceleration' body='arm' point=0.2,0.0 /
&sensor name='pin' quantity='reaction' joint='p' /
&transient t_end=2.0 method={} output_step=0.05 accept_unstable=.true. /
"""


@pytest.mark.parametrize(
    ("method", "order", "step"), [("rk4", 4, 5e-3), ("dopri5", 5, 1e-2), ("radau", 5, 1e-2), ("generalized_alpha", 2, 2.5e-3)]
)
def test_methods_keep_their_order_across_impacts(method, order, step, run_deck):
    runs = [run_deck(ARM.format(f"'{method}' step={step / k}"), name=f"h{k}") for k in (1, 2, 4)]
    assert len({tuple(words[1:4] for words in events_of(run)) for run in runs}) == 1
    assert len(events_of(runs[0])) > 3
    coarse, fine = ({x: np.abs(a.history[x] - b.history[x]).max() for x in a.history.names[1:]} for a, b in zip(runs, runs[1:]))
    for column, error in fine.items():
        if error > 0.0:
            assert order - 0.3 < np.log2(coarse[column] / error) < order + 0.8, column


WALLS = """&scene gravity={9.81*sin(b)},{-9.81*cos(b)} /
&parameter name='b' value=0.3 /
&body name='b' mass=2.0 inertia=0.1 position={0.1*cos(b)},{0.1*sin(b)} angle={b} velocity={-0.3*cos(b)},{-0.3*sin(b)} /
&joint name='rail' type='prismatic' body_a='b' direction={b} FRICTION /
&stop name='wall' type='position' body_a='b' direction={b} lower=0.05 upper=0.2 restitution=RESTITUTION /
&history name='h' kind='sine' amplitude=12.0 frequency=1.0 phase=3.0 /
&force name='f' body='b' fx=1.0 axes='body' history='h' /
&sensor name='x' quantity='position' body='b' /
&transient method=METHOD t_end=3.0 output_step=0.02 /
"""


def test_a_stop_is_left_whenever_the_load_turns(run_deck):
    """Nothing moves while a block is pressed on a wall: steps are no longer than a row, however small all errors are."""
    run = run_deck(WALLS.replace("FRICTION", "").replace("RESTITUTION", "0").replace("METHOD", "'dopri5' tolerance=1e-6"))
    left = [t for t, _, before, after, _ in events_of(run) if after == "open"]
    assert left == pytest.approx((np.arange(2, 7) * np.pi - 3) / (2 * np.pi), abs=1e-9)


def block_before_a_wall(end):
    """Return the events of the block of WALLS with friction, a rebound of 0.5 and one wall; each motion is a closed form."""
    largest, kinetic, static, w, wall = 6.0, 0.2 * 9.81, 0.25 * 9.81, 2 * np.pi, 0.05
    t, x, v, sign, found = 0.0, 0.1, -0.3, -1, []
    ways = {1: "forward", -1: "backward"}

    def load(s):
        return largest * np.sin(w * s + 3.0)

    def first(g, begin):
        grid = begin + (end - begin) * np.r_[1e-12 * 1.3 ** np.arange(100), np.linspace(1e-3, 1.0, 3000)]
        falls = np.flatnonzero((g(grid[:-1]) > 0) & (g(grid[1:]) <= 0))
        return brentq(g, grid[falls[0]], grid[falls[0] + 1], xtol=1e-16) if len(falls) else np.inf

    while True:
        a, b, p = largest / w, -sign * kinetic, w * t + 3.0

        def speed(s, t=t, v=v, a=a, b=b, p=p):
            return v + b * (s - t) + a * (np.cos(p) - np.cos(w * s + 3.0))

        def place(s, t=t, x=x, v=v, a=a, b=b, p=p):
            return x + (v + a * np.cos(p)) * (s - t) + b * (s - t) ** 2 / 2 - a / w * (np.sin(w * s + 3.0) - np.sin(p))

        turn = first(lambda s, sign=sign, speed=speed: sign * speed(s), t)
        hit = first(lambda s, place=place: place(s) - wall, t) if sign < 0 else np.inf
        t = min(turn, hit)
        if t > end:
            return found
        if turn < hit:
            found.append((t, "rail", ways[sign], ways[-sign]))
            x, v, sign = place(t), 0.0, -sign
            assert sign * load(t) > static
            continue
        x, v, sign, fall = wall, -0.5 * speed(t), 1, kinetic - load(t)
        found.append((t, "wall", "open", "lower_rebound"))
        if v**2 > 2 * fall * 1e-11 * 0.1:  # the scene is 0.1 m large
            found.append((t, "rail", "backward", "forward"))
            continue
        found += [(t + 4 * v / fall, "wall", "open", "lower"), (t, "rail", "backward", "at_limit")]
        t = first(lambda s: -static - load(s), t)  # friction alone holds it, at the wall
        found += [(t, "wall", "lower", "lower_unloaded"), (t, "rail", "at_limit", "stuck")]
        t = first(lambda s: static - load(s), t)
        found += [(t, "wall", "lower_unloaded", "open"), (t, "rail", "stuck", "forward")]
        v = 0.0


def test_friction_and_rigid_stops_together(run_deck):
    """Rebounds, rest at the wall by friction alone, shares of both: two methods have the events of an independent program."""
    deck = WALLS.replace("FRICTION", "friction=0.2 friction_static=0.25").replace(" upper=0.2", "").replace("RESTITUTION", "0.5")
    runs = [run_deck(deck.replace("METHOD", f"'{method}' tolerance=1e-10"), name=method) for method in ("dopri5", "radau")]
    expected = block_before_a_wall(3.0)
    pairs = (("open", "lower"), ("lower", "lower_unloaded"))
    closed, opened = (next(words[0] for words in expected if words[2:4] == pair) for pair in pairs)
    for run in runs:
        events = events_of(run)
        assert [words[1:4] for words in events] == [words[1:] for words in expected]
        assert np.abs(np.array([words[0] for words in events]) - [words[0] for words in expected]).max() < 1e-9
        assert run.transient["energy_balance"] < 1e-8
        assert run.transient["friction"][0]["undetermined"] == pytest.approx(opened - closed, abs=1e-5)  # closing is dated later


@pytest.mark.parametrize("method", ["'dopri5' tolerance=1e-5", "'dopri5' tolerance=1e-9", *METHODS[2:]])
def test_all_loads_pass_through_zero_at_an_event(method, run_deck):
    """A sled pushes another one, whose rail presses nothing, by a stop; both part when the load of all is zero, at pi."""
    run = run_deck(
        """&body name='a' mass=1.467 inertia=0.05 /
&joint name='ra' type='prismatic' body_a='a' friction=0.236 /
&body name='b' mass=1.406 inertia=0.05 position=0.5,0 /
&joint name='rb' type='prismatic' body_a='b' body_b='a' point_a=-0.5,0 friction=0.146 /
&stop name='ab' type='position' body_a='b' body_b='a' lower=0.462 upper=0.646 restitution=0.0 /
&stop name='wall' type='position' body_a='a' lower=-0.258 upper=0.684 restitution=0.0 /
&history name='h' kind='sine' amplitude=4.430 frequency=0.939 phase=0.245 /
&force name='f' type='force' body='a' point=0.120,-0.171 fx=3.796 fy=0.476 history='h' /
&sensor name='b' quantity='velocity' body='b' /
&transient t_end=0.55 output_step=0.01 method={method} /
""".replace("{method}", method)
    )
    left = [words[0] for words in events_of(run) if words[1:4] == ("ab", "lower", "open")]
    assert left == pytest.approx([(np.pi - 0.245) / (2 * np.pi * 0.939)], abs=1e-9)
    assert np.ptp(run.history["b.x"][run.history["t"] > left[0]]) < 1e-9  # nothing acts on it any more


def test_friction_that_hardly_acts_on_a_freedom(run_deck):
    """A stop is left while a pin hardly turns with the mechanism: it is carried, then slips; no event changes nothing."""
    deck = """&scene gravity=0,-9.81 /
&body name='k' mass=1.968 inertia=0.0257 com=0.072239945463803246,0 angle=2.1470052009032674 angular_velocity=0.000 /
&body name='r' mass=0.475 inertia=0.0394 com=0.24189163954532053,0 position=-0.078719705440993798,0.12115133865433035
  angle=0.54277737547386429 /
&body name='s' mass=1.796 inertia=0.0213 com=0.20518233369604058,0 position=0.51084272409201403,0 angle=2.0121952583385161 /
&joint name='o' type='revolute' body_a='k' friction=0.000 pin_radius=0.028 preload=0.055 /
&joint name='p' type='revolute' body_a='r' body_b='k' point_b=0.14447989092760649,0 /
&joint name='q' type='revolute' body_a='r' body_b='s' point_a=0.48378327909064106,0 point_b=0.41036466739208116,0
  friction=0.300 friction_static=0.380 pin_radius=0.010 /
&joint name='t' type='revolute' body_a='s' point_b=0.51084272409201403,0 /
&stop name='sk' type='rotation' body_a='k' upper=3.140 lower=0.944 restitution=0.0 /
&history name='h' kind='sine' amplitude=2.992 frequency=1.650 phase=1.563 /
&force name='m' type='torque' body='k' moment=1 history='h' /
&sensor name='x' quantity='position' body='k' point=.1,.1 /
&sensor name='w' quantity='angular_velocity' body='k' /
&sensor name='fo' quantity='friction' joint='o' /
&sensor name='fq' quantity='friction' joint='q' /
&transient t_end=0.5 output_step=0.01 method={} /
"""
    runs = [run_deck(deck.format(method), name=method[1:4]) for method in ("'dopri5' tolerance=1e-10", "'radau' tolerance=1e-9")]
    first, second = (events_of(run) for run in runs)
    assert [words[1:4] for words in first] == [words[1:4] for words in second]
    assert all(words[2] != words[3] for words in first)
    left = next(words[0] for words in first if words[1:4] == ("sk", "upper_unloaded", "open"))
    assert {words[1:4] for words in first if words[0] == left} == {("sk", "upper_unloaded", "open"), ("o", "stuck", "backward")}
    assert runs[0].history["x.x"] == pytest.approx(runs[1].history["x.x"], abs=1e-8)


GEARED = """&body name='a' mass=1.0 inertia=0.05 /
&body name='b' mass=1.0 inertia=0.02 position=0.3,0.0 /
&joint name='ja' type='revolute' body_a='a' /
&joint name='jb' type='revolute' body_a='b' point_b=0.3,0.0 friction=0.0 pin_radius=0.02 preload=0.05 /
&joint name='g' type='gear' body_a='b' body_b='a' ratio=-1.7 /
&stop name='s' type='rotation' body_a='a' upper=1.3 restitution=0.0 /
&history name='h' kind='sine' amplitude=6.0 frequency=0.9 phase=0.5 /
&force name='m' type='torque' body='a' moment=1.0 history='h' /
&sensor name='a' quantity='angle' body='a' /
&transient t_end=0.6 output_step=0.01 method=METHOD /
"""


@pytest.mark.parametrize("method", METHODS)
def test_a_stop_and_friction_behind_a_gear_hold_one_freedom(method, run_deck):
    """The moment 6 sin(p) falls to what friction holds, 1.7 0.05 N m, and the stop is relieved; at its negative the arm leaves."""
    run = run_deck(GEARED.replace("METHOD", method))
    hit, *_, left = events_of(run)
    assert hit[1:4] == ("s", "open", "upper")
    moments = {words[1:4]: words[0] for words in events_of(run)[1:]}
    assert moments["jb", "backward", "at_limit"] == hit[0]  # at rest with the arm, at its limit
    held = np.arcsin(0.085 / 6)
    for words, phase in (("s", "upper", "upper_unloaded"), np.pi - held), (("s", "upper_unloaded", "open"), np.pi + held):
        assert moments[words] == pytest.approx((phase - 0.5) / (2 * np.pi * 0.9), abs=1e-12)
    assert left[0] == moments["s", "upper_unloaded", "open"]
    assert left[1:4] == ("jb", "stuck", "forward")
    assert run.history["a"][-1] < 1.3


def test_an_impact_moves_a_body_that_friction_holds(run_deck):
    """The impulse goes through the masses alone; the body that stuck slides v^2/(2 mu g), then sticks again."""
    run = run_deck("""&scene gravity=0.0,-9.81 /
&body name='a' mass=1.0 inertia=0.1 velocity=1.2,0.0 /
&body name='b' mass=2.0 inertia=0.1 position=0.4,0.0 /
&joint name='rail_a' type='prismatic' body_a='a' /
&joint name='rail_b' type='prismatic' body_a='b' friction=0.1 friction_static=0.3 /
&stop name='buffer' type='position' body_a='b' body_b='a' lower=0.1 restitution=0.8 /
&sensor name='a' quantity='position' body='a' /
&sensor name='b' quantity='position' body='b' /
&sensor name='v' quantity='velocity' body='a' /
&transient method='generalized_alpha' step=0.01 t_end=1.5 output_step=0.05 /
""")
    v = 1.8 * 1.2 / 3
    assert [words[1:4] for words in events_of(run)] == [
        ("buffer", "open", "lower_rebound"),
        ("rail_b", "stuck", "forward"),
        ("rail_b", "forward", "stuck"),
    ]
    assert [words[0] for words in events_of(run)] == pytest.approx([0.25, 0.25, 0.25 + v / 0.981], abs=1e-12)
    assert run.history["b.x"][-1] == pytest.approx(0.4 + v**2 / 1.962, abs=1e-12)
    assert run.history["v.x"][-1] == pytest.approx(1.2 - 2 * v, abs=1e-12)
    assert run.transient["stops"][0]["lost"] == pytest.approx(0.5 * (1 - 0.8**2) * 1.2**2 / 1.5, rel=1e-12)
    assert run.transient["energy_balance"] < 1e-12


TURN = """&body name='arm' mass=1.2 inertia=0.1 com=0.3,0.0 /
&joint name='pin' type='revolute' body_a='arm' /
&stop name='s' type='rotation' body_a='arm' upper=0.3 restitution=0.5 /
&spring name='k' type='linear' body_a='arm' point_a=0.3,0.0 point_b=3.0,3.0 stiffness=1.0 free_length=0.1 /
&sensor name='a' quantity='angle' body='arm' /
"""


def test_a_stop_of_an_angle_in_a_scene_that_is_not_one_metre_long(run_deck):
    """Its limit in statics and its impulse are an angle and a moment's, whatever the length is by which angles are weighed."""
    assert np.loadtxt(run_deck(TURN + "&static /\n", name="rest").folder / "static.txt")[-1, -1] == pytest.approx(0.3, rel=1e-13)
    run = run_deck(TURN + "&transient t_end=2 method='dopri5' tolerance=1e-10 /\n", name="hit")
    speed = events_of(run)[0][4]
    assert run.transient["stops"][0]["largest_impulse"] == pytest.approx((0.1 + 1.2 * 0.3**2) * 1.5 * speed, rel=1e-9)


def test_what_rests_on_a_stop_stays_there_when_its_other_end_hits(run_deck):
    """The impact at the right would throw the left end through its stop, which stops it at once: nothing rebounds there."""
    stops = "".join(
        f"&stop name='{name}' type='position' body_a='rod' point_a={x},0 direction={{pi/2}} lower=0 restitution=0.5 /\n"
        f"&sensor name='{name}' quantity='velocity' body='rod' point={x},0 /\n"
        for name, x in (("left", -0.3), ("right", 0.3))
    )
    run = run_deck(f"""&scene gravity=0,-9.81 /
&body name='rod' mass=1.2 inertia=0.03 position=0,0.15 angle={{pi/6}} /
{stops}&transient method='dopri5' tolerance=1e-10 t_end=0.25 output_step=0.01 /
""")
    assert [(words[1], words[2]) for words in events_of(run)] == [("right", "open")]
    assert np.abs(run.history["left.y"]).max() < 1e-12
    assert run.history["right.y"].max() > 0.4 * events_of(run)[0][4]


START = """&body name='b' mass=2 inertia=1 velocity={v},0 /
&joint name='g' type='prismatic' body_a='b' /
&sensor name='x' quantity='position' body='b' /
&sensor name='v' quantity='velocity' body='b' /
&stop name='s' type='position' body_a='b' {limits} restitution=0.5 /
&transient t_end=1 output_step=0.1 {steps} /
"""


@pytest.mark.parametrize("steps", [f"method={words}" for words in ("'dopri5' tolerance=1e-9", *METHODS[2:])])
@pytest.mark.parametrize(("v", "limits"), [(1.0, "upper=0"), (-1.0, "lower=0"), (1.0, "lower=-0.2 upper=0")])
def test_an_impact_at_the_start(v, limits, steps, run_deck):
    """A body at its stop that moves into it parts with half the speed; what is lost stands in the balance of the first row."""
    run = run_deck(START.format(v=v, limits=limits, steps=steps))
    assert events_of(run)[0] == (0.0, "s", "open", "upper_rebound" if v > 0 else "lower_rebound", 1.0)
    assert run.history["v.x"][:3] == pytest.approx(-0.5 * v)
    assert run.energy["dissipated"][0] == pytest.approx(0.75)
    assert abs(run.energy["residual"]) == pytest.approx(0.0, abs=1e-12)


def test_a_rigid_stop_is_met_by_the_mass_of_a_body_without_joints(run_deck):
    """Rows of stops that are open hold nothing: with a guide, which has rows as well, the mass is the same."""
    deck = "&body name='b' mass=2 inertia=1 position=0,1 /\n"
    deck += "&stop name='s' type='position' body_a='b' direction={pi/2} lower=0 restitution=0.5 /\n"
    guide = "&joint name='g' type='prismatic' body_a='b' direction={pi/2} point_b=0,1 /\n"
    for more in ("", guide):
        run = run_deck(deck + more + "&transient t_end=1 method='dopri5' tolerance=1e-8 /\n", "--check")
        assert "rigid, met by 2 kg" in run.stdout
