"""A short run of `make fuzz`, and the decks in which it found something wrong, made smaller (tests/fuzz/found)."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "fuzz"))

import fuzz

FOUND = sorted((Path(__file__).resolve().parents[1] / "fuzz" / "found").glob("*.nml"))


@pytest.mark.parametrize("number", range(4))
def test_decks_of_a_batch_end_as_they_should(number, biela):
    judged = fuzz.judge(biela, fuzz.drawn(number, 50), twin=True)
    statuses = [status for _, _, status in judged]
    assert [f"seed {number}: {fault}\n{deck.decode('latin-1')}" for deck, fault, _ in judged if fault] == []
    assert statuses.count(0) > 2
    assert statuses.count(2) > 5


def test_decks_that_were_found(biela):
    judged = fuzz.judge(biela, [path.read_bytes() for path in FOUND])
    assert [(path.name, fault) for path, (_, fault, _) in zip(FOUND, judged) if fault] == []


@pytest.mark.parametrize(
    ("program", "fault"),
    [
        ("kill -SEGV $$", "died or hung: status -11"),
        ("echo d000.nml: done; mkdir -p results/d000; echo nan > results/d000/history.txt", "history.txt is not finite"),
        ("echo d000.nml: refused", "refused without a message"),
        ("echo d000.nml: done; mkdir -p results/d000; printf 1 > results/d000/history.txt", "history.txt ends within a line"),
        ("echo d000.nml: done; mkdir -p results/d000; echo outcome: stopped > results/d000/summary.txt", "contradict each other"),
    ],
)
def test_what_is_wrong_is_noticed(program, fault, tmp_path):
    path = tmp_path / "program"
    path.write_text(f"#!/bin/sh\n{program}\n")
    path.chmod(0o755)
    ((_, found, _),) = fuzz.judge(path, [b"&scene /\n"])
    assert fault in found


def test_energies_off_balance_are_noticed(tmp_path):
    rows = "0.0 0.0 0.0 0.0 0.0\n0.1 1.0 {} 0.0 0.0\n"
    for potential, noticed in ((-1.0, False), (-0.5, True)):
        (tmp_path / "energy.txt").write_text("# energies\n" + rows.format(potential))
        assert bool(fuzz.unbalanced(tmp_path, kinetic_alone=False)) == noticed
    for kinetic, noticed in ((0.96, False), (0.94, True)):
        (tmp_path / "energy.txt").write_text(f"# energies\n0.0 1.0 0.0 0.0 0.0\n0.1 {kinetic} 0.0 0.0 0.0\n")
        assert bool(fuzz.unbalanced(tmp_path, kinetic_alone=True)) == noticed


def test_methods_that_disagree_are_noticed(tmp_path):
    for name, end in (("a", 1.0), ("b", 1.1), ("c", 1.0)):
        (tmp_path / "results" / name).mkdir(parents=True)
        (tmp_path / "results" / name / "history.txt").write_text(f"# columns: t[s] p.x[m]\n0.0 0.0\n0.1 {end}\n")
    assert "differ in p.x[m]" in fuzz.disagree(tmp_path, ["a.nml", "b.nml"])
    assert fuzz.disagree(tmp_path, ["a.nml", "c.nml"]) == ""


def test_a_deck_is_made_smaller(tmp_path):
    path = tmp_path / "program"
    path.write_text("#!/bin/sh\ngrep -q gravity d000.nml && kill -SEGV $$\necho d000.nml: done\n")
    path.chmod(0o755)
    deck = b"&scene title='a' gravity=0,1 /\n&body name='b' mass=1 /\n"
    ((_, fault, _),) = fuzz.judge(path, [deck])
    assert fuzz.smaller(path, deck, fuzz.kind_of(fault)).split() == [b"&scene", b"gravity=0,1", b"/"]
