"""Dry friction by explicit methods: exact and independent solutions, rest without creep, states that are found or refused."""

import re
from math import atan2, cos, hypot, pi, sin, tan

import numpy as np
import pytest
from scipy.integrate import solve_ivp

G = 9.81
INCLINE = """&scene gravity=0,-9.81 /
&body name='block' mass=2 inertia=0.1 position={cos(0.3)},{sin(0.3)} angle=0.3 /
&joint name='rail' type='prismatic' body_a='block' direction=0.3 friction=MU /
&spring name='s' body_a='block' point_b={-10*cos(0.3)},{-10*sin(0.3)} stiffness=50 free_length=10 /
&sensor name='x' quantity='distance' body='block' point=0,0 point_b={-10*cos(0.3)},{-10*sin(0.3)} /
&transient t_end=5 output_step=0.1 METHOD /
"""
PENDULUM = """&scene gravity=0,-9.81 /
&body name='rod' mass=1.6 inertia=0.05 position={0.35*sin(0.9)},{-0.35*cos(0.9)} angle=0.9 /
&joint name='pin' type='revolute' body_a='rod' point_a=0,0.35 friction=0.25 friction_static=0.3 pin_radius=0.025 /
&sensor name='a' quantity='angle' body='rod' /
&transient METHOD /
"""
BLOCK = """&scene gravity=0,-9.81 /
&body name='b' mass=2 inertia=0.1 /
&joint name='rail' type='prismatic' body_a='b' friction=0.2 FRICTION /
&history name='h' HISTORY /
&force name='f' type='force' body='b' point=0,0 fx=1 history='h' /
&sensor name='x' quantity='position' body='b' point=0,0 /
&transient METHOD /
"""
TURNING = 0.6283185307179586  # half swing of the block on the incline [s]


def events_of(run):
    """Return times and words of events.txt."""
    lines = (run.folder / "events.txt").read_text(encoding="utf-8").splitlines()
    found = [line.split() for line in lines if not line.startswith("#")]
    return np.array([float(words[0]) for words in found]), [words[1:4] for words in found]


@pytest.mark.parametrize(("method", "error"), [("method='dopri5' tolerance=1e-11", 3e-11), ("method='rk4' step=5e-3", 2e-7)])
def test_block_on_an_incline(method, error, run_deck):
    """Half swings about centres that friction shifts; it sticks at the seventh turning point."""
    run = run_deck(INCLINE.replace("MU", "0.2").replace("METHOD", method))
    times, words = events_of(run)
    assert times == pytest.approx(TURNING * np.arange(1, 8), abs=error)
    assert words[-1] == ["rail", "backward", "stuck"]
    assert run.history["x"][-1] - 10 == pytest.approx(-0.182276950856, abs=error)
    assert run.energy["dissipated"][-1] == pytest.approx(31.024345449663, abs=100 * error)
    assert np.ptp(run.history["x"][-6:]) == 0.0


def test_pendulum_with_pin_friction(run_deck):
    """By an independent program (DOP853, 1e-13): 22 events, the last one, the angle of rest and the loss."""
    run = run_deck(PENDULUM.replace("METHOD", "method='dopri5' tolerance=1e-11 t_end=16 output_step=0.5"))
    times, words = events_of(run)
    assert len(times) == 22
    assert times[:2] == pytest.approx([0.6980220667647676, 1.392174842450448], abs=1e-11)
    assert times[-1] == pytest.approx(14.855476719468, abs=1e-10)
    assert words[-1] == ["pin", "forward", "stuck"]
    assert run.history["a"][-1] == pytest.approx(0.007155215493, abs=1e-11)
    assert run.energy["dissipated"][-1] == pytest.approx(2.078582850690, abs=1e-10)


@pytest.mark.parametrize(("method", "order"), [("rk4", 4), ("dopri5", 5)])
def test_order_across_events(method, order, run_deck):
    """Times of three reversals, with steps that events cut anywhere."""
    exact = [0.6980220667647676, 1.392174842450448, 2.082843393737755]
    errors = []
    for step in (0.02, 0.01):
        words = f"method='{method}' step={step} t_end=2.4 output_step=0.4"
        errors.append(np.abs(events_of(run_deck(PENDULUM.replace("METHOD", words), name=f"h{step}"))[0][:3] - exact).max())
    assert order - 0.3 < np.log2(errors[0] / errors[1]) < order + 1.2


def test_stick_and_slip_on_a_belt(run_deck):
    """Slip (pi + 2 atan2(v/omega, a))/omega, stick 2 a/v with a = (mu_s - mu_k) m g/k."""
    run = run_deck("""&scene gravity=0,-9.81 /
&body name='belt' mass=1 inertia=1 velocity=0.1,0 /
&body name='m' mass=1 inertia=1 velocity=0.1,0 /
&joint name='guide' type='prismatic' body_a='belt' /
&joint name='rub' type='slider' body_a='m' point_a=0,0 body_b='belt' point_b=0,0 friction=0.3 friction_static=0.4 /
&drive name='d' type='position' body_a='belt' point_a=0,0 history='v' rate=.true. /
&history name='v' kind='polynomial' coefficients=0.1 /
&spring name='s' type='linear' body_a='m' point_a=0,0 point_b=-10,0 stiffness=100 free_length=10 /
&transient method='dopri5' tolerance=1e-11 t_end=4 output_step=0.1 /
""")
    times, words = events_of(run)
    omega, a = 10.0, 0.1 * G / 100
    slip, stick = (pi + 2 * atan2(0.1 / omega, a)) / omega, 2 * a / 0.1
    assert slip + stick == pytest.approx(0.669357062343, abs=1e-12)
    expected = 0.3924 + np.ravel([[k * (slip + stick), k * (slip + stick) + slip] for k in range(6)])
    assert times == pytest.approx(expected[: len(times)], abs=1e-10)
    assert [word[1:] for word in words[:2]] == [["stuck", "backward"], ["backward", "stuck"]]


KLEIN = """&parameter name='mu' value=0 /
&parameter name='v' value=1 /
&body name='b1' mass=1.5 inertia=0.1 velocity={v},0 /
&body name='b2' mass=0.8 inertia=0.1 position={cos(0.9)},{sin(0.9)} velocity={v},0 /
&joint name='rail1' type='prismatic' body_a='b1' friction={mu} friction_static={1.5*mu} /
&joint name='rail2' type='prismatic' body_a='b2' point_b=0,{sin(0.9)} /
&joint name='link' type='distance' body_a='b1' point_a=0,0 body_b='b2' point_b=0,0 /
&force name='f1' type='force' body='b1' point=0,0 fx=3 /
&force name='f2' type='force' body='b2' point=0,0 fx=-1 /
&sensor name='a' quantity='acceleration' body='b1' point=0,0 /
&transient method='dopri5' tolerance=1e-8 t_end=1e-3 output_step=1e-3 /
"""


def test_blocks_on_parallel_rails(run_deck):
    """Accelerations on both sides; where (A) stops having one solution, to nine digits, the run stops and says so."""
    m1, m2, phi = 1.5, 0.8, 0.9
    limit = (m1 + m2) / (m2 * tan(phi))
    run_deck(KLEIN, "--set", f"mu={limit - 1e-9:.16g}", name="last")
    for v in (1, -1):
        for mu in (0.4, 1.2):
            run = run_deck(KLEIN, "--set", f"mu={mu}", "--set", f"v={v}", name=f"v{v}mu{mu}")
            # with the tension R of the link: m1 a = 3 + R cos - v mu sin |R|, m2 a = -1 - R cos
            for side in (1, -1):
                r = (-1 / m2 - 3 / m1) / (cos(phi) / m1 - v * mu * sin(phi) * side / m1 + cos(phi) / m2)
                if r * side > 0:
                    assert run.history["a.x"][0] == pytest.approx((-1 - r * cos(phi)) / m2, rel=1e-12)
        lost = run_deck(KLEIN, "--set", f"mu={1.1 * limit:.16g}", "--set", f"v={v}", expect=1, name=f"beyond{v}").stderr
        assert 'joint "rail1" at t = 0.000000E+00 s: its friction presses 1.100 times as hard as it brakes' in lost
        assert f"a friction below {limit:.3f}, or an elastic link, has one" in lost
        run_deck(KLEIN, "--set", f"mu={limit + 1e-9:.16g}", "--set", f"v={v}", expect=1, name=f"first{v}")
    # at rest: two forces, of which one moves the block, and then the other would do as well
    push = ["--set", f"mu={1.1 * limit:.16g}", "--set", "v=0", "--set", "force/f1/fx=20"]
    assert 'joint "rail1" at t = 0.000000E+00 s: its friction presses 1.100' in run_deck(KLEIN, *push, expect=1, name="rest").stderr


PARALLELOGRAM = """&scene gravity=0,0 /
&parameter name='x' value={0.15*cos(0.8)} /
&parameter name='y' value={0.15*sin(0.8)} /
&body name='left' mass=1 inertia=0.02 position={x},{y} angle=0.8 velocity={-6*y},{6*x} angular_velocity=6 /
&body name='coupler' mass=1 inertia=0.02 position={0.25+2*x},{2*y} velocity={-12*y},{12*x} /
&body name='right' mass=1 inertia=0.02 position={0.5+x},{y} angle=0.8 velocity={-6*y},{6*x} angular_velocity=6 /
&joint name='A' type='revolute' body_a='left' point_a=-0.15,0 friction=0.2 pin_radius=0.01 /
&joint name='B' type='revolute' body_a='coupler' point_a=-0.25,0 body_b='left' point_b=0.15,0 friction=0.2 pin_radius=0.01 /
&joint name='C' type='revolute' body_a='coupler' point_a=0.25,0 body_b='right' point_b=0.15,0 friction=0.2 pin_radius=0.01 /
&joint name='D' type='revolute' body_a='right' point_a=-0.15,0 point_b=0.5,0 friction=0.2 pin_radius=0.01 /
&transient METHOD t_end=0.5 output_step=0.05 /
"""


def test_no_motion_through_a_change_point(run_deck):
    """Next to it the pins press harder than they brake: all methods say so, also where it is within a step that it begins."""
    for word in ("'rk4' step=1e-3", "'dopri5' tolerance=1e-8", "'radau' tolerance=1e-8", "'generalized_alpha' step=1e-3"):
        lost = run_deck(PARALLELOGRAM.replace("METHOD", f"method={word}"), name=word[1:4], expect=1).stderr
        assert "times as hard as it brakes" in lost
        assert "(Painleve)" in lost
        assert 0.38 < float(lost.split(" at t = ")[1].split()[0]) < 0.4


JAM = """&scene gravity=0,0 /
&parameter name='b' value={-asin(0.2*sin(0.6)/0.47)} /
&body name='crank' mass=1 inertia=0.02 com=0.1,0 angle=0.6 /
&body name='rod' mass=0.5 inertia=0.01 com=0.235,0 position={0.2*cos(0.6)},{0.2*sin(0.6)} angle={b} /
&body name='slider' mass=0.4 inertia=1e-3 position={0.2*cos(0.6)+0.47*cos(b)},0 /
&joint name='main' type='revolute' body_a='crank' friction=0.07 pin_radius=0.007 /
&joint name='big' type='revolute' body_a='rod' body_b='crank' point_b=0.2,0 /
&joint name='small' type='revolute' body_a='rod' point_a=0.47,0 body_b='slider' friction=0.26 pin_radius=0.015 preload=0.12 /
&joint name='rail' type='prismatic' body_a='slider' friction=0.42 /
&stop name='limit' type='rotation' body_a='crank' upper=1.2 restitution=0 /
&history name='turn' kind='sine' amplitude=5.2 frequency=2.8 phase=0.12 /
&force name='motor' type='torque' body='crank' moment=1 history='turn' /
&sensor name='crank' quantity='angle' body='crank' /
&transient METHOD t_end=0.3 output_step=0.01 /
"""


def test_breaks_away_after_a_load_has_passed_through_zero(run_deck):
    """A crank lies at its stop when the motor's moment turns back; it leaves when statics with all joints at their limits say so.

    The friction in the rail presses it harder than it brakes while the pin of the rod sticks.
    """
    psi = -np.arcsin(0.2 * sin(1.2) / 0.47)
    moment = pin = normal = 0.0
    for _ in range(200):
        along, turning = 0.42 * normal, 0.26 * 0.015 * pin + 0.12  # what opposes the slider's and the rod's motion
        normal = abs((turning / 0.47 - sin(psi) * along) / cos(psi))
        pin = hypot(along, normal)
        moment = 0.07 * 0.007 * pin + 0.2 * (cos(1.2) * normal + sin(1.2) * along)
    leaves = (pi + np.arcsin(moment / 5.2) - 0.12) / (2 * pi * 2.8)
    angles = []
    for word in ("'rk4' step=1e-3", "'rk4' step=5e-4", "'dopri5' tolerance=1e-8", "'radau' tolerance=1e-8"):
        run = run_deck(JAM.replace("METHOD", f"method={word}"), name=re.sub("[' =]", "", word))
        events = [line.split() for line in (run.folder / "events.txt").read_text().splitlines() if line[0] != "#"]
        away = [float(e[0]) for e in events if e[1] == "rail" and e[3] == "forward"]
        assert away == [pytest.approx(leaves, abs=1e-11)]
        struck = next(e[0] for e in events if e[1] == "limit")  # there all three joints with friction come to rest
        assert {e[1] for e in events if e[0] == struck and e[3] in ("stuck", "at_limit")} == {"main", "small", "rail"}
        angles.append(run.history["crank"][-1])
    assert angles == [pytest.approx(angles[-1], abs=1e-7)] * 4


CRANK = """&scene gravity=0,-9.81 /
&parameter name='b' value={-asin(0.15*sin(0.7)/0.4)} /
&body name='crank' mass=1.2 inertia=0.004 com=0.05,0 angle=0.7 angular_velocity=30 /
&body name='rod' mass=0.8 inertia=0.012 com=0.2,0 position={0.15*cos(0.7)},{0.15*sin(0.7)} angle={b} /
&body name='piston' mass=0.5 inertia=0.0004 position={0.15*cos(0.7)+0.4*cos(b)},0 /
&joint name='main' type='revolute' body_a='crank' friction=0.1 pin_radius=0.02 /
&joint name='big' type='revolute' body_a='rod' body_b='crank' point_b=0.15,0 friction=0.1 friction_static=0.15 pin_radius=0.015 /
&joint name='small' type='revolute' body_a='rod' point_a=0.4,0 body_b='piston' friction=0.1 friction_static=0.15 pin_radius=0.01 /
&joint name='rail' type='prismatic' body_a='piston' friction=0.2 friction_static=0.3 pad_distance=0.08 /
&sensor name='a' quantity='angle' body='crank' /
&sensor name='w' quantity='angular_velocity' body='crank' /
&sensor name='rail' quantity='reaction' joint='rail' /
&sensor name='main' quantity='reaction' joint='main' /
&transient METHOD /
"""


class SliderCrank:
    """The same in nine coordinates: mass centres and angles, all forces from one dense solve in each pass of the friction."""

    mass = np.array([1.2, 1.2, 0.004, 0.8, 0.8, 0.012, 0.5, 0.5, 0.0004])

    def __init__(self, side):
        """Directions of sliding of main, big, small and rail."""
        self.side = np.array(side)

    def forces(self, angle, rate):
        """Return q, v, accelerations and multipliers at a crank's angle and rate."""
        t = angle, -np.arcsin(0.15 * sin(angle) / 0.4)
        w = rate, -0.15 * cos(t[0]) * rate / (0.4 * cos(t[1]))
        e = [np.array([cos(x), sin(x)]) for x in t]
        n = [np.array([-sin(x), cos(x)]) for x in t]
        rows, right = np.zeros((8, 9)), np.zeros(8)

        def add(row, body, arm, sign):  # a point of crank or rod, at an arm along it from its mass centre
            rows[row : row + 2, 3 * body : 3 * body + 2] += sign * np.eye(2)
            rows[row : row + 2, 3 * body + 2] += sign * arm * n[body]
            right[row : row + 2] += sign * arm * w[body] ** 2 * e[body]

        add(0, 0, -0.05, 1)
        add(2, 1, -0.2, 1)
        add(2, 0, 0.1, -1)
        add(4, 1, 0.2, 1)
        rows[4:6, 6:8] = -np.eye(2)
        rows[6, 7] = rows[7, 8] = 1.0
        slide = np.zeros((4, 9))
        slide[0, 2] = slide[1, 5] = slide[2, 5] = slide[3, 6] = 1.0
        slide[1, 2] = slide[2, 8] = -1.0
        speed = 0.15 * rate * n[0] + 0.4 * w[1] * n[1]
        matrix = np.block([[np.diag(self.mass), rows.T], [rows, np.zeros((8, 8))]])
        weight = -G * self.mass * np.tile([0, 1, 0], 3)
        inverse = np.linalg.inv(matrix)
        f = np.zeros(4)
        for _ in range(40):
            x = inverse @ np.concatenate([weight - slide.T @ f, right])
            m = x[9:]
            pins = [0.02 * hypot(m[0], m[1]), 0.015 * hypot(m[2], m[3]), 0.01 * hypot(m[4], m[5])]
            pads = [abs(m[6]) / 2 + s * m[7] / 0.08 * np.sign(m[6]) for s in (1, -1)]
            new = self.side * np.array([*(0.1 * np.array(pins)), 0.2 * sum(np.abs(pads))])
            if np.abs(new - f).max() < 1e-14:
                break
            f = new
        return x, m, f, np.array([rate, w[1] - rate, w[1], speed[0]])


def test_reactions_that_pass_through_zero_are_rounding_there(run_deck):
    """A beam shakes on its rail: where the rail's reaction passes through zero, what is left of it is rounding.

    The motion is one whatever the rail's direction.
    """
    deck = """&material name='m' density=1100 young=1e9 /
&section name='s' shape='rectangle' width=0.02 height=0.008 /
&body name='b' kind='beam' length=0.2 elements=2 angle={angle} material='m' section='s' /
&joint name='j' type='prismatic' body_a='b' node_a=1 direction={{{angle}+1.2}} friction=0.25 /
&force name='f' type='torque' body='b' node=-1 moment=0.02 /
&sensor name='d' quantity='deflection' body='b' node=-1 /
&sensor name='slip' quantity='friction' joint='j' /
&transient step=2e-5 t_end=0.02 output_step=1e-2 /
"""
    first, *others = [run_deck(deck.format(angle=x)).history for x in np.arange(8) / 4]
    for other in others:
        for name in ("d.r", "slip.rate", "slip.f"):
            np.testing.assert_allclose(other[name], first[name], rtol=0, atol=1e-3 * np.ptp(first[name]))


def test_slider_crank_with_friction_in_four_joints(run_deck):
    """Against independent equations up to the third event; then all joints come to rest and share the load."""
    run = run_deck(CRANK.replace("METHOD", "method='dopri5' tolerance=1e-11 t_end=0.12 output_step=0.01"))
    times, words = events_of(run)
    state, start, side = [0.7, 30.0], 0.0, [1, -1, -1, -1]
    found, angles = [], []
    while len(found) < 2:
        crank = SliderCrank(side)

        def sliding(_, y, crank=crank):
            return (crank.forces(y[0], y[1])[3] * crank.side)[2:].min()

        sliding.terminal, sliding.direction = True, -1
        part = solve_ivp(
            lambda _, y, crank=crank: [y[1], crank.forces(y[0], y[1])[0][2]],
            (start, 0.12),
            state,
            "DOP853",
            rtol=1e-10,
            atol=1e-12,
            events=sliding,
            max_step=5e-3,
            dense_output=True,
        )
        angles += [part.sol(t)[0] for t in run.history["t"] if start <= t < part.t[-1]]
        which = 2 + np.argmin(np.abs(crank.forces(*part.y[:, -1])[3][2:]))
        found.append(part.t[-1])
        side[which] = -side[which]
        start, state = part.t[-1], part.y[:, -1]
    assert times[:2] == pytest.approx(found, abs=1e-9)
    assert [word[0] for word in words[:2]] == ["small", "rail"]
    assert run.history["a"][: len(angles)] == pytest.approx(angles, abs=1e-8)
    _, m, f, _ = SliderCrank([1, -1, -1, -1]).forces(0.7, 30.0)
    assert run.history["rail.fx"][0] == pytest.approx(-f[3], rel=1e-10)
    assert run.history["rail.fy"][0] == pytest.approx(-m[6], rel=1e-10)
    assert run.history["main.m"][0] == pytest.approx(-f[0], rel=1e-10)


def test_crank_turns_back_with_friction_in_four_joints(run_deck):
    """Where a spring turns it back, all joints stand for an instant: each slips backward from there, and energy balances."""
    deck = """&scene gravity=0,-9.81 /
&body name='crank' mass=0.5 inertia=0.001 angle=2.31154 position={0.0546*cos(2.31154)},{0.0546*sin(2.31154)}
  angular_velocity=-22.8 /
&body name='rod' mass=0.3 inertia=0.003 angle=-0.3566 position=0.0314,0.0414 /
&body name='slide' mass=0.447 inertia=0.0004 position=0.136,0.00231 /
&joint name='main' type='revolute' body_a='crank' point_a=-0.0546,0 friction=0.308 pin_radius=0.0106 /
&joint name='big' type='revolute' body_a='rod' point_a=-0.112,0 body_b='crank' point_b=0.0546,0
  friction=0.4 friction_static=0.6 pin_radius=0.005 /
&joint name='small' type='revolute' body_a='rod' point_a=0.112,0 body_b='slide'
  friction=0.0524 friction_static=0.0581 pin_radius=0.0083 /
&joint name='rail' type='prismatic' body_a='slide' point_b=0,0.00231 friction=0.125 friction_static=0.194 pad_distance=0.08 /
&spring name='k' type='linear' body_a='slide' point_b=0.6,0.1 stiffness=175 damping=0.35 free_length=0.3 /
&sensor name='w' quantity='angular_velocity' body='crank' /
&transient t_end=0.4 method='dopri5' tolerance=1e-9 /
"""
    run = run_deck(deck)
    times, words = events_of(run)
    turn = int(np.argmax(np.diff(times) == 0))
    assert sorted(word[0] for word in words[turn : turn + 4]) == ["big", "main", "rail", "small"]
    assert all({word[1], word[2]} == {"forward", "backward"} for word in words[turn : turn + 4])
    assert np.abs(run.energy["residual"]).max() < 1e-8 * run.energy["kinetic"].max()
    before = run.history["t"] < times[turn]
    assert (run.history["w"][before] < 0).all()
    assert (run.history["w"][~before][1:] > 0).all()


def test_mechanism_at_rest_stays_for_an_hour(run_deck):
    """It comes to rest in several joints at once; not a digit moves in an hour, by steps of any kind."""
    deck = CRANK.replace("angular_velocity=30", "angular_velocity=1")
    for method in ("method='dopri5' tolerance=1e-4", "method='rk4' step=2.0 accept_unstable=.true."):
        first = deck.replace("friction=0.1", "friction=0.1 preload=1.0").replace("angular_velocity=1", "angular_velocity=0")
        run = run_deck(first.replace("METHOD", f"{method} t_end=3600 output_step=100"), name=method[8:11])
        assert np.ptp(run.history["a"]) < 1e-14
        assert not events_of(run)[1]
        assert abs(run.history["rail.fy"]).min() > 0.0
    run = run_deck(deck.replace("METHOD", "method='dopri5' tolerance=1e-6 t_end=3 output_step=0.1"), name="stops")
    assert sorted(word[0] for word in events_of(run)[1][-4:]) == ["big", "main", "rail", "small"]
    assert events_of(run)[1][-1][2] == "stuck"
    assert np.ptp(run.history["a"][-3:]) < 1e-15


@pytest.mark.parametrize("method", ["method='dopri5' tolerance=1e-10", "method='rk4' step=1e-2"])
def test_loads_that_vary_and_jump(method, run_deck):
    """Breakaway at 6 sin(2 pi t) = mu_s m g; a load that jumps at t = 1.013, one at the limit, one beyond it within a step."""
    run = run_deck(
        BLOCK.replace("FRICTION", "friction_static=0.25")
        .replace("HISTORY", "kind='sine' amplitude=6 frequency=1")
        .replace("METHOD", f"{method} t_end=1 output_step=0.05"),
        name="varies",
    )
    times, words = events_of(run)
    assert times[0] == pytest.approx(np.arcsin(0.25 * 2 * G / 6) / (2 * pi), abs=1e-9)
    assert words[0] == ["rail", "stuck", "forward"]
    run = run_deck(
        BLOCK.replace("FRICTION", "friction_static=0.25")
        .replace("HISTORY", f"kind='sine' amplitude={0.25 * 2 * G * 1.004!r} frequency=1 phase=0.157")
        .replace("METHOD", f"{method} t_end=0.3 output_step=0.05"),
        name="dips",
    )
    assert events_of(run)[0][0] == pytest.approx((np.arcsin(1 / 1.004) - 0.157) / (2 * pi), abs=1e-9)
    run = run_deck(
        BLOCK.replace("FRICTION", "")
        .replace("HISTORY", "kind='pulse' value=6 start=1.013 finish=1.513")
        .replace("METHOD", f"{method} t_end=3 output_step=0.05"),
        name="jumps",
    )
    speed = 0.5 * (6 - 0.4 * G) / 2
    assert events_of(run)[0] == pytest.approx([1.013, 1.513 + speed / (0.2 * G)], abs=1e-9)
    assert run.history["x.x"][-1] == pytest.approx(speed * (0.25 + speed / (0.4 * G)), abs=1e-9)
    load = 0.4 * G  # exactly at the limit
    for name, value in (("at", load), ("above", load * (1 + 1e-9))):
        deck = BLOCK.replace("FRICTION", "").replace("HISTORY", f"kind='polynomial' coefficients={value!r}")
        x = run_deck(deck.replace("METHOD", f"{method} t_end=1 output_step=0.5"), name=name).history["x.x"]
        assert (np.abs(x).max() == 0.0) == (name == "at")


def test_a_preload_that_holds_more_than_it_brakes(run_deck):
    """A force that grows by 10 N/s breaks a preload of 5 N, which then brakes with 2 N: m x'' = 10 t - 2."""
    deck = BLOCK.replace("gravity=0,-9.81", "").replace("friction=0.2 FRICTION", "preload=2 preload_static=5")
    deck = deck.replace("HISTORY", "coefficients=0,10").replace("METHOD", "method='rk4' step=1e-2 t_end=1 output_step=0.1")
    run = run_deck(deck)
    times, words = events_of(run)
    assert [w[2] for w in words] == ["forward"]
    assert times[0] == pytest.approx(0.5, abs=1e-11)
    t = 0.5
    way = 10 * (1 - t**3) / 6 - (1 - t**2) - (5 * t**2 - 2 * t) * (1 - t)
    assert run.history["x.x"][-1] == pytest.approx(way / 2, abs=1e-11)


def test_a_pin_that_locks_by_itself_is_told(run_deck):
    """Only where the static friction's arm is beyond those of all forces on a body that no moment turns."""
    deck = """&body name='rod' mass=0.2 inertia=2e-4 com=0.05,0 /
&body name='wheel' mass=1 inertia=0.1 position=1,0 angular_velocity=9 /
&joint name='pin' type='revolute' body_a='rod' friction=0.1 friction_static=STATIC pin_radius=0.25 /
&joint name='axle' type='revolute' body_a='wheel' point_b=1,0 friction=0.2 pin_radius=0.02 /
&force name='f' body='rod' point=0.1,0 fy=1 /
OTHER
&transient t_end=1e-3 method='rk4' step=1e-4 /
"""
    torque = "&force name='t' type='torque' body='rod' moment=1 /"
    for static, other, told in (("0.41", "", True), ("0.39", "", False), ("0.41", torque, False)):
        run = run_deck(deck.replace("STATIC", static).replace("OTHER", other), "--check", name=f"d{static}{len(other)}")
        assert ('joint "pin" locks by itself' in run.stderr) == told
        assert '"axle"' not in run.stderr


def test_no_friction_is_none(run_deck):
    """Coefficients of zero make no row and the same bits; of 1e-12, columns that agree to 1e-9."""
    method = "METHOD", "method='rk4' step=1e-3 t_end=0.3 output_step=0.01"
    deck = PENDULUM.replace(*method)
    keys = "friction=0.25 friction_static=0.3 pin_radius=0.025"
    plain, none, little = (
        run_deck(deck.replace(keys, words), name=name)
        for name, words in (
            ("plain", ""),
            ("none", "friction=0 friction_static=0 pin_radius=0.025 preload=0"),
            ("little", "friction=1e-12 pin_radius=0.025"),
        )
    )
    assert np.array_equal(plain.history["a"], none.history["a"])
    assert not (none.folder / "events.txt").exists()
    assert little.history["a"] == pytest.approx(plain.history["a"], abs=1e-9)


def test_behind_a_drive_and_without_load(run_deck):
    """Beside a drive a joint slips with it and is unloaded while it rests; joints without load or with preload alone."""
    run = run_deck("""&scene gravity=0,-9.81 /
&body name='crank' mass=1 inertia=0.01 com=0.1,0 /
&joint name='main' type='revolute' body_a='crank' friction=0.3 pin_radius=0.02 /
&history name='h' kind='ramp' start_value=0 end_value=1 start=0.5 finish=1.0 /
&drive name='d' body_a='crank' history='h' /
&sensor name='d' quantity='reaction' drive='d' /
&transient method='dopri5' tolerance=1e-9 t_end=2 output_step=0.25 /
""")
    times, words = events_of(run)
    assert times == pytest.approx([0.5, 1.0], abs=1e-5)
    assert [word[1:] for word in words] == [["unloaded", "forward"], ["forward", "unloaded"]]
    assert run.history["d.m"][-1] == pytest.approx(0.1 * G * cos(1.0), rel=1e-9)
    run = run_deck(
        """&body name='b' mass=2 inertia=0.1 /
&body name='c' mass=2 inertia=0.1 position=1,0 angular_velocity=1 /
&body name='d' mass=2 inertia=0.1 position=0,1 angular_velocity=1 /
&joint name='rail' type='prismatic' body_a='b' friction=0.2 friction_static=0.25 /
&joint name='pin' type='revolute' body_a='c' body_b='b' point_b=1,0 friction=0.2 pin_radius=0.1 /
&joint name='tight' type='revolute' body_a='d' point_b=0,1 preload=0.05 /
&sensor name='c' quantity='angle' body='c' /
&sensor name='d' quantity='angle' body='d' /
&transient method='rk4' step=1e-2 t_end=3 output_step=0.5 /
""",
        name="none",
    )
    assert run.history["c"][-1] == pytest.approx(3.0, abs=1e-12)
    assert run.history["d"][-1] == pytest.approx(1.0, abs=1e-12)
    assert events_of(run)[0] == pytest.approx([2.0], abs=1e-12)


def test_redundant_joints_cannot_rub(run_deck):
    lost = run_deck(
        """&body name='b' mass=2 inertia=0.1 /
&joint name='one' type='prismatic' body_a='b' /
&joint name='two' type='prismatic' body_a='b' point_a=0.3,0 point_b=0.3,0 friction=0.1 /
&joint name='three' type='slider' body_a='b' point_a=0.1,0.5 point_b=0.1,0.5 direction=0.1 /
&transient t_end=1 /
""".replace("&joint name='three' type='slider' body_a='b' point_a=0.1,0.5 point_b=0.1,0.5 direction=0.1 /\n", ""),
        "--check",
        expect=2,
    ).stderr
    assert 'scene.nml:3: joint "two": its reaction is not determined by rigid-body mechanics' in lost
    assert "expected a flexible body in the loop" in lost


def test_held_means_that_shares_exist(run_deck):
    """Parallelograms at rest under a torque: held exactly while the four pins' static limits add up to it."""
    dice = np.random.default_rng(3)
    deck, expected = "&scene gravity=0,0 /\n", []
    for k in range(14):
        preload = dice.uniform(0.05, 1.0, 4)
        torque = dice.uniform(0.7, 1.3) * preload.sum() * dice.choice([-1, 1])
        expected.append(abs(torque) <= preload.sum())
        angle, x = dice.uniform(0.5, 2.5), 3.0 * k
        tip = f"{x + cos(angle):.17g},{sin(angle):.17g}"
        deck += f"&body name='l{k}' mass=1 inertia=0.1 position={x},0 angle={angle:.17g} /\n"
        deck += f"&body name='r{k}' mass=1 inertia=0.1 position={x + 1},0 angle={angle:.17g} /\n"
        deck += f"&body name='c{k}' mass=1 inertia=0.1 position={tip} /\n"
        ends = [("l", "0,0", "", f"{x},0"), ("r", "0,0", "", f"{x + 1},0"), ("c", "0,0", "l", "1,0"), ("c", "1,0", "r", "1,0")]
        for (body, at, other, there), p in zip(ends, preload, strict=True):
            second = f"body_b='{other}{k}'" if other else ""
            deck += f"&joint name='{body}{other}{k}' type='revolute' body_a='{body}{k}' point_a={at} {second} point_b={there} "
            deck += f"preload={p:.17g} /\n"
        deck += f"&force name='f{k}' type='torque' body='l{k}' moment={torque:.17g} /\n"
        deck += f"&sensor name='a{k}' quantity='angle' body='l{k}' /\n"
    run = run_deck(deck + "&transient method='dopri5' tolerance=1e-6 t_end=0.01 output_step=0.01 /\n")
    held = [np.ptp(run.history[f"a{k}"]) < 1e-14 for k in range(14)]
    assert held == expected
    assert 3 < sum(held) < 11
    unknown = [joint.get("undetermined", 0.0) for joint in run.transient["friction"]]
    assert unknown == pytest.approx(np.repeat(0.01 * np.array(held), 4), abs=1e-15)
    assert run.summary.count("its share of the load is not determined by rigid bodies") == 4 * sum(held)
    pins = [joint["name"] for joint in run.transient["friction"][:4]]
    light = re.sub("moment=.*", "moment=0.02 /", deck.split("&body name='l1'")[0])  # all hold: least shares, none at its limit
    light += "".join(f"&sensor name='on_{pin}' quantity='friction' joint='{pin}' /\n" for pin in pins)
    h = run_deck(light + "&transient method='dopri5' tolerance=1e-6 t_end=0.01 output_step=0.01 /\n", name="light").history
    assert all(0.0 < h[f"on_{pin}.share"].max() < 0.5 for pin in pins)


def test_a_mechanism_of_one_freedom_comes_to_rest_in_all_joints_at_once(run_deck):
    """A four-bar with friction in all four pins swings until it is held: none slides on while another one sticks."""
    deck = """&scene gravity=0,0.0 /
&body name='k' mass=1.160 inertia=0.0476 com=0.05955815156899498,0 angle=2.1110335979138943 angular_velocity=4.283 /
&body name='r' mass=0.598 inertia=0.0414 com=0.21053366643444674,0 position=-0.061266218210914984,0.10215255346487462
  angle=0.42628796752506065 /
&body name='s' mass=1.187 inertia=0.0119 com=0.16747213094993765,0 position=0.51150528841993548,0 angle=2.1717481189229817 /
&joint name='o' type='revolute' body_a='k' friction=0.084 pin_radius=0.020 preload=0.063 /
&joint name='p' type='revolute' body_a='r' body_b='k' point_b=0.11911630313798996,0 friction=0.206 pin_radius=0.024
  preload=0.035 /
&joint name='q' type='revolute' body_a='r' body_b='s' point_a=0.42106733286889347,0 point_b=0.33494426189987531,0
  friction=0.213 pin_radius=0.014 preload=0.096 /
&joint name='t' type='revolute' body_a='s' point_b=0.51150528841993548,0 friction=0.287 pin_radius=0.012 preload=0.076 /
&sensor name='w' quantity='angular_velocity' body='k' /
&transient t_end=2.0 output_step=0.01 method='dopri5' tolerance=TOLERANCE /
"""
    ends = []
    for tolerance in ("1e-9", "1e-10", "1e-11"):
        run = run_deck(deck.replace("TOLERANCE", tolerance), name=tolerance)
        times, words = events_of(run)
        assert {name for name, *_ in words[-4:]} == {"o", "p", "q", "t"}
        assert {after for *_, after in words[-4:]} <= {"stuck", "at_limit"}
        assert np.ptp(times[-4:]) < 1e-12
        assert np.abs(run.history["w"][run.history["t"] > times[-1]]).max() < 1e-13
        ends.append(times[-1])
    assert np.ptp(ends) < 1e-7


def chain(links, angle, friction, transient):
    """Return a deck of equal links with friction in each pin, let go from a straight line."""
    groups = ["&scene gravity=0,-9.81 /"]
    for k in range(links):
        at = f"{0.1 * k * cos(angle):.17g},{0.1 * k * sin(angle):.17g}"
        groups += [
            f"&body name='b{k}' mass=0.1 inertia=8e-5 com=0.05,0 position={at} angle={angle} /",
            f"&joint name='j{k}' type='revolute' body_a='b{k}'"
            + (f" body_b='b{k - 1}' point_b=0.1,0" if k else "")
            + f" friction={friction} pin_radius=0.01 /",
            f"&sensor name='f{k}' quantity='friction' joint='j{k}' /",
            f"&sensor name='w{k}' quantity='angular_acceleration' body='b{k}' /",
        ]
    return "\n".join([*groups, transient])


def test_long_chain_let_go(run_deck):
    """Sixty pins: each one's acceleration has the sign that its friction says, down to reactions that are rounding."""
    deck = chain(60, 0.0, 0.01, "&transient method='dopri5' tolerance=1e-6 t_end=1e-3 output_step=1e-3 /")
    h = run_deck(deck).history
    w = np.array([0.0] + [h[f"w{k}"][0] for k in range(60)])
    states = np.array([h[f"f{k}.state"][0] for k in range(60)])
    assert (states[:15] == np.sign(np.diff(w)[:15])).all()
    assert set(states[:15]) == {-1.0, 1.0}
    assert np.abs(np.diff(w)[states == 0]).max(initial=0) < 1e-8 * np.abs(w).max()
    assert (states * np.diff(w) >= -1e-9 * np.abs(w).max()).all()
    moves = [
        run_deck(chain(30, 0.0, 0.02, f"&transient {method} t_end=0.01 output_step=0.002 /"), name=name).history
        for name, method in (("d", "method='dopri5' tolerance=1e-9"), ("g", "method='generalized_alpha' step=0.001"))
    ]
    for k in range(0, 20, 5):  # short trial steps know rates badly: what they take for events changes nothing
        assert moves[1][f"w{k}"] == pytest.approx(moves[0][f"w{k}"], abs=1e-3 * np.abs(moves[0]["w0"]).max())
