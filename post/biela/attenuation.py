"""Damping in the rod, in the joint, in both (the decks slider_crank_joint_*), or what took the energy in any deck."""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from . import loss_picture
from .demo import RESULTS, deck, run, size
from .engineering import of_energy
from .histories import History, read, read_summary
from .picture_files import save
from .plot import COLOURS, LOOK, pretty_unit
from .result_files import HistoryError

CASES = {"none": "no damping", "rod": "viscoelastic rod", "joint": "viscoelastic joint", "both": "both"}
QUANTITIES = {"mid.q": "deflection of mid-rod", "mid.qd": "its velocity", "mid.qdd": "its acceleration"}
SWING = 6.0e-3  # the crank moves until then [s]


def deck_name(case: str) -> str:
    """Return the deck's name of one of the CASES."""
    return f"slider_crank_joint_{case}"


def table(runs: dict[str, History], columns: dict[str, str], swing: float = SWING) -> list[str]:
    """Return the lines of a table of peaks and root mean squares over all cases, each with its ratio to the first.

    Args:
        runs: history of each case, the undamped one first
        columns: words for each column
        swing: the root mean square is that of the ringing after this time [s]
    """
    lines = [f"{'':41}" + "".join(f"{CASES[case]:>22}" for case in runs)]
    for column, words in columns.items():
        values = {case: (size(h[column])[0], size(h[column][h.time > swing])[1]) for case, h in runs.items()}
        reference = next(iter(values.values()))
        unit = pretty_unit(next(iter(runs.values())).units[column])
        for k, measure in enumerate(("peak", "RMS")):
            row = "".join(f"{value[k]:>14.3e} ({value[k] / reference[k]:5.3f})" for value in values.values())
            lines.append(f"{words + f' [{unit}]':31}{measure:10}{row}")
    return lines


def energies(cases: list[str]) -> list[str]:
    """Return the lines that say what was dissipated in each case and what the motor put in at most [J]."""
    balance = {case: read(RESULTS / deck_name(case), "energy") for case in cases}
    dissipated = "".join(f"{e['dissipated'][-1]:>22.4g}" for e in balance.values())
    work = "".join(f"{e['work'].max():>22.4g}" for e in balance.values())
    return [f"{'energy dissipated [J]':41}{dissipated}", f"{'largest work of the motor [J]':41}{work}"]


def picture(runs: dict[str, History], columns: dict[str, str]) -> Path:
    """Draw one row of panels a column and one panel a case, all of a row on one scale, the undamped one behind each."""
    with plt.rc_context(LOOK):
        figure, axes = plt.subplots(
            len(columns), len(runs), figsize=(12.0, 0.9 + 2.1 * len(columns)), sharex=True, sharey="row", layout="constrained"
        )
        reference = next(iter(runs.values()))
        for row, (column, words) in zip(axes, columns.items()):
            for axis, case, colour in zip(row, runs, COLOURS):
                axis.axvspan(0.0, 1e3 * SWING, color="#f2f2f2", linewidth=0)
                if case != next(iter(runs)):
                    axis.plot(1e3 * reference.time, reference[column], color="#c3cbe0", linewidth=0.7)
                axis.plot(1e3 * runs[case].time, runs[case][column], color=colour, linewidth=0.9)
                axis.margins(x=0.0)
            row[0].set_ylabel(f"{words}\n[{pretty_unit(reference.units[column])}]")
        for axis, case in zip(axes[0], runs):
            axis.set_title(CASES[case], fontsize=10)
        for axis in axes[-1]:
            axis.set_xlabel("t [ms]")
        figure.suptitle("Slider-crank: damping in the rod, in the joint, in both (the crank swings in the grey band, then stands)")
    return save(figure, RESULTS / "joints" / "attenuation")


def tabulate(biela: Path) -> int:
    """Run the four cases, print the table, draw the picture; raises HistoryError."""
    run(biela, [deck(deck_name(case)) for case in CASES])
    runs = {case: read(RESULTS / deck_name(case)) for case in CASES}
    if any(not np.array_equal(h.time, runs["none"].time) for h in runs.values()):
        raise HistoryError("the four decks do not have the same output times")
    print("Slider-crank with a bush between crank and rod")
    print("RMS: of the ringing after the swing; in brackets: ratio to no damping\n")
    print("\n".join(table(runs, QUANTITIES) + energies(list(CASES))) + "\n")
    drawn = picture(runs, QUANTITIES)
    print(f"Picture: {drawn}")
    return 0


def causes(biela: Path, decks: list[Path]) -> int:
    """Run decks; print what took the energy of each, friction, stops, materials, and draw it; raises HistoryError."""
    run(biela, decks)
    for path in decks:
        folder = RESULTS / path.stem
        balance = read(folder, "energy")
        transient = read_summary(folder).get("transient", {})
        print(f"{path.stem}")
        print("\n".join(f"  {words:40}{value}" for words, value in of_energy(balance, transient)))
        if figure := loss_picture.draw(balance, transient):
            print(f"  Picture: {save(figure, folder / 'losses')}")
    return 0


def work(args: argparse.Namespace) -> int:
    """Run the decks or the four cases; returns 0."""
    return causes(args.biela, args.decks) if args.decks else tabulate(args.biela)
