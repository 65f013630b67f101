"""Faulty decks: every one must show its complete diagnosis, end with status 2 and write nothing.

`faulty/NAME.nml` is a deck and `faulty/NAME.expected` all that standard error must show, line by line. To add a case write
both. The folder `lib` holds files that the decks include.
"""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
from pathlib import Path

import pytest

FAULTY = Path(__file__).resolve().parents[1] / "faulty"
DECKS = sorted(FAULTY.glob("*.nml"))
SECONDS = 300.0
WHAT_TO_DO = ("expected", "did you mean", "it applies to")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a copy of the faulty decks, where a results folder would be seen."""
    copy = tmp_path_factory.mktemp("decks") / "faulty"
    shutil.copytree(FAULTY, copy)
    return copy


def solve(biela: Path, folder: Path, *arguments: str) -> subprocess.CompletedProcess[bytes]:
    """Run the solver in a folder, within a time limit."""
    return subprocess.run([str(biela), *arguments], cwd=folder, capture_output=True, timeout=SECONDS, check=False)


def files(folder: Path) -> set[Path]:
    """Return everything below a folder."""
    return set(folder.rglob("*"))


def test_there_are_many():
    assert len(DECKS) >= 100


@pytest.mark.parametrize("deck", DECKS, ids=lambda deck: deck.stem)
@pytest.mark.parametrize("options", [("--check",), ()], ids=["check", "run"])
def test_diagnosis(biela: Path, folder: Path, deck: Path, options: tuple[str, ...]):
    before = files(folder)
    done = solve(biela, folder, *options, deck.name)
    expected = deck.with_suffix(".expected").read_text(encoding="utf-8")
    assert done.stderr.decode("utf-8", errors="replace") == expected
    assert done.stdout == b""
    assert done.returncode == 2
    assert files(folder) == before


def test_every_line_says_what_was_expected():
    for deck in DECKS:
        for line in deck.with_suffix(".expected").read_text(encoding="utf-8").splitlines():
            assert any(words in line for words in WHAT_TO_DO), f"{deck.name}: {line}"


def test_no_deck_at_that_path(biela: Path, tmp_path: Path):
    done = solve(biela, tmp_path, "--check", "nowhere.nml")
    assert done.stderr.decode() == "nowhere.nml: cannot be read: no such file or directory, expected a deck file\n"
    assert done.returncode == 2
    assert files(tmp_path) == set()


def test_path_is_shown_as_given(biela: Path, folder: Path):
    done = solve(biela, folder.parent, "--check", "faulty/set_twice.nml")
    assert done.stderr.decode() == "faulty/set_twice.nml:2: body/crank: mass is set twice, first in line 1, expected one value\n"


def test_good_deck_after_a_faulty_one(biela: Path, folder: Path, tmp_path: Path):
    good = tmp_path / "good.nml"
    text = "&body name='disc' mass=1.0 inertia=1.0 /\n&joint name='pin' type='revolute' body_a='disc' /\n"
    good.write_text(text, encoding="utf-8")
    done = solve(biela, tmp_path, "--check", str(folder / "set_twice.nml"), "good.nml")
    assert done.returncode == 2
    assert b"disc" in done.stdout
    assert done.stderr.count(b"\n") == 1


def test_of_many_faults_the_first_are_shown_in_order_and_the_rest_is_counted(biela: Path, tmp_path: Path):
    """4096 bodies, each with a fault, and 4096 joints, each with a misspelt body: linear time, sorted by line."""
    count = 4096
    bodies = "".join(f"&body name='b{k}' kind='rigid' mass=-1.0 inertia=1.0 /\n" for k in range(count))
    joints = "".join(f"&joint name='j{k}' type='revolute' body_a='c{k}' /\n" for k in range(count))
    (tmp_path / "many.nml").write_text(bodies + joints, encoding="utf-8")
    *lines, rest = solve(biela, tmp_path, "--check", "many.nml").stderr.decode().splitlines()
    assert [int(line.split(":")[1]) for line in lines] == list(range(1, 101))
    assert rest == f"many.nml: {2 * count - 100} more faults are not shown"


BODY = "&body name='b' mass=1 inertia=1 /\n"


@pytest.mark.parametrize(
    ("found", "told"),
    [
        ("fifo", "not an ordinary file"),
        ("/dev/zero", "not an ordinary file"),
        ("/dev/urandom", "not an ordinary file"),
        ("nothing", "empty, or not an ordinary file"),
        (".", "is a directory"),
    ],
)
@pytest.mark.parametrize("deck", ["{}", "&include file='{}' /", "&history name='h' kind='table' file='{}' columns=1,2 /"])
def test_a_pipe_a_device_or_a_folder_is_refused_at_once(deck, found, told, biela, tmp_path):
    """Without a size it may be a file of the system that forgets what was read (/proc/kmsg): it is not read."""
    os.mkfifo(tmp_path / "fifo")
    (tmp_path / "nothing").touch()
    (tmp_path / "scene.nml").write_text(BODY + deck.format(found))
    done = solve(biela, tmp_path, "--check", found if deck == "{}" else "scene.nml")
    assert done.returncode == 2
    assert f"cannot be read: {told}, expected a".encode() in done.stderr


@pytest.mark.parametrize("text", [b"root:x:0:0:secret\n", b"secret &1\n& secret\n", b"\0\1secret", b"a = 'secret\n&if x & y /\n"])
def test_an_included_file_that_is_no_deck_is_not_shown(text, biela, tmp_path):
    (tmp_path / "scene.nml").write_text(BODY + "&include file='passwd' /\n")
    (tmp_path / "passwd").write_bytes(text)
    done = solve(biela, tmp_path, "--check", "scene.nml")
    assert done.returncode == 2
    assert done.stderr.startswith(b"scene.nml:2: include: file='passwd' cannot be read: it ")
    assert done.stderr.count(b"\n") == 1
    assert b"secret" not in done.stderr


def test_files_may_include_each_other_3000_deep_and_not_without_end(biela, tmp_path):
    """A depth that would end the stack is refused."""
    folder = tmp_path / "a" / "b" / "c" / "d"  # the files lie four folders above the deck
    folder.mkdir(parents=True)
    (folder / "1.nml").write_text("&include file='../../../../2.nml' /\n")
    for k in range(2, 5002):
        (tmp_path / f"{k}.nml").write_text(f"&include file='{k + 1}.nml' /\n")
    (tmp_path / "3001.nml").write_text(BODY)
    assert solve(biela, folder, "--check", "1.nml").returncode == 0
    (tmp_path / "3001.nml").write_text("&include file='3002.nml' /\n")
    told = b"5000.nml:1: include: file='5001.nml' is one file too many, expected at most 5000"
    assert told in solve(biela, folder, "--check", "1.nml").stderr


def test_control_characters_of_names_and_titles_reach_no_terminal(biela, tmp_path):
    """Escapes, also those of one byte (C1), in the names of a deck and of what it includes, of its folder and its title."""
    bad = "\x1b[31m\x9b31m\u2028\u202e"
    (tmp_path / f"{bad}.nml").write_text(f"&scene title='\x9b1m\x85' /\n{BODY}&include file='{bad}x' /\n", encoding="utf-8")
    (tmp_path / "good.nml").write_text(f"&scene title='\x9b1m\x85' /\n{BODY}", encoding="utf-8")
    said = b""
    for words in (["--check", f"{bad}.nml"], [f"{bad}.nml", f"{bad}y.nml"], ["-j2", f"{bad}.nml", f"{bad}y.nml"], [f"--{bad}"],
                  ["-o", f"good.nml/{bad}", "good.nml"], ["--check", "good.nml"], ["--check", "--json", "good.nml"]):  # fmt: skip
        done = solve(biela, tmp_path, *words)
        said += done.stdout + done.stderr
    assert "title: ?1m?" in said.decode()
    assert '"title": "\\u009b1m\\u0085"' in said.decode()
    assert [c for c in said.decode() if c != "\n" and (not c.isprintable())] == []


def seconds_to_read(biela: Path, folder: Path, count: int) -> float:
    """Return the processor time [s] for reading a chain of `count` beams whose last line is faulty."""
    beam = "kind='beam' length=0.1 elements=2 material='m' section='s' reference='clamped'"
    bodies = "".join(f"&body name='b{k}' {beam} position={0.1 * k:.1f},0.0 /\n" for k in range(count))
    pair = "body_a='b{}' node_a=1 body_b='b{}' node_b=-1"
    joints = "".join(f"&joint name='j{k}' type='revolute' {pair.format(k, k - 1)} /\n" for k in range(1, count))
    other = "&material name='m' density=1.0 young=1.0e9 /\n&section name='s' area=1.0e-4 inertia=1.0e-9 /\n&scene gravity=1.0 /\n"
    (folder / "chain.nml").write_text(joints + bodies + other, encoding="utf-8")
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    assert solve(biela, folder, "--check", "chain.nml").stderr.count(b"\n") == 1
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before


def test_reading_takes_linear_time(biela: Path, tmp_path: Path):
    """Eight times the bodies take about eight times the time; 64 times if some look-up were quadratic.

    On a busy machine a run may take several times its time: the best of ten pairs counts.
    """
    pairs = ((seconds_to_read(biela, tmp_path, 8192), seconds_to_read(biela, tmp_path, 1024)) for _ in range(10))
    assert any(large < 20.0 * small for large, small in pairs)
