"""What is measured on a run at an extreme, and the messages that are stated."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from extreme_cases import Ran

REFUSAL = r"above the safe bound of rk4"
UNSTABLE = r"diverged|cannot be kept closed"


def away(column: str, exact: Callable[[np.ndarray], np.ndarray], scale: float) -> Callable[[Ran], float]:
    """Return a measure: the largest difference of a column from an exact function of time, over a scale."""
    return lambda ran: float(np.abs(ran.history[column] - exact(ran.history.time)).max() / scale)


def same(column: str, kept: np.ndarray, scale: float) -> Callable[[Ran], float]:
    """Return a measure: the largest difference of a column over a scale from the same scene at an ordinary size."""
    return lambda ran: float(np.abs(ran.history[column] / scale - kept).max())


def residual(ran: Ran) -> float:
    """Return the largest energy residual over the largest energy."""
    return ran.residual


def opening(ran: Ran) -> float:
    """Return the largest violation of the joints [m]."""
    return float(np.abs(ran.energy["position_violation"]).max())


def largest(ran: Ran) -> float:
    """Return the largest value of any sensor."""
    return float(np.abs(ran.history.data[:, 1:]).max())
