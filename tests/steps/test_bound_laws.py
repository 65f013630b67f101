"""Laws of the advised step: exact eigenvalues of a disc on a spring, and independent parts that bound the step each by itself."""

from __future__ import annotations

import json
import os
import re
from itertools import combinations

import numpy as np
import pytest
from numpy.polynomial import Polynomial

STABILITY = {
    "rk4": [1 / 24, 1 / 6, 1 / 2, 1.0, 1.0],
    "dopri5": [1 / 600, 1 / 120, 1 / 24, 1 / 6, 1 / 2, 1.0, 1.0],
}
PARTS = {
    "elastic spring": "&body name='a' kind='rigid' mass=1.0 inertia=1.0 /\n&joint name='a' type='revolute' body_a='a' /\n"
    "&spring name='a' type='torsional' body_a='a' stiffness=100.0 /\n",
    "spring that GHM stiffens": "&body name='b' kind='rigid' mass=1.0 inertia=1.0 /\n&joint name='b' type='revolute' body_a='b' /\n"
    "&spring name='b' type='torsional' body_a='b' stiffness=20.0 ghm_alpha=14.0 ghm_zeta=0.5 ghm_omega=1.0 /\n",
    "damper": "&body name='c' kind='rigid' mass=1.0 inertia=1.0 /\n&joint name='c' type='revolute' body_a='c' /\n"
    "&spring name='c' type='torsional' body_a='c' stiffness=1.0 damping=40.0 /\n",
    "soft beam with Rayleigh damping": "&material name='d' density=1000.0 young=1.0e4 rayleigh_stiffness=3.0 /\n"
    "&section name='d' area=1.0e-4 inertia=1.0e-8 /\n"
    "&body name='d' kind='beam' length=1.0 elements=1 material='d' section='d' axial=.false. reference='clamped' /\n"
    "&joint name='d' type='weld' body_a='d' node_a=1 /\n",
}


def bounds(run_deck, deck, method, name="d"):
    """Return the safe and the current bound of a scene [s]."""
    told = run_deck(deck + "&transient method='rk4' step=1.0e-6 t_end=1.0 /\n", "--check", name=name).stdout
    return [float(x) for x in re.search(method + r": safe bound\s+(\S+) s .*, current bound\s+(\S+) s", told).groups()]


def safe_bound(run_deck, deck, method, name="d"):
    """Return the safe bound of a scene [s]."""
    return bounds(run_deck, deck, method, name)[0]


def largest_step(eigenvalues, method, points=600001):
    """Return the smallest step at which an eigenvalue leaves the stability region [s]."""
    steps = np.linspace(0.0, 1.2, points)[1:] * 4.0 / max(abs(eigenvalues))
    outside = [abs(np.polyval(STABILITY[method], steps * mu)) > 1.0 + 1e-9 for mu in eigenvalues]
    return steps[np.argmax(np.any(outside, axis=0))]


def disc(k, c, terms):
    """Return the deck of a disc of inertia 1 on a spring, and its eigenvalues, the terms' coordinates in."""
    a = np.zeros((2 + 2 * len(terms), 2 + 2 * len(terms)))
    a[0, 1], a[1, 0], a[1, 1] = 1.0, -k * (1.0 + sum(alpha for alpha, _, _ in terms)), -c
    for i, (alpha, zeta, omega) in enumerate(terms):
        j = 2 + 2 * i
        a[1, j], a[j, j + 1] = k * alpha, 1.0
        a[j + 1, [0, j, j + 1]] = omega**2, -(omega**2), -2.0 * zeta * omega
    lists = [",".join(repr(float(term[i])) for term in terms) for i in range(3)]
    ghm = "ghm_alpha={} ghm_zeta={} ghm_omega={}".format(*lists) if terms else ""
    deck = "&body name='d' kind='rigid' mass=1.0 inertia=1.0 /\n&joint name='j' type='revolute' body_a='d' /\n"
    deck += f"&spring name='s' type='torsional' body_a='d' stiffness={k!r} damping={c!r} {ghm} /\n"
    return deck, np.linalg.eigvals(a)


@pytest.mark.parametrize("method", STABILITY)
@pytest.mark.parametrize(
    ("k", "c", "terms"),
    [
        (100.0, 0.0, []),
        (1.0, 40.0, []),
        (100.0, 3.0, []),
        (100.0, 1.0, [(0.5, 0.4, 8.0)]),
        (100.0, 0.0, [(0.3, 0.2, 12.0), (2.5, 0.1, 7.0)]),
        (100.0, 25.0, [(0.3, 0.2, 3.0), (1.5, 0.6, 7.0), (0.2, 0.1, 1.0)]),
    ],
)
def test_one_disc_has_its_exact_bound(run_deck, method, k, c, terms):
    deck, eigenvalues = disc(k, c, terms)
    exact = largest_step(eigenvalues, method)
    assert safe_bound(run_deck, deck, method) == pytest.approx(exact, rel=2e-4)


def coupled_discs(seed):
    """Return discs on one axis between springs with dampers and GHM terms of their own, and the eigenvalues of all of it."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 6))
    inertia = (10 ** rng.uniform(-1, 1, n)).tolist()
    deck, terms, k, c = "", [], np.zeros((n, n)), np.zeros((n, n))
    for i, j in enumerate(inertia):
        deck += f"&body name='d{i}' kind='rigid' mass=1.0 inertia={j!r} /\n&joint name='j{i}' type='revolute' body_a='d{i}' /\n"
    for s in range(2 * n):
        b, a = sorted(rng.choice(n + 1, 2, replace=False))
        line = (np.eye(n + 1)[a, 1:] - np.eye(n + 1)[b, 1:]) / np.sqrt(inertia)
        stiffness, more = 10 ** rng.uniform(2, 4), ""
        k += stiffness * np.outer(line, line)
        if rng.random() < 0.4:
            damping = 10 ** rng.uniform(-1, 2)
            c += damping * np.outer(line, line)
            more += f" damping={damping!r}"
        if rng.random() < 0.6:
            count = rng.integers(1, 3)
            own = np.array([10 ** rng.uniform(*ends, count) for ends in ((-1, 1), (-0.7, 0.5), (0.5, 2.5))])
            lists = [",".join(repr(float(x)) for x in row) for row in own]
            more += " ghm_alpha={} ghm_zeta={} ghm_omega={}".format(*lists)
            terms += [(*term, np.sqrt(stiffness) * line) for term in own.T]
        on = f"body_b='d{b - 1}'" if b else ""
        deck += f"&spring name='s{s}' type='torsional' body_a='d{a - 1}' {on} stiffness={stiffness!r}{more} /\n"
    order = 2 * n + 2 * len(terms)
    whole = np.zeros((order, order))
    whole[:n, n : 2 * n], whole[n : 2 * n, :n], whole[n : 2 * n, n : 2 * n] = np.eye(n), -k, -c
    for i, (alpha, zeta, omega, line) in zip(range(2 * n, order, 2), terms):
        whole[n : 2 * n, :n] -= alpha * np.outer(line, line)
        whole[n : 2 * n, i], whole[i, i + 1] = alpha * line, 1.0
        whole[i + 1, :n], whole[i + 1, i : i + 2] = omega**2 * line, [-(omega**2), -2 * zeta * omega]
    return deck, np.linalg.eigvals(whole)


@pytest.mark.parametrize("seed", range(int(os.environ.get("BOUND_SCENES", "16")) // 4))
def test_the_current_bound_of_coupled_discs_is_that_of_all_their_eigenvalues(run_deck, seed):
    """Dampers and terms couple the modes. Poles of terms that no disc reaches may lower it a little, never raise it."""
    deck, eigenvalues = coupled_discs(seed)
    told = run_deck(deck + "&transient method='rk4' step=1.0e-6 t_end=1.0 /\n", "--check").stdout
    seen = eigenvalues[(eigenvalues.imag >= 0.0) & (np.abs(eigenvalues) > 1e-5 * np.abs(eigenvalues).max())]  # but for free turns
    for method in STABILITY:
        line = re.search(method + r": safe bound\s+(\S+) s .*, current bound\s+(\S+) s", told)
        exact = largest_step(seen, method)
        assert 0.9 < float(line[2]) / exact < 1.001, f"seed {seed}, {method}"
        assert float(line[1]) / exact < 1.001, f"seed {seed}, {method}"


def controlled_sled(name, mass, stiffness, **law):
    """Return the deck of a sled with a spring and a controller, and its poles: m s2 + k + H(s) = 0."""
    s = Polynomial([0.0, 1.0])
    filtered = 1.0 + law.get("filter", 0.0) * s
    of, over = (law["kp"] * s + law.get("ki", 0.0)) * filtered + law.get("kd", 0.0) * s**2, s * filtered
    x = law.get("delay", 0.0) * s
    of, over = of * (120.0 - 60.0 * x + 12.0 * x**2 - x**3), over * (120.0 + 60.0 * x + 12.0 * x**2 + x**3)
    deck = f"&body name='{name}' mass={mass!r} inertia=1 /\n&joint name='{name}' type='prismatic' body_a='{name}' /\n"
    deck += f"&sensor name='{name}' quantity='position' body='{name}' /\n"
    deck += f"&spring name='{name}' body_a='{name}' stiffness={stiffness!r} /\n"
    keys = " ".join(f"{key}={value!r}" for key, value in law.items())
    deck += f"&controller name='{name}' argument='{name}.x' history='zero' {keys} /\n"
    deck += f"&force name='{name}' body='{name}' fx=1 controller='{name}' /\n"
    return deck, ((mass * s**2 + stiffness) * over + of).roots()


ZERO = "&history name='zero' coefficients=0 /\n"
PID = {"kp": 1e4, "kd": 10.0, "filter": 1e-3}


@pytest.mark.parametrize(
    ("sleds", "cause"),
    [
        ([(1.0, 100.0, PID)], 'the loop of controller "s0"'),  # a pole of the filter, which no fast motion shows
        ([(1.0, 100.0, {"kp": 1e4, "ki": 1e3, "delay": 2e-3})], 'the loop of controller "s0"'),
        ([(1.0, 1e6, {"kp": 1e2, "kd": 0.1, "filter": 0.1})], "a mode of springs and rigid bodies"),
        ([(1.0 + 0.01 * k, 100.0, {"kp": 1e4}) for k in range(16)], 'the loop of controller "s0"'),
        ([(1.0 + 0.01 * k, 100.0, {"kp": 1e4 if k else 1.0}) for k in range(12)], 'the loop of controller "s1"'),
        ([(1.0 + 0.01 * k, 1e4, {"kp": 1.0} | (PID if k == 11 else {})) for k in range(12)], 'the loop of controller "s11"'),
    ],
)
def test_loops_of_controllers_bound_the_step_with_their_states(run_deck, sleds, cause):
    parts = [controlled_sled(f"s{i}", mass, stiffness, **law) for i, (mass, stiffness, law) in enumerate(sleds)]
    deck = ZERO + "".join(text for text, _ in parts)
    poles = np.concatenate([own for _, own in parts])
    told = run_deck(deck + "&transient method='rk4' step=1.0e-6 t_end=1.0 /\n", "--check").stdout
    poles = np.minimum(poles.real, 0.0) + 1j * poles.imag  # what grows is followed as what does not decay
    for method in STABILITY:
        line = re.search(method + r": .* current bound\s+(\S+) s .*\n +limited by (.*), \|eigenvalue", told)
        assert float(line[1]) == pytest.approx(largest_step(poles, method, 60001), rel=2e-4)
    assert re.search(r"rk4: .*\n +limited by (.*), \|eigenvalue", told)[1] == cause


@pytest.mark.parametrize("factor", [0.95, 1.05])
def test_a_filtered_loop_diverges_beyond_its_bound(run_deck, factor):
    deck, _ = controlled_sled("s", 1.0, 100.0, **PID)
    step = factor * safe_bound(run_deck, ZERO + deck, "rk4")
    deck = ZERO + deck.replace("mass=1.0", "mass=1.0 velocity=1e-3,0")
    deck += f"&transient method='rk4' step={step} t_end={400 * step} output_step={40 * step} accept_unstable=.true. /\n"
    run = run_deck(deck, expect=int(factor > 1.0))
    assert ("diverged" in run.stderr) == (factor > 1.0)


@pytest.mark.parametrize("pair", combinations(PARTS, 2), ids=" and ".join)
def test_the_bound_of_parts_that_do_not_touch_is_that_of_the_worst(run_deck, pair):
    for method in STABILITY:
        alone = [bounds(run_deck, PARTS[part], method, name=f"only{i}") for i, part in enumerate(pair)]
        both = bounds(run_deck, "".join(PARTS[part] for part in pair), method)
        assert both == pytest.approx(np.min(alone, axis=0), rel=2e-4)


def test_poles_of_terms_that_a_joint_keeps_at_rest_count_beside_a_damper(run_deck):
    """A weld holds a disc on a GHM spring. Released, its motion makes poles of the terms faster than a vibration beside it."""
    damped, _ = disc(1.35**2, 0.01, [])
    vibration, own = disc(1.35**2, 0.0, [])  # as stiff, without damping: no other motion is extreme
    vibration = damped + re.sub("'([djs])'", r"'\1\1\1'", vibration)
    held, poles = disc(0.1, 0.0, [(14.0, 1.0, 1.0)])
    held = re.sub("'([djs])'", r"'\1\1'", held).replace("revolute", "weld")
    released, vibrates = largest_step(poles, "rk4"), largest_step(own, "rk4")
    assert released < 0.9 * vibrates
    safe, current = bounds(run_deck, vibration + held, "rk4")
    assert 0.95 * released < safe < 1.0002 * released
    assert current == pytest.approx(vibrates, rel=2e-4)


def test_the_worst_mixture_of_two_vibrations_lies_between_them(run_deck):
    """Discs on springs of one stiffness, one critically damped: what is damped in part is stable up to 6 % shorter steps only."""
    decks = [disc(100.0, c, [])[0] for c in (0.0, 20.0)]
    decks[1] = re.sub("'([djs])'", r"'\1\1'", decks[1])
    mixtures = [np.roots([1.0, c, 100.0]) for c in np.linspace(0.0, 20.0, 41)]
    steps = [largest_step(eigenvalues, "rk4") for eigenvalues in mixtures]
    assert min(steps) < 0.95 * min(steps[0], steps[-1])
    assert safe_bound(run_deck, "".join(decks), "rk4") == pytest.approx(min(steps), rel=5e-3)


WORDS = [
    ("axial=.false.", 'a bending mode of body "b"'),
    ("", 'an axial mode of body "b"'),
    ("flexible=.false.", "a mode of springs and rigid bodies"),
]


@pytest.mark.parametrize(("more", "words"), WORDS)
def test_what_limits_is_named(run_deck, more, words):
    """A slender beam is fastest along itself, in bending where it cannot stretch; a soft one elsewhere has no part in it."""
    deck = (
        "&material name='m' density=1000.0 young=1.0e9 /\n&material name='soft' density=1000.0 young=1.0e3 /\n"
        "&section name='s' area=1.0e-4 inertia=1.0e-9 /\n"
        f"&body name='b' kind='beam' length=1.0 elements=2 material='m' section='s' {more} /\n"
        "&body name='other' kind='beam' length=1.0 elements=2 material='soft' section='s' position=0.0,2.0 /\n"
        "&spring name='k' type='torsional' body_a='b' stiffness=10.0 /\n"
    )
    told = run_deck(deck + "&transient method='rk4' step=1.0e-6 t_end=1.0 /\n", "--check").stdout
    assert re.search(r"limited by (.*), \|eigenvalue\|", told)[1] == words
    assert ("larger steps by" in told) == words.endswith('body "b"')


LIKE = """&material name='m' density=1000.0 young=1.0e9 {material} /
&section name='s' area=1.0e-4 inertia=1.0e-9 /
"""


def beams(lengths: list[float], material: str = "") -> str:
    """Return free beams beside each other."""
    deck = LIKE.format(material=material)
    for k, length in enumerate(lengths):
        deck += f"&body name='b{k}' kind='beam' length={length} elements=2 material='m' section='s' position=0.0,{k} /\n"
    return deck + "&transient method='rk4' step=1.0e-8 t_end=1.0 /\n"


@pytest.mark.parametrize(("material", "words"), [
    ("rayleigh_stiffness=1.0e-3", "Rayleigh damping of an axial mode of body"),
    ("rayleigh_stiffness=1.0e-7", "an axial mode of body"),
])  # fmt: skip
def test_damping_that_limits_is_named(run_deck, material, words):
    told = run_deck(beams([1.0, 1.0], material), "--check").stdout
    assert re.search(r"rk4: safe.*\n +limited by (.*?) \"", told)[1] == words
    assert ("larger steps by: less Rayleigh damping on body" in told) == words.startswith("Rayleigh")


def test_a_force_that_sees_nothing_of_the_motion_bounds_no_step(run_deck):
    """A piston at its dead centre stands still for small turns of the crank: a force over its place is no spring there."""
    deck = """&body name='crank' mass=8 inertia=0.04 angle={pi} /
&body name='rod' mass=0.5 inertia=8e-4 com=0.04,0 position=-0.03,0 /
&body name='piston' mass=0.6 inertia=1e-4 position=0.08,0 /
&joint name='bearing' type='revolute' body_a='crank' /
&joint name='pin' type='revolute' body_a='rod' body_b='crank' point_b=0.03,0 /
&joint name='eye' type='revolute' body_a='rod' point_a=0.11,0 body_b='piston' /
&joint name='bore' type='prismatic' body_a='piston' /
&sensor name='place' quantity='position' body='piston' /
&history name='gas' kind='table' argument='place.x' interpolation='linear' time=0,0.1,0.2 value=0,-100,-300 /
&force name='gas' body='piston' fx=1 history='gas' /
&transient method='rk4' step=1.0e-3 t_end=1.0 /
"""
    told = run_deck(deck, "--check").stdout
    assert "rk4: no limit" in told
    assert "dopri5: no limit" in told


@pytest.mark.parametrize("feed", [0.0, 10.0, 200.0])
@pytest.mark.parametrize("spring", [False, True])
def test_a_vibration_that_forces_make_grow_bounds_steps_by_its_frequency(run_deck, spring, feed):
    """A mass with x'' - feed x' + 1e6 x = 0, the stiffness that of a spring or of a force over the place."""
    deck = """&body name='m' mass=1 inertia=1 position=0.001,0 /
&joint name='guide' type='prismatic' body_a='m' /
&sensor name='x' quantity='position' body='m' /
&sensor name='v' quantity='velocity' body='m' /
"""
    if spring:
        deck += "&spring name='k' type='linear' body_a='m' point_b=-1,0 stiffness=1e6 free_length=1 /\n"
    else:
        deck += "&history name='k' kind='table' argument='x.x' interpolation='linear' time=-1,1 value=1e6,-1e6 /\n"
        deck += "&force name='k' body='m' fx=1 history='k' /\n"
    deck += "&history name='c' kind='table' argument='v.x' interpolation='linear' "
    deck += f"time=-1000,1000 value={-1000 * feed},{1000 * feed} /\n&force name='c' body='m' fx=1 history='c' /\n"
    told = run_deck(deck + "&transient method='rk4' step=1e-6 t_end=1.0 /\n", "--check", "--json", name="told").stdout
    assert json.loads(told)["stable_steps"].get("growth", 0.0) == pytest.approx(feed / 2, rel=1e-9)
    safe, current = bounds(run_deck, deck, "rk4")
    frequency = np.sqrt(1e6 - feed**2 / 4)
    assert current == pytest.approx(np.sqrt(8) / frequency, rel=1e-4)
    assert safe == pytest.approx(np.sqrt(8) / (1000 if spring else frequency), rel=1e-4)
