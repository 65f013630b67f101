"""The rule by which two histories agree, and compare.py's exit status and messages."""

from __future__ import annotations

import numpy as np
import pytest
from biela.compare import differences
from biela.histories import History, HistoryError
from biela.programs import compare

TIME = np.linspace(0.0, 1.0, 11)


def history(path="run", time=TIME, units=True, **columns):
    names = ["t", *columns]
    kinds = {"t": "s", "x": "m", "y": "m", "zero": "m", "f": "N", "nought": "N", "alone": "kg", "m": "Nm"}
    data = np.column_stack([time, *columns.values()])
    return History(path, names, {name: kinds[name] if units else "" for name in names}, data)


def error(run, reference, name):
    return next(d for d in differences(run, reference) if d.name == name).error


def test_the_error_is_the_largest_difference_over_the_range():
    reference = history(x=2.0 + TIME * 4.0)
    off = np.zeros_like(TIME)
    off[[3, 7]] = 0.1, -0.2
    [found] = differences(history(x=reference["x"] + off), reference, tolerance=0.05)
    assert found.error == pytest.approx(0.05, rel=1.0e-14)
    assert (found.largest, found.scale, found.time) == (pytest.approx(0.2), 4.0, TIME[7])


def test_the_tolerance_is_met_or_not():
    reference, run = history(x=TIME), history(x=TIME + 1.0e-3)
    assert [d.passed for d in differences(run, reference, tolerance=1.1e-3)] == [True]
    assert [d.passed for d in differences(run, reference, tolerance=0.9e-3)] == [False]


def test_a_channel_of_zeros_is_measured_by_its_unit():
    zeros = np.zeros_like(TIME)
    reference = history(x=5.0 * TIME, y=2.0 * TIME, zero=zeros, f=7.0 * TIME, nought=zeros)
    run = history(x=5.0 * TIME, y=2.0 * TIME, zero=zeros + 1.0e-3, f=7.0 * TIME, nought=zeros - 1.4e-2)
    assert error(run, reference, "zero") == pytest.approx(1.0e-3 / 5.0)
    assert error(run, reference, "nought") == pytest.approx(1.4e-2 / 7.0)


def test_rounding_noise_is_a_channel_of_zeros():
    noise = 1.0e-17 * (-1.0) ** np.arange(TIME.size)
    assert error(history(x=TIME, zero=0.0 * TIME), history(x=TIME, zero=noise), "zero") == pytest.approx(1.0e-17)


def test_a_small_channel_that_moves_is_measured_by_itself():
    reference = history(x=TIME, y=1.0e-6 * TIME)
    assert error(history(x=TIME, y=1.1e-6 * TIME), reference, "y") == pytest.approx(0.1)


def test_a_constant_alone_in_its_unit_is_measured_by_its_size():
    one = np.ones_like(TIME)
    assert error(history(alone=3.003 * one), history(alone=3.0 * one), "alone") == pytest.approx(1.0e-3)


def test_a_zero_alone_in_its_unit_is_measured_by_one():
    zeros = np.zeros_like(TIME)
    assert error(history(m=zeros + 2.0e-3), history(m=zeros), "m") == pytest.approx(2.0e-3)


def test_the_units_of_the_run_serve_a_reference_without():
    zeros = np.zeros_like(TIME)
    reference = history(units=False, x=5.0 * TIME, zero=zeros)
    assert error(history(x=5.0 * TIME, zero=zeros + 1.0e-3), reference, "zero") == pytest.approx(2.0e-4)


def test_columns_without_units_do_not_measure_each_other():
    reference = history(units=False, x=100.0 * TIME, alone=np.full_like(TIME, 5.0))
    run = history(units=False, x=100.0 * TIME, alone=np.full_like(TIME, 5.5))
    assert error(run, reference, "alone") == pytest.approx(0.1)


def test_rows_are_matched_by_time_and_further_ones_do_not_count():
    fine = np.linspace(0.0, 1.5, 31)
    x = fine**2
    x[1::2] += 9.0
    assert error(history(time=fine, x=x), history(x=TIME**2), "x") < 1.0e-15


def test_rounding_of_times_is_no_mismatch():
    assert error(history(time=TIME * (1.0 + 1.0e-14), x=TIME), history(x=TIME), "x") == 0.0


@pytest.mark.parametrize("time", [TIME[:-1], TIME[1:], TIME + 0.01, np.delete(TIME, 5)])
def test_a_missing_time_is_refused(time):
    with pytest.raises(HistoryError, match=r"run: no row at t = .* s, which reference has; the nearest is t = "):
        differences(history(time=time, x=time), history("reference", x=TIME))


def test_a_reference_of_one_row():
    reference = history(time=[0.5], x=[2.0])
    assert error(history(x=TIME + 1.5), reference, "x") == 0.0
    with pytest.raises(HistoryError, match=r"no row at t = 0.5"):
        differences(history(time=[0.4], x=[2.0]), reference)


def test_columns_missing_or_in_another_unit_are_refused():
    with pytest.raises(HistoryError, match=r"run: lacks the column 'y' of reference"):
        differences(history(x=TIME), history("reference", x=TIME, y=TIME))
    run = history(x=TIME)
    run.units["x"] = "mm"
    with pytest.raises(HistoryError, match=r"run: x \[mm\] is in another unit in reference: x \[m\]"):
        differences(run, history("reference", x=TIME))


def test_tolerances_by_pattern_and_choice_of_columns():
    reference, run = history(x=TIME, y=TIME, f=TIME), history(x=TIME, y=TIME + 0.1, f=TIME + 0.01)
    found = {d.name: (d.tolerance, d.passed) for d in differences(run, reference, 1.0e-3, None, {"[yf]": 0.05, "y": 0.2})}
    assert found == {"x": (1.0e-3, True), "y": (0.2, True), "f": (0.05, True)}
    assert [d.name for d in differences(run, reference, columns=["x", "f"])] == ["x", "f"]
    with pytest.raises(HistoryError, match="no column matches 'g'"):
        differences(run, reference, 0.0, None, {"g": 1.0})


@pytest.fixture
def files(tmp_path):
    (tmp_path / "expected.csv").write_text("t,x,zero\n0.0,1.0,0.0\n0.1,2.0,0.0\n")
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "history.txt").write_text("# columns: t[s] x[m] zero[m]\n0.0 1.0 0.0\n0.1 2.001 1e-4\n0.2 3 0\n")
    return [str(tmp_path / "run"), str(tmp_path / "expected.csv")]


def test_the_command_tells_by_its_status(files, capsys):
    assert compare.main([*files, "--tolerance", "2e-3"]) == 0
    assert "2 columns, 2 rows (1 further rows of the run not compared): all within tolerance" in capsys.readouterr().out
    assert compare.main([*files, "--tolerance", "5e-4"]) == 1
    told = capsys.readouterr().out
    assert [line.split()[0] for line in told.splitlines() if "TOO LARGE" in line] == ["x"]
    assert "1 too far apart" in told
    assert compare.main([*files, "--tolerance", "5e-4", "--column", "x=2e-3"]) == 0
    assert compare.main([*files, "--tolerance", "5e-4", "--columns", "zero"]) == 0


def test_the_command_refuses_in_one_line(files, capsys, tmp_path):
    assert compare.main([str(tmp_path / "nothing"), files[1]]) == 2
    told = capsys.readouterr().err
    assert told.startswith("compare: ")
    assert told.count("\n") == 1
    assert compare.main([files[1], files[0]]) == 2
    assert "no row at t = 0.2" in capsys.readouterr().err
    for words in (["--tolerance", "-1"], ["--tolerance", "nan"], ["--column", "x"], ["--column", "=1"]):
        with pytest.raises(SystemExit) as ended:
            compare.main([*files, *words])
        assert ended.value.code == 2
