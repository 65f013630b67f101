"""Compare two histories, or a history with a reference: the largest difference of each column, relative to its range.

The rule, for the tests too:
- Rows are matched by time: each time of the reference must be in the run (to a millionth of the reference's shortest
  interval); further rows of the run do not count. Every column of the reference must be in the run, further ones do not count.
- The error of a column is its largest difference over all rows, divided by the range (largest minus smallest value) that
  the column has in the reference.
- A column that is constant in the reference (range below 1e-13 of its size or of the following) is measured by the largest
  range among the reference's columns of the same unit: a channel that should be zero stays zero, next to channels that are
  not. A constant column alone in its unit is measured by its own size, and one that is zero by 1 of its unit (1 m, 1 N ...).
- A column passes when its error is at most its tolerance.

Exit status: 0 every column within its tolerance, 1 some are not, 2 the files cannot be compared.

Example: post/compare.py results/slider_crank_elastic expected.csv --tolerance 1e-5
"""

import argparse
from pathlib import Path

from .. import command


def _pair(text: str) -> tuple[str, float]:
    name, mark, value = text.rpartition("=")
    try:
        number = float(value)
    except ValueError:
        number = -1.0
    if not (mark and name and 0.0 <= number < float("inf")):
        raise argparse.ArgumentTypeError(f"{text!r}: NAME=TOLERANCE expected")
    return name, number


def _tolerance(text: str) -> float:
    return _pair(f"all={text}")[1]
parser = command.parser("compare", __doc__)
parser.add_argument("run", type=Path, help="results folder, history file or .csv")
parser.add_argument("reference", type=Path, help="results folder, history file or .csv")
parser.add_argument("--tolerance", type=_tolerance, default=1.0e-6, help="largest error of a column (%(default)g)")
parser.add_argument("--columns", nargs="+", metavar="PATTERN", help="compare these columns only, e.g. 'qf4.*' (all)")
parser.add_argument(
    "--column", type=_pair, action="append", default=[], metavar="PATTERN=TOLERANCE", help="another tolerance, of some columns"
)
parser.add_argument("--file", choices=["history", "energy", "motion"], default="history", help="which file of results folders")

main = command.program(parser, "compare.compare")
