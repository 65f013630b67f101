"""Units do not matter: a scene in other units of mass, length and time gives the same numbers in those units.

The units are powers of two, so that every number of the deck changes without rounding. Where no absolute size hides in the
solver, fixed explicit steps then give the same histories to the last bit.
"""

import json

import numpy as np
import pytest
from biela.histories import read
from scipy.optimize import brentq

SCALES = {"time": (0, 0, 20), "length": (0, -10, 0), "mass": (-10, 0, 0), "all": (20, 30, -10)}  # powers of 2 of kg, m, s


class Units:
    """Writes quantities in units of mass, length and time."""

    def __init__(self, mass, length, time):
        self.powers = np.array([mass, length, time], dtype=float)

    def __call__(self, value, mass=0, length=0, time=0):
        """Return a value given in SI, whose dimensions follow, as a deck's word."""
        return repr(float(value) * 2.0 ** float(self.powers @ [mass, length, time]))


def slider_crank(u, rod=""):
    """Return a slider-crank: rigid crank at a steady rate, viscoelastic rod of three elements, a spring on the slider."""
    return f"""&scene gravity=0.0,{u(-9.81, length=1, time=-2)} /
&material name='m' density={u(1600.0, mass=1, length=-3)} young={u(2.1e9, mass=1, length=-1, time=-2)}
  ghm_alpha=0.4 ghm_zeta=1.2 ghm_omega={u(700.0, time=-1)} rayleigh_mass={u(0.8, time=-1)} rayleigh_stiffness={u(1e-7, time=1)} /
&section name='s' shape='rectangle' width={u(0.02, length=1)} height={u(0.01, length=1)} /
&body name='crank' kind='rigid' mass={u(0.4, mass=1)} inertia={u(1e-3, mass=1, length=2)} com={u(0.05, length=1)},0.0
  angle=0.5 angular_velocity={u(30.0, time=-1)} /
&body name='rod' kind='beam' length={u(0.3, length=1)} elements=3 material='m' section='s' angle=-0.1602877 {rod}
  position={u(0.08775825618903728, length=1)},{u(0.0479425538604203, length=1)} /
&lump body='rod' node=-1 mass={u(0.2, mass=1)} inertia={u(1e-4, mass=1, length=2)} /
&joint name='a' type='revolute' body_a='crank' /
&joint name='b' type='revolute' body_a='rod' node_a=1 body_b='crank' point_b={u(0.1, length=1)},0.0 /
&joint name='c' type='slider' body_a='rod' node_a=-1 direction=0.0 /
&history name='w' kind='polynomial' coefficients={u(30.0, time=-1)} /
&drive name='motor' type='rotation' body_a='crank' history='w' rate=.true. /
&spring name='s' type='linear' body_a='rod' node_a=-1 point_b={u(1.0, length=1)},0.0 stiffness={u(200.0, mass=1, time=-2)} /
&sensor name='tip' quantity='position' body='rod' node=-1 /
&sensor name='mid' quantity='deflection' body='rod' node=2 /
&sensor name='pin' quantity='reaction' joint='b' /
"""


DIMENSIONS = {  # of the columns: mass, length, time
    "t": (0, 0, 1),
    "tip.x": (0, 1, 0),
    "mid.u": (0, 1, 0),
    "mid.v": (0, 1, 0),
    "mid.r": (0, 0, 0),
    "pin.fx": (1, 1, -2),
    "pin.fy": (1, 1, -2),
}


def histories(run_deck, powers, words):
    """Return the columns of a run in SI, from a deck in the given units."""
    u = Units(*powers)
    steps = f"&transient t_end={u(0.02, time=1)} output_step={u(4e-4, time=1)} {words(u)} /\n"
    found = run_deck(slider_crank(u) + steps, name="u" + "_".join(str(p) for p in powers)).history
    return {name: found[name] / 2.0 ** float(u.powers @ d) for name, d in DIMENSIONS.items()}


@pytest.mark.parametrize("scale", SCALES)
def test_fixed_explicit_steps_are_the_same_to_the_last_bit(run_deck, scale):
    def words(u):
        return f"method='rk4' step={u(1e-5, time=1)}"

    plain = histories(run_deck, (0, 0, 0), words)
    for name, column in histories(run_deck, SCALES[scale], words).items():
        np.testing.assert_array_equal(column, plain[name], err_msg=name)


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize(("method", "limit"), [("dopri5", 1e-9), ("generalized_alpha", 1e-8)])
def test_other_steps_are_the_same_to_rounding(run_deck, scale, method, limit):
    """Steps of dopri5 follow a frequency from Lanczos' iteration and measured rounding; implicit pivots mix forces and lengths.

    An absolute size in the choice of the first step moved the histories of dopri5 by 1e-8.
    """

    def words(u):
        return f"method='{method}' " + ("tolerance=1e-5" if method == "dopri5" else f"step={u(2e-5, time=1)}")

    plain = histories(run_deck, (0, 0, 0), words)
    for name, column in histories(run_deck, SCALES[scale], words).items():
        assert np.abs(column - plain[name]).max() <= limit * np.abs(plain[name]).max(), name


def counts(run_deck, powers, words, rod=""):
    """Return what summary.json says of the run of a slider-crank in the given units."""
    u = Units(*powers)
    steps = f"&transient t_end={u(0.02, time=1)} output_step={u(4e-4, time=1)} {words(u)} /\n"
    run = run_deck(slider_crank(u, rod) + steps, name="c" + "_".join(str(p) for p in powers))
    return json.loads((run.folder / "summary.json").read_text(encoding="utf-8"))["transient"]


@pytest.mark.parametrize("scale", SCALES)
def test_bounds_of_steps_are_watched_in_any_units(run_deck, scale):
    def words(u):
        return f"method='rk4' step={u(1e-5, time=1)}"

    plain, found = (counts(run_deck, powers, words) for powers in ((0, 0, 0), SCALES[scale]))
    second = 2.0 ** SCALES[scale][2]
    assert found["bound_estimates"] == plain["bound_estimates"] > 1
    assert found["smallest_bound"] / second == pytest.approx(plain["smallest_bound"], rel=1e-6)
    assert found["smallest_bound_at"] / second == pytest.approx(plain["smallest_bound_at"], rel=1e-6)


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize(
    ("words", "rod"),
    [
        ("method='generalized_alpha' step={}", ""),
        ("method='radau' tolerance=1e-6", "modes=2"),
    ],
)
def test_newton_iterates_as_often_in_any_units(run_deck, scale, words, rod):
    """Its tests of convergence compare lengths with the scene's size and angles with one radian."""

    def method(u):
        return words.format(u(1e-4, time=1))

    plain, found = (counts(run_deck, powers, method, rod) for powers in ((0, 0, 0), SCALES[scale]))
    for name in ("steps", "newton_iterations"):
        assert found[name] == pytest.approx(plain[name], rel=0.03), name


@pytest.mark.parametrize("tolerance", [1e-4, 1e-5])
def test_the_first_step_of_a_slow_motion_is_the_same_in_any_unit_of_time(run_deck, tolerance):
    found = []
    for power in (0, -10, 10):
        u = Units(0, 0, power)
        deck = f"""&body name='b' mass=1.0 inertia=1.0 /
&joint name='g' type='prismatic' body_a='b' direction=0.0 /
&spring name='s' type='linear' body_a='b' point_b=1.0,0.0 stiffness={u(0.25, time=-2)} free_length=0.5 /
&transient t_end={u(0.1, time=1)} output_step={u(0.01, time=1)} method='radau' tolerance={tolerance} /
"""
        told = json.loads((run_deck(deck, name=f"p{power}").folder / "summary.json").read_text(encoding="utf-8"))["transient"]
        found.append([told["steps"], told["rejected"], told["shortest_step"] / 2.0**power])
    assert found[1] == pytest.approx(found[0], rel=1e-6)
    assert found[2] == pytest.approx(found[0], rel=1e-6)


def flap(u, stiffness, spin):
    """Return a link on a torsional spring, hinged to the rim of a hub that turns steadily; the spring is slack at 0.8 rad."""
    w = u(spin, time=-1)
    return f"""&body name='hub' kind='rigid' mass={u(1.0, mass=1)} inertia={u(1.0, mass=1, length=2)} angular_velocity={w} /
&joint name='axle' type='revolute' body_a='hub' /
&history name='w' kind='polynomial' coefficients={w} /
&drive name='motor' type='rotation' body_a='hub' history='w' rate=.true. /
&body name='link' kind='rigid' mass={u(2.0, mass=1)} inertia={u(1 / 6, mass=1, length=2)} com={u(0.5, length=1)},0.0
  position={u(0.5, length=1)},0.0 angular_velocity={w} velocity=0.0,{u(0.5 * spin, length=1, time=-1)} /
&joint name='hinge' type='revolute' body_a='link' body_b='hub' point_b={u(0.5, length=1)},0.0 /
&spring name='flat' type='torsional' body_a='link' body_b='hub' stiffness={u(stiffness, mass=1, length=2, time=-2)} free_angle=0.8 /
&static tolerance=1.0e-13 /
&modal modes=1 /
"""


@pytest.mark.parametrize("scale", ["none", *SCALES])
@pytest.mark.parametrize(("stiffness", "spin"), [(10.0, 3.0), (1e4, 30.0), (1.0, 30.0)])
def test_steady_turn_of_a_sprung_link(run_deck, scale, stiffness, spin):
    """Centrifugal moment m r c w^2 sin(angle) against the spring's, and the frequency about that state."""
    u = Units(*SCALES.get(scale, (0, 0, 0)))
    run = run_deck(flap(u, stiffness, spin))
    pull = 2.0 * 0.5 * 0.5 * spin**2
    exact = brentq(lambda a: stiffness * (0.8 - a) - pull * np.sin(a), 0.0, 1.0, xtol=1e-15)
    angle = read(run.folder, "static")["state.link.angle"][-1]
    assert angle == pytest.approx(exact, rel=1e-10)
    frequency = np.sqrt((stiffness + pull * np.cos(exact)) / (2.0 / 3.0)) / (2.0 * np.pi)
    modes = read(run.folder, "modes")
    assert modes["frequency"][0] == pytest.approx(float(u(frequency, time=-1)), rel=1e-10)


def carried_line(u, words):
    """Return a damped beam that carries a slider's line; a damper from the slider to the ground turns with the body."""
    return f"""&scene gravity=0.0,{u(-9.81, length=1, time=-2)} /
&material name='m' density={u(2000.0, mass=1, length=-3)} young={u(2e8, mass=1, length=-1, time=-2)}
  rayleigh_stiffness={u(1e-4, time=1)} /
&section name='s' shape='rectangle' width={u(0.02, length=1)} height={u(0.01, length=1)} /
&body name='b' kind='beam' length={u(0.4, length=1)} elements=2 material='m' section='s' /
&body name='c' kind='rigid' mass={u(0.4, mass=1)} inertia={u(1e-3, mass=1, length=2)} angle=0.2
  position={u(0.5, length=1)},{u(0.05, length=1)} com={u(0.04, length=1)},{u(0.03, length=1)} /
&joint name='j' type='revolute' body_a='b' node_a=1 /
&joint name='k' type='slider' body_a='c' body_b='b' node_b=-1 direction=0.4636 /
&spring name='d' type='linear' body_a='c' point_a={u(0.1, length=1)},0.0 point_b={u(0.8, length=1)},{u(0.3, length=1)}
  stiffness={u(30.0, mass=1, time=-2)} damping={u(2.0, mass=1, time=-1)} /
&sensor name='p' quantity='position' body='c' /
&sensor name='pin' quantity='reaction' joint='j' /
&transient t_end={u(0.05, time=1)} output_step={u(1e-3, time=1)} {words} /
"""


@pytest.mark.parametrize("powers", [(0, -10, 0), (0, -20, 0), (0, 10, 0), (20, 0, 0), (0, 0, -12)])
@pytest.mark.parametrize("method", ["radau", "generalized_alpha"])
def test_a_line_that_a_body_carries_is_the_same_in_any_units(run_deck, powers, method):
    """Rows of moments and of rates stand beside those of forces: mixed pivots, 1e-6 by length, looked like a singular position."""

    def run(u, name):
        words = "tolerance=1e-6" if method == "radau" else f"step={u(2e-4, time=1)}"
        found = run_deck(carried_line(u, f"method='{method}' {words}"), name=name)
        told = found.transient
        return [told[x] for x in ("steps", "newton_iterations")], found.history["p.x"] / float(u(1, length=1)), found.history

    u = Units(*powers)
    plain, found = run(Units(0, 0, 0), "plain"), run(u, "other")
    assert found[0] == pytest.approx(plain[0], rel=0.005)
    assert np.abs(found[1] - plain[1]).max() < 1e-10
    force = found[2]["pin.fy"] / float(u(1, mass=1, length=1, time=-2))
    assert np.abs(force - plain[2]["pin.fy"]).max() < 1e-8 * np.abs(force).max()
