"""What a run of a trade-off is measured by: its errors against a converged truth, and its cost."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .compare import matching_rows, scales
from .histories import Event, History, read, read_events, read_summary, still_columns
from .result_files import HistoryError
from .sweep_scalars import Measured

EVENTS = "events"  # the error of their times stands under this name beside those of the columns
STATES = (".state", ".share", ".limited", ".element", ".node")  # columns that count or jump
COSTS = ("rms", "seconds", "evaluations", "solves", "unknowns", "steps")


@dataclass(frozen=True)
class Errors:
    """Measures runs against the truth, relative to the ranges of its columns.

    At rows where a stop or joint has another state than in the truth columns differ by the jump of an event, however small the
    error of its time is: these rows are left out. The part of the time during which states differ is an error of its own.
    """

    truth: str  # folder of its results
    columns: tuple[str, ...]  # that are compared
    scales: tuple[float, ...]  # what the error of each is divided by
    digest: str  # of its history and events

    @property
    def names(self) -> list[str]:
        """Of what is measured: the largest error of each column, the share of the time with other states, then rms and costs."""
        return [*self.columns, EVENTS, *COSTS]

    def of(self, folder: Path) -> Measured:
        """Return the errors and costs of a run; ValueError where it has other columns or times."""
        try:
            values = [*self.errors(folder), *_costs(read_summary(folder))]
        except HistoryError as fault:
            raise ValueError(str(fault)) from None
        return Measured(values, [""] * len(values))

    def errors(self, folder: Path) -> list[float]:
        """Return the largest error of each column, that of the events, and the largest root mean square over time."""
        truth, happened = _truth(self.truth, self.digest)
        run, own = read(folder), read_events(folder)
        rows = matching_rows(run, truth)
        off = np.abs([run[name][rows] - truth[name] for name in self.columns]) / np.array(self.scales)[:, None]
        differs, late = state_differences(own, happened, truth.time)
        off[:, differs] = 0.0
        return [*off.max(axis=1).tolist(), late, float(np.sqrt(np.mean(off**2, axis=1)).max())]


@functools.lru_cache(maxsize=4)
def _truth(folder: str, digest: str) -> tuple[History, list[Event]]:  # noqa: ARG001
    """Return the history and the events of the truth, once a worker."""
    return read(folder), read_events(folder)


def _costs(figures: dict) -> list[float]:
    """Return seconds of the processor without start-up, evaluations (residuals of implicit steps too), solves, unknowns, steps."""
    run, model = figures["transient"], figures["model"]
    evaluations = run["evaluations"] + run.get("residual_evaluations", run.get("newton_iterations", 0))
    unknowns = 2 * (model["coordinates"] + model["dissipative_coordinates"])
    unknowns -= model.get("dissipative_coordinates_of_first_order", 0)
    seconds, steps = figures["timing"]["processor_seconds"], run["steps"] + run.get("rejected", 0)
    return [seconds, *map(float, (evaluations, run.get("banded_solves", 0), unknowns, steps))]


def against(folder: Path, wanted: Sequence[str]) -> Errors:
    """Return what measures runs against the truth in a folder, by sensors or columns in lower case (all but rounding, states)."""
    history = read(folder)
    idle = {*(still_columns(read_summary(folder)) or {}), *(name for name in history.names if name.endswith(STATES))}
    low = [name.lower() for name in history.names]
    if missing := [word for word in wanted if "." in word and word not in low]:
        have = ", ".join(name for name in history.names if name.lower().partition(".")[0] == missing[0].partition(".")[0])
        raise HistoryError(f"no column {missing[0]!r}; its sensor has {have}")
    named = [name for name in history.names[1:] if "." in name and name.lower() in wanted]
    own = [name for name in history.names[1:] if not wanted or name.partition(".")[0].lower() in wanted]
    columns = [*named, *(name for name in own if name not in {*idle, *named})] or own
    found = scales(history, history.units)
    digest = hashlib.sha256(history.data.tobytes() + repr(read_events(folder)).encode()).hexdigest()
    return Errors(str(folder.resolve()), tuple(columns), tuple(found[name] for name in columns), digest)


def _states(events: Sequence[Event], element: str, start: str, times: np.ndarray) -> np.ndarray:
    """Return the state of a stop or joint just before each time, in words; rebounds that follow each other are counted."""
    own = [event for event in events if event.element == element]
    words, rebounds = [start], 0
    for event in own:
        rebounds = rebounds + 1 if event.after.endswith("rebound") else 0
        words.append(f"{event.after} {rebounds}")
    return np.array(words)[np.searchsorted([event.time for event in own], times)]


def state_differences(run: Sequence[Event], truth: Sequence[Event], times: np.ndarray) -> tuple[np.ndarray, float]:
    """Return whether any state of two runs differs at each time, and the largest part of the time that one differs."""
    differs, longest = np.zeros(len(times), dtype=bool), 0.0
    starts = {event.element: event.before for event in reversed([*run, *truth])}
    ends = np.unique(np.clip([times[0], times[-1], *(event.time for event in (*run, *truth))], times[0], times[-1]))
    for element, start in starts.items():
        before, after = (_states(events, element, start, times) for events in (run, truth))
        differs |= before != after
        before, after = (_states(events, element, start, ends[1:]) for events in (run, truth))
        longest = max(longest, float(np.diff(ends)[before != after].sum() / (times[-1] - times[0])))
    return differs, longest
