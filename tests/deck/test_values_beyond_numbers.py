"""Values that numbers of double precision cannot carry: refused with the reason, or computed; never a crash, never NaN."""

from __future__ import annotations

import random
import re
import subprocess

import pytest
from conftest import ROOT

BEAM = """&material name='m' density=1600.0 young=2.1e10 {ghm} /
&section name='s' area=1.6129e-4 inertia=8.6576e-9 /
&body name='rod' kind='beam' length={length} elements=2 material='m' section='s' /
&joint name='crank' type='revolute' body_a='rod' node_a=1 /
&force name='f' body='rod' node=-1 fx=1.0 /
&sensor name='tip' quantity='position' body='rod' node=-1 /
&transient t_end=0.1 step=0.01 /
"""
GHM = "ghm_alpha=0.5 ghm_zeta=1.0 ghm_omega=5000.0"


@pytest.mark.parametrize("ghm", ["", GHM])
@pytest.mark.parametrize(
    ("length", "what"),
    [
        ("1e-40", r"moment of inertia about its origin would be \S+e-1\d\d kg m2"),
        ("1e-18", r"squared bending frequency of an element would be \S+e7\d rad2/s2"),
        ("1e30", r"moment of inertia about its origin would be \S+e8\d kg m2"),
    ],
)
@pytest.mark.parametrize("more", [(), ("--check",)])
def test_a_length_whose_frequencies_do_not_fit_is_a_fault_of_its_body(length, what, more, ghm, run_deck):
    done = run_deck(BEAM.format(length=length, ghm=ghm), *more, expect=2)
    assert re.fullmatch(
        rf"\S+scene.nml:3: body/rod: the {what}, too far from 1 to compute with in double precision; expected 1e-60 to 1e60 "
        r"\(check units\)\n",
        done.stderr,
    )
    assert not done.folder.exists()


@pytest.mark.parametrize("axial", ["", "axial=.false."])
@pytest.mark.parametrize("length", [1e8, 1e9, 1e15])
def test_an_element_so_slender_that_stretch_hides_its_bending(length, axial, run_deck):
    slender = length / 2 > 1e10 * (8.6576e-9 / 1.6129e-4) ** 0.5 and not axial
    done = run_deck(BEAM.format(length=f"{length:g} {axial}", ghm=""), "--check", expect=2 if slender else 0)
    assert ("scene.nml:3: body/rod: an element of 5e" in done.stderr and "1e10 radii of gyration" in done.stderr) == slender


@pytest.mark.parametrize(
    ("mass", "t_end", "told"),
    [
        ("1e40", "0.1", "8: body/wheel: its radius of gyration, 1e-20 m, is lost in rounding beside the size of the scene, 1 m;"),
        ("1e4", "1e-30", ""),
    ],
)
def test_what_rounding_of_positions_hides(mass, t_end, told, run_deck):
    wheel = f"&body name='wheel' mass={mass} inertia=1.0 /\n&joint name='axle' type='revolute' body_a='wheel' /\n"
    deck = BEAM.format(length=1.0, ghm="").replace("t_end=0.1 step=0.01", f"t_end={t_end} method='radau' tolerance=1e-4")
    told_of = run_deck(deck + wheel, expect=2 if told else 0).stderr
    assert ("scene.nml:" + told in told_of) if told else "rounding" not in told_of


@pytest.mark.parametrize("law", ["ghm_alpha=0.5 ghm_zeta=1.0 ghm_omega=1e-58", "prony_alpha=1e-59 prony_tau=1e-59"])
@pytest.mark.parametrize("where", ["material", "spring"])
def test_terms_that_do_not_fit_are_a_fault_of_their_law(law, where, run_deck):
    spring = "&spring name='k' body_a='rod' node_a=-1 stiffness=1.0 {} /\n"
    laws = (law, "") if where == "material" else ("", law)
    run = run_deck(BEAM.format(length=1.0, ghm=laws[0]) + spring.format(laws[1]), "--check", expect=2 if "omega" in law else 0)
    assert not run.status or f"{where}/" in run.stderr
    assert not run.status or re.search(r"the inertia of a GHM term would be 1e116 s2, too far from 1", run.stderr)


@pytest.mark.parametrize("ghm", ["", GHM])
@pytest.mark.parametrize("length", ["1e-13", "1e7"])
def test_advice_of_absurd_lengths_has_room_for_every_number(length, ghm, run_deck):
    done = run_deck(BEAM.format(length=length, ghm=ghm), "--check")
    assert "stable steps of explicit methods" in done.stdout
    assert re.search(r'larger steps by: .* on body "rod"', done.stdout)


@pytest.mark.parametrize("far", ["1e12,0", "0,1e20", "1e40,0"])
@pytest.mark.parametrize("joint", ["weld", "revolute"])
def test_a_force_that_acts_too_far_away_is_a_fault_of_its_body(far, joint, run_deck):
    """Rounding of the angle would move the point by more than the body can tell: joints stay open, work is noise."""
    deck = f"""&body name='b' mass=8.5 inertia=0.044 com=0.1,0.02 angle=0.66 angular_velocity=-2.38 velocity=0.3,-0.2 /
&joint name='j' type='{joint}' body_a='b' point_a=-0.1,0.1 /
&force name='f' axes='body' fx=3 fy=1 body='b' point={{}} /
&transient t_end=0.01 method='dopri5' tolerance=1e-6 /
"""
    run = run_deck(deck.format(far), expect=2)
    assert re.search(r"body/b: a joint or force acts \S+ m from its mass centre, too far for double precision", run.stderr)
    assert not run.folder.exists()
    assert "cannot be trusted" not in run_deck(deck.format("1e6,0")).stderr


@pytest.mark.parametrize("body", ["a", "b"])
def test_an_acceleration_that_does_not_fit_is_a_fault_of_its_force(body, run_deck):
    deck = "".join(f"&body name='{k}' mass=1e-30 inertia=1e-30 com=0.1,0.0 /\n" for k in "ab")
    done = run_deck(deck + f"&force name='f' body='{body}' fx=3e40 fy=4e40 /\n", "--check", expect=2)
    assert "scene.nml:3: force/f: the acceleration of its body would be 5e70 m/s2, too far from 1" in done.stderr


def absurd_deck(choice: random.Random) -> str:
    """A beam on a joint, a body on a spring, analyses at random; magnitudes from 1e-59 to 1e59."""

    def some() -> str:
        power = choice.choice([0, 0, 0, 0, 3, -3, 8, -8, 15, -15, 30, -30, 45, -45, 59, -59])
        return f"{choice.uniform(1, 9):.3g}e{power}"

    ghm = choice.choice(["", f"ghm_alpha={some()} ghm_zeta={choice.choice(['1.0', some()])} ghm_omega={some()}"])
    kind = choice.choice(["", "axial=.false.", "modes=1", "stiffening=.true.", "flexible=.false."])
    lines = [
        f"&material name='m' density={some()} young={some()} {ghm} /",
        f"&section name='s' area={some()} inertia={some()} /",
        f"&body name='rod' kind='beam' length={some()} elements={choice.choice([1, 2, 4])} material='m' section='s' {kind} /",
        "&joint name='crank' type='revolute' body_a='rod' node_a=1 /",
        f"&force name='f' body='rod' node=-1 fx={some()} fy=1.0 /",
        "&sensor name='tip' quantity='position' body='rod' node=-1 /",
    ]
    method = choice.choice(["accept_unstable=.true.", "method='generalized_alpha'"])
    for chance, text in [
        (
            0.5,
            f"&body name='b' mass={some()} inertia={some()} position={some()},0.0 /\n&spring name='k' body_a='b' body_b='rod' "
            f"node_b=-1 stiffness={some()} damping={some()} length={some()} /",
        ),
        (0.3, f"&lump body='rod' node=-1 mass={some()} /"),
        (0.3, "&static /"),
        (0.3, "&frequency_response from=1.0 to=10.0 points=3 input='f' /"),
        (0.6, f"&transient t_end=0.1 step=0.01 {method} /"),
    ]:
        if choice.random() < chance:
            lines.append(text)
    return "\n".join([*lines, "&modal modes=2 /"]) + "\n"


@pytest.mark.parametrize("seed", range(4))
def test_no_magnitude_crashes_or_reaches_a_file_as_no_number(seed, biela, tmp_path):
    choice = random.Random(seed)
    for number in range(25):
        deck = absurd_deck(choice)
        told = f"seed {seed}, deck {number}:\n{deck}"
        folder = tmp_path / str(number)
        path = tmp_path / f"{number}.nml"
        path.write_text(deck, encoding="utf-8")
        command = [biela, "--quiet", "--output", folder, path]
        done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
        assert done.returncode in (0, 1, 2), told + done.stderr
        assert not re.search("Fortran|Backtrace|On entry|signalling", done.stderr), told + done.stderr
        assert done.returncode == 2 or (folder / "summary.txt").exists(), told
        assert not (folder / ".lock").exists(), told
        for file in folder.glob("*.txt"):
            assert not re.search("NaN|Infinity", file.read_text(encoding="utf-8")), f"{told}{file.name}"


def test_only_the_text_of_numbers_writes_into_buffers():
    """Elsewhere lines are put together: a buffer that is too short for a name or a number would end the program."""
    allowed = {"text.f90", "decimal.f90"}
    for path in (ROOT / "src").rglob("*.f90"):
        units = re.findall(r"^\s*(?:if \(.*\) )?write \(([\w%]+),", path.read_text(encoding="utf-8"), re.MULTILINE)
        assert path.name in allowed or set(units) <= {"error_unit", "output_unit", "unit"}, path


@pytest.mark.parametrize(("mass", "status"), [("1e60", 0), ("1.000001e60", 2), ("1e-60", 0), ("9.99e-61", 2), ("1e400", 2)])
def test_both_ends_of_the_range_belong_to_it(mass, status, run_deck):
    told = run_deck(f"&body name='a' mass={mass} inertia={mass} /\n", "--check", expect=status).stderr
    assert (f"mass={mass} is out of range, expected 0 or a magnitude from 1e-60 to 1e60" in told) == (status == 2)
