"""Makes the runs of a study side by side, on the cores at hand or a Dask cluster, each once: finished ones stand in a journal."""

from __future__ import annotations

import hashlib
import json
import logging
import math
import shutil
import time
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from dataclasses import asdict
from pathlib import Path

from .command import Progress
from .deck import Deck
from .mode_following import Followed
from .result_files import HistoryError
from .sweep_run import Batch, Row, common_settings, end_with_parent, run_batch, settings_of
from .sweep_study import Study, StudyOptions

FOLDER = Path(__file__).resolve().parents[1]  # of the package
BATCH = 50
RUNNING = "running"  # folder of runs that are under way; what is in it at the start of a study was killed


class Journal:
    """The finished runs of a sweep, one line of JSON each; a sweep that was interrupted reads them and continues."""

    def __init__(self, path: Path, results: int) -> None:
        """Read the journal of a study with that many results."""
        self.path = path
        self.done: dict[str, dict] = {}  # what each run gave, by its key: the fields of a `Row`
        self.damaged: list[int] = []  # lines that cannot be read, as an interruption leaves them: their runs are made again
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
        count = 0 if entry["reason"] else results
        return entry if isinstance(entry["key"], str) and len(entry["values"]) == len(entry["units"]) == count else None
    except (ValueError, KeyError, TypeError, RecursionError):
        return None


def digest(biela: Path) -> str:
    """Return a hash of what runs and measures."""
    names = ("sweep_run.py", "sweep_scalars.py", "decays.py", "fatigue.py", "tradeoff_errors.py")
    programs = biela, *(FOLDER / "biela" / name for name in names)
    return hashlib.sha256(b"".join(path.read_bytes() for path in programs)).hexdigest()


def keys(study: Study, text: str, solver: str, runs: list[tuple[str, ...]]) -> list[str]:
    """Return a key for each run: a hash of solver (`digest`), deck, settings and measures. The same key means the same run."""
    measured = asdict(study.measured) if study.measured else [asdict(scalar) for scalar in study.scalars]
    common = json.dumps([solver, text, measured, study.extremes, study.check, study.follow])
    head = hashlib.sha256(common.encode())
    found = []
    for run in runs:
        own = head.copy()
        own.update(json.dumps(run).encode())
        found.append(own.hexdigest()[:24])
    return found


def batches(
    study: Study, common: tuple[str, ...], runs: list[tuple[str, ...]], wanted: list[int], options: StudyOptions, folder: Path
) -> Iterator[Batch]:
    """Yield batches of the runs that are still to be made: single ones where time is limited, a row of cycles that follow."""
    size = max(1, min(BATCH if math.isinf(options.longest) else 1, len(wanted) // (4 * options.workers) or 1))
    parts = [wanted[first : first + size] for first in range(0, len(wanted), size)]
    if study.follow:
        row = len(study.parameters[-1].values)
        parts = [range(k, min(k + row, len(runs))) for k in range(0, len(runs), row) if {*wanted} & {*range(k, k + row)}]
    for part in parts:
        own = {number: {word.partition("=")[0] for word in runs[number]} for number in part}
        some = {number: (*runs[number], *(word for word in common if word.partition("=")[0] not in own[number])) for number in part}
        place = folder / "runs" if options.keep else folder / RUNNING / f"{part[0]:06d}"
        how = options.keep, study.extremes, study.check, study.measured, options.longest, study.follow
        yield Batch(str(options.biela.resolve()), str(study.deck), some, study.scalars, str(place.resolve()), *how)


def executor(options: StudyOptions) -> Executor:
    """Return what runs batches: this machine's cores, or a Dask scheduler; HistoryError where there is none."""
    if not options.scheduler:
        return ProcessPoolExecutor(max_workers=options.workers, initializer=end_with_parent)
    try:
        from dask.distributed import Client
    except ImportError:
        raise HistoryError("--scheduler needs the package distributed: pip install 'dask[distributed]'") from None
    try:
        logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what goes wrong is told here
        return Client(options.scheduler, timeout="10s").get_executor(pure=False, retries=5)
    except OSError as fault:
        raise HistoryError(f"--scheduler {options.scheduler}: no scheduler answers ({fault})") from None


def submit(pool: Executor, batch: Batch, options: StudyOptions) -> Future:
    """Hand a batch over."""
    if not options.scheduler:
        return pool.submit(run_batch, batch)
    import pickle

    def on_worker(folder: str, words: bytes) -> list[Row]:
        """Run a batch where this package may never have been seen; within a function, so that it is sent as code, not by name."""
        import pickle
        import sys

        if folder not in sys.path:
            sys.path.insert(0, folder)
        from biela.sweep_run import run_batch

        return run_batch(pickle.loads(words))

    return pool.submit(on_worker, str(FOLDER), pickle.dumps(batch))


def rows_of(future: Future) -> list[Row]:
    """Return what a batch gave; HistoryError where its worker has ended."""
    try:
        return future.result()
    except OSError:
        raise
    except Exception as fault:  # of the pool, or of Dask: a worker that was killed, another version of Python
        words = str(fault).strip().partition("\n")[0] or type(fault).__name__
        raise HistoryError(f"a worker does not go on ({words}); the same command continues") from None


class StudyRuns:
    """Makes runs of a study and of what searches ask of it."""

    def __init__(self, study: Study, deck: Deck, options: StudyOptions, folder: Path) -> None:
        self.study, self.deck, self.options, self.folder = study, deck, options, folder
        self.text = deck.flat(options.biela)
        self.progress = Progress()
        self.pool: Executor | None = None
        self.followed = Followed(study)
        self.digest = ""
        try:
            folder.mkdir(parents=True, exist_ok=True)
            for left in (RUNNING, *["runs"] * options.keep):  # of a study that was killed, and of one that kept its runs
                shutil.rmtree(folder / left, ignore_errors=True)
            self.journal = Journal(folder / "journal.jsonl", len(study.measured.names if study.measured else study.scalars))
        except OSError as fault:
            raise HistoryError(f"{fault.filename or folder}: {fault.strerror or fault}") from None

    def __enter__(self) -> StudyRuns:
        return self

    def __exit__(self, *_: object) -> None:
        if self.pool:
            self.pool.shutdown(wait=False, **({} if self.options.scheduler else {"cancel_futures": True}))  # Dask's always does
        shutil.rmtree(self.folder / RUNNING, ignore_errors=True)
        self.progress.clear()

    def entries(self, study: Study) -> list[dict]:
        """Return what the journal has of the study's points, missing runs are made; errors are those of `run_all`."""
        found = self.run_all(study, [settings_of(study, point) for point in study.points])
        return self.followed.take(study, found) if any(one.mode for one in study.scalars) else found

    def run_all(self, study: Study, runs: list[tuple[str, ...]]) -> list[dict]:
        """Make runs (NAME=VALUE of each) that the journal lacks; return all; HistoryError: Ctrl-C, solver or journal fail."""
        running: set[Future] = set()
        done, wanted = 0, []
        try:
            self.digest = self.digest or digest(self.options.biela)
            found = keys(study, self.text, self.digest, runs)
            wanted = [k for k, key in enumerate(found) if self.options.keep or key not in self.journal.done]
            begun = time.monotonic()
            common = common_settings(study, self.deck, not self.options.keep) if wanted else ()
            waiting = batches(study, common, runs, wanted, self.options, self.folder)
            self.pool = self.pool or (executor(self.options) if wanted else None)
            while True:
                while len(running) < 3 * self.options.workers and (batch := next(waiting, None)):
                    running.add(submit(self.pool, batch, self.options))
                if not running:
                    return [self.journal.done[key] for key in found]
                finished, running = wait(running, return_when=FIRST_COMPLETED)
                for future in finished:
                    rows = rows_of(future)
                    self.journal.add({found[row.number]: row for row in rows})
                    done += len(rows)
                left = (time.monotonic() - begun) / max(done, 1) * (len(wanted) - done)
                self.progress.show("runs", done, len(wanted), f", {left:.0f} s left")
        except KeyboardInterrupt:
            raise HistoryError(f"interrupted after {done} of {len(wanted)} runs; the same command continues") from None
        except OSError as fault:
            raise HistoryError(f"{fault.filename or self.folder}: {fault.strerror or fault}") from None
