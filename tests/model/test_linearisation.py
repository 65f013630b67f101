"""The linearised matrices against finite differences of the accelerations, term by term, at random states."""

import subprocess

import numpy as np
import pytest
from linearised import DECKS, PROBE, SENSOR, evaluate, layout
from scipy.linalg import eigh


@pytest.mark.parametrize("name", DECKS)
def test_matrices_against_finite_differences(name, tmp_path):
    """N^T (M x'' + C x' + K x + GHM) = 0 for random perturbations, N the null space of the constraint rows."""
    deck = tmp_path / "deck.nml"
    deck.write_text(SENSOR + DECKS[name])
    nq, nz, rows, bodies = layout(str(deck))
    rng = np.random.default_rng(5)
    initial = subprocess.run([PROBE, "layout", str(deck)], check=True, capture_output=True, text=True).stdout
    q0 = np.array([float(x) for x in [s for s in initial.splitlines() if s.startswith("initial")][0].split()[1:]])
    frames = np.zeros(nq, dtype=bool)
    for b in bodies:
        frames[b : b + 3] = True
    q = q0 + np.where(frames, 0.0, 2e-3 * rng.standard_normal(nq))
    v = np.where(frames, 3.0, 0.3) * rng.standard_normal(nq)
    z = 1e-3 * rng.standard_normal(nz)
    zd = 0.3 * rng.standard_normal(nz)
    base = dict()
    named = evaluate(str(deck), [[0.0, *q, *v, *z, *zd]], "linear")[0]
    runs = []
    for key, value in named:
        if key == "run":
            runs.append([value.reshape(3, -1)])
        elif key == "run_stiffness":
            runs[-1].append(value.reshape(nq, nq).T)
        else:
            base[key] = value
    mass, damping, stiffness = (base[k].reshape(nq, nq).T for k in ("mass", "damping", "stiffness"))
    jac = base["rows"].reshape(nq, rows).T
    acc = base["acceleration"]
    _, s, vt = np.linalg.svd(jac) if rows else (None, np.zeros(0), np.eye(nq))
    null = vt[int((s > 1e-9 * s.max()).sum()) if rows else 0 :].T
    for _ in range(4):
        x, xd = rng.standard_normal(nq) * np.where(frames, 1.0, 0.05), rng.standard_normal(nq)
        dq, dv = x.copy(), xd.copy()
        for b in bodies:
            rot = np.array([[np.cos(q[b + 2]), -np.sin(q[b + 2])], [np.sin(q[b + 2]), np.cos(q[b + 2])]])
            turn = np.array([[0.0, -1.0], [1.0, 0.0]])
            dq[b : b + 2] = rot @ x[b : b + 2]
            dv[b : b + 2] = rot @ (xd[b : b + 2] + v[b + 2] * turn @ x[b : b + 2])
        h = 2e-5
        plus, plus2, minus2, minus = (
            dict(r)["acceleration"]
            for r in evaluate(str(deck), [[0.0, *(q + k * h * dq), *(v + k * h * dv), *z, *zd] for k in (1, 2, -2, -1)])
        )
        da = (8 * (plus - minus) - (plus2 - minus2)) / (12 * h)
        xdd = da.copy()
        for b in bodies:
            w = v[b + 2]
            back = np.array([[np.cos(q[b + 2]), np.sin(q[b + 2])], [-np.sin(q[b + 2]), np.cos(q[b + 2])]])
            xdd[b : b + 2] = (
                back @ da[b : b + 2] - 2 * w * turn @ xd[b : b + 2] - (acc[b + 2] * turn - w**2 * np.eye(2)) @ x[b : b + 2]
            )
        terms = [mass @ xdd, damping @ xd, stiffness @ x]
        terms += [alpha * (k @ x) for par, k in runs for alpha in par[0]]
        residual = null.T @ sum(terms)
        scale = max(np.abs(null.T @ t).max() for t in terms)
        assert np.abs(residual).max() < 2e-7 * scale


def element(length, mass, young, area, inertia):
    """Mass and stiffness (6, 6) of an Euler-Bernoulli element along x: u, v, rotation of both nodes."""
    m, k, bend = np.zeros((6, 6)), np.zeros((6, 6)), [1, 2, 4, 5]
    s = np.diag([1.0, length, 1.0, length])
    m[np.ix_([0, 3], [0, 3])] = mass / 6 * np.array([[2, 1], [1, 2]])
    m[np.ix_(bend, bend)] = mass / 420 * s @ [[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]] @ s
    k[np.ix_([0, 3], [0, 3])] = young * area / length * np.array([[1, -1], [-1, 1]])
    k[np.ix_(bend, bend)] = young * inertia / length**3 * s @ [[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]] @ s
    return m, k


@pytest.mark.parametrize("seed", range(4))
def test_stiffness_of_each_material_of_a_body_in_modes(seed, tmp_path):
    """Each is the sum over its elements, reduced to the modes: equal but for the signs of modes."""
    rng = np.random.default_rng(seed)
    ne, modes, area, inertia = int(rng.integers(6, 12)), 4, 6.0e-5, 2.0e-10
    density, young = rng.uniform(1e3, 3e3, 4), rng.uniform(1e9, 5e9, 4)
    names = rng.permutation([*range(4), *rng.integers(0, 4, ne - 4)])  # the last material is elastic
    deck = tmp_path / "deck.nml"
    text = f"&section name='s' area={area} inertia={inertia} /\n"
    for k in range(4):
        law = f"ghm_alpha={0.1 * (k + 1):.1f} ghm_zeta=1.0 ghm_omega=500.0" if k < 3 else ""
        text += f"&material name='m{k}' density={density[k]} young={young[k]} {law} /\n"
    listed = ",".join(f"'m{k}'" for k in names)
    deck.write_text(
        text + f"&body name='b' kind='beam' length=0.6 elements={ne} element_material={listed} section='s' "
        f"reference='clamped' modes={modes} /\n"
    )
    mass, parts = np.zeros((3 * ne + 3, 3 * ne + 3)), np.zeros((4, 3 * ne + 3, 3 * ne + 3))
    for e, k in enumerate(names):
        at = np.ix_(*[range(3 * e, 3 * e + 6)] * 2)
        m, stiffness = element(0.6 / ne, density[k] * area * 0.6 / ne, young[k], area, inertia)
        mass[at] += m
        parts[k][at] += stiffness
    _, x = eigh(parts.sum(0)[3:, 3:], mass[3:, 3:], subset_by_index=[0, modes - 1])
    expected = {0.1 * (k + 1): x.T @ parts[k][3:, 3:] @ x for k in range(3)}
    nq, nz, _, _ = layout(str(deck))
    found, alpha = {}, None
    for key, value in evaluate(str(deck), [np.zeros(1 + 2 * nq + 2 * nz)], "linear")[0]:
        if key == "run":
            alpha = value[0]
        elif key == "run_stiffness":
            found[alpha] = value.reshape(nq, nq)[3:, 3:]
    assert sorted(found) == pytest.approx(sorted(expected)), f"seed {seed}"
    for one, other in zip(sorted(found), sorted(expected)):
        k = expected[other]
        np.testing.assert_allclose(np.abs(found[one]), np.abs(k), rtol=0, atol=1e-8 * np.abs(k).max(), err_msg=f"seed {seed}")
        loop = [m[0, 1] * m[1, 2] * m[2, 0] for m in (found[one], k)]  # signs of modes cancel
        assert loop[0] == pytest.approx(loop[1], rel=1e-6), f"seed {seed}"
