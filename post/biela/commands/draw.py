"""Draw the assembled mechanism of a deck with its names, before any run: bodies, joints, drives, springs, loads, sensors.

The solver assembles the deck (biela --check --json); a results folder is drawn from its summary.json. Lengths are to scale.

    post/draw.py input/four_bar.nml          writes results/four_bar/scene.png
"""

from pathlib import Path

from .. import command

parser = command.parser("draw", __doc__, runs_solver=True)
parser.add_argument("source", type=Path, metavar="DECK", help="a deck, or a results folder")
parser.add_argument("--output", type=Path, metavar="FILE", help="the picture, .png, .pdf or .svg (results/DECK/scene.png)")

main = command.program(parser, "draw.work")
