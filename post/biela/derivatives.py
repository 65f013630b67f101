"""Derivatives of results by parameters, with their errors, from runs beside a design.

The polynomial through five designs gives the derivative; that through the nearest three tells how far the step bends it. The error
of a run (`check_error`) over the step is the other part. The step makes both alike.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .design_runs import Design, DesignRuns, Space
from .sweep_study import Study

FIVE = {"both sides": (-2.0, -1.0, 1.0, 2.0), "above": (1.0, 2.0, 3.0, 4.0), "below": (-1.0, -2.0, -3.0, -4.0)}
THREE = {"both sides": (-1.0, 1.0), "above": (1.0, 2.0), "below": (-1.0, -2.0)}
SHORTEST, LONGEST = 1.0e-6, 0.12  # steps, in parts of a parameter's range
ROUNDS = 2  # of steps that are tried
SPREAD = 0.01  # of a parameter's value, where the study says none
HEADER = ["result", "parameter", "at", "derivative", "error", "spread", "change by the spread"]
HEADER += ["error of the change", "percent per percent"]


@dataclass
class Derivatives:
    """Derivatives at a design, of each parameter and result (rows) by each free parameter (columns)."""

    values: np.ndarray  # by the parameters themselves, in their units; nan where runs failed
    errors: np.ndarray  # of them
    steps: np.ndarray  # that were taken, in parts of the ranges, shape (columns,)


def weights(nodes: tuple[float, ...]) -> np.ndarray:
    """Return the weights of values at 0 and at nodes that give the derivative at 0 of the polynomial through them."""
    positions = np.array([0.0, *nodes])
    return np.linalg.inv(np.vander(positions, increasing=True))[1]


def matched(base: Design, other: Design, column: int, first: int = 0) -> float:
    """Return the value of another design at the extreme nearest to one of the base (0: the deciding one): each has no kink."""
    extremes, others = base.extremes[column], other.extremes[column]
    if not extremes or not others:
        return other.values[column]
    positions = np.array([position for position, _ in extremes])
    at = int(np.argmin([abs(position - positions[first]) for position, _ in others]))
    apart = np.abs(np.delete(positions, first) - positions[first])
    if apart.size and abs(others[at][0] - positions[first]) > 0.5 * apart.min():  # it has gone, or another one has come
        at = min(first, len(others) - 1)
    return others[at][1]


def _at_step(runs: DesignRuns, space: Space, base: Design, start: np.ndarray, choice: tuple, steps: np.ndarray):
    """Return derivatives by coordinates, how far the steps bend them, and the weight of errors, each (values, parameters)."""
    sides, points = [], []
    for k, step in enumerate(steps):
        side = "both sides" if 2.0 * step <= start[k] <= 1.0 - 2.0 * step else "above" if start[k] < 0.5 else "below"
        sides.append(side)
        for node in FIVE[side]:
            position = start.copy()
            position[k] += node * step
            points.append(space.point(position, choice))
    found = runs.of(points)
    shape = len(base.values), len(steps)
    slopes, bends, weight = np.full(shape, np.nan), np.full(shape, np.nan), np.zeros(len(steps))
    for k, step in enumerate(steps):
        four = found[4 * k : 4 * k + 4]
        weight[k] = np.abs(weights(FIVE[sides[k]])).sum() / step
        if not all(one.ok for one in four):
            continue
        values = np.array([base.values, *([matched(base, one, j) for j in range(shape[0])] for one in four)])
        slopes[:, k] = weights(FIVE[sides[k]]) @ values / step
        pick = [0, *(1 + FIVE[sides[k]].index(node) for node in THREE[sides[k]])]
        bends[:, k] = np.abs(slopes[:, k] - weights(THREE[sides[k]]) @ values[pick] / step)
    return slopes, bends, weight


def derivatives(
    runs: DesignRuns, space: Space, base: Design, start: np.ndarray, choice: tuple, errors: np.ndarray, scales: np.ndarray
) -> Derivatives:
    """Return derivatives at a design that stands at `start` in the unit cube, by errors and sizes of its values; RunsOverError."""
    own = len(space.parameters)
    known = np.maximum(errors, np.finfo(float).eps * np.abs(base.values))
    part = np.max((known / scales)[own:], initial=0.0)
    steps = np.full(len(space.free), np.clip((3.0 * part) ** (1.0 / 3.0), 1.0e-3, LONGEST))
    best: Derivatives | None = None
    for _ in range(ROUNDS):
        slopes, bends, weight = _at_step(runs, space, base, start, choice, steps)
        noise = known[:, None] * weight
        total = bends + noise
        if best is None:
            best = Derivatives(slopes, total, steps.copy())
        else:
            better = ~(best.errors <= total)
            best.values, best.errors = np.where(better, slopes, best.values), np.where(better, total, best.errors)
            best.steps = np.where(better[own:].any(axis=0), steps, best.steps)
        longer = _better_steps(bends[own:], noise[own:], steps)
        if np.all(np.abs(np.log(longer / steps)) < np.log(2.0)):
            break
        steps = longer
    slope = np.array([space.slope(k, unit) for k, unit in enumerate(start)])
    return Derivatives(best.values / slope, best.errors / np.abs(slope), best.steps)


def _better_steps(bends: np.ndarray, noise: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Return the steps at which the errors of all results together are least: one part grows as the square, the other falls."""
    ratios = np.logspace(-2.0, 2.0, 81)[:, None]
    found = steps.copy()
    for k, step in enumerate(steps):
        good = np.isfinite(bends[:, k]) & (bends[:, k] + noise[:, k] > 0.0)
        if not good.any():
            found[k] = step / 4.0  # runs failed: nearer to the design
            continue
        errors = bends[good, k] * ratios**2 + noise[good, k] / ratios
        total = (errors / errors.min(axis=0)).sum(axis=1)
        found[k] = np.clip(step * ratios[np.argmin(total), 0], SHORTEST, LONGEST)
    return found


def rows_of(study: Study, space: Space, base: Design, found: Derivatives) -> list[list]:
    """Return the rows of the table, each result's largest change first."""
    own, rows = len(study.parameters), []
    for j, scalar in enumerate(study.scalars):
        value = base.values[own + j]
        part = []
        for k, one in enumerate(space.free):
            at = base.point[one.name]
            slope, error = found.values[own + j, k], found.errors[own + j, k]
            spread = one.spread or SPREAD * (abs(at) or one.ends[1] - one.ends[0])
            relative = slope * at / value if value != 0.0 else np.nan
            part.append([scalar.name, one.name, at, slope, error, spread, slope * spread, error * spread, relative])
        rows += sorted(part, key=lambda row: -abs(np.nan_to_num(row[6])))
    return rows
