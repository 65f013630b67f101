"""Runs a batch of a sweep's decks: each flat, with its values, one call of the solver for all, numbers taken from the results.

A batch is what a worker gets at a time, on this machine or another: a run lasts milliseconds, so that starting the solver and
handing over one run at a time would cost more than the run.
"""

from __future__ import annotations

import multiprocessing
import os
import re
import shutil
import tempfile
import threading
from dataclasses import dataclass, field
from pathlib import Path

from . import solver_start
from .deck_text import DeckError, DeckText, parse, read
from .sweep_scalars import Scalar, measure
from .sweep_study import Study, StudyError, Target

Assignments = tuple[tuple[str, ...], tuple[tuple[Target, object], ...]]

FAULT = re.compile(r"^(?P<deck>[^\s:]*?(?P<number>\d{6})\.nml)(?::\d+)?:\s*(?P<words>.*)$")


@dataclass(frozen=True)
class Batch:
    """What a worker gets.

    Attributes:
        biela: path of the solver
        deck: path of the base deck
        assignments: of each run, by its number: parameters, NAME=VALUE, and (variable of the deck, value)
        scalars: what is measured
        keep: folder in which decks and results stay, None: they are deleted
        only_used: sensors that no scalar uses are left out of the decks
        extremes: whether the rows list the extremes of columns
        check: each run measures its own error, which costs three times as much
    """

    biela: str
    deck: str
    assignments: dict[int, Assignments]
    scalars: tuple[Scalar, ...]
    keep: str | None
    only_used: bool
    extremes: bool = False
    check: bool = False


@dataclass(frozen=True)
class Row:
    """What a run gave.

    Attributes:
        number: of the run in the study
        values: of the scalars, empty where the run failed
        units: of them
        reason: why it failed, '' where it did not
        extremes: of the scalars that are one of several, where they were asked for
        errors: of the values, where they were measured
    """

    number: int
    values: list[float]
    units: list[str]
    reason: str
    extremes: list = field(default_factory=list)
    errors: list[float] = field(default_factory=list)


def assign(deck: DeckText, target: Target, value: str) -> DeckText:
    """Return the deck with a variable set, as text; StudyError where the deck has no such group or list."""
    found = [group for group in deck.all(target.group) if not target.name or group.name == target.name]
    words = f"{target.group}{'/' + target.name if target.name else ''}"
    if len(found) != 1:
        raise StudyError(f"{words}: the deck has {len(found)} such groups, one expected")
    if target.index:
        items = found[0].items(target.variable)
        if target.index > len(items):
            raise StudyError(f"{words}/{target.variable}: the deck gives {len(items)} values, no number {target.index}")
        items[target.index - 1] = value
        value = ",".join(items)
    return deck.set(found[0], **{target.variable: value})


def without_unused_sensors(deck: DeckText, scalars: tuple[Scalar, ...]) -> DeckText:
    """Return the deck without motion files, and without sensors that neither a scalar nor the deck itself uses."""
    if any(scalar.mode or scalar.file not in ("history", "energy") for scalar in scalars):
        return deck
    used = {scalar.column.partition(".")[0].lower() for scalar in scalars if scalar.file == "history"}
    text, needed = deck.text, deck.needed_sensors(used)
    for group in reversed(deck.all("sensor")):
        if used and group.name not in needed:
            text = text[: group.start] + text[group.end :]
    only_used = parse(text)
    for group in only_used.all("transient"):
        only_used = only_used.set(group, motion_step=None)
    return only_used


def template(batch: Batch, settings: tuple[str, ...], targets: tuple[Target, ...]) -> str:
    """Return the text of runs with those parameters, with a mark, '@number@', in the place of each variable that is set.

    Raises:
        StudyError: the deck has no such variable
        DeckError: what the solver says of the deck with these parameters
    """
    deck = read(Path(batch.deck), *settings, biela=Path(batch.biela))
    for k, target in enumerate(targets):
        deck = assign(deck, target, f"@{k}@")
    for group in deck.all("transient") if batch.check else []:
        deck = deck.set(group, check_error=".true.")
    return (without_unused_sensors(deck, batch.scalars) if batch.only_used else deck).text


def assignments(study: Study, point: dict) -> Assignments:
    """Return what a run sets: parameters as the solver takes them, variables with their values."""
    settings = tuple(f"{name}={value!r}" for one in study.parameters for name, value in one.settings(point[one.name]).items())
    return settings, tuple((target, point[one.name]) for one in study.parameters for target in one.targets)


def literal(value: object) -> str:
    """Return a value as a deck states it."""
    if isinstance(value, bool):
        return ".true." if value else ".false."
    return "'" + value.replace("'", "''") + "'" if isinstance(value, str) else repr(value)


def run_batch(batch: Batch) -> list[Row]:
    """Run a batch and return a row of each run, also of those that fail; StudyError where the deck has no such variable."""
    folder = Path(batch.keep) if batch.keep else Path(tempfile.mkdtemp(prefix="biela-sweep-"))
    folder.mkdir(parents=True, exist_ok=True)
    try:
        return _rows(batch, folder)
    finally:
        if not batch.keep:
            shutil.rmtree(folder, ignore_errors=True)


def _rows(batch: Batch, folder: Path) -> list[Row]:
    """Write the decks, run them, read the results."""
    texts: dict[tuple[str, ...], str] = {}
    decks, reasons = {}, {}
    for number, (settings, values) in batch.assignments.items():
        decks[number] = folder / f"{number:06d}.nml"
        try:
            if settings not in texts:
                texts[settings] = template(batch, settings, tuple(target for target, _ in values))
        except DeckError as fault:
            reasons[number] = str(fault)
            continue
        deck = texts[settings]
        for k, (_, value) in enumerate(values):
            deck = deck.replace(f"@{k}@", literal(value))
        decks[number].write_text(deck, encoding="utf-8")
    names = [path.name for number, path in decks.items() if number not in reasons]
    stopped = ""
    if names:
        with solver_start.start([batch.biela, "--quiet", *names], folder) as solver:
            _, errors = solver.communicate()
        reasons |= _reasons(errors)
        status = solver_start.status(solver)
        stopped = f"the solver was stopped by signal {-status}" if status < 0 else ""
    return [_row(number, folder / "results" / path.stem, batch, reasons.get(number, stopped)) for number, path in decks.items()]


def end_with_parent() -> None:
    """Let this worker, and its solver with it, end with the process that started it, which cannot tell them where it is killed."""

    def watch() -> None:
        parent = multiprocessing.parent_process()
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _reasons(text: str) -> dict[int, str]:
    """Return what standard error says of each deck first, warnings left out, by the number in the deck's name."""
    found: dict[int, str] = {}
    for line in text.splitlines():
        words = FAULT.match(line)
        if words and not words["words"].startswith("warning") and int(words["number"]) not in found:
            found[int(words["number"])] = words["words"]
    return found


def _row(number: int, folder: Path, batch: Batch, reason: str) -> Row:
    """Return the numbers of a run that came to its end, else the reason why it did not."""
    if not reason:
        try:
            found = measure(folder, batch.scalars, batch.extremes, batch.check)
            return Row(number, found.values, found.units, "", found.extremes if batch.extremes else [], found.errors)
        except ValueError as fault:
            reason = str(fault)
    return Row(number, [], [], reason)
