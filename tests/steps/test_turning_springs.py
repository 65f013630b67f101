"""Springs turn: the safe bound holds for every direction that they take in a run, and is reached where they take the worst.

`make extremes` runs 200 scenes of the family, `make test` 16; BOUND_SCENES=n any other number.
"""

from __future__ import annotations

import math
import os
import re

import numpy as np
import pytest
from random_springs import random_springs

RK4, DOPRI5 = math.sqrt(8.0), 0.997188  # reach along the imaginary axis
LEAST = 2.0 / 3.0
SCENES = int(os.environ.get("BOUND_SCENES", "16"))
TURNING = """&body name='b' kind='rigid' mass=1.0 inertia=1.0e-3 com=0.1,0.0 angular_velocity=20.0 /
&spring name='s' type='linear' body_a='b' point_b=0.5,0.0 stiffness=1.0e6 /
"""
BEAM = """&material name='m' density=1200.0 young=3.0e9 /
&section name='s' shape='rectangle' width=0.02 height=0.02 /
&body name='b' kind='beam' length=0.4 elements=2 material='m' section='s' angular_velocity=20.0 /
&spring name='s' type='linear' body_a='b' node_a=1 point_b=-2.0,0.0 stiffness=3.0e7 {damping} /
"""
PAIR = """&body name='a' kind='rigid' mass=2.0 inertia=0.02 com=0.05,0.1 /
&body name='b' kind='rigid' mass=0.5 inertia=4.0e-3 position=1.0,0.4 angle=0.7 /
&spring name='s' type='linear' body_a='a' point_a=0.3,0.0 body_b='b' point_b=0.1,0.2 stiffness=1.0e5 /
"""
GUIDED = """&body name='p' kind='rigid' mass=1.0 inertia=1.0e-6 com=0.0,0.2 /
&joint name='g' type='prismatic' body_a='p' direction=1.5707963267948966 /
&spring name='s' type='linear' body_a='p' point_b={point} stiffness=1.0e4 /
"""
PULLED = """&body name='b' kind='rigid' mass=1.0 inertia=1.0e-3 /
&spring name='s' type='linear' body_a='b' point_a=0.1,0.0 point_b=3.1,0.0 stiffness=1.0e4 free_length=0.0 /
&force name='f' type='force' body='b' fx=-3.0e4 /
"""


def transient(method: str, step: float, steps: int) -> str:
    """Return a fixed-step &transient group with a row every tenth step."""
    return (
        f"&transient t_end={steps * step:.12e} method='{method}' step={step:.12e} output_step={10 * step:.12e}"
        " accept_unstable=.true. /\n"
    )


def safe_bound(run_deck, deck: str, method: str) -> float:
    """Return the safe bound that a check states [s]."""
    told = run_deck(deck + transient(method, 1e-9, 100), "--check").stdout
    return float(re.search(rf"{method}: safe bound\s+(\S+) s", told)[1])


def rise(run) -> float:
    """Return how far the mechanical energy rose above the start's; it can only fall."""
    energy = run.energy["kinetic"] + run.energy["potential"]
    scale = max(energy[0] - energy.min(), run.energy["kinetic"].max())
    return (energy.max() - energy[0]) / scale


@pytest.mark.parametrize("method", ["rk4", "dopri5"])
@pytest.mark.parametrize("deck", [TURNING, BEAM.format(damping=""), BEAM.format(damping="damping=20.0")])
def test_a_spring_that_turns_does_not_leave_the_safe_bound(run_deck, deck, method):
    safe = safe_bound(run_deck, deck, method)
    steps = 20 * math.ceil(2 * math.pi / 20.0 / safe / 10)
    assert rise(run_deck(deck + transient(method, 0.95 * safe, steps))) < 1e-6


def test_the_safe_bound_is_the_current_one_in_the_worst_direction(run_deck):
    """Across the lever, at rest but for a light push, 1.05 of it diverges; the same body along the spring has a larger bound."""
    worst = TURNING.replace("point_b=0.5,0.0", "point_b=0.0,0.5").replace("angular_velocity=20.0", "")
    worst += "&force name='f' type='force' body='b' fx=1.0e-3 fy=1.0e-3 /\n"
    bounds = {}
    for name, deck in (("along", TURNING), ("across", worst)):
        told = run_deck(deck + transient("rk4", 1e-9, 100), "--check", name=name).stdout
        bounds[name] = [float(x) for x in re.search(r"rk4: safe bound\s+(\S+) s.*current bound\s+(\S+) s", told).groups()]
    assert bounds["along"][0] == pytest.approx(bounds["across"][0], rel=2e-4)
    assert bounds["along"][0] < 0.5 * bounds["along"][1]
    assert bounds["across"][0] == pytest.approx(bounds["across"][1], rel=2e-4)
    assert run_deck(worst + transient("rk4", 0.95 * bounds["across"][0], 4000)).status == 0
    assert run_deck(worst + transient("rk4", 1.05 * bounds["across"][0], 4000), expect=1).status == 1


@pytest.mark.parametrize(
    ("deck", "square"),
    [
        (TURNING, 1.0e6 * (1 / 1.0 + 0.1**2 / 1.0e-3)),
        (PAIR, 1.0e5 * (1 / 2.0 + (0.25**2 + 0.1**2) / 0.02 + 1 / 0.5 + (0.1**2 + 0.2**2) / 4.0e-3)),
    ],
)
def test_one_spring_has_the_bound_of_its_worst_direction(run_deck, deck, square):
    assert safe_bound(run_deck, deck, "rk4") == pytest.approx(RK4 / math.sqrt(square), rel=2e-4)
    assert safe_bound(run_deck, deck, "dopri5") == pytest.approx(DOPRI5 / math.sqrt(square), rel=2e-4)


def test_a_spring_along_a_guide_does_not_turn(run_deck):
    """The inertia of a body that cannot turn does not count, unless the spring lies across the guide and turns."""
    along = safe_bound(run_deck, GUIDED.format(point="0.0,-0.5").replace("com=0.0,0.2", "com=0.0,0.0"), "rk4")
    assert along == pytest.approx(RK4 / math.sqrt(1.0e4), rel=2e-4)
    guide = GUIDED.replace("direction=1.5707963267948966", "direction=0.0")
    for text, free in ((GUIDED, "0.0,-0.5"), (guide, "-0.5,0.0")):
        deck = text.format(point=free)
        loose = re.sub("&joint.*\n", "", deck)
        assert safe_bound(run_deck, deck, "rk4") >= safe_bound(run_deck, loose, "rk4")


@pytest.mark.parametrize("turning", [TURNING, PULLED])
def test_a_spring_that_cannot_turn_hides_none_behind_it(run_deck, turning):
    """A torsion spring and one along a guide, both far too soft to matter, before or behind the spring that turns."""
    still = GUIDED.format(point="0.0,1.0").replace("name='s'", "name='g'").replace("1.0e4", "1.0e-3")
    still += "&spring name='t' type='torsional' body_a='p' stiffness=1.0e-9 /\n"
    bounds = [safe_bound(run_deck, deck, "rk4") for deck in (still + turning, turning + still)]
    assert bounds[0] == pytest.approx(bounds[1], rel=1e-9) == pytest.approx(safe_bound(run_deck, turning, "rk4"), rel=1e-3)


def test_the_pull_of_a_stretched_spring_counts(run_deck):
    """A body on a lever of 0.1 m under 30 kN: F lever/I, more than the spring's own stiffness gives."""
    lever, force, inertia = 0.1, 3.0e4, 1.0e-3
    exact = RK4 / math.sqrt((1.0e4 * lever**2 + force * lever) / inertia)  # of turns, the largest
    safe = safe_bound(run_deck, PULLED, "rk4")
    assert 0.9 * exact < safe < 1.001 * exact


@pytest.mark.parametrize("seed", range(SCENES))
def test_random_scenes_stay_bounded_below_the_safe_bound(run_deck, seed):
    """At 0.95 of it the mechanical energy does not rise, but for what deflections do, of which the run tells.

    Below a right bound no mode grows; what energy rises by is the error of modes that the steps resolve badly, a thousandth of
    the largest swing in 300 scenes with both methods. A hundredth is allowed: a mode beyond its bound by 2 % takes 3000 steps
    to a multiple of it.
    """
    deck = random_springs(seed)
    for method in ("rk4", "dopri5"):
        step = 0.95 * safe_bound(run_deck, deck, method)
        run = run_deck(deck + transient(method, step, 3000), name=f"seed{seed}_{method}", expect=None)
        told = "no longer holds" in run.stderr or "deflections changed the inertia" in run.stderr
        assert told or (run.status == 0 and rise(run) < 0.01), f"seed {seed}, {method}: {run.stderr}"


DAMPERS = """&scene gravity=0.0,-9.81 /
&body name='a' kind='rigid' mass=0.5441 inertia=0.02113 com=0.1625,-0.0651 position=0.0,-0.209 angular_velocity=-18.203 /
&body name='b' kind='rigid' mass=1.429 inertia=0.00861 com=-0.0202,-0.0229 position=0.4,0.128 angular_velocity=6.35 /
&spring name='s' type='linear' body_a='b' point_a=0.0189,-0.1311 body_b='a' point_b=-0.1982,-0.1576 stiffness=1.8e5 damping=384.7 /
&spring name='t' type='linear' body_a='a' point_a=0.1937,-0.2515 body_b='b' point_b=-0.1153,-0.2236 stiffness=6.0e5 damping=11.53 /
"""


@pytest.mark.parametrize("method", ["rk4", "dopri5"])
def test_a_damped_mode_that_no_undamped_one_resembles(run_deck, method):
    """Two dampers between two bodies reach the real eigenvalue -3061 1/s; the most damped mode by itself has 2766 1/s."""
    safe = safe_bound(run_deck, DAMPERS, method)
    assert safe < {"rk4": 2.785, "dopri5": 3.307}[method] / 3061.0
    assert rise(run_deck(DAMPERS + transient(method, 0.95 * safe, 3000))) < 0.01


def dampers(rng: np.random.Generator, freedoms: int) -> tuple[str, np.ndarray, np.ndarray]:
    """Return discs on one axis, springs and dampers between them, with stiffness and damping over the inertia 1."""
    deck, k, c = "", np.zeros((freedoms, freedoms)), np.zeros((freedoms, freedoms))
    for i in range(freedoms):
        deck += f"&body name='d{i}' kind='rigid' mass=1.0 inertia=1.0 /\n&joint name='j{i}' type='revolute' body_a='d{i}' /\n"
    for n in range(2 * freedoms):
        a, b = rng.choice(freedoms + 1, 2, replace=False)
        a, b = max(a, b), min(a, b)
        line = np.eye(freedoms + 1)[a, 1:] - np.eye(freedoms + 1)[b, 1:]
        stiffness, damping = 10 ** rng.uniform(2, 4), 10 ** rng.uniform(-1, 2)
        other = f"body_b='d{b - 1}'" if b else ""
        deck += f"&spring name='s{n}' type='torsional' body_a='d{a - 1}' {other} stiffness={stiffness!r} damping={damping!r} /\n"
        k += stiffness * np.outer(line, line)
        c += damping * np.outer(line, line)
    return deck, k, c


def largest_step(eigenvalues: np.ndarray, method: str) -> float:
    """Return the smallest step at which an eigenvalue leaves the stability region [s]."""
    terms = {"rk4": [1 / 24, 1 / 6, 1 / 2, 1, 1], "dopri5": [1 / 600, 1 / 120, 1 / 24, 1 / 6, 1 / 2, 1, 1]}[method]
    steps = np.linspace(0.0, 4.8, 20001)[1:] / abs(eigenvalues).max()
    return steps[np.argmax((abs(np.polyval(terms, steps[:, None] * eigenvalues)) > 1 + 1e-9).any(axis=1))]


@pytest.mark.parametrize("seed", range(12))
def test_no_eigenvalue_of_discs_with_dampers_passes_the_bound(run_deck, seed):
    """Against all eigenvalues of the first-order system: stable at the bound, which is at least two thirds of the exact one."""
    rng = np.random.default_rng(seed)
    freedoms = int(rng.integers(2, 6))
    deck, k, c = dampers(rng, freedoms)
    zero, one = np.zeros((freedoms, freedoms)), np.eye(freedoms)
    eigenvalues = np.linalg.eigvals(np.block([[zero, one], [-k, -c]]))
    for method in ("rk4", "dopri5"):
        ratio = safe_bound(run_deck, deck, method) / largest_step(eigenvalues, method)
        assert LEAST < ratio < 1 + 2e-4, f"seed {seed}, {method}: {ratio}"


BENT = """&material name='m' density=1200.0 young=1.245e10 /
&section name='s' shape='rectangle' width=0.02 height=0.012 /
&body name='a' kind='rigid' mass=2.862 inertia=0.01905 com=0.036,-0.0099 position=0.0,0.217 angle=2.161 angular_velocity=5.728 /
&body name='b' kind='beam' length=0.4 elements=3 section='s' reference='clamped' material='m' position=0.4,0.17 angle=-1.924
  angular_velocity=11.493 /
&lump body='b' node=4 mass=0.2934 inertia=1.0e-4 /
&spring name='s0' type='linear' body_a='a' point_a=0.2172,-0.2104 point_b=0.256,0.297 stiffness=7.2e6 damping=9709 /
&spring name='s1' type='linear' body_a='b' node_a=2 body_b='a' point_b=0.193,-0.0713 stiffness=1.33e7 damping=317.8 /
&spring name='s2' type='linear' body_a='b' node_a=1 body_b='a' point_b=0.2442,-0.2317 stiffness=1.12e7 ghm_alpha=1.58 ghm_zeta=0.965
  ghm_omega=3.0e4 /
"""


def test_deflections_that_lower_the_bound_are_told(run_deck):
    """A light beam whose tip turns by 0.18 rad raises the largest frequency from 1.02e5 to 1.75e5 rad/s; there are no joints."""
    safe = safe_bound(run_deck, BENT, "rk4")
    assert "bent as far as the model holds" in run_deck(BENT + transient("rk4", 1e-9, 100), "--check").stdout
    checked = run_deck(BENT + transient("rk4", 0.95 * safe, 100), "--check").stdout
    bent = float(re.search(r"bent as far as the model holds they would allow about +(\S+) s", checked)[1])
    said = re.search(r"of the safe bound: too large where bodies bend .* holds; expected at most (\S+) s$", checked.strip())
    assert float(said[1]) == pytest.approx(0.98 * bent, rel=1e-3)
    refused = run_deck(BENT + transient("rk4", 1.1 * safe, 100).replace("accept_unstable=.true.", ""), expect=2).stderr
    assert float(re.search(r"expected at most +(\S+) s", refused)[1]) == pytest.approx(0.98 * bent, rel=1e-2)
    run = run_deck(BENT + transient("rk4", 0.95 * safe, 1000), expect=None)
    assert re.search(r"too large where bodies bend as far as the model holds; expected at most (\S+) s", run.stderr)[1] == said[1]
    told = r"smallest current bound, at t = \S+ s, limited by .*body \"b\": .*deflections changed the inertia"
    assert re.search(told, run.stderr)
    small = run_deck(BENT + transient("rk4", 0.5 * safe, 1000))
    assert "deflections changed the inertia" not in small.stderr
    assert rise(small) < 0.01
