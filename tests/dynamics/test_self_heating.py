"""Temperatures of a cycle at which losses and heat flow agree, against closed forms of springs; runaway; a warm body."""

import re

import numpy as np
import pytest
from conftest import ROOT
from scipy.optimize import brentq, fsolve

AMBIENT = 20.0
W = 20.0  # of the force [rad/s]

HEAD = f"""&scene temperature={AMBIENT} /
&history name='h' kind='sine' amplitude=1 frequency={{{W}/2/pi}} /
&periodic period={{2*pi/{W}}} multipliers=0 /
&transient method='rk4' step={{2*pi/{W}/600}} output_step={{2*pi/{W}/20}} /
"""
LAW = "prony_alpha=1.5 prony_tau=0.02 wlf=8.86,101.6 reference_temperature=20 vertical=1e-3"
ONE = """&body name='m' mass=2 inertia=1 /
&joint name='line' type='prismatic' body_a='m' /
&spring name='k' body_a='m' body_b='ground' point_b=-1,0 stiffness=4000 damping=40 LAW thermal_resistance=R /
&force name='f' body='m' fx=60 history='h' /
&sensor name='m' quantity='position' body='m' /
"""


def stiffness(temperature, k, damping=0.0, wlf=(8.86, 101.6), vertical=1e-3):
    """Return K(iW) of a spring with the terms of LAW."""
    a = 10 ** (-wlf[0] * (temperature - 20) / (wlf[1] + temperature - 20))
    s = 1j * W * a
    return (1 + vertical * (temperature - 20)) * (k * (1 + 1.5 * 0.02 * s / (1 + 0.02 * s)) + damping * s)


def heated(run):
    """Return (temperature, loss) of each heated part, and hold them to the part's own balance."""
    parts = run.figures["periodic"]["heated"]
    for part in parts:
        balance = part["ambient"] + part["thermal_resistance"] * part["loss"]
        assert abs(part["temperature"] - balance) < 1e-5 * (balance - part["ambient"]) + 1e-12
    return [(part["temperature"], part["loss"]) for part in parts]


@pytest.mark.parametrize("resistance", [3.0, 60.0])
def test_a_spring_whose_loss_falls(run_deck, resistance):
    """One degree of freedom under a force; with 60 K/W the plain iteration goes from 20 to 273 degrees and back for ever."""

    def power(temperature):
        k = stiffness(temperature, 4000.0, 40.0)
        return 0.5 * W * abs(60 / (k - 2 * W**2)) ** 2 * k.imag

    run = run_deck(HEAD + ONE.replace("LAW", LAW).replace("=R", f"={resistance}"), "--quiet")
    ((temperature, loss),) = heated(run)
    exact = brentq(lambda t: t - AMBIENT - resistance * power(t), AMBIENT, 300.0, xtol=1e-12)
    assert temperature == pytest.approx(exact, abs=2e-5 * (exact - AMBIENT))
    assert loss == pytest.approx(power(exact), rel=1e-5)
    assert np.ptp(run.history["m.x"]) == pytest.approx(2 * abs(60 / (stiffness(exact, 4000.0, 40.0) - 2 * W**2)), rel=0.02)
    (told,) = run.figures["periodic"]["temperatures"]
    assert told["modulus"] == pytest.approx(1 + 1e-3 * (temperature - 20), rel=1e-12)


MOVED = """&body name='m' mass=2 inertia=1 /
&joint name='line' type='prismatic' body_a='m' /
&drive name='d' type='position' body_a='m' history='h' relative=.true. /
&spring name='k' body_a='m' body_b='ground' point_b=-5,0 stiffness=40 damping=2 vertical=V reference_temperature=20
  thermal_resistance=R /
"""


@pytest.mark.parametrize("share", [0.5, 0.9, 1.1, 3.0])
def test_runaway_where_each_kelvin_adds_more_heat_than_flows_off(run_deck, share):
    """Moved by a drive, with a modulus that grows by v a kelvin: T - T_a = R P/(1 - v R P), and none from v R P = 1 on."""
    resistance, power = 0.25, 0.5 * 2.0 * W**2
    deck = HEAD.replace("600", "100") + MOVED.replace("=V", f"={share / (resistance * power)!r}").replace("=R", f"={resistance}")
    run = run_deck(deck, "--quiet", expect=0 if share < 1 else 1)
    if share < 1:
        ((temperature, _),) = heated(run)
        assert temperature - AMBIENT == pytest.approx(resistance * power / (1 - share), rel=1e-5)
    else:
        assert re.search(r'thermal runaway: spring "k" at \S+ C loses \S+ W, which leads to \S+ C; ', run.stderr)
        assert run.status == 1


def test_a_modulus_that_ends(run_deck):
    """Softer with each kelvin, through the resonance, until from 220 degrees on the law has no value: steps beyond are halved."""
    deck = ONE.replace("LAW", LAW.replace("1e-3", "-5e-3").replace("wlf=8.86,101.6 ", "")).replace("damping=40", "")
    ((temperature, loss),) = heated(run_deck(HEAD + deck.replace("=R", "=30"), "--quiet"))

    def power(temperature):
        k = stiffness(temperature, 4000.0, 0.0, (0.0, 1.0), -5e-3)
        return 0.5 * W * abs(60 / (k - 2 * W**2)) ** 2 * k.imag

    exact = brentq(lambda t: t - AMBIENT - 30 * power(t), 205.0, 219.9, xtol=1e-12)
    assert (temperature, loss) == (pytest.approx(exact, rel=1e-5), pytest.approx(power(exact), rel=1e-5))


def test_two_springs_of_one_chain(run_deck):
    """What one loses depends on the temperature of the other: beside a root of two equations."""
    springs, masses, resistances = (4000.0, 2500.0), (2.0, 1.0), (9.0, 25.0)
    deck = "".join(
        f"""&body name='m{n}' mass={masses[n]} inertia=1 position={n},0 /
&joint name='line{n}' type='prismatic' body_a='m{n}' /
&spring name='k{n}' body_a='m{n}' body_b='{("ground", "m0")[n]}' {("point_b=-1,0", "")[n]} stiffness={springs[n]} {LAW}
  thermal_resistance={resistances[n]} /
"""
        for n in range(2)
    )

    def powers(temperatures):
        k = [stiffness(t, spring) for t, spring in zip(temperatures, springs)]
        dynamic = np.array([[k[0] + k[1], -k[1]], [-k[1], k[1]]]) - W**2 * np.diag(masses)
        x = np.linalg.solve(dynamic, [0, 30.0])
        return np.array([0.5 * W * abs(d) ** 2 * s.imag for d, s in zip((x[0], x[1] - x[0]), k)])

    run = run_deck(HEAD + deck + "&force name='f' body='m1' fx=30 history='h' /\n", "--quiet")
    temperatures, losses = np.array(heated(run)).T
    exact = fsolve(lambda t: t - AMBIENT - np.array(resistances) * powers(t), temperatures, xtol=1e-10)
    np.testing.assert_allclose(temperatures - AMBIENT, exact - AMBIENT, rtol=1e-4)
    np.testing.assert_allclose(losses, powers(exact), rtol=1e-4)
    assert min(exact) > 25


def test_a_rod_of_the_pump_warms_itself(run_deck):
    """Its losses are those of its energy sensor, Rayleigh damping included; the cycle is that of a rod at that temperature."""
    deck = (ROOT / "input" / "warm_pump.nml").read_text(encoding="utf-8") + "&sensor name='rod' quantity='energy' body='rod' /\n"
    deck = deck.replace("reference_temperature", "rayleigh_stiffness=1e-5 reference_temperature")
    run = run_deck(deck, "--quiet", name="pump")
    ((temperature, loss),) = heated(run)
    history = run.history
    assert history["rod.dissipated"][-1] / history["t"][-1] == pytest.approx(loss, rel=1e-9)
    assert temperature == pytest.approx(36.5, abs=1.5)
    stated = deck.replace("thermal_resistance=7", f"temperature={temperature!r}")
    same = run_deck(stated, "--quiet", name="stated").history
    for column in ("bend.v", "torque.m"):
        assert np.abs(same[column] - history[column]).max() < 1e-6 * np.ptp(same[column])
    check = run_deck(deck, "--check").stdout
    assert re.search(r'body "rod": beam .*, warmed by its losses in the cycle, 7 K/W from 25 C', check)


ROD = """&scene temperature=20 /
&material name='soft' density=1000 young=1e9 prony_alpha=0.5 prony_tau=2e-3 arrhenius=60e3 reference_temperature=20 OWN/
&section name='s' shape='rectangle' width=0.01 height=0.01 /
&body name='b' kind='beam' length=0.3 elements=2 modes=1 reference='clamped' material='soft' section='s' OF_BODY/
&joint name='w' type='weld' body_a='b' node_a=1 /
&history name='h' kind='sine' amplitude=0.5 frequency=20 /
&force name='f' body='b' node=-1 fy=1 history='h' /
&periodic period=0.05 multipliers=0 /
&transient method='radau' step=1e-3 output_step=1e-2 /
"""
STEEL = "&material name='stiff' density=1000 young=1e9 prony_alpha=0.5 prony_tau=2e-3 arrhenius=60e3 reference_temperature=20 /\n"


@pytest.mark.parametrize(("own", "body", "expected"), [("", "", 20), ("60", "", 60), ("", "40", 40), ("60", "40", 40)])
def test_ambient_temperature_of_a_body(run_deck, own, body, expected):
    """Its own, before that of its material, before that of the scene: with heat that flows off at once as without losses."""
    deck = ROD.replace("OWN", f"temperature={own} " * bool(own))
    stated = f"temperature={body} " * bool(body)
    cold = run_deck(deck.replace("OF_BODY", stated)).figures["periodic"]["lost_in_a_period"]
    run = run_deck(deck.replace("OF_BODY", stated + "thermal_resistance=1e-9 "))
    ((temperature, _),) = heated(run)
    assert temperature == pytest.approx(expected, abs=1e-6)
    assert run.figures["periodic"]["lost_in_a_period"] == pytest.approx(cold, rel=1e-6)


def test_materials_that_differ(run_deck):
    """Of a body that its losses warm they state one temperature, or the body does."""
    deck = ROD.replace("OWN", "temperature=60 ").replace("material='soft'", "element_material='soft','stiff'") + STEEL
    told = run_deck(deck.replace("OF_BODY", "thermal_resistance=1 "), expect=2).stderr
    assert "its materials state 60 and 20 C, expected temperature of the body" in told
    run_deck(deck.replace("OF_BODY", "thermal_resistance=1 temperature=60 "), "--check")
