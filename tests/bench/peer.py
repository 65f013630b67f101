"""`make bench-peer`: biela beside exudyn 1.13.6 on one slider-crank and on chains of links: error against seconds.

Each program's mid-rod deflection is compared with its own converged run; steps alone differ within a curve. Seconds of
the solver alone and of the whole process, medians of five runs. Written: results/peer.txt, results/peer.png. exudyn is
installed into an environment of its own, build/peer-venv.
"""

import os
import re
import subprocess
import sys
import time
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import peer_scene
import bench_scenes as scenes

ROOT = Path(__file__).resolve().parents[2]
BIELA = Path(os.environ.get("BIELA", "bin/biela")).resolve()
VENV = ROOT / "build" / "peer-venv"
WORK = ROOT / "build" / "peer"
RESULTS = ROOT / "results"
VERSION = "1.13.6"
POINTS = 125  # instants at which deflections are compared
ERRORS = (1e-3, 1e-4, 1e-5)


def install():
    """Makes exudyn's environment; ends with one line where that does not work."""
    python = VENV / "bin" / "python"
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", str(VENV)], check=True)
    ask = [str(python), "-c", "import exudyn; print(exudyn.__version__)"]
    have = subprocess.run(ask, capture_output=True, text=True, check=False)
    if VERSION in have.stdout:
        return python
    get = [str(python), "-m", "pip", "install", "-q", f"exudyn=={VERSION}"]
    done = subprocess.run(get, capture_output=True, text=True, check=False)
    if done.returncode:
        reason = (done.stderr.strip().splitlines() or ["pip failed"])[-1]
        sys.exit(f"bench-peer: exudyn {VERSION} cannot be installed for Python {sys.version.split()[0]}: {reason}")
    return python


def slider_crank(elements, steps, method, modes):
    """The deck of the common scene."""
    x, y = peer_scene.crank_end()
    basis = f" modes={modes}" if modes else ""
    step = peer_scene.END / steps
    return (
        "&scene title='slider-crank' /\n" + scenes.materials(0)
        + f"&body name='rod' kind='beam' length={peer_scene.LENGTH} elements={elements} material='rod' section='rod' "
        f"position={x:.16g},{y:.16g} angle={peer_scene.rod_angle():.16g} reference='pinned'{basis} /\n"
        f"&joint name='crank' type='distance' body_a='rod' node_a=1 point_b=0.0,0.0 length={peer_scene.CRANK} /\n"
        "&joint name='slider' type='slider' body_a='rod' node_a=-1 direction=0.0 /\n"
        f"&force name='push' type='force' body='rod' node=1 fx={peer_scene.FORCE[0]} fy={peer_scene.FORCE[1]} /\n"
        f"&sensor name='mid' quantity='deflection' body='rod' node={elements // 2 + 1} /\n"
        f"&transient t_end={peer_scene.END} method='{method}' step={step:.16g} output_step={peer_scene.END / POINTS:.16g} /\n"
    )


def run_biela(model, steps):
    """Seconds of the solver, of the process, and the deflections; None where the step is refused or unstable."""
    elements, method, modes = model
    deck = WORK / "deck.nml"
    deck.write_text(slider_crank(elements, steps, method, modes))
    folder = WORK / "biela"
    start = time.perf_counter()
    done = subprocess.run([str(BIELA), "--quiet", "--output", str(folder), str(deck)], capture_output=True, check=False)
    process = time.perf_counter() - start
    if done.returncode:
        return None
    seconds = float(re.search(r"timing: analyses took\s+(\S+) s", (folder / "summary.txt").read_text()).group(1))
    return seconds, process, np.loadtxt(folder / "history.txt")[:, 2]


def run_exudyn(model, steps):
    """The same of exudyn, whose model is a scene of peer_exudyn and its elements."""
    out = WORK / "exudyn.txt"
    script = Path(__file__).with_name("peer_exudyn.py")
    command = [str(VENV / "bin" / "python"), str(script), model[0], str(model[1]), str(steps), "modified", str(out)]
    start = time.perf_counter()
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=WORK)
    process = time.perf_counter() - start
    found = re.search(r"seconds (\S+)", done.stdout)
    if not found:
        return None
    return float(found.group(1)), process, np.loadtxt(out, ndmin=2)[:: max(1, steps // POINTS), 1]


def curve(run, model, steps, reference):
    """(steps, error, seconds alone, seconds of the process) for every number of steps that works, medians of five."""
    points = []
    for n in steps:
        runs = [run(model, n) for _ in range(5)]
        if None in runs:
            continue
        values = runs[0][2]
        if len(values) != len(reference):
            continue
        error = np.abs(values - reference).max() / np.abs(reference).max()
        points.append((n, error, sorted(r[0] for r in runs)[2], sorted(r[1] for r in runs)[2]))
    return points


def seconds_at(points, error, column):
    """Seconds at which a curve reaches an error, between its points in logarithms; None where it does not."""
    best = None
    for (_, e0, *t0), (_, e1, *t1) in zip(points, points[1:]):
        if min(e0, e1) <= error <= max(e0, e1) and e0 != e1:
            share = np.log(error / e0) / np.log(e1 / e0)
            here = float(np.exp((1 - share) * np.log(t0[column]) + share * np.log(t1[column])))
            best = here if best is None else min(best, here)
    if points and best is None and points[0][1] <= error:
        best = points[0][2 + column]
    return best


class Report:
    """Lines for the terminal and for results/peer.txt."""

    def __init__(self):
        self.lines = []

    def add(self, text=""):
        """Adds and shows a line."""
        self.lines.append(text)
        print(text, flush=True)


def compare(report, title, jobs, references):
    """One block: curves of all models against their programs' references; returns {label: points}."""
    report.add()
    report.add(title)
    truth = {name: run(model, steps) for name, (run, model, steps) in references.items()}
    for name, result in truth.items():
        if result is None:
            sys.exit(f"bench-peer: the reference of {name} failed")
    curves = {}
    implicit = run_biela((32, "generalized_alpha", 0), 2000) is not None  # a step that no explicit method can take
    for label, (program, run, model, steps) in jobs.items():
        if "generalized_alpha" in model and not implicit:
            report.add(f"{label}: this build does not offer generalized_alpha")
            continue
        points = curve(run, model, steps, truth[program][2])
        if not points:
            report.add(f"{label}: this build does not offer it, or no step is stable")
            continue
        curves[label] = points
        for n, error, alone, process in points:
            each = alone / n * 1e6
            report.add(
                f"{label:<34}{n:>8} steps  error {error:.2e}  {alone * 1e3:9.2f} ms alone  {process * 1e3:9.1f} ms process"
                f"  {each:8.2f} us/step"
            )
    programs = {label: jobs[label][0] for label in curves}
    report.add(f"{'milliseconds at error':<34}" + "".join(f"{e:>12.0e} alone     process" for e in ERRORS))
    for label, points in curves.items():
        cells = ""
        for error in ERRORS:
            for column in (0, 1):
                value = seconds_at(points, error, column)
                cells += f"{'-' if value is None else format(value * 1e3, '.2f'):>{18 if column == 0 else 12}}"
        report.add(f"{label:<34}{cells}")
    for error in ERRORS:
        ratio = []
        for column in (0, 1):
            best = {}
            for label, points in curves.items():
                value = seconds_at(points, error, column)
                if value is not None:
                    best[programs[label]] = min(value, best.get(programs[label], value))
            if len(best) == 2:
                ratio.append(f"{best['exudyn'] / best['biela']:.1f} times ({'alone' if column == 0 else 'process'})")
        if ratio:
            report.add(f"at error {error:.0e} exudyn's fastest takes " + ", ".join(ratio) + " the time of biela's fastest")
    return curves


def chains(report):
    """Microseconds a step and link, by the difference of two run lengths."""
    report.add()
    report.add("chain of rigid links: microseconds a link and step (biela: rk4 with projection; exudyn: implicit, sparse solver)")
    for links in (8, 32, 128, 512, 2048):
        short = max(10, 4000 // links)
        costs = []
        for program in ("biela", "exudyn"):
            each = []
            for _ in range(3):
                pair = [chain_seconds(program, links, n) for n in (short, 4 * short)]
                each.append((pair[1] - pair[0]) / (3 * short * links) * 1e6)
            costs.append(sorted(each)[1])
        report.add(f"{links:>6} links: biela {costs[0]:7.3f}   exudyn {costs[1]:7.3f}   ratio {costs[1] / costs[0]:5.1f}")


def chain_seconds(program, links, steps):
    """Seconds of one chain's march."""
    if program == "exudyn":
        return run_exudyn(("chain", links), steps)[0]
    deck = WORK / "chain.nml"
    deck.write_text(scenes.chain(links, scenes.transient(1.0e-6, steps)))
    subprocess.run([str(BIELA), "--quiet", "--output", str(WORK / "chain"), str(deck)], capture_output=True, check=True)
    return float(re.search(r"took\s+(\S+) s", (WORK / "chain" / "summary.txt").read_text()).group(1))


def picture(blocks):
    """Error against seconds, one panel a block."""
    figure, axes = plt.subplots(1, len(blocks), figsize=(6.2 * len(blocks), 4.8), sharey=True)
    for axis, (title, curves) in zip(axes, blocks):
        for label, points in curves.items():
            style = "s--" if label.startswith("exudyn") else "o-"
            axis.loglog([p[2] for p in points], [p[1] for p in points], style, label=label, markersize=4)
        axis.set(xlabel="seconds of the solver alone", title=title)
        axis.grid(alpha=0.3)
        axis.legend(fontsize=8)
    axes[0].set_ylabel("largest error of the mid-rod deflection, relative to its largest value")
    figure.tight_layout()
    figure.savefig(RESULTS / "peer.png", dpi=150)
    plt.close(figure)


def main():
    """Runs both programs."""
    WORK.mkdir(parents=True, exist_ok=True)
    RESULTS.mkdir(exist_ok=True)
    install()
    report = Report()
    report.add(f"biela beside exudyn {VERSION} (implicit trapezoidal rule of index 2, modified Newton; sparse above 8 elements)")
    report.add("slider-crank, massless crank and slider, 10 ms; error of the mid-rod deflection at 125 instants over its largest")
    fine = [POINTS * 2**k for k in range(2, 9)]
    two = compare(
        report, "two elements, each program's own converged two-element run is its reference",
        {
            "biela, nodal, rk4": ("biela", run_biela, (2, "rk4", 0), fine),
            "biela, nodal, generalized_alpha": ("biela", run_biela, (2, "generalized_alpha", 0), fine),
            "exudyn, ANCF cable": ("exudyn", run_exudyn, ("cable", 2), fine),
        },
        {"biela": (run_biela, (2, "rk4", 0), POINTS * 2**10), "exudyn": (run_exudyn, ("cable", 2), POINTS * 2**11)},
    )
    frame = compare(
        report, "two elements, floating frames (the same Hermite functions in both)",
        {
            "biela, nodal, rk4": ("biela", run_biela, (2, "rk4", 0), fine),
            "exudyn, floating frame": ("exudyn", run_exudyn, ("frame", 2), fine[:6]),
        },
        {"biela": (run_biela, (2, "rk4", 0), POINTS * 2**10), "exudyn": (run_exudyn, ("frame", 2), POINTS * 2**9)},
    )
    many = compare(
        report, "32 elements: each program free to choose its model, its converged run of 32 elements is its reference",
        {
            "biela, 8 elements, rk4": ("biela", run_biela, (8, "rk4", 0), [POINTS * 2**k for k in range(5, 8)]),
            "biela, 32 elements, rk4": ("biela", run_biela, (32, "rk4", 0), [POINTS * 400, POINTS * 800]),
            "biela, 32 elements, 4 modes, rk4": ("biela", run_biela, (32, "rk4", 4), fine),
            "biela, 32 elements, 8 modes, rk4": ("biela", run_biela, (32, "rk4", 8), fine),
            "biela, 32 elements, 16 modes, rk4": ("biela", run_biela, (32, "rk4", 16), fine),
            "biela, 16 elements, rk4": ("biela", run_biela, (16, "rk4", 0), [POINTS * 120, POINTS * 240]),
            "biela, 32 el., generalized_alpha": ("biela", run_biela, (32, "generalized_alpha", 0), fine[:5]),
            "exudyn, 2 cables": ("exudyn", run_exudyn, ("cable", 2), fine),
            "exudyn, 8 cables": ("exudyn", run_exudyn, ("cable", 8), fine[:6]),
            "exudyn, 32 cables": ("exudyn", run_exudyn, ("cable", 32), fine[:6]),
        },
        {"biela": (run_biela, (32, "rk4", 0), POINTS * 1600), "exudyn": (run_exudyn, ("cable", 32), POINTS * 2**9)},
    )
    chains(report)
    (RESULTS / "peer.txt").write_text("\n".join(report.lines) + "\n")
    picture([("two elements, ANCF", two), ("two elements, floating frames", frame), ("32 elements", many)])
    print("written: results/peer.txt, results/peer.png")


if __name__ == "__main__":
    main()
