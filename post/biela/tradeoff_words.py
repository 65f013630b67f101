"""What a trade-off has found, in figures, in words and in a picture: tradeoff.txt, recommended.nml, error against seconds."""

from __future__ import annotations

import html
import math
import textwrap
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .deck import Deck
from .figures import Tabular
from .tradeoff_errors import Errors
from .tradeoff_settings import FAMILIES, Grid, Setting, TradeoffOptions, own_setting

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FULL = "full model"
WIDTH = 120
TRUTH = "Truth: the deck's own model and meshes, passes of the solver"
MARKS = dict(zip(FAMILIES, "os^vDP"))
TALLEST = 2.0  # error of a run that tells nothing


def model_words(model: str) -> str:
    """Return how a model is simplified."""
    return f"the model simplified: {model}" if model else "the model in full"


@dataclass(frozen=True)
class Point:
    """A model with a setting: its deck, how far it is off, what it costs."""

    model: str  # what is taken out, '' for the model in full
    setting: Setting | None  # None: that of the deck itself
    deck: Deck  # that was run
    values: dict[str, float] = field(default_factory=dict)  # by the names of `Errors.names`, empty where it failed
    reason: str = ""  # why it failed

    @property
    def errors(self) -> dict[str, float]:
        """Largest error of each column over its range, and that of the events."""
        return dict(list(self.values.items())[: list(self.values).index("rms")]) if self.values else {}

    @property
    def error(self) -> float:
        """The largest of them; infinite where the run failed."""
        return max(self.errors.values(), default=math.inf)

    @property
    def column(self) -> str:
        """Which column that is."""
        return max(self.errors, key=self.errors.get, default="")

    @property
    def seconds(self) -> float:
        """Of the processor, analyses alone [s]."""
        return self.values.get("seconds", math.inf)

    @property
    def work(self) -> float:
        """Evaluations times unknowns: a cost that no machine changes."""
        return self.values.get("evaluations", math.inf) * self.values.get("unknowns", math.inf)


@dataclass
class Tradeoff(Tabular):
    """What a study of speed against accuracy has found."""

    head = ("model", "setting", "error", "error_rms", "worst_column", "seconds_[s]", "evaluations")

    options: TradeoffOptions  # what was asked
    folder: Path  # of tradeoff.txt, recommended.nml and what was stored
    grid: Grid  # times of the comparison
    measured: Errors | None = None  # the truth, and what of it is compared
    uncertainty: float = math.inf  # largest error that the truth itself may have, over the ranges [-]
    points: list[Point] = field(default_factory=list)  # everything that was run
    removed: list[tuple[int, str, float, bool]] = field(default_factory=list)  # tried: round, label, error, whether it was taken
    written: Point | None = None  # the deck as written
    chosen: Point | None = None  # what is recommended, as a run of recommended.nml shows it; None where nothing can be
    notes: list[str] = field(default_factory=list)  # on the truth and the search
    warnings: list[str] = field(default_factory=list)  # of the solver on the deck as written

    @property
    def allowed(self) -> float:
        """The tolerance less the uncertainty of the truth; negative where no error can be shown to be small enough."""
        return self.options.tolerance - self.uncertainty if self.uncertainty < self.options.tolerance else -1.0

    @property
    def meets(self) -> bool:
        """Whether the recommended deck is accurate enough."""
        return self.chosen is not None and self.chosen.error <= self.allowed

    @property
    def recommended(self) -> Path | None:
        """The deck that is recommended, None where there is none."""
        return self.folder / "recommended.nml" if self.chosen else None

    def setting(self, point: Point) -> str:
        """Return a point's setting in words."""
        return point.setting.words(self.grid) if point.setting else own_setting(point.deck)

    @property
    def rows(self) -> list[list]:
        """All runs of the search: model, setting, errors over a column's range, seconds, evaluations."""
        return [[p.model or FULL, self.setting(p), p.error, p.values["rms"], p.column, p.seconds, int(p.values["evaluations"])]
                for p in self.points]  # fmt: skip

    def _repr_html_(self) -> str:
        return f"<p>{html.escape(self.verdict)}</p>" + "".join(f"<p>{html.escape(words)}</p>" for words in self.warnings)

    @property
    def verdict(self) -> str:
        """Return the paragraph: the cheapest setting that meets the tolerance, what it costs and what it leaves out."""
        tolerance, written, chosen = f"{self.options.tolerance:g} of each sensor's range", self.written, self.chosen
        own = f"The deck as written has an error of {written.error:.1e} and takes {written.seconds:.4f} s"
        own = own if written.values else f"The deck as written could not be compared: {written.reason}"
        if chosen is None and math.isinf(self.uncertainty):
            return f"No reference converged within --time {self.options.time:g}: nothing is recommended, errors are rough. {own}."
        if chosen is None:
            return f"No setting that was tried meets {tolerance}. {own}. The truth itself is known to {self.uncertainty:.1e}."
        known = f"(worst column {chosen.column}; the truth is known to {self.uncertainty:.1e})"
        if chosen is written:
            text = f"The deck as written is the cheapest that was found to meet {tolerance}: keep it. Its error is "
            return f"{text}{chosen.error:.1e} {known}, it takes {chosen.seconds:.4f} s."
        lead = "The cheapest setting that meets" if self.meets else "The best setting, whose own run misses"
        text = f"{lead} {tolerance} is {self.setting(chosen)} with {model_words(chosen.model)}. "
        text += f"recommended.nml was run: its error is {chosen.error:.1e} {known}, it takes {chosen.seconds:.4f} s. {own}"
        if written.values:
            text += f": the speed-up is {written.seconds / max(chosen.seconds, 1.0e-6):.3g} in seconds, "
            text += f"{written.work / max(chosen.work, 1.0):.3g} in evaluations x unknowns"
            if chosen.seconds > written.seconds:
                text += "; the deck as written is cheaper, but misses the tolerance"
        return f"{text}."

    def comment(self) -> str:
        """Return the comment on top of recommended.nml."""
        texts = [*(f"- {words}" for words in self.warnings), f"Recommended for {self.options.deck.name}. {self.verdict}"]
        texts.append(f"{TRUTH}. Compared: {', '.join(self.measured.columns)}.")
        if not self.grid.stated:
            texts.append(f"The deck states no output_step: a row each step. Here one stands each {self.grid.interval:g} s.")
        return "".join(f"! {line}\n" for text in texts for line in textwrap.wrap(text, WIDTH - 2)) + "\n"

    def _line(self, point: Point, mark: str = "") -> str:
        """Return a run as a line of the table."""
        below, values = "<" if point.error < self.uncertainty else " ", point.values
        left = f"{self.setting(point):34}  {point.error:9.2e}{below} {values['rms']:9.2e}  {point.column:22.22}"
        counts = f"{values['evaluations']:11.0f} {values['solves']:11.0f} {values['unknowns']:8.0f}"
        return f"{left} {point.seconds:10.4f} {counts}  {mark:2}{point.model or FULL}"

    @property
    def text(self) -> str:
        """Return the text of tradeoff.txt."""
        marks, lowest = {}, math.inf
        for point in sorted(self.points, key=lambda p: (p.seconds, p.error)):
            marks[id(point)], lowest = "*" * (point.error < lowest), min(lowest, point.error)
        wide = max([44, *(len(label) for _, label, _, _ in self.removed)])
        allowed, lines = self.allowed, [f"Speed against accuracy of {self.options.deck.name}", ""]
        lines += [line for text in [*self.warnings, self.verdict] for line in textwrap.wrap(text, WIDTH)]
        lines += ["", TRUTH]
        lines += [f"  its own uncertainty: {self.uncertainty:.1e} of a column's range, as the solver estimates it"]
        lines += [f"  {note}" for note in self.notes]
        lines += textwrap.wrap(f"compared: {', '.join(self.measured.columns)}; rounding alone and states are left out", WIDTH)
        lines += [
            f"rows compared: every {self.grid.interval:g} s up to {self.grid.t_end:g} s; tolerance {self.options.tolerance:g}",
            "errors: largest and root mean square over time, of the worst column, over its range (post/compare.py has the rule)",
            "seconds: of the processor, analyses alone, without start-up; the last rows: of several runs in turn, the median",
            "",
            "What each removal changes",
            f"{'round':>5}  {'simplified':{wide}} {'error':>9}",
            *(
                f"{turn:5}  {label:{wide}} {error:9.2e}  {'taken' if taken else '' if error <= allowed else 'too much'}".rstrip()
                for turn, label, error, taken in self.removed
            ),
            "",
            "Every run (* Pareto front; < below the truth's own uncertainty)",
            f"{'setting':34}  {'error max':>9}  {'error rms':>9}  {'worst column':22} {'seconds':>10} {'evaluations':>11} "
            f"{'solves':>11} {'unknowns':>8}  model",
            *(self._line(p, marks[id(p)]) for p in sorted(self.points, key=lambda p: (p.model, p.seconds))),
            *(self._line(p, mark) for p, mark in ((self.written, "W"), (self.chosen, "R")) if p and p.values),
        ]
        return "\n".join(lines) + "\n"

    def picture(self) -> Figure:
        """Draw error against seconds, colour and mark tell the method, line style the model; not errors above `TALLEST`."""
        import matplotlib as mpl

        from .picture_files import subplots
        from .plot import COLOURS, LOOK, STYLES

        unsure = self.uncertainty if math.isfinite(self.uncertainty) else 0.0
        floor = max(0.5 * unsure, 1.0e-16)
        models = dict.fromkeys(["", self.chosen.model if self.chosen else ""])
        with mpl.rc_context(LOOK):
            figure, axes = subplots(figsize=(8.0, 6.4))
            for style, model in zip(STYLES, models):
                for k, family in enumerate(FAMILIES):
                    mine = [p for p in self.points if (p.model, p.setting.family) == (model, family) and p.error < TALLEST]
                    points = [(p.seconds, max(p.error, floor)) for p in sorted(mine, key=lambda p: p.setting.index)]
                    look = dict(ls=style, color=COLOURS[k], marker=MARKS[family], ms=4, label=None if model else family)
                    axes.loglog(*np.array(points).reshape(-1, 2).T, **look)
            axes.axhline(self.options.tolerance, color="k", lw=1.0, ls=(0, (8, 3)), label=f"tolerance {self.options.tolerance:g}")
            if unsure:
                axes.axhspan(1.0e-18, unsure, color="0.88", zorder=0, label="below the truth's uncertainty")
            for mark, label, point, size in (
                ("kX", "deck as written", self.written, 9),
                ("k*", "recommended.nml", self.chosen, 15),
            ):
                if point and point.error < TALLEST:
                    axes.plot(point.seconds, max(point.error, floor), mark, ms=size, mec="white", label=label, zorder=4)
            for style, model in zip(STYLES, models):
                words = "\n".join(textwrap.wrap(model_words(model).removeprefix("the "), 58))
                axes.plot([], [], color="0.3", ls=style, label=words)
            heights = [y for line in axes.lines for y in line.get_ydata() if floor <= y < TALLEST]
            axes.set_ylim(0.5 * min(heights, default=floor), 2.0 * max(heights, default=1.0))
            left, right = axes.get_xlim()
            wider = math.sqrt(max(1.0, 12.0 * left / right))  # below a decade the ticks between powers of ten are named and meet
            axes.set_xlim(left / wider, right * wider)
            axes.set(xlabel="seconds of the processor, analyses alone", ylabel="largest error / range, worst column")
            axes.set_title(f"{self.options.deck.name}: {', '.join(self.measured.columns)}"[:90], fontsize=10)
            figure.legend(loc="outside lower center", ncols=2, fontsize=8)
        return figure
