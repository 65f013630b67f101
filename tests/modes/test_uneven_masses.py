"""Modes of mechanisms whose masses differ by up to 1e9, against closed forms in exact arithmetic; what is beyond is told."""

import re
from decimal import Decimal, getcontext
from fractions import Fraction

import numpy as np
import pytest
from biela.histories import read

getcontext().prec = 60
RATIOS = [1e-9, 1e-6, 1e-3, 1.0, 1e3, 1e6, 1e9]
PRECISION = 2e-14  # of a frequency: what rounding leaves

BEAM = """&material name='m' density=2700.0 young=7.0e10 /
&section name='s' area=3.0e-4 inertia=2.5e-9 /
&body name='b' kind='beam' length=0.8 elements={elements} material='m' section='s' reference='clamped' {more} /
"""


def two_frequencies(mass, stiffness):
    """Return the frequencies [Hz], ascending, of K x = w M x for exact symmetric 2 x 2 matrices ((a, b), (b, c))."""
    (ma, mb, mc), (ka, kb, kc) = mass, stiffness
    a, b, c = ma * mc - mb * mb, ma * kc + mc * ka - 2 * mb * kb, ka * kc - kb * kb

    def decimal(x):
        return Decimal(x.numerator) / Decimal(x.denominator)

    large = (decimal(b) + decimal(b * b - 4 * a * c).sqrt()) / (2 * decimal(a))
    return [float((decimal(c) / decimal(a) / large).sqrt()) / (2 * np.pi), float(large.sqrt()) / (2 * np.pi)]


def link(name, mass, on, spin=0.0, x=0.0, y=0.0, angle=0.0):
    """Return a uniform unit link hung on a place; its state is one of a steady turn about the origin."""
    return f"""&body name='{name}' kind='rigid' mass={mass:.17e} inertia={mass / 12:.17e} com=0.5,0.0 position={x},{y} angle={angle}
  angular_velocity={spin} velocity=0.0,{spin * x} /
&joint name='{name}' type='revolute' body_a='{name}' {on} /
"""


def frequencies(run_deck, deck, **options):
    """Return the frequencies of the undamped modes [Hz]."""
    table = read(run_deck(deck, **options).folder, "modes")
    return table["frequency"][table["kind"] == 0]


@pytest.mark.parametrize("ratio", RATIOS)
def test_two_hanging_links(run_deck, ratio):
    down = -np.pi / 2
    deck = "&scene gravity=0.0,-9.81 /\n" + link("one", 1.0, "", angle=down)
    deck += link("two", ratio, "body_b='one' point_b=1.0,0.0", y=-1.0, angle=down) + "&modal modes=2 /\n"
    m, g = Fraction(float(f"{ratio:.17e}")), Fraction(9.81)
    inertia = [Fraction(float(f"{x / 12:.17e}")) for x in (1.0, ratio)]
    mass = (inertia[0] + Fraction(1, 4) + m, m / 2, inertia[1] + m / 4)
    exact = two_frequencies(mass, ((Fraction(1, 2) + m) * g, Fraction(0), m * g / 2))
    np.testing.assert_allclose(frequencies(run_deck, deck), exact, rtol=PRECISION)


@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("spin", [1e-2, 10.0])
def test_two_links_on_a_turning_hub(run_deck, ratio, spin):
    deck = f"&scene /\n&body name='hub' kind='rigid' mass=1.0 inertia=1.0 angular_velocity={spin} /\n"
    deck += "&joint name='axle' type='revolute' body_a='hub' /\n"
    deck += f"&history name='w' kind='polynomial' coefficients={spin} /\n"
    deck += "&drive name='motor' type='rotation' body_a='hub' history='w' rate=.true. /\n"
    deck += link("one", 1.0, "body_b='hub' point_b=0.5,0.0", spin, x=0.5)
    deck += link("two", ratio, "body_b='one' point_b=1.0,0.0", spin, x=1.5) + "&modal modes=2 /\n"
    m, w = Fraction(float(f"{ratio:.17e}")), Fraction(spin) ** 2
    inertia = [Fraction(float(f"{x / 12:.17e}")) for x in (1.0, ratio)]
    mass = (inertia[0] + Fraction(1, 4) + m, m / 2, inertia[1] + m / 4)
    # centrifugal potential -w/2 sum of m r^2; r^2 holds 2 c_i c_j cos(angle_i - angle_j), the hub's angle being 0
    stiffness = (w * (Fraction(1, 4) + m / 2 + m / 2), -w * m / 2, w * (m / 4 + m / 2))
    np.testing.assert_allclose(frequencies(run_deck, deck), two_frequencies(mass, stiffness), rtol=1e-12)


@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("spring", [1.0, 1e-9, 1e9])
def test_two_masses_on_springs(run_deck, ratio, spring):
    deck = "&scene /\n"
    for k, mass in enumerate((1.0, ratio)):
        deck += f"&body name='b{k}' kind='rigid' mass={mass:.17e} inertia=1.0 position={k + 1},0.0 /\n"
        deck += f"&joint name='j{k}' type='prismatic' body_a='b{k}' /\n"
    deck += "&spring name='s0' type='linear' body_a='b0' stiffness=100.0 /\n"
    deck += f"&spring name='s1' type='linear' body_a='b1' body_b='b0' stiffness={100.0 * spring:.17e} /\n&modal modes=2 /\n"
    m, k = Fraction(float(f"{ratio:.17e}")), Fraction(float(f"{100.0 * spring:.17e}"))
    exact = two_frequencies((Fraction(1), Fraction(0), m), (100 + k, -k, k))
    np.testing.assert_allclose(frequencies(run_deck, deck), exact, rtol=PRECISION)


@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("more", ["", "modes=4"])
def test_one_element_with_a_lump(run_deck, ratio, more):
    """One clamped element: its bending has two coordinates, so the frequencies follow in exact arithmetic."""
    lump = ratio * 2700.0 * 3.0e-4 * 0.8
    elements = BEAM.format(elements=1, more=more.replace("4", "3"))
    deck = elements + f"&lump body='b' node=-1 mass={lump:.17e} /\n&joint name='w' type='weld' body_a='b' node_a=1 /\n"
    found = frequencies(run_deck, deck + "&modal modes=3 /\n")
    w = Fraction(2700.0) * Fraction(3.0e-4) * Fraction(0.8)
    long, bend, m = Fraction(0.8), Fraction(7.0e10) * Fraction(2.5e-9), Fraction(float(f"{lump:.17e}"))
    mass = (w * 156 / 420 + m, -w * 22 * long / 420, w * 4 * long * long / 420)
    bending = two_frequencies(mass, (12 * bend / long**3, -6 * bend / long**2, 4 * bend / long))
    axial = np.sqrt(7.0e10 * 3.0e-4 / 0.8 / float(w / 3 + m)) / (2 * np.pi)
    np.testing.assert_allclose(found, sorted([*bending, axial]), rtol=PRECISION)


@pytest.mark.parametrize("ratio", [1e-6, 1.0, 1e9])
@pytest.mark.parametrize("elements", [8, 40])
def test_modes_kept_of_a_lumped_beam_are_those_of_its_nodes(run_deck, ratio, elements):
    tail = f"&lump body='b' node=-1 mass={ratio * 0.648:.17e} /\n"
    tail += "&joint name='w' type='weld' body_a='b' node_a=1 /\n&modal modes=3 /\n"
    nodal = frequencies(run_deck, BEAM.format(elements=elements, more="") + tail, name="nodal")
    modal = frequencies(run_deck, BEAM.format(elements=elements, more="modes=5") + tail, name="modal")
    np.testing.assert_allclose(modal, nodal, rtol=1e-11 if elements < 20 else 1e-9)  # its own matrices are rounded, too


@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("spin", [1e-5, 3e-4, 30.0])
def test_a_structure_that_turns_freely_in_space(run_deck, ratio, spin):
    """In axes that turn with it a free structure has one rigid motion, and drifts past at the frequency of the turn.

    Slow turns are right although the square of 1e-5 rad/s is to that of the lowest vibration as rounding to 1.
    """
    deck = f"&body name='p' kind='rigid' mass={0.648 * ratio} inertia={0.01 * ratio} angular_velocity={spin} /\n"
    deck += BEAM.format(elements=4, more=f"angular_velocity={spin}")
    found = frequencies(run_deck, deck + "&joint name='w' type='weld' body_a='b' node_a=1 body_b='p' /\n&modal modes=4 /\n")
    assert found[0] == 0.0
    np.testing.assert_allclose(found[1:3], spin / (2 * np.pi), rtol=1e-6)  # a double root with one vector: half the digits
    assert found[3] > 10.0


@pytest.mark.parametrize("analysis", ["&modal modes=2 /", "&transient t_end=1.0 method='rk4' step=1e-3 /"])
def test_masses_beyond_double_precision_are_told(run_deck, analysis):
    text = "&scene gravity=1.0,0.0 /\n"
    for k, mass in enumerate((1.0, 1e9, 1e18)):
        text += link(f"l{k}", mass, f"body_b='l{k - 1}' point_b=1.0,0.0" if k else "", x=k)
    run = run_deck(text + analysis + "\n", expect=2)
    assert "too uneven for double precision" in run.stderr
    place = re.match(r"\S+\.nml:(\d+): .*, most of all at joint \"(\w+)\"", run.stderr)
    assert text.splitlines()[int(place[1]) - 1].startswith(f"&joint name='{place[2]}'")
    assert place[2] in ("l1", "l2")  # between light bodies and heavy ones
    assert not run.folder.exists()


def test_masses_that_become_too_uneven_in_a_run_are_told_with_the_weakest_joint(run_deck):
    text, x, y = "&scene gravity=1.0,0.5 /\n", 0.0, 0.0
    for k in range(3):
        text += f"&body name='l{k}' mass={1e9**k} inertia={0.1 * 1e9**k} position={x},{y} angle={0.3 * k} /\n"
        text += f"&joint name='j{k}' type='revolute' body_a='l{k}' " + (f"body_b='l{k - 1}' point_b=1.0,0.0 /\n" if k else "/\n")
        x, y = x + np.cos(0.3 * k), y + np.sin(0.3 * k)
    text += "&body name='apart' mass=1.0 inertia=1.0 /\n&joint name='j3' type='revolute' body_a='apart' /\n"
    text += "&sensor name='s' quantity='angle' body='l0' /\n"
    run = run_deck(text + "&transient t_end=10.0 method='rk4' step=1e-2 output_step=0.1 accept_unstable=.true. /\n", expect=1)
    place = re.match(r"\S+\.nml:(\d+): the run cannot go on after .*, most of all at joint \"(\w+)\"\. Results", run.stderr)
    assert place[2] == "j2"
    assert text.splitlines()[int(place[1]) - 1].startswith("&joint name='j2'")


@pytest.mark.parametrize("ratio", [1e-9, 1.0, 1e9])
def test_bodies_left_free_are_named_whatever_their_masses(run_deck, ratio):
    text = ""
    for k, mass in enumerate((1.0, ratio)):
        own = BEAM.format(elements=100, more=f"position={0.8 * k},0.0").replace("density=2700.0", f"density={2700.0 * mass}")
        for name in ("m", "s", "b"):
            own = own.replace(f"'{name}'", f"'{name}{k}'")
        text += own
    text += "&joint name='one' type='revolute' body_a='b0' node_a=1 /\n"
    text += "&joint name='two' type='revolute' body_a='b1' node_a=1 body_b='b0' node_b=-1 /\n&static /\n"
    run = run_deck(text, expect=2)
    assert 'left free to move: "b0" "b1"' in run.stderr


CRANK, ROD, TURN = 0.2, 0.4, 0.5  # lengths [m], the crank's angle [rad]
FLEXIBLE = """&material name='m' density={density:.3e} young=7.0e10 /
&section name='s' shape='rectangle' width=0.02 height=0.02 /
&body name='rod' kind='beam' length=0.4 elements=2 material='m' section='s' {rest} /
{lump}"""


def slider_crank(rod, ends=("", "point_a=0.4,0.0"), method="method='rk4' step=1e-5"):
    """Return a slider-crank whose crank turns at 150 rad/s, the rod given with {rest} for where it lies."""
    lean = -np.arcsin(CRANK * np.sin(TURN) / ROD)
    rest = f"position={CRANK * np.cos(TURN):.17g},{CRANK * np.sin(TURN):.17g} angle={lean:.17g}"
    return f"""&scene gravity=0.0,-9.81 /
&body name='crank' kind='rigid' mass=1.0 inertia=1e-2 com=0.1,0.0 angle={TURN} angular_velocity=150.0 /
{rod.replace("{rest}", rest)}
&joint name='o' type='revolute' body_a='crank' /
&joint name='p' type='revolute' body_a='rod' {ends[0]} body_b='crank' point_b=0.2,0.0 /
&joint name='s' type='slider' body_a='rod' {ends[1]} direction=0.0 /
&sensor name='w' quantity='angular_velocity' body='crank' /
&sensor name='v' quantity='velocity' body='rod' {"point=0.4,0.0" if not ends[0] else "node=-1"} /
&transient t_end=1e-3 {method} output_step=1e-4 /
"""


def starts_right_or_is_refused(run):
    """Whether the run began with the stated motion; else it has been refused for its masses, and nothing was written."""
    if run.status == 0 or (run.folder / "history.txt").exists():
        h = run.history
        assert h["w"][0] == pytest.approx(150.0, rel=1e-9)
        lean = np.arcsin(CRANK * np.sin(TURN) / ROD)
        speed = -150.0 * CRANK * (np.sin(TURN) + np.cos(TURN) * np.tan(lean))
        assert h["v.x"][0] == pytest.approx(speed, rel=1e-9)
        assert "was corrected" not in run.stderr
        for name in ("history.txt", "energy.txt"):
            assert "nan" not in (run.folder / name).read_text(encoding="utf-8").lower()
        return True
    assert run.status == 2
    assert re.match(r"\S+\.nml:\d+: .*too uneven for double precision", run.stderr)
    assert not run.folder.exists()
    return False


@pytest.mark.parametrize("power", [-15, -9, 0, 3, 6, 7, 8, 9, 11, 12, 15, 18])
@pytest.mark.parametrize(
    "method",
    [
        "rk4' step=1e-5",
        "rk4' step=1e-5 stabilization='baumgarte'",
        "radau' tolerance=1e-8",
        "radau' tolerance=1e-5",
        "generalized_alpha' step=1e-5",
    ],
)
def test_rigid_links_in_motion(run_deck, power, method):
    """A heavy rod keeps its energy: the crank ends at the speed that rods of 3e3 times its mass and more give it."""
    mass = 3.0 * 10.0**power
    rod = f"&body name='rod' kind='rigid' mass={mass:.3e} inertia={0.01 * mass:.3e} com=0.2,0.0 {{rest}} /"
    run = run_deck(slider_crank(rod, method=f"method='{method}"), expect=None)
    right = starts_right_or_is_refused(run)
    assert right or power > 11
    if right:
        assert run.status == 0
        error = 1e-5 if "alpha" in method else 1e-7 if "baumgarte" in method else 1e-8  # Baumgarte's rows stay open a little
        assert power < 8 or run.history["w"][-1] == pytest.approx(134.79498717, rel=error)


FLEXIBLE_METHODS = ["rk4' step=1e-6", "generalized_alpha' step=5e-5", "radau' tolerance=1e-6", "dopri5' tolerance=1e-6"]


@pytest.mark.parametrize("method", [f"method='{method}" for method in FLEXIBLE_METHODS])
@pytest.mark.parametrize(
    ("density", "lump"), [(2700.0, 1e6), (2700.0, 1e15), (2700.0, 1e20), (1e-6, 1.0), (1e-14, 0.0), (1e-14, 1.0)]
)
def test_flexible_rods_in_motion(run_deck, density, lump, method):
    """A step above the stable one is another reason to refuse."""
    own = f"&lump body='rod' node=-1 mass={lump:.3e} /" if lump else ""
    rod = FLEXIBLE.format(density=density, lump=own, rest="{rest}")
    deck = slider_crank(rod, ("node_a=1", "node_a=-1"), method)
    if density == 1e-6 and "dopri5" in method:  # millions of steps, and the start is what is judged
        deck = deck.replace("t_end=1e-3", "t_end=1e-5").replace("output_step=1e-4", "output_step=1e-5")
    run = run_deck(deck, expect=None)
    if "above the safe bound" in run.stderr:
        assert not run.folder.exists()
        return
    if density < 1e-13 and "dopri5" in method and not lump:
        assert "light masses on stiff springs" in run.stderr
        assert run.status == 1
        return
    starts_right_or_is_refused(run)


def test_a_short_first_element_is_not_taken_for_uneven_masses(run_deck):
    """The frame at its node has 1e-15 of the body's inertia, which rounding hides; a weld holds it anyway."""
    deck = """&scene gravity=0.0,-9.81 /
&material name='m' density=1000 young=1e9 /
&section name='s' area=1e-4 inertia=1e-9 /
&body name='b' kind='frame' node_x=0.0,1e-2,125.0,250.0,375.0,500.0 node_y=6*0.0 element_nodes=1,2,2,3,3,4,4,5,5,6 material='m'
  section='s' reference='{}' /
&joint name='j' type='weld' body_a='b' node_a=1 /
&sensor name='r' quantity='reaction' joint='j' /
&transient t_end=1e-4 method='generalized_alpha' step=1e-4 /
"""
    clamped, pinned = (run_deck(deck.format(r), name=r).history for r in ("clamped", "pinned"))
    for column in ("r.fy", "r.m"):
        np.testing.assert_allclose(clamped[column][-1], pinned[column][-1], rtol=1e-6)


@pytest.mark.parametrize("words", ["'radau' tolerance=1e-4", "'generalized_alpha' step=1e-5", "'rk4' step=1e-6"])
def test_a_pin_at_the_clamped_node_of_a_fine_mesh_is_warned_of(words, run_deck):
    """The frame moves with the first element alone, a billionth of the body's inertia: rounding leaves five figures."""
    deck = f"""&scene gravity=0.0,-9.81 /
&material name='m' density=1000 young=1e9 /
&section name='s' area=1e-4 inertia=1e-9 /
&body name='b' kind='beam' length=50 elements=200 material='m' section='s' reference='{{}}' /
&joint name='j' type='revolute' body_a='b' node_a=1 /
&sensor name='r' quantity='reaction' joint='j' /
&sensor name='a' quantity='angular_acceleration' body='b' node=1 /
&transient t_end=1e-4 method={words} /
"""
    runs = {r: run_deck(deck.format(r), name=r) for r in ("clamped", "pinned")}
    for column in ("r.fy", "a"):
        np.testing.assert_allclose(runs["clamped"].history[column], runs["pinned"].history[column], rtol=1e-5)
    assert abs(runs["clamped"].transient["steps"] - runs["pinned"].transient["steps"]) <= 1
    assert ["so fine a mesh" in runs[r].stderr for r in ("clamped", "pinned")] == [True, False]
