"""`make demo`: it runs the shipped pairs, draws them, and prints figures that are those of the results."""

from __future__ import annotations

import re

import numpy as np
import pytest
from biela import demo
from biela.histories import read
from biela.programs import demo as demo_command
from conftest import ROOT
from PIL import Image


@pytest.fixture
def place(tmp_path, monkeypatch):
    """Work in an empty folder that sees the project's decks."""
    (tmp_path / "input").symlink_to(ROOT / "input")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_demonstration(biela, place, capfd):
    assert demo_command.main(["--biela", str(biela)]) == 0
    told, warned = capfd.readouterr()
    # the solver tells of the paper's two elements what the demonstration measures: once for each deck that has them
    assert len(warned.splitlines()) == 3 * len(demo.PAIRS)
    assert all('body "rod" moves elastically at' in line for line in warned.splitlines())
    figures = re.findall(r"acceleration of qf4 \[rad/s²\] +peak +(\S+) +(\S+) +(\S+) +(\S+) +(\S+)", told)
    assert len(figures) == len(demo.PAIRS)
    for pair, row in zip(demo.PAIRS, figures):
        names = (pair.elastic, pair.viscoelastic, f"{pair.stem}_stiff_twin")
        before, after, stiff = (np.abs(read(place / "results" / name)["qf4.qdd"]).max() for name in names)
        assert [float(word) for word in row] == pytest.approx([before, after, after / before, stiff, after / stiff], rel=2.0e-3)
        assert after < before
    dissipated = read(place / "results" / demo.PAIRS[0].viscoelastic, "energy")["dissipated"]
    assert dissipated[-1] > 0.0
    assert f"energy dissipated by the rod: {dissipated[-1]:.4g} J" in told
    percent = re.search(r"rotation of the middle node \(qf4\) is off by (\d+) % of its range", told)
    twins = re.findall(r"stiff twin: (\S+) E_R, the rod's storage modulus at (\S+) Hz", told)
    assert len(twins) == len(demo.PAIRS)
    for modulus, frequency in twins:
        s = 2j * np.pi * float(frequency)
        expected = 1 + 0.5 * (s**2 + 4e4 * s) / (s**2 + 4e4 * s + 4e8)
        assert float(modulus) == pytest.approx(expected.real, rel=5e-3)
    assert 60 <= int(percent.group(1)) <= 80
    drawn = re.search(r"Pictures in results/demo/: (.*)", told).group(1).split(", ")
    assert len(drawn) == len(demo.PAIRS) + 2
    for name in drawn:
        path = place / "results" / "demo" / name
        assert path.stat().st_size > 5000
        if path.suffix == ".png":
            assert len(Image.open(path).convert("RGB").getcolors(1 << 24)) > 50


def test_the_elastic_twin_dissipates_nothing(biela, place):
    pair = demo.PAIRS[0]
    demo.run(biela, [demo.deck(pair.elastic)])
    assert not read(place / "results" / pair.elastic, "energy")["dissipated"].any()


def test_a_missing_solver_or_deck_is_one_line(biela, place, capfd, monkeypatch):
    assert demo_command.main(["--biela", "nowhere/biela"]) == 1
    assert "nowhere/biela: cannot be started" in capfd.readouterr().err
    monkeypatch.setattr(demo.command, "ROOT", place / "nowhere")
    assert demo_command.main(["--biela", str(biela)]) == 1
    assert capfd.readouterr().err.splitlines()[-1].endswith("ended with status 2")
