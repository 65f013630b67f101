"""Models that are made of a deck's text: lists and nodes follow a new mesh, what cannot follow is told."""

from __future__ import annotations

import pytest
from biela import deck_models, deck_text, tradeoff_truth
from biela.tradeoff_settings import grid_of
from studies import study_with

FRAME = """&body name='l' kind='frame' node_x=0,1,1 node_y=0,0,2 element_nodes=1,2,2,3 element_material='a','b' section='s','t'
 reference_node=1,-1,3 reference_dof='u','v','r' /
&sensor name='end' quantity='position' body='l' node=3 /
&sensor name='knee' quantity='position' body='l' node=2 /
"""


def test_a_frame_cut_in_two_keeps_its_lists_and_its_last_node():
    body = deck_models.split_frame(deck_text.parse(FRAME), "l", set()).one("body", "l")
    assert body.numbers("node_x") == [0.0, 1.0, 0.5, 1.0, 1.0]
    assert body.numbers("node_y") == [0.0, 0.0, 0.0, 1.0, 2.0]
    assert [int(n) for n in body.numbers("element_nodes")] == [1, 3, 3, 2, 2, 4, 4, 5]
    assert body.items("element_material") == ["'a'", "'a'", "'b'", "'b'"]
    assert body.items("section") == ["'s'", "'s'", "'t'", "'t'"]
    assert body.items("reference_node") == ["1", "-1", "5"]
    assert deck_models.coordinates(body)[:3] == [(1, "v"), (1, "r"), (2, "u")]
    assert deck_models.coordinates(body)[-1:] == [(5, "u")], "v and the rotation of the last node belong to the frame"


BEAM = "&body name='b' kind='beam' length=1.0 elements=4 {} /\n&sensor name='s' quantity='angle' body='b' /\n"


@pytest.mark.parametrize(
    ("words", "count", "found"),
    [
        ("element_material='a','a','b','b'", 2, {"element_material": ["'a'", "'b'"]}),
        ("element_material='a','a','b','b'", 8, {"element_material": ["'a'"] * 4 + ["'b'"] * 4}),
        ("element_material='a','b','b','b'", 2, "body b: 2 elements do not follow its materials"),
        ("reference_node=1,3,-1 reference_dof='u','v','r'", 2, {"reference_node": ["1", "2", "-1"]}),
        ("reference_node=1,2 reference_dof='u','v'", 2, "body b: a reference node is not on this mesh"),
    ],
)
def test_lists_of_a_beam_follow_its_mesh(words, count, found):
    deck = deck_text.parse(BEAM.format(words))
    if isinstance(found, str):
        with pytest.raises(deck_models.ImpossibleError) as fault:
            deck_models.with_elements(deck, "b", count, set())
        assert str(fault.value) == found
    else:
        body = deck_models.with_elements(deck, "b", count, set()).one("body", "b")
        assert {key: body.items(key) for key in found} == found


def test_free_modes_are_more_on_a_finer_mesh():
    deck = deck_text.parse(BEAM.format("modes=3 reference='free'"))
    assert deck_models.refined(deck, 2, set()).one("body", "b").number("modes") == 12.0


def test_a_frame_on_the_mesh_of_the_truth_keeps_its_model(tmp_path):
    deck = deck_text.parse(FRAME)
    small = deck_models.changed(deck, "l", {"axial": ".false."}, set())
    fine = tradeoff_truth._on_mesh(study_with(tmp_path), deck, small, 2).one("body", "l")
    assert deck_models.elements_of(fine) == 8
    assert not fine.flag("axial", True)


def test_numbers_and_decks_that_cannot_be_read(tmp_path):
    with pytest.raises(deck_text.DeckError, match=r"^&body b: length = 1.0m is no list of numbers$"):
        deck_text.parse("&body name='b' length=1.0m /").one("body").number("length")
    (tmp_path / "deck.nml").write_bytes(b"! \xff\xfe\n")
    for path, told in ((tmp_path, "cannot be read: is a directory"), (tmp_path / "deck.nml", "cannot be read as text")):
        with pytest.raises(deck_text.DeckError, match=told):
            deck_text.read(path)
    deck = deck_text.parse("&parameter name='L' value={2 ! 3, /} / ! {\n&body n=3 position=2*{max(1, 2)},{L/2} angle=0 /\n")
    assert deck.one("body").items("position") == ["{max(1, 2)}"] * 2 + ["{L/2}"]
    assert deck.set(deck.one("parameter"), value="{L}").one("body").values == deck.one("body").values
    with pytest.raises(deck_text.DeckError, match=r"the deck's &transient states no t_end"):
        grid_of(deck_text.parse("&transient step=1e-4 /"))
