"""Whether the estimated errors of left-out modes and of meshes are those beside better models: random scenes.

Each scene has at least one body in modes, some with static shapes, others nodal, some with geometric stiffening; chains, loops,
drives, springs in the middle of a body, GHM, large rotations. A column counts where its error is settled (radau at 1e-8 and at 1e-7
agree to a tenth of it, both in modes and in nodal coordinates) and above 1e-5 of its range. Then modes='auto' with static
shapes is asked for accuracies and judged against the runs in nodal coordinates.

Scenes for meshes are drawn alike, all nodal, with two or four elements a beam, most with some damping, since undamped waves ask for
more time than there is; the truth has eight times as many, at 1e-7 and 1e-6, and a column counts where that differs from four times
as many by less than a fifth of the error.

    REDUCTION_SEED=7 REDUCTION_SCENES=40 python tests/bench/bench_reduction.py bin/biela [modes|meshes]
"""

from __future__ import annotations

import os
import random
import re
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Callable

import bench_promise
import numpy as np
from bench_promise import Drawn, Printed, Ran, errors, ranges, run
from random_scenes import scene, sensors

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


def coarse(seed: int, number: int) -> Drawn:
    """Return a scene whose beams have few elements, with every place on them a share of the length."""
    dice = random.Random(f"coarse/{seed}/{number}")
    drawn = next(d for k in range(1, 100) if "kind='beam'" in (d := scene(seed, 1000 * number + k)).text)
    counts = {name: int(n) for name, n in re.findall(r"&body name='(\w+)' kind='beam'[^/]*?elements=(\d+)", drawn.text)}
    groups = []
    for group in re.findall(r"&.*?/\n", re.sub(r"modes=\d+", "", drawn.text), re.DOTALL):
        if "quantity='internal'" in group or "quantity='coordinate'" in group:
            continue
        placed = group
        for suffix, name in re.findall(r"\bbody(_a|_b|)='(\w+)'", group):
            if name in counts:
                placed = re.sub(rf"\bnode{suffix}=(-?\d+)", lambda m, n=counts[name], s=suffix: f"at{s}={share(m[1], n)!r}", placed)
        groups.append(placed)
    text = re.sub(r"elements=\d+", lambda _: f"elements={dice.choice([2, 2, 4])}", "".join(groups))
    more = f" rayleigh_stiffness={10.0 ** dice.uniform(-5.0, -3.5):.3g}" if dice.random() < 0.75 else ""
    text = re.sub(r"rayleigh_stiffness=\S+", "", text) if more else text
    return Drawn(re.sub(r"(&material [^/]*?young=\S+)", rf"\1{more}", text), min(drawn.time, 0.05))


def tolerances(digits: int) -> tuple[str, str]:
    """Return two settings of radau."""
    return tuple(f"method='radau' tolerance=1e-{k}" for k in (digits, digits - 1))


def share(node: str, elements: int) -> float:
    """Return where a node is: at an end or in the middle, which every mesh has."""
    if node == "-1":
        return 1.0
    return 0.5 * round(2 * (int(node) - 1) / elements)


def finer(drawn: Drawn, times: int) -> Drawn:
    """Return the scene with more elements."""
    return Drawn(re.sub(r"elements=(\d+)", lambda m: f"elements={times * int(m[1])}", drawn.text), drawn.time)


@dataclass
class Study:
    """How one kind of estimate is judged."""

    draw: Callable[[int, int], Drawn]
    better: Callable[[Drawn], list[Drawn]]  # the truth, then what it has to agree with
    key: str
    errors: str  # names of figures
    cost: str
    auto: tuple[str, str] | None  # what becomes what, for promises
    unsure: float  # agreement of the truths, of the error of a column
    truths: tuple[str, str]


STUDIES = {
    "modes": Study(
        reduced, lambda d: [whole(d)], "check_reduction", "errors", "cost",
        (r"modes=\d+(\s+static_shapes=\.true\.)?", "modes='auto' static_shapes=.true."), 0.1, tolerances(8),
    ),
    "meshes": Study(
        coarse, lambda d: [finer(d, 8), finer(d, 4)], "check_mesh", "mesh_errors", "mesh_cost",
        None, 0.2, tolerances(7),
    ),
}  # fmt: skip


@dataclass
class Verdict:
    """What a scene has shown."""

    ratios: dict[str, float] = field(default_factory=dict)  # of estimate and error, by column
    promises: dict[float, tuple[bool, float]] = field(default_factory=dict)  # by accuracy: kept as it says, error over it
    cost: float = float("nan")  # of the pilots, over that of the run in nodal coordinates


def gaps(a: Ran, b: Ran) -> np.ndarray:
    """Return the largest difference of each column."""
    return abs(a.data - b.data)[:, 1:].max(axis=0)


def judge(program: Path, study: Study, seed: int, number: int) -> Verdict | None:
    """Return what a scene shows; None where a truth fails or takes too long."""
    drawn = study.draw(seed, number)
    given = [run(program, drawn, words) for words in study.truths]
    if None in given:
        return None
    first, *others = study.better(drawn)
    truths = [run(program, first, words) for words in study.truths] + [run(program, deck, study.truths[0]) for deck in others]
    found = run(program, drawn, f"{study.truths[0]} {study.key}=.true.")
    if None in (*truths, found):
        return None
    verdict, extent = Verdict(), ranges(truths[0], drawn.time)
    apart = np.maximum.reduce([gaps(truths[0], t) for t in truths[1:]])
    error, unsure = gaps(given[0], truths[0]), np.maximum(gaps(*given), apart)
    told = found.figures["reduction"]
    for k, (name, estimate) in enumerate(told[study.errors].items()):
        if error[k] > LEAST * extent[k] > 0 and unsure[k] < study.unsure * error[k]:
            verdict.ratios[name] = estimate / error[k]
    verdict.cost = told[study.cost] / truths[0].cost
    for asked in ASKED if study.auto else ():
        found = run(program, Drawn(re.sub(*study.auto, drawn.text), drawn.time), f"accuracy={asked}")
        settled = (extent > 0) & (apart < SETTLED * asked * extent)
        if found and settled.any():
            error = errors(found, truths[0], np.where(settled, extent, 0.0)) / asked
            verdict.promises[asked] = (found.figures["accuracy"]["kept"], error)
    return verdict


def reductions(table, program: Path, count: int, seed: int, kind: str) -> None:
    """Add the table: how near the estimates come, and which promises hold."""
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        found = list(pool.map(lambda number: (number, judge(program, STUDIES[kind], seed, number)), range(count)))
    judged = [v for _, v in found if v]
    x = np.array([r for v in judged for r in v.ratios.values()])
    table.add()
    table.add(f"errors of {kind}, {count} random scenes of seed {seed}: {len(judged)} with truths, {len(x)} columns settled")
    near, low, lost = (100.0 * np.mean(y) for y in ((x < 3) & (x > 1 / 3), x < 1 / 3, x < 0.1))
    table.add(f"  estimates within a factor 3: {near:.1f} %, below a third: {low:.1f} %, below a tenth: {lost:.1f} %")
    table.add(f"  cost of the pilots over the run of the better model: median {np.median([v.cost for v in judged]):.2f}")
    for asked in ASKED:
        mine = [v.promises[asked] for v in judged if asked in v.promises]
        promised = [error for yes, error in mine if yes]
        kept = sum(error <= 1 for error in promised)
        table.add(f"  'auto', accuracy {asked:.0e}: {len(mine)} settled, {len(promised)} promised, {kept} kept")
    for number, verdict in found:
        for name, ratio in (verdict.ratios if verdict else {}).items():
            if not 1 / 3 < ratio < 3:
                table.add(f"  off: scene {number}, {name}: estimate {ratio:.2g} of the error")
        for asked, (promised, error) in (verdict.promises if verdict else {}).items():
            if promised and error > 1:
                table.add(f"  broken: scene {number} at {asked:.0e}: error {error:.1f} of what was asked")


if __name__ == "__main__":
    bench_promise.LIMIT = 20  # of a run, of the processor [s]
    scenes, first = (int(os.environ.get(f"REDUCTION_{key}", usual)) for key, usual in (("SCENES", "40"), ("SEED", "1")))
    for what in sys.argv[2:] or STUDIES:
        reductions(Printed(), Path(sys.argv[1]).resolve(), scenes, first, what)
