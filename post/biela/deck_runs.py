"""Runs of many variants of a deck: side by side on the cores at hand, each stored, so that an interrupted study resumes.

The key of a stored run is the hash of the deck's text and of the solver itself: another solver or another word in the deck is
another run. What a run costs is read from its summary: seconds of the analyses without start-up, evaluations of the equations
of motion, residuals of implicit methods, banded solves, unknowns.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import re
import shutil
import signal
import subprocess
import threading
import time
import zipfile
import zlib
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from . import solver_start
from .histories import Event, read, read_events, read_summary, still_columns
from .progress import Progress
from .result_files import BielaError, HistoryError

COUNTS = {
    "steps": ("transient", "steps"),
    "rejected": ("transient", "rejected"),
    "evaluations": ("transient", "evaluations"),
    "newton": ("transient", "newton_iterations"),
    "residuals": ("transient", "residual_evaluations"),
    "solves": ("transient", "banded_solves"),
    "coordinates": ("model", "coordinates"),
    "dissipative": ("model", "dissipative_coordinates"),
    "first_order": ("model", "dissipative_coordinates_of_first_order"),
    "multipliers": ("model", "constraints"),
}
MOST_REPEATS = 9  # a run that is timed alone is repeated at most this often
REPEAT_TIME = 1.0  # [s] by the clock after which a run timed alone is not repeated any more
GRACE = 0.5  # [s] that a run has to write how far it came
Item = TypeVar("Item")
Result = TypeVar("Result")
MARK = "\n! timed alone\n"


class RunsError(BielaError):
    """The solver or the folder cannot be used."""


class InterruptedRunsError(Exception):
    """Ctrl-C: what was finished is stored."""


class OutOfTimeError(Exception):
    """The time of the study is over: no further run starts."""


@dataclass(frozen=True)
class Unfinished:
    """A run that the time ended.

    Attributes:
        text: of the deck
        seconds: by the clock that it had [s]
        reached: the time of the motion that it came to, nan where it had not begun [s]
    """

    text: str
    seconds: float
    reached: float


@dataclass(frozen=True)
class Outcome:
    """What a run gave and cost.

    Attributes:
        status: exit status of the solver, -1: stopped for taking too long
        message: its first error line, '' where it ran
        names: columns without the time
        data: rows of the history, shape (rows, 1 + columns), the time first
        seconds: of the processor, analyses only; median of the repeats where it was timed alone [s]
        counts: steps, evaluations, newton, residuals, solves, coordinates, dissipative,
            first_order, multipliers
        warnings: of the solver, a sentence each
        still: columns that only rounding moves, as the solver finds; None: it does not list them
        events: at which stops and joints change their states
        model_errors: estimated errors of each column, `errors` of left-out modes and `mesh_errors`, where the deck asks for them
    """

    status: int
    message: str
    names: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    data: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    seconds: float = float("nan")
    counts: dict[str, int] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    still: tuple[str, ...] | None = None
    events: tuple[Event, ...] = ()
    model_errors: dict[str, dict[str, float]] = field(default_factory=dict)

    @property
    def ok(self) -> bool:
        """Whether the run went to its end."""
        return self.status == 0

    @property
    def unknowns(self) -> int:
        """First-order unknowns: twice the coordinates and the dissipative ones of GHM terms, once those of Maxwell terms."""
        second_order = self.counts.get("coordinates", 0) + self.counts.get("dissipative", 0)
        return 2 * second_order - self.counts.get("first_order", 0)

    @property
    def evaluations(self) -> int:
        """Evaluations of the equations of motion, residuals of implicit steps among them (one a Newton iteration or stage)."""
        return self.counts.get("evaluations", 0) + self.counts.get("residuals", self.counts.get("newton", 0))

    @property
    def steps(self) -> int:
        """Steps, the rejected ones included."""
        return self.counts.get("steps", 0) + self.counts.get("rejected", 0)

    @property
    def work(self) -> int:
        """Evaluations times unknowns: a cost that no machine changes."""
        return self.evaluations * self.unknowns


@dataclass
class Runner:
    """Runs decks and keeps what they gave.

    Attributes:
        biela: the solver
        folder: where runs are stored
        jobs: how many run at a time
        longest: a run that takes longer is stopped [s]
        quiet: no progress bar
        time: that the study may take [s]
        share: of that time after which no run of the present phase goes on
        unfinished: runs that the time ended
        loading_seconds: of the processor, which count as used before the first run: of a program, what loading it took [s]
    """

    biela: Path
    folder: Path
    jobs: int = field(default_factory=lambda: os.cpu_count() or 1)
    longest: float = 300.0
    quiet: bool = False
    time: float = math.inf
    share: float = 1.0
    unfinished: list[Unfinished] = field(default_factory=list)
    loading_seconds: float = 0.0

    def __post_init__(self) -> None:
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            self.digest = hashlib.sha256(self.biela.read_bytes()).hexdigest()
        except OSError as fault:
            hint = " (`make` builds the solver)" if fault.filename == str(self.biela) else ""
            raise RunsError(f"{fault.filename}: {fault.strerror}{hint}") from None
        self.children: set[subprocess.Popen] = set()
        self.stopped = threading.Event()
        self.progress = Progress(not self.quiet)
        self.made = self.found = 0
        self.started, self.earlier_seconds = time.monotonic(), _children_seconds()
        self.clock_seconds: list[float] = []  # by the clock, for each run [s]

    def slowness(self) -> float:
        """Return the ratio of clock time to processor time of the runs so far: it grows with other work on the machine."""
        used = _children_seconds() - self.earlier_seconds
        return max(sum(self.clock_seconds) / used, 1.0) if used > 0.0 else 1.0

    def left(self) -> float:
        """Return the seconds that the present phase of the study still has; what loading the tool took is counted."""
        return self.share * self.time - (time.monotonic() - self.started) - self.loading_seconds * self.slowness()

    def late(self, share: float = 1.0) -> bool:
        """Whether that share of the time until the present phase ends is over."""
        return self.left() <= (1.0 - share) * self.share * self.time if math.isfinite(self.time) else False

    def one(self, text: str) -> Outcome:
        """Run one deck."""
        return self.all([text])[0]

    def all(self, texts: Iterable[str], stage: str = "") -> list[Outcome]:
        """Run decks side by side; the outcomes in their order.

        Raises:
            InterruptedRunsError: after Ctrl-C.
            OutOfTimeError: the time of the phase is over and one of them was neither stored nor finished.
        """
        texts = list(texts)
        pool = ThreadPoolExecutor(self.jobs)
        jobs = {text: pool.submit(self._stored_or_made, text) for text in dict.fromkeys(texts)}
        try:
            open_jobs = set(jobs.values())
            while open_jobs:
                done, open_jobs = wait(open_jobs, timeout=0.25, return_when=FIRST_COMPLETED)
                counts = f", {self.made} runs made, {self.found} stored ones used"
                self.progress.show(stage, len(jobs) - len(open_jobs), len(jobs), counts)
                for job in done:
                    job.result()
            return [jobs[text].result() for text in texts]
        except KeyboardInterrupt:
            self.stop()
            raise InterruptedRunsError from None
        finally:
            for job in jobs.values():
                job.cancel()
            pool.shutdown(wait=True)

    def spread(self, task: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
        """Return task(item) of each item, several at a time; tasks may call `all`. InterruptedRunsError after Ctrl-C."""
        pool = ThreadPoolExecutor(self.jobs)
        jobs = [pool.submit(task, item) for item in items]
        try:
            return [job.result() for job in jobs]
        except KeyboardInterrupt:
            self.stop()
            raise InterruptedRunsError from None
        finally:
            for job in jobs:
                job.cancel()
            pool.shutdown(wait=True)

    def stop(self) -> None:
        """End the solvers that run; nothing is started any more."""
        self.stopped.set()
        for child in list(self.children):
            _end(child)

    def timed(self, text: str) -> Outcome:
        """Run a deck alone, several times, and return it with the median of the seconds; stored like other runs."""
        return self.all([text + MARK])[0]

    def timed_in_turn(self, first: str, second: str) -> tuple[Outcome, Outcome]:
        """Run two decks in turn, so that other work on the machine slows both alike; stored like other runs."""
        marked = [f"{a}{MARK}! beside {self._key(b)}\n" for a, b in ((first, second), (second, first))]
        found = [self.stored(text) for text in marked]
        if all(found):
            return found[0], found[1]
        runs: list[tuple[Outcome, Outcome]] = []
        begun = time.monotonic()
        while not runs or (len(runs) < MOST_REPEATS and time.monotonic() - begun < REPEAT_TIME):
            try:
                runs.append(tuple(self._made(text.replace(MARK, "\n"), self._key(text)) for text in marked))
            except OutOfTimeError:
                if runs:
                    break
                raise
        done = [_median(outcomes) for outcomes in zip(*runs)]
        for text, outcome in zip(marked, done):
            _save(self.folder / f"{self._key(text)}.npz", outcome)
        return done[0], done[1]

    def _key(self, text: str) -> str:
        """Return the name under which a run is stored."""
        return hashlib.sha256((self.digest + text).encode()).hexdigest()[:32]

    def stored(self, text: str) -> Outcome | None:
        """Return a stored run, None where there is none yet."""
        with contextlib.suppress(OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error):
            return _load(self.folder / f"{self._key(text)}.npz")
        return None

    def _stored_or_made(self, text: str) -> Outcome:
        """Return a stored run or make it."""
        outcome = self.stored(text)
        if outcome:
            self.found += 1
            return outcome
        if self.stopped.is_set():
            raise InterruptedRunsError
        key = self._key(text)
        outcome = self._made(text, key)
        if self.stopped.is_set() and not outcome.ok:
            raise InterruptedRunsError
        _save(self.folder / f"{key}.npz", outcome)
        self.made += 1
        return outcome

    def _made(self, text: str, key: str) -> Outcome:
        """Run a deck, several times where it is timed alone."""
        run_folder = self.folder / f"{key}.{os.getpid()}.run"
        run_folder.mkdir(exist_ok=True)
        try:
            (run_folder / "deck.nml").write_text(text, encoding="utf-8")
            begun = time.monotonic()
            outcomes = [self._run(run_folder)]
            with contextlib.suppress(OutOfTimeError):
                while text.endswith(MARK) and len(outcomes) < MOST_REPEATS and time.monotonic() - begun < REPEAT_TIME:
                    outcomes.append(self._run(run_folder))
            return _median(outcomes)
        finally:
            shutil.rmtree(run_folder, ignore_errors=True)

    def _run(self, run_folder: Path) -> Outcome:
        """Call the solver on the deck in a folder; OutOfTimeError where the phase ends before the run."""
        limit = min(self.longest, self.left())
        if limit <= 0.0:
            raise OutOfTimeError
        child = solver_start.start([self.biela.resolve(), "--quiet", "--output", "out", "deck.nml"], run_folder)
        self.children.add(child)
        if self.stopped.is_set():
            _end(child)
        begun = time.monotonic()
        try:
            _, errors = child.communicate(timeout=limit)
            status = solver_start.status(child)
        except subprocess.TimeoutExpired:
            reached = _reached(child)
            if limit < self.longest:
                self.unfinished.append(Unfinished((run_folder / "deck.nml").read_text(encoding="utf-8"), limit, reached))
                raise OutOfTimeError from None
            status, errors = -1, f"deck.nml: stopped after {self.longest:g} s" + (f" at t = {reached:g} s" if reached > 0.0 else "")
        except BaseException:
            _end(child)
            raise
        finally:
            self.children.discard(child)
            self.clock_seconds.append(time.monotonic() - begun)
        lines = [line for line in errors.splitlines() if "warning" not in line]
        message = re.sub(r"^deck\.nml:(?=\d)", "line ", lines[0]).removeprefix("deck.nml: ") if lines else ""
        if status:
            return Outcome(status, message or f"the solver ended with status {status}")
        try:
            history = read(run_folder / "out")
            summary = read_summary(run_folder / "out")
            events = tuple(read_events(run_folder / "out"))
        except HistoryError as fault:
            return Outcome(-2, str(fault))
        counts = {name: summary[part][key] for name, (part, key) in COUNTS.items() if key in summary.get(part, {})}
        seconds = summary["timing"]["processor_seconds"]
        units = tuple(history.units[name] for name in history.names[1:])
        warnings = tuple(summary.get("warnings", ()))
        still = still_columns(summary)
        still = None if still is None else tuple(still)
        found = summary.get("reduction", {})
        model = {kind: found[kind] for kind in ("errors", "mesh_errors") if kind in found}
        return Outcome(0, "", tuple(history.names[1:]), units, history.data, seconds, counts, warnings, still, events, model)


def _median(outcomes: Sequence[Outcome]) -> Outcome:
    """Return the first of several runs of a deck with the median of their seconds."""
    return replace(outcomes[0], seconds=float(np.median([outcome.seconds for outcome in outcomes])))


def _children_seconds() -> float:
    """Return the seconds of the processor that all solvers that have ended took."""
    return sum(os.times()[2:4])


def _reached(child: subprocess.Popen) -> float:
    """Stop a solver and return the time of the motion that it says it came to [s], nan where it says nothing."""
    _end(child, signal.SIGTERM)
    try:
        _, errors = child.communicate(timeout=GRACE)
    except subprocess.TimeoutExpired:
        _end(child)
        _, errors = child.communicate()
    found = re.search(r"stopped by signal \d+ at t = +(\S+) s", errors)
    return float(found[1]) if found else math.nan


def _end(child: subprocess.Popen, how: int = signal.SIGKILL) -> None:
    """Stop a solver that was started here."""
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(child.pid, how)


def _save(path: Path, outcome: Outcome) -> None:
    """Store a run; the file is written under another name and renamed, so that it is never incomplete."""
    plain = {k: v for k, v in outcome.__dict__.items() if k != "data"}
    new = path.with_suffix(f".{os.getpid()}.{threading.get_ident()}.new")
    with new.open("wb") as file:
        np.savez_compressed(file, data=outcome.data, rest=np.array(json.dumps(plain)))
    new.replace(path)


def _load(path: Path) -> Outcome:
    """Return a stored run."""
    with np.load(path) as stored:
        rest = json.loads(str(stored["rest"]))
        rest |= {name: tuple(rest.get(name, ())) for name in ("names", "units", "warnings")}
        rest["events"] = tuple(Event(*event) for event in rest["events"])
        rest["still"] = None if rest.get("still") is None else tuple(rest["still"])
        return Outcome(data=stored["data"], **rest)
