"""What a search for the best design ends with: the design, what holds it back, all runs, in figures and in words."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .derivatives import Derivatives, rows_of
from .design_runs import Design, Space
from .design_search import Goal, Search
from .figures import Figures, Tabular
from .sweep_study import Study

ACTIVE = 1.0e-4  # distance from an end of a range at which a parameter is at it, in parts of the range
MET = 1.0e-3  # distance from a limit, of the value's size, within which it may hold the optimum back; or the error of its run


@dataclass
class Optimum(Tabular):
    """What a search ends with."""

    study: Study  # that was searched
    space: Space  # of its designs
    goal: Goal  # what is best
    best: Design | None = None  # the best design, None where no run came to its end
    position: np.ndarray = field(default_factory=lambda: np.empty(0))  # of the best design in the unit cube
    choice: tuple = ()  # of the lists
    searches: list[Search] = field(default_factory=list)  # in their order
    slopes: Derivatives | None = None  # at the optimum, None without free parameters or runs
    errors: np.ndarray = field(default_factory=lambda: np.empty(0))  # of the optimum's values
    prices: dict[str, float] = field(default_factory=dict)  # change of the objective by active bounds, by name of the column
    residual: tuple[float, float] = (0.0, 0.0)  # part of the objective's slope that no limit explains, and that of errors
    notes: list[str] = field(default_factory=list)  # what a user should know
    made: list[Design] = field(default_factory=list)  # in their order, without those that only measure errors
    units: list[str] = field(default_factory=list)  # of the results
    runs: int = 0  # that were asked for, those that measure errors included
    folder: Path = Path()  # of what was stored and of the tables
    warnings: list[str] = field(default_factory=list)  # on what was stored, and what the solver warned of, once each

    @property
    def names(self) -> list[str]:
        """Of parameters and results."""
        return [one.name for one in self.study.columns]

    @property
    def feasible(self) -> bool:
        """Whether the best design meets all limits."""
        return self.best is not None and bool(self.goal.violation(self.best) == 0.0)

    @property
    def parameters(self) -> Figures:
        """Values of the best design, by name."""
        return Figures(self.best.point if self.best else {})

    @property
    def results(self) -> Figures:
        """What the best design gives, by name; None for what it does not have."""
        own = len(self.study.parameters)
        return Figures(zip(self.names[own:], map(_finite, self.best.values[own:])) if self.best else {})

    @property
    def sensitivities(self) -> Figures:
        """Derivatives of the results at the optimum with their errors, by name of the result and of the parameter."""
        if self.slopes is None:
            return Figures()
        own, slopes = len(self.study.parameters), self.slopes

        def of(j: int) -> Figures:
            pairs = zip(self.space.free, map(_finite, slopes.values[j]), map(_finite, slopes.errors[j]))
            return Figures({one.name: Figures(derivative=slope, error=error) for one, slope, error in pairs})

        return Figures({name: of(own + k) for k, name in enumerate(self.names[own:])})

    @property
    def figures(self) -> dict:
        """All of that as JSON has it."""
        outside = sum(one.outside for one in self.made)
        failed = sum(not one.ok for one in self.made) - outside
        found: dict = {"runs": self.runs, "failed": failed, "left_out": outside, "report": self.report, "notes": self.notes}
        found["warnings"] = list(self.best.warnings) if self.best else []
        if self.best:
            found |= {"feasible": self.feasible, "parameters": self.best.point, "results": self.results, "prices": self.prices}
        return found | ({"sensitivities": self.sensitivities} if self.slopes is not None else {})

    def draw(self) -> Iterator[Path]:
        """Draw the history of the search and the tornado of its optimum into the folder, one after the other."""
        from .picture_files import save
        from .sweep_picture import history, tornado

        yield save(history(self), self.folder / "history.png")
        if self.slopes is not None:
            rows = rows_of(self.study, self.space, self.best, self.slopes)
            yield save(tornado(self.study, self.space, rows, self.units, "the optimum"), self.folder / "tornado.png")

    @property
    def head(self) -> list[str]:
        """Of the table of all runs."""
        results = (one.name + (f"[{unit}]" if unit else "") for one, unit in zip(self.study.scalars, self.units))
        return ["run", *(one.label for one in self.study.parameters), *results, "violation", "best", "warnings", "failure"]

    @property
    def rows(self) -> list[list]:
        """All runs: number, values, violation of the limits, best value so far."""
        own, best, rows = len(self.study.parameters), math.inf, []
        for number, design in enumerate(self.made, 1):
            violation, value = self.goal.merit(design)
            best = min(best, value) if violation == 0.0 else best
            shown = list(design.point.values()) + ([*design.values[own:]] if design.ok else [""] * len(self.study.scalars))
            rows.append(
                [number, *shown, violation, self.goal.sign * best if best < math.inf else "", len(design.warnings), design.reason]
            )
        return rows

    @property
    def report(self) -> list[str]:
        """What was found, in lines; what its slopes do not explain is among them."""
        goal, names, own = self.goal, self.names, len(self.study.parameters)
        outside = sum(one.outside for one in self.made)
        failed = sum(not one.ok for one in self.made) - outside
        lines = [f"{self.runs} runs, {failed} failed"]
        if outside:
            lines[0] += f", {outside} left out: the model does not hold for their motion (--allow-warnings)"
        if self.best is None:
            return [*lines, "no run gave its results: " + self.made[0].reason if self.made else "no run was made"]
        units = [one.unit for one in self.study.parameters] + self.units

        def shown(k: int) -> str:
            value = list(self.best.point.values())[k] if k < own else self.best.values[k]
            return f"{names[k]} = {value:.6g} {units[k]}".rstrip() if isinstance(value, float) else f"{names[k]} = {value}"

        goal_text = f"{'min' if goal.sign > 0 else 'max'} {names[goal.column]}"
        missed = goal.violation(self.best)
        head = f"best ({goal_text}): " if not missed else "no design meets all limits; the nearest one: "
        lines.append(head + ", ".join(map(shown, range(own))))
        lines.append("  " + ", ".join(map(shown, range(own, len(names)))))
        for limit in goal.limits:
            value, name = self.best.values[limit.column], names[limit.column]
            words = f"  limit {name} {'<' if limit.sign > 0 else '>'} {limit.bound:.6g}: "
            if limit.sign * (limit.bound - value) < 0.0:
                lines.append(words + f"missed, {name} = {value:.6g}")
            elif name in self.prices:
                price = self.prices[name] * 0.01 * (abs(limit.bound) or goal.scales[limit.column])
                lines.append(words + f"active; 1 % more changes {names[goal.column]} by {price:+.3g} {units[goal.column]}".rstrip())
            else:
                lines.append(words + f"not active, {name} = {value:.6g}")
        for k, one in enumerate(self.space.free):
            if not missed and self.slopes is not None and min(self.position[k], 1.0 - self.position[k]) <= ACTIVE:
                lines.append(f"  {one.name} is at its {'lower' if self.position[k] < 0.5 else 'upper'} end")
        lines += [f"  warning: {words}" for words in self.best.warnings]
        return lines + [f"  note: {words}" for words in self.notes]


def _finite(value: float) -> float | None:
    """Return a number as JSON has it."""
    return float(value) if np.isfinite(value) else None


def position_of(space: Space, design: Design) -> tuple[np.ndarray, tuple]:
    """Return position and choice of a design."""
    position = np.array([space.unit(k, design.point[one.name]) for k, one in enumerate(space.free)])
    return np.clip(position, 0.0, 1.0), tuple(design.point[one.name] for one in space.lists)
