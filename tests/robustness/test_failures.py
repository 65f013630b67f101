"""Runs that cannot go on: exit status, what is said, and what is on the disk."""

from __future__ import annotations

import re
import resource
import signal
import subprocess

import numpy as np
import pytest
from failing_scenes import CRANK, PULL, failed

ARM = """&material name='m' density=2700.0 young=7.0e10 /
&section name='s' shape='rectangle' width=0.02 height=0.01 /
&body name='quiet' kind='beam' length=1.0 elements=2 material='m' section='s' position=3.0,0.0 /
&body name='arm' kind='beam' length=1.0 elements=4 material='m' section='s' reference='clamped' angular_velocity=100.0 /
&joint name='hub' type='revolute' body_a='arm' node_a=1 /
&joint name='pin' type='revolute' body_a='quiet' node_a=1 point_b=3.0,0.0 /
&history name='w' kind='polynomial' coefficients=100.0 /
&drive name='motor' type='rotation' body_a='arm' history='w' rate=.true. /
&force name='f' type='force' body='arm' node=-1 fy=1.0 /
&sensor name='tip' quantity='deflection' body='arm' node=-1 /
"""


@pytest.mark.parametrize("step", [3.6e-5, 1e-4, 1e-3])
def test_an_unstable_step(step, run_deck):
    text = f"&transient t_end=0.02 method='rk4' step={step} output_step=1e-3 accept_unstable=.true. /\n"
    run, told = failed(run_deck, CRANK + text)
    if "cannot be kept closed" not in told:
        assert "the solution diverged" in told
        assert 'body "rod"' in told
        assert "try a smaller one (biela --check tells the stable ones)" in told
    assert "the step is too large" in told
    energy = run.energy
    assert np.abs(energy["residual"]).max() <= 1e3 * max(1.0, np.abs(energy["work"]).max())


def test_an_unstable_step_between_two_rows(run_deck):
    """Values are watched at every stage: no overflow, also in the checked build, however far apart rows are."""
    _, told = failed(run_deck, CRANK + "&transient t_end=1.0 method='rk4' step=5e-4 output_step=1.0 accept_unstable=.true. /\n")
    assert 'body "rod" grow' in told
    _, told = failed(run_deck, CRANK + "&transient t_end=1.0 method='dopri5' step=1e-4 output_step=1.0 accept_unstable=.true. /\n")
    assert 'body "rod" grow' in told


@pytest.mark.parametrize("method", ["'rk4' step=1e-4", "'dopri5' step=1e-4", "'dopri5' tolerance=1e-8"])
def test_a_drive_that_demands_the_impossible(method, run_deck):
    _, told = failed(run_deck, PULL + f"&transient t_end=0.1 method={method} output_step=1e-3 /\n")
    names = "(o|pull)" if "tolerance" in method else "pull"  # by tolerance both are open by as little
    assert re.search(rf'the joints cannot be kept closed after t = \S+ s: "{names}" opens most', told)
    assert float(re.search(r" t = (\S+) s", told)[1]) == pytest.approx(0.05, abs=2e-4)
    assert "elsewhere" not in told


@pytest.mark.parametrize("method", ["'rk4' step=1e-4", "'dopri5' tolerance=1e-8"])
def test_joints_that_drift_apart(method, run_deck):
    text = f"&transient t_end=0.1 method={method} output_step=1e-3 stabilization='none' /\n"
    run, told = failed(run_deck, PULL + text)
    assert "the joints have drifted apart" in told or "the solution diverged" in told or "the step became too small" in told
    assert run.energy["position_violation"].max() < 0.01 * 5.0


WOUND = """&body name='b' mass=0.07 inertia=0.01 angular_velocity=1e-9 /
&spring name='k' type='torsional' body_a='b' stiffness=8e3 free_angle=70 /
&spring name='l' type='torsional' body_a='b' stiffness=8e3 free_angle=-70 /
&transient t_end=1e5 output_step=1e5 method='dopri5' tolerance=1e-12 /
"""


def test_a_step_that_rounding_makes_too_small(run_deck):
    """Moments of 5.6e5 N m cancel on a body that hardly moves."""
    _, told = failed(run_deck, WOUND)
    assert "the step became too small" in told
    assert "rounding may set the estimated error (large values that cancel" in told


def test_a_step_that_becomes_too_small(run_deck):
    """Accelerations grow without bound where the drive reaches the end of the arm: no step keeps the tolerance there."""
    text = "&transient t_end=0.1 method='dopri5' tolerance=1e-8 output_step=1e-3 stabilization='none' /\n"
    _, told = failed(run_deck, PULL + text)
    assert re.search(r"the step became too small at t = 5\.0000\d+E-02 s: the tolerance cannot be kept", told)
    assert "the motion may be singular there" in told
    assert 'the coordinates of body "a" grow most' in told
    assert re.search(r'the largest reactions are those of ("pull" "o"|"o" "pull")', told)
    assert "or try a larger tolerance" in told
    assert "elsewhere" not in told


IMPLICIT = ["'radau' tolerance=1e-6", "'generalized_alpha' step=1e-3"]


@pytest.mark.parametrize("method", ["'dopri5' tolerance=1e-6", "'rk4' step=1e-3", "'dopri5' step=1e-3", *IMPLICIT])
def test_loads_beyond_all_numbers(method, run_deck):
    """A load that grows to 1e59 N: values beyond 1e40 are never used, and nothing of them reaches a file."""
    load = "&history name='h' kind='polynomial' coefficients=0,0,0,0,0,0,0,0,1.0e59 /\n&force name='f' type='force' body='b' "
    scene = PULL[: PULL.index("&history")] + load + "fx=1.0 history='h' /\n"
    scene = scene.replace("&joint name='elsewhere' type='revolute' body_a='b' point_b=5.0,0.0 /\n", "")
    scene += "&sensor name='b' quantity='position' body='b' /\n"
    _, told = failed(run_deck, scene + f"&transient t_end=1.0 method={method} output_step=1e-2 /\n")
    assert re.search(r'the solution diverged at t = \S+ s, the coordinates of body "b" grow most', told)
    assert ("check the loads" if "tolerance" in method else "try a smaller one") in told


@pytest.mark.parametrize("method", ["'dopri5' tolerance=1e-6", "'rk4' step=2e-6"])
def test_a_motion_that_grows_without_bound(method, run_deck):
    """A beam without stiffening that spins at twice its first frequency."""
    _, told = failed(run_deck, ARM + f"&transient t_end=10.0 method={method} output_step=1e-2 /\n")
    assert 'body "arm" deflects by more than a thousand times' in told
    assert "stiffening=.true." in told


HISTORY_LIMIT = 20000


def test_a_full_disk(biela, tmp_path):
    """A limit on the size of files stands for it: status 3, whole rows, and with space again the run continues."""
    text = CRANK + "&transient t_end=0.01 method='rk4' step=4e-6 output_step=4e-6 checkpoint_interval=1e-4 /\n"
    (tmp_path / "scene.nml").write_text(text)

    def limited():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (HISTORY_LIMIT, HISTORY_LIMIT))

    command = [str(biela), "--quiet", "scene.nml"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, preexec_fn=limited)
    assert done.returncode == 3
    assert 'results cannot be written into "results/scene"' in done.stderr
    folder = tmp_path / "results" / "scene"
    rows = (folder / "history.txt").read_bytes()
    assert len(rows) <= HISTORY_LIMIT
    assert rows.endswith(b"\n")
    assert np.loadtxt(folder / "history.txt").shape[1] == 3
    command.insert(1, "--restart")
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0
    assert np.loadtxt(folder / "history.txt").shape == (2501, 3)


def test_a_folder_that_cannot_be_made(biela, tmp_path):
    (tmp_path / "scene.nml").write_text(CRANK + "&transient t_end=1e-4 step=4e-6 /\n")
    (tmp_path / "results").write_text("a file in the way")
    done = subprocess.run([str(biela), "scene.nml"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 3
    assert 'results cannot be written into "results/scene"' in done.stderr
    assert (tmp_path / "results").read_text() == "a file in the way"


def test_a_result_file_that_cannot_be_replaced(run_deck, tmp_path):
    (tmp_path / "results" / "scene" / "energy.txt").mkdir(parents=True)
    run = run_deck(CRANK + "&transient t_end=1e-4 step=4e-6 /\n", expect=3)
    assert "results cannot be written" in run.stderr
    assert list((run.folder / "energy.txt").iterdir()) == []


PENDULUM = """&scene gravity=0.0,-9.81 /
&material name='m' density=1500.0 young=2.0e8 /
&section name='s' shape='rectangle' width=0.02 height=0.02 /
&body name='arm' kind='beam' length=1.0 elements=1 material='m' section='s' angle=-1.0 /
&joint name='pin' type='revolute' body_a='arm' node_a=1 /
&sensor name='tip' quantity='position' body='arm' node=-1 /
&transient t_end={t_end} method='rk4' step={step} output_step={output} /
"""


def test_a_flexible_pendulum_for_many_steps(run_deck):
    """Over 250,000 steps the joint stays closed to 1e-12 of the size; the energy residual falls with the method's order."""
    size = 1.0
    energy = run_deck(PENDULUM.format(t_end=50.0, step=2e-4, output=0.02)).energy
    assert energy["position_violation"].max() < 1e-12 * size
    assert np.abs(energy["residual"]).max() < 1e-6 * np.abs(energy["potential"]).max()
    coarse, fine = (
        np.abs(run_deck(PENDULUM.format(t_end=4.0, step=step, output=0.02), name="short").energy["residual"]).max()
        for step in (2e-4, 1e-4)
    )
    assert 3.5 < np.log2(coarse / fine) < 5.5


def test_the_summary_says_how_far_the_energy_balance_closed(run_deck):
    """Over the largest swing of an energy, from the rows themselves."""
    run = run_deck(CRANK + "&transient t_end=0.01 method='rk4' step=4e-6 output_step=1e-4 /\n")
    energy = run.energy
    share = np.abs(energy["residual"]).max() / max(np.ptp(energy[n]) for n in ("kinetic", "potential", "dissipated", "work"))
    assert run.transient["energy_balance"] == pytest.approx(share, rel=1e-6)


@pytest.mark.parametrize(("step", "warned"), [(0.05, False), (0.2, True)])
def test_a_coarse_run_is_called_so(step, warned, run_deck):
    """Once in the summary and once on standard error; the run has ended well all the same."""
    pendulum = PENDULUM.replace("elements=1", "elements=1 flexible=.false.")
    run = run_deck(pendulum.format(t_end=20.0, step=step, output=step))
    for told in (run.summary, run.stderr):
        assert told.count("the results cannot be trusted") == warned


def test_joints_that_drift_apart_end_the_run(run_deck):
    """Two pendulums without projection: the pin between them opens by a hundredth of the scene's size within seconds."""
    deck = """&scene gravity=0.0,-9.81 /
&body name='a' mass=1.0 inertia=0.01 com=0.5,0.0 /
&body name='b' mass=1.0 inertia=0.01 com=0.5,0.0 position=1.0,0.0 /
&joint name='j' type='revolute' body_a='a' /
&joint name='k' type='revolute' body_a='b' body_b='a' point_b=1.0,0.0 /
&transient t_end=20.0 method='rk4' step=0.02 output_step=1.0 stabilization='none' /
"""
    run, told = failed(run_deck, deck)
    assert 'the joints have drifted apart by t = 5.000000E+00 s: "k" opens most, by ' in told
    assert 8e-3 < run.transient["position_violation_of_size"] < 1e-2
    assert run.history["t"][-1] == 4.0


def test_a_singular_start_is_told_and_no_drive_is_spoken_of(run_deck):
    """A parallelogram that lies flat, its crank's speed stated: the change point leaves open how it goes on; nothing drives it."""
    deck = """&body name='c' mass=1 inertia=0.1 angle=0 angular_velocity=2 /
&body name='l' mass=1 inertia=0.1 position=1,0 angle=0 /
&body name='r' mass=1 inertia=0.1 position=2,0 angle=0 /
&joint name='A' type='revolute' body_a='c' /
&joint name='B' type='revolute' body_a='l' body_b='c' point_b=1,0 /
&joint name='C' type='revolute' body_a='l' point_a=2,0 body_b='r' point_b=1,0 /
&joint name='D' type='revolute' body_a='r' point_b=2,0 /
&transient t_end=2 method='dopri5' tolerance=1e-9 output_step=0.1 /
"""
    told = run_deck(deck, expect=1).stderr
    assert 'the start is a singular position of joints "A" "B" "C" "D"' in told
    assert "drive" not in told
