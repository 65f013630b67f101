"""The truth that errors are measured against, and the parts of an error: time integration, mesh, model."""

from __future__ import annotations

from dataclasses import dataclass

import deck_models
from deck_runs import Outcome, RunsError
from deck_text import DeckText
from tradeoff_curves import Curve, curves, doubt
from tradeoff_errors import Gap, between, gap, plain_truth, richardson, truth_of
from tradeoff_settings import Setting
from tradeoff_study import Study

MESHES = 4  # doublings of the mesh at most
DEARER = 3.0  # a run of a mesh twice as fine, before any has shown: half the step, and some more work
SETTLED = 0.1  # the mesh is refined until its uncertainty is below this share of the tolerance
RIGHT = 0.7  # share of what an error may be that a model may use up, so that the search starts from it


@dataclass(frozen=True)
class Base:
    """The truth with the model that it comes from.

    Attributes:
        deck: the model that the search starts from: the deck's own, or one of its refinements
        curves: its runs, the most accurate family first
        doublings: of the deck's mesh, in the truth
        notes: lines for the report
    """

    deck: DeckText
    curves: list[Curve]
    doublings: int
    notes: list[str]


def _best(study: Study, deck: DeckText, stage: str, lone: Curve | None = None, spare: bool = False) -> list[Curve]:
    """Return the curves of a model; RunsError where no family gave an estimate of its own error."""
    found = curves(study, deck, stage, lone=lone, spare=spare)
    if not found or found[0].left == float("inf"):
        first = study.runner.one(study.text(deck, Setting(study.families[-1], 0)))
        told = f"; the solver says: {first.message}" if first.message else ""
        raise RunsError(f"{stage}: no method converged within {study.runner.longest:g} s a run or half of --time{told}")
    return found


def _words(study: Study, made: Curve) -> str:
    """Return how the finest run of a curve was made."""
    return made.settings[-1].words(study.grid)


def deck_truth(study: Study, deck: DeckText) -> Base:
    """Set the study's truth: the deck's own model, converged in time."""
    found = _best(study, deck, "reference")
    finest = found[0].outcomes[-1]
    study.truth = truth_of(finest, study.sizes, doubt(study, found), f"the deck's model, {_words(study, found[0])}")
    notes = [
        f"{c.family}: its finest run ({_words(study, c)}) is {between(c.outcomes[-1], finest, study.sizes):.1e} away"
        for c in found[1:]
    ]
    return Base(deck, found, 0, notes)


def refined_truth(study: Study, deck: DeckText) -> Base:
    """Set the study's truth: nodal coordinates, axial deformation, a mesh refined until it has settled, converged in time.

    Raises:
        RunsError: there are no two meshes whose difference would tell how far off the finer one is.
    """
    meshes, notes, left = _meshes(study, deck)
    finest = meshes[-1]
    words = f"mesh x {2 ** (len(meshes) - 1)}, all kinematics modelled, {_words(study, finest.curves[0])}"
    outcome = finest.curves[0].outcomes[-1]
    study.truth = truth_of(outcome, study.sizes, left + doubt(study, finest.curves), words)
    return _start(study, deck, meshes, notes)


def _meshes(study: Study, deck: DeckText) -> tuple[list[Base], list[str], float]:
    """Return the refined models with their curves, coarse to fine, lines for the report, and the mesh's share of the error."""
    meshes: list[Base] = []
    left, notes, before = float("inf"), [], float("inf")
    for doublings in range(MESHES + 1):
        if meshes and _growth(meshes) * meshes[-1].curves[0].cost > study.runner.longest:
            notes.append(f"mesh x {2**doublings} would take more than {study.runner.longest:g} s a run")
            break
        model = deck_models.refined(deck, doublings, study.asked)
        lone = meshes[-1].curves[0] if meshes else None
        try:
            found = _best(study, model, f"reference, mesh x {2**doublings}", lone, spare=True)
        except RunsError:
            if not meshes:
                raise
            notes.append(f"mesh x {2**doublings}: no converged run within {study.runner.longest:g} s or the study's time")
            break
        meshes.append(Base(model, found, doublings, []))
        if len(meshes) > 1:
            off = between(*(mesh.curves[0].outcomes[-1] for mesh in meshes[-2:]), study.sizes)
            left, before = richardson(before, off, 2.0, 4.0), off
            notes.append(f"mesh x {2**doublings}: {off:.1e} from the one before")
            if left <= SETTLED * study.tolerance and (len(meshes) > 2 or off <= SETTLED * study.tolerance):
                break
    if len(meshes) < 2:
        raise RunsError(f"no second mesh to compare with: {notes[-1]}; more --time or --longest-run, or fewer sensors, would help")
    return meshes, notes, left


def _growth(meshes: list[Base]) -> float:
    """Return how much dearer the next mesh is, as the last two were, else as explicit steps are."""
    costs = [mesh.curves[0].cost for mesh in meshes[-2:]]
    return costs[1] / costs[0] if len(costs) == 2 else DEARER


def _start(study: Study, deck: DeckText, meshes: list[Base], notes: list[str]) -> Base:
    """Return the coarsest model that is right by itself, from which the search begins: the deck's own, or one of the meshes."""
    own, finest = "the deck's own model", meshes[-1]
    models = [(own, deck, curves(study, deck, f"search's start, {own}", spare=True))]
    models += [(f"the model of mesh x {2**mesh.doublings}", mesh.deck, mesh.curves) for mesh in meshes[:-1]]
    for name, model, found in models:
        if not found or found[0].left == float("inf"):
            notes.append(f"{name}: no converged run in time")
            continue
        off = gap(found[0].outcomes[-1], study.truth)
        if off.largest + found[0].left <= RIGHT * study.room:
            notes.append(f"the search starts from {name}, whose own error is {off.largest:.1e} ({off.column})")
            return Base(model, curves(study, model, f"search's start, {name}"), finest.doublings, notes)
        notes.append(f"{name} has an error of {off.largest:.1e} of its own ({off.column})")
    notes.append(f"the search starts from the model of mesh x {2**finest.doublings}")
    return Base(finest.deck, finest.curves, finest.doublings, notes)


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

    Raises:
        RunsError: the model or its fine mesh could not be converged.
    """
    own = _best(study, model, "parts of the error")
    fine = _best(study, _on_mesh(study, deck, model, doublings), "parts of the error, fine mesh", own[0])
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
    if outcome.status == -1:
        raise RunsError(f"the deck as written takes longer than {study.runner.longest:g} s (--longest-run, --time)")
    if not outcome.ok:
        raise RunsError(f"the deck as written does not run: {outcome.message}")
    return outcome
