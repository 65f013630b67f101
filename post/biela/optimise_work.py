"""The best design of a study: starts all over the ranges, searches from the best of them, what holds the optimum back."""

from __future__ import annotations

import argparse
import contextlib
import json
import math
from dataclasses import replace

import numpy as np

from .command import options_of
from .deck import flat_text
from .derivatives import derivatives
from .design_runs import Design, DesignRuns, RunsOverError, Space
from .design_search import Goal, Limit, Search, scales_of
from .optimum import ACTIVE, MET, Optimum, position_of
from .result_files import HistoryError, remove_noted, writing
from .run_warnings import told_once
from .sweep_run import settings_of
from .sweep_scalars import LARGEST
from .sweep_study import Study, StudyOptions
from .sweep_work import parse_goal, prepare, tell, write_table

CHOICES = 64  # combinations of the lists at most from which a search begins
SPREAD = 2.0  # sigma of the distance within which a better position of the sample rules a start out
SIMPLEX, NEAR = 0.05, 2.0e-4  # first and last size of a search without slopes, in parts of the ranges
PENALTY = 1.0e3  # of a scaled violation beside the scaled objective


def goal_of(study: Study, options: StudyOptions) -> Goal:
    """Return what the study or the options ask for; HistoryError where nothing or nonsense is asked for."""
    goal_text, conditions = options.best or study.best, [*study.where, *options.where]
    if not goal_text:
        names = ", ".join(one.name for one in study.scalars)
        raise HistoryError(f"{options.study}: best = 'min NAME' is missing, NAME one of {names}; or --best")
    sign, column, tests = parse_goal(study, goal_text, conditions)
    values = [*(one.values for one in study.parameters), *[()] * len(study.scalars)]
    for k, _, _ in [(column, "", 0.0), *tests]:
        if any(isinstance(value, str) for value in values[k]):
            raise HistoryError(f"{options.study}: the values of {study.parameters[k].name} are words, which have no limit")
    limits = tuple(Limit(k, 1 if test.startswith("<") else -1, bound) for k, test, bound in tests)
    width = len(values)
    own, signs = len(study.parameters), [(one.measure in LARGEST) * (-1 if one.measure == "min" else 1) for one in study.scalars]
    several = {own + k: one for k, one in enumerate(signs) if one}
    return Goal(sign, column, limits, np.ones(width), np.zeros(width), several)


def find(runs: DesignRuns, goal: Goal) -> Optimum:
    """Search; what was found until the runs were used up is what is returned."""
    space = Space.of(runs.study)
    found = Optimum(runs.study, space, goal)
    try:
        if not space.free:
            runs.of([space.point(np.empty(0), choice) for choice in space.choices()])
        else:
            found.goal = goal = _sample_ranges(runs, space, goal)
            _searches(runs, space, found)
    except RunsOverError:
        found.notes.append(f"runs = {runs.study.runs}: they are used up; the search was not finished")
    _take_best(runs, found)
    if found.best and space.free and not goal.violation(found.best):
        with contextlib.suppress(RunsOverError):
            _analyse_optimum(runs, space, found)
            _continue_search(runs, space, found)
    return found


def _take_best(runs: DesignRuns, found: Optimum) -> None:
    """Take the best design of all runs."""
    good = [one for one in runs.made if one.ok]
    if good:
        found.best = min(good, key=found.goal.merit)
        found.position, found.choice = position_of(found.space, found.best)


def _sample_ranges(runs: DesignRuns, space: Space, goal: Goal) -> Goal:
    """Make runs all over the ranges, one that measures its own errors, and return the goal with sizes and errors of its values."""
    choices = space.choices()
    count = max(4 * (len(space.free) + 1) // len(choices), 2) if len(choices) > 1 else 4 * (len(space.free) + 1)
    points = []
    for number, choice in enumerate(choices):
        positions = [space.start(), *space.spread_out(count - 1, seed=number)]
        points += [space.point(position, choice) for position in positions]
    designs = runs.of(points)
    good = [one for one in designs if one.ok]
    if not good:
        reasons = sorted({one.reason for one in designs})
        raise HistoryError(f"none of {len(designs)} runs all over the ranges gave its results: {reasons[0]}")
    goal = replace(goal, scales=scales_of(designs, len(goal.scales)))
    (checked,) = runs.of([min(good, key=goal.merit).point], check=True)
    return replace(goal, errors=checked.errors if checked.ok else 1.0e-6 * goal.scales)


def _searches(runs: DesignRuns, space: Space, found: Optimum) -> None:
    """Search from the best positions, then from that of each further choice."""
    ranked = sorted((one for one in runs.made if one.ok), key=found.goal.merit)
    begins = _starting_points(space, ranked, runs.study.starts)
    for position, choice in [position_of(space, design) for design in ranked]:
        if len(begins) < CHOICES and all(choice != other for _, other in begins):
            begins.append((position, choice))
    if space.combinations > CHOICES:
        found.notes.append(f"of {space.combinations} combinations of the lists the best {CHOICES} by two runs each were searched")
    for position, choice in begins:
        found.searches.append(Search(runs, space, found.goal, choice, position, found.searches).run())


def _starting_points(space: Space, ranked: list[Design], starts: int) -> list[tuple[np.ndarray, tuple]]:
    """Return the best positions without a better one of that choice nearby (Rinnooy Kan & Timmer, Math. Programming 39, 1987)."""
    count, size = len(ranked), len(space.free)
    volume = math.gamma(1.0 + size / 2.0) * SPREAD * math.log(max(count, 2)) / max(count, 2)
    distance = volume ** (1.0 / size) / math.sqrt(math.pi)
    positions = [position_of(space, design) for design in ranked]
    begins = []
    for k, (position, choice) in enumerate(positions):
        if all(choice != other or np.linalg.norm(position - there) > distance for there, other in positions[:k]):
            begins.append((position, choice))
    return begins[:starts]


def _analyse_optimum(runs: DesignRuns, space: Space, found: Optimum) -> None:
    """Take slopes at the optimum, the limits that hold it back and their prices."""
    from scipy.optimize import nnls

    goal, best = found.goal, found.best
    (checked,) = runs.of([best.point], check=True)
    found.errors = checked.errors if checked.ok else goal.errors
    found.slopes = derivatives(runs, space, best, found.position, found.choice, found.errors, goal.scales)
    widths = np.array([space.slope(k, unit) for k, unit in enumerate(found.position)])
    slopes, errors = found.slopes.values * widths, found.slopes.errors * widths
    down = goal.sign * slopes[goal.column] / goal.scales[goal.column]
    columns, active = [], []
    for limit in goal.limits:
        margin = limit.sign * (limit.bound - best.values[limit.column])
        size = max(abs(limit.bound), goal.scales[limit.column])
        if margin <= max(MET * size, found.errors[limit.column]):
            columns.append(-limit.sign * slopes[limit.column] / goal.scales[limit.column])
            active.append(limit)
    for k, unit in enumerate(found.position):
        for end, sign in ((0.0, 1.0), (1.0, -1.0)):
            if abs(unit - end) <= ACTIVE:
                columns.append(sign * np.eye(len(found.position))[k])
    if not np.isfinite(down).all() or not np.isfinite(columns).all():
        found.residual = math.inf, 0.0
        return
    several = _slopes_of_extremes(runs, found) or [down]
    # the objective's slope, or a mean of those of its extremes that are as large, is what the limits' slopes make up
    heavy = 1.0e3 * max(np.abs(several).max(), 1.0)
    sums = heavy * np.array([0.0] * len(columns) + [1.0] * len(several))
    factors, left = nnls(np.vstack([np.array([*columns, *(-one for one in several)]).T, sums]), np.append(0.0 * down, heavy))
    found.residual = float(left), float(np.linalg.norm(errors[goal.column] / goal.scales[goal.column]))
    for limit, factor in zip(active, factors):
        if factor == 0.0:  # loosening it would not move the optimum
            continue
        change = -goal.sign * limit.sign * factor * goal.scales[goal.column] / goal.scales[limit.column]
        found.prices[found.names[limit.column]] = float(change)


def _slopes_of_extremes(runs: DesignRuns, found: Optimum) -> list[np.ndarray]:
    """Return the scaled slopes of those extremes of the objective that are as large as the largest one."""
    goal, value = found.goal, found.best.values[found.goal.column]
    tolerance = max(1.0e-3 * abs(value), found.errors[goal.column])
    near = [k for k, (_, other) in enumerate(found.best.extremes[goal.column]) if abs(other - value) <= tolerance]
    if not goal.worst_of_several(goal.column, goal.sign) or len(near) < 2:
        return []
    tables, _ = Search(runs, found.space, goal, found.choice, found.position, [], central=True)._slope(found.position)
    return [goal.sign * tables[0][k] for k in near]


def _continue_search(runs: DesignRuns, space: Space, found: Optimum) -> None:
    """Go on by scipy's Nelder-Mead from an optimum whose slope is not explained: where runs fail, or at a kink, slopes do not help.

    Limits are a penalty, a run that fails is worse than all.
    """
    from scipy.optimize import minimize

    goal, here, (left, error), before = found.goal, found.position, found.residual, found.goal.merit(found.best)
    if left <= max(3.0 * error, 1.0e-3):
        return

    def merit(position: np.ndarray) -> float:
        (design,) = runs.of([space.point(position, found.choice)])
        violation, value = goal.merit(design)
        return PENALTY * violation + value / goal.scales[goal.column] if math.isfinite(violation) else math.inf

    # a simplex along no axis, whose corners stand where runs do not fail: a corner on a wall would hold all others there
    ways = SIMPLEX * np.linalg.qr(np.random.default_rng(0).normal(size=(here.size, here.size)))[0]
    fine = [one.ok for one in runs.of([space.point(here + way, found.choice) for way in ways])]
    ways = np.where(np.array(fine)[:, None], ways, -ways)
    corners = np.clip(here + np.vstack([0.5 * ways.mean(axis=0), ways]), 0.0, 1.0)
    options = {"initial_simplex": corners, "xatol": NEAR, "fatol": goal.accuracy}
    minimize(merit, here, method="Nelder-Mead", bounds=[(0.0, 1.0)] * here.size, options=options)
    _take_best(runs, found)
    if goal.merit(found.best) < before:
        _analyse_optimum(runs, space, found)


def optimise(options: StudyOptions) -> Optimum:
    """Search the best design of a study and write its files; BielaError where it cannot be run."""
    study, deck = prepare(options, design=False)
    goal, folder, space = goal_of(study, options), options.folder("optimise"), Space.of(study)
    if (least := space.combinations * (2 if space.free and space.lists else 1)) > study.runs:
        raise HistoryError(f"{options.study}: the lists allow {space.combinations} combinations: runs = {least} or more expected")
    with DesignRuns(study, deck, options, folder, only_within=not options.allow_warnings) as runs:
        found = find(runs, goal)
    found.made, found.units, found.runs, found.folder = runs.made, runs.units, runs.count, folder
    found.warnings = runs.journal.warnings + told_once((one.point, one.warnings) for one in runs.made)
    left, error = found.residual
    if found.slopes is not None and left > max(3.0 * error, 1.0e-2):
        slope = f"the slope of {found.names[found.goal.column]}"
        found.notes.append(f"{slope} is not explained by the limits (part left: {left:.2g}): a kink, or not the end")
    remove_noted(folder)
    write_table(folder / "history.csv", found.head, found.rows)
    with writing(folder / "optimum.json"):
        (folder / "optimum.json").write_text(json.dumps(found.figures, indent=1) + "\n", encoding="utf-8")
        if found.best:
            text = flat_text(options.biela, study.deck, *settings_of(study, found.best.point))
            (folder / "optimum.nml").write_text(text, encoding="utf-8")
    return found


def work(args: argparse.Namespace) -> int:
    """Search, print and draw; returns 0, or 1 where no design meets all limits."""
    found = optimise(options_of(args, StudyOptions))
    files = f"history, optimum: {found.folder}/history.csv, optimum.json, optimum.nml"
    tell("optimise", found.warnings, [*found.report, files], [] if args.no_pictures or not found.best else found.draw())
    return int(not found.feasible)
