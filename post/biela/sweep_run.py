"""Runs a batch of a study's decks, what a worker gets at a time: one call of the solver for all, numbers taken from the results."""

from __future__ import annotations

import math
import multiprocessing
import os
import shutil
import signal
import subprocess
import threading
from dataclasses import dataclass
from pathlib import Path

from .command import call_solver
from .deck import Deck, including, literal, where_of
from .histories import read_summary
from .result_files import HistoryError
from .sweep_scalars import Measured, Scalar, measure
from .sweep_study import Study

# A shell starts the solver. It ends the solver when nobody holds the other end of its standard input any more: a killed worker.
SHELL = """exec 3<&0
"$@" 3<&- </dev/null & solver=$!
{ read -r nothing <&3; kill "$solver"; } >/dev/null 2>&1 & watch=$!
wait "$solver"; status=$?; kill "$watch" 2>/dev/null; exit $status"""


@dataclass(frozen=True)
class Batch:
    """What a worker gets."""

    biela: str  # path of the solver
    deck: str  # path of the base deck
    runs: dict[int, tuple[str, ...]]  # NAME=VALUE of each run, by its number
    scalars: tuple[Scalar, ...]  # what is measured
    folder: str  # of its decks and results
    keep: bool = False  # whether these stay
    extremes: bool = False  # whether the rows list the extremes of columns
    check: bool = False  # each run measures its own error, which costs three times as much
    measured: object = None  # measures a run in place of scalars
    longest: float = math.inf  # seconds after which a run is stopped [s]
    follow: bool = False  # the cycle of each run starts from that of the one before


@dataclass(frozen=True)
class Row(Measured):
    """What a run gave, nothing where it failed."""

    number: int = 0  # of the run in the study
    reason: str = ""  # why it failed, '' where it did not
    warnings: tuple[str, ...] = ()  # what the solver warned of
    outside: bool = False  # whether one of them says that the model does not hold for this motion


def common_settings(study: Study, deck: Deck, only_used: bool) -> tuple[str, ...]:
    """Return NAME=VALUE of all runs: an error check where it is wanted, and no motion files or sensors that nothing needs."""
    found = [f"{where_of(group)}check_error=.true." for group in deck.all("transient") if study.check]
    if not only_used or any(scalar.mode or scalar.file not in ("history", "energy") for scalar in study.scalars):
        return tuple(found)
    used = {column.partition(".")[0].lower() for one in study.scalars if one.file == "history" for column in one.columns}
    needed = deck.needed_sensors(used)
    found += [f"{where_of(group)}=" for group in deck.all("sensor") if used and group.name not in needed]
    return (*found, *(f"{where_of(group)}motion_step=" for group in deck.all("transient")))


def settings_of(study: Study, point: dict) -> tuple[str, ...]:
    """Return NAME=VALUE of a run: parameters of the deck, and variables of its groups."""
    found = [f"{name}={value!r}" for one in study.parameters for name, value in one.settings(point[one.name]).items()]
    return (*found, *(f"{target}={literal(point[one.name])}" for one in study.parameters for target in one.targets))


def run_batch(batch: Batch) -> list[Row]:
    """Run a batch and return a row of each run, also of those that fail."""
    folder = Path(batch.folder)
    folder.mkdir(parents=True, exist_ok=True)
    try:
        return _rows(batch, folder)
    finally:
        if not batch.keep:
            shutil.rmtree(folder, ignore_errors=True)


def _rows(batch: Batch, folder: Path) -> list[Row]:
    """Write the decks, run them, read the results."""
    decks = {number: folder / f"{number:06d}.nml" for number in batch.runs}
    for number, path in decks.items():
        path.write_text(including(Path(batch.deck), batch.runs[number]), encoding="utf-8")
    if batch.follow:
        rows, orbit = [], ()
        for number, path in decks.items():
            stopped = _call(batch, [*orbit, path.name], folder)
            rows.append(_row(number, folder / "results" / path.stem, path, batch, stopped))
            orbit = orbit if rows[-1].reason else ("--orbit", f"results/{path.stem}")
        return rows
    stopped = _call(batch, [path.name for path in decks.values()], folder)
    return [_row(number, folder / "results" / path.stem, path, batch, stopped) for number, path in decks.items()]


def _call(batch: Batch, words: list[str], folder: Path) -> str:
    """Call the solver in a folder and return why it was stopped, '' where it was not."""
    shell = ["/bin/sh", "-c", SHELL, "sh", batch.biela, "--quiet", *words]
    quiet = dict(stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    with subprocess.Popen(shell, cwd=folder, **quiet, start_new_session=True) as solver:
        try:
            status = solver.wait(batch.longest if math.isfinite(batch.longest) else None)
        except subprocess.TimeoutExpired:
            os.killpg(solver.pid, signal.SIGKILL)
            return f"stopped after {batch.longest:g} s"
    stopped = status - 128 if status > 128 else -status
    return f"the solver was stopped by signal {stopped}" if stopped > 0 else ""


def end_with_parent() -> None:
    """Let this worker, and its solver with it, end with the process that started it, which cannot tell them where it is killed."""

    def watch() -> None:
        parent = multiprocessing.parent_process()
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _row(number: int, results: Path, deck: Path, batch: Batch, stopped: str) -> Row:
    """Return the numbers of a run that came to its end, else the reason why it did not."""
    summary = {}
    try:
        summary = read_summary(results)
        reason = "" if summary.get("status") == 0 else stopped or summary["outcome"]
    except HistoryError:  # the deck was refused: the solver says why when it is asked for this one alone
        reason = stopped or _refusal(batch, deck)
    told = dict(number=number, warnings=tuple(summary.get("warnings", ())), outside=bool(summary.get("outside_model")))
    if not reason:
        try:
            found = batch.measured.of(results) if batch.measured else measure(results, batch.scalars, batch.extremes, batch.check)
            return Row(**vars(found), **told)
        except ValueError as fault:
            reason = str(fault)
    return Row(**told, reason=reason)


def _refusal(batch: Batch, deck: Path) -> str:
    """Return the first line that the solver writes of a deck, warnings left out."""
    done = call_solver(Path(batch.biela), "--check", deck)
    lines = [line for line in done.stderr.splitlines() if ": warning: " not in line]
    return (lines or ["the solver has left no results"])[0].removeprefix(f"{Path(batch.deck).parent}/").removeprefix(f"{deck}: ")
