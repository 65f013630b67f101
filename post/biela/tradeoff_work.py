"""Speed against accuracy of a deck: the cheapest method, step and model that are accurate enough."""

from __future__ import annotations

import argparse
import contextlib
import html
import math
import os
import signal
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from .command import options_of
from .deck_models import effective_removals
from .deck_runs import InterruptedRunsError, Outcome, OutOfTimeError, Runner, RunsError
from .deck_text import DeckError, DeckText, parse, read
from .tradeoff_causes import PARTS, cancellation, deciding, offset
from .tradeoff_errors import Compared, error_of, sizes_of
from .tradeoff_report import Result, head, nothing_finished, own_setting, setting_words, table, verdict
from .tradeoff_search import EFFECT, cheapest, simplify
from .tradeoff_settings import (
    FAMILIES,
    METHODS,
    Setting,
    TradeoffOptions,
    columns,
    grid_of,
    length_of,
    sensors,
    with_accuracy,
    with_checks,
    with_setting,
)
from .tradeoff_study import EVALUATION_COST, FULL, Point, Study
from .tradeoff_truth import Base, as_written, deck_truth, effect_settings, left_out, parts, refined_truth

if TYPE_CHECKING:
    import pandas

FINALISTS = 4
NEAR = 1.5  # settings whose cost is within this factor of the least are timed again, one at a time
CLOCK = 0.05  # [s] longer runs are ranked by measured time, shorter ones by counts
# shares of --time at which these phases end: the deck as written, the reference, the search
WRITTEN, REFERENCE, SEARCH = 0.25, 0.5, 0.85
DRAWING = 0.7  # [s] of the processor that table and picture take


def first_guesses(study: Study, base: Base) -> dict[str, Setting]:
    """Return, by family, the coarsest setting of the full model's curve that meets the tolerance."""
    found = {}
    for curve in base.curves:
        good = [s for s, o in zip(curve.settings, curve.outcomes) if error_of(o, study.truth).largest <= study.allowed_error]
        found[curve.family] = good[0] if good else curve.settings[-1]
    return found


def search(study: Study, base: Base, result: Result) -> None:
    """Find the cheapest setting that is accurate enough, for each model from the full one to the smallest."""
    starts = first_guesses(study, base)
    families = [curve.family for curve in base.curves]
    if study.allowed_error <= 0.0:
        return
    best = cheapest(study, FULL, base.deck, starts, math.inf, "full model: settings", families)
    if best is None:
        return
    result.important, notes = left_out(study, base, best)
    result.notes += notes
    study.families = families
    effects = effect_settings(study, best, EFFECT)[:3]
    result.path = simplify(study, base.deck, best, effects, starts)
    last = result.path[-1]
    if len(result.path) > 1:
        rest = [s for k in range(-8, 13, 2) if (s := last.setting.finer(k)).exists()]
        study.measure(last.model, last.deck, rest, "curve of the smallest model")
    result.important += deciding(study, base, best, effects, starts)


def explore(study: Study, base: Base, result: Result) -> None:
    """Search as long as there is time; what was measured stays in the study."""
    for curve in base.curves:
        longest = curve.outcomes[-1]
        study.rates[curve.family] = curve.cost / (longest.evaluations * (longest.unknowns + EVALUATION_COST))
        study.keep(FULL, base.deck, curve.settings, curve.outcomes)
    with contextlib.suppress(OutOfTimeError):
        search(study, base, result)
    if study.runner.late():
        ended = f"the search was ended by --time {study.runner.time:g}; the same command with more goes on from there"
        result.notes.append(ended)


def choose(study: Study, budget: float) -> Point | None:
    """Return the cheapest point that is accurate enough, else the most accurate one within the budget; the best few are timed."""
    good = sorted((p for p in study.points if p.error.largest <= study.allowed_error), key=study.ranking_cost)[:FINALISTS]
    alone = []
    for point in (p for p in good if study.ranking_cost(p) <= NEAR * study.ranking_cost(good[0])):
        with contextlib.suppress(OutOfTimeError):
            alone.append(replace(point, outcome=study.runner.timed(study.text(point.deck, point.setting))))
    best = min(alone or good, key=lambda p: p.cost if p.cost > CLOCK else study.ranking_cost(p), default=None)
    if best and best.cost <= budget:
        return best
    affordable = [p for p in study.points if p.cost <= budget]
    return min(affordable, key=lambda p: p.error.largest, default=None) if math.isfinite(budget) else None


def recommend(study: Study, result: Result, point: Point | None, folder: Path) -> None:
    """Write recommended.nml: a point's deck as a run of its own shows it, or the deck as written where none does better.

    A run that met the tolerance by luck misses it with other rows, at which its steps end: then the next best point is taken.
    """
    while point:
        verify(study, result, point)
        found = result.chosen.error
        if found.largest <= study.allowed_error or point.error.largest > study.allowed_error:
            break
        same = [(p.model, p.setting) == (point.model, point.setting) for p in study.points]
        study.points = [replace(p, error=found) if lost else p for p, lost in zip(study.points, same)]
        point = choose(study, result.budget) if any(same) else None
    written, chosen = result.written, result.chosen
    study.update(FULL, own_setting(written.deck), written)
    if point:
        study.update(point.model, setting_words(study, point), chosen)
    if written.error.largest <= study.allowed_error and written.cost <= min(chosen.cost if chosen else math.inf, result.budget):
        result.chosen, result.taken = replace(written, model="recommended.nml"), []
    elif chosen:
        with contextlib.suppress(OutOfTimeError):
            result.important += cancellation(study, point, chosen.error.largest) if point else []
    if result.chosen:
        result.meets = result.chosen.error.largest <= study.allowed_error
        (folder / "recommended.nml").write_text(head(study, result) + result.chosen.deck.text, encoding="utf-8")


def verify(study: Study, result: Result, point: Point) -> None:
    """Run a point's deck as recommended.nml will be, in turn with the deck as written."""
    deck = with_setting(point.deck, point.setting, study.grid, study.grid.stated or study.grid.interval)
    written = result.written
    try:
        if written.outcome.ok:
            outcome, again = study.runner.timed_in_turn(deck.text, written.deck.text)
            result.written = replace(written, outcome=again)
        else:
            outcome = study.runner.timed(deck.text)
    except OutOfTimeError:
        outcome = point.outcome
        result.notes.append("the time ended: the figures of recommended.nml are those of the same run of the search")
    if not outcome.ok:
        raise RunsError(f"recommended.nml does not run: {outcome.message}")
    result.chosen = Point("recommended.nml", point.setting, deck, outcome, error_of(outcome, study.truth))
    result.taken = [] if point.model == FULL else effective_removals(point.model.split("; "))


def run_with_accuracy(study: Study, result: Result, deck: DeckText) -> None:
    """Run the deck with the tolerance as its `accuracy`, where there is time: where that lies beside the curves."""
    text = with_accuracy(deck, study.tolerance, study.grid, study.asked)
    with contextlib.suppress(OutOfTimeError):
        outcome = study.runner.timed(text)
        if outcome.ok:
            found = error_of(outcome, study.truth)
            result.accuracy_run = Point(f"accuracy={study.tolerance:g}", None, parse(text), outcome, found)
            figures = f"error {found.largest:.1e}, {outcome.seconds:.4f} s with all its passes"
            result.notes.append(f"accuracy={study.tolerance:g} in &transient: {figures}")
        checked = with_checks(deck, study.tolerance, study.grid, study.asked)
        if checked:
            outcome = study.runner.all([checked])[0]
            result.model_errors = outcome.model_errors
            if not outcome.ok:
                result.notes.append(f"errors of modes and meshes are not estimated: {outcome.message}")


def split(study: Study, result: Result, deck: DeckText, doublings: int) -> None:
    """Split the errors of the deck as written and of the recommended one into parts; a model that fails leaves a note instead."""
    for name, point in (("deck as written", result.written), ("recommended.nml", result.chosen)):
        if point is None or not point.outcome.ok:
            continue
        try:
            found = parts(study, deck, point.deck, point.outcome, doublings)
        except (RunsError, OutOfTimeError) as fault:
            result.notes.append(f"{name}: its error is not split: {str(fault) or 'the time ended'}")
            continue
        result.parts.append((name, *found))
        result.important += offset(name, dict(zip(PARTS, (part.largest for part in found))), point.error.largest, study.tolerance)


def study_of(options: TradeoffOptions, deck: DeckText, folder: Path) -> Study:
    """Return an empty study of a deck."""
    wanted = sensors(deck, options.sensor)
    families = [name for name, (method, _) in FAMILIES.items() if method in options.methods]
    jobs = options.jobs or os.cpu_count() or 1
    runner = Runner(options.biela, folder / "kept", jobs, options.longest_run, not options.shown, options.time)
    runner.loading_seconds = options.loading_seconds
    grid = grid_of(deck)
    compared = Compared(sizes_of(length_of(deck), grid.interval), sensors=frozenset(wanted))
    return Study(runner, grid, deck.needed_sensors(wanted), options.tolerance, families, compared)


def choose_columns(study: Study, deck: DeckText, written: Outcome, wanted: list[str]) -> None:
    """Let the study compare the columns that were named; DeckError for one that does not exist."""
    if not any("." in word for word in wanted):
        return
    names = written.names
    if not names:  # the run was not finished: the beginning of it tells the names
        transient = deck.one("transient")
        short = {"t_end": f"{study.grid.interval:.17g}", "output_step": f"{study.grid.interval:.17g}"}
        names = study.runner.one(deck.set(transient, **short).text).names
    study.compared = replace(study.compared, columns=columns(names, wanted))


def methods_left_out(options: TradeoffOptions, study: Study, base: Base) -> list[str]:
    """Return the methods that no curve shows, each with the reason."""
    shown = {curve.family for curve in base.curves}
    missing = {name: method for name, (method, _) in FAMILIES.items() if name not in shown}
    failed, unasked = "there was no time for it", "not in --methods"
    why = {name: study.reasons.get(name, failed) if method in options.methods else unasked for name, method in missing.items()}
    return [f"{name}: {reason}" for name, reason in why.items()]


@dataclass(frozen=True)
class Tradeoff:
    """What a study of speed against accuracy has found.

    Attributes:
        folder: of tradeoff.txt, recommended.nml and what was stored
        study: its runs and their errors
        result: the truth, the search, what is recommended; None where no run came to its end
        verdict: a paragraph: what is recommended, or why nothing is
        text: of tradeoff.txt
    """

    folder: Path
    study: Study
    result: Result | None
    verdict: str
    text: str

    @property
    def meets(self) -> bool:
        """Whether the recommended deck is accurate enough."""
        return self.result is not None and self.result.meets

    @property
    def warnings(self) -> list[str]:
        """What the solver warns of, and what a user should know before he trusts the recommendation."""
        return [*self.result.warnings, *self.result.important] if self.result else []

    @property
    def recommended(self) -> Path | None:
        """The deck that is recommended, None where there is none."""
        return self.folder / "recommended.nml" if self.result and self.result.chosen else None

    def to_dataframe(self) -> pandas.DataFrame:
        """Return all runs of the search: model, setting, error of the worst column's range, seconds, evaluations."""
        import pandas

        def row(p: Point) -> list:
            words = p.setting.words(self.study.grid)
            return [p.model, words, p.error.largest, p.error.rms, p.error.column, p.cost, p.outcome.evaluations]

        head = ["model", "setting", "error", "error_rms", "worst_column", "seconds_[s]", "evaluations"]
        return pandas.DataFrame([row(p) for p in self.study.points], columns=head)

    def _repr_html_(self) -> str:
        return f"<p>{html.escape(self.verdict)}</p>" + "".join(f"<p>{html.escape(words)}</p>" for words in self.warnings)


def tradeoff(options: TradeoffOptions) -> Tradeoff:
    """Make the study and write its files, without the picture; BielaError where the deck is wrong."""
    if options.truth not in ("deck", "refined") or not set(options.methods) <= set(METHODS):
        raise RunsError(f"truth = 'deck' or 'refined' and methods of {', '.join(METHODS)} expected")
    deck = read(options.deck, biela=options.biela)
    folder = options.output or Path("results") / "tradeoff" / options.deck.stem
    study = study_of(options, deck, folder)
    runner = study.runner
    try:
        runner.share = WRITTEN
        written = as_written(study, deck)
        runner.share = REFERENCE
        choose_columns(study, deck, written, options.sensor)
        base = (deck_truth if options.truth == "deck" else refined_truth)(study, deck, written)
    except OutOfTimeError:
        paragraph, text = nothing_finished(study, options.deck.name)
        runner.progress.clear()
        (folder / "tradeoff.txt").write_text(text, encoding="utf-8")
        return Tradeoff(folder, study, None, paragraph, text)
    own = Point("deck as written", None, deck, written, error_of(written, study.truth))
    (folder / "recommended.nml").unlink(missing_ok=True)
    result = Result(options.deck.name, options.truth, base.notes, base.curves, own, [], budget=options.budget)
    result.warnings = [f"the solver warns of the deck as written: {words}" for words in written.warnings]
    known = [name for name in base.curves[0].outcomes[-1].names if not study.compared.columns] if base.curves else []
    result.dropped = [name for name in known if name not in study.truth.names and study.compared.has(name)]
    result.methods_left_out = methods_left_out(options, study, base)
    runner.share = SEARCH
    explore(study, base, result)
    runner.share = max(SEARCH, 1.0 - DRAWING * runner.slowness() / options.time)
    recommend(study, result, choose(study, options.budget), folder)
    run_with_accuracy(study, result, deck)
    if base.doublings:
        split(study, result, deck, base.doublings)
    runner.progress.clear()
    found = Tradeoff(folder, study, result, verdict(study, result), table(study, result))
    (folder / "tradeoff.txt").write_text(found.text, encoding="utf-8")
    return found


def run(args: argparse.Namespace) -> int:
    """Make the study, print and draw; the exit status."""
    found = tradeoff(replace(options_of(args, TradeoffOptions), shown=not args.quiet, loading_seconds=time.process_time()))
    if found.result is None:
        print(f"{found.verdict}\nTable: {found.folder}/tradeoff.txt; the same command goes on from what is stored")
        return 1
    from . import tradeoff_picture

    tradeoff_picture.draw(found.study, found.result, found.folder / "work_precision.png")
    print("".join(f"- {line}\n" for line in found.warnings), end="")
    print(found.verdict)
    deck_file = "recommended.nml, " if found.recommended else ""
    print(f"Results: {found.folder}/tradeoff.txt, {deck_file}work_precision.png")
    return 0 if found.meets else 1


def work(args: argparse.Namespace) -> int:
    """Do what the command line asks and return the exit status."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        return run(args)
    except (DeckError, RunsError) as fault:
        print(f"\ntradeoff: {fault}" if sys.stderr.isatty() else f"tradeoff: {fault}", file=sys.stderr)
        return 2
    except (InterruptedRunsError, KeyboardInterrupt):
        print("\ntradeoff: interrupted; what was run is stored, the same command continues", file=sys.stderr)
        return 130
    except BrokenPipeError:
        raise  # the reader of standard output has gone
    except OSError as fault:
        print(f"tradeoff: {fault.filename}: {fault.strerror}", file=sys.stderr)
        return 2
