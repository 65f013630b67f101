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
    """Return quantiles of independent draws with their intervals, those of order statistics, of whatever distribution.

    An end is infinite where the draws are too few to bound it (David & Nagaraja, Order Statistics, 7.1).
    """
    from scipy.stats import binom

    ranks, count, tail = np.concatenate([[-math.inf], np.sort(values), [math.inf]]), len(values), 0.5 * (1.0 - SURE)
    found = []
    for level in levels if count else ():
        low, high = int(binom.ppf(tail, count, level)), int(binom.ppf(1.0 - tail, count, level)) + 1
        found.append(Quantile(name, level, float(np.quantile(values, level)), float(ranks[low]), float(ranks[high])))
    return found


def share_of(condition: str, good: int, count: int) -> Share:
    """Return a share with its interval (Clopper & Pearson, Biometrika 26, 1934)."""
    from scipy.stats import beta

    tail = 0.5 * (1.0 - SURE)
    low = float(beta.ppf(tail, good, count - good + 1)) if good else 0.0
    high = float(beta.ppf(1.0 - tail, good + 1, count - good)) if good < count else 1.0
    return Share(condition, good / count, low, high)
