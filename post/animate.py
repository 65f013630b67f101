#!/usr/bin/env python3
"""Draw a mechanism's motion from motion.txt: a moving picture (GIF) and a sheet of snapshots (PNG); no window is needed.

The run must have written motion.txt (motion_step in the deck's transient). With --deck the massless links, springs, slider
lines, pins and rigid bodies' outlines are drawn too. Between the nodes of a beam a smooth curve is drawn through them.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import command
import matplotlib.pyplot as plt
import numpy as np
from histories import HistoryError, read
from mechanism import Mechanism, add_deck, from_motion
from PIL import Image
from plot import COLOURS, LOOK

DARK = "#333333"


class Picture:
    """The mechanism on one axis: lines made once, moved to a row of the motion by `show`."""

    def __init__(self, axis: plt.Axes, scene: Mechanism, margin: float = 0.08):
        self.scene, self.axis = scene, axis
        low, high = scene.extent()
        room = margin * max(high - low)
        axis.set(xlim=(low[0] - room, high[0] + room), ylim=(low[1] - room, high[1] + room), aspect="equal")
        self.reach = 4.0 * max(high - low)
        self.rails = [axis.plot([], [], "-", color="#aaaaaa", lw=1.0, zorder=1)[0] for _ in scene.sliders]
        self.links = [axis.plot([], [], "-", color=DARK, lw=2.5, zorder=2)[0] for _ in scene.links]
        self.springs = [axis.plot([], [], ":", color=DARK, lw=1.5, zorder=2)[0] for _ in scene.springs]
        self.bodies = [
            axis.plot([], [], "-", color=COLOURS[k % len(COLOURS)], lw=2.2, zorder=3, label=name)[0]
            for k, name in enumerate(scene.bodies)
        ]
        self.nodes = [axis.plot([], [], "o", color=line.get_color(), ms=3.5, zorder=4)[0] for line in self.bodies]
        self.blocks = axis.plot([], [], "s", color="white", mec=DARK, ms=9, mew=1.3, zorder=5)[0]
        self.pins = axis.plot([], [], "o", color="white", mec=DARK, ms=5.5, mew=1.3, zorder=6)[0]
        fixed = [place.point for place in scene.pins if place.body is None]
        if fixed:
            axis.plot(*np.transpose(fixed), "^", color=DARK, ms=10, zorder=2)
        self.stamp = axis.text(0.02, 0.98, "", transform=axis.transAxes, ha="left", va="top")
        lines = [*self.rails, *self.links, *self.springs, *self.bodies, *self.nodes, self.blocks, self.pins]
        self.moving = [*sorted(lines, key=lambda line: line.zorder), self.stamp]

    def show(self, row: int) -> None:
        """Move everything to one row of the motion."""
        scene = self.scene
        for line, dots, body in zip(self.bodies, self.nodes, scene.bodies.values()):
            outline = scene.outline(body, row)
            line.set_data(*outline.T)
            nodes = body.to_global(row, scene.nodes(body, row)) if len(body.rest) else outline
            dots.set_data(*nodes.T)
        for lines, pairs in ((self.links, scene.links), (self.springs, scene.springs)):
            for line, pair in zip(lines, pairs):
                line.set_data(*np.transpose([scene.at(place, row) for place in pair]))
        for line, (_, base, direction) in zip(self.rails, scene.sliders):
            angle = direction + (base.body.frame[row, 2] if base.body else 0.0)
            along = self.reach * np.array([np.cos(angle), np.sin(angle)])
            line.set_data(*np.transpose([scene.at(base, row) - along, scene.at(base, row) + along]))
        _dots(self.blocks, [scene.at(place, row) for place, _, _ in scene.sliders])
        _dots(self.pins, [scene.at(place, row) for place in scene.pins])
        self.stamp.set_text(f"t = {scene.time[row] * 1.0e3:.4g} ms" if scene.time[-1] < 0.1 else f"t = {scene.time[row]:.4g} s")


def _dots(line: plt.Line2D, points: list[np.ndarray]) -> None:
    line.set_data(*(np.transpose(points) if points else ([], [])))


def _height(scene: Mechanism, width: float) -> float:
    """Return the height that suits a picture of that width [inch]."""
    low, high = scene.extent()
    size = high - low + 0.16 * max(high - low)
    return float(np.clip(width * size[1] / size[0], 0.2 * width, 1.5 * width))


def film(scene: Mechanism, frames: int) -> list[Image.Image]:
    """Return at most that many frames, evenly spread over time; what does not move is drawn once."""
    rows = np.unique(np.linspace(0, len(scene.time) - 1, min(frames, len(scene.time))).round().astype(int))
    with plt.rc_context(LOOK | {"axes.grid": False, "figure.dpi": 80}):
        figure, axis = plt.subplots(figsize=(6.4, max(2.0, _height(scene, 6.4))), layout="constrained")
        axis.set(xlabel="x [m]", ylabel="y [m]")
        picture = Picture(axis, scene)
        for artist in picture.moving:
            artist.set_animated(True)
        canvas = figure.canvas
        canvas.draw()
        still = canvas.copy_from_bbox(figure.bbox)
        images = []
        for row in rows:
            canvas.restore_region(still)
            picture.show(row)
            for artist in picture.moving:
                axis.draw_artist(artist)
            images.append(Image.fromarray(np.array(canvas.buffer_rgba())).convert("RGB").quantize(64))
    return images


def sheet(scene: Mechanism, pictures: int = 6, title: str = "") -> plt.Figure:
    """Return a figure of that many snapshots, evenly spread over time."""
    rows = np.linspace(0, len(scene.time) - 1, pictures).round().astype(int)
    columns = min(3, pictures)
    lines = -(-pictures // columns)
    with plt.rc_context(LOOK | {"axes.grid": False, "font.size": 9}):
        size = (3.4 * columns, lines * (_height(scene, 3.2) + 0.15) + 0.7)
        figure, axes = plt.subplots(lines, columns, figsize=size, squeeze=False, layout="constrained", sharex=True, sharey=True)
        for axis, row in zip(axes.flat, rows):
            Picture(axis, scene).show(row)
        for axis in axes.flat[pictures:]:
            axis.axis("off")
        figure.supxlabel("x [m]", fontsize=9)
        figure.supylabel("y [m]", fontsize=9)
        if title:
            figure.suptitle(title, fontsize=10)
    return figure


def write(scene: Mechanism, stem: Path, frames: int = 100, seconds: float = 5.0, pictures: int = 6, title: str = "") -> list[Path]:
    """Write STEM.gif and STEM.png and return their paths.

    Raises:
        HistoryError: they cannot be written.
    """
    paths = [stem.with_name(stem.name + ".gif"), stem.with_name(stem.name + ".png")]
    try:
        stem.parent.mkdir(parents=True, exist_ok=True)
        images = film(scene, frames)
        images[0].save(paths[0], save_all=True, append_images=images[1:], duration=round(1000.0 * seconds / len(images)), loop=0)
        sheet(scene, pictures, title).savefig(paths[1], dpi=110)
    except OSError as fault:
        raise HistoryError(f"{stem}: cannot be written ({fault.strerror})") from None
    finally:
        plt.close("all")
    return paths


def arguments() -> argparse.ArgumentParser:
    """Return the command line's parser."""
    parser = argparse.ArgumentParser(prog="animate.py", description=__doc__.split("\n")[0])
    parser.add_argument("run", type=Path, help="results folder or motion.txt")
    parser.add_argument("--deck", type=Path, help="the deck of the run: draws links, pins, sliders and rigid bodies too")
    parser.add_argument("--exaggerate", type=float, default=1.0, metavar="FACTOR", help="multiply the deflections (1)")
    parser.add_argument("--frames", type=int, default=100, help="largest number of frames (%(default)d)")
    parser.add_argument("--seconds", type=float, default=5.0, help="how long the animation lasts (%(default)g)")
    parser.add_argument("--pictures", type=int, default=6, help="snapshots on the sheet (%(default)d)")
    parser.add_argument("--output", type=Path, metavar="STEM", help="write STEM.gif and STEM.png (motion, in the run's folder)")
    return parser


def animate(args: argparse.Namespace) -> int:
    """Draw as the command line asks and say which files were written; raises HistoryError."""
    if args.frames < 2 or args.pictures < 1 or args.seconds <= 0.0:
        raise HistoryError("at least 2 frames, 1 picture and a positive number of seconds are needed")
    motion = read(args.run, "motion")
    scene = from_motion(motion, args.exaggerate)
    if args.deck:
        add_deck(scene, args.deck)
    note = f"deflections × {args.exaggerate:g}" if args.exaggerate != 1.0 else ""
    paths = write(scene, args.output or motion.path.parent / "motion", args.frames, args.seconds, args.pictures, note)
    print("wrote " + " and ".join(map(str, paths)))
    return 0


def main(words: list[str] | None = None) -> int:
    """Draw; status 0, or 2 with one line on standard error."""
    args = arguments().parse_args(words)
    return command.attempt("animate", lambda: animate(args))


if __name__ == "__main__":
    command.run(main)
