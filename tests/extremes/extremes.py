#!/usr/bin/env python3
"""Numerical stability at the extremes: runs every case, holds it to what was stated beforehand, writes the report.

`make extremes` calls it from the project's root. results/extremes/ then holds report.txt, a row a case, and factors.png and
mixtures.png. Exit status 0 where every row is as stated, else 1. EXTREMES_SEED chooses other random mixtures.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "post"))

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from extreme_cases import BIELA, Case, Row, judge
from extreme_factors import all_factors
from extreme_mixtures import COUNT, implicit_mixture, mixture

SEED = 2024
FOLDER = Path("results") / "extremes"
COLUMNS = 3
STYLES = {"rk4": ("tab:blue", "o"), "dopri5": ("tab:orange", "s"), "generalized_alpha": ("tab:green", "D")}
Maker = Callable[[int, int], Case]


def bar(done: int, count: int, began: float) -> None:
    """Draw the progress bar on a terminal."""
    if sys.stderr.isatty():
        drawn = ("#" * (30 * done // count)).ljust(30, ".")
        print(f"\r[{drawn}] {done}/{count} cases, {time.monotonic() - began:.0f} s ", end="", file=sys.stderr, flush=True)


def run(cases: list[Case | tuple[Maker, int]], seed: int) -> list[Row]:
    """Judge cases, or numbers of random mixtures with what makes them, on the cores at hand; the rows in their order."""
    began, rows = time.monotonic(), []
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for row in pool.map(lambda case: judge(case if isinstance(case, Case) else case[0](seed, case[1])), cases):
            rows.append(row)
            bar(len(rows), len(cases), began)
    return rows


def text(rows: list[Row], seed: int, seconds: float) -> str:
    """Return the report."""
    bad = sum(not row.passed for row in rows)
    lines = [
        "Numerical stability at the extremes",
        "",
        f"{len(rows)} cases, {len(rows) - bad} as stated, {bad} not; random mixtures of seed {seed}; {seconds:.0f} s",
    ]
    for factor in dict.fromkeys(row.case.factor for row in rows):
        mine = [row for row in rows if row.case.factor == factor]
        kept = sum(row.passed for row in mine)
        lines += [
            "",
            f"{factor}: {kept} of {len(mine)} as stated",
            f"  {'value':28} {'method':17} {'stated beforehand':58} {'limit':>6}  found",
        ]
        for row in mine:
            c = row.case
            limit = f"{c.limit:6.0e}" if c.measure else " " * 6
            mark = "" if row.passed else "  NOT AS STATED"
            lines.append(f"  {c.value:28} {c.method:17} {c.expected:58} {limit}  {row.outcome}{mark}")
    return "\n".join(lines) + "\n"


def picture_of_factors(rows: list[Row], path: Path) -> None:
    """Draw each factor's figures against their limits; refusals and stops stand on the upper edge."""
    factors = list(dict.fromkeys(row.case.factor for row in rows))
    lines = 1 + -(-(len(factors) - 1) // COLUMNS)
    figure = plt.figure(figsize=(14, 2.7 * lines), layout="constrained")
    grid = figure.add_gridspec(lines, COLUMNS)
    for k, factor in enumerate(factors):
        mine = [row for row in rows if row.case.factor == factor]
        draw_factor(figure.add_subplot(grid[0, :] if k == 0 else grid[1 + (k - 1) // COLUMNS, (k - 1) % COLUMNS]), mine)
    marks = [plt.Line2D([], [], color=c, marker=m, ls="-", lw=1, label=f"{n}: figure and limit") for n, (c, m) in STYLES.items()]
    marks += [
        plt.Line2D([], [], color="0.3", marker=m, ls="", label=t)
        for m, t in (("v", "refused as stated"), ("X", "stopped as stated"), ("P", "warned as stated"))
    ]
    marks += [plt.Line2D([], [], color="tab:red", marker="o", ls="", label="not as stated")]
    figure.legend(handles=marks, loc="outside upper center", ncols=len(marks), fontsize=9)
    figure.savefig(path, dpi=90)
    plt.close(figure)


def draw_factor(axis: plt.Axes, rows: list[Row]) -> None:
    """Draw one factor: its values side by side, the methods above each other."""
    values = list(dict.fromkeys(row.case.value for row in rows))
    for row in rows:
        x = values.index(row.case.value)
        colour, mark = STYLES[row.case.method]
        shown = colour if row.passed else "tab:red"
        if row.figure == row.figure:
            axis.semilogy(x, max(row.figure, 1e-17), mark, color=shown, ms=4)
            axis.semilogy([x - 0.4, x + 0.4], [row.case.limit] * 2, "-", color=colour, lw=1)
        else:
            height = 1e2 * 30.0 ** list(STYLES).index(row.case.method)
            axis.semilogy(x, height, "PXv"[row.case.status], color=shown, ms=5)
    axis.set_title(rows[0].case.factor, fontsize=10)
    axis.set_xticks(range(len(values)), [value[:20] for value in values], rotation=90, fontsize=7 if len(values) < 40 else 6)
    axis.set_xlim(-0.7, len(values) - 0.3)
    axis.set_ylim(1e-18, 1e7)
    axis.set_yticks([10.0**k for k in range(-16, 5, 4)])
    axis.tick_params(axis="y", labelsize=7)
    axis.grid(axis="y", lw=0.3)


def picture_of_mixtures(rows: list[Row], path: Path) -> None:
    """Draw the random mixtures: worst figure over what was stated, in order of size; refused ones counted."""
    figure, axis = plt.subplots(figsize=(8, 4))
    refused = sum(row.case.status == 2 and row.passed for row in rows)
    for method, (colour, mark) in STYLES.items():
        figures = sorted(max(row.figure, 1e-17) for row in rows if row.case.method == method and row.figure == row.figure)
        if figures:
            axis.semilogy(figures, mark, color=colour, ms=3, label=f"{method}: {len(figures)} ran")
    axis.axhline(1.0, color="tab:red", lw=1, ls="--", label="limit")
    axis.set_xlabel("mixtures that ran, in order")
    axis.set_ylabel("worst of joints and energy / limit")
    axis.set_title(f"{COUNT} random mixtures; rk4 refused {refused} steps above its bound, as stated", fontsize=10)
    axis.legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(path, dpi=90)
    plt.close(figure)


def main() -> int:
    """Run all cases, write the report; the exit status."""
    if not os.access(BIELA, os.X_OK):
        print(f"extremes: {BIELA} is missing: `make` builds it", file=sys.stderr)
        return 2
    seed, began = int(os.environ.get("EXTREMES_SEED", SEED)), time.monotonic()
    print(f"numerical stability at the extremes; random mixtures of seed {seed}")
    factors = all_factors()
    mixtures = [(maker, number) for maker in (mixture, implicit_mixture) for number in range(COUNT)]
    rows = run([*factors, *mixtures], seed)
    report = text(rows, seed, time.monotonic() - began)
    FOLDER.mkdir(parents=True, exist_ok=True)
    (FOLDER / "report.txt").write_text(report, encoding="utf-8")
    picture_of_factors(rows[: len(factors)], FOLDER / "factors.png")
    picture_of_mixtures(rows[len(factors) :], FOLDER / "mixtures.png")
    bad = [row for row in rows if not row.passed]
    for row in bad:
        print(f"NOT AS STATED: {row.case.factor}, {row.case.value}: stated: {row.case.expected}; found: {row.outcome}")
    print(report.splitlines()[2])
    print(f"{FOLDER}/report.txt, factors.png, mixtures.png")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
