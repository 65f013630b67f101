"""Pictures of a sweep's table: a curve where one parameter varies, a map where two do, dots against each where more do."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib import patheffects

from .picture_files import save
from .plot import COLOURS, LOOK, pretty_unit
from .sweep_study import Study

OUTLINED = [patheffects.withStroke(linewidth=2.5, foreground="white", alpha=0.85)]


def draw(study: Study, header: list[str], rows: list[list], folder: Path) -> list[Path]:
    """Draw every result of the table against the parameters that vary; returns the pictures' paths (PNG)."""
    free = [k for k, parameter in enumerate(study.parameters) if not parameter.expression and len({row[k] for row in rows}) > 1]
    results = range(len(study.parameters), len(header) - 1)
    good = [row for row in rows if not row[-1]]
    numeric = all(isinstance(row[k], (int, float)) for row in rows for k in free)
    if not free or not good:
        return []
    if len(free) == 2 and numeric and all(len(study.parameters[k].values) > 1 for k in free) and _is_grid(rows, free):
        return [_map(study, header, rows, free, result, folder) for result in results]
    with plt.rc_context(LOOK):
        figure, axes = plt.subplots(
            len(results), len(free), figsize=(1.5 + 5.0 * len(free), 0.8 + 2.4 * len(results)), squeeze=False, layout="constrained"
        )
        for line, result in zip(axes, results):
            for axis, k in zip(line, free):
                points = sorted((row[k] if numeric else str(row[k]), row[result]) for row in good)
                style = "-" if len(free) == 1 and numeric else ""
                axis.plot(*zip(*points), f"{style}o", markersize=4, color=COLOURS[0])
                if study.parameters[k].log:
                    axis.set_xscale("log")
                axis.set_xlabel(pretty_unit(header[k].replace("[", " [")))
            line[0].set_ylabel(pretty_unit(header[result].replace("[", " [")))
    return [save(figure, folder / "curves")]


def _is_grid(rows: list[list], free: list[int]) -> bool:
    """Return whether every value of one parameter meets every value of the other."""
    one, two = ({row[k] for row in rows} for k in free)
    return len({(row[free[0]], row[free[1]]) for row in rows}) == len(one) * len(two)


def _map(study: Study, header: list[str], rows: list[list], free: list[int], result: int, folder: Path) -> Path:
    """Draw one result over two parameters; runs that failed stay white, crossed."""
    x, y = (sorted({row[k] for row in rows}) for k in free)
    values = np.full((len(y), len(x)), np.nan)
    for row in rows:
        if not row[-1]:
            values[y.index(row[free[1]]), x.index(row[free[0]])] = row[result]
    with plt.rc_context(LOOK | {"axes.grid": False}):
        figure, axis = plt.subplots(figsize=(7.0, 5.2), layout="constrained")
        shades = axis.pcolormesh(x, y, np.ma.masked_invalid(values), shading="nearest", cmap="viridis")
        if min(values.shape) > 2 and np.isfinite(values).all():
            lines = axis.contour(x, y, values, colors="black", linewidths=0.9)
            lines.set_path_effects(OUTLINED)  # legible on dark and on light shades
            for text in axis.clabel(lines, fontsize=8):
                text.set_path_effects(OUTLINED)
        failed = [(row[free[0]], row[free[1]]) for row in rows if row[-1]]
        if failed:
            axis.plot(*zip(*failed), "x", color="black", label="failed")
            axis.legend(loc="upper right")
        figure.colorbar(shades, label=pretty_unit(header[result].replace("[", " [")))
        for k, scale, label in ((free[0], axis.set_xscale, axis.set_xlabel), (free[1], axis.set_yscale, axis.set_ylabel)):
            label(pretty_unit(header[k].replace("[", " [")))
            if study.parameters[k].log:
                scale("log")
    return save(figure, folder / f"map_{study.scalars[result - len(study.parameters)].name}")
