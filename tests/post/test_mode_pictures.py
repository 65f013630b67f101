"""Pictures of modes, poles and responses: files that are there and not blank, the right rows and columns, faults in one line."""

import os
import re
from pathlib import Path

import numpy as np
import pytest
from biela import animate
from biela import mode_pictures as modes
from biela.histories import History, HistoryError, read
from biela.programs import modes as modes_command
from linear_scenes import FORCE, beam, sweep
from PIL import Image

GHM = "ghm_alpha=0.5 ghm_zeta=2.0 ghm_omega=1000.0"


@pytest.fixture
def run(run_deck):
    """Return a run with modes and a response."""
    return run_deck(beam(6, ghm=GHM) + FORCE + sweep(1.0, 300.0, 30))


def ink(path):
    """Return the fraction of pixels that are not white."""
    return float(np.mean(np.asarray(Image.open(path).convert("L")) < 250))


def test_all_three_pictures_are_drawn(run, capsys):
    assert modes_command.main([str(run.folder)]) == 0
    found = [run.folder / f"modal_{name}.png" for name in ("modes", "poles", "response")]
    assert capsys.readouterr().out == f"wrote {', '.join(map(str, found))}\n"
    assert all(ink(path) > 0.005 for path in found)


def test_shares_of_layers_are_bars_that_add_up(run_deck, run):
    """A tape under a cover and a free layer: of the loss they have all together."""
    assert modes.draw_shares(read(run.folder, "modes")) is None
    deck = (
        "&material name='m' density=7850.0 young=2.1e11 /\n"
        f"&material name='tape' density=1000.0 shear_modulus=4e5 {GHM} /\n&material name='pad' density=1200.0 young=1e9 {GHM} /\n"
        "&section name='s' layers='m','tape','m','pad' thickness=2e-3,0.25e-3,0.5e-3,1e-3 width=0.02 cores=2 /\n"
        "&body name='b' kind='beam' length=0.25 elements=4 section='s' reference='clamped' /\n"
        "&joint name='wall' type='weld' body_a='b' node_a=1 /\n&modal modes=2 /\n"
    )
    layered = run_deck(deck, name="layered")
    figure = modes.draw_shares(read(layered.folder, "modes"))
    bars = [[bar.get_height() for bar in axis.patches] for axis in figure.axes]
    np.testing.assert_allclose(np.reshape(bars[0], (2, 2)).sum(axis=0), 1.0, rtol=1e-9)
    assert np.all(np.reshape(bars[1], (2, 2)).sum(axis=0) < 0.5)
    assert min(bars[0]) > 1e-3
    assert modes_command.main([str(layered.folder)]) == 0
    assert all(ink(layered.folder / f"modal_{name}.png") > 0.005 for name in ("shares", "slip"))


def test_shear_of_cores_is_drawn_along_the_beam(run_deck, run):
    """A full cover, simply supported: the core of mode n shears as cos n pi x/L, most at the ends."""
    assert modes.draw_slip(read(run.folder, "modes"), [0]) is None
    deck = (
        "&material name='m' density=7850.0 young=2.1e11 /\n"
        f"&material name='tape' density=1000.0 shear_modulus=4e5 {GHM} /\n"
        "&section name='s' layers='m','tape','m' thickness=2e-3,0.25e-3,0.5e-3 width=0.02 /\n"
        "&body name='b' kind='beam' length=0.25 elements=8 section='s' /\n&joint name='a' type='revolute' body_a='b' node_a=1 /\n"
        "&joint name='c' type='slider' body_a='b' node_a=-1 /\n&modal modes=2 /\n"
    )
    table = read(run_deck(deck, name="covered").folder, "modes")
    figure = modes.draw_slip(table, modes.chosen_rows(table, None))
    for n, line in enumerate(figure.axes[0].lines[:2], 1):
        x, shear = line.get_data()
        np.testing.assert_allclose(x, np.linspace(0.0, 0.25, 9), atol=1e-12)
        np.testing.assert_allclose(shear * shear[0], np.cos(4 * n * np.pi * x), atol=3e-3)


def test_a_shape_is_drawn_where_the_file_puts_it(run):
    table = read(run.folder, "modes")
    rows = modes.chosen_rows(table, [1, 2])
    assert [int(table["kind"][row]) for row in rows] == [modes.VIBRATION] * 2
    scene = modes.moved(table, rows[0])
    body = scene.bodies["b"]
    rest, up, down = (body.to_global(k, body.local[k]) for k in range(3))
    np.testing.assert_allclose(rest[:, 1], 0.0, atol=1e-14)
    np.testing.assert_allclose(up[:, 1], -down[:, 1], rtol=1e-12)
    shape = np.array([table[f"b.{k}.y.re"][rows[0]] for k in range(1, 8)])
    np.testing.assert_allclose(up[:, 1] / up[-1, 1], shape / shape[-1], rtol=1e-10)
    assert np.max(np.abs(up[:, 1])) == pytest.approx(modes.SIZE * 0.8, rel=1e-12)


def test_columns_that_are_rounding_are_left_out_unless_asked_for(run):
    table = read(run.folder, "frequency_response")
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


def test_rounding_does_not_stretch_the_axes_of_the_poles():
    figure = modes.draw_poles(poles((1, 0, -1e-13, 1e-9), (2, 1, -1e-10, 300.0), (3, 1, -20.0, 4000.0)))
    axis = figure.axes[0]
    assert axis.xaxis.get_transform().linthresh == 10.0
    assert axis.yaxis.get_transform().linthresh == 100.0


def test_numbers_of_poles_at_one_place_stand_side_by_side():
    figure = modes.draw_poles(poles((1, 1, -1.0, 50.0), (2, 1, -30.0, 4000.0), (3, 1, -30.1, 4010.0)))
    assert sorted(text.get_text() for text in figure.axes[0].texts) == ["1", "2, 3"]
    assert figure.axes[0].get_xlabel() == "real part [1/s], logarithmic, linear within ±1"


def test_a_response_says_to_what(run):
    table = read(run.folder, "frequency_response")
    figure = modes.draw_response(table, ["tip.v", "tip.r"])
    assert re.fullmatch(r'response to force "\w+", per unit of its history', figure.get_suptitle())
    assert [axis.get_ylabel() for axis in figure.axes] == ["amplitude [m]", "phase [°]", "amplitude [rad]", "phase [°]"]


def test_faults_are_one_line(run, tmp_path, capsys):
    assert modes_command.main([str(tmp_path / "nowhere")]) == 2
    assert modes_command.main([str(run.folder), "--modes", "9"]) == 2
    told = capsys.readouterr().err.splitlines()
    assert len(told) == 2
    assert "neither" in told[0]
    assert "no mode 9" in told[1]


def test_a_file_without_positions_is_refused(run):
    table = run.folder / "modes.txt"
    table.write_text("\n".join(line for line in table.read_text().splitlines() if not line.startswith("# positions")))
    with pytest.raises(HistoryError, match="positions"):
        modes.positions(table)


SHAPES = "# positions: {}\n# columns: number[-] mode[-] kind[-] frequency[Hz] damping_ratio[-]{}\n"
COLUMNS = "".join(f" b.{c}.{part}[-]" for c in ("x", "y", "angle") for part in ("re", "im"))


@pytest.mark.parametrize(
    ("places", "columns", "told"),
    [
        ("0 0 0", COLUMNS, ""),
        ("0 0", COLUMNS, "2 positions for 3 shape columns"),
        ("0 0 x", COLUMNS, "its line '# positions:' is damaged (could not convert string to float: 'x')"),
        ("0 0 0", "", "has no columns of shapes"),
    ],
)
def test_a_damaged_file_of_modes_is_told(tmp_path, places, columns, told):
    path = tmp_path / "modes.txt"
    path.write_text(SHAPES.format(places, columns) + "1 1 0 5.0 0.0" + " 0.5" * len(columns.split()) + "\n")
    if told:
        with pytest.raises(HistoryError) as fault:
            modes.moved(read(path), 0)
        assert str(fault.value) == f"{path}: {told}"
    else:
        assert modes.moved(read(path), 0).bodies["b"].frame.shape == (3, 3)


def test_panels_that_shapes_do_not_need_are_empty(run):
    table = read(run.folder, "modes")
    (row,) = modes.chosen_rows(table, [1])
    corners = modes.moved(table, row).extent()
    count = next(n for n in range(2, 20) if np.prod(animate.tiles(n, *corners)[:2]) > n)
    figure = modes.draw_shapes(table, [row] * count, title="a beam")
    titles = [axis.get_title() for axis in figure.axes]
    assert titles == [modes.caption(table, row)] * count + [""] * (len(titles) - count)
    assert [axis.axison for axis in figure.axes] == [bool(title) for title in titles]
    assert len(titles) > count
    assert figure.get_suptitle() == "a beam"


def test_the_file_itself_stands_for_its_folder(run, monkeypatch, capsys):
    monkeypatch.setattr(modes, "save", lambda _, stem, part: f"{stem}{part}")
    folder = run.folder
    assert modes_command.main([str(folder / "modes.txt"), "--modes", "1"]) == 0
    assert capsys.readouterr().out == f"wrote {folder}/modal_modes, {folder}/modal_poles, {folder}/modal_response\n"


def test_a_response_of_which_no_file_tells_the_input(tmp_path):
    assert modes.input_of(tmp_path / "none.txt") == ""
    (tmp_path / "f.txt").write_text("# columns: f[Hz]\n1.0\n")
    assert modes.input_of(tmp_path / "f.txt") == ""
    (tmp_path / "f.txt").write_text("# input: force tip; per unit\n1.0\n")
    assert modes.input_of(tmp_path / "f.txt") == "response to force tip, per unit of its history"
