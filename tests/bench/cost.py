#!/usr/bin/env python3
"""`make cost BASE=commit`: instructions of this program beside those of another commit, by callgrind, scene by scene.

The commit is built below build/base/ as it was. Instructions repeat from run to run, whatever else the machine does. Rows that say
'an evaluation' divide the instructions between two lengths of run by the evaluations between them, so that reading and set-up
cancel. The table goes to the screen and to results/cost.txt. Needs valgrind.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import bench_scenes as scenes

HERE = Path(__file__).resolve().parents[2]
BIELA = Path(os.environ.get("BIELA", "bin/biela")).resolve()
WORK = HERE / "build" / "cost"
ELEMENTS = {2: (1e-6, 300), 8: (2e-7, 300), 32: (2e-8, 200), 128: (4e-9, 100)}  # step [s], steps
INPUT = {  # shipped decks and how long they run [s], so that one takes some seconds under callgrind
    "slider_crank_viscoelastic": 0.002,
    "friction_slider_crank": 0.05,
    "four_bar": 0.01,
    "engine": 0.01,
    "press": 0.05,
    "valve_train": 0.05,
    "controlled_arm": 0.1,
    "clad_rod": 0.002,
}


def fail(message: str) -> None:
    """End with one line on standard error."""
    sys.exit(f"cost: {message}")


def built(commit: str) -> Path:
    """Return the program of a commit, built below build/base/ where it is not there yet."""
    ask = ["git", "rev-parse", "--verify", "--short=8", f"{commit}^{{commit}}"]
    found = subprocess.run(ask, cwd=HERE, capture_output=True, text=True, check=False)
    if found.returncode:
        fail(f"BASE={commit} is no commit of this project")
    folder = HERE / "build" / "base" / found.stdout.strip()
    if not (folder / "bin" / "biela").exists():
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        packed = subprocess.Popen(["git", "archive", commit], cwd=HERE, stdout=subprocess.PIPE)
        subprocess.run(["tar", "-x", "-C", str(folder)], stdin=packed.stdout, check=True)
        if packed.wait():
            fail(f"the files of {commit} cannot be taken out")
        apart = {name: value for name, value in os.environ.items() if not name.startswith(("MAKE", "MFLAGS", "BIELA"))}
        make = ["make", f"-j{os.cpu_count()}", "all"]
        if subprocess.run(make, cwd=folder, env=apart, stdout=subprocess.DEVNULL, check=False).returncode:
            fail(f"{commit} does not build")
    return folder / "bin" / "biela"


def count(program: Path, *arguments: str) -> tuple[int, dict]:
    """Return the instructions of a run, and its summary where it wrote one."""
    out = WORK / "out"
    shutil.rmtree(out, ignore_errors=True)
    command = ["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null"]
    command += [str(program), "--quiet", "--output", str(out), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL, check=False)
    found = re.search(r"Collected : (\d+)", done.stderr)
    if done.returncode or not found:
        words = [line for line in done.stderr.splitlines() if line and not line.startswith("==")]
        fail(f"{program} {' '.join(arguments)}: {words[0] if words else 'failed'}")
    summary = out / "summary.json"
    return int(found[1]), json.loads(summary.read_text()) if summary.exists() else {}


def deck(name: str, text: str) -> str:
    """Write a deck and return its path."""
    path = WORK / f"{name}.nml"
    path.write_text(text)
    return str(path)


def evaluation(program: Path, elements: int) -> float:
    """Return the instructions of one explicit evaluation of the slider-crank."""
    step, steps = ELEMENTS[elements]
    found = []
    for length in (steps, 3 * steps):
        text = scenes.slider_crank(elements, scenes.transient(step, length), torque_on_crank=True)
        cost, summary = count(program, deck("evaluation", text))
        found.append((cost, summary["transient"]["evaluations"]))
    (a, few), (b, many) = found
    return (b - a) / (many - few)


def whole(*arguments: str):
    """Return what counts the instructions of a whole process."""
    return lambda program: float(count(program, *arguments)[0])


def rows() -> list[tuple[str, object]]:
    """Return the rows of the table: what is counted, and the function of the program that counts it."""
    few = scenes.slider_crank(2, scenes.transient(1e-6, 10))
    friction = scenes.chain(20, scenes.transient(1e-4, 20))
    friction = re.sub(r"(type='revolute' [^\n]*) /", r"\1 friction=0.2 pin_radius=0.01 /", friction)
    sensors = "".join(f"&sensor name='s{k}' quantity='deflection' body='rod' node={2 + k % 30} /\n" for k in range(500))
    clamped = scenes.many_materials(100, "&sensor name='tip' quantity='position' body='arm' node=-1 /\n", count=1)
    push = "&force name='push' type='force' body='arm' node=-1 fy=1.0 /\n"
    sweep = "&frequency_response input='push' from=1.0 to=1000.0 points=50 /\n"
    found = [(f"an evaluation, {n} elements", lambda program, n=n: evaluation(program, n)) for n in ELEMENTS]
    found += [
        ("a deck of 2 elements, 10 steps", whole(deck("few", few))),
        ("its --check", whole("--check", deck("few", few))),
        ("20 pins with friction, 20 steps", whole(deck("friction", friction))),
        ("500 sensors, 10 steps", whole(deck("sensors", scenes.slider_crank(32, scenes.transient(1e-7, 10) + sensors)))),
        ("30 modes with a GHM term", whole(deck("modes", clamped + "&modal modes=30 /\n"))),
        ("responses, 100 elements, 50 frequencies", whole(deck("responses", clamped + push + sweep))),
        ("set-up of 2,000 elements, 20 steps", whole(deck("setup", scenes.slider_crank(2000, scenes.transient(1e-12, 20))))),
    ]
    for name, end in INPUT.items():
        cut = ["--set", f"transient/t_end={end}", "--set", f"transient/output_step={end / 10}"]
        found.append((f"input/{name}.nml, {end} s", whole(*cut, str(HERE / "input" / f"{name}.nml"))))
    return found


def main() -> None:
    """Count both programs and print the table."""
    if not shutil.which("valgrind"):
        fail("valgrind is missing: install it with the package manager of the system")
    base = os.environ.get("BASE")
    if not base:
        fail("BASE is missing: make cost BASE=commit")
    WORK.mkdir(parents=True, exist_ok=True)
    programs = [built(base), BIELA]
    lines = [f"{'instructions':44s} {base[:12]:>14s} {'this program':>14s} {'ratio':>7s}"]
    print(lines[0], flush=True)
    ratios = []
    for name, cost in rows():
        before, now = (cost(program) for program in programs)
        ratios.append(now / before)
        lines.append(f"{name:44s} {before:14,.0f} {now:14,.0f} {ratios[-1]:7.4f}")
        print(lines[-1], flush=True)
    mean = 1.0
    for ratio in ratios:
        mean *= ratio ** (1 / len(ratios))
    lines.append(f"geometric mean {mean:.4f}, greatest {max(ratios):.4f}")
    print(lines[-1])
    (HERE / "results").mkdir(exist_ok=True)
    (HERE / "results" / "cost.txt").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
