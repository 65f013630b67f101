"""The elastic twin of a viscoelastic body: the static modulus, or the storage modulus at a frequency."""

from __future__ import annotations

import numpy as np
import pytest

TERMS = "ghm_alpha={} ghm_zeta={} ghm_omega={}"
DECK = """&material name='m' density=1200.0 young={young!r} {ghm} /
&section name='s' shape='rectangle' width=0.02 height=0.01 /
&body name='b' kind='{kind}' {shape} material='m' section='s' {words} /
&joint name='j' type='weld' body_a='b' node_a=1 /
&sensor name='tip' quantity='deflection' body='b' node=-1 /
&force name='f' type='force' body='b' node=-1 fy=3.0 /
&transient method='generalized_alpha' step=1e-3 t_end=0.05 /
"""
SHAPES = {
    "beam": "length=0.5 elements=4 reference='clamped'",
    "frame": "node_x=0.0,0.2,0.4 node_y=0.0,0.1,0.0 element_nodes=1,2,2,3 reference='clamped'",
}


def storage(alpha, zeta, omega, frequency: float) -> float:
    """Return the real part of E/E_R."""
    s = 2j * np.pi * frequency
    return 1.0 + float((alpha * (s**2 + 2 * zeta * omega * s) / (s**2 + 2 * zeta * omega * s + omega**2)).sum().real)


@pytest.mark.parametrize("kind", SHAPES)
@pytest.mark.parametrize("modes", [0, 3])
@pytest.mark.parametrize("frequency", [0.0, 7.0, 300.0])
def test_the_twin_has_the_storage_modulus_of_its_frequency(run_deck, kind, modes, frequency):
    rng = np.random.default_rng([modes, int(frequency)])
    alpha, zeta, omega = rng.uniform(0.1, 2.0, 3), rng.uniform(0.5, 3.0, 3), 10.0 ** rng.uniform(1.0, 4.0, 3)
    ghm = TERMS.format(*(",".join(map(repr, x.tolist())) for x in (alpha, zeta, omega)))
    shape = f"{SHAPES[kind]} modes={modes}"
    words = "viscoelastic=.false." + f" modulus_at={frequency!r}" * (frequency > 0)
    twin = run_deck(DECK.format(young=3.0e9, ghm=ghm, kind=kind, shape=shape, words=words), name="twin")
    young = 3.0e9 * storage(alpha, zeta, omega, frequency)
    plain = run_deck(DECK.format(young=young, ghm="", kind=kind, shape=shape, words=""), name="plain")
    np.testing.assert_allclose(twin.history.data, plain.history.data, rtol=1e-9, atol=1e-9 * np.abs(plain.history.data).max())
    told = (twin.folder / "summary.txt").read_text()
    assert ("static modulus E_R" if frequency == 0 else f"modulus at {frequency:g} Hz") in told
