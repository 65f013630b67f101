"""Sweeps: designs, expressions, numbers of runs, failures, resuming, a cluster that loses a worker."""

from __future__ import annotations

import csv
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from biela import mode_following, study_runs, sweep_scalars, sweep_study
from biela.histories import read
from biela.programs import sweep as sweep_command
from biela.sweep_scalars import Scalar
from biela.units import factor
from conftest import ROOT, TIMEOUT, wait_for
from study_decks import ARGUMENT

DECK = """&include file='steel.nml' /
&parameter name='height' value={4*mm} /
&parameter name='width' value={0.08e-3/height} /
&section name='strip' shape='rectangle' width={width} height={height} /
&body name='arm' kind='beam' length=0.5 elements=2 material='steel' section='strip' reference='clamped' /
&joint name='wall' type='weld' body_a='arm' node_a=1 point_b=0.0,0.0 /
&force name='push' type='force' body='arm' node=-1 fx=0.0 fy=1.0 /
&sensor name='tip' quantity='deflection' body='arm' node=-1 /
&sensor name='other' quantity='deflection' body='arm' node=2 /
&transient t_end=0.02 method='rk4' step=2.0e-6 output_step=1.0e-4 motion_step=0.01 /
"""
STUDY = """deck = 'arm.nml'
[[parameter]]
name = 'height'
values = [0.004, 0.006]
[[parameter]]
name = 'force'
set = ['force/push/fy']
from = 1.0
to = 3.0
points = 3
[[result]]
name = 'width'
measure = 'summary'
key = 'parameters.width'
[[result]]
name = 'peak'
measure = 'peak'
column = 'tip.v'
[[result]]
name = 'loss'
measure = 'max'
column = 'residual'
file = 'energy'
"""


@pytest.fixture
def study(tmp_path, biela, monkeypatch):
    """Return a function that runs the study in tmp_path and returns status and the table's rows."""
    (tmp_path / "arm.nml").write_text(DECK, encoding="utf-8")
    (tmp_path / "steel.nml").write_text("&material name='steel' density=7800.0 young=2.1e11 /\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)

    def run(text: str, *words: str) -> tuple[int, list[dict]]:
        (tmp_path / "study.toml").write_text(text, encoding="utf-8")
        status = sweep_command.main(["study.toml", "--biela", str(biela), *words])
        with (tmp_path / "results" / "sweep" / "study" / "table.csv").open(encoding="utf-8") as file:
            return status, list(csv.DictReader(file))

    return run


def test_a_grid_with_a_linked_parameter(study, run_deck, capsys):
    status, rows = study(STUDY, "--best", "min peak", "--where", "force > 1.5", "--jobs", "2")
    assert status == 0
    assert [(row["height"], row["force"]) for row in rows] == [(h, f) for h in ("0.004", "0.006") for f in ("1.0", "2.0", "3.0")]
    assert all(row["failure"] == "" for row in rows)
    peaks = np.array([float(row["peak[m]"]) for row in rows])
    np.testing.assert_allclose(peaks[1:3] / peaks[0], [2.0, 3.0], rtol=1.0e-9)
    width = float(rows[3]["width"])
    np.testing.assert_allclose(width, 0.08e-3 / 0.006)
    alone = run_deck(DECK.replace("{4*mm}", "0.006").replace("{width}", f"{width!r}"), name="alone")
    time, tip = alone.history.time, alone.history["tip.v"]
    np.testing.assert_allclose(peaks[3], Scalar("x", "peak", "c").of(time, tip), rtol=1.0e-12)
    assert "best of 4 runs (min peak, force > 1.5): height = 0.006, force = 2" in capsys.readouterr().out
    assert Path("results/sweep/study/map_peak.png").exists()


def test_a_sweep_goes_on_where_it_was_interrupted(study, monkeypatch, capsys):
    _, whole = study(STUDY, "--no-pictures")
    journal = Path("results/sweep/study/journal.jsonl")
    lines = journal.read_text(encoding="utf-8").splitlines(keepends=True)
    without_values = f'{{"key": {json.dumps(json.loads(lines[0])["key"])}}}\n'
    journal.write_text("".join([without_values, *lines[1:4], "[" * 20_000 + "\n", lines[4][:20]]), encoding="utf-8")
    ran = []
    monkeypatch.setattr(study_runs, "ProcessPoolExecutor", lambda **_: Inline(ran))
    capsys.readouterr()
    Path("results/sweep/study/map_old.png").write_text("of another study")
    Path("results/sweep/study/.drawn").write_text("map_old.png\nnone.png\n")
    for runs in (3, 3):  # the second time there is nothing left to run
        _, rest = study(STUDY, "--no-pictures")
        assert rest == whole
        assert sum(len(batch.runs) for batch in ran) == runs
    assert not Path("results/sweep/study/map_old.png").exists()
    told = "line 1 and 2 more cannot be read; the runs are made again"
    said = capsys.readouterr().err.splitlines()
    assert said[0] == f"sweep: warning: results/sweep/study/journal.jsonl: {told}"
    assert all("6 of 6 designs" in line and "moves elastically" in line for line in said[1:])


class Inline:
    """An executor that works at once and remembers what it was given."""

    def __init__(self, ran: list) -> None:
        self.ran = ran

    def submit(self, work, batch):
        """Work at once."""
        self.ran.append(batch)
        future = study_runs.Future()
        future.set_result(work(batch))
        return future

    def shutdown(self, **_: object) -> None:
        """There is nothing to end."""


def test_runs_that_fail_stand_in_the_table(study):
    text = STUDY.replace("[0.004, 0.006]", "[0.004, -1.0, 0]")
    status, rows = study(text)
    assert status == 0
    assert [row["failure"] != "" for row in rows] == [False] * 3 + [True] * 6
    assert "section/strip: width={width} = -8e-5 is out of range" in rows[3]["failure"]
    assert "divides by 0" in rows[6]["failure"]


def test_all_runs_failed_is_status_1(study):
    assert study(STUDY.replace("[0.004, 0.006]", "[-0.004]"))[0] == 1


def test_a_latin_hypercube_covers_every_stratum(tmp_path):
    path = tmp_path / "s.toml"
    path.write_text("design = 'latin_hypercube'\nsamples = 12\nseed = 3\n" + STUDY, encoding="utf-8")
    points = sweep_study.read(path).points
    strata = sorted(int((point["force"] - 1.0) / 2.0 * 12) for point in points)
    assert strata == list(range(12))
    assert points == sweep_study.read(path).points


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (("deck = 'arm.nml'", "deck = 'none.nml'"), "no such file"),
        (("values = [0.004, 0.006]", "value = [1.0]"), "'value' is not known"),
        (("name = 'height'", "name = 'depth'"), "parameter depth: the deck has no &parameter of that name (height, width)"),
        (("force/push/fy", "force/pull/fy"), "force/pull: the deck has 0 such groups"),
        (("measure = 'peak'", "measure = 'height'"), "one of peak"),
        (("deck = 'arm.nml'", "deck = "), "cannot be read as TOML"),
        (("deck = 'arm.nml'", "deck = 'arm.nml'\ndesign = 'zip'"), "as many values"),
        (("name = 'peak'", "name = 'height'"), "is given twice"),
    ],
)
def test_faulty_studies_end_in_one_line(study, capsys, change, told):
    Path("results/sweep/study").mkdir(parents=True)
    Path("results/sweep/study/table.csv").write_text("old\n", encoding="utf-8")
    assert study(STUDY.replace(*change))[0] == 2
    said = capsys.readouterr().err
    assert told in said
    assert said.count("\n") == 1


def test_a_column_that_is_missing_is_the_reason_of_each_run(study):
    status, rows = study(STUDY.replace("tip.v", "tip.q"))
    assert status == 1
    assert rows[0]["failure"].startswith("history.txt: no column 'tip.q'")


def test_numbers_are_read_as_float_reads_them(run_deck):
    run = run_deck(ROOT / "input" / "slider_crank_viscoelastic.nml")
    found = read(run.folder)
    assert (found.names, found.units) == (run.history.names, run.history.units)
    np.testing.assert_allclose(found.data, run.history.data, rtol=5.0e-16, atol=0.0)


def test_measures_against_closed_forms():
    time = np.linspace(0.0, 4.0, 8001)
    swing = np.exp(-0.7 * time) * np.cos(2.0 * np.pi * 12.5 * time)
    expected = {"decay_rate": 0.7, "spectral_peak": 12.5, "peak": 1.0, "final": swing[-1], "range": 1.0 - swing.min()}
    for measure, value in expected.items():
        assert Scalar("x", measure, "c").of(time, swing) == pytest.approx(value, rel=2.0e-3)
    assert Scalar("x", "rms", "c").of(time, np.sin(2.0 * np.pi * time)) == pytest.approx(np.sqrt(0.5), rel=1.0e-6)
    assert Scalar("x", "value", "c", at=1.2345).of(time, 3.0 * time) == pytest.approx(3.7035)
    assert Scalar("x", "settling_time", "c", band=0.1).of(time, np.minimum(time, 1.0)) == pytest.approx(0.9, abs=1.0e-3)
    assert np.isnan(Scalar("x", "decay_rate", "c").of(time, time))
    settling = Scalar("x", "settling_time", "c")
    assert np.isnan(settling.of(time, np.sin(2.0 * np.pi * 5.03 * time))), "it never settles"
    assert settling.of(time, np.exp(-3.0 * time) * np.sin(30.0 * time)) == pytest.approx(1.2, abs=0.15)
    coarse = np.linspace(0.0, 1.0, 47)  # 23 rows a period, none of them on a crest
    for measure, value in (("peak", 1.0), ("min", -1.0), ("max", 1.0), ("range", 2.0), ("value", np.sin(9.0 * 0.3))):
        assert Scalar("x", measure, "c", at=0.3).of(coarse, np.sin(9.0 * coarse)) == pytest.approx(value, rel=1.0e-5)
    jump = np.where(time < 2.0, 0.0, 1.0 + 0.1 * time)
    assert 1.4 <= Scalar("x", "peak", "c").of(time, jump) <= 1.4 + 1.0e-12


@pytest.mark.parametrize("kind", ["mean", "rms"])
def test_averages_err_by_no_more_than_they_tell(kind):
    """Of half a sine with few rows, of jumps; of whole vibrations, where the trapezoidal rule is exact."""
    t = np.linspace(0.0, 0.5, 11)
    value, error = sweep_scalars.averages(t, np.sin(2.0 * np.pi * t), kind)
    right = 2.0 / np.pi if kind == "mean" else np.sqrt(0.5)
    assert abs(value - right) <= max(error, 1e-15) < 3e-4 * right
    t = np.linspace(0.0, 2.0, 41)
    value, error = sweep_scalars.averages(t, np.sin(2.0 * np.pi * t), kind)
    assert value == pytest.approx(0.0 if kind == "mean" else np.sqrt(0.5), abs=1e-15)
    assert error < 1e-15
    dice = np.random.default_rng(5)
    told = []
    for _ in range(400):
        t = np.linspace(0.0, dice.uniform(0.3, 3.0), dice.integers(9, 60))
        jump, omega, phase = dice.uniform(0.0, t[-1]), dice.uniform(1.0, 0.5 * t.size / t[-1]), dice.uniform(0.0, 6.0)
        size = dice.choice([0.0, 1.0])
        fine = np.linspace(0.0, t[-1], 20001)
        law = lambda x: np.sin(omega * x + phase) + size * (x > jump)  # noqa: B023, E731
        power = 2 if kind == "rms" else 1
        exact = np.trapezoid(law(fine) ** power, fine) / t[-1]
        value, error = sweep_scalars.averages(t, law(t), kind)
        told.append(abs(value - exact ** (1.0 / power)) <= 5.0 * error + 1e-4)
    assert np.mean(told) > 0.9


def test_the_error_of_a_mean_is_told_with_that_of_its_column(tmp_path):
    """Also of a level in dB, and of rows that are read from a time on."""
    t = np.linspace(0.0, 0.5, 12)
    rows = "".join(f"{x:.16e} {np.sin(2 * np.pi * x):.16e}\n" for x in t)
    (tmp_path / "history.txt").write_text("# columns: t[s] a.x[m/s2]\n" + rows)
    told = {"transient": {"estimated_errors": {"a.x[m/s2]": 1e-9}, "worst_error_of_range": 1e-9}}
    (tmp_path / "summary.json").write_text(json.dumps(told))
    scalars = (Scalar("m", "mean", "a.x"), Scalar("r", "rms", "a.x"), Scalar("level", "rms", "a.x", reference=1e-3))
    found = sweep_scalars.measure(tmp_path, scalars, errors=True)
    right = [2.0 / np.pi, np.sqrt(0.5), 20.0 * np.log10(np.sqrt(0.5) / 1e-3)]
    for value, error, exact in zip(found.values, found.errors, right):
        assert 1e-9 <= error < 1e-3 * exact
        assert abs(value - exact) <= 10.0 * error


MEASURED = "t[{}],a[{}]\n" + "".join(f"{x / 10},{1 + x / 5}\n" for x in range(11))


@pytest.mark.parametrize(
    ("time", "unit", "misfit"),
    [("s", "m/s2", 0.0), ("", "", 0.0), ("s", "", 0.0), ("ms", "mm/s2", 0.9980), ("s", "m/s^2", 0.0), ("s", "m/s²", 0.0)],
)
def test_what_was_measured_is_taken_in_its_units(tmp_path, time, unit, misfit):
    """1 + 2 t in m/s2 and s, against the model's 1 + 2 t: in ms and mm/s2 nearly 1 m/s2 apart, over the first millisecond."""
    t = np.linspace(0.0, 1.0, 21)
    rows = "".join(f"{x:.16e} {1 + 2 * x:.16e}\n" for x in t)
    (tmp_path / "history.txt").write_text("# columns: t[s] acc.x[m/s2]\n" + rows)
    (tmp_path / "m.csv").write_text(MEASURED.format(time, unit).replace("[]", ""))
    entry = {"name": "m", "measure": "misfit", "column": "acc.x", "data": "m.csv", "data_column": "a"}
    scalar = sweep_study._scalar(entry, tmp_path)
    (found,) = sweep_scalars.measure(tmp_path, (scalar,)).values
    assert found == pytest.approx(misfit, abs=2e-3 if misfit else 1e-12)


@pytest.mark.parametrize(("time", "unit"), [("s", "m/s"), ("Hz", "m/s2"), ("s", "volt"), ("s", "rad/s2")])
def test_units_that_do_not_go_together_are_refused(tmp_path, time, unit):
    (tmp_path / "history.txt").write_text("# columns: t[s] acc.x[m/s2]\n0 1\n0.5 2\n1 3\n")
    (tmp_path / "m.csv").write_text(MEASURED.format(time, unit))
    entry = {"name": "m", "measure": "misfit", "column": "acc.x", "data": "m.csv", "data_column": "a"}
    with pytest.raises(ValueError, match=r"what was measured of acc\.x: the unit"):
        sweep_scalars.measure(tmp_path, (sweep_study._scalar(entry, tmp_path),))


@pytest.mark.parametrize(
    ("unit", "wanted", "size"),
    [("g", "kg", 1e-3), ("ms", "s", 1e-3), ("kNm", "Nm", 1e3), ("N mm", "Nm", 1e-3), ("rpm", "rad/s", np.pi / 30),
     ("deg/s", "rad/s", np.pi / 180),
     ("N/mm2", "Pa", 1e6), ("mm/s²", "m/s2", 1e-3), ("1/min", "Hz", 1 / 60), ("%", "-", 0.01), ("MPa", "Pa", 1e6),
     ("min", "s", 60.0), ("mN", "N", 1e-3), ("µm", "m", 1e-6)],
)  # fmt: skip
def test_units_are_converted(unit, wanted, size):
    assert factor(unit, wanted) == pytest.approx(size, rel=1e-14)


@pytest.mark.parametrize("second", ["set = 'force/push/fy'", "set = 'FORCE/Push/fy'", "set = ['force/push/fx', 'force/push/fy']"])
def test_one_place_is_set_by_one_parameter(tmp_path, second):
    text = STUDY.replace("[[result]]", f"[[parameter]]\nname = 'other'\n{second}\nvalues = [1, 2]\n[[result]]", 1)
    (tmp_path / "twice.toml").write_text(text)
    with pytest.raises(sweep_study.StudyError, match="force/push/fy is set twice"):
        sweep_study.read(tmp_path / "twice.toml")


def test_lists_and_items_of_them_are_set_once(tmp_path):
    for places in (["h/x", "h/x(2)"], ["h/x(2)", "h/x"], ["h/x(2)", "h/x(2)"]):
        entries = [{"name": f"p{k}", "set": one, "values": [1]} for k, one in enumerate(places)]
        parameters = [sweep_study._parameter(entry, tmp_path) for entry in entries]
        with pytest.raises(sweep_study.StudyError, match="is set twice"):
            sweep_study._once(tuple(parameters))
    parameters = [sweep_study._parameter({"name": f"p{k}", "set": f"h/x({k})", "values": [1]}, tmp_path) for k in (1, 2)]
    sweep_study._once(tuple(parameters))
    own = [sweep_study._parameter({"name": "L", "values": [1]}, tmp_path)]
    own.append(sweep_study._parameter({"name": "m", "set": "parameter/l/value", "values": [1]}, tmp_path))
    with pytest.raises(sweep_study.StudyError, match="parameter/l/value is set twice"):
        sweep_study._once(tuple(own))


def test_extremes_at_corners_and_jumps_are_those_of_rows():
    """Whatever runs straight from row to row has no value beyond them; the force of a stop has a corner where it is let go."""
    time = np.linspace(0.0, 1.0, 101)
    pushes = np.maximum(0.0, 4000.0 * np.sin(4.0 * np.pi * time + 0.3))
    assert Scalar("x", "min", "c").of(time, pushes) == 0.0
    assert Scalar("x", "max", "c").of(time, pushes) == pytest.approx(4000.0, rel=1.0e-9)
    assert Scalar("x", "value", "c", at=0.235).of(time, pushes) == 0.0
    chance = np.random.default_rng(12)
    for _ in range(300):
        knots = np.cumsum(chance.integers(4, 9, size=9))
        straight = np.interp(np.arange(70.0), knots, chance.normal(size=9))
        straight[chance.integers(70) :] += chance.choice([0.0, 1.0])
        for measure, row in (("max", straight.max()), ("min", straight.min()), ("peak", np.abs(straight).max())):
            assert Scalar("x", measure, "c").of(np.arange(70.0), straight) == pytest.approx(row, rel=1.0e-13)
    x = np.arange(-5.0, 6.0)
    for left, right in ((1.0, 0.1), (1.0, 1.0), (3.0, 0.2)):  # a corner between two arcs, in a row
        assert Scalar("x", "max", "c").of(x, np.where(x < 0.0, left * x, -right * x) - 0.01 * x * x) == 0.0


def test_a_force_keeps_the_sensor_that_it_depends_on(study):
    """A mass on the force -k x let go at x = 1: its speed is least at a quarter of the period, -sqrt(k)."""
    Path("arm.nml").write_text(ARGUMENT, encoding="utf-8")
    text = "deck = 'arm.nml'\n[[parameter]]\nname = 'k'\nvalues = [4.0, 9.0]\n"
    status, rows = study(text + "[[result]]\nname = 'v'\nmeasure = 'min'\ncolumn = 'v.x'\n", "--no-pictures")
    assert status == 0
    np.testing.assert_allclose([float(row["v[m/s]"]) for row in rows], [-2.0, -3.0], rtol=1.0e-9)
    result = "[[result]]\nname = '{}'\nmeasure = 'min'\ncolumn = 'v.x'\n{}"
    status, (row, _) = study(text + result.format("v", "") + result.format("w", "to = 0.25\n"), "--end", "0.5", "--no-pictures")
    assert float(row["v[m/s]"]) == pytest.approx(-2.0 * np.sin(1.0), rel=1.0e-9), "the last row that counts"
    assert float(row["w[m/s]"]) == pytest.approx(-2.0 * np.sin(0.5), rel=1.0e-9), "a result's own end goes first"


OSCILLATORS = """&parameter name='k' value=400 /
&body name='a' mass=1 inertia=1 /
&joint name='ga' type='prismatic' body_a='a' direction=0 /
&spring name='sa' type='linear' body_a='a' point_b=-1,0 stiffness={k} damping=0.4 free_length=1 /
&body name='b' mass=1 inertia=1 position=0,1 /
&joint name='gb' type='prismatic' body_a='b' direction=0 point_b=0,1 /
&spring name='sb' type='linear' body_a='b' point_b=-1,1 stiffness=900 damping=3 free_length=1 /
&static /
&modal modes=2 /
"""


def test_a_vibration_is_followed_by_its_shape(study, capsys):
    """Two masses on springs, k and 900 N/m: the first is the lowest vibration of the deck, and passes the second one at k = 900."""
    Path("arm.nml").write_text(OSCILLATORS, encoding="utf-8")
    text = "deck = 'arm.nml'\n[[parameter]]\nname = 'k'\nvalues = [400.0, 800.0, 1600.0, 3200.0]\n"
    text += "".join(f"[[result]]\nname = '{name}'\nmeasure = '{name}'\nmode = 1\n" for name in ("frequency", "damping_ratio"))
    status, rows = study(text, "--no-pictures")
    assert status == 0
    stiffness = np.array([400.0, 800.0, 1600.0, 3200.0])
    ratio = 0.2 / np.sqrt(stiffness)
    np.testing.assert_allclose([float(row["damping_ratio"]) for row in rows], ratio, rtol=1.0e-9)
    expected = np.sqrt(stiffness * (1.0 - ratio**2)) / (2.0 * np.pi)
    np.testing.assert_allclose([float(row["frequency[Hz]"]) for row in rows], expected, rtol=1.0e-9)
    for change, told in (
        (("mode = 1", "mode = 3"), "mode = 3: the deck has 2 vibrations"),
        (("'arm.nml'", "'still.nml'"), "the deck has no modes to follow: "),
    ):
        Path("still.nml").write_text(OSCILLATORS.replace("&modal modes=2 /\n", ""), encoding="utf-8")
        assert study(text.replace(*change), "--no-pictures")[0] == 2
        assert told in capsys.readouterr().err


def test_a_vibration_is_followed_from_design_to_design(study):
    """The same masses with 200 N/m between them: the lowest one moves from the one to the other where the springs are alike."""
    coupled = "&spring name='ab' type='linear' body_a='a' body_b='b' point_b=-1,-1 stiffness=200 free_length=1 /\n"
    still = OSCILLATORS.replace("damping=0.4 ", "").replace("damping=3 ", "")
    Path("arm.nml").write_text(still + coupled, encoding="utf-8")
    text = "deck = 'arm.nml'\n[[parameter]]\nname = 'k'\nfrom = 300.0\nto = 2000.0\npoints = 18\n"
    status, rows = study(text + "[[result]]\nname = 'f'\nmeasure = 'frequency'\nmode = 1\n", "--no-pictures")
    assert status == 0
    lowest = [np.linalg.eigvalsh([[float(row["k"]) + 200.0, -200.0], [-200.0, 1100.0]])[0] for row in rows]
    np.testing.assert_allclose([float(row["f[Hz]"]) for row in rows], np.sqrt(lowest) / (2.0 * np.pi), rtol=1.0e-9)


DUFFING = """&parameter name='w' value=1.0 /
&scene /
&body name='mass' mass=1 inertia=1 position=0,0 /
&joint name='rail' type='prismatic' body_a='mass' direction=0 /
&history name='law' kind='polynomial' coefficients=0,1,0,1 /
&spring name='k' type='linear' body_a='mass' body_b='ground' point_b=-20,0 characteristic='law' damping=0.1 free_length=20 /
&history name='h' kind='sine' amplitude=0.3 frequency={w/(2*pi)} phase={pi/2} /
&force name='f' type='force' body='mass' fx=1 history='h' /
&sensor name='x' quantity='position' body='mass' /
&periodic period={2*pi/w} multipliers=2 /
&transient method='rk4' step={2*pi/w/200} /
"""


def test_cycles_follow_a_branch(study, tmp_path, run_deck):
    """Duffing's oscillator at rising frequency stays on the high branch, where a start at rest finds the low one."""
    (tmp_path / "duffing.nml").write_text(DUFFING, encoding="utf-8")
    words = "deck = 'duffing.nml'\nfollow = true\n[[parameter]]\nname = 'w'\nfrom = 1.0\nto = 1.6\npoints = 7\n"
    words += "[[result]]\nname = 'peak'\nmeasure = 'max'\ncolumn = 'x.x'\n"
    words += "[[result]]\nname = 'largest'\nmeasure = 'summary'\nkey = 'periodic.largest_multiplier'\n"
    status, rows = study(words)
    assert status == 0
    assert all(float(row["largest"]) < 1 for row in rows)
    rest = run_deck(DUFFING, "--set", "w=1.6").history["x.x"].max()
    found = [(float(row["w"]), float(row["peak[m]"])) for row in rows]
    for w, peak in [*found, (1.6, rest)]:  # harmonic balance
        squares = np.roots([0.75**2, -1.5 * (w**2 - 1), (w**2 - 1) ** 2 + (0.1 * w) ** 2, -0.09])
        size = np.sqrt(squares[np.abs(squares.imag) < 1e-9].real)
        assert np.abs(size / peak - 1).min() < 0.06
    assert found[-1][1] > 5 * rest


def test_a_winner_is_told_with_its_warnings(study, capsys):
    """A tip force of 500 N bends the arm by more than the model holds for: such a run is the best only where that is allowed."""
    text = STUDY.replace("to = 3.0", "to = 500.0").replace("points = 3", "points = 2").replace("[0.004, 0.006]", "[0.004]")
    _, rows = study(text, "--best", "max peak", "--no-pictures")
    told = capsys.readouterr()
    assert [int(row["warnings"]) for row in rows] == [1, 3]
    assert "best of 1 runs (max peak): height = 0.004, force = 1," in told.out
    assert "1 of 2 runs are left out: the model does not hold for their motion (--allow-warnings)" in told.out
    assert told.err.count('sweep: warning: 1 of 2 designs (height = 0.004, force = 500): body "arm" deflects by') == 1
    assert told.err.count("sweep: warning: 2 of 2 designs (height = 0.004, force = 1; height = 0.004, force = 500): ") == 1
    study(text, "--best", "max peak", "--no-pictures", "--allow-warnings")
    out = capsys.readouterr().out
    assert "best of 2 runs (max peak): height = 0.004, force = 500," in out
    assert out.count("  warning: ") == 3


def test_a_shape_that_no_vibration_has_is_told(run_deck):
    """A vibration with a motion that no mass has, 1.5 times its size: its likeness is 1/(1 + 1.5^2)."""
    run = run_deck(OSCILLATORS)
    _, shapes = sweep_scalars.vibrations(read(run.folder, "modes"))
    across = np.zeros(shapes.shape[1])
    across[1] = 1.0  # no mass moves that way
    mixed = shapes[0] / np.linalg.norm(shapes[0]) + 1.5 * across
    parts = tuple(float(x) for value in mixed for x in (value.real, value.imag))
    scalars = (Scalar("f", "frequency", mode=1, shape=parts),)
    wanted = sweep_study.Study("s", run.folder, (), scalars, ({},))
    entry = {
        "reason": "",
        "values": [np.nan],
        "units": ["Hz"],
        "warnings": [],
        "modes": sweep_scalars.measure(run.folder, scalars).modes,
    }
    (told,) = mode_following.Followed(wanted).take(wanted, [entry])
    assert told["warnings"] == ["no vibration is like mode 1 of the design nearest to this one (at most 0.31 of 1)"]
    assert told["reason"] == ""
    assert np.isnan(told["values"]).all()


def test_solvers_end_with_a_sweep_that_is_killed(study, biela, tmp_path):
    study(STUDY, "--no-pictures")
    deck = tmp_path / "arm.nml"
    deck.write_text(re.sub(r"t_end=\S+", "t_end=1e4", deck.read_text(encoding="utf-8")), encoding="utf-8")
    words = [sys.executable, ROOT / "post" / "sweep.py", "study.toml", "--biela", biela, "--keep", "--jobs", "2"]
    sweep = subprocess.Popen(words, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    kept = tmp_path / "results" / "sweep" / "study" / "runs" / "results"
    wait_for(kept / "000000" / "energy.txt", sweep)
    sweep.kill()
    sweep.wait(timeout=TIMEOUT)
    until = time.monotonic() + TIMEOUT
    while list(kept.glob("*/.lock")) and time.monotonic() < until:
        time.sleep(0.02)
    assert "outcome: stopped by signal 15" in (kept / "000000" / "summary.txt").read_text(encoding="utf-8")


@pytest.mark.long
def test_a_cluster_that_loses_a_worker_gives_the_same_table(study):
    distributed = pytest.importorskip("distributed")
    text = STUDY.replace("points = 3", "points = 30")
    _, here = study(text, "--no-pictures")
    Path("results/sweep/study/journal.jsonl").unlink()
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
        victim = next(iter(cluster.workers.values())).pid
        child = os.fork()
        if child == 0:
            time.sleep(0.4)
            os.kill(victim, signal.SIGKILL)
            os._exit(0)
        _, there = study(text, "--no-pictures", "--scheduler", cluster.scheduler_address)
        os.waitpid(child, 0)
    assert there == here


def test_no_scheduler_is_told_in_one_line(study, capsys, monkeypatch):
    distributed = pytest.importorskip("dask.distributed")
    client = distributed.Client
    monkeypatch.setattr(distributed, "Client", lambda address, **_: client(address, timeout="1s"))  # not its 10 s
    Path("results/sweep/study").mkdir(parents=True)
    Path("results/sweep/study/table.csv").write_text("old\n", encoding="utf-8")
    assert study(STUDY, "--scheduler", "tcp://127.0.0.1:9")[0] == 2
    assert "no scheduler answers" in capsys.readouterr().err


def test_histories_are_read_by_their_own_reader_too(study):
    study(STUDY, "--keep", "--no-pictures")
    kept = Path("results/sweep/study/runs")
    assert "other.v" in read(kept / "results" / "000000")
    running = kept.with_name("running")
    running.mkdir()
    study(STUDY.replace("points = 3", "points = 2"), "--no-pictures")
    assert not running.exists(), "what a study that was killed has left"
    assert len(list(kept.glob("0*"))) == 6
    study(STUDY.replace("points = 3", "points = 2"), "--keep", "--no-pictures")
    assert len(list(kept.glob("0*"))) == 4, "those before are gone"


def test_what_is_wrong_with_the_command_ends_it_in_one_line(study, capsys):
    Path("results/sweep/study").mkdir(parents=True)
    Path("results/sweep/study/table.csv").write_text("old\n", encoding="utf-8")
    Path("text").write_text("no program\n", encoding="utf-8")
    for words, told in (
        (["--biela", "nothing"], "nothing: no such program: build it with make, or name it with --biela"),
        (["--biela", "text", "--no-pictures"], "text: cannot be run (Permission denied): `make` builds it, --biela names another"),
        (["--output", "arm.nml/there"], "arm.nml/there: Not a directory"),
    ):
        assert study(STUDY, *words)[0] == 2
        said = capsys.readouterr().err
        assert said.startswith("sweep: ")
        assert said.endswith(f"{told}\n")
        assert said.count("\n") == 1
    assert Path("results/sweep/study/table.csv").read_text(encoding="utf-8") == "old\n"


def test_a_table_that_cannot_be_written(study, capsys):
    Path("out/table.csv").mkdir(parents=True)
    Path("results/sweep/study").mkdir(parents=True)
    Path("results/sweep/study/table.csv").write_text("old\n", encoding="utf-8")
    assert study(STUDY.replace("points = 3", "points = 2"), "--output", "out")[0] == 2
    assert capsys.readouterr().err == "sweep: out/table.csv: cannot be written (Is a directory)\n"


class Interrupted(Inline):
    """An executor that Ctrl-C reaches when it gets its fourth batch."""

    def submit(self, work, batch):
        """Work at once, or be interrupted."""
        if len(self.ran) == 3:
            raise KeyboardInterrupt
        return super().submit(work, batch)


def test_an_interrupted_sweep_says_how_to_go_on(study, monkeypatch, capsys):
    Path("results/sweep/study").mkdir(parents=True)
    Path("results/sweep/study/table.csv").write_text("old\n", encoding="utf-8")
    text = STUDY.replace("points = 3", "points = 2")
    ran = []
    monkeypatch.setattr(study_runs, "ProcessPoolExecutor", lambda **_: Interrupted(ran))
    assert study(text, "--jobs", "1")[0] == 2
    assert capsys.readouterr().err == "sweep: interrupted after 3 of 4 runs; the same command continues\n"
    monkeypatch.setattr(study_runs, "ProcessPoolExecutor", lambda **_: Inline(ran))
    ran.clear()
    assert study(text, "--no-pictures")[0] == 0
    assert len(ran) == 1
    journal = Path("results/sweep/study/journal.jsonl")
    written = journal.read_bytes()
    journal.write_bytes(written + b"\xff\xfe cut\n")
    monkeypatch.setattr(study_runs, "ProcessPoolExecutor", lambda **_: pytest.fail("all was run before"))
    status, rows = study(text, "--no-pictures")
    assert (status, len(rows)) == (0, 4)


def test_without_the_package_of_dask_the_command_names_it(study, monkeypatch, capsys):
    Path("results/sweep/study").mkdir(parents=True)
    Path("results/sweep/study/table.csv").write_text("old\n", encoding="utf-8")
    monkeypatch.setitem(sys.modules, "dask.distributed", None)
    assert study(STUDY, "--scheduler", "tcp://127.0.0.1:9")[0] == 2
    assert capsys.readouterr().err == "sweep: --scheduler needs the package distributed: pip install 'dask[distributed]'\n"


OSCILLATOR = """&parameter name='speed' value=8 /
&parameter name='idle' value=1 /
&body name='mass' mass=1 inertia=1 position=0.1,0 /
&joint name='rail' type='prismatic' body_a='mass' direction=0 /
&spring name='k' type='linear' body_a='mass' body_b='ground' point_b=-2,0 stiffness=100 damping=1 free_length=2.1 /
&history name='h' kind='sine' amplitude=5 frequency={speed/2/pi} phase={pi/2} /
&force name='f' type='force' body='mass' fx=1 history='h' /
&sensor name='x' quantity='position' body='mass' /
&periodic period={2*pi/speed} multipliers=2 /
&transient method='rk4' step={2*pi/speed/400} output_step={2*pi/speed/100} /
"""
MAP = """deck = 'oscillator.nml'
design = 'zip'
follow = true
parameter = [{name = 'speed', values = [8, 8, 10, -1, 12]}, {name = 'idle', values = [1, 2, 3, 4, 5]}]
result = [{name = 'range', measure = 'range', column = 'x.x'},
          {name = 'multiplier', measure = 'summary', key = 'periodic.largest_multiplier'},
          {name = 'turns', measure = 'summary', key = 'periodic.turns_to_cycle'}]
"""


def test_cycles_over_speed_follow_one_another(study, tmp_path):
    """An oscillator under a harmonic force: its amplitude and its multipliers are known; the same cycle again needs one turn."""
    (tmp_path / "oscillator.nml").write_text(OSCILLATOR)
    status, rows = study(MAP, "--jobs", "2")
    assert status == 0
    assert [row["failure"] != "" for row in rows] == [False, False, False, True, False]
    for row in rows:
        speed = float(row["speed"])
        if not row["failure"]:
            size = 5.0 / np.hypot(100.0 - speed**2, speed)
            assert float(row["range[m]"]) == pytest.approx(2.0 * size, rel=1e-6)
            assert float(row["multiplier"]) == pytest.approx(np.exp(-np.pi / speed), abs=1e-8)
    assert [float(rows[k]["turns"]) for k in (0, 1, 2)] == [4.0, 1.0, 5.0]
    journal = Path("results/sweep/study/journal.jsonl").read_text().splitlines()
    Path("results/sweep/study/journal.jsonl").write_text("\n".join(journal[:2]) + "\n")
    assert study(MAP)[1] == rows, "a row of cycles is made anew as a whole"
