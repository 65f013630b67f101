"""Forces over the motion and spring characteristics: tangents, orders, energies, scipy's solution, closed loops, stable steps."""

from __future__ import annotations

import os
import re
import subprocess

import numpy as np
import pytest
from biela.histories import read
from conftest import program
from linear_oracle import compare_linear
from scipy.integrate import solve_ivp

SUFFIX = "-debug" if "debug" in os.environ.get("TANGENT", "") else ""
SCENE = """&scene gravity=0,-9.81 /
&material name='m' density=1200 young=2e8 ghm_alpha=0.5 ghm_zeta=2 ghm_omega=900 /
&section name='s' area=4e-4 inertia=1.3e-8 /
&body name='arm' kind='beam' length=0.5 elements=3 material='m' section='s' angle=0.3 {arm} /
&body name='rod' kind='beam' length=0.4 elements=3 material='m' section='s' angle=-0.5
  position=0.47766824456280304,0.14776010333066977 {rod} /
&body name='disc' kind='rigid' mass=0.4 inertia=2e-3 position=0.1,-0.2 /
&joint name='j1' type='revolute' body_a='arm' node_a=1 /
&joint name='j2' type='revolute' body_a='rod' node_a=1 body_b='arm' node_b=-1 /
&spring name='sp' body_a='disc' point_a=0.02,0.03 body_b='rod' node_b=2 stiffness=300 damping=0.2 /
&spring name='ts' type='torsional' body_a='disc' body_b='arm' node_b=-1 stiffness=3 /
"""
COLUMNS = {
    "p.x": "quantity='position' body='rod' node=-1",
    "q.y": "quantity='position' body='arm' node=2 body_b='disc' point_b=0.1,0.05",
    "v.x": "quantity='velocity' body='rod' node=3",
    "u.y": "quantity='velocity' body='rod' node=-1 body_b='arm' node_b=2",
    "a": "quantity='angle' body='rod' node=2",
    "b": "quantity='angle' body='disc' body_b='arm' node_b=3",
    "w": "quantity='angular_velocity' body='arm'",
    "o": "quantity='angular_velocity' body='rod' node=3 body_b='disc'",
    "d.u": "quantity='deflection' body='arm' node=3",
    "e.v": "quantity='deflection' body='rod' node=3",
    "f.r": "quantity='deflection' body='arm' node=-1",
    "c.q": "quantity='coordinate' body='rod' index=2",
    "g.qd": "quantity='coordinate' body='arm' index=3",
    "h": "quantity='distance' body='disc' point=0.02,0.0 body_b='rod' node_b=-1",
    "s.d": "quantity='spring' spring='sp'",
    "t.d": "quantity='spring' spring='ts'",
}
LOADS = (
    "type='force' body='arm' node=3 fx=3 fy=-2",
    "type='force' body='rod' node=2 fx=3 fy=-2 axes='body'",
    "type='force' body='rod' node=-1 fx=1 fy=4 axes='section'",
    "type='torque' body='arm' node=2 moment=0.7",
    "type='torque' body='rod' moment=0.7",
    "type='torque_about' body='disc' point=0.05,0.02 moment=0.3 centre=0.7,-0.6",
)
BODIES = {
    "nodal": {"arm": "", "rod": "reference='clamped' stiffening=.true."},
    "modes": {"arm": "modes=4 static_shapes=.true.", "rod": "modes=3"},
}


@pytest.mark.parametrize("column", COLUMNS)
@pytest.mark.parametrize("bodies", BODIES)
def test_tangents_by_place_and_rate(bodies, column, tmp_path):
    text = SCENE.format(**BODIES[bodies]) + f"&sensor name='{column.split('.')[0]}' {COLUMNS[column]} /\n"
    rate = "velocity" in COLUMNS[column] or column.endswith("qd")
    text += f"&history name='h' coefficients=1,{'0.3' if rate else '2,-3,4'} /\n"
    for k, load in enumerate(LOADS):
        text += f"&force name='f{k}' {load} history='h' argument='{column}' /\n"
    (tmp_path / "deck.nml").write_text(text, encoding="utf-8")
    command = [program("TANGENT", f"bin/tangent{SUFFIX}"), "deck.nml", "1e-3", "0.6", "3"]
    out = subprocess.run(command, cwd=tmp_path, check=True, capture_output=True, text=True).stdout
    assert max(float(word) for word in re.findall(r"\d\S*", out)) < 1e-6


TABLES = {
    "linear": "interpolation='linear' time=-0.45,-0.3,-0.15,-0.05,0.02 value=2,-1.5,1,-2,1.5",
    "pchip": "interpolation='pchip' time=-0.45,-0.3,-0.15,-0.05,0.02 value=2,-1.5,1,-2,1.5",
    "periodic": "interpolation='linear' periodic=.true. time=0,0.03,0.08,0.1 value=0,2,-1,0",
}


def driven(table: str, transient: str) -> str:
    """Return a GHM arm whose tip's height rules a force on a disc that hangs on it."""
    return f"""&scene gravity=0,-9.81 /
&material name='m' density=1200 young=2e7 ghm_alpha=0.5 ghm_zeta=2 ghm_omega=60 /
&section name='s' area=4e-4 inertia=1.3e-8 /
&body name='arm' kind='beam' length=0.5 elements=2 material='m' section='s' axial=.false. reference='clamped' /
&body name='disc' kind='rigid' mass=0.4 inertia=2e-3 position=0.1,-0.2 /
&joint name='j1' type='revolute' body_a='arm' node_a=1 /
&spring name='a' body_a='disc' point_a=0.01,0.02 body_b='arm' node_b=2 stiffness=30 damping=0.2 /
&spring name='b' body_a='disc' point_a=0.01,0.02 point_b=0.2,-0.5 stiffness=60 free_length=0.25 /
&sensor name='tip' quantity='position' body='arm' node=-1 /
&sensor name='disc' quantity='position' body='disc' /
&sensor name='turn' quantity='angle' body='disc' /
&history name='h' kind='table' {TABLES[table]} /
&force name='f' body='disc' point=0.03,0 fx=1.5 fy=1 axes='body' history='h' argument='tip.y' /
&transient t_end=0.2 output_step=0.1 {transient} /
"""


METHODS = {"rk4": (4, 2e-4), "dopri5": (5, 5e-4), "radau": (5, 5e-4), "generalized_alpha": (2, 1e-4)}


@pytest.mark.parametrize("table", TABLES)
def test_orders_and_energy_across_corners(table, run_deck):
    ends, energy = {}, {}
    for method in ("dopri5", "radau"):
        run = run_deck(driven(table, f"method='{method}' tolerance=1e-11"), name=method)
        ends[method], energy[method] = run.history.data[-1], np.abs(run.energy["residual"]).max()
    assert np.abs(ends["dopri5"] - ends["radau"]).max() < 1e-10
    assert max(energy.values()) < 1e-10
    for method, (order, step) in METHODS.items():
        errors = []
        for part in (1, 2):
            run = run_deck(driven(table, f"method='{method}' step={step / part!r}"), name=f"{method}{part}")
            errors.append(np.abs(run.history.data[-1] - ends["radau"]).max())
        assert errors[0] / errors[1] > 2 ** (order - 0.75), (method, errors)


SLIDE = """&body name='a' kind='rigid' mass=2 inertia=0.1 /
&body name='b' kind='rigid' mass=1 inertia=0.02 position=1,0 angular_velocity=3 /
&joint name='guide' type='prismatic' body_a='a' /
&joint name='pin' type='revolute' body_a='b' body_b='a' point_b=1,0 /
"""


def test_press_and_motor_against_scipy(run_deck):
    places, forces = np.array([-1.0, 0.01, 0.03, 0.05, 1.0]), np.array([0.0, 0.0, 90.0, 10.0, 0.0])
    speeds, torques = np.array([-9.0, 0.0, 5.0, 9.0]), np.array([0.9, 0.6, -0.2, -0.9])

    def rhs(t, y):
        push = 4.0 * np.cos(20 * t) + 3.0 - np.interp(y[0], places, forces)
        return [y[1], push / 3.0, np.interp(y[2], speeds, torques) / 0.02]

    crossings = [lambda _, y, c=c: y[0] - c for c in places[1:-1]] + [lambda _, y, c=c: y[2] - c for c in speeds[1:-1]]
    for crossing in crossings:
        crossing.terminal = True
    t, y, found = 0.0, np.array([0.0, 0.0, 3.0]), 0
    while t < 0.5:
        part = solve_ivp(rhs, (t, 0.5), y, method="DOP853", rtol=1e-13, atol=1e-15, events=crossings)
        found += part.status == 1
        t, y = part.t[-1], part.y[:, -1]
        if part.status == 1:  # past the corner
            part = solve_ivp(rhs, (t, min(0.5, t + 1e-6)), y, method="DOP853", rtol=1e-13, atol=1e-15)
            t, y = part.t[-1], part.y[:, -1]
    table = "kind='table' interpolation='linear'"
    deck = (
        SLIDE
        + f"""&sensor name='at' quantity='position' body='a' /
&sensor name='go' quantity='velocity' body='a' /
&sensor name='spin' quantity='angular_velocity' body='b' body_b='a' /
&history name='press' {table} time=-1,0.01,0.03,0.05,1 value=0,0,90,10,0 /
&history name='motor' {table} time=-9,0,5,9 value=0.9,0.6,-0.2,-0.9 /
&history name='push' kind='sine' offset=3 amplitude=4 frequency={{10/pi}} phase={{pi/2}} /
&force name='f' body='a' fx=-1 history='press' argument='at.x' /
&force name='g' body='a' fx=1 history='push' /
&force name='m' type='torque' body='b' moment=1 history='motor' argument='spin' /
&force name='back' type='torque' body='a' moment=-1 history='motor' argument='spin' /
"""
    )
    assert found >= 3
    for method in ("dopri5", "radau"):
        rows = run_deck(deck + f"&transient t_end=0.5 output_step=0.1 method='{method}' tolerance=1e-11 /\n").history
        np.testing.assert_allclose([rows["at.x"][-1], rows["go.x"][-1], rows["spin"][-1]], y, rtol=0, atol=2e-9)


def test_modes_statics_and_responses_close_the_loop(run_deck):
    """Two masses in a row: a force on the first by the place and the speed of the second."""
    deck = """&body name='a' kind='rigid' mass=2 inertia=0.1 /
&body name='b' kind='rigid' mass=1 inertia=0.02 position=1,0 /
&joint name='ga' type='prismatic' body_a='a' /
&joint name='gb' type='prismatic' body_a='b' point_b=1,0 /
&spring name='k' body_a='a' body_b='b' stiffness=100 /
&spring name='g' body_a='a' point_b=-1,0 stiffness=50 /
&sensor name='at' quantity='position' body='b' /
&sensor name='go' quantity='velocity' body='b' /
&history name='h' coefficients=3,-7,-2 /
&history name='d' coefficients=0,-1.5 /
&force name='f' body='a' fx=1 history='h' argument='at.x' /
&force name='v' body='a' fx=1 history='d' argument='go.x' /
&force name='in' body='b' fx=1 stage='transient' /
&static / &modal modes=2 /
&frequency_response from=1 to=3 points=3 input='in' /
"""
    run = run_deck(deck)
    x = np.roots([2, 57, -53]).max()  # 50 (x - 1) = 3 - 7 x - 2 x^2
    np.testing.assert_allclose(read(run.folder / "static.txt")["at.x"][-1], x, rtol=1e-10)
    mass, damping = np.diag([2.0, 1.0]), np.array([[0, 1.5], [0, 0]])
    stiffness = np.array([[150, -100 + 7 + 4 * x], [-100, 100.0]])
    undamped = np.sqrt(-np.linalg.eigvals(np.linalg.solve(mass, stiffness)) + 0j)
    still = [p for p in run.figures["modes"]["poles"] if p["kind"] == "undamped"]
    still = [complex(p["real_part"], 2 * np.pi * p["frequency"]) for p in still]
    np.testing.assert_allclose(np.sort_complex(still), np.sort_complex(undamped), rtol=1e-7)
    compare_linear(run, mass, damping, stiffness)


CHARACTERISTIC = """&body name='a' kind='rigid' mass=2 inertia=0.1 /
&joint name='ga' type='prismatic' body_a='a' /
&history name='c' kind='table' interpolation='{table}' time=-0.4,-0.1,0.1,0.4 value=-50,0,0,50 /
&spring name='k' body_a='a' point_b=-1,0 characteristic='c' free_length={free} damping={damping} /
&sensor name='at' quantity='position' body='a' /
&sensor name='k' quantity='spring' spring='k' /
"""


def test_characteristic_with_play(run_deck):
    """A mass with a play of 0.1 m on both sides: its energy is the integral, its corners are passed to rounding."""
    deck = CHARACTERISTIC.format(table="linear", free=0.8, damping=1e-3) + "&sensor name='v' quantity='velocity' body='a' /\n"
    run = run_deck(deck + "&transient t_end=1 output_step=0.02 method='dopri5' tolerance=1e-11 /\n")
    d, force = run.history["k.d"], run.history["k.f"]
    np.testing.assert_allclose(d, run.history["at.x"] + 0.2, atol=1e-14)
    elastic = np.sign(d) * np.maximum(abs(d) - 0.1, 0) * 50 / 0.3
    np.testing.assert_allclose(force, elastic + 1e-3 * run.history["v.x"], atol=1e-12)
    np.testing.assert_allclose(run.energy["potential"], 0.5 * (50 / 0.3) * np.maximum(abs(d) - 0.1, 0) ** 2, atol=1e-12)
    assert d.min() < -0.19
    assert np.abs(run.energy["residual"]).max() < 1e-10
    omega, flight = np.sqrt(50 / 0.3 / 2), 0.1  # harmonic while it touches: a quarter period, then at constant speed
    back = np.pi / 2 / omega + 2 * flight / (flight * omega)
    assert abs(np.interp(back, run.history.time, d) + flight) < 1e-3


def test_characteristic_in_equilibrium_and_modes(run_deck):
    deck = "&scene gravity=-3,0 /\n" + CHARACTERISTIC.format(table="pchip", free=1, damping=0.4) + "&static / &modal modes=1 /\n"
    run = run_deck(deck)
    row = read(run.folder / "static.txt")
    assert abs(row["k.f"][-1] + 6) < 1e-9
    assert row["newton_steps"].sum() < 60  # 39; without a limit of their length 99
    pole = next(p for p in run.figures["modes"]["poles"] if p["kind"] == "undamped")
    step = 1e-5  # slope of the pchip there, by the forces of two other equilibria
    forces = []
    for g in (-3 - step, -3 + step):
        other = read(run_deck(deck.replace("gravity=-3", f"gravity={g!r}"), name="other").folder / "static.txt")
        forces.append((other["k.f"][-1], other["k.d"][-1]))
    slope = (forces[1][0] - forces[0][0]) / (forces[1][1] - forces[0][1])
    assert abs(2 * np.pi * pole["frequency"] - np.sqrt(slope / 2)) < 1e-5
    pull = "&force name='p' body='a' fx=1 history='off' /\n&history name='off' coefficients=0 /\n"
    pull += "&frequency_response input='p' from=1 to=3 points=2 /\n"
    seen = read(run_deck(deck.replace("&modal modes=1 /", pull), name="response").folder / "frequency_response.txt")
    force, stretch = (seen[f"k.{x}.re"] + 1j * seen[f"k.{x}.im"] for x in "fd")
    np.testing.assert_allclose(force / stretch, slope + 0.4j * 2 * np.pi * seen["f"], rtol=1e-6)


@pytest.mark.parametrize("law", ["history", "kp=50", "kd=0.05 filter=1e-3"])
def test_a_fast_loop_is_in_the_current_bound(run_deck, law):
    """A strong brake by the speed of a shaft is a damper: rk4 is stable up to 2.785 of its time constant.

    So is a controller that starts at its limit: it may leave it. With kd s/(1 + s/1000) of the speed the pole is -1000 (1 + kd/J).
    """
    deck = """&body name='rotor' kind='rigid' mass=1 inertia=0.01 /
&joint name='pin' type='revolute' body_a='rotor' /
&sensor name='w' quantity='angular_velocity' body='rotor' /
"""
    if law == "history":
        deck += "&history name='brake' coefficients=0,-50 /\n"
        deck += "&force name='f' type='torque' body='rotor' moment=1 history='brake' argument='w' /\n"
    else:
        deck += f"&history name='one' coefficients=1 /\n&controller name='c' argument='w' history='one' {law} lower=-1 upper=2 /\n"
        deck += "&force name='f' type='torque' body='rotor' moment=1 controller='c' /\n"
    text = run_deck(deck, "--check").stdout
    bounds = [float(x) for x in re.findall(r"rk4: safe bound\s+(\S+) s .*current bound\s+(\S+) s", text)[0]]
    np.testing.assert_allclose(bounds, 2.785293563405282 / (6000 if "filter" in law else 5000), rtol=1e-3)
    assert "note: the safe bound takes forces over the motion as at the start" in text
