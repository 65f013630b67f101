"""Single numbers of a run: what a sweep puts into its table."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

FILES = {"history": "history.txt", "energy": "energy.txt", "modes": "modes.txt", "static": "static.txt"}
FILES["frequency_response"] = "frequency_response.txt"
MINUS = ord("-")
# of the 24 letters of b' -1.2345678901234567E-003': weights that give the first nine digits, the other eight, the exponent, each
# an exact number; the letter of a digit is 48 more than the digit
WEIGHTS = np.zeros((24, 3))
WEIGHTS[[1, *range(3, 11)], 0] = 10.0 ** np.arange(8, -1, -1)
WEIGHTS[range(11, 19), 1] = 10.0 ** np.arange(7, -1, -1)
WEIGHTS[[21, 22, 23], 2] = [100.0, 10.0, 1.0]
LETTERS = ord("0") * WEIGHTS.sum(axis=0)
POWERS = np.array([float(f"1e{k}") for k in range(-324, 309)])
HEAD = re.compile(rb"(?:#.*\n)*")
MEASURES = ("peak", "rms", "range", "min", "max", "mean", "final", "value")
MEASURES += ("decay_rate", "settling_time", "spectral_peak", "summary")


@dataclass(frozen=True)
class Scalar:
    """A number that is measured of each run.

    Attributes:
        name: column of the table
        measure: peak (largest size), rms, range, min, max, mean, final, value (interpolated at `at`), decay_rate (of the peaks'
            envelope [1/s]), settling_time (after which it stays within `band` of its range about its last value [s]), spectral_peak
            (frequency of the largest amplitude [Hz]), or summary (a figure of summary.json named by `key`)
        column: of the file
        file: history, energy, static, modes or frequency_response
        at: time, load or frequency of `value`
        band: of `settling_time`, in parts of the range
        start: rows before this time do not count [s]
        key: of `summary`, parts separated by dots
    """

    name: str
    measure: str
    column: str = ""
    file: str = "history"
    at: float = 0.0
    band: float = 0.02
    start: float = -np.inf
    key: str = ""

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name.isidentifier():
            raise ValueError(f"name = {self.name!r}: a word of letters, digits and _ expected")
        if self.measure not in MEASURES:
            raise ValueError(f"measure = {self.measure!r}: one of {', '.join(MEASURES)} expected")
        if self.file not in [*FILES]:  # a list has no hash
            raise ValueError(f"file = {self.file!r}: one of {', '.join(FILES)} expected")
        if self.measure == "summary" and not (self.key and isinstance(self.key, str)):
            raise ValueError("measure = 'summary' needs key = 'a.figure.of.summary.json'")
        if self.measure != "summary" and not (self.column and isinstance(self.column, str)):
            raise ValueError(f"measure = {self.measure!r} needs a column")
        for word, value in (("at", self.at), ("band", self.band), ("from", self.start)):
            if not isinstance(value, (int, float)):
                raise ValueError(f"{word} = {value!r}: a number expected")

    def unit(self, of_column: str, of_axis: str) -> str:
        """Return the unit of the number, from those of its column and of the file's first column."""
        if self.measure == "settling_time":
            return of_axis
        return {"decay_rate": f"1/{of_axis}", "spectral_peak": "Hz", "summary": ""}.get(self.measure, of_column)

    def of(self, axis: np.ndarray, values: np.ndarray) -> float:
        """Return the number of a column; NaN where the column has none.

        Args:
            axis: the file's first column, ascending
            values: the column
        """
        axis, values = axis[axis >= self.start], values[axis >= self.start]
        if not values.size:
            return np.nan
        simple = {
            "peak": lambda: np.abs(values).max(),
            "rms": lambda: np.sqrt(np.trapezoid(values**2, axis) / np.ptp(axis)) if np.ptp(axis) else abs(values[0]),
            "range": lambda: np.ptp(values),
            "min": values.min,
            "max": values.max,
            "mean": lambda: np.trapezoid(values, axis) / np.ptp(axis) if np.ptp(axis) else values[0],
            "final": lambda: values[-1],
            "value": lambda: np.interp(self.at, axis, values) if axis[0] <= self.at <= axis[-1] else np.nan,
            "decay_rate": lambda: decay_rate(axis, values),
            "settling_time": lambda: settling_time(axis, values, self.band),
            "spectral_peak": lambda: spectral_peak(axis, values),
        }
        return float(simple[self.measure]())


def decay_rate(time: np.ndarray, values: np.ndarray) -> float:
    """Return the rate at which the peaks about the mean decay: minus the slope of the logarithm of their sizes [1/s].

    NaN where there are fewer than three peaks.
    """
    size = np.abs(values - values.mean())
    inner = np.flatnonzero((size[1:-1] >= size[:-2]) & (size[1:-1] > size[2:])) + 1
    inner = inner[size[inner] > 0.0]
    if inner.size < 3:
        return np.nan
    return float(-np.polyfit(time[inner], np.log(size[inner]), 1)[0])


def settling_time(time: np.ndarray, values: np.ndarray, band: float) -> float:
    """Return the time after which values stay within `band` of their range about the last one [s]."""
    outside = np.flatnonzero(np.abs(values - values[-1]) > band * np.ptp(values))
    return float(time[outside[-1]]) if outside.size else float(time[0])


def spectral_peak(time: np.ndarray, values: np.ndarray) -> float:
    """Return the frequency of the largest amplitude, mean and trend removed, evenly resampled, Hann window [Hz]."""
    if values.size < 8 or np.ptp(values) == 0.0:
        return np.nan
    even = np.linspace(time[0], time[-1], values.size)
    signal = np.interp(even, time, values)
    signal = signal - np.polyval(np.polyfit(even, signal, 1), even)
    size = np.abs(np.fft.rfft(signal * np.hanning(signal.size)))
    k = int(np.argmax(size[1:])) + 1
    shift = 0.0
    if k + 1 < size.size and size[k - 1] > 0.0 and size[k + 1] > 0.0:  # the parabola through three logarithms
        a, b, c = np.log(size[k - 1 : k + 2])
        shift = 0.5 * (a - c) / (a - 2.0 * b + c)
    return float((k + shift) / (signal.size * (even[1] - even[0])))


def measure(folder: Path, scalars: tuple[Scalar, ...]) -> tuple[list[float], list[str]]:
    """Return the numbers of a run and their units; ValueError where a file or column is missing."""
    wanted: dict[str, set[str]] = {}
    for scalar in scalars:
        if scalar.measure != "summary":
            wanted.setdefault(scalar.file, set()).add(scalar.column)
    tables = {}
    for file, columns in wanted.items():
        path = folder / FILES[file]
        tables[file] = _read_columns(path, columns)
    values, units = [], []
    for scalar in scalars:
        if scalar.measure == "summary":
            values.append(_summary_figure(folder, scalar.key))
            units.append("")
            continue
        columns, known, axis, axis_unit = tables[scalar.file]
        values.append(scalar.of(axis, columns[scalar.column]))
        units.append(scalar.unit(known[scalar.column], axis_unit))
    return values, units


def _read_columns(path: Path, wanted: set[str]) -> tuple[dict[str, np.ndarray], dict[str, str], np.ndarray, str]:
    """Return columns of a results file by name, all units, the first column and its unit; ValueError where one is missing.

    The solver writes numbers of one width, so that only the columns that are wanted have to be turned into numbers: text to
    numbers is the dearest thing that a sweep does besides the run itself.
    """
    try:
        text = path.read_bytes()
    except OSError as fault:
        raise ValueError(f"{path.name}: {fault.strerror}") from None
    first = HEAD.match(text).end()
    head = text.rfind(b"# columns:", 0, first)
    words = [word.partition("[") for word in text[head:first].decode().partition(":")[2].split()]
    names, units = [word[0] for word in words], [word[2].rstrip("]") for word in words]
    missing = sorted(wanted - set(names))
    if missing:
        raise ValueError(f"{path.name} has no column {missing[0]!r}; it has {', '.join(names[:12])}")
    picked = sorted({0, *(names.index(column) for column in wanted)})
    line = text.find(b"\n", first) - first
    width = line // max(len(names), 1)
    if width <= 0 or line != width * len(names) or (len(text) - first) % (line + 1):
        raise ValueError(f"{path.name} is not complete")
    rows = np.frombuffer(text, np.dtype([("words", f"S{width}", (len(names),)), ("end", "S1")]), offset=first)
    values = _numbers(rows["words"][:, picked])
    return {names[k]: values[:, j] for j, k in enumerate(picked)}, dict(zip(names, units)), values[:, 0], units[0]


def _numbers(words: np.ndarray) -> np.ndarray:
    """Return what words such as b' -1.2345678901234567E-003' say, to an ulp or two, a tenth of the time of float() of each."""
    letters = np.ascontiguousarray(words).view(np.uint8).reshape(words.size, -1)[:, -24:]
    high, low, power = (letters.astype(float) @ WEIGHTS - LETTERS).T
    power = np.where(letters[:, 20] == MINUS, -power, power).astype(int)
    size = np.where(letters[:, 0] == MINUS, -1.0, 1.0) * (1.0e8 * high + low)
    return (size * 1.0e-16 * POWERS[power + 324]).reshape(words.shape)


def _summary_figure(folder: Path, key: str) -> float:
    """Return a figure of summary.json by its path of keys."""
    try:
        found = json.loads((folder / "summary.json").read_text(encoding="utf-8", errors="replace"))
        for part in key.split("."):
            found = found[int(part)] if isinstance(found, list) else found[part]
        return float(found)
    except (OSError, KeyError, IndexError, TypeError, ValueError):
        raise ValueError(f"summary.json has no figure {key!r}") from None
