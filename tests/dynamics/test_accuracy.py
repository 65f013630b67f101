"""What the summary says of a run's accuracy is true: its energy balance, the estimated errors of columns, its silence otherwise."""

from __future__ import annotations

import json
import re
import signal
import subprocess

import numpy as np
import pytest
from conftest import TIMEOUT, Run, wait_for
from random_scenes import scene

PENDULUM = """&scene gravity=0.0,-9.81 /
&body name='p' kind='rigid' mass=1.0 inertia=0.02 com=0.5,0.0 position=0.0,{y} /
&joint name='o' type='revolute' body_a='p' point_b=0.0,{y} /
&sensor name='a' quantity='angle' body='p' /
&transient t_end=5.0 method='rk4' step=0.05 /
"""
CANTILEVER = """&material name='m' density=2700.0 young=7.0e10 /
&section name='s' shape='rectangle' width=0.02 height=0.005 /
&body name='b' kind='beam' length=0.5 elements=2 material='m' section='s' reference='clamped' axial=.false. /
&joint name='w' type='weld' body_a='b' node_a=1 /
&force name='f' type='force' body='b' node=-1 fy=5.0 /
&sensor name='tip' quantity='deflection' body='b' node=-1 /
"""
FLYWHEEL = """&body name='wheel' kind='rigid' mass=50.0 inertia=5.0 position=2.0,0.0 angular_velocity=100.0 /
&joint name='p' type='revolute' body_a='wheel' point_b=2.0,0.0 /
&force name='t' type='torque' body='wheel' moment=50.0 /
"""
COARSE = "&transient t_end=0.2 method='generalized_alpha' step=5.0e-3 {} /\n"
CRANK = """&material name='m' density=1600.0 young=2.1e10 /
&section name='s' area=1.6129e-4 inertia=8.6576e-9 /
&body name='rod' kind='beam' length=0.3492 elements=2 material='m' section='s' position=0.1524,0.0 /
&joint name='c' type='distance' body_a='rod' node_a=1 point_b=0.0,0.0 length=0.1524 /
&joint name='d' type='slider' body_a='rod' node_a=-1 direction=0.0 /
&force name='t' type='torque_about' body='rod' node=1 centre=0.0,0.0 moment=9.0 /
&sensor name='pin' quantity='position' body='rod' node=1 /
"""


def share(run: Run) -> float:
    """Return how far the energy balance closed, of the energy that moved."""
    return run.transient["energy_balance"]


def body_share(run: Run) -> float:
    """Return how far it closed, of what a body's deformation exchanged."""
    return float(re.search(r"closed to (\S+) of what the deformation of body \"b\" took up", run.summary)[1])


def estimates(run: Run) -> dict[str, tuple[float, float | None]]:
    """Return the estimated error of each column and its share of the range; None where the column is constant."""
    table = re.search(r"    column, largest error, of its range\n((?:    .*\n)+?)(?=  \S)", run.summary)[1]
    found = {}
    for line in table.splitlines():
        name, error, part = line.split(maxsplit=2)
        found[name.split("[")[0]] = (float(error), None if "constant" in part else float(part.split(",")[0]))
    return found


@pytest.mark.parametrize("y", [1.0, 1.0e4, -1.0e6])
def test_the_balance_does_not_depend_on_where_the_scene_stands(run_deck, y):
    low, high = (share(run_deck(PENDULUM.format(y=at), name=f"p{k}")) for k, at in enumerate((0.0, y)))
    assert low > 1e-5
    assert high == pytest.approx(low, rel=0.1)


def test_a_flywheel_beside_it_does_not_make_a_vibration_better(run_deck):
    alone, beside = (run_deck(CANTILEVER + more + COARSE.format(""), name=name) for more, name in (("", "a"), (FLYWHEEL, "b")))
    assert share(beside) < 0.01 * share(alone)
    assert body_share(beside) == pytest.approx(body_share(alone), rel=0.3)
    exact = run_deck(CANTILEVER + "&transient t_end=0.2 method='dopri5' tolerance=1e-6 output_step=5.0e-3 /\n", name="exact")
    checked = run_deck(CANTILEVER + FLYWHEEL + COARSE.format("check_error=.true."), name="c")
    for run in (alone, beside, checked):
        off = np.abs(run.history["tip.v"] - exact.history["tip.v"]).max() / np.ptp(exact.history["tip.v"])
        assert off > 0.2
        assert "trusted" not in run.summary.replace("cannot be trusted", "")
        assert "exact" not in run.summary.split("deck text")[0].replace("exact 0", "")
    assert "the energy balance does not bound errors of columns" in beside.summary
    assert estimates(checked)["tip.v"][1] > 0.2
    warnings = re.findall(r"warning: \d of 3 columns err by more than 1.0E-02 of their range", checked.stderr)
    assert len(warnings) == 1
    assert checked.status == 0


def test_nothing_is_said_of_a_run_that_was_lost(run_deck):
    text = CRANK + "&transient t_end=1.0 method='rk4' step=5e-4 output_step=1.0 accept_unstable=.true. {} /\n"
    told = set()
    for more in ("", "check_error=.true."):
        run = run_deck(text.format(more), expect=None)
        told.add(run.stderr)
        assert run.status == 1
        assert "accuracy: unknown, the run failed" in run.summary
        assert "energy balance: closed" not in run.summary
        assert "errs by" not in run.summary
    assert len(told) == 1  # no second run is made
    mass = "&body name='b' mass=1.0 inertia=1.0 velocity=1.0,0.0 /\n&joint name='j' type='prismatic' body_a='b' /\n"
    mass += "&spring name='s' type='linear' body_a='b' point_b=-1.0,0.0 stiffness=1e4 free_length=1.0 /\n&transient t_end=3.0 "
    mass += "method='rk4' step=0.032 output_step=0.032 accept_unstable=.true. checkpoint_interval=1e-9 /\n"
    told = [run_deck(mass, *options, expect=1, name="mass").stderr for options in ([], ["--restart"])]
    assert "where energies were up to 5.000000E-01 J" in told[1]  # those before the checkpoint, too
    assert told[1] == told[0]


@pytest.mark.parametrize("method", ["rk4", "dopri5", "generalized_alpha"])
def test_estimates_of_resolved_motion_are_the_errors(run_deck, method):
    """Where the order shows: within a few per cent; an odd number of steps in an interval makes no difference."""
    swing = PENDULUM.format(y=0.0).split("&transient")[0] + "&transient t_end=2.0 output_step=0.03 check_error=.true. {} /\n"
    exact = run_deck(swing.format("method='dopri5' tolerance=1e-13"), name="exact").history
    for step in (0.01, 0.03):
        run = run_deck(swing.format(f"method='{method}' step={step}"))
        assert estimates(run)["a"][0] == pytest.approx(np.abs(run.history["a"] - exact["a"]).max(), rel=0.1)


def test_the_second_run_shortens_max_step(run_deck):
    """Steps that it sets do not know the tolerance: two runs would err alike."""
    swing = PENDULUM.format(y=0.0).split("&transient")[0] + "&transient t_end=2.0 output_step=0.5 method='radau' {} /\n"
    run = run_deck(swing.format("tolerance=0.1 max_step=0.1 check_error=.true."))
    exact = run_deck(swing.format("tolerance=1e-11"), name="exact")
    assert run.transient["longest_step"] == pytest.approx(0.1, rel=1e-9)
    off = np.abs(run.history["a"] - exact.history["a"]).max()
    assert estimates(run)["a"][0] == pytest.approx(4 / 3 * off, rel=0.1)


def test_estimates_of_modal_coordinates_are_the_errors(run_deck):
    """In the units of mass-orthonormal shapes; what a straight bar does is rounding, and not a share of its range."""
    deck = CANTILEVER.replace("axial=.false.", "modes=2")
    deck += "&body name='c' kind='beam' length=0.4 elements=2 material='m' section='s' modes=1 position=1.0,0.0 velocity=0,1 /\n"
    for name, body, index in (("q", "b", 1), ("p", "b", 2), ("r", "c", 1)):
        deck += f"&sensor name='{name}' quantity='coordinate' body='{body}' index={index} /\n"
    deck += "&transient t_end=0.02 output_step=1e-3 {} /\n"
    exact = run_deck(deck.format("method='dopri5' tolerance=1e-11"), name="exact").history
    run = run_deck(deck.format("method='generalized_alpha' step=5e-5 check_error=.true."))
    found = estimates(run)
    for name in ("q.q", "q.qd", "p.q"):
        off = np.abs(run.history[name] - exact[name]).max()
        assert found[name][0] == pytest.approx(off, rel=0.1)
        assert found[name][1] == pytest.approx(off / np.ptp(exact[name]), rel=0.1)
    assert found["r.q"][1] is None


WAYS = {
    "rk4 at 0.9 of the bound": "method='rk4' step={rk4!r}",
    "coarse generalized_alpha": "method='generalized_alpha' step={row!r}",
    "loose radau": "method='radau' tolerance=1e-3",
    "loose dopri5": "method='dopri5' tolerance=1e-4",
}
SEED = 1


@pytest.mark.parametrize("number", [0, 2, 7, 34])
def test_random_scenes_no_column_errs_by_ten_times_its_estimate(run_deck, biela, tmp_path, number):
    """And the rows are those of the run without the check, to the last bit."""
    drawn = scene(SEED, number)
    print(f"seed {SEED}/{number}")
    (tmp_path / "bound.nml").write_text(drawn.text + "&transient t_end=1.0 step=1e-9 /\n")
    told = subprocess.run([biela, "--check", "bound.nml"], cwd=tmp_path, capture_output=True, text=True, check=True).stdout
    found = re.search(r"rk4: safe bound\s+(\S+) s", told)
    bound = float(found[1]) if found else 1.0  # rigid bodies only
    time = min(drawn.time, 1000 * bound)
    row = time / 100
    transient = "&transient t_end=" + repr(time) + " output_step=" + repr(row) + " {} {} /\n"
    exact = [drawn.text + transient.format(f"method='dopri5' tolerance={t}", "") for t in (1e-10, 1e-12)]
    truths = [run_deck(deck, name="truth").history for deck in exact]
    for way in WAYS.values():
        words = way.format(rk4=min(0.9 * bound, row), row=row)
        run = run_deck(drawn.text + transient.format(words, "check_error=.true."))
        told, seen = estimates(run), 0
        for name, (error, part) in told.items():
            true = np.abs(run.history[name] - truths[1][name]).max()
            unsure = np.abs(truths[0][name] - truths[1][name]).max()
            if part is None or unsure > 0.1 * true or true < 1e-8 * np.ptp(truths[1][name]):
                continue
            seen += 1
            assert true < 10 * error, (words, name)
        assert seen > 0 or "dopri5" in words
        assert ("columns err by more than" in run.stderr) == (max(p or 0.0 for _, p in told.values()) > 0.01)
        plain = run_deck(drawn.text + transient.format(words, ""), name="plain")
        rows = [(r.folder / "history.txt").read_text().split("# columns:")[1] for r in (plain, run)]
        assert rows[0] == rows[1]


def test_estimates_are_doubted_where_both_runs_damp_a_vibration_between_rows(run_deck):
    """An axial wave that a spectral radius of 0 removes within a row: both runs agree, and both are wrong."""
    beam = CANTILEVER.replace("axial=.false.", "").replace("fy=5.0", "fx=500.0 fy=5.0")
    text = beam + "&transient t_end=0.024 {} output_step=4.8e-3 {} /\n"
    run = run_deck(text.format("method='generalized_alpha' step=4e-4 spectral_radius=0.0", "check_error=.true."))
    exact = run_deck(text.format("method='dopri5' tolerance=1e-8", ""), name="exact").history
    assert np.abs(run.history["tip.u"] - exact["tip.u"]).max() > 100 * estimates(run)["tip.u"][0]
    assert run.stderr.count("the energy balance of the second run closes hardly better") == 1
    assert "accuracy: unknown" in run.summary
    assert "errs by" not in run.summary


def test_redundant_joints_are_told_once_on_standard_error(run_deck):
    door = "&body name='d' kind='rigid' mass=1.0 inertia=0.1 com=0.4,0.0 /\n"
    hinges = "".join(f"&joint name='h{k}' type='revolute' body_a='d' /\n" for k in (1, 2))
    run = run_deck("&scene gravity=0.0,-9.81 /\n" + door + hinges + "&transient t_end=0.1 method='rk4' step=1e-3 /\n")
    told = 'warning: redundant constraints at the start among "h1" "h2"; the reactions of these joints are not determined'
    assert run.stderr.count(told) == 1
    assert run.status == 0


LONG = "&transient t_end=100.0 method='rk4' step=4e-6 output_step=1e-3 /\n"


def test_a_killed_rerun_does_not_read_done(run_deck, biela, tmp_path):
    """Nor does anything of the earlier run stand beside its summary."""
    old = run_deck(CRANK + "&modal modes=2 /\n&transient t_end=1e-3 method='rk4' step=4e-6 motion_step=1e-4 /\n")
    assert "outcome: done" in old.summary
    assert {"modes.txt", "motion.txt", "history.txt"} <= {path.name for path in old.folder.iterdir()}
    (old.folder / "notes.txt").write_text("mine")
    for name in ("history.txt", "energy.txt"):  # which the new run opens one after the other
        (old.folder / name).unlink()
    (tmp_path / "scene.nml").write_text(CRANK.replace("0.1524,0.0 /", "0.1524,0.0 /  ! changed") + LONG)
    process = subprocess.Popen([biela, "--quiet", "scene.nml"], cwd=tmp_path)
    for name in ("history.txt", "energy.txt"):
        wait_for(old.folder / name, process)
    summary = old.summary
    process.send_signal(signal.SIGKILL)
    process.wait(timeout=TIMEOUT)
    for text in (summary, old.summary):
        assert "outcome: running" in text
        assert "done" not in text
        assert "! changed" in text
    found = {path.name for path in old.folder.iterdir() if not path.name.startswith(".")}
    assert found - {"checkpoint"} == {"summary.txt", "summary.json", "history.txt", "energy.txt", "notes.txt"}


def test_an_interrupted_run_reads_interrupted_and_running_while_it_goes_on(biela, tmp_path):
    (tmp_path / "scene.nml").write_text(CRANK + LONG)
    folder = tmp_path / "results" / "scene"
    for options in ([], ["--restart"]):
        process = subprocess.Popen([biela, "--quiet", *options, "scene.nml"], cwd=tmp_path, stderr=subprocess.DEVNULL)
        if options:
            while "outcome: running" not in (folder / "summary.txt").read_text():
                assert process.poll() is None
        else:
            wait_for(folder / "energy.txt", process)
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=TIMEOUT) == 128 + signal.SIGINT
        assert "outcome: stopped by signal" in (folder / "summary.txt").read_text()


def test_where_no_energy_moves_its_rounding_casts_no_doubt(run_deck):
    """A flywheel that turns about its centre of mass: the estimate stands, although the residual does not converge."""
    run = run_deck(
        """&scene gravity=0.0,-9.81 /
&body name='a' kind='rigid' mass=1.0 inertia=0.1 com=0.5,0.3 angle=0.3 angular_velocity=1.0 /
&joint name='w' type='revolute' body_a='a' point_a=0.5,0.3 point_b=0.3890,0.4344 /
&sensor name='v' quantity='velocity' body='a' point=0.5,0.0 /
&transient t_end=1.0 method='rk4' step=1.0e-2 output_step=0.1 check_error=.true. /
"""
    )
    assert run.stderr == ""
    assert float(re.search(r"closed to (\S+) of the kinetic energy, which is constant", run.summary)[1]) < 1e-13
    assert "  accuracy: the worst column, " in run.summary


@pytest.mark.parametrize(("step", "warned"), [(0.005, False), (0.1, False), (0.9, True)])
def test_kinetic_energy_alone_is_compared_with_all_of_it(run_deck, step, warned):
    """A bob that circles at 2 rad/s in steps of rk4: its kinetic energy falls by an error, and nothing else moves."""
    run = run_deck(
        f"""&scene gravity=0.0,0.0 /
&body name='a' kind='rigid' mass=1.0 inertia=0.1 position=1.0,0.0 velocity=0.0,2.0 angular_velocity=2.0 /
&joint name='l' type='distance' body_a='a' length=1.0 /
&transient t_end=9.0 method='rk4' step={step} /
"""
    )
    residual, kinetic = run.energy["residual"], run.energy["kinetic"]
    share = float(re.search(r"closed to (\S+) of the kinetic energy, which is constant", run.summary)[1])
    assert share == pytest.approx(abs(residual).max() / kinetic.max(), rel=0.06)
    assert ("off by" in run.stderr and "of the kinetic energy, which is constant: the results cannot" in run.stderr) == warned


TURN = """&body name='b' kind='rigid' mass=1.0 inertia=0.1 com=0.2,0.0 /
&joint name='j' type='revolute' body_a='b' /
&history name='w' kind='polynomial' coefficients=0.0,1.5 /
&drive name='d' type='rotation' body_a='b' history='w' /
&body name='p' kind='rigid' mass=0.5 inertia=0.01 position={x!r},0.0 angular_velocity=1.5 /
&joint name='e' type='slider' body_a='p' body_b='b' direction=0.0 /
&spring name='k' type='linear' body_a='p' body_b='b' stiffness=10.0 damping={damping} free_length=0.4 /
&sensor name='x' quantity='spring' spring='k' /
&transient t_end={end} method='radau' step={step} output_step=1.0 /
"""
STEADY = 0.4507042253521127


def test_a_steady_turn_is_held_against_the_energy_that_turns(run_deck):
    """The drive feeds what the method removes, 5e-8 J, which is all that swings, but for 1 J that goes from x to y and back."""
    run = run_deck(TURN.format(x=STEADY, damping=0.5, end=200, step=0.05))
    share = json.loads((run.folder / "summary.json").read_text())["transient"]["energy_balance"]
    assert 1e-8 < share < 1e-6
    assert "cannot be trusted" not in run.stderr
    assert np.abs(run.history["x.d"] - (STEADY - 0.4)).max() < 1e-9
    swinging = run_deck(TURN.format(x=1.0, damping=0.0, end=200, step=0.5))  # a vibration that these steps damp away
    assert "the results cannot be trusted" in swinging.stderr


def test_the_balance_is_the_same_in_a_vehicle(run_deck):
    """Two bodies on a spring turn about their mass centre, at rest or at 300 m/s: the same part of the same energy."""
    deck = """&body name='a' mass=1.0 inertia=0.1 velocity={0},-1.0 /
&body name='b' mass=2.0 inertia=0.1 position=1.0,0.0 velocity={0},0.5 /
&spring name='k' type='linear' body_a='a' body_b='b' stiffness=100.0 /
&transient t_end=3.0 method='rk4' step=0.02 output_step=0.1 /
"""
    runs = [run_deck(deck.format(speed), name=f"at_{speed}") for speed in (0, 300)]
    shares = [json.loads((run.folder / "summary.json").read_text())["transient"]["energy_balance"] for run in runs]
    assert shares[1] == pytest.approx(shares[0], rel=1e-2)
