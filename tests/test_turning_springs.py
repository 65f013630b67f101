"""Springs turn: the safe bound holds for every direction that they take in a run, and is reached where they take the worst.

`make extremes` runs 200 scenes of the family, `make test` 40; BOUND_SCENES=n any other number.
"""

from __future__ import annotations

import math
import os
import re

import pytest
from random_springs import random_springs

RK4, DOPRI5 = math.sqrt(8.0), 0.997188  # reach along the imaginary axis
SCENES = int(os.environ.get("BOUND_SCENES", "40"))
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


def test_the_pull_of_a_stretched_spring_counts(run_deck):
    """A body on a lever of 0.1 m under 30 kN: F lever/I, more than the spring's own stiffness gives."""
    lever, force, inertia = 0.1, 3.0e4, 1.0e-3
    exact = RK4 / math.sqrt((1.0e4 * lever**2 + force * lever) / inertia)  # of turns, the largest
    safe = safe_bound(run_deck, PULLED, "rk4")
    assert 0.9 * exact < safe < 1.001 * exact


@pytest.mark.parametrize("seed", range(SCENES))
def test_random_scenes_stay_bounded_below_the_safe_bound(run_deck, seed):
    """At 0.95 of it the mechanical energy does not rise by a fifth of the largest motion's, unless the model is left."""
    deck = random_springs(seed)
    for method in ("rk4", "dopri5"):
        run = run_deck(deck + transient(method, 0.95 * safe_bound(run_deck, deck, method), 3000), name=f"seed{seed}_{method}")
        assert "no longer holds" in run.stderr or rise(run) < 0.2, f"seed {seed}, {method}"
