"""The table of keys of the deck language (src/deck/keys.txt), as the build reads it."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = r"""END { for (k = 1; k <= rows; k++) print group[of[k]] "\t" name[k] "\t" type[k] "\t" unit[k] "\t" required[k] + 0 \
  "\t" preset[k] "\t" range[k] "\t" kinds[k] "\t" meaning[k] }"""


class Key(NamedTuple):
    """A row of the table: a key of a group, for some words of the group's choice or (none named) for all."""

    group: str
    name: str
    type: str
    unit: str
    required: bool
    default: str
    range: str
    kinds: list[str]
    meaning: str

    def limits(self) -> list[str]:
        """Return numbers just out of the range, as a deck has them."""
        words = self.range.split()
        if self.type.rstrip(".") not in ("real", "integer", "auto") or not words:
            return []
        if "to" in words:
            return [f"{float(words[0]) - 1:g}", f"{float(words[2]) + 1:.9g}"]
        outside = words[1] if words[0] == ">" else f"{float(words[1]) - 1:g}"
        return [outside, *words[3:]]


def read_keys() -> list[Key]:
    """Return all rows, in the order of the table."""
    words = ["awk", "-f", "src/deck/keys.awk", "-f", "/dev/stdin", "src/deck/keys.txt"]
    lines = subprocess.run(words, cwd=ROOT, input=PROGRAM, capture_output=True, text=True, check=True).stdout.splitlines()
    rows = [line.split("\t") for line in lines]
    return [Key(*row[:4], row[4] == "1", row[5], row[6], row[7].split(), row[8]) for row in rows]


KEYS = read_keys()
GROUPS = {group: [key for key in KEYS if key.group == group] for group in dict.fromkeys(key.group for key in KEYS)}


def choice_of(group: str) -> Key | None:
    """Return the key that decides which others apply, if the group has one."""
    return next((key for key in GROUPS[group] if key.type == "choice"), None)


def applying(group: str, kind: str) -> dict[str, Key]:
    """Return the keys of a group that apply where its choice is this word."""
    found = {}
    for key in GROUPS[group]:
        if not key.kinds or kind in key.kinds:
            found.setdefault(key.name, key)
    return found
