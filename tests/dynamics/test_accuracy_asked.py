"""`accuracy` is kept, by passes that agree and in truth: their counts, what sensors override, what cannot be kept."""

from __future__ import annotations

import re

import numpy as np
import pytest
from conftest import Run, untimed
from random_scenes import scene

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


# a slider-crank on a viscoelastic rod: tolerances of 1e-3 and 1e-5 of radau err alike
ROD = """&scene gravity=0,-9.81 /
&body name='crank' mass=0.5 inertia=2e-3 com=0.025,0 angle=0.3 /
&material name='m' density=7850 young=3e9 ghm_alpha=0.4 ghm_zeta=2.0 ghm_omega=3000 /
&section name='s' shape='rectangle' width=0.01 height=0.02 /
&body name='rod' kind='beam' length=0.2 elements=3 material='m' section='s' position={0.05*cos(0.3)},{0.05*sin(0.3)}
      angle={-asin(0.05*sin(0.3)/0.2)} /
&body name='piston' mass=0.4 inertia=1e-3 position={0.05*cos(0.3)+0.2*cos(asin(0.05*sin(0.3)/0.2))},0 /
&joint name='o' type='revolute' body_a='crank' /
&joint name='p' type='revolute' body_a='rod' node_a=1 body_b='crank' point_b=0.05,0 /
&joint name='q' type='revolute' body_a='rod' node_a=-1 body_b='piston' /
&joint name='r' type='prismatic' body_a='piston' /
&history name='h' kind='ramp' start_value=0 end_value=314 start=0 finish=0.05 /
&drive name='d' type='rotation' body_a='crank' history='h' rate=.true. /
&sensor name='rr' quantity='reaction' joint='r' /
"""
# beside its upper position; a wheel turns alone
UPRIGHT = """&scene gravity=0,-9.81 /
&body name='b' mass=1 inertia=0.0133 com=0.2,0 angle={pi/2+1e-6} /
&joint name='j' type='revolute' body_a='b' /
&body name='w' mass=1 inertia=0.1 position=1,0 angular_velocity=1 /
&joint name='k' type='revolute' body_a='w' point_b=1,0 /
&sensor name='a' quantity='angle' body='b' /
&sensor name='turn' quantity='angle' body='w' /
&transient t_end=6 output_step=0.015 accuracy=1e-1 /
"""


def passes(run: Run) -> list[tuple[str, float]]:
    """Return method and tolerance (or step) of each pass."""
    return [(p["method"], p.get("tolerance", p.get("step"))) for p in run.figures["accuracy"]["passes"]]


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
    assert run.figures["accuracy"]["not_kept"] == []
    assert error(run, truth) < float(asked)
    last = run.figures["accuracy"]["passes"][run.figures["accuracy"]["results_of_pass"] - 1]
    assert last["worst_error_of_asked"] <= 1.0
    assert run.transient["tolerance"] == last["tolerance"]


def test_soft_scenes_are_left_to_dopri5(run_deck):
    """Its steps are far below the stable one: radau, which may pay only where stability sets them, is not begun."""
    steps = "&transient t_end=0.06 output_step=0.002 {} /\n"
    run = run_deck(ROD + steps.format("accuracy=1e-5"))
    truth = run_deck(ROD + steps.format("method='dopri5' tolerance=1e-8"), name="truth")
    assert run.figures["accuracy"]["kept"]
    assert error(run, truth) < 1e-5
    assert passes(run) == [("dopri5", 1e-6), ("dopri5", 1e-7)]
    first, last = run.figures["accuracy"]["passes"]
    assert "worst_column" not in first
    assert last["worst_column"] == "rr.fy[N]"


def test_the_first_passes_are_chosen_by_what_they_cost(run_deck):
    """Stability sets the steps of dopri5; radau follows what rings, and would cost more than a third."""
    run = run_deck(BAR.format(damping="", override="", words="accuracy=1e-3"))
    assert passes(run)[:4] == [("dopri5", 1e-4), ("radau", 1e-3), ("dopri5", 1e-4), ("dopri5", 1e-5)]
    look, radau, first = run.figures["accuracy"]["passes"][:3]
    assert look["cost"] < 0.06 * first["cost"]
    assert radau["cost"] < 1.25 * first["cost"] / 3
    assert 0.0 < radau["reached"] < 0.02
    assert "worst_column" not in first


def test_a_column_that_does_not_converge_is_named_and_leaves_the_others(run_deck):
    """Passes fall to either side of the upper position, by what a tolerance makes of a millionth: finer ones, too."""
    run = run_deck(UPRIGHT)
    found = run.figures["accuracy"]
    assert (found["kept"], found["not_kept"]) == (False, ["a[rad]"])
    assert "warning: 1 of 2 columns err by more than is asked, the worst, a[rad], by an estimated" in run.stderr
    assert run.stderr.endswith("the accuracy is not kept: finer passes do not converge (rounding or chaos)\n")
    asked = [p["worst_error_of_asked"] for p in found["passes"][1:]]
    assert len(asked) == 4
    assert min(asked[1:]) > asked[0] / 2
    assert run.figures["outcome"] == "done"


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
    assert "pass 1: dopri5, tolerance 1e-4" in text
    assert re.search(r"pass 2: dopri5, tolerance 1e-5, cost \d+; b.angle\[rad\] differs by", text)
    assert len((one / "history.txt").read_text().splitlines()) == 1001 + 3


def test_damped_vibrations_cost_little_and_ringing_ones_are_followed(run_deck):
    damped = run_deck(BAR.format(damping="rayleigh_stiffness=1e-3", override="", words="accuracy=1e-2"))
    ringing = run_deck(BAR.format(damping="", override="", words="accuracy=1e-2"), name="ringing")
    assert passes(damped) == [("dopri5", 1e-3), ("radau", 1e-2), ("radau", 1e-3)]
    assert damped.figures["accuracy"]["passes"][0]["cost"] < 600
    assert damped.figures["accuracy"]["cost"] < 0.05 * ringing.figures["accuracy"]["cost"]
    assert all(run.figures["accuracy"]["kept"] for run in (damped, ringing))
    for run, damping in ((damped, "rayleigh_stiffness=1e-3"), (ringing, "")):
        words = "method='radau' tolerance=1e-9" if damping else "method='dopri5' tolerance=1e-9"
        truth = run_deck(BAR.format(damping=damping, override="", words=words), name="truth")
        assert error(run, truth) < 1e-2


def test_a_finer_pass_takes_shorter_steps_where_stability_sets_them(run_deck):
    """Else both passes of dopri5 err alike there."""
    deck = BAR.format(damping="rayleigh_stiffness=1e-3", override="", words="accuracy=1e-2 method='dopri5'")
    run = run_deck(deck.replace("t_end=0.02", "t_end=0.002"))
    first, last = run.figures["accuracy"]["passes"]
    assert last["tolerance"] == pytest.approx(0.1 * first["tolerance"])
    assert run.transient["longest_step"] < 0.8 * 7 * 0.002 / first["cost"]


@pytest.mark.parametrize("override", ["floor=100.0", "accuracy=0.9"])
def test_a_sensor_may_ask_for_less(override, run_deck):
    """The reaction that rings does not rule the position any more."""
    words = "accuracy=1e-3 method='radau'"
    strict = run_deck(BAR.format(damping="", override="", words=words))
    eased = run_deck(BAR.format(damping="", override=override, words=words), name="eased")
    assert eased.figures["accuracy"]["cost"] < 0.3 * strict.figures["accuracy"]["cost"]
    assert eased.figures["accuracy"]["kept"]


def test_what_hardly_moves_beside_its_kind_does_not_set_the_cost(run_deck):
    """An axial force that rings a millionth of the transverse one: it is asked for absolutely, and costs as none at all."""
    deck = BAR.replace("gravity=0.0,-9.81", "").replace("angle=-1.4", "").replace("revolute", "weld")
    deck += "&history name='h' kind='cycloid' start_value=0.0 end_value=10.0 start=0.0 finish=0.02 /\n"
    deck += "&force name='y' type='force' body='b' node=-1 fy=1.0 history='h' /\n{}"
    still, rings = (
        run_deck(deck.format(more, damping="rayleigh_stiffness=1e-7", override="", words="accuracy=1e-3"), name=name)
        for name, more in (("still", ""), ("rings", "&force name='x' type='force' body='b' node=-1 fx=1e-6 /\n"))
    )
    found = rings.figures["accuracy"]
    assert found["kept"]
    assert found["cost"] < 1.1 * still.figures["accuracy"]["cost"]
    assert rings.transient["absolute"]["pin.fx[N]"] == pytest.approx(1e-6 * np.ptp(rings.history["pin.fy"]), rel=1e-9)
    assert "pin.fy[N]" not in rings.transient["absolute"]
    assert "absolute accuracy of columns with a floor, or a range below a thousandth" in rings.summary


@pytest.mark.parametrize("method", ["rk4", "dopri5", "radau", "generalized_alpha"])
def test_a_method_is_kept(method, run_deck):
    deck = PENDULUM + "&sensor name='a' quantity='angle' body='b' /\n"
    deck += f"&transient t_end=1.0 output_step=0.05 accuracy=1e-4 method='{method}' /\n"
    run = run_deck(deck)
    found = passes(run)
    assert {p[0] for p in found} == {method}
    ratio = 0.5 if method in ("rk4", "generalized_alpha") else 0.1
    assert [b[1] / a[1] for a, b in zip(found, found[1:])] == pytest.approx([ratio] * (len(found) - 1))
    truth = run_deck(deck.replace(f"accuracy=1e-4 method='{method}'", "method='dopri5' tolerance=1e-10"), name="truth")
    assert error(run, truth) < 1e-4


@pytest.mark.parametrize("output", [0.05, 6.0])
def test_a_motion_that_cannot_be_predicted_is_told(output, run_deck):
    """A ball among round walls: each impact amplifies errors, so that finer passes have other events; one row shows it, too."""
    run = run_deck(BALL + f"&transient t_end=6.0 output_step={output} accuracy=1e-3 /\n")
    assert len(passes(run)) < 8
    assert not run.figures["accuracy"]["kept"]
    assert "the accuracy is not kept: finer passes have other sequences of events" in run.stderr
    assert re.search(r"from t =  ?\S+ s on", run.stderr)
    assert run.figures["outcome"] == "done"


def test_events_without_a_row_behind_them_are_compared(run_deck):
    """The only row is that of the end: the first two passes strike the walls in another order before it."""
    run = run_deck(BALL + "&transient t_end=0.9 output_step=0.9 accuracy=1e-3 /\n")
    found = run.figures["accuracy"]["passes"]
    assert run.figures["accuracy"]["kept"]
    assert 0.0 < found[1]["events_differ_from"] < 0.9
    assert "events_differ_from" not in found[-1]
    truth = run_deck(BALL + "&transient t_end=0.9 output_step=0.9 method='dopri5' tolerance=1e-11 /\n", name="truth")
    assert error(run, truth) < 1e-3


def test_a_contact_that_stays_closed_is_left_to_radau(run_deck):
    """Open, as at the start, it does not limit the steps of dopri5; closed it does. Passes agree in the small bounces, too."""
    deck = PENDULUM.replace("com=0.5,0.0", "com=0.5,0.0 angle=0.3")
    deck += "&spring name='t' type='torsional' body_a='b' stiffness=2.0 free_angle=0.3 /\n"
    deck += "&stop name='s' type='rotation' body_a='b' lower=0.0 stiffness=1e6 exponent=1.0 restitution=0.05 /\n"
    run = run_deck(deck + "&sensor name='a' quantity='angle' body='b' /\n&transient t_end=1.0 output_step=0.01 accuracy=1e-2 /\n")
    found = run.figures["accuracy"]
    assert {p[0] for p in passes(run)} == {"radau"}
    assert found["cost"] < 2e4  # a pass of dopri5 takes 7e4
    assert found["kept"]
    *_, before, last = found["passes"]
    assert before["worst_error_of_asked"] < 1.0
    assert 0.0 < before["events_differ_from"] < 1.0
    assert "events_differ_from" not in last


def test_most_seconds_ends_a_ladder_with_what_is_there(run_deck):
    run = run_deck(BAR.format(damping="", override="", words="accuracy=1e-5 most_seconds=1e-6"))
    assert run.figures["accuracy"]["results_of_pass"] == len(passes(run))
    assert all(p["reached"] < 0.02 for p in run.figures["accuracy"]["passes"][:-1])
    assert "the accuracy is not kept: most_seconds ended the search" in run.stderr


def test_an_accuracy_beyond_the_digits_is_told(run_deck):
    run = run_deck(PENDULUM + "&transient t_end=1.0 output_step=0.1 accuracy=1e-30 /\n")
    assert [p[1] for p in passes(run)] == pytest.approx([1e-12, 1e-13], abs=0.0)
    assert "the worst, b.angle[rad], by an estimated" in run.stderr
    assert "the accuracy is not kept: tolerances end at 1e-13" in run.stderr


# equal lengths: at 0 and pi positions are singular; no force acts, and every angular velocity is constant
PARALLELOGRAM = """&parameter name='a' value=0.7 /
&body name='crank' mass=1 inertia=0.02 com=0.06,0 angle={a} angular_velocity=5 /
&body name='bar' mass=1.5 inertia=0.02 com=0.15,0 position={0.12*cos(a)},{0.12*sin(a)} /
&body name='rocker' mass=1 inertia=0.02 com=0.06,0 position=0.3,0 angle={a} /
&joint name='a' type='revolute' body_a='crank' /
&joint name='b' type='revolute' body_a='bar' body_b='crank' point_b=0.12,0 /
&joint name='c' type='revolute' body_a='bar' point_a=0.3,0 body_b='rocker' point_b=0.12,0 /
&joint name='d' type='revolute' body_a='rocker' point_b=0.3,0 /
&sensor name='crank' quantity='angle' body='crank' /
&sensor name='speed' quantity='angular_velocity' body='crank' /
&transient t_end=2 output_step=0.01 """
# a wheel at 100 rad/s with a ripple of its torque: a hundred-thousandth of its speed
RIPPLE = """&body name='w' mass=1 inertia=0.1 angular_velocity=100 /
&joint name='j' type='revolute' body_a='w' /
&history name='h' kind='sine' amplitude=1 frequency={90/(2*pi)} /
&force name='f' type='torque' body='w' moment=9e-3 history='h' /
&sensor name='speed' quantity='angular_velocity' body='w' /
&transient t_end=2 output_step=0.01 """


@pytest.mark.parametrize("asked", ["1e-2", "1e-3", "1e-6"])
def test_a_constant_column_is_not_measured_by_its_noise(asked, run_deck):
    run = run_deck(PARALLELOGRAM + f"accuracy={asked} /\n")
    assert run.figures["accuracy"]["kept"]
    assert run.stderr == ""
    assert np.abs(run.history["speed"] - 5).max() < 1e-3 * float(asked) * 5 + 1.5e-8 * 5
    assert np.abs(run.history["crank"] - 0.7 - 5 * run.history.time).max() < float(asked) * 10
    assert "speed[rad/s]" not in run.figures["transient"]["estimated_errors_of_range"]


def test_a_second_run_does_not_measure_noise_by_noise(run_deck):
    run = run_deck(PARALLELOGRAM + "method='radau' tolerance=1e-6 check_error=.true. /\n")
    assert run.stderr == ""
    coarse = run_deck(PARALLELOGRAM + "method='radau' tolerance=1e-3 check_error=.true. /\n", name="coarse")
    assert "1 of 2 columns move by no more than they err, speed[rad/s] by an estimated" in coarse.stderr
    assert "of its range" not in coarse.stderr


@pytest.mark.parametrize("asked", ["1e-2", "1e-4"])
def test_a_ripple_on_a_constant_speed_is_no_noise(asked, run_deck):
    run = run_deck(RIPPLE + f"accuracy={asked} /\n")
    speed = 100 + 1e-3 * (1 - np.cos(90 * run.history.time))
    assert run.figures["accuracy"]["kept"] == (np.abs(run.history["speed"] - speed).max() < float(asked) * 2e-3)


@pytest.mark.parametrize("end", [2e-6, 2e-4])
def test_columns_of_very_short_runs_are_judged_as_any(end, run_deck):
    """A motion over the scene's size within the run is no scale there: it would make all that moves in microseconds a constant."""
    deck = f"""&body name='m' mass=1 inertia=1 /
&joint name='p' type='prismatic' body_a='m' /
&body name='b' mass=1 inertia=1 com=0.5,0 /
&joint name='q' type='revolute' body_a='b' /
&sensor name='x' quantity='position' body='m' /
&sensor name='v' quantity='velocity' body='m' /
&history name='h' kind='sine' amplitude=1 frequency={2 / end} /
&force name='f' body='m' fx=40 fy=30 history='h' /
&transient t_end={end} output_step={end / 200} accuracy=1e-3 /
"""
    run = run_deck(deck)
    t = run.history["t"]
    omega = 4 * np.pi / end
    v = 40 / omega * (1 - np.cos(omega * t))
    x = 40 / omega * (t - np.sin(omega * t) / omega)
    assert np.abs(run.history["v.x"] - v).max() < 1e-3 * v.max()
    assert np.abs(run.history["x.x"] - x).max() < 1e-3 * x.max()
    assert set(run.transient["still_columns"]) == {"x.y[m]", "v.y[m/s]"}
