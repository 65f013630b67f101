"""Frequencies of a run: amplitudes, power spectral density, waterfall, orders of a drive, decay."""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import matplotlib as mpl
import numpy as np
from matplotlib import mlab
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from . import fatigue, labels
from .decays import LEAST_ROWS, even_samples, ring_down
from .figures import Tabular
from .histories import History, read
from .picture_files import save, subplots
from .plot import COLOURS, LOOK, STYLES, axis_label, pretty_unit
from .result_files import HistoryError
from .sweep_scalars import orders as orders_of
from .sweep_scalars import spectral_line

LEAST_PERIODS = 2  # periods in the run that a peak needs: below, within the window's main lobe, stands what drifts
RESOLVED = 1.0 - 0.5**0.5  # share of its height by which a peak rises above the valley to a higher one: 3 dB; else a shoulder
VISIBLE = 1.0e-3  # share of the largest amplitude below which a frequency does not extend the axis
SMALL = 0.05  # share of the largest peak below which amplitudes are drawn logarithmically
LEAST_ORDER = 1.0e-4  # share of the largest amplitude below which an order is not named


def hann(size: int) -> np.ndarray:
    """Return a Hann window for what repeats itself behind its last row."""
    return np.hanning(size + 1)[:-1]


def amplitudes(axis: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return frequencies (of the axis' unit, 1/axis) and single-sided peak amplitudes, Hann window, trend removed."""
    window = hann(values.size)
    size = 2.0 * np.abs(np.fft.rfft(mlab.detrend_linear(values) * window)) / window.sum()
    size[0] /= 2.0
    return np.fft.rfftfreq(values.size, axis[1] - axis[0]), size


def density(axis: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return frequencies and power spectral density (Welch, eight overlapping Hann windows, trend removed)."""
    length = min(max(LEAST_ROWS, 2 * values.size // 9), values.size)
    how = dict(NFFT=length, Fs=1.0 / (axis[1] - axis[0]), window=hann(length), noverlap=length // 2, detrend="linear")
    power, frequency = mlab.psd(values, **how)
    return frequency, power


def peaks(size: np.ndarray, most: int) -> list[int]:
    """Return the indices of the largest peaks; left out are drifts, shoulders, and peaks below a hundredth of the largest."""
    rows = np.flatnonzero((size[1:-1] > size[:-2]) & (size[1:-1] >= size[2:])) + 1
    rows = rows[(rows >= LEAST_PERIODS) & (size[rows] >= 0.01 * size[1:].max(initial=0.0))]

    def valley(k: int, side: np.ndarray) -> float:
        higher = np.flatnonzero(side > size[k])
        return side[: higher[0] if higher.size else None].min()

    rows = [k for k in rows if max(valley(k, size[:k][::-1]), valley(k, size[k + 1 :])) <= (1.0 - RESOLVED) * size[k]]
    return sorted(sorted(rows, key=lambda k: -size[k])[:most])


def waterfall(axis: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return frequencies, times and amplitudes (frequencies, times) of overlapping windows, a twelfth of the run long."""
    length = max(LEAST_ROWS, values.size // 12)
    how = dict(NFFT=length, window=hann(length), noverlap=length - max(1, length // 8), detrend="linear", mode="magnitude")
    size, frequency, times = mlab.specgram(values, Fs=1.0 / (axis[1] - axis[0]), **how)
    return frequency, axis[0] + times, 2.0 * size


def last_visible(size: np.ndarray) -> int:
    """Return the index up to which a spectrum is drawn: half as far again as where the last of what is no rounding stands."""
    last = int(np.flatnonzero(size >= VISIBLE * size[1:].max())[-1])
    return min(max(3 * last // 2, LEAST_ROWS), size.size - 1)


@dataclass(frozen=True)
class Line:
    """A line of a spectrum: its column, frequency or order with the error of it (0: exact), and amplitude in the column's unit."""

    column: str
    frequency: float
    error: float
    amplitude: float


@dataclass(frozen=True)
class Spectrum(Tabular):
    """What frequencies, or orders of a drive, columns hold."""

    abscissa: str  # 'frequency' or 'order of COLUMN'
    unit: str  # of it: 'Hz' or 'per turn'
    units: dict[str, str]  # of each column
    amplitudes: dict[str, tuple[np.ndarray, np.ndarray]]  # frequencies and amplitudes (Hann window, trend removed) of each column
    densities: dict[str, tuple[np.ndarray, np.ndarray]]  # frequencies and power spectral densities (Welch); none of whole turns
    lines: list[Line]  # of all columns
    reference: float = 0.0  # of levels in dB [unit of the columns]; 0: amplitudes

    def place(self, line: Line, digits: int = 5) -> str:
        """Return where a line stands, with its error."""
        return f"{line.frequency:.{digits}g}" + (f" ± {line.error:.2g}" if line.error else "")

    def words(self, line: Line) -> str:
        """Return a line in words."""
        of = pretty_unit(self.units[line.column])
        level = f", {self.level(line.amplitude):.1f} dB re {self.reference:g} {of}" if self.reference else ""
        return f"{line.column}: {self.place(line)} {self.unit}, amplitude {line.amplitude:.4g} {of}".rstrip() + level

    def level(self, amplitudes: np.ndarray | float) -> np.ndarray | float:
        """Return the levels of the rms values of amplitudes [dB], without a reference the amplitudes."""
        size = np.maximum(amplitudes, 1.0e-300)
        return 20.0 * np.log10(size / np.sqrt(2.0) / self.reference) if self.reference else amplitudes

    def picture(self) -> Figure:
        """Draw amplitude and density of every column."""
        return draw_spectrum(self)

    @property
    def head(self) -> list[str]:
        """Of the table of the lines."""
        return ["column", f"frequency_[{self.unit}]", f"error_[{self.unit}]", "amplitude", "unit"]

    @property
    def rows(self) -> list[list]:
        """The lines: column, frequency and its error, amplitude in the column's unit."""
        return [[one.column, one.frequency, one.error, one.amplitude, self.units[one.column]] for one in self.lines]


def spectrum(
    run: History, columns: list[str], orders: str | None = None, most: int = 5, turns: tuple | None = None, reference: float = 0.0
) -> Spectrum:
    """Take the spectra of columns, wildcards allowed, the most lines of each; HistoryError: no such column, or too few rows.

    Orders are those of a drive's angle [rad], which turns one way; exact over `turns`, the first and last whole turn that count (1
    the first, -1 the last). A reference gives levels in dB [unit of the columns].
    """
    if turns and not orders:
        raise HistoryError("turns are those of the drive whose orders are taken: orders = 'COLUMN' expected")
    run = run.turns(orders, *turns) if turns else run
    axis_values, abscissa, unit = run.time, "frequency", "Hz"
    if orders:
        axis_values, abscissa, unit = run[orders] / (2.0 * np.pi), f"order of {orders}", "per turn"
        axis_values = axis_values if axis_values[-1] > axis_values[0] else -axis_values
        if np.any(np.diff(axis_values) <= 0.0) and not turns:
            raise HistoryError(
                f"{run.path}: {orders} does not increase or decrease throughout: orders need a drive turning one way"
            )
    found = Spectrum(abscissa, unit, {}, {}, {}, [], reference)
    for name in run.match(columns):
        if turns:
            found.units[name] = run.units[name]
            order, size = found.amplitudes[name] = orders_of(axis_values, run[name])
            largest = np.argsort(-size[1:], kind="stable")[:most] + 1
            seen = sorted(k for k in largest if size[k] > LEAST_ORDER * size.max())
            found.lines.extend(Line(name, float(order[k]), 0.0, float(size[k])) for k in seen)
            continue
        axis, values = even_samples(axis_values, run[name])
        frequency, size = amplitudes(axis, values)
        found.units[name], found.amplitudes[name], found.densities[name] = run.units[name], (frequency, size), density(axis, values)
        for k in peaks(size, most):
            at, error, top = spectral_line(size, k)
            found.lines.append(Line(name, at * frequency[1], error * frequency[1], top))
    return found


def draw_spectrum(found: Spectrum) -> Figure:
    """Return a figure of amplitude, or level, and density of every column, with its lines and their errors."""
    names, unit = list(found.units), found.unit
    across = 2 if found.densities else 1
    with mpl.rc_context(LOOK):
        size = (11.0 if across > 1 else 8.0, 0.8 + 2.6 * len(names))
        figure, axes = subplots(len(names), across, figsize=size, squeeze=False)
        for line, name in zip(axes, names):
            of, mine = found.units[name], [one for one in found.lines if one.column == name]
            frequency, size = found.amplitudes[name]
            tops = [one.amplitude for one in mine]
            if found.densities:
                line[0].plot(frequency[1:], found.level(size[1:]), color=COLOURS[0])
            else:
                foot = found.level(LEAST_ORDER * size[1:].max()) if found.reference else 0.0
                shown = size[1:] > LEAST_ORDER * size[1:].max()
                line[0].vlines(frequency[1:][shown], foot, found.level(size[1:][shown]), color=COLOURS[0])
            if found.reference:
                line[0].set_ylim(found.level(1.0e-4 * size[1:].max()), found.level(2.0 * size[1:].max()))
            elif len(tops) > 1 and min(tops) < SMALL * max(tops) and found.densities:
                line[0].set_yscale("log")
                line[0].set_ylim(0.2 * min(tops), 3.0 * max(tops))
            else:
                line[0].set_ylim(0.0, 1.2 * size[1:].max() or 1.0)
            for one in mine:
                line[0].errorbar(one.frequency, found.level(one.amplitude), xerr=one.error, fmt="o", color=COLOURS[1], ms=3)
            line[0].set_ylabel(f"{name} [dB re {found.reference:g} {pretty_unit(of)}]" if found.reference else axis_label(name, of))
            line[0].set_title("level of the rms value" if found.reference else "amplitude", fontsize=9)
            line[0].set_xlim(0.0, frequency[last_visible(size)])
            line[0].set_xlabel(f"{found.abscissa} [{unit}]")
            if found.densities:
                _draw_density(line[1], *found.densities[name], found, name, line[0].get_xlim())
        for axis, name in zip(axes[:, 0], names):
            tops = [(one.frequency, found.level(one.amplitude), found.place(one, 4)) for one in found.lines if one.column == name]
            labels.write(axis, [labels.Label(np.array(top), words, "black") for *top, words in tops])
    return figure


def _draw_density(axis: Axes, band: np.ndarray, power: np.ndarray, found: Spectrum, name: str, limits: tuple) -> None:
    """Draw the power spectral density of a column."""
    of, unit = found.units[name], found.unit
    axis.semilogy(band[1:], np.maximum(power[1:], power[1:].max() * 1.0e-12 or 1.0e-300), color=COLOURS[0])
    squared = f"{of}²" if of.isalpha() else f"({pretty_unit(of)})²" if of else "1"
    axis.set_ylabel(f"{name} [{squared}/{unit.replace('per turn', 'order')}]")
    axis.set_title("power spectral density (Welch)", fontsize=9)
    axis.set_xlabel(f"{found.abscissa} [{unit}]")
    axis.set_xlim(limits)
    seen = power[1:][band[1:] <= limits[1]]
    if seen.size and seen.max() > 0.0:
        axis.set_ylim(0.5 * max(seen.min(), seen.max() * 1.0e-12), 3.0 * seen.max())


def draw_waterfall(run: History, name: str, speed: str | None) -> Figure:
    """Return a figure of amplitudes over frequency and time, or over the speed of a drive."""
    axis, values = even_samples(run.time, run[name])
    if axis.size <= LEAST_ROWS:
        raise HistoryError(f"{axis.size} rows: {LEAST_ROWS + 1} or more are needed for a waterfall")
    frequency, times, size = waterfall(axis, values)
    across, label = times, "t [s]"
    if speed:
        across, label = np.interp(times, run.time, run[speed]), run.label(speed)
        if np.any(np.diff(across) <= 0.0) and np.any(np.diff(across) >= 0.0):
            raise HistoryError(f"{run.path}: {speed} has to rise or to fall throughout")
    with mpl.rc_context(LOOK | {"axes.grid": False}):
        figure, ax = subplots(figsize=(8.0, 5.0))
        level = 20.0 * np.log10(np.maximum(size, size.max() * 1.0e-5 or 1.0e-300))
        shades = ax.pcolormesh(across, frequency, level, shading="nearest", cmap="viridis", rasterized=True)
        figure.colorbar(shades, label=f"amplitude of {name} [dB re 1 {pretty_unit(run.units[name])}]")
        ax.set_xlabel(label)
        ax.set_ylabel("frequency [Hz]")
        ax.set_ylim(0.0, frequency[last_visible(size.max(axis=1))])
    return figure


def draw_decay(run: History, names: list[str]) -> tuple[Figure, list[str]]:
    """Return a figure of columns with the vibrations that decay in them, the envelope of the largest, and them in words."""
    told = []
    with mpl.rc_context(LOOK):
        figure, axes = subplots(len(names), 1, figsize=(8.0, 0.8 + 3.0 * len(names)), squeeze=False)
        for axis, name in zip(axes[:, 0], names):
            found = ring_down(run.time, run[name])
            inner = np.linspace(found.start, found.end, max(2000, run.time.size))
            envelope = found.envelope(inner)
            axis.plot(run.time, run[name], color=COLOURS[0], linewidth=0.8, label="rows")
            axis.plot(inner, found.level(inner) + envelope, linestyle=STYLES[1], color=COLOURS[1], label="envelope of the largest")
            axis.plot(inner, found.level(inner) - envelope, linestyle=STYLES[1], color=COLOURS[1])
            axis.set_ylabel(axis_label(name, run.units[name]))
            axis.legend(loc="upper right")
            words = [f"{name}: {found.words(k)}" for k in range(len(found.vibrations))]
            axis.set_title("\n".join(words), fontsize=8)
            told += words
        axes[-1, 0].set_xlabel("t [s]")
    return figure, told


def work(args: argparse.Namespace) -> int:
    """Draw what the command line asks for; raises HistoryError."""
    run = read(args.run).between(args.start, args.end)
    names = run.match(args.columns)
    if args.peaks < 0:
        raise HistoryError(f"--peaks {args.peaks}: 0 or more expected")
    if args.speed and not args.waterfall:
        raise HistoryError("--speed goes with --waterfall")
    if args.waterfall:
        if len(names) > 1:
            raise HistoryError(f"--waterfall draws one column, {len(names)} are chosen")
        figure = draw_waterfall(run, names[0], args.speed)
    elif args.rainflow or args.life:
        figure, words = fatigue.picture(run, names, args.life and tuple(args.life))
        print("\n".join(words))
    elif args.decay:
        figure, words = draw_decay(run, names)
        print("\n".join(words))
    else:
        found = spectrum(run, names, args.orders, args.peaks, args.turns and tuple(args.turns), args.reference)
        for line in found.lines:
            print(found.words(line))
        figure = found.picture()
    path = save(figure, args.output or run.path.parent / "spectrum")
    print(f"wrote {path}")
    return 0
