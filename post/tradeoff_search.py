"""The search: work-precision curves of a model, its cheapest adequate setting, and what can be taken out of it greedily."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import deck_models
from deck_runs import Outcome, OutOfTimeError, Runner
from deck_text import DeckText
from tradeoff_errors import Gap, Truth, between, gap, richardson
from tradeoff_settings import FAMILIES, ORDERS, Grid, Setting, for_search

LEVELS = 14  # of a curve at most
CERTAIN = 0.05  # the reference is refined until its uncertainty is below this share of the tolerance
EFFECT = 0.1  # a removal's effect is measured with a time error below this share of the tolerance
DOUBT = 10.0  # an effect below this many tolerances is measured again with another method before the removal is given up
CALL = 40  # an evaluation costs about as much as this many unknowns, whatever is evaluated
DEAR = 3.0  # a method is given up where a run that is not adequate costs so many times what another method asks
HALF = 0.5  # share of the study's time after which curves are not refined any more
SHORT = 2.0  # [s] shorter runs are ranked by their counts: side by side, on a machine with other work, clocks err
GAIN = 0.97  # a removal is worth it where the cost falls below this share


@dataclass(frozen=True)
class Point:
    """A model with a setting: what it costs and how far it is off."""

    model: str
    setting: Setting | None
    deck: DeckText
    outcome: Outcome
    gap: Gap

    @property
    def cost(self) -> float:
        """Seconds of the analyses."""
        return self.outcome.seconds if self.outcome.ok else float("inf")


@dataclass
class Step:
    """One removal that was tried: from which round, what it changes, and the cheapest adequate setting found with it."""

    round: int
    label: str
    effect: Gap
    best: Point | None = None
    taken: bool = False
    note: str = ""


@dataclass
class Study:
    """What all searches share, and what they found.

    Attributes:
        runner: makes the runs
        grid: times of the comparison
        asked: names of the sensors
        tolerance: largest error that is accepted, relative to the range
        families: curves that are tried
        sizes: what motions of the scene's size are, by unit
        points: everything that was measured against the truth
        steps: every removal that was tried
        rates: seconds for an evaluation of one unknown, by family, from the full model's longest run
    """

    runner: Runner
    grid: Grid
    asked: set[str]
    tolerance: float
    families: list[str]
    sizes: dict[str, float]
    truth: Truth | None = None
    points: list[Point] = field(default_factory=list)
    steps: list[Step] = field(default_factory=list)
    rates: dict[str, float] = field(default_factory=dict)

    @property
    def room(self) -> float:
        """What an error may be so that it meets the tolerance whatever the truth's own error is."""
        return max(self.tolerance - self.truth.uncertainty, 0.0)

    def price(self, point: Point) -> float:
        """Return what a point is ranked by: its seconds.

        Where they are few, its counts times the seconds that such counts take in longer runs of the same method.
        """
        outcome = point.outcome
        if not outcome.ok or outcome.seconds >= SHORT or point.setting.family not in self.rates:
            return point.cost
        return outcome.evaluations * (outcome.unknowns + CALL) * self.rates[point.setting.family]

    def text(self, deck: DeckText, setting: Setting | None) -> str:
        """Return the text that is run."""
        return for_search(deck, setting, self.grid, self.asked)

    def measure(self, model: str, deck: DeckText, settings: list[Setting], stage: str) -> list[Point]:
        """Run a model with some settings and keep the points."""
        outcomes = self.runner.all([self.text(deck, s) for s in settings], stage)
        found = [Point(model, s, deck, o, gap(o, self.truth)) for s, o in zip(settings, outcomes)]
        known = {(p.model, p.setting) for p in self.points}
        self.points += [p for p in found if p.outcome.ok and (p.model, p.setting) not in known]
        return found


@dataclass(frozen=True)
class Curve:
    """Runs of one model with one family, coarse to fine, and the error left in the finest."""

    family: str
    settings: list[Setting]
    outcomes: list[Outcome]
    left: float

    @property
    def cost(self) -> float:
        """Seconds of the finest run."""
        return self.outcomes[-1].seconds if self.outcomes else float("inf")


def curve(study: Study, deck: DeckText, family: str, target: float, dearest: float, stage: str) -> Curve:
    """Refine a family by factors of two of the step (of ten of the tolerance).

    It ends where its own differences promise an error below the target, or a run would take longer than `dearest` seconds.
    """
    settings: list[Setting] = []
    outcomes: list[Outcome] = []
    left, setting = float("inf"), Setting(family, 0)
    while setting.exists() and len(outcomes) < LEVELS and left > target:
        batch = [s for s in (setting, setting.doubled()) if s.exists()]
        done = study.runner.all([study.text(deck, s) for s in batch], f"{stage}, {family}")
        setting = batch[-1].doubled()
        for s, outcome in zip(batch, done):
            if outcome.status == -1:
                return Curve(family, settings, outcomes, left)
            if outcome.ok:
                settings.append(s)
                outcomes.append(outcome)
        new = _left(study, family, outcomes)
        if new > 0.7 * left and left < 1.0e-6 and len(outcomes) > 4:
            break
        left = new
        if study.runner.late(HALF) or (outcomes and 4.0 * outcomes[-1].seconds > dearest):
            break
    return Curve(family, settings, outcomes, left)


def _left(study: Study, family: str, outcomes: list[Outcome]) -> float:
    """Return the error that the finest run of a curve has by the differences of its last three."""
    if len(outcomes) < 3:
        return float("inf")
    coarse, fine = (between(a, b, study.sizes) for a, b in zip(outcomes[-3:], outcomes[-2:]))
    if FAMILIES[family][1] == "tolerance":
        return fine
    return richardson(coarse, fine, 2.0, ORDERS[family])


def curves(study: Study, deck: DeckText, stage: str, target: float | None = None, dearest: float | None = None) -> list[Curve]:
    """Return the curves of a model, the most accurate first.

    The first family that reaches the target spares the others the finest levels.
    """
    target = CERTAIN * study.tolerance if target is None else target
    dearest = dearest or study.runner.longest
    found: list[Curve] = []
    for family in study.families:
        sharp = any(c.left <= target for c in found)
        limit = min([dearest, *(max(4.0 * c.cost, 1.0) for c in found if c.left <= target)])
        made = curve(study, deck, family, 0.3 * study.tolerance if sharp else target, limit, stage)
        found.append(made)
    return sorted((c for c in found if c.outcomes), key=lambda c: c.left)


def adequate(study: Study, model: str, deck: DeckText, start: Setting, dearest: float, stage: str) -> Point | None:
    """Return the coarsest setting of a family that meets the tolerance, from a first guess.

    None where none does at a cost below `dearest` seconds.
    """
    best, worse, setting = None, float("inf"), start
    while setting.exists():
        point = study.measure(model, deck, [setting], stage)[0]
        if point.gap.largest <= study.room:
            best = point
            break
        stuck = point.outcome.ok and point.gap.largest > 0.8 * worse and point.gap.largest < 1.0
        if point.outcome.status == -1 or (point.outcome.ok and (stuck or study.price(point) > dearest)):
            return None
        worse = point.gap.largest
        setting = setting.better(min(point.gap.largest / study.room, 1.0e6)) if study.room > 0.0 else setting.doubled()
    while best and best.setting.index > 0:
        coarser = study.measure(model, deck, [best.setting.finer(-1)], stage)[0]
        if coarser.gap.largest > study.room:
            break
        best = coarser
    return best


def cheapest(
    study: Study,
    model: str,
    deck: DeckText,
    starts: dict[str, Setting],
    dearest: float,
    stage: str,
    families: list[str] | None = None,
) -> Point | None:
    """Return the cheapest adequate point of a model over the families; the starts are moved to what was found."""
    found = []
    for family in families or study.families:
        limit = min([dearest, *(DEAR * study.price(point) for point in found)])
        point = adequate(study, model, deck, starts.get(family, Setting(family, 0)), limit, stage)
        if point:
            found.append(point)
            starts[family] = point.setting
    return min(found, key=study.price, default=None)


def greedy(study: Study, deck: DeckText, best: Point, effects: list[Setting], starts: dict[str, Setting]) -> list[Point]:
    """Take out of a model, one by one, what the sensors do not notice, the removal that saves most first.

    Args:
        study: what is shared
        deck: the model to start from
        best: its cheapest adequate point
        effects: settings of different methods whose time error is small against the tolerance
        starts: first guess of the adequate setting by family

    Returns:
        the cheapest adequate point of each model on the way, the full model's first
    """
    path, hopeless, turn, name = [best], set(), 0, best.model
    while options := [c for c in deck_models.removals(deck, study.asked) if c.label not in hopeless]:
        turn += 1
        try:
            step, change = _round(study, turn, options, path[-1], name, effects, starts) or (None, None)
            hopeless |= {s.label for s in study.steps if s.round == turn and not s.effect.largest <= study.room}
            if step is None:
                break
            step.taken, deck, name = True, change.deck, step.best.model
            path.append(step.best)
            path[-1] = cheapest(study, name, deck, starts, study.price(step.best), f"round {turn}: methods") or step.best
        except OutOfTimeError:
            break
    return path


def _round(
    study: Study,
    turn: int,
    options: list[deck_models.Change],
    last: Point,
    name: str,
    effects: list[Setting],
    starts: dict[str, Setting],
) -> tuple[Step, deck_models.Change] | None:
    """Return the removal that saves most, with its cheapest adequate point; None where none saves anything."""
    tried = _effects(study, turn, options, effects)
    fit = [(step, change) for step, change in zip(tried, options) if step.effect.largest <= study.room]
    fit = _promising(study, fit)
    own = [last.setting.family] if len(fit) > 3 else None

    def price(pair: tuple[Step, deck_models.Change]) -> Point | None:
        step, change = pair
        title = step.label if turn == 1 else f"{name}; {step.label}"
        stage = f"round {turn}: settings without {step.label}"
        return cheapest(study, title, change.deck, dict(starts), 2.0 * study.price(last), stage, own)

    for (step, _), best in zip(fit, study.runner.spread(price, fit)):
        step.best = best
    fit = [(step, change) for step, change in fit if step.best and study.price(step.best) < GAIN * study.price(last)]
    return min(fit, key=lambda pair: study.price(pair[0].best), default=None)


def _promising(study: Study, fit: list[tuple[Step, deck_models.Change]]) -> list[tuple[Step, deck_models.Change]]:
    """Return the removals whose cost is worth measuring.

    A rigid body is cheaper than any other model of it; of the smaller meshes and numbers of modes that fit, the smallest is
    tried, and the smallest that leaves half of the tolerance to the time integration.
    """
    kept = []
    rigid = {change.body for _, change in fit if change.kind == "rigid"}
    for step, change in fit:
        same = [(s, c) for s, c in fit if (c.body, c.kind) == (change.body, change.kind) and c.count < change.count]
        half = 0.5 * study.room
        beaten = bool(same) and (step.effect.largest > half or min(s.effect.largest for s, _ in same) <= half)
        if change.kind == "rigid" or not (beaten or change.body in rigid):
            kept.append((step, change))
    return kept


def _effects(study: Study, turn: int, options: list[deck_models.Change], settings: list[Setting]) -> list[Step]:
    """Return the removals with their measured effects, and keep them.

    A step that suits the full model may not suit a smaller one: a run that fails, or is off by little more than the tolerance,
    is made with the next method too, and the smaller error counts.
    """
    stage = f"round {turn}: what each removal changes"
    found = [Step(turn, change.label, Gap(math.inf, math.inf, ""), note="not run") for change in options]
    for setting in settings:
        doubtful = [k for k, step in enumerate(found) if step.note or study.room < step.effect.largest < DOUBT * study.room]
        outcomes = study.runner.all([study.text(options[k].deck, setting) for k in doubtful], stage)
        for k, outcome in zip(doubtful, outcomes):
            effect = gap(outcome, study.truth)
            if found[k].note or effect.largest < found[k].effect.largest:
                found[k] = Step(turn, options[k].label, effect, note=outcome.message)
    study.steps += found
    return found
