"""Draw columns of one or several runs against time (or against another column), as PNG (PDF, SVG by --output); no window is needed.

Columns of one unit share a panel; one that would be a flat line beside its neighbours gets a panel of its own. Columns that are
zero throughout, or rounding beside others of their unit, are left out, unless they are named. Several runs lie over each other in
one picture: the first blue, the second red (elastic, viscoelastic). Lengths against lengths (a path) are drawn to scale.

Example: post/plot.py results/slider_crank_elastic results/slider_crank_viscoelastic --columns 'qf4.*'
"""

from pathlib import Path

from .. import command
from ..result_files import RESULT_FILES

parser = command.parser("plot", __doc__)
parser.add_argument("runs", nargs="+", type=Path, metavar="RUN", help="results folder, results file or .csv")
parser.add_argument("--columns", nargs="+", metavar="NAME", help="columns, wildcards allowed, e.g. 'qf4.*' (all)")
parser.add_argument("--against", metavar="NAME", help="column of the horizontal axis (the first: time, load, frequency)")
parser.add_argument("--file", choices=sorted(RESULT_FILES), default="history", help="which file of results folders (history)")
parser.add_argument("--events", action="store_true", help="mark the events of the runs, e.g. when stops touch, by lines")
parser.add_argument("--labels", nargs="+", metavar="TEXT", help="names of the runs in the legend (those of their folders)")
parser.add_argument("--title", default="", help="written above the picture")
parser.add_argument("--output", type=Path, metavar="FILE", help="the picture, .png, .pdf or .svg (in the first run's folder)")

main = command.program(parser, "plot.plot")
