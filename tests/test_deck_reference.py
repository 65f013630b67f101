"""The reference of the deck language names every group, variable and word that the reader knows."""
import pathlib
import re

import pytest

ROOT = pathlib.Path(__file__).resolve().parent.parent
REFERENCE = (ROOT / 'input' / 'README.md').read_text(encoding='utf-8')
READERS = sorted((ROOT / 'src' / 'deck').glob('deck_*.f90'))


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


def known_groups():
    """Groups that the reader knows."""
    text = '\n'.join(joined_statements((ROOT / 'src/deck/deck_kinds.f90').read_text(encoding='utf-8')))
    return re.findall(r"'(\w+)'", re.search(r'group_names\(group_kinds\) = \[(.*?)\]', text).group(1))


@pytest.mark.parametrize('group', known_groups())
def test_every_group_stands_in_the_reference(group):
    assert f'`&{group}`' in REFERENCE
