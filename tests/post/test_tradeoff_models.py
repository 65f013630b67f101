"""Smaller models of a deck: what can be taken out of it, and what goes with it."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from biela import tradeoff_models as models
from biela.deck import Deck, DeckError, Group, groups_of, read
from biela.material_law import of_group
from conftest import REFERENCE, ROOT

CRANK = REFERENCE / "vrl_ghm" / "deck.nml"


def deck_of(*listed: dict) -> Deck:
    """Return a deck of groups; what is no list is a list of one."""
    as_list = [{key: v if key == "group" or isinstance(v, list) else [v] for key, v in group.items()} for group in listed]
    return Deck(Path("-"), groups_of(as_list))


BEAM = {"group": "body", "name": "b", "kind": "beam", "length": 1.0, "elements": 4}


def test_sensors_of_what_a_change_takes_away_go_or_forbid_it():
    sensors = [{"group": "sensor", "name": kind[0], "quantity": kind, "body": "b"} for kind in (*models.ELASTIC, "angle")]
    deck = deck_of(BEAM, *sensors)
    body = deck.one("body", "b")
    assert [g.name for g in models.changed(deck, body, {"flexible": False}, {"a"}).all("sensor")] == ["a"]
    assert [g.name for g in models.changed(deck, body, {"modes": 3}, {"a"}).all("sensor")] == ["i", "s", "a"]
    assert [g.name for g in models.changed(deck, body, {"viscoelastic": False}, {"c"}).all("sensor")] == ["c", "i", "s", "a"]
    assert models.changed(deck, body, {"flexible": False}, {"s"}) is None
    assert models.changed(deck, body, {"axial": False}, {"c"}) is None


@pytest.mark.parametrize(
    ("words", "count"),
    [
        ({}, 12),
        ({"axial": False}, 8),
        ({"reference": "clamped", "axial": False}, 8),
        ({"reference": "free"}, 15),
        ({"reference_node": [1, 5, 5], "reference_dof": ["v", "u", "u"], "axial": False}, 9),
        ({"kind": "frame", "node_x": [0, 1, 1], "node_y": [0, 0, 1]}, 6),
    ],
)
def test_coordinates_are_counted_as_the_solver_does(words, count):
    assert models.coordinates(deck_of({**BEAM, **words}).one("body", "b")) == count


def test_numbers_and_decks_that_cannot_be_read(tmp_path):
    with pytest.raises(DeckError, match=r"^&body b: length = \['x'\] is no list of numbers$"):
        Group("body", {"name": ["b"], "length": ["x"]}).number("length")
    with pytest.raises(DeckError, match="cannot be read: is a directory"):
        read(tmp_path)


SCALED = deck_of(
    {"group": "material", "name": "m", "density": 1000.0, "young": 1e9, "ghm_alpha": [0.5, 0.2], "ghm_zeta": [2.0, 3.0],
     "ghm_omega": [1e3, 1e2], "prony_alpha": 0.3, "prony_tau": 1e-2, "ghm_frequency_scale": 3.0},
    {"group": "spring", "name": "s", "stiffness": 5.0, "ghm_alpha": 1.0, "ghm_zeta": 5.0, "ghm_omega": 20.0},
    {"group": "material", "name": "n", "density": 1000.0, "shear_modulus": 2.0, "poisson": 0.25, "ghm_alpha": 1.0, "ghm_zeta": 5.0,
     "ghm_omega": 20.0},
)  # fmt: skip


@pytest.mark.parametrize(("number", "internal", "fits"), [(0, 5, 3), (1, 2, 1), (2, 2, 1)])
def test_maxwell_terms_take_the_place_of_ghm_terms_with_the_error_that_is_told(number, internal, fits):
    group = SCALED.groups[number]
    law, errors = of_group(group), []
    assert law.internal_variables == internal
    assert law.young == (1e9, 5.0, 5.0)[number]  # 2 (1 + 0.25) times a shear modulus
    for label, values in models._term_changes(group, 1000.0, 0.5):
        if "modulus within" not in label:
            continue
        changed = SCALED.set(group, **values).groups[number]
        other = of_group(changed)
        assert (other.weight.size, other.alpha.size) == (int(label.split()[0]), 0)
        assert changed.number("ghm_frequency_scale", 1.0) == 1.0
        errors.append(float(re.search(r"within (\S+)\)", label)[1]))
        band = np.geomspace(law.slowest_pole / (20.0 * np.pi), 1000.0, 333)
        assert np.abs(other.modulus(band) / law.modulus(band) - 1.0).max() == pytest.approx(errors[-1], rel=0.6)
    assert (len(errors), errors) == (fits, sorted(errors, reverse=True))
    assert not [label for label, _ in models._term_changes(group, 1000.0, 1e-12) if "modulus within" in label]


def test_a_term_goes_or_becomes_stiffness():
    """Left out: the modulus of slow motion stays; made stiffness: that of fast motion does."""
    group = SCALED.groups[0]
    law, slow, fast = of_group(group), np.array([1e-6]), np.array([1e9])
    found = models._term_changes(group, 1000.0, 0.0)
    for label, values in found:
        other = of_group(SCALED.set(group, **values).groups[0])
        assert other.internal_variables == law.internal_variables - (1 if "Maxwell" in label else 2)
        kept = slow if "left out" in label else fast
        np.testing.assert_allclose(other.modulus(kept), law.modulus(kept), rtol=1e-5)
    assert len(found) == 6


def test_static_shapes_are_tried_beside_few_modes_and_go_with_the_modes():
    deck = deck_of({**BEAM, "name": "few"}, {"group": "sensor", "name": "a", "quantity": "angle", "body": "few"})
    offered = {c.label: c for c in models.removals(deck, {"a"}, 100.0, 0.0) if c.what.endswith("shapes")}
    assert len(offered) == 4, "at most a third of the twelve coordinates"
    shaped = offered["few: 4 modes and static shapes"].deck
    fewer = [c.label for c in models.removals(shaped, {"a"}, 100.0, 0.0) if "mode" in c.what]
    assert fewer == [f"few: {k} mode{'s' * (k > 1)} and static shapes" for k in (3, 2, 1)]


def test_a_flat_deck_keeps_comments_and_layout(biela):
    deck = read(ROOT / "input" / "slider_crank_viscoelastic.nml", biela=biela)
    text = models.changed(deck, deck.one("body", "rod"), {"modes": 2}, {"mid"}).flat(biela)
    assert "! Slider-crank with a viscoelastic rod: slider_crank_elastic.nml with one GHM term" in text
    assert "modes=2" in text
    assert "quantity='deflection' body='rod' node=" in text
