"""Whether `accuracy` keeps its promise, and what that costs: random scenes against settled truths and against single settings.

A truth is settled for an accuracy where radau and dopri5 at a tolerance of 1e-10 agree to a hundredth of it in all columns. The
cheapest single setting is the tolerance of dopri5 or radau which keeps the accuracy in truth, as nobody could know beforehand. Cost
is counted in explicit evaluations, of all passes.

    PROMISE_SEED=7 PROMISE_SCENES=60 [PROMISE_KINDS=springs,ringing] python tests/bench/bench_promise.py bin/biela
    python tests/bench/bench_promise.py bin/biela shipped
"""

from __future__ import annotations

import json
import os
import random
import re
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(HERE / "post"), str(HERE / "tests" / "shared")]
from biela.histories import read  # noqa: E402
from random_scenes import Drawn, chain, crank, scene, sensors  # noqa: E402
from random_springs import random_springs  # noqa: E402

ASKED = (1e-2, 1e-3, 1e-5)
TRUTHS = ("method='radau' tolerance=1e-10", "method='dopri5' tolerance=1e-10")
LADDER = [f"method='{m}' tolerance=1e-{k}" for m in ("dopri5", "radau") for k in range(2, 9)]
SETTLED = 0.01  # agreement of the two truths, of the accuracy
ROWS = 200
LIMIT = 10  # of a single run, of the processor [s]
PASSES = 6  # of these for a run with an accuracy
WEIGHTS = {"radau": ("residual_evaluations", 2.2), "generalized_alpha": ("newton_iterations", 3.5)}  # in explicit evaluations


@dataclass
class Ran:
    """What a run left: its figures, rows, events."""

    figures: dict
    kinds: list[str]  # of each column: the quantity of its sensor, its unit in brackets
    data: np.ndarray
    events: list[tuple[float, str]] = field(default_factory=list)

    @property
    def cost(self) -> float:
        """Return explicit evaluations, the work of implicit methods weighted."""
        if "accuracy" in self.figures:
            return self.figures["accuracy"]["cost"]
        found = self.figures["transient"]
        key, weight = WEIGHTS.get(found["method"], ("evaluations", 0.0))
        return found["evaluations"] + weight * found[key]


def stopped(seed: int, number: int, rigid: bool = False) -> Drawn:
    """Return a chain that swings against a stop."""
    dice = random.Random(f"{'rigid' if rigid else 'stops'}/{seed}/{number}")
    text = chain(dice)
    while rigid and "kind='beam'" in text:  # a rigid stop meets rigid bodies
        text = chain(dice)
    bodies = text.split("&body ")[1:]
    law = f"exponent={dice.choice([1.0, 1.5, 1.5, 2.0])} restitution={dice.choice([1.0, 0.9, 0.7, 0.5])}"
    if dice.random() < 0.5:
        angle = float(re.search(r"angle=(\S+)", bodies[0])[1])
        limits = f"lower={angle - dice.uniform(0.05, 0.4):.4f} upper={angle + dice.uniform(0.05, 0.4):.4f}"
        text += f"&stop name='st' type='rotation' body_a='b0' {limits} stiffness={10.0 ** dice.uniform(1.0, 3.5):.4g} {law} /\n"
    else:
        place = "node_a=-1" if "kind='beam'" in bodies[-1].split("/")[0] else "point_a=0.1,0.0"
        text += f"&stop name='st' type='position' body_a='b{len(bodies) - 1}' {place} direction=1.5707963267948966\n"
        text += f"  lower={-dice.uniform(0.2, 0.9):.4f} stiffness={10.0 ** dice.uniform(2.0, 5.0):.4g} {law} /\n"
    if rigid:
        text = re.sub(r"stiffness=\S+ exponent=\S+ (restitution=\S+ /\n)$", r"\1", text)
    text = "&scene gravity=0.0,-9.81 /\n" + text + sensors(text) + "&sensor name='st' quantity='stop' stop='st' /\n"
    return Drawn(text, 10.0 ** dice.uniform(-0.7, 0.2))


def rubbing(seed: int, number: int) -> Drawn:
    """Return a chain or a slider-crank with dry friction in its joints."""
    dice = random.Random(f"friction/{seed}/{number}")
    text = dice.choice([chain, crank])(dice)
    for kind, more in (("revolute", " pin_radius=0.01"), ("slider", "")):
        rough = dice.uniform(0.05, 0.3)
        words = f"type='{kind}' friction={rough:.4f} friction_static={rough * dice.uniform(1.0, 1.4):.4f}{more}"
        text = text.replace(f"type='{kind}'", words)
    text = "&scene gravity=0.0,-9.81 /\n" + text + sensors(text)
    return Drawn(text, 10.0 ** dice.uniform(-0.7, 0.2))


def steered(seed: int, number: int) -> Drawn:
    """Return a chain whose first link a controller with limits turns."""
    dice = random.Random(f"steered/{seed}/{number}")
    text = chain(dice)
    angle = float(re.search(r"angle=(\S+)", text.split("&body ")[1])[1])
    time, place = 10.0 ** dice.uniform(-0.5, 0.2), "node=1" if "kind='beam'" in text.split("&body ")[1] else ""
    most = 10.0 ** dice.uniform(0.5, 1.5)
    text += f"&sensor name='turn' quantity='angle' body='b0' {place} /\n"
    text += f"&history name='path' kind='cycloid' start_value={angle} end_value={angle + dice.uniform(-1.0, 1.0):.4f} "
    text += f"start=0.0 finish={0.6 * time:.4f} /\n"
    gains = f"kp={10.0 ** dice.uniform(1.0, 2.5):.4g} ki={dice.uniform(0.0, 50.0):.4g} kd={10.0 ** dice.uniform(-1.0, 0.5):.4g}"
    limits = f"lower={-most:.4g} upper={most:.4g} windup_time=0.1"
    text += f"&controller name='servo' argument='turn' history='path' {gains} filter=0.002 {limits} /\n"
    text += f"&force name='motor' type='torque' body='b0' {place} moment=1.0 controller='servo' /\n"
    return Drawn("&scene gravity=0.0,-9.81 /\n" + text + sensors(text), time)


def springs(seed: int, number: int) -> Drawn:
    """Return bodies on stiff springs, dampers and GHM terms that turn."""
    text = random_springs(1000 * seed + number)
    return Drawn(text + sensors(text), 10.0 ** random.Random(1000 * seed + number).uniform(-2.5, -1.0))


def like(words: str, wanted: bool, seed: int, number: int) -> Drawn:
    """Return a random scene with a beam, and with or without words in it."""
    tries = (scene(seed, 100 * number + k) for k in range(1, 100))
    return next(d for d in tries if "kind='beam'" in d.text and bool(re.search(words, d.text)) == wanted)


def damped(seed: int, number: int) -> Drawn:
    """Return a viscoelastic scene whose terms are fast and whose materials may have stiffness-proportional damping."""
    drawn, dice = like("ghm_alpha", True, seed + 1, number), random.Random(f"damped/{seed}/{number}")
    faster = 10.0 ** dice.uniform(0.0, 1.5)
    text = re.sub(
        r"ghm_omega=(\S+)", lambda m: "ghm_omega=" + ",".join(f"{faster * float(x):.4e}" for x in m[1].split(",")), drawn.text
    )
    more = f" rayleigh_stiffness={10.0 ** dice.uniform(-5.0, -3.0):.3g}" if dice.random() < 0.6 else ""
    return Drawn(re.sub(r"(&material [^/]*?young=\S+)", rf"\1{more}", text), drawn.time)


KINDS = {
    "random": scene,
    "springs": springs,
    "stops": stopped,
    "rigid stops": lambda seed, number: stopped(seed, number, rigid=True),
    "friction": rubbing,
    "controllers": steered,
    "viscoelastic": lambda seed, number: like("ghm_alpha", True, seed, number),
    "damped": damped,
    "ringing": lambda seed, number: like("ghm_alpha|rayleigh", False, seed, number),
}


def run(program: Path, drawn: Drawn, words: str, times: int = 1) -> Ran | None:
    """Return what a run leaves; None where it fails or takes too long."""
    return run_text(program, drawn.text + f"&transient t_end={drawn.time!r} output_step={drawn.time / ROWS!r} {words} /\n", times)


def run_text(program: Path, deck: str, times: int) -> Ran | None:
    """Return what a whole deck leaves."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "scene.nml").write_text(deck, encoding="utf-8")
        command = ["prlimit", f"--cpu={times * LIMIT}", str(program), "--quiet", "--output", "found", "scene.nml"]
        if subprocess.run(command, cwd=folder, capture_output=True, check=False).returncode:
            return None
        found = Path(folder) / "found"
        history = read(found)
        lines = (found / "events.txt").read_text(encoding="utf-8").splitlines() if (found / "events.txt").exists() else []
        events = [(float(line.split()[0]), " ".join(line.split()[1:4])) for line in lines if not line.startswith("#")]
        asked = {m[1]: m[2] for m in re.finditer(r"&sensor\s+name='([^']+)'[^/]*?quantity='([^']+)'", deck)}
        kinds = [f"{asked.get(name.rsplit('.', 1)[0], '')}[{history.units[name]}]" for name in history.names[1:]]
        return Ran(json.loads((found / "summary.json").read_text(encoding="utf-8")), kinds, history.data, events)


def errors(a: Ran, b: Ran, extent: np.ndarray) -> float:
    """Return the largest difference of two runs over the ranges, rows between an event and its partner left out."""
    keep = np.ones(len(a.data), bool)
    for one, other in zip(a.events, b.events):
        first, last = sorted((one[0], other[0]))
        keep &= ~((a.data[:, 0] >= first) & (a.data[:, 0] <= last))
        if one[1] != other[1]:
            keep &= a.data[:, 0] < first
    unmatched = sorted(a.events[len(b.events) :] + b.events[len(a.events) :])
    if unmatched:
        keep &= a.data[:, 0] < unmatched[0][0]
    gap = abs(a.data - b.data)[keep, 1:].max(axis=0, initial=0.0)
    return float((gap[extent > 0] / extent[extent > 0]).max(initial=0.0))


def alike(a: Ran, b: Ran) -> bool:
    """Return whether two runs have the same events: beyond those that differ no row is compared, and a wrong run looks right."""
    return sorted(words for _, words in a.events) == sorted(words for _, words in b.events)


def ranges(truth: Ran, time: float) -> np.ndarray:
    """Return the columns' ranges that count: zero for rounding, at least a thousandth of the largest one of the same kind.

    Rounding is beside the largest value of the unit, or of 1 kg that moves 1 m within the run.
    """
    x, units = truth.data[:, 1:], [kind.split("[")[1][:-1] for kind in truth.kinds]
    found = np.zeros(len(units))
    for k, unit in enumerate(units):
        per = unit.count("/s") + unit.count("/s2") + 2 * unit.startswith(("N", "Pa"))
        largest = max([time**-per] + [abs(x[:, j]).max() for j in range(len(units)) if units[j] == unit])
        extent = np.ptp(x[:, k])
        found[k] = extent if extent > 1e-10 * largest and unit != "-" else 0.0
    least = [1e-3 * max(found[j] for j in range(len(units)) if truth.kinds[j] == kind) for kind in truth.kinds]
    return np.where(found > 0, np.maximum(found, least), 0.0)


def judge(program: Path, seed: int, kind: str, number: int) -> dict[float, dict] | None:
    """Return for each accuracy whether it was promised and kept, and the cost over that of the best single setting."""
    drawn = KINDS[kind](seed, number)
    truths = [run(program, drawn, words) for words in TRUTHS]
    if None in truths:
        return None
    extent = ranges(truths[0], drawn.time)
    apart = errors(*truths, extent)
    singles = [found for words in LADDER if (found := run(program, drawn, words))]
    verdicts = {}
    for asked in ASKED:
        if apart > SETTLED * asked:
            continue
        found = run(program, drawn, f"accuracy={asked}", PASSES)
        best = min((s.cost for s in singles if alike(s, truths[0]) and errors(s, truths[0], extent) <= asked), default=float("nan"))
        kept = bool(found) and found.figures["accuracy"]["kept"]
        off = errors(found, truths[0], extent) / asked if found else float("nan")
        verdicts[asked] = {"promised": kept, "error": off, "ratio": found.cost / best if found else float("nan")}
    return verdicts


def promises(table, program: Path, count: int, seed: int) -> None:
    """Add the table: scenes by kind, how many were promised and kept, what it cost."""
    kinds = os.environ.get("PROMISE_KINDS", ",".join(KINDS)).split(",")
    jobs = [(kinds[k % len(kinds)], k // len(kinds)) for k in range(count)]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        found = list(pool.map(lambda job: (job, judge(program, seed, *job)), jobs))
    table.add()
    table.add(f"accuracy on {count} random scenes of seed {seed}: settled, promised, kept; cost over the best single setting")
    for asked in ASKED:
        for kind in [*KINDS, "all"]:
            mine = [v[asked] for (name, _), v in found if v and asked in v and kind in (name, "all")]
            promised = [v for v in mine if v["promised"]]
            ratios = [v["ratio"] for v in promised if v["ratio"] == v["ratio"]]
            if not ratios:
                continue
            middle, most = np.median(ratios), np.percentile(ratios, 95, method="higher")
            kept = sum(v["error"] <= 1.0 for v in promised)
            words = f"{len(mine)} settled, {len(promised)} promised, {kept} kept; median {middle:.1f}, 95 of 100 at most {most:.1f}"
            table.add(f"  {asked:.0e} {kind}: {words}")
    for (kind, number), verdicts in found:
        for asked, v in (verdicts or {}).items():
            if v["promised"] and not v["error"] <= 1.0:
                table.add(f"  broken: {kind} {number} at {asked:.0e}: error {v['error']:.1f} of what was asked")
            elif not v["promised"]:
                table.add(f"  not promised: {kind} {number} at {asked:.0e}")
            elif v["ratio"] > 10.0:
                table.add(f"  dear: {kind} {number} at {asked:.0e}: {v['ratio']:.1f} times the best single setting")


def shipped(table, program: Path) -> None:
    """Add the table: the decks of input/ with an accuracy in place of their own method and steps."""
    table.add()
    table.add("decks of input/: promised, error over what was asked where the truth is settled, cost in explicit evaluations")
    for path in sorted((HERE / "input").glob("*.nml")):
        command = [str(program), "--flat", str(path)]
        text = subprocess.run(command, capture_output=True, text=True, check=False).stdout  # without other files
        group = re.search(r"&transient [^/]*/ *\n?", text)
        if not group:
            continue
        bare = re.sub(r"\s(method|step|tolerance|first_step|max_step|motion_step|stabilization)=\S+", "", group[0])
        truths = [run_text(program, text.replace(group[0], bare.replace("&transient", f"&transient {w}")), 4) for w in TRUTHS]
        for asked in ASKED:
            found = run_text(program, text.replace(group[0], bare.replace("&transient", f"&transient accuracy={asked}")), 4)
            if not found:
                table.add(f"  {path.stem} at {asked:.0e}: no result in {4 * LIMIT} s of the processor")
                break
            words = "promised" if found.figures["accuracy"]["kept"] else f"not promised: {found.figures['warnings']}"
            if None not in truths:
                extent = ranges(truths[0], float(truths[0].data[-1, 0]))
                settled = errors(*truths, extent) <= SETTLED * asked
                words += f", error {errors(found, truths[0], extent) / asked:.2g}" if settled else ", no settled truth"
            table.add(f"  {path.stem} at {asked:.0e}: {words}, cost {found.cost:.0f}")


class Printed:
    """A table that is printed at once."""

    def add(self, line: str = "") -> None:
        """Print a line."""
        print(line, flush=True)


if __name__ == "__main__":
    if sys.argv[2:] == ["shipped"]:
        shipped(Printed(), Path(sys.argv[1]).resolve())
    else:
        scenes, first = (int(os.environ.get(f"PROMISE_{key}", usual)) for key, usual in (("SCENES", "60"), ("SEED", "1")))
        promises(Printed(), Path(sys.argv[1]).resolve(), scenes, first)
