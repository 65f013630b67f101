"""The command line: options, what is refused, decks from pipes, decks of one name."""

from __future__ import annotations

import os
import re
import resource
import select
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
        (["-x"], "unknown option -x"),
        (["a.nml", "-o"], "-o needs a folder"),
        (["-", "-"], "standard input (-) holds one deck"),
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


def test_a_deck_from_standard_input(biela, tmp_path):
    """The deck `-`: messages name it so, files that it includes lie beside the current folder, results in results/stdin."""
    (tmp_path / "more.nml").write_text(DECK)
    done = call(biela, tmp_path, "-", given="&include file='more.nml' /\n")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert "outcome: done" in (tmp_path / "results" / "stdin" / "summary.txt").read_text()
    assert call(biela, tmp_path, "-o", "there", "-", given=DECK).returncode == 0
    assert (tmp_path / "there" / "history.txt").exists()
    assert call(biela, tmp_path, "-", given="&body /\n").stderr.startswith("-:1: body: ")
    (tmp_path / "-").write_text(DECK)
    assert call(biela, tmp_path, "--check", "./-", given="").returncode == 0


def test_short_options(biela, tmp_path):
    assert call(biela, tmp_path, "-h").stdout == call(biela, tmp_path, "--help").stdout != ""


def test_several_decks_end_with_a_line_each(biela, tmp_path):
    (tmp_path / "good.nml").write_text(DECK)
    (tmp_path / "bad.nml").write_text(DECK.replace("mass=1.0", "mass=-1.0"))
    steep = "&force name='f' type='torque' body='a' moment=1.0e50 /\n"
    (tmp_path / "lost.nml").write_text(DECK.replace("step=", "accept_unstable=.true. step=") + steep)
    decks = ["good.nml", "bad.nml", "lost.nml"]
    done = call(biela, tmp_path, *decks)
    assert done.stdout == "good.nml: done\nbad.nml: refused\nlost.nml: an analysis failed\n"
    assert call(biela, tmp_path, "--quiet", *decks).stdout == ""
    assert call(biela, tmp_path, "good.nml").stdout == ""
    checked = call(biela, tmp_path, "--check", *decks).stdout
    assert [line for line in checked.splitlines() if line.split(":")[0] in decks] == [
        "good.nml: done",
        "bad.nml: refused",
        "lost.nml: done",
    ]
    with Path("/dev/full").open("w") as full:
        assert (
            subprocess.run(
                [biela, "good.nml", "good.nml"], cwd=tmp_path, stdout=full, stderr=subprocess.PIPE, check=False
            ).returncode
            == 3
        )


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
        done = subprocess.run(
            [biela, "--check", "plain.nml"], cwd=tmp_path, stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    assert done.returncode == 3
    assert "cannot be written" in done.stderr


def test_a_terminal_sees_how_far_a_run_is(biela, tmp_path):
    """The first line of a run that would take minutes: the share of t_end that is done, the time reached, what is left."""
    (tmp_path / "long.nml").write_text(DECK.replace("t_end=0.1 step=0.01", "t_end=1.0e6 method='rk4' step=0.01 output_step=10.0"))
    terminal, end = os.openpty()
    with subprocess.Popen([biela, "long.nml"], cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=end) as run:
        os.close(end)
        shown = b""
        while not shown.endswith(b"left   ") and select.select([terminal], [], [], 60.0)[0]:
            shown += os.read(terminal, 500)
        run.terminate()
    os.close(terminal)
    done, t, left = map(float, re.fullmatch(rb"\r(\S+) %   t = +(\S+) s   about (\S+) s left   ", shown).groups())
    assert 100 * t / 1.0e6 == pytest.approx(done, abs=0.051)
    assert left > 0.2 * (1.0e6 / t - 1) - 1.0  # it is the first line after a fifth of a second


LONG = DECK.replace("t_end=0.1 step=0.01", "t_end=0.5 method='rk4' step=1e-6 output_step=0.1")


def on_a_terminal(biela: Path, folder: Path, *options: str, deck: str = LONG) -> bytes:
    """Run a deck, one that takes a while, and return what its standard error shows on a terminal."""
    (folder / "a.nml").write_text(deck)
    ours, theirs = os.openpty()
    with subprocess.Popen([biela, *options, "a.nml"], cwd=folder, stdout=subprocess.DEVNULL, stderr=theirs) as process:
        os.close(theirs)
        shown = b""
        while True:
            try:
                part = os.read(ours, 4096)
            except OSError:  # the other side has ended
                break
            if not part:
                break
            shown += part
    os.close(ours)
    assert process.returncode == 0
    return shown


def test_progress_is_shown_on_a_terminal_and_cleared(biela, tmp_path):
    lines = on_a_terminal(biela, tmp_path).split(b"\r")
    assert not lines[-1]
    assert lines[-2] == b" " * 60
    reports = [re.fullmatch(rb"(\d+\.\d) %   t = +(\S+) s   about (\d+) s left *", line) for line in lines[1:-2]]
    assert reports
    assert all(reports)
    percents, times = ([float(report[k]) for report in reports] for k in (1, 2))
    assert times == sorted(set(times))
    assert percents == pytest.approx([200 * t for t in times], abs=0.06)
    assert all(float(report[3]) < 600 for report in reports)


def test_a_terminal_that_was_shown_nothing_has_nothing_cleared(biela, tmp_path):
    assert re.fullmatch(rb"((\r[^\r]+)+\r +\r)?", on_a_terminal(biela, tmp_path, deck=DECK))


def test_no_progress_is_shown_when_quiet(biela, tmp_path):
    assert on_a_terminal(biela, tmp_path, "--quiet") == b""


def test_endless_input_is_refused(biela, tmp_path):
    with Path("/dev/zero").open("rb") as endless:
        done = subprocess.run([biela, "--check", "-"], cwd=tmp_path, stdin=endless, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr == "-: cannot be read: endless or too long, expected a deck file\n"


@pytest.mark.parametrize("limit", [1200, 0])
def test_a_summary_that_cannot_be_written_is_told(biela, tmp_path, limit):
    """Files may not be that long, or a folder has its name: the status is 3, other decks go on."""
    for name in ("a", "b"):
        (tmp_path / f"{name}.nml").write_text(DECK.replace("t_end=0.1", "t_end=0.02"))
    if not limit:
        (tmp_path / "results" / "a" / "summary.txt").mkdir(parents=True)
    done = subprocess.run(
        [biela, "a.nml", "b.nml"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
        preexec_fn=lambda: limit and resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )
    assert done.returncode == 3
    assert 'a.nml: results cannot be written into "results/a"' in done.stderr
    assert re.search(r"^a\.nml: results could not be written", done.stdout, re.MULTILINE)
    assert re.search(r"^b\.nml: " + ("results could not" if limit else "done"), done.stdout, re.MULTILINE)
