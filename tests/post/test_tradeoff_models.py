"""Smaller and larger models of a deck: lists and nodes follow a new mesh, what cannot follow is told."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from biela import tradeoff_models as models
from biela.compare import differences
from biela.deck import Deck, DeckError, Group, groups_of, read
from biela.material_law import of_group
from biela.tradeoff_work import _kept
from conftest import REFERENCE, ROOT

CRANK = REFERENCE / "vrl_ghm" / "deck.nml"


def deck_of(*listed: dict) -> Deck:
    """Return a deck of groups; what is no list is a list of one."""
    as_list = [{key: v if key == "group" or isinstance(v, list) else [v] for key, v in group.items()} for group in listed]
    return Deck(Path("-"), groups_of(as_list))


FRAME = deck_of(
    {"group": "body", "name": "l", "kind": "frame", "node_x": [0, 1, 1], "node_y": [0, 0, 2], "element_nodes": [1, 2, 2, 3],
     "element_material": ["a", "b"], "section": ["s", "t"], "reference_node": [1, -1, 3], "reference_dof": ["u", "v", "r"]},
    {"group": "sensor", "name": "end", "quantity": "position", "body": "l", "node": 3},
    {"group": "sensor", "name": "knee", "quantity": "position", "body": "l", "node": 2},
)  # fmt: skip


def test_a_frame_cut_in_two_keeps_its_lists_and_its_last_node():
    deck = models.split_frame(FRAME, "l", set())
    body = deck.one("body", "l")
    assert body.numbers("node_x") == [0.0, 1.0, 0.5, 1.0, 1.0]
    assert body.numbers("node_y") == [0.0, 0.0, 0.0, 1.0, 2.0]
    assert body.numbers("element_nodes") == [1, 3, 3, 2, 2, 4, 4, 5]
    assert body.words("element_material") == ["a", "a", "b", "b"]
    assert body.words("section") == ["s", "s", "t", "t"]
    assert body.numbers("reference_node") == [1, -1, 5]
    assert models.coordinates(body)[:3] == [(1, "v"), (1, "r"), (2, "u")]
    assert models.coordinates(body)[-1:] == [(5, "u")], "v and the rotation of the last node belong to the frame"
    assert "sensor/end/node=5" in deck.words


BEAM = {"group": "body", "name": "b", "kind": "beam", "length": 1.0, "elements": 4}


@pytest.mark.parametrize(
    ("words", "count", "found"),
    [
        ({"element_material": ["a", "a", "b", "b"]}, 2, {"element_material": ["a", "b"]}),
        ({"element_material": ["a", "a", "b", "b"]}, 8, {"element_material": ["a"] * 4 + ["b"] * 4}),
        ({"element_material": ["a", "b", "b", "b"]}, 2, "body b: 2 elements do not follow its materials"),
        ({"reference_node": [1, 3, -1], "reference_dof": ["u", "v", "r"]}, 2, {"reference_node": [1, 2, -1]}),
        ({"reference_node": [1, 2], "reference_dof": ["u", "v"]}, 2, "body b: a reference node is not on this mesh"),
    ],
)
def test_lists_of_a_beam_follow_its_mesh(words, count, found):
    deck = deck_of({**BEAM, **words})
    if isinstance(found, str):
        with pytest.raises(models.ImpossibleError) as fault:
            models.with_elements(deck, "b", count, set())
        assert str(fault.value) == found
    else:
        body = models.with_elements(deck, "b", count, set()).one("body", "b")
        assert {key: body.values[key] for key in found} == found


def test_free_modes_are_more_on_a_finer_mesh():
    deck = deck_of({**BEAM, "modes": 3, "reference": "free"})
    assert models.refined(deck, 2, set()).one("body", "b").number("modes") == 12.0


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
    assert {c.count for c in offered.values()} == {1, 2, 3, 4}, "at most a third of the twelve coordinates"
    shaped = offered["few: 4 modes and static shapes"].deck
    fewer = [c.label for c in models.removals(shaped, {"a"}, 100.0, 0.0) if "mode" in c.what]
    assert fewer == [f"few: {k} mode{'s' * (k > 1)} and static shapes" for k in (3, 2, 1)]
    body = models.refined(shaped, 1, {"a"}).one("body", "few")
    assert not body.number("modes"), "nodal coordinates have no static shapes"
    assert not body.flag("static_shapes", False)
    taken = ["few: 8 modes of 12 coordinates", "m: 2 Maxwell terms (modulus within 0.1)"]
    assert _kept(taken, "few: 2 modes of 12 coordinates") == taken[1:]
    assert _kept(["few: 2 of 4 elements", taken[1]], "few: rigid") == taken[1:]


def test_sensors_follow_their_material_points_to_a_finer_mesh(run_deck, tmp_path, biela):
    (tmp_path / "deck.nml").write_text(CRANK.read_text() + "\n&sensor name='point' quantity='position' body='rod' node=2 /\n")
    deck = read(tmp_path / "deck.nml", biela=biela)
    fine = models.refined(deck, 2, {s.name for s in deck.all("sensor")})
    fine = fine.set(fine.one("transient"), step=1e-6)
    coarse, finer = run_deck(tmp_path / "deck.nml"), run_deck(fine.flat(biela), name="fine")
    for run in (coarse, finer):
        assert np.array_equal(run.history["qf4.q"], run.history["mid.r"])
        assert np.ptp(run.history["mid.r"]) > 0.0
    for column in ("point.x", "point.y"):
        assert finer.history[column][0] == pytest.approx(coarse.history[column][0], abs=1e-15)
        assert np.abs(coarse.history[column] - finer.history[column]).max() < 0.01


def test_frame_cut_in_two_is_the_same_structure(run_deck, biela):
    path = REFERENCE / "viscoelastic_joint" / "deck.nml"
    cut = models.split_frame(read(path, biela=biela), "lower", {"tip", "upper"})
    one, two = run_deck(path), run_deck(cut.set(cut.one("transient"), step=5e-6).flat(biela), name="cut")
    found = differences(two.history, one.history, 1e-3, columns=["tip.*", "upper"])
    assert all(d.passed for d in found), found


def test_a_flat_deck_keeps_comments_and_layout(biela):
    deck = read(ROOT / "input" / "slider_crank_viscoelastic.nml", biela=biela)
    with pytest.raises(models.ImpossibleError):
        models.with_elements(deck, "rod", 1, {"mid"})
    text = models.with_elements(deck, "rod", 4, {"mid"}).flat(biela)
    assert "! Slider-crank with a viscoelastic rod: slider_crank_elastic.nml with one GHM term" in text
    assert "length=0.3492 elements=4 material='rod'" in text
    assert "quantity='deflection' body='rod' node=3 /" in text
