"""The command line: options, what is refused, decks from pipes, decks of one name."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

DECK = """&body name='a' mass=1.0 inertia=0.1 com=0.5,0.0 /
&joint name='j' type='revolute' body_a='a' /
&scene gravity=0.0,-9.81 /
&sensor name='angle' quantity='angle' body='a' /
&transient t_end=0.1 step=0.01 /
"""


def call(biela: Path, folder: Path, *arguments: str, given: str = "") -> subprocess.CompletedProcess[str]:
    """Run the solver in a folder with a text on its standard input."""
    return subprocess.run([biela, *arguments], cwd=folder, input=given, capture_output=True, text=True, timeout=600, check=False)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "no deck given"),
        (["--quiet"], "no deck given"),
        (["--chek", "a.nml"], "unknown option --chek, did you mean --check?"),
        (["-h"], "unknown option -h"),
        (["a.nml", "--output"], "--output needs a folder"),
        (["--output", "", "a.nml"], "--output needs a folder"),
        (["--output", "--check", "a.nml"], "--output needs a folder"),
        (["--output", "x", "a.nml", "a.nml"], "--output goes with one deck"),
    ],
)
def test_a_wrong_command_line_is_refused(biela, tmp_path, arguments, message):
    (tmp_path / "a.nml").write_text(DECK)
    done = call(biela, tmp_path, *arguments)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"biela: {message} (biela --help)\n"
    assert [path.name for path in tmp_path.iterdir()] == ["a.nml"]


def test_a_deck_from_a_pipe(biela, tmp_path):
    (tmp_path / "a.nml").write_text(DECK)
    assert call(biela, tmp_path, "--output", "file", "a.nml").returncode == 0
    done = call(biela, tmp_path, "--output", "pipe", "/dev/stdin", given=DECK)
    assert (done.returncode, done.stderr) == (0, "")
    rows = [
        [line for line in (tmp_path / name / "history.txt").read_text().splitlines() if not line.startswith("#")]
        for name in ("file", "pipe")
    ]
    assert rows[0] == rows[1]
    assert len(rows[0]) == 11


def test_decks_of_one_name_warn_that_they_share_a_folder(biela, tmp_path):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "same.nml").write_text(DECK)
    (tmp_path / "other.nml").write_text(DECK)
    done = call(biela, tmp_path, "a/same.nml", "other.nml", "b/same.nml")
    assert done.returncode == 0
    assert done.stderr == (
        "biela: warning: the results of b/same.nml replace those of a/same.nml, both are written into results/same "
        "(one deck and --output keeps both)\n"
    )
    assert call(biela, tmp_path, "a/same.nml", "other.nml").stderr == ""
    assert call(biela, tmp_path, "--check", "a/same.nml", "b/same.nml").stderr == ""


def test_with_several_decks_the_highest_status_and_the_good_ones_run(biela, tmp_path):
    (tmp_path / "good.nml").write_text(DECK)
    (tmp_path / "bad.nml").write_text(DECK.replace("mass=1.0", "mass=-1.0"))
    done = call(biela, tmp_path, "bad.nml", "good.nml", "absent.nml")
    assert done.returncode == 2
    assert [line.split(":")[0] for line in done.stderr.splitlines()] == ["bad.nml", "absent.nml"]
    assert (tmp_path / "results" / "good" / "history.txt").exists()
    assert not (tmp_path / "results" / "bad").exists()


def test_forces_and_lumps_of_zero_run_with_a_warning(biela, tmp_path):
    """Their values have defaults of 0 (input/README.md): the deck runs as if they were not there, and says so."""
    (tmp_path / "plain.nml").write_text(DECK, encoding="utf-8")
    (tmp_path / "idle.nml").write_text(DECK + "&force name='f' body='a' /\n&lump body='a' /\n", encoding="utf-8")
    assert call(biela, tmp_path, "--quiet", "plain.nml").stderr == ""
    done = call(biela, tmp_path, "--quiet", "idle.nml")
    assert done.returncode == 0
    assert done.stderr.splitlines() == [
        "idle.nml:6: force/f: warning: fx and fy are 0: it pushes nothing",
        "idle.nml:7: lump: warning: mass and inertia are 0: it adds nothing",
    ]
    rows = [(tmp_path / "results" / name / "history.txt").read_text().splitlines()[3:] for name in ("plain", "idle")]
    assert rows[0] == rows[1]


def test_a_check_that_cannot_be_printed_fails(biela, tmp_path):
    (tmp_path / "plain.nml").write_text(DECK, encoding="utf-8")
    with Path("/dev/full").open("w") as full:
        done = subprocess.run([biela, "--check", "plain.nml"], cwd=tmp_path, stdout=full, stderr=subprocess.PIPE,
                              text=True, check=False)
    assert done.returncode == 3
    assert "cannot be written" in done.stderr
