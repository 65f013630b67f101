"""Cycles and their Floquet multipliers against closed forms and independent monodromies."""

from __future__ import annotations

import itertools
import math
import signal
import subprocess
import time

import numpy as np
import pytest
from conftest import REFERENCE, ROOT, caught, wait_for
from linear_oracle import TurningArm
from oracle_probe import Twins
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq, root
from scipy.special import mathieu_a, mathieu_b

GRAVITY = 9.81


def multipliers(run) -> np.ndarray:
    """Return those of floquet.txt, largest first, and hold the summary to it."""
    table = np.loadtxt(run.folder / "floquet.txt", ndmin=2)
    found = table[:, 1] + 1j * table[:, 2]
    told = [m["real"] + 1j * m["imag"] for m in run.figures["periodic"]["multipliers"]]
    assert np.array_equal(found, told)
    assert np.allclose(table[:, 3], np.abs(found), rtol=1e-14)
    return found


def assert_multipliers(run, expected, tolerance=1e-6):
    """Hold the multipliers to the expected ones, as sets, and their told errors to the true ones."""
    found = multipliers(run)
    errors = np.loadtxt(run.folder / "floquet.txt", ndmin=2)[:, 4]
    expected = sorted(np.atleast_1d(expected), key=lambda x: (-abs(x), -x.imag))[: len(found)]
    for value, error in zip(found, errors):
        nearest = min(abs(value - x) for x in expected)
        assert nearest < tolerance, (value, expected)
        assert nearest < 10 * error + 2e-8, (value, error)
    assert len(found) == len(expected)


def assert_repeats(run, tolerance=1e-8):
    """Hold the rows of the transient of one period to the first one, over their ranges."""
    rows = run.history.data[:, 1:]
    ranges = np.ptp(rows, axis=0)
    assert np.all(np.abs(rows[-1] - rows[0]) <= tolerance * np.maximum(ranges, 1e-6 * ranges.max()))


# --- impacts


BALL = """! A ball that a table, driven up and down, meets once a period.
&parameter name='A' value=0.0015 /
&parameter name='T' value=0.1 /
&parameter name='e' value=0.8 /
&parameter name='k' value=1 /
&parameter name='w' value={9.81*T/2*(1-e)/(1+e)} /
&parameter name='ph' value={k*acos(w/(A*2*pi/T))} /
&scene gravity=0,-9.81 /
&body name='table' mass=1 inertia=1 position=0,{A*sin(ph-pi)} /
&body name='ball' mass=1 inertia=1 position=0,{A*sin(ph) + 9.81*T^2/8 + 1e-4} velocity=0,0.01 /
&joint name='g1' type='prismatic' body_a='table' direction={pi/2} /
&joint name='g2' type='prismatic' body_a='ball' direction={pi/2} /
&history name='h' kind='sine' amplitude={A} frequency={1/T} phase={ph-pi} /
&drive name='d' type='position' body_a='table' direction={pi/2} history='h' /
&stop name='s' type='position' body_a='ball' point_a=0,0 body_b='table' point_b=0,0 direction={pi/2} lower=0.0 restitution={e} /
&sensor name='z' quantity='position' body='ball' /
&periodic period={T} multipliers=2 /
&transient method='rk4' step={T/500} output_step={T/50} /
"""


@pytest.mark.parametrize("side", [1, -1])
def test_bouncing_ball(run_deck, side):
    """Both phases at which a ball bounces once a period (Holmes, J. Sound Vib. 84, 1982): one is stable, the other is not."""
    amplitude, period, rebound = 0.0015, 0.1, 0.8
    omega = 2 * math.pi / period
    table_speed = GRAVITY * period / 2 * (1 - rebound) / (1 + rebound)
    phase = side * math.acos(table_speed / (amplitude * omega))
    run = run_deck(BALL, "--set", f"k={side}")
    height = amplitude * math.sin(phase) + GRAVITY * period**2 / 8
    assert abs(run.history["z.y"][0] - height) < 1e-10
    flight = np.array([[1, period / 2], [0, 1]])
    slope = -(1 + rebound) * (GRAVITY - amplitude * omega**2 * math.sin(phase)) / (-GRAVITY * period / 2 - table_speed)
    jump = np.array([[-rebound, 0], [slope, -rebound]])
    expected = np.linalg.eigvals(flight @ jump @ flight)
    assert_multipliers(run, expected)
    assert run.figures["periodic"]["stable"] == (side == 1)


def test_ball_at_rest(run_deck):
    """A table that throws the ball, which rebounds endlessly often and rests: no freedom is left at t = 0, nothing lives on."""
    deck = BALL.replace("name='e' value=0.8", "name='e' value=0.3").replace("name='A' value=0.0015", "name='A' value=0.0035")
    run = run_deck(deck.replace("value={k*acos(w/(A*2*pi/T))}", "value=-0.5").replace("phase={ph-pi}", "phase=-0.5"))
    assert run.figures["periodic"]["multipliers"] == []
    assert run.figures["periodic"]["stable"]
    assert run.transient["events"]["count"] > 3


OSCILLATOR = """! A mass on a damped spring under a harmonic force, with a rigid stop: one impact a period.
&scene /
&body name='mass' mass=1 inertia=1 position=0.03,0 velocity=0.9,0 /
&joint name='rail' type='prismatic' body_a='mass' direction=0 /
&spring name='k' type='linear' body_a='mass' body_b='ground' point_b=-2,0 stiffness=100 damping=0.5 free_length=2 /
&history name='h' kind='sine' amplitude=1 frequency={12/(2*pi)} phase=0.2 /
&force name='f' type='force' body='mass' fx=15 history='h' /
&stop name='s' type='position' body_a='mass' point_a=0,0 body_b='ground' point_b=0,0 direction=0 upper=0.05 restitution=0.7 /
&sensor name='x' quantity='position' body='mass' /
&sensor name='v' quantity='velocity' body='mass' /
&periodic period={2*pi/12} multipliers=2 /
&transient method='rk4' step=1e-3 output_step=1e-2 /
"""


def linear_flight(duration, state, time, parameters):
    """Return the state after a flight of x'' + 2 d x' + k x = f sin(w t + p) in closed form, and the matrix of the flight."""
    k, c, force, omega, phase = parameters
    drive = np.array([[0, 1, 0, 0], [-k, -c, force, 0], [0, 0, 0, omega], [0, 0, -omega, 0]])
    start = np.array([*state, math.sin(omega * time + phase), math.cos(omega * time + phase)])
    return (expm(drive * duration) @ start)[:2], expm(drive[:2, :2] * duration)


def test_impact_oscillator(run_deck):
    """The impact oscillator of Shaw & Holmes (J. Sound Vib. 90, 1983): orbit by matching, monodromy by flight, jump, flight."""
    parameters = (100.0, 0.5, 15.0, 12.0, 0.2)
    period, limit, rebound = 2 * math.pi / 12, 0.05, 0.7
    run = run_deck(OSCILLATOR)
    state = np.array([run.history["x.x"][0], run.history["v.x"][0]])
    hit = brentq(lambda t: linear_flight(t, state, 0.0, parameters)[0][0] - limit, *bracket(run))
    before, first = linear_flight(hit, state, 0.0, parameters)
    after = np.array([limit, -rebound * before[1]])
    end, second = linear_flight(period - hit, after, hit, parameters)
    assert np.allclose(end, state, atol=1e-9 * 15)
    acceleration = [
        -100 * limit - 0.5 * v + 15 * math.sin(12 * hit + 0.2) for v in (before[1], after[1])
    ]  # before and after the impact
    jump = np.array([[-rebound, 0], [(acceleration[1] + rebound * acceleration[0]) / before[1], -rebound]])
    assert_multipliers(run, np.linalg.eigvals(second @ jump @ first))
    assert abs(np.prod(multipliers(run)) - rebound**2 * math.exp(-0.5 * period)) < 1e-6
    assert run.figures["periodic"]["turns_to_cycle"] <= 9  # the start strikes once more than the cycle


def bracket(run):
    """Return times around the first impact of a run."""
    events = [line.split() for line in (run.folder / "events.txt").read_text().splitlines() if not line.startswith("#")]
    time = float(events[0][0])
    return time - 2e-3, time + 2e-3


# --- parametric vibration


MATHIEU = """! Pendulum on a pivot that is driven up and down: small motions are y'' + (a - 2 q cos 2v) y = 0, v = W t/2.
&parameter name='a' value=0.3 /
&parameter name='q' value=0.4 /
&parameter name='W' value=20 /
&parameter name='L' value=0.25 /
&scene gravity=0,{-L*a*W^2/4} /
&body name='bob' mass=1 inertia={L^2*2/9} position=0,{-q*L/2} com=0,{-2*L/3} /
&joint name='pivot' type='slider' body_a='bob' point_a=0,0 body_b='ground' point_b=0,0 direction={pi/2} /
&history name='h' kind='sine' amplitude={q*L/2} frequency={W/2/pi} phase={-pi/2} /
&drive name='d' type='position' body_a='bob' point_a=0,0 direction={pi/2} history='h' /
&sensor name='p' quantity='angle' body='bob' /
&periodic period={2*pi/W} multipliers=2 /
&transient method='rk4' step={2*pi/W/500} output_step={2*pi/W/50} /
"""


def mathieu_multipliers(a, q):
    """Return the multipliers over pi of y'' + (a - 2 q cos 2v) y = 0."""

    def slope(v, y):
        return [y[1], -(a - 2 * q * math.cos(2 * v)) * y[0], y[3], -(a - 2 * q * math.cos(2 * v)) * y[2]]

    end = solve_ivp(slope, (0, math.pi), [1, 0, 0, 1], method="DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
    return np.linalg.eigvals(end.reshape(2, 2).T)


@pytest.mark.parametrize(("a", "q"), [(0.3, 0.4), (1.0, 0.6), (-0.02, 0.3), (-0.2, 0.3), (2.6, 1.5)])
def test_mathieu(run_deck, a, q):
    """Stable and unstable hanging and standing pendulums."""
    run = run_deck(MATHIEU, "--set", f"a={a}", "--set", f"q={q}")
    expected = mathieu_multipliers(a, q)
    assert_multipliers(run, expected, 1e-6 * max(1, abs(expected).max()))
    assert abs(np.prod(multipliers(run)) - 1) < 1e-6
    assert run.figures["periodic"]["stable"] is (False if np.max(np.abs(expected)) > 1.1 else None)  # nothing damps them


CURVES = [(mathieu_a, 1, -1), (mathieu_b, 1, -1), (mathieu_a, 2, 1), (mathieu_a, 0, 1)]


@pytest.mark.parametrize(("curve", "order", "half_trace"), CURVES)
def test_characteristic_curves(run_deck, curve, order, half_trace):
    """On the characteristic curves of Abramowitz & Stegun (20.2) the half trace is 1 or -1, where stability changes."""
    q = 0.5
    run = run_deck(MATHIEU, "--set", f"a={curve(order, q):.17g}", "--set", f"q={q}")
    assert abs(np.sum(multipliers(run)) / 2 - half_trace) < 1e-7


# --- friction


SLIDER = """! A mass on a spring with dry friction under a harmonic force: it never rests (Den Hartog, Trans. ASME 53, 1931).
&scene gravity=0,-9.81 /
&body name='mass' mass=1 inertia=1 position=0.1,0 velocity=0.8,0 /
&joint name='rail' type='prismatic' body_a='mass' direction=0 friction=0.1 /
&spring name='k' type='linear' body_a='mass' body_b='ground' point_b=-2,0 stiffness=100 free_length=2 /
&history name='h' kind='sine' amplitude=1 frequency={14/(2*pi)} /
&force name='f' type='force' body='mass' fx=30 history='h' /
&sensor name='x' quantity='position' body='mass' /
&sensor name='v' quantity='velocity' body='mass' /
&periodic period={2*pi/14} multipliers=2 /
&transient method='rk4' step=1e-3 output_step=1e-2 /
"""


def test_friction(run_deck):
    """Two reversals a period: monodromy by flights and the jumps of the acceleration at them."""
    run = run_deck(SLIDER)
    period, brake = 2 * math.pi / 14, 0.1 * GRAVITY
    events = [line.split() for line in (run.folder / "events.txt").read_text().splitlines() if not line.startswith("#")]
    times = [float(e[0]) for e in events]
    assert len(times) == 2
    state, monodromy, now = np.array([run.history["x.x"][0], run.history["v.x"][0]]), np.eye(2), 0.0
    lost, turns = run.figures["periodic"]["losses"], []
    sign = math.copysign(1.0, state[1])
    for event in [*times, period]:
        shift = np.array([-sign * brake / 100, 0])
        state, flight = linear_flight(event - now, state - shift, now, (100.0, 0.0, 30.0, 14.0, 0.0))
        state, monodromy, now = state + shift, flight @ monodromy, event
        if event < period:
            assert abs(state[1]) < 1e-8
            turns.append(state[0])
            drive = -100 * state[0] + 30 * math.sin(14 * event)
            monodromy = np.diag([1, (drive + sign * brake) / (drive - sign * brake)]) @ monodromy
            sign = -sign
    assert np.allclose(state, [run.history["x.x"][0], run.history["v.x"][0]], atol=1e-8)
    assert_multipliers(run, np.linalg.eigvals(monodromy))
    assert [one["element"] for one in lost] == ["rail"]
    assert abs(lost[0]["lost"] - 2 * brake * abs(turns[0] - turns[1])) < 1e-8


@pytest.mark.parametrize("phase", [0.6, 2.0])
def test_rest_that_kinetic_friction_would_not_hold(run_deck, phase):
    """It rests twice a period. At phase 2 it does so at t = 0, held by more than kinetic friction: so it does beside the cycle."""
    deck = SLIDER.replace("friction=0.1", "friction=0.5 friction_static=0.8").replace("position=0.1,0 velocity=0.8,0", "")
    deck = deck.replace("14/(2*pi)", f"4/(2*pi)}} phase={{{phase}").replace("2*pi/14", "2*pi/4")
    run = run_deck(deck + "&sensor name='r' quantity='friction' joint='rail' /\n")
    assert (0.55 * GRAVITY < run.history["r.f"][0] < 0.8 * GRAVITY) == (phase == 2.0)
    shift = np.array([-0.5 * GRAVITY / 100, 0])

    def across(x):
        """Return where a slide from rest at x ends, seen from the other side: slides to and fro are alike."""
        start = math.asin((100 * x + 0.8 * GRAVITY) / 30) / 4
        flight = lambda s: linear_flight(s, np.array([x, 0]) - shift, start, (100.0, 0.0, 30.0, 4.0, 0.0))[0]  # noqa: E731
        return -(flight(brentq(lambda s: flight(s)[1], 0.4, 0.7, xtol=1e-15))[0] + shift[0])

    rest = brentq(lambda x: across(x) - x, -0.36, -0.32, xtol=1e-15)
    assert phase != 2.0 or abs(run.history["x.x"][0]) == pytest.approx(-rest, rel=1e-8)
    exact = ((across(rest + 1e-5) - across(rest - 1e-5)) / 2e-5) ** 2
    assert multipliers(run) == pytest.approx([exact], abs=2e-6)
    if phase == 0.6:  # at 2.0 the second difference, by which the told error goes, happens to be small
        assert_multipliers(run, exact)


@pytest.mark.parametrize("sides", [1, 2])
def test_stops_that_are_just_not_touched(run_deck, sides):
    """Moved starts touch: multipliers are those of the side that does not; where both touch, there are none."""
    w = 8.0
    top = 10 / (4 - w**2 + 2j * w)
    limits = " ".join(f"{name}={sign * abs(top) * (1 + 1e-6)!r}" for name, sign in (("upper", 1), ("lower", -1))[:sides])
    run = run_deck(
        f"""&body name='m' mass=1 inertia=1 position={top.imag!r},0 velocity={top.real * w!r},0 /
&joint name='g' type='prismatic' body_a='m' direction=0 /
&spring name='k' body_a='m' body_b='ground' point_b=-1,0 stiffness=4 damping=2 free_length=1 /
&history name='h' kind='sine' amplitude=1 frequency={{{w}/2/pi}} /
&force name='f' body='m' fx=10 history='h' /
&stop name='s' type='position' body_a='m' direction=0 restitution=0.5 {limits} /
&periodic period={{2*pi/{w}}} multipliers=2 /
&transient method='rk4' step={{2*pi/{w}/400}} output_step={{2*pi/{w}/20}} /
"""
    )
    assert ("change on both sides of the cycle" in run.stderr) == (sides == 2)
    if sides == 1:
        assert_multipliers(run, np.exp(np.roots([1, 2, 4]) * 2 * np.pi / w), 1e-8)


# --- unknown period


ROTOR = """! Rotor off its centre under a constant torque with viscous drag: the divergence gives the product of the multipliers.
&scene gravity=0,-9.81 /
&body name='rotor' mass=1 inertia=0.01 com=0.05,0 angular_velocity=20 /
&joint name='shaft' type='revolute' body_a='rotor' point_a=0,0 body_b='ground' point_b=0,0 /
&spring name='drag' type='torsional' body_a='rotor' body_b='ground' stiffness=0 damping=0.05 free_angle=0 /
&force name='motor' type='torque' body='rotor' moment=1.0 /
&sensor name='w' quantity='angular_velocity' body='rotor' /
&sensor name='a' quantity='angle' body='rotor' /
&periodic period_guess=0.3 /
&transient method='rk4' step=1e-3 output_step=1e-2 /
"""


def test_rotor_of_unknown_period(run_deck):
    """One multiplier belongs to time; the other is exp(-c T/J)."""
    run = run_deck(ROTOR)
    period = run.figures["periodic"]["period"]
    assert_multipliers(run, math.exp(-0.05 * period / 0.0125))
    rate = solve_ivp(
        lambda angle, y: [(1.0 - 0.05 * y[0] - 0.05 * GRAVITY * math.cos(angle)) / (0.0125 * y[0]), 1 / y[0]],
        (run.history["a"][0], run.history["a"][0] + 2 * math.pi),
        [run.history["w"][0], 0],
        method="DOP853",
        rtol=1e-12,
        atol=1e-12,
    ).y[:, -1]
    assert abs(rate[0] - run.history["w"][0]) < 1e-7
    assert abs(rate[1] - period) < 1e-9
    assert run.history.time[-1] == period


BELT = """! A block on a moving belt: it sticks, breaks away at the static limit, slips back.
&scene gravity=0,-9.81 /
&body name='belt' mass=5 inertia=1 velocity=0.1,0 /
&body name='block' mass=1 inertia=0.1 position=0.02,0 velocity=-0.1,0 /
&joint name='rail' type='prismatic' body_a='belt' direction=0 /
&joint name='guide' type='prismatic' body_a='block' body_b='belt' direction=0 friction=0.2 friction_static=0.3 /
&spring name='k' type='linear' body_a='block' body_b='ground' point_b=-0.5,0 stiffness=100 free_length=0.5 /
&history name='v' kind='polynomial' coefficients=0.1 /
&drive name='d' type='position' body_a='belt' direction=0 history='v' rate=.true. /
&sensor name='x' quantity='position' body='block' /
&periodic period_guess=0.8 moves_on='belt' /
&transient method='rk4' step=1e-3 /
"""


@pytest.mark.parametrize("speed", [-0.1, 0.1])
def test_stick_slip(run_deck, speed):
    """Period of stick-slip in closed form, from a start that slips and from one that sticks; nothing of a disturbance lives."""
    run = run_deck(BELT.replace("velocity=-0.1,0", f"velocity={speed},0"))
    lag = 0.1 * GRAVITY / 100  # what the spring gives way between static and kinetic limit
    slip = 2 * (math.pi - math.atan2(10 * lag, 0.1)) / 10
    assert abs(run.figures["periodic"]["period"] - (slip + 2 * lag / 0.1)) < 1e-9
    assert run.figures["periodic"]["largest_multiplier"] < 1e-6


# --- flexible links


def test_bending_rod(run_deck):
    """A slider-crank whose rod bends: variational DOP853 at 1e-11 of the linear equations with periodic coefficients."""
    run = run_deck(REFERENCE / "periodic_rod" / "deck.nml")
    slowest = -0.9184239365777669 + 0.23886829767452952j
    assert_multipliers(run, [slowest, slowest.conjugate()])
    first = {name: run.history[name][0] for name in ("mid.v", "mid.r", "slider.x", "motor.m")}
    assert abs(first["mid.v"] - 0.0026402136744060308) < 1e-9
    assert abs(first["mid.r"] + 0.0010438506449076913) < 1e-9
    assert abs(first["slider.x"] - 0.297329781480429) < 1e-9
    assert abs(abs(first["motor.m"]) - 1.2986985235807957) < 1e-6
    assert_repeats(run, 1e-6)  # accelerations of stiff modes
    periodic = run.figures["periodic"]
    assert periodic["turns_to_cycle"] <= 17  # running alone takes 480


ARM = """! A viscoelastic arm that turns at constant speed under its weight: linear with constant coefficients in its own axes.
&scene gravity=0,-9.81 /
&material name='soft' density=1200 young=2e9 ghm_alpha=0.4 ghm_zeta=1.2 ghm_omega=300 rayleigh_stiffness=2e-5 /
&section name='bar' shape='rectangle' width=0.01 height=0.008 /
&body name='arm' kind='beam' length=0.3 elements=2 material='soft' section='bar' reference='clamped' axial=.false. /
&joint name='shaft' type='revolute' body_a='arm' node_a=1 body_b='ground' point_b=0,0 /
&history name='spin' kind='polynomial' coefficients=40.0 /
&drive name='motor' type='rotation' body_a='arm' history='spin' rate=.true. /
&sensor name='tip' quantity='deflection' body='arm' node=3 /
"""


@pytest.fixture(scope="module")
def arm_poles(probe, tmp_path_factory):
    """The eigenvalues of the oracle's equations of the arm [1/s]."""
    arm = TurningArm(Twins(probe, tmp_path_factory.mktemp("arm"), ARM).oracle)
    return np.linalg.eigvals(arm.slopes())


@pytest.mark.parametrize(("method", "steps"), [("rk4", 4000), ("dopri5", 1000), ("radau", 1000)])
def test_turning_arm(run_deck, arm_poles, method, steps):
    """The multipliers of an arm with GHM terms are exp(lambda T), by each method."""
    period = 2 * math.pi / 40
    transient = f"&transient method='{method}' step={period / steps!r} output_step={period / 50!r} /\n"
    run = run_deck(ARM + f"&periodic period={period!r} multipliers=3 /\n" + transient)
    assert_multipliers(run, np.exp(arm_poles * period))


CONTROLLED = """! A mass on a spring that a controller leads along a sine, continuously or by samples.
&parameter name='T' value=0.5 /
&scene /
&body name='mass' mass=2 inertia=1 position=0,0 /
&joint name='rail' type='prismatic' body_a='mass' direction=0 /
&spring name='k' type='linear' body_a='mass' body_b='ground' point_b=-1,0 stiffness=50 damping=1 free_length=1 /
&history name='r' kind='sine' amplitude=0.1 frequency={1/T} /
&sensor name='x' quantity='position' body='mass' /
&sensor name='v' quantity='velocity' body='mass' /
&controller name='c' argument='x.x' history='r' kp=200 ki=300 kd=8 filter=0.01 SAMPLE/
&force name='f' type='force' body='mass' fx=1 controller='c' /
&periodic period={T} multipliers=4 /
&transient method='rk4' step=5e-4 output_step=1e-2 /
"""


def test_controller(run_deck):
    """Integral and filter of a PID controller are unknowns of the cycle."""
    run = run_deck(CONTROLLED.replace("SAMPLE", ""))
    filtered, mass = 0.01, 2.0
    matrix = np.array(  # x, v, integral, filter f: D = kd (e - f)/tau, e = -x
        [
            [0, 1, 0, 0],
            [(-50 - 200 - 8 / filtered) / mass, -1 / mass, 1 / mass, -8 / filtered / mass],
            [-300, 0, 0, 0],
            [-1 / filtered, 0, 0, -1 / filtered],
        ]
    )
    expected = np.exp(np.linalg.eigvals(matrix) * 0.5)
    assert_multipliers(run, expected[np.abs(expected) > 1e-6])
    assert_repeats(run)


def test_sampled_controller(run_deck):
    """The same by samples: the map of a sample to the power of their number."""
    run = run_deck(CONTROLLED.replace("SAMPLE", "sample=0.025 "))
    hold = expm(np.array([[0, 1, 0], [-25, -0.5, 0.5], [0, 0, 0]]) * 0.025)[:2]
    tau, h = 0.01, 0.025
    error = np.array([-1.0, 0, 0, 0])  # of x, v, integral, filter
    integral = np.array([0, 0, 1.0, 0]) + h * 300 * error
    change = 8 / (tau + h) * (error - np.array([0, 0, 0, 1.0]))
    smooth = (tau * np.array([0, 0, 0, 1.0]) + h * error) / (tau + h)
    output = 200 * error + np.array([0, 0, 1.0, 0]) + change
    sample = np.vstack([hold @ np.vstack([np.eye(4)[:2], output]), integral, smooth])
    expected = np.linalg.eigvals(sample) ** 20
    assert_multipliers(run, expected[np.abs(expected) > 1e-6])
    assert_repeats(run)
    fault = run_deck(CONTROLLED.replace("SAMPLE", "sample=0.03 "), expect=2)
    assert "has 16.667 samples" in fault.stderr


# --- what is refused or told

GROWING = """&force name='c' body='ball' fx=0 /
&force name='g' body='ball' fx=1 history='grows' /
&history name='grows' coefficients=0,1 /
&periodic """
IN_A_FACTOR = """&force name='g' body='ball' fx=1 history='both' /
&history name='both' kind='product' histories='along','late' /
&history name='along' coefficients=1,1 argument='z.y' /
&history name='late' kind='sine' amplitude=1 frequency=7 /
&periodic """


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("&periodic period={T} ", "&periodic period={T} period_guess=1 "), "are both given"),
        (("&periodic period={T} ", "&periodic "), "period is missing, expected period or period_guess"),
        (("&periodic period={T} ", "&periodic period={1.5*T} "), "does not repeat in the period of the cycle, 0.15 s"),
        (("&periodic period={T} ", "&periodic period_guess={T} "), "depends on time"),
        (("method='rk4'", "method='generalized_alpha'"), "wrong phases"),
        (("method='rk4'", "method='rk4' stabilization='none'"), "expected 'projection'"),
        (("&transient method='rk4' step={T/500} output_step={T/50} /", ""), "expected &transient"),
        (("multipliers=2", "moves_on='tabel'"), "did you mean"),
        (("&periodic ", GROWING), 'force/g: history "grows" does not repeat'),
        (("&periodic ", IN_A_FACTOR), 'force/g: history "late" does not repeat'),
    ],
)
def test_refused(run_deck, change, words):
    """Faults of the deck, with their lines."""
    run = run_deck(BALL.replace(*change), expect=2)
    assert words in run.stderr, run.stderr
    assert not run.folder.exists()


def test_a_fast_history_repeats(run_deck):
    """Rounding of times near 1 s, 1e-16 s, moves a history of 1e8 periods by more than a billionth."""
    deck = "&body name='b' mass=1 inertia=1 /\n&joint name='g' type='prismatic' body_a='b' /\n"
    deck += "&force name='f' body='b' fx=1 history='h' /\n&history name='h' kind='sine' amplitude=1 frequency={} /\n"
    deck += "&spring name='k' body_a='b' stiffness=4 damping=0.1 /\n&transient step=0.01 t_end=1 /\n&periodic period=1 /\n"
    run_deck(deck.format("1.1e8"), "--check")
    assert "does not repeat" in run_deck(deck.format("1.5"), "--check", expect=2).stderr


def test_no_cycle(run_deck):
    """A body that falls for ever repeats in no sense; one that drifts is named with its way."""
    deck = "&scene gravity=0,-9.81 /\n&body name='stone' mass=1 inertia=1 /\n&sensor name='s' quantity='position' body='stone' /\n"
    run = run_deck(deck + "&periodic period=0.5 /\n&transient method='rk4' step=0.01 /\n", expect=1)
    assert "no cycle was found" in run.stderr
    assert 'body "stone"' in run.stderr
    assert not (run.folder / "floquet.txt").exists()
    pushed = SLIDER.replace(" friction=0.1", "").replace(" multipliers=2", " most_turns=9")  # without its spring
    pushed = "".join(line for line in pushed.splitlines(keepends=True) if "&spring" not in line)
    way = (0.8 + 30 / 14) * 2 * math.pi / 14
    assert f"it is {way:.3E} m farther on after a period" in run_deck(pushed, expect=1).stderr
    drifting = BELT.replace("moves_on='belt'", "").replace("period_guess=0.8", "period=0.8")
    run = run_deck(drifting, expect=1)
    assert 'the x of body "belt"' in run.stderr
    assert "moves_on='belt'" in run.stderr


def test_rattling(run_deck):
    """A pin that rattles in its hole comes to no cycle: its name, and the time of an event that changes."""
    deck = (ROOT / "input" / "clearance_slider_crank.nml").read_text(encoding="utf-8").split("&transient")[0]
    deck = deck.replace("stiffness=6.6e10", "stiffness=1e6")
    run = run_deck(
        deck + "&periodic period={2*pi/314.1592653589793} most_turns=12 /\n&transient method='rk4' step=1e-4 /\n", expect=1
    )
    assert "no cycle was found" in run.stderr
    assert 'events of "pin" at t = ' in run.stderr


def test_rest_is_no_cycle(run_deck):
    """With an unknown period a rest would repeat after any time."""
    deck = ROTOR.replace("angular_velocity=20", "angle=-1.5").replace("moment=1.0", "moment=0.1")
    deck = deck.replace("damping=0.05", "damping=0.2")
    run = run_deck(deck, expect=1)
    assert "rest" in run.stderr


ENGINE = """! An engine whose rail rubs: gas force over the angle, load over the speed. Two states are free.
&scene gravity=0,-9.81 /
&body name='crank' mass=3 inertia=0.02 angular_velocity=60 angle=0.2 /
&body name='rod' mass=0.4 inertia=1e-3 com=0.07,0 angle={-asin(0.04*sin(0.2)/0.15)} position={0.04*cos(0.2)},{0.04*sin(0.2)} /
&body name='piston' mass=0.4 inertia=1e-4 position={0.04*cos(0.2)+sqrt(0.15^2-(0.04*sin(0.2))^2)},0 /
&joint name='o' type='revolute' body_a='crank' point_a=0,0 /
&joint name='a' type='revolute' body_a='rod' point_a=0,0 body_b='crank' point_b=0.04,0 /
&joint name='b' type='revolute' body_a='piston' point_a=0,0 body_b='rod' point_b=0.15,0 /
&joint name='c' type='prismatic' body_a='piston' direction=0 friction=0.05 /
&sensor name='phi' quantity='angle' body='crank' /
&sensor name='w' quantity='angular_velocity' body='crank' /
&history name='gas' kind='table' periodic=.true. interpolation='pchip' time=0,0.3,1.5,{pi},{2*pi-1},{2*pi}
  value=-2000,-2500,-600,-100,-300,-2000 /
&force name='g' type='force' body='piston' fx=1 history='gas' argument='phi' /
&history name='load' kind='polynomial' coefficients=0,0,-2e-3 /
&force name='l' type='torque' body='crank' moment=1 history='load' argument='w' /
&periodic period_guess=0.1 multipliers=6 /
&transient method='rk4' step=2e-4 output_step=1e-3 /
"""


def test_few_freedoms(run_deck):
    """A force that is in a piece of its table remembers nothing; no direction is left after those of the freedoms."""
    run = run_deck(ENGINE)
    assert_multipliers(run, 0.29846979)  # the other one belongs to time; dense differences of runs of dopri5 to 1e-12
    assert abs(run.history["w"][-1] - run.history["w"][0]) < 1e-8


CART = """! A cart with a rotor that is off its centre: both move on, the rotor's angle repeats under its weight.
&scene gravity=0,-9.81 /
&body name='cart' mass=3 inertia=1 velocity=0.5,0 /
&body name='rotor' mass=0.5 inertia=0.001 angular_velocity=30 com=0.05,0 /
&joint name='rail' type='prismatic' body_a='cart' direction=0 /
&joint name='pin' type='revolute' body_a='rotor' point_a=0,0 body_b='cart' point_b=0,0 /
&sensor name='v' quantity='velocity' body='cart' /
&sensor name='w' quantity='angular_velocity' body='rotor' body_b='cart' /
&history name='mot' kind='polynomial' coefficients=0.9,-0.03 /
&force name='m' type='torque' body='rotor' moment=1 history='mot' argument='w' /
&history name='drag' kind='polynomial' coefficients=2,-4,0,-0.5 /
&force name='d' type='force' body='cart' fx=1 history='drag' argument='v.x' /
&periodic period_guess=0.2 moves_on='cart','rotor' angle_repeats='rotor' /
&transient method='rk4' step=5e-4 /
"""


def test_vehicle(run_deck):
    """Where a body moves on only its angle may have to repeat: a cycle in which its rates alone repeat is none."""
    run = run_deck(CART)
    assert run.figures["periodic"]["turns_to_cycle"] <= 12
    mass, inertia, arm, both = 0.5, 0.00225, 0.05, 3.5

    def slope(angle, y):  # speed of the cart, rate of the rotor, time
        v, w, _ = y
        motor, s, c = 0.9 - 0.03 * w, math.sin(angle), math.cos(angle)
        drag = 2 - 4 * v - 0.5 * v**3
        matrix = [[both, -mass * arm * s], [-mass * arm * s, inertia]]
        rates = np.linalg.solve(matrix, [drag + mass * arm * c * w**2, motor - mass * GRAVITY * arm * c])
        return [*(rates / w), 1 / w]

    def turn(v, w):
        return solve_ivp(slope, (0, 2 * math.pi), [v, w, 0], method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]

    cycle = root(lambda x: turn(*x)[:2] - x, [0.5, 25.0], tol=1e-12).x
    assert abs(run.figures["periodic"]["period"] - turn(*cycle)[2]) < 1e-9
    steps = np.diag([1e-4, 1e-2])
    slopes = np.array([(turn(*(cycle + d)) - turn(*(cycle - d)))[:2] / (2 * d.sum()) for d in steps]).T
    assert_multipliers(run, np.linalg.eigvals(slopes))
    wrong = run_deck(CART.replace("angle_repeats='rotor'", ""), expect=1)
    assert "the rates repeat, but the motion does not" in wrong.stderr


def test_contact_with_memory(run_deck):
    """A compliant stop that is touched at t = 0 has a force which the state does not tell."""
    deck = OSCILLATOR.replace("position=0.03,0 velocity=0.9,0", "position=0.052,0 velocity=0.1,0").replace(
        "restitution=0.7", "restitution=0.7 stiffness=2e4"
    )
    for phase in np.arange(0.0, 6.2, 0.3):  # the contact takes 1/60 of a period: some phase has it at t = 0
        run = run_deck(deck.replace("phase=0.2", f"phase={phase}").replace("stiffness=2e4", "stiffness=200"), expect=None)
        if run.status == 1:
            assert 'stop "s" is touched at t = 0' in run.stderr
            assert "the speed at touching" in run.stderr
            told = run_deck(deck.replace("phase=0.2", f"phase={phase}").replace("restitution=0.7 stiffness=2e4", "stiffness=200"))
            assert told.figures["periodic"]["residual"] < 1e-9
            return
    pytest.fail("no phase has the contact at t = 0")


@pytest.mark.parametrize("killed", [False, True])
def test_restart(run_deck, biela, tmp_path, killed):
    """A signal within the turns, or the end after a checkpoint of them, then --restart: the files of an undisturbed run."""
    deck = (REFERENCE / "periodic_rod" / "deck.nml").read_text(encoding="utf-8")
    interval = ("--set", "transient/checkpoint_interval=0.1") if killed else ()
    whole = run_deck(deck, *interval, "--output", "whole", name="rod")
    parts = tmp_path / "parts"
    moments = itertools.count(0.02, 0.02)  # of the search for the cycle one of them, on a fast machine and on a slow one [s]

    def interrupted():
        command = [str(biela), *interval, "--output", "parts", "rod.nml"]
        process = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True)
        if killed:
            wait_for(parts / "checkpoint", process)
            process.kill()
            process.communicate()
            return not (parts / "history.txt").exists() or None
        time.sleep(next(moments))
        process.send_signal(signal.SIGINT)
        told = process.communicate()[1]
        return told if process.returncode == 128 + signal.SIGINT and "turns" in told else None

    caught(interrupted)
    parts = run_deck(tmp_path / "rod.nml", *interval, "--restart", "--output", "parts")
    for name in ("history.txt", "floquet.txt", "energy.txt"):
        assert (whole.folder / name).read_bytes() == (parts.folder / name).read_bytes()
    assert whole.figures["periodic"] == parts.figures["periodic"]
    assert not (parts.folder / "checkpoint").exists()


def test_orbit(run_deck):
    """A cycle is the start of another one: of the same it is found in one turn; of a neighbour on the same branch."""
    first = run_deck(ROTOR, "--output", "first")
    again = run_deck(ROTOR, "--orbit", "first", "--output", "again")
    assert again.figures["periodic"]["turns_to_cycle"] == 1
    assert np.array_equal(again.history.data[0], first.history.data[0])
    stronger = run_deck(ROTOR.replace("moment=1.0", "moment=1.05"), "--orbit", "first", "--output", "stronger")
    assert stronger.figures["periodic"]["period"] < first.figures["periodic"]["period"]
    plain = ROTOR.replace("&periodic period_guess=0.3 /\n", "").replace("&transient", "&transient t_end=0.1")
    assert "is not the cycle of a deck" in run_deck(BALL, "--orbit", "first", "--output", "other", expect=2).stderr
    assert "with &periodic" in run_deck(plain, "--orbit", "first", expect=2).stderr


def test_errors_of_steps(run_deck, arm_poles):
    """With check_error the told errors of multipliers include those of the steps: true ones against the oracle."""
    period = 2 * math.pi / 40
    transient = f"&transient method='rk4' step={period / 1000!r} check_error=.true. /\n"
    run = run_deck(ARM + f"&periodic period={period!r} multipliers=2 /\n" + transient)
    true = np.abs(multipliers(run)[:, None] - np.exp(arm_poles * period)).min(axis=1)
    told = np.loadtxt(run.folder / "floquet.txt", ndmin=2)[:, 4]
    assert np.all(true > 1e-6)  # the steps' error is what is seen
    assert np.all(true < told)
    assert np.all(told < 100 * true)
    assert run.figures["periodic"]["steps"] == 2000
    exact = f"&periodic period={period!r} tolerance=1e-12 /\n&transient method='rk4' step={period / 8000!r} /\n"
    fine = run_deck(ARM + exact, "--output", "fine")
    for name, unit in (("tip.u", "m"), ("tip.v", "m"), ("tip.r", "rad")):
        told, off = (run.figures["periodic"]["errors_of_columns"][f"{name}[{unit}]"], run.history[name][0] - fine.history[name][0])
        assert abs(off) <= told + 1e-12


def test_accuracy(run_deck):
    """With accuracy alone biela chooses method and steps of the turns, too."""
    run = run_deck(ROTOR.replace("method='rk4' step=1e-3 output_step=1e-2", "accuracy=1e-5"))
    periodic = run.figures["periodic"]
    assert periodic["error"] < 1e-5
    assert abs(multipliers(run)[0] - math.exp(-0.05 * periodic["period"] / 0.0125)) < 1e-5
    exact = run_deck(ROTOR, "--output", "exact").figures["periodic"]["period"]
    assert abs(periodic["period"] - exact) < 1e-5 * exact


@pytest.mark.parametrize(("parts", "asked"), [(2, 8), (4, 16), (3, 5), (6, 4)])
def test_multipliers_of_like_parts_are_told_as_often_as_they_are_there(run_deck, parts, asked):
    """Equal oscillators and a softer one, driven together: each pair exp((-c/2 +- j w) T) as often as there are parts."""
    deck = "&history name='s' kind='sine' amplitude=1 frequency=1 /\n"
    expected = []
    for i in range(parts + 1):
        k, c = (90.0, 0.5) if i < parts else (40.0, 2.0)
        deck += f"&body name='b{i}' mass=1 inertia=1 position={2 * i},0 /\n"
        deck += f"&joint name='j{i}' type='prismatic' body_a='b{i}' point_b={2 * i},0 /\n"
        deck += f"&spring name='k{i}' type='linear' body_a='b{i}' point_b={2 * i - 1},0 stiffness={k} damping={c} free_length=1 /\n"
        deck += f"&force name='f{i}' body='b{i}' fx=1 history='s' /\n"
        expected += [np.exp(-c / 2 + sign * 1j * np.sqrt(k - c * c / 4)) for sign in (1, -1)]
    deck += f"&periodic period=1 multipliers={asked} /\n&transient method='rk4' step=2.5e-3 output_step=0.1 /\n"
    found = multipliers(run_deck(deck))
    assert len(found) == min(asked, 2 * parts + 2)
    assert all(min(abs(value - x) for x in expected) < 1e-6 for value in found)
    assert sum(abs(abs(found) - np.exp(-0.25)) < 1e-6) == min(asked, 2 * parts)


# --- verdicts and their errors


ROTOR_ON_SPRINGS = """! A rotor that turns steadily in a hub on springs: hub and lag angles of its two blades rest in the cycle.
&parameter name='W' value=45 /
&parameter name='lag' value=0 /
&parameter name='hub' value=0 /
&body name='cx' mass=0.5 inertia=0.01 /
&body name='cy' mass=1 inertia=0.01 /
&body name='hub' mass=4 inertia=0.1 angular_velocity={W} /
&body name='b0' mass=1 inertia=0.08 com=0.5,0 position=0.2,0 velocity=0,{0.2*W} angular_velocity={W} /
&body name='b1' mass=1 inertia=0.08 com=0.5,0 position=-0.2,0 velocity=0,{-0.2*W} angle={pi} angular_velocity={W} /
&joint name='h0' type='revolute' body_a='b0' body_b='hub' point_b=0.2,0 /
&joint name='h1' type='revolute' body_a='b1' body_b='hub' point_b=-0.2,0 /
&spring name='k0' type='torsional' body_a='b0' body_b='hub' stiffness=20 damping={lag} /
&spring name='k1' type='torsional' body_a='b1' body_b='hub' stiffness=20 damping={lag} free_angle={pi} /
&joint name='jx' type='prismatic' body_a='cx' direction=0 /
&joint name='jy' type='prismatic' body_a='cy' body_b='cx' direction={pi/2} /
&joint name='ax' type='revolute' body_a='hub' body_b='cy' /
&spring name='sx' body_a='cx' body_b='ground' point_b=-99,0 stiffness=3200 damping={hub} free_length=99 /
&spring name='sy' body_a='cy' body_b='cx' point_b=0,-99 stiffness=2500 damping={hub} free_length=99 /
&history name='w' coefficients={W} /
&drive name='spin' type='rotation' body_a='hub' history='w' rate=.true. /
&periodic period={2*pi/W} multipliers=8 /
&transient method='METHOD' step={2*pi/W/STEPS} /
"""


def rotor_multipliers(speed, lag, hub):
    """Return those of the rotor: Lagrange's equations, linear about the steady turn, over a period."""
    mass, inertia, pin, arm = 1.0, 0.08, 0.2, 0.5
    inert, damping = np.diag([7.5, 7.0, *2 * [mass * arm**2 + inertia]]), np.diag([hub, hub, lag, lag]) * 1.0
    stiffness = np.diag([3200.0, 2500.0, *2 * [20 + mass * arm * pin * speed**2]])

    def slope(t, y):
        m, c, k = inert.copy(), damping.copy(), stiffness.copy()
        for blade in range(2):
            angle = speed * t + np.pi * blade
            along, across = np.array([math.cos(angle), math.sin(angle)]), np.array([-math.sin(angle), math.cos(angle)])
            m[:2, 2 + blade] = m[2 + blade, :2] = mass * arm * across
            c[:2, 2 + blade] = -2 * mass * arm * speed * along
            k[:2, 2 + blade] = -mass * arm * speed**2 * across
        y = y.reshape(8, 8)
        return np.concatenate([y[4:], -np.linalg.solve(m, c @ y[4:] + k @ y[:4])]).ravel()

    end = solve_ivp(slope, (0, 2 * np.pi / speed), np.eye(8).ravel(), method="DOP853", rtol=1e-12, atol=1e-13)
    return np.linalg.eigvals(end.y[:, -1].reshape(8, 8))


@pytest.mark.parametrize(
    ("method", "steps", "speed", "lag", "hub"),
    [("rk4", 300, 90, 0.5, 5), ("dopri5", 150, 45, 0.5, 30), ("rk4", 150, 20, 0.5, 30), ("radau", 30, 30, 0.2, 5)],
)
def test_told_errors_where_coordinates_rest(run_deck, method, steps, speed, lag, hub):
    """Errors of multipliers are told within a factor of 10, so that what grows is unstable, and what falls is stable."""
    settings = [x for name, value in (("W", speed), ("lag", lag), ("hub", hub)) for x in ("--set", f"{name}={value}")]
    run = run_deck(ROTOR_ON_SPRINGS.replace("METHOD", method).replace("STEPS", str(steps)), *settings)
    expected = rotor_multipliers(speed, lag, hub)
    told = np.loadtxt(run.folder / "floquet.txt")[:, 4]
    true = np.abs(multipliers(run)[:, None] - expected).min(axis=1)
    assert len(told) == 8
    assert np.all(true < 1e-4)
    assert np.all(true < 10 * told)
    assert np.all(told < 10 * true + 1e-8)
    assert run.figures["periodic"]["stable"] is bool(np.abs(expected).max() < 1)


GROWING_LINE = """! A mass on a spring whose force along its speed feeds it, under a harmonic force.
&parameter name='c' value=-8 /
&parameter name='k' value=40 /
&parameter name='T' value=1 /
&body name='b' mass=1 inertia=1 VELOCITY/
&joint name='g' type='prismatic' body_a='b' /
&spring name='k' body_a='b' body_b='ground' point_b=-1e3,0 stiffness={k} free_length=1e3 /
&history name='feed' coefficients=0,{-c} /
&force name='n' body='b' fx=1 history='feed' argument='v.x' /
&history name='h' kind='sine' amplitude=1 frequency={1/T} /
&force name='f' body='b' fx=1 history='h' /
&sensor name='x' quantity='position' body='b' /
&sensor name='v' quantity='velocity' body='b' /
&periodic period={T} SETTINGS/
&transient TRANSIENT output_step={T/50} /
"""


def forced(c, k, period):
    """Return place and speed at t = 0 of x'' + c x' + k x = sin(2 pi t/period) as it repeats."""
    w = 2 * np.pi / period
    x = 1 / (k - w**2 + 1j * w * c)
    return x.imag, (1j * w * x).imag


def growing_line(transient, settings="", velocity=""):
    """Return the deck."""
    deck = GROWING_LINE.replace("TRANSIENT", transient).replace("SETTINGS", settings)
    return deck.replace("VELOCITY", velocity)


@pytest.mark.parametrize("velocity", ["", "velocity=1e2,0 "])
def test_unstable_cycle_of_a_linear_machine(run_deck, velocity):
    """A pair of multipliers of modulus e^4: plain turns lead away, the differences of as many as grow do not."""
    periodic = (run := run_deck(growing_line("method='rk4' step=1e-3", velocity=velocity))).figures["periodic"]
    assert run.history.data[0, [1, 3]] == pytest.approx(forced(-8, 40, 1), abs=1e-8)
    assert periodic["multipliers"][0]["growth"] == pytest.approx(4, abs=1e-7)
    assert periodic["stable"] is False


def test_slow_growth_is_growth(run_deck):
    """A modulus of 1.0005 is unstable: it is known to 1e-6, whatever the tolerance of the cycle."""
    run = run_deck(growing_line("accuracy=1e-3"), "--set", "c=-0.1", "--set", "k=4000", "--set", "T=0.01")
    periodic = run.figures["periodic"]
    assert periodic["largest_multiplier"] == pytest.approx(math.exp(0.0005), abs=1e-6)
    assert (periodic["stable"], periodic["stability"]) == (False, "unstable")


def test_scales_are_those_of_the_cycle(run_deck):
    """The first turn is much faster than the cycle: not that is what a loose tolerance is of."""
    deck = growing_line("method='rk4' step={T/200}", "tolerance=1e-3 ", "velocity=1e2,0 ")
    periodic = (run := run_deck(deck, "--set", "c=0.2", "--set", "k=100", "--set", "T=0.628")).figures["periodic"]
    start, speed = np.array(forced(0.2, 100, 0.628)), np.ptp(run.history["v.x"])
    assert np.abs(run.history.data[0, [1, 3]] - start) == pytest.approx(0, abs=1e-3 * speed / 10)
    assert periodic["start_kept"] is True
    assert periodic["multipliers_kept"] is True


@pytest.mark.parametrize(("asked", "kept"), [("1e-7", False), ("1e-4", True)])
def test_verdicts_on_start_and_multipliers(run_deck, asked, kept):
    """Each is held against what was asked, by an error that is true within a factor of 10."""
    deck = growing_line("method='rk4' step={T/50} check_error=.true.", f"tolerance={asked} ")
    periodic = (run := run_deck(deck, "--set", "c=0.2", "--set", "k=100", "--set", "T=0.628")).figures["periodic"]
    true = np.abs(run.history.data[0, [1, 3]] - forced(0.2, 100, 0.628)) / np.ptp(run.history.data[:, [1, 3]], axis=0)
    assert 0.1 < periodic["error"] / true.max() < 10
    assert periodic["start_kept"] is kept
    exact = np.exp(0.628 * np.roots([1, 0.2, 100]))
    true = max(np.abs(exact - value).min() for value in multipliers(run))
    assert 0.1 < max(one["error"] for one in periodic["multipliers"]) / true < 10
    assert periodic["multipliers_kept"] is bool(true < float(asked))
    assert ("not known to the" in run.stderr) is not kept


def test_a_family_of_cycles(run_deck):
    """Nothing damps a pendulum: two multipliers are 1, of which one belongs to time. Whether the cycle is stable no error tells."""
    run = run_deck(
        """&scene gravity=0,-9.81 /
&body name='b' mass=1 inertia=1e-9 com=0,-1 angle=1 /
&joint name='g' type='revolute' body_a='b' /
&periodic period_guess=2.1 /
&transient method='rk4' step=4e-3 output_step=0.1 /
"""
    )
    periodic = run.figures["periodic"]
    (left,) = periodic["multipliers"]
    assert 0.1 < left["error"] / abs(left["real"] + 1j * left["imag"] - 1) < 10
    assert (periodic["stable"], periodic["stability"], periodic["way"]) == (None, "not known", "jump")
    assert "one of a family" in (run.folder / "summary.txt").read_text()
    assert "whether the cycle is stable is not known" in run.stderr


CRANK = """! A pendulum that a driven crank shakes by a spring.
&scene gravity=0,-1 /
&body name='crank' mass=1 inertia=1 /
&body name='top' mass=1 inertia=1 com=0,1 /
&joint name='a' type='revolute' body_a='crank' /
&joint name='b' type='revolute' body_a='top' /
&history name='w' coefficients={2*pi} /
&drive name='motor' type='rotation' body_a='crank' history='w' rate=.true. /
&spring name='s' SPRING /
&periodic period_guess=0.99 /
&transient method='rk4' step=5e-3 output_step=0.1 t_end=1 /
"""
SHAKEN = "body_a='crank' point_a=0.07,0.07 body_b='top' point_b=0,0.5 stiffness=0.1 free_length=0"


def test_no_multiplier_belongs_to_time(run_deck):
    """The drive prescribes the period that was sought: a pair that is not 1 is told, as with the period."""
    run = run_deck(CRANK.replace("SPRING", SHAKEN))
    told = run.figures["periodic"]
    assert told["period"] == pytest.approx(1, abs=1e-9)
    assert told["stable"] is False
    given = run_deck(CRANK.replace("SPRING", SHAKEN).replace("period_guess=0.99", "period=1"), "--output", "given")
    assert multipliers(run) == pytest.approx(multipliers(given), abs=1e-6)
    assert multipliers(run)[0] == pytest.approx(math.exp(math.sqrt(0.5)), abs=2e-3)  # without the spring, which is soft


@pytest.mark.parametrize("other", ["body_b='top'", "body_b='ground'"])
def test_what_winds_up_is_no_cycle(run_deck, other):
    """Angles repeat up to whole turns, a torsional spring does not: its moment grows with each, on a body or on the drive alone."""
    deck = CRANK.replace("SPRING", f"type='torsional' body_a='crank' {other} stiffness=1 free_angle=0")
    deck += "&spring name='hold' type='torsional' body_a='top' stiffness=30 damping=3 free_angle=0 /\n"
    run = run_deck(deck.replace("period_guess=0.99", "period=1"), expect=1)
    assert "a turn repeats, but not the one after it" in run.stderr


@pytest.mark.parametrize("guess", [0.73, 1.5, 2.1])
def test_a_part_of_the_period(run_deck, guess):
    """From a guess of about once, twice and three times the period, that of the stick-slip all the same."""
    run = run_deck(BELT.replace("period_guess=0.8", f"period_guess={guess}"))
    lag = 0.1 * GRAVITY / 100
    period = 2 * (math.pi - math.atan2(10 * lag, 0.1)) / 10 + 2 * lag / 0.1
    assert run.figures["periodic"]["period"] == pytest.approx(period, abs=1e-9)


@pytest.mark.parametrize(
    ("period", "history", "words"),
    [
        ("period_guess=0.64", "kind='sine' amplitude=1 frequency=100", "depends on time"),
        ("period_guess=0.5", "kind='pulse' start=6.1 finish=6.5 value=3", "depends on time"),
        ("period=0.2", "kind='pulse' start=0.5 finish=0.6 value=10", "does not repeat"),
        ("period=0.2", "kind='product' histories='late','h'", "does not repeat"),
        ("period=0.2", "kind='sum' factors=1,1 histories='late','h'", "does not repeat"),
        ("period=0.2", "kind='sequence' histories='h','late' durations=4,4", "does not repeat"),
    ],
)
def test_histories_are_looked_at_to_their_ends(run_deck, period, history, words):
    """Also behind the first periods, and between points that a fast sine meets at the same phase."""
    deck = f"""&body name='b' mass=1 inertia=1 /
&joint name='g' type='prismatic' body_a='b' /
&spring name='k' body_a='b' body_b='ground' point_b=-10,0 stiffness=100 damping=1 free_length=10 /
&history name='h' kind='sine' amplitude=1 frequency=5 /
&history name='late' kind='pulse' start=3 finish=3.1 value=1 /
&history name='acts' {history} /
&force name='f' body='b' fx=1 history='acts' /
&periodic {period} /
&transient method='rk4' step=2e-3 output_step=0.1 /
"""
    assert words in run_deck(deck, "--check", expect=2).stderr
