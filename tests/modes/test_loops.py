"""Closed loops about a state: poles, growth and margins beside parts that are stiff or free, what a static analysis leaves them."""

from __future__ import annotations

import numpy as np
import pytest
from loop_oracle import random_loop

CART = """&body name='cart' kind='rigid' mass=2 inertia=0.1 /
&joint name='way' type='prismatic' body_a='cart' body_b='ground' /
&sensor name='cart' quantity='position' body='cart' /
&history name='zero' coefficients=0 /
&force name='motor' body='cart' fx=1 controller='servo' /
"""
STIFF = """&material name='steel' density=7800 young=2.1e11 /
&section name='s' shape='rectangle' width=0.01 height=0.01 /
&body name='rod' kind='beam' length=0.05 elements=12 material='steel' section='s' reference='clamped' position=0,3 /
&joint name='clamp' type='weld' body_a='rod' node_a=1 body_b='ground' point_b=0,3 /
"""


def poles_of(run):
    """Return the rows of poles.txt as complex numbers."""
    rows = np.atleast_2d(np.loadtxt(run.folder / "poles.txt"))
    return rows[:, 2] + 1j * rows[:, 3]


def pid(**law):
    """Return a controller of the cart."""
    return "&controller name='servo' argument='cart.x' history='zero' " + " ".join(f"{k}={v!r}" for k, v in law.items()) + " /\n"


@pytest.mark.parametrize("seed", [pytest.param(seed, marks=[pytest.mark.long] * (seed >= 12)) for seed in range(200)])
def test_poles_and_margins_of_a_random_loop(run_deck, seed):
    """Every pole as a dense eigenvalue of the part alone, growth as Nyquist counts it, margins as on a fine grid."""
    loop = random_loop(seed)
    run = run_deck(loop.deck + "&modal modes=1 /\n")
    told, right = poles_of(run), loop.poles()
    for pole in right[right.imag >= 0]:
        assert np.abs(told - pole).min() <= 1e-8 * abs(pole) + 1e-12 * np.abs(right).max()
    growing = (right.real > 1e-9 * np.abs(right)).sum()
    assert loop.encircled() == growing
    figures = run.figures["closed_loops"]
    assert figures["growing"] == growing
    assert len(figures["margins"]) == (growing == 0)
    if growing:
        return
    gains, lags = loop.margins()
    (told,) = figures["margins"]
    assert ("gain_margin" in told, "phase_margin" in told) == (bool(gains), bool(lags))
    if gains:
        gain, at = min(gains, key=lambda x: abs(np.log(x[0])))
        assert (told["gain_margin"], told["gain_margin_at"] * 2 * np.pi) == pytest.approx((gain, at), rel=1e-6)
    if lags:
        lag, at = min(lags)
        assert (told["phase_margin"], told["phase_margin_at"] * 2 * np.pi) == pytest.approx((lag, at), rel=1e-6)


def test_a_gain_margin_lies_at_0_hz(run_deck):
    """An upright pendulum falls where the gain is less than its weight times its arm: 0.8, at s = 0."""
    deck = """&scene gravity=0,-8 /
&body name='rod' kind='rigid' mass=1 inertia=0.05 com=0,0.25 /
&joint name='hub' type='revolute' body_a='rod' body_b='ground' /
&sensor name='rod' quantity='angle' body='rod' /
&history name='zero' coefficients=0 /
&controller name='servo' argument='rod' history='zero' kp=2.5 kd=0.6 delay=0.01 /
&force name='motor' type='torque' body='rod' moment=1 controller='servo' /
"""
    (told,) = run_deck(deck + "&modal modes=1 /\n").figures["closed_loops"]["margins"]
    assert told["gain_margin"] == pytest.approx(0.8, rel=1e-9)
    assert told["gain_margin_at"] == 0.0


@pytest.mark.parametrize("law", [{"kp": 10.0, "ki": 5.0, "kd": 4.0}, {"kp": 1e-3, "ki": 5e-6, "kd": 4e-2}])
def test_a_slow_loop_beside_a_stiff_part(run_deck, law):
    """Routh: s^3 m + kd s^2 + kp s + ki grows below the gain ki m/(kp kd), at sqrt(ki/kd); ten decades lie below the beam."""
    run = run_deck(CART + STIFF + pid(**law) + "&modal modes=2 /\n")
    (told,) = run.figures["closed_loops"]["margins"]
    assert run.figures["closed_loops"]["growing"] == 0
    assert told["gain_margin"] == pytest.approx(2 * law["ki"] / law["kp"] / law["kd"], rel=1e-8)
    assert told["gain_margin_at"] == pytest.approx(np.sqrt(law["ki"] / law["kd"]) / 2 / np.pi, rel=1e-8)
    for part, growing in ((0.98, 2), (1.02, 0)):
        less = {name: part * told["gain_margin"] * gain for name, gain in law.items()}
        run = run_deck(CART + STIFF + pid(**less) + "&modal modes=2 /\n", name=f"grows_{growing}")
        assert run.figures["closed_loops"]["growing"] == growing


PAIR = """&body name='a' kind='rigid' mass=2 inertia=0.1 /
&body name='b' kind='rigid' mass=3 inertia=0.1 position=1,0 /
&joint name='way_a' type='prismatic' body_a='a' body_b='ground' /
&joint name='way_b' type='prismatic' body_a='b' body_b='ground' point_b=1,0 /
&sensor name='d' quantity='distance' body='a' body_b='b' /
&history name='one' coefficients=1 /
&force name='on_b' body='b' fx=1 controller='servo' /
&force name='on_a' body='a' fx=-1 controller='servo' /
"""


@pytest.mark.parametrize("delay", [0.0, 0.01])
def test_free_motion_beside_a_loop_does_not_grow(run_deck, delay):
    """Two carts hold their distance and drift: the drift has a double pole at 0, exactly, and the state is one of rest."""
    law = f"&controller name='servo' argument='d' history='one' kp=0.3 kd=0.2 delay={delay} /\n" if delay else PAIR_LAW
    run = run_deck(PAIR + law + "&modal modes=2 /\n")
    poles = poles_of(run)
    assert (poles == 0).sum() == 2
    assert run.figures["closed_loops"]["growing"] == 0
    assert "no equilibrium" not in run.stderr
    late = np.poly1d([-(delay**3), 12 * delay**2, -60 * delay, 120]), np.poly1d([delay**3, 12 * delay**2, 60 * delay, 120])
    right = (np.poly1d([1.2, 0, 0]) * late[1] + np.poly1d([0.2, 0.3]) * late[0]).roots
    np.testing.assert_allclose(np.sort_complex(poles[poles != 0]), np.sort_complex(right[right.imag >= 0]), rtol=1e-9)


PAIR_LAW = "&controller name='servo' argument='d' history='one' kp=0.3 kd=0.2 /\n"


def test_an_undamped_pole_of_the_open_loop_is_no_crossing(run_deck):
    """A hanging pendulum with PD: the open loop jumps through infinity at its own frequency and limits no gain."""
    deck = CART + "&spring name='k' type='linear' body_a='cart' body_b='ground' point_b=-1,0 stiffness=77 free_length=1 /\n"
    (told,) = run_deck(deck + pid(kp=30.0, kd=5.0) + "&modal modes=1 /\n").figures["closed_loops"]["margins"]
    assert "gain_margin" not in told
    (crossing,) = (x**0.5 for x in np.roots([4.0, -2 * 2 * 77 - 25.0, 77.0**2 - 900]) if x > 77 / 2)
    lag = np.degrees(np.angle(-(30 + 5j * crossing) / (77 - 2 * crossing**2))) % 360
    assert told["phase_margin"] == pytest.approx(lag, rel=1e-8)


PENDULUM = """&scene gravity=0,-9.81 /
&body name='rod' kind='rigid' mass=1 inertia=0.1 com=0,-0.5 /
&joint name='hub' type='revolute' body_a='rod' body_b='ground' /
&sensor name='tip' quantity='position' body='rod' point=0,-1 /
&history name='set' coefficients=-0.4 /
&controller name='servo' argument='tip.y' history='set' kp=10 {} /
&force name='motor' body='rod' point=0,-1 fy=1 controller='servo' {} /
&static /
&modal modes=1 /
"""


@pytest.mark.parametrize(("delay", "stage"), [("", ""), ("delay=0.01", ""), ("", "stage='transient'")])
def test_loops_about_an_equilibrium_have_the_force_of_the_controller(run_deck, delay, stage):
    """&static has no controllers; about what it finds they are switched on: 6 N push the tip up, and the rod falls over."""
    run = run_deck(PENDULUM.format(delay, stage))
    grows = np.sqrt((6.0 - 9.81 * 0.5) / 0.35)
    assert np.abs(poles_of(run) - grows).min() < 1e-9 * grows
    assert run.figures["closed_loops"]["growing"] == 1


HELD = """&scene gravity={},0 /
&spring name='k' type='linear' body_a='cart' body_b='ground' point_b=-1,0 stiffness=800 damping=4 free_length=1 /
&controller name='servo' argument='cart.x' history='zero' kp=3000 upper=50 lower=-50 /
&static /
&modal modes=1 /
"""


def test_limits_are_those_of_the_state_that_static_finds(run_deck):
    """In its equilibrium the cart stands 0.05 m from its set-point: the output is at its limit. Assembled, it stands there."""
    run = run_deck(CART + HELD.format(20))
    assert "at a limit in the present state: controllers servo" in run.stderr
    away = CART.replace("inertia=0.1", "inertia=0.1 position=0.05,0").replace("body_b='ground'", "body_b='ground' point_b=0.05,0")
    run = run_deck(away + HELD.format(0), name="away")
    assert "at a limit" not in run.stderr


@pytest.mark.parametrize("method", ["radau tolerance=1e-9", "rk4 step=1e-3", "generalized_alpha step=1e-3"])
def test_a_held_output_at_its_limit_is_told(run_deck, method):
    """The held output is 10 for 0.1 s to rounding; the flag says that it is at its limit in every row."""
    deck = CART.replace("coefficients=0", "coefficients=1") + pid(kp=100.0, upper=10.0, sample=0.01)
    deck += "&sensor name='o' quantity='controller' controller='servo' /\n"
    method, rest = method.split()
    run = run_deck(deck + f"&transient t_end=0.1 method='{method}' {rest} output_step=0.01 /\n")
    np.testing.assert_array_equal(run.history["o.limited"], 1.0)


def test_a_response_where_the_open_loop_is_free(run_deck):
    """1/(m s^2 + kd s + kp) down to 1e-8 Hz, where the cart alone would drift away."""
    deck = CART + pid(kp=3000.0, kd=20.0) + "&force name='load' body='cart' fx=1 stage='transient' /\n"
    run = run_deck(deck + "&frequency_response from=1e-8 to=1 points=9 input='load' /\n")
    told = np.loadtxt(run.folder / "frequency_response.txt")
    s = 2j * np.pi * told[:, 0]
    np.testing.assert_allclose(told[:, 1] + 1j * told[:, 2], 1 / (2 * s**2 + 20 * s + 3000), rtol=1e-12)


def test_a_response_at_an_undamped_mode_of_the_open_loop(run_deck):
    """There the open loop has none; that of the closed one is 1/(kp + kd s)."""
    deck = CART + "&spring name='k' type='linear' body_a='cart' point_b=-1,0 stiffness={2*(2*pi*10)^2} free_length=1 /\n"
    deck += pid(kp=3000.0, kd=20.0) + "&force name='load' body='cart' fx=1 history='zero' /\n"
    run = run_deck(deck + "&frequency_response from=9 to=10 points=3 input='load' /\n")
    told = np.loadtxt(run.folder / "frequency_response.txt")[-1]
    assert told[1] + 1j * told[2] == pytest.approx(1 / (3000 + 20j * 2 * np.pi * 10), rel=1e-10)


def test_the_windup_at_a_limit_bounds_the_step(run_deck):
    """While the output is at its limit the integral has the pole -1/windup_time: rk4 is stable up to 2.785 times that."""
    law = {"kp": 1000.0, "kd": 20.0, "ki": 1.0, "upper": 20.0, "lower": -20.0, "windup_time": 1e-4}
    deck = CART.replace("coefficients=0", "coefficients=1") + pid(**law)
    deck += "&transient t_end=0.05 method='rk4' step={} output_step=0.01 /\n"
    refused = run_deck(deck.format("1e-3"), expect=2)
    assert 'the windup of controller "servo" while its output is at a limit' in refused.stderr
    run = run_deck(deck.format("2.7e-4"))
    assert run.figures["stable_steps"]["rk4"]["safe_bound"] == pytest.approx(2.785e-4, rel=1e-3)
    assert 0.009 < run.history["cart.x"][-1] < 0.012


def test_an_integral_leaves_no_response_at_0_hz(run_deck):
    """The integral takes a constant load away; the open loop is free there."""
    deck = CART + pid(kp=3000.0, kd=20.0, ki=5.0) + "&force name='load' body='cart' fx=1 history='zero' /\n"
    run = run_deck(deck + "&frequency_response from=0 to=1 points=3 spacing='linear' input='load' /\n")
    told = np.loadtxt(run.folder / "frequency_response.txt")
    s = 2j * np.pi * told[1:, 0]
    np.testing.assert_allclose(told[0, 1:3], 0.0, atol=1e-15)
    np.testing.assert_allclose(told[1:, 1] + 1j * told[1:, 2], s / (2 * s**3 + 20 * s**2 + 3000 * s + 5), rtol=1e-12)
