"""The best design of a study: starts all over the ranges, searches from the best of them, what holds the optimum back."""

from __future__ import annotations

import argparse
import contextlib
import csv
import json
import math
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from . import deck_text
from .derivatives import Derivatives, derivatives
from .design_runs import Design, DesignRuns, RunsOverError
from .design_search import SAME, Goal, Limit, Search, scales_of, search_all, several_of
from .design_space import Space
from .result_files import HistoryError, remove_noted
from .sweep_run import assign, assignments, literal
from .sweep_study import Study
from .sweep_work import parse_goal, prepare

EVERY_CHOICE = 64  # combinations of the lists, each of which is searched
SPREAD = 2.0  # sigma of the distance within which a better position of the sample rules a start out
ACTIVE = 1.0e-4  # distance from a limit at which it holds the optimum back, of the value's size; or the error of its run
SIMPLEX, NEAR = 0.05, 2.0e-4  # first and last size of a search without slopes, in parts of the ranges
PENALTY = 1.0e3  # of a scaled violation beside the scaled objective
EXCHANGES = 20  # rounds in which one list after the other is tried


@dataclass
class Optimum:
    """What a search ends with.

    Attributes:
        study: that was searched
        space: of its designs
        goal: what is best
        best: the best design, None where no run came to its end
        position: of the best design in the unit cube
        choice: of the lists
        searches: in their order
        slopes: at the optimum, None without free parameters or runs
        errors: of the optimum's values
        prices: change of the objective by each limit's bound, of those that hold it back, by name of the column
        residual: part of the objective's slope that no limit explains, and what the slopes' errors explain of it
        notes: what a user should know
    """

    study: Study
    space: Space
    goal: Goal
    best: Design | None = None
    position: np.ndarray = field(default_factory=lambda: np.empty(0))
    choice: tuple = ()
    searches: list[Search] = field(default_factory=list)
    slopes: Derivatives | None = None
    errors: np.ndarray = field(default_factory=lambda: np.empty(0))
    prices: dict[str, float] = field(default_factory=dict)
    residual: tuple[float, float] = (0.0, 0.0)
    notes: list[str] = field(default_factory=list)

    @property
    def names(self) -> list[str]:
        """Of parameters and results."""
        return [one.name for one in (*self.study.parameters, *self.study.scalars)]


def goal_of(study: Study, args: argparse.Namespace) -> Goal:
    """Return what the study or the command line asks for; HistoryError where nothing or nonsense is asked for."""
    goal_text, conditions = args.best or study.best, [*study.where, *args.where]
    if not goal_text:
        names = ", ".join(one.name for one in study.scalars)
        raise HistoryError(f"{args.study}: best = 'min NAME' is missing, NAME one of {names}; or --best")
    sign, column, tests = parse_goal(study, goal_text, conditions)
    values = [*(one.values for one in study.parameters), *[()] * len(study.scalars)]
    for k, _, _ in [(column, "", 0.0), *tests]:
        if any(isinstance(value, str) for value in values[k]):
            raise HistoryError(f"{args.study}: the values of {study.parameters[k].name} are words, which have no limit")
    limits = tuple(Limit(k, 1 if test.startswith("<") else -1, bound) for k, test, bound in tests)
    width = len(values)
    return Goal(sign, column, limits, np.ones(width), np.zeros(width), several_of(study))


def find(runs: DesignRuns, goal: Goal) -> Optimum:
    """Search; what was found until the runs were used up is what is returned."""
    space = Space.of(runs.study)
    found = Optimum(runs.study, space, goal)
    try:
        if not space.free:
            _lists_alone(runs, space, found)
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
        found.position, found.choice = _position(found.space, found.best)


def _position(space: Space, design: Design) -> tuple[np.ndarray, tuple]:
    """Return position and choice of a design."""
    position = np.array([space.unit(k, design.point[one.name]) for k, one in enumerate(space.free)])
    return np.clip(position, 0.0, 1.0), tuple(design.point[one.name] for one in space.lists)


def _sample_ranges(runs: DesignRuns, space: Space, goal: Goal) -> Goal:
    """Make runs all over the ranges, one that measures its own errors, and return the goal with sizes and errors of its values."""
    choices = space.choices() if space.combinations <= EVERY_CHOICE else _sample(space, EVERY_CHOICE)
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


def _sample(space: Space, count: int) -> list[tuple]:
    """Return some of the choices, drawn."""
    generator = np.random.default_rng(0)
    return [tuple(one.values[generator.integers(len(one.values))] for one in space.lists) for _ in range(count)]


def _searches(runs: DesignRuns, space: Space, found: Optimum) -> None:
    """Search from the best positions of each choice, from several of the best choice; then exchange items of long lists."""
    goal, ranked = found.goal, sorted((one for one in runs.made if one.ok), key=found.goal.merit)
    begins = _starting_points(space, ranked, runs.study.starts)
    if space.combinations <= EVERY_CHOICE:
        for design in ranked:
            position, choice = _position(space, design)
            if all(choice != other for _, other in begins):
                begins.append((position, choice))
    found.searches = [Search(k + 1, space, goal, choice, position) for k, (position, choice) in enumerate(begins)]
    search_all(runs, found.searches)
    if space.combinations > EVERY_CHOICE:
        found.notes.append(
            f"of {space.combinations} combinations of the lists those were searched that differ in one item from good ones"
        )
        for one in list(found.searches):
            _exchange(runs, space, found, one.best)


def _exchange(runs: DesignRuns, space: Space, found: Optimum, best: Design | None) -> None:
    """Exchange one item of the lists after the other, as long as the design gets better, and search from there."""
    goal = found.goal
    for _ in range(EXCHANGES if best else 0):
        nearest = min(runs.of(_neighbours(space, best)), key=goal.merit)
        if goal.merit(nearest) >= goal.merit(best):
            return
        position, choice = _position(space, nearest)
        best = nearest
        if space.free:
            found.searches.append(Search(len(found.searches) + 1, space, goal, choice, position))
            search_all(runs, found.searches[-1:])
            best = min((nearest, found.searches[-1].best), key=goal.merit)


def _starting_points(space: Space, ranked: list[Design], starts: int) -> list[tuple[np.ndarray, tuple]]:
    """Return the best positions without a better one of the same choice nearby: Rinnooy Kan and Timmer's distance for a sample.

    Mathematical Programming 39, 27-78 (1987): with it a search begins once in the basin of each minimum, almost surely.
    """
    count, size = len(ranked), len(space.free)
    volume = math.gamma(1.0 + size / 2.0) * SPREAD * math.log(max(count, 2)) / max(count, 2)
    distance = volume ** (1.0 / size) / math.sqrt(math.pi)
    positions = [_position(space, design) for design in ranked]
    begins = []
    for k, (position, choice) in enumerate(positions):
        if all(choice != other or np.linalg.norm(position - there) > distance for there, other in positions[:k]):
            begins.append((position, choice))
    return begins[:starts]


def _neighbours(space: Space, design: Design) -> list[dict]:
    """Return the designs that differ from one in one item of the lists."""
    return [{**design.point, one.name: value} for one in space.lists for value in one.values if value != design.point[one.name]]


def _lists_alone(runs: DesignRuns, space: Space, found: Optimum) -> None:
    """Run all combinations, or, where there are more than runs, exchange one item at a time from several drawn ones."""
    position = np.empty(0)
    if space.combinations <= runs.study.runs:
        runs.of([space.point(position, choice) for choice in space.choices()])
        return
    runs.of([space.point(position, choice) for choice in _sample(space, max(runs.study.runs // 4, 1))])
    found.notes.append(
        f"the lists allow {space.combinations} combinations, runs = {runs.study.runs}: items were exchanged one at a time"
    )
    found.goal = replace(found.goal, scales=scales_of(runs.made, len(found.goal.scales)))
    for design in sorted(runs.made, key=found.goal.merit)[: runs.study.starts]:
        _exchange(runs, space, found, design)


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
        if margin <= max(ACTIVE * size, found.errors[limit.column]):
            columns.append(-limit.sign * slopes[limit.column] / goal.scales[limit.column])
            active.append(limit)
    for k, unit in enumerate(found.position):
        for end, sign in ((0.0, 1.0), (1.0, -1.0)):
            if abs(unit - end) <= ACTIVE:
                columns.append(sign * np.eye(len(found.position))[k])
    if not np.isfinite(down).all() or not np.isfinite(columns).all():
        found.residual = math.inf, 0.0
        return
    several = [down]
    if goal.worst_of_several(goal.column, goal.sign) and len(best.extremes[goal.column]) > 1:
        several = _slopes_of_extremes(runs, found) or several
    # the objective's slope, or one of those of its extremes that are as large, is what the limits' slopes make up
    if len(several) == 1:
        matrix = np.array(columns).T if columns else np.zeros((len(down), 1))
        factors, left = nnls(matrix, down)
    else:
        heavy = 1.0e3 * max(np.abs(several).max(), 1.0)
        matrix = np.vstack(
            [np.array([*columns, *(-one for one in several)]).T, heavy * np.array([0.0] * len(columns) + [1.0] * len(several))]
        )
        factors, left = nnls(matrix, np.append(np.zeros(len(down)), heavy))
    found.residual = float(left), float(np.linalg.norm(errors[goal.column] / goal.scales[goal.column]))
    for limit, factor in zip(active, factors):
        change = -goal.sign * limit.sign * factor * goal.scales[goal.column] / goal.scales[limit.column]
        found.prices[found.names[limit.column]] = float(change)


def _slopes_of_extremes(runs: DesignRuns, found: Optimum) -> list[np.ndarray]:
    """Return the scaled slopes of those extremes of the objective that are as large as the largest one."""
    goal, best = found.goal, found.best
    probe = Search(0, found.space, goal, found.choice, found.position, central=True)
    size = goal.scales[goal.column]
    value = best.values[goal.column]
    tolerance = max(1.0e-3 * abs(value), found.errors[goal.column])
    near = [k for k, (_, other) in enumerate(best.extremes[goal.column]) if abs(other - value) <= tolerance]
    probe._ask = lambda positions: runs.of([found.space.point(position, found.choice) for position in positions])
    tables, _ = probe._slope(found.position)
    return [goal.sign * tables[0][k] for k in near] if size > 0.0 and len(near) > 1 else []


def _continue_search(runs: DesignRuns, space: Space, found: Optimum) -> None:
    """Go on from an optimum whose slope is not explained: by differences on both sides, then without slopes (Nelder & Mead).

    Where runs fail, or at a kink, the slope leads nowhere: there the second finds what the first cannot.
    """
    walled = any(not one.ok and np.abs(_position(space, one)[0] - found.position).max() <= SIMPLEX for one in runs.made)
    for attempt in (_without_slopes,) if walled else (_search_by_both_sides, _without_slopes):
        left, error = found.residual
        if left <= max(3.0 * error, 1.0e-3):
            return
        before = found.goal.merit(found.best)
        attempt(runs, space, found)
        _take_best(runs, found)
        if found.goal.merit(found.best) < before:
            _analyse_optimum(runs, space, found)


def _search_by_both_sides(runs: DesignRuns, space: Space, found: Optimum) -> None:
    """Search once more from the best design."""
    found.searches.append(Search(len(found.searches) + 1, space, found.goal, found.choice, found.position, central=True))
    search_all(runs, found.searches[-1:])


def _without_slopes(runs: DesignRuns, space: Space, found: Optimum) -> None:
    """Search around the best design by scipy's Nelder-Mead; limits are a penalty, a run that fails is worse than all."""
    from scipy.optimize import minimize

    goal, here = found.goal, found.position

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


def report(found: Optimum, runs: DesignRuns) -> list[str]:
    """Return what is printed."""
    study, goal, names = found.study, found.goal, found.names
    own = len(study.parameters)
    failed = sum(not one.ok for one in runs.made)
    lines = [f"{runs.count} runs, {failed} failed"]
    if found.best is None:
        return [*lines, "no run gave its results: " + runs.made[0].reason if runs.made else "no run was made"]
    units = [one.unit for one in study.parameters] + runs.units

    def shown(k: int) -> str:
        value = list(found.best.point.values())[k] if k < own else found.best.values[k]
        return f"{names[k]} = {value:.6g} {units[k]}".rstrip() if isinstance(value, float) else f"{names[k]} = {value}"

    goal_text = f"{'min' if goal.sign > 0 else 'max'} {names[goal.column]}"
    missed = goal.violation(found.best)
    head = f"best ({goal_text}): " if not missed else "no design meets all limits; the nearest one: "
    lines.append(head + ", ".join(map(shown, range(own))))
    lines.append("  " + ", ".join(map(shown, range(own, len(names)))))
    for limit in goal.limits:
        value, name = found.best.values[limit.column], names[limit.column]
        words = f"  limit {name} {'<' if limit.sign > 0 else '>'} {limit.bound:.6g}: "
        if limit.sign * (limit.bound - value) < 0.0:
            lines.append(words + f"missed, {name} = {value:.6g}")
        elif name in found.prices:
            price = found.prices[name] * 0.01 * (abs(limit.bound) or goal.scales[limit.column])
            lines.append(words + f"active; 1 % more changes {names[goal.column]} by {price:+.3g} {units[goal.column]}".rstrip())
        else:
            lines.append(words + f"not active, {name} = {value:.6g}")
    for k, one in enumerate(found.space.free):
        if not missed and found.slopes is not None and min(found.position[k], 1.0 - found.position[k]) <= ACTIVE:
            lines.append(f"  {one.name} is at its {'lower' if found.position[k] < 0.5 else 'upper'} end")
    lines += _ends(found)
    left, error = found.residual
    if found.slopes is not None and left > max(3.0 * error, 1.0e-2):
        found.notes.append(
            f"the slope of {names[goal.column]} is not explained by the limits (part left: {left:.2g}): a kink, or not the end"
        )
    value, good = found.best.values[goal.column], [k + 1 for k, one in enumerate(runs.made) if not goal.violation(one)]
    at = next((k for k in good if abs(runs.made[k - 1].values[goal.column] - value) <= 1.0e-3 * abs(value)), 0)
    if at:
        lines.append(f"  within 0.1 % of the best after {at} runs")
    return lines + [f"  note: {words}" for words in found.notes]


def _ends(found: Optimum) -> list[str]:
    """Return how the searches ended: at which optima."""
    goal, ends = found.goal, []
    for one in found.searches:
        if one.best is None or one.ended.startswith("another") or one.central or goal.violation(one.best):
            continue
        position, choice = _position(found.space, one.best)
        if all(choice != other or np.abs(position - there).max() > SAME for there, other, _ in ends):
            ends.append((position, choice, one.best.values[goal.column]))
    count = len([one for one in found.searches if not one.central])
    if not count:
        return []
    values = ", ".join(f"{value:.6g}" for value in sorted((value for *_, value in ends), key=lambda value: goal.sign * value)[:7])
    several = "1 search" if count == 1 else f"{count} searches"
    return [f"  {several} ended at {len(ends)} optim{'um' if len(ends) == 1 else 'a'}: {found.names[goal.column]} = {values}"] \
        if ends else [f"  {several}, none of which met all limits"]  # fmt: skip


def write_files(found: Optimum, runs: DesignRuns, folder: Path, args: argparse.Namespace, lines: list[str]) -> None:
    """Write the history of the runs, the optimum as JSON and as a deck of its own, and the sensitivities."""
    header = [one.label for one in found.study.parameters]
    header += [one.name + (f"[{unit}]" if unit else "") for one, unit in zip(found.study.scalars, runs.units)]
    own, best, rows = len(found.study.parameters), math.inf, []
    for number, design in enumerate(runs.made, 1):
        violation, value = found.goal.merit(design)
        best = min(best, value) if violation == 0.0 else best
        shown = list(design.point.values()) + ([*design.values[own:]] if design.ok else [""] * len(found.study.scalars))
        rows.append([number, *shown, violation, found.goal.sign * best if best < math.inf else "", design.reason])
    try:
        with (folder / "history.csv").open("w", encoding="utf-8", newline="") as file:
            csv.writer(file).writerows([["run", *header, "violation", "best", "failure"], *rows])
        (folder / "optimum.json").write_text(json.dumps(as_figures(found, runs, lines), indent=1) + "\n", encoding="utf-8")
        if found.best:
            (folder / "optimum.nml").write_text(_deck(found, args), encoding="utf-8")
    except OSError as fault:
        raise HistoryError(f"{fault.filename}: cannot be written ({fault.strerror})") from None


def _deck(found: Optimum, args: argparse.Namespace) -> str:
    """Return the deck of the optimum, which runs alone."""
    settings, variables = assignments(found.study, found.best.point)
    deck = deck_text.read(found.study.deck, *settings, biela=args.biela)
    for target, value in variables:
        deck = assign(deck, target, literal(value))
    return deck.text


def as_figures(found: Optimum, runs: DesignRuns, lines: list[str]) -> dict:
    """Return the optimum as JSON has it."""

    def finite(value: float) -> float | None:
        return float(value) if np.isfinite(value) else None

    own, names = len(found.study.parameters), found.names
    figures: dict = {"runs": runs.count, "failed": sum(not one.ok for one in runs.made), "report": lines, "notes": found.notes}
    if found.best:
        results = dict(zip(names[own:], map(finite, found.best.values[own:])))
        feasible = bool(found.goal.violation(found.best) == 0.0)
        figures |= {"feasible": feasible, "parameters": found.best.point, "results": results, "prices": found.prices}
    if found.slopes is not None:
        figures["sensitivities"] = {
            names[j]: {
                one.name: {"derivative": finite(found.slopes.values[j, k]), "error": finite(found.slopes.errors[j, k])}
                for k, one in enumerate(found.space.free)
            }
            for j in range(own, len(names))
        }
    return figures


def optimise(args: argparse.Namespace) -> int:
    """Search the best design; returns 0, or 1 where no design meets all limits."""
    study, text = prepare(args, design=False)
    goal = goal_of(study, args)
    folder = args.output or Path("results") / "optimise" / study.name
    with DesignRuns(study, text, args, folder, "optimise") as runs:
        found = find(runs, goal)
    lines = report(found, runs)
    remove_noted(folder)
    write_files(found, runs, folder, args, lines)
    print("\n".join(lines))
    print(f"history, optimum: {folder}/history.csv, optimum.json, optimum.nml")
    if not args.no_pictures and found.best:
        from . import optimise_picture

        for path in optimise_picture.draw(found, runs, folder):
            print(f"picture: {path}")
    return int(found.best is None or found.goal.violation(found.best) > 0.0)
