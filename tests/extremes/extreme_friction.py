"""Dry friction and rigid stops at the extremes: coefficients, radii, limits, no load, long rests, many joints; exact motions."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from extreme_cases import Case, Ran
from extreme_measures import residual
from extreme_scenes import adaptive, transient

G = 9.81
METHODS = {
    "dopri5": lambda end: adaptive(end, 1e-10, "dopri5"),
    "radau": lambda end: adaptive(end, 1e-10, "radau"),
    "rk4": lambda end: transient(end, end / 200),
    "generalized_alpha": lambda end: transient(end, end / 5000, method="generalized_alpha"),
}


def block(keys: str, more: str = "", speed: float = 0.0, tilt: float = 0.0) -> str:
    """Return a block of 1 kg on a rail, under weight that is tilted."""
    return (
        f"&scene gravity={G * math.sin(tilt)!r},{-G * math.cos(tilt)!r} /\n"
        f"&body name='b' mass=1.0 inertia=0.01 velocity={speed!r},0.0 /\n"
        f"&joint name='rail' type='prismatic' body_a='b' {keys} /\n&sensor name='p' quantity='position' body='b' /\n{more}"
    )


def last(column: str, exact: float, scale: float) -> Callable[[Ran], float]:
    """Return what measures how far a column ends from an exact value."""
    return lambda ran: abs(float(ran.history[column][-1]) - exact) / scale


def moved(ran: Ran) -> float:
    """Return how far a block has moved."""
    return float(np.ptp(ran.history["p.x"]))


def friction() -> list[Case]:
    """Return joints with friction: exact ways to rest, times of breakaway, and no motion at all."""
    found = []

    def add(name: str, deck: str, end: float, expected: str, measure: Callable[[Ran], float], limit: float) -> None:
        for method, group in METHODS.items():
            found.append(Case("friction of joints", name, deck + group(end), expected, measure=measure, limit=limit, method=method))

    for mu in (1e-6, 1e-3, 0.3, 1.0, 10.0):
        way = mu * G / 2  # at rest after a second
        add(f"friction {mu:g}", block(f"friction={mu}", speed=mu * G), 1.5, "comes to rest", last("p.x", way, way), 1e-6)
    for radius in (1e-6, 1e-2, 1e2):
        rate = 0.3 * radius * G
        deck = f"&scene gravity=0.0,{-G} /\n&body name='r' mass=1.0 inertia=1.0 angular_velocity={rate!r} /\n"
        deck += f"&joint name='pin' type='revolute' body_a='r' friction=0.3 pin_radius={radius} /\n"
        deck += "&sensor name='a' quantity='angle' body='r' /\n"
        add(f"pin of {radius:g} m", deck, 1.5, "comes to rest", last("a", rate / 2, rate / 2), 1e-6)
    for static in (1e-3, 1.0, 10.0):
        start, end = static * G / 20.0, static * G / 20.0 + 0.5
        way = 20.0 * (end**3 - start**3) / 6 - 10.0 * start**2 * (end - start) - 1e-3 * G * (end - start) ** 2 / 2
        pull = "&history name='h' kind='polynomial' coefficients=0.0,20.0 /\n&force name='f' body='b' fx=1.0 history='h' /\n"
        deck = block(f"friction=1e-3 friction_static={static}", pull)
        add(f"static {static:g}, kinetic 1e-3", deck, end, "breaks away on time", last("p.x", way, way), 1e-5)
    free = block("friction=0.5 friction_static=1.0", speed=1.0).replace(f"{-G}", "0.0")
    add("no reaction, no preload", free, 1.0, "slides freely", last("p.x", 1.0, 1.0), 1e-12)
    add("preload alone", block("preload=2.0", speed=2.0), 1.5, "comes to rest", last("p.x", 1.0, 1.0), 1e-9)
    for share, limit in ((1 - 1e-9, 1e-12), (1.0, 1e-12)):
        deck = block("friction=0.5", tilt=math.atan(0.5 * share))
        add(f"slope of {share!r} of the limit", deck, 10.0, "stays", moved, limit)
    deck = block("friction=0.5", tilt=math.atan(0.5 * (1 + 1e-6)))
    way = G * (math.sin(math.atan(0.5 * (1 + 1e-6))) - 0.5 * math.cos(math.atan(0.5 * (1 + 1e-6)))) * 50.0
    add("slope just above the limit", deck, 10.0, "slides", last("p.x", way, way), 1e-6)
    for links, keys, method, group in (
        (100, "friction=0.2 pin_radius=0.01", "radau", adaptive(0.005, 1e-8, "radau")),
        (30, "friction=0.2 pin_radius=0.01", "rk4", transient(0.01, 5e-5)),
        (30, "friction=2.0 pin_radius=0.01 preload=1e-3", "radau", adaptive(0.01, 1e-8, "radau")),
    ):
        name = f"{links} pins, {keys[:12]}"
        deck = chain(links, keys) + group
        found.append(Case("friction of joints", name, deck, "energies close", measure=residual, limit=1e-5, method=method))
    return found


def chain(links: int, keys: str) -> str:
    """Return equal links in a row that turn in turns: every pin slips."""
    text, x, speed = f"&scene gravity=0.0,{-G} /\n", 0.0, 0.0
    for k in range(links):
        rate = 3.0 if k % 2 else -2.0
        text += f"&body name='b{k}' mass=0.1 inertia=1e-4 com=0.05,0.0 position={x!r},0.0 "
        text += f"velocity=0.0,{speed!r} angular_velocity={rate} /\n"
        other = f"body_b='b{k - 1}' point_b=0.1,0.0" if k else ""
        text += f"&joint name='j{k}' type='revolute' body_a='b{k}' {other} {keys} /\n"
        x, speed = x + 0.1, speed + 0.1 * rate
    return text + f"&sensor name='p' quantity='position' body='b{links - 1}' /\n"


def rigid_stops() -> list[Case]:
    """Return balls on rigid stops of any restitution, and trains of bodies of any masses that meet at once."""
    found = []
    floor = "&stop name='s' type='position' body_a='b' direction={{pi/2}} lower=0.0 restitution={!r} /\n"
    for height in (1e-9, 1.0, 1e6):
        fall = math.sqrt(2 * height / G)
        for e in (0.0, 1e-9, 0.5, 0.9, 1.0 - 1e-9, 1.0):
            end = fall * (1.5 * (1 + e) / (1 - e) if e < 0.95 else 7.0)
            ball = f"&scene gravity=0.0,{-G} /\n&body name='b' mass=1.0 inertia=1.0 position=0.0,{height!r} /\n"
            ball += "&sensor name='p' quantity='position' body='b' /\n" + floor.format(e)
            exact = 0.0 if e < 0.95 else height
            expected = "comes to rest" if e < 0.95 else "comes back"
            for method, group in METHODS.items():
                if method == "generalized_alpha" and 0.0 < e < 0.95:
                    continue  # order 2: the many impacts of a chatter are late
                goal = last("p.y", exact - (G * fall**2 / 2 if e > 0.95 else 0.0), height)
                rows = ball + group(end)
                found.append(Case("rigid stops", f"{height:g} m, e={e!r}", rows, expected, measure=goal, limit=1e-5, method=method))
    for ratio in (1e-6, 1.0, 1e6):
        deck = "&body name='a' mass=1.0 inertia=0.1 velocity=1.0,0.0 /\n"
        deck += f"&body name='b' mass={ratio!r} inertia=0.1 position=1.0,0.0 /\n"
        deck += "".join(f"&joint name='{x}' type='prismatic' body_a='{x}' point_b={k}.0,0.0 /\n" for k, x in enumerate("ab"))
        deck += "&stop name='s' type='position' body_a='b' body_b='a' lower=0.5 restitution=0.75 /\n"
        deck += "&sensor name='v' quantity='velocity' body='b' /\n"
        speed = 1.75 / (1.0 + ratio)
        for method, group in METHODS.items():
            goal, rows = last("v.x", speed, speed), deck + group(1.0)
            found.append(Case("rigid stops", f"mass ratio {ratio:g}", rows, "momentum", measure=goal, limit=1e-9, method=method))
    bar = "&scene gravity=0.0,-10.0 /\n&body name='b' mass=1.0 inertia=0.5 position=0.0,0.2 /\n"
    bar += "&sensor name='p' quantity='position' body='b' /\n"
    for e in (0.0, 0.3):
        stop = f"direction={{pi/2}} lower=0.0 restitution={e} /\n"
        places = [f"point_a={k / 10 - 1.0!r},0.0" for k in range(21)]
        deck = bar + "".join(f"&stop name='s{k}' type='position' body_a='b' {at} {stop}" for k, at in enumerate(places))
        for method in ("rk4", "dopri5", "radau"):
            goal, rows = last("p.y", 0.0, 1.0), deck + METHODS[method](2.0)
            found.append(Case("rigid stops", f"21 at once, e={e}", rows, "lies flat", measure=goal, limit=1e-9, method=method))
    return found


def long_rest() -> list[Case]:
    """Return a block that sticks on a slope for a million steps."""
    deck = block("friction=0.5", tilt=0.4) + transient(1e3, 1e-3)
    return [Case("friction of joints", "rest for a million steps", deck, "stays", measure=moved, limit=0.0)]
