"""Random scenes with springs that turn: rigid bodies and beams, chains, lumps, GHM, dampers, spins, prestress."""

from __future__ import annotations

import numpy as np

HEAD = """&scene title='springs that turn, seed {seed}' gravity=0.0,{gravity:.4g} /
&material name='plain' density=1200.0 young={young:.4g} /
&material name='damped' density=1200.0 young={young:.4g} ghm_alpha={alpha:.3g} ghm_zeta={zeta:.3g} ghm_omega={omega:.4g} /
&section name='s' shape='rectangle' width=0.02 height=0.012 /
"""


def point(rng: np.random.Generator, body: dict, side: str) -> tuple[str, np.ndarray]:
    """Return the keys of a random point or node of a body, and where it is at the start [m]."""
    if body["kind"] == "beam":
        node = rng.integers(1, body["elements"] + 2)
        keys, x, y = f"node_{side}={node}", 0.4 * (node - 1) / body["elements"], 0.0
    else:
        x, y = rng.uniform(-0.3, 0.3, 2)
        keys = f"point_{side}={x:.4f},{y:.4f}"
    c, s = np.cos(body["angle"]), np.sin(body["angle"])
    return f"body_{side}='{body['name']}' {keys}", body["at"] + [c * x - s * y, s * x + c * y]


def beam(rng: np.random.Generator, name: str, where: str) -> tuple[str, dict]:
    """Return a beam's groups and what springs need to know of it."""
    elements = int(rng.integers(1, 4))
    rest = rng.choice(["", "axial=.false.", "reference='clamped'"]) + f" material='{rng.choice(['plain', 'damped'])}'"
    deck = f"&body name='{name}' kind='beam' length=0.4 elements={elements} section='s' {rest} {where} /\n"
    if rng.random() < 0.4:
        deck += f"&lump body='{name}' node={rng.integers(1, elements + 2)} mass={rng.uniform(0.01, 0.3):.4g} inertia=1.0e-4 /\n"
    return deck, {"name": name, "kind": "beam", "elements": elements}


def random_springs(seed: int) -> str:
    """Return a deck without a transient. Its mechanical energy can only fall."""
    rng = np.random.default_rng(seed)
    scale = 10 ** rng.uniform(5.5, 7.5)  # of the springs [N/m]
    deck = HEAD.format(
        seed=seed,
        gravity=rng.choice([0.0, -9.81]),
        young=10 ** rng.uniform(9.5, 11.0),
        alpha=10 ** rng.uniform(-1.0, 0.5),
        zeta=10 ** rng.uniform(-0.3, 0.8),
        omega=10 ** rng.uniform(3.0, 5.0),
    )
    bodies = []
    chain = rng.random() < 0.5
    for k in range(rng.integers(1, 5)):
        height, angle = (0.0, 0.0) if chain else (rng.uniform(-0.3, 0.3), rng.uniform(-3.0, 3.0))
        where = f"position={0.4 * k:.3f},{height:.3f} angle={angle:.3f}"
        if not chain or k == 0:
            where += f" angular_velocity={rng.uniform(-20.0, 20.0):.3f}"
        if rng.random() < 0.4:
            text, body = beam(rng, f"b{k}", where)
        else:
            mass = 10 ** rng.uniform(-1.0, 0.5)
            text = f"&body name='b{k}' kind='rigid' mass={mass:.4g} inertia={mass * 10 ** rng.uniform(-3.0, -1.3):.4g} "
            text += f"com={rng.uniform(-0.1, 0.2):.4f},{rng.uniform(-0.1, 0.1):.4f} {where} /\n"
            body = {"name": f"b{k}", "kind": "rigid"}
        body |= {"at": np.array([0.4 * k, height]), "angle": angle}
        deck += text
        if chain:
            start = "node_a=1" if body["kind"] == "beam" else "point_a=0.0,0.0"
            end = "point_b=0.0,0.0"
            if k > 0:
                last = "node_b=-1" if bodies[-1]["kind"] == "beam" else "point_b=0.4,0.0"
                end = f"body_b='b{k - 1}' {last}"
            deck += f"&joint name='j{k}' type='revolute' body_a='b{k}' {start} {end} /\n"
        bodies.append(body)
    for k in range(rng.integers(1, 5)):
        a, b = rng.choice(len(bodies), 2) if len(bodies) > 1 else (0, 0)
        ground = a == b or rng.random() < 0.3
        there = np.array([rng.uniform(-0.5, 2.0), rng.uniform(-0.8, 0.8)])
        other = f"point_b={there[0]:.3f},{there[1]:.3f}"
        if not ground:
            other, there = point(rng, bodies[b], "b")
        more = f" damping={scale * 10 ** rng.uniform(-5.0, -2.5):.4g}" if rng.random() < 0.4 else ""
        if rng.random() < 0.25:
            more += f" ghm_alpha={10 ** rng.uniform(-1.0, 0.5):.3g} ghm_zeta={10 ** rng.uniform(-0.3, 0.6):.3g}"
            more += f" ghm_omega={10 ** rng.uniform(3.0, 4.5):.4g}"
        kind = rng.choice(["linear", "linear", "linear", "torsional"])
        stiffness = scale * 10 ** rng.uniform(-1.0, 0.0) * (1.0 if kind == "linear" else 0.03)
        end = f"body_a='{bodies[a]['name']}'" + (" node_a=1" if bodies[a]["kind"] == "beam" else "")
        if kind == "linear":
            end, here = point(rng, bodies[a], "a")
            if rng.random() < 0.25:
                more += f" free_length={np.linalg.norm(here - there) * rng.uniform(0.97, 1.02):.5g}"
        else:
            other = ""
        if kind == "torsional" and not ground:
            other = f"body_b='{bodies[b]['name']}'"
        deck += f"&spring name='s{k}' type='{kind}' {end} {other} stiffness={stiffness:.5g}{more} /\n"
    return deck
