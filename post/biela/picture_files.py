"""Where pictures are written, and in which format: PNG, or the format of the suffix that `--output` has."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt

from .result_files import HistoryError, note

FORMATS = (".png", ".pdf", ".svg", ".eps", ".jpg", ".jpeg")


def stem_of(path: Path, suffixes: tuple[str, ...] = FORMATS) -> Path:
    """Return a path without its suffix where that is one of the formats; any other dot belongs to the name."""
    return path.with_suffix("") if path.suffix.lower() in suffixes else path


def picture_path(path: Path, part: str = "") -> Path:
    """Return the path of a picture: the suffix that is given is taken, else it is PNG; a part such as `_modes` ends the name."""
    stem = stem_of(path)
    return stem.with_name(stem.name + part + (path.name[len(stem.name) :] or ".png"))


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
    """Write a figure and return the path of the picture; its folder is made where it is missing; HistoryError."""
    picture = picture_path(path, part)
    try:
        picture.parent.mkdir(parents=True, exist_ok=True)
        lay_out(figure)
        figure.savefig(picture)
        note(picture)
    except OSError as fault:
        raise HistoryError(f"{picture}: cannot be written ({fault.strerror})") from None
    finally:
        plt.close(figure)
    return picture
