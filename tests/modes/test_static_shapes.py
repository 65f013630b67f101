"""Bodies in modes with static shapes: small loads act as on the mesh, a full basis is the mesh, few coordinates go far."""

from __future__ import annotations

import random
import re
import sys

import numpy as np
import pytest
from biela.histories import read
from conftest import ROOT

sys.path.insert(0, str(ROOT / "tests" / "bench"))
from bench_scenes import driven_rod
from modal_bodies import HEAD, LOADS, LUMPS, PIN, SCENES, SENSORS, TRANSIENT, text

SHAPES = " static_shapes=.true."


def coordinates(run) -> tuple[int, int]:
    """Return the numbers of elastic coordinates and of static shapes among them."""
    found = re.search(r"3 \+ (\d+) modes, (\d+) of them static shapes", run.summary)
    return int(found[1]), int(found[2])


def differences(run, mesh) -> dict[str, float]:
    """Return the largest difference of each column over the range of all columns of its kind of its sensor."""
    of = {}
    for column in mesh.names[1:]:
        kind = re.sub(r"[xy]$|[12]$", "", column)
        of[column] = max(np.ptp(mesh[c]) for c in mesh.names[1:] if re.sub(r"[xy]$|[12]$", "", c) == kind)
    return {c: np.abs(run[c] - mesh[c]).max() / (of[c] + 1e-300) for c in mesh.names[1:]}


@pytest.mark.parametrize("name", ["pinned", "clamped", "own reference", "partly viscoelastic", "two elements of each", "frame"])
def test_a_basis_as_large_as_the_mesh_is_the_mesh(run_deck, name):
    """Shapes beyond the mesh's coordinates depend on the others and are left out; GHM per material, Rayleigh damping, lumps."""
    body, more, number = SCENES[name]
    rest = PIN + LOADS + SENSORS + TRANSIENT.format(step=8.0e-6)
    mesh = run_deck(text(body, more, 0) + rest, name="mesh")
    run = run_deck(text(body, more + SHAPES, number - 4) + rest, name="shapes")
    assert coordinates(run) == (number, 4)
    assert max(differences(run.history, mesh.history).values()) < 1e-8
    for column in ("kinetic", "potential", "dissipated", "work"):
        np.testing.assert_allclose(run.energy[column], mesh.energy[column], rtol=0, atol=1e-8 * np.abs(mesh.energy[column]).max())


def held_structure(dice: random.Random, size: float) -> tuple[str, str]:
    """Return a body with springs, loads and lumps on it, and what holds it, with loads of the given size."""
    n = dice.randint(6, 12)
    reference = dice.choice(["reference='clamped'", "reference='pinned'", "reference='free'"])
    if dice.random() < 0.5:
        body = f"&body name='b' kind='beam' length=0.8 elements={n} material='elastic' section='s' {reference}"
    else:
        x = [0.1 * k for k in range(n + 1)]
        y = [0.0 if k < n // 2 else 0.06 * (k - n // 2) for k in range(n + 1)]
        pairs = ",".join(f"{k + 1},{k + 2}" for k in range(n))
        body = (
            f"&body name='b' kind='frame' node_x={','.join(map(str, x))} node_y={','.join(map(str, y))}\n"
            f"  element_nodes={pairs} material='elastic' section='s' {reference}"
        )
    node = dice.randint(3, n - 1)
    fx, fy, moment = (size * dice.uniform(0.5, 1.0) for _ in range(3))
    rest = dice.choice(
        [
            "&joint name='o' type='weld' body_a='b' node_a=1 /\n",
            "&joint name='o' type='revolute' body_a='b' node_a=1 /\n"
            f"&spring name='s' type='torsional' body_a='b' node_a={node} body_b='ground' stiffness=4.0 /\n",
            "&joint name='o' type='revolute' body_a='b' node_a=1 /\n&joint name='e' type='slider' body_a='b' node_a=-1 /\n",
        ]
    )
    rest += f"&lump body='b' node={node} mass=0.02 inertia=1.0e-5 /\n"
    rest += f"&force name='p' type='force' body='b' node={dice.choice([-1, node - 1])} fx={fx} fy={fy} /\n"
    rest += f"&force name='m' type='torque' body='b' node={node} moment={moment} /\n"
    rest += f"&sensor name='t' quantity='deflection' body='b' node={node} /\n"
    rest += f"&sensor name='i' quantity='internal' body='b' element={dice.randint(1, node - 2)} /\n"
    rest += "&sensor name='r' quantity='reaction' joint='o' /\n"
    return body, rest + "&static load_steps=1 /\n"


@pytest.mark.parametrize("seed", range(12))
def test_small_static_loads_act_as_on_the_mesh(run_deck, seed):
    """One mode and the shapes give deflections, section forces and reactions; plain modes do not come near."""
    head = HEAD.replace("gravity=1.0,-9.81", "gravity=0.0,0.0")
    last = {}
    for label, option in [("mesh", ""), ("shapes", " modes=1" + SHAPES), ("modes", " modes=3")]:
        body, rest = held_structure(random.Random(seed), 1e-7)
        if label == "mesh":
            body = body.replace("'free'", "'clamped'")
        run = run_deck(head + body + option + " /\n" + rest, name=label)
        lines = (run.folder / "static.txt").read_text(encoding="utf-8").splitlines()
        names = [name for name in lines if name.startswith("# columns:")][0].split()[2:]
        values = dict(zip(names, map(float, lines[-1].split())))
        last[label] = {name: value for name, value in values.items() if name[:2] in ("i.", "r.") and "[-]" not in name}
    of = {n: max(abs(last["mesh"][m]) for m in last["mesh"] if m.split("[")[1] == n.split("[")[1]) for n in last["mesh"]}
    error = {label: max(abs(last[label][n] - last["mesh"][n]) / of[n] for n in of) for label in ("shapes", "modes")}
    assert error["shapes"] < 1e-6
    assert error["modes"] > 1e-3


def test_section_moments_of_a_driven_rod_need_few_coordinates(run_deck):
    """A crank brings a loaded rod to speed: eight coordinates do better than sixteen modes, four in bending alone than twelve."""
    measured = """&sensor name='shank' quantity='internal' body='rod' element=3 /
&transient t_end=0.06 method='generalized_alpha' step=2.0e-5 output_step=2.0e-4 /
"""
    mesh = run_deck(driven_rod(8) + measured, name="mesh").history["shank.m1"]

    def error(option):
        return np.abs(run_deck(driven_rod(8, option) + measured, name="few").history["shank.m1"] - mesh).max() / np.ptp(mesh)

    few = run_deck(driven_rod(8, "modes=1" + SHAPES) + measured, name="few")
    assert coordinates(few) == (8, 7)
    assert error("modes=1" + SHAPES) < 3e-4
    assert error("modes=12") > 3e-3
    assert error("modes=16") > 5e-4
    few = run_deck(driven_rod(8, "axial=.false. modes=1" + SHAPES) + measured, name="few")
    assert coordinates(few) == (4, 3)
    assert error("axial=.false. modes=1" + SHAPES) < 5e-4
    assert error("axial=.false. modes=8") > 1e-2
    assert error("axial=.false. modes=12") > 1e-3


def test_shapes_that_others_contain_are_left_out(run_deck):
    """Two loads on one node are one shape a component; a free body's uniform accelerations have none."""
    body = (
        "&body name='b' kind='beam' length=0.8 elements=6 material='elastic' section='s' reference='{}' modes=2" + SHAPES + " /\n"
    )
    twice = "".join(f"&force name='{n}' type='force' body='b' node=-1 fy=1.0 /\n" for n in "pq")
    rest = PIN + twice + LUMPS + "&transient t_end=1.0e-3 method='rk4' step=1.0e-5 /\n"
    assert coordinates(run_deck(HEAD + body.format("clamped") + rest)) == (8, 6)  # u, v of the tip; inertia: two axial, two bending
    assert coordinates(run_deck(HEAD + body.format("free") + rest, name="free")) == (7, 5)  # u, v of both ends; spin: axial


@pytest.mark.parametrize("modes", ["", " modes=0"])
def test_nodal_coordinates_have_no_static_shapes(run_deck, modes):
    body = f"&body name='b' kind='beam' length=0.8 elements=6 material='elastic' section='s'{modes}{SHAPES} /\n"
    run = run_deck(HEAD + body + PIN + "&static /\n", expect=2)
    assert "static_shapes=.true. with nodal coordinates" in run.stderr
    assert "expected modes > 0" in run.stderr


def test_a_gear_on_a_beam_gets_the_static_shape_of_its_moment(run_deck):
    """A simply supported beam under a load at its middle; gears at one end join it to a torsional spring."""
    length, young, second, stiffness, ratio, load = 0.8, 2.0e9, 0.02 * 0.01**3 / 12, 5.0, -2.0, 1.0e-6
    deck = f"""&material name='m' density=1600.0 young={young} /
&section name='s' shape='rectangle' width=0.02 height=0.01 /
&body name='beam' kind='beam' length={length} elements=4 material='m' section='s' modes=1{SHAPES} /
&body name='wheel' kind='rigid' mass=1.0 inertia=1.0 position=0.0,-0.1 /
&joint name='gears' type='gear' body_a='beam' node_a=1 body_b='wheel' ratio={ratio} /
&joint name='axle' type='revolute' body_a='wheel' point_b=0.0,-0.1 /
&joint name='left' type='revolute' body_a='beam' node_a=1 /
&joint name='right' type='slider' body_a='beam' node_a=-1 direction=0.0 /
&spring name='k' type='torsional' body_a='wheel' stiffness={stiffness} free_angle=0.0 /
&force name='p' type='force' body='beam' node=3 fy={-load} /
&sensor name='turn' quantity='angle' body='wheel' /
&static load_steps=1 /
"""
    free, bending = load * length**2 / (16 * young * second), length / (3 * young * second)
    expected = -free / (1 + stiffness / ratio**2 * bending) / ratio
    assert read(run_deck(deck).folder, "static")["turn"][-1] == pytest.approx(expected, rel=1e-7, abs=0.0)
