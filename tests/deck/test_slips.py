"""Typical slips are told, each with its line; decks that mean what they say hear nothing."""

from __future__ import annotations

import subprocess

import numpy as np
import pytest
from conftest import REFERENCE, ROOT

TOP = "&scene gravity=0.0,-9.81 /\n&material name='m' density=7800.0 young=2.1e11 /\n"
SECTION = "&section name='s' shape='rectangle' width=0.01 height=0.005 /\n"
BEAM = "&body name='b' kind='beam' length=0.4 elements=2 material='m' section='s' /\n"
BEAM += "&joint name='j' type='weld' body_a='b' node_a=1 /\n"
DISC = "&body name='d' kind='rigid' mass=1.0 inertia=0.01 com=0.1,0.0 /\n&joint name='p' type='revolute' body_a='d' /\n"
RUN = "&transient t_end=0.1 method='generalized_alpha' step=0.01 /\n"
PLAIN = TOP + SECTION + BEAM + DISC + RUN

SLIPS = {
    "GPa": (PLAIN.replace("2.1e11", "210.0"), "2: material/m: warning: sqrt(young/density) is 0.164083 m/s"),
    "g/cm3": (PLAIN.replace("7800.0", "7.8"), "2: material/m: warning: sqrt(young/density) is 164083 m/s"),
    "degrees": (PLAIN.replace("com=0.1,0.0", "com=0.1,0.0 angle=45.0"), "6: body/d: warning: angle=45 is 7.2 turns: degrees"),
    "phase": (
        PLAIN + "&history name='h' kind='sine' amplitude=1.0 frequency=1.0 phase=90.0 /\n",
        "9: history/h: warning: phase=90",
    ),
    "direction": (
        PLAIN + "&body name='s' kind='rigid' mass=1.0 inertia=1.0 /\n&joint name='k' type='slider' body_a='s' direction=90.0 /\n",
        "10: joint/k: warning: direction=90 is 14.3 turns",
    ),
    "free angle": (
        PLAIN + "&spring name='k' type='torsional' body_a='d' stiffness=1.0 free_angle=30.0 /\n",
        "9: spring/k: warning: free_angle=30",
    ),
    "a drive's direction": (
        PLAIN + "&body name='s' mass=1.0 inertia=1.0 /\n&history name='h' coefficients=0.0 /\n"
        "&drive name='k' type='position' body_a='s' direction=90.0 history='h' /\n",
        "11: drive/k: warning: direction=90",
    ),
    "a stop's direction": (
        PLAIN + "&stop name='k' type='position' body_a='d' direction=90.0 upper=100.0 stiffness=1.0 /\n",
        "9: stop/k: warning: direction=90",
    ),
    "a lower limit": (
        PLAIN + "&stop name='k' type='rotation' body_a='d' lower=-30.0 upper=1.0 stiffness=1.0 /\n",
        "9: stop/k: warning: lower=-30",
    ),
    "an upper limit": (
        PLAIN + "&stop name='k' type='rotation' body_a='d' lower=-1.0 upper=30.0 stiffness=1.0 /\n",
        "9: stop/k: warning: upper=30",
    ),
    "a controller in statics": (
        PLAIN + "&history name='h' kind='polynomial' coefficients=1.0 /\n&sensor name='a' quantity='angle' body='d' /\n"
        "&controller name='c' argument='a' history='h' kp=1.0 /\n"
        "&force name='f' type='torque' body='d' moment=1.0 controller='c' stage='static' /\n",
        "12: force/f: warning: stage='static' beside controller",
    ),
    "a controller of nothing": (
        PLAIN + "&history name='h' kind='polynomial' coefficients=1.0 /\n&sensor name='a' quantity='angle' body='d' /\n"
        "&controller name='c' argument='a' history='h' kp=1.0 /\n",
        "11: controller/c: warning: no force obeys it",
    ),
    "an accuracy that nothing keeps": (
        PLAIN + "&sensor name='a' quantity='angle' body='d' floor=1e-3 /\n",
        "9: sensor/a: warning: accuracy and floor are those of a &transient with accuracy",
    ),
    "gravity in mm": (PLAIN.replace("9.81", "9810.0"), "1: scene: warning: gravity of 9810 m/s2"),
    "loose": (PLAIN + "&body name='x' mass=1.0 inertia=1.0 /\n", "9: body/x: warning: no joint, drive, spring or force names it"),
    "loose beside a spring": (
        TOP + DISC + "&spring name='k' type='torsional' body_a='d' stiffness=1.0 /\n&body name='x' mass=1.0 inertia=1.0 /\n" + RUN,
        "6: body/x: warning: no joint, drive, spring or force names it",
    ),
}


@pytest.mark.parametrize("slip", SLIPS)
def test_a_slip_is_told_once(run_deck, tmp_path, slip):
    deck, told = SLIPS[slip]
    lines = [line for line in run_deck(deck, "--check").stderr.splitlines() if ": warning: " in line]
    assert len([line for line in lines if line.startswith(f"{tmp_path}/scene.nml:{told}")]) == 1, lines


def test_a_deck_without_an_analysis(run_deck):
    deck = PLAIN.replace(RUN, "")
    assert "warning: no analysis (&static, &modal, &frequency_response, &transient)" in run_deck(deck).stderr
    assert run_deck(deck, "--check").stderr == ""


def test_what_assembly_moved_is_told_without_rounding(run_deck):
    """A disc pinned at its centre and turned by its drive: an angle, no distance of 1e-27 m."""
    deck = "&body name='d' mass=1.0 inertia=0.01 /\n&joint name='p' type='revolute' body_a='d' /\n"
    deck += "&history name='h' kind='polynomial' coefficients=0.7 /\n"
    told = run_deck(deck + "&drive name='x' type='rotation' body_a='d' history='h' /\n" + RUN, "--check").stderr
    assert 'assembly moved body "d" by 7.00E-01 rad: are' in told


MEANT = {
    "as it is": PLAIN,
    "a turn": PLAIN.replace("com=0.1,0.0", f"com=0.1,0.0 angle={2 * np.pi!r}"),
    "turns of a driven crank": PLAIN.replace("com=0.1,0.0", "com=0.1,0.0 angle=7.853981633974483")
    + "&history name='h' kind='polynomial' coefficients=7.853981633974483,3.0 /\n"
    + "&drive name='x' type='rotation' body_a='d' history='h' /\n",
    "a thrown body": PLAIN + "&body name='x' mass=1.0 inertia=1.0 velocity=1.0,0.0 /\n",
    "unused material": PLAIN + "&material name='x' density=1.0 young=1.0 /\n",
}


@pytest.mark.parametrize("case", MEANT)
def test_what_may_be_meant_is_not_told(run_deck, case):
    assert run_deck(MEANT[case], "--check").stderr == ""


WORDS = ("solids have", "turns: degrees", "mm/s2", "names it: it is left")
SOLIDS = [(7800, 2.1e11), (2700, 7e10), (1100, 1e6), (1200, 3e9), (1600, 2.1e10), (600, 1e10), (3500, 1.1e12), (930, 2e8)]


def random_deck(seed: int) -> str:
    """Return a chain of links, rigid and flexible, from millimetres to tens of metres, as users write them."""
    rng = np.random.default_rng(seed)
    size = 10.0 ** rng.uniform(-2.0, 1.5)
    density, young = SOLIDS[rng.integers(len(SOLIDS))]
    g = rng.choice([0.0, 1.62, 9.81])
    deck = f"&scene gravity=0.0,{-g!r} /\n&material name='m' density={density!r} young={young!r} /\n"
    deck += f"&section name='s' shape='rectangle' width={0.05 * size!r} height={size * rng.uniform(0.01, 0.06)!r} /\n"
    deck += f"&history name='h' kind='sine' amplitude={rng.uniform(0.1, 5)!r} "
    deck += f"frequency={rng.uniform(0.1, 50)!r} phase={rng.uniform(-6, 6)!r} /\n"
    x, y, before, end = 0.0, 0.0, "ground", ""
    for k in range(rng.integers(1, 6)):
        angle, length = rng.uniform(-6.2, 6.2), size * rng.uniform(0.3, 1.0)
        start = f"position={x!r},{y!r} angle={angle!r}"
        if rng.random() < 0.5:
            deck += f"&body name='b{k}' kind='beam' length={length!r} elements=2 material='m' section='s' {start} /\n"
            here, there = "node_{}=1", "node_{}=-1"
        else:
            mass = density * length * (0.05 * size) ** 2 * rng.uniform(0.2, 2.0)
            deck += f"&body name='b{k}' kind='rigid' mass={mass!r} "
            deck += f"inertia={mass * length**2 / 12!r} com={length / 2!r},0.0 {start} /\n"
            here, there = "", f"point_{{}}={length!r},0.0"
        deck += f"&joint name='j{k}' type='revolute' body_a='b{k}' {here.format('a')} body_b='{before}' "
        deck += (end.format("b") if before != "ground" else "") + " /\n"
        if rng.random() < 0.4:
            free = rng.uniform(-3, 3)
            deck += f"&spring name='k{k}' type='torsional' body_a='b{k}' body_b='{before}' stiffness=1.0 free_angle={free!r} /\n"
        x, y, before, end = x + length * np.cos(angle), y + length * np.sin(angle), f"b{k}", there
    deck += f"&force name='f' type='force' body='{before}' {end.format('a').replace('_a', '')} fy=1.0 history='h' /\n"
    return deck.replace("np.float64(", "").replace(")", "") + RUN


def test_no_false_alarms(biela, tmp_path):
    """Shipped decks, references and 200 random scenes in usual units."""
    decks = [*sorted((ROOT / "input").glob("*.nml")), *sorted(REFERENCE.glob("*/deck.nml"))]
    assert len(decks) > 25
    for seed in range(200):
        decks.append(tmp_path / f"random{seed}.nml")
        decks[-1].write_text(random_deck(seed))
    done = subprocess.run([biela, "--check", *decks], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    assert [line for line in done.stderr.splitlines() if any(word in line for word in WORDS)] == []
