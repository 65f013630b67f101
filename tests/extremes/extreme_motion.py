"""Links of very different masses, spins past divergence, dead centres and change points."""

from __future__ import annotations

import math

import numpy as np
from extreme_cases import Case, Ran, safe_bound
from extreme_measures import away, opening, residual
from extreme_scenes import (
    FIRST,
    crank,
    loaded_cantilever,
    parallelogram,
    pendulum_chain,
    pendulum_chain_exact,
    spinning_arm,
    spinning_arm_exact,
    transient,
)

LONG = 200_000  # steps above which an explicit run is not asked for
SHARE = 12.0 / FIRST**4  # of a cantilever's static tip deflection that its first mode carries


def masses() -> list[Case]:
    """Return links of very different masses, hung one below the other, and a heavy mass on a light welded beam."""
    factor, found = "mass ratio of neighbours", []
    chains = {f"1e{k}": [1.0, 10.0**k] for k in range(-9, 10, 3)}
    chains |= {
        "1e9 up and down": [1.0, 1e9, 1.0],
        "1e-9 up and down": [1e9, 1.0, 1e9],
        "1e4, 1e4": [1e-4, 1.0, 1e4],
        "1e-4, 1e-4": [1e4, 1.0, 1e-4],
        "1e9, 1e9": [1.0, 1e9, 1e18],
        "1e-9, 1e-9": [1.0, 1e-9, 1e-18],
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
        deck = spinning_arm(ratio * omega, load, "stiffening=.true.", 16 if ratio > 3.0 else 8)
        t_end = 2.0 * math.pi / omega / max(ratio, 1.0)
        step = 0.5 * safe_bound(deck)
        deck = deck.replace("axes='body'", "axes='body' stage='transient'") + "&static /\n" + transient(t_end, step)
        largest = float(np.abs(spinning_arm_exact(ratio * omega, load, np.linspace(0.0, t_end, 200))).max())
        exact = away("tip.v", lambda t, r=ratio: spinning_arm_exact(r * omega, load, t), largest)
        told = "swings as a beam under its centrifugal tension"
        found.append(Case("spin / first frequency", f"{ratio:g} stiffened", deck, told, 0, "", exact, 0.02))
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
