"""The tools as commands: whatever standard output is, no traceback."""

from __future__ import annotations

import argparse
import importlib.util
import os
import subprocess
import sys

import command
import compare
import deck_runs
import histories
import pytest
import tools
from conftest import ROOT

POST = ROOT / "post"
TOOLS = sorted(path.name for path in POST.glob("*.py") if "__main__" in path.read_text(encoding="utf-8"))
SPEAKING = "import sys, command; command.run(lambda: print('4 µs, α = ζ', *range({count})) or {status})"


def speak(count: int, status: int = 0, **keywords) -> subprocess.Popen:
    """Start a tool that prints Greek letters and numbers and ends with a status."""
    environment = {**os.environ, "PYTHONPATH": str(POST), **keywords.pop("env", {})}
    words = [sys.executable, "-c", SPEAKING.format(count=count, status=status)]
    return subprocess.Popen(words, stderr=subprocess.PIPE, env=environment, **keywords)


def test_there_are_tools():
    assert {"demo.py", "compare.py", "plot.py", "animate.py", "modes.py", "tradeoff.py"} <= set(TOOLS)


@pytest.mark.parametrize("tool", TOOLS)
def test_every_tool_begins_and_ends_by_the_same_rule(tool):
    assert (POST / tool).read_text(encoding="utf-8").endswith('if __name__ == "__main__":\n    command.run(main)\n')


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


@pytest.mark.parametrize(
    ("kind", "text", "found"),
    [
        (command.finite, "-1.5e-3", -1.5e-3),
        (command.finite, "nan", "'nan': a number expected"),
        (command.finite, "five", "'five': a number expected"),
        (command.positive, "2", 2.0),
        (command.positive, "0", "'0': a number above 0 expected"),
        (command.positive, "inf", "'inf': a number expected"),
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


def test_commands_of_the_package_are_the_tools():
    called = tools.compare
    assert (called.func, called.args) == (command.run, (compare.main,))
    with pytest.raises(AttributeError):
        _ = tools._private
    with pytest.raises(ModuleNotFoundError, match="no_tool"):
        _ = tools.no_tool


def test_the_package_has_the_reader_and_the_runner():
    spec = importlib.util.spec_from_file_location("biela_as_package", POST / "__init__.py")
    package = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(package)
    assert (package.read, package.History) == (histories.read, histories.History)
    assert {name: getattr(package, name) for name in package.__all__}["Runner"] is deck_runs.Runner
