"""The reader of results: what it returns, and the sentence that each damaged file gets."""

from __future__ import annotations

import re

import numpy as np
import pytest
from biela import histories
from biela.histories import HistoryError, read, read_summary

GOOD = "# biela: sensors\n# columns: t[s] a.q[rad] a.qd[rad/s] b\n0.0 1.0 -2.5e3 1\n1.0e-3 2.0 1E-300 2\n"


@pytest.fixture
def write(tmp_path):
    def put(text, name="history.txt"):
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return put


def test_names_units_and_numbers(write):
    history = read(write(GOOD))
    assert history.names == ["t", "a.q", "a.qd", "b"]
    assert history.units == {"t": "s", "a.q": "rad", "a.qd": "rad/s", "b": ""}
    np.testing.assert_array_equal(history.data, [[0.0, 1.0, -2500.0, 1.0], [1.0e-3, 2.0, 1.0e-300, 2.0]])
    np.testing.assert_array_equal(history.time, [0.0, 1.0e-3])
    np.testing.assert_array_equal(history["a.qd"], [-2500.0, 1.0e-300])
    assert [history.label(name) for name in ("a.q", "b")] == ["a.q [rad]", "b"]


def test_numpy_reads_the_file_as_it_is(write):
    path = write(GOOD)
    np.testing.assert_array_equal(np.loadtxt(path), read(path).data)


def test_seventeen_digits_survive(write):
    value = 0.1 + 0.2
    assert read(write(f"# columns: t[s] x[m]\n0 {value:.17g}\n"))["x"][0] == value


@pytest.mark.parametrize("kind", ["history", "energy", "motion"])
def test_a_folder_stands_for_its_files(write, kind):
    path = write(GOOD, f"{kind}.txt")
    assert read(path.parent, kind).path == path


def test_a_reference_has_commas_and_no_units(write):
    reference = read(write("t,a.q\n0.0,1\n0.5,2\n", "expected.csv"))
    assert reference.names == ["t", "a.q"]
    assert reference.units["a.q"] == ""
    np.testing.assert_array_equal(reference["a.q"], [1.0, 2.0])


def test_patterns_select_in_file_order(write):
    history = read(write(GOOD))
    assert history.match() == ["a.q", "a.qd", "b"]
    assert history.match(["b", "a.*"]) == ["a.q", "a.qd", "b"]
    assert history.match(["*d"]) == ["a.qd"]
    with pytest.raises(HistoryError, match=r"no column matches 'c\*'; it has t, a.q, a.qd, b$"):
        history.match(["c*"])
    with pytest.raises(HistoryError, match=r"no column 'c'; it has t"):
        history["c"]


FAULTS = {
    "empty": ("", "is no history: a line '# columns:' expected"),
    "headless": ("0 1 2\n1 2 3\n", "is no history: a line '# columns:' expected"),
    "rowless": ("# columns: t[s] a\n", "holds no rows (was the run interrupted at its start?)"),
    "short row": (GOOD + "2.0 1.0\n", ":5: 2 values, 4 expected (is the file complete?)"),
    "long row": (GOOD + "2.0 1 2 3 4\n", ":5: 5 values, 4 expected (is the file complete?)"),
    "all rows short": ("# columns: t[s] a b\n0 1\n1 2\n", ":2: 2 values, 3 expected (is the file complete?)"),
    "cut number": (GOOD + "2.0 1.0 3.0e- 1\n", ":5: '3.0e-' is no finite number"),
    "NaN": (GOOD + "2.0 NaN 3.0 1\n", ":5: 'NaN' is no finite number"),
    "infinite": (GOOD + "2.0 1 -Infinity 1\n", ":5: '-Infinity' is no finite number"),
    "twice": ("# columns: t[s] a[m] a[m]\n0 1 2\n", ": the column 'a' is given twice"),
    "odd name": ("# columns: t[s] a[m\n0 1\n", ": 'a[m' is no column name, name[unit] expected"),
    "time stands": (GOOD + "1.0e-3 1 2 3\n", ": t does not increase after row 2 (t = 0.001)"),
    "binary": (b"\xff\xfe\x00", "is no history: a line '# columns:' expected"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_damaged_files_are_named(write, fault):
    text, told = FAULTS[fault]
    path = write(text)
    with pytest.raises(HistoryError) as caught:
        read(path)
    assert str(caught.value).startswith(str(path))
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_damaged_reference_is_named(write):
    with pytest.raises(HistoryError, match=r"expected.csv:3: 1 values, 2 expected"):
        read(write("t,a\n0,1\n1\n", "expected.csv"))
    with pytest.raises(HistoryError, match=r"is no history: names on its first line expected"):
        read(write("", "empty.csv"))


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(HistoryError, match=r"history.txt: no such file \(has the run been made\?\)"):
        read(tmp_path)
    (tmp_path / "modes.txt").touch()
    with pytest.raises(HistoryError, match=r"history.txt: no such file \(this run wrote modes.txt\)"):
        read(tmp_path)
    (tmp_path / "history.txt").touch()
    with pytest.raises(HistoryError, match=r"motion.txt: no such file \(it is written where .* has a motion_step\)"):
        read(tmp_path, "motion")


def test_numbers_as_only_other_programs_write_them(write):
    with pytest.raises(HistoryError, match=r"history.txt: cannot be read as rows of 2 numbers$"):
        read(write("# columns: t[s] a\n0 1\n1 1_0\n"))


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (None, "no such file (has the run been made?)"),
        ("{", "cannot be read (Expecting property name"),
        (b"\xff", "cannot be read (Expecting value"),
        ("[]", "cannot be read (no JSON object)"),
    ],
)
def test_figures_that_are_missing_or_damaged(write, tmp_path, text, told):
    if text is not None:
        write(text, "summary.json")
    with pytest.raises(HistoryError) as fault:
        read_summary(tmp_path)
    assert str(fault.value).startswith(f"{tmp_path}/summary.json: {told}")


def test_tables_of_the_solver_and_large_ones_are_read_by_fast_parsers(write, monkeypatch):
    """Row by row what float() reads; a damaged number is named with its line, whichever parser met it first."""
    values = np.random.default_rng(1).normal(size=(700, 31)) * 10.0 ** np.random.default_rng(2).integers(-300, 300, (700, 31))
    values[:, 0] = np.arange(700)
    digits = [[f"{value:.16E}".partition("E") for value in row] for row in values]
    words = [[f"{mantissa}E{power[0]}{power[1:].zfill(3)}".rjust(25) for mantissa, _, power in row] for row in digits]
    head = "# title: µ\n# columns: t[s] " + " ".join(f"c{k}[m]" for k in range(30)) + "\n"
    text = head + "".join("".join(row) + "\n" for row in words)
    found = read(write(text))
    np.testing.assert_allclose(found.data, values, rtol=5.0e-16)
    assert found.data.flags.f_contiguous
    assert found.ends["c3"] == (found["c3"].min(), found["c3"].max())
    for odd in ("NaN", "1.2345678901234567D+000", "1.23456789012345x7E+000"):
        with pytest.raises(HistoryError, match=re.escape(f"history.txt:702: '{odd}' is no finite number")):
            read(write(head + "".join("".join(row) + "\n" for row in [*words[:699], [*words[699][:-1], odd.rjust(25)]])))
    monkeypatch.setattr(histories, "LARGE", 1000)
    loadtxt = np.loadtxt
    monkeypatch.setattr(np, "loadtxt", lambda *_, **__: pytest.fail("the slow parser reads it"))
    table = "".join(f"{k},{k}.5\n" for k in range(500))
    blanks = re.sub("^", "  ", table.replace(",", "\t  "), flags=re.MULTILINE)
    for text, name in (
        ("\ufefft,a\r\n" + table.replace("\n", "\r\n"), "a.csv"),
        ("t,a\n" + table.replace("7\n", "7\n\n")[:-1], "a.csv"),
        ("# columns: t[s] a[m]\n" + blanks, "a.txt"),
        ("# columns: t[s] a[m]\n" + blanks.replace("\n", " \t\n\n"), "a.txt"),
    ):
        np.testing.assert_array_equal(read(write(text, name)).data, np.arange(500)[:, None] + [0.0, 0.5])
    monkeypatch.setattr(np, "loadtxt", loadtxt)
    for word in ("x", "nan", "1 2", ""):
        with pytest.raises(HistoryError, match=rf"a\.csv:103: '{word}' is no finite number"):
            read(write("t,a\n" + table.replace("101.5", word), "a.csv"))
    with pytest.raises(HistoryError, match=r"a\.csv:103: 1 values, 2 expected"):
        read(write("t,a\n" + table.replace("101,101.5", "101"), "a.csv"))
