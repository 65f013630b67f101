"""The implicit method: tangent, order, reference scenes, stiff scenes at steps of the motion, energy, counts, restart."""

import os
import re
import shutil
import signal
import subprocess
import time

import numpy as np
import pytest
from biela.compare import differences
from biela.histories import read
from conftest import REFERENCE, TIMEOUT, caught, program, wait_for
from four_bars import row_of_four_bars
from linearised import DECKS
from scenes import LUMPS, MATERIALS, PUSHES, SPRINGS, beam, frame, rigid

MIXED = (
    MATERIALS
    + beam("b", "two", "rod", 3, rest="position=0.1,0.2 angle=0.6 stiffening=.true.")
    + frame("f")
    + rigid("r")
    + beam("m", "three", "strip", 5, rest="position=0.4,-0.3 angle=0.1 modes=4")
    + LUMPS
    + "&lump body='m' node=3 mass=0.2 inertia=1.0e-3 /\n"
    + PUSHES
    + SPRINGS
    + """&stop name='t1' type='position' body_a='r' body_b='b' node_b=3 direction=0.8 upper=-1.0 stiffness=4.0e3 damping=1.0e-3 /
&stop name='t2' type='clearance' body_a='f' node_a=2 body_b='m' node_b=4 gap=0.01 stiffness=2.0e3 exponent=2.0 /
&spring name='s5' type='linear' body_a='m' node_a=2 body_b='b' node_b=3 stiffness=400.0 damping=9.0 free_length=0.1
  ghm_alpha=0.4 ghm_zeta=0.8 ghm_omega=300.0 /
&force name='p10' type='force' axes='section' body='m' node=4 fx=10.0 fy=7.0 /
&force name='p11' type='force' axes='body' body='m' node=6 fx=-4.0 fy=5.0 /
&joint name='rod' type='distance' body_a='b' node_a=1 body_b='r' point_b=0.1,0.02 /
&joint name='guide' type='prismatic' body_a='f' node_a=2 body_b='m' node_b=3 direction=0.4 /
&joint name='slide' type='slider' body_a='r' point_a=0.0,0.1 body_b='b' node_b=2 direction=0.9 /
&sensor name='tip' quantity='position' body='b' node=2 /
&transient t_end=1.0e-2 method='generalized_alpha' step=1.0e-3 /
"""
)
FOUR_BAR = """&scene title='four-bar of bending members' gravity=0.0,-9.81 /
&material name='steel' density=7850.0 young=2.1e11 /
&material name='polymer' density=1200.0 young=3.0e9 ghm_alpha=0.4,0.6 ghm_zeta=1.5,2.5 ghm_omega=400.0,4000.0 /
&section name='strip' shape='rectangle' width=0.02 height=0.006 /
&body name='crank' kind='rigid' mass=0.3 inertia=4.0e-4 com=0.05,0.0 angle=1.5707963267948966 /
&body name='coupler' kind='beam' length=0.35 elements=1 material='polymer' section='strip' position=0.0,0.1 angle=0.49 /
&body name='rocker' kind='beam' length=0.28 elements=1 material='steel' section='strip' position=0.4,0.0 angle=1.9 axial=.false. /
&joint name='a' type='revolute' body_a='crank' /
&joint name='b' type='revolute' body_a='coupler' node_a=1 body_b='crank' point_b=0.1,0.0 /
&joint name='c' type='revolute' body_a='coupler' node_a=-1 body_b='rocker' node_b=-1 /
&joint name='d' type='revolute' body_a='rocker' node_a=1 point_b=0.4,0.0 /
&history name='spin' kind='sine' offset=1.5707963267948966 amplitude=1.0 frequency=4.0 /
&drive name='motor' type='rotation' body_a='crank' history='spin' /
&sensor name='p' quantity='position' body='rocker' node=-1 /
&sensor name='v' quantity='velocity' body='rocker' node=-1 /
&sensor name='a' quantity='acceleration' body='rocker' node=-1 /
&sensor name='q' quantity='coordinate' body='coupler' index=1 /
&sensor name='motor' quantity='reaction' drive='motor' /
&sensor name='pin' quantity='reaction' joint='c' /
"""
CRANK = """&material name='m' density=1600.0 young={young} {ghm} /
&section name='s' area=1.6129e-4 inertia=8.6576e-9 /
&body name='rod' kind='beam' length=0.3492 elements={elements} material='m' section='s' position=0.1524,0.0 /
&joint name='crank' type='distance' body_a='rod' node_a=1 point_b=0.0,0.0 length=0.1524 /
&joint name='slider' type='slider' body_a='rod' node_a=-1 /
&force name='torque' type='torque_about' body='rod' node=1 centre=0.0,0.0 moment=10.0 /
&sensor name='pin' quantity='position' body='rod' node=1 /
&sensor name='rod' quantity='angle' body='rod' /
"""
CANTILEVER = """&material name='steel' density=7850.0 young=2.1e11 /
&section name='s' shape='rectangle' width=0.02 height=0.01 /
&body name='arm' kind='beam' length=1.0 elements=8 material='steel' section='s' reference='clamped' /
&joint name='w' type='weld' body_a='arm' node_a=1 /
&force name='f' type='force' body='arm' node=-1 fy=10.0 {history} /
&sensor name='tip' quantity='deflection' body='arm' node=-1 /
"""
TURNING_GUIDE = """&body name='b' kind='rigid' mass=1. inertia=.1 com=.2,0 /
&joint name='j' type='revolute' body_a='b' /
&history name='w' kind='polynomial' coefficients=0.,1.5 /
&drive name='d' type='rotation' body_a='b' history='w' /
&body name='p' kind='rigid' mass=.5 inertia=.01 position=.4507042253521127,0. angular_velocity=1.5 /
&joint name='e' type='{}' body_a='p' body_b='b' direction=0. /
&spring name='k' type='linear' body_a='p' body_b='b' stiffness=10. damping=.5 free_length=.4 /
&sensor name='x' quantity='spring' spring='k' /
"""
CROSSED = """&body name='b' kind='rigid' mass=1. inertia=.1 /
&joint name='j' type='revolute' body_a='b' /
&history name='w' kind='polynomial' coefficients=0.,2.3 /
&drive name='d' type='rotation' body_a='b' history='w' /
&body name='p' kind='rigid' mass=.5 inertia=3e-4 position=.616301,0. velocity=0.,1.417493 angular_velocity=2.3 /
&joint name='e' type='prismatic' body_a='p' body_b='b' direction=0. /
&spring name='k' type='linear' body_a='p' body_b='b' stiffness=200. free_length=.6 /
&body name='q' kind='rigid' mass=.5 inertia=1e-3 position=.616301,0. velocity=0.,1.417493 angular_velocity=2.3 /
&joint name='f' type='prismatic' body_a='q' body_b='p' direction=1.5707963267948966 /
&spring name='l' type='linear' body_a='q' body_b='p' point_b=0.,-1. stiffness=200. free_length=1. /
&sensor name='y' quantity='spring' spring='l' /
"""


def march(text):
    """Return a &transient group of the implicit method."""
    return f"&transient method='generalized_alpha' {text} /\n"


@pytest.fixture(scope="module")
def tangent():
    """Return a function: mismatch of structured correction and finite differences, for bodies, worst row and constraints."""
    path = program("TANGENT", f"bin/tangent{'-debug' if 'debug' in os.environ.get('PROBE', '') else ''}")

    def measure(deck, step, radius, seed):
        done = subprocess.run([path, deck, str(step), str(radius), str(seed)], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return [float(x) for x in done.stdout.split()[1:]]

    return measure


@pytest.mark.parametrize("scene", ["mixed", "vrl_ghm", "four_bar", "viscoelastic_joint", "spin_up", "andrews"])
@pytest.mark.parametrize(("step", "seed"), [(1e-4, 3), (1e-3, 7), (1e-2, 11)])
def test_the_tangent_is_the_derivative_of_the_residual(scene, step, seed, tangent, tmp_path):
    deck = REFERENCE / scene / "deck.nml"
    if scene == "mixed":
        deck = tmp_path / "deck.nml"
        deck.write_text(MIXED, encoding="utf-8")
    bodies, row, constraints = tangent(deck, step, 0.6, seed)
    assert bodies < 1e-7
    assert row < 1e-5
    assert constraints < 1e-7


@pytest.mark.parametrize("pairs", ["pairs", "joints on profiles"])
@pytest.mark.parametrize(("step", "seed"), [(1e-3, 7), (1e-2, 11), (1e-3, 4)])
def test_the_tangent_of_friction_on_profiles(pairs, step, seed, tangent, tmp_path):
    """Of stops it follows their forces; the slip's own gradient turns. With the even seed it sticks."""
    deck = tmp_path / "deck.nml"
    deck.write_text(DECKS[pairs].replace("type='profile'", "type='profile' friction=0.3") + march("step=1e-3 t_end=1"))
    assert max(tangent(deck, step, 0.6, seed)) < 1e-6


@pytest.mark.parametrize("radius", [0.0, 0.5, 0.9])
def test_order_two_on_the_four_bar(radius, run_deck):
    """Positions, velocities, accelerations, and the multipliers as reactions of drive and joint."""
    exact = run_deck(FOUR_BAR + "&transient t_end=0.05 method='dopri5' tolerance=1e-12 output_step=1e-3 /\n", name="exact").history
    errors = []
    for step in (1e-5, 5e-6, 2.5e-6):
        text = FOUR_BAR + march(f"t_end=0.05 step={step} output_step=1e-3 spectral_radius={radius}")
        errors.append({d.name: d.error for d in differences(run_deck(text, name=f"s{step}").history, exact)})
    moving = [name for name, error in errors[0].items() if error > 1e-12]
    assert len(moving) >= 10
    for name in moving:
        orders = [np.log2(a[name] / b[name]) for a, b in zip(errors[:-1], errors[1:], strict=True)]
        assert min(orders) > 1.75, (name, orders, errors[-1][name])
        assert errors[-1][name] < 2e-2


@pytest.mark.parametrize("radius", [0.0, 0.5, 0.9])
def test_order_two_on_the_slider_crank(radius, run_deck):
    deck = (REFERENCE / "vrl_ghm" / "deck.nml").read_text(encoding="utf-8").split("&transient")[0]
    expected = read(REFERENCE / "vrl_ghm" / "expected.csv")
    errors = []
    for step in (1e-6, 5e-7, 2.5e-7):
        run = run_deck(deck + march(f"t_end=0.01 step={step} output_step=4e-5 spectral_radius={radius}"), name=f"s{step}")
        errors.append({d.name: d.error for d in differences(run.history, expected)})
    for name in (n for n in expected.names[1:] if errors[0][n] > 1e-12):
        orders = [np.log2(a[name] / b[name]) for a, b in zip(errors[:-1], errors[1:], strict=True)]
        assert min(orders) > 1.75, (name, orders)


# steps that resolve every column's motion, and how long: rocker_q3.qdd of the four-bar rings with an undamped axial mode of
# 1.02e5 rad/s, whose phase errs by (omega h)^2/12 omega t
RESOLVED = {
    "vrl_elastic": (5e-7, 0.01),
    "vrl_ghm": (5e-7, 0.01),
    "vrl_torque_on_rod": (5e-7, 0.01),
    "four_bar": (2.5e-7, 0.009),
    "viscoelastic_joint": (1e-5, 0.3),
    "spin_up": (2e-3, 20.0),
    "andrews": (1e-5, 0.03),
}


@pytest.mark.parametrize("scene", RESOLVED)
def test_every_reference_scene_is_approached_with_order_two(scene, run_deck, tmp_path):
    """All columns: positions, velocities, accelerations and reactions, with projection, GHM and drives."""
    step, t_end = RESOLVED[scene]
    deck = re.sub(r"t_end=\S+", f"t_end={t_end}", (REFERENCE / scene / "deck.nml").read_text(encoding="utf-8"))
    rows = (REFERENCE / scene / "expected.csv").read_text(encoding="utf-8").splitlines()
    rows = [rows[0]] + [row for row in rows[1:] if float(row.split(",")[0]) < 1.000001 * t_end]
    (tmp_path / "expected.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    expected = read(tmp_path / "expected.csv")
    errors = []
    for h in (step, step / 2):
        text, count = re.subn(r"method='rk4' step=\S+", f"method='generalized_alpha' step={h}", deck)
        assert count == 1
        errors.append({d.name: d.error for d in differences(run_deck(text, name=f"h{h}").history, expected)})
    for name, error in errors[0].items():
        assert error < 1e-12 or np.log2(error / errors[1][name]) > 1.85, (name, error, errors[1][name])
        assert errors[1][name] < 5e-3


@pytest.fixture
def own_variables(tmp_path):
    """Return a function: the method's own q, v, acceleration, multiplier at five times; arrays of shape (5, unknowns)."""
    path = program("TANGENT", f"bin/tangent{'-debug' if 'debug' in os.environ.get('PROBE', '') else ''}")

    def march_inside(deck, step, radius, interval):
        (tmp_path / "own.nml").write_text(deck + march("t_end=1.0 step=1e-3"), encoding="utf-8")
        words = [path, tmp_path / "own.nml", str(step), str(radius), "march", "5", str(interval)]
        done = subprocess.run(words, capture_output=True, text=True, check=True)
        lines = [line.split() for line in done.stdout.splitlines()]
        return {name: np.array([line[1:] for line in lines if line[0] == name], dtype=float) for name in {x[0] for x in lines}}

    return march_inside


@pytest.mark.parametrize("radius", [0.0, 0.5, 0.9])
@pytest.mark.parametrize("scene", ["slider-crank", "four-bar"])
def test_the_methods_own_multipliers_have_order_two(scene, radius, run_deck, own_variables):
    """What the method carries, not what rows report: differences of three steps fall fourfold; the limit is what rows report."""
    deck, step, interval = FOUR_BAR, 8e-6, 2e-3
    if scene == "slider-crank":
        deck = (REFERENCE / "vrl_ghm" / "deck.nml").read_text(encoding="utf-8").split("&transient")[0]
        step, interval = 1e-6, 2e-4
    runs = [own_variables(deck, step / 2**k, radius, interval) for k in range(3)]
    for name in ("q", "v", "acceleration", "multiplier"):
        gaps = [np.abs(a[name] - b[name]).max() for a, b in zip(runs[:-1], runs[1:], strict=True)]
        assert 1.75 < np.log2(gaps[0] / gaps[1]) < 2.4, (name, gaps)
    limit = (4 * runs[2]["multiplier"] - runs[1]["multiplier"]) / 3
    ends = f"t_end={5 * interval} method='dopri5' tolerance=1e-11 output_step={interval}"
    rows = run_deck(deck + f"&transient {ends} /\n", name="rows").history
    if scene == "four-bar":
        forces, own = np.column_stack([rows["pin.fx"], rows["pin.fy"]]), -limit[:, 4:6]
    else:
        forces, own = np.hypot(rows["crank_link.fx"], rows["crank_link.fy"])[:, None], np.abs(limit[:, :1])
    assert np.abs(own - forces[1:]).max() < 2e-3 * np.abs(forces).max()


@pytest.mark.parametrize("radius", [0.0, 0.9])
def test_the_first_multipliers_have_order_two(radius, run_deck, own_variables):
    """No order is lost after the start, where index-3 methods err by O(h) unless their variables start with their own offsets."""
    deck = FOUR_BAR.replace("kind='beam'", "kind='beam' flexible=.false.").replace("axial=.false.", "")
    deck = "\n".join(line for line in deck.splitlines() if "quantity='coordinate'" not in line) + "\n"
    errors = []
    for step in (2e-4, 1e-4):
        ends = f"t_end={5 * step} method='dopri5' tolerance=1e-11 output_step={step}"
        rows = run_deck(deck + f"&transient {ends} /\n", name="rows").history
        own = -own_variables(deck, step, radius, step)["multiplier"][:, 4:6]
        errors.append(np.abs(own - np.column_stack([rows["pin.fx"], rows["pin.fy"]])[1:]).max())
    assert np.log2(errors[0] / errors[1]) > 1.75, errors


STIFF = {
    "64 elements": ("2.1e10", 64, ""),
    "young 1e15": ("1e15", 64, ""),
    "pole of 1e7 rad/s": ("2.1e10", 2, "ghm_alpha=0.5 ghm_zeta=1.0 ghm_omega=1e7"),
    "over-damped": ("2.1e10", 64, "ghm_alpha=0.5 ghm_zeta=100.0 ghm_omega=5e3"),
    "almost undamped": ("2.1e10", 64, "ghm_alpha=0.5 ghm_zeta=1e-3 ghm_omega=1e7"),
    "all of it": ("1e15", 64, "ghm_alpha=0.5,50.0 ghm_zeta=1e-3,100.0 ghm_omega=1e7,1e2"),
}


@pytest.mark.parametrize("radius", [0.0, 0.8])
@pytest.mark.parametrize("scene", STIFF)
def test_stiff_scenes_run_at_steps_of_the_motion(scene, radius, run_deck):
    """Steps thousands of times the explicit bound: the gross motion is right, two iterations and one factor do it."""
    young, elements, ghm = STIFF[scene]
    text = CRANK.format(young=young, elements=elements, ghm=ghm)
    run = run_deck(text + march(f"t_end=0.01 step=2e-5 output_step=1e-4 spectral_radius={radius}"))
    rigid_rod = CRANK.format(young="1e12", elements=1, ghm="").replace("position=", "flexible=.false. position=")
    exact = run_deck(rigid_rod + "&transient t_end=0.01 method='dopri5' tolerance=1e-9 output_step=1e-4 /\n", name="rigid").history
    assert np.abs(run.history["pin.x"] - exact["pin.x"]).max() < 3e-4
    assert run.transient["rejected"] == 0
    assert run.transient["newton_iterations"] <= 2.6 * 500
    assert run.transient["constant_factorisations"] == 1
    energy = run.energy
    assert np.abs(energy["residual"]).max() < 2e-4 * np.abs(energy["work"]).max()


def test_no_spurious_first_accelerations(run_deck):
    """The row of t = 0 is that of the equations, and the first rows after it do not ring."""
    deck = CANTILEVER.format(history="") + "&sensor name='a' quantity='acceleration' body='arm' node=-1 /\n"
    deck += "&sensor name='w' quantity='reaction' joint='w' /\n"
    implicit = run_deck(deck + march("t_end=2e-3 step=1e-6 output_step=1e-4")).history
    exact = run_deck(deck + "&transient t_end=2e-3 method='dopri5' tolerance=1e-10 output_step=1e-4 /\n", name="e").history
    for column in ("a.y", "w.fy", "w.m"):
        assert implicit[column][0] == pytest.approx(exact[column][0], rel=1e-12, abs=1e-9)
    coarse = run_deck(deck + march("t_end=0.02 step=1e-3"), name="coarse").history
    assert np.abs(coarse["tip.v"]).max() < 1.1 * 2 * 10.0 / (3 * 2.1e11 * 0.02 * 0.01**3 / 12)


def test_the_energy_that_the_method_removes_explains_the_residual(run_deck):
    deck = CANTILEVER.format(history="history='h'")
    deck += "&history name='h' kind='cycloid' start_value=0.0 end_value=1.0 start=0.0 finish=5e-3 /\n"
    removed = {}
    for radius in (0.2, 0.5):
        ends = []
        for t_end in (0.01, 0.2):  # between them no load varies: the trapezoidal work adds nothing
            run = run_deck(deck + march(f"t_end={t_end} step=1e-4 output_step=1e-3 spectral_radius={radius}"), name=f"r{radius}")
            ends.append((run.transient["energy_removed"], run.energy["residual"][-1]))
        removed[radius] = ends[1][0] - ends[0][0]
        assert removed[radius] == pytest.approx(ends[0][1] - ends[1][1], rel=0.25)
    assert removed[0.2] > 2 * removed[0.5] > 0


@pytest.mark.parametrize("radius", [0.0, 0.5, 0.9])
@pytest.mark.parametrize(("scene", "step", "t_end"), [("vrl_ghm", 1e-6, 0.01), ("viscoelastic_joint", 1e-3, 1.0)])
def test_work_dissipation_and_removed_energy_have_order_two(scene, step, t_end, radius, run_deck):
    """The residual without what the method removes falls fourfold; at spectral radius 0 removal is most of the residual."""
    deck = (REFERENCE / scene / "deck.nml").read_text(encoding="utf-8").split("&transient")[0]
    left = []
    for h in (step, step / 2):
        text = deck + march(f"t_end={t_end} step={h} output_step={t_end / 20} spectral_radius={radius}")
        run = run_deck(text, name=f"h{h}")
        removed = run.transient["energy_removed"]
        residual = run.energy["residual"][-1]
        left.append(abs(residual + removed))
        told = float(re.search(r"without it the residual at the end: *(\S+) J", run.summary)[1])
        assert told == pytest.approx(residual + removed, rel=0.02, abs=1e-3 * abs(residual))
        if radius == 0.0:
            assert left[-1] < 0.3 * abs(residual)
    assert 1.8 < np.log2(left[0] / left[1]) < 2.2


@pytest.mark.parametrize("kind", ["nodal", "modal", "spring"])
def test_the_removed_energy_counts_dissipative_coordinates(kind, run_deck):
    """Weakly damped ones that vibrate faster than the step resolves: half of what the method removes is theirs."""
    ghm = "ghm_alpha=1.0 ghm_zeta=0.02 ghm_omega=2e3"
    deck = CANTILEVER.replace("elements=8", "elements=2").format(history="stage='static'") + "&static /\n"
    if kind == "modal":
        deck = deck.replace("reference='clamped'", "reference='clamped' modes=4")
    if kind == "spring":
        deck += f"&spring name='s' type='torsional' body_a='arm' node_a=-1 stiffness=1e3 {ghm} /\n"
    else:
        deck = deck.replace("young=2.1e11", f"young=2.1e11 {ghm}")
    run = run_deck(deck + march("t_end=0.04 step=2e-4 spectral_radius=0.0"))
    residual = run.energy["residual"][-1]
    assert residual < -1e-5
    assert abs(residual + run.transient["energy_removed"]) < 0.04 * abs(residual)


def test_a_jump_at_the_end_of_a_step_is_felt_from_there_on(run_deck):
    """A pulse that starts and ends at step ends keeps order 2."""
    deck = CANTILEVER.replace("elements=8", "elements=1").format(history="history='h'")
    deck += "&history name='h' kind='pulse' value=1.0 start=4e-3 finish=9e-3 /\n"
    exact = run_deck(deck + "&transient t_end=0.02 method='dopri5' tolerance=1e-11 output_step=1e-3 /\n", name="e").history
    errors = []
    for step in (2e-5, 1e-5):
        found = run_deck(deck + march(f"t_end=0.02 step={step} output_step=1e-3"), name=f"s{step}").history
        errors.append(np.abs(found["tip.v"] - exact["tip.v"]).max())
    assert np.log2(errors[0] / errors[1]) > 1.8


def test_a_short_piece_of_a_step_shakes_nothing(run_deck):
    """A jump 3e-9 s before the end of a step makes the motion of one at its end, though positions say little of a short piece."""
    deck = """&scene gravity=0.0,-9.81 /
&body name='a' mass=1.0 inertia=0.02 com=0.2,0.0 /
&body name='b' mass=0.5 inertia=0.01 com=0.15,0.0 position=0.4,0.0 angle=0.5 /
&joint name='o' type='revolute' body_a='a' /
&joint name='p' type='revolute' body_a='b' body_b='a' point_b=0.4,0.0 /
&history name='h' kind='pulse' value=0.5 start=0.5 finish=2.0 /
&force name='m' type='torque' body='a' moment=1.0 history='h' /
&sensor name='b' quantity='angle' body='b' /
"""
    runs = {
        name: run_deck(text + march("t_end=0.6 step=1e-3 output_step=0.1"), name=name).history["b"]
        for name, text in (("at", deck), ("before", deck.replace("start=0.5", f"start={0.5 - 3e-9}")))
    }
    assert runs["before"] == pytest.approx(runs["at"], abs=3e-9)


@pytest.mark.parametrize(("joint", "radius", "step"), [("slider", 0.9, 0.2), ("prismatic", 0.99, 0.05), ("slider", 0.99, 0.01)])
def test_a_guide_that_turns_steadily(joint, radius, step, run_deck):
    """A mass on a turning guide, held by a spring, keeps the elongation of the steady turn, but for errors of order step**2."""
    run = run_deck(TURNING_GUIDE.format(joint) + march(f"t_end=80 step={step} spectral_radius={radius} output_step=1"))
    assert run.history["x.d"][40:] == pytest.approx(0.0507042253521127, abs=0.03 * step**2)


def test_guides_after_a_thousand_turns(run_deck):
    """The angle is known to 1e-12 rad only: the joints of a guided mass on a guided mass are open by its rounding, no more."""
    angle = -6283.185307179586
    deck = TURNING_GUIDE.format("slider").replace("0.,1.5", f"{angle},-2.5").replace("position=.45", "position=.36")
    deck += "&spring name='t' type='torsional' body_a='p' body_b='b' stiffness=.44 damping=.013 /\n"
    deck += "&body name='q' kind='rigid' mass=1.4 inertia=.014 position=.66,-.18 angular_velocity=-2.5 /\n"
    deck += "&joint name='f' type='prismatic' body_a='q' body_b='p' direction=0. /\n"
    deck += "&spring name='l' type='linear' body_a='q' body_b='b' point_b=-2.,-.18 stiffness=94. damping=.6 free_length=2.66 /\n"
    deck = deck.replace("' kind='rigid'", f"' kind='rigid' angle={angle}").replace("=1.5 /", "=-2.5 /")
    deck = deck.replace(",0. angular", ",-.18 angular").replace("'b' direction", "'b' point_b=0.,-.18 direction")
    run = run_deck(deck + march("t_end=40 step=0.05 output_step=1"))
    assert run.energy["position_violation"].max() < 2e-11


@pytest.mark.parametrize(("step", "grows"), [(0.1, False), (0.3, True)])
def test_masses_that_cross_on_a_turning_line(step, grows, run_deck):
    """Two undamped masses, one across the line of the other: a step that resolves their vibration keeps it, not a longer one."""
    run = run_deck(CROSSED + march(f"t_end=60 step={step} output_step={step}"))
    y = np.abs(run.history["y.d"])
    early, late = y[len(y) // 3 : len(y) // 2].max(), y[2 * len(y) // 3 : 5 * len(y) // 6].max()
    assert (late > early) == grows
    assert 'where the line of "f" turns that is not proven' in run.summary


def test_a_turning_line_with_friction_is_named_once(run_deck):
    deck = TURNING_GUIDE.format("slider").replace("type='slider'", "type='slider' friction=0.1")
    run = run_deck(deck + march("t_end=1e-3 step=1e-3 output_step=1e-3"))
    assert run.summary.count("turns that is not proven") == 1


def test_a_step_that_fails_is_divided_and_the_summary_says_so(run_deck):
    """Near its dead points a rigid slider-crank cannot be solved in steps of three quarters of a radian."""
    deck = CRANK.format(young="2.1e10", elements=1, ghm="").replace("position=", "flexible=.false. position=")
    run = run_deck(deck + march("t_end=0.15 step=1.5e-2 output_step=1.5e-2"))
    assert run.transient["rejected"] > 0
    assert "the step was halved" in run.summary
    assert run.energy["position_violation"].max() < 1e-12


def test_counts_of_a_smooth_run(run_deck):
    """Two Newton iterations a step, one factorisation a body, no evaluation beside the rows'."""
    text = CRANK.format(young="2.1e10", elements=32, ghm="ghm_alpha=0.5 ghm_zeta=1.0 ghm_omega=5e3")
    run = run_deck(text + march("t_end=0.01 step=1e-5 output_step=1e-3"))
    assert run.transient["steps"] == 1000
    assert run.transient["newton_iterations"] <= 2100
    assert run.transient["constant_factorisations"] == 1
    assert run.transient["exact_factorisations"] == 0
    assert run.transient["evaluations"] < 50


def stopped(command, folder):
    """Run until rows are written, then interrupt: whether the run was still going on (None where it was not)."""
    shutil.rmtree(folder / "results", ignore_errors=True)
    job = subprocess.Popen(command, cwd=folder, stderr=subprocess.DEVNULL)
    wait_for(folder / "results" / "scene" / "history.txt", job)
    time.sleep(0.03)
    job.send_signal(signal.SIGINT)
    status = job.wait(timeout=TIMEOUT)
    assert status in (0, 128 + signal.SIGINT)
    return True if status else None


def test_an_interrupted_run_continues_bit_for_bit(biela, tmp_path):
    deck = (REFERENCE / "four_bar" / "deck.nml").read_text(encoding="utf-8").split("&transient")[0]
    deck += march("t_end=0.05 step=2e-6 output_step=4e-4")
    texts = []
    for interrupted in (False, True):
        folder = tmp_path / str(interrupted)
        folder.mkdir()
        (folder / "scene.nml").write_text(deck, encoding="utf-8")
        command = [str(biela), "--quiet", "scene.nml"]
        if interrupted:
            caught(lambda command=command, folder=folder: stopped(command, folder))
            command.insert(1, "--restart")
        subprocess.run(command, cwd=folder, check=True, capture_output=True)
        results = folder / "results" / "scene"
        summary = (results / "summary.txt").read_text(encoding="utf-8")
        kept = [line for line in summary.splitlines() if not line.strip().startswith("timing:")]
        texts.append([(results / f"{n}.txt").read_bytes() for n in ("history", "energy")] + [kept])
    assert texts[0] == texts[1]


def test_singular_positions_with_a_dependent_row_are_passed_with_order_two(run_deck):
    """Two four-bars through all their change points: end values of the exact reduction."""
    deck = row_of_four_bars(2)
    errors = []
    for step in (1e-3, 5e-4):
        run = run_deck(deck + march(f"t_end=10.0 step={step} output_step=0.01"), name=f"s{step}")
        errors.append(abs(run.history["b.x"][-1] - 0.3284581115347))
        assert run.energy["position_violation"].max() < 1e-12
    assert errors[1] < 1e-5
    assert np.log2(errors[0] / errors[1]) > 1.9


@pytest.mark.parametrize("bars", [1, 4, 6])
def test_many_rows_may_become_dependent_at_once(bars, run_deck):
    """Six four-bars in line at other speeds: the energy is kept through the change points."""
    run = run_deck(row_of_four_bars(bars, 1.37) + march("t_end=3.0 step=1e-3 output_step=0.01"))
    assert np.abs(run.energy["residual"]).max() < 5e-5 * run.energy["kinetic"].max()


def test_a_body_at_rest_stays_there(run_deck):
    """All corrections are zero: no contraction can be measured from them."""
    deck = "&scene /\n&body name='a' kind='rigid' mass=1.0 inertia=0.1 /\n"
    deck += "&sensor name='p' quantity='position' body='a' point=0.0,0.0 /\n"
    run = run_deck(deck + "&transient t_end=0.1 method='generalized_alpha' step=1e-2 output_step=1e-2 /\n")
    assert not run.history["p.x"].any()
