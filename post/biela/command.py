"""What the programs share: words of their command lines, how they end, the call of the solver."""

from __future__ import annotations

import argparse
import contextlib
import functools
import math
import os
import shutil
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Callable, NoReturn

from .result_files import BielaError

if TYPE_CHECKING:
    import subprocess

WIDTH = 118  # letters of the line
ROOT = Path(__file__).resolve().parents[2]
SOLVER = ROOT / "bin" / "biela"  # built by `make`; found from any folder
if not SOLVER.is_file():  # the installed package
    SOLVER = Path(shutil.which("biela") or SOLVER)


class Progress:
    """The line, which each call writes anew; `Progress.shown` says whether a program lets it be seen."""

    shown = False

    def __init__(self) -> None:
        self.begun = time.monotonic()

    def show(self, what: str, done: int, count: int, more: str = "") -> None:
        """Write how many of so many are done, how long that took, and more words; count 0: how many there will be is not known."""
        seconds = time.monotonic() - self.begun
        bar = f"[{'#' * (20 * done // count):.<20}] " if count else ""
        self._write(f"{bar}{what}: {done}{f'/{count}' if count else ''}, {seconds:.0f} s{more}"[:WIDTH].ljust(WIDTH))

    def clear(self) -> None:
        """Take the line away."""
        self._write(" " * WIDTH + "\r")

    def _write(self, text: str) -> None:
        if self.shown and sys.stderr.isatty():
            print(f"\r{text}", end="", file=sys.stderr, flush=True)


def options_of(args: argparse.Namespace, kind: type) -> object:
    """Return what a command line says as a record of options; what it does not have keeps the record's default."""
    import dataclasses

    given = {name: tuple(value) if isinstance(value, list) else value for name, value in vars(args).items()}
    return kind(**{one.name: given[one.name] for one in dataclasses.fields(kind) if given.get(one.name) is not None})


def call_solver(biela: Path, *words: object, given: str | None = None) -> subprocess.CompletedProcess:
    """Call the solver with words, and text on its standard input; return what it leaves; BielaError where it cannot be called."""
    import subprocess

    try:
        return subprocess.run([biela.resolve(), *words], input=given, stdin=subprocess.DEVNULL if given is None else None,
                              capture_output=True, encoding="utf-8", errors="replace", check=False)  # fmt: skip
    except OSError as fault:
        raise BielaError(f"{biela}: cannot be run ({fault.strerror}): `make` builds it, --biela names another") from None


def finite(text: str, words: str = "a number", least: float = -math.inf, kind: type = float) -> float:
    """Return a number from the command line, of a kind and not below the least; infinities and NaN are none."""
    with contextlib.suppress(ValueError):
        if math.isfinite(number := kind(text)) and number >= least:
            return number
    raise argparse.ArgumentTypeError(f"{text!r}: {words} expected")


positive = functools.partial(finite, words="a number above 0", least=math.ulp(0.0))
tolerance = functools.partial(finite, words="a number of at least 0", least=0.0)
count = functools.partial(finite, words="a whole number of at least 1", least=1, kind=int)


def pair(text: str) -> tuple[str, float]:
    """Return name and tolerance of NAME=TOLERANCE from the command line."""
    name, mark, value = text.rpartition("=")
    with contextlib.suppress(ValueError):
        if mark and name and 0.0 <= float(value) < math.inf:
            return name, float(value)
    raise argparse.ArgumentTypeError(f"{text!r}: NAME=TOLERANCE expected")


def attempt(tool: str, work: Callable[[], int], failed: int = 2) -> int:
    """Return the exit status of a tool's work; a fault of its files becomes one line on standard error, and its status."""
    try:
        return work()
    except BielaError as fault:
        Progress().clear()
        print(f"{tool}: {fault}", file=sys.stderr)
        return failed


def missing(fault: ModuleNotFoundError) -> str:
    """Return the words on a library that is not installed; a module of this package that is not there is a fault of the program."""
    name = (fault.name or "").partition(".")[0]
    if name in ("", "biela"):
        raise fault
    return f"the Python package {name!r} is missing: `make setup` installs it, or pip install {name}"


def run(tool: str, main: Callable[[], int]) -> NoReturn:
    """Call a tool and end with its status; letters that the terminal lacks are '?', without a reader (`| head`) it ends quietly."""
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            stream.reconfigure(errors="replace")
    try:
        status = main()
        if sys.stdout is not None:
            sys.stdout.flush()
    except (ModuleNotFoundError, KeyboardInterrupt) as fault:
        stopped = isinstance(fault, KeyboardInterrupt)
        print(f"{tool}: {'interrupted' if stopped else missing(fault)}", file=sys.stderr)
        status = 130 if stopped else 2
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # what is still buffered has no reader
        status = 141  # of a command whose reader has gone, as shells count it (128 + SIGPIPE)
    sys.exit(status)
