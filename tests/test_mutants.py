"""The places at which `make mutants` makes mistakes, and the tests that meet them first."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent / "mutants"))

import mutants


def test_mistakes_are_made_in_statements_only():
    places = mutants.places()
    assert len({path for path, *_ in places}) > 100
    for path, number, column, old, new in places[::50]:
        line = path.read_text(encoding="utf-8").split("\n")[number]
        assert line[column : column + len(old)] == old != new
        assert not line.lstrip().startswith(("!", "use ", "end "))
        assert line[:column].count("'") % 2 == 0
        assert "::" not in line.split("!")[0]


def test_tests_that_name_a_file_come_first():
    first, others = mutants.tests_of(mutants.ROOT / "src" / "base" / "decimal.f90")
    assert "tests/test_reference.py" in first
    assert "tests/test_pictures.py" in others
    assert not set(first) & set(others)
