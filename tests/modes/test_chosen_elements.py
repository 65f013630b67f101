"""elements='auto': as few elements as keep the accuracy, with a node wherever a place is."""

from __future__ import annotations

import re
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from biela.histories import read

CRANK = """&scene gravity=0.0,-9.81 /
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
&transient t_end=0.12 output_step=1e-3 {how} /
"""


def shares(run, truth) -> dict[str, float]:
    """Return the largest difference of each column that varies over its range."""
    a, b = read(run.folder), read(truth.folder)
    found = {f"{c}[{a.units[c]}]": (np.abs(a[c] - b[c]).max(), np.ptp(b[c])) for c in a.names[1:]}
    return {c: gap / extent for c, (gap, extent) in found.items() if extent > 1e-12}


def test_as_few_as_keep_the_accuracy(run_deck):
    """Beside forty elements; the estimated errors are those of the mesh, and half as many elements err by more than they may."""
    truth = run_deck(CRANK.format(elements=40, how="method='radau' tolerance=1e-8"), name="truth")
    counts = []
    for asked in (1e-2, 1e-4):
        deck = CRANK.format(elements="'auto'", how=f"accuracy={asked}")
        run = run_deck(deck, name=f"a{asked}")
        found = run.figures["reduction"]
        counts.append(found["elements"]["rod"])
        assert run.figures["accuracy"]["kept"]
        assert max(shares(run, truth).values()) < asked
        settled = {
            n: shares(run_deck(CRANK.format(elements=n, how="method='radau' tolerance=1e-8"), name=f"m{n}"), truth)
            for n in (counts[-1], 2 * (counts[-1] // 4))
            if n
        }
        ranges = {f"{c}[{u}]": np.ptp(read(truth.folder)[c]) for c, u in read(truth.folder).units.items()}
        worst = max(settled[counts[-1]], key=settled[counts[-1]].get)
        assert settled[counts[-1]][worst] / 3 < found["mesh_errors"][worst] / ranges[worst] < 3 * settled[counts[-1]][worst]
        assert all(max(x.values()) > 0.25 * asked for n, x in settled.items() if n < counts[-1])
    assert counts[0] < counts[1] < 40


def test_pilots_end_by_the_clock_and_by_signals(run_deck, biela, tmp_path):
    """With a warning that says what was taken; a signal leaves things as if the run had not begun."""
    deck = CRANK.format(elements="'auto'", how="accuracy=1e-2 most_seconds=1e-6")
    run = run_deck(deck, name="late")
    assert "elements='auto': what the mesh makes columns err is not known: most_seconds ended the pilots" in run.stderr
    assert run.figures["reduction"]["elements"]["rod"] == 8
    deck = deck.replace(" most_seconds=1e-6", "").replace("t_end=0.12", "t_end=9.0")
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
    deck = CRANK.replace("t_end=0.12", "t_end=0.04")
    truth = run_deck(deck.format(elements=16, how="method='radau' tolerance=1e-7"), name="truth")
    run = run_deck(deck.format(elements=2, how="method='radau' tolerance=1e-7 check_mesh=.true."))
    found, true = run.figures["reduction"]["mesh_errors"], shares(run, truth)
    extent = {f"{c}[{u}]": np.ptp(read(truth.folder)[c]) for c, u in read(truth.folder).units.items()}
    of_use = {c: found[c] / extent[c] / true[c] for c in true if true[c] > 1e-5}
    assert len(of_use) > 2
    assert all(1 / 3 < ratio < 3 for ratio in of_use.values())


def test_a_place_is_a_node(run_deck):
    """The same rows by shares of the length, in the mesh of a deck and beside a node that only the place asks for."""
    deck = CRANK.format(elements=40, how="method='radau' tolerance=1e-3")
    places = read(run_deck(deck).folder)
    nodes = read(run_deck(deck.replace("at=0.5", "node=21").replace("at_a=1.0", "node_a=-1"), name="nodes").folder)
    assert np.array_equal(places.data, nodes.data)
    uneven = run_deck(CRANK.format(elements="'auto'", how="accuracy=1e-2").replace("at=0.5 mass", "at=0.3 mass"), name="uneven")
    assert uneven.figures["reduction"]["elements"]["rod"] == 3
    nodes = np.array(uneven.figures["scene"]["bodies"][1]["nodes"])
    assert np.linalg.norm(nodes - nodes[0], axis=1) == pytest.approx([0.0, 0.12, 0.2, 0.4])
