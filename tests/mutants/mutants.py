#!/usr/bin/env python3
"""Mutants: small mistakes planted in src/, one at a time; which of them no test notices?

`make mutants` calls it; results/mutants.txt lists the survivors. Each mistake is made in a copy of the sources, built there
(what the mistake does not touch is not compiled again) and met by the tests that name the file, then by the others, until one
fails. MUTANTS= says how many, SEED= which; what no longer compiles is not counted. MUTANT_FILES= limits the files by a pattern.
"""

from __future__ import annotations

import os
import random
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
COPY = ROOT / "build" / "mutants"
SHARED = [
    "tests",
    "post",
    "input",
    "share",
    ".venv",
    "requirements.txt",
    "setup.sh",
    "setup.py",
    "pyproject.toml",
    "fortitude.toml",
]
FIRST = {"reference", "faulty_decks", "static", "modal", "generalized_alpha", "dopri5", "energy", "frequency_response", "sensors"}
SECONDS = 1500  # of all tests
SWAPS = [
    (r" \+ ", " - "), (r" - ", " + "), (r"(?<=\w)\*(?=\w)", "/"), (r"(?<=[\w)])/(?=\w)", "*"), (r" < ", " <= "), (r" > ", " >= "),
    (r" <= ", " < "), (r" >= ", " > "), (r" == ", " /= "), (r" /= ", " == "), (r"\.and\.", ".or."), (r"\.or\.", ".and."),
    (r"\.true\.", ".false."), (r"\.false\.", ".true."), (r"\.not\. ", ""), (r"\bmin\(", "max("), (r"\bmax\(", "min("),
    (r"\bmaxval\(", "minval("), (r"\b1\b(?![._])", "2"), (r"\b0\b(?![._])", "1"), (r"\b2\b(?![._])", "3"), (r"\b0\.5_wp", "0.6_wp"),
    (r"\b2\*", "3*"), (r"\bexit\b", "cycle"), (r"\bcycle\b", "exit"), (r"^ *call .*", "continue"), (r"\breturn\b", "continue"),
]  # fmt: skip
NOT_CODE = re.compile(
    r"^\s*(!|use\b|end\b|module\b|contains|private|public|implicit|import|interface|abstract|type\b|class\b|$)|::"
)


def places() -> list[tuple[Path, int, int, str, str]]:
    """Return where mistakes can be made: file, line, column, what stands there, what is put in its place."""
    found = []
    for path in sorted((ROOT / "src").rglob("*.f90")):
        if not re.search(os.environ.get("MUTANT_FILES", ""), str(path)):
            continue
        for number, line in enumerate(path.read_text(encoding="utf-8").split("\n")):
            code = re.sub(r"'[^']*'", lambda text: "_" * len(text[0]), line).split("!")[0]
            if NOT_CODE.search(code) or re.match(r"\s*(pure|elemental|subroutine|function|real|integer|logical|character)\b", code):
                continue
            hits = [(m.span(), new) for old, new in SWAPS for m in re.finditer(old, code)]
            found += [(path, number, a, line[a:b], new) for (a, b), new in hits]
    return found


def tests_of(path: Path) -> tuple[list[str], list[str]]:
    """Return the tests that name a file or its folder, with a few that reach most lines, and all others."""
    words = {path.stem, *path.stem.split("_")} - {"of", "the"}
    files = sorted((ROOT / "tests").glob("test_*.py"))
    first = [f for f in files if f.stem[5:] in FIRST or words & set(f.stem[5:].split("_")) or path.stem in f.read_text()]
    slow = {"test_extremes", "test_fuzz", "test_faults", "test_build", "test_install", "test_layers", "test_units_stated"}
    return (
        [str(f.relative_to(ROOT)) for f in group] for group in (first, [f for f in files if f not in first and f.stem not in slow])
    )


def run(*command: str, seconds: float = SECONDS, **environment: str) -> bool:
    """Return whether a command in the copy succeeds in time."""
    try:
        done = subprocess.run(
            command, cwd=COPY, env={**os.environ, **environment}, capture_output=True, timeout=seconds, check=False
        )
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0


def caught(path: Path) -> str:
    """Return which part of the tests notices the mistake that stands in the copy: '' none, 'build' where it does not compile."""
    if not run("make", "all", "probe"):
        return "build"
    names = {name.upper(): str(COPY / "bin" / name) for name in ("biela", "probe", "tangent", "terms")}
    for part, files in zip(("first", "others"), tests_of(path)):
        if not run(".venv/bin/python", "-m", "pytest", "-q", "-x", "-n", os.environ.get("JOBS", "auto"), *files, **names):
            return part
    return ""


def main() -> int:
    """Plant the mistakes; exit status 1 where more than three in a hundred survive."""
    count, seed = int(os.environ.get("MUTANTS", "20")), int(os.environ.get("SEED", "1"))
    shutil.rmtree(COPY, ignore_errors=True)
    for name in ("src", "bin", "build/release"):  # times are kept, so that nothing is compiled again
        shutil.copytree(ROOT / name, COPY / name)
    for name in ("Makefile", "build/toolchain.ok"):
        shutil.copy2(ROOT / name, COPY / name)
    for name in SHARED:
        if not (COPY / name).is_symlink():
            (COPY / name).symlink_to(ROOT / name)
    if caught(Path("none")):
        sys.exit("mutants: the tests fail without any mistake")
    drawn = random.Random(seed)
    candidates, tried, survivors = places(), 0, []
    drawn.shuffle(candidates)
    for path, number, column, old, new in candidates:
        if tried == count:
            break
        target = COPY / path.relative_to(ROOT)
        lines = path.read_text(encoding="utf-8").split("\n")
        lines[number] = lines[number][:column] + new + lines[number][column + len(old) :]
        target.write_text("\n".join(lines), encoding="utf-8")
        by = caught(path)
        shutil.copyfile(path, target)
        if by == "build":
            continue
        tried += 1
        where = f"{path.relative_to(ROOT)}:{number + 1}: {lines[number].strip()}   (was {old.strip()})"
        if not by:
            survivors.append(where)
        print(f"{tried} {'caught' if by else 'SURVIVED'} {where}", flush=True)
    report = f"{tried} mistakes of seed {seed}, {tried - len(survivors)} caught\n" + "".join(f"{line}\n" for line in survivors)
    (ROOT / "results").mkdir(exist_ok=True)
    (ROOT / "results" / "mutants.txt").write_text(report, encoding="utf-8")
    print(report, end="")
    return 1 if len(survivors) > 0.03 * tried else 0


if __name__ == "__main__":
    sys.exit(main())
