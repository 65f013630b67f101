"""What a study of a deck shares and finds: its runs, their errors against the truth, the removals that were tried."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from . import deck_models
from .deck_runs import Outcome, OutOfTimeError, Runner
from .deck_text import DeckText
from .tradeoff_errors import Compared, RunError, Truth, error_of
from .tradeoff_settings import Grid, Setting, for_search

FULL = "full model"

EVALUATION_COST = 40  # fixed cost of an evaluation, in unknowns: small models are not cheaper than that
SHORT = 2.0  # [s] shorter runs are ranked by counts of evaluations: their measured times vary too much


@dataclass(frozen=True)
class Point:
    """A model with a setting: what it costs and how far it is off."""

    model: str
    setting: Setting | None
    deck: DeckText
    outcome: Outcome
    error: RunError

    @property
    def cost(self) -> float:
        """Seconds of the analyses."""
        return self.outcome.seconds if self.outcome.ok else float("inf")


@dataclass
class Step:
    """One removal that was tried, and the cheapest adequate setting found with it.

    Attributes:
        round: of the search
        label: what is removed
        effect: error of the model without it
        change: largest difference from the model before, by the same setting
    """

    round: int
    label: str
    effect: RunError
    change: float = math.inf
    best: Point | None = None
    taken: bool = False
    note: str = ""


@dataclass
class Study:
    """What all searches share, and what they found.

    Attributes:
        runner: makes the runs
        grid: times of the comparison
        asked: names of the sensors that stay: those that are compared, and those that the deck itself needs
        tolerance: largest error that is accepted, relative to the range
        families: curves that are tried
        compared: columns, and the sizes by which they are judged
        points: everything that was measured against the truth
        steps: every removal that was tried
        rates: seconds for an evaluation of one unknown, by family, from the full model's longest run
        reasons: why a run of a family gave nothing, the last one
    """

    runner: Runner
    grid: Grid
    asked: set[str]
    tolerance: float
    families: list[str]
    compared: Compared
    truth: Truth | None = None
    points: list[Point] = field(default_factory=list)
    steps: list[Step] = field(default_factory=list)
    rates: dict[str, float] = field(default_factory=dict)
    reasons: dict[str, str] = field(default_factory=dict)

    @property
    def allowed_error(self) -> float:
        """The tolerance less the uncertainty of the truth; where it is negative, no error can be shown to be small enough."""
        left = self.tolerance - self.truth.uncertainty
        return left if left > 0.0 else -1.0

    def ranking_cost(self, point: Point) -> float:
        """Return what a point is ranked by: its seconds.

        Where they are few, its counts times the seconds that such counts take in longer runs of the same method.
        """
        outcome = point.outcome
        if not outcome.ok or outcome.seconds >= SHORT or point.setting.family not in self.rates:
            return point.cost
        return outcome.evaluations * (outcome.unknowns + EVALUATION_COST) * self.rates[point.setting.family]

    def removals(self, deck: DeckText) -> list[deck_models.Change]:
        """Return every single thing that can be taken out of a model."""
        return deck_models.removals(deck, self.asked, self.grid.highest, self.tolerance)

    def text(self, deck: DeckText, setting: Setting | None) -> str:
        """Return the text that is run."""
        return for_search(deck, setting, self.grid, self.asked)

    def update(self, model: str, words: str, found: Point) -> None:
        """Let a model with a setting, in words, have the cost and the error that were measured last, wherever it stands."""
        if not found.outcome.ok:
            return

        def settled(p: Point | None) -> Point | None:
            same = p and p.setting and p.model == model and p.setting.words(self.grid) == words
            return replace(p, outcome=found.outcome, error=found.error) if same else p

        self.points = [settled(p) for p in self.points]
        for step in self.steps:
            step.best = settled(step.best)

    def measure(self, model: str, deck: DeckText, settings: list[Setting], stage: str) -> list[Point]:
        """Run a model with some settings and keep the points."""
        texts = [self.text(deck, s) for s in settings]
        try:
            return self.keep(model, deck, settings, self.runner.all(texts, stage))
        except OutOfTimeError:
            self.keep(model, deck, settings, [self.runner.stored(text) for text in texts])
            raise

    def keep(self, model: str, deck: DeckText, settings: list[Setting], outcomes: list[Outcome | None]) -> list[Point]:
        """Keep what a model gave with some settings, None where there was no run, and return the points."""
        found = [Point(model, s, deck, o, error_of(o, self.truth)) for s, o in zip(settings, outcomes) if o]
        known = {(p.model, p.setting) for p in self.points}
        self.points += [p for p in found if p.outcome.ok and (p.model, p.setting) not in known]
        return found
