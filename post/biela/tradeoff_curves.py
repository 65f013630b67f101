"""Work-precision curves of a model: each method refined until its own differences promise an error below a target.

The method that promises to reach it most cheaply, by what its runs have cost and shown, is refined first; once one has reached
the target, the others are spared their finest levels.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field

from .deck_runs import Outcome, OutOfTimeError
from .deck_text import DeckText
from .tradeoff_errors import NOISE, between, richardson
from .tradeoff_settings import ORDERS, Setting
from .tradeoff_study import Study

LEVELS = 14  # of a curve at most
CERTAIN = 0.05  # the reference is refined until its uncertainty is below this share of the tolerance
ENOUGH = 0.3  # share of the tolerance to which the other methods are refined, once one has reached the target
CHEAP, DRAWN = 0.5, 7  # curves have so many points where the next ones cost less [s]: their slopes show the order
PAIR, PAIR_BY_TOLERANCE = 4.0, 2.5  # cost of the two next runs together, in costs of the last run
FEW = 2  # levels that an estimate of the error needs
HIGH = 5.0  # order of convergence that is assumed for methods with a tolerance
TINY = 1.0e-30
SLOW = 0.1  # the lowest order of convergence that is assumed
EXPLICIT = ("rk4", "dopri5")


@dataclass
class Curve:
    """Runs of one model with one family, coarse to fine, and the error left in the finest.

    Attributes:
        family: of settings
        settings: that ran
        outcomes: what they gave
        left: error that the finest run has by the differences of the last ones; infinite without an estimate
        following: the next setting
        before: seconds of the finest run and error left before the last refinement
        waited: seconds by the clock that its last runs took
        ended: whether nothing finer is run
    """

    family: str
    settings: list[Setting] = field(default_factory=list)
    outcomes: list[Outcome] = field(default_factory=list)
    left: float = float("inf")
    following: Setting | None = None
    before: tuple[float, float] | None = None
    waited: float = 0.0
    ended: bool = False

    @property
    def cost(self) -> float:
        """Seconds of the finest run."""
        return self.outcomes[-1].seconds if self.outcomes else float("inf")

    @property
    def coming(self) -> float:
        """Seconds that the next runs may take; what the last ones took as long as none went to its end."""
        if not self.outcomes:
            return self.waited
        return (PAIR_BY_TOLERANCE if self.settings[-1].adaptive else PAIR) * self.cost


def curves(study: Study, deck: DeckText, stage: str, previous: Curve | None = None, stop_early: bool = False) -> list[Curve]:
    """Return the curves of a model, the most accurate first.

    Args:
        study: what is shared
        deck: the model
        stage: for the progress bar
        previous: curve of a like model: its family alone is run, from the level by which it had converged
        stop_early: whether to end when one family has reached the target
    """
    target = CERTAIN * study.tolerance
    # where the time ended a run, implicit methods first: their coarsest run has the fewest steps
    families = study.families[::-1] if study.runner.unfinished else study.families
    first = [previous.settings[-3:][0]] if previous else [Setting(family, 0) for family in families]
    found = [Curve(setting.family, following=setting) for setting in first]
    while unfinished := [curve for curve in found if not curve.ended]:
        best = min((c.cost for c in found if uncertainty_of(study, c, found) <= target), default=float("inf"))
        if stop_early and best < float("inf"):
            break
        curve = min(unfinished, key=lambda c: _expected_cost(c, target))
        cost_limit = min(study.runner.longest, study.runner.left(), max(PAIR * best, 1.0))
        enough = curve.left <= (target if best == float("inf") else ENOUGH * study.tolerance)
        drawn = stop_early or previous or curve.coming > CHEAP or len(curve.outcomes) >= DRAWN
        if curve.coming > cost_limit or (enough and drawn):
            curve.ended = True
        else:
            try:
                _refine(study, deck, curve, stage)
            except OutOfTimeError:
                break
    for curve in found:
        if curve.left == float("inf") and len(curve.outcomes) == FEW:
            curve.left = between(curve.outcomes[0], curve.outcomes[1], study.compared)
    return sorted((c for c in found if c.outcomes), key=lambda c: uncertainty_of(study, c, found))


def _expected_cost(curve: Curve, target: float) -> float:
    """Return the seconds by which a curve may have reached the target.

    Its error falls with the cost as it last did, and with the order of its method where that is not known yet.
    """
    if curve.left == float("inf"):
        return curve.coming
    rate = ORDERS.get(curve.family, HIGH)
    before = curve.before
    if before and before[1] < float("inf") and curve.cost > before[0]:
        seen = math.log(max(before[1] / max(curve.left, TINY), 1.0)) / math.log(curve.cost / before[0])
        rate = min(max(seen, SLOW), rate)
    return max(curve.coming, curve.cost * (curve.left / target) ** (1.0 / rate))


def uncertainty_of(study: Study, curve: Curve, found: list[Curve]) -> float:
    """Return the error that the finest run of a curve may have.

    Its own differences say it, and so do explicit methods: fast vibrations that a fixed step damps are missing in all runs of that
    method alike, and its differences tell nothing of them. What the run of an explicit method is away, less the error that it
    claims itself, counts where it is more. Implicit runs may damp the same vibrations and are no witnesses. Nothing is known
    better than to the rounding of a run.
    """
    others = [c for c in found if c is not curve and c.family in EXPLICIT and c.left < float("inf")]
    apart = [between(c.outcomes[-1], curve.outcomes[-1], study.compared) - c.left for c in others] if curve.outcomes else []
    return max([curve.left, NOISE, *apart])


def _refine(study: Study, deck: DeckText, curve: Curve, stage: str) -> None:
    """Add the next two levels to a curve: steps halved, tolerances divided by ten.

    Raises:
        OutOfTimeError: one was not finished; what was is in the curve.
    """
    batch = [s for s in (curve.following, curve.following.doubled()) if s.exists()]
    begun, cost, late = time.monotonic(), curve.cost, None
    texts = [study.text(deck, s) for s in batch]
    try:
        done = study.runner.all(texts, f"{stage}, {curve.family}")
    except OutOfTimeError as fault:
        late, done = fault, [study.runner.stored(text) for text in texts]
    curve.waited = time.monotonic() - begun
    curve.following = batch[-1].doubled()
    for setting, outcome in zip(batch, done):
        if outcome is None or outcome.status == -1:
            curve.ended = True
            study.reasons[curve.family] = f"{setting.words(study.grid)} did not come to its end in the time that a run may take"
            break
        if not outcome.ok:
            study.reasons[curve.family] = f"{setting.words(study.grid)}: {outcome.message}"
        else:
            curve.settings.append(setting)
            curve.outcomes.append(outcome)
    left = _left(study, curve)
    curve.before = (cost, curve.left)
    rounding = left > 0.7 * curve.left and curve.left < 1.0e-6 and len(curve.outcomes) > 4
    curve.left = min(left, curve.left) if rounding else left
    curve.ended = curve.ended or rounding or not curve.following.exists() or len(curve.outcomes) >= LEVELS
    if late:
        raise late


def _left(study: Study, curve: Curve) -> float:
    """Return the error that the finest run of a curve has by the differences of its last three.

    Where tolerances are divided by ten it is taken to fall as it last did, by ten at most; steps go by Richardson.
    """
    last = curve.outcomes[-3:]
    away = [between(a, b, study.compared) for a, b in zip(last, last[1:])]
    if not away:
        return float("inf")
    if curve.settings[-1].adaptive:
        return away[-1] * (min(max(away[-1] / away[0], 0.1), 1.0) if away[0] > 0.0 else 1.0)
    return richardson(away[0], away[1], 2.0, ORDERS[curve.family]) if len(away) == 2 else float("inf")
