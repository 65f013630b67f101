"""Simpler viscoelastic terms of a deck: without a term, with stiffness in its place, or fewer Maxwell terms for GHM terms.

Neighbouring GHM terms of a measured material often share their poles; then half as many internal variables, those of Maxwell terms,
give nearly the same modulus. The measure is the largest relative error of the complex modulus from a tenth of the slowest
relaxation up to the highest frequency that is asked for.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from .deck_text import Group
from .material_fit import fit, relative_error
from .material_law import GHM_KEYS, MAXWELL_KEYS, Material, of_group, static_key

ROWS = 40  # frequencies of a fit
ABOVE = 10.0  # the fit covers this factor below the slowest relaxation; poles reach this factor above the band


def has_terms(group: Group) -> bool:
    """Whether a material or spring has viscoelastic terms."""
    return bool(group.items(GHM_KEYS[0]) or group.items(MAXWELL_KEYS[0]))


def changes(group: Group, highest: float, target: float) -> list[tuple[str, dict[str, str | None]]]:
    """Return (label, values) of what can be done to the terms of a material or spring.

    Each is left out (too fast to matter) or made part of the static modulus or stiffness (too slow to relax).

    Args:
        group: the material or spring
        highest: frequency that is asked for [Hz]
        target: largest error of the modulus with which Maxwell terms are offered for GHM terms [-]
    """
    found = []
    for words, keys in (("GHM", GHM_KEYS), ("Maxwell", MAXWELL_KEYS)):
        for k, alpha in enumerate(group.numbers(keys[0])):
            found += _without(group, words, keys, k, alpha)
    law = of_group(group)
    if law.alpha.size:
        for fitted, error in _maxwell(tuple(map(tuple, law.arrays)), law.young, highest):
            if error <= target:
                label = f"{fitted.weight.size} Maxwell terms (modulus within {error:.1g})"
                values = dict.fromkeys((*GHM_KEYS, *MAXWELL_KEYS, "ghm_frequency_scale")) | fitted.assignments(static_key(group))
                found.append((f"{group.name}: {label}", values))
    return found


def _without(group: Group, words: str, keys: tuple[str, ...], k: int, alpha: float) -> list[tuple[str, dict[str, str | None]]]:
    """Return the two changes by which term k of a law goes; the weights of the others are those of the new stiffness."""
    rest = {key: [item for j, item in enumerate(group.items(key)) if j != k] for key in keys}
    without = {key: ",".join(items) or None for key, items in rest.items()}
    if len(group.items(GHM_KEYS[0])) + len(group.items(MAXWELL_KEYS[0])) == 1:
        without["ghm_frequency_scale"] = None
    weights = {key: rest.get(key, group.items(key)) for key in (GHM_KEYS[0], MAXWELL_KEYS[0])}
    scaled = {key: ",".join(repr(float(x) / (1.0 + alpha)) for x in items) or None for key, items in weights.items()}
    folded = {**without, **scaled, static_key(group): repr(group.number(static_key(group)) * (1.0 + alpha))}
    label = f"{group.name}: {words} term {k + 1} of {len(group.items(keys[0]))}"
    return [(f"{label} left out", without), (f"{label} as stiffness", folded)]


@lru_cache(maxsize=64)
def _maxwell(arrays: tuple[tuple[float, ...], ...], young: float, highest: float) -> list[tuple[Material, float]]:
    """Return fits of one Maxwell term up to one for each term there is, with their largest errors over the band [-]."""
    law = Material(young, *map(np.array, arrays))
    lowest = law.slowest_pole / (2.0 * np.pi * ABOVE)
    band = np.geomspace(lowest, max(highest, ABOVE * lowest), ROWS)
    modulus = law.modulus(band)
    fastest, most = ABOVE * 2.0 * np.pi * band[-1], law.alpha.size + law.weight.size
    fits = [fit("maxwell", count, band, modulus, fastest) for count in range(1, most + 1)]
    return [(one.material, float(relative_error(one.material, band, modulus).max())) for one in fits]
