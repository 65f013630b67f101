"""The derivatives with which generalized_alpha starts in motion, and where a load jumps."""

import numpy as np
import pytest

ARM = """&material name='m' density=1600.0 young=2.1e9 ghm_alpha=2.0 ghm_zeta=0.7 ghm_omega=200.0 /
&section name='s' shape='rectangle' width=0.02 height=0.02 /
&body name='arm' kind='beam' length=0.4 elements=1 material='m' section='s' reference='clamped' {modes} /
&joint name='w' type='weld' body_a='arm' node_a=1 /
&force name='f' type='force' body='arm' node=-1 fy=10.0 history='h' /
&history name='h' kind='pulse' value=1.0 start=0.0 finish=8e-3 /
&sensor name='tip' quantity='deflection' body='arm' node=-1 /
"""


@pytest.mark.parametrize("radius", [0.0, 0.9])
@pytest.mark.parametrize("modes", ["", "modes=2"])
def test_a_start_in_motion_keeps_order_two_in_dissipative_coordinates(modes, radius, run_deck):
    """Where the pulse ends the method starts anew, and dissipative coordinates have rates and accelerations there."""
    scene = ARM.format(modes=modes)
    exact = run_deck(scene + "&transient method='dopri5' t_end=0.016 tolerance=1e-11 output_step=2e-3 /\n", name="exact").history
    errors = []
    for step in (4e-5, 2e-5, 1e-5):
        ends = f"t_end=0.016 step={step} spectral_radius={radius} output_step=2e-3"
        found = run_deck(scene + f"&transient method='generalized_alpha' {ends} /\n", name=f"s{step}").history
        errors.append(np.abs(found["tip.v"] - exact["tip.v"])[5:].max())
    assert np.log2(errors[1] / errors[2]) > 1.85, errors


def test_a_start_in_motion_has_the_energy_it_dissipates(run_deck):
    """Dissipation just after the pulse, from the rates of dissipative coordinates: order 2 at the first rows."""
    scene = ARM.format(modes="")
    ends = "t_end=8.4e-3 output_step=2e-4"
    exact = run_deck(scene + f"&transient method='dopri5' tolerance=1e-11 {ends} /\n", name="exact").energy
    errors = []
    for step in (2e-5, 1e-5):
        found = run_deck(scene + f"&transient method='generalized_alpha' step={step} {ends} /\n", name=f"s{step}").energy
        errors.append(np.abs(found["dissipated"] - exact["dissipated"])[-2:].max())
    assert np.log2(errors[0] / errors[1]) > 1.85, errors
