"""What a static analysis says: unstable equilibria with their growth rate, validity, prestress that grows by load steps."""

from __future__ import annotations

import json
import math
import re

import numpy as np
import pytest
from biela.histories import read

PENDULUM = """&scene title='inverted pendulum' gravity=0.0,-9.81 /
&body name='rod' kind='rigid' mass=1.0 inertia=0.1 com=0.5,0.0 angle=1.5707963267948966 /
&joint name='pin' type='revolute' body_a='rod' /
&spring name='k' type='torsional' body_a='rod' stiffness={stiffness} /
&static /
"""
COLUMN = """&scene title='column' /
&material name='m' density=1000.0 young=2.0e9 /
&section name='s' area=1.0e-4 inertia=8.0e-10 /
&body name='other' kind='beam' length=0.3 elements=2 material='m' section='s' reference='clamped' position=0.0,1.0 /
&joint name='o' type='weld' body_a='other' node_a=1 point_b=0.0,1.0 /
&body name='column' kind='beam' length=0.8 elements=4 material='m' section='s' reference='clamped' stiffening=.true. /
&joint name='w' type='weld' body_a='column' node_a=1 /
&force name='load' type='force' body='column' node=-1 fx={load!r} /
&sensor name='tip' quantity='deflection' body='column' node=-1 /
&static /
"""
EULER = math.pi**2 * 2.0e9 * 8.0e-10 / (4 * 0.8**2)  # of the cantilever [N]


def growth(run) -> float:
    """Return the growth rate that is told, 0 where none is."""
    told = re.search(r"static equilibrium is unstable.* grow at (\S+) 1/s", run.stderr)
    assert (told is None) == ("static equilibrium is unstable" not in run.summary)
    return float(told[1]) if told else 0.0


@pytest.mark.parametrize("stiffness", [0.0, 1.0, 4.8, 5.0, 20.0])
def test_an_inverted_pendulum_on_a_weak_spring(run_deck, stiffness):
    left = 9.81 * 0.5 - stiffness
    expected = math.sqrt(left / (0.1 + 0.25)) if left > 0 else 0.0
    deck = PENDULUM.format(stiffness=stiffness)
    run = run_deck("".join(line for line in deck.splitlines(True) if stiffness or "&spring" not in line))
    assert growth(run) == pytest.approx(expected, rel=2e-6)
    assert ('most of all of body "rod", grow' in run.stderr) == (left > 0)


@pytest.mark.parametrize("elements", [4, 60])
def test_the_fastest_of_many_growing_motions_is_told(run_deck, elements):
    """Elastic pendulums on their heads, all on springs too weak: more of them grow than a few lowest modes show."""
    deck = "&scene title='pendulums' gravity=0.0,-9.81 /\n&material name='m' density=7850.0 young=2.1e11 /\n"
    deck += "&section name='s' area=1.0e-4 inertia=1.0e-7 /\n"
    stiffness = (2.5, 1.5, 0.5, 3.0, 2.0, 1.0)
    for i, k in enumerate(stiffness):
        deck += f"&body name='rod{i}' kind='beam' length=1.0 elements={elements} material='m' section='s' position={i},0.0 "
        deck += f"angle={math.pi / 2!r} reference='clamped' /\n&joint name='pin{i}' type='revolute' body_a='rod{i}' node_a=1 "
        deck += f"point_b={i},0.0 /\n&spring name='k{i}' type='torsional' body_a='rod{i}' stiffness={k} /\n"
    run = run_deck(deck + "&static /\n&modal modes=6 /\n")
    rates = np.sqrt((7850.0 * 1e-4 * 9.81 / 2 - np.array(stiffness)) / (7850.0 * 1e-4 / 3))
    assert growth(run) == pytest.approx(rates.max(), rel=1e-4)
    assert '"rod2"' in run.stderr
    np.testing.assert_allclose(np.sort(read(run.folder, "modes")["real"][:6]), np.sort(rates), rtol=1e-4)


@pytest.mark.parametrize("share", [0.5, 0.98, 1.05, 2.0])
def test_a_column_beyond_its_buckling_load(run_deck, share):
    """The rate is the one at which a small push grows, and the body is named."""
    deck = COLUMN.format(load=-share * EULER)
    run = run_deck(deck)
    rate = growth(run)
    assert (rate > 0.0) == (share > 1.0)
    if not rate:
        return
    assert '"column", grow' in run.stderr
    assert '"other"' not in run.stderr
    push = "&force name='push' type='force' body='column' node=-1 fy=1.0e-9 stage='transient' /\n"
    time = 12.0 / rate
    motion = f"&transient t_end={time!r} method='generalized_alpha' step={time / 6000!r} output_step={time / 60!r} /\n"
    tip = run_deck(deck + push + motion, name="pushed").history["tip.v"]
    assert math.log(tip[-1] / tip[-11]) / (time / 6) == pytest.approx(rate, rel=2e-3)


@pytest.mark.parametrize(("speed", "unstable"), [(5.0, False), (30.0, True)])
def test_a_bob_that_turns_faster_than_its_spring_holds(run_deck, speed, unstable):
    """At rest seen from the table: k against m w^2 along the guide, where the Coriolis force goes into the guide."""
    deck = f"""&body name='table' kind='rigid' mass=1.0 inertia=0.1 angular_velocity={speed} /
&joint name='axle' type='revolute' body_a='table' /
&history name='h' kind='polynomial' coefficients={speed} /
&drive name='motor' type='rotation' body_a='table' history='h' rate=.true. /
&body name='bob' kind='rigid' mass=2.0 inertia=0.05 angular_velocity={speed} /
&joint name='guide' type='prismatic' body_a='bob' body_b='table' /
&spring name='k' type='linear' body_a='bob' body_b='table' stiffness=1000.0 free_length=0.0 /
&static /
"""
    expected = math.sqrt(speed**2 - 500.0) if unstable else 0.0
    run = run_deck(deck)
    assert growth(run) == pytest.approx(expected, rel=1e-6)
    assert ('"bob", grow' in run.stderr) == unstable


def test_a_large_deflection_is_told(run_deck):
    """A tip that sags by a fifth of the length leaves the linear floating frame; one that sags by a twentieth does not."""
    for share, told in ((0.05, False), (0.2, True)):
        deck = COLUMN.format(load=0.0) + (f"&force name='f' type='force' body='column' node=-1 fy={3 * 1.6 * share / 0.8**2!r} /\n")
        run = run_deck(deck, name=f"share{share}")
        assert ('in the static analysis body "column" deflects by' in run.stderr) == told
        assert ('in the static analysis body "column" deflects by' in run.summary) == told


TERMS = (
    "ghm_alpha=0.5,0.8 ghm_zeta=1.1,0.7 ghm_omega=60.0,300.0 prony_alpha=0.9 prony_tau=0.02",
    "prony_alpha=2.0,0.3 prony_tau=0.1,0.01",
)
# body and point of each end, stiffness, free length or angle (None: as assembled)
SPRINGS = {
    "s1": ("a", (0.1, 0.0), "", (1.0, 0.3), 90.0, 0.5),
    "s2": ("a", (-0.2, 0.1), "", (-0.7, 0.9), 120.0, None),
    "s3": ("c", (0.1, 0.1), "a", (-0.1, 0.2), 60.0, 0.0),
    "s4": ("c", (0.0, 0.0), "", (0.2, -0.8), 70.0, 1.1),
    "t1": ("c", None, "a", None, 5.0, 0.5),
    "t2": ("a", None, "", None, 4.0, None),
}
MASSES = {"a": (0.7, (0.05, -0.03)), "c": (0.4, (-0.1, 0.04))}
PAIR = """&scene title='pair' gravity=0.4,-9.81 /
&body name='a' mass=0.7 inertia=0.02 com=0.05,-0.03 position=0.1,0.2 angle=0.4 /
&body name='c' mass=0.4 inertia=0.01 com=-0.1,0.04 position=0.3,0.5 angle=-0.3 /
&joint name='p' type='revolute' body_a='c' point_a=-0.1,0.0 body_b='a' point_b=0.22455348276472328,0.26285639846290454 /
&force name='f' type='force' body='c' point=0.2,0.1 fx=1.0 fy=2.0 /
&force name='g' type='torque' body='a' moment=0.3 /
&force name='h' type='force' body='a' fx=3.0 stage='static' /
&force name='i' type='force' body='a' fx=3.0 stage='transient' /
&sensor name='p' quantity='reaction' joint='p' /
&static load_steps=3 tolerance=1e-12 /
&transient t_end=0.02 method='rk4' step=1e-4 output_step=0.01 /
"""


def at(row, body, point):
    """Return a point of a body, or of the ground, in a row of static.txt."""
    if not body:
        return np.array(point)
    c, s = np.cos(row[f"angle_{body}"]), np.sin(row[f"angle_{body}"])
    return np.array([row[f"{body}.x"], row[f"{body}.y"]]) + np.array([[c, -s], [s, c]]) @ point


def length(row, name):
    """Return the length of a linear spring, or the angle of a torsional one."""
    a, point_a, b, point_b, _, _ = SPRINGS[name]
    if point_a:
        return np.hypot(*(at(row, a, point_a) - at(row, b, point_b)))
    return row[f"angle_{a}"] - (row[f"angle_{b}"] if b else 0.0)


def test_each_load_step_is_an_equilibrium_of_that_part_of_loads_and_prestress(run_deck):
    """Free lengths and angles have gone that part of their way from the assembled ones; the run that follows rests."""
    deck = PAIR
    for k, (name, (a, point_a, b, point_b, stiffness, free)) in enumerate(SPRINGS.items()):
        deck += f"&spring name='{name}' body_a='{a}' stiffness={stiffness} damping={k} {TERMS[k % 2]} "
        deck += f"body_b='{b}' " if b else ""
        deck += f"type='{'linear' if point_a else 'torsional'}' "
        deck += f"point_a={point_a[0]},{point_a[1]} point_b={point_b[0]},{point_b[1]} " if point_a else ""
        deck += "" if free is None else f"free_{'length' if point_a else 'angle'}={free} "
        deck += f"/\n&sensor name='{name}' quantity='spring' spring='{name}' /\n"
    for body in "ac":
        deck += f"&sensor name='{body}' quantity='position' body='{body}' /\n"
        deck += f"&sensor name='angle_{body}' quantity='angle' body='{body}' /\n"
    run = run_deck(deck)
    table = read(run.folder, "static")
    start = {"a.x": 0.1, "a.y": 0.2, "angle_a": 0.4, "c.x": 0.3, "c.y": 0.5, "angle_c": -0.3}
    np.testing.assert_allclose(table["load"], [1 / 3, 2 / 3, 1])
    static = json.loads((run.folder / "summary.json").read_text())["static"]
    assert (static["load_steps"], static["newton_steps"]) == (3, table["newton_steps"].sum())
    for i, load in enumerate(table["load"]):
        row = {name: table[name][i] for name in table.names}
        pin, reaction = at(row, "c", (-0.1, 0.0)), np.array([row["p.fx"], row["p.fy"]])
        pushes = [(body, at(row, body, com), load * mass * np.array([0.4, -9.81])) for body, (mass, com) in MASSES.items()]
        pushes += [("c", at(row, "c", (0.2, 0.1)), load * np.array([1.0, 2.0])), ("a", at(row, "a", (0, 0)), [3.0 * load, 0.0])]
        pushes += [("c", pin, reaction), ("a", pin, -reaction)]
        moment = {"a": 0.3 * load, "c": row["p.m"], "": 0.0}
        for name, (a, point_a, b, point_b, stiffness, free) in SPRINGS.items():
            assembled = length(start, name)
            stretch = length(row, name) - assembled - load * ((assembled if free is None else free) - assembled)
            assert row[f"{name}.d"] == pytest.approx(stretch, abs=1e-9)
            assert row[f"{name}.f"] == pytest.approx(stiffness * stretch, abs=1e-7)
            if point_a:
                line = at(row, b, point_b) - at(row, a, point_a)
                line *= row[f"{name}.f"] / np.hypot(*line)
                pushes += [(a, at(row, a, point_a), line), (b, at(row, b, point_b), -line)]
            else:
                moment[a] -= row[f"{name}.f"]
                moment[b] += row[f"{name}.f"]
        for body in "ac":
            arms = [(point - at(row, body, (0, 0)), f) for on, point, f in pushes if on == body]
            np.testing.assert_allclose(sum(np.array(f) for _, f in arms), 0.0, atol=1e-8)
            assert moment[body] + sum(arm[0] * f[1] - arm[1] * f[0] for arm, f in arms) == pytest.approx(0.0, abs=1e-8)
    for name in run.history.names[1:]:
        np.testing.assert_allclose(run.history[name], table[name][-1], rtol=0, atol=1e-8, err_msg=name)
    stored = sum(0.5 * spring[4] * row[f"{name}.d"] ** 2 for name, spring in SPRINGS.items())
    for body, (mass, com) in MASSES.items():
        stored -= mass * at(row, body, com) @ [0.4, -9.81]
    np.testing.assert_allclose(run.energy["potential"], stored, rtol=1e-9)


@pytest.mark.parametrize("seed", range(16))
def test_random_chains_of_upright_and_hanging_links(run_deck, seed):
    """Growth rates are those of the chain's own small motions, M a'' + K a = 0 in the angles, derived here."""
    rng = np.random.default_rng(seed)
    links, gravity = rng.integers(1, 5), rng.uniform(1.0, 20.0)
    up = rng.choice([-1.0, 1.0], links)
    length, mass, inertia, spring = (10 ** rng.uniform(*x, links) for x in ((-1, 0.3), (-1, 1), (-3, 0), (-1, 2.3)))
    com = length * rng.uniform(0.2, 0.9, links)
    deck = f"&scene title='seed {seed}' gravity=0.0,{-gravity} /\n"
    m, k, y = np.diag(inertia), np.zeros((links, links)), 0.0
    for i in range(links):
        deck += f"&body name='b{i}' kind='rigid' mass={mass[i]} inertia={inertia[i]} com={com[i]},0.0 position=0.0,{y:.17g} "
        deck += f"angle={up[i] * math.pi / 2:.17g} /\n"
        on = f"body_b='b{i - 1}' point_b={length[i - 1]},0.0" if i else ""
        deck += f"&joint name='j{i}' type='revolute' body_a='b{i}' {on} /\n"
        other = f"body_b='b{i - 1}'" if i else ""
        deck += f"&spring name='k{i}' type='torsional' body_a='b{i}' {other} stiffness={spring[i]} /\n"
        y += up[i] * length[i]
        arm = np.zeros(links)  # height of the mass centre is sum(arm sin), its sideways motion -sum(arm a)
        arm[:i] = (up * length)[:i]
        arm[i] = up[i] * com[i]
        m += mass[i] * np.outer(arm, arm)
        k -= mass[i] * gravity * np.diag(arm)
        turn = np.zeros(links)
        turn[i] = 1.0
        if i:
            turn[i - 1] = -1.0
        k += spring[i] * np.outer(turn, turn)
    lowest = np.linalg.eigvals(np.linalg.solve(m, k)).real.min()
    expected = math.sqrt(max(0.0, -lowest))
    assert growth(run_deck(deck + "&static /\n")) == pytest.approx(expected, rel=1e-5), f"seed {seed}"


@pytest.mark.parametrize("seed", range(8))
def test_random_cantilevers_that_sag_are_told_of(run_deck, seed):
    """The tip sags by F l3/(3 E I), the end section turns by F l2/(2 E I); limits are a tenth of the length and 0.2 rad."""
    rng = np.random.default_rng(seed)
    length, young, inertia = 10 ** rng.uniform(-1, 1), 10 ** rng.uniform(8, 11), 10 ** rng.uniform(-12, -8)
    sag = rng.uniform(0.02, 0.25)
    force = 3 * young * inertia * sag / length**2
    deck = f"""&scene title='seed {seed}' /
&material name='m' density=1000.0 young={young} /
&section name='s' area=1.0e-5 inertia={inertia} /
&body name='b' kind='beam' length={length} elements={rng.integers(1, 9)} material='m' section='s' reference='clamped' /
&joint name='w' type='weld' body_a='b' node_a=1 /
&force name='f' type='force' body='b' node=-1 fy={force} /
&static /
"""
    run = run_deck(deck)
    for words, figure, limit in (("deflects by", 100 * sag, 10.0), ("turns a section by", 1.5 * sag, 0.2)):
        found = re.search(rf'in the static analysis body "b" {words} (\S+) ', run.stderr)
        assert (found is not None) == (figure > limit), f"seed {seed}"
        if found:
            assert float(found[1]) == pytest.approx(figure, rel=0.02), f"seed {seed}"


@pytest.mark.parametrize("seed", range(8))
def test_random_prestress_grows_by_load_steps(run_deck, seed):
    """Springs along a guide and about a pin: each row has its share of the displacement, also beside a force."""
    rng = np.random.default_rng(seed)
    ends, stiffness, free = rng.uniform(1, 2, 4) * [1, 1, -1, -1], 10 ** rng.uniform(1, 4, 4), rng.uniform(0.9, 1.1, 4)
    torsion, angle, force = 10 ** rng.uniform(0, 2, 3), rng.uniform(-1, 1, 3), rng.uniform(-5, 5)
    deck = f"&scene title='seed {seed}' /\n&body name='a' kind='rigid' mass=1.0 inertia=0.1 /\n"
    deck += "&joint name='g' type='prismatic' body_a='a' /\n&body name='t' kind='rigid' mass=1.0 inertia=0.1 position=0.0,9.0 /\n"
    deck += f"&joint name='p' type='revolute' body_a='t' point_b=0.0,9.0 /\n&force name='f' type='force' body='a' fx={force} /\n"
    for i in range(4):
        deck += f"&spring name='s{i}' type='linear' body_a='a' point_b={ends[i]},0.0 stiffness={stiffness[i]} "
        deck += f"free_length={abs(ends[i]) * free[i]} /\n"
    for i in range(3):
        deck += f"&spring name='t{i}' type='torsional' body_a='t' stiffness={torsion[i]} free_angle={angle[i]} /\n"
    deck += "&sensor name='a' quantity='position' body='a' /\n&sensor name='turn' quantity='angle' body='t' /\n"
    table = read(run_deck(deck + f"&static load_steps={rng.integers(1, 7)} /\n").folder, "static")
    moved = (force + np.sum(stiffness * ends * (1 - free))) / stiffness.sum()
    assert table["load"][-1] == 1.0
    np.testing.assert_allclose(table["a.x"], moved * table["load"], rtol=1e-8, atol=1e-12, err_msg=f"seed {seed}")
    turned = np.sum(torsion * angle) / torsion.sum()
    np.testing.assert_allclose(table["turn"], turned * table["load"], rtol=1e-8, atol=1e-12, err_msg=f"seed {seed}")


@pytest.mark.parametrize("conditions", ["reference='clamped'", "reference_node=11,11,11 reference_dof='u','v','r'"])
def test_an_equilibrium_is_one_whatever_the_frame(run_deck, conditions):
    """What rounding leaves of elastic forces accelerates light elements; it is no motion."""
    run = run_deck(f"""&material name='a' density=7850.0 young=2.1e11 /
&section name='s' shape='rectangle' width=0.02 height=0.01 /
&body name='b' kind='beam' length=1.0 elements=20 section='s' material='a' {conditions} /
&joint name='w' type='revolute' body_a='b' node_a=1 /
&joint name='v' type='slider' body_a='b' node_a=-1 point_b=1.0,0.0 /
&force name='f' type='force' body='b' node=11 fy=-90.0 /
&static /
&modal modes=2 /
""")
    assert "no equilibrium" not in run.stderr


@pytest.mark.parametrize("thick", ["5e-3", "3e-3"])
def test_a_layered_beam_at_rest_is_counted(run_deck, thick):
    """Entries of the stiffness that cancel are rounding, as their mirrors are: nothing follows the motion."""
    run = run_deck(f"""&material name='a' density=7850.0 young=2.1e11 /
&material name='v' density=1200.0 young=3.0e6 poisson=0.5 prony_alpha=2.0 prony_tau=0.001 /
&section name='s' layers='a','v','a' thickness=5e-3,1e-3,{thick} width=0.02 cores=2 base=2 /
&body name='b' kind='beam' length=0.4 elements=60 section='s' reference='clamped' /
&joint name='w' type='weld' body_a='b' node_a=1 /
&modal modes=3 /
""")
    assert "complete below" in run.summary
    assert "not counted" not in run.summary


def test_sections_of_one_layer_are_not_called_layers(run_deck):
    """Beside a section that shears, one that does not is named as what it is."""
    run = run_deck("""&material name='a' density=7850.0 young=2.1e11 /
&section name='t' shape='rectangle' width=0.02 height=0.03 shear=.true. /
&section name='c' shape='circle' diameter=0.03 /
&body name='f' kind='beam' length=0.4 elements=4 element_section='t','c','t','c' material='a' reference='clamped' /
&joint name='w' type='weld' body_a='f' node_a=1 /
&modal modes=3 /
""")
    assert "layers" not in run.stderr
    assert 'body "f" has a section that is as thick as' in run.stderr


FROZEN = "of the frozen instant"
ROTOR = """&body name='hub' mass=1.0 inertia=0.1 angular_velocity=20.0 /
&body name='arm' mass=1.0 inertia=0.1 position=0.5,0.0 velocity=0.0,10.0 angular_velocity={arm} /
&joint name='p' type='revolute' body_a='hub' /
&joint name='w' type='{joint}' body_a='arm' body_b='hub' point_b=0.5,0.0 /
&history name='w' coefficients=20.0 /
&drive name='d' type='rotation' body_a='hub' history='w' rate=.true. /
&body name='bob' mass=0.2 inertia=0.01 position=1.0,0.0 velocity=0.0,20.0 angular_velocity=20.0 /
&joint name='g' type='prismatic' body_a='bob' body_b='hub' point_b=1.0,0.0 /
&spring name='k' type='linear' body_a='bob' body_b='hub' point_b=1.0,0.0 stiffness=1.0e4 free_length=0.0 /
{more}
&modal modes=2 /
"""


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"arm": 20.0, "joint": "weld", "more": "&static /"}, ""),
        ({"arm": 20.0, "joint": "weld", "more": ""}, "accelerates"),  # the bob is not yet where its spring holds it
        ({"arm": 0.0, "joint": "revolute", "more": ""}, "accelerates"),
    ],
)
def test_a_steady_turn_is_not_warned_of_and_what_accelerates_is(run_deck, values, told):
    run = run_deck(ROTOR.format(**values))
    assert (FROZEN in run.stderr) == bool(told)
    assert told in run.stderr
    assert (FROZEN in (run.folder / "modes.txt").read_text(encoding="utf-8")) == bool(told)


@pytest.mark.parametrize("turning", [0.0, 30.0])
@pytest.mark.parametrize("analysis", ["&modal modes=2 /", "&frequency_response from=1.0 to=2.0 points=2 input='f' /"])
def test_coefficients_that_change_with_the_turn_are_told(run_deck, turning, analysis):
    """A disc with two unlike stiffnesses in turning axes, on a slide that does not turn: Mathieu's kind of equation."""
    run = run_deck(f"""&body name='slide' mass=1.0 inertia=0.1 /
&joint name='s' type='prismatic' body_a='slide' direction=0.0 /
&spring name='k' type='linear' body_a='slide' point_b=-1.0,0.0 stiffness=1000.0 /
&body name='disc' mass=1.0 inertia=0.1 angular_velocity={turning} /
&joint name='p' type='revolute' body_a='disc' body_b='slide' /
&history name='w' coefficients={turning} /
&drive name='d' type='rotation' body_a='disc' body_b='slide' history='w' rate=.true. /
&body name='bob' mass=0.1 inertia=0.01 position=0.0,0.0 angular_velocity={turning} /
&joint name='g' type='prismatic' body_a='bob' body_b='disc' direction=0.3 /
&spring name='c' type='linear' body_a='bob' point_a=0.0,0.1 body_b='disc' point_b=0.0,0.1 stiffness=500.0 free_length=0.0 /
&force name='f' type='force' body='slide' fx=1.0 stage='transient' /
&sensor name='x' quantity='position' body='slide' /
{analysis}
""")
    assert ("change with the turn" in run.stderr) == (turning > 0.0)


def test_a_stiffened_link_that_spins_has_constant_coefficients(run_deck):
    run = run_deck("""&material name='m' density=2700.0 young=7.0e10 /
&section name='s' shape='rectangle' width=0.02 height=0.01 /
&body name='b' kind='beam' length=1.0 elements=6 section='s' material='m' stiffening=.true. angular_velocity=40.0 /
&joint name='p' type='revolute' body_a='b' node_a=1 /
&history name='w' coefficients=40.0 /
&drive name='d' type='rotation' body_a='b' history='w' rate=.true. /
&static /
&modal modes=3 /
""")
    assert run.stderr == ""
