"""`make bench-peer`: biela beside exudyn 1.13.6 on one slider-crank and on chains of links: error against seconds.

Each program's mid-rod deflection is compared with its own converged run; steps alone differ within a curve. Seconds of the
processor for the solver alone and for the whole process, medians of up to five runs. Written: results/peer.txt and
results/peer.png. exudyn is installed into an environment of its own, build/peer-venv.
"""

import os
import re
import resource
import subprocess
import sys
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "post"))
import bench_scenes as scenes
import matplotlib.pyplot as plt
import numpy as np
import peer_scene
from biela.plot import COLOURS
from scipy.integrate import solve_ivp

ROOT = Path(__file__).resolve().parents[2]
BIELA = Path(os.environ.get("BIELA", "bin/biela")).resolve()
VENV = ROOT / "build" / "peer-venv"
WORK = ROOT / "build" / "peer"
RESULTS = ROOT / "results"
VERSION = "1.13.6"
POINTS = 125  # instants at which deflections are compared
ERRORS = (1e-3, 1e-4, 1e-5)
STOP_ERROR = 1e-6  # of a column's range
STOP_PATIENCE = 10.0  # a run of exudyn that takes longer is the last one that is tried [s]


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


def slider_crank(model, steps):
    """The deck of the common scene; model: elements, method, modes."""
    elements, method, modes = model
    x, y = peer_scene.crank_end()
    basis = f" modes={modes}" if modes else ""
    step = peer_scene.END / steps
    return (
        "&scene title='slider-crank' /\n"
        + scenes.materials(0)
        + f"&body name='rod' kind='beam' length={peer_scene.LENGTH} elements={elements} material='rod' section='rod' "
        f"position={x:.16g},{y:.16g} angle={peer_scene.rod_angle():.16g} reference='pinned'{basis} /\n"
        f"&joint name='crank' type='distance' body_a='rod' node_a=1 point_b=0.0,0.0 length={peer_scene.CRANK} /\n"
        "&joint name='slider' type='slider' body_a='rod' node_a=-1 direction=0.0 /\n"
        f"&force name='push' type='force' body='rod' node=1 fx={peer_scene.FORCE[0]} fy={peer_scene.FORCE[1]} /\n"
        f"&sensor name='mid' quantity='deflection' body='rod' node={elements // 2 + 1} /\n"
        f"&transient t_end={peer_scene.END} method='{method}' step={step:.16g} output_step={peer_scene.END / POINTS:.16g} /\n"
    )


def processor(command, **options):
    """A finished process and the seconds that it took of the processor."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(command, capture_output=True, text=True, check=False, **options)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return done, after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def run_biela(model, steps):
    """Seconds of the solver, of the process, and the deflections; None where the step is refused or unstable."""
    deck = WORK / "deck.nml"
    deck.write_text(slider_crank(model, steps))
    folder = WORK / "biela"
    done, process = processor([str(BIELA), "--quiet", "--output", str(folder), str(deck)])
    if done.returncode:
        return None
    return march_seconds(folder), process, np.loadtxt(folder / "history.txt")[:, 2]


def march_seconds(folder):
    """Seconds that the transient of a run took of the processor, files included."""
    return float(re.search(r"s, +(\S+) s of the processor", (folder / "summary.txt").read_text()).group(1))


def run_exudyn(model, steps):
    """The same of exudyn, whose model is a scene of peer_exudyn and its elements."""
    out = WORK / "exudyn.txt"
    script = Path(__file__).with_name("peer_exudyn.py")
    command = [str(VENV / "bin" / "python"), "-W", "ignore", str(script), model[0], str(model[1]), str(steps), "modified", str(out)]
    done, process = processor(command, cwd=WORK)
    found = re.search(r"seconds (\S+)", done.stdout)
    if not found:
        return None
    rows = np.loadtxt(out, ndmin=2)[:: max(1, steps // POINTS), 1:]
    return float(found.group(1)), process, rows if rows.shape[1] > 1 else rows[:, 0]


def curve(run, model, steps, reference):
    """(steps, error, seconds alone, seconds of the process) for every number of steps that works.

    Medians of five runs, of three where the solver takes more than half a second, one run beyond three seconds.
    """
    points = []
    for n in steps:
        runs = [run(model, n)]
        if None in runs or len(runs[0][2]) != len(reference):
            continue
        repeats = 5 if runs[0][0] < 0.5 else 3 if runs[0][0] < 3.0 else 1
        runs += [run(model, n) for _ in range(repeats - 1)]
        error = np.abs(runs[0][2] - reference).max() / np.abs(reference).max()
        points.append((n, error, sorted(r[0] for r in runs)[repeats // 2], sorted(r[1] for r in runs)[repeats // 2]))
    return points


def seconds_at(points, error, column):
    """Seconds at which a curve reaches an error, between its points in logarithms; None where it does not."""
    best = None
    for (_, e0, *t0), (_, e1, *t1) in zip(points, points[1:]):
        if min(e0, e1) <= error <= max(e0, e1) and e0 != e1:
            share = np.log(error / e0) / np.log(e1 / e0)
            here = float(np.exp((1 - share) * np.log(t0[column]) + share * np.log(t1[column])))
            best = here if best is None else min(best, here)
    met = [t[column] for (_, e, *t) in points if e <= error]
    if met:
        best = min(met) if best is None else min(best, *met)
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
    summarise(report, curves, {label: jobs[label][0] for label in curves})
    return curves


def summarise(report, curves, programs):
    """Milliseconds of every curve at the errors looked at, and how many times longer exudyn's fastest takes."""
    report.add(f"{'milliseconds at error':<34}" + "".join(f"{e:>12.0e} alone     process" for e in ERRORS))
    for label, points in curves.items():
        cells = ""
        for error in ERRORS:
            for column in (0, 1):
                value = seconds_at(points, error, column)
                cells += f"{'-' if value is None else format(value * 1e3, '.2f'):>{18 if column == 0 else 12}}"
        report.add(f"{label:<34}{cells}")
    for error in ERRORS:
        best = {}
        for label, points in curves.items():
            for column, kind in ((0, "alone"), (1, "process")):
                value = seconds_at(points, error, column)
                if value is not None:
                    best[programs[label], kind] = min(value, best.get((programs[label], kind), value))
        report.add(f"at error {error:.0e}: " + ", ".join(ratio(best, kind, curves, programs) for kind in ("alone", "process")))


def ratio(best, kind, curves, programs):
    """How many times longer exudyn takes, in words; a bound where it does not get there."""
    ours, theirs = best.get(("biela", kind)), best.get(("exudyn", kind))
    if ours is None:
        return f"biela does not get there ({kind})"
    if theirs is not None:
        return f"exudyn's fastest takes {theirs / ours:.1f} times as long as biela's ({kind})"
    column = 2 if kind == "alone" else 3
    tried = max(points[-1][column] for label, points in curves.items() if programs[label] == "exudyn")
    return f"exudyn does not get there in {tried / ours:.0f} times biela's time ({kind})"


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
    return march_seconds(WORK / "chain")


def stops_deck(name, settings):
    """The deck of a scene with stops."""
    links, limit, end = peer_scene.STOPS[name]
    half = peer_scene.LINK / 2
    text = "&scene gravity=0.0,-9.81 /\n"
    for k in range(links):
        other = f"body_b='b{k - 1}' " if k else ""
        text += f"&body name='b{k}' mass=1.0 inertia={peer_scene.LINK**2 / 12:.17g} position={(2 * k + 1) * half:.17g},0.0 /\n"
        text += f"&joint name='j{k}' type='revolute' body_a='b{k}' point_a={-half},0.0 {other}point_b={half if k else 0.0},0.0 /\n"
        text += f"&stop name='s{k}' type='rotation' body_a='b{k}' {other}lower={-limit} upper={limit} "
        text += f"stiffness={peer_scene.STIFFNESS} exponent=1 /\n"
    tip = f"body='b{links - 1}' point={half},0.0 /\n"
    text += f"&sensor name='p' quantity='position' {tip}&sensor name='v' quantity='velocity' {tip}"
    text += f"&sensor name='a' quantity='angle' body='b{links - 1}' /\n"
    return text + f"&transient t_end={end} {settings} output_step={end / POINTS:.16g} /\n"


def stops_truth(name):
    """Rows of the same columns by DOP853 on the angles of the links: no program of ours, and none of theirs."""
    links, limit, end = peer_scene.STOPS[name]
    length = peer_scene.LINK
    beyond = links - 1 - np.maximum.outer(np.arange(links), np.arange(links))  # links that both move
    inertia = length**2 * (beyond + np.where(np.eye(links) > 0, 0.25 + 1 / 12, 0.5))
    weight = 9.81 * length * (links - 0.5 - np.arange(links))

    def rates(_, s):
        angle, rate = s[:links], s[links:]
        turn = np.subtract.outer(angle, angle)
        bend = np.diff(angle, prepend=0.0)
        push = peer_scene.STIFFNESS * (np.maximum(bend - limit, 0.0) - np.maximum(-bend - limit, 0.0))
        moment = np.append(push[1:], 0.0) - push - weight * np.cos(angle) - (inertia * np.sin(turn)) @ rate**2
        return np.append(rate, np.linalg.solve(inertia * np.cos(turn), moment))

    times = np.linspace(0.0, end, POINTS + 1)
    s = solve_ivp(rates, (0.0, end), np.zeros(2 * links), "DOP853", times, rtol=1e-12, atol=1e-13, max_step=end / 2000).y
    angle, rate = s[:links], s[links:]
    along = [length * (f(angle) * g).sum(0) for f, g in ((np.cos, 1), (np.sin, 1), (np.sin, -rate), (np.cos, rate))]
    return np.column_stack([*along, angle[-1]])


def run_stops(program, name, setting):
    """Seconds of the solver and the largest error of a column over its range; None where the run fails."""
    if program == "exudyn":
        found = run_exudyn((name, 0), setting)
        rows = found and found[2]
    else:
        (WORK / "stops.nml").write_text(stops_deck(name, setting))
        done = subprocess.run([str(BIELA), "--quiet", "--output", str(WORK / "stops"), str(WORK / "stops.nml")], check=False)
        found = None if done.returncode else (march_seconds(WORK / "stops"),)
        rows = found and np.loadtxt(WORK / "stops" / "history.txt")[:, 1:]
    return found and (found[0], rows)


def stops(report):
    """Scenes with stops: each program's fastest setting whose columns all err by at most 1e-6 of their range."""
    report.add()
    report.add(f"stops, linear and without loss: largest error of a column (end's position, velocity, angle) at {POINTS} instants")
    asked = {
        "biela": [f"method='{m}' tolerance={t}" for m in ("dopri5", "radau") for t in (1e-6, 3e-7, 1e-7, 3e-8, 1e-8)],
        "exudyn": [POINTS * 2**k for k in range(3, 16)],
    }
    for name in peer_scene.STOPS:
        truth, best = stops_truth(name), {}
        for program, settings in asked.items():
            for setting in settings:
                found = run_stops(program, name, setting)
                if found is None:
                    continue
                error = (np.abs(found[1] - truth).max(0) / np.ptp(truth, axis=0)).max()
                report.add(f"{name}, {program}, {setting}: error {error:.1e}, {found[0] * 1e3:.2f} ms")
                if program == "exudyn" or (error <= STOP_ERROR and (program not in best or found[0] < best[program][0])):
                    best[program] = found[0], setting, error
                if program == "exudyn" and (error <= STOP_ERROR or found[0] > STOP_PATIENCE):
                    break
        seconds = {p: sorted(run_stops(p, name, setting)[0] for _ in range(5))[2] for p, (_, setting, _) in best.items()}
        error = best["exudyn"][2]
        report.add(
            f"{name}: biela {best['biela'][1]} {seconds['biela'] * 1e3:.2f} ms, exudyn {best['exudyn'][1]} steps "
            f"{seconds['exudyn'] * 1e3:.2f} ms, medians of five: {'' if error <= STOP_ERROR else 'more than '}"
            f"{seconds['exudyn'] / seconds['biela']:.0f} times"
            + ("" if error <= STOP_ERROR else f", since exudyn still errs by {error:.1e}")
        )


def family(label):
    """Name, colour, marker and line of what a curve belongs to: meshes and numbers of modes of one family look alike."""
    if label.startswith("exudyn"):
        frame = "frame" in label
        return "exudyn, floating frame" if frame else "exudyn, ANCF cables", COLOURS[3] if frame else COLOURS[1], "s", "--"
    if "modes" in label:
        return "biela, modes, rk4", COLOURS[5], "o", "-"
    if "generalized_alpha" in label:
        return "biela, nodes, generalized_alpha", COLOURS[2], "D", "-"
    return "biela, nodes, rk4", COLOURS[0], "^", "-"


def picture(blocks):
    """Error against seconds, one panel a block, as wide as a page."""
    figure, axes = plt.subplots(1, len(blocks), figsize=(8.4, 4.6), sharey=True, layout="constrained")
    marks = {}
    for axis, (title, curves) in zip(axes, blocks):
        for label, points in curves.items():
            name, colour, marker, line = family(label)
            look = {"ls": line, "marker": marker, "color": colour, "ms": 4, "lw": 1}
            axis.loglog([p[2] for p in points], [p[1] for p in points], **look)
            marks[name] = plt.Line2D([], [], label=name, **look)
        axis.set_title(title, fontsize=9)
        axis.set_ylim(1e-7, 0.1)
        axis.tick_params(labelsize=8)
        axis.grid(alpha=0.3)
    figure.supxlabel("seconds of the processor, solver alone", fontsize=9)
    figure.legend(handles=list(marks.values()), loc="outside upper center", ncols=3, fontsize=8, frameon=False)
    axes[0].set_ylabel("largest error of the mid-rod deflection / its largest value", fontsize=9)
    figure.savefig(RESULTS / "peer.png", dpi=100)
    plt.close(figure)


def nodal_steps(report, curves):
    """Steps of 32 elements in nodal coordinates, implicit in both programs."""
    each = {}
    for label in ("biela, 32 el., generalized_alpha", "exudyn, 32 cables"):
        if label in curves:
            each[label] = sorted(t / n for n, _, t, _ in curves[label])[len(curves[label]) // 2] * 1e6
    if len(each) == 2:
        ours, theirs = each.values()
        report.add(
            f"an implicit step of 32 elements, nodal: biela {ours:.2f} us, exudyn {theirs:.2f} us, {theirs / ours:.1f} times"
        )


def main():
    """Runs both programs."""
    WORK.mkdir(parents=True, exist_ok=True)
    RESULTS.mkdir(exist_ok=True)
    install()
    report = Report()
    report.add(f"biela beside exudyn {VERSION} (implicit trapezoidal rule of index 2, modified Newton; sparse above 8 elements)")
    report.add("slider-crank, massless crank and slider, 10 ms; error of the mid-rod deflection at 125 instants over its largest")
    report.add("seconds of the processor; us/step from the solver alone")
    fine = [POINTS * 2**k for k in range(2, 9)]
    two = compare(
        report,
        "two elements, each program's own converged two-element run is its reference",
        {
            "biela, nodal, rk4": ("biela", run_biela, (2, "rk4", 0), fine),
            "biela, nodal, generalized_alpha": ("biela", run_biela, (2, "generalized_alpha", 0), fine),
            "exudyn, ANCF cable": ("exudyn", run_exudyn, ("cable", 2), [*fine, POINTS * 2**9, POINTS * 2**10, POINTS * 2**11]),
        },
        {"biela": (run_biela, (2, "rk4", 0), POINTS * 2**10), "exudyn": (run_exudyn, ("cable", 2), POINTS * 2**14)},
    )
    frame = compare(
        report,
        "two elements, floating frames (the same Hermite functions in both)",
        {
            "biela, nodal, rk4": ("biela", run_biela, (2, "rk4", 0), fine),
            "exudyn, floating frame": ("exudyn", run_exudyn, ("frame", 2), fine[:6]),
        },
        {"biela": (run_biela, (2, "rk4", 0), POINTS * 2**10), "exudyn": (run_exudyn, ("frame", 2), POINTS * 2**9)},
    )
    many = compare(
        report,
        "32 elements: each program free to choose its model, its converged run of 32 elements is its reference",
        free_models(fine),
        {"biela": (run_biela, (32, "rk4", 0), POINTS * 3200), "exudyn": (run_exudyn, ("cable", 32), POINTS * 2**11)},
    )
    nodal_steps(report, many)
    chains(report)
    stops(report)
    (RESULTS / "peer.txt").write_text("\n".join(report.lines) + "\n")
    picture([("2 elements; exudyn: ANCF", two), ("2 elements, floating frames", frame), ("32 elements, any model", many)])
    print("written: results/peer.txt, results/peer.png")


def free_models(fine):
    """Models for the 32-element reference: coarser meshes, nodal coordinates, and more and more modes.

    The force starts suddenly: waves along the rod meet the deflection, and modes and meshes resolve them slowly.
    """
    jobs = {}
    for elements, n in ((8, 32), (16, 120)):
        jobs[f"biela, {elements} elements, rk4"] = ("biela", run_biela, (elements, "rk4", 0), [POINTS * n, 2 * POINTS * n])
    jobs["biela, 32 elements, rk4"] = ("biela", run_biela, (32, "rk4", 0), [POINTS * 400, POINTS * 480, POINTS * 800])
    jobs["biela, 32 el., generalized_alpha"] = ("biela", run_biela, (32, "generalized_alpha", 0), fine[:5])
    thirds = [POINTS * n for n in (48, 64, 96, 128)]
    modal = {8: fine[:4], 16: fine[1:5], 24: fine[2:5], 32: fine[3:6], 48: thirds, 56: thirds[1:], 64: fine[5:7]}
    for modes, steps in modal.items():
        jobs[f"biela, 32 el., {modes} modes, rk4"] = ("biela", run_biela, (32, "rk4", modes), steps)
    for cables, steps in ((2, fine), (8, fine[:6]), (32, [*fine, POINTS * 2**9, POINTS * 2**10])):
        jobs[f"exudyn, {cables} cables"] = ("exudyn", run_exudyn, ("cable", cables), steps)
    return jobs


if __name__ == "__main__":
    main()
