"""biela from Python: run, results as arrays and figures, one exception; the notebook of post/ as it stands."""

from __future__ import annotations

import json
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import biela as package
import numpy as np
import pytest
from biela import export, session
from biela.programs import export as export_command
from conftest import ROOT

DECK = """&parameter name='L' value=1.0 /
&body name='b' kind='rigid' mass=1.0 inertia=0.1 com={L},0.0 /
&joint name='j' type='revolute' body_a='b' /
&history name='h' kind='table' file='load.txt' /
&force name='f' type='torque' body='b' moment=1.0 history='h' /
&sensor name='a' quantity='angle' body='b' /
&transient t_end=0.1 method='rk4' step=1e-3 output_step=1e-2 /
"""


@pytest.fixture(autouse=True)
def built(biela, monkeypatch, tmp_path):
    """Work in a folder with a table's file, with the solver under test."""
    monkeypatch.setenv("BIELA", str(biela))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "load.txt").write_text("0.0 1.0\n1.0 1.0\n")


def test_decks_by_text_and_by_path_find_their_files_and_take_values(tmp_path):
    """Under 1 N m the angle is t^2/2 over the inertia, which is 0.1 + L^2."""
    (tmp_path / "deck.nml").write_text(DECK)
    for deck in (DECK, "deck.nml", tmp_path / "deck.nml"):
        for values, inertia in (({}, 1.1), ({"L": 2}, 4.1), ({"body/b/com(1)": 0.0, "body/b/mass": np.float64(3.0)}, 0.1)):
            found = package.run(deck, set=values)
            assert found["a"][-1] == pytest.approx(0.1**2 / 2 / inertia)
            assert found.time[-1] == 0.1
    assert found.summary.transient.steps == 100
    assert found.summary.scene.bodies.b.mass == found.summary.scene.bodies[0]["mass"] == 3.0
    assert found.to_dataframe("energy").columns[0] == "t_[s]"
    assert found.findings()["work of drives and loads"].endswith(" J")
    assert "<table>" in found._repr_html_()
    assert package.run(DECK, folder=tmp_path / "kept").folder == tmp_path / "kept"
    assert {path.name for path in (tmp_path / "kept").iterdir()} >= {"history.txt", "summary.json"}


def test_whatever_goes_wrong_is_one_exception_with_the_words_of_the_solver():
    for call, told in (
        (lambda: package.run(DECK, set={"M": 2}), "--set M=2 names no parameter"),
        (lambda: package.run(DECK.replace("mass=1.0", "mas=1.0")), "unknown variable mas, did you mean mass?"),
        (lambda: package.run("none.nml"), "none.nml: cannot be read"),
        (lambda: package.run(DECK, solver="none"), "no solver: looked at none and for `biela` on the PATH"),
        (lambda: package.run(DECK, set={"body/x/mass": 1}), "--set body/x/mass=1 names 0 groups of the deck, expected one"),
        (lambda: package.run(DECK, set={"L": float("nan")}), "L: nan: a finite number expected"),
        (lambda: package.run(DECK, set={"L": None}), "L: NoneType is no value of a deck"),
        (lambda: package.run(DECK)["b"], "no column 'b'"),
        (lambda: package.fit("none.csv"), "none.csv: no such file"),
        (lambda: package.fit("none.csv", law="kelvin"), "--law kelvin: one of ghm, maxwell expected"),
        (lambda: package.sweep("none.toml"), "none.toml: no such file"),
        (lambda: package.tradeoff("none.nml"), "none.nml: cannot be read"),
    ):
        with pytest.raises(package.BielaError) as fault:
            call()
        assert told in str(fault.value)
    with pytest.raises(AttributeError, match="no 'nothing'; there are version"):
        _ = package.run(DECK).summary.nothing


def test_fits_in_threads_are_those_of_one_after_the_other_and_leave_nothing(tmp_path, capsys):
    """Data come back; nothing is printed, drawn or written, and the streams of the process stay what they are."""
    before = sys.stdout, sys.stderr
    table = ROOT / "input" / "materials" / "elastomer.csv"
    kinds = [("maxwell", 3), ("ghm", 2), ("maxwell", 2)] * 2
    with ThreadPoolExecutor(6) as pool:
        found = list(pool.map(lambda kind: package.fit(table, law=kind[0], terms=kind[1], density=1200), kinds))
    assert (sys.stdout, sys.stderr) == before
    assert capsys.readouterr() == ("", "")
    assert {path.name for path in tmp_path.iterdir()} == {"load.txt"}
    for one, (law, terms) in zip(found, kinds):
        alone = package.fit(table, law=law, terms=terms, density=1200)
        assert (one.text, one.error) == (alone.text, alone.error)
        frame = one.to_dataframe()
        fitted, measured = (frame[f"{a}E_stor_[Pa]"] * (1 + 1j * frame[f"{a}loss_factor"]) for a in ("fit.", ""))
        off = fitted / measured
        assert np.sqrt(np.mean(np.abs(off - 1.0) ** 2)) == pytest.approx(one.error, rel=1e-12)
    assert "<pre>! 3 Maxwell terms fitted to elastomer.csv" in found[0]._repr_html_()
    assert package.fit(table, "kept", terms=3).warnings == []
    assert {path.name for path in (tmp_path / "kept").iterdir()} == {"elastomer.nml", "elastomer.png"}


def test_a_spectrum_is_data(capsys):
    """The rate of a mass on 400 N/m that is let go: one line at 20/(2 pi) Hz."""
    deck = """&body name='b' mass=1 inertia=1 position=1.1,0 /
&joint name='g' type='prismatic' body_a='b' /
&spring name='s' type='linear' body_a='b' stiffness=400 free_length=1 /
&sensor name='x' quantity='position' body='b' /
&transient t_end=4 method='dopri5' tolerance=1e-9 output_step=0.01 /
"""
    arm = package.run(deck)
    (line,) = package.spectrum(arm, "x.x", start=0.5).lines
    assert abs(line.frequency - 20.0 / (2.0 * np.pi)) <= line.error < 0.02
    assert line.amplitude == pytest.approx(0.1, rel=0.01)
    found = package.spectrum(arm.history, ["x.x"])
    assert found.to_dataframe()["column"].tolist() == ["x.x"]
    assert capsys.readouterr() == ("", "")


def test_a_study_gives_its_table(tmp_path):
    (tmp_path / "deck.nml").write_text(DECK)
    lines = "[[parameter]]\nname='L'\nvalues=[1.0, 2.0]\n[[result]]\nname='end'\nmeasure='final'\ncolumn='a'\n"
    (tmp_path / "study.toml").write_text("deck = 'deck.nml'\n" + lines)
    found = package.sweep("study.toml", folder="out", jobs=1)
    np.testing.assert_allclose(found.to_dataframe()["end[rad]"], [0.005 / 1.1, 0.005 / 4.1])
    assert found.best("min end")["L"] == 2.0
    assert "study: 2 runs, 0 failed" in found._repr_html_()
    assert package.sweep("study.toml", folder="out", jobs=1).rows == found.rows, "stored"
    with pytest.raises(package.BielaError, match="sweep: got an unexpected keyword argument 'job'"):
        package.sweep("study.toml", job=1)


def test_what_studies_give_is_data_and_nothing_is_printed(tmp_path, capsys):
    """The angle under 1 N m at 0.1 s, 0.005/(0.1 + L^2): its derivative, and its least value between 1 and 2."""
    (tmp_path / "deck.nml").write_text(DECK)
    lines = "best = 'min end'\n[[parameter]]\nname='L'\nfrom=1.0\nto=2.0\n[[result]]\nname='end'\nmeasure='final'\ncolumn='a'\n"
    (tmp_path / "study.toml").write_text("deck = 'deck.nml'\n" + lines)
    with ThreadPoolExecutor(2) as pool:
        slopes, best = (pool.submit(f, "study.toml", jobs=1) for f in (package.sensitivity, package.optimise))
        slopes, best = slopes.result(), best.result()
    (row,) = slopes.to_dataframe().to_dict("records")
    assert (row["result"], row["parameter"], row["at"]) == ("end", "L", 1.0)
    assert row["derivative"] == pytest.approx(-0.01 / 1.1**2, rel=1e-6)
    assert (best.feasible, best.parameters.L) == (True, pytest.approx(2.0))
    assert best.results.end == pytest.approx(0.005 / 4.1)
    assert "L is at its upper end" in best._repr_html_()
    speed = package.tradeoff("deck.nml", tolerance=1e-3, methods=["rk4"], time=20.0, jobs=1)
    assert speed.meets
    assert speed.recommended.read_text().startswith("! ")
    assert speed.verdict.split()[0] in speed.text
    assert speed.to_dataframe()["error"].min() < 1e-3
    assert capsys.readouterr() == ("", "")
    assert not list(tmp_path.rglob("*.png"))


def test_hdf5_and_a_library_that_is_missing(tmp_path, monkeypatch, capsys):
    h5py = pytest.importorskip("h5py")
    found = package.run(DECK, folder="run")
    assert export_command.main(["run", "--to", "hdf5"]) == 0
    with h5py.File(tmp_path / "run" / "history.h5") as file:
        np.testing.assert_array_equal(file["a"], found["a"])
        assert file["a"].attrs["unit"] == "rad"
    for form, library, wanted in (("hdf5", "h5py", "'biela[hdf5]'"), ("matlab", "scipy.io", "scipy")):
        monkeypatch.setitem(sys.modules, library, None)
        assert export_command.main(["run", "--to", form]) == 2
        told = f"export: --to {form}: the library {library.split('.')[0]} is missing: pip install {wanted}\n"
        assert capsys.readouterr().err.endswith(told)
    assert set(export.EXTRAS) == {*export.TABLES, "vtk"}


def test_the_notebook_runs(monkeypatch, capsys):
    """Its cells in one Python, as a kernel runs them; what a cell ends with is shown."""
    monkeypatch.chdir(ROOT / "post")
    before = set((ROOT / "post").iterdir())
    cells = json.loads((ROOT / "post" / "biela.ipynb").read_text())["cells"]
    names: dict = {}
    for cell in cells:
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), "biela.ipynb", "exec"), names)
            assert cell["outputs"] == []
    names["plt"].close("all")
    assert names["arm"].warnings == []
    assert names["best"] in names["heights"][1:], "some bend too far, some do not"
    assert "h" in capsys.readouterr().out.splitlines()[-1]
    assert set((ROOT / "post").iterdir()) == before


def test_help_waits_for_no_large_library():
    words = "import sys, biela; biela.BielaError; print({'numpy', 'scipy', 'pandas', 'matplotlib'} & {*sys.modules})"
    done = subprocess.run(
        [sys.executable, "-c", words], capture_output=True, text=True, check=True, env={"PYTHONPATH": f"{ROOT}/post"}
    )
    assert done.stdout == "set()\n"
    assert session.Figures(a=1).a == 1
