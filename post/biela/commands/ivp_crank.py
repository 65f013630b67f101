"""The flexible slider-crank of the IVP test set: error against its converged history and cost, for every method.

Runs input/ivp_slider_crank.nml with several meshes, methods and steps; prints the table and draws error against evaluations. The
converged history (linear elasticity, by an independent program) is tests/reference/published/crank_conv_lin_ini2.csv.

Example: post/ivp_crank.py
"""

from pathlib import Path

from .. import command
from ..tradeoff_settings import FAMILIES

parser = command.parser("ivp_crank", __doc__, runs_solver=True)
parser.add_argument("--methods", nargs="+", choices=list(FAMILIES), default=list(FAMILIES), help="curves (all)")
parser.add_argument("--output", type=Path, default=Path("results") / "ivp_crank", help="folder (%(default)s)")

main = command.program(parser, "ivp_crank.work", failed=1)
