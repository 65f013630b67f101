"""Problems that others published, or that have closed forms: the solver meets their values.

Sources: IVP test set (Andrews' squeezing mechanism, Simeon's flexible slider-crank; Hairer & Wanner, Solving ODEs II),
IFToMM multibody benchmarks A01 and A02, Kane, Ryan & Banerjee and Simo & Vu-Quoc for the spin-up of a beam; all values
recomputed independently to the digits that stand here.
"""

import numpy as np
import pytest
from biela.histories import read
from conftest import REFERENCE
from four_bars import GRAVITY, four_bars, reduced_four_bars
from scipy.integrate import solve_ivp

# ---------------------------------------------------------------- Andrews' squeezing mechanism

ANDREWS_END = (
    15.81077119515371,
    -15.75637105841183,
    0.04082224011964580,
    -0.5347301163420796,
    0.5244099658799541,
    0.5347301163420796,
    1.048080741041938,
)
ANDREWS_RATES = (1139.920302259106, -1424.379295177540, 11.03291191061859, 19.29337410503204, 0.5735699148295025,
                 -19.29337410503204, 0.3231791491424991)  # fmt: skip


def andrews_coordinates(history, suffix=""):
    """Return beta, Theta, gamma, Phi, delta, Omega, epsilon (7, rows) from the absolute angles of the seven bodies."""
    k1, k2, k3, k4, k5, k6, k7 = (history[f"k{number}{suffix}"] for number in range(1, 8))
    return np.array([k1, k2 - k1, k3, k4 - k5, k5, k6 - k7, k7])


def test_andrews_end_values_and_history(run_deck):
    deck = (REFERENCE / "andrews" / "deck.nml").read_text(encoding="utf-8").replace("output_step=3.0e-4", "output_step=5.0e-4")
    sensors = "".join(
        f"&sensor name='k{number}_acc' quantity='angular_acceleration' body='k{number}' /\n" for number in range(1, 8)
    )
    history = run_deck(deck + sensors).history
    end, rates, acceleration = (andrews_coordinates(history, suffix) for suffix in ("", "_rate", "_acc"))
    np.testing.assert_allclose(end[:, -1], ANDREWS_END, rtol=1e-8)
    np.testing.assert_allclose(rates[:, -1], ANDREWS_RATES, rtol=1e-8)
    np.testing.assert_allclose(acceleration[:2, 0], (14222.4439199541, -10666.8329399656), rtol=1e-10)
    published = read(REFERENCE / "published" / "andrews_history.csv")
    names = ("beta", "Theta", "gamma", "Phi", "delta", "Omega", "eps")
    for found, prefix in ((end, ""), (rates, "d"), (acceleration, "dd")):
        for row, name in zip(found, names):
            column = published[prefix + name]
            np.testing.assert_allclose(row, column, rtol=0, atol=1e-8 * np.ptp(column), err_msg=prefix + name)


# ---------------------------------------------------------------- N-four-bar mechanism


FOUR_BAR_ENDS = {
    1: (0.4783850577528, 0.8781501787957, 1.7272640755311, -0.9409521793418),
    2: (0.3284581115347, 0.9445185381807, 1.4230514701931, -0.4948688454719),
}
FIRST_PASSAGE = {1: 0.7084500088358, 2: 0.7143555292930}


@pytest.mark.parametrize("count", FOUR_BAR_ENDS)
def test_n_four_bar(count, run_deck):
    """Ten seconds, five turns, through the singular position twice a turn: 1e-9 of the published values at step 1e-3."""
    run = run_deck(four_bars(count))
    history = run.history
    for name, end in zip(("b0.x", "b0.y", "vb0.x", "vb0.y"), FOUR_BAR_ENDS[count]):
        assert abs(history[name][-1] - end) < 1e-9 * np.ptp(history[name]), name
    if count == 2:
        published = read(REFERENCE / "published" / "n_four_bar_2.csv")
        for column, name in (("xB0", "b0.x"), ("yB0", "b0.y"), ("vxB0", "vb0.x"), ("vyB0", "vb0.y")):
            np.testing.assert_allclose(history[name], published[column], rtol=0, atol=1e-9 * np.ptp(published[column]))
    energy = run.energy
    assert np.abs(energy["position_violation"]).max() < 1e-12
    assert np.abs(energy["velocity_violation"]).max() < 1e-10


@pytest.mark.parametrize("count", FOUR_BAR_ENDS)
@pytest.mark.parametrize("past", [0.0, 1e-9, 1e-6, 1e-5, 1e-4])
def test_step_on_the_change_point(count, past, run_deck):
    """The start moved so that a step ends exactly where all links lie in line, or up to 1e-4 s past it."""
    step = 1e-3
    early = (FIRST_PASSAGE[count] + past) % step
    phi, rate = reduced_four_bars(count, [0.0, early])[:, -1]
    passage = round((FIRST_PASSAGE[count] - early) / step)
    history = run_deck(four_bars(count, phi, rate, t_end=2.0, output=step)).history
    assert abs(history["b0.y"][passage]) < 1e-9 + 6 * past
    exact, speed = reduced_four_bars(count, history.time, phi, rate)
    np.testing.assert_allclose(history["b0.x"], np.sin(exact), rtol=0, atol=1e-9)
    np.testing.assert_allclose(history["b0.y"], np.cos(exact), rtol=0, atol=1e-9)
    np.testing.assert_allclose(history["vb0.y"], -speed * np.sin(exact), rtol=0, atol=1e-8)


@pytest.mark.parametrize(("count", "step"), [(5, 1e-3), (5, 5e-4), (10, 1e-3), (40, 1e-3)])
def test_many_four_bars_pass_their_change_points(count, step, run_deck):
    """Every loop could fold there: neither the energy nor the path feels it, wherever the steps fall (three starts, 3 s)."""
    for phi, rate in ((0.0, 1.0), (0.3, 2.0), (0.41, 2.7)):
        t_end = 3.0 if count < 40 else 1.0
        run = run_deck(four_bars(count, phi, rate, t_end=t_end, step=step, output=0.02))
        exact = reduced_four_bars(count, run.history.time, phi, rate)[0]
        assert np.sum(np.diff(np.sign(np.cos(exact))) != 0) >= 1  # it does pass
        np.testing.assert_allclose(run.history["b0.x"], np.sin(exact), rtol=0, atol=2e-9, err_msg=f"start {phi}, {rate}")
        energy = run.energy
        assert np.abs(energy["residual"]).max() < 1e-10 * np.abs(energy["kinetic"]).max(), f"start {phi}, {rate}"


@pytest.mark.parametrize("count", [2, 5, 40])
def test_controlled_steps_do_not_crawl_at_change_points(count, run_deck):
    """What joints make of rounding there is no error of the step: at most 20 times the evaluations of rk4 at step 1e-3."""
    for phi, rate in ((0.0, 1.0), (0.41, 2.7)):
        t_end = 3.0 if count < 40 else 1.0
        deck = four_bars(count, phi, rate, t_end=t_end, output=0.02)
        run = run_deck(deck.replace("method='rk4' step=0.001", "method='dopri5' tolerance=1e-9"))
        assert run.transient["evaluations"] < 20 * 4 * 1000 * t_end
        exact = reduced_four_bars(count, run.history.time, phi, rate)[0]
        assert np.sum(np.diff(np.sign(np.cos(exact))) != 0) >= 1
        np.testing.assert_allclose(run.history["b0.x"], np.sin(exact), rtol=0, atol=1e-7)
        assert np.abs(run.energy["residual"]).max() < 3e-9 * np.abs(run.energy["kinetic"]).max()


def test_redundancy_that_appears_during_the_motion(run_deck):
    """A slider-crank with equal links: as the slider passes the crank's bearing the rod could turn freely, one row is redundant.

    The motion goes straight through (inertia keeps the slider moving): one angle phi with the rod at -phi describes it.
    """
    deck = f"""&scene gravity=0.0,{-GRAVITY} /
&body name='crank' kind='rigid' mass=1.0 inertia=0.08333333333333333 com=0.5,0.0 angle=0.3 angular_velocity=8.0 /
&body name='rod' kind='rigid' mass=1.0 inertia=0.08333333333333333 com=0.5,0.0
  position={np.cos(0.3):.17g},{np.sin(0.3):.17g} angle=-0.3 /
&lump body='rod' point=1.0,0.0 mass=0.5 /
&joint name='bearing' type='revolute' body_a='crank' /
&joint name='pin' type='revolute' body_a='rod' body_b='crank' point_b=1.0,0.0 /
&joint name='slider' type='slider' body_a='rod' point_a=1.0,0.0 direction=0.0 /
&sensor name='phi' quantity='angle' body='crank' /
&sensor name='rod' quantity='angle' body='rod' /
&sensor name='tip' quantity='position' body='rod' point=1.0,0.0 /
&transient t_end=3.0 method='rk4' step=5.0e-4 output_step=1.0e-2 /
"""
    history = run_deck(deck).history

    def slope(_, y):  # T = phi'^2/2 (1/3 + 1/12 + 9/4 s^2 + c^2/4 + 2 s^2): crank, rod, slider; V = g (1/2 + 1/2) s
        s, c = np.sin(y[0]), np.cos(y[0])
        inertia = 5 / 12 + 9 / 4 * s**2 + c**2 / 4 + 2 * s**2
        return [y[1], (-4.0 * s * c * y[1] ** 2 - GRAVITY * c) / inertia]

    exact = solve_ivp(slope, (0.0, 3.0), [0.3, 8.0], "DOP853", t_eval=history.time, rtol=1e-13, atol=1e-13).y[0]
    assert exact[-1] > 3 * np.pi
    np.testing.assert_allclose(history["phi"], exact, rtol=0, atol=1e-8)
    np.testing.assert_allclose(history["rod"], -exact, rtol=0, atol=1e-8)
    np.testing.assert_allclose(history["tip.x"], 2 * np.cos(exact), rtol=0, atol=1e-8)


# ---------------------------------------------------------------- pendulums

POINT_MASS = """&body name='p' kind='rigid' mass=1.0 inertia=1.0 position={x:.17g},{y:.17g} /
&joint name='string' type='distance' body_a='p' length=1.0 /
"""
ROD = """&body name='p' kind='rigid' mass=1.0 inertia=0.08333333333333333 com=0.5,0.0 angle={angle:.17g} /
&joint name='bearing' type='revolute' body_a='p' /
"""
UNIFORM_BEAM = """&material name='m' density=1000.0 young=1.0e9 /
&section name='s' area=1.0e-3 inertia=1.0e-8 /
&body name='p' kind='beam' length=1.0 elements=3 material='m' section='s' flexible=.false. angle={angle:.17g} /
&joint name='bearing' type='revolute' body_a='p' node_a=1 /
"""
SMALL = 2 * np.pi / np.sqrt(GRAVITY)
PERIODS = [
    ("point", POINT_MASS, 90, 2.367841947576237),
    ("rod", ROD, 90, 1.933334854373),
    ("beam", UNIFORM_BEAM, 90, 1.933334854373),
    ("point30", POINT_MASS, 30, 1.017408797595956 * SMALL),
    ("point150", POINT_MASS, 150, 1.762203729503756 * SMALL),
    ("rod30", ROD, 30, 1.017408797595956 * SMALL * np.sqrt(2 / 3)),
]


@pytest.mark.parametrize(("name", "body", "degrees", "period"), PERIODS)
def test_pendulum_periods(name, body, degrees, period, run_deck):
    """After one period from rest the pendulum rests again; its speed then, over its acceleration, is the period's error."""
    swing = np.radians(degrees)
    place = "point=0.0,0.0" if name.startswith("point") else "node=-1" if name == "beam" else "point=1.0,0.0"
    deck = (
        f"&scene gravity=0.0,{-GRAVITY} /\n"
        + body.format(x=np.sin(swing), y=-np.cos(swing), angle=swing - np.pi / 2)
        + f"&sensor name='v' quantity='velocity' body='p' {place} /\n"
        + f"&sensor name='a' quantity='acceleration' body='p' {place} /\n"
        + f"&transient t_end={period:.17g} method='rk4' step={period / 4000:.17g} output_step={period / 4:.17g} /\n"
    )
    history = run_deck(deck).history
    speed = np.hypot(history["v.x"], history["v.y"])
    assert speed[1] > 0.9 * speed.max()  # lowest point after a quarter
    assert speed[2] < 1e-8
    assert speed[4] / np.hypot(history["a.x"][4], history["a.y"][4]) < 1e-9 * period


def test_rigid_double_pendulum(run_deck):
    """Two uniform rods, chaotic after a while: the first two seconds against Lagrange's two equations."""
    deck = f"""&scene gravity=0.0,{-GRAVITY} /
&body name='a' kind='rigid' mass=1.0 inertia=0.08333333333333333 com=0.5,0.0 angle=0.2 /
&body name='b' kind='rigid' mass=2.0 inertia=0.16666666666666666 com=0.5,0.0 angle=1.0
  position={np.cos(0.2):.17g},{np.sin(0.2):.17g} angular_velocity=-2.0 /
&joint name='one' type='revolute' body_a='a' /
&joint name='two' type='revolute' body_a='b' body_b='a' point_b=1.0,0.0 /
&sensor name='a' quantity='angle' body='a' /
&sensor name='b' quantity='angle' body='b' /
&sensor name='wa' quantity='angular_velocity' body='a' /
&transient t_end=2.0 method='rk4' step=2.0e-4 output_step=1.0e-2 /
"""
    history = run_deck(deck).history

    def slope(_, y):
        (p, q), (u, w) = y[:2], y[2:]
        mass = np.array([[1 / 3 + 2.0, np.cos(p - q)], [np.cos(p - q), 2 / 3]])
        force = [-np.sin(p - q) * w**2 - 2.5 * GRAVITY * np.cos(p), np.sin(p - q) * u**2 - GRAVITY * np.cos(q)]
        return [u, w, *np.linalg.solve(mass, force)]

    start = [0.2, 1.0, history["wa"][0], -2.0]
    exact = solve_ivp(slope, (0.0, 2.0), start, "DOP853", t_eval=history.time, rtol=1e-13, atol=1e-13).y
    np.testing.assert_allclose(history["a"], exact[0], rtol=0, atol=1e-8)
    np.testing.assert_allclose(history["b"], exact[1], rtol=0, atol=1e-8)
    np.testing.assert_allclose(history["wa"], exact[2], rtol=0, atol=1e-7)


# ---------------------------------------------------------------- spin-up of a rotating beam


def test_spin_up_stretch_and_largest_deflection(run_deck):
    """Steady stretch 5.1432e-4 m (published 5.14e-4) and a largest tip deflection of about 0.574 m near 6.75 s."""
    deck = (REFERENCE / "spin_up" / "deck.nml").read_text(encoding="utf-8")
    deck = deck.replace("elements=4", "elements=8").replace("step=1.0e-4 output_step=0.2", "step=2.0e-4 output_step=0.05")
    history = run_deck(deck).history
    lowest = int(np.argmin(history["tip.v"]))
    assert abs(history["tip.v"][lowest] + 0.575855) < 0.003 * 0.575855  # von Karman strain; geometrically exact 0.573780
    assert abs(history.time[lowest] - 6.75) < 0.06
    steady = history.time >= 15.0  # the arm still vibrates by 4 mm, which shortens it by some 1e-3 of the stretch
    assert np.abs(history["tip.v"][steady]).max() < 5e-3
    assert abs(history["tip.u"][steady].mean() - 5.1432e-4) < 1.5e-3 * 5.1432e-4


def test_spin_up_without_stiffening_diverges(run_deck):
    """Linear elasticity softens with spin: above its first frequency, 3.80 rad/s, the arm flies off."""
    deck = (REFERENCE / "spin_up" / "deck.nml").read_text(encoding="utf-8")
    deck = deck.replace("stiffening=.true.", "").replace("step=1.0e-4", "step=2.0e-4")
    run = run_deck(deck, expect=None)
    assert run.status == 1 or np.abs(run.history["tip.v"]).max() > 10.0


# ---------------------------------------------------------------- flexible slider-crank of the IVP test set


def test_ivp_flexible_slider_crank(run_deck):
    """A physical beam in Simeon's slider-crank: crank at 150 rad/s, linear elasticity, frame through both ends of the rod."""
    deck = """&material name='steel' density=7870.0 young=2.0e11 /
&section name='square' shape='rectangle' width=0.008 height=0.008 /
&body name='crank' kind='rigid' mass=0.1 inertia=1.0e-4 com=0.075,0.0 /
&body name='rod' kind='beam' length=0.30 elements=12 material='steel' section='square' position=0.15,0.0 /
&lump body='rod' node=-1 mass=0.075552 /
&joint name='bearing' type='revolute' body_a='crank' /
&joint name='pin' type='revolute' body_a='rod' node_a=1 body_b='crank' point_b=0.15,0.0 /
&joint name='slider' type='slider' body_a='rod' node_a=-1 direction=0.0 /
&history name='speed' kind='polynomial' coefficients=150.0 /
&drive name='motor' type='rotation' body_a='crank' history='speed' rate=.true. /
&sensor name='phi1' quantity='angle' body='crank' /
&sensor name='phi2' quantity='angle' body='rod' /
&sensor name='dphi2' quantity='angular_velocity' body='rod' /
&sensor name='x3' quantity='position' body='rod' node=-1 /
&sensor name='mid' quantity='deflection' body='rod' node=7 /
&sensor name='end' quantity='deflection' body='rod' node=-1 /
&transient t_end=0.1 method='rk4' step=1.0e-6 output_step=5.0e-4 /
"""
    history = run_deck(deck).history
    published = read(REFERENCE / "published" / "crank_conv_lin_ini2.csv")
    tolerances = {
        ("phi1", "phi1"): 1e-12,
        ("phi2", "phi2"): 2e-5,
        ("x3.x", "x3"): 4e-5,
        ("dphi2", "dphi2"): 2e-3,
        ("mid.v", "wmid_local"): 4e-4,
    }
    for (column, other), tolerance in tolerances.items():
        error = np.abs(history[column] - published[other]).max()
        assert error < tolerance * np.ptp(published[other]), column
    largest = int(np.argmax(np.abs(history["mid.v"])))
    assert abs(history.time[largest] - 0.048) < 1e-9
    assert abs(history["mid.v"][largest] - 1.97724e-3) < 4e-4 * 1.97724e-3
    assert abs(history["phi2"][-1] + 0.33119254) < 1e-6
    assert abs(history["x3.x"][-1] - 0.16971977) < 1e-6
    assert abs(history["mid.v"][-1] + 1.42199e-4) < 4e-7
