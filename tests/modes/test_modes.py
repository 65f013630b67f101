"""Bodies in modes: all of them are the nodal body, fewer converge, free ones leave the frame alone, GHM goes along."""

from __future__ import annotations

import re
import subprocess

import numpy as np
import pytest
from modal_bodies import (
    BEAM,
    FRAME,
    HEAD,
    LOADS,
    LUMPS,
    PIN,
    SCENES,
    SENSORS,
    TRANSIENT,
    text,
)


@pytest.mark.parametrize("name", SCENES)
def test_all_modes_are_the_nodal_body(run_deck, name):
    """Motion, section forces and reactions to 1e-9 of each column's range, under the same reference conditions."""
    body, more, number = SCENES[name]
    rest = PIN + LOADS + SENSORS + TRANSIENT.format(step=8.0e-6)
    nodal = run_deck(text(body, more, 0) + rest, name="nodal")
    modal = run_deck(text(body, more, number) + rest, name="modal")
    assert f"{number} modes of {number} nodal coordinates" in modal.summary
    for column in nodal.history.names[1:]:
        expected = nodal.history[column]
        scale = max(np.ptp(expected), np.abs(expected).max())
        if column.startswith("acc") or column.startswith("r.f"):
            scale = max(np.ptp(nodal.history[c]) for c in nodal.history.names if c.startswith(column.split(".")[0]))
        np.testing.assert_allclose(modal.history[column], expected, rtol=0, atol=1e-9 * scale + 1e-300, err_msg=column)
    for column in ("kinetic", "potential", "dissipated", "work"):
        expected = nodal.energy[column]
        np.testing.assert_allclose(modal.energy[column], expected, rtol=0, atol=1e-9 * max(np.abs(expected).max(), 1e-300))
    assert nodal.energy["dissipated"][-1] > 0.0  # the spring's GHM at least


class Linear:
    """Matrices of a scene at its assembled state, from the probe.

    Attributes:
        mass, stiffness: (nq, nq), SI
        rows: (rows, nq)
    """

    def __init__(self, probe, folder, deck):
        path = folder / "linear.nml"
        path.write_text(deck, encoding="utf-8")

        def call(word, states=""):
            done = subprocess.run([str(probe), word, str(path)], input=states, capture_output=True, text=True, check=False)
            assert done.returncode == 0, done.stderr
            return [line.split() for line in done.stdout.splitlines()]

        layout = call("layout")
        counts = {line[0]: int(line[1]) for line in layout if len(line) == 2}
        n, nz = counts["coordinates"], counts["dissipative"]
        q = next(line[1:] for line in layout if line[0] == "initial")
        state = " ".join(["0.0", *q, *["0.0"] * (n + 2 * nz)])
        answer = {line[0]: np.array(line[1:], dtype=float) for line in call("linear", state + "\n")}
        self.mass, self.stiffness = (answer[word].reshape(n, n, order="F") for word in ("mass", "stiffness"))
        self.rows = answer["rows"].reshape(-1, n, order="F") if answer["rows"].size else np.zeros((0, n))

    def frequencies(self) -> np.ndarray:
        """Return the undamped frequencies of the constrained scene, ascending [rad/s]."""
        if len(self.rows):
            _, s, vt = np.linalg.svd(self.rows)
            basis = vt[np.count_nonzero(s > 1e-10 * s[0]) :].T
        else:
            basis = np.eye(len(self.mass))
        mass, stiffness = (basis.T @ m @ basis for m in (self.mass, 0.5 * (self.stiffness + self.stiffness.T)))
        inverse = np.linalg.inv(np.linalg.cholesky(mass))
        return np.sqrt(np.maximum(np.linalg.eigvalsh(inverse @ stiffness @ inverse.T), 0.0))


PLAIN = HEAD.replace("gravity=1.0,-9.81", "")
BENDING = np.sqrt(2.0e9 * 0.02 * 0.01**3 / 12 / (1600.0 * 0.02 * 0.01)) / 0.8**2


@pytest.mark.parametrize(
    ("reference", "roots"),
    [
        ("clamped", [1.87510406871196, 4.69409113297417, 7.85475743823761]),
        ("pinned", [np.pi, 2 * np.pi, 3 * np.pi]),
        ("free", [4.73004074486270, 7.85320462409584, 10.995607838]),
    ],
)
@pytest.mark.parametrize("elements", [24, 90])
def test_frequencies_of_the_kept_modes(probe, tmp_path, reference, roots, elements):
    """Of a body by itself, in closed form; 90 elements go through the iteration for large bodies."""
    deck = PLAIN + BEAM.format(n=elements, more=f"reference='{reference}' axial=.false. modes=3")
    linear = Linear(probe, tmp_path, deck)
    stiffness = linear.stiffness[3:, 3:]
    error = np.sqrt(np.diag(stiffness)) / (np.array(roots) ** 2 * BENDING) - 1.0
    np.testing.assert_allclose(error, (np.array(roots) / elements) ** 4 / 1440, rtol=0.05, atol=1e-8)  # that of cubic elements
    np.testing.assert_allclose(stiffness - np.diag(np.diag(stiffness)), 0.0, rtol=0, atol=1e-8 * stiffness.max())
    np.testing.assert_allclose(linear.mass[3:, 3:], np.eye(3), rtol=0, atol=1e-9)


@pytest.mark.parametrize("body", [BEAM, FRAME], ids=["beam", "frame"])
@pytest.mark.parametrize("modes", [1, 3, 6])
def test_free_modes_leave_the_frame_alone(probe, tmp_path, body, modes):
    """S-bar = 0 and c0 = 0 to rounding, lumps included: the frame follows the mass centre and carries all momentum."""
    linear = Linear(probe, tmp_path, PLAIN + body.format(n=6, more=f"reference='free' modes={modes}") + LUMPS)
    mass = linear.mass
    scale = np.sqrt(np.outer(np.diag(mass), np.diag(mass)))
    assert np.abs(mass[:3, 3:] / scale[:3, 3:]).max() < 1e-12
    np.testing.assert_allclose(mass[3:, 3:], np.eye(modes), rtol=0, atol=1e-11)
    assert np.abs(linear.stiffness[:3, :]).max() < 1e-9 * np.abs(linear.stiffness).max()


def test_a_free_body_rings_without_moving(run_deck):
    """Pushed at both ends and in the middle with no resultant, a free body's frame stays where it is."""
    deck = PLAIN + BEAM.format(n=8, more="reference='free' modes=5").replace("angle=-0.3", "angle=0.0")
    for node, fy in ((1, 1.0), (-1, 1.0), (5, -2.0)):
        deck += f"&force name='f{node}' type='force' body='b' node={node} fy={fy} axes='body' /\n".replace("f-1", "fl")
    deck += "&sensor name='a' quantity='angle' body='b' /\n&sensor name='mid' quantity='deflection' body='b' node=5 /\n"
    deck += (
        "&sensor name='p' quantity='position' body='b' node=5 /\n&transient t_end=0.1 method='rk4' step=1.0e-4 motion_step=0.01 /\n"
    )
    run = run_deck(deck)
    assert np.abs(run.history["mid.v"]).max() > 1e-3
    np.testing.assert_allclose(run.history["a"], 0.0, rtol=0, atol=1e-13)
    for column in ("b.x", "b.y"):
        np.testing.assert_allclose(run.motion[column], run.motion[column][0], rtol=0, atol=1e-13)


def test_fewer_modes_converge_in_frequency(probe, tmp_path):
    """Modes of a clamped body hinged at both ends: frequencies fall to those of the nodal body, from above."""
    joints = PIN + "&joint name='e' type='slider' body_a='b' node_a=-1 direction=-0.3 /\n"
    found = []
    for modes in (3, 5, 9, 14, 0):
        deck = PLAIN + BEAM.format(n=12, more=f"reference='clamped' axial=.false. modes={modes}") + joints
        found.append(Linear(probe, tmp_path, deck).frequencies()[:2])
    exact = found.pop()
    np.testing.assert_allclose(exact, np.array([np.pi, 2 * np.pi]) ** 2 * BENDING, rtol=1e-4)
    errors = np.array(found) / exact - 1.0
    assert np.all(errors > -1e-10)
    assert np.all(np.diff(errors, axis=0) < 0.0)
    assert errors[-1, 0] < 2e-3


def test_fewer_modes_converge_in_deflection(run_deck):
    """A heavy pinned beam let go, hinged at one end and sliding on the other: the middle against the nodal body."""
    joints = PIN + "&joint name='e' type='slider' body_a='b' node_a=-1 direction=-0.3 /\n"
    sensor = "&sensor name='mid' quantity='deflection' body='b' node=5 /\n"
    curves = []
    for modes in (1, 3, 5, 0):
        more = f"element_material='one','one','one','elastic','elastic','elastic','one','one' axial=.false. modes={modes}"
        deck = HEAD + BEAM.format(n=8, more=more) + joints + sensor
        curves.append(
            run_deck(deck + "&transient t_end=0.1 method='rk4' step=1.0e-5 output_step=1.0e-3 /\n", name=f"m{modes}").history
        )
    exact = curves.pop()["mid.v"]
    errors = [np.abs(h["mid.v"] - exact).max() / np.ptp(exact) for h in curves]
    assert errors[0] < 0.05
    assert errors[1] < errors[0] / 4
    assert errors[2] < errors[1] / 2


def test_dissipative_coordinates_are_kept_per_mode_and_material(run_deck):
    more = "element_material='one','two','one','two' reference='clamped' modes=5"
    told = run_deck(HEAD + BEAM.format(n=4, more=more), "--check").stdout
    assert re.search(r"3 \+ 5 modes of 12 nodal coordinates, 15 dissipative coordinates", told)  # 5*(1 + 2) terms
