"""What took the energy of a run: friction, stops, viscoelastic materials, dampers.

With decks: runs them, prints what each joint, stop, spring and term of a material has lost, and draws it: over time, and by cause
(results/<deck name>/losses.png). Without: damping in the rod, in the joint, in both (the four decks slider_crank_joint_*), a table
of the attenuation and a picture in results/joints/, as `make joints` does.

Example: post/attenuation.py input/friction_slider_crank.nml
"""

from __future__ import annotations

import argparse
from pathlib import Path

from .. import command


def arguments() -> argparse.ArgumentParser:
    """Return the command line's parser."""
    parser = command.parser("attenuation", __doc__)
    parser.add_argument("decks", type=Path, nargs="*", metavar="DECK.nml", help="whose losses are told")
    parser.add_argument("--biela", type=Path, default=command.SOLVER, help="the solver (bin/biela of the project)")
    return parser


def main(words: list[str] | None = None) -> int:
    """Run the decks or the four cases; status 0, or 1 with one line on standard error."""
    args = arguments().parse_args(words)
    from ..attenuation import causes, tabulate

    return command.attempt("attenuation", lambda: causes(args.biela, args.decks) if args.decks else tabulate(args.biela), failed=1)
