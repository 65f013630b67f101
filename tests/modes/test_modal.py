"""Modes: closed forms of beams, GHM poles, mechanisms against an independent dense computation, large and special systems.

Largest relative error of the first three bending frequencies against the closed forms, Euler-Bernoulli beams of n elements:

    n   pinned-pinned  clamped-free  clamped-pinned  free-free
    8   1.3e-03        6.1e-04       1.8e-03         2.1e-03
    16  8.3e-05        4.0e-05       1.1e-04         1.5e-04
    32  5.2e-06        2.5e-06       7.2e-06         9.6e-06
"""

import numpy as np
import pytest
from conftest import ROOT
from linear_oracle import LinearOracle, TurningArm, settle
from linear_scenes import (
    AREA,
    DENSITY,
    ENDS,
    GHM,
    HELD,
    LENGTH,
    REAL,
    UNDAMPED,
    UNIT,
    VIBRATION,
    Modes,
    beam,
    closed_mechanism,
    spinning_arm,
)
from oracle_probe import Twins

ROOTS = {
    "pinned-pinned": np.pi * np.array([1.0, 2.0, 3.0]),
    "clamped-free": np.array([1.87510406871196, 4.69409113297417, 7.85475743823761]),
    "clamped-pinned": np.array([3.92660231204792, 7.06858274562873, 10.21017612281303]),
    "free-free": np.array([4.73004074486270, 7.85320462409584, 10.9956078380017]),
}


@pytest.fixture
def modes_of(run_deck):
    """Return a function that runs a deck and returns its modes."""
    return lambda deck, **options: Modes(run_deck(deck, **options))


def bending(modes, count):
    """Return the lowest bending frequencies: those of modes with transverse motion [rad/s]."""
    shape = np.array([modes.table[name] for name in modes.table.names if name.startswith("b.") and ".y." in name])
    chosen = (modes.kind == UNDAMPED) & (np.abs(shape).max(axis=0) > 0.1) & (modes.poles.imag > 1e-3)
    return modes.poles[chosen].imag[:count]


# ---------------------------------------------------------------- closed forms


@pytest.mark.parametrize("ends", sorted(ENDS))
def test_euler_bernoulli_frequencies_converge_with_order_four(modes_of, ends):
    exact = ROOTS[ends] ** 2 * UNIT
    errors = []
    for elements in (8, 16, 32, 64):
        found = bending(modes_of(beam(elements, ends, modes=8), name=f"n{elements}"), 3)
        errors.append(np.max(np.abs(found / exact - 1.0)))
    theory = (ROOTS[ends][2] / 64) ** 4 / 1440.0  # of the element: its leading error
    assert errors[-1] == pytest.approx(theory, rel=0.02)
    order = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all((order > 3.6) & (order < 4.2)), errors


def test_a_free_beam_has_three_rigid_motions(modes_of):
    modes = modes_of(beam(6, "free-free", modes=5))
    assert np.all(modes.poles[:3] == 0.0)
    assert modes.poles[3].imag > 100.0


@pytest.mark.parametrize(("ratio", "root"), [(0.1, 1.7227415205933), (1.0, 1.2479174096065), (10.0, 0.73578191938965)])
def test_tip_mass(modes_of, ratio, root):
    mass = ratio * DENSITY * AREA * LENGTH
    found = bending(modes_of(beam(24, rest=f"&lump body='b' node=-1 mass={mass:.17g} /\n")), 1)
    assert found[0] == pytest.approx(root**2 * UNIT, rel=1e-7)


# ---------------------------------------------------------------- GHM


@pytest.mark.parametrize("terms", sorted(GHM))
def test_each_bending_mode_of_a_ghm_beam_solves_its_own_equation(modes_of, terms):
    modes = modes_of(beam(6, "pinned-pinned", GHM[terms], modes=4))
    values = {word.split("=")[0]: np.array(word.split("=")[1].split(","), float) for word in GHM[terms].split()}
    alpha, zeta, omega = (values[f"ghm_{name}"] for name in ("alpha", "zeta", "omega"))
    undamped = modes.undamped()
    for mode in range(4):
        mine = (modes.table["mode"] == mode + 1) & (modes.kind != UNDAMPED)
        poles = modes.poles[mine]
        for s in poles:
            ratio = (s**2 + 2 * zeta * omega * s) / (s**2 + 2 * zeta * omega * s + omega**2)
            parts = np.abs(s) ** 2 + undamped[mode] ** 2 * (1 + np.sum(alpha * np.abs(ratio)))
            assert abs(s**2 + undamped[mode] ** 2 * (1 + alpha @ ratio)) < 1e-9 * parts
        assert np.sum(np.where(np.abs(poles.imag) > 0, 2, 1)) == 2 + 2 * terms
        gaps = np.abs(poles[:, None] - poles) + np.diag(np.full(len(poles), np.inf))
        assert gaps.min() > 1e-6 * np.abs(poles).max(), "a pole stands there twice"


OSCILLATOR = """&scene title='one degree of freedom' /
&body name='m' kind='rigid' mass=2.0 inertia=0.1 position=1.0,0.0 /
&joint name='rail' type='prismatic' body_a='m' direction=0.0 /
&spring name='k' type='linear' body_a='m' stiffness=2.0e6 {ghm} /
&modal modes=3 /
"""


@pytest.mark.parametrize(
    ("ghm", "expected"),
    [
        ("0.5,2,1000", [-41.2761318281638 + 1231.26810998151j, -176.108304497853, -3741.33943184582]),
        ("0.2,0.7,500", [-10.9650453313832 + 1110.01284615174j, -339.034954668617 + 296.540746077802j]),
    ],
)
def test_closed_form_roots_of_one_degree_of_freedom(modes_of, ghm, expected):
    alpha, zeta, omega = ghm.split(",")
    modes = modes_of(OSCILLATOR.format(ghm=f"ghm_alpha={alpha} ghm_zeta={zeta} ghm_omega={omega}"))
    assert modes.undamped() == pytest.approx([1000.0], rel=1e-14)
    found = sorted(modes.damped(), key=lambda s: s.real)
    np.testing.assert_allclose(found, sorted(expected, key=lambda s: s.real), rtol=1e-13)


def test_over_damped_vibration_is_listed_as_real_poles(modes_of):
    modes = modes_of(OSCILLATOR.replace("{ghm}", "damping=1.0e4"))
    assert np.all(modes.kind[1:] == REAL)
    np.testing.assert_allclose(np.sort(modes.damped().real), -2500.0 + np.array([-1, 1]) * np.sqrt(2500.0**2 - 1e6), rtol=1e-12)


# ---------------------------------------------------------------- mechanisms


def paired(found, expected, count):
    """Return the largest relative distance of `found` poles to the nearest of `expected`, each of those taken once."""
    left, worst = list(expected), 0.0
    for s in found[:count]:
        k = int(np.argmin(np.abs(np.array(left) - s)))
        worst = max(worst, abs(left.pop(k) - s) / abs(s))
    return worst


@pytest.mark.parametrize("hold", sorted(HELD))
@pytest.mark.parametrize("angle", [0.4, 3.5])
@pytest.mark.parametrize("kind", ["four_bar", "slider_crank"])
def test_mechanisms_against_an_independent_null_space_computation(modes_of, probe, tmp_path, kind, angle, hold):
    deck = closed_mechanism(kind, angle) + HELD[hold].format(angle=angle)
    modes = modes_of(deck + "&modal modes=8 /\n")
    oracle = LinearOracle(Twins(probe, tmp_path, deck).oracle)
    expected = oracle.frequencies()
    found = modes.undamped()
    first = 1 if hold == "free" else 0
    assert np.all(found[:first] == 0.0)
    np.testing.assert_allclose(found[first:], expected[first : len(found)], rtol=1e-6)
    poles = oracle.poles()
    assert paired(modes.poles[modes.kind == VIBRATION], poles, 8) < 1e-6
    assert paired(modes.damped(), poles, 99) < 2e-5


@pytest.mark.parametrize("kind", ["four_bar", "slider_crank"])
def test_modes_about_a_loaded_equilibrium(modes_of, probe, tmp_path, kind):
    loads = "&scene title='t' gravity=0.0,-9.81 /\n&force name='push' type='force' body='crank' point=0.1,0.0 fx=3.0 fy=-20.0 /\n"
    if kind == "slider_crank":
        loads = loads.replace("point=0.1,0.0", "node=-1")
    deck = loads + closed_mechanism(kind, 0.9) + HELD["spring"]
    modes = modes_of(deck + "&static /\n&modal modes=6 /\n")
    twins = Twins(probe, tmp_path, deck)
    oracle = settle(twins.oracle, twins.q0)
    np.testing.assert_allclose(modes.undamped(), oracle.frequencies()[:6], rtol=1e-6)
    assert paired(modes.poles[modes.kind == VIBRATION], oracle.poles(), 6) < 1e-6


MIXED = """&material name='soft' density=2500.0 young=5.8e7 rayleigh_mass=3.0
  ghm_alpha=3.0,0.6 ghm_zeta=1.3,0.5 ghm_omega=940.0,94.0 /
&material name='firm' density=2500.0 young=2.5e8 ghm_alpha=0.1 ghm_zeta=2.0 ghm_omega=190.0 /
&section name='a' area=6.8e-5 inertia=1.2e-9 /
&section name='b' shape='rectangle' width=0.0066 height=0.011 /
&body name='post' kind='beam' length=0.43 elements=1 material='firm' section='a' reference='clamped' angle=1.5 /
&body name='arm' kind='beam' length=0.48 elements=2 material='soft' section='a' reference='clamped' angle=-0.2 /
&body name='tree' kind='frame' node_x=0.0,0.1,0.3,0.1 node_y=0.0,0.2,0.2,0.4 element_nodes=1,2,2,3,2,4
  material='soft' section='a','b','a' reference='clamped' position=0.470432,-0.095361 angle=0.5 /
&lump body='arm' node=1 mass=0.05 inertia=5.0e-5 /
&joint name='foot' type='weld' body_a='post' node_a=1 /
&joint name='pin' type='revolute' body_a='arm' node_a=1 body_b='post' node_b=1 /
&joint name='graft' type='weld' body_a='tree' node_a=1 body_b='arm' node_b=-1 /
&spring name='hold' type='torsional' body_a='arm' node_a=1 body_b='post' stiffness=99.0 damping=0.0145
  ghm_alpha=0.5 ghm_zeta=0.4 ghm_omega=150.0 /
"""


def test_every_pole_of_a_scene_of_several_materials_is_found(modes_of, probe, tmp_path):
    """Modes of different damping mix: shapes with damping are far from the undamped ones, and poles lie close together."""
    modes = modes_of(MIXED + "&modal modes=99 /\n")
    oracle = LinearOracle(Twins(probe, tmp_path, MIXED).oracle)
    poles = oracle.poles()
    poles = poles[poles.imag >= 0.0]
    found = modes.damped()
    for zeta, omega in ((1.3, 940.0), (0.5, 94.0), (2.0, 190.0), (0.4, 150.0)):  # terms whose deformations stand still
        poles = poles[np.abs(poles**2 + 2 * zeta * omega * poles + omega**2) > 1e-5 * omega**2]
        found = found[np.abs(found**2 + 2 * zeta * omega * found + omega**2) > 1e-5 * omega**2]
    assert found.size == poles.size
    assert paired(found, poles, poles.size) < 1e-6
    assert len(set(modes.table["mode"][modes.kind == VIBRATION])) == (modes.kind == VIBRATION).sum()


FOUR = """&material name='m0' density=2100.0 young=7.6e7 ghm_alpha=0.2,0.49,0.053 ghm_zeta=1.0,0.34,2.0 ghm_omega=76.0,100.0,62.0 /
&material name='m1' density=2200.0 young=8.2e7 ghm_alpha=0.19,0.4 ghm_zeta=0.87,0.9 ghm_omega=510.0,1400.0 rayleigh_mass=2.7 /
&section name='s' shape='tube' outer=0.015 inner=0.0041 /
&body name='b0' kind='beam' length=0.39 elements=3 material='m1' section='s' reference='clamped' position=0.77,-1.1 angle=2.6 /
&joint name='j0' type='revolute' body_a='b0' node_a=3 point_b=0.55,-0.98 /
&spring name='t0' type='torsional' body_a='b0' stiffness=26.0 damping=0.011 /
&lump body='b0' node=2 mass=0.085 inertia=4.0e-5 /
&body name='b1' kind='beam' length=0.46 elements=3 material='m1' section='s' position=0.87,-0.4 angle=-2.8 /
&joint name='j1' type='revolute' body_a='b1' node_a=-1 point_b=0.43,-0.53 /
&spring name='t1' type='torsional' body_a='b1' node_a=4 stiffness=61.0 free_angle=-2.9 /
&body name='b2' kind='beam' length=0.39 elements=3 material='m0' section='s' reference='free' modes=2 position=0.67,0.74 angle=3.0 /
&joint name='j2' type='prismatic' body_a='b2' node_a=2 point_b=0.44,0.85 direction=-0.7 /
&spring name='p2' type='linear' body_a='b2' node_a=2 point_b=0.82,0.53 stiffness=660.0 /
&body name='b3' kind='frame' node_x=-0.16,0.0063,-0.14 node_y=0.18,0.28,0.14 element_nodes=2,1,3,2 material='m0' section='s'
  reference='clamped' modes=5 position=1.0,-0.18 angle=2.5 /
&joint name='j3' type='weld' body_a='b3' node_a=2 body_b='b1' node_b=1 /
&static /
"""


def test_all_modes_of_a_scene_are_found_whose_highest_ones_are_known_to_rounding_only(modes_of):
    """Frequencies apart by 1000: those of the highest modes go on changing by rounding while the lowest are settled."""
    modes = modes_of(FOUR + "&modal modes=200 /\n")
    assert modes.undamped().size == 28
    np.testing.assert_allclose(modes.undamped()[:8], modes_of(FOUR + "&modal modes=8 /\n", name="few").undamped(), rtol=1e-9)


TANGLED = """&scene gravity=0.838,-0.00438 /
&material name='m0' density=2820.0 young=3.92e8 ghm_alpha=2.77,0.548,1.18 ghm_zeta=0.994,1.92,0.243 ghm_omega=124.0,1110.0,364.0 /
&material name='m1' density=2660.0 young=1.43e8 ghm_alpha=0.0885,0.101,0.667 ghm_zeta=0.595,2.36,0.505 ghm_omega=212.0,40.5,773.0
  ghm_frequency_scale=0.809 rayleigh_mass=2.32 rayleigh_stiffness=1.04e-6 /
&section name='s0' shape='rectangle' width=0.0143 height=0.00788 /
&section name='s1' shape='tube' outer=0.0126 inner=0.00339 /
&body name='b0' kind='frame' node_x=0.228,0.0979,-0.0233 node_y=0.212,0.0401,0.227 element_nodes=2,1,2,3 material='m1','m0'
  section='s0' stiffening=.true. position=0.61,-0.105 angle=2.13 /
&joint name='j0' type='prismatic' body_a='b0' node_a=1 point_b=0.208,-0.0658 direction=0.391 /
&spring name='p0' type='linear' body_a='b0' node_a=1 point_b=0.671,0.124 stiffness=607.0 /
&body name='b1' kind='beam' length=0.563 elements=3 material='m0' section='s1' axial=.false. position=0.717,-0.000345 angle=2.1 /
&joint name='j1' type='revolute' body_a='b1' node_a=4 point_b=0.433,0.485 /
&spring name='t1' type='torsional' body_a='b1' node_a=4 stiffness=86.3 /
&body name='b2' kind='beam' length=0.529 elements=2 material='m0' section='s0' element_material='m1','m0'
  position=0.572,-0.00205 angle=1.76 /
&joint name='j2' type='prismatic' body_a='b2' node_a=2 body_b='b1' node_b=3 direction=2.53 /
&spring name='p2' type='linear' body_a='b2' node_a=2 point_b=0.489,-0.175 stiffness=514.0 /
&lump body='b2' node=2 mass=0.0679 /
&body name='b3' kind='rigid' mass=0.6 inertia=0.0467 position=0.372,0.0549 angle=0.687 /
&joint name='j3' type='revolute' body_a='b3' point_a=0.118,-0.17 body_b='b2' node_b=1 /
&spring name='t3' type='torsional' body_a='b3' body_b='b2' stiffness=17.9 damping=0.0169
  ghm_alpha=0.627,0.247 ghm_zeta=1.88,1.06 ghm_omega=383.0,270.0 /
&lump body='b3' point=-0.124,-0.041 mass=0.0748 /
&force name='f0' type='force' body='b1' node=2 fx=-2.49 fy=1.83 axes='body' history='h0' /
&force name='f1' type='torque' body='b3' moment=0.07 /
&force name='f2' type='force' body='b1' node=3 fx=-1.58 fy=-0.0624 axes='section' /
&history name='h0' kind='table' time=0.002,0.005,0.009,0.013,0.03 value=0.0907,0.916,-0.915,0.245,0.872 /
&static /
"""


def test_nothing_is_listed_that_is_no_pole(modes_of):
    """Real poles of one GHM term crowd together here; a search between them may settle at none of them."""
    modes = modes_of(TANGLED + "&modal modes=200 /\n")
    assert modes.damped().size > 90
    assert modes.table["residual"].max() < 1e-9


# ---------------------------------------------------------------- turning structures


@pytest.fixture(scope="module")
def rotating_table():
    """Return the published table by column name."""
    path = ROOT / "tests" / "reference" / "published" / "rotating_beam_table.csv"
    return np.genfromtxt(path, delimiter=",", names=True)


@pytest.mark.parametrize("eta", [0.0, 2.0, 4.0, 6.0, 8.0, 10.0])
def test_spinning_arm_follows_the_published_table(modes_of, rotating_table, eta):
    row = rotating_table[np.argmin(np.abs(rotating_table["eta"] - eta))]
    table = np.array([row["chord1"], row["chord2"], row["chord3"]])
    found = []
    for elements in (20, 40):
        deck, unit = spinning_arm(eta, 8000.0, elements)
        found.append(bending(modes_of(deck, name=f"n{elements}"), 3) / unit)
    coarse, fine = np.abs(np.array(found) / table - 1.0)
    assert np.all(fine < 2e-4)
    if eta > 0.0:
        assert np.all((coarse / fine > 3.5) & (coarse / fine < 8.0)), "the tension is constant in an element: order two"
    np.testing.assert_allclose((4 * found[1] - found[0]) / 3, table, rtol=8e-6)


def test_coriolis_coupling_with_stretch_lowers_the_frequency(modes_of, rotating_table):
    deck, unit = spinning_arm(2.0, 70.0)
    table = rotating_table["chord1"][rotating_table["eta"] == 2.0][0]
    assert 3.6196 < bending(modes_of(deck), 1)[0] / unit < table - 1e-3


@pytest.mark.parametrize("ghm", ["", GHM[2]])
def test_spinning_arm_against_differences_of_the_oracles_accelerations(modes_of, probe, tmp_path, ghm):
    deck = spinning_arm(4.0, 70.0, elements=2)[0].replace(" /\n&section", f" {ghm} /\n&section", 1)
    modes = modes_of(deck)
    arm = TurningArm(Twins(probe, tmp_path, deck).oracle)
    found = modes.poles[modes.kind == (VIBRATION if ghm else UNDAMPED)]
    assert np.max(np.abs(arm.state[: arm.n])) > 1e-5, "the arm is stretched"
    assert paired(found, np.linalg.eigvals(arm.slopes()), 3) < 1e-6


# ---------------------------------------------------------------- special and large systems


def test_two_equal_arms_keep_their_double_frequencies(modes_of):
    other = beam(8).replace("'b'", "'c'").replace("'one'", "'other'")
    body = "\n".join(line for line in other.splitlines() if line.startswith(("&body", "&joint")))
    alone = modes_of(beam(8, ghm=GHM[1]), name="alone")
    both = modes_of(beam(8, ghm=GHM[1], rest=body + "\n", modes=6), name="both")
    np.testing.assert_allclose(both.undamped(), np.repeat(alone.undamped(), 2), rtol=1e-10)
    np.testing.assert_allclose(both.poles[both.kind == VIBRATION], np.repeat(alone.poles[alone.kind == VIBRATION], 2), rtol=1e-10)


def test_redundant_joints_change_nothing(modes_of):
    twice = "&joint name='again' type='revolute' body_a='b' node_a=1 /\n"
    once = modes_of(beam(5, "pinned-pinned", GHM[2], modes=4), name="once")
    more = modes_of(beam(5, "pinned-pinned", GHM[2], rest=twice, modes=4), name="more")
    np.testing.assert_allclose(more.poles, once.poles, rtol=1e-10)


def test_spring_between_two_nodes_of_bodies_and_modal_bodies(modes_of):
    link = "&spring name='k' type='linear' body_a='b' node_a=-1 point_b=0.8,0.3 stiffness=5.0e3 damping=1.0 /\n"
    nodal = modes_of(beam(4, ghm=GHM[1], rest=link, modes=3), name="nodal")
    reduced = beam(4, ghm=GHM[1], rest=link, modes=3).replace("reference='clamped' /", "reference='clamped' modes=12 /")
    whole = modes_of(reduced, name="reduced")
    np.testing.assert_allclose(whole.undamped(), nodal.undamped(), rtol=1e-9)
    np.testing.assert_allclose(whole.poles[whole.kind == VIBRATION], nodal.poles[nodal.kind == VIBRATION], rtol=1e-8)


def test_the_finest_mesh_does_not_lose_the_lowest_mode_to_rounding(modes_of):
    modes = modes_of(beam(400, ghm=GHM[1], modes=3))
    undamped = bending(modes, 3)
    np.testing.assert_allclose(undamped, ROOTS["clamped-free"] ** 2 * UNIT, rtol=1e-9)
    for s in modes.damped():
        ratio = 0.5 * (s**2 + 4000.0 * s) / (s**2 + 4000.0 * s + 1e6)
        parts = np.abs(s**2 + undamped**2 * (1.0 + ratio)) / (abs(s) ** 2 + undamped**2 * (1.0 + abs(ratio)))
        assert np.min(parts) < 1e-9


def test_large_systems_give_the_frequencies_of_the_closed_form(modes_of):
    found = bending(modes_of(beam(150, modes=12)), 3)
    np.testing.assert_allclose(found, ROOTS["clamped-free"] ** 2 * UNIT, rtol=1e-7)


def test_shapes_are_those_of_the_closed_form(modes_of):
    modes = modes_of(beam(16, "pinned-pinned"))
    stations = np.linspace(0.0, 1.0, 17)
    for mode in range(3):
        shape = np.array([modes.table[f"b.{k}.y.re"][mode] for k in range(1, 18)])
        sine = np.sin((mode + 1) * np.pi * stations)
        np.testing.assert_allclose(shape * np.sign(shape[1]), sine / np.abs(sine).max(), atol=2e-5)


def test_a_shape_that_moves_no_node_is_zero(modes_of):
    """One element on two hinges: its ends only turn, both ways alike or against one another."""
    modes = modes_of(beam(1, "pinned-pinned", modes=2))
    np.testing.assert_allclose(modes.poles.imag, np.sqrt([120.0, 2520.0]) * UNIT, rtol=1e-9)
    assert np.abs([modes.table[name] for name in modes.table.names if name.startswith("b.")]).max() < 1e-12


def test_more_modes_than_freedoms_are_listed_as_far_as_they_go(run_deck):
    run = run_deck(OSCILLATOR.format(ghm=""))
    assert len(Modes(run).poles) == 1
    assert "only 1 degrees of freedom" in run.summary
