"""Write one page (HTML) about a run, or about two runs side by side: it opens from the disk and needs no network.

It begins with the outcome, warnings, largest deflections, stresses and reactions, drives, where energy was lost, frequencies and
damping. Then come the scene, histories, motion, modes, responses, the table of a trade-off where there is one; what the solver did
and the deck stand last. Of two runs the differences are drawn and tabulated, too.

    post/report.py results/slider_crank_elastic results/slider_crank_viscoelastic

writes results/slider_crank_elastic/report.html.
"""

import math
from pathlib import Path

from .. import command

parser = command.parser("report", __doc__)
parser.add_argument("runs", nargs="+", type=Path, metavar="RESULTS", help="one results folder, or two to compare")
parser.add_argument("--labels", nargs="+", metavar="TEXT", help="names of the runs (those of their folders)")
parser.add_argument("--title", help="headline (the first deck's title)")
parser.add_argument("--tradeoff", type=Path, metavar="FOLDER", help="of a trade-off study (results/tradeoff/<deck name>)")
parser.add_argument("--start", type=float, default=-math.inf, metavar="S", help="largest values: rows before do not count")
parser.add_argument("--end", type=float, default=math.inf, metavar="S", help="largest values: rows after do not count")
parser.add_argument("--output", type=Path, metavar="FILE", help="the page (report.html in the first folder)")

main = command.program(parser, "report.work")
