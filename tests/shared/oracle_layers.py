"""Beams of layers, and beams that shear, in biela's independent test model: layer upon layer, by quadrature of the field.

The field is sampled at the Gauss points of an element and differentiated there; the layers are stacked from interface to interface.
What condensation fixes (the shear of a bonded section, the part of u that makes the axial force constant) comes from the energies.
Kinetic energy: of each layer 1/2 rho A |velocity of its middle|^2 + 1/2 rho I (spin)^2, less 1/2 thetadot^2 rho A s^2, s the
displacement along the axis less that of the section's centre of mass: a section that turns is not stiffened by the spin.
"""

import numpy as np
from oracle_parts import Body, as_list, by_name, ghm_terms, section_properties, shape_rows, unit_gauss


def is_layered(record, groups):
    """Return whether a body has a section of layers or one that shears."""
    sections = by_name(groups, "section")
    names = as_list(record.get("element_section", record.get("section", [])))
    return any("layers" in sections[name] or sections[name].get("shear", False) for name in names)


def cowper(record, poisson):
    """Return the shear coefficient of a section's shape (Cowper 1966)."""
    if "shear_factor" in record:
        return record["shear_factor"]
    if record.get("shape", "rectangle") == "rectangle":
        return 10 * (1 + poisson) / (12 + 11 * poisson)
    m2 = (record.get("inner", 0.0) / record["outer"]) ** 2 if record["shape"] == "tube" else 0.0
    return 6 * (1 + poisson) * (1 + m2) ** 2 / ((7 + 6 * poisson) * (1 + m2) ** 2 + (20 + 12 * poisson) * m2)


def read_layers(section, material, materials, viscoelastic):
    """Return the layers of a section, from below, as dictionaries."""
    if "layers" in section:
        names, count = as_list(section["layers"]), len(as_list(section["layers"]))
        heights, width = as_list(section["thickness"]), section["width"]
        cores = as_list(section.get("cores", [2] if count == 3 and not section.get("shear") else []))
        sizes = [(h, width * h, width * h**3 / 12) for h in heights]
    else:
        names, cores, sizes = [material], [], [(0.0, *section_properties(section))]
    layers = []
    for number, (name, (h, area, second)) in enumerate(zip(names, sizes), 1):
        record = materials[name]
        poisson = record.get("poisson", 0.3)
        young = record["young"] if "young" in record else 2 * (1 + poisson) * record["shear_modulus"]
        factor = cowper(section, poisson) if section.get("shear") else 1.0
        core = number in cores
        terms = ghm_terms(record) if viscoelastic else []
        layers.append(
            {
                "h": h,
                "ea": young * area,
                "ei": young * second,
                "ga": factor * young / (2 * (1 + poisson)) * area,
                "mass": record["density"] * area,
                "turning": record["density"] * second if "layers" in section or section.get("shear") else 0.0,
                "core": core,
                "terms": terms,
                "all_terms": not core or section.get("core_stretch", False),
                "drag_mass": record.get("rayleigh_mass", 0.0),
                "drag_stiffness": record.get("rayleigh_stiffness", 0.0),
                "name": name,
            }
        )
    return layers, section.get("base", 1) - 1, bool(section.get("shear", False))


class LayeredBody(Body):
    """A beam or frame of layers: rows (n, nf) with stiffness, the part of the foreshortening in each and its element."""

    def kept_columns(self, record):
        """Number u, v, r and the cores' angles node by node, elements' own parts behind their first node."""
        plain = super().kept_columns(record) >= 0
        groups = self.groups
        sections, materials = by_name(groups, "section"), by_name(groups, "material")
        if self.kind == "beam":
            ends = [(k, k + 1) for k in range(record["elements"])]
        else:
            ends = [tuple(pair) for pair in np.array(record["element_nodes"]).reshape(-1, 2) - 1]
        names = as_list(record.get("element_section", record.get("section")))
        names = names * len(ends) if len(names) == 1 else names
        self.stacks = []
        for index, name in enumerate(names):
            given = as_list(record.get("element_material", record.get("material", [None])))
            material = given[index if len(given) > 1 else 0]
            self.stacks.append(read_layers(sections[name], material, materials, record.get("viscoelastic", True)))
        levels = sorted({k - base for layers, base, _ in self.stacks for k, layer in enumerate(layers) if layer["core"]})
        there = np.zeros((len(self.nodes), len(levels)), bool)
        cores = [[k - base for k, layer in enumerate(layers) if layer["core"]] for layers, base, _ in self.stacks]
        for pair, levels_here in zip(ends, cores):
            for node in pair:
                there[node, [levels.index(level) for level in levels_here]] = True
        if not record.get("flexible", True):
            there[:] = False
            cores = [[] for _ in cores]
        for node in as_list(record.get("slip_held", [])):
            there[node - 1 if node > 0 else node] = False
        kept = np.hstack([plain, there])
        columns = np.full(kept.shape, -1)
        self.own, count = [{} for _ in ends], 0
        for node in range(len(self.nodes)):
            columns[node, kept[node]] = count + np.arange(kept[node].sum())
            count += kept[node].sum()
            for element, pair in enumerate(ends):
                if pair[0] == node:
                    for level in cores[element]:
                        self.own[element][level] = count
                        count += 1
        self.levels, self.count = levels, count
        return columns

    def selection(self, node, dof):
        """Return the row (nf,) that picks one nodal coordinate (zero where it is removed)."""
        row = np.zeros(self.count)
        if self.columns[node, dof] >= 0:
            row[self.columns[node, dof]] = 1.0
        return row

    def build_elements(self, ends, record, groups):  # noqa: ARG002
        """Lay material points, rotors and energy rows, element by element and layer by layer."""
        self.nf, self.basis = self.count, np.eye(self.count)
        self.length, self.slope, self.elements, found = [], [], [], []
        self.drag, self.quadrature = [], unit_gauss()[1]
        self.shift = []
        for index, (first, last) in enumerate(ends):
            span = self.nodes[last] - self.nodes[first]
            length = np.hypot(*span)
            turn = np.array([[span[0], -span[1]], [span[1], span[0]]]) / length
            rows = [self.selection(node, dof) for node in (first, last) for dof in (0, 1)]
            local = [turn[:, 0] @ np.array(rows[:2]), turn[:, 1] @ np.array(rows[:2]), self.selection(first, 2)]
            local += [turn[:, 0] @ np.array(rows[2:]), turn[:, 1] @ np.array(rows[2:]), self.selection(last, 2)]
            layers, base, shears = self.stacks[index]
            for level in (k - base for k, layer in enumerate(layers) if layer["core"]):
                own = np.zeros(self.count)
                own[self.own[index].get(level, [])] = 1.0
                column = 3 + self.levels.index(level)
                local += [self.selection(first, column), self.selection(last, column), own]
            local = np.array(local)
            self.add_element(index, layers, base, shears, length, turn, local, span, self.nodes[first], found)
            self.length.append(length)
            self.elements.append(layers[base]["name"])
        self.length, self.slope = np.array(self.length), np.array(self.slope)
        self.shift = np.array(self.shift).reshape(len(self.shift), self.nf)
        # rows: elastic ones first, then layer by layer those that terms follow
        found.sort(key=lambda row: (row["layer"] + 1 if row["terms"] else 0, row["element"]))
        self.rows = np.array([row["row"] for row in found]).reshape(len(found), self.nf)
        self.row_stiffness = np.array([row["stiffness"] for row in found])
        self.shortening = np.array([row["shortening"] for row in found])
        self.row_element = np.array([row["element"] for row in found], int)
        self.row_material = [row["material"] if row["terms"] else None for row in found]
        if self.nf:
            self.ghm = [(number, *term) for number, row in enumerate(found) for term in row["terms"]]

    def add_element(self, index, layers, base, shears, length, turn, local, span, start, found):
        """Add one element's points, rotors and rows."""
        points, weights = unit_gauss()
        size = 6 + 3 * sum(layer["core"] for layer in layers)
        nodes = np.vander(points, increasing=True)
        slope_of = np.array([[k * x ** max(k - 1, 0) for k in range(len(points))] for x in points]) @ np.linalg.inv(nodes) / length

        def padded(rows):
            return np.hstack([np.array(rows), np.zeros((len(rows), size - 6))])

        turns = np.zeros(size)  # both ends turn against the chord
        turns[[1, 2, 4, 5]] = 1 / length, 0.5, -1 / length, 0.5
        v = padded([shape_rows(x, length)[1] for x in points])
        u = padded([shape_rows(x, length)[0] for x in points])
        equal_slopes = np.array([shape_rows(x, length)[1] @ [0, 0, 1, 0, 0, 1] for x in points])
        g, here = [np.zeros((len(points), size)) for _ in layers], 0
        for number, layer in enumerate(layers):
            if layer["core"]:
                at = 6 + 3 * here
                g[number][:, at : at + 3] = np.array([1 - points, points, 4 * points * (1 - points)]).T
                here += 1

        def stack(u, turn_of_section):
            """Return w (layers, points, size) of the layers' middles and their turns."""
            angles = [turn_of_section - g[number] for number in range(len(layers))]
            w = [None] * len(layers)
            w[base] = u
            for number in range(base + 1, len(layers)):
                face = w[number - 1] - layers[number - 1]["h"] / 2 * angles[number - 1]
                w[number] = face - layers[number]["h"] / 2 * angles[number]
            for number in range(base - 1, -1, -1):
                face = w[number + 1] + layers[number + 1]["h"] / 2 * angles[number + 1]
                w[number] = face + layers[number]["h"] / 2 * angles[number]
            return np.array(w), np.array(angles)

        def with_constant_force(u, turn_of_section):
            """Return u with the quadratic part that leaves the axial force constant."""
            ea = np.array([layer["ea"] for layer in layers])
            force = np.einsum("l,lpi->pi", ea, slope_of @ stack(u, turn_of_section)[0])
            line = np.polynomial.polynomial.polyfit(points, force, 1)[1]  # along the element
            return u + np.outer(4 * points * (1 - points), line * length / (8 * ea.sum()))

        shear = np.zeros(size)
        if shears:
            unit = turns / (turns @ turns)  # (phi1 + phi2)/2 = 1
            bent = with_constant_force(0 * u, np.outer(slope_of @ equal_slopes, turns))
            w, angles = stack(bent, np.outer(slope_of @ equal_slopes, turns))
            strain, curve = slope_of @ w, slope_of @ angles
            stiffness = length * sum(
                layer["ea"] * weights @ (e @ unit) ** 2 + layer["ei"] * weights @ (k @ unit) ** 2
                for layer, e, k in zip(layers, strain, curve)
            )
            shear = -stiffness / (stiffness + length * sum(layer["ga"] for layer in layers)) * turns
            v = v + np.outer(equal_slopes, shear)
        section_turn = slope_of @ v - shear
        u = with_constant_force(u, section_turn)
        w, angles = stack(u, section_turn)
        strain, curve = slope_of @ w, slope_of @ angles
        heights = self.heights(layers, base)
        self.slope.append(slope_of @ v @ local)
        masses = np.array([layer["mass"] for layer in layers])
        middle = np.einsum("l,lpi->pi", masses / masses.sum(), w)  # of the centre of mass
        cores = 0
        for number, layer in enumerate(layers):
            for k, weight in enumerate(weights):
                mass = layer["mass"] * length * weight
                self.weight.append(mass)
                self.rest.append(start + points[k] * span + turn[:, 1] * heights[number])
                self.shape.append(turn @ np.array([w[number, k], v[k]]) @ local)
                self.shift.append((w[number, k] - middle[k]) @ local)
                self.rotors.append(layer["turning"] * length * weight)
                self.spin.append(angles[number, k] @ local)
                if layer["drag_mass"]:
                    for row, amount in ((w[number, k], mass), (v[k], mass), (angles[number, k], self.rotors[-1])):
                        self.drag.append((row @ local, layer["drag_mass"] * amount))

            def add(row, stiffness, shortening, follows, layer=layer, number=number):
                if np.any(np.abs(row) > 1e-12 * np.abs(strain).max() * length):
                    terms = layer["terms"] if follows else []
                    found.append(
                        {"row": row @ local, "stiffness": stiffness, "shortening": shortening, "terms": terms, "layer": number}
                        | {"element": index, "material": layer["name"]}
                    )
                    if layer["drag_stiffness"]:
                        self.drag.append((row @ local, layer["drag_stiffness"] * stiffness))

            mean_e, mean_k = length * weights @ strain[number], length * weights @ curve[number]
            along = 1.0 if self.record.get("axial", True) else 0.0
            if not along:
                mean_e[[0, 3]] = 0.0
            follows = layer["all_terms"]
            if here == 0:
                unit = turns / (turns @ turns)
                bend = length * weights @ (layer["ea"] * (strain[number] @ unit) ** 2 + layer["ei"] * (curve[number] @ unit) ** 2)
                bend += layer["ga"] * length * (shear @ unit) ** 2 if shears else 0.0
                add(mean_e, layer["ea"] / length, along, follows)
                add(mean_k, layer["ei"] / length, 0.0, follows)
                add(turns, bend, 0.0, follows)
                continue
            change = 3 * length * weights * (1 - 2 * points)
            add(mean_e, layer["ea"] / length, along, follows)
            add(change @ strain[number], layer["ea"] / length / 3, 0.0, follows)
            add(mean_k, layer["ei"] / length, 0.0, follows)
            add(change @ curve[number], layer["ei"] / length / 3, 0.0, follows)
            if layer["core"]:
                for xi in (0.5 - 0.5 / np.sqrt(3), 0.5 + 0.5 / np.sqrt(3)):
                    row = np.zeros(size)
                    row[6 + 3 * cores : 9 + 3 * cores] = 1 - xi, xi, 4 * xi * (1 - xi)
                    add(row, layer["ga"] * length / 2, 0.0, True)
                cores += 1

    @staticmethod
    def heights(layers, base):
        """Return the heights of the layers' middles above that of the base."""
        top = np.cumsum([layer["h"] for layer in layers])
        middle = top - 0.5 * np.array([layer["h"] for layer in layers])
        return middle - middle[base]

    @property
    def components(self):
        """Return the numbers under which the probe lists what dissipative coordinates follow."""
        return tuple(range(1, self.nf + 1)) if self.modal else (3,)

    def foreshortening(self, qf):
        """Return L/2 times the mean squared slope of every element (..., element) [m]."""
        if not self.stiffening:
            return np.zeros((*np.shape(qf)[:-1], len(self.length)))
        slope = np.einsum("egf,...f->...eg", self.slope, qf)
        return 0.5 * self.length * ((slope * slope) @ self.quadrature)

    def row_values(self, qf):
        """Return the rows (..., n)."""
        return qf @ self.rows.T + self.shortening * self.foreshortening(qf)[..., self.row_element]

    def followed(self, qf):
        """Return what dissipative coordinates follow, (..., unit, component)."""
        return super().followed(qf) if self.modal else self.row_values(qf)[..., None]

    def followed_stiffness(self):
        """Return the stiffness on what is followed, (unit, component, component)."""
        return super().followed_stiffness() if self.modal else self.row_stiffness[:, None, None]

    def strain_energy(self, qf):
        """Return 1/2 sum of stiffness times row squared (...,) [J]."""
        if not self.nf:
            return 0.0
        rows = self.row_values(qf)
        return 0.5 * (rows * rows) @ self.row_stiffness

    def rayleigh_function(self, rate):
        """Return half the power of proportional damping at the elastic rates (..., nf) [W]."""
        if not self.drag:
            return 0.0 * rate[..., 0]
        rows = np.array([row for row, _ in self.drag]) @ self.basis
        flow = rate @ rows.T
        return 0.5 * (flow * flow) @ np.array([amount for _, amount in self.drag])

    def reduce(self, modes, signs):
        """Keep the lowest mass-normalised modes (of the given signs); GHM follows them material by material."""
        mass = np.einsum("p,pif,pig->fg", self.weight, self.shape, self.shape) + (self.spin.T * self.rotors) @ self.spin
        inverse = np.linalg.inv(np.linalg.cholesky(mass))
        stiffness = (self.rows.T * self.row_stiffness) @ self.rows
        _, vectors = np.linalg.eigh(inverse @ stiffness @ inverse.T)
        self.basis = (inverse.T @ vectors)[:, :modes] * signs
        for key in ("shape", "spin", "slope", "rows"):
            setattr(self, key, getattr(self, key) @ self.basis)
        self.shift = self.shift @ self.basis
        self.modal, self.nf = True, modes
        materials = list(dict.fromkeys(self.row_material[unit] for unit, *_ in self.ghm))
        first = [self.row_material.index(material) for material in materials]
        self.ghm = [(first.index(unit), *term) for unit, *term in self.ghm if unit in first]
        self.mode_stiffness = np.array(
            [
                (self.rows.T * self.row_stiffness * np.array([m == material for m in self.row_material])) @ self.rows
                for material in materials
            ]
        )
