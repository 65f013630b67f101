"""The flexible slider-crank of the IVP test set: error and cost of every method."""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from . import command, deck_models, labels
from .deck_runs import InterruptedRunsError, Outcome, Runner
from .deck_text import DeckText, read
from .histories import History
from .histories import read as read_history
from .tradeoff_settings import FAMILIES, Setting, grid_of, with_setting

COLUMNS = {"rod": "phi2", "slider.x": "x3", "mid.v": "wmid_local"}
MESHES = (2, 4, 8, 16)
ASKED = {"rod", "slider", "mid", "motor"}
RADII = (0.9, 0.5, 0.0)  # of generalized_alpha


@dataclass(frozen=True)
class Row:
    """A run: its mesh, curve, setting in words, what it gave, and its errors (rod angle, slider, deflection)."""

    elements: int
    curve: str
    setting: str
    outcome: Outcome
    errors: list[float]


def errors(run: Outcome, reference: History) -> list[float]:
    """Return the largest error of rod angle, slider and mid-rod deflection, each over its range."""
    found = []
    for ours, theirs in COLUMNS.items():
        mine = run.data[:, 1 + run.names.index(ours)]
        found.append(float(np.abs(mine - reference[theirs]).max() / np.ptp(reference[theirs])))
    return found


def settings(family: str) -> list[Setting]:
    """Return the ladder of a method.

    Explicit steps go from the output interval over 4 to that over 1024, implicit ones from the interval to its 256th part;
    tolerances fall from 1e-3 by tens, seven times.
    """
    implicit = FAMILIES[family][0] == "generalized_alpha"
    if FAMILIES[family][1] == "tolerance":
        return [Setting(family, k) for k in range(2, 16, 2)]
    ladder = [Setting(family, 0 if implicit else 3)]
    while len(ladder) < 9:
        ladder.append(ladder[-1].doubled())
    return ladder


def variants(families: list[str]) -> list[tuple[str, float | None]]:
    """Return (family, spectral radius) of each curve; the fixed-step implicit method has one curve for each of `RADII`."""
    found: list[tuple[str, float | None]] = []
    for family in families:
        fixed = family == "generalized_alpha"
        found += [(family, radius) for radius in RADII] if fixed else [(family, None)]
    return found


def with_radius(deck: DeckText, radius: float | None) -> DeckText:
    """Return a deck with a spectral radius, as it is without one."""
    return deck if radius is None else deck.set(deck.one("transient"), spectral_radius=f"{radius:g}")


def rows(runner: Runner, deck: DeckText, families: list[str], reference: History) -> list[Row]:
    """Return every run that the solver accepts."""
    grid = grid_of(deck)
    plan = [(n, f, r, s) for n in MESHES for f, r in variants(families) for s in settings(f)]
    meshes = {n: deck_models.with_elements(deck, "rod", n, ASKED) for n in MESHES}
    texts = [with_radius(with_setting(meshes[n], s, grid, grid.interval), r).text for n, _, r, s in plan]
    outcomes = runner.all(texts, "IVP slider-crank")
    runner.progress.clear()
    return [
        Row(n, f"{f}, radius {r:g}" if r is not None else f, s.words(grid), o, errors(o, reference))
        for (n, f, r, s), o in zip(plan, outcomes)
        if o.ok
    ]


def table(found: list[Row]) -> str:
    """Return the table: by mesh and curve, from the coarsest run that the solver accepts to the finest."""
    head = f"{'rod angle':>9} {'slider':>9} {'mid-rod':>9} {'seconds':>9} {'evaluations':>11} {'solves':>9}"
    lines = [f"{'elements':>8}  {'curve':29} {'setting':36} {head}"]
    for row in found:
        o, (rod, slider, mid) = row.outcome, row.errors
        counts = f"{o.evaluations:11} {o.counts.get('solves', 0):9}"
        figures = f"{rod:9.1e} {slider:9.1e} {mid:9.1e} {o.seconds:9.4f} {counts}"
        lines.append(f"{row.elements:8}  {row.curve:29} {row.setting:36} {figures}")
    return "\n".join(lines)


def draw(found: list[Row], path: Path) -> None:
    """Draw the error of the mid-rod deflection against evaluations, one curve a mesh and method (spectral radius 0.9)."""
    figure, axes = plt.subplots(figsize=(8.0, 4.8), layout="constrained")
    marks = dict(zip(FAMILIES, "os^vDP"))
    ends = []
    for n in MESHES:
        colour = f"C{MESHES.index(n)}"
        for family in FAMILIES:
            mine = [r for r in found if r.elements == n and r.curve in (family, f"{family}, radius {RADII[0]:g}")]
            if mine:
                points = [(r.outcome.evaluations, r.errors[2]) for r in mine]
                axes.loglog(*zip(*points), marks[family] + "-", color=colour, ms=4, lw=1)
                ends.append((*max(points), n, colour))
    last = {n: max(end for end in ends if end[2] == n) for n in dict.fromkeys(end[2] for end in ends)}
    names = [labels.Label(np.array([x, y]), f"{n} elements", colour) for x, y, n, colour in last.values()]
    axes.set_xlabel("evaluations of the equations of motion (implicit: Newton iterations)")
    axes.set_ylabel("largest error of the mid-rod deflection / range")
    axes.set_title("Flexible slider-crank of the IVP test set, against its converged history", fontsize=10)
    axes.grid(which="major", alpha=0.3)
    handles = [plt.Line2D([], [], color="0.3", marker=mark, ms=4, lw=1, label=family) for family, mark in marks.items()]
    figure.legend(handles=handles, fontsize=8, ncols=3, loc="outside lower center")
    labels.write(axes, names)
    figure.savefig(path, dpi=100)
    plt.close(figure)


def work(args: argparse.Namespace) -> int:
    """Make the table and the picture; returns 0, or 130 where it is interrupted."""
    try:
        deck = read(command.ROOT / "input" / "ivp_slider_crank.nml")
        reference = read_history(command.ROOT / "tests" / "reference" / "published" / "crank_conv_lin_ini2.csv")
        runner = Runner(args.biela, args.output / "kept")
        found = rows(runner, deck, args.methods, reference)
        text = table(found)
        (args.output / "table.txt").write_text(text + "\n", encoding="utf-8")
        draw(found, args.output / "ivp_crank.png")
    except (InterruptedRunsError, KeyboardInterrupt):
        print("\nivp_crank: interrupted; what was run is stored", file=sys.stderr)
        return 130
    print(text)
    print(f"{args.output}/table.txt, ivp_crank.png")
    return 0
