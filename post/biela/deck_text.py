"""Edits a deck as text: values change, everything else, comments and layout included, stays as it was written.

A deck is split into groups and assignments with their places in the text (the grammar of biela's namelist files: `&name ... /`,
`!` comments, quotes, expressions in braces). An edit returns a new `DeckText`; the old one stays valid. Expressions are text here:
what they are worth the solver says (`read`).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from .command import SOLVER, call_solver
from .deck import DeckError as _DeckError

GROUP = re.compile(r"&([A-Za-z_]\w*)")
ASSIGNMENT = re.compile(r"(?<![\w.])([A-Za-z_]\w*)\s*=")
ITEM = re.compile(r"(?:\{[^}\n]*\}|[^,\s{])+")
REPEATED = re.compile(r"(\d+)\*(.+)")


class DeckError(_DeckError):
    """A deck that cannot be read or edited."""


@dataclass(frozen=True)
class Group:
    """A group and where it stands.

    Attributes:
        kind: its name in lower case: 'body', 'joint', ...
        start: index of its `&`
        end: index behind its closing slash
        spans: (first index of the name, first and last index of the value) of each assignment, by name in lower case
        values: the values as written, comments taken out
    """

    kind: str
    start: int
    end: int
    spans: dict[str, tuple[int, int, int]]
    values: dict[str, str]

    @property
    def name(self) -> str:
        """The group's own name in lower case, '' where it has none."""
        return self.word("name")

    def word(self, key: str, default: str = "") -> str:
        """Return a word without its quotes, in lower case."""
        return self.values.get(key, default).strip().strip("'\"").strip().lower()

    def items(self, key: str) -> list[str]:
        """Return the items of a list as written, repeat counts (3*0.5) written out."""
        found = []
        for item in ITEM.findall(self.values.get(key, "")):
            repeated = REPEATED.fullmatch(item)
            found += [repeated[2]] * int(repeated[1]) if repeated else [item]
        return found

    def numbers(self, key: str) -> list[float]:
        """Return a list of numbers; DeckError where an item is none."""
        try:
            return [float(item.lower().replace("d", "e")) for item in self.items(key)]
        except ValueError:
            raise DeckError(f"&{self.kind} {self.name}: {key} = {self.values[key].strip()} is no list of numbers") from None

    def number(self, key: str, default: float = 0.0) -> float:
        """Return one number."""
        return (self.numbers(key) or [default])[0]

    def flag(self, key: str, default: bool) -> bool:
        """Return a logical value."""
        written = self.values.get(key, "").strip().lower().lstrip(".")
        return default if not written else written.startswith("t")


@dataclass(frozen=True)
class DeckText:
    """A deck's text and its groups, in the order of the file."""

    text: str
    groups: tuple[Group, ...]

    def all(self, *kinds: str) -> list[Group]:
        """Return the groups of some kinds."""
        return [group for group in self.groups if group.kind in kinds]

    def one(self, kind: str, name: str = "") -> Group:
        """Return the group of that kind and name; DeckError where there is none."""
        for group in self.groups:
            if group.kind == kind and (not name or group.name == name):
                return group
        raise DeckError(f"the deck has no &{kind}{' ' + name if name else ''}")

    def needed_sensors(self, wanted: set[str]) -> set[str]:
        """Return the names of the sensors that are wanted, and of those that are arguments of forces and controllers."""
        arguments = {group.word("argument").partition(".")[0] for group in self.groups}
        return {group.name for group in self.all("sensor") if group.name in wanted | arguments}

    def set(self, group: Group, **values: str) -> DeckText:
        """Return the deck with values of a group set, as text; None takes an assignment away."""
        text = self.text
        where = sorted(values, key=lambda key: group.spans.get(key, (0, 0, -1))[1], reverse=True)
        for key in (key for key in where if key in group.spans):
            start, first, last = group.spans[key]
            kept = _comments(text[first:last])
            if values[key] is None:
                text = text[:start] + kept + text[last:].lstrip(" ,\t")
            else:
                text = text[:first] + values[key] + (" " + kept if kept else "") + text[last:]
        new = "".join(f" {key}={values[key]}" for key in values if key not in group.spans and values[key] is not None)
        if new:
            at = parse(text).groups[self.groups.index(group)]
            end = max([last for _, _, last in at.spans.values()], default=at.start + 1 + len(at.kind))
            text = text[:end] + new + text[end:]
        return parse(text)

    def drop(self, group: Group, why: str) -> DeckText:
        """Return the deck with a group made a comment, with the reason in front."""
        body = self.text[group.start : group.end].replace("\n", "\n! ")
        tail = self.text[group.end :]
        rest = tail.split("\n", 1)[0]
        gap = "\n" if rest.strip() and not rest.strip().startswith("!") else ""
        lead = "" if self.text[: group.start].endswith("\n") or group.start == 0 else "\n"
        return parse(f"{self.text[: group.start]}{lead}! {why}: {body}{gap}{tail}")


def _comments(text: str) -> str:
    """Return the comments inside a value, each with its end of line."""
    hidden = mask(text)
    found = [line[k:] for line, k in ((text[a:b], c - a) for a, b, c in _comment_spans(text, hidden))]
    return "".join(comment + "\n" for comment in found)


def _comment_spans(text: str, hidden: str) -> list[tuple[int, int, int]]:
    """Return (start of line, end of line, index of the comment's `!`) of each comment."""
    spans, start = [], 0
    for line in text.split("\n"):
        shown = hidden[start : start + len(line)]
        if "\x00" in shown:
            spans.append((start, start + len(line), start + shown.index("\x00")))
        start += len(line) + 1
    return spans


def mask(text: str) -> str:
    r"""Return text of the same length with characters in quotes and braces as `q` and comments as NUL characters."""
    out, quote, comment = [], "", False
    for c in text:
        if c == "\n":
            quote, comment = "", False
            out.append(c)
        elif comment:
            out.append("\x00")
        elif quote:
            out.append("q")
            quote = "" if c == quote else quote
        elif c in "'\"{":
            quote = "}" if c == "{" else c
            out.append("q")
        elif c == "!":
            comment = True
            out.append("\x00")
        else:
            out.append(c)
    return "".join(out)


def parse(text: str) -> DeckText:
    """Split a deck's text; DeckError where a group has no end."""
    hidden = mask(text)
    groups, place = [], 0
    while found := GROUP.search(hidden, place):
        end = hidden.find("/", found.end()) + 1
        if end == 0:
            raise DeckError(f"the group &{found[1]} has no closing slash")
        groups.append(_group(text, hidden, found, end))
        place = end
    return DeckText(text, tuple(groups))


def _group(text: str, hidden: str, head: re.Match, end: int) -> Group:
    """Return the group between its head and its slash."""
    marks = list(ASSIGNMENT.finditer(hidden, head.end(), end - 1))
    spans, values = {}, {}
    for mark, following in zip(marks, [*(m.start() for m in marks[1:]), end - 1]):
        shown = hidden[mark.end() : following].replace("\x00", " ")
        last = mark.end() + len(shown.rstrip(" ,\t\r\n"))
        first = mark.end() + len(shown) - len(shown.lstrip()) if shown.strip() else last
        key = mark[1].lower()
        spans[key] = (mark.start(), first, max(first, last))
        values[key] = "".join(c for c, h in zip(text[first:last], hidden[first:last]) if h != "\x00")
    return Group(head[1].lower(), head.start(), end, spans, values)


def read(path: Path, *settings: str, biela: Path = SOLVER) -> DeckText:
    """Read a deck as the solver states it in one text: included files and parts in their places, numbers for expressions.

    Args:
        path: of the deck
        settings: NAME=VALUE of parameters that get another value
        biela: the solver

    Raises:
        BielaError: the solver cannot be called.
        DeckError: it refuses the deck; the first line that it writes.
    """
    words = [word for setting in settings for word in ("--set", setting)]
    done = call_solver(biela, "--flat", *words, path)
    if done.returncode:
        raise DeckError((done.stderr.splitlines() or [f"{path}: the solver ended with {done.returncode}"])[0])
    if "\ufffd" in done.stdout:
        raise DeckError(f"{path}: cannot be read as text: its letters are not those of UTF-8")
    return parse(done.stdout)


def sources(path: Path) -> str:
    """Return the texts of a deck and of the files that it includes, as they are written."""
    text = path.read_text(encoding="utf-8")
    inner = [path.parent / group.values.get("file", "").strip().strip("'\"") for group in parse(text).all("include")]
    return text + "".join(sources(file) for file in dict.fromkeys(inner))
