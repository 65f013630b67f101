"""Many steps, loads from nothing to absurd, other units, drives that cannot be followed."""

from __future__ import annotations

import math
import re

from extreme_cases import Case, call, safe_bound
from extreme_measures import away, largest, opening, residual, same
from extreme_scenes import cantilever, crank, oscillator, pendulum, transient


def many_steps() -> list[Case]:
    """Return a million steps."""
    deck, unit = pendulum()
    rigid = deck + transient(2000.0 * unit, 0.002 * unit, 200)
    deck, unit = pendulum(body="flexible")
    h = min(0.5 * safe_bound(deck), 0.002 * unit)
    flexible = deck + transient(1e6 * h, h, 200)
    return [
        Case("steps", "1e6, rigid", rigid, "joints closed to 1e-12 m", measure=opening, limit=1e-12),
        Case("steps", "1e6, rigid, energy", rigid, "energy kept to 1e-8", measure=residual, limit=1e-8),
        Case("steps", "1e6, flexible", flexible, "joints closed to 1e-12 m", measure=opening, limit=1e-12),
    ]


def loads() -> list[Case]:
    """Return gravity and torques from nothing to absurd."""
    deck, unit = pendulum()
    kept = call(deck + transient(5.0 * unit, 1e-3 * unit)).history["rod"]
    found = []
    for k in (-12, -6, 6, 12):
        deck, unit = pendulum(gravity=10.0**k)
        run = deck + transient(5.0 * unit, 1e-3 * unit)
        found.append(
            Case("gravity [m/s2]", f"1e{k}", run, "the same swing in its own time", measure=same("rod", kept, 1.0), limit=1e-8)
        )
    deck = pendulum(gravity=0.0)[0] + transient(1.0, 1e-3)
    found.append(Case("gravity [m/s2]", "0", deck, "stays there", measure=largest, limit=1e-14))
    for k in (-12, -6, 0, 6, 12):
        free = re.sub("&spring.*\n", "", oscillator([], moment=10.0**k))
        disc = free + transient(1.0, 1e-3)
        exact = away("disc", lambda t, m=10.0**k: 0.5 * m * t**2, 0.5 * 10.0**k)
        found.append(Case("torque [N m]", f"1e{k}", disc, "turns as M t^2/2J within 1e-9", measure=exact, limit=1e-9))
    deck, period, _ = cantilever(more="axial=.false.")
    for force, told, status, said in (
        (4.0e2, "runs, warns that the floating frame no longer holds", 0, "floating frame no longer holds"),
        (1.0e9, "stops, says that the deflection is absurd", 1, "deflects by more than a thousand times"),
    ):
        more = f"&force name='more' type='force' body='beam' node=-1 fy={force} /\n&force name='tip'"
        run = deck.replace("&force name='tip'", more) + transient(2.0 * period, period / 2000)
        found.append(Case("force on a beam", f"{force:g} N", run, told, status, said))
    return found


def units() -> list[Case]:
    """Return the same scene in micrometres and megametres, microseconds and days."""
    deck, unit = pendulum(body="flexible")
    kept = call(deck + transient(3.0 * unit, 2e-4 * unit)).history["rod"]
    found = []
    for name, length, gravity in (
        ("micrometres", 1e-6, 9.81),
        ("millimetres", 1e-3, 9.81),
        ("kilometres", 1e3, 9.81),
        ("megametres", 1e6, 9.81),
        ("microseconds", 1.0, 1e12),
        ("days", 1.0, 1e-10),
        ("millimetres in microseconds", 1e-3, 1e9),
        ("kilometres in days", 1e3, 1e-7),
    ):
        deck, unit = pendulum(length, gravity, body="flexible")
        run = deck + transient(3.0 * unit, 2e-4 * unit)
        found.append(Case("units", name, run, "the same swing in its own units", measure=same("rod", kept, 1.0), limit=1e-8))
    return found


def drives() -> list[Case]:
    """Return drives that cannot be followed."""
    disc = oscillator([]).replace("&force", "&drive name='motor' type='rotation' body_a='disc' history='h' /\n&force")
    run = transient(1.0, 1e-3)
    arm = crank(0.5, 0.0) + "&drive name='push' type='position' body_a='rod' point_a=3.0,0.0 direction=0.0 history='h' /\n"
    far = "&history name='h' kind='ramp' start_value={start:.16e} end_value=6.0 start=0.0 finish=1.0 /\n"
    start = math.cos(0.5) + math.sqrt(9.0 - math.sin(0.5) ** 2)
    return [
        Case(
            "drive",
            "a jump",
            disc + "&history name='h' kind='pulse' value=1.0 start=0.3 finish=0.6 /\n" + run,
            "refused, names the time",
            2,
            r"jump.*(0?\.3|3\.0*E-01)|(0?\.3|3\.0*E-01).*jump",
        ),
        Case(
            "drive",
            "a corner",
            disc + "&history name='h' kind='table' time=0.0,0.3,0.6 value=0.0,1.0,0.0 /\n" + run,
            "refused, names the time",
            2,
            r"slope|jump",
        ),
        Case(
            "drive",
            "beyond reach",
            arm + far.format(start=start) + run,
            "stops, names what opens",
            1,
            r"beyond the reach of the mechanism",
        ),
        Case(
            "drive",
            "beyond reach at the start",
            arm + far.format(start=7.0).replace("end_value=6.0", "end_value=8.0") + run,
            "refused, names the joints",
            2,
            r"push|pin|guide",
        ),
    ]
