"""Section forces and stresses within an element: weight, inertia of the body and of its vibration, forces by equilibrium.

Closed forms of beams under their own weight, of a spinning bar and of a falling one; what elements of any kind say of a node.
"""

from __future__ import annotations

import numpy as np
import pytest
from biela.histories import read

WIDTH, HEIGHT, LENGTH, DENSITY, GRAVITY = 0.02, 0.01, 1.0, 7850.0, 9.81
LIGHT = 1e-3  # of gravity where deflections shall not count
LOAD = DENSITY * WIDTH * HEIGHT * GRAVITY * LIGHT  # weight per length then
AREA, MODULUS = WIDTH * HEIGHT, WIDTH * HEIGHT**2 / 6  # of the section
HEAD = f"""&scene gravity=0,-{GRAVITY} /
&material name='m' density={DENSITY} young=2e11 rayleigh_stiffness=2e-3 /
&section name='s' shape='rectangle' width={WIDTH} height={HEIGHT} /
"""
SUPPORTS = {
    "simple": "&joint name='a' type='revolute' body_a='r' node_a=1 /\n&joint name='b' type='slider' body_a='r' node_a=-1 /\n",
    "clamped": "&joint name='a' type='weld' body_a='r' node_a=1 /\n",
    "fixed": "&joint name='a' type='weld' body_a='r' node_a=1 /\n&joint name='b' type='weld' body_a='r' node_a=-1 point_b=1,0 /\n",
    "hinged": "&joint name='a' type='revolute' body_a='r' node_a=1 /\n",
}
LARGEST = {"simple": (1 / 8, 0.5), "clamped": (-1 / 2, 0.0), "fixed": (-1 / 12, 0.0)}  # moment over q L^2, and its place


def beam(support: str, more: str, elements: int = 1, rest: str = "") -> str:
    """Return a deck with a supported beam and its sensors."""
    deck = HEAD + f"&body name='r' kind='beam' length={LENGTH} elements={elements} material='m' section='s' {more} /\n"
    deck += SUPPORTS[support] + "".join(
        f"&sensor name='i{e + 1}' quantity='internal' body='r' element={e + 1} /\n" for e in range(elements)
    )
    return deck + "&sensor name='most' quantity='stress' body='r' /\n" + rest


def lightly(deck: str) -> str:
    """Return a deck with hardly any weight."""
    return deck.replace(f"gravity=0,-{GRAVITY}", f"gravity=0,-{LIGHT * GRAVITY!r}")


def still(run) -> dict[str, float]:
    """Return the columns of the equilibrium."""
    table = read(run.folder, "static")
    return {name: table[name][-1] for name in table.names}


KINDS = ["", "reference='clamped'", "axial=.false.", "stiffening=.true.", "flexible=.false."]


@pytest.mark.parametrize("elements", [1, 3])
@pytest.mark.parametrize("more", KINDS)
@pytest.mark.parametrize("support", ["simple", "clamped", "fixed"])
def test_beams_under_their_weight_are_exact(run_deck, support, more, elements):
    """Moments at the ends, the largest stress and its place; with one element the middle lies inside."""
    if support == "fixed" and more in ("flexible=.false.", "axial=.false."):
        pytest.skip("what redundant joints share is open")
    found = still(run_deck(lightly(beam(support, more, elements)) + "&static tolerance=1e-13 /\n"))
    share, place = LARGEST[support]
    size = abs(share) * LOAD * LENGTH**2 / MODULUS
    assert found["most.s"] == pytest.approx(size, rel=1e-5)
    assert found["most.top"] == pytest.approx(-np.sign(share) * size, rel=1e-5)
    assert found["most.bottom"] == pytest.approx(np.sign(share) * size, rel=1e-5)
    assert (found["most.element"] - 1 + found["most.along"]) / elements == pytest.approx(place, abs=1e-6)
    ends = {"simple": (0.0, 0.0), "clamped": (-0.5, 0.0), "fixed": (-1 / 12, -1 / 12)}[support]
    for column, end in (("i1.m1", ends[0]), (f"i{elements}.m2", ends[1])):
        assert found[column] == pytest.approx(end * LOAD * LENGTH**2, abs=1e-6 * LOAD)
    assert found["i1.q"] - found[f"i{elements}.q2"] == pytest.approx(-LOAD * LENGTH, rel=1e-9)


@pytest.mark.parametrize("more", [*KINDS, "modes=2 reference='clamped'"])
def test_a_hanging_bar_carries_what_is_below(run_deck, more):
    deck = beam("clamped", f"angle={-np.pi / 2!r} {more}", 2)
    found = still(run_deck(lightly(deck) + "&static tolerance=1e-13 /\n"))
    expected = LOAD * LENGTH * np.array([1.0, 0.5, 0.5, 0.0])
    np.testing.assert_allclose([found[n] for n in ("i1.n", "i1.n2", "i2.n", "i2.n2")], expected, rtol=0, atol=1e-6 * expected[0])
    assert found["most.s"] == pytest.approx(LOAD * LENGTH / AREA, rel=1e-5)


SPIN = 30.0


@pytest.mark.parametrize("more", KINDS)
def test_a_spinning_bar_is_pulled_by_its_own_mass(run_deck, more):
    """By rho A W^2 (L^2 - x^2)/2 at x, with one element: at the root, at the tip, and in stresses at a quarter of the length."""
    deck = beam("hinged", f"angular_velocity={SPIN} {more}").replace(f"gravity=0,-{GRAVITY}", "").replace("2e-3", "2e-4")
    deck += "&sensor name='at' quantity='internal' body='r' element=1 along=0.25 /\n"
    found = run_deck(deck + "&transient t_end=0.02 method='radau' tolerance=1e-8 output_step=0.02 /\n").history
    pull = DENSITY * AREA * SPIN**2 * LENGTH**2 / 2
    assert found["i1.n"][-1] == pytest.approx(pull, rel=1e-4)  # it stretches by 1e-5, and turns more slowly
    assert abs(found["i1.n2"][-1]) < 1e-9 * pull
    assert found["most.s"][-1] == pytest.approx(pull / AREA, rel=1e-4)
    assert found["at.top"][-1] == pytest.approx(15 / 16 * pull / AREA, rel=1e-4)
    assert found["at.along"][-1] == 0.25


@pytest.mark.parametrize("more", ["", "axial=.false.", "flexible=.false."])
def test_a_falling_bar_bends_most_at_a_third(run_deck, more):
    """Hinged at one end and let go level: M = (m g x/4) (1 - x/L)^2 cos of the angle, so that tall chimneys break there."""
    rest = "&sensor name='turn' quantity='angle' body='r' /\n"
    rest += "&sensor name='third' quantity='internal' body='r' element=1 along={1/3} /\n"
    found = run_deck(
        beam("hinged", more, 1, rest) + "&transient t_end=0.3 method='radau' tolerance=1e-9 output_step=0.01 /\n"
    ).history
    rows = slice(0, None) if "flexible" in more else slice(12, None)  # what the release has started has died out
    turn = found["turn"][rows]
    assert turn[-1] < -0.5
    mass = DENSITY * AREA * LENGTH
    spin2 = 3 * GRAVITY / LENGTH * np.sin(-turn)
    x = np.linspace(0.0, 1.0, 20001)[:, None]
    moment = mass * GRAVITY * LENGTH * x * (1 - x) ** 2 / 4 * np.cos(turn)
    pull = mass * (spin2 * LENGTH * (1 - x**2) / 2 + GRAVITY * np.sin(-turn) * (1 - x))
    near = 1e-7 if "flexible" in more else 2e-3
    np.testing.assert_allclose(found["i1.s"][rows], (pull / AREA + moment / MODULUS).max(axis=0), rtol=near)
    np.testing.assert_allclose(found["i1.bottom"][rows], found["i1.s"][rows], rtol=near)
    np.testing.assert_allclose(found["i1.m1"][rows], 0.0, rtol=0, atol=1e-9 * mass * GRAVITY)
    third = mass * GRAVITY * LENGTH / 27 * np.cos(turn)
    bend = (found["third.bottom"][rows] - found["third.top"][rows]) / 2 * MODULUS
    np.testing.assert_allclose(bend, third, rtol=near)
    if "flexible" in more:
        assert found["i1.along"][0] == pytest.approx(1 / 3, rel=1e-12)


SECTIONS = {
    "plain": f"shape='rectangle' width={WIDTH} height=0.02",
    "shear": "shape='rectangle' width=0.02 height=0.05 shear=.true.",
    "bonded": "layers='m','k' thickness=0.01,0.004 width=0.02",
    "bonded, shear": "layers='m','k','m' thickness=0.01,0.004,0.02 width=0.02 cores=0 shear=.true.",
    "core": "layers='k','m','k' thickness=0.004,0.008,0.002 width=0.02 base=1",
}


@pytest.mark.parametrize("more", ["", "reference='clamped'", "stiffening=.true. reference='clamped'"])
@pytest.mark.parametrize("section", SECTIONS)
def test_elements_agree_at_their_node(run_deck, section, more):
    """Swung by a turning crank, damped by mass, stiffness, GHM and Maxwell terms: nothing acts on the nodes between."""
    at = [float(0.1 * f(0.4)) for f in (np.cos, np.sin)]
    deck = (
        """&scene gravity=1.5,-9.81 /
&material name='m' density=1500.0 young=1.0e8 ghm_alpha=0.5 ghm_zeta=1.2 ghm_omega=900.0 prony_alpha=0.3 prony_tau=1e-3
  rayleigh_stiffness=1e-5 rayleigh_mass=3.0 /
&material name='k' density=2500.0 young=3.0e8 rayleigh_mass=5.0 /
"""
        + f"&section name='s' {SECTIONS[section]} /\n"
        + "&body name='c' mass=0.2 inertia=1e-3 com=0.05,0 angle=0.4 angular_velocity=40 /\n"
        + "&joint name='a' type='revolute' body_a='c' /\n"
        + f"&body name='b' kind='beam' length=0.4 elements=3 section='s' position={at[0]!r},{at[1]!r} angle=1.0 {more}"
        + ("" if "layers" in SECTIONS[section] else " material='m'")
        + " /\n&joint name='e' type='revolute' body_a='b' node_a=1 body_b='c' point_b=0.1,0 /\n"
        + "&lump body='b' node=-1 mass=0.1 inertia=1e-4 /\n&force name='f' body='b' node=-1 fx=2 fy=1 /\n"
        + "".join(f"&sensor name='i{e}' quantity='internal' body='b' element={e} /\n" for e in (1, 2, 3))
    )
    found = run_deck(deck + "&transient t_end=4e-3 method='radau' tolerance=1e-6 output_step=4e-4 /\n").history
    for e in (1, 2):
        for last, first in (("n2", "n"), ("q2", "q"), ("m2", "m1")):
            here = found[f"i{e}.{last}"]
            assert np.ptp(here) > 1e-3
            assert np.abs(here - found[f"i{e + 1}.{first}"]).max() < 1e-11 * np.abs(here).max(), (e, last)


PULL = 2.0e5


@pytest.mark.parametrize("more", ["axial=.false.", "modes=3", "modes=2 axial=.false.", "flexible=.false."])
def test_an_axial_force_is_there_without_axial_coordinates(run_deck, more):
    """2e5 N through 2e-4 m2, then with weight along, a spring and lumps between, whose forces appear where they act."""
    deck = beam("clamped", f"reference='clamped' {more}", 4).replace(f"gravity=0,-{GRAVITY}", "gravity={G},0")
    deck += f"&force name='f' body='r' node=-1 fx={PULL} /\n"
    found = still(run_deck("&parameter name='G' value=0 /\n" + deck + "&static /\n"))
    for name in [f"i{e}.{n}" for e in range(1, 5) for n in ("n", "n2")]:
        assert found[name] == pytest.approx(PULL, rel=1e-12)
    assert found["most.s"] == pytest.approx(PULL / AREA, rel=1e-12)
    deck += (
        "&lump body='r' node=3 mass=20 /\n&spring name='k' body_a='r' node_a=4 point_b=0.75,0.5 stiffness=1e4 free_length=0.4 /\n"
    )
    deck += "&spring name='l' body_a='r' node_a=2 point_b=0.75,0 stiffness=1e4 free_length=0.4 /\n"
    found = still(run_deck("&parameter name='G' value=100 /\n" + deck + "&static /\n", name="more"))
    weight = DENSITY * AREA * 0.25 * 100.0
    pulls = np.array([PULL, PULL, PULL + 2000.0, PULL + 2000.0 + 1000.0])  # of what acts at the nodes beyond each element
    expected = (pulls + weight * np.arange(1, 5))[::-1]
    np.testing.assert_allclose([found[f"i{e}.n"] for e in range(1, 5)], expected, rtol=2e-5)


def forked(more: str) -> str:
    """Return a link that springs, lumps, two loads and a controller act on, hung on a crank, under one force."""
    at = [float(0.1 * f(0.4)) for f in (np.cos, np.sin)]
    return f"""&scene gravity=2.0,-9.81 /
&material name='m' density=1500.0 young=2e11 rayleigh_stiffness=1e-7 rayleigh_mass=2.0 /
&section name='s' shape='rectangle' width=0.02 height=0.005 /
&body name='c' mass=0.5 inertia=2e-2 com=0.05,0 angle=0.4 /
&joint name='a' type='revolute' body_a='c' /
&body name='b' kind='beam' length=0.4 elements=4 material='m' section='s' position={at[0]!r},{at[1]!r} angle=0.3 {more} /
&joint name='e' type='revolute' body_a='b' node_a=1 body_b='c' point_b=0.1,0 /
&lump body='b' node=-1 mass=0.1 inertia=1e-4 /
&lump body='b' node=3 mass=0.05 /
&spring name='t' type='torsional' body_a='c' stiffness=40 damping=0.2 /
&spring name='u' type='torsional' body_a='b' node_a=1 body_b='c' stiffness=30 damping=0.1 ghm_alpha=0.5 ghm_zeta=1 ghm_omega=60 /
&spring name='k' type='linear' body_a='b' node_a=-1 point_b=0.8,0.5 stiffness=400 damping=1.0 free_length=0.2
  ghm_alpha=0.4 ghm_zeta=1 ghm_omega=50 prony_alpha=0.2 prony_tau=0.01 /
&force name='f' body='b' node=4 fx=2 fy=1 axes='body' /
&force name='g' body='b' node=2 fx=-3 fy=1 axes='section' /
&sensor name='tip' quantity='position' body='b' node=-1 /
&history name='zero' kind='polynomial' coefficients=0 /
&controller name='law' argument='tip.y' history='zero' kp=3.0 kd=0.1 /
&force name='held' body='b' node=3 fx=1.0 controller='law' /
""" + "".join(f"&sensor name='i{e}' quantity='internal' body='b' element={e} /\n" for e in (1, 2, 3, 4))


@pytest.mark.parametrize("driven", ["f", "g"])
def test_responses_have_the_axial_force_of_equilibrium(run_deck, driven):
    """About a deflected equilibrium: as a beam that hardly stretches has it."""
    rest = f"&static tolerance=1e-13 /\n&frequency_response from=0.01 to=20 points=6 input='{driven}' /\n"
    columns = [f"i{e}.{n}" for e in (1, 2, 3, 4) for n in ("n", "n2")]

    def amplitudes(more: str, name: str) -> np.ndarray:
        table = read(run_deck(forked(more) + rest, name=name).folder, "frequency_response")
        return np.array([table[f"{c}.re"] + 1j * table[f"{c}.im"] for c in columns])

    elastic, balanced = amplitudes("", "elastic"), amplitudes("axial=.false.", "balanced")
    assert np.abs(elastic[0] - elastic[-1]).max() > 1.0  # they differ along the beam
    assert np.abs(balanced - elastic).max() < 2e-3 * np.abs(elastic).max()


def test_layers_bonded_together_share_the_moment_of_their_weight(run_deck):
    """One element, simply supported: E M (z - axis)/EI at mid-span, by the transformed section."""
    modulus, height, density = np.array([2.1e11, 7e10]), np.array([4e-3, 6e-3]), np.array([7850.0, 2700.0])
    top = np.cumsum(height)
    middle = top - height / 2
    axis = (modulus * height) @ middle / (modulus @ height)
    ei = 0.02 * modulus @ (height**3 / 12 + height * (middle - axis) ** 2)
    deck = (
        f"&scene gravity=0,-{GRAVITY * LIGHT!r} /\n&material name='steel' density=7850 young=2.1e11 /\n"
        "&material name='alu' density=2700 young=7e10 /\n"
        "&section name='s' layers='steel','alu' thickness=4e-3,6e-3 width=0.02 /\n"
        "&body name='r' kind='beam' length=1 elements=1 section='s' /\n"
        + SUPPORTS["simple"]
        + "".join(f"&sensor name='l{k}' quantity='layer' body='r' element=1 layer={k} /\n" for k in (1, 2))
        + "&static tolerance=1e-13 /\n"
    )
    found = still(run_deck(deck))
    moment = 0.02 * height @ density * GRAVITY * LIGHT / 8
    for k in (1, 2):
        bottom, up = (modulus[k - 1] * moment * (axis - z) / ei for z in (top[k - 1] - height[k - 1], top[k - 1]))
        assert found[f"l{k}.bottom"] == pytest.approx(bottom, rel=1e-6)
        assert found[f"l{k}.top"] == pytest.approx(up, rel=1e-6)
        assert found[f"l{k}.s"] == pytest.approx(max(abs(bottom), abs(up)), rel=1e-6)
        assert found[f"l{k}.along"] == pytest.approx(0.5, abs=1e-6)


def test_the_error_of_a_mesh_is_that_of_the_same_part_of_the_beam(run_deck):
    """check_mesh: an element of the deck is two of the finer mesh; places in the mesh are not compared."""
    deck = HEAD.replace("2e-3", "1e-4") + "&body name='r' kind='beam' length=1 elements={n} material='m' section='s' /\n"
    deck += SUPPORTS["hinged"] + "{sensors}&sensor name='most' quantity='stress' body='r' /\n"
    deck += "&transient t_end=0.05 method='radau' tolerance=1e-7 output_step=1e-3 {more} /\n"

    def sensors(*elements: int) -> str:
        return "".join(f"&sensor name='i{e}' quantity='internal' body='r' element={e} /\n" for e in elements)

    coarse = run_deck(deck.format(n=3, sensors=sensors(2), more="check_mesh=.true."))
    fine = run_deck(deck.format(n=6, sensors=sensors(3, 4), more=""), name="fine").history
    told = coarse.figures["reduction"]["mesh_errors"]
    for column, of in (("i2.n[N]", "i3.n"), ("i2.m1[Nm]", "i3.m1"), ("i2.m2[Nm]", "i4.m2"), ("i2.q2[N]", "i4.q2")):
        name = column.partition("[")[0]
        assert told[column] == pytest.approx(4 / 3 * np.abs(coarse.history[name] - fine[of]).max(), rel=1e-3)
    largest = np.maximum(fine["i3.s"], fine["i4.s"])
    assert told["i2.s[Pa]"] == pytest.approx(4 / 3 * np.abs(coarse.history["i2.s"] - largest).max(), rel=1e-3)
    assert told["most.s[Pa]"] < 0.02 * np.ptp(coarse.history["most.s"])
    assert not [column for column in told if column.partition("[")[0].endswith((".element", ".node", ".along"))]
