"""Compares two histories, or a history with a reference, by the rule that `post/compare.py --help` states."""

from __future__ import annotations

import argparse
import fnmatch
from dataclasses import dataclass

import numpy as np

from .histories import History, read
from .result_files import HistoryError

CONSTANT = 1.0e-13


@dataclass(frozen=True)
class Difference:
    """The largest difference of one column."""

    name: str  # the column
    unit: str  # its unit, '' where neither file states one
    largest: float  # largest absolute difference, in the column's unit
    scale: float  # what it is measured by, in the column's unit
    error: float  # largest / scale
    time: float  # where it stands [s]
    tolerance: float  # what the error may be

    @property
    def passed(self) -> bool:
        """Whether the error is within the tolerance."""
        return self.error <= self.tolerance


def matching_rows(run: History, reference: History) -> np.ndarray:
    """Return, for each row of the reference, the run's row at the same time; HistoryError where a time is not among the run's."""
    wanted, have = reference.time, run.time
    interval = np.diff(wanted).min() if wanted.size > 1 else max(abs(wanted[0]), 1.0)
    nearest = np.rint(np.interp(wanted, have, np.arange(have.size))).astype(int)
    off = np.abs(have[nearest] - wanted) > 1.0e-6 * interval
    if off.any():
        row = int(np.argmax(off))
        words = f"{run.path}: no row at t = {wanted[row]:.9g} s, which {reference.path} has"
        raise HistoryError(f"{words}; the nearest is t = {have[nearest[row]]:.9g} s")
    return nearest


def common_rows(one: History, other: History) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows of two histories at the times that both have."""
    interval = min(np.diff(table.time).min() if table.time.size > 1 else 1.0 for table in (one, other))
    nearest = np.rint(np.interp(one.time, other.time, np.arange(other.time.size))).astype(int)
    own = np.flatnonzero(np.abs(other.time[nearest] - one.time) <= 1.0e-6 * interval)
    return own, nearest[own]


def scales(reference: History, units: dict[str, str]) -> dict[str, float]:
    """Return what each column's difference is measured by, in its unit (the rule above)."""
    ranges = {name: float(np.ptp(reference[name])) for name in reference.names[1:]}
    result = {}
    for name, own in ranges.items():
        family = max((r for other, r in ranges.items() if units[other] and units[other] == units[name]), default=own)
        size = float(np.abs(reference[name]).max())
        result[name] = own if own > CONSTANT * max(family, size) else family or size or 1.0
    return result


def differences(
    run: History, reference: History, tolerance: float = 0.0, columns: list[str] | None = None, tolerances: dict | None = None
) -> list[Difference]:
    """Return the difference of each column of the reference that patterns choose (all); HistoryError: no such times or columns."""
    names = reference.match(columns)
    missing = [name for name in names if name not in run]
    if missing:
        raise HistoryError(f"{run.path}: lacks the column {missing[0]!r} of {reference.path}")
    units = {name: reference.units[name] or run.units.get(name, "") for name in reference.names}
    clash = [n for n in names if reference.units[n] and run.units[n] and reference.units[n] != run.units[n]]
    if clash:
        name = clash[0]
        raise HistoryError(f"{run.path}: {run.label(name)} is in another unit in {reference.path}: {reference.label(name)}")
    for pattern in tolerances or {}:
        reference.match([pattern])
    rows = matching_rows(run, reference)
    scale = scales(reference, units)
    result = []
    for name in (n for n in names if n != reference.names[0]):
        gap = np.abs(run[name][rows] - reference[name])
        worst = int(np.argmax(gap))
        allowed = [value for pattern, value in (tolerances or {}).items() if fnmatch.fnmatchcase(name, pattern)]
        largest, time = float(gap[worst]), float(reference.time[worst])
        error = largest / scale[name]
        result.append(Difference(name, units[name], largest, scale[name], error, time, [tolerance, *allowed][-1]))
    return result


def table(found: list[Difference]) -> str:
    """Return one line a column: what differs, by how much, where, and whether that passes."""
    width = max([6, *(len(d.name) for d in found)])
    lines = [f"{'column':{width}}  {'error':>9}  {'tolerance':>9}  {'difference':>10}  {'range':>9}  {'unit':8}  at t [s]"]
    for d in found:
        mark = "" if d.passed else "  TOO LARGE"
        figures = f"{d.error:9.2e}  {d.tolerance:9.2e}  {d.largest:10.2e}  {d.scale:9.2e}"
        lines.append(f"{d.name:{width}}  {figures}  {d.unit:8}  {d.time:.6g}{mark}")
    return "\n".join(lines)


def compare(args: argparse.Namespace) -> int:
    """Compare as the command line asks and return the exit status; raises HistoryError."""
    run, reference = read(args.run, args.file), read(args.reference, args.file)
    found = differences(run, reference, args.tolerance, args.columns, dict(args.column))
    print(table(found))
    failed, more = sum(not d.passed for d in found), run.time.size - reference.time.size
    rest = f" ({more} further rows of the run not compared)" if more else ""
    verdict = f"{failed} too far apart" if failed else "all within tolerance"
    print(f"{len(found)} columns, {reference.time.size} rows{rest}: {verdict}")
    return int(failed > 0)
