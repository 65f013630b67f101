"""Assembly moves bodies as little as possible: turns count as much as displacements of the scene's size; so with velocities."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

GAP = 1.0e-6
# position, angle, mass of each body; joints: body a, point, body b (None: ground), point; the gaps are what assembly closes
BODIES = [((0.0, 0.0), 0.3, 1.0), ((0.9, 0.4), -0.2, 30.0), ((1.8, 0.1), 1.1, 0.01)]
JOINTS = [(0, (0.0, 0.0), None), (1, (-0.1, 0.2), 0), (2, (0.3, 0.1), 1), (2, (-0.4, 0.0), None)]


def turned(point, angle):
    """Return a point of a body in global axes, from its origin."""
    x, y = point
    return np.array([x * math.cos(angle) - y * math.sin(angle), x * math.sin(angle) + y * math.cos(angle)])


def scene():
    """Return the deck, the joints' rows and their gaps."""
    text, rows, gaps = "", [], []
    for k, (at, angle, mass) in enumerate(BODIES):
        text += f"&body name='b{k}' mass={mass} inertia={mass} position={at[0]},{at[1]} angle={angle} /\n"
    for k, (a, point, b) in enumerate(JOINTS):
        gap = GAP * np.array([math.cos(k + 1.0), math.sin(3.0 * k)])
        row = np.zeros((2, 9))
        arm = turned(point, BODIES[a][1])
        place = np.array(BODIES[a][0]) + arm - gap
        row[:, 3 * a : 3 * a + 2] += np.eye(2)
        row[:, 3 * a + 2] += [-arm[1], arm[0]]
        other = place
        if b is not None:
            arm = place - BODIES[b][0]
            other = turned(arm, -BODIES[b][1])
            row[:, 3 * b : 3 * b + 2] -= np.eye(2)
            row[:, 3 * b + 2] -= [-arm[1], arm[0]]
        on = f"body_b='b{b}'" if b is not None else ""
        ends = f"point_a={point[0]},{point[1]} {on} point_b={float(other[0])!r},{float(other[1])!r}"
        text += f"&joint name='j{k}' type='revolute' body_a='b{a}' {ends} /\n"
        rows.append(row)
        gaps.append(gap)
    return text, np.vstack(rows), np.concatenate(gaps)


def test_gaps_are_closed_by_the_least_motion(run_deck):
    text, rows, gaps = scene()
    run = run_deck(text + "&transient t_end=1e-9 step=1e-9 motion_step=1e-9 /\n")
    size = json.loads((run.folder / "summary.json").read_text())["scene"]["size"]
    weights = np.tile([size, size, 1.0], 3)
    least = -weights * (np.linalg.pinv(rows * weights) @ gaps)
    moved = np.array([run.motion[f"b{k}.{part}"][0] for k in range(3) for part in ("x", "y", "angle")])
    moved -= np.concatenate([[*at, angle] for at, angle, _ in BODIES])
    assert np.abs(least).max() > 0.1 * GAP
    assert moved == pytest.approx(least, abs=1e-4 * GAP)


@pytest.mark.parametrize(
    ("held", "expected"),
    [
        ("&joint name='j' type='distance' body_a='r' length=1.0 /\n", [0.0, 2.0, 5.0]),
        ("&drive name='j' type='rotation' body_a='r' history='w' rate=.true. /\n", [1.0, 2.0, 3.0]),
    ],
)
def test_one_row_corrects_the_velocity_that_contradicts_it(held, expected, run_deck):
    run = run_deck(
        "&body name='r' mass=1.0 inertia=0.1 position=1.0,0.0 velocity=1.0,2.0 angular_velocity=5.0 /\n"
        f"&history name='w' kind='polynomial' coefficients=3.0 /\n{held}"
        "&sensor name='v' quantity='velocity' body='r' /\n&sensor name='w' quantity='angular_velocity' body='r' /\n"
        "&transient t_end=1e-3 step=1e-3 /\n"
    )
    assert [run.history[name][0] for name in ("v.x", "v.y", "w")] == pytest.approx(expected, abs=1e-12)
    assert 'velocity of body "r" contradicts the joints and was corrected' in run.stderr
