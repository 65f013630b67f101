"""Curves through tables, sums, sequences and periods, against scipy and against their own differences, over random tables."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from biela import deck
from scipy.interpolate import CubicHermiteSpline, CubicSpline, PchipInterpolator

T_END, STEP = 2.0, 1.25e-2
TOP = "&body name='{0}' kind='rigid' mass=0.7 inertia=0.02 angle={1!r} /\n&joint name='{0}' type='revolute' body_a='{0}' /\n"
SENSORS = "".join(
    f"&sensor name='{part}{word}' quantity='{quantity}' body='{part}' /\n"
    for part in "xr"
    for word, quantity in (("0", "angle"), ("1", "angular_velocity"), ("2", "angular_acceleration"))
)
RUN = f"&transient t_end={T_END} method='rk4' step={STEP} /\n"


def followed(run_deck, histories: str, value: float, *, direct: bool) -> np.ndarray:
    """Return what the drives of a history `h` impose: by its rate the integral (from 0.2), value and slope; directly all three."""
    text = histories + TOP.format("r", 0.2) + "&drive name='r' type='rotation' body_a='r' history='h' rate=.true. /\n"
    text += TOP.format("x", float(value))
    if direct:
        text += "&drive name='x' type='rotation' body_a='x' history='h' /\n"
    h = run_deck(text + SENSORS + RUN).history
    return np.array([h.time, *(h[name] for name in ("r0", "r1", "r2", "x0", "x1", "x2"))])


def check(rows: np.ndarray, law, corners: list[float], *, direct: bool) -> None:
    """Compare a run with a law t -> (value, slope, curvature): pointwise, its integral, and its own differences."""
    t = rows[0]
    value, slope, curvature = law(t)
    clear = np.array([min((abs(x - c) for c in corners), default=1.0) > 1e-9 for x in t])
    x, w = np.polynomial.legendre.leggauss(8)
    area = [0.2]
    for a, b in zip(t[:-1], t[1:]):
        cuts = np.unique([a, b, *(c for c in corners if a < c < b)])
        half, middle = np.diff(cuts) / 2, (cuts[1:] + cuts[:-1]) / 2
        area.append(area[-1] + sum((law(m + d * x)[0] * w).sum() * d for d, m in zip(half, middle)))
    expected = [(1, np.array(area)), (2, value), (3, slope)]
    if direct:
        expected += [(4, value), (5, slope), (6, curvature)]
    for k, column in expected:
        miss = np.abs(rows[k] - column)[clear | (k in (1, 2, 4))]
        assert miss.max() < 1e-10 * max(1.0, np.abs(column).max()), f"column {k}"
    smooth = np.array([all(not a < c < b for c in corners) for a, b in zip(t[:-2] - 1e-9, t[2:] + 1e-9)])
    assert smooth.any()
    for k in (1, 2, 4, 5)[: 4 if direct else 2]:
        mean = (rows[k + 1][:-2] + 4 * rows[k + 1][1:-1] + rows[k + 1][2:]) / 6
        miss = (rows[k][2:] - rows[k][:-2]) / (t[2:] - t[:-2]) - mean
        assert np.abs(miss[smooth]).max() < 1e-4 * max(1.0, np.abs(rows[k + 1]).max()), f"difference of column {k}"


def points(seed: int, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a random table over 0.1 to 1.3 s with a dwell of two intervals."""
    rng = np.random.default_rng(seed)
    t = 0.1 + 1.2 * np.concatenate(([0.0], np.sort(rng.uniform(0.05, 0.95, n - 2)), [1.0]))
    while np.diff(t).min() < 0.02:
        t = 0.1 + 1.2 * np.concatenate(([0.0], np.sort(rng.uniform(0.05, 0.95, n - 2)), [1.0]))
    y = rng.uniform(-1.0, 1.0, n)
    if n > 4:
        y[2:4] = y[1]
    return np.round(t, 6), np.round(y, 6)


def words(t: np.ndarray, y: np.ndarray) -> str:
    """Return a table's points as the deck writes them."""
    return f"time={','.join(map(repr, t.tolist()))} value={','.join(map(repr, y.tolist()))}"


def outside(curve, t, y, periodic: bool):
    """Return the law of a curve that repeats or stays outside its points."""

    def law(x):
        if periodic:
            inside = t[0] + np.mod(x - t[0], t[-1] - t[0])
            return np.array([curve(inside, k) for k in range(3)])
        held = np.where(x < t[0], y[0], y[-1])
        within = (x >= t[0]) & (x < t[-1])
        return np.array([np.where(within, curve(np.clip(x, t[0], t[-1]), k), held if k == 0 else 0.0) for k in range(3)])

    return law


def at_rest_monotone(t, y):
    """Return the monotone cubic with slopes 0 at its ends."""
    slopes = PchipInterpolator(t, y).derivative()(t)
    slopes[[0, -1]] = 0.0
    curve = CubicHermiteSpline(t, y, slopes)
    return lambda x, k: curve.derivative(k)(x) if k else curve(x)


def line(t, y):
    """Return straight lines."""
    chord = np.diff(y) / np.diff(t)

    def curve(x, k):
        if k == 0:
            return np.interp(x, t, y)
        return chord[np.clip(np.searchsorted(t, x, side="right") - 1, 0, len(chord) - 1)] if k == 1 else 0.0 * x

    return curve


CURVES = {
    "interpolation='spline'": CubicSpline,
    "ends='not-a-knot'": CubicSpline,
    "ends='natural'": lambda t, y: CubicSpline(t, y, bc_type="natural"),
    "ends='rest'": lambda t, y: CubicSpline(t, y, bc_type="clamped"),
    "periodic=.true.": lambda t, y: CubicSpline(t, y, bc_type="periodic"),
    "interpolation='pchip'": PchipInterpolator,
    "interpolation='pchip' ends='rest'": at_rest_monotone,
    "interpolation='linear'": line,
    "interpolation='linear' periodic=.true.": line,
}


@pytest.mark.parametrize("n", [2, 3, 4, 9])
@pytest.mark.parametrize("curve", CURVES)
def test_tables_against_scipy(run_deck, curve, n):
    for seed in range(2):
        t, y = points(100 * n + seed, n)
        periodic = "periodic" in curve
        if periodic:
            y[-1] = y[0]
        law = outside(CURVES[curve](t, y), t, y, periodic)
        corners = [c + k * (t[-1] - t[0]) for c in t for k in (range(-2, 3) if periodic else (0,))]
        direct = curve in ("ends='rest'", "interpolation='pchip' ends='rest'", "periodic=.true.")
        history = f"&history name='h' kind='table' {words(t, y)} {curve} /\n"
        rows = followed(run_deck, history, law(np.zeros(1))[0, 0], direct=direct)
        check(rows, law, corners, direct=direct)


def test_a_periodic_monotone_table(run_deck):
    """No such curve in scipy: the middle turn of the table written three times."""
    t, y = points(7, 8)
    y[-1] = y[0]
    turn = t[-1] - t[0]
    long = np.concatenate([t[:-1] - turn, t[:-1], t + turn])
    curve = PchipInterpolator(long, np.concatenate([y[:-1], y[:-1], y]))
    law = outside(curve, t, y, periodic=True)
    history = f"&history name='h' kind='table' {words(t, y)} interpolation='pchip' periodic=.true. /\n"
    rows = followed(run_deck, history, law(np.zeros(1))[0, 0], direct=True)
    check(rows, law, [c + k * turn for c in t for k in range(-2, 3)], direct=True)


def test_a_monotone_table_keeps_dwells_and_stays_between_its_points(run_deck):
    """A cam: rise of 8 mm, dwell, return. The spline leaves the dwell by more than a tenth of a millimetre, pchip does not."""
    t = np.array([0.1, 0.3, 0.5, 0.7, 0.9, 1.1, 1.3, 1.5])
    y = 8e-3 * np.array([0.0, 0.0, 0.5, 1.0, 1.0, 1.0, 0.0, 0.0])
    lift = {}
    for curve in ("spline", "pchip"):
        history = f"&history name='h' kind='table' {words(t, y)} interpolation='{curve}' ends='rest' /\n"
        rows = followed(run_deck, history, 0.0, direct=True)
        lift[curve] = rows[0], rows[4]
    for curve, (time, value) in lift.items():
        dwell = np.abs(value[(time > 0.7) & (time < 1.1)] - 8e-3).max()
        assert (dwell < 1e-12) == (curve == "pchip")
        assert (value.min() > -1e-12) == (curve == "pchip")


RISE = "&history name='rise' kind='cycloid' start_value=0.1 end_value=0.6 start=0.0 finish=0.3 /\n"
BACK = "&history name='back' kind='ramp' start_value=0.6 end_value=0.1 start=0.05 finish=0.25 /\n"
DWELL = "&history name='{}' kind='polynomial' coefficients={} /\n"


def rise(x):
    """Return the cycloid of 0.3 s."""
    s, c = np.clip(x / 0.3, 0.0, 1.0), 2 * np.pi
    return np.array([0.1 + 0.5 * (s - np.sin(c * s) / c), 0.5 * (1 - np.cos(c * s)) / 0.3, 0.5 * c * np.sin(c * s) / 0.09])


def back(x):
    """Return the ramp from 0.05 to 0.25 s."""
    s = np.clip((x - 0.05) / 0.2, 0.0, 1.0)
    shape = np.array([6 * s**5 - 15 * s**4 + 10 * s**3, 30 * s**4 - 60 * s**3 + 30 * s**2, 120 * s**3 - 180 * s**2 + 60 * s])
    return np.array([0.6 - 0.5 * shape[0], -0.5 * shape[1] / 0.2, -0.5 * shape[2] / 0.04])


@pytest.mark.parametrize("periodic", [False, True])
def test_a_sequence_moves_dwells_and_returns(run_deck, periodic):
    start, durations = 0.15, np.array([0.3, 0.2, 0.35, 0.1])
    begins = start + np.concatenate(([0.0], np.cumsum(durations)))
    parts = [rise, lambda x: np.array([0.6 + 0 * x, 0 * x, 0 * x]), back, lambda x: np.array([0.1 + 0 * x, 0 * x, 0 * x])]

    def law(t):
        x = start + np.mod(t - start, begins[-1] - start) if periodic else np.clip(t, begins[0], begins[-1])
        k = np.clip(np.searchsorted(begins, x, side="right") - 1, 0, 3)
        return np.array([[parts[i](v - begins[i])[d] for i, v in zip(k, x)] for d in range(3)])

    deck = RISE + BACK + DWELL.format("up", 0.6) + DWELL.format("down", 0.1)
    deck += "&history name='h' kind='sequence' histories='rise','up','back','down' durations=0.3,0.2,0.35,0.1 start=0.15 "
    deck += f"periodic={'.true.' if periodic else '.false.'} /\n"
    corners = [c + k * (begins[-1] - start) for c in [*begins, begins[2] + 0.05, begins[2] + 0.25] for k in range(-2, 3)]
    check(followed(run_deck, deck, law(np.zeros(1))[0, 0], direct=True), law, corners, direct=True)


def test_a_sum_of_a_rise_and_a_wave(run_deck):
    w = 2 * np.pi * 1.7

    def law(t):
        wave = np.array([0.3 * np.sin(w * t + 0.4), 0.3 * w * np.cos(w * t + 0.4), -0.3 * w**2 * np.sin(w * t + 0.4)])
        return 2.0 * rise(t) - 0.5 * wave + back(t)

    deck = RISE + BACK + "&history name='wave' kind='sine' amplitude=0.3 frequency=1.7 phase=0.4 /\n"
    deck += "&history name='h' kind='sum' histories='rise','wave','back' factors=2.0,-0.5,1.0 /\n"
    check(followed(run_deck, deck, law(np.zeros(1))[0, 0], direct=True), law, [0.0, 0.3, 0.05, 0.25], direct=True)


def test_pulses_that_follow_one_another_do_not_jump(run_deck):
    """Corners that cancel in a sum are none: a rate may follow, no message."""
    deck = "&history name='a' kind='pulse' value=0.5 start=-1.0 finish=0.7 /\n"
    deck += "&history name='b' kind='pulse' value=0.25 start=0.7 finish=3.0 /\n"
    deck += "&history name='h' kind='sum' histories='a','b' factors=1.0,2.0 /\n"
    rows = followed(run_deck, deck, 0.0, direct=False)
    np.testing.assert_allclose(rows[2], 0.5, rtol=0, atol=1e-13)


def test_parts_of_a_sequence_that_meet_but_for_rounding_do_not_jump(run_deck):
    """1 - cos ends at 2e-16, not at the zero of the rest behind it: a drive may follow."""
    deck = "&history name='wave' kind='sine' offset=1.0 amplitude=1.0 frequency=1.0 phase=-1.5707963267948966 /\n"
    deck += DWELL.format("rest", 0.0) + "&history name='h' kind='sequence' histories='wave','rest' durations=1.0,1.0 /\n"
    run_deck(DRIVEN.format(deck) + "&transient t_end=2.0 method='rk4' step=0.01 /\n", "--check")


SAW = "&history name='h' kind='table' time=0.0,0.07,0.1 value=0.0,1.0,0.0 interpolation='linear' periodic=.true. /\n"
STEPS = (
    DWELL.format("one", 1.0)
    + DWELL.format("two", "-0.5,3.0")
    + "&history name='h' kind='sequence' histories='one','two' durations=0.03,0.07 periodic=.true. /\n"
)
BOTH = SAW.replace("'h'", "'saw'") + STEPS.replace("'h'", "'steps'") + "&history name='h' kind='sum' histories='saw','steps' /\n"


def saw(t):
    """Return the saw's value."""
    return np.interp(np.mod(t, 0.1), [0.0, 0.07, 0.1], [0.0, 1.0, 0.0])


def steps(t):
    """Return the value of the steps."""
    x = np.mod(t, 0.1)
    return np.where(x < 0.03, 1.0, -0.5 + 3.0 * (x - 0.03))


@pytest.mark.parametrize("history", ["saw", "steps", "both"])
def test_adaptive_steps_end_at_every_corner(run_deck, history):
    """Between corners the motion is a cubic, which dopri5 follows exactly: a coarse tolerance errs by rounding alone."""
    law = {"saw": saw, "steps": steps, "both": lambda t: saw(t) + steps(t)}[history]
    deck = {"saw": SAW, "steps": STEPS, "both": BOTH}[history]
    deck += "&body name='b' kind='rigid' mass=2.0 inertia=1.0 /\n&force name='f' type='force' body='b' fx=1.0 history='h' /\n"
    deck += "&sensor name='v' quantity='velocity' body='b' /\n"
    deck += "&transient method='dopri5' tolerance=1e-2 t_end=1.05 output_step=0.01 /\n"
    h = run_deck(deck).history
    x, w = np.polynomial.legendre.leggauss(2)
    fine = np.arange(0.0, 1.05 + 1e-9, 0.01)
    area = np.concatenate(([0.0], np.cumsum([(law(a + 0.005 * (1 + x)) * w).sum() * 0.005 for a in fine[:-1]])))
    at = np.isin(np.round(h.time, 6), np.round(fine, 6))
    assert at.sum() > 20
    np.testing.assert_allclose(h["v.x"][at], 0.5 * area[np.round(h.time[at] / 0.01).astype(int)], rtol=0, atol=1e-13)


@pytest.mark.parametrize("history", ["saw", "steps", "both"])
def test_controlled_implicit_steps_keep_their_tolerance_over_corners(run_deck, history):
    """Thirty jumps and corners of the force, no output between them: the last velocity errs by the tolerance alone."""
    deck = {"saw": SAW, "steps": STEPS, "both": BOTH}[history]
    deck += "&body name='b' kind='rigid' mass=2.0 inertia=1.0 /\n&force name='f' type='force' body='b' fx=1.0 history='h' /\n"
    deck += "&sensor name='v' quantity='velocity' body='b' /\n&transient method='radau' tolerance={} t_end=1.0 "
    exact = {"saw": 0.25, "steps": 0.5 * (0.3 + 10 * (-0.5 * 0.07 + 1.5 * 0.07**2))}
    exact["both"] = exact["saw"] + exact["steps"]
    miss = [abs(run_deck(deck.format(tol) + "output_step=1.0 /\n").history["v.x"][-1] - exact[history]) for tol in (1e-3, 1e-6)]
    assert miss[0] < 2e-3
    assert miss[1] < 2e-6


FILES = {
    "commas.csv": "time,x,value\n0.0,9,0.5\n0.5,9,1.25\n1.0,9,-2.0\n",
    "semicolons.csv": "Zeit;x;Wert\r\n[s];;[rad]\r\n0,0;;0,5\r\n0,5;;1,25\r\n1,0;;-2,0\r\n",
    "quoted.csv": '"time, s","x","value"\n"0.0","9","0.5"\n"0.5","9","1.25"\n"1.0","9","-2.0"\n',
    "quoted_commas.csv": '"t","x","y"\n"0,0","9","0,5"\n"0,5","9","1,25"\n"1,0","9","-2"\n',
    "tabs.txt": "t\tx\ty\n0,0\t9\t0,5\n\n0,5\t9\t1,25\n1,0\t9\t-2e0",
    "blanks.txt": "# biela: sensors\n# columns: t x y\n  0.0  9  5.0E-01\n  0.5  9  1.25\n% a remark\n  1.0  9 -2.0d0\n",
    "blank_commas.txt": "0,0  9  0,5\n0,5  9  1,25\n1,0  9  -2,0\n",
    "spaced.csv": "t , x , y\n0.0, 9, 0.5\n0.5, 9, 1.25\n1.0, 9, -2.0\n",
    "mark.csv": "\ufefftime,x,y\n0,9,.5\n.5,9,1.25\n1.,9,-2.\n",
}


@pytest.mark.parametrize("name", FILES)
def test_tables_from_files_as_they_come(run_deck, tmp_path, name):
    """The path counts from the deck's own file, also in an included one."""
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / name).write_bytes(FILES[name].encode())
    (tmp_path / "parts" / "h.nml").write_text(f"&history name='h' kind='table' file='{name}' columns=1,3 /\n")
    rows = followed(run_deck, "&history name='h' kind='table' time=0.0,0.5,1.0 value=0.5,1.25,-2.0 /\n", 0.0, direct=False)
    assert np.array_equal(rows, followed(run_deck, "&include file='parts/h.nml' /\n", 0.0, direct=False))
    told = (tmp_path / "results" / "scene" / "summary.txt").read_text()
    assert f"! history h: 3 points of {tmp_path}/parts/{name}, digest " in told


def test_tables_that_differ_in_their_last_letter_have_other_digests(run_deck, tmp_path):
    digests = set()
    for last in "12":
        (tmp_path / "h.txt").write_text(f"0 0.5\n1 -2.{last}\n")
        followed(run_deck, "&history name='h' kind='table' interpolation='linear' file='h.txt' /\n", 0.0, direct=False)
        told = (tmp_path / "results" / "scene" / "summary.txt").read_text()
        digests.add(told.partition("h.txt, digest ")[2].split()[0])
    assert len(digests) == 2


BAD_FILES = {
    "absent": (None, "cannot be read: no such file or directory, expected a table of numbers beside this deck"),
    "empty": ("\n", "has no row with numbers in columns 1 and 3, expected rows of numbers"),
    "headings": ("t,x,y\n[s],2,[m]\n", "has no row with numbers in columns 1 and 3, expected rows of numbers"),
    "narrow": ("0,1\n1,2\n", "line 1 has nothing in column 3, expected a number"),
    "no heading": ("t,x,y\n0,1,1 V\n1, 1,2\n", "line 2 has '1 V' in column 3, which is not a number, expected one such as 1.5e-3"),
    "nor this": ("t;x;y\n-;1;5\n0;1;1\n", "line 2 has '-' in column 1, which is not a number, expected one such as 1.5e-3"),
    "thousands": (
        '0,1,"0,125"\n1,2,"-1,250"\n',
        "line 2 has '-1,250' in column 3, which may have a comma of thousands or of decimals, expected a decimal point",
    ),
    "words": ("t,x,y\n0,1,2\n1,2,none\n", "line 3 has 'none' in column 3, which is not a number, expected one such as 1.5e-3"),
    "gap": ("0,1,2\n1,2\n", "line 2 has nothing in column 3, expected a number"),
    "endless": ("0,1,2\n1,2,nan\n", "line 2 has 'nan' in column 3, which is not finite, expected a finite number"),
    "back": (
        "0,1,2\n0,1,2\n",
        "time (column 1) is not ordered: value 2, 0, is not later than value 1, 0, expected increasing times",
    ),
    "short": ("0,1,2\n", "time (column 1) has 1 value, expected at least 2"),
    "bytes": (
        "\x00\x01\x02" * 40,
        "cannot be read: it is no text in UTF-8: it has zero bytes, expected a table of numbers beside this deck",
    ),
}


@pytest.mark.parametrize("name", BAD_FILES)
def test_what_is_wrong_with_a_file_is_told(run_deck, tmp_path, name):
    content, told = BAD_FILES[name]
    if content is not None:
        (tmp_path / "bad.csv").write_text(content)
    deck = "&body name='b' mass=1.0 inertia=1.0 /\n&history name='h' kind='table' file='bad.csv' columns=1,3 /\n"
    done = run_deck(deck, expect=2)
    assert done.stderr.removeprefix(f"{tmp_path}/scene.nml:2: history/h: ").removeprefix("file='bad.csv' ") == told + "\n"


DRIVEN = "&body name='d' mass=1.0 inertia=1.0 /\n&joint name='j' type='revolute' body_a='d' /\n{} \n"
DRIVEN += "&drive name='m' type='rotation' body_a='d' history='h' /\n"
ENDS_AT_SPEED = "&history name='h' kind='table' time=0.0,0.5,1.0 value=0.0,1.0,1.5 {} /"


def test_no_jump_is_told_that_no_analysis_meets(run_deck):
    deck = DRIVEN.format(ENDS_AT_SPEED.format(""))
    run_deck(deck + "&static /\n")
    run_deck(deck + "&transient t_end=1.0 step=0.01 /\n")
    told = run_deck(deck + "&transient t_end=1.1 step=0.01 /\n", expect=2).stderr
    assert "jump of slope at t = 1.00000E+00 s" in told
    assert "ends='rest'" in told


@pytest.mark.parametrize(
    ("wrong", "right"),
    [
        ("kind='table' time=0.0,0.5,1.0 value=0.0,1.0,1.5", "ends='rest'"),
        ("kind='table' time=0.0,0.5,1.0 value=0.0,1.0,0.0", "periodic=.true."),
        ("kind='table' time=0.0,0.5,1.0 value=0.0,1.0,0.0 interpolation='linear'", "interpolation='pchip' ends='rest'"),
    ],
)
def test_the_remedy_that_is_told_helps(run_deck, wrong, right):
    run = "&transient t_end=1.5 step=0.01 /\n"
    told = run_deck(DRIVEN.format(f"&history name='h' {wrong} /") + run, expect=2).stderr
    assert all(
        line.endswith("expected a history with continuous value and slope" + line.partition("and slope")[2]) and right in line
        for line in told.splitlines()
    )
    helped = wrong.replace(" interpolation='linear'", "") + " " + right
    run_deck(DRIVEN.format(f"&history name='h' {helped} /") + run)


def test_a_changed_file_is_another_deck(run_deck, tmp_path):
    """A restart refuses what is not the run that it would go on with: the file's text belongs to the deck."""
    (tmp_path / "m.csv").write_text("0,0\n1,1\n2,0\n")
    deck = "&body name='b' mass=1.0 inertia=1.0 /\n&history name='g' kind='sine' amplitude=1.0 frequency=1.0 /\n"
    deck += "&history name='h' kind='table' file='m.csv' /\n&force name='f' body='b' fx=1.0 history='h' /\n"
    first = run_deck(deck + "&transient t_end=2.0 step=0.01 /\n").folder.joinpath("summary.txt").read_text()
    (tmp_path / "m.csv").write_text("0,0\n1,2\n2,0\n")
    second = run_deck(deck + "&transient t_end=2.0 step=0.01 /\n").folder.joinpath("summary.txt").read_text()
    lines = [[line for line in text.splitlines() if line.startswith("! history h: 3 points")] for text in (first, second)]
    assert len(lines[0]) == 1
    assert lines[0] != lines[1]


def test_a_copy_of_a_deck_finds_its_tables(run_deck, tmp_path):
    """The trade-off tool writes decks elsewhere: names of files follow, also those of an included deck."""
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "m.csv").write_text("0,0\n1,1\n2,0\n")
    (tmp_path / "parts" / "h.nml").write_text("&history name='h' kind='table' file='m.csv' columns=1,2 /\n")
    (tmp_path / "a.nml").write_text("&body name='b' mass=1.0 inertia=1.0 /\n&include file='parts/h.nml' /\n&static /\n")
    (tmp_path / "b").mkdir()
    copy = tmp_path / "b" / "copy.nml"
    copy.write_text(deck.read(tmp_path / "a.nml").flat(deck.SOLVER).replace("&static /", "&modal /"))
    run_deck(copy, "--check")


def zigzag(times, begins: float, up: float, down: float) -> np.ndarray:
    """Return value and integral from t = 0 of a line from 0 to 1 and back, repeated, by exact fractions of the numbers given."""
    up, turn = Fraction(up), Fraction(up) + Fraction(down)

    def area(t: Fraction) -> Fraction:
        turns, x = divmod(t - Fraction(begins), turn)
        return turns * turn / 2 + (x**2 / up / 2 if x < up else turn / 2 - (turn - x) ** 2 / (turn - up) / 2)

    rows = []
    for t in map(Fraction, times):
        x = (t - Fraction(begins)) % turn
        rows.append((float(x / up if x < up else (turn - x) / (turn - up)), float(area(t) - area(Fraction(0)))))
    return np.array(rows).T


@pytest.mark.parametrize("seed", range(6))
def test_a_periodic_history_that_began_or_begins_turns_by_the_billion_away(run_deck, seed):
    """Up to 1e12 turns before or after the run: no count overflows, no digit of value or integral is lost."""
    dice = np.random.default_rng(seed)
    half = float(dice.choice([0.5, 0.05, 0.0123, 0.0031]))
    begins = float(dice.choice([-1.0, 1.0]) * half * 10 ** dice.uniform(9.0, 12.3))
    deck = f"&history name='p' coefficients=0.0,{1 / half!r} /\n&history name='q' coefficients=1.0,{-1 / half!r} /\n"
    chain = f"&history name='h' kind='sequence' histories='p','q' durations={half!r},{half!r} start={begins!r} periodic=.true. /\n"
    t = [begins, begins + half, begins + 2 * half]
    table = f"&history name='h' kind='table' interpolation='linear' time={t[0]!r},{t[1]!r},{t[2]!r} value=0.0,1.0,0.0 "
    for text, up, down in ((chain, half, half), (table + "periodic=.true. /\n", t[1] - t[0], t[2] - t[1])):
        rows = followed(run_deck, deck + text, 0.0, direct=False)
        value, area = zigzag(rows[0], begins, up, down)
        np.testing.assert_allclose(rows[2], value, atol=1e-12 / half, err_msg=text)
        np.testing.assert_allclose(rows[1], 0.2 + area, atol=1e-12, err_msg=text)


@pytest.mark.parametrize("begins", [-1e15, 3e15, -1e16, 1e20])
def test_a_periodic_history_that_begins_where_times_are_too_coarse_is_refused(run_deck, begins):
    deck = "&body name='b' kind='rigid' mass=1.0 inertia=1.0 /\n&force name='f' body='b' fx=1.0 history='h' /\n"
    deck += "&transient t_end=2.5 step=0.125 /\n&history name='p' kind='sine' amplitude=1.0 frequency=2.0 /\n"
    text = f"&history name='h' kind='sequence' histories='p','p' durations=0.5,0.5 start={begins} periodic=.true. /\n"
    told = run_deck(deck + text, expect=2).stderr
    assert "history/h: it begins at" in told
    assert "too coarse for parts of 0.5 s, expected a start nearer to t = 0" in told


@pytest.mark.parametrize("phase", [1.0e17, -3.0e20])
def test_a_sine_of_many_turns_of_phase_moves(run_deck, phase):
    deck = TOP.format("r", 0.2) + "&drive name='r' type='rotation' body_a='r' history='h' rate=.true. /\n" + RUN
    deck += "&sensor name='r' quantity='angular_velocity' body='r' /\n"
    history = "&history name='h' kind='sine' amplitude=1.0 frequency=2.0 phase={!r} /\n"
    far, near = (run_deck(deck + history.format(x)).history["r"] for x in (phase, math.fmod(phase, 2 * math.pi)))
    np.testing.assert_allclose(far, near, atol=1e-12)
    assert np.ptp(near) > 1.9


DEAD_CENTRE = """! A compressor: gas by two tables over the piston's place that end where it turns, one for each way of the piston.
&scene /
&body name='crank' mass=8 inertia=0.4 angle=0.3 angular_velocity=40 /
&body name='rod' mass=0.5 inertia=8e-4 com=0.04,0 angle={-asin(0.03*sin(0.3)/0.11)} position={0.03*cos(0.3)},{0.03*sin(0.3)} /
&body name='piston' mass=0.6 inertia=1e-4 position={0.03*cos(0.3)+sqrt(0.11^2-(0.03*sin(0.3))^2)},0 /
&joint name='bearing' type='revolute' body_a='crank' /
&joint name='pin' type='revolute' body_a='rod' point_a=0,0 body_b='crank' point_b=0.03,0 /
&joint name='eye' type='revolute' body_a='rod' point_a=0.11,0 body_b='piston' point_b=0,0 /
&joint name='bore' type='prismatic' body_a='piston' direction=0 /
&sensor name='place' quantity='position' body='piston' /
&sensor name='stroke' quantity='velocity' body='piston' /
&sensor name='speed' quantity='angular_velocity' body='crank' /
&history name='in' kind='table' argument='place.x' interpolation='pchip' time=0.08,0.1,0.12,0.14 value=0,100,300,1200 /
&history name='out' kind='table' argument='place.x' interpolation='pchip' time=0.08,0.1,0.12,0.14 value=0,0,0,1200 /
&history name='gas' kind='switch' argument='stroke.x' histories='in','out' /
&force name='gas' body='piston' fx=-1 history='gas' /
&history name='motor' kind='table' argument='speed' interpolation='linear' time=0,50,70 value=12,10,0 /
&force name='motor' type='torque' body='crank' moment=1 history='motor' /
&transient method='rk4' step=2e-4 output_step=5e-3 t_end=0.3 /
"""


def test_tables_that_end_where_the_motion_turns(run_deck):
    """There both tables come to their ends with a rate that is rounding: one that leaves an end does not send the other over it."""
    steps = ("5e-5", "1e-4", "2.3e-4")  # the first and the last one had events without end
    places = [run_deck(DEAD_CENTRE, "--set", f"transient/step={step}").history["place.x"][-1] for step in steps]
    assert np.allclose(places, places[0], rtol=0, atol=1e-9)


SLIDE = """&body name='cart' kind='rigid' mass=2 inertia=0.1 /
&joint name='way' type='prismatic' body_a='cart' body_b='ground' /
&drive name='d' type='position' body_a='cart' history='h' /
&transient t_end=1 method='radau' tolerance=1e-8 output_step=0.1 /
"""


@pytest.mark.parametrize("short", ["1e-3", "1e-6", "1e-9"])
def test_a_jump_of_slope_is_seen_beside_a_short_part(run_deck, short):
    """0.5 m/s end where a part begins that stands still, however short that is."""
    deck = f"""&history name='go' coefficients=0,0.5 /
&history name='stay' coefficients=0.25 /
&history name='h' kind='sequence' histories='go','stay','stay' durations=0.5,{short},0.5 /
"""
    refused = run_deck(deck + SLIDE, "--check", expect=2)
    assert "a jump of slope at t = 5.00000E-01 s" in refused.stderr
    smooth = deck.replace("'go' coefficients=0,0.5", "'go' kind='cycloid' start=0 finish=0.5 start_value=0 end_value=0.25")
    run_deck(smooth + SLIDE, "--check", name="smooth")


def test_the_part_of_a_history_that_jumps_is_named(run_deck):
    """Of a sum the part from which most of the jump comes; a part of a sequence that jumps within it."""
    deck = """&history name='h' kind='sum' histories='still','seq','late' factors=3,2,-1 /
&history name='still' kind='table' time=0,0.5,1,2 value=0,1,1,0 interpolation='pchip' ends='rest' /
&history name='late' kind='pulse' value=1 start=0.7 finish=0.8 /
&history name='seq' kind='sequence' histories='one','two' durations=0.3,0.6 /
&history name='one' coefficients=0 /
&history name='two' kind='table' time=0,0.1,0.2 value=0,0,1 interpolation='linear' /
"""
    told = run_deck(deck + SLIDE, "--check", expect=2).stderr.splitlines()
    assert "t = 4.00000E-01" in told[0]
    assert told[0].endswith("""in "seq" in "two" interpolation='pchip' ends='rest'""")
    assert "t = 5.00000E-01" in told[1]
    assert "t = 7.00000E-01" in told[2]
    assert told[2].endswith('in "late" a ramp or a cycloid instead of the pulse')
