"""Units of measured tables, and by what numbers in one are multiplied to be in another."""

from __future__ import annotations

import math
import re

from .result_files import HistoryError

SYMBOLS = {  # size in SI units, and powers of m, kg, s, rad
    "m": (1.0, (1, 0, 0, 0)),
    "g": (1.0e-3, (0, 1, 0, 0)),
    "s": (1.0, (0, 0, 1, 0)),
    "rad": (1.0, (0, 0, 0, 1)),
    "N": (1.0, (1, 1, -2, 0)),
    "Nm": (1.0, (2, 1, -2, 0)),
    "Pa": (1.0, (-1, 1, -2, 0)),
    "J": (1.0, (2, 1, -2, 0)),
    "W": (1.0, (2, 1, -3, 0)),
    "Hz": (1.0, (0, 0, -1, 0)),
    "min": (60.0, (0, 0, 1, 0)),
    "h": (3600.0, (0, 0, 1, 0)),
    "deg": (math.pi / 180.0, (0, 0, 0, 1)),
    "°": (math.pi / 180.0, (0, 0, 0, 1)),
    "rpm": (math.pi / 30.0, (0, 0, -1, 1)),
    "in": (0.0254, (1, 0, 0, 0)),
    "%": (0.01, (0, 0, 0, 0)),
    "-": (1.0, (0, 0, 0, 0)),
    "1": (1.0, (0, 0, 0, 0)),
}
PREFIXES = {"n": 1e-9, "u": 1e-6, "µ": 1e-6, "μ": 1e-6, "m": 1e-3, "c": 1e-2, "k": 1e3, "M": 1e6, "G": 1e9}
PREFIXED = ("m", "g", "s", "rad", "N", "Nm", "Pa", "J", "W", "Hz")
TOKEN = re.compile(r"(?P<symbol>[^\W\d]+|[°%1-])(?:\^?(?P<power>-?\d+))?")


def factor(unit: str, wanted: str) -> float:
    """Return by what numbers in a unit are multiplied to be in the wanted one (mm/s2, m/s2); HistoryError: they cannot."""
    if unit == wanted:
        return 1.0
    size, powers = _size(unit)
    of_wanted, others = _size(wanted)
    if powers != others:
        raise HistoryError(f"the unit {unit!r} does not go with {wanted!r}")
    return size / of_wanted


def _size(unit: str) -> tuple[float, tuple[int, ...]]:
    """Return a unit in SI units, and its powers; HistoryError: not known."""
    size, powers = 1.0, (0, 0, 0, 0)
    plain = unit.strip().translate(str.maketrans({"²": "2", "³": "3", "·": " ", "*": " "}))
    for k, part in enumerate(plain.split("/")):
        for word in part.split():
            found = TOKEN.fullmatch(word)
            symbol = found["symbol"] if found else ""
            prefix = symbol[:1] if symbol not in SYMBOLS and symbol[:1] in PREFIXES and symbol[1:] in PREFIXED else ""
            if symbol.removeprefix(prefix) not in SYMBOLS:
                raise HistoryError(f"the unit {unit!r} is not known")
            one, own = SYMBOLS[symbol.removeprefix(prefix)]
            power = int(found["power"] or 1) * (-1 if k else 1)
            size *= (PREFIXES.get(prefix, 1.0) * one) ** power
            powers = tuple(have + power * more for have, more in zip(powers, own))
    return size, powers
