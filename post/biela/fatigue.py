"""Life of a part: rainflow counts of a stress history and the damage that they do."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .result_files import HistoryError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .histories import History

FINE = 1.0e-3  # share of the largest range below which cycles are not drawn
ROUNDING = 1.0e-9  # of the largest range: smaller ones are no cycles, as between equal values at both ends of a history
SIGNED = {"s": ("top", "bottom"), "tau": ("tau1", "tau2")}  # parts of stresses that are sizes, and those that have their sign
OF_STRESS = ("internal", "stress", "layer")  # quantities of sensors with such parts
NEEDS_SIGN = ("damage", "mean")  # measures that mean nothing of a size


def signed_columns(name: str) -> list[str]:
    """Return the columns with the signs of a stress that a name says is a size, none of others."""
    sensor, _, part = name.rpartition(".")
    return [f"{sensor}.{one}" for one in SIGNED.get(part, ())] if sensor else []


def size_words(name: str, what: str) -> str:
    """Return why a measure does not apply to a stress without sign, and what to take."""
    return f"{name} is a size, which has no {what}: take {' and '.join(signed_columns(name))}"


def refuse_size(run: History, name: str, what: str) -> None:
    """Raise HistoryError where a column is the size of a stress, with the columns that have its sign."""
    signed = signed_columns(name)
    there = [one for one in signed if one in run]
    if signed and run.units[name] == "Pa" and (there or run.path.suffix == ".txt") and run[name].min() >= 0.0:
        again = "" if there else ", which the deck's next run has"
        raise HistoryError(f"{run.path}: {size_words(name, what)}{again}")


def moved_words(run: History, name: str) -> list[str]:
    """Return a note where a stress is not of one place: by how much of its size cycles may then err."""
    sensor, _, part = name.rpartition(".")
    if part not in SIGNED["s"] or f"{sensor}.along" not in run:
        return []
    place = sum(run[name] for name in (f"{sensor}.along", f"{sensor}.element") if name in run)
    size = run[f"{sensor}.s"]
    elsewhere = size[np.abs(place - place[size.argmax()]) > FINE]
    share = elsewhere.max(initial=0.0) / (size.max() or 1.0)
    words = f"note: {name} is of places that change, with up to {100.0 * share:.2g} % of the largest stress elsewhere; "
    return [words + "along= in a sensor of 'internal' or 'layer' keeps to one"] if share > FINE else []


def cycles(values: np.ndarray) -> np.ndarray:
    """Return range, mean and count (1 or 0.5) of each cycle of a history by rainflow counting (ASTM E1049-85, 5.4.4)."""
    from rainflow import extract_cycles

    return np.array([cycle[:3] for cycle in extract_cycles(values)], dtype=float).reshape(-1, 3)


def repeating(values: np.ndarray) -> np.ndarray:
    """Return the same of a history that follows itself again and again (5.4.5): from its largest value on all cycles are whole."""
    first = int(np.argmax(values))
    counted = cycles(np.concatenate([values[first:], values[: first + 1]]))
    return counted[counted[:, 0] > ROUNDING * counted[:, 0].max(initial=0.0)]


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
            refuse_size(run, name, "cycles")
            counted = repeating(run[name])
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
            words += [told, *moved_words(run, name)]
            axis.set_ylabel(axis_label(f"range of {name}", run.units[name]))
            axis.set_xlabel("cycles with at least that range (ASTM E1049)")
    return figure, words
