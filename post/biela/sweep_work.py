"""Runs a deck over ranges of its parameters and gathers numbers of every run into one table."""

from __future__ import annotations

import argparse
import csv
import html
import math
import operator
import re
import sys
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from . import command, fatigue, histories
from .deck import Deck, run_into
from .deck import read as read_deck
from .result_files import BielaError, HistoryError, remove_noted, writing
from .run_warnings import told_once
from .study_runs import StudyRuns
from .sweep_scalars import Scalar, vibrations
from .sweep_study import Study, StudyError, StudyOptions, read

if TYPE_CHECKING:
    import pandas

COMPARISONS = {"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge}
SURE = 0.95  # chance that an interval holds the true value
SHOWN = 12  # rows of a table that is printed
CONDITION = re.compile(r"\s*(\w+)\s*(<=|>=|<|>)\s*(\S+)\s*")


def table(study: Study, entries: list[dict]) -> tuple[list[str], list[list]]:
    """Return the header and the rows of the table, in the order of the design."""
    units = next((entry["units"] for entry in entries if entry["units"]), [""] * len(study.scalars))
    header = [parameter.label for parameter in study.parameters]
    header += [scalar.name + (f"[{unit}]" if unit else "") for scalar, unit in zip(study.scalars, units)]
    header += ["warnings", "failure"]
    rows = []
    for point, entry in zip(study.points, entries):
        rows.append([*point.values(), *(entry["values"] or [""] * len(study.scalars)), len(entry["warnings"]), entry["reason"]])
    return header, rows


def write_table(path: Path, header: list[str], rows: list[list]) -> None:
    """Write the table; HistoryError where it cannot be written."""
    with writing(path), path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([header, *(["" if value != value else value for value in row] for row in rows)])


def parse_goal(study: Study, goal: str, conditions: list[str]) -> tuple[int, int, list[tuple[int, str, float]]]:
    """Return sign (1: the smallest is best) and column of a goal, and column, comparison and value of conditions; HistoryError."""
    names = [one.name for one in study.columns]
    words = goal.split()
    if len(words) != 2 or words[0] not in ("min", "max") or words[1] not in names:
        raise HistoryError(f"--best {goal!r}: 'min NAME' or 'max NAME' expected, NAME one of {', '.join(names)}")
    tests = []
    for condition in conditions:
        found = CONDITION.fullmatch(condition)
        try:
            tests.append((names.index(found[1]), found[2], float(found[3])))
        except (TypeError, ValueError):
            raise HistoryError(f"--where {condition!r}: 'NAME < VALUE' expected, NAME one of {', '.join(names)}") from None
    return (1 if words[0] == "min" else -1), names.index(words[1]), tests


def choose(study: Study, rows: list[list], goal: str, conditions: list[str]) -> tuple[list | None, int, list[tuple[int, float]]]:
    """Return the best run that meets all conditions, how many do, and column and limit of each; HistoryError."""
    sign, column, tests = parse_goal(study, goal, conditions)
    good = [row for row in rows if not row[-1]]
    for condition, (k, test, value) in zip(conditions, tests):
        if any(isinstance(row[k], str) for row in good):
            raise HistoryError(f"--where {condition!r}: the values of {study.columns[k].name} are words")
        good = [row for row in good if COMPARISONS[test](row[k], value)]
    good = [row for row in good if row[column] == row[column]]
    chosen = min(good, key=lambda row: sign * row[column]) if good else None
    return chosen, len(good), [(k, value) for k, _, value in tests]


def best(study: Study, rows: list[list], goal: str, conditions: list[str]) -> str:
    """Return a line that names the best run that meets all conditions; HistoryError where the words are wrong."""
    chosen, count, _ = choose(study, rows, goal, conditions)
    pairs = zip(study.columns, chosen or ())
    words = ", ".join(f"{one.name} = {x:.6g}" if isinstance(x, float) else f"{one.name} = {x}" for one, x in pairs)
    return f"best of {count} runs ({', '.join([goal, *conditions])}): {words}" if chosen else "best: no run meets the conditions"


def prepare(options: StudyOptions, design: bool = True) -> tuple[Study, Deck]:
    """Return a study, its design's points where wanted, and its deck; BielaError: these or the options are wrong."""
    if not options.biela.is_file():
        raise HistoryError(f"{options.biela}: no such program: build it with make, or name it with --biela")
    study = read(options.study, design)
    starts = [one.start if math.isfinite(one.start) else options.start for one in study.scalars]
    ends = [one.end if math.isfinite(one.end) else options.end for one in study.scalars]
    scalars = tuple(replace(one, start=start, end=end) for one, start, end in zip(study.scalars, starts, ends))
    study = replace(study, scalars=scalars)
    deck = read_deck(study.deck, biela=options.biela)
    known = [group.name for group in deck.all("parameter")]
    for parameter in study.parameters:
        for name in parameter.settings(parameter.values[0]):
            if name.lower() not in known:
                raise StudyError(f"parameter {name}: the deck has no &parameter of that name ({', '.join(known) or 'none'})")
        for target in parameter.targets:
            deck.check(target)
    stresses = [group.name for group in deck.all("sensor") if group.word("quantity") in fatigue.OF_STRESS]
    for one in study.scalars:
        of_size = fatigue.signed_columns(one.column) and one.column.rpartition(".")[0].lower() in stresses
        if of_size and one.measure in fatigue.NEEDS_SIGN:
            raise StudyError(f"result {one.name}: {fatigue.size_words(one.column, one.measure)}")
    if any(one.mode for one in study.scalars):
        study = replace(study, scalars=_with_shapes(study.scalars, deck, options.biela))
    return study, deck


def _with_shapes(scalars: tuple[Scalar, ...], deck: Deck, biela: Path) -> tuple[Scalar, ...]:
    """Return results with the shapes of their vibrations in the study's deck, which its runs follow; StudyError without modes."""
    words = "measure = 'frequency' or 'damping_ratio': the deck has no modes to follow: "
    if not deck.all("modal"):
        raise StudyError(words + "it has no &modal")
    with tempfile.TemporaryDirectory(prefix="biela-") as name:
        try:
            run_into(Path(name) / "run", deck.drop(*deck.all("transient", "frequency_response")), biela)
            _, shapes = vibrations(histories.read(Path(name) / "run", "modes"))
        except BielaError as fault:
            raise StudyError(f"{words}{fault}") from None
    most = max(one.mode for one in scalars)
    if most > len(shapes):
        raise StudyError(f"mode = {most}: the deck has {len(shapes)} vibrations")
    parts = [tuple(float(x) for value in shape for x in (value.real, value.imag)) for shape in shapes]
    return tuple(replace(one, shape=parts[one.mode - 1]) if one.mode else one for one in scalars)


def tell(tool: str, warnings: list[str], lines: Iterable[str], pictures: Iterable[Path] = ()) -> None:
    """Print the warnings of a program, what it has found, and the paths of pictures, which are drawn now."""
    for words in warnings:
        print(f"{tool}: warning: {words}", file=sys.stderr)
    for line in lines:
        print(line)
    for path in pictures:
        print(f"picture: {path}")


@dataclass(frozen=True)
class Quantile:
    """A quantile of a result, in its unit: level, value, and the ends between which the true one lies with a chance of 95 %."""

    name: str
    level: float
    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Share:
    """The share of designs that meet a condition, and the ends between which the true one lies with a chance of 95 %."""

    condition: str
    value: float
    low: float
    high: float

    def __str__(self) -> str:
        parts = f"{100.0 * self.value:.3g} % ({100.0 * self.low:.3g} to {100.0 * self.high:.3g})"
        return f"{self.condition}: {parts} of the designs"


def quantiles_of(name: str, values: np.ndarray, levels: tuple[float, ...]) -> list[Quantile]:
    """Return quantiles of independent draws with intervals by order statistics, infinite ends where the draws are too few."""
    from scipy.stats import quantile_test

    found = []
    for level in levels if len(values) else ():
        low, high = quantile_test(values, p=level).confidence_interval(SURE)
        ends = -math.inf if np.isnan(low) else float(low), math.inf if np.isnan(high) else float(high)
        found.append(Quantile(name, level, float(np.quantile(values, level)), *ends))
    return found


def share_of(condition: str, good: int, count: int) -> Share:
    """Return a share with its interval (Clopper & Pearson, Biometrika 26, 1934)."""
    from scipy.stats import binomtest

    return Share(condition, good / count, *map(float, binomtest(good, count).proportion_ci(SURE)))


@dataclass(frozen=True)
class Sweep:
    """The table of a sweep."""

    study: Study  # that was run
    folder: Path  # of table.csv and of what was stored
    header: list[str]  # names of parameters and results with their units, `warnings` (their number) and `failure`
    rows: list[list]  # one a run, in the order of the design; '' for the results of a run that failed
    warnings: list[str] = field(default_factory=list)  # on what was stored, and what the solver warned of, once each
    told: list[list[str]] = field(default_factory=list)  # what the solver warned of in each run
    outside: list[bool] = field(default_factory=list)  # whether the model does not hold for its motion
    allow_warnings: bool = False  # whether such a run may be the best one

    @property
    def quantiles(self) -> list[Quantile]:
        """Those of the results, where the design is random; of the runs that did not fail."""
        own, good = len(self.study.parameters), [row for row in self.rows if not row[-1]]
        columns = [(one, np.array([row[own + k] for row in good])) for k, one in enumerate(self.study.scalars)]
        levels = self.study.quantiles
        return [one for scalar, values in columns for one in quantiles_of(scalar.name, values[np.isfinite(values)], levels)]

    def shares(self, where: tuple[str, ...] = ()) -> list[Share]:
        """Return which share of random designs meets each condition, those of the study first; a run that failed meets none."""
        conditions = [*self.study.where, *where] if self.study.quantiles else []
        good = [choose(self.study, self.rows, f"min {self.study.scalars[0].name}", [one])[1] for one in conditions]
        return [share_of(one, count, len(self.rows)) for one, count in zip(conditions, good)]

    @property
    def failed(self) -> list[list]:
        """The runs that failed, their reasons last."""
        return [row for row in self.rows if row[-1]]

    def to_dataframe(self) -> pandas.DataFrame:
        """Return the table; NaN for the results of a run that failed."""
        import pandas

        own = len(self.study.parameters)
        rows = [[*row[:own], *(math.nan if value == "" else value for value in row[own:-1]), row[-1]] for row in self.rows]
        return pandas.DataFrame(rows, columns=self.header)

    @property
    def within(self) -> list[list]:
        """The runs from which the best one is chosen: those whose motion the model holds for, or all where warnings are allowed."""
        return [row for row, off in zip(self.rows, self.outside) if self.allow_warnings or not off]

    def best(self, goal: str = "", where: tuple[str, ...] = ()) -> dict | None:
        """Return the best run by name, 'min NAME' or 'max NAME' (that of the study), or None; HistoryError: wrong words.

        `warnings` are the solver's of this run. Runs for whose motion the model does not hold are left out (`allow_warnings`).
        """
        chosen, _, _ = choose(self.study, self.within, goal or self.study.best, [*self.study.where, *where])
        if chosen is None:
            return None
        return dict(zip((one.name for one in self.study.columns), chosen)) | {"warnings": self.warnings_of(chosen)}

    def warnings_of(self, row: list) -> list[str]:
        """Return what the solver warned of in a run."""
        return self.told[next(k for k, one in enumerate(self.rows) if one is row)]

    def _repr_html_(self) -> str:
        head = html.escape(f"{self.study.name}: {len(self.rows)} runs, {len(self.failed)} failed")
        return f"<p><b>{head}</b></p>" + self.to_dataframe().to_html(max_rows=20)


def sweep(options: StudyOptions) -> Sweep:
    """Run a study, or what is not stored of it, and write its table; BielaError where it cannot be run."""
    study, deck = prepare(options)
    choose(study, [], options.best or study.best or f"min {study.scalars[0].name}", [*study.where, *options.where])  # wrong words
    folder = options.folder("sweep")
    with StudyRuns(study, deck, options, folder) as runs:
        entries = runs.entries(study)
    remove_noted(folder)
    told = [list(entry["warnings"]) for entry in entries]
    words = runs.journal.warnings + told_once(zip(study.points, told))
    outside = [entry["outside"] for entry in entries]
    result = Sweep(study, folder, *table(study, entries), words, told, outside, options.allow_warnings)
    write_table(folder / "table.csv", result.header, result.rows)
    if study.quantiles:
        head = ["result", "quantile", "value", "from", "to"]
        write_table(folder / "quantiles.csv", head, [list(vars(one).values()) for one in result.quantiles])
    return result


def lines_of(result: Sweep, where: tuple[str, ...]) -> list[str]:
    """Return the quantiles of a random design and the shares that meet conditions, in words."""
    units = [word.partition("[")[2].rstrip("]") for word in result.header[len(result.study.parameters) : -1]]
    unit_of = dict(zip((one.name for one in result.study.scalars), units))
    lines = ["quantiles, with their 95 % intervals:"] if result.quantiles else []
    for one in result.quantiles:
        ends = f"({one.low:.4g} to {one.high:.4g})".replace("inf", "?")
        lines.append(f"  {one.name}, {100.0 * one.level:g} %: {one.value:.5g} {ends} {unit_of[one.name]}".rstrip())
    return lines + [f"  {share}" for share in result.shares(where)]


def work(args: argparse.Namespace) -> int:
    """Run the study, print and draw; returns 0, or 1 where every run failed."""
    options = command.options_of(args, StudyOptions)
    result = sweep(options)
    study, rows = result.study, result.rows
    goal, conditions = options.best or study.best, [*study.where, *options.where]
    lines = [f"{len(rows)} runs, {len(result.failed)} failed; table in {result.folder / 'table.csv'}"]
    if len(rows) <= SHOWN:
        shown = [result.header[:-1], *([f"{x:.5g}" if isinstance(x, float) else str(x) for x in row[:-1]] for row in rows)]
        wide = [max(map(len, column)) for column in zip(*shown)]
        lines += ["  " + "  ".join(word.rjust(width) for word, width in zip(row, wide)).rstrip() for row in shown]
    for row in result.failed[:3]:
        lines.append(f"  failed: {', '.join(f'{p.name} = {v}' for p, v in zip(study.parameters, row))}: {row[-1]}")
    tell("sweep", result.warnings, [*lines, *lines_of(result, options.where)])
    chosen, _, limits = choose(study, result.within, goal or f"min {study.scalars[0].name}", conditions)
    if not args.no_pictures and len(result.failed) < len(rows):
        from . import sweep_picture

        paths = sweep_picture.draw(study, result.header, rows, result.folder, chosen if goal else None, limits)
        if study.quantiles:
            paths.append(sweep_picture.draw_distributions(study, result.header, rows, result.quantiles, limits, result.folder))
        for path in paths:
            print(f"picture: {path}")
    if goal:
        print(best(study, result.within, goal, conditions))
        for words in result.warnings_of(chosen) if chosen else ():
            print(f"  warning: {words}")
        if left := len(rows) - len(result.within):
            print(f"  {left} of {len(rows)} runs are left out: the model does not hold for their motion (--allow-warnings)")
    return int(len(result.failed) == len(rows))
