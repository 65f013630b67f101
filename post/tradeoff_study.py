"""What a study of a deck shares and finds: its runs, their errors against the truth, the removals that were tried."""

from __future__ import annotations

from dataclasses import dataclass, field

from deck_runs import Outcome, Runner
from deck_text import DeckText
from tradeoff_errors import Gap, Truth, gap
from tradeoff_settings import Grid, Setting, for_search

CALL = 40  # an evaluation costs about as much as this many unknowns, whatever is evaluated
SHORT = 2.0  # [s] shorter runs are ranked by their counts: side by side, on a machine with other work, clocks err


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
