"""Runs a deck over ranges of its parameters and gathers numbers of every run into one table."""

from __future__ import annotations

import argparse
import csv
import hashlib
import html
import json
import math
import operator
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from . import command, deck_text, histories
from .result_files import HistoryError, remove_noted
from .sweep_run import Batch, Row, assign, assignments, end_with_parent, literal, run_batch
from .sweep_scalars import Scalar, vibrations
from .sweep_study import Study, StudyError, StudyOptions, read

if TYPE_CHECKING:
    import pandas

FOLDER = Path(__file__).resolve().parents[1]  # of the package
BATCH = 50
COMPARISONS = {"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge}
CONDITION = re.compile(r"\s*(\w+)\s*(<=|>=|<|>)\s*(\S+)\s*")


class Journal:
    """The finished runs of a sweep, one line of JSON each; a sweep that was interrupted reads them and continues.

    Attributes:
        path: the file
        done: what each run gave, by its key: the fields of a `Row`
        damaged: numbers of lines that cannot be read, as an interruption leaves them: their runs are made again
    """

    def __init__(self, path: Path, results: int) -> None:
        """Read the journal of a study with that many results."""
        self.path = path
        self.done: dict[str, dict] = {}
        self.damaged: list[int] = []
        text = path.read_text(encoding="utf-8", errors="replace") if path.exists() else ""
        for number, line in enumerate(text.split("\n"), 1):
            entry = _entry(line, results)
            if entry:
                self.done[entry["key"]] = entry
            elif line.strip():
                self.damaged.append(number)
        if self.damaged or text[-1:] not in ("", "\n"):  # what follows must not be joined to a line that was cut
            repaired = path.with_name(path.name + ".new")
            repaired.write_text("".join(json.dumps(entry) + "\n" for entry in self.done.values()), encoding="utf-8")
            repaired.replace(path)

    @property
    def warnings(self) -> list[str]:
        """What is damaged, in words."""
        more = f" and {len(self.damaged) - 1} more" if len(self.damaged) > 1 else ""
        return [f"{self.path}: line {self.damaged[0]}{more} cannot be read; the runs are made again"] if self.damaged else []

    def add(self, rows: dict[str, Row]) -> None:
        """Write the rows of a batch, by their keys."""
        with self.path.open("a", encoding="utf-8") as file:
            for key, row in rows.items():
                self.done[key] = {"key": key, **asdict(row)}
                file.write(json.dumps(self.done[key]) + "\n")


def _entry(line: str, results: int) -> dict | None:
    """Return the run that a line of a journal tells, None where it is damaged."""
    try:
        entry = json.loads(line)
        values, units, reason = entry["values"], entry["units"], entry["reason"]
        numbers = [float(value) for value in values]
        strings = (isinstance(word, str) for word in (entry["key"], reason, *units))
        count = 0 if reason else results
        return entry if all(strings) and len(numbers) == len(units) == count else None
    except (ValueError, KeyError, TypeError, RecursionError):
        return None


def keys(study: Study, text: str, biela: Path) -> list[str]:
    """Return a key for each run: a hash of solver, deck, values, measures and what measures. The same key means the same run."""
    programs = biela, *(FOLDER / "biela" / name for name in ("sweep_run.py", "sweep_scalars.py"))
    solver = hashlib.sha256(b"".join(path.read_bytes() for path in programs)).hexdigest()
    targets = [[one.name, [asdict(target) for target in one.targets], one.catalogue] for one in study.parameters]
    common = json.dumps([solver, text, [asdict(scalar) for scalar in study.scalars], targets, study.extremes, study.check])
    head = hashlib.sha256(common.encode())
    found = []
    for point in study.points:
        own = head.copy()
        own.update(json.dumps(point, default=str).encode())
        found.append(own.hexdigest()[:24])
    return found


def batches(study: Study, wanted: list[int], options: StudyOptions, folder: Path) -> Iterator[Batch]:
    """Yield batches of the runs that are still to be made."""
    size = max(1, min(BATCH, len(wanted) // (4 * options.workers) or 1))
    for first in range(0, len(wanted), size):
        runs = {number: assignments(study, study.points[number]) for number in wanted[first : first + size]}
        keep = str(folder / "runs") if options.keep else None
        solver, lean = str(options.biela.resolve()), not options.keep
        yield Batch(solver, str(study.deck), runs, study.scalars, keep, lean, study.extremes, study.check)


def _on_worker(folder: str, batch: bytes) -> list[Row]:
    """Run a batch on a Dask worker, which may never have seen this package."""
    import pickle
    import sys

    if folder not in sys.path:
        sys.path.insert(0, folder)
    from biela.sweep_run import run_batch

    return run_batch(pickle.loads(batch))


def executor(options: StudyOptions) -> Executor:
    """Return what runs batches: this machine's cores, or a Dask scheduler; HistoryError where there is none."""
    if not options.dask:
        return ProcessPoolExecutor(max_workers=options.workers, initializer=end_with_parent)
    try:
        from dask.distributed import Client
    except ImportError:
        raise HistoryError("--dask needs the package distributed: pip install 'dask[distributed]'") from None
    try:
        return Client(options.dask, timeout="10s").get_executor(pure=False, retries=5)
    except OSError as fault:
        raise HistoryError(f"--dask {options.dask}: no scheduler answers ({fault})") from None


def submit(pool: Executor, batch: Batch, options: StudyOptions) -> Future:
    """Hand a batch over."""
    if not options.dask:
        return pool.submit(run_batch, batch)
    import pickle

    return pool.submit(_on_worker, str(FOLDER), pickle.dumps(batch))


def begin_kept(folder: Path, found: list[str], keep: bool) -> None:
    """Remove the decks and results that --keep left of another study; the file `keys` says whose they are."""
    mark = folder / "keys"
    words = "\n".join(found)
    if mark.is_file() and mark.read_text(encoding="utf-8") == words:
        return
    for path in [*folder.glob("[0-9]" * 6 + ".nml"), *folder.glob("results/" + "[0-9]" * 6)]:
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    if keep:
        folder.mkdir(parents=True, exist_ok=True)
        mark.write_text(words, encoding="utf-8")


def run_all(
    study: Study, text: str, journal: Journal, options: StudyOptions, folder: Path, pool: Executor | None = None
) -> list[str]:
    """Make the runs that the journal does not have and return the keys of all; after Ctrl-C the finished ones stay in it.

    Args:
        study: what is run
        text: of its deck
        journal: of the runs
        options: of the runs
        folder: where decks and results stay with --keep
        pool: what runs batches, which stays open; without it one is opened, and the progress is shown
    """
    found = keys(study, text, options.biela)
    begin_kept(folder / "runs", found, options.keep)
    wanted = [k for k, key in enumerate(found) if key not in journal.done]
    begun, done = time.monotonic(), 0
    if not wanted:
        return found
    waiting = batches(study, wanted, options, folder)
    used = pool or executor(options)
    running: set[Future] = set()
    try:
        while True:
            while len(running) < 3 * options.workers and (batch := next(waiting, None)):
                running.add(submit(used, batch, options))
            if not running:
                break
            finished, running = wait(running, return_when=FIRST_COMPLETED)
            for future in finished:
                rows = future.result()
                journal.add({found[row.number]: row for row in rows})
                done += len(rows)
            if not pool and options.shown:
                _progress(done, len(wanted), time.monotonic() - begun)
        if not pool:
            used.shutdown()
    except KeyboardInterrupt:
        used.shutdown(wait=False, cancel_futures=True)
        raise HistoryError(f"interrupted after {done} of {len(wanted)} runs; the same command continues") from None
    return found


def _progress(done: int, total: int, seconds: float) -> None:
    """Show how far the sweep is, on a terminal only."""
    if sys.stderr.isatty():
        left = seconds / max(done, 1) * (total - done)
        bar = "#" * (30 * done // total)
        end = "\n" if done == total else ""
        print(f"\r[{bar:<30}] {done}/{total} runs, {left:.0f} s left ", end=end, file=sys.stderr, flush=True)


def table(study: Study, journal: Journal, found: list[str]) -> tuple[list[str], list[list]]:
    """Return the header and the rows of the table, in the order of the design."""
    entries = [journal.done[key] for key in found]
    units = next((entry["units"] for entry in entries if entry["units"]), [""] * len(study.scalars))
    header = [parameter.label for parameter in study.parameters]
    header += [scalar.name + (f"[{unit}]" if unit else "") for scalar, unit in zip(study.scalars, units)] + ["failure"]
    rows = []
    for point, entry in zip(study.points, entries):
        rows.append([*point.values(), *(entry["values"] or [""] * len(study.scalars)), entry["reason"]])
    return header, rows


def write_table(path: Path, header: list[str], rows: list[list]) -> None:
    """Write the table; HistoryError where it cannot be written."""
    try:
        with path.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(header)
            writer.writerows(rows)
    except OSError as fault:
        raise HistoryError(f"{path}: cannot be written ({fault.strerror})") from None


def parse_goal(study: Study, goal: str, conditions: list[str]) -> tuple[int, int, list[tuple[int, str, float]]]:
    """Return sign (1: the smallest is best) and column of a goal, and column, comparison and value of each condition.

    Columns are counted through parameters and results.

    Raises:
        HistoryError: the words are wrong.
    """
    names = [one.name for one in (*study.parameters, *study.scalars)]
    words = goal.split()
    if len(words) != 2 or words[0] not in ("min", "max") or words[1] not in names:
        raise HistoryError(f"--best {goal!r}: 'min NAME' or 'max NAME' expected, NAME one of {', '.join(names)}")
    tests = []
    for condition in conditions:
        found = CONDITION.fullmatch(condition)
        try:
            tests.append((names.index(found[1]), found[2], float(found[3])))
        except (TypeError, ValueError):
            raise HistoryError(f"--where {condition!r}: 'NAME < VALUE' expected, NAME one of {', '.join(names)}") from None
    return (1 if words[0] == "min" else -1), names.index(words[1]), tests


def choose(study: Study, rows: list[list], goal: str, conditions: list[str]) -> tuple[list | None, int, list[tuple[int, float]]]:
    """Return the best run that meets all conditions, how many meet them, and column and limit of each condition.

    Raises:
        HistoryError: the words are wrong.
    """
    sign, column, tests = parse_goal(study, goal, conditions)
    good = [row for row in rows if not row[-1]]
    for condition, (k, test, value) in zip(conditions, tests):
        if any(isinstance(row[k], str) for row in good):
            names = [one.name for one in (*study.parameters, *study.scalars)]
            raise HistoryError(f"--where {condition!r}: the values of {names[k]} are words")
        good = [row for row in good if COMPARISONS[test](row[k], value)]
    good = [row for row in good if row[column] == row[column]]
    chosen = min(good, key=lambda row: sign * row[column]) if good else None
    return chosen, len(good), [(k, value) for k, _, value in tests]


def best(study: Study, rows: list[list], goal: str, conditions: list[str]) -> str:
    """Return a line that names the best run that meets all conditions; HistoryError where the words are wrong."""
    names = [one.name for one in (*study.parameters, *study.scalars)]
    chosen, count, _ = choose(study, rows, goal, conditions)
    if chosen is None:
        return "best: no run meets the conditions"
    shown = [f"{value:.6g}" if isinstance(value, float) else str(value) for value in chosen]
    values = ", ".join(f"{name} = {value}" for name, value in zip(names, shown))
    return f"best of {count} runs ({goal}{''.join(', ' + condition for condition in conditions)}): {values}"


def prepare(options: StudyOptions, design: bool = True) -> tuple[Study, str]:
    """Return a study and the text of its deck, in which all its parameters were found.

    Args:
        options: of the study
        design: whether the points of the study's design are wanted

    Raises:
        BielaError: the study, the deck or the options are wrong.
    """
    if not options.biela.is_file():
        raise HistoryError(f"{options.biela}: no such program: build it with make, or name it with --biela")
    study = read(options.study, design)
    base = deck_text.read(study.deck, biela=options.biela)
    known = [group.name for group in base.all("parameter")]
    for parameter in study.parameters:
        for name in parameter.deck_names:
            if name.lower() not in known:
                raise StudyError(f"parameter {name}: the deck has no &parameter of that name ({', '.join(known) or 'none'})")
        for target in parameter.targets:
            base = assign(base, target, literal(parameter.values[0]))
    if any(one.mode for one in study.scalars):
        study = replace(study, scalars=_with_shapes(study.scalars, base, options.biela))
    return study, deck_text.sources(study.deck)


def _with_shapes(scalars: tuple[Scalar, ...], deck: deck_text.DeckText, biela: Path) -> tuple[Scalar, ...]:
    """Return results with the shapes of their vibrations in the study's deck, which its runs follow; StudyError without modes."""
    for kind in ("transient", "frequency_response"):
        for group in deck.all(kind):
            deck = deck.drop(group, "not needed here")
    with tempfile.TemporaryDirectory(prefix="biela-") as name:
        folder = Path(name)
        (folder / "deck.nml").write_text(deck.text, encoding="utf-8")
        done = command.call_solver(biela, "--quiet", "--output", folder, folder / "deck.nml")
        try:
            _, shapes = vibrations(histories.read(folder, "modes"))
        except HistoryError:
            words = (done.stderr.strip().splitlines() or ["it has no &modal"])[0].removeprefix(f"{folder}/")
            raise StudyError(f"measure = 'frequency' or 'damping_ratio': the deck has no modes to follow: {words}") from None
    most = max(one.mode for one in scalars)
    if most > len(shapes):
        raise StudyError(f"mode = {most}: the deck has {len(shapes)} vibrations")
    parts = [tuple(float(x) for value in shape for x in (value.real, value.imag)) for shape in shapes]
    return tuple(replace(one, shape=parts[one.mode - 1]) if one.mode else one for one in scalars)


def open_journal(study: Study, folder: Path) -> Journal:
    """Return the journal of a study in its folder, which is made; OSError where it cannot be."""
    folder.mkdir(parents=True, exist_ok=True)
    return Journal(folder / "journal.jsonl", len(study.scalars))


def tell(tool: str, warnings: list[str]) -> None:
    """Print the warnings of a program."""
    for words in warnings:
        print(f"{tool}: warning: {words}", file=sys.stderr)


@dataclass(frozen=True)
class Sweep:
    """The table of a sweep.

    Attributes:
        study: that was run
        folder: of table.csv and of what was stored
        header: names of parameters and results with their units, and `failure`
        rows: one a run, in the order of the design; '' for the results of a run that failed
        warnings: on what was stored
    """

    study: Study
    folder: Path
    header: list[str]
    rows: list[list]
    warnings: list[str] = field(default_factory=list)

    @property
    def failed(self) -> list[list]:
        """The runs that failed, their reasons last."""
        return [row for row in self.rows if row[-1]]

    def to_dataframe(self) -> pandas.DataFrame:
        """Return the table; NaN for the results of a run that failed."""
        import pandas

        own = len(self.study.parameters)
        rows = [[*row[:own], *(math.nan if value == "" else value for value in row[own:-1]), row[-1]] for row in self.rows]
        return pandas.DataFrame(rows, columns=self.header)

    def best(self, goal: str = "", where: tuple[str, ...] = ()) -> dict | None:
        """Return parameters and results of the best run, 'min NAME' or 'max NAME' (that of the study), None where there is none.

        Raises:
            HistoryError: the words are wrong.
        """
        chosen, _, _ = choose(self.study, self.rows, goal or self.study.best, [*self.study.where, *where])
        return None if chosen is None else dict(zip((one.name for one in (*self.study.parameters, *self.study.scalars)), chosen))

    def _repr_html_(self) -> str:
        head = html.escape(f"{self.study.name}: {len(self.rows)} runs, {len(self.failed)} failed")
        return f"<p><b>{head}</b></p>" + self.to_dataframe().to_html(max_rows=20)


def sweep(options: StudyOptions) -> Sweep:
    """Run a study, or what is not stored of it, and write its table; BielaError where it cannot be run."""
    study, text = prepare(options)
    folder = options.folder("sweep")
    try:
        journal = open_journal(study, folder)
        found = run_all(study, text, journal, options, folder)
    except OSError as fault:
        raise HistoryError(f"{fault.filename or folder}: {fault.strerror or fault}") from None
    remove_noted(folder)
    result = Sweep(study, folder, *table(study, journal, found), journal.warnings)
    write_table(folder / "table.csv", result.header, result.rows)
    return result


def work(args: argparse.Namespace) -> int:
    """Run the study, print and draw; returns 0, or 1 where every run failed."""
    options = command.options_of(args, StudyOptions)
    result = sweep(replace(options, shown=True))
    study, rows = result.study, result.rows
    goal, conditions = options.best or study.best, [*study.where, *options.where]
    tell("sweep", result.warnings)
    print(f"{len(rows)} runs, {len(result.failed)} failed; table in {result.folder / 'table.csv'}")
    for row in result.failed[:3]:
        print(f"  failed: {', '.join(f'{p.name} = {v}' for p, v in zip(study.parameters, row))}: {row[-1]}")
    if not args.no_pictures and len(result.failed) < len(rows):
        from . import sweep_picture

        chosen, _, limits = choose(study, rows, goal, conditions) if goal else (None, 0, [])
        for path in sweep_picture.draw(study, result.header, rows, result.folder, chosen, limits):
            print(f"picture: {path}")
    if goal:
        print(best(study, rows, goal, conditions))
    return int(len(result.failed) == len(rows))
