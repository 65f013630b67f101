"""The shipped decks and the README's deck and commands are in order."""

from __future__ import annotations

import re

import pytest
from conftest import ROOT

DECKS = sorted((ROOT / "input").glob("*.nml"))
README = (ROOT / "README.md").read_text(encoding="utf-8")


# short and thick bodies, and a step that is stable for the small deflections of this deck alone
TOLD_BEFORE_A_RUN = {"engine": r'body "rod" is so short and thick', "quick_return": r'body "arm" is so short and thick',
                     "spin_up_without_stiffening": r"step=4e-4 s is too large where bodies bend"}  # fmt: skip


@pytest.mark.parametrize("deck", DECKS, ids=lambda path: path.stem)
def test_a_shipped_deck_is_in_order_and_explains_itself(run_deck, deck):
    done = run_deck(deck, "--check")
    told = [line.partition(": warning: ")[2] for line in done.stderr.splitlines()]
    expected = TOLD_BEFORE_A_RUN.get(deck.stem)
    assert len(told) == (expected is not None)
    assert all(re.match(expected, words) for words in told)
    assert not done.folder.exists()
    assert deck.read_text(encoding="utf-8").startswith("! ")


def test_the_reference_lists_exactly_the_shipped_decks():
    table = (ROOT / "input" / "README.md").read_text(encoding="utf-8").split("Decks in `input/`:\n\n")[1].split("\n\n")[0]
    rows = re.findall(r"^\| (`\w+`(?:, `\w+`)*) \|", table, re.MULTILINE)
    assert sorted(name for row in rows for name in re.findall(r"`(\w+)`", row)) == [deck.stem for deck in DECKS]


def test_the_readmes_deck_runs(run_deck):
    lines = [line[4:] for line in README.splitlines() if line.startswith("    ")]
    start = next(k for k, line in enumerate(lines) if line.startswith("&scene"))
    end = next(k for k, line in enumerate(lines) if line.startswith("&transient"))
    deck = "\n".join(lines[start : end + 1]) + "\n"
    history = run_deck(deck).history
    assert history.names == ["t", "qf4.q", "qf4.qd", "qf4.qdd", "mid.u", "mid.v", "mid.r"]
    assert history.time[-1] == 0.01
    rigid = re.sub(r"&sensor.*\n", "", deck).replace("reference='pinned'", "flexible=.false.")
    assert "coordinates: 3 of frames + 0 elastic = 3\n  dissipative coordinates: 0\n" in run_deck(rigid, name="rigid").summary


def test_the_readmes_files_exist():
    for name in re.findall(r"(?:input|post)/[\w/]+\.\w+", README):
        assert (ROOT / name).is_file(), name
