"""Speed against accuracy of a deck: the cheapest method, step and model that are accurate enough."""

from __future__ import annotations

import argparse
import html
import math
import shutil
import time
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from .command import call_solver, options_of
from .deck import Deck, read
from .figures import Tabular
from .histories import read_summary
from .progress import Progress
from .result_files import BielaError
from .study_runs import StudyRuns
from .sweep_study import Study, StudyOptions
from .tradeoff_errors import Errors, against
from .tradeoff_models import removals
from .tradeoff_settings import (
    FAMILIES,
    METHODS,
    Grid,
    Setting,
    TradeoffOptions,
    grid_of,
    lean,
    own_setting,
    sensors,
    with_accuracy,
    with_setting,
)

FULL = "full model"
CERTAIN = 0.05  # the truth is asked for with this share of the tolerance
BELOW = 0.1  # curves go on until their error is below this share of what is allowed
LEVELS, DEAR, SHORT = 12, 4.0, 1.0  # of a curve at most; it ends where the next run costs so many times the best one, and [s] more
OVERHEAD = 40  # fixed cost of an evaluation, in unknowns: small models are not cheaper than that
EXACT = 2.0  # [s] shorter runs are ranked by counts of evaluations: their measured times vary too much
MOST = 4  # of the removals that are fine, the cheapest, whose coarsest settings are sought
GAIN = 0.97  # a removal pays where it lowers the cost below this share
REPEATS = 5  # of the runs that are timed, in turn


@dataclass(frozen=True)
class Point:
    """A model with a setting: its deck, how far it is off, what it costs."""

    model: str  # what is taken out, '' for the model in full
    setting: Setting | None  # None: that of the deck itself
    deck: Deck  # that was run
    values: dict[str, float] = field(default_factory=dict)  # by the names of `Errors.names`, empty where it failed
    reason: str = ""  # why it failed

    @property
    def errors(self) -> dict[str, float]:
        """Largest error of each column over its range, and that of the events."""
        return dict(list(self.values.items())[: list(self.values).index("rms")]) if self.values else {}

    @property
    def error(self) -> float:
        """The largest of them; infinite where the run failed."""
        return max(self.errors.values(), default=math.inf)

    @property
    def column(self) -> str:
        """Which column that is."""
        return max(self.errors, key=self.errors.get, default="")

    @property
    def seconds(self) -> float:
        """Of the processor, analyses alone [s]."""
        return self.values.get("seconds", math.inf)

    @property
    def work(self) -> float:
        """Evaluations times unknowns: a cost that no machine changes."""
        return self.values.get("evaluations", math.inf) * self.values.get("unknowns", math.inf)


@dataclass
class Tradeoff(Tabular):
    """What a study of speed against accuracy has found."""

    head = ("model", "setting", "error", "error_rms", "worst_column", "seconds_[s]", "evaluations")

    options: TradeoffOptions  # what was asked
    folder: Path  # of tradeoff.txt, recommended.nml and what was stored
    grid: Grid  # times of the comparison
    measured: Errors | None = None  # the truth, and what of it is compared
    uncertainty: float = math.inf  # largest error that the truth itself may have, over the ranges [-]
    points: list[Point] = field(default_factory=list)  # everything that was run
    # removals that were tried: round, label, error, whether it was taken
    removed: list[tuple[int, str, float, bool]] = field(default_factory=list)
    written: Point | None = None  # the deck as written
    chosen: Point | None = None  # what is recommended, as a run of recommended.nml shows it; None where nothing can be
    notes: list[str] = field(default_factory=list)  # on the truth and the search
    # of the solver on the deck as written, and what a user should know before he trusts the recommendation
    warnings: list[str] = field(default_factory=list)

    @property
    def allowed(self) -> float:
        """The tolerance less the uncertainty of the truth; negative where no error can be shown to be small enough."""
        return self.options.tolerance - self.uncertainty if self.uncertainty < self.options.tolerance else -1.0

    @property
    def meets(self) -> bool:
        """Whether the recommended deck is accurate enough."""
        return self.chosen is not None and self.chosen.error <= self.allowed

    @property
    def recommended(self) -> Path | None:
        """The deck that is recommended, None where there is none."""
        return self.folder / "recommended.nml" if self.chosen else None

    @property
    def verdict(self) -> str:
        """A paragraph: what is recommended, or why nothing is."""
        from .tradeoff_words import verdict

        return verdict(self)

    @property
    def text(self) -> str:
        """That of tradeoff.txt."""
        from .tradeoff_words import table

        return table(self)

    def setting(self, point: Point) -> str:
        """Return a point's setting in words."""
        return point.setting.words(self.grid) if point.setting else own_setting(point.deck)

    @property
    def rows(self) -> list[list]:
        """All runs of the search: model, setting, errors over a column's range, seconds, evaluations."""
        return [[p.model or FULL, self.setting(p), p.error, p.values["rms"], p.column, p.seconds, int(p.values["evaluations"])]
                for p in self.points]  # fmt: skip

    def picture(self):
        """Draw error against seconds, one curve a method and model."""
        from .tradeoff_words import picture

        return picture(self)

    def _repr_html_(self) -> str:
        return f"<p>{html.escape(self.verdict)}</p>" + "".join(f"<p>{html.escape(words)}</p>" for words in self.warnings)


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
        highest = 0.5 / found.grid.interval
        for turn in range(1, 100):
            options = [c for c in removals(best.deck, self.asked, highest, found.options.tolerance) if c.label not in rejected]
            names = ["; ".join([*taken, change.label]) for change in options]
            tried = self.measure([(name, change.deck, best.setting) for name, change in zip(names, options)])
            failed = [k for k, p in enumerate(tried) if not p.values]  # an explicit step may be too long for the smaller model
            again = self.measure([(names[k], options[k].deck, best.setting.finer(2)) for k in failed])
            tried = [again[failed.index(k)] if k in failed and again else p for k, p in enumerate(tried)]
            fit = sorted(((p, c) for p, c in zip(tried, options) if p.error <= found.allowed), key=lambda one: self.cost(one[0]))[
                :MOST
            ]
            rejected |= {change.label for p, change in zip(tried, options) if p.error > found.allowed}
            cheapest = dict(zip([change.label for _, change in fit], self.coarsest([p for p, _ in fit])))
            label = min(cheapest, key=lambda one: self.cost(cheapest[one]), default="")
            pays = bool(label) and self.cost(cheapest[label]) < GAIN * self.cost(best)
            found.removed += [(turn, c.label, p.error, pays and c.label == label) for p, c in zip(tried, options)]
            if not pays:
                break
            best = cheapest[label]
            taken.append(label)
            best = replace(best, model="; ".join(taken))
        if taken:
            first = {family: max(best.setting.index - 6 if family == best.setting.family else 0, 0) for family in self.rates}
            self.curves(best.model, best.deck, first)
            self.coarsest(self.adequate()[:1])


def run_into(folder: Path, deck: Deck, biela: Path) -> dict:
    """Run a deck into a folder and return the figures of its summary; BielaError with the words of the solver where it fails."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    done = call_solver(biela, "--quiet", "--output", folder, *(word for one in deck.words for word in ("--set", one)), deck.path)
    if done.returncode:
        lines = [line for line in done.stderr.splitlines() if ": warning: " not in line]
        raise BielaError((lines or [f"the solver ended with status {done.returncode}"])[0])
    return read_summary(folder)


def set_truth(found: Tradeoff, deck: Deck) -> None:
    """Set the truth, the deck's own model by the solver's passes, and what errors of it the solver estimates."""
    Progress().show("the truth: runs", 1, 0)
    accurate = with_accuracy(deck, CERTAIN * found.options.tolerance, found.grid, 0.4 * found.options.time)
    figures = run_into(found.folder / "truth", accurate, found.options.biela)
    found.measured = against(found.folder / "truth", [name.lower() for name in found.options.sensor])
    estimates = {name.partition("[")[0]: error for name, error in figures["transient"].get("estimated_errors", {}).items()}
    if estimates:
        sizes = zip(found.measured.columns, found.measured.scales)
        found.uncertainty = max((estimates[name] or 0.0) / scale for name, scale in sizes)


def verify(found: Tradeoff, search: Search) -> None:
    """Run the best points as recommended.nml would be, in turn with the deck as written, and keep the first that holds."""
    options, grid = found.options, found.grid
    finalists = search.adequate()[:4]
    cheap = [p for p in finalists if search.cost(p) <= options.budget]
    if not cheap and math.isfinite(options.budget):
        cheap = sorted((p for p in found.points if p.seconds <= options.budget), key=lambda p: p.error)[:1]
    for point in cheap:
        own = with_setting(point.deck, point.setting, grid, grid.stated or grid.interval)
        both = [(found.written, found.written.deck if found.written.values else None), (point, own)]
        times: list[list[float]] = [[], []]
        for _ in range(REPEATS):
            for k, (_, deck) in enumerate(both):
                if deck is not None:
                    figures = run_into(found.folder / ("written", "recommended")[k], deck, options.biela)
                    times[k].append(figures["timing"]["processor_seconds"])
            if sum(map(sum, times)) > 2.0:
                break
        if times[0]:
            found.written.values["seconds"] = float(np.median(times[0]))
        values = dict(zip(found.measured.names, found.measured.of(found.folder / "recommended").values))
        values["seconds"] = float(np.median(times[1]))
        found.chosen = replace(point, deck=own, values=values)
        if found.chosen.error <= found.allowed:
            break
    written = found.written
    dearest = min(found.chosen.seconds if found.chosen else math.inf, options.budget)
    if written.error <= found.allowed and written.seconds <= dearest:
        found.chosen = written


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
        found.written = as_written(found, deck)
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
        from .tradeoff_words import head

        (folder / "recommended.nml").write_text(head(found) + found.chosen.deck.flat(options.biela), encoding="utf-8")
    (folder / "tradeoff.txt").write_text(found.text, encoding="utf-8")
    return found


def as_written(found: Tradeoff, deck: Deck) -> Point:
    """Return the deck as it is; BielaError where it does not run."""
    figures = run_into(found.folder / "written", deck, found.options.biela)
    found.warnings += [f"the solver warns of the deck as written: {words}" for words in figures.get("warnings", ())]
    try:
        return Point("", None, deck, dict(zip(found.measured.names, found.measured.of(found.folder / "written").values)))
    except ValueError as fault:
        return Point("", None, deck, {}, str(fault))


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
