"""Jumps and corners of loads beside ends of steps: all methods end there, no pass steps over a load, rows have their work."""

from __future__ import annotations

import pytest

MASS = "&body name='m' mass=1 inertia=1 /\n&joint name='p' type='prismatic' body_a='m' /\n"
SENSORS = """&sensor name='x' quantity='position' body='m' /
&sensor name='v' quantity='velocity' body='m' /
&sensor name='w' quantity='work' {of} /
"""
METHODS = ["rk4", "dopri5", "radau", "generalized_alpha"]
PUSH = MASS + "&force name='f' body='m' fx=1 history='h' /\n" + SENSORS.format(of="force='f'")


def last_row(done, *columns):
    """Return values of the last row."""
    return [done.history[column][-1] for column in columns]


def under_pulses(pulses, end):
    """Return position, speed and work [m, m/s, J] of 1 kg under pulses (start, finish, value) that do not overlap."""
    x = v = 0.0
    now = 0.0
    for start, finish, value in sorted(pulses):
        d = finish - start
        x += v * (finish - now) + 0.5 * value * d**2
        v += value * d
        now = finish
    return x + v * (end - now), v, 0.5 * v**2


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("beside", [-1e-7, -1e-8, -3e-10, -1e-13, -3e-15, 3e-15, 1e-13, 3e-10, 1e-8, 1e-7])
def test_jumps_beside_ends_of_steps_are_not_missed(beside, method, run_deck):
    """Of rows (1 s) and of steps (0.1 s), at the start of a load and at its end, and beside another jump."""
    pulses = [(0.7 + beside, 1 + beside, 2.0), (2 + beside, 2.2 - 2 * beside, -1.5), (2.5, 2.5 + abs(beside), 0.4 / abs(beside))]
    if abs(beside) < 1e-12:
        pulses.pop()  # as short as rounding
    names = "".join(f",'h{k}'" for k in range(len(pulses)))[1:]
    lines = [f"&history name='h{k}' kind='pulse' start={p[0]!r} finish={p[1]!r} value={p[2]!r} /" for k, p in enumerate(pulses)]
    deck = "\n".join([*lines, f"&history name='h' kind='sum' histories={names} /", PUSH])
    within = 2e-10 if method == "generalized_alpha" else 1e-12  # lengths within 1e-9 of a step are one for it
    for row in (1.0, 3.0):
        done = run_deck(deck + f"&transient t_end={row} output_step=1 method='{method}' step=0.1 /\n", "--quiet")
        before = [(a, min(b, row), value) for a, b, value in pulses if a < row]
        assert last_row(done, "x.x", "v.x") == pytest.approx(under_pulses(before, row)[:2], abs=within)
        # by the trapezoidal rule the work of generalized_alpha is exact, as power is linear between jumps
        assert last_row(done, "w") == pytest.approx([under_pulses(before, row)[2]], abs=within)


@pytest.mark.parametrize("method", METHODS)
def test_times_of_few_digits_are_one_instant_for_steps_and_histories(method, run_deck):
    table = "time=0,0.333333333333,0.666666666667,1 value=0,0,1,1"
    drive = MASS + f"&history name='h' kind='table' interpolation='linear' {table} /\n" + SENSORS.format(of="drive='d'")
    drive += "&drive name='d' type='position' body_a='m' history='h' rate=.true. /\n"
    done = run_deck(drive + f"&transient t_end=1 output_step={{1/3}} method='{method}' step={{1/30}} /\n", "--quiet")
    assert last_row(done, "v.x", "w") == pytest.approx([1.0, 0.5], abs=1e-10)
    assert done.history["x.x"][2:] == pytest.approx([1 / 6, 0.5], abs=1e-10)


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("method", METHODS)
def test_thousands_of_parts_end_where_they_should(method, periodic, run_deck):
    """A sum of 4,000 times 0.1 s drifts by 1e-11 s if each is rounded; jumps stay at ends of steps, which their number shows."""
    parts = 2 if periodic else 4000
    names = ",".join(["'a'", "'b'"] * (parts // 2))
    deck = "&history name='a' coefficients=1 /\n&history name='b' coefficients=-1 /\n"
    deck += f"&history name='h' kind='sequence' histories={names}\n durations={','.join(['0.1'] * parts)} periodic=.{periodic}. /\n"
    done = run_deck(deck + PUSH + f"&transient t_end=400 output_step=100 method='{method}' step=0.1 /\n", "--quiet")
    assert done.transient["steps"] == 4000
    assert last_row(done, "x.x", "v.x", "w") == pytest.approx([20.0, 0.0, 0.0], abs=1e-11)


@pytest.mark.parametrize("words", ["method='rk4' step=0.1", "method='dopri5' tolerance=1e-8"])
def test_a_jump_soon_after_the_start_in_a_late_part_of_a_period(words, run_deck):
    """Times in the period are rounded more coarsely than those of the run: both sides of the jump stay apart."""
    deck = "&history name='a' coefficients=3 /\n&history name='b' coefficients=1 /\n"
    deck += "&history name='h' kind='sequence' histories='a','b' durations=0.75,0.25 start=0.250015383445828 periodic=.true. /\n"
    deck += PUSH
    done = run_deck(deck + f"&transient t_end=0.2 output_step=0.1 {words} /\n", "--quiet")
    assert last_row(done, "v.x") == pytest.approx([1.538344582e-5 * 3 + (0.2 - 1.538344582e-5) * 1], abs=1e-13)


@pytest.mark.parametrize("method", METHODS)
def test_a_row_just_behind_a_jump_has_its_own_work_and_losses(method, run_deck):
    """1 N until 1e-8 s before a row, a damper of 0.1 N s/m along the motion."""
    deck = "&history name='h' kind='pulse' start=0 finish=0.99999999 value=1 /\n" + PUSH
    deck += "&spring name='d' body_a='m' body_b='ground' point_b=-10,0 stiffness=0 damping=0.1 /\n"
    deck += "&sensor name='l' quantity='work' spring='d' /\n"
    done = run_deck(deck + f"&transient t_end=1 output_step=0.5 method='{method}' step=0.05 /\n", "--quiet")
    v = 9.516258196404048  # (1 - exp(-0.1))/0.1, less what follows
    x = 100 * (0.1 - (1 - 0.9048374180359595))
    assert last_row(done, "v.x", "w", "l") == pytest.approx([v / 10, x, 0.5 * (v / 10) ** 2 - x], rel=1e-3, abs=0)
    assert abs(done.energy["residual"][-1]) < 1e-4


@pytest.mark.parametrize("words", ["accuracy=1e-3", "step=0.1 output_step=0.1 check_error=.true."])
@pytest.mark.parametrize("method", METHODS)
def test_no_smooth_load_between_two_steps_is_unseen(words, method, run_deck):
    """1000 N for 10 ms, whose flanks have continuous slopes, between two steps of 0.1 s."""
    deck = """&history name='up' kind='cycloid' start=2.03 finish=2.031 start_value=0 end_value=1 /
&history name='down' kind='cycloid' start=2.04 finish=2.041 start_value=0 end_value=-1 /
&history name='h' kind='sum' histories='up','down' factors=1000,1000 /
"""
    words += "" if "output_step" in words else " output_step=0.1"
    done = run_deck(deck + PUSH + f"&transient t_end=4 method='{method}' {words} /\n", "--quiet")
    if "accuracy" in words:
        assert last_row(done, "v.x") == pytest.approx([10.0], rel=2e-3)
    else:
        right = abs(last_row(done, "v.x")[0] - 10.0)
        assert done.transient["estimated_errors"]["v.x[m/s]"] == pytest.approx(right, rel=0.4, abs=1e-6)


def test_passes_that_breakpoints_divide_alike_are_still_refined(run_deck):
    """Corners at 0.047 and 0.075 s leave passes of 0.05 and of 0.025 s the same steps where the load acts."""
    deck = "&history name='h' kind='table' interpolation='linear' time=0.047,0.075 value=-0.3,-1 /\n" + PUSH
    done = run_deck(deck + "&transient t_end=0.1 output_step=0.1 method='generalized_alpha' accuracy=1e-5 /\n", "--quiet")
    d, slope = 0.028, -0.7 / 0.028
    v1 = -0.3 * 0.075 + slope * d**2 / 2
    x1 = -0.3 * 0.075**2 / 2 + slope * d**3 / 6
    assert last_row(done, "x.x", "v.x") == pytest.approx([x1 + v1 * 0.025 - 0.025**2 / 2, v1 - 0.025], rel=2e-5)


def test_work_at_rows_within_a_long_step(run_deck):
    """Radau takes a few steps of a motion that it integrates exactly; the rows within have the exact work, too."""
    deck = "&history name='h' kind='table' interpolation='linear' time=0,1 value=0,1 /\n" + PUSH
    done = run_deck(deck + "&transient t_end=1 output_step=0.05 method='radau' tolerance=1e-4 /\n", "--quiet")
    t = done.history["t"]
    assert done.transient["steps"] < 12
    assert done.history["w"] == pytest.approx(t**4 / 8, abs=1e-12)
