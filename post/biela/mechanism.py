"""What a picture of a mechanism shows: the places of motion.txt, joined as the deck says.

motion.txt holds the frame of every body (`NAME.x NAME.y NAME.angle`) and its nodes (`NAME.1.x NAME.1.y ...`). The deck, where
it is given, adds what has no coordinates of its own: rigid bodies' joint places, massless links, springs, slider lines, ground.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import f90nml
import numpy as np
from scipy.interpolate import CubicSpline

from .deck_text import DeckError
from .deck_text import read as read_deck
from .histories import History
from .result_files import HistoryError

NODE = re.compile(r"(?P<body>.+)\.(?P<node>\d+)\.x")
PER_ELEMENT = 8


@dataclass
class Body:
    """One body over time.

    Attributes:
        frame: x, y, angle of its frame [m, m, rad], shape (rows, 3)
        local: its nodes in its own axes [m], shape (rows, nodes, 2); no nodes on a plain rigid body
        rest: the undeformed nodes in its axes [m], shape (nodes, 2)
        elements: pairs of node indices from 0; None: a straight beam, drawn as a smooth curve
        places: points of a rigid body that its joints, loads and sensors name [m], in its axes
    """

    frame: np.ndarray
    local: np.ndarray
    rest: np.ndarray
    elements: list[tuple[int, int]] | None = None
    places: list[np.ndarray] = field(default_factory=list)

    def to_global(self, row: int, points: np.ndarray) -> np.ndarray:
        """Return points given in body axes, shape (n, 2) [m], in global axes."""
        x, y, angle = self.frame[row]
        c, s = np.cos(angle), np.sin(angle)
        return np.array([x, y]) + points @ np.array([[c, s], [-s, c]])


@dataclass
class Place:
    """A node or point of a body, or a fixed point of the ground (body None)."""

    body: Body | None
    node: int | None
    point: np.ndarray


@dataclass
class Mechanism:
    """Bodies and sensors' places by name in lower case, massless links and springs as pairs of places, slider lines, pins, lumps.

    Traces are paths that are drawn whole, each of shape (rows, 2) [m].
    """

    time: np.ndarray
    bodies: dict[str, Body]
    exaggerate: float = 1.0
    links: list[tuple[Place, Place]] = field(default_factory=list)
    springs: list[tuple[Place, Place]] = field(default_factory=list)
    sliders: list[tuple[Place, Place, float]] = field(default_factory=list)
    pins: list[Place] = field(default_factory=list)
    lumps: list[Place] = field(default_factory=list)
    sensors: dict[str, Place] = field(default_factory=dict)
    traces: list[np.ndarray] = field(default_factory=list)

    def nodes(self, body: Body, row: int) -> np.ndarray:
        """Return a body's nodes in its axes with the deflections exaggerated, shape (nodes, 2) [m]."""
        return body.rest + self.exaggerate * (body.local[row] - body.rest)

    def at(self, place: Place, row: int) -> np.ndarray:
        """Return where a place is, shape (2,) [m]."""
        if place.body is None:
            return place.point
        if place.node is None:
            return place.body.to_global(row, place.point[None])[0]
        return place.body.to_global(row, self.nodes(place.body, row))[place.node]

    def outline(self, body: Body, row: int) -> np.ndarray:
        """Return the line to draw for a body, shape (n, 2) [m], NaN rows between separate pieces."""
        if not len(body.rest):
            return body.to_global(row, hull(np.array([np.zeros(2), *body.places])))
        nodes = self.nodes(body, row)
        if body.elements is not None:
            gap = np.full(2, np.nan)
            pieces = [point for i, j in body.elements for point in (nodes[i], nodes[j], gap)]
            return body.to_global(row, np.array(pieces))
        if len(nodes) < 3:
            return body.to_global(row, nodes)
        station = np.arange(len(nodes), dtype=float)
        fine = np.linspace(0.0, station[-1], PER_ELEMENT * (len(nodes) - 1) + 1)
        return body.to_global(row, CubicSpline(station, nodes, bc_type="natural")(fine))

    def extent(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the lower left and upper right corner of all that ever moves or is fixed [m]."""
        rows = range(0, len(self.time), max(1, len(self.time) // 100))
        points = [self.outline(body, row) for row in rows for body in self.bodies.values()]
        points += [self.at(place, 0)[None] for pair in self.links + self.springs for place in pair]
        points += [self.at(base, 0)[None] for _, base, _ in self.sliders]
        points += [self.at(place, 0)[None] for place in self.pins]
        everything = np.concatenate(points)
        return np.nanmin(everything, axis=0), np.nanmax(everything, axis=0)


def hull(points: np.ndarray) -> np.ndarray:
    """Return the closed convex outline of points, shape (n, 2); of points on one line, its ends."""
    ordered = sorted(set(map(tuple, points)))
    if len(ordered) < 3:
        return np.array(ordered)

    def half(sequence: list[tuple[float, float]]) -> list[tuple[float, float]]:
        chain: list[tuple[float, float]] = []
        for p in sequence:
            while len(chain) > 1:
                (ax, ay), (bx, by) = chain[-2], chain[-1]
                if (bx - ax) * (p[1] - ay) - (by - ay) * (p[0] - ax) > 0.0:
                    break
                chain.pop()
            chain.append(p)
        return chain

    return np.array(half(ordered) + half(ordered[::-1])[1:])


def from_motion(motion: History, exaggerate: float = 1.0) -> Mechanism:
    """Return the bodies of a motion file; what only the deck knows is missing.

    Raises:
        HistoryError: the columns are not those of a motion file.
    """
    bodies: dict[str, Body] = {}
    for name in (column[: -len(".angle")] for column in motion.names if column.endswith(".angle")):
        frame = np.column_stack([motion[f"{name}.{part}"] for part in ("x", "y", "angle")])
        ids = [m["node"] for m in map(NODE.fullmatch, motion.names) if m and m["body"] == name]
        nodes = np.array([[motion[f"{name}.{k}.x"], motion[f"{name}.{k}.y"]] for k in ids]).reshape(len(ids), 2, len(frame))
        gap = nodes.transpose(2, 0, 1) - frame[:, None, :2] if ids else np.zeros((len(frame), 0, 2))
        c, s = np.cos(frame[:, 2])[:, None], np.sin(frame[:, 2])[:, None]
        local = np.stack([c * gap[..., 0] + s * gap[..., 1], c * gap[..., 1] - s * gap[..., 0]], axis=-1)
        bodies[name.lower()] = Body(frame, local, local[0].copy())
    if not bodies:
        raise HistoryError(f"{motion.path}: has no body frames (columns NAME.x NAME.y NAME.angle): is it a motion.txt?")
    return Mechanism(motion.time, bodies, exaggerate)


def add_deck(scene: Mechanism, path: Path) -> None:
    """Add to a mechanism what its deck says about links, springs, sliders, pins and the places on rigid bodies.

    Raises:
        HistoryError: the deck cannot be read, or is of another scene.
    """
    try:
        text = read_deck(path).text
    except DeckError as fault:
        raise HistoryError(str(fault)) from None
    add_text(scene, text, path)


def add_text(scene: Mechanism, text: str, path: Path) -> None:
    """Add what the text of a deck says; path: where it comes from, for messages. Raises HistoryError as `add_deck`."""
    try:
        _add_groups(scene, f90nml.reads(text))
    except Exception as fault:
        raise HistoryError(f"{path}: is no deck of these results ({fault})") from None


def _add_groups(scene: Mechanism, groups: f90nml.Namelist) -> None:
    """Add what the groups of a deck say; any exception where they are not those of the scene."""
    for group in _all(groups, "body"):
        body = scene.bodies.get(str(group["name"]).lower())
        if body is None:
            raise ValueError(f"its body {group['name']!r} is not in the motion file")
        _shape(body, group)
    for kind in ("joint", "spring"):
        for group in _all(groups, kind):
            _connection(scene, kind, group)
    for kind in ("force", "drive"):
        for group in _all(groups, kind):
            _place(scene, group, "")
            _place(scene, group, "_a")
    scene.lumps += [place for group in _all(groups, "lump") if (place := _place(scene, group, ""))]
    for group in _all(groups, "sensor"):
        place = _place(scene, group, "")
        if place:
            scene.sensors[str(group["name"]).lower()] = place


def add_trace(scene: Mechanism, name: str) -> None:
    """Let the path of a sensor's place, of a body's node (BODY.NODE) or of its frame (BODY) be drawn.

    Raises:
        HistoryError: there is no such place.
    """
    body, _, node = name.lower().rpartition(".")
    place = scene.sensors.get(name.lower())
    if place is None and name.lower() in scene.bodies:
        place = Place(scene.bodies[name.lower()], None, np.zeros(2))
    elif place is None and body in scene.bodies and node.isdecimal() and 0 < int(node) <= len(scene.bodies[body].rest):
        place = Place(scene.bodies[body], int(node) - 1, np.zeros(2))
    if place is None:
        known = ", ".join([*scene.sensors, *(f"{key}.1" if len(b.rest) else key for key, b in scene.bodies.items())])
        raise HistoryError(f"no place {name!r} to trace; there are {known}")
    scene.traces.append(np.array([scene.at(place, row) for row in range(len(scene.time))]))


def _all(groups: f90nml.Namelist, kind: str) -> list[f90nml.Namelist]:
    """Return all groups of one kind."""
    found = groups.get(kind, [])
    return found if isinstance(found, list) else [found]


def _list(value: object) -> list:
    return value if isinstance(value, list) else [value]


def _shape(body: Body, group: f90nml.Namelist) -> None:
    """Take the undeformed nodes and the elements of a beam or frame from its group."""
    count, kind = len(body.rest), str(group.get("kind")).lower()
    if kind == "frame" and count:
        rest = np.column_stack([_list(group["node_x"]), _list(group["node_y"])]).astype(float)
        if len(rest) != count:
            raise ValueError(f"its body {group['name']!r} has {len(rest)} nodes, {count} in the motion file")
        body.rest = rest
        ends = _list(group["element_nodes"])
        body.elements = [(int(i) - 1, int(j) - 1) for i, j in zip(ends[::2], ends[1::2])]
    elif kind == "beam" and count:
        body.rest = np.column_stack([np.linspace(0.0, float(group["length"]), count), np.zeros(count)])


def _place(scene: Mechanism, group: f90nml.Namelist, side: str) -> Place | None:
    """Return the place that a group names with body/node/point (side '', '_a' or '_b'), and note it on a rigid body."""
    name = str(group.get(f"body{side}", "ground" if side == "_b" else "")).lower()
    point = np.array(_list(group.get(f"point{side}", [0.0, 0.0])), dtype=float)
    if name == "ground":
        return Place(None, None, point)
    body = scene.bodies.get(name)
    if body is None:
        return None
    node = group.get(f"node{side}")
    if node and len(body.rest):
        if not 0 < abs(node) <= len(body.rest):
            raise ValueError(f"its body {name!r} has {len(body.rest)} nodes in the motion file, no node {node}")
        return Place(body, int(node) - 1 if node > 0 else int(node), point)
    if f"point{side}" in group:
        body.places.append(point)
    return Place(body, None, point)


def _connection(scene: Mechanism, kind: str, group: f90nml.Namelist) -> None:
    """Add one joint or spring to what is drawn."""
    a, b = _place(scene, group, "_a"), _place(scene, group, "_b")
    if a is None or b is None:
        return
    word = str(group.get("type", "")).lower()
    if kind == "spring":
        if word == "linear":
            scene.springs.append((a, b))
    elif word == "distance":
        scene.links.append((a, b))
        scene.pins += [a, b]
    elif word in ("slider", "prismatic"):
        scene.sliders.append((a, b, float(group.get("direction", 0.0))))
    else:
        scene.pins.append(b)
