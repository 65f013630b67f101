"""The work-precision picture: error against seconds, one curve a method and model."""

from __future__ import annotations

import math
import textwrap
from pathlib import Path

import matplotlib.pyplot as plt

from .deck_models import effective_removals
from .plot import COLOURS, LOOK, STYLES
from .tradeoff_report import Result, asked_for, pareto
from .tradeoff_settings import FAMILIES
from .tradeoff_study import FULL, Point, Study

MARKS = dict(zip(FAMILIES, "os^vDP"))
TALLEST = 2.0  # larger errors are not drawn


def model_words(model: str) -> str:
    """Return how a model is simplified, changes that later ones overtook not named."""
    if model == FULL:
        return "model in full"
    return "\n".join(textwrap.wrap("simplified: " + "; ".join(effective_removals(model.split("; "))), 58))


def _curves(study: Study, result: Result) -> dict[str, dict[str, list[Point]]]:
    """Return by model and family the points: of the full model and the last ones on the way to the recommended one."""
    models = list(dict.fromkeys([FULL, *(point.model for point in result.path)]))
    keep = models if len(models) <= 3 else [models[0], *models[-2:]]
    found: dict[str, dict[str, list[Point]]] = {}
    for model in keep:
        for family in FAMILIES:
            mine = [p for p in study.points if (p.model, p.setting.family) == (model, family) and p.error.largest < TALLEST]
            if mine:
                found.setdefault(model, {})[family] = sorted(mine, key=lambda p: p.setting.index)
    return found


def draw(study: Study, result: Result, path: Path) -> None:
    """Write the picture: colour and mark tell the method, line style the model; open marks are below the truth's uncertainty."""
    unsure = study.truth.uncertainty if math.isfinite(study.truth.uncertainty) else 0.0
    floor = max(0.5 * unsure, 1.0e-16)

    def height(point: Point) -> float:
        return max(point.error.largest, floor)

    with plt.rc_context(LOOK):
        figure, axes = plt.subplots(figsize=(8.0, 6.4), layout="constrained")
        shown: dict[str, list] = {"methods": [], "models": [], "others": []}
        for style, (model, families) in zip(STYLES, _curves(study, result).items()):
            for family, points in families.items():
                k = list(FAMILIES).index(family)
                fill = ["white" if p.error.largest < unsure else COLOURS[k] for p in points]
                x, y = [p.cost for p in points], [height(p) for p in points]
                axes.loglog(x, y, ls=style, color=COLOURS[k], lw=1.2)
                axes.scatter(x, y, marker=MARKS[family], c=fill, edgecolors=COLOURS[k], s=22, zorder=3)
            shown["models"].append(plt.Line2D([], [], color="0.3", ls=style, label=model_words(model)))
        for k, family in enumerate(FAMILIES):
            if any(p.setting.family == family for p in study.points):
                shown["methods"].append(plt.Line2D([], [], color=COLOURS[k], marker=MARKS[family], ms=5, label=family))
        front = sorted((study.points[k].cost, height(study.points[k])) for k in pareto(study.points))
        front = [(s, e) for s, e in front if e < TALLEST]
        if front:
            shown["others"] += axes.step(*zip(*front), where="post", color="0.5", lw=0.7, label="no run is better in both")
        wanted = f"tolerance {study.tolerance:g}"
        shown["others"].append(axes.axhline(study.tolerance, color="k", lw=1.0, ls=(0, (8, 3)), label=wanted))
        if unsure:
            shown["others"].append(axes.axhspan(1.0e-18, unsure, color="0.88", zorder=0, label="below the truth's uncertainty"))
        marks = {"kX": ("deck as written", result.written, 10), "k*": ("recommended.nml", result.chosen, 15)}
        marks["kP"] = (f"accuracy={study.tolerance:g}, all passes", result.accuracy_run, 10)
        for mark, (label, point, size) in marks.items():
            if point and point.outcome.ok:
                shown["others"] += axes.plot(point.cost, height(point), mark, ms=size, mec="white", label=label, zorder=4)
        lowest = min([study.tolerance, unsure or 1.0, *(e for _, e in front), *(height(p) for _, p, _ in marks.values() if p)])
        highest = max([study.tolerance, *(y for line in axes.lines for y in line.get_ydata() if y < TALLEST)])
        axes.set_ylim(0.5 * max(lowest, floor), 2.0 * highest)
        axes.set(xlabel="seconds of the processor, analyses alone", ylabel="largest error / range, worst column")
        axes.set_title(f"{result.deck_name}: {', '.join(asked_for(study))}"[:90], fontsize=10)
        lines = [*shown["methods"], *shown["others"], *shown["models"]]
        figure.legend(handles=lines, loc="outside lower center", ncols=2, fontsize=8)
        figure.savefig(path, dpi=100)
        plt.close(figure)
