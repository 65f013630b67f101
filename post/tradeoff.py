#!/usr/bin/env python3
"""Speed against accuracy, measured for a deck: which method, which step, and the smallest model that is good enough.

Runs variants of the deck, measures the error of its sensors against a converged truth, takes out of the model what the sensors
do not notice, and writes into results/tradeoff/<deck name>/:
  tradeoff.txt         every run: error, seconds, evaluations; what each removal changes; the cheapest adequate setting
  recommended.nml      the deck with that setting and model, comments kept; error and speed-up are those of its own run
  work_precision.png   error against seconds
  kept/                all runs, by the hash of their deck: an interrupted study resumes

The truth is the deck's own model converged in time (--truth deck), or a refined one (--truth refined: nodal coordinates, axial
deformation, a finer mesh); materials, loads and bodies that the deck calls rigid are taken as they are.

Exit status: 0 recommended.nml meets the tolerance, 1 nothing does (within the budget), 2 the deck or the command line is wrong,
130 interrupted: the same command continues.
"""

from __future__ import annotations

import argparse
import math
import os
import signal
import sys
from dataclasses import replace
from pathlib import Path

import command
from deck_models import in_force
from deck_runs import InterruptedRunsError, OutOfTimeError, Runner, RunsError
from deck_text import DeckError, DeckText, read
from tradeoff_errors import gap, sizes_of
from tradeoff_picture import draw
from tradeoff_report import Result, head, table, verdict
from tradeoff_search import EFFECT, cheapest, greedy
from tradeoff_settings import FAMILIES, METHODS, Setting, grid_of, length_of, sensors, with_setting
from tradeoff_study import CALL, Point, Study
from tradeoff_truth import Base, as_written, deck_truth, effect_settings, parts, refined_truth, stiffened

FULL = "full model"
FINALISTS = 4
CLOCK = 0.05  # [s] runs timed alone are ranked by the clock where they take longer


def first_guesses(study: Study, base: Base) -> dict[str, Setting]:
    """Return, by family, the coarsest setting of the full model's curve that meets the tolerance."""
    found = {}
    for made in base.curves:
        good = [s for s, o in zip(made.settings, made.outcomes) if gap(o, study.truth).largest <= study.room]
        found[made.family] = good[0] if good else made.settings[-1]
    return found


def search(study: Study, base: Base) -> list[Point]:
    """Return the cheapest adequate point of each model from the full one to the smallest, empty where none is adequate."""
    for made in base.curves:
        longest = made.outcomes[-1]
        study.rates[made.family] = made.cost / (longest.evaluations * (longest.unknowns + CALL))
        study.measure(FULL, base.deck, made.settings, "curves")
    starts = first_guesses(study, base)
    families = [made.family for made in base.curves]
    best = cheapest(study, FULL, base.deck, starts, math.inf, "full model: settings", families)
    if best is None:
        return []
    study.families = families
    return greedy(study, base.deck, best, effect_settings(study, base, EFFECT), starts)


def explore(study: Study, base: Base, result: Result) -> None:
    """Search as long as there is time; what was measured stays in the study."""
    try:
        result.notes.append(stiffened(study, base.deck, effect_settings(study, base, EFFECT)[0]))
        result.path = search(study, base)
        if len(result.path) > 1:
            last = result.path[-1]
            rest = [s for k in range(-8, 13, 2) if (s := last.setting.finer(k)).exists()]
            study.measure(last.model, last.deck, rest, "curve of the smallest model")
    except OutOfTimeError:
        pass
    if study.runner.late():
        ended = f"the search was ended after {study.runner.time:g} s (--time); the same command goes on from there"
        result.notes.append(ended)


def choose(study: Study, budget: float) -> Point | None:
    """Return the cheapest adequate point, timed alone among the best few; within the budget, else the most accurate there."""
    good = sorted((p for p in study.points if p.gap.largest <= study.room), key=study.price)[:FINALISTS]
    alone = [replace(p, outcome=study.runner.timed(study.text(p.deck, p.setting))) for p in good]
    best = min(alone, key=lambda p: p.cost if p.cost > CLOCK else study.price(p), default=None)
    if best and best.cost <= budget:
        return best
    affordable = [p for p in study.points if p.cost <= budget]
    return min(affordable, key=lambda p: p.gap.largest, default=None) if math.isfinite(budget) else None


def verify(study: Study, result: Result, point: Point, folder: Path) -> None:
    """Write recommended.nml, run it, and put what that run shows into its head."""
    deck = with_setting(point.deck, point.setting, study.grid, study.grid.stated or study.grid.interval)
    outcome = study.runner.timed(deck.text)
    if not outcome.ok:
        raise RunsError(f"recommended.nml does not run: {outcome.message}")
    result.chosen = Point("recommended.nml", point.setting, deck, outcome, gap(outcome, study.truth))
    result.taken = [] if point.model == FULL else in_force(point.model.split("; "))
    result.meets = result.chosen.gap.largest + study.truth.uncertainty <= study.tolerance
    (folder / "recommended.nml").write_text(head(study, result) + deck.text, encoding="utf-8")


def split(study: Study, result: Result, deck: DeckText, doublings: int) -> None:
    """Split the errors of the deck as written and of the recommended one into parts; a model that fails leaves a note instead."""
    for name, point in (("deck as written", result.written), ("recommended.nml", result.chosen)):
        if point is None:
            continue
        try:
            result.parts.append((name, *parts(study, deck, point.deck, point.outcome, doublings)))
        except RunsError as fault:
            result.notes.append(f"{name}: its error is not split: {fault}")


def study_of(args: argparse.Namespace, deck: DeckText, folder: Path) -> Study:
    """Return an empty study of a deck."""
    asked = sensors(deck, args.sensor)
    families = [name for name, (method, _) in FAMILIES.items() if method in args.methods]
    runner = Runner(args.biela, folder / "kept", args.jobs, min(args.longest_run, args.time), args.quiet, args.time)
    grid = grid_of(deck)
    return Study(runner, grid, asked, args.tolerance, families, sizes_of(length_of(deck), grid.interval))


def run(args: argparse.Namespace) -> int:
    """Make the whole study; the exit status."""
    deck = read(args.deck)
    folder = args.output or Path("results") / "tradeoff" / args.deck.stem
    study = study_of(args, deck, folder)
    written = as_written(study, deck)
    base = (deck_truth if args.truth == "deck" else refined_truth)(study, deck)
    own = Point("deck as written", None, deck, written, gap(written, study.truth))
    result = Result(args.deck.name, args.truth, base.notes, base.curves, own, [], budget=args.budget)
    explore(study, base, result)
    late, study.runner.time = study.runner.late(), math.inf
    point = choose(study, args.budget)
    if point:
        verify(study, result, point, folder)
    if args.truth == "refined" and not late:
        split(study, result, deck, base.doublings)
    result.notes = [note for note in result.notes if note]
    study.runner.clear_line()
    (folder / "tradeoff.txt").write_text(table(study, result), encoding="utf-8")
    draw(study, result, folder / "work_precision.png")
    print(verdict(study, result))
    print(f"Table, deck and picture: {folder}/tradeoff.txt, recommended.nml, work_precision.png")
    return 0 if result.meets else 1


def positive(text: str) -> float:
    """Return a number above zero from the command line."""
    try:
        number = float(text)
    except ValueError:
        number = 0.0
    if not 0.0 < number < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r}: a number above 0 expected")
    return number


def arguments() -> argparse.ArgumentParser:
    """Return the command line's parser."""
    about = {"description": __doc__.split("\n")[0], "epilog": "see the head of post/tradeoff.py"}
    parser = argparse.ArgumentParser(prog="tradeoff.py", **about)
    parser.add_argument("deck", type=Path, help="the deck, with a &transient and sensors")
    parser.add_argument("--sensor", nargs="+", default=[], metavar="NAME", help="sensors that must be right (all)")
    parser.add_argument("--tolerance", type=positive, default=1.0e-3, help="largest error, relative to the range (%(default)g)")
    parser.add_argument("--budget", type=positive, default=math.inf, metavar="SECONDS", help="of a recommended run at most (any)")
    parser.add_argument("--truth", choices=["deck", "refined"], default="deck", help="measures errors (%(default)s)")
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=list(METHODS), help="methods that are tried (all)")
    parser.add_argument("--output", type=Path, help="folder (results/tradeoff/<deck name>)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="runs at a time (%(default)s)")
    parser.add_argument("--longest-run", type=positive, default=120.0, metavar="SECONDS", help="of any run at most (%(default)g)")
    parser.add_argument("--time", type=positive, default=600.0, metavar="SECONDS", help="of the whole search (%(default)g)")
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    parser.add_argument("--biela", type=Path, default=Path("bin/biela"), help="the solver (%(default)s)")
    return parser


def main(words: list[str] | None = None) -> int:
    """Do what the command line asks and return the exit status."""
    args = arguments().parse_args(words)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        return run(args)
    except (DeckError, RunsError) as fault:
        print(f"\ntradeoff: {fault}" if sys.stderr.isatty() else f"tradeoff: {fault}", file=sys.stderr)
        return 2
    except OutOfTimeError:
        print(f"tradeoff: no reference within {args.time:g} s; give more --time, the same command goes on", file=sys.stderr)
        return 2
    except (InterruptedRunsError, KeyboardInterrupt):
        print("\ntradeoff: interrupted; what was run is kept, the same command continues", file=sys.stderr)
        return 130
    except BrokenPipeError:
        raise  # the reader of standard output has gone
    except OSError as fault:
        print(f"tradeoff: {fault.filename}: {fault.strerror}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    command.run(main)
