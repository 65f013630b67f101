"""Left-out modes and meshes: static shares, the errors of columns that pilots find, how many modes keep an accuracy."""

from __future__ import annotations

import json
import re
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from biela.histories import read
from conftest import caught

BEAM = """&scene gravity=0.0,-9.81 /
&material name='m' density=1600.0 young=2.0e9 ghm_alpha=0.5 ghm_zeta=1.5 ghm_omega=400.0 /
&section name='s' shape='rectangle' width=0.02 height=0.01 /
&body name='b' kind='beam' length=0.8 elements=6 material='m' section='s' reference='{reference}' {modes} /
"""
CLAMPED = """&joint name='o' type='weld' body_a='b' node_a=1 /
&force name='p' type='force' body='b' node=-1 fy=-2.0 /
&sensor name='tip' quantity='position' body='b' node=-1 /
&sensor name='i' quantity='internal' body='b' element=1 /
"""
CRANK = """&body name='c' kind='rigid' mass=0.5 inertia=2.0e-3 com=0.1,0.0 angle=-1.0 position=0.0,0.0 /
&joint name='o' type='revolute' body_a='c' body_b='ground' /
&joint name='j' type='revolute' body_a='b' node_a=1 body_b='c' point_b=0.2,0.0 /
&joint name='l' type='slider' body_a='b' node_a=-1 direction=0.2 /
&spring name='k' type='torsional' body_a='c' stiffness=4.0 /
&sensor name='tip' quantity='position' body='b' node=4 /
&sensor name='w' quantity='angular_velocity' body='c' /
&sensor name='r' quantity='reaction' joint='l' /
&sensor name='i' quantity='internal' body='b' element=2 /
"""
MESHED = """&scene gravity=0.0,-9.81 /
&material name='m' density=1200.0 young=2.0e9 ghm_alpha=0.3 ghm_zeta=1.5 ghm_omega=600.0 rayleigh_stiffness=1e-4 /
&section name='s' shape='rectangle' width=0.02 height=0.008 /
&body name='crank' kind='rigid' mass=0.5 inertia=2.0e-3 com=0.05,0.0 angle=0.6 /
&body name='rod' kind='beam' length=0.4 elements={elements} material='m' section='s' position=0.0825,0.0565 angle=-0.14 /
&joint name='j0' type='revolute' body_a='crank' /
&joint name='j1' type='revolute' body_a='rod' node_a=1 body_b='crank' point_b=0.1,0.0 /
&joint name='j2' type='slider' body_a='rod' at_a=1.0 /
&lump body='rod' at=0.5 mass=0.05 /
&history name='h' kind='cycloid' start_value=0.6 end_value=5.0 start=0.0 finish=0.1 /
&drive name='d' type='rotation' body_a='crank' history='h' /
&sensor name='mid' quantity='deflection' body='rod' at=0.5 /
&sensor name='torque' quantity='reaction' drive='d' /
&transient t_end=0.04 output_step=1e-3 {how} /
"""
TRANSIENT = "&transient t_end=0.05 output_step=2e-3 {how} /\n"
SETTLED = TRANSIENT.format(how="method='radau' tolerance=1e-7")


def text(rest: str, modes: str, reference: str = "clamped") -> str:
    """Return a scene with a body in modes."""
    return BEAM.format(modes=modes, reference=reference) + rest


def gaps(a, b) -> dict[str, float]:
    """Return the largest difference of each column, but of places."""
    return {f"{c}[{a.units[c]}]": np.abs(a[c] - b[c]).max() for c in a.names[1:] if a.units[c] != "-"}


def test_the_static_share_is_that_of_the_static_response(run_deck):
    """The end of a clamped beam under a force there: no load that stores the same energy moves it farther."""
    decks = {k: text(CLAMPED, f"axial=.false. {k}").replace("gravity=0.0,-9.81", "") for k in ("modes=0", "modes=2")}
    mesh, modes = (read(run_deck(deck + "&static /\n", name=k[-1]).folder, "static")["tip.y"][-1] for k, deck in decks.items())
    found = json.loads(run_deck(decks["modes=2"], "--check", "--json").stdout)["static_share_of_left_out_modes"]
    shares = [s["share"] for s in found]
    assert shares == sorted(shares, reverse=True)
    assert {s["column"]: s["share"] for s in found}["tip.y[m]"] == pytest.approx(1 - modes / mesh, rel=1e-6)
    whole = run_deck(decks["modes=2"].replace("modes=2", "modes=2 static_shapes=.true."), "--check").stdout
    assert "none above" in whole


@pytest.mark.parametrize(("rest", "modes"), [(CLAMPED, 1), (CRANK, 2)], ids=["clamped", "crank"])
def test_pilots_find_the_errors_of_columns(run_deck, rest, modes):
    """Beside runs in nodal coordinates and in modes: positions, forces in a section, reactions, a rigid body in the same loop."""
    mesh = run_deck(text(rest, "modes=0") + SETTLED, name="mesh").history
    run = run_deck(text(rest, f"modes={modes}") + SETTLED.replace("radau'", "radau' check_reduction=.true."))
    found = run.figures["reduction"]["errors"]
    true = gaps(run.history, mesh)
    assert true.keys() == found.keys()
    of_use = [c for c, name in ((c, c.split("[")[0]) for c in true) if true[c] > 1e-4 * np.ptp(mesh[name]) > 1e-12]
    assert len(of_use) > 3
    assert all(true[c] / 1.5 < found[c] < 1.5 * true[c] for c in of_use)


def test_auto_takes_the_fewest_modes_that_keep_the_accuracy(run_deck, biela, tmp_path):
    """With one mode less they take more than their half of what columns may err by; a restarted run finds the same modes."""
    asked = 2e-2
    mesh = run_deck(text(CRANK, "modes=0") + SETTLED, name="mesh").history
    shapes = "static_shapes=.true."
    run = run_deck(text(CRANK, f"modes='auto' {shapes}") + TRANSIENT.format(how=f"accuracy={asked} checkpoint_interval=5e-3"))
    number = run.figures["reduction"]["modes"]["b"]
    assert number > 1
    fewer = run_deck(text(CRANK, f"modes={number - 1} {shapes}") + SETTLED, name="fewer").history
    extent = {f"{c}[{mesh.units[c]}]": np.ptp(mesh[c]) for c in mesh.names[1:]}
    ours, theirs = gaps(run.history, mesh), gaps(fewer, mesh)
    assert all(ours[c] < asked * extent[c] for c in ours if extent[c] > 1e-9)
    assert any(theirs[c] > 0.49 * asked * extent[c] for c in ours if extent[c] > 1e-9)
    told = run.figures["transient"]["estimated_errors"]
    assert all(told[c] >= run.figures["reduction"]["errors"][c] for c in told if extent[c] > 1e-9)
    checkpoint = tmp_path / "cut" / "checkpoint"

    def cut() -> bool | None:
        process = subprocess.Popen([str(biela), "--quiet", "--output", "cut", "scene.nml"], cwd=tmp_path)
        while process.poll() is None and not checkpoint.exists():
            time.sleep(0.001)
        process.kill()
        process.wait()
        return checkpoint.exists() or None

    assert caught(cut)
    again = run_deck(tmp_path / "scene.nml", "--restart", "--output", "cut").folder
    assert (again / "history.txt").read_bytes() == (run.folder / "history.txt").read_bytes()


def test_pilots_end_by_the_clock_and_by_signals(run_deck, biela, tmp_path):
    """With a warning that says what was taken; a signal leaves things as if the run had not begun."""
    deck = text(CRANK, "modes='auto'") + TRANSIENT.format(how="accuracy=1e-2 most_seconds=1e-6")
    run = run_deck(deck, name="late")
    assert "modes='auto': fewer modes may be enough: most_seconds ended the pilots" in run.stderr
    assert run.figures["reduction"]["modes"]["b"] == 0
    deck = deck.replace(" most_seconds=1e-6", "").replace("t_end=0.05", "t_end=9.0")
    (tmp_path / "long.nml").write_text(re.sub(r"ghm_.*/", "/", deck), encoding="utf-8")
    process = subprocess.Popen([str(biela), "--quiet", "--output", "none", "long.nml"], cwd=tmp_path, stderr=subprocess.PIPE)
    ticks = Path(f"/proc/{process.pid}/stat")
    while process.poll() is None and int(ticks.read_text().split()[13]) < 20:  # 0.2 s of the processor: in the pilots
        time.sleep(0.01)
    process.terminate()
    words = process.communicate()[1].decode()
    assert "stopped by signal 15 in a pilot, before the run: no file was written or changed" in words
    assert process.returncode == 128 + 15
    assert not (tmp_path / "none").exists()


def test_the_error_of_a_mesh(run_deck):
    """check_mesh beside sixteen elements."""
    truth = run_deck(MESHED.format(elements=16, how="method='radau' tolerance=1e-7"), name="truth").history
    run = run_deck(MESHED.format(elements=2, how="method='radau' tolerance=1e-7 check_mesh=.true."))
    found, true = run.figures["reduction"]["mesh_errors"], gaps(run.history, truth)
    extent = {f"{c}[{truth.units[c]}]": np.ptp(truth[c]) for c in truth.names[1:]}
    of_use = [found[c] / true[c] for c in true if true[c] > 1e-5 * extent[c] > 1e-17]
    assert len(of_use) > 2
    assert all(1 / 3 < ratio < 3 for ratio in of_use)


def test_a_place_is_a_node(run_deck):
    """The same rows by shares of the length and by numbers of nodes."""
    deck = MESHED.format(elements=4, how="method='radau' tolerance=1e-3")
    places = run_deck(deck).history
    nodes = run_deck(deck.replace("at=0.5", "node=3").replace("at_a=1.0", "node_a=-1"), name="nodes").history
    assert np.array_equal(places.data, nodes.data)
