"""Every sensor against a figure that does not come from it: differences of other columns, Newton's and Euler's laws, statics."""

from __future__ import annotations

import numpy as np
import pytest

HEAD = """&scene title='sensors' gravity=0.6,-9.81 /
&material name='m' density=1200.0 young=1.0e8 rayleigh_stiffness=1.0e-5 ghm_alpha=0.5,1.5 ghm_zeta=1.5,0.6 ghm_omega=300.0,90.0 /
&section name='s' shape='rectangle' width=0.02 height=0.012 /
"""
AREA, WEIGHT = 0.02 * 0.012, 1200.0 * 0.02 * 0.012
BODIES = """&body name='arm' kind='rigid' mass=0.5 inertia=4.0e-3 com=0.1,0.02 angle=0.2 /
&body name='b' kind='beam' length=0.4 elements=2 material='m' section='s'
  position=0.29401997335237250,0.059600799238518366 angle=-0.5 reference='{reference}' {more} /
&lump body='b' node=-1 mass=0.05 inertia=1.0e-5 /
&joint name='o' type='revolute' body_a='arm' /
&joint name='e' type='revolute' body_a='b' node_a=1 body_b='arm' point_b=0.3,0.0 /
&force name='f' type='force' body='b' node=-1 fy=0.3 axes='body' /
&spring name='k' type='torsional' body_a='b' node_a=1 body_b='arm' stiffness=0.4 damping=1.0e-3 free_angle=-0.3
  ghm_alpha=2.0 ghm_zeta=1.2 ghm_omega=40.0 /
"""
POINTS = {"p": "body='arm' point=0.12,-0.05", "n": "body='b' node=2", "t": "body='b' node=-1"}


def differentiate(values: np.ndarray, h: float) -> np.ndarray:
    """Return the derivative by the central formula of order 6; three rows fewer at each end."""
    c = (-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0)
    n = len(values) - 6
    return sum(w * values[k : k + n] for k, w in enumerate(c)) / (60.0 * h)


def close(found: np.ndarray, expected: np.ndarray, share: float = 1e-6) -> None:
    """Assert equality to a share of the expected values' largest."""
    np.testing.assert_allclose(found, expected, rtol=0, atol=share * np.abs(expected).max())


def pendulum(more: str = "", reference: str = "pinned") -> str:
    """Return a rigid arm with a flexible one hinged to it by a viscoelastic spring."""
    return HEAD + BODIES.format(reference=reference, more=more)


def transient(t_end: float, step: float) -> str:
    """Return a &transient group that writes every step."""
    return f"&transient t_end={t_end!r} method='rk4' step={step!r} motion_step={step!r} /\n"


VARIANTS = [("pinned", ""), ("clamped", ""), ("clamped", "modes=6"), ("clamped", "stiffening=.true."), ("pinned", "axial=.false.")]


@pytest.fixture(scope="module", params=VARIANTS, ids=" ".join)
def run(request, run_deck_once):
    """One run with all kinematic sensors, for each kind of flexible body."""
    reference, more = request.param
    text = pendulum(more, reference)
    for name, place in POINTS.items():
        for quantity in ("position", "velocity", "acceleration", "angle", "angular_velocity", "angular_acceleration"):
            where = place.split(" point")[0] if "ang" in quantity else place
            text += f"&sensor name='{name}_{quantity}' quantity='{quantity}' {where} /\n"
    for quantity in ("position", "velocity", "acceleration", "distance"):
        text += f"&sensor name='seen_{quantity}' quantity='{quantity}' body='b' node=-1 body_b='arm' point_b=0.12,-0.05 /\n"
    for quantity in ("angle", "angular_velocity", "angular_acceleration"):
        text += f"&sensor name='seen_{quantity}' quantity='{quantity}' body='b' node=-1 body_b='arm' /\n"
    for node in (1, 2, 3):
        text += f"&sensor name='d{node}' quantity='deflection' body='b' node={node} /\n"
    text += "&sensor name='frame' quantity='angle' body='b' /\n&sensor name='q' quantity='coordinate' body='b' index=3 /\n"
    for joint in ("o", "e"):
        text += f"&sensor name='{joint}' quantity='reaction' joint='{joint}' /\n"
    text += "&sensor name='k' quantity='spring' spring='k' /\n&sensor name='kp' quantity='power' spring='k' /\n"
    text += "&sensor name='fp' quantity='power' force='f' /\n"
    text += "".join(f"&sensor name='e_{body}' quantity='energy' body='{body}' /\n" for body in ("arm", "b"))
    text += "".join(f"&sensor name='i{e}' quantity='internal' body='b' element={e} /\n" for e in (1, 2))
    text += "&sensor name='most' quantity='stress' body='b' /\n"
    return run_deck_once(text + transient(0.06, 2.0e-5))


def test_rates_are_the_derivatives_of_what_they_rate(run):
    h = run.history
    step = h.time[1]
    for name in POINTS:
        for c in ("x", "y"):
            close(differentiate(h[f"{name}_position.{c}"], step), h[f"{name}_velocity.{c}"][3:-3])
            close(differentiate(h[f"{name}_velocity.{c}"], step), h[f"{name}_acceleration.{c}"][3:-3], 2e-5)
        close(differentiate(h[f"{name}_angle"], step), h[f"{name}_angular_velocity"][3:-3])
        close(differentiate(h[f"{name}_angular_velocity"], step), h[f"{name}_angular_acceleration"][3:-3], 2e-5)
    close(differentiate(h["q.q"], step), h["q.qd"][3:-3])
    close(differentiate(h["q.qd"], step), h["q.qdd"][3:-3], 2e-5)


def test_what_is_measured_against_another_marker_is_the_difference(run):
    h = run.history
    for quantity in ("position.x", "velocity.x", "acceleration.y", "angle", "angular_velocity", "angular_acceleration"):
        np.testing.assert_array_equal(h[f"seen_{quantity}"], h[f"t_{quantity}"] - h[f"p_{quantity}"])
    distance = np.hypot(h["seen_position.x"], h["seen_position.y"])
    np.testing.assert_allclose(h["seen_distance"], distance, rtol=1e-15)
    assert np.ptp(distance) > 1e-2


def test_powers_and_energies_make_the_balance(run):
    """Kinetic energy is the sum of the bodies'; the work is the integral of the force's power; a spring takes f d'."""
    h, e = run.history, run.energy
    np.testing.assert_allclose(h["e_arm.kinetic"] + h["e_b.kinetic"], e["kinetic"], rtol=0, atol=1e-14 * e["kinetic"].max())
    step = h.time[1]
    close(h["fp"][3:-3], differentiate(e["work"], step), 1e-5)
    close(h["kp"][3:-3], -h["k.f"][3:-3] * differentiate(h["k.d"], step), 1e-5)
    np.testing.assert_array_equal(h["e_arm.strain"], 0.0)
    assert h["e_b.strain"].max() > 0.0


def test_the_largest_stress_is_that_of_the_place_it_names(run):
    """The first of equal ones counts, as both elements have the stress of the node between them."""
    h = run.history
    second = h["i2.s"] > (1 + 1e-9) * h["i1.s"]
    assert second.any()
    assert not second.all()
    np.testing.assert_array_equal(h["most.element"], 1 + second)
    for part in ("s", "top", "bottom", "along"):
        np.testing.assert_array_equal(h[f"most.{part}"], np.where(second, h[f"i2.{part}"], h[f"i1.{part}"]))
    np.testing.assert_array_equal(h["most.node"], h["most.element"] + (h["most.along"] > 0.5))
    for one in ("i1", "i2"):
        np.testing.assert_array_equal(h[f"{one}.s"], np.maximum(np.abs(h[f"{one}.top"]), np.abs(h[f"{one}.bottom"])))


LINKAGE = """&scene gravity=0.0,0.0 /
&material name='m' density=1500.0 young=1.0e8 ghm_alpha=0.5 ghm_zeta=1.2 ghm_omega=900.0 prony_alpha=0.3 prony_tau=1e-3
  rayleigh_stiffness=1e-6 /
&section name='s' shape='rectangle' width=0.02 height=0.02 /
&body name='crank' mass=0.2 inertia=1e-3 com=0.05,0.0 angle={70*deg} /
&body name='coupler' kind='beam' length=0.4 elements=2 material='m' section='s'
  position={0.1*cos(70*deg)},{0.1*sin(70*deg)} angle=0.3 /
&body name='rocker' mass=0.5 inertia=0.02 com=0.15,0.0 position=0.45,0.0 angle=1.6 /
&joint name='a' type='revolute' body_a='crank' /
&joint name='b' type='revolute' body_a='coupler' node_a=1 body_b='crank' point_b=0.1,0.0 /
&joint name='c' type='revolute' body_a='rocker' point_a=0.25,0.0 body_b='coupler' node_b=-1 /
&joint name='d' type='revolute' body_a='rocker' point_b=0.45,0.0 friction=0.2 pin_radius=0.02 preload=0.1 /
&history name='turn' kind='sine' amplitude=0.5 frequency=5.0 offset=1.2 /
&drive name='motor' body_a='crank' history='turn' relative=.true. /
&history name='push' kind='sine' amplitude=30.0 frequency=8.0 /
&force name='f' body='coupler' node=2 fx=1.0 history='push' axes='section' /
&spring name='k' type='torsional' body_a='rocker' stiffness=20.0 damping=0.1 ghm_alpha=1 ghm_zeta=1 ghm_omega=50 free_angle=1.5 /
"""
SOURCES = {"a": "joint", "b": "joint", "c": "joint", "d": "joint", "motor": "drive", "f": "force", "k": "spring"}
INTEGRATED = [
    ("method='rk4' step=4e-5", 1e-7),
    ("method='dopri5' tolerance=1e-9", 1e-12),
    ("method='radau' tolerance=1e-8", 1e-9),
    ("method='generalized_alpha' step=1e-4", 2e-4),
]


@pytest.mark.parametrize(("method", "near"), INTEGRATED, ids=[m.split("'")[1] for m, _ in INTEGRATED])
def test_each_body_has_its_own_balance(run_deck, method, near):
    """What joints, drives, forces and springs bring a body is in its energies, or dissipated there."""
    text = LINKAGE + f"&transient t_end=0.04 {method} output_step=2e-4 /\n"
    for name, kind in SOURCES.items():
        text += (
            f"&sensor name='{name}' quantity='work' {kind}='{name}' /\n&sensor name='p{name}' quantity='power' {kind}='{name}' /\n"
        )
    text += "".join(f"&sensor name='e_{body}' quantity='energy' body='{body}' /\n" for body in ("crank", "coupler", "rocker"))
    run = run_deck(text)
    h, e = run.history, run.energy
    size = near * np.ptp(h["motor"])
    bodies = {
        "crank": h["motor"] + h["a"] - h["b"],
        "coupler": h["b"] - h["c"] + h["f"],
        "rocker": h["c"] + h["d"] + h["k"],
    }
    for body, brought in bodies.items():
        has = h[f"e_{body}.kinetic"] + h[f"e_{body}.strain"]
        assert np.abs(has - has[0] + h[f"e_{body}.dissipated"] - brought).max() < size, body
    assert np.abs(h["motor"] + h["f"] - e["work"]).max() < 1e-12
    assert np.abs(h["d"] + e["friction"]).max() < 1e-12
    assert np.abs(h["a"]).max() < 1e-12
    assert h["e_coupler.dissipated"][-1] > 1e-5
    for name in SOURCES:  # events have corners of powers
        rate = differentiate(h[name], 2e-4)
        assert np.median(np.abs(rate - h[f"p{name}"][3:-3])) <= 1e-4 * np.ptp(h[f"p{name}"]) + 1e-12, name


def test_deflections_and_section_angles_fit_the_motion(run):
    h, m = run.history, run.motion
    c, s = np.cos(m["b.angle"]), np.sin(m["b.angle"])
    np.testing.assert_array_equal(h["frame"], m["b.angle"])
    for node in (1, 2, 3):
        dx, dy = m[f"b.{node}.x"] - m["b.x"], m[f"b.{node}.y"] - m["b.y"]
        np.testing.assert_allclose(h[f"d{node}.u"], c * dx + s * dy - 0.2 * (node - 1), rtol=0, atol=1e-14)
        np.testing.assert_allclose(h[f"d{node}.v"], -s * dx + c * dy, rtol=0, atol=1e-14)
    np.testing.assert_allclose(h["t_angle"], h["frame"] + h["d3.r"], rtol=0, atol=1e-14)
    np.testing.assert_allclose(h["n_position.x"], m["b.2.x"], rtol=0, atol=1e-14)
    assert np.abs(h["d3.r"] - h["d1.r"]).max() > 1e-2


def first_moment(run) -> np.ndarray:
    """Return the integral of the positions over the flexible body's mass, shape (2, rows) [kg m], by the shape functions."""
    h, m = run.history, run.motion
    axis = np.array([-np.sin(m["b.angle"]), np.cos(m["b.angle"])])  # body y
    total = 0.05 * np.array([m["b.3.x"], m["b.3.y"]])
    for k in (1, 2):
        ends = [np.array([m[f"b.{node}.x"], m[f"b.{node}.y"]]) for node in (k, k + 1)]
        total = total + WEIGHT * 0.2 * (0.5 * (ends[0] + ends[1]) + 0.2 / 12 * (h[f"d{k}.r"] - h[f"d{k + 1}.r"]) * axis)
    return total


def test_reactions_keep_newtons_and_eulers_laws(run):
    """The momenta of both bodies, from differentiated positions, change as the reported forces say."""
    h, m = run.history, run.motion
    step, gravity = h.time[1], np.array([[0.6], [-9.81]])

    def twice(values):
        return np.array([differentiate(differentiate(row, step), step) for row in np.atleast_2d(values)])

    inside = slice(6, -6)
    elbow = np.array([h["e.fx"], h["e.fy"]])[:, inside]  # on the beam
    base = np.array([h["o.fx"], h["o.fy"]])[:, inside]  # on the arm
    angle = h["frame"][inside]
    push = 0.3 * np.array([-np.sin(angle), np.cos(angle)])
    mass = 0.05 + 0.4 * WEIGHT
    close(elbow, twice(first_moment(run)) - mass * gravity - push, 3e-5)
    c, s = np.cos(m["arm.angle"]), np.sin(m["arm.angle"])
    centre = np.array([m["arm.x"] + 0.1 * c - 0.02 * s, m["arm.y"] + 0.1 * s + 0.02 * c])
    close(base, 0.5 * twice(centre) - 0.5 * gravity + elbow, 3e-5)
    tip = np.array([m["b.x"], m["b.y"]])[:, inside]  # not the pin itself for every reference, so take its position
    tip = np.array([m["b.1.x"], m["b.1.y"]])[:, inside]
    to_base, to_tip = np.array([m["arm.x"], m["arm.y"]])[:, inside] - centre[:, inside], tip - centre[:, inside]
    moment = h["k.f"][inside] + to_base[0] * base[1] - to_base[1] * base[0] - to_tip[0] * elbow[1] + to_tip[1] * elbow[0]
    close(moment, 4.0e-3 * twice(m["arm.angle"])[0], 3e-5)
    for joint in ("o", "e"):
        np.testing.assert_array_equal(h[f"{joint}.m"], 0.0)  # pins hold no moment


def test_the_springs_deformation(run):
    h = run.history
    np.testing.assert_allclose(h["k.d"], h["frame"] + h["d1.r"] - h["p_angle"] + 0.3, rtol=0, atol=1e-14)


def spring_force(d: np.ndarray, h: float, k: float, c: float, terms: list) -> np.ndarray:
    """Return force or moment of a spring with GHM terms (alpha, zeta, omega), d given at steps of h, relaxed at first.

    Each z'' = omega^2 (d - z) - 2 zeta omega z' is taken exactly for a d that is linear over a step.
    """
    force = k * d
    force[3:-3] += c * differentiate(d, h)
    for alpha, zeta, omega in terms:
        a = np.array([[0, 1, 0, 0], [-(omega**2), -2 * zeta * omega, omega**2, 0], [0, 0, 0, 1], [0, 0, 0, 0]])
        step = np.linalg.matrix_power(np.eye(4) + a * h / 4096 + a @ a * (h / 4096) ** 2 / 2, 4096)
        x, z = np.array([d[0], 0.0, 0.0, 0.0]), np.empty_like(d)
        z[0] = d[0]
        for n in range(len(d) - 1):
            x[2:] = d[n], (d[n + 1] - d[n]) / h
            x = step @ x
            z[n + 1] = x[0]
        force = force + k * alpha * (d - z)
    return force


def test_the_springs_moment_with_its_dissipative_part(run):
    h = run.history
    expected = spring_force(h["k.d"].copy(), h.time[1], 0.4, 1.0e-3, [(2.0, 1.2, 40.0)])
    close(h["k.f"][3:-3], expected[3:-3], 1e-5)
    assert np.abs(h["k.f"] - 0.4 * h["k.d"]).max() > 0.2 * np.abs(h["k.f"]).max()


def test_a_linear_spring_between_two_bodies(run_deck):
    """Newton's law for the body that hangs on it; tension is positive."""
    text = HEAD + "&body name='a' kind='rigid' mass=0.4 inertia=1.0e-3 position=0.1,0.2 angular_velocity=3.0 /\n"
    text += "&body name='c' kind='rigid' mass=0.7 inertia=1.0e-3 position=0.6,-0.3 /\n"
    text += "&spring name='k' type='linear' body_a='a' body_b='c' stiffness=80.0 damping=0.7 free_length=0.5\n"
    text += " ghm_alpha=0.5,1.0 ghm_zeta=1.0,2.0 ghm_omega=30.0,200.0 /\n&sensor name='k' quantity='spring' spring='k' /\n"
    for name in ("a", "c"):
        text += f"&sensor name='{name}' quantity='position' body='{name}' /\n"
    h = run_deck(text + transient(0.4, 2.0e-4)).history
    step = h.time[1]
    line = np.array([h["c.x"] - h["a.x"], h["c.y"] - h["a.y"]])
    length = np.hypot(*line)
    np.testing.assert_allclose(h["k.d"], length - 0.5, rtol=0, atol=1e-14)
    close(h["k.f"][3:-3], spring_force(length - 0.5, step, 80.0, 0.7, [(0.5, 1.0, 30.0), (1.0, 2.0, 200.0)])[3:-3], 1e-5)
    for c, gravity, k in (("x", 0.6, 0), ("y", -9.81, 1)):
        acceleration = differentiate(differentiate(h[f"a.{c}"], step), step)
        close(0.4 * (acceleration - gravity), (h["k.f"] * line[k] / length)[6:-6], 1e-5)


@pytest.mark.parametrize("pull", [0.5, -0.5])
def test_internal_forces_of_a_clamped_element_in_statics(pull, run_deck):
    """F across the tip, slowly: q = F, m1 = F L, m2 = 0; with P along it n = P; the stress is |N|/A + |M| (h/2)/I."""
    text = HEAD.replace("gravity=0.6,-9.81", "").replace("1.0e-5", "1.0e-3")
    text += "&body name='b' kind='beam' length=0.4 elements=1 material='m' section='s' reference='clamped' angle=0.7 /\n"
    text += "&joint name='w' type='weld' body_a='b' node_a=1 /\n"
    text += "&history name='slow' kind='ramp' start_value=0.0 end_value=1.0 start=0.0 finish=2.0 /\n"
    text += f"&force name='f' type='force' body='b' node=2 fx={pull} fy=0.02 axes='body' history='slow' /\n"
    text += "&sensor name='d' quantity='deflection' body='b' node=2 /\n"
    text += "&sensor name='i' quantity='internal' body='b' element=1 /\n&sensor name='w' quantity='reaction' joint='w' /\n"
    h = run_deck(text + "&transient t_end=3.0 method='rk4' step=2.0e-5 output_step=0.1 /\n").history
    n, q, m1, m2, s = (h[f"i.{c}"][-1] for c in ("n", "q", "m1", "m2", "s"))
    assert n == pytest.approx(pull, rel=1e-6)
    assert q == pytest.approx(0.02, rel=1e-4)
    assert m1 == pytest.approx(0.02 * 0.4, rel=1e-4)
    assert abs(m2) < 1e-4 * m1
    assert s == pytest.approx(abs(n) / AREA + m1 * 0.006 / (0.02 * 0.012**3 / 12), rel=1e-12)
    moment = 0.02 * (0.4 + h["d.u"][-1]) - pull * h["d.v"][-1]  # of both forces where they act, about the wall
    assert h["w.m"][-1] == pytest.approx(-moment, rel=1e-4)
    assert np.hypot(h["w.fx"][-1], h["w.fy"][-1]) == pytest.approx(np.hypot(0.5, 0.02), rel=1e-6)


@pytest.mark.parametrize("more", ["", "modes=3", "stiffening=.true.", "axial=.false."])
def test_internal_forces_in_motion_are_those_on_the_tip_mass(run_deck, more):
    """A beam without noticeable mass: what it carries is the lump's F - m a, elastic, Rayleigh and GHM parts together."""
    density = "1.0e-1" if "axial" in more else "1.0e-5"
    share = 2e-3 if "axial" in more else 1e-6
    text = HEAD.replace("gravity=0.6,-9.81", "").replace("density=1200.0", f"density={density}")
    text += "&body name='apart' mass=1.0 inertia=1.0 position=5.0,0.0 /\n"
    text += f"&body name='b' kind='beam' length=0.4 elements=1 material='m' section='s' reference='clamped' {more} /\n"
    text += "&lump body='b' node=-1 mass=0.2 inertia=1.0e-3 /\n&joint name='w' type='weld' body_a='b' node_a=1 /\n"
    text += "&force name='f' type='force' body='b' node=2 fx=2.0 fy=1.0 /\n"
    text += "&force name='t' type='torque' body='b' node=2 moment=0.05 /\n"
    text += (
        "&sensor name='i' quantity='internal' body='b' element=1 /\n&sensor name='a' quantity='acceleration' body='b' node=2 /\n"
    )
    text += "&sensor name='r' quantity='angular_acceleration' body='b' node=2 /\n&sensor name='w' quantity='reaction' joint='w' /\n"
    h = run_deck(text + "&transient t_end=0.1 method='rk4' step=2.0e-5 output_step=2.0e-4 accept_unstable=.true. /\n").history
    q, m2 = 1.0 - 0.2 * h["a.y"], 0.05 - 1.0e-3 * h["r"]
    if "stiffening" not in more:  # with it the chord's turning adds N times the slope
        close(h["i.q"], q, share)
        close(h["i.m1"], m2 + 0.4 * q, share)
        close(h["i.m2"], m2, share)
    if "axial" not in more:
        close(h["i.n"], 2.0 - 0.2 * h["a.x"])
    close(h["w.fy"], -q, share)
    close(h["w.fx"], -(2.0 - 0.2 * h["a.x"]), share)
    assert np.ptp(h["i.q"]) > 0.3


def test_reactions_of_lines_links_and_drives(run_deck):
    """A slider pushes across its line, a link along itself, a prismatic joint holds a moment; a and b see opposite forces."""
    body = "&body name='a' kind='rigid' mass=0.4 inertia=2.0e-3 com=0.1,0.0 position=0.1,0.1 angle=0.4 /\n"
    other = "&body name='c' kind='rigid' mass=0.6 inertia=3.0e-3 com=-0.1,0.0 position=0.4,0.3 angle=-0.3 /\n"
    joints = (
        "&joint name='s' type='slider' body_a='a' point_a=0.0,0.0 point_b=0.0,0.05 direction=0.4636476090008061 /\n",
        "&joint name='d' type='distance' body_a='c' point_a=-0.2,0.0 body_b='a' point_b=0.2,0.0 /\n",
        "&joint name='p' type='prismatic' body_a='c' point_a=0.0,0.0 point_b=0.0,0.3 direction=0.0 /\n",
    )
    sensors = "".join(f"&sensor name='{n}' quantity='reaction' joint='{n}' /\n" for n in "sdp")
    for name, point in (("a", "0.2,0.0"), ("c", "-0.2,0.0"), ("ac", "0.1,0.0"), ("cc", "-0.1,0.0"), ("c0", "0.0,0.0")):
        sensors += f"&sensor name='{name}_p' quantity='position' body='{name[0]}' point={point} /\n"
        sensors += f"&sensor name='{name}_a' quantity='acceleration' body='{name[0]}' point={point} /\n"
    sensors += "&sensor name='spin' quantity='angular_acceleration' body='c' /\n"
    text = HEAD + body + other
    h = run_deck(text + "".join(joints) + sensors + transient(0.3, 5.0e-4)).history
    along = h["s.fx"] * np.cos(np.arctan(0.5)) + h["s.fy"] * np.sin(np.arctan(0.5))
    np.testing.assert_allclose(along, 0.0, rtol=0, atol=1e-12 * np.abs(h["s.fx"]).max())
    link = np.array([h["c_p.x"] - h["a_p.x"], h["c_p.y"] - h["a_p.y"]])
    cross = h["d.fx"] * link[1] - h["d.fy"] * link[0]
    np.testing.assert_allclose(cross, 0.0, rtol=0, atol=1e-12 * np.abs(h["d.fx"]).max())
    for c, gravity in (("x", 0.6), ("y", -9.81)):
        close(h[f"s.f{c}"] - h[f"d.f{c}"], 0.4 * (h[f"ac_a.{c}"] - gravity), 1e-10)
        close(h[f"p.f{c}"] + h[f"d.f{c}"], 0.6 * (h[f"cc_a.{c}"] - gravity), 1e-9)
    np.testing.assert_allclose(h["p.fx"], 0.0, rtol=0, atol=1e-12 * np.abs(h["p.fy"]).max())
    arms = {n: (h[f"{k}_p.x"] - h["cc_p.x"], h[f"{k}_p.y"] - h["cc_p.y"]) for n, k in (("d", "c"), ("p", "c0"))}
    moment = h["p.m"] + sum(x * h[f"{n}.fy"] - y * h[f"{n}.fx"] for n, (x, y) in arms.items())
    np.testing.assert_allclose(moment, 3.0e-3 * h["spin"], rtol=0, atol=1e-10 * np.abs(h["p.m"]).max())
    swapped = joints[1].replace(
        "body_a='c' point_a=-0.2,0.0 body_b='a' point_b=0.2,0.0", "body_a='a' point_a=0.2,0.0 body_b='c' point_b=-0.2,0.0"
    )
    other_way = run_deck(text + joints[0] + swapped + joints[2] + sensors + transient(0.3, 5.0e-4), name="swapped").history
    for c in ("fx", "fy"):
        close(other_way[f"d.{c}"], -h[f"d.{c}"], 1e-9)


def test_the_torque_of_a_drive(run_deck):
    """Euler's law for a driven rigid pendulum: torque = I_o alpha - m g x_c."""
    text = (
        HEAD + "&body name='a' kind='rigid' mass=0.4 inertia=2.0e-3 com=0.1,0.0 /\n&joint name='o' type='revolute' body_a='a' /\n"
    )
    text += (
        "&history name='h' kind='sine' amplitude=0.8 frequency=2.0 /\n&drive name='m' type='rotation' body_a='a' history='h' /\n"
    )
    h = run_deck(text + "&sensor name='m' quantity='reaction' drive='m' /\n" + transient(0.5, 1.0e-3)).history
    w = 4 * np.pi
    angle = 0.8 * np.sin(w * h.time)
    gravity = 0.4 * 0.1 * (np.cos(angle) * -9.81 - np.sin(angle) * 0.6)
    close(h["m.m"], -(2.0e-3 + 0.4 * 0.1**2) * w**2 * angle - gravity, 1e-11)
    assert np.ptp(h["m.m"]) > 1.0


def test_each_element_of_a_modal_body_answers_with_its_own_material(run_deck):
    """With all modes kept a body of two viscoelastic materials is the nodal one, in every element's forces too."""
    found = []
    for modes in (0, 6):
        text = f"""&scene gravity=0.0,-9.81 /
&material name='slow' density=1200.0 young=1.0e8 ghm_alpha=1.5 ghm_zeta=1.2 ghm_omega=60.0 /
&material name='fast' density=1200.0 young=1.0e8 ghm_alpha=0.4,0.3 ghm_zeta=0.8,2.0 ghm_omega=900.0,200.0 /
&section name='s' shape='rectangle' width=0.02 height=0.012 /
&body name='b' kind='beam' length=0.4 elements=2 material='slow' section='s' element_material='slow','fast'
  reference='clamped' modes={modes} /
&joint name='o' type='weld' body_a='b' node_a=1 /
&force name='f' type='force' body='b' node=-1 fx=2.0 fy=0.3 /
&sensor name='e1' quantity='internal' body='b' element=1 /
&sensor name='e2' quantity='internal' body='b' element=2 /
&transient t_end=0.02 method='rk4' step=1e-5 output_step=1e-4 /
"""
        found.append(run_deck(text, name=f"modes{modes}").history)
    for name in found[0].names[1:]:
        scale = max(np.abs(found[0][other]).max() for other in found[0].names if found[0].units[other] == found[0].units[name])
        np.testing.assert_allclose(found[1][name], found[0][name], rtol=0, atol=1e-6 * scale, err_msg=name)
