"""Signals, closed streams, pipes in place of files, memory that ends: a status, one line, no lock left behind."""

from __future__ import annotations

import os
import re
import resource
import signal
import stat
import subprocess
from pathlib import Path

import pytest
from conftest import wait_for

PENDULUM = """&body name='a' mass=1.0 inertia=0.1 com=0.0,-0.5 /
&scene gravity=0.0,-9.81 /
&joint name='j' type='revolute' body_a='a' /
&spring name='k' type='torsional' body_a='a' stiffness=1.0 damping=0.1 /
&force name='f' type='torque' body='a' moment=0.1 /
&sensor name='angle' quantity='angle' body='a' /
"""
BEAM = """&scene gravity=0.0,-9.81 /
&material name='m' density=1600.0 young=2.1e10 rayleigh_stiffness=1e-5 /
&section name='s' area=1.6129e-4 inertia=8.6576e-9 /
&body name='rod' kind='beam' length=1.0 elements=300 material='m' section='s' reference='clamped' /
&joint name='j' type='weld' body_a='rod' node_a=1 /
"""
TRANSIENT = "&transient t_end=0.1 step=0.01 method='generalized_alpha' checkpoint_interval=0.02 /\n"
ENDLESS = {
    "static analysis": (PENDULUM + "&static load_steps=20000000 /\n", "static.txt"),
    "modal analysis": (BEAM + "&modal modes=40 /\n", ".lock"),
    "frequency response": (
        PENDULUM + "&frequency_response from=0.1 to=10.0 points=20000000 input='f' /\n",
        "frequency_response.txt",
    ),
}


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("analysis", ENDLESS)
def test_a_signal_ends_every_analysis_and_the_decks_after_it(analysis, number, biela, tmp_path):
    deck, file = ENDLESS[analysis]
    (tmp_path / "first.nml").write_text(PENDULUM + TRANSIENT)
    (tmp_path / "second.nml").write_text(deck + TRANSIENT)
    (tmp_path / "third.nml").write_text(PENDULUM + TRANSIENT)
    command = [biela, "--quiet", "first.nml", "second.nml", "third.nml"]
    results = tmp_path / "results"
    process = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    wait_for(results / "second" / file, process)
    process.send_signal(number)
    _, told = process.communicate(timeout=600)
    assert process.returncode == 128 + number
    said = f"stopped by signal {int(number)} in the {analysis}, whose results may be incomplete; run the deck again"
    assert f"second.nml: {said}\n" in told
    assert f"outcome: {said}\n" in (results / "second" / "summary.txt").read_text()
    assert "outcome: done" in (results / "first" / "summary.txt").read_text()
    assert not list(results.glob("*/.lock"))
    assert not (results / "third").exists()
    for path in (results / "second").glob("*.txt"):
        assert path.read_bytes().endswith(b"\n")
    if analysis == "frequency response":
        points = re.search(r"points: (\d+),", (results / "second" / "summary.txt").read_text())[1]
        rows = (results / "second" / file).read_text().splitlines()
        assert int(points) == sum(not row.startswith("#") for row in rows)


def test_messages_that_nobody_reads_any_more_do_not_end_a_run_halfway(biela, tmp_path):
    (tmp_path / "a.nml").write_text(ENDLESS["static analysis"][0])
    process = subprocess.Popen([biela, "--quiet", "a.nml"], cwd=tmp_path, stderr=subprocess.PIPE)
    results = tmp_path / "results" / "a"
    wait_for(results / "static.txt", process)
    process.stderr.close()
    process.terminate()
    assert process.wait(timeout=600) == 128 + signal.SIGTERM
    assert "outcome: stopped by signal 15" in (results / "summary.txt").read_text()
    assert not (results / ".lock").exists()


def test_a_folder_into_which_another_run_writes_is_left_alone(biela, tmp_path):
    (tmp_path / "a.nml").write_text(ENDLESS["static analysis"][0])
    process = subprocess.Popen([biela, "--quiet", "a.nml"], cwd=tmp_path, stderr=subprocess.DEVNULL)
    wait_for(tmp_path / "results" / "a" / "static.txt", process)
    done = subprocess.run([biela, "a.nml"], cwd=tmp_path, capture_output=True, text=True, check=False)
    process.terminate()
    process.wait(timeout=600)
    assert done.returncode != 0
    assert done.stderr == 'a.nml: another run is writing into "results/a"\n'


def test_a_signal_before_anything_is_written_ends_at_once(biela, tmp_path):
    process = subprocess.Popen([biela, "-"], cwd=tmp_path, stdin=subprocess.PIPE)
    process.stdin.write(b"&" * 200000)  # more than the pipe holds: the run waits for the rest of its deck now
    process.send_signal(signal.SIGTERM)
    assert process.wait(timeout=600) == 128 + signal.SIGTERM
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("closed", [(0,), (1,), (2,), (0, 1, 2)])
def test_closed_streams_change_no_result(closed, biela, tmp_path):
    def close():
        for number in closed:
            os.close(number)

    deck = PENDULUM + "&force name='idle' body='a' /\n&static /\n" + TRANSIENT.replace("generalized_alpha", "rk4")
    (tmp_path / "a.nml").write_text(deck)
    subprocess.run([biela, "-o", "plain", "a.nml"], cwd=tmp_path, check=True, capture_output=True)
    done = subprocess.run([biela, "-o", "closed", "a.nml"], cwd=tmp_path, preexec_fn=close, check=False)
    assert done.returncode == 0
    names = {path.name for path in (tmp_path / "plain").iterdir()}
    assert {path.name for path in (tmp_path / "closed").iterdir()} == names
    for name in names - {"summary.txt", "summary.json"}:
        assert (tmp_path / "closed" / name).read_bytes() == (tmp_path / "plain" / name).read_bytes()


@pytest.mark.parametrize("words", [[], ["--jobs", "2"]])
@pytest.mark.parametrize("quiet", [False, True])
def test_how_decks_ended_is_a_line_that_was_asked_for(words, quiet, biela, tmp_path):
    """With all streams closed the results are complete; the lines cannot be printed, which --quiet does not ask for."""
    for name in ("a", "b"):
        (tmp_path / f"{name}.nml").write_text(PENDULUM + TRANSIENT.replace("generalized_alpha", "rk4"))
    command = [biela, *words, *(["--quiet"] if quiet else []), "a.nml", "b.nml"]
    done = subprocess.run(command, cwd=tmp_path, preexec_fn=lambda: os.closerange(0, 3), check=False)
    assert done.returncode == (0 if quiet else 3)
    for name in ("a", "b"):
        assert "outcome" in (tmp_path / "results" / name / "summary.json").read_text()


@pytest.mark.parametrize("options", [["--help"], ["--version"], ["--check", "a.nml"]])
def test_what_cannot_be_printed_is_told(options, biela, tmp_path):
    (tmp_path / "a.nml").write_text(PENDULUM)
    for close in (None, lambda: os.close(1)):
        with Path("/dev/full").open("w") as full:
            done = subprocess.run(
                [biela, *options], cwd=tmp_path, stdout=full, stderr=subprocess.PIPE, preexec_fn=close, check=False
            )
        assert done.returncode == 3
        assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize("name", ["energy.txt", "history.txt", "summary.txt.new", "summary.json.new", ".lock"])
def test_a_pipe_in_place_of_a_result_is_refused(name, run_deck, tmp_path):
    folder = tmp_path / "results" / "scene"
    folder.mkdir(parents=True)
    os.mkfifo(folder / name)
    done = run_deck(PENDULUM + TRANSIENT, expect=3)
    assert "results cannot be written into" in done.stderr
    assert name == ".lock" or not (folder / ".lock").exists()


@pytest.fixture
def checkpoint(biela, tmp_path):
    """Return the checkpoint of a run stopped by a limit on the size of its files."""
    (tmp_path / "a.nml").write_text(PENDULUM + TRANSIENT.replace("0.01", "1e-4"))
    limit = (100000, 100000)
    command = [biela, "--quiet", "a.nml"]
    done = subprocess.run(command, cwd=tmp_path, check=False, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, limit))
    assert done.returncode == 3
    path = tmp_path / "results" / "a" / "checkpoint"
    assert path.exists()
    return path


def restart(biela, folder, **keywords):
    """Restart deck a.nml; return status and what it says."""
    command = [biela, "--quiet", "--restart", "a.nml"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=600, **keywords)
    return done.returncode, done.stderr


def test_a_pipe_in_place_of_a_checkpoint_is_refused(checkpoint, biela, tmp_path):
    checkpoint.unlink()
    os.mkfifo(checkpoint)
    status, told = restart(biela, tmp_path)
    assert (status, len(told.splitlines())) == (2, 1)
    assert "cannot be read" in told


def test_an_enlarged_checkpoint_is_refused_before_it_is_read(checkpoint, largest, biela, tmp_path):
    os.truncate(checkpoint, 40 * 2**30)
    status, told = restart(biela, tmp_path, env=largest(1e8))
    assert (status, len(told.splitlines())) == (2, 1)
    assert "is damaged" in told


@pytest.mark.parametrize("name", ["history.txt", "energy.txt"])
def test_results_that_a_restart_cannot_extend(name, checkpoint, biela, tmp_path):
    """Nothing is written through a link, though what is there may be read."""
    path = checkpoint.with_name(name)
    text = path.read_bytes()
    path.rename(tmp_path / "elsewhere")
    path.symlink_to(tmp_path / "elsewhere")
    status, told = restart(biela, tmp_path)
    assert (tmp_path / "elsewhere").read_bytes() == text
    assert (status, len(told.splitlines())) == (3, 1)
    assert "results cannot be written into" in told


def test_memory_that_ends_is_told_and_leaves_no_lock(largest, biela, tmp_path):
    """The run-time library may say first which array it could not have."""
    (tmp_path / "a.nml").write_text(BEAM.replace("300", "1500") + TRANSIENT)
    outcomes = []
    for most in (1e5, 2e5, 3e5, 4e5, 6e5, 8e5, 1e6, 1e9):
        command = [biela, "--quiet", "a.nml"]
        done = subprocess.run(command, cwd=tmp_path, env=largest(most), capture_output=True, text=True, check=False)
        assert not (tmp_path / "results" / "a" / ".lock").exists()
        outcomes.append(done.returncode)
        assert done.returncode == 0 or done.stderr.splitlines()[-1].startswith("biela: stopped, most likely because")
    assert set(outcomes) == {0, 1}


RESULTS = ["history.txt", "summary.json", "checkpoint"]
SCRATCH = [".lock", "summary.json.new", "summary.txt.new", "checkpoint.new"]
# how files begin that a killed run has left
BEGIN = {"history": "# biela: sensors", "summary": '{\n  "version": "0', "checkpoint": "bbbbbbbb", "": ""}


@pytest.mark.parametrize("name", [*RESULTS, *SCRATCH])
@pytest.mark.parametrize("kind", ["link", "dangling link", "device", "hard link", "left over"])
def test_no_name_in_a_folder_leads_a_run_to_a_file_elsewhere(kind, name, run_deck, tmp_path):
    """Links are replaced by results and refused where biela keeps what it needs meanwhile; nothing is written through them."""
    place, other = tmp_path / "results" / "scene" / name, tmp_path / "precious"
    place.parent.mkdir(parents=True)
    other.write_text("precious")
    if kind == "link":
        place.symlink_to(other)
    elif kind == "dangling link":
        place.symlink_to(tmp_path / "nowhere")
    elif kind == "hard link":
        place.hardlink_to(other)
    elif kind == "left over":
        place.write_text(BEGIN[name.partition(".")[0]])
    else:
        try:
            os.mknod(place, stat.S_IFCHR | 0o666, os.makedev(1, 3))
        except PermissionError:
            pytest.skip("only root makes devices")
    refused = name in SCRATCH and kind not in ("hard link", "left over")
    run = run_deck(PENDULUM + TRANSIENT, expect=3 if refused else 0)
    assert other.read_text() == "precious"
    assert not (tmp_path / "nowhere").exists()
    assert os.path.lexists(place) == (refused or name in ("history.txt", "summary.json"))
    if refused:
        assert "results cannot be written" in run.stderr
    elif place.exists():
        assert stat.S_ISREG(place.lstat().st_mode)


def test_a_lock_is_the_file_of_that_name_or_none(biela, tmp_path):
    """Who opens the lock, waits, and then locks a file that has been removed since must not count as the one who holds it."""
    (tmp_path / "late.c").write_text(LATE_LOCK)
    subprocess.run(["gcc", "-shared", "-fPIC", "-o", "late.so", "late.c", "-ldl"], cwd=tmp_path, check=True)
    (tmp_path / "a.nml").write_text(ENDLESS["static analysis"][0])
    lock = tmp_path / "results" / "a" / ".lock"
    lock.parent.mkdir(parents=True)
    lock.touch()
    environment = {**os.environ, "LD_PRELOAD": str(tmp_path / "late.so")}
    late = subprocess.Popen([biela, "a.nml"], cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True)
    wait_for(tmp_path / "opened", late)
    lock.unlink()
    other = subprocess.Popen([biela, "--quiet", "a.nml"], cwd=tmp_path, stderr=subprocess.DEVNULL)
    wait_for(lock.with_name("static.txt"), other)
    (tmp_path / "go on").touch()
    try:
        assert late.communicate(timeout=60)[1] == 'a.nml: another run is writing into "results/a"\n'
        assert other.poll() is None
    finally:
        late.kill()
        other.kill()


LATE_LOCK = r"""
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdio.h>
#include <unistd.h>
int flock(int fd, int operation)
{
  FILE *opened = fopen("opened", "w");
  if (opened) fclose(opened);
  while (access("go on", F_OK)) usleep(1000);
  return ((int (*)(int, int))dlsym(RTLD_NEXT, "flock"))(fd, operation);
}
"""


@pytest.mark.parametrize("name", ["...nml", "..nml", ".nml"])
def test_names_that_leave_only_dots_keep_their_ending(name, biela, tmp_path):
    (tmp_path / name).write_text(PENDULUM + TRANSIENT)
    subprocess.run([biela, "--quiet", name], cwd=tmp_path, check=True)
    assert {path.name for path in tmp_path.iterdir()} == {name, "results"}
    assert {path.name for path in (tmp_path / "results").iterdir()} == {name}
    assert (tmp_path / "results" / name / "history.txt").exists()


def test_a_path_with_a_blank_at_its_end_is_refused(biela, tmp_path):
    for name in ("a.nml", "a.nml "):
        (tmp_path / name).write_text(PENDULUM + TRANSIENT)
    done = subprocess.run([biela, "a.nml "], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith('biela: the path "a.nml " ends with a blank')
    assert not (tmp_path / "results").exists()


INTERRUPTED_WRITE = r"""
#include <errno.h>
#include <sys/syscall.h>
#include <unistd.h>
ssize_t write(int fd, const void *bytes, size_t count)
{
  static int calls = 0;
  if (fd > 2 && ++calls % 2) { errno = EINTR; return -1; }
  return syscall(SYS_write, fd, bytes, count);
}
"""


def test_an_interrupted_write_is_repeated(biela, tmp_path):
    (tmp_path / "write.c").write_text(INTERRUPTED_WRITE)
    subprocess.run(["gcc", "-shared", "-fPIC", "-o", "write.so", "write.c"], cwd=tmp_path, check=True)
    (tmp_path / "a.nml").write_text(PENDULUM + TRANSIENT)
    for folder, environment in (("plain", {}), ("again", {"LD_PRELOAD": str(tmp_path / "write.so")})):
        subprocess.run([biela, "-o", folder, "a.nml"], cwd=tmp_path, env={**os.environ, **environment}, check=True)
    for name in ("history.txt", "energy.txt"):
        assert (tmp_path / "plain" / name).read_bytes() == (tmp_path / "again" / name).read_bytes()


OWN = """&body name='x' mass=1 inertia=1 /
&history name='h' kind='table' file='{}' interpolation='linear' /
&force name='f' body='x' fx=1 history='h' /
&sensor name='acc' quantity='acceleration' body='x' /
&transient t_end=1 method='rk4' step=1e-2 output_step=0.25 /
"""
ALL = ["static", "modes", "poles", "frequency_response", "floquet", "orbit", "history", "energy", "motion", "events", "summary"]


@pytest.fixture
def here(biela, tmp_path):
    """Return a function that runs a deck, with its results in the folder `out`, and tells status and words."""
    (tmp_path / "out").mkdir()

    def call(deck, *words):
        (tmp_path / "a.nml").write_text(deck)
        command = [biela, "--quiet", "--output", "out", *words, "a.nml"]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        return done.returncode, done.stderr

    return call


def held(folder):
    """Return the files of a folder and what they hold."""
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


@pytest.mark.parametrize("table", ["out/history.txt", "out/../out/summary.txt", "link"])
@pytest.mark.parametrize("made", [False, True])
def test_what_a_run_reads_is_not_replaced(table, made, here, tmp_path):
    """Neither the user's table nor one that biela made, under whatever name the deck has it."""
    target = tmp_path / "out" / ("summary.txt" if "summary" in table else "history.txt")
    target.write_text("# biela: sensors against time\n" * made + "0 100\n1 200\n")
    if table == "link":
        (tmp_path / "link").symlink_to(target)
    before = held(tmp_path / "out")
    status, told = here(OWN.format(table))
    assert status == 2
    assert told == f'a.nml: this run reads "{table.replace("out/../", "")}", which its results would replace; ' + (
        "expected another folder (--output DIR)\n"
    )
    assert held(tmp_path / "out") == before


@pytest.mark.parametrize("name", ["a.csv", "poles.txt"])
def test_what_a_run_reads_is_not_removed(name, here, tmp_path):
    """What was drawn of the former run goes with it, and results of other analyses."""
    (tmp_path / "out" / name).write_text("# biela: poles\n0 100\n1 200\n")
    if name == "a.csv":
        (tmp_path / "out" / ".drawn").write_text("b.csv\na.csv\n")
    status, told = here(OWN.format(f"out/{name}"))
    assert (status, "this run reads" in told) == (2, True)
    assert (tmp_path / "out" / name).exists()


def test_the_deck_itself_is_not_replaced(biela, tmp_path):
    (tmp_path / "history.txt").write_text(PENDULUM + TRANSIENT)
    done = subprocess.run([biela, "-o", ".", "history.txt"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert (tmp_path / "history.txt").read_text() == PENDULUM + TRANSIENT
    done = subprocess.run(f"{biela} -o . - < history.txt", shell=True, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, 'reads "-"' in done.stderr) == (2, True)


def test_files_of_others_stay(here, tmp_path):
    """Those that the run would not write are left alone; where it would write one nothing has changed."""
    (tmp_path / "t.csv").write_text("0 100\n1 200\n")
    written = {"history.txt", "energy.txt", "summary.txt", "summary.json", "history.txt.new1", ".lock"}
    others = {f"{name}.txt" for name in ALL} | {"checkpoint", "poles.txt.new", "mine.txt"}
    for name in sorted(others - written):
        (tmp_path / "out" / name).write_text("mine")
    assert here(OWN.format("t.csv")) == (0, "")
    assert {name for name, text in held(tmp_path / "out").items() if text == b"mine"} == others - written
    for name in sorted(written):
        path = tmp_path / "out" / name
        path.write_text("mine")
        before = held(tmp_path / "out")
        status, told = here(OWN.format("t.csv"))
        assert (status, f'biela has not written "out/{name}"' in told) == (2, True)
        assert held(tmp_path / "out") == before
        path.unlink()
    assert here(OWN.format("t.csv")) == (0, "")


def test_what_a_former_run_left_goes(here, tmp_path):
    """Also what only other analyses write, such as poles."""
    (tmp_path / "t.csv").write_text("0 100\n1 200\n")
    for name in ALL[:6]:
        (tmp_path / "out" / f"{name}.txt").write_text("# biela: of a former run\n")
    assert here(OWN.format("t.csv")) == (0, "")
    assert sorted(held(tmp_path / "out")) == ["energy.txt", "history.txt", "summary.json", "summary.txt"]


def test_a_checkpoint_of_others_is_not_replaced(here, tmp_path):
    (tmp_path / "t.csv").write_text("0 100\n1 200\n")
    path = tmp_path / "out" / "checkpoint"
    path.write_text("mine")
    status, told = here(OWN.format("t.csv").replace("output_step", "checkpoint_interval=0.5 output_step"))
    assert (status, f'"out/{path.name}"' in told) == (2, True)
    assert path.read_text() == "mine"
