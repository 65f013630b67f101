"""Modes and poles of random scenes against all eigenvalues of the same scene, made dense and of first order.

The matrices are those of the linearisation (which `test_linearisation.py` holds against finite differences); null space of the
constraints, internal variables in the space that each set of terms deforms, and the eigenvalues are numpy's.
"""

import json
import math
import re
import subprocess

import numpy as np
import pytest
from biela.histories import read
from linear_oracle import Dense

UNDAMPED, VIBRATION, FURTHER, REAL = range(4)


def material(rng, name):
    text = f"&material name='{name}' density={rng.uniform(1000, 3000):.6g} young={10 ** rng.uniform(7.5, 9.5):.6g}"
    terms = rng.integers(0, 4)
    if terms:
        text += ghm(rng, terms)
    if rng.random() < 0.3:
        text += f" rayleigh_mass={rng.uniform(0.1, 5):.6g} rayleigh_stiffness={10 ** rng.uniform(-6, -4):.6g}"
    return text + " /\n"


def ghm(rng, terms):
    lists = [10 ** rng.uniform(low, high, terms) for low, high in ((-1, 0.4), (-0.5, 0.5), (1.5, 3.5))]
    return " ghm_alpha={} ghm_zeta={} ghm_omega={}".format(*(",".join(f"{x:.6g}" for x in values) for values in lists))


def scene(seed, elements=(1, 4)):
    """A random scene: beams and rigid bodies on joints and springs, free, turning, or on their own."""
    rng = np.random.default_rng(seed)
    text = "&scene title='random' gravity={},{} /\n".format(*(rng.uniform(-3, 3, 2).round(3) if rng.random() < 0.4 else (0, 0)))
    materials = [f"m{i}" for i in range(rng.integers(1, 4))]
    text += "".join(material(rng, m) for m in materials)
    text += "&section name='s' shape='rectangle' width=0.01 height=0.01 /\n&section name='t' area=7e-5 inertia=1e-9 /\n"
    for b in range(rng.integers(1, 4)):
        spin = f" angular_velocity={rng.uniform(-30, 30):.4g}" if rng.random() < 0.25 else ""
        place = "position={:.4g},{:.4g} angle={:.4g}".format(*rng.uniform(-1, 1, 3)) + spin
        flexible = rng.random() < 0.7
        if flexible:
            n = rng.integers(*elements)
            own = ",".join(f"'{m}'" for m in rng.choice(materials, n))
            reference = rng.choice(["pinned", "clamped", "free"])
            more = f"reference='{reference}'" + (f" modes={rng.integers(1, 4)}" if reference == "free" else "")
            text += f"&body name='b{b}' kind='beam' length={rng.uniform(0.2, 0.6):.4g} elements={n} element_material={own} section="
            text += f"'{rng.choice(['s', 't'])}' {more} {place} /\n"
            end = " node_a=1"
        else:
            text += f"&body name='b{b}' kind='rigid' mass={rng.uniform(0.1, 2):.4g} "
            text += f"inertia={rng.uniform(0.001, 0.05):.4g} {place} /\n"
            end = ""
        kind = rng.choice(["none", "revolute", "weld", "prismatic"]) if not spin else rng.choice(["none", "revolute"])
        x, y = (float(v) for v in re.search(r"position=(\S+),(\S+) ", text.splitlines()[-1] + " ").groups())
        other = f" point_b={x:.6g},{y:.6g}"
        if kind != "none":
            direction = " direction=0.3" if kind == "prismatic" else ""
            text += f"&joint name='j{b}' type='{kind}' body_a='b{b}'{end}{other}{direction} /\n"
        if rng.random() < 0.7:
            text += f"&spring name='t{b}' type='torsional' body_a='b{b}'{end} stiffness={10 ** rng.uniform(0, 2):.4g}"
            text += f" damping={10 ** rng.uniform(-4, -1):.4g}" if rng.random() < 0.5 else ""
            text += (ghm(rng, rng.integers(1, 3)) if rng.random() < 0.5 else "") + " /\n"
        if rng.random() < 0.4 and b > 0:
            first = " node_b=1" if "name='b0' kind='beam'" in text else ""
            text += f"&spring name='l{b}' type='linear' body_a='b{b}'{end} body_b='b0'{first} "
            text += f"stiffness={10 ** rng.uniform(2, 4):.4g} damping=1.0 /\n"
    return text


def means(poles, apart=1e-5):
    """Return poles, those that are double as the mean of both; crowds as they are.

    A double pole with one shape moves by the square root of what is rounded: in numpy by that of the kernels that its BLAS picks.
    The mean moves by the rounding alone.
    """
    near = [poles[np.abs(poles - s) <= apart * abs(s)] for s in poles]
    return np.array([np.mean(both) if len(both) == 2 else s for s, both in zip(poles, near)])


def nearest(found, expected):
    """Return for each found pole its relative distance to an expected one, each of those taken once."""
    left, distances = list(means(expected)), []
    for s in means(found):
        k = int(np.argmin(np.abs(np.array(left) - s)))
        distances.append(abs(left.pop(k) - s) / abs(s))
        if not left:
            break
    return np.array(distances)


class Listed:
    """The rows of modes.txt."""

    def __init__(self, run):
        table = read(run.folder, "modes")
        self.kind, self.mode = table["kind"].astype(int), table["mode"].astype(int)
        self.poles = table["real"] + 1j * table["imag"]
        self.head = [line[2:] for line in (run.folder / "modes.txt").read_text(encoding="utf-8").splitlines() if line[0] == "#"]

    def note(self, word):
        """Return the line on completeness that starts with a word."""
        return next(line for line in self.head if line.startswith(word))

    def vibration(self, mode):
        """Return the poles listed as a mode's vibration."""
        return self.poles[(self.kind == VIBRATION) & (self.mode == mode)]

    def seen(self, dense):
        """Return the damped poles in which the mechanism moves."""
        found = self.poles[self.kind != UNDAMPED]
        for terms, _ in dense.parts:
            for _, zeta, omega in terms.T:
                found = found[np.abs(found**2 + 2 * zeta * omega * found + omega**2) > 1e-6 * omega**2]
        return found


# then: growing motions (30, 51 and 133 have more undamped modes than motions), modes that pass each other, rounding; from 1064:
# rigid motions known to rounding only (23128: and damped), searches that end elsewhere, motions far slower than forces suggest
SEEDS = [*range(0, 14), 19, 30, 51, 133, 180, 186, 200, 219, 393, 1064, 1109, 1181, 2033, 2055, 2100, 2138, 2170, 2253, 5015, 23128]


@pytest.mark.parametrize("seed", SEEDS)
def test_every_pole_of_a_random_scene_is_listed(run_deck, probe, tmp_path, seed):
    """All poles, no more; every undamped mode is followed to its vibration; with few modes the same rows and the same words."""
    deck = scene(seed)
    told = f"seed {seed}\n{deck}"
    all_modes = Listed(run_deck(deck + "&modal modes=999 /\n", name="all"))
    (tmp_path / "dense.nml").write_text(deck, encoding="utf-8")
    dense = Dense(probe, tmp_path / "dense.nml")
    undamped, expected = dense.poles(0.0), dense.poles()
    undamped = undamped[(undamped.imag > 0.0) | (undamped.real > 0.0)]
    mine = all_modes.poles[(all_modes.kind == UNDAMPED) & (np.abs(all_modes.poles) > 0.0)]
    assert len(mine) == len(undamped), told
    assert np.all(nearest(mine, undamped) < 1e-6), told
    assert "complete" in all_modes.note("undamped modes") or not len(mine), told
    if np.any(all_modes.kind != UNDAMPED):
        found = all_modes.seen(dense)
        assert len(found) == len(expected), told
        assert np.all(nearest(found, expected) < 1e-6), told
        assert all_modes.note("poles").startswith("poles: complete, all "), told
    few = Listed(run_deck(deck + "&modal modes=4 /\n", name="few"))
    for mode, kind, pole in zip(few.mode, few.kind, few.poles):
        same = all_modes.poles[(all_modes.kind == kind) & ((all_modes.mode == mode) | (kind > VIBRATION))]
        assert np.min(np.abs(same - pole)) <= 1e-6 * abs(pole), told
    for mode in np.unique(few.mode):
        assert len(few.vibration(mode)) == len(all_modes.vibration(mode)), told
    assert not any("missing" in line or "not counted" in line for line in few.head), told


@pytest.mark.parametrize("seed", [1, 7, 13, 51, 393])
def test_every_mode_is_followed_to_its_vibration(run_deck, probe, tmp_path, seed):
    """By small steps of the damping in the dense system; over-damped modes have none."""
    deck = scene(seed)
    listed = Listed(run_deck(deck + "&modal modes=999 /\n"))
    (tmp_path / "scene.nml").write_text(deck, encoding="utf-8")
    dense = Dense(probe, tmp_path / "scene.nml")
    for mode, pole in zip(listed.mode[listed.kind == UNDAMPED], listed.poles[listed.kind == UNDAMPED]):
        if pole.imag <= 0.0 or not np.any(listed.kind != UNDAMPED):
            continue
        if np.sum(np.abs(listed.poles[listed.kind == UNDAMPED] - pole) < 1e-5 * abs(pole)) > 1:
            continue  # a free body seen from its turning axes: a double pole with one shape
        shape = np.linalg.svd(dense.dynamic(pole, 0.0)[0])[2][-1].conj()
        end = dense.follow(pole, shape)
        if end is not None:
            assert len(listed.vibration(mode)) == 1, f"seed {seed} mode {mode}"
            assert abs(listed.vibration(mode)[0] - end) < 1e-6 * abs(end), f"seed {seed} mode {mode}"


def coupled_arms(arms, elements):
    """Return hinged arms of two viscoelastic materials in turn, sprung at the hinges: every motion couples to every other."""
    text = "&section name='s' shape='rectangle' width=0.02 height=0.01 /\n"
    for k, (zeta, omega) in enumerate(((1.2, 400.0), (2.2, 600.0))):
        text += f"&material name='m{k}' density={1200 + 100 * k} young={1 + k}.0e9 ghm_alpha=0.3,0.4 ghm_zeta={zeta},0.8 "
        text += f"ghm_omega={omega},3000.0 /\n"
    for b in range(arms):
        own = ",".join(f"'m{(e + b) % 2}'" for e in range(elements))
        text += f"&body name='b{b}' kind='beam' length=0.5 elements={elements} element_material={own} section='s' "
        text += f"reference='clamped' position={0.5 * b},0.0 /\n"
        on = f"body_b='b{b - 1}' node_b=-1" if b else ""
        text += f"&joint name='j{b}' type='{'revolute' if b else 'weld'}' body_a='b{b}' node_a=1 {on} /\n"
        if b:
            text += f"&spring name='t{b}' type='torsional' body_a='b{b}' node_a=1 {on} stiffness=50.0 damping=0.01 /\n"
    return text


@pytest.mark.parametrize(("arms", "elements", "modes"), [pytest.param(1, 44, 12, marks=pytest.mark.long), (2, 13, 6)])
def test_a_large_coupled_scene_lists_true_poles(run_deck, probe, tmp_path, arms, elements, modes):
    """More unknowns than are solved as a whole, crowds of internal poles: each that is listed is one, none is twice."""
    deck = coupled_arms(arms, elements)
    listed = Listed(run_deck(deck + f"&modal modes={modes} /\n"))
    (tmp_path / "dense.nml").write_text(deck, encoding="utf-8")
    found = listed.poles[listed.kind != UNDAMPED]
    assert len(found) >= modes
    assert np.all(nearest(found, Dense(probe, tmp_path / "dense.nml").poles()) < 1e-6)
    assert all(len(listed.vibration(mode)) == 1 for mode in range(1, modes + 1))


def test_no_pole_of_all_modes_is_lost(run_deck):
    """More than 400 unknowns of first order, crowds of real poles: as many as numpy finds (`Dense`), each a root."""
    run = run_deck(scene(22044, (13, 22)) + "&modal modes=999 /\n")
    listed = Listed(run)
    assert listed.note("poles") == "poles: complete, all 414 with conjugates"
    assert np.sum(np.where(listed.poles.imag > 0.0, 2, 1)[listed.kind != UNDAMPED]) == 414
    assert np.max(read(run.folder, "modes")["residual"]) <= 1e-7


def test_a_searched_scene_of_mixed_materials_lists_the_poles_of_its_modes(run_deck, probe, tmp_path):
    """Crowds of real poles: those of which the modes asked for hold more than half of the motion are all listed, no others."""
    deck = scene(9, (13, 22))
    listed = Listed(run_deck(deck + f"&modal modes={(few := 4)} /\n"))
    assert "those of the modes asked for" in listed.note("poles")
    (tmp_path / "d.nml").write_text(deck, encoding="utf-8")
    dense = Dense(probe, tmp_path / "d.nml")
    values, vectors = np.linalg.eig(dense.matrix(1.0))
    whole = np.abs(np.diag(dense.stiffness)) + sum(t[0].sum() * np.diag(k) for t, k in dense.parts)
    masses = np.abs(vectors[: len(whole)]) ** 2 / np.maximum(whole, 1e-9 * whole.max())[:, None]  # of the modes in each pole
    seen = (values.imag == 0.0) & (np.abs(values) > 1e-3)
    for terms, _ in dense.parts:
        for _, zeta, omega in terms.T:
            seen &= np.abs(values**2 + 2 * zeta * omega * values + omega**2) > 1e-6 * omega**2
    expected = values[seen & (masses[:few].sum(axis=0) > 0.5 * masses.sum(axis=0))].real
    found = listed.poles[listed.kind == REAL].real
    np.testing.assert_allclose(np.sort(found), np.sort(expected), rtol=1e-6)


@pytest.mark.parametrize("seed", [31, 49, 271])
def test_a_scene_that_is_no_equilibrium_has_its_rigid_motions(run_deck, probe, tmp_path, seed):
    """Rigid motions are null vectors of an unsymmetric K, each is listed once, at zero, and not among the damped poles.

    31: natural modes do not span the null vectors; 49: nor what they cause at constant rates; 271: a search for a
    damped pole ends at a rigid motion.
    """
    modes = [1, 2, 3, 4, 6, 8][seed % 6]
    deck = scene(seed, (13, 22))
    run = run_deck(deck + f"&modal modes={modes} /\n")
    listed = Listed(run)
    assert "complete, " in listed.note("poles")
    (tmp_path / "d.nml").write_text(deck, encoding="utf-8")
    expected = Dense(probe, tmp_path / "d.nml").poles(0.0)
    expected = expected[(np.abs(expected) > 1e-2) & ((expected.imag > 1e-9 * np.abs(expected)) | (expected.real > 0.0))]
    undamped = listed.poles[listed.kind == UNDAMPED]
    assert np.all(np.abs(listed.poles[listed.kind != UNDAMPED]) > 1e-2)
    assert len(undamped) == modes
    moving = undamped[np.abs(undamped) > 0.0]
    assert np.all(nearest(moving, expected[np.argsort(np.abs(expected))][: len(moving)]) < 1e-6)
    assert np.max(read(run.folder, "modes")["residual"]) <= 1e-7
    assert "not settle" not in listed.note("poles")


def test_the_search_in_a_turning_scene_finds_what_the_whole_solution_has(run_deck):
    """One mode more, and all eigenvalues are computed: the same vibrations, and of the crowds of relaxations true ones."""
    deck = "&material name='m' density=1600.0 young=2.0e9 ghm_alpha=0.4 ghm_zeta=1.4 ghm_omega=300.0 /\n"
    deck += "&section name='s' shape='rectangle' width=0.02 height=0.006 /\n&body name='b' kind='beam' length=0.8 elements=49 "
    deck += "material='m' section='s' reference='clamped' angular_velocity=9.0 /\n&lump body='b' node=-1 mass=0.05 /\n"
    deck += "&joint name='j' type='revolute' body_a='b' node_a=1 /\n&spring name='t' type='torsional' body_a='b' node_a=1 "
    deck += "stiffness=40.0 damping=0.05 /\n&modal modes={} /\n"
    few, more = (Listed(run_deck(deck.format(modes), name=f"m{modes}")) for modes in (3, 4))
    assert "those of the modes asked for" in few.note("poles")
    assert "of the relaxations not all" in few.note("poles")
    assert "complete, " in more.note("poles")
    for kind in (UNDAMPED, VIBRATION, REAL):
        here, there = (x.poles[(x.kind == kind) & (x.mode <= 3)] for x in (few, more))
        assert len(here) == len(there) or (1 < len(here) < len(there) and kind == REAL)
        assert np.all(nearest(here, there) < 1e-6)


LAWS = {  # terms of the material: one, with a pole of high damping; two with nearly the same frequency, and Maxwell terms
    "one term": {"ghm": ((1.0, 0.3, 3000.0),), "prony": ()},
    "five terms": {"ghm": ((0.2, 0.05, 30.0), (0.2, 0.03, 32.0), (0.2, 0.02, 1200.0)), "prony": ((0.4, 0.01), (0.2, 3e-4))},
}


@pytest.mark.parametrize("law", LAWS)
def test_a_searched_beam_has_all_poles_of_its_modes_and_no_others(run_deck, law):
    """Of one material: each mode has the roots of s^2 + w^2 E(s)/E_R = 0, and what is said of the list is true."""
    terms = LAWS[law]
    text = "&material name='m' density=1500.0 young=2.0e9 ghm_alpha={} ghm_zeta={} ghm_omega={}".format(
        *(",".join(map(str, values)) for values in zip(*terms["ghm"]))
    )
    if terms["prony"]:
        text += " prony_alpha={} prony_tau={}".format(*(",".join(map(str, values)) for values in zip(*terms["prony"])))
    text += " /\n&section name='s' area=2.0e-4 inertia=1.6667e-9 /\n&body name='b' kind='beam' length=0.5 elements=20 material='m' "
    text += "section='s' reference='clamped' /\n&joint name='w' type='weld' body_a='b' node_a=1 /\n&modal modes=3 /\n"
    run = run_deck(text)
    listed = Listed(run)
    below, above = [], []  # E(s)/E_R - 1 = sum of above/below
    for alpha, zeta, omega in terms["ghm"]:
        below.append(np.poly1d([1.0, 2 * zeta * omega, omega**2]))
        above.append(alpha * np.poly1d([1.0, 2 * zeta * omega, 0.0]))
    for alpha, tau in terms["prony"]:
        below.append(np.poly1d([tau, 1.0]))
        above.append(alpha * np.poly1d([tau, 0.0]))
    whole = math.prod(below, start=np.poly1d([1.0]))
    modulus = sum((a * (whole / b)[0] for a, b in zip(above, below)), np.poly1d([0.0]))
    for mode, undamped in zip(listed.mode[listed.kind == UNDAMPED], listed.poles[listed.kind == UNDAMPED]):
        expected = (np.poly1d([1.0, 0.0, 0.0]) * whole + undamped.imag**2 * (whole + modulus)).roots
        mine = listed.poles[(listed.mode == mode) & (listed.kind != UNDAMPED)]
        assert len(mine) == np.sum(expected.imag >= 0.0)
        assert np.all(nearest(mine, expected[expected.imag >= 0.0]) < 1e-6)
    assert listed.note("undamped modes").startswith("undamped modes: 3, complete below ")
    assert "those of the modes asked for, residuals at most" in listed.note("poles")
    figures = json.loads((run.folder / "summary.json").read_text(encoding="utf-8"))
    assert not figures["warnings"]
    assert max(pole["residual"] for pole in figures["modes"]["poles"]) < 1e-12


def test_a_mode_that_the_list_lacks_is_missed(probe, tmp_path):
    """A mesh too fine for all its eigenvalues: whichever mode is left out of the list, the count says so and the run fails."""
    deck = STRIP.format(elements=60, more="") + "&joint name='j' type='weld' body_a='b' node_a=1 /\n&modal modes=6 /\n"
    (tmp_path / "d.nml").write_text(deck, encoding="utf-8")
    done = subprocess.run([str(probe), "completeness", str(tmp_path / "d.nml")], check=True, capture_output=True, text=True)
    whole, *lacking = done.stdout.splitlines()
    assert whole == "F "
    assert len(lacking) == 6
    for line in lacking:
        assert line.startswith("T the modal analysis has not found all modes that were asked for: undamped modes: 7, 1 missing")


@pytest.mark.parametrize("seed", range(6))
def test_free_bodies_on_a_spring_have_their_motions_at_zero(run_deck, seed):
    """Two free rigid bodies, a spring between their mass centres: one stretching motion, five of frequency zero."""
    rng = np.random.default_rng(seed)
    mass, inertia = rng.uniform(0.1, 2.0, 2), rng.uniform(0.01, 0.05, 2)
    stiffness, damping = 10 ** rng.uniform(1, 4), rng.uniform(0.1, 2.0)
    deck = f"&scene gravity=0.0,{rng.choice([0.0, -9.81])} /\n"
    for b in range(2):
        x, y, angle = rng.uniform(-1, 1, 3)
        deck += f"&body name='b{b}' kind='rigid' mass={mass[b]} inertia={inertia[b]} position={x},{y} angle={angle} /\n"
    deck += f"&spring name='s' type='linear' body_a='b0' body_b='b1' stiffness={stiffness} damping={damping} /\n"
    listed = Listed(run_deck(deck + "&modal /\n"))
    reduced = mass.prod() / mass.sum()
    undamped = listed.poles[listed.kind == UNDAMPED]
    assert np.all(undamped[:5] == 0.0), f"seed {seed}"
    np.testing.assert_allclose(undamped[5:].imag, [np.sqrt(stiffness / reduced)], rtol=1e-10)
    expected = np.roots([reduced, damping, stiffness])
    np.testing.assert_allclose(listed.poles[listed.kind == VIBRATION], expected[expected.imag > 0], rtol=1e-10)
    assert "complete, all 2 with" in listed.note("poles"), f"seed {seed}"


ALONE = {
    "pinned": "&body name='b' kind='rigid' mass=0.08 inertia=0.0014 /\n&joint name='j' type='revolute' body_a='b' /\n",
    "rotor": "&body name='b' kind='rigid' mass=0.08 inertia=0.0014 angular_velocity=40.0 /\n"
    "&joint name='j' type='revolute' body_a='b' /\n",
    "free": "&body name='b' kind='rigid' mass=0.08 inertia=0.0014 /\n",
    "slider": "&body name='b' kind='rigid' mass=0.08 inertia=0.0014 /\n&joint name='j' type='slider' body_a='b' direction=0.4 /\n",
}


@pytest.mark.parametrize("name", ALONE)
def test_a_coordinate_on_its_own_has_its_damped_mode(run_deck, name):
    """The search begins at the root itself, where the matrix is singular to the last bit."""
    deck = ALONE[name] + "&spring name='k' type='torsional' body_a='b' stiffness=6.13 damping=0.01 /\n&modal /\n"
    listed = Listed(run_deck(deck))
    expected = np.roots([0.0014, 0.01, 6.13])
    found = listed.poles[listed.kind == VIBRATION]
    np.testing.assert_allclose(found, [expected[expected.imag > 0][0]], rtol=1e-12)


def test_poles_scale_with_the_rates_of_the_scene(run_deck):
    """Two masses that one damped spring couples: with all rates divided by 1e6 the poles are as many, divided by it."""
    deck = "&body name='a' mass=1.0 inertia=1.0 /\n&joint name='ga' type='prismatic' body_a='a' /\n"
    deck += "&body name='b' mass=2.0 inertia=1.0 position=1.0,0.0 /\n&joint name='gb' type='prismatic' body_a='b' /\n"
    deck += "&spring name='s' type='linear' body_a='a' point_b=-1.0,0.0 stiffness={} ghm_alpha=1.0 ghm_zeta=1.5 ghm_omega={} /\n"
    deck += "&spring name='t' type='linear' body_a='a' body_b='b' stiffness={} /\n&modal modes=2 /\n"
    found = []
    for c in (1.0, 1e-6):
        table = read(run_deck(deck.format(300.0 * c**2, 20.0 * c, 200.0 * c**2)).folder, "modes")
        found.append(np.sort_complex((table["real"] + 1j * table["imag"]) / c))
    np.testing.assert_allclose(found[1], found[0], rtol=1e-9)


def test_a_free_beam_in_its_own_modes_has_its_vibrations(run_deck):
    """Each solves s^2 + w^2 E(s)/E_R = 0."""
    deck = "&material name='m' density=1200.0 young=1.0e9 ghm_alpha=0.5 ghm_zeta=1.5 ghm_omega=400.0 /\n"
    deck += "&section name='s' shape='rectangle' width=0.02 height=0.01 /\n&body name='b' kind='beam' length=0.8 elements=8 "
    listed = Listed(run_deck(deck + "material='m' section='s' reference='free' modes=3 /\n&modal /\n"))
    undamped, found = (listed.poles[listed.kind == k] for k in (UNDAMPED, VIBRATION))
    assert np.all(undamped[:3] == 0.0)
    assert len(found) == 3
    modulus = 1 + 0.5 * (found**2 + 1200.0 * found) / (found**2 + 1200.0 * found + 160000.0)
    np.testing.assert_allclose(found**2, undamped[3:].imag ** 2 * -modulus, rtol=1e-8)
    assert "complete, all 12 with conjugates" in listed.note("poles")


STRIP = """&material name='steel' density=7850.0 young=2.1e11 /
&section name='s' shape='rectangle' width=0.02 height=0.002 /
&body name='b' kind='beam' length=1.0 elements={elements} material='steel' section='s' reference='clamped' {more} /
"""
PUSHED = "&joint name='j' type='weld' body_a='b' node_a=1 /\n&force name='f' type='force' body='b' node=-1 fy=1.0 /\n"
TURNED = """&joint name='j' type='revolute' body_a='b' node_a=1 /
&history name='w' kind='polynomial' coefficients=2.0 /
&drive name='d' type='rotation' body_a='b' history='w' rate=.true. /
&static /
"""


@pytest.mark.parametrize(("elements", "rest"), [(300, PUSHED), (400, TURNED)], ids=["pushed", "turning"])
def test_the_lowest_mode_of_a_fine_mesh_is_not_lost(run_deck, elements, rest):
    """K is not symmetric, and the lowest squared frequency is 1e-14 and less of the highest."""
    more = "stiffening=.true." if rest == TURNED else ""
    listed = Listed(run_deck(STRIP.format(elements=elements, more=more) + rest + "&modal modes=3 /\n"))
    exact = np.array([1.8751040687, 4.6940911330, 7.8547574382]) ** 2 * np.sqrt(2.1e11 * 0.002**2 / 12 / 7850.0)
    np.testing.assert_allclose(listed.poles.imag, exact, rtol=1e-5 if rest == PUSHED else 5e-3)
    assert "undamped modes: 3, not counted: there are gyroscopic terms or forces" in listed.note("undamped")


def lumped(seed, modes=0):
    """Return a free beam of two materials beside lumps that weigh up to a thousand times as much."""
    rng = np.random.default_rng(seed)
    elements = int(rng.integers(2, 13))
    length = 10 ** rng.uniform(-2, 2)
    depth = length * 10 ** rng.uniform(-2, -1)
    text = "&scene title='lumps' gravity=0.0,0.0 /\n"
    for k in (1, 2):
        text += f"&material name='m{k}' density={rng.uniform(1e3, 8e3):.6g} young={10 ** rng.uniform(7, 11):.6g} /\n"
    text += f"&section name='s' shape='rectangle' width={depth:.6g} height={depth:.6g} /\n"
    own = ",".join(f"'m{k}'" for k in rng.integers(1, 3, elements))
    text += f"&body name='b' kind='beam' length={length:.6g} elements={elements} element_material={own} section='s' "
    text += f"reference='{rng.choice(['clamped', 'pinned'])}' modes={modes and 3 * elements} /\n"
    for _ in range(2):
        mass = 1e3 * depth**2 * length * 10 ** rng.uniform(-2, 3)
        inertia = mass * length**2 * 10 ** rng.uniform(-3, 1)
        text += f"&lump body='b' node={rng.integers(1, elements + 2)} mass={mass:.6g} inertia={inertia:.6g} /\n"
    return text + "&modal modes=999 /\n"


@pytest.mark.parametrize("seed", [0, 4, 6, 7, 16, 43])
def test_a_body_that_heavy_lumps_weigh_down_has_its_modes(run_deck, seed):
    """The frame moves against the nodes, or against all modes of the body, with hardly any mass: three motions are rigid."""
    nodes, modes = (Listed(run_deck(lumped(seed, modes), name=f"m{modes}")).poles.imag for modes in (0, 1))
    assert np.all(nodes[:3] == 0.0)
    assert np.all(modes[:3] == 0.0)
    np.testing.assert_allclose(modes[3:], nodes[3:], rtol=1e-6)


def first_order_poles(mass, damping, stiffness):
    """Return all eigenvalues of M x'' + C x' + K x = 0 with Im >= 0, sorted."""
    n = len(mass)
    a = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(mass, stiffness), -np.linalg.solve(mass, damping)]])
    poles = np.linalg.eigvals(a)
    return np.sort_complex(np.round(poles[poles.imag > -1e-9], 9))


@pytest.mark.parametrize(("free", "modes"), [(False, 9), (True, 9), (False, 0)], ids=["held", "free", "some"])
@pytest.mark.parametrize("parts", range(2, 7))
def test_poles_of_like_parts_are_told_as_often_as_they_are_there(run_deck, parts, free, modes):
    """Damped pendulums on a sledge: the pole of all motions that do not move it is as often there as there are such motions."""
    deck = "&scene gravity=0,-9.81 /\n&body name='t' mass=5 inertia=0.1 /\n&joint name='rail' type='prismatic' body_a='t' /\n"
    spring = "&spring name='k' type='linear' body_a='t' body_b='ground' point_b=-1,0 stiffness=900 damping=2 /\n"
    deck += "" if free else spring
    mass, damping, stiffness = (np.zeros((parts + 1, parts + 1)) for _ in range(3))
    mass[0, 0], damping[0, 0], stiffness[0, 0] = 5 + parts, 0 if free else 2, 0 if free else 900
    for i in range(1, parts + 1):
        deck += f"&body name='p{i}' mass=1 inertia=0.01 com=0,-0.4 position={0.2 * i},0 /\n"
        deck += f"&joint name='h{i}' type='revolute' body_a='p{i}' body_b='t' point_b={0.2 * i},0 /\n"
        deck += f"&spring name='t{i}' type='torsional' body_a='p{i}' body_b='t' stiffness=0.3 damping=0.05 free_angle=0 /\n"
        mass[i, i], mass[0, i], mass[i, 0] = 0.17, 0.4, 0.4
        damping[i, i], stiffness[i, i] = 0.05, 0.3 + 9.81 * 0.4
    run = run_deck(deck + f"&modal modes={modes or parts} /\n")
    listed = Listed(run)
    right = first_order_poles(mass, damping, stiffness)
    right = right[np.abs(right) > 1e-4]
    found = np.sort_complex(listed.poles[listed.kind != UNDAMPED])
    if modes:
        np.testing.assert_allclose(found, right, rtol=1e-7, atol=1e-7)
    multiple = max(np.roots([0.17, 0.05, 4.224]), key=np.imag)
    undamped = listed.poles[listed.kind == UNDAMPED]
    asked = (np.abs(undamped.imag - np.sqrt(4.224 / 0.17)) < 1e-6).sum()
    assert asked == parts - 1
    assert (np.abs(found - multiple) < 1e-6).sum() == asked
    vibrations = listed.mode[listed.kind == VIBRATION]
    assert len(set(vibrations)) == len(vibrations) == len(found) - (listed.kind == REAL).sum()
    assert "missing" not in run.summary


@pytest.mark.parametrize("times", [1e-3, 1e-6, 1e-7, 1e-9])
def test_fast_relaxations_are_told_or_counted(run_deck, times):
    """The pole of a Maxwell term that is fast beside the motion, -1/time and a little: in the list, or left out and said so."""
    deck = "&body name='m' mass=1 inertia=1 /\n&joint name='rail' type='prismatic' body_a='m' /\n&spring name='k' type='linear' "
    deck += f"body_a='m' point_b=-1,0 stiffness=100 free_length=1 prony_alpha=0.5,0.3 prony_tau={times},0.1 /\n&modal modes=1 /\n"
    run = run_deck(deck)
    listed = Listed(run)
    real = listed.poles[listed.kind == REAL].real
    moves = 0.5 * 100 * times**2  # of that pole, in its distance from -1/time
    told = moves > 1e-13
    assert (np.abs(real * times + 1) < 2 * moves + 1e-12).sum() == told
    note = "poles: complete, all 4 with conjugates" if told else "poles: 3 with conjugates, complete but for 1 of viscoelastic"
    assert note in run.summary
