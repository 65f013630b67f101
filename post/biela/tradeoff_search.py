"""The search: the cheapest adequate setting of a model, and what can be taken out of the model greedily."""

from __future__ import annotations

import math

from . import deck_models
from .deck_runs import Outcome, OutOfTimeError
from .deck_text import DeckText
from .tradeoff_errors import RunError, between
from .tradeoff_settings import Setting
from .tradeoff_study import Point, Step, Study

EFFECT = 0.5  # an effect that the cheapest adequate setting leaves open is measured with an error below this share of the room
GIVE_UP = 3.0  # a method is given up where a run of it, not accurate enough, costs this many times the best one of another method
GAIN = 0.97  # a removal pays where it lowers the cost below this share


def adequate(study: Study, model: str, deck: DeckText, start: Setting, cost_limit: float, stage: str) -> Point | None:
    """Return the coarsest setting of a family that meets the tolerance, from a first guess.

    None where none does at a cost below `cost_limit` seconds.
    """
    best, worse, setting = None, float("inf"), start
    coarser = [p for p in study.points if p.model == model and p.setting.family == start.family and p.setting.index <= start.index]
    if any(study.ranking_cost(p) > cost_limit for p in coarser):
        return None
    while setting.exists():
        point = study.measure(model, deck, [setting], stage)[0]
        if point.error.largest <= study.allowed_error:
            best = point
            break
        stuck = point.outcome.ok and point.error.largest > 0.8 * worse and point.error.largest < 1.0
        if point.outcome.status == -1 or (point.outcome.ok and (stuck or study.ranking_cost(point) > cost_limit)):
            return None
        worse = point.error.largest
        allowed = study.allowed_error
        setting = setting.better(min(point.error.largest / allowed, 1.0e6)) if allowed > 0.0 else setting.doubled()
    while best and best.setting.index > 0:
        coarser = study.measure(model, deck, [best.setting.finer(-1)], stage)[0]
        if coarser.error.largest > study.allowed_error:
            break
        best = coarser
    return best


def cheapest(
    study: Study,
    model: str,
    deck: DeckText,
    starts: dict[str, Setting],
    cost_limit: float,
    stage: str,
    families: list[str] | None = None,
) -> Point | None:
    """Return the cheapest adequate point of a model over the families; the starts are moved to what was found."""
    found = []
    for family in families or study.families:
        limit = min([cost_limit, *(GIVE_UP * study.ranking_cost(point) for point in found)])
        point = adequate(study, model, deck, starts.get(family, Setting(family, 0)), limit, stage)
        if point:
            found.append(point)
            starts[family] = point.setting
    return min(found, key=study.ranking_cost, default=None)


def simplify(study: Study, deck: DeckText, best: Point, effects: list[Setting], starts: dict[str, Setting]) -> list[Point]:
    """Remove parts of a model that the sensors do not need, one at a time, the one that saves most first.

    Args:
        study: what is shared
        deck: the model to start from
        best: its cheapest adequate point
        effects: the cheapest settings of different methods whose error leaves room for that of a smaller model
        starts: first guess of the adequate setting by family

    Returns:
        the cheapest adequate point of each model on the way, the full model's first
    """
    path, rejected, turn, name = [best], set(), 0, best.model
    while options := [c for c in study.removals(deck) if c.label not in rejected]:
        turn += 1
        try:
            step, change = _round(study, turn, (deck, options), path[-1], name, effects, starts) or (None, None)
            rejected |= {s.label for s in study.steps if s.round == turn and not s.effect.largest <= study.allowed_error}
            if step is None:
                break
            step.taken, deck, name = True, change.deck, step.best.model
            path.append(step.best)
            path[-1] = cheapest(study, name, deck, starts, study.ranking_cost(step.best), f"round {turn}: methods") or step.best
        except OutOfTimeError:
            break
    return path


def _round(
    study: Study,
    turn: int,
    models: tuple[DeckText, list[deck_models.Change]],
    last: Point,
    name: str,
    effects: list[Setting],
    starts: dict[str, Setting],
) -> tuple[Step, deck_models.Change] | None:
    """Return the removal that saves most, with its cheapest adequate point; None where none saves anything.

    Args:
        study: what is shared
        turn: number of the round
        models: the model of the last round, and what can be removed from it
        last: cheapest adequate point of that model
        name: of that model
        effects: settings by which effects are measured
        starts: first guess of the adequate setting by family
    """
    deck, options = models
    titles = [change.label if turn == 1 else f"{name}; {change.label}" for change in options]
    tried = _effects(study, turn, deck, list(zip(titles, options)), effects)
    fit = [(step, change) for step, change in zip(tried, options) if step.effect.largest <= study.allowed_error]
    fit = _promising(study, fit)
    own = [last.setting.family] if len(fit) > 3 else None

    def price(pair: tuple[Step, deck_models.Change]) -> Point | None:
        step, change = pair
        title = titles[tried.index(step)]
        stage = f"round {turn}: settings without {step.label}"
        return cheapest(study, title, change.deck, dict(starts), 2.0 * study.ranking_cost(last), stage, own)

    for (step, _), best in zip(fit, study.runner.spread(price, fit)):
        step.best = best
    fit = [(step, change) for step, change in fit if step.best and study.ranking_cost(step.best) < GAIN * study.ranking_cost(last)]
    return min(fit, key=lambda pair: study.ranking_cost(pair[0].best), default=None)


def _promising(study: Study, fit: list[tuple[Step, deck_models.Change]]) -> list[tuple[Step, deck_models.Change]]:
    """Return the removals whose cost is worth measuring.

    A rigid body is cheaper than any other model of it; of the smaller meshes and numbers of modes that fit, the smallest is
    tried, and the smallest that leaves half of the tolerance to the time integration.
    """
    kept = []
    rigid = {change.body for _, change in fit if change.kind == "rigid"}
    for step, change in fit:
        same = [(s, c) for s, c in fit if (c.body, c.kind) == (change.body, change.kind) and c.count < change.count]
        half = 0.5 * study.allowed_error
        beaten = bool(same) and (step.change > half or min(s.change for s, _ in same) <= half)
        if change.kind == "rigid" or not (beaten or change.body in rigid):
            kept.append((step, change))
    return kept


def _effects(
    study: Study, turn: int, deck: DeckText, options: list[tuple[str, deck_models.Change]], settings: list[Setting]
) -> list[Step]:
    """Return the removals with their measured effects, and keep them.

    The cheapest adequate setting tells how much a removal changes. One that changes less than is left for errors, but has no room
    beside the setting's own error, is measured with the next setting too, and so is one whose run fails: the smaller error counts.
    """
    stage = f"round {turn}: what each removal changes"
    found = [Step(turn, change.label, RunError(math.inf, math.inf, ""), note="not run") for _, change in options]
    study.steps += found
    for setting in settings:
        doubtful = [k for k, step in enumerate(found) if step.note or step.change <= study.allowed_error < step.effect.largest]
        texts = [study.text(model, setting) for model in (deck, *(options[k][1].deck for k in doubtful))]
        ended = None
        try:
            outcomes = study.runner.all(texts, stage)
        except OutOfTimeError as fault:
            ended, outcomes = fault, [study.runner.stored(text) for text in texts]
        for k, outcome in zip(doubtful, outcomes[1:]):
            for point in study.keep(options[k][0], options[k][1].deck, [setting], [outcome]):
                _take(study, found[k], point, outcomes[0])
        if ended:
            raise ended
    return found


def _take(study: Study, step: Step, point: Point, before: Outcome | None) -> None:
    """Put a run into a removal's step where it is the first or errs less; before: the larger model by the same setting."""
    if step.note or point.error.largest < step.effect.largest:
        step.effect, step.note = point.error, point.outcome.message
        step.change = between(point.outcome, before, study.compared) if before else math.inf
