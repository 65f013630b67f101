"""post/tradeoff.py: what it recommends holds against references that it never saw; its edits keep the deck's words."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from biela import deck_models, deck_runs, deck_text, tradeoff_picture
from biela.compare import differences
from biela.deck_runs import Outcome
from biela.histories import Event, History, read
from biela.programs import tradeoff as tradeoff_command
from biela.tradeoff_curves import Curve, uncertainty_of
from biela.tradeoff_errors import Compared, error_of, truth_of
from conftest import REFERENCE, ROOT
from oracle import Scene
from scipy.integrate import solve_ivp
from studies import ARGUMENT
from tool_calls import call

TOOL = ROOT / "post" / "tradeoff.py"
CRANK = REFERENCE / "vrl_ghm" / "deck.nml"
SOME = ("rk4", "generalized_alpha")
AT_LEISURE = ("--quiet", "--time", "1e5", "--longest-run", "1e5")  # a study ends by itself, however busy the machine


@pytest.fixture
def study(biela: Path, tmp_path: Path, monkeypatch):
    """Return a function that runs the tool on a deck: (folder, stdout, stderr); it draws only where a picture is asked for."""

    def run(deck: Path, *options: str, status: int = 0, picture: bool = False) -> tuple[Path, str, str]:
        if not picture:
            monkeypatch.setattr(tradeoff_picture, "draw", lambda *_: None)
        words = [deck, *options, "--biela", biela, "--output", "study", *AT_LEISURE]
        done = call(tradeoff_command.main, *words, cwd=tmp_path)
        assert done.returncode == status, done.stdout + done.stderr
        return tmp_path / "study", done.stdout, done.stderr

    return run


def shortened(deck: Path, folder: Path, t_end: str) -> Path:
    """Return the path of a copy of a deck that ends earlier."""
    text = deck_text.read(deck)
    (folder / "deck.nml").write_text(text.set(text.one("transient"), t_end=t_end).text)
    return folder / "deck.nml"


def beginning(history: History, rows: int) -> History:
    """Return the first rows of a history."""
    return replace(history, data=history.data[:rows])


def promised(folder: Path) -> tuple[float, float, float]:
    """Return error, speed-up in seconds and in counts from the head of recommended.nml; 1 where the deck as written is kept."""
    words = " ".join(line.lstrip("! ") for line in (folder / "recommended.nml").read_text().splitlines() if line.startswith("!"))
    error = re.search(r"[Ii]ts error is ([\d.e+-]+) ", words)
    if "keep it." in words:
        return float(error[1]), 1.0, 1.0
    speed = re.search(r"speed-up is ([\d.e+-]+) in seconds, ([\d.e+-]+) in evaluations", words)
    return float(error[1]), float(speed[1]), float(speed[2])


@pytest.mark.parametrize("tolerance", [1e-2, 1e-6])
def test_recommended_deck_meets_the_tolerance_against_an_independent_solution(study, run_deck, tolerance):
    folder, _, _ = study(CRANK, "--sensor", "rod", "pin", "--tolerance", str(tolerance), "--methods", "rk4")
    done = run_deck(folder / "recommended.nml")
    found = differences(done.history, read(REFERENCE / "vrl_ghm" / "expected.csv"), tolerance, columns=["rod", "pin.*"])
    assert all(d.passed for d in found), found
    error, _, counts = promised(folder)
    assert error == pytest.approx(max(d.error for d in found), rel=0.05, abs=2e-8)
    told = (folder / "tradeoff.txt").read_text()
    own = re.search(r"accuracy=\S+ in &transient: error (\S+), ", told)
    estimate = re.search(r"by pilots \(check_reduction, check_mesh\) +mesh\n(?:  .*\n)*?  rod +(\S+)", told)
    assert 0.0 < float(estimate[1]) < 1.0
    assert 0.0 < float(own[1]) < tolerance
    if tolerance == 1e-2:
        assert counts > 5.0


def test_a_force_keeps_the_sensor_that_it_depends_on(study, run_deck, tmp_path):
    """A mass on the force -9 x let go at x = 1; the sensor of x is there for the force alone, and is not compared."""
    (tmp_path / "deck.nml").write_text(ARGUMENT)
    folder, _, _ = study(tmp_path / "deck.nml", "--sensor", "v", "--tolerance", "1e-3", "--methods", "rk4")
    assert "\nsensors: v; tolerance" in (folder / "tradeoff.txt").read_text()
    assert "not compared, rounding alone: v.y\n" in (folder / "tradeoff.txt").read_text()
    done = run_deck(folder / "recommended.nml")
    off = np.abs(done.history["v.x"] + 3.0 * np.sin(3.0 * done.history.time)).max()
    assert off / 3.0 < 1e-3
    assert promised(folder)[0] == pytest.approx(off / 3.0, rel=0.2)


@pytest.mark.long
def test_all_sensors_of_the_joint_spring_scene(study, run_deck, tmp_path):
    reference = REFERENCE / "viscoelastic_joint"
    deck = shortened(reference / "deck.nml", tmp_path, "0.1")
    folder, _, _ = study(deck, "--tolerance", "1e-2", "--methods", "rk4")
    done = run_deck(folder / "recommended.nml")
    found = differences(done.history, beginning(read(reference / "expected.csv"), len(done.history.time)), 1e-2)
    assert all(d.passed for d in found), found
    assert promised(folder)[2] > 5.0


def test_refined_truth_splits_the_error_and_is_met(study, run_deck):
    folder, _, _ = study(CRANK, "--sensor", "rod", "pin", "--tolerance", "1e-2", "--truth", "refined", "--methods", "rk4")
    text = (folder / "tradeoff.txt").read_text()
    row = re.search(r"^recommended\.nml +([\d.e+-]+) +([\d.e+-]+) +([\d.e+-]+)$", text, re.MULTILINE)
    assert 0.0 < sum(float(row[k]) for k in (1, 2, 3)) < 1.5e-2
    fine = deck_models.refined(deck_text.read(CRANK), 3, {"rod", "pin"})
    transient = fine.one("transient")
    reference = run_deck(fine.set(transient, step="4e-7").text, name="fine")
    found = differences(run_deck(folder / "recommended.nml").history, reference.history, 1e-2, columns=["rod", "pin.*"])
    assert all(d.passed for d in found), found


@pytest.mark.long
def test_refined_truth_of_the_four_bar_starts_the_search_from_the_decks_own_model(study, run_deck, tmp_path):
    path = shortened(ROOT / "input" / "four_bar_from_equilibrium.nml", tmp_path, "0.04")
    short, asked = deck_text.read(path), {"rocker", "motor", "pin_c"}
    folder, _, _ = study(path, "--sensor", *asked, "--tolerance", "1e-2", "--truth", "refined", "--methods", "dopri5", *SOME)
    text = (folder / "tradeoff.txt").read_text()
    assert re.search(r"mesh x 2, all kinematics modelled, (rk4|dopri5)", text)
    assert "the search starts from the deck's own model, whose own error is" in text
    fine = deck_models.refined(short, 2, asked)
    values = {"method": "'generalized_alpha'", "step": "5e-5"}
    reference = run_deck(fine.set(fine.one("transient"), **values).text, name="fine").history
    run = run_deck(folder / "recommended.nml").history
    columns = ["rocker", "motor.m", "pin_c.fx", "pin_c.fy"]
    worst = max(np.abs(np.interp(reference.time, run.time, run[c]) - reference[c]).max() / np.ptp(reference[c]) for c in columns)
    error, _, counts = promised(folder)
    assert worst < 1e-2
    assert error == pytest.approx(worst, rel=0.2)
    assert counts > 5.0


class Fixed:
    """A study of which `uncertainty_of` needs what is compared and the tolerance only."""

    compared, tolerance = Compared({}), 1e-2


def test_vibrations_that_one_method_damps_alike_in_all_its_runs_are_doubted():
    t = np.linspace(0.0, 1.0, 101)

    def outcome(ring: float) -> Outcome:
        return Outcome(0, "", ("x",), ("m",), np.column_stack([t, np.sin(t) + ring * np.cos(700.0 * t)]))

    damped = Curve("rk4", outcomes=[outcome(0.0)], left=1e-9)
    ringing = Curve("dopri5", outcomes=[outcome(2e-3)], left=1e-5)
    unsure = Curve("dopri5", outcomes=[outcome(2e-3)], left=5e-3)
    assert uncertainty_of(Fixed, damped, [damped, ringing]) == pytest.approx(2e-3 / np.sin(1.0), rel=0.1)
    assert uncertainty_of(Fixed, damped, [damped, unsure]) == 1e-9, "no estimate, no witness"
    assert uncertainty_of(Fixed, ringing, [ringing, Curve("generalized_alpha", outcomes=[outcome(0.0)], left=1e-9)]) == 1e-5
    alone = replace(damped, family="radau")
    far = Curve("rk4", outcomes=[outcome(0.3)], left=0.02)
    assert uncertainty_of(Fixed, alone, [alone, far]) > 0.2, (
        "an unsettled explicit run is a witness where it is farther away than it is unsure"
    )


def test_at_an_event_the_error_of_its_time_counts_and_not_the_jump():
    """A step from 0 to 1 and a rebound, both late by 0.1 of the time; a run in which the step never comes."""
    t = np.linspace(0.0, 1.0, 101)

    def run(step: float, rebound: float) -> Outcome:
        events = (Event(0.2, "pin", "stuck", "forward", 0.0), Event(step, "pin", "forward", "stuck", 0.0))
        events += (Event(rebound, "stop", "open", "lower_rebound", 1.0),)
        data = np.column_stack([t, np.where(t > step, 1.0, 0.0), np.abs(t - rebound)])
        return Outcome(0, "", ("f", "x"), ("N", "m"), data, events=events)

    truth = truth_of(run(0.5, 0.655), Compared({}))
    assert error_of(run(0.5, 0.655), truth).largest == 0.0
    late = error_of(run(0.605, 0.655), truth)
    assert (late.column, late.largest, late.each["f"]) == ("events", pytest.approx(0.105), 0.0)
    assert error_of(run(0.5, 0.675), truth).each["events"] == pytest.approx(0.02)
    assert error_of(run(2.0, 0.655), truth).each["events"] == pytest.approx(0.5)


@pytest.mark.long
def test_reactions_of_the_four_bar_by_an_implicit_method(study, run_deck):
    deck = REFERENCE / "four_bar" / "deck.nml"
    folder, _, _ = study(deck, "--sensor", "joint_c", "pin_c", "--tolerance", "1e-2", "--methods", *SOME)
    done = run_deck(folder / "recommended.nml")
    found = differences(done.history, read(deck.parent / "expected.csv"), 1e-2, columns=["joint_c.*", "pin_c.*"])
    assert all(d.passed for d in found), found
    assert promised(folder)[2] > 5.0
    assert "generalized_alpha" in (folder / "recommended.nml").read_text().split("&scene")[0]


def start_of(scene_deck: Path, rows: int, times: np.ndarray, columns: list[str]) -> np.ndarray:
    """Return columns of the independent model's motion at the first times, shape (rows, columns)."""
    scene = Scene(scene_deck)
    v, moving = scene.deck_v.copy(), {"velocity", "angular_velocity"}
    free = [scene.offset[b.name] + k for b in scene.bodies if not moving & set(b.record) for k in range(3)]
    v[free] = np.linalg.lstsq(scene.jacobian(scene.q0)[:, free], -scene.phi_rate(0.0, scene.q0, v), rcond=None)[0]
    start = np.concatenate([scene.q0, v, *scene.relaxed(scene.q0)])
    run = solve_ivp(scene.derivative, (0.0, times[rows]), start, "DOP853", t_eval=times[: rows + 1], rtol=1e-8, atol=1e-11)
    values = [scene.sensor_columns(t, *scene.split(run.y[:, k])) for k, t in enumerate(run.t)]
    return np.array([[row[column] for column in columns] for row in values])


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "t_end", "asked", "rows"),
    [("engine", "2e-3", ["piston", "crank_pin"], 4), ("four_bar", "1e-2", ["rocker", "motor", "pin_c"], 1)],
)
def test_recommended_deck_follows_the_independent_model(study, run_deck, tmp_path, name, t_end, asked, rows):
    deck = shortened(ROOT / "input" / f"{name}.nml", tmp_path, t_end)
    folder, _, _ = study(deck, "--sensor", *asked, "--tolerance", "1e-2")
    run = run_deck(folder / "recommended.nml").history
    columns = [c for c in run.names[1:] if c.split(".")[0] in asked and np.ptp(run[c]) > 1e-9]
    assert len(columns) >= 3
    expected = start_of(deck, rows, run.time, columns)
    for k, column in enumerate(columns):
        assert np.abs(run[column][: rows + 1] - expected[:, k]).max() < 1e-2 * np.ptp(run[column]), column


def test_rod_angle_and_slider_of_the_ivp_crank_meet_a_thousandth(study, run_deck, tmp_path):
    path = shortened(ROOT / "input" / "ivp_slider_crank.nml", tmp_path, "0.02")
    path.write_text(deck_models.with_elements(deck_text.read(path), "rod", 2, {"rod", "slider"}).text)
    folder, _, _ = study(path, "--sensor", "rod", "slider", "--truth", "refined", "--methods", "rk4")
    run = run_deck(folder / "recommended.nml").history
    reference = beginning(read(REFERENCE / "published" / "crank_conv_lin_ini2.csv"), len(run.time))
    for ours, theirs in {"rod": "phi2", "slider.x": "x3"}.items():
        exact = np.interp(run.time, reference.time, reference[theirs])
        assert np.array_equal(np.round(run.time, 12), np.round(reference.time, 12))
        assert np.abs(run[ours] - exact).max() < 1e-3 * np.ptp(reference[theirs])
    assert promised(folder)[2] > 5.0


def test_curve_has_the_slope_of_the_methods_order(study):
    folder, _, _ = study(CRANK, "--sensor", "mid", "--tolerance", "1e-4", "--methods", "rk4", picture=True)
    text = (folder / "tradeoff.txt").read_text()
    seen = [float(word) for word in re.search(r"^  rk4: (.*)$", text, re.MULTILINE)[1].split(", ")]
    assert any(abs(order - 4.0) < 0.3 for order in seen), seen
    assert (folder / "work_precision.png").stat().st_size > 10_000


RIGID = """&scene gravity=0.0,-9.81 /
&body name='a' kind='rigid' mass=1.0 inertia=0.08 com=0.5,0.0 angle=0.3 /
&body name='b' kind='rigid' mass=0.5 inertia=0.04 com=0.25,0.0 position=0.9553364891,0.2955202067 angle=-0.4 /
&joint name='o' type='revolute' body_a='a' /
&joint name='p' type='revolute' body_a='b' body_b='a' point_b=1.0,0.0 /
&sensor name='b' quantity='angle' body='b' /
&sensor name='o' quantity='reaction' joint='o' /
&sensor name='fixed' quantity='position' body='a' /
&transient t_end=1.0 method='rk4' step=1e-4 output_step=5e-3 /
"""


def test_curves_of_all_methods_fall_with_their_orders(study, tmp_path):
    """A sensor of a fixed point shows rounding only: it must not hold up convergence."""
    (tmp_path / "deck.nml").write_text(RIGID)
    folder, _, _ = study(tmp_path / "deck.nml", "--tolerance", "1e-6")
    text = (folder / "tradeoff.txt").read_text()
    first, last, middle = {}, {}, {}
    for family in ("rk4", "dopri5", "generalized_alpha", "radau", "radau adaptive"):
        orders = [float(order) for order in re.search(rf"^  {family}: ([-\d., ]+)$", text, re.MULTILINE)[1].split(", ")]
        first[family], last[family], middle[family] = orders[0], orders[-1], sorted(orders[:3])[1]
    assert abs(last["rk4"] - 4.0) < 0.3
    assert 4.5 < last["dopri5"] < 7.5
    assert abs(last["generalized_alpha"] - 2.0) < 0.15
    assert abs(first["radau"] - 5.0) < 0.3, "from an error of 4e-11 on its own finest runs are rounding"
    assert 4.5 < middle["radau adaptive"] < 7.5, "errors by tolerance scatter from run to run"
    rows = re.findall(r"^generalized_alpha step (\S+) s +\S+ +\S+ +\S+ +\S+ +(\d+) ", text, re.MULTILINE)
    assert len(rows) > 5
    assert all(int(evaluations) > 1.0 / float(step) for step, evaluations in rows), "Newton iterations count as evaluations"


def test_a_reader_that_has_gone_ends_the_study_quietly(biela, tmp_path):
    read_end, write_end = os.pipe()
    os.close(read_end)
    (tmp_path / "deck.nml").write_text(RIGID)
    command = [sys.executable, str(TOOL), str(tmp_path / "deck.nml"), "--sensor", "b", "--tolerance", "1e-2", "--methods", "dopri5"]
    command += ["--biela", str(biela), "--output", str(tmp_path / "study"), "--quiet"]
    done = subprocess.run(command, stdout=write_end, stderr=subprocess.PIPE, text=True, timeout=300, check=False)
    os.close(write_end)
    assert (done.stderr, done.returncode) == ("", 141)
    assert (tmp_path / "study" / "recommended.nml").exists()


@pytest.mark.parametrize(
    ("runs", "told", "status"),
    [(2, "No run of a method came to its end", 1), (7, "No reference converged", 1), (12, "recommended.nml was run", 0)],
)
def test_time_ends_the_search(runs, told, status, study, monkeypatch):
    """By a clock that runs alone drive, so that no other job's work is in it."""
    monkeypatch.setattr(deck_runs.Runner, "left", lambda self: self.share * self.time * (1.0 - self.made / runs))
    folder, said, warned = study(CRANK, "--tolerance", "1e-5", "--methods", "rk4", status=status)
    assert (told in said, warned) == (True, "")
    assert (folder / "recommended.nml").exists() == (status == 0)


def test_budget_takes_the_most_accurate_run_that_fits(study, run_deck, monkeypatch):
    """With seconds that are counted, a microsecond for each evaluation, so that no other job's work is in them."""
    real = deck_runs.read_summary

    def counted(folder: Path) -> dict:
        summary = real(folder)
        return {**summary, "timing": {**summary["timing"], "processor_seconds": 1e-6 * summary["transient"]["evaluations"]}}

    monkeypatch.setattr(deck_runs, "read_summary", counted)
    budget = f"{4e-6 * run_deck(CRANK).transient['evaluations']:.4f}"  # the tolerance takes six times the deck's own steps
    folder, told, _ = study(CRANK, "--tolerance", "1e-6", "--budget", budget, "--methods", "rk4", status=1)
    assert "most accurate setting within the budget" in told.replace("\n", " ")
    assert 1e-6 < promised(folder)[0] < 1e-1


def test_second_study_uses_the_kept_runs_and_marks_points_below_the_truths_own_uncertainty(study):
    words = CRANK, "--sensor", "rod", "--tolerance", "1e-3", "--methods", "rk4"
    folder, first, _ = study(*words)
    kept = {path.name for path in (folder / "kept").iterdir()}
    _, second, _ = study(*words)
    assert second == first
    assert {path.name for path in (folder / "kept").iterdir()} == kept
    text = (folder / "tradeoff.txt").read_text()
    uncertainty = float(re.search(r"its own uncertainty: ([\d.e+-]+) ", text)[1])
    rows = re.findall(r"^rk4 step \S+ s +([\d.e+-]+)(<?) ", text, re.MULTILINE)
    assert len(rows) > 10
    for error, mark in rows:
        assert (mark == "<") == (float(error) < uncertainty) or float(error) == pytest.approx(uncertainty, rel=0.1)


def test_interrupt_keeps_what_was_run(biela: Path, tmp_path: Path):
    command = [sys.executable, str(TOOL), str(REFERENCE / "four_bar" / "deck.nml"), "--biela", str(biela), "--output", "study"]
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a child of tests in the background would ignore it
    child = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True, env=dict(os.environ))
    signal.signal(signal.SIGINT, before)
    kept = tmp_path / "study" / "kept"
    until = time.monotonic() + 120.0
    while time.monotonic() < until and not any(kept.glob("*.npz")):
        time.sleep(0.05)
    child.send_signal(signal.SIGINT)
    _, told = child.communicate(timeout=120)
    assert child.returncode == 130
    assert told.splitlines()[-1].startswith("tradeoff: interrupted")
    assert "Traceback" not in told
    assert not list(kept.glob("*.run"))
    assert list(kept.glob("*.npz"))


@pytest.mark.parametrize(
    ("text", "options", "fault"),
    [
        (None, [], "no such file"),
        ("&scene /\n", [], "no &sensor"),
        ("&scene \n", [], "no closing slash"),
        ("&body name='b' mass=1 inertia=1 /\n&sensor name='a' quantity='angle' body='b' /\n", [], "no &transient"),
        ("good", ["--sensor", "nonsense"], "no sensor 'nonsense'"),
        ("faulty", [], "unknown variable yonug, did you mean young?"),
    ],
)
def test_faults_are_one_line(study, tmp_path, text, options, fault):
    deck = tmp_path / "deck.nml"
    if text in ("good", "faulty"):
        deck.write_text(CRANK.read_text().replace("young=2.1e10", "young=2.1e10" if text == "good" else "yonug=2.1e10"))
    elif text is not None:
        deck.write_text(text)
    _, _, told = study(deck, *options, status=2)
    lines = told.strip().splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("tradeoff: ")
    assert fault in lines[0] or "no method converged" in lines[0]


COMMENTED = """! head
&include file='inner.nml' /   ! the material
&body name='rod' kind='beam' length=0.3 elements=4   ! four / of them & more
      material='steel' section='s' /  ! end
&section name='s' area=1e-4 inertia=1e-9 /
&sensor name='a' quantity='angle' body='rod' / ! keep
&sensor name='q' quantity='coordinate' body='rod' index=3 /
&transient t_end=1.0 ! s
           method='rk4' ! explicit
           step=1e-4 /
"""


INNER = """&material name='steel' density=7800.0 young=2e11
 ghm_alpha=0.5, ! slow
 0.2 ! fast
 ghm_zeta=1,1 ghm_omega=30,500
 /
"""


def test_edits_keep_comments_and_layout(tmp_path):
    (tmp_path / "deck.nml").write_text(COMMENTED)
    (tmp_path / "inner.nml").write_text(INNER)
    deck = deck_text.read(tmp_path / "deck.nml")
    again = deck_models.with_elements(deck, "rod", 2, {"a"})
    again = again.set(again.one("transient"), step="2e-4", output_step="1e-2")
    again = again.set(again.one("material"), ghm_alpha="0.1", ghm_zeta="1", ghm_omega="30")
    for words in ("! head", "! the material", "! four / of them & more", "! end", "! keep", "! explicit", "! slow", "elements=2"):
        assert words in again.text
    assert again.one("transient").number("step") == 2e-4
    assert again.one("material").numbers("ghm_alpha") == [0.1]
    assert again.one("material").number("young") == 2e11
    assert [s.name for s in again.all("sensor")] == ["a"]
    assert "! dropped" in again.text
    with pytest.raises(deck_models.ImpossibleError):
        deck_models.with_elements(deck, "rod", 3, {"q"})


def test_sensors_follow_their_material_points_to_a_finer_mesh(run_deck):
    deck = deck_text.parse(CRANK.read_text() + "\n&sensor name='point' quantity='position' body='rod' node=2 /\n")
    fine = deck_models.refined(deck, 2, {s.name for s in deck.all("sensor")})
    coarse, finer = run_deck(deck.text), run_deck(fine.set(fine.one("transient"), step="1e-6").text, name="fine")
    for run in (coarse, finer):
        assert np.array_equal(run.history["qf4.q"], run.history["mid.r"])
        assert np.ptp(run.history["mid.r"]) > 0.0
    for column in ("point.x", "point.y"):
        assert finer.history[column][0] == pytest.approx(coarse.history[column][0], abs=1e-15)
        assert np.abs(coarse.history[column] - finer.history[column]).max() < 0.01


def test_frame_cut_in_two_is_the_same_structure(run_deck):
    deck = deck_text.read(REFERENCE / "viscoelastic_joint" / "deck.nml")
    cut = deck_models.split_frame(deck, "lower", {"tip", "upper"})
    one, two = run_deck(deck.text), run_deck(cut.set(cut.one("transient"), step="5e-6").text, name="cut")
    found = differences(two.history, one.history, 1e-3, columns=["tip.*", "upper"])
    assert all(d.passed for d in found), found
