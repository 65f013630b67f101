"""Pictures of a search for the best design: its history, and what the results there depend on (a tornado)."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from .derivatives import rows_of
from .design_space import Space
from .optimum import Optimum
from .picture_files import save
from .plot import COLOURS, LOOK, axis_label, mark_beyond, pretty_unit, stacked
from .sweep_study import Study

CURVES = 6  # parameters, limits of one panel


def draw(found: Optimum) -> list[Path]:
    """Draw the history of a search and the tornado of its optimum; returns the pictures' paths."""
    paths = [save(history(found), found.folder / "history.png")]
    if found.slopes is not None:
        rows = rows_of(found.study, found.space, found.best, found.slopes)
        figure = tornado(found.study, found.space, rows, found.units, "the optimum")
        paths.append(save(figure, found.folder / "tornado.png"))
    return paths


def history(found: Optimum) -> plt.Figure:
    """Draw objective, limits and free parameters of each run in its order."""
    goal, made, names = found.goal, found.made, found.names
    number = np.arange(1, len(made) + 1)
    values = np.array([one.values for one in made])
    missed = np.array([goal.violation(one) for one in made])
    fine, failed = missed == 0.0, ~np.isfinite(missed)
    units = [one.unit for one in found.study.parameters] + found.units
    limits = {limit.column: limit for limit in goal.limits if limit.bound != 0.0}
    panels = 1 + bool(limits) + bool(found.space.free)
    with plt.rc_context(LOOK):
        figure, axes = plt.subplots(panels, 1, figsize=(8.0, 1.2 + 2.1 * panels), sharex=True, squeeze=False, layout="constrained")
        top, rest = axes[0, 0], list(axes[1:, 0])
        objective = values[:, goal.column]
        top.plot(
            number[~fine & ~failed], objective[~fine & ~failed], "o", mfc="none", color=COLOURS[1], ms=4, label="misses a limit"
        )
        top.plot(number[fine], objective[fine], "o", color=COLOURS[0], ms=4, label="meets all limits" if limits else "run")
        best = np.minimum.accumulate(np.where(fine, goal.sign * np.nan_to_num(objective), np.inf))
        known = np.isfinite(best)
        top.step(number[known], goal.sign * best[known], where="post", color="black", lw=1.0, label="best so far")
        shown = objective[fine] if fine.any() else objective[~failed]
        low, high = np.quantile(shown, (0.0, 0.9) if goal.sign > 0 else (0.1, 1.0))
        room = 0.15 * (high - low) or 0.1 * abs(high) or 1.0
        top.set_ylim(low - room, high + room)
        for runs, colour in ((~fine & ~failed, COLOURS[1]), (fine, COLOURS[0])):
            mark_beyond(top, number[runs], objective[runs], colour)
        if failed.any():
            top.plot(number[failed], np.full(failed.sum(), low - 0.7 * room), "x", color="black", ms=5, label="failed")
        top.set_ylabel(axis_label(names[goal.column], units[goal.column]))
        figure.suptitle(
            f"{found.study.name}: {'min' if goal.sign > 0 else 'max'} {names[goal.column]}, {found.runs} runs", fontsize=10
        )
        if limits:
            axis = rest.pop(0)
            for k, (column, limit) in enumerate(list(limits.items())[:CURVES]):
                sign = "<" if limit.sign > 0 else ">"
                axis.plot(number, values[:, column] / limit.bound, ".", ms=5, color=COLOURS[k % len(COLOURS)],
                          label=f"{names[column]} {sign} {limit.bound:.4g}")  # fmt: skip
            axis.axhline(1.0, color="black", lw=0.8, ls="--")
            axis.set(ylabel="value / limit", ylim=(0.0, 2.5))
            for k, (column, limit) in enumerate(list(limits.items())[:CURVES]):
                mark_beyond(axis, number, values[:, column] / limit.bound, COLOURS[k % len(COLOURS)])
        if found.space.free:
            axis = rest.pop(0)
            for k, one in enumerate(found.space.free[:CURVES]):
                shares = [found.space.unit(k, design.point[one.name]) for design in made]
                axis.plot(number, shares, ".", ms=5, color=COLOURS[k % len(COLOURS)],
                          label=f"{one.name}, {one.ends[0]:.4g} to {one.ends[1]:.4g} {pretty_unit(one.unit)}".rstrip())  # fmt: skip
            axis.set(ylabel="share of its range", ylim=(-0.05, 1.05))
        axes[-1, 0].set_xlabel("run")
        for axis in axes[:, 0]:
            axis.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)
    return figure


def tornado(study: Study, space: Space, rows: list[list], units: list[str], at: str) -> plt.Figure:
    """Draw by how much each result changes where each parameter changes by its spread, with errors, the largest on top."""
    free, unit_of = len(space.free), {one.name: one.unit for one in space.free}
    wide = min(len(study.scalars), 2)
    tall = -(-len(study.scalars) // wide)
    with plt.rc_context(LOOK):
        figure = plt.figure(figsize=(4.6 * wide, 0.9 + tall * (0.9 + 0.3 * free)), layout="constrained")
        for k, (axis, scalar) in enumerate(zip(stacked(figure, len(study.scalars), wide), study.scalars)):
            part = [row for row in rows if row[0] == scalar.name][::-1]
            changes = np.nan_to_num([row[6] for row in part])
            errors = np.nan_to_num([row[7] for row in part])
            axis.barh(
                range(len(part)), changes, color=[COLOURS[0] if change >= 0.0 else COLOURS[1] for change in changes], height=0.6
            )
            axis.errorbar(changes, range(len(part)), xerr=errors, fmt="none", ecolor="black", capsize=3, lw=1.0)
            axis.set_yticks(range(len(part)), [f"{row[1]} + {row[5]:.3g} {pretty_unit(unit_of[row[1]])}".rstrip() for row in part])
            axis.axvline(0.0, color="black", lw=0.8)
            axis.set_xlabel(f"change of {axis_label(scalar.name, units[k])}")
            axis.locator_params(axis="x", nbins=5)
            axis.grid(axis="y", visible=False)
        figure.suptitle(f"{study.name}: sensitivities at {at}", fontsize=10)
    return figure
