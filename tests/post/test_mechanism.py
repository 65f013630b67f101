"""What a picture shows of a mechanism, from the motion and the deck: outlines, places, traces, and decks of other scenes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from biela import animate, mechanism
from biela.histories import History, HistoryError
from biela.mechanism import Mechanism, add_text, add_trace, from_motion

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


def test_a_beam_of_one_element_is_a_line():
    scene = motion(rod=[[0.0, 0.0], [2.0, 0.0]])
    np.testing.assert_allclose(scene.outline(scene.bodies["rod"], 4), [[0.0, 0.0], [0.0, 2.0]], atol=1e-15)


@pytest.mark.parametrize("kind", ["frame", "FRAME"])
def test_a_frame_has_the_elements_of_its_deck(kind):
    scene = motion(l=[[0.0, 0.0], [1.0, 0.0], [1.0, 2.0]])
    add_text(scene, f"&body name='L' kind='{kind}' node_x=0,1,1 node_y=0,0,2 element_nodes=1,2,2,3 /", Path("deck.nml"))
    assert scene.bodies["l"].elements == [(0, 1), (1, 2)]
    line = scene.outline(scene.bodies["l"], 4)
    np.testing.assert_allclose(line[[0, 1, 3, 4]], [[0.0, 0.0], [0.0, 1.0], [0.0, 1.0], [-2.0, 1.0]], atol=1e-15)


@pytest.mark.parametrize(
    ("name", "path"),
    [("rod", [0.0, 0.0]), ("ROD.2", [0.0, 1.0]), ("Tip", [-0.5, 2.0]), ("hub", [0.0, 0.0])],
)
def test_the_path_of_a_frame_a_node_or_a_sensor(name, path):
    scene = motion(rod=[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]], hub=[])
    add_text(scene, "&sensor name='tip' quantity='position' body='rod' point=2.0,0.5 /", Path("deck.nml"))
    add_trace(scene, name)
    assert scene.traces[0].shape == (5, 2)
    np.testing.assert_allclose(scene.traces[0][-1], path, atol=1e-15)


@pytest.mark.parametrize("name", ["rod.4", "rod.0", "rod.x", "hub.1", "tip"])
def test_a_place_that_is_not_there_is_told_with_those_that_are(name):
    scene = motion(rod=[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]], hub=[])
    with pytest.raises(HistoryError) as fault:
        add_trace(scene, name)
    assert str(fault.value) == f"no place '{name}' to trace; there are rod.1, hub"


def test_a_spring_and_a_joint_of_bodies_that_are_not_drawn_are_left_out():
    scene = motion(rod=[[0.0, 0.0], [2.0, 0.0]])
    joints = "&joint type='revolute' body_a='rod' body_b='other' /\n&joint type='revolute' body_a='rod' node_a=-1 /\n"
    add_text(scene, joints + "&spring name='c' type='torsional' body_a='rod' /", Path("deck.nml"))
    assert (len(scene.pins), scene.springs, scene.links) == (1, [], [])


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("&body name='rod'", "End-of-file reached before end of namelist."),
        ("&body kind='rigid' /", "'name'"),
        ("&body name='other' kind='rigid' /", "its body 'other' is not in the motion file"),
        ("&body name='rod' kind='beam' length='long' /", "could not convert string to float: 'long'"),
        ("&body name='l' kind='frame' node_x=0,1 node_y=0,0 element_nodes=1,2 /", "its body 'l' has 2 nodes, 3 in the motion file"),
        ("&sensor name='s' body='rod' node=5 /", "its body 'rod' has 2 nodes in the motion file, no node 5"),
        ("&joint name='j' type='revolute' body_a='rod' node_a=-3 /", "its body 'rod' has 2 nodes in the motion file, no node -3"),
    ],
)
def test_the_deck_of_another_scene_is_refused(text, told):
    scene = motion(rod=[[0.0, 0.0], [2.0, 0.0]], l=[[0.0, 0.0], [1.0, 0.0], [1.0, 2.0]])
    with pytest.raises(HistoryError) as fault:
        add_text(scene, text, Path("deck.nml"))
    assert str(fault.value) == f"deck.nml: is no deck of these results ({told})"


def test_panels_that_a_sheet_does_not_need_are_empty():
    scene = motion(rod=[[0.0, 0.0], [2.0, 0.0]])
    count = next(n for n in range(2, 9) if np.prod(animate.tiles(n, *scene.extent())[:2]) > n)
    figure = animate.sheet(scene, count, "deflections × 3")
    assert [axis.axison for axis in figure.axes] == [True] * count + [False] * (len(figure.axes) - count)
    assert len(figure.axes) > count
    assert figure.get_suptitle() == "deflections × 3"
    assert figure.axes[count - 1].texts[-1].get_text() == "t = 1 s"
    animate.plt.close(figure)


def test_a_film_that_cannot_be_written_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(animate, "film", lambda *_: pytest.fail("nothing is drawn before the folder is there"))
    (tmp_path / "file").write_text("")
    with pytest.raises(HistoryError, match=r"file/film: cannot be written \(.*\)$"):
        animate.write(motion(rod=[[0.0, 0.0], [2.0, 0.0]]), tmp_path / "file" / "film", 3, 1.0, 2, "", False)


def test_a_motion_file_has_frames():
    with pytest.raises(HistoryError, match=r"has no body frames"):
        mechanism.from_motion(History(Path("history.txt"), ["t"], {"t": "s"}, np.zeros((2, 1))))
