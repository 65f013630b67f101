"""By how much results change with each free parameter: derivatives with their errors, a table and a tornado picture.

    sensitivity.py STUDY.toml                             at the study's start, else as the deck has its parameters
    sensitivity.py STUDY.toml --at outer=0.015 --at wall=1e-3
    sensitivity.py STUDY.toml --dask tcp://HOST:8786      on the workers of a Dask scheduler that sees this folder

The step of the differences comes from the error that a run measures of itself; the error of a derivative holds that and the step's.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from .. import command


def arguments() -> argparse.ArgumentParser:
    """Return the command line's parser."""
    parser = command.parser("sensitivity", __doc__)
    parser.add_argument("study", type=Path, metavar="STUDY.toml", help="deck, parameters and results (see post/README.md)")
    parser.add_argument(
        "--at", action="append", default=[], metavar="NAME=VALUE", help="value of a parameter; may stand several times"
    )
    parser.add_argument("--output", type=Path, metavar="DIR", help="folder of the table (results/sensitivity/<study name>)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="runs side by side (all cores: %(default)s)")
    parser.add_argument("--dask", metavar="ADDRESS", help="address of a Dask scheduler, instead of this machine's cores")
    parser.add_argument("--no-pictures", action="store_true", help="the table only")
    parser.add_argument("--biela", type=Path, default=command.SOLVER, help="the solver")
    parser.set_defaults(keep=False)
    return parser


def main(words: list[str] | None = None) -> int:
    """Take derivatives; status 0, 1 where the design itself fails, or 2 with one line on standard error."""
    args = arguments().parse_args(words)
    from ..sensitivity_work import sensitivity

    return command.attempt("sensitivity", lambda: sensitivity(args))
