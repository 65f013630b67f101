"""Assembly moves bodies as little as possible: turns count as much as displacements of the scene's size; so with velocities."""

from __future__ import annotations

import json
import math
import re

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


def least(mass, rows, gap):
    """Return the change with the least x M x that changes the rows by the gap, as far as they can follow."""
    if not len(mass):
        return np.zeros(0)
    half = np.linalg.inv(np.linalg.cholesky(mass)).T
    return half @ (np.linalg.pinv(rows @ half, rcond=1e-10) @ gap)


def closed_velocities(mass, rows, start, stated):
    """Return what velocity closing promises: stated ones kept, or changed least; then the others change least."""
    free = ~stated
    v = start.copy()
    v[free] += least(mass[np.ix_(free, free)], rows[:, free], -rows @ v)
    if np.abs(rows @ v).max() > 1e-9 * np.abs(start).max():
        u, s, _ = np.linalg.svd(rows[:, free])
        beyond = u[:, np.count_nonzero(s > 1e-10) :].T  # what the others cannot do
        v = start.copy()
        v[stated] += least(mass[np.ix_(stated, stated)], beyond @ rows[:, stated], -beyond @ rows @ v)
        v[free] += least(mass[np.ix_(free, free)], rows[:, free], -rows @ v)
    return v


@pytest.mark.parametrize("stated_of", ["0w", "1v", "1w2w", "2v", "0vw1v", "0v1vw2v", "0w1vw2vw", "0vw2vw"])
def test_velocities_of_a_chain_change_least_by_its_masses(run_deck, stated_of):
    """Mass centres stand off the origins; the first four sets of velocities fit the joints, the others contradict them."""
    rng = np.random.default_rng(len(stated_of))
    speed = (1e-6, 1e3)[len(stated_of) % 2]
    mass, rows, start, stated = np.zeros((9, 9)), np.zeros((6, 9)), np.zeros(9), np.zeros(9, bool)
    text, last = "", None
    for b in range(3):
        m, inertia, angle = 10 ** rng.uniform(-0.5, 0.5), 10 ** rng.uniform(-1, 0), rng.uniform(-3, 3)
        com, at, point = rng.uniform(-0.7, 0.7, (3, 2))
        i, arm = 3 * b, turned(com, angle)
        mass[i : i + 3, i : i + 3] = [[m, 0, -m * arm[1]], [0, m, m * arm[0]], [-m * arm[1], m * arm[0], inertia + m * arm @ arm]]
        text += f"&body name='b{b}' mass={m} inertia={inertia} com={com[0]},{com[1]} position={at[0]},{at[1]} angle={angle} "
        words = re.search(f"{b}(v?)(w?)", stated_of)
        if words and words[1]:
            start[i : i + 2], stated[i : i + 2] = speed * rng.uniform(-2, 2, 2), True
            text += f"velocity={start[i]},{start[i + 1]} "
        if words and words[2]:
            start[i + 2], stated[i + 2] = speed * rng.uniform(-3, 3), True
            text += f"angular_velocity={start[i + 2]} "
        arm = turned(point, angle)
        rows[2 * b : 2 * b + 2, i : i + 3] = [[1, 0, -arm[1]], [0, 1, arm[0]]]
        place, on = at + arm, ""
        if last:
            other = place - last[0]
            rows[2 * b : 2 * b + 2, i - 3 : i] = [[-1, 0, other[1]], [0, -1, -other[0]]]
            place, on = turned(other, -last[1]), f"body_b='b{b - 1}'"
        text += f"/\n&joint name='j{b}' type='revolute' body_a='b{b}' point_a={point[0]},{point[1]} {on} "
        text += f"point_b={place[0]},{place[1]} /\n&sensor name='v{b}' quantity='velocity' body='b{b}' /\n"
        text += f"&sensor name='w{b}' quantity='angular_velocity' body='b{b}' /\n"
        last = at, angle
    run = run_deck(text + f"&transient t_end={1e-6 / speed} step={1e-6 / speed} /\n")
    found = np.array([run.history[name][0] for b in range(3) for name in (f"v{b}.x", f"v{b}.y", f"w{b}")])
    expected = closed_velocities(mass, rows, start, stated)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * speed)
    words = r'body "b(\d)" contradicts the joints and was corrected by(?: (\S+) m/s)?(?: and)?(?: (\S+) rad/s)?'
    told = re.findall(words, run.stderr)
    change = np.where(stated, expected - start, 0.0).reshape(3, 3)
    assert len(told) == np.count_nonzero(np.abs(change).max(1) > 1e-6 * speed)
    assert bool(told) == (len(stated_of) > 4)
    for b, along, around in told:
        assert float(along or 0) == pytest.approx(np.hypot(*change[int(b), :2]), rel=0.06)
        assert float(around or 0) == pytest.approx(abs(change[int(b), 2]), rel=0.06)


@pytest.mark.parametrize("words", ["", "angular_velocity=0.7", "velocity=0.5,0.4"])
def test_a_beam_that_has_to_stretch_takes_the_least_rates_of_its_mass(run_deck, words):
    """Pinned at node 1, its end driven along its axis: frames alone cannot; rates of nodes by the textbook's consistent mass."""
    mu, length, angle, end, com = 1.2, 0.4, 0.3, (0.6, 0.02), np.array([0.1, -0.2])
    c, s = math.cos(angle), math.sin(angle)
    turn = np.kron(np.eye(2), [[c, s, 0], [-s, c, 0], [0, 0, 1]])
    element = np.zeros((6, 6))
    element[np.ix_([0, 3], [0, 3])] = mu * length / 6 * np.array([[2, 1], [1, 2]])
    bend = np.array([[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]])
    arms = np.diag([1.0, length, 1.0, length])
    element[np.ix_([1, 2, 4, 5], [1, 2, 4, 5])] = mu * length / 420 * arms @ bend @ arms
    mass, start = np.zeros((12, 12)), np.zeros(12)
    for n in (0, 3):
        mass[n : n + 6, n : n + 6] += turn.T @ element @ turn
    arm = turned(com, -0.5)
    mass[9:, 9:] = end[0] * np.array([[1, 0, -arm[1]], [0, 1, arm[0]], [-arm[1], arm[0], arm @ arm]]) + np.diag([0, 0, end[1]])
    rows = [*np.eye(12)[[0, 1, 9]], [*[0] * 9, -s, c, 0], *(np.eye(12)[6:9] - np.eye(12)[9:])]
    gap = [0.0, 0.0, 1.3, *[0.0] * 4]
    if "angular" in words:  # all of the body turns with its frame at first
        start[:9] = 0.7 * np.array([0, 0, 1, -s * length, c * length, 1, -s * 2 * length, c * 2 * length, 1])
        rows, gap = [*rows, np.eye(12)[2]], [*gap, 0.7]
    expected = start + least(mass, np.array(rows), gap - np.array(rows) @ start)
    run = run_deck(
        f"""&body name='apart' mass=1.0 inertia=1.0 position=5.0,5.0 /
&material name='m' density={mu * 1e3} young=1e6 /
&section name='s' area=1e-3 inertia=1e-7 /
&body name='b' kind='beam' length={2 * length} elements=2 material='m' section='s' reference='clamped' angle={angle} {words} /
&body name='c' mass={end[0]} inertia={end[1]} com={com[0]},{com[1]} position={2 * length * c!r},{2 * length * s!r} angle=-0.5 /
&joint name='p' type='revolute' body_a='b' node_a=1 /
&joint name='w' type='weld' body_a='c' body_b='b' node_b=3 /
&joint name='s' type='slider' body_a='c' direction={angle} /
&history name='h' kind='polynomial' coefficients={2 * length * c!r},1.3 /
&drive name='d' type='position' body_a='c' history='h' /
"""
        + "".join(f"&sensor name='v{n}' quantity='velocity' body='b' node={n} /\n" for n in (1, 2, 3))
        + "".join(f"&sensor name='w{n}' quantity='angular_velocity' body='b' node={n} /\n" for n in (1, 2, 3))
        + "&transient t_end=1e-7 step=1e-7 /\n"
    )
    found = [run.history[name][0] for n in (1, 2, 3) for name in (f"v{n}.x", f"v{n}.y", f"w{n}")]
    np.testing.assert_allclose(found, expected[:9], rtol=0, atol=1e-8)


def test_a_beam_that_its_frame_can_move_keeps_its_shape(run_deck):
    """Pinned at node 1, started otherwise: the pin takes m v, and what turns about the pin keeps its moment of momentum."""
    length, angle, v, w = 0.8, 0.3, (0.5, 0.4), 0.7
    run = run_deck(
        f"""&material name='m' density=1200 young=1e6 /
&section name='s' area=1e-3 inertia=1e-7 /
&body name='b' kind='beam' length={length} elements=3 material='m' section='s' reference='clamped' angle={angle}
  velocity={v[0]},{v[1]} angular_velocity={w} /
&joint name='p' type='revolute' body_a='b' node_a=1 /
&transient t_end=1e-7 step=1e-7 /
"""
        + "".join(f"&sensor name='w{n}' quantity='angular_velocity' body='b' node={n} /\n" for n in (1, 2, 3, 4))
    )
    turning = w + 1.5 / length * (v[1] * math.cos(angle) - v[0] * math.sin(angle))
    assert [run.history[f"w{n}"][0] for n in (1, 2, 3, 4)] == pytest.approx([turning] * 4, rel=1e-9)
