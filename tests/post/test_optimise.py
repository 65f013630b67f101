"""The best design and sensitivities: known answers from starts that nobody has chosen, failures, lists, errors that hold."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path

import biela as package
import numpy as np
import pytest
from biela import design_runs, study_runs
from biela.programs import optimise as optimise_command
from biela.programs import sensitivity as sensitivity_command
from conftest import ROOT
from known_optima import PROBLEMS, Pool, Problem, install

OSCILLATOR = """&parameter name='m' value=2 /
&parameter name='c' value=3 /
&parameter name='k' value=800 /
&body name='b' kind='rigid' mass={m} inertia=1 /
&joint name='x' type='slider' body_a='b' direction=0 /
&joint name='y' type='slider' body_a='b' direction=0 point_a=1,0 /
&spring name='s' type='linear' body_a='b' point_b=-1,0 stiffness={k} damping={c} free_length=1 /
&force name='f' type='force' body='b' fx=10 fy=0 /
&sensor name='p' quantity='position' body='b' /
&transient t_end=0.5 method='METHOD' tolerance=TOLERANCE output_step=4e-3 /
"""


@pytest.fixture
def optimise(tmp_path, biela, monkeypatch):
    """Return a function that optimises study.toml of an empty folder and returns status and optimum."""
    monkeypatch.chdir(tmp_path)

    def run(*words: str) -> tuple[int, dict]:
        status = optimise_command.main(["study.toml", "--jobs", "1", "--biela", str(biela), *words])
        return status, json.loads(Path("results/optimise/study/optimum.json").read_text())

    return run


@pytest.mark.parametrize(("name", "drawn"), [*((name, 1) for name in PROBLEMS), ("runs that fail", 303)])
def test_known_optima_are_found_from_places_that_are_drawn(optimise, tmp_path, monkeypatch, name, drawn):
    problem = PROBLEMS[name]
    spread_out = design_runs.Space.spread_out
    monkeypatch.setattr(design_runs.Space, "spread_out", lambda self, count, seed=0: spread_out(self, count, seed + drawn))
    monkeypatch.setattr(design_runs.Space, "start", lambda self: np.random.default_rng(drawn).random(len(self.free)))
    install(monkeypatch, tmp_path, problem)
    status, found = optimise("--no-pictures")
    assert status == 0
    assert found["results"]["f"] == pytest.approx(problem.answer, rel=problem.within)
    assert found["runs"] < {"runs that fail": 250, "tubes of lists": 1000}.get(name, 500)  # each of 112 tubes is searched


def test_a_search_goes_on_and_tells_what_holds_it_back(optimise, tmp_path, monkeypatch, capsys):
    """The least x + 2 y above a hyperbola and a bound: prices by hand."""
    problem = Problem(
        lambda x, y: {"f": x + 2 * y, "g": x * y}, {"x": (0.1, 4), "y": (0.5, 4)}, "min f", ("g >= 2", "x <= 1.6"), 4.1
    )
    install(monkeypatch, tmp_path, problem)
    status, whole = optimise("--no-pictures")
    assert (status, whole["feasible"]) == (0, True)
    assert whole["results"]["f"] == pytest.approx(1.6 + 2 * 1.25, rel=1.0e-6)
    assert whole["prices"] == pytest.approx({"g": 2 / 1.6, "x": 1 - 2 * 2 / 1.6**2}, rel=1.0e-4)
    slope = whole["sensitivities"]["g"]["x"]
    assert abs(slope["derivative"] - 1.25) <= slope["error"] + 1.0e-6
    told = capsys.readouterr().out
    assert "limit g > 2: active; 1 % more changes f by +0.025" in told
    journal = Path("results/optimise/study/journal.jsonl")
    lines = journal.read_text().splitlines(keepends=True)
    journal.write_text("".join(lines[: len(lines) // 2]))
    pool = Pool(problem.function)
    monkeypatch.setattr(study_runs, "ProcessPoolExecutor", lambda **_: pool)
    assert optimise() == (status, whole)
    assert pool.runs == len(lines) - len(lines) // 2
    table = list(csv.DictReader(Path("results/optimise/study/history.csv").read_text().splitlines()))
    assert len(table) == whole["runs"] - 2
    assert float(table[-1]["best"]) == whole["results"]["f"]
    assert {path.name for path in Path("results/optimise/study").glob("*.png")} == {"history.png", "tornado.png"}


def test_what_cannot_be_met_is_told(optimise, tmp_path, monkeypatch, capsys):
    problem = Problem(lambda x: {"f": x, "g": -x}, {"x": (0, 1)}, "min f", ("g >= 1",), 0.0)
    install(monkeypatch, tmp_path, problem)
    assert optimise("--no-pictures")[0] == 1
    assert "no design meets all limits; the nearest one: x = " in capsys.readouterr().out
    install(monkeypatch, tmp_path, problem, runs=7)
    _, found = optimise("--no-pictures")
    assert found["notes"] == ["runs = 7: they are used up; the search was not finished"]
    pool = Pool(lambda **_: {"f": math.nan, "g": 0.0})
    monkeypatch.setattr(study_runs, "ProcessPoolExecutor", lambda **_: pool)
    Path("results/optimise/study/journal.jsonl").unlink()
    install(monkeypatch, tmp_path, problem)
    monkeypatch.setattr(study_runs, "ProcessPoolExecutor", lambda **_: pool)
    assert optimise_command.main(["study.toml", "--jobs", "1"]) == 2
    assert "none of 8 runs all over the ranges gave its results: the solver failed" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (("best = 'min f'", ""), "best = 'min NAME' is missing, NAME one of f"),
        (("min f", "min mass"), "'min NAME' or 'max NAME' expected, NAME one of x, f"),
        (("where = []", "where = ['f = 3']"), "'NAME < VALUE' expected"),
        (("where = []", "where = 3"), "where = ['NAME < VALUE'] expected"),
        (("starts = 3", "starts = 0"), "starts = 0: a whole number of at least 1 expected"),
        (("from = 0", "start = 3\nfrom = 0"), "start = 3: a value between from and to expected"),
        (("from = 0", "spread = 0\nfrom = 0"), "spread = 0: a number above 0 expected"),
        (("from = 0\nto = 1", "catalogue = 'tubes.csv'"), "catalogue = 'tubes.csv': cannot be read (No such file or directory)"),
        (("from = 0\nto = 1", "catalogue = 'bad.csv'"), "'a,1,2': a new name and 1 numbers expected"),
        (("measure = 'peak'", "unit = 'm'\nmeasure = 'peak'"), "unit = '...' belongs to measure = 'summary'"),
    ],
)
def test_faulty_studies_end_in_one_line(tmp_path, biela, monkeypatch, capsys, change, told):
    monkeypatch.chdir(tmp_path)
    install(monkeypatch, tmp_path, Problem(lambda x: {"f": x}, {"x": (0, 1)}, "min f", (), 0.0))
    Path("bad.csv").write_text("name,x\na,1,2\n")
    text = Path("study.toml").read_text()
    assert change[0] in text
    Path("study.toml").write_text(text.replace(*change))
    assert optimise_command.main(["study.toml", "--biela", str(biela)]) == 2
    said = capsys.readouterr().err
    assert told in said
    assert said.count("\n") == 1


def swing(m: float, c: float, k: float) -> dict[str, float]:
    """Return what the oscillator does under a constant force: largest deflection, and the deflection at 0.4 s."""
    decay, still = c / (2 * m), 10 / k
    turn = math.sqrt(k / m - decay**2)
    at = still * (1 - math.exp(-decay * 0.4) * (math.cos(turn * 0.4) + decay / turn * math.sin(turn * 0.4)))
    return {"peak": still * (1 + math.exp(-decay * math.pi / turn)), "at": at}


def test_errors_of_derivatives_hold(tmp_path, biela, monkeypatch):
    """Of 72 derivatives by random masses, dampers, springs, methods and tolerances at least 95 in 100 are within their errors."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("BIELA", str(biela))
    generator, within, relative = np.random.default_rng(11), [], []
    for number in range(12):
        method, tolerance = ("dopri5", "radau")[number % 2], 10.0 ** generator.uniform(-9, -3)
        Path("deck.nml").write_text(OSCILLATOR.replace("METHOD", method).replace("TOLERANCE", f"{tolerance:.3e}"))
        at = {"m": generator.uniform(1, 4), "c": generator.uniform(1, 8), "k": generator.uniform(400, 1600)}
        text = "deck = 'deck.nml'\n"
        for name, value in at.items():
            text += f"[[parameter]]\nname = '{name}'\nfrom = {0.5 * value}\nto = {2 * value}\nstart = {value}\n"
        text += "[[result]]\nname = 'peak'\nmeasure = 'peak'\ncolumn = 'p.x'\n"
        text += "[[result]]\nname = 'at'\nmeasure = 'value'\nat = 0.4\ncolumn = 'p.x'\n"
        Path("study.toml").write_text(text)
        table = package.sensitivity("study.toml", folder=f"out{number}", jobs=1).to_dataframe()
        for _, row in table.iterrows():
            step = 1.0e-5 * at[row["parameter"]]
            up, down = (swing(**{**at, row["parameter"]: at[row["parameter"]] + sign * step})[row["result"]] for sign in (1, -1))
            truth = (up - down) / (2 * step)
            within.append(abs(row["derivative"] - truth) <= row["error"] + 1.0e-9 * abs(truth))
            relative.append(row["error"] / abs(truth))
    assert len(within) == 72
    assert np.mean(within) >= 0.95
    assert np.median(relative) < 0.02, "errors so large that they always hold say nothing"


def test_the_lightest_damped_arm_takes_less_than_60_runs(tmp_path, biela, monkeypatch):
    """The best of a grid of 200 (post/sweep.py input/studies/damped_arm.toml) has 24.7 g."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("BIELA", str(biela))
    found = package.optimise(ROOT / "input" / "studies" / "damped_arm.toml", folder="out", jobs=1)
    assert found.results.mass == pytest.approx(0.02247, rel=1.0e-3)
    assert found.results.ringing <= 1.0e-3
    assert found.runs < 60
    assert set(found.prices) == {"ringing", "slender"}
    assert found.feasible
    assert found.sensitivities.mass.outer["derivative"] > 0.0
    assert len(found.to_dataframe()) == found.runs - 2
    assert not list(Path("out").glob("*.png")), "drawn when asked for"
    own = package.run(Path("out/optimum.nml"))
    assert np.abs(own["tip.v"][own.time >= 0.3]).max() == pytest.approx(1.0e-3, rel=0.02)


def test_a_catalogue_is_tried_row_by_row(tmp_path, biela, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("BIELA", str(biela))
    text = (ROOT / "input" / "studies" / "damped_arm_tubes.toml").read_text()
    text = text.replace("damped_arm.nml", f"{ROOT}/input/studies/damped_arm.nml").replace("min time", "min mass")
    first, last = text.index('[[parameter]]\nname = "time"'), text.index("[[result]]")
    Path("study.toml").write_text((text[:first] + text[last:]).replace('"mass < 0.026", ', "").replace("8e-3", "6e-3"))
    Path("tubes.csv").write_text((ROOT / "input" / "studies" / "tubes.csv").read_text())
    found = package.optimise("study.toml", jobs=1)
    table = csv.DictReader(Path("results/optimise/study/history.csv").read_text().splitlines())
    rows = [row for row in table if float(row["violation"]) == 0.0]
    assert found.runs == 12
    assert found.parameters.tube == min(rows, key=lambda row: float(row["mass[kg]"]))["tube"]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--at", "outer"], "--at 'outer': NAME=VALUE expected, NAME one of outer, wall"),
        (["--at", "outer=x"], "--at outer: 'x': a number expected"),
        (["--at", "outer=1"], "--at outer=1: a value from 0.01 to 0.02 expected"),
    ],
)
def test_a_design_that_is_no_design(tmp_path, biela, monkeypatch, capsys, words, told):
    monkeypatch.chdir(tmp_path)
    assert sensitivity_command.main([f"{ROOT}/input/studies/damped_arm.toml", "--biela", str(biela), *words]) == 2
    assert capsys.readouterr().err == f"sensitivity: {told}\n"
