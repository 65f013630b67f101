"""One line on a terminal that says how far a study is; nothing where standard error is no terminal."""

from __future__ import annotations

import contextvars
import sys
import threading
import time

WIDTH = 118  # letters of the line


class Progress:
    """The line, which each call writes anew."""

    def __init__(self, shown: bool) -> None:
        self.shown = shown and sys.stderr.isatty()
        self.begun = time.monotonic()
        self.lock = threading.Lock()

    def show(self, what: str, done: int, count: int, more: str = "") -> None:
        """Write how many of so many are done, how long that took, and more words; count 0: how many there will be is not known."""
        seconds = time.monotonic() - self.begun
        bar = f"[{'#' * (20 * done // count):.<20}] " if count else ""
        line = f"{bar}{what}: {done}{f'/{count}' if count else ''}, {seconds:.0f} s{more}"
        self._write("\r" + line[:WIDTH].ljust(WIDTH))

    def clear(self) -> None:
        """Take the line away."""
        self._write("\r" + " " * WIDTH + "\r")

    @classmethod
    def of_program(cls) -> Progress:
        """Return the line of the program that runs; where none does, one that is not written."""
        return _PROGRAM.get(None) or cls(False)

    @classmethod
    def begin(cls) -> Progress:
        """Show how far what a program does is; return the line."""
        _PROGRAM.set(cls(True))
        return _PROGRAM.get()

    def _write(self, text: str) -> None:
        if self.shown:
            with self.lock:
                print(text, end="", file=sys.stderr, flush=True)


_PROGRAM: contextvars.ContextVar[Progress] = contextvars.ContextVar("progress")
