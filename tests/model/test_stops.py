"""Stops: where they hold bodies in equilibrium, how these vibrate on them, what is told of a start beyond a limit."""

import json

import numpy as np
import pytest
from biela.histories import read
from conftest import ROOT
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

G, MASS = 9.81, 2.0
UP = "direction=1.5707963267948966"
BALL = "&body name='b{k}' kind='rigid' mass=2.0 inertia=0.01 position=0.0,{y} /\n"
BALL += "&joint name='g{k}' type='prismatic' body_a='b{k}' " + UP + " /\n"
SCENE = f"&scene gravity=0.0,-{G} /\n"
FLOOR = f"&stop name='floor' type='position' body_a='b1' {UP} lower=0.0 stiffness=1.0e8 restitution=0.5 /\n"
SENSE = "&sensor name='p' quantity='position' body='b1' /\n&sensor name='s' quantity='stop' stop='floor' /\n"


def test_a_stack_of_bodies_that_only_stops_hold_finds_its_place(run_deck):
    """Each stop carries the weight of all above it; the lowest mode is that of the chain of the tangents."""
    deck = SCENE + "".join(BALL.format(k=k, y=0.1 * k + 0.05 * k**2) for k in (1, 2, 3)) + FLOOR + SENSE
    exponents, hardness = {2: 1.0, 3: 3.0}, {2: 1.0e6, 3: 1.0e10}
    for k in (2, 3):
        deck += f"&stop name='s{k}' type='position' body_a='b{k}' body_b='b{k - 1}' {UP} lower=0.02 exponent={exponents[k]} "
        deck += f"stiffness={hardness[k]} /\n&sensor name='s{k}' quantity='stop' stop='s{k}' /\n"
    run = run_deck(deck + "&static load_steps=2 /\n&modal modes=3 /\n")
    static = read(run.folder, "static")
    tangents = []
    for name, weights, n, k in (("s", 3, 1.5, 1e8), ("s2", 2, 1.0, 1e6), ("s3", 1, 3.0, 1e10)):
        depth = (weights * MASS * G / k) ** (1 / n)
        assert static[f"{name}.f"][-1] == pytest.approx(weights * MASS * G, rel=1e-8)
        assert static[f"{name}.gap"][-1] == pytest.approx(-depth, rel=1e-7)
        assert static[f"{name}.state"][-1] == -1
        tangents.append(n * k * depth ** (n - 1))
    a, b, c = tangents
    omega2 = np.linalg.eigvalsh(np.array([[a + b, -b, 0], [-b, b + c, -c], [0, -c, c]]) / MASS)
    modes = read(run.folder, "modes")
    np.testing.assert_allclose(modes["undamped_frequency"], np.sqrt(omega2) / (2 * np.pi), rtol=1e-7)
    np.testing.assert_allclose(modes["damping_ratio"], 0.0, atol=1e-12)  # a restitution is of impacts
    assert static["newton_steps"].max() < 150


@pytest.mark.parametrize("height", [1e-6, 500.0])
def test_the_height_of_the_fall_does_not_matter(run_deck, height):
    static = read(run_deck(SCENE + BALL.format(k=1, y=height) + FLOOR + SENSE + "&static load_steps=1 /\n").folder, "static")
    assert static["p.y"][-1] == pytest.approx(-((MASS * G / 1e8) ** (2 / 3)), rel=1e-9)


def test_bodies_that_no_stop_holds_are_named(run_deck):
    deck = SCENE + BALL.format(k=1, y=0.1) + FLOOR.replace("lower=0.0", "upper=0.2") + "&static /\n"
    assert 'no stop holds "b1"' in run_deck(deck, expect=1).stderr
    across = deck.replace("type='prismatic'", "type='slider'")
    assert 'left free to move: "b1"' in run_deck(across.replace(f"'b1' {UP} upper", "'b1' upper"), expect=2, name="across").stderr


def test_a_beam_between_its_stops_and_the_response_about_them(run_deck):
    """A cantilever pushed onto two stops: flexibility and contact in series; the response to a force is that of the tangents."""
    load, hardness, gap, damping = 300.0, 1.0e7, 0.01, 0.3
    deck = f"""&material name='steel' density=7850.0 young=2.1e11 /
&section name='s' shape='rectangle' width=0.02 height=0.01 /
&body name='arm' kind='beam' length=1.0 elements=4 material='steel' section='s' reference='clamped' MODES /
&joint name='w' type='weld' body_a='arm' node_a=1 /
&stop name='end' type='position' body_a='arm' node_a=-1 point_b=1.0,0.0 {UP} lower=-{gap} upper={gap} stiffness={hardness}
  exponent=2.0 damping={damping} /
&force name='p' type='force' body='arm' node=-1 fy=-{load} /
&sensor name='s' quantity='stop' stop='end' /
&sensor name='tip' quantity='deflection' body='arm' node=-1 /
&static load_steps=3 /
&frequency_response from=1.0e-3 to=1.0 points=2 input='p' /
"""
    beam = 3 * 2.1e11 * 0.02 * 0.01**3 / 12
    depth = brentq(lambda d: beam * (gap + d) + hardness * d**2 - load, 0.0, 0.1, xtol=1e-16)
    tangent = 2 * hardness * depth
    for modes in ("", "modes=2 static_shapes=.true."):
        run = run_deck(deck.replace("MODES", modes), name="b" + modes[:5].replace("=", ""))
        static, response = read(run.folder, "static"), read(run.folder, "frequency_response")
        assert static["s.f"][-1] == pytest.approx(hardness * depth**2, rel=1e-7)
        assert static["tip.v"][-1] == pytest.approx(-gap - depth, rel=1e-8)
        omega = 2 * np.pi * 1e-3
        expected = tangent + 1j * omega * hardness * depth**2 * damping
        found = response["s.f.re"][0] + 1j * response["s.f.im"][0]
        assert found == pytest.approx(load * expected / (expected + beam), rel=1e-6)
        assert response["s.gap.re"][0] == pytest.approx(-load / (tangent + beam), rel=1e-6)


def test_a_start_beyond_a_limit_is_told_with_all_values_and_grows_with_the_loads(run_deck):
    deck = SCENE + "&body name='rod' kind='rigid' mass=2.0 inertia=0.1 com=0.5,0.0 /\n"
    deck += "&joint name='j' type='revolute' body_a='rod' /\n"
    deck += "&stop name='t' type='rotation' body_a='rod' upper=-0.01 lower=-0.3 stiffness=1.0e5 exponent=2.0 /\n"
    run = run_deck(deck + "&sensor name='s' quantity='stop' stop='t' /\n&static load_steps=4 /\n")
    assert run.figures["warnings"] == [
        'stop "t" begins beyond its limit: it measures 0 rad, allowed is from -0.3 up to -0.01, and it pushes with 10 N m'
    ]
    static = read(run.folder, "static")
    np.testing.assert_allclose(static["s.f"], static["load"] * MASS * G * 0.5 * np.cos(0.3 - static["s.gap"]), rtol=1e-9)


@pytest.mark.parametrize("method", ["rk4", "dopri5", "radau", "generalized_alpha"])
def test_what_a_stop_dissipates_is_a_column_and_closes_the_balance(run_deck, method):
    """Two stops share the loss; nothing else dissipates."""
    deck = SCENE + BALL.format(k=1, y=0.05) + FLOOR.replace("restitution=0.5", "exponent=2.0 damping=0.5")
    deck += f"&stop name='roof' type='position' body_a='b1' {UP} upper=0.04 stiffness=1.0e5 exponent=3.0 damping=2.0 /\n"
    energy = run_deck(deck + f"&transient t_end=0.2 method='{method}' step=5.0e-5 output_step=1.0e-2 /\n").energy
    assert list(energy.names)[-1] == "stops"
    np.testing.assert_allclose(energy["stops"], energy["dissipated"], rtol=1e-12)
    assert energy["stops"][-1] > 0.1
    assert np.abs(energy["residual"]).max() < (2e-3 if method == "generalized_alpha" else 3e-5)


def test_a_start_beyond_a_limit_does_not_pull_back_what_leaves(run_deck):
    deck = SCENE + BALL.format(k=1, y=-0.01).replace("mass=2.0", "velocity=0.0,3.0 mass=2.0") + FLOOR + SENSE
    run = run_deck(deck + "&transient t_end=0.1 method='radau' tolerance=1e-8 output_step=1e-3 /\n")
    assert not run.history["s.f"].any()
    assert run.history["s.state"][0] == -2
    assert [row[2:4] for row in events_of(run)] == [("lower_free", "open")]
    assert run.history["p.y"][-1] == pytest.approx(-0.01 + 0.3 - 0.5 * G * 0.01, rel=1e-9)


def test_a_stop_is_described_at_a_hundredth_of_the_size(run_deck):
    """1.5 K d^(1/2) at d = 0.01 S, S = 0.5 m: the distance of the stop's point from the guide's."""
    deck = """&body name='b' mass=1 inertia=0.1 /
&joint name='j' type='prismatic' body_a='b' /
&stop name='s' type='position' body_a='b' point_a=0.5,0 upper=1 stiffness=1e6 /
&transient method='rk4' step=1e-5 t_end=0.1 /
"""
    assert 'stop "s": stiffness 106066 N/m, against 1 kg' in run_deck(deck, "--check").stdout


def events_of(run):
    """Return the rows of events.txt: time, element, state before and after, speed."""
    lines = (run.folder / "events.txt").read_text(encoding="utf-8").splitlines()
    assert lines[-1].startswith("#") is False
    return [(float(t), name, before, after, float(v)) for t, name, before, after, v in (x.split() for x in lines if x[0] != "#")]


FREE = """&body name='b1' kind='rigid' mass=2.0 inertia=0.01 velocity=1.5,0.0 /
&body name='b2' kind='rigid' mass=0.5 inertia=0.01 position=0.5,0.0 velocity=-0.5,0.0 /
&stop name='floor' type='position' body_a='b2' body_b='b1' lower=0.1 stiffness={} exponent={} restitution={} /
&sensor name='p' quantity='velocity' body='b1' /
&sensor name='q' quantity='velocity' body='b2' /
&sensor name='s' quantity='stop' stop='floor' /
&transient t_end=0.3 method='dopri5' tolerance=1.0e-10 output_step=0.01 motion_step=0.1 /
"""


LAWS = [(1e6, 1.5, 0.5), (1e4, 1.0, 0.9), (1e9, 3.0, 0.05), (1e6, 2.0, 1.0)]


@pytest.mark.parametrize(("stiffness", "exponent", "restitution"), LAWS)
def test_free_bodies_part_with_the_restitution(run_deck, stiffness, exponent, restitution):
    run = run_deck(FREE.format(stiffness, exponent, restitution))
    history, (touch, part) = run.history, events_of(run)
    assert touch[1:4] == ("floor", "open", "lower")
    assert part[2:4] == ("lower", "open")
    assert touch[0] == pytest.approx(0.4 / 2.0, abs=1e-13)
    assert touch[4] == pytest.approx(2.0, rel=1e-12)
    after = history["q.x"][-1] - history["p.x"][-1]
    assert after == pytest.approx(restitution * 2.0, rel=3e-8)
    stop, mass = run.transient["stops"][0], 0.4
    assert stop["lost"] == pytest.approx(0.5 * mass * 4.0 * (1 - restitution**2), rel=1e-7, abs=1e-10)
    assert run.energy["stops"][-1] == pytest.approx(stop["lost"], rel=1e-12)
    if restitution == 1.0:
        depth = ((exponent + 1) * mass * 4.0 / (2 * stiffness)) ** (1 / (exponent + 1))
        assert stop["largest_penetration"] == pytest.approx(depth, rel=1e-5)
        assert stop["largest_force"] == pytest.approx(stiffness * depth**exponent, rel=1e-5)
    assert run.transient["events"] == {"count": 2, "touched": 1, "opened": 1, "let_go": 0, "pressed": 0}
    assert (stop["first"], stop["last"]) == (touch[0], part[0])
    assert stop["steps_of_shortest_contact"] > 3


CRANK, ROD, CENTRE, MASS_ROD, INERTIA_ROD, MASS_SLIDER, SPEED = 0.05, 0.12, 0.06, 0.21, 2.5e-4, 0.14, 100 * np.pi
PIN = {"gap": 5e-4, "hardness": 6.6e10, "exponent": 1.5, "restitution": 0.95}


def rattling_pin(count):
    """Event times of the clearance in input/clearance_slider_crank.nml by DOP853: two coordinates, one law, no program of ours."""
    e = PIN["restitution"]
    y = brentq(lambda y: np.log((1 + y) / (1 - e * y)) - y * (1 + e), 1e-6, 1 / e - 1e-9, xtol=1e-16, rtol=1e-15)

    def pin(t, s):
        x, turn, xd, rate = s
        along, phase = np.array([np.cos(turn), np.sin(turn)]), SPEED * t
        across = np.array([-along[1], along[0]])
        d = [x, 0.0] - ROD * along - CRANK * np.array([np.cos(phase), np.sin(phase)])
        v = [xd, 0.0] - ROD * rate * across - CRANK * SPEED * np.array([-np.sin(phase), np.cos(phase)])
        r = np.hypot(*d)
        return d / r, r, d @ v / r, along, across

    def rates(t, s, chi):
        direction, r, rd, along, across = pin(t, s)
        f = -PIN["hardness"] * max(r - PIN["gap"], 0.0) ** PIN["exponent"] * (1 + chi * rd) * direction if chi else np.zeros(2)
        arm = ROD - CENTRE
        coupling = -MASS_ROD * arm * across[0]
        mass = np.array([[MASS_ROD + MASS_SLIDER, coupling], [coupling, INERTIA_ROD + MASS_ROD * arm**2]])
        return [*s[2:], *np.linalg.solve(mass, [f[0] - MASS_ROD * arm * s[3] ** 2 * along[0], -ROD * (f @ across)])]

    t, s, chi, times = 0.0, np.array([CRANK + ROD, 0.0, 0.0, -CRANK * SPEED / ROD]), None, []
    while len(times) < count:
        sign = -1.0 if chi is None else 1.0
        gap = lambda t, s, sign=sign: sign * (pin(t, s)[1] - PIN["gap"])  # noqa: E731
        gap.direction, gap.terminal = -1, True
        step = 2e-5 if chi is None else 3e-6
        law = lambda t, s, chi=chi: rates(t, s, chi)  # noqa: E731
        found = solve_ivp(law, (t, 0.1), s, method="DOP853", rtol=1e-12, atol=1e-16, events=gap, max_step=step)
        t, s = found.t_events[0][-1], found.y_events[0][-1]
        chi = y / pin(t, s)[2] if chi is None else None
        times.append(t)
    return np.array(times)


def test_a_pin_that_rattles_in_its_hole_strikes_when_an_independent_integration_says(run_deck):
    deck = (ROOT / "input" / "clearance_slider_crank.nml").read_text(encoding="utf-8")
    run = run_deck(deck.replace("t_end=0.02", "t_end=0.007"))
    found = np.array([row[0] for row in events_of(run)])[:30]
    truth = rattling_pin(30)
    assert np.abs(found - truth).max() < 1e-11  # of 6.6 ms
    assert np.abs(run.energy["residual"]).max() < 1e-8 * run.energy["stops"][-1]


@pytest.mark.parametrize(("method", "residual"), [("rk4", 1e-3), ("dopri5", 1e-4), ("radau", 1e-4), ("generalized_alpha", 0.03)])
def test_a_step_longer_than_a_contact_is_divided_while_it_lasts_and_grows_again_at_rest(run_deck, method, residual):
    """A contact of 2.8 ms within steps of 10 ms; the ball comes to rest, where implicit methods take the whole step again."""
    deck = SCENE + BALL.format(k=1, y=0.1) + FLOOR + SENSE
    run = run_deck(deck + f"&transient t_end=2.0 method='{method}' step=1.0e-2 output_step=1.0e-2 /\n")
    figures = run.transient
    assert np.abs(run.energy["residual"]).max() < residual * 2.0
    assert 2.0e-4 < figures["step_in_contact"] < 2.6e-4
    assert "steps were divided while stops touched" in run.summary
    assert run.history["p.y"][-1] == pytest.approx(-((MASS * G / 1e8) ** (2 / 3)), rel=1e-6)
    assert figures["steps"] < (4500 if method in ("rk4", "dopri5") else 500)


def test_a_stop_that_fights_a_drive_is_told_with_both_names(run_deck):
    deck = "&history name='h' kind='sine' amplitude=0.3 frequency=2.0 /\n"
    deck += "&body name='lever' kind='rigid' mass=1.0 inertia=0.1 com=0.2,0.0 /\n"
    deck += "&joint name='j' type='revolute' body_a='lever' /\n&drive name='motor' type='rotation' body_a='lever' history='h' /\n"
    deck += "&stop name='end' type='rotation' body_a='lever' upper=UPPER stiffness=1.0e6 exponent=2.0 /\n"
    deck += "&transient t_end=0.5 method='dopri5' tolerance=1.0e-8 output_step=1.0e-2 /\n"
    run = run_deck(deck.replace("UPPER", "0.2"))
    assert 'stop "end" is pressed by drive "motor", which moves on against any force: up to 999' in run.stderr
    assert run.transient["stops"][0]["largest_force"] == pytest.approx(1e6 * 0.1**2, rel=1e-4)
    assert 'prescribed by drive "motor"' in run_deck(deck.replace("UPPER", "0.2"), "--check", name="check").stdout
    assert "fights" not in run_deck(deck.replace("UPPER", "0.4"), name="clear").stderr


def test_a_contact_that_a_reduced_body_cannot_follow_is_told(run_deck):
    deck = (ROOT / "input" / "end_stop.nml").read_text(encoding="utf-8").replace("t_end=0.4", "t_end=0.11")
    told = "less than half a period of what the mesh or modes of body"
    assert told in run_deck(deck.replace("axial=.false.", "axial=.false. modes=2").replace("2.0e7", "2.0e11")).stderr
    assert told not in run_deck(deck, name="soft").stderr
    assert f"warning: that is {told}" in run_deck(deck.replace("2.0e7", "2.0e11"), "--check", name="check").stdout
    assert told not in run_deck(deck, "--check", name="soft_check").stdout


def test_the_example_of_a_contact_is_one_of_a_free_mass(run_deck):
    """A mass on a stop with exponent 1 bounces for half a period of the spring."""
    deck = BALL.format(k=1, y=0.1) + FLOOR.replace("restitution=0.5", "exponent=1.0").replace("1.0e8", "1.0e4")
    example = json.loads(run_deck(deck + "&transient t_end=1.0 method='dopri5' tolerance=1e-6 /\n", "--check", "--json").stdout)
    example = example["stop_examples"][0]
    assert example["stiffness"] == pytest.approx(1e4, rel=1e-12)
    assert example["mass"] == pytest.approx(MASS, rel=1e-12)
    assert example["contact"] == pytest.approx(np.pi * np.sqrt(MASS / 1e4), rel=1e-12)
    rigid = deck.replace("stiffness=1.0e4 exponent=1.0", "restitution=0.5") + "&transient t_end=1.0 step=1e-3 /\n"
    told = run_deck(rigid, "--check", "--json", name="rigid").stdout
    assert json.loads(told)["stop_examples"][0]["mass"] == pytest.approx(MASS, rel=1e-12)


def test_a_second_run_tells_how_well_events_are_known_and_up_to_when(run_deck):
    deck = (ROOT / "input" / "clearance_slider_crank.nml").read_text(encoding="utf-8")
    fine = run_deck(deck.replace("t_end=0.02", "t_end=0.007 check_error=.true.")).transient
    assert fine["events_compared"] >= 30
    assert 0.0 < fine["event_time_error"] < 1e-8
    assert "events_differ_from" not in fine
    coarse = run_deck(deck.replace("t_end=0.02", "t_end=0.02 check_error=.true.").replace("1.0e-11", "1e-4"), name="coarse")
    apart = coarse.transient["events_differ_from"]
    assert 0.002 < apart < 0.02
    second = run_deck(deck.replace("1.0e-11", "1e-5"), name="second")  # as the check's second run, by itself
    off = np.abs(coarse.history["slider.x"] - second.history["slider.x"])  # of two motions from there on
    assert off.argmax() > np.searchsorted(coarse.history["t"], apart)
    assert coarse.transient["estimated_errors"]["slider.x[m]"] == pytest.approx(4 / 3 * off.max(), rel=1e-9)
    assert "rows beyond are not predictable" in coarse.stderr
    assert "event sequences of both runs differ" in coarse.figures["warnings"][0]


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize(("exponent", "e"), [(1.0, 0.5), (1.5, 0.1), (2.0, 1.0)])
def test_a_start_beyond_a_limit_rebounds_as_from_the_touching_that_leads_there(exponent, e, way, run_deck):
    """From rest at a depth a free mass parts with e v0, where a touching with v0 comes to rest at that depth."""
    hardness, depth, mass = 1.0e5, 0.01, 2.0
    y = brentq(lambda y: np.log((1 + y) / (1 - e * y)) - y * (1 + e), 1e-3, 1 / e - 1e-12) if e < 1 else 0.0
    share = (y - np.log(1 + y)) / y**2 if y > 0 else 0.5
    v0 = np.sqrt(hardness * depth ** (exponent + 1) / ((exponent + 1) * mass * share))
    limit = "upper=0" if way > 0 else "lower=0"
    deck = f"""&body name='b' mass={mass} inertia=1 position={way * depth},0 velocity=0,0 /
&joint name='g' type='prismatic' body_a='b' /
&sensor name='v' quantity='velocity' body='b' /
&stop name='s' type='position' body_a='b' {limit} stiffness={hardness} exponent={exponent} restitution={e} /
&transient t_end=0.5 output_step=0.1 method='dopri5' tolerance=1e-9 /
"""
    run = run_deck(deck)
    assert run.history["v.x"][-1] == pytest.approx(-way * e * v0, rel=1e-6)
    assert run.transient["steps"] < 1000


def test_a_contact_that_had_let_go_at_the_start_presses_again_at_the_speed_of_its_depth(run_deck):
    """It leaves its limit, a spring turns it: with the least speed at touching it would crawl back in 1e5 steps and more."""
    deck = """&body name='b' mass=0.015 inertia=1 position=0.005,0 velocity=-0.5,0 /
&joint name='g' type='prismatic' body_a='b' /
&spring name='k' body_a='b' point_b=1,0 stiffness=50000 free_length=0.95 /
&sensor name='v' quantity='velocity' body='b' /
&stop name='s' type='position' body_a='b' upper=0 stiffness=1e7 restitution=0.5 /
&transient t_end=0.01 output_step=0.001 method='dopri5' tolerance=1e-8 /
"""
    run = run_deck(deck)
    assert [row[2:4] for row in events_of(run)][0] == ("upper_free", "upper")
    assert run.transient["steps"] < 3000
