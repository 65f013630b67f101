"""Pictures of studies: tables of sweeps as curves, maps, dots; identified parameters; searches; tornados of sensitivities."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .design_runs import Design, Space
from .optimum import Optimum
from .picture_files import save, subplots
from .plot import COLOURS, LOOK, axis_label, heading_label, mark_beyond, pretty_unit, stacked
from .sweep_study import Study

ROUNDED = 1.0e-6  # by which a multiplier of 1 may be above it
CURVES = 6  # parameters, limits of one panel
OUTLINED = [patheffects.withStroke(linewidth=2.5, foreground="white", alpha=0.85)]


def draw(
    study: Study, header: list[str], rows: list[list], folder: Path, best: list | None = None, limits: list | tuple = ()
) -> list[Path]:
    """Draw every result over what varies, the best row marked, limits (column, value) as lines; return the paths."""
    free = [k for k, parameter in enumerate(study.parameters) if len({row[k] for row in rows}) > 1]
    results = range(len(study.parameters), len(study.columns))
    good = [row for row in rows if not row[-1]]
    numeric = {k: all(isinstance(row[k], (int, float)) for row in rows) for k in free}
    if not free or not good:
        return []
    lists = [{row[k] for row in rows} for k in free]
    grid = len({tuple(row[k] for k in free) for row in rows}) == np.prod([len(one) for one in lists])
    if len(free) == 2 and all(numeric.values()) and all(len(study.parameters[k].values) > 1 for k in free) and grid:
        return [_map(study, header, rows, free, result, folder, best, limits) for result in results]
    groups: dict[object, list[int]] = {}  # orders of one column share a panel
    for result, scalar in zip(results, study.scalars):
        groups.setdefault((scalar.column, scalar.reference) if scalar.measure == "order" else result, []).append(result)
    with mpl.rc_context(LOOK):
        size = 1.5 + 5.0 * len(free) + 1.5 * (len(free) == 1), 0.8 + 2.4 * len(groups)
        figure, axes = subplots(len(groups), len(free), figsize=size, squeeze=False)
        for line, group in zip(axes, groups.values()):
            for axis, k in zip(line, free):
                for colour, result in zip(COLOURS * len(group), group):
                    points = sorted((row[k] if numeric[k] else str(row[k]), row[result]) for row in good)
                    style = "-" if len(free) == 1 and numeric[k] else ""
                    name = header[result].partition("[")[0] if len(group) > 1 else None
                    axis.plot(*zip(*points), f"{style}o", markersize=4, color=colour, label=name, clip_on=False)
                if study.parameters[k].log:
                    axis.set_xscale("log")
                axis.set_xlabel(heading_label(header[k]))
                if len(free) == 1 and numeric[k]:
                    _shade_unstable(axis, study, rows, k)
                if axis.get_legend_handles_labels()[0]:
                    axis.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2, ncols=6)
            name, unit = header[group[0]].split("[") if "[" in header[group[0]] else (header[group[0]], "")
            words = name if len(group) == 1 else f"orders of {study.scalars[group[0] - results[0]].column}"
            line[0].set_ylabel(axis_label(words, unit.rstrip("]")))
    return [save(figure, folder / "curves")]


def _shade_unstable(axis: Axes, study: Study, rows: list[list], k: int) -> None:
    """Shade the values of a parameter whose cycles are not stable, where a result says so."""
    own = len(study.parameters)
    of = [own + j for j, one in enumerate(study.scalars) if one.key == "periodic.largest_multiplier"]
    if not of:
        return
    at = sorted((row[k], not row[-1] and row[of[0]] > 1.0 + ROUNDED) for row in rows)
    values = [value for value, _ in at]
    ends = [values[0], *(0.5 * (a + b) for a, b in zip(values, values[1:])), values[-1]]
    shown = [axis.axvspan(*ends[j : j + 2], color=COLOURS[1], alpha=0.2, lw=0.0) for j, (_, grows) in enumerate(at) if grows]
    if shown:
        shown[0].set_label("unstable cycle")


def draw_distributions(study: Study, header: list[str], rows: list[list], quantiles: list, limits, folder: Path) -> Path:
    """Draw which share of random designs has at most each value of each result, with the quantiles and their intervals."""
    own, count = len(study.parameters), len(study.scalars)
    with mpl.rc_context(LOOK):
        figure, axes = subplots(count, 1, figsize=(8.0, 0.8 + 2.4 * count), squeeze=False)
        for k, (axis, scalar) in enumerate(zip(axes[:, 0], study.scalars)):
            values = np.sort([row[own + k] for row in rows if not row[-1]])
            values = values[np.isfinite(values)]
            axis.step(values, 100.0 * np.arange(1, values.size + 1) / values.size, where="post", color=COLOURS[0])
            for one in (one for one in quantiles if one.name == scalar.name):
                ends = np.clip([one.low, one.high], *values[[0, -1]])
                axis.plot(ends, [100.0 * one.level] * 2, "|-", color=COLOURS[1], markersize=8)
                axis.plot(one.value, 100.0 * one.level, "o", color=COLOURS[1], markersize=4)
            for column, limit in limits:
                if column == own + k:
                    axis.axvline(limit, color=COLOURS[2], ls="--", label=f"limit {limit:.4g}")
                    axis.legend(loc="lower right")
            axis.set_xlabel(heading_label(header[own + k]))
            axis.set_ylabel("designs up to it [%]")
        figure.suptitle(f"{study.name}: {values.size} of {len(rows)} designs, quantiles with 95 % intervals", fontsize=10)
    return save(figure, folder / "distributions")


def draw_identified(study: Study, best: Design, units: list[str]) -> Figure:
    """Return a figure of what was measured and of the model (of a response the amplitude), and of their differences."""
    misfits = [(one, unit) for one, unit in zip(study.scalars, units) if one.measure == "misfit"]
    with mpl.rc_context(LOOK):
        figure, axes = subplots(2 * len(misfits), 1, figsize=(8.0, 0.8 + 4.0 * len(misfits)), squeeze=False, sharex="col",
                                    height_ratios=(3, 2) * len(misfits))  # fmt: skip
        for (upper, lower), (asked, unit), found in zip(axes.reshape(-1, 2), misfits, best.differences):
            one = asked.in_units("Hz" if asked.file == "frequency_response" else "s", unit)
            at, *parts = map(np.array, one.measured)
            inside = (at >= one.start) & (at <= one.end)
            measured = np.array(parts)[:, inside]
            apart = np.reshape(found, measured.shape)
            size = (lambda both: np.hypot(*both)) if len(parts) > 1 else (lambda both: both[0])
            upper.plot(at[inside], size(measured), ".", color="#666666", markersize=3, label="measured")
            upper.plot(at[inside], size(measured + apart), color=COLOURS[1], label="model")
            for part, name in zip(apart, ("real part", "imaginary part")):
                lower.plot(at[inside], part, label=name if len(apart) > 1 else None)
            upper.set_ylabel(axis_label(f"{one.column}, amplitude" if len(parts) > 1 else one.column, unit))
            upper.set_yscale("log" if len(parts) > 1 else "linear")
            lower.set_ylabel(axis_label("model less measured", unit))
            if at[0] > 0.0 and at[-1] > 10.0 * at[0] and len(parts) > 1:
                upper.set_xscale("log")
            for axis in (upper, lower) if len(parts) > 1 else (upper,):
                axis.legend(loc="upper right", ncols=2)
        axes[-1, 0].set_xlabel("f [Hz]" if misfits[-1][0].file == "frequency_response" else "t [s]")
    return figure


def _map(study: Study, header: list[str], rows: list[list], free: list[int], result: int, folder: Path, best, limits) -> Path:
    """Draw one result over two parameters; runs that failed stay white, crossed."""
    x, y = (sorted({row[k] for row in rows}) for k in free)

    def table(column: int) -> np.ndarray:
        """Return a column over the grid; NaN where the run failed."""
        found = np.full((len(y), len(x)), np.nan)
        for row in rows:
            if not row[-1]:
                found[y.index(row[free[1]]), x.index(row[free[0]])] = row[column]
        return found

    def words(column: int) -> str:
        return heading_label(header[column])

    values = table(result)
    with mpl.rc_context(LOOK | {"axes.grid": False}):
        figure, axis = subplots(figsize=(7.0, 5.2))
        shades = axis.pcolormesh(x, y, np.ma.masked_invalid(values), shading="nearest", cmap="viridis")
        if min(values.shape) > 2 and np.isfinite(values).all():
            lines = axis.contour(x, y, values, colors="black", linewidths=0.9)
            lines.set_path_effects(OUTLINED)  # legible on dark and on light shades
            for text in axis.clabel(lines, fontsize=8):
                text.set_path_effects(OUTLINED)
        failed = [(row[free[0]], row[free[1]]) for row in rows if row[-1]]
        if failed:
            axis.plot(*zip(*failed), "x", color="black", label="failed")
        for column, value in limits:
            if min(values.shape) > 1 and np.nanmin(table(column)) < value < np.nanmax(table(column)):
                axis.contour(x, y, table(column), [value], colors=COLOURS[1], linewidths=2.0, linestyles="--")
                axis.plot([], [], "--", color=COLOURS[1], linewidth=2.0, label=f"{words(column)} = {value:.4g}")
        if best is not None:
            unit = words(result).partition(" [")[2].rstrip("]")
            look = dict(color="white", mec=COLOURS[1], mew=1.5, ms=14, ls="none", clip_on=False, zorder=5)
            axis.plot(best[free[0]], best[free[1]], "*", label=f"best: {best[result]:.4g} {unit}".rstrip(), **look)
        if axis.get_legend_handles_labels()[0]:
            figure.legend(loc="outside lower center", ncols=3)
        scalar = study.scalars[result - len(study.parameters)]
        of = " ".join(str(part) for part in (scalar.measure, "of", scalar.column) if scalar.column) or scalar.measure
        axis.set_title(f"{study.name}: {scalar.name} ({of}), {len(rows) - len(failed)} of {len(rows)} runs", fontsize=10)
        figure.colorbar(shades, label=words(result))
        for k, scale, label in ((free[0], axis.set_xscale, axis.set_xlabel), (free[1], axis.set_yscale, axis.set_ylabel)):
            label(words(k))
            if study.parameters[k].log:
                scale("log")
    return save(figure, folder / f"map_{study.scalars[result - len(study.parameters)].name}")


def history(found: Optimum) -> Figure:
    """Draw objective, limits and free parameters of each run in its order."""
    goal, made, names = found.goal, found.made, found.names
    number = np.arange(1, len(made) + 1)
    values = np.array([one.values for one in made])
    missed = np.array([goal.violation(one) for one in made])
    fine, failed = missed == 0.0, ~np.isfinite(missed)
    units = [one.unit for one in found.study.parameters] + found.units
    limits = {limit.column: limit for limit in goal.limits if limit.bound != 0.0}
    panels = 1 + bool(limits) + bool(found.space.free)
    with mpl.rc_context(LOOK):
        figure, axes = subplots(panels, 1, figsize=(8.0, 1.2 + 2.1 * panels), sharex=True, squeeze=False)
        top, rest = axes[0, 0], list(axes[1:, 0])
        objective = values[:, goal.column]
        looks = {COLOURS[1]: (~fine & ~failed, "misses a limit"), COLOURS[0]: (fine, "meets all limits" if limits else "run")}
        for colour, (runs, label) in looks.items():
            top.plot(number[runs], objective[runs], "o", mfc=colour if runs is fine else "none", color=colour, ms=4, label=label)
        best = np.minimum.accumulate(np.where(fine, goal.sign * np.nan_to_num(objective), np.inf))
        known = np.isfinite(best)
        top.step(number[known], goal.sign * best[known], where="post", color="black", lw=1.0, label="best so far")
        shown = objective[fine] if fine.any() else objective[~failed]
        low, high = np.quantile(shown, (0.0, 0.9) if goal.sign > 0 else (0.1, 1.0))
        room = 0.15 * (high - low) or 0.1 * abs(high) or 1.0
        top.set_ylim(low - room, high + room)
        for colour, (runs, _) in looks.items():
            mark_beyond(top, number[runs], objective[runs], colour)
        if failed.any():
            top.plot(number[failed], np.full(failed.sum(), low - 0.7 * room), "x", color="black", ms=5, label="failed")
        top.set_ylabel(axis_label(names[goal.column], units[goal.column]))
        goal_words = f"{'min' if goal.sign > 0 else 'max'} {names[goal.column]}"
        figure.suptitle(f"{found.study.name}: {goal_words}, {found.runs} runs", fontsize=10)
        if limits:
            axis = rest.pop(0)
            axis.axhline(1.0, color="black", lw=0.8, ls="--")
            axis.set(ylabel="value / limit", ylim=(0.0, 2.5))
            for colour, (column, limit) in zip(COLOURS[:CURVES], limits.items()):
                label = f"{names[column]} {'<' if limit.sign > 0 else '>'} {limit.bound:.4g}"
                axis.plot(number, values[:, column] / limit.bound, ".", ms=5, color=colour, label=label)
                mark_beyond(axis, number, values[:, column] / limit.bound, colour)
        if found.space.free:
            axis = rest.pop(0)
            axis.set(ylabel="share of its range", ylim=(-0.05, 1.05))
            for k, one in enumerate(found.space.free[:CURVES]):
                shares = [found.space.unit(k, design.point[one.name]) for design in made]
                label = f"{one.name}, {one.ends[0]:.4g} to {one.ends[1]:.4g} {pretty_unit(one.unit)}".rstrip()
                axis.plot(number, shares, ".", ms=5, color=COLOURS[k], label=label)
        axes[-1, 0].set_xlabel("run")
        for axis in axes[:, 0]:
            axis.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)
    return figure


def tornado(study: Study, space: Space, rows: list[list], units: list[str], at: str) -> Figure:
    """Draw by how much each result changes where each parameter changes by its spread, with errors, the largest on top."""
    free, unit_of = len(space.free), {one.name: one.unit for one in space.free}
    wide = min(len(study.scalars), 2)
    tall = -(-len(study.scalars) // wide)
    with mpl.rc_context(LOOK):
        figure, axes = stacked(len(study.scalars), wide, (4.6 * wide, 0.9 + tall * (0.9 + 0.3 * free)))
        for k, (axis, scalar) in enumerate(zip(axes, study.scalars)):
            part = [row for row in rows if row[0] == scalar.name][::-1]
            changes = np.nan_to_num([row[6] for row in part])
            errors = np.nan_to_num([row[7] for row in part])
            axis.barh(range(len(part)), changes, 0.6, color=[COLOURS[int(change < 0.0)] for change in changes])
            axis.errorbar(changes, range(len(part)), xerr=errors, fmt="none", ecolor="black", capsize=3, lw=1.0)
            axis.set_yticks(range(len(part)), [f"{row[1]} + {row[5]:.3g} {pretty_unit(unit_of[row[1]])}".rstrip() for row in part])
            axis.axvline(0.0, color="black", lw=0.8)
            axis.set_xlabel(f"change of {axis_label(scalar.name, units[k])}")
            axis.locator_params(axis="x", nbins=5)
            axis.grid(axis="y", visible=False)
        figure.suptitle(f"{study.name}: sensitivities at {at}", fontsize=10)
    return figure
