"""What a picture shows of a mechanism, from motion and assembled scene: outlines, places, traces, and scenes of other runs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from biela import animate, mechanism
from biela.histories import History, HistoryError
from biela.mechanism import Body, Marker, Mechanism, Stop, add_scene, add_trace, from_motion
from scipy.interpolate import CubicSpline

TIME = np.linspace(0.0, 1.0, 5)


def motion(**nodes: list[list[float]]) -> Mechanism:
    """Return bodies that turn by a right angle in all, with nodes at rest in their axes."""
    names, columns = ["t"], [TIME]
    angle = 0.5 * np.pi * TIME
    for body, points in nodes.items():
        names += [f"{body}.x", f"{body}.y", f"{body}.angle"]
        columns += [0.0 * TIME, 0.0 * TIME, angle]
        for k, (x, y) in enumerate(points, 1):
            names += [f"{body}.{k}.x", f"{body}.{k}.y"]
            columns += [x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle)]
    return from_motion(History(Path("motion.txt"), names, dict.fromkeys(names, ""), np.column_stack(columns)))


QUARTER = 0.5 * np.pi  # by which the assembled scene is turned here, so that nothing is right by chance


def turned(body: str | None, node: int, x: float, y: float) -> dict:
    """Return a place of the assembled scene, given in body axes; all frames lie at (1, 2)."""
    return {"body": body, "node": node, "at": [1.0 - y, 2.0 + x] if body else [x, y]}


def item(name: str, kind: str, nodes: list[list[float]], elements: list[list[int]] | None = None) -> dict:
    """Return a body of the assembled scene."""
    at = [turned(name, 0, *node)["at"] for node in nodes]
    return {"name": name, "kind": kind, "frame": [1.0, 2.0, QUARTER], "nodes": at, "elements": elements or []}


def assembled(*bodies: dict, **items: list[dict]) -> dict:
    """Return the figures of a summary with an assembled scene."""
    empty = {kind: [] for kind in ("joints", "drives", "springs", "forces", "sensors")}
    return {"scene": {"bodies": list(bodies), **empty, **items}}


FILE = Path("summary.json")


def test_a_beam_of_one_element_is_a_line():
    scene = motion(rod=[[0.0, 0.0], [2.0, 0.0]])
    np.testing.assert_allclose(scene.outline(scene.bodies["rod"], 4), [[0.0, 0.0], [0.0, 2.0]], atol=1e-15)


def test_a_frame_has_the_elements_and_the_undeformed_nodes_of_the_scene():
    scene = motion(l=[[0.0, 0.0], [1.0, 0.0], [1.0, 2.0]])
    bent = [[0.0, 0.0], [1.0, 0.0], [1.0, 2.5]]
    add_scene(scene, assembled(item("L", "frame", bent, [[1, 2], [2, 3]])), FILE)
    assert scene.bodies["l"].elements == [(0, 1), (1, 2)]
    np.testing.assert_allclose(scene.bodies["l"].rest, bent, atol=1e-15)
    line = scene.outline(scene.bodies["l"], 4)
    np.testing.assert_allclose(line[[0, 1, 3, 4]], [[0.0, 0.0], [0.0, 1.0], [0.0, 1.0], [-2.0, 1.0]], atol=1e-15)


@pytest.mark.parametrize("count", [3, 4, 9])
def test_a_beam_is_a_natural_cubic_spline(count):
    nodes = np.random.default_rng(count).normal(size=(count, 2))
    expected = CubicSpline(np.arange(count), nodes, bc_type="natural")(np.arange(8 * count - 7) / 8)
    np.testing.assert_allclose(mechanism.spline(nodes), expected, atol=1e-14)


@pytest.mark.parametrize(
    ("name", "path"),
    [("rod", [0.0, 0.0]), ("ROD.2", [0.0, 1.0]), ("Tip", [-0.5, 2.0]), ("hub", [0.0, 0.0])],
)
def test_the_path_of_a_frame_a_node_or_a_sensor(name, path):
    scene = motion(rod=[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]], hub=[])
    sensors = [{"name": "Tip", "kind": "position", "at": turned("rod", 0, 2.0, 0.5)}]
    rod = item("rod", "beam", [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]])
    add_scene(scene, assembled(rod, item("hub", "rigid", []), sensors=sensors), FILE)
    add_trace(scene, name)
    assert scene.traces[0].shape == (33, 2), "a smooth curve through the rows"
    np.testing.assert_allclose(scene.traces[0][-1], path, atol=1e-15)


@pytest.mark.parametrize("name", ["rod.4", "rod.0", "rod.x", "hub.1", "tip"])
def test_a_place_that_is_not_there_is_told_with_those_that_are(name):
    scene = motion(rod=[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]], hub=[])
    with pytest.raises(HistoryError) as fault:
        add_trace(scene, name)
    assert str(fault.value) == f"no marker '{name}' to trace; there are rod.1, hub"


def test_a_line_of_a_slider_turns_with_its_body_and_torsional_springs_are_not_drawn():
    scene = motion(rod=[[0.0, 0.0], [2.0, 0.0]], hub=[])
    places = {"a": turned("rod", 2, 2.0, 0.0), "b": turned("hub", 0, 0.3, 0.1)}
    joint = {"name": "j", "kind": "prismatic", **places, "direction": QUARTER + 0.25}
    springs = [{"name": kind, "kind": kind, **places, "direction": 0.0} for kind in ("torsional", "linear")]
    bodies = [item("Rod", "beam", [[0.0, 0.0], [2.0, 0.0]]), item("hub", "rigid", [])]
    add_scene(scene, assembled(*bodies, joints=[joint], springs=springs), FILE)
    ((end, base, direction),) = scene.sliders
    assert (end.body, end.node, base.body) == (scene.bodies["rod"], 1, scene.bodies["hub"])
    assert direction == pytest.approx(0.25)
    np.testing.assert_allclose(base.point, [0.3, 0.1], atol=1e-15)
    assert (len(scene.springs), scene.links, scene.pins, scene.lumps) == (1, [], [], [])


@pytest.mark.parametrize(
    ("figures", "told"),
    [
        ({}, "'scene'"),
        ({"scene": {}}, "'bodies'"),
        (assembled({"kind": "rigid"}), "'name'"),
        (assembled(item("other", "rigid", [])), "its body 'other' is not in the motion"),
        (assembled(item("rod", "beam", [[0.0, 0.0]])), "its body 'rod' has 1 nodes, 2 in the motion"),
        (assembled(sensors=[{"name": "s", "at": turned(None, 0, "x", 0.0)}]), "could not convert string to float: 'x'"),
        (assembled(lumps=[{"at": {"body": "rod", "node": 0, "at": [0.0, 0.0]}}]), "'rod'"),
    ],
)
def test_the_scene_of_another_run_is_refused(figures, told):
    scene = motion(rod=[[0.0, 0.0], [2.0, 0.0]])
    with pytest.raises(HistoryError) as fault:
        add_scene(scene, figures, FILE)
    assert str(fault.value) == f"summary.json: has no scene of this motion ({told})"


def test_panels_that_a_sheet_does_not_need_are_empty():
    scene = motion(rod=[[0.0, 0.0], [2.0, 0.0]])
    count = next(n for n in range(2, 9) if np.prod(animate.tiles(n, *scene.extent())[:2]) > n)
    figure = animate.sheet(scene, count, "deflections × 3")
    assert [axis.axison for axis in figure.axes] == [True] * count + [False] * (len(figure.axes) - count)
    assert len(figure.axes) > count
    assert figure.get_suptitle() == "deflections × 3"
    assert figure.axes[count - 1].texts[-1].get_text() == "t = 1 s"


def test_a_film_that_cannot_be_written_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(animate, "film", lambda *_: pytest.fail("nothing is drawn before the folder is there"))
    (tmp_path / "file").write_text("")
    with pytest.raises(HistoryError, match=r"file/film: cannot be written \(.*\)$"):
        animate.write(motion(rod=[[0.0, 0.0], [2.0, 0.0]]), tmp_path / "file" / "film", 3, 1.0, 2, "", False)


def test_a_motion_file_has_frames():
    with pytest.raises(HistoryError, match=r"has no body frames"):
        mechanism.from_motion(History(Path("history.txt"), ["t"], {"t": "s"}, np.zeros((2, 1))))


def test_a_contact_between_two_pictures_is_seen():
    """Twelve seconds, a blow from 4.2 s to 4.3 s: the next picture shows it."""
    time = np.arange(13.0)
    ball = Body(np.column_stack([np.abs(time - 4.2) + 0.1, 0.0 * time, 0.0 * time]), np.zeros((13, 0, 2)), np.zeros((0, 2)))
    stop = Stop(Marker(ball, None, np.zeros(2)), Marker(None, None, np.zeros(2)), 0.0, 0.0, None, struck=np.array([4.2, 4.3]))
    scene = Mechanism(time, {"ball": ball}, stops=[stop])
    picture = animate.Picture(animate.subplots()[1], scene)
    for since, row, touched in ((0, 4, False), (4, 8, True), (8, 12, False)):
        picture.show(row, since)
        assert (len(picture.touched[0].get_xdata()) > 0) is touched


def test_limits_of_an_angle_stand_about_the_joint_of_both_bodies():
    """Not about marker a, which may be anywhere on its body: the hinge is on the first joint of these two, on the body of a."""
    sides = [{"body": name, "at": k} for k, name in enumerate(("rod", None, "arm", "rod"))]
    joints = [{"kind": "revolute", "a": sides[0], "b": sides[1]}, {"kind": "revolute", "a": sides[2], "b": sides[3]}]
    at = [mechanism.hinge({"joints": joints}, {"a": a, "b": b})["at"] for a, b in ((sides[3], sides[2]), (sides[2], sides[1]))]
    assert at == [3, 2]


def test_walls_of_stops_stand_where_they_limit_and_tell_what_touches():
    """A wall 0.5 m along x of the turned body b, a hole of 0.1 m about the same point, the end of a turn by a radian."""
    plate = Body(np.array([[1.0, 2.0, QUARTER]]), np.zeros((1, 0, 2)), np.zeros((0, 2)))
    scene = Mechanism(np.zeros(1), {"plate": plate})
    base = Marker(plate, None, np.zeros(2))
    for y, touches in ((2.4, False), (2.5, True)):
        walls, found = Stop(Marker(None, None, np.array([1.3, y])), base, 0.0, None, 0.5).walls(scene, 0, 0.1)
        np.testing.assert_allclose(walls[0], [[1.4, 2.5], [1.2, 2.5]], atol=1e-15)
        assert found is touches
    circle, found = Stop(Marker(None, None, np.array([1.05, 2.0])), base, None, None, 0.1).walls(scene, 0, 0.1)
    np.testing.assert_allclose(np.hypot(*(circle[0] - [1.0, 2.0]).T), 0.1, rtol=1e-12)
    assert not found
    plate.points = [np.array([0.3, 0.0])]
    for upper, touches in ((1.0, True), (QUARTER, True), (QUARTER + 0.1, False)):
        stop = Stop(base, Marker(None, None, np.zeros(2)), None, None, upper, angular=True)
        walls, found = stop.walls(scene, 0, 0.1)
        np.testing.assert_allclose(walls[0][1] - [1.0, 2.0], [0.4 * np.cos(upper), 0.4 * np.sin(upper)], atol=1e-15)
        assert found is touches
    bent = Body(np.zeros((1, 3)), np.array([[[0.0, 0.0], [1.0, 0.0], [2.0, 0.1]]]), np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]))
    assert [Marker(bent, node, np.zeros(2)).angle(0) for node in (0, 2)] == pytest.approx([0.0, np.arctan(0.1)], abs=1e-15)
