"""The table of a study, in words and figures: tradeoff.txt and the head of recommended.nml."""

from __future__ import annotations

import math
import textwrap
from dataclasses import dataclass, field

from .deck_text import DeckText, parse
from .tradeoff_curves import Curve
from .tradeoff_errors import RunError, as_truth, error_of, is_state
from .tradeoff_study import Point, Study

WIDTH = 120
MANY = 20  # a study takes about as long as this many of its longest runs


@dataclass
class Result:
    """What a study ends with.

    Attributes:
        deck_name: name of the deck
        kind: 'deck' or 'refined'
        notes: lines about the truth and the search
        curves: work-precision curves of the full model
        written: the deck as written, timed alone
        path: cheapest adequate points, model by model
        chosen: what is recommended, as verified by running recommended.nml, None where nothing can be
        taken: removals that the recommended model has
        accuracy_run: the deck with `accuracy` in place of method and step, None where there was no time for it
        model_errors: of the deck as written, as its run estimates them by pilots: of left-out modes, of the mesh
        meets: whether the verified error is within the tolerance
        budget: solver seconds that the recommended run may take, infinite without [s]
        parts: (what, time, mesh, model) parts of errors
        important: what a user should know before he trusts the recommendation
        warnings: what the solver warns of in the deck as written; both stand before everything else
        dropped: columns that are rounding alone or states, and were not compared
        methods_left_out: methods that are not in the curves, each with the reason
    """

    deck_name: str
    kind: str
    notes: list[str]
    curves: list[Curve]
    written: Point
    path: list[Point]
    chosen: Point | None = None
    taken: list[str] = field(default_factory=list)
    accuracy_run: Point | None = None
    model_errors: dict[str, dict[str, float]] = field(default_factory=dict)
    meets: bool = False
    budget: float = math.inf
    parts: list[tuple[str, RunError, RunError, RunError]] = field(default_factory=list)
    important: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    dropped: list[str] = field(default_factory=list)
    methods_left_out: list[str] = field(default_factory=list)


def asked_for(study: Study) -> list[str]:
    """Return what must be right: columns where some were named, else sensors."""
    return sorted(study.compared.columns or study.compared.sensors)


def pareto(points: list[Point]) -> set[int]:
    """Return the indices of the points that no other one beats in both cost and error."""
    front, lowest = set(), math.inf
    for k in sorted(range(len(points)), key=lambda k: (points[k].cost, points[k].error.largest)):
        if points[k].error.largest < lowest:
            lowest = points[k].error.largest
            front.add(k)
    return front


def setting_words(study: Study, point: Point) -> str:
    """Return a point's setting as text."""
    return point.setting.words(study.grid) if point.setting else own_setting(point.deck)


def own_setting(deck: DeckText) -> str:
    """Return the setting that stands in a deck as text."""
    transient = deck.one("transient")
    if "accuracy" in transient.values or not {"step", "tolerance"} & transient.values.keys():
        return f"accuracy {transient.number('accuracy', 1e-3):.3g}"
    size = "tolerance" if "tolerance" in transient.values else "step"
    return f"{transient.word('method', 'rk4')} {size} {transient.number(size):.3g}" + " s" * (size == "step")


def orders(study: Study, curve: Curve) -> list[float]:
    """Return the observed orders of a curve against its own finest run: how fast errors fall with the number of steps.

    Only errors far above those of the finest run count.
    """
    finest = as_truth(curve.outcomes[-1], study.truth)
    runs = [(error_of(outcome, finest).largest, outcome.steps) for outcome in curve.outcomes[:-1]]
    pairs = [(a, b) for a, b in zip(runs, runs[1:]) if b[0] > 10.0 * curve.left and a[0] < 0.3 and b[1] > 1.05 * a[1]]
    return [math.log(a[0] / b[0]) / math.log(b[1] / a[1]) for a, b in pairs]


def _line(study: Study, point: Point, mark: str = "") -> str:
    o, below = point.outcome, point.error.largest < study.truth.uncertainty
    left = f"{setting_words(study, point):34}  {point.error.largest:9.2e}{'<' if below else ' '} {point.error.rms:9.2e}"
    right = f"{point.cost:10.4f} {o.evaluations:>11} {o.counts.get('solves', 0):>11} {o.unknowns:>8}"
    return f"{left}  {point.error.column:22.22} {right}  {mark:2}{point.model}"


def _points(study: Study) -> list[str]:
    head = (
        f"{'setting':34}  {'error max':>9}  {'error rms':>9}  {'worst column':22} {'seconds':>10} {'evaluations':>11} "
        f"{'solves':>11} {'unknowns':>8}  model"
    )
    front = pareto(study.points)
    order = sorted(range(len(study.points)), key=lambda k: (study.points[k].model, study.points[k].cost))
    return [head, *(_line(study, study.points[k], "*" if k in front else "") for k in order)]


def _removals(study: Study) -> list[str]:
    width = max([44, *(len(s.label) for s in study.steps)])
    lines = [f"{'round':>5}  {'simplified':{width}} {'error max':>9} {'error rms':>9}  {'worst column':22} {'seconds':>9}  "]
    for s in study.steps:
        seconds = f"{s.best.cost:9.4f}" if s.best else " " * 9
        note = "taken" if s.taken else (s.note[:60] if s.note else ("" if s.effect.largest <= study.allowed_error else "too much"))
        column = "" if s.note else s.effect.column
        errors = f"{s.effect.largest:9.2e} {s.effect.rms:9.2e}"
        lines.append(f"{s.round:5}  {s.label:{width}} {errors}  {column:22.22} {seconds}  {note}")
    return lines


def speed_up(written: Point, chosen: Point) -> tuple[float, float]:
    """Return how many times cheaper the second is: in seconds, in evaluations times unknowns."""
    return written.cost / max(chosen.cost, 1.0e-6), written.outcome.work / max(chosen.outcome.work, 1)


def verdict(study: Study, result: Result) -> str:
    """Return the paragraph: the cheapest setting that meets the tolerance, what it costs and what it leaves out."""
    tolerance, truth, written = f"{study.tolerance:g} of each sensor's range", study.truth, result.written
    own = f"The deck as written has an error of {written.error.largest:.1e} and takes {written.cost:.4f} s"
    own = own if written.outcome.ok else f"The deck as written was not measured: {written.outcome.message}"
    chosen = result.chosen
    if chosen is None and not result.curves and study.reasons:
        return f"No run of a method came to its end: nothing is recommended. {'; '.join(study.reasons.values())}. {own}."
    if chosen is None and math.isinf(truth.uncertainty):
        return f"No reference converged within --time {study.runner.time:g}: nothing is recommended, errors are rough. {own}."
    if chosen is None:
        cut = f" The search was ended by --time {study.runner.time:g}." if study.runner.late() else ""
        return f"No setting that was tried meets {tolerance}. {own}. The truth itself is known to {truth.uncertainty:.1e}.{cut}"
    known = f"(worst column {chosen.error.column}; the truth is known to {truth.uncertainty:.1e})"
    if chosen.deck is written.deck:
        return (
            f"The deck as written is the cheapest that was found to meet {tolerance}: keep it. Its error is "
            f"{chosen.error.largest:.1e} {known}, it takes {chosen.cost:.4f} s."
        )
    model = "the model " + ("simplified: " + "; ".join(result.taken) if result.taken else "in full")
    text = (
        f"{'The cheapest setting that meets' if result.meets else 'The most accurate setting within the budget, which misses'} "
        f"{tolerance} is {setting_words(study, chosen)} with {model}. "
        f"recommended.nml was run: its error is {chosen.error.largest:.1e} {known}, it takes {chosen.cost:.4f} s. {own}"
    )
    if written.outcome.ok:
        seconds, work = speed_up(written, chosen)
        text += f": the speed-up is {seconds:.3g} in seconds, {work:.3g} in evaluations x unknowns"
        if chosen.cost > written.cost:
            text += "; the deck as written is cheaper, but misses the tolerance"
    text += "."
    if math.isfinite(result.budget):
        text += f" The budget was {result.budget:g} s."
    return text


def nothing_finished(study: Study, name: str) -> tuple[str, str]:
    """Return a paragraph, and the text of tradeoff.txt, where the time ended before any run came to its end.

    Args:
        study: whose runs were ended
        name: of the deck
    """
    runs, t_end = study.runner.unfinished, study.grid.t_end
    full_time = min((r.seconds * t_end / r.reached for r in runs if r.reached > 0.0), default=math.nan)
    given = study.runner.time
    text = f"No run came to its end within --time {given:g}: nothing can be compared, nothing is recommended."
    needed = MANY * given
    if full_time < math.inf:
        text += f" At the speed of the one that came farthest a run takes {full_time:.2g} s on this machine as busy as it is."
        needed = max(MANY * full_time, 2.0 * given)
    text += f" Give --time {float(f'{needed:.2g}'):g} or a shorter t_end."
    lines = [f"Speed against accuracy of {name}", "", *textwrap.wrap(text, WIDTH), ""]
    lines += [f"{'setting':34}  {'seconds':>10}  came to"]
    for run in runs:
        reached = f"t = {run.reached:.4g} s of {t_end:.4g} s" if run.reached >= 0.0 else "its set-up"
        lines.append(f"{own_setting(parse(run.text)):34}  {run.seconds:10.4f}  {reached}")
    return text, "\n".join(lines) + "\n"


def _wrapped(notes: list[str]) -> list[str]:
    """Return notes as lines of a list."""
    return [line for note in notes for line in textwrap.wrap(note, WIDTH - 2, initial_indent="- ", subsequent_indent="  ")]


def _not_compared(why: str, names: list[str]) -> list[str]:
    """Return the lines that name columns which were not compared, none where there are no such columns."""
    return textwrap.wrap(f"not compared, {why}: {', '.join(names)}", WIDTH) if names else []


def head(study: Study, result: Result) -> str:
    """Return the comment on top of recommended.nml."""
    lines = _wrapped([*result.warnings, *result.important])
    lines += textwrap.wrap(f"Recommended for {result.deck_name}. {verdict(study, result)}", WIDTH - 2)
    lines += textwrap.wrap(f"Truth: {study.truth.words}. Sensors: {', '.join(asked_for(study))}.", WIDTH - 2)
    if not study.grid.stated:
        lines += textwrap.wrap(
            f"The deck as written states no output_step: a row each step. Here a row stands each {study.grid.interval:g} s.",
            WIDTH - 2,
        )
    return "".join(f"! {line}\n" for line in lines) + "\n"


def _model_lines(study: Study, result: Result) -> list[str]:
    """Return what left-out modes and meshes make each column err, as the solver estimates it."""
    if not result.model_errors:
        return []
    names, truth = {"errors": "modes", "mesh_errors": "mesh"}, study.truth
    title = "Errors of the deck's own modes and mesh, by pilots (check_reduction, check_mesh)"
    lines = ["", f"{title:82} " + " ".join(f"{names[kind]:>9}" for kind in result.model_errors)]
    for name, scale in zip(truth.names, truth.scale):
        found = [[x for key, x in errors.items() if key.split("[")[0] == name] for errors in result.model_errors.values()]
        lines.append(f"  {name:80} " + " ".join(f"{x[0] / scale:9.2e}" if x else 9 * " " for x in found))
    return lines


def table(study: Study, result: Result) -> str:
    """Return the text of tradeoff.txt."""
    truth = study.truth
    lines = [
        f"Speed against accuracy of {result.deck_name}",
        "",
        *_wrapped([*result.warnings, *result.important]),
        *textwrap.wrap(verdict(study, result), WIDTH),
        "",
        f"truth ({result.kind}): {truth.words}",
        f"  its own uncertainty: {truth.uncertainty:.1e} of a column's range (finest levels and meshes, the other explicit method)",
        *(f"  {note}" for note in result.notes),
        f"sensors: {', '.join(asked_for(study))}; tolerance {study.tolerance:g} of each column's range",
        *_not_compared("rounding alone", [name for name in result.dropped if not is_state(name)]),
        *_not_compared("states, whose events are compared by their times", [name for name in result.dropped if is_state(name)]),
        *(f"left out: {words}" for words in result.methods_left_out),
        f"rows compared: every {study.grid.interval:g} s up to {study.grid.t_end:g} s",
        "errors: largest and root mean square over time, of the worst column, relative to its range (post/compare.py has the rule)",
        "seconds: of the processor, analyses alone, without start-up; the last rows: of several runs in turn, the median",
        "evaluations: of the equations of motion; each Newton iteration of an implicit step counts as one, of radau each stage's",
        "",
        "Observed orders on the full model: how fast errors fall with the number of steps",
    ]
    for curve in result.curves:
        seen = orders(study, curve)
        if seen:
            lines.append(f"  {curve.family}: " + ", ".join(f"{order:.2f}" for order in seen))
    if lines[-1].startswith("Observed"):
        lines.append("  none: fewer than two of a method's runs lie far above the error of its finest one")
    if result.parts:
        lines += ["", f"{'Parts of the error':44} {'time':>9} {'mesh':>9} {'model':>9}"]
        lines += [f"{what:44} {t.largest:9.2e} {m.largest:9.2e} {k.largest:9.2e}" for what, t, m, k in result.parts]
    lines += _model_lines(study, result)
    cut = "--time ended the search before" if study.runner.late() else "there is no adequate setting, or nothing to remove"
    removals = _removals(study) if study.steps else [f"  none was tried: {cut}"]
    lines += ["", "What each removal changes, and what the cheapest adequate setting then costs", *removals]
    lines += ["", "Every run (* Pareto front; < below the truth's own uncertainty)", *_points(study)]
    lines += [_line(study, point) for point in (result.written, result.accuracy_run, result.chosen) if point and point.outcome.ok]
    return "\n".join(lines) + "\n"
