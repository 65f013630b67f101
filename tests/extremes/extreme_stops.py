"""A ball that falls onto stops from soft to hard, from far and from next to nothing; several at once; one that is only grazed."""

from __future__ import annotations

import math

import numpy as np
from extreme_cases import Case, Ran
from extreme_measures import residual
from extreme_scenes import adaptive

UP = math.pi / 2


def ball(height: float, law: str, count: int = 1) -> str:
    """Return a ball of 1 kg at a height above equal stops."""
    text = f"&scene gravity=0.0,-9.81 /\n&body name='b' kind='rigid' mass=1.0 inertia=1.0 position=0.0,{height!r} /\n"
    text += f"&joint name='guide' type='prismatic' body_a='b' direction={UP!r} /\n&sensor name='p' quantity='position' body='b' /\n"
    for k in range(count):
        text += f"&stop name='s{k}' type='position' body_a='b' direction={UP!r} lower=0.0 {law} /\n"
    return text


def duration(height: float, stiffness: float, exponent: float) -> float:
    """Return the time of two falls and of some contacts [s], with the penetration at which the stop bears the weight."""
    bearing = (9.81 / stiffness) ** (1.0 / exponent)
    return 4.0 * math.sqrt(2.0 * height / 9.81) + 20.0 * math.sqrt(bearing / (9.81 * exponent))


def stops() -> list[Case]:
    """Return balls on stops: the energy balance closes, and without damping they come back to where they fell from."""
    factor, found = "stiffness, gap of a stop", []
    laws = [(10.0**k, h, 1.5) for k in (3, 6, 9, 12) for h in (1e-9, 1e-4, 1.0)] + [(1e7, 0.01, n) for n in (1.0, 1.25, 2.0, 3.0)]
    for stiffness, height, exponent in laws:
        for method, tolerance, limit in (("dopri5", 1e-10, 1e-6), ("radau", 1e-9, 1e-5)):
            t_end = duration(height, stiffness, exponent)
            for rest in ("", " restitution=0.5", " damping=10.0"):
                deck = ball(height, f"stiffness={stiffness!r} exponent={exponent}{rest}") + adaptive(t_end, tolerance, method)
                name = f"{stiffness:.0e}, {height:.0e} m, n={exponent}{rest}"
                found.append(Case(factor, name, deck, "energies close", measure=residual, limit=limit, method=method))
    many = ball(0.1, "stiffness=1.0e6 restitution=0.7", 20) + adaptive(0.5, 1e-8, "dopri5")
    found.append(Case(factor, "20 at once", many, "energies close", measure=residual, limit=1e-6, method="dopri5"))

    def lowest(ran: Ran) -> float:
        return float(abs(np.min(ran.history["p.y"]) + 2.0 * 9.81 / 100.0))

    spring = "&spring name='k' type='linear' body_a='b' point_b=0.0,0.5 stiffness=100.0 free_length=0.5 /\n"
    for share in (1.0 - 1e-9, 1.0, 1.0 + 1e-9):
        deck = ball(0.0, "stiffness=1.0e8").replace("lower=0.0", f"lower={-2 * 9.81 / 100 * share!r}") + spring
        deck += adaptive(2 * math.pi / 10.0, 1e-10, "dopri5", rows=400)
        found.append(Case(factor, f"grazed at {share!r}", deck, "swings as if free", measure=lowest, limit=1e-5, method="dopri5"))
    return found
