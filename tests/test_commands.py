"""The tools as commands: whatever standard output is, no traceback."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
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
