"""The solver's inside as the probe prints it, beside the independent model of the same deck."""

import subprocess
from dataclasses import dataclass

import numpy as np
from oracle import Scene


@dataclass
class Answer:
    """What the probe says about one state: its lines by name, the Jacobian as (rows, nq)."""

    lines: dict

    def __getattr__(self, name):
        """Return one line's numbers."""
        return self.lines[name]

    @property
    def constraint_forces(self):
        """The generalised forces of all constraints, -Phi_q^T lambda, shape (nq,)."""
        return -self.jacobian.T @ self.multipliers


class Twins:
    """One deck in the solver's hands and in the oracle's, with the same order of unknowns and rows."""

    def __init__(self, probe, folder, deck):
        self.probe, self.path = probe, folder / "twin.nml"
        self.path.write_text(deck, encoding="utf-8")
        self.layout, self.row_names, initial = [], [], []
        for line in self.call("layout"):
            word, *rest = line.split()
            if word == "z":
                self.layout.append(tuple(int(x) if x.isdigit() else x for x in rest))
            elif word == "row":
                self.row_names.append(rest[1])
            elif word == "initial":
                initial.append(np.array([float(x) for x in rest]))
        self.q0, self.v0 = initial
        self.oracle = Scene(self.path, self.q0)
        if any(body.modal for body in self.oracle.bodies):
            self.oracle = Scene(self.path, self.q0, self.mode_signs())
        self.oracle.set_layout(self.layout)
        by_owner = {}
        for row in self.oracle.rows:
            by_owner.setdefault(row.owner, []).append(row)
        self.oracle.rows = [by_owner[name].pop(0) for name in self.row_names]
        assert not any(by_owner.values()), "the solver leaves constraint rows out"

    def call(self, word, text=""):
        """Return the lines that the probe prints."""
        done = subprocess.run(
            [str(self.probe), word, str(self.path)], input=text, capture_output=True, text=True, timeout=600, check=False
        )
        assert done.returncode == 0, f"probe {word}: {done.stderr}"
        return done.stdout.splitlines()

    def evaluate(self, states):
        """Return the probe's answers for states (t, q, v, z, zd)."""
        text = "\n".join(" ".join(f"{x:.17g}" for x in np.concatenate([[s[0]], *s[1:]])) for s in states) + "\n"
        answers, lines = [], {}
        for line in self.call("evaluate", text):
            word, *numbers = line.split()
            if word == "end":
                lines["jacobian"] = lines["jacobian"].reshape(-1, self.oracle.nq)
                answers.append(Answer(lines))
                lines = {}
            else:
                lines[word] = np.array([float(x) for x in numbers])
        assert len(answers) == len(states)
        return answers

    def mode_signs(self):
        """Return the signs that turn the oracle's modes into the solver's: by the power of the loads along each mode."""
        scene, signs = self.oracle, {}
        zero = np.zeros(scene.nz)
        for body in scene.bodies:
            if body.modal:
                at = np.arange(body.nf) + scene.offset[body.name] + 3
                power = scene.load_forces(0.0, self.q0)[at]
                answers = self.evaluate([(0.0, self.q0, unit, zero, zero) for unit in np.eye(scene.nq)[at]])
                theirs = np.array([answer.power[1] for answer in answers])
                np.testing.assert_allclose(np.abs(theirs), np.abs(power), rtol=1e-6)
                signs[body.name] = np.sign(power * theirs)
        return signs

    def random_states(self, seed, count, spread=1.0):
        """Return states around the assembled one that need not satisfy the constraints; elastic parts are small."""
        scene, rng, states = self.oracle, np.random.default_rng(seed), []
        for _ in range(count):
            q, v = self.q0.copy(), np.zeros(scene.nq)
            for body in scene.bodies:
                at = scene.offset[body.name]
                q[at : at + 3] += spread * np.array([0.05, 0.05, 0.3]) * rng.standard_normal(3)
                v[at : at + 3] = spread * np.array([1.0, 1.0, 6.0]) * rng.standard_normal(3)
                q[at + 3 : at + 3 + body.nf] += 2e-3 * spread * rng.standard_normal(body.nf)
                v[at + 3 : at + 3 + body.nf] = 0.5 * spread * rng.standard_normal(body.nf)
            z = scene.deformations(q) + 1e-3 * spread * rng.standard_normal(scene.nz)
            states.append((rng.uniform(0.0, 0.5), q, v, z, 0.5 * spread * rng.standard_normal(scene.nz)))
        return states

    def kinds(self):
        """Return the kinds of coordinates as (indices, weights): frames (angles times the size S), each body's elastic ones."""
        scene, found = self.oracle, []
        frames = np.concatenate([scene.offset[body.name] + np.arange(3) for body in scene.bodies])
        found.append((frames, np.tile([1.0, 1.0, scene.size], len(scene.bodies))))
        for body in scene.bodies:
            if body.nf:
                found.append((scene.offset[body.name] + 3 + np.arange(body.nf), np.ones(body.nf)))
        return found

    def closed_state(self, seed, t=0.0):
        """Return a random state that satisfies the constraints in position and velocity (least change)."""
        scene = self.oracle
        _, q, v, z, zd = self.random_states(seed, 1, spread=0.3)[0]
        weight = np.concatenate([[1.0, 1.0, 1.0, *[1e-3] * body.nf] for body in scene.bodies])
        for _ in range(50):
            gap = scene.phi(t, q)
            if np.max(np.abs(gap), initial=0.0) < 1e-15:
                break
            q = q - weight * np.linalg.lstsq(scene.jacobian(q) * weight, gap, rcond=1e-10)[0]
        v = v - weight * np.linalg.lstsq(scene.jacobian(q) * weight, scene.phi_rate(t, q, v), rcond=1e-10)[0]
        return t, q, v, z, zd


def largest_error(found, expected, kinds=None, beside=0.0):
    """Return the largest difference over the largest value, kind by kind; `beside`: values of the same kind that count too."""
    beside = np.broadcast_to(beside, expected.shape)
    worst = 0.0
    for kind, weight in kinds or [(np.arange(len(expected)), np.ones(len(expected)))]:
        scale = np.max(weight * np.maximum(np.abs(expected[kind]), np.abs(beside[kind])), initial=0.0)
        gap = np.max(weight * np.abs(found[kind] - expected[kind]), initial=0.0)
        worst = max(worst, gap / scale if scale > 0 else gap)
    return worst
