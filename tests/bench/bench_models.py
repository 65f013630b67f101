"""What smaller models of the same scene cost and err: Maxwell terms in place of GHM terms, static shapes beside few modes.

Errors are largest differences over the columns' ranges: of the cantilever from itself with GHM terms, of rod and engine from the
full mesh.
"""

import re
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(HERE / "post"))
from bench_scenes import driven_rod, explicit_step, slider_crank, transient  # noqa: E402
from biela.command import SOLVER  # noqa: E402
from biela.deck import read as read_deck  # noqa: E402
from biela.histories import read  # noqa: E402

ELEMENTS = 16  # of rod and engine
MODES = range(1, 29)
WANTED = (1e-2, 1e-3)
COLUMNS = {"moment": ["shank.m1"], "force": ["crank_pin.fx", "crank_pin.fy"]}
ROD = (
    driven_rod(ELEMENTS)
    + "&sensor name='crank_pin' quantity='reaction' joint='crank_pin' /\n"
    + f"&sensor name='shank' quantity='internal' body='rod' element={ELEMENTS // 2} /\n"
    + "&transient t_end=0.06 method='radau' tolerance=1.0e-6 output_step=2.0e-4 /\n"
)


def maxwell(table, measure, run_process, folder, quick):
    """Add what a Maxwell term costs beside a GHM term, and what the measured elastomer loses by its Maxwell terms."""
    table.add()
    for elements in (8, 32) if quick else (8, 32, 128, 512):
        run = transient(explicit_step(elements), 20_000)
        kinds = [(0, "ghm"), (3, "ghm"), (3, "maxwell")]
        jobs = [(f"law_{k}_{n}", slider_crank(elements, run, n, law=k), 3 + (0.23 + 0.04 * n) * elements) for n, k in kinds]
        elastic, ghm, prony = (parts["step"][1] for parts in measure(jobs))
        share = (prony - elastic) / (ghm - elastic)
        table.add(f"a Maxwell term at {elements} elements costs {share:.2f} of a GHM term in a step (three of each)")
    found = []
    for name, step in (("", "5e-6"), ("_maxwell", "5e-6"), ("_maxwell", "1.25e-5")):  # the first and the last near their bounds
        deck = read_deck(HERE / "input" / f"elastomer_cantilever{name}.nml")
        text = deck.set(deck.one("transient"), step=float(step), motion_step=None).flat(SOLVER)
        seconds = min(run_process("law", text)[1] for _ in range(3))
        found.append((f"{seconds:.3f} s at steps of {step} s", read(folder / "law")))
    (slow, ghm), (same, prony), (fast, _) = found
    gap = max(abs(prony[c] - ghm[c]).max() / (ghm[c].max() - ghm[c].min()) for c in ("tip.v", "tip.r", "wall.fy", "wall.m"))
    words = f"three GHM terms {slow}; three Maxwell terms {same}, worst column {gap:.1e} apart; {fast}"
    table.add(f"elastomer cantilever, rk4, 0.5 s: {words}")


def fewest(found, column, wanted):
    """Return the smallest number of coordinates from which on all runs err by less, '-' where none does."""
    sizes = sorted(found)
    good = [n for k, n in enumerate(sizes) if all(found[m][column] < wanted for m in sizes[k:])]
    return str(good[0]) if good else "-"


def ran(run_process, folder, deck):
    """Return the history of a deck and the number of elastic coordinates of its rod."""
    run_process("shapes", deck.flat(SOLVER))
    return read(folder / "shapes"), int(re.search(r'"rod": .*?3 \+ (\d+)', (folder / "shapes" / "summary.txt").read_text())[1])


def shapes(table, run_process, folder, quick):
    """Add the coordinates that bending moments and joint forces take with plain modes and with static shapes beside modes."""
    table.add()
    table.add(f"coordinates of {ELEMENTS} elements from which on bending moment, joint force err by less than 1e-2; 1e-3")
    finer = f"body/rod/elements={ELEMENTS}", f"sensor/mid/node={ELEMENTS // 2 + 1}", f"sensor/shank/element={ELEMENTS // 2}"
    engine = read_deck(HERE / "input" / "engine.nml", *finer)
    values = {"method": "radau", "step": None, "tolerance": 1e-6, "output_step": 1e-4, "motion_step": None}
    engine = engine.set(engine.one("transient"), **values)
    for name, text, variants in (
        ("driven rod", ROD, (("", {}), ("no axial deformation, ", {"axial": False}))),
        ("engine", engine.flat(SOLVER), (("", {}),)),
    ):
        (folder / "model.nml").write_text(text)
        deck, truth = read_deck(folder / "model.nml"), None
        for words, values in variants:
            for basis, option in (("plain modes", {}), ("static shapes", {"static_shapes": True})):
                found = {}
                for modes in MODES[: 6 if quick else 12 if option else 28]:
                    few = deck.set(deck.one("body", "rod"), modes=modes, **values, **option)
                    truth = truth or ran(run_process, folder, deck)[0]
                    history, size = ran(run_process, folder, few)
                    found[size] = {
                        what: max(abs(history[c] - truth[c]).max() / (truth[c].max() - truth[c].min()) for c in columns)
                        for what, columns in COLUMNS.items()
                    }
                told = "; ".join(", ".join(fewest(found, what, wanted) for what in COLUMNS) for wanted in WANTED)
                table.add(f"{name}, {words}{basis}: {told}")
