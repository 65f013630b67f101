"""Draw what frequencies a run holds: amplitude spectrum, power spectral density, waterfall, orders of a drive, decay.

    spectrum.py results/four_bar --columns 'tip.*'                  amplitudes and power spectral density (Welch)
    spectrum.py results/four_bar --columns tip.v --waterfall        against time
    spectrum.py results/run_up --columns tip.v --waterfall --speed crank.v      against the speed of a drive
    spectrum.py results/run_up --columns tip.v --orders crank       in orders of the rotation of column crank [rad]
    spectrum.py results/ring_down --columns tip.v --decay           envelope, logarithmic decrement, damping ratio

Rows at uneven times are interpolated to as many even ones. Mean and trend are removed first. Peaks are marked
and named, each with how surely it is known; two lines need some 4 periods of their difference in the run to be told apart.
"""

import math
from pathlib import Path

from .. import command

parser = command.parser("spectrum", __doc__)
parser.add_argument("run", type=Path, metavar="RUN", help="results folder, results file or .csv")
parser.add_argument("--columns", nargs="+", required=True, metavar="NAME", help="columns, wildcards allowed")
parser.add_argument("--start", type=float, default=-math.inf, metavar="S", help="rows before this time do not count")
parser.add_argument("--end", type=float, default=math.inf, metavar="S", help="rows after this time do not count")
kind = parser.add_mutually_exclusive_group()
kind.add_argument("--waterfall", action="store_true", help="amplitudes against time or --speed (one column)")
kind.add_argument("--orders", metavar="ANGLE", help="column of a drive's angle [rad]: orders of its rotation")
kind.add_argument("--decay", action="store_true", help="envelope, logarithmic decrement, damping ratio")
parser.add_argument("--speed", metavar="COLUMN", help="with --waterfall: column of the drive's speed")
parser.add_argument("--peaks", type=int, default=5, metavar="N", help="peaks that are named (%(default)s)")
parser.add_argument("--output", type=Path, metavar="FILE", help="the picture: .png, .pdf, .svg (spectrum.png beside the run)")

main = command.program(parser, "spectrum_work.work")
