"""One scene written in different ways must give the same results, bit for bit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import Run

PLAIN = """&scene title='four-bar' gravity=0.0,-9.81 /
&material name='m' density=1200.0 young=3.0e9 ghm_alpha=0.4,0.4 ghm_zeta=1.5,1.5 ghm_omega=400.0,4000.0 /
&section name='s' shape='rectangle' width=0.02 height=0.006 /
&body name='crank' kind='rigid' mass=0.3 inertia=4.0e-4 com=0.05,0.0 position=0.0,0.0 angle=1.5 /
&body name='coupler' kind='beam' length=0.35 elements=2 material='m' section='s' position=0.0,0.1 angle=0.4 flexible=.true. /
&joint name='a' type='revolute' body_a='crank' point_a=0.0,0.0 point_b=0.0,0.0 /
&joint name='b' type='revolute' body_a='coupler' node_a=1 body_b='crank' point_b=0.1,0.0 /
&joint name='c' type='slider' body_a='coupler' node_a=-1 point_b=0.0,0.24 direction=0.0 /
&force name='push' type='torque' body='crank' moment=0.5 /
&sensor name='mid' quantity='deflection' body='coupler' node=2 /
&sensor name='pin' quantity='reaction' joint='b' /
&transient t_end=0.01 method='rk4' step=1.0e-5 output_step=1.0e-3 /
"""


def replaced(*pairs: tuple[str, str]) -> str:
    """Return the plain deck with texts replaced; each must be there."""
    deck = PLAIN
    for old, new in pairs:
        assert old in deck
        deck = deck.replace(old, new)
    return deck


def reordered() -> str:
    """Return the plain deck with its groups in another order, those of one kind as they were."""
    lines = PLAIN.splitlines(keepends=True)
    kinds = ["transient", "sensor", "force", "joint", "body", "section", "material", "scene"]
    return "".join(line for kind in kinds for line in lines if line.startswith(f"&{kind} "))


def rows(run: Run) -> list[str]:
    """Return the line of the columns and the rows of history.txt, without the comments that name the deck."""
    lines = (run.folder / "history.txt").read_text(encoding="utf-8").splitlines()
    assert len(lines) > 11
    return [line for line in lines if line.startswith("# columns:") or not line.startswith("#")]


NOTATIONS = {
    "upper case": replaced(("&body", "&BODY"), ("kind", "Kind"), ("'rigid'", "'RIGID'"), ("body_a='crank'", "BODY_A='Crank'")),
    "tabs and CR LF": PLAIN.replace(" /", "\t/").replace("\n", "\r\n").replace(" mass", "\tmass"),
    "commas": replaced((" kind=", ", kind="), (" mass=", ", mass="), (" inertia=", " ,inertia="), ("4.0e-4 ", "4.0e-4, ")),
    "blanks": replaced(("0.0,-9.81", "0.0   -9.81"), ("com=0.05,0.0", "com = 0.05 , 0.0"), ("mass=0.3", "mass  =  0.3")),
    "repeat counts": replaced(("0.4,0.4", "2*0.4"), ("1.5,1.5", "2*1.5"), ("position=0.0,0.0", "position=2*0.0")),
    "numbers": replaced(("3.0e9", "3D9"), ("0.3", "+.3"), ("4.0e-4", "4d-04"), ("1200.0", "1200"), ("0.05,", "5.E-2,")),
    "logicals": replaced((".true.", "T")),
    "double quotes": replaced(("'coupler'", '"coupler"'), ("'four-bar'", '"it\'s a four-bar"')),
    "doubled quotes": replaced(("'four-bar'", "'it''s a / four-bar ! &'")),
    "defaults left out": replaced((" kind='rigid'", ""), (" position=0.0,0.0", ""), (" point_a=0.0,0.0", "")),
    "other order": reordered(),
    "comments": "! head\n" + PLAIN.replace(" mass=", " ! a / comment & 'more\n mass=") + "! end",
    "no final newline": PLAIN.rstrip("\n"),
    "byte order mark": "\ufeff" + PLAIN,
    "two groups a line": PLAIN.replace("/\n&", "/ &"),
    "values over lines": replaced(("0.0,-9.81", "\n 0.0\n , ! down\n\n -9.81\n"), ("ghm_omega=", "ghm_omega\n=\n")),
}


@pytest.mark.parametrize("notation", sorted(NOTATIONS))
def test_same_results(run_deck, notation: str):
    plain = run_deck(PLAIN, "--quiet", name="plain")
    other = run_deck(NOTATIONS[notation], "--quiet", name="other")
    assert rows(plain) == rows(other)


def test_a_library_of_materials(run_deck, tmp_path: Path):
    lines = PLAIN.splitlines(keepends=True)
    (tmp_path / "library" / "more").mkdir(parents=True)
    (tmp_path / "library" / "materials.nml").write_text(lines[1] + "&include file='more/../more/sections.nml' /\n")
    (tmp_path / "library" / "more" / "sections.nml").write_text(lines[2])
    plain = run_deck(PLAIN, "--quiet", name="plain")
    deck = lines[0] + "&include file='library/materials.nml' /\n" + "".join(lines[3:])
    other = run_deck(deck, "--quiet", name="other")
    assert rows(plain) == rows(other)
    assert lines[2].strip() in other.summary


def test_frequency_scale_multiplies_every_omega(run_deck):
    plain = run_deck(PLAIN, "--quiet", name="plain")
    scaled = replaced(("ghm_omega=400.0,4000.0", "ghm_omega=200.0,2000.0 ghm_frequency_scale=2.0"))
    other = run_deck(scaled, "--quiet", name="other")
    assert rows(plain) == rows(other)


def test_shapes_give_area_and_second_moment(run_deck):
    """A tube's properties by hand; equal to rounding, since they are computed in another order."""
    outer, inner = 0.012, 0.008
    area, inertia = np.pi / 4 * (outer**2 - inner**2), np.pi / 64 * (outer**4 - inner**4)
    by_shape = replaced(("shape='rectangle' width=0.02 height=0.006", f"shape='tube' outer={outer} inner={inner}"))
    by_value = replaced(("shape='rectangle' width=0.02 height=0.006", f"area={area!r} inertia={inertia!r}"))
    one = run_deck(by_shape, "--quiet", name="shape").history
    two = run_deck(by_value, "--quiet", name="value").history
    np.testing.assert_allclose(one.data, two.data, rtol=1e-9, atol=1e-12 * np.abs(two.data).max())


def test_names_of_sensors_are_kept_as_written(run_deck):
    run = run_deck(replaced(("name='mid'", "name='Mid_1-b'")), "--quiet", name="plain")
    assert any(name.startswith("Mid_1-b.") for name in run.history.names)


def test_an_interval_that_is_longer_by_rounding_alone_is_no_fault(run_deck):
    run_deck(replaced(("output_step=1.0e-3", "output_step={0.1*0.1}")), "--check")
