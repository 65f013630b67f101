"""The places at which `make mutants` makes mistakes, and what stands in the source with them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "mutants"))

import mutants


def test_mistakes_are_made_in_statements_only():
    sources, told = mutants.draw(400, 1)
    assert len(told) == 400
    planted = [(path, s) for path, found in sources.items() for s in found if s.mistakes]
    assert len({path for path, _ in planted}) > 100
    for path, statement in planted:
        lines = path.read_text(encoding="utf-8").split("\n")
        first = lines[statement.start]
        assert first.startswith(statement.lines[0])
        assert not first.lstrip().startswith(("!", "use ", "end ", "case"))
        assert "::" not in first.split("!")[0]


@pytest.mark.parametrize(
    ("source", "first", "text"),
    [
        ("x = a + b", "x = a - b", ["if (planted(1)) then", "x = a - b", "else", "x = a + b", "end if"]),
        ("if (a > b) exit", "if (a >= b) exit", ["if (planted(1)) then", "if (a >= b) exit", "else", "if (a > b) exit", "end if"]),
        ("if (a > b) then", "if (a >= b) then", ["if ((planted(1) .and. (a >= b)) .or. (.not. (planted(1)) .and. (a > b))) then"]),
        ("do i = 1, f(n, 3)", "do i = 2, f(n, 3)", ["do i = merge(2, 1, planted(1)), f(n, 3)"]),
    ],
)
def test_each_mistake_stands_behind_its_question(source, first, text):
    (statement,) = mutants.can_be_mistaken(mutants.statements(source))
    number, column, old, new = statement.candidates()[0]
    line = statement.lines[number]
    statement.mistakes[1] = [line[:column] + new + line[column + len(old) :]]
    assert statement.mistakes[1] == [first]
    assert statement.text() == text


@pytest.mark.parametrize("source", ["real(wp) :: x = 1.0", "case (1)", "end if", "pure subroutine f(x)", "x = 1; y = 2", "else"])
def test_what_cannot_be_mistaken(source):
    assert mutants.can_be_mistaken(mutants.statements(source)) == []


def test_the_copy_builds_from_what_it_has(tmp_path, monkeypatch):
    copy = tmp_path / "copy"
    monkeypatch.setattr(mutants, "COPY", copy)
    monkeypatch.setattr(mutants, "SEEN", copy / "seen")
    mutants.prepare()
    mutants.write(mutants.draw(1, 1)[0])
    done = subprocess.run(["make", "-n", "all"], cwd=copy, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert {"deck_keys.f90", "system_calls.o"} <= {word.split("/")[-1] for word in done.stdout.split()}
