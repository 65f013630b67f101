"""The files of a results folder, and the fault that every program tells in one line; nothing here takes time to load."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

RESULT_FILES = {
    "history": "history.txt",
    "energy": "energy.txt",
    "motion": "motion.txt",
    "static": "static.txt",
    "modes": "modes.txt",
    "frequency_response": "frequency_response.txt",
}
INNER = "vtk"  # folder of files that show the results
EVENTS = "events.txt"  # words beside numbers: not one of the tables above
TABLES = {"csv": ".csv", "parquet": ".parquet", "matlab": ".mat", "hdf5": ".h5"}  # suffix of each format of a table


class BielaError(Exception):
    """Whatever goes wrong, in few lines."""


class HistoryError(BielaError):
    """A results file that is missing or damaged, or a column that it does not have."""


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Make the folder of a file that is written within this context; HistoryError where that is not allowed."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield
    except OSError as fault:
        raise HistoryError(f"{path}: cannot be written ({fault.strerror or fault})") from None


def note(*paths: Path) -> None:
    """Note files that show results, beside them or in the folder `vtk` there, in `.drawn`: the next run removes them; OSError."""
    folder = paths[0].parent.parent if paths[0].parent.name == INNER else paths[0].parent
    if not any((folder / name).is_file() for name in ("summary.json", "journal.jsonl")):
        return
    notes = folder / ".drawn"
    known = notes.read_text(encoding="utf-8", errors="replace").split("\n") if notes.is_file() else []
    new = sorted({path.relative_to(folder).as_posix() for path in paths} - {*known})
    handle = os.open(notes, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW, 0o666)
    with os.fdopen(handle, "a", encoding="utf-8") as file:
        file.writelines(name + "\n" for name in new)


def remove_noted(folder: Path) -> None:
    """Remove the files that `note` has noted in a folder, as the solver does before a run; OSError where that is not allowed."""
    notes = folder / ".drawn"
    if not notes.is_file():
        return
    for name in notes.read_text(encoding="utf-8", errors="replace").split("\n"):
        if name and "/" not in name.removeprefix(f"{INNER}/") and (folder / name).is_file():
            (folder / name).unlink()
    notes.unlink()
