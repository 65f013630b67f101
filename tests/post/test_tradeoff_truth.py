"""The truth of a trade-off study and what it says where the time ends, a run fails or a mesh does not settle."""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from biela import deck_models, deck_text, tradeoff_errors, tradeoff_search, tradeoff_truth, tradeoff_work
from biela.deck_runs import Outcome, OutOfTimeError, RunsError
from biela.programs import tradeoff as tradeoff_command
from biela.tradeoff_curves import Curve
from biela.tradeoff_errors import Compared, RunError, error_of, truth_of
from biela.tradeoff_report import Result, head, table, verdict
from biela.tradeoff_settings import Setting
from biela.tradeoff_study import FULL, Step, Study
from biela.tradeoff_truth import Base, deck_truth, refined_truth
from studies import CRANK, TIMES, outcome, point, study_with

DECK = deck_text.read(CRANK)
FAILED = Outcome(2, "line 3: refused")


def curve(off: float = 0.0, left: float = 1e-6, seconds: float = 1.0, family: str = "rk4") -> Curve:
    """Return a curve whose finest run is off by so much."""
    return Curve(family, [Setting(family, 5)], [outcome(TIMES + off, TIMES, seconds=seconds)], left)


@pytest.fixture
def study(tmp_path) -> Study:
    return study_with(tmp_path)


@pytest.mark.parametrize("message", ["line 3: refused", ""])
def test_a_model_that_never_converged_is_told_with_what_the_solver_says(study, monkeypatch, message):
    monkeypatch.setattr(tradeoff_truth, "curves", lambda *_, **__: [curve(left=math.inf)])
    monkeypatch.setattr(study.runner, "one", lambda _: Outcome(2 if message else 0, message))
    with pytest.raises(RunsError) as fault:
        tradeoff_truth._best(study, DECK, "reference")
    told = "reference: no method converged within 300 s a run or half of --time"
    assert str(fault.value) == told + (f"; the solver says: {message}" if message else "")


def test_without_any_curve_the_deck_as_written_is_the_truth(study, monkeypatch):
    monkeypatch.setattr(tradeoff_truth, "curves", lambda *_: [])
    base = deck_truth(study, DECK, outcome(TIMES, 2.0 * TIMES))
    assert (base.curves, base.doublings) == ([], 0)
    assert study.truth.words == "the deck as written: no other run came to its end in time"
    assert study.truth.uncertainty == math.inf
    np.testing.assert_array_equal(study.truth.values[:, 1], 2.0 * TIMES)
    assert study.runner.share == tradeoff_truth.LATE, "the reference had the search's time, too"
    with pytest.raises(RunsError, match=r"^no run came to its end: line 3: refused$"):
        deck_truth(study, DECK, FAILED)
    study.runner.time = 5.0
    with pytest.raises(OutOfTimeError):
        deck_truth(study, DECK, FAILED)


def test_a_truth_that_may_not_have_converged_says_so(study, monkeypatch):
    monkeypatch.setattr(tradeoff_truth, "curves", lambda *_: [curve(left=math.inf), curve(3e-3, family="dopri5")])
    base = deck_truth(study, DECK, FAILED)
    assert study.truth.words.endswith(", not known to have converged: the time ended")
    assert base.notes[0].startswith("dopri5: its finest run (dopri5 tolerance")
    assert base.notes[0].endswith("is 3.0e-03 away")


@pytest.mark.parametrize(("fault", "why"), [(RunsError("no second mesh"), "no second mesh"), (OutOfTimeError(), "the time ended")])
def test_without_a_refined_truth_the_decks_own_model_takes_its_place(study, monkeypatch, fault, why):
    def meshes(*_: object) -> None:
        raise fault

    monkeypatch.setattr(tradeoff_truth, "_meshes", meshes)
    monkeypatch.setattr(tradeoff_truth, "curves", lambda *_: [curve()])
    base = refined_truth(study, DECK, FAILED)
    assert base.notes == [f"no refined truth: {why}; the errors are those of the time integration alone"]
    assert study.truth.words.startswith("the deck's model, rk4 step")
    assert study.runner.share == tradeoff_truth.SECOND


def refinement(study: Study, monkeypatch, *found: Curve | None) -> tuple[list[Base], list[str], float]:
    """Return what comes of meshes whose curves are given, None: that mesh fails."""
    waiting = list(found)

    def best(*_: object, **__: object) -> list[Curve]:
        if (made := waiting.pop(0)) is None:
            raise RunsError("no method converged")
        return [made]

    monkeypatch.setattr(tradeoff_truth, "_best", best)
    return tradeoff_truth._meshes(study, DECK)


def test_meshes_are_doubled_until_they_settle(study, monkeypatch):
    meshes, notes, left = refinement(study, monkeypatch, curve(8e-3), curve(1e-3), curve(1e-4), curve())
    assert [deck_models.elements_of(mesh.deck.one("body", "rod")) for mesh in meshes] == [2, 4, 8]
    assert notes == ["mesh x 2: 7.0e-03 from the one before", "mesh x 4: 9.0e-04 from the one before"]
    assert left < tradeoff_truth.SETTLED * study.tolerance


def test_a_mesh_that_is_too_dear_or_fails_ends_the_refinement(study, monkeypatch):
    study.runner.longest = 10.0
    meshes, notes, _ = refinement(study, monkeypatch, curve(8e-3), curve(1e-3, seconds=3.0), curve(9e-3, seconds=9.0))
    assert len(meshes) == 3
    assert notes[-1] == "mesh x 8 would take more than 10 s a run"
    meshes, notes, _ = refinement(study, monkeypatch, curve(8e-3), curve(1e-3), None)
    assert len(meshes) == 2
    assert notes[-1] == "mesh x 4: no converged run within 10 s or the study's time"
    with pytest.raises(RunsError, match=r"^no method converged$"):
        refinement(study, monkeypatch, None)
    for seconds, why in ((1.0, "mesh x 2: no converged run within 10 s or the study's time"), (4.0, "mesh x 2 would take more")):
        with pytest.raises(RunsError) as fault:
            refinement(study, monkeypatch, curve(seconds=seconds), None)
        assert str(fault.value).startswith(f"no second mesh to compare with: {why}")
        assert str(fault.value).endswith("more --time or --longest-run, or fewer sensors, would help")


@pytest.mark.parametrize(
    ("own", "first", "start", "notes"),
    [
        (curve(1e-3), curve(), "deck", ["the search starts from the deck's own model, whose own error is 1.0e-03 (a.x)"]),
        (
            None,
            curve(2e-3),
            "x1",
            [
                "the deck's own model: no converged run in time",
                "the search starts from the model of mesh x 1, whose own error is 2.0e-03 (a.x)",
            ],
        ),
        (
            curve(5e-2),
            curve(9e-3),
            "x2",
            [
                "the deck's own model has an error of 5.0e-02 of its own (a.x)",
                "the model of mesh x 1 has an error of 9.0e-03 of its own (a.x)",
                "the search starts from the model of mesh x 2",
            ],
        ),
        (curve(left=math.inf), curve(0.0, left=1e-2), "x2", ["the deck's own model: no converged run in time"]),
    ],
)
def test_the_search_starts_from_the_coarsest_model_that_is_right(study, monkeypatch, own, first, start, notes):
    models = {name: DECK.set(DECK.one("scene"), title=f"'{name}'") for name in ("deck", "x1", "x2")}
    monkeypatch.setattr(tradeoff_truth, "curves", lambda _, deck, *__, **___: [own] if own and deck is models["deck"] else [])
    meshes = [Base(models["x1"], [first], 0, []), Base(models["x2"], [curve()], 1, [])]
    found = tradeoff_truth._start(study, models["deck"], meshes, [])
    assert found.deck is models[start]
    assert found.notes[: len(notes)] == notes
    assert found.doublings == 1


def test_runs_that_cannot_be_compared_are_told():
    truth = truth_of(outcome(TIMES, TIMES), Compared({}))
    with pytest.raises(RunsError, match=r"a run lacks the column b\.x"):
        error_of(outcome(TIMES, TIMES, names=("a.x", "c.x")), truth)
    short = outcome(TIMES, TIMES)
    with pytest.raises(RunsError, match="a run lacks rows at the times of the reference"):
        error_of(replace(short, data=short.data[::2]), truth)


def test_nothing_is_recommended_where_nothing_is_known(study):
    result = Result("deck.nml", "deck", [], [], point(1e-3, 0.0, 2.0), [])
    own = "The deck as written has an error of 1.0e-03 and takes 2.0000 s."
    known = f"No setting that was tried meets 0.01 of each sensor's range. {own} The truth itself is known to 0.0e+00."
    assert verdict(study, result) == known
    study.truth = replace(study.truth, uncertainty=math.inf)
    study.runner.time = 5.0
    rough = f"No reference converged within --time 5: nothing is recommended, errors are rough. {own}"
    assert verdict(study, result) == rough
    result.written = replace(result.written, outcome=FAILED)
    assert verdict(study, result).endswith("The deck as written was not measured: line 3: refused.")


def test_the_interval_of_rows_is_told_where_the_deck_states_none(study):
    result = Result("deck.nml", "deck", [], [], point(1e-3, 0.0, 2.0), [])
    told = f"Here a row stands each {study.grid.interval:g} s."
    assert (told in head(study, result)) == (not study.grid.stated)
    study.grid = replace(study.grid, stated=0.0)
    assert told in head(study, result)
    study.grid = replace(study.grid, stated=study.grid.interval)
    assert told not in head(study, result)


def test_a_search_without_a_known_truth_or_time_leaves_what_it_has(study, monkeypatch):
    result = Result("deck.nml", "deck", [], [], point(1e-3, 0.0, 2.0), [])
    study.truth = replace(study.truth, uncertainty=1.0)
    tradeoff_work.search(study, Base(DECK, [curve()], 0, []), result)
    assert (result.path, result.notes, result.important) == ([], [], [])
    monkeypatch.setattr(study.runner, "late", lambda: True)
    study.runner.time = 7.0
    tradeoff_work.explore(study, Base(DECK, [curve()], 0, []), result)
    assert result.notes == ["the search was ended by --time 7; the same command with more goes on from there"]
    assert [p.model for p in study.points] == [FULL]
    assert study.rates["rk4"] == pytest.approx(1.0 / (1000 * (10 + 40)))


def test_a_recommendation_that_the_time_or_the_solver_does_not_allow_to_run(study, monkeypatch):
    chosen, unmeasured = point(2e-3, 0.0, 0.5), replace(point(1e-3, 0.0, 2.0), outcome=Outcome(-1, "too long"))
    result = Result("deck.nml", "deck", [], [], unmeasured, [])
    monkeypatch.setattr(study.runner, "timed", lambda _: outcome(TIMES + 1e-3, TIMES, seconds=0.25))
    tradeoff_work.verify(study, result, chosen)
    assert (result.chosen.cost, result.chosen.error.largest) == (0.25, pytest.approx(1e-3))

    def late(_: str) -> None:
        raise OutOfTimeError

    monkeypatch.setattr(study.runner, "timed", late)
    tradeoff_work.verify(study, result, chosen)
    assert (result.chosen.cost, result.chosen.error.largest) == (0.5, pytest.approx(2e-3))
    assert result.notes == ["the time ended: the figures of recommended.nml are those of the same run of the search"]
    monkeypatch.setattr(study.runner, "timed", lambda _: FAILED)
    with pytest.raises(RunsError, match=r"^recommended\.nml does not run: line 3: refused$"):
        tradeoff_work.verify(study, result, chosen)


def test_removals_that_were_run_before_the_time_ended_stay_in_the_table(study, monkeypatch):
    best = point(1e-3, 0.0, 1.0)
    options = [SimpleNamespace(label=label, deck=DECK) for label in ("rod: rigid", "rod: elastic twin")]
    monkeypatch.setattr(study, "removals", lambda _: options)
    monkeypatch.setattr(study, "text", lambda *_: str(len(texts)) if texts.append(0) is None else "")
    kept = {"1": outcome(TIMES, TIMES), "2": outcome(TIMES + 4e-3, TIMES), "3": None}
    texts: list[int] = []

    def late(*_: object) -> None:
        raise OutOfTimeError

    monkeypatch.setattr(study.runner, "all", late)
    monkeypatch.setattr(study.runner, "stored", kept.get)
    assert tradeoff_search.simplify(study, DECK, best, [best.setting], {}) == [best]
    first, second = study.steps
    assert (first.label, first.effect.largest, first.change) == ("rod: rigid", pytest.approx(4e-3), pytest.approx(4e-3))
    assert second == Step(1, "rod: elastic twin", RunError(math.inf, math.inf, ""), note="not run")


def test_a_solver_that_is_no_program_is_told_in_one_line(tmp_path, capsys):
    (tmp_path / "text").write_text("no program\n")
    words = [str(CRANK), "--biela", str(tmp_path / "text"), "--output", str(tmp_path / "out"), "--quiet"]
    assert tradeoff_command.main(words) == 2
    assert capsys.readouterr().err.startswith(f"tradeoff: {tmp_path / 'text'}: cannot be run (Permission denied): ")


@pytest.mark.parametrize(("fault", "why"), [(RunsError("no fine mesh"), "no fine mesh"), (OutOfTimeError(), "the time ended")])
def test_an_error_that_is_not_split_leaves_a_note(study, monkeypatch, fault, why):
    def parts(*_: object) -> None:
        raise fault

    monkeypatch.setattr(tradeoff_work, "parts", parts)
    result = Result("deck.nml", "refined", [], [], point(1e-3, 0.0, 2.0), [])
    tradeoff_work.split(study, result, DECK, 1)
    assert (result.parts, result.notes) == ([], [f"deck as written: its error is not split: {why}"])


def test_columns_of_rounding_are_not_compared_unless_they_are_asked_for():
    """Beside a motion of the same unit, or of the scene's size; where all are rounding all are kept."""
    small = 1.0e-15 * np.sin(50.0 * TIMES)
    for state in ("pad.state", "servo.limited", "most.node"):
        run = outcome(TIMES, 1.0 * (TIMES[1] < TIMES), names=("a.x", state))
        assert tradeoff_errors.truth_of(run, Compared({})).names == ("a.x",)
    run = outcome(TIMES, small, names=("a.x", "a.y"))
    assert tradeoff_errors.rounding_columns(run, {}) == ["a.y"]
    assert tradeoff_errors.truth_of(run, Compared({})).names == ("a.x",)
    assert tradeoff_errors.truth_of(run, Compared({}, frozenset({"a.y"}))).names == ("a.y",)
    still = outcome(small, small)
    assert tradeoff_errors.rounding_columns(still, {}) == []
    assert tradeoff_errors.rounding_columns(outcome(small, 1.0e-3 * TIMES), {"m": 1.0}) == ["a.x"]


def test_what_the_solver_warns_of_and_what_is_absent_are_told(tmp_path):
    curve = Curve("rk4", [], [])
    args = argparse.Namespace(methods=["rk4", "radau"])
    base = SimpleNamespace(curves=[curve])
    study = study_with(tmp_path, point(1e-3, 1e-3, 1.0))
    study.reasons["radau"] = "radau step 0.1 s: the step is too large"
    assert tradeoff_work.methods_left_out(args, study, base) == [
        "dopri5: not in --methods",
        "generalized_alpha: not in --methods",
        "radau: radau step 0.1 s: the step is too large",
        "radau adaptive: there was no time for it",
    ]
    warning = "the solver warns of the deck as written: body bends too far"
    told = dict(warnings=[warning], dropped=["a.y", "pad.state"], methods_left_out=["dopri5: not in --methods"])
    result = Result("a.nml", "deck", [], [], study.points[0], [], **told)
    lines = table(study, result).splitlines()
    assert lines[2] == f"- {warning}"
    assert "not compared, rounding alone: a.y" in lines
    assert "not compared, states, whose events are compared by their times: pad.state" in lines
    assert "left out: dopri5: not in --methods" in lines
    assert "  none was tried: there is no adequate setting, or nothing to remove" in lines, "no empty tables"
    assert warning in head(study, result)


def test_a_setting_has_one_cost_and_one_error_wherever_it_stands(tmp_path):
    """What the last run of a setting measured replaces the search's figures, of that model and that setting alone."""
    old, other, smaller = point(1e-3, 1e-3, 1.0), point(1e-3, 1e-3, 2.0, index=4), point(1e-3, 1e-3, 3.0, "without x")
    study = study_with(tmp_path, old, other, smaller)
    study.steps.append(Step(1, "x", old.error, best=old))
    study.update(old.model, old.setting.words(study.grid), point(2e-3, 1e-3, 0.5))
    assert [p.cost for p in study.points] == [0.5, 2.0, 3.0]
    assert study.steps[0].best.error.largest == study.points[0].error.largest == pytest.approx(2 * old.error.largest)
