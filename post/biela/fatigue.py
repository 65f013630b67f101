"""Life of a part: rainflow counts of a stress history and the damage that they do."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .histories import History

FINE = 1.0e-3  # share of the largest range below which cycles are not drawn


def cycles(values: np.ndarray) -> np.ndarray:
    """Return range, mean and count (1 or 0.5) of each cycle of a history by rainflow counting (ASTM E1049-85, 5.4.4)."""
    from rainflow import extract_cycles

    return np.array([cycle[:3] for cycle in extract_cycles(values)], dtype=float).reshape(-1, 3)


def damage(counted: np.ndarray, strength: float, borne: float, slope: float, ultimate: float = np.inf) -> float:
    """Return the share of a life that cycles use up (Palmgren, Miner): the amplitude `strength` is borne `borne` times (Basquin).

    Amplitudes are divided by 1 - mean/ultimate (Goodman) where means are positive; all in the unit of the ranges.
    """
    ranges, means, counts = counted.T
    left = 1.0 - np.maximum(means, 0.0) / ultimate
    if np.any(left <= 0.0):
        return np.inf
    return float(np.sum(counts * (0.5 * ranges / left / strength) ** slope) / borne)


def picture(run: History, names: list[str], life: tuple[float, float, float] | None) -> tuple[Figure, list[str]]:
    """Return a figure of how many cycles of columns have at least each range, and words on each; life: as of `damage`."""
    import matplotlib as mpl

    from .picture_files import subplots
    from .plot import COLOURS, LOOK, axis_label, pretty_unit

    words = []
    with mpl.rc_context(LOOK):
        figure, axes = subplots(len(names), 1, figsize=(8.0, 0.8 + 3.0 * len(names)), squeeze=False)
        for axis, name in zip(axes[:, 0], names):
            counted = cycles(run[name])
            counted = counted[np.argsort(-counted[:, 0], kind="stable")]
            at_least = np.cumsum(counted[:, 2])
            top, unit = counted[0, 0] if len(counted) else 0.0, pretty_unit(run.units[name])
            shown = counted[:, 0] > FINE * top
            axis.loglog(at_least[shown], counted[shown, 0], "o-", drawstyle="steps-pre", ms=3, color=COLOURS[0], clip_on=False)
            told = f"{name}: {at_least[-1] if len(counted) else 0.0:g} cycles, largest range {top:.4g} {unit}".rstrip()
            if life and len(counted):
                found = damage(counted, *life)
                told += f", damage {found:.3g}" + (f": {1.0 / found:.3g} such histories" if found > 0.0 else "")
                axis.set_title(told, fontsize=9)
            words.append(told)
            axis.set_ylabel(axis_label(f"range of {name}", run.units[name]))
            axis.set_xlabel("cycles with at least that range (ASTM E1049)")
    return figure, words
