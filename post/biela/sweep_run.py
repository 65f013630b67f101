"""Runs a batch of a sweep's decks: decks edited with f90nml, one call of the solver for all, numbers taken from the results.

A batch is what a worker gets at a time, on this machine or another: a run lasts milliseconds, so that starting the solver and
handing over one run at a time would cost more than the run.
"""

from __future__ import annotations

import io
import re
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import f90nml

from .sweep_scalars import Scalar, measure
from .sweep_study import StudyError, Target

FAULT = re.compile(r"^(?P<deck>[^\s:]*?(?P<number>\d{6})\.nml)(?::\d+)?:\s*(?P<words>.*)$")


@dataclass(frozen=True)
class Batch:
    """What a worker gets.

    Attributes:
        biela: path of the solver
        text: the base deck, what it includes put in place
        folder: of the base deck; files that it names lie relative to it
        assignments: of each run, by its number: (variable of the deck, value)
        scalars: what is measured
        keep: folder in which decks and results stay, None: they are deleted
        lean: sensors that no scalar uses are left out of the decks
    """

    biela: str
    text: str
    folder: str
    assignments: dict[int, tuple[tuple[Target, object], ...]]
    scalars: tuple[Scalar, ...]
    keep: str | None
    lean: bool


@dataclass(frozen=True)
class Row:
    """What a run gave.

    Attributes:
        number: of the run in the study
        values: of the scalars, empty where the run failed
        units: of them
        reason: why it failed, '' where it did not
    """

    number: int
    values: list[float]
    units: list[str]
    reason: str


def groups(deck: f90nml.Namelist, kind: str) -> list:
    """Return the groups of one kind."""
    found = deck.get(kind, [])
    return [found] if isinstance(found, f90nml.Namelist) else list(found)


def assign(deck: f90nml.Namelist, target: Target, value: object) -> None:
    """Set a variable of a deck; StudyError where the deck has no such group or list."""
    found = [one for one in groups(deck, target.group) if not target.name or str(one.get("name", "")).lower() == target.name]
    words = f"{target.group}{'/' + target.name if target.name else ''}"
    if len(found) != 1:
        raise StudyError(f"{words}: the deck has {len(found)} such groups, one expected")
    if not target.index:
        found[0][target.variable] = value
        return
    before = found[0].get(target.variable, [])
    items = list(before) if isinstance(before, list) else [before]
    if target.index > len(items):
        raise StudyError(f"{words}/{target.variable}: the deck gives {len(items)} values, no number {target.index}")
    items[target.index - 1] = value
    found[0][target.variable] = items


def lean_deck(deck: f90nml.Namelist, scalars: tuple[Scalar, ...]) -> f90nml.Namelist:
    """Return the deck without sensors and motion files that no scalar uses."""
    if any(scalar.file not in ("history", "energy") for scalar in scalars):
        return deck
    used = {scalar.column.partition(".")[0].lower() for scalar in scalars if scalar.file == "history"}
    lean = f90nml.Namelist()
    for kind, group in deck.items():
        if kind == "sensor" and used and str(group.get("name", "")).lower() not in used:
            continue
        group.pop("motion_step", None)
        lean.add_cogroup(kind, group)
    return lean


def template(batch: Batch) -> str:
    """Return the text of the batch's decks with a mark, '@number@', in the place of each assigned value; raises StudyError."""
    deck = f90nml.reads(batch.text)
    for one in groups(deck, "history"):
        if "file" in one:
            one["file"] = str((Path(batch.folder) / one["file"]).resolve())
    first = next(iter(batch.assignments.values()))
    for k, (target, _) in enumerate(first):
        assign(deck, target, f"@{k}@")
    if batch.lean:
        deck = lean_deck(deck, batch.scalars)
    text = io.StringIO()
    deck.write(text)
    return text.getvalue()


def literal(value: object) -> str:
    """Return a value as a deck states it."""
    if isinstance(value, bool):
        return ".true." if value else ".false."
    return "'" + value.replace("'", "''") + "'" if isinstance(value, str) else repr(value)


def run_batch(batch: Batch) -> list[Row]:
    """Run a batch and return a row of each run, also of those that fail; StudyError where the deck has no such variable."""
    place = Path(batch.keep) if batch.keep else Path(tempfile.mkdtemp(prefix="biela-sweep-"))
    place.mkdir(parents=True, exist_ok=True)
    try:
        return _rows(batch, place)
    finally:
        if not batch.keep:
            shutil.rmtree(place, ignore_errors=True)


def _rows(batch: Batch, place: Path) -> list[Row]:
    """Write the decks, run them, read the results."""
    text = template(batch)
    decks = {}
    for number, values in batch.assignments.items():
        deck = text
        for k, (_, value) in enumerate(values):
            deck = deck.replace(f"'@{k}@'", literal(value))
        decks[number] = place / f"{number:06d}.nml"
        decks[number].write_text(deck, encoding="utf-8")
    names = [path.name for path in decks.values()]
    done = subprocess.run([batch.biela, "--quiet", *names], cwd=place, capture_output=True, text=True, check=False)
    said = _reasons(done.stderr)
    stopped = f"the solver was stopped by signal {abs(done.returncode) % 128}" if not 0 <= done.returncode <= 128 else ""
    return [_row(number, place / "results" / path.stem, batch.scalars, said.get(number, stopped)) for number, path in decks.items()]


def _reasons(text: str) -> dict[int, str]:
    """Return what standard error says of each deck first, warnings left out, by the number in the deck's name."""
    found: dict[int, str] = {}
    for line in text.splitlines():
        words = FAULT.match(line)
        if words and not words["words"].startswith("warning") and int(words["number"]) not in found:
            found[int(words["number"])] = words["words"]
    return found


def _row(number: int, folder: Path, scalars: tuple[Scalar, ...], said: str) -> Row:
    """Return the numbers of a run that came to its end, else the reason why it did not."""
    if not said:
        try:
            return Row(number, *measure(folder, scalars), "")
        except ValueError as fault:
            said = str(fault)
    return Row(number, [], [], said)
