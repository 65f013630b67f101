"""Implicit steps that fail: tried smaller and told, or the run stops at its last good row and says why."""

import re

import numpy as np
import pytest
from failing_scenes import BENT, BEYOND, CRANK, PULL, failed

IMPLICIT = "&transient method='generalized_alpha' "
CONTROLLED = "&transient method='radau' "
RIGID = CRANK.replace("elements=2", "elements=2 flexible=.false.")
BLOW = CRANK + (
    "&history name='j' kind='pulse' value=1e12 start=5e-3 finish=6e-3 /\n"
    "&force name='blow' type='force' body='rod' node=2 fy=1.0 history='j' /\n"
)


def newton_failures(summary):
    """Return how often the summary says in words that Newton's method failed."""
    found = re.search(r"failures of Newton's method: (\d+), where the step was (halved|tried smaller)", summary)
    return int(found[1]) if found else 0


def test_a_controlled_step_that_newtons_method_cannot_solve_is_tried_smaller(run_deck):
    """A first step of half a turn; the run that follows is as good as one that began with a short one."""
    runs = []
    for first in (0.2, 1e-4):
        text = CONTROLLED + f"t_end=0.2 tolerance=1e-6 first_step={first} output_step=0.1 /\n"
        runs.append(run_deck(RIGID + text, name=f"f{first}"))
    assert newton_failures(runs[0].summary) > 0
    assert newton_failures(runs[1].summary) == 0
    assert np.abs(runs[0].history["pin.x"] - runs[1].history["pin.x"]).max() < 1e-4


@pytest.mark.parametrize("steps", ["step=1e-3", "tolerance=1e-5", "tolerance=1e-9"])
def test_a_drive_beyond_reach(steps, run_deck):
    """A point of the unit link pulled to x = 1.5 m: it stops where the link is stretched, naming body and drive."""
    run, told = failed(run_deck, PULL + (IMPLICIT if "step" in steps else CONTROLLED) + f"t_end=0.2 {steps} output_step=1e-2 /\n")
    assert 0.035 < run.history.time[-1] < 0.051
    assert '"pull"' in told
    assert 'body "a"' in told


def test_a_step_that_underflows(run_deck):
    _, told = failed(run_deck, PULL + CONTROLLED + "t_end=0.2 tolerance=1e-9 output_step=1e-2 /\n")
    assert "the step became too small" in told
    assert "the tolerance cannot be kept" in told
    assert "the motion may be singular there" in told  # no step is too long for an implicit method's stability


def test_a_blow_that_no_beam_survives(run_deck):
    """A blow of 1e12 N: the equations can be solved, and give a deflection that means nothing."""
    run, told = failed(run_deck, BLOW + IMPLICIT + "t_end=0.01 step=1e-5 output_step=1e-4 /\n")
    assert 'body "rod" deflects by more than a thousand times the size of the scene' in told
    assert run.history.time[-1] == pytest.approx(5e-3)


SPUN = PULL[: PULL.index("&history")] + BEYOND + "&force name='f' type='torque' body='a' moment=1.0 history='h' /\n"
SWUNG = SPUN.replace("type='torque' body='a' moment", "type='force' body='a' point=1.0,0.0 fx")


@pytest.mark.parametrize(
    ("method", "steps"),
    [("radau", steps) for steps in ("tolerance=1e-3", "tolerance=1e-6", "step=1e-3", "step=1e-5")]
    + [("generalized_alpha", steps) for steps in ("step=1e-3", "step=1e-5")],
)
def test_a_load_that_passes_all_numbers_stops_the_run_early(steps, method, run_deck):
    """Turned by 1e59 t**8 N m: no following of turns without end; some thousand steps, not millions."""
    run, told = failed(run_deck, SPUN + f"&transient method='{method}' t_end=1.0 {steps} output_step=1e-2 /\n")
    assert "the solution diverged at t" in told
    assert 'the coordinates of body "a" grow most' in told
    assert ("check the loads" if "tolerance" in steps else "try a smaller one") in told
    assert run.transient["steps"] < 20000


def test_a_beam_bent_beyond_all_shape_stops_the_run_between_rows(run_deck):
    _, told = failed(run_deck, BENT + CONTROLLED + "t_end=1.0 tolerance=1e-3 output_step=1e-2 /\n")
    assert 'body "rod" deflects by more than a thousand times the size of the scene' in told


def test_steps_that_fail_leave_nothing_behind(run_deck):
    """A load that no first step can follow: halved often enough a step can, as far as the beam has a shape."""
    run, told = failed(run_deck, BENT + IMPLICIT + "t_end=1.0 step=1e-4 output_step=1e-2 /\n")
    assert 'body "rod" deflects by more than a thousand times the size of the scene' in told
    assert 5 < newton_failures(run.summary) < 20


def test_a_run_that_would_never_end_stops(run_deck):
    """A pendulum in a force that grows without end swings ever faster: steps become a 1e-11th of the run, for good."""
    _, told = failed(run_deck, SWUNG + CONTROLLED + "t_end=100.0 tolerance=1e-5 output_step=1.0 /\n")
    assert "the step became too small at t" in told
    assert 'the coordinates of body "a" grow most' in told


def test_the_verdict_distrusts_a_run_of_far_too_long_steps(run_deck):
    text = IMPLICIT + "t_end=0.1 step=2e-3 spectral_radius=0.0 /\n"
    assert "the results cannot be trusted" in run_deck(CRANK + text).summary


@pytest.mark.parametrize("steps", ["generalized_alpha' step=1e28", "radau' step=1e28", "radau' tolerance=1e-6"])
def test_equations_of_a_free_body_that_cannot_be_solved(steps, run_deck):
    """A load that passes all numbers within a step on a body without joints: no joint or drive is blamed."""
    deck = "&body name='b' kind='rigid' mass=1.0 inertia=1.0 position=1.0,0.0 /\n"
    deck += "&history name='h' kind='polynomial' coefficients=0,0,0,0,0,0,1e50 /\n"
    deck += "&force name='f' type='force' body='b' fx=1e20 history='h' /\n"
    _, told = failed(run_deck, deck + f"&transient t_end=1e30 method='{steps} output_step=1e28 /\n")
    assert "the equations of a step could not be solved" in told
    assert 'the coordinates of body "b" grow most' in told
    assert ("try a larger tolerance" if "tolerance" in steps else "try a smaller step") in told
    assert "joint" not in told
    assert "drive" not in told
