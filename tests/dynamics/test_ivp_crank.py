"""The flexible slider-crank of the IVP test set against its converged history."""

from __future__ import annotations

import numpy as np
import pytest
from biela import ivp_crank
from biela.histories import read
from biela.programs import ivp_crank as ivp_crank_command
from biela.tradeoff_settings import Grid
from conftest import REFERENCE, ROOT

COLUMNS = {"rod": "phi2", "slider.x": "x3", "mid.v": "wmid_local"}
# elements: largest errors of rod angle, slider and mid-rod deflection over their ranges, measured; a factor of 1.5 is allowed
MEASURED = {4: (5.7e-5, 1.2e-4, 3.6e-3), 8: (1.7e-5, 3.6e-5, 3.9e-4)}


@pytest.mark.parametrize("elements", sorted(MEASURED))
def test_errors_against_the_converged_history(run_deck, elements):
    text = (ROOT / "input" / "ivp_slider_crank.nml").read_text().replace("elements=8", f"elements={elements}")
    run = run_deck(text.replace("node=5", f"node={elements // 2 + 1}")).history
    reference = read(REFERENCE / "published" / "crank_conv_lin_ini2.csv")
    assert np.array_equal(np.round(run.time, 12), np.round(reference.time, 12))
    for (ours, theirs), measured in zip(COLUMNS.items(), MEASURED[elements]):
        error = np.abs(run[ours] - reference[theirs]).max() / np.ptp(reference[theirs])
        assert error < 1.5 * measured, f"{ours}: {error:.2e}"


def test_end_values(run_deck):
    run = run_deck((ROOT / "input" / "ivp_slider_crank.nml").read_text()).history
    assert run["rod"][-1] == pytest.approx(-0.33119254, abs=5e-6)
    assert run["slider.x"][-1] == pytest.approx(0.16971977, abs=5e-6)
    assert run["mid.v"][-1] == pytest.approx(-1.42199e-4, abs=1e-6)


def test_the_tool_makes_its_table_and_picture_from_any_folder(biela, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(ivp_crank, "MESHES", (2,))
    monkeypatch.setattr(ivp_crank, "RADII", (0.9,))
    assert ivp_crank_command.main(["--methods", "generalized_alpha", "--biela", str(biela)]) == 0
    table = (tmp_path / "results" / "ivp_crank" / "table.txt").read_text()
    assert table in capsys.readouterr().out
    rows = [line.split() for line in table.splitlines()[1:]]
    assert len(rows) == 9
    assert all(row[1:5] == ["generalized_alpha,", "radius", "0.9", "generalized_alpha"] for row in rows)
    finest = [float(word) for word in rows[-1][8:11]]
    for found, measured in zip(finest, (5.6e-5, 1.2e-4, 4.5e-2)):
        assert found == pytest.approx(measured, rel=0.1)
    assert (tmp_path / "results" / "ivp_crank" / "ivp_crank.png").stat().st_size > 10_000


def test_the_tools_faults_are_one_line(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert ivp_crank_command.main(["--biela", "nowhere/biela"]) == 1
    assert capsys.readouterr().err.strip() == "ivp_crank: nowhere/biela: No such file or directory (`make` builds the solver)"
    monkeypatch.setattr(ivp_crank, "rows", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
    assert ivp_crank_command.main(["--biela", __file__]) == 130
    assert "interrupted" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("family", "ladder"),
    [
        ("dopri5", [1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9]),
        ("rk4", [1.0 / (4 * 2**k) for k in range(9)]),
        ("generalized_alpha", [1.0 / 2**k for k in range(9)]),
    ],
)
def test_ladders_of_settings(family, ladder):
    grid = Grid(1.0, 1.0, 1.0, 1.0)
    assert [setting.size(grid) for setting in ivp_crank.settings(family)] == pytest.approx(ladder, rel=1e-12)
