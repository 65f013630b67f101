"""Histories against their formulas: what a drive follows, directly and by its rate, and the factor of a load."""

from __future__ import annotations

import numpy as np
import pytest
from biela.histories import read
from scipy.interpolate import CubicSpline

T_END, STEP = 1.0, 0.01
TIME = [0.15, 0.2, 0.37, 0.45, 0.71, 0.8]
VALUE = [0.3, 0.45, 0.2, -0.4, 0.1, 0.25]
SCENE = """&body name='disc' kind='rigid' mass=0.7 inertia=0.02 com=0.05,0.02 angle={angle!r} /
&body name='sled' kind='rigid' mass=1.3 inertia=0.01 position={place!r},0.0 /
&body name='free' kind='rigid' mass=2.5 inertia=0.3 position=0.0,3.0 /
&joint name='pin' type='revolute' body_a='disc' /
&joint name='rail' type='prismatic' body_a='sled' /
{history}
{drives}
&force name='push' type='force' body='free' fx=1.7 history='h' /
&sensor name='a' quantity='angle' body='disc' /
&sensor name='w' quantity='angular_velocity' body='disc' /
&sensor name='wd' quantity='angular_acceleration' body='disc' /
&sensor name='x' quantity='position' body='sled' /
&sensor name='v' quantity='velocity' body='sled' /
&sensor name='vd' quantity='acceleration' body='sled' /
&sensor name='p' quantity='acceleration' body='free' /
&transient t_end={t_end} method='rk4' step=1e-3 output_step={step} /
"""
DRIVES = """&drive name='turn' type='rotation' body_a='disc' history='h' rate={rate} /
&drive name='slide' type='position' body_a='sled' history='h' rate={rate} /"""
SMOOTH = ["polynomial", "sine", "still", "ramp", "cycloid"]


def law(kind: str, t: np.ndarray) -> np.ndarray:
    """Return the left limits of a history and of its first two derivatives at times t, shape (3, times)."""
    if kind == "polynomial":
        p = np.polynomial.Polynomial([0.2, -0.3, 0.5, 0.9])
        return np.array([p(t), p.deriv()(t), p.deriv(2)(t)])
    if kind in ("sine", "still"):
        w, phase = (2 * np.pi * 1.3, 0.4) if kind == "sine" else (0.0, 0.6)
        x = w * t + phase
        return np.array([0.1 + 0.4 * np.sin(x), 0.4 * w * np.cos(x), -0.4 * w**2 * np.sin(x)])
    if kind in ("ramp", "cycloid"):
        start, width, low, rise = 0.2, 0.5, 0.3, -0.7
        s = np.clip((t - start) / width, 0.0, 1.0)
        if kind == "ramp":
            shape = [6 * s**5 - 15 * s**4 + 10 * s**3, 30 * s**4 - 60 * s**3 + 30 * s**2, 120 * s**3 - 180 * s**2 + 60 * s]
        else:
            c = 2 * np.pi
            shape = [s - np.sin(c * s) / c, 1 - np.cos(c * s), c * np.sin(c * s)]
        return np.array([low + rise * shape[0], rise * shape[1] / width, rise * shape[2] / width**2])
    if kind == "table":
        spline = CubicSpline(TIME, VALUE)
        inside = (t > TIME[0] + 1e-9) & (t < TIME[-1] + 1e-9)
        held = np.where(t < TIME[0] + 1e-9, VALUE[0], VALUE[-1])
        return np.array([np.where(inside, spline(t, k), held if k == 0 else 0.0) for k in range(3)])
    inside = (t > 0.25 + 1e-9) & (t < 0.62 + 1e-9)
    return np.array([np.where(inside, 0.8, 0.0), 0 * t, 0 * t])


def integral(kind: str, t: np.ndarray) -> np.ndarray:
    """Return the integral from 0 to t, by Gauss's formula between all corners."""
    x, w = np.polynomial.legendre.leggauss(8)
    corners = {"table": TIME, "ramp": [0.2, 0.7], "cycloid": [0.2, 0.7], "pulse": [0.25, 0.62]}.get(kind, [])
    area = []
    for end in t:
        cuts = np.unique([0.0, end, *np.arange(0.05, end, 0.05), *(c for c in corners if c < end)])
        half, middle = np.diff(cuts) / 2, (cuts[1:] + cuts[:-1]) / 2
        area.append(sum((law(kind, m + h * x)[0] * w).sum() * h for h, m in zip(half, middle)))
    return np.array(area)


def history(kind: str) -> str:
    """Return the &history group of a kind."""
    words = {
        "polynomial": "kind='polynomial' coefficients=0.2,-0.3,0.5,0.9",
        "sine": "kind='sine' offset=0.1 amplitude=0.4 frequency=1.3 phase=0.4",
        "still": "kind='sine' offset=0.1 amplitude=0.4 frequency=0.0 phase=0.6",
        "ramp": "kind='ramp' start_value=0.3 end_value=-0.4 start=0.2 finish=0.7",
        "cycloid": "kind='cycloid' start_value=0.3 end_value=-0.4 start=0.2 finish=0.7",
        "table": f"kind='table' time={','.join(map(str, TIME))} value={','.join(map(str, VALUE))}",
        "pulse": "kind='pulse' value=0.8 start=0.25 finish=0.62",
    }
    return f"&history name='h' {words[kind]} /"


def moved(run_deck, kind: str, drives: str, angle: float = 0.0, place: float = 0.0):
    """Run the scene; return its history."""
    text = SCENE.format(angle=angle, place=place, history=history(kind), drives=drives, t_end=T_END, step=STEP)
    return run_deck(text).history


@pytest.mark.parametrize("kind", SMOOTH)
def test_a_drive_follows_its_history_and_both_derivatives(run_deck, kind):
    value = float(law(kind, np.zeros(1))[0, 0])
    h = moved(run_deck, kind, DRIVES.format(rate=".false."), value, value)
    expected = law(kind, h.time)
    for names in (("a", "w", "wd"), ("x.x", "v.x", "vd.x")):
        for name, column in zip(names, expected):
            np.testing.assert_allclose(h[name], column, rtol=0, atol=1e-9 * max(1.0, np.abs(column).max()), err_msg=name)


@pytest.mark.parametrize("kind", SMOOTH)
def test_by_rate_a_drive_follows_the_integral_from_the_decks_own_value(run_deck, kind):
    h = moved(run_deck, kind, DRIVES.format(rate=".true."), 0.35, -0.6)
    value, slope, _ = law(kind, h.time)
    area = integral(kind, h.time)
    for start, names in ((0.35, ("a", "w", "wd")), (-0.6, ("x.x", "v.x", "vd.x"))):
        for name, column in zip(names, (start + area, value, slope)):
            np.testing.assert_allclose(h[name], column, rtol=0, atol=1e-9 * max(1.0, np.abs(column).max()), err_msg=name)


def test_by_rate_a_drive_follows_a_table_between_its_points_and_outside(run_deck):
    """A table's slope jumps at its ends: its rate may be driven, not its value."""
    h = moved(run_deck, "table", DRIVES.format(rate=".true."), 0.35, -0.6)
    value, slope, _ = law("table", h.time)
    np.testing.assert_allclose(h["a"], 0.35 + integral("table", h.time), rtol=0, atol=1e-9)
    np.testing.assert_allclose(h["w"], value, rtol=0, atol=1e-9)
    np.testing.assert_allclose(h["wd"], slope, rtol=0, atol=1e-8)


@pytest.mark.parametrize("kind", [*SMOOTH, "table", "pulse"])
def test_a_load_is_scaled_by_its_history(run_deck, kind):
    h = moved(run_deck, kind, "")
    np.testing.assert_allclose(h["p.x"], 1.7 * law(kind, h.time)[0] / 2.5, rtol=0, atol=1e-12)


METHODS = ["'rk4' step=1e-3", "'dopri5' tolerance=1e-9", "'generalized_alpha' step=1e-3"]


@pytest.mark.parametrize("method", METHODS)
def test_a_table_may_end_with_the_run_in_full_motion(run_deck, method):
    """What a drive's table holds beyond its last time is not felt in the last row: no jump of rates, the last torque."""
    deck = SCENE.format(
        angle=0.0,
        place=0.0,
        t_end=0.1,
        step=0.01,
        drives=DRIVES.format(rate=".false."),
        history="&history name='h' kind='table' time=0.0,0.05,0.1 value=0.0,1.0,3.0 /",
    )
    deck = deck.replace("method='rk4' step=1e-3", f"method={method}") + "&sensor name='m' quantity='reaction' drive='turn' /\n"
    run = run_deck(deck)
    assert run.history["w"][-1] == pytest.approx(50.0, rel=1e-10)
    assert run.history["wd"][-1] == pytest.approx(400.0, rel=1e-9)
    assert run.history["vd.x"][-1] == pytest.approx(400.0, rel=1e-9)
    assert run.history["m.m"][-1] == pytest.approx(400.0 * (0.02 + 0.7 * (0.05**2 + 0.02**2)), rel=1e-9)
    assert np.abs(read(run.folder, "energy")["velocity_violation"]).max() < 1e-9


CRANK = """&scene gravity=0.0,-9.81 /
&material name='m' density=1200.0 young=2.0e8 /
&section name='s' shape='rectangle' width=0.02 height=0.02 /
&body name='crank' kind='beam' length=0.4 elements=2 material='m' section='s' modes=2 angle=0.9 /
&body name='rod' kind='rigid' mass=0.5 inertia=0.02 com=0.3,0.0 position=0.2,0.3 angle=-0.4 /
&body name='sled' kind='rigid' mass=1.0 inertia=0.01 position=0.8,0.0 /
&joint name='a' type='revolute' body_a='crank' node_a=1 /
&joint name='b' type='revolute' body_a='rod' body_b='crank' node_b=-1 /
&joint name='c' type='revolute' body_a='rod' point_a=0.6,0.0 body_b='sled' /
&joint name='d' type='prismatic' body_a='sled' /
&history name='h' kind='polynomial' coefficients=0.03,0.4,-2.0 /
&sensor name='angle' quantity='angle' body='crank' /
&sensor name='section' quantity='angle' body='crank' node=-1 /
&sensor name='x' quantity='position' body='sled' /
"""
DRIVEN = {
    "angle": "type='rotation' body_a='crank'",
    "section": "type='rotation' body_a='crank' node_a=-1",
    "x.x": "type='position' body_a='sled'",
}


@pytest.mark.parametrize("rate", [False, True])
@pytest.mark.parametrize("column", DRIVEN)
def test_a_relative_drive_adds_to_the_assembled_value(run_deck, column, rate):
    """Assembly moves crank and sled from where the deck has them; gravity bends the crank, before and after an equilibrium."""
    end = "&transient t_end=0.05 step=5e-4 output_step=0.005 method='radau' /\n"
    at = run_deck(CRANK + "&transient t_end=1e-4 step=1e-4 method='radau' /\n").history[column][0]
    assert min(abs(at - x) for x in (0.9, 0.8)) > 1e-3
    drive = f"&drive name='q' {DRIVEN[column]} history='h' relative=.true. rate={'.true.' if rate else '.false.'} /\n"
    for before in ("", "&static /\n"):
        h = run_deck(CRANK + drive + before + end).history
        value = 0.03 * h.time + 0.2 * h.time**2 - 2 / 3 * h.time**3 if rate else 0.03 + 0.4 * h.time - 2 * h.time**2
        np.testing.assert_allclose(h[column], at + value, rtol=0, atol=1e-12)
