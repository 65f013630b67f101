"""The assembled mechanism of a deck with its names."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Arc

from . import labels
from .animate import Picture
from .command import call_solver
from .histories import read_summary
from .mechanism import hinge, of_scene
from .picture_files import save, subplots
from .plot import COLOURS, LOOK, body_look
from .result_files import HistoryError

DARK, GREY = "#333333", "#8c8c8c"
DRIVE, FORCE, SPRING, SENSOR, STOP = COLOURS[1], COLOURS[4], COLOURS[2], "#9a5b00", "#b0126e"
SYMBOL = 0.035  # size of drawn arrows and springs, of the picture's larger side
STACK = 0.05  # height of the highest stack of layers, likewise


def figures_of(source: Path, biela: Path) -> dict:
    """Return the figures of a results folder, or of a deck that the solver assembles; HistoryError where it refuses the deck."""
    if source.is_dir():
        return read_summary(source)
    done = call_solver(biela, "--check", "--json", source)
    if done.returncode:
        lines = done.stderr.strip().splitlines()
        raise HistoryError("\n".join(lines) or f"{source}: biela --check ended with status {done.returncode}")
    return json.loads(done.stdout)


def walls(stop: dict) -> list[np.ndarray]:
    """Return where the limits of a position are, beside marker a; of other stops nothing."""
    if stop["kind"] != "position":
        return []
    a, b = (np.array(stop[side]["at"]) for side in "ab")
    along = np.array([np.cos(stop["direction"]), np.sin(stop["direction"])])
    line = a - along * ((a - b) @ along)  # where the quantity is 0
    return [line + limit * along for limit in (stop["lower"], stop["upper"]) if limit is not None]


class ScenePicture:
    """A scene on one axis: the mechanism as in every picture, what acts on it, then the labels, which know of each other."""

    def __init__(self, axis: Axes, scene: dict):
        self.axis, self.scene = axis, scene
        self.labels: list[labels.Label] = []
        points = np.array([point for body in scene["bodies"] for point in [*body["nodes"], body["frame"][:2], body["centre"]]])
        items = [item for kind in ("joints", "springs", "stops") for item in scene.get(kind, [])]
        ends = [np.array(item[side]["at"]) for item in items for side in "ab"]
        points = np.array([*points, *ends, *(sensor["at"]["at"] for sensor in scene["sensors"])])
        if scene.get("profiles"):
            points = np.array([*points, *of_scene(scene).extent()])
        low, high = points.min(axis=0), points.max(axis=0)
        side = max(high - low)  # a wall farther away than the mechanism is long would make it small
        found = [wall for stop in scene.get("stops", []) for wall in walls(stop)]
        points = np.array([*points, *(wall for wall in found if (low - side < wall).all() and (wall < high + side).all())])
        low, high = points.min(axis=0), points.max(axis=0)
        self.span = float(max(high - low)) or 1.0
        room = np.maximum(0.16 * self.span, 0.3 * self.span - (high - low) / 2.0)
        Picture(axis, of_scene(scene), (low, high), stops=STOP, springs=SPRING).show_still()
        axis.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
        axis.set_xlim(low[0] - 0.25 * self.span, high[0] + 0.25 * self.span)
        axis.set_ylim(low[1] - room[1], high[1] + room[1])

    def draw(self) -> None:
        """Draw what the mechanism is subject to, and note the names."""
        for k, body in enumerate(self.scene["bodies"]):
            colour, nodes = body_look(k)[0], np.array(body["nodes"])
            at = np.array(body["centre"])
            if len(nodes):
                at = nodes[np.array(body["elements"][len(body["elements"]) // 2]) - 1].mean(axis=0)
            else:
                self.axis.plot(*at, "P", color=colour, ms=6, zorder=4)
            self._label(at, body["name"], colour)
            if any(len(stack) > 1 for stack in body.get("sections", [])):
                self._layers(body, colour)
        for spring in self.scene["springs"]:
            a, b = (np.array(spring[side]["at"]) for side in "ab")
            if spring["kind"] == "torsional":
                turn = np.linspace(0.0, 5.0 * np.pi, 120)
                r = SYMBOL * self.span * turn / turn[-1]
                self.axis.plot(a[0] + r * np.cos(turn), a[1] + r * np.sin(turn), "-", color=SPRING, lw=1.2, zorder=5)
            self._label(a if spring["kind"] == "torsional" else (a + b) / 2.0, spring["name"], SPRING)
        for joint in self.scene["joints"]:
            a, b = (np.array(joint[side]["at"]) for side in "ab")
            words = f"{joint['kind']}, friction {joint['friction']:g}" if "friction" in joint else joint["kind"]
            self._label((a + b) / 2.0 if joint["kind"] == "distance" else a, f"{joint['name']} ({words})", DARK)
        for drive in self.scene["drives"]:
            self._drive(drive)
        for stop in self.scene.get("stops", []):  # older runs do not tell them
            self._stop(stop)
        for force in self.scene["forces"]:
            self._force(force)
        for sensor in self.scene["sensors"]:
            at = np.array(sensor["at"]["at"])
            self.axis.plot(*at, "D", color="white", mec=SENSOR, ms=4, mew=1.1, zorder=8)
            self._label(at, sensor["name"], SENSOR)
        self._gravity()
        self._key()

    def _layers(self, body: dict, colour: str) -> None:
        """Draw the layers of a beam to a scale of their own across; viscoelastic ones are hatched, with dark edges."""
        nodes = np.array(body["nodes"])
        highest = max(stack[-1]["to"] - stack[0]["from"] for stack in body["sections"])
        scale = max(STACK * self.span / highest, 1.0)
        for ends, section in zip(body["elements"], body["element_sections"]):
            a, b = nodes[np.array(ends) - 1]
            across = scale * np.array([a[1] - b[1], b[0] - a[0]]) / np.hypot(*(b - a))
            for layer in body["sections"][section - 1]:
                low, high = layer["from"] * across, layer["to"] * across
                look = dict(fc=colour, ec=colour, alpha=0.25, lw=0.6)
                if layer["viscoelastic"]:
                    look = dict(fc="white", ec=DARK, hatch="////////", lw=1.2, zorder=2.5)
                self.axis.fill(*np.transpose([a + low, b + low, b + high, a + high]), **look)
        words = f"layers of {body['name']}: {scale:.3g} times as thick, viscoelastic ones hatched"
        if self.axis.get_title():
            words = f"{self.axis.get_title()}\n{words}"
        self.axis.set_title(words, fontsize=9)

    def _label(self, at: np.ndarray, text: str, colour: str) -> None:
        self.labels.append(labels.Label(np.array(at), text, colour))

    def _stop(self, stop: dict) -> None:
        """Name a stop; the arc of an angle and the way of a position say between which limits it lets go."""
        limits = [x for x in (stop["lower"], stop["upper"]) if x is not None]
        at = np.array(stop["a"]["at"])
        if stop["kind"] == "position":
            ends = walls(stop) + ([at] if len(limits) == 1 else [])
            self.axis.plot(*np.transpose(ends), ":", color=STOP, lw=1.0, zorder=2)
            at = walls(stop)[-1]
        elif stop["kind"] == "rotation":
            at = np.array(hinge(self.scene, stop)["at"])
        unit = "rad" if stop["kind"] == "rotation" else "m"
        words = {"clearance": "gap {1:.3g} m", "profile": f"profile {stop.get('profile')}"}
        shown = words.get(stop["kind"], " to ".join(f"{x:.3g}" for x in limits) + f" {unit}")
        self._label(at, f"{stop['name']} (stop, {shown.format(stop['lower'], stop['upper'])})", STOP)

    def _turn(self, at: np.ndarray, colour: str, sign: float = 1.0) -> None:
        """Draw an arrow that turns about a marker."""
        r = 1.3 * SYMBOL * self.span
        first, last = (30.0, 300.0)
        self.axis.add_patch(Arc(at, 2 * r, 2 * r, theta1=first, theta2=last, color=colour, lw=1.6, zorder=7))
        end = np.radians(last if sign > 0 else first)
        tip = at + r * np.array([np.cos(end), np.sin(end)])
        ahead = sign * np.array([-np.sin(end), np.cos(end)])
        self._arrow(tip - 0.01 * r * ahead, tip + 0.3 * r * ahead, colour)

    def _arrow(self, start: np.ndarray, end: np.ndarray, colour: str) -> None:
        style = dict(arrowstyle="-|>", color=colour, lw=1.6, shrinkA=0, shrinkB=0, mutation_scale=12)
        self.axis.annotate("", xy=end, xytext=start, arrowprops=style, zorder=7)

    def _drive(self, drive: dict) -> None:
        """Draw a drive at its marker a."""
        at = np.array(drive["a"]["at"])
        if drive["kind"] == "rotation":
            self._turn(at, DRIVE)
        else:
            angle = drive["direction"]
            self._arrow(at, at + 3.0 * SYMBOL * self.span * np.array([np.cos(angle), np.sin(angle)]), DRIVE)
        self._label(at, f"{drive['name']} (drive)", DRIVE)

    def _force(self, force: dict) -> None:
        """Draw a force as an arrow that ends at its marker, a torque as one that turns."""
        at = np.array(force["at"]["at"])
        if force["kind"] == "force":
            vector = np.array(force["force"])
            frames = {body["name"]: body["frame"][2] for body in self.scene["bodies"]}
            angle = 0.0 if force["axes"] == "global" else frames[force["at"]["body"]]
            c, s = np.cos(angle), np.sin(angle)
            vector = np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])
            self._arrow(at - 4.0 * SYMBOL * self.span * vector / (np.hypot(*vector) or 1.0), at, FORCE)
        else:
            self._turn(np.array(force["centre"]) if force["kind"] == "torque_about" else at, FORCE, np.sign(force["moment"]) or 1.0)
        self._label(at, f"{force['name']} ({force['kind'].replace('_', ' ')})", FORCE)

    def _gravity(self) -> None:
        """Draw gravity in the corner."""
        gravity = np.array(self.scene["gravity"])
        size = np.hypot(*gravity)
        if size > 0.0:
            start, style = np.array([0.95, 0.95]), dict(arrowstyle="-|>", color=GREY, lw=1.4)
            self.axis.annotate("", start + 0.09 * gravity / size, start, "axes fraction", "axes fraction", arrowprops=style)
            look = dict(ha="right", va="top", color=GREY, fontsize=8, transform=self.axis.transAxes)
            self.axis.text(0.935, 0.95, f"g {size:.3g} m/s²", **look)

    def _key(self) -> None:
        """Say which colour stands for what, of the kinds that are there."""
        kinds = {"joints": ("o", DARK), "drives": (r"$\circlearrowleft$", DRIVE), "forces": (r"$\rightarrow$", FORCE)}
        kinds |= {"springs": (r"$\sim$", SPRING), "stops": ("|", STOP), "sensors": ("D", SENSOR)}
        shown = {kind: look for kind, look in kinds.items() if self.scene.get(kind)}
        look = dict(color="white", ls="none", ms=7)
        lines = [Line2D([], [], marker=marker, mec=colour, label=kind, **look) for kind, (marker, colour) in shown.items()]
        colours = [colour for _, colour in shown.values()]
        if lines:
            self.axis.figure.legend(handles=lines, loc="outside lower center", ncol=5, fontsize=8, labelcolor=colours)


def draw(figures: dict, title: str | None = None) -> Figure:
    """Return a figure of a summary's scene, titled as the deck where no title is given; HistoryError where it is damaged."""
    try:
        return _drawn(figures, title)
    except (AttributeError, IndexError, KeyError, TypeError, ValueError) as fault:
        raise HistoryError(f"summary.json: has no scene that can be drawn ({fault})") from None


def _drawn(figures: dict, title: str | None) -> Figure:
    """Return the figure; any exception where the figures are damaged."""
    scene, model = figures["scene"], figures["model"]
    if title is None:
        mobility = f", rigid mobility {figures['rigid_mobility']}" if figures.get("rigid_mobility") is not None else ""
        title = f"{figures['title'] or figures['deck']}\n{model['coordinates']} coordinates, "
        title += f"{model['dissipative_coordinates']} dissipative, {model['degrees_of_freedom']} degrees of freedom{mobility}"
    with mpl.rc_context(LOOK | {"axes.grid": False}):
        figure, axis = subplots(figsize=(8.0, 5.5))
        picture = ScenePicture(axis, scene)
        shape = (axis.get_ylim()[1] - axis.get_ylim()[0]) / (axis.get_xlim()[1] - axis.get_xlim()[0])
        figure.set_size_inches(8.0, float(np.clip(7.2 * shape + 1.2, 3.0, 9.0)))
        picture.draw()
        axis.set_title("\n".join(filter(None, [title, axis.get_title()])), fontsize=9)
        labels.write(axis, picture.labels)  # once everything else stands where it stays
    return figure


def work(args: argparse.Namespace) -> int:
    """Draw and say which files were written; raises HistoryError."""
    figures = figures_of(args.source, args.biela)
    folder = args.source if args.source.is_dir() else Path("results") / figures["deck"]
    path = save(draw(figures), args.output or folder / "scene")
    print(f"wrote {path}")
    return 0
