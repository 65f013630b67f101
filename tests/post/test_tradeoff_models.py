"""Smaller models of a deck: what can be taken out of it, and what goes with it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from biela import tradeoff_settings as models
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


def test_a_term_is_left_out_and_the_modulus_of_slow_motion_stays():
    terms = {"ghm_alpha": [0.5, 0.2], "ghm_zeta": [2.0, 3.0], "ghm_omega": [1e3, 1e2], "prony_alpha": 0.3, "prony_tau": 1e-2}
    material = {"group": "material", "name": "m", "density": 1000.0, "young": 1e9, **terms}
    alone = {"group": "spring", "name": "s", "stiffness": 5.0, "prony_alpha": 1.0, "prony_tau": 0.5, "ghm_frequency_scale": 3.0}
    deck = deck_of({**BEAM, "material": "m"}, material, alone, {**material, "name": "unused"})
    law, found = of_group(deck.groups[1]), dict(models.removals(deck, set()))
    labels = [f"m: {words}" for words in ("GHM term 1 of 2", "GHM term 2 of 2", "Maxwell term 1 of 1")]
    assert [label for label in found if "term" in label] == [*labels, "s: Maxwell term 1 of 1"]
    for label, variables in zip(labels, (2, 2, 1)):
        other = of_group(found[label].groups[1])
        assert other.internal_variables == law.internal_variables - variables
        np.testing.assert_allclose(other.modulus(np.array([1e-6])), law.modulus(np.array([1e-6])), rtol=1e-5)
    assert of_group(found[labels[1]].groups[1]).omega == [1e3]
    assert "ghm_frequency_scale" not in found["s: Maxwell term 1 of 1"].groups[2].values
    assert "b: elastic twin" in found


def test_static_shapes_are_tried_beside_few_modes_and_go_with_the_modes():
    deck = deck_of({**BEAM, "name": "few"}, {"group": "sensor", "name": "a", "quantity": "angle", "body": "few"})
    offered = {label: less for label, less in models.removals(deck, {"a"}) if label.endswith("shapes")}
    assert len(offered) == 4, "at most a third of the twelve coordinates"
    fewer = [label for label, _ in models.removals(offered["few: 4 modes and static shapes"], {"a"}) if "mode" in label]
    assert fewer == [f"few: {k} mode{'s' * (k > 1)} and static shapes" for k in (3, 2, 1)]


def test_a_flat_deck_keeps_comments_and_layout(biela):
    deck = read(ROOT / "input" / "slider_crank_viscoelastic.nml", biela=biela)
    text = models.changed(deck, deck.one("body", "rod"), {"modes": 2}, {"mid"}).flat(biela)
    assert "! Slider-crank with a viscoelastic rod: slider_crank_elastic.nml with one GHM term" in text
    assert "modes=2" in text
    assert "quantity='deflection' body='rod' node=" in text
