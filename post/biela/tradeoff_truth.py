"""The truth that errors are measured against, and the parts of an error: time integration, mesh, model."""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass, replace

from . import deck_models
from .deck_models import MODAL, ImpossibleError
from .deck_runs import Outcome, OutOfTimeError, RunsError
from .deck_text import DeckText
from .tradeoff_curves import Curve, curves, uncertainty_of
from .tradeoff_errors import RunError, as_truth, between, error_of, richardson, truth_of
from .tradeoff_settings import Setting
from .tradeoff_study import FULL, Point, Study

MESHES = 4  # doublings of the mesh at most
GIVE_UP = 4.0  # a setting by which effects are measured costs at most so many times the cheapest adequate one
DEARER = 3.0  # a run of a mesh twice as fine, before any has shown: half the step, and some more work
SETTLED = 0.1  # the mesh is refined until its uncertainty is below this share of the tolerance
LATE = 0.9  # share of the study's time after which nothing more is done for a truth
SECOND = 0.7  # share of the study's time after which the second attempt at a truth ends
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


def _best(study: Study, deck: DeckText, stage: str, previous: Curve | None = None, stop_early: bool = False) -> list[Curve]:
    """Return the curves of a model; RunsError where no family gave an estimate of its own error."""
    found = curves(study, deck, stage, previous=previous, stop_early=stop_early)
    if not found or found[0].left == float("inf"):
        first = study.runner.one(study.text(deck, Setting(study.families[-1], 0)))
        reason = f"; the solver says: {first.message}" if first.message else ""
        raise RunsError(f"{stage}: no method converged within {study.runner.longest:g} s a run or half of --time{reason}")
    return found


def _words(study: Study, curve: Curve) -> str:
    """Return how the finest run of a curve was made."""
    return curve.settings[-1].words(study.grid)


def deck_truth(study: Study, deck: DeckText, written: Outcome) -> Base:
    """Set the study's truth: the deck's own model, converged in time.

    Where none is known well enough when the time of the reference is over, it has that of the search, too: without it nothing
    can be recommended. Where nothing converged even then, the finest run takes its place, or else the deck as written, and how
    far it is off is not known.

    Raises:
        OutOfTimeError: no run at all came to its end.
        RunsError: every run failed.
    """
    found = curves(study, deck, "reference")
    if not (found and uncertainty_of(study, found[0], found) < study.tolerance):
        study.runner.share = LATE
        found = curves(study, deck, "reference")
    if not found:
        if not written.ok:
            raise OutOfTimeError if math.isfinite(study.runner.time) else RunsError(f"no run came to its end: {written.message}")
        study.truth = truth_of(written, study.compared, float("inf"), "the deck as written: no other run came to its end in time")
        return Base(deck, [], 0, [])
    finest = found[0].outcomes[-1]
    words = f"the deck's model, {_words(study, found[0])}"
    if found[0].left == float("inf"):
        words += ", not known to have converged: the time ended"
    study.truth = truth_of(finest, study.compared, uncertainty_of(study, found[0], found), words)
    notes = [
        f"{c.family}: its finest run ({_words(study, c)}) is {between(c.outcomes[-1], finest, study.compared):.1e} away"
        for c in found[1:]
    ]
    return Base(deck, found, 0, notes)


def refined_truth(study: Study, deck: DeckText, written: Outcome) -> Base:
    """Set the study's truth: nodal coordinates, axial deformation, a mesh refined until it has settled, converged in time.

    Without two meshes, whose difference tells how far off the finer one is, the deck's own model takes its place.
    """
    try:
        meshes, notes, left = _meshes(study, deck)
    except (RunsError, OutOfTimeError) as fault:
        study.runner.share = SECOND
        base = deck_truth(study, deck, written)
        note = f"no refined truth: {str(fault) or 'the time ended'}; the errors are those of the time integration alone"
        return replace(base, notes=[note, *base.notes])
    finest = meshes[-1]
    words = f"mesh x {2 ** (len(meshes) - 1)}, all kinematics modelled, {_words(study, finest.curves[0])}"
    outcome = finest.curves[0].outcomes[-1]
    study.truth = truth_of(outcome, study.compared, left + uncertainty_of(study, finest.curves[0], finest.curves), words)
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
        previous = meshes[-1].curves[0] if meshes else None
        try:
            found = _best(study, model, f"reference, mesh x {2**doublings}", previous, stop_early=True)
        except RunsError:
            if not meshes:
                raise
            notes.append(f"mesh x {2**doublings}: no converged run within {study.runner.longest:g} s or the study's time")
            break
        meshes.append(Base(model, found, doublings, []))
        if len(meshes) > 1:
            off = between(*(mesh.curves[0].outcomes[-1] for mesh in meshes[-2:]), study.compared)
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
    models = [(own, deck, curves(study, deck, f"search's start, {own}", stop_early=True))]
    models += [(f"the model of mesh x {2**mesh.doublings}", mesh.deck, mesh.curves) for mesh in meshes[:-1]]
    for name, model, found in models:
        if not found or found[0].left == float("inf"):
            notes.append(f"{name}: no converged run in time")
            continue
        off = error_of(found[0].outcomes[-1], study.truth)
        if off.largest + found[0].left <= RIGHT * study.allowed_error:
            notes.append(f"the search starts from {name}, whose own error is {off.largest:.1e} ({off.column})")
            return Base(model, curves(study, model, f"search's start, {name}"), finest.doublings, notes)
        notes.append(f"{name} has an error of {off.largest:.1e} of its own ({off.column})")
    notes.append(f"the search starts from the model of mesh x {2**finest.doublings}")
    return Base(finest.deck, finest.curves, finest.doublings, notes)


def effect_settings(study: Study, best: Point, share: float) -> list[Setting]:
    """Return settings by which effects are measured: the cheapest adequate one, and those that follow where it does not do.

    They are, by family, the cheapest that leaves the full model an error below a share of the room, where it is not too dear.
    """
    found = {}
    for point in sorted((p for p in study.points if p.model == FULL), key=study.ranking_cost):
        if point.error.largest <= share * study.allowed_error and study.ranking_cost(point) <= GIVE_UP * study.ranking_cost(best):
            found.setdefault(point.setting.family, point.setting)
    return list(dict.fromkeys([best.setting, *found.values()]))


def parts(study: Study, deck: DeckText, model: DeckText, run: Outcome, doublings: int) -> tuple[RunError, RunError, RunError]:
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
    time = error_of(run, as_truth(own[0].outcomes[-1], study.truth))
    mesh = error_of(own[0].outcomes[-1], as_truth(fine[0].outcomes[-1], study.truth))
    return time, mesh, error_of(fine[0].outcomes[-1], study.truth)


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


def larger_models(deck: DeckText, asked: set[str], mesh: bool) -> dict[str, DeckText]:
    """Return, by what they add in words, models with what the deck leaves out; what is impossible is not among them.

    Args:
        deck: the model
        asked: names of the sensors that must stay
        mesh: whether a mesh twice as fine is one of them
    """
    added: dict[str, DeckText] = {}
    bodies = [body for body in deck.all("body") if body.word("kind") in ("beam", "frame")]
    flexible = [body for body in bodies if deck_models.is_flexible(body)]
    for body in bodies:
        if body not in flexible:
            with contextlib.suppress(ImpossibleError):
                added[f"the flexibility of {body.name}"] = deck_models.changed(deck, body.name, {"flexible": None}, asked)
    off = {
        "axial deformation": (("axial",), lambda body: not body.flag("axial", True)),
        "viscoelasticity": (("viscoelastic",), lambda body: not body.flag("viscoelastic", True)),
        "what the modes leave out": (MODAL, lambda body: body.number("modes") and body.word("reference") != "free"),
    }
    for words, (keys, missing) in off.items():
        _add(added, words, deck, [(body.name, dict.fromkeys(keys)) for body in flexible if missing(body)], asked)
    soft = [body for body in flexible if not body.flag("stiffening", False) and body.word("reference") != "free"]
    values = {"stiffening": ".true.", **dict.fromkeys(("axial", *MODAL))}
    _add(added, "geometric stiffening", deck, [(body.name, values) for body in soft], asked)
    if mesh and flexible:
        with contextlib.suppress(ImpossibleError):
            added["a mesh twice as fine"] = deck_models.refined(deck, 1, asked, model=False)
    return added


def _add(added: dict[str, DeckText], words: str, deck: DeckText, edits: list[tuple[str, dict]], asked: set[str]) -> None:
    """Add a model with values of some bodies changed, where there is such a body."""
    with contextlib.suppress(ImpossibleError):
        for body, values in edits:
            deck = deck_models.changed(deck, body, values, asked)
        if edits:
            added[words] = deck


def left_out(study: Study, base: Base, best: Point) -> tuple[list[str], list[str]]:
    """Return lines on what the model leaves out: those that change the sensors beyond the tolerance, the others.

    Each is added to the model by itself; the two are compared by the same setting, the first that both accept: explicit steps
    are bounded by what is added.
    """
    settings = [*effect_settings(study, best, 1.0), best.setting.doubled().doubled()]
    important, others, faults = [], [], {}
    untried = larger_models(base.deck, study.asked, mesh=not base.doublings)
    for setting in settings:
        texts = [study.text(model, setting) for model in (base.deck, *untried.values())]
        before, *outcomes = study.runner.all(texts, "what the deck leaves out") if untried else [None]
        for words, outcome in zip(list(untried), outcomes):
            faults[words] = outcome.message or before.message
            if outcome.ok and before.ok:
                del untried[words]
                off = error_of(outcome, as_truth(before, study.truth))
                line = f"{words}, which the model leaves out, changes the sensors by {off.largest:.1e} ({off.column})"
                (important if off.largest > study.tolerance else others).append(line)
    return important, others + [f"{words} could not be tried: {faults[words]}" for words in untried]


def as_written(study: Study, deck: DeckText) -> Outcome:
    """Return what the deck as it is gives, timed alone, unfinished where it takes too long; RunsError where it does not run."""
    limit = min(study.runner.longest, study.runner.left())
    try:
        outcome = study.runner.timed(deck.text)
    except OutOfTimeError:
        outcome = Outcome(-1, "")
    if outcome.status == -1:
        return Outcome(-1, f"it takes more than {limit:.3g} s and was not finished")
    if not outcome.ok:
        raise RunsError(f"the deck as written does not run: {outcome.message}")
    return outcome
