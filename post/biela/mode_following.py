"""Vibrations that are followed by their shapes from design to design: frequencies and damping ratios of a study's runs."""

from __future__ import annotations

import math

import numpy as np

from .sweep_scalars import Scalar
from .sweep_study import Parameter, Study

ALIKE = 0.5  # of orthogonal shapes one alone is more than half like another


def likeness(one: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return how much shapes (rows) are like one: the modal assurance criterion (Allemang & Brown 1982)."""
    sizes = np.linalg.norm(others, axis=1) * np.linalg.norm(one)
    return (np.abs(others.conj() @ one) / np.where(sizes > 0.0, sizes, 1.0)) ** 2


def place_of(parameter: Parameter, value: object) -> float:
    """Return where a value stands in the range of its parameter, of words and items of a list by their number."""
    if not parameter.ends:
        if parameter.deviation:
            return (value - parameter.values[0]) / parameter.deviation
        return parameter.values.index(value) / max(len(parameter.values) - 1, 1)
    low, high = parameter.ends
    return math.log(value / low) / math.log(high / low) if parameter.log else (value - low) / (high - low)


class Followed:
    """Vibrations of the designs so far, each taken from that of the nearest design before it; the first from the deck's own."""

    def __init__(self, study: Study) -> None:
        self.parameters = study.parameters
        self.deck = {one.mode: _complex(one.shape) for one in study.scalars if one.mode}
        self.places: list[list[float]] = []
        self.shapes: list[dict[int, np.ndarray]] = []

    def take(self, study: Study, entries: list[dict]) -> list[dict]:
        """Return the entries of a study's points with the values of its vibrations, NaN and a warning where none is like them."""
        found = list(entries)
        places = np.array([[place_of(one, point[one.name]) for one in self.parameters] for point in study.points])
        left = [k for k, entry in enumerate(entries) if not entry["reason"]]
        if not left:
            return found
        vibrations = {k: [(*one[:2], _complex(one[2])) for one in entries[k]["modes"]] for k in left}
        distance, nearest = np.full(len(entries), np.inf), [self.deck] * len(entries)
        if not self.places:  # that which is most like the deck comes first
            distance[left] = [-sum(_best(shape, vibrations[k])[0] for shape in self.deck.values()) for k in left]
        for place, shapes in zip(self.places, self.shapes):
            _reach(places, place, shapes, distance, nearest)
        while left:
            k = min(left, key=lambda k: distance[k])
            left.remove(k)
            picked = {mode: _best(shape, vibrations[k]) for mode, shape in nearest[k].items()}
            found[k], followed = _told(study, entries[k], picked)
            if followed:
                if not self.places:
                    distance[:] = np.inf
                self.places.append(places[k].tolist())
                self.shapes.append({mode: vibration[2] for mode, (_, vibration) in picked.items()})
                _reach(places, self.places[-1], self.shapes[-1], distance, nearest)
        return found


def _complex(parts: tuple[float, ...]) -> np.ndarray:
    """Return a shape from real and imaginary parts in turn."""
    return np.array(parts[::2]) + 1j * np.array(parts[1::2])


def _best(shape: np.ndarray, vibrations: list[tuple]) -> tuple[float, tuple | None]:
    """Return likeness and vibration of the one that is most like a shape; -1 where none has as many displacements."""
    same = [one for one in vibrations if one[2].shape == shape.shape]
    if not same:
        return -1.0, None
    alike = likeness(shape, np.array([one[2] for one in same]))
    return float(alike.max()), same[int(np.argmax(alike))]


def _reach(places: np.ndarray, place: list[float], shapes: dict, distance: np.ndarray, nearest: list[dict]) -> None:
    """Note for which designs another one is nearer than those before."""
    away = np.linalg.norm(places - place, axis=1)
    for k in np.flatnonzero(away < distance):
        distance[k], nearest[k] = away[k], shapes


def _told(study: Study, entry: dict, picked: dict[int, tuple]) -> tuple[dict, bool]:
    """Return an entry with the values of the vibrations that were picked, NaN and a warning where none is alike; are all?"""
    words = []
    for mode, (alike, _) in picked.items():
        if alike < 0.0:
            words.append(f"mode {mode}: other bodies or meshes than the study's deck, whose shapes cannot be followed")
        elif alike < ALIKE:
            words.append(f"no vibration is like mode {mode} of the design nearest to this one (at most {alike:.2g} of 1)")

    def value(one: Scalar, measured: float) -> float:
        if not one.mode:
            return measured
        alike, vibration = picked[one.mode]
        return vibration[one.measure == "damping_ratio"] if alike >= ALIKE else math.nan

    values = [value(*both) for both in zip(study.scalars, entry["values"])]
    return {**entry, "values": values, "warnings": [*entry["warnings"], *words]}, not words
