"""Energies of runs: the residual, the columns beside the oracle's quadrature, the violations of the constraints."""

import re

import numpy as np
import pytest
from conftest import REFERENCE
from oracle import Scene, gradient
from oracle_probe import Twins
from scenes import JOINTS, LOOPS, LUMPS, MATERIALS, beam, frame, rigid

VRL = ("vrl_elastic", "vrl_ghm", "vrl_torque_on_rod")


def with_step(deck, step):
    """Return a deck's text with another step."""
    changed, count = re.subn(r" step=\S+", f" step={step}", deck)
    assert count == 1
    return changed


def reference_deck(scene):
    """Return the text of a reference scene's deck."""
    return (REFERENCE / scene / "deck.nml").read_text(encoding="utf-8")


def relative_residual(run):
    """Return the largest energy residual over the largest energy of a run."""
    energy = run.energy
    return np.abs(energy["residual"]).max() / max(np.abs(energy[name]).max() for name in ("kinetic", "potential", "work"))


# A driven, damped, moving scene whose fastest motion its steps resolve: the residual shows the method's order itself.
SWING = (
    MATERIALS
    + rigid(rest="angle=0.4")
    + "&material name='soft' density=1500.0 young=2.0e6 ghm_alpha=0.6 ghm_zeta=1.2 ghm_omega=80.0 rayleigh_mass=0.8 /\n"
    + beam(material="soft", elements=1, rest="position=0.18,0.08 angle=-0.2 axial=.false.")
    + """&joint name='a' type='revolute' body_a='r' /
&joint name='b' type='revolute' body_a='b' node_a=1 body_b='r' point_b=0.2,0.0 /
&spring name='s' type='torsional' body_a='b' node_a=1 body_b='r' stiffness=0.5 damping=0.01 free_angle=-0.4
  ghm_alpha=1.5 ghm_zeta=0.7 ghm_omega=25.0 /
&history name='h' kind='sine' offset=0.4 amplitude=0.8 frequency=1.3 phase=0.0 /
&drive name='d' type='rotation' body_a='r' history='h' /
&force name='f' type='force' body='b' node=-1 fx=0.3 fy=0.2 axes='section' /
&transient t_end=0.5 method='rk4' step=2.0e-3 output_step=1.0e-2 /
"""
)


def test_residual_has_the_methods_order(run_deck):
    """Loads, a drive, Rayleigh, spring and GHM damping: W and the dissipated energy are integrated by the method itself."""
    residuals = [relative_residual(run_deck(with_step(SWING, step), name=f"s{step}")) for step in (2e-3, 1e-3, 5e-4)]
    assert residuals[2] > 1e-13
    for coarse, fine in zip(residuals[:-1], residuals[1:]):
        assert 3.8 < np.log2(coarse / fine) < 4.3
    energy = run_deck(with_step(SWING, 5e-4)).energy
    assert np.ptp(energy["dissipated"]) > 1e-3
    assert np.all(np.diff(energy["dissipated"]) >= 0)
    assert np.ptp(energy["work"]) > 1e-2


LOSSES = """&scene title='a rod that a slow force bends at a damped hinge' gravity=0.0,0.0 /
&section name='s' area=1.0e-4 inertia=1.0e-9 /
&material name='m' density=1000.0 young=1.0e9 ghm_alpha=0.4,0.2 ghm_zeta=1.5,0.8 ghm_omega=60.0,15.0
  prony_alpha=0.3 prony_tau=0.05 /
&body name='b' kind='beam' section='s' material='m' length=0.5 elements=2 axial=.false. modes={modes} /
&joint name='a' type='revolute' body_a='b' node_a=1 /
&spring name='hinge' type='torsional' body_a='b' node_a=1 stiffness=20.0 damping=0.3 /
&history name='h' kind='sine' amplitude=1.0 frequency=2.0 /
&force name='f' type='force' body='b' node=-1 fy=1.0 history='h' axes='section' /
&sensor name='turn' quantity='spring' spring='hinge' /
&transient t_end=2.0 method={method} output_step=5.0e-3 /
"""


@pytest.mark.parametrize("modes", [0, 1])
def test_losses_by_term_and_spring(modes, run_deck):
    """Of one vibration terms lose energy as their parts of the loss modulus stand to each other, a dashpot c times rate squared."""
    deck = LOSSES.format(method="'rk4' step=1.0e-3" if modes else "'radau' tolerance=1.0e-6", modes=modes).replace(" modes=0", "")
    first, last = (run_deck(deck.replace("t_end=2.0", f"t_end={end}"), name=f"t{end}") for end in (1.0, 2.0))
    lost = np.array([one["lost"] for one in last.transient["losses"]])
    assert lost.sum() == pytest.approx(last.energy["dissipated"][-1], rel=1e-12)
    assert last.transient["losses"][-1]["spring"] == "hinge"
    assert [(one["kind"], one["term"]) for one in last.transient["losses"][:-1]] == [("GHM", 1), ("GHM", 2), ("Maxwell", 1)]
    lost -= [one["lost"] for one in first.transient["losses"]]
    s = 2j * np.pi * 2.0
    terms = [(0.4, 60.0, 1.5), (0.2, 15.0, 0.8)]
    parts = [(a * (s**2 + 2 * z * w * s) / (s**2 + 2 * z * w * s + w**2)).imag for a, w, z in terms]
    parts.append((0.3 * 0.05 * s / (1 + 0.05 * s)).imag)
    assert lost[:3] / lost[:3].sum() == pytest.approx(np.array(parts) / sum(parts), rel=1e-3)
    table = last.history
    rate = np.gradient(table["turn.d"], table.time)[table.time >= 1.0]
    assert lost[3] == pytest.approx(0.3 * (rate**2).mean(), rel=1e-2)


@pytest.mark.parametrize("scene", [*VRL, "andrews"])
def test_residual_of_reference_scenes(scene, run_deck):
    """At least order 4 (undamped oscillations lose energy with order 5), and small."""
    steps = (2e-6, 1e-6) if scene in VRL else (1e-5, 5e-6)
    coarse, fine = (relative_residual(run_deck(with_step(reference_deck(scene), step), name=f"s{step}")) for step in steps)
    assert np.log2(coarse / fine) > 3.9
    assert fine < 1e-9


@pytest.mark.parametrize(
    ("scene", "step"),
    [
        ("vrl_elastic", 4e-6),
        ("vrl_ghm", 4e-6),
        ("vrl_torque_on_rod", 4e-6),
        ("four_bar", 1e-5),
        ("spin_up", 4e-4),
        ("andrews", 1e-5),
    ],
)
def test_projection_holds_the_constraints(scene, step, run_deck):
    energy = run_deck(with_step(reference_deck(scene), step)).energy
    assert np.abs(energy["position_violation"]).max() < 1e-12
    assert np.abs(energy["velocity_violation"]).max() < 1e-10


@pytest.mark.parametrize("way", ["baumgarte", "none"])
def test_other_stabilizations_follow_the_same_motion(way, run_deck):
    deck = reference_deck("vrl_ghm").replace("step=4.0e-6", f"step=1.0e-6 stabilization='{way}'")
    plain = run_deck(with_step(reference_deck("vrl_ghm"), 1e-6), name="plain")
    other = run_deck(deck, name="other")
    for column in ("qf4.q", "pin.x", "rod", "mid.v"):
        np.testing.assert_allclose(other.history[column], plain.history[column], rtol=0, atol=2e-5 * np.ptp(plain.history[column]))
    violation = np.abs(other.energy["position_violation"])
    assert 1e-15 < violation.max() < 1e-9
    if way == "none":  # nothing pulls the drift back
        assert violation[-1] > 0.1 * violation.max()


# ---------------------------------------------------------------- the columns, recomputed from the run's own states

STATE_SENSORS = "".join(
    f"&sensor name='{body}_{tag}' quantity='{quantity}' body='{body}' {at} /\n"
    for body, place in (("r", "point=0.0,0.0"), ("b", "node=1"), ("f", "node=1"))
    for tag, quantity, at in (("r", "position", place), ("v", "velocity", place), ("a", "angle", ""), ("o", "angular_velocity", ""))
)


def elastic_scene(young=2.1e9):
    """Return a slider-crank that carries a frame, all elastic, with sensors for every coordinate and rate."""
    text = (
        MATERIALS
        + f"&material name='changed' density=1600.0 young={young!r} /\n"
        + rigid(rest="angle=0.4")
        + beam(elements=3, rest="position=0.18,0.08 angle=-0.2 element_material='elastic','changed','elastic'")
        + LUMPS
        + frame(materials="'elastic'", rest="reference='clamped' position=0.05,0.03 angle=0.1 stiffening=.true.")
        + """&joint name='a' type='revolute' body_a='r' /
&joint name='b' type='revolute' body_a='b' node_a=1 body_b='r' point_b=0.2,0.0 /
&joint name='c' type='slider' body_a='b' node_a=-1 direction=0.0 /
&joint name='d' type='weld' body_a='f' node_a=1 body_b='r' point_b=0.05,0.01 /
&force name='t' type='torque' body='r' moment=8.0 /
&spring name='s' type='linear' body_a='f' node_a=3 point_b=0.6,0.5 stiffness=400.0 free_length=0.3 /
&transient t_end=0.02 method='rk4' step=2.0e-6 output_step=5.0e-4 /
"""
    )
    sensors = "".join(
        f"&sensor name='{body}{k}' quantity='coordinate' body='{body}' index={k} /\n"
        for body, count in (("b", 9), ("f", 9))
        for k in range(1, count + 1)
    )
    return text + STATE_SENSORS + sensors


def states_of(run, scene):
    """Return q and v (rows, nq) of a run of elastic_scene, from its sensors."""
    history = run.history
    q, v = (np.zeros((len(history.time), scene.nq)) for _ in range(2))
    for body in scene.bodies:
        at, name = scene.offset[body.name], body.name
        for target, place, angle, elastic in ((q, "_r", "_a", ".q"), (v, "_v", "_o", ".qd")):
            target[:, at] = history[f"{name}{place}.x"]
            target[:, at + 1] = history[f"{name}{place}.y"]
            target[:, at + 2] = history[f"{name}{angle}"]
            for k in range(body.nf):
                target[:, at + 3 + k] = history[f"{name}{k + 1}{elastic}"]
    return q, v


def energies_of(run, scene):
    """Return the oracle's kinetic and potential energy (rows,) along a run."""
    q, v = states_of(run, scene)
    nothing = np.zeros(0)
    return scene.kinetic(q, v), np.array([scene.potential(x, nothing, nothing) for x in q])


def test_energy_columns_are_the_quadrature_over_the_field(run_deck, tmp_path):
    run = run_deck(elastic_scene(), name="scene")
    scene = Scene(tmp_path / "scene.nml")
    kinetic, potential = energies_of(run, scene)
    assert np.ptp(kinetic) > 0.05
    assert np.ptp(potential) > 0.05
    scale = np.abs(run.energy["potential"]).max()
    np.testing.assert_allclose(run.energy["kinetic"], kinetic, rtol=1e-12, atol=1e-13 * scale)
    np.testing.assert_allclose(run.energy["potential"], potential, rtol=1e-12, atol=1e-12 * scale)


def test_a_millionth_of_one_stiffness_is_seen(run_deck, tmp_path):
    """Forces of a run with one element 1e-6 stiffer, energies without: the residual is far above the run's own error."""
    run_deck(elastic_scene(), name="scene")
    scene = Scene(tmp_path / "scene.nml")
    residuals = []
    for young in (2.1e9, 2.1e9 * (1 + 1e-6)):
        run = run_deck(elastic_scene(young), name=f"young{young}")
        kinetic, potential = energies_of(run, scene)
        total = kinetic + potential - run.energy["work"]
        residuals.append(np.abs(total - total[0]).max())
    assert residuals[1] > 10 * residuals[0]
    assert residuals[0] < 1e-3 * 1e-6  # of order 1 J moves in this scene


@pytest.mark.parametrize("name", [*LOOPS, *(name for name in JOINTS if name.startswith("drive"))])
def test_power_balance(name, probe, tmp_path):
    """d(T + V)/dt + dissipated = input at consistent states, from the solver's accelerations and powers.

    A stiffness changed by 1e-6 in the force alone would show.
    """
    scenes = {**LOOPS, **JOINTS}
    twins = Twins(probe, tmp_path, MATERIALS + scenes[name] + "&transient t_end=1e-3 step=1e-5 /\n")
    scene = twins.oracle
    states = [twins.closed_state(seed, t=0.2) for seed in range(3)]
    seen = 0
    for (_, q, v, z, zd), answer in zip(states, twins.evaluate(states)):
        energy_slope = gradient(lambda x, v=v, z=z, zd=zd: scene.kinetic(x, v) + scene.potential(x, z, zd), q)
        slope_z = gradient(lambda x, q=q, zd=zd: batch_potential(scene, q, x, zd), z)
        slope_zd = gradient(lambda x, q=q, z=z: batch_potential(scene, q, z, x), zd)
        flow = [energy_slope @ v, scene.momentum(q, v) @ answer.acceleration, slope_z @ zd, slope_zd @ answer.zdd]
        dissipated, put_in = answer.power
        scale = sum(map(abs, flow)) + abs(dissipated) + abs(put_in)
        residual = abs(sum(flow) + dissipated - put_in)
        assert residual < 1e-12 * scale
        flexible = [body for body in scene.bodies if body.nf]
        stretched = max(
            abs(1e-6 * gradient(body.strain_energy, scene.parts(body, q)[2]) @ scene.parts(body, v)[2]) for body in flexible
        )
        seen += stretched > 1e3 * residual
    assert seen == len(states)


def batch_potential(scene, q, z, zd):
    """Return the potential for a batch of z or of zd."""
    count = max(len(np.atleast_2d(z)), len(np.atleast_2d(zd)))
    pairs = zip(np.broadcast_to(z, (count, scene.nz)), np.broadcast_to(zd, (count, scene.nz)))
    return np.array([scene.potential(q, a, b) for a, b in pairs])
