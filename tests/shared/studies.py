"""Studies of post/tradeoff.py without a run: points whose columns are off by what a test says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from biela import deck_text
from biela.deck_runs import Outcome, Runner
from biela.tradeoff_errors import Compared, error_of, truth_of
from biela.tradeoff_settings import Setting, grid_of
from biela.tradeoff_study import FULL, Point, Study
from conftest import REFERENCE

CRANK = REFERENCE / "vrl_ghm" / "deck.nml"
TIMES = np.linspace(0.0, 1.0, 11)


ARGUMENT = """&body name='b' mass=1 inertia=1 position=1,0 /
&joint name='g' type='prismatic' body_a='b' /
&sensor name='x' quantity='position' body='b' /
&sensor name='v' quantity='velocity' body='b' /
&parameter name='k' value=9 /
&history name='s' kind='polynomial' coefficients=0,{-k} /
&force name='f' body='b' fx=1 history='s' argument='x.x' /
&transient t_end=1 method='rk4' step=1e-3 /
"""  # a force that depends on a sensor


def outcome(*values: np.ndarray, seconds: float = 1.0, names: tuple[str, ...] = ("a.x", "b.x")) -> Outcome:
    data = np.column_stack([TIMES, *values])
    counts = {"evaluations": int(1000 * seconds), "coordinates": 5}
    return Outcome(0, "", names, ("m",) * len(names), data, seconds, counts)


def study_with(tmp_path: Path, *points: Point, tolerance: float = 1e-2) -> Study:
    """Return a study with the truth a.x = b.x = t and some points; its runner's solver is no program."""
    deck = deck_text.read(CRANK)
    runner = Runner(Path(__file__), tmp_path / "kept", 1)
    truth = truth_of(outcome(TIMES, TIMES), Compared({}))
    return Study(runner, grid_of(deck), {"a", "b"}, tolerance, ["rk4"], Compared({}), truth, list(points))


def point(a: float, b: float, seconds: float, model: str = FULL, index: int = 3, family: str = "rk4") -> Point:
    """Return a point whose columns are off by a and b."""
    made = outcome(TIMES + a, TIMES + b, seconds=seconds)
    truth = truth_of(outcome(TIMES, TIMES), Compared({}))
    return Point(model, Setting(family, index), deck_text.read(CRANK), made, error_of(made, truth))
