"""The assembled mechanism of a deck with its names."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Arc, Circle, Polygon

from . import labels
from .command import call_solver
from .histories import read_summary
from .mechanism import direction_of, hinge, hull
from .picture_files import save
from .plot import COLOURS, LOOK, body_look, plain_numbers
from .result_files import HistoryError

DARK, GREY = "#333333", "#8c8c8c"
DRIVE, FORCE, SPRING, SENSOR, STOP = COLOURS[1], COLOURS[4], COLOURS[2], "#9a5b00", "#b0126e"
SIGNS = {"revolute": "o", "weld": "s", "slider": "s", "prismatic": "s", "distance": "o", "gear": "h"}
SYMBOL = 0.035  # size of drawn arrows and springs, of the picture's larger side


def figures_of(source: Path, biela: Path) -> dict:
    """Return the figures of a results folder, or of a deck that the solver assembles.

    Raises:
        HistoryError: there is none, the deck is refused, or the solver is missing.
    """
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
    """A scene on one axis: lines first, then the labels, which need to know of each other."""

    def __init__(self, axis: plt.Axes, scene: dict):
        self.axis, self.scene = axis, scene
        self.labels: list[labels.Label] = []
        points = np.array([point for body in scene["bodies"] for point in [*body["nodes"], body["frame"][:2], body["centre"]]])
        items = [item for kind in ("joints", "springs", "stops") for item in scene.get(kind, [])]
        ends = [np.array(item[side]["at"]) for item in items for side in "ab"]
        points = np.array([*points, *ends, *(sensor["at"]["at"] for sensor in scene["sensors"])])
        low, high = points.min(axis=0), points.max(axis=0)
        side = max(high - low)  # a wall farther away than the mechanism is long would make it small
        found = [wall for stop in scene.get("stops", []) for wall in walls(stop)]
        points = np.array([*points, *(wall for wall in found if (low - side < wall).all() and (wall < high + side).all())])
        self.low, self.high = points.min(axis=0), points.max(axis=0)
        self.span = float(max(self.high - self.low)) or 1.0
        self.middle = (self.low + self.high) / 2.0
        room = np.maximum(0.16 * self.span, 0.3 * self.span - (self.high - self.low) / 2.0)
        axis.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
        plain_numbers(axis)
        axis.set_xlim(self.low[0] - 0.25 * self.span, self.high[0] + 0.25 * self.span)
        axis.set_ylim(self.low[1] - room[1], self.high[1] + room[1])

    def draw(self) -> None:
        """Draw everything, the names last."""
        for k, body in enumerate(self.scene["bodies"]):
            self._body(body, *body_look(k))
        for spring in self.scene["springs"]:
            self._spring(spring)
        for joint in self.scene["joints"]:
            self._joint(joint)
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

    def name_all(self) -> None:
        """Write the names, once everything else stands where it stays."""
        labels.write(self.axis, self.labels)

    def _label(self, at: np.ndarray, text: str, colour: str) -> None:
        self.labels.append(labels.Label(np.array(at), text, colour))

    def _body(self, body: dict, colour: str, style: object) -> None:
        """Draw the elements of a beam or frame; of a rigid body the outline of its frame, mass centre and markers."""
        nodes = np.array(body["nodes"])
        if len(nodes):
            for i, j in body["elements"]:
                self.axis.plot(*nodes[[i - 1, j - 1]].T, ls=style, color=colour, lw=2.4, zorder=3, solid_capstyle="round")
            self.axis.plot(*nodes.T, "o", color=colour, ms=3, zorder=4)
            first = np.array(body["elements"][len(body["elements"]) // 2]) - 1
            at = nodes[first].mean(axis=0)
        else:
            points = [body["frame"][:2], body["centre"], *self._points_of(body["name"])]
            outline = hull(np.array(points))
            if len(outline) > 3:
                self.axis.add_patch(Polygon(outline, facecolor=colour, alpha=0.15, zorder=2))
            self.axis.plot(*outline.T, ls=style, color=colour, lw=3.2, alpha=0.8, zorder=3, solid_capstyle="round")
            at = np.array(body["centre"])
            self.axis.plot(*at, "P", color=colour, ms=6, zorder=4)
        self._label(at, body["name"], colour)

    def _points_of(self, name: str) -> list:
        """Return where joints, springs and forces hold a body."""
        kinds = ("joints", "drives", "springs", "stops")
        found = [item[side] for kind in kinds for item in self.scene.get(kind, []) for side in "ab"]
        found += [force["at"] for force in self.scene["forces"]]
        return [marker["at"] for marker in found if marker["body"] == name]

    def _ground(self, at: np.ndarray) -> None:
        """Draw a hatched triangle under a marker of the ground."""
        s = 0.7 * SYMBOL * self.span
        self.axis.add_patch(
            Polygon(at + s * np.array([[0.0, 0.0], [-1.0, -1.5], [1.0, -1.5]]), facecolor="#eeeeee", edgecolor=GREY, zorder=1)
        )
        for k in range(-1, 3):
            foot = at + np.array([0.6 * k * s, -1.5 * s])
            self.axis.plot(*np.transpose([foot, foot - [0.5 * s, 0.5 * s]]), "-", color=GREY, lw=0.8, zorder=1)

    def _joint(self, joint: dict) -> None:
        """Draw a joint between its two markers."""
        a, b = (np.array(joint[side]["at"]) for side in "ab")
        kind = joint["kind"]
        if kind in ("slider", "prismatic"):
            angle = joint["direction"]
            along = 0.5 * self.span * np.array([np.cos(angle), np.sin(angle)])
            self.axis.plot(*np.transpose([a - along, a + along]), "--", color=GREY, lw=1.0, zorder=1)
        elif kind == "distance":
            self.axis.plot(*np.transpose([a, b]), "-", color=DARK, lw=1.6, zorder=2)
            self.axis.plot(*b, "o", color="white", mec=DARK, ms=6, mew=1.3, zorder=6)
        if joint["b"]["body"] is None and kind not in ("slider", "prismatic"):
            self._ground(b)
        face = DARK if kind == "weld" else "white"
        size = 10 if kind in ("slider", "prismatic") else 6
        self.axis.plot(*a, SIGNS[kind], color=face, mec=DARK, ms=size, mew=1.3, zorder=6)
        words = f"{kind}, friction {joint['friction']:g}" if "friction" in joint else kind
        self._label((a + b) / 2.0 if kind == "distance" else a, f"{joint['name']} ({words})", DARK)

    def _spring(self, spring: dict) -> None:
        """Draw a linear spring as a zigzag, a torsional one as a spiral."""
        a, b = (np.array(spring[side]["at"]) for side in "ab")
        if spring["kind"] == "torsional":
            turn = np.linspace(0.0, 5.0 * np.pi, 120)
            r = SYMBOL * self.span * turn / turn[-1]
            self.axis.plot(a[0] + r * np.cos(turn), a[1] + r * np.sin(turn), "-", color=SPRING, lw=1.2, zorder=5)
            self._label(a, spring["name"], SPRING)
            return
        side = np.array([a[1] - b[1], b[0] - a[0]]) / (np.hypot(*(b - a)) or 1.0)
        part = np.array([0.0, 0.25, *np.linspace(0.28, 0.72, 12), 0.75, 1.0])
        swing = 0.4 * SYMBOL * self.span * np.array([0.0, 0.0, *([1.0, -1.0] * 6), 0.0, 0.0])
        line = a + part[:, None] * (b - a) + swing[:, None] * side
        self.axis.plot(*line.T, "-", color=SPRING, lw=1.2, zorder=5)
        if spring["b"]["body"] is None:
            self._ground(b)
        self._label((a + b) / 2.0, spring["name"], SPRING)

    def _stop(self, stop: dict) -> None:
        """Draw a stop: a wall at each limit of a position, the hole of a clearance, the arc between the limits of an angle."""
        a, b = (np.array(stop[side]["at"]) for side in "ab")
        size = 1.2 * SYMBOL * self.span
        limits = [x for x in (stop["lower"], stop["upper"]) if x is not None]
        at = a
        if stop["kind"] == "clearance":
            r = max(stop["upper"], 0.5 * size)  # a gap that cannot be seen is drawn as a ring
            self.axis.add_patch(Circle(b, r, facecolor="none", edgecolor=STOP, lw=1.4, zorder=7))
        elif stop["kind"] == "position":
            across = size * np.array([-np.sin(stop["direction"]), np.cos(stop["direction"])])
            for at in walls(stop):
                self.axis.plot(*np.transpose([at - across, at + across]), "-", color=STOP, lw=2.2, zorder=7)
            ends = walls(stop) + ([a] if len(limits) == 1 else [])
            self.axis.plot(*np.transpose(ends), ":", color=STOP, lw=1.0, zorder=2)
        else:
            at = a = np.array(hinge(self.scene, stop)["at"])
            centre = {body["name"]: body["centre"] for body in self.scene["bodies"]}.get(stop["a"]["body"], a)
            turned = {body["name"]: body["frame"][2] for body in self.scene["bodies"]}
            turn, other = (turned.get(stop[side]["body"], 0.0) for side in "ab")
            arm = direction_of(np.array(centre) - a, turn, 0.1 * size)
            angles = [arm + limit - (turn - other) for limit in limits]
            for angle in angles:
                ray = np.array([np.cos(angle), np.sin(angle)])
                self.axis.plot(*np.transpose([a + 1.2 * size * ray, a + 1.8 * size * ray]), "-", color=STOP, lw=2.2, zorder=7)
            first, last = np.degrees([min(arm, *angles), max(arm, *angles)])
            last = min(last, first + 359.0)
            self.axis.add_patch(Arc(a, 3 * size, 3 * size, theta1=first, theta2=last, color=STOP, lw=1.4, zorder=7))
        unit = "rad" if stop["kind"] == "rotation" else "m"
        shown = {"clearance": "gap {1:.3g} m"}.get(stop["kind"], " to ".join(f"{x:.3g}" for x in limits) + f" {unit}")
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
            start, end = np.array([0.95, 0.95]) - 0.0, np.array([0.95, 0.95]) + 0.09 * gravity / size
            style = dict(arrowstyle="-|>", color=GREY, lw=1.4)
            self.axis.annotate("", end, start, "axes fraction", "axes fraction", arrowprops=style)
            text = f"g {size:.3g} m/s²"
            self.axis.text(0.935, 0.95, text, transform=self.axis.transAxes, ha="right", va="top", color=GREY, fontsize=8)

    def _key(self) -> None:
        """Say which colour stands for what, of the kinds that are there."""
        kinds = {"joints": ("o", DARK), "drives": (r"$\circlearrowleft$", DRIVE), "forces": (r"$\rightarrow$", FORCE)}
        kinds |= {"springs": (r"$\sim$", SPRING), "stops": ("|", STOP), "sensors": ("D", SENSOR)}
        lines = [
            self.axis.plot([], [], marker=marker, color="white", mec=colour, ls="none", ms=7, label=kind)[0]
            for kind, (marker, colour) in kinds.items()
            if self.scene.get(kind)
        ]
        if lines:
            found = self.axis.figure.legend(handles=lines, loc="outside lower center", ncol=5, fontsize=8)
            for text, line in zip(found.get_texts(), lines):
                text.set_color(line.get_markeredgecolor())


def draw(figures: dict, title: str | None = None) -> plt.Figure:
    """Return a figure of the scene of a summary.

    Args:
        figures: what summary.json or --check --json holds
        title: written above; left out: the deck's title and its coordinates

    Raises:
        HistoryError: they are damaged.
    """
    try:
        return _drawn(figures, title)
    except (AttributeError, IndexError, KeyError, TypeError, ValueError) as fault:
        raise HistoryError(f"summary.json: has no scene that can be drawn ({fault})") from None


def _drawn(figures: dict, title: str | None) -> plt.Figure:
    """Return the figure; any exception where the figures are damaged."""
    scene, model = figures["scene"], figures["model"]
    if title is None:
        mobility = f", rigid mobility {figures['rigid_mobility']}" if figures.get("rigid_mobility") is not None else ""
        title = f"{figures['title'] or figures['deck']}\n{model['coordinates']} coordinates, " + (
            f"{model['dissipative_coordinates']} dissipative, {model['degrees_of_freedom']} degrees of freedom{mobility}"
        )
    with plt.rc_context(LOOK | {"axes.grid": False}):
        figure, axis = plt.subplots(figsize=(8.0, 5.5), layout="constrained")
        picture = ScenePicture(axis, scene)
        shape = (axis.get_ylim()[1] - axis.get_ylim()[0]) / (axis.get_xlim()[1] - axis.get_xlim()[0])
        figure.set_size_inches(8.0, float(np.clip(7.2 * shape + 1.2, 3.0, 9.0)))
        picture.draw()
        axis.set_title(title, fontsize=9)
        picture.name_all()
    return figure


def work(args: argparse.Namespace) -> int:
    """Draw and say which files were written; raises HistoryError."""
    figures = figures_of(args.source, args.biela)
    folder = args.source if args.source.is_dir() else Path("results") / figures["deck"]
    path = save(draw(figures), args.output or folder / "scene")
    print(f"wrote {path}")
    return 0
