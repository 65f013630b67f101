"""Quantiles of what was drawn at random, and shares of it, each with its 95 % interval: what tolerances of parts bring."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

SURE = 0.95  # chance that an interval holds the true value


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
    """Return quantiles of independent draws with their intervals, of whatever distribution (order statistics).

    An end is infinite where the draws are too few to bound it.
    """
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
