"""The parts of biela's independent test model: histories, material points, places and elements, read from a deck.

Nothing here is shared with the solver. A deck is read by f90nml; a body becomes a cloud of weighted material points
(Gauss points of its elements, lumps, mass centres) whose positions are linear in its elastic coordinates. All
functions of the coordinates accept complex arrays with leading batch dimensions, so that derivatives can be taken
by complex steps.
"""

from pathlib import Path

import f90nml
import numpy as np
from numpy.polynomial import Polynomial

GAUSS = 5  # points an element: exact to degree 9; the fields need 6
HERMITE = {  # element coordinate -> (axial polynomial, transverse polynomial / L^power) in xi = x/L
    0: (Polynomial([1, -1]), None, 0),
    1: (None, Polynomial([1, 0, -3, 2]), 0),
    2: (None, Polynomial([0, 1, -2, 1]), 1),
    3: (Polynomial([0, 1]), None, 0),
    4: (None, Polynomial([0, 0, 3, -2]), 0),
    5: (None, Polynomial([0, 0, -1, 1]), 1),
}


def read_deck(path):
    """Return the deck as {group: [assignments, ...]}, names in lower case, included files read in place."""
    groups = {}
    for group, content in f90nml.read(str(path)).items():
        for record in content if isinstance(content, list) else [content]:
            if group == "include":
                for name, more in read_deck(Path(path).parent / record["file"]).items():
                    groups.setdefault(name, []).extend(more)
            else:
                groups.setdefault(group, []).append({key: lower(value) for key, value in record.items()})
    return groups


def lower(value):
    """Return words in lower case (names are case-insensitive), everything else as it is."""
    if isinstance(value, str):
        return value.lower()
    return [lower(item) for item in value] if isinstance(value, list) else value


def as_list(value):
    """Return a scalar as a list of one."""
    return list(value) if isinstance(value, (list, tuple)) else [value]


def by_name(groups, kind):
    """Return {name: record} of all groups of one kind, in deck order."""
    return {record["name"]: record for record in groups.get(kind, [])}


# ---------------------------------------------------------------- histories


class Pieces:
    """A function of time made of polynomials between breaks; constant outside unless the ends are open."""

    def __init__(self, breaks, polynomials, before, after):
        self.breaks, self.polynomials, self.before, self.after = list(breaks), polynomials, before, after

    def value(self, t, order=0):
        """Return the derivative of the given order at t [unit/s^order]."""
        if t < self.breaks[0]:
            return self.before if order == 0 else 0.0
        if t >= self.breaks[-1]:
            return self.after if order == 0 else 0.0
        piece = self.polynomials[np.searchsorted(self.breaks, t, side="right") - 1]
        return float(piece.deriv(order)(t)) if order else float(piece(t))

    def corners(self):
        """Return the times at which the function is not smooth [s]."""
        return [t for t in self.breaks if np.isfinite(t)]


class Waves:
    """offset + slope t + amplitude sin(omega t + phase) between start and finish, constant outside."""

    def __init__(self, offset, slope, amplitude, omega, phase, start=-np.inf, finish=np.inf):
        self.parameters = offset, slope, amplitude, omega, phase
        self.start, self.finish = start, finish

    def value(self, t, order=0):
        """Return the derivative of the given order at t [unit/s^order]."""
        if order and not self.start <= t <= self.finish:
            return 0.0
        offset, slope, amplitude, omega, phase = self.parameters
        t = min(max(t, self.start), self.finish)
        line = (offset + slope * t, slope, 0.0)[order]
        return line + amplitude * omega**order * np.sin(omega * t + phase + order * np.pi / 2)

    def corners(self):
        """Return the times at which the function is not smooth [s]."""
        return [t for t in (self.start, self.finish) if np.isfinite(t)]


def not_a_knot(times, values):
    """Return the cubic pieces of the not-a-knot spline through at least four points, from one dense system."""
    n = len(times) - 1
    rows, right = [], []

    def row(piece, t, order, sign=1.0):
        line = np.zeros(4 * n)
        for power in range(order, 4):
            factor = np.prod(np.arange(power - order + 1, power + 1)) if order else 1.0
            line[4 * piece + power] = sign * factor * (t - times[piece]) ** (power - order)
        return line

    for i in range(n):
        rows += [row(i, times[i], 0), row(i, times[i + 1], 0)]
        right += [values[i], values[i + 1]]
    for i in range(n - 1):
        for order in (1, 2):
            rows.append(row(i, times[i + 1], order) + row(i + 1, times[i + 1], order, -1.0))
            right.append(0.0)
    for i in (0, n - 2):
        rows.append(row(i, times[i + 1], 3) + row(i + 1, times[i + 1], 3, -1.0))
        right.append(0.0)
    coefficients = np.linalg.solve(np.array(rows), np.array(right)).reshape(n, 4)
    return [Polynomial(c)(Polynomial([-t, 1.0])) for c, t in zip(coefficients, times[:-1])]


def make_history(record):
    """Return the function of time that a &history record (or None: the factor 1) describes."""
    if record is None:
        return Pieces([-np.inf, np.inf], [Polynomial([1.0])], 1.0, 1.0)
    kind = record["kind"]
    if kind == "polynomial":
        return Pieces([-np.inf, np.inf], [Polynomial(as_list(record["coefficients"]))], None, None)
    if kind == "sine":
        omega = 2 * np.pi * record["frequency"]
        return Waves(record.get("offset", 0.0), 0.0, record["amplitude"], omega, record.get("phase", 0.0))
    if kind == "table":
        times, values = as_list(record["time"]), as_list(record["value"])
        return Pieces(times, not_a_knot(times, values), values[0], values[-1])
    start, finish = record["start"], record["finish"]
    if kind == "pulse":
        return Pieces([start, finish], [Polynomial([record["value"]])], 0.0, 0.0)
    first, last = record["start_value"], record["end_value"]
    if kind == "ramp":
        s = Polynomial([-start / (finish - start), 1 / (finish - start)])
        return Pieces([start, finish], [first + (last - first) * (10 * s**3 - 15 * s**4 + 6 * s**5)], first, last)
    slope, omega = (last - first) / (finish - start), 2 * np.pi / (finish - start)
    return Waves(first - slope * start, slope, -(last - first) / (2 * np.pi), omega, -omega * start, start, finish)


class Integral:
    """The time integral of a history from t = 0 by Gauss quadrature between its corners, plus a constant."""

    def __init__(self, rate, constant):
        self.rate, self.constant = rate, constant
        self.nodes, self.weights = np.polynomial.legendre.leggauss(12)

    def value(self, t, order=0):
        """Return the integral (order 0) or derivatives of the rate at t."""
        if order:
            return self.rate.value(t, order - 1)
        panels = np.linspace(0.0, t, 41)
        low, high = min(0.0, t), max(0.0, t)
        panels = np.sort(np.concatenate([panels, [c for c in self.rate.corners() if low < c < high]]))
        total = 0.0
        for a, b in zip(panels[:-1], panels[1:]):
            middle, half = 0.5 * (a + b), 0.5 * (b - a)
            total += half * sum(w * self.rate.value(middle + half * x) for x, w in zip(self.nodes, self.weights))
        return self.constant + (total if t >= 0 else -total)


# ---------------------------------------------------------------- bodies


def section_properties(record):
    """Return (area [m^2], second moment [m^4]) of a &section record."""
    if "shape" not in record:
        return record["area"], record["inertia"]
    if record["shape"] == "rectangle":
        return record["width"] * record["height"], record["width"] * record["height"] ** 3 / 12
    if record["shape"] == "circle":
        return np.pi * record["diameter"] ** 2 / 4, np.pi * record["diameter"] ** 4 / 64
    outer, inner = record["outer"], record["inner"]
    return np.pi * (outer**2 - inner**2) / 4, np.pi * (outer**4 - inner**4) / 64


def ghm_terms(record):
    """Return the list of GHM terms (alpha, zeta, omega [rad/s]) of a material or spring record."""
    lists = [as_list(record.get(key, [])) for key in ("ghm_alpha", "ghm_zeta", "ghm_omega")]
    scale = record.get("ghm_frequency_scale", 1.0)
    return [(a, z, w * scale) for a, z, w in zip(*lists)]


def shape_rows(xi, length, order=0):
    """Return (axial, transverse) rows (6,) of the order-th x-derivative of the element's field at xi."""
    axial, transverse = np.zeros(6), np.zeros(6)
    for index, (along, across, power) in HERMITE.items():
        for row, polynomial in ((axial, along), (transverse, across)):
            if polynomial is not None:
                derived = polynomial.deriv(order) if order else polynomial
                row[index] = derived(xi) * length ** (power - order)
    return axial, transverse


def unit_gauss():
    """Return Gauss points and weights on [0, 1]."""
    nodes, weights = np.polynomial.legendre.leggauss(GAUSS)
    return 0.5 * (nodes + 1), 0.5 * weights


# what dissipative coordinates of an element follow, by its deformations: e, the difference of the end rotations and their mean
FOLLOWED = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 1.0], [0.0, 0.5, 0.5]])


class Body:
    """One body as a cloud of material points, with its elements' strain fields.

    weight (p,) [kg], rest (p, 2) [m], shape (p, 2, nf): point p lies at rest + shape q_f in body axes;
    rotors (r,) [kg m^2] turn with theta + spin (r, nf) q_f.
    """

    def __init__(self, name, record, groups, mode_signs=1.0):
        self.name, self.record, self.groups = name, record, groups
        self.kind = record["kind"]
        self.weight, self.rest, self.shape = [], [], []
        self.rotors, self.spin = [], []
        self.ghm = []  # (unit, alpha, zeta, omega): an element, or in a modal basis a material, and a term
        self.modal, self.axial, self.shift = False, True, None  # shift: part of `shape` that the spin does not see
        if self.kind == "rigid":
            self.nf, self.nodes, self.elements, self.basis = 0, np.zeros((0, 2)), [], np.eye(0)
            self.add_mass(
                np.array(as_list(record.get("com", [0.0, 0.0]))), np.zeros((2, 0)), np.zeros(0), record["mass"], record["inertia"]
            )
        else:
            self.mesh(record, groups)
        for lump in groups.get("lump", []):
            if lump["body"] == name:
                self.add_mass(*self.station(lump.get("node"), lump.get("point")), lump.get("mass", 0.0), lump.get("inertia", 0.0))
        self.weight, self.rotors = np.array(self.weight), np.array(self.rotors)
        self.rest = np.array(self.rest, float).reshape(len(self.weight), 2)
        self.shape = np.array(self.shape, float).reshape(len(self.weight), 2, self.nf)
        self.spin = np.array(self.spin, float).reshape(len(self.rotors), self.nf)
        if self.nf and record.get("modes", 0):
            self.reduce(record["modes"], mode_signs)

    def add_mass(self, rest, shape, spin, mass, inertia):
        """Add a point mass and a rotor."""
        self.weight.append(mass)
        self.rest.append(rest)
        self.shape.append(shape)
        self.rotors.append(inertia)
        self.spin.append(spin)

    def mesh(self, record, groups):
        """Read nodes and elements, choose the coordinates that stay and lay the material points."""
        if self.kind == "beam":
            count = record["elements"]
            self.nodes = np.stack([np.linspace(0.0, record["length"], count + 1), np.zeros(count + 1)], axis=1)
            ends = np.stack([np.arange(count), np.arange(1, count + 1)], axis=1)
        else:
            self.nodes = np.stack([as_list(record["node_x"]), as_list(record["node_y"])], axis=1).astype(float)
            ends = np.array(record["element_nodes"]).reshape(-1, 2) - 1
        self.columns = self.kept_columns(record)
        self.nf = int(self.columns.max(initial=-1)) + 1
        self.basis = np.eye(self.nf)
        self.axial = record.get("axial", True)
        self.stiffening = record.get("stiffening", False)
        self.build_elements(ends, record, groups)

    def kept_columns(self, record):
        """Return (nodes, 3) column numbers of u, v, r; -1 where a coordinate is removed."""
        count = len(self.nodes)
        kept = np.full((count, 3), bool(record.get("flexible", True)))
        if "reference_node" in record:
            removed = [
                (node, "uvr".index(dof)) for node, dof in zip(as_list(record["reference_node"]), as_list(record["reference_dof"]))
            ]
        else:
            removed = {"pinned": [(1, 0), (1, 1), (-1, 1)], "clamped": [(1, 0), (1, 1), (1, 2)], "free": []}[
                record.get("reference", "pinned")
            ]
        for node, dof in removed:
            kept[node - 1 if node > 0 else node, dof] = False
        if not record.get("axial", True):
            kept[:, 0] = False
        columns = np.full((count, 3), -1)
        columns[kept] = np.arange(kept.sum())
        return columns

    def selection(self, node, dof):
        """Return the row (nf,) that picks one nodal coordinate (zero where it is removed)."""
        row = np.zeros(self.columns.max(initial=-1) + 1)
        if self.columns[node, dof] >= 0:
            row[self.columns[node, dof]] = 1.0
        return row

    def build_elements(self, ends, record, groups):
        """Lay Gauss points and strain rows element by element."""
        materials, sections = by_name(groups, "material"), by_name(groups, "section")
        count = len(ends)
        names = as_list(record.get("element_material", record.get("material")))
        names = names * count if len(names) == 1 else names
        section_names = as_list(record["section"])
        section_names = section_names * count if len(section_names) == 1 else section_names
        points, weights = unit_gauss()
        self.ends = ends
        self.elements = []
        self.length, self.ea, self.ei, self.lift = [], [], [], []
        self.slope, self.curvature, self.stretch = [], [], []
        self.drag_mass, self.drag_stiffness, self.owner = [], [], []
        for index, (first, last) in enumerate(ends):
            material = materials[names[index]]
            area, inertia = section_properties(sections[section_names[index]])
            span = self.nodes[last] - self.nodes[first]
            length = np.hypot(*span)
            turn = np.array([[span[0], -span[1]], [span[1], span[0]]]) / length  # element axes -> body axes
            rows = [self.selection(node, dof) for node in (first, last) for dof in (0, 1)]
            along = [turn[:, 0] @ np.array(rows[0:2]), turn[:, 0] @ np.array(rows[2:4])]
            across = [turn[:, 1] @ np.array(rows[0:2]), turn[:, 1] @ np.array(rows[2:4])]
            local = np.array(
                [along[0], across[0], self.selection(first, 2), along[1], across[1], self.selection(last, 2)]
            )  # (6, nf)
            for xi, weight in zip(points, weights):
                self.weight.append(material["density"] * area * length * weight)
                self.rest.append(self.nodes[first] + xi * span)
                self.shape.append(turn @ np.array(shape_rows(xi, length)) @ local)
                self.owner.append(index)
            self.slope.append([shape_rows(xi, length, 1)[1] @ local for xi in points])
            self.curvature.append([shape_rows(xi, length, 2)[1] @ local for xi in points])
            self.stretch.append(length * shape_rows(0.5, length, 1)[0] @ local)
            chord = (local[4] - local[1]) / length
            self.lift.append([local[2] - chord, local[5] - chord])
            self.length.append(length)
            self.ea.append(material["young"] * area)
            self.ei.append(material["young"] * inertia)
            self.drag_mass.append(material.get("rayleigh_mass", 0.0))
            self.drag_stiffness.append(material.get("rayleigh_stiffness", 0.0))
            self.elements.append(names[index])
            if record.get("viscoelastic", True) and self.nf:
                self.ghm += [(index, *term) for term in ghm_terms(material)]
        for key in ("length", "ea", "ei", "lift", "slope", "curvature", "stretch", "drag_mass", "drag_stiffness"):
            setattr(self, key, np.array(getattr(self, key)))
        self.stiffness_of_deformation(points, weights)

    def stiffness_of_deformation(self, points, weights):
        """Form D (element, 3, 3) by quadrature of the energy of (e, phi1, phi2); keep the Gauss weights."""
        self.quadrature = weights
        self.d_matrix = np.zeros((len(self.length), 3, 3))
        for index, length in enumerate(self.length):
            self.d_matrix[index, 0, 0] = self.ea[index] / length
            for xi, weight in zip(points, weights):
                bend = shape_rows(xi, length, 2)[1][[2, 5]]
                self.d_matrix[index, 1:, 1:] += weight * length * self.ei[index] * np.outer(bend, bend)

    def station(self, node=None, point=None):
        """Return (rest (2,), shape (2, nf), spin (nf,)) of a place on the body."""
        if self.kind == "rigid":
            return np.array(as_list(point if point is not None else [0.0, 0.0]), float), np.zeros((2, 0)), np.zeros(0)
        node = node - 1 if node > 0 else node
        shape = np.array([self.selection(node, 0), self.selection(node, 1)])
        return self.nodes[node].copy(), shape @ self.basis, self.selection(node, 2) @ self.basis

    def reduce(self, modes, signs):
        """Keep the lowest mass-normalised modes (of the given signs); GHM follows them material by material."""
        mass = np.einsum("p,pif,pig->fg", self.weight, self.shape, self.shape) + (self.spin.T * self.rotors) @ self.spin
        flow = np.concatenate([self.stretch[:, None], self.lift], axis=1)  # (element, 3, nf)
        parts = np.einsum("eif,eij,ejg->efg", flow, self.d_matrix, flow)
        inverse = np.linalg.inv(np.linalg.cholesky(mass))
        _, vectors = np.linalg.eigh(inverse @ parts.sum(axis=0) @ inverse.T)
        rigid = (3 if self.axial else 2) if self.record.get("reference") == "free" else 0
        self.basis = (inverse.T @ vectors)[:, rigid : rigid + modes] * signs
        for key in ("shape", "spin", "lift", "slope", "curvature", "stretch"):
            setattr(self, key, getattr(self, key) @ self.basis)
        self.modal, self.nf = True, modes
        materials = list(dict.fromkeys(self.elements[unit] for unit, *_ in self.ghm))
        first = [self.elements.index(material) for material in materials]
        self.ghm = [(first.index(unit), *term) for unit, *term in self.ghm if unit in first]
        self.mode_stiffness = np.array(
            [self.basis.T @ sum(k for k, m in zip(parts, self.elements) if m == material) @ self.basis for material in materials]
        )

    @property
    def components(self):
        """Return the numbers of what dissipative coordinates follow: rows of `FOLLOWED`, or modes."""
        if self.modal:
            return tuple(range(1, self.nf + 1))
        return (1, 2, 3) if self.axial else (2, 3)

    def followed(self, qf):
        """Return what dissipative coordinates follow, (..., unit, component)."""
        if self.modal:
            return np.repeat(qf[..., None, :], len(self.mode_stiffness), axis=-2)
        return (self.deformation(qf) @ FOLLOWED.T)[..., self.components[0] - 1 :]

    def followed_stiffness(self):
        """Return the stiffness on what is followed, (unit, component, component)."""
        if self.modal:
            return self.mode_stiffness
        first = self.components[0] - 1
        return (np.linalg.inv(FOLLOWED).T @ self.d_matrix @ np.linalg.inv(FOLLOWED))[:, first:, first:]

    # ------------------------------------------------ fields of the elastic coordinates

    def elongation(self, qf):
        """Return the length changes e (..., element) [m]; with stiffening the mean von Karman strain times L."""
        change = qf @ self.stretch.T
        if self.stiffening:
            slope = np.einsum("egf,...f->...eg", self.slope, qf)
            change = change + 0.5 * self.length * ((slope * slope) @ self.quadrature)
        return change

    def deformation(self, qf):
        """Return (..., element, 3): length change [m] and the end rotations from the chord [rad]."""
        return np.concatenate([self.elongation(qf)[..., None], np.einsum("eif,...f->...ei", self.lift, qf)], axis=-1)

    def strain_energy(self, qf):
        """Return 1/2 int EA eps^2 + EI v''^2 dx (...,) [J]."""
        if not self.nf:
            return 0.0
        change = self.elongation(qf)
        return 0.5 * (change * change) @ (self.ea / self.length) + self.bending_energy(qf, self.ei)

    def bending_energy(self, qf, stiffness):
        """Return 1/2 int stiffness v''^2 dx (...,)."""
        bend = np.einsum("egf,...f->...eg", self.curvature, qf)
        return 0.5 * ((bend * bend) @ self.quadrature) @ (stiffness * self.length)

    def rayleigh_function(self, rate):
        """Return half the power of proportional damping at the elastic rates (..., nf) [W]."""
        if not self.nf:
            return 0.0
        field = np.einsum("pif,...f->...pi", self.shape[: len(self.owner)], rate)
        mass = self.weight[: len(self.owner)] * self.drag_mass[self.owner]
        change = rate @ self.stretch.T
        return (
            0.5 * (field * field).sum(axis=-1) @ mass
            + 0.5 * (change * change) @ (self.drag_stiffness * self.ea / self.length)
            + self.bending_energy(rate, self.drag_stiffness * self.ei)
        )
