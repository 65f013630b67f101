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
    columns = 4
    figure, axes = plt.subplots(
        -(-len(factors) // columns), columns, figsize=(15, 3.1 * -(-len(factors) // columns)), squeeze=False
    )
    for axis, factor in zip(axes.flat, factors):
        mine = [row for row in rows if row.case.factor == factor]
        for k, row in enumerate(mine):
            colour = "tab:green" if row.passed else "tab:red"
            if row.figure == row.figure:
                axis.semilogy(k, max(row.figure, 1e-17), "o", color=colour, ms=4)
                axis.semilogy([k - 0.4, k + 0.4], [row.case.limit] * 2, "-", color="0.3", lw=1)
            else:
                axis.semilogy(k, 1e3, "v" if row.case.status == 2 else "X", color=colour, ms=5)
        axis.set_title(factor, fontsize=9)
        axis.set_xticks(range(len(mine)), [row.case.value[:14] for row in mine], rotation=90, fontsize=5)
        axis.set_ylim(1e-18, 1e5)
        axis.tick_params(axis="y", labelsize=6)
    for axis in list(axes.flat)[len(factors) :]:
        axis.axis("off")
    figure.suptitle("Figure of each case (dot) and its limit (line); triangle: refused as stated, cross: stopped as stated")
    figure.tight_layout()
    figure.savefig(path, dpi=90)
    plt.close(figure)


def picture_of_mixtures(rows: list[Row], path: Path) -> None:
    """Draw the random mixtures: worst figure over what was stated, in order of size; refused ones counted."""
    figures = sorted(max(row.figure, 1e-17) for row in rows if row.figure == row.figure)
    refused = sum(row.case.status == 2 and row.passed for row in rows)
    figure, axis = plt.subplots(figsize=(7, 3.6))
    axis.semilogy(figures, ".", color="tab:green")
    axis.axhline(1.0, color="tab:red", lw=1, ls="--")
    axis.set_xlabel("mixtures that ran, in order")
    axis.set_ylabel("joints and energy / stated")
    axis.set_title(f"{len(rows)} random mixtures: {len(figures)} ran, {refused} refused with advice as stated", fontsize=10)
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
