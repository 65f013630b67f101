"""The designs of a study: parameters that are free between two ends, parameters that take the values of a list."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from .sweep_study import Parameter, Study


@dataclass(frozen=True)
class Space:
    """All designs of a study.

    A design is a position in the unit cube, one coordinate for each free parameter, and a choice from the lists of the others.
    """

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
