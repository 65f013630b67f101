"""Single numbers of a run: what a sweep puts into its table."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from . import fatigue
from .decays import KNOWN, ring_down
from .histories import History, read, read_summary
from .result_files import RESULT_FILES, HistoryError
from .units import factor

FILES = [file for file in RESULT_FILES if file != "motion"]
MEASURES = ("peak", "rms", "range", "min", "max", "mean", "final", "value")
MEASURES += ("decay_rate", "settling_time", "spectral_peak", "order", "damage", "misfit", "mass", "summary")
OF_MODE = ("frequency", "damping_ratio")
FURTHER = 6  # vibrations that are looked at besides twice as many as a mode's number
MEASURES += OF_MODE
LARGEST = ("peak", "max", "min")  # the measures that are the largest of several extremes
EXTREMES = 6  # of a column that are listed, the largest first
ROUNDING = 1.0e-12  # of a number that no step in time has made
BETWEEN_ROWS = ("peak", "min", "max", "range", "value")
HALF_THE_ROWS = 1.0 / 32.0  # error of a polynomial of degree five or six with all rows, in parts of that with every second row
OF_A_QUARTER = 1.0 / 256.0  # error of a rule of order four, in parts of what a quarter of the rows lacks of half of them
EDGE = 1.0e-9  # of what the rows span, by which their ends may err
FINER = 4  # samples of a spline in a row, for its orders
NEIGHBOURS = 3  # rows on either side of an extreme, which its polynomial passes through
OF_COLUMN = {"peak": 1.0, "min": 1.0, "max": 1.0, "mean": 1.0, "final": 1.0, "value": 1.0, "rms": 1.0, "range": 2.0}


@dataclass(frozen=True)
class Scalar:
    """A number that is measured of each run."""

    name: str  # column of the table
    measure: str  # what it is, one of MEASURES (post/README.md); NaN where it has none
    column: str = ""  # of the file; of a response that was measured the sensor's, without .amplitude and .phase
    file: str = "history"  # history, energy, static, modes or frequency_response
    at: float = 0.0  # time, load or frequency of `value`
    target: float | None = None  # of `settling_time` [unit of the column]; None: the last value
    band: float = 0.02  # of `settling_time`, on either side of the target, in parts of the column's range [-]
    within: float = 0.0  # in place of `band` [unit of the column]
    start: float = -np.inf  # rows before this time do not count [s]
    end: float = np.inf  # rows after this time do not count [s]
    period: float | str = 0.0  # whole ones count: its length [s], or a column with an angle [rad], a turn of which is one; 0: none
    periods: int = 0  # how many, the last ones; 0: all that the rows hold
    order: float = 0.0  # of `order`: how often it vibrates in a period; without a period all rows are one
    reference: float = 0.0  # of `rms` and `order`, that are levels in dB then: 20 lg(rms/reference) [unit of the column]
    strength: float = 0.0  # of `damage`: amplitude that the material bears `cycles` times [unit of the column]
    cycles: float = 2.0e6  # of `strength`
    slope: float = 0.0  # of the line of `strength`: the cycles borne fall with this power of the amplitude
    ultimate: float = np.inf  # of `damage`: amplitudes over 1 - mean/ultimate count (Goodman) [unit of the column]
    measured: tuple[tuple[float, ...], ...] = ()  # times or frequencies and values, of a response real and imaginary parts
    measured_units: tuple[str, ...] = ()  # of times or frequencies, and of values; '': not stated, so that of the column
    error: float = 0.0  # standard error of what was measured [unit of the column]; 0: not known
    key: str = ""  # of `summary`, parts separated by dots
    stated_unit: str = ""  # of `summary`, whose figures have none
    mode: int = 0  # number of a vibration, 1 the lowest: among the damped ones where there are such
    shape: tuple[float, ...] = ()  # of that in the study's deck, real and imaginary parts of displacements in turn [m]

    def __post_init__(self) -> None:
        def need(good: object, words: str) -> None:
            if not good:
                raise ValueError(words)

        names = isinstance(self.column, str)
        named = isinstance(self.name, str) and self.name.isidentifier()
        need(named, f"name = {self.name!r}: a word of letters, digits and _ expected")
        need(self.measure in MEASURES, f"measure = {self.measure!r}: one of {', '.join(MEASURES)} expected")
        need(self.file in FILES, f"file = {self.file!r}: one of {', '.join(FILES)} expected")
        if self.measure == "summary":
            need(self.key and isinstance(self.key, str), "measure = 'summary' needs key = 'a.figure.of.summary.json'")
            wanted = "measure = 'frequency' or 'damping_ratio' with mode = N expected"
            need(not self.key.startswith("modes.poles."), f"key = {self.key!r}: poles have no fixed places; {wanted}")
        of_mode = self.measure not in OF_MODE or (type(self.mode) is int and self.mode > 0)
        need(of_mode, f"measure = {self.measure!r} needs mode = N, the number of a vibration, 1 or more")
        need(self.measure != "mass" or names, f"column = {self.column!r}: the name of a body expected")
        need(self.of_summary or self.mode or (self.column and names), f"measure = {self.measure!r} needs a column")
        numbers = {"at": self.at, "from": self.start, "to": self.end, "target": self.target or 0.0}
        above = ("band", "within", "periods", "order", "reference", "error", "strength", "cycles", "slope", "ultimate", "period")
        numbers |= {word: getattr(self, word) for word in above if word != "period" or not isinstance(self.period, str)}
        for word, value in numbers.items():
            good = type(value) in (int, float) and (word not in above or value >= 0.0)
            need(good, f"{word} = {value!r}: a number expected" + (", 0 or more" if word in above else ""))
        owners = {"reference": ("rms", "order"), "order": ("order",), "strength": ("damage",), "within": ("settling_time",)}
        for word, measures in (owners | {"measured": ("misfit",), "error": ("misfit",)}).items():
            told = "data" if word == "measured" else word
            good = not getattr(self, word) or self.measure in measures
            need(good, f"{told} belongs to measure = {' or '.join(map(repr, measures))}")
        for measure, words in (("order", ("order",)), ("damage", ("strength", "cycles", "slope"))):
            good = self.measure != measure or all(getattr(self, word) for word in words)
            need(good, f"measure = {measure!r} needs {', '.join(words)}")
        need(type(self.periods) is int, f"periods = {self.periods!r}: a whole number expected")
        need(self.measure != "misfit" or self.measured, "measure = 'misfit' needs data = 'FILE.csv', what was measured")

    @property
    def of_summary(self) -> bool:
        """Whether it is a figure of summary.json, not of a table."""
        return self.measure in ("summary", "mass")

    @property
    def path(self) -> str:
        """The position of its figures in summary.json."""
        return self.key or "scene.bodies." + (f"{self.column}." if self.column else "*.") + "mass"

    @property
    def columns(self) -> set[str]:
        """The columns of its file that it needs."""
        parts = (".amplitude", ".phase") if len(self.measured) == 3 else ("",)
        return {self.column + part for part in parts} | ({self.period} if isinstance(self.period, str) else set())

    def unit(self, of_column: str, of_axis: str) -> str:
        """Return the unit of the number, from those of its column and of the file's first column."""
        if self.reference:
            return f"dB re {self.reference:g} {of_column}".rstrip()
        named = {"settling_time": of_axis, "decay_rate": f"1/{of_axis}", "spectral_peak": "Hz", "frequency": "Hz"}
        named |= dict.fromkeys(("damping_ratio", "summary", "damage"), "")
        return named.get(self.measure, of_column)

    def rows(self, axis: np.ndarray, values: np.ndarray, angle: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return axis and column of the rows that count; angle: of `period` [rad]; ValueError: too few periods."""
        inside = (axis >= self.start) & (axis <= self.end)
        axis, values = axis[inside], values[inside]
        if not values.size:
            raise ValueError(f"no row from {self.start:g} to {self.end:g}")
        if not self.period:
            return axis, values
        first = first_of_whole(axis / self.period if angle is None else angle[inside] / (2.0 * np.pi), axis, self.periods)
        later = axis > first + EDGE * np.ptp(axis)
        return np.append(first, axis[later]), np.append(interpolated(axis, values, first), values[later])

    def of(self, axis: np.ndarray, values: np.ndarray, angle: np.ndarray | None = None) -> float:
        """Return the number of a column, NaN where it has none; ValueError: no whole period, or not all that was measured."""
        if self.measure == "misfit":
            return float(np.sqrt(np.mean(np.square(self.differences(axis, values)))))
        all_rows = axis
        axis, values = self.rows(axis, values, angle)
        if self.measure == "order":
            turn = axis / (self.period or np.ptp(axis)) if angle is None else np.interp(axis, all_rows, angle) / (2.0 * np.pi)
            places, sizes = orders(turn, values)
            k = int(np.argmin(np.abs(places - self.order)))
            if abs(places[k] - self.order) > 1.0e-6:
                raise ValueError(f"order = {self.order:g} is none of {np.ptp(turn):.3g} periods of {values.size} rows")
            return self._level(sizes[k], np.sqrt(2.0))
        simple = {
            "peak": lambda: self.extremes(axis, values)[0][1],
            "rms": lambda: self._level(averages(axis, values, self.measure)[0]),
            "range": lambda: maxima(axis, values)[0][1] + maxima(axis, -values)[0][1],
            "min": lambda: self.extremes(axis, values)[0][1],
            "max": lambda: self.extremes(axis, values)[0][1],
            "mean": lambda: averages(axis, values, self.measure)[0],
            "final": lambda: values[-1],
            "value": lambda: interpolated(axis, values, self.at) if axis[0] <= self.at <= axis[-1] else np.nan,
            "decay_rate": lambda: decay_rate(axis, values),
            "settling_time": lambda: settling_time(axis, values, self.target, self.within or self.band * np.ptp(values)),
            "spectral_peak": lambda: spectral_peak(axis, values),
            "damage": lambda: fatigue.damage(fatigue.repeating(values), self.strength, self.cycles, self.slope, self.ultimate),
        }
        return float(simple[self.measure]())

    def _level(self, size: float, of_rms: float = 1.0) -> float:
        """Return the size, or in dB the level of the rms value, which is the size over `of_rms`."""
        return float(20.0 * np.log10(size / of_rms / self.reference) if size > 0.0 else -np.inf) if self.reference else float(size)

    def in_units(self, of_axis: str, of_column: str) -> Scalar:
        """Return it with what was measured in the units of a run; ValueError: they do not go together."""
        pairs = list(zip(self.measured_units, (of_axis, of_column)))
        try:
            scale = [factor(unit, wanted) if unit and wanted else 1.0 for unit, wanted in pairs]
        except HistoryError as fault:
            raise ValueError(f"what was measured of {self.column}: {fault}") from None
        if set(scale) <= {1.0}:
            return self
        parts = [tuple(np.multiply(part, scale[min(k, 1)])) for k, part in enumerate(self.measured)]
        return replace(self, measured=tuple(parts), measured_units=(of_axis, of_column))

    def differences(self, axis: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Return a column, by a cubic spline, less what was measured, of a response both parts; ValueError: too short."""
        at, *parts = map(np.array, self.measured)
        inside = (at >= self.start) & (at <= self.end)
        at = at[inside]
        if not at.size or at[0] < axis[0] - EDGE * np.ptp(axis) or at[-1] > axis[-1] + EDGE * np.ptp(axis):
            raise ValueError(f"{self.column} runs from {axis[0]:g} to {axis[-1]:g}, which is not where it was measured")
        from scipy.interpolate import CubicSpline

        found = CubicSpline(axis, values)(at)
        own = (found.real, found.imag)[: len(parts)]
        return np.concatenate([one - part[inside] for one, part in zip(own, parts)])

    def extremes(self, axis: np.ndarray, values: np.ndarray, angle: np.ndarray | None = None) -> list[tuple[float, float]]:
        """Return position and value of the extremes from which the number is taken, the deciding one first: each is smooth."""
        axis, values = self.rows(axis, values, angle)
        if self.measure == "peak":
            return sorted(maxima(axis, values) + maxima(axis, -values), key=lambda one: -one[1])[:EXTREMES]
        return [(at, -value) for at, value in maxima(axis, -values)] if self.measure == "min" else maxima(axis, values)


def averages(axis: np.ndarray, values: np.ndarray, kind: str) -> tuple[float, float]:
    """Return the mean or the rms value of a column and what its rows leave open of it.

    The trapezoidal rule or a cubic spline, whichever errs less by what it gives with half and with a quarter of the rows.
    """
    from scipy.interpolate import CubicSpline

    span, squared = np.ptp(axis), kind == "rms"
    if not span:
        return float(abs(values[0]) if squared else values[0]), 0.0
    known = values**2 if squared else values
    found = []
    for rule in (np.trapezoid, lambda y, x: CubicSpline(x, y).integrate(x[0], x[-1])):
        kept = [np.unique([*range(0, axis.size, step), axis.size - 1]) for step in (1, 2, 4)]
        full, half, quarter = (float(rule(known[rows], axis[rows])) / span for rows in kept)
        last, before = abs(full - half), abs(half - quarter)
        found.append((max(last * min(1.0, last / (before - last)) if before > last else last, before * OF_A_QUARTER), full))
    error, full = min(found)
    if not squared:
        return full, error
    size = np.sqrt(max(full, 0.0))
    return float(size), float(min(np.sqrt(error), 0.5 * error / size) if size else np.sqrt(error))


def maxima(axis: np.ndarray, values: np.ndarray) -> list[tuple[float, float]]:
    """Return position and value of the largest local maxima of a column over its axis, ends included, the largest first."""
    inner = np.flatnonzero((values[1:-1] >= values[:-2]) & (values[1:-1] > values[2:])) + 1
    ends = [k for k, next_to in ((0, 1), (-1, -2)) if values.size < 2 or values[k] >= values[next_to]]
    rows = np.concatenate([inner, np.arange(values.size)[ends]]).astype(int)
    rows = rows[np.argsort(-values[rows], kind="stable")][:EXTREMES]
    return sorted({_summit(axis, values, k) for k in rows}, key=lambda one: -one[1])


def _summit(axis: np.ndarray, values: np.ndarray, k: int) -> tuple[float, float]:
    """Return position and value of the maximum near the row k, by polynomials through neighbours; at ends, corners, jumps its own.

    Where the polynomial through seven rows does not agree with the parabola through three, the parabola counts.
    """
    found = axis[k], values[k]
    rise = 0.0
    if not 0 < k < values.size - 1:
        return float(found[0]), float(found[1])
    for neighbours in (1, NEIGHBOURS):
        near = slice(max(k - neighbours, 0), k + neighbours + 1)
        scale = axis[k + 1] - axis[k - 1]
        law = np.polynomial.Polynomial.fit((axis[near] - axis[k]) / scale, values[near] - values[k], len(axis[near]) - 1)
        inside = law.deriv().roots()
        inside = inside.real[np.abs(inside.imag) < 1.0e-9]
        inside = inside[(inside >= (axis[k - 1] - axis[k]) / scale) & (inside <= (axis[k + 1] - axis[k]) / scale)]
        if not inside.size:
            continue
        best = inside[np.argmax(law(inside))]
        higher = within_rows(axis, values, axis[k] + scale * best, values[k] + law(best)) - values[k]
        if higher > 0.0 and (neighbours == 1 or higher <= 2.0 * rise):
            found, rise = (axis[k] + scale * best, values[k] + higher), higher
    return float(found[0]), float(found[1])


def within_rows(axis: np.ndarray, values: np.ndarray, at: float, found: float) -> float:
    """Return a value found between two rows, kept to what the rows around allow: a polynomial overshoots at corners and jumps.

    Where six rows are curved to one side a smooth column lies between the chord of its neighbours and the lines through the two
    rows on either side; elsewhere it is kept between its neighbours.
    """
    k = int(np.clip(np.searchsorted(axis, at) - 1, 0, values.size - 2))
    near = slice(max(k - 2, 0), k + 4)
    slopes = np.diff(values[near]) / np.diff(axis[near])
    side = np.sign(np.diff(slopes))
    low, high = sorted(values[k : k + 2])
    if side.size and side[0] != 0.0 and (side == side[0]).all():
        ends = [(k, k - 1)] * (k > 0) + [(k + 1, k + 2)] * (k + 2 < values.size)
        lines = [values[a] + (values[b] - values[a]) / (axis[b] - axis[a]) * (at - axis[a]) for a, b in ends]
        chord = np.interp(at, axis[k : k + 2], values[k : k + 2])
        low, high = (chord, max(min(lines), chord)) if side[0] < 0.0 else (min(max(lines), chord), chord)
    return float(np.clip(found, low, high))


def interpolated(axis: np.ndarray, values: np.ndarray, at: float) -> float:
    """Return a column between its rows: the polynomial through the six nearest; at corners and jumps between its neighbours."""
    k = int(np.clip(np.searchsorted(axis, at) - 3, 0, max(values.size - 6, 0)))
    x, y = axis[k : k + 6], values[k : k + 6]
    return within_rows(axis, values, at, np.polynomial.Polynomial.fit(x, y, x.size - 1)(at)) if x.size > 1 else float(y[0])


def first_of_whole(turns: np.ndarray, axis: np.ndarray, count: int) -> float:
    """Return where as many whole periods (0: all) begin as end with the last row; ValueError: fewer, or turns go back."""
    there = int(abs(turns[-1] - turns[0]) * (1.0 + EDGE) + EDGE)
    if there < max(count, 1):
        raise ValueError(f"{there} whole periods, {max(count, 1)} or more expected")
    way = np.sign(turns[-1] - turns[0])
    if np.any(way * np.diff(turns) <= 0.0):
        raise ValueError("the angle of period = '...' does not turn one way")
    return float(np.interp(0.0, way * (turns - turns[-1]) + (count or there), axis))


def orders(turned: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return orders and their amplitudes over whole turns, from the first row to the last: no window, no trend removed."""
    from scipy.interpolate import make_interp_spline

    along = np.abs(turned - turned[0])
    even = along[-1] * np.arange(FINER * values.size) / (FINER * values.size)
    size = 2.0 * np.abs(np.fft.rfft(make_interp_spline(along, values, k=min(3, values.size - 1))(even))) / even.size
    return np.arange(values.size // 2) / along[-1], size[: values.size // 2]


def decay_rate(time: np.ndarray, values: np.ndarray) -> float:
    """Return the decay of the largest vibration [1/s]; NaN: none, or not known to a tenth, nor is what the run loses by it."""
    try:
        one = ring_down(time, values).vibrations[0]
    except HistoryError:
        return np.nan
    known = one.resolved or one.rate_error * np.ptp(time) <= KNOWN
    return one.rate if known else np.nan


def turning_points(values: np.ndarray, least: float) -> np.ndarray:
    """Return the rows at which values turn by at least so much, both ends left out."""
    found = [0]
    for k in [*np.flatnonzero(np.diff(np.sign(np.diff(values)))) + 1, values.size - 1]:
        if len(found) > 1 and (values[k] - values[found[-1]]) * (values[found[-1]] - values[found[-2]]) >= 0.0:
            found[-1] = k  # on the same way
        elif abs(values[k] - values[found[-1]]) >= least:
            found.append(k)
    return np.array(found[1:-1], dtype=int)


def settling_time(time: np.ndarray, values: np.ndarray, target: float | None, within: float) -> float:
    """Return when values begin to stay that near to the target [s]; NaN where the last one is not.

    Without a target (None) it is the last value; NaN where the last period still swings by more than `within`.
    """
    if target is None and within > 0.0:
        turns = turning_points(values, within)
        if turns.size > 2 and time[-1] - time[turns[-1]] < time[turns[-1]] - time[turns[-3]]:
            return np.nan
    off = np.abs(values - (values[-1] if target is None else target)) - within
    outside = np.flatnonzero(off > 0.0)
    if not outside.size:
        return float(time[0])
    k = outside[-1]
    if k == values.size - 1:
        return np.nan
    return float(time[k] + off[k] / (off[k] - off[k + 1]) * (time[k + 1] - time[k]))


def spectral_peak(time: np.ndarray, values: np.ndarray) -> float:
    """Return the frequency of the largest amplitude, mean and trend removed, evenly resampled, Hann window [Hz]."""
    if values.size < 8 or np.ptp(values) == 0.0:
        return np.nan
    even = np.linspace(time[0], time[-1], values.size)
    signal = np.interp(even, time, values)
    signal = signal - np.polyval(np.polyfit(even, signal, 1), even)
    size = np.abs(np.fft.rfft(signal * np.hanning(signal.size + 1)[:-1]))
    return spectral_line(size, int(np.argmax(size[1:])) + 1)[0] / (signal.size * (even[1] - even[0]))


def spectral_line(size: np.ndarray, k: int) -> tuple[float, float, float]:
    """Return the place of a line beside the peak k of a spectrum by a Hann window, its error, both in its steps, and its amplitude.

    Peak and either neighbour give the place (Grandke, IEEE Trans. Instrum. Meas. 32, 1983). Where both differ the line decays, or
    another one is near: twice that is the error, which holds for 19 of 20 lines that stand two steps or more apart.
    """
    if not 0 < k < size.size - 1:
        return float(k), 0.5, float(size[k])
    low, high = size[k - 1] / size[k], size[k + 1] / size[k]
    below, above = (1.0 - 2.0 * low) / (1.0 + low), (2.0 * high - 1.0) / (1.0 + high)
    shift = (below * low + above * high) / (low + high) if low + high > 0.0 else 0.0
    return float(k + shift), max(2.0 * abs(above - below), 0.01), float(size[k] * (1.0 - shift**2) / np.sinc(shift))


@dataclass(frozen=True)
class Measured:
    """The numbers of a run."""

    values: list[float] = field(default_factory=list)  # of the scalars
    units: list[str] = field(default_factory=list)  # of them
    extremes: list[list[tuple[float, float]]] = field(default_factory=list)  # positions and values, where it is one of several
    errors: list[float] = field(default_factory=list)  # of the values, by the run's own `check_error`, where that was asked for
    differences: list[list[float]] = field(default_factory=list)  # from data, of each misfit, where the extremes were asked for
    modes: list[list] = field(default_factory=list)  # frequency [Hz], damping ratio and shape of vibrations, where one is followed


def measure(folder: Path, scalars: tuple[Scalar, ...], extremes: bool = False, errors: bool = False) -> Measured:
    """Return the numbers of a run; ValueError where a file or column is missing."""
    try:
        return _measure(folder, scalars, extremes, errors)
    except HistoryError as fault:
        raise ValueError(str(fault).removeprefix(f"{folder}/")) from None


def _measure(folder: Path, scalars: tuple[Scalar, ...], extremes: bool, errors: bool) -> Measured:
    tables = {one.file: read(folder, one.file) for one in scalars if not one.of_summary and not one.mode}
    found = Measured()
    if numbers_of_modes := [one.mode for one in scalars if one.mode]:
        found.modes.extend(_modes(folder, 2 * max(numbers_of_modes) + FURTHER))
    for scalar in scalars:
        several: list = []
        if scalar.of_summary or scalar.mode:
            found.values.append(np.nan if scalar.mode else _summary_figure(folder, scalar.path))
            found.units.append("kg" if scalar.measure == "mass" else str(scalar.stated_unit) or scalar.unit("", ""))
        else:
            table = tables[scalar.file]
            axis, angle = table.time, table[scalar.period] if isinstance(scalar.period, str) else None
            if len(scalar.measured) == 3:
                values = table[f"{scalar.column}.amplitude"] * np.exp(1j * table[f"{scalar.column}.phase"])
            else:
                values = table[scalar.column]
                if scalar.measure in fatigue.NEEDS_SIGN:
                    fatigue.refuse_size(table, scalar.column, scalar.measure)
            unit = table.units.get(scalar.column) or table.units.get(f"{scalar.column}.amplitude", "")
            own = scalar.in_units(table.units[table.names[0]], unit)
            found.values.append(own.of(axis, values, angle))
            found.units.append(own.unit(unit, table.units[table.names[0]]))
            if extremes and np.isfinite(found.values[-1]):
                several = own.extremes(axis, values, angle) if scalar.measure in LARGEST else []
                if scalar.measure == "misfit":
                    found.differences.append(own.differences(axis, values).tolist())
        found.extremes.append(several)
    if errors:
        found.errors.extend(_errors(folder, scalars, found.values, tables))
    return found


def _modes(folder: Path, most: int) -> list[list]:
    """Return frequency [Hz], damping ratio and shape (real and imaginary parts in turn, to 1e-4) of the lowest vibrations."""
    table = read(folder, "modes")
    rows, shapes = vibrations(table)
    parts = [np.stack([shape.real, shape.imag], axis=1).ravel() for shape in shapes[:most]]
    shown = [np.round(part / (np.abs(part).max(initial=0.0) or 1.0), 4).tolist() for part in parts]
    return [[float(table["frequency"][row]), float(table["damping_ratio"][row]), part] for row, part in zip(rows, shown)]


def vibrations(table: History) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows of vibrations in a modes file (damped ones where there are), the lowest first, and their displacements."""
    kind = 1 if np.any(table["kind"] == 1) else 0
    rows = np.flatnonzero((table["kind"] == kind) & (table["frequency"] > 0.0))
    names = [name[: -len(".re")] for name in table.names if name.endswith(".re") and table.units[name] == "m"]
    shapes = np.array([table[f"{name}.re"] + 1j * table[f"{name}.im"] for name in names]).T.reshape(len(table.data), -1)
    rows = rows[np.argsort(table["frequency"][rows], kind="stable")]
    return rows, shapes[rows]


def _errors(folder: Path, scalars: tuple[Scalar, ...], values: list[float], tables: dict) -> list[float]:
    """Return the errors of numbers: of columns as estimated, and what is lost between rows, as half of the rows tell.

    Of another number of a run in time: the part of its range that the worst column errs by. Of other analyses: rounding.
    """
    transient = read_summary(folder).get("transient", {})
    columns = {name.partition("[")[0]: error or 0.0 for name, error in transient.get("estimated_errors", {}).items()}
    worst = transient.get("worst_error_of_range") or 0.0
    found = []
    for scalar, value in zip(scalars, values):
        error = 0.0
        if scalar.file == "history" and scalar.measure in OF_COLUMN:
            table = tables[scalar.file]
            axis, angle = table.time, table[scalar.period][::2] if isinstance(scalar.period, str) else None
            half = scalar.of(axis[::2], table[scalar.column][::2], angle) if scalar.measure in BETWEEN_ROWS else value
            smooth = scalar.measure != "range" and value not in np.abs(table[scalar.column]) and value not in table[scalar.column]
            between = abs(half - value) * (HALF_THE_ROWS if smooth else 1.0)
            between = between if np.isfinite(half) else 0.0
            size = 1.0
            if scalar.measure in ("mean", "rms"):
                turned = table[scalar.period] if isinstance(scalar.period, str) else None
                size, between = averages(*scalar.rows(axis, table[scalar.column], turned), scalar.measure)
            error = OF_COLUMN[scalar.measure] * columns.get(scalar.column, 0.0) + between
            if scalar.reference and error:  # a level
                error = 20.0 / np.log(10.0) * error / size if size else np.inf
        elif scalar.file in ("history", "energy") and (not scalar.of_summary or scalar.path.startswith("transient.")):
            error = worst * abs(value)
        found.append(max(error, ROUNDING * abs(value)))
    return found


def _summary_figure(folder: Path, key: str) -> float:
    """Return a figure of summary.json by its path of keys, an item of a list by its position or its name; '*' is the sum of all."""
    try:
        found: list = [read_summary(folder)]
        for part in key.split("."):
            if part == "*":
                found = [item for one in found for item in one]
            elif isinstance(found[0], dict) or part.isdigit():
                found = [one[int(part) if isinstance(one, list) else part] for one in found]
            else:  # of a list of objects with names
                found = [{str(item["name"]).lower(): item for item in one}[part.lower()] for one in found]
        return float(sum(float(one) for one in found))
    except (HistoryError, KeyError, IndexError, TypeError, ValueError):
        raise ValueError(f"summary.json has no figure {key!r}") from None
