"""Errors against a converged reference, and how far the reference itself can be trusted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .compare import scales
from .deck_runs import Outcome, RunsError
from .histories import Event, History

NOISE = 1.0e-11  # a column that varies less than this share of the others of its unit, or of the scene's size, is rounding


@dataclass(frozen=True)
class Truth:
    """What errors are measured against.

    Attributes:
        names: columns
        times: shape (rows,) [s]
        values: shape (rows, columns)
        scale: what each column's error is divided by: its range, shape (columns,)
        uncertainty: largest error that the truth itself may have over columns and times, relative to the ranges
        words: how it was made
        events: at which stops and joints change their states
    """

    names: tuple[str, ...]
    times: np.ndarray
    values: np.ndarray
    scale: np.ndarray
    uncertainty: float
    words: str
    events: tuple[Event, ...] = ()


@dataclass(frozen=True)
class RunError:
    """Difference of a run from a truth, relative to the ranges: the worst column's largest and root mean square.

    At an event accelerations, friction and reactions jump. At rows where a stop or joint has another state in the run than in the
    truth, between the times that both have for one event, they differ by the jump, however small the error of the time is: these
    rows are left out. The part of the time during which states differ is an error of its own, that of the events.

    Attributes:
        each: the largest difference of each column, and of the events where there are any
    """

    largest: float
    rms: float
    column: str
    each: dict[str, float] = field(default_factory=dict)

    def without(self, sensor: str) -> float:
        """Return the largest difference over the columns of all other sensors."""
        return max((error for name, error in self.each.items() if name.split(".")[0] != sensor), default=self.largest)


@dataclass(frozen=True)
class Compared:
    """What of a run is compared, and with what.

    Attributes:
        sizes: what motions of the scene's size are, by unit
        columns: names of the columns; none: all of the sensors
        sensors: names of the sensors in lower case; none: all
    """

    sizes: dict[str, float]
    columns: frozenset[str] = frozenset()
    sensors: frozenset[str] = frozenset()

    def has(self, name: str) -> bool:
        """Whether a column belongs to one of the sensors."""
        return not self.sensors or name.partition(".")[0].lower() in self.sensors


EVENTS = "events"  # the error of their times stands under this name beside those of the columns


def _states(events: Sequence[Event], element: str, start: str, times: np.ndarray) -> np.ndarray:
    """Return the state of a stop or joint at each time, in words; rebounds from a rigid stop that follow each other are counted.

    Args:
        events: of a run
        element: name of the stop or joint
        start: its state before its first event
        times: just before which the state is meant, shape (rows,) [s]
    """
    own = [event for event in events if event.element == element]
    words, rebounds = [start], 0
    for event in own:
        rebounds = rebounds + 1 if event.after.endswith("rebound") else 0
        words.append(f"{event.after} {rebounds}")
    return np.array(words)[np.searchsorted([event.time for event in own], times)]


def state_differences(run: Sequence[Event], truth: Sequence[Event], times: np.ndarray) -> tuple[np.ndarray, float]:
    """Compare the states of all stops and joints of two runs.

    Returns:
        whether any state differs, at each of the times
        the largest part of the time during which the states of one differ
    """
    differs, longest = np.zeros(len(times), dtype=bool), 0.0
    starts = {event.element: event.before for event in reversed([*run, *truth])}
    ends = np.unique(np.clip([times[0], times[-1], *(event.time for event in (*run, *truth))], times[0], times[-1]))
    for element, start in starts.items():
        before, after = (_states(events, element, start, times) for events in (run, truth))
        differs |= before != after
        before, after = (_states(events, element, start, ends[1:]) for events in (run, truth))
        longest = max(longest, float(np.diff(ends)[before != after].sum() / (times[-1] - times[0])))
    return differs, longest


def sizes_of(length: float, interval: float) -> dict[str, float]:
    """Return by unit what a motion of the scene's own size [m] within the interval of comparison [s] is."""
    own = {"m": length, "rad": 1.0}
    return {unit + per: size / interval**k for unit, size in own.items() for k, per in enumerate(("", "/s", "/s2"))}


def scale_of(outcome: Outcome, sizes: dict[str, float]) -> np.ndarray:
    """Return what the error of each column is divided by, shape (columns,).

    That is the rule of post/compare.py, with more taken for rounding: it is measured by the largest column of the unit, by the
    size of the scene (a fixed point's motion), or by the force of the same reaction (its moment where all are rounding).
    """
    names = ["t", *outcome.names]
    history = History(Path("reference"), names, dict(zip(names, ["s", *outcome.units])), outcome.data)
    found = scales(history, history.units)
    for name in outcome.names:
        if name.endswith(".m") and name[:-2] + ".fx" in found:
            force = max(found[name[:-2] + ".fx"], found[name[:-2] + ".fy"])
            found[name] = max(found[name], NOISE * force)
    units = dict(zip(outcome.names, outcome.units))
    largest = {unit: max([sizes.get(unit, 0.0), *(found[n] for n in units if units[n] == unit)]) for unit in units.values()}
    for name, unit in units.items():
        if found[name] < NOISE * (largest[unit] if unit else 0.0):
            found[name] = largest[unit]
    return np.array([found[name] for name in outcome.names])


def rounding_columns(outcome: Outcome, sizes: dict[str, float]) -> list[str]:
    """Return the columns that only rounding moves, as the solver has found; none where all do.

    Where it has said nothing: those that move little beside the largest of their unit or the scene's size.
    """
    if outcome.still is not None:
        return list(outcome.still) if len(outcome.still) < len(outcome.names) else []
    moved = np.ptp(outcome.data[:, 1:], axis=0)
    units = dict(zip(outcome.names, outcome.units))
    largest = {unit: max([sizes.get(unit, 0.0), *moved[[one == unit for one in outcome.units]]]) for unit in units.values()}
    forces = max((moved[k] for k, unit in enumerate(outcome.units) if unit == "N"), default=0.0)
    largest["Nm"] = max(largest.get("Nm", 0.0), forces * sizes.get("m", 0.0))
    found = [name for name, move in zip(outcome.names, moved) if units[name] and move < NOISE * largest[units[name]]]
    return found if len(found) < len(outcome.names) else []


def is_state(name: str) -> bool:
    """Return whether a column counts or jumps: states of stops, friction and limits, shares, the place of the largest stress.

    An event between two rows is wrong by all of the range there, however small the error of its time.
    """
    return name.endswith((".state", ".share", ".limited", ".element", ".node"))


def truth_of(outcome: Outcome, compared: Compared, uncertainty: float = 0.0, words: str = "") -> Truth:
    """Return a run as the truth, without the columns that are rounding or states, unless they were asked for."""
    idle = {*rounding_columns(outcome, compared.sizes), *filter(is_state, outcome.names)}
    own = set(filter(compared.has, outcome.names))
    wanted = compared.columns or own - idle or own
    keep = [k for k, name in enumerate(outcome.names) if name in wanted]
    scale = scale_of(outcome, compared.sizes)[keep]
    names = tuple(outcome.names[k] for k in keep)
    return Truth(names, outcome.data[:, 0], outcome.data[:, 1:][:, keep], scale, uncertainty, words, outcome.events)


def as_truth(outcome: Outcome, like: Truth) -> Truth:
    """Return a run as a truth, with the columns and scales of another one."""
    order = [outcome.names.index(name) for name in like.names]
    return Truth(like.names, outcome.data[:, 0], outcome.data[:, 1:][:, order], like.scale, 0.0, "", outcome.events)


def error_of(run: Outcome, truth: Truth) -> RunError:
    """Return the error of a run; infinite where it failed. RunsError: the run has other columns or times."""
    if not run.ok:
        return RunError(float("inf"), float("inf"), run.message)
    columns = [run.names.index(name) for name in truth.names if name in run.names]
    if len(columns) < len(truth.names):
        missing = next(name for name in truth.names if name not in run.names)
        raise RunsError(f"a run lacks the column {missing}")
    rows = np.rint(np.interp(truth.times, run.data[:, 0], np.arange(len(run.data)))).astype(int)
    if np.abs(run.data[rows, 0] - truth.times).max() > 1.0e-6 * (truth.times[1] - truth.times[0]):
        raise RunsError("a run lacks rows at the times of the reference")
    off = np.abs(run.data[rows, 1:][:, columns] - truth.values) / truth.scale
    differs, late = state_differences(run.events, truth.events, truth.times)
    off[differs] = 0.0
    rms = np.sqrt(np.mean(off**2, axis=0))
    each = dict(zip(truth.names, off.max(axis=0).tolist()))
    if run.events or truth.events:
        each[EVENTS] = late
    worst = max(each, key=each.get)
    return RunError(each[worst], float(rms.max()), worst, each)


def between(a: Outcome, b: Outcome, compared: Compared) -> float:
    """Return the largest difference of two runs relative to the ranges of the second, infinite where one failed."""
    return error_of(a, truth_of(b, compared)).largest if a.ok and b.ok else float("inf")


def richardson(coarse: float, fine: float, ratio: float, order: float) -> float:
    """Return the error left in the finest of three levels.

    Args:
        coarse: difference of the first two levels
        fine: difference of the last two
        ratio: of the steps of neighbouring levels
        order: of the method; the observed order counts where it is lower, and never one below 1
    """
    seen = np.log(coarse / fine) / np.log(ratio) if coarse > 0.0 and fine > 0.0 and np.isfinite(coarse) else 1.0
    used = min(max(seen, 1.0), order)
    return fine / (ratio**used - 1.0)
