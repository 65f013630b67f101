"""Sweeps in parts: what each word of a study means or is refused for, measures of columns, how a batch gives its rows."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from biela import study_runs, sweep_run, sweep_study, sweep_work
from biela.deck import read
from biela.histories import HistoryError
from biela.sweep_run import Batch, run_batch
from biela.sweep_scalars import Scalar, measure
from biela.sweep_study import StudyError

PARAMETER = "[[parameter]]\nname = 'h'\nset = 'section/strip/height'\n"
RESULT = "[[result]]\nname = 'peak'\nmeasure = 'peak'\ncolumn = 'tip.v'\n"


def points(folder: Path, text: str) -> list[tuple]:
    """Return the values of the parameters of a study's runs."""
    (folder / "study.toml").write_text(text, encoding="utf-8")
    return [tuple(point.values()) for point in sweep_study.read(folder / "study.toml").points]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("", "parameter h: one of values, from, mean or catalogue expected"),
        ("values = [1.0]\nfrom = 1.0", "parameter h: one of values, from, mean or catalogue expected"),
        ("values = 1.0", "parameter h: values = [...] expected, numbers or words"),
        ("values = []", "parameter h: values = [...] expected, numbers or words"),
        ("values = [[1.0]]", "parameter h: values = [...] expected, numbers or words"),
        ("from = 1.0", "parameter h: from, to and points expected, all numbers"),
        ("from = 'a'\nto = 2.0", "parameter h: from, to and points expected, all numbers"),
        ("from = 1.0\nto = 2.0\npoints = inf", "parameter h: from, to and points expected, all numbers"),
        ("from = 1.0\nto = 2.0\npoints = 1", "parameter h: two points or more expected, finite ends"),
        ("from = 1.0\nto = inf", "parameter h: two points or more expected, finite ends"),
        ("from = 0.0\nto = 2.0\nspacing = 'log'", "positive ones for spacing = 'log'"),
        ("from = 1.0\nto = 2.0\nspacing = 'cubic'", "parameter h: spacing = 'linear' or 'log' expected"),
        ("from = 1.0\nto = 2.0\npoints = 1_000_000_000", "points = 1000000000: at most 1000000 runs expected"),
        (f"values = [{'1' * 5000}]", "cannot be read as TOML"),
        (f"values = {'[' * 20_000}", "cannot be read as TOML"),
    ],
)
def test_what_a_parameter_cannot_be_is_told(tmp_path, words, told):
    with pytest.raises(StudyError) as fault:
        points(tmp_path, f"deck = 'a.nml'\n{PARAMETER}{words}\n{RESULT}")
    assert str(fault.value).startswith(f"{tmp_path / 'study.toml'}: ")
    assert told in str(fault.value)


VALUES = PARAMETER + "values = [1.0, 2.0]\n"
MANY = PARAMETER + f"values = {[1.0] * 2000}\n"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (f"{VALUES}{RESULT}", "deck = 'FILE.nml' is missing"),
        (f"deck = 3\n{VALUES}{RESULT}", "deck = 'FILE.nml' is missing"),
        (f"deck = 'a.nml'\n{RESULT}", "no [[parameter]] is given"),
        (f"deck = 'a.nml'\n{VALUES}", "no [[result]] is given"),
        (f"deck = 'a.nml'\nparameter = 3\n{RESULT}", "parameter: tables [[parameter]] expected"),
        (f"deck = 'a.nml'\nparameter = ['h']\n{RESULT}", "parameter: tables [[parameter]] expected"),
        (f"deck = 'a.nml'\n{VALUES}[result]\nname = 'peak'\n", "result: tables [[result]] expected"),
        (f"deck = 'a.nml'\ndesign = 'star'\n{VALUES}{RESULT}", "design = 'star': one of grid, zip, latin_hypercube, random"),
        (f"deck = 'a.nml'\ndesign = 'latin_hypercube'\n{VALUES}{RESULT}", "samples = a whole number expected"),
        (f"deck = 'a.nml'\ndesign = 'latin_hypercube'\nsamples = 2\nseed = -1\n{VALUES}{RESULT}", "seed too where given"),
        (
            f"deck = 'a.nml'\ndesign = 'latin_hypercube'\nsamples = 2\n{PARAMETER}values = ['a', 'b']\n{RESULT}",
            "parameters have to be numbers",
        ),
        (
            f"deck = 'a.nml'\ndesign = 'latin_hypercube'\nsamples = 2\n{PARAMETER}values = [0.0, 1.0]\nspacing = 'log'\n{RESULT}",
            "parameter h: positive numbers expected for spacing = 'log'",
        ),
        (f"deck = 'a.nml'\n{PARAMETER}expression = '2.0'\n{RESULT}", "expression: expected in the deck, &parameter name='...'"),
        (f"deck = 'a.nml'\n[[parameter]]\nname = 'h'\nvalues = [1.0, 'a']\n{RESULT}", "parameter h: numbers expected; words go to"),
        (
            f"deck = 'a.nml'\n{MANY}{MANY.replace('h', 'w', 1).replace('strip/height', 'strip/width')}{RESULT}",
            "design = 'grid': the parameters' values make more than",
        ),
        (f"deck = 'a.nml'\ndesign = 'latin_hypercube'\nsamples = 10_000_000\n{VALUES}{RESULT}", "samples = 10000000: at most"),
        (f"deck = 'a.nml'\n[[parameter]]\nname = '2h'\nvalues = [1.0]\n{RESULT}", "name = '2h': a word of letters, digits and _"),
        (f"deck = 'a.nml'\n[[parameter]]\nname = 'h'\nset = 'strip'\nvalues = [1.0]\n{RESULT}", "set: 'strip': 'group/name/var"),
        (f"deck = 'a.nml'\n[[parameter]]\nname = 'h'\nset = 3\nvalues = [1.0]\n{RESULT}", "set: 3: 'group/name/variable'"),
        (f"deck = 'a.nml'\n[[parameter]]\nname = 'h'\nset = [3]\nvalues = [1.0]\n{RESULT}", "set: 3: 'group/name/variable'"),
    ],
)
def test_what_a_study_lacks_is_told(tmp_path, text, told):
    with pytest.raises(StudyError) as fault:
        points(tmp_path, text)
    assert told in str(fault.value)


def test_a_study_that_is_not_there(tmp_path):
    with pytest.raises(StudyError, match=r"none\.toml: no such file"):
        sweep_study.read(tmp_path / "none.toml")


def test_zip_takes_the_values_in_turn(tmp_path):
    second = "[[parameter]]\nname = 'w'\nfrom = 1.0\nto = 100.0\npoints = 2\nspacing = 'log'\n"
    assert points(tmp_path, f"deck = 'a.nml'\ndesign = 'zip'\n{VALUES}{second}{RESULT}") == [(1.0, 1.0), (2.0, 100.0)]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ({"name": "2x"}, "name = '2x': a word of letters, digits and _ expected"),
        ({"measure": "size"}, "measure = 'size': one of peak, rms"),
        ({"file": "motion"}, "file = 'motion': one of history, energy"),
        ({"file": ["history"]}, "file = ['history']: one of history, energy"),
        ({"measure": "summary"}, "measure = 'summary' needs key = 'a.figure.of.summary.json'"),
        ({"measure": "summary", "key": "modes.poles.0.damping_ratio"}, "measure = 'frequency' or 'damping_ratio' with mode = N"),
        ({"measure": "frequency"}, "measure = 'frequency' needs mode = N"),
        ({"measure": "summary", "key": 3}, "measure = 'summary' needs key"),
        ({"column": ""}, "measure = 'peak' needs a column"),
        ({"column": 3}, "measure = 'peak' needs a column"),
        ({"at": "end"}, "at = 'end': a number expected"),
        ({"band": [0.1]}, "band = [0.1]: a number expected"),
        ({"start": "0"}, "from = '0': a number expected"),
        ({"end": "0"}, "to = '0': a number expected"),
    ],
)
def test_what_a_result_cannot_be_is_told(words, told):
    with pytest.raises(ValueError, match=r"expected|needs") as fault:
        Scalar(**{"name": "x", "measure": "peak", "column": "tip.v", **words})
    assert told in str(fault.value)


TABLE = "# columns: t[s] a[m] b[rad/s]\n"
ROWS = [(0.0, 1.0, -2.0), (1.0, -3.0, 4.0), (2.0, 1.0, 10.0)]


SCENE = {"bodies": [{"name": "rod", "mass": 3.0}, {"name": "1", "mass": 2.0}]}


def lines(rows: list[tuple]) -> str:
    """Return rows as the solver writes them."""
    return "".join("".join(f"{x:24.16E}"[:21] + f"{int(f'{x:e}'[-3:]):+04d}" for x in row) + "\n" for row in rows)


@pytest.fixture
def folder(tmp_path):
    """Return a results folder with a history and a summary."""
    (tmp_path / "history.txt").write_text(TABLE + lines(ROWS), encoding="utf-8")
    figures = {"transient": {"steps": 12}, "modes": {"poles": [{"frequency": 3.5}]}, "scene": SCENE}
    (tmp_path / "summary.json").write_text(json.dumps(figures))
    return tmp_path


@pytest.mark.parametrize(
    ("words", "value", "unit"),
    [
        ({"measure": "peak", "column": "a"}, 3.0, "m"),
        ({"measure": "range", "column": "b"}, 12.0, "rad/s"),
        ({"measure": "mean", "column": "a"}, -1.0, "m"),
        ({"measure": "mean", "column": "a", "start": 2.0}, 1.0, "m"),
        ({"measure": "max", "column": "b", "end": 1.0}, 4.0, "rad/s"),
        ({"measure": "min", "column": "b"}, -2.0, "rad/s"),
        ({"measure": "rms", "column": "a", "start": 2.0}, 1.0, "m"),
        ({"measure": "final", "column": "b"}, 10.0, "rad/s"),
        ({"measure": "value", "column": "b", "at": 0.5}, 1.0, "rad/s"),
        ({"measure": "value", "column": "b", "at": 2.5}, np.nan, "rad/s"),
        ({"measure": "spectral_peak", "column": "a"}, np.nan, "Hz"),
        ({"measure": "decay_rate", "column": "a"}, np.nan, "1/s"),
        ({"measure": "settling_time", "column": "b"}, 1.96, "s"),
        ({"measure": "settling_time", "column": "b", "band": 1.0}, 0.0, "s"),
        ({"measure": "summary", "key": "transient.steps"}, 12.0, ""),
        ({"measure": "summary", "key": "scene.bodies.0.mass"}, 3.0, ""),
        ({"measure": "mass"}, 5.0, "kg"),
        ({"measure": "mass", "column": "Rod"}, 3.0, "kg"),
    ],
)
def test_a_measure_has_its_exact_value_and_unit(folder, words, value, unit):
    found = measure(folder, (Scalar("x", **words),))
    assert (found.values, found.units) == (pytest.approx([value], rel=1e-15, nan_ok=True), [unit])


@pytest.mark.parametrize(
    ("change", "words", "told"),
    [
        (None, {"file": "energy"}, "energy.txt: no such file (this run wrote history.txt)"),
        (None, {"column": "c"}, "history.txt: no column 'c'; it has t, a, b"),
        (TABLE + lines(ROWS)[:-5], {}, "history.txt:4: '1.0000000000000000E' is no finite number"),
        (TABLE, {}, "history.txt: holds no rows (was the run interrupted at its start?)"),
        ("#\n" + TABLE, {}, "history.txt: holds no rows (was the run interrupted at its start?)"),
        ("##\n" + TABLE, {}, "history.txt: holds no rows (was the run interrupted at its start?)"),
        (None, {"start": 3.0}, "no row from 3 to inf"),
        (None, {"measure": "summary", "key": "transient.none"}, "summary.json has no figure 'transient.none'"),
        (None, {"measure": "summary", "key": "scene.bodies.7.mass"}, "summary.json has no figure 'scene.bodies.7.mass'"),
        (None, {"measure": "frequency", "mode": 1, "column": ""}, "modes.txt: no such file (this run wrote history.txt)"),
        (None, {"measure": "summary", "key": "transient.steps.x"}, "summary.json has no figure 'transient.steps.x'"),
    ],
)
def test_results_without_the_number_are_told(folder, change, words, told):
    if change is not None:
        (folder / "history.txt").write_text(change, encoding="utf-8")
    with pytest.raises(ValueError, match=r"\.txt|\.json|no row") as fault:
        measure(folder, (Scalar(**{"name": "x", "measure": "peak", "column": "a", **words}),))
    assert str(fault.value) == told.format(folder)


DECK = """&parameter name='m' value=1 /
&body name='b' mass={sqrt(m)} inertia=1 /
&sensor name='x' quantity='velocity' body='b' /
&sensor name='other' quantity='angle' body='b' /
&scene gravity={m},0 /
&transient t_end=1 step=0.1 motion_step=0.1 /
"""


def batch(folder: Path, solver: Path, **changes: object) -> Batch:
    """Return a batch of three runs, of which the solver refuses the first."""
    (folder / "deck.nml").write_text(DECK)
    runs = {k: (f"m={m}", "sensor/other/=") for k, m in enumerate((-1.0, 2.0, 3.0))}
    words = dict(scalars=(Scalar("peak", "peak", "x.x"), Scalar("m", "summary", key="parameters.m")), folder=str(folder / "runs"))
    return Batch(str(solver), str(folder / "deck.nml"), runs, **{**words, **changes})


def test_each_run_of_a_batch_has_its_numbers_or_what_the_solver_says_of_it(tmp_path, biela):
    rows = run_batch(batch(tmp_path, biela))
    assert rows[0].reason == "deck.nml:2: body/b: mass={sqrt(m)} takes sqrt of -1, expected an argument >= 0"
    assert [row.values for row in rows[1:]] == [pytest.approx([m, m]) for m in (2.0, 3.0)]
    assert not (tmp_path / "runs").exists()


def test_a_solver_that_is_stopped_is_told(tmp_path):
    (tmp_path / "solver").write_text("#!/bin/sh\nkill -9 $$\n")
    (tmp_path / "solver").chmod(0o755)
    assert {row.reason for row in run_batch(batch(tmp_path, tmp_path / "solver"))} == {"the solver was stopped by signal 9"}


def test_decks_that_are_kept_hold_the_values(tmp_path, biela):
    run_batch(batch(tmp_path, biela, keep=True))
    kept = [read(tmp_path / "runs" / f"00000{k}.nml") for k in (1, 2)]
    assert [deck.one("scene").numbers("gravity")[0] for deck in kept] == [2.0, 3.0]


def test_lean_decks_keep_what_is_measured(tmp_path):
    (tmp_path / "deck.nml").write_text(DECK)
    for file, told in (("history", ("sensor/other/=", "transient/motion_step=")), ("modes", ())):
        study = sweep_study.Study("s", tmp_path / "deck.nml", (), (Scalar("peak", "peak", "x.x", file),), ())
        assert sweep_run.common_settings(study, read(tmp_path / "deck.nml"), True) == told


def test_a_scheduler_and_its_workers_need_not_have_this_package(tmp_path):
    """They read the call in a Python that has no `biela`, as the README starts them; the worker gets the folder with the call."""
    cloudpickle = pytest.importorskip("cloudpickle")

    class Pool:
        def submit(self, *call):
            return cloudpickle.dumps(call)

    options = sweep_study.StudyOptions(tmp_path, Path("/bin/true"), scheduler="tcp://there")
    sent = study_runs.submit(Pool(), batch(tmp_path, Path("/bin/true")), options)
    words = "import pickle, sys; call, *given = pickle.load(sys.stdin.buffer); print([row.reason for row in call(*given)])"
    done = subprocess.run([sys.executable, "-c", words], input=sent, capture_output=True, check=True, env={}, cwd="/")
    assert done.stdout.decode() == f"{['the solver has left no results'] * 3}\n"


def study_of(folder: Path, text: str = f"deck = 'a.nml'\n{VALUES}{RESULT}"):
    (folder / "study.toml").write_text(text, encoding="utf-8")
    return sweep_study.read(folder / "study.toml")


@pytest.mark.parametrize(
    ("goal", "conditions", "told"),
    [
        ("max peak", [], "best of 2 runs (max peak): h = 2, peak = 9"),
        ("min peak", ["h >= 2"], "best of 1 runs (min peak, h >= 2): h = 2, peak = 9"),
        ("min peak", ["h > 2"], "best: no run meets the conditions"),
        ("least peak", [], "--best 'least peak': 'min NAME' or 'max NAME' expected, NAME one of h, peak"),
        ("min mass", [], "'min NAME' or 'max NAME' expected, NAME one of h, peak"),
        ("min peak", ["mass < 3"], "--where 'mass < 3': 'NAME < VALUE' expected, NAME one of h, peak"),
        ("min peak", ["h < x"], "--where 'h < x': 'NAME < VALUE' expected, NAME one of h, peak"),
        ("min peak", ["h = 2"], "--where 'h = 2': 'NAME < VALUE' expected, NAME one of h, peak"),
    ],
)
def test_the_best_run_is_named(tmp_path, goal, conditions, told):
    rows = [[1.0, 4.0, ""], [2.0, 9.0, ""], [3.0, "", "failed"], [4.0, np.nan, ""]]
    try:
        said = sweep_work.best(study_of(tmp_path), rows, goal, conditions)
    except HistoryError as fault:
        said = str(fault)
    assert told in said


def test_words_have_no_size(tmp_path):
    with pytest.raises(HistoryError, match="--where 'h < 3': the values of h are words"):
        sweep_work.best(study_of(tmp_path), [["steel", 4.0, ""], ["brass", 3.0, ""]], "min peak", ["h < 3"])
