"""The table of keys (src/deck/keys.txt): the documents made from it are up to date, the program reads and explains every row."""

from __future__ import annotations

import re
import subprocess

import numpy as np
import pytest
from conftest import ROOT
from deck_keys import GROUPS, applying, choice_of

DOCUMENTS = ["input/README.md", "share/biela.1", "share/biela.bash", "share/_biela"]
WRONG = {  # values that no key of this type takes, each with what the message says
    "logical": ("3", ".true. or"),
    "text": ("bare", "not in quotes"),
    "name": ("'a b'", "may not have"),
    "word": ("'zzzzzz'", "is not known"),
    "letter...": ("'zz'", "is not known"),
}


@pytest.mark.parametrize("document", DOCUMENTS)
def test_the_documents_are_up_to_date(document):
    words = ["awk", "-f", "src/deck/keys.awk", "-f", "share/documents.awk", "src/deck/keys.txt", document]
    made = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    assert made == (ROOT / document).read_text(encoding="utf-8"), "make documents"


def test_the_reference_has_a_table_of_each_group():
    text = (ROOT / "input" / "README.md").read_text(encoding="utf-8")
    assert [group for group in GROUPS if f"<!-- keys of &{group} -->" not in text] == []


def asked(biela, word):
    done = subprocess.run([biela, "--help", word], capture_output=True, text=True, check=False)
    return done.returncode, done.stdout, done.stderr


def plain(text):
    """Return a text as the help has it: without marks of code, in one line."""
    return " ".join(text.replace("`", "").split())


@pytest.mark.parametrize("group", GROUPS)
def test_the_help_of_a_group_has_all_of_its_keys(biela, group):
    status, told, _ = asked(biela, f"&{group}")
    lines = told.splitlines()
    assert (status, lines[0].partition(":")[0]) == (0, f"&{group}")
    assert max(map(len, lines)) <= 100
    heads = re.findall(r"^  \S.*(?:\n    \S.*)*", told, re.MULTILINE)
    for key, head in zip(GROUPS[group], map(plain, heads), strict=True):
        assert head.startswith(key.name), head
        assert (", required" in head) == key.required, head
        assert f"[{key.unit}]" in head or not key.unit, head
        assert f", default {key.default}" in head or not key.default, head
        assert all(f"'{word}'" in head for word in key.kinds), head
        assert plain(key.meaning) in plain(told), head


def test_the_help_of_a_key_has_every_group_that_has_it(biela):
    for name in ("friction", "direction", "spring", "node_b"):
        told = asked(biela, name.upper())[1]
        assert [group for group in GROUPS if f"&{group}\n  {name}" in told] == [
            group for group in GROUPS if any(key.name == name for key in GROUPS[group])
        ]
    assert asked(biela, "angel") == (2, "", "biela: no group or key of decks is called angel, did you mean angle? (biela --help)\n")


def faulty(key):
    """Return values that the row of a key refuses, each with what the message says."""
    kind = key.type.rstrip(".")
    told = {"real": "number", "integer": "a whole number", "auto": "'auto'", "pair": "1 value, expected 2"}
    if key.limits():
        return [(value, "expected every" if key.type == "real..." else "is out of range") for value in key.limits()]
    if kind in told:
        return [("'x'", told[kind])]
    if kind.startswith("&") or kind in ("input", "column"):
        return [("'nosuch'", "names no")]
    return [WRONG[key.type]]


@pytest.mark.parametrize("group", [group for group in GROUPS if group not in ("include", "parameter")])
def test_every_row_is_read_by_its_own_rules(run_deck, group):
    """In a group of each kind each key with values that its row refuses: told by its rule, or that it does not apply."""
    choice = choice_of(group)
    for kind in choice.range.split() if choice else [""]:
        keys = applying(group, kind)
        for turn in range(2):
            lines, expected = ["&body name='b' mass=1 inertia=1 /", f"&{group}"], {}
            if choice:
                lines.append(f"  {choice.name}='{kind}'")
            for name in dict.fromkeys(key.name for key in GROUPS[group]):
                if name == "name" and group == "history":  # a history without a readable name may be any
                    lines.append("name='h'")
                    continue
                if choice and name == choice.name:
                    continue
                value, told = faulty(keys.get(name) or next(key for key in GROUPS[group] if key.name == name))[-turn]
                lines.append(f"  {name}={value}")
                expected[len(lines)] = (name, told if name in keys else "does not apply to")
            found = run_deck("\n".join([*lines, "/", ""]), "--check", expect=2).stderr.splitlines()
            for line, (name, told) in expected.items():
                said = [text for text in found if f":{line}: " in text and name in text and told in text]
                assert said, (kind, name, told, found)


@pytest.mark.parametrize("group", [group for group in GROUPS if any(key.required for key in GROUPS[group])])
def test_every_required_key_is_missed(run_deck, group):
    choice = choice_of(group)
    for kind in choice.range.split() if choice else [""]:
        text = f"&{group} {choice.name}='{kind}' /" if choice else f"&{group} /"
        found = run_deck(f"&body name='b' mass=1 inertia=1 /\n{text}\n", "--check", expect=2).stderr
        for key in applying(group, kind).values():
            if key.required and key is not choice:
                assert f": {key.name} is missing, expected " in found, (kind, key.name, found)


def test_rows_are_whole():
    """Each has a sentence, no key stands twice for one kind, kinds are words of the choice, the default is a word of the list."""
    for group, keys in GROUPS.items():
        seen = set()
        choice = choice_of(group)
        words = choice.range.split() if choice else []
        for key in keys:
            assert key.meaning, (group, key.name)
            assert set(key.kinds) <= set(words), (group, key.name)
            assert key.type not in ("word", "choice") or key.default in ["", *key.range.split()], (group, key.name)
            own = {(key.name, kind) for kind in key.kinds or ["", *words]}
            assert not own & seen, (group, key.name)
            seen |= own


def test_default_rates_of_baumgartes_terms_are_a_tenth_over_the_step_in_use(run_deck):
    """The step of 7 ms becomes a third of the 20 ms between rows: the rates are 0.1 over that. Two links that swing drift."""
    deck = (
        "&scene gravity=0.0,-9.81 /\n&body name='r' kind='rigid' mass=1.0 inertia=0.1 com=0.5,0.0 /\n"
        "&body name='s' kind='rigid' mass=1.0 inertia=0.1 com=0.5,0.0 position=1.0,0.0 /\n"
        "&joint name='j' type='revolute' body_a='r' /\n"
        "&joint name='k' type='revolute' body_a='s' body_b='r' point_b=1.0,0.0 /\n"
        "&sensor name='p' quantity='position' body='s' point=1.0,0.0 /\n"
        "&transient method='rk4' step=7.0e-3 output_step=2.0e-2 t_end=1.0 stabilization='baumgarte' {} /\n"
    )
    rate = 0.1 / (2.0e-2 / 3)
    default = run_deck(deck.format(""), name="default").history["p.y"]
    stated = run_deck(deck.format(f"baumgarte_alpha={rate!r} baumgarte_beta={rate!r}"), name="stated").history["p.y"]
    assert np.abs(default - stated).max() < 1e-11
    for one in ("alpha", "beta"):
        other = run_deck(deck.format(f"baumgarte_{one}={1.05 * rate!r}"), name=one).history["p.y"]
        assert np.abs(default - other).max() > 1e-9


@pytest.mark.parametrize("method", ["dopri5", "radau"])
def test_adaptive_runs_have_a_thousand_rows_where_none_are_asked_for(run_deck, method):
    deck = (
        "&scene gravity=0.0,-9.81 /\n&body name='r' kind='rigid' mass=1.0 inertia=0.1 com=0.5,0.0 /\n"
        f"&transient method='{method}' tolerance=1.0e-4 t_end=0.5 /\n"
    )
    run = run_deck(deck)
    assert run.energy.time.size == 1001
    assert run.energy.time[-1] == 0.5
