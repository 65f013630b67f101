"""The coefficients of the explicit methods to the last digits: what single steps make of linear problems."""

from __future__ import annotations

from math import factorial

import numpy as np
import pytest
from scipy.integrate import RK45

OMEGA, START = 3.0, 0.25
SCENE = """&body name='b' kind='rigid' mass=2.0 inertia=1.0 position={x!r},0.0 /
{more}
&sensor name='x' quantity='position' body='b' /
&sensor name='v' quantity='velocity' body='b' /
"""
SPRING = "&spring name='k' type='linear' body_a='b' stiffness=18.0 free_length=1.0 /"  # omega2 = 18/2
POLYNOMIALS = {  # growth of y' = mu y in a step of h mu = z: the order's terms of exp(z), then what the stages leave
    "rk4": [1 / factorial(k) for k in range(5)],
    "dopri5": [*(1 / factorial(k) for k in range(6)), 1 / 600],
}


def oscillator(run_deck, march: str):
    """Run a mass on a spring along x, released with a deflection, and return its history and the figures of the transient."""
    run = run_deck(SCENE.format(x=1.0 + START, more=SPRING) + f"&transient {march} /\n")
    return run.history, run.transient


@pytest.mark.parametrize("step", [0.05, 0.3])
@pytest.mark.parametrize("method", POLYNOMIALS)
def test_steps_multiply_by_the_methods_polynomial(run_deck, method, step):
    h, _ = oscillator(run_deck, f"t_end={10 * step!r} method='{method}' step={step!r} accept_unstable=.true.")
    growth = np.polynomial.Polynomial(POLYNOMIALS[method])(1j * OMEGA * step)
    y = START * growth ** np.arange(11)  # deflection - i velocity/omega
    np.testing.assert_allclose(h["x.x"] - 1.0, y.real, rtol=0, atol=2e-15)
    np.testing.assert_allclose(h["v.x"], -OMEGA * y.imag, rtol=0, atol=6e-15)


@pytest.mark.parametrize(("method", "degree"), [("rk4", 3), ("dopri5", 4)])
def test_one_step_integrates_polynomials_in_time_exactly(run_deck, method, degree):
    c = [0.3, -0.7, 1.1, 0.9, -1.3][: degree + 1]
    force = f"&history name='p' kind='polynomial' coefficients={','.join(map(str, c))} /\n"
    force += "&force name='f' type='force' body='b' fx=2.0 history='p' /"
    h = run_deck(SCENE.format(x=0.0, more=force) + f"&transient t_end=0.8 method='{method}' step=0.8 /\n").history
    assert h["v.x"][-1] == pytest.approx(np.polynomial.Polynomial(c).integ()(0.8), abs=1e-15)


def test_rows_within_a_step_lie_on_the_continuous_extension(run_deck):
    """Against RK45 of scipy, which is the same pair with the same extension, coded by others."""
    step = 0.1
    h, told = oscillator(run_deck, f"t_end={step!r} method='dopri5' tolerance=1.0e-3 first_step={step!r} output_step=0.01")
    assert (told["steps"], told["rejected"]) == (1, 0)
    peer = RK45(lambda _, y: [y[1], -(OMEGA**2) * y[0]], 0.0, [START, 0.0], step, rtol=1e3, atol=1e3, first_step=step)
    peer.step()
    assert peer.t == step
    expected = peer.dense_output()(h.time)
    np.testing.assert_allclose(h["x.x"] - 1.0, expected[0], rtol=0, atol=1e-15)
    np.testing.assert_allclose(h["v.x"], expected[1], rtol=0, atol=3e-15)


def test_steps_grow_with_the_fourth_root_of_the_tolerance(run_deck):
    """The error estimate is one of order five: its weights add up to zero, and so on. A step may take its share of the run."""
    counts = []
    for tolerance in (1e-9, 1e-11):
        _, told = oscillator(run_deck, f"t_end=20.0 method='dopri5' tolerance={tolerance} output_step=20.0")
        counts.append(told["steps"])
    assert counts[1] / counts[0] == pytest.approx(10**0.5, rel=0.03)


def test_accelerations_of_small_vibrations_are_held_to_their_own_range(run_deck):
    """Deflections of a tenth of the least scale of 1e-6 of the scene's size: no error of values would tell."""
    start = (1.0 + 1e-7) - 1.0
    text = SCENE.format(x=1.0 + start, more=SPRING) + "&sensor name='a' quantity='acceleration' body='b' /\n"
    h = run_deck(text + "&transient t_end=20.0 method='dopri5' tolerance=1e-8 output_step=0.05 /\n").history
    error = h["a.x"] + start * OMEGA**2 * np.cos(OMEGA * h.time)
    assert np.max(np.abs(error)) < 100 * 1e-8 * 2 * start * OMEGA**2
