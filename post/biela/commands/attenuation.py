"""Damping in the rod, in the joint, in both: runs the four decks slider_crank_joint_*, draws them, prints the attenuation.

`make joints` calls it from the project's root. Results go to results/<deck name>/, the picture to results/joints/.

Example: post/attenuation.py
"""

from __future__ import annotations

import argparse
from pathlib import Path

from .. import command


def arguments() -> argparse.ArgumentParser:
    """Return the command line's parser."""
    parser = command.parser("attenuation", __doc__)
    parser.add_argument("--biela", type=Path, default=command.SOLVER, help="the solver (bin/biela of the project)")
    return parser


def main(words: list[str] | None = None) -> int:
    """Run the four cases; status 0, or 1 with one line on standard error."""
    args = arguments().parse_args(words)
    from ..attenuation import tabulate

    return command.attempt("attenuation", lambda: tabulate(args.biela), failed=1)
