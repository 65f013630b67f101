"""biela's independent test model: equations of motion from the energies of the interpolated field, nothing else.

The kinetic energy is a Gauss quadrature of 1/2 rho A |r'|^2 over the interpolated field, the strain energy one of
EI v''^2 and EA eps^2; accelerations follow from Lagrange's equations with derivatives by complex steps, constraints
from geometry alone, multipliers from a dense least-squares solution. No shape integral, no hand-written velocity
term and no constraint Jacobian appears, so the solver's are tested against something else.

State: q and v (nq,) hold x, y, theta of every body in deck order, each followed by its elastic coordinates node by
node; z and zd (nz,) the dissipative coordinates in the order of `Scene.layout`.
"""

from dataclasses import dataclass, field

import numpy as np
from oracle_layers import LayeredBody, is_layered
from oracle_parts import (
    FOLLOWED,
    Body,
    Integral,
    as_list,
    by_name,
    ghm_terms,
    make_history,
    read_deck,
    section_properties,
    shape_rows,
    unit_gauss,
)

TINY = 1e-30  # complex step
CIRCLE = np.exp(2j * np.pi * np.arange(16) / 16)
PERP = np.array([[0.0, -1.0], [1.0, 0.0]])


def length_of(vector):
    """Return the length of (..., 2), also of complex continuations."""
    return np.sqrt((vector * vector).sum(axis=-1))


def dot(a, b):
    """Return the scalar product over the last axis, without conjugation."""
    return (a * b).sum(axis=-1)


def turned(angle, vector):
    """Return the vector (..., 2) turned by the angle (...,)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * vector[..., 0] - s * vector[..., 1], s * vector[..., 0] + c * vector[..., 1]], axis=-1)


def gradient(function, q):
    """Return d function / dq as (nq, ...) by complex steps; function takes a batch (nq, nq)."""
    return np.imag(function(q + 1j * TINY * np.eye(len(q)))) / TINY


def along(function, q, v):
    """Return the derivative of function(q) in the direction v by a complex step."""
    return np.imag(function((q + 1j * TINY * v)[None]))[0] / TINY


@dataclass
class Place:
    """A place on a body (offset -1: the ground): rest (2,), shape (2, nf), spin (nf,)."""

    offset: int
    rest: np.ndarray
    shape: np.ndarray = field(default_factory=lambda: np.zeros((2, 0)))
    spin: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def elastic(self, q):
        """Return the body's elastic coordinates (..., nf)."""
        return q[..., self.offset + 3 : self.offset + 3 + len(self.spin)]

    def position(self, q):
        """Return the place in global axes (..., 2) [m]."""
        if self.offset < 0:
            return np.broadcast_to(self.rest, (*q.shape[:-1], 2))
        local = self.rest + self.elastic(q) @ self.shape.T
        return q[..., self.offset : self.offset + 2] + turned(q[..., self.offset + 2], local)

    def frame(self, q):
        """Return the angle of the body frame (...,) [rad]."""
        return q[..., self.offset + 2] if self.offset >= 0 else np.zeros(q.shape[:-1])

    def angle(self, q):
        """Return the angle of the section (...,) [rad]."""
        return self.frame(q) + (self.elastic(q) @ self.spin if self.offset >= 0 else 0.0)


@dataclass
class Row:
    """One constraint row: function(q) - history(t) = 0."""

    owner: str
    function: object
    history: object = None


@dataclass
class Spring:
    """A spring: its deformation(q), stiffness, damping, GHM terms and the numbers of its dissipative coordinates."""

    name: str
    deformation: object
    stiffness: float
    damping: float
    terms: list
    slots: list = field(default_factory=list)


@dataclass
class Load:
    """A load: its force (place, vector(q)) or moment (angle(q)), scaled by a history."""

    place: Place
    force: object
    angle: object
    moment: float
    history: object


class Scene:
    """A deck as equations of motion."""

    def __init__(self, path, assembled=None, mode_signs=None):
        self.groups = read_deck(path) if not isinstance(path, dict) else path
        self.bodies, self.offset, self.nq = [], {}, 0
        for name, record in by_name(self.groups, "body").items():
            kind = LayeredBody if is_layered(record, self.groups) else Body
            body = kind(name, record, self.groups, (mode_signs or {}).get(name, 1.0))
            self.bodies.append(body)
            self.offset[name] = self.nq
            self.nq += 3 + body.nf
        self.body = {body.name: body for body in self.bodies}
        self.gravity = np.array(as_list(self.groups.get("scene", [{}])[0].get("gravity", [0.0, 0.0])), float)
        self.deck_q, self.deck_v = self.deck_state()
        self.size = self.scene_size()
        self.histories = {name: make_history(record) for name, record in by_name(self.groups, "history").items()}
        self.histories[None] = make_history(None)
        self.rows = self.joint_rows() + self.drive_rows()
        self.q0 = self.assemble() if assembled is None else np.asarray(assembled, float)
        for gap, a, b in self.pending:
            gap[0] = float(length_of(a.position(self.q0) - b.position(self.q0)))
        self.springs = [self.make_spring(record) for record in self.groups.get("spring", [])]
        self.loads = [self.make_load(record) for record in self.groups.get("force", []) if record.get("stage", "all") != "static"]
        self.layout, self.slots = [], {}
        self.lay_dissipative()

    # ------------------------------------------------ from the deck

    def deck_state(self):
        """Return q and v as the deck states them."""
        q, v = np.zeros(self.nq), np.zeros(self.nq)
        for body in self.bodies:
            at, record = self.offset[body.name], body.record
            q[at : at + 2], q[at + 2] = as_list(record.get("position", [0.0, 0.0])), record.get("angle", 0.0)
            v[at : at + 2] = as_list(record.get("velocity", [0.0, 0.0]))
            v[at + 2] = record.get("angular_velocity", 0.0)
        return q, v

    def place(self, record, side):
        """Return the place that body_a / node_a / point_a (or body, node, point with side '') name."""
        name = record.get("body" + side, "ground")
        if name == "ground":
            return Place(-1, np.array(as_list(record.get("point" + side, [0.0, 0.0])), float))
        station = self.body[name].station(record.get("node" + side) or 1, record.get("point" + side))
        return Place(self.offset[name], *station)

    def places(self):
        """Return (body name, body-axes point) of all named places, nodes and mass centres."""
        found = []
        for kind in ("joint", "drive", "spring", "force", "lump", "sensor"):
            for record in self.groups.get(kind, []):
                if record.get("type") == "gear":
                    continue  # it acts on angles alone
                for side in ("", "_a", "_b"):
                    if f"node{side}" in record or f"point{side}" in record or (kind == "joint" and side):
                        found.append((record.get("body" + side, "ground"), self.place(record, side).rest))
        for body in self.bodies:
            found += [(body.name, node) for node in body.nodes]
            found.append((body.name, body.weight @ body.rest / body.weight.sum()))
        return found

    def scene_size(self):
        """Return S: the largest distance between two places of one body or of the ground [m]."""
        by_body = {}
        for name, point in self.places():
            by_body.setdefault(name, []).append(point)
        return max(np.max(np.hypot(*(np.array(p)[:, None] - np.array(p)[None]).T)) for p in by_body.values()) or 1.0

    def joint_rows(self):
        """Return the constraint rows of all joints, in deck order."""
        rows, self.pending = [], []  # distance joints without a length take the assembled one
        for record in self.groups.get("joint", []):
            name, kind = record["name"], record["type"]
            a, b = self.place(record, "_a"), self.place(record, "_b")
            if kind in ("revolute", "weld"):
                rows += [Row(name, lambda q, a=a, b=b, i=i: (a.position(q) - b.position(q))[..., i]) for i in (0, 1)]
            if kind in ("slider", "prismatic"):
                rows.append(Row(name, self.line_gap(a, b, record.get("direction", 0.0) + np.pi / 2)))
            if kind in ("weld", "prismatic"):
                kept = float(a.frame(self.deck_q) - b.frame(self.deck_q))
                rows.append(Row(name, lambda q, a=a, b=b, kept=kept: a.angle(q) - b.angle(q) - kept))
            if kind == "gear":
                turns = [self.angle_of(record, side) for side in ("_a", "_b", "_c")]
                rows.append(Row(name, self.gear_gap(turns, record["ratio"], self.deck_q)))
            if kind == "distance":
                gap = [record.get("length")]
                if gap[0] is None:
                    self.pending.append((gap, a, b))
                rows.append(
                    Row(
                        name,
                        lambda q, a=a, b=b, gap=gap: (
                            0.0 * q[..., 0] if gap[0] is None else length_of(a.position(q) - b.position(q)) - gap[0]
                        ),
                    )
                )
        return rows

    def angle_of(self, record, side):
        """Return the angle (q) of the section that a record names on a side, of the body's frame where it names no node."""
        place = self.place(record, side)
        return place.angle if record.get("node" + side, 0) else place.frame

    @staticmethod
    def gear_gap(turns, ratio, start):
        """Return how far a gear's turn of a is from ratio times that of b, both from the carrier c and from the start."""
        a, b, c = turns

        def gap(q):
            return a(q) - c(q) - ratio * (b(q) - c(q))

        kept = float(gap(start))
        return lambda q: gap(q) - kept

    @staticmethod
    def line_gap(a, b, direction):
        """Return the distance (q) of place a from place b along a direction fixed in b's section."""
        unit = np.array([np.cos(direction), np.sin(direction)])
        return lambda q: dot(turned(b.angle(q), np.broadcast_to(unit, (*q.shape[:-1], 2))), a.position(q) - b.position(q))

    def drive_rows(self):
        """Return the constraint rows of all drives, in deck order."""
        rows = []
        for record in self.groups.get("drive", []):
            a, b = self.place(record, "_a"), self.place(record, "_b")
            if record["type"] == "position":
                function = self.line_gap(a, b, record.get("direction", 0.0))
            else:
                left, right = self.angle_of(record, "_a"), self.angle_of(record, "_b")

                def function(q, left=left, right=right):
                    return left(q) - right(q)

            history = self.histories[record["history"]]
            if record.get("rate", False):
                history = Integral(history, float(function(self.deck_q)))
            rows.append(Row(record["name"], function, history))
        return rows

    def make_spring(self, record):
        """Return the spring of a record."""
        a, b = self.place(record, "_a"), self.place(record, "_b")
        if record["type"] == "linear":

            def measure(q):
                return length_of(a.position(q) - b.position(q))

            free = record.get("free_length")
        else:
            left, right = self.angle_of(record, "_a"), self.angle_of(record, "_b")

            def measure(q):
                return left(q) - right(q)

            free = record.get("free_angle")
        free = float(measure(self.q0)) if free is None else free
        return Spring(
            record["name"], lambda q: measure(q) - free, record["stiffness"], record.get("damping", 0.0), ghm_terms(record)
        )

    def make_load(self, record):
        """Return the load of a record."""
        place, kind = self.place(record, ""), record["type"]
        history = self.histories[record.get("history")]
        if kind == "torque":
            angle = place.angle if record.get("node", 0) else place.frame
            return Load(place, None, angle, record["moment"], history)
        if kind == "torque_about":
            centre, moment = np.array(as_list(record["centre"]), float), record["moment"]

            def force(q):
                arm = place.position(q) - centre
                return moment * (arm @ PERP.T) / dot(arm, arm)[..., None]

            return Load(place, force, None, 0.0, history)
        vector = np.array([record.get("fx", 0.0), record.get("fy", 0.0)])
        axes = {"global": lambda q: np.zeros(q.shape[:-1]), "body": place.frame, "section": place.angle}
        axes = axes[record.get("axes", "global")]
        return Load(place, lambda q: turned(axes(q), np.broadcast_to(vector, (*q.shape[:-1], 2))), None, 0.0, history)

    def lay_dissipative(self):
        """Number the dissipative coordinates: elements of all bodies, term by term, then springs."""
        self.layout = []
        for body in self.bodies:
            self.layout += [key for keys in self.keys(body) for key in keys]
        for spring in self.springs:
            self.layout += [("spring", spring.name, term + 1) for term in range(len(spring.terms))]
        self.set_layout(self.layout)

    @staticmethod
    def keys(body):
        """Return the keys of a body's dissipative coordinates, one list for each of its (unit, term)."""
        found, terms = [], {}
        for unit, *_ in body.ghm:
            terms[unit] = terms.get(unit, 0) + 1
            names = [(unit + 1, c) if not body.modal else (c, unit + 1) for c in body.components]
            found.append([("mode" if body.modal else "element", body.name, *name, terms[unit]) for name in names])
        return found

    def set_layout(self, layout):
        """Take another order of the dissipative coordinates: a list of the keys in `layout`."""
        if sorted(layout) != sorted(self.layout):
            raise ValueError(f"dissipative coordinates differ: {set(layout) ^ set(self.layout)}")
        self.layout, self.nz = list(layout), len(layout)
        at = {key: number for number, key in enumerate(self.layout)}
        self.slots = {}
        for body in self.bodies:
            if not body.ghm:
                continue
            units = np.array([entry[0] for entry in body.ghm])
            numbers = np.array([[at[key] for key in keys] for keys in self.keys(body)])
            stiffness = body.followed_stiffness()[units]
            self.slots[body.name] = (units, numbers, stiffness, *np.array([entry[1:] for entry in body.ghm]).T)
        for spring in self.springs:
            spring.slots = [at["spring", spring.name, k + 1] for k in range(len(spring.terms))]

    # ------------------------------------------------ energies

    def parts(self, body, x):
        """Return the slices x[R], x[theta], x[elastic] of one body."""
        at = self.offset[body.name]
        return x[..., at : at + 2], x[..., at + 2], x[..., at + 3 : at + 3 + body.nf]

    def local(self, body, qf):
        """Return the material points in body axes (..., p, 2)."""
        return body.rest + np.einsum("pif,...f->...pi", body.shape, qf)

    def velocities(self, body, q, v):
        """Return the velocities of the material points, global axes (..., p, 2), and the spins of the rotors."""
        _, theta, qf = self.parts(body, q)
        rate, omega, qd = self.parts(body, v)
        inner = omega[..., None, None] * (self.local(body, qf) @ PERP.T) + np.einsum("pif,...f->...pi", body.shape, qd)
        return rate[..., None, :] + turned(theta[..., None], inner), omega[..., None] + qd @ body.spin.T

    def kinetic(self, q, v):
        """Return the kinetic energy (...,) [J] by quadrature over the field."""
        total = 0.0
        for body in self.bodies:
            points, spins = self.velocities(body, q, v)
            total = total + 0.5 * dot(points, points) @ body.weight + 0.5 * (spins * spins) @ body.rotors
            total = total - 0.5 * self.parts(body, v)[1] ** 2 * self.shifted(body, self.parts(body, q)[2])
        return total

    @staticmethod
    def shifted(body, qf):
        """Return the second moment (...,) of the displacements that the spin does not see [kg m^2]."""
        if body.shift is None:
            return 0.0
        moved = qf @ body.shift.T
        return (moved * moved) @ body.weight[: len(body.shift)]

    def momentum(self, q, v):
        """Return dT/dv (..., nq): the field's momentum through dr/dq."""
        pieces = []
        for body in self.bodies:
            points, spins = self.velocities(body, q, v)
            _, theta, qf = self.parts(body, q)
            flow = body.weight[:, None] * points
            back = turned(-theta[..., None], flow)
            turning = dot(back, self.local(body, qf) @ PERP.T).sum(axis=-1) + spins @ body.rotors
            turning = turning - self.parts(body, v)[1] * self.shifted(body, qf)
            elastic = np.einsum("pif,...pi->...f", body.shape, back) + (spins * body.rotors) @ body.spin
            pieces += [flow.sum(axis=-2), turning[..., None], elastic]
        return np.concatenate(pieces, axis=-1)

    def mass_matrix(self, q):
        """Return M (nq, nq): the momenta of unit velocities."""
        return self.momentum(np.broadcast_to(q, (self.nq, self.nq)), np.eye(self.nq))

    def potential(self, q, z, zd):
        """Return strain, GHM, spring and gravity energy (...,) [J]; the rate term of GHM counts as stored."""
        total = 0.0
        for body in self.bodies:
            place, theta, qf = self.parts(body, q)
            total = total + body.strain_energy(qf)
            centre = place[..., None, :] + turned(theta[..., None], self.local(body, qf))
            total = total - (centre @ self.gravity) @ body.weight
            if body.ghm:
                units, numbers, d_matrix, alpha, _, omega = self.slots[body.name]
                lag = body.followed(qf)[..., units, :] - z[numbers]
                total = total + 0.5 * np.einsum("...si,sij,...sj->...s", lag, d_matrix, lag) @ alpha
                total = total + 0.5 * np.einsum("si,sij,sj->s", zd[numbers], d_matrix, zd[numbers]) @ (alpha / omega**2)
        for spring in self.springs:
            d = spring.deformation(q)
            total = total + 0.5 * spring.stiffness * d * d
            for (alpha, _, omega), slot in zip(spring.terms, spring.slots):
                total = total + 0.5 * spring.stiffness * alpha * ((d - z[slot]) ** 2 + (zd[slot] / omega) ** 2)
        return total

    # ------------------------------------------------ generalised forces

    def load_forces(self, t, q):
        """Return the generalised forces of the loads (nq,), by virtual work."""
        total = np.zeros(self.nq)
        for load in self.loads:
            factor = load.history.value(t)
            if load.force is None:
                total += factor * load.moment * gradient(load.angle, q)
            else:
                total += factor * gradient(load.place.position, q) @ load.force(q)
        return total

    def damping_forces(self, q, v):
        """Return the generalised forces of Rayleigh and spring damping (nq,)."""
        total = np.zeros(self.nq)
        for body in self.bodies:
            if body.nf:
                at = self.offset[body.name] + 3
                total[at : at + body.nf] -= gradient(body.rayleigh_function, v[at : at + body.nf])
        for spring in self.springs:
            if spring.damping:
                slope = gradient(spring.deformation, q)
                total -= spring.damping * (slope @ v) * slope
        return total

    def bias(self, q, v):
        """Return dT/dq - (dp/dq) v (nq,): all velocity terms of Lagrange's equations."""
        return gradient(lambda x: self.kinetic(x, v), q) - along(lambda x: self.momentum(x, v[None]), q, v)

    def forces(self, t, q, v, z, zd):
        """Return everything that is not a constraint or an inertia M a (nq,)."""
        return (
            self.bias(q, v) - gradient(lambda x: self.potential(x, z, zd), q) + self.load_forces(t, q) + self.damping_forces(q, v)
        )

    # ------------------------------------------------ constraints

    def geometry(self, q):
        """Return the rows' geometric quantities (..., rows)."""
        return np.stack([row.function(q) for row in self.rows], axis=-1)

    def history_part(self, t, order=0):
        """Return the histories of the rows and their time derivatives (rows,)."""
        return np.array([row.history.value(t, order) if row.history else 0.0 for row in self.rows])

    def phi(self, t, q):
        """Return the constraint values (rows,)."""
        return self.geometry(q) - self.history_part(t) if self.rows else np.zeros(0)

    def jacobian(self, q):
        """Return dPhi/dq (rows, nq)."""
        return gradient(self.geometry, q).T if self.rows else np.zeros((0, self.nq))

    def phi_rate(self, t, q, v):
        """Return dPhi/dt along the motion (rows,)."""
        return self.jacobian(q) @ v - self.history_part(t, 1) if self.rows else np.zeros(0)

    def gamma(self, t, q, v):
        """Return the right-hand side of Phi_q a = gamma: minus the curvature along v, by Cauchy's integral."""
        if not self.rows:
            return np.zeros(0)
        speed = np.max(np.abs(v)) / min(1.0, self.shortest())
        radius = 0.1 / speed if speed > 0 else 1.0
        samples = self.geometry(q + radius * CIRCLE[:, None] * v)
        curvature = 2.0 * np.real((samples * CIRCLE[:, None] ** -2).mean(axis=0)) / radius**2
        return self.history_part(t, 2) - curvature

    def shortest(self):
        """Return the shortest element or distance link [m], a scale for complex circles."""
        links = [record["length"] for record in self.groups.get("joint", []) if "length" in record]
        links += [length for body in self.bodies if len(body.elements) for length in body.length]
        return min([*links, self.size])

    # ------------------------------------------------ equations of motion

    def solve(self, t, q, v, z, zd):
        """Return accelerations (nq,), multipliers (rows,) and constraint forces -Phi_q^T lambda (nq,)."""
        scale = 1.0 / np.sqrt(np.diag(self.mass_matrix(q)))
        factor = np.linalg.cholesky(scale[:, None] * self.mass_matrix(q) * scale)
        free = np.linalg.solve(factor, scale * self.forces(t, q, v, z, zd))
        jacobian = self.jacobian(q)
        multipliers = np.zeros(0)
        if self.rows:
            w = np.linalg.solve(factor, scale[:, None] * jacobian.T)
            norm = 1.0 / np.sqrt((w * w).sum(axis=0))
            left, sigma, right = np.linalg.svd(w * norm, full_matrices=False)
            inverse = np.where(sigma > 1e-9 * sigma[0], 1.0 / np.where(sigma > 0, sigma, 1.0), 0.0)
            gap = right @ (norm * self.gamma(t, q, v))
            multipliers = norm * (right.T @ (inverse * (left.T @ free) - inverse**2 * gap))
            free = free - left @ (np.where(inverse > 0, 1.0, 0.0) * (left.T @ free) - inverse * gap)
        return scale * np.linalg.solve(factor.T, free), multipliers, -jacobian.T @ multipliers

    def deformations(self, q):
        """Return the deformation that each dissipative coordinate follows (nz,)."""
        target = np.zeros(self.nz)
        for body in self.bodies:
            if body.ghm:
                units, numbers, *_ = self.slots[body.name]
                target[numbers] = body.followed(self.parts(body, q)[2])[units]
        for spring in self.springs:
            target[spring.slots] = spring.deformation(q)
        return target

    def term_parameters(self):
        """Return (zeta, omega) of every dissipative coordinate (nz,), (nz,)."""
        zeta, omega = np.zeros(self.nz), np.zeros(self.nz)
        for body in self.bodies:
            if body.ghm:
                _, numbers, _, _, zetas, omegas = self.slots[body.name]
                zeta[numbers], omega[numbers] = zetas[:, None], omegas[:, None]
        for spring in self.springs:
            for (_, z, w), slot in zip(spring.terms, spring.slots):
                zeta[slot], omega[slot] = z, w
        return zeta, omega

    def dissipative_accelerations(self, q, z, zd):
        """Return zdd (nz,)."""
        zeta, omega = self.term_parameters()
        return -2 * zeta * omega * zd - omega**2 * (z - self.deformations(q))

    def dissipated_power(self, q, v, zd):
        """Return the power that GHM, Rayleigh and spring damping take out [W]."""
        power = -self.damping_forces(q, v) @ v
        for body in self.bodies:
            if body.ghm:
                _, numbers, d_matrix, alpha, zeta, omega = self.slots[body.name]
                power += (np.einsum("si,sij,sj->s", zd[numbers], d_matrix, zd[numbers]) * 2 * alpha * zeta / omega).sum()
        for spring in self.springs:
            for (alpha, zeta, omega), slot in zip(spring.terms, spring.slots):
                power += 2 * spring.stiffness * alpha * zeta / omega * zd[slot] ** 2
        return power

    def input_power(self, t, q, v, multipliers):
        """Return the power of loads and drives [W]: minus Phi_q^T lambda works along the histories' rates."""
        return self.load_forces(t, q) @ v - multipliers @ self.history_part(t, 1)

    # ------------------------------------------------ assembly

    def assemble(self):
        """Return q with all rows closed at t = 0: Newton steps of least sum (dx^2 + dy^2)/S^2 + dtheta^2."""
        q = self.deck_q.copy()
        weight = np.zeros(self.nq)
        for body in self.bodies:
            at = self.offset[body.name]
            weight[at : at + 3] = self.size, self.size, 1.0
        for _ in range(50):
            gap = self.phi(0.0, q)
            if not len(gap) or np.max(np.abs(gap)) < 1e-14 * self.size:
                break
            q = q - weight * np.linalg.lstsq(self.jacobian(q) * weight, gap, rcond=1e-10)[0]
        return q

    def relaxed(self, q):
        """Return the dissipative coordinates of a relaxed state and their rates."""
        return self.deformations(q), np.zeros(self.nz)

    def derivative(self, t, y):
        """Return dy/dt of y = (q, v, z, zd)."""
        q, v, z, zd = self.split(y)
        return np.concatenate([v, self.solve(t, q, v, z, zd)[0], zd, self.dissipative_accelerations(q, z, zd)])

    def split(self, y):
        """Return q, v, z, zd of a packed state."""
        n, m = self.nq, self.nz
        return y[:n], y[n : 2 * n], y[2 * n : 2 * n + m], y[2 * n + m :]

    # ------------------------------------------------ sensors

    def sensor_columns(self, t, q, v, z, zd):
        """Return {column: value} of the deck's sensors at a state."""
        a, multipliers, _ = self.solve(t, q, v, z, zd)
        values = {}
        for record in self.groups.get("sensor", []):
            values.update(self.sensor(record, q, v, z, a, multipliers))
        return values

    def sensor(self, record, q, v, z, a, multipliers):
        """Return {column: value} of one sensor."""
        name, quantity = record["name"], record["quantity"]
        if quantity == "reaction":
            return self.reaction(name, record.get("joint", record.get("drive")), q, multipliers)
        if quantity == "internal":
            return self.internal(name, record, q, v, z, a)
        if quantity == "spring":
            spring = next(s for s in self.springs if s.name == record["spring"])
            d, speed = float(spring.deformation(q)), gradient(spring.deformation, q) @ v
            lag = sum(alpha * (d - z[slot]) for (alpha, *_), slot in zip(spring.terms, spring.slots))
            return {f"{name}.f": spring.stiffness * (d + lag) + spring.damping * speed, f"{name}.d": d}
        place = self.place(record, "")
        if quantity == "coordinate":
            at = place.offset + 2 + record["index"]
            return {f"{name}.q": q[at], f"{name}.qd": v[at], f"{name}.qdd": a[at]}
        if quantity == "deflection":
            u = place.shape @ place.elastic(q)
            return {f"{name}.u": u[0], f"{name}.v": u[1], f"{name}.r": place.spin @ place.elastic(q)}
        words = quantity.split("_")
        order = {"velocity": 1, "acceleration": 2}.get(words[-1], 0)
        if words[0] in ("angle", "angular"):
            function = place.angle if "node" in record else place.frame
            slope = gradient(function, q)
            return {name: float((function(q), slope @ v, slope @ a)[order])}
        point = (place.position(q), gradient(place.position, q).T @ v, self.point_acceleration(place, q, v, a))[order]
        return {f"{name}.x": point[0], f"{name}.y": point[1]}

    def point_acceleration(self, place, q, v, a):
        """Return the acceleration of a place (2,)."""
        speed = np.max(np.abs(v)) / min(1.0, self.shortest())
        radius = 0.1 / speed if speed > 0 else 1.0
        samples = place.position(q + radius * CIRCLE[:, None] * v)
        return gradient(place.position, q).T @ a + 2 * np.real((samples * CIRCLE[:, None] ** -2).mean(axis=0)) / radius**2

    def internal(self, column, record, q, v, z, a):
        """Return forces at both ends and outer-fibre stresses of an element, by elasticity and its material points."""
        body, element = self.body[record["body"]], record["element"] - 1
        qf, rate = self.parts(body, q)[2], self.parts(body, v)[2]
        strain = body.deformation(qf)[element]
        drag = body.drag_stiffness[element] * np.append(body.stretch[element] @ rate, body.lift[element] @ rate)
        total = strain.copy()
        if body.ghm:
            units, numbers, _, alpha, *_ = self.slots[body.name]
            for slot in np.flatnonzero(units == element):
                lag = FOLLOWED @ strain
                first = body.components[0] - 1
                lag[first:] -= z[numbers[slot]]
                lag[:first] = 0.0
                total = total + alpha[slot] * np.linalg.solve(FOLLOWED, lag)
        pull = body.d_matrix[element][0] @ total if getattr(body, "stiffening", False) else 0.0
        normal, first_end, second_end = body.d_matrix[element] @ (total + drag)
        n, across, m, ends = self.courses(body, element, q, v, a, (normal, first_end, second_end), pull)
        values = {".n": n(0.0), ".q": across(0.0) - (pull and n(0.0) * ends[2]), ".m1": m(0.0), ".m2": m(1.0)}
        last = {".n2": n(1.0), ".q2": across(1.0) - (pull and n(1.0) * ends[5])}
        names = as_list(body.record["section"])
        section = by_name(self.groups, "section")[names[element if len(names) > 1 else 0]]
        if "shape" in section:
            area, second = section_properties(section)
            fibre = section[{"rectangle": "height", "circle": "diameter", "tube": "outer"}[section["shape"]]] / 2
            top, bottom = n / area - m * fibre / second, n / area + m * fibre / second
            turns = np.concatenate([[0.0, 1.0], top.deriv().roots(), bottom.deriv().roots()])
            places = np.real([x for x in turns if abs(np.imag(x)) < 1e-9 and 0.0 <= np.real(x) <= 1.0])
            sizes = np.maximum(np.abs(top(places)), np.abs(bottom(places)))
            along = places[np.argmax(sizes >= sizes.max() * (1 - 1e-12))]
            last = {".s": sizes.max()} | last | {".top": top(along), ".bottom": bottom(along), ".along": along}
        return {column + key: float(value) for key, value in (values | last).items()}

    def courses(self, body, element, q, v, a, forces, pull):
        """Return N, the force across and M along an element as polynomials of its share, and the coordinates of its ends.

        The loads of its material points (weight, inertia, damping by the mass) go to the ends by the shapes of the displacements.
        """
        offset, length = self.offset[body.name], body.length[element]
        mine = np.flatnonzero(np.array(body.owner) == element)
        points, weights = unit_gauss()
        ends = [body.station(node + 1, None) for node in body.ends[element]]
        axis = (ends[1][0] - ends[0][0]) / length
        turn = np.array([axis, [-axis[1], axis[0]]])  # body axes -> element axes
        qf, rate = self.parts(body, q)[2], self.parts(body, v)[2]
        local = np.concatenate([np.append(turn @ (shape @ qf), spin @ qf) for _, shape, spin in ends])
        loads = []  # per length, element axes
        for k, weight in zip(mine, weights):
            place = Place(offset, body.rest[k], body.shape[k], np.zeros(body.nf))
            force = turned(-q[offset + 2], self.gravity - self.point_acceleration(place, q, v, a))
            loads.append(turn @ (force - body.drag_mass[element] * (body.shape[k] @ rate)) * body.weight[k] / (weight * length))
        along, across = (
            np.polynomial.Polynomial.fit(points, column, 3, domain=[0, 1], window=[0, 1]) for column in np.array(loads).T
        )
        nodal = sum(w * length * load @ np.array(shape_rows(x, length)) for x, w, load in zip(points, weights, np.array(loads)))
        psi = (local[4] - local[1]) / length
        slopes = np.array([local[2], local[5]]) - psi
        tilt = pull * length / 30 * np.array([4 * slopes[0] - slopes[1], 4 * slopes[1] - slopes[0]])
        n = forces[0] + nodal[0] - length * along.integ()
        q_across = -(forces[1] + forces[2] + tilt.sum()) / length + pull * psi + nodal[1] - length * across.integ()
        moved = [np.array([shape_rows(x, length)[1] @ local for x in np.linspace(0, 1, 4)]) - local[1]]
        bent = np.polynomial.Polynomial.fit(np.linspace(0, 1, 4), moved[0], 3, domain=[0, 1], window=[0, 1])
        m = -forces[1] - tilt[0] + nodal[2] - length * q_across.integ() + pull * bent
        return n, q_across, m, local

    def reaction(self, column, name, q, multipliers):
        """Return force and moment (about place a) of a joint or drive on body_a, global axes."""
        record = (by_name(self.groups, "joint") | by_name(self.groups, "drive"))[name]
        mask = np.array([row.owner == name for row in self.rows])
        place = self.place(record, "_a")
        force = -(self.jacobian(q)[mask].T @ multipliers[mask])[place.offset : place.offset + 3]
        arm = place.position(q) - q[place.offset : place.offset + 2]
        moment = force[2] - (arm[0] * force[1] - arm[1] * force[0])
        return {f"{column}.fx": force[0], f"{column}.fy": force[1], f"{column}.m": moment}
