"""Reads measured complex moduli: a table of frequency, storage and loss modulus or loss factor, temperature, set; DataError."""

from __future__ import annotations

import csv
import math
import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from .result_files import BielaError

USUAL = {
    "frequency": ("f", "freq", "frequency", "omega", "w"),
    "storage": ("e_stor", "e'", "estor", "e_storage", "storage", "storage modulus", "g_stor", "g'", "modulus"),
    "loss": ("e_loss", "e''", 'e"', "eloss", "loss modulus", "g_loss", "g''"),
    "factor": ("eta", "tan_delta", "tand", "tan delta", "loss factor", "loss_factor", "loss"),
    "temperature": ("t", "temp", "temperature"),
    "set": ("set", "sweep", "isotherm"),
}
FREQUENCY_UNITS = {"hz": 1.0, "khz": 1.0e3, "1/s": 1.0, "rad/s": 0.5 / np.pi, "krad/s": 500.0 / np.pi}
MODULUS_UNITS = {"pa": 1.0, "kpa": 1.0e3, "mpa": 1.0e6, "gpa": 1.0e9, "n/m2": 1.0, "n/mm2": 1.0e6}
RATIO_UNITS = {"-": 1.0, "1": 1.0, "": 1.0, "%": 0.01}
ANGULAR = ("omega", "w")  # names of frequencies whose unit 1/s means rad/s
SHEAR = ("g",)  # how names of shear moduli begin
TEMPERATURE_UNITS = {"c": 273.15, "°c": 273.15, "degc": 273.15, "celsius": 273.15, "k": 0.0, "kelvin": 0.0}
LEAST, LARGEST = 1.0e-100, 1.0e100  # of frequencies [Hz], moduli [Pa], loss factors: rates, squares and ratios stay finite
HEADING = re.compile(r"(?P<name>.*?)\s*_?[\[(](?P<unit>[^\])]*)[\])]\s*")


class DataError(BielaError):
    """A table of measurements that cannot be used."""


@dataclass(frozen=True)
class Measurements:
    """A complex modulus as measured, sorted by temperature and frequency."""

    frequency: np.ndarray  # [Hz]
    modulus: np.ndarray  # complex modulus [Pa]
    temperature: np.ndarray  # of each row [K], NaN where the table states none
    group: np.ndarray  # index of the temperature at which each row was measured, from cold to warm
    zero: float  # of the table's scale of temperature [K]
    shear: bool = False  # whether it is the shear modulus

    @property
    def temperatures(self) -> np.ndarray:
        """Mean temperature of each group, ascending [K]; empty where the table states none."""
        if np.isnan(self.temperature).any():
            return np.zeros(0)
        return np.array([self.temperature[self.group == k].mean() for k in range(self.group.max() + 1)])

    def name(self, temperature: float) -> str:
        """Return a temperature [K] as the table would state it."""
        return f"{round(temperature - self.zero, 6) + 0.0:.4g} {'C' if self.zero else 'K'}"


def read(path: Path, names: dict[str, str] | None = None, units: str = "", tolerance: float = 0.5) -> Measurements:
    """Read a table; `names`: of columns by keys of USUAL; units where it has none; temperatures within a tolerance [K] are one."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise DataError(f"{path}: no such file") from None
    except (OSError, UnicodeDecodeError) as fault:
        raise DataError(f"{path}: cannot be read as text ({fault})") from None
    lines = [(k, line) for k, line in enumerate(text.splitlines(), 1) if line.strip() and not line.lstrip().startswith("#")]
    if not lines:
        raise DataError(f"{path}: is empty; a line of column names such as f,E_stor,E_loss expected")
    rows = [(k, _split(line, lines[0][1])) for k, line in lines]
    headings = [HEADING.fullmatch(word) for word in rows[0][1]]
    columns = [found["name"] if found else word for found, word in zip(headings, rows[0][1])]
    stated = [found["unit"] if found else None for found in headings]
    rows = rows[1:]
    if rows and np.isnan([_number(word) for word in rows[0][1]]).all():
        stated = [word.strip("[]() ") for word in rows.pop(0)[1]]
    where = _find_columns(path, columns, names or {})
    scale = _scales(path, columns, where, stated, [word.strip() for word in units.split(",")] if units else [])
    kinds = {columns[where[one]].lower().startswith(SHEAR) for one in ("storage", "loss") if one in where}
    if len(kinds) > 1:
        names = " and ".join(columns[where[one]] for one in ("storage", "loss"))
        raise DataError(f"{path}: {names}: a modulus of tension and one of shear; two of one kind expected")
    return replace(_measurements(path, rows, where, scale, len(columns), tolerance), shear=kinds.pop())


def _split(line: str, first: str) -> list[str]:
    """Return the words of a line, separated as the first line of the table is."""
    separator = next((mark for mark in ";,\t" if mark in first), None)
    words = next(csv.reader([line], delimiter=separator)) if separator else line.split()
    words = [word.strip() for word in words]
    return [word.replace(",", ".") for word in words] if separator == ";" else words


def _number(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        return math.nan


def _find_columns(path: Path, columns: list[str], names: dict[str, str]) -> dict[str, int]:
    """Return the column's index of each quantity that the table holds."""
    low = [column.lower() for column in columns]
    where = {}
    for quantity, usual in USUAL.items():
        if quantity in names:
            if names[quantity].lower() not in low:
                raise DataError(f"{path}: no column {names[quantity]!r}; it has {', '.join(columns)}")
            where[quantity] = low.index(names[quantity].lower())
        elif found := [k for k, column in enumerate(low) if column in usual]:
            where[quantity] = found[0]
    if "loss" in names or "factor" in names:
        where.pop("factor" if "loss" in names else "loss", None)
    missing = [quantity for quantity in ("frequency", "storage") if quantity not in where]
    missing += [] if {"loss", "factor"} & set(where) else ["loss"]
    if missing:
        raise DataError(f"{path}: no column of {missing[0]} found among {', '.join(columns)}; name it with --{missing[0]}")
    return where


def _scales(path: Path, columns: list[str], where: dict[str, int], stated: list[str | None], given: list[str]) -> dict[str, float]:
    """Return what each quantity's numbers are multiplied by (temperature: what is added), from their units."""
    kinds = {"frequency": FREQUENCY_UNITS, "storage": MODULUS_UNITS, "loss": MODULUS_UNITS, "factor": RATIO_UNITS}
    kinds["temperature"] = TEMPERATURE_UNITS
    order = [quantity for quantity in kinds if quantity in where]
    scale = {}
    for quantity in order:
        k = where[quantity]
        unit = given[order.index(quantity)] if order.index(quantity) < len(given) else stated[k] if k < len(stated) else None
        if unit is None and quantity == "factor":
            unit = "-"
        if unit is None:
            raise DataError(f"{path}: the unit of {quantity} is not stated: add a line of units such as Hz,MPa,MPa, or --units")
        exact = {"MHz": 1.0e6, "mHz": 1.0e-3} if quantity == "frequency" else {}
        if unit not in exact and unit.lower() not in kinds[quantity]:
            known = ", ".join(filter(None, kinds[quantity]))
            raise DataError(f"{path}: {unit!r} is no unit of {quantity}; one of {known} expected")
        angular = quantity == "frequency" and unit.lower() == "1/s" and columns[k].lower() in ANGULAR
        scale[quantity] = exact.get(unit) or kinds[quantity]["rad/s" if angular else unit.lower()]
    return scale


def _measurements(path: Path, rows: list, where: dict, scale: dict, width: int, tolerance: float) -> Measurements:
    """Return the rows as complex moduli; DataError names the first line that cannot be one."""
    values, sets = [], []
    for number, words in rows:
        if len(words) < width:
            raise DataError(f"{path}:{number}: {len(words)} values, {width} expected")
        row = {}
        for quantity, k in where.items():
            if quantity == "set":
                continue
            if not np.isfinite(_number(words[k])):
                raise DataError(f"{path}:{number}: {words[k]!r} is no finite number ({quantity})")
            row[quantity] = float(words[k]) * (1.0 if quantity == "temperature" else scale[quantity])
            if quantity != "temperature" and not LEAST <= row[quantity] <= LARGEST:
                ends = f"from {LEAST:g} to {LARGEST:g}"
                raise DataError(f"{path}:{number}: {quantity} = {words[k]}, a positive value {ends} expected")
        kelvin = row["temperature"] + scale["temperature"] if "temperature" in row else np.nan
        if kelvin <= 0.0:
            raise DataError(f"{path}:{number}: {kelvin:g} K lies below absolute zero: is the unit right?")
        loss = row["loss"] if "loss" in row else row["factor"] * row["storage"]
        values.append((kelvin, row["frequency"], row["storage"], loss, number))
        sets.append(words[where["set"]] if "set" in where else "")
    if len(values) < 2:
        raise DataError(f"{path}: {len(values)} rows of numbers, two or more frequencies expected")
    table, labels = np.array(values), np.array(sets)
    group = _groups(path, table[:, 0], labels, tolerance)
    order = np.lexsort((table[:, 1], labels, group))
    table, labels, group = table[order], labels[order], group[order]
    twice = (np.diff(table[:, 1]) == 0.0) & (np.diff(group) == 0) & (labels[1:] == labels[:-1])
    if twice.any():
        row = table[1:][twice][0]
        raise DataError(f"{path}:{row[4]:.0f}: the frequency {row[1]:g} Hz is given twice (temperatures in a column T?)")
    return Measurements(table[:, 1], table[:, 2] + 1j * table[:, 3], table[:, 0], group, scale.get("temperature", 0.0))


def _groups(path: Path, kelvin: np.ndarray, labels: np.ndarray, tolerance: float) -> np.ndarray:
    """Return the index of each row's temperature, from cold to warm: that of its set, or of what no gap parts."""
    if np.isnan(kelvin).any():
        return np.zeros(kelvin.size, dtype=int)
    nominal = kelvin.copy()
    for label in np.unique(labels[labels != ""]):
        nominal[labels == label] = kelvin[labels == label].mean()
    order = np.argsort(nominal, kind="stable")
    group = np.empty(kelvin.size, dtype=int)
    group[order] = np.append(0, np.cumsum(np.diff(nominal[order]) > tolerance))
    for k in range(group.max() + 1):
        width = np.ptp(kelvin[group == k])
        if width > 4.0 * tolerance:
            words = (
                f"{path}: temperatures that run over {width:.3g} K count as one, no gap between them being above {tolerance:g} K"
            )
            raise DataError(f"{words}: measured while it changed? A smaller --tolerance, or a column 'set', tells them apart")
    return group
