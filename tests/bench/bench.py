"""`make bench`: what a step costs, by part, element, GHM term and link; a table, results/bench.txt and two pictures.

Times are processor times of one thread, medians of several runs of several repetitions, with the least and the most;
scenes that are compared run in turn. Shares and ratios are taken from the
least times, which other programs on the machine disturb least.
Options: --quick leaves the largest scenes out.
"""

import argparse
import json
import math
import os
import re
import resource
import subprocess
import sys
import time
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import bench_scenes as scenes
import matplotlib.pyplot as plt
from bench_accuracy import evaluations
from bench_friction import friction_cost, friction_trade
from bench_models import maxwell, shapes
from bench_promise import promises, shipped
from bench_reduction import STUDIES, reductions

HERE = Path(__file__).resolve().parents[2]
BIELA = Path(os.environ.get("BIELA", "bin/biela")).resolve()
BENCH = BIELA.with_name(BIELA.name.replace("biela", "bench"))
WORK = HERE / "build" / "bench"
RESULTS = HERE / "results"
TERMS = (0, 1, 3, 10)  # GHM terms
TARGET = 12_000.0  # microseconds that one repetition should take


def fail(message):
    """Ends with one line on standard error."""
    sys.exit(f"bench: {message}")


def run_bench(name, text, guess, dense=False):
    """The parts of one scene: {name: (median, smallest, largest)} in microseconds, counts as integers.

    `guess` is a step's expected cost in microseconds, from which the number of steps follows.
    """
    deck = WORK / f"{name}.nml"
    deck.write_text(text)
    steps = max(3, min(20_000, int(TARGET / guess)))
    command = [str(BENCH), str(deck), str(steps)] + (["dense"] if dense else [])
    done = subprocess.run(command, capture_output=True, text=True, cwd=WORK, check=False)
    if done.returncode:
        fail(f"{name}: {done.stderr.strip().splitlines()[0] if done.stderr else 'failed'}")
    found = {}
    for line in done.stdout.splitlines():
        words = line.split()
        if len(words) == 4:
            found[words[0]] = tuple(float(x) for x in words[1:])
        else:
            found[words[0]] = int(words[1])
    return found


def measure(jobs):
    """Runs the jobs (arguments of run_bench) in turn, three times over, and merges: median of medians, least, most."""
    rounds = [[run_bench(*job) for job in jobs] for _ in range(3)]
    merged = []
    for runs in zip(*rounds):
        parts = {}
        for name, first in runs[0].items():
            if isinstance(first, int):
                parts[name] = first
            else:
                medians, least, most = zip(*(run[name] for run in runs))
                parts[name] = (median(medians), min(least), max(most))
        merged.append(parts)
    return merged


def run_process(name, text):
    """Seconds of the process by the clock, of the processor in its march, and in all of it; None where refused."""
    deck = WORK / f"{name}.nml"
    deck.write_text(text)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    start = time.perf_counter()
    done = subprocess.run([str(BIELA), "--quiet", "--output", str(WORK / name), str(deck)], capture_output=True, check=False)
    seconds = time.perf_counter() - start
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        return None
    march = re.search(r"s, +(\S+) s of the processor", (WORK / name / "summary.txt").read_text())
    processor = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
    return seconds, float(march.group(1)), processor


def median(values):
    """The middle value."""
    return sorted(values)[len(values) // 2]


def implicit_step(make, step, steps):
    """Microseconds of a generalized_alpha step (median, smallest, largest of differences of two run lengths), or None."""
    costs = []
    for _ in range(5):
        runs = [run_process("implicit", make(scenes.transient(step, n, "generalized_alpha"))) for n in (steps, 3 * steps)]
        if None in runs:
            return None
        costs.append((runs[1][1] - runs[0][1]) / (2 * steps) * 1e6)
    return median(costs), min(costs), max(costs)


def growth(sizes, costs):
    """Exponent p of cost ~ size^p by least squares in logarithms."""
    x = [math.log(s) for s in sizes]
    y = [math.log(c) for c in costs]
    mean_x, mean_y = sum(x) / len(x), sum(y) / len(y)
    return sum((a - mean_x) * (b - mean_y) for a, b in zip(x, y)) / sum((a - mean_x) ** 2 for a in x)


def shares(parts):
    """Percent of a step in its four right-hand sides, the banded solves in them, and the projection."""
    step, rhs, solve, projection = (parts[name][1] for name in ("step", "right_hand_side", "solve", "projection"))
    return 400 * rhs / step, 400 * solve / step, 100 * projection / step


class Table:
    """Lines for the terminal and for results/bench.txt."""

    def __init__(self):
        self.lines = []

    def add(self, text=""):
        """Adds and shows a line."""
        self.lines.append(text)
        print(text, flush=True)

    def scene(self, name, parts, count, unit):
        """One scene: a step with its spread, per element or link, shares, a row of output, the floor."""
        step = parts["step"]
        rhs, solve, projection = shares(parts)
        floor = f"{step[1] / parts['floor'][1]:7.2f}" if "floor" in parts else "      -"
        self.add(
            f"{name:<26}{step[0]:10.2f} ({step[1]:8.2f} ..{step[2]:9.2f}){step[0] / count:9.3f} /{unit:<8}"
            f"{rhs:5.0f}%{solve:6.0f}%{projection:6.0f}%{parts['row'][0]:9.2f}{floor}"
            f"{parts['set_up'][0] / 1e3:9.2f}{parts['memory'] / 1024:8.1f}"
        )

    def head(self, title):
        """Title and column names of a block."""
        self.add()
        self.add(title)
        self.add(
            f"{'scene':<26}{'us a step':>10} ({'least':>8} ..{'most':>9}){'us each':>9}  {'':<8}"
            f"{'rhs':>6}{'solve':>7}{'proj.':>7}{'us/row':>9}{'/floor':>7}{'set-up':>9}{'MB':>8}"
        )


def rods(table, quick):
    """Slider-crank rods: elements, GHM terms, modes. Returns {(elements, terms): parts}."""
    found = {}
    table.head("slider-crank's rod, rk4 with projection; shares of a step; floor: 4 (2 DPBTRS + 3 DSBMV) of the rod's size")
    for elements in (2, 8, 32, 128, 512, 2048)[: 4 if quick else 6]:
        run = scenes.transient(scenes.explicit_step(elements), 20_000)
        jobs = [(f"rod{elements}_{t}", scenes.slider_crank(elements, run, t), 3 + (0.23 + 0.04 * t) * elements) for t in TERMS]
        for terms, parts in zip(TERMS, measure(jobs)):
            found[elements, terms] = parts
            table.scene(f"{elements} elements, {terms} terms", parts, elements, "element")
    run = scenes.transient(1e-6, 20_000)
    jobs = [(f"modal_{t}", scenes.slider_crank(32, run, t, modes=6), 4) for t in (0, 1)]
    for terms, parts in zip((0, 1), measure(jobs)):
        table.scene(f"32 el., 6 modes, {terms} terms", parts, 6, "mode")
    table.add()
    for elements in sorted({e for e, _ in found}):
        base = found[elements, 0]["step"][1]
        cost = [100 * (found[elements, t]["step"][1] - base) / t / base for t in TERMS[1:]]
        table.add(
            f"a GHM term at {elements} elements costs {cost[0]:.1f} % of the elastic step (one term), {cost[1]:.1f} % each "
            f"(three), {cost[2]:.1f} % each (ten)"
        )
    return found


def chains(table, elements, quick):
    """Pendulum chains. Returns {links: parts}."""
    found = {}
    kind = f"links of {elements} elements" if elements else "rigid links"
    table.head(f"pendulum chain of {kind}, rk4 with projection")
    sizes = (2, 8, 32, 128, 512, 1024) if elements else (2, 8, 32, 128, 512, 2048, 4096)
    sizes = sizes[: 4 if quick else 7]
    run = scenes.transient(1.0e-7, 20_000)
    jobs = [(f"chain{n}_{elements}", scenes.chain(n, run, elements), 2 + n * (2.8 if elements else 0.85)) for n in sizes]
    for links, parts in zip(sizes, measure(jobs)):
        found[links] = parts
        table.scene(f"{links} links", parts, links, "link")
    return found


def implicit(table):
    """Steps of generalized_alpha, where the program offers them."""
    table.add()
    for elements, terms in ((32, 0), (32, 1), (2, 0), (2, 1), (128, 0)):
        cost = implicit_step(lambda run, e=elements, g=terms: scenes.slider_crank(e, run, g), 4e-6, 40_000 // elements)
        if cost is None:
            table.add("generalized_alpha: this build does not offer it")
            return
        table.add(
            f"generalized_alpha, {elements} elements, {terms} terms: {cost[0]:.2f} us a step ({cost[1]:.2f} .. {cost[2]:.2f})"
        )


def whole_processes(table, quick):
    """Whole processes, start-up and memory."""
    table.add()
    run = scenes.transient(4e-6, 2500, every=1)
    runs = [run_process("files", scenes.slider_crank(2, run)) for _ in range(9)]
    table.add(f"whole process, 2 elements, 2,500 steps, rows each step: {milliseconds(runs)}")
    scene = {
        "2 elements": lambda: scenes.slider_crank(2, scenes.transient(4e-6, 1)),
        "2048 elements": lambda: scenes.slider_crank(2048, scenes.transient(scenes.explicit_step(2048), 1)),
        "32 links": lambda: scenes.chain(32, scenes.transient(1e-6, 1)),
        "4096 links": lambda: scenes.chain(4096, scenes.transient(1e-6, 1)),
    }
    for name, make in list(scene.items())[: 1 if quick else 4]:
        runs = [run_process("start", make()) for _ in range(5)]
        if None in runs:
            fail(f"biela refused the deck of {name}")
        table.add(f"whole process of one step, {name}: {milliseconds(runs)}")


def analyses(table, quick):
    """Modes and frequency responses of fine beams."""
    table.add()
    modes = "&modal modes=20 /\n"
    response = "&frequency_response from=1.0 to=20000.0 points=500 input='push' /\n"
    for elements in (50, 200) if quick else (50, 200, 800):
        for terms in (0, 3):
            for name, analysis in (("20 modes and all poles", modes), ("response at 500 frequencies", response)):
                runs = [run_process("analysis", scenes.cantilever(elements, terms, analysis)) for _ in range(3)]
                if None in runs:
                    fail(f"biela refused the deck of {name}")
                table.add(f"cantilever of {elements} elements, {terms} terms, {name}: {milliseconds(runs)}")


def set_ups(table, quick):
    """Whole processes of one step or a static analysis, where the set-up is nearly all: its growth with what a deck asks for."""
    table.add()
    run = scenes.transient(1e-9, 1, "generalized_alpha")
    families = {
        "elements, 4 modes": (lambda n: scenes.slider_crank(n, run, modes=4), 2500),
        "elements, 50 modes": (lambda n: scenes.slider_crank(n, run, modes=50), 2500),
        "columns of a truss": (lambda n: scenes.truss(n, 5, run), 84),
        "materials": (lambda n: scenes.many_materials(n, run), 500),
        "materials, with a static analysis": (lambda n: scenes.many_materials(n, "&static load_steps=1 /\n"), 500),
        "bodies of a chain": (lambda n: scenes.chain(n, run), 1024),
        "loops of a lattice": (lambda n: scenes.lattice(n, run), 200),
    }
    for name, (make, first) in families.items():
        sizes = [first, 2 * first] if quick else [first, 2 * first, 4 * first]
        costs = []
        for size in sizes:
            text = make(size)
            runs = [run_process("set_up", text) for _ in range(3)]
            if None in runs:
                fail(f"biela refused the deck of {size} {name}")
            costs.append(min(r[2] for r in runs))
        words = ", ".join(f"{cost:.2f} s with {size}" for size, cost in zip(sizes, costs))
        table.add(f"set-up by {name}: {words}; exponent {growth(sizes, costs):.2f}")


def milliseconds(runs):
    """Processor and clock times of some runs of run_process, in words."""
    processor, clock = ([r[k] * 1e3 for r in runs] for k in (2, 0))
    return (
        f"{median(processor):.1f} ms of the processor ({min(processor):.1f} .. {max(processor):.1f}), "
        f"{median(clock):.1f} ms by the clock ({min(clock):.1f} .. {max(clock):.1f})"
    )


def verdicts(table, rod, rigid, flexible, dense):
    """Growth exponents and the figures to watch."""
    table.add()
    for name, found, first in (
        ("elements", {e: p for (e, t), p in rod.items() if t == 0}, 32),
        ("rigid links", rigid, 32),
        ("flexible links", flexible, 32),
    ):
        sizes = [s for s in sorted(found) if s >= first]
        if len(sizes) > 1:
            exponent = growth(sizes, [found[s]["step"][1] for s in sizes])
            memory = (found[sizes[-1]]["memory"] - found[sizes[0]]["memory"]) / (sizes[-1] - sizes[0])
            table.add(
                f"growth of a step with {name}, {sizes[0]} to {sizes[-1]}: exponent {exponent:.3f}; memory {memory:.2f} kB each"
            )
    for elements, parts in dense.items():
        table.add(
            f"the paper's dense way, {elements} elements, 1 term: {parts['dense'][0]:.0f} us a step, "
            f"{parts['dense'][1] / parts['step'][1]:.0f} times the structured one"
        )


def pictures(rod, rigid, flexible):
    """Cost against size, log-log, and the parts of a step."""
    figure, axes = plt.subplots(1, 2, figsize=(11, 4.2))
    for terms in TERMS:
        sizes = [e for e, t in sorted(rod) if t == terms]
        axes[0].loglog(sizes, [rod[e, terms]["step"][0] for e in sizes], "o-", label=f"{terms} GHM terms")
    sizes = [e for e, t in sorted(rod) if t == 0]
    axes[0].loglog(sizes, [rod[e, 0]["floor"][0] for e in sizes], "k--", label="4 (2 DPBTRS + 3 DSBMV)")
    axes[0].set(xlabel="elements of the rod", ylabel="microseconds a step", title="slider-crank, rk4 with projection")
    for found, label in ((rigid, "rigid links"), (flexible, "links of 4 elements")):
        axes[1].loglog(sorted(found), [found[n]["step"][0] for n in sorted(found)], "o-", label=label)
    axes[1].set(xlabel="links of the chain", ylabel="microseconds a step", title="pendulum chain, rk4 with projection")
    for axis in axes:
        axis.grid(alpha=0.3)
        axis.legend()
    figure.tight_layout()
    figure.savefig(RESULTS / "bench_growth.png", dpi=150)
    plt.close(figure)


def main():
    """Runs all scenes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="leave the largest scenes out")
    quick = parser.parse_args().quick
    if not BENCH.exists():
        fail(f"{BENCH} is missing: make bench builds it")
    WORK.mkdir(parents=True, exist_ok=True)
    RESULTS.mkdir(exist_ok=True)
    table = Table()
    table.add("biela: cost of a step, processor time. Medians of 3 runs of 9 repetitions, with the least and the most.")
    table.add("rhs: share of the step's four right-hand sides, solve: of the banded solves in them, proj.: of a projection with")
    table.add("one correction; us/row: one row of history and energy; /floor: step over the floor; set-up: ms of building and")
    table.add("assembling; MB: peak memory of the process. Shares and ratios are taken from the least times.")
    rod = rods(table, quick)
    rigid = chains(table, 0, quick)
    flexible = chains(table, 4, quick)
    table.head("four-bar: driven crank, viscoelastic coupler and elastic rocker of 4 elements")
    table.scene("four-bar", measure([("four_bar", scenes.four_bar(scenes.transient(1e-6, 20_000)), 7)])[0], 8, "element")
    run = scenes.transient(scenes.explicit_step(32), 20_000)
    sizes = (2, 8) if quick else (2, 8, 32)
    jobs = [(f"dense{e}", scenes.slider_crank(e, run, 1), 3 + 0.26 * e, True) for e in sizes]
    dense = dict(zip(sizes, measure(jobs)))
    implicit(table)
    evaluations(table, WORK, run_process, quick)
    maxwell(table, measure, run_process, WORK, quick)
    shapes(table, run_process, WORK, quick)
    friction_trade(table, BIELA)
    friction_cost(table, BIELA)
    promises(table, BIELA, 12 if quick else 120, int(os.environ.get("PROMISE_SEED", "1")))
    shipped(table, BIELA)
    for kind in STUDIES:
        reductions(table, BIELA, 10 if quick else 100, int(os.environ.get("REDUCTION_SEED", "1")), kind)
    whole_processes(table, quick)
    analyses(table, quick)
    set_ups(table, quick)
    verdicts(table, rod, rigid, flexible, dense)
    (RESULTS / "bench.txt").write_text("\n".join(table.lines) + "\n")
    (WORK / "bench.json").write_text(json.dumps({f"{e} {t}": p for (e, t), p in rod.items()}, indent=1))
    pictures(rod, rigid, flexible)
    print("written: results/bench.txt, results/bench_growth.png")


if __name__ == "__main__":
    main()
