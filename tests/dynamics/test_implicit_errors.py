"""The implicit method's estimate of its local error against what a step really errs by, and the derivatives it starts with."""


import numpy as np
import pytest

POINT = """&body name='b' kind='rigid' mass=1.0 inertia=1.0 position={x},0.0 velocity={v},0.0 /
&history name='h' kind='polynomial' coefficients={force} /
&force name='f' type='force' body='b' fx=1.0 history='h' /
&sensor name='x' quantity='position' body='b' /
&sensor name='v' quantity='velocity' body='b' /
"""
ARM = """&material name='m' density=1600.0 young=2.1e9 ghm_alpha=2.0 ghm_zeta=0.7 ghm_omega=200.0 /
&section name='s' shape='rectangle' width=0.02 height=0.02 /
&body name='arm' kind='beam' length=0.4 elements=1 material='m' section='s' reference='clamped' {modes} /
&joint name='w' type='weld' body_a='arm' node_a=1 /
&force name='f' type='force' body='arm' node=-1 fy=10.0 history='h' /
&history name='h' kind='pulse' value=1.0 start=0.0 finish=8e-3 /
&sensor name='tip' quantity='deflection' body='arm' node=-1 /
"""
SHARE = 0.04  # of the tolerance that a step may take
AFTER_GROWTH = 0.85**3  # of that share: what a step errs by that has grown as far as the control lets it


def controlled(text):
    """Return a &transient group of controlled steps."""
    return f"&transient method='generalized_alpha' {text} /\n"


def accepted(run):
    """Return the number of accepted steps."""
    return run.transient["steps"]


@pytest.mark.parametrize("radius", [0.0, 0.5, 0.9])
@pytest.mark.parametrize("tolerance", [1e-7, 1e-9])
def test_the_estimate_is_the_local_error_of_positions(tolerance, radius, run_deck):
    """Under F = t on 1 kg every step of h errs by the same multiple of h**3, so that the control settles on one step."""
    ends = f"t_end=0.5 tolerance={tolerance} spectral_radius={radius} output_step=1e-2"
    run = run_deck(POINT.format(x=1.0, v=0.0, force="0,1") + controlled(ends))
    t = run.history.time
    error = run.history["x.x"] - (1 + t**3 / 6)
    carried = np.trapezoid(run.history["v.x"] - t**2 / 2, t)
    each = abs(error[-1] - carried) / accepted(run)
    assert each == pytest.approx(AFTER_GROWTH * SHARE * tolerance, rel=0.12)


@pytest.mark.parametrize("radius", [0.0, 0.5, 0.9])
@pytest.mark.parametrize("tolerance", [1e-6, 1e-7])
def test_the_estimate_is_the_local_error_of_rates(tolerance, radius, run_deck):
    """The same under F = t**2 for a body so far away that its position's error is no matter."""
    scene = POINT.format(x=1e4, v=1.0, force="0,0,1")
    ends = f"tolerance={tolerance} spectral_radius={radius} output_step=1e-2"
    half, whole = (run_deck(scene + controlled(f"t_end={t} {ends}"), name=f"t{t}") for t in (0.25, 0.5))
    error = [run.history["v.x"][-1] - 1 - run.history.time[-1] ** 3 / 3 for run in (half, whole)]
    each = abs(error[1] - error[0]) / (accepted(whole) - accepted(half))
    assert each == pytest.approx(AFTER_GROWTH * SHARE * tolerance, rel=0.12)


@pytest.mark.parametrize("radius", [0.0, 0.9])
@pytest.mark.parametrize("modes", ["", "modes=2"])
def test_a_start_in_motion_keeps_order_two_in_dissipative_coordinates(modes, radius, run_deck):
    """Where the pulse ends the method starts anew, and dissipative coordinates have rates and accelerations there."""
    scene = ARM.format(modes=modes)
    exact = run_deck(scene + "&transient method='dopri5' t_end=0.016 tolerance=1e-11 output_step=2e-3 /\n", name="exact").history
    errors = []
    for step in (4e-5, 2e-5, 1e-5):
        ends = f"t_end=0.016 step={step} spectral_radius={radius} output_step=2e-3"
        found = run_deck(scene + controlled(ends), name=f"s{step}").history
        errors.append(np.abs(found["tip.v"] - exact["tip.v"])[5:].max())
    assert np.log2(errors[1] / errors[2]) > 1.85, errors


def test_a_start_in_motion_has_the_energy_it_dissipates(run_deck):
    """Dissipation just after the pulse, from the rates of dissipative coordinates: order 2 at the first rows."""
    scene = ARM.format(modes="")
    ends = "t_end=8.4e-3 output_step=2e-4"
    exact = run_deck(scene + f"&transient method='dopri5' tolerance=1e-11 {ends} /\n", name="exact").energy
    errors = []
    for step in (2e-5, 1e-5):
        found = run_deck(scene + controlled(f"step={step} {ends}"), name=f"s{step}").energy
        errors.append(np.abs(found["dissipated"] - exact["dissipated"])[-2:].max())
    assert np.log2(errors[0] / errors[1]) > 1.85, errors


def test_rows_between_the_ends_of_controlled_steps(run_deck):
    """Rates and accelerations at both ends of a step give its rows: x of a force t is a cubic, which they meet exactly."""
    scene = POINT.format(x=1.0, v=0.0, force="1,1")
    run = run_deck(scene + controlled("t_end=0.1 tolerance=1e-6 first_step=1e-3 output_step=1e-4"))
    assert accepted(run) < 200
    t = run.history.time
    rough = np.diff(run.history["x.x"] - (1 + t**2 / 2 + t**3 / 6), 2)
    assert np.abs(rough).max() < 1e-10
    rough = np.diff(run.history["v.x"] - (t + t**2 / 2), 2)
    assert np.abs(rough).max() < 1e-10
