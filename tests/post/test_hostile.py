"""Damaged tables, studies, catalogues, journals, summaries, materials, decks: every program ends with few words, no traceback.

`TOOL_CASES=2000 pytest tests/post/test_hostile.py` draws more than the few of `make test`; TOOL_SEED= draws others.
"""

from __future__ import annotations

import os
import random
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from biela.programs import (
    animate,
    compare,
    draw,
    export,
    fit_material,
    modes,
    optimise,
    plot,
    report,
    sensitivity,
    spectrum,
    sweep,
    tradeoff,
)
from conftest import ROOT
from tool_calls import call

CASES = int(os.environ.get("TOOL_CASES", "15"))
SEED = int(os.environ.get("TOOL_SEED", "1"))
DECK = """&scene gravity=0,-9.81 /
&parameter name='h' value=0.004 /
&material name='m' density=1200 young=3e9 ghm_alpha=0.3 ghm_zeta=1.5 ghm_omega=600 /
&section name='s' shape='rectangle' width=0.02 height={h} /
&body name='b' kind='beam' length=0.3 elements=2 material='m' section='s' reference='clamped' /
&joint name='j' type='weld' body_a='b' node_a=1 /
&sensor name='tip' quantity='deflection' body='b' node=-1 /
&sensor name='root' quantity='internal' body='b' element=1 /
&modal modes=2 /
&transient t_end=0.05 method='radau' tolerance=1e-4 output_step=1e-3 motion_step=5e-3 /
"""
STUDY = """deck = "deck.nml"
best = "min peak"
where = ["root < 1e9"]
starts = 1
runs = 9
[[parameter]]
name = "h"
from = 0.003
to = 0.006
points = 2
[[parameter]]
name = "length"
set = ["body/b/length"]
values = [0.3]
[[result]]
name = "peak"
measure = "peak"
column = "tip.v"
[[result]]
name = "root"
measure = "max"
column = "root.s"
"""
ODD = rb"nan inf -1 0 1e999 [ { ' = , / & # 1e-400 true null [[ {h} * .. -".split()
ODD += [b'"', b"\x00", b"\xff\xfe", b"\r\n", b"\n\n", b" ", b"9" * 400, "€".encode()]
WORDS = re.compile(rb"[\w.+-]+|\s+|[^\w\s]")


def damaged(text: bytes, chance: random.Random) -> bytes:
    """Return a text with a few words lost, doubled, exchanged or replaced by odd ones, or cut."""
    words = WORDS.findall(text)
    for _ in range(chance.randint(1, 3)):
        k, j = (chance.randrange(len(words)) for _ in range(2))
        what = chance.randrange(6)
        if what == 0:
            del words[k]
        elif what == 1:
            words[k] = chance.choice(ODD)
        elif what == 2:
            words[k], words[j] = words[j], words[k]
        elif what == 3:
            words.insert(k, words[j])
        elif what == 4:
            words[k] = chance.choice(ODD) + words[k]
        else:
            words = words[: k + 1]
        words = words or [b" "]
    return b"".join(words)


@pytest.fixture(scope="module")
def whole(tmp_path_factory, biela):
    """Return a folder with a deck, its results, a study, a table of moduli, a catalogue."""
    folder = tmp_path_factory.mktemp("whole")
    (folder / "deck.nml").write_text(DECK)
    (folder / "study.toml").write_text(STUDY)
    study = STUDY.replace('set = ["body/b/length"]\nvalues = [0.3]', 'catalogue = "cat.csv"').replace("length", "row")
    (folder / "cat.toml").write_text(study.replace('name = "h"', 'name = "height"\nset = ["section/s/height"]'))
    (folder / "cat.csv").write_text("name,h\na,0.004\nb,0.005\n")
    (folder / "moduli.csv").write_text((ROOT / "input" / "materials" / "elastomer.csv").read_text())
    subprocess.run([str(biela), "--quiet", "deck.nml"], cwd=folder, check=True, capture_output=True)
    return folder


QUICK = ["--no-pictures", "--jobs", "1"]
TOOLS = {
    "plot": (plot, ["results/deck"], ["results/deck/history.txt"]),
    "plot energy": (plot, ["results/deck", "--file", "energy"], ["results/deck/energy.txt"]),
    "spectrum": (spectrum, ["results/deck", "--columns", "tip.v"], ["results/deck/history.txt"]),
    "export": (export, ["results/deck", "--to", "csv"], ["results/deck/history.txt", "results/deck/summary.json"]),
    "compare": (compare, ["results/deck", "results/deck"], ["results/deck/history.txt"]),
    "report": (report, ["results/deck"], ["results/deck/summary.json", "results/deck/history.txt", "results/deck/energy.txt",
                                          "results/deck/motion.txt", "results/deck/modes.txt"]),
    "modes": (modes, ["results/deck"], ["results/deck/modes.txt", "results/deck/summary.json"]),
    "animate": (animate, ["results/deck"], ["results/deck/motion.txt", "results/deck/summary.json"]),
    "draw": (draw, ["deck.nml"], ["deck.nml"]),
    "fit": (fit_material, ["moduli.csv", "--density", "1200", "--terms", "2", "--output", "fitted"], ["moduli.csv"]),
    "sweep": (sweep, ["study.toml", *QUICK], ["study.toml", "deck.nml", "results/sweep/study/journal.jsonl"]),
    "optimise": (optimise, ["study.toml", *QUICK], ["study.toml", "results/optimise/study/journal.jsonl"]),
    "catalogue": (optimise, ["cat.toml", *QUICK], ["cat.csv", "cat.toml"]),
    "sensitivity": (sensitivity, ["study.toml", *QUICK], ["study.toml", "deck.nml"]),
    "tradeoff": (tradeoff, ["deck.nml", "--time", "0.5", "--jobs", "1"], ["deck.nml"]),
}  # fmt: skip


@pytest.mark.parametrize("number", range(CASES))
def test_what_is_damaged_is_told_in_few_words(whole, tmp_path, biela, number):
    chance = random.Random(1000 * SEED + number)
    name = list(TOOLS)[number % len(TOOLS)]
    tool, words, files = TOOLS[name]
    folder = tmp_path / "case"
    shutil.copytree(whole, folder)
    takes_solver = name in ("draw", "sweep", "optimise", "catalogue", "sensitivity", "tradeoff")
    words = [*words, "--biela", str(biela)] if takes_solver else words
    file = folder / chance.choice(files)
    if "journal" in file.name:
        call(tool.main, *words, cwd=folder)
    file.write_bytes(damaged(file.read_bytes(), chance))
    said = call(tool.main, *words, cwd=folder)
    wrong = f"{name} {file.name} seed {1000 * SEED + number}\n{said.stderr}"
    assert said.returncode in (0, 1, 2), wrong
    assert "Traceback" not in said.stderr, wrong
    own = [line for line in said.stderr.splitlines() if "warning" not in line.lower() and "deck.nml:" not in line]
    assert len(own) <= 3, wrong  # beside the solver's list of all faults of a deck
    if said.returncode == 2:
        assert said.stderr.strip(), wrong
    assert not list(Path(folder).glob("**/*.new")), wrong
