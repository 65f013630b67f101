"""What a picture shows of a mechanism: the bodies of motion.txt over time, joined as the solver assembled them (summary.json)."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .deck import groups_of
from .histories import History, read, read_events, read_summary
from .result_files import HistoryError

NODE = re.compile(r"(?P<body>.+)\.(?P<node>\d+)\.x")
PER_ELEMENT = 8
SMOOTH = 1000  # points that are a smooth line by themselves


@dataclass
class Body:
    """One body over time."""

    frame: np.ndarray  # x, y, angle of its frame [m, m, rad], shape (rows, 3)
    local: np.ndarray  # its nodes in its own axes [m], shape (rows, nodes, 2); no nodes on a plain rigid body
    rest: np.ndarray  # the undeformed nodes in its axes [m], shape (nodes, 2)
    elements: list[tuple[int, int]] | None = None  # pairs of node indices from 0; None: a straight beam, drawn as a smooth curve
    points: list[np.ndarray] = field(default_factory=list)  # of a rigid body, that joints, loads, sensors name [m], in its axes

    def to_global(self, row: int, points: np.ndarray) -> np.ndarray:
        """Return points given in body axes, shape (n, 2) [m], in global axes."""
        x, y, angle = self.frame[row]
        c, s = np.cos(angle), np.sin(angle)
        return np.array([x, y]) + points @ np.array([[c, s], [-s, c]])


@dataclass
class Marker:
    """A node or point of a body, or a fixed point of the ground (body None)."""

    body: Body | None
    node: int | None
    point: np.ndarray

    def angle(self, row: int) -> float:
        """Return the angle of the section there [rad]; that of a node is the turn of an element that ends in it."""
        if self.body is None:
            return 0.0
        angle = self.body.frame[row, 2]
        if self.node is not None:
            last = len(self.body.rest) - 1
            pairs = self.body.elements or [(min(self.node, last - 1), min(self.node, last - 1) + 1)]
            i, j = next(pair for pair in pairs if self.node in pair)
            rest, now = self.body.rest[j] - self.body.rest[i], self.body.local[row, j] - self.body.local[row, i]
            angle += np.arctan2(rest[0] * now[1] - rest[1] * now[0], rest @ now)
        return float(angle)


ON_LIMIT = 1e-9  # so near to its limit a stop is touched [m, rad]: digits of motion.txt


@dataclass
class Stop:
    """A stop that limits a position along a line through b, the distance from b, or an angle: None where there is no limit."""

    a: Marker
    b: Marker
    direction: float | None  # from the frame of b's body [rad]; None: a clearance or an angle
    lower: float | None
    upper: float | None
    angular: bool = False
    name: str = ""
    pivot: Marker | None = None  # where an angle turns, on the body of a; None: a
    struck: np.ndarray = field(default_factory=lambda: np.zeros(0))  # times of its events, at which it touches or lets go [s]

    def walls(self, scene: Mechanism, row: int, half: float) -> tuple[list[np.ndarray], bool]:
        """Return walls of half that length, each of shape (n, 2) [m], the nearest first, and whether a touches it."""
        a, b = scene.position(self.a, row), scene.position(self.b, row)
        limits = [limit for limit in (self.lower, self.upper) if limit is not None]
        if self.angular:
            x = self.a.angle(row) - self.b.angle(row)
            a = scene.position(self.pivot or self.a, row)
            arm = np.nanmean(scene.outline(self.a.body, row), axis=0) - a
            along = np.arctan2(arm[1], arm[0]) if np.hypot(*arm) > half else self.a.body.frame[row, 2]
            rays = [np.array([np.cos(along + limit - x), np.sin(along + limit - x)]) for limit in limits]
            walls = [np.array([a + half * ray, a + 4.0 * half * ray]) for ray in rays]
            return self.nearest_first(walls, x), self.beyond(x)
        if self.direction is None:
            turn = np.linspace(0.0, 2.0 * np.pi, 61)
            r = max(self.upper, 0.5 * half)
            return [b + r * np.transpose([np.cos(turn), np.sin(turn)])], self.beyond(np.hypot(*(a - b)))
        angle = self.direction + (self.b.body.frame[row, 2] if self.b.body else 0.0)
        along = np.array([np.cos(angle), np.sin(angle)])
        x = (a - b) @ along
        across = half * np.array([-along[1], along[0]])
        feet = [a + (limit - x) * along for limit in limits]
        return self.nearest_first([np.array([foot - across, foot + across]) for foot in feet], x), self.beyond(x)

    def nearest_first(self, walls: list[np.ndarray], x: float) -> list[np.ndarray]:
        """Return walls at the lower and upper limit in the order of their distances from the quantity."""
        return walls[::-1] if len(walls) == 2 and self.upper - x < x - self.lower else walls

    def beyond(self, x: float) -> bool:
        """Return whether a limit is reached."""
        below = self.lower is not None and x <= self.lower + ON_LIMIT
        return bool(below or (self.upper is not None and x >= self.upper - ON_LIMIT))


@dataclass
class Pair(Stop):
    """A joint or stop between a follower at a, a roller or a flat face, and a profile at b."""

    outline: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))  # of the profile, axes of section b [m]
    radius: float = 0.0  # of the roller [m]
    face: float | None = None  # angle of a face's normal from section a [rad]
    force: np.ndarray | None = None  # (rows) of the contact over its largest size [-]; None: not known

    def walls(self, scene: Mechanism, row: int, half: float) -> tuple[list[np.ndarray], bool]:
        """Return the follower and the profile, and whether they touch, as far as points tell."""
        a, profile = scene.position(self.a, row), self._profile(scene, row)
        place, normal = self.contact(scene, row)
        if self.face is None:
            turn = np.linspace(0.0, 2.0 * np.pi, 61)
            follower = a + self.radius * np.transpose([np.cos(turn), np.sin(turn)])
            gap = abs((a - place) @ normal - self.radius)
        else:
            along = np.diff(self.outline, axis=0)  # the face is wide enough for all places
            reach = np.abs((self.outline[:-1] * along).sum(axis=1) / np.hypot(*along.T)).max()
            across = (half + reach) * np.array([-normal[1], normal[0]])
            follower = np.array([a - across, a + across])
            gap = (a - place) @ normal
        return [follower, profile], bool(gap <= 0.05 * np.hypot(*np.diff(profile, axis=0).T).max())

    def contact(self, scene: Mechanism, row: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the place of the profile that is nearest to the follower [m], and the normal there, towards the follower."""
        a, profile = scene.position(self.a, row), self._profile(scene, row)
        if self.face is not None:
            angle = self.a.angle(row) + self.face
            normal = np.array([np.cos(angle), np.sin(angle)])
            return profile[np.argmax(profile @ normal)], normal
        along = np.diff(profile, axis=0)
        share = np.clip(((a - profile[:-1]) * along).sum(axis=1) / (along**2).sum(axis=1), 0.0, 1.0)
        feet = profile[:-1] + share[:, None] * along
        k = np.argmin(np.hypot(*(a - feet).T))
        arm = a - feet[k] if self.radius > 0.0 else np.array([along[k, 1], -along[k, 0]])
        return feet[k], arm / np.hypot(*arm)

    def pressed(self, scene: Mechanism, row: int, longest: float) -> np.ndarray:
        """Return the line of the force on the follower from where it touches, shape (2, 2) [m]; a pull goes the other way."""
        place, normal = self.contact(scene, row)
        return np.array([place, place + longest * (0.0 if self.force is None else self.force[row]) * normal])

    def _profile(self, scene: Mechanism, row: int) -> np.ndarray:
        c, s = np.cos(self.b.angle(row)), np.sin(self.b.angle(row))
        return scene.position(self.b, row) + self.outline @ np.array([[c, s], [-s, c]])


@dataclass
class Mechanism:
    """Bodies and sensors by names in lower case, links and springs (pairs), sliders, pins, lumps, paths (rows, 2) [m]."""

    time: np.ndarray
    bodies: dict[str, Body]
    exaggerate: float = 1.0
    links: list[tuple[Marker, Marker]] = field(default_factory=list)
    springs: list[tuple[Marker, Marker]] = field(default_factory=list)
    sliders: list[tuple[Marker, Marker, float]] = field(default_factory=list)
    pins: list[Marker] = field(default_factory=list)
    lumps: list[Marker] = field(default_factory=list)
    sensors: dict[str, Marker] = field(default_factory=dict)
    traces: list[np.ndarray] = field(default_factory=list)
    stops: list[Stop] = field(default_factory=list)

    def nodes(self, body: Body, row: int) -> np.ndarray:
        """Return a body's nodes in its axes with the deflections exaggerated, shape (nodes, 2) [m]."""
        return body.rest + self.exaggerate * (body.local[row] - body.rest)

    def position(self, marker: Marker, row: int) -> np.ndarray:
        """Return where a marker is, shape (2,) [m]."""
        if marker.body is None:
            return marker.point
        if marker.node is None:
            return marker.body.to_global(row, marker.point[None])[0]
        return marker.body.to_global(row, self.nodes(marker.body, row))[marker.node]

    def outline(self, body: Body, row: int) -> np.ndarray:
        """Return the line to draw for a body, shape (n, 2) [m], NaN rows between separate pieces."""
        if not len(body.rest):
            return body.to_global(row, hull(np.array([np.zeros(2), *body.points])))
        nodes = self.nodes(body, row)
        if body.elements is not None:
            gap = np.full(2, np.nan)
            pieces = [point for i, j in body.elements for point in (nodes[i], nodes[j], gap)]
            return body.to_global(row, np.array(pieces))
        if len(nodes) < 3:
            return body.to_global(row, nodes)
        return body.to_global(row, spline(nodes))

    def extent(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the lower left and upper right corner of all that ever moves or is fixed [m]."""
        rows = range(0, len(self.time), max(1, len(self.time) // 100))
        points = [self.outline(body, row) for row in rows for body in self.bodies.values()]
        markers = [*(marker for pair in self.links + self.springs for marker in pair), *(base for _, base, _ in self.sliders)]
        points += [self.position(marker, 0)[None] for marker in [*markers, *self.pins]]
        points += [wall for row in rows for pair in self.stops if isinstance(pair, Pair) for wall in pair.walls(self, row, 0.0)[0]]
        return np.nanmin(np.concatenate(points), axis=0), np.nanmax(np.concatenate(points), axis=0)


def spline(nodes: np.ndarray) -> np.ndarray:
    """Return points of the natural cubic spline through nodes, `PER_ELEMENT` an interval (scipy's takes long to load)."""
    ones = np.eye(len(nodes) - 2)
    second = np.zeros_like(nodes)
    shifted = np.eye(len(ones), k=1)
    second[1:-1] = np.linalg.solve(4.0 * ones + shifted + shifted.T, 6.0 * np.diff(nodes, 2, axis=0))
    second, points = second[:, None], nodes[:, None]
    right = (np.arange(PER_ELEMENT) / PER_ELEMENT)[:, None]
    left = 1.0 - right
    inner = left * points[:-1] + right * points[1:] + ((left**3 - left) * second[:-1] + (right**3 - right) * second[1:]) / 6.0
    return np.concatenate([inner.reshape(-1, 2), nodes[-1:]])


def hull(points: np.ndarray) -> np.ndarray:
    """Return the closed convex outline of points, shape (n, 2), that differ by more than a file's rounding; of a line, its ends."""
    extent = np.ptp(points, axis=0).max() or 1.0
    ordered = sorted({tuple(np.round(point / extent, 5)): complex(*point) for point in points}.items())
    if len(ordered) < 3:
        return np.array([[z.real, z.imag] for _, z in ordered])
    chain: list[complex] = []
    for sequence in (ordered, ordered[::-1]):  # below, then above
        first = len(chain)
        for _, z in sequence:
            while len(chain) > first + 1 and ((chain[-1] - chain[-2]).conjugate() * (z - chain[-2])).imag <= 0.0:
                chain.pop()
            chain.append(z)
        del chain[-1]
    return np.array([[z.real, z.imag] for z in [*chain, chain[0]]])


def from_motion(motion: History, exaggerate: float = 1.0) -> Mechanism:
    """Return the bodies of a motion file alone. HistoryError: the columns are not those of a motion file."""
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


def of_scene(scene: dict) -> Mechanism:
    """Return the mechanism of a summary's scene as assembled; any exception where that is damaged."""
    bodies = {}
    for item in scene["bodies"]:
        frame = np.array(item["frame"], dtype=float)
        local = to_local(frame, np.array(item["nodes"], dtype=float).reshape(-1, 2))
        bodies[item["name"].lower()] = Body(frame[None], local[None], local)
    mechanism = Mechanism(np.zeros(1), bodies)
    _add_items(mechanism, scene)
    return mechanism


def zigzag(a: np.ndarray, b: np.ndarray, width: float) -> np.ndarray:
    """Return the line of a spring between two points, shape (n, 2) [m]."""
    across = np.array([a[1] - b[1], b[0] - a[0]]) / (np.hypot(*(b - a)) or 1.0)
    part = np.array([0.0, 0.25, *np.linspace(0.28, 0.72, 12), 0.75, 1.0])
    swing = width * np.array([0.0, 0.0, *([1.0, -1.0] * 6), 0.0, 0.0])
    return a + part[:, None] * (b - a) + swing[:, None] * across


def from_run(motion: History, exaggerate: float = 1.0) -> Mechanism:
    """Return the mechanism of a motion with the scene of the summary.json beside it, if any; HistoryError: damaged."""
    mechanism = from_motion(motion, exaggerate)
    path = motion.path.parent / "summary.json"
    if path.is_file():
        add_scene(mechanism, read_summary(path.parent), path)
        events = read_events(path.parent)
        for stop in mechanism.stops:
            stop.struck = np.array([event.time for event in events if event.element.lower() == stop.name.lower()])
        _add_forces(mechanism, motion.path.parent)
    return mechanism


def _add_forces(mechanism: Mechanism, folder: Path) -> None:
    """Add the forces of the contacts that sensors show."""
    pairs = {pair.name.lower(): pair for pair in mechanism.stops if isinstance(pair, Pair)}
    groups = groups_of(read_summary(folder)["groups"]) if pairs else ()
    shown = {g.name: g.word("joint") or g.word("stop") for g in groups if g.kind == "sensor" and g.word("quantity") == "contact"}
    history = read(folder) if shown else None
    for column in history.names if history else ():
        name, _, part = column.rpartition(".")
        if part == "f" and (pair := pairs.get(shown.get(name.lower()) or "")):
            largest = np.abs(history[column]).max() or 1.0
            pair.force = np.interp(mechanism.time, history.time, history[column]) / largest


def add_scene(mechanism: Mechanism, figures: dict, path: Path) -> None:
    """Add to a mechanism what the scene of a summary says; HistoryError, with its path: damaged, or other bodies."""
    try:
        _add_items(mechanism, figures["scene"])
    except (AttributeError, KeyError, IndexError, TypeError, ValueError) as fault:
        raise HistoryError(f"{path}: has no scene of this motion ({fault})") from None


def _add_items(mechanism: Mechanism, scene: dict) -> None:
    """Add nodes, joints, springs, lumps and markers of sensors; any exception where the scene is not that of the motion."""
    frames = {}
    for item in scene["bodies"]:
        name = item["name"].lower()
        if name not in mechanism.bodies:
            raise ValueError(f"its body {item['name']!r} is not in the motion")
        body, frames[name] = mechanism.bodies[name], np.array(item["frame"], dtype=float)
        if len(item["nodes"]) != len(body.rest):
            raise ValueError(f"its body {item['name']!r} has {len(item['nodes'])} nodes, {len(body.rest)} in the motion")
        if len(body.rest):
            body.rest = to_local(frames[name], np.array(item["nodes"], dtype=float))
        if item["kind"].lower() == "frame":
            body.elements = [(i - 1, j - 1) for i, j in item["elements"]]

    def marker(item: dict) -> Marker:
        """Return where something acts; noted on a rigid body, whose outline contains it."""
        at = np.array(item["at"], dtype=float).reshape(2)
        if item["body"] is None:
            return Marker(None, None, at)
        body = mechanism.bodies[item["body"].lower()]
        if item["node"] > 0:
            return Marker(body, item["node"] - 1, np.zeros(2))
        point = to_local(frames[item["body"].lower()], at[None])[0]
        body.points.append(point)
        return Marker(body, None, point)

    outlines = {item["name"]: np.array(item["points"], dtype=float) for item in scene.get("profiles", [])}

    def pair(item: dict) -> Pair:
        """Return what a joint or stop of this kind shows."""
        a, b = marker(item["a"]), marker(item["b"])
        follower = {"outline": outlines[item["profile"]], "radius": item["radius"], "face": item["face"]}
        still = np.ones(1) if len(mechanism.time) == 1 else None  # of a scene that does not move: where a force would act
        return Pair(a, b, None, 0.0, None, name=item["name"], force=still, **follower)

    for joint in scene["joints"]:
        if joint["kind"] == "profile":
            mechanism.stops.append(pair(joint))
            continue
        a, b = marker(joint["a"]), marker(joint["b"])
        if joint["kind"] == "distance":
            mechanism.links.append((a, b))
            mechanism.pins += [a, b]
        elif joint["kind"] in ("slider", "prismatic"):
            turned = frames[joint["b"]["body"].lower()][2] if b.body else 0.0
            mechanism.sliders.append((a, b, joint["direction"] - turned))
        elif joint["kind"] != "gear":  # which joins angles, wherever its bodies are
            mechanism.pins.append(b)
    for spring in scene["springs"]:
        a, b = marker(spring["a"]), marker(spring["b"])
        if spring["kind"] == "linear":
            mechanism.springs.append((a, b))
    for stop in scene.get("stops", []):  # older runs do not tell them
        if stop["kind"] == "profile":
            mechanism.stops.append(pair(stop))
            continue
        a, b = marker(stop["a"]), marker(stop["b"])
        turned = frames[stop["b"]["body"].lower()][2] if b.body else 0.0
        direction = stop["direction"] - turned if stop["kind"] == "position" else None
        angular = stop["kind"] == "rotation"
        pivot = marker(hinge(scene, stop)) if angular else None
        mechanism.stops.append(Stop(a, b, direction, stop["lower"], stop["upper"], angular, stop["name"], pivot))
    for item in [*(drive["a"] for drive in scene["drives"]), *(force["at"] for force in scene["forces"])]:
        marker(item)
    mechanism.lumps += [marker(lump["at"]) for lump in scene.get("lumps", [])]  # older runs do not tell them
    mechanism.sensors |= {sensor["name"].lower(): marker(sensor["at"]) for sensor in scene["sensors"]}


def hinge(scene: dict, stop: dict) -> dict:
    """Return where the angle of a stop turns: the revolute joint of its two bodies, on the body of a; else its marker a."""
    a, b = stop["a"]["body"], stop["b"]["body"]
    for joint in scene["joints"]:
        if joint["kind"] == "revolute" and {joint["a"]["body"], joint["b"]["body"]} == {a, b}:
            return joint["a" if joint["a"]["body"] == a else "b"]
    return stop["a"]


def to_local(frame: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return points given in global axes, shape (n, 2) [m], in the axes of a frame (x, y, angle) [m, m, rad]."""
    c, s = np.cos(frame[2]), np.sin(frame[2])
    return (points - frame[:2]) @ np.array([[c, -s], [s, c]])


def add_trace(scene: Mechanism, name: str) -> None:
    """Let the path of a sensor's marker, a body's node (BODY.NODE) or its frame (BODY) be drawn; HistoryError: none."""
    body, _, node = name.lower().rpartition(".")
    marker = scene.sensors.get(name.lower())
    if marker is None and name.lower() in scene.bodies:
        marker = Marker(scene.bodies[name.lower()], None, np.zeros(2))
    elif marker is None and body in scene.bodies and node.isdecimal() and 0 < int(node) <= len(scene.bodies[body].rest):
        marker = Marker(scene.bodies[body], int(node) - 1, np.zeros(2))
    if marker is None:
        known = ", ".join([*scene.sensors, *(f"{key}.1" if len(b.rest) else key for key, b in scene.bodies.items())])
        raise HistoryError(f"no marker {name!r} to trace; there are {known}")
    path = np.array([scene.position(marker, row) for row in range(len(scene.time))])
    scene.traces.append(spline(path) if len(path) < SMOOTH else path)
