"""What a sweep varies and what it measures, read from a TOML file (post/README.md says what one can state)."""

from __future__ import annotations

import csv
import itertools
import math
import os
import re
import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .histories import read as read_table
from .result_files import BielaError, HistoryError
from .sweep_scalars import Scalar
from .units import factor

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

TARGET = re.compile(r"\w+/([\w-]+/)?\w+(\(\d+\))?")
DESIGNS = ("grid", "zip", "latin_hypercube", "random")
MOST_RUNS = 1_000_000  # of a study


class StudyError(BielaError):
    """A study that cannot be read or makes no sense."""


@dataclass(frozen=True)
class Parameter:
    """A quantity that is varied."""

    name: str  # column of the table; of the deck's parameter where there are no targets
    targets: tuple[str, ...]  # GROUP/NAME/KEY that get it, in the place of a parameter
    values: tuple  # what it takes
    log: bool  # a Latin hypercube samples it by its logarithm
    unit: str = ""  # as the table and the pictures show it
    ends: tuple[float, float] | None = None  # between which it is free, none where it takes its values alone
    start: float | None = None  # where a search begins
    spread: float | None = None  # by how much it may be off
    catalogue: dict[str, dict[str, float]] = field(default_factory=dict)  # the deck's parameters by the value, a row's name
    deviation: float = 0.0  # standard deviation about its one value, in a random design

    def settings(self, value: object) -> dict[str, object]:
        """Return the deck's parameters that a value means, by name; none where variables get it."""
        if self.catalogue:
            return self.catalogue[value]
        return {} if self.targets else {self.name: value}

    @property
    def label(self) -> str:
        """Its name with its unit, as the table has it."""
        return f"{self.name}[{self.unit}]" if self.unit else self.name


@dataclass(frozen=True)
class StudyOptions:
    """How the runs of a study are made, and what is asked of them."""

    study: Path  # the file
    biela: Path  # the solver
    output: Path | None = None  # folder of the results; None: results/<tool>/<study name>
    jobs: int | None = None  # runs side by side; None: as many as there are cores
    scheduler: str | None = None  # address of a Dask scheduler, in place of this machine's cores
    keep: bool = False  # all decks and results stay
    best: str = ""  # 'min NAME' or 'max NAME', '': what the study says
    allow_warnings: bool = False  # designs for whose motion the model does not hold may be the best one
    where: tuple[str, ...] = ()  # conditions 'NAME < VALUE' beside those of the study
    at: tuple[str, ...] = ()  # 'NAME=VALUE' of parameters at which sensitivities are taken
    start: float = -math.inf  # rows before do not count for results that do not say `from` themselves [s]
    end: float = math.inf  # rows after do not count for results that do not say `to` themselves [s]
    longest: float = math.inf  # seconds after which a run is stopped [s]

    @property
    def workers(self) -> int:
        """Runs side by side."""
        return self.jobs or os.cpu_count() or 1

    def folder(self, tool: str) -> Path:
        """Return the folder of the results of a tool."""
        return self.output or Path("results") / tool / self.study.stem


@dataclass(frozen=True)
class Study:
    """A study."""

    name: str  # of the file, without its ending
    deck: Path  # path of the base deck
    parameters: tuple[Parameter, ...]  # in the order of the file
    scalars: tuple[Scalar, ...]  # what is measured of each run
    points: tuple[dict, ...]  # values of all parameters, one dictionary a run
    best: str = ""  # 'min NAME' or 'max NAME', '' where the file states none
    where: tuple[str, ...] = ()  # conditions 'NAME < VALUE'
    starts: int = 3  # of a search
    runs: int = 1000  # that a search may make
    extremes: bool = False  # the runs tell those of columns
    check: bool = False  # the runs measure their own errors
    quantiles: tuple[float, ...] = ()  # of the results, where the points are drawn at random; none where they are not
    follow: bool = False  # cycles of `&periodic` start from that of the last value of the last parameter
    measured: object = None  # a record that measures a run in place of scalars: `of(folder)`, and the `names` of what it gives

    @property
    def columns(self) -> tuple[Parameter | Scalar, ...]:
        """Parameters and results, as in the table."""
        return (*self.parameters, *self.scalars)


def read(path: Path, design: bool = True) -> Study:
    """Read a study, without the points of its design where they are not wanted; StudyError names the file and what is wrong."""
    try:
        with path.open("rb") as file:
            content = tomllib.load(file)
    except FileNotFoundError:
        raise StudyError(f"{path}: no such file") from None
    except (OSError, ValueError, RecursionError) as fault:  # ValueError: of the text's encoding, of TOML, of a number's length
        raise StudyError(f"{path}: cannot be read as TOML ({fault})") from None
    try:
        return _study(path, content, design)
    except StudyError as fault:
        raise StudyError(f"{path}: {fault}") from None


def _need(good: object, words: str) -> None:
    """Refuse a study, in words, where something is not as it should be; StudyError."""
    if not good:
        raise StudyError(words)


def _study(path: Path, content: dict, design: bool) -> Study:
    """Return the study that a TOML file states."""
    words = ("deck", "design", "samples", "seed", "quantiles", "follow", "parameter", "result", "best", "where", "starts", "runs")
    _known(content, words, "the study")
    _need(isinstance(content.get("deck"), str), "deck = 'FILE.nml' is missing")
    parameters = tuple(_parameter(entry, path.parent) for entry in _tables(content, "parameter"))
    scalars = tuple(_scalar(entry, path.parent) for entry in _tables(content, "result"))
    _once(parameters)
    names = [one.name for one in (*parameters, *scalars)]
    twice = sorted({name for name in names if names.count(name) > 1})
    _need(not twice, f"the name {''.join(map(repr, twice[:1]))} is given twice")
    best, where = content.get("best", ""), content.get("where", [])
    listed = isinstance(where, list) and all(isinstance(one, str) for one in where)
    _need(isinstance(best, str) and listed, "best = 'min NAME' and where = ['NAME < VALUE'] expected")
    counts = {word: content[word] for word in ("starts", "runs") if word in content}
    for word, value in counts.items():
        _need(type(value) is int and value > 0, f"{word} = {value!r}: a whole number of at least 1 expected")
    points = _points(content, parameters) if design else ()
    levels = content.get("quantiles", [0.05, 0.5, 0.95])
    listed = isinstance(levels, list) and levels and all(type(one) in (int, float) and 0.0 < one < 1.0 for one in levels)
    _need(listed, f"quantiles = {levels!r}: numbers between 0 and 1 expected")
    levels = tuple(sorted(levels)) if design and content.get("design") == "random" else ()
    follow = content.get("follow", False)
    ordered = isinstance(follow, bool) and (not follow or content.get("design", "grid") in ("grid", "zip"))
    _need(ordered, f"follow = {follow!r}: true or false expected, with design = 'grid' or 'zip'")
    deck, more = (path.parent / content["deck"]).resolve(), dict(**counts, quantiles=levels, follow=follow)
    return Study(path.stem, deck, parameters, scalars, points, best, tuple(where), **more)


def _once(parameters: tuple[Parameter, ...]) -> None:
    """Refuse parameters that set one place of the deck twice: the whole of a list and an item, too."""
    taken: list[str] = []
    for one in parameters:
        names = next(iter(one.catalogue.values())) if one.catalogue else () if one.targets else (one.name,)
        for place in [*map(str.lower, one.targets), *(f"parameter/{name}/value".lower() for name in names)]:
            whole = place.partition("(")[0]
            twice = any(other in (place, whole) or other.partition("(")[0] == place for other in taken)
            _need(not twice, f"parameter {one.name}: {place} is set twice, by parameters of which the later would have no effect")
            taken.append(place)


def _known(entry: dict, words: tuple[str, ...], what: str) -> None:
    """Refuse words that mean nothing."""
    unknown = sorted(set(entry) - set(words))
    _need(not unknown, f"{what}: {''.join(map(repr, unknown[:1]))} is not known; one of {', '.join(words)} expected")


def _tables(content: dict, kind: str) -> list[dict]:
    """Return the tables [[kind]] of a study."""
    found = content.get(kind, [])
    tables = isinstance(found, list) and all(isinstance(entry, dict) for entry in found)
    _need(tables, f"{kind}: tables [[{kind}]] expected")
    _need(found, f"no [[{kind}]] is given")
    return found


def _parameter(entry: dict, folder: Path) -> Parameter:
    """Return one [[parameter]]; folder: of the study."""
    instead = "expected in the deck, &parameter name='...' value={...}, whose value follows those that vary"
    _need("expression" not in entry, f"expression: {instead}")
    _known(entry, PARAMETER_WORDS, "[[parameter]]")
    name = entry.get("name", "")
    named = isinstance(name, str) and name.isidentifier()
    _need(named, f"[[parameter]] name = {name!r}: a word of letters, digits and _ expected")
    targets = tuple(entry.get("set", [])) if isinstance(entry.get("set", []), list) else (entry["set"],)
    for text in targets:
        good = isinstance(text, str) and TARGET.fullmatch(text)
        _need(good, f"set: {text!r}: 'group/name/variable', 'group/variable' or '.../variable(2)' expected")
    kinds = sum(word in entry for word in ("values", "from", "catalogue", "mean"))
    _need(kinds == 1, f"parameter {name}: one of values, from, mean or catalogue expected")
    log, unit = entry.get("spacing", "linear") == "log", str(entry.get("unit", ""))
    if "catalogue" in entry:
        rows = _catalogue(name, folder, entry["catalogue"])
        _need(not targets, f"parameter {name}: a catalogue names the deck's parameters; `set` has no place beside it")
        return Parameter(name, (), tuple(rows), False, unit, catalogue=rows)
    start, spread, mean, deviation = (_number(name, entry, word) for word in ("start", "spread", "mean", "deviation"))
    both = (mean is None) == (deviation is None) and (deviation or 1.0) > 0.0
    _need(both, f"parameter {name}: mean and deviation go together, the latter a number above 0")
    values: tuple = (mean,)
    if "values" in entry:
        values = tuple(entry["values"]) if isinstance(entry["values"], list) else ()
        good = values and all(isinstance(value, (int, float, str, bool)) for value in values)
        _need(good, f"parameter {name}: values = [...] expected, numbers or words")
    elif mean is None:
        values = _range(name, entry, log)
    good = targets or all(type(value) in (int, float) for value in values)
    _need(good, f"parameter {name}: numbers expected; words go to variables that `set` names")
    ends = (min(values), max(values)) if "from" in entry and min(values) < max(values) else None
    good = start is None or (ends and ends[0] <= start <= ends[1])
    _need(good, f"parameter {name}: start = {entry.get('start')}: a value between from and to expected")
    _need(spread is None or spread > 0.0, f"parameter {name}: spread = {entry.get('spread')}: a number above 0 expected")
    return Parameter(name, targets, values, log, unit, ends, start, spread, deviation=deviation or 0.0)


def _number(name: str, entry: dict, word: str) -> float | None:
    """Return a finite number of a table, None where it is not given."""
    value = entry.get(word)
    good = value is None or (type(value) in (int, float) and math.isfinite(value))
    _need(good, f"parameter {name}: {word} = {value!r}: a number expected")
    return None if value is None else float(value)


def _catalogue(name: str, folder: Path, file: object) -> dict[str, dict[str, float]]:
    """Return the rows of a catalogue: a table whose first column names the rows, the others the deck's parameters."""
    where = f"parameter {name}: catalogue = {file!r}"
    _need(isinstance(file, str), f"{where}: the name of a table (.csv) expected")
    try:
        with (folder / file).open(encoding="utf-8-sig", newline="") as text:
            lines = [[word.strip() for word in line] for line in csv.reader(text) if any(word.strip() for word in line)]
    except (OSError, UnicodeDecodeError, ValueError, csv.Error) as fault:
        raise StudyError(f"{where}: cannot be read ({getattr(fault, 'strerror', None) or fault})") from None
    good = len(lines) > 1 and len(lines[0]) > 1 and all(word.isidentifier() for word in lines[0][1:])
    _need(good, f"{where}: a first line 'name,PARAMETER,...' expected, then a row of each item")
    rows: dict[str, dict[str, float]] = {}
    for line in lines[1:]:
        try:
            numbers = [float(word) for word in line[1:]]
        except ValueError:
            numbers = []
        good = len(line) == len(lines[0]) and line[0] not in rows and numbers and all(map(math.isfinite, numbers))
        _need(good, f"{where}: {','.join(line)[:60]!r}: a new name and {len(lines[0]) - 1} numbers expected")
        rows[line[0]] = dict(zip(lines[0][1:], numbers))
    return rows


def _range(name: str, entry: dict, log: bool) -> tuple:
    """Return the values of from, to, points, spacing."""
    try:
        first, last, points = float(entry["from"]), float(entry["to"]), int(entry.get("points", 2))
    except (KeyError, TypeError, ValueError, OverflowError):
        raise StudyError(f"parameter {name}: from, to and points expected, all numbers") from None
    _need(points <= MOST_RUNS, f"parameter {name}: points = {points}: at most {MOST_RUNS} runs expected")
    good = points >= 2 and math.isfinite(first) and math.isfinite(last) and (not log or min(first, last) > 0.0)
    _need(good, f"parameter {name}: two points or more expected, finite ends, positive ones for spacing = 'log'")
    _need(entry.get("spacing", "linear") in ("linear", "log"), f"parameter {name}: spacing = 'linear' or 'log' expected")
    return tuple((np.geomspace if log else np.linspace)(first, last, points).tolist())


PARAMETER_WORDS = ("name", "set", "values", "from", "to", "points", "spacing", "unit", "catalogue", "start", "spread", "mean")
PARAMETER_WORDS += ("deviation",)
RESULT_WORDS = ("name", "measure", "column", "file", "at", "target", "band", "within", "from", "to", "period", "periods", "order")
RESULT_WORDS += ("reference", "strength", "cycles", "slope", "ultimate", "data", "data_column", "error", "key", "unit", "mode")


def _scalar(entry: dict, folder: Path) -> Scalar:
    """Return one [[result]]; folder: of the study."""
    _known(entry, RESULT_WORDS, "[[result]]")
    own = "unit" not in entry or (entry.get("measure") == "summary" and isinstance(entry["unit"], str))
    _need(own, f"[[result]] {entry.get('name', '')}: unit = '...' belongs to measure = 'summary', others have their own")
    options = {{"from": "start", "to": "end", "unit": "stated_unit"}.get(key, key): value for key, value in entry.items()}
    try:
        if "data" in options:
            file, column = options.pop("data"), options.pop("data_column", options.get("column", ""))
            if not isinstance(file, str) or not isinstance(column, str):
                raise ValueError("data = 'FILE.csv' and data_column = 'NAME' expected")
            options["measured"], options["measured_units"] = _measured(folder / file, column)
        return Scalar(**options)
    except (TypeError, ValueError, HistoryError) as fault:
        raise StudyError(f"[[result]] {entry.get('name', '')}: {fault}") from None


def _measured(path: Path, column: str) -> tuple[tuple[tuple[float, ...], ...], tuple[str, str]]:
    """Return times and values of a table, of a response frequencies, real and imaginary parts, and their units; HistoryError."""
    table = read_table(path)
    of_time = table.units[table.names[0]]
    if column in table or f"{column}.amplitude" not in table:
        return (tuple(table.time.tolist()), tuple(table[column].tolist())), (of_time, table.units[column])
    turn = factor(table.units[f"{column}.phase"] or "rad", "rad")
    response = table[f"{column}.amplitude"] * np.exp(1j * turn * table[f"{column}.phase"])
    parts = tuple(table.time.tolist()), tuple(response.real.tolist()), tuple(response.imag.tolist())
    return parts, (of_time, table.units[f"{column}.amplitude"])


def _points(content: dict, parameters: tuple[Parameter, ...]) -> tuple[dict, ...]:
    """Return the values of all parameters of every run."""
    design, lists = content.get("design", "grid"), [parameter.values for parameter in parameters]
    _need(design in DESIGNS, f"design = {design!r}: one of {', '.join(DESIGNS)} expected")
    if design == "grid":
        good = math.prod(map(len, lists)) <= MOST_RUNS
        _need(good, f"design = 'grid': the parameters' values make more than {MOST_RUNS} runs")
    elif design == "zip":
        _need(len({*map(len, lists)}) == 1, "design = 'zip': all parameters need as many values as the first")
    ordered = {"grid": itertools.product, "zip": zip}
    rows = ordered[design](*lists) if design in ordered else _sample(content, parameters, design)
    return tuple(dict(zip((parameter.name for parameter in parameters), row)) for row in rows)


def _sample(content: dict, parameters: tuple[Parameter, ...], design: str) -> list[tuple]:
    """Return the rows of a Latin hypercube, or random ones: normal with a deviation, even between from and to, one of a list."""
    samples, seed = content.get("samples"), content.get("seed", 0)
    good = isinstance(samples, int) and samples > 0 and isinstance(seed, int) and seed >= 0
    _need(good, f"design = {design!r}: samples = a whole number expected, seed too where given")
    _need(samples <= MOST_RUNS, f"design = {design!r}: samples = {samples}: at most {MOST_RUNS} runs expected")
    random = design == "random"
    good = all(isinstance(value, (int, float)) or (random and not one.ends) for one in parameters for value in one.values)
    _need(good, f"design = {design!r}: parameters have to be numbers")
    generator = np.random.default_rng(seed)
    columns = []
    for parameter in parameters:
        if random and not parameter.ends:
            drawn = generator.integers(len(parameter.values), size=samples)
            steps = parameter.deviation * generator.standard_normal(samples)
            pairs = [(parameter.values[k], float(step)) for k, step in zip(drawn, steps)]
            columns.append([value + step if parameter.deviation else value for value, step in pairs])
            continue
        strata = 0.0 if random else generator.permutation(samples)  # of a hypercube: one value in each of as many
        part = (strata + generator.random(samples)) / (1 if random else samples)
        low, high = min(parameter.values), max(parameter.values)
        _need(not parameter.log or low * high > 0.0, f"parameter {parameter.name}: positive numbers expected for spacing = 'log'")
        columns.append((low * (high / low) ** part if parameter.log else low + (high - low) * part).tolist())
    return list(zip(*columns))
