"""Every sensor of a run beside the oracle's own value, the oracle's motion integrated by another method."""

import numpy as np
import pytest
from oracle_probe import Twins
from scenes import MATERIALS, beam, frame, rigid
from scipy.integrate import solve_ivp

SOFT = (
    MATERIALS
    + """&material name='soft' density=1000.0 young=4.0e5 ghm_alpha=0.6,0.2 ghm_zeta=1.2,0.5 ghm_omega=80.0,30.0 rayleigh_mass=0.4
  rayleigh_stiffness=1.0e-4 /
&material name='firm' density=1000.0 young=8.0e5 /
"""
)
BODIES = (
    rigid(rest="angle=0.3 angular_velocity=1.0")
    + beam(material="firm", elements=2, rest="element_material='soft','firm' position=0.19,0.06 angle=0.2")
    + frame(materials="'firm','soft','firm','soft'", rest="reference='clamped' position=0.5,0.3 angle=0.5")
    + rigid(name="block", rest="position=0.3,0.3 angle=0.1")
    + "&lump body='f' node=3 mass=0.03 inertia=2.0e-5 /\n"
)
JOINTS = """&joint name='j0' type='revolute' body_a='r' /
&joint name='j1' type='revolute' body_a='b' node_a=1 body_b='r' point_b=0.2,0.0 /
&joint name='j2' type='slider' body_a='block' point_a=0.02,0.0 body_b='b' node_b=2 direction=0.6 /
&joint name='j3' type='weld' body_a='f' node_a=1 body_b='b' node_b=-1 /
&joint name='j4' type='distance' body_a='block' point_a=0.03,0.01 body_b='f' node_b=3 /
&history name='swing' kind='sine' offset=0.3 amplitude=0.5 frequency=1.5 /
&drive name='d0' type='rotation' body_a='r' history='swing' /
&spring name='s0' type='linear' body_a='f' node_a=2 body_b='r' point_b=0.1,0.1 stiffness=20.0 damping=0.5 free_length=0.2
  ghm_alpha=0.5 ghm_zeta=0.9 ghm_omega=40.0 /
&spring name='s1' type='torsional' body_a='b' node_a=1 body_b='r' stiffness=0.3 damping=0.01 ghm_alpha=1.5,0.3 ghm_zeta=0.7,2.0
  ghm_omega=25.0,90.0 /
"""
PLACES = {"r": "point=0.1,0.05", "b": "node=2", "f": "node=3", "block": ""}


def sensors():
    """Return one sensor of every quantity on every body, joint, drive, spring and several elements."""
    lines = []
    for body, place in PLACES.items():
        for quantity in ("position", "velocity", "acceleration"):
            lines.append(f"&sensor name='{body}_{quantity}' quantity='{quantity}' body='{body}' {place} /")
        for quantity in ("angle", "angular_velocity", "angular_acceleration"):
            lines.append(f"&sensor name='{body}_{quantity}' quantity='{quantity}' body='{body}' /")
    for body in ("b", "f"):
        lines.append(f"&sensor name='{body}_deflection' quantity='deflection' body='{body}' node=3 /")
        lines.append(f"&sensor name='{body}_coordinate' quantity='coordinate' body='{body}' index=4 /")
        for quantity in ("angle", "angular_velocity", "angular_acceleration"):
            lines.append(f"&sensor name='{body}_section_{quantity}' quantity='{quantity}' body='{body}' node=2 /")
        lines += [f"&sensor name='{body}_in{e}' quantity='internal' body='{body}' element={e} /" for e in (1, 2)]
    lines.append("&sensor name='f_in4' quantity='internal' body='f' element=4 /")
    lines += [f"&sensor name='j{k}_r' quantity='reaction' joint='j{k}' /" for k in range(5)]
    lines.append("&sensor name='d0_r' quantity='reaction' drive='d0' /")
    lines += [f"&sensor name='s{k}_s' quantity='spring' spring='s{k}' /" for k in range(2)]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("more", ["", "stiffening=.true."])
def test_all_sensors(more, probe, run_deck, tmp_path):
    bodies = BODIES.replace("reference='clamped'", f"reference='clamped' {more}")
    deck = SOFT + bodies + JOINTS + sensors() + "&transient t_end=0.015 method='rk4' step=1.0e-5 output_step=3.0e-3 /\n"
    twins = Twins(probe, tmp_path, deck)
    scene, history = twins.oracle, run_deck(deck).history
    start = np.concatenate([twins.q0, twins.v0, *scene.relaxed(twins.q0)])
    run = solve_ivp(scene.derivative, (0.0, 0.015), start, "DOP853", t_eval=history.time, rtol=1e-10, atol=1e-13)
    rows = [scene.sensor_columns(t, *scene.split(y)) for t, y in zip(history.time, run.y.T)]
    expected = {column: np.array([row[column] for row in rows]) for column in rows[0]}
    assert list(expected) == history.names[1:]
    for column, values in expected.items():
        unit = [other for other in expected if history.units[other] == history.units[column]]
        scale = max(np.ptp(values), 1e-3 * max(np.abs(expected[other]).max() for other in unit))
        error = np.abs(history[column] - values).max() / scale
        assert error < 1e-8, f"{column}: {error:.1e}"


@pytest.mark.parametrize("kind", ["revolute", "weld", "distance"])
def test_a_joint_that_names_the_ground_first_holds_as_well(kind, run_deck):
    """The same motion; the reaction is that on the other end."""
    deck = (
        "&scene gravity=0.0,-9.81 /\n" + rigid(rest="angular_velocity=2.0") + "&joint name='j' type='" + kind + "' {ends} /\n"
        "&sensor name='r' quantity='position' body='r' /\n&sensor name='j' quantity='reaction' joint='j' /\n"
        "&transient t_end=0.1 method='rk4' step=1.0e-3 output_step=0.02 /\n"
    ).replace("angular_velocity=2.0", "" if kind == "weld" else "angular_velocity=2.0")
    place = "point_{}=0.3,0.2" if kind == "distance" else "point_{}=0.0,0.0"
    last, first = (
        run_deck(deck.format(ends=f"body_a='{a}' body_b='{b}' {place.format(end)}"), name=a).history
        for a, b, end in (("r", "ground", "b"), ("ground", "r", "a"))
    )
    assert np.abs(last["j.fy" if kind != "distance" else "j.fx"]).max() > 0.1
    for name in last.names[1:]:
        sign = -1 if name.startswith("j.f") or name == "j.m" else 1
        np.testing.assert_allclose(first[name], sign * last[name], rtol=0, atol=1e-11, err_msg=name)
