"""Analyses that linear algebra could refuse: scenes without a free coordinate, too many modes, a wrong argument."""

import os
import subprocess

import pytest
from biela.histories import read
from conftest import preloaded

CRANK = """&body name='b' kind='rigid' mass=0.08 inertia=0.0014 com=0.1,0.0 /
&joint name='j' type='revolute' body_a='b' /
&sensor name='r' quantity='reaction' joint='j' /
"""
DRIVE = """&history name='w' kind='polynomial' coefficients=0.3,{speed} /
&drive name='d' type='rotation' body_a='b' history='w' {ghm} /
&force name='f' type='force' body='b' point=0.1,0.0 fy=1.0 /
"""
SPRING = "&spring name='k' type='torsional' body_a='b' stiffness=6.13 /\n"
RESPONSE = "&frequency_response from=1.0 to=10.0 points=5 input='{name}' /\n"


@pytest.mark.parametrize("speed", [0.0, 20.0])
@pytest.mark.parametrize("name", ["f", "d"])
def test_a_scene_without_a_free_coordinate_has_no_modes_but_a_response(run_deck, speed, name):
    """The response of the reaction to the force is its share at the joint: no dynamics is left."""
    run = run_deck(CRANK + DRIVE.format(speed=speed, ghm="") + "&modal /\n" + RESPONSE.format(name=name))
    assert all(line.startswith("#") for line in (run.folder / "modes.txt").read_text(encoding="utf-8").splitlines())
    assert "outcome: done" in run.summary
    response = read(run.folder, "frequency_response")
    if name == "f":
        assert response["r.fx.amplitude"] ** 2 + response["r.fy.amplitude"] ** 2 == pytest.approx(1.0, rel=1e-12)
    else:  # m r w^2 at rest
        reaction = (response["r.fx.re"] ** 2 + response["r.fy.re"] ** 2) ** 0.5
        if speed == 0.0:
            assert reaction == pytest.approx(0.08 * 0.1 * (2 * 3.141592653589793 * response["f"]) ** 2, rel=1e-12)


def test_more_modes_than_fit_into_an_integer_are_those_that_there_are(run_deck):
    run = run_deck(CRANK + SPRING + "&modal modes=2147483640 /\n")
    assert len(read(run.folder, "modes")["mode"]) == 1
    assert "only 1 degrees of freedom for 2147483640 modes" in run.summary


def test_a_refused_argument_fails_the_deck_not_the_run(biela, tmp_path):
    """LAPACK would end the program with status 0: a summary says why instead, the lock goes, other decks run."""
    library = preloaded("refuse", tmp_path)
    (tmp_path / "one.nml").write_text(CRANK + SPRING + "&modal /\n", encoding="utf-8")
    (tmp_path / "two.nml").write_text(CRANK + DRIVE.format(speed=1.0, ghm="") + RESPONSE.format(name="f"), encoding="utf-8")
    done = subprocess.run(
        [str(biela), "one.nml", "two.nml"],
        cwd=tmp_path,
        env={**os.environ, "LD_PRELOAD": str(library)},
        capture_output=True,
        text=True,
        check=False,
    )
    if "DGEQP3" not in done.stderr and done.returncode == 0:
        pytest.skip("libraries are not preloaded here")
    assert done.returncode == 1
    assert "one.nml: the linear algebra library refuses a matrix (DGEQP3, argument 8)" in done.stderr
    assert "DGEQP3" in (tmp_path / "results/one/summary.txt").read_text(encoding="utf-8")
    assert not (tmp_path / "results/one/.lock").exists()
    assert "outcome: done" in (tmp_path / "results/two/summary.txt").read_text(encoding="utf-8")


def test_threaded_linear_algebra_is_told_to_use_one_thread(biela, tmp_path):
    """Sums of several threads differ from run to run."""
    (tmp_path / "one.nml").write_text(CRANK + SPRING + "&modal /\n", encoding="utf-8")
    environment = {**os.environ, "LD_PRELOAD": str(preloaded("threads", tmp_path))}
    done = subprocess.run([str(biela), "one.nml"], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0
    assert "threads: 1\n" in done.stdout
