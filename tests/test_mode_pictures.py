"""Pictures of modes, poles and responses: files that are there and not blank, the right rows and columns, faults in one line."""

import os
import re
from pathlib import Path

import modes
import numpy as np
import pytest
from histories import History, HistoryError, read
from PIL import Image
from test_frequency_response import FORCE, sweep
from test_modal import beam

GHM = "ghm_alpha=0.5 ghm_zeta=2.0 ghm_omega=1000.0"


@pytest.fixture
def run(run_deck, tmp_path):
    """Return a run with modes and a response, and its deck."""
    deck = beam(6, ghm=GHM) + FORCE + sweep(1.0, 300.0, 30)
    return run_deck(deck), tmp_path / "scene.nml"


def ink(path):
    """Return the fraction of pixels that are not white."""
    return float(np.mean(np.asarray(Image.open(path).convert("L")) < 250))


def test_all_three_pictures_are_drawn(run, capsys):
    done, deck = run
    assert modes.main([str(done.folder), "--deck", str(deck)]) == 0
    for name in ("modes", "poles", "response"):
        for ending in ("png", "pdf"):
            assert f"modal_{name}.{ending}" in capsys.readouterr().out or (done.folder / f"modal_{name}.{ending}").is_file()
        assert ink(done.folder / f"modal_{name}.png") > 0.005


def test_a_shape_is_drawn_where_the_file_puts_it(run):
    table = read(run[0].folder, "modes")
    rows = modes.chosen_rows(table, [1, 2])
    assert [int(table["kind"][row]) for row in rows] == [modes.VIBRATION] * 2
    scene = modes.moved(table, rows[0], None)
    body = scene.bodies["b"]
    rest, up, down = (body.to_global(k, body.local[k]) for k in range(3))
    np.testing.assert_allclose(rest[:, 1], 0.0, atol=1e-14)
    np.testing.assert_allclose(up[:, 1], -down[:, 1], rtol=1e-12)
    shape = np.array([table[f"b.{k}.y.re"][rows[0]] for k in range(1, 8)])
    np.testing.assert_allclose(up[:, 1] / up[-1, 1], shape / shape[-1], rtol=1e-10)
    assert np.max(np.abs(up[:, 1])) == pytest.approx(modes.SIZE * 0.8, rel=1e-12)


def test_columns_that_are_rounding_are_left_out_unless_asked_for(run):
    table = read(run[0].folder, "frequency_response")
    assert modes.sensors(table, None) == ["tip.v", "tip.r"]
    assert modes.sensors(table, ["tip.u"]) == ["tip.u"]


def poles(*rows):
    """Return a table of poles: (mode, kind, real, imag)."""
    names = ["number", "mode", "kind", "real", "imag"]
    return History(Path("modes.txt"), names, {}, np.array([[k + 1.0, *row] for k, row in enumerate(rows)]))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("span", [3.0, 30.0, 300.0])
def test_poles_of_any_size_are_drawn_without_a_warning(span):
    draw = np.random.default_rng(14)
    for _ in range(4):
        size = 10.0 ** draw.uniform(-span, span, (6, 2))
        rows = [(k + 1, draw.integers(0, 4), -s[0] * draw.integers(0, 2), s[1]) for k, s in enumerate(size)]
        figure = modes.draw_poles(poles(*rows))
        figure.savefig(os.devnull, format="png")
        modes.plt.close(figure)


def test_rounding_does_not_stretch_the_axes_of_the_poles():
    figure = modes.draw_poles(poles((1, 0, -1e-13, 1e-9), (2, 1, -1e-10, 300.0), (3, 1, -20.0, 4000.0)))
    axis = figure.axes[0]
    assert axis.xaxis.get_transform().linthresh == 10.0
    assert axis.yaxis.get_transform().linthresh == 100.0
    modes.plt.close(figure)


def test_numbers_of_poles_at_one_place_stand_side_by_side():
    figure = modes.draw_poles(poles((1, 1, -1.0, 50.0), (2, 1, -30.0, 4000.0), (3, 1, -30.1, 4010.0)))
    assert [text.get_text() for text in figure.axes[0].texts] == ["1", "2, 3"]
    modes.plt.close(figure)


def test_a_response_says_to_what(run):
    table = read(run[0].folder, "frequency_response")
    figure = modes.draw_response(table, ["tip.v", "tip.r"])
    assert re.fullmatch(r'response to force "\w+", per unit of its history', figure.get_suptitle())
    assert [axis.get_ylabel() for axis in figure.axes] == ["amplitude [m]", "phase [°]", "amplitude [rad]", "phase [°]"]
    modes.plt.close(figure)


def test_faults_are_one_line(run, tmp_path, capsys):
    assert modes.main([str(tmp_path / "nowhere")]) == 2
    assert modes.main([str(run[0].folder), "--modes", "9"]) == 2
    told = capsys.readouterr().err.splitlines()
    assert len(told) == 2
    assert "neither" in told[0]
    assert "no mode 9" in told[1]


def test_a_file_without_positions_is_refused(run):
    table = run[0].folder / "modes.txt"
    table.write_text("\n".join(line for line in table.read_text().splitlines() if not line.startswith("# positions")))
    with pytest.raises(HistoryError, match="positions"):
        modes.positions(table)
