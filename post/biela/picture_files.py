"""Where pictures are written, and in which format: PNG, or the format of the suffix that `--output` has."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt

from .result_files import note, writing

FORMATS = (".png", ".pdf", ".svg", ".eps", ".jpg", ".jpeg")


def stem_of(path: Path, suffixes: tuple[str, ...] = FORMATS) -> Path:
    """Return a path without its suffix where that is one of the formats; any other dot belongs to the name."""
    return path.with_suffix("") if path.suffix.lower() in suffixes else path


def lay_out(figure: plt.Figure) -> None:
    """Place what a figure holds, once: matplotlib would lay out and draw all of it a second time when it is written.

    Names of stacked axes are aligned behind that, since each pass compares every axis with all others.
    """
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
