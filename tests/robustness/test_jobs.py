"""--jobs: decks side by side leave what they leave one after another; what they say is not mixed; a signal stops all."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import time

import pytest
from conftest import TIMEOUT, untimed, wait_for

DECK = """&scene gravity=0.0,-9.81 /
&body name='a' kind='rigid' mass=1.0 inertia=0.1 com=0.5,0.0 angle={angle} /
&joint name='pin' type='revolute' body_a='a' /
&joint name='pin2' type='revolute' body_a='a' /
&sensor name='tip' quantity='position' body='a' point=1.0,0.0 /
&transient t_end={t_end} method='rk4' step=1e-3 /
"""
LINE = re.compile(r"(?P<deck>\S+): (?P<words>[a-z ]+), (?P<seconds>\d+\.\d\d) s, (?P<warnings>\d+) warnings?")


def decks(folder, count, t_end=0.05):
    names = [f"d{k}.nml" for k in range(count)]
    for k, name in enumerate(names):
        (folder / name).write_text(DECK.format(angle=0.1 * k, t_end=t_end))
    return names


def call(biela, folder, *words):
    return subprocess.run([biela, *words], cwd=folder, capture_output=True, text=True, check=False, timeout=TIMEOUT)


def test_results_are_those_of_one_after_another(biela, tmp_path):
    (tmp_path / "one").mkdir()
    (tmp_path / "many").mkdir()
    for folder, options in ((tmp_path / "one", []), (tmp_path / "many", ["--jobs", "3"])):
        assert call(biela, folder, *options, *decks(folder, 7)).returncode == 0
    for path in (tmp_path / "one" / "results").rglob("*.*"):
        if path.is_file():
            assert untimed((tmp_path / "many" / path.relative_to(tmp_path / "one")).read_bytes()) == untimed(path.read_bytes())


def test_one_line_a_deck_and_messages_in_one_piece(biela, tmp_path):
    names = decks(tmp_path, 6)
    (tmp_path / "bad.nml").write_text("&scene titel='x' /\n")
    begun = time.monotonic()
    done = call(biela, tmp_path, "-j", "2", *names, "bad.nml", "none.nml")
    whole = time.monotonic() - begun
    found = {m["deck"]: m for m in map(LINE.fullmatch, done.stdout.splitlines())}
    assert done.returncode == 2
    assert set(found) == {*names, "bad.nml", "none.nml"}
    assert found["bad.nml"]["words"] == "refused"
    assert all(float(m["seconds"]) <= whole + 0.01 for m in found.values())
    for name in names:
        mine = [line for line in done.stderr.splitlines() if line.startswith(name)]
        assert int(found[name]["warnings"]) == len(mine) > 0
        first = done.stderr.index(mine[0])
        assert done.stderr[first:].startswith("\n".join(mine))


def test_a_single_deck_may_have_jobs_to_spare(biela, tmp_path):
    assert call(biela, tmp_path, "--jobs", "2", *decks(tmp_path, 1)).stdout.startswith("d0.nml: ")


def test_quiet_says_nothing_of_runs_that_go_well(biela, tmp_path):
    names = decks(tmp_path, 3)
    assert call(biela, tmp_path, "--quiet", "--jobs", "2", *names).stdout == ""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_to_the_first_process_stops_all(number, biela, tmp_path):
    names = decks(tmp_path, 4, t_end=1e4)
    process = subprocess.Popen(
        [biela, "--jobs", "2", *names], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, start_new_session=True
    )
    for name in ("d0", "d1"):
        wait_for(tmp_path / "results" / name / "energy.txt", process)
    os.kill(process.pid, number)
    said, _ = process.communicate(timeout=TIMEOUT)
    assert process.returncode == 128 + number
    assert said.decode().count("stopped by a signal") == 2
    assert not (tmp_path / "results" / "d2").exists()
    assert (tmp_path / "results" / "d0" / "checkpoint").exists()
    with pytest.raises(ProcessLookupError):
        os.killpg(process.pid, 0)


def test_decks_end_when_the_process_that_started_them_is_killed(biela, tmp_path):
    names = decks(tmp_path, 2, t_end=1e4)
    process = subprocess.Popen([biela, "-j", "2", *names], cwd=tmp_path, stdout=subprocess.DEVNULL, start_new_session=True)
    for name in ("d0", "d1"):
        wait_for(tmp_path / "results" / name / "energy.txt", process)
    process.kill()
    process.wait(timeout=TIMEOUT)
    until = time.monotonic() + TIMEOUT
    while list(tmp_path.glob("results/*/.lock")) and time.monotonic() < until:
        time.sleep(0.02)
    for name in ("d0", "d1"):
        assert "outcome: stopped by signal 15" in (tmp_path / "results" / name / "summary.txt").read_text()
        assert (tmp_path / "results" / name / "checkpoint").exists()


@pytest.mark.parametrize("words", [("0",), ("x",), ("1025",), ()])
def test_what_is_no_number_is_refused(words, biela, tmp_path):
    done = call(biela, tmp_path, "--jobs", *words)
    assert done.returncode == 2
    assert "--jobs needs a number" in done.stderr


def test_decks_of_one_name_are_refused(biela, tmp_path):
    (tmp_path / "sub").mkdir()
    names = [*decks(tmp_path, 1), *(f"sub/{name}" for name in decks(tmp_path / "sub", 1))]
    done = call(biela, tmp_path, "--jobs", "2", *names)
    assert done.returncode == 2
    assert "results/d0" in done.stderr
    assert not (tmp_path / "results").exists()
