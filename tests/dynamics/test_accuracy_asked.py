"""`accuracy` is kept, by the estimates and in truth: passes, their counts, what sensors override, what cannot be kept."""

from __future__ import annotations

import re
import subprocess

import numpy as np
import pytest
from conftest import ROOT, Run, untimed
from random_scenes import scene, sensors
from random_springs import random_springs

PENDULUM = """&scene gravity=0.0,-9.81 /
&body name='b' kind='rigid' mass=1.0 inertia=0.01 com=0.5,0.0 /
&joint name='j' type='revolute' body_a='b' /
"""
# a bar that gravity strikes: its axial vibration, 4e4 rad/s and undamped, is all that the reaction shows beside the weight
BAR = """&scene gravity=0.0,-9.81 /
&material name='m' density=7800.0 young=2.0e11 {damping} /
&section name='s' shape='rectangle' width=0.01 height=0.01 /
&body name='b' kind='beam' length=0.2 elements=1 material='m' section='s' reference='clamped' angle=-1.4 /
&joint name='j' type='revolute' body_a='b' node_a=1 /
&sensor name='tip' quantity='position' body='b' node=-1 /
&sensor name='pin' quantity='reaction' joint='j' {override} /
&transient t_end=0.02 output_step=2e-4 {words} /
"""
BALL = """&body name='b' kind='rigid' mass=1.0 inertia=1.0 velocity=3.0,1.0 /
&sensor name='p' quantity='position' body='b' point=0.0,0.0 /
&stop name='ring' type='clearance' body_a='b' point_b=0.0,0.05 gap=0.2 stiffness=1.0e6 exponent=1.0 /
&stop name='post' type='position' body_a='b' direction=0.4 upper=0.11 stiffness=1.0e6 exponent=1.0 /
"""


def passes(run: Run) -> list[tuple[str, str, float]]:
    """Return role, method and tolerance (or step) of each pass."""
    return [(p["role"], p["method"], p.get("tolerance", p.get("step"))) for p in run.figures["accuracy"]["passes"]]


def error(run: Run, truth: Run) -> float:
    """Return the largest error of all columns that vary, over their ranges."""
    a, b = (np.column_stack([r.history[name] for name in r.history.names[1:]]) for r in (run, truth))
    extent = np.ptp(b, axis=0)
    varies = extent > 1e-9 * np.abs(b).max()
    return float((np.abs(a - b).max(axis=0)[varies] / extent[varies]).max())


@pytest.mark.parametrize(("number", "asked"), [(1, "1e-2"), (2, "1e-3"), (2, "1e-5")])
def test_random_scenes_keep_it(run_deck, number, asked):
    drawn = scene(1, number)
    deck = drawn.text + f"&transient t_end={drawn.time / 4} {{}} /\n"
    run = run_deck(deck.format(f"accuracy={asked}"))
    truth = run_deck(deck.format("method='radau' tolerance=1e-9"), name="truth")
    assert run.figures["accuracy"]["kept"]
    assert error(run, truth) < float(asked)
    last = run.figures["accuracy"]["passes"][run.figures["accuracy"]["results_of_pass"] - 1]
    assert last["worst_error_of_asked"] <= 1.0
    assert run.transient["tolerance"] == last["tolerance"]


def test_a_deck_without_steps_asks_for_a_thousandth(run_deck):
    """Without sensors frames and nodes count; equal runs leave equal files; nothing else is in the folder."""
    run, again = (run_deck(PENDULUM + "&transient t_end=1.0 /\n", "--output", folder) for folder in ("one", "two"))
    one, two = run.folder, again.folder
    assert sorted(path.name for path in one.iterdir() if path.name != ".lock") == [
        "energy.txt",
        "history.txt",
        "summary.json",
        "summary.txt",
    ]
    for name in ("history.txt", "energy.txt", "summary.txt", "summary.json"):
        assert untimed((one / name).read_bytes()) == untimed((two / name).read_bytes())
    text = (one / "summary.txt").read_text()
    assert "pass 1, results: dopri5, tolerance 1e-4" in text
    assert re.search(r"pass 2, results: dopri5, tolerance 3.1e-5, cost \d+; b.angle\[rad\] errs by", text)
    assert len((one / "history.txt").read_text().splitlines()) == 1001 + 3


def test_damped_vibrations_are_left_to_radau_and_ringing_ones_followed(run_deck):
    damped = run_deck(BAR.format(damping="rayleigh_stiffness=1e-3", override="", words="accuracy=1e-2"))
    ringing = run_deck(BAR.format(damping="", override="", words="accuracy=1e-2"), name="ringing")
    assert [p[:2] for p in passes(damped)][0] == ("pilot", "radau")
    assert passes(damped)[-1][:2] == ("witness", "dopri5")
    assert damped.figures["accuracy"]["results_of_pass"] == len(passes(damped)) - 1
    assert passes(ringing)[-1][1] == "dopri5"
    assert all(run.figures["accuracy"]["kept"] for run in (damped, ringing))
    assert "before its first row: it tells nothing" in damped.summary  # its own steps are a fiftieth
    truth = run_deck(BAR.format(damping="", override="", words="method='dopri5' tolerance=1e-9"), name="truth")
    assert error(ringing, truth) < 1e-2


def test_a_finer_pass_takes_shorter_steps_where_stability_sets_them(run_deck):
    """Else both passes of dopri5 err alike there."""
    deck = BAR.format(damping="rayleigh_stiffness=1e-3", override="", words="accuracy=1e-2 method='dopri5'")
    run = run_deck(deck.replace("t_end=0.02", "t_end=0.002"))
    first, last = run.figures["accuracy"]["passes"]
    assert last["tolerance"] == pytest.approx(0.31 * first["tolerance"])
    assert run.transient["longest_step"] < 0.8 * 7 * 0.002 / first["cost"]


@pytest.mark.parametrize("override", ["floor=100.0", "accuracy=0.9"])
def test_a_sensor_may_ask_for_less(override, run_deck):
    """The reaction that rings does not rule the position any more."""
    words = "accuracy=1e-3"
    strict = run_deck(BAR.format(damping="", override="", words=words))
    eased = run_deck(BAR.format(damping="", override=override, words=words), name="eased")
    assert eased.figures["accuracy"]["cost"] < 0.3 * strict.figures["accuracy"]["cost"]
    assert eased.figures["accuracy"]["kept"]


@pytest.mark.parametrize("method", ["rk4", "dopri5", "radau", "generalized_alpha"])
def test_a_method_is_kept_and_witnessed(method, run_deck):
    deck = PENDULUM + "&sensor name='a' quantity='angle' body='b' /\n"
    deck += f"&transient t_end=1.0 output_step=0.05 accuracy=1e-4 method='{method}' /\n"
    run = run_deck(deck)
    found = passes(run)
    assert {p[1] for p in found if p[0] == "results"} == {method}
    assert (found[-1][0] == "witness") == (method != "dopri5")
    truth = run_deck(deck.replace(f"accuracy=1e-4 method='{method}'", "method='dopri5' tolerance=1e-10"), name="truth")
    assert error(run, truth) < 1e-4


def test_a_motion_that_cannot_be_predicted_is_told(run_deck):
    """A ball among round walls: each impact amplifies errors, so that finer passes have other events."""
    run = run_deck(BALL + "&transient t_end=6.0 output_step=0.05 accuracy=1e-3 /\n")
    assert not run.figures["accuracy"]["kept"]
    assert "the accuracy is not kept: finer passes have other sequences of events" in run.stderr
    assert re.search(r"from t =  ?\S+ s on", run.stderr)
    assert run.figures["outcome"] == "done"


def test_steps_that_follow_what_no_column_shows_are_told(run_deck):
    """The bar's axial vibration, 4.385e4 rad/s as assembled, moves its tip by less than a thousandth of the swing."""
    steps = "method='dopri5' tolerance=1e-6"
    deck = re.sub(r"&sensor name='pin'.*\n", "", BAR).replace("t_end=0.02", "t_end=0.04").replace("2e-4", "5e-3")
    run = run_deck(deck.format(damping="", words=steps))
    assert re.search(r'note: steps follow a vibration near (6.9|7.0)E\+03 Hz of body "b"', run.stderr)
    assert run.stderr.count("need not follow it") == 1
    assert run.transient["followed_frequency"] == pytest.approx(4.385e4 / 2 / np.pi, rel=0.02)
    assert 1e-7 < run.transient["followed_share"] < 1e-3
    shown = run_deck(BAR.format(damping="", override="", words=steps).replace("t_end=0.02", "t_end=0.04"), name="shown")
    assert "need not follow it" not in shown.stderr


def test_a_robot_whose_drives_ring(biela, run_deck):
    """The shipped robot in undamped steel: its rods ring at 12, 24 and 28 kHz, which the tool does not show."""
    words = [str(biela), "--flat", str(ROOT / "input" / "redundant_robot.nml")]
    deck = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    deck = re.sub(r"&material[^/]*/", "&material name='polymer' density=7850 young=2.1e11 /", deck)
    deck = re.sub(r"&sensor name='._[^/]*/", "", deck)

    def run(words, name):
        return run_deck(re.sub(r"&transient[^/]*/", f"&transient t_end=0.024 {words} /", deck), name=name)

    ringing = run("method='radau' tolerance=1e-6 output_step=1e-3", "ringing")
    words = r'note: steps follow a vibration near [12].\dE\+04 Hz of body "._rod".*accuracy=1e-3 in place of'
    assert re.search(words, ringing.stderr)
    assert ringing.transient["steps"] > 4096
    assert 1e-12 < ringing.transient["followed_share"] < 1e-7
    eased = run("accuracy=1e-3 output_step=1e-4", "eased")
    assert eased.figures["accuracy"]["kept"]
    assert eased.transient["steps"] < 0.2 * ringing.transient["steps"]
    assert eased.figures["accuracy"]["cost"] < 0.3 * 2.2 * ringing.transient["residual_evaluations"]
    assert "left out or damped as too small, by the witness: no column shows a hundredth of what is asked" in eased.summary
    assert re.search(r"energy removed by the method itself: +\d\.\d+E-\d+ J", eased.summary)
    seldom = run("accuracy=1e-3 output_step=1e-3", "seldom")
    assert re.search(r"witness: dopri5, .*, before its first row: it tells nothing", seldom.summary)


def test_what_a_fine_tolerance_costs_is_no_reason_to_change_the_method(run_deck):
    """dopri5 may cost four times what its stable step, or radau by the part that its pilot has done, asks for."""
    drawn = scene(349823, 404)
    run = run_deck(drawn.text + f"&transient t_end={drawn.time / 8} accuracy=1e-7 /\n")
    assert [p[:2] for p in passes(run)] == [("pilot", "radau"), ("results", "dopri5"), ("results", "dopri5")]
    assert run.figures["accuracy"]["passes"][0]["reached"] < drawn.time / 8  # the pilot was given up
    assert run.figures["accuracy"]["kept"]


def test_a_contact_that_stays_closed_is_left_to_radau(run_deck):
    """Open, as at the start, it does not limit the steps of dopri5; closed it does, a thousand times."""
    deck = PENDULUM.replace("com=0.5,0.0", "com=0.5,0.0 angle=0.3")
    deck += "&spring name='t' type='torsional' body_a='b' stiffness=2.0 free_angle=0.3 /\n"
    deck += "&stop name='s' type='rotation' body_a='b' lower=0.0 stiffness=1e9 exponent=1.0 restitution=0.3 /\n"
    run = run_deck(deck + "&sensor name='a' quantity='angle' body='b' /\n&transient t_end=1.0 output_step=0.01 accuracy=1e-2 /\n")
    first, second = (p for p in run.figures["accuracy"]["passes"][1:3])
    assert (first["method"], second["method"]) == ("dopri5", "radau")
    assert first["reached"] < 1.0
    assert first["cost"] < 2e4
    assert run.figures["accuracy"]["kept"]


def test_a_coarse_pass_that_is_enough_costs_little(run_deck):
    """Cost alone ends a search by radau: here dopri5 would need fifty times as much."""
    text = random_springs(953834001)
    run = run_deck(text + sensors(text) + "&transient t_end=0.0246 output_step=1.23e-4 accuracy=1e-2 /\n")
    assert {p[1] for p in passes(run) if p[0] == "results"} == {"radau"}
    assert run.figures["accuracy"]["kept"]


def test_most_seconds_ends_a_search_with_what_is_there(run_deck):
    run = run_deck(BAR.format(damping="", override="", words="accuracy=1e-5 most_seconds=1e-6"))
    assert run.figures["accuracy"]["results_of_pass"] == 1
    assert "the accuracy is not kept: most_seconds ended the search" in run.stderr


def test_an_accuracy_beyond_the_digits_is_told(run_deck):
    run = run_deck(PENDULUM + "&transient t_end=1.0 output_step=0.1 accuracy=1e-30 /\n")
    assert [p[2] for p in passes(run)] == pytest.approx([1e-12, 3.1e-13, 1e-13], abs=0.0)
    assert "the accuracy is not kept: tolerances end at 1e-13; the worst column of the results, b.angle[rad], errs by" in run.stderr
