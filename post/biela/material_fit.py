"""Fits GHM or Maxwell terms to a complex modulus.

The relative complex error |E_fit/E - 1| is made small, root mean square over the rows: weights for given poles by least
squares (Lawson & Hanson), from poles that this picks on a fine grid and from even ones; then both together, by their logarithms.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares, nnls

from .command import Progress
from .material_law import Material, ghm_shapes, maxwell_shapes, pole_factor

GRID = 6  # poles of the grid in a decade
ZETAS = (0.3, 20.0)  # bounds of the damping ratio of a GHM term
NEAR = 1.2  # errors within this factor count as equal: the fewer internal variables win
STEP = 1.0e-7  # of a difference of logarithms
STATIC = 1.0e-2  # smallest static modulus, in parts of the smallest storage modulus


@dataclass(frozen=True)
class Fit:
    """A fitted material."""

    material: Material  # the terms
    error: float  # root mean square of |E_fit/E - 1| over the rows [-]


def relative_error(material: Material, frequency: np.ndarray, modulus: np.ndarray) -> np.ndarray:
    """Return |E_fit/E - 1| at each frequency [Hz]."""
    return np.abs(material.modulus(frequency) / modulus - 1.0)


def rms(values: np.ndarray) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(np.abs(values) ** 2)))


class _Law:
    """The poles of n terms of one law as a vector of logarithms: of 1/tau; for GHM of the fastest pole, then of zeta."""

    def __init__(self, kind: str, slowest: float, fastest: float) -> None:
        self.kind = kind
        self.range = (np.log(slowest), np.log(fastest))

    def bounds(self, terms: int) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds of the poles' parameters."""
        low, high = np.full(terms, self.range[0]), np.full(terms, self.range[1])
        if self.kind == "maxwell":
            return low, high
        return np.append(low, np.full(terms, np.log(ZETAS[0]))), np.append(high, np.full(terms, np.log(ZETAS[1])))

    def shapes(self, s: np.ndarray, poles: np.ndarray) -> np.ndarray:
        """Return the shape of each term at s, a column each."""
        if self.kind == "maxwell":
            return maxwell_shapes(s, np.exp(-poles))
        zeta, omega = self.split(poles)
        return ghm_shapes(s, zeta, omega)

    def split(self, poles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return zeta and omega [rad/s] of GHM terms."""
        zeta = np.exp(poles[poles.size // 2 :])
        return zeta, np.exp(poles[: poles.size // 2]) / pole_factor(zeta)

    def material(self, static: float, weights: np.ndarray, poles: np.ndarray) -> Material:
        """Return the material, terms from slow to fast; terms without weight are left out."""
        kept = weights > 1.0e-9
        if self.kind == "maxwell":
            order = np.argsort(poles[kept])
            return Material(static, weight=weights[kept][order], tau=np.exp(-poles[kept])[order])
        zeta, omega = (values[kept] for values in self.split(poles))
        order = np.argsort(omega)
        return Material(static, weights[kept][order], zeta[order], omega[order])

    def starts(self, picked: np.ndarray, terms: int) -> list[np.ndarray]:
        """Return starting poles: logarithms of the rates that least squares picked from the grid, and evenly spaced ones."""
        inner = np.linspace(*self.range, terms + 2)[1:-1]
        rates = [inner]
        if picked.size:
            rates.append(np.interp(np.linspace(0.0, 1.0, terms), np.linspace(0.0, 1.0, picked.size), picked))
        if picked.size > terms:  # neighbours become one
            rates.append(np.array([group.mean() for group in np.array_split(picked, terms)]))
        if self.kind == "maxwell":
            return rates
        starts = []
        for slow in rates:
            for zeta in (0.8, 2.0, 5.0):
                spread = np.log(pole_factor(np.array(zeta)) ** 2)
                starts.append(np.append(np.clip(slow + spread, *self.range), np.full(terms, np.log(zeta))))
        return starts


def spectrum_misfit(frequency: np.ndarray, modulus: np.ndarray) -> np.ndarray:
    """Return relative errors of storage and loss modulus, each of its own, for the best sum of relaxations with weights above 0."""
    s = 2j * np.pi * frequency[:, None]
    ends = np.log10(frequency.min()) - 1.0, np.log10(frequency.max()) + 1.0
    rates = 2.0 * np.pi * np.logspace(*ends, round(GRID * (ends[1] - ends[0])))
    columns = np.column_stack([np.ones(s.size), maxwell_shapes(s, 1.0 / rates)])
    matrix = np.vstack([columns.real / modulus.real[:, None], columns.imag / modulus.imag[:, None]])
    floor = STATIC * modulus.real.min()
    weights = nnls(matrix, 1.0 - floor * matrix[:, 0])[0]
    return matrix @ weights + floor * matrix[:, 0] - 1.0


def _weights(columns: np.ndarray, modulus: np.ndarray, floor: float) -> np.ndarray:
    """Return static modulus and moduli of the terms that make the relative error least, none negative, the first above a floor."""
    matrix = columns / modulus[:, None]
    matrix = np.vstack([matrix.real, matrix.imag])
    target = np.append(np.ones(modulus.size), np.zeros(modulus.size))
    found = nnls(matrix, target - floor * matrix[:, 0])[0]
    return found + np.append(floor, np.zeros(found.size - 1))


def _refine(law: _Law, s: np.ndarray, modulus: np.ndarray, poles: np.ndarray, floor: float) -> tuple[float, np.ndarray]:
    """Refine poles and moduli together from one start; returns the error and the parameters (moduli, poles)."""
    terms = law.shapes(s, poles).shape[1]
    columns = np.column_stack([np.ones(s.size), law.shapes(s, poles)])
    moduli = np.log(np.maximum(_weights(columns, modulus, floor), 1.0e-6 * floor))
    low, high = law.bounds(terms)
    low = np.concatenate([[np.log(floor)], np.full(terms, np.log(1.0e-9 * floor)), low])
    high = np.concatenate([np.full(terms + 1, np.log(10.0 * np.abs(modulus).max())), high])
    start = np.clip(np.append(moduli, poles), low + 1.0e-9, high - 1.0e-9)

    def real(values: np.ndarray) -> np.ndarray:
        """Return relative numbers, a row a frequency, as twice as many real ones."""
        return np.concatenate([values.real, values.imag]) / np.sqrt(modulus.size)

    def error(x: np.ndarray) -> np.ndarray:
        return real((np.exp(x[0]) + law.shapes(s, x[terms + 1 :]) @ np.exp(x[1 : terms + 1])) / modulus - 1.0)

    def slopes(x: np.ndarray) -> np.ndarray:
        """Return the derivatives; a term's shape depends on its own poles alone, so that all are moved at once."""
        weights, poles = np.exp(x[1 : terms + 1]), x[terms + 1 :]
        shapes = law.shapes(s, poles)
        columns = [np.full((s.size, 1), np.exp(x[0])), shapes * weights]
        for block in np.eye(poles.size // terms):
            moved = law.shapes(s, poles + STEP * np.repeat(block, terms))
            columns.append((moved - shapes) / STEP * weights)
        return real(np.hstack(columns) / modulus[:, None])

    solution = least_squares(error, start, jac=slopes, bounds=(low, high), xtol=1.0e-8, ftol=1.0e-8, gtol=1.0e-12, max_nfev=200)
    return float(np.linalg.norm(solution.fun)), solution.x


def fit(kind: str, terms: int, frequency: np.ndarray, modulus: np.ndarray, fastest: float) -> Fit:
    """Fit terms, 1 or more, of one law to complex moduli [Pa] at frequencies [Hz]; no pole is faster than the fastest [1/s]."""
    s = 2j * np.pi * frequency[:, None]
    slowest = 2.0 * np.pi * frequency.min() / 10.0
    law = _Law(kind, slowest, fastest)
    floor = STATIC * modulus.real.min()
    grid = np.linspace(*law.range, max(2, round(GRID * (law.range[1] - law.range[0]) / np.log(10.0))))
    on_grid = _weights(np.column_stack([np.ones(s.size), maxwell_shapes(s, np.exp(-grid))]), modulus, floor)[1:]
    picked = grid[on_grid > 1.0e-6 * on_grid.max()]
    error, best = min((_refine(law, s, modulus, poles, floor) for poles in law.starts(picked, terms)), key=lambda found: found[0])
    moduli = np.exp(best[: terms + 1])
    return Fit(law.material(moduli[0], moduli[1:] / moduli[0], best[terms + 1 :]), error)


def choose_terms(kind: str, frequency: np.ndarray, modulus: np.ndarray, fastest: float, target: float, most: int) -> Fit:
    """Return the fit of the fewest terms whose error is below the target, else of the fewest that are about as good as any.

    Errors are compared per degree of freedom, so that terms which only follow the scatter do not win.
    """
    rows = 2 * frequency.size
    per_term = 2 if kind == "maxwell" else 3
    tried, scatter, line = [], [], Progress()
    for terms in range(1, max(1, min(most, (rows - 2) // per_term)) + 1):
        line.show(f"terms of {kind}", terms, most)
        tried.append(fit(kind, terms, frequency, modulus, fastest))
        scatter.append(tried[-1].error * np.sqrt(rows / max(rows - 1 - per_term * terms, 1)))
        if tried[-1].error <= target:
            break
    line.clear()
    return tried[-1] if tried[-1].error <= target else next(one for one, size in zip(tried, scatter) if size <= NEAR * min(scatter))
