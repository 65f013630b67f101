"""Where pictures are written, and in which format: PNG, or the format of the suffix that `--output` has."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.ticker import LogFormatterMathtext, ScalarFormatter

from .result_files import note, writing

FORMATS = (".png", ".pdf", ".svg", ".eps", ".jpg", ".jpeg")
RAISED = str.maketrans("0123456789-−", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁻")


class Plain(ScalarFormatter):
    """Numbers of an axis as plain text, the power of ten above it with raised digits: to set formulas takes a third of the time."""

    def __init__(self) -> None:
        super().__init__(useMathText=False)
        self.set_powerlimits((-3, 4))

    def get_offset(self) -> str:
        """Return the power of ten, such as ×10⁻⁴."""
        factor, mark, power = super().get_offset().partition("1e")
        return f"{factor}×10{power.translate(RAISED)}" if mark else factor


class PlainLog(LogFormatterMathtext):
    """Numbers of a logarithmic axis as plain text."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        """Return a number such as 2×10⁻⁴, '' of those that are not written."""
        if not super().__call__(x, pos):
            return ""
        if x == 0.0:
            return "0"
        factor, _, power = f"{x:.3e}".partition("e")
        ten = f"10{str(int(power)).translate(RAISED)}"
        return f"{float(factor):g}×{ten}".replace("-", "−") if abs(float(factor)) != 1.0 else ("−" if x < 0.0 else "") + ten


def plain_numbers(figure: plt.Figure) -> None:
    """Write the numbers of all axes as plain text."""
    for axis in (one for axes in figure.axes for one in (axes.xaxis, axes.yaxis)):
        if type(axis.get_major_formatter()) is ScalarFormatter:
            axis.set_major_formatter(Plain())
        if isinstance(axis.get_major_formatter(), LogFormatterMathtext):
            axis.set_major_formatter(PlainLog())
        if isinstance(axis.get_minor_formatter(), LogFormatterMathtext):
            axis.set_minor_formatter(PlainLog())


def stem_of(path: Path, suffixes: tuple[str, ...] = FORMATS) -> Path:
    """Return a path without its suffix where that is one of the formats; any other dot belongs to the name."""
    return path.with_suffix("") if path.suffix.lower() in suffixes else path


def lay_out(figure: plt.Figure) -> None:
    """Place what a figure holds, once: matplotlib would lay out and draw all of it a second time when it is written.

    Names of stacked axes are aligned behind that, since each pass compares every axis with all others.
    """
    plain_numbers(figure)
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
        figure.set_layout_engine(None)
    for part in figure.subfigs:
        part.align_ylabels()


def save(figure: plt.Figure, path: Path, part: str = "") -> Path:
    """Write a figure and return its path, with the suffix that is given, else PNG; a part such as `_modes` ends the name."""
    stem = stem_of(path)
    picture = stem.with_name(stem.name + part + (path.name[len(stem.name) :] or ".png"))
    try:
        with writing(picture):
            lay_out(figure)
            figure.savefig(picture)
            note(picture)
    finally:
        plt.close(figure)
    return picture
