"""The files of a results folder, and the fault that every program tells in one line; nothing here takes time to load."""

from __future__ import annotations

import os
from pathlib import Path

RESULT_FILES = {
    "history": "history.txt",
    "energy": "energy.txt",
    "motion": "motion.txt",
    "static": "static.txt",
    "modes": "modes.txt",
    "frequency_response": "frequency_response.txt",
}
EVENTS = "events.txt"  # words beside numbers: not one of the tables above
TABLES = {"csv": ".csv", "parquet": ".parquet", "matlab": ".mat", "hdf5": ".h5"}  # suffix of each format of a table


class BielaError(Exception):
    """Whatever goes wrong, in few lines."""


class HistoryError(BielaError):
    """A results file that is missing or damaged, or a column that it does not have."""


def note(path: Path) -> None:
    """Note a file that shows the results beside it in `.drawn`: the next run that replaces the results removes it.

    Raises:
        OSError: the note cannot be written.
    """
    folder = path.parent
    if not any((folder / name).is_file() for name in ("summary.json", "journal.jsonl")):
        return
    notes = folder / ".drawn"
    if notes.is_file() and path.name in notes.read_text(encoding="utf-8", errors="replace").split("\n"):
        return
    handle = os.open(notes, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW, 0o666)
    with os.fdopen(handle, "a", encoding="utf-8") as file:
        file.write(path.name + "\n")


def remove_noted(folder: Path) -> None:
    """Remove the files that `note` has noted in a folder, as the solver does before a run; OSError where that is not allowed."""
    notes = folder / ".drawn"
    if not notes.is_file():
        return
    for name in notes.read_text(encoding="utf-8", errors="replace").split("\n"):
        if name and "/" not in name and (folder / name).is_file():
            (folder / name).unlink()
    notes.unlink()
