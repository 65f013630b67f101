"""Where the energy of a run went: friction, stops, viscoelastic materials and dampers, over time and by cause, in one picture."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np

from .engineering import losses
from .histories import History
from .plot import COLOURS, LOOK

DAMPING = "materials and dampers"
GROUPS = {DAMPING: COLOURS[0], "friction": COLOURS[1], "stops": COLOURS[3]}  # from the bottom to the top
MOST_BARS = 12


def group_of(cause: str) -> str:
    """Return to which of the groups a cause belongs."""
    return "stops" if cause.startswith("stop ") else "friction" if cause.startswith("friction ") else DAMPING


def parts(table: History) -> dict[str, np.ndarray]:
    """Return what each group has lost at each time [J], as far as it has lost anything; their sum is what was dissipated."""
    found = {name: np.asarray(table[name]) for name in ("friction", "stops") if name in table.names}
    found[DAMPING] = np.asarray(table["dissipated"]) - sum(found.values(), np.zeros(len(table.time)))
    rounding = 1e-9 * float(np.abs(table["dissipated"]).max())
    return {name: found[name] for name in GROUPS if name in found and np.abs(found[name]).max() > rounding}


def draw(table: History, transient: dict) -> plt.Figure | None:
    """Draw the energies lost over time, one on top of the other, and what each cause has taken by the end; None without losses."""
    shown = parts(table)
    causes = sorted(((sum(each.values()), cause) for cause, each in losses(table, transient).items()), reverse=True)[:MOST_BARS]
    if not shown or not causes:
        return None
    total = float(table["dissipated"][-1])
    with plt.rc_context(LOOK):
        size = (8.0, max(2.6, 1.1 + 0.28 * len(causes)))
        figure, (left, right) = plt.subplots(1, 2, figsize=size, layout="constrained", width_ratios=(1.0, 1.0))
        left.stackplot(table.time, *shown.values(), colors=[GROUPS[name] for name in shown], linewidth=0)
        left.margins(x=0.0)
        left.set_xlabel("t [s]")
        left.set_ylabel("energy lost [J]")
        heights = np.arange(len(causes))[::-1]
        right.barh(heights, [energy for energy, _ in causes], color=[GROUPS[group_of(cause)] for _, cause in causes])
        right.set_yticks(heights, [cause for _, cause in causes])
        for height, (energy, _) in zip(heights, causes):
            words = f" {energy:.3g} J, {100.0 * energy / total:.3g} %" if total > 0.0 else f" {energy:.3g} J"
            right.annotate(words, (max(energy, 0.0), height), va="center", fontsize=8)
        right.margins(x=0.45)
        right.set_xlim(left=min(0.0, *(energy for energy, _ in causes)))
        right.set_xlabel("lost by the end [J]")
        right.grid(visible=False, axis="y")
        handles = [plt.Rectangle((0, 0), 1, 1, color=GROUPS[name]) for name in shown]
        words = [f"{name}: {100.0 * energy[-1] / total:.3g} %" if total > 0.0 else name for name, energy in shown.items()]
        figure.legend(handles, words, loc="outside upper center", ncols=len(shown))
    return figure
