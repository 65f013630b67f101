"""Time domain, frequency domain, eigenvalues and the paper's own augmented matrices (Vaz, Rade & Lima, Eq. 31) tell one story.

For damping ratios of the GHM oscillator below, at and above one. The literal matrices are built here, dense, from the textbook:

    M_G = [[M, 0], [0, alpha/omega^2 K0]]   C_G = [[0, 0], [0, 2 alpha zeta/omega K0]]
    K_G = [[K0 (1 + alpha), -alpha K0], [-alpha K0, alpha K0]]
"""

import numpy as np
import pytest
import scipy.linalg
from linear_scenes import FORCE, FURTHER, REAL, VIBRATION, Modes, Response, beam, sweep, textbook_cantilever

ALPHA, OMEGA = 0.5, 900.0
ZETAS = [0.6, 1.0, 1.7]
PLUCK = "&force name='pluck' type='force' body='b' node=-1 fy=2.0 stage='static' /\n"


class Literal:
    """Eq. 31 of a clamped beam of two elements, one GHM term."""

    def __init__(self, zeta, elements=2):
        mass, k0 = textbook_cantilever(elements)
        zero, n = np.zeros_like(k0), len(k0)
        self.n = n
        self.mass = np.block([[mass, zero], [zero, ALPHA / OMEGA**2 * k0]])
        self.damping = np.block([[zero, zero], [zero, 2 * ALPHA * zeta / OMEGA * k0]])
        self.stiffness = np.block([[(1 + ALPHA) * k0, -ALPHA * k0], [-ALPHA * k0, ALPHA * k0]])
        self.k0 = k0
        inverse = np.linalg.inv(self.mass)
        self.first_order = np.block(
            [[np.zeros((2 * n, 2 * n)), np.eye(2 * n)], [-inverse @ self.stiffness, -inverse @ self.damping]]
        )

    def poles(self):
        """Return all eigenvalues [1/s]."""
        return np.linalg.eigvals(self.first_order)

    def response(self, s):
        """Return the tip's transverse amplitude under a unit force there [m]."""
        force = np.zeros(2 * self.n)
        force[self.n - 2] = 1.0
        return np.linalg.solve(s**2 * self.mass + s * self.damping + self.stiffness, force)[self.n - 2]

    def release(self, times):
        """Return the tip's deflection after the release from a static force of 2 N, relaxed [m]."""
        force = np.zeros(self.n)
        force[-2] = 2.0
        start = np.linalg.solve(self.k0, force)
        state = np.concatenate([start, start, np.zeros(2 * self.n)])
        step = scipy.linalg.expm(self.first_order * (times[1] - times[0]))
        found = []
        for _ in times:
            found.append(state[self.n - 2])
            state = step @ state
        return np.array(found)


def ghm(zeta):
    """Return the material's GHM variables."""
    return f"ghm_alpha={ALPHA} ghm_zeta={zeta} ghm_omega={OMEGA}"


def bending_poles(modes):
    """Return the poles of modes with transverse motion, one of each conjugate pair."""
    shape = np.array([modes.table[name] for name in modes.table.names if name.startswith("b.") and ".y." in name])
    return modes.poles[(modes.kind >= VIBRATION) & (np.abs(shape).max(axis=0) > 0.1)]


def fit_poles(times, values, count):
    """Return the poles of a sum of exponentials by linear prediction (least squares), slowest decay first."""
    n = len(values)
    columns = np.array([values[count - 1 - k : n - 1 - k] for k in range(count)]).T
    coefficients = np.linalg.lstsq(columns, values[count:], rcond=None)[0]
    roots = np.roots(np.concatenate([[1.0], -coefficients])).astype(complex)
    poles = np.log(roots) / (times[1] - times[0])
    return poles[np.argsort(-poles.real)]


@pytest.mark.parametrize("zeta", ZETAS)
def test_eigenvalues_frequency_and_time_domain_and_literal_matrices_agree(run_deck, zeta):
    literal = Literal(zeta)
    common = beam(2, ghm=ghm(zeta), modes=6) + PLUCK + FORCE.replace("/\n", "stage='transient' history='none' /\n", 1)
    common += "&history name='none' kind='polynomial' coefficients=0.0 /\n&static /\n"
    run = run_deck(common + sweep(1.0, 3000.0, 25) + "&transient t_end=0.6 method='rk4' step=1.0e-5 output_step=2.0e-4 /\n")
    # eigenvalues: all poles of bending, the paper's matrices have no others
    poles, expected = bending_poles(Modes(run)), literal.poles()
    expected = expected[expected.imag >= -1e-9]
    assert len(poles) == len(expected)
    for s in poles:
        assert np.min(np.abs(expected - s)) < 1e-8 * abs(s)
    # frequency response
    response = Response(run)
    np.testing.assert_allclose(response["tip.v"], [literal.response(s) for s in response.s], rtol=1e-9)
    # transient from the static state
    times = run.history.time
    exact = literal.release(times)
    assert np.max(np.abs(run.history["tip.v"] - exact)) < 1e-7 * exact[0]
    # the decay is that of the first mode once the others are gone
    late = np.flatnonzero(times > 0.3)[::40]
    modes = Modes(run)
    first = modes.poles[modes.kind == VIBRATION][0]
    fitted = fit_poles(times[late], run.history["tip.v"][late], 2)
    nearest = fitted[np.argmin(np.abs(fitted - first))]
    assert -nearest.real / abs(nearest) == pytest.approx(-first.real / abs(first), rel=1e-3)
    assert abs(nearest) == pytest.approx(abs(first), rel=1e-4)


@pytest.mark.parametrize(("zeta", "pairs", "real"), [(0.6, 2, 0), (1.7, 1, 2)])
def test_kinds_of_poles_follow_the_damping_ratio_of_the_term(run_deck, zeta, pairs, real):
    modes = Modes(run_deck(beam(2, ghm=ghm(zeta), modes=1)))
    assert np.sum((modes.kind == VIBRATION) | (modes.kind == FURTHER)) == pairs
    assert np.sum(modes.kind == REAL) == real


def sweep_table(start, stop, end, points):
    """Return times, values and instantaneous frequency of a linear sine sweep [s, -, Hz]."""
    times = np.linspace(0.0, end, points)
    phase = 2 * np.pi * (start * times + (stop - start) * times**2 / (2 * end))
    return times, np.sin(phase), start + (stop - start) * times / end


def test_slow_sine_sweep_gives_the_amplitude_of_the_response(run_deck):
    material = "ghm_alpha=1.5 ghm_zeta=1.0 ghm_omega=150.0"
    times, values, frequency = sweep_table(8.0, 20.0, 12.0, 9601)
    table = "&history name='sweep' kind='table'\n  time=" + ",\n  ".join(f"{t:.6f}" for t in times)
    table += "\n  value=" + ",\n  ".join(f"{v:.12f}" for v in values) + " /\n"
    deck = (
        beam(1, ghm=material)
        .replace("&modal modes=3 /\n", "")
        .replace("reference='clamped' /", "reference='clamped' axial=.false. /")
    )
    deck += table + FORCE.replace("fy=1.0", "fy=1.0 history='sweep'") + sweep(8.0, 20.0, 121, "linear")
    run = run_deck(deck + "&transient t_end=12.0 method='rk4' step=2.5e-4 output_step=5.0e-4 /\n")
    amplitude = Response(run).table["tip.v.amplitude"]
    grid = Response(run).table["f"]
    t, v = run.history.time, run.history["tip.v"]
    peaks = np.flatnonzero((np.abs(v[1:-1]) > np.abs(v[:-2])) & (np.abs(v[1:-1]) >= np.abs(v[2:]))) + 1
    peaks = peaks[(t[peaks] > 0.5) & (t[peaks] < 11.8)]
    expected = np.interp(np.interp(t[peaks], times, frequency), grid, amplitude)
    assert len(peaks) > 100
    assert expected.max() > 1.3 * expected.min(), "the resonance lies in the sweep"
    np.testing.assert_allclose(np.abs(v[peaks]), expected, rtol=0.01)
