"""A part of `make faults` on a short run, and faults of a program that `make faults` must notice."""

from __future__ import annotations

import random
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "faults"))

import faults

SHORT = "&transient t_end=0.004 output_step=2e-4 motion_step=1e-3 checkpoint_interval=4e-4 method='generalized_alpha' step=2e-5 /\n"


@pytest.fixture(scope="module")
def place(biela, tmp_path_factory):
    """Return a folder with a short run."""
    return faults.Place(biela, tmp_path_factory.mktemp("faults") / "place", SHORT)


@pytest.mark.parametrize(
    ("family", "count"),
    [(faults.interruptions, 8), (faults.failing_calls, 0), (faults.limits, 2), (faults.damaged_checkpoints, 40)],
    ids=lambda value: getattr(value, "__name__", value),
)
def test_a_fault_ends_a_run_as_stated(family, count, place):
    found = family(place, random.Random(1), count)
    assert len(found) >= max(count, 2)
    assert [fault for fault in found if fault] == []


def test_what_is_not_as_stated_is_noticed(place):
    place.clear()
    place.run()
    assert place.after(0, "") == ""
    (place.results / "history.txt").write_text("0.0 1.0")
    assert place.after(0, "") == "status 0 and other results"
    assert place.after(143, "stopped") == "history.txt ends within a line"
    assert place.after(3, "") == "status 3 without a message"
    (place.results / ".lock").write_text("")
    assert place.after(3, "said") == "a lock is left"
