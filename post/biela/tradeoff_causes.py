"""Why a recommendation is what it is: the sensor that decides its cost, and errors that are small because larger ones cancel."""

from __future__ import annotations

from dataclasses import replace

from .deck_models import effective_removals
from .tradeoff_errors import between, error_of
from .tradeoff_search import simplify
from .tradeoff_settings import Setting
from .tradeoff_study import FULL, Point, Study
from .tradeoff_truth import Base

PARTS = ("time integration", "the mesh", "the model")
CANCEL = 2.0  # errors count as cancelling where one of them is larger than their sum by this factor
WORTH = 1.25  # a sensor decides the cost where the cost falls by more than this factor without it
EARLY = 0.7  # share of the search's time after which no second search is begun


def deciding(study: Study, base: Base, best: Point, effects: list[Setting], starts: dict[str, Setting]) -> list[str]:
    """Return the line that says which sensor decides the cost and what leaving it out would buy, none where no single one does.

    What was run points to a sensor: the one without which least is asked. The search is made again without it, where there is time.

    Args:
        study: what is shared
        base: the model that the search started from
        best: its cheapest adequate point
        effects: settings by which effects are measured
        starts: first guess of the adequate setting by family
    """
    names = sorted({name.split(".")[0] for name in study.truth.names})
    if len(names) < 2:
        return []
    cost, allowed = study.ranking_cost, study.allowed_error
    last = min((p for p in study.points if p.error.largest <= allowed), key=cost)
    asked = {name: min(cost(p) for p in study.points if p.error.without(name) <= allowed) for name in names}
    sensor = min(names, key=lambda name: (asked[name], name != last.error.column.split(".")[0]))
    others = _without(study, sensor)
    if not study.runner.late(EARLY):
        start = min((p for p in others.points if p.model == FULL and p.error.largest <= allowed), key=cost, default=best)
        simplify(others, base.deck, start, effects, dict(starts))
    cheap = min((p for p in others.points if p.error.largest <= allowed), key=cost)
    gain = cost(last) / cost(cheap)
    model = FULL if cheap.model == FULL else "; ".join(effective_removals(cheap.model.split("; ")))
    other = f"{cheap.setting.words(study.grid)}, {model}, would do, {gain:.3g} times cheaper"
    return [f"{sensor} decides the cost: without it {other}"] if gain > WORTH else []


def _without(study: Study, sensor: str) -> Study:
    """Return a study without one of the sensors; it uses the same runs."""
    keep = [k for k, name in enumerate(study.truth.names) if name.split(".")[0] != sensor]
    names = tuple(study.truth.names[k] for k in keep)
    truth = replace(study.truth, names=names, values=study.truth.values[:, keep], scale=study.truth.scale[keep])
    points = [replace(p, error=error_of(p.outcome, truth)) for p in study.points]
    compared = replace(study.compared, columns=frozenset(names))
    return replace(study, truth=truth, compared=compared, points=points, steps=[])


def cancellation(study: Study, point: Point, error: float) -> list[str]:
    """Return the line that says that a point's error is small because larger ones cancel: of its time integration, of removals.

    The time integration's is the difference from a run with steps four times finer (a hundredth of the tolerance).
    """
    outcome = study.runner.one(study.text(point.deck, point.setting.doubled().doubled()))
    found = {}
    if outcome.ok:
        found = {PARTS[0]: between(point.outcome, outcome, study.compared), PARTS[2]: error_of(outcome, study.truth).largest}
    for turn, label in enumerate([] if point.model == FULL else point.model.split("; "), 1):
        found |= {f"'{label}'": s.change for s in study.steps if (s.round, s.label) == (turn, label)}
    return offset("recommended.nml", found, error, study.tolerance)


def offset(what: str, found: dict[str, float], error: float, tolerance: float) -> list[str]:
    """Return the line that says that an error is small because larger ones cancel, none where they do not.

    They do where one alone is much larger than their sum, or misses the tolerance that the sum meets.
    """
    much = CANCEL * error if error > tolerance else min(CANCEL * error, tolerance)
    large = {name: part for name, part in found.items() if much < part < float("inf")}
    if not large:
        return []
    listed = ", ".join(f"{name} {part:.1e}" for name, part in large.items())
    return [f"{what}: its error of {error:.1e} is small because larger ones cancel: alone are off by {listed}"]
