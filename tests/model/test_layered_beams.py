"""Beams of layers and beams that shear against closed forms: frequencies, loss factors, static deflections, section forces.

The matrices themselves are held by the independent model (`test_accelerations.py`, `test_linearisation.py`); here is what they
converge to, and how fast.
"""

import json
import re

import numpy as np
import pytest
from biela.histories import read
from scipy.linalg import expm
from scipy.optimize import brentq

STEEL = "&material name='steel' density=7850.0 young=2.1e11 /\n"
GHM = "ghm_alpha=1.5 ghm_zeta=1.0 ghm_omega=1500.0"


def ratio(s):
    """Return E(s)/E_R of GHM."""
    return 1 + 1.5 * (s**2 + 3000.0 * s) / (s**2 + 3000.0 * s + 1500.0**2)


@pytest.fixture
def poles(run_deck):
    """Return a function that gives the damped poles of a deck's first modes, undamped ones where it has no terms [rad/s]."""

    def of(deck, count):
        table = read(run_deck(deck + f"&modal modes={count} /\n").folder, "modes")
        kind = np.asarray(table["kind"])
        chosen = kind == (1 if np.any(kind == 1) else 0)
        return (np.asarray(table["real"]) + 1j * np.asarray(table["imag"]))[chosen]

    return of


def timoshenko(n, length, ei, mass, turning, shear):
    """Return the n-th bending frequency of a simply supported Timoshenko beam [rad/s], by the quadratic of omega squared."""
    k = n * np.pi / length
    a, b, c = mass * turning / shear, -(mass + turning * k**2 + mass * ei * k**2 / shear), ei * k**4
    return np.sqrt((-b - np.sqrt(b**2 - 4 * a * c)) / (2 * a))


@pytest.mark.parametrize(("height", "published"), [(0.1, (3.11568, 6.09066, 8.84052)), (0.2, (3.04533, 5.67155, 7.83952))])
def test_a_beam_that_shears_converges_to_timoshenko(poles, height, published):
    """Lee & Schultz (J. Sound Vib. 269, 2004); order 2."""
    exact = [
        timoshenko(n, 1.0, 2.1e11 * height**3 / 12, 7850 * height, 7850 * height**3 / 12, 5 / 6 * 2.1e11 / 2.6 * height)
        for n in (1, 2, 3)
    ]
    unit = np.sqrt(2.1e11 * height**2 / 12 / 7850)
    np.testing.assert_allclose(np.sqrt(np.array(exact) / unit), published, rtol=2e-6)
    errors = []
    for elements in (20, 40):
        found = poles(
            STEEL + f"&section name='s' shape='rectangle' width=1.0 height={height} shear=.true. shear_factor={{5/6}} /\n"
            f"&body name='b' kind='beam' length=1.0 elements={elements} material='steel' section='s' axial=.false. /\n"
            "&joint name='a' type='revolute' body_a='b' node_a=1 /\n"
            "&joint name='c' type='slider' body_a='b' node_a=-1 /\n",
            3,
        ).imag
        errors.append(found / exact - 1)
    assert np.all(np.abs(errors[1]) < 3e-3)
    order = np.log2(errors[0] / errors[1])
    assert np.all(np.abs(order - 2) < 0.05), order


def cantilever(omega, length, ei, mass, turning, shear):
    """Return what is zero at the frequencies of a Timoshenko cantilever: v' = r + Q/S, r' = M/EI, both loads zero at the tip."""
    field = np.array([[0, 1, 0, 1 / shear], [0, 0, 1 / ei, 0], [0, -turning * omega**2, 0, -1], [-mass * omega**2, 0, 0, 0]])
    return np.linalg.det(expm(field * length)[2:, 2:])


@pytest.mark.parametrize(("height", "known"), [(0.1, (1.86771, 4.57241, 7.41542)), (0.2, (1.84656, 4.28529, 6.61128))])
def test_a_cantilever_that_shears_converges_to_timoshenko(poles, height, known):
    """Frequencies of three modes; the roots of the field equations are sought near known digits. Order 2."""
    beam = (1.0, 2.1e11 * height**3 / 12, 7850 * height, 7850 * height**3 / 12, 5 / 6 * 2.1e11 / 2.6 * height)
    unit = np.sqrt(2.1e11 * height**2 / 12 / 7850)
    near = np.array(known) ** 2 * unit
    exact = np.array([brentq(cantilever, 0.999 * x, 1.001 * x, beam, xtol=1e-9 * x) for x in near])
    np.testing.assert_allclose(exact, near, rtol=5e-6)
    errors = []
    for elements in (20, 40):
        found = poles(
            STEEL + f"&section name='s' layers='steel' thickness={height} width=1.0 shear=.true. shear_factor={{5/6}} /\n"
            f"&body name='b' kind='beam' length=1.0 elements={elements} section='s' axial=.false. reference='clamped' /\n"
            "&joint name='a' type='weld' body_a='b' node_a=1 /\n",
            3,
        ).imag
        errors.append(found / exact - 1)
    assert np.all(np.abs(errors[1]) < (3e-5, 6e-4, 2e-3))
    order = np.log2(errors[0] / errors[1])
    assert np.all(np.abs(order - 2) < 0.05), order


@pytest.mark.parametrize(
    "section", ["shape='rectangle' width=0.02 height=0.1", "shape='circle' diameter=0.1", "shape='tube' outer=0.1 inner=0.08"]
)
@pytest.mark.parametrize("elements", [1, 3])
def test_static_deflection_of_a_short_beam_is_exact(run_deck, section, elements):
    """F L^3/3EI + F L/kGA at the tip whatever the mesh, k by Cowper; moments and shear force from equilibrium."""
    nu, m = 0.25, 0.8 if "tube" in section else 0.0
    factor = 10 * (1 + nu) / (12 + 11 * nu)
    area, second = 0.002, 0.02 * 0.1**3 / 12
    if "rectangle" not in section:
        area, second = np.pi / 4 * 0.1**2 * (1 - m**2), np.pi / 64 * 0.1**4 * (1 - m**4)
        factor = 6 * (1 + nu) * (1 + m**2) ** 2 / ((7 + 6 * nu) * (1 + m**2) ** 2 + (20 + 12 * nu) * m**2)
    run = run_deck(
        "&material name='steel' density=7850.0 young=2.1e11 poisson=0.25 /\n"
        f"&section name='s' {section} shear=.true. /\n"
        f"&body name='b' kind='beam' length=0.3 elements={elements} material='steel' section='s' reference='clamped' /\n"
        "&joint name='w' type='weld' body_a='b' node_a=1 /\n"
        "&force name='f' type='force' body='b' node=-1 fy=100.0 /\n"
        "&sensor name='tip' quantity='deflection' body='b' node=-1 /\n"
        "&sensor name='in' quantity='internal' body='b' element=1 /\n&static /\n"
    )
    last = {name: np.asarray(column)[-1] for name, column in read_static(run).items()}
    flexible = 100 * 0.3**3 / (3 * 2.1e11 * second) + 100 * 0.3 / (factor * 2.1e11 / 2.5 * area)
    assert last["tip.v"] == pytest.approx(flexible, rel=1e-9)
    assert last["tip.r"] == pytest.approx(100 * 0.3**2 / (2 * 2.1e11 * second), rel=1e-9)
    assert last["in.m1"] == pytest.approx(30.0, rel=1e-9)
    assert last["in.q"] == pytest.approx(100.0, rel=1e-9)


def read_static(run):
    """Return the columns of the equilibrium."""
    table = read(run.folder, "static")
    return {name: table[name] for name in table.names}


@pytest.mark.parametrize(("thick", "soft", "published"), [(1.0, 0.01, 0.113039), (3.0, 0.01, 0.607575), (2.0, 0.1, 0.700855)])
def test_a_free_layer_damps_as_oberst_says(poles, thick, soft, published):
    """Eta of two bonded layers over that of the upper one (Oberst & Frankenfeld, Acustica 2, 1952), by the modulus at the pole."""
    deck = STEEL + (
        f"&material name='layer' density=1000.0 young={soft * 2.1e11} prony_alpha=1.0 prony_tau=1.0 /\n"
        f"&section name='s' layers='steel','layer' thickness=3e-3,{thick * 3e-3} width=0.02 /\n"
        "&body name='b' kind='beam' length=0.3 elements=16 section='s' /\n"
        "&joint name='a' type='revolute' body_a='b' node_a=1 /\n&joint name='c' type='slider' body_a='b' node_a=-1 /\n"
    )

    def bending(e2):
        h1, h2 = 3e-3, thick * 3e-3
        z = e2 * h2 * (h1 + h2) / 2 / (2.1e11 * h1 + e2 * h2)
        return 2.1e11 * (h1**3 / 12 + h1 * z**2) + e2 * (h2**3 / 12 + h2 * ((h1 + h2) / 2 - z) ** 2)

    loss = bending(soft * 2.1e11 * (1 + 0.5j))
    assert loss.imag / loss.real / 0.5 == pytest.approx(published, rel=2e-6)
    (found,) = poles(deck, 1)
    # fixed point s^2 (mass + rotary inertia k^2) + B(E(s)) k^4 = 0; Z of the upper layer is in both inertias
    k = np.pi / 0.3
    h1, h2 = 3e-3, thick * 3e-3
    mass = 7850 * h1 + 1000 * h2
    s = found
    for _ in range(60):
        e2 = soft * 2.1e11 * (1 + s / (1 + s))
        z = e2 * h2 * (h1 + h2) / 2 / (2.1e11 * h1 + e2 * h2)
        turning = 7850 * h1**3 / 12 + 1000 * h2**3 / 12 + 1000 * h2 * ((h1 + h2) / 2 - z) ** 2 + 7850 * h1 * z**2
        s = 1j * np.sqrt(bending(e2) * k**4 / (mass + turning * k**2))
    assert abs(found / s - 1) < 1e-3


def sandwich(k, shear, faces, core):
    """Return omega^2 by Mead & Markus of the wave number k: (E, h, rho) of the faces, (h, rho) of the core."""
    (e1, h1, r1), (e3, h3, r3) = faces
    h2, r2 = core
    d = h2 + (h1 + h3) / 2
    bend = (e1 * h1**3 + e3 * h3**3) / 12
    g = shear / h2 * (1 / (e1 * h1) + 1 / (e3 * h3))
    y = d**2 * e1 * h1 * e3 * h3 / (e1 * h1 + e3 * h3) / bend
    return bend * k**4 * (1 + y * g / (g + k**2)) / (r1 * h1 + r2 * h2 + r3 * h3)


def test_a_constrained_layer_converges_to_mead_and_markus_with_order_four(poles):
    """A soft, light core and slender faces: stretch and rotary inertia of the layers count for less than 1e-4 of a pole."""
    faces, core = ((2.1e11, 2e-3, 7850.0), (7e10, 0.5e-3, 2700.0)), (0.25e-3, 10.0)
    exact = []
    for n in (1, 2):
        s = 100j
        for _ in range(200):
            s = 1j * np.sqrt(sandwich(n * np.pi / 2.0, 4e5 * ratio(s), faces, core))
        exact.append(s)
    errors = []
    for elements in (2, 4, 32):
        found = poles(
            STEEL + "&material name='alu' density=2700.0 young=7e10 /\n"
            f"&material name='tape' density=10.0 shear_modulus=4e5 poisson=0.49 {GHM} /\n"
            "&section name='s' layers='steel','tape','alu' thickness=2e-3,0.25e-3,0.5e-3 width=0.02 /\n"
            f"&body name='b' kind='beam' length=2.0 elements={elements} section='s' /\n"
            "&joint name='a' type='revolute' body_a='b' node_a=1 /\n&joint name='c' type='slider' body_a='b' node_a=-1 /\n",
            2,
        )
        errors.append(found)
    np.testing.assert_allclose(errors[2], exact, rtol=1e-4)
    order = np.log2(abs(errors[0] - errors[2]) / abs(errors[1] - errors[2]))
    assert np.all(order > 3.7), order


def test_the_check_tells_the_core_that_damps_most(poles, run_deck):
    """Re g/k2 = 1/sqrt((1 + Y)(1 + eta^2)) of Mead & Markus' beam: told loss factors are those of poles, the one at most is."""
    deck = STEEL + (
        "&material name='tape' density=10.0 shear_modulus={0} poisson=0.49 ghm_alpha=1.5 ghm_zeta=1.0 ghm_omega=1500.0 /\n"
        "&section name='s' layers='steel','steel','tape','steel' thickness=1e-3,1e-3,0.25e-3,0.5e-3 width=0.02 cores=3 /\n"
        "&body name='b' kind='beam' length=0.8 elements=8 section='s' /\n&joint name='a' type='revolute' body_a='b' node_a=1 /\n"
        "&joint name='c' type='slider' body_a='b' node_a=-1 /\n"
    )

    def told(modulus):
        return json.loads(run_deck(deck.format(modulus), "--check", "--json").stdout)["cores"][0]

    def loss(modulus):
        square = -(poles(deck.format(modulus), 1)[0] ** 2)
        return square.imag / square.real

    first = told(2e5)
    assert (first["body"], first["layer"]) == ("b", 3)
    assert first["loss_factor"] == pytest.approx(loss(2e5), rel=0.02)
    best = 2e5 * first["best_g_over_k2"] / first["g_over_k2"]
    for _ in range(3):  # the frequency rises with the modulus, and the core's own loss with it
        found = told(best)
        best *= found["best_g_over_k2"] / found["g_over_k2"]
    assert found["loss_factor"] == pytest.approx(found["most_by_stiffness"], rel=1e-3)
    y = 2.1e11 / (2.1e11 * (2.0**3 + 0.5**3) / 12) * 1.5**2 * 1.0 / 2.5
    k = np.pi / 0.8
    stiff, eta = first["g_over_k2"] * k**2, np.sqrt(1 / (1 + y)) / first["best_g_over_k2"]
    modulus = 2e5 * ratio(2j * np.pi * first["frequency"])
    assert stiff == pytest.approx(modulus.real / 0.25e-3 * (1 / 2e-3 + 1 / 0.5e-3) / 2.1e11, rel=0.02)
    assert np.sqrt(eta**2 - 1) == pytest.approx(modulus.imag / modulus.real, rel=1e-4)


INCH, POUND, PSI = 0.0254, 0.45359237, 6894.757


@pytest.mark.parametrize(
    ("frequency", "loss", "digits"),
    [(64.08, 0.2815, 4), (296.4, 0.2424, 4), (743.7, 0.154, 3), (1393.9, 0.089, 3), (2261.1, 0.057, 3)],
)
def test_the_sandwich_cantilever_of_soni(poles, frequency, loss, digits):
    """Soni (Shock Vib. Bull. 55, 1981) by Daya & Potier-Ferry (Comput. Struct. 79, 2001): Hz, loss factor over the core's.

    That of the core is 0.1 at all frequencies: here at the published pole. Faces of 0.06 in, 1e7 psi, 0.1 lb/in3, core of 0.005 in,
    100 psi (shear) and 0.035 lb/in3, 7 in by 0.5 in. In three digits of SI units modulus and density make 7e-4 of a frequency.
    """
    pole = 2j * np.pi * frequency * np.sqrt(1 + 0.1j * loss)
    x = pole / (abs(pole) + pole)  # a Maxwell term of that time: E_R (1 + alpha x) = G (1 + 0.1 i)
    alpha = 0.1 / (x.imag - 0.1 * x.real)
    static = 100 * PSI / (1 + alpha * x.real)
    deck = (
        f"&material name='face' density={0.1 * POUND / INCH**3} young={1e7 * PSI} /\n"
        f"&material name='core' density={0.035 * POUND / INCH**3} shear_modulus={static} prony_alpha={alpha}\n"
        f"  prony_tau={1 / abs(pole)} /\n"
        f"&section name='s' layers='face','core','face' thickness={0.06 * INCH},{0.005 * INCH},{0.06 * INCH} width={0.5 * INCH} /\n"
        f"&body name='b' kind='beam' length={7 * INCH} elements=16 section='s' reference='clamped' slip_held=1 /\n"
        "&joint name='wall' type='weld' body_a='b' node_a=1 /\n"
    )
    found = -(poles(deck, 5) ** 2)
    found = found[np.argmin(np.abs(found + pole**2))]
    assert np.sqrt(found.real) / 2 / np.pi == pytest.approx(frequency, rel=1e-3)
    assert found.imag / found.real / 0.1 == pytest.approx(loss, rel=1e-3, abs=0.5 * 10.0**-digits)


SCENE = (
    STEEL + f"&material name='tape' density=1000.0 shear_modulus=4e5 poisson=0.49 {GHM} prony_alpha=0.5 prony_tau=2e-3 /\n"
    "&section name='bare' layers='steel' thickness=5e-3 width=0.025 /\n"
    "&section name='clad' layers='steel','tape','steel' thickness=5e-3,0.3e-3,1.5e-3 width=0.025 /\n"
    "&body name='arm' kind='beam' length=0.4 elements=4 element_section='bare',2*'clad','bare' reference='clamped'\n"
    "  stiffening=.true. /\n"
    "&lump body='arm' node=-1 mass=0.1 /\n&joint name='pin' type='revolute' body_a='arm' node_a=1 /\n"
    "&history name='turn' kind='ramp' start_value=0.0 end_value=0.5 start=0.0 finish=0.02 /\n"
    "&drive name='motor' type='rotation' body_a='arm' history='turn' /\n"
    "&sensor name='tip' quantity='deflection' body='arm' node=-1 /\n"
    "&sensor name='motor' quantity='reaction' drive='motor' /\n&sensor name='arm' quantity='energy' body='arm' /\n"
    "&sensor name='edge' quantity='slip' body='arm' node=2 /\n"
    "&sensor name='tape' quantity='layer' body='arm' element=2 layer=2 /\n"
)


def test_all_methods_agree_and_energies_balance(run_deck):
    """An arm with a cover over a part of it is turned; the reference is radau at a fine tolerance."""
    settings = {
        "fine": ("method='radau' tolerance=1e-10", 0.0),
        "rk4": ("method='rk4' step=1e-6", 2e-6),
        "dopri5": ("method='dopri5' tolerance=1e-8", 2e-6),
        "radau": ("method='radau' tolerance=1e-7", 1e-5),
        "alpha": ("method='generalized_alpha' step=5e-6 spectral_radius=0.9", 2e-3),
    }
    columns = {}
    for name, (words, allowed) in settings.items():
        run = run_deck(SCENE + f"&transient t_end=4e-3 {words} output_step=2e-4 /\n")
        columns[name] = {column: np.asarray(run.history[column]) for column in run.history.names}
        residual = np.abs(np.asarray(run.energy["residual"])).max()
        assert residual < max(allowed, 1e-7) * np.ptp(columns[name]["arm.strain"])
        for column, fine in columns["fine"].items():
            if column not in ("motor.fx", "motor.fy"):
                assert np.abs(columns[name][column] - fine).max() <= allowed * np.ptp(fine), (name, column)
    assert np.ptp(columns["fine"]["edge.g1"]) > 1e-6
    assert np.ptp(columns["fine"]["tape.tau"]) > 1.0


ARM = (
    STEEL + f"&material name='tape' density=1000.0 shear_modulus=4e5 poisson=0.49 {GHM} /\n"
    "&material name='pad' density=1200.0 young=1e9 ghm_alpha=4.0 ghm_zeta=1.2 ghm_omega=9000.0 /\n"
    "&section name='s' layers='steel','tape','steel','pad' thickness=2e-3,0.25e-3,0.5e-3,1e-3 width=0.02 cores=2 /\n"
    "&joint name='wall' type='weld' body_a='b' node_a=1 /\n"
)
CLAMPED = "&body name='b' kind='beam' length=0.25 elements=8 section='s' reference='clamped' slip_held=1 {} /\n"


def test_a_few_modes_keep_the_damping_of_a_core(poles):
    """The shapes K^-1 K_r phi beside the modes; the modes alone err in damping by 15, 56 and 43 %.

    The base, here the core, says only where the node line is: what the layers can do is the same.
    """
    exact, found = poles(ARM + CLAMPED.format(""), 3), poles(ARM + CLAMPED.format("modes=3"), 3)
    for base in (2, 4):
        np.testing.assert_allclose(poles(ARM.replace("cores=2", f"cores=2 base={base}") + CLAMPED.format(""), 3), exact, rtol=1e-8)
    np.testing.assert_allclose(found.real, exact.real, rtol=1e-3)
    np.testing.assert_allclose(found.imag, exact.imag, rtol=2e-5)


@pytest.mark.parametrize("base", [1, 2])
def test_each_layer_stores_what_its_strains_say(run_deck, base):
    """One element of three layers, clamped: its field from the coordinates p, u, v, r, g; the core's shear by two points."""
    h, young, width, length = np.array([2e-3, 0.5e-3, 1e-3]), np.array([2.1e11, 1e6 * 2.98, 7e10]), 0.02, 0.3
    names = ("p", "u", "v", "r", "g")
    deck = STEEL + (
        "&material name='tape' density=1e3 shear_modulus=1e6 poisson=0.49 /\n&material name='alu' density=2.7e3 young=7e10 /\n"
        f"&section name='s' layers='steel','tape','alu' thickness=2e-3,0.5e-3,1e-3 width={width} base={base} /\n"
        f"&body name='b' kind='beam' length={length} elements=1 section='s' reference='clamped' slip_held=1 /\n"
        "&joint name='wall' type='weld' body_a='b' node_a=1 /\n&force name='f' type='force' body='b' node=2 fx=300 fy=-4 /\n"
        + "".join(f"&sensor name='{x}' quantity='coordinate' body='b' index={k} /\n" for k, x in enumerate(names, 1))
        + "".join(f"&sensor name='layer{k}' quantity='energy' body='b' layer={k} /\n" for k in (1, 2, 3))
        + "&sensor name='edge' quantity='slip' body='b' node=2 /\n&static /\n"
    )
    last = {name: column[-1] for name, column in read_static(run_deck(deck)).items()}
    p, u, v, r, g = (last[f"{x}.q"] for x in names)
    assert last["edge.g1"] == g
    x, weight = np.polynomial.legendre.leggauss(6)
    x, weight = (x + 1) / 2, weight * length / 2
    one, side = np.ones(6), length * 6 * (1 - 2 * x) / length**2
    turn = np.array([v * 6 * x * (1 - x) / length + r * x * (3 * x - 2), side * v / length + r * (6 * x - 2) / length])
    core = np.array([g * x + 4 * p * x * (1 - x), (g + 4 * p * (1 - 2 * x)) / length])
    turns = [turn[1], turn[1] - core[1], turn[1]]  # change of the layers' turns
    steps = [0.5 * (h[k] * turns[k] + h[k + 1] * turns[k + 1]) for k in (0, 1)]  # of strain from middle to middle
    strain = np.array([0 * x, -steps[0], -steps[0] - steps[1]])
    strain -= (young * h) @ (strain - np.average(strain, axis=1, weights=weight)[:, None]) / (young @ h)  # the force is constant
    strain += u / length * one - np.average(strain[base - 1], weights=weight)
    for k in range(3):
        energy = young[k] * width / 2 * weight @ (h[k] * strain[k] ** 2 + h[k] ** 3 / 12 * turns[k] ** 2)
        if k == 1:
            at = 0.5 + np.array([-1, 1]) / np.sqrt(12)
            energy += 1e6 * width * h[1] * length / 4 * np.sum((g * at + 4 * p * at * (1 - at)) ** 2)
        assert last[f"layer{k + 1}.strain"] == pytest.approx(energy, rel=1e-9)


@pytest.mark.parametrize(
    ("modulus", "words", "named"), [("4e7", "", False), ("5e7", "", True), ("5e7", "core_stretch=.true.", False)]
)
def test_a_core_that_is_stiff_beside_its_faces_is_named(run_deck, modulus, words, named):
    """E h of the core over that of the thinner face: 2.8e-4 and 3.5e-4; the limit is 3e-4."""
    deck = ARM.replace("4e5", modulus).replace("cores=2", f"cores=2 {words}") + CLAMPED.format("") + "&modal modes=1 /\n"
    assert ("would store in its stretch" in run_deck(deck).summary) == named


def test_shares_of_layers_are_those_of_the_pole(run_deck):
    """x* (s^2 M + K(s)) x = 0 at a pole: the loss factor of K(s) is that of -s^2, and the sum of the layers' parts."""
    table = read(run_deck(ARM + CLAMPED.format("") + "&modal modes=3 /\n").folder, "modes")
    damped = np.asarray(table["kind"]) == 1
    s = (np.asarray(table["real"]) + 1j * np.asarray(table["imag"]))[damped]
    pad = 1 + 4.0 * (s**2 + 21600.0 * s) / (s**2 + 21600.0 * s + 9000.0**2)
    total, loss = 0.0, []
    for layer, modulus in ((2, ratio(s)), (4, pad)):
        energy = np.asarray(table[f"b.layer{layer}.energy"])[damped]
        loss.append(energy * modulus.imag / modulus.real)
        total = total + loss[-1]
    np.testing.assert_allclose(total, (-(s**2)).imag / (-(s**2)).real, rtol=1e-9)
    for layer, part in zip((2, 4), loss):
        np.testing.assert_allclose(np.asarray(table[f"b.layer{layer}.loss"])[damped], part / total, rtol=1e-9)
    assert np.all(np.min(loss, axis=0) / total > 1e-3)


def test_static_shapes_of_a_body_with_cores_hold_loads_on_any_node(run_deck):
    """One mode and static shapes: deflections under the loads are those of the mesh."""
    deck = (
        ARM
        + CLAMPED
        + "&force name='f' type='force' body='b' node=5 fy=1.0 /\n&force name='g' type='force' body='b' node=-1 fx=1.0 /\n"
        "&sensor name='middle' quantity='deflection' body='b' node=5 /\n"
        "&sensor name='tip' quantity='deflection' body='b' node=-1 /\n&sensor name='b' quantity='energy' body='b' /\n"
        + "".join(f"&sensor name='layer{k}' quantity='energy' body='b' layer={k} /\n" for k in (1, 2, 3, 4))
        + "&static /\n"
    )
    nodal, modal = (read_static(run_deck(deck.format(words))) for words in ("", "modes=1 static_shapes=.true."))
    for column in nodal:
        if column.startswith(("middle", "tip", "layer")):
            assert modal[column][-1] == pytest.approx(nodal[column][-1], rel=1e-9)
    assert sum(modal[f"layer{k}.strain"][-1] for k in (1, 2, 3, 4)) == pytest.approx(modal["b.strain"][-1], rel=1e-11)


def test_the_error_of_a_mesh_holds_the_slip_at_the_same_place(run_deck):
    """check_mesh: 4/3 of the difference to twice the elements; the layers stay held together at the last node."""
    scene = SCENE.replace("'bare',2*'clad','bare'", "{0}*'bare',{1}*'clad' slip_held=-1").replace("elements=4", "elements={2}")
    scene = (
        scene[: scene.index("&sensor name='tape'")] + "&transient t_end=2e-3 method='radau' tolerance=1e-7 output_step=2e-4 {3} /\n"
    )
    checked = run_deck(scene.format(2, 2, 4, "check_mesh=.true."))
    fine = run_deck(scene.format(4, 4, 8, "").replace("node=2", "node=3"), name="fine")
    for column in ("tip.v[m]", "edge.g1[rad]", "arm.strain[J]"):
        name = column.partition("[")[0]
        differs = np.abs(np.asarray(checked.history[name]) - np.asarray(fine.history[name])).max()
        assert checked.figures["reduction"]["mesh_errors"][column] == pytest.approx(4 / 3 * differs, rel=1e-3)


@pytest.mark.parametrize("modes", ["", "modes=6"])
def test_what_each_layer_loses(modes, run_deck):
    """Two layers of one material and one of another; what they lose adds up to what is dissipated. In modes one material is one."""
    deck = (
        ARM.replace("'steel','tape','steel','pad'", "'pad','steel','tape','steel','pad'").replace(
            "2e-3,0.25e-3,0.5e-3,1e-3 width=0.02 cores=2", "5e-4,2e-3,0.25e-3,0.5e-3,1e-3 width=0.02 base=2 cores=3"
        )
        + CLAMPED.format(modes)
        + "&force name='f' type='force' body='b' node=-1 fy=5.0 /\n"
        "&transient t_end=2e-3 method='radau' tolerance=1e-4 output_step=1e-3 /\n"
    )
    layers = (1, 2, 3, 4, 5) if not modes else (2, 3, 4)
    sensors = [f"&sensor name='l{k}' quantity='energy' body='b' layer={k} /\n" for k in layers]
    run = run_deck(deck + "&sensor name='b' quantity='energy' body='b' /\n" + "".join(sensors))
    losses = run.transient["losses"]
    for k in layers:
        lost = sum(one["lost"] for one in losses if one.get("layer") == k)
        assert run.history[f"l{k}.dissipated"][-1] == pytest.approx(lost, rel=1e-12, abs=0.0)
    for column in ("strain", "dissipated") if not modes else ():
        total = sum(np.asarray(run.history[f"l{k}.{column}"]) for k in layers)
        np.testing.assert_allclose(total, run.history[f"b.{column}"], rtol=1e-12)
    places = [(one.get("layer"), one["material"]) for one in losses]
    assert places == ([(1, "pad"), (3, "tape"), (5, "pad")] if not modes else [(None, "pad"), (3, "tape")])
    assert all(one["lost"] > 1e-7 for one in losses)
    assert sum(one["lost"] for one in losses) == pytest.approx(run.energy["dissipated"][-1], rel=1e-5)


def test_sections_of_one_layer_lose_by_material(run_deck):
    """A beam that shears, one of a single layer: layers are not what their losses are listed by."""
    deck = "&material name='pad' density=1200.0 young=1e9 ghm_alpha=4.0 ghm_zeta=1.2 ghm_omega=9000.0 /\n"
    for name, words in (("a", "shape='rectangle' height=0.03 shear=.true."), ("b", "layers='pad' thickness=0.03")):
        material = "material='pad'" if name == "a" else ""
        deck += (
            f"&section name='{name}' {words} width=0.02 /\n"
            f"&body name='{name}' kind='beam' length=0.3 elements=2 {material} section='{name}' reference='clamped' /\n"
            f"&joint name='w{name}' type='weld' body_a='{name}' node_a=1 /\n"
            f"&force name='f{name}' type='force' body='{name}' node=-1 fy=5.0 /\n"
        )
    run = run_deck(deck + "&transient t_end=2e-3 method='radau' tolerance=1e-4 output_step=1e-3 /\n")
    ((lost, words),) = ((one.pop("lost"), one) for one in run.transient["losses"])
    assert words == {"material": "pad", "kind": "GHM", "term": 1}
    for body in run.figures["scene"]["bodies"]:
        assert [body["sections"][0][0][end] for end in ("from", "to")] == pytest.approx([-0.015, 0.015])
    assert lost == pytest.approx(run.energy["dissipated"][-1], rel=1e-9)


@pytest.mark.parametrize(
    ("length", "section", "named"),
    [
        (0.18, "'steel','pad' thickness=4e-3,6e-3", ["% of half a wave"]),
        (0.6, "'steel','pad' thickness=4e-3,6e-3", []),
        (0.18, "'steel','pad' thickness=4e-3,6e-3 shear=.true.", []),
        (0.6, "'steel','tape' thickness=4e-3,6e-3", ["of (thickness over half a wave) squared"]),
        (0.3, "'steel','tape','steel' thickness=6e-3,4e-3,3e-3", ["resonance of its faces"]),
    ],
)
def test_where_the_theory_of_layers_ends(length, section, named, run_deck):
    """Simply supported: half a wave is the length. Against elasticity the free layer errs by 1e-3 in f at 0.02, 5e-3 at 0.1."""
    deck = ARM[: ARM.index("&section")] + (
        f"&section name='s' layers={section} width=0.02 /\n&body name='b' kind='beam' length={length} elements=8 section='s' /\n"
        "&joint name='a' type='revolute' body_a='b' node_a=1 /\n&joint name='c' type='slider' body_a='b' node_a=-1 /\n"
        "&modal modes=1 /\n"
    )
    figures = run_deck(deck).figures
    warnings = figures.get("warnings", [])
    assert len(warnings) == len(named)
    assert all(words in warning for words, warning in zip(named, warnings))
    if "resonance" in "".join(named):
        omega = 2 * np.pi * max(pole["frequency"] for pole in figures["modes"]["poles"])
        across = 2 * 1.49 * 4e5 * ratio(1j * omega).real / 4e-3 * (1 / 6e-3 + 1 / 3e-3) / 7850
        assert float(re.search(r"as fast as ([\d.]+) of", warnings[0])[1]) == pytest.approx(omega / np.sqrt(across), abs=0.006)


def test_a_core_that_shears_far_is_named(run_deck):
    deck = ARM + CLAMPED.format("") + "&force name='f' type='force' body='b' node=-1 fy={} /\n&static /\n"
    assert "shears a core by" not in run_deck(deck.format(1.0)).summary
    assert "shears a core by" in run_deck(deck.format(10.0)).summary


def test_three_layers_may_be_bonded(poles, run_deck):
    """cores=0: the same pole as with one very stiff core, whose slip is named where it is the fastest motion."""
    deck = ARM.replace("'steel','tape','steel','pad'", "'steel','alu','steel'").replace(
        "2e-3,0.25e-3,0.5e-3,1e-3", "2e-3,1e-5,1e-3"
    )
    deck = "&material name='alu' density=2700.0 young=1e12 poisson=0.0 /\n" + deck
    found = {}
    for cores, held, words in (
        ("0", "", "larger steps by: fewer elements, modes= or flexible"),
        ("2", "slip_held=1,-1", "limited by slip of the layers of body"),
    ):
        text = deck.replace("cores=2", f"cores={cores}") + CLAMPED.format("").replace("slip_held=1", held)
        found[cores] = poles(text, 2)
        assert words in run_deck(text + "&modal modes=1 /\n").summary
    np.testing.assert_allclose(found["0"], found["2"], rtol=1e-6)


def test_bodies_of_equal_layers_move_as_each_would_alone(run_deck):
    """Three arms: the second is the first one again, the third has a stiffer tape; constants of the first serve the second."""
    head, arm = SCENE[: SCENE.index("&body")], SCENE[SCENE.index("&body") :].replace("stiffening=.true.", "")
    arm = arm[: arm.index("&sensor name='motor'")] + arm[arm.index("&sensor name='edge'") :]

    def named(name, words=arm):
        for one in ("arm", "pin", "motor", "tip", "edge", "tape' q"):
            words = words.replace(f"'{one}", f"'{name}{one}")
        return words

    stiff = head[head.index("&material name='tape'") : head.index("&section")].replace("'tape'", "'hard'").replace("4e5", "8e5")
    stiff += head[head.index("&section name='clad'") :].replace("'clad'", "'stiff'").replace("'tape'", "'hard'")
    motor = "&history name='turn' kind='ramp' start_value=0.0 end_value=0.5 start=0.0 finish=0.02 /\n"
    arm = arm.replace(motor, "")
    transient = "&transient t_end=2e-3 method='dopri5' tolerance=1e-9 output_step=2e-4 /\n"
    other = named("c", arm).replace("'clad'", "'stiff'")
    together = run_deck(head + stiff + motor + named("a", arm) + named("b", arm) + other + transient).history
    alone = run_deck(head + stiff + motor + named("a", arm) + transient, name="first").history
    stiffer = run_deck(head + stiff + motor + other + transient, name="third").history
    for column in (name[1:] for name in alone.names[1:]):
        size = np.ptp(np.asarray(alone["a" + column]))
        for one, reference in (("a", alone["a" + column]), ("b", alone["a" + column]), ("c", stiffer["c" + column])):
            assert np.abs(np.asarray(together[one + column]) - np.asarray(reference)).max() <= 1e-7 * size, (one, column)


@pytest.mark.parametrize(("cores", "within"), [(0, 1e-9), (2, 1e-4)])
def test_stresses_of_layers_at_the_root_are_those_of_equilibrium(cores, within, run_deck):
    """E M (z - axis)/EI where the bending moment is largest, at the face farther from the axis; a stiff core changes little."""
    modulus, height = np.array([2.1e11, 1e12, 7e10]), np.array([2e-3, 1e-5, 1e-3])
    top = np.cumsum(height)
    middle = top - height / 2
    axis = (modulus * height) @ middle / (modulus @ height)
    ei = 0.02 * modulus @ (height**3 / 12 + height * (middle - axis) ** 2)
    deck = STEEL + (
        "&material name='alu' density=2700.0 young=7e10 /\n&material name='glue' density=1000.0 young=1e12 poisson=0.0 /\n"
        f"&section name='s' layers='steel','glue','alu' thickness=2e-3,1e-5,1e-3 width=0.02 cores={cores} /\n"
        f"&body name='b' kind='beam' length=0.25 elements=4 section='s' reference='clamped' {'slip_held=1,-1' if cores else ''} /\n"
        "&joint name='w' type='weld' body_a='b' node_a=1 /\n&force name='f' type='force' body='b' node=-1 fy=1.0 /\n"
        + "".join(f"&sensor name='l{k}' quantity='layer' body='b' element=1 layer={k} /\n" for k in (1, 3))
        + "&static /\n"
    )
    last = {name: np.asarray(column)[-1] for name, column in read_static(run_deck(deck)).items()}
    for k in (1, 3):
        far = max(abs(top[k - 1] - axis), abs(top[k - 1] - height[k - 1] - axis))
        assert last[f"l{k}.s"] == pytest.approx(modulus[k - 1] * 0.25 * far / ei, rel=within)


def test_a_sensor_may_have_more_columns_than_others(run_deck):
    """Two stacks whose bases are their lowest and their highest layer have eight cores together."""
    stack = "width=0.02 layers=" + "'s','v'," * 4 + "'s' thickness=" + "1e-3,5e-4," * 4 + "1e-3"
    deck = "&material name='s' density=7800.0 young=2e11 /\n&material name='v' density=1000.0 young=1e8 /\n"
    deck += "".join(f"&section name='{n}' {stack} base={base} cores=2,4,6,8 /\n" for n, base in (("a", 1), ("b", 9)))
    deck += "&body name='b' kind='beam' length=0.4 elements=2 element_section='a','b' reference='clamped' slip_held=1 /\n"
    deck += "&joint name='w' type='weld' body_a='b' node_a=1 /\n&force name='f' body='b' node=-1 fy=1.0 /\n"
    deck += "".join(f"&sensor name='{n}' quantity='slip' body='b' node={k} /\n" for n, k in (("mid", 2), ("end", 3)))
    run = run_deck(deck + "&static load_steps=1 /\n")
    lines = (run.folder / "static.txt").read_text().splitlines()
    names = next(line for line in lines if line.startswith("# columns")).split()[2:]
    values = dict(zip((name.partition("[")[0] for name in names), map(float, lines[-1].split())))
    assert [n for n in values if ".g" in n] == [f"{s}.g{k}" for s in ("mid", "end") for k in range(1, 9)]
    assert all(abs(values[f"mid.g{k}"]) > 1e-5 for k in range(1, 9))
    assert [abs(values[f"end.g{k}"]) > 1e-5 for k in range(1, 9)] in ([True] * 4 + [False] * 4, [False] * 4 + [True] * 4)


@pytest.mark.parametrize("elements", [20, 40])
@pytest.mark.parametrize(
    "layers", ["layers='steel','pad' thickness=1e-3,0.03", "layers='steel','pad','steel' thickness=1e-3,0.02,1e-3"]
)
def test_the_kinetic_energy_is_definite_wherever_the_base_lies(run_deck, layers, elements):
    """Steel with a pad of elastomer, clamped: the centre of mass is far from the node line, and the beam bends while it turns."""
    run = run_deck(f"""&scene gravity=0.0,-9.81 /
&material name='steel' density=7850.0 young=2.1e11 /
&material name='pad' density=1200.0 young=3.0e6 poisson=0.49 prony_alpha=1.0 prony_tau=1.0e-3 /
&section name='s' {layers} width=0.02 /
&body name='b' kind='beam' length=0.4 elements={elements} section='s' reference='clamped' /
&joint name='w' type='revolute' body_a='b' node_a=1 /
&history name='h' kind='ramp' start_value=0.0 end_value=1.0 start=0.0 finish=0.02 /
&drive name='m' type='rotation' body_a='b' history='h' /
&force name='f' type='force' body='b' node=-1 fy=-4.0 history='h' /
&transient t_end=0.03 method='radau' tolerance=1e-4 output_step=3e-3 /
""")
    assert "uneven" not in run.stderr
    assert np.abs(run.energy["residual"]).max() < 1e-3 * np.abs(run.energy["kinetic"]).max()
