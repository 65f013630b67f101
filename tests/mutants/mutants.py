#!/usr/bin/env python3
"""Mutants: small mistakes planted in src/; which of them does no test notice?

`make mutants` calls it; results/mutants.txt lists the survivors. All mistakes are built into one copy of the program, each behind
a question: if (planted(17)) then the mistake, else the statement as it is. The environment variable PLANTED says which one is
made. A first run of the tests, without any, tells which test asks which question; a mistake then meets the tests that reach it
until one fails (`meet`), for MUTANT_SECONDS=300 of a processor at most. MUTANTS= says how many, SEED= which, MUTANT_FILES= limits
the files by a pattern.
"""

from __future__ import annotations

import json
import os
import random
import re
import shutil
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
COPY = ROOT / "build" / "mutants"
SEEN = COPY / "seen"
LINKED = ["tests", "post", "input", "share", ".venv", "README.md", "requirements.txt", "setup.sh"]
LINKED += ["pyproject.toml", "fortitude.toml"]
BEYOND = r"(?!-?[\d.]*[1-9][\d.]*(e-?\d+)?_wp)"  # no constant that real numbers meet by chance alone: either side is right there
# what builds the program, or reads its sources, says nothing about a mistake
APART = ["build", "install", "layers", "units_stated", "mutants", "fuzz", "faults", "toy_kinds", "readme_commands"]
MOST = 4000
SECONDS = os.environ.get("MUTANT_SECONDS", "300")  # of the tests that one mistake meets
SWAPS = [
    (r" \+ ", " - "), (r" - ", " + "), (r"(?<=\w)\*(?=\w)", "/"), (r"(?<=[\w)])/(?=\w)", "*"), (r" < " + BEYOND, " <= "),
    (r" > " + BEYOND, " >= "), (r" <= " + BEYOND, " < "), (r" >= " + BEYOND, " > "), (r" == ", " /= "), (r" /= ", " == "),
    (r"\.and\.", ".or."), (r"\.or\.", ".and."), (r"\.true\.", ".false."), (r"\.false\.", ".true."), (r"\.not\. ", ""),
    (r"\bmin\(", "max("), (r"\bmax\(", "min("), (r"\bmaxval\(", "minval("), (r"\b1\b(?![._])", "2"), (r"\b0\b(?![._])", "1"),
    (r"\b2\b(?![._])", "3"), (r"\b0\.5_wp", "0.6_wp"), (r"\b2\*", "3*"), (r"\bexit\b", "cycle"), (r"\bcycle\b", "exit"),
    (r"^ *call .*", "continue"), (r"\breturn\b", "continue"),
]  # fmt: skip
NO_STATEMENT = re.compile(
    r"(!|use|end|module|submodule|program|contains|private|public|implicit|import|interface|abstract|type|class|select|case|where|"
    r"elsewhere|else *$|associate|block|enum|do +concurrent|(\w+: *)?do *$|pure|elemental|impure|recursive|subroutine|function|"
    r"real|integer|logical|character|complex)\b|.*::|.*;|\w+: *(block|associate)|$"
)
CONDITION = re.compile(r"((?:\w+: *)?(?:if|else *if|do *while)) *\(", re.IGNORECASE)
LOOP = re.compile(r"^(?P<head>(?:\w+: *)?do +\w+ *= *)(?P<inside>.*)$", re.IGNORECASE)
QUESTION = """module planted_mistakes
  use, intrinsic :: iso_c_binding, only: c_bool, c_int
  implicit none (type, external)
  interface
    pure logical(c_bool) function planted(k) bind(c)
      import :: c_bool, c_int
      integer(c_int), value :: k
    end function planted
  end interface
end module planted_mistakes
"""
ANSWER = f"""#include <fcntl.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <unistd.h>
static unsigned char own[{MOST}], *asked = own;
static int chosen;
__attribute__((constructor)) static void start(void) {{
  const char *number = getenv("PLANTED"), *path = getenv("PLANTED_SEEN");
  int file = path ? open(path, O_RDWR | O_CREAT, 0600) : -1;
  if (number) chosen = atoi(number);
  if (file < 0) return;
  if (!ftruncate(file, {MOST})) {{
    void *shared = mmap(0, {MOST}, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    if (shared != MAP_FAILED) asked = shared;
  }}
  close(file);
}}
_Bool planted(int k) {{ asked[k] = 1; return k == chosen; }}
"""


class Statement:
    """A statement: its first line (from 0), its lines without comments, and the lines that its mistakes make of them."""

    def __init__(self, start: int, lines: list[str]):
        self.start, self.lines, self.mistakes = start, lines, {}

    @staticmethod
    def joined(lines: list[str]) -> str:
        """Return the statement as one line."""
        return " ".join(line.strip().removesuffix("&").removeprefix("&").strip() for line in lines).strip()

    def text(self) -> list[str]:
        """Return the statement with its mistakes, each behind its question."""
        if not self.mistakes:
            return self.lines
        plain = self.joined(self.lines)
        if found := condition(plain):
            head, inside, tail = found
            wrong = [f"(planted({k}) .and. ({condition(self.joined(new))[1]}))" for k, new in self.mistakes.items()]
            none = " .or. ".join(f"planted({k})" for k in self.mistakes)
            return [f"{head} ({' .or. '.join(wrong)} .or. (.not. ({none}) .and. ({inside}))){tail}"]
        if found := LOOP.match(plain):
            parts = bounds = split(found["inside"])
            for k, new in self.mistakes.items():
                others = split(LOOP.match(self.joined(new))["inside"])
                parts = [p if b == o else f"merge({o}, {p}, planted({k}))" for b, p, o in zip(bounds, parts, others)]
            return [found["head"] + ", ".join(parts)]
        text, word = [], "if"
        for k, new in self.mistakes.items():
            text += [f"{word} (planted({k})) then", *new]
            word = "else if"
        return [*text, "else", *self.lines, "end if"]

    def candidates(self) -> list[tuple[int, int, str, str]]:
        """Return line within the statement, column, what stands there, what is put in its place."""
        hits = []
        for number, line in enumerate(self.lines):
            code = re.sub(r"'[^']*'|\"[^\"]*\"", lambda text: "_" * len(text[0]), line)
            hits += [(number, m.start(), m[0], new) for old, new in SWAPS for m in re.finditer(old, code)]
        if len(self.lines) > 1:
            hits = [hit for hit in hits if hit[3] != "continue"]
        if LOOP.match(self.joined(self.lines)):
            hits = [hit for hit in hits if hit[2].strip() != "="]
        return hits


def condition(text: str) -> tuple[str, str, str] | None:
    """Return head, condition and tail of a statement that opens a block with a condition, None for all others."""
    if not (found := CONDITION.match(text)):
        return None
    depth, end = 1, found.end()
    while depth and end < len(text):
        depth += (text[end] == "(") - (text[end] == ")")
        end += 1
    tail = text[end:]
    return (found[1], text[found.end() : end - 1], tail) if tail.strip().lower() in ("then", "") else None


def split(text: str) -> list[str]:
    """Return the parts of a list with commas, those within brackets left alone."""
    parts, depth = [""], 0
    for letter in text:
        depth += (letter in "([") - (letter in ")]")
        if letter == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return [part.strip() for part in parts]


def statements(text: str) -> list[Statement]:
    """Return the statements of a source file, in order; comments are left out."""
    found, lines, start = [], [], 0
    for number, line in enumerate(text.split("\n")):
        code = re.match(r"(?:'[^']*'|\"[^\"]*\"|[^'\"!])*", line)[0].rstrip()
        if not code and lines:
            continue
        if not lines:
            start = number
        lines.append(code)
        if not code.endswith("&"):
            found.append(Statement(start, lines))
            lines = []
    return found


def can_be_mistaken(all_of_them: list[Statement]) -> list[Statement]:
    """Return the statements that can stand behind a question."""
    found, masked = [], False
    for statement in all_of_them:
        code = statement.joined(statement.lines).lower()
        if re.match(r"where *\(", code) and code.endswith(")") and len(split(code)) == 1 and " = " not in code:
            masked = True
        elif re.match(r"end *where", code):
            masked = False
        elif not masked and not NO_STATEMENT.match(code):
            found.append(statement)
    return found


def draw(count: int, seed: int) -> tuple[dict[Path, list[Statement]], dict[int, str]]:
    """Return the sources with mistakes planted, and a line on each of these."""
    sources, places = {}, []
    for path in sorted((ROOT / "src").rglob("*.f90")):
        sources[path] = statements(path.read_text(encoding="utf-8"))
        if re.search(os.environ.get("MUTANT_FILES", ""), str(path)):
            places += [(path, s, hit) for s in can_be_mistaken(sources[path]) for hit in s.candidates()]
    random.Random(seed).shuffle(places)
    told = {}
    for k, (path, statement, (number, column, old, new)) in enumerate(places[: min(count, MOST - 1)], 1):
        lines = list(statement.lines)
        lines[number] = lines[number][:column] + new + lines[number][column + len(old) :]
        statement.mistakes[k] = lines
        told[k] = f"{path.relative_to(ROOT)}:{statement.start + number + 1}: {lines[number].strip()}   (was {old.strip()})"
    return sources, told


def prepare() -> None:
    """Make the copy, all but its sources with mistakes."""
    shutil.rmtree(COPY, ignore_errors=True)
    SEEN.mkdir(parents=True)
    for name in LINKED:
        (COPY / name).symlink_to(ROOT / name)
    (COPY / "build").mkdir()
    shutil.copy2(ROOT / "Makefile", COPY)
    shutil.copy2(ROOT / "build" / "toolchain.ok", COPY / "build")
    shutil.copytree(ROOT / "src", COPY / "src", ignore=shutil.ignore_patterns("*.f90"))  # the table of keys, what reads it, C
    (COPY / "src" / "base" / "planted_mistakes.f90").write_text(QUESTION, encoding="utf-8")
    (COPY / "answer.c").write_text(ANSWER, encoding="utf-8")
    subprocess.run(["cc", "-O2", "-c", "answer.c", "-o", "answer.o"], cwd=COPY, check=True)


def write(sources: dict[Path, list[Statement]]) -> dict[Path, list[int]]:
    """Write the sources into the copy; return for each file the mistake that each of its lines belongs to, 0 for none."""
    owners = {}
    for path, found in sources.items():
        lines, owner = [], []
        for statement in found:
            new = statement.text()
            lines += new
            of_line = [0] * len(new)
            for k, wrong in statement.mistakes.items():
                for i in range(len(new)):
                    if f"planted({k})" in new[i]:
                        of_line[i : i + 1 + len(wrong)] = [k] * min(1 + len(wrong), len(new) - i)
            owner += of_line
            if re.match(r"\s*(module\s+\w+|submodule\s*\(.*\)\s*\w+|program\s+\w+)$", new[0]):
                lines.append("use planted_mistakes, only: planted")
                owner.append(0)
        target = COPY / path.relative_to(ROOT)
        target.parent.mkdir(parents=True, exist_ok=True)
        text = "\n".join(lines)
        if not target.exists() or target.read_text(encoding="utf-8") != text:
            target.write_text(text, encoding="utf-8")
        owners[target] = owner
    return owners


def build(sources: dict[Path, list[Statement]]) -> set[int]:
    """Build the copy; return the mistakes that do not compile, and were taken out."""
    refused = set()
    libraries = f"LDLIBS={COPY}/answer.o {os.environ.get('LDLIBS', '-llapack -lblas')}"
    command = ["make", "-k", "all", "probe", "FFLAGS=-O1 -ffree-line-length-none -w -fcheck=bounds", "WERROR=", libraries]
    while True:
        owners = write(sources)
        done = subprocess.run(command, cwd=COPY, capture_output=True, text=True, check=False)
        if done.returncode == 0:
            return refused
        wrong = set()
        for name, line in re.findall(r"^(src/\S+\.f90):(\d+):[\d-]+:$", done.stdout + done.stderr, re.MULTILINE):
            wrong.add(owners[COPY / name][int(line) - 1])
        wrong -= {0}
        if not wrong:
            sys.exit(f"mutants: the copy does not build\n{done.stderr[-3000:]}")
        refused |= wrong
        for found in sources.values():
            for statement in found:
                statement.mistakes = {k: new for k, new in statement.mistakes.items() if k not in wrong}


def pytest(*words: str, **environment: str) -> subprocess.Popen:
    """Start tests on the copy, all but those that look at sources or build."""
    names = {name.upper(): str(COPY / "bin" / name) for name in ("biela", "probe", "tangent", "terms")}
    apart = [f"--ignore-glob=*/test_{name}.py" for name in APART]
    command = [".venv/bin/python", "-m", "pytest", "-q", "-p", "no:cacheprovider", *words, "tests", *apart]
    folder = str(Path(__file__).parent)
    return subprocess.Popen(
        command, cwd=COPY, env={**os.environ, **names, **environment, "PYTHONPATH": folder}, stdout=subprocess.DEVNULL
    )


def reach(jobs: str) -> dict[int, list[tuple[float, str]]]:
    """Run all tests without a mistake; return the tests that reach each one, with their seconds."""
    pytest("-n", jobs, "-p", "reach", PLANTED_FOLDER=str(SEEN)).wait()
    tests = defaultdict(list)
    for record in SEEN.glob("*.json"):
        test = json.loads(record.read_text(encoding="utf-8"))
        seen = record.with_suffix(".seen")
        if test["passed"] and seen.exists():
            for k, asked in enumerate(seen.read_bytes()):
                if asked:
                    tests[k].append((test["seconds"], test["name"]))
    return tests


def meetings(told: dict[int, str], tests: dict[int, list[tuple[float, str]]], jobs: int) -> Iterator[tuple[int, str]]:
    """Let each mistake meet the tests that reach it; yield it with a word on how that ended, as they come."""
    met, planned = COPY / "met.jsonl", COPY / "tests.json"
    met.touch()
    planned.write_text(json.dumps({k: tests[k] for k in told if k in tests}), encoding="utf-8")
    files = {"PLANTED_MET": str(met), "PLANTED_TESTS": str(planned), "MUTANT_SECONDS": SECONDS}
    workers = [pytest("-s", "-p", "meet", MUTANT_SHARE=f"{n}/{jobs}", **files) for n in range(1, jobs + 1)]
    yield from ((k, "NOT REACHED") for k in told if k not in tests)
    known, busy = 0, True
    while busy:
        busy = any(worker.poll() is None for worker in workers)
        time.sleep(1.0)
        lines = met.read_text(encoding="utf-8").split("\n")[:-1]  # the last one may not be whole yet
        for end in map(json.loads, lines[known:]):
            tests_met = "" if len(end["met"]) == end["of"] else f" {len(end['met'])} of {end['of']} tests that reach it"
            yield end["mistake"], f"caught by {end['failed'][0]}" if end["failed"] else f"SURVIVED{tests_met}"
        known = len(lines)


def main() -> int:
    """Plant the mistakes; exit status 1 where more than three in a hundred survive."""
    count, seed, jobs = int(os.environ.get("MUTANTS", "20")), int(os.environ.get("SEED", "1")), os.environ.get("JOBS", "auto")
    prepare()
    sources, told = draw(count, seed)
    for k in build(sources):
        del told[k]
    print(f"{len(told)} mistakes planted, of {count} drawn; the others do not compile", flush=True)
    tests = reach(jobs)
    if not tests:
        sys.exit("mutants: no test passes without any mistake")
    survivors, met = [], set()
    for k, end in meetings(told, tests, (os.cpu_count() or 1) if jobs == "auto" else int(jobs)):
        print(f"{end}: {told[k]}", flush=True)
        met.add(k)
        if not end.startswith("caught"):
            survivors.append(f"{end}: {told[k]}")
    if met != set(told):
        sys.exit("mutants: the tests of some mistakes did not end")
    report = f"{len(told)} mistakes of seed {seed}, {len(told) - len(survivors)} caught\n" + "".join(f"{s}\n" for s in survivors)
    (ROOT / "results").mkdir(exist_ok=True)
    (ROOT / "results" / "mutants.txt").write_text(report, encoding="utf-8")
    print(report, end="")
    return 1 if len(survivors) > 0.03 * len(told) else 0


if __name__ == "__main__":
    sys.exit(main())
