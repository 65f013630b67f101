"""Whether the estimated errors of left-out modes are those of a run in modes beside one in nodal coordinates: random scenes.

Each scene has at least one body in modes, some with static shapes, others nodal, some with geometric stiffening; chains, loops,
drives, springs in the middle of a body, GHM, large rotations. A column counts where its error is settled (radau at 1e-8 and at 1e-7
agree to a tenth of it, both in modes and in nodal coordinates) and above 1e-5 of its range. Then modes='auto' with static
shapes is asked for accuracies and judged against the runs in nodal coordinates.

    REDUCTION_SEED=7 REDUCTION_SCENES=40 python tests/bench/bench_reduction.py bin/biela
"""

from __future__ import annotations

import os
import random
import re
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import bench_promise
import numpy as np
from bench_promise import Drawn, Printed, Ran, errors, ranges, run
from random_scenes import scene, sensors

TRUTHS = ("method='radau' tolerance=1e-8", "method='radau' tolerance=1e-7")
SETTLED = 0.1  # agreement of the truths, of the error of a column
LEAST = 1e-5  # error of a column that counts, of its range
ASKED = (1e-2, 1e-3)


def reduced(seed: int, number: int) -> Drawn:
    """Return a scene with bodies in modes."""
    dice = random.Random(f"reduced/{seed}/{number}")
    drawn = next(d for k in range(1, 100) if "kind='beam'" in (d := scene(seed, 1000 * number + k)).text)
    text = re.sub(r"&sensor.*?/\n", "", drawn.text)
    bodies = re.findall(r"&body name='(\w+)' kind='beam'.*?/\n", text, re.DOTALL)
    for name in bodies:
        old = re.search(rf"&body name='{name}' kind='beam'.*?/\n", text, re.DOTALL)[0]
        elements = 2 * dice.randint(2, 5)
        new = re.sub(r"axial=\.false\.|modes=\d+", "", re.sub(r"elements=\d+", f"elements={elements}", old))
        if name == bodies[0] or dice.random() < 0.5:
            more = f"modes={dice.randint(1, 5)} {dice.choice(['', '', '', 'static_shapes=.true.'])}"
            if dice.random() < 0.3:
                more += " axial=.false."
            elif dice.random() < 0.2:
                new = re.sub(r"reference='\w+'", "reference='free'", new)
        else:
            more = dice.choice(["", "stiffening=.true."])
        text = text.replace(old, new.replace(" /\n", f" {more} /\n"))
        if dice.random() < 0.3:
            text += f"&spring name='mid{name}' type='linear' body_a='{name}' node_a={elements // 2 + 1} point_b=0.3,0.9\n"
            text += f"  stiffness={10.0 ** dice.uniform(0.5, 2.5):.3f} damping={dice.choice([0.0, 0.2])} /\n"
    return Drawn(text + sensors(text), min(drawn.time, 0.1))


def whole(drawn: Drawn) -> Drawn:
    """Return the same scene in nodal coordinates, or in all modes of the mesh where the frame is that of free bodies."""

    def mesh(found: re.Match) -> str:
        text = re.sub(r"modes=\d+|static_shapes=\.true\.", "", found[0])
        nodes = 1 + int(re.search(r"elements=(\d+)", text)[1])
        modes = (2 if "axial=.false." in text else 3) * (nodes - 1)
        return text.replace("reference='free'", f"reference='free' modes={modes}")

    return Drawn(re.sub(r"&body name='\w+' kind='beam'.*?/\n", mesh, drawn.text, flags=re.DOTALL), drawn.time)


@dataclass
class Verdict:
    """What a scene has shown."""

    ratios: dict[str, float] = field(default_factory=dict)  # of estimate and error, by column
    promises: dict[float, tuple[bool, float]] = field(default_factory=dict)  # by accuracy: kept as it says, error over it
    cost: float = float("nan")  # of the pilots, over that of the run in nodal coordinates


def gaps(a: Ran, b: Ran) -> np.ndarray:
    """Return the largest difference of each column."""
    return abs(a.data - b.data)[:, 1:].max(axis=0)


def judge(program: Path, seed: int, number: int) -> Verdict | None:
    """Return what a scene shows; None where a truth fails or takes too long."""
    drawn = reduced(seed, number)
    mesh = [run(program, whole(drawn), words) for words in TRUTHS]
    modes = [run(program, drawn, words) for words in TRUTHS]
    found = run(program, drawn, f"{TRUTHS[0]} check_reduction=.true.")
    if None in (*mesh, *modes, found):
        return None
    verdict, extent = Verdict(), ranges(mesh[0], drawn.time)
    error, unsure = gaps(modes[0], mesh[0]), np.maximum(gaps(*mesh), gaps(*modes))
    told = found.figures["reduction"]
    for k, (name, estimate) in enumerate(told["errors"].items()):
        if error[k] > LEAST * extent[k] > 0 and unsure[k] < SETTLED * error[k]:
            verdict.ratios[name] = estimate / error[k]
    verdict.cost = told["cost"] / mesh[0].cost
    auto = re.sub(r"modes=\d+(\s+static_shapes=\.true\.)?", "modes='auto' static_shapes=.true.", drawn.text)
    for asked in ASKED:
        found = run(program, Drawn(auto, drawn.time), f"accuracy={asked}")
        if found and errors(*mesh, extent) < SETTLED * asked:
            verdict.promises[asked] = (found.figures["accuracy"]["kept"], errors(found, mesh[0], extent) / asked)
    return verdict


def reductions(table, program: Path, count: int, seed: int) -> None:
    """Add the table: how near the estimates come, and which promises hold."""
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        found = list(pool.map(lambda number: (number, judge(program, seed, number)), range(count)))
    judged = [v for _, v in found if v]
    x = np.array([r for v in judged for r in v.ratios.values()])
    table.add()
    table.add(f"left-out modes, {count} random scenes of seed {seed}: {len(judged)} with truths, {len(x)} columns settled")
    near, low, lost = (100.0 * np.mean(y) for y in ((x < 3) & (x > 1 / 3), x < 1 / 3, x < 0.1))
    table.add(f"  estimates within a factor 3: {near:.1f} %, below a third: {low:.1f} %, below a tenth: {lost:.1f} %")
    table.add(f"  cost of the pilots over the run in nodal coordinates: median {np.median([v.cost for v in judged]):.2f}")
    for asked in ASKED:
        mine = [v.promises[asked] for v in judged if asked in v.promises]
        promised = [error for yes, error in mine if yes]
        kept = sum(error <= 1 for error in promised)
        table.add(f"  modes='auto', accuracy {asked:.0e}: {len(mine)} settled, {len(promised)} promised, {kept} kept")
    for number, verdict in found:
        for name, ratio in (verdict.ratios if verdict else {}).items():
            if not 1 / 3 < ratio < 3:
                table.add(f"  off: scene {number}, {name}: estimate {ratio:.2g} of the error")
        for asked, (promised, error) in (verdict.promises if verdict else {}).items():
            if promised and error > 1:
                table.add(f"  broken: scene {number} at {asked:.0e}: error {error:.1f} of what was asked")


if __name__ == "__main__":
    bench_promise.LIMIT = 40.0  # of a run [s]
    scenes, first = (int(os.environ.get(f"REDUCTION_{key}", usual)) for key, usual in (("SCENES", "40"), ("SEED", "1")))
    reductions(Printed(), Path(sys.argv[1]).resolve(), scenes, first)
