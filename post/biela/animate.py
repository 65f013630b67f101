"""A mechanism's motion as a moving picture and as a sheet of snapshots."""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib import patheffects as path_effects
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from .command import Progress
from .histories import read
from .mechanism import Mechanism, Pair, add_trace, from_run, zigzag
from .picture_files import FORMATS, stem_of, subplots
from .plot import LOOK, body_look
from .result_files import HistoryError, note, writing

DARK = "#333333"
TOUCHED = "#e0452f"
FILMS = (".gif", ".mp4")
LONGEST = 8.0  # line of a contact's force, over half the length of a wall
SHORTEST_FRAME = 0.02  # of a GIF [s]
MARGIN = 0.1  # around what is drawn, by its larger side
SHEET = (10.0, 7.5)  # of a sheet of panels at most [inch]
SHEET_LOOK = LOOK | {"axes.grid": False, "font.size": 9}
LARGEST, SMALLEST = 4.5, 1.4  # width of one panel [inch]


class Picture:
    """The mechanism on one axis: lines made once, moved to a row of the motion by `show`."""

    def __init__(
        self, axis: Axes, scene: Mechanism, corners: tuple[np.ndarray, np.ndarray] | None = None, named: bool = False,
        stops: str = DARK, springs: str = DARK,
    ):  # fmt: skip
        self.scene, self.axis = scene, axis
        low, high = corners or scene.extent()
        room = MARGIN * (max(high - low) or 1.0)
        axis.set(xlim=(low[0] - room, high[0] + room), ylim=(low[1] - room, high[1] + room), aspect="equal")
        self.rail_length = 4.0 * max(high - low)
        self.rails = [axis.plot([], [], "-", color="#aaaaaa", lw=1.0, zorder=1)[0] for _ in scene.sliders]
        self.links = [axis.plot([], [], "-", color=DARK, lw=2.5, zorder=2)[0] for _ in scene.links]
        self.springs = [axis.plot([], [], "-", color=springs, lw=1.2, zorder=5)[0] for _ in scene.springs]
        self.stops = [axis.plot([], [], "-", color=stops, lw=2.0, zorder=2)[0] for _ in scene.stops]
        self.touched = [axis.plot([], [], "-", color=TOUCHED, lw=3.5, zorder=4.5)[0] for _ in scene.stops]  # over what touches them
        self.pairs = [stop for stop in scene.stops if isinstance(stop, Pair)]
        self.forces = [axis.plot([], [], "-", color=TOUCHED, lw=1.8, zorder=6.5)[0] for _ in self.pairs]
        self.wall = 0.03 * max(high - low)
        looks = map(body_look, range(len(scene.bodies)))
        self.bodies = [axis.plot([], [], color=colour, ls=style, lw=2.2, zorder=3)[0] for colour, style in looks]
        outlined = [path_effects.withStroke(linewidth=2.5, foreground="white")]
        look = {"fontsize": 8, "va": "bottom", "path_effects": outlined, "zorder": 7}
        self.names = [axis.text(0, 0, f"   {name}   ", **look) for name in scene.bodies if named]
        self.nodes = [axis.plot([], [], "o", color=line.get_color(), ms=3.5, zorder=4)[0] for line in self.bodies]
        for path in scene.traces:
            axis.plot(*path.T, "-", color="#999999", lw=0.8, zorder=1)
        self.lumps = axis.plot([], [], "o", color=DARK, ms=7, zorder=5)[0]
        self.blocks = axis.plot([], [], "s", color="white", mec=DARK, ms=9, mew=1.3, zorder=5)[0]
        self.pins = axis.plot([], [], "o", color="white", mec=DARK, ms=5.5, mew=1.3, zorder=6)[0]
        fixed = [marker.point for marker in scene.pins if marker.body is None]
        if fixed:
            axis.plot(*np.transpose(fixed), "^", color=DARK, ms=10, zorder=2)
        self.stamp = axis.text(0.02, 0.98, "", transform=axis.transAxes, ha="left", va="top")
        lines = [*self.rails, *self.links, *self.springs, *self.stops, *self.touched, *self.forces]
        lines += [*self.bodies, *self.nodes, self.lumps, self.blocks, self.pins]
        self.moving = [*sorted(lines, key=lambda line: line.zorder), *self.names, self.stamp]

    def show_still(self, row: int = 0) -> None:
        """Show a row without its time."""
        self.show(row)
        self.stamp.set_text("")

    def show(self, row: int, since: int | None = None) -> None:
        """Move everything to one row of the motion; stops that have touched since an earlier row are drawn as touched."""
        scene = self.scene
        for line, dots, body in zip(self.bodies, self.nodes, scene.bodies.values()):
            outline = scene.outline(body, row)
            line.set_data(*outline.T)
            nodes = body.to_global(row, scene.nodes(body, row)) if len(body.rest) else outline
            dots.set_data(*nodes.T)
        for text, line in zip(self.names, self.bodies):
            points = line.get_xydata()
            text.set_position(np.nanmean(points, axis=0) if len(points) else (0.0, 0.0))
            along = points[-1] - points[0] if len(points) else np.zeros(2)
            text.set_ha("right" if along[0] * along[1] > 0.0 else "left")  # above a line that rises its left side is free
        for line, pair in zip(self.links, scene.links):
            line.set_data(*np.transpose([scene.position(marker, row) for marker in pair]))
        for line, pair in zip(self.springs, scene.springs):
            line.set_data(*zigzag(*(scene.position(marker, row) for marker in pair), 0.4 * self.wall).T)
        for line, (_, base, direction) in zip(self.rails, scene.sliders):
            angle = direction + (base.body.frame[row, 2] if base.body else 0.0)
            along = self.rail_length * np.array([np.cos(angle), np.sin(angle)])
            line.set_data(*np.transpose([scene.position(base, row) - along, scene.position(base, row) + along]))
        for line, hit, stop in zip(self.stops, self.touched, scene.stops):
            walls, touches = stop.walls(scene, row, self.wall)
            touches |= since is not None and bool(np.any((scene.time[since] < stop.struck) & (stop.struck <= scene.time[row])))
            line.set_data(*np.concatenate([[*wall, [np.nan] * 2] for wall in walls]).T)
            hit.set_data(*(walls[0].T if touches else ([], [])))
        for line, pair in zip(self.forces, self.pairs):
            line.set_data(*pair.pressed(scene, row, LONGEST * self.wall).T)
        blocks = [marker for marker, _, _ in scene.sliders]
        for dots, markers in ((self.lumps, scene.lumps), (self.blocks, blocks), (self.pins, scene.pins)):
            dots.set_data(*np.array([scene.position(marker, row) for marker in markers]).reshape(-1, 2).T)
        self.stamp.set_text(f"t = {scene.time[row] * 1.0e3:.4g} ms" if scene.time[-1] < 0.1 else f"t = {scene.time[row]:.4g} s")


def tiles(count: int, low: np.ndarray, high: np.ndarray) -> tuple[int, int, float, float]:
    """Return lines, columns, width and height [inch] of panels from low to high [m], to scale, as large as a sheet takes them."""
    size = high - low + 2.0 * MARGIN * (max(high - low) or 1.0)
    ratio = float(np.clip(size[1] / size[0], 0.25, 4.0))
    found = []
    for columns in range(1, count + 1):
        lines = -(-count // columns)
        width = max(min(SHEET[0] / columns, LARGEST, SHEET[1] / (lines * ratio)), SMALLEST)
        found.append((width * count / (lines * columns), lines, columns, width, width * ratio))
    return max(found)[1:]


def panels_to_scale(count: int, low: np.ndarray, high: np.ndarray, above: float, title: str = "") -> tuple[Figure, list[Axes]]:
    """Return a figure of as many panels from low to high [m], to scale, with room above each [inch]."""
    lines, columns, width, height = tiles(count, low, high)
    size = (width * columns + 0.5, (height + above) * lines + 0.7)
    figure, axes = subplots(lines, columns, figsize=size, squeeze=False, sharex=True, sharey=True)
    for axis in axes.flat[count:]:
        axis.axis("off")
    figure.supxlabel("x [m]", fontsize=9)
    figure.supylabel("y [m]", fontsize=9)
    if title:
        figure.suptitle(title, fontsize=10)
    return figure, list(axes.flat[:count])


def film(scene: Mechanism, frames: int) -> list[Image.Image]:
    """Return at most that many frames, evenly spread over time; what does not move is drawn once."""
    rows = np.unique(np.linspace(0, len(scene.time) - 1, min(frames, len(scene.time))).round().astype(int))
    size = np.ptp(scene.extent(), axis=0)
    size += 2.0 * MARGIN * (max(size) or 1.0)
    with mpl.rc_context(LOOK | {"axes.grid": False, "figure.dpi": 80}):
        figure, axis = subplots(figsize=(6.4, float(np.clip(6.4 * size[1] / size[0], 2.0, 9.6))))
        axis.set(xlabel="x [m]", ylabel="y [m]")
        picture = Picture(axis, scene, named=True)
        for artist in picture.moving:
            artist.set_animated(True)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        still = canvas.copy_from_bbox(figure.bbox)
        images, line = [], Progress()
        for row, since in zip(rows, [0, *rows]):
            canvas.restore_region(still)
            picture.show(row, since)
            for artist in picture.moving:
                axis.draw_artist(artist)
            line.show("frames", len(images) + 1, len(rows))
            images.append(Image.fromarray(np.array(canvas.buffer_rgba())).convert("RGB"))
    line.clear()
    return images


def sheet(scene: Mechanism, pictures: int = 6, title: str = "") -> Figure:
    """Return a figure of that many snapshots, evenly spread over time; stops that were touched since the one before are red."""
    corners = scene.extent()
    with mpl.rc_context(SHEET_LOOK):
        figure, axes = panels_to_scale(pictures, *corners, 0.15, title)
        rows = np.linspace(0, len(scene.time) - 1, pictures).round().astype(int)
        for axis, row, since in zip(axes, rows, [0, *rows]):
            Picture(axis, scene, corners, named=axis is axes[0]).show(row, since)
    return figure


def write_mp4(images: list[Image.Image], path: Path, seconds: float) -> None:
    """Write frames as a film of that many seconds, its sides cut to even numbers of pixels as the codec asks."""
    import imageio_ffmpeg

    width, height = (side // 2 * 2 for side in images[0].size)
    writer = imageio_ffmpeg.write_frames(str(path), (width, height), fps=len(images) / seconds, macro_block_size=2)
    writer.send(None)
    for image in images:
        writer.send(image.crop((0, 0, width, height)).tobytes())
    writer.close()


def write_gif(images: list[Image.Image], path: Path, seconds: float) -> None:
    """Write frames as a GIF of that many seconds: whole hundredths a frame, two at least, since players slow shorter ones down."""
    count = min(len(images), max(round(seconds / SHORTEST_FRAME), 2))
    chosen = [images[k] for k in np.linspace(0, len(images) - 1, count).round().astype(int)]
    ends = np.round(100.0 * seconds * np.arange(count + 1) / count)
    first, *rest = (image.quantize(64) for image in chosen)
    first.save(path, save_all=True, append_images=rest, duration=(10.0 * np.diff(ends)).astype(int).tolist(), loop=0)


def write(
    scene: Mechanism, stem: Path, frames: int = 100, seconds: float = 5.0, pictures: int = 6, title: str = "", mp4: bool = False
) -> list[Path]:
    """Write STEM.gif, STEM.png, with mp4 STEM.mp4; of a STEM with such a suffix that file alone; return paths; HistoryError."""
    name = stem_of(stem, (*FORMATS, *FILMS))
    endings = [".gif", ".png"] if name == stem else [stem.suffix]
    if mp4 and ".mp4" not in endings:
        endings.append(".mp4")
    paths = [name.with_name(name.name + ending) for ending in endings]
    with writing(stem):
        images = film(scene, frames) if {*endings} & {*FILMS} else []
        for path in paths:
            if path.suffix == ".mp4":
                write_mp4(images, path, seconds)
            elif path.suffix == ".gif":
                write_gif(images, path, seconds)
            else:
                sheet(scene, pictures, title).savefig(path, dpi=110)
            note(path)
    return paths


def animate(args: argparse.Namespace) -> int:
    """Draw as the command line asks and say which files were written; raises HistoryError."""
    if args.frames < 2:
        raise HistoryError("at least 2 frames are needed")
    motion = read(args.run, "motion")
    scene = from_run(motion, args.exaggerate)
    for name in args.trace:
        add_trace(scene, name)
    note = f"deflections × {args.exaggerate:g}" if args.exaggerate != 1.0 else ""
    stem = args.output or motion.path.parent / "motion"
    paths = write(scene, stem, args.frames, args.seconds, args.pictures, note, args.mp4)
    print("wrote " + " and ".join(map(str, paths)))
    return 0
