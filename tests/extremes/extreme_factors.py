"""One factor at a time: what is made extreme, and what must happen."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from extreme_cases import Case, Ran, bounds, call, safe_bound
from extreme_friction import friction, long_rest, rigid_stops
from extreme_implicit import all_implicit
from extreme_measures import REFUSAL, UNSTABLE, away, largest, residual, same
from extreme_motion import LONG, SHARE, masses, singular_positions, spins
from extreme_scales import drives, loads, many_steps, units
from extreme_scenes import Term, cantilever, oscillator, oscillator_bound, oscillator_exact, transient
from extreme_stops import stops

STEPS = 30_000  # of a run at the limit: enough for one that grows by a thousandth a step
SLOW = 1_500_000  # for one that grows by 3e-5 a step
Measure = Callable[[Ran], float]
CANTILEVERS = {
    "E 1e3": {"young": 1e3},
    "E 1e15": {"young": 1e15},
    "slenderness 1": {"slenderness": 1.0},
    "slenderness 1e5": {"slenderness": 1e5},
    "1 element": {"elements": 1},
    "64 elements": {"elements": 64},
    "static shapes": {"elements": 8, "more": "modes=2 static_shapes=.true."},
    "64 elements, static shapes": {"elements": 64, "more": "modes=4 static_shapes=.true."},
    "E 1e15, static shapes": {"young": 1e15, "more": "modes=1 static_shapes=.true."},
    "slenderness 1e5, static shapes": {"slenderness": 1e5, "more": "modes=1 static_shapes=.true."},
}
FACTORS = {
    "GHM alpha": {f"1e{k}": [(10.0**k, 1.0, 3.0)] for k in range(-6, 4)},
    "GHM zeta": {f"1e{k}": [(0.5, 10.0**k, 3.0)] for k in range(-3, 4)},
    "GHM omega [rad/s]": {f"1e{k}": [(0.5, 1.0, 10.0**k)] for k in range(-2, 10)},
    "Maxwell alpha": {f"1e{k}": [(10.0**k, 0.3)] for k in range(-6, 4)},
    "Maxwell tau [s]": {f"1e{k}": [(0.5, 10.0**k)] for k in range(-9, 4)},
    "Maxwell mixed": {
        "slow and fast": [(1e3, 1e2), (0.5, 1e-3)],
        "tiny and huge": [(1e-6, 1.0), (1e3, 1.0)],
        "a decade each": [(1.0, 10.0**k) for k in range(-4, 3)],
        "nearly one term thrice": [(0.3, 0.4999), (0.3, 0.5), (0.3, 0.5001)],
        "beside GHM": [(0.5, 1.0, 3.0), (0.5, 0.3)],
        "beside GHM, far apart": [(0.5, 1e3, 2.0), (1e3, 1e-6), (1e-6, 1e3)],
    },
    "GHM mixed": {
        "all small": [(1e-6, 1e-3, 1e-2)],
        "slow and fast": [(1e3, 0.7, 1e-2), (0.5, 1.0, 1e3)],
        "undamped and overdamped": [(0.5, 1e-3, 2.0), (0.5, 1e3, 2.0)],
        "tiny and huge": [(1e-6, 1.0, 1.0), (1e3, 1.0, 1.0)],
        "everything": [(1e-6, 1e3, 1e-2), (1e3, 1e-3, 1.0), (1.0, 1.0, 1e9)],
        "the same term thrice": [(0.3, 1.0, 2.0)] * 3,
    },
}


def at_the_limit(
    name: str, deck: str, bound: float, measure: Measure, limit: float, method: str = "rk4", steps: int = STEPS
) -> list[Case]:
    """Return runs at 0.95 and 1.05 of a bound: one that must stay bounded, one that must be lost."""
    factor, found = "step / advised limit", []
    for share in (0.95, 1.05):
        h = share * bound
        run = deck + transient(steps * h, h, 100, "accept_unstable=.true.", method)
        if share < 1.0:
            found.append(Case(factor, f"{share:g} {name}", run, "stays bounded", measure=measure, limit=limit, method=method))
        else:
            found.append(Case(factor, f"{share:g} {name}", run, "diverges and says so", 1, UNSTABLE, method=method))
    return found


def steps_at_the_limit() -> list[Case]:
    """Return runs at 0.95 and 1.05 of the advised step: limited by modes, static shapes, poles of GHM and Maxwell terms."""
    free = cantilever(elements=2)[0].replace("&joint name='wall' type='weld' body_a='beam' node_a=1 /\n", "")
    scenes = {
        "disc": oscillator([]),
        "real GHM pole": oscillator([(0.5, 20.0, 50.0)]),
        "complex GHM pole": oscillator([(0.5, 0.3, 50.0)]),
        "free beam": free,
    }
    found = []
    for name, deck in scenes.items():
        for method in ("rk4", "dopri5"):
            h = safe_bound(deck, method)
            said = REFUSAL.replace("rk4", method)
            refused = deck + transient(6300 * h, 1.05 * h, 100, method=method)
            value = f"1.05 {name}, as is"
            found.append(Case("step / advised limit", value, refused, "refuses with advice", 2, said, method=method))
            if name != "free beam" or method == "rk4":  # of dopri5 an undamped mode grows by 3e-5 a step only
                steps = SLOW if name == "disc" and method == "dopri5" else STEPS
                found += at_the_limit(name, deck, h, residual, 1.0, method, steps)
    for factor, rows in FACTORS.items():
        for value, terms in rows.items():
            deck, name = oscillator(terms), f"{factor.split(' [')[0].removeprefix('GHM ')} {value}"
            stays, _ = at_the_limit(name, deck, bounds(deck)[1], largest, 0.25)
            _, lost = at_the_limit(name, deck, oscillator_bound(terms), largest, 0.25)  # the advice counts 1/tau beside the poles
            found += [stays, lost]
    for name, words in CANTILEVERS.items():
        deck = cantilever(**words)[0]
        found += at_the_limit(name, deck, bounds(deck)[1], residual, 1.0)
    return found


def beams() -> list[Case]:
    """Return cantilevers from soft to hard, stubby to slender, of one to 512 elements."""
    base, period, static = cantilever(more="axial=.false.")
    kept = call(base + transient(2.0 * period, period / 2000)).history["tip.v"] / static
    found = []
    for exponent in range(3, 16, 2):
        deck, period, static = cantilever(young=10.0**exponent, more="axial=.false.")
        run = deck + transient(2.0 * period, period / 2000)
        found.append(
            Case(
                "Young modulus [Pa]",
                f"1e{exponent}",
                run,
                "the same motion in its own time",
                measure=same("tip.v", kept, static),
                limit=1e-8,
            )
        )
    for slenderness in (1.0, 3.0, 1e2, 1e3, 1e4, 1e5):
        deck, period, static = cantilever(slenderness=slenderness, more="axial=.false.")
        run = deck + transient(2.0 * period, period / 2000)
        found.append(
            Case(
                "slenderness",
                f"{slenderness:g}",
                run,
                "the same motion in its own time",
                measure=same("tip.v", kept, static),
                limit=1e-8,
            )
        )
        if slenderness > 500.0:
            deck = cantilever(slenderness=slenderness)[0] + transient(2.0 * period, period / 2000)
            found.append(Case("slenderness", f"{slenderness:g}, axial", deck, "refuses with advice", 2, REFUSAL))
    for elements in (1, 2, 4, 8, 32, 128, 512):
        deck, period, static = cantilever(elements=elements, more="modes=1")
        limit = 5e-2 if elements < 2 else max(2.0 / elements**4, 1e-4)
        exact = away("tip.v", lambda t, w=2.0 * math.pi / period, s=static: SHARE * s * (1.0 - np.cos(w * t)), static)
        run = deck + transient(2.0 * period, period / 2000)
        found.append(Case("elements", str(elements), run, f"one mode within {limit:.0e} of the beam's", measure=exact, limit=limit))
        if elements > 16:
            deck = cantilever(elements=elements)[0] + transient(2.0 * period, period / 2000)
            found.append(Case("elements", f"{elements}, nodal", deck, "refuses with advice", 2, REFUSAL))
    return found


def damped(factor: str, value: str, terms: list[Term]) -> Case:
    """Return an oscillator with viscoelastic terms: within 1e-6 of the exact solution, or refused.

    It is refused where a step of 1/400 of the run is not stable and a stable one would take too many steps.
    """
    deck, t_end = oscillator(terms), 12.0
    wanted, bound = t_end / 400, oscillator_bound(terms)
    step = min(wanted, 0.02 * bound) if t_end / (0.02 * bound) < LONG else 0.5 * bound
    if t_end / step > LONG:
        return Case(factor, value, deck + transient(t_end, wanted), "refuses with advice", 2, REFUSAL)
    exact = away("disc", lambda t: oscillator_exact(terms, t), 0.2)
    return Case(factor, value, deck + transient(t_end, step), "within 1e-6 of the exact motion", measure=exact, limit=1e-6)


def damping() -> list[Case]:
    """Return GHM and Maxwell parameters from tiny to huge, alone and mixed; the oscillator's own frequency is 1 rad/s."""
    return [damped(factor, value, terms) for factor, rows in FACTORS.items() for value, terms in rows.items()]


def all_factors() -> list[Case]:
    """Return every case of one factor, those of implicit methods after the others of their factor."""
    families = (steps_at_the_limit, beams, damping, masses, spins, singular_positions, many_steps, loads, units, drives, stops)
    families += (rigid_stops, friction, long_rest)
    cases = [case for family in families for case in family()] + all_implicit(FACTORS)
    factors = list(dict.fromkeys(case.factor for case in cases))
    return sorted(cases, key=lambda case: factors.index(case.factor))
