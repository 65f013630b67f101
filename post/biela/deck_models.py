"""Smaller and larger models of the same scene: what can be taken out of a deck, and how its mesh and model are refined.

Each change is made in the deck's text. Node numbers, element lists and coordinate numbers everywhere in the deck follow the new
mesh. A sensor that has no counterpart on the new model (a node that is gone, the coordinate of a rigid body) becomes a
comment, unless it was asked for: then the change is impossible.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass

from . import deck_terms
from .deck_text import DeckError, DeckText, Group

MODAL = ("modes", "static_shapes")  # taken away together: nodal coordinates have no static shapes
NODE_KEYS = [("node_a", "body_a"), ("node_b", "body_b"), ("node", "body")]


class ImpossibleError(DeckError):
    """A change that a sensor asked for, a joint or a load does not allow."""


@dataclass(frozen=True)
class Change:
    """One thing that can be taken out of a model, and the deck without it; body, kind, count left: as far as the label says."""

    label: str
    deck: DeckText
    body: str = ""
    kind: str = ""
    count: int = 0


def is_flexible(body: Group) -> bool:
    """Whether a body has elastic coordinates."""
    return body.word("kind") in ("beam", "frame") and body.flag("flexible", True)


def elements_of(body: Group) -> int:
    """Return the number of elements of a beam or frame."""
    return int(body.number("elements")) if body.word("kind") == "beam" else len(body.items("element_nodes")) // 2


def nodes_of(body: Group) -> int:
    """Return the number of nodes of a beam or frame."""
    return elements_of(body) + 1 if body.word("kind") == "beam" else len(body.items("node_x"))


def coordinates(body: Group) -> list[tuple[int, str]]:
    """Return (node, 'u'|'v'|'r') of each nodal elastic coordinate, in the solver's order (input/README.md, sensor 'coordinate')."""
    last = nodes_of(body)
    removed = {"pinned": {(1, "u"), (1, "v"), (last, "v")}, "clamped": {(1, "u"), (1, "v"), (1, "r")}}.get(
        body.word("reference", "pinned"), set()
    )
    if "reference_node" in body.values:
        nodes = [int(n) if int(n) > 0 else last for n in body.items("reference_node")]
        removed = set(zip(nodes, (dof.strip("'\"").lower() for dof in body.items("reference_dof"))))
    kept = "uvr" if body.flag("axial", True) else "vr"
    return [(node, dof) for node in range(1, last + 1) for dof in kept if (node, dof) not in removed]


def coordinate_count(body: Group) -> int:
    """Return the number of elastic coordinates."""
    return int(body.number("modes")) or len(coordinates(body))


def changed(deck: DeckText, name: str, values: dict[str, str], asked: set[str], nodes: dict[int, int] | None = None) -> DeckText:
    """Return the deck with a body's values set and every reference to the body adapted.

    Args:
        deck: the deck
        name: the body
        values: what is set in its group
        asked: names of the sensors that must stay
        nodes: new number of each old node that stays; None: the mesh stays

    Raises:
        ImpossibleError: a joint, load or asked-for sensor needs what the change takes away.
    """
    before = deck.one("body", name)
    deck = deck.set(before, **values)
    after = deck.one("body", name)
    for k in range(len(deck.groups) - 1, -1, -1):
        group = deck.groups[k]
        edits, lost = _renumbered(group, name, nodes, nodes_of(before))
        if group.kind == "sensor" and group.word("body") == name:
            edits, lost = _sensor(group, before, after, nodes, edits, lost)
        if lost and (group.kind != "sensor" or group.name in asked):
            raise ImpossibleError(f"{group.kind} {group.name}: {lost}")
        if lost:
            deck = deck.drop(group, f"dropped, {lost}")
        elif edits:
            deck = deck.set(group, **edits)
    return deck


def _renumbered(group: Group, name: str, nodes: dict[int, int] | None, last: int) -> tuple[dict[str, str], str]:
    """Return the new node numbers of a group, and what it loses."""
    edits = {}
    for key, owner in NODE_KEYS:
        if nodes is None or key not in group.values or group.word(owner) != name:
            continue
        node = int(group.number(key))
        if node in (0, -1):
            continue
        if node not in nodes:
            return {}, f"node {node} of {last} of body {name} is not on this mesh"
        edits[key] = str(nodes[node])
    return edits, ""


def _sensor(
    group: Group, before: Group, after: Group, nodes: dict[int, int] | None, edits: dict[str, str], lost: str
) -> tuple[dict[str, str], str]:
    """Return what changes in a sensor on the changed body, and what it loses."""
    quantity = group.word("quantity")
    if lost or quantity not in ("coordinate", "internal", "stress"):
        return edits, lost
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
    return {**edits, "index": str(coordinates(after).index(coordinate) + 1)}, ""


def with_elements(deck: DeckText, name: str, count: int, asked: set[str]) -> DeckText:
    """Return the deck with another number of elements of a beam; `ImpossibleError` where a place is not on that mesh."""
    body = deck.one("body", name)
    old = elements_of(body)
    nodes = {k + 1: k * count // old + 1 for k in range(old + 1) if k * count % old == 0}
    values = {"elements": str(count)}
    if "element_material" in body.values:
        mapped = [body.items("element_material")[int((e + 0.5) * old / count)] for e in range(count)]
        back = [mapped[int((e + 0.5) * count / old)] for e in range(old)]
        if back != body.items("element_material"):
            raise ImpossibleError(f"body {name}: {count} elements do not follow its materials")
        values["element_material"] = ",".join(mapped)
    if "reference_node" in body.values:
        kept = [int(n) for n in body.items("reference_node")]
        if any(n != -1 and n not in nodes for n in kept):
            raise ImpossibleError(f"body {name}: a reference node is not on this mesh")
        values["reference_node"] = ",".join(str(n if n == -1 else nodes[n]) for n in kept)
    return changed(deck, name, values, asked, nodes)


def split_frame(deck: DeckText, name: str, asked: set[str]) -> DeckText:
    """Return the deck with every element of a frame cut in two; the last node stays the last one."""
    body = deck.one("body", name)
    pairs = [int(item) for item in body.items("element_nodes")]
    x, y = body.numbers("node_x"), body.numbers("node_y")
    last, count = len(x), len(pairs) // 2
    new = {k: k for k in range(1, last)} | {last: last + count}
    ends = [(pairs[2 * e], pairs[2 * e + 1]) for e in range(count)]
    lists = {"element_nodes": ",".join(f"{new[a]},{last + e},{last + e},{new[b]}" for e, (a, b) in enumerate(ends))}
    for key, values in (("node_x", x), ("node_y", y)):
        middle = [0.5 * (values[a - 1] + values[b - 1]) for a, b in ends]
        lists[key] = ",".join(repr(v) for v in [*values[:-1], *middle, values[-1]])
    for key in ("material", "section", "element_material"):
        if len(body.items(key)) > 1:
            lists[key] = ",".join(item for item in body.items(key) for _ in range(2))
    if "reference_node" in body.values:
        lists["reference_node"] = ",".join(str(new.get(int(n), int(n))) for n in body.items("reference_node"))
    return changed(deck, name, lists, asked, new)


def refined(deck: DeckText, doublings: int, asked: set[str], model: bool = True) -> DeckText:
    """Return the deck with every element of its flexible bodies cut in 2**doublings.

    With model, what the kinematics leave out is modelled too: nodal coordinates instead of modes, axial deformation.
    """
    for body in [group.name for group in deck.all("body") if is_flexible(group)]:
        group = deck.one("body", body)
        values = {}
        if model and group.number("modes") and group.word("reference") != "free":
            values |= dict.fromkeys(MODAL)
        elif model and group.number("modes"):
            values["modes"] = str(int(group.number("modes")) * 2**doublings)
        if model and not group.flag("axial", True):
            values["axial"] = None
        if values:
            deck = changed(deck, body, values, asked)
        if deck.one("body", body).word("kind") == "beam":
            deck = with_elements(deck, body, elements_of(group) * 2**doublings, asked)
        else:
            for _ in range(doublings):
                deck = split_frame(deck, body, asked)
    return deck


def removals(deck: DeckText, asked: set[str], highest: float, target: float) -> list[Change]:
    """Return every single thing that can be taken out of a model; what is impossible is left out.

    Args:
        deck: the model
        asked: names of the sensors that must stay
        highest: frequency that is asked for [Hz]
        target: largest error of a modulus with which Maxwell terms take the place of GHM terms [-]
    """
    found: list[Change] = []

    def offer(label: str, make: Callable[[], DeckText]) -> None:
        with contextlib.suppress(ImpossibleError):
            found.append(Change(label, make(), *_parts_of_label(label)))

    for body in (group for group in deck.all("body") if is_flexible(group)):
        for label, values in _body_changes(deck, body):
            offer(label, lambda values=values, body=body: changed(deck, body.name, values, asked))
        if body.word("kind") == "beam":
            for count in _coarser(elements_of(body)):
                label = f"{body.name}: {count} of {elements_of(body)} elements"
                offer(label, lambda count=count, body=body: with_elements(deck, body.name, count, asked))
    for group in deck.all("material", "spring"):
        damps = deck_terms.has_terms(group) and (group.kind == "spring" or _damps(deck, group))
        for label, values in deck_terms.changes(group, highest, target) if damps else ():
            offer(label, lambda values=values, group=group: deck.set(group, **values))
    return found


def _parts_of_label(label: str) -> tuple[str, str, int]:
    """Return (body, kind, what is left) of a removal's label."""
    body, what = label.split(": ", 1)
    counted = _counted(what)
    kind = "shapes" if what.endswith("shapes") else counted or what
    return body, kind, int(what.split()[0]) if counted else 0


def effective_removals(labels: list[str]) -> list[str]:
    """Return the labels of removals, made one after another, that a later one has not overtaken."""
    kept: list[str] = []
    for label in labels:
        body, what = label.split(": ", 1)
        same = [k for k in kept if k.startswith(body + ": ")]
        over = [k for k in same if what == "rigid" or (_counted(what) and _counted(what) == _counted(k.split(": ", 1)[1]))]
        kept = [k for k in kept if k not in over] + [label]
    return kept


def _counted(what: str) -> str:
    """Return what a label counts, '' where it counts nothing."""
    counted = ("modes", "mode", "elements", "Maxwell") if what[0].isdigit() else ()
    return next((word for word in counted if word in what.split()), "").rstrip("s")


def _coarser(count: int) -> list[int]:
    """Return the smaller meshes that are tried: the divisors, and one element less."""
    return sorted({n for n in range(1, count) if count % n == 0 or n == count - 1}, reverse=True)


def _materials(deck: DeckText, body: Group) -> list[Group]:
    """Return the materials of a body."""
    names = {item.strip("'\"").lower() for key in ("material", "element_material") for item in body.items(key)}
    return [group for group in deck.all("material") if group.name in names]


def _body_changes(deck: DeckText, body: Group) -> list[tuple[str, dict[str, str]]]:
    """Return (label, values) of what can be switched off in a flexible body."""
    name, stiff = body.name, body.flag("stiffening", False)
    found = [(f"{name}: rigid", {"flexible": ".false.", **dict.fromkeys(("stiffening", *MODAL, "axial", "viscoelastic"))})]
    damped = any(deck_terms.has_terms(material) for material in _materials(deck, body))
    if damped and body.flag("viscoelastic", True):
        found.append((f"{name}: elastic twin", {"viscoelastic": ".false."}))
    if stiff:
        found.append((f"{name}: no stiffening", {"stiffening": ".false."}))
    elif body.word("kind") == "beam" and body.flag("axial", True):
        found.append((f"{name}: no axial deformation", {"axial": ".false."}))
    count, shapes = coordinate_count(body), body.flag("static_shapes", False)
    some = {b * 2**j for b in (2, 3) for j in range(8)} | {1, count - 1, count - 2}
    for k in () if stiff else sorted((k for k in some if 0 < k < count), reverse=True):
        plain = (f"{name}: {k} mode{'s' * (k > 1)} of {count} coordinates", {"modes": str(k)})
        more = (f"{name}: {k} mode{'s' * (k > 1)} and static shapes", {"modes": str(k), "static_shapes": ".true."})
        found += [more] if shapes else [plain, more] if 3 * k <= count else [plain]
    return found


def _damps(deck: DeckText, material: Group) -> bool:
    """Whether a flexible, viscoelastic body is made of the material."""
    return any(
        is_flexible(body) and body.flag("viscoelastic", True) and material in _materials(deck, body) for body in deck.all("body")
    )
