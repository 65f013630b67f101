"""The tools as commands: whatever standard output is, no traceback."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys

import biela
import known_optima
import pytest
from biela import command, histories, programs
from conftest import ROOT

POST = ROOT / "post"
GREEK = r"'4 \xb5s, \u03b1 = \u03b6'"  # ASCII: no locale of the child decides how its source is read
SPEAKING = f"import sys; from biela import command; command.run('speak', lambda: print({GREEK}, *range({{count}})) or {{status}})"


def speak(count: int, status: int = 0, **keywords) -> subprocess.Popen:
    """Start a tool that prints Greek letters and numbers and ends with a status."""
    environment = {**os.environ, "PYTHONPATH": str(POST), **keywords.pop("env", {})}
    words = [sys.executable, "-c", SPEAKING.format(count=count, status=status)]
    return subprocess.Popen(words, stderr=subprocess.PIPE, env=environment, **keywords)


@pytest.mark.parametrize(
    ("tool", "library", "words"),
    [("fit_material", "scipy", ["run.csv"]), ("plot", "matplotlib", ["run"]), ("optimise", "scipy", ["study.toml"])],
)
def test_a_library_that_is_missing_is_told(tmp_path, biela, tool, library, words):
    """A search loads scipy in a thread, when it begins."""
    known_optima.write(tmp_path, known_optima.PROBLEMS["Branin, three minima"])
    (tmp_path / "deck.nml").write_text(MOVING)
    code = f"import sys; sys.modules['{library}'] = None; from biela import programs; programs.{tool}()"
    environment = {**os.environ, "PYTHONPATH": str(POST), "BIELA": str(biela)}
    line = [sys.executable, "-c", code, *words]
    done = subprocess.run(line, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    told = f"the Python package '{library}' is missing: `make setup` installs it, or pip install {library}"
    assert (done.returncode, done.stderr.partition(": ")[2]) == (2, told + "\n")


MOVING = """&parameter name='x' value=1 /
&parameter name='y' value=1 /
&body name='b' mass=1 inertia=1 /
&sensor name='f' quantity='angle' body='b' /
&transient t_end=1 step=1 /
"""
SHOWN = {"ascii": "4 ?s, ? = ? 0", "latin-1": "4 µs, ? = ? 0", "utf-8": "4 µs, α = ζ 0"}


@pytest.mark.parametrize(("encoding", "shown"), SHOWN.items())
def test_letters_that_the_terminal_lacks_are_replaced(encoding, shown):
    child = speak(1, 3, stdout=subprocess.PIPE, env={"PYTHONIOENCODING": encoding, "PYTHONUTF8": "0"})
    told, warned = child.communicate(timeout=120)
    assert (told.decode(encoding).strip(), warned, child.returncode) == (shown, b"", 3)


@pytest.mark.parametrize("count", [1, 100_000])
def test_a_reader_that_has_gone_ends_a_tool_quietly(count):
    read, write = os.pipe()
    os.close(read)
    child = speak(count, stdout=write)
    os.close(write)
    _, warned = child.communicate(timeout=120)
    assert (warned, child.returncode) == (b"", 141)


def test_a_closed_standard_output_changes_nothing():
    child = speak(1, 3, preexec_fn=lambda: os.close(1))
    _, warned = child.communicate(timeout=120)
    assert (warned, child.returncode) == (b"", 3)


def test_ctrl_c_ends_a_tool_with_one_line(capsys):
    def stop() -> int:
        raise KeyboardInterrupt

    with pytest.raises(SystemExit) as ended:
        command.run("report", stop)
    assert (ended.value.code, capsys.readouterr().err) == (130, "report: interrupted\n")


@pytest.mark.parametrize(
    ("kind", "text", "found"),
    [
        (command.finite, "-1.5e-3", -1.5e-3),
        (command.finite, "nan", "'nan': a number expected"),
        (command.finite, "five", "'five': a number expected"),
        (command.positive, "2", 2.0),
        (command.positive, "0", "'0': a number above 0 expected"),
        (command.positive, "inf", "'inf': a number above 0 expected"),
        (command.count, "3", 3),
        (command.count, "0", "'0': a whole number of at least 1 expected"),
        (command.count, "1.5", "'1.5': a whole number of at least 1 expected"),
    ],
)
def test_numbers_of_a_command_line(kind, text, found):
    if isinstance(found, str):
        with pytest.raises(argparse.ArgumentTypeError) as fault:
            kind(text)
        assert str(fault.value) == found
    else:
        assert kind(text) == found


def test_commands_of_the_package_are_those_of_the_table():
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    for name in programs.PROGRAMS:
        assert f'biela-{name.replace("_", "-")} = "biela.programs:{name}"\n' in text


def test_the_package_has_the_reader_and_the_runner():
    assert (biela.read, biela.History) == (histories.read, histories.History)
    assert all(hasattr(biela, name) for name in biela.__all__)
    with pytest.raises(AttributeError, match="no attribute 'write'"):
        _ = biela.write
