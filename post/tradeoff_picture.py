"""The work-precision picture: error against seconds, one curve a method or model."""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from tradeoff_report import Result, pareto
from tradeoff_study import Point, Study

MARKS = {"rk4": "o", "dopri5": "s", "generalized_alpha": "^", "generalized_alpha adaptive": "v"}
SHOWN = 12  # curves of smaller models at most


def _short(model: str) -> str:
    """Return a model's name that fits a legend."""
    steps = model.split("; ")
    return model if len(model) < 44 else f"{steps[0]}; … ({len(steps)} removals)"


def _curves(study: Study, result: Result) -> dict[tuple[str, str], list[Point]]:
    """Return the points by (model, family): the full model and those on the way to the recommended one."""
    models = list(dict.fromkeys(point.model for point in result.path))
    keep = models if len(models) <= 3 else [models[0], *models[-2:]]
    found: dict[tuple[str, str], list[Point]] = {}
    for point in study.points:
        if point.model in keep and point.gap.largest < 2.0:
            found.setdefault((point.model, point.setting.family), []).append(point)
    return dict(list(found.items())[:SHOWN])


def draw(study: Study, result: Result, path: Path) -> None:
    """Write the picture."""
    figure, axes = plt.subplots(figsize=(11.4, 5.6))
    colours = plt.get_cmap("tab10").colors
    models = list(dict.fromkeys(model for model, _ in _curves(study, result)))
    for (model, family), points in _curves(study, result).items():
        ordered = sorted(points, key=lambda p: p.setting.index)
        floor = 0.5 * study.truth.uncertainty
        x, y = [p.cost for p in ordered], [max(p.gap.largest, floor) for p in ordered]
        colour = colours[models.index(model) % 10]
        axes.loglog(x, y, "-", color=colour, lw=1.1, alpha=0.8, label=f"{family}, {_short(model)}", marker=MARKS[family], ms=4)
        under = [(p.cost, max(p.gap.largest, floor)) for p in ordered if p.gap.largest < study.truth.uncertainty]
        if under:
            axes.plot(*zip(*under), "w" + MARKS[family], ms=4, markeredgecolor=colour, zorder=3)
    front = sorted((study.points[k].cost, study.points[k].gap.largest) for k in pareto(study.points))
    front = [(s, max(e, 0.5 * study.truth.uncertainty)) for s, e in front if e < 2.0]
    if front:
        axes.step(*zip(*front), where="post", color="k", lw=0.8, ls=":", label="Pareto front")
    axes.axhline(study.tolerance, color="tab:red", lw=1.0, ls="--", label=f"tolerance {study.tolerance:g}")
    axes.axhspan(1e-18, study.truth.uncertainty, color="0.85", zorder=0, label="below the truth's own uncertainty")
    axes.plot(result.written.cost, max(result.written.gap.largest, 1e-17), "kX", ms=9, label="deck as written")
    if result.chosen:
        axes.plot(result.chosen.cost, result.chosen.gap.largest, "*", color="tab:red", ms=15, label="recommended.nml", zorder=4)
    lowest = min([study.truth.uncertainty, *(e for _, e in front), study.tolerance])
    axes.set_ylim(0.5 * max(lowest, 1e-16), 2.5)
    axes.set_xlabel("processor seconds of the analyses")
    axes.set_ylabel("largest error / range, worst column")
    axes.set_title(f"{result.deck_name}: {', '.join(sorted(study.asked))}"[:90])
    axes.grid(which="major", alpha=0.3)
    axes.legend(fontsize=7, loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)
    figure.tight_layout()
    figure.savefig(path, dpi=90)
    plt.close(figure)
