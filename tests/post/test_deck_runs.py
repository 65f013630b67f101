"""Runs of many decks: what is kept, what a run that fails or takes too long says, interruptions, the progress bar.

A stand-in for the solver obeys its deck, which is a script of the shell.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from biela import deck_runs
from biela.deck_runs import InterruptedRunsError, Outcome, OutOfTimeError, Runner, RunsError
from biela.progress import Progress
from conftest import TIMEOUT, wait_for

ENDLESS = "sleep 600\n"
GOOD = """mkdir out
printf '# columns: t[s] a.x[m]\\n0.0 1.0\\n1.0 2.0\\n' > out/history.txt
printf '{"timing": {"processor_seconds": 0.5}, "transient": {"steps": 3}, "model": {"coordinates": 4}}' > out/summary.json
"""


@pytest.fixture
def program(tmp_path):
    """Return a solver that obeys its decks."""
    program = tmp_path / "solver"
    program.write_text("#!/bin/sh\n. ./deck.nml\n")
    program.chmod(0o755)
    return program


@pytest.fixture
def runner(program, tmp_path):
    """Return a runner of that solver."""
    return Runner(program, tmp_path / "kept", 2)


def test_a_run_gives_its_rows_and_what_it_cost(runner):
    found = runner.one(GOOD)
    assert (found.ok, found.names, found.units, found.seconds, found.steps, found.unknowns) == (True, ("a.x",), ("m",), 0.5, 3, 8)
    np.testing.assert_array_equal(found.data, [[0.0, 1.0], [1.0, 2.0]])
    assert (runner.made, runner.found) == (1, 0)
    again = runner.one(GOOD)
    np.testing.assert_array_equal(again.data, found.data)
    assert (runner.made, runner.found, again.names, again.counts) == (1, 1, found.names, found.counts)


DAMAGES = {
    "empty": lambda _: b"",
    "no archive": lambda _: b"PK\x03\x04 and no more",
    "cut": lambda kept: kept[:60],
    "cut at its end": lambda kept: kept[:-30],
    "overwritten": lambda kept: kept[:60] + b"\xff" * 40 + kept[100:],
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_kept_run_that_is_damaged_is_made_again(runner, damage):
    runner.one(GOOD)
    (path,) = runner.folder.iterdir()
    path.write_bytes(DAMAGES[damage](path.read_bytes()))
    assert runner.one(GOOD).seconds == 0.5
    assert (runner.made, runner.found) == (2, 0)


@pytest.mark.parametrize(
    ("deck", "status", "message"),
    [
        ("echo 'deck.nml:3: warning: odd' >&2; echo 'deck.nml:4: no such word' >&2; exit 2", 2, "line 4: no such word"),
        ("exit 7", 7, "the solver ended with status 7"),
        ("exit 0", -2, "run/out: no such file"),
        (GOOD + "echo '1.0 nan' >> out/history.txt", -2, "out/history.txt:4: 'nan' is no finite number"),
        (GOOD + "rm out/summary.json", -2, "out/summary.json: no such file (has the run been made?)"),
        (GOOD + "printf '{' > out/summary.json", -2, "out/summary.json: cannot be read"),
    ],
)
def test_a_run_that_fails_says_why(runner, deck, status, message):
    found = runner.one(deck)
    assert not found.ok
    assert found.status == status
    assert message in found.message


def test_a_run_that_takes_too_long_says_how_far_it_came(runner, tmp_path, monkeypatch):
    said = "deck.nml: stopped by signal 15 at t =  2.000000E-03 s; biela --restart continues from there"
    ready, real = tmp_path / "ready", subprocess.Popen.communicate

    def communicate(child: subprocess.Popen, timeout: float | None = None) -> tuple:
        if timeout != runner.longest:
            return real(child, timeout=timeout)
        while not ready.exists():
            time.sleep(0.01)
        raise subprocess.TimeoutExpired("solver", timeout)

    monkeypatch.setattr(subprocess.Popen, "communicate", communicate)
    monkeypatch.setattr(deck_runs, "GRACE", 100.0)
    deck = f"trap \"echo '{said}' >&2; exit 143\" TERM; touch {ready}; while :; do sleep 0.01; done\n"
    found = runner.one(deck)
    assert (found.status, found.message) == (-1, "stopped after 300 s at t = 0.002 s")


def test_a_run_that_does_not_listen_is_ended(runner, monkeypatch):
    monkeypatch.setattr(deck_runs, "GRACE", 0.05)
    runner.longest = 0.3
    found = runner.one("trap '' TERM; " + ENDLESS)
    assert (found.status, found.message) == (-1, "stopped after 0.3 s")


def test_ctrl_c_ends_the_solvers_and_keeps_what_was_finished(runner, monkeypatch):
    real = deck_runs.wait

    def interrupted(jobs: set, **_: object) -> tuple:
        while not runner.made or not runner.children:
            real(jobs, timeout=0.01)
        raise KeyboardInterrupt

    monkeypatch.setattr(deck_runs, "wait", interrupted)
    with pytest.raises(InterruptedRunsError):
        runner.all([GOOD, ENDLESS, ENDLESS + "# never begun"])
    assert runner.children == set()
    assert [path.suffix for path in runner.folder.iterdir()] == [".npz"]
    monkeypatch.setattr(deck_runs, "wait", real)
    assert runner.one(GOOD).ok, "kept"
    with pytest.raises(InterruptedRunsError):
        runner.one("exit 0\n")


def test_a_solver_that_begins_after_ctrl_c_is_ended(runner):
    runner.stopped.set()
    found = runner._made(ENDLESS, "key")
    assert (found.status, found.message) == (-9, "the solver ended with status -9")


def test_ctrl_c_in_one_of_several_tasks(runner):
    def task(item: int) -> int:
        if item == 2:
            raise KeyboardInterrupt
        return 10 * item

    assert runner.spread(task, [1, 3]) == [10, 30]
    with pytest.raises(InterruptedRunsError):
        runner.spread(task, [1, 2, 3])
    assert runner.stopped.is_set()


def test_ctrl_c_while_a_solver_is_waited_for_ends_it(runner, monkeypatch):
    seen = []

    def communicate(child: subprocess.Popen, **_: object) -> None:
        seen.append(child)
        raise KeyboardInterrupt

    monkeypatch.setattr(subprocess.Popen, "communicate", communicate)
    with pytest.raises(KeyboardInterrupt):
        runner._made(ENDLESS, "key")
    assert seen[0].wait(timeout=100) == -9
    assert list(runner.folder.iterdir()) == []


@pytest.mark.parametrize(("finished", "pairs"), [(1, 0), (3, 1), (5, 2), (100, deck_runs.MOST_REPEATS)])
def test_runs_in_turn_give_the_median_of_the_pairs_that_the_time_allows(runner, monkeypatch, finished, pairs):
    made = []

    def run(text: str, _: str) -> Outcome:
        if len(made) == finished:
            raise OutOfTimeError
        made.append(text)
        return Outcome(0, "", seconds=float(len(made)))

    monkeypatch.setattr(runner, "_made", run)
    if not pairs:
        with pytest.raises(OutOfTimeError):
            runner.timed_in_turn("first", "second")
        return
    first, second = runner.timed_in_turn("first", "second")
    assert (first.seconds, second.seconds) == (float(pairs), float(pairs + 1))
    assert [text.startswith("first") for text in made[:4]] == [True, False, True, False][: len(made)]
    again = runner.timed_in_turn("first", "second")
    assert [outcome.seconds for outcome in again] == [first.seconds, second.seconds]


def test_a_solver_or_a_folder_that_cannot_be_used(runner, tmp_path):
    with pytest.raises(RunsError, match=r"none: No such file or directory \(`make` builds the solver\)"):
        Runner(tmp_path / "none", tmp_path / "kept")
    with pytest.raises(RunsError, match=r"solver/kept: Not a directory$"):
        Runner(runner.biela, runner.biela / "kept")


def test_the_progress_bar_is_for_a_terminal(monkeypatch, capsys):
    for terminal, shown in ((False, True), (True, False)):
        monkeypatch.setattr(sys.stderr, "isatty", lambda terminal=terminal: terminal)
        progress = Progress(shown)
        progress.show("reference", 1, 4)
        progress.clear()
    assert capsys.readouterr().err == ""
    progress = Progress(True)
    progress.begun -= 7.0
    progress.show("reference, rk4", 1, 4, ", 3 runs made, 2 stored ones used")
    line = f"[{'#' * 5}{'.' * 15}] reference, rk4: 1/4, 7 s, 3 runs made, 2 stored ones used"
    assert capsys.readouterr().err == "\r" + line.ljust(118)
    progress.show("runs", 12, 0)
    assert capsys.readouterr().err == "\r" + "runs: 12, 7 s".ljust(118)
    progress.show("reference" * 20, 4, 4)
    progress.clear()
    told = capsys.readouterr().err
    assert len(told) == 1 + 118 + 1 + 118 + 1
    assert told.endswith("\r" + " " * 118 + "\r")


def test_the_place_of_a_run_is_its_own_and_goes(runner, tmp_path):
    runner.one(f"pwd > {tmp_path}/where\n")
    where = Path((tmp_path / "where").read_text().strip())
    assert where.parent == runner.folder
    assert not where.exists()


def test_solvers_end_with_a_study_that_is_killed(program, tmp_path):
    deck = "trap 'touch ../../ended; exit' TERM\ntouch ../../begun\nwhile :; do sleep 0.02; done\n"
    words = "import sys; from pathlib import Path; from biela.deck_runs import Runner; "
    words += "Runner(Path(sys.argv[1]), Path('kept')).one(sys.argv[2])"
    post = Path(deck_runs.__file__).parents[1]
    study = subprocess.Popen(
        [sys.executable, "-c", words, program, deck], cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(post)}
    )
    wait_for(tmp_path / "begun", study)
    study.kill()
    study.wait()
    until = time.monotonic() + 0.02 * TIMEOUT
    while not (tmp_path / "ended").exists() and time.monotonic() < until:
        time.sleep(0.02)
    assert (tmp_path / "ended").exists()
