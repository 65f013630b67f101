"""Starts a solver that ends with the process that started it, also where that one is killed."""

from __future__ import annotations

import contextlib
import functools
import os
import signal
import subprocess
from pathlib import Path

# A shell starts the solver. It ends the solver when nobody holds the other end of its standard input any more.
SHELL = """exec 3<&0
"$@" 3<&- </dev/null & solver=$!
{ read -r nothing <&3; kill "$solver"; } >/dev/null 2>&1 & watch=$!
wait "$solver"; status=$?; kill "$watch" 2>/dev/null; exit $status"""


def start(words: list, folder: Path) -> subprocess.Popen:
    """Start the solver in a folder, as a group of processes of its own; its standard error is a pipe."""
    return subprocess.Popen(
        ["/bin/sh", "-c", SHELL, "sh", *words],
        cwd=folder,
        stdin=_pipe(os.getpid())[0],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def status(solver: subprocess.Popen) -> int:
    """Return the exit status of a solver that has ended, minus the number of the signal that stopped it."""
    return solver.returncode if solver.returncode <= 128 else 128 - solver.returncode


def end(solver: subprocess.Popen) -> None:
    """Stop a solver that was started here, and what it started."""
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(solver.pid, signal.SIGKILL)
    solver.communicate()


@functools.cache
def _pipe(process: int) -> tuple[int, int]:  # noqa: ARG001
    """Return both ends of the pipe that ends with this process, not with the one that it was copied from."""
    return os.pipe()
