"""Speed against accuracy, measured for a deck: which method, which step, and the smallest model that is good enough.

Runs variants of the deck, measures the error of its sensors against a converged truth, takes out of the model what the sensors
do not notice, and writes into results/tradeoff/<deck name>/:
  tradeoff.txt         every run: error, seconds, evaluations; what each removal changes; the cheapest adequate setting
  recommended.nml      the deck with that setting and model, comments kept; error and speed-up are those of its own run
  work_precision.png   error against seconds
  kept/                all runs, by the hash of their deck: an interrupted study resumes

The truth is the deck's own model converged in time (--truth deck), or a refined one (--truth refined: nodal coordinates, axial
deformation, a finer mesh); materials, loads and bodies that the deck calls rigid are taken as they are.

Exit status: 0 recommended.nml meets the tolerance, 1 nothing does (within the budget), 2 the deck or the command line is wrong,
130 interrupted: the same command continues.

Example: post/tradeoff.py input/four_bar.nml --sensor rocker motor --tolerance 1e-2
"""

import math
import os
from pathlib import Path

from .. import command
from ..tradeoff_settings import METHODS

parser = command.parser("tradeoff", __doc__, runs_solver=True)
parser.add_argument("deck", type=Path, help="the deck, with a &transient and sensors")
seconds = {"type": command.positive, "metavar": "SECONDS"}
parser.add_argument("--sensor", nargs="+", default=[], metavar="NAME", help="sensors or columns (tip.v) to get right (all)")
parser.add_argument("--tolerance", type=command.positive, default=1.0e-3, help="largest error over the range (%(default)g)")
parser.add_argument("--budget", **seconds, default=math.inf, help="of a recommended run at most (any)")
parser.add_argument("--truth", choices=["deck", "refined"], default="deck", help="measures errors (%(default)s)")
parser.add_argument("--methods", nargs="+", choices=METHODS, default=list(METHODS), help="methods that are tried (all)")
parser.add_argument("--output", type=Path, help="folder (results/tradeoff/<deck name>)")
parser.add_argument("--jobs", type=command.count, default=os.cpu_count() or 1, help="runs at a time (%(default)s)")
parser.add_argument("--longest-run", **seconds, default=120.0, help="of any run at most (%(default)g)")
parser.add_argument("--time", **seconds, default=600.0, help="of the whole study (%(default)g)")
parser.add_argument("--quiet", action="store_true", help="no progress bar")

main = command.program(parser, "tradeoff_work.work")
