"""Static equilibrium: closed forms, turning arms, closed mechanisms, large deflections, and what follows from them."""

import math

import numpy as np
import pytest
from biela.histories import read
from linear_oracle import settle
from linear_scenes import AREA, DENSITY, HELD, INERTIA, LENGTH, YOUNG, beam, closed_mechanism
from oracle_probe import Twins

TIP = "&sensor name='tip' quantity='deflection' body='b' node=-1 /\n&sensor name='wall' quantity='reaction' joint='one' /\n"


def cantilever(rest, elements=6, ghm="", static="&static /\n"):
    """Return the deck of a clamped beam with sensors and a static analysis."""
    return beam(elements, ghm=ghm).replace("&modal modes=3 /\n", "") + TIP + rest + static


@pytest.fixture
def static_of(run_deck):
    """Return a function that runs a deck and returns static.txt."""
    return lambda deck, **options: read(run_deck(deck, **options).folder, "static")


def test_cantilever_under_weight_and_tip_force(static_of):
    gravity = "&force name='f' type='force' body='b' node=-1 fy=-2.0 /\n"
    deck = cantilever(gravity, ghm="ghm_alpha=0.5 ghm_zeta=2.0 ghm_omega=1000.0").replace(
        "'beam' /", "'beam' gravity=0.0,-9.81 /", 1
    )
    table = static_of(deck)
    ei, weight = YOUNG * INERTIA, DENSITY * AREA * 9.81
    expected = -weight * LENGTH**4 / (8 * ei) - 2.0 * LENGTH**3 / (3 * ei)
    np.testing.assert_allclose(table["load"], np.arange(1, 11) / 10, rtol=1e-15)
    np.testing.assert_allclose(table["tip.v"], expected * table["load"], rtol=1e-10)
    np.testing.assert_allclose(table["wall.fy"][-1], 2.0 + weight * LENGTH, rtol=1e-10)
    np.testing.assert_allclose(table["wall.m"][-1], 2.0 * LENGTH + weight * LENGTH**2 / 2, rtol=1e-10)
    assert np.all(table["residual"] <= 1e-10)
    np.testing.assert_allclose(table["state.b.7.y"], table["tip.v"], rtol=1e-14)


@pytest.mark.parametrize("length", [1e-11, 1e-7, 1e-3, 1e4, 1e6])
def test_deflection_and_frequency_of_a_cantilever_of_any_length(length, run_deck):
    """Forces and moments of one matrix differ by the length: nothing that is weak may be told by comparing them."""
    deck = cantilever("", ghm="ghm_alpha=0.5 ghm_zeta=2.0 ghm_omega=1000.0", static="&static load_steps=1 /\n&modal modes=2 /\n")
    deck = deck.replace(f"length={LENGTH}", f"length={length}").replace("'beam' /", "'beam' gravity=0.0,-9.81 /", 1)
    run = run_deck(deck)
    ei, line = YOUNG * INERTIA, DENSITY * AREA
    assert read(run.folder, "static")["tip.v"][-1] == pytest.approx(-line * 9.81 * length**4 / (8 * ei), rel=1e-10)
    lowest = min(1.8751040687**2 * np.sqrt(ei / line) / length**2, np.pi / 2 * np.sqrt(YOUNG / DENSITY) / length) / (2 * np.pi)
    modes = read(run.folder, "modes")
    assert modes["undamped_frequency"][0] == pytest.approx(lowest, rel=5e-3)
    assert "missing" not in (run.folder / "modes.txt").read_text()


def test_a_scene_of_any_size_takes_the_same_steps_to_its_equilibrium(static_of):
    found = []
    for size in (1e-3, 1.0, 1e3):
        deck = f"""&scene gravity=0.0,-9.81 /
&body name='r' kind='rigid' mass=2.0 inertia={0.01 * size**2} position={size},0.0 /
&spring name='a' type='linear' body_a='r' stiffness={40.0 / size} free_length={0.8 * size} /
&spring name='b' type='linear' body_a='r' point_a={0.1 * size},0.0 point_b={size},{1.5 * size} stiffness={40.0 / size} /
&spring name='c' type='torsional' body_a='r' stiffness={5.0 * size} /
&sensor name='p' quantity='position' body='r' /
&static load_steps=1 /
"""
        table = static_of(deck, name=f"size{size}")
        found.append([table["newton_steps"][-1], table["p.x"][-1] / size, table["p.y"][-1] / size])
    assert np.hypot(found[1][1] - 1, found[1][2]) > 0.3  # a way that is not gone in one step
    np.testing.assert_allclose(found, [found[1]] * 3, rtol=1e-9)


def test_a_fine_mesh_is_not_taken_for_a_free_body(run_deck):
    """Its lowest frequency is small beside what rounding of the largest one is."""
    elements = 2500
    held = f"&joint name='one' type='{{}}' body_a='b' node_a={elements + 1} point_b={LENGTH},0.0 /\n"
    deck = beam(elements, "pinned-pinned").split("&joint")[0] + "{}&static load_steps=1 /\n"
    run_deck(deck.format(held.format("weld")), "--check")
    assert "left free to move" in run_deck(deck.format(held.format("revolute")), "--check", expect=2).stderr


def test_bodies_that_rounding_cannot_tell_from_free_ones_are_refused(run_deck):
    """A beam whose stiffness in tension is lost beside that in bending."""
    run = run_deck(cantilever("").replace(f"length={LENGTH}", "length=1e-4").replace("area=0.0003", "area=1e-38"), expect=2)
    assert 'left free to move: "b"; expected' in run.stderr
    assert "by more than rounding" in run.stderr


def test_steady_stretch_of_the_spinning_arm(static_of, run_deck):
    deck = """&scene title='steady turn' /
&material name='m' density=3000.0 young=7.0e10 /
&section name='s' area=4.0e-4 inertia=2.0e-7 /
&body name='arm' kind='beam' length=10.0 elements=8 material='m' section='s' reference='clamped' stiffening=.true. /
&joint name='hub' type='revolute' body_a='arm' node_a=1 /
&history name='spin' kind='polynomial' coefficients=6.0 /
&drive name='motor' type='rotation' body_a='arm' history='spin' rate=.true. /
&sensor name='tip' quantity='deflection' body='arm' node=-1 /
&sensor name='hub' quantity='reaction' joint='hub' /
&static /
"""
    table = static_of(deck)
    assert table["tip.u"][-1] == pytest.approx(5.1432e-4, rel=1e-4)
    assert table["hub.fx"][-1] == pytest.approx(-1.2 * 36.0 * 50.0, rel=1e-4)
    run = run_deck(deck + "&transient t_end=0.05 method='rk4' step=1.0e-4 output_step=1.0e-3 /\n", name="turning")
    assert np.max(np.abs(run.history["tip.u"] - table["tip.u"][-1])) < 1e-9 * 5e-4
    assert np.max(np.abs(run.history["tip.v"])) < 1e-9 * 5e-4


@pytest.mark.parametrize("kind", ["four_bar", "slider_crank"])
def test_closed_mechanism_against_the_oracle(static_of, run_deck, probe, tmp_path, kind):
    push = "node=-1" if kind == "slider_crank" else "point=0.1,0.0"
    deck = "&scene title='t' gravity=0.0,-9.81 /\n" + closed_mechanism(kind, 0.9) + HELD["spring"]
    deck += f"&force name='push' type='force' body='crank' {push} fx=3.0 fy=-20.0 /\n"
    deck += "&sensor name='crank' quantity='angle' body='crank' /\n&sensor name='hold' quantity='spring' spring='hold' /\n"
    deck += "&sensor name='c' quantity='reaction' joint='c' /\n"
    twins = Twins(probe, tmp_path, deck)
    scene = twins.oracle
    about = settle(scene, twins.q0)
    expected = scene.sensor_columns(0.0, about.q, about.zero, about.z, 0 * about.z)
    table = static_of(deck + "&static tolerance=1.0e-13 /\n")
    for name, value in expected.items():
        scale = max(abs(x) for other, x in expected.items() if other.split(".")[0] == name.split(".")[0])
        assert abs(table[name][-1] - value) < 1e-8 * scale, name
    assert abs(expected["crank"] - 0.9) > 0.01, "the equilibrium lies elsewhere than the deck's position"
    transient = "&static tolerance=1.0e-13 /\n&transient t_end=5.0e-3 method='rk4' step=5.0e-6 output_step=1.0e-4 /\n"
    run = run_deck(deck + transient, name="still")
    assert np.max(np.abs(run.history["crank"] - run.history["crank"][0])) < 1e-10
    assert np.max(np.abs(run.energy["kinetic"])) < 1e-16


def test_large_rotation_of_welded_beams_bends_into_an_arc(static_of):
    pieces, deck = 8, "&scene title='elastica' /\n"
    deck += f"&material name='m' density={DENSITY} young={YOUNG} /\n&section name='s' area={AREA} inertia={INERTIA} /\n"
    length = LENGTH / pieces
    for k in range(pieces):
        deck += f"&body name='b{k}' kind='beam' length={length} elements=2 material='m' section='s' position={k * length},0.0 /\n"
        fixed = "point_b=0.0,0.0" if k == 0 else f"body_b='b{k - 1}' node_b=-1"
        deck += f"&joint name='j{k}' type='weld' body_a='b{k}' node_a=1 {fixed} /\n"
    turn = np.pi / 2
    deck += f"&force name='end' type='torque' body='b7' node=-1 moment={YOUNG * INERTIA * turn / LENGTH:.17g} /\n"
    deck += "&sensor name='tip' quantity='position' body='b7' node=-1 /\n&sensor name='end' quantity='angle' body='b7' node=-1 /\n"
    table = static_of(deck + "&static load_steps=6 /\n")
    radius = LENGTH / turn
    assert table["end"][-1] == pytest.approx(turn, rel=1e-9)
    assert table["tip.x"][-1] == pytest.approx(radius, rel=2e-3)
    assert table["tip.y"][-1] == pytest.approx(radius, rel=2e-3)


def test_pluck_and_release(run_deck):
    pluck = "&force name='pluck' type='force' body='b' node=-1 fy=3.0 stage='static' /\n"
    transient = "&transient t_end=0.02 method='rk4' step=8.0e-6 output_step=1.0e-4 /\n"
    run = run_deck(cantilever(pluck, elements=2) + transient)
    table = read(run.folder, "static")
    deflection = 3.0 * LENGTH**3 / (3 * YOUNG * INERTIA)
    assert table["tip.v"][-1] == pytest.approx(deflection, rel=1e-10)
    assert run.history["tip.v"][0] == pytest.approx(deflection, rel=1e-10)
    assert run.history["tip.v"].min() < 0.0, "released: it swings through"
    held = run_deck(cantilever(pluck.replace("stage='static'", ""), elements=2) + transient, name="held")
    assert np.max(np.abs(held.history["tip.v"] - deflection)) < 1e-9 * deflection


TERMS = "ghm_alpha=0.4,0.3 ghm_zeta=1.3,0.6 ghm_omega=300.0,2000.0 prony_alpha=0.5 prony_tau=1.0e-3"


@pytest.mark.parametrize("method", ["'dopri5' tolerance=1e-8", "'radau' tolerance=1e-8", "'rk4' step=8.0e-6"])
@pytest.mark.parametrize("ghm", ["", TERMS])
def test_a_run_from_equilibrium_rests_without_effort(method, ghm, run_deck):
    """Accelerations are rounding alone: adaptive steps do not follow it, and nothing is said about the mesh."""
    load = "&force name='f' type='force' body='b' node=-1 fx=40.0 fy=3.0 /\n"
    transient = f"&transient t_end=0.02 method={method} output_step=1.0e-3 /\n"
    first = "&body name='first' mass=1.0 inertia=1.0 /\n&joint name='j' type='weld' body_a='first' /\n"
    deck = cantilever(load, elements=4, ghm=ghm).replace("'beam' /\n", f"'beam' /\n{first}", 1)
    run = run_deck(deck + transient)
    assert run.stderr == ""
    deflection = run.history["tip.v"]
    assert np.max(np.abs(deflection - deflection[0])) < 1e-12 * np.abs(deflection[0])
    assert "tolerance" not in method or run.transient["steps"] < 4000


def test_transient_loads_do_not_act_in_the_static_stage(static_of):
    table = static_of(cantilever("&force name='f' type='force' body='b' node=-1 fy=3.0 stage='transient' /\n"))
    assert np.all(table["tip.v"] == 0.0)


FREE = """&scene title='a free one' gravity=0.0,-9.81 /
&body name='Arm' kind='rigid' mass=1.0 inertia=0.1 com={com},0.0 /
&body name='bracket' kind='rigid' mass=1.0 inertia=0.1 position=3.0,0.0 /
&joint name='hub' type='revolute' body_a='arm' /
&joint name='wall' type='weld' body_a='bracket' point_b=3.0,0.0 /
&static /
"""


def test_bodies_left_free_are_refused_by_name(run_deck):
    run = run_deck(FREE.format(com=0.0), expect=2)
    assert '"arm"' in run.stderr.lower()
    assert "bracket" not in run.stderr
    assert not run.folder.exists()
    told = run_deck(FREE.format(com=0.0), "--check", expect=2, name="check").stderr.splitlines()
    assert sum("left free to move" in line for line in told) == 1


HANGING = """&scene gravity=0.0,-9.81 /
&body name='arm' mass=1.0 inertia=0.1 com=0.5,0.0 angle={angle!r} /
&joint name='hub' type='revolute' body_a='arm' /
&sensor name='arm' quantity='angle' body='arm' /
&sensor name='hub' quantity='reaction' joint='hub' /
"""
PULL = "&spring name='k' type='linear' body_a='arm' point_a=1.0,0.0 point_b=3.0,0.0 stiffness=100.0 free_length={} /\n"
UP = np.pi / 2


@pytest.mark.parametrize("start", [-UP, 0.0, 1.2, UP - 1e-6])
def test_weight_holds_a_pendulum_wherever_it_starts(run_deck, start):
    """It hangs, also from beside the top; the run that follows rests there."""
    run = run_deck(HANGING.format(angle=start) + "&static /\n&transient t_end=0.5 method='rk4' step=1e-3 output_step=0.1 /\n")
    assert run.stderr == ""
    np.testing.assert_allclose(run.history["arm"], -UP, atol=1e-9)
    np.testing.assert_allclose(run.history["hub.fy"], 9.81, rtol=1e-9)


@pytest.mark.parametrize(("free", "start", "angle"), [(1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (5.0, 1.0, np.pi)])
def test_a_stretched_or_pressed_spring_holds_an_arm_along_its_line(static_of, free, start, angle):
    """Without weight: the arm points to the spring's end, or away from it; the spring's force is that of this length."""
    deck = HANGING.format(angle=start).replace("-9.81", "0.0") + PULL.format(free)
    table = static_of(deck + "&static /\n")
    assert table["arm"][-1] == pytest.approx(angle, abs=1e-9)
    assert abs(table["hub.fx"][-1]) == pytest.approx(100.0 * abs(abs(3.0 - np.cos(angle)) - free), rel=1e-9)


@pytest.mark.parametrize(
    ("load", "balanced"),
    [
        ("", True),
        ("&force name='t' type='torque' body='arm' moment=1.0 /\n", True),
        ("&force name='f' type='force' body='arm' fx=3.0 /\n", True),
        ("&body name='cart' mass=1.0 inertia=1.0 /\n&joint name='rail' type='prismatic' body_a='cart' /\n", False),
    ],
)
def test_loads_that_do_not_change_with_the_position_hold_nothing(run_deck, load, balanced):
    """An arm balanced on its pin: no load there, a moment or a force through the pin turns it back. A cart rolls, the arm hangs."""
    com = "com=0.0,0.0" if balanced else "com=0.5,0.0"
    run = run_deck(HANGING.format(angle=0.4).replace("com=0.5,0.0", com) + load + "&static /\n", expect=2)
    assert f'left free to move: "{"arm" if balanced else "cart"}"; expected' in run.stderr
    assert not run.folder.exists()


def test_velocities_of_free_bodies_hold_nothing(run_deck):
    """Two bodies that fly hinged to one another, as a deck may start them."""
    deck = "&body name='a' mass=1.0 inertia=0.1 velocity=0.1,0.2 /\n&body name='b' mass=1.0 inertia=0.1 position=1.0,0.3 /\n"
    deck += "&joint name='j' type='revolute' body_a='a' point_a=0.5,0.0 body_b='b' point_b=-0.5,-0.3 /\n&static /\n"
    for spin in (0.0, 3.0):
        turned = deck.replace("velocity=0.1", f"angular_velocity={spin} velocity=0.1")
        assert 'left free to move: "a" "b"' in run_deck(turned, expect=2, name=f"spin{spin}").stderr


@pytest.mark.parametrize("links", [3, 30])
def test_a_chain_hangs(static_of, links):
    """From level: every link ends upright, each pin carries what hangs below it."""
    deck = "&scene gravity=0.0,-9.81 /\n"
    for k in range(links):
        deck += f"&body name='l{k}' mass=1.0 inertia=0.1 com=0.5,0.0 position={k},0.0 /\n&joint name='j{k}' type='revolute' "
        deck += f"body_a='l{k}' " + (f"body_b='l{k - 1}' point_b=1.0,0.0 /\n" if k else "/\n")
    deck += "&sensor name='low' quantity='reaction' joint='j1' /\n&static load_steps=1 /\n"
    table = static_of(deck)
    for k in range(links):
        assert table[f"state.l{k}.angle"][-1] % (2 * np.pi) == pytest.approx(1.5 * np.pi, abs=1e-8)
    assert table["low.fy"][-1] == pytest.approx(9.81 * (links - 1), rel=1e-9)


@pytest.mark.parametrize("modes", ["", "modes=3 "])
@pytest.mark.parametrize("start", [0.0, 2.5])
def test_a_flexible_arm_hangs(static_of, modes, start):
    """Straight down, stretched by its weight: rho g L^2 / (2 E) where nodes follow it."""
    deck = cantilever("").replace("'beam' /", "'beam' gravity=0.0,-9.81 /", 1).replace("type='weld'", "type='revolute'")
    table = static_of(deck.replace("kind='beam'", f"kind='beam' {modes}angle={start} "))
    assert table["state.b.angle"][-1] % (2 * np.pi) == pytest.approx(1.5 * np.pi, abs=1e-9)
    assert table["wall.fy"][-1] == pytest.approx(DENSITY * AREA * LENGTH * 9.81, rel=1e-9)
    if not modes:
        assert table["tip.u"][-1] == pytest.approx(DENSITY * 9.81 * LENGTH**2 / (2 * YOUNG), rel=1e-6)


def test_an_arch_of_links_falls_to_its_mirror_image(static_of):
    """A chain between two pins balances as an arch, unstable: let go a little beside it, it hangs as the mirrored arch."""
    links, deck, x, y = 8, "&scene gravity=0.0,-9.81 /\n", 0.0, 0.0
    for k in range(links):
        angle = 0.7 - 0.2 * k
        deck += f"&body name='l{k}' mass=1.0 inertia=0.1 com=0.5,0.0 position={x!r},{y!r} angle={angle!r} /\n&joint name='j{k}' "
        deck += f"type='revolute' body_a='l{k}' " + (f"body_b='l{k - 1}' point_b=1.0,0.0 /\n" if k else "/\n")
        x, y = x + math.cos(angle), y + math.sin(angle)
    deck += f"&joint name='end' type='revolute' body_a='l7' point_a=1.0,0.0 point_b={x!r},{y!r} /\n"
    deck += "&sensor name='pin' quantity='reaction' joint='j0' /\n&static load_steps=1 /\n"
    table = static_of(deck)
    angles = np.array([table[f"state.l{k}.angle"][-1] for k in range(links)])
    # links of equal weight: the tangent changes by the weight over the horizontal force from joint to joint
    pull = table["pin.fx"][-1]
    expected = np.arctan(9.81 * (np.arange(links) - (links - 1) / 2) / -pull)
    np.testing.assert_allclose(angles, expected, atol=1e-8)
    assert np.sum(np.cos(expected)) == pytest.approx(x, rel=1e-9)
    assert table["pin.fy"][-1] == pytest.approx(9.81 * links / 2, rel=1e-9)


@pytest.mark.parametrize(
    "hold",
    [
        "&spring name='k' type='torsional' body_a='arm' stiffness=60.0 /\n",
        "&history name='h' kind='polynomial' coefficients=0.0 /\n&drive name='d' type='rotation' body_a='arm' history='h' /\n",
        "&joint name='tip' type='slider' body_a='arm' point_a=1.0,0.0 point_b=1.0,0.0 direction=0.0 /\n",
    ],
)
def test_the_same_body_held_is_accepted(run_deck, hold):
    deck = FREE.format(com=0.5).replace("&static /", hold + "&static /")
    assert run_deck(deck).status == 0


def test_more_than_the_structure_can_carry_is_a_failure_not_a_hang(run_deck):
    push = "&force name='f' type='torque' body='arm' moment=1.0e5 /\n&spring name='k' type='linear' body_a='arm' point_a=1.0,0.0"
    push += " point_b=1.0,1.0 stiffness=10.0 /\n"
    run = run_deck(FREE.format(com=0.5).replace("&static /", push + "&static /"), expect=1)
    assert "no equilibrium" in run.stderr
    assert (run.folder / "summary.txt").exists()


def test_nothing_acts_and_nothing_moves(static_of):
    table = static_of(cantilever(""))
    assert np.all(table["tip.v"] == 0.0)
    assert np.all(table["residual"] <= 1e-10)


SOFT = """&scene gravity=4.91,-3.56 /
&material name='a' density=1740.0 young=5.57e8 /
&material name='b' density=858.0 young=1.0e8 /
&material name='c' density=2550.0 young=2.01e8 /
&section name='thick' shape='circle' diameter=0.0108 /
&section name='thin' shape='circle' diameter=0.009 /
&body name='low' kind='beam' length=0.311 elements=3 material='c' section='thick' element_material='a','b','b' axial=.false.
  position=0.728,-0.747 angle=-0.388 /
&joint name='low' type='revolute' body_a='low' node_a=3 point_b=0.919,-0.826 /
&spring name='low' type='torsional' body_a='low' stiffness=8.72 /
&body name='high' kind='beam' length=0.493 elements=3 material='b' section='thin' element_material='a','c','a'
  reference_node=2,2,2 reference_dof='u','v','r' stiffening=.true. position=-0.877,0.117 angle=-0.727 /
&joint name='high' type='revolute' body_a='high' node_a=-1 point_b=-0.508,-0.211 /
&spring name='high' type='torsional' body_a='high' node_a=4 stiffness=75.8 free_angle=-0.782 /
&sensor name='low' quantity='position' body='low' node=1 /
&sensor name='high' quantity='position' body='high' node=1 /
"""


def test_large_rotations_of_soft_beams_do_not_need_small_load_steps(run_deck):
    """Soft beams that sag by a third of their length: the equilibrium does not depend on the number of load steps."""
    found = []
    for steps in (1, 10, 40):
        run = run_deck(SOFT + f"&static load_steps={steps} /\n", name=f"steps{steps}")
        table = read(run.folder, "static")
        assert table["load"].size == steps
        assert table["residual"].max() <= 1e-10
        assert table["newton_steps"].max() <= (14 if steps == 1 else 12)
        found.append([table[name][-1] for name in ("low.x", "low.y", "high.x", "high.y")])
    np.testing.assert_allclose(found[:2], [found[2]] * 2, rtol=0.0, atol=1e-9)


TURNING = """&scene title='relative equilibrium' /
&body name='table' kind='rigid' mass=1.0 inertia=0.1 angular_velocity=10.0 /
&joint name='axle' type='revolute' body_a='table' /
&history name='h' kind='polynomial' coefficients=10.0 /
&drive name='motor' type='rotation' body_a='table' history='h' rate=.true. /
"""
BOB = """&body name='bob' kind='rigid' mass=2.0 inertia=0.05 position=0.5,0.0 angular_velocity=10.0 velocity=0.0,5.0 /
&joint name='guide' type='prismatic' body_a='bob' body_b='table' point_b=0.5,0.0 /
&spring name='k' type='linear' body_a='bob' body_b='table' stiffness=1000.0 damping=50.0 free_length=0.5 /
"""
ARM = """&body name='arm' kind='rigid' mass=2.0 inertia=0.05 {frame} angular_velocity=10.0 /
&joint name='pin' type='revolute' body_a='arm' point_a={pin} body_b='table' point_b=0.5,0.0 /
&spring name='k' type='torsional' body_a='arm' body_b='table' stiffness=1000.0 damping=20.0 free_angle=0.0 /
"""


def arm_angle():
    """Angle of an arm (2 kg, 0.2 m across the table's radius of 0.5 m, 10 rad/s) against the table: k phi = m w2 r x c."""
    angle = 0.0
    for _ in range(60):
        c = 0.2 * np.array([-np.sin(angle), np.cos(angle)])  # from the pin, table's axes
        angle = 2.0 * 100.0 * (-c[1]) * 0.5 / 1000.0
    return angle


@pytest.mark.parametrize(
    ("held", "expected"),
    [
        (BOB, 2.0 * 100.0 * 0.5 / (1000.0 - 2.0 * 100.0)),
        (ARM.format(frame="com=0.0,0.2 position=0.5,0.0", pin="0.0,0.0"), arm_angle()),
        (ARM.format(frame="position=0.5,0.2", pin="0.0,-0.2"), arm_angle()),
    ],
    ids=["bob on a radius", "arm, frame in the pin", "arm, frame in the mass centre"],
)
def test_bodies_that_springs_hold_turn_with_the_table(run_deck, held, expected):
    """Centrifugal forces stretch the springs, wherever the held body's frame has its origin; the transient stays there."""
    sensor = "&sensor name='k' quantity='spring' spring='k' /\n"
    transient = "&static /\n&transient t_end=0.5 method='rk4' step=1.0e-4 output_step=0.01 /\n"
    run = run_deck(TURNING + held + sensor + transient)
    assert read(run.folder, "static")["k.d"][-1] == pytest.approx(expected, rel=1e-7)
    np.testing.assert_allclose(run.history["k.d"], expected, rtol=1e-7)


def test_rates_that_a_drive_asks_of_a_beam_go_to_its_section_alone(run_deck):
    """A drive moves the tip of a clamped beam: the tip's coordinate has its rate, no other has; only C q' bends the beam."""
    deck = cantilever(
        "&history name='h' kind='polynomial' coefficients=0.0,0.5 /\n"
        "&drive name='d' type='position' body_a='b' node_a=-1 history='h'\n"
        f"  direction=1.5707963267948966 point_b={LENGTH},0.0 /\n",
        elements=3,
        ghm="rayleigh_mass=2.0 rayleigh_stiffness=1.0e-6",
    )
    names = []
    for index in range(1, 10):
        deck += f"&sensor name='q{index}' quantity='coordinate' body='b' index={index} /\n"
        names.append(f"q{index}.qd")
    run = run_deck(deck + "&transient t_end=1.0e-6 method='rk4' step=1.0e-7 output_step=1.0e-7 /\n")
    rates = np.array([run.history[name][0] for name in names])
    assert read(run.folder, "static")["residual"].max() <= 1e-10
    assert rates[7] == pytest.approx(0.5, rel=1e-12)
    np.testing.assert_allclose(np.delete(rates, 7), 0.0, atol=1e-7)


@pytest.mark.parametrize(
    ("profile", "at", "place"),
    [
        (
            "kind='points' closed=.false. x=-1,-0.8,-0.6,-0.4,-0.2,0,0.2,0.4,0.6,0.8,1 "
            "y=1,0.64,0.36,0.16,0.04,0,0.04,0.16,0.36,0.64,1",
            (0.01, 0.06),
            0.05,
        ),
        ("kind='circle' radius=0.5 hollow=.true.", (0.2, -0.3), -0.45),
    ],
)
def test_weight_and_a_bend_hold_a_roller_in_a_hollow(profile, at, place, run_deck):
    deck = f"""&scene gravity=0,-9.81 /
&profile name='p' {profile} /
&body name='b' mass=2 inertia=1 position={at[0]},{at[1]} /
&spring name='t' type='torsional' body_a='b' stiffness=1 free_angle=0 /
&stop name='s' type='profile' body_a='b' radius=0.05 profile='p' stiffness=1e6 exponent=1 /
&sensor name='x' quantity='position' body='b' /
&static /
"""
    rests = read(run_deck(deck).folder, "static")
    assert [rests["x.x"][-1], rests["x.y"][-1]] == pytest.approx([0.0, place - 2 * 9.81 / 1e6], abs=1e-12)
    away = run_deck(deck.replace("gravity=0,-9.81", "gravity=0,9.81" if "points" in profile else "gravity=0,0"), expect=None)
    assert away.status != 0
    assert 'no stop holds "b"' in away.stderr


def test_a_roller_that_leaves_a_hill_is_told(run_deck):
    deck = """&scene gravity=0,-9.81 /
&profile name='p' kind='circle' radius=0.5 /
&body name='b' mass=2 inertia=1 position=0.01,0.56 /
&spring name='t' type='torsional' body_a='b' stiffness=1 free_angle=0 /
&stop name='s' type='profile' body_a='b' radius=0.05 profile='p' stiffness=1e6 exponent=1 /
&static /
"""
    assert 'no stop holds "b"' in run_deck(deck, expect=1).stderr
