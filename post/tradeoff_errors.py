"""Errors against a converged reference, and how far the reference itself can be trusted."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from compare import scales
from deck_runs import Outcome, RunsError
from histories import History

NOISE = 1.0e-12  # a moment below this share of the same sensor's force (in N m per N) is rounding


@dataclass(frozen=True)
class Truth:
    """What errors are measured against.

    Attributes:
        names: columns
        times: shape (rows,) [s]
        values: shape (rows, columns)
        scale: what each column's error is divided by: its range, shape (columns,)
        uncertainty: largest error that the truth itself may have over columns and times, relative to the ranges
        words: how it was made
    """

    names: tuple[str, ...]
    times: np.ndarray
    values: np.ndarray
    scale: np.ndarray
    uncertainty: float
    words: str


@dataclass(frozen=True)
class Gap:
    """Difference of a run from a truth, relative to the ranges: the worst column's largest and root mean square."""

    largest: float
    rms: float
    column: str


def scale_of(outcome: Outcome) -> np.ndarray:
    """Return what the error of each column is divided by, shape (columns,).

    That is the rule of post/compare.py, with the moment of a reaction never below the rounding of its force.
    """
    names = ["t", *outcome.names]
    history = History(Path("reference"), names, dict(zip(names, ["s", *outcome.units])), outcome.data)
    found = scales(history, history.units)
    for name in outcome.names:
        if name.endswith(".m") and name[:-2] + ".fx" in found:
            force = max(found[name[:-2] + ".fx"], found[name[:-2] + ".fy"])
            found[name] = max(found[name], NOISE * force)
    return np.array([found[name] for name in outcome.names])


def truth_of(outcome: Outcome, uncertainty: float, words: str) -> Truth:
    """Return a run as the truth."""
    return Truth(outcome.names, outcome.data[:, 0], outcome.data[:, 1:], scale_of(outcome), uncertainty, words)


def plain_truth(outcome: Outcome, like: Truth) -> Truth:
    """Return a run as a truth, with the columns and scales of another one."""
    order = [outcome.names.index(name) for name in like.names]
    return Truth(like.names, outcome.data[:, 0], outcome.data[:, 1:][:, order], like.scale, 0.0, "")


def gap(run: Outcome, truth: Truth) -> Gap:
    """Return the error of a run; infinite where it failed.

    Raises:
        RunsError: the run has other columns or times.
    """
    if not run.ok:
        return Gap(float("inf"), float("inf"), run.message)
    columns = [run.names.index(name) for name in truth.names if name in run.names]
    if len(columns) < len(truth.names):
        missing = next(name for name in truth.names if name not in run.names)
        raise RunsError(f"a run lacks the column {missing}")
    rows = np.rint(np.interp(truth.times, run.data[:, 0], np.arange(len(run.data)))).astype(int)
    if np.abs(run.data[rows, 0] - truth.times).max() > 1.0e-6 * (truth.times[1] - truth.times[0]):
        raise RunsError("a run lacks rows at the times of the reference")
    off = np.abs(run.data[rows, 1:][:, columns] - truth.values) / truth.scale
    rms = np.sqrt(np.mean(off**2, axis=0))
    worst = int(np.argmax(off.max(axis=0)))
    return Gap(float(off.max()), float(rms.max()), truth.names[worst])


def between(a: Outcome, b: Outcome) -> float:
    """Return the largest difference of two runs relative to the ranges of the second, infinite where one failed."""
    return gap(a, truth_of(b, 0.0, "")).largest if a.ok and b.ok else float("inf")


def richardson(coarse: float, fine: float, ratio: float, order: float) -> float:
    """Return the error left in the finest of three levels.

    Args:
        coarse: difference of the first two levels
        fine: difference of the last two
        ratio: of the steps of neighbouring levels
        order: of the method; the observed order counts where it is lower, and never one below 1
    """
    seen = np.log(coarse / fine) / np.log(ratio) if coarse > 0.0 and fine > 0.0 and np.isfinite(coarse) else 1.0
    used = min(max(seen, 1.0), order)
    return fine / (ratio**used - 1.0)
