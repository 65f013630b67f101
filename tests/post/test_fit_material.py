"""Terms from measured moduli: known terms come back, real data are met, bad tables end in one line."""

from __future__ import annotations

import re

import numpy as np
import pytest
from biela import deck_text, fit_material
from biela.commands import fit_material as fit_material_command
from biela.material_data import DataError, read
from biela.material_fit import choose_terms, fit, master_curve, relative_error, shift_factor
from biela.material_law import Material, of_group, pole_factor
from conftest import ROOT

ELASTOMER = "f,E_stor,eta\nHz,MPa,-\n1,23.2,1.1\n10,58,.85\n50,145,.7\n100,203,.6\n500,348,.4\n1000,435,.35\n1500,464,.34\n"
SHIPPED = ROOT / "input" / "materials" / "elastomer.nml"
BAND = np.logspace(0.0, 3.0, 25)


def random_material(kind: str, rng: np.random.Generator) -> Material:
    """Return two GHM or three Maxwell terms that act inside 1 Hz to 1 kHz."""
    young = 10.0 ** rng.uniform(6.0, 9.0)
    if kind == "maxwell":
        decades = np.array([rng.uniform(0.2, 0.8), rng.uniform(1.2, 1.8), rng.uniform(2.2, 2.8)])
        return Material(young, weight=rng.uniform(0.2, 3.0, 3), tau=0.5 / np.pi / 10.0**decades)
    decades = np.array([rng.uniform(0.5, 1.4), rng.uniform(1.8, 2.7)])
    return Material(young, rng.uniform(0.2, 3.0, 2), rng.uniform(0.7, 4.0, 2), 2.0 * np.pi * 10.0**decades)


def table(folder, text: str):
    path = folder / "data.csv"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("kind", ["ghm", "maxwell"])
def test_known_terms_come_back_from_noisy_data(kind):
    fine, sizes = np.logspace(0.0, 3.0, 200), []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        truth = random_material(kind, rng)
        noise = (rng.standard_normal(BAND.size) + 1j * rng.standard_normal(BAND.size)) / np.sqrt(2.0)
        found = choose_terms(kind, BAND, truth.modulus(BAND) * (1.0 + 0.01 * noise), 2.0e4 * np.pi, 0.01, 4)
        error = relative_error(found.material, fine, truth.modulus(fine)).max()
        assert error < 0.02, f"seed {seed}: {error}"
        made = found.material
        sizes.append(made.internal_variables)
        assert (np.concatenate([made.alpha, made.zeta, made.omega, made.weight, made.tau]) > 0.0).all()
        assert made.fastest_pole <= 2.0e4 * np.pi * (1.0 + 1.0e-9)
    assert np.median(sizes) <= (4 if kind == "ghm" else 3)


def test_the_elastomer_as_published_fits_say(tmp_path):
    data = read(table(tmp_path, ELASTOMER))
    fastest = 20.0 * np.pi * 1500.0
    assert fit("ghm", 4, data.frequency, data.modulus, fastest).error < 0.022
    shipped = of_group(deck_text.read(SHIPPED).one("material"))
    three = fit("maxwell", 3, data.frequency, data.modulus, fastest)
    ghm = relative_error(shipped, data.frequency, data.modulus)
    assert three.error <= np.sqrt(np.mean(ghm**2)) * (1.0 + 1.0e-4)
    assert three.material.internal_variables == 3
    np.testing.assert_allclose(three.material.weight, [6.198, 25.31, 42.46], rtol=2.0e-3)


def test_overdamped_ghm_terms_are_differences_of_maxwell_terms():
    ghm = Material(3.0e6, np.array([1.7]), np.array([2.5]), np.array([400.0]))
    fast = 400.0 * pole_factor(np.array(2.5))
    slow = 400.0**2 / fast
    weights = 1.7 * np.array([fast, -slow]) / (fast - slow)
    maxwell = Material(3.0e6, weight=weights, tau=1.0 / np.array([slow, fast]))
    np.testing.assert_allclose(ghm.modulus(BAND), maxwell.modulus(BAND), rtol=1.0e-12)


def test_the_law_is_converted_with_its_error_told(tmp_path, capsys):
    words = [str(SHIPPED), "--law", "maxwell", "--terms", "3", "--band", "1", "1500", "--output", str(tmp_path / "out.png")]
    assert fit_material_command.main(words) == 0
    printed = capsys.readouterr().out
    back = of_group(deck_text.parse(printed).one("material"))
    shipped = of_group(deck_text.read(SHIPPED).one("material"))
    inside = np.logspace(0.0, np.log10(1500.0), 60)
    assert relative_error(back, inside, shipped.modulus(inside)).max() < 2.0e-4
    assert back.fastest_pole < shipped.fastest_pole / 90.0
    assert "nothing is claimed there" in printed
    assert {path.name for path in tmp_path.iterdir()} == {"out.nml", "out.png"}


@pytest.mark.parametrize(("law", "constants"), [("wlf", [12.0, 80.0]), ("arrhenius", [180.0]), ("free", None)])
def test_tables_at_several_temperatures_are_shifted_back(tmp_path, law, constants):
    truth = Material(5.0e6, weight=np.array([4.0, 12.0, 30.0]), tau=np.array([0.3, 6.0e-3, 1.0e-4]))
    celsius = np.array([10.0, 15.0, 20.0, 25.0, 30.0])
    kelvin = celsius + 273.15
    shifts = shift_factor(law if law != "free" else "wlf", np.array(constants or [12.0, 80.0]), kelvin, 293.15)
    frequency = np.logspace(0.0, 2.0, 12)
    rows = []
    for temperature, shift in zip(celsius, shifts):
        modulus = truth.modulus(frequency * 10.0**shift) / 1.0e6
        rows += [f"{f:.10g},{e.real:.10g},{e.imag:.10g},{temperature}" for f, e in zip(frequency, modulus)]
    data = read(table(tmp_path, "f,E_stor,E_loss,T\nHz,MPa,MPa,C\n" + "\n".join(rows)))
    found, values, _ = master_curve(data, law, 293.15)
    np.testing.assert_allclose(found, shifts, atol=0.04)
    if law == "arrhenius":
        np.testing.assert_allclose(values, constants, rtol=0.02)
    words = ["--law", "maxwell", "--shift", law, "--reference", "20", "--output", str(tmp_path / "out")]
    assert fit_material_command.main([str(tmp_path / "data.csv"), *words]) == 0
    back = of_group(deck_text.read(tmp_path / "out.nml").one("material"))
    reduced = np.logspace(-1.0, 3.0, 40)
    assert relative_error(back, reduced, truth.modulus(reduced)).max() < 0.05


def test_printed_lines_run_and_the_bound_of_a_deck_is_told(tmp_path, biela, capsys):
    words = [str(table(tmp_path, ELASTOMER)), "--law", "ghm", "--terms", "2", "--density", "1200", "--output", str(tmp_path / "m")]
    deck = ROOT / "input" / "elastomer_cantilever.nml"
    assert fit_material_command.main([*words, "--deck", str(deck), "--biela", str(biela)]) == 0
    printed = capsys.readouterr().out
    assert "stable steps of explicit methods" in printed
    assert "rk4: safe bound" in printed


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "is empty"),
        ("f,E_stor,E_loss\nHz,Pa,Pa\n1,2,3\n", "two or more frequencies expected"),
        ("f,E_stor,E_loss\nHz,Pa,Pa\n1,2,3\n2,nan,3\n", "data.csv:4: 'nan' is no finite number"),
        ("f,E_stor,E_loss\nHz,Pa,Pa\n1,2,3\n2,3,-3\n", "data.csv:4: loss = -3, a positive value expected"),
        ("f,E_stor,E_loss\nHz,Pa,Pa\n1,2,3\n1,3,3\n", "data.csv:4: the frequency 1 Hz is given twice"),
        ("f,E_stor,E_loss\nHz,Pa,Pa\n1,2,3\n2,3,abc\n", "data.csv:4: 'abc' is no finite number"),
        ("f,E_stor,E_loss\nHz,Pa,Pa\n1,2,3\n2,3\n", "data.csv:4: 2 values, 3 expected"),
        ("f,E_stor,E_loss\n1,2,3\n2,3,3\n", "the unit of frequency is not stated"),
        ("f,E_stor,E_loss\nHz,stone,Pa\n1,2,3\n2,3,3\n", "'stone' is no unit of storage"),
        ("f,young,E_loss\nHz,Pa,Pa\n1,2,3\n2,3,3\n", "no column of storage found"),
        ("some words\nand more\n", "no column of frequency found"),
        ("f,E_stor,E_loss,T\nHz,Pa,Pa,K\n1,2,3,-4\n2,3,3,20\n", "below absolute zero"),
    ],
)
def test_bad_tables_end_in_one_line(tmp_path, capsys, text, told):
    assert fit_material_command.main([str(table(tmp_path, text)), "--density", "1200"]) == 2
    said = capsys.readouterr().err
    assert told in said
    assert said.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["data.csv"]


def test_units_and_unsorted_rows(tmp_path):
    data = read(table(tmp_path, "omega (rad/s);E' (GPa);tan_delta\n628,318530718;0,2;0,5\n62,8318530718;0,1;0,25\n"))
    np.testing.assert_allclose(data.frequency, [10.0, 100.0])
    np.testing.assert_allclose(data.modulus, [1.0e8 + 2.5e7j, 2.0e8 + 1.0e8j])
    with pytest.raises(DataError, match="no column 'x'"):
        read(tmp_path / "data.csv", {"storage": "x"})


def test_options_that_make_no_sense(tmp_path, capsys):
    path = str(table(tmp_path, ELASTOMER))
    for words in (["--terms", "0"], ["--fastest-pole", "1"], ["--band", "5", "2"], ["--band", "2", "9"], ["--target", "nan"]):
        assert fit_material_command.main([path, *words]) == 2
    assert capsys.readouterr().err.count("\n") == 5


@pytest.mark.parametrize(
    ("header", "names", "modulus"),
    [
        ("f,E_stor,E_loss,eta\nHz,Pa,Pa,-", {}, 2.0 + 3.0j),
        ("f,E_stor,E_loss,eta\nHz,Pa,Pa,-", {"factor": "eta"}, 2.0 + 1.0j),
        ("f,E_stor,E_loss,eta\nHz,Pa,Pa,-", {"loss": "e_loss"}, 2.0 + 3.0j),
        ("f,real,E_loss,eta\nHz,kPa,Pa,%", {"storage": "Real", "factor": "ETA"}, 2.0e3 + 10.0j),
        ("f,E_stor,E_loss,eta\nmHz,MHz,Pa,-", {}, "'MHz' is no unit of storage"),
    ],
)
def test_named_columns_go_before_the_usual_ones(tmp_path, header, names, modulus):
    path = table(tmp_path, header + "\n1,2,3,0.5\n4,2,3,0.5\n")
    if isinstance(modulus, str):
        with pytest.raises(DataError, match=modulus):
            read(path, names)
    else:
        np.testing.assert_allclose(read(path, names).modulus, [modulus] * 2, rtol=1e-15)


def test_files_that_cannot_be_read_or_written_are_told(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(fit_material, "picture", lambda *_: None)
    monkeypatch.setattr(fit_material, "save", lambda *_: [])
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "out.nml").mkdir()
    path = str(table(tmp_path, ELASTOMER))
    for words, told in (
        ([str(tmp_path / "none.csv")], "none.csv: no such file"),
        ([str(tmp_path / "binary.csv")], "binary.csv: cannot be read as text"),
        ([path, "--law", "maxwell", "--terms", "1", "--output", f"{tmp_path}/out"], "out.nml: cannot be written (Is a directory)"),
    ):
        assert fit_material_command.main(words) == 2
        said = capsys.readouterr().err
        assert told in said
        assert said.count("\n") == 1


def test_the_law_is_chosen_for_a_given_number_of_terms(tmp_path):
    data = read(table(tmp_path, ELASTOMER))
    args = fit_material_command.arguments().parse_args(["data.csv", "--terms", "1"])
    found, told = fit_material.chosen_fit(args, data.frequency, data.modulus)
    assert found.material.weight.size == 2, "two Maxwell terms cost as much as one GHM term"
    other = fit("ghm", 1, data.frequency, data.modulus, 20.0 * np.pi * 1500.0)
    errors = [f"{100 * one.error:.3g} % with 2 internal variables" for one in (found, other)]
    assert told == [f"law chosen: 2 Maxwell terms: {errors[0]}; 1 GHM terms: {errors[1]}"]


def test_a_storage_modulus_that_falls_is_noted():
    ghm = Material(1.0e6, np.array([1.0]), np.array([0.3]), np.array([2.0 * np.pi * 30.0]))
    (note,) = fit_material.falling_storage(ghm, (1.0, 1000.0))
    wide = np.logspace(-1.0, 4.0, 4000)
    storage = ghm.modulus(wide).real
    lowest = storage[storage.argmax() :].min()
    assert float(re.search(r"falls by (\S+) %", note)[1]) == pytest.approx(100.0 * (1.0 - lowest / storage.max()), rel=0.05)
    assert note.endswith("an under-damped term; try Maxwell terms")
    assert fit_material.falling_storage(Material(1.0e6, weight=np.ones(1), tau=np.full(1, 0.01)), (1.0, 1000.0)) == []


def test_a_temperature_that_the_table_lacks(tmp_path, capsys):
    rows = "".join(f"{f},{2 + f},{3},{T}\n" for T in (10, 20) for f in (1, 10))
    path = table(tmp_path, "f,E_stor,E_loss,T\nHz,MPa,MPa,C\n" + rows)
    assert fit_material_command.main([str(path), "--reference", "17"]) == 2
    assert capsys.readouterr().err == "fit_material: --reference 17: no temperature of the table (283.15, 293.15 K)\n"


def test_temperatures_of_one_row_cannot_be_shifted(tmp_path):
    data = read(table(tmp_path, "f,E_stor,E_loss,T\nHz,MPa,MPa,C\n1,2,3,10\n1,2,3,20\n"))
    with pytest.raises(DataError, match="neighbouring temperatures share no frequencies to shift by: three rows or more at each"):
        master_curve(data, "wlf", 283.15)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("ghm_alpha=1.0,2.0 ghm_zeta=1.0 ghm_omega=1.0", "&material m: the lists of its terms differ in length"),
        ("prony_alpha=1.0,-2.0 prony_tau=1.0,2.0", "&material m: young and all terms have to be positive"),
        ("young=0.0", "&material m: young and all terms have to be positive"),
    ],
)
def test_terms_that_make_no_modulus(words, told):
    with pytest.raises(deck_text.DeckError) as fault:
        of_group(deck_text.parse(f"&material name='m' {words if 'young' in words else 'young=1e6 ' + words} /").one("material"))
    assert str(fault.value) == told


def test_what_the_solver_says_of_the_deck_is_told(tmp_path):
    (tmp_path / "deck.nml").write_text("&material name='rubber' density=1000.0 young=1e6 /\n")
    (tmp_path / "solver").write_text("#!/bin/sh\necho 'deck.nml:1: too soft' >&2\necho more >&2\nexit 2\n")
    (tmp_path / "solver").chmod(0o755)
    for program, told in (
        ("solver", f"{tmp_path}/deck.nml: with the fitted terms the solver says: deck.nml:1: too soft"),
        ("none", f"{tmp_path}/none: cannot be run (No such file or directory): build it, or name it with --biela"),
    ):
        words = ["d.csv", "--deck", f"{tmp_path}/deck.nml", "--biela", f"{tmp_path}/{program}"]
        args = fit_material_command.arguments().parse_args(words)
        with pytest.raises(DataError) as fault:
            fit_material.stable_steps(args, Material(1e6))
        assert str(fault.value) == told
