"""The solver against Lagrange's equations of the interpolated field, at random states of small scenes.

The oracle takes the kinetic energy by Gauss quadrature of 1/2 rho A |r'|^2 and everything else from energies, virtual
work and geometry; no assembled integral of the solver's is used.
"""

import numpy as np
import pytest
from oracle_probe import Twins, largest_error
from scenes import ALL, BODIES, LOOPS, MODAL

TOLERANCE = 1e-10


@pytest.mark.parametrize("name", ALL)
def test_accelerations_forces_and_energies(name, probe, tmp_path):
    twins = Twins(probe, tmp_path, ALL[name])
    states = twins.random_states(sum(map(ord, name)), 4)
    if name == "redundant":  # away from its positions a redundant set of rows contradicts itself
        states = [twins.closed_state(seed) for seed in range(3)]
    kinds = twins.kinds()
    for (t, q, v, z, zd), answer in zip(states, twins.evaluate(states)):
        acceleration, multipliers, forces = twins.oracle.solve(t, q, v, z, zd)
        assert largest_error(answer.acceleration, acceleration, kinds) < TOLERANCE
        assert largest_error(answer.zdd, twins.oracle.dissipative_accelerations(q, z, zd)) < TOLERANCE
        others = twins.oracle.forces(t, q, v, z, zd)
        forces_kinds = [(kind, 1.0 / weight) for kind, weight in kinds]
        assert largest_error(answer.constraint_forces, forces, forces_kinds, others) < TOLERANCE
        energies = np.array([twins.oracle.kinetic(q, v), twins.oracle.potential(q, z, zd)])
        np.testing.assert_allclose(answer.energy, energies, rtol=1e-12, atol=1e-12 * np.abs(energies).max())
        power = np.array([twins.oracle.dissipated_power(q, v, zd), twins.oracle.input_power(t, q, v, multipliers)])
        np.testing.assert_allclose(answer.power, power, rtol=TOLERANCE, atol=TOLERANCE * np.abs(power).max())


@pytest.mark.parametrize("name", [name for name in ALL if name not in BODIES])
def test_constraint_rows(name, probe, tmp_path):
    """Rows may be scaled (angles by the scene's size); value, rate, curvature and Jacobian carry the same factor."""
    twins = Twins(probe, tmp_path, ALL[name])
    states = twins.random_states(5, 3)
    for (t, q, v, _, _), answer in zip(states, twins.evaluate([*states])):
        expected = twins.oracle.jacobian(q)
        scale = (answer.jacobian * expected).sum(axis=1) / (expected * expected).sum(axis=1)
        assert np.all(np.minimum(np.abs(scale - 1.0), np.abs(scale - twins.oracle.size)) < 1e-9)
        speed = np.abs(v).max()
        for found, rows, size in (
            (answer.jacobian.T, expected.T, 1.0),
            (answer.phi, twins.oracle.phi(t, q), 1.0),
            (answer.phidot, twins.oracle.phi_rate(t, q, v), speed),
            (answer.gamma, twins.oracle.gamma(t, q, v), speed**2),
        ):
            np.testing.assert_allclose(found, rows * scale, rtol=TOLERANCE, atol=1e-12 * size)


@pytest.mark.parametrize("name", [*LOOPS, *(name for name in MODAL if name != "modal_frame")])
def test_assembled_state_closes(name, probe, tmp_path):
    twins = Twins(probe, tmp_path, ALL[name])
    size = twins.oracle.size
    assert np.abs(twins.oracle.phi(0.0, twins.q0)).max(initial=0.0) < 1e-12 * max(size, 1.0)
    assert np.abs(twins.oracle.phi_rate(0.0, twins.q0, twins.v0)).max(initial=0.0) < 1e-10
