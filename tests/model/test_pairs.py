"""Profiles and what touches them: a law's disc moves its follower by the law, circles are rods and clearances."""

import json
import re

import numpy as np
import pytest
from biela.histories import read
from biela.mechanism import from_run
from scipy.interpolate import CubicSpline
from scipy.linalg import eigh

W = 40.0
CAM = f"""&body name='cam' mass=1 inertia=1e-3 angle=0.4 /
&joint name='shaft' type='revolute' body_a='cam' /
&history name='speed' kind='polynomial' coefficients={W} /
&drive name='motor' type='rotation' body_a='cam' history='speed' rate=.true. /
"""
BACK = CAM.replace(f"={W}", f"=-{W}").replace("angle=0.4", "angle=-0.4")
LIFT = """&history name='up' kind='ramp' start_value=0 end_value=0.012 start=0 finish=1.5 /
&history name='high' kind='polynomial' coefficients=0.012 /
&history name='down' kind='cycloid' start_value=0.012 end_value=0 start=0 finish=2 /
&history name='lift' kind='sequence' histories='up','high','down' durations=1.5,0.5,{2*pi-2} /
"""
FOLLOWER = """&body name='f' mass=0.3 inertia=1e-4 position={x},{y} /
&joint name='guide' type='prismatic' body_a='f' point_b={x},0 direction={{90*deg}} /
"""
SEE = "&sensor name='y' quantity='position' body='f' /\n&sensor name='a' quantity='acceleration' body='f' /\n"
SEE += "&sensor name='n' quantity='reaction' joint='contact' /\n&sensor name='motor' quantity='reaction' drive='motor' /\n"
RUN = "&transient t_end=0.15 method='rk4' step=2e-4 output_step=1e-3 /\n"


def lift(angle):
    """Return the lift with two derivatives, once more from its own formulas."""
    u = np.mod(angle, 2 * np.pi)
    x = np.clip(u / 1.5, 0.0, 1.0)
    up = np.array([x**3 * (10 - 15 * x + 6 * x**2), 30 * x**2 * (1 - x) ** 2 / 1.5, 60 * x * (1 - x) * (1 - 2 * x) / 1.5**2])
    z = np.clip((u - 2.0) / 2.0, 0.0, 1.0)
    wave = 2 * np.pi * z
    down = np.array([z - np.sin(wave) / (2 * np.pi), (1 - np.cos(wave)) / 2.0, 2 * np.pi * np.sin(wave) / 4.0])
    down[0] -= 1.0
    return 0.012 * np.where(u <= 2.0, up, -down)


@pytest.mark.parametrize("clockwise", [False, True])
@pytest.mark.parametrize(("follower", "x"), [("roller", 0.006), ("larger roller", 0.0), ("flat", 0.01)])
def test_the_disc_of_a_law_moves_its_follower_by_the_law(follower, x, clockwise, run_deck):
    """Motion, and by power the force: F cos(pressure angle) v = torque W, though gap and force know no lift."""
    law = "base_radius=0.025 follower='flat'" if follower == "flat" else f"base_radius=0.025 radius=0.008 offset={x}"
    touch = {"roller": "radius=0.008", "larger roller": "radius=0.02", "flat": "face={90*deg}"}[follower]
    base = 0.025 if follower == "flat" else np.sqrt(0.033**2 - x**2)
    if follower == "larger roller":
        law, touch = "base_radius=0.013 radius=0.02", "radius=0.02"
    deck = LIFT + (BACK if clockwise else CAM) + FOLLOWER.format(x=x, y=base + lift(0.4)[0]) + SEE + RUN
    deck += f"&profile name='disc' kind='law' history='lift' {law} clockwise={'.true.' if clockwise else '.false.'} /\n"
    deck += f"&joint name='contact' type='profile' body_a='f' {touch} body_b='cam' profile='disc' /\n"
    h = run_deck(deck).history
    s = lift(0.4 + W * h["t"])
    np.testing.assert_allclose(h["y.y"], base + s[0], rtol=0, atol=2e-12)
    np.testing.assert_allclose(h["a.y"], W**2 * s[2], rtol=0, atol=1e-7 * W**2 * 0.01)
    sense = -1.0 if clockwise else 1.0
    np.testing.assert_allclose(h["n.fy"], 0.3 * h["a.y"], rtol=0, atol=1e-9)
    np.testing.assert_allclose(sense * h["motor.m"], h["n.fy"] * s[1], rtol=0, atol=1e-9)
    side = 0.0 if follower == "flat" else (sense * s[1] - x) / (base + s[0])  # tangent of the pressure angle
    np.testing.assert_allclose(h["n.fx"], -h["n.fy"] * side, rtol=0, atol=1e-9)


@pytest.mark.parametrize("clockwise", [False, True])
def test_the_disc_of_a_law_swings_its_arm_by_the_law(clockwise, run_deck):
    """A roller at the end of an arm on a bearing beside the cam: its angle is the law, its torque follows by power."""
    deck = LIFT.replace("0.012", "0.2") + (BACK if clockwise else CAM)
    beta = 0.5 + lift(0.4)[0] / 0.06
    deck += f"""&body name='f' mass=0.3 inertia=2e-4 com=0.02,0.0 position=-0.04,0.01 angle={beta} /
&joint name='bearing' type='revolute' body_a='f' point_b=-0.04,0.01 /
&history name='arm' kind='sum' histories='lift','half' /
&history name='half' kind='polynomial' coefficients=0.5 /
&profile name='disc' kind='law' history='arm' arm=0.06 pivot=-0.04,0.01 radius=0.007 CLOCKWISE /
&joint name='contact' type='profile' body_a='f' point_a=0.06,0.0 radius=0.007 body_b='cam' profile='disc' /
&sensor name='y' quantity='angle' body='f' /
&sensor name='motor' quantity='reaction' drive='motor' /
"""
    h = run_deck(deck.replace("CLOCKWISE", "clockwise=.true." if clockwise else "") + RUN).history
    s = lift(0.4 + W * h["t"]) * 0.2 / 0.012
    np.testing.assert_allclose(h["y"], 0.5 + s[0], rtol=0, atol=1e-11)
    torque = (2e-4 + 0.3 * 0.02**2) * W**2 * s[2] * s[1]
    np.testing.assert_allclose(h["motor.m"] * (-1 if clockwise else 1), torque, rtol=0, atol=1e-8)


def test_circles_touch_as_rods_and_clearances_do(run_deck):
    """A roller on an eccentric circle is a rod between the centres; a ball in a rigid bowl a pin with clearance."""
    deck = "&scene gravity=0,-9.81 /\n" + CAM + FOLLOWER.format(x=0.004, y=0.03) + SEE + RUN
    deck += "&profile name='disc' kind='circle' radius=0.022 /\n"
    rod = "&joint name='contact' type='distance' body_a='f' body_b='cam' point_b=0.007,0 length=0.031 /\n"
    pair = "&joint name='contact' type='profile' body_a='f' radius=0.009 body_b='cam' point_b=0.007,0 profile='disc' /\n"
    one, other = run_deck(deck + rod, name="rod").history, run_deck(deck + pair, name="pair").history
    for name in ("y.y", "a.y", "n.fx", "n.fy", "motor.m"):
        np.testing.assert_allclose(other[name], one[name], rtol=0, atol=1e-11 * max(1.0, np.abs(one[name]).max()))
    ball = """&scene gravity=0,-9.81 /
&body name='b' mass=1 inertia=1e-3 position=0.1,0.0 /
&profile name='bowl' kind='circle' radius=0.25 hollow=.true. /
&sensor name='y' quantity='position' body='b' /
&stop name='s' TYPE body_a='b' restitution=0.7 /
&transient t_end=1.2 method='dopri5' tolerance=1e-10 output_step=0.1 /
"""
    runs = [run_deck(ball.replace("TYPE", f"type={words}"), name=words[1:5]) for words in PINS]
    events = [np.array([[float(x) for x in line.split()[::4]] for line in read_lines(run)]) for run in runs]
    assert len(events[0]) > 4
    apart = 64 * np.finfo(float).eps * 0.25 / np.maximum(events[0][:, 1], 1e-9)  # an event is where a length is zero to rounding
    assert (np.abs(events[1] - events[0]) < 1e-11 + np.outer(apart, [1.0, 9.81])).all()
    np.testing.assert_allclose(runs[1].history["y.x"], runs[0].history["y.x"], rtol=0, atol=1e-9)
    rest = ball.replace("restitution=0.7", "point_a=0,0.02 stiffness=1e5 exponent=1").replace("0.1,0.0", "0.05,-0.22")
    rest = rest.partition("&transient")[0] + "&static /\n&modal modes=2 /\n"
    runs = [run_deck(rest.replace("TYPE", f"type={words}"), name="rest" + words[1:5]) for words in PINS]
    # a body that hangs 0.02 m below a pin that slides in a hole: K = [[W/R, 0], [0, W h]] by the pin's place and the angle
    arm, radius, weight = 0.02, 0.2 + 9.81 / 1e5, 9.81
    stiff, mass = np.diag([weight / radius, weight * arm]), np.array([[1.0, arm], [arm, 1e-3 + arm**2]])
    exact = np.sqrt(eigh(stiff, mass, eigvals_only=True)) / (2 * np.pi)
    for run in runs:
        found = run.figures["modes"]["poles"]
        np.testing.assert_allclose([mode["frequency"] for mode in found], exact, rtol=1e-9)


PINS = ("'clearance' gap=0.2", "'profile' profile='bowl' radius=0.05 body_b='ground'")


def read_lines(run):
    return [line for line in (run.folder / "events.txt").read_text().splitlines() if not line.startswith("#")]


@pytest.mark.parametrize("turn", [1, -1])
def test_points_of_a_circle_are_nearly_that_circle(turn, run_deck):
    """An eccentric one, by 48 points either way round. The spline's curvature errs by (2 pi/48)^2/12 of itself."""
    angle = turn * 2 * np.pi * np.arange(48) / 48
    text = [",".join(f"{v:.15e}" for v in values) for values in (7.0 + 22.0 * np.cos(angle), 22.0 * np.sin(angle))]
    points = f"&profile name='disc' kind='points' scale={{1*mm}}\n x={text[0]}\n y={text[1]} /\n".replace(",", ",\n")
    for touch in ("radius=0.009", "face={90*deg}"):
        deck = CAM + FOLLOWER.format(x=0.004, y=0.03) + SEE + RUN
        deck += f"&joint name='contact' type='profile' body_a='f' {touch} body_b='cam' PROFILE /\n"
        one = run_deck(deck.replace("PROFILE", "profile='disc'") + points, name="points").history
        circle = "&profile name='disc' kind='circle' radius=0.022 /\n"
        other = run_deck(deck.replace("PROFILE", "profile='disc' point_b=0.007,0") + circle, name="circle").history
        assert np.abs(one["y.y"] - other["y.y"]).max() < 2e-8
        assert np.abs(one["a.y"] - other["a.y"]).max() < 2e-3 * 0.029 * W**2


@pytest.mark.parametrize("pair", ["joint", "stop"])
@pytest.mark.parametrize("touch", ["radius=0.008", "face={80*deg}"])
def test_a_contact_has_its_force_place_angle_and_pressure(pair, touch, run_deck):
    """On a cam that a spring holds: balance of forces and moments at the place shown; slow responses are differences of statics."""
    stiff = "stiffness=2e7 exponent=1.5" if pair == "stop" else ""
    deck = (
        LIFT
        + f"""&scene gravity=0,-9.81 /
&body name='cam' mass=1 inertia=1e-3 angle=0.7 /
&joint name='shaft' type='revolute' body_a='cam' /
&spring name='twist' type='torsional' body_a='cam' stiffness=50 free_angle=0.7 /
&profile name='disc' kind='law' history='lift' base_radius=0.03 radius=0.011 offset=0.004 /
&body name='f' mass=0.3 inertia=1e-4 position=0.004,0.045 /
&spring name='x' type='torsional' body_a='f' stiffness=8 free_angle=0 /
&spring name='guide' body_a='f' point_b=-0.3,0.045 stiffness=2e4 free_length=0.304 /
&spring name='press' body_a='f' point_b=0.004,0.2 stiffness=2000 free_length=0.3 /
&{pair} name='contact' type='profile' body_a='f' point_a=0.001,0 {touch} body_b='cam' profile='disc' {stiff} /
&sensor name='c' quantity='contact' {pair}='contact' direction={{90*deg}} PRESSURE /
&sensor name='f' quantity='position' body='f' point=0.001,0 /
&sensor name='turn' quantity='angle' body='f' /
&sensor name='cam' quantity='spring' spring='twist' /
&force name='p' type='force' body='f' point=0.01,0 fx=LOAD /
&static /
"""
    )
    columns = ["c.f", "c.gap", "c.x", "c.y", "c.angle"]
    states = []
    for load in (-1e-3, 0.0, 1e-3):
        run = run_deck(deck.replace("LOAD", f"{{10+{load}}}").replace("PRESSURE", "modulus=1.1e11 width=0.01"), name=f"s{load}")
        found = read(run.folder, "static")
        states.append({name: found[name][-1] for name in found.names})
    low, s, high = states
    normal = np.array([np.cos(s["c.angle"] + s["turn"] + np.pi / 2), np.sin(s["c.angle"] + s["turn"] + np.pi / 2)])
    assert s["c.f"] > 100.0
    torque = s["c.f"] * (s["c.y"] * normal[0] - s["c.x"] * normal[1])  # of -F N at the place, about the shaft
    assert torque == pytest.approx(s["cam.f"], rel=1e-6)
    arm = np.array([s["c.x"] - s["f.x"], s["c.y"] - s["f.y"]])
    radius = 0.008 if "radius" in touch else 0.0
    assert arm @ normal == pytest.approx(-radius - s["c.gap"], abs=1e-12)
    deck = deck.replace("LOAD", "10").replace("PRESSURE", "") + "&frequency_response from=1e-4 to=1e-3 points=2 input='p' /\n"
    run = run_deck(deck, name="r")
    response = read(run.folder, "frequency_response")
    for name in columns:
        slope = (high[name] - low[name]) / 2e-3 * 10.0
        assert response[f"{name}.re"][0] == pytest.approx(slope, rel=2e-5, abs=1e-9), name
    bend = (s["c.p"] / 1.1e11) ** 2 * np.pi * 0.01 / s["c.f"] * 1.1e11  # 1/r + kappa
    assert bend == pytest.approx(kappa_of(s, radius), rel=1e-3)


def kappa_of(s, radius):
    """Return 1/r + the curvature of the disc at the cam's angle of contact, by differences of its own points."""
    cam = 0.7 + s["cam.d"]

    def place(u):  # the pitch curve in the axes of the cam
        h = np.sqrt(0.041**2 - 0.004**2) + lift(u)[0]
        return np.array([np.cos(u) * 0.004 + np.sin(u) * h, -np.sin(u) * 0.004 + np.cos(u) * h])

    c, n = np.cos(cam), np.sin(cam)
    at = np.array([c * s["c.x"] + n * s["c.y"], -n * s["c.x"] + c * s["c.y"]])
    u = min(np.linspace(0, 2 * np.pi, 20001), key=lambda v: abs(np.hypot(*(place(v) - at)) - 0.011))
    e = 1e-4
    one, two = (place(u + e) - place(u - e)) / (2 * e), (place(u + e) - 2 * place(u) + place(u - e)) / e**2
    pitch = -(one[0] * two[1] - one[1] * two[0]) / np.hypot(*one) ** 3
    return pitch / (1 - 0.011 * pitch) + (1 / radius if radius else 0.0)


def test_pictures_show_the_profile_and_its_follower_where_they_are(run_deck):
    """A ball that falls onto a turning disc: the outlines come as near to each other as the column says; touched is touched."""
    deck = LIFT + CAM + "&scene gravity=0,-9.81 /\n&body name='f' mass=0.3 inertia=1e-4 position=0.0,0.05 /\n"
    deck += "&profile name='disc' kind='law' history='lift' base_radius=0.025 radius=0.008 /\n"
    deck += "&stop name='s' type='profile' body_a='f' radius=0.01 body_b='cam' profile='disc' restitution=0.5 /\n"
    deck += "&sensor name='c' quantity='contact' stop='s' /\n&sensor name='k' quantity='controller' controller='k' /\n"
    deck += (
        "&history name='zero' kind='polynomial' coefficients=0 /\n&controller name='k' argument='c.gap' history='zero' kp=-3 /\n"
    )
    deck += "&force name='shaft' type='force' body='cam' fx=1 controller='k' /\n"
    run = run_deck(deck + "&transient t_end=0.15 method='rk4' step=1e-3 motion_step=1e-3 /\n")
    mechanism = from_run(run.motion)
    (pair,) = mechanism.stops
    gaps = run.history["c.gap"]
    np.testing.assert_allclose(run.history["k.out"], 3 * gaps, rtol=1e-13, atol=1e-16)
    assert len(pair.struck) > 0
    for row in range(0, len(gaps), 10):
        (follower, outline), touches = pair.walls(mechanism, row, 0.01)
        away = np.hypot(*(outline - mechanism.position(pair.a, row)).T).min() - 0.01
        assert away == pytest.approx(gaps[row], abs=1e-5)
        assert np.hypot(*(follower - mechanism.position(pair.a, row)).T) == pytest.approx(0.01)
        assert touches == (gaps[row] < 4e-5)
        place, normal = pair.contact(mechanism, row)
        np.testing.assert_allclose(place, [run.history["c.x"][row], run.history["c.y"][row]], atol=2e-4)
        assert np.arctan2(*normal[::-1]) - pair.a.angle(row) == pytest.approx(run.history["c.angle"][row], abs=0.02)
        pair.force = np.full(len(gaps), -0.5)  # a pull
        ends = pair.pressed(mechanism, row, 0.1)
        assert (ends[1] - ends[0]) @ normal == pytest.approx(-0.05)


POINTS = np.linspace(0.0, 2 * np.pi, 37)
JUMPS = "&history name='table' kind='table' interpolation='pchip' periodic=.true.\n time=" + ",\n".join(f"{x:.15g}" for x in POINTS)
JUMPS += "\n value=" + ",\n".join(f"{0.006 * (1 - np.cos(x)):.15g}" for x in POINTS) + " /\n"
ORDERS = [("rk4", 4, (32, 64), "lift"), ("dopri5", 5, (16, 32), "lift"), ("radau", 5, (8, 16), "lift")]
ORDERS += [("rk4", 4, (64, 128), "table"), ("rk4", 4, (80, 160), "table")]


@pytest.mark.parametrize(("method", "order", "steps", "law"), ORDERS)
def test_fixed_steps_keep_their_order_over_the_corners_of_a_law(method, order, steps, law, run_deck):
    """A cam that coasts: its law's third derivative jumps at both ends of each stroke, of a table the second at every point."""
    deck = (
        LIFT
        + JUMPS
        + """&scene gravity=0,-9.81 /
&body name='cam' mass=1 inertia=2e-4 angle=0.4 angular_velocity=40 /
&joint name='shaft' type='revolute' body_a='cam' /
&profile name='disc' kind='law' history='lift' base_radius=0.025 radius=0.008 offset=0.006 /
&joint name='contact' type='profile' body_a='f' radius=0.008 body_b='cam' profile='disc' /
&spring name='press' body_a='f' point_b=0.006,0.2 stiffness=3000 free_length=0.2 /
&sensor name='w' quantity='angular_velocity' body='cam' /
"""
    )
    deck = deck.replace("history='lift' base", f"history='{law}' base") + FOLLOWER.format(x=0.006, y=0.033)
    found = []
    for words in ("method='dopri5' tolerance=1e-12", *(f"method='{method}' step={{0.01/{n}}}" for n in steps)):
        found.append(run_deck(deck + f"&transient t_end=0.1 output_step=0.01 {words} /\n", name=f"s{len(found)}").history["w"])
    errors = [np.abs(w - found[0]).max() for w in found[1:]]
    assert errors[1] < 2e-5
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.5)


def test_what_a_check_tells_of_pairs(run_deck):
    """Radius of curvature, pressure angle, reach of a face; too few digits of a table."""
    u = np.linspace(0.0, 2 * np.pi, 361)
    deck = LIFT + "&history name='coarse' kind='table' periodic=.true.\n time=" + ",\n".join(f"{x:.12f}" for x in u) + "\n value="
    deck += ",\n".join(f"{x:.6f}" for x in lift(u)[0]) + " /\n" + CAM + FOLLOWER.format(x=0.006, y=0.04)
    thirds = ",".join(f"{{{k}*pi/3}}" for k in range(7))
    deck += f"&history name='six' kind='table' periodic=.true. time={thirds} value=0,0.003,0,0,0,0,0 /\n"
    deck += "&profile name='disc' kind='law' history='lift' base_radius=0.025 radius=0.008 offset=0.006 /\n"
    deck += "&profile name='flat' kind='law' history='lift' base_radius=0.04 follower='flat' /\n"
    deck += "&profile name='rough' kind='law' history='coarse' base_radius=0.2 radius=0.008 /\n"
    deck += "&profile name='few' kind='law' history='six' base_radius=0.2 radius=0.008 /\n"
    pair = "&stop name='{0}' type='profile' body_a='f' {1} body_b='cam' profile='{0}' stiffness=1e6 /\n"
    deck += pair.format("disc", "radius=0.008") + pair.format("flat", "face=1.5") + pair.format("rough", "radius=0.008")
    deck += pair.format("few", "radius=0.008")
    told = run_deck(deck, "--check", "--json").stdout
    disc, flat, *_ = json.loads(told)["pairs"]
    s = lift(np.linspace(0.0, 2 * np.pi, 100001))
    angle = np.arctan((s[1] - 0.006) / (np.sqrt(0.033**2 - 0.006**2) + s[0]))
    assert disc["pressure_angle"] == pytest.approx(np.abs(angle).max(), rel=1e-4)
    assert flat["reach"] == pytest.approx(np.abs(s[1]).max(), rel=1e-3)
    assert flat["least_radius"] == pytest.approx((0.04 + s[0] + s[2]).min(), rel=1e-3)
    share = 0.5e-6 * 4 / (2 * np.pi / 360) ** 2 / np.abs(s[2]).max()
    found = re.findall(r"curvature err by (\d+) %", run_deck(deck, "--check").stderr)
    assert [float(x) / 100 for x in found] == pytest.approx([share, 0.5e-3 * 4 / 0.006], rel=0.1)


POINT = """&profile name='p' kind='points' x={x} y={y} closed=.{closed}. /
&body name='b' mass=1 inertia=1 position={at} /
&stop name='s' type='profile' body_a='b' profile='p' stiffness=1e4 exponent=1 /
&sensor name='c' quantity='contact' stop='s' /
&transient t_end=1e-6 method='rk4' step=1e-6 output_step=1e-6 /
"""


@pytest.mark.parametrize(
    ("x", "y", "at"),
    [
        ([-1.5, 0.2, 1.5], [2.25, 0.1, 2.0], (-0.0429, 2.0968)),
        ([0, 1, 2, 3, 4], [0, 2, 0, 2, 0], (0.3, 9.0)),
        ([0, 1, 2, 3, 4], [0, 2, 0, 2, 0], (2.05, 3.1)),
        ([1, 0.3, -1, -0.2, 0.1], [0.1, 1.3, 0.4, -0.2, -1.2], (-1.5, 2.5)),
    ],
)
def test_the_gap_of_an_edge_is_to_the_nearest_of_all_places(x, y, at, run_deck):
    """Within one arc of the curve several places may be nearest; all places of the same spline tell which is."""
    closed = len(set(np.diff(x))) > 1 and len(x) > 4
    points = np.array([x, y], float).T
    if closed:
        points = np.vstack([points, points[:1]])
    chords = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    curve = CubicSpline(chords, points, bc_type="periodic" if closed else "not-a-knot")
    nearest = np.hypot(*(curve(np.linspace(0, chords[-1], 200001)) - at).T).min()
    words = {"x": ",".join(map(str, x)), "y": ",".join(map(str, y)), "at": f"{at[0]},{at[1]}", "closed": str(closed).lower()}
    run = run_deck(POINT.format(**words))
    assert run.history["c.gap"][0] == pytest.approx(nearest, abs=1e-9)


def test_digits_of_an_exact_coordinate_do_not_count(run_deck):
    """Who rounds points rounds both coordinates alike: whole millimetres beside ten digits are exact, beside two not."""
    x = range(11)
    for digits, warned in ((10, False), (2, True)):
        y = ",".join(f"{np.cosh(k / 5):.{digits}f}" for k in x)
        deck = POINT.format(x=",".join(map(str, x)), y=y, at="0,9", closed="false")
        assert ("digits" in run_deck(deck, "--check").stderr) == warned
