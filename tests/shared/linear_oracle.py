"""Linearised mechanisms as dense matrices on the null space of the constraints, and all of their poles.

`LinearOracle`: mass, damping and stiffness are central differences of the oracle's forces about a state of rest, constraints its
Jacobian; dissipative coordinates are eliminated at each frequency or kept as unknowns. Nothing of the solver is used.
`Dense`: matrices of the solver's linearisation, which test_linearisation.py holds against finite differences, with numpy's
eigenvalues. `TurningArm`: an arm at a constant spin.
"""

import subprocess

import numpy as np
import scipy.linalg
from biela.histories import read
from linearised import evaluate, layout


def first_order(stiffness, damping, terms, scale):
    """Return the matrix of x'' + C x' + K u = c z, z'' + 2 zeta omega z' + omega^2 z = omega^2 f u for (u, x', z, z'/omega).

    u is x times a scale (n,); the terms are c (n, m), f (m, n), zeta and omega (m,).
    """
    coupling, follow, zeta, omega = terms
    n, m = coupling.shape
    x, v, z, y = (slice(a, b) for a, b in ((0, n), (n, 2 * n), (2 * n, 2 * n + m), (2 * n + m, 2 * n + 2 * m)))
    a = np.zeros((2 * n + 2 * m, 2 * n + 2 * m))
    a[x, v], a[z, y] = np.diag(scale), np.diag(omega)
    a[v, x], a[v, v], a[v, z] = -stiffness, -damping, coupling
    a[y, x], a[y, z], a[y, y] = omega[:, None] * follow, -np.diag(omega), -np.diag(2 * zeta * omega)
    return a


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
        k, c, coupling = (np.linalg.solve(self.mass, a) for a in (self.stiffness, self.damping, self.coupling))
        terms = coupling, self.follow, self.zeta, self.omega
        return np.linalg.eigvals(first_order(k, c, terms, np.ones(len(k))))

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


class TurningArm:
    """An arm at a constant spin as the oracle sees it: first-order equations of its elastic and dissipative coordinates."""

    def __init__(self, scene):
        self.scene = scene
        self.spin = scene.rows[-1].history.value(0.0, 1)
        self.elastic = np.arange(3, scene.nq)
        self.n, self.m = len(self.elastic), scene.nz
        self.state = np.zeros(2 * self.n + 2 * self.m)
        for _ in range(8):
            self.state = self.state - np.linalg.solve(self.slopes(), self.rate(self.state))

    def rate(self, y, t=0.0):
        """Return dy/dt of (q_f, q_f', z, z'); the arm's angle stays 0, loads are those of time t."""
        scene, n, m = self.scene, self.n, self.m
        q, v = scene.q0.copy(), np.zeros(scene.nq)
        q[self.elastic], v[self.elastic], v[2] = y[:n], y[n : 2 * n], self.spin
        q[2] = self.spin * t
        z, zd = y[2 * n : 2 * n + m], y[2 * n + m :]
        a = scene.solve(t, q, v, z, zd)[0]
        return np.concatenate([v[self.elastic], a[self.elastic], zd, scene.dissipative_accelerations(q, z, zd)])

    def slopes(self):
        """Return the Jacobian at the present state by central differences."""
        n, m = self.n, self.m
        steps = 1e-6 * np.concatenate([np.ones(n), np.full(n, 1e3), np.ones(m), np.full(m, 1e3)])
        return np.array([(self.rate(self.state + h) - self.rate(self.state - h)) / (2 * h.max()) for h in np.diag(steps)]).T


class Dense:
    """The linearised scene on the null space of its constraints.

    Attributes:
        mass, gyro, damping, stiffness: (p, p)
        parts: (alpha, zeta, omega, K_r) of each distinct set of terms
    """

    def __init__(self, probe, path):
        nq, nz, rows, _ = layout(str(path))
        text = subprocess.run([str(probe), "layout", str(path)], check=True, capture_output=True, text=True).stdout
        initial = [np.array(line.split()[1:], float) for line in text.splitlines() if line.startswith("initial")]
        state = [0.0, *initial[0], *initial[1], *np.zeros(2 * nz)]
        named = evaluate(str(path), [state], "linear")[0]
        base, runs = {}, []
        for key, value in named:
            if key == "run":
                runs.append([value.reshape(3, -1)])
            elif key == "run_stiffness":
                runs[-1].append(value.reshape(nq, nq).T)
            else:
                base[key] = value
        null = np.eye(nq)
        if rows:
            jac = base["rows"].reshape(nq, rows).T
            _, s, vt = np.linalg.svd(jac)
            null = vt[int((s > 1e-9 * s.max()).sum()) :].T
        full = {k: base[k].reshape(nq, nq).T for k in ("mass", "damping", "stiffness")}
        mass = null.T @ full["mass"] @ null
        null = null @ np.linalg.inv(np.linalg.cholesky((mass + mass.T) / 2)).T
        damping = null.T @ full["damping"] @ null
        self.stiffness = null.T @ full["stiffness"] @ null
        self.gyro, self.damping = (damping - damping.T) / 2, (damping + damping.T) / 2
        sets = {}
        for terms, k in runs:
            key = terms.tobytes()
            sets.setdefault(key, [terms, 0.0])
            sets[key][1] = sets[key][1] + null.T @ k @ null
        self.parts = list(sets.values())
        self.modes = np.linalg.eigh((self.stiffness + self.stiffness.T) / 2)[1]
        for name in ("stiffness", "gyro", "damping"):
            setattr(self, name, self.modes.T @ getattr(self, name) @ self.modes)
        self.parts = [(terms, self.modes.T @ k @ self.modes) for terms, k in self.parts]

    def matrix(self, share):
        """Return the matrix of first order with a share of the damping."""
        p = len(self.stiffness)
        whole = np.abs(np.diag(self.stiffness)) + sum(t[0].sum() * np.diag(k) for t, k in self.parts)
        scale = np.sqrt(np.maximum(whole, 1e-9 * whole.max() + 1e-30))
        stiffness, blocks = self.stiffness / scale, [(np.zeros((p, 0)), np.zeros((0, p)), [], [])]
        for terms, k in self.parts if share else []:
            w, v = np.linalg.eigh((k + k.T) / 2 / np.outer(scale, scale))
            f = (v * np.sqrt(np.maximum(w, 0.0)))[:, w > 1e-9]
            for alpha, zeta, omega in terms.T:
                stiffness += share * alpha * scale[:, None] * (f @ f.T)
                blocks.append((share * alpha * scale[:, None] * f, f.T, np.full(f.shape[1], zeta), np.full(f.shape[1], omega)))
        terms = [np.concatenate(parts, axis=axis) for parts, axis in zip(zip(*blocks), (1, 0, 0, 0))]
        return first_order(stiffness, self.gyro + share * self.damping, terms, scale)

    def poles(self, share=1.0):
        """Return all poles with Im >= 0 in which the mechanism moves."""
        values = np.linalg.eigvals(self.matrix(share))
        values = values[np.abs(values) > 1e-6 * np.abs(values).max() ** 0.5]
        for terms, _ in self.parts if share else []:
            for _, zeta, omega in terms.T:
                values = values[np.abs(values**2 + 2 * zeta * omega * values + omega**2) > 1e-6 * omega**2]
        return values[values.imag >= 0.0]

    def dynamic(self, s, share):
        """Return T(s) and its derivative."""
        t = s * s * np.eye(len(self.stiffness)) + s * (self.gyro + share * self.damping) + self.stiffness
        slope = 2 * s * np.eye(len(self.stiffness)) + self.gyro + share * self.damping
        for terms, k in self.parts:
            for alpha, zeta, omega in terms.T:
                below = s * s + 2 * zeta * omega * s + omega**2
                t = t + share * alpha * (below - omega**2) / below * k
                slope = slope + share * alpha * 2 * (s + zeta * omega) * omega**2 / below**2 * k
        return t, slope

    def follow(self, s, x, steps=150):
        """Return what an undamped pole becomes while the damping grows, None where it meets the real axis or is not sure."""
        for i in range(1, steps + 1):
            before = s
            for _ in range(20):
                t, slope = self.dynamic(s, (i / steps) ** 1.5)
                try:
                    u = np.linalg.solve(t, slope @ x)
                except np.linalg.LinAlgError:  # singular to the last bit: the iteration ends there
                    left, values, right = np.linalg.svd(t)
                    u = right.conj().T @ (left.conj().T @ (slope @ x) / np.maximum(values, 1e-16 * values[0]))
                step = np.vdot(x, x) / np.vdot(x, u)
                s, x = s - step, u / np.linalg.norm(u)
                if abs(step) < 1e-12 * abs(s):
                    break
            if s.imag < 1e-3 * abs(s) or abs(s - before) > 0.1 * abs(s):
                return None
        return s


def compare_linear(run, mass, damping, stiffness):
    """Hold damped modes and the response of `at.x` to a unit force on the second freedom to dense matrices of two freedoms."""
    poles = np.linalg.eigvals(np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(mass, np.hstack([stiffness, damping]))]]))
    found = [p for p in run.figures["modes"]["poles"] if p["kind"] != "undamped"]
    found = [complex(p["real_part"], 2 * np.pi * p["frequency"]) for p in found]
    np.testing.assert_allclose(np.sort_complex(found), np.sort_complex(poles[poles.imag > 0]), rtol=1e-7)
    response = read(run.folder / "frequency_response.txt")
    s = 2j * np.pi * response["f"]
    b = [np.linalg.solve(mass * si**2 + damping * si + stiffness, [0, 1])[1] for si in s]
    np.testing.assert_allclose(response["at.x.re"] + 1j * response["at.x.im"], b, rtol=1e-9)
