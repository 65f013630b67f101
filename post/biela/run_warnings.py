"""What the solver warned of in the runs of a study: each sentence once, with the designs for which it holds."""

from __future__ import annotations

import re
from collections.abc import Iterable

NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(\.\d*)?(e[-+]?\d+)?", re.IGNORECASE)
NAMED = 3  # designs that are named


def told_once(designs: Iterable[tuple[dict, Iterable[str]]]) -> list[str]:
    """Return the warnings of designs (values by name, sentences); sentences that differ in their numbers alone are told once."""
    designs = list(designs)
    found: dict[str, tuple[str, list[dict]]] = {}
    for point, sentences in designs:
        for words in sentences:
            found.setdefault(NUMBER.sub("#", words), (words, []))[1].append(point)
    lines = []
    for words, points in found.values():
        names = [", ".join(f"{name} = {_shown(value)}" for name, value in point.items()) for point in points[:NAMED]]
        more = "; ..." if len(points) > NAMED else ""
        lines.append(f"{len(points)} of {len(designs)} designs ({'; '.join(names)}{more}): {words}")
    return lines


def _shown(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
