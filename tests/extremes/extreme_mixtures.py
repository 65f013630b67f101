"""Random mixtures: chains of rigid and flexible bodies whose parameters spread over many decades.

A mixture is built so that its motion stays within the model: loads bend each beam by a hundredth of its length at most. Its
step is a random share of the advised bound, a thousandth to a thousand times it. Stated beforehand: below the bound the run
ends, its rows are finite, the joints stay closed to 1e-9 of the size and the energy residual stays below the whole energy (below
1e-6 of it where the step is less than a twentieth of the bound); above it the run is refused with the advice. The
bound knows elasticity and damping, not the swing of a light link under a heavy one: steps below the bound also keep below a
share of that swing's time scale. Masses of neighbours differ by up to 1e9. generalized_alpha and radau run every mixture, at
the same share of the bound or of the swing, below and above the bound: joints closed, energy kept to 1e-2.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import dataclass, replace

from extreme_cases import Case, Ran, safe_bound
from extreme_measures import REFUSAL
from extreme_scenes import term_words, transient

COUNT = 200
STEPS = 400  # ten times as many where all links are rigid
SWING = 0.03  # steps are at most this share of the shortest swing, which no bound knows


@dataclass
class Link:
    """One body of a chain: its length [m], mass [kg] and the text of its groups, '{force}' not yet filled in."""

    length: float
    mass: float
    text: str
    node: str
    limit: float


def spread(dice: random.Random, low: float, high: float) -> float:
    """Return a number whose logarithm is evenly spread."""
    return 10.0 ** dice.uniform(math.log10(low), math.log10(high))


def rigid(dice: random.Random, k: int, size: float, mass: float) -> Link:
    """Return a uniform rigid rod."""
    length = size * dice.uniform(0.3, 3.0)
    text = f"&body name='b{k}' kind='rigid' mass={mass:.16e} inertia={mass * length**2 / 12:.16e} com={length / 2:.16e},0.0"
    return Link(length, mass, text, f"point={length:.16e},0.0", math.inf)


def flexible(dice: random.Random, k: int, size: float, mass: float) -> Link:
    """Return a beam with up to three GHM terms; its limit is the acceleration [m/s2] that bends it by 1 % under its own mass."""
    length, slenderness = size * dice.uniform(0.3, 3.0), spread(dice, 5.0, 1e4)
    height = length / slenderness
    density, young = mass / (height**2 * length), spread(dice, 1e3, 1e15)
    frequency = 3.5 * math.sqrt(young / density) * height / math.sqrt(12.0) / length**2
    count = dice.choice([0, 0, 1, 1, 2, 3])
    terms = [(spread(dice, 1e-6, 1e3), spread(dice, 1e-3, 1e3), frequency * spread(dice, 1e-3, 1e3)) for _ in range(count)]
    elements = dice.choice([1, 2, 3, 5, 8])
    option = dice.choice(["", "", "axial=.false.", "modes=1", "stiffening=.true."])
    text = f"""&material name='m{k}' density={density:.16e} young={young:.16e} {term_words(terms)} /
&section name='s{k}' shape='rectangle' width={height:.16e} height={height:.16e} /
&body name='b{k}' kind='beam' length={length:.16e} elements={elements} material='m{k}' section='s{k}' {option}"""
    return Link(length, mass, text, "node=-1", 0.01 * frequency**2 * length)


def chain(dice: random.Random) -> tuple[str, float, float]:
    """Return the groups of a hanging chain of one to three links, its size [m] and the time scale of its swings [s]."""
    size, mass = spread(dice, 1e-6, 1e6), spread(dice, 1e-9, 1e6)
    links = [dice.choice([rigid, flexible])(dice, k, size, mass * spread(dice, 3.2e-5, 3.2e4)) for k in range(dice.randint(1, 3))]
    total = sum(link.mass for link in links)
    most = min(link.limit * link.mass / total for link in links)
    gravity = min(most, spread(dice, 1e-9, 1e9)) * spread(dice, 1e-3, 1.0)
    text, x = f"&scene gravity={gravity * 0.6:.16e},{-gravity * 0.8:.16e} /\n", 0.0
    for k, link in enumerate(links):
        near = "node_a=1" if link.node == "node=-1" else "point_a=0.0,0.0"
        far = "" if k == 0 else f"body_b='b{k - 1}' {links[k - 1].node.replace('=', '_b=', 1)}"
        text += f"{link.text} position={x:.16e},0.0 /\n&joint name='j{k}' type='revolute' body_a='b{k}' {near} {far} /\n"
        text += f"&sensor name='b{k}' quantity='angle' body='b{k}' /\n"
        x += link.length
    end = f"&sensor name='end' quantity='position' body='b{len(links) - 1}' {links[-1].node} /\n"
    return text + end, x, swing(links, gravity)


def swing(links: list[Link], gravity: float) -> float:
    """Return the shortest time scale of a light link under the weight of those below [s]: it vibrates as a taut string."""
    hung = [sum(link.mass for link in links[k:]) for k in range(len(links))]
    return min(math.sqrt(link.mass * link.length / (30.0 * gravity * load)) for link, load in zip(links, hung))


def held(size: float, allowed: float) -> Callable[[Ran], float]:
    """Return a measure: the worst of joints and energy, each over what was stated for it."""

    def measure(ran: Ran) -> float:
        return max(float(abs(ran.energy["position_violation"]).max()) / (1e-9 * size), ran.residual / allowed)

    return measure


def mixture(seed: int, number: int) -> Case:
    """Return one random case; the seed and its number make it again."""
    deck, size, time, share, bound = drawn(seed, number)
    case = Case("mixture", f"{seed}/{number}", deck, "")
    share = share if math.isfinite(bound) else min(share, 0.04)
    step = share * bound if share > 1.0 else min(share * bound, SWING * time)
    steps = STEPS if "kind='beam'" in deck else 10 * STEPS
    deck += transient(steps * step, step, steps // 8)
    if share > 1.0:
        return replace(case, deck=deck, expected="refuses with advice", status=2, message=REFUSAL)
    told = f"at {share:.2g} of the bound: joints closed, energy kept as stated"
    return replace(case, deck=deck, expected=told, measure=held(size, 1e-6 if share < 0.05 else 1.0), limit=1.0)


def implicit_mixture(seed: int, number: int, method: str = "generalized_alpha") -> Case:
    """Return the same case run by an implicit method, whatever the bound is."""
    deck, size, time, share, bound = drawn(seed, number)
    step = min(share * bound, SWING * time)
    deck += transient(STEPS * step, step, STEPS // 8, method=method)
    told = f"at {min(share, step / bound):.2g} of rk4's bound: joints closed, energy to 1e-2"
    case = Case("mixture", f"{seed}/{number}", deck, told, measure=held(size, 1e-2), limit=1.0)
    return replace(case, method=method)


def drawn(seed: int, number: int) -> tuple[str, float, float, float, float]:
    """Return a mixture's groups, size [m], time scale of its swings [s], share of the bound that its step is, and bound [s]."""
    dice = random.Random(f"{seed}/{number}")
    deck, size, time = chain(dice)
    return deck, size, time, spread(dice, 1e-3, 1e3), safe_bound(deck)
