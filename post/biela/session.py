"""biela from Python: `run` calls the solver; `sweep`, `optimise`, `sensitivity`, `fit`, `tradeoff` do what the programs do.

Every fault is a `BielaError` of few lines, those of the solver where it has refused or stopped.
"""

from __future__ import annotations

import contextlib
import functools
import html
import io
import json
import math
import os
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from . import command, deck_text
from .histories import History, read, read_summary
from .result_files import RESULT_FILES, BielaError

if TYPE_CHECKING:
    import pandas

    from .fit_material import MaterialFit


REPEATED = ("where", "at")  # options that stand once for each of their values


class Figures(dict):
    """Figures of summary.json, as items and as attributes: `figures.transient.steps`."""

    def __getattr__(self, name: str) -> object:
        """Return an item by its name."""
        try:
            return self[name]
        except KeyError:
            raise AttributeError(f"no {name!r}; there are {', '.join(self)}") from None


class Named(list):
    """A list of figures that have names, as items and by these: `figures.scene.bodies.crank`."""

    def __getattr__(self, name: str) -> object:
        """Return an item by its name."""
        found = next((item for item in self if isinstance(item, dict) and item.get("name") == name), None)
        if found is None:
            raise AttributeError(f"no {name!r}; there are {', '.join(str(item['name']) for item in self if 'name' in item)}")
        return found


class SolverError(BielaError):
    """The solver refused a deck or stopped; `result` has what was written until then, `status` is the solver's."""

    def __init__(self, words: str, status: int, result: Result | None) -> None:
        super().__init__(words)
        self.status, self.result = status, result


class Result:
    """What a run left: its tables, its figures, its warnings.

    `result["tip.v"]` is a column of the history, `result.time` its times; `result.energy`, `.motion`, `.modes`, `.static` and
    `.frequency_response` are the other tables, read when they are asked for.

    Attributes:
        folder: of the results
    """

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
        return _figures(read_summary(self.folder))

    @property
    def warnings(self) -> list[str]:
        """What the solver warned of."""
        return list(self.summary.warnings)

    def to_dataframe(self, kind: str = "history") -> pandas.DataFrame:
        """Return a table as a pandas DataFrame, units in the names of its columns."""
        return getattr(self, kind).to_dataframe()

    def findings(self) -> dict[str, str]:
        """Return what the report begins with: largest deflections, stresses, reactions, torques, energies, frequencies."""
        from . import report

        return report.findings(report.load(self.folder, self.summary.deck, "A"))

    def _repr_html_(self) -> str:
        rows = "".join(f"<tr><td>{html.escape(a)}</td><td>{html.escape(b)}</td></tr>" for a, b in self.findings().items())
        warnings = "".join(f"<p><b>warning:</b> {html.escape(words)}</p>" for words in self.warnings)
        head = html.escape(f"{self.summary.title or self.summary.deck}: {self.summary.outcome}")
        return f"<p><b>{head}</b></p>{warnings}<table>{rows}</table>"

    def __repr__(self) -> str:
        return f"<biela.Result {self.summary.deck}: {self.summary.outcome}, {len(self.warnings)} warnings, {self.folder}>"


def _figures(value: object) -> object:
    """Return a JSON value with its objects as `Figures`."""
    if isinstance(value, dict):
        return Figures({name: _figures(item) for name, item in value.items()})
    return Named(_figures(item) for item in value) if isinstance(value, list) else value


def find_solver(solver: str | Path | None = None) -> Path:
    """Return the path of the solver: as given, of the environment's BIELA, built in the project, or on the PATH; BielaError."""
    path = Path(solver or os.environ.get("BIELA") or command.SOLVER)
    if not path.is_file():
        raise BielaError(f"no solver: looked at {path} and for `biela` on the PATH; `make` builds it, solver= or BIELA names it")
    return path.resolve()


def run(
    deck: str | Path, *, set: Mapping[str, object] | None = None, folder: str | Path | None = None, solver: str | Path | None = None
) -> Result:
    """Run a deck and return its results.

    Args:
        deck: path of a deck, or its text, whose files are looked for from the current folder
        set: values by name: of parameters (`L`), or of variables of the deck (`section/rod/height`, `transient/step`)
        folder: of the results; left out: one that lasts as long as the result
        solver: the program

    Raises:
        SolverError: the solver refuses the deck or stops; its words.
        BielaError: there is no solver, or a name of `set` is not in the deck.
    """
    program = find_solver(solver)
    text = str(deck) if isinstance(deck, str) and ("&" in deck or "\n" in deck) else None
    source, given = ("-", text) if text is not None else (str(deck), None)
    values = {name: _literal(name, value) for name, value in (set or {}).items()}
    words = [word for name, value in values.items() if "/" not in name for word in ("--set", f"{name}={value}")]
    variables = {name: value for name, value in values.items() if "/" in name}
    if variables:
        given, source, words = _with_variables(_call([program, "--flat", *words, source], given).stdout, variables), "-", []
    keep = tempfile.TemporaryDirectory(prefix="biela-") if folder is None else None
    results = Path(folder) if folder is not None else Path(keep.name) / "results"
    done = _call([program, "--quiet", "--output", results, *words, source], given, results, keep)
    return done if isinstance(done, Result) else Result(results, keep)


def _literal(name: str, value: object) -> str:
    """Return a value as decks write it: numbers in full, words in quotes, lists with commas."""
    if isinstance(value, bool):
        return ".true." if value else ".false."
    if isinstance(value, str):
        return value if "/" not in name else f"'{value}'"
    if hasattr(value, "__iter__"):
        return ",".join(_literal(name, item) for item in value)
    if isinstance(value, (int, float)) or hasattr(value, "__float__"):
        if not math.isfinite(float(value)):
            raise BielaError(f"{name} = {value}: a finite number expected")
        return repr(int(value)) if isinstance(value, int) else repr(float(value))
    raise BielaError(f"{name}: {type(value).__name__} is no value of a deck; a number, a word, or a list expected")


def _with_variables(text: str, variables: dict[str, str]) -> str:
    """Return a flat deck with variables set, each named group/variable or group/name/variable."""
    from .sweep_run import assign
    from .sweep_study import TARGET, Target

    deck = deck_text.parse(text)
    for words, value in variables.items():
        found = TARGET.fullmatch(words.lower())
        if not found:
            raise BielaError(f"{words}: group/variable or group/name/variable expected")
        target = Target(found["group"], found["name"] or "", found["variable"], int(found["index"] or 0))
        deck = assign(deck, target, value)
    return deck.text


def _call(words: list, given: str | None, folder: Path | None = None, keep: object = None) -> subprocess.CompletedProcess:
    """Call the solver with a deck's text on its standard input; SolverError with its words where it does not end with 0."""
    try:
        done = subprocess.run(words, input=given, stdin=None if given is not None else subprocess.DEVNULL, capture_output=True,
                              encoding="utf-8", errors="replace", check=False)  # fmt: skip
    except OSError as fault:
        raise BielaError(f"{words[0]}: cannot be run ({fault.strerror})") from None
    if done.returncode:
        lines = [line for line in done.stderr.splitlines() if line.strip() and ": warning: " not in line]
        written = folder is not None and (folder / "summary.json").is_file()
        message = "\n".join(lines) or f"the solver ended with status {done.returncode}"
        raise SolverError(message, done.returncode, Result(folder, keep) if written else None)
    return done


def _tool(name: str, *words: object, **options: object) -> tuple[int, str]:
    """Do what a program of post/ does, options as its command line has them; returns its status and what it prints."""
    from importlib import import_module

    line = [str(word) for word in words]
    for option, value in options.items():
        values = [] if value is True else value if isinstance(value, (list, tuple)) else [value]
        flag = f"--{option.replace('_', '-')}"
        if option in REPEATED:
            line += [word for one in values for word in (flag, str(one))]
        elif value is not None and value is not False:
            line += [flag, *map(str, values)]
    output, errors = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(errors):
        try:
            status = import_module(f".commands.{name}", __package__).main(line)
        except SystemExit:
            status = 2
        except ModuleNotFoundError as fault:
            raise BielaError(f"{name}: {command.missing(fault)}") from None
    if status not in (0, 1):
        raise BielaError(errors.getvalue().strip() or f"{name} ended with status {status}")
    return status, output.getvalue()


def sweep(study: str | Path, folder: str | Path | None = None, **options: object) -> pandas.DataFrame:
    """Run a study (STUDY.toml) and return its table; options are those of post/sweep.py (`jobs=4`, `dask=...`).

    Raises:
        BielaError: the study or its deck is wrong.
    """
    import pandas

    results = Path(folder or Path("results") / "sweep" / Path(study).stem)
    _tool("sweep", study, output=results, biela=find_solver(), no_pictures=True, **options)
    return pandas.read_csv(results / "table.csv")


def optimise(study: str | Path, folder: str | Path | None = None, **options: object) -> Figures:
    """Search the best design of a study; options are those of post/optimise.py (`best="min mass"`, `where=["peak < 1e-3"]`).

    Returns:
        `parameters` and `results` of the best design, whether it is `feasible`, `prices` of the limits, `sensitivities`,
        `runs`, `notes`, and the `report` in lines; history and pictures are in the folder.

    Raises:
        BielaError: the study or its deck is wrong.
    """
    results = Path(folder or Path("results") / "optimise" / Path(study).stem)
    _tool("optimise", study, output=results, biela=find_solver(), **options)
    return _figures(json.loads((results / "optimum.json").read_text(encoding="utf-8")))


def sensitivity(study: str | Path, folder: str | Path | None = None, **options: object) -> pandas.DataFrame:
    """Return derivatives of a study's results with their errors; options are those of post/sensitivity.py (`at=["L=0.3"]`).

    Raises:
        BielaError: the study or its deck is wrong, or the design fails.
    """
    import pandas

    results = Path(folder or Path("results") / "sensitivity" / Path(study).stem)
    status, output = _tool("sensitivity", study, output=results, biela=find_solver(), **options)
    if status:
        raise BielaError(output.strip())
    return pandas.read_csv(results / "table.csv")


def fit(table: str | Path, folder: str | Path | None = None, **options: object) -> MaterialFit:
    """Fit terms to measured moduli; nothing is printed, and nothing drawn without a folder.

    Args:
        table: of measured moduli
        folder: gets NAME.nml and NAME.png
        options: those of `fit_material.Options` (`density=1200` [kg/m3], `law="maxwell"`, `terms=3`)

    Returns:
        the `material`, its `error`, `warnings`, the deck's `text`; `picture()`, `to_dataframe()`.

    Raises:
        BielaError: the table cannot be fitted.
    """
    from . import fit_material

    found = fit_material.fit_table(table, fit_material.Options(**options))
    if folder is not None:
        fit_material.write(found, Path(folder) / Path(table).stem)
    return found


def tradeoff(deck: str | Path, folder: str | Path | None = None, **options: object) -> str:
    """Return what the trade-off tool says of a deck: which method, step and model; options are those of post/tradeoff.py.

    Raises:
        BielaError: the deck is wrong, or has nothing to compare.
    """
    results = Path(folder or Path("results") / "tradeoff" / Path(deck).stem)
    _tool("tradeoff", deck, output=results, biela=find_solver(), quiet=True, **options)
    return (results / "tradeoff.txt").read_text(encoding="utf-8")
