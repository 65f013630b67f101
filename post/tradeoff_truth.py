"""The truth that errors are measured against, and the parts of an error: time integration, mesh, model."""

from __future__ import annotations

from dataclasses import dataclass

import deck_models
from deck_runs import Outcome, RunsError
from deck_text import DeckText
from tradeoff_errors import Gap, between, gap, plain_truth, richardson, truth_of
from tradeoff_search import CERTAIN, Curve, Study, curves
from tradeoff_settings import Setting

MESHES = 4  # doublings of the mesh at most
DEARER = 8.0  # an explicit run of a mesh twice as fine: twice the work, a quarter of the step
SETTLED = 0.1  # the mesh is refined until its uncertainty is below this share of the tolerance


@dataclass(frozen=True)
class Base:
    """The truth with the model that it comes from.

    Attributes:
        deck: the model in full: the deck itself, or its refinement
        curves: its runs, the most accurate family first
        doublings: of the deck's mesh
        notes: lines for the report
    """

    deck: DeckText
    curves: list[Curve]
    doublings: int
    notes: list[str]


def _best(study: Study, deck: DeckText, stage: str) -> list[Curve]:
    """Return the curves of a model; RunsError where no family gave an estimate of its own error."""
    found = curves(study, deck, stage)
    if not found or found[0].left == float("inf"):
        first = study.runner.one(study.text(deck, Setting(study.families[0], 0)))
        told = f"; the solver says: {first.message}" if first.message else ""
        raise RunsError(f"no method converged on this model within {study.runner.longest:g} s a run{told}")
    return found


def _words(study: Study, made: Curve) -> str:
    """Return how the finest run of a curve was made."""
    return made.settings[-1].words(study.grid)


def deck_truth(study: Study, deck: DeckText) -> Base:
    """Set the study's truth: the deck's own model, converged in time."""
    found = _best(study, deck, "reference")
    finest = found[0].outcomes[-1]
    study.truth = truth_of(finest, study.sizes, found[0].left, f"the deck's model, {_words(study, found[0])}")
    notes = [
        f"{c.family}: its finest run ({_words(study, c)}) is {between(c.outcomes[-1], finest, study.sizes):.1e} away"
        for c in found[1:]
    ]
    return Base(deck, found, 0, notes)


def refined_truth(study: Study, deck: DeckText) -> Base:
    """Set the study's truth: nodal coordinates, axial deformation, a mesh refined until it has settled, converged in time."""
    fine: list[Outcome] = []
    left, notes, before = float("inf"), [], float("inf")
    for doublings in range(MESHES + 1):
        model = deck_models.refined(deck, doublings, study.asked)
        try:
            found = _best(study, model, f"reference, mesh x {2**doublings}")
        except RunsError:
            if len(fine) < 2:
                raise
            notes.append(f"mesh x {2**doublings}: no converged run within {study.runner.longest:g} s, the mesh before counts")
            break
        fine.append(found[0].outcomes[-1])
        kept = (model, found, doublings)
        if len(fine) > 1:
            off = between(fine[-2], fine[-1], study.sizes)
            left, before = richardson(before, off, 2.0, 4.0), off
            notes.append(f"mesh x {2**doublings}: {off:.1e} from the one before")
            if left <= SETTLED * study.tolerance and (len(fine) > 2 or off <= SETTLED * study.tolerance):
                break
        if DEARER * found[0].cost > study.runner.longest and len(fine) > 1:
            notes.append(f"a finer mesh would take more than {study.runner.longest:g} s a run")
            break
    model, found, doublings = kept
    words = f"mesh x {2**doublings}, all kinematics modelled, {_words(study, found[0])}"
    study.truth = truth_of(fine[-1], study.sizes, left + found[0].left, words)
    return Base(model, found, doublings, notes)


def effect_settings(study: Study, base: Base, share: float) -> list[Setting]:
    """Return settings of the two most accurate families, coarse, with a time error below a share of the tolerance.

    The finest of the best family where there are none.
    """
    found = []
    for made in base.curves:
        good = [s for s, o in zip(made.settings, made.outcomes) if gap(o, study.truth).largest <= share * study.tolerance]
        found += good[:1]
    return found[:2] or [base.curves[0].settings[-1]]


def parts(study: Study, deck: DeckText, model: DeckText, run: Outcome, doublings: int) -> tuple[Gap, Gap, Gap]:
    """Return the parts of a run's error that time integration, mesh and model have.

    Args:
        study: what is shared
        deck: the deck as written, whose mesh is doubled for the truth
        model: the model that was run
        run: what it gave
        doublings: of the deck's mesh in the truth
    """
    own = curves(study, model, "parts of the error", target=CERTAIN * study.tolerance)
    meshed = _on_mesh(study, deck, model, doublings)
    fine = curves(study, meshed, "parts of the error, fine mesh", target=CERTAIN * study.tolerance)
    time = gap(run, plain_truth(own[0].outcomes[-1], study.truth))
    mesh = gap(own[0].outcomes[-1], plain_truth(fine[0].outcomes[-1], study.truth))
    return time, mesh, gap(fine[0].outcomes[-1], study.truth)


def _on_mesh(study: Study, deck: DeckText, model: DeckText, doublings: int) -> DeckText:
    """Return a model on the truth's mesh, its other simplifications kept."""
    for body in [group.name for group in model.all("body") if deck_models.is_flexible(group)]:
        here, written = model.one("body", body), deck.one("body", body)
        count = deck_models.elements_of(written) * 2**doublings
        if here.word("kind") == "beam" and deck_models.elements_of(here) != count:
            model = deck_models.with_elements(model, body, count, study.asked)
        while here.word("kind") == "frame" and deck_models.elements_of(model.one("body", body)) < count:
            model = deck_models.split_frame(model, body, study.asked)
    return model


def stiffened(study: Study, deck: DeckText, setting: Setting) -> str:
    """Return a line that says what geometric stiffening would change, '' where it cannot be asked for."""
    model = deck
    for body in deck.all("body"):
        soft = not body.flag("stiffening", False) and body.flag("axial", True) and not body.number("modes")
        if deck_models.is_flexible(body) and soft:
            model = model.set(model.one("body", body.name), stiffening=".true.")
    if model is deck:
        return ""
    outcome = study.runner.all([study.text(model, setting)], "geometric stiffening")[0]
    if not outcome.ok:
        return f"geometric stiffening could not be tried: {outcome.message}"
    found = gap(outcome, study.truth)
    return f"geometric stiffening, where the deck has none, changes the sensors by {found.largest:.1e} ({found.column})"


def as_written(study: Study, deck: DeckText) -> Outcome:
    """Return what the deck as it is gives, timed alone; RunsError where it does not run."""
    outcome = study.runner.timed(deck.text)
    if not outcome.ok:
        raise RunsError(f"the deck as written does not run: {outcome.message}")
    return outcome
