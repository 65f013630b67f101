"""By how much results change with parameters at one design: derivatives with errors, a table and a tornado picture."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .command import finite, options_of
from .deck import Deck
from .derivatives import HEADER, derivatives, rows_of
from .design_runs import Design, DesignRuns, RunsOverError, Space
from .figures import Tabular
from .result_files import HistoryError, remove_noted
from .run_warnings import told_once
from .sweep_study import Study, StudyOptions
from .sweep_work import prepare, tell, write_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def design_of(study: Study, deck: Deck, space: Space, options: StudyOptions) -> tuple[np.ndarray, tuple]:
    """Return position (unit cube) and choice of the design of --at, of the study, of the deck; HistoryError."""
    asked = {}
    for word in options.at:
        name, equals, value = word.partition("=")
        if not equals or name not in [one.name for one in study.parameters]:
            known = ", ".join(one.name for one in study.parameters)
            raise HistoryError(f"--at {word!r}: NAME=VALUE expected, NAME one of {known}")
        asked[name] = value
    own = {group.name: group.number("value") for group in deck.all("parameter")}
    position = space.start()
    for k, one in enumerate(space.free):
        low, high = one.ends
        if one.name in asked:
            try:
                value = finite(asked[one.name])
            except argparse.ArgumentTypeError as fault:
                raise HistoryError(f"--at {one.name}: {fault}") from None
            if not low <= value <= high:
                raise HistoryError(f"--at {one.name}={value:g}: a value from {low:g} to {high:g} expected")
            position[k] = space.unit(k, value)
        elif one.start is None and not one.targets and low <= own[one.name.lower()] <= high:
            position[k] = space.unit(k, own[one.name.lower()])
    choice = []
    for one in space.lists:
        words = {str(value): value for value in one.values}
        if asked.get(one.name, str(one.values[0])) not in words:
            raise HistoryError(f"--at {one.name}={asked[one.name]}: one of {', '.join(words)} expected")
        choice.append(words[asked.get(one.name, str(one.values[0]))])
    return position, tuple(choice)


@dataclass(frozen=True)
class Sensitivity(Tabular):
    """Derivatives of a study's results at one design."""

    head = HEADER

    study: Study  # of the results
    space: Space  # of its designs
    base: Design  # the design
    errors: np.ndarray  # of its values, as its run measures them
    rows: list[list]  # of the table, whose head is derivatives.HEADER: each result's largest change first
    units: list[str]  # of the results
    runs: int  # that were asked for
    folder: Path  # of table.csv and of what was stored
    warnings: list[str]  # on what was stored, and what the solver warned of, once each

    @property
    def report(self) -> list[str]:
        """The design, its results, and the table in lines."""
        own, lines = len(self.study.parameters), [f"{self.runs} runs at {_shown(self.base, 6)}"]
        for k, scalar in enumerate(self.study.scalars):
            value, error = self.base.values[own + k], self.errors[own + k]
            lines.append(f"  {scalar.name} = {value:.6g} {self.units[k]}".rstrip() + f" (error of the run {error:.1e})")
        wide = max(len(one.name) for one in self.study.scalars), max(len(one.name) for one in self.space.free)
        unit_of = {one.name: one.unit for one in self.space.free} | dict(zip((one.name for one in self.study.scalars), self.units))
        lines.append(
            f"{'result':{wide[0]}}  {'by':{wide[1]}}  {'derivative':>11}  {'error':>8}  {'% per %':>8}  change by the spread"
        )
        for name, parameter, _, slope, error, spread, change, _, relative in self.rows:
            by = f"{change:+.3g} {unit_of[name]}".rstrip() + f" by {spread:.3g} {unit_of[parameter]}".rstrip()
            unsure = "" if abs(slope) > error else "  (not more than its error)"
            told = f"{slope:11.4g}  {error:8.1e}  {relative:8.3g}  {by}{unsure}"
            told = told if np.isfinite(slope) else "not known: runs beside the design failed"
            lines.append(f"{name:{wide[0]}}  {parameter:{wide[1]}}  {told}")
        return lines

    def picture(self) -> Figure:
        """Draw the changes by the spread of each parameter (a tornado)."""
        from .sweep_picture import tornado

        return tornado(self.study, self.space, self.rows, self.units, _shown(self.base, 4))


def sensitivity(options: StudyOptions) -> Sensitivity:
    """Take the derivatives and write their table; BielaError where the study cannot be run or the design itself fails."""
    study, deck = prepare(options, design=False)
    space = Space.of(study)
    if not space.free:
        raise HistoryError(f"{options.study}: no parameter is free: from and to expected")
    folder = options.folder("sensitivity")
    position, choice = design_of(study, deck, space, options)
    with DesignRuns(study, deck, options, folder) as runs:
        try:
            (base,) = runs.of([space.point(position, choice)])
            (checked,) = runs.of([base.point], check=True)
            if not base.ok or not checked.ok:
                raise HistoryError("the design fails: " + (base.reason or checked.reason))
            scales = np.where(base.values != 0.0, np.abs(base.values), 1.0)
            found = derivatives(runs, space, base, position, choice, checked.errors, scales)
        except RunsOverError:
            raise HistoryError(f"{options.study}: runs = {study.runs} are too few: {8 * len(space.free) + 2} expected") from None
    rows = rows_of(study, space, base, found)
    warnings = runs.journal.warnings + told_once((one.point, one.warnings) for one in runs.made)
    remove_noted(folder)
    write_table(folder / "table.csv", HEADER, rows)
    return Sensitivity(study, space, base, checked.errors, rows, runs.units, runs.count, folder, warnings)


def work(args: argparse.Namespace) -> int:
    """Print and draw the sensitivities; returns 0."""
    found = sensitivity(options_of(args, StudyOptions))
    lines = [*found.report, f"table: {found.folder / 'table.csv'}"]
    tell("sensitivity", found.warnings, lines, [] if args.no_pictures else found.draw("tornado.png"))
    return 0


def _shown(design: Design, digits: int) -> str:
    """Return the parameters of a design in words."""
    shown = {name: f"{value:.{digits}g}" if isinstance(value, float) else value for name, value in design.point.items()}
    return ", ".join(f"{name} = {value}" for name, value in shown.items())
