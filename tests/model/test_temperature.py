"""Temperature: E(s, T) = b_T E(a_T s, T_ref) of materials, springs, bodies and layers: closed forms, decks shifted by hand."""

import numpy as np
import pytest
from linear_scenes import Response

GAS, ZERO = 8.314462618, 273.15
MASS = 2.0  # of the one-degree oscillator [kg]


def factors(temperature, wlf=None, arrhenius=0.0, vertical=0.0, reference=20.0):
    """Return a_T and b_T at a temperature [°C]."""
    log = -wlf[0] * (temperature - reference) / (wlf[1] + temperature - reference) if wlf else 0.0
    a = 10.0**log * np.exp(arrhenius / GAS * (1 / (temperature + ZERO) - 1 / (reference + ZERO)))
    return a, 1 + vertical * (temperature - reference)


def modulus(s, ghm=(), maxwell=(), viscous=0.0):
    """Return E(s)/E_R."""
    terms = sum(a * (s**2 + 2 * z * w * s) / (s**2 + 2 * z * w * s + w**2) for a, z, w in ghm)
    return 1 + terms + sum(a * s * t / (1 + s * t) for a, t in maxwell) + viscous * s


OSCILLATOR = f"""&parameter name='T' value=20 /
&body name='m' kind='rigid' mass={MASS} inertia=1.0 /
&joint name='line' type='prismatic' body_a='m' /
&spring name='k' body_a='m' body_b='ground' point_b=-1,0 LAW reference_temperature=20 temperature={{T}} /
&force name='f' body='m' fx=1 /
&sensor name='m' quantity='position' body='m' /
&frequency_response input='f' from=0.1 to=30 points=25 /
"""


@pytest.mark.parametrize(
    ("said", "law"),
    [("wlf=8.86,101.6 vertical=2e-3", {"wlf": (8.86, 101.6), "vertical": 2e-3}), ("arrhenius=90e3", {"arrhenius": 90e3})],
)
def test_a_spring_of_one_term_of_each_kind(run_deck, said, law):
    """Compliance of one degree of freedom; the temperature is a parameter, as in a sweep. A damper's oil thins, too."""
    k, c = 4000.0, 3.0
    terms = "ghm_alpha=0.8 ghm_zeta=1.7 ghm_omega=60 prony_alpha=1.5 prony_tau=0.02"
    deck = OSCILLATOR.replace("LAW", f"stiffness={k} damping={c} {terms} {said}")
    for temperature in (-10.0, 20.0, 75.5):
        run = run_deck(deck, "--quiet", "--set", f"T={temperature}")
        response = Response(run)
        a, b = factors(temperature, **law)
        stiff = b * k * modulus(a * response.s, [(0.8, 1.7, 60.0)], [(1.5, 0.02)], c / k)
        np.testing.assert_allclose(response["m.x"], 1 / (stiff + MASS * response.s**2), rtol=1e-9)
        (told,) = run.figures["model"]["temperatures"]
        assert told == {"spring": "k", "temperature": temperature, "times": pytest.approx(a, rel=1e-12),
                        "reference_temperature": 20, "modulus": pytest.approx(b, rel=1e-14)}  # fmt: skip


ARMS = """&scene SCENE /
&material name='r' density=1100 young=YOUNG ghm_alpha=0.5 ghm_zeta=1.3 ghm_omega=GHM prony_alpha=2.0 prony_tau=TAU LAW
  rayleigh_stiffness=RAYLEIGH band=BAND /
&material name='steel' density=7800 young=2.1e11 /
&section name='s' shape='rectangle' width=0.02 height=0.01 SHEAR /
&section name='l' layers='steel','r','steel' thickness=2e-3,1e-3,1e-3 width=0.02 /
&body name='one' kind='beam' length=0.3 elements=3 material='r' section='s' reference='clamped' ONE /
&body name='two' kind='beam' length=0.4 elements=3 section='LAYERS' reference='clamped' /
&joint name='j' type='weld' body_a='one' node_a=1 /
&joint name='k' type='weld' body_a='two' node_a=1 /
&force name='f' body='one' node=-1 fy=1 /
&force name='g' body='two' node=-1 fy=1 /
&sensor name='a' quantity='deflection' body='one' node=-1 /
&sensor name='b' quantity='deflection' body='two' node=-1 /
"""
WLF = (8.86, 101.6)
LAW = "wlf=8.86,101.6 vertical=1e-3 reference_temperature=20"
ELASTIC = {"YOUNG": 5e6, "GHM": 400.0, "TAU": 0.01, "RAYLEIGH": 1e-4}


def arms(force, first=(1.0, 1.0), **words):
    """Return a deck of two arms; first: a_T and b_T by which the numbers of the material are moved."""
    values = {"YOUNG": 5e6 * first[1], "GHM": 400.0 / first[0], "TAU": 0.01 * first[0], "RAYLEIGH": 1e-4 * first[0]}
    values |= {"BAND": "1,50", "SCENE": "", "LAW": "", "ONE": "", "SHEAR": "", "LAYERS": "l"} | words
    text = ARMS
    for key, value in values.items():
        text = text.replace(key, str(value))
    return text + f"&frequency_response input='{force}' from=0.3 to=300 points=12 /\n"


@pytest.mark.parametrize(
    ("words", "at"),
    [
        ({"SCENE": "temperature=60"}, (60.0, 60.0)),
        ({"SCENE": "temperature=60", "LAW": LAW + " temperature=45"}, (45.0, 45.0)),
        ({"SCENE": "temperature=60", "LAW": LAW + " temperature=45", "ONE": "temperature=80"}, (80.0, 45.0)),
        ({"ONE": "temperature=0", "SHEAR": "shear=.true."}, (0.0, 20.0)),
        ({}, (20.0, 20.0)),
    ],
)
def test_bodies_and_layers_have_the_modulus_of_their_temperatures(run_deck, words, at):
    """Body before material before scene before reference; beside decks whose numbers are moved by hand."""
    for force, column, temperature in zip("fg", "ab", at):
        found = Response(run_deck(arms(force, **{"LAW": LAW} | words), "--quiet", name="law"))[f"{column}.v"]
        hand = arms(force, factors(temperature, WLF, 0.0, 1e-3), SHEAR=words.get("SHEAR", ""))
        np.testing.assert_allclose(found, Response(run_deck(hand, "--quiet", name="hand"))[f"{column}.v"], rtol=1e-9)


def test_a_layered_body_at_a_temperature_of_its_own(run_deck):
    """Its materials are in its sections; the other body's stay as they are."""
    deck = arms("g", LAW=LAW).replace("section='l' reference", "section='l' temperature=70 reference")
    hand = arms("g", factors(70.0, WLF, 0.0, 1e-3))
    expected = Response(run_deck(hand, "--quiet", name="hand"))["b.v"]
    np.testing.assert_allclose(Response(run_deck(deck, "--quiet", name="law"))["b.v"], expected, rtol=1e-9)
    deck, hand = (text.replace("input='g'", "input='f'") for text in (deck, arms("g")))
    expected = Response(run_deck(hand, "--quiet", name="hand"))["a.v"]
    np.testing.assert_allclose(Response(run_deck(deck, "--quiet", name="law"))["a.v"], expected, rtol=1e-9)


def test_the_band_moves_and_losses_are_told_apart(run_deck):
    """At a_T = 0.1 a band of 1 to 50 Hz is one of 10 to 500 Hz: of 12 frequencies from 0.3 to 300 Hz six lie below."""
    deck = arms("f", LAW="arrhenius=1e5 reference_temperature=20", ONE="temperature=TEMP")
    warm = 1 / (1 / (20.0 + ZERO) - GAS * np.log(10.0) / 1e5) - ZERO
    deck = deck.replace("TEMP", f"{warm:.12g}") + "&transient method='radau' tolerance=1e-4 t_end=0.02 /\n"
    run = run_deck(deck, "--quiet")
    said = 'from 0.30 to 6.93 Hz, lie outside the band of material "r in one", 10.00 to 500.00 Hz'
    assert f"warning: 6 of 12 frequencies of the response, {said}" in run.stderr
    assert 'outside the band of material "r", 1.00 to 50.00 Hz' in run.stderr
    assert {loss["material"] for loss in run.transient["losses"]} == {"r", "r in one"}
    assert f'material "r in one" at {warm:.4g}' in run.summary


def test_temperatures_on_which_nothing_depends_are_told(run_deck):
    run = run_deck(arms("f", SCENE="temperature=40", ONE="temperature=50"), "--check")
    assert run.status == 0
    assert run.stderr.count("temperature changes nothing") == 2
    run = run_deck(arms("f", SCENE="temperature=40", LAW=LAW), "--check")
    assert "temperature changes nothing" not in run.stderr
