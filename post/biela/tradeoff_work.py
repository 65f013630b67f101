"""Speed against accuracy of a deck: the cheapest method, step and model that are accurate enough."""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from .command import Progress, options_of
from .deck import Deck, read, run_into
from .result_files import BielaError
from .study_runs import StudyRuns
from .sweep_study import Study, StudyOptions
from .tradeoff_errors import against
from .tradeoff_settings import FAMILIES, METHODS, Setting, TradeoffOptions, grid_of, lean, removals, sensors, with_setting
from .tradeoff_words import Point, Tradeoff

CERTAIN = 0.05  # the truth is asked for with this share of the tolerance
BELOW = 0.1  # curves go on until their error is below this share of what is allowed
LEVELS, DEAR, SHORT = 12, 4.0, 1.0  # of a curve at most; it ends where the next run costs so many times the best one, and [s] more
OVERHEAD = 40  # fixed cost of an evaluation, in unknowns: small models are not cheaper than that
EXACT = 2.0  # [s] shorter runs are ranked by counts of evaluations: their measured times vary too much
GAIN = 0.97  # a removal pays where it lowers the cost below this share
REPEATS = 5  # of the runs that are timed, in turn


class Search:
    """Makes the runs of a trade-off and fills what it has found."""

    def __init__(self, found: Tradeoff, deck: Deck, asked: set[str], runs: StudyRuns, begun: float) -> None:
        self.found, self.deck, self.asked, self.runs = found, deck, asked, runs
        self.rates: dict[str, float] = {}  # [s] of an evaluation of one unknown, by family, from its longest run
        self.begun = begun

    @property
    def left(self) -> float:
        """Seconds that the study still has [s]."""
        return self.found.options.time - (time.monotonic() - self.begun)

    def measure(self, wanted: list[tuple[str, Deck, Setting]]) -> list[Point]:
        """Run models with settings side by side, and keep the points that went to their end."""
        grid = self.found.grid
        decks = [with_setting(deck, setting, grid, grid.interval) for _, deck, setting in wanted]
        study = Study("", self.deck.path, (), (), (), measured=self.found.measured)
        entries = self.runs.run_all(study, [tuple(deck.words) for deck in decks]) if self.left > 0.0 else []
        points = []
        for (model, deck, setting), entry in zip(wanted, entries):
            values = dict(zip(self.found.measured.names, entry["values"]))
            points.append(Point(model, setting, deck, values, entry["reason"]))
            if values and not any((p.model, p.setting) == (model, setting) for p in self.found.points):
                self.found.points.append(points[-1])
        return points

    def cost(self, point: Point) -> float:
        """Return what a point is ranked by: its seconds; where they are few, its counts times what such take in longer runs."""
        if not point.values or point.seconds >= EXACT or point.setting.family not in self.rates:
            return point.seconds
        return point.values["evaluations"] * (point.values["unknowns"] + OVERHEAD) * self.rates[point.setting.family]

    def adequate(self) -> list[Point]:
        """Return the points that are accurate enough, the cheapest first."""
        return sorted((p for p in self.found.points if p.error <= self.found.allowed), key=self.cost)

    def curves(self, model: str, deck: Deck, first: dict[str, int]) -> None:
        """Refine the settings of families side by side, from entries of their ladders, until exact enough, or too dear."""
        live = {family: Setting(family, index) for family, index in first.items()}
        for turn in range(LEVELS):
            points = self.measure([(model, deck, setting) for setting in live.values()])
            best = min((self.cost(p) for p in self.adequate()), default=math.inf)
            for point in points:
                if point.values:
                    counts = point.values["evaluations"] * (point.values["unknowns"] + OVERHEAD)
                    self.rates[point.setting.family] = point.seconds / max(counts, 1.0)
                growth = 2.0 if point.setting.key == "step" else 10.0 ** (1.0 / 4.0)
                next_one = point.setting.finer(2)
                enough = turn > 1 and point.error <= BELOW * self.found.allowed
                dear = growth * self.cost(point) > max(DEAR * best, SHORT) if point.values else "stopped after" in point.reason
                if enough or dear or not next_one.exists():
                    del live[point.setting.family]
                else:
                    live[point.setting.family] = next_one
            if not live or not points:
                return

    def coarsest(self, points: list[Point]) -> list[Point]:
        """Return, for each adequate point, the coarsest one of its model and family that is adequate."""
        best, live = {id(p): p for p in points}, {id(p): p for p in points}
        while live:
            wanted = [(key, p, p.setting.finer(-1)) for key, p in live.items() if p.setting.finer(-1).exists()]
            made = self.measure([(p.model, p.deck, setting) for _, p, setting in wanted])
            live = {key: p for (key, _, _), p in zip(wanted, made) if p.error <= self.found.allowed}
            best |= live
        return list(best.values())

    def simplify(self, best: Point) -> None:
        """Take out of the model what the sensors do not need, one thing at a time, the one that saves most first."""
        found, rejected, taken = self.found, set(), []
        for turn in range(1, 100):
            options = [(label, deck) for label, deck in removals(best.deck, self.asked) if label not in rejected]
            tried = self.measure([("; ".join([*taken, label]), deck, best.setting) for label, deck in options])
            labels = [label for label, _ in options]
            fine = [(p, label) for p, label in zip(tried, labels) if p.error <= found.allowed]
            rejected |= {label for p, label in zip(tried, labels) if p.error > found.allowed}
            point, took = min(fine, key=lambda one: self.cost(one[0]), default=(best, ""))
            pays = self.cost(point) < GAIN * self.cost(best)
            found.removed += [(turn, label, p.error, pays and label == took) for p, label in zip(tried, labels)]
            if not pays:
                break
            best, taken = point, [*taken, took]
        if taken:  # a smaller model often allows longer steps
            first = {family: max(best.setting.index - 6 if family == best.setting.family else 0, 0) for family in self.rates}
            self.curves(best.model, best.deck, first)
            self.coarsest(self.adequate()[:1])


def set_truth(found: Tradeoff, deck: Deck) -> None:
    """Set the truth, the deck's own model by the solver's passes, and what errors of it the solver estimates."""
    Progress().show("the truth: runs", 1, 0)
    accurate = with_setting(deck, None, found.grid, found.grid.interval)
    passes = dict(accuracy=CERTAIN * found.options.tolerance, most_seconds=0.4 * found.options.time)
    accurate = accurate.set(accurate.one("transient"), **passes)
    figures = run_into(found.folder / "truth", accurate, found.options.biela)
    found.measured = against(found.folder / "truth", [name.lower() for name in found.options.sensor])
    estimates = {name.partition("[")[0]: error for name, error in figures["transient"].get("estimated_errors", {}).items()}
    if estimates:
        sizes = zip(found.measured.columns, found.measured.scales)
        found.uncertainty = max((estimates[name] or 0.0) / scale for name, scale in sizes)


def verify(found: Tradeoff, search: Search) -> None:
    """Run the best points as recommended.nml would be, in turn with the deck as written, and keep the first that holds."""
    options, grid = found.options, found.grid
    for point in search.adequate()[:4]:
        own = with_setting(point.deck, point.setting, grid, grid.stated or grid.interval)
        decks = {"recommended": own} | ({"written": found.written.deck} if found.written.values else {})
        times: dict[str, list[float]] = {name: [] for name in decks}
        told: dict[str, list[str]] = {}
        while sum(map(sum, times.values())) <= 2.0 and len(times["recommended"]) < REPEATS:
            for name, deck in decks.items():
                figures = run_into(found.folder / name, deck, options.biela)
                times[name].append(figures["timing"]["processor_seconds"])
                told[name] = figures.get("warnings", ())
        if "written" in times:
            found.written.values["seconds"] = float(np.median(times["written"]))
        values = dict(zip(found.measured.names, found.measured.of(found.folder / "recommended").values))
        values["seconds"] = float(np.median(times["recommended"]))
        found.chosen = replace(point, deck=own, values=values)
        if found.chosen.error <= found.allowed:
            found.warnings += [f"the solver warns of the recommended deck: {words}" for words in told["recommended"]]
            break
    if found.written.error <= found.allowed and (found.chosen is None or found.written.seconds <= found.chosen.seconds):
        found.chosen = found.written


def tradeoff(options: TradeoffOptions) -> Tradeoff:
    """Make the study and write its files, without the picture; BielaError where the deck is wrong."""
    if not set(options.methods) <= set(METHODS):
        raise BielaError(f"methods of {', '.join(METHODS)} expected")
    deck = read(options.deck, biela=options.biela)
    folder = options.output or Path("results") / "tradeoff" / options.deck.stem
    asked = deck.needed_sensors(sensors(deck, options.sensor))
    found, begun = Tradeoff(options, folder, grid_of(deck)), time.monotonic()
    model = lean(deck, asked)
    set_truth(found, model)
    how = dict(jobs=options.jobs, scheduler=options.scheduler, longest=options.longest_run)
    how = StudyOptions(options.deck, options.biela, folder, **how)
    with StudyRuns(Study("", deck.path, (), (), (), measured=found.measured), deck, how, folder) as runs:
        search = Search(found, deck, asked, runs, begun)
        figures = run_into(folder / "written", deck, options.biela)
        found.warnings += [f"the solver warns of the deck as written: {words}" for words in figures.get("warnings", ())]
        try:
            values, fault = dict(zip(found.measured.names, found.measured.of(folder / "written").values)), ""
        except ValueError as words:
            values, fault = {}, str(words)
        found.written = Point("", None, deck, values, fault)
        if found.allowed > 0.0:
            families = [name for name, (method, _) in FAMILIES.items() if method in options.methods]
            search.curves("", model, dict.fromkeys(families, 0))
            if search.adequate():
                search.coarsest([p for family in families for p in search.adequate() if p.setting.family == family][:8])
                search.simplify(search.adequate()[0])
        if search.left <= 0.0:
            found.notes.append(f"the search was ended by --time {options.time:g}; the same command with more goes on from there")
        verify(found, search)
    if found.chosen:
        (folder / "recommended.nml").write_text(found.comment() + found.chosen.deck.flat(options.biela), encoding="utf-8")
    (folder / "tradeoff.txt").write_text(found.text, encoding="utf-8")
    return found


def work(args: argparse.Namespace) -> int:
    """Make the study, print and draw; the exit status: 1 where nothing meets the tolerance."""
    from .picture_files import save

    found = tradeoff(options_of(args, TradeoffOptions))
    print("".join(f"- {line}\n" for line in found.warnings), end="")
    print(found.verdict)
    drawn = [save(found.picture(), found.folder / "work_precision").name] if found.points else []
    names = ["tradeoff.txt", *["recommended.nml"] * bool(found.chosen), *drawn]
    print(f"Results: {found.folder}/" + ", ".join(names))
    return 0 if found.meets else 1
