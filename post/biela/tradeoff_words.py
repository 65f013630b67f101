"""What a trade-off has found, in words and in a picture: tradeoff.txt, the head of recommended.nml, error against seconds."""

from __future__ import annotations

import math
import textwrap

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from .picture_files import subplots
from .plot import COLOURS, LOOK, STYLES
from .tradeoff_settings import FAMILIES
from .tradeoff_work import FULL, Point, Tradeoff

WIDTH = 120
TRUTH = "Truth: the deck's own model and meshes, passes of the solver"
MARKS = dict(zip(FAMILIES, "os^vDP"))
TALLEST = 2.0  # error of a run that tells nothing


def model_words(model: str) -> str:
    """Return how a model is simplified."""
    return f"the model simplified: {model}" if model else "the model in full"


def verdict(found: Tradeoff) -> str:
    """Return the paragraph: the cheapest setting that meets the tolerance, what it costs and what it leaves out."""
    tolerance, written, chosen = f"{found.options.tolerance:g} of each sensor's range", found.written, found.chosen
    own = f"The deck as written has an error of {written.error:.1e} and takes {written.seconds:.4f} s"
    own = own if written.values else f"The deck as written could not be compared: {written.reason}"
    if chosen is None and math.isinf(found.uncertainty):
        return f"No reference converged within --time {found.options.time:g}: nothing is recommended, errors are rough. {own}."
    if chosen is None:
        return f"No setting that was tried meets {tolerance}. {own}. The truth itself is known to {found.uncertainty:.1e}."
    known = f"(worst column {chosen.column}; the truth is known to {found.uncertainty:.1e})"
    if chosen is written:
        return (
            f"The deck as written is the cheapest that was found to meet {tolerance}: keep it. Its error is {chosen.error:.1e} "
            f"{known}, it takes {chosen.seconds:.4f} s."
        )
    lead = "The cheapest setting that meets" if found.meets else "The most accurate setting within the budget, which misses"
    text = f"{lead} {tolerance} is {found.setting(chosen)} with {model_words(chosen.model)}. "
    text += f"recommended.nml was run: its error is {chosen.error:.1e} {known}, it takes {chosen.seconds:.4f} s. {own}"
    if written.values:
        text += f": the speed-up is {written.seconds / max(chosen.seconds, 1.0e-6):.3g} in seconds, "
        text += f"{written.work / max(chosen.work, 1.0):.3g} in evaluations x unknowns"
        if chosen.seconds > written.seconds:
            text += "; the deck as written is cheaper, but misses the tolerance"
    budget = f" The budget was {found.options.budget:g} s." if math.isfinite(found.options.budget) else ""
    return f"{text}.{budget}"


def pareto(points: list[Point]) -> set[int]:
    """Return the indices of the points that no other one beats in both cost and error."""
    front, lowest = set(), math.inf
    for k in sorted(range(len(points)), key=lambda k: (points[k].seconds, points[k].error)):
        if points[k].error < lowest:
            lowest = points[k].error
            front.add(k)
    return front


def head(found: Tradeoff) -> str:
    """Return the comment on top of recommended.nml."""
    texts = [*(f"- {words}" for words in found.warnings), f"Recommended for {found.options.deck.name}. {verdict(found)}"]
    texts.append(f"{TRUTH}. Compared: {', '.join(found.measured.columns)}.")
    if not found.grid.stated:
        texts.append(f"The deck as written states no output_step: a row each step. Here one stands each {found.grid.interval:g} s.")
    return "".join(f"! {line}\n" for text in texts for line in textwrap.wrap(text, WIDTH - 2)) + "\n"


def _line(found: Tradeoff, point: Point, mark: str = "") -> str:
    """Return a run as a line of the table."""
    below, values = "<" if point.error < found.uncertainty else " ", point.values
    left = f"{found.setting(point):34}  {point.error:9.2e}{below} {values['rms']:9.2e}  {point.column:22.22}"
    counts = f"{values['evaluations']:11.0f} {values['solves']:11.0f} {values['unknowns']:8.0f}"
    return f"{left} {point.seconds:10.4f} {counts}  {mark:2}{point.model or FULL}"


def table(found: Tradeoff) -> str:
    """Return the text of tradeoff.txt."""
    front = pareto(found.points)
    order = sorted(range(len(found.points)), key=lambda k: (found.points[k].model, found.points[k].seconds))
    wide = max([44, *(len(label) for _, label, _, _ in found.removed)])
    allowed, lines = found.allowed, [f"Speed against accuracy of {found.options.deck.name}", ""]
    lines += [line for text in [*found.warnings, verdict(found)] for line in textwrap.wrap(text, WIDTH)]
    lines += ["", TRUTH]
    lines += [f"  its own uncertainty: {found.uncertainty:.1e} of a column's range, as the solver estimates it"]
    lines += [f"  {note}" for note in found.notes]
    lines += textwrap.wrap(f"compared: {', '.join(found.measured.columns)}; rounding alone and states are left out", WIDTH)
    lines += [
        f"rows compared: every {found.grid.interval:g} s up to {found.grid.t_end:g} s; tolerance {found.options.tolerance:g}",
        "errors: largest and root mean square over time, of the worst column, relative to its range (post/compare.py has the rule)",
        "seconds: of the processor, analyses alone, without start-up; the last rows: of several runs in turn, the median",
        "",
        "What each removal changes",
        f"{'round':>5}  {'simplified':{wide}} {'error':>9}",
        *(
            f"{turn:5}  {label:{wide}} {error:9.2e}  {'taken' if taken else '' if error <= allowed else 'too much'}".rstrip()
            for turn, label, error, taken in found.removed
        ),
        "",
        "Every run (* Pareto front; < below the truth's own uncertainty)",
        f"{'setting':34}  {'error max':>9}  {'error rms':>9}  {'worst column':22} {'seconds':>10} {'evaluations':>11} "
        f"{'solves':>11} {'unknowns':>8}  model",
        *(_line(found, found.points[k], "*" if k in front else "") for k in order),
        *(_line(found, p, mark) for p, mark in ((found.written, "W"), (found.chosen, "R")) if p and p.values),
    ]
    return "\n".join(lines) + "\n"


def picture(found: Tradeoff) -> Figure:
    """Draw error against seconds, colour and mark tell the method, line style the model; errors above `TALLEST` are not drawn."""
    unsure = found.uncertainty if math.isfinite(found.uncertainty) else 0.0
    floor = max(0.5 * unsure, 1.0e-16)
    models = dict.fromkeys(["", found.chosen.model if found.chosen else ""])
    with mpl.rc_context(LOOK):
        figure, axes = subplots(figsize=(8.0, 6.4))
        for style, model in zip(STYLES, models):
            for k, family in enumerate(FAMILIES):
                mine = [p for p in found.points if (p.model, p.setting.family) == (model, family) and p.error < TALLEST]
                points = [(p.seconds, max(p.error, floor)) for p in sorted(mine, key=lambda p: p.setting.index)]
                look = dict(ls=style, color=COLOURS[k], marker=MARKS[family], ms=4, label=None if model else family)
                axes.loglog(*np.array(points).reshape(-1, 2).T, **look)
        front = sorted((found.points[k].seconds, max(found.points[k].error, floor)) for k in pareto(found.points))
        axes.step(*np.array(front).reshape(-1, 2).T, where="post", color="0.5", lw=0.7, label="no run is better in both")
        axes.axhline(found.options.tolerance, color="k", lw=1.0, ls=(0, (8, 3)), label=f"tolerance {found.options.tolerance:g}")
        if unsure:
            axes.axhspan(1.0e-18, unsure, color="0.88", zorder=0, label="below the truth's uncertainty")
        for mark, label, point, size in (("kX", "deck as written", found.written, 10), ("k*", "recommended.nml", found.chosen, 15)):
            if point and point.error < TALLEST:
                axes.plot(point.seconds, max(point.error, floor), mark, ms=size, mec="white", label=label, zorder=4)
        for style, model in zip(STYLES, models):
            words = "\n".join(textwrap.wrap(model_words(model).removeprefix("the "), 58))
            axes.plot([], [], color="0.3", ls=style, label=words)
        heights = [y for line in axes.lines for y in line.get_ydata() if floor <= y < TALLEST]
        axes.set_ylim(0.5 * min(heights, default=floor), 2.0 * max(heights, default=1.0))
        left, right = axes.get_xlim()
        wider = math.sqrt(max(1.0, 12.0 * left / right))  # below a decade the ticks between powers of ten have names, which meet
        axes.set_xlim(left / wider, right * wider)
        axes.set(xlabel="seconds of the processor, analyses alone", ylabel="largest error / range, worst column")
        axes.set_title(f"{found.options.deck.name}: {', '.join(found.measured.columns)}"[:90], fontsize=10)
        figure.legend(loc="outside lower center", ncols=2, fontsize=8)
    return figure
