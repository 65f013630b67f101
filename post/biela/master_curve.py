"""Shifts moduli measured at several temperatures onto one curve (time-temperature superposition; Ferry 1980).

At the temperature T a frequency f acts as a_T f at the reference. How far neighbouring sets are shifted follows from their overlap:
both together have to be one sum of relaxations with no negative weight. Where sets apart meet that as well, the overlap leaves the
shift open, and that of the neighbours, by kelvin, takes its place. Then all that is known is refined together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import approx_fprime, least_squares

from .material_data import DataError, Measurements
from .material_fit import rms, spectrum_misfit
from .material_law import shift_factor

CONSTANTS = {"free": 1, "wlf": 2, "arrhenius": 1}  # shifts that have to be known for each law
CONFIDENCE = 20.0  # least logarithm of the likelihood ratio, doubled, of an overlap beside none: 4.5 standard deviations
BEYOND = 0.5  # decades beyond touching at which sets that stand apart are tried
FLOOR = 2.0e-3  # misfit that the spacing of the spectrum leaves [-]


@dataclass(frozen=True)
class MasterCurve:
    """Sets of several temperatures on one curve."""

    law: str  # 'free' (a factor each), 'wlf' (Williams, Landel & Ferry 1955) or 'arrhenius'
    reference: float  # temperature that is not shifted [K]
    temperatures: np.ndarray  # of the sets, ascending [K]
    shifts: np.ndarray  # log10 a_T of each set
    overlaps: np.ndarray  # log10 a_T of each set as its overlap with its neighbours alone says, nan where that leaves it open
    errors: np.ndarray  # standard error of log10 a_T of each set by the scatter; infinite of free factors beyond an open step
    misfits: np.ndarray  # root mean square of the relative errors of storage and loss modulus, of each set
    constants: np.ndarray  # C1 [-] and C2 [K] of WLF, the activation energy of Arrhenius [kJ/mol], else empty
    frequency: np.ndarray  # of each row at the reference temperature [Hz]
    open: list[tuple[int, float, float]]  # colder set, least and largest log10 a_T of the next, of pairs whose shift is open

    def shift(self, temperature: float) -> float:
        """Return log10 a_T of a temperature between the measured ones [K]."""
        return float(_shifts(self.law, self.constants, self.temperatures, self.shifts, temperature, self.reference))


def _shifts(law: str, constants: np.ndarray, sets: np.ndarray, factors: np.ndarray, temperature, reference: float) -> np.ndarray:
    """Return log10 a_T of temperatures [K]; of free factors between those of the sets, straight on beyond the outer ones."""
    if law != "free":
        return shift_factor(law, constants, temperature, reference)
    slopes = np.diff(factors) / np.diff(sets)
    k = np.clip(np.searchsorted(sets, temperature) - 1, 0, slopes.size - 1)
    return factors[k] + slopes[k] * (temperature - sets[k])


def master_curve(data: Measurements, law: str, reference: float) -> MasterCurve:
    """Shift the sets of a table by a law onto one curve at a reference [K]; DataError: it does not hold for them."""
    sets = data.temperatures
    if law == "wlf" and sets.size < 3:
        raise DataError(f"WLF has two constants, which {sets.size} temperatures do not give: --shift free or arrhenius")
    steps, least, largest, off = np.array([_step(data, k) for k in range(sets.size - 1)]).T
    known = np.isfinite(largest - least)
    if known.sum() < CONSTANTS[law]:
        k = int(np.argmin(known))
        names = " and ".join(data.name(t) for t in sets[k : k + 2])
        words = f"the curves at {names} do not overlap: apart they are as good a modulus ({off[k]:.2g} %), so that their shift"
        raise DataError(f"{words} is not known, and those of their neighbours are too few to take it from")
    middle, apart = 0.5 * (sets[1:] + sets[:-1]), np.diff(sets)
    steps[~known] = np.interp(middle[~known], middle[known], (steps / apart)[known]) * apart[~known]
    chain = np.append(0.0, np.cumsum(steps))
    base = int(np.argmin(np.abs(sets - reference)))  # the law is fitted about a set, so that WLF's C2 has a bound
    start, bounds, sizes = _start(law, steps, known, sets, base)

    def spread(x: np.ndarray, temperature: np.ndarray) -> np.ndarray:
        """Return log10 a_T of temperatures [K] for unknowns x."""
        factors = np.zeros(sets.size)
        if law == "free":
            own = steps.copy()
            own[known] = x
            factors[1:] = np.cumsum(own)
        return _shifts(law, x, sets, factors - factors[base], temperature, sets[base])

    part = np.append(0, np.cumsum(~known))[data.group]  # sets that an open step parts do not tell of each other

    def misfit(x: np.ndarray) -> np.ndarray:
        rows = data.frequency * 10.0 ** spread(x, data.temperature)
        off = np.empty((2, rows.size))
        for k in range(part.max() + 1):
            off[:, part == k] = spectrum_misfit(rows[part == k], data.modulus[part == k]).reshape(2, -1)
        return off.ravel()

    found = least_squares(misfit, start, bounds=bounds, x_scale=sizes, diff_step=1.0e-3, xtol=1.0e-5, ftol=1.0e-6)
    temperatures = np.append(reference, sets)
    own = spread(found.x, temperatures)
    own, zero = own[1:], own[0]
    rows = data.frequency * 10.0 ** (spread(found.x, data.temperature) - zero)
    _check_overlap(data, law, rows, known)
    constants = found.x if law != "free" else np.zeros(0)
    if law == "wlf":
        second = constants[1] + reference - sets[base]
        constants = np.array([constants[0] * constants[1] / second, second])
    misfits = np.array([rms(found.fun.reshape(2, -1)[:, data.group == k]) for k in range(sets.size)])
    moves = approx_fprime(found.x, lambda x: spread(x, sets) - spread(x, temperatures[:1]))
    spare = max(found.fun.size - found.x.size - 2 * sets.size, 1)  # about two numbers of the spectrum for each set
    covariance = np.linalg.pinv(found.jac.T @ found.jac) * (found.fun @ found.fun) / spare
    errors = np.sqrt(np.einsum("ij,jk,ik->i", moves, covariance, moves))
    passed = np.append(0, np.cumsum(~known))  # how many open steps lie before each set
    overlaps = np.where(passed != passed[base], np.nan, chain - np.interp(reference, sets, chain))
    errors = np.where(passed != passed[base], np.inf, errors) if law == "free" else errors
    left = [(int(k), float(least[k]), float(largest[k])) for k in np.flatnonzero(~known)]
    return MasterCurve(law, reference, sets, own - zero, overlaps, errors, misfits, constants, rows, left)


def _step(data: Measurements, k: int) -> tuple[float, float, float, float]:
    """Return log10 a_T of set k + 1 beside set k by their overlap, its ends (infinite: sets apart are as good), misfit [%]."""
    cold, warm = data.group == k, data.group == k + 1
    low, high = (np.log10(data.frequency[part]) for part in (cold, warm))
    modulus = np.append(data.modulus[cold], data.modulus[warm])
    total_width = low.max() - low.min() + high.max() - high.min()  # shifts between the two at which the sets only touch

    def misfit(step: float) -> float:
        return rms(spectrum_misfit(10.0 ** np.append(low, high + step), modulus)) + FLOOR

    first = low.min() - high.max() - BEYOND  # where the warm set ends the cold one begins, and farther apart
    steps = first + (total_width + 2.0 * BEYOND) * np.linspace(0.0, 1.0, max(5, round(20 * (total_width + 2.0 * BEYOND))) + 1)
    misfits = np.array([misfit(step) for step in steps])
    best, as_good = int(np.argmin(misfits)), 4 * modulus.size * np.log(misfits / misfits.min()) < CONFIDENCE
    around = slice(max(best - 1, 0), best + 2)
    top = np.polyfit(steps[around], misfits[around], 2) if steps[around].size == 3 else np.zeros(3)
    step = -top[1] / (2.0 * top[0]) if top[0] > 0.0 else steps[best]
    least = -np.inf if as_good[0] else steps[as_good].min()
    largest = np.inf if as_good[-1] else steps[as_good].max()
    return float(step), float(least), float(largest), 100.0 * float(misfits[best])


def _check_overlap(data: Measurements, law: str, rows: np.ndarray, known: np.ndarray) -> None:
    """Refuse a law that shifts neighbouring sets apart whose overlap is known; rows: reduced frequencies [Hz]."""
    for k, (cold, warm) in enumerate(zip(data.temperatures, data.temperatures[1:])):
        one, two = rows[data.group == k], rows[data.group == k + 1]
        if known[k] and (two.max() < one.min() or one.max() < two.min()):
            names = f"{data.name(cold)} and {data.name(warm)}"
            raise DataError(f"{law} does not hold: it shifts the overlapping curves at {names} apart; try --shift free")


def _start(law: str, steps: np.ndarray, known: np.ndarray, sets: np.ndarray, base: int) -> tuple[np.ndarray, tuple, np.ndarray]:
    """Return unknowns that come nearest to the known steps from set to set, their bounds and their sizes."""
    first = steps[known]
    if law == "free":
        return first, (-np.inf, np.inf), np.ones(first.size)

    def step(constants: np.ndarray) -> np.ndarray:
        return np.diff(shift_factor(law, constants, sets, sets[base]))[known]

    if law == "arrhenius":
        unit = step(np.ones(1))
        start = np.array([max(unit @ first / (unit @ unit), 1.0)])
        return start, (0.0, np.inf), start
    least = max(1.0, 1.0 - (sets.min() - sets[base]))  # C2 + T - T_ref stays positive
    bounds = ([0.0, least], [200.0, 2000.0])
    guess = least_squares(lambda c: step(c) - first, [10.0, least + 60.0], bounds=bounds)
    return guess.x, bounds, np.maximum(guess.x, 1.0)
