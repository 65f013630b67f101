"""Dry friction by implicit methods, and in the other analyses: open scenes with known motion, orders, a flexible slider-crank."""

import numpy as np
import pytest

ANGLE = 0.3
RAIL = """&scene gravity=0.0,-9.81 /
&body name='block' mass=2.0 inertia=0.01 position={-6*cos(0.3)},{-6*sin(0.3)} angle=0.3 /
&joint name='rail' type='prismatic' body_a='block' direction=0.3 friction=0.2 /
&spring name='s' type='linear' body_a='block' point_b={-10*cos(0.3)},{-10*sin(0.3)} stiffness=50.0 free_length=3.0 /
&sensor name='x' quantity='position' body='block' /
&sensor name='v' quantity='velocity' body='block' /
&sensor name='rail' quantity='reaction' joint='rail' /
&sensor name='rub' quantity='friction' joint='rail' /
&transient t_end=5.0 output_step=0.01 method=METHOD /
"""
PENDULUM = """&scene gravity=0.0,-9.81 /
&body name='arm' mass=1.6 inertia=0.05 com=0.0,-0.35 angle=0.9 /
&joint name='pin' type='revolute' body_a='arm' friction=0.25 friction_static=0.3 pin_radius=0.025 /
&sensor name='a' quantity='angle' body='arm' /
&sensor name='pin' quantity='reaction' joint='pin' /
&sensor name='rub' quantity='friction' joint='pin' /
&transient t_end=16.0 output_step=0.1 method=METHOD /
"""
CRANK = """&scene gravity=0.0,-9.81 /
&material name='soft' density=1200.0 young=2.0e7 ghm_alpha=0.4 ghm_zeta=1.5 ghm_omega=150.0 /
&section name='bar' shape='rectangle' width=0.01 height=0.012 /
&body name='crank' mass=0.6 inertia=8.0e-4 com=0.02,0.0 angle=0.6 angular_velocity=1.5 /
&body name='rod' kind='beam' length=0.3 elements=2 material='soft' section='bar' axial=.false.
  position={0.08*cos(0.6)},{0.08*sin(0.6)} angle={-asin(0.08*sin(0.6)/0.3)} reference='pinned' /
&body name='piston' mass=0.4 inertia=2.0e-4 position={0.08*cos(0.6) + 0.3*cos(asin(0.08*sin(0.6)/0.3))},0.0 /
&joint name='bearing' type='revolute' body_a='crank' friction=0.2 friction_static=0.25 pin_radius=0.015 /
&joint name='crank_pin' type='revolute' body_a='rod' node_a=1 body_b='crank' point_b=0.08,0.0 friction=0.2 pin_radius=0.01 /
&joint name='piston_pin' type='revolute' body_a='rod' node_a=-1 body_b='piston' friction=0.2 pin_radius=0.01 /
&joint name='rail' type='prismatic' body_a='piston' friction=0.2 friction_static=0.25 /
&sensor name='crank' quantity='angular_velocity' body='crank' /
&sensor name='bend' quantity='deflection' body='rod' node=2 /
&sensor name='pin' quantity='reaction' joint='crank_pin' /
&sensor name='rub' quantity='friction' joint='rail' /
&transient t_end=0.25 output_step=0.005 method=METHOD /
"""


def events_of(run):
    """Return time and words of each line of events.txt."""
    lines = (run.folder / "events.txt").read_text(encoding="utf-8").splitlines()
    found = [line.split() for line in lines if not line.startswith("#")]
    return np.array([float(words[0]) for words in found]), [words[1:4] for words in found]


def slide(t):
    """Return way along the rail, velocity, friction on the block: half swings about centres that friction shifts."""
    omega, centre, shift = 5.0, -2.0 * 9.81 * np.sin(ANGLE) / 50.0, 0.2 * 2.0 * 9.81 * np.cos(ANGLE) / 50.0
    n = np.minimum(np.floor(t * omega / np.pi), 6)
    start = (1.0 - centre - shift) - 2 * n * shift  # amplitude of this half swing
    rests = t > 7 * np.pi / omega
    phase = np.where(rests, np.pi, omega * t - n * np.pi)
    sign = (-1.0) ** n
    x = centre + sign * (shift + start * np.cos(phase))
    return x, np.where(rests, 0.0, -sign * start * omega * np.sin(phase)), np.where(rests, 50.0 * (x - centre), sign * 50.0 * shift)


@pytest.mark.parametrize("method", ["'radau' tolerance=1e-10", "'generalized_alpha' step=1e-3"])
def test_block_on_a_rail_to_its_exact_motion(method, run_deck):
    run = run_deck(RAIL.replace("METHOD", method))
    goal = 1e-10 if "radau" in method else 1e-3
    times, words = events_of(run)
    assert np.abs(times - np.arange(1, 8) * np.pi / 5).max() < goal
    assert words[-1] == ["rail", "backward", "stuck"]
    h = run.history
    x, v, f = slide(h["t"])
    along = [np.cos(ANGLE), np.sin(ANGLE)]
    assert np.abs(h["x.x"] * along[0] + h["x.y"] * along[1] + 7.0 - x).max() < goal
    assert np.abs(h["v.x"] * along[0] + h["v.y"] * along[1] - v).max() < 10 * goal
    near = np.abs(h["t"][:, None] - times).min(1) < 1e-2
    assert np.abs(h["rub.f"] - f)[~near].max() < 50 * goal
    assert np.abs(h["rail.fx"] * along[0] + h["rail.fy"] * along[1] - h["rub.f"]).max() < 1e-12  # a reaction includes friction
    joint = run.transient["friction"][0]
    assert joint["slid"] == pytest.approx(31.024345449663 / (0.2 * 2.0 * 9.81 * np.cos(ANGLE)), rel=10 * goal)
    assert joint["lost"] == pytest.approx(31.024345449663, rel=10 * goal)
    assert (joint["sticks"], joint["slips"], joint["turns"]) == (1, 0, 6)
    assert joint["time_at_rest"] == pytest.approx(5.0 - 1.4 * np.pi, abs=goal)


def test_pendulum_with_pin_friction(run_deck):
    """By independent equations (DOP853 at 1e-13): 22 events, the last with angle and loss; at rest nothing creeps."""
    run = run_deck(PENDULUM.replace("METHOD", "'radau' tolerance=1e-10"))
    times, words = events_of(run)
    assert len(times) == 22
    assert words[-1][2] == "stuck"
    assert np.abs(times[[0, 1, -1]] - [0.6980220667647676, 1.392174842450448, 14.855476719467976]).max() < 1e-9
    h = run.history
    assert h["a"][-1] == pytest.approx(0.007155215492640, abs=1e-11)
    assert np.ptp(h["a"][h["t"] > 14.9]) < 1e-15
    assert run.transient["friction"][0]["lost"] == pytest.approx(2.078582850689869, rel=1e-9)
    assert h["rub.f"] == pytest.approx(h["pin.m"], abs=1e-12)


@pytest.mark.parametrize(("method", "order", "step"), [("radau", 5, 0.02), ("generalized_alpha", 2, 0.004)])
def test_order_between_and_across_events(method, order, step, run_deck):
    errors = []
    for h in (step, step / 2):
        run = run_deck(PENDULUM.replace("16.0", "2.4").replace("METHOD", f"'{method}' step={h}"), name=f"h{h}")
        errors.append(np.abs(events_of(run)[0][:3] - [0.6980220667647676, 1.392174842450448, 2.082843393737755]).max())
    assert order - 0.3 < np.log2(errors[0] / errors[1]) < order + 0.7


def test_flexible_slider_crank_by_explicit_and_implicit_steps(run_deck):
    """Friction in four joints, a viscoelastic rod: columns, and the sequence of events with their times."""
    explicit = run_deck(CRANK.replace("METHOD", "'dopri5' tolerance=1e-9"), name="explicit")
    implicit = run_deck(CRANK.replace("METHOD", "'radau' tolerance=1e-9"), name="implicit")
    (t, words), (s, others) = events_of(explicit), events_of(implicit)
    assert words == others
    assert len(words) > 5
    assert np.abs(t - s).max() < 1e-9
    for name in explicit.history.names[1:]:
        a, b = explicit.history[name], implicit.history[name]
        assert np.abs(a - b).max() <= 1e-7 * np.ptp(a), name
    assert implicit.transient["energy_balance"] < 1e-8


def test_newton_follows_the_pads_of_a_tilted_block(run_deck):
    """Normal forces of both pads, of opposite signs, follow the force: little more than an iteration a step."""
    deck = """&scene gravity=0,-9.81 /
&body name='block' mass=2 inertia=0.01 /
&joint name='rail' type='prismatic' body_a='block' friction=0.2 pad_distance=0.2 /
&spring name='k' type='linear' body_a='block' point_a=0.0,0.3 point_b=1.0,0.5 stiffness=2000 free_length=0.8 /
&transient t_end=0.2 method='generalized_alpha' step=2e-3 /
"""
    run = run_deck(deck)
    assert [word[0] for word in events_of(run)[1]] == ["rail"]
    assert run.transient["newton_iterations"] <= 1.5 * run.transient["steps"]


BEAM = """&scene gravity=0.0,0.0 /
&material name='m' density=1600.0 young=2.1e9 ghm_alpha=0.5 ghm_zeta=1.0 ghm_omega=800.0 /
&section name='s' shape='rectangle' width=0.02 height=0.01 /
&body name='b' kind='beam' length=0.4 elements=2 material='m' section='s' /
&joint name='pin' type='TYPE' body_a='b' node_a=1 /
&spring name='k' type='torsional' body_a='b' node_a=1 stiffness=20.0 /
&force name='load' type='force' body='b' node=-1 fy=1.0 history='wave' /
&history name='wave' kind='sine' amplitude=1.0 frequency=1.0 /
&sensor name='tip' quantity='position' body='b' node=-1 /
&sensor name='pin' quantity='reaction' joint='pin' /
&modal modes=3 WORD /
&frequency_response from=1.0 to=50.0 points=3 input='load' WORD /
"""


@pytest.mark.parametrize(("word", "like"), [("", "weld"), ("friction='free'", "revolute")])
def test_modes_and_responses_hold_what_sticks(word, like, run_deck):
    deck = BEAM.replace("type='TYPE'", "type='revolute' preload=1.0 friction=0.1 pin_radius=0.01")
    runs = [run_deck(deck.replace("WORD", word)), run_deck(BEAM.replace("TYPE", like).replace("WORD", ""), name="like")]
    for file in ("modes.txt", "frequency_response.txt"):
        values = [np.loadtxt(run.folder / file) for run in runs]
        assert values[0] == pytest.approx(values[1], rel=1e-9, abs=1e-9 * np.abs(values[1]).max())
    assert ("held_by_friction" in runs[0].figures["modes"]) == (like == "weld")


def test_statics_frees_friction_and_a_transient_is_held_there(run_deck):
    spring = "&spring name='k' type='torsional' body_a='arm' stiffness=2.0 free_angle=1.0 /\n&static /\n"
    run = run_deck(PENDULUM.replace("METHOD", "'radau' tolerance=1e-8").replace("16.0", "1.0") + spring)
    assert "this equilibrium is one of a set" in run.summary
    a = run.history["a"][0]
    assert 1.6 * 9.81 * 0.35 * np.sin(a) == pytest.approx(2.0 * (1.0 - a), rel=1e-9)
    assert np.ptp(run.history["a"]) < 1e-15
    assert len(events_of(run)[0]) == 0
    assert run.history["rub.share"].max() < 1e-9


def test_a_joint_without_friction_has_no_friction_to_measure(run_deck):
    run = run_deck(PENDULUM.replace("METHOD", "'rk4' step=0.01").replace("friction=0.25 friction_static=0.3 ", ""), expect=2)
    assert 'sensor/rub: joint "pin" has no friction' in run.stderr


TURNING_LOAD = """&scene gravity=0,0 /
&parameter name='b' value={-asin(0.2*sin(0.792)/0.5961)} /
&body name='crank' mass=1 inertia=0.02 com=0.1,0 angle=0.792 /
&body name='rod' mass=0.5 inertia=0.01 com=0.298,0 position={0.2*cos(0.792)},{0.2*sin(0.792)} angle={b} /
&body name='slider' mass=0.4 inertia=1e-3 position={0.2*cos(0.792)+0.5961*cos(b)},0 /
&joint name='main' type='revolute' body_a='crank' /
&joint name='big' type='revolute' body_a='rod' body_b='crank' point_b=0.2,0 /
&joint name='small' type='revolute' body_a='rod' point_a=0.5961,0 body_b='slider' friction=0.332 pin_radius=0.0189 /
&joint name='rail' type='prismatic' body_a='slider' friction=2.364 /
&history name='turn' kind='sine' amplitude=5.68 frequency=1.101 phase=2.855 /
&force name='motor' type='torque' body='crank' moment=1 history='turn' /
&sensor name='crank' quantity='angle' body='crank' /
&sensor name='rail' quantity='reaction' joint='rail' /
&transient METHOD t_end=0.06 output_step=1e-3 /
"""


def test_a_rail_whose_load_turns(run_deck):
    """The force across a rail passes through zero: a matrix with the old sign led to and fro, without end."""
    runs = [
        run_deck(TURNING_LOAD.replace("METHOD", f"method={word}"), name=word[1:4])
        for word in ("'radau' tolerance=1e-9", "'dopri5' tolerance=1e-11")
    ]
    assert runs[0].history["rail.fy"].min() < -0.1 < 0.1 < runs[0].history["rail.fy"].max()
    np.testing.assert_allclose(runs[0].history["crank"], runs[1].history["crank"], atol=1e-9)
    np.testing.assert_allclose(runs[0].history["rail.fy"], runs[1].history["rail.fy"], atol=1e-6)
    assert runs[0].transient["rejected"] < 0.1 * runs[0].transient["steps"] < 30
