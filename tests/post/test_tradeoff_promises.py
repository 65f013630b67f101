"""post/tradeoff.py: what it says about a recommendation, and what it holds to whatever the time."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from biela import deck_models, deck_runs, deck_terms, deck_text, tradeoff_causes, tradeoff_truth, tradeoff_work
from biela.deck_runs import COUNTS, Outcome, OutOfTimeError, Runner
from biela.histories import read_summary
from biela.material_law import of_group
from biela.programs import tradeoff as tradeoff_command
from biela.tradeoff_errors import RunError, error_of
from biela.tradeoff_report import Result
from biela.tradeoff_settings import Setting, columns
from biela.tradeoff_study import Point
from biela.tradeoff_truth import Base
from conftest import ROOT, Run
from studies import CRANK, TIMES, outcome, point, study_with


@pytest.mark.parametrize("words", [["--jobs", "0"], ["--jobs", "-5"], ["--jobs", "x"], ["--tolerance", "nan"], ["--time", "inf"]])
def test_numbers_of_the_command_line_are_refused(words, capsys):
    with pytest.raises(SystemExit) as ended:
        tradeoff_command.main([str(CRANK), *words])
    assert ended.value.code == 2
    assert "expected" in capsys.readouterr().err.splitlines()[-1]


def test_columns_are_asked_for_by_their_own_names_or_by_their_sensors():
    names = ("rod", "tip.u", "tip.v", "pin.fx", "pin.fy")
    assert columns(names, ["tip.V", "rod"]) == {"tip.v", "rod"}
    assert columns(names, ["tip.v", "pin"]) == {"tip.v", "pin.fx", "pin.fy"}
    with pytest.raises(deck_text.DeckError, match=r"no column 'tip.w'; its sensor has tip.u, tip.v"):
        columns(names, ["tip.w"])


def tables(biela: Path, folder: Path, monkeypatch, runs: int, *options: str) -> tuple[int, str]:
    """Return the status and the table of a study whose time ends after so many runs of the solver."""
    made, real = [], Runner._run

    def counted(self: Runner, place: Path) -> Outcome:
        if len(made) >= runs and self.share <= tradeoff_truth.LATE:
            raise OutOfTimeError
        made.append(place)
        return real(self, place)

    monkeypatch.setattr(Runner, "_run", counted)
    words = [str(CRANK), "--sensor", "rod", "mid.v", "--tolerance", "1e-2", "--methods", "rk4", "generalized_alpha", *options]
    status = tradeoff_command.main([*words, "--biela", str(biela), "--output", str(folder), "--quiet", "--jobs", "1"])
    return status, (folder / "tradeoff.txt").read_text()


def test_a_study_in_which_no_run_ends_says_how_far_they_came_and_what_would_do(biela, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(deck_runs.time, "process_time", lambda: 0.0)  # what the other tests took is no loading of the tool
    program = tmp_path / "slow"
    said = "deck.nml: stopped by signal 15 at t =  2.000000E-03 s; biela --restart continues from there"
    reads = f'[ "$1" = --flat ] && exec \'{biela}\' "$@"'  # decks are read; runs never end
    program.write_text(f"#!/bin/sh\n{reads}\ntrap \"echo '{said}' >&2; exit 143\" TERM\nwhile :; do sleep 0.01; done\n")
    program.chmod(0o755)
    words = [str(CRANK), "--biela", str(program), "--output", str(tmp_path / "study"), "--quiet", "--time", "3", "--jobs", "2"]
    assert tradeoff_command.main(words) == 1
    text = (tmp_path / "study" / "tradeoff.txt").read_text()
    rows = re.findall(r"^(?:rk4|generalized_alpha) .*  (?:t = 0.002 s of 0.01 s|its set-up)$", text, re.MULTILINE)
    assert rows, text
    assert re.search(r"Give --time \d+ or a shorter t_end", " ".join(text.split()))
    told = capsys.readouterr()
    assert told.err == ""
    assert "nothing is recommended" in told.out


def test_a_study_without_any_run_has_a_table_that_says_so(biela, tmp_path, monkeypatch, capsys):
    status, text = tables(biela, tmp_path, monkeypatch, 0)
    assert status == 1
    assert "No run came to its end" in text
    assert not (tmp_path / "recommended.nml").exists()
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("runs", [9, 14, 60])
def test_the_table_has_rows_whenever_the_time_ends(biela, tmp_path, monkeypatch, capsys, runs):
    status, text = tables(biela, tmp_path, monkeypatch, runs)
    rows = re.findall(r"^\S.*  (?:\* )?(?:full model|deck as written|recommended.nml|rod: .*)$", text, re.MULTILINE)
    assert rows, text
    assert "sensors: mid.v, rod; tolerance" in text
    assert not re.search(r"mid\.[ur] ", text)
    assert status == (0 if (tmp_path / "recommended.nml").exists() else 1)
    assert capsys.readouterr().err == ""


def test_no_run_goes_on_after_its_phase(tmp_path):
    program = tmp_path / "slow"
    program.write_text("#!/bin/sh\nwhile :; do :; done\n")  # how slow runs are is told by what they use of the processor
    program.chmod(0o755)
    runner = Runner(program, tmp_path / "kept", 1, time=1e3)
    runner.share = (1e3 - runner.left() + 0.2) / 1e3
    with pytest.raises(OutOfTimeError):
        runner.one("&scene /\n")  # endless, if it were not ended
    assert runner.left() <= 0.0
    assert not list((tmp_path / "kept").iterdir()), "a run that the time ended is not kept"


def test_a_deck_that_is_the_cheapest_is_recommended_as_it_is(tmp_path, monkeypatch):
    study = study_with(tmp_path)
    written = point(1e-3, 1e-3, 1.0)
    best = point(5e-3, 5e-3, 0.5)
    result = Result("deck.nml", "deck", [], [], written, [])
    for seconds, kept in ((1.2, True), (0.8, False)):
        again = outcome(TIMES + 5e-3, TIMES + 5e-3, seconds=seconds)
        monkeypatch.setattr(study.runner, "timed_in_turn", lambda *_, again=again: (again, written.outcome), raising=False)
        monkeypatch.setattr(tradeoff_work, "cancellation", lambda *_: [])
        result.written = written
        tradeoff_work.recommend(study, result, best, tmp_path)
        text = (tmp_path / "recommended.nml").read_text()
        assert ("is the cheapest that was found to meet" in " ".join(text.split())) == kept
        assert text.endswith(written.deck.text) == kept
        assert result.chosen.cost <= result.written.cost
        assert result.meets


def test_a_point_that_met_the_tolerance_by_luck_gives_way_to_the_next(tmp_path, monkeypatch):
    lucky, next_best, last = point(5e-3, 0.0, 0.1, index=0), point(5e-3, 0.0, 0.2, index=1), point(1e-3, 0.0, 0.5, index=2)
    study = study_with(tmp_path, lucky, next_best, last)
    written = point(1e-3, 1e-3, 1.0)
    steps = {p.setting.size(study.grid): p for p in study.points}

    def of_text(text: str) -> Point:
        return steps[deck_text.parse(text).one("transient").number("step")]

    def timed_in_turn(text: str, _: str) -> tuple[Outcome, Outcome]:
        return (last.outcome if of_text(text) is last else outcome(TIMES + 5e-2, TIMES)), written.outcome

    monkeypatch.setattr(study.runner, "timed_in_turn", timed_in_turn, raising=False)
    monkeypatch.setattr(study.runner, "timed", lambda text: of_text(text).outcome, raising=False)
    monkeypatch.setattr(tradeoff_work, "cancellation", lambda *_: [])
    result = Result("deck.nml", "deck", [], [], written, [])
    tradeoff_work.recommend(study, result, tradeoff_work.choose(study, np.inf), tmp_path)
    assert result.chosen.setting == last.setting
    assert result.meets
    study.points, result.chosen, result.written = [lucky], None, replace(written, error=error_of(lucky.outcome, study.truth))
    monkeypatch.setattr(study.runner, "timed_in_turn", lambda *_: (outcome(TIMES + 5e-2, TIMES), lucky.outcome), raising=False)
    tradeoff_work.recommend(study, result, lucky, tmp_path)
    assert result.meets, "nothing cheaper is left: the deck as written"


def test_effects_are_measured_at_the_cheapest_adequate_setting(tmp_path):
    points = [point(e, 0.0, s, index=k) for k, (e, s) in enumerate([(3e-2, 0.01), (9e-3, 0.02), (4e-3, 0.04), (1e-5, 5.0)])]
    points.append(point(1e-4, 0.0, 0.05, index=0, family="dopri5"))
    points.append(point(1e-4, 0.0, 3.0, index=0, family="generalized_alpha"))
    study = study_with(tmp_path, *points)
    found = tradeoff_truth.effect_settings(study, points[1], 0.5)
    assert found == [Setting("rk4", 1), Setting("rk4", 2), Setting("dopri5", 0)]


LEAN = """&material name='m' density=1000.0 young=1e9 ghm_alpha=0.5 ghm_zeta=2.0 ghm_omega=1000.0 /
&section name='s' area=1e-4 inertia=1e-9 /
&body name='stiff' kind='beam' length=1.0 elements=2 material='m' section='s' flexible=.false. /
&body name='short' kind='beam' length=1.0 elements=2 material='m' section='s' axial=.false. /
&body name='few' kind='beam' length=1.0 elements=4 material='m' section='s' modes=2 /
&body name='dry' kind='beam' length=1.0 elements=2 material='m' section='s' viscoelastic=.false. stiffening=.true. /
&sensor name='q' quantity='coordinate' body='few' index=1 /
&sensor name='a' quantity='angle' body='few' /
&transient t_end=1.0 step=1e-4 /
"""


def test_everything_that_a_deck_leaves_out_is_tried():
    deck = deck_text.parse(LEAN)
    found = tradeoff_truth.larger_models(deck, {"a"}, mesh=True)
    assert set(found) == {
        "the flexibility of stiff",
        "axial deformation",
        "viscoelasticity",
        "what the modes leave out",
        "geometric stiffening",
        "a mesh twice as fine",
    }
    assert found["the flexibility of stiff"].one("body", "stiff").flag("flexible", True)
    assert found["axial deformation"].one("body", "short").flag("axial", True)
    assert found["viscoelasticity"].one("body", "dry").flag("viscoelastic", True)
    stiffened = found["geometric stiffening"]
    assert [b.name for b in stiffened.all("body") if b.flag("stiffening", False)] == ["short", "few", "dry"]
    assert not any(b.number("modes") for b in stiffened.all("body"))
    assert [deck_models.elements_of(b) for b in found["a mesh twice as fine"].all("body")][1:] == [4, 8, 4]
    kept = tradeoff_truth.larger_models(deck, {"q"}, mesh=False)
    assert set(kept) == {"the flexibility of stiff", "axial deformation", "viscoelasticity"}, "mode 1 must stay a coordinate"


def test_what_is_left_out_and_matters_is_told_apart(tmp_path, monkeypatch):
    best = point(9e-3, 0.0, 1.0)
    study = study_with(tmp_path, best)
    models = {"small": "s", "large": "l", "late": "t", "never": "n"}
    off = {"before": 9e-3, "s": 8e-3, "l": 5e-2, "t": 9.1e-3}
    fine = best.setting.doubled().doubled()
    monkeypatch.setattr(tradeoff_truth, "larger_models", lambda *_, **__: dict(models))
    monkeypatch.setattr(study, "text", lambda model, setting: ("before" if model is best.deck else model, setting), raising=False)

    def ran(texts: list, _: str) -> list[Outcome]:
        bad = [model == "n" or (model == "t" and setting != fine) for model, setting in texts]
        return [Outcome(2, "refused") if b else outcome(TIMES + off[m], TIMES) for (m, _), b in zip(texts, bad)]

    monkeypatch.setattr(study.runner, "all", ran, raising=False)
    important, others = tradeoff_truth.left_out(study, Base(best.deck, [], 0, []), best)
    assert important == ["large, which the model leaves out, changes the sensors by 4.1e-02 (a.x)"]
    assert others[0].startswith("small, which the model leaves out, changes the sensors by 1.0e-03")
    assert others[1].startswith("late, which the model leaves out, changes the sensors by 1.0e-04")
    assert others[2] == "never could not be tried: refused"


def test_an_error_that_is_small_because_larger_ones_cancel_is_told(tmp_path, monkeypatch):
    study = study_with(tmp_path)
    chosen = point(1e-3, 0.0, 1.0, model="rod: rigid")
    study.steps = [SimpleNamespace(round=1, label="rod: rigid", change=1.2e-2), SimpleNamespace(round=1, label="other", change=0.5)]
    for fine, told in ((9e-3, True), (1.2e-3, False)):
        monkeypatch.setattr(study.runner, "one", lambda _, fine=fine: outcome(TIMES + fine, TIMES), raising=False)
        study.steps[0].change = 1.2e-2 if told else 1.1e-3
        found = tradeoff_causes.cancellation(study, chosen, 1e-3)
        assert bool(found) == told
    monkeypatch.setattr(study.runner, "one", lambda _: outcome(TIMES + 9e-3, TIMES), raising=False)
    study.steps[0].change = 1.2e-2
    told = tradeoff_causes.cancellation(study, chosen, 1e-3)[0]
    assert told.endswith("alone are off by time integration 8.0e-03, the model 9.0e-03, 'rod: rigid' 1.2e-02")


def test_a_part_that_misses_the_tolerance_by_itself_is_told():
    assert tradeoff_causes.offset("deck", {"the model": 1.3e-2}, 8e-3, 1e-2)
    assert not tradeoff_causes.offset("deck", {"the model": 9e-3}, 8e-3, 1e-2)
    assert not tradeoff_causes.offset("deck", {"the model": 1.3e-2}, 1.2e-2, 1e-2)


def test_the_sensor_that_decides_the_cost_is_named_with_what_leaving_it_out_would_buy(tmp_path, monkeypatch):
    best = point(1e-3, 9e-3, 1.0)
    cheap = point(2e-3, 0.3, 0.1, model="rod: rigid", index=1)
    study = study_with(tmp_path, best, cheap, point(0.5, 0.5, 0.01, index=0))
    monkeypatch.setattr(study.runner, "late", lambda *_: True, raising=False)
    told = tradeoff_causes.deciding(study, Base(best.deck, [], 0, []), best, [best.setting], {})
    assert told == [f"b decides the cost: without it {cheap.setting.words(study.grid)}, rod: rigid, would do, 10 times cheaper"]
    study.points = [best, point(0.3, 0.3, 0.1, index=1)]
    assert tradeoff_causes.deciding(study, Base(best.deck, [], 0, []), best, [best.setting], {}) == []


def test_gaps_of_single_sensors():
    found = RunError(0.3, 0.1, "b.x", {"a.x": 0.1, "a.y": 0.2, "b.x": 0.3})
    assert (found.without("a"), found.without("b"), found.without("c")) == (0.3, 0.2, 0.3)


def work(run: Run) -> int:
    """Return evaluations, Newton iterations among them, times unknowns of a run."""
    summary = read_summary(run.folder)
    return Outcome(0, "", counts={name: summary[part].get(key, 0) for name, (part, key) in COUNTS.items()}).work


OWN = {"five_bar": ("0.01", "2.5e-6"), "press": ("0.008", "2.5e-6"), "swing": ("0.04", "5e-6")}


@pytest.mark.parametrize("name", ["five_bar", *(pytest.param(name, marks=pytest.mark.long) for name in ("press", "swing"))])
def test_recommended_decks_of_own_mechanisms_keep_their_promise_and_are_no_slower(biela, run_deck, tmp_path, monkeypatch, name):
    real = deck_models.removals
    monkeypatch.setattr(deck_models, "removals", lambda *words: real(*words)[::9])  # a part of the search
    t_end, step = OWN[name]
    deck = deck_text.read(ROOT / "tests" / "tradeoff" / f"{name}.nml")
    deck = deck.set(deck.one("transient"), t_end=t_end)
    (tmp_path / "deck.nml").write_text(deck.text)
    words = [str(tmp_path / "deck.nml"), "--tolerance", "1e-2", "--biela", str(biela), "--quiet", "--jobs", "2"]
    words += ["--time", "1e5", "--longest-run", "1e5"]  # the search ends by itself, however busy the machine
    assert tradeoff_command.main([*words, "--output", str(tmp_path / "study")]) == 0
    path = tmp_path / "study" / "recommended.nml"
    fine = deck.set(deck.one("transient"), step=step)
    truth, run, own = (run_deck(d) for d in (fine.text, path, tmp_path / "deck.nml"))
    for column in truth.history.names[1:]:
        exact = np.interp(run.history.time, truth.history.time, truth.history[column])
        if np.ptp(exact) > 1e-9 * np.abs(truth.history.data[:, 1:]).max():
            assert np.abs(run.history[column] - exact).max() < 1e-2 * np.ptp(exact), column
    assert work(run) <= work(own), "evaluations x unknowns of the recommended deck and of the one given"


SCALED = """&material name='m' density=1000.0 young=1e9 ghm_alpha=0.5,0.2 ghm_zeta=2.0,3.0 ghm_omega=1e3,1e2 prony_alpha=0.3
 prony_tau=1e-2 ghm_frequency_scale=3.0 /
&spring name='s' type='torsional' body_a='a' stiffness=5.0 ghm_alpha=1.0 ghm_zeta=5.0 ghm_omega=20.0 /
"""


def test_maxwell_terms_take_the_place_of_ghm_terms_with_the_error_that_is_told():
    deck = deck_text.parse(SCALED)
    for group, internal in ((deck.groups[0], 5), (deck.groups[1], 2)):
        law = of_group(group)
        assert law.internal_variables == internal
        found = [c for c in deck_terms.changes(group, 1000.0, 0.5) if "modulus within" in c[0]]
        assert len(found) == (3 if internal == 5 else 1)
        for label, values in found:
            changed = deck.set(group, **values)
            other = of_group(changed.one(group.kind))
            assert other.weight.size == int(label.split()[1])
            assert other.alpha.size == 0
            assert changed.one(group.kind).number("ghm_frequency_scale", 1.0) == 1.0
            told = float(re.search(r"within (\S+)\)", label)[1])
            band = np.geomspace(law.slowest_pole / (20.0 * np.pi), 1000.0, 333)
            assert np.abs(other.modulus(band) / law.modulus(band) - 1.0).max() == pytest.approx(told, rel=0.6)
        errors = [float(re.search(r"within (\S+)\)", label)[1]) for label, _ in found]
        assert errors == sorted(errors, reverse=True)
    assert not [c for c in deck_terms.changes(deck.groups[0], 1000.0, 1e-12) if "modulus within" in c[0]]


def test_a_term_goes_or_becomes_stiffness():
    """Left out: the modulus of slow motion stays; made stiffness: that of fast motion does."""
    group = deck_text.parse(SCALED).groups[0]
    law, slow, fast = of_group(group), np.array([1e-6]), np.array([1e9])
    for label, values in deck_terms.changes(group, 1000.0, 0.0):
        other = of_group(deck_text.parse(SCALED).set(group, **values).groups[0])
        assert other.internal_variables == law.internal_variables - (1 if "Maxwell" in label else 2)
        kept = slow if "left out" in label else fast
        np.testing.assert_allclose(other.modulus(kept), law.modulus(kept), rtol=1e-5)
    assert len(deck_terms.changes(group, 1000.0, 0.0)) == 6


def test_static_shapes_are_tried_beside_few_modes_and_go_with_the_modes():
    deck = deck_text.parse(LEAN.replace("elements=4 material='m' section='s' modes=2", "elements=4 material='m' section='s'"))
    offered = {c.label: c for c in deck_models.removals(deck, {"a"}, 100.0, 0.0) if c.kind == "shapes"}
    counts = {int(label.split()[1]) for label in offered if label.startswith("few")}
    assert counts == {1, 2, 3, 4}, "at most a third of the twelve coordinates"
    shaped = offered["few: 4 modes and static shapes"].deck
    assert shaped.one("body", "few").flag("static_shapes", False)
    fewer = [c.label for c in deck_models.removals(shaped, {"a"}, 100.0, 0.0) if c.body == "few" and "mode" in c.label]
    assert fewer == [f"few: {k} mode{'s' * (k > 1)} and static shapes" for k in (3, 2, 1)]
    for model in (deck_models.refined(shaped, 1, {"a"}), *tradeoff_truth.larger_models(shaped, {"a"}, mesh=False).values()):
        body = model.one("body", "few")
        assert bool(body.number("modes")) == body.flag("static_shapes", False), "nodal coordinates have no static shapes"
    labels = ["few: 8 modes of 12 coordinates", "few: 2 modes and static shapes", "m: 2 Maxwell terms (modulus within 0.1)"]
    assert deck_models.effective_removals(labels) == labels[1:]
    assert deck_models.effective_removals([*labels, "few: rigid"]) == [labels[2], "few: rigid"]


def test_the_elastomer_is_told_to_be_maxwell_terms_by_a_reference_of_radau(biela, run_deck, tmp_path, monkeypatch):
    """Explicit steps are bound by a GHM pole of 4.5e5 1/s: radau is the cheapest method that converges."""
    real = deck_models.removals
    monkeypatch.setattr(deck_models, "removals", lambda *words: [c for c in real(*words) if c.body == "elastomer"])
    monkeypatch.setattr(tradeoff_work, "left_out", lambda *_: ([], []))
    deck = deck_text.read(ROOT / "input" / "elastomer_cantilever.nml")
    deck = deck.set(deck.one("transient"), t_end="0.05")
    (tmp_path / "deck.nml").write_text(deck.text)
    words = [str(tmp_path / "deck.nml"), "--tolerance", "1e-3", "--biela", str(biela), "--quiet", "--jobs", "2", "--sensor", "tip"]
    words += ["--time", "1e5", "--longest-run", "1e5", "--methods", "rk4", "radau"]
    assert tradeoff_command.main([*words, "--output", str(tmp_path / "study")]) == 0
    text = (tmp_path / "study" / "tradeoff.txt").read_text()
    assert "the deck's model, radau tolerance" in text
    assert re.search(r"elastomer: 3 Maxwell terms \(modulus within \de-05\) .* taken", text)
    run = run_deck(tmp_path / "study" / "recommended.nml")
    assert "of first order: " in run.summary
    exact = run_deck(deck.set(deck.one("transient"), method="'radau'", step=None, tolerance="1e-8").text, name="exact").history
    for column in ("tip.v", "tip.r"):
        truth = np.interp(run.history.time, exact.time, exact[column])
        assert np.abs(run.history[column] - truth).max() < 1e-3 * np.ptp(truth)
    assert 10 * work(run) < work(run_deck(tmp_path / "deck.nml"))
