#!/usr/bin/env python3
"""The flexible slider-crank of the IVP test set: error against its converged history and cost, for every method.

Runs input/ivp_slider_crank.nml with several meshes, methods and steps; prints the table and draws error against seconds. The
converged history (linear elasticity, by an independent program) is tests/reference/published/crank_conv_lin_ini2.csv.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import command
import deck_models
import matplotlib.pyplot as plt
import numpy as np
from deck_runs import InterruptedRunsError, Outcome, Runner, RunsError
from deck_text import DeckError, DeckText, read
from histories import History, HistoryError
from histories import read as read_history
from tradeoff_settings import FAMILIES, Setting, grid_of, with_setting

COLUMNS = {"rod": "phi2", "slider.x": "x3", "mid.v": "wmid_local"}
MESHES = (2, 4, 8, 16)
ASKED = {"rod", "slider", "mid", "motor"}


def errors(run: Outcome, reference: History) -> list[float]:
    """Return the largest error of rod angle, slider and mid-rod deflection, each over its range."""
    found = []
    for ours, theirs in COLUMNS.items():
        mine = run.data[:, 1 + run.names.index(ours)]
        found.append(float(np.abs(mine - reference[theirs]).max() / np.ptp(reference[theirs])))
    return found


def settings(family: str) -> list[Setting]:
    """Return the ladder of a method: steps of the output interval over 4 to 1024, tolerances from 1e-3 to 1e-9."""
    if FAMILIES[family][1] == "tolerance":
        return [Setting(family, k) for k in range(2, 16, 2)]
    first = Setting(family, 3)
    ladder = [first]
    while len(ladder) < 9:
        ladder.append(ladder[-1].doubled())
    return ladder


def rows(
    runner: Runner, deck: DeckText, families: list[str], reference: History
) -> list[tuple[int, str, Setting, Outcome, list[float]]]:
    """Return (elements, family, setting, outcome, errors) of every run that the solver accepts."""
    grid = grid_of(deck)
    plan = [(n, f, s) for n in MESHES for f in families for s in settings(f)]
    meshes = {n: deck_models.with_elements(deck, "rod", n, ASKED) for n in MESHES}
    texts = [with_setting(meshes[n], s, grid, grid.interval).text for n, _, s in plan]
    outcomes = runner.all(texts, "IVP slider-crank")
    runner.clear_line()
    return [(*p, o, errors(o, reference)) for p, o in zip(plan, outcomes) if o.ok]


def table(found: list, grid_words) -> str:
    """Return the table: the coarsest accepted run of each mesh and method, then ever finer ones."""
    head = f"{'rod angle':>9} {'slider':>9} {'mid-rod':>9} {'seconds':>9} {'evaluations':>11} {'solves':>9}"
    lines = [f"{'elements':>8}  {'setting':34} {head}"]
    for n, _, setting, o, (rod, slider, mid) in found:
        counts = f"{o.evaluations:11} {o.counts.get('solves', 0):9}"
        lines.append(f"{n:8}  {grid_words(setting):34} {rod:9.1e} {slider:9.1e} {mid:9.1e} {o.seconds:9.4f} {counts}")
    return "\n".join(lines)


def draw(found: list, path: Path) -> None:
    """Draw the error of the mid-rod deflection against seconds, one curve a mesh and method."""
    figure, axes = plt.subplots(figsize=(7.2, 4.6))
    marks = dict(zip(FAMILIES, "os^v"))
    for n in MESHES:
        for family in FAMILIES:
            mine = [(o.seconds, e[2]) for m, f, _, o, e in found if (m, f) == (n, family)]
            if mine:
                colour = f"C{MESHES.index(n)}"
                axes.loglog(*zip(*mine), marks[family] + "-", color=colour, ms=4, lw=1, label=f"{n} elements, {family}")
    axes.set_xlabel("seconds of the analysis")
    axes.set_ylabel("largest error of the mid-rod deflection / range")
    axes.set_title("Flexible slider-crank of the IVP test set, against its converged history", fontsize=10)
    axes.grid(which="major", alpha=0.3)
    axes.legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(path, dpi=100)
    plt.close(figure)


def main(words: list[str] | None = None) -> int:
    """Make the table and the picture; status 0, or 1 with one line on standard error."""
    parser = argparse.ArgumentParser(prog="ivp_crank.py", description=__doc__.split("\n")[0])
    parser.add_argument("--methods", nargs="+", choices=list(FAMILIES), default=list(FAMILIES), help="curves (all)")
    parser.add_argument("--output", type=Path, default=Path("results") / "ivp_crank", help="folder (%(default)s)")
    parser.add_argument("--biela", type=Path, default=Path("bin/biela"), help="the solver (%(default)s)")
    args = parser.parse_args(words)
    try:
        deck = read(Path("input") / "ivp_slider_crank.nml")
        reference = read_history(Path("tests") / "reference" / "published" / "crank_conv_lin_ini2.csv")
        runner = Runner(args.biela, args.output / "kept")
        found = rows(runner, deck, args.methods, reference)
        text = table(found, lambda s: s.words(grid_of(deck)))
        (args.output / "table.txt").write_text(text + "\n", encoding="utf-8")
        draw(found, args.output / "ivp_crank.png")
    except (DeckError, RunsError, HistoryError) as fault:
        print(f"ivp_crank: {fault}", file=sys.stderr)
        return 1
    except (InterruptedRunsError, KeyboardInterrupt):
        print("\nivp_crank: interrupted; what was run is kept", file=sys.stderr)
        return 130
    print(text)
    print(f"{args.output}/table.txt, ivp_crank.png")
    return 0


if __name__ == "__main__":
    command.run(main)
