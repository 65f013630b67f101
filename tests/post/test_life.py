"""Lives by stresses with a sign: what a fully reversed bending does; sizes of stresses are refused where cycles or means count."""

from __future__ import annotations

import pytest
from biela import sweep_work
from biela.histories import read
from biela.programs import spectrum as spectrum_command
from biela.sweep_scalars import Scalar, measure
from biela.sweep_study import StudyError
from biela.sweep_work import StudyOptions

DECK = """&material name='steel' density=7850 young=2.1e11 rayleigh_stiffness=1e-4 /
&section name='s' shape='rectangle' width=0.02 height=0.01 /
&body name='rod' kind='beam' length=0.2 elements=2 material='steel' section='s' reference='clamped' {more} /
&joint name='clamp' type='weld' body_a='rod' node_a=1 /
&history name='f' kind='sine' offset={offset} amplitude=1 frequency=5 /
&force name='f' body='rod' node=-1 fy=200 history='f' /
&sensor name='root' quantity='internal' body='rod' element=1 /
&sensor name='most' quantity='stress' body='rod' /
&transient t_end=2 method='radau' tolerance=1e-6 output_step=2e-3 /
"""
LIFE = {"strength": 120e6, "cycles": 2e6, "slope": 5}  # 200 N over 0.2 m and 3.333e-7 m3: 120 MPa


@pytest.fixture(scope="module")
def run(run_deck_once):
    return run_deck_once(DECK.format(more="axial=.false.", offset=0))


@pytest.mark.parametrize("column", ["root.top", "root.bottom", "most.top", "most.bottom"])
def test_ten_reversed_cycles_take_ten_of_two_millions(run, column):
    """The vibration of the rod adds 0.03 %."""
    found = measure(run.folder, (Scalar("x", "damage", column, **LIFE), Scalar("y", "mean", column), Scalar("z", "range", column)))
    assert found.values[0] == pytest.approx(10 / 2e6, rel=5e-3)
    assert abs(found.values[1]) < 1e5
    assert found.values[2] == pytest.approx(240e6, rel=2e-3)


def test_both_fibres_of_bending_under_a_mean_load(run_deck):
    """Pulled by 20 kN along and bent between 0 and 120 MPa: top and bottom differ, and add up to twice the pull."""
    deck = DECK.format(more="", offset=1).replace("fy=200", "fy=100") + "&force name='p' body='rod' node=-1 fx=2e4 /\n"
    h = run_deck(deck.replace("t_end=2", "t_end=0.4") + "&static /\n").history
    assert (h["root.top"] + h["root.bottom"])[20:].mean() == pytest.approx(2e8, rel=1e-3)
    assert h["root.bottom"].max() == pytest.approx(1e8 + 120e6, rel=5e-3)
    assert h["root.top"].min() == pytest.approx(1e8 - 120e6, rel=3e-2)


@pytest.mark.parametrize("options", [["--rainflow"], ["--life", "120e6", "2e6", "5"]])
def test_cycles_of_a_size_are_refused_with_what_to_take(run, capsys, options):
    assert spectrum_command.main([str(run.folder), "--columns", "root.s", *options]) != 0
    assert "root.s is a size, which has no cycles: take root.top and root.bottom" in capsys.readouterr().err
    assert spectrum_command.main([str(run.folder), "--columns", "root.top", *options]) == 0
    told = capsys.readouterr().out
    assert told.startswith("root.top: 10 cycles, largest range 2.4")
    assert "note" not in told


@pytest.mark.parametrize("words", [{"measure": "damage", **LIFE}, {"measure": "mean"}])
def test_measures_that_need_a_sign_refuse_a_size(run, words):
    with pytest.raises(ValueError, match=f"most.s is a size, which has no {words['measure']}: take most.top and most.bottom"):
        measure(run.folder, (Scalar("x", column="most.s", **words),))
    assert measure(run.folder, (Scalar("x", "peak", "most.s"),)).values[0] == pytest.approx(120e6, rel=2e-3)


def test_a_study_refuses_a_size_before_its_first_run(biela, tmp_path):
    (tmp_path / "deck.nml").write_text(DECK.format(more="", offset=0), encoding="utf-8")
    study = 'deck = "deck.nml"\n[[parameter]]\nname = "F"\nset = "force/f/fy"\nvalues = [200]\n[[result]]\nname = "d"\n'
    (tmp_path / "study.toml").write_text(study + 'measure = "mean"\ncolumn = "root.s"\n', encoding="utf-8")
    with pytest.raises(StudyError, match="is a size, which has no mean"):
        sweep_work.prepare(StudyOptions(study=tmp_path / "study.toml", biela=biela))
    (tmp_path / "study.toml").write_text(study + 'measure = "mean"\ncolumn = "root.top"\n', encoding="utf-8")
    sweep_work.prepare(StudyOptions(study=tmp_path / "study.toml", biela=biela))


def test_a_stress_that_moves_is_told(run_deck, capsys):
    """A beam held at both ends and pushed in its middle at another beat: the place of the largest stress changes."""
    deck = DECK.format(more="", offset=0).replace("node=-1 fy=200", "node=2 fy=400").replace("t_end=2", "t_end=0.4")
    deck = deck.replace("&history", "&joint name='end' type='weld' body_a='rod' node_a=-1 point_b=0.2,0 /\n&history", 1)
    run = run_deck(deck)
    assert len(set(read(run.folder)["most.along"])) > 1
    spectrum_command.main([str(run.folder), "--columns", "most.top", "--life", "120e6", "2e6", "5"])
    assert "note: most.top is of places that change, with up to" in capsys.readouterr().out
