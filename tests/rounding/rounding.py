#!/usr/bin/env python3
"""How many digits of the reference scenes depend on rounding: the four IEEE modes, fused operations, another compiler.

`make rounding` calls it, after building the variants; results/rounding.txt then holds a table: digits of the worst column of
history.txt (its largest difference over its range) that agree with those of the ordinary build in the ordinary mode.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
MODES = {"upward": "FE_UPWARD", "downward": "FE_DOWNWARD", "toward zero": "FE_TOWARDZERO"}
MODE = "#include <fenv.h>\n__attribute__((constructor)) static void begin(void) { fesetround(%s); }\n"


def columns(biela: Path, deck: Path, folder: Path, library: Path | None = None) -> np.ndarray:
    """Return the rows of a deck's history."""
    environment = {**os.environ, **({"LD_PRELOAD": str(library)} if library else {})}
    command = [str(biela), "--quiet", "--output", str(folder / "out"), str(deck)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"rounding: {deck} ended with status {done.returncode}: {done.stderr}")
    return np.loadtxt(folder / "out" / "history.txt", ndmin=2)


def digits(a: np.ndarray, b: np.ndarray) -> float:
    """Return the digits to which the worst column agrees: of its range, or of its largest value where it hardly changes."""
    if a.shape != b.shape:
        return 0.0
    scale = np.maximum(np.ptp(a, axis=0), 1e-9 * np.abs(a).max())
    worst = (np.abs(a - b).max(axis=0) / np.where(scale > 0, scale, 1.0)).max()
    return min(16.0, -np.log10(max(worst, 1e-16)))


def main() -> int:
    """Run the references in all variants, write the table; exit status 1 where fewer digits agree than asked for."""
    programs = {Path(name).name.replace("biela-", ""): Path(name).resolve() for name in sys.argv[2:] if Path(name).exists()}
    ordinary, least = Path(sys.argv[1]).resolve(), float(os.environ.get("ROUNDING_DIGITS", "5"))
    decks = sorted((ROOT / "tests" / "reference").glob("*/deck.nml"))
    rows = [f"{'digits that agree':24}" + "".join(f"{name:>14}" for name in [*MODES, *programs])]
    bad = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        libraries = []
        for mode in MODES.values():
            (folder / "mode.c").write_text(MODE % mode)
            libraries.append(folder / f"{mode}.so")
            subprocess.run(["gcc", "-shared", "-fPIC", "-o", str(libraries[-1]), str(folder / "mode.c"), "-lm"], check=True)
        for deck in decks:
            plain = columns(ordinary, deck, folder)
            found = [digits(plain, columns(ordinary, deck, folder, library)) for library in libraries]
            found += [digits(plain, columns(program, deck, folder)) for program in programs.values()]
            bad += sum(figure < least for figure in found)
            rows.append(f"{deck.parent.name:24}" + "".join(f"{figure:14.1f}" for figure in found))
            print(rows[-1], flush=True)
    (ROOT / "results").mkdir(exist_ok=True)
    (ROOT / "results" / "rounding.txt").write_text("\n".join(rows) + "\n", encoding="utf-8")
    print(rows[0], f"results/rounding.txt; {bad} below {least:g} digits", sep="\n")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
