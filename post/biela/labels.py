"""Writes names beside what they name, so that none lies on another, on a line or on a mark of the picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import textalloc
from matplotlib.axes import Axes
from matplotlib.text import Annotation, Text

SIZE = 8  # of the letters [point]
GROWTH = 1.25  # of a figure in which the names have no room
LARGEST_SIDE = 20.0  # longer side of a figure [inch]


@dataclass(frozen=True)
class Label:
    """A name at a point of the axis, in a colour."""

    at: np.ndarray
    text: str
    colour: str


def obstacles(axis: Axes) -> tuple[list[np.ndarray], np.ndarray]:
    """Return what stands in an axis: lines, each of shape (n, 2), and marks, shape (n, 2), in data coordinates."""
    lines, marks = [], [np.zeros((0, 2))]
    for line in axis.lines:
        points = line.get_xydata()
        if line.get_transform() != axis.transData or not len(points):
            continue
        if line.get_marker() not in ("None", "", None):
            marks.append(points)
        if line.get_linestyle() not in ("None", "") and len(points) > 1:
            pieces = np.split(points, np.flatnonzero(np.isnan(points).any(axis=1)))
            lines += [piece for piece in (piece[~np.isnan(piece).any(axis=1)] for piece in pieces) if len(piece) > 1]
    back = axis.transData.inverted()
    paths = [one.get_transform().transform_path(one.get_path()) for one in axis.patches if len(one.get_path().vertices) > 1]
    lines += [back.transform(path.to_polygons(closed_only=False)[0]) for path in paths]
    for text in axis.texts:
        if isinstance(text, Annotation) and text.arrow_patch is not None:
            lines.append(back.transform(text.arrow_patch.get_transform().transform_path(text.arrow_patch.get_path()).vertices))
        if text.get_text():
            x0, y0, x1, y1 = text.get_window_extent().extents
            lines += [back.transform([(x0, y0), (x1, y1)]), back.transform([(x0, y1), (x1, y0)])]
    (x0, x1), (y0, y1) = axis.get_xlim(), axis.get_ylim()
    lines.append(np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)]))  # the border
    return lines, np.concatenate(marks)


def overlaps(boxes: list[tuple[str, np.ndarray]]) -> list[tuple[str, str]]:
    """Return the pairs of texts whose boxes, (x0, y0, x1, y1) in pixels, overlap by more than a pixel."""
    words = [text for text, _ in boxes]
    corners = np.array([box for _, box in boxes]).reshape(-1, 4)
    sides = np.minimum(corners[:, None, 2:], corners[None, :, 2:]) - np.maximum(corners[:, None, :2], corners[None, :, :2])
    return [(words[i], words[j]) for i, j in zip(*np.nonzero((sides > 1.0).all(axis=2))) if i < j]


def write(axis: Axes, labels: list[Label]) -> list[Text]:
    """Write labels free of each other, with a thin line to what they name, and return the texts; without room the figure grows."""
    if not labels:
        return []
    figure, points = axis.figure, np.array([label.at for label in labels])
    colours, words = [label.colour for label in labels], [label.text for label in labels]
    look = dict(textsize=SIZE, textcolor=colours, linecolor=colours, linewidth=0.5, min_distance=0.012, max_distance=0.3, zorder=9)
    while True:
        figure.lay_out()
        lines, marks = obstacles(axis)
        x, y = np.concatenate([marks, points]).T
        taken = dict(x_scatter=x, y_scatter=y, x_lines=[line[:, 0] for line in lines], y_lines=[line[:, 1] for line in lines])
        _, _, texts, leaders = textalloc.allocate(axis, *points.T, words, **taken, **look)
        size = figure.get_size_inches() * GROWTH
        apart = not overlaps([(text.get_text(), text.get_window_extent().extents) for text in texts])
        if apart or max(size) > LARGEST_SIDE:
            return texts
        for artist in filter(None, [*texts, *leaders]):
            artist.remove()
        figure.set_size_inches(*size)
        figure.placed = False
