"""The counts that make the solver fast: right-hand sides, solves, factorisations and allocations of a step.

Seconds depend on the machine, counts do not. Two runs that differ in length alone are compared, so that whatever the
set-up does drops out. Allocations and factorisations are counted from outside, by a preloaded library.
"""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT

sys.path.insert(0, str(ROOT / "tests" / "bench"))
import bench_scenes as scenes

SCENES = {
    "elastic": lambda run: scenes.slider_crank(4, run),
    "ghm": lambda run: scenes.slider_crank(4, run, terms=3),
    "modal": lambda run: scenes.slider_crank(8, run, terms=2, modes=4),
    "rigid chain": lambda run: scenes.chain(12, run),
    "flexible chain": lambda run: scenes.chain(5, run, elements=3),
    "four-bar": scenes.four_bar,
}
FLEXIBLE = {"elastic": 1, "ghm": 1, "modal": 0, "rigid chain": 0, "flexible chain": 5, "four-bar": 2}
STEP = 5.0e-7  # stable for every scene [s]
METHODS = {"rk4": 4, "dopri5": 6, "generalized_alpha": 0}  # right-hand sides of a step


def work(run):
    """Return steps, right-hand sides and banded solves of a transient."""
    return [run.transient[name] for name in ("steps", "evaluations", "banded_solves")]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", SCENES)
def test_right_hand_sides_and_solves(run_deck, name, method):
    runs = [work(run_deck(SCENES[name](scenes.transient(STEP, n, method)))) for n in (40, 140)]
    steps, evaluations, solves = (b - a for a, b in zip(*runs))
    assert steps == 100
    assert evaluations == METHODS[method] * steps
    assert solves == 2 * FLEXIBLE[name] * evaluations


@pytest.mark.parametrize("name", SCENES)
def test_iterations_and_factors_of_implicit_steps(run_deck, name):
    """Two Newton iterations a step, one constant factor a body, exact blocks never."""
    told = run_deck(SCENES[name](scenes.transient(STEP, 200, "generalized_alpha"))).transient
    assert 200 <= told["newton_iterations"] <= 2.1 * 200
    assert told["exact_factorisations"] == 0
    assert told["constant_factorisations"] <= len(re.findall(r"kind='beam'", SCENES[name]("")))


def counts(program: Path, library: Path, folder: Path, text: str):
    """Allocations, factorisations and sines of one run of the solver."""
    deck = folder / "deck.nml"
    deck.write_text(text)
    done = subprocess.run(
        [str(program), "--quiet", "--output", str(folder / "out"), str(deck)],
        env={**os.environ, "LD_PRELOAD": str(library)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    found = dict(re.findall(r"^(allocations|factorisations|angles) (\d+)$", done.stderr, re.MULTILINE))
    return int(found["allocations"]), int(found["factorisations"]), int(found["angles"])


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", SCENES)
def test_no_allocation_and_no_factorisation_in_a_step(biela, counters, tmp_path, name, method):
    if biela.name.endswith("-debug"):
        pytest.skip("the checked build makes temporary arrays")
    # both long enough for the same verdicts at the end, which look closer at bodies whose axial loads are not small
    runs = (SCENES[name](scenes.transient(STEP, n, method, every=n // 20)) for n in (9000, 17000))
    short, long = (counts(biela, counters, tmp_path, deck) for deck in runs)
    assert abs(long[0] - short[0]) < 400  # the words of the two summaries may differ; 8,000 steps in nothing
    assert long[1] == short[1]
    assert short[0] > 0
    assert short[1] >= FLEXIBLE[name]


LONG = {"modal": (0.02, 0.5), "rigid chain": (0.02, 6.0), "flexible chain": (5e-4, 2e-3)}  # ends of runs by tolerance [s]


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("steps", ["'generalized_alpha' step=1e-5", "'radau' tolerance=1e-5", "'dopri5' tolerance=1e-5"])
def test_steps_and_their_changes_allocate_nothing(biela, counters, tmp_path, steps, name):
    """Fixed steps factor no elastic block either."""
    if biela.name.endswith("-debug"):
        pytest.skip("the checked build makes temporary arrays")
    fixed = "step" in steps
    group = "&transient method=" + steps + " t_end={} output_step={} /\n"
    ends = (4e-3, 0.02) if fixed else LONG.get(name, (4e-3, 8e-3))
    short, long = (counts(biela, counters, tmp_path, SCENES[name](group.format(t, t / 20))) for t in ends)
    total = json.loads((tmp_path / "out" / "summary.json").read_text())["transient"]["steps"]
    assert total > 1500
    assert abs(long[0] - short[0]) < total / 4  # the digits of the seconds in two summaries make a difference of up to 300
    assert short[0] > 0
    if fixed:
        assert long[1] == short[1]


@pytest.mark.parametrize("name", ["ghm", "modal", "flexible chain"])
def test_no_allocation_and_no_kinematics_in_a_row(biela, counters, tmp_path, name):
    if biela.name.endswith("-debug"):
        pytest.skip("the checked build makes temporary arrays")
    scene = SCENES[name]
    few, many = (counts(biela, counters, tmp_path, scene(scenes.transient(STEP, 2000, every=n))) for n in (1000, 1))
    assert abs(many[0] - few[0]) < 1998 / 4  # 1,998 rows more; the words of the two summaries differ (digits of the seconds)
    assert many[1] == few[1]
    assert many[2] == few[2] > 1000
