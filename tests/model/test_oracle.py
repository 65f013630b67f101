"""The independent test model itself: the first rows of the reference scenes, integrated with another method."""

import numpy as np
import pytest
from biela.histories import read
from conftest import REFERENCE
from oracle import Scene
from scipy.integrate import solve_ivp

ROWS = {"vrl_elastic": 1, "vrl_ghm": 1, "vrl_torque_on_rod": 1, "viscoelastic_joint": 1, "spin_up": 1, "andrews": 3}
LONG = ("viscoelastic_joint", "spin_up")


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.long] * (name in LONG)) for name in ROWS])
def test_reference_scenes(name):
    scene = Scene(REFERENCE / name / "deck.nml")
    expected = read(REFERENCE / name / "expected.csv")
    times = expected.time[: ROWS[name] + 1]
    start = np.concatenate([scene.q0, scene.deck_v, *scene.relaxed(scene.q0)])
    run = solve_ivp(scene.derivative, (0.0, times[-1]), start, "DOP853", t_eval=times, rtol=1e-10, atol=1e-13)
    for row, t in enumerate(times):
        values = scene.sensor_columns(t, *scene.split(run.y[:, row]))
        for column in expected.names[1:]:
            scale = np.ptp(expected[column]) or 1.0
            assert abs(values[column] - expected[column][row]) < 2e-9 * scale, (column, t)


def test_energy_is_an_integral_of_the_undamped_motion():
    """T + V of the oracle follows the power of its own load: M, bias, forces and energies belong together."""
    scene = Scene(REFERENCE / "vrl_ghm" / "deck.nml")
    rng = np.random.default_rng(1)
    q = scene.q0 + 1e-3 * rng.standard_normal(scene.nq)
    v, z, zd = (scale * rng.standard_normal(n) for scale, n in ((2.0, scene.nq), (1e-3, scene.nz), (0.3, scene.nz)))
    a, multipliers, forces = scene.solve(0.0, q, v, z, zd)
    zdd = scene.dissipative_accelerations(q, z, zd)
    step = 1e-6

    def energy(s):
        state = [x + s * dx for x, dx in ((q, v), (v, a), (z, zd), (zd, zdd))]
        return scene.kinetic(*state[:2]) + scene.potential(state[0], *state[2:])

    rate = (8 * (energy(step) - energy(-step)) - energy(2 * step) + energy(-2 * step)) / (12 * step)
    powers = [scene.input_power(0.0, q, v, multipliers), -scene.dissipated_power(q, v, zd), forces @ v]
    assert abs(rate - sum(powers)) < 1e-8 * max(abs(p) for p in powers)
