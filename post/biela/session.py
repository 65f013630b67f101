"""biela from Python: `run` calls the solver, the others do what the programs do; every fault is a `BielaError` of few lines."""

from __future__ import annotations

import functools
import html
import math
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from . import command
from .deck import literal
from .figures import Figures, figures
from .histories import History, read, read_summary
from .result_files import RESULT_FILES, BielaError
from .sweep_study import StudyOptions

if TYPE_CHECKING:
    import pandas

    from .decays import RingDown
    from .fit_material import MaterialFit
    from .identify_work import Identified
    from .mode_pictures import Modes
    from .optimum import Optimum
    from .report_page import Report
    from .sensitivity_work import Sensitivity
    from .spectrum_work import Spectrum
    from .sweep_work import Sweep
    from .tradeoff_work import Tradeoff


REPEATED = ("where", "at", "sensor", "methods")  # options that are lists


class SolverError(BielaError):
    """The solver refused a deck or stopped; `result` has what was written until then, `status` is the solver's."""

    def __init__(self, words: str, status: int, result: Result | None) -> None:
        super().__init__(words)
        self.status, self.result = status, result


class Result:
    """What a run left in its `folder`: `result["tip.v"]`, `.time` of the history, `.energy`, `.motion`, ..., `.summary`."""

    def __init__(self, folder: str | Path, keep: object = None) -> None:
        self.folder = Path(folder)
        self._keep = keep  # a temporary folder lives as long as its result

    def __getattr__(self, name: str) -> History:
        """Return a table by its name."""
        if name not in RESULT_FILES:
            raise AttributeError(f"a result has no {name!r}")
        table = read(self.folder, name)
        setattr(self, name, table)
        return table

    def __getitem__(self, name: str):
        """Return a column of the history; BielaError where there is none."""
        return self.history[name]

    @property
    def time(self):
        """The times of the history [s]."""
        return self.history.time

    @functools.cached_property
    def summary(self) -> Figures:
        """All figures of the run (input/README.md lists them)."""
        return figures(read_summary(self.folder))

    @property
    def warnings(self) -> list[str]:
        """What the solver warned of."""
        return list(self.summary.warnings)

    def to_dataframe(self, kind: str = "history") -> pandas.DataFrame:
        """Return a table as a pandas DataFrame, units in the names of its columns."""
        return getattr(self, kind).to_dataframe()

    def findings(self) -> dict[str, str]:
        """Return what the report begins with: largest deflections, stresses, reactions, torques, energies, frequencies."""
        from . import report_page

        return report_page.findings(report_page.load(self.folder, self.summary.deck))

    def _repr_html_(self) -> str:
        rows = "".join(f"<tr><td>{html.escape(a)}</td><td>{html.escape(b)}</td></tr>" for a, b in self.findings().items())
        warnings = "".join(f"<p><b>warning:</b> {html.escape(words)}</p>" for words in self.warnings)
        head = html.escape(f"{self.summary.title or self.summary.deck}: {self.summary.outcome}")
        return f"<p><b>{head}</b></p>{warnings}<table>{rows}</table>"

    def __repr__(self) -> str:
        return f"<biela.Result {self.summary.deck}: {self.summary.outcome}, {len(self.warnings)} warnings, {self.folder}>"


def find_solver(solver: str | Path | None = None) -> Path:
    """Return the path of the solver: as given, of the environment's BIELA, built in the project, or on the PATH; BielaError."""
    path = Path(solver or os.environ.get("BIELA") or command.SOLVER)
    if not path.is_file():
        raise BielaError(f"no solver: looked at {path} and for `biela` on the PATH; `make` builds it, solver= or BIELA names it")
    return path.resolve()


def run(
    deck: str | Path, *, set: Mapping[str, object] | None = None, folder: str | Path | None = None, solver: str | Path | None = None
) -> Result:
    """Run a deck (a path, or its text) and return its results; SolverError with its words where the solver refuses it or stops.

    Values are set by name, of parameters (`L`) or variables (`section/rod/height`). Without a folder results last as long as this.
    """
    program = find_solver(solver)
    text = str(deck) if isinstance(deck, str) and ("&" in deck or "\n" in deck) else None
    source, given = ("-", text) if text is not None else (str(deck), None)
    words = [word for name, value in (set or {}).items() for word in ("--set", f"{name}={_literal(name, value)}")]
    keep = tempfile.TemporaryDirectory(prefix="biela-") if folder is None else None
    results = Path(folder) if folder is not None else Path(keep.name) / "results"
    done = command.call_solver(program, "--quiet", "--output", results, *words, source, given=given)
    if not done.returncode:
        return Result(results, keep)
    lines = [line for line in done.stderr.splitlines() if line.strip() and ": warning: " not in line]
    written = (results / "summary.json").is_file()
    message = "\n".join(lines) or f"the solver ended with status {done.returncode}"
    raise SolverError(message, done.returncode, Result(results, keep) if written else None)


def _literal(name: str, value: object) -> str:
    """Return a value as decks write it: numbers in full, words in quotes, lists with commas; a parameter's are expressions."""
    if isinstance(value, str):
        return literal(value) if "/" in name else value
    try:
        return ",".join(map(literal, value)) if hasattr(value, "__iter__") else literal(value)
    except BielaError as fault:
        raise BielaError(f"{name}: {fault}") from None


def _options(kind: type, tool: str, source: str | Path, folder: str | Path | None, given: Mapping[str, object]) -> object:
    """Return a record of options of a function."""
    listed = {name: (value,) if isinstance(value, str) and name in REPEATED else value for name, value in given.items()}
    listed = {name: tuple(value) if isinstance(value, list) else value for name, value in listed.items()}
    output = Path(folder) if folder is not None else None
    try:
        return kind(Path(source), find_solver(listed.pop("solver", None)), output, **listed)
    except TypeError as fault:
        raise BielaError(f"{tool}: {str(fault).partition(' ')[2]}") from None


def sweep(study: str | Path, folder: str | Path | None = None, **options: object) -> Sweep:
    """Run a study (STUDY.toml), what is not stored of it, and return its table.

    Options: those of `sweep_study.StudyOptions` (`jobs=4`, `scheduler="tcp://..."`, `start`, `end` [s]). Returned:
    `to_dataframe()`, `best("min peak", ["area < 2e-4"])`, `failed`, `quantiles` and `shares()` of random designs.
    """
    from .sweep_work import sweep as make

    return make(_options(StudyOptions, "sweep", study, folder, options))


def optimise(study: str | Path, folder: str | Path | None = None, **options: object) -> Optimum:
    """Search the best design of a study; options as of `sweep` (`best="min mass"`).

    Returned: `parameters`, `results`, `feasible`, `prices` of limits, `sensitivities`, `report`; `to_dataframe()` has all runs.
    """
    from .optimise_work import optimise as search

    return search(_options(StudyOptions, "optimise", study, folder, options))


def sensitivity(study: str | Path, folder: str | Path | None = None, **options: object) -> Sensitivity:
    """Take derivatives of results, with errors; options as of `sweep` (`at=["L=0.3"]`): `to_dataframe()`, `report`, `picture()`."""
    from .sensitivity_work import sensitivity as take

    return take(_options(StudyOptions, "sensitivity", study, folder, options))


def identify(study: str | Path, folder: str | Path | None = None, **options: object) -> Identified:
    """Find parameters of a deck from what was measured (results with measure = 'misfit'); options as of `sweep`.

    Returned: `parameters`, `intervals` (95 %), `untold`: combinations of which the data tell nothing, `report`, `picture()`.
    """
    from .identify_work import identify as find

    return find(_options(StudyOptions, "identify", study, folder, options))


def fit(table: str | Path, folder: str | Path | None = None, **options: object) -> MaterialFit:
    """Fit terms to a table of measured moduli; a folder gets NAME.nml and NAME.png, without it nothing is drawn.

    Options: those of `fit_material.Options` (`density=1200` [kg/m3], `law="maxwell"`). Returned: `material`, `error` [-], `text`.
    """
    from . import fit_material

    found = fit_material.fit_table(table, fit_material.Options(**options))
    if folder is not None:
        fit_material.write(found, Path(folder) / Path(table).stem)
    return found


def tradeoff(deck: str | Path, folder: str | Path | None = None, **options: object) -> Tradeoff:
    """Measure speed against accuracy of a deck; the folder gets tradeoff.txt and recommended.nml.

    Options: those of `tradeoff_settings.TradeoffOptions` (`sensor=["tip"]`, `tolerance=1e-3` [-], `time=60.0` [s]). Returned:
    `verdict`, `text`, `meets`, `recommended`, the deck's path; `to_dataframe()`.
    """
    from .tradeoff_settings import TradeoffOptions
    from .tradeoff_work import tradeoff as measure

    return measure(_options(TradeoffOptions, "tradeoff", deck, folder, options))


def spectrum(
    run: str | Path | Result | History, columns: str | list[str], start: float = -math.inf, end: float = math.inf, **options: object
) -> Spectrum:
    """Take the spectra of columns (wildcards allowed) of a result, a history, or a results folder, from start to end [s].

    Options: `orders="crank"`, the column of a drive's angle [rad], `turns=(-1, -1)`, `reference=1e-6` [unit of the column],
    `most=5` lines a column. Returned: `lines` (frequency [Hz], error, amplitude), `amplitudes`, `densities`, `picture()`.
    """
    from .spectrum_work import spectrum as take

    table = run.history if isinstance(run, Result) else run if isinstance(run, History) else read(run)
    return take(table.between(start, end), [columns] if isinstance(columns, str) else columns, **options)


def ring_down(run: str | Path | Result | History, column: str, start: float = -math.inf, end: float = math.inf) -> RingDown:
    """Find the decaying vibrations of a column of a result, a history, or a results folder, from start to end [s].

    Returned: `vibrations`, the largest share first, each with `frequency` [Hz], `damping_ratio` [-], `rate` [1/s], their errors
    (half of the 95 % interval), `share` [-] and `resolved`; `to_dataframe()`.
    """
    from .decays import ring_down as find

    table = run.history if isinstance(run, Result) else run if isinstance(run, History) else read(run)
    table = table.between(start, end)
    return find(table.time, table[column])


def modes(run: str | Path | Result) -> Modes:
    """Return the modes of a result or a results folder: `to_dataframe()` with [Hz], [-], [1/s], [rad/s]; `picture()`, `poles()`."""
    from .mode_pictures import Modes

    return Modes(run.modes if isinstance(run, Result) else read(run, "modes"))


def report(*runs: str | Path | Result, **options: object) -> Report:
    """Return a page (HTML) about a run, or about two side by side: results, or results folders.

    Options: `labels=["old", "new"]`, `title`; `start`, `end`: rows that count [s]. Returned: the `html`, the `findings` by run;
    `save(path)`, `to_dataframe()`.
    """
    from .report_page import report as write

    return write([run.folder if isinstance(run, Result) else Path(run) for run in runs], **options)
