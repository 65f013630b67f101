"""Optimisation problems with known answers, and runs of them without a solver: what `post/optimise.py` is held to.

Each function returns the values of all results, by their names, at values of the parameters; NaN is a run that fails.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Callable

from biela.study_runs import Future
from biela.sweep_run import Batch, Row


@dataclass(frozen=True)
class Problem:
    """A problem.

    Attributes:
        function: of the parameters, by name, to the results, by name
        ends: of each parameter; a list: values that it may take
        best: 'min f' or 'max f'
        where: limits
        answer: the best value, from the literature or by hand
        within: by which relative error it has to be met
    """

    function: Callable[..., dict]
    ends: dict
    best: str
    where: tuple[str, ...]
    answer: float
    within: float = 1.0e-4
    starts: int = 3
    options: dict = field(default_factory=dict)


def _rosenbrock(x, y):
    return {"f": 100 * (y - x * x) ** 2 + (1 - x) ** 2, "g": x * x + y * y}


def _hock_schittkowski_71(a, b, c, d):
    return {"f": a * d * (a + b + c) + c, "g": a * b * c * d, "h": a * a + b * b + c * c + d * d}


def _himmelblau(x, y):
    return {"f": 1.0 + (x * x + y - 11) ** 2 + (x + y * y - 7) ** 2}


def _camel(x, y):
    return {"f": (4 - 2.1 * x**2 + x**4 / 3) * x**2 + x * y + (4 * y**2 - 4) * y**2}


def _branin(x, y):
    ring = y - 5.1 / (4 * math.pi**2) * x * x + 5 / math.pi * x - 6
    return {"f": ring**2 + 10 * (1 - 1 / (8 * math.pi)) * math.cos(x) + 10}


def _double_well(x):
    return {"f": (x * x - 1) ** 2 + 0.3 * x}


def _spring(d, coil, turns):
    """Arora's tension spring: mass, deflection, shear stress, surge frequency, outer diameter."""
    ratio = (4 * coil**2 - d * coil) / (12566 * (coil * d**3 - d**4)) + 1 / (5108 * d * d)
    surge = 140.45 * d / (coil**2 * turns)
    return {"f": (turns + 2) * coil * d * d, "g": coil**3 * turns / (71785 * d**4), "s": ratio, "w": surge, "o": (coil + d) / 1.5}


def _truss(a, b):
    """Three bars, stresses over 2 kN/cm2."""
    wide = math.sqrt(2.0)
    return {
        "f": 100 * (2 * wide * a + b),
        "s": 2 * (wide * a + b) / (wide * a * a + 2 * a * b),
        "t": 2 * b / (wide * a * a + 2 * a * b),
        "u": 2 / (wide * b + a),
    }


def _beam(h, length, t, b):
    """Ragsdell's welded beam: cost, shear, bending stress, deflection, buckling load."""
    force, arm, young, shear = 6000.0, 14.0, 30e6, 12e6
    direct = force / (math.sqrt(2) * h * length)
    radius = math.sqrt(length**2 / 4 + ((h + t) / 2) ** 2)
    polar = 2 * math.sqrt(2) * h * length * (length**2 / 12 + ((h + t) / 2) ** 2)
    turn = force * (arm + length / 2) * radius / polar
    load = 4.013 * young * math.sqrt(t * t * b**6 / 36) / arm**2 * (1 - t / (2 * arm) * math.sqrt(young / (4 * shear)))
    return {
        "f": 1.10471 * h * h * length + 0.04811 * t * b * (14 + length),
        "tau": math.sqrt(direct**2 + 2 * direct * turn * length / (2 * radius) + turn**2),
        "sigma": 6 * force * arm / (b * t * t),
        "d": 4 * force * arm**3 / (young * t**3 * b),
        "p": load,
        "thin": h - b,
    }


def _tubes(wide, wall, long):
    """A tube of a catalogue under a load: mass, stress; wide and wall come from lists, the length is free."""
    inner = wide - 2 * wall
    inertia = math.pi / 64 * (wide**4 - inner**4)
    return {
        "f": math.pi / 4 * (wide**2 - inner**2) * long,
        "s": 500 * long * wide / 2 / inertia,
        "d": 500 * long**3 / 3 / 7e4 / inertia,
    }


def _absorber(ratio, damping):
    """Den Hartog's absorber of a twentieth of the mass: the worse of two resonances (a kink at the optimum)."""
    mass, peaks = 0.05, []
    for ends in ((0.5, 0.96), (0.96, 1.5)):
        low, high = ends
        for _ in range(2):
            grid = [low + (high - low) * k / 60 for k in range(61)]
            values = []
            for g in grid:
                top = (2 * damping * g) ** 2 + (g * g - ratio**2) ** 2
                bottom = (2 * damping * g) ** 2 * (g * g - 1 + mass * g * g) ** 2
                bottom += (mass * ratio**2 * g * g - (g * g - 1) * (g * g - ratio**2)) ** 2
                values.append(math.sqrt(top / bottom))
            k = max(range(61), key=lambda k: values[k])
            low, high = grid[max(k - 1, 0)], grid[min(k + 1, 60)]
        peaks.append([grid[k], values[k]])
    peaks.sort(key=lambda one: -one[1])
    return {"f": peaks[0][1], "extremes": peaks}


def _holes(x, y):
    """A paraboloid whose runs fail beside a wall that is no limit."""
    failed = x + y < 1.0
    return {"f": math.nan if failed else x * x + 2 * y * y}


PROBLEMS = {
    "Rosenbrock in a disk": Problem(_rosenbrock, {"x": (-2, 2), "y": (-2, 2)}, "min f", ("g <= 1",), 0.0456748),
    "Hock and Schittkowski 71": Problem(
        _hock_schittkowski_71, dict.fromkeys("abcd", (1, 5)), "min f", ("g >= 25", "h <= 40"), 17.0140173
    ),
    "Himmelblau, four minima": Problem(_himmelblau, {"x": (-5, 5), "y": (-5, 5)}, "min f", (), 1.0),
    "camel, two of six minima": Problem(_camel, {"x": (-2, 2), "y": (-1, 1)}, "min f", (), -1.0316285),
    "Branin, three minima": Problem(_branin, {"x": (-5, 10), "y": (0, 15)}, "min f", (), 0.3978874),
    "double well": Problem(_double_well, {"x": (-2, 2)}, "min f", (), -0.3054289),
    "tension spring": Problem(
        _spring,
        {"d": (0.05, 0.2), "coil": (0.25, 1.3), "turns": (2, 15)},
        "min f",
        ("g >= 1", "s <= 1", "w >= 1", "o <= 1"),
        0.0126652,
    ),
    "three bars": Problem(_truss, {"a": (0.01, 1), "b": (0.01, 1)}, "min f", ("s <= 2", "t <= 2", "u <= 2"), 263.8958),
    "welded beam": Problem(
        _beam,
        {"h": (0.125, 5), "length": (0.1, 10), "t": (0.1, 10), "b": (0.1, 5)},
        "min f",
        ("tau <= 13600", "sigma <= 30000", "d <= 0.25", "p >= 6000", "thin <= 0"),
        1.7248523,
    ),
    "tubes of lists": Problem(
        _tubes,
        {"wide": [float(k) for k in range(10, 41, 2)], "wall": [1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0], "long": (200.0, 500.0)},
        "min f",
        ("s <= 100", "d <= 2"),
        23247.7856,
    ),
    "absorber, equal peaks": Problem(_absorber, {"ratio": (0.8, 1.1), "damping": (0.02, 0.4)}, "min f", (), 6.4078, 1.0e-3),
    "runs that fail": Problem(_holes, {"x": (-1, 2), "y": (-1, 2)}, "min f", (), 2.0 / 3.0, 2.0e-3),
}


def study_text(problem: Problem, deck: str, runs: int = 1000) -> str:
    """Return the study of a problem; deck: any that has its parameters."""
    text = f"deck = '{deck}'\nbest = '{problem.best}'\nwhere = {list(problem.where)!r}\nstarts = {problem.starts}\nruns = {runs}\n"
    for name, ends in problem.ends.items():
        values = f"values = {ends}" if isinstance(ends, list) else f"from = {ends[0]}\nto = {ends[1]}"
        text += f"[[parameter]]\nname = '{name}'\n{values}\n"
    middle = {name: ends[0] if isinstance(ends, list) else 0.6 * ends[1] + 0.4 * ends[0] for name, ends in problem.ends.items()}
    for name in problem.function(**middle):
        if name != "extremes":
            text += f"[[result]]\nname = '{name}'\nmeasure = 'peak'\ncolumn = '{name}'\n"
    return text


def deck_text(problem: Problem) -> str:
    """Return a deck with the parameters of a problem, for what reads the deck before runs."""
    return "".join(f"&parameter name='{name}' value=1 /\n" for name in problem.ends) + "&body name='b' mass=1 inertia=1 /\n"


class Pool:
    """An executor whose runs are a function of Python."""

    def __init__(self, function: Callable[..., dict]) -> None:
        self.function, self.runs = function, 0

    def submit(self, _: Callable, batch: Batch) -> Future:
        """Work at once."""
        future, rows = Future(), []
        for number, settings in batch.runs.items():
            self.runs += 1
            point = {name: float(value) for name, value in (word.split("=") for word in settings if "/" not in word)}
            found = self.function(**point)
            peaks = found.pop("extremes", None)
            values = list(found.values())
            reason = "" if all(map(math.isfinite, values)) else "the solver failed"
            extremes = [peaks or [] for _ in values] if batch.extremes else []
            errors = [1.0e-12 * abs(value) for value in values] if batch.check else []
            rows.append(
                Row([] if reason else values, [] if reason else [""] * len(values), extremes, errors, number=number, reason=reason)
            )
        future.set_result(rows)
        return future

    def shutdown(self, **_: object) -> None:
        """There is nothing to end."""


def write(folder: Path, problem: Problem, runs: int = 1000) -> None:
    """Write study.toml and deck.nml of a problem into a folder."""
    (folder / "deck.nml").write_text(deck_text(problem), encoding="utf-8")
    (folder / "study.toml").write_text(study_text(problem, "deck.nml", runs), encoding="utf-8")


def install(monkeypatch, folder: Path, problem: Problem, runs: int = 1000) -> Pool:
    """Write study.toml and deck.nml of a problem into a folder and let sweeps run its function; returns the executor."""
    from biela import study_runs

    write(folder, problem, runs)
    pool = Pool(problem.function)
    monkeypatch.setattr(study_runs, "ProcessPoolExecutor", lambda **_: pool)
    return pool
