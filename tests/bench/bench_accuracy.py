"""What accuracy costs on stiff and damped scenes: evaluations and processor time of radau and generalized_alpha at equal error.

An evaluation is one residual of all bodies: each stage's counts for radau, each Newton iteration for generalized_alpha. Time is
that of the march, without what a run of no length takes. The error is that of the scene's worst named column over its range,
against radau at a tolerance of 1e-9.
"""

import re
import sys
from itertools import pairwise
from math import exp, log
from pathlib import Path

HERE = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(HERE / "post"))
from biela.histories import read  # noqa: E402

RADAU = [f"method='radau' tolerance={x}" for x in ("1e-1", "3e-2", "1e-2", "3e-3", "1e-3", "3e-4", "1e-4", "1e-5", "1e-6", "1e-7")]
TRUTH = "method='radau' tolerance=1e-9"
SMOOTH = [  # the crank starts from rest, its rod has three GHM terms
    (r"young=2.0e11", "young=2.0e11 ghm_alpha=0.1,0.1,0.1 ghm_zeta=1.0,1.0,1.0 ghm_omega=1e3,1e4,1e5"),
    (r"angular_velocity=\S+", ""),
    (r"&history.*", "&history name='speed' kind='cycloid' start_value=0.0 end_value=150.0 start=0.0 finish=0.02 /"),
]
# scene: (deck, changes, t_end [s], steps of generalized_alpha from [s], named columns)
SCENES = {
    **{
        f"ivp_slider_crank, {n} elements": (
            "ivp_slider_crank",
            [("elements=8", f"elements={n}"), ("node=5", f"node={n // 2 + 1}")],
            0.02,
            2e-5,
            ["slider.x", "rod", "mid.v"],
        )
        for n in (8, 16, 64)
    },
    "four-bar from equilibrium": ("four_bar_from_equilibrium", [], 0.3, 1e-3, ["coupler_mid.v", "rocker_mid.v", "rocker"]),
    "elastomer cantilever": ("elastomer_cantilever", [], 0.5, 1e-3, ["tip.v", "tip.r"]),
    "slider-crank from rest, three GHM terms": ("ivp_slider_crank", SMOOTH, 0.04, 1e-4, ["slider.x", "rod", "mid.v"]),
}


def run(folder, run_process, deck, words):
    """Return history, evaluations and processor time [s] of a run."""
    if run_process("accuracy", deck.format(words)) is None:
        return None
    results = folder / "accuracy"
    text = (results / "summary.txt").read_text(encoding="utf-8")
    count = re.search(r"evaluations of the residual: (\d+)", text) or re.search(r"Newton iterations: (\d+)", text)
    return read(results / "history.txt"), int(count[1]), float(re.search(r"(\S+) s of the processor", text)[1])


def at_error(points, wanted):
    """Return evaluations and time at an error, between the two runs around it on logarithmic scales; None beyond them."""
    for coarse, fine in pairwise(points):
        if coarse[0] >= wanted > fine[0]:
            share = log(coarse[0] / wanted) / log(coarse[0] / fine[0])
            return [exp(log(a) + share * log(b / a)) for a, b in zip(coarse[1:], fine[1:])]
    return None


def evaluations(table, folder, run_process, quick):
    """Add the table."""
    table.add()
    table.add("evaluations (processor seconds) at equal error: radau by tolerance, generalized_alpha by step, and their ratios")
    for scene, (name, changes, t_end, step, columns) in list(SCENES.items())[: 2 if quick else 6]:
        deck = (HERE / "input" / f"{name}.nml").read_text(encoding="utf-8")
        for old, new in changes:
            deck = re.sub(old, new, deck)
        deck = deck.replace("'materials/", f"'{HERE}/input/materials/").replace("{", "{{").replace("}", "}}")
        deck = re.sub(r"&transient[^/]*/", f"&transient t_end={t_end} output_step={t_end / 100} {{}} /", deck)
        truth = run(folder, run_process, deck, TRUTH)
        still = re.sub(r"t_end=\S+ output_step=\S+", "t_end=1e-9 output_step=1e-9", deck)
        before = run(folder, run_process, still, RADAU[0])[2]
        found = {}
        for method in ("radau", "generalized_alpha"):
            steps = [f"method='{method}' step={step / 2**k:.17g}" for k in range(3 if quick else 12)]
            words = RADAU if method == "radau" else steps
            found[method] = []
            for text in words:
                done = run(folder, run_process, deck, text)
                if done is None:
                    continue
                gaps = [abs(done[0][c] - truth[0][c]).max() / (truth[0][c].max() - truth[0][c].min()) for c in columns]
                found[method].append((max(gaps), done[1], max(done[2] - before, 1e-4)))
                if max(gaps) < 1e-6:
                    break
        for wanted in (1e-4, 1e-6):
            costs = {method: at_error(points, wanted) for method, points in found.items()}
            words = [f"{method} {c[0]:.0f} ({c[1]:.3f})" if c else f"{method} -" for method, c in costs.items()]
            if all(costs.values()):
                a, b = costs.values()
                words.append(f"ratios {b[0] / a[0]:.1f} ({b[1] / a[1]:.1f})")
            table.add(f"{scene}, {wanted:.0e}: {', '.join(words)}")
