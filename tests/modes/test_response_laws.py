"""Amplitudes of a frequency response against each other: kinematics of turning axes, Newton's law, laws of springs and sections.

A flexible viscoelastic arm is turned at a growing rate, a bead slides on a line that turns with the arm's middle section.
"""

from __future__ import annotations

from math import cos, sin

import numpy as np
import pytest
from biela.histories import read
from oracle_parts import shape_rows, unit_gauss

OMEGA, ALPHA, RAYLEIGH = 12.0, 90.0, 2.0e-4
GHM = {"arm": ([0.6, 0.3], [1.2, 0.7], [60.0, 300.0]), "hold": ([0.8], [0.9], [40.0])}
YOUNG, WIDTH, HEIGHT, LENGTH = 4.0e7, 0.02, 0.012, 0.2
MASS, STIFFNESS, DAMPING = 0.15, 300.0, 1.7
X, Y = 0.3 * cos(0.4), 0.3 * sin(0.4)
START = f"position={X!r},{Y!r} velocity={-OMEGA * Y!r},{OMEGA * X!r} angular_velocity={OMEGA}"
TURN = {"stiffness": 9.0, "damping": 0.03}


def terms(name: str) -> str:
    """Return the GHM words of a material or spring."""
    return " ".join(f"ghm_{key}={','.join(map(str, values))}" for key, values in zip(("alpha", "zeta", "omega"), GHM[name]))


def scene(more: str) -> str:
    """Return the deck."""
    return (
        f"""&scene gravity=0.0,-2.0 /
&material name='m' density=1100.0 young={YOUNG} rayleigh_stiffness={RAYLEIGH} {terms("arm")} /
&section name='s' shape='rectangle' width={WIDTH} height={HEIGHT} /
&body name='arm' kind='beam' length={2 * LENGTH} elements=2 material='m' section='s' reference='clamped' angle=0.4 {more} /
&body name='bead' kind='rigid' mass={MASS} inertia=1e-4 {START} /
&joint name='pin' type='revolute' body_a='arm' node_a=1 /
&joint name='rod' type='slider' body_a='bead' body_b='arm' node_b=2 /
&history name='w' kind='polynomial' coefficients={OMEGA},{ALPHA} /
&drive name='motor' type='rotation' body_a='arm' history='w' rate=.true. /
&spring name='hold' type='linear' body_a='bead' body_b='arm' node_b=2 stiffness={STIFFNESS} damping={DAMPING} free_length=0.1
  {terms("hold")} /
&spring name='turn' type='torsional' body_a='bead' body_b='arm' node_b=3 stiffness={TURN["stiffness"]} damping={TURN["damping"]}
  free_angle=0.0 /
&force name='f' type='force' body='bead' fx=0.8 fy=-0.6 /
"""
        + "".join(
            f"&sensor name='{name}_{q[0]}' quantity='{q}' {place} /\n"
            for name, place in {"bead": "body='bead'", "mid": "body='arm' node=2", "tip": "body='arm' node=3"}.items()
            for q in ("position", "velocity", "acceleration")
        )
        + """&sensor name='bead_turn' quantity='angle' body='bead' /
&sensor name='tip_turn' quantity='angle' body='arm' node=3 /
&sensor name='tip_rate' quantity='angular_velocity' body='arm' node=3 /
&sensor name='tip_jerk' quantity='angular_acceleration' body='arm' node=3 /
&sensor name='gap' quantity='distance' body='bead' body_b='arm' node_b=2 /
&sensor name='seen' quantity='velocity' body='bead' body_b='arm' node_b=3 /
&sensor name='gained' quantity='acceleration' body='bead' body_b='arm' node_b=3 /
&sensor name='d2' quantity='deflection' body='arm' node=2 /
&sensor name='d3' quantity='deflection' body='arm' node=3 /
&sensor name='rod' quantity='reaction' joint='rod' /
&sensor name='hold' quantity='spring' spring='hold' /
&sensor name='turn' quantity='spring' spring='turn' /
&controller name='law' argument='d3.v' history='w' kp=2.0 kd=0.1 /
&sensor name='law' quantity='controller' controller='law' /
&controller name='loop' argument='tip_v.y' history='w' kp=0.4 /
&force name='loop' type='force' body='bead' fx=0.5 fy=1.0 controller='loop' /
&sensor name='loop' quantity='controller' controller='loop' /
&sensor name='in' quantity='internal' body='arm' element=2 /
&frequency_response from=0.5 to=60.0 points=9 input='f' /
&transient t_end=1e-6 method='rk4' step=1e-6 /
"""
    )


class Response:
    """Amplitudes by column, and the state about which they are: the first row of a transient."""

    def __init__(self, run):
        found = read(run.folder, "frequency_response")
        self.s = 2j * np.pi * found.time
        self.found = found
        self.state = run.history

    def __call__(self, *names: str) -> np.ndarray:
        """Return complex amplitudes, shape (names, frequencies)."""
        return np.array([self.found[f"{n}.re"] + 1j * self.found[f"{n}.im"] for n in names])

    def now(self, *names: str) -> np.ndarray:
        """Return values of the present state."""
        return np.array([self.state[n][0] for n in names])


@pytest.fixture(params=["", "stiffening=.true.", "axial=.false.", "modes=4"])
def response(request, run_deck):
    """Return the response of one kind of arm."""
    found = Response(run_deck(scene(request.param)))
    found.stiffening = "stiffening" in request.param
    return found


def same(found: np.ndarray, expected: np.ndarray, share: float = 1e-8) -> None:
    """Assert equality to a share of the expected values' largest."""
    np.testing.assert_allclose(found, expected, rtol=0, atol=share * np.abs(expected).max())


def ratio(name: str, s: np.ndarray) -> np.ndarray:
    """Return E(s)/E_R."""
    return 1 + sum(a * (s**2 + 2 * z * w * s) / (s**2 + 2 * z * w * s + w**2) for a, z, w in zip(*GHM[name]))


def test_rates_contain_the_turn_of_the_axes(response):
    """What is w exp(s t) in axes that turn has the rates w' + W H w and w'' + 2 W H w' + W' H w - W^2 w."""
    s, turned = response.s, np.array([[0.0, -1.0], [1.0, 0.0]])
    for name in ("mid", "tip"):
        w = response(f"{name}_p.x", f"{name}_p.y")
        same(response(f"{name}_v.x", f"{name}_v.y"), s * w + OMEGA * turned @ w)
        expected = s**2 * w + (2 * s * OMEGA + ALPHA) * (turned @ w) - OMEGA**2 * w
        same(response(f"{name}_a.x", f"{name}_a.y"), expected)
    same(response("tip_rate"), s * response("tip_turn"))
    same(response("tip_jerk"), s**2 * response("tip_turn"))


def test_the_beads_reaction_is_newtons(response):
    """The line's force turns with the section: its change of direction belongs to the amplitude."""
    spring = response("hold.f")
    gap0 = response.now("bead_p.x", "bead_p.y") - response.now("mid_p.x", "mid_p.y")
    length = np.hypot(*gap0)
    e = gap0 / length
    gap = response("bead_p.x", "bead_p.y") - response("mid_p.x", "mid_p.y")
    same(response("hold.d")[0], e @ gap)
    same(response("gap"), response("hold.d"))
    for seen, rate in (("seen", "v"), ("gained", "a")):
        names = [f"{name}_{rate}.{axis}" for name in ("bead", "tip") for axis in "xy"]
        same(response(f"{seen}.x", f"{seen}.y"), response(*names[:2]) - response(*names[2:]))
    across = (gap - np.outer(e, e @ gap)) / length
    pull = np.outer(e, spring) + response.now("hold.f") * across
    push = np.array([[0.8], [-0.6]]) - np.outer([0.5, 1.0], 0.4 * response("tip_v.y")[0])  # by the closed loop
    balance = MASS * response("bead_a.x", "bead_a.y") - push + pull
    assert np.abs(response.now("rod.fx", "rod.fy")).max() > 0.1
    same(response("rod.fx", "rod.fy"), balance, 1e-7)


def test_springs_and_controllers_answer_with_their_laws(response):
    s = response.s
    same(response("hold.f"), (STIFFNESS * ratio("hold", s) + s * DAMPING) * response("hold.d"))
    same(response("turn.f"), (TURN["stiffness"] + s * TURN["damping"]) * response("turn.d"))
    same(response("turn.d"), response("bead_turn") - response("tip_turn"))
    same(response("law.out"), -(2.0 + 0.1 * s) * response("d3.v"))
    same(response("loop.out"), -0.4 * response("tip_v.y"))


def test_sections_answer_with_the_complex_modulus(response):
    """N, Q and M of element 2 from the deflections of its ends and the inertia of its field; the stress is the largest in it."""
    s = response.s
    u2, v2, r2, u3, v3, r3 = response("d2.u", "d2.v", "d2.r", "d3.u", "d3.v", "d3.r")
    chord = (v3 - v2) / LENGTH
    p1, p2 = r2 - chord, r3 - chord
    modulus = ratio("arm", s)
    area, second = WIDTH * HEIGHT, WIDTH * HEIGHT**3 / 12
    bending = (modulus + s * RAYLEIGH) * YOUNG * second / LENGTH
    moments = [bending * (4 * p1 + 2 * p2), bending * (2 * p1 + 4 * p2)]
    mean = (modulus + s * RAYLEIGH) * YOUNG * area / LENGTH * (u3 - u2)
    points, weights = unit_gauss()
    shapes = np.array([shape_rows(x, LENGTH) for x in points])  # (points, along and across, 6)
    w = np.einsum("pci,is->pcs", shapes, np.array([u2, v2, r2, u3, v3, r3]))
    turned = np.stack([-w[:, 1], w[:, 0]], axis=1)
    load = -1100.0 * area * ((s**2 - OMEGA**2) * w + (2 * s * OMEGA + ALPHA) * turned)  # the frame's turn is prescribed
    nodal = LENGTH * np.einsum("p,pci,pcs->is", weights, shapes, load)
    n, q, m1, m2, n2, q2 = response("in.n", "in.q", "in.m1", "in.m2", "in.n2", "in.q2")
    if np.abs(u3).max() > 0:
        same(n, mean + nodal[0], 1e-6)
        np.testing.assert_allclose(n2, mean - nodal[3], rtol=0, atol=1e-6 * np.abs(n).max())
    else:  # by equilibrium: nothing acts at the tip
        same(n, LENGTH * weights @ load[:, 0], 1e-6)
        assert np.abs(n2).max() < 1e-12 * np.abs(n).max()
    across = -(moments[0] + moments[1]) / LENGTH
    same(m1, -moments[0] + nodal[2], 1e-6)
    same(m2, moments[1] - nodal[5], 1e-6)
    lean = response.now("in.n", "in.n2")[:, None] * (r2, r3) * response.stiffening  # N acts along the deflected axis
    same(q, across + nodal[1] - lean[0], 1e-6)
    np.testing.assert_allclose(q2, across - nodal[4] - lean[1], rtol=0, atol=1e-6 * np.abs(q).max())
    xi = np.linspace(0.0, 1.0, 4001)
    spread = np.linalg.solve(np.vander(points[:4], 4, increasing=True), load[:4].reshape(4, -1)).reshape(4, 2, -1)
    along = n - LENGTH * np.einsum("kx,ks->xs", [xi ** (k + 1) / (k + 1) for k in range(4)], spread[:, 0])
    bend = m1 - LENGTH * np.outer(xi, q + lean[0])
    bend = bend + LENGTH**2 * np.einsum("kx,ks->xs", [xi ** (k + 2) / (k + 1) / (k + 2) for k in range(4)], spread[:, 1])
    fibres = np.abs([along / area + sign * bend * HEIGHT / 2 / second for sign in (-1, 1)])
    same(np.abs(response("in.s")[0]), fibres.max(axis=(0, 1)), 1e-6)
    same(np.maximum(*np.abs(response("in.top", "in.bottom"))), fibres.max(axis=(0, 1)), 1e-6)


def cantilever(factor: float, more: str, sweep: str, elements: str = "2 element_material='slow','fast'") -> str:
    """Return a clamped beam of two materials under a tip force times a factor."""
    return f"""&material name='slow' density=1200.0 young=1.0e8 ghm_alpha=1.5 ghm_zeta=1.2 ghm_omega=60.0 /
&material name='fast' density=1200.0 young=1.0e8 ghm_alpha=0.4,0.3 ghm_zeta=0.8,2.0 ghm_omega=900.0,200.0 /
&section name='s' shape='rectangle' width={WIDTH} height={HEIGHT} /
&body name='b' kind='beam' length={2 * LENGTH} elements={elements} material='slow' section='s' reference='clamped' {more} /
&joint name='o' type='weld' body_a='b' node_a=1 /
&force name='f' type='force' body='b' node=-1 fx={40.0 * factor!r} fy={0.6 * factor!r} /
&sensor name='e1' quantity='internal' body='b' element=1 /
&sensor name='e2' quantity='internal' body='b' element=2 /
&sensor name='o' quantity='reaction' joint='o' /
&static tolerance=1e-12 /
{sweep}"""


@pytest.mark.parametrize("stiffening", [".true.", ".false."])
def test_slow_forces_change_the_sections_as_the_statics_do(stiffening, run_deck):
    """With stiffening the strain is quadratic: amplitudes about a deflected state against differences of equilibria."""
    more = f"stiffening={stiffening}"
    near, step = [], 1e-3
    for factor in (1.0 - step, 1.0 + step):
        run = run_deck(cantilever(factor, more, ""), name=f"f{factor}")
        near.append(read(run.folder, "static"))
    found = read(
        run_deck(cantilever(1.0, more, "&frequency_response from=1e-5 to=2e-5 points=2 input='f' /\n")).folder,
        "frequency_response",
    )
    for name in ("e1.n", "e1.q", "e1.m1", "e1.m2", "e2.n", "e2.m1", "o.fx", "o.fy", "o.m"):
        slope = (near[1][name][-1] - near[0][name][-1]) / (2 * step)
        assert found[f"{name}.re"][0] == pytest.approx(slope, rel=1e-5, abs=1e-5), name
    linear = read(run_deck(cantilever(1.0, "", "", "2"), name="linear").folder, "static")
    change = abs(linear["e1.m1"][-1] - near[0]["e1.m1"][-1]) / abs(linear["e1.m1"][-1])
    assert (change > 0.05) == (stiffening == ".true.")  # the deflection does matter


def test_slow_forces_strain_layers_as_the_statics_do(run_deck):
    """A clamped beam with a core: stresses of a face and of the core, and the core's angle at the tip."""
    deck = f"""&material name='face' density=7800.0 young=2.1e11 /
&material name='tape' density=1000.0 shear_modulus=4e5 poisson=0.49 {terms("arm")} /
&section name='s' layers='face','tape','face' thickness=2e-3,0.5e-3,1e-3 width=0.02 /
&body name='b' kind='beam' length=0.25 elements=4 section='s' reference='clamped' slip_held=1 /
&joint name='o' type='weld' body_a='b' node_a=1 /
&force name='f' type='force' body='b' node=-1 fx=3.0 fy=2.0 /
&sensor name='face' quantity='layer' body='b' element=2 layer=3 /
&sensor name='core' quantity='layer' body='b' element=2 layer=2 /
&sensor name='tip' quantity='slip' body='b' node=-1 /
&sensor name='end' quantity='deflection' body='b' node=-1 /
&static tolerance=1e-12 /
"""
    folder = run_deck(deck + "&frequency_response from=1e-5 to=2e-5 points=2 input='f' /\n").folder
    found, still = read(folder, "frequency_response"), read(folder, "static")
    for name in ("face.s", "core.s", "core.tau", "tip.g1", "end.v"):
        assert found[f"{name}.amplitude"][0] == pytest.approx(abs(still[name][-1]), rel=1e-6), name
    assert found["tip.g1.re"][0] == pytest.approx(still["tip.g1"][-1], rel=1e-6)


@pytest.mark.parametrize("speed", [0.0, 1.0])
def test_friction_holds_or_slides_in_a_response(run_deck, speed):
    """A block on a line: at rest its friction takes the force; sliding, m x'' is the force."""
    deck = f"""&scene gravity=0,-9.81 /
&body name='b' mass=2 inertia=1 velocity={speed},0 /
&joint name='j' type='prismatic' body_a='b' direction=0 friction=0.3 /
&force name='f' type='force' body='b' fx=0.5 fy=0.2 /
&sensor name='r' quantity='friction' joint='j' /
&frequency_response from=1 to=3 points=3 input='f' friction='held' /
"""
    found = read(run_deck(deck).folder, "frequency_response")
    force, rate = (found[f"r.{x}.re"] + 1j * found[f"r.{x}.im"] for x in ("f", "rate"))
    np.testing.assert_allclose(force, 0 * force - (0.5 if speed == 0 else 0), atol=1e-15)
    np.testing.assert_allclose(rate, 0 * rate if speed == 0 else 0.5 / (2 * 2j * np.pi * found.time), atol=1e-12)


def test_each_element_of_a_modal_body_answers_with_its_own_modulus(run_deck):
    """With all modes kept a body of two viscoelastic materials is the nodal one; slow axial forces are those of the tip.

    The outer elements have one material, but internal variables of their own.
    """
    sweep = "&frequency_response from=1.0 to=300.0 points=9 input='f' /\n"
    nodal, modal = (
        read(
            run_deck(cantilever(1.0, f"modes={n}", sweep, "3 element_material='slow','fast','slow'"), name=f"modes{n}").folder,
            "frequency_response",
        )
        for n in (0, 9)
    )
    for name in (f"e{k}.{part}" for k in (1, 2) for part in ("n", "q", "m1", "m2", "s")):
        a, b = (h[f"{name}.re"] + 1j * h[f"{name}.im"] for h in (modal, nodal))
        same(np.abs(a) if name.endswith("s") else a, np.abs(b) if name.endswith("s") else b, 1e-7)
        assert not name.endswith("n") or b[0] == pytest.approx(40.0, rel=1e-3), name


@pytest.mark.parametrize("ends", ["body_a='bob' body_b='post'", "body_a='post' body_b='bob'"])
def test_reactions_of_a_loaded_link_are_newtons(run_deck, ends):
    """A bob hangs on a link, which turns with it under its weight: m x'' is the force and the reaction."""
    run = run_deck(
        f"""&scene gravity=0.0,-9.81 /
&body name='post' mass=1.0 inertia=0.1 /
&joint name='fixed' type='weld' body_a='post' /
&body name='bob' mass=2.0 inertia=0.1 position=0.0,-1.0 /
&joint name='link' type='distance' {ends} length=1.0 /
&spring name='t' type='torsional' body_a='bob' stiffness=3.0 /
&force name='f' type='force' body='bob' fx=1.0 /
&sensor name='x' quantity='position' body='bob' /
&sensor name='r' quantity='reaction' joint='link' /
&frequency_response from=0.1 to=2.0 points=5 input='f' /
"""
    )
    h = read(run.folder, "frequency_response")
    x, force = h["x.x.re"] + 1j * h["x.x.im"], h["r.fx.re"] + 1j * h["r.fx.im"]
    on_bob = force if ends.startswith("body_a='bob'") else -force
    np.testing.assert_allclose(1 + on_bob, -2.0 * (2 * np.pi * h.time) ** 2 * x, rtol=1e-9)


def test_an_input_of_the_transient_alone_is_no_constant_load(run_deck):
    """A free body answers a force off its centre by its masses; a constant force would turn it. One that acts is told."""
    deck = """&body name='b' mass=2 inertia=.1 /
&sensor name='p' quantity='position' body='b' point=0.3,0.4 /
&force name='in' type='force' body='b' point=0.3,0.4 fx=30{} /
&frequency_response from=0.1 to=10 points=3 input='in' /
"""
    run = run_deck(deck.format(" stage='transient'"))
    h = read(run.folder, "frequency_response")
    exact = -30 * (1 / 2 + 0.4**2 / 0.1) / (2 * np.pi * h.time) ** 2
    np.testing.assert_allclose(h["p.x.re"], exact, rtol=1e-12)
    assert not run.stderr
    assert "is no equilibrium" in run_deck(deck.format(""), name="acts").stderr
