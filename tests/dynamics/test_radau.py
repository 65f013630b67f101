"""method='radau': order 5 of every column, tolerances that are kept, L-stability, evaluations beside scipy's Radau, energies."""

import re
import subprocess

import numpy as np
import pytest
from biela.compare import differences
from biela.histories import read
from conftest import REFERENCE, ROOT
from failing_scenes import BENT, PULL, failed
from four_bars import four_bars, reduced_four_bars, row_of_four_bars
from scipy.integrate import Radau
from scipy.linalg import expm

# Two steps between which every column above the reference's own error falls with order 5.
STEPS = {
    "vrl_elastic": (1e-5, 5e-6),
    "vrl_ghm": (1e-5, 5e-6),
    "vrl_torque_on_rod": (1e-5, 5e-6),
    "andrews": (1e-4, 5e-5),
    "viscoelastic_joint": (1.25e-3, 6.25e-4),
}
STRUCK = {"viscoelastic_joint": ["damper.f"]}  # axial vibrations of the start, which these steps do not resolve
TOLERANCES = [
    *[(scene, tolerance) for scene in ("vrl_elastic", "vrl_ghm", "vrl_torque_on_rod") for tolerance in (1e-4, 1e-6)],
    *[(scene, tolerance) for scene in ("andrews", "viscoelastic_joint", "spin_up") for tolerance in (1e-4, 1e-6, 1e-8)],
    ("vrl_torque_on_rod", 1e-8),
    ("four_bar", 1e-4),
]
UNHEARD = {"four_bar": ["rocker_q3.qdd"]}  # a vibration of 1e-9 m far above all others, which shows in its acceleration alone


@pytest.fixture
def errors(run_deck):
    """Return a function: errors by column, over its range, of a scene run with the given words."""

    def measure(scene, words):
        deck = (REFERENCE / scene / "deck.nml").read_text(encoding="utf-8")
        deck, count = re.subn(r"method='rk4' step=\S+", f"method='radau' {words}", deck)
        assert count == 1
        run = run_deck(deck, name=f"{scene}_{words.split('=')[1]}")
        return {d.name: d.error for d in differences(run.history, read(REFERENCE / scene / "expected.csv"))}

    return measure


@pytest.mark.parametrize("scene", STEPS)
def test_order_five_of_every_column(scene, errors):
    coarse, fine = (errors(scene, f"step={step}") for step in STEPS[scene])
    seen = [column for column in fine if fine[column] > 1e-8 and column not in STRUCK.get(scene, [])]
    assert len(seen) >= 4
    for column in seen:
        assert 4.6 < np.log2(coarse[column] / fine[column]) < 5.4, column


@pytest.mark.parametrize(("history", "low", "high"), [("0,0,0,0,1e8", 3.0, 5.2), ("1", 0.7, 2.0)])
def test_order_of_a_fine_beam_is_that_of_its_start(history, low, high, run_deck):
    """A torque that begins as t^4, and one that jumps: the modes that it sets off fall as the power 3/2 of their frequencies."""
    deck = f"""&material name='m' density=2700 young=7e10 /
&section name='s' shape='rectangle' width=0.01 height=0.01 /
&body name='b' kind='beam' length=0.5 elements=32 material='m' section='s' /
&joint name='j' type='revolute' body_a='b' node_a=1 /
&history name='h' kind='polynomial' coefficients={history} /
&force name='f' type='torque' body='b' node=1 moment=1 history='h' /
&sensor name='tip' quantity='position' body='b' node=-1 /
&sensor name='mid' quantity='deflection' body='b' node=17 /
&sensor name='turn' quantity='angular_velocity' body='b' /
&sensor name='pin' quantity='reaction' joint='j' /
&transient t_end=0.01 output_step=1e-3 method='radau' step={{}} /
"""
    coarse, fine, truth = (run_deck(deck.format(step), name=f"h{step}").history for step in (1e-3, 6.25e-5, 7.8125e-6))
    columns = ["tip.y", "mid.v", "turn", "pin.fy"] if high > 3 else ["tip.y", "mid.v"]
    for column in columns:
        a, b = (np.abs(x[column] - truth[column]).max() for x in (coarse, fine))
        assert low < np.log2(a / b) / 4 < high, column


@pytest.mark.parametrize(("scene", "tolerance"), TOLERANCES)
def test_every_column_keeps_within_a_hundred_tolerances(scene, tolerance, errors):
    found = errors(scene, f"tolerance={tolerance}")
    bad = {column: error for column, error in found.items() if error > 100 * tolerance}
    assert [column for column in bad if column not in UNHEARD.get(scene, [])] == []


SWING = """&joint name='j' type='revolute' body_a='b' {near} /
&sensor name='p' quantity='position' body='b' {far} /
&sensor name='w' quantity='angular_velocity' body='b' /
&sensor name='a' quantity='angular_acceleration' body='b' /
&sensor name='r' quantity='reaction' joint='j' /
&transient t_end=0.5 output_step=0.05 method='radau' {words} /
"""
RIGID = (
    """&scene gravity=0.0,-9.81 /
&body name='b' kind='rigid' mass=0.05 inertia=1.0416666666666667e-3 com=0.25,0.0 /
"""
    + SWING
)
STIFF = (
    """&scene gravity=0.0,-9.81 /
&material name='m' density=1000.0 young=1.0e15 {terms} /
&section name='s' shape='rectangle' width=0.01 height=0.01 /
&body name='b' kind='beam' length=0.5 elements={elements} material='m' section='s' /
"""
    + SWING
)
NODES = {"near": "node_a=1", "far": "node=-1"}
FAST = "ghm_alpha=0.5 ghm_zeta=3.0 ghm_omega=1.7e6 prony_alpha=0.5 prony_tau=1.0e-7"  # poles up to 1e7 rad/s


@pytest.mark.parametrize(
    ("elements", "terms", "words"),
    [(512, "", "step=0.01"), (512, "", "tolerance=1e-3"), (4, FAST, "step=0.01"), (4, FAST, "tolerance=1e-5")],
)
def test_steps_of_the_motion_whatever_vibrates_above_it(elements, terms, words, run_deck):
    """A swinging rod of E = 1e15: with 512 elements, and with poles of 1e7 rad/s, it moves as the rigid rod at its steps."""
    run = run_deck(STIFF.format(elements=elements, terms=terms, words=words, **NODES), name="stiff")
    rigid = run_deck(RIGID.format(words="tolerance=1e-9", near="", far="point=0.5,0.0"), name="rigid")
    for column in run.history.names[1:]:
        apart = np.abs(run.history[column] - rigid.history[column])[1:]  # the rod starts undeformed
        assert apart.max() <= 2e-3 * np.ptp(rigid.history[column]) + 1e-9, column
    assert run.transient["steps"] < 250


# a compound pendulum with a stiff linear damper-spring: one coordinate, written for scipy as its own equation
PENDULUM = """&scene gravity=0.0,-9.81 /
&body name='a' kind='rigid' mass=1.0 inertia=0.1 com=0.5,0.0 /
&joint name='o' type='revolute' body_a='a' /
&spring name='k' type='torsional' body_a='a' stiffness={k} damping={c} /
&sensor name='angle' quantity='angle' body='a' /
&transient t_end=2.0 output_step=2.0 method='radau' tolerance={tolerance} /
"""


class Counted:
    """The pendulum's equations, counting how often they are asked for."""

    def __init__(self, k, c):
        """Take the spring."""
        self.k, self.c, self.count = k, c, 0

    def __call__(self, _, y):
        """Return the rates."""
        self.count += 1
        return [y[1], (-self.k * y[0] - self.c * y[1] - 9.81 * 0.5 * np.cos(y[0])) / 0.35]

    def jacobian(self, _, y):
        """Return their derivatives."""
        return [[0.0, 1.0], [(-self.k + 9.81 * 0.5 * np.sin(y[0])) / 0.35, -self.c / 0.35]]


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize(("k", "c"), [(0.0, 0.0), (20.0, 0.2), (1e3, 200.0)])
def test_evaluations_beside_those_of_scipy(k, c, tolerance, run_deck):
    run = run_deck(PENDULUM.format(k=k, c=c, tolerance=tolerance))
    mine = run.transient["residual_evaluations"]
    equations = Counted(k, c)
    method = Radau(equations, 0.0, [0.0, 0.0], 2.0, rtol=tolerance, atol=tolerance * 1e-2, jac=equations.jacobian)
    while method.status == "running":
        method.step()
    assert mine <= 1.5 * equations.count
    exact = Counted(k, c)
    truth = Radau(exact, 0.0, [0.0, 0.0], 2.0, rtol=1e-9, atol=1e-10, jac=exact.jacobian)
    while truth.status == "running":
        truth.step()
    assert abs(run.history["angle"][-1] - truth.y[0]) < 100 * tolerance


# One body on one spring, with a GHM and a Maxwell term or without: wound or stretched and let go, or driven.
SPRING = """&body name='a' mass=0.07 inertia={inertia} angular_velocity={spin} /
&spring name='k' body_a='a' stiffness=8.0 {spring}
  {terms} /
&sensor name='x' quantity='{quantity}' body='a' /
&sensor name='a' quantity='{acceleration}' body='a' /
&transient t_end={end} output_step={end} method='radau' tolerance={tolerance} /
"""
ANGLES = {"quantity": "angle", "acceleration": "angular_acceleration", "inertia": 0.01}
PLACES = {"quantity": "position", "acceleration": "acceleration", "inertia": 0.07}
TAUT = "type='linear' point_b=-1.0,0.0 free_length=0.5"
TERMS = "ghm_alpha=0.5 ghm_zeta={zeta} ghm_omega=100.0 prony_alpha=0.3 prony_tau=1e-3"
LET_GO = {"end": 0.002, "zeta": 1.0, "terms": TERMS.format(zeta=1.0), "spin": 0.0}
LAGGING = {"end": 0.3, "zeta": 0.05, "terms": TERMS.format(zeta=0.05), "spin": 1.0, "spring": "type='torsional'", "inertia": 1e6}
STRAINED = [
    *[(ANGLES | LET_GO | {"spring": "type='torsional' free_angle=0.7"}, -0.7, tolerance) for tolerance in (1e-6, 1e-9, 1e-12)],
    (ANGLES | LET_GO | {"spring": "type='torsional' free_angle=0.7", "terms": ""}, -0.7, 1e-6),
    (ANGLES | LET_GO | {"spring": "type='torsional' free_angle=70.0"}, -70.0, 1e-12),
    (PLACES | LET_GO | {"spring": TAUT}, 0.5, 1e-12),
    *[(ANGLES | LAGGING, 0.0, tolerance) for tolerance in (1e-6, 1e-8)],
]


@pytest.mark.parametrize(("words", "strain", "tolerance"), STRAINED)
def test_steps_on_viscoelastic_springs_beside_those_of_scipy(words, strain, tolerance, run_deck):
    """At most twice as many and at least half, from the same first-order equations: x, v, both internal variables, one rate.

    The scale of a value is at least a millionth, that of a rate what moves a value by that in a step, as in the deck's measure.
    """
    run = run_deck(SPRING.format(tolerance=tolerance, **words))
    steps = int(re.search(r"steps: (\d+)", run.summary)[1])
    end, omega, mass = words["end"], 100.0, words["inertia"]
    rates = np.array(
        [
            [0.0, 1.0, 0.0, 0.0, 0.0],
            [-8.0 * 1.8 / mass, 0.0, 8.0 * 0.5 / mass, 8.0 * 0.3 / mass, 0.0],
            [0.0, 0.0, 0.0, 0.0, 1.0],
            [1e3, 0.0, 0.0, -1e3, 0.0],
            [omega**2, 0.0, -(omega**2), 0.0, -2 * words["zeta"] * omega],
        ]
    )  # x: the deformation
    start = np.array([strain, words["spin"], strain, strain, 0.0])
    least = tolerance * 1e-6
    scales = np.array([least, least * steps / end, least, least, least * steps / end])
    if not words["terms"]:
        rates[1, 0] = -8.0 / mass
        rates, start, scales = rates[:2, :2], start[:2], scales[:2]
    rest = np.array([strain, 0.0, 0.0, 0.0, 0.0])[: len(start)]  # the body's own coordinate starts at 0
    method = Radau(lambda _, y: rates @ (y + rest), 0.0, start - rest, end, rtol=tolerance, atol=scales, jac=rates)
    count = 0
    while method.status == "running":
        method.step()
        count += 1
    assert 0.5 * count <= steps <= 2.0 * count
    exact = expm(rates * end) @ start
    moved, pull = exact[0] - strain, rates[1] @ exact
    found = [run.history[name][-1] for name in run.history.names[1:]]
    assert abs(found[0] - moved) < 100 * tolerance * max(abs(moved), 1e-6) + 1e-15 * abs(strain)
    assert abs(found[len(found) // 2] - pull) < 100 * tolerance * max(abs(rates[1] @ start), abs(pull))


BEND = """&material name='m' density=1100.0 young=5e7 {terms} /
&section name='s' shape='rectangle' width=0.02 height=0.02 /
&body name='b' kind='beam' length=0.5 elements=3 material='m' section='s' reference='clamped' {modes} /
&joint name='w' type='weld' body_a='b' node_a=1 point_b=0.0,0.0 /
&force name='f' type='force' body='b' node=-1 fy=-0.5 stage='static' /
&sensor name='p' quantity='position' body='b' node=-1 /
&static /
&transient t_end=2e-3 output_step=2e-3 method='radau' tolerance=1e-11 /
"""


@pytest.mark.parametrize("modes", ["", "modes=3"])
def test_steps_of_a_bent_beam_let_go(modes, run_deck):
    """Terms with inertia and slow poles take as many steps as terms without: rounding of the bend sets none."""
    laws = {"ghm": "ghm_alpha=0.5 ghm_zeta=1.0 ghm_omega=100.0", "maxwell": "prony_alpha=0.5 prony_tau=0.02"}
    runs = {name: run_deck(BEND.format(terms=terms, modes=modes), name=name) for name, terms in laws.items()}
    steps = {name: int(re.search(r"\n  steps: (\d+)", run.summary)[1]) for name, run in runs.items()}
    assert steps["ghm"] < 1.2 * steps["maxwell"]


def test_energy_that_the_method_takes_out_is_told(run_deck):
    """Undamped vibrations that large steps damp: the residual is what the method says that it removed."""
    deck = (REFERENCE / "vrl_elastic" / "deck.nml").read_text(encoding="utf-8")
    run = run_deck(re.sub(r"method='rk4' step=\S+", "method='radau' step=2e-5", deck))
    residual, removed = run.transient["energy_residual_at_end"], run.transient["energy_removed"]
    assert removed > 0.0
    assert abs(residual + removed) < 0.1 * abs(residual)


@pytest.mark.parametrize("end", ["2.0,0.0", "0.0,2.0", ""])
def test_energy_taken_out_of_each_motion_of_a_rigid_body_is_told(end, run_deck):
    """A body with 2 J that vibrates at 10 rad/s along x, along y or turning."""
    spring = f"type='linear' point_b={end} stiffness=100.0 free_length=2.0" if end else "type='torsional' stiffness=100.0"
    rates = "velocity=2.0,0.0" if end.endswith(",0.0") else "velocity=0.0,2.0" if end else "angular_velocity=2.0"
    run = run_deck(
        f"&body name='b' mass=1.0 inertia=1.0 {rates} /\n&spring name='k' body_a='b' {spring} /\n"
        "&sensor name='b' quantity='position' body='b' /\n&transient method='radau' step=0.02 t_end=2.0 output_step=0.1 /\n"
    )
    residual, removed = run.transient["energy_residual_at_end"], run.transient["energy_removed"]
    assert removed > 0.0
    assert abs(residual + removed) < 0.02 * removed


@pytest.mark.parametrize("terms", ["prony_alpha=0.4,0.2 prony_tau=2e-4,1e-5", "ghm_alpha=0.4 ghm_zeta=2.0 ghm_omega=4e4"])
def test_energy_taken_out_of_internal_variables_is_told(terms, run_deck):
    """Fast terms and large steps: the residual is what the method says that it removed, of internal variables, too."""
    deck = (REFERENCE / "vrl_elastic" / "deck.nml").read_text(encoding="utf-8")
    deck = re.sub(r"(&material [^/]*)/", rf"\1 {terms} /", deck, count=1).replace("elements=2", "elements=2 axial=.false.")
    run = run_deck(re.sub(r"method='rk4' step=\S+", "method='radau' step=1e-5", deck))
    residual, removed = run.transient["energy_residual_at_end"], run.transient["energy_removed"]
    assert abs(residual + removed) < 0.01 * abs(residual)


def test_one_step_of_a_falling_body_makes_its_matrices_once(run_deck):
    run = run_deck(
        "&scene gravity=0.0,-9.81 /\n&body name='b' kind='rigid' mass=1.0 inertia=1.0 /\n"
        "&sensor name='b' quantity='position' body='b' /\n&transient method='radau' step=0.01 t_end=0.01 output_step=0.01 /\n"
    )
    assert run.transient["matrices"] == 1


def test_no_bound_applies(run_deck):
    run = run_deck(STIFF.format(elements=2, terms="", words="step=0.05", **NODES), name="bound")
    assert "this deck: radau, stable with any step" in run.summary


def test_a_damped_scene_at_a_tenth_of_the_evaluations_of_rk4(run_deck):
    """The viscoelastic slider-crank when its fast motion has died away: 1e-4 of positions."""
    deck = (ROOT / "input" / "slider_crank_viscoelastic.nml").read_text(encoding="utf-8")
    runs = {}
    for name, words in {"radau": "radau' tolerance=1e-2", "rk4": "rk4' step=9e-6", "truth": "radau' tolerance=1e-7"}.items():
        text = re.sub(r"&transient[^/]*/", f"&transient t_end=0.1 output_step=1e-3 method='{words} accept_unstable=.true. /", deck)
        runs[name] = run_deck(text, name=name)
    for column in ("pin.x", "pin.y", "rod"):
        truth = runs["truth"].history[column]
        for name in ("radau", "rk4"):
            assert np.abs(runs[name].history[column] - truth).max() < 1e-4 * np.ptp(truth), (name, column)
    assert 10 * runs["radau"].transient["residual_evaluations"] <= runs["rk4"].transient["evaluations"]


ARM = """&scene gravity=0.0,-9.81 /
&body name='b' mass=0.3 inertia=3e-3 com=0.1,0.0 /
&joint name='j' type='revolute' body_a='b' /
"""
ROD = "&joint name='k' type='distance' body_a='b' point_a=0.2,0.1 /\n"


def cranks(places, angle=-0.6, rate=0.0):
    """Return the deck of equal cranks on the ground at these places, with a coupler over all of them, from an angle on."""
    deck = "&scene gravity=0.0,-9.81 /\n"
    deck += f"&body name='c' mass=0.5 inertia=0.01 com=0.3,0.0 position={{0.2*cos({angle})}},{{0.2*sin({angle})}} "
    deck += f"velocity={{-0.2*{rate}*sin({angle})}},{{0.2*{rate}*cos({angle})}} /\n"
    n = len(places)
    for name, place in zip("bde", places):
        deck += f"&body name='{name}' mass={0.9 / n} inertia={9e-3 / n} com=0.1,0.0 position={place} angle={angle} "
        deck += f"angular_velocity={rate} /\n"
        deck += f"&joint name='j{name}' type='revolute' body_a='{name}' point_b={place} /\n"
        deck += f"&joint name='m{name}' type='revolute' body_a='c' point_a={place} body_b='{name}' point_b=0.2,0.0 /\n"
    return deck


IN_LINE = cranks(["0.0,0.0", "0.2,0.3"], 0.0, 8.0), cranks(["0.0,0.0", "0.6,0.0", "0.2,0.3"], 0.0, 8.0)
BESIDE_LINE = cranks(["0.0,0.0", "0.2,0.3"], 3.14, 8.0), cranks(["0.0,0.0", "0.6,0.0", "0.2,0.3", "0.4,-0.1"], 3.14, 8.0)
LEVEL = cranks(["0.0,0.0", "0.6,0.0"]), cranks(["0.0,0.0", "0.3,0.0", "0.6,0.0"])


@pytest.mark.parametrize(
    ("alone", "redundant", "tolerance"),
    [(ARM, ARM + ROD, 1e-11), (*LEVEL, 1e-8), (*LEVEL, 1e-11), (*IN_LINE, 1e-10), (*BESIDE_LINE, 1e-10)],
)
def test_redundant_rows_cost_no_steps(alone, redundant, tolerance, run_deck):
    """What they leave open of the multipliers must not grow: its rounding would be what Newton's method cannot solve."""
    rest = "&sensor name='a' quantity='angle' body='b' /\n"
    rest += f"&transient t_end=0.3 method='radau' tolerance={tolerance} output_step=0.02 /\n"
    one, two = run_deck(alone + rest, name="alone"), run_deck(redundant + rest, name="redundant")
    assert two.transient["steps"] < 1.1 * one.transient["steps"]
    np.testing.assert_allclose(two.history["a"], one.history["a"], atol=100 * tolerance)


@pytest.mark.parametrize(("bars", "tolerance"), [(2, 1e-6), (1, 1e-8), (3, 1e-8), (1, 1e-11)])
def test_change_points_by_tolerance(bars, tolerance, run_deck):
    """Four-bars in a row, all links in line twice a turn: the error falls with the tolerance, steps are as long as elsewhere."""
    deck = re.sub(r"method='rk4' step=\S+", f"method='radau' tolerance={tolerance}", four_bars(bars, t_end=2.0))
    run = run_deck(deck)
    exact, _ = reduced_four_bars(bars, run.history.time)
    error = np.hypot(run.history["b0.x"] - np.sin(exact), run.history["b0.y"] - np.cos(exact)).max()
    assert error < max(10 * tolerance, 1e-10)
    assert run.transient["rejected"] < 0.06 * run.transient["steps"]


def test_change_points_of_uneven_cranks_that_turn_with_their_ground(run_deck):
    """Reactions grow without bound there, and no link keeps its direction. Truth: the same by another method."""
    deck = "&scene gravity=0.0,-9.81 /\n&body name='g' mass=2.0 inertia=0.1 com=0.3,0.0 angle=0.3 angular_velocity=1.0 /\n"
    deck += "&joint name='g' type='revolute' body_a='g' /\n"
    turned = "position={%s*cos(0.3)+%s*cos(1.3)},{%s*sin(0.3)+%s*sin(1.3)}"
    deck += f"&body name='c' mass=0.5 inertia=0.01 com=0.3,0.0 {turned % (0, 0.2, 0, 0.2)} angle=0.3 angular_velocity=1.0 /\n"
    for name, place, inertia in (("b", 0.0, 3e-3), ("d", 0.6, 6e-3)):
        deck += f"&body name='{name}' mass=0.3 inertia={inertia} com=0.1,0.0 {turned % (place, 0, place, 0)} angle=1.3 "
        deck += "angular_velocity=13.0 /\n"
        deck += f"&joint name='j{name}' type='revolute' body_a='{name}' body_b='g' point_b={place},0.0 /\n"
        deck += f"&joint name='m{name}' type='revolute' body_a='c' point_a={place},0.0 body_b='{name}' point_b=0.2,0.0 /\n"
    deck += "&sensor name='a' quantity='angle' body='b' /\n"
    angles = {}
    for method, tolerance in (("dopri5", 1e-11), ("radau", 1e-8)):
        words = f"&transient t_end=0.5 method='{method}' tolerance={tolerance} output_step=0.02 /\n"
        angles[method] = run_deck(deck + words, name=method).history["a"]
    np.testing.assert_allclose(angles["radau"], angles["dopri5"], atol=1e-7)


@pytest.mark.parametrize("step", [1e-2, 2e-3])
@pytest.mark.parametrize("speed", [1.0, 1.37])
@pytest.mark.parametrize("bars", [2, 4])
def test_change_points_by_fixed_steps(bars, speed, step, run_deck):
    """Rows of four-bars that fall into line: no step ends the run, and the energy is kept."""
    run = run_deck(row_of_four_bars(bars, speed) + f"&transient t_end=4.0 method='radau' step={step} output_step=0.01 /\n")
    assert np.abs(run.energy["residual"]).max() < 3e-4 * run.energy["kinetic"].max()


@pytest.mark.parametrize(("steps", "word"), [("step=1e-3", '"pull" opens most'), ("tolerance=1e-5", 'body "a"')])
def test_a_drive_beyond_reach(steps, word, run_deck):
    """A point of the unit link pulled to x = 1.5 m: the run stops where the link is stretched and says so."""
    run, told = failed(run_deck, PULL + f"&transient t_end=0.2 method='radau' {steps} output_step=1e-2 /\n")
    assert 0.035 < run.history.time[-1] < 0.051
    assert word in told
    assert "drive" in told


def test_a_load_beyond_all_numbers(run_deck):
    """A load that grows to 1e59 N on a rod: refused steps become smaller until the run ends with its message."""
    _, told = failed(run_deck, BENT + "&transient t_end=1.0 method='radau' step=1e-3 output_step=1e-2 /\n")
    assert 'body "rod"' in told


@pytest.mark.parametrize("tolerance", [1e-4, 1e-8])
def test_the_first_step_is_short_beside_the_motion_at_the_start(run_deck, tolerance):
    """A disc that turns freely: the first step turns it by a small part of a radian whose fourth power is the tolerance."""
    run = run_deck(
        "&body name='d' mass=1.0 inertia=0.5 angular_velocity=100.0 /\n&joint name='j' type='revolute' body_a='d' /\n"
        f"&transient t_end=1.0 method='radau' tolerance={tolerance} output_step=1.0 /\n"
    )
    first = float(re.search(r"accepted steps from +(\S+) to", run.summary)[1])
    assert 0.0 < 100.0 * first <= tolerance**0.25


def first_error(mass, matrix, load, start, h, twice):
    """Return the estimate of Hairer & Wanner, IV.8, of a step of M x' = A x + f(t), filtered once or twice."""
    root = np.sqrt(6.0)
    a = np.array([
        [(88 - 7 * root) / 360, (296 - 169 * root) / 1800, (-2 + 3 * root) / 225],
        [(296 + 169 * root) / 1800, (88 + 7 * root) / 360, (-2 - 3 * root) / 225],
        [(16 - root) / 36, (16 + root) / 36, 1 / 9],
    ])  # fmt: skip
    n = len(start)
    known = np.concatenate([matrix @ start + load(c * h) for c in a.sum(1)])
    stages = h * np.kron(a, np.eye(n)) @ np.linalg.solve(np.kron(np.eye(3), mass) - h * np.kron(a, matrix), known)
    embedded = mass @ (np.array([-13 - 7 * root, -13 + 7 * root, -1.0]) @ stages.reshape(3, n)) / 3 / h + load(0.0)
    filtered = (3 - 3 ** (1 / 3) + 3 ** (2 / 3)) / h * mass - matrix
    error = np.linalg.solve(filtered, matrix @ start + embedded)
    return np.linalg.solve(filtered, matrix @ (start + error) + embedded) if twice else error


@pytest.mark.parametrize(("terms", "tolerance"), [(True, 1e-1), (False, 1e-12)])
@pytest.mark.parametrize("driven", [False, True])
def test_the_estimated_error_is_that_of_the_reference(driven, terms, tolerance, probe, tmp_path):
    """Of each unknown, internal variables too, at a step as long as the vibration is fast; the spring's other end is driven."""
    inertia, k, c, h, alpha, zeta, omega, tau = 0.3, 40.0, 0.7, 0.05, 0.8, 0.6, 30.0, 0.06
    deck = f"&body name='b' mass=1.0 inertia={inertia} angle=0.2 angular_velocity=2.0 /\n"
    if driven:
        deck += "&body name='d' mass=1.0 inertia=0.2 angular_velocity=0.5 /\n"
        deck += "&drive name='m' type='rotation' body_a='d' history='h' /\n"
        deck += "&history name='h' kind='polynomial' coefficients=0.0,0.5,3.0,4.0,40.0 /\n"
    words = f"ghm_alpha={alpha} ghm_zeta={zeta} ghm_omega={omega} prony_alpha=0.5 prony_tau={tau}" if terms else ""
    words += " body_b='d'" if driven else ""
    deck += f"&spring name='s' type='torsional' body_a='b' stiffness={k} damping={c} free_angle=0.7 {words} /\n"
    deck += "&sensor name='a' quantity='angle' body='b' /\n"
    deck += f"&transient t_end=1.0 method='radau' tolerance={tolerance} first_step={h} output_step=0.5 /\n"
    (tmp_path / "d.nml").write_text(deck, encoding="utf-8")
    done = subprocess.run([str(probe), "error", str(tmp_path / "d.nml")], check=True, capture_output=True, text=True)
    lines = [line.split() for line in done.stdout.splitlines()]
    found = np.array([float(x) for x in lines[0][1:]])
    assert (float(lines[1][1]) > 1.0) == (tolerance < 1e-6)
    # unknowns: angle of the driven body, its rate, the moment of the drive; angle of the other less that of rest, its rate, z of
    # the GHM term and of the Maxwell term, z' of the first
    stiff = k * (1 + 1.3 * terms)
    matrix = np.array([
        [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [-stiff, -c, 1.0, stiff, c, -k * alpha, -0.5 * k, 0.0],
        [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
        [stiff, c, 0.0, -stiff, -c, k * alpha, 0.5 * k, 0.0],
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0],
        [-1 / tau, 0.0, 0.0, 1 / tau, 0.0, 0.0, -1 / tau, 0.0],
        [-(omega**2), 0.0, 0.0, omega**2, 0.0, -(omega**2), 0.0, -2 * zeta * omega],
    ])  # fmt: skip
    mass = np.diag([1.0, 0.2, 0.0, 1.0, inertia, 1.0, 1.0, 1.0])
    start = np.array([0.0, 0.5, 0.0, -0.5, 2.0, -0.4, -0.4, 0.1])
    use = np.arange(0 if driven else 3, 8 if terms else 5)
    at = [5, 11, 0, 2, 8, 12, 13, 14] if driven else [0, 0, 0, 2, 5, 6, 7, 8]

    def load(t):
        return np.array([0.0, 0.0, -(0.5 + 6 * t + 12 * t**2 + 160 * t**3), 0.0, 0.0, 0.0, 0.0, 0.0])[use]

    expected = dict(zip(use, first_error(mass[np.ix_(use, use)], matrix[np.ix_(use, use)], load, start[use], h, not terms)))
    expected.pop(2, None)  # a moment has no tolerance
    assert sum(abs(x) < 1e-6 for x in expected.values()) == driven  # of the rate that is driven
    assert found[[at[k] for k in expected]] == pytest.approx(list(expected.values()), rel=1e-9, abs=1e-12)
