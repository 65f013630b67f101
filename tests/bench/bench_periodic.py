"""What cycles cost in turns: `.venv/bin/python tests/bench/bench_periodic.py bin/biela` prints the table of README.md.

plain: turns that running alone takes to 1e-9, by the largest multiplier. Allowed for the cycle: its multipliers above 1e-2 and
10; where plain turns need fewer than 15, 1.2 times theirs. Allowed for the multipliers: those above 1e-3 and 6, twice, since half
of the turns measure the errors.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "dynamics"))
sys.path.insert(0, str(ROOT / "tests" / "shared"))
sys.path.insert(0, str(ROOT / "tests"))
sys.path.insert(0, str(ROOT / "post"))

import test_periodic as scenes  # noqa: E402

ROD = (scenes.REFERENCE / "periodic_rod" / "deck.nml").read_text(encoding="utf-8")
CRANK = (ROOT / "input" / "crank_at_speed.nml").read_text(encoding="utf-8")
CONTROLLED = scenes.CONTROLLED.replace("SAMPLE", "")
DECKS = {
    "ball on a table, stable": scenes.BALL,
    "ball on a table, unstable": scenes.BALL.replace("name='k' value=1", "name='k' value=-1"),
    "impact oscillator": scenes.OSCILLATOR,
    "dry friction": scenes.SLIDER,
    "stick-slip, unknown period": scenes.BELT,
    "rotor, unknown period": scenes.ROTOR,
    "controller": CONTROLLED,
    "controller, strong damping": CONTROLLED.replace("damping=1 ", "damping=40 "),
    "turning arm with GHM": scenes.ARM + "&periodic period={2*pi/40} /\n&transient method='rk4' step={2*pi/40/2000} /\n",
    "crank at 60 rad/s": CRANK.replace("value=100 ", "value=60 "),
    "crank at 100 rad/s": CRANK,
    "crank at 180 rad/s": CRANK.replace("value=100 ", "value=180 "),
    "crank, light damping": CRANK.replace("ghm_alpha=0.25,0.2", "ghm_alpha=0.025,0.02"),
    "crank, undamped": CRANK.replace("ghm_alpha=0.25,0.2 ghm_zeta=1.5,1.5 ghm_omega=300,3000", ""),
    "rod of the reference": ROD,
}


def measured(program: Path, deck: str, folder: Path, *options: str) -> dict:
    """Return the figures of a run's cycle."""
    path = folder / "scene.nml"
    path.write_text(deck, encoding="utf-8")
    subprocess.run([program, "--quiet", *options, path], cwd=folder, check=True, stderr=subprocess.DEVNULL)
    return json.loads((folder / "results" / "scene" / "summary.json").read_text(encoding="utf-8"))["periodic"]


def main(program: Path) -> None:
    """Print a row for each scene."""
    print("| scene | unknowns | above 1e-2 | above 1e-3 | plain | cycle | allowed | multipliers | allowed |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- | --- |")
    for name, deck in DECKS.items():
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch)
            usual = measured(program, deck, folder)
            all_of_them = measured(program, deck, folder, "--set", "periodic/multipliers=1000")
            unknowns = int((folder / "results/scene/orbit.txt").read_text(encoding="utf-8").split("# unknowns: ")[1].split()[0])
        sizes = [one["modulus"] for one in all_of_them["multipliers"]]
        large, small = (sum(size > least for size in sizes) for least in (1e-2, 1e-3))
        first = max(sizes, default=0.0)
        plain = math.ceil(math.log(1e-9) / math.log(first)) if 1e-9 < first < 1 - 1e-6 else math.inf if first > 0.5 else 2
        cycle = min(large, unknowns) + 10 if plain >= 15 else max(math.ceil(1.2 * plain), 2)
        turns, more = usual["turns_to_cycle"], usual["turns"] - usual["turns_to_cycle"]
        print(f"| {name} | {unknowns} | {large} | {small} | {plain} | {turns} | {cycle} | {more} | {2 * (small + 6)} |")


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve())
