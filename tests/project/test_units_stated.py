"""Each real or complex dummy argument and component of src says in brackets in which unit it is: [kg], [N m], [-]."""

from __future__ import annotations

import re

import pytest
from conftest import ROOT

DECLARED = re.compile(r"(?:real|complex)\s*\([^)]*\)(?P<attributes>.*?)::", re.IGNORECASE)
TYPE_STARTS = re.compile(r"type\s*(?:,.*::|::|\s)\s*\w+$", re.IGNORECASE)
TYPE_ENDS = re.compile(r"end\s*type\b", re.IGNORECASE)
QUOTED = re.compile(r"'[^']*'|\"[^\"]*\"")
UNIT = re.compile(r"\[(?:-|[^][]*[A-Za-z][^][]*)\]")


def statements(text: str) -> list[tuple[int, str, str]]:
    """Return first line, code and comments of each statement, continued ones joined."""
    found, code, comment, start = [], "", "", 0
    for number, line in enumerate(text.splitlines(), 1):
        own, _, remark = QUOTED.sub(lambda quoted: "'" + "q" * (len(quoted[0]) - 2) + "'", line).partition("!")
        own = own.strip()
        if not code:
            start, comment = number, ""
        comment += remark + " "
        code = f"{code} {own.removeprefix('&').strip()}".strip()
        if code.endswith("&"):
            code = code[:-1].rstrip() or " "
        elif own:
            found.append((start, code.strip(), comment))
            code = ""
    return found


def without_unit(text: str) -> list[tuple[int, str]]:
    """Return line and code of each real or complex dummy and component whose comment names no unit."""
    found, in_type = [], False
    for line, code, comment in statements(text):
        if TYPE_STARTS.match(code):
            in_type = True
        elif TYPE_ENDS.match(code):
            in_type = False
        declared = DECLARED.match(code)
        if declared and (in_type or "intent" in declared["attributes"].lower()) and not UNIT.search(comment):
            found.append((line, code))
    return found


def test_units_are_stated():
    missing = []
    for path in sorted((ROOT / "src").rglob("*.f90")):
        missing += [f"{path.name}:{line}: {code}" for line, code in without_unit(path.read_text(encoding="utf-8"))]
    assert missing == [], "a unit in brackets, [-] for a pure number"


@pytest.mark.parametrize(
    ("text", "lines"),
    [
        ("type :: body\n  real(wp) :: mass = 0.0_wp !! [kg]\n  real(wp) :: inertia\nend type body\n", [3]),
        ("type, extends(rigid), public :: body\n  complex(wp), allocatable :: x(:)   !! (n)\nend type\n", [2]),
        ("real(wp), intent(in) :: a, &\n                        b   !! lengths [m]\n", []),
        ("real(wp), intent(in) :: &   !! lengths\n  ! of both\n\n  a, b\n", [1]),
        ("real(kind=wp), intent(inout), contiguous :: x(:)   !! x[1] and so on\n", [1]),
        ("real(wp), intent(in) :: x   !! [-]\nreal(wp), intent(out) :: y   !! [rad/s]\n", []),
        ("real(wp) :: x\nreal(wp), parameter :: y = 1.0_wp\ninteger, intent(in) :: n\n", []),
        ("x = '!! [m]'\nREAL(wp), INTENT(in) :: x   ! x\n", [2]),
    ],
)
def test_what_counts_as_missing(text, lines):
    assert [line for line, _ in without_unit(text)] == lines
