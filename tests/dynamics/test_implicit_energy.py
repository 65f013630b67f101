"""The implicit method's account of energy: work of drives, Rayleigh damping in modes, what it removes from turning lumps."""

import numpy as np
import pytest

DRIVEN = """&scene title='driven' gravity=0.0,-9.81 /
&material name='m' density=1200.0 young=3.0e9 rayleigh_mass=4.0 rayleigh_stiffness=1.0e-4 /
&section name='s' shape='rectangle' width=0.02 height=0.01 /
&body name='crank' kind='rigid' mass=0.5 inertia=1.0e-3 com=0.05,0.0 angle=0.6 /
&body name='rod' kind='beam' length=0.3 elements=3 axial=.false. material='m' section='s' position=0.0825,0.0565 angle=-0.2 {} /
&lump body='rod' node=-1 mass=0.1 inertia=2.0e-3 /
&joint name='axle' type='revolute' body_a='crank' /
&joint name='pin' type='revolute' body_a='rod' node_a=1 body_b='crank' point_b=0.1,0.0 /
&joint name='guide' type='slider' body_a='rod' node_a=-1 /
&history name='h' kind='sine' offset=0.6 amplitude=0.5 frequency=4.0 phase=-1.5707963267948966 /
&drive name='motor' type='rotation' body_a='crank' history='h' /
"""
PLUCKED = """&material name='steel' density=7850.0 young=2.1e11 /
&section name='s' shape='rectangle' width=0.02 height=0.01 /
&body name='arm' kind='beam' length=1.0 elements=2 material='steel' section='s' reference='clamped' {} /
&joint name='w' type='weld' body_a='arm' node_a=1 /
&lump body='arm' node=-1 inertia=0.2 mass=5.0 /
&force name='f' type='torque' body='arm' node=-1 moment=20.0 stage='static' /
&static /
"""


def account(run_deck, deck, t_end, step, radius):
    """Return the energy residual at the end and what the method says that it removed [J]."""
    deck += f"&transient method='generalized_alpha' t_end={t_end} step={step} output_step={step * 10} spectral_radius={radius} /\n"
    run = run_deck(deck, name=f"h{step}r{radius}")
    return run.energy["residual"][-1], run.transient["energy_removed"]


@pytest.mark.parametrize("radius", [0.0, 0.9])
@pytest.mark.parametrize("rest", ["", "modes=2"])
def test_a_driven_damped_rod_with_a_turning_lump(run_deck, rest, radius):
    """What is left of the residual falls fourfold: a wrong drive power, damping power or mass leaves more, or falls less."""
    left = [sum(account(run_deck, DRIVEN.format(rest), 0.2, step, radius)) for step in (4e-5, 2e-5)]
    assert 1.9 < np.log2(abs(left[0] / left[1])) < 2.1
    assert abs(left[1]) < 1e-7


@pytest.mark.parametrize("rest", ["", "modes=4"])
def test_the_removed_energy_counts_the_inertia_of_lumps(run_deck, rest):
    """Most of the vibration that these steps damp turns a heavy lump."""
    residual, removed = account(run_deck, PLUCKED.format(rest), 0.08, 2e-3, 0.0)
    assert residual < -1e-3
    assert abs(residual + removed) < 0.03 * abs(residual)
