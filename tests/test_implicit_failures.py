"""Implicit steps that fail: tried smaller and told, or the run stops at its last good row and says why."""

import re

import numpy as np
import pytest
from test_failures import CRANK, PULL, failed

IMPLICIT = "&transient method='generalized_alpha' "
RIGID = CRANK.replace("elements=2", "elements=2 flexible=.false.")
BLOW = CRANK + (
    "&history name='j' kind='pulse' value=1e12 start=5e-3 finish=6e-3 /\n"
    "&force name='blow' type='force' body='rod' node=2 fy=1.0 history='j' /\n"
)


def newton_failures(summary):
    """Return how often the summary says that Newton's method failed."""
    found = re.search(r"Newton's method failed (\d+) times, and the step was (halved|tried smaller)", summary)
    return int(found[1]) if found else 0


def test_a_controlled_step_that_newtons_method_cannot_solve_is_tried_smaller(run_deck):
    """A first step of half a turn; the run that follows is as good as one that began with a short one."""
    runs = []
    for first in (0.2, 1e-4):
        text = IMPLICIT + f"t_end=0.2 tolerance=1e-6 first_step={first} output_step=0.1 /\n"
        runs.append(run_deck(RIGID + text, name=f"f{first}"))
    assert newton_failures(runs[0].summary) > 0
    assert newton_failures(runs[1].summary) == 0
    assert np.abs(runs[0].history["pin.x"] - runs[1].history["pin.x"]).max() < 1e-4


@pytest.mark.parametrize("steps", ["step=1e-3", "tolerance=1e-5", "tolerance=1e-9"])
def test_a_drive_beyond_reach(steps, run_deck):
    """A point of the unit link pulled to x = 1.5 m: it stops where the link is stretched, naming body and drive."""
    run, told = failed(run_deck, PULL + IMPLICIT + f"t_end=0.2 {steps} output_step=1e-2 /\n")
    assert 0.035 < run.history.time[-1] < 0.051
    assert '"pull"' in told
    assert 'body "a"' in told


def test_a_step_that_underflows(run_deck):
    _, told = failed(run_deck, PULL + IMPLICIT + "t_end=0.2 tolerance=1e-9 output_step=1e-2 /\n")
    assert "the step became too small" in told
    assert "the tolerance cannot be kept" in told


def test_a_load_that_no_step_can_follow(run_deck):
    """A blow of 1e12 N: Newton's method fails however often the step is halved."""
    run, told = failed(run_deck, BLOW + IMPLICIT + "t_end=0.01 step=1e-5 output_step=1e-4 /\n")
    assert "the equations of a step could not be solved" in told
    assert 'body "rod"' in told
    assert run.history.time[-1] == pytest.approx(5e-3)
    assert newton_failures(run.summary) > 20


def test_the_verdict_distrusts_a_run_of_far_too_long_steps(run_deck):
    text = IMPLICIT + "t_end=0.1 step=2e-3 spectral_radius=0.0 /\n"
    assert "the results cannot be trusted" in run_deck(CRANK + text).summary
