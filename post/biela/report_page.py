"""One page (HTML) about a run, or about two runs side by side."""

from __future__ import annotations

import argparse
import base64
import functools
import io
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Callable

import jinja2
import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from . import draw as scene_picture
from . import engineering, mode_pictures, plot
from .animate import sheet
from .command import Progress
from .compare import common_rows
from .deck import Deck, groups_of
from .histories import History, read, read_summary
from .mechanism import from_run
from .result_files import RESULT_FILES, HistoryError, note, writing

if TYPE_CHECKING:
    import pandas

TEMPLATE = Path(__file__).resolve().parent / "report.html"
MOST_COLUMNS = 40  # drawn of a history; a table of the ranges holds them all
PANELS = 2  # of one picture: two pictures fit on a printed page
PIXELS = 96  # of an inch, as browsers count
FILMS = {".mp4": "video/mp4", ".gif": "image/gif"}  # of animate.py, by their endings
MOST_POINTS = 50_000  # of a picture, above which it is embedded as pixels


@dataclass
class Picture:
    """A picture as a data URI, what it shows, and its own width [pixel], beyond which it is not stretched."""

    data: str
    caption: str
    width: int


@dataclass
class Part:
    """What stands under one heading: any of paragraphs, a table, pictures, text as it is, a film (a data URI)."""

    heading: str = ""
    paragraphs: list[str] = field(default_factory=list)
    head: list[str] = field(default_factory=list)
    rows: list[list[str]] = field(default_factory=list)
    pictures: list[Picture] = field(default_factory=list)
    text: str = ""
    warning: bool = False
    film: str = ""


@dataclass
class Section:
    """A part of the page."""

    title: str
    parts: list[Part]

    @property
    def pair(self) -> bool:
        """Whether its parts are those of two runs, which stand side by side where the page is wide."""
        return len(self.parts) == 2 and all(part.heading for part in self.parts)


@dataclass(eq=False)
class Run:
    """A results folder: its figures, its words, and the files that it has."""

    folder: Path  # where it is
    figures: dict  # of summary.json
    label: str  # what tells it from the other run
    start: float = -math.inf  # rows before this time do not count among the largest values [s]
    end: float = math.inf  # rows after this time do not count among them [s]

    @property
    def ok(self) -> bool:
        """Whether the run went to its end."""
        return self.figures.get("status") == 0

    @property
    def outcome(self) -> str:
        """How the run ended, and whether the solver warns."""
        count = len(self.figures["warnings"])
        return self.figures["outcome"] + (f", but with {count} warning{'s' if count > 1 else ''}" if count else "")

    @property
    def clean(self) -> bool:
        """Whether nothing speaks against its results."""
        return self.ok and not self.figures["warnings"]

    @functools.cache  # noqa: B019, of a run that lives as long as its page
    def table(self, kind: str) -> History | None:
        """Return a results file, None where the run has none, or no row of it."""
        if not (self.folder / RESULT_FILES[kind]).is_file():
            return None
        try:
            return read(self.folder, kind)
        except HistoryError:
            if self.ok:
                raise
            return None


def load(folder: Path, label: str, start: float = -math.inf, end: float = math.inf) -> Run:
    """Return a run; HistoryError where the folder holds none."""
    if not folder.is_dir():
        raise HistoryError(f"{folder}: no results folder")
    return Run(folder, read_summary(folder), label, start, end)


def embed(figure: Figure, caption: str) -> Picture:
    """Return a figure as SVG, or as PNG where it has very many points."""
    points = sum(len(line.get_xdata(orig=False)) for axis in figure.axes for line in axis.lines)
    kind, name = ("png", "png") if points > MOST_POINTS else ("svg", "svg+xml")
    file = io.BytesIO()
    with mpl.rc_context({"svg.fonttype": "path", "savefig.dpi": 150}):
        figure.savefig(file, format=kind)
    width = round(PIXELS * figure.get_figwidth())
    return Picture(f"data:image/{name};base64,{base64.b64encode(file.getvalue()).decode()}", caption, width)


def column_pictures(tables: list[History], labels: list[str], names: list[str], caption: str) -> list[Picture]:
    """Return the pictures of columns, a few panels each."""
    groups = plot.panels(tables, names)
    parts = [[name for group in groups[k : k + PANELS] for name in group] for k in range(0, len(groups), PANELS)]
    return [embed(plot.draw(tables, labels, part, styled=True), caption) for part in parts]


def table_text(x: object) -> str:
    """Return a figure for a table."""
    if x is None:
        return "–"
    return f"{x:,}" if isinstance(x, int) else f"{x:.4g}" if isinstance(x, float) else str(x)


@functools.cache
def findings(run: Run) -> dict[str, str]:
    """Return what a designer asks of a run, in words by what it is."""
    deck = deck_of(run)
    found: list[tuple[str, str]] = []
    table, motions = (part.between(run.start, run.end) if (part := run.table(kind)) else None for kind in ("history", "motion"))
    energies = part.between(run.start, math.inf) if (part := run.table("energy")) else None  # what was lost is told of its end
    scene = run.figures["scene"]
    moved = from_run(motions) if motions is not None else None
    if moved is not None:
        undeformed = {body["name"].lower(): np.array(body["nodes"] or [[0.0, 0.0]], dtype=float) for body in scene["bodies"]}
        lengths = {name: float(np.linalg.norm(np.ptp(nodes, axis=0))) for name, nodes in undeformed.items()}
        found += engineering.of_motion(moved, lengths)
    if table is not None:
        drives = engineering.turning_drives(scene, deck)
        left_out = set(table.names[1:]) - set(plot.moving([table], table.names[1:]))
        left_out |= {name for name in table.names if name.endswith(".m") and name[:-2].lower() in drives}
        all_rows = run.start == -math.inf and run.end == math.inf
        stops = {one["name"].lower(): one.get("largest_force", 0.0) for one in run.figures["transient"].get("stops", [])}
        found += engineering.of_history(table, deck, left_out, stops if all_rows else {})
        found += engineering.of_drives(table, drives, deck)
        found += engineering.of_pairs(run.figures["transient"]) if all_rows else []
    if energies is not None:
        found += engineering.of_energy(energies, run.figures.get("transient", {}), run.end)
    return dict([*found, *engineering.of_modes(run.figures)])


def deck_of(run: Run) -> Deck:
    """Return the deck of a run in numbers, with all included parts."""
    return Deck(run.folder, groups_of(run.figures["groups"]))


def results(runs: list[Run]) -> Section:
    """Return warnings first, then the results that a designer asks for, runs side by side, and the moduli of materials."""
    warnings = [Part(heading=f"Warnings: {run.label}", paragraphs=run.figures["warnings"], warning=True) for run in runs]
    found = [findings(run) for run in runs]
    names = list(dict.fromkeys(name for one in found for name in one))
    table = [[name, *(one.get(name, "–") for one in found)] for name in names]
    notes = []
    if math.isfinite(runs[0].start) or math.isfinite(runs[0].end):
        notes.append(f"Rows from {max(runs[0].start, 0.0):g} s to {runs[0].end:g} s count.".replace("to inf s", "on"))
    pictures, drawn_moduli = [], []
    for run in runs:
        poles = run.figures.get("modes", {}).get("poles", [])
        frequencies = [pole["frequency"] for pole in poles if pole["kind"] == "damped" and pole["frequency"] > 0.0]
        for name, law, band in engineering.materials(deck_of(run), run.figures["model"].get("temperatures", [])):
            modulus = name, str(law), band, frequencies
            if modulus not in drawn_moduli:  # two runs often have the same material
                drawn_moduli.append(modulus)
                figure = engineering.modulus_picture(name, law, band, frequencies)
                pictures.append(embed(figure, f"{run.label}: modulus of material {name}"))
    head = ["", *(run.label for run in runs)]
    part = Part(paragraphs=notes, head=head, rows=table, pictures=pictures)
    return Section("Results", [*(one for one in warnings if one.paragraphs), part])


def facts(part: object, lead: str = "") -> dict[str, str]:
    """Return the figures of a part of the summary in words, by what they are; items of a list by their names."""
    if isinstance(part, dict):
        named = {f"{lead}, {key}" if lead else key: value for key, value in part.items() if key != "name"}
        words = {key: key if "[" in key else key.replace("_", " ") for key in named}  # a column keeps its name
        return {name: text for key, value in named.items() for name, text in facts(value, words[key]).items()}
    if isinstance(part, list) and part and isinstance(part[0], dict):
        items = {f"{lead} {item.get('name', number)}": item for number, item in enumerate(part, 1)}
        return {name: "; ".join(f"{key} {words}" for key, words in facts(item).items()) for name, item in items.items()}
    return {lead: ", ".join(map(table_text, part)) if isinstance(part, list) else table_text(part)}


def side_by_side(title: str, runs: list[Run], *parts: str) -> Section | None:
    """Return a section with the figures of parts of the summary, runs side by side; None where no run has any."""
    found = [{name: x for part in parts if part in run.figures for name, x in facts(run.figures[part]).items()} for run in runs]
    names = dict.fromkeys(name for one in found for name in one)
    rows = [[name, *(one.get(name, "") for one in found)] for name in names]
    head = ["SI units", *(run.label for run in runs)]
    return Section(title, [Part(head=head, rows=rows)]) if rows else None


def each(title: str, runs: list[Run], make: Callable[[Run], Part | None]) -> Section | None:
    """Return a section with a part of each run that has one, under its name where there are two runs; None where none has."""
    parts = [(run, part) for run in runs if (part := make(run))]
    for run, part in parts:
        part.heading = run.label if len(runs) > 1 else ""
    return Section(title, [part for _, part in parts]) if parts else None


def scene(runs: list[Run]) -> Section | None:
    """Return the scene as assembled."""

    def of(run: Run) -> Part:
        if run is not runs[0] and run.figures["scene"] == runs[0].figures["scene"]:
            return Part(paragraphs=["The same scene."])
        return Part(pictures=[embed(scene_picture.draw(run.figures, ""), f"{run.label}: the scene as assembled")])

    return each("Scene", runs, of)


def differences(runs: list[Run], names: list[str]) -> list[Part]:
    """Return the second run less the first at the rows that both have: between rows a difference would be that of interpolation."""
    first, second = (run.table("history") for run in runs)
    alike = [name for name in names if first.units[name] == second.units[name]]
    notes = [f"{name}: {first.label(name)} and {second.label(name)} are not compared." for name in names if name not in alike]
    rows = common_rows(first, second)
    if not rows[0].size or not alike:
        notes += [] if rows[0].size else ["The runs have no rows at the same times: with one output_step they can be compared."]
        return [Part(heading="Differences", paragraphs=notes)]
    one, other = ({name: table[name][own] for name in alike} for table, own in zip((first, second), rows))
    change = {name: other[name] - one[name] for name in alike}
    gap = History(first.path, [first.names[0], *alike], first.units, np.column_stack([first.time[rows[0]], *change.values()]))
    table = []
    for name in alike:
        span, largest = float(np.ptp(first[name])), float(np.abs(change[name]).max())
        share = f"{100.0 * largest / span:.3g} %" if span > 0.0 else "–"
        table.append([plot.axis_label(name, first.units[name]), f"{span:.4g}", f"{largest:.4g}", share])
    if rows[0].size < min(first.time.size, second.time.size):
        notes.append(f"{rows[0].size} rows stand at the same times; the others are not compared.")
    shown = [name for name in alike if np.any(change[name])][:MOST_COLUMNS]
    pictures = column_pictures([gap], ["difference"], shown, f"{runs[1].label} less {runs[0].label}")
    head = ["column", f"range of {runs[0].label}", "largest difference", "of the range"]
    return [Part(heading="Differences", paragraphs=notes, head=head, rows=table, pictures=pictures)]


def histories(runs: list[Run]) -> Section | None:
    """Return the sensors against time, runs over each other, and their differences."""
    have = [(run, table) for run in runs if (table := run.table("history")) is not None]
    if not have:
        return None
    tables = [table for _, table in have]
    common = [name for name in tables[0].names[1:] if all(name in table for table in tables)]
    names = plot.moving(tables, common) or common
    labels = [run.label for run, _ in have]
    notes = []
    if len(names) > MOST_COLUMNS:
        notes.append(f"The first {MOST_COLUMNS} of {len(names)} columns are drawn; history.txt holds all.")
    if len(names) < len(common):
        notes.append("Zero or rounding throughout: " + ", ".join(name for name in common if name not in names) + ".")
    missing = sorted({name for table in tables for name in table.names[1:]} - set(common))
    if missing:
        notes.append("Not in both runs: " + ", ".join(missing) + ".")
    parts = [Part(paragraphs=notes)]
    if names:
        parts[0].pictures = column_pictures(tables, labels, names[:MOST_COLUMNS], "sensors against time")
    if len(have) == 2 and names:
        parts += differences(runs, names)
    return Section("Histories", parts)


def energy(run: Run) -> Part | None:
    """Return energies, residual and openings of the joints."""
    table = run.table("energy")
    if table is None:
        return None
    shown = [name for name in table.names[1:] if np.any(table[name])]
    named = f"{run.label}: energies, their residual, openings of joints"
    return Part(pictures=column_pictures([table], [run.label], shown, named))


def modal(run: Run) -> Part | None:
    """Return poles and shapes."""
    table = run.table("modes")
    if table is None:
        return None
    found = run.figures["modes"]
    keys = ("mode", "frequency", "damping_ratio", "real_part")
    rows = [[pole["kind"], *(table_text(pole[key]) for key in keys)] for pole in found["poles"]]
    head = ["kind", "mode", "frequency [Hz]", "damping ratio [-]", "real part [1/s]"]
    shown, words = mode_pictures.Modes(table), ("shapes", "poles", "which layers store and lose", "shear of cores")
    figures = zip((shown.picture(), shown.poles(), shown.shares(), shown.slip()), words)
    pictures = [embed(figure, f"{run.label}: {what}") for figure, what in figures if figure]
    words = [line for line in (found["complete"], found["complete_damped"]) if line]
    return Part(paragraphs=words, head=head, rows=rows, pictures=pictures)


def responses(run: Run) -> Part | None:
    """Return the frequency responses."""
    table = run.table("frequency_response")
    if table is None:
        return None
    figure = mode_pictures.draw_response(table, mode_pictures.sensors(table, None))
    return Part(pictures=[embed(figure, f"{run.label}: response to {run.figures['frequency_response']['input']}")])


def motion(run: Run) -> Part | None:
    """Return snapshots of the motion, and the film that animate.py has made of it, where it has."""
    table = run.table("motion")
    if table is None or len(table.time) < 2:
        return None
    words = f"{len(table.time)} instants from {table.time[0]:.4g} s to {table.time[-1]:.4g} s; three of them below."
    part = Part(paragraphs=[words], pictures=[embed(sheet(from_run(table), 3), f"{run.label}: motion")])
    film = next((path for kind in FILMS if (path := run.folder / f"motion{kind}").is_file()), None)
    if film:
        part.film = f"data:{FILMS[film.suffix]};base64,{base64.b64encode(film.read_bytes()).decode()}"
    else:
        part.paragraphs.append("A film of it stands here where post/animate.py has made one before this page.")
    return part


def sections(runs: list[Run]) -> list[Section]:
    """Return the page's sections; those of which a run has no file are left out."""
    title = "Decks" if len(runs) > 1 else "Deck"
    makers = [
        lambda: results(runs), lambda: scene(runs), lambda: histories(runs), lambda: each("Motion", runs, motion),
        lambda: side_by_side("Equilibrium", runs, "static"), lambda: each("Modes", runs, modal),
        lambda: each("Frequency response", runs, responses), lambda: each("Energy", runs, energy),
        lambda: side_by_side("Model and solver", runs, "model", "transient", "timing"),
        lambda: side_by_side("Stable steps", runs, "stable_steps"),
        lambda: each(title, runs, lambda run: Part(text=run.figures["deck_text"])),
    ]  # fmt: skip
    found, line = [], Progress()
    for number, make in enumerate(makers, 1):
        line.show("sections", number, len(makers))
        found.append(make())
    line.clear()
    return [section for section in found if section]


def page(runs: list[Run], title: str) -> str:
    """Return the page."""
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, keep_trailing_newline=True)
    template = environment.from_string(TEMPLATE.read_text(encoding="utf-8"))
    return template.render(title=title, runs=runs, sections=sections(runs))


@dataclass(frozen=True)
class Report:
    """A page about a run, or about two."""

    html: str  # the page
    findings: dict[str, dict[str, str]]  # what a designer asks, in words, of each run by its label

    def save(self, path: str | Path) -> Path:
        """Write the page; HistoryError where it cannot be written."""
        path = Path(path)
        with writing(path):
            path.write_text(self.html, encoding="utf-8")
            note(path)
        return path

    def to_dataframe(self) -> pandas.DataFrame:
        """Return the findings, a column a run."""
        import pandas

        return pandas.DataFrame(self.findings)

    def _repr_html_(self) -> str:
        return self.to_dataframe().to_html(na_rep="–")


def _names(folders: list[Path]) -> list[str]:
    """Return the last parts of paths, as many as tell them apart; of one folder given twice a number."""
    for parts in range(1, 1 + max(len(path.parts) for path in folders)):
        names = ["/".join(path.parts[-parts:]) for path in folders]
        if len(set(names)) == len(names):
            return names
    return [f"{path.name} ({k})" for k, path in enumerate(folders, 1)]


def report(
    folders: list[Path], labels: list[str] | None = None, title: str = "", start: float = -math.inf, end: float = math.inf
) -> Report:
    """Return the page about one or two results folders; rows from start to end count [s]; HistoryError: damaged, or more."""
    if len(folders) > 2:
        raise HistoryError(f"{len(folders)} runs: one, or two to compare, expected")
    labels = labels or _names([path.resolve() for path in folders])
    if len(labels) != len(folders) or len(set(labels)) < len(labels):
        raise HistoryError(f"{len(labels)} labels ({', '.join(labels)}) for {len(folders)} runs: one each expected, all different")
    runs = [load(*found, start, end) for found in zip(folders, labels)]
    title = title or " – ".join(dict.fromkeys(run.figures["title"] or run.figures["deck"] for run in runs))
    return Report(page(runs, title), {run.label: findings(run) for run in runs})


def work(args: argparse.Namespace) -> int:
    """Write the page and say where it is; raises HistoryError."""
    found = report(args.runs, args.labels, args.title or "", args.start, args.end)
    print(f"wrote {found.save(args.output or args.runs[0] / 'report.html')}")
    return 0
