"""Frequency responses: closed forms, the complex-modulus solution of textbook matrices, every kind of input and sensor."""

import numpy as np
import pytest
from conftest import ROOT
from linear_oracle import LinearOracle, TurningArm, settle
from linear_scenes import (
    AREA,
    DENSITY,
    FORCE,
    GHM,
    INERTIA,
    LENGTH,
    YOUNG,
    Response,
    beam,
    closed_mechanism,
    spinning_arm,
    sweep,
    textbook_cantilever,
)
from oracle_probe import Twins
from scipy.optimize import brentq

S1 = "ghm_alpha=0.5 ghm_zeta=2.0 ghm_omega=1000.0"


def modulus(s, alpha=(0.5,), zeta=(2.0,), omega=(1000.0,)):
    """Return E(s)/E_R."""
    return 1.0 + sum(a * (s**2 + 2 * z * w * s) / (s**2 + 2 * z * w * s + w**2) for a, z, w in zip(alpha, zeta, omega))


@pytest.fixture
def response_of(run_deck):
    """Return a function that runs a deck and returns its frequency response."""
    return lambda deck, **options: Response(run_deck(deck, **options))


# ---------------------------------------------------------------- closed forms


def tip_compliance(f, ratio):
    """Return W/F 3 E_R I/L^3 of a cantilever at f [Hz]; ratio is rho A L^4/(E_R I)."""
    e = modulus(2j * np.pi * f)
    x = (ratio * (2 * np.pi * f) ** 2 / e) ** 0.25
    return 3 / e * (np.sin(x) * np.cosh(x) - np.cos(x) * np.sinh(x)) / (x**3 * (1 + np.cos(x) * np.cosh(x)))


def test_cantilever_against_the_published_closed_form(response_of):
    path = ROOT / "tests" / "reference" / "published" / "ghm_cantilever_frf_S1.csv"
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    ratio = brentq(lambda c: tip_compliance(80.0, c).real - table[5, 1], 5.9e-5, 6.05e-5, xtol=1e-19)
    np.testing.assert_allclose(tip_compliance(table[:, 0], ratio), table[:, 1] + 1j * table[:, 2], rtol=1e-9)
    deck = beam(60, ghm=S1).replace(f"young={YOUNG}", f"young={DENSITY * AREA * LENGTH**4 / (ratio * INERTIA):.17g}")
    scale = 3 * DENSITY * AREA * LENGTH / ratio
    grid = [f for f in table[:, 0] if f % 10 == 0]
    response = response_of(deck.replace("&modal modes=3 /\n", "") + FORCE + sweep(10.0, 1000.0, 100, "linear"))
    found = [response["tip.v"][np.argmin(np.abs(response.table["f"] - f))] * scale for f in grid if f >= 10]
    expected = [row[1] + 1j * row[2] for row in table if row[0] in grid and row[0] >= 10]
    errors = np.abs(np.array(found) - expected)
    assert len(expected) > 8
    assert np.max(errors) < 2e-6


@pytest.mark.parametrize(
    ("alpha", "zeta", "omega"),
    [
        ((0.5,), (2.0,), (1000.0,)),
        ((0.4, 0.9), (0.6, 1.0), (300.0, 4000.0)),
        ((0.2, 0.3, 0.4, 0.5, 0.6), (1, 2, 0.8, 3, 1.5), (60, 300, 1500, 8e3, 4e4)),
    ],
)
def test_ghm_beam_against_the_complex_modulus_solution(response_of, alpha, zeta, omega):
    words = (",".join(f"{float(x)!r}" for x in values) for values in (alpha, zeta, omega))
    ghm = "ghm_alpha={} ghm_zeta={} ghm_omega={}".format(*words)
    response = response_of(beam(5, ghm=ghm) + FORCE + sweep(0.5, 3000.0, 50))
    mass, stiffness = textbook_cantilever(5)
    force = np.zeros(len(mass))
    force[-2] = 1.0
    expected = np.array([np.linalg.solve(s**2 * mass + modulus(s, alpha, zeta, omega) * stiffness, force) for s in response.s])
    for column, name in ((-2, "tip.v"), (-1, "tip.r")):
        np.testing.assert_allclose(response[name], expected[:, column], rtol=1e-10)
    assert np.max(np.abs(response["tip.u"])) < 1e-15 * np.max(np.abs(response["tip.v"]))


BASE = """&scene title='shaken' /
&body name='m' kind='rigid' mass=2.0 inertia=0.1 position=1.0,0.0 /
&body name='table' kind='rigid' mass=5.0 inertia=0.1 /
&joint name='rail' type='prismatic' body_a='m' direction=0.0 /
&joint name='rail2' type='prismatic' body_a='table' direction=0.0 /
&history name='h' kind='sine' amplitude=0.001 frequency=3.0 /
&drive name='shaker' type='position' body_a='table' history='h' {rate} /
&spring name='k' type='linear' body_a='m' body_b='table' stiffness=2.0e6 damping=30.0 ghm_alpha=0.5 ghm_zeta=2.0 ghm_omega=1000.0 /
&sensor name='x' quantity='position' body='m' /
&sensor name='k' quantity='spring' spring='k' /
&sensor name='shaker' quantity='reaction' drive='shaker' /
"""


@pytest.mark.parametrize("rate", [False, True])
def test_base_excitation_by_a_drive_or_its_rate(response_of, rate):
    response = response_of(BASE.format(rate="rate=.true." if rate else "") + sweep(5.0, 800.0, 30, source="shaker"))
    s = response.s
    stiffness = 2.0e6 * modulus(s) + 30.0 * s
    base = 1 / s if rate else np.ones(len(s))
    mass = base * stiffness / (stiffness + 2.0 * s**2)
    np.testing.assert_allclose(response["x.x"], mass, rtol=1e-11)
    np.testing.assert_allclose(response["k.f"], stiffness * (mass - base), rtol=1e-10)
    np.testing.assert_allclose(response["shaker.fx"], s**2 * (5.0 * base + 2.0 * mass), rtol=1e-10)


def test_a_rate_has_no_response_at_rest(run_deck):
    run = run_deck(BASE.format(rate="rate=.true.") + sweep(0.0, 10.0, 5, "linear", "shaker"), expect=1)
    assert "shaker" in run.stderr
    assert "from > 0" in run.stderr


REST = "&history name='none' kind='polynomial' coefficients=0.0 /\n"
PUSH = """&force name='f' type='force' body='b' {place} fy=1.0 history='none' /
&sensor name='p' quantity='position' body='b' {place} /
"""
RIGID = "&body name='b' kind='rigid' mass=1.0 inertia=1.0 /\n"
MESH = """&material name='m' density=1000.0 young=1.0e9 /
&section name='s' shape='rectangle' width=0.02 height=0.02 /
&body name='b' kind='beam' length=1.0 elements={elements} material='m' section='s' angle=0.4 {rest} /
"""


@pytest.mark.parametrize(
    ("body", "place"),
    [(RIGID, ""), (MESH.format(elements=40, rest=""), "node=-1"), (MESH.format(elements=8, rest="modes=3"), "node=-1")],
    ids=["rigid", "mesh", "modes"],
)
def test_nothing_holds_a_free_body_at_rest(run_deck, body, place):
    """The stiffness is singular, exactly or but for rounding: no large number stands for the response that there is not."""
    deck = REST + body + PUSH.format(place=place)
    run = run_deck(deck + sweep(0.0, 10.0, 5, "linear", "f"), expect=1)
    assert "the frequency response is singular at 0 Hz" in run.stderr
    assert "outcome: done" not in run.summary
    run_deck(deck + sweep(1.0e-3, 10.0, 5, "linear", "f"))


def test_a_free_body_that_no_force_reaches_is_no_obstacle(response_of):
    held = "&spring name='k' type='linear' body_a='b' point_b=0.0,-1.0 stiffness=100.0 free_length=1.0 /\n"
    other = "&body name='free' kind='rigid' mass=1.0 inertia=1.0 position=3.0,0.0 /\n"
    response = response_of(REST + RIGID + held + other + PUSH.format(place="") + sweep(0.0, 10.0, 5, "linear", "f"))
    np.testing.assert_allclose(response["p.y"][0], 0.01, rtol=1e-12)


@pytest.mark.parametrize(("spacing", "ratios"), [("log", True), ("linear", False)])
def test_points_are_spaced_as_the_deck_says(response_of, spacing, ratios):
    f = response_of(beam(2, ghm=S1) + FORCE + sweep(2.0, 200.0, 11, spacing)).table["f"]
    assert (f[0], f[-1], len(f)) == (2.0, 200.0, 11)
    steps = f[1:] / f[:-1] if ratios else np.diff(f)
    np.testing.assert_allclose(steps, steps[0], rtol=1e-12)


# ---------------------------------------------------------------- every sensor, whole mechanisms

SENSORS = """&sensor name='pos' quantity='position' body='coupler' node=2 /
&sensor name='vel' quantity='velocity' body='coupler' node=2 /
&sensor name='acc' quantity='acceleration' body='rocker' node=2 /
&sensor name='com' quantity='acceleration' body='crank' point=0.05,0.01 /
&sensor name='ang' quantity='angle' body='crank' /
&sensor name='sec' quantity='angle' body='coupler' node=2 /
&sensor name='om' quantity='angular_velocity' body='rocker' node=-1 /
&sensor name='al' quantity='angular_acceleration' body='coupler' /
&sensor name='def' quantity='deflection' body='coupler' node=2 /
&sensor name='q3' quantity='coordinate' body='rocker' index=3 /
&sensor name='ra' quantity='reaction' joint='a' /
&sensor name='rc' quantity='reaction' joint='c' /
&sensor name='s' quantity='spring' spring='hold' /
&sensor name='t' quantity='spring' spring='tie' /
"""
TIES = """&spring name='hold' type='torsional' body_a='crank' stiffness=40.0 damping=0.01
  ghm_alpha=0.5 ghm_zeta=1.2 ghm_omega=300.0 /
&spring name='tie' type='linear' body_a='coupler' node_a=2 body_b='rocker' node_b=2 stiffness=900.0 damping=0.4 free_length=0.1 /
&history name='w' kind='sine' offset=1.0 amplitude=1.0 frequency=1.0 /
"""
INPUTS = {
    "force": "type='force' body='coupler' node=2 fx=4.0 fy=-7.0",
    "follower": "type='force' body='rocker' node=2 fx=4.0 fy=-7.0 axes='section'",
    "torque": "type='torque' body='crank' moment=0.8",
    "about": "type='torque_about' body='coupler' node=-1 centre=0.1,-0.2 moment=0.6",
}


def loaded_four_bar(source=""):
    """Return the deck under all inputs, of which one has a history; at t = 0 they are the same."""
    deck = "&scene title='t' gravity=0.0,-9.81 /\n" + closed_mechanism("four_bar", 0.9) + TIES + SENSORS
    histories = {source: " history='w'"}
    return deck + "".join(f"&force name='{k}' {INPUTS[k]}{histories.get(k, '')} /\n" for k in INPUTS)


@pytest.fixture(scope="module")
def four_bar_at_rest(probe, tmp_path_factory):
    """The linear oracle about the equilibrium."""
    twins = Twins(probe, tmp_path_factory.mktemp("at_rest"), loaded_four_bar())
    about = settle(twins.oracle, twins.q0)
    assert np.max(np.abs(about.scene.solve(0.0, about.q, about.zero, about.z, 0 * about.z)[0])) < 1e-6, "no equilibrium"
    return about


@pytest.mark.parametrize("kind", sorted(INPUTS))
def test_every_sensor_of_a_loaded_four_bar_against_the_oracle(four_bar_at_rest, response_of, probe, tmp_path, kind):
    deck, about = loaded_four_bar(kind), four_bar_at_rest
    scene = Twins(probe, tmp_path, deck).oracle
    response = response_of(deck + "&static tolerance=1.0e-12 /\n" + sweep(2.0, 400.0, 7, source=kind))
    moment = 1.0e-3 / (2 * np.pi)  # the factor is 1 + sin(2 pi t): its change over t is the input
    load = scene.load_forces(moment, about.q) - scene.load_forces(0.0, about.q)
    load = load / np.sin(2 * np.pi * moment)

    def columns(t, dq, dv, dz):
        values = scene.sensor_columns(t, about.q + dq, dv, about.z + dz, 0 * dz)
        return np.array([float(value) for value in values.values()])

    names = list(scene.sensor_columns(0.0, about.q, about.zero, about.z, 0 * about.z))
    none = (np.zeros(scene.nq), np.zeros(scene.nq), np.zeros(scene.nz))
    direct = (columns(moment, *none) - columns(-moment, *none)) / (2 * np.sin(2 * np.pi * moment))
    for k, s in enumerate(response.s):
        q, z = about.response(s, load)
        size = 1e-5 / np.max(np.abs(q))
        expected = direct.astype(complex)
        for factor in (1.0, 1j):
            part = [np.real(x / factor) * size for x in (q, s * q, z)]
            expected += factor * (columns(0.0, *part) - columns(0.0, *(-x for x in part))) / (2 * size)
        for name, value in zip(names, expected):
            group = [j for j, other in enumerate(names) if other.split(".")[0] == name.split(".")[0]]
            cancelled = 1e-6 * np.max(np.abs(direct[group]))  # accelerations: what is left of large forces in the oracle
            assert abs(response[name][k] - value) < 1e-5 * np.max(np.abs(expected[group])) + cancelled, (name, s)


def test_response_of_a_turning_arm_against_the_oracle(response_of, probe, tmp_path):
    deck = spinning_arm(6.0, 70.0, elements=2)[0].replace(" /\n&section", f" {GHM[2]} /\n&section", 1)
    deck += FORCE.replace("fy=1.0", "fx=0.5 fy=1.0 axes='body' history='sine'")
    deck += "&history name='sine' kind='sine' amplitude=1.0 frequency=1.0 /\n"
    arm = TurningArm(Twins(probe, tmp_path, deck).oracle)
    moment = 1.0e-4
    size = np.sin(2 * np.pi * moment)
    drive = (arm.rate(arm.state, moment) - arm.rate(arm.state, -moment)) / (2 * size)
    jacobian = arm.slopes()
    response = response_of(deck + sweep(1.0, 900.0, 12))
    for k, s in enumerate(response.s):
        expected = np.linalg.solve(s * np.eye(len(jacobian)) - jacobian, drive)[arm.n - 3 : arm.n]
        found = [response[f"tip.{name}"][k] for name in "uvr"]
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-7 * np.max(np.abs(expected)))


@pytest.mark.parametrize("bent", [False, True])
def test_internal_forces_balance_the_reaction(bent, response_of):
    """Of a straight beam, and of one that a static load has bent, whose shortening only the reaction knows."""
    internal = (
        "&sensor name='root' quantity='internal' body='b' element=1 /\n&sensor name='wall' quantity='reaction' joint='one' /\n"
    )
    deck = beam(6, ghm=S1).replace(f"area={AREA} inertia={INERTIA}", "shape='rectangle' width=0.03 height=0.01")
    if bent:
        deck = deck.replace("elements=6", "elements=6 stiffening=.true.") + FORCE.replace("'tip'", "'load'").replace("1.0", "4.0")
        deck += "&static /\n"
    response = response_of(deck + FORCE + internal + sweep(1.0, 200.0, 5))
    assert abs(response["wall.m"]).max() > 3 * LENGTH  # inertia counts
    for part, of_wall in (("n", "fx"), ("q", "fy"), ("m1", "m")):
        scale = np.abs(response[f"wall.{of_wall}"]).max()
        np.testing.assert_allclose(
            response[f"root.{part}"], -response[f"wall.{of_wall}"], rtol=0, atol=(1e-4 if bent else 1e-9) * max(scale, 1.0)
        )
    bend = response["root.m1"] * 6 / (0.03 * 0.01**2)
    pull = response["root.n"] / (0.03 * 0.01)
    np.testing.assert_allclose(response["root.top"], pull - bend, rtol=1e-9, atol=1e-9 * np.abs(bend).max())


def test_redundant_joints_share_their_reaction(response_of):
    twice = "&joint name='again' type='weld' body_a='b' node_a=1 /\n"
    sensors = "&sensor name='one' quantity='reaction' joint='one' /\n"
    alone = response_of(beam(3, ghm=S1) + FORCE + sensors + sweep(2.0, 300.0, 6), name="alone")
    deck = beam(3, ghm=S1, rest=twice) + FORCE + sensors + sensors.replace("'one'", "'again'")
    both = response_of(deck + sweep(2.0, 300.0, 6), name="both")
    for name in ("fy", "m"):
        np.testing.assert_allclose(both[f"one.{name}"], alone[f"one.{name}"] / 2, rtol=1e-7)
        np.testing.assert_allclose(both[f"again.{name}"], alone[f"one.{name}"] / 2, rtol=1e-7)


def test_redundant_drive_cannot_be_the_input(run_deck):
    deck = BASE.format(rate="") + "&drive name='twin' type='position' body_a='table' history='h' /\n"
    run = run_deck(deck + sweep(5.0, 50.0, 3, source="twin"), expect=None)
    other = run_deck(deck + sweep(5.0, 50.0, 3, source="shaker"), expect=None, name="other")
    assert {run.status, other.status} == {0, 1}
    assert "redundant" in run.stderr + other.stderr


def test_long_fine_beam_costs_memory_in_proportion(run_deck):
    kilobytes = []
    for elements in (100, 200):
        ghm = "ghm_alpha=0.5,0.3,0.2 ghm_zeta=2.0,0.7,1.0 ghm_omega=1000.0,5000.0,300.0"
        run = run_deck(beam(elements, ghm=ghm, modes=20) + FORCE + sweep(1.0, 1000.0, 50), name=f"n{elements}")
        line = next(line for line in run.summary.splitlines() if "matrices:" in line)
        kilobytes.append(float(line.split("matrices:")[1].split()[0]))
    assert kilobytes[1] < 2.1 * kilobytes[0]
    # at least, of 600 coordinates: 16 diagonals (with room for pivots), 3 columns of the frame and 3 of the joint on either side
    assert kilobytes[1] > 16 * 600 * (16 + 2 * 6) / 1024


def test_about_keeps_the_present_state_of_a_linear_oracle(probe, tmp_path):
    deck = closed_mechanism("four_bar", 0.9) + TIES.replace("free_length=0.1", "")
    oracle = LinearOracle(Twins(probe, tmp_path, deck).oracle)
    assert np.allclose(oracle.mass, oracle.mass.T)
    k = oracle.relaxed_stiffness()
    assert np.max(np.abs(k - k.T)) < 1e-6 * np.max(np.abs(k))
