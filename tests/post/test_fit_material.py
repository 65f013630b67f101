"""Terms from measured moduli: known terms come back, real data are met, bad tables end in one line."""

from __future__ import annotations

import io
import re

import numpy as np
import pytest
from biela import deck, fit_material
from biela.master_curve import master_curve, shift_factor
from biela.material_data import DataError, read
from biela.material_fit import choose_terms, fit, relative_error
from biela.material_law import Material, moved, of_group, pole_factor
from biela.programs import fit_material as fit_material_command
from conftest import ROOT

ELASTOMER = "f,E_stor,eta\nHz,MPa,-\n1,23.2,1.1\n10,58,.85\n50,145,.7\n100,203,.6\n500,348,.4\n1000,435,.35\n1500,464,.34\n"
SHIPPED = ROOT / "input" / "materials" / "elastomer.nml"
BAND = np.logspace(0.0, 3.0, 25)


def deck_of(folder, text):
    """Return the deck that a text states."""
    (folder / "of_text.nml").write_text(text)
    return deck.read(folder / "of_text.nml")


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
    shipped = of_group(deck.read(SHIPPED).one("material"))
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
    back = of_group(deck_of(tmp_path.parent, printed).one("material"))
    shipped = of_group(deck.read(SHIPPED).one("material"))
    inside = np.logspace(0.0, np.log10(1500.0), 60)
    assert relative_error(back, inside, shipped.modulus(inside)).max() < 2.0e-4
    assert back.fastest_pole < shipped.fastest_pole / 90.0
    assert "nothing is claimed there" in printed
    assert {path.name for path in tmp_path.iterdir()} == {"out.nml", "out.png"}


def raw_table(folder, seed: int, share: float, noise: float = 0.01) -> tuple:
    """Write a raw table of five temperatures: scatter, jitter of the temperature, rows in disorder.

    Args:
        folder: where to
        seed: of material, law, scatter
        share: by how much of its two decades a set is shifted beside its neighbour; above 1 they do not overlap
        noise: relative scatter of each modulus

    Returns:
        path, material, law, temperatures [K], log10 a_T of each with the middle one as reference
    """
    rng = np.random.default_rng(seed)
    decades = np.linspace(-9.0, 6.0, 16) + rng.uniform(-0.3, 0.3, 16)
    weight = np.exp(-(((decades - rng.uniform(-5.0, 1.0)) / rng.uniform(2.0, 4.0)) ** 2)) * 10 ** rng.uniform(-0.2, 0.2, 16)
    truth = Material(10 ** rng.uniform(5, 7), weight=weight * 10 ** rng.uniform(1.0, 2.5) / weight.sum(), tau=10**decades)
    law, constants = (("wlf", [rng.uniform(6, 16), rng.uniform(60, 130)]), ("arrhenius", [rng.uniform(120, 300)]))[seed % 2]
    start = rng.uniform(0.0, 60.0) + 273.15
    wide = np.linspace(start, start + 400.0, 20000)
    shifts = -2.0 * share * rng.uniform(0.9, 1.1) * np.arange(5)
    kelvin = np.interp(shifts, shift_factor(law, np.array(constants), wide, start)[::-1], wide[::-1])
    frequency, rows = np.logspace(-1.0, 1.0, 14), []
    for k, temperature in enumerate(kelvin):
        own = temperature + 0.03 * rng.standard_normal(frequency.size)
        modulus = truth.modulus(frequency * 10.0 ** (shift_factor(law, np.array(constants), own, start) - shifts[2])) / 1.0e6
        scatter = 1.0 + noise * rng.standard_normal((2, frequency.size))
        rows += list(zip(frequency, modulus.real * scatter[0], modulus.imag * scatter[1], own - 273.15, [k] * frequency.size))
    rng.shuffle(rows)
    lines = "\n".join("{:.8g},{:.8g},{:.8g},{:.3f},{:.0f}".format(*row) for row in rows)
    return table(folder, f"f,E_stor,E_loss,T,set\nHz,MPa,MPa,C,\n{lines}\n"), truth, law, kelvin, shifts - shifts[2]


def test_raw_tables_are_shifted_back_within_two_percent(tmp_path):
    for seed in range(20):
        path, _, law, kelvin, shifts = raw_table(tmp_path, seed, 0.5)
        if seed % 4 == 3:  # without sets, gaps between temperatures make them
            path.write_text(re.sub(r",[^,]*$", "", path.read_text(), flags=re.MULTILINE))
        law = "free" if seed % 3 == 2 else law
        found = master_curve(read(path), law, kelvin[2])
        error = np.abs(found.shifts - shifts).max()
        assert error < 0.02 * np.abs(shifts).max(), (seed, law, error)
        assert error < 5.0 * found.errors.max() + 1.0e-3, (seed, law)
        assert found.misfits.max() < 0.02
        if seed < 3:  # a reference that was not measured
            between = 0.7 * kelvin[1] + 0.3 * kelvin[2]
            assert master_curve(read(path), law, between).shift(kelvin[2]) == pytest.approx(-found.shift(between), abs=2e-3)


def test_curves_that_do_not_overlap_are_refused(tmp_path):
    for seed in range(5):
        path, _, law, kelvin, _ = raw_table(tmp_path, seed, 1.2)
        with pytest.raises(DataError, match="do not overlap: apart they are as good a modulus"):
            master_curve(read(path), law, kelvin[2])


@pytest.mark.parametrize("seed", range(6))
def test_a_shift_that_the_overlap_leaves_open_is_taken_from_the_law_or_the_neighbours(tmp_path, seed):
    """The fourth of five sets is missing, so that the last two stand apart by a decade."""
    path, _, law, kelvin, shifts = raw_table(tmp_path, seed, 0.75)
    path.write_text(re.sub(r"[^\n]*,3\n", "", path.read_text() + "\n"))
    data, true = read(path), shifts[[0, 1, 2, 4]]
    for mode in (law, "free"):
        found = master_curve(data, mode, kelvin[2])
        ((k, low, high),) = found.open
        assert (k, np.isnan(found.overlaps).tolist()) == (2, [False, False, False, True])
        assert low <= true[3] <= high
        off = np.abs(found.shifts - true)
        assert off[: 3 if mode == "free" else 4].max() < 0.05 * np.abs(true).max(), (mode, off)
        assert np.isinf(found.errors[3]) == (mode == "free")


def test_a_raw_table_becomes_the_material_of_a_temperature(tmp_path, capsys):
    path, truth, _, kelvin, shifts = raw_table(tmp_path, 0, 0.5)
    frequency = np.logspace(-1.0, 1.0, 30)
    words = [str(path), "--law", "maxwell", "--terms", "7", "--density", "1200", "--output", str(tmp_path / "out")]
    at = kelvin[4] - 273.15
    assert fit_material_command.main([*words, "--reference", f"{kelvin[2] - 273.15:.4f}", "--temperature", f"{at:.4f}"]) == 0
    group = (found := deck.read(tmp_path / "out.nml")).one("material")
    error = relative_error(of_group(group, *moved(group, found)), frequency, truth.modulus(frequency * 10.0 ** shifts[4]))
    assert np.sqrt(np.mean(error**2)) < 0.01, "the noise"
    assert error.max() < 0.025
    assert moved(group, found)[0] == pytest.approx(10.0 ** shifts[4], rel=0.1)
    band = np.array(group.numbers("band"))
    np.testing.assert_allclose(band, [0.1 * 10.0 ** shifts[4], 10.0 * 10.0 ** shifts[0]], rtol=0.1)
    capsys.readouterr()
    for option in ("--reference", "--temperature"):
        assert fit_material_command.main([*words, option, f"{kelvin[4] - 270.0}"]) == 2
        assert "outside the measured temperatures" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("rows", "words", "told"),
    [
        ("1,2,3,10\n10,3,3,10\n1,2,3,20\n10,3,3,20\n", ["--shift", "wlf"], "WLF has two constants, which 2 temperatures do"),
        ("1,2,3,10\n1,1,3,20\n", [], "the curves at 10 C and 20 C do not overlap"),
        ("".join(f"{f},{f},1,{10 + 0.4 * f}\n" for f in range(1, 9)), [], "temperatures that run over 2.8 K count as one"),
        ("1,2,3,10\n10,3,3,10\n", ["--temperature", "10"], "--temperature: the table has fewer than two temperatures"),
    ],
)
def test_temperatures_that_cannot_be_shifted(tmp_path, capsys, rows, words, told):
    assert fit_material_command.main([str(table(tmp_path, "f,E_stor,E_loss,T\nHz,MPa,MPa,C\n" + rows)), *words]) == 2
    said = capsys.readouterr().err
    assert told in said
    assert said.count("\n") == 1


def test_what_the_data_cannot_tell_is_said(tmp_path, capsys):
    rows = "".join(f"{f},{e},0.2\n" for f, e in zip([1, 2, 4, 8, 16, 32, 64], [1.0, 1.1, 1.2, 1.3, 1.2, 1.1, 1.0]))
    path = table(tmp_path, "f,E_stor,E_loss\nHz,MPa,MPa\n" + rows)
    assert fit_material_command.main([str(path), "--law", "maxwell", "--target", "0.001"]) == 0
    told = capsys.readouterr()
    assert "warning: the measured storage modulus falls by 23 %" in told.out
    rows = read(path)
    few = "f,E_stor,E_loss\nHz,MPa,MPa\n1,10,1\n3,11,1.5\n10,10.5,1.8\n30,9,2\n100,8,2.2\n300,10,2\n"
    assert fit_material_command.main([str(table(tmp_path, few)), "--law", "maxwell", "--terms", "1"]) == 0
    assert "warning: the measured storage modulus falls by 27 %" in capsys.readouterr().err
    assert "warning: no fit reaches --target 0.001, the best has" in told.out
    material = of_group(deck_of(tmp_path.parent, told.out).one("material"))
    first = slice(0, 4)  # 1 to 10 Hz
    loss = material.modulus(rows.frequency).imag / material.modulus(rows.frequency).real
    off = loss[first] / (rows.modulus.imag / rows.modulus.real)[first] - 1.0
    stated = float(re.search(r"1 to 10 Hz \S+ %, loss factor (\S+) %", told.out)[1])
    assert stated == pytest.approx(100.0 * np.sqrt(np.mean(off**2)), rel=0.06)
    assert "terms act outside the band, at " in told.out
    assert told.err.count("warning: ") == 2


def test_printed_lines_are_a_deck(tmp_path, biela):
    words = [str(table(tmp_path, ELASTOMER)), "--law", "ghm", "--terms", "2", "--density", "1200", "--output", str(tmp_path / "m")]
    assert fit_material_command.main(words) == 0
    group = deck.read(tmp_path / "m.nml", biela=biela).one("material")
    assert (len(group.numbers("ghm_alpha")), group.number("density")) == (2, 1200.0)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "is empty"),
        ("f,E_stor,E_loss\nHz,Pa,Pa\n1,2,3\n", "two or more frequencies expected"),
        ("f,E_stor,E_loss\nHz,Pa,Pa\n1,2,3\n2,nan,3\n", "data.csv:4: 'nan' is no finite number"),
        ("f,E_stor,E_loss\nHz,Pa,Pa\n1,2,3\n2,3,-3\n", "data.csv:4: loss = -3, a positive value from 1e-100 to 1e+100 expected"),
        ("f,E_stor,eta\nHz,MPa,-\n1e-320,435,0.35\n1,9,1\n", "data.csv:3: frequency = 1e-320, a positive value from 1e-100"),
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


def test_angular_frequencies_and_shear_moduli_are_read_as_what_they_are(tmp_path):
    data = read(table(tmp_path, "omega[1/s],G'[MPa],G''[MPa]\n6.28318530718,1,0.1\n62.8318530718,2,0.2\n"))
    np.testing.assert_allclose(data.frequency, [1.0, 10.0])
    assert data.shear
    assert (
        " shear_modulus="
        in fit_material.fit_table(tmp_path / "data.csv", fit_material.Options(density=1000, law="maxwell", terms=1)).text
    )
    assert not read(table(tmp_path, "f[1/s],E'[MPa],E''[MPa]\n1,1,0.1\n10,2,0.2\n")).shear
    with pytest.raises(DataError, match="a modulus of tension and one of shear"):
        read(table(tmp_path, "f[Hz],E'[MPa],G''[MPa]\n1,1,0.1\n10,2,0.2\n"))


def test_a_conversion_keeps_what_it_does_not_change(tmp_path, biela):
    """A band that is stated moves with the frequencies' scale, as the solver's does."""
    terms = "ghm_alpha=1.0 ghm_zeta=2.0 ghm_omega=1000.0 ghm_frequency_scale=10 band=1,100"
    text = f"&material name='m' density=1100 young=1e6 poisson=0.49 {terms} rayleigh_stiffness=1e-4 /\n"
    (tmp_path / "m.nml").write_text(text, encoding="utf-8")
    found = deck_of(
        tmp_path, fit_material.convert(tmp_path / "m.nml", fit_material.Options(law="maxwell", terms=2), biela).text
    ).one("material")
    assert [found.number(key) for key in ("poisson", "rayleigh_stiffness")] == [0.49, 1e-4]
    assert found.numbers("band") == pytest.approx([10.0, 1000.0])


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
    found, told = fit_material.chosen_fit(fit_material.Options(terms=1), data.frequency, data.modulus)
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


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ({"ghm_alpha": [1.0, 2.0], "ghm_zeta": [1.0], "ghm_omega": [1.0]}, "&material m: the lists of its terms differ in length"),
        ({"prony_alpha": [1.0, -2.0], "prony_tau": [1.0, 2.0]}, "&material m: young and all terms have to be positive"),
        ({"young": [0.0]}, "&material m: young and all terms have to be positive"),
    ],
)
def test_terms_that_make_no_modulus(words, told):
    with pytest.raises(deck.DeckError) as fault:
        of_group(deck.Group("material", {"name": ["m"], "young": [1e6], **words}))
    assert str(fault.value) == told


def test_every_temperature_of_a_fit_is_named():
    frequency = np.logspace(0.0, 2.0, 20)
    law = fit_material.fit("maxwell", 1, frequency, 1.0e6 * (1.0 + 1j * frequency / (10.0 + 1j * frequency)), 1.0e4).material
    for count in (3, 21):
        names = [f"{5 * k} C" for k in range(count)]
        figure = fit_material.picture(law, "", (1.0, 100.0), [(name, frequency, law.modulus(frequency)) for name in names])
        words = (figure.axes[0].get_legend() if count < 8 else figure.legends[0]).get_texts()
        shown = [text.get_text() for text in words]
        assert [word for word in shown if word.endswith(" C")] == names
        figure.savefig(io.BytesIO(), format="png")
