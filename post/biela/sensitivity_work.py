"""By how much results change with parameters at one design: derivatives with errors, a table and a tornado picture."""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import numpy as np

from . import deck_text
from .command import finite
from .derivatives import Derivatives, derivatives
from .design_runs import Design, DesignRuns, RunsOverError
from .design_space import Space
from .result_files import HistoryError, remove_noted
from .sweep_study import Study
from .sweep_work import prepare

SPREAD = 0.01  # of a parameter's value, where the study says none
HEADER = [
    "result",
    "parameter",
    "at",
    "derivative",
    "error",
    "spread",
    "change by the spread",
    "error of the change",
    "percent per percent",
]


def design_of(study: Study, space: Space, args: argparse.Namespace) -> tuple[np.ndarray, tuple]:
    """Return position (unit cube) and choice of the design at which derivatives are taken: of --at, of the study, of the deck.

    Raises:
        HistoryError: --at names no parameter, or no value that it may have.
    """
    asked = {}
    for word in args.at:
        name, equals, value = word.partition("=")
        if not equals or name not in [one.name for one in study.parameters]:
            known = ", ".join(one.name for one in study.parameters)
            raise HistoryError(f"--at {word!r}: NAME=VALUE expected, NAME one of {known}")
        asked[name] = value
    own = {group.name: group.number("value") for group in deck_text.read(study.deck, biela=args.biela).all("parameter")}
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


def rows_of(study: Study, space: Space, base: Design, found: Derivatives) -> list[list]:
    """Return the rows of the table, each result's largest change first."""
    own, rows = len(study.parameters), []
    for j, scalar in enumerate(study.scalars):
        value = base.values[own + j]
        part = []
        for k, one in enumerate(space.free):
            at = base.point[one.name]
            slope, error = found.values[own + j, k], found.errors[own + j, k]
            spread = one.spread or SPREAD * (abs(at) or one.ends[1] - one.ends[0])
            relative = slope * at / value if value != 0.0 else np.nan
            part.append([scalar.name, one.name, at, slope, error, spread, slope * spread, error * spread, relative])
        rows += sorted(part, key=lambda row: -abs(np.nan_to_num(row[6])))
    return rows


def lines_of(study: Study, space: Space, rows: list[list], units: list[str]) -> list[str]:
    """Return the rows as lines of text."""
    wide = max(len(one.name) for one in study.scalars), max(len(one.name) for one in space.free)
    unit_of = {one.name: one.unit for one in space.free} | {one.name: unit for one, unit in zip(study.scalars, units)}
    lines = [f"{'result':{wide[0]}}  {'by':{wide[1]}}  {'derivative':>11}  {'error':>8}  {'% per %':>8}  change by the spread"]
    for name, parameter, _, slope, error, spread, change, _, relative in rows:
        words = f"{name:{wide[0]}}  {parameter:{wide[1]}}  "
        if not np.isfinite(slope):
            lines.append(words + "not known: runs beside the design failed")
            continue
        change_words = f"{change:+.3g} {unit_of[name]}".rstrip() + f" by {spread:.3g} {unit_of[parameter]}".rstrip()
        per = f"{relative:8.3g}" if np.isfinite(relative) else f"{'-':>8}"
        unsure = "" if abs(slope) > error else "  (not more than its error)"
        lines.append(f"{words}{slope:11.4g}  {error:8.1e}  {per}  {change_words}{unsure}")
    return lines


def sensitivity(args: argparse.Namespace) -> int:
    """Take the derivatives, write table and picture; returns 0, or 1 where the design itself fails."""
    study, text = prepare(args, design=False)
    space = Space.of(study)
    if not space.free:
        raise HistoryError(f"{args.study}: no parameter is free: from and to expected")
    folder = args.output or Path("results") / "sensitivity" / study.name
    position, choice = design_of(study, space, args)
    with DesignRuns(study, text, args, folder, "sensitivity") as runs:
        try:
            (base,) = runs.of([space.point(position, choice)])
            (checked,) = runs.of([base.point], check=True)
            if not base.ok or not checked.ok:
                print("the design fails: " + (base.reason or checked.reason))
                return 1
            scales = np.where(base.values != 0.0, np.abs(base.values), 1.0)
            found = derivatives(runs, space, base, position, choice, checked.errors, scales)
        except RunsOverError:
            raise HistoryError(f"{args.study}: runs = {study.runs} are too few: {8 * len(space.free) + 2} expected") from None
    rows = rows_of(study, space, base, found)
    remove_noted(folder)
    try:
        with (folder / "table.csv").open("w", encoding="utf-8", newline="") as file:
            csv.writer(file).writerows([HEADER, *rows])
    except OSError as fault:
        raise HistoryError(f"{folder / 'table.csv'}: cannot be written ({fault.strerror})") from None
    own = len(study.parameters)
    print(f"{runs.count} runs at {_shown(base, 6)}")
    for k, scalar in enumerate(study.scalars):
        error = checked.errors[own + k]
        print(f"  {scalar.name} = {base.values[own + k]:.6g} {runs.units[k]}".rstrip() + f" (error of the run {error:.1e})")
    print("\n".join(lines_of(study, space, rows, runs.units)))
    print(f"table: {folder / 'table.csv'}")
    if not args.no_pictures:
        from . import optimise_picture

        at = _shown(base, 4)
        print(f"picture: {optimise_picture.tornado(study, space, rows, runs.units, at, folder / 'tornado.png')}")
    return 0


def _shown(design: Design, digits: int) -> str:
    """Return the parameters of a design in words."""
    shown = {name: f"{value:.{digits}g}" if isinstance(value, float) else value for name, value in design.point.items()}
    return ", ".join(f"{name} = {value}" for name, value in shown.items())
