"""The slider-crank of Vaz, Rade & Lima, undamped against viscoelastic."""

from __future__ import annotations

import argparse
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from . import command, deck_text
from .animate import write as write_motion
from .compare import differences
from .histories import read
from .mechanism import from_run
from .picture_files import save
from .plot import draw, pretty_unit
from .result_files import HistoryError

RESULTS = Path("results")
SENSOR = "qf4"
EXAGGERATE = 30.0


@dataclass(frozen=True)
class Pair:
    """The same scene undamped and viscoelastic: what it shows, and the names of the two decks in input/."""

    title: str
    stem: str
    elastic: str
    viscoelastic: str


PAIRS = [
    Pair("torque on the rod, as in the paper", "torque_on_rod", "slider_crank_elastic", "slider_crank_viscoelastic"),
    Pair("torque on the crank", "torque_on_crank", "slider_crank_crank_torque_elastic", "slider_crank_crank_torque"),
    Pair("rod of 0.0758 kg, torque on it", "paper_mass", "slider_crank_paper_mass_elastic", "slider_crank_paper_mass_viscoelastic"),
]
FINE = "slider_crank_fine_elastic"


def deck(name: str) -> Path:
    """Return the path of a deck of input/."""
    return command.ROOT / "input" / f"{name}.nml"


def run(biela: Path, decks: list[Path]) -> None:
    """Run the solver on decks. HistoryError: the solver is missing or one of the runs failed; its own message stands above."""
    try:
        done = subprocess.run([str(biela.resolve()), "--quiet", *map(str, decks)], check=False)
    except OSError as fault:
        raise HistoryError(f"{biela}: cannot be started ({fault.strerror}); `make` builds it") from None
    if done.returncode:
        raise HistoryError(f"{biela} ended with status {done.returncode}")


def size(values: np.ndarray) -> tuple[float, float]:
    """Return the largest absolute value and the root mean square of a column."""
    return float(np.abs(values).max()), float(np.sqrt(np.mean(values**2)))


def stiff_twin(pair: Pair) -> tuple[Path, float, float]:
    """Write the undamped twin whose rod has the modulus of fast motion; its deck, the frequency [Hz], the modulus over E_R.

    The frequency is the one at which the sensor of the elastic run moves fastest.
    """
    run = read(RESULTS / pair.elastic)
    swing = run[f"{SENSOR}.qd"]
    frequency = float(np.fft.rfftfreq(len(swing), run.time[1])[np.abs(np.fft.rfft(swing - swing.mean())).argmax()])
    text = deck_text.read(deck(pair.viscoelastic))
    alpha, zeta, omega = (np.array(text.one("material", "rod").numbers(f"ghm_{word}")) for word in ("alpha", "zeta", "omega"))
    s = 2j * np.pi * frequency
    modulus = 1.0 + float((alpha * (s**2 + 2 * zeta * omega * s) / (s**2 + 2 * zeta * omega * s + omega**2)).sum().real)
    path = RESULTS / "demo" / f"{pair.stem}_stiff_twin.nml"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text.set(text.one("body", "rod"), viscoelastic=".false.", modulus_at=f"{frequency!r}").text, encoding="utf-8")
    return path, frequency, modulus


def attenuation(pair: Pair, twin: tuple[Path, float, float]) -> list[str]:
    """Return the lines of text that compare the viscoelastic run of a pair with both undamped ones."""
    path, frequency, modulus = twin
    before, after, stiff = (read(RESULTS / name) for name in (pair.elastic, pair.viscoelastic, path.stem))
    lines = [f"{pair.title:44}{'undamped':>11}{'viscoelastic':>14}{'ratio':>8}{'stiff twin':>13}{'ratio':>8}"]
    for word, column in (("velocity", f"{SENSOR}.qd"), ("acceleration", f"{SENSOR}.qdd")):
        label = f"{word} of {SENSOR} [{pretty_unit(before.units[column])}]"
        for measure, a, b, c in zip(("peak", "RMS"), size(before[column]), size(after[column]), size(stiff[column])):
            lines.append(f"  {label:34}{measure:8}{a:>11.4g}{b:>14.4g}{b / a:>8.3f}{c:>13.4g}{b / c:>8.3f}")
    lines.append("  undamped: the static modulus E_R;")
    lines[-1] += f" stiff twin: {modulus:.3g} E_R, the rod's storage modulus at {frequency:.4g} Hz,"
    lines.append(f"  where {SENSOR} moves fastest (viscoelastic=.false. modulus_at={frequency:.4g})")
    energy = read(RESULTS / pair.viscoelastic, "energy")
    lost, work = energy["dissipated"][-1], energy["work"][-1]
    lines.append(
        f"  energy dissipated by the rod: {lost:.4g} J, {100.0 * lost / work:.2g} % of the {work:.4g} J that the torque put in"
    )
    return lines


def picture(pair: Pair) -> Path:
    """Draw velocity and acceleration of the sensor, undamped blue and viscoelastic red."""
    runs = [read(RESULTS / name) for name in (pair.elastic, pair.viscoelastic)]
    title = f"Slider-crank, {pair.title}: rotation of the middle node"
    figure = draw(runs, ["undamped", "viscoelastic"], [f"{SENSOR}.qd", f"{SENSOR}.qdd"], title=title)
    return save(figure, RESULTS / "demo" / pair.stem)


def motion(name: str) -> list[Path]:
    """Draw the moving mechanism with its deflections exaggerated."""
    scene = from_run(read(RESULTS / name, "motion"), EXAGGERATE)
    title = f"{name}: deflections × {EXAGGERATE:g}"
    return write_motion(scene, RESULTS / "demo" / "motion", frames=60, seconds=4.0, title=title)


def mesh() -> list[str]:
    """Return the lines that say how far the paper's mesh is from a finer one, measured on these runs."""
    coarse, fine = read(RESULTS / PAIRS[0].elastic), read(RESULTS / FINE)
    error = {d.name: 100.0 * d.error for d in differences(coarse, fine, columns=[f"{SENSOR}.q", "mid.v"])}
    return [
        "About the mesh: two elements are the paper's choice, and they reproduce the paper, not the rod.",
        f"  Against eight elements the rotation of the middle node ({SENSOR}) is off by {error[f'{SENSOR}.q']:.0f} % of its range,",
        f"  the deflection there by {error['mid.v']:.0f} % (largest difference over the 10 ms, undamped, torque on the rod).",
    ]


def demonstrate(args: argparse.Namespace) -> int:
    """Run the demonstration and print its figures; raises HistoryError."""
    run(args.biela, [deck(name) for pair in PAIRS for name in (pair.elastic, pair.viscoelastic)] + [deck(FINE)])
    twins = [stiff_twin(pair) for pair in PAIRS]
    run(args.biela, [path for path, _, _ in twins])
    print("Slider-crank of Vaz, Rade & Lima: rod of two elements, 10 ms, RK4 with a step of 4 µs\n")
    drawn = []
    for pair, twin in zip(PAIRS, twins):
        print("\n".join(attenuation(pair, twin)) + "\n")
        drawn.append(picture(pair))
    print("\n".join(mesh()) + "\n")
    drawn += motion(PAIRS[1].elastic)
    print(f"Pictures in {drawn[0].parent}/: " + ", ".join(path.name for path in drawn))
    return 0
