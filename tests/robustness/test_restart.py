"""Restart: killed at any moment and continued, a run leaves the files of the uninterrupted one, to the last bit."""

from __future__ import annotations

import os
import random
import re
import shutil
import signal
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from conftest import TIMEOUT, caught, untimed, wait_for

SCENE = """&scene title='two beams, a drive, a spring, a pulse' gravity=0.0,-9.81 /
&material name='m' density=1500.0 young=3.0e9 ghm_alpha=0.5,0.3 ghm_zeta=1.2,0.6 ghm_omega=900.0,4000.0 rayleigh_stiffness=1e-6 /
&section name='s' shape='rectangle' width=0.02 height=0.02 /
&body name='crank' kind='rigid' mass=0.2 inertia=1e-4 com=0.05,0.0 angle=1.5707963267948966 /
&body name='a' kind='beam' length=0.5 elements=2 material='m' section='s' position=0.0,0.1 angle=0.2 /
&body name='b' kind='beam' length=0.4 elements=2 material='m' section='s' position=0.6,0.0 angle=1.9 modes=3 /
&joint name='o' type='revolute' body_a='crank' /
&joint name='p' type='revolute' body_a='a' node_a=1 body_b='crank' point_b=0.1,0.0 /
&joint name='q' type='revolute' body_a='a' node_a=-1 body_b='b' node_b=-1 /
&joint name='r' type='revolute' body_a='b' node_a=1 point_b=0.6,0.0 /
&history name='turn' kind='ramp' start_value=1.5707963267948966 end_value=3.0 start=0.0 finish=0.1 /
&drive name='motor' type='rotation' body_a='crank' history='turn' /
&history name='knock' kind='pulse' value=1.0 start=0.0313 finish=0.0517 /
&force name='f' type='force' body='b' node=2 fx=20.0 history='knock' /
&spring name='k' type='linear' body_a='a' node_a=2 point_b=0.5,0.5 stiffness=100.0 ghm_alpha=1.0 ghm_zeta=1.0 ghm_omega=50.0 /
&sensor name='tip' quantity='acceleration' body='b' node=-1 /
&sensor name='pin' quantity='reaction' joint='q' /
&sensor name='motor' quantity='reaction' drive='motor' /
&sensor name='work' quantity='work' joint='q' /
&sensor name='kept' quantity='energy' body='a' /
&transient t_end=0.1 {method} output_step={output} motion_step=1e-3 checkpoint_interval={interval} /
"""
METHODS = {
    "rk4": "method='rk4' step=4e-6",
    "dopri5 fixed": "method='dopri5' step=4e-6",
    "dopri5 adaptive": "method='dopri5' tolerance=1e-8",
    "errors checked": "method='dopri5' tolerance=1e-7 check_error=.true.",
    "passes": "accuracy=3e-2",
}


@dataclass
class Place:
    """A folder of its own with a deck and the solver."""

    biela: Path
    folder: Path

    def start(self, *options, **keywords) -> subprocess.Popen:
        """Start the solver on the deck."""
        return subprocess.Popen(
            [str(self.biela), "--quiet", *options, "scene.nml"], cwd=self.folder, stderr=subprocess.PIPE, text=True, **keywords
        )

    def run(self, *options) -> tuple[int, str]:
        """Run to the end; return exit status and what was said."""
        done = self.start(*options)
        _, told = done.communicate(timeout=TIMEOUT)
        return done.returncode, told

    @property
    def results(self) -> Path:
        """The results folder."""
        return self.folder / "results" / "scene"

    def files(self) -> dict[str, bytes]:
        """Return the bytes of every result, without the lines of times."""
        return {path.name: untimed(path.read_bytes()) for path in self.results.iterdir() if path.name != ".lock"}


@pytest.fixture
def place(biela, tmp_path):
    """Return a function that makes a folder with the scene under a method."""

    def make(name, method, output=2e-4, interval=1e-3):
        folder = tmp_path / name
        folder.mkdir()
        (folder / "scene.nml").write_text(SCENE.format(method=method, output=output, interval=interval), encoding="utf-8")
        return Place(biela, folder)

    return make


def killed_after(place, seconds, number, *options):
    """Start, send a signal after some time; return the exit status (negative: ended by the signal) and what was said."""
    process = place.start(*options)
    time.sleep(seconds)
    process.send_signal(number)
    _, told = process.communicate(timeout=TIMEOUT)
    return process.returncode, told


@pytest.mark.parametrize("method", METHODS)
def test_killed_at_random_moments(method, place):
    whole = place("whole", METHODS[method])
    start = time.monotonic()
    assert whole.run()[0] == 0
    duration = time.monotonic() - start
    expected = whole.files()
    assert set(expected) == {"history.txt", "energy.txt", "motion.txt", "summary.txt", "summary.json"}

    moments = random.Random(6)
    cut = place("cut", METHODS[method])
    kills = 0
    while kills < 6:
        options = ["--restart"] if (cut.results / "checkpoint").exists() else []
        status, _ = killed_after(cut, moments.uniform(0.0, 0.2 * duration), signal.SIGKILL, *options)
        if status == 0:  # faster than the signal: begin again, so that there are kills enough
            assert cut.files() == expected
        kills += status == -signal.SIGKILL
        assert status in (0, -signal.SIGKILL)
    options = ["--restart"] if (cut.results / "checkpoint").exists() else []
    assert cut.run(*options)[0] == 0
    assert cut.files() == expected
    counts = re.compile(rb"evaluations: \d+, banded solves: \d+")
    assert counts.search(cut.files()["summary.txt"])[0] == counts.search(expected["summary.txt"])[0]
    if options:
        assert re.search(r"^timing: restarts \d+$", (cut.results / "summary.txt").read_text(), re.MULTILINE)


def test_a_checkpoint_at_a_breakpoint(place):
    """At the start of the pulse the implicit method starts anew: nothing of the step before may count."""
    runs = [place(name, "method='generalized_alpha' step=3.13e-5", output=3.13e-3, interval=0.0313) for name in ("whole", "cut")]
    whole, process = [run.start() for run in runs]
    wait_for(runs[1].results / "checkpoint", process)
    process.kill()
    process.communicate(timeout=TIMEOUT)
    assert runs[1].run("--restart")[0] == 0
    whole.communicate(timeout=TIMEOUT)
    assert whole.returncode == 0
    assert runs[1].files()["history.txt"] == runs[0].files()["history.txt"]


@pytest.mark.parametrize(
    ("method", "number"), [(method, (signal.SIGINT, signal.SIGTERM)[k % 2]) for k, method in enumerate(METHODS)]
)
def test_signals_stop_cleanly(method, number, place):
    """Also without checkpoint_interval and within a long output interval: status 128 + signal, whole rows, a checkpoint."""
    whole = place("whole", METHODS[method], output=0.05, interval=0)
    assert whole.run()[0] == 0
    cut = place("cut", METHODS[method], output=0.05, interval=0)

    def stopped():
        """Return what a run says that a signal stops; None where it was faster."""
        shutil.rmtree(cut.results, ignore_errors=True)
        process = cut.start()
        wait_for(cut.results / "history.txt", process)
        time.sleep(0.01)
        process.send_signal(number)
        _, told = process.communicate(timeout=TIMEOUT)
        assert process.returncode in (0, 128 + number)
        return told if process.returncode else None

    told = caught(stopped)
    assert re.search(rf"stopped by signal {number} at t = \S+ s; biela --restart continues", told)
    assert "outcome: stopped by signal" in (cut.results / "summary.txt").read_text()
    assert (cut.results / "checkpoint").exists()
    for name in ("history.txt", "energy.txt", "motion.txt"):
        assert (cut.results / name).read_bytes().endswith(b"\n")
    assert cut.run("--restart")[0] == 0
    assert cut.files() == whole.files()


def test_killed_while_files_of_a_pass_get_their_names(place):
    """Some have their names already; of the pass that was to follow there may be beginnings."""
    whole = place("whole", METHODS["passes"])
    cut = place("cut", METHODS["passes"])
    process = whole.start()
    interrupted = cut.start()
    wait_for(cut.results / "checkpoint", interrupted)
    interrupted.send_signal(signal.SIGTERM)
    interrupted.communicate(timeout=TIMEOUT)
    (energy,) = cut.results.glob("energy.txt.new?")
    energy.rename(energy.with_suffix(""))
    (cut.results / {"1": "history.txt.new2", "2": "history.txt.new1"}[energy.name[-1]]).write_bytes(b"# beginning")
    assert cut.run("--restart")[0] == 0
    process.communicate(timeout=TIMEOUT)
    assert cut.files() == whole.files()


@pytest.fixture
def interrupted(place):
    """Return a folder with an interrupted run."""
    cut = place("cut", METHODS["rk4"], interval=1e-3)

    def killed():
        """Return the folder of a run killed after its first checkpoint; None where the run was faster."""
        process = cut.start()
        wait_for(cut.results / "checkpoint", process)
        time.sleep(0.02)
        process.kill()
        process.communicate()
        return cut if process.returncode and (cut.results / "checkpoint").exists() else None

    return caught(killed)


def contents(cut):
    """Return the bytes of every file but the lock."""
    return {path.name: path.read_bytes() for path in cut.results.iterdir() if path.name != ".lock"}


def refused(cut, sentence):
    """Check that a restart is refused with a sentence and that no file has changed."""
    before = contents(cut)
    status, told = cut.run("--restart")
    assert status == 2
    assert sentence in told
    assert len([line for line in told.splitlines() if "warning" not in line]) == 1
    assert contents(cut) == before


def test_damaged_checkpoints_are_refused(interrupted):
    path = interrupted.results / "checkpoint"
    good = path.read_bytes()
    moments = random.Random(7)
    for _ in range(8):
        at = moments.randrange(8, len(good))
        bad = bytearray(good)
        bad[at] ^= 1 << moments.randrange(8)
        path.write_bytes(bad)
        refused(interrupted, "is damaged, or is no checkpoint of biela")
    for size in (0, 8, 17, len(good) // 2, len(good) // 2 // 8 * 8, len(good) - 8, len(good) - 1):
        path.write_bytes(good[:size])
        refused(interrupted, "is damaged, or is no checkpoint of biela")
    path.write_bytes(good + bytes(8))
    refused(interrupted, "is damaged, or is no checkpoint of biela")
    path.write_bytes(b"something else" * 20)
    refused(interrupted, "is damaged, or is no checkpoint of biela")
    path.write_bytes(good)
    assert interrupted.run("--restart")[0] == 0


def test_checkpoints_of_other_decks_are_refused(interrupted):
    deck = interrupted.folder / "scene.nml"
    text = deck.read_text()
    deck.write_text(text.replace("fx=20.0", "fx=20.1"))
    refused(interrupted, "belongs to another deck or other values of --set, or the deck has been changed")
    deck.write_text(text)
    assert interrupted.run("--restart")[0] == 0


@pytest.mark.parametrize("name", ["history.txt", "energy.txt", "motion.txt"])
def test_results_that_have_changed_are_noticed(name, interrupted):
    """Cut off, zeros of the same length, another digit in the first row."""
    path = interrupted.results / name
    good = path.read_bytes()
    first = re.search(rb"^ .*$", good, re.MULTILINE)
    another = good[: first.end() - 1] + bytes([good[first.end() - 1] ^ 1]) + good[first.end() :]
    for bad in (good[:100], bytes(len(good)), another):
        path.write_bytes(bad)
        refused(interrupted, "missing, cut off or changed since its checkpoint")
    path.write_bytes(good)
    assert interrupted.run("--restart")[0] == 0


def test_changed_results_of_the_pass_before_are_noticed(place):
    """They stay the results where no later pass is better."""
    cut = place("cut", METHODS["passes"])

    def killed():
        """Return the results of a pass, the next one of which was killed; None where the run was faster."""
        process = cut.start()
        wait_for(cut.results / "history.txt", process)
        process.kill()
        process.communicate()
        return cut.results / "history.txt" if process.returncode else None

    history = caught(killed)
    good = history.read_bytes()
    history.write_bytes(bytes(len(good)))
    refused(cut, "missing, cut off or changed since its checkpoint")
    history.write_bytes(good)
    assert cut.run("--restart")[0] == 0


def test_no_checkpoint_no_restart(place):
    fresh = place("fresh", METHODS["rk4"])
    status, told = fresh.run("--restart")
    assert status == 2
    assert "there is no checkpoint to restart from" in told
    assert not fresh.results.exists()


def test_a_fresh_run_replaces_a_checkpoint(interrupted, place):
    whole = place("whole", METHODS["rk4"])
    assert whole.run()[0] == 0
    assert interrupted.run()[0] == 0
    assert interrupted.files() == whole.files()
    status, told = interrupted.run("--restart")
    assert status == 2
    assert "the run ended well" in told


def test_a_deck_without_transient_cannot_restart(biela, tmp_path):
    (tmp_path / "scene.nml").write_text(re.sub(r"&transient.*\n", "&modal modes=2 /\n", SCENE))
    status, told = Place(biela, tmp_path).run("--restart")
    assert status == 2
    assert "the deck has no transient that --restart could continue" in told


LOW = 0xFFFFFFFF
PRIME = 2**32 + 15


def turned(word, n):
    """Return a word of 64 bits turned to the left."""
    return (word << n | word >> 64 - n) & 0xFFFFFFFFFFFFFFFF


def digest(words):
    """Return the checksum of a checkpoint's words: Fletcher's sums over the halves of words mixed of four."""
    a, b, length = 0, 0, 8 * len(words)
    words = list(words) + [0x2020202020202020] * (4 - len(words) % 4)  # blanks behind the last ones, or alone
    for at in range(0, len(words), 4):
        word = words[at] ^ turned(words[at + 1], 13) ^ turned(words[at + 2], 27) ^ turned(words[at + 3], 43)
        a += word & LOW
        b += a
        a += word >> 32
        b += a
    return turned(b % PRIME, 32) ^ a % PRIME ^ turned(length, 48)


def test_checkpoints_of_other_builds_are_refused(interrupted):
    """The second word stands for version, compiler and options; the last is the checksum of the others."""
    path = interrupted.results / "checkpoint"
    words = np.frombuffer(path.read_bytes(), np.uint64).tolist()
    assert words[-1] == digest(words[:-1])
    words[1] ^= 1
    words[-1] = digest(words[:-1])
    path.write_bytes(np.array(words, np.uint64).tobytes())
    refused(interrupted, "was written by another version or build of biela")


def test_a_checkpoint_that_is_no_file_is_refused(interrupted):
    path = interrupted.results / "checkpoint"
    path.unlink()
    os.mkfifo(path)
    status, told = interrupted.run("--restart")
    assert status == 2
    assert "cannot be read" in told
