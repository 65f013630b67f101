"""Life of a part: rainflow counts of a stress history and the damage that they do."""

from __future__ import annotations

import numpy as np


def cycles(values: np.ndarray) -> np.ndarray:
    """Return the cycles of a history by rainflow counting (ASTM E1049-85, 5.4.4).

    Args:
        values: of a stress, a force or whatever else wears, shape (rows,)

    Returns:
        a row a cycle: range and mean, in the unit of the values, and count, 1 or 0.5; shape (cycles, 3)
    """
    from rainflow import extract_cycles

    return np.array([cycle[:3] for cycle in extract_cycles(values)], dtype=float).reshape(-1, 3)


def damage(counted: np.ndarray, strength: float, borne: float, slope: float, ultimate: float = np.inf) -> float:
    """Return the share of a life that cycles use up, by Palmgren and Miner's sum, on a line of Basquin without a limit.

    Args:
        counted: range, mean and count of each cycle
        strength: amplitude that is borne so many times [unit of the ranges]
        borne: those times
        slope: the cycles borne fall with this power of the amplitude
        ultimate: amplitudes are divided by 1 - mean/ultimate (Goodman) where means are positive [unit of the ranges]
    """
    ranges, means, counts = counted.T
    left = 1.0 - np.maximum(means, 0.0) / ultimate
    if np.any(left <= 0.0):
        return np.inf
    return float(np.sum(counts * (0.5 * ranges / left / strength) ** slope) / borne)
