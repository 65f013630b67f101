"""How many steps make an interval: one rule, and counts that do not fit are refused; equal scenes take equal steps."""

from __future__ import annotations

import json

import pytest

BODY = """&scene gravity=0.0,-9.81 /
&body name='a' mass=1.0 inertia=0.1 com=0.5,0.0 /
&joint name='j' type='revolute' body_a='a' /
&sensor name='angle' quantity='angle' body='a' /
"""


@pytest.mark.parametrize(
    ("times", "said"),
    [
        ("t_end=1.0 step=1e-20 output_step=1.0", "t_end=1 is 1e20 times step=1e-20"),
        ("t_end=1.0 step=1e-20", "t_end=1 is 1e20 times step=1e-20"),
        ("t_end=1e20 step=0.01", "t_end=1e20 is 1e22 times step=0.01"),
        ("t_end=1.0 step=0.01 motion_step=1e30", "motion_step=1e30 is 1e32 times output_step=0.01"),
        ("t_end=1.0 method='dopri5' tolerance=1e-6 output_step=1e-20", "t_end=1 is 1e20 times output_step=1e-20"),
        ("t_end=1.0 method='dopri5' tolerance=1e-6 motion_step=1e30", "motion_step=1e30 is 1e33 times output_step=0.001"),
    ],
)
def test_counts_that_do_not_fit_are_refused(times, said, run_deck):
    done = run_deck(BODY + f"&transient {times} /\n", expect=2)
    assert f"transient: {said}, expected at most 1e18 times" in done.stderr
    assert not done.folder.exists()


def steps(done):
    """Return the number of steps and the step."""
    return done.transient["steps"], done.transient["step"]


@pytest.mark.parametrize("method", ["rk4", "dopri5", "generalized_alpha"])
@pytest.mark.parametrize(("excess", "count"), [(-5e-10, 10), (0.0, 10), (5e-10, 10), (2e-9, 11), (1e-3, 11)])
def test_a_ratio_that_is_whole_but_for_rounding_counts_as_whole(excess, count, method, run_deck):
    step = 0.1 / (1.0 + excess)
    done = run_deck(BODY + f"&transient t_end=1.0 output_step=1.0 step={step!r} method='{method}' /\n", "--quiet")
    assert steps(done) == (count, pytest.approx(1.0 / count, rel=1e-9))


def test_default_rates_belong_to_the_step_in_use(run_deck):
    text = BODY + "&transient t_end=1.0 output_step=1.0 step={} stabilization='baumgarte' {} /\n"
    default = run_deck(text.format(repr(0.1 / (1.0 + 5e-10)), ""), name="default")
    stated = run_deck(text.format("0.1", "baumgarte_alpha=1.0 baumgarte_beta=1.0"), name="stated")
    assert (default.history.data == stated.history.data).all()


def test_rounding_of_late_times_adds_no_step(run_deck):
    done = run_deck(BODY + "&transient t_end=12.0 output_step=1e-3 step=1e-4 /\n", "--quiet")
    assert steps(done)[0] == 120000


def test_a_spring_cut_into_two_that_share_its_stiffness_takes_the_same_steps(run_deck):
    """Each half has the internal variables of the whole, whose rates, hardly damped, set the step."""
    counts = []
    for names in (("k",), ("k", "l")):
        springs = "".join(
            f"&spring name='{name}' type='torsional' body_a='b' stiffness={1.0 / len(names)} ghm_alpha=0.5 ghm_zeta=0.01"
            " ghm_omega=100.0 /\n"
            for name in names
        )
        run = run_deck(
            "&body name='b' mass=1.0 inertia=1.0 angular_velocity=2.0 /\n&joint name='p' type='revolute' body_a='b' /\n"
            f"{springs}&sensor name='b' quantity='angle' body='b' /\n"
            "&transient method='dopri5' tolerance=1e-6 t_end=0.5 output_step=0.1 /\n",
            name="".join(names),
        )
        counts.append(json.loads((run.folder / "summary.json").read_text())["transient"]["evaluations"])
    assert counts[0] == counts[1]
