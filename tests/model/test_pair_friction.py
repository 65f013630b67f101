"""Friction of profiles: sticks, slips and loses energy as dense equations of motion with events of their own say."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

G = 9.81
ALL = ["'dopri5' tolerance=1e-11", "'radau' tolerance=1e-11", "'rk4' step=2e-4", "'generalized_alpha' step=2e-4"]


def march(rates, roots, switch, y, mode, times):
    """Integrate piece by piece; `roots` are functions of the state that fall to zero. Return states, modes, times of events."""
    t, states, modes, events = 0.0, [], [], []
    keys = {"rtol": 1e-12, "atol": 1e-13, "max_step": times[1], "dense_output": True}  # events are sought in its interpolants
    while True:
        watch = [lambda _, y, f=f: f(y) for f in roots(mode)]
        for f in watch:
            f.terminal, f.direction = True, -1
        s = solve_ivp(lambda _, y, now=mode: rates(y, now), (t, times[-1]), y, "DOP853", events=watch, **keys)
        inside = times[(times >= t) & (times < s.t[-1])] if s.status == 1 else times[times >= t]
        states += [s.sol(u) for u in inside]
        modes += [mode] * len(inside)
        if s.status != 1:
            return np.array(states).T, modes, np.array(events)
        k = next(i for i, found in enumerate(s.t_events) if len(found))
        t, y = s.t[-1], s.y[:, -1]
        events.append(t)
        mode = switch(y, mode, k)


def times_of(run):
    lines = [line.split() for line in (run.folder / "events.txt").read_text().splitlines() if not line.startswith("#")]
    return np.unique([float(words[0]) for words in lines]), [words[2:4] for words in lines]


def test_friction_of_a_flat_face_takes_two_thirds_of_the_torque_of_a_cam(run_deck):
    """F (s' + mu (base + s)) on the cam, by a weight so slow that F stays: in the mean of a rise 67 % of F s' is added."""
    deck = """&scene gravity=0,-9.81 /
&history name='rise' kind='cycloid' start_value=0 end_value=0.01 start=0 finish={110*deg} /
&history name='fall' kind='cycloid' start_value=0.01 end_value=0 start=0 finish={250*deg} /
&history name='lift' kind='sequence' histories='rise','fall' durations={110*deg},{250*deg} periodic=.true. /
&profile name='disc' kind='law' follower='flat' history='lift' base_radius=0.03 /
&body name='cam' mass=1 inertia=1e-3 /
&body name='f' mass=2 inertia=1e-4 position=0,0.03 /
&joint name='shaft' type='revolute' body_a='cam' /
&joint name='guide' type='prismatic' body_a='f' direction={90*deg} /
&joint name='pair' type='profile' body_a='f' face={90*deg} body_b='cam' profile='disc' friction=0.1 /
&history name='w' kind='polynomial' coefficients=0.5 /
&drive name='motor' type='rotation' body_a='cam' history='w' rate=.true. /
&sensor name='rub' quantity='friction' joint='pair' /
&sensor name='motor' quantity='reaction' drive='motor' /
&sensor name='c' quantity='contact' joint='pair' /
&transient t_end=12 method='dopri5' tolerance=1e-10 output_step=0.02 /
"""
    run = run_deck(deck)
    h = run.history
    u, rise = 0.5 * h["t"], np.deg2rad(110)
    u, span = np.where(u < rise, u / rise, 1 - (u - rise) / (2 * np.pi - rise)), np.where(u < rise, rise, rise - 2 * np.pi)
    s = 0.01 * (u - np.sin(2 * np.pi * u) / (2 * np.pi))
    slope = 0.01 * (1 - np.cos(2 * np.pi * u)) / span
    np.testing.assert_allclose(h["motor.m"], h["c.f"] * (slope + 0.1 * (0.03 + s)), rtol=0, atol=1e-9)
    np.testing.assert_allclose(h["rub.rate"], -0.5 * (0.03 + s), rtol=0, atol=1e-12)
    up = h["t"] < rise / 0.5
    assert (h["rub.f"] * (0.03 + s))[up].mean() / (h["c.f"] * slope)[up].mean() == pytest.approx(0.672, abs=0.01)
    assert run.transient["friction"][0]["slid"] == pytest.approx(np.trapezoid(-h["rub.rate"], h["t"]), rel=1e-6)


@pytest.mark.parametrize("method", ALL[:3])
def test_a_cam_that_swings_sticks_below_its_flat_face(method, run_deck):
    """An eccentric circle turned by a spring against a face that another presses on it: it comes to rest, off the middle."""
    radius, arm, m, inertia, stiff, twist, mu, hold = 0.022, 0.007, 0.35, 1e-3, 900.0, 1.1, 0.3, 0.5
    deck = f"""&scene gravity=0,-{G} /
&profile name='disc' kind='circle' radius={radius} /
&body name='cam' mass=1 inertia={inertia} angle=1.4 /
&body name='f' mass={m} inertia=1e-4 position=0,{{{radius} + {arm}*sin(1.4)}} /
&joint name='shaft' type='revolute' body_a='cam' /
&joint name='guide' type='prismatic' body_a='f' direction={{90*deg}} /
&joint name='pair' type='profile' body_a='f' face={{90*deg}} body_b='cam' point_b={arm},0 profile='disc'
  friction={mu} friction_static={hold} /
&spring name='s' body_a='f' point_b=0,0.18 stiffness={stiff} free_length=0.175 /
&spring name='t' type='torsional' body_a='cam' stiffness={twist} free_angle=0.1 /
&sensor name='w' quantity='angle' body='cam' /
&sensor name='c' quantity='contact' joint='pair' /
&sensor name='rub' quantity='friction' joint='pair' /
&transient t_end=0.8 output_step=0.008 method={method} /
"""

    def force(y, turn):
        """Normal force where the cam's angle accelerates by `turn`."""
        height, lift = radius + arm * np.sin(y[0]), arm * (np.cos(y[0]) * turn - np.sin(y[0]) * y[1] ** 2)
        return m * (lift + G) + stiff * (0.175 - 0.18 + height)

    def turning(y, slips):
        """Acceleration of the cam, force, moment that friction takes: all are linear where the sense of slip is known."""
        free, lever, height = -twist * (y[0] - 0.1), arm * np.cos(y[0]), radius + arm * np.sin(y[0])
        if slips == 0:
            return 0.0, force(y, 0.0), free - force(y, 0.0) * lever
        reach = lever + slips * mu * height
        a = (free - force(y, 0.0) * reach) / (inertia + m * arm * np.cos(y[0]) * reach)
        return a, force(y, a), slips * mu * force(y, a) * height

    def limit(y):
        _, press, moment = turning(y, 0)
        return hold * press * (radius + arm * np.sin(y[0])) - abs(moment)

    def switch(y, mode, _):
        return 0 if limit(y) > 0 else -mode

    exact, modes, events = march(
        lambda y, mode: [y[1], turning(y, mode)[0]],
        lambda mode: [lambda y: mode * y[1]] if mode else [],
        switch,
        [1.4, 0.0],
        -1,
        np.linspace(0, 0.8, 101),
    )
    run = run_deck(deck)
    h = run.history
    found, words = times_of(run)
    goal = 1e-7 if "rk4" in method else 1e-9
    assert len(events) > 2
    np.testing.assert_allclose(found, events, rtol=0, atol=goal)
    assert words[-1][1] == "stuck"
    np.testing.assert_allclose(h["w"], exact[0], rtol=0, atol=goal)
    values = np.array([turning(y, mode) for y, mode in zip(exact.T, modes, strict=True)])
    np.testing.assert_allclose(h["c.f"], values[:, 1], rtol=0, atol=1e3 * goal)
    np.testing.assert_allclose(h["rub.f"] * (radius + arm * np.sin(exact[0])), values[:, 2], rtol=0, atol=1e2 * goal)
    assert run.transient["energy_residual"] < 1e-8 * run.transient["energy_swing"] * (1e2 if "rk4" in method else 1)


def ball(method, pair, end, angle, spin=0.0, ends=""):
    """Return a deck of a ball on a circle of 0.25 m, inside at 0.2 m or outside at 0.3 m, `angle` off the vertical."""
    away, way = (0.3, 1) if "hill" in pair else (0.2, -1)
    return f"""&scene gravity=0,-{G} /
&profile name='bowl' kind='circle' radius=0.25 hollow=.true. /
&profile name='hill' kind='circle' radius=0.25 /
&body name='b' mass=1 inertia=6e-4 position={{{away}*sin({angle})}},{{{way * away}*cos({angle})}} angular_velocity={spin} {ends} /
{pair} type='profile' body_a='b' radius=0.05 body_b='ground' /
&sensor name='r' quantity='position' body='b' /
&sensor name='w' quantity='angle' body='b' /
&sensor name='c' quantity='contact' {pair.split()[0][1:]}='p' /
&sensor name='rub' quantity='friction' {pair.split()[0][1:]}='p' /
&transient t_end={end} output_step={end / 100} method={method} /
"""


@pytest.mark.parametrize("method", ALL)
def test_a_ball_that_sticks_rolls_in_a_bowl_as_a_longer_pendulum(method, run_deck):
    """Its angle, and the friction that turns it: no creep."""
    h = run_deck(ball(method, "&joint name='p' profile='bowl' friction=0.9", 1.0, 1.2)).history
    rate = G / (0.2 * (1 + 6e-4 / 0.05**2))
    s = solve_ivp(lambda _, y: [y[1], -rate * np.sin(y[0])], (0, 1), [1.2, 0.0], "DOP853", rtol=1e-12, atol=1e-13, t_eval=h["t"])
    goal = 1e-4 if "alpha" in method else 1e-9
    np.testing.assert_allclose(h["r.x"], 0.2 * np.sin(s.y[0]), rtol=0, atol=goal)
    np.testing.assert_allclose(h["w"], 4 * (1.2 - np.arctan2(h["r.x"], -h["r.y"])), rtol=0, atol=1e-10)
    np.testing.assert_allclose(h["c.f"], G * np.cos(s.y[0]) + 0.2 * s.y[1] ** 2, rtol=0, atol=30 * goal)
    np.testing.assert_allclose(np.abs(h["rub.f"]), 6e-4 / 0.05 * 4 * rate * np.abs(np.sin(s.y[0])), rtol=0, atol=30 * goal)
    assert set(h["rub.state"]) == {0.0}


@pytest.mark.parametrize("method", ALL[:2])
def test_a_ball_on_a_hill_rolls_then_slides_then_is_held_from_outside(method, run_deck):
    """Rolling ends where friction reaches its static limit, sliding goes on by the kinetic one, the force changes its sign."""
    run = run_deck(ball(method, "&joint name='p' profile='hill' friction=0.15 friction_static=0.2", 0.5, 0.3))
    h = run.history
    turns, mu, hold = 6e-4 / 0.05**2, 0.15, 0.2

    def press(y):
        return G * np.cos(y[0]) - 0.3 * y[1] ** 2

    def friction(y, mode):
        """On the ball, up the hill."""
        rolling = G * np.sin(y[0]) * turns / (1 + turns)
        return rolling if mode == 0 else mu * mode * press(y)

    def rates(y, mode):
        return [y[1], (G * np.sin(y[0]) - friction(y, mode)) / 0.3, friction(y, mode) * 0.05 / 6e-4]

    exact, _, events = march(
        rates,
        lambda mode: [(lambda y: mode * press(y)) if mode else (lambda y: hold * press(y) - friction(y, 0))],
        lambda _, mode, __: -mode if mode else 1,
        [0.3, 0.0, 0.0],
        0,
        h["t"],
    )
    found, words = times_of(run)
    assert len(events) == 2
    np.testing.assert_allclose(found, events[:1], rtol=0, atol=1e-9)
    assert words == [["stuck", "backward"]]
    np.testing.assert_allclose(h["r.x"], 0.3 * np.sin(exact[0]), rtol=0, atol=1e-9)
    np.testing.assert_allclose(h["c.f"], press(exact), rtol=0, atol=1e-7)


@pytest.mark.parametrize("method", ALL[:2])
def test_a_spinning_ball_jumps_and_grips_in_a_compliant_bowl(method, run_deck):
    """Each contact slips, or sticks within it; between them friction has no limit. In polar coordinates of the ball's centre."""
    mu, hold, stiff, loss = 0.08, 0.12, 4e6, 0.3
    pair = f"&stop name='p' profile='bowl' friction={mu} friction_static={hold} stiffness={stiff} exponent=1.5 damping={loss}"
    run = run_deck(ball(method, pair, 0.4, 0.9, spin=40).replace("{0.2*", "{0.19*").replace("{-0.2*", "{-0.19*"))
    h = run.history

    def press(y):
        return stiff * np.maximum(y[0] - 0.2, 0.0) ** 1.5 * (1 + loss * y[3])

    def rates(y, load, drag):
        far, angle, speed, turn = y[0], y[1], y[3], y[4]
        outward = far * turn**2 + G * np.cos(angle) - load
        return [
            speed,
            turn,
            y[5],
            outward,
            (-2 * far * speed * turn - G * far * np.sin(angle) + 0.2 * drag) / far**2,
            drag * 0.05 / 6e-4,
        ]

    def slip(y):
        return 0.2 * y[4] + 0.05 * y[5]

    def gripping(y):
        """Friction with which the slip keeps its rate."""
        free, pulled = rates(y, press(y), 0.0), rates(y, press(y), 1.0)
        return slip(free) / (slip(free) - slip(pulled))

    def drag(y, mode):
        """Of modes None: open, 0: sticks, 1 and -1: slips."""
        return 0.0 if mode is None else -mode * mu * press(y) if mode else gripping(y)

    def roots(mode):
        if mode is None:
            return [lambda y: 0.2 - y[0]]
        return [lambda y: y[0] - 0.2, (lambda y: mode * slip(y)) if mode else (lambda y: hold * press(y) - abs(gripping(y)))]

    def switch(y, mode, k):
        if mode is not None and k == 0:
            return None
        if mode is None:
            return int(np.sign(slip(y)))
        if mode == 0:
            return -int(np.sign(gripping(y)))
        return 0 if abs(gripping(y)) <= hold * press(y) else -mode

    start = [0.19, 0.9, 0.0, 0.0, 0.0, 40.0]
    exact, modes, events = march(
        lambda y, mode: rates(y, 0.0 if mode is None else press(y), drag(y, mode)), roots, switch, start, None, h["t"]
    )
    found, words = times_of(run)
    assert len(events) > 15
    assert ["backward", "stuck"] in words
    np.testing.assert_allclose(found, events, rtol=0, atol=1e-9)
    np.testing.assert_allclose(h["r.x"], exact[0] * np.sin(exact[1]), rtol=0, atol=1e-9)
    np.testing.assert_allclose(h["w"], exact[2], rtol=0, atol=1e-8)
    loads = [0.0 if mode is None else press(y) for y, mode in zip(exact.T, modes, strict=True)]
    np.testing.assert_allclose(h["c.f"], loads, rtol=0, atol=1e-6 * max(loads))
    drags = [drag(y, mode) for y, mode in zip(exact.T, modes, strict=True)]
    np.testing.assert_allclose(h["rub.f"], [-f for f in drags], rtol=0, atol=1e-6 * max(loads))
    assert run.transient["energy_residual"] < 1e-8


def test_a_stop_softer_than_its_curvature_ends_the_run(run_deck):
    deck = ball("'dopri5' tolerance=1e-8", "&stop name='soft' profile='hill' stiffness=10 exponent=1", 1.0, 0.0)
    deck = deck.replace("stop='p'", "stop='soft'").replace("&sensor name='rub'", "! ")
    assert 'stop "soft" is softer than its own curvature' in run_deck(deck, expect=1).stderr
    inside = deck.replace("{0.3*cos(0.0)}", "0.02")
    assert 'stop "soft": it begins in the profile by more than nine tenths' in run_deck(inside, expect=2).stderr
    rest = deck.replace("stiffness=10", "stiffness=34").split("&transient")[0] + "&joint name='g' type='prismatic' body_a='b' "
    run = run_deck(rest + "direction={pi/2} /\n&static /\n", expect=1)
    assert 'static: stop "soft" is softer than its own curvature' in run.stderr


@pytest.mark.parametrize("method", ALL[:2])
def test_a_beam_follows_an_eccentric_circle_and_leaves_it(method, run_deck):
    """A clamped beam with a roller at its end: columns and events of two dense elements of Euler and Bernoulli."""
    mass, stiff, lump, load = np.zeros((6, 6)), np.zeros((6, 6)), 0.01, np.zeros(6)
    length, mu, bending = 0.15, 2700 * 0.012 * 0.004, 7e10 * 0.012 * 0.004**3 / 12
    for i in (0, 2):
        at = np.ix_(range(i, i + 4), range(i, i + 4))
        a, s = length, length**2
        stiff[at] += (
            bending
            / a**3
            * np.array(
                [[12, 6 * a, -12, 6 * a], [6 * a, 4 * s, -6 * a, 2 * s], [-12, -6 * a, 12, -6 * a], [6 * a, 2 * s, -6 * a, 4 * s]]
            )
        )
        mass[at] += (
            mu
            * a
            / 420
            * np.array(
                [
                    [156, 22 * a, 54, -13 * a],
                    [22 * a, 4 * s, 13 * a, -3 * s],
                    [54, 13 * a, 156, -22 * a],
                    [-13 * a, -3 * s, -22 * a, 4 * s],
                ]
            )
        )
        load[i : i + 4] -= G * mu * a * np.array([1 / 2, a / 12, 1 / 2, -a / 12])
    mass[4, 4] += lump
    load[4] -= G * lump
    inverse, stiff, load = np.linalg.inv(mass[2:, 2:]), stiff[2:, 2:], load[2:]
    speed, start, arm, reach, hard, loss = 150.0, -1.2, 0.004, 0.026, 2e5, 0.3
    axis = np.array([2 * length - arm * np.cos(start), -reach - arm * np.sin(start) - 1e-4])

    def contact(y):
        """Gap, its rate, the vertical part of the normal, the touching place; the last state is the time."""
        turn = np.array([np.cos(start + speed * y[8]), np.sin(start + speed * y[8])])
        away = np.array([2 * length, y[2]]) - axis - arm * turn
        far = np.hypot(*away)
        normal = away / far
        rate = normal @ (np.array([0.0, y[6]]) - arm * speed * np.array([-turn[1], turn[0]]))
        return far - reach, rate, normal[1], axis + arm * turn + 0.02 * normal

    def press(y, touches):
        gap, rate, _, _ = contact(y)
        return touches * hard * max(-gap, 0.0) ** 1.5 * (1 - loss * rate)

    def rates(y, touches):
        force = load - stiff @ y[:4]
        force[2] += press(y, touches) * contact(y)[2]
        return [*y[4:8], *(inverse @ force), 1.0]

    deck = f"""&scene gravity=0,-{G} /
&material name='al' density=2700 young=7e10 /
&section name='s' shape='rectangle' width=0.012 height=0.004 /
&body name='beam' kind='beam' length=0.3 elements=2 material='al' section='s' axial=.false. reference='clamped' /
&lump body='beam' node=-1 mass={lump} /
&joint name='wall' type='weld' body_a='beam' node_a=1 /
&profile name='disc' kind='circle' radius=0.02 /
&body name='cam' mass=1 inertia=1e-3 angle={start} position={axis[0]},{axis[1]} /
&joint name='shaft' type='revolute' body_a='cam' point_b={axis[0]},{axis[1]} /
&history name='w' kind='polynomial' coefficients={speed} /
&drive name='motor' type='rotation' body_a='cam' history='w' rate=.true. /
&stop name='c' type='profile' body_a='beam' node_a=-1 radius=0.006 body_b='cam' point_b={arm},0 profile='disc'
  stiffness={hard} exponent=1.5 damping={loss} /
&sensor name='tip' quantity='deflection' body='beam' node=-1 /
&sensor name='mid' quantity='deflection' body='beam' node=2 /
&sensor name='c' quantity='contact' stop='c' /
&transient t_end=0.024 output_step=0.001 method={method} /
"""
    run = run_deck(deck)
    h = run.history
    roots = lambda touches: [lambda y: (1 - 2 * touches) * contact(y)[0]]  # noqa: E731
    exact, modes, events = march(rates, roots, lambda _, touches, __: 1 - touches, np.zeros(9), 0, h["t"])
    assert len(events) > 2
    np.testing.assert_allclose(times_of(run)[0], events, rtol=0, atol=1e-9)
    columns = {"tip.v": exact[2], "tip.r": exact[3], "mid.v": exact[0]}
    columns["c.f"] = np.array([press(y, touches) for y, touches in zip(exact.T, modes, strict=True)])
    columns["c.gap"], _, _, place = zip(*map(contact, exact.T), strict=True)
    columns["c.x"], columns["c.y"] = np.array(place).T
    for name, values in columns.items():
        np.testing.assert_allclose(h[name], values, rtol=0, atol=1e-7 * np.ptp(values), err_msg=name)


@pytest.mark.parametrize("method", ALL)
def test_a_block_stops_on_a_floor_that_yields(method, run_deck):
    """A stop of a position: by its weight times the coefficient, at the place and time that follow."""
    run = run_deck(f"""&scene gravity=0,-{G} /
&body name='b' mass=2 inertia=1 position=0,{{-2*{G}/1e5}} velocity=3,0 /
&spring name='t' type='torsional' body_a='b' stiffness=1e3 free_angle=0 /
&stop name='p' type='position' body_a='b' direction={{90*deg}} lower=0 stiffness=1e5 exponent=1 friction=0.25 friction_static=0.3 /
&sensor name='y' quantity='position' body='b' /
&sensor name='rub' quantity='friction' stop='p' /
&transient t_end=2 output_step=0.02 method={method.replace("2e-4", "1e-2")} /
""")
    h, rest = run.history, 3 / (0.25 * G)
    way = np.where(h["t"] < rest, 3 * h["t"] - 0.125 * G * h["t"] ** 2, 1.5 * rest)
    np.testing.assert_allclose(h["y.x"], way, rtol=0, atol=1e-10)
    np.testing.assert_allclose(h["rub.f"], np.where(h["t"] < rest, 0.5 * G, 0.0), rtol=0, atol=1e-9)  # along -x
    found, words = times_of(run)
    np.testing.assert_allclose(found, [rest], rtol=0, atol=1e-10)
    assert words == [["backward", "stuck"]]
    stop = run.transient["friction"][0]
    assert stop["slid"] == pytest.approx(1.5 * rest)
    assert stop["lost"] == pytest.approx(9.0)


def test_a_pin_that_rubs_in_its_hole_is_a_roller_in_a_ring(run_deck):
    deck = f"""&scene gravity=0,-{G} /
&profile name='ring' kind='circle' radius=0.012 hollow=.true. /
&body name='b' mass=1 inertia=6e-4 com=0.1,0 angle=0.2 angular_velocity=30 /
&stop name='p' type=PAIR body_a='b' friction=0.3 friction_static=0.4 stiffness=4e6 damping=0.5 /
&sensor name='w' quantity='angle' body='b' /
&sensor name='s' quantity='stop' stop='p' /
&sensor name='rub' quantity='friction' stop='p' /
&transient t_end=0.2 method='dopri5' tolerance=1e-9 output_step=0.01 /
"""
    words = ["'clearance' gap=0.0003 pin_radius=0.0117", "'profile' profile='ring' radius=0.0117 body_b='ground'"]
    pin, ring = [run_deck(deck.replace("PAIR", pair), name=pair[1:5]).history for pair in words]
    for name in ("w", "s.f", "rub.f", "rub.rate"):
        np.testing.assert_allclose(pin[name], ring[name], rtol=0, atol=1e-9 * np.abs(ring[name]).max())
    assert np.abs(pin["rub.f"]).max() > 1.0
