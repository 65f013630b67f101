"""The one reader of biela's results and of comma-separated tables; each fault is a `HistoryError` of one line, the file first."""

from __future__ import annotations

import contextlib
import csv
import fnmatch
import functools
import itertools
import json
import re
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, NoReturn

import numpy as np

from .result_files import EVENTS, RESULT_FILES, HistoryError

if TYPE_CHECKING:
    import pandas

HEADER = "# columns:"
LARGE = 20_000_000  # bytes beyond which pandas reads a table: it is faster, but takes long to load
WHOLE = 1.0e-9  # of a turn, by which the end of a whole one may err
COLUMN = re.compile(r"(?P<name>[^\[\]]+)(?:\[(?P<unit>[^\[\]]*)\])?")


@dataclass(frozen=True)
class History:
    """Columns of numbers against time."""

    path: Path  # the file they come from
    names: list[str]  # column names; the first is the independent one, `t` in every file of a transient
    units: dict[str, str]  # unit of each name, '' where the file states none
    data: np.ndarray  # array of shape (rows, columns), in the columns' units; a column's values lie side by side

    @property
    def time(self) -> np.ndarray:
        """The first column, shape (rows,) [s]."""
        return self.data[:, 0]

    def __contains__(self, name: str) -> bool:
        return name in self.names

    def __getitem__(self, name: str) -> np.ndarray:
        """Return one column, shape (rows,); HistoryError with the nearest names where there is none of that name."""
        if name not in self.names:
            raise HistoryError(f"{self.path}: no column {name!r}; {self._known_columns()}")
        return self.data[:, self.names.index(name)]

    @functools.cached_property
    def ends(self) -> dict[str, tuple[float, float]]:
        """Least and largest value of each column."""
        low, high = self.data.min(axis=0), self.data.max(axis=0)
        return {name: (float(low[k]), float(high[k])) for k, name in enumerate(self.names)}

    def size(self, name: str) -> float:
        """Return the largest size of a column's values."""
        return max(map(abs, self.ends[name]))

    def between(self, start: float, end: float) -> History:
        """Return the rows from one value of the first column to another, both included; HistoryError where there are none."""
        rows = (self.time >= start) & (self.time <= end)
        if not rows.any():
            raise HistoryError(f"{self.path}: no row from {start:g} to {end:g}")
        return self if rows.all() else History(self.path, self.names, self.units, np.asfortranarray(self.data[rows]))

    def turns(self, angle: str, first: int, last: int) -> History:
        """Return the rows of whole turns of an angle [rad], 1 the first, -1 the last, both ends by a spline; HistoryError."""
        from scipy.interpolate import CubicSpline

        turned = np.abs(self[angle] - self[angle][0]) / (2.0 * np.pi)
        whole = int(turned[-1] + WHOLE)
        begin, end = (number - 1 if number > 0 else whole + number for number in (first, last))
        if np.any(np.diff(turned) <= 0.0):
            raise HistoryError(f"{self.path}: {angle} does not turn one way throughout, as turns need")
        if not 0 <= begin <= end < whole:
            raise HistoryError(f"{self.path}: turns {first} to {last} of {angle}: it has {whole} whole ones")
        ends = CubicSpline(turned, self.time)([begin, min(end + 1, turned[-1])])
        inside = (turned > begin + WHOLE) & (turned < end + 1 - WHOLE)
        edges = CubicSpline(self.time, self.data)(ends)
        data = np.concatenate([edges[:1], self.data[inside], edges[1:]])
        return History(self.path, self.names, self.units, np.asfortranarray(data))

    def label(self, name: str) -> str:
        """Return the name with its unit in brackets, as axes show it."""
        unit = self.units[name]
        return f"{name} [{unit}]" if unit else name

    def to_dataframe(self) -> pandas.DataFrame:
        """Return a pandas table with the units in the columns' names, as `mid.v_[m]`; HistoryError where pandas is missing."""
        try:
            import pandas
        except ImportError:
            raise HistoryError("the library pandas is missing: pip install 'biela[tables]'") from None
        return pandas.DataFrame(self.data, columns=self.columns())

    def columns(self) -> list[str]:
        """Return the columns' names with their units, as `mid.v_[m]`."""
        return [f"{name}_[{self.units[name]}]" if self.units[name] else name for name in self.names]

    def match(self, patterns: list[str] | None = None) -> list[str]:
        """Return the names that shell patterns select, in file order; without patterns all but the first; HistoryError: none."""
        if not patterns:
            return self.names[1:]
        found = {pattern: fnmatch.filter(self.names, pattern) for pattern in patterns}
        for pattern in (pattern for pattern, names in found.items() if not names):
            raise HistoryError(f"{self.path}: no column matches {pattern!r}; {self._known_columns()}")
        return [name for name in self.names if any(name in names for names in found.values())]

    def _known_columns(self) -> str:
        shown = ", ".join(self.names[:12])
        return f"it has {shown}" + (f" and {len(self.names) - 12} more" if len(self.names) > 12 else "")


def read(source: str | Path, kind: str = "history") -> History:
    """Read a results file, a table (`.csv`), or the file of a kind ('history', 'energy', ...) in a results folder; HistoryError."""
    path = Path(source)
    if path.is_dir():
        path = path / RESULT_FILES[kind]
    separator = "," if path.suffix == ".csv" else None
    try:
        head = _head(path, separator)
        columns = _header(path, head, separator)
        names = [name for name, _ in columns]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise HistoryError(f"{path}: the column {twice[0]!r} is given twice")
        data = np.asfortranarray(_rows(path, len(head), len(names), separator))
    except FileNotFoundError:
        raise HistoryError(f"{path}: no such file ({_why_missing(path)})") from None
    except OSError as fault:
        raise HistoryError(f"{path}: cannot be read as text ({fault})") from None
    except MemoryError:
        raise HistoryError(f"{path}: is larger than the memory") from None
    back = np.flatnonzero(np.diff(data[:, 0]) <= 0.0)
    if back.size:
        raise HistoryError(f"{path}: {names[0]} does not increase after row {back[0] + 1} ({names[0]} = {data[back[0], 0]:g})")
    return History(path, names, dict(columns), data)


def _head(path: Path, separator: str | None) -> list[str]:
    """Return the lines of a file before its rows."""
    with path.open("rb") as file:
        lines = itertools.islice(file, 1) if separator else itertools.takewhile(lambda one: one.startswith(b"#"), file)
        return [line.decode("utf-8-sig", "replace").rstrip("\r\n") for line in lines]


class Event(NamedTuple):
    """A line of events.txt: time [s], element, its states before and after, speed at touching [m/s] or [rad/s], else 0."""

    time: float
    element: str
    before: str
    after: str
    speed: float


def read_events(folder: str | Path) -> list[Event]:
    """Read the events of a run; a scene in which nothing switches leaves no such file, and has none; HistoryError: damaged."""
    path, events = Path(folder) / EVENTS, []
    try:
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines() if path.exists() else []
    except OSError as fault:
        raise HistoryError(f"{path}: cannot be read as text ({fault})") from None
    for number, line in enumerate(lines, 1):
        words = line.split()
        if not words or line.startswith("#"):
            continue
        if len(words) != 5 or not (_finite(words[0]) and _finite(words[4])):
            raise HistoryError(f"{path}:{number}: is no event: time, element, states before and after, speed expected")
        events.append(Event(float(words[0]), *words[1:4], float(words[4])))
    return events


def common_still(runs: list[History]) -> dict[str, float] | None:
    """Return the columns of `still_columns` that stand still at one value in all runs; none where a run has no such list."""
    try:
        if not all(run.path.name == RESULT_FILES["history"] for run in runs):
            return None
        found = [still_columns(read_summary(run.path.parent)) for run in runs]
    except HistoryError:
        return None
    if None in found:
        return None
    return {name: value for name, value in found[0].items() if all(one.get(name) == value for one in found)}


def still_columns(figures: dict) -> dict[str, float] | None:
    """Return the columns that rounding alone moves, with their values, as summary.json says; None: no transient came to an end."""
    if figures.get("status") is None or "reached" not in figures.get("transient", {}):
        return None
    return {name.partition("[")[0]: value for name, value in figures["transient"].get("still_columns", {}).items()}


class MissingFigureError(HistoryError, KeyError):
    """A summary does not have what the solver writes."""

    __str__ = HistoryError.__str__


class _Figures(dict):
    def __missing__(self, name: str) -> NoReturn:
        raise MissingFigureError(f"summary.json has no {name!r} where the solver writes it: damaged, or of another version")


def read_summary(folder: str | Path) -> dict:
    """Read summary.json of a results folder (input/README.md says what it means); HistoryError where it is missing or damaged."""
    path = Path(folder) / "summary.json"
    try:
        found = json.loads(path.read_text(encoding="utf-8", errors="replace"), object_hook=_Figures)
    except FileNotFoundError:
        raise HistoryError(f"{path}: no such file (has the run been made?)") from None
    except (OSError, ValueError) as fault:
        raise HistoryError(f"{path}: cannot be read ({fault})") from None
    if not isinstance(found, dict):
        raise HistoryError(f"{path}: cannot be read (no JSON object)")
    return found


def _why_missing(path: Path) -> str:
    """Return what may be the reason why a results file is not there, from what else its folder holds."""
    others = [name for name in RESULT_FILES.values() if (path.parent / name).is_file()]
    if path.suffix == ".csv":
        return "a table with names on its first line is expected there"
    if path.name not in RESULT_FILES.values() or not others:
        return "has the run been made?"
    if path.name == "motion.txt" and "history.txt" in others:
        return "it is written where the deck's &transient has a motion_step"
    return f"this run wrote {' and '.join(others)}"


def _header(path: Path, lines: list[str], separator: str | None) -> list[tuple[str, str]]:
    """Return name and unit of each column, from the lines before the rows."""
    heads = [line[len(HEADER) :] for line in lines if line.startswith(HEADER)]
    words = "".join(lines).split(separator) if separator else "".join(heads[-1:]).split()
    if not any(words):
        wanted = "names on its first line" if separator else f"a line {HEADER!r}"
        raise HistoryError(f"{path}: is no history: {wanted} expected")
    columns = []
    for word in words:
        parts = COLUMN.fullmatch(word.strip())
        if not parts:
            raise HistoryError(f"{path}: {word.strip()!r} is no column name, name[unit] expected")
        exported = separator and parts["unit"] is not None  # name_[unit], as `columns` writes it
        columns.append((parts["name"].removesuffix("_") if exported else parts["name"], parts["unit"] or ""))
    return columns


def _rows(path: Path, first: int, width: int, separator: str | None) -> np.ndarray:
    """Return the numbers after the first lines, shape (rows, width); where they cannot be read, name the faulty line."""
    with contextlib.suppress(ValueError), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a file without rows is named below
        data = _numbers(path, first, separator)
        if data.shape[1] == width and np.isfinite(data).all() and data.size:
            return data
    rows = 0
    with path.open(encoding="utf-8", errors="replace") as file:
        for number, line in enumerate(itertools.islice(file, first, None), first + 1):
            words = line.strip().split(separator) if line.strip() else []
            rows += bool(words)
            if words and len(words) != width:
                raise HistoryError(f"{path}:{number}: {len(words)} values, {width} expected (is the file complete?)")
            for word in words:
                if not _finite(word):
                    raise HistoryError(f"{path}:{number}: {word.strip()!r} is no finite number")
    wanted = f"cannot be read as rows of {width} numbers" if rows else "holds no rows (was the run interrupted at its start?)"
    raise HistoryError(f"{path}: {wanted}")


def _numbers(path: Path, first: int, separator: str | None) -> np.ndarray:
    """Return the numbers after the first lines, of a large file by pandas where it is installed; ValueError."""
    if path.stat().st_size > LARGE:
        with contextlib.suppress(ImportError):
            from pandas import read_csv

            form = dict(header=None, dtype=float, na_filter=False, quoting=csv.QUOTE_NONE, skiprows=first)
            return read_csv(path, sep=separator or r"\s+", **form).to_numpy()
    return np.loadtxt(path, delimiter=separator, ndmin=2, comments=None, skiprows=first, encoding="utf-8")


def _finite(word: str) -> bool:
    try:
        return bool(np.isfinite(float(word)))
    except ValueError:
        return False
