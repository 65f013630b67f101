"""A search for the best design: scipy's SLSQP on runs of the solver, those of one derivative side by side.

What it finds does not depend on the number of cores, and one that was interrupted finds its runs in the journal. The largest of
several extremes has kinks: SLSQP gets each extreme as a function of its own. A run that failed is infeasible: the search goes back.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .derivatives import matched
from .design_runs import Design, DesignRuns, Space
from .sweep_scalars import EXTREMES

FAR = 1.0e3  # scaled distance from a limit where a design has fewer extremes than others: never active
SAME = 0.03  # two searches nearer than this part of the ranges, each, go the same way
ITERATIONS = 60
PATIENCE = 3  # iterations that stay in one position, which end a search
FAILURES = 12  # runs that fail, which end a search
JOINED = "another search goes the same way, or farther"
LEAST_STEP, LARGEST_STEP = 1.0e-6, 0.05  # of forward differences, in parts of a parameter's range


@dataclass(frozen=True)
class Limit:
    """A condition: sign * (bound - value) has to be at least zero."""

    column: int  # parameter or result
    sign: int  # 1: the value has to stay below
    bound: float  # in its unit


@dataclass(frozen=True)
class Goal:
    """What the best design is."""

    sign: int  # 1: the smallest value is best
    column: int  # parameter or result that decides
    limits: tuple[Limit, ...]  # to be met
    scales: np.ndarray  # sizes by which values are measured, of each parameter and result
    errors: np.ndarray  # of the values
    several: dict[int, int]  # columns that are the largest (smallest) of several extremes, with the sign of the better way

    def violation(self, design: Design) -> float:
        """Return by how much a design misses its limits, scaled and summed; infinite where its run failed."""
        if not design.ok:
            return math.inf
        missed = (-one.sign * (one.bound - design.values[one.column]) / self.scales[one.column] for one in self.limits)
        return sum(max(miss, 0.0) for miss in missed)

    def merit(self, design: Design) -> tuple[float, float]:
        """Return what the better design has less of: violation first, then the objective."""
        return self.violation(design), self.sign * design.values[self.column] if design.ok else math.inf

    @property
    def accuracy(self) -> float:
        """The scaled change of the objective at which a search ends."""
        return float(max(1.0e-8, (self.errors / self.scales)[self.columns].max()))

    @property
    def columns(self) -> list[int]:
        """All columns that count."""
        return [self.column, *(one.column for one in self.limits)]

    def worst_of_several(self, column: int, sign: int) -> bool:
        """Return whether a column that has to be small (sign 1) or large is the worst of several extremes."""
        return self.several.get(column) == sign


def scales_of(designs: list[Design], width: int) -> np.ndarray:
    """Return the size of each value: the middle half of its spread over designs, else its own size."""
    values = np.array([one.values for one in designs if one.ok]).reshape(-1, width)
    if not len(values):
        return np.ones(width)
    values = np.nan_to_num(values)
    low, high = np.quantile(values, (0.25, 0.75), axis=0)
    sizes = np.abs(values).max(axis=0)
    spread = np.where(high - low > 1.0e-9 * sizes, high - low, np.ptp(values, axis=0))
    return np.where(spread > 1.0e-9 * sizes, spread, np.where(sizes > 0.0, sizes, 1.0))


class StoppedError(Exception):
    """The search is over: another one went the same way, or runs fail."""


class Search:
    """One search, of what the lists leave free, from where it begins, after others; `central`: by differences on both sides."""

    def __init__(self, runs: DesignRuns, space: Space, goal: Goal, choice: tuple, begin: np.ndarray, before: list, central=False):
        self.runs, self.space, self.goal, self.choice, self.begin, self.central = runs, space, goal, choice, begin, central
        self.before = list(before)
        self.ended, self.best = "", None  # why it ended, the best design that it met
        self.path: list[np.ndarray] = []  # positions of its iterates
        self.failures, self.worst = 0, 0.0
        self.known: dict[bytes, Design] = {}
        self.slopes: dict[bytes, tuple[list[np.ndarray], np.ndarray]] = {}
        # an objective that is the worst of several extremes is a further variable, above all of them
        self.above = goal.worst_of_several(goal.column, goal.sign)
        self.rows = [(goal.column, goal.sign, None)] * self.above + [(one.column, one.sign, one.bound) for one in goal.limits]
        part = float((goal.errors / goal.scales)[goal.columns].max())
        step = part ** (1.0 / 3.0) if central else math.sqrt(part)
        self.step = float(np.clip(2.0 * step, LEAST_STEP, LARGEST_STEP))

    def run(self) -> Search:
        """Search until SLSQP ends or the search is stopped; RunsOverError where there are no more runs."""
        try:
            self.ended = self._slsqp()
        except StoppedError as reason:
            self.ended = str(reason)
        return self

    def _slsqp(self) -> str:
        from scipy.optimize import minimize

        goal, first = self.goal, self._design(self.begin)
        if not first.ok:
            return "its first run failed: " + first.reason
        constraints = [{"type": "ineq", "fun": self._margins, "jac": self._margin_slopes}] if self.rows else []
        slope = (lambda x: np.eye(len(x))[-1]) if self.above else lambda x: goal.sign * self._slope(x)[1]
        how = dict(jac=slope, bounds=[(0.0, 1.0)] * len(self.begin) + [(None, None)] * self.above, constraints=constraints)
        how |= dict(method="SLSQP", options={"maxiter": ITERATIONS, "ftol": goal.accuracy})
        found = minimize(self._objective, np.append(self.begin, [self._scaled(first)] * self.above), **how)
        return "" if found.status == 0 else str(found.message)

    def _scaled(self, design: Design) -> float:
        """Return the objective of a design, to be small."""
        return self.goal.sign * design.values[self.goal.column] / self.goal.scales[self.goal.column]

    def _ask(self, positions: list[np.ndarray]) -> list[Design]:
        """Return designs at positions of the cube; StoppedError where the search is not to go on."""
        if self.best and any(self._follows(other) for other in self.before):
            raise StoppedError(JOINED)
        return self.runs.of([self.space.point(position, self.choice) for position in positions])

    def _follows(self, other: Search) -> bool:
        """Return whether an ended search with a design as good or better came the same way, or its end is much nearer."""
        if not other.best or other.ended not in ("", JOINED) or self.goal.merit(self.best) < self.goal.merit(other.best):
            return False
        early = not other.ended and len(self.path) > 2 * len(other.path)
        same = other.choice == self.choice and self.path and other.path
        return early or bool(same and np.abs(self.path[-1] - other.path[-1]).max() < SAME)

    def _design(self, variables: np.ndarray) -> Design:
        """Return the design at a position."""
        position = np.clip(variables[: len(self.begin)], 0.0, 1.0)
        key = position.tobytes()
        if key not in self.known:
            (design,) = self._ask([position])
            self.known[key] = design
            self.failures += not design.ok
            if self.failures > FAILURES:
                raise StoppedError("runs fail around it: " + design.reason)
            if design.ok:
                self.worst = max(self.worst, self._scaled(design))
            if self.best is None or self.goal.merit(design) < self.goal.merit(self.best):
                self.best = design
        return self.known[key]

    def _values(self, column: int, sign: int, base: Design, design: Design) -> list[float]:
        """Return a column of a design, each of the base's extremes where the worst of them counts; scaled."""
        several = self.goal.worst_of_several(column, sign)
        count = max(len(base.extremes[column]), 1) if several else 1
        return [matched(base, design, column, k) / self.goal.scales[column] for k in range(count)]

    def _margins(self, variables: np.ndarray) -> np.ndarray:
        """Return the scaled distances from all limits, positive inside; each extreme has its own."""
        design, goal, found = self._design(variables), self.goal, []
        for column, sign, bound in self.rows:
            most = variables[-1] if bound is None else sign * bound / goal.scales[column] - 2.0 * goal.accuracy
            inside = [most - sign * value for value in self._values(column, sign, design, design)] if design.ok else [-1.0]
            count = EXTREMES if goal.worst_of_several(column, sign) else 1
            found += inside + [FAR] * (count - len(inside))
        return np.array(found)

    def _margin_slopes(self, variables: np.ndarray) -> np.ndarray:
        """Return the derivatives of `_margins`."""
        found = []
        for (column, sign, bound), table in zip(self.rows, self._slope(variables)[0]):
            count = EXTREMES if self.goal.worst_of_several(column, sign) else 1
            rows = np.zeros((count, len(variables)))
            rows[: len(table), : len(self.begin)] = -sign * table
            rows[:, -1] += bound is None
            found.append(rows)
        return np.vstack(found)

    def _objective(self, variables: np.ndarray) -> float:
        """Return the scaled objective; of a failed run more than that of any other."""
        design = self._design(variables)
        return float((variables[-1] if self.above else self._scaled(design)) if design.ok else self.worst + 10.0)

    def _slope(self, variables: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
        """Return the derivatives of the values of all rows, each an array (extremes, parameters), and of the objective."""
        position = np.clip(variables[: len(self.begin)], 0.0, 1.0)
        key = position.tobytes()
        if key in self.slopes:
            return self.slopes[key]
        base = self._design(position)
        if not base.ok:
            raise StoppedError("the run failed: " + base.reason)
        self.path.append(position)
        # iterations that move by less than the step of the differences do so for ever, by their errors
        if len(self.path) > PATIENCE and np.abs(np.array(self.path[-PATIENCE - 1 : -1]) - position).max() < self.step:
            raise StoppedError("")
        columns = [*((column, sign) for column, sign, _ in self.rows), (self.goal.column, 0)]
        found = [np.zeros((len(self._values(column, sign, base, base)), len(position))) for column, sign in columns]
        for k, differences in enumerate(self._neighbours(position, base)):
            for (column, sign), table in zip(columns, found):
                values = [self._values(column, sign, base, design) for _, design in differences]
                table[:, k] = np.dot([weight for weight, _ in differences], values)
        self.slopes[key] = found[:-1], found[-1][0]
        return self.slopes[key]

    def _neighbours(self, position: np.ndarray, base: Design) -> list[list[tuple[float, Design]]]:
        """Return, for each parameter, designs with the weights that give a derivative."""

        def moved(k: int, step: float) -> np.ndarray:
            return position + step * np.eye(len(position))[k]

        up = [self.step if unit <= 1.0 - self.step else -self.step for unit in position]
        steps = [[step, -step] if self.central and 0.0 <= unit - step <= 1.0 else [step] for step, unit in zip(up, position)]
        made = iter(self._ask([moved(k, step) for k, several in enumerate(steps) for step in several]))
        found = []
        for k, several in enumerate(steps):
            good = [(step, design) for step in several if (design := next(made)).ok]
            if not good and 0.0 <= position[k] - several[0] <= 1.0:  # the other side
                good = [(-several[0], design) for design in self._ask([moved(k, -several[0])]) if design.ok]
            if not good:
                raise StoppedError("runs on both sides of a design failed")
            good += [(0.0, base)] * (len(good) < 2)
            apart = good[0][0] - good[1][0]
            found.append([(1.0 / apart, good[0][1]), (-1.0 / apart, good[1][1])])
        return found
