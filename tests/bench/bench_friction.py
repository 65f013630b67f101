"""Friction by located events against a smoothed law: evaluations of the equations until an angle is right.

A pendulum with dry friction in its pin (from the pin's own reaction) swings until it sticks. biela locates its reversals; the
smoothed law replaces sign(w) by tanh(w/v), here in scipy's integrators and a fixed rk4, for speeds v that make it less or more
stiff. The truth is made of half swings, each integrated to 1e-13. Alone:
`.venv/bin/python tests/bench/bench_friction.py bin/biela`.
"""

import json
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "post"))
from biela.histories import read

G, MASS, INERTIA, ARM, MU, RADIUS, START = 9.81, 1.6, 0.05, 0.35, 0.25, 0.025, 0.9
END, ROWS = 16.0, 160
DECK = f"""&scene gravity=0.0,-{G} /
&body name='arm' mass={MASS} inertia={INERTIA} com=0.0,-{ARM} angle={START} /
&joint name='pin' type='revolute' body_a='arm' friction={MU} pin_radius={RADIUS} /
&sensor name='a' quantity='angle' body='arm' /
&transient t_end={END} output_step={END / ROWS} SETTING /
"""
SETTINGS = [f"method='rk4' step={h}" for h in (0.05, 0.025, 0.0125, 0.00625, 0.003125)]
SETTINGS += [f"method='{m}' tolerance=1e-{k}" for m in ("dopri5", "radau") for k in range(3, 10)]
SPEEDS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
ASKED = (1e-3, 1e-4, 1e-5, 1e-6)


def acceleration(angle, rate, side):
    """Angular acceleration with friction in the direction `side`: the pin's force depends on it in turn."""
    found, inertia = 0.0, INERTIA + MASS * ARM**2
    for _ in range(30):
        along, across = ARM * rate**2 + G * np.cos(angle), ARM * found + G * np.sin(angle)
        before, found = found, -(MASS * G * ARM * np.sin(angle) + side * MU * RADIUS * MASS * np.hypot(along, across)) / inertia
        if abs(found - before) <= 1e-15 * abs(found):
            break
    return found


def truth(times):
    """Angles by half swings with one direction of friction each, until the weight's moment cannot break away."""
    angles, state, t, side = np.full(len(times), START), [START, 0.0], 0.0, -1.0
    while t < END and side * acceleration(state[0], 0.0, side) > 0.0:

        def turns(_, y, side=side):
            return y[1] * side

        turns.terminal, turns.direction = True, -1
        part = solve_ivp(
            lambda _, y, side=side: [y[1], acceleration(y[0], y[1], side)],
            (t, END),
            state,
            "DOP853",
            rtol=1e-13,
            atol=1e-15,
            events=turns,
            dense_output=True,
            first_step=1e-4,
        )
        inside = (times >= t) & (times <= part.t[-1])
        angles[inside] = part.sol(times[inside])[0]
        t, state, side = part.t[-1], [part.y[0, -1], 0.0], -side
        angles[times > t] = state[0]
    return angles


def located(program, setting):
    """Evaluations and angles of biela."""
    with tempfile.TemporaryDirectory() as name:
        deck = Path(name) / "pendulum.nml"
        deck.write_text(DECK.replace("SETTING", setting))
        subprocess.run([str(program), "--quiet", "--output", f"{name}/out", str(deck)], check=True)
        run = json.loads((Path(name) / "out" / "summary.json").read_text())["transient"]
        return run["evaluations"] + run.get("residual_evaluations", 0), read(Path(name) / "out", "history")["a"]


def smoothed(speed, method, setting, times):
    """Evaluations and angles of the smoothed law: by scipy to a tolerance, or by rk4 with a number of steps a row."""
    count = 0

    def rates(_, y):
        nonlocal count
        count += 1
        return np.array([y[1], acceleration(y[0], y[1], np.tanh(y[1] / speed))])

    if method != "rk4":
        found = solve_ivp(rates, (0.0, END), [START, 0.0], method, t_eval=times, rtol=setting, atol=setting * 1e-2)
        return count, found.y[0]
    h, y, angles = END / ROWS / setting, np.array([START, 0.0]), [START]
    for k in range(ROWS * setting):
        k1 = rates(0, y)
        k2 = rates(0, y + h / 2 * k1)
        k3 = rates(0, y + h / 2 * k2)
        y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + rates(0, y + h * k3))
        if (k + 1) % setting == 0:
            angles.append(y[0])
    return count, np.array(angles)


def friction_trade(table, program):
    """Adds the table: the fewest evaluations of each law at each error of the angle, and what it does at rest."""
    times = np.linspace(0.0, END, ROWS + 1)
    exact = truth(times)
    tries = [("located", setting, *located(program, setting)) for setting in SETTINGS]
    for speed in SPEEDS:
        explicit = (("rk4", (2, 8, 20)), ("RK45", (1e-3, 1e-5, 1e-7))) if speed > 5e-4 else ()  # stiffer than that they crawl
        for method, settings in (*explicit, ("Radau", (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-9))):
            for setting in settings:
                with np.errstate(all="ignore"):
                    tries.append((f"tanh(w/{speed:g})", f"{method} {setting:g}", *smoothed(speed, method, setting, times)))
    table.add()
    table.add("friction in a pin: evaluations until a pendulum's angle errs by less over 16 s, at rest after 15")
    judged = [(law, how, n, float(np.abs(a - exact).max()) if len(a) == len(exact) else np.inf, a) for law, how, n, a in tries]
    for asked in ASKED:
        best = {}
        for law, how, count, error, angles in sorted(judged, key=lambda x: x[2]):
            kind = "located" if law == "located" else "smoothed, implicit" if "Radau" in how else "smoothed, explicit"
            if error < asked and kind not in best:
                law_words = "" if law == "located" else f", {law}"
                best[kind] = f"{count:,} ({how}{law_words}; {abs(angles[-1] - angles[-11]):.0e} rad in the last second)"
        for kind in ("located", "smoothed, implicit", "smoothed, explicit"):
            table.add(f"  {asked:.0e}  {kind:18}  {best.get(kind, 'none of the settings tried')}")


def slipping_chain(links, friction, steps):
    """Returns the deck of links in a row that turn in turns: every pin slips."""
    text, x = f"&scene gravity=0.0,-{G} /\n", np.zeros(2)
    for k in range(links):
        angle, rate = -1.2 - 0.5 * (-1) ** k, -3.0 * (-1) ** k
        other = f"body_b='b{k - 1}' point_b=0.1,0.0" if k else ""
        keys = f"friction={friction} pin_radius=0.01" if friction else ""
        text += f"&body name='b{k}' mass=0.1 inertia=1e-4 com=0.05,0.0 position={x[0]:.17g},{x[1]:.17g} angle={angle} "
        text += f"angular_velocity={rate} /\n&joint name='j{k}' type='revolute' body_a='b{k}' {other} {keys} /\n"
        x = x + 0.1 * np.array([np.cos(angle), np.sin(angle)])
    end = f"t_end={steps * 1e-7:.17g} output_step={steps * 1e-7:.17g}"
    return text + f"&sensor name='a' quantity='angle' body='b0' /\n&transient method='rk4' step=1e-7 {end} /\n"


def seconds_of(program, deck):
    """Returns the least processor time of three runs."""
    times = []
    for _ in range(3):
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "d.nml").write_text(deck)
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            subprocess.run([program, "--quiet", "--output", "o", "d.nml"], cwd=folder, check=True, capture_output=True)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
        times.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return min(times)


def friction_cost(table, program):
    """Adds the table: processor time of a step of rk4 with all pins slipping, beside pins without friction."""
    table.add()
    table.add("friction in every pin of a chain, all slipping: microseconds of a step of rk4, and those without friction")
    for links in (10, 30, 100):
        found = []
        for friction in (0.1, 0.0):
            few, many = (seconds_of(program, slipping_chain(links, friction, n)) for n in (100, 100 + 100000 // links))
            found.append((many - few) / (100000 // links) * 1e6)
        table.add(f"  {links:4} pins  {found[0]:8.1f}  {found[1]:8.1f}  {found[0] / found[1]:5.1f}")


class Printed:
    """A table that is printed at once."""

    def add(self, line=""):
        """Prints a line."""
        print(line, flush=True)


if __name__ == "__main__":
    friction_trade(Printed(), Path(sys.argv[1]).resolve())
    friction_cost(Printed(), Path(sys.argv[1]).resolve())
