"""Smaller and larger models of the same scene: what can be taken out of a deck, and how its mesh and model are refined.

Node numbers, element lists and coordinate numbers everywhere in the deck follow the new mesh. A sensor that has no counterpart on
the new model (a node that is gone, the coordinate of a rigid body) goes, unless it was asked for: then the change is impossible.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from .deck import Deck, DeckError, Group
from .material_fit import fit, relative_error
from .material_law import GHM_KEYS, MAXWELL_KEYS, Material, moved, of_group, over_static, static_key

MODAL = ("modes", "static_shapes")  # taken away together: nodal coordinates have no static shapes
NODE_KEYS = (("node_a", "body_a"), ("node_b", "body_b"), ("node", "body"))
ROWS, ABOVE = 40, 10.0  # of a fit of Maxwell terms: frequencies; it covers this factor below the slowest relaxation


class ImpossibleError(DeckError):
    """A change that a sensor asked for, a joint or a load does not allow."""


@dataclass(frozen=True)
class Change:
    """One thing that can be taken out of a model: of what (a body, material, spring), which kind of change, how much is left."""

    of: str
    what: str
    deck: Deck
    count: int = 0

    @property
    def label(self) -> str:
        """In words."""
        return f"{self.of}: {self.what}"

    @property
    def kind(self) -> str:
        """What it counts or switches off: changes of one kind of the same thing overtake each other."""
        return " ".join(word.rstrip("s") for word in self.what.split() if not word.isdigit())


def is_flexible(body: Group) -> bool:
    """Whether a body has elastic coordinates."""
    return body.word("kind") in ("beam", "frame") and body.flag("flexible", True)


def elements_of(body: Group) -> int:
    """Return the number of elements of a beam or frame."""
    return int(body.number("elements")) if body.word("kind") == "beam" else len(body.numbers("element_nodes")) // 2


def nodes_of(body: Group) -> int:
    """Return the number of nodes of a beam or frame."""
    return elements_of(body) + 1 if body.word("kind") == "beam" else len(body.numbers("node_x"))


def coordinates(body: Group) -> list[tuple[int, str]]:
    """Return (node, 'u'|'v'|'r') of each nodal elastic coordinate, in the solver's order (input/README.md, sensor 'coordinate')."""
    last = nodes_of(body)
    removed = {"pinned": {(1, "u"), (1, "v"), (last, "v")}, "clamped": {(1, "u"), (1, "v"), (1, "r")}}.get(
        body.word("reference", "pinned"), set()
    )
    if "reference_node" in body.values:
        nodes = [int(n) if n > 0 else last for n in body.numbers("reference_node")]
        removed = set(zip(nodes, body.words("reference_dof")))
    kept = "uvr" if body.flag("axial", True) else "vr"
    return [(node, dof) for node in range(1, last + 1) for dof in kept if (node, dof) not in removed]


def changed(deck: Deck, name: str, values: dict, asked: set[str], nodes: dict[int, int] | None = None) -> Deck:
    """Return the deck with a body's values set, None where a key goes, and every reference to the body adapted.

    `asked` are sensors that must stay, `nodes` the new number of each old node that stays (None: the mesh stays). ImpossibleError:
    a joint, load or asked-for sensor needs what the change takes away.
    """
    before = deck.one("body", name)
    deck = deck.set(before, **values)
    after = deck.one("body", name)
    for group in deck.groups:
        edits, lost = _renumbered(group, name, nodes, nodes_of(before))
        if group.kind == "sensor" and group.word("body") == name and not lost:
            edits, lost = _sensor(group, before, after, nodes, edits)
        if lost and (group.kind != "sensor" or group.name in asked):
            raise ImpossibleError(f"{group.kind} {group.name}: {lost}")
        if lost:
            deck = deck.drop(group)
        elif edits:
            deck = deck.set(group, **edits)
    return deck


def _renumbered(group: Group, name: str, nodes: dict[int, int] | None, last: int) -> tuple[dict, str]:
    """Return the new node numbers of a group, and what it loses."""
    edits = {}
    for key, owner in NODE_KEYS:
        node = int(group.number(key)) if key in group.values and group.word(owner) == name else 0
        if nodes is None or node in (0, -1):
            continue
        if node not in nodes:
            return {}, f"node {node} of {last} of body {name} is not on this mesh"
        edits[key] = nodes[node]
    return edits, ""


def _sensor(group: Group, before: Group, after: Group, nodes: dict[int, int] | None, edits: dict) -> tuple[dict, str]:
    """Return what changes in a sensor on the changed body, and what it loses."""
    quantity = group.word("quantity")
    if quantity not in ("coordinate", "internal", "stress"):
        return edits, ""
    if not is_flexible(after):
        return {}, f"body {after.name} is rigid here"
    if quantity == "stress":
        return edits, ""
    if quantity == "internal":
        return ({}, "the elements are others here") if nodes is not None else (edits, "")
    index, modes = int(group.number("index")), int(after.number("modes"))
    if int(before.number("modes")) and modes:
        return (edits, "") if index <= modes else ({}, f"mode {index} is not on this model")
    if int(before.number("modes")) or modes or index > len(coordinates(before)):
        return {}, f"body {after.name} has other coordinates here"
    node, dof = coordinates(before)[index - 1]
    coordinate = (node if nodes is None else nodes.get(node, 0), dof)
    if coordinate not in coordinates(after):
        return {}, f"coordinate {index} is not modelled here"
    return {**edits, "index": coordinates(after).index(coordinate) + 1}, ""


def with_elements(deck: Deck, name: str, count: int, asked: set[str]) -> Deck:
    """Return the deck with another number of elements of a beam; `ImpossibleError` where a place is not on that mesh."""
    body = deck.one("body", name)
    old = elements_of(body)
    nodes = {k + 1: k * count // old + 1 for k in range(old + 1) if k * count % old == 0}
    values: dict = {"elements": count}
    materials = body.values.get("element_material")
    if materials:
        values["element_material"] = [materials[int((e + 0.5) * old / count)] for e in range(count)]
        if [values["element_material"][int((e + 0.5) * count / old)] for e in range(old)] != materials:
            raise ImpossibleError(f"body {name}: {count} elements do not follow its materials")
    if "reference_node" in body.values:
        kept = [int(n) for n in body.numbers("reference_node")]
        if any(n != -1 and n not in nodes for n in kept):
            raise ImpossibleError(f"body {name}: a reference node is not on this mesh")
        values["reference_node"] = [n if n == -1 else nodes[n] for n in kept]
    return changed(deck, name, values, asked, nodes)


def split_frame(deck: Deck, name: str, asked: set[str]) -> Deck:
    """Return the deck with every element of a frame cut in two; the last node stays the last one."""
    body = deck.one("body", name)
    pairs = np.array(body.numbers("element_nodes"), dtype=int).reshape(-1, 2)
    last, count = nodes_of(body), len(pairs)
    new = {k: k for k in range(1, last)} | {last: last + count}
    lists: dict = {"element_nodes": [n for e, (a, b) in enumerate(pairs.tolist()) for n in (new[a], last + e, last + e, new[b])]}
    for key in ("node_x", "node_y"):
        places = np.array(body.numbers(key))
        lists[key] = [*places[:-1].tolist(), *places[pairs - 1].mean(axis=1).tolist(), float(places[-1])]
    for key in ("material", "section", "element_material"):
        if len(body.values.get(key, [])) > 1:
            lists[key] = [item for item in body.values[key] for _ in range(2)]
    if "reference_node" in body.values:
        lists["reference_node"] = [new.get(int(n), int(n)) for n in body.numbers("reference_node")]
    return changed(deck, name, lists, asked, new)


def refined(deck: Deck, doublings: int, asked: set[str]) -> Deck:
    """Return the deck with every element of its flexible bodies cut in 2**doublings, and with what the kinematics leave out.

    That is: nodal coordinates instead of modes, axial deformation.
    """
    for name in [group.name for group in deck.all("body") if is_flexible(group)]:
        group, values = deck.one("body", name), {}
        if group.number("modes"):
            free = group.word("reference") == "free"
            values = {"modes": int(group.number("modes")) * 2**doublings} if free else dict.fromkeys(MODAL)
        if not group.flag("axial", True):
            values["axial"] = None
        if values:
            deck = changed(deck, name, values, asked)
        if group.word("kind") == "beam":
            deck = with_elements(deck, name, elements_of(group) * 2**doublings, asked)
        else:
            for _ in range(doublings):
                deck = split_frame(deck, name, asked)
    return deck


def removals(deck: Deck, asked: set[str], highest: float, target: float) -> list[Change]:
    """Return every single thing that can be taken out of a model; what is impossible is left out.

    Maxwell terms take the place of GHM terms up to a frequency, the highest [Hz], where the modulus errs by the target at most [-].
    """
    found: list[Change] = []
    for body in (group for group in deck.all("body") if is_flexible(group)):
        for what, count, values in _body_changes(deck, body):
            with contextlib.suppress(ImpossibleError):
                found.append(Change(body.name, what, changed(deck, body.name, values, asked), count))
        own = elements_of(body)
        for count in sorted({n for n in range(1, own) if own % n == 0 or n == own - 1}, reverse=True):
            if body.word("kind") == "beam":
                with contextlib.suppress(ImpossibleError):
                    what = f"{count} of {own} elements"
                    found.append(Change(body.name, what, with_elements(deck, body.name, count, asked), count))
    used = {name for body in deck.all("body") if is_flexible(body) and body.flag("viscoelastic", True) for name in _materials(body)}
    for group in deck.all("material", "spring"):
        if group.kind == "spring" or group.name in used:
            known = max(1.0, moved(group, deck)[0]) * highest  # terms stay those of the reference
            found += [Change(group.name, what, deck.set(group, **values)) for what, values in _term_changes(group, known, target)]
    return found


def _materials(body: Group) -> list[str]:
    """Return the names of the materials of a body."""
    return body.words("material") + body.words("element_material")


def _body_changes(deck: Deck, body: Group) -> list[tuple[str, int, dict]]:
    """Return (label, what is left, values) of what can be switched off in a flexible body."""
    stiff = body.flag("stiffening", False)
    found: list = [("rigid", 0, {"flexible": False, **dict.fromkeys(("stiffening", *MODAL, "axial", "viscoelastic"))})]
    damped = any(_has_terms(one) for one in deck.all("material") if one.name in _materials(body))
    if damped and body.flag("viscoelastic", True):
        found.append(("elastic twin", 0, {"viscoelastic": False}))
    if stiff:
        return [*found, ("no stiffening", 0, {"stiffening": False})]
    if body.word("kind") == "beam" and body.flag("axial", True):
        found.append(("no axial deformation", 0, {"axial": False}))
    count = int(body.number("modes")) or len(coordinates(body))
    some = {b * 2**j for b in (2, 3) for j in range(8)} | {1, count - 1, count - 2}
    for k in sorted((k for k in some if 0 < k < count), reverse=True):
        if not body.flag("static_shapes", False):
            found.append((f"{k} mode{'s' * (k > 1)} of {count} coordinates", k, {"modes": k}))
        if body.flag("static_shapes", False) or 3 * k <= count:
            found.append((f"{k} mode{'s' * (k > 1)} and static shapes", k, {"modes": k, "static_shapes": True}))
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
