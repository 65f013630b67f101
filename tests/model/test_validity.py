"""The validity watch warns where the model no longer holds, names the body, and is silent on the near side of each limit."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
import scipy.linalg

LENGTH, AREA, INERTIA, YOUNG, DENSITY = 0.8, 1.0e-4, 8.0e-10, 2.0e9, 1000.0
EI = YOUNG * INERTIA
FIRST = 1.87510406871196**2 * math.sqrt(EI / (DENSITY * AREA)) / LENGTH**2  # of the cantilever [rad/s]
SILENT = "validity: spins and excited frequencies stay within what the model can tell"
HEAD = f"""&scene title='v' /
&material name='m' density={DENSITY} young={YOUNG} /
&section name='s' area={AREA} inertia={INERTIA} /
"""


def body(name: str, more: str, elements: int = 4) -> str:
    """Return a beam on its own ground pivot, which its node 1 keeps."""
    return f"&body name='{name}' kind='beam' length={LENGTH} elements={elements} material='m' section='s' {more} /\n"


def transient(t_end: float, step: float, output_step: float) -> str:
    """Return a &transient group."""
    return f"&transient t_end={t_end!r} method='rk4' step={step!r} output_step={output_step!r} /\n"


def slow_force(size: float, node: int) -> str:
    """Return a force on the beam 'b' across it, applied slowly against its first period."""
    return (
        "&history name='slow' kind='ramp' start_value=0.0 end_value=1.0 start=0.0 finish=6.0 /\n"
        f"&force name='f' type='force' body='b' node={node} fy={size!r} history='slow' /\n"
    )


def told(run) -> list[str]:
    """Return the warnings of validity; those of the summary are the same, and where there are none it says that all is well."""
    warnings = [line[line.index("warning:") :] for line in run.stderr.splitlines() if "warning: body" in line]
    assert [line.strip() for line in run.summary.splitlines() if line.strip().startswith("warning: body")] == warnings
    assert (SILENT in run.summary) == (not [line for line in warnings if "short and thick" not in line])
    return warnings


@pytest.mark.parametrize(("share", "warned"), [(0.097, False), (0.103, True)])
def test_deflection_beyond_a_tenth_of_the_length(run_deck, share, warned):
    force = 3 * EI * share / LENGTH**2
    other = body("quiet", "axial=.false. reference='clamped' position=0.0,2.0") + (
        "&joint name='o' type='weld' body_a='quiet' node_a=1 point_b=0.0,2.0 /\n"
    )
    deck = HEAD + body("b", "axial=.false. reference='clamped'") + "&joint name='w' type='weld' body_a='b' node_a=1 /\n"
    lines = told(run_deck(deck + other + slow_force(force, -1) + transient(6.5, 4.0e-4, 0.02)))
    assert len(lines) == warned
    if warned:
        found = re.fullmatch(r'warning: body "b" deflects by (\S+) % of its length: .*', lines[0])
        assert float(found[1]) == pytest.approx(100 * share, rel=0.02)


@pytest.mark.parametrize(("rotation", "warned"), [(0.195, False), (0.205, True)])
def test_rotations_beyond_a_fifth(run_deck, rotation, warned):
    """Pinned at both ends, pressed in the middle: the ends turn by F L^2/(16 E I)."""
    deck = HEAD + body("b", "axial=.false.") + "&joint name='p' type='revolute' body_a='b' node_a=1 /\n"
    deck += "&joint name='r' type='slider' body_a='b' node_a=-1 /\n"
    lines = told(run_deck(deck + slow_force(16 * EI * rotation / LENGTH**2, 3) + transient(6.5, 4.0e-4, 0.02)))
    assert len(lines) == warned
    if warned:
        found = re.fullmatch(r'warning: body "b" turns a section by (\S+) rad in its frame: .*', lines[0])
        assert float(found[1]) == pytest.approx(rotation, abs=0.006)  # told to two digits


@pytest.mark.parametrize(
    ("share", "more", "warned"),
    [
        (0.325, "axial=.false.", False),
        (0.345, "axial=.false.", True),
        (0.345, "modes=3", True),
        (0.325, "modes=3", False),
        (0.6, "stiffening=.true.", False),
    ],
)
def test_spin_beyond_a_third_of_the_first_frequency(run_deck, share, more, warned):
    """Without stiffening; with it a fast spin is in order. The spin grows slowly, so that nothing else is passed."""
    deck = HEAD + body("b", f"reference='clamped' {more}", elements=2) + "&joint name='p' type='revolute' body_a='b' node_a=1 /\n"
    deck += f"&history name='s' kind='ramp' start_value=0.0 end_value={share * FIRST!r} start=0.0 finish=20.0 /\n"
    deck += "&drive name='m' type='rotation' body_a='b' node_a=1 history='s' rate=.true. /\n"
    lines = told(run_deck(deck + transient(21.0, 2.0e-4, 0.1)))
    assert len(lines) == warned
    if warned:
        found = re.fullmatch(r'warning: body "b" spins at (\S+) of its lowest bending frequency without stiffening.*', lines[0])
        assert float(found[1]) == pytest.approx(share, abs=0.006)


@pytest.mark.parametrize(
    ("elements", "more", "share", "warned"),
    [(2, "", 1.3, True), (2, "", 0.3, False), (5, "", 1.3, False), (4, "modes=2", 3.0, True), (4, "modes=5", 3.0, False)],
)
def test_motion_that_the_mesh_cannot_carry(run_deck, elements, more, share, warned):
    """The base is shaken at a share of the frequency whose half wave is one of two elements (or at one beyond two modes)."""
    carried = (math.pi / (LENGTH / 2)) ** 2 * math.sqrt(EI / (DENSITY * AREA))
    if more == "modes=2":
        carried = 4.69409113297417**2 * math.sqrt(EI / (DENSITY * AREA))
    frequency = share * carried / (2 * math.pi)
    deck = HEAD + body("b", f"reference='clamped' axial=.false. {more}", elements)
    deck += "&joint name='guide' type='prismatic' body_a='b' node_a=1 direction=1.5707963267948966 /\n"
    deck += f"&history name='s' kind='sine' offset=1.0e-4 amplitude=1.0e-4 frequency={frequency!r}\n phase=-1.5707963267948966 /\n"
    deck += "&drive name='m' type='position' body_a='b' node_a=1 direction=1.5707963267948966 history='s' /\n"
    lines = told(run_deck(deck + transient(1.0, 1.0e-4, 1.0e-3)))
    assert len(lines) == warned
    if warned:
        found = re.fullmatch(r'warning: body "b" moves elastically at (\S+) rad/s, faster than its mesh or modes can .*', lines[0])
        assert float(found[1]) > carried


@pytest.mark.parametrize("length", [0.1, 0.3, 1.0, 8.0])
def test_what_a_mesh_carries_scales_with_its_elements(run_deck, length):
    """One element pinned at its ends rings 1.11 times faster than half a wave on it; two, clamped, 0.576 times as fast."""
    scale = math.sqrt(EI / (DENSITY * AREA)) / length**2
    pinned, clamped = math.sqrt(120.0) / math.pi**2, 22.736 / (2 * math.pi) ** 2
    for elements, first, last, ratio in ((1, "revolute", "slider", pinned), (2, "weld", "weld", clamped)):
        share = ratio * (elements * math.pi) ** 2 * scale
        reference = "pinned" if elements == 1 else "clamped"
        deck = HEAD.replace("title='v'", "title='v' gravity=0.0,-1.0e-3") + body("b", "axial=.false.", elements).replace(
            f"length={LENGTH}", f"length={length} reference='{reference}'"
        )
        deck += f"&joint name='p' type='{first}' body_a='b' node_a=1 /\n"
        deck += f"&joint name='q' type='{last}' body_a='b' node_a=-1 point_b={length},0.0 /\n"
        period = 2 * math.pi / share
        lines = told(run_deck(deck + transient(10 * period, period / 200, period / 20), name=f"e{elements}"))
        lines = [line for line in lines if "short and thick" not in line]  # the shortest is
        lines = [line for line in lines if "redundant" not in line]  # as two welds of a body without axial deformation are
        assert len(lines) == (1 if ratio > 1 else 0), lines
        if lines:
            found = re.search(r"moves elastically at (\S+) rad/s", lines[0])
            assert float(found[1]) == pytest.approx(share, rel=0.02)


def test_rotations_count_by_the_length_of_an_element(run_deck):
    """A moment at the tip of one long clamped element rings both its modes: their mean squares, of a Hermite element, are told.

    A rotation counts as the deflection that it gives half an element away.
    """
    length = 8.0
    stiffness = EI / length**3 * np.array([[12.0, -6.0 * length], [-6.0 * length, 4.0 * length**2]])
    mass = DENSITY * AREA * length / 420 * np.array([[156.0, -22.0 * length], [-22.0 * length, 4.0 * length**2]])
    squares, shapes = scipy.linalg.eigh(stiffness, mass)
    size = np.array([1.0, (length / 2) ** 2]) @ (shapes * (shapes[1] / squares)) ** 2  # of each mode's amplitude
    expected = math.sqrt((size @ squares**2) / (size @ squares))
    deck = HEAD + body("b", "axial=.false. reference='clamped'", 1).replace(f"length={LENGTH}", f"length={length}")
    deck += "&joint name='w' type='weld' body_a='b' node_a=1 /\n"
    deck += f"&force name='f' type='torque' body='b' node=-1 moment={1.0e-3 * EI / length!r} /\n"
    period = 2 * math.pi / math.sqrt(squares[1])
    lines = told(run_deck(deck + transient(60 * period, period / 100, 0.1 * period)))
    found = re.search(r"moves elastically at (\S+) rad/s", lines[0])
    assert float(found[1]) == pytest.approx(expected, rel=0.02)


def test_one_mode_that_rings_is_carried(run_deck):
    """A body kept with one mode rings at that mode's frequency: no warning, whatever part of a period the run ends in."""
    deck = HEAD + body("b", "reference='clamped' modes=1")
    deck += "&joint name='w' type='weld' body_a='b' node_a=1 /\n&force name='f' type='force' body='b' node=-1 fy=1.0e-2 /\n"
    period = 2 * math.pi / FIRST
    for part in (0.3, 0.6, 0.9, 1.25, 5.0):
        assert told(run_deck(deck + transient(part * period, 1.0e-3, part * period / 50), name=f"part{part}")) == []


def test_rigid_bodies_are_never_warned_of(run_deck):
    deck = HEAD + body("b", "flexible=.false. angular_velocity=500.0") + "&joint name='p' type='revolute' body_a='b' node_a=1 /\n"
    assert told(run_deck(deck + transient(0.1, 1.0e-4, 1.0e-3))) == []


@pytest.mark.parametrize("height", [0.06, 0.09, 0.5])
def test_beams_that_are_not_slender(run_deck, height):
    """Pinned, 1 m long: the lowest frequency loses k2 r2 (1 + E/(kappa G))/2; a per cent at about a thirteenth of the length."""
    deck = f"""&scene gravity=0.0,-1.0 /
&material name='m' density=7800.0 young=2.1e11 /
&section name='s' shape='rectangle' width=0.02 height={height} /
&body name='b' kind='beam' length=1.0 elements=6 material='m' section='s' axial=.false. /
&joint name='p' type='revolute' body_a='b' node_a=1 /
&joint name='r' type='slider' body_a='b' node_a=-1 /
"""
    first = 0.5 * math.pi**2 * height**2 / 12 * (1 + 3.12)
    expected = 1 - 1 / math.sqrt(1 + 2 * first)
    bent = transient(1.0e-3, 1.0e-6, 1.0e-4)
    response = "&force name='f' type='force' body='b' node=3 fy=1.0 /\n&sensor name='s' quantity='deflection' body='b' node=3 /\n"
    response += "&frequency_response from=1.0 to=9.0 points=3 input='f' /\n"
    for k, analysis in enumerate((bent, "&static /\n", "&modal /\n", response, "&modal /\n" + bent)):
        run = run_deck(deck + analysis, name=f"a{k}")
        found = re.findall(r'body "b" is so short and thick .* frequency by (\S+) %', run.stderr)
        assert len(found) == (expected > 0.01)
        if found:
            assert float(found[0]) == pytest.approx(100 * expected, rel=0.01)


@pytest.mark.parametrize("modes", [1, 2, 4])
def test_modes_that_are_kept_are_in_use(run_deck, modes):
    """A pinned beam 1 m long and 0.05 m high: k = n pi of the highest mode in bending; the first mode along it does not count."""
    deck = f"""&scene gravity=0.0,-1.0 /
&material name='m' density=7800.0 young=2.1e11 /
&section name='s' shape='rectangle' width=0.02 height=0.05 /
&body name='b' kind='beam' length=1.0 elements=24 material='m' section='s' modes={modes} /
&joint name='p' type='revolute' body_a='b' node_a=1 /
&joint name='r' type='slider' body_a='b' node_a=-1 /
"""
    highest = {1: 1, 2: 2, 4: 3}[modes]  # the fourth is the first along the axis: pi/2 c/l against 16 pi2 r c/l2
    expected = 1 - 1 / math.sqrt(1 + (highest * math.pi) ** 2 * 0.05**2 / 12 * (1 + 3.12))
    run = run_deck(deck + transient(1.0e-3, 1.0e-6, 1.0e-4))
    found = re.search(r'body "b" is so short and thick .* (\w+) frequency by (\S+) %', run.stderr)
    assert (found is not None) == (expected > 0.01)
    if found:
        assert found[1] == "kept"
        assert float(found[2]) == pytest.approx(100 * expected, rel=0.02)


def test_frequencies_outside_the_band_of_a_material(run_deck):
    """`band`: known moduli end there. The cantilever swings at 3.5 Hz, its second mode at 22 Hz."""
    swing = body("b", "axial=.false. reference='clamped'") + "&joint name='w' type='weld' body_a='b' node_a=1 /\n"
    more = "&modal modes=2 /\n&force name='f' type='force' body='b' node=-1 fy=1e-3 /\n"
    more += "&frequency_response input='f' from=1.0 to=50.0 points=50 spacing='linear' /\n"
    for band, modes, points, moves in (
        ("1,100", 0, 0, 0),
        ("10,22.5", 1, 37, 1),
        ("4,9 ghm_frequency_scale=2.5", 1, 37, 1),  # the same band
        ("0.1,1", 2, 49, 1),
    ):
        terms = f"prony_alpha=0.01 prony_tau=0.01 band={band}"
        run = run_deck((HEAD + swing + more + transient(1.5, 4.0e-4, 0.02)).replace(f"young={YOUNG}", f"young={YOUNG} {terms}"))
        nouns = ("damped modes", "frequencies of the response")
        counts = [re.search(rf"warning: (\d+) of \d+ {noun}, from", run.stderr) for noun in nouns]
        assert [int(found[1]) if found else 0 for found in counts] == [modes, points], band
        assert run.stderr.count('warning: the elastic motion of body "b"') == moves, band
        assert (SILENT in run.summary) == (not moves), band
        assert run.stderr.count('outside the band of material "m"') == bool(modes) + bool(points) + moves


def held_beam(reference: str, joint: str) -> str:
    """Return a beam of six elements damped in proportion to mass, with three modes wanted."""
    return (
        "&material name='m' density=2000.0 young=3.0e9 rayleigh_mass=20.0 /\n"
        "&section name='s' shape='rectangle' width=0.02 height=0.01 /\n"
        f"&body name='b' kind='beam' length=0.5 elements=6 material='m' section='s' {reference} /\n"
        f"{joint}&modal modes=6 /\n"
    )


def damped_as_moved(run) -> bool:
    """Return whether the first three modes that bend have the damping ratio alpha/(2 omega)."""
    rows = [line.split() for line in (run.folder / "modes.txt").read_text("utf-8").splitlines() if line[:1] not in "#"]
    figures = np.array([row[:7] for row in rows if int(float(row[2])) == 1], float)
    expected = 20.0 / (2 * 2 * np.pi * figures[:3, 3])
    return len(figures) >= 3 and np.allclose(figures[:3, 5], expected, rtol=0.1)


PIN = "&joint name='p' type='revolute' body_a='b' node_a=1 /\n"
PIN += "&joint name='r' type='slider' body_a='b' node_a=-1 point_b=0.5,0.0 /\n"


@pytest.mark.parametrize(
    ("reference", "joint"),
    [
        ("", "&joint name='w' type='weld' body_a='b' node_a=1 /\n"),
        ("modes=6", "&joint name='w' type='weld' body_a='b' node_a=1 /\n"),
        ("reference='clamped'", "&joint name='w' type='weld' body_a='b' node_a=-1 point_b=0.5,0.0 /\n"),
        ("reference='free' modes=6", "&joint name='w' type='weld' body_a='b' node_a=3 /\n"),
        ("reference='clamped'", PIN),
        ("reference='clamped' modes=6", ""),
    ],
)
def test_damping_by_mass_is_that_of_the_held_body_or_told(run_deck, reference, joint):
    """The reference that a warning names gives alpha/(2 omega), and is not warned of; the one that the deck has does not."""
    run = run_deck(held_beam(reference, joint))
    told_ratios = re.search(
        r"its mode of (\S+) Hz has the damping ratio (\S+) of it, alpha/\(2 omega\) is (\S+); (reference\S*( reference_dof=\S+)?)",
        run.stderr,
    )
    assert told_ratios
    assert not damped_as_moved(run)
    assert float(told_ratios[3]) == pytest.approx(20.0 / (4 * np.pi * float(told_ratios[1])), rel=1e-4)
    modes = " modes=6" if "modes" in reference else ""
    better = run_deck(held_beam(told_ratios[4] + modes, joint), name="better")
    assert "rayleigh_mass" not in better.stderr
    assert damped_as_moved(better)


def test_damping_by_mass_of_a_welded_cantilever_has_the_share_of_its_shape(run_deck):
    """Against a frame through both ends, 1.4 % of the first shape's square are left besides its chord: 0.0117 for 0.201."""
    x = np.linspace(0.0, 1.0, 20001)
    k = 1.87510406871196
    c = (np.cosh(k) + np.cos(k)) / (np.sinh(k) + np.sin(k))
    shape = np.cosh(k * x) - np.cos(k * x) - c * (np.sinh(k * x) - np.sin(k * x))
    share = np.trapezoid((shape - shape[-1] * x) ** 2, x) / np.trapezoid(shape**2, x)
    run = run_deck(held_beam("", "&joint name='w' type='weld' body_a='b' node_a=1 /\n"))
    found = re.search(r"damping ratio (\S+) of it, alpha/\(2 omega\) is (\S+);", run.stderr)
    assert float(found[1]) / float(found[2]) == pytest.approx(share, rel=2e-3)


def test_welded_pieces_are_damped_as_one_body(run_deck):
    """Each frame follows its piece: what is left of the damping falls with the number of pieces, and no reference helps."""
    half = "kind='beam' length=0.25 elements=4 material='m' section='s' reference='clamped'"
    run = run_deck(
        "&material name='m' density=2000.0 young=3.0e9 rayleigh_mass=20.0 /\n"
        "&section name='s' shape='rectangle' width=0.02 height=0.01 /\n"
        f"&body name='a' {half} /\n&body name='b' {half} position=0.25,0.0 /\n"
        "&joint name='w' type='weld' body_a='a' node_a=1 /\n"
        "&joint name='v' type='weld' body_a='a' node_a=-1 body_b='b' node_b=1 /\n&modal modes=3 /\n"
    )
    found = re.search(r'body "a" \(welded to 1 more\).* Hz has the damping ratio (\S+) of it, .* no reference agrees', run.stderr)
    rows = [line.split() for line in (run.folder / "modes.txt").read_text("utf-8").splitlines() if line[:1] not in "#"]
    ratio = [float(row[5]) for row in rows if int(float(row[2])) == 1]
    assert float(found[1]) == pytest.approx(ratio[0], rel=0.02)


WALL, HINGE, ROLLER, GUIDE = (
    "&joint name='w' type='weld' body_a='b' node_a=1 /\n",
    "&joint name='w' type='revolute' body_a='b' node_a=1 /\n",
    f"&joint name='v' type='slider' body_a='b' node_a=-1 point_b={LENGTH},0.0 /\n",
    f"&joint name='v' type='prismatic' body_a='b' node_a=-1 point_b={LENGTH},0.0 /\n",
)
EULER = {WALL: math.pi**2 / 4, HINGE + ROLLER: math.pi**2, WALL + ROLLER: 20.190729, WALL + GUIDE: 4 * math.pi**2}


@pytest.mark.parametrize(
    ("joints", "more"),
    [(joints, more) for joints in EULER for more in ("", "reference='clamped'", "axial=.false.")]
    + [(WALL, "modes=6 reference='clamped'")],
)
@pytest.mark.parametrize("share", [0.31, 0.36, -0.36])
def test_loads_along_a_beam_are_measured_by_eulers_loads(run_deck, joints, more, share):
    """As the joints hold the beam, whatever its frame and its coordinates are."""
    load = share * EULER[joints] * EI / LENGTH**2
    deck = HEAD + body("b", more, 8) + joints + f"&force name='f' type='force' body='b' node=-1 fx={-load!r} /\n"
    lines = [line for line in run_deck(deck + "&static /\n").stderr.splitlines() if " along its axis by " in line]
    assert len(lines) == (abs(share) > 1 / 3)
    if lines:
        assert ("is pressed" if share > 0 else "is pulled") in lines[0]
        assert float(re.search(r"along its axis by (\S+) of", lines[0])[1]) == pytest.approx(abs(share), abs=0.011)


@pytest.mark.parametrize(("load", "warned"), [(2.5, False), (2.7, True)])
def test_a_column_under_its_own_weight(run_deck, load, warned):
    """It buckles at 7.837 EI/L^3 for a metre (Greenhill); the axial force is that of the weight above."""
    gravity = load * EI / LENGTH**3 / (DENSITY * AREA)
    deck = f"&scene gravity={-gravity!r},0.0 /\n" + HEAD.replace("&scene title='v' /\n", "")
    deck += body("b", "reference='clamped'", 8) + WALL + "&static /\n"
    found = re.search(r"pressed along its axis by (\S+) of its critical load", run_deck(deck).stderr)
    assert (found is not None) == warned
    if warned:
        assert float(found[1]) == pytest.approx(load / 7.837, abs=0.011)


def test_a_load_along_a_beam_in_motion(run_deck):
    """A ramp to half of the critical load in a transient; with stiffening, or cut into pieces, nothing is left out."""
    push = f"&force name='f' type='force' body='b' node=-1 fx={-EULER[WALL] * EI / LENGTH**2 / 2!r} history='h' /\n"
    push = "&history name='h' kind='ramp' start_value=0.0 end_value=1.0 start=0.0 finish=1.0 /\n" + push
    end = "&transient t_end=1.0 method='radau' tolerance=1e-4 output_step=0.1 /\n"
    run = run_deck(HEAD + body("b", "reference='clamped'") + WALL + push + end)
    assert float(re.search(r"pressed along its axis by (\S+) of its critical load", run.stderr)[1]) == pytest.approx(0.5, abs=0.02)
    assert run.summary.count("along its axis") == 1
    assert "along its axis" not in run_deck(HEAD + body("b", "reference='clamped' stiffening=.true.") + WALL + push + end).stderr


def test_bodies_made_alike_have_one_warning_also_in_a_check(run_deck):
    """Four thick links and a thicker one: two sentences."""
    deck = "&material name='m' density=1200.0 young=1e7 /\n&section name='s' shape='rectangle' width=0.01 height=0.01 /\n"
    deck += "&section name='t' shape='rectangle' width=0.01 height=0.02 /\n"
    for k in range(5):
        deck += f"&body name='b{k}' kind='beam' length=0.1 elements=3 material='m' section='{'ts'[k > 0]}' position={k}e-1,0 /\n"
        deck += f"&joint name='j{k}' type='revolute' body_a='b{k}' node_a=1 "
        deck += f"body_b='b{k - 1}' node_b=-1 /\n" if k else "/\n"
    deck += "&transient t_end=1e-5 method='radau' tolerance=1e-4 output_step=1e-5 /\n"
    for options in ([], ["--check"]):
        told = [line for line in run_deck(deck, *options).stderr.splitlines() if "short and thick" in line]
        assert len(told) == 2
        assert 'body "b0" is so' in told[0]
        assert 'body "b1" (with 3 like it) is so' in told[1]


def test_a_frame_at_a_node_of_a_fine_mesh_is_named(run_deck):
    """One body has no uneven masses: its frame, which stands at one of 10,000 nodes, has no inertia beside the mesh."""
    deck = """&material name='m' density=1600 young=2.1e10 /
&section name='s' shape='rectangle' width=0.02 height=0.005 /
&body name='rod' kind='beam' length=0.35 elements=10000 material='m' section='s' reference='clamped' /
&joint name='w' type='weld' body_a='rod' node_a=1 /
&static /
"""
    told = run_deck(deck, expect=2).stderr
    assert "uneven" not in told
    assert "clamped at a node of so fine a mesh" in told
    assert "expected reference='pinned' or fewer elements" in told


def turned_beam(pieces: int, angle: float, time: float) -> str:
    """Return a hub that turns a beam of welded pieces, one metre in all."""
    length = 1.0 / pieces
    deck = f"""&material name='m' density=2700.0 young=7.0e10 rayleigh_stiffness=2.0e-4 /
&section name='s' shape='rectangle' width=0.02 height=0.006 /
&body name='hub' mass=5.0 inertia=0.1 /
&joint name='axle' type='revolute' body_a='hub' /
&history name='r' kind='ramp' start_value=0.0 end_value={angle} start=0.0 finish={time} /
&drive name='d' type='rotation' body_a='hub' history='r' /
"""
    for k in range(pieces):
        before = f"body_b='b{k - 1}' node_b=-1" if k else "body_b='hub' point_b=0.1,0.0"
        deck += f"&body name='b{k}' kind='beam' length={length!r} elements={12 // pieces} section='s' material='m' "
        deck += "reference='clamped' "
        deck += f"position={0.1 + k * length!r},0.0 /\n&joint name='w{k}' type='weld' body_a='b{k}' node_a=1 {before} /\n"
    deck += f"&sensor name='tip' quantity='position' body='b{pieces - 1}' node=-1 /\n"
    deck += "&sensor name='hub' quantity='angle' body='hub' /\n"
    return deck + f"&transient t_end={2 * time!r} method='radau' tolerance=1e-5 output_step={time / 40!r} /\n"


@pytest.mark.parametrize(("angle", "time"), [(1.0, 0.5), (1.5, 0.5), (1.5, 0.42)])
def test_what_linear_deflections_leave_out(run_deck, angle, time):
    """Within a factor of two of what one body differs from six welded ones; less with two, each against its own frame."""
    tips, told_shares = [], []
    for pieces in (1, 2, 6):
        run = run_deck(turned_beam(pieces, angle, time), name=f"pieces{pieces}")
        turn = np.exp(-1j * run.history["hub"])
        tips.append((run.history["tip.x"] + 1j * run.history["tip.y"]) * turn - 1.1)
        told_shares.append(run.transient["left_out_percent"] / 100)
    true = np.abs(tips[0] - tips[2]).max() / np.abs(tips[2]).max()
    assert true / 2 < told_shares[0] < 2 * true
    assert told_shares[1] < 0.7 * told_shares[0]


def test_stiffened_and_rigid_bodies_leave_out_no_shortening(run_deck):
    deck = turned_beam(1, 1.0, 0.5)
    plain = run_deck(deck, name="a")
    stiff = run_deck(deck.replace("'clamped' ", "'clamped' stiffening=.true. "), name="b")
    assert stiff.transient["left_out_percent"] < 0.1 * plain.transient["left_out_percent"]
    rigid = run_deck(deck.replace("'clamped' ", "'clamped' flexible=.false. "), name="c")
    assert "left_out_percent" not in rigid.transient
