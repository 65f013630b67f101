"""Parameters of a deck from what was measured: least squares on the runs of a study, intervals, and what the data do not tell."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .command import options_of
from .deck import flat_text
from .design_runs import Design, DesignRuns, RunsOverError, Space
from .figures import Tabular
from .result_files import HistoryError, remove_noted
from .sweep_run import settings_of
from .sweep_study import Study, StudyOptions
from .sweep_work import prepare, tell, write_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STEP = 1.0e-3  # of the differences on both sides, in parts of the ranges
INSIDE = 1.0e-3  # distance of a start from the ends of the ranges
SURE = 0.95  # chance that an interval holds the true value
TIED = 0.9  # size of a correlation from which it is told
HEADER = ("parameter", "unit", "value", "from", "to")


@dataclass(frozen=True)
class Identified(Tabular):
    """Parameters that explain what was measured: its errors count as independent and normal, the model as right and linear."""

    study: Study  # of the parameters, and of the results with what was measured
    space: Space  # of its designs
    best: Design  # the design with the least squares
    position: np.ndarray  # of it, in parts of the ranges
    directions: np.ndarray  # orthonormal, in parts of the ranges, what the data tell best first, shape (parameters, parameters)
    singular: np.ndarray  # singular values of the differences' slopes along these, over the error of what was measured
    factor: float  # of a standard error, which gives half the interval
    degrees: int  # measured values less parameters
    misfit: float  # root of the sum of squares over `degrees`; over the stated errors where these are known
    stated: bool  # whether they are
    units: list[str]  # of the results
    folder: Path  # of what was stored and of the tables
    notes: list[str]  # what a user should know

    @property
    def covariance(self) -> np.ndarray:
        """Of the parameters, in parts of their ranges; infinite along what the data do not tell at all."""
        least = np.finfo(float).eps * self.singular.max(initial=0.0)
        scaled = self.directions / np.where(self.singular > least, self.singular, np.nan)[:, None]
        blind = (np.isnan(scaled) & (np.abs(self.directions) > 1.0e-8)).any(axis=0)
        scaled = np.nan_to_num(scaled)
        found = scaled.T @ scaled
        found[np.diag_indices_from(found)] = np.where(blind, np.inf, np.diagonal(found))
        return found

    @property
    def parameters(self) -> dict[str, float]:
        """Values by name."""
        return {one.name: self.best.point[one.name] for one in self.space.free}

    @property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """Ends by name, between which each true value lies with a chance of 95 %; far out where the data tell nothing."""
        half = self.factor * np.sqrt(np.diagonal(self.covariance))
        ends = zip(self.position - half, self.position + half)
        return {one.name: tuple(self.space.beyond(k, x) for x in both) for k, (one, both) in enumerate(zip(self.space.free, ends))}

    @property
    def untold(self) -> list[dict[str, float]]:
        """Combinations of parameters of which the data tell less than the ranges do: parts of the ranges by name."""
        names = [one.name for one in self.space.free]
        weak = [way for way, size in zip(self.directions, self.singular) if self.factor >= 0.5 * size]
        return [{name: float(part) for name, part in zip(names, way) if abs(part) > 0.1} for way in weak]

    @property
    def rows(self) -> list[list]:
        """The table of the parameters, whose head is HEADER."""
        return [[one.name, one.unit, self.parameters[one.name], *self.intervals[one.name]] for one in self.space.free]

    @property
    def report(self) -> list[str]:
        """What was found, in lines."""
        lines = []
        for name, unit, value, low, high in self.rows:
            lines.append(f"  {name} = {value:.6g} {unit}".rstrip() + f", 95 % from {low:.6g} to {high:.6g}")
        words = "of the stated errors" if self.stated else "standard error of a measured value"
        lines.append(f"  misfit {self.misfit:.4g}, {words}; {self.degrees + len(self.space.free)} measured values")
        lines.append("  singular values, over the measured values' error: " + ", ".join(f"{size:.3g}" for size in self.singular))
        errors = np.sqrt(np.diagonal(self.covariance))
        for j, one in enumerate(self.space.free):
            for k in range(j):
                tie = self.covariance[j, k] / (errors[j] * errors[k]) if np.isfinite(errors[[j, k]]).all() else 0.0
                if abs(tie) > TIED:
                    lines.append(f"  {self.space.free[k].name} and {one.name} are tied: correlation {tie:.3f}")
        for way in self.untold:
            ways = ", ".join(f"{name} {part:+.2f}" for name, part in way.items())
            lines.append(f"  the data do not tell: {ways} of the ranges, together")
        return lines + [f"  note: {words}" for words in self.notes]

    def picture(self) -> Figure:
        """Draw what was measured, the model, and their differences."""
        from .sweep_picture import draw_identified

        return draw_identified(self.study, self.best, self.units)


def identify(options: StudyOptions) -> Identified:
    """Find the parameters and write table.csv and identified.nml; BielaError where the study cannot be run or has no data."""
    study, deck = prepare(options, design=False)
    space, folder = Space.of(study), options.folder("identify")
    misfits = [one for one in study.scalars if one.measure == "misfit"]
    if not space.free or any(len(one.values) > 1 for one in space.lists):
        raise HistoryError(f"{options.study}: parameters with from and to expected, none with a list or a catalogue")
    if not misfits or (len(misfits) > 1 and not all(one.error for one in misfits)):
        wanted = "error = ... of each of several misfits" if misfits else "a result with measure = 'misfit'"
        raise HistoryError(f"{options.study}: {wanted} expected")
    with DesignRuns(study, deck, options, folder) as runs:
        search = _Search(runs, space, [one.error or 1.0 for one in misfits])
        try:
            best, position = search.find()
            slopes = search.slopes(position)
        except RunsOverError:
            raise HistoryError(f"{options.study}: runs = {study.runs} are too few") from None
    degrees = len(slopes) - len(space.free)
    if degrees < 1:
        raise HistoryError(f"{options.study}: {len(slopes)} measured values for {len(space.free)} parameters: more expected")
    from scipy import stats

    stated = all(one.error for one in misfits)
    misfit = float(np.sqrt(search.squares(best) / degrees))
    _, singular, directions = np.linalg.svd(slopes / (1.0 if stated else misfit or 1.0), full_matrices=False)
    tail = 0.5 + 0.5 * SURE
    factor = float(stats.norm.ppf(tail) if stated else stats.t.ppf(tail, degrees))
    notes = list(search.notes) + runs.journal.warnings + [f"the solver warns: {words}" for words in best.warnings]
    if stated and stats.chi2.sf(misfit**2 * degrees, degrees) < 1.0e-3:
        notes.append("the differences are larger than the stated errors allow: the model or these are wrong; intervals too small")
    at_ends = [one.name for one, unit in zip(space.free, position) if min(unit, 1.0 - unit) < INSIDE]
    notes += [f"{name} is at an end of its range: its interval does not hold" for name in at_ends]
    known = (study, space, best, position, directions, singular, factor, degrees, misfit, stated, runs.units)
    found = Identified(*known, folder, notes)
    remove_noted(folder)
    write_table(folder / "table.csv", list(HEADER), found.rows)
    text = flat_text(options.biela, study.deck, *settings_of(study, best.point))
    (folder / "identified.nml").write_text(text, encoding="utf-8")
    return found


class _Search:
    """Least squares from the best of runs all over the ranges; scipy's trust region asks for one design after the other."""

    def __init__(self, runs: DesignRuns, space: Space, errors: list[float]) -> None:
        self.runs, self.space, self.errors, self.notes = runs, space, errors, []
        self.choice = tuple(one.values[0] for one in space.lists)
        self.far = np.empty(0)

    def designs(self, positions: list[np.ndarray]) -> list[Design]:
        """Run positions side by side."""
        return self.runs.of([self.space.point(position, self.choice) for position in positions])

    def scaled(self, design: Design) -> np.ndarray:
        """Return the differences of a design, over the stated errors."""
        return np.concatenate([np.array(part) / error for part, error in zip(design.differences, self.errors)])

    def differences(self, position: np.ndarray) -> np.ndarray:
        """Return those of a position; of a run that fails ten times those of the worst start, from which a search turns back."""
        (design,) = self.designs([position])
        return self.scaled(design) if design.ok else self.far

    def slopes(self, position: np.ndarray) -> np.ndarray:
        """Return the derivatives of the differences by the position, shape (measured values, parameters)."""
        ways = [(k, side) for k in range(len(position)) for side in (STEP, -STEP)]
        around = [np.clip(position + side * np.eye(len(position))[k], 0.0, 1.0) for k, side in ways]
        made, base = self.designs(around), self.differences(position)
        columns = []
        for k in range(len(position)):
            pair = [(around[j][k], self.scaled(made[j])) for j in (2 * k, 2 * k + 1) if made[j].ok]
            pair += [(position[k], base)] * (len(pair) < 2)
            if len(pair) < 2:
                raise HistoryError(f"runs on both sides of {self.space.free[k].name} failed: {made[2 * k].reason}")
            columns.append((pair[0][1] - pair[1][1]) / (pair[0][0] - pair[1][0]))
        return np.array(columns).T

    def find(self) -> tuple[Design, np.ndarray]:
        """Search from several starts and return the best design with its position."""
        from scipy.optimize import least_squares

        sample = [self.space.start(), *self.space.spread_out(4 * len(self.space.free) + 3)]
        sample = [np.clip(one, INSIDE, 1.0 - INSIDE) for one in sample]
        made = self.designs(sample)
        good = [(one, at) for one, at in zip(made, sample) if one.ok]
        if not good:
            raise HistoryError(f"none of {len(made)} runs all over the ranges gave its results: {made[0].reason}")
        good.sort(key=lambda one: self.squares(one[0]))
        self.far = 10.0 * np.abs(self.scaled(good[-1][0]))
        how = dict(bounds=(0.0, 1.0), xtol=1.0e-7, ftol=1.0e-9, gtol=1.0e-12)
        found = [least_squares(self.differences, at, self.slopes, **how).x for _, at in good[: self.runs.study.starts]]
        ends = sorted(zip(self.designs(found), found), key=lambda one: self.squares(one[0]))
        elsewhere = sum(self.squares(one) > 1.01 * self.squares(ends[0][0]) for one, _ in ends)
        if elsewhere:
            self.notes.append(f"{elsewhere} of {len(ends)} searches ended elsewhere, with a larger misfit")
        return ends[0]

    def squares(self, design: Design) -> float:
        """Return the sum of the squares of all differences."""
        return float(np.sum(np.square(self.scaled(design))))


def work(args: argparse.Namespace) -> int:
    """Identify, print and draw; returns 0, or 1 where there is something that the data do not tell."""
    found = identify(options_of(args, StudyOptions))
    lines = [*found.report, f"table, deck: {found.folder}/table.csv, identified.nml"]
    tell("identify", [], lines, [] if args.no_pictures else found.draw("identified.png"))
    return int(bool(found.untold))
