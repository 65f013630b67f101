"""Beams, closed mechanisms and turning arms for tests of modes and responses, and their results as arrays."""

import numpy as np
from biela.histories import read

LENGTH, YOUNG, DENSITY, AREA, INERTIA = 0.8, 7.0e10, 2700.0, 3.0e-4, 2.5e-9
UNIT = np.sqrt(YOUNG * INERTIA / (DENSITY * AREA)) / LENGTH**2
GHM = {
    1: "ghm_alpha=0.5 ghm_zeta=2.0 ghm_omega=1000.0",
    2: "ghm_alpha=0.5,0.8 ghm_zeta=0.6,1.4 ghm_omega=400.0,5000.0",
    5: "ghm_alpha=0.2,0.3,0.4,0.5,0.6 ghm_zeta=1.0,2.0,0.8,3.0,1.5 ghm_omega=60.0,300.0,1500.0,8000.0,40000.0",
}
ENDS = {
    "pinned-pinned": ("pinned", "pin(1) slide(-1)"),
    "clamped-free": ("clamped", "clamp(1)"),
    "clamped-pinned": ("clamped", "clamp(1) slide(-1)"),
    "free-free": ("pinned", ""),
}
UNDAMPED, VIBRATION, FURTHER, REAL = range(4)


def beam(elements, ends="clamped-free", ghm="", rest="", modes=3, length=LENGTH):
    """Return a deck of one beam with the given supports."""
    reference, supports = ENDS[ends]
    text = f"&scene title='beam' /\n&material name='m' density={DENSITY} young={YOUNG} {ghm} /\n"
    text += f"&section name='s' area={AREA} inertia={INERTIA} /\n"
    text += f"&body name='b' kind='beam' length={length} elements={elements} material='m' section='s' reference='{reference}' /\n"
    if "clamp(1)" in supports:
        text += "&joint name='one' type='weld' body_a='b' node_a=1 /\n"
    if "pin(1)" in supports:
        text += "&joint name='one' type='revolute' body_a='b' node_a=1 /\n"
    if "slide(-1)" in supports:
        text += f"&joint name='two' type='slider' body_a='b' node_a=-1 point_b={length},0.0 /\n"
    return text + rest + f"&modal modes={modes} /\n"


class Modes:
    """The rows of modes.txt."""

    def __init__(self, run):
        self.table = read(run.folder, "modes")
        self.kind = self.table["kind"].astype(int)
        self.poles = self.table["real"] + 1j * self.table["imag"]

    def undamped(self):
        """Return the angular frequencies of the undamped modes [rad/s]."""
        return self.poles[self.kind == UNDAMPED].imag

    def damped(self):
        """Return all poles of the damped system [1/s]."""
        return self.poles[self.kind != UNDAMPED]


MATERIAL = """&material name='soft' density=1500.0 young=4.0e9 ghm_alpha=0.4,0.9 ghm_zeta=0.7,2.0 ghm_omega=800.0,6000.0 /
&material name='hard' density=2700.0 young=7.0e10 rayleigh_stiffness=3.0e-6 rayleigh_mass=2.0 /
&section name='s' shape='rectangle' width=0.02 height=0.008 /
"""
FOUR_BAR = (
    MATERIAL
    + """&body name='crank' kind='rigid' mass=0.4 inertia=1.0e-3 com=0.05,0.0 angle={angle} /
&body name='coupler' kind='beam' length=0.35 elements=2 material='soft' section='s' angle={coupler} position={x},{y} /
&body name='rocker' kind='beam' length=0.25 elements=2 material='hard' section='s' angle={rocker} position=0.3,0.0
  reference='clamped' /
&joint name='a' type='revolute' body_a='crank' /
&joint name='b' type='revolute' body_a='crank' point_a=0.1,0.0 body_b='coupler' node_b=1 /
&joint name='c' type='revolute' body_a='coupler' node_a=-1 body_b='rocker' node_b=-1 /
&joint name='d' type='revolute' body_a='rocker' node_a=1 point_b=0.3,0.0 /
"""
)
SLIDER_CRANK = (
    MATERIAL
    + """&body name='crank' kind='beam' length=0.1 elements=1 material='hard' section='s' angle={angle} reference='clamped' /
&body name='rod' kind='beam' length=0.3 elements=2 material='soft' section='s' angle={rod} position={x},{y} /
&lump body='rod' node=-1 mass=0.3 /
&joint name='a' type='revolute' body_a='crank' node_a=1 /
&joint name='b' type='revolute' body_a='crank' node_a=-1 body_b='rod' node_b=1 /
&joint name='c' type='slider' body_a='rod' node_a=-1 direction=0.0 /
"""
)
HELD = {
    "drive": "&history name='still' kind='polynomial' coefficients={angle} /\n"
    "&drive name='hold' type='rotation' body_a='crank' history='still' /\n",
    "spring": "&spring name='hold' type='torsional' body_a='crank' stiffness=40.0 damping=0.01 ghm_alpha=0.5 ghm_zeta=1.2"
    " ghm_omega=300.0 /\n",
    "free": "",
}


def closed_mechanism(kind, angle):
    """Return the deck of a four-bar or slider-crank at a crank angle, positions near the closed ones."""
    x, y = 0.1 * np.cos(angle), 0.1 * np.sin(angle)
    if kind == "slider_crank":
        return SLIDER_CRANK.format(angle=angle, x=x, y=y, rod=-np.arcsin(y / 0.3))
    reach, toward = np.hypot(0.3 - x, -y), np.arctan2(-y, 0.3 - x)
    inner = np.arccos((0.35**2 + reach**2 - 0.25**2) / (2 * 0.35 * reach))
    coupler = toward + inner
    rocker = np.arctan2(y + 0.35 * np.sin(coupler), x + 0.35 * np.cos(coupler) - 0.3)
    return FOUR_BAR.format(angle=angle, x=x, y=y, coupler=coupler, rocker=rocker)


def spinning_arm(eta, slenderness, elements=12):
    """Return the deck of a clamped arm held at a spin by a drive; slenderness is L sqrt(A/I)."""
    inertia = AREA * LENGTH**2 / slenderness**2
    spin = eta * np.sqrt(YOUNG * inertia / (DENSITY * AREA)) / LENGTH**2
    deck = beam(elements, rest="", modes=3).replace(f"inertia={INERTIA}", f"inertia={inertia:.17g}")
    deck = deck.replace("type='weld'", "type='revolute'")
    deck = deck.replace("reference='clamped' /", "reference='clamped' stiffening=.true. /")
    drive = f"&history name='w' kind='polynomial' coefficients={spin:.17g} /\n"
    drive += "&drive name='motor' type='rotation' body_a='b' history='w' rate=.true. /\n&static load_steps=4 /\n"
    return deck.replace("&modal", drive + "&modal"), np.sqrt(YOUNG * inertia / (DENSITY * AREA)) / LENGTH**2


FORCE = "&force name='tip' type='force' body='b' node=-1 fy=1.0 /\n&sensor name='tip' quantity='deflection' body='b' node=-1 /\n"
SWEEP = "&frequency_response from={start} to={stop} points={points} spacing='{spacing}' input='{source}' /\n"


def sweep(start=1.0, stop=500.0, points=40, spacing="log", source="tip"):
    """Return a &frequency_response group."""
    return SWEEP.format(start=start, stop=stop, points=points, spacing=spacing, source=source)


class Response:
    """The columns of frequency_response.txt as complex amplitudes."""

    def __init__(self, run):
        self.table = read(run.folder, "frequency_response")
        self.s = 2j * np.pi * self.table["f"]

    def __getitem__(self, name):
        """Return one sensor column, shape (points,), after checking amplitude and phase against real and imaginary part."""
        value = self.table[f"{name}.re"] + 1j * self.table[f"{name}.im"]
        np.testing.assert_allclose(self.table[f"{name}.amplitude"], np.abs(value), rtol=1e-14)
        np.testing.assert_allclose(np.exp(1j * self.table[f"{name}.phase"]) * np.abs(value), value, rtol=1e-13, atol=1e-300)
        return value


def textbook_cantilever(elements):
    """Return bending mass and stiffness of a clamped beam from the textbook's element matrices (v and rotation of each node)."""
    h = LENGTH / elements
    k = np.array(
        [
            [12, 6 * h, -12, 6 * h],
            [6 * h, 4 * h**2, -6 * h, 2 * h**2],
            [-12, -6 * h, 12, -6 * h],
            [6 * h, 2 * h**2, -6 * h, 4 * h**2],
        ]
    )
    m = np.array(
        [
            [156, 22 * h, 54, -13 * h],
            [22 * h, 4 * h**2, 13 * h, -3 * h**2],
            [54, 13 * h, 156, -22 * h],
            [-13 * h, -3 * h**2, -22 * h, 4 * h**2],
        ]
    )
    mass, stiffness = np.zeros((2, 2 * elements + 2, 2 * elements + 2))
    for e in range(elements):
        at = slice(2 * e, 2 * e + 4)
        stiffness[at, at] += YOUNG * INERTIA / h**3 * k
        mass[at, at] += DENSITY * AREA * h / 420 * m
    return mass[2:, 2:], stiffness[2:, 2:]
