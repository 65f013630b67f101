"""One factor at a time: what is made extreme, and what must happen."""

from __future__ import annotations

import math

import numpy as np
from extreme_cases import Case, Ran, call, safe_bound
from extreme_measures import REFUSAL, UNSTABLE, away, opening, residual, same
from extreme_scales import drives, loads, many_steps, units
from extreme_scenes import (
    FIRST,
    cantilever,
    crank,
    loaded_cantilever,
    oscillator,
    oscillator_bound,
    oscillator_exact,
    parallelogram,
    pendulum_chain,
    pendulum_chain_exact,
    spinning_arm,
    transient,
)

LONG = 200_000  # steps above which an explicit run is not asked for
SHARE = 12.0 / FIRST**4  # of a cantilever's static tip deflection that its first mode carries
Term = tuple[float, float, float]


def steps_at_the_limit() -> list[Case]:
    """Return runs at 0.95 and 1.05 of the advised step: limited by an axial mode, a real and a complex GHM pole."""
    scenes = {
        "disc": oscillator([]),
        "real GHM pole": oscillator([(0.5, 20.0, 50.0)]),
        "complex GHM pole": oscillator([(0.5, 0.3, 50.0)]),
        "free beam": cantilever(elements=2)[0].replace("&joint name='wall' type='weld' body_a='beam' node_a=1 /\n", ""),
    }
    found = []
    for name, deck in scenes.items():
        h = safe_bound(deck)
        for share in (0.95, 1.05):
            run = transient(6000 * share * h, share * h, 100, "accept_unstable=.true.")
            if share < 1.0:
                found.append(
                    Case("step / advised limit", f"{share:g} {name}", deck + run, "stays bounded", measure=residual, limit=1.0)
                )
            else:
                told = "diverges and says so"
                found.append(Case("step / advised limit", f"{share:g} {name}", deck + run, told, 1, UNSTABLE))
            refused = deck + transient(6000 * share * h, share * h, 100)
            if share > 1.0:
                found.append(Case("step / advised limit", f"{share:g} {name}, as is", refused, "refuses with advice", 2, REFUSAL))
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
    """Return an oscillator with GHM terms: within 1e-6 of the exact solution, or refused.

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
    """Return GHM parameters from tiny to huge, alone and mixed; the oscillator's own frequency is 1 rad/s."""
    found = [damped("GHM alpha", f"1e{k}", [(10.0**k, 1.0, 3.0)]) for k in range(-6, 4)]
    found += [damped("GHM zeta", f"1e{k}", [(0.5, 10.0**k, 3.0)]) for k in range(-3, 4)]
    found += [damped("GHM omega [rad/s]", f"1e{k}", [(0.5, 1.0, 10.0**k)]) for k in range(-2, 10)]
    mixed = {
        "all small": [(1e-6, 1e-3, 1e-2)],
        "slow and fast": [(1e3, 0.7, 1e-2), (0.5, 1.0, 1e3)],
        "undamped and overdamped": [(0.5, 1e-3, 2.0), (0.5, 1e3, 2.0)],
        "tiny and huge": [(1e-6, 1.0, 1.0), (1e3, 1.0, 1.0)],
        "everything": [(1e-6, 1e3, 1e-2), (1e3, 1e-3, 1.0), (1.0, 1.0, 1e9)],
        "the same term thrice": [(0.3, 1.0, 2.0)] * 3,
    }
    return found + [damped("GHM mixed", name, terms) for name, terms in mixed.items()]


def masses() -> list[Case]:
    """Return links of very different masses, hung one below the other, and a heavy mass on a light welded beam."""
    factor, found = "mass ratio of neighbours", []
    chains = {f"1e{k}": [1.0, 10.0**k] for k in range(-9, 10, 3)}
    chains |= {
        "1e9 up and down": [1.0, 1e9, 1.0],
        "1e-9 up and down": [1e9, 1.0, 1e9],
        "1e4, 1e4": [1e-4, 1.0, 1e4],
        "1e-4, 1e-4": [1e4, 1.0, 1e-4],
        "1, 1, 1e9": [1.0, 1.0, 1e9],
        "four links": [1.0, 1e5, 1e-2, 1e5],
    }
    for name, kg in chains.items():
        t_end, step = (4.0, 1e-3) if len(kg) < 3 else (0.1, 1e-6)
        exact = away("link0", lambda t, kg=kg: pendulum_chain_exact(kg, t)[:, 0], 1.0)
        deck = pendulum_chain(kg) + transient(t_end, step)
        found.append(Case(factor, name, deck, "within 1e-6 of Lagrange's equations", measure=exact, limit=1e-6))
    for k in (3, 5, 7, 9):
        kg = [1.0, 10.0**k]
        exact = away("link0", lambda t, kg=kg: pendulum_chain_exact(kg, t, straight=True)[:, 0], 1.0)
        deck = pendulum_chain(kg, straight=True) + transient(0.4, 1e-6)
        found.append(Case(factor, f"1e{k}, straight", deck, "within 1e-6 of Lagrange's equations", measure=exact, limit=1e-6))
    for k in (3, 5, 7, 9):
        deck, period, static = loaded_cantilever(10.0**k)
        step = 0.5 * safe_bound(deck)
        t_end = min(period, LONG * step)

        def measure(ran: Ran, period: float = period, static: float = static) -> float:
            moved = math.cos(0.7) * ran.history["tip.y"] - math.sin(0.7) * ran.history["tip.x"]
            exact = static * (1.0 - np.cos(2.0 * math.pi / period * ran.history.time))
            return float(np.abs(moved - exact).max() / exact.max())

        told = "within 1e-5 of a massless beam's motion"
        found.append(Case(factor, f"beam 1, tip 1e{k}", deck + transient(t_end, step), told, measure=measure, limit=1e-5))
    return found


def spins() -> list[Case]:
    """Return arms that spin below and past the speed at which the linear strain diverges, without and with stiffening."""
    omega = FIRST**2 * math.sqrt(1.0e9 * (0.02**4 / 12) / (1000.0 * 0.02**2))
    load, found = 1.0, []
    static = load / (3.0 * 1.0e9 * 0.02**4 / 12)
    for ratio in (0.0, 0.5, 0.9, 0.99, 1.01, 1.5, 3.0, 10.0):
        square = complex(omega**2 * (1.0 - ratio**2))
        kappa = np.sqrt(square)
        t_end = 4.0 / max(omega, abs(kappa))

        def exact(t: np.ndarray, kappa: complex = kappa, square: complex = square) -> np.ndarray:
            return SHARE * static * omega**2 * ((1.0 - np.cos(kappa * t)) / square).real

        deck = spinning_arm(ratio * omega, load, "modes=1") + transient(t_end, t_end / 1000)
        measure = away("tip.v", exact, float(np.abs(exact(np.array([t_end]))).max()))
        said = "without stiffening" if ratio > 1.0 else ""
        told = "grows as the linear model must, with a warning" if ratio > 1.0 else "swings as the linear model must"
        found.append(Case("spin / first frequency", f"{ratio:g}", deck, told, 0, said, measure, 1e-3))
        if ratio > 3.0:
            continue  # two per cent of stretch: no linear material
        deck = spinning_arm(ratio * omega, load, "stiffening=.true.") + transient(2.0 * math.pi / omega, 2e-5)
        found.append(
            Case(
                "spin / first frequency",
                f"{ratio:g} stiffened",
                deck,
                "stays near its static deflection",
                measure=lambda ran: float(np.abs(ran.history["tip.v"]).max() / static),
                limit=2.5,
            )
        )
    return found


def singular_positions() -> list[Case]:
    """Return dead centres and change points, at rest and at speed."""
    factor, found = "dead centre", []
    for name, angle in (("outer", 0.0), ("inner", math.pi)):
        deck = crank(angle, 0.0) + transient(1.0, 1e-3)
        stays = away("crank", lambda t, a=angle: 0.0 * t + a, 1.0)
        found.append(Case(factor, f"{name}, at rest", deck, "stays there", measure=stays, limit=1e-12))
        deck = crank(angle, 1.0) + transient(2.0, 1e-3)
        found.append(Case(factor, f"{name}, torque", deck, "leaves it, energy kept to 1e-8", measure=residual, limit=1e-8))
        for speed in (1.0, 1e3, 1e6):
            deck = crank(angle, 0.0, speed) + transient(10.0 / speed, 1e-3 / speed)
            found.append(
                Case(factor, f"{name}, {speed:g} rad/s", deck, "passes it, energy kept to 1e-8", measure=residual, limit=1e-8)
            )
    factor = "change point"
    deck = parallelogram(1.0) + transient(4.0, 5e-4)
    found.append(Case(factor, "passed in motion", deck, "passes it, energy kept to 1e-5", measure=residual, limit=1e-5))
    deck = parallelogram(5.0, 0.0, 0.0) + transient(4.0, 5e-4)
    found.append(Case(factor, "start at speed", deck, "runs closed, names the redundant joints", 0, "redundant", opening, 1e-9))
    deck = parallelogram(0.0, 0.0, 0.0) + transient(1.0, 1e-3)
    found.append(Case(factor, "start at rest", deck, "stays there, names the redundant joints", 0, "redundant", opening, 1e-12))
    deck = parallelogram(0.0, 0.0) + transient(1.0, 1e-3)
    found.append(Case(factor, "start, gravity", deck, "runs closed, names the redundant joints", 0, "redundant", opening, 1e-9))
    return found


def all_factors() -> list[Case]:
    """Return every case of one factor."""
    families = (steps_at_the_limit, beams, damping, masses, spins, singular_positions, many_steps, loads, units, drives)
    return [case for family in families for case in family()]
