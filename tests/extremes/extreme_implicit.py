"""Rows for generalized_alpha and radau: the same scenes, and those that explicit methods refuse, which they simply run.

Where a row of radau names a tolerance of 1e-6, its figure may be 1e-4: a hundred times the local error of one step. Where it names
a step, the error of a method of second order is stated: the phase of each mode is late by (omega h)^2/12 per radian. radau has to
do no worse with the same steps, and with poles of 1e7 rad/s, E = 1e15 and 512 elements at steps of the motion.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from extreme_cases import Case, safe_bound
from extreme_measures import away, largest, opening
from extreme_motion import masses, singular_positions, spins
from extreme_scales import drives, loads, units
from extreme_scenes import adaptive, cantilever, oscillator, oscillator_exact, pendulum, transient

TOLERANCE, ALLOWED = 1e-6, 1e-4
METHODS = ("generalized_alpha", "radau")
FINE = {"generalized_alpha": 1e6, "radau": 1e5}  # steps of a long run: of three stages, which are dearer, fewer
GROUP = re.compile(r"&transient.*\n")


def twin(case: Case) -> Case:
    """Return a case run by radau with a tolerance instead of a step.

    Limits on accuracy become what the tolerance allows; what holds whatever the step is (closed joints, rest) is kept.
    """
    group = GROUP.search(case.deck)[0]
    t_end = float(re.search(r"t_end=(\S+)", group)[1])
    accuracy = bool(re.search("1e-[568]|same swing", case.expected))
    return replace(
        case,
        deck=case.deck.replace(group, adaptive(t_end, TOLERANCE, "radau")),
        expected=re.sub("1e-[568]", "1e-4", case.expected),
        limit=max(ALLOWED, case.limit) if accuracy else case.limit,
        method="radau",
    )


def far_above_the_bound(method: str = METHODS[0]) -> list[Case]:
    """Return runs at a thousand times the largest stable step of rk4."""
    found = []
    for name, deck in {
        "disc": oscillator([]),
        "real GHM pole": oscillator([(0.5, 20.0, 50.0)]),
        "complex GHM pole": oscillator([(0.5, 0.3, 50.0)]),
        "Maxwell pole": oscillator([(0.5, 1e-3)]),
        "static shapes": cantilever(elements=8, more="modes=2 static_shapes=.true.")[0],
        "cantilever": cantilever(elements=8)[0],
    }.items():
        h = 1000.0 * safe_bound(deck)
        run = deck + transient(500 * h, h, 50, method=method)
        case = Case("step / advised limit", f"1000 {name}", run, "stays bounded", measure=largest, limit=0.25, method=method)
        found.append(case)
    return found


def cantilever_exact(period: float, static: float) -> Callable[[np.ndarray], np.ndarray]:
    """Return the tip's deflection after a sudden tip force: the sum over the exact modes of the beam."""
    roots = [1.8751040687119611, 4.694091132974175, 7.854757438237613] + [(k - 0.5) * math.pi for k in range(4, 40)]
    rate = 2.0 * math.pi / period * (np.array(roots) / roots[0]) ** 2
    share = 12.0 / np.array(roots) ** 4
    return lambda t: static * share @ (1.0 - np.cos(np.outer(rate, t)))


def beams(method: str = METHODS[0]) -> list[Case]:
    """Return cantilevers of every modulus, slenderness and mesh, all coordinates kept, and in static shapes, 400 steps a period.

    The first mode is late by 2e-5 of a radian per radian, the second by 8e-4, the third by 6e-3: within 1e-2 of the deflection.
    """
    scenes = {("Young modulus [Pa]", f"1e{k}"): {"young": 10.0**k} for k in range(3, 16, 2)}
    scenes |= {("slenderness", f"{s:g}"): {"slenderness": s} for s in (1.0, 3.0, 1e2, 1e3, 1e4, 1e5)}
    scenes |= {("elements", str(n)): {"elements": n} for n in (4, 8, 32, 128, 512)}
    shapes = {"more": "modes=4 static_shapes=.true."}
    scenes |= {("elements", f"{n}, static shapes"): {"elements": n, **shapes} for n in (8, 512)}
    scenes[("Young modulus [Pa]", "1e15, 512 elements")] = {"young": 1e15, "elements": 512}
    found = []
    for (factor, value), words in scenes.items():
        deck, period, static = cantilever(**words)
        exact = away("tip.v", cantilever_exact(period, static), static)
        run = deck + transient(2.0 * period, period / 400, method=method)
        found.append(Case(factor, value, run, "within 1e-2 of the beam's motion", measure=exact, limit=1e-2, method=method))
    return found


def damping(factors: dict[str, dict[str, list]]) -> list[Case]:
    """Return every parameter of viscoelastic terms with radau, none refused."""
    found = []
    for factor, rows in factors.items():
        for value, terms in rows.items():
            exact = away("disc", lambda t, terms=terms: oscillator_exact(terms, t), 0.2)
            deck = oscillator(terms) + adaptive(12.0, TOLERANCE, "radau")
            told = "within 1e-4 of the exact motion"
            found.append(Case(factor, value, deck, told, measure=exact, limit=ALLOWED, method="radau"))
    return found


def sizes(method: str = METHODS[0]) -> list[Case]:
    """Return many steps of a rigid pendulum, and a flexible one in every unit, 2000 steps a time unit."""
    deck, unit = pendulum()
    run = deck + transient(0.002 * FINE[method] * unit, 0.002 * unit, 200, method=method)
    value, told = f"{FINE[method]:.0e}, rigid".replace("+0", ""), "joints closed to 1e-12 m"
    steps = Case("steps", value, run, told, measure=opening, limit=1e-12, method=method)
    found = [steps]
    for case in units():
        group = GROUP.search(case.deck)[0]
        t_end = float(re.search(r"t_end=(\S+)", group)[1])
        run = case.deck.replace(group, transient(t_end, t_end / 6000, method=method))
        found.append(replace(case, deck=run, limit=ALLOWED, method=method))
    return found


def spinning(method: str = METHODS[0]) -> list[Case]:
    """Return the spinning arms in 2000 steps: no mode that the load excites turns by more than 0.03 rad a step."""
    found = []
    for case in spins():
        group = GROUP.search(case.deck)[0]
        t_end = float(re.search(r"t_end=(\S+)", group)[1])
        found.append(replace(case, deck=case.deck.replace(group, transient(t_end, t_end / 2000, method=method)), method=method))
    return found


def stiff() -> list[Case]:
    """Return disc and cantilever with terms whose poles lie at 1e7 rad/s, in 40 steps of radau a period of the slow motion."""
    found = []
    for name, terms in {
        "GHM, undamped": [(0.5, 1e-3, 1e7)],
        "GHM, critical": [(0.5, 1.0, 1e7)],
        "GHM, 1e4 to 1e10": [(0.5, 500.0, 1e7)],
        "Maxwell": [(0.5, 1e-7)],
        "both, and slow ones": [(0.5, 1.0, 1e7), (0.5, 1e-7), (0.5, 1.0, 1.0), (0.5, 1.0)],
    }.items():
        exact = away("disc", lambda t, terms=terms: oscillator_exact(terms, t), 0.2)
        deck = oscillator(terms) + transient(12.0, 0.15, 40, method="radau")
        told = "within 1e-5 of the exact motion"
        found.append(Case("poles of 1e7 rad/s", name, deck, told, measure=exact, limit=1e-5, method="radau"))
    return found


def all_implicit(factors: dict[str, dict[str, list]]) -> list[Case]:
    """Return every row of the implicit methods."""
    found = [*stiff(), *damping(factors)]
    found += [twin(case) for family in (masses, singular_positions, loads, drives) for case in family()]
    for m in METHODS:
        found += [*far_above_the_bound(m), *beams(m), *spinning(m), *sizes(m)]
    return found
