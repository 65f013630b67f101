#!/usr/bin/env python3
"""Fuzzing: decks of all kinds against the checked build and the build that watches addresses and undefined behaviour.

`make fuzz` calls it. A deck has to end with status 0 and finite results whose energies balance, or on whose positions two other
methods agree, or with 1 or 2, a message and the files that go with it. FUZZ_CASES= and FUZZ_SEED= choose how many and which;
what fails is made smaller and kept in results/fuzz/.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from deck_makers import ASSIGNMENT, GROUP, ROOT, decks
from hypothesis import HealthCheck, Phase, given, seed, settings

BATCH = 100  # decks of one process
PATIENCE = 6.0  # with a deck before it is asked to stop [s]
HANG = 60.0  # after which a deck that was asked has stopped [s]
MEMORY = 4 * 1024**2  # of address space [kB]
FOLDER = ROOT / "results" / "fuzz"
STATUS = {"done": 0, "an analysis failed": 1, "refused": 2, "results could not be written": 3, "stopped by a signal": 143}
DIED = re.compile(rb"Backtrace|runtime error|Sanitizer|Fortran runtime|SIG[A-Z]{3}|core dumped|On entry to")
NOT_FINITE = re.compile(rb"^[^#\n]*(?:nan|inf)", re.MULTILINE | re.IGNORECASE)
MISTRUST = "trusted|energ|unstable|above|grow|bound|too large|rounding"  # the program's own words on what it doubts
BALANCE = 0.05  # of the energy that moved
AGREE = 1.0e-2  # two accurate methods, of a column's range
ENVIRONMENT = {
    **os.environ,
    "ASAN_OPTIONS": "detect_leaks=1:allocator_may_return_null=1:max_allocation_size_mb=2000:abort_on_error=0",
    "UBSAN_OPTIONS": "print_stacktrace=1:halt_on_error=1",
}


def start(program: Path, folder: Path, names: list[str], patience: float) -> tuple[int, list[tuple[str, int]], bytes]:
    """Run decks in one process; its status, the decks that ended with theirs, what was said.

    A deck that takes longer than the patience is asked to stop, and killed where it does not.
    """
    said, ended = folder / "said", []
    with said.open("wb") as log:
        limits = "ulimit -c 0; " + ("" if "sanitize" in program.name else f"ulimit -v {MEMORY}; ")  # the sanitizer has its own
        command = ["sh", "-c", limits + 'exec "$@"', "sh", str(program), *names, *(["missing.nml"] if len(names) == 1 else [])]
        process = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=log, env=ENVIRONMENT, text=True)
        waiting = True
        while waiting:
            clocks = [threading.Timer(patience, process.terminate), threading.Timer(patience + HANG, process.kill)]
            for clock in clocks:
                clock.start()
            line = process.stdout.readline()
            for clock in clocks:
                clock.cancel()
            name, _, words = line.strip().partition(": ")
            if words in STATUS and name in names:
                ended.append((name, STATUS[words]))
            waiting = bool(line)
        process.wait()
    return process.returncode, ended, said.read_bytes()


def run(program: Path, folder: Path, names: list[str], patience: float = PATIENCE) -> dict[str, tuple[int, str]]:
    """Return each deck's status (-1: it died or hung) and what it said, with as few processes as crashes allow."""
    found: dict[str, tuple[int, str]] = {}
    while names:
        status, ended, said = start(program, folder, names, patience)
        texts = said.decode(errors="replace").splitlines()
        for name, ending in ended:
            mine = (line for line in texts if line.startswith(name) or "part.nml:" in line)  # or of the file that decks include
            found[name] = (ending, "\n".join(mine))
        names = [name for name in names if name not in found]
        normal = status in (0, 1, 2, 3, 143, -15) and not DIED.search(said)
        if names and status in (143, -15) and not ended:  # asked to stop before it had begun to write, or to run
            found[names.pop(0)] = (143, "")
        elif names and (not normal or not ended):  # the first without an ending is the one that died
            found[names.pop(0)] = (-1, f"status {status}\n" + said.decode(errors="replace")[-3000:])
        elif not normal:
            found[ended[-1][0]] = (-1, f"status {status}\n" + said.decode(errors="replace")[-3000:])
    return found


def table(path: Path) -> np.ndarray:
    """Return the numbers of a result."""
    return np.loadtxt(path, comments="#", ndmin=2, encoding="latin-1")


def unbalanced(results: Path, *, kinetic_alone: bool) -> str:
    """Return how far the energies of a run are from balance, '' where they are in it; kinetic_alone: nothing should change it."""
    t = table(results / "energy.txt")
    kinetic, potential, dissipated, work = t[:, 1:5].T
    total = kinetic + potential + dissipated - work
    moved = kinetic.max() if kinetic_alone else max(np.ptp(column) for column in t[:, 1:5].T)
    gap = np.abs(total - total[0]).max()
    if gap > BALANCE * moved + 1e-9 * np.abs(t[:, 1:5]).max() + 1e-6:
        return f"energies off balance by {gap:.3g} J where {moved:.3g} J moved"
    return ""


def wrong(folder: Path, name: str, status: int, said: str) -> str:
    """Return what is wrong with the way in which a deck ended, '' where nothing is."""
    results = folder / "results" / Path(name).stem
    if status == -1:
        return "died or hung: " + said
    if status == 3:
        return "could not write: " + said
    for path in results.glob("*.txt"):
        text = path.read_bytes()
        if path.name not in ("summary.txt",) and NOT_FINITE.search(text):
            return f"{path.name} is not finite"
        if text and not text.endswith(b"\n"):
            return f"{path.name} ends within a line"
    if (results / ".lock").exists():
        return "a lock is left"
    summary = results / "summary.txt"
    if status == 2:
        return "" if said and not results.exists() else "refused without a message, or with results"
    if status == 1 and not said:
        return "failed without a message"
    if not summary.exists():
        return "" if status == 1 or not results.exists() else "no summary"
    told = summary.read_text(errors="replace").split("\ndeck text\n")[0]
    if ("outcome: done" in told) != (status == 0):
        return "summary and status contradict each other"
    if status == 0 and (results / "energy.txt").exists() and not re.search(MISTRUST, said) and "it says nothing" not in told:
        return unbalanced(results, kinetic_alone="kinetic energy, which is constant" in told)
    return ""


def twins(folder: Path, name: str) -> list[str]:
    """Write a deck's transient for two methods of high accuracy; their names, none where it has no transient."""
    text = (folder / name).read_bytes().decode("latin-1")
    groups = [g for g in GROUP.findall(text) if g.lower().startswith("&transient")]
    end = re.search(r"t_end\s*=\s*([^\s,/]+)", groups[0]) if len(groups) == 1 else None
    if not end or "{" in end[1]:  # an expression, whose value is the solver's
        return []
    names = []
    for method in ("dopri5' tolerance=1e-9", "radau' tolerance=1e-9"):
        names.append(f"{method[:6]}_{name}")
        made = f"&transient t_end={end[1]} method='{method} output_step={float(end[1]) / 10!r} /\n"
        (folder / names[-1]).write_bytes(text.replace(groups[0], made).encode("latin-1"))
    return names


def disagree(folder: Path, pair: list[str]) -> str:
    """Return where the positions and angles that two methods give differ, '' where they agree."""
    paths = [folder / "results" / Path(name).stem / "history.txt" for name in pair]
    a, b = (table(path) for path in paths)
    heads = re.search(r"^# columns: (.*)$", paths[0].read_text("latin-1"), re.MULTILINE)[1].split()
    if a.shape != b.shape:
        return f"{pair} have unlike rows"
    for k, head in enumerate(heads):
        # what bodies measure: positions and angles, over the range of the run and beyond rounding
        if head.endswith(("[m]", "[rad]")) and np.ptp(a[:, k]) > 1e-6:
            off = np.abs(a[:, k] - b[:, k]).max() / np.ptp(a[:, k])
            if off > AGREE:
                return f"{pair} differ in {head} by {off:.2g} of its range"
    return ""


def judge(program: Path, texts: list[bytes], twin: bool = False) -> list[tuple[bytes, str, int]]:
    """Run decks; each with what is wrong and its status."""
    folder = Path(tempfile.mkdtemp(prefix="fuzz"))
    try:
        names = [f"d{k:03d}.nml" for k in range(len(texts))]
        for name, text in zip(names, texts):
            (folder / name).write_bytes(text)
        ends = run(program, folder, names)
        faults = {name: wrong(folder, name, *ends[name]) for name in names}
        ran = [n for n in names if ends[n] == (0, "") and (folder / "results" / Path(n).stem / "energy.txt").exists()]
        for name in [n for n in ran if not faults[n]][:2] if twin else []:
            pair = twins(folder, name)
            again = run(program, folder, pair, PATIENCE / 6) if pair else {}
            if pair and all(again[n] == (0, "") for n in pair):
                faults[name] = disagree(folder, pair)
        return [(text, faults[name], ends[name][0]) for name, text in zip(names, texts)]
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def kind_of(fault: str) -> str:
    """Return a fault without what differs between decks that show it."""
    at = re.search(r"\w+\.f90:\d+", fault)
    line = re.search(r"runtime error.*|ERROR: .*|signal SIG\w+", fault) or re.match(r".*", fault)
    return re.sub(r"[-+\d.eE]{3,}|0x\w+|d\d+", "#", line[0])[:160] + (f", {at[0]}" if at else "")


def smaller(program: Path, deck: bytes, kind: str, seconds: float = 30.0) -> bytes:
    """Leave out groups, then assignments, then lines, as long as the deck fails in the same way."""
    text, end = deck.decode("latin-1"), time.monotonic() + seconds
    for pattern in (GROUP, ASSIGNMENT, re.compile(r".*\n")):
        k = 0
        while time.monotonic() < end:
            found = list(pattern.finditer(text))
            if k >= len(found):
                break
            shorter = text[: found[k].start()] + text[found[k].end() :]
            ((_, fault, _),) = judge(program, [shorter.encode("latin-1")])
            if fault and kind_of(fault) == kind:
                text = shorter
            else:
                k += 1
    return text.encode("latin-1")


def drawn(number: int, count: int) -> list[bytes]:
    """Return a batch of decks; its number makes it again."""
    found: list[bytes] = []

    @seed(number)
    @settings(max_examples=count, phases=[Phase.generate], database=None, deadline=None, suppress_health_check=list(HealthCheck))
    @given(decks())
    def collect(deck: bytes) -> None:
        found.append(deck)

    collect()
    return found


def batch(program: Path, number: int, count: int) -> tuple[int, list[tuple[bytes, str, int]]]:
    """Judge one batch."""
    return number, judge(program, drawn(number, count), twin=True)


@contextmanager
def workers(count: int | None) -> Iterator[ProcessPoolExecutor]:
    """Yield processes; where the work on a result fails, what waits is not begun."""
    pool = ProcessPoolExecutor(count)
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def main() -> int:
    """Fuzz each program given; exit status 1 where something is wrong."""
    programs = [Path(name).resolve() for name in sys.argv[1:]]
    cases = int(os.environ.get("FUZZ_CASES", "2000"))
    first = int(os.environ.get("FUZZ_SEED", "1"))
    jobs = int(os.environ.get("JOBS", "0")) if os.environ.get("JOBS", "").isdigit() else os.cpu_count()
    FOLDER.mkdir(parents=True, exist_ok=True)
    print(f"{cases} decks, FUZZ_SEED={first}, {' and '.join(p.name for p in programs)} in turn", flush=True)
    began, kinds, statuses, decks_run = time.monotonic(), Counter(), Counter(), 0
    with workers(jobs or None) as pool:
        waiting = [pool.submit(batch, programs[k % len(programs)], 10**6 * first + k, BATCH) for k in range(-(-cases // BATCH))]
        for k, task in enumerate(waiting):
            number, judged = task.result()
            for deck, fault, status in judged:
                decks_run, statuses = decks_run + 1, statuses + Counter([status])
                if not fault:
                    continue
                kind = kind_of(fault)
                kinds[kind] += 1
                program = programs[k % len(programs)]
                print(f"batch {number}, {program.name}: {kind}", flush=True)
                if kinds[kind] == 1:
                    path = FOLDER / f"{number}_{len(kinds)}.nml"
                    path.write_bytes(deck)
                    path.with_suffix(".small.nml").write_bytes(smaller(program, deck, kind))
                    path.with_suffix(".txt").write_text(fault, errors="replace")
            if (k + 1) % 20 == 0 or k + 1 == len(waiting):
                ends = ", ".join(f"{n} with status {s}" for s, n in sorted(statuses.items()))
                print(f"{decks_run} decks in {time.monotonic() - began:.0f} s: {ends}; {sum(kinds.values())} wrong", flush=True)
    for kind, count in kinds.most_common():
        print(f"{count:6d}  {kind}")
    return 1 if kinds else 0


if __name__ == "__main__":
    sys.exit(main())
