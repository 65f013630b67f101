"""Decaying vibrations of a record: several modes at once, each with frequency, damping, share of the motion and intervals.

The record is taken as a line and a sum of decaying sines and decays without vibration. The matrix pencil (Hua & Sarkar 1990,
IEEE Trans. ASSP 38, 814) gives poles for each number of them; least squares over all rows make them better, Schwarz' criterion
(BIC) chooses how many there are. Intervals follow from the residual, which is taken as white noise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from .figures import Tabular
from .result_files import HistoryError

MOST_ROWS = 1000  # rows that are fitted; more are averaged by a low-pass filter first
MOST_POLES = 16  # of the fit; a vibration has two
LEAST_ROWS = 16
NORMAL = 1.959963984540054  # half of the 95 % interval, in standard deviations
KNOWN = 0.1  # half of the 95 % interval of a damping, over the damping, up to which it is called resolved
BAND = 0.6  # of half the sampling frequency, up to which thinned rows keep what vibrates
LEAST_SHARE = 1.0e-9  # of the motion, below which a vibration is what the filter leaves of faster ones
FALL = 4.6  # largest logarithmic decrement of a vibration: crests that fall to less than a hundredth within a period are not seen
EVEN = 1.0e-6  # unevenness of steps that is rounding [-]
STARTS = (0.0, 1 / 64, 1 / 32, 1 / 16, 1 / 8, 1 / 4)  # shares of the rows that may be left out: a push before the free vibration


@dataclass(frozen=True)
class Vibration:
    """A decaying vibration; each error is half of the 95 % interval."""

    frequency: float  # of the damped vibration [Hz]
    frequency_error: float  # [Hz]
    damping_ratio: float  # [-]
    damping_error: float  # [-]
    amplitude: float  # at the first row of the fit, of its envelope [unit of the column]
    phase: float  # there, of a cosine [rad]
    share: float  # of the sum of the squares of all vibrations that are told, over the rows [-]

    @property
    def rate(self) -> float:
        """Of the decay [1/s]."""
        return self.damping_ratio / math.sqrt(1.0 - self.damping_ratio**2) * 2.0 * math.pi * self.frequency

    @property
    def rate_error(self) -> float:
        """Half of the 95 % interval of the decay [1/s]."""
        return abs(self.rate) * self.damping_error / abs(self.damping_ratio) if self.damping_ratio else math.inf

    @property
    def decrement(self) -> float:
        """Logarithm of the ratio of two crests that follow each other [-]."""
        return self.rate / self.frequency

    def wave(self, since: np.ndarray) -> np.ndarray:
        """Return the vibration at times since the first row of the fit [unit of the column]."""
        return self.amplitude * np.exp(-self.rate * since) * np.cos(2.0 * np.pi * self.frequency * since + self.phase)

    @property
    def seen(self) -> bool:
        """Whether it is a vibration: its frequency is known, and it swings before it has gone."""
        return self.frequency_error <= KNOWN * self.frequency and self.decrement <= FALL and self.share > LEAST_SHARE

    @property
    def resolved(self) -> bool:
        """Whether the interval of the damping is narrow enough for a figure."""
        return self.damping_error <= KNOWN * abs(self.damping_ratio)


@dataclass(frozen=True)
class RingDown(Tabular):
    """The vibrations of a record by their shares, the largest first, and how the fit follows the rows."""

    vibrations: list[Vibration]
    start: float  # first row of the fit [s]
    end: float  # last row of it [s]
    middle: tuple[np.ndarray, np.ndarray]  # about which it rings: times [s], values [unit of the column]
    top: float  # highest frequency that was looked at [Hz]
    residual: float  # root mean square of what the fit leaves, over that of the rows about their mean [-]

    @property
    def head(self) -> list[str]:
        """Of the table of the vibrations."""
        return ["frequency_[Hz]", "frequency_error_[Hz]", "damping_ratio", "damping_error", "resolved", "amplitude", "share"]

    @property
    def rows(self) -> list[list]:
        """The vibrations, the largest share first."""
        return [[one.frequency, one.frequency_error, one.damping_ratio, one.damping_error, one.resolved, one.amplitude, one.share]
                for one in self.vibrations]  # fmt: skip

    def level(self, time: np.ndarray) -> np.ndarray:
        """Return about what it rings [unit of the column]."""
        return np.interp(time, *self.middle)

    def envelope(self, time: np.ndarray, k: int = 0) -> np.ndarray:
        """Return the envelope of a vibration [unit of the column]."""
        one = self.vibrations[k]
        return one.amplitude * np.exp(-one.rate * (time - self.start))

    def words(self, k: int) -> str:
        """Return a vibration in words."""
        one = self.vibrations[k]
        text = f"{one.frequency:.5g} ± {one.frequency_error:.2g} Hz, damping ratio "
        if one.resolved:
            text += f"{one.damping_ratio:.4g} ± {one.damping_error:.2g}, decay {one.rate:.4g} 1/s"
        else:
            text += f"not resolved ({one.damping_ratio:.2g} ± {one.damping_error:.2g})"
        return text + f", {100.0 * one.share:.3g} % of the vibrations up to {self.top:.3g} Hz"


def even_samples(axis: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return evenly spaced samples: the rows themselves, or as many from a cubic spline; HistoryError where they are too few."""
    if axis.size < LEAST_ROWS:
        raise HistoryError(f"{axis.size} rows: {LEAST_ROWS} or more are needed for a spectrum or a decay")
    steps = np.diff(axis)
    if np.ptp(steps) <= EVEN * steps.max():
        return axis, values
    from scipy.interpolate import make_interp_spline

    even = np.linspace(axis[0], axis[-1], axis.size)
    return even, make_interp_spline(axis, values, k=3)(even)


def ring_down(time: np.ndarray, values: np.ndarray) -> RingDown:
    """Return the vibrations of a column [s, unit of the column]; HistoryError where there are too few rows, or none rings.

    Rows at the start that no decay follows (a push) are left out where the others then leave less than half the residual.
    """
    time, values = even_samples(time, values)
    if not np.ptp(values) > 0.0:
        raise HistoryError("the column is constant: nothing rings")
    thin, thinned, window = _thinned(time, values)
    best = None
    for share in STARTS:
        first = round(share * thinned.size)
        if thinned.size - first < LEAST_ROWS:
            break
        found = _fit(thin[first:] - thin[first], thinned[first:])
        if best is None or found.noise < 0.5 * best[0].noise:
            best = found, first
        if found.even:
            break
    found, first = best
    scale = thinned[first:].std() or 1.0
    top = 0.5 / (thin[1] - thin[0]) * (BAND if window.size > 1 else 1.0)
    passed = (np.arange(window.size) - window.size // 2) * (time[1] - time[0])
    gain = np.exp(np.outer(found.poles, passed)) @ window  # by which the filter multiplies a decaying sine
    noise = found.noise / math.sqrt(BAND if window.size > 1 else 1.0)  # the filter leaves a part of the band
    vibrations = [one for one in found.vibrations(gain, top, noise) if one.seen]
    all_seen = sum(one.share for one in vibrations)
    vibrations = [replace(one, share=one.share / all_seen) for one in vibrations]
    if not vibrations or found.noise > 0.5 * scale:
        raise HistoryError("no decaying vibration is seen in the rows")
    since = thin[first:] - thin[first]
    waves = sum(one.wave(since) for one in vibrations)
    middle = thin[first:], found.curve() - waves
    return RingDown(vibrations, float(thin[first]), float(thin[-1]), middle, float(top), found.noise / scale)


def _thinned(time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return at most MOST_ROWS rows, without what is faster than they can show, and the filter, which ends within the rows."""
    factor = -(-values.size // MOST_ROWS)
    if factor == 1:
        return time, values, np.ones(1)
    from scipy.signal import firwin, upfirdn

    window = firwin(40 * factor + 1, BAND / factor, window=("kaiser", 12.0))  # from 0.8 on it leaves 1e-6
    inner = slice(20 * factor, values.size - 20 * factor, factor)
    kept = time[inner]
    return kept, upfirdn(window, values, down=factor)[40 : 40 + kept.size], window  # of each kept row alone, the work is linear


class _Fit:
    """A line, decays and decaying sines beside rows: poles, amplitudes, residual, covariance."""

    def __init__(self, time: np.ndarray, values: np.ndarray, real: np.ndarray, pairs: np.ndarray) -> None:
        """Take real poles [1/s] and one of each pair of complex ones [1/s]; amplitudes by linear least squares."""
        self.time, self.values, self.decays, self.pairs = time, values, real.size, pairs.size
        self.scale = values.std() or 1.0
        start = np.concatenate([real, pairs.real, pairs.imag])
        self._take(np.concatenate([start, np.linalg.lstsq(self._columns(start), values, rcond=None)[0]]))

    def _take(self, parameters: np.ndarray) -> None:
        """Take parameters: their residual, and Schwarz' criterion."""
        self.parameters, size = parameters, self.values.size
        self.sum = float(np.sum(self._difference(parameters) ** 2)) * self.scale**2
        self.noise = math.sqrt(self.sum / max(size - parameters.size, 1))  # standard deviation [unit of the column]
        rounding = (1e-14 * np.abs(self.values).max()) ** 2 * size
        self.criterion = size * math.log(max(self.sum, rounding) / size) + parameters.size * math.log(size)

    def refined(self) -> _Fit:
        """Return it with all parameters by least squares."""
        from scipy.optimize import least_squares

        with np.errstate(all="ignore"):  # steps that go too far are taken back
            found = least_squares(self._difference, self.parameters, self._slopes, method="lm", x_scale="jac", max_nfev=40)
        if np.all(np.isfinite(found.x)) and np.sum(found.fun**2) * self.scale**2 < self.sum:
            self._take(found.x)
        return self

    def _poles(self, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        r, p = self.decays, self.pairs
        return parameters[:r], parameters[r : r + p], parameters[r + p : r + 2 * p]

    def _columns(self, parameters: np.ndarray) -> np.ndarray:
        """Return what is multiplied by the linear parameters, shape (rows, 2 + decays + 2 pairs)."""
        real, sigma, omega = self._poles(parameters)
        fall, sway = np.exp(np.outer(self.time, sigma)), np.outer(self.time, omega)
        parts = [
            np.vander(self.time / self.time[-1], 2, increasing=True),
            np.exp(np.outer(self.time, real)),
            fall * np.cos(sway),
            fall * np.sin(sway),
        ]
        return np.nan_to_num(np.hstack(parts), posinf=1e150, neginf=-1e150)

    def _linear(self, parameters: np.ndarray) -> np.ndarray:
        return parameters[self.decays + 2 * self.pairs :]

    def _difference(self, parameters: np.ndarray) -> np.ndarray:
        return (self._columns(parameters) @ self._linear(parameters) - self.values) / self.scale

    def _slopes(self, parameters: np.ndarray) -> np.ndarray:
        """Return the derivative of the difference by all parameters."""
        columns, linear = self._columns(parameters), self._linear(parameters)
        r, p, t = self.decays, self.pairs, self.time[:, None]
        decays, cosines, sines = columns[:, 2 : 2 + r], columns[:, 2 + r : 2 + r + p], columns[:, 2 + r + p :]
        c, a, b = linear[2 : 2 + r], linear[2 + r : 2 + r + p], linear[2 + r + p :]
        return np.hstack([t * decays * c, t * (cosines * a + sines * b), t * (cosines * b - sines * a), columns]) / self.scale

    def curve(self) -> np.ndarray:
        """Return what is fitted to the rows."""
        return self._columns(self.parameters) @ self._linear(self.parameters)

    @property
    def even(self) -> bool:
        """Whether the first quarter of the rows is followed as the others are, or all are to rounding."""
        squares = self._difference(self.parameters) ** 2
        return squares.max() < 1e-24 or squares[: squares.size // 4].mean() <= 4.0 * squares[squares.size // 4 :].mean()

    @property
    def poles(self) -> np.ndarray:
        """One of each pair of complex poles [1/s]."""
        _, sigma, omega = self._poles(self.parameters)
        return sigma + 1j * omega

    def vibrations(self, gain: np.ndarray, top: float, noise: float) -> list[Vibration]:
        """Return the decaying sines up to a frequency [Hz], the largest share first, before a filter.

        gain: of the filter at each of them [-]; noise: standard deviation of white noise that fills the band as the residual does.
        """
        slopes = self._slopes(self.parameters) * self.scale
        norms = np.linalg.norm(slopes, axis=0)
        norms[norms == 0.0] = 1.0
        covariance = np.linalg.pinv((slopes / norms).T @ (slopes / norms), rcond=1e-14) * noise**2 / np.outer(norms, norms)
        _, sigma, omega = self._poles(self.parameters)
        linear, columns = self._linear(self.parameters), self._columns(self.parameters)
        r, p = self.decays, self.pairs
        size = (linear[2 + r : 2 + r + p] - 1j * linear[2 + r + p :]) / gain
        told = [k for k in range(p) if abs(omega[k]) <= 2.0 * np.pi * top]
        waves = columns[:, 2 + r : 2 + r + p] * size.real - columns[:, 2 + r + p :] * size.imag
        energies = {k: np.sum(waves[:, k] ** 2) for k in told}
        found = []
        for k in told:
            i, j = r + k, r + p + k  # places of the pole's two parts
            turn = math.hypot(sigma[k], omega[k])
            ratio = -sigma[k] / turn
            slope = np.array([-(omega[k] ** 2), sigma[k] * omega[k]]) / turn**3  # of the ratio
            part = covariance[np.ix_([i, j], [i, j])]
            error = NORMAL * math.sqrt(max(slope @ part @ slope, 0.0))
            turns = NORMAL * math.sqrt(max(part[1, 1], 0.0)) / (2.0 * math.pi)
            share = energies[k] / (sum(energies.values()) or 1.0)
            amplitude, phase = abs(size[k]), float(np.angle(size[k]))
            found.append(Vibration(abs(omega[k]) / (2.0 * math.pi), turns, ratio, error, amplitude, phase, share))
        return sorted(found, key=lambda one: -one.share)


def _fit(time: np.ndarray, values: np.ndarray) -> _Fit:
    """Return the fit that Schwarz' criterion chooses among numbers of poles."""
    from scipy.linalg import hankel, svd

    step, size = time[1] - time[0], values.size
    lags = size // 3
    left, weights, _ = svd(hankel(values[: lags + 1] - values.mean(), values[lags:] - values.mean()), full_matrices=False)
    tried = []
    for count in range(1, min(MOST_POLES, lags - 1) + 1):
        if weights[count - 1] <= 1e-13 * weights[0]:
            break
        space = left[:, :count]
        poles = np.linalg.eigvals(np.linalg.lstsq(space[:-1], space[1:], rcond=None)[0])
        poles = np.log(poles[np.abs(poles) > 1e-6].astype(complex)) / step
        poles = poles[poles.real * time[-1] < 1.0]  # what grows by more is no decay
        real = poles.real[np.abs(poles.imag) < 1e-9 * np.pi / step]
        pairs = poles[(poles.imag * time[-1] > 1.0) & (poles.imag < 0.98 * np.pi / step)]
        tried.append(_Fit(time, values, real[real * time[-1] < -0.1], pairs))
    least = min(range(len(tried)), key=lambda k: tried[k].criterion)
    return min((one.refined() for one in tried[max(least - 3, 0) : least + 2]), key=lambda one: one.criterion)
