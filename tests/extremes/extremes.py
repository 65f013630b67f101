#!/usr/bin/env python3
"""Numerical stability at the extremes: runs every case, holds it to what was stated beforehand, writes the report.

`make extremes` calls it from the project's root. results/extremes/ then holds report.txt, a row a case, and factors.png and
mixtures.png. Exit status 0 where every row is as stated, else 1. EXTREMES_SEED chooses other random mixtures.
"""

from __future__ import annotations

import os
import re
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "post"))

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from biela.plot import COLOURS
from extreme_cases import BIELA, Case, Row, judge
from extreme_factors import all_factors
from extreme_mixtures import COUNT, implicit_mixture, mixture

SEED = 2024
FOLDER = Path("results") / "extremes"
COLUMNS = 2
COLUMN, LABEL, LINE, TITLE = 4.2, 2.2, 0.16, 4  # width of a column, of its labels, height of a line [inch]; lines for a title
WRONG = COLOURS[1]
STYLES = {"rk4": (COLOURS[0], "o"), "dopri5": (COLOURS[3], "s"), "generalized_alpha": (COLOURS[2], "D"), "radau": (COLOURS[4], "^")}
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
    """Draw each factor's figures against their limits, a line of text a value; refusals and stops stand on the right edge."""
    factors = {name: [row for row in rows if row.case.factor == name] for name in dict.fromkeys(row.case.factor for row in rows)}
    columns: list[list[str]] = [[] for _ in range(COLUMNS)]
    lines = {name: len({line_of(row.case) for row in mine}) + TITLE for name, mine in factors.items()}
    for name in sorted(factors, key=lambda name: -lines[name]):
        min(columns, key=lambda column: sum(lines[n] for n in column)).append(name)
    tall = max(sum(lines[name] for name in column) for column in columns) + 2 * TITLE
    width = COLUMN * max(sum(map(bool, columns)), 1)
    figure = plt.figure(figsize=(width, tall * LINE))
    for k, column in enumerate(columns):
        top = 1.0 - 2.0 * TITLE / tall
        for name in (n for n in factors if n in column):
            height = (lines[name] - TITLE) / tall
            axis = figure.add_axes(((k * COLUMN + LABEL) / width, top - height, (COLUMN - LABEL - 0.15) / width, height))
            draw_factor(axis, factors[name])
            top -= lines[name] / tall
    marks = [plt.Line2D([], [], color=c, marker=m, ls="-", lw=1, label=n) for n, (c, m) in STYLES.items()]
    marks += [
        plt.Line2D([], [], color="0.3", marker=m, ls="", label=t)
        for m, t in ((">", "refused as stated"), ("X", "stopped as stated"), ("P", "warned as stated"))
    ]
    head = "a case's relative error [-] (mark) and its limit (line)"
    if not all(row.passed for row in rows):
        head += "; red circle: not as stated"
    figure.legend(handles=marks, loc="upper center", ncols=4, fontsize=9, title=head)
    figure.savefig(path, dpi=100)
    plt.close(figure)


def line_of(case: Case) -> str:
    """Return the words on a case's line of the picture: runs below and above a limit share one."""
    return re.sub(r"^(0\.95|1\.05) ", "", case.value)


def draw_factor(axis: plt.Axes, rows: list[Row]) -> None:
    """Draw one factor: its values above each other, the methods side by side where they refuse."""
    values = list(dict.fromkeys(line_of(row.case) for row in rows))
    for row in rows:
        y = values.index(line_of(row.case))
        colour, mark = STYLES[row.case.method]
        x = 1e2 * 30.0 ** list(STYLES).index(row.case.method)
        if row.figure == row.figure:
            x = max(row.figure, 1e-17)
            axis.plot(x, y, mark, color=colour, ms=4)
            axis.plot([row.case.limit] * 2, [y - 0.4, y + 0.4], "-", color=colour, lw=1.5)
        else:
            axis.plot(x, y, "PX>"[row.case.status], color=colour, ms=5)
        if not row.passed:
            axis.plot(x, y, "o", mec=WRONG, mfc="none", ms=10, mew=1.5)
    axis.set_title(rows[0].case.factor, fontsize=10)
    axis.set_xscale("log")
    axis.set_xlim(1e-18, 1e7)
    axis.set_xticks([10.0**k for k in range(-16, 5, 8)])
    axis.set_yticks(range(len(values)), values)
    axis.set_ylim(len(values) - 0.3, -0.7)
    axis.tick_params(labelsize=8)
    axis.grid(axis="x", lw=0.3)


def picture_of_mixtures(rows: list[Row], path: Path) -> None:
    """Draw the random mixtures: worst figure over what was stated, in order of size; refused ones counted."""
    figure, axis = plt.subplots(figsize=(8, 4))
    refused = sum(row.case.status == 2 and row.passed for row in rows)
    for method, (colour, mark) in STYLES.items():
        figures = sorted(max(row.figure, 1e-17) for row in rows if row.case.method == method and row.figure == row.figure)
        if figures:
            axis.semilogy(figures, mark, color=colour, ms=3, label=f"{method}: {len(figures)} ran")
    axis.axhline(1.0, color=WRONG, lw=1, ls="--", label="limit")
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
    makers = (mixture, implicit_mixture, partial(implicit_mixture, method="radau"))
    mixtures = [(maker, number) for maker in makers for number in range(COUNT)]
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
