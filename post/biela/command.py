"""How the programs begin and end as commands."""

from __future__ import annotations

import argparse
import importlib
import math
import os
import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Callable, NoReturn

from .result_files import BielaError

if TYPE_CHECKING:
    import subprocess

CLOSED = 141  # status of a command whose reader has gone, as shells count it (128 + SIGPIPE)
ROOT = Path(__file__).resolve().parents[2]
SOLVER = ROOT / "bin" / "biela"  # built by `make`; found from any folder
if not SOLVER.is_file():  # the installed package
    SOLVER = Path(shutil.which("biela") or SOLVER)


def parser(tool: str, description: str, runs_solver: bool = False) -> argparse.ArgumentParser:
    """Return the parser of a program's command line.

    Args:
        tool: name of the program
        description: first part of its help, printed as it is laid out
        runs_solver: whether it has the option --biela
    """
    form = argparse.RawDescriptionHelpFormatter
    found = argparse.ArgumentParser(prog=f"{tool}.py", description=description, formatter_class=form)
    if runs_solver:
        found.add_argument("--biela", type=Path, default=SOLVER, help="the solver (bin/biela of the project)")
    return found


def study_parser(tool: str, description: str) -> argparse.ArgumentParser:
    """Return the parser of a program that makes the runs of a study, with the options that all of these have."""
    found = parser(tool, description, runs_solver=True)
    found.add_argument("study", type=Path, metavar="STUDY.toml", help="deck, parameters and results (see post/README.md)")
    found.add_argument("--output", type=Path, metavar="DIR", help=f"folder of the results (results/{tool}/<study name>)")
    found.add_argument("--jobs", type=count, help=f"runs side by side (all cores: {os.cpu_count() or 1})")
    found.add_argument("--dask", metavar="ADDRESS", help="address of a Dask scheduler, instead of this machine's cores")
    found.add_argument("--start", type=finite, metavar="S", help="rows before do not count (results with their own `from`: that)")
    found.add_argument("--end", type=finite, metavar="S", help="rows after do not count (results with their own `to`: that)")
    found.add_argument("--no-pictures", action="store_true", help="tables only")
    return found


def options_of(args: argparse.Namespace, kind: type) -> object:
    """Return what a command line says as a record of options; what it does not have keeps the record's default."""
    import dataclasses

    given = {name: tuple(value) if isinstance(value, list) else value for name, value in vars(args).items()}
    return kind(**{one.name: given[one.name] for one in dataclasses.fields(kind) if given.get(one.name) is not None})


def call_solver(biela: Path, *words: object) -> subprocess.CompletedProcess:
    """Call the solver and return its status and what it writes; BielaError where it cannot be called."""
    import subprocess

    try:
        return subprocess.run([biela.resolve(), *words], capture_output=True, encoding="utf-8", errors="replace", check=False)
    except OSError as fault:
        raise BielaError(f"{biela}: cannot be run ({fault.strerror}): `make` builds it, --biela names another") from None


def finite(text: str) -> float:
    """Return a number from the command line; infinities and NaN are none."""
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise argparse.ArgumentTypeError(f"{text!r}: a number expected")
    return number


def positive(text: str) -> float:
    """Return a number above zero from the command line."""
    number = finite(text)
    if number <= 0.0:
        raise argparse.ArgumentTypeError(f"{text!r}: a number above 0 expected")
    return number


def count(text: str) -> int:
    """Return a whole number of at least one from the command line."""
    try:
        number = int(text)
    except ValueError:
        number = 0
    if number < 1:
        raise argparse.ArgumentTypeError(f"{text!r}: a whole number of at least 1 expected")
    return number


def attempt(tool: str, work: Callable[[], int], failed: int = 2) -> int:
    """Return the status of a tool's work; a fault of its files becomes one line on standard error.

    Args:
        tool: name of the tool, which begins the line
        work: what the tool does; returns its exit status
        failed: status after a fault
    """
    try:
        return work()
    except BielaError as fault:
        print(f"{tool}: {fault}", file=sys.stderr)
        return failed


def program(parser: argparse.ArgumentParser, work: str, failed: int = 2) -> Callable[..., int]:
    """Return a program as a function of the arguments of its command line.

    Args:
        parser: of the command line
        work: MODULE.FUNCTION of this package, which takes what was parsed and returns the exit status; loaded after the parsing
        failed: status after a fault
    """

    def main(words: list[str] | None = None) -> int:
        args = parser.parse_args(words)
        module, function = work.split(".")
        do = getattr(importlib.import_module(f".{module}", __package__), function)
        return attempt(parser.prog.removesuffix(".py"), lambda: do(args), failed)

    return main


def missing(fault: ModuleNotFoundError) -> str:
    """Return the words on a library that is not installed; a module of this package that is not there is a fault of the program."""
    name = (fault.name or "").partition(".")[0]
    if name in ("", "biela"):
        raise fault
    return f"the Python package {name!r} is missing: `make setup` installs it, or pip install {name}"


def run(main: Callable[[], int]) -> NoReturn:
    """Call a tool and end with its status; what it prints never ends it.

    Characters that the terminal's encoding lacks are shown as '?'. Where the reader has gone (`| head`), the tool ends quietly.

    Args:
        main: the tool; returns its exit status
    """
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            stream.reconfigure(errors="replace")
    try:
        status = main()
        if sys.stdout is not None:
            sys.stdout.flush()
    except ModuleNotFoundError as fault:
        tool = Path(sys.argv[0]).stem.removeprefix("biela-")
        print(f"{tool}: {missing(fault)}", file=sys.stderr)
        status = 2
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # what is still buffered has no reader
        status = CLOSED
    sys.exit(status)
