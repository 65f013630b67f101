"""Kinds that the program does not have, in scenes with a closed form: joints, a force element, an explicit method, a law.

Each is one file of tests/toys, compiled against the built library.
"""

from __future__ import annotations

import os
import subprocess
from math import factorial, gamma, pi
from pathlib import Path

import numpy as np
import pytest
from biela.histories import read
from conftest import program
from scipy.optimize import brentq

G, MASS, DROP, HARDNESS, GAP = 9.81, 2.0, 0.1, 4.0e5, 0.05
SUFFIX = Path(os.environ.get("BIELA", "biela")).name.removeprefix("biela")  # of the build under test
BALL = f"""&scene gravity=0.0,{-G} /
&body name='ball' kind='rigid' mass={MASS} inertia=0.01 position=0.2,{{height!r}} /
&spring name='stop' type='linear' body_a='ball' point_b=0.3,0.0 stiffness=0.0 free_length=0.0 /
&sensor name='p' quantity='position' body='ball' /
&sensor name='k' quantity='spring' spring='stop' /
"""
BEAD = f"""&scene gravity=0.0,{-G} /
&body name='bead' kind='rigid' mass={MASS} inertia=0.01 position={{x!r}},{{y!r}} /
&joint name='guide' type='slider' body_a='bead' /
&drive name='hold' type='rotation' body_a='bead' history='none' /
&history name='none' kind='polynomial' coefficients=0.0 /
&sensor name='p' quantity='position' body='bead' /
&sensor name='v' quantity='velocity' body='bead' /
"""
METHODS = ("rk4", "radau", "generalized_alpha")
RADIUS = 0.5


def run_toy(name, tmp_path, deck, *words):
    """Run a toy program on a deck's text and return what it printed; results go to tmp_path/results."""
    (tmp_path / "scene.nml").write_text(deck, encoding="utf-8")
    command = [str(program("", f"bin/{name}{SUFFIX}")), "scene.nml", *map(str, words)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.parametrize("method", METHODS)
def test_a_ball_leaves_the_bumper_as_fast_as_it_came(tmp_path, method):
    step = 1e-5 if method == "rk4" else 5e-5
    march = f"&transient t_end=0.36 method='{method}' step={step} output_step=1e-4 /\n"
    run_toy("toy_bumper", tmp_path, BALL.format(height=GAP + DROP) + march, "results", GAP, HARDNESS)
    history, energy = read(tmp_path / "results", "history"), read(tmp_path / "results", "energy")
    depth = brentq(lambda d: HARDNESS * d**3 / 3 - MASS * G * (DROP + d), 1e-6, 0.1)
    assert GAP - history["p.y"].min() == pytest.approx(depth, rel=2e-4)
    assert history["p.y"][-1000:].max() == pytest.approx(GAP + DROP, abs=2e-6 * DROP if method == "rk4" else 2e-3 * DROP)
    scale = MASS * G * DROP
    if method == "rk4":
        assert np.abs(energy["residual"]).max() < 1e-7 * scale
    assert np.ptp(energy["potential"]) > 0.9 * scale


def test_a_ball_rests_on_the_bumper_and_vibrates_on_it(tmp_path):
    deck = BALL.format(height=GAP - 1e-3) + "&drive name='x' type='position' body_a='ball' point_b=0.2,0.0 history='n' /\n"
    deck += "&drive name='turn' type='rotation' body_a='ball' history='n' /\n"
    deck += "&history name='n' kind='polynomial' coefficients=0.0 /\n"
    run_toy("toy_bumper", tmp_path, deck + "&static load_steps=4 /\n&modal modes=1 /\n", "results", GAP, HARDNESS)
    depth = np.sqrt(MASS * G / HARDNESS)
    static = read(tmp_path / "results", "static")
    assert GAP - static["p.y"][-1] == pytest.approx(depth, rel=1e-9)
    assert static["k.f"][-1] == pytest.approx(MASS * G, rel=1e-9)
    assert static["k.d"][-1] == 0.0  # it names no deformation
    frequency = np.sqrt(2 * HARDNESS * depth / MASS) / (2 * pi)
    assert read(tmp_path / "results", "modes")["undamped_frequency"][0] == pytest.approx(frequency, rel=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_a_bead_slides_along_the_parabola(tmp_path, method):
    x = 0.3
    deck = BEAD.format(x=x, y=x**2 / (2 * RADIUS)) + f"&transient t_end=1.5 method='{method}' step=1e-3 output_step=1e-2 /\n"
    run_toy("toy_guide", tmp_path, deck, "results", RADIUS)
    h = read(tmp_path / "results", "history")
    np.testing.assert_allclose(h["p.y"], h["p.x"] ** 2 / (2 * RADIUS), rtol=0, atol=1e-12)
    assert h["p.x"].min() < -0.29
    fall = G * (x**2 / (2 * RADIUS) - h["p.y"])
    np.testing.assert_allclose((h["v.x"] ** 2 + h["v.y"] ** 2) / 2, fall, rtol=0, atol=1e-9 if method == "rk4" else 1e-4)


def test_a_bead_vibrates_at_the_bottom(tmp_path):
    run_toy("toy_guide", tmp_path, BEAD.format(x=0.0, y=0.0) + "&modal modes=1 /\n", "results", RADIUS)
    assert read(tmp_path / "results", "modes")["undamped_frequency"][0] == pytest.approx(np.sqrt(G / RADIUS) / (2 * pi), rel=1e-10)


def test_a_tableau_makes_a_method(tmp_path):
    """Each step multiplies a vibration by the polynomial of degree three."""
    deck = "&body name='b' kind='rigid' mass=2.0 inertia=1.0 position=1.25,0.0 /\n"
    deck += "&spring name='k' type='linear' body_a='b' stiffness=18.0 free_length=1.0 /\n"
    deck += "&transient t_end=1.0 method='rk4' step=0.1 /\n"
    y = np.array(run_toy("toy_tableau", tmp_path, deck, 0.1, 10).split(), float)
    growth = np.polynomial.Polynomial([1 / factorial(k) for k in range(4)])(1j * 3.0 * 0.1) ** 10
    np.testing.assert_allclose([y[0] - 1.0, y[3]], [0.25 * growth.real, -0.25 * 3.0 * growth.imag], rtol=0, atol=1e-14)


STRETCHED = """&body name='m' kind='rigid' mass={mass} inertia=0.1 position=1.0,0.0 /
&joint name='rail' type='prismatic' body_a='m' direction=0.0 /
&spring name='k' type='linear' body_a='m' stiffness={stiffness} /
&sensor name='x' quantity='position' body='m' /
&sensor name='k' quantity='spring' spring='k' /
"""
BETA, TAU, STIFFNESS = 0.5, 1.0, 50.0


@pytest.mark.parametrize("method", METHODS)
def test_a_power_law_resists_a_steady_stretch(tmp_path, method):
    """At a rate v from rest its force is k v (t + tau**beta t**(1-beta)/Gamma(2-beta)); terms end at 1e5/tau."""
    deck = STRETCHED.format(mass=MASS, stiffness=STIFFNESS) + "&drive name='pull' type='position' body_a='m' history='h' /\n"
    deck += "&history name='h' kind='polynomial' coefficients=1.0,0.2 /\n"
    deck += f"&transient t_end=0.2 method='{method}' step={2e-5 if method == 'rk4' else 1e-3} output_step=0.02 /\n"
    run_toy("toy_law", tmp_path, deck, "results", BETA, TAU)
    h = read(tmp_path / "results", "history")
    t = h["t"][2:]
    force = STIFFNESS * 0.2 * (t + TAU**BETA * t ** (1 - BETA) / gamma(2 - BETA))
    np.testing.assert_allclose(h["k.f"][2:], force, rtol=1e-2)
    np.testing.assert_allclose(h["x.x"][2:], 1.0 + 0.2 * t, rtol=0, atol=1e-9)


def test_a_power_law_in_a_frequency_response(tmp_path):
    deck = STRETCHED.format(mass=MASS, stiffness=STIFFNESS) + "&history name='h' kind='sine' amplitude=1.0 frequency=1.0 /\n"
    deck += "&force name='push' type='force' body='m' fx=1.0 history='h' /\n"
    deck += "&frequency_response from=1e-3 to=1.0 points=20 input='push' /\n"
    run_toy("toy_law", tmp_path, deck, "results", BETA, TAU)
    h = read(tmp_path / "results", "frequency_response")
    s = 2j * pi * h["f"]
    expected = 1 / (STIFFNESS * (1 + (TAU * s) ** BETA) + MASS * s**2)
    np.testing.assert_allclose(h["x.x.re"] + 1j * h["x.x.im"], expected, rtol=1e-2)
