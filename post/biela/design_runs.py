"""Designs of a study, where they are, and their runs: what optimisation and sensitivities ask the solver for."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from .deck import Deck
from .study_runs import StudyRuns
from .sweep_study import Parameter, Study, StudyOptions


@dataclass(frozen=True)
class Space:
    """All designs of a study: positions in the unit cube, a coordinate a free parameter, and choices from lists."""

    parameters: tuple[Parameter, ...]  # all, in the order of the study
    free: tuple[Parameter, ...]  # those with ends
    lists: tuple[Parameter, ...]  # the others

    @classmethod
    def of(cls, study: Study) -> Space:
        """Return the space of a study."""
        free = tuple(one for one in study.parameters if one.ends)
        return cls(study.parameters, free, tuple(one for one in study.parameters if not one.ends))

    @property
    def combinations(self) -> int:
        """How many choices the lists allow."""
        return math.prod(len(one.values) for one in self.lists)

    def choices(self) -> list[tuple]:
        """Return all of them."""
        return list(itertools.product(*(one.values for one in self.lists)))

    def value(self, k: int, unit: float) -> float:
        """Return the value of the free parameter k, from its coordinate."""
        return self.beyond(k, min(max(float(unit), 0.0), 1.0))

    def beyond(self, k: int, unit: float) -> float:
        """Return the value of the free parameter k from its coordinate, which may lie outside of the cube."""
        low, high = self.free[k].ends
        return float(low * (high / low) ** unit if self.free[k].log else low + (high - low) * unit)

    def unit(self, k: int, value: float) -> float:
        """Return the coordinate of a value of the free parameter k."""
        low, high = self.free[k].ends
        return float(math.log(value / low) / math.log(high / low) if self.free[k].log else (value - low) / (high - low))

    def slope(self, k: int, unit: float) -> float:
        """Return the derivative of the value of the free parameter k by its coordinate."""
        low, high = self.free[k].ends
        return self.value(k, unit) * math.log(high / low) if self.free[k].log else high - low

    def point(self, units: np.ndarray, choice: tuple) -> dict:
        """Return a design as values by name, in the order of the study."""
        values = {one.name: self.value(k, units[k]) for k, one in enumerate(self.free)}
        values |= {one.name: value for one, value in zip(self.lists, choice)}
        return {one.name: values[one.name] for one in self.parameters}

    def start(self) -> np.ndarray:
        """Return the position where a search begins: what the study says, else the middle."""
        return np.array([0.5 if one.start is None else self.unit(k, one.start) for k, one in enumerate(self.free)])

    def spread_out(self, count: int, seed: int = 0) -> np.ndarray:
        """Return positions all over the cube, shape (count, parameters): of many Latin hypercubes the one with the widest gaps."""
        generator, best, widest = np.random.default_rng(seed), np.empty((count, len(self.free))), -1.0
        for _ in range(50 if count > 1 else 1):
            shuffled = np.argsort(generator.random((len(self.free), count)), axis=1).T
            positions = (shuffled + 0.5) / count
            gaps = np.linalg.norm(positions[:, None] - positions[None], axis=2) + np.eye(count) * 10.0
            if gaps.min() > widest:
                best, widest = positions, gaps.min()
        return best


class RunsOverError(Exception):
    """The runs that the study allows are made."""


@dataclass(frozen=True)
class Design:
    """A design and what its run gave."""

    point: dict  # values of the parameters, by name
    values: np.ndarray  # of parameters and results, in the order of the study; nan where the run failed, and for words
    extremes: list  # place and value of the extremes of each of them, empty where it is no extreme of several
    errors: np.ndarray  # of the values, 0 where they were not measured
    reason: str  # why the run failed, '' where it did not
    differences: list = field(default_factory=list)  # from what was measured, of each misfit
    warnings: tuple[str, ...] = ()  # what the solver warned of
    outside: bool = False  # whether it was left out since the model does not hold for its motion

    @property
    def ok(self) -> bool:
        """Whether the run gave all its numbers."""
        return not self.reason


class DesignRuns(StudyRuns):
    """Makes runs of designs, each once."""

    def __init__(self, study: Study, deck: Deck, options: StudyOptions, folder: Path, only_within: bool = False) -> None:
        """Take a study; only_within: designs for whose motion the model does not hold count as failed."""
        super().__init__(replace(study, extremes=True), deck, options, folder)
        self.only_within = only_within
        self.made: list[Design] = []  # in the order in which they were asked for, without those that only measure errors
        self.seen: dict[str, Design] = {}
        self.checked = 0
        self.units = [""] * len(study.scalars)  # of the results

    @property
    def count(self) -> int:
        """How many runs were asked for, those that measure errors included."""
        return len(self.made) + self.checked

    def of(self, points: list[dict], check: bool = False) -> list[Design]:
        """Return what runs of designs gave; `check`: they measure their errors; RunsOverError: those that were left are made."""
        left = self.study.runs - self.count
        fresh = [point for point in points if check or repr(point) not in self.seen]
        if len(fresh) > left:
            if left > 0 and not check:
                self.of(fresh[:left])
            raise RunsOverError
        found = self.entries(replace(self.study, points=tuple(fresh), check=check))
        designs = [self._design(point, entry) for point, entry in zip(fresh, found)]
        if check:
            self.checked += len(designs)
            return designs
        for design in designs:
            if repr(design.point) not in self.seen:
                self.seen[repr(design.point)] = design
                self.made.append(design)
        self.progress.show("runs", self.count, 0)
        return [self.seen[repr(point)] for point in points]

    def _design(self, point: dict, entry: dict) -> Design:
        """Return a design from its line of the journal."""
        own = [float(value) if isinstance(value, (int, float)) else np.nan for value in point.values()]
        failed = [np.nan] * len(self.study.scalars)
        values = np.array(own + (entry["values"] or failed), dtype=float)
        # of modes that are followed nothing is measured
        errors = np.nan_to_num([0.0] * len(own) + (entry.get("errors") or [0.0] * len(failed)))
        extremes = [[]] * len(own) + (entry.get("extremes") or [[]] * len(failed))
        reason = entry["reason"]
        if not reason:
            self.units = entry["units"]
            missing = [one.name for one, value in zip(self.study.scalars, entry["values"]) if not np.isfinite(value)]
            reason = f"the run has no {missing[0]}" if missing else ""
        left_out = self.only_within and entry["outside"] and not reason
        if left_out:
            reason = f"the model does not hold for its motion ({entry['warnings'][0]}); --allow-warnings lets it count"
        told = tuple(entry["warnings"]), left_out
        return Design(point, values, extremes, errors, reason, entry.get("differences", []), *told)
