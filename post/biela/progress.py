"""One line on a terminal that says how far a program is; nothing where standard error is no terminal, and in functions."""

from __future__ import annotations

import sys
import time

WIDTH = 118  # letters of the line


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
