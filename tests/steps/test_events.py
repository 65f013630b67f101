"""Events: located to rounding in all methods, none missed or invented, anywhere in a step; the methods keep their order."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

ARM = """&scene gravity=0.0,-9.81 /
&body name='arm' mass=1.6 inertia=0.05 position=0.35,0.0 angular_velocity=4.0 /
&joint name='p' type='revolute' body_a='arm' point_a=-0.35,0.0 point_b=0.0,0.0 /
&stop name='low' type='rotation' body_a='arm' lower=-0.5 upper=0.3 stiffness={} exponent={} {} /
&spring name='s' type='torsional' body_a='arm' stiffness=20.0 free_angle=0.0 /
&sensor name='a' quantity='position' body='arm' point=0.2,0.0 /
&sensor name='v' quantity='velocity' body='arm' point=0.2,0.0 /
&sensor name='acc' quantity='acceleration' body='arm' point=0.2,0.0 /
&sensor name='pin' quantity='reaction' joint='p' /
&sensor name='contact' quantity='stop' stop='low' /
&transient t_end=1.5 method={} output_step=0.05 accept_unstable=.true. /
"""


def errors(history, exact):
    """Return the largest error of each column that moves, over its range."""
    names = [name for name in exact.names[1:] if np.ptp(exact[name]) > 0.0 and not name.endswith("state")]
    return {name: np.abs(history[name] - exact[name]).max() / np.ptp(exact[name]) for name in names}


def events_of(run):
    """Return the words of each line of events.txt."""
    lines = (run.folder / "events.txt").read_text(encoding="utf-8").splitlines()
    return [line.split() for line in lines if not line.startswith("#")]


@pytest.mark.parametrize(("exponent", "stiffness"), [(1, 200), (1.5, 600), (3, 10000)])
@pytest.mark.parametrize(
    ("method", "order", "step"), [("rk4", 4, 5e-3), ("dopri5", 5, 5e-3), ("radau", 5, 5e-3), ("generalized_alpha", 2, 2.5e-3)]
)
def test_methods_keep_their_order_across_contacts(method, order, step, exponent, stiffness, run_deck):
    """All columns, across contacts that begin and end anywhere in a step; for the power 1.5 steps are graded."""
    runs = []
    for k in (1, 2, 4):
        deck = ARM.format(stiffness, exponent, "damping=0.1", f"'{method}' step={step / k}")
        runs.append(run_deck(deck, name=f"h{k}"))
        states = [words[2:4] for words in events_of(runs[-1])]
        assert states == (3 * [["open", "lower"], ["lower", "open"]])[: len(states)]
        assert len(states) > 4
    coarse = errors(runs[0].history, runs[1].history)
    fine = errors(runs[1].history, runs[2].history)
    for column, error in fine.items():
        assert order - 0.25 < np.log2(coarse[column] / error) < order + 0.6, column


def arm_by_hand(times, hardness, exponent, e):
    """Return angle and rate of ARM at times: one freedom and the law of its stops by DOP853, no program of ours."""
    y = brentq(lambda y: np.log((1 + y) / (1 - e * y)) - y * (1 + e), 1e-6, 1 / e - 1e-9, xtol=1e-16, rtol=1e-15)
    limits = {1: 0.3, -1: -0.5}

    def rates(_t, s, side, chi):
        moment = -1.6 * 9.81 * 0.35 * np.cos(s[0]) - 20.0 * s[0]
        if side:
            depth = max(side * (s[0] - limits[side]), 0.0)
            moment -= side * hardness * depth**exponent * (1 + chi * side * s[1])
        return [s[1], moment / (0.05 + 1.6 * 0.35**2)]

    t, s, side, chi, rows = 0.0, np.array([0.0, 4.0]), 0, 0.0, []
    while len(rows) < len(times):
        signs = {side: side} if side else {1: -1, -1: 1}
        gaps = [lambda _t, s, *_, k=k, sign=sign: sign * (s[0] - limits[k]) for k, sign in signs.items()]
        for gap in gaps:
            gap.terminal, gap.direction = True, -1
        law = {"args": (side, chi), "events": gaps, "rtol": 1e-13, "atol": 1e-15, "max_step": 2e-3}
        run = solve_ivp(rates, (t, times[-1]), s, "DOP853", times[times > t], **law)
        rows.extend(run.y.T if len(run.t) else [])
        if run.status == 1:
            which = next(k for k, found in enumerate(run.t_events) if len(found))
            t, s = run.t_events[which][-1], run.y_events[which][-1]
            side = 0 if side else [1, -1][which]
            chi = y / abs(s[1])
    return np.array(rows).T


@pytest.mark.parametrize("exponent", [1, 1.5, 2.2])
def test_errors_stay_within_a_hundred_tolerances(exponent, run_deck):
    """All columns beside a fine run, which agrees with an independent integration where the arm is and how fast it moves."""
    hardness = 3e3 * 10 ** (2 * exponent - 2)
    deck = ARM.format(hardness, exponent, "restitution=0.7", "{}")
    exact = run_deck(deck.format("'dopri5' tolerance=1e-12"), name="exact").history
    angle, rate = arm_by_hand(exact["t"][1:], hardness, exponent, 0.7)
    assert np.abs(exact["a.x"][1:] - 0.55 * np.cos(angle)).max() < 1e-10
    assert np.abs(exact["v.y"][1:] - 0.55 * rate * np.cos(angle)).max() < 1e-9
    for method, tolerance in (("dopri5", 1e-6), ("dopri5", 1e-10), ("radau", 1e-6), ("radau", 1e-8)):
        run = run_deck(deck.format(f"'{method}' tolerance={tolerance}"), name=f"{method}{tolerance:g}")
        assert max(errors(run.history, exact).values()) < 100 * tolerance, (method, tolerance)


def rotors(fractions, step, stiffness):
    """Return a deck of free rotors, each of which comes to its stop at a fraction of the sixth step, and where the stops are."""
    limits = [(5 + fraction) * step for fraction in fractions]
    deck = ""
    for k, limit in enumerate(limits):
        deck += f"&body name='b{k}' mass=1.0 inertia=1.0 angular_velocity=1.0 /\n"
        deck += f"&stop name='t{k}' type='rotation' body_a='b{k}' upper={limit:.17g} stiffness={stiffness} exponent=1 /\n"
        deck += f"&sensor name='x{k}' quantity='angle' body='b{k}' /\n"
    return deck + "&transient t_end=0.6 method={} output_step=0.06 /\n", np.array(limits)


@pytest.mark.parametrize(
    ("method", "error"),
    [
        ("'rk4' step=0.01", 2e-5),
        ("'dopri5' step=0.01", 2e-7),
        ("'radau' step=0.01", 1e-7),
        ("'generalized_alpha' step=0.01", 2e-3),
        ("'dopri5' tolerance=1e-9", 2e-9),
        ("'radau' tolerance=1e-9", 1e-10),
    ],
)
def test_events_lie_anywhere_in_a_step(method, error, run_deck):
    """From 1e-16 to 1 of a step from its ends, alone and at equal times; the exact motion is half a sine in contact."""
    ends = [10.0**-k for k in range(1, 17)]
    for fractions in ([0.0, 0.0, *ends, 0.3, 0.3, 0.5, *[1 - x for x in ends]], *[[x] for x in (2e-6, 1 - 2e-6, 1 - 5e-7)]):
        deck, limits = rotors(fractions, 0.01, 400)
        run = run_deck(deck.format(method))
        assert len(events_of(run)) == 2 * len(fractions)
        for k, limit in enumerate(limits):
            since = run.history["t"] - limit
            x = np.where(since < 0, since, np.where(since < np.pi / 20, np.sin(20 * since) / 20, np.pi / 20 - since)) + limit
            assert np.abs(run.history[f"x{k}"] - x).max() < error, fractions[k]
        for words in events_of(run):
            if words[2] == "open":
                assert abs(float(words[0]) - limits[int(words[1][1:])]) < 1e-13


@pytest.mark.parametrize("method", ["'rk4' step=0.005", "'radau' step=0.0125", "'dopri5' tolerance=1e-9"])
def test_no_grazing_contact_is_missed_or_invented(method, run_deck):
    """Two hundred vibrations whose amplitudes differ from their limits by a millionth at most: touches within a step."""
    random = np.random.default_rng(3)
    speed = 2 * np.pi
    deck, touching = "", set()
    for k in range(200):
        phase, margin = random.uniform(0.05, speed - 0.05), random.choice([-1, 1]) * random.uniform(1e-8, 1e-6)
        deck += f"&body name='b{k}' mass=1.0 inertia=1.0 angle={np.sin(phase)} angular_velocity={speed * np.cos(phase)} /\n"
        deck += f"&spring name='s{k}' type='torsional' body_a='b{k}' stiffness={speed**2} free_angle=0.0 /\n"
        deck += f"&stop name='t{k}' type='rotation' body_a='b{k}' upper={1 + margin} stiffness=1e4 exponent=1.0 /\n"
        if margin < 0.0 and (np.pi / 2 - phase) % speed < np.pi:
            touching.add(f"t{k}")
    run = run_deck(
        deck + f"&sensor name='x' quantity='angle' body='b0' /\n&transient t_end=0.5 method={method} output_step=0.1 /\n"
    )
    assert {words[1] for words in events_of(run)} == touching
    assert len(events_of(run)) == 2 * len(touching)


HOPPING = """&scene gravity=0.0,-9.81 /
&body name='b' mass=0.9354394938516586 inertia=0.003 position=0.0,0.1620824899323869 angle=-1.2131645533303614
  velocity=-0.9634173440000726,-0.9680036315246587 angular_velocity=-2.830745740775237 /
&stop name='s0' type='position' body_a='b' point_a=-0.014675624085022869,0.04357161207209874 direction=1.5707963267948966
  lower=0.0 stiffness=4565928.991395172 damping=1.2541873975110671 /
&stop name='s1' type='position' body_a='b' point_a=0.014675624085022869,0.03 direction=1.5707963267948966
  lower=-0.01 stiffness=13375834341.793095 exponent=2.8921610369894273 restitution=0.05 /
&sensor name='x' quantity='angle' body='b' /
&transient t_end=0.5 method='dopri5' tolerance={} output_step=0.1 /
"""


def test_a_piece_that_ends_at_an_event_errs_no_more_than_a_step(run_deck):
    """A whole step across the end of a contact may err little by chance, where the piece up to there errs much."""
    times = []
    for tolerance in (1e-8, 1e-11):
        run = run_deck(HOPPING.format(tolerance), name=f"{tolerance:g}")
        times.append(np.array([float(words[0]) for words in events_of(run)]))
    assert np.abs(times[0] - times[1]).max() < 1e-8


def test_events_without_end_are_told_with_names(run_deck):
    deck = "&body name='b' mass=1.0 inertia=1.0 /\n&sensor name='x' quantity='angle' body='b' /\n"
    deck += "&stop name='tight' type='rotation' body_a='b' lower=-1e-9 upper=1e-9 stiffness=1e14 exponent=1 /\n"
    deck += "&history name='kick' kind='table' time=0.5,0.500001,0.500002 value=0,1e6,0 /\n"  # to 1 rad/s
    deck += "&force name='f' type='torque' body='b' moment=1 history='kick' /\n"
    run = run_deck(deck + "&transient t_end=1000 method='dopri5' tolerance=1e-6 output_step=1 /\n", expect=1)
    assert "events follow one another without end at t = 5.00" in run.stderr
    assert 's, in "tight": more than 1000 in a millionth of the run' in run.stderr
    assert "an explicit step be too large" in run.stderr
    deck = """&body name='b' mass=1.0 inertia=1.0 position=0.1,0 /
&joint name='rail' type='prismatic' body_a='b' friction=0 preload=1e-6 /
&spring name='stiff' body_a='b' stiffness=1e14 damping=0 free_length=0 /
&sensor name='x' quantity='position' body='b' /
&history name='zero' kind='polynomial' coefficients=0 /
&controller name='limiter' argument='x.x' history='zero' kp=1 upper=0.01 lower=-0.01 /
&force name='f' body='b' fx=1 controller='limiter' /
"""  # ten million radians in a second: the controller comes to its limits, and the sled turns back
    run = run_deck(deck + "&transient t_end=1000 method='dopri5' tolerance=1e-6 output_step=1 /\n", expect=1, name="controller")
    assert 's, in "rail" "limiter": more than 1000 in a millionth of the run' in run.stderr


@pytest.mark.parametrize("method", ["'rk4' step=1e-3", "'radau' step=5e-3", "'generalized_alpha' step=5e-3"])
def test_open_stops_take_no_part_in_a_step(method, run_deck):
    """A chain with a stop at each joint that nothing reaches moves as without, to the last digit."""
    links, stops = "&scene gravity=0.0,-9.81 /\n", ""
    for k in range(6):
        other = f"body_b='b{k - 1}' " if k else ""
        links += f"&body name='b{k}' mass=1.0 inertia=0.1 position={k + 0.5},0.0 /\n"
        links += f"&joint name='j{k}' type='revolute' body_a='b{k}' point_a=-0.5,0.0 {other}point_b={0.5 if k else 0.0},0.0 /\n"
        stops += f"&stop name='t{k}' type='rotation' body_a='b{k}' {other}lower=-50 upper=50 stiffness=1e5 /\n"
    links += "&sensor name='x' quantity='position' body='b5' /\n"
    text = f"&transient t_end=0.5 method={method} output_step=0.1 /\n"
    found = [(run_deck(links + extra + text, name=f"n{len(extra)}").folder / "history.txt").read_text() for extra in ("", stops)]
    assert found[0].splitlines()[-5:] == found[1].splitlines()[-5:]


JUMPS = """&scene gravity=0,-10 /
&body name='a' mass=1 inertia=1 /
&joint name='ga' type='prismatic' body_a='a' friction=0.5 friction_static=0.6 /
&history name='p' kind='pulse' value=100 start=0.1 finish=0.2 /
&force name='fa' type='force' body='a' fx=1 history='p' /
&sensor name='fr' quantity='friction' joint='ga' /
&body name='b' mass=1 inertia=1 /
&joint name='gb' type='prismatic' body_a='b' direction={{pi/2}} /
&stop name='s' type='position' body_a='b' direction={{pi/2}} lower=0 restitution=0 /
&history name='none' kind='polynomial' coefficients=0 /
&history name='all' kind='polynomial' coefficients=100 /
&history name='q' kind='sequence' histories='none','all','none' durations=0.1,0.1,1 /
&force name='fb' type='force' body='b' fy=1 history='q' /
&sensor name='s' quantity='stop' stop='s' /
&body name='c' mass=1 inertia=1 /
&joint name='gc' type='prismatic' body_a='c' /
&sensor name='x' quantity='position' body='c' /
&history name='r' kind='sum' histories='p' factors=0.01 /
&controller name='c' argument='x.x' history='r' kp=100 kd=1 lower=-2 upper=2 /
&force name='fc' type='force' body='c' fx=1 controller='c' /
&sensor name='o' quantity='controller' controller='c' /
&body name='d' mass=1 inertia=1 /
&joint name='gd' type='prismatic' body_a='d' /
&history name='v' kind='table' interpolation='linear' time=0.1,0.2 value=0,1 /
&drive name='d' type='position' body_a='d' history='v' rate=.true. /
&sensor name='d' quantity='acceleration' body='d' /
&sensor name='m' quantity='power' drive='d' /
&body name='e' mass=1 inertia=1 position=0,0.2 /
&stop name='e' type='position' body_a='e' body_b='ground' direction={{pi/2}} lower=0 restitution=0.5 /
&sensor name='e' quantity='stop' stop='e' /
&sensor name='u' quantity='velocity' body='e' /
&transient t_end=0.3 output_step=0.05 method={} check_error=.true. /
"""
ROWS = {  # at 0.1, 0.2 and 0.25 s
    "fr.f": [0, -5, -5],
    "fr.share": [0, 1, 1],
    "fr.state": [0, 1, 1],
    "s.f": [10, 0, 0],
    "s.state": [-1, 0, 0],
    "o.error": [0, 0.99, -0.0181486],
    "o.out": [0, 2, -1.934666],
    "o.limited": [0, 1, 0],
    "d.x": [0, 10, 0],
    "m": [0, 10, 0],
    "e.state": [0, 0, 0],
    "u.y": [-1, -2, 0.5],
}


@pytest.mark.parametrize(
    "method", ["'rk4' step=0.01", "'dopri5' tolerance=1e-8", "'radau' tolerance=1e-8", "'generalized_alpha' step=0.001"]
)
def test_a_row_at_a_jump_shows_one_side(method, run_deck):
    """Pulse, sequence, sum, corner of a driven rate at 0.1 and 0.2 s, an impact at 0.2 s: rows are those of before, entirely."""
    run = run_deck(JUMPS.format(method))
    for column, values in ROWS.items():
        np.testing.assert_allclose(run.history[column][[2, 4, 5]], values, rtol=0, atol=2e-5, err_msg=column)
    assert run.transient["friction"][0]["largest_share"] <= 1.0
    assert max(run.transient["estimated_errors"].values()) < 1e-4
    start = run_deck(JUMPS.format(method).replace("start=0.1", "start=0"), name="start")
    assert [start.history[column][0] for column in ("fr.f", "fr.state", "o.out", "o.limited")] == pytest.approx([-5, 1, 2, 1])


def test_a_row_between_the_times_of_one_event_is_left_out(run_deck):
    """A spring throws a mass onto a wall at 0.1 s, a row: half a steps' error before it in one run, behind it in the other."""
    hit = 0.1 - 1e-5  # fixed steps are 1.9e-5 s late, half of them 1e-6 s
    run = run_deck(
        f"""&body name='b' mass=1.0 inertia=1.0 position=0.3,0.0 /
&joint name='g' type='prismatic' body_a='b' /
&spring name='k' type='linear' body_a='b' point_b=-5.0,0.0 stiffness={(np.pi / 2 / hit) ** 2!r} free_length=5.0 /
&stop name='w' type='position' body_a='b' lower=0.0 restitution=0.5 /
&sensor name='v' quantity='velocity' body='b' /
&transient t_end=0.15 output_step=0.05 method='rk4' step=0.025 check_error=.true. /
"""
    )
    found = run.transient
    assert found["events_compared"] == 1
    assert 1.5e-5 < found["event_time_error"] < 2.2e-5
    assert found["estimated_errors"]["v.x[m/s]"] < 1e-2  # not 7 m/s, by which the wall throws it back


@pytest.mark.parametrize(("mean", "first"), [(0.1, 0.655), (0.3, 0.577)])
def test_unlike_events_of_one_stop_differ_from_the_earlier_one(mean, first, run_deck):
    """Steps of the force's period see it push left; half the steps see its mean, which pushes right.

    They reach 0.05 m at 0.66 s and 1 s; with a larger mean the second run at 0.58 s, the first one not at all.
    """
    run = run_deck(
        """&body name='b' mass=1.0 inertia=1.0 /
&joint name='g' type='prismatic' body_a='b' /
&history name='h' kind='sine' offset={mean} amplitude=1.0 frequency=10.0 phase={pi/2} /
&force name='f' body='b' fx=1.0 history='h' /
&stop name='w' type='position' body_a='b' lower=-0.05 upper=0.05 restitution=0 /
&transient t_end=1.1 output_step=1.1 method='rk4' step=0.1 check_error=.true. /
""".replace("{mean}", str(mean))
    )
    assert run.transient["events_differ_from"] == pytest.approx(first, abs=0.01)
    assert "rows beyond are not predictable" in run.stderr
    assert run.transient["estimated_errors"]["b.x[m]"] > 0.05  # beyond the events, too: not 0 before them
