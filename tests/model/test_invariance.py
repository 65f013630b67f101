"""What must not matter: the words that describe a beam, where the scene lies, its units, the basis, a cut; and Newton's laws."""

from dataclasses import dataclass

import numpy as np
import pytest
from biela.compare import differences
from oracle import Scene
from oracle_probe import Twins
from scenes import ALL, LUMPS, MATERIALS, beam, rigid

SLIDER_CRANK = """&scene gravity=0.0,-9.81 /
&material name='m' density=1600.0 young=2.1e9 ghm_alpha=0.4,0.7 ghm_zeta=1.2,0.5 ghm_omega=700.0,2500.0
  rayleigh_mass=0.8 rayleigh_stiffness=1.0e-7 /
&section name='s' shape='rectangle' width=0.02 height=0.01 /
&body name='crank' kind='rigid' mass=0.4 inertia=1.0e-3 com=0.05,0.0 angle=0.5 /
&body name='rod' {rod} material='m' section='s' position=0.0877582561890372761,0.047942553860420301 angle=-0.1602877 {more} /
&lump body='rod' node=-1 mass=0.2 inertia=1.0e-4 /
&joint name='a' type='revolute' body_a='crank' /
&joint name='b' type='revolute' body_a='rod' node_a=1 body_b='crank' point_b=0.1,0.0 /
&joint name='c' type='slider' body_a='rod' node_a=-1 direction=0.0 /
&force name='t' type='torque' body='crank' moment=6.0 /
&force name='f' type='force' body='rod' node=2 fx=10.0 fy=-30.0 axes='section' /
&sensor name='crank' quantity='angle' body='crank' /
&sensor name='rod' quantity='angle' body='rod' /
&sensor name='tip' quantity='position' body='rod' node=-1 /
&sensor name='mid' quantity='deflection' body='rod' node=2 /
&sensor name='mid_a' quantity='acceleration' body='rod' node=2 /
&sensor name='pin' quantity='reaction' joint='b' /
&transient t_end=0.02 method='rk4' step=4.0e-6 output_step=2.0e-4 /
"""
MOVING = ["crank", "rod", "tip.x", "mid.*", "mid_a.*", "pin.f*"]
BEAM_ROD = "kind='beam' length=0.3 elements=3"
FRAME_ROD = "kind='frame' node_x=0.0,0.1,0.2,0.3 node_y=0.0,0.0,0.0,0.0 element_nodes=1,2,2,3,3,4"


def assert_same(found, expected, tolerance, columns=None):
    """Assert that columns agree to a part of their range (the rule of compare.py)."""
    for difference in differences(found, expected, tolerance, columns):
        assert difference.passed, f"{difference.name}: {difference.error:.2e}"


@pytest.mark.parametrize("more", ["", "reference='clamped'", "reference='clamped' stiffening=.true."])
def test_beam_is_a_straight_frame(more, run_deck):
    as_beam = run_deck(SLIDER_CRANK.format(rod=BEAM_ROD, more=more), name="beam").history
    as_frame = run_deck(SLIDER_CRANK.format(rod=FRAME_ROD, more=more), name="frame").history
    assert np.ptp(as_beam["mid.v"]) > 1e-4
    assert_same(as_frame, as_beam, 1e-9, ["crank", "rod", "tip.x", "mid.*"])
    assert_same(as_frame, as_beam, 1e-8, MOVING)


@pytest.mark.parametrize("more", ["", "reference='clamped'"])
def test_elements_in_a_row_are_those_in_any_order(more, run_deck):
    """The loop over a straight beam's elements in a row against the sparse products that serve all other bodies."""
    loose = FRAME_ROD.replace("1,2,2,3,3,4", "3,4,1,2,2,3")
    row = run_deck(SLIDER_CRANK.format(rod=FRAME_ROD, more=more), name="row").history
    any_order = run_deck(SLIDER_CRANK.format(rod=loose, more=more), name="loose").history
    assert np.ptp(row["mid.v"]) > 1e-4
    assert_same(any_order, row, 1e-9, ["crank", "rod", "tip.x", "mid.*"])


@pytest.mark.parametrize("reference", ["pinned", "clamped"])
def test_all_modes_are_the_nodal_coordinates(reference, run_deck):
    more = f"reference='{reference}'"
    nodal = run_deck(SLIDER_CRANK.format(rod=BEAM_ROD, more=more), name="nodal").history
    modal = run_deck(SLIDER_CRANK.format(rod=BEAM_ROD, more=more + " modes=9"), name="modal").history
    assert_same(modal, nodal, 1e-9, ["crank", "rod", "tip.x", "mid.*"])
    assert_same(modal, nodal, 1e-8, MOVING)
    few = [run_deck(SLIDER_CRANK.format(rod=BEAM_ROD, more=f"{more} modes={n}"), name=f"modes{n}").history for n in (1, 3, 5)]
    errors = [np.abs(run["mid.v"] - nodal["mid.v"]).max() / np.ptp(nodal["mid.v"]) for run in few]
    assert errors[0] > errors[1] > errors[2] > 1e-9
    assert errors[2] < 0.1


@pytest.mark.parametrize("name", ["modal_free", "modal_frame"])
def test_free_modes_are_orthogonal_to_rigid_motions(name, probe, tmp_path):
    """S-bar = 0 and c0 = 0, lumps included: no kinetic energy is shared between frame and modes at the undeformed state."""
    twins = Twins(probe, tmp_path, ALL[name])
    body = next(body for body in twins.oracle.bodies if body.modal)
    at, count = twins.oracle.offset[body.name], twins.oracle.nq
    zero = np.zeros(twins.oracle.nz)
    units = np.eye(count)
    rates = [units[at + k] for k in range(3)] + [units[at + 3 + k] for k in range(body.nf)]
    pairs = [(i, 3 + j) for i in range(3) for j in range(body.nf)]
    states = [(0.0, twins.q0, rate, zero, zero) for rate in rates]
    states += [(0.0, twins.q0, rates[i] + rates[j], zero, zero) for i, j in pairs]
    kinetic = [answer.energy[0] for answer in twins.evaluate(states)]
    for (i, j), together in zip(pairs, kinetic[len(rates) :]):
        assert abs(together - kinetic[i] - kinetic[j]) < 1e-12 * np.sqrt(kinetic[i] * kinetic[j])


# ---------------------------------------------------------------- where the scene lies, and its units


@dataclass
class View:
    """A scene seen from elsewhere: turned, shifted, with another unit of length (values of SI scenes in, text out)."""

    turn: float = 0.0
    shift: tuple = (0.0, 0.0)
    scale: float = 1.0

    def matrix(self):
        """Return the rotation."""
        c, s = np.cos(self.turn), np.sin(self.turn)
        return np.array([[c, -s], [s, c]])

    def point(self, x, y):
        """Return a fixed point as text."""
        x, y = self.scale * (self.matrix() @ (x, y) + self.shift)
        return f"{x:.17g},{y:.17g}"

    def vector(self, x, y):
        """Return a global acceleration (or velocity) as text."""
        x, y = self.scale * self.matrix() @ (x, y)
        return f"{x:.17g},{y:.17g}"

    def length(self, *values):
        """Return lengths, or coordinates in a body's axes, as text."""
        return ",".join(f"{self.scale * value:.17g}" for value in values)

    def power(self, value, power):
        """Return a quantity with the given power of length as text."""
        return f"{value * self.scale**power:.17g}"

    def angle(self, value):
        """Return an angle from the global x axis as text."""
        return f"{value + self.turn:.17g}"


def seen(view):
    """Return a scene with every kind of joint, spring and load that has a direction or a place of its own."""
    v, push = view, view.matrix() @ (20.0, -35.0)
    return f"""&scene gravity={v.vector(0.0, -9.81)} /
&material name='m' density={v.power(1600.0, -3)} young={v.power(2.1e8, -1)} ghm_alpha=0.4,0.7 ghm_zeta=1.2,0.5
  ghm_omega=700.0,2500.0 rayleigh_mass=0.8 /
&section name='s' shape='rectangle' width={v.length(0.02)} height={v.length(0.01)} /
&section name='t' area={v.power(2e-4, 2)} inertia={v.power(3e-9, 4)} /
&body name='crank' kind='rigid' mass=0.4 inertia={v.power(1e-3, 2)} com={v.length(0.05, 0.0)} position={v.point(0.0, 0.0)}
  angle={v.angle(0.5)} angular_velocity=3.0 /
&body name='rod' kind='beam' length={v.length(0.3)} elements=3 material='m' section='s'
  position={v.point(0.0877582561890372761, 0.047942553860420301)} angle={v.angle(-0.16)} /
&body name='arm' kind='frame' node_x={v.length(0.0, 0.1, 0.1)} node_y={v.length(0.0, 0.0, 0.12)} element_nodes=1,2,2,3 material='m'
  section='s','t' reference='clamped' position={v.point(0.5, 0.1)} angle={v.angle(0.3)} /
&body name='block' kind='rigid' mass=0.3 inertia={v.power(2e-4, 2)} position={v.point(0.45, -0.2)} angle={v.angle(0.2)} /
&lump body='rod' node=-1 mass=0.2 inertia={v.power(1e-4, 2)} /
&joint name='a' type='revolute' body_a='crank' point_b={v.point(0.0, 0.0)} /
&joint name='b' type='revolute' body_a='rod' node_a=1 body_b='crank' point_b={v.length(0.1, 0.0)} /
&joint name='c' type='slider' body_a='rod' node_a=-1 point_b={v.point(0.1, 0.0)} direction={v.angle(0.0)} /
&joint name='d' type='weld' body_a='arm' node_a=1 point_b={v.point(0.5, 0.1)} /
&joint name='e' type='prismatic' body_a='block' point_b={v.point(0.45, -0.2)} direction={v.angle(0.4)} /
&joint name='f' type='distance' body_a='block' point_a={v.length(0.01, 0.02)} body_b='rod' node_b=-1 /
&spring name='s' type='linear' body_a='arm' node_a=3 body_b='rod' node_b=2 stiffness=800.0 damping=2.0
  free_length={v.length(0.2)} /
&spring name='w' type='torsional' body_a='rod' node_a=1 body_b='crank' stiffness={v.power(4.0, 2)} ghm_alpha=1.0 ghm_zeta=0.8
  ghm_omega=90.0 /
&spring name='g' type='torsional' body_a='crank' stiffness={v.power(2.0, 2)} /
&force name='t' type='torque_about' body='crank' point={v.length(0.1, 0.0)} centre={v.point(0.0, 0.0)} moment={v.power(5.0, 2)} /
&force name='p' type='force' body='rod' node=3 fx={v.power(push[0], 1)} fy={v.power(push[1], 1)} /
&force name='q' type='force' body='arm' node=-1 fx={v.power(4.0, 1)} fy={v.power(9.0, 1)} axes='section' /
&sensor name='crank' quantity='angle' body='crank' /
&sensor name='rod' quantity='angle' body='rod' /
&sensor name='tip' quantity='position' body='rod' node=-1 /
&sensor name='block' quantity='velocity' body='block' /
&sensor name='mid' quantity='deflection' body='rod' node=2 /
&sensor name='arm' quantity='deflection' body='arm' node=-1 /
&sensor name='mid_a' quantity='acceleration' body='rod' node=2 /
&sensor name='pin' quantity='reaction' joint='b' /
&sensor name='clamp' quantity='reaction' joint='d' /
&transient t_end=0.03 method='rk4' step=1.0e-5 output_step=5.0e-4 /
"""


VECTORS = {"tip": 1, "block": 1, "mid_a": 1, "pin": 1, "clamp": 1}  # power of length
SCALARS = {"mid.u": 1, "mid.v": 1, "mid.r": 0, "arm.u": 1, "arm.v": 1, "arm.r": 0, "pin.m": 2, "clamp.m": 2}


@pytest.mark.parametrize(
    "view",
    [
        View(turn=2.1),
        View(turn=-np.pi / 2),
        View(shift=(3.0, -2.0)),
        View(scale=1000.0),
        View(scale=1e-3),
        View(0.7, (0.4, 0.9), 1000.0),
    ],
    ids=["turned", "upright", "shifted", "millimetres", "kilometres", "all"],
)
def test_place_and_units_do_not_matter(view, run_deck):
    plain, other = (run_deck(seen(v), name=name).history for v, name in ((View(), "plain"), (view, "other")))
    for name, power in VECTORS.items():
        columns = [f"{name}.{axis}" if f"{name}.x" in plain else f"{name}.f{axis}" for axis in "xy"]
        expected = np.stack([plain[column] for column in columns])
        found = view.matrix().T @ np.stack([other[column] for column in columns]) / view.scale**power
        if name == "tip":
            found = found - (view.matrix().T @ view.shift)[:, None]
        assert np.abs(found - expected).max() < 1e-9 * np.ptp(expected), name
    for column, power in SCALARS.items():
        scale = max(np.ptp(plain[column]), 1e-9)
        assert np.abs(other[column] / view.scale**power - plain[column]).max() < 1e-9 * scale, column
    for column in ("crank", "rod"):
        assert np.abs(other[column] - view.turn - plain[column]).max() < 1e-10


# ---------------------------------------------------------------- a beam cut in two


def cantilever(force, cut):
    """Return a clamped beam of four elements under a tip force, whole or cut in the middle into two welded bodies."""
    whole = "&body name='b' kind='beam' length=1.0 elements=4 material='m' section='s' reference='clamped' /\n"
    half = "&body name='{}' kind='beam' length=0.5 elements=2 material='m' section='s' reference='clamped' position={},0.0 /\n"
    bodies = half.format("b0", 0.0) + half.format("b", 0.5) if cut else whole
    weld = "&joint name='cut' type='weld' body_a='b' node_a=1 body_b='b0' node_b=-1 /\n" if cut else ""
    return f"""&material name='m' density=1200.0 young=1.0e8 /
&section name='s' shape='rectangle' width=0.02 height=0.02 /
{bodies}{weld}
&joint name='wall' type='weld' body_a='{"b0" if cut else "b"}' node_a=1 /
&history name='h' kind='ramp' start_value=0.0 end_value=1.0 start=0.0 finish=0.3 /
&force name='f' type='force' body='b' node=-1 fy={force} history='h' /
&sensor name='tip' quantity='position' body='b' node=-1 /
&transient t_end=0.6 method='rk4' step=1.0e-4 output_step=5.0e-3 /
"""


def test_cut_beam_differs_in_second_order(run_deck):
    """Two frames follow the deflection that one linear frame does not: the difference falls four times as the load halves."""
    gaps, deflections = [], []
    for force in (0.2, 0.1, 0.05, 0.025):
        whole, cut = (run_deck(cantilever(force, way), name=f"c{way:d}_{force}").history for way in (False, True))
        gap = np.hypot(whole["tip.x"] - cut["tip.x"], whole["tip.y"] - cut["tip.y"])
        gaps.append(gap.max())
        deflections.append(np.abs(whole["tip.y"]).max())
    assert 0.05 < deflections[0] < 0.1
    for large, small in zip(gaps[:-1], gaps[1:]):
        assert 3.5 < large / small < 4.5
    assert gaps[0] < deflections[0] ** 2


# ---------------------------------------------------------------- Newton and Euler from outside

JOINTS = {  # name: (kind of group, body a, place a, body b)
    "j0": ("joint", "r", "point=0.0,0.0", None),
    "j1": ("joint", "b", "node=1", "r"),
    "j2": ("joint", "w", "point=-0.05,0.01", "b"),
    "j3": ("joint", "c", "point=0.02,0.0", "b"),
    "j4": ("joint", "f", "point=0.03,0.01", "c"),
    "j5": ("joint", "p", "point=0.01,0.0", "r"),
    "d0": ("drive", "r", "point=0.0,0.0", None),
    "d1": ("drive", "p", "point=0.01,0.0", "r"),
}
MASSES = {"r": 0.5, "w": 0.2, "c": 0.3, "f": 0.25, "p": 0.15}


def every_joint():
    """Return a scene in which every joint and drive acts between moving bodies, all sensors included."""
    inertia = {name: 1e-3 * mass for name, mass in MASSES.items()}
    bodies = "".join(
        f"&body name='{name}' kind='rigid' mass={mass} inertia={inertia[name]} com=0.01,-0.005 {at} /\n"
        for (name, mass), at in zip(
            MASSES.items(),
            ("angle=0.3", "position=0.5,0.1 angle=0.2", "position=0.3,0.25", "position=0.4,0.4", "position=0.02,0.11 angle=0.3"),
        )
    )
    sensors = "".join(
        f"&sensor name='{name}' quantity='reaction' {kind}='{name}' /\n"
        f"&sensor name='{name}_at' quantity='position' body='{a}' {at} /\n"
        for name, (kind, a, at, _) in JOINTS.items()
    )
    for name in [*MASSES, "b"]:
        at = "node=1" if name == "b" else "point=0.0,0.0"
        sensors += f"&sensor name='{name}_r' quantity='position' body='{name}' {at} /\n"
        sensors += f"&sensor name='{name}_v' quantity='velocity' body='{name}' {at} /\n"
        sensors += f"&sensor name='{name}_a' quantity='angle' body='{name}' /\n"
        sensors += f"&sensor name='{name}_o' quantity='angular_velocity' body='{name}' /\n"
    sensors += "".join(f"&sensor name='b{k}' quantity='coordinate' body='b' index={k} /\n" for k in range(1, 5))
    return (
        "&scene gravity=1.5,-9.81 /\n"
        "&material name='soft' density=1000.0 young=4.0e6 ghm_alpha=0.6 ghm_zeta=1.2 ghm_omega=80.0 rayleigh_mass=0.4 /\n"
        "&section name='s' shape='rectangle' width=0.02 height=0.02 /\n"
        + bodies
        + beam(material="soft", section="s", length=0.3, rest="axial=.false. position=0.19,0.06 angle=0.2")
        + """&lump body='b' node=2 mass=0.05 inertia=1.0e-5 /
&joint name='j0' type='revolute' body_a='r' /
&joint name='j1' type='revolute' body_a='b' node_a=1 body_b='r' point_b=0.2,0.0 /
&joint name='j2' type='weld' body_a='w' point_a=-0.05,0.01 body_b='b' node_b=-1 /
&joint name='j3' type='slider' body_a='c' point_a=0.02,0.0 body_b='b' node_b=2 direction=0.6 /
&joint name='j4' type='distance' body_a='f' point_a=0.03,0.01 body_b='c' point_b=0.0,0.02 /
&joint name='j5' type='prismatic' body_a='p' point_a=0.01,0.0 body_b='r' point_b=0.0,0.1 direction=0.4 /
&history name='swing' kind='sine' offset=0.3 amplitude=0.5 frequency=1.5 /
&history name='slide' kind='cycloid' start_value=0.0 end_value=0.1 start=0.0 finish=0.3 /
&drive name='d0' type='rotation' body_a='r' history='swing' /
&drive name='d1' type='position' body_a='p' point_a=0.01,0.0 body_b='r' point_b=0.0,0.1 direction=0.4 history='slide' /
"""
        + sensors
        + "&transient t_end=0.2 method='rk4' step=5.0e-5 output_step=4.0e-4 /\n"
    )


def rate_of_change(values, step):
    """Return the time derivative (sixth order, central) of rows, three rows less at each end."""
    weights = np.array([-1, 9, -45, 0, 45, -9, 1]) / (60 * step)
    return sum(w * values[k : len(values) - 6 + k] for k, w in enumerate(weights))


def test_reactions_obey_newton_and_euler(run_deck, tmp_path):
    """Momentum and angular momentum of every body, from its own motion, change by the reported forces and gravity alone."""
    history = run_deck(every_joint(), name="scene").history
    scene = Scene(tmp_path / "scene.nml", assembled=None)
    times, step = history.time, history.time[1] - history.time[0]
    q, v = np.zeros((len(times), scene.nq)), np.zeros((len(times), scene.nq))
    for body in scene.bodies:
        at = scene.offset[body.name]
        for target, place, angle in ((q, "_r", "_a"), (v, "_v", "_o")):
            columns = [f"{body.name}{place}.x", f"{body.name}{place}.y", f"{body.name}{angle}"]
            target[:, at : at + 3] = np.stack([history[column] for column in columns], axis=1)
    at = scene.offset["b"] + 3
    for k in range(scene.body["b"].nf):
        q[:, at + k], v[:, at + k] = history[f"b{k + 1}.q"], history[f"b{k + 1}.qd"]
    momentum = scene.momentum(q, v)
    middle = slice(3, -3)
    for body in scene.bodies:
        at = scene.offset[body.name]
        flow = momentum[:, at : at + 2]
        spin = momentum[:, at + 2] + cross(q[:, at : at + 2], flow)
        weight = body.weight.sum() * scene.gravity
        place, theta, qf = scene.parts(body, q)
        local = scene.local(body, qf)
        turn = np.stack([np.stack([np.cos(theta), -np.sin(theta)], -1), np.stack([np.sin(theta), np.cos(theta)], -1)], -2)
        centre = place + np.einsum("tij,tpj,p->ti", turn, local, body.weight / body.weight.sum())
        force = np.broadcast_to(weight, centre.shape).copy()
        moment = cross(centre, force)
        acting = 0.0
        for name, (_, first, _, second) in JOINTS.items():
            sign = (first == body.name) - (second == body.name)
            if sign:
                push = sign * np.stack([history[f"{name}.fx"], history[f"{name}.fy"]], axis=1)
                point = np.stack([history[f"{name}_at.x"], history[f"{name}_at.y"]], axis=1)
                force += push
                moment += cross(point, push) + sign * history[f"{name}.m"]
                acting = max(acting, np.abs(push).max())
        assert acting > 0.01
        assert np.abs(rate_of_change(flow, step) - force[middle]).max() < 2e-7 * acting, body.name
        assert np.abs(rate_of_change(spin, step) - moment[middle]).max() < 2e-7 * np.abs(moment).max(), body.name


def cross(a, b):
    """Return the plane cross product of rows."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def test_same_lumped_body_as_rigid(run_deck):
    """A beam that is not flexible moves as the rigid body with its integrated mass properties."""
    mass, length = 1600.0 * 0.02 * 0.012 * 0.4, 0.4
    total = mass + 0.3 + 0.05
    com = (mass * length / 2 + 0.3 * length / 2 + 0.05 * length) / total
    about_origin = mass * length**2 / 3 + 0.3 * (length / 2) ** 2 + 0.05 * length**2 + 2.0e-3 + 4.0e-4
    tail = """&joint name='a' type='revolute' body_a='b' {at} /
&sensor name='a' quantity='angle' body='b' /
&sensor name='a_r' quantity='reaction' joint='a' /
&transient t_end=0.5 method='rk4' step=1.0e-3 /
"""
    integrated = MATERIALS + beam(rest="flexible=.false. angle=0.3") + LUMPS + tail.format(at="node_a=1")
    stated = (
        MATERIALS
        + f"&body name='b' kind='rigid' mass={total:.17g} inertia={about_origin - total * com**2:.17g} com={com:.17g},0.0\n"
        + "  angle=0.3 /\n"
        + rigid(name="unused")
        + tail.format(at="")
    )
    assert_same(run_deck(integrated, name="i").history, run_deck(stated, name="s").history, 1e-11, ["a", "a_r.fx", "a_r.fy"])
