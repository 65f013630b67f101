"""Maxwell terms: relaxation, creep, poles and responses against closed forms, energy, order of convergence."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from biela.histories import read
from conftest import ROOT
from scipy.integrate import solve_ivp
from scipy.linalg import expm

ALPHA, TAU = np.array([0.6, 1.7, 0.2]), np.array([0.3, 0.021, 0.0016])
TERMS = "prony_alpha=0.6,1.7,0.2 prony_tau=0.3,0.021,0.0016"
GHM = (0.5, 0.8, 90.0)
GHM_WORDS = "ghm_alpha=0.5 ghm_zeta=0.8 ghm_omega=90.0"
MOVE, TURN = 0.05, 0.2  # a cycloid and what it moves by [s], [rad or m]


def followed(t):
    """Return delta - z of every term, shape (terms, times), where delta follows the cycloid."""
    w = 2 * np.pi / MOVE
    u, tau = np.minimum(t, MOVE), TAU[:, None]
    wave = tau / (1 + (w * tau) ** 2) * (np.cos(w * u) + w * tau * np.sin(w * u) - np.exp(-u / tau))
    return TURN / MOVE * (tau * (1 - np.exp(-u / tau)) - wave) * np.exp(-(t - u) / tau)


def moved(t):
    """Return the cycloid."""
    x = np.minimum(t / MOVE, 1.0)
    return TURN * (x - np.sin(2 * np.pi * x) / (2 * np.pi))


CYCLOID = f"&history name='h' kind='cycloid' start_value=0.0 end_value={TURN} start=0.0 finish={MOVE} /\n"
HELD_SPRING = """&body name='b' kind='rigid' mass=1.0 inertia=1.0 /
&joint name='j' type='revolute' body_a='b' /
&drive name='d' type='rotation' body_a='b' history='h' /
&spring name='s' type='torsional' body_a='b' stiffness=40.0 free_angle=0.0 {terms} /
&sensor name='s' quantity='spring' spring='s' /
"""
HELD_ROD = """&material name='m' density=1.0 young=2.0e4 {terms} /
&section name='s' area=1e-3 inertia=1e-7 /
&body name='b' kind='beam' length=0.5 elements=1 material='m' section='s' reference='clamped' {more} /
&body name='c' kind='rigid' mass=1.0 inertia=1.0 position=0.5,0.0 /
&joint name='w' type='weld' body_a='b' node_a=1 /
&joint name='e' type='weld' body_a='c' body_b='b' node_b=2 /
&history name='x' kind='sum' histories='h','o' /
&history name='o' kind='polynomial' coefficients=0.5 /
&drive name='d' type='position' body_a='c' history='x' /
&sensor name='s' quantity='internal' body='b' element=1 /
"""


def mean_pull(history, name):
    """Return the mean axial force of an element that is stretched from its first end: its inertia grows from there."""
    return (2 * history[f"{name}.n"] + history[f"{name}.n2"]) / 3


@pytest.mark.parametrize("method", ["method='rk4' step=1e-4", "method='dopri5' tolerance=1e-12"])
@pytest.mark.parametrize("scene", ["spring", "rod", "rod of modes"])
def test_relaxation_of_a_held_deformation(run_deck, scene, method):
    deck = HELD_SPRING if scene == "spring" else HELD_ROD.replace("{more}", "modes=3" if "modes" in scene else "")
    found = run_deck(CYCLOID + deck.replace("{terms}", TERMS) + f"&transient t_end=0.4 output_step=0.01 {method} /\n").history
    t = found.time
    stiffness = 40.0 if scene == "spring" else 2.0e4 * 1e-3 / 0.5
    force = stiffness * (moved(t) + ALPHA @ followed(t))
    values = found["s.f"] if scene == "spring" else mean_pull(found, "s")
    scale = np.abs(force).max()
    assert np.abs(np.abs(values) - np.abs(force)).max() < 1e-9 * scale


# stiffness, deformation at the start, terms (alpha, tau) and (alpha, zeta, omega): no two owners have as many of each
OWNERS = {
    "rod": (40.0, 0.0, [(0.7, 0.04)], [(0.4, 0.8, 120.0)]),
    "t1": (40.0, 0.1, [(0.6, 0.3), (1.7, 0.021)], []),
    "t2": (25.0, -0.3, [(0.9, 0.015)], [(0.5, 0.8, 90.0), (0.8, 1.5, 40.0)]),
    "l1": (60.0, 0.1, [(0.2, 0.007), (0.4, 0.05), (0.3, 0.4)], [(1.3, 0.7, 60.0)]),
    "l2": (30.0, -0.2, [], [(0.3, 1.0, 150.0), (0.2, 0.6, 200.0), (0.6, 2.0, 90.0)]),
}


def words(maxwell, ghm):
    """Return the deck's words for terms."""
    lists = {"prony_alpha": [m[0] for m in maxwell], "prony_tau": [m[1] for m in maxwell]}
    lists |= {f"ghm_{key}": [g[k] for g in ghm] for k, key in enumerate(("alpha", "zeta", "omega"))}
    return " ".join(f"{key}={','.join(map(str, values))}" for key, values in lists.items() if values)


def follow(maxwell, ghm, t):
    """Return internal variables that follow the cycloid, those of GHM terms first, and the rates of these."""
    n = len(ghm)

    def rates(time, z):
        delta = moved(time)
        second = [w * w * (delta - x) - 2 * zeta * w * v for (_, zeta, w), x, v in zip(ghm, z, z[n:])]
        return [*z[n : 2 * n], *second, *((delta - x) / tau for (_, tau), x in zip(maxwell, z[2 * n :]))]

    start = np.zeros(2 * n + len(maxwell))
    z = solve_ivp(rates, (0.0, t[-1]), start, t_eval=t, rtol=1e-10, atol=1e-12, max_step=MOVE / 10).y
    return [*z[:n], *z[2 * n :]], z[n : 2 * n]


@pytest.mark.parametrize("method", ["'rk4' step=1e-4", "'radau' step=1e-3"])
def test_preloaded_owners_start_relaxed_and_each_follows_by_its_own_terms(run_deck, method):
    deck = CYCLOID + HELD_SPRING[: HELD_SPRING.index("&spring")] + HELD_ROD.replace("name='b'", "name='r'").replace("'b'", "'r'")
    deck = deck.replace("2.0e4 {terms}", f"2.0e4 {words(*OWNERS['rod'][2:])}").replace("name='s' quantity", "name='rod' quantity")
    deck = deck.replace("{more}", "").replace("name='j'", "name='pivot'")
    deck = deck.replace("name='d' type='position'", "name='dx' type='position'")
    for name, (k, d, *terms) in list(OWNERS.items())[1:]:
        deck += f"&spring name='{name}' stiffness={k} {words(*terms)} "
        torsional, linear = f"type='torsional' body_a='b' free_angle={-d} ", f"type='linear' body_a='c' free_length={0.5 - d} "
        deck += torsional if name[0] == "t" else linear
        deck += f"/\n&sensor name='{name}' quantity='spring' spring='{name}' /\n"
    run = run_deck(deck + f"&transient t_end=0.1 output_step=0.01 method={method} /\n")
    scene = json.loads((run.folder / "summary.json").read_text())["model"]
    count = (scene["dissipative_coordinates"], scene["dissipative_coordinates_of_first_order"])
    assert count == (3 * 2 + 2 + 3 + 4 + 3, 3 + 2 + 1 + 3)
    t, potential = run.history.time, 0.0
    for name, (k, d, maxwell, ghm) in OWNERS.items():
        z, zd = follow(maxwell, ghm, t)
        behind = [(alpha, moved(t) - x) for (alpha, *_), x in zip([*ghm, *maxwell], z)]
        force = k * (d + moved(t) + sum(alpha * x for alpha, x in behind))
        found = mean_pull(run.history, name) if name == "rod" else run.history[f"{name}.f"]
        assert found[0] == pytest.approx(k * d, abs=1e-12), "relaxed"
        assert np.abs(found - force).max() < 2e-6 * np.abs(force).max(), name
        potential += k / 2 * ((d + moved(t)) ** 2 + sum(alpha * x**2 for alpha, x in behind))
        potential += k / 2 * sum(alpha * (v / w) ** 2 for (alpha, _, w), v in zip(ghm, zd))
    stored = run.energy["potential"]
    assert stored == pytest.approx(potential, rel=1e-5)


@pytest.mark.parametrize("tau", [(0.02,), (0.3, 0.02)])
def test_the_first_step_of_generalized_alpha_is_of_third_order(run_deck, tau):
    """A deformation that grows evenly from a relaxed start: z'' = delta'/tau there is what the method starts from."""
    rate, k, alpha = 3.0, 40.0, 0.7
    ramp = f"&history name='h' kind='polynomial' coefficients=0.0,{rate} /\n"
    terms = f"prony_alpha={','.join([str(alpha)] * len(tau))} prony_tau={','.join(map(str, tau))}"
    errors = []
    for h in (1e-3, 5e-4):
        words = f"&transient method='generalized_alpha' step={h} t_end={h} output_step={h} /\n"
        force = np.abs(run_deck(ramp + HELD_SPRING.replace("{terms}", terms) + words, name=f"h{h}").history["s.f"])[-1]
        exact = k * rate * (h + sum(alpha * -t * np.expm1(-h / t) for t in tau))
        errors.append(abs(force - exact))
    assert 7.0 < errors[0] / errors[1] < 9.0


@pytest.mark.parametrize("kind", ["spring", "rod"])
def test_creep_under_a_force(run_deck, kind):
    """A mass on a spring or at the end of a rod of one element, let go under a force: the exponential of four equations."""
    mass, k, force = 0.4, 60.0, 3.0
    if kind == "spring":
        deck = f"""&body name='b' kind='rigid' mass={mass} inertia=1.0 position=0.3,0.0 /
&joint name='j' type='prismatic' body_a='b' direction=0.0 /
&spring name='s' type='linear' body_a='b' stiffness={k} free_length=0.3 {TERMS} /
&force name='f' type='force' body='b' fx={force} /
&sensor name='x' quantity='position' body='b' /
"""
    else:
        deck = f"""&material name='m' density={3 * mass / (0.5 * 1e-3)} young={k * 0.5 / 1e-3} {TERMS} /
&section name='s' area=1e-3 inertia=1e-7 /
&body name='b' kind='beam' length=0.5 elements=1 material='m' section='s' reference='clamped' /
&joint name='w' type='weld' body_a='b' node_a=1 /
&force name='f' type='force' body='b' node=2 fx={force} /
&sensor name='x' quantity='deflection' body='b' node=2 /
"""
    run = run_deck(deck + "&transient method='dopri5' tolerance=1e-12 t_end=2.0 output_step=0.1 /\n").history
    a = np.zeros((5, 5))
    a[0, 1] = 1.0
    a[1, 0], a[1, 2:] = -k * (1 + ALPHA.sum()) / mass, k * ALPHA / mass
    a[2:, 0], a[2:, 2:] = 1 / TAU, -np.diag(1 / TAU)
    rest = np.linalg.solve(a, -np.eye(5)[1] * force / mass)
    exact = np.array([(rest - expm(a * t) @ rest)[0] for t in run.time])
    name = next(c for c in run.names if c.startswith("x."))
    assert np.abs(run[name] - run[name][0] - exact).max() < 1e-9 * exact.max()


def ratio(s, ghm):
    """Return E(s)/E_R - 1."""
    s = np.asarray(s)[..., None]
    g = np.sum(ALPHA * s * TAU / (1 + s * TAU), -1)
    if ghm:
        alpha, zeta, omega = GHM
        a = s[..., 0] ** 2 + 2 * zeta * omega * s[..., 0]
        g = g + alpha * a / (a + omega**2)
    return g


@pytest.mark.parametrize("ghm", [False, True])
@pytest.mark.parametrize("kind", ["oscillator", "beam", "beam of modes"])
def test_poles_and_responses_solve_the_equation_of_the_modulus(run_deck, kind, ghm):
    words = TERMS + (" " + GHM_WORDS if ghm else "")
    if kind == "oscillator":
        deck = f"""&body name='b' kind='rigid' mass=0.4 inertia=1.0 position=0.3,0.0 /
&joint name='j' type='prismatic' body_a='b' direction=0.0 /
&spring name='s' type='linear' body_a='b' stiffness=600.0 free_length=0.3 {words} /
&force name='f' type='force' body='b' fx=1.0 /
&sensor name='x' quantity='position' body='b' /
"""
    else:
        deck = f"""&material name='m' density=1200.0 young=3.0e6 {words} /
&section name='s' shape='rectangle' width=0.02 height=0.01 /
&body name='b' kind='beam' length=0.3 elements=4 material='m' section='s' axial=.false. {"modes=3" if "modes" in kind else ""} /
&joint name='j' type='revolute' body_a='b' node_a=1 /
&joint name='k' type='slider' body_a='b' node_a=-1 direction=0.0 /
&force name='f' type='force' body='b' node=3 fy=1.0 /
&sensor name='x' quantity='deflection' body='b' node=3 /
"""
    run = run_deck(deck + "&modal modes=3 /\n&frequency_response from=0.5 to=200.0 points=9 input='f' /\n")
    found = read(run.folder, "modes")
    poles = found["real"] + 1j * found["imag"]
    assert re.search(r"poles: .*complete", run.summary)
    undamped = np.abs(poles[found["kind"] == 0])
    named = 0
    for s in poles[found["kind"] > 0]:
        parts = np.abs(s) ** 2 + undamped**2 * np.abs(1 + ratio(s, ghm))
        assert (np.abs(s**2 + undamped**2 * (1 + ratio(s, ghm))) / parts).min() < 1e-10
        named += 1 if s.imag == 0 else 2
    assert named == len(undamped) * (2 + 3 + (2 if ghm else 0))
    if kind == "oscillator":
        response = read(run.folder, "frequency_response")
        w = 2 * np.pi * response.time
        exact = 1 / (600.0 * (1 + ratio(1j * w, ghm)) - 0.4 * w**2)
        assert np.abs(response["x.x.re"] + 1j * response["x.x.im"] - exact).max() < 1e-10 * np.abs(exact).max()


@pytest.mark.parametrize("rod", [0, 1])
def test_rods_of_different_laws_in_one_scene_respond_by_their_own(run_deck, rod):
    """Laws that are told apart by neither the sum of their numbers nor their kind; tip of a single element: k, and m of a third."""
    k, mass, laws = 600.0, 0.4, ((0.5, 0.25), (0.25, 0.5))
    deck = "&section name='s' area=1e-3 inertia=1e-7 /\n"
    for number, (alpha, tau) in enumerate(laws):
        deck += f"""&material name='m{number}' density={3 * mass / 0.5e-3} young={k * 500.0} prony_alpha={alpha} prony_tau={tau} /
&body name='b{number}' kind='beam' length=0.5 elements=1 material='m{number}' section='s' reference='clamped' /
&joint name='w{number}' type='weld' body_a='b{number}' node_a=1 /
"""
    deck += f"&force name='f' type='force' body='b{rod}' node=2 fx=1.0 /\n"
    deck += f"&sensor name='x' quantity='deflection' body='b{rod}' node=2 /\n"
    response = read(run_deck(deck + "&frequency_response from=0.1 to=10.0 points=5 input='f' /\n").folder, "frequency_response")
    s = 2j * np.pi * response.time
    alpha, tau = laws[rod]
    exact = 1 / (k * (1 + alpha * s * tau / (1 + s * tau)) + mass * s**2)
    assert np.abs(response["x.u.re"] + 1j * response["x.u.im"] - exact).max() < 1e-10 * np.abs(exact).max()


SWING = f"""&scene gravity=0.0,-9.81 /
&material name='m' density=1100.0 young=3.0e7 prony_alpha=0.8,0.5 prony_tau=0.02,0.0009 {GHM_WORDS} /
&material name='n' density=1300.0 young=5.0e7 prony_alpha=0.6 prony_tau=0.004 /
&section name='s' shape='rectangle' width=0.02 height=0.015 /
&body name='a' kind='beam' length=0.4 elements=2 material='m' section='s' STIFF angle=-0.4 /
&body name='c' kind='frame' node_x=0.0,0.2,0.3 node_y=0.0,0.0,0.1 element_nodes=1,2,2,3 material='n','m' section='s' MODES
  position=X,Y reference='clamped' /
&joint name='o' type='revolute' body_a='a' node_a=1 /
&joint name='p' type='revolute' body_a='c' node_a=1 body_b='a' node_b=-1 /
&spring name='t' type='torsional' body_a='c' node_a=1 body_b='a' node_b=-1 stiffness=0.8 prony_alpha=2.0 prony_tau=0.03 /
&spring name='u' type='linear' body_a='c' node_a=-1 point_b=0.5,0.2 stiffness=20.0 ghm_alpha=1.0 ghm_zeta=1.0 ghm_omega=60.0 /
&sensor name='tip' quantity='position' body='c' node=-1 /
&sensor name='in' quantity='internal' body='c' element=1 /
""".replace("X,Y", f"{0.4 * np.cos(0.4):.17g},{-0.4 * np.sin(0.4):.17g}")


def swing(run_deck, stiff, modes, words, name="swing"):
    """Return the run of two swinging viscoelastic links."""
    deck = SWING.replace("STIFF", "stiffening=.true." if stiff else "").replace("MODES", "modes=3" if modes else "")
    return run_deck(deck + f"&transient t_end=0.03 output_step=0.003 {words} /\n", name=name)


@pytest.mark.parametrize(("stiff", "modes"), [(False, False), (True, True)])
@pytest.mark.parametrize(("method", "order"), [("rk4", 4), ("generalized_alpha", 2)])
def test_order_and_energy_balance(run_deck, stiff, modes, method, order):
    """Differences between halved steps fall by two to the order, and so does the residual of the energies."""
    steps = 4e-5 * np.array([1.0, 0.5, 0.25])
    runs = [swing(run_deck, stiff, modes, f"method='{method}' step={float(h)!r}", f"swing{i}") for i, h in enumerate(steps)]
    for name in ("tip.x", "tip.y"):
        a, b, c = (run.history[name] for run in runs)
        assert np.log2(np.abs(a - b).max() / np.abs(b - c).max()) == pytest.approx(order, abs=0.25)
    swings = np.ptp(runs[2].energy["potential"])
    assert np.abs(runs[2].energy["residual"]).max() < (1e-9 if order == 4 else 1e-4) * swings
    assert runs[2].energy["dissipated"][-1] > 1e-3 * swings
    assert np.all(np.diff(runs[2].energy["dissipated"]) >= 0.0)


def test_methods_agree(run_deck):
    exact = swing(run_deck, True, False, "method='dopri5' tolerance=1e-10").history
    for words, bound in [
        ("method='rk4' step=2e-5", 1e-7),
        ("method='generalized_alpha' step=1e-5", 1e-4),
        ("method='radau' tolerance=1e-6", 1e-5),
    ]:
        found = swing(run_deck, True, False, words).history
        for name in ("tip.x", "tip.y"):
            assert np.abs(found[name] - exact[name]).max() < bound * np.ptp(exact[name]), words


def test_scale_shifts_the_rates(run_deck):
    """ghm_frequency_scale multiplies every rate 1/tau and every omega; modulus_at reads both kinds."""
    scaled = SWING.replace("/\n&material name='n'", "ghm_frequency_scale=2.5 /\n&material name='n'")
    plain = SWING.replace("prony_tau=0.02,0.0009", "prony_tau=0.008,0.00036").replace("ghm_omega=90.0", "ghm_omega=225.0")
    runs = [
        run_deck(deck.replace("STIFF", "").replace("MODES", "") + "&modal modes=2 /\n", name=name)
        for name, deck in (("a", scaled), ("b", plain))
    ]
    a, b = (read(run.folder, "modes") for run in runs)
    for part in ("real", "imag"):
        np.testing.assert_allclose(a[part], b[part], rtol=1e-9, atol=1e-6)


def test_elastic_twin(run_deck):
    """viscoelastic=.false. leaves the terms out, modulus_at takes the storage modulus of both kinds."""
    deck = """&material name='m' density=1200.0 young=3.0e6 {terms} /
&section name='s' shape='rectangle' width=0.02 height=0.01 /
&body name='b' kind='beam' length=0.3 elements=3 material='m' section='s' viscoelastic=.false. {at} /
&joint name='j' type='weld' body_a='b' node_a=1 /
&modal modes=2 /
"""
    hertz = 12.0
    found = [
        read(run_deck(deck.format(terms=terms, at=at), name=name).folder, "modes")["imag"]
        for name, terms, at in (
            ("e", "", ""),
            ("t", f"{TERMS} {GHM_WORDS}", ""),
            ("a", f"{TERMS} {GHM_WORDS}", f"modulus_at={hertz}"),
        )
    ]
    np.testing.assert_allclose(found[1], found[0], rtol=1e-12)
    storage = 1 + ratio(2j * np.pi * hertz, True).real
    np.testing.assert_allclose(found[2], found[0] * np.sqrt(storage), rtol=1e-9)


def test_the_explicit_bound_is_that_of_the_term(run_deck):
    """A slow spring with a fast term: rk4's bound is 2.785 tau nearly, and named so."""
    told = run_deck(
        "&body name='b' kind='rigid' mass=1.0 inertia=1.0 /\n&joint name='j' type='revolute' body_a='b' /\n"
        "&spring name='s' type='torsional' body_a='b' stiffness=1.0 prony_alpha=0.5,0.1 prony_tau=1.0,1e-5 /\n"
        "&transient method='rk4' step=1e-5 t_end=1.0 /\n",
        "--check",
    ).stdout
    bound = float(re.search(r"rk4: safe bound\s+([-+.\dE]+)", told)[1])
    assert bound == pytest.approx(2.7853e-5, rel=1e-3)
    assert 'Maxwell pole of spring "s", term 2' in told


def test_the_summary_names_the_kinds_of_terms_of_a_body(run_deck):
    deck = "&material name='g' density=1200.0 young=3.0e8 ghm_alpha=0.5 ghm_zeta=1.5 ghm_omega=900.0 /\n"
    deck += "&material name='p' density=1200.0 young=3.0e8 prony_alpha=0.5 prony_tau=1e-3 /\n"
    deck += "&section name='s' area=1e-4 inertia=9e-9 /\n"
    deck += "&body name='b' kind='beam' length=0.4 elements=2 element_material={} section='s' /\n"
    for materials, ghm, maxwell in (("'g','p'", 1, 1), ("'g','g'", 1, 0), ("'p','p'", 0, 1)):
        words = f"one a viscoelastic deformation and term, up to {ghm} of GHM and {maxwell} of Maxwell"
        assert f"6 dissipative coordinates ({words})" in run_deck(deck.format(materials), "--check").stdout


def test_the_elastomer_with_maxwell_terms_moves_as_with_ghm_terms(run_deck):
    """The shipped decks: the same history within 1e-4 of its range, half the state for the terms, a larger explicit step."""
    runs = {}
    for name in ("elastomer_cantilever", "elastomer_cantilever_maxwell"):
        text = (
            (ROOT / "input" / f"{name}.nml").read_text(encoding="utf-8").replace("file='materials", f"file='{ROOT}/input/materials")
        )
        runs[name] = run_deck(text.replace("t_end=0.5", "t_end=0.1"), name=name)
    ghm, maxwell = runs.values()
    for name in ("tip.v", "tip.r", "wall.fy", "wall.m"):
        a, b = ghm.history[name], maxwell.history[name]
        assert np.abs(a - b).max() < 1e-4 * np.ptp(a)
    bounds = [run.figures["stable_steps"]["rk4"]["safe_bound"] for run in (ghm, maxwell)]
    assert bounds[1] > 2.0 * bounds[0]
    assert "dissipative coordinates: 36, of first order: 36" in maxwell.summary
