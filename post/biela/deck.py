"""A deck as the solver reads it: groups with their values, and settings that change them (`biela --set GROUP/NAME/KEY=VALUE`)."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path

from .command import SOLVER, call_solver
from .histories import read_summary
from .result_files import BielaError


class DeckError(BielaError):
    """A deck that cannot be read, or a value that is not what is expected."""


@dataclass(frozen=True)
class Group:
    """A group of a deck."""

    kind: str  # 'body', 'joint', ...
    values: dict[str, list]  # of each key, repeat counts written out

    @property
    def name(self) -> str:
        """The group's own name in lower case, '' where it has none."""
        return self.word("name")

    def word(self, key: str, default: str = "") -> str:
        """Return a word in lower case."""
        return str((self.values.get(key) or [default])[0]).strip().lower()

    def words(self, key: str) -> list[str]:
        """Return a list of words in lower case."""
        return [str(item).strip().lower() for item in self.values.get(key, [])]

    def numbers(self, key: str) -> list[float]:
        """Return a list of numbers; DeckError where an item is none."""
        try:
            return [float(item) for item in self.values.get(key, [])]
        except (TypeError, ValueError):
            raise DeckError(f"&{self.kind} {self.name}: {key} = {self.values[key]} is no list of numbers") from None

    def number(self, key: str, default: float = 0.0) -> float:
        """Return one number."""
        return (self.numbers(key) or [default])[0]

    def flag(self, key: str, default: bool) -> bool:
        """Return a logical value."""
        return bool((self.values.get(key) or [default])[0])


def groups_of(listed: list[dict]) -> tuple[Group, ...]:
    """Return groups from a list as `biela --flat --json` prints it and summary.json has it."""
    return tuple(Group(one["group"], {key: value for key, value in one.items() if key != "group"}) for one in listed)


@dataclass(frozen=True)
class Deck:
    """A deck with its groups, and with settings by which it differs from its file."""

    path: Path  # of the file
    groups: tuple[Group, ...]  # in their order, as the settings leave them
    settings: dict[str, str] = field(default_factory=dict)  # texts by GROUP/NAME/KEY, by GROUP/NAME/ of a group; '': it goes

    def all(self, *kinds: str) -> list[Group]:
        """Return the groups of some kinds."""
        return [group for group in self.groups if group.kind in kinds]

    def one(self, kind: str, name: str = "") -> Group:
        """Return the group of that kind and name; DeckError where there is none."""
        for group in self.groups:
            if group.kind == kind and (not name or group.name == name):
                return group
        raise DeckError(f"the deck has no &{kind}{' ' + name if name else ''}")

    def check(self, target: str) -> None:
        """Refuse GROUP/NAME/KEY or GROUP/KEY that names no group of the deck, or several; DeckError."""
        kind, *name = target.lower().split("/")[:-1]
        found = [group for group in self.all(kind) if not name or group.name == name[0]]
        if len(found) != 1:
            raise DeckError(f"{'/'.join([kind, *name])}: the deck has {len(found)} such groups, one expected")

    def needed_sensors(self, wanted: Iterable[str]) -> set[str]:
        """Return the names of the sensors that are wanted, and of those that are arguments of histories, forces and controllers."""
        arguments = {group.word("argument").partition(".")[0] for group in self.groups}
        return {group.name for group in self.all("sensor") if group.name in {*wanted} | arguments}

    def set(self, group: Group, **values: object) -> Deck:
        """Return the deck with values of a group set: words, numbers, flags or lists of them; None takes a key away."""
        changed = {key: [] if value is None else value if isinstance(value, list) else [value] for key, value in values.items()}
        settings = {f"{where_of(group)}{key}": ",".join(map(literal, items)) for key, items in changed.items()}
        kept = {key: items for key, items in {**group.values, **changed}.items() if items}
        groups = tuple(replace(one, values=kept) if one is group else one for one in self.groups)
        return replace(self, groups=groups, settings={**self.settings, **settings})

    def drop(self, *gone: Group) -> Deck:
        """Return the deck without some groups."""
        groups = tuple(one for one in self.groups if not any(one is group for group in gone))
        kept = {key: value for key, value in self.settings.items() if not any(key.startswith(where_of(group)) for group in gone)}
        return replace(self, groups=groups, settings={**kept, **{where_of(group): "" for group in gone}})

    @property
    def words(self) -> list[str]:
        """NAME=VALUE of all settings."""
        return [f"{key}={value}" for key, value in self.settings.items()]

    def flat(self, biela: Path) -> str:
        """Return the deck as one text that runs alone, comments and layout kept, as the solver prints it."""
        return flat_text(biela, self.path, *self.words)


def where_of(group: Group) -> str:
    """Return GROUP/NAME/, under which the solver finds a group."""
    return f"{group.kind}/{group.name}/" if group.name else f"{group.kind}/"


def literal(value: object) -> str:
    """Return a value as a deck states it; DeckError for what none can have."""
    if isinstance(value, bool):
        return ".true." if value else ".false."
    if isinstance(value, str):
        return "'" + value.replace("'", "''") + "'"
    if not hasattr(value, "__float__"):
        raise DeckError(f"{type(value).__name__} is no value of a deck; a number, a word, or a list expected")
    if not math.isfinite(value):
        raise DeckError(f"{value}: a finite number expected")
    return repr(int(value)) if isinstance(value, int) else repr(float(value))


def including(path: Path, settings: Iterable[str]) -> str:
    """Return a deck that brings a file in with settings NAME=VALUE."""
    listed = "".join(",\n    '" + word.replace("'", "''") + "'" for word in settings)
    return f"&include file='{str(path).replace(chr(39), 2 * chr(39))}'" + (f" set={listed[6:]}" if listed else "") + " /\n"


def flat_text(biela: Path, path: Path, *settings: str, json_too: bool = False) -> str:
    """Return a deck with settings NAME=VALUE as one text, or its groups as JSON; DeckError with the solver's first line."""
    words = [word for setting in settings for word in ("--set", setting)]
    done = call_solver(biela, "--flat", *["--json"] * json_too, *words, path)
    if done.returncode:
        raise DeckError((done.stderr.splitlines() or [f"{path}: the solver ended with {done.returncode}"])[0])
    if "\ufffd" in done.stdout:
        raise DeckError(f"{path}: cannot be read as text: its letters are not those of UTF-8")
    return done.stdout


def read(path: Path, *settings: str, biela: Path = SOLVER) -> Deck:
    """Read a deck with settings NAME=VALUE as the solver does, numbers for expressions; BielaError where it refuses it."""
    listed = json.loads(flat_text(biela, path, *settings, json_too=True))
    return Deck(path.resolve(), groups_of(listed), dict(one.split("=", 1) for one in settings))


def run_into(folder: Path, deck: Deck, biela: Path) -> dict:
    """Run a deck into a folder and return the figures of its summary; BielaError with the words of the solver where it fails."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    done = call_solver(biela, "--quiet", "--output", folder, *(word for one in deck.words for word in ("--set", one)), deck.path)
    if done.returncode:
        lines = [line for line in done.stderr.splitlines() if ": warning: " not in line]
        raise BielaError((lines or [f"the solver ended with status {done.returncode}"])[0])
    return read_summary(folder)
