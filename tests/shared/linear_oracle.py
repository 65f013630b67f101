"""The linearised mechanism from the independent model: dense matrices on the null space of the constraints.

Mass, damping and stiffness come from central differences of the oracle's forces about a state of rest, constraints from its
Jacobian; dissipative coordinates are eliminated at each frequency or kept as unknowns. Nothing of the solver is used.
"""

import numpy as np
import scipy.linalg


class LinearOracle:
    """Matrices of a scene about an equilibrium at rest.

    Attributes:
        basis: null space of the constraints, shape (nq, freedoms)
        mass, damping, stiffness: on that basis
        coupling: generalised force of each dissipative coordinate, shape (freedoms, nz)
        follow: deformation that each of them follows, shape (nz, freedoms)
    """

    def __init__(self, scene, q=None, step=1e-5):
        self.scene = scene
        self.q = scene.q0 if q is None else q
        self.z, rest = scene.relaxed(self.q)
        self.zero = np.zeros(scene.nq)
        self.multipliers = scene.solve(0.0, self.q, self.zero, self.z, rest)[1]
        self.basis = scipy.linalg.null_space(scene.jacobian(self.q)) if scene.rows else np.eye(scene.nq)
        n = self.basis
        unit = np.eye(scene.nq)
        self.full_stiffness = self.columns(lambda x: -self.force(self.q + x, self.zero, self.z), unit, step)
        self.full_damping = self.columns(lambda x: -self.force(self.q, x, self.z), unit, step)
        self.full_coupling = self.columns(lambda x: self.force(self.q, self.zero, self.z + x), np.eye(scene.nz), step)
        self.full_follow = self.columns(lambda x: scene.deformations(self.q + x), unit, step)
        self.full_mass = scene.mass_matrix(self.q)
        self.mass, self.damping, self.stiffness = (n.T @ a @ n for a in (self.full_mass, self.full_damping, self.full_stiffness))
        self.coupling, self.follow = n.T @ self.full_coupling, self.full_follow @ n
        self.zeta, self.omega = scene.term_parameters()

    @staticmethod
    def columns(function, directions, step):
        """Return central differences of a function along the rows of `directions`, shape (values, directions)."""
        if not len(directions):
            return np.zeros((len(function(np.zeros(0))), 0))
        return np.array([(function(step * d) - function(-step * d)) / (2 * step) for d in directions]).T

    def force(self, q, v, z):
        """Return all forces with the constraints' at fixed multipliers, shape (nq,)."""
        scene = self.scene
        total = scene.forces(0.0, q, v, z, np.zeros(scene.nz))
        return total - scene.jacobian(q).T @ self.multipliers if scene.rows else total

    def relaxed_stiffness(self):
        """Return the stiffness with the dissipative coordinates following, on the basis."""
        return self.stiffness - self.coupling @ self.follow

    def frequencies(self):
        """Return the undamped angular frequencies [rad/s], ascending."""
        k = self.relaxed_stiffness()
        return np.sqrt(np.abs(scipy.linalg.eigh((k + k.T) / 2, self.mass, eigvals_only=True)))

    def poles(self):
        """Return all eigenvalues of the first-order system [1/s]."""
        n, m = self.mass.shape[0], len(self.zeta)
        a = np.zeros((2 * n + 2 * m, 2 * n + 2 * m))
        a[:n, n : 2 * n] = np.eye(n)
        inverse = np.linalg.inv(self.mass)
        a[n : 2 * n, :n] = -inverse @ self.stiffness
        a[n : 2 * n, n : 2 * n] = -inverse @ self.damping
        a[n : 2 * n, 2 * n : 2 * n + m] = inverse @ self.coupling
        a[2 * n : 2 * n + m, 2 * n + m :] = np.eye(m)
        a[2 * n + m :, :n] = self.omega[:, None] ** 2 * self.follow
        a[2 * n + m :, 2 * n : 2 * n + m] = -np.diag(self.omega**2)
        a[2 * n + m :, 2 * n + m :] = -np.diag(2 * self.zeta * self.omega)
        return np.linalg.eigvals(a)

    def response(self, s, force):
        """Return complex amplitudes of q (nq,) and of the dissipative coordinates (nz,) under a force amplitude (nq,)."""
        ratio = self.omega**2 / (s**2 + 2 * self.zeta * self.omega * s + self.omega**2)
        dynamic = s**2 * self.mass + s * self.damping + self.stiffness - (self.coupling * ratio) @ self.follow
        q = self.basis @ np.linalg.solve(dynamic, self.basis.T @ force)
        return q, ratio * (self.full_follow @ q)

    def equilibrium(self):
        """Return the next estimate of the equilibrium by one Newton step from the present state, shape (nq,)."""
        scene = self.scene
        rows = scene.jacobian(self.q)
        k = self.full_stiffness - self.full_coupling @ self.full_follow
        system = np.block([[k, rows.T], [rows, np.zeros((len(rows), len(rows)))]])
        force = self.force(self.q, self.zero, self.z)
        return self.q + np.linalg.lstsq(system, np.concatenate([force, -scene.phi(0.0, self.q)]), rcond=None)[0][: scene.nq]


def settle(scene, q, passes=12):
    """Return the linear system about the scene's static equilibrium near q."""
    for _ in range(passes):
        about = LinearOracle(scene, q)
        q = about.equilibrium()
        if np.max(np.abs(q - about.q)) < 1e-13:
            break
    return LinearOracle(scene, q)
