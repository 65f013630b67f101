"""draw.py: every deck of input/ is drawn from what the solver assembles, with all of its names."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
import random_scenes
from biela import BielaError, draw
from biela.histories import HistoryError
from biela.picture_files import save
from conftest import ROOT
from matplotlib.colors import to_rgb
from matplotlib.text import Annotation


@pytest.mark.parametrize(
    "name", ["four_bar", "quick_return", "slider_crank_joint_both", "clearance_slider_crank", "bouncing_linkage"]
)
def test_all_names_are_drawn(name, biela):
    figures = draw.figures_of(ROOT / "input" / f"{name}.nml", biela)
    figure = draw.draw(figures)
    shown = " ".join(text.get_text() for text in figure.axes[0].texts)
    for kind in ("bodies", "joints", "drives", "springs", "stops", "forces", "sensors"):
        for item in figures["scene"][kind]:
            assert item["name"] in shown
    axis = figure.axes[0]
    assert axis.get_xlabel() == "x [m]"
    shown = [point for body in figures["scene"]["bodies"] for point in (body["centre"], *body["nodes"])]
    for x, y in shown + [wall for stop in figures["scene"]["stops"] for wall in draw.walls(stop)]:
        assert axis.get_xlim()[0] < x < axis.get_xlim()[1]
        assert axis.get_ylim()[0] < y < axis.get_ylim()[1]


def test_layers_are_drawn_to_one_scale_where_they_are(biela):
    """The rod: 4 mm of steel; tape and cover above it over the middle 0.3 m, hatched where a layer damps."""
    figure = draw.draw(draw.figures_of(ROOT / "input" / "clad_rod.nml", biela))
    found = [(patch.get_xy()[:-1], patch.get_hatch()) for patch in figure.axes[0].patches if len(getattr(patch, "xy", ())) == 5]
    assert len(found) == 10 + 2 * 6
    steel = [corners for corners, hatch in found if hatch is None and corners[:, 1].min() < 0.0]
    scale = np.ptp(steel[0][:, 1]) / 4e-3
    tape = [corners for corners, hatch in found if hatch]
    assert len(tape) == 6
    assert scale > 1.0
    np.testing.assert_allclose([np.min(tape, axis=(0, 1))[0], np.max(tape, axis=(0, 1))[0]], [0.15, 0.45], rtol=1e-9)
    np.testing.assert_allclose([np.min(tape, axis=(0, 1))[1], np.max(tape, axis=(0, 1))[1]], [2e-3 * scale, 2.1e-3 * scale])


SHIPPED = sorted(path.stem for path in (ROOT / "input").glob("*.nml"))


@pytest.mark.parametrize(
    "numbers", [[4], pytest.param(range(50), marks=pytest.mark.long), pytest.param([], marks=pytest.mark.long)]
)
def test_names_stand_apart_in_random_and_in_shipped_scenes(numbers, biela, tmp_path):
    """The renderer says so, see tests/conftest.py."""
    decks = [tmp_path / f"{number}.nml" for number in numbers] or [ROOT / "input" / f"{name}.nml" for name in SHIPPED]
    for number, deck in zip(numbers, decks):
        deck.write_text(random_scenes.scene(5, number).text)
    for deck in decks:
        save(draw.draw(draw.figures_of(deck, biela)), tmp_path / "scene")


def test_a_deck_and_its_results_draw_the_same(biela, run_deck, tmp_path):
    text = (ROOT / "input" / "slider_crank_elastic.nml").read_text().replace("t_end=0.01", "t_end=1e-4")
    run = run_deck(text)
    checked = draw.figures_of(tmp_path / "scene.nml", biela)
    assert draw.figures_of(run.folder, biela)["scene"] == checked["scene"]
    checked["scene"]["sensors"][0]["at"]["at"] = [0.1]
    with pytest.raises(HistoryError, match=r"summary\.json: has no scene that can be drawn \("):
        draw.draw(checked)


def test_a_faulty_deck_is_told_as_the_solver_tells_it(biela, tmp_path):
    (tmp_path / "bad.nml").write_text("&scene titel='x' /\n")
    script = ROOT / "post" / "draw.py"
    command = [sys.executable, script, "bad.nml", "--biela", biela]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "bad.nml:1" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_missing_solver_and_one_that_says_nothing_are_told(tmp_path):
    with pytest.raises(BielaError, match=r"none: cannot be run \(No such file or directory\): `make` builds it"):
        draw.figures_of(tmp_path / "deck.nml", tmp_path / "none")
    (tmp_path / "mute").write_text("#!/bin/sh\nexit 3\n")
    (tmp_path / "mute").chmod(0o755)
    with pytest.raises(HistoryError, match=r"deck\.nml: biela --check ended with status 3$"):
        draw.figures_of(tmp_path / "deck.nml", tmp_path / "mute")


def test_a_drive_along_a_line_is_an_arrow_that_way(biela, tmp_path):
    (tmp_path / "deck.nml").write_text(
        "&body name='block' kind='rigid' mass=1.0 inertia=0.1 position=1.0,0.0 /\n"
        "&drive name='push' type='position' body_a='block' direction=0.5 history='rest' /\n"
        "&history name='rest' kind='polynomial' coefficients=0.8775825618903728 /\n"
    )
    figure = draw.draw(draw.figures_of(tmp_path / "deck.nml", biela))
    arrows = [text for text in figure.axes[0].texts if isinstance(text, Annotation) and not text.get_text()]
    (arrow,) = [one for one in arrows if one.arrow_patch.get_edgecolor()[:3] == to_rgb(draw.DRIVE)]
    along = np.subtract(arrow.xy, arrow.xyann)
    assert np.arctan2(along[1], along[0]) == pytest.approx(0.5)
