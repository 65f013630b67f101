"""Spin softens a linear beam; welded parts or geometric stiffening bring the tension back (theory.md, section 9)."""

from __future__ import annotations

import math

import numpy as np
import pytest

LENGTH, DENSITY, YOUNG, AREA, INERTIA = 10.0, 3000.0, 7.0e10, 4.0e-4, 2.0e-7
UNIT = math.sqrt(YOUNG * INERTIA / (DENSITY * AREA)) / LENGTH**2  # [rad/s]
TABLE = {  # first frequency of 1, 2, 4, 8 bodies by spin; None: unstable
    1: (3.371, 3.471, 3.525, 3.539),
    2: (2.892, 3.324, 3.548, 3.604),
    3: (1.834, 3.038, 3.577, 3.704),
    4: (None, 2.518, 3.595, 3.827),
    6: (None, None, 3.514, 4.102),
}
CHORD = {1: 3.543236270, 2: 3.621796964, 3: 3.743511896, 4: 3.897722524, 6: 4.263225420}  # published, slender beam


def arm(bodies: int, more: str = "") -> str:
    """Return an arm of 8 elements cut into welded bodies, hinged at the hub."""
    text = f"&scene title='arm' /\n&material name='m' density={DENSITY} young={YOUNG} /\n"
    text += f"&section name='s' area={AREA} inertia={INERTIA} /\n&joint name='hub' type='revolute' body_a='b0' node_a=1 /\n"
    piece = LENGTH / bodies
    for k in range(bodies):
        text += f"&body name='b{k}' kind='beam' length={piece!r} elements={8 // bodies} material='m' section='s'\n"
        text += f"  reference='clamped' position={k * piece!r},0.0 {more} /\n"
        if k:
            text += f"&joint name='w{k}' type='weld' body_a='b{k}' node_a=1 body_b='b{k - 1}' node_b=-1 /\n"
    return text


def pole(run_deck, bodies: int, spin: float, more: str = "") -> complex:
    """Return the first pole at a steady spin; both times sqrt(rho A L^4/(E I))."""
    text = arm(bodies, more) + f"&history name='h' kind='polynomial' coefficients={spin * UNIT!r} /\n"
    text += "&drive name='m' type='rotation' body_a='b0' node_a=1 history='h' rate=.true. /\n&static /\n&modal modes=2 /\n"
    run = run_deck(text)
    lines = (run.folder / "modes.txt").read_text(encoding="utf-8").splitlines()
    names = [word.split("[")[0] for word in lines[next(k for k, x in enumerate(lines) if x.startswith("# columns:"))].split()[2:]]
    row = next(line.split() for line in lines if not line.startswith("#"))
    return complex(float(row[names.index("real")]), float(row[names.index("imag")])) / UNIT


@pytest.mark.parametrize("spin", [1, 2, 3])
def test_one_linear_body_softens_with_spin(run_deck, spin):
    """omega^2 = omega_0^2 - Omega^2, the opposite of what a beam does."""
    found = pole(run_deck, 1, spin)
    assert found.imag == pytest.approx(math.sqrt(3.516015268**2 - spin**2), rel=1e-4)
    assert found.imag < CHORD[spin]


def test_one_linear_body_is_unstable_beyond_its_first_frequency(run_deck):
    assert pole(run_deck, 1, 4).real > 1.0


@pytest.mark.parametrize("spin", [2, 4])
def test_cutting_converges_with_the_square_of_the_pieces(run_deck, spin):
    errors = [CHORD[spin] - pole(run_deck, n, spin).imag for n in (2, 4, 8)]
    assert all(error > 0.0 for error in errors)
    for coarse, fine in zip(errors, errors[1:]):
        assert 3.5 < coarse / fine < 5.0


@pytest.mark.parametrize("spin", CHORD)
def test_geometric_stiffening_meets_the_published_frequencies(run_deck, spin):
    assert pole(run_deck, 1, spin, "stiffening=.true.").imag == pytest.approx(CHORD[spin], rel=3e-3)


@pytest.mark.parametrize("spin", TABLE)
def test_the_readmes_table(run_deck, spin):
    for bodies, value in zip((1, 2, 4, 8), TABLE[spin]):
        found = pole(run_deck, bodies, spin)
        if value is None:
            assert found.real > 0.1
        else:
            assert found.imag == pytest.approx(value, abs=6e-4)


def test_cut_arms_spin_up(run_deck):
    """Eight welded bodies lag as the exact beam does, within 1.5 %; four within 6 %."""
    history = "&history name='h' kind='cycloid' start_value=0.0 end_value=6.0 start=0.0 finish=15.0 /\n"
    drive = "&drive name='m' type='rotation' body_a='b0' node_a=1 history='h' rate=.true. /\n"
    for bodies, lag in ((4, 0.605), (8, 0.581)):
        text = arm(bodies) + history + drive
        text += f"&sensor name='tip' quantity='position' body='b{bodies - 1}' node=-1 /\n"
        text += "&sensor name='hub' quantity='angle' body='b0' node=1 /\n"
        h = run_deck(text + "&transient t_end=9.0 method='rk4' step=2.0e-4 output_step=0.02 /\n").history
        across = -np.sin(h["hub"]) * h["tip.x"] + np.cos(h["hub"]) * h["tip.y"]
        assert across.min() == pytest.approx(-lag, abs=1e-3)
        assert abs(-across.min() / 0.57378 - 1.0) < (0.06 if bodies == 4 else 0.015)
