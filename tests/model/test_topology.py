"""Mechanisms as graphs: freedoms and redundancy counted, assembly, impossible drives, joints and drives in closed form."""

from __future__ import annotations

import re

import numpy as np
import pytest
from biela.histories import read

GRAVITY = "&scene title='t' gravity=0.0,-9.81 /\n"
WEIGHTLESS = "&scene title='t' /\n"
STEEL = "&material name='m' density=1000.0 young=1.0e9 /\n&section name='s' shape='rectangle' width=0.02 height=0.02 /\n"


def rigid(name: str, at: str = "0.0,0.0", angle: float = 0.0, com: str = "0.5,0.0", more: str = "") -> str:
    """Return a &body group of a rigid body of 2 kg and 0.3 kg m2."""
    return f"&body name='{name}' kind='rigid' mass=2.0 inertia=0.3 com={com} position={at} angle={angle!r} {more} /\n"


def beam(name: str, more: str = "", elements: int = 2) -> str:
    """Return a &body group of a beam of 1 m."""
    return f"&body name='{name}' kind='beam' length=1.0 elements={elements} material='m' section='s' {more} /\n"


def joint(name: str, kind: str, a: str, point_a: str, b: str = "ground", point_b: str = "", more: str = "") -> str:
    """Return a &joint group; places are deck text such as `point_a=1.0,0.0`."""
    return f"&joint name='{name}' type='{kind}' body_a='{a}' {point_a} body_b='{b}' {point_b} {more} /\n"


def sensor(name: str, quantity: str, what: str) -> str:
    """Return a &sensor group."""
    return f"&sensor name='{name}' quantity='{quantity}' {what} /\n"


def transient(t_end: float, step: float = 1.0e-3) -> str:
    """Return a &transient group."""
    return f"&transient t_end={t_end!r} method='rk4' step={step!r} /\n"


def parallelogram(links: int, angle: float, spins: tuple = ()) -> str:
    """Return links of 1 m, 1 m apart, under one top bar: one freedom whatever the number of links. Spins are stated rates."""
    text = rigid("top", f"{np.cos(angle):.17g},{np.sin(angle):.17g}", com=f"{0.5 * (links - 1)},0.0")
    for k in range(links):
        text += rigid(f"l{k}", f"{k}.0,0.0", angle, more=f"angular_velocity={spins[k]}" if spins else "")
        text += joint(f"g{k}", "revolute", f"l{k}", "", point_b=f"point_b={k}.0,0.0")
        text += joint(f"t{k}", "revolute", "top", f"point_a={k}.0,0.0", f"l{k}", "point_b=1.0,0.0")
    return text


DOOR = rigid("door", com="0.5,0.5") + joint("upper", "revolute", "door", "") + joint("lower", "revolute", "door", "")
SLIDER_CRANK = (
    rigid("crank", angle=0.2)
    + rigid("rod", "0.98006657784124163,0.19866933079506122", -0.40873, com="0.25,0.0")
    + joint("shaft", "revolute", "crank", "")
    + joint("pin", "revolute", "rod", "", "crank", "point_b=1.0,0.0")
    + joint("slot", "slider", "rod", "point_a=0.5,0.0")
)
TWO_BEAMS = (
    STEEL + beam("b", "position=0.0,0.0") + beam("c", "position=1.0,0.0") + joint("w", "weld", "c", "node_a=1", "b", "node_b=-1")
)

COUNTS = {
    "free body": (rigid("a"), 0, 0, 3, ""),
    "pendulum": (rigid("a") + joint("o", "revolute", "a", ""), 2, 2, 1, ""),
    "structure": (rigid("a") + joint("o", "weld", "a", ""), 3, 3, 0, ""),
    "link": (rigid("a") + joint("o", "distance", "a", "", point_b="point_b=1.0,1.0"), 1, 1, 2, ""),
    "slide": (rigid("a") + joint("o", "prismatic", "a", ""), 2, 2, 1, ""),
    "slider-crank": (SLIDER_CRANK, 5, 5, 1, ""),
    "doubly hinged door": (DOOR, 4, 2, 1, '"upper" "lower"'),
    "two links": (parallelogram(2, 1.0), 8, 8, 1, ""),
    "three links": (parallelogram(3, 1.0), 12, 11, 1, '"g0" "t0" "g1" "t1" "g2" "t2"'),
    "four links": (parallelogram(4, 1.0), 16, 14, 1, '"g0" "t0" "g1" "t1" "g2" "t2" "g3" "t3"'),
    "change point": (parallelogram(2, 0.0), 8, 7, 2, '"g0" "t0" "g1" "t1"'),
    "welded beams": (TWO_BEAMS, 3, 3, 3 + 6 + 3 + 6 - 3, ""),
}


@pytest.mark.parametrize("name", COUNTS)
def test_freedoms_and_redundant_joints_are_counted_and_named(run_deck, name):
    bodies, rows, rank, freedoms, joints = COUNTS[name]
    told = run_deck(GRAVITY + bodies, "--check").stdout
    assert f"constraints (multipliers): {rows}, independent at the start: {rank}\n" in told
    assert f"degrees of freedom: {freedoms}\n" in told
    found = re.search(r"redundant constraints: (\d+) at the start, among (.*?);", told)
    assert (found is not None) == (rank < rows)
    if found:
        assert int(found[1]) == rows - rank
        assert sorted(found[2].split()) == sorted(joints.split())


def test_only_the_joints_of_the_redundant_loop_are_named(run_deck):
    text = DOOR + rigid("p", "5.0,0.0") + joint("other", "revolute", "p", "", point_b="point_b=5.0,0.0")
    told = run_deck(GRAVITY + text, "--check").stdout
    assert re.search(r"among (.*?);", told)[1].split() == ['"upper"', '"lower"']


def test_a_doubly_hinged_door_moves_as_a_singly_hinged_one_and_shares_its_reaction(run_deck):
    angle = sensor("door", "angle", "body='door'")
    single = DOOR.replace(joint("lower", "revolute", "door", ""), "")
    one = run_deck(GRAVITY + single + angle + sensor("u", "reaction", "joint='upper'") + transient(0.5), name="one").history
    both = GRAVITY + DOOR + angle + sensor("u", "reaction", "joint='upper'") + sensor("l", "reaction", "joint='lower'")
    two = run_deck(both + transient(0.5), name="two").history
    np.testing.assert_allclose(two["door"], one["door"], rtol=0, atol=1e-12)
    for c in ("fx", "fy"):
        scale = np.abs(one[f"u.{c}"]).max()
        # minimum norm: equal shares, up to rounding over the shift of 1e-9 (theory.md, section 6)
        np.testing.assert_allclose(two[f"u.{c}"], two[f"l.{c}"], rtol=0, atol=2e-6 * scale)
        np.testing.assert_allclose(two[f"u.{c}"] + two[f"l.{c}"], one[f"u.{c}"], rtol=0, atol=1e-9 * scale)


def test_a_start_at_a_change_point(run_deck):
    """The flat parallelogram, all of its links turning alike, goes on as a parallelogram at constant speed (no gravity)."""
    turning = parallelogram(2, 0.0, (3.0, 3.0)).replace("&body name='top'", "&body angular_velocity=0.0 name='top'")
    run = run_deck(WEIGHTLESS + turning + sensor("a", "angle", "body='l0'") + sensor("b", "angle", "body='l1'") + transient(2.5))
    assert re.search(r"^\S+ warning: redundant constraints at the start among [^\n]*\n\Z", run.stderr)
    for name in ("a", "b"):
        np.testing.assert_allclose(run.history[name], 3.0 * run.history.time, rtol=0, atol=1e-8)


CANNOT = (
    rigid("left", angle=1.0)
    + rigid("right", "3.0,0.0", 2.0)
    + joint("west", "revolute", "left", "")
    + joint("east", "revolute", "right", "", point_b="point_b=3.0,0.0")
    + joint("middle", "revolute", "left", "point_a=1.0,0.0", "right", "point_b=1.0,0.0")
)
LOCKED = (
    rigid("a")
    + joint("wall", "weld", "a", "")
    + "&history name='h' kind='polynomial' coefficients=1.0 /\n"
    + "&drive name='motor' type='rotation' body_a='a' history='h' rate=.true. /\n"
)


@pytest.mark.parametrize(("text", "names"), [(CANNOT, ["middle"]), (LOCKED, ["wall", "motor"])])
def test_what_cannot_be_assembled_is_refused_with_its_joints(run_deck, text, names):
    """Positions: the joint that does not close when those before it do; velocities: all that contradict each other."""
    done = run_deck(GRAVITY + text + transient(0.1), expect=2)
    assert "cannot be assembled" in done.stderr or "no velocities satisfy" in done.stderr
    for name in names:
        assert re.search(rf'(joint|drive) "{name}" (in line 6 )?stays open by', done.stderr)
    line = 1 + next(k for k, group in enumerate((GRAVITY + text).splitlines()) if f"name='{names[0]}'" in group)
    assert f".nml:{line}: " in done.stderr  # of the first that it names
    assert not done.folder.exists()


PULL = (
    rigid("a", angle=-1.0)
    + joint("o", "revolute", "a", "")
    + "&history name='h' kind='ramp' start_value=0.5 end_value=1.5 start=0.0 finish=0.1 /\n"
    + "&drive name='pull' type='position' body_a='a' point_a=1.0,0.0 history='h' /\n"
    + sensor("a", "angle", "body='a'")
)
SWING = (
    SLIDER_CRANK
    + "&history name='h' kind='ramp' start_value=0.2 end_value=1.2 start=0.0 finish=0.1 /\n"
    + "&drive name='motor' type='rotation' body_a='crank' history='h' /\n"
    + sensor("a", "angle", "body='crank'")
)


@pytest.mark.parametrize(
    ("text", "value", "names"),
    [(PULL, 0.5, ["pull", "o"]), (SWING, (np.arcsin(0.5) - 0.2), ["slot", "pin", "shaft", "motor"])],
    ids=["a point pulled out of reach", "a crank beyond the rod's reach"],
)
def test_a_drive_that_demands_the_impossible_stops_there(run_deck, text, value, names):
    done = run_deck(GRAVITY + text + transient(0.1, 1.0e-4), expect=1)
    s = np.linspace(0.0, 1.0, 200001)
    limit = 0.1 * s[np.searchsorted(s**3 * (10 - 15 * s + 6 * s * s), value)]  # where the ramp reaches it
    told = re.search(r'kept closed after t = (\S+) s: "(\w+)" opens most', done.stderr)
    assert float(told[1]) == pytest.approx(limit, abs=2.0e-4)
    assert told[2] in names
    history = done.history
    assert history.time[-1] == pytest.approx(float(told[1]), abs=1e-9)
    assert history.time.size == round(history.time[-1] / 1.0e-4) + 1
    assert done.energy["position_violation"].max() < 1e-11
    assert f"outcome: the joints cannot be kept closed after t = {told[1]}" in done.summary


def test_stated_velocities_are_kept_and_the_others_follow(run_deck):
    text = parallelogram(2, 1.0).replace("&body name='l0'", "&body angular_velocity=2.0 name='l0'")
    sensors = sensor("a", "angular_velocity", "body='l1'") + sensor("v", "velocity", "body='top' point=0.0,0.0")
    run = run_deck(WEIGHTLESS + text + sensors + sensor("b", "angular_velocity", "body='l0'") + transient(0.01))
    assert run.stderr == ""
    assert run.history["b"][0] == 2.0
    assert run.history["a"][0] == pytest.approx(2.0, abs=1e-12)
    assert run.history["v.x"][0] == pytest.approx(-2.0 * np.sin(1.0), abs=1e-12)
    assert run.history["v.y"][0] == pytest.approx(2.0 * np.cos(1.0), abs=1e-12)


def test_stated_velocities_that_contradict_the_joints_are_corrected_with_a_warning(run_deck):
    text = parallelogram(2, 1.0, (2.0, 1.0))
    sensors = sensor("a", "angular_velocity", "body='l0'") + sensor("b", "angular_velocity", "body='l1'")
    run = run_deck(WEIGHTLESS + text + sensors + transient(0.01))
    for name in ("l0", "l1"):
        assert f'the stated velocity of body "{name}" contradicts the joints and was corrected' in run.stderr
        assert f'the stated velocity of body "{name}" contradicts' in run.summary
        assert f'body "{name}" contradicts the joints and was corrected by 5.00E-01 rad/s\n' in run.stderr
    assert run.history["a"][0] == pytest.approx(1.5, abs=1e-12)  # half the change each
    assert run.history["b"][0] == pytest.approx(run.history["a"][0], abs=1e-12)


def test_a_stated_velocity_with_the_digits_of_a_deck_is_no_contradiction(run_deck):
    """Along a rail that is not that of an axis; nothing turns, and the rail stands."""
    text = rigid("a", more="velocity=0.955336,0.295520") + joint("rail", "prismatic", "a", "direction=0.3")
    assert run_deck(WEIGHTLESS + text + transient(0.01)).stderr == ""


def test_only_what_contradicts_is_corrected(run_deck):
    """The first link cannot move away from its pin; the second keeps what the deck states, the first link's spin gives it."""
    text = rigid("a", more="velocity=0.0,1.0") + rigid("b", "1.0,0.0", more="velocity=0.0,2.0")
    text += joint("o", "revolute", "a", "") + joint("e", "revolute", "b", "", "a", "point_b=1.0,0.0")
    sensors = sensor("v", "velocity", "body='b' point=0.0,0.0") + sensor("w", "angular_velocity", "body='a'")
    run = run_deck(WEIGHTLESS + text + sensors + transient(0.01))
    assert 'velocity of body "a" contradicts the joints and was corrected by 1.00E+00 m/s\n' in run.stderr
    assert 'velocity of body "b"' not in run.stderr
    assert run.history["v.y"][0] == pytest.approx(2.0, abs=1e-12)
    assert run.history["w"][0] == pytest.approx(2.0, abs=1e-12)


def test_a_welded_body_stands_still_whatever_its_stated_velocity(run_deck):
    text = rigid("a", more="velocity=0.0,1.0") + joint("w", "weld", "a", "point_a=1.0,0.0", "ground", "point_b=1.0,0.0")
    run = run_deck(GRAVITY + text + sensor("v", "velocity", "body='a' point=0.5,0.0") + transient(0.01))
    assert "was corrected by 1.00E+00 m/s" in run.stderr
    assert abs(run.history["v.y"]).max() < 1e-12
    assert "energy balance: no energy moves in this scene beyond" in run.summary


@pytest.mark.parametrize(("offset", "warned"), [(0.049, False), (0.051, True)])
def test_assembly_warns_of_frames_that_move_by_more_than_a_twentieth_of_the_scene(run_deck, offset, warned):
    text = rigid("a", f"{offset},0.0") + joint("o", "revolute", "a", "") + sensor("p", "position", "body='a' point=1.0,0.0")
    text += "&force name='f' body='a' point=1.0,0.0 fx=1.0 /\n"
    run = run_deck(GRAVITY + text + transient(0.01))
    assert ('assembly moved body "a"' in run.stderr) == warned
    assert run.history["p.x"][0] == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize("kind", ["revolute", "weld", "slider", "prismatic", "distance"])
@pytest.mark.parametrize(("body", "where"), [("ground", "on the ground"), ("a", "on rigid body 'a'")])
def test_a_joint_of_a_body_with_itself_is_a_fault(run_deck, kind, body, where):
    done = run_deck(GRAVITY + rigid("a") + joint("o", kind, body, "", body, "point_b=1.0,0.0"), "--check", expect=2)
    assert re.fullmatch(rf".*:3: joint/o: markers a and b are {where} and cannot move.*\n", done.stderr)


def test_a_distance_joint_takes_its_length_from_the_assembled_positions(run_deck):
    bodies = rigid("a", "0.02,0.0") + joint("o", "revolute", "a", "") + rigid("b", "1.0,1.0")
    link = joint("link", "distance", "b", "", "a", "point_b=1.0,0.0")
    sensors = sensor("p", "position", "body='a' point=1.0,0.0") + sensor("q", "position", "body='b' point=0.0,0.0")
    h = run_deck(GRAVITY + bodies + link + sensors + transient(0.5)).history
    length = np.hypot(h["p.x"] - h["q.x"], h["p.y"] - h["q.y"])
    assert h["p.x"][0] == pytest.approx(1.0, abs=1e-14)
    np.testing.assert_allclose(length, 1.0, rtol=0, atol=1e-13)  # not hypot(0.02, 1), the deck's own distance


@pytest.mark.parametrize("number", [2, 6, 7, 10, 11])
def test_pendulums_that_nothing_connects_all_swing_alike(run_deck, number):
    text = GRAVITY
    for k in range(number):
        text += rigid(f"b{k}", com="0.0,0.0") + joint(f"d{k}", "distance", f"b{k}", "", point_b="point_b=0.6,0.8")
        text += sensor(f"p{k}", "position", f"body='b{k}'")
    found = run_deck(text + transient(0.5)).history
    assert np.ptp(found["p0.x"]) > 0.5
    for k in range(number):
        assert np.hypot(found[f"p{k}.x"] - 0.6, found[f"p{k}.y"] - 0.8) == pytest.approx(1.0, abs=1e-9)
        assert found[f"p{k}.x"] == pytest.approx(found["p0.x"], abs=1e-12)


def test_a_weld_keeps_the_angle_of_the_deck(run_deck):
    """Between the sections of two beams that stand at right angles and bend."""
    text = STEEL + beam("b", "angle=0.0") + beam("c", "position=1.0,0.0 angle=1.5707963267948966 reference='clamped'")
    text += joint("o", "revolute", "b", "node_a=1") + joint("w", "weld", "c", "node_a=1", "b", "node_b=-1")
    sensors = sensor("b", "angle", "body='b' node=-1") + sensor("c", "angle", "body='c' node=1") + sensor("f", "angle", "body='b'")
    h = run_deck(GRAVITY + text + sensors + transient(0.2, 2.0e-5).replace(" /", " output_step=0.01 /")).history
    np.testing.assert_allclose(h["c"] - h["b"], np.pi / 2, rtol=0, atol=1e-13)
    assert np.abs(h["b"] - h["f"]).max() > 1e-3


OMEGA = 2.0


def test_a_bead_on_a_turning_rod(run_deck):
    """A line fixed in a moving body: r'' = Omega^2 r, and the rod's force is the Coriolis one, 2 m Omega r'."""
    text = rigid("rod", more=f"angular_velocity={OMEGA}", com="0.0,0.0") + joint("o", "revolute", "rod", "")
    text += f"&history name='h' kind='polynomial' coefficients={OMEGA} /\n"
    text += "&drive name='motor' type='rotation' body_a='rod' history='h' rate=.true. /\n"
    text += rigid("bead", "0.5,0.0", com="0.0,0.0", more=f"velocity=0.0,{0.5 * OMEGA}")
    text += joint("line", "prismatic", "bead", "", "rod")
    sensors = sensor("p", "position", "body='bead' point=0.0,0.0") + sensor("f", "reaction", "joint='line'")
    h = run_deck(WEIGHTLESS + text + sensors + sensor("m", "reaction", "drive='motor'") + transient(1.0)).history
    t, r = h.time, 0.5 * np.cosh(OMEGA * h.time)
    rate = 0.5 * OMEGA * np.sinh(OMEGA * t)
    np.testing.assert_allclose(h["p.x"], r * np.cos(OMEGA * t), rtol=0, atol=1e-10)
    np.testing.assert_allclose(h["p.y"], r * np.sin(OMEGA * t), rtol=0, atol=1e-10)
    np.testing.assert_allclose(h["f.fx"], -2 * 2.0 * OMEGA * rate * np.sin(OMEGA * t), rtol=0, atol=1e-8)
    np.testing.assert_allclose(h["f.fy"], 2 * 2.0 * OMEGA * rate * np.cos(OMEGA * t), rtol=0, atol=1e-8)
    np.testing.assert_allclose(h["m.m"], 2 * 2.0 * OMEGA * rate * r, rtol=0, atol=1e-8)


@pytest.mark.parametrize("kind", ["slider", "prismatic"])
def test_a_line_on_a_moving_flexible_body_turns_with_its_section(run_deck, kind):
    text = STEEL.replace("1.0e9", "2.0e7") + beam("b", "reference='clamped'") + joint("o", "revolute", "b", "node_a=1")
    text += rigid("bead", "0.85,0.15", 0.4, com="0.0,0.0").replace("mass=2.0 inertia=0.3", "mass=0.2 inertia=0.001")
    text += joint("line", kind, "bead", "point_a=0.0,0.0", "b", "node_b=2", "direction=0.4048917862850834")
    sensors = sensor("p", "position", "body='bead' point=0.0,0.0") + sensor("n", "position", "body='b' node=2")
    sensors += (
        sensor("psi", "angle", "body='b' node=2") + sensor("frame", "angle", "body='b'") + sensor("bead", "angle", "body='bead'")
    )
    run = run_deck(GRAVITY + text + sensors + transient(0.3, 1.0e-4))
    h = run.history
    d = np.array([h["p.x"] - h["n.x"], h["p.y"] - h["n.y"]])
    line = h["psi"] + 0.4048917862850834
    away = -np.sin(line) * d[0] + np.cos(line) * d[1]
    start = away[0]
    assert abs(start) < 1e-12
    np.testing.assert_allclose(away, 0.0, rtol=0, atol=1e-12)
    assert np.abs(h["psi"] - h["frame"]).max() > 1e-2  # the section does turn
    assert np.ptp(np.hypot(*d)) > 1e-2  # the bead does slide
    if kind == "prismatic":
        np.testing.assert_allclose(h["bead"] - h["psi"], 0.4, rtol=0, atol=1e-12)
    assert np.abs(run.energy["residual"]).max() < 1e-6 * np.abs(run.energy["kinetic"]).max()


def test_a_force_that_turns_with_a_body(run_deck):
    """A spinning free body pushed along its own axis: the acceleration turns at the spin, the path is a curve in closed form."""
    text = rigid("a", com="0.0,0.0", more="angular_velocity=3.0")
    text += "&force name='f' type='force' body='a' fx=4.0 fy=0.0 axes='body' /\n"
    h = run_deck(WEIGHTLESS + text + sensor("p", "position", "body='a' point=0.0,0.0") + transient(1.0)).history
    a, w, t = 4.0 / 2.0, 3.0, h.time
    np.testing.assert_allclose(h["p.x"], a * (1 - np.cos(w * t)) / w**2, rtol=0, atol=1e-10)
    np.testing.assert_allclose(h["p.y"], a * (w * t - np.sin(w * t)) / w**2, rtol=0, atol=1e-10)


@pytest.mark.parametrize("axes", ["global", "body", "section"])
def test_the_work_of_a_force_on_a_bending_beam(run_deck, axes):
    """Against a quadrature of F.v, F turned by hand with the frame's or the section's angle."""
    text = STEEL + beam("b", "reference='clamped' angle=0.3") + joint("o", "revolute", "b", "node_a=1")
    text += f"&force name='f' type='force' body='b' node=-1 fx=3.0 fy=8.0 axes='{axes}' /\n"
    sensors = sensor("v", "velocity", "body='b' node=-1") + sensor("body", "angle", "body='b'")
    sensors += sensor("section", "angle", "body='b' node=-1")
    run = run_deck(WEIGHTLESS + text + sensors + transient(0.2, 5.0e-5))
    h = run.history
    turn = h[axes] if axes != "global" else 0.0 * h.time
    power = (3.0 * np.cos(turn) - 8.0 * np.sin(turn)) * h["v.x"] + (3.0 * np.sin(turn) + 8.0 * np.cos(turn)) * h["v.y"]
    simpson = (power[:-2:2] + 4.0 * power[1:-1:2] + power[2::2]).sum() * (h.time[1] - h.time[0]) / 3.0
    assert run.energy["work"][-1] == pytest.approx(simpson, rel=1e-6)
    assert np.abs(h["section"] - h["body"]).max() > 1e-3


def test_a_position_drive_follows_its_history_and_its_force_is_newtons(run_deck):
    text = rigid("a", "0.3,0.0", com="0.0,0.0") + joint("g", "prismatic", "a", "", more="direction=0.0")
    text += "&history name='h' kind='sine' offset=0.3 amplitude=0.2 frequency=1.5 /\n"
    text += "&drive name='d' type='position' body_a='a' history='h' /\n"
    run = run_deck(
        WEIGHTLESS
        + text
        + sensor("p", "position", "body='a' point=0.0,0.0")
        + sensor("d", "reaction", "drive='d'")
        + transient(0.5)
    )
    h, w = run.history, 2 * np.pi * 1.5
    np.testing.assert_allclose(h["p.x"], 0.3 + 0.2 * np.sin(w * h.time), rtol=0, atol=1e-14)
    np.testing.assert_allclose(h["d.fx"], -2.0 * 0.2 * w**2 * np.sin(w * h.time), rtol=0, atol=1e-11)
    kinetic = 0.5 * 2.0 * (0.2 * w * np.cos(w * h.time)) ** 2
    np.testing.assert_allclose(run.energy["work"], kinetic - kinetic[0], rtol=0, atol=1e-8)


def test_a_drive_by_rate_starts_from_the_decks_own_value(run_deck):
    text = rigid("a", "0.3,0.0", 0.7, com="0.0,0.0") + joint("g", "slider", "a", "", more="direction=0.0")
    text += "&history name='h' kind='polynomial' coefficients=1.0,4.0 /\n"
    text += "&history name='w' kind='polynomial' coefficients=-2.0,0.0,3.0 /\n"
    text += "&drive name='d' type='position' body_a='a' history='h' rate=.true. /\n"
    text += "&drive name='m' type='rotation' body_a='a' history='w' rate=.true. /\n"
    sensors = sensor("p", "position", "body='a' point=0.0,0.0") + sensor("a", "angle", "body='a'")
    h = run_deck(
        WEIGHTLESS + text + sensors + sensor("d", "reaction", "drive='d'") + sensor("m", "reaction", "drive='m'") + transient(0.5)
    ).history
    t = h.time
    np.testing.assert_allclose(h["p.x"], 0.3 + t + 2 * t**2, rtol=0, atol=1e-14)
    np.testing.assert_allclose(h["a"], 0.7 - 2 * t + t**3, rtol=0, atol=1e-14)
    np.testing.assert_allclose(h["d.fx"], 2.0 * 4.0, rtol=1e-12)
    np.testing.assert_allclose(h["m.m"], 0.3 * 6 * t, rtol=0, atol=1e-12)


def test_a_rotation_drive_between_two_sections(run_deck):
    """The relative angle of two beams' sections follows, though both bend."""
    text = STEEL + beam("b", "reference='clamped'") + beam("c", "position=1.0,0.0 reference='clamped'")
    text += joint("o", "weld", "b", "node_a=1") + joint("e", "revolute", "c", "node_a=1", "b", "node_b=-1")
    text += "&history name='h' kind='ramp' start_value=0.0 end_value=0.5 start=0.0 finish=0.2 /\n"
    text += "&drive name='d' type='rotation' body_a='c' node_a=1 body_b='b' node_b=-1 history='h' /\n"
    sensors = sensor("b", "angle", "body='b' node=-1") + sensor("c", "angle", "body='c' node=1")
    h = run_deck(WEIGHTLESS + text + sensors + transient(0.2, 5.0e-5).replace(" /", " output_step=0.01 /")).history
    s = h.time / 0.2
    np.testing.assert_allclose(h["c"] - h["b"], 0.5 * s**3 * (10 - 15 * s + 6 * s * s), rtol=0, atol=1e-13)
    assert np.abs(h["b"]).max() > 1e-3


BOW = """&scene gravity=0.0,-9.81 /
&material name='m' density=1000.0 young=1.0e8 ghm_alpha=0.5 ghm_zeta=1.0 ghm_omega=1.0e3 /
&section name='s' shape='rectangle' width=0.02 height=0.02 /
&body name='u' kind='frame' node_x=0,1,1,0 node_y=0,0,0.5,0.5 element_nodes=1,2,2,3,3,4 material='m' section='s'
  reference='clamped' position=-1.0,0.0 angular_velocity=3.0 /
&joint name='pin' type='revolute' body_a='u' node_a=2 /
&sensor name='string' quantity='reaction' joint='string' /
&sensor name='a' quantity='acceleration' body='u' node=1 /
&sensor name='p' quantity='position' body='u' node=1 /
&sensor name='q' quantity='position' body='u' node=4 /
"""


@pytest.mark.parametrize("string", ["distance", "revolute"])
def test_a_joint_between_two_nodes_of_one_body(run_deck, string):
    """A bow whose string is a rod or, of a ring, a pin: explicit and implicit methods share no matrix of joints."""
    deck = BOW + f"&joint name='string' type='{string}' body_a='u' node_a=1 body_b='u' node_b=4 /\n"
    if string == "revolute":
        deck = deck.replace("node_x=0,1,1,0 node_y=0,0,0.5,0.5", "node_x=0,1,1,0 node_y=0,0,0.5,0.0")
    ends = []
    for name, steps in (("rk4", "step=4e-6"), ("radau", "tolerance=1e-10")):
        run = run_deck(deck + f"&transient t_end=0.02 method='{name}' {steps} output_step=0.01 /\n", name=name)
        h = run.history
        apart = np.hypot(h["p.x"] - h["q.x"], h["p.y"] - h["q.y"])
        np.testing.assert_allclose(apart, 0.5 if string == "distance" else 0.0, rtol=0, atol=1e-13)
        assert np.abs(run.energy["residual"]).max() < 1e-10 * np.ptp(run.energy["kinetic"])
        ends.append([h[column][-1] for column in ("string.fx", "string.fy", "a.x", "a.y")])
    assert np.hypot(*ends[0][:2]) > 0.05
    np.testing.assert_allclose(ends[0], ends[1], rtol=1e-7)


def geared(n: float) -> str:
    """Return an arm on a base that turns, both about one shaft, and the arm's motor on the base: its rotor turns n times as far."""
    text = "&body name='base' kind='rigid' mass=2.0 inertia=0.3 /\n" + joint("b", "revolute", "base", "")
    for name, mass, inertia in (("arm", 1.0, 0.1), ("rotor", 0.2, 1.0e-3)):
        text += f"&body name='{name}' kind='rigid' mass={mass} inertia={inertia} position=0.5,0.0 angle=0.2 /\n"
        text += joint(name, "revolute", name, "", "base", "point_b=0.5,0.0")
    text += joint("g", "gear", "rotor", "", "arm", more=f"body_c='base' ratio={n!r}")
    return text + "".join(sensor(name, "angle", f"body='{name}'") for name in ("base", "arm", "rotor"))


@pytest.mark.parametrize("method", ["rk4", "dopri5", "radau", "generalized_alpha"])
def test_a_motor_turns_its_arm_and_the_base_that_carries_it(run_deck, method):
    """Turn of the rotor: n that of the arm less (n - 1) that of the base; a torque on it turns both by these shares."""
    n, torque, t_end = -20.0, 0.5, 0.4
    push = f"&force name='m' type='torque' body='rotor' moment={torque} /\n" + sensor("r", "reaction", "joint='g'")
    h = run_deck(WEIGHTLESS + geared(n) + push + transient(t_end, 2e-3).replace("rk4", method)).history
    turns = np.array([1 - n, n])
    inertia = np.diag([0.3 + 1.2 * 0.5**2, 0.1]) + 1e-3 * np.outer(turns, turns)
    base, arm = np.linalg.solve(inertia, torque * turns)
    of = 1e-11 if method != "generalized_alpha" else 1e-6
    for name, rate, start in (("base", base, 0.0), ("arm", arm, 0.2), ("rotor", turns @ [base, arm], 0.2)):
        np.testing.assert_allclose(h[name] - start, 0.5 * rate * h.time**2, rtol=0, atol=of * abs(rate) * t_end**2)
    np.testing.assert_allclose(h["r.m"], 1e-3 * (turns @ [base, arm]) - torque, rtol=1e-6)


def test_a_rotor_behind_gears_at_rest_and_in_vibration(run_deck):
    """A spring at the arm, a torque at the rotor of a base that is held: the arm feels n times the torque, n^2 the inertia."""
    n, k = 15.0, 30.0
    hold = "&drive name='hold' type='rotation' body_a='base' history='none' /\n"
    hold += "&history name='none' kind='polynomial' coefficients=0 /\n"
    spring = f"&spring name='k' type='torsional' body_a='arm' stiffness={k} free_angle=0.2 /\n"
    push = "&force name='m' type='torque' body='rotor' moment=0.1 /\n&static /\n&modal modes=1 /\n"
    run = run_deck(WEIGHTLESS + geared(n) + hold + spring + push)
    static = read(run.folder, "static")
    turns = [static[name][-1] for name in ("base", "arm", "rotor")]
    np.testing.assert_allclose(turns, [0.0, 0.2 + n * 0.1 / k, 0.2 + n * n * 0.1 / k], rtol=0, atol=1e-11)
    frequency = np.sqrt(k / (0.1 + n * n * 1e-3)) / (2 * np.pi)
    assert read(run.folder, "modes")["undamped_frequency"][0] == pytest.approx(frequency, rel=1e-10)


def test_gears_in_a_ring_are_redundant_or_hold_the_wheels(run_deck):
    """Three wheels in a ring: the third gear repeats the others where the product of the ratios is 1, and else stops them all."""
    wheels = ""
    for k in range(3):
        wheels += rigid(f"w{k}", f"{k}.0,0.0", com="0.0,0.0")
        wheels += joint(f"p{k}", "revolute", f"w{k}", "", point_b=f"point_b={k}.0,0.0")
    for last, rows, freedoms in ((-0.25, 1, 1), (0.25, 0, 0)):
        ring = "".join(
            joint(f"g{k}", "gear", f"w{k}", "", f"w{(k + 1) % 3}", more=f"ratio={ratio}") for k, ratio in enumerate((2, -2, last))
        )
        run = run_deck(WEIGHTLESS + wheels + ring + "&transient t_end=0.01 method='rk4' step=0.01 /\n", name=f"ring{rows}")
        assert run.figures["model"].get("redundant_constraints", 0) == rows
        assert run.figures["model"]["degrees_of_freedom"] == freedoms
