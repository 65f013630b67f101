"""How the tools of this folder begin and end as commands."""

from __future__ import annotations

import os
import sys
from typing import Callable, NoReturn

from histories import HistoryError

CLOSED = 141  # status of a command whose reader has gone, as shells count it (128 + SIGPIPE)


def attempt(tool: str, work: Callable[[], int], failed: int = 2) -> int:
    """Return the status of a tool's work; a fault of its files becomes one line on standard error.

    Args:
        tool: name of the tool, which begins the line
        work: what the tool does; returns its exit status
        failed: status after a fault
    """
    try:
        return work()
    except HistoryError as fault:
        print(f"{tool}: {fault}", file=sys.stderr)
        return failed


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
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # what is still buffered has no reader
        status = CLOSED
    sys.exit(status)
