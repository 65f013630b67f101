"""Histories with arguments of their own: products, switches and sums of functions of several motions and of time, as loads."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
from biela.histories import read
from conftest import program
from linear_oracle import compare_linear
from scipy.integrate import solve_ivp
from test_motion_laws import BODIES, COLUMNS, LOADS, SCENE, SUFFIX

COMPRESSOR = Path(__file__).parents[2] / "input" / "compressor.nml"


def events(folder: Path) -> list[tuple[float, str]]:
    """Return times and new states of the events of a run."""
    lines = [line.split() for line in (folder / "events.txt").read_text(encoding="utf-8").splitlines() if line[0] != "#"]
    return [(float(line[0]), line[3]) for line in lines]


class Compressor:
    """The compressor by its one freedom, from the energies of crank, rod and piston; tables as they stand in the deck."""

    place = 0.14 + 1e-3 * np.array([-60, -48, -36, -27, -20, 3 - 63 / 6 ** (1 / 1.3), 0])
    closing = 200 * np.array([*((63 / np.array([63, 51, 39, 30, 23])) ** 1.3 - 1), 5, 5])
    back = 0.14 + 1e-3 * np.array([-60, 3 * (1 - 6 ** (1 / 1.3)), -6, -4, -2, -1, 0])
    opening = 200 * np.array([0, *(6 * (3 / np.array([3 * 6 ** (1 / 1.3), 9, 7, 5, 4, 3])) ** 1.3 - 1)])

    def motion(self, angle: complex) -> tuple[complex, complex, complex]:
        """Return the piston's place, its slope by the crank's angle, and the reduced inertia."""
        s, c = np.sin(angle), np.cos(angle)
        rod = np.sqrt(1 - (0.03 * s / 0.11) ** 2)
        turn = -0.03 * c / (0.11 * rod)
        slope = -0.03 * s + 0.03 * s * turn
        centre = -0.03 * s + 0.01 * s * turn, 0.02 * c
        return (0.03 * c + 0.11 * rod, slope, 0.04 + 0.5 * (centre[0] ** 2 + centre[1] ** 2) + 8e-4 * turn**2 + 0.6 * slope**2)

    def rates(self, t: float, y: np.ndarray) -> list[float]:
        """Return the rates of angle and speed."""
        place, slope, inertia = self.motion(y[0])
        change = self.motion(y[0] + 1e-20j)[2].imag / 1e-20
        gas = np.interp(place, self.place, self.closing) if slope >= 0 else np.interp(place, self.back, self.opening)
        share = min(t / 0.2, 1)
        motor = np.interp(y[1], np.pi / 30 * np.array([0, 1300, 1500]), [12, 20, 0])
        motor *= share**3 * (10 + share * (6 * share - 15))
        return [y[1], (motor - gas * slope - 0.5 * change * y[1] ** 2) / inertia]

    def run(self) -> tuple[np.ndarray, float]:
        """Return the times of the dead centres until 0.5 s, and the speed then."""

        def centre(t: float, y: np.ndarray) -> float:
            return np.sin(y[0]) if t > 0.1 else -1

        found = solve_ivp(self.rates, (0, 0.5), [np.pi, 0], "DOP853", rtol=1e-13, atol=1e-14, events=centre, max_step=2e-3)
        return found.t_events[0], found.y[1, -1]

    def area(self) -> float:
        """Return what the gas takes in a turn [J]."""
        return np.trapezoid(self.closing, self.place) - np.trapezoid(self.opening, self.back)


def test_compressor_against_scipy(run_deck):
    compressor = Compressor()
    times, speed = compressor.run()
    text = COMPRESSOR.read_text(encoding="utf-8").partition("&transient")[0] + "&transient output_step=0.01 "
    for method in ("t_end=0.5 method='radau' tolerance=1e-10", "t_end=0.77 method='rk4' step=2e-4"):
        run = run_deck(f"{text} {method} /\n")
        seen = [(t, state) for t, state in events(run.folder) if t < 0.5]
        assert [state for _, state in seen] == ["second", "first"] * 3
        np.testing.assert_allclose([t for t, _ in seen], times, rtol=0, atol=1e-9)
        np.testing.assert_allclose(run.history["speed"][run.history.time <= 0.5 + 1e-9][-1], speed, rtol=1e-8)
        assert np.abs(run.energy["residual"]).max() < 1e-8 * np.ptp(run.energy["kinetic"])
    turns = [t for t, state in events(run.folder) if state == "first"]
    assert len(turns) == 9
    spent = run.history["gas"][run.history.time < turns[-1]][-1]  # nothing acts before the lower dead centre
    np.testing.assert_allclose(spent, -9 * compressor.area(), rtol=1e-6)


MIXED = {
    "product": "&history name='h' kind='product' histories='g','i' /",
    "sum": "&history name='h' kind='sum' histories='g','i' factors=0.7,-2 /",
    "switch": """&history name='k' kind='product' histories='i','g','j' /
&history name='l' coefficients=1,9 argument='ty' /
&history name='m' kind='sum' histories='k','g' /
&history name='h' kind='switch' argument='ty' level=-9 histories='m','l' /""",
    "other": """&history name='k' kind='product' histories='i','g','j' /
&history name='l' coefficients=1,9 argument='p.x' /
&history name='h' kind='switch' argument='ty' level=9 histories='l','k' /""",
}


@pytest.mark.parametrize("pair", [("p.x", "w"), ("s.d", "v.x"), ("o", "d.u"), ("h", "g.qd")])
@pytest.mark.parametrize("mixed", MIXED)
@pytest.mark.parametrize("bodies", BODIES)
def test_tangents_of_several_arguments(bodies, mixed, pair, tmp_path):
    text = SCENE.format(**BODIES[bodies]) + "&sensor name='ty' quantity='angle' body='disc' /\n"
    for name in {column.split(".")[0] for column in (*pair, "p.x")}:
        text += f"&sensor name='{name}' {next(COLUMNS[key] for key in COLUMNS if key.split('.')[0] == name)} /\n"
    text += f"&history name='g' coefficients=1,0.3,0.2 argument='{pair[0]}' /\n"
    text += f"&history name='i' coefficients=2,-0.4,0.1 argument='{pair[1]}' /\n"
    text += "&history name='j' kind='sine' amplitude=0.5 offset=1 frequency=3 /\n" + MIXED[mixed] + "\n"
    for k, load in enumerate(LOADS):
        text += f"&force name='f{k}' {load} history='h' /\n"
    (tmp_path / "deck.nml").write_text(text, encoding="utf-8")
    command = [program("TANGENT", f"bin/tangent{SUFFIX}"), "deck.nml", "1e-3", "0.6", "3"]
    out = subprocess.run(command, cwd=tmp_path, check=True, capture_output=True, text=True).stdout
    assert max(float(word) for word in re.findall(r"\d\S*", out)) < 1e-6


CARTS = """&body name='a' kind='rigid' mass=2 inertia=0.1 {a} /
&body name='b' kind='rigid' mass=1 inertia=0.02 position=1,0 {b} /
&joint name='ga' type='prismatic' body_a='a' /
&joint name='gb' type='prismatic' body_a='b' point_b=1,0 /
&spring name='k' body_a='a' body_b='b' stiffness=100 /
&spring name='g' body_a='a' point_b=-1,0 stiffness=50 /
&sensor name='at' quantity='position' body='b' /
&sensor name='go' quantity='velocity' body='b' /
"""


def test_statics_modes_and_responses(run_deck):
    """A force on the first cart: a product of functions of the second one's place and speed, chosen by the place of the first."""
    deck = (
        CARTS.format(a="", b="")
        + """&sensor name='first' quantity='position' body='a' /
&history name='h' coefficients=3,-7,-2 argument='at.x' /
&history name='d' coefficients=2,-1.5 argument='go.x' /
&history name='p' kind='product' histories='h','d' /
&history name='not' coefficients=1e3 /
&history name='s' kind='switch' argument='first.x' level=1 histories='not','p' /
&force name='f' body='a' fx=0.5 history='s' /
&force name='in' body='b' fx=1 stage='transient' /
&static / &modal modes=2 /
&frequency_response from=1 to=3 points=3 input='in' /
"""
    )
    run = run_deck(deck)
    x = np.roots([2, 57, -53]).max()  # 50 (x - 1) = 3 - 7 x - 2 x^2
    np.testing.assert_allclose(read(run.folder / "static.txt")["at.x"][-1], x, rtol=1e-10)
    mass = np.diag([2.0, 1.0])
    damping = np.array([[0, 0.5 * 1.5 * (3 - 7 * x - 2 * x * x)], [0, 0]])
    stiffness = np.array([[150, -100 + 7 + 4 * x], [-100, 100.0]])
    compare_linear(run, mass, damping, stiffness)


STROKE = """&body name='a' kind='rigid' mass=2 inertia=0.1 position=0.3,0 /
&joint name='ga' type='prismatic' body_a='a' /
&spring name='k' body_a='a' point_b=-10,0 stiffness=72 free_length=10 /
&sensor name='at' quantity='position' body='a' /
&sensor name='go' quantity='velocity' body='a' /
&history name='on' coefficients={on} /
&history name='off' coefficients=0 /
&history name='h' kind='switch' argument='go.x' histories='on','off' level={level} /
&force name='f' body='a' fx=1 history='h' /
&sensor name='w' quantity='work' force='f' /
&transient t_end=2 output_step=0.01 method='{method}' {step} /
"""
METHODS = {"rk4": "step=1e-3", "dopri5": "tolerance=1e-11", "radau": "tolerance=1e-11", "generalized_alpha": "step=1e-4"}


@pytest.mark.parametrize("method", METHODS)
def test_a_force_on_one_stroke(method, run_deck):
    """An oscillator from rest: -3 N on its way up alone. Dead centres are half periods; a turn loses 3 N times the way up."""
    run = run_deck(STROKE.format(on=-3, level=0, method=method, step=METHODS[method]))
    within = 2e-6 if method == "generalized_alpha" else 1e-9
    seen = events(run.folder)
    assert [state for _, state in seen] == ["second", "first", "second", "first"]
    np.testing.assert_allclose([t for t, _ in seen[1:]], np.arange(1, 4) * np.pi / 6, rtol=0, atol=within)
    middle = -3 / 72  # on the way up
    top = 0.3 + 2 * middle
    now = middle - (top + middle) * np.cos(6 * 2.0 - 3 * np.pi)
    spent = -3 * (0.3 + top + now + top)
    np.testing.assert_allclose([run.history["at.x"][-1], run.history["w"][-1]], [now, spent], rtol=100 * within)
    assert np.abs(run.energy["residual"]).max() < (1e-4 if method == "generalized_alpha" else 1e-9)


def test_a_switch_at_a_level(run_deck):
    """A constant force while the speed is above a level: the event is where the sine has it."""
    run = run_deck(STROKE.format(on=5, level=0.9, method="radau", step="tolerance=1e-11"))
    t, state = events(run.folder)[0]
    assert state == "first"
    np.testing.assert_allclose(t, (np.pi + np.arcsin(0.5)) / 6, rtol=1e-11)  # -1.8 sin 6t = 0.9


def test_a_switch_that_brakes_is_refused(run_deck):
    deck = STROKE.format(on=-40, level=0, method="dopri5", step="tolerance=1e-8").replace("coefficients=0 ", "coefficients=40 ")
    run = run_deck(deck, expect=1)
    assert re.search(r'events follow one another without end at t = \S+ s, in "h": ', run.stderr)
    assert "in place of a switch take friction of a joint" in run.stderr


def test_a_cycle_with_a_stroke(run_deck):
    """A cart that is pushed by a sine and braked on one stroke repeats; what the push puts in brake and damper take."""
    push = "&history name='s' kind='sine' amplitude=30 frequency=1 /\n&force name='p' body='a' fx=1 history='s' /\n"
    push += "&sensor name='p' quantity='work' force='p' /\n&periodic period=1 multipliers=2 /\n"
    run = run_deck(
        push + STROKE.format(on=-3, level=0, method="rk4", step="step=1e-3").replace("t_end=2 ", "").replace("=72", "=72 damping=4")
    )
    rows = run.history
    assert [state for _, state in events(run.folder)] == ["first", "second"]
    np.testing.assert_allclose([rows["at.x"][-1], rows["go.x"][-1]], [rows["at.x"][0], rows["go.x"][0]], rtol=0, atol=1e-8)
    np.testing.assert_allclose(rows["w"][-1], -3 * np.ptp(rows["at.x"]), rtol=1e-3)
    np.testing.assert_allclose(rows["p"][-1] + rows["w"][-1], run.energy["dissipated"][-1], rtol=1e-7)


def test_a_product_over_time(run_deck):
    """A drive along a product of time, against the same polynomial."""
    deck = """&body name='a' kind='rigid' mass=2 inertia=0.1 /
&joint name='ga' type='revolute' body_a='a' /
&history name='p' coefficients=1,2 /
&history name='q' coefficients=0,1,3 /
&history name='r' {} /
&drive name='d' body_a='a' history='r' relative=.true. /
&sensor name='m' quantity='reaction' drive='d' /
&transient t_end=1 output_step=0.1 method='rk4' step=0.01 /
"""
    one = run_deck(deck.format("kind='product' histories='p','q'"), name="one").history["m.m"]
    two = run_deck(deck.format("coefficients=0,1,5,6"), name="two").history["m.m"]
    np.testing.assert_allclose(one, two, rtol=1e-12)
    np.testing.assert_allclose(two[5], 0.1 * (10 + 36 * 0.5), rtol=1e-9)
