"""Figures, how they are laid out, and where they are written: as PNG, or in the format of the suffix that `--output` has."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatterMathtext

from .result_files import note, writing

FORMATS = (".png", ".pdf", ".svg", ".eps", ".jpg", ".jpeg")
RAISED = str.maketrans("0123456789-−", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁻")


class Drawing(Figure):
    """A figure that notebooks show. It belongs to no window, unlike those of pyplot, which takes long to load."""

    placed = False

    def lay_out(self) -> None:
        """Place what it holds, once, below and above its legends: the constrained layout would measure all of it twice."""
        for axis in (one for axes in self.axes for one in (axes.xaxis, axes.yaxis)):
            if isinstance(axis.get_major_formatter(), LogFormatterMathtext):
                axis.set_major_formatter(PlainLog())
            if isinstance(axis.get_minor_formatter(), LogFormatterMathtext):
                axis.set_minor_formatter(PlainLog())
        if not self.placed:
            extents = [legend.get_window_extent().transformed(self.transFigure.inverted()) for legend in self.legends]
            below = max((one.y1 for one in extents if one.y0 < 0.5), default=0.0)
            above = max((1.0 - one.y0 for one in extents if one.y0 >= 0.5), default=0.0)
            self.tight_layout()  # with a `rect` it measures twice
            self.subplots_adjust(bottom=self.subplotpars.bottom + below, top=self.subplotpars.top - above)
            self.placed = True

    def savefig(self, *args: object, **how: object) -> None:
        """Write it, laid out."""
        self.lay_out()
        super().savefig(*args, **how)

    def _repr_png_(self) -> bytes:
        file = io.BytesIO()
        self.savefig(file, format="png")
        return file.getvalue()


class PlainLog(LogFormatterMathtext):
    """Numbers of a logarithmic axis as plain text: to set formulas takes a third of the time of a picture."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        """Return a number such as 2×10⁻⁴, '' of those that are not written."""
        if not super().__call__(x, pos):
            return ""
        if x == 0.0:
            return "0"
        factor, _, power = f"{x:.3e}".partition("e")
        ten = f"10{str(int(power)).translate(RAISED)}"
        return f"{float(factor):g}×{ten}".replace("-", "−") if abs(float(factor)) != 1.0 else ("−" if x < 0.0 else "") + ten


def subplots(
    rows: int = 1, columns: int = 1, figsize: tuple[float, float] = (8.0, 5.0), **how: object
) -> tuple[Drawing, Axes | np.ndarray]:
    """Return a figure and its axes, as the function of pyplot that has this name."""
    figure = Drawing(figsize=figsize)
    return figure, figure.subplots(rows, columns, **how)


def stem_of(path: Path, suffixes: tuple[str, ...] = FORMATS) -> Path:
    """Return a path without its suffix where that is one of the formats; any other dot belongs to the name."""
    return path.with_suffix("") if path.suffix.lower() in suffixes else path


def save(figure: Figure, path: Path, part: str = "") -> Path:
    """Write a figure and return its path, with the suffix that is given, else PNG; a part such as `_modes` ends the name."""
    stem = stem_of(path)
    picture = stem.with_name(stem.name + part + (path.name[len(stem.name) :] or ".png"))
    with writing(picture):
        figure.savefig(picture)
        note(picture)
    return picture
