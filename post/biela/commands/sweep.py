"""Run a deck over ranges of its parameters and gather numbers of every run into one table.

    sweep.py STUDY.toml                                   all runs on all cores; results/sweep/STUDY/table.csv and pictures
    sweep.py STUDY.toml --best 'min peak' --where 'height < 0.012'
    sweep.py STUDY.toml --dask tcp://HOST:8786            on the workers of a Dask scheduler that sees this folder

An interrupted sweep goes on where it was; what was run is not run again. A run that fails stands in the table with its reason.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from .. import command


def arguments() -> argparse.ArgumentParser:
    """Return the command line's parser."""
    parser = command.parser("sweep", __doc__)
    parser.add_argument("study", type=Path, metavar="STUDY.toml", help="deck, parameters and results (see post/README.md)")
    parser.add_argument("--output", type=Path, metavar="DIR", help="folder of the table (results/sweep/<study name>)")
    parser.add_argument("--best", metavar="'min NAME'", help="name the best run: 'min' or 'max' and a result")
    parser.add_argument("--where", action="append", default=[], metavar="'NAME < VALUE'", help="condition of the best")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="runs side by side (all cores: %(default)s)")
    parser.add_argument("--dask", metavar="ADDRESS", help="address of a Dask scheduler, instead of this machine's cores")
    parser.add_argument("--keep", action="store_true", help="keep all decks and results, with all their sensors")
    parser.add_argument("--no-pictures", action="store_true", help="the table only")
    parser.add_argument("--biela", type=Path, default=command.SOLVER, help="the solver")
    return parser


def main(words: list[str] | None = None) -> int:
    """Sweep; status 0, 1 where every run failed, or 2 with one line on standard error."""
    args = arguments().parse_args(words)
    from ..sweep_work import sweep

    return command.attempt("sweep", lambda: sweep(args))
