"""What a set-up costs grows with at most the power 1.2 of what a deck asks for, told by bytes that are allocated, not seconds."""

import math
import os
import re
import subprocess
import sys

import numpy as np
import pytest
from conftest import ROOT

sys.path.insert(0, str(ROOT / "tests" / "bench"))
import bench_scenes as scenes

RUN = scenes.transient(1e-9, 1, "generalized_alpha")
FAMILIES = {
    "elements, 4 modes": (lambda n: scenes.slider_crank(n, RUN, modes=4), 300),
    "redundant links": (lambda n: scenes.truss(n, 4, RUN), 12),
    "materials": (lambda n: scenes.many_materials(n, RUN), 100),
    "materials, static": (lambda n: scenes.many_materials(n, "&static load_steps=1 /\n"), 300),
    "bodies": (lambda n: scenes.chain(n, RUN), 100),
    "loops": (lambda n: scenes.lattice(n, RUN), 40),
}


@pytest.mark.parametrize("name", FAMILIES)
def test_growth_of_what_a_set_up_allocates(biela, counters, tmp_path, name):
    if biela.name.endswith("-debug"):
        pytest.skip("the checked build makes temporary arrays")
    make, n = FAMILIES[name]
    found = []
    for size in (n, 4 * n):
        deck = tmp_path / f"{size}.nml"
        deck.write_text(make(size))
        done = subprocess.run(
            [str(biela), "--quiet", "--output", str(tmp_path / "out"), str(deck)],
            env={**os.environ, "LD_PRELOAD": str(counters)},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        found.append(int(re.search(r"^bytes (\d+)$", done.stderr, re.MULTILINE).group(1)))
    assert math.log(found[1] / found[0]) / math.log(4.0) <= 1.2, found


def test_the_joints_of_many_redundant_sets_are_named(run_deck):
    """Every bay of a ladder is determinate but those with a second diagonal, whose six links alone are redundant."""
    deck = "&scene title='ladder' /\n"
    crossed, bays = {3, 4, 11, 20, 21, 22, 37}, 40
    expected = set()
    for i in range(bays + 1):
        for j in (0, 1):
            deck += f"&body name='p{i}_{j}' kind='rigid' mass=1.0 inertia=0.01 position={i},{j} /\n"
    links = [((0, 0), (0, 1))]
    for i in range(bays):
        bay = [((i, 0), (i + 1, 0)), ((i, 1), (i + 1, 1)), ((i, 0), (i + 1, 1)), ((i + 1, 0), (i + 1, 1))]
        if i in crossed:
            bay.append(((i, 1), (i + 1, 0)))
            expected |= {*bay, ((i, 0), (i, 1))}
        links += bay
    names = {}
    for a, b in links:
        name = names[a, b] = f"d{a[0]}_{a[1]}_{b[0]}_{b[1]}"
        deck += f"&joint name='{name}' type='distance' body_a='p{a[0]}_{a[1]}' body_b='p{b[0]}_{b[1]}' "
        deck += f"length={math.dist(a, b)!r} /\n"
    run = run_deck(deck + RUN)
    line = re.search(r"redundant constraints: (\d+) at the start, among (.*?);", run.summary)
    assert int(line.group(1)) == len(crossed)
    assert set(re.findall(r'"(\w+)"', line.group(2))) == {names[link] for link in expected}
    assert re.search(rf'redundant constraints at the start among( "\w+"){{3}} and {len(expected) - 3} more;', run.stderr)


@pytest.mark.parametrize(("elements", "omega"), [(80, 2.0e4), (6, 3.0e6)], ids=["a mode limits", "a pole limits"])
def test_many_like_materials_bound_steps_as_one(run_deck, elements, omega):
    """Each element of a material of its own, all with the same values, against one material for all."""
    run = "&transient t_end=1e-8 method='generalized_alpha' step=1e-8 /\n"
    found = []
    for count in (1, elements):
        deck = scenes.many_materials(elements, run, 0.0, omega, count)
        bounds = run_deck(deck).figures["stable_steps"]
        found.append([bounds[method][which] for method in ("rk4", "dopri5") for which in ("safe_bound", "current_bound")])
    np.testing.assert_allclose(found[1], found[0], rtol=1e-3)


def test_the_modes_of_a_fine_mesh(run_deck):
    """The lowest frequencies of a cantilever of 1,000 elements to more digits than the largest one leaves them by itself."""
    beta = np.array([1.8751040687119611, 4.694091132974175, 7.854757438237613])
    run = run_deck(scenes.cantilever(1000, 0, "&modal modes=3 /\n"))
    table = np.loadtxt(run.folder / "modes.txt")
    exact = (beta / scenes.LENGTH) ** 2 * math.sqrt(scenes.YOUNG * scenes.INERTIA / scenes.DENSITY / scenes.AREA) / (2 * math.pi)
    np.testing.assert_allclose(table[:3, 3], exact, rtol=1e-10)
    assert run.figures["modes"]["factorisations"] <= 40


def test_the_modes_of_a_mesh_whose_rounding_lies_above_them(run_deck):
    """Of a rod that turns its crank freely: a motion of frequency 0 and vibrations as those of a coarser mesh, to 8 digits."""
    found = []
    for elements in (800, 5000):
        deck = re.sub("&force.*\n", "", scenes.slider_crank(elements, "&modal modes=4 /\n"))
        table = np.loadtxt(run_deck(deck, name=f"e{elements}").folder / "modes.txt")
        found.append(table[:, 3])
    assert found[0][0] == found[1][0] == 0.0
    np.testing.assert_allclose(found[1][1:], found[0][1:], rtol=3e-7)
    assert found[1][1] == pytest.approx(534.13395960, rel=1e-8)


def reduced(reference: str, elements: int, modes: int = 4) -> str:
    """Return a body of two materials, one viscoelastic and one with Rayleigh damping, in its lowest modes."""
    half = elements // 2
    return f"""&scene title='a fine mesh', gravity=0.0,0.0 /
&material name='soft', young=2.0e10, density=7800.0, ghm_alpha=0.4, ghm_zeta=2.0, ghm_omega=1e4 /
&material name='steel', young=2.0e11, density=7800.0, rayleigh_mass=3.0, rayleigh_stiffness=1e-5 /
&section name='s', area=1e-4, inertia=8.333333333333333e-10 /
&body name='b', kind='beam', length=1.0, elements={elements}, modes={modes}, reference='{reference}', section='s',
  element_material={half}*'soft',{elements - half}*'steel' /
&modal modes={modes} /
"""


@pytest.mark.parametrize("reference", ["free", "clamped", "pinned"])
def test_the_modes_of_a_body_keep_their_digits_in_a_fine_mesh(run_deck, reference):
    """Frequencies and damping with 300 and with 6,000 elements, whose stiffness is rounded by more than the lowest bending has."""
    found = []
    for elements in (300, 6000):
        run = run_deck(reduced(reference, elements), name=f"e{elements}")
        found.append(np.loadtxt(run.folder / "modes.txt")[:, 2:9])
    sizes = abs(found[0]).max(axis=0)
    np.testing.assert_allclose(found[1] / sizes, found[0] / sizes, rtol=1e-7, atol=1e-9)


CARRIES = "double precision does not carry the stiffness of this mesh; expected fewer elements"


def test_a_mesh_that_double_precision_does_not_carry_is_refused(run_deck):
    run = run_deck(reduced("free", 50000), expect=2)
    assert CARRIES in run.stderr
    assert not run.folder.exists()


@pytest.mark.parametrize("reference", ["clamped", "free"])
def test_static_shapes_of_a_fine_mesh_are_right_or_refused(run_deck, reference):
    """Their factor has no large shift; whether it keeps a digit to correct depends on roundings."""
    found = []
    for elements in (300, 3000, 7000):
        deck = reduced(reference, elements).replace("section='s',", "section='s' static_shapes=.true.,")
        deck += "&force name='f' type='force' body='b' node=-1 fy=1.0 /\n"
        run = run_deck(deck, name=f"e{elements}", expect=None)
        if run.status == 2:
            assert elements > 3000
            assert CARRIES in run.stderr
        else:
            found.append(np.loadtxt(run.folder / "modes.txt")[:5, 3])
            np.testing.assert_allclose(found[-1], found[0], rtol=1e-6, atol=1e-9 * found[0].max())
