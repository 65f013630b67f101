"""Smaller models of the same scene: what can be taken out of a deck, one thing at a time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from .deck import Deck, Group
from .material_fit import fit, relative_error
from .material_law import GHM_KEYS, MAXWELL_KEYS, Material, moved, of_group, over_static, static_key

MODAL = ("modes", "static_shapes")  # taken away together: nodal coordinates have no static shapes
ELASTIC = ("coordinate", "internal", "stress")  # what sensors measure of flexible bodies alone
ROWS, ABOVE = 40, 10.0  # of a fit of Maxwell terms: frequencies; it covers this factor below the slowest relaxation


@dataclass(frozen=True)
class Change:
    """One thing that can be taken out of a model: of what (a body, material, spring), and which."""

    of: str
    what: str
    deck: Deck

    @property
    def label(self) -> str:
        """In words."""
        return f"{self.of}: {self.what}"


def is_flexible(body: Group) -> bool:
    """Whether a body has elastic coordinates."""
    return body.word("kind") in ("beam", "frame") and body.flag("flexible", True)


def coordinates(body: Group) -> int:
    """Return the number of nodal elastic coordinates of a beam or frame."""
    nodes = int(body.number("elements")) + 1 if body.word("kind") == "beam" else len(body.numbers("node_x"))
    kept = "uvr" if body.flag("axial", True) else "vr"
    held = [] if body.word("reference") == "free" else body.words("reference_dof") or ["u", "v", "v"]
    return nodes * len(kept) - sum(dof in kept for dof in held)


def changed(deck: Deck, body: Group, values: dict, asked: set[str]) -> Deck | None:
    """Return the deck with a body's values set, None where a key goes, without sensors that mean nothing there.

    None where that is a sensor that must stay: of a rigid body one of elastic quantities, of other coordinates that of one.
    """
    lost = ELASTIC if values.get("flexible") is False else ELASTIC[: "modes" in values or "axial" in values]
    gone = [one for one in deck.all("sensor") if one.word("body") == body.name and one.word("quantity") in lost]
    return None if any(one.name in asked for one in gone) else deck.set(body, **values).drop(*gone)


def removals(deck: Deck, asked: set[str], highest: float, target: float) -> list[Change]:
    """Return every single thing that can be taken out of a model; what is impossible is left out.

    Maxwell terms take the place of GHM terms up to a frequency, the highest [Hz], where the modulus errs by the target at most [-].
    """
    found: list[Change] = []
    for body in (group for group in deck.all("body") if is_flexible(group)):
        for what, values in _body_changes(deck, body):
            if less := changed(deck, body, values, asked):
                found.append(Change(body.name, what, less))
    used = {name for body in deck.all("body") if is_flexible(body) and body.flag("viscoelastic", True) for name in _materials(body)}
    for group in deck.all("material", "spring"):
        if group.kind == "spring" or group.name in used:
            known = max(1.0, moved(group, deck)[0]) * highest  # terms stay those of the reference
            found += [Change(group.name, what, deck.set(group, **values)) for what, values in _term_changes(group, known, target)]
    return found


def _materials(body: Group) -> list[str]:
    """Return the names of the materials of a body."""
    return body.words("material") + body.words("element_material")


def _body_changes(deck: Deck, body: Group) -> list[tuple[str, dict]]:
    """Return (label, values) of what can be switched off in a flexible body."""
    stiff = body.flag("stiffening", False)
    found: list = [("rigid", {"flexible": False, **dict.fromkeys(("stiffening", *MODAL, "axial", "viscoelastic"))})]
    damped = any(_has_terms(one) for one in deck.all("material") if one.name in _materials(body))
    if damped and body.flag("viscoelastic", True):
        found.append(("elastic twin", {"viscoelastic": False}))
    if stiff:
        return [*found, ("no stiffening", {"stiffening": False})]
    if body.word("kind") == "beam" and body.flag("axial", True):
        found.append(("no axial deformation", {"axial": False}))
    count = int(body.number("modes")) or coordinates(body)
    some = {b * 2**j for b in (2, 3) for j in range(8)} | {1, count - 1, count - 2}
    for k in sorted((k for k in some if 0 < k < count), reverse=True):
        if not body.flag("static_shapes", False):
            found.append((f"{k} mode{'s' * (k > 1)} of {count} coordinates", {"modes": k}))
        if body.flag("static_shapes", False) or 3 * k <= count:
            found.append((f"{k} mode{'s' * (k > 1)} and static shapes", {"modes": k, "static_shapes": True}))
    return found


def _has_terms(group: Group) -> bool:
    """Whether a material or spring has viscoelastic terms."""
    return bool(group.numbers(GHM_KEYS[0]) or group.numbers(MAXWELL_KEYS[0]))


def _term_changes(group: Group, highest: float, target: float) -> list[tuple[str, dict]]:
    """Return (label, values) of what can be done to the terms of a material or spring.

    Each is left out (too fast to matter) or made part of the static modulus or stiffness (too slow to relax). GHM terms of a
    measured material often share their poles: then half as many internal variables, those of Maxwell terms, are as good.
    """
    found, law = [], of_group(group) if _has_terms(group) else None
    for words, keys in (("GHM", GHM_KEYS), ("Maxwell", MAXWELL_KEYS)):
        for k, alpha in enumerate(group.numbers(keys[0])):
            rest = {key: [x for j, x in enumerate(group.numbers(key)) if j != k] for key in keys}
            weights = {key: rest.get(key, group.numbers(key)) for key in (GHM_KEYS[0], MAXWELL_KEYS[0])}
            alone = {"ghm_frequency_scale": None} if not any(weights.values()) else {}
            scaled = {key: [x / (1.0 + alpha) for x in items] or None for key, items in weights.items() if key in group.values}
            without = {**{key: items or None for key, items in rest.items()}, **alone}
            label = f"{words} term {k + 1} of {len(group.numbers(keys[0]))}"
            folded = {**without, **scaled, static_key(group): group.number(static_key(group)) * (1.0 + alpha)}
            found += [(f"{label} left out", without), (f"{label} as stiffness", folded)]
    for fitted, error in _maxwell(tuple(map(tuple, law.arrays)), law.young, highest) if law and law.alpha.size else ():
        if error <= target:
            values: dict = dict.fromkeys(key for key in (*GHM_KEYS, *MAXWELL_KEYS, "ghm_frequency_scale") if key in group.values)
            values |= dict(zip(MAXWELL_KEYS, (fitted.weight.tolist(), fitted.tau.tolist())))
            values[static_key(group)] = fitted.young / over_static(group)
            found.append((f"{fitted.weight.size} Maxwell terms (modulus within {error:.1g})", values))
    return found


@lru_cache(maxsize=64)
def _maxwell(arrays: tuple[tuple[float, ...], ...], young: float, highest: float) -> list[tuple[Material, float]]:
    """Return fits of one Maxwell term up to one for each term there is, with their largest errors over the band [-]."""
    law = Material(young, *map(np.array, arrays))
    lowest = law.slowest_pole / (2.0 * np.pi * ABOVE)
    band = np.geomspace(lowest, max(highest, ABOVE * lowest), ROWS)
    modulus, fastest = law.modulus(band), ABOVE * 2.0 * np.pi * band[-1]
    fits = [fit("maxwell", count, band, modulus, fastest).material for count in range(1, law.alpha.size + law.weight.size + 1)]
    return [(one, float(relative_error(one, band, modulus).max())) for one in fits]
