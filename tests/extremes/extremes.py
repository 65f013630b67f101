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
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "post"))

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from biela.plot import COLOURS, LOOK
from extreme_cases import BIELA, Case, Row, judge
from extreme_factors import all_factors
from extreme_mixtures import COUNT, implicit_mixture, mixture

SEED = 2024
FOLDER = Path("results") / "extremes"
LEAST = 1e-12  # share of its limit below which a figure is drawn as this
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
    """Draw each factor's figures over their limits, a line a factor; how many cases were refused or stopped stands at its end."""
    factors = list(dict.fromkeys(row.case.factor for row in rows))
    with plt.rc_context(LOOK):
        figure, axis = plt.subplots(figsize=(8.0, 0.27 * len(factors) + 1.4), layout="constrained")
        for k, (method, (colour, mark)) in enumerate(STYLES.items()):
            mine = [row for row in rows if row.case.method == method and row.figure == row.figure]
            places = [factors.index(row.case.factor) + 0.2 * (k - 1.5) for row in mine]
            shares = [share(row) for row in mine]
            axis.semilogx(shares, places, mark, color=colour, ms=4, mec="none", alpha=0.7, label=method)
        axis.axvline(1.0, color="black", lw=1.0, ls="--", label="what was stated")
        wrong = [row for row in rows if not row.passed]
        for row in wrong:
            axis.plot(share(row), factors.index(row.case.factor), "o", mec=WRONG, mfc="none", ms=11, mew=1.5)
        told = axis.secondary_yaxis("right")
        for one, words in ((axis, factors), (told, [refused(rows, factor) for factor in factors])):
            one.set_yticks(range(len(factors)), words, fontsize=9)
            one.tick_params(length=0)
        axis.set_ylim(len(factors) - 0.4, -0.6)
        axis.set_xlabel(f"figure of a case / its limit (least drawn: {LEAST:g})")
        figure.legend(loc="outside lower center", ncols=5)
        figure.suptitle(f"{len(rows)} cases, {len(rows) - len(wrong)} as stated" + " (circles: not)" * bool(wrong), fontsize=10)
    figure.savefig(path, dpi=100)
    plt.close(figure)


def share(row: Row) -> float:
    """Return a figure over its limit as it is drawn; at the line where there is none, or no limit but zero and more than that."""
    if row.case.limit > 0.0 and row.figure == row.figure:
        return max(row.figure / row.case.limit, LEAST)
    return LEAST if row.passed else 1.0


def refused(rows: list[Row], factor: str) -> str:
    """Return how many cases of a factor were told in words, as stated, instead of giving a figure."""
    count = sum(row.case.factor == factor and row.figure != row.figure and row.passed for row in rows)
    return f"{count} refused or told" if count else ""


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
