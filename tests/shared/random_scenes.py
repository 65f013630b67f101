"""Random planar scenes with sensors of every kind, made again by their seed: chains, loops, springs, drives, GHM, modes."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass


@dataclass
class Drawn:
    """A scene without its &transient.

    Attributes:
        text: the groups
        time: the time that its slow motion takes [s]
    """

    text: str
    time: float


def material(dice: random.Random, name: str) -> str:
    """Return a material, with up to two GHM terms or Rayleigh damping or none."""
    young = 10.0 ** dice.uniform(7.5, 10.5)
    more = ""
    terms = dice.choice([0, 0, 0, 1, 2])
    if terms:
        more = " ".join(
            f"ghm_{key}=" + ",".join(f"{10.0 ** dice.uniform(low, high):.4e}" for _ in range(terms))
            for key, low, high in (("alpha", -1.5, 0.3), ("zeta", -0.3, 0.7), ("omega", 2.0, 4.0))
        )
    elif dice.random() < 0.2:
        more = f"rayleigh_mass={dice.uniform(0.1, 2.0):.4f}"
    return f"&material name='{name}' density={dice.uniform(800, 3000):.1f} young={young:.4e} {more} /\n"


def link(dice: random.Random, name: str, length: float, at: str) -> tuple[str, str, str]:
    """Return a link's groups, and the words of its first and last place."""
    if dice.random() < 0.3:
        mass = dice.uniform(0.05, 1.0)
        inertia = mass * length**2 / 10
        text = f"&body name='{name}' kind='rigid' mass={mass:.4f} inertia={inertia:.6f} com={length / 2:.4f},0.0 {at} /\n"
        return text, "point{}=0.0,0.0", f"point{{}}={length!r},0.0"
    height = length * dice.uniform(0.01, 0.05)
    option = dice.choice(["", "", "axial=.false.", "modes=2 ", "modes=3 axial=.false."])
    reference = dice.choice(["pinned", "clamped"])
    text = material(dice, f"m{name}")
    text += f"&section name='s{name}' shape='rectangle' width=0.02 height={height:.5f} /\n"
    text += f"&body name='{name}' kind='beam' length={length!r} elements={dice.choice([2, 3, 4])} material='m{name}'\n"
    text += f"  section='s{name}' reference='{reference}' {option} {at} /\n"
    if dice.random() < 0.3:
        text += f"&lump body='{name}' node=-1 mass={dice.uniform(0.01, 0.3):.4f} /\n"
    return text, "node{}=1", "node{}=-1"


def chain(dice: random.Random) -> str:
    """Return one to three links that hang from the ground, each turned against the last, some held by springs."""
    text, x, y, angle = "", 0.0, 0.0, dice.uniform(-1.5, 0.5)
    last = "point_b=0.0,0.0"
    for k in range(dice.randint(1, 3)):
        length = round(dice.uniform(0.2, 0.8), 4)
        spin = f"angular_velocity={dice.uniform(-6.0, 6.0):.3f}" if dice.random() < 0.5 else ""
        groups, first, end = link(dice, f"b{k}", length, f"position={x!r},{y!r} angle={angle!r} {spin}")
        text += groups + f"&joint name='j{k}' type='revolute' body_a='b{k}' {first.format('_a')} {last} /\n"
        if dice.random() < 0.35:
            hold = f"stiffness={10.0 ** dice.uniform(-0.5, 1.5):.4f} damping={dice.choice([0.0, 0.01]):.2f}"
            other = "" if k == 0 else f"body_b='b{k - 1}'"
            rest = f"free_angle={dice.uniform(-0.5, 0.5):.3f}"
            text += f"&spring name='t{k}' type='torsional' body_a='b{k}' {other} {hold} {rest} /\n"
        x, y = x + length * math.cos(angle), y + length * math.sin(angle)
        last = f"body_b='b{k}' {end.format('_b')}"
        angle += dice.uniform(-0.8, 0.8)
    if dice.random() < 0.4:
        stiffness, far = 10.0 ** dice.uniform(1.0, 3.0), 0.5 * dice.random()
        text += f"&spring name='l' type='linear' {last.replace('_b=', '_a=')} point_b={x + 0.3:.4f},{y + far:.4f}\n"
        text += f"  stiffness={stiffness:.3f} damping={dice.choice([0.0, 0.0, 0.5])} /\n"
    return text


def crank(dice: random.Random) -> str:
    """Return a slider-crank: a rigid crank, driven or pushed, and a link whose end slides."""
    radius, angle = round(dice.uniform(0.05, 0.2), 4), dice.uniform(0.2, 1.2)
    length = round(radius * dice.uniform(2.5, 5.0), 4)
    x, y = radius * math.cos(angle), radius * math.sin(angle)
    lean = -math.asin(y / length)
    text = f"&body name='b0' kind='rigid' mass=0.5 inertia=2.0e-3 com={radius / 2!r},0.0 angle={angle!r} /\n"
    groups, first, end = link(dice, "b1", length, f"position={x!r},{y!r} angle={lean!r}")
    text += groups + "&joint name='j0' type='revolute' body_a='b0' /\n"
    text += f"&joint name='j1' type='revolute' body_a='b1' {first.format('_a')} body_b='b0' point_b={radius!r},0.0 /\n"
    text += f"&joint name='j2' type='slider' body_a='b1' {end.format('_a')} direction=0.0 /\n"
    if dice.random() < 0.5:
        speed = dice.uniform(5.0, 40.0)
        text += f"&history name='h' kind='polynomial' coefficients={angle!r},0.0,{speed / 0.2:.4f} /\n"
        text += "&drive name='d' type='rotation' body_a='b0' history='h' /\n"
    else:
        text += f"&force name='p' type='torque' body='b0' moment={dice.uniform(1.0, 10.0):.4f} /\n"
    return text


def cantilever(dice: random.Random) -> str:
    """Return a clamped beam under a struck or swinging force, now and then beside a flywheel that nothing touches."""
    length = round(dice.uniform(0.3, 1.0), 4)
    groups = "rigid"
    while "kind='beam'" not in groups:
        groups, _, _ = link(dice, "b0", length, "")
    text = groups + "&joint name='j0' type='weld' body_a='b0' node_a=1 /\n"
    text += f"&history name='h' kind='sine' amplitude=1.0 frequency={dice.uniform(1.0, 30.0):.3f} /\n"
    text += f"&force name='p' type='force' body='b0' node=-1 fy={dice.uniform(0.01, 0.3):.4f}"
    text += dice.choice(["", " history='h'"]) + " /\n"
    if dice.random() < 0.4:
        spin = dice.uniform(20.0, 200.0)
        text += f"&body name='w' kind='rigid' mass=20.0 inertia=2.0 position=3.0,0.0 angular_velocity={spin:.2f} /\n"
        text += "&joint name='jw' type='revolute' body_a='w' point_b=3.0,0.0 /\n"
        text += "&force name='pw' type='torque' body='w' moment=5.0 /\n"
    return text


def sensors(text: str) -> str:
    """Return a sensor of each kind for every body and joint of a scene."""
    found = ""
    for k, part in enumerate(text.split("&body ")[1:]):
        name = part.split("'")[1]
        beam = "kind='beam'" in part.split("/")[0]
        place = "node=-1" if beam else "point=0.1,0.0"
        for tag, quantity in (("p", "position"), ("v", "velocity"), ("a", "acceleration")):
            found += f"&sensor name='{name}{tag}{k}' quantity='{quantity}' body='{name}' {place} /\n"
        found += f"&sensor name='{name}w{k}' quantity='angular_velocity' body='{name}' /\n"
        if beam:
            found += f"&sensor name='{name}u{k}' quantity='deflection' body='{name}' node=2 /\n"
            found += f"&sensor name='{name}i{k}' quantity='internal' body='{name}' element=1 /\n"
    for part in text.split("&joint ")[1:]:
        name = part.split("'")[1]
        found += f"&sensor name='r{name}' quantity='reaction' joint='{name}' /\n"
    return found


def scene(seed: int, number: int) -> Drawn:
    """Return one scene; the seed and its number make it again."""
    dice = random.Random(f"{seed}/{number}")
    text = dice.choice([chain, chain, crank, cantilever])(dice)
    head = f"&scene title='random {seed}/{number}' gravity=0.0,{dice.choice([0.0, -9.81, -9.81])} /\n"
    return Drawn(head + text + sensors(text), 10.0 ** dice.uniform(-1.3, 0.0))
