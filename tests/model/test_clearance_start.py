"""Starts behind clearances: velocities run through pins held where they are; pins given nowhere are put into their holes."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

DECK = (Path(__file__).parents[2] / "input" / "clearance_slider_crank.nml").read_text(encoding="utf-8")
STATED = re.search(r"\n  velocity=.*", DECK)[0].removesuffix(" /")
TWO = """&body name='crank' kind='rigid' mass=1 inertia=0.01 {crank} /
&body name='rod' kind='{kind}' position={x},{y} angle={angle} {rod} /
&body name='rocker' kind='rigid' mass=0.5 inertia=0.02 com=0.1,0 angle={{pi/2}} position=0.5,0 {rocker} /
&material name='m' density=1200 young=2e8 /
&section name='s' area=4e-4 inertia=1.3e-8 /
&joint name='o' type='revolute' body_a='crank' /
&joint name='p' type='revolute' body_a='rocker' point_b=0.5,0 /
&history name='turn' coefficients=30 /
&drive name='motor' body_a='crank' history='turn' rate=.true. /
&stop name='a' type='clearance' body_a='rod' {first} body_b='crank' point_b=0.1,0 gap=1e-3 stiffness=1e8 restitution=0.8 /
&stop name='b' type='clearance' body_a='rod' {last} body_b='rocker' point_b=0.3,0 gap=1e-3 {law} /
&sensor name='a' quantity='velocity' body='rod' {first} body_b='crank' point_b=0.1,0 /
&sensor name='b' quantity='velocity' body='rod' {last} body_b='rocker' point_b=0.3,0 /
&sensor name='apart' quantity='distance' body='rod' {first} body_b='crank' point_b=0.1,0 /
&sensor name='beyond' quantity='distance' body='rod' {last} body_b='rocker' point_b=0.3,0 /
&sensor name='w' quantity='angular_velocity' body='rod' /
&sensor name='r' quantity='angular_velocity' body='rocker' /
&transient t_end=1e-6 method='rk4' step=1e-6 output_step=1e-6 accept_unstable=.true. /
"""
RIGID = {"kind": "rigid", "first": "point_a=0,0", "last": "point_a=0.5,0", "law": "stiffness=1e8 restitution=0.8"}
ROD = "mass=0.4 inertia=0.01 com=0.25,0"
BEAM = "length=0.5 elements=2 material='m' section='s'"


def first_row(run_deck, deck: str, **keys: str) -> dict:
    """Return the first row of a run of both clearances, by column."""
    text = TWO.format(**{**RIGID, "crank": "", "rocker": "", "rod": ROD, "x": 0.1, "y": 0, "angle": ANGLE, **keys})
    text = re.sub(r"(&sensor.*?)(point|node)_a=", r"\1\2=", text)
    run = run_deck(text, name=deck)
    assert ('angular_velocity of body "rod" would be' in run.stderr) == (deck in ("still", "turned"))
    return {name: run.history[name][0] for name in run.history.names[1:]}


ANGLE = np.arctan2(0.3, 0.4)  # the rod from (0.1, 0) to (0.5, 0.3)


def expected() -> tuple[float, float]:
    """Return the turning speeds of rod and rocker with both pins in the middle."""
    rod, rocker = np.array([-0.3, 0.4]), np.array([-0.3, 0.0])  # by a unit speed: pin b against pin a, pin b
    w = np.linalg.solve(np.array([rod, -rocker]).T, [0.0, -3.0])
    return w[0], w[1]


@pytest.mark.parametrize("body", ["rigid", "beam"])
def test_velocities_run_through_two_clearances(body, run_deck):
    keys = {} if body == "rigid" else {"kind": "beam", "rod": BEAM, "first": "node_a=1", "last": "node_a=-1"}
    row = first_row(run_deck, body, **keys)
    np.testing.assert_allclose([row["w"], row["r"]], expected(), rtol=1e-9)
    assert max(abs(row[c]) for c in ("a.x", "a.y", "b.x", "b.y")) < 1e-11


def test_pins_are_held_where_they_are(run_deck):
    """Off the middles of their holes, one at its wall."""
    row = first_row(run_deck, "off", x=0.1 - 0.6e-3, y=0.8e-3)
    np.testing.assert_allclose([row["apart"], row["beyond"]], 1e-3, rtol=1e-9)
    assert max(abs(row[c]) for c in ("a.x", "a.y", "b.x", "b.y")) < 1e-11


def test_a_deck_that_states_otherwise(run_deck):
    still = " velocity=0,0 angular_velocity=0"
    row = first_row(run_deck, "still", rod=ROD + still, rocker=still)
    np.testing.assert_allclose([row["w"], row["r"], row["a.y"]], [0, 0, -3], atol=1e-12)
    row = first_row(run_deck, "turned", rod=ROD + " angular_velocity=5")  # contradicts both pins: as without them
    np.testing.assert_allclose([row["w"], row["r"], row["a.y"]], [5, 0, -3], atol=1e-12)


def test_pins_given_nowhere_are_put_into_their_holes(run_deck):
    """The rod's position is not in the deck; a rigid stop, which refuses a start beyond it."""
    text = TWO.format(**{**RIGID, "crank": "", "rocker": "", "rod": ROD, "x": 7, "y": 7, "angle": 0.5, "law": "restitution=0.5"})
    text = re.sub(r"(&sensor.*?)(point|node)_a=", r"\1\2=", text)
    run = run_deck(text.replace("position=7,7 ", ""), name="nowhere")
    np.testing.assert_allclose([run.history["apart"][0], run.history["beyond"][0]], 0, atol=1e-12)
    assert max(abs(run.history[c][0]) for c in ("a.x", "a.y", "b.x", "b.y")) < 1e-11
    assert abs(run.history["w"][0]) > 1
    refused = run_deck(text, name="given", expect=2)
    assert 'stop "b"' in refused.stderr


def test_the_slider_crank_with_play_starts_as_it_runs(run_deck):
    """Without its velocities, and without positions: the events of the deck that states both."""
    deck = DECK.replace("t_end=0.02", "t_end=2e-3")
    lines = []
    for k, text in enumerate((deck, deck.replace(STATED, ""), re.sub(r" position=0\.(05|17),0\.0", "", deck.replace(STATED, "")))):
        run = run_deck(text, name=f"deck{k}")
        found = (run.folder / "events.txt").read_text(encoding="utf-8").splitlines()
        lines.append([float(line.split()[0]) for line in found if line[0] != "#"])
    assert len(lines[0]) > 2
    np.testing.assert_allclose(lines[1], lines[0], rtol=1e-9)
    np.testing.assert_allclose(lines[2], lines[0], rtol=1e-9)
