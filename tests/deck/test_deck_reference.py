"""The reference of the deck language and the manual page name every group, variable and word that the reader knows."""
import pathlib
import re

import numpy as np
import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
REFERENCE = (ROOT / 'input' / 'README.md').read_text(encoding='utf-8')
MANUAL = re.sub(r'\\f[BR]', ' ', (ROOT / 'share' / 'biela.1').read_text(encoding='utf-8').split('.SH DECKS')[1])
READERS = sorted((ROOT / 'src' / 'deck').rglob('deck_*.f90'))


def joined_statements(text):
    """Fortran statements, continuation lines joined, comments of whole lines left out."""
    text = '\n'.join(line for line in text.splitlines() if not line.lstrip().startswith('!'))
    return re.sub(r'&\s*\n\s*', '', text).splitlines()


def known_words():
    """Variables that some reader asks for, and the words that it accepts for them."""
    words = set()
    for path in READERS:
        for line in joined_statements(path.read_text(encoding='utf-8')):
            call = re.match(r"\s*(?:if \(.*\) )?call get_?\w*\(deck, '(\w+)'", line)
            if not call:
                continue
            words.add(call.group(1))
            choices = re.search(r'\[character\(\d+\) :: ([^\]]*)\]', line)
            if choices:
                words.update(re.findall(r"'(\w+)'", choices.group(1)))
    return sorted(words)


def test_the_readers_were_found():
    assert {'young', 'ghm_alpha', 'reference_dof', 'spectral_radius', 'prismatic', 'cycloid'} <= set(known_words())
    assert len(known_words()) > 90


@pytest.mark.parametrize('word', known_words())
def test_every_word_of_the_reader_stands_in_the_reference(word):
    assert re.search(rf"`'?{word}\b|\b{word}'?[`=]|`[^`\n]*\b{word}\b[^`\n]*`", REFERENCE), word
    assert re.search(rf"\b{word}\b", MANUAL), word


def known_groups():
    """Groups that the reader knows."""
    text = '\n'.join(joined_statements((ROOT / 'src/deck/language/deck_kinds.f90').read_text(encoding='utf-8')))
    return re.findall(r"'(\w+)'", re.search(r'group_names\(group_kinds\) = \[(.*?)\]', text).group(1))


@pytest.mark.parametrize('group', known_groups())
def test_every_group_stands_in_the_reference(group):
    assert f'`&{group}`' in REFERENCE
    assert f'.B &{group}\n' in MANUAL


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
