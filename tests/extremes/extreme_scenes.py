"""Scenes that can be made extreme, with their exact answers."""

from __future__ import annotations

import math

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import expm

LIMIT = 2.7  # |mu h| up to which classical Runge-Kutta is surely stable along the rays met here
Term = tuple[float, ...]  # of GHM: alpha, zeta, omega [rad/s]; of Maxwell: alpha, tau [s]
FIRST = 1.8751040687119611  # first root of 1 + cos x cosh x


def transient(t_end: float, step: float, rows: int = 50, more: str = "", method: str = "rk4") -> str:
    """Return the group of a fixed-step run."""
    output = max(t_end / rows, step)
    return f"&transient t_end={t_end:.16e} method='{method}' step={step:.16e} output_step={output:.16e} {more} /\n"


def adaptive(t_end: float, tolerance: float, method: str, rows: int = 50) -> str:
    """Return the group of a run of an implicit method that chooses its own steps."""
    words = f"tolerance={tolerance} output_step={t_end / rows:.16e}"
    return f"&transient t_end={t_end:.16e} method='{method}' {words} /\n"


def term_words(terms: list[Term]) -> str:
    """Return the assignments of GHM and Maxwell terms, '' without terms."""
    kinds = {3: ("ghm_alpha", "ghm_zeta", "ghm_omega"), 2: ("prony_alpha", "prony_tau")}
    lists = [pair for size, keys in kinds.items() for pair in zip(keys, zip(*(term for term in terms if len(term) == size)))]
    return " ".join(f"{key}={','.join(f'{x:.16e}' for x in values)}" for key, values in lists)


def oscillator(terms: list[Term], stiffness: float = 1.0, inertia: float = 1.0, moment: float = 0.1) -> str:
    """Return a disc on a viscoelastic torsional spring under a moment that starts at t = 0: one degree of freedom."""
    return f"""&body name='disc' kind='rigid' mass=1.0 inertia={inertia:.16e} /
&joint name='axle' type='revolute' body_a='disc' /
&spring name='shaft' type='torsional' body_a='disc' stiffness={stiffness:.16e} {term_words(terms)} /
&force name='load' type='torque' body='disc' moment={moment:.16e} /
&sensor name='disc' quantity='angle' body='disc' /
"""


def oscillator_matrix(terms: list[Term], square: float) -> np.ndarray:
    """Return the matrix of the first-order equations of q and the internal variables (theory.md, section 5).

    Args:
        terms: GHM and Maxwell terms
        square: square of the relaxed frequency [rad2/s2]

    Returns:
        square matrix for (q, q', then z, z' of a GHM term, z of a Maxwell term)
    """
    n = 2 + sum(len(term) - 1 for term in terms)
    a = np.zeros((n, n))
    a[0, 1] = 1.0
    a[1, 0] = -square * (1.0 + sum(term[0] for term in terms))
    z = 2
    for term in terms:
        a[1, z] = square * term[0]
        if len(term) == 3:
            _, zeta, omega = term
            a[z, z + 1] = 1.0
            a[z + 1, [0, z, z + 1]] = omega**2, -(omega**2), -2.0 * zeta * omega
        else:
            a[z, [0, z]] = 1.0 / term[1], -1.0 / term[1]
        z += len(term) - 1
    return a


def oscillator_exact(terms: list[Term], times: np.ndarray, load: float = 0.1, square: float = 1.0) -> np.ndarray:
    """Return q at equally spaced times from rest under a constant load (per unit of inertia)."""
    a = oscillator_matrix(terms, square)
    n = len(a)
    grown = np.zeros((n + 1, n + 1))
    grown[:n, :n] = a
    grown[1, n] = load
    turn = expm(grown * (times[1] - times[0]))
    state = np.zeros(n + 1)
    state[n] = 1.0
    found = []
    for _ in times:
        found.append(state[0])
        state = turn @ state
    return np.array(found)


def oscillator_bound(terms: list[Term], square: float = 1.0) -> float:
    """Return the largest stable step of classical Runge-Kutta by its own stability polynomial [s]."""
    poles = np.linalg.eigvals(oscillator_matrix(terms, square))
    scale = 3.5 / np.abs(poles).max()
    for h in np.linspace(0.5, 1.0, 501) * scale:
        z = poles * h
        if np.abs(1.0 + z + z**2 / 2.0 + z**3 / 6.0 + z**4 / 24.0).max() > 1.0 + 1.0e-9:
            return float(h)
    return float(scale)


def cantilever(
    young: float = 1.0e9, slenderness: float = 50.0, length: float = 1.0, density: float = 1000.0, elements: int = 4, more: str = ""
) -> tuple[str, float, float]:
    """Return a clamped beam under a tip force, its first period [s] and its static tip deflection (one percent of the length)."""
    height = length / slenderness
    area, inertia = height * height, height**4 / 12.0
    omega = FIRST**2 * math.sqrt(young * inertia / (density * area * length**4))
    deflection = 0.01 * length
    force = 3.0 * young * inertia * deflection / length**3
    deck = f"""&material name='m' density={density:.16e} young={young:.16e} /
&section name='s' area={area:.16e} inertia={inertia:.16e} /
&body name='beam' kind='beam' length={length:.16e} elements={elements} material='m' section='s' reference='clamped' {more} /
&joint name='wall' type='weld' body_a='beam' node_a=1 /
&force name='tip' type='force' body='beam' node=-1 fy={force:.16e} /
&sensor name='tip' quantity='deflection' body='beam' node=-1 /
"""
    return deck, 2.0 * math.pi / omega, deflection


def pendulum(length: float = 1.0, gravity: float = 9.81, mass: float = 1.0, body: str = "rigid") -> tuple[str, float]:
    """Return a uniform rod let go from the horizontal, rigid or flexible, and its time scale sqrt(L/g) [s]."""
    if body == "rigid":
        rod = f"kind='rigid' mass={mass:.16e} inertia={mass * length**2 / 12:.16e} com={length / 2:.16e},0.0 /"
        groups, place = "", "point_a=0.0,0.0"
    else:
        height = length / 20.0
        young = 2.0e5 * gravity * length * mass / length**3
        groups = f"""&material name='m' density={mass / (height**2 * length):.16e} young={400 * young:.16e} /
&section name='s' shape='rectangle' width={height:.16e} height={height:.16e} /
"""
        rod = f"kind='beam' length={length:.16e} elements=2 material='m' section='s' axial=.false. /"
        place = "node_a=1"
    deck = f"""&scene gravity=0.0,{-gravity:.16e} /
{groups}&body name='rod' {rod}
&joint name='pivot' type='revolute' body_a='rod' {place} /
&sensor name='rod' quantity='angle' body='rod' /
"""
    return deck, math.sqrt(length / gravity) if gravity > 0.0 else 1.0


def pendulum_angles(links: int, straight: bool) -> list[float]:
    """Return the angles [rad] at which a chain is released: in one straight line, or bent to and fro."""
    return [0.9 if straight else -0.5 if k % 2 else 0.3 for k in range(links)]


def pendulum_chain(masses: list[float], straight: bool = False) -> str:
    """Return unit links hung one below the other under 1 m/s2 along x."""
    text, x, y = "&scene gravity=1.0,0.0 /\n", 0.0, 0.0
    for k, (mass, angle) in enumerate(zip(masses, pendulum_angles(len(masses), straight))):
        text += f"""&body name='link{k}' kind='rigid' mass={mass:.16e} inertia={mass / 12:.16e} com=0.5,0.0
  position={x:.16e},{y:.16e} angle={angle} /
&joint name='pin{k}' type='revolute' body_a='link{k}' {f"body_b='link{k - 1}' point_b=1.0,0.0" if k else ""} /
&sensor name='link{k}' quantity='angle' body='link{k}' /
"""
        x, y = x + math.cos(angle), y + math.sin(angle)
    return text


def pendulum_chain_exact(masses: list[float], times: np.ndarray, straight: bool = False) -> np.ndarray:
    """Return the angles, shape (times, links), from Lagrange's equations (angles from the x axis, gravity along x)."""
    n = len(masses)
    below = np.array([sum(masses[k + 1 :]) for k in range(n)])
    carried = np.array(masses) / 2 + below  # moment of each angle's weight over g
    coupling = np.array([[masses[max(i, j)] / 2 + below[max(i, j)] for j in range(n)] for i in range(n)])
    np.fill_diagonal(coupling, np.array(masses) / 3 + below)

    def rates(_: float, y: np.ndarray) -> np.ndarray:
        turn = y[:n, None] - y[None, :n]
        right = -coupling * np.sin(turn) @ y[n:] ** 2 - carried * np.sin(y[:n])
        return np.concatenate([y[n:], np.linalg.solve(coupling * np.cos(turn), right)])

    start = pendulum_angles(n, straight) + [0.0] * n
    return solve_ivp(rates, (0.0, times[-1]), start, "DOP853", times, rtol=1e-12, atol=1e-13).y[:n].T


def loaded_cantilever(ratio: float) -> tuple[str, float, float]:
    """Return a clamped beam, turned by 0.7 rad, with a tip mass `ratio` times its own under a sideways force at the tip.

    Its period [s] and static deflection [m] follow: Rayleigh's 33/140 of the beam's mass moves with the tip.
    """
    height, deflection = 0.02, 1e-3
    stiffness, mass = 3.0e9 * height**4 / 12, 1000.0 * height**2
    period = 2.0 * math.pi * math.sqrt((ratio + 33 / 140) * mass / stiffness)
    force = stiffness * deflection
    deck = f"""&material name='m' density=1000.0 young=1.0e9 /
&section name='s' shape='rectangle' width={height} height={height} /
&body name='beam' kind='beam' length=1.0 elements=1 material='m' section='s' axial=.false. angle=0.7 /
&lump body='beam' node=-1 mass={ratio * mass:.16e} /
&joint name='wall' type='weld' body_a='beam' node_a=1 /
&force name='tip' type='force' body='beam' node=-1 fx={-force * math.sin(0.7):.16e} fy={force * math.cos(0.7):.16e} /
&sensor name='tip' quantity='position' body='beam' node=-1 /
"""
    return deck, period, deflection


def spinning_arm(spin: float, load: float, more: str, elements: int = 4) -> str:
    """Return an arm turned at a constant rate [rad/s], pushed sideways at its tip (in its own axes)."""
    return f"""&material name='m' density=1000.0 young=1.0e9 /
&section name='s' shape='rectangle' width=0.02 height=0.02 /
&body name='arm' kind='beam' length=1.0 elements={elements} material='m' section='s' reference='clamped'
  {more} angular_velocity={spin:.16e} /
&joint name='hub' type='revolute' body_a='arm' node_a=1 /
&history name='spin' kind='polynomial' coefficients={spin:.16e} /
&drive name='motor' type='rotation' body_a='arm' history='spin' rate=.true. /
&force name='push' type='force' body='arm' node=-1 fy={load:.16e} axes='body' /
&sensor name='tip' quantity='deflection' body='arm' node=-1 /
"""


def spinning_arm_exact(spin: float, load: float, times: np.ndarray) -> np.ndarray:
    """Return the tip's deflection at equally spaced times after a sudden sideways load on the arm that spins, in balance.

    A Ritz solution with polynomials, linear about the stretched arm: bending, stretching, the centrifugal tension
    EA (cos kx / cos k - 1), k = spin / sqrt(E/rho), centrifugal and Coriolis forces in both directions.
    """
    young, inertia, line = 1.0e9 * 0.02**2, 1.0e9 * 0.02**4 / 12, 1000.0 * 0.02**2
    n, k = 10, spin / math.sqrt(1.0e9 / 1000.0)
    x, weight = np.polynomial.legendre.leggauss(40)
    x, weight = 0.5 * (x + 1.0), 0.5 * weight
    side, slope, bend = (np.array([legendre_power(i, 2, x, d) for i in range(n)]) for d in range(3))
    along, stretch = (np.array([legendre_power(i, 1, x, d) for i in range(n)]) for d in range(2))
    tension = young * (np.cos(k * x) / math.cos(k) - 1.0)
    zero = np.zeros((n, n))
    mass = line * np.block([[(along * weight) @ along.T, zero], [zero, (side * weight) @ side.T]])
    turn = 2.0 * spin * line * (along * weight) @ side.T
    coriolis = np.block([[zero, -turn], [turn.T, zero]])
    sideways = inertia * (bend * weight) @ bend.T + (slope * weight * tension) @ slope.T
    stiff = np.block([[young * (stretch * weight) @ stretch.T, zero], [zero, sideways]]) - spin**2 * mass
    tip = np.concatenate([np.zeros(n), [legendre_power(i, 2, np.ones(1), 0)[0] for i in range(n)]])
    still = np.linalg.solve(stiff, load * tip)
    matrix = np.block(
        [[np.zeros((2 * n, 2 * n)), np.eye(2 * n)], [-np.linalg.solve(mass, stiff), -np.linalg.solve(mass, coriolis)]]
    )
    step, state, found = expm(matrix * (times[1] - times[0])), np.concatenate([-still, np.zeros(2 * n)]), []
    for _ in times:
        found.append(tip @ (still + state[: 2 * n]))
        state = step @ state
    return np.array(found)


def legendre_power(order: int, power: int, x: np.ndarray, derivative: int) -> np.ndarray:
    """Return x^power times the Legendre polynomial of an order on (0, 1), or a derivative of it, at x."""
    shape = np.polynomial.Legendre.basis(order, domain=[0.0, 1.0]).convert(kind=np.polynomial.Polynomial)
    shape = shape * np.polynomial.Polynomial([0.0] * power + [1.0])
    return (shape.deriv(derivative) if derivative else shape)(x)


def parallelogram(speed: float, angle: float = math.pi / 2, gravity: float = 9.81) -> str:
    """Return a four-bar of three uniform unit links whose bars all lie on one line twice a turn, at an angle of its cranks."""
    x, y = math.cos(angle), math.sin(angle)
    rate = f"angular_velocity={speed:.16e}"
    return f"""&scene gravity=0.0,{-gravity:.16e} /
&body name='left' kind='rigid' mass=1.0 inertia={1 / 12:.16e} com=0.5,0.0 angle={angle:.16e} {rate} /
&body name='right' kind='rigid' mass=1.0 inertia={1 / 12:.16e} com=0.5,0.0 position=1.0,0.0 angle={angle:.16e} {rate} /
&body name='top' kind='rigid' mass=1.0 inertia={1 / 12:.16e} com=0.5,0.0 position={x:.16e},{y:.16e} /
&joint name='a' type='revolute' body_a='left' /
&joint name='d' type='revolute' body_a='right' point_b=1.0,0.0 /
&joint name='b' type='revolute' body_a='top' body_b='left' point_b=1.0,0.0 /
&joint name='c' type='revolute' body_a='top' point_a=1.0,0.0 body_b='right' point_b=1.0,0.0 /
&sensor name='left' quantity='angle' body='left' /
"""


def crank(angle: float, torque: float, speed: float = 0.0) -> str:
    """Return a rigid slider-crank with a crank angle, a crank torque and a crank speed at the start."""
    reach = math.sqrt(9.0 - math.sin(angle) ** 2)
    x, y = math.cos(angle), math.sin(angle)
    return f"""&body name='crank' kind='rigid' mass=1.0 inertia={1 / 12:.16e} com=0.5,0.0
  angle={angle:.16e}
  angular_velocity={speed:.16e} /
&body name='rod' kind='rigid' mass=1.0 inertia=0.75 com=1.5,0.0 position={x:.16e},{y:.16e} angle={-math.atan2(y, reach):.16e} /
&lump body='rod' point=3.0,0.0 mass=0.5 /
&joint name='main' type='revolute' body_a='crank' /
&joint name='pin' type='revolute' body_a='rod' body_b='crank' point_b=1.0,0.0 /
&joint name='guide' type='slider' body_a='rod' point_a=3.0,0.0 /
&force name='torque' type='torque' body='crank' moment={torque:.16e} /
&sensor name='crank' quantity='angle' body='crank' /
"""
