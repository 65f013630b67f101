"""Vaz, Rade & Lima's augmented matrices (Eq. 31), built literally and dense, against the solver's deformation space.

    M_G = [[M, 0], [0, alpha/omega^2 K0]]   C_G = [[C, 0], [0, 2 alpha zeta/omega K0]]
    K_G = [[K0 (1 + sum alpha), -alpha K0], [-alpha K0, alpha K0]]        (one row and column of blocks a term)

K0 is the stiffness of a homogeneous body in its elastic coordinates, from the textbook's element matrices; the paper's
dissipative coordinates are as many as the elastic ones, the solver's are their deformations, delta_k = B z_k.
"""

import numpy as np
import pytest
from oracle import gradient
from oracle_parts import FOLLOWED, section_properties
from oracle_probe import Twins, largest_error
from scenes import MATERIALS, PUSHES, beam, frame, rigid

SCENES = {
    "free_beam_one_term": beam(material="one", elements=3),
    "free_beam_three_terms": beam(material="three", elements=3),
    "clamped_two_terms": beam(material="two", rest="reference='clamped' angle=0.4"),
    "no_axial": beam(material="two", rest="axial=.false. reference='clamped' angle=0.4"),
    "closed_frame": frame(materials="'two'"),
    "slider_crank": rigid(rest="angle=0.4")
    + beam(material="three", rest="position=0.18,0.08 angle=-0.2")
    + """&joint name='a' type='revolute' body_a='r' /
&joint name='b' type='revolute' body_a='b' node_a=1 body_b='r' point_b=0.2,0.0 /
&joint name='c' type='slider' body_a='b' node_a=-1 direction=0.0 /
""",
    "two_bodies": beam(material="one")
    + frame(materials="'two'")
    + rigid()
    + PUSHES
    + "&joint name='j' type='revolute' body_a='f' node_a=3 body_b='b' node_b=-1 /\n",
}


def textbook_stiffness(body, groups):
    """Return K0 (nf, nf): Euler-Bernoulli element matrices turned and assembled over the kept coordinates."""
    young = {record["name"]: record["young"] for record in groups["material"]}
    sections = {record["name"]: section_properties(record) for record in groups["section"]}
    names = body.record["section"]
    names = [names] * len(body.elements) if isinstance(names, str) else names
    ends = np.array(body.record.get("element_nodes", [[k + 1, k + 2] for k in range(len(body.elements))])).reshape(-1, 2) - 1
    total = np.zeros((body.nf, body.nf))
    for (first, last), material, name in zip(ends, body.elements, names):
        dx, dy = body.nodes[last] - body.nodes[first]
        length = np.hypot(dx, dy)
        area, inertia = sections[name]
        ea, ei = young[material] * area / length, young[material] * inertia / length**3
        stiffness = np.zeros((6, 6))
        stiffness[np.ix_([0, 3], [0, 3])] = ea * np.array([[1, -1], [-1, 1]])
        stiffness[np.ix_([1, 2, 4, 5], [1, 2, 4, 5])] = ei * np.array(
            [
                [12, 6 * length, -12, 6 * length],
                [6 * length, 4 * length**2, -6 * length, 2 * length**2],
                [-12, -6 * length, 12, -6 * length],
                [6 * length, 2 * length**2, -6 * length, 4 * length**2],
            ]
        )
        c, s = dx / length, dy / length
        turn = np.kron(np.eye(2), np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]))
        stiffness = turn.T @ stiffness @ turn
        columns = np.concatenate([body.columns[first], body.columns[last]])
        kept = np.flatnonzero(columns >= 0)
        total[np.ix_(columns[kept], columns[kept])] += stiffness[np.ix_(kept, kept)]
    return total


class Literal:
    """The augmented system of one scene: q, then for every viscoelastic body and term a full set of elastic coordinates."""

    def __init__(self, scene):
        self.scene, self.blocks = scene, []  # (body, K0, alpha, zeta, omega, indices of q_f, indices of the literal z)
        at = scene.nq
        for body in scene.bodies:
            stiffness = textbook_stiffness(body, scene.groups) if body.nf else None
            for term in range(len([entry for entry in body.ghm if entry[0] == 0])):
                _, alpha, zeta, omega = body.ghm[term]
                own = scene.offset[body.name] + 3 + np.arange(body.nf)
                self.blocks.append((body, stiffness, alpha, zeta, omega, own, at + np.arange(body.nf), term + 1))
                at += body.nf
        self.size = at

    def matrices(self, q):
        """Return M_G, C_G, K_G; K_G holds the viscoelastic bodies' static stiffness too."""
        nq = self.scene.nq
        mass, damping, stiffness = (np.zeros((self.size, self.size)) for _ in range(3))
        mass[:nq, :nq] = self.scene.mass_matrix(q)
        for body in self.scene.bodies:
            if body.nf:
                own = self.scene.offset[body.name] + 3 + np.arange(body.nf)
                stiffness[np.ix_(own, own)] = textbook_stiffness(body, self.scene.groups)
        for _, k0, alpha, zeta, omega, own, lag, _ in self.blocks:
            mass[np.ix_(lag, lag)] = alpha / omega**2 * k0
            damping[np.ix_(lag, lag)] = 2 * alpha * zeta / omega * k0
            stiffness[np.ix_(own, own)] += alpha * k0
            stiffness[np.ix_(own, lag)] -= alpha * k0
            stiffness[np.ix_(lag, own)] -= alpha * k0
            stiffness[np.ix_(lag, lag)] += alpha * k0
        return mass, damping, stiffness

    def spread(self, values):
        """Return the solver's dissipative coordinates that belong to literal ones (size - nq,): delta = B z."""
        found = np.zeros(self.scene.nz)
        for body, *_, lag, term in self.blocks:
            deformation = body.deformation(values[lag - self.scene.nq]) @ FOLLOWED.T
            for number, key in enumerate(self.scene.layout):
                if key[1] == body.name and key[4] == term:
                    found[number] = deformation[key[2] - 1, key[3] - 1]
        return found

    def accelerations(self, t, q, v, z, zd):
        """Return q'' (nq,) and the literal z'' from one dense solution of the augmented, constrained system."""
        scene, nq = self.scene, self.scene.nq
        mass, damping, stiffness = self.matrices(q)
        gravity = gradient(lambda x: sum(self.weight_potential(body, x) for body in scene.bodies), q)
        right = -damping @ np.concatenate([v, zd]) - stiffness @ np.concatenate([q, z])
        right[:nq] += scene.bias(q, v) - gravity + scene.load_forces(t, q) + scene.damping_forces(q, v)
        jacobian = np.zeros((len(scene.rows), self.size))
        jacobian[:, :nq] = scene.jacobian(q)
        rows = len(scene.rows)
        full = np.block([[mass, jacobian.T], [jacobian, np.zeros((rows, rows))]])
        scale = np.ones(len(full))
        scale[: self.size] = 1 / np.sqrt(np.diag(mass))
        solution = scale * np.linalg.solve(scale[:, None] * full * scale, scale * np.concatenate([right, scene.gamma(t, q, v)]))
        return solution[:nq], solution[nq : self.size]

    def weight_potential(self, body, q):
        """Return the potential of gravity of one body (...,)."""
        place, theta, qf = self.scene.parts(body, q)
        local = self.scene.local(body, qf)
        c, s = np.cos(theta)[..., None], np.sin(theta)[..., None]
        gx, gy = self.scene.gravity
        x = place[..., None, 0] + c * local[..., 0] - s * local[..., 1]
        y = place[..., None, 1] + s * local[..., 0] + c * local[..., 1]
        return -(gx * x + gy * y) @ body.weight


@pytest.mark.parametrize("name", SCENES)
def test_same_accelerations(name, probe, tmp_path):
    twins = Twins(probe, tmp_path, MATERIALS + SCENES[name] + "&transient t_end=1e-3 step=1e-5 /\n")
    literal = Literal(twins.oracle)
    nz = literal.size - twins.oracle.nq
    rng = np.random.default_rng(11)
    full, states = [], []
    for t, q, v, _, _ in twins.random_states(3, 3):
        z, zd = 1e-3 * rng.standard_normal(nz), 0.3 * rng.standard_normal(nz)
        full.append((t, q, v, z, zd))
        states.append((t, q, v, literal.spread(z), literal.spread(zd)))
    for state, answer in zip(full, twins.evaluate(states)):
        acceleration, dissipative = literal.accelerations(*state)
        assert largest_error(answer.acceleration, acceleration, twins.kinds()) < 1e-10
        assert largest_error(answer.zdd, literal.spread(dissipative)) < 1e-10
