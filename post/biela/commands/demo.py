"""The slider-crank of Vaz, Rade & Lima, undamped against viscoelastic: runs the decks, draws, prints the attenuation.

`make demo` calls it from the project's root. Results go to results/<deck name>/, pictures to results/demo/.

Example: post/demo.py
"""

from __future__ import annotations

import argparse
from pathlib import Path

from .. import command


def arguments() -> argparse.ArgumentParser:
    """Return the command line's parser."""
    parser = command.parser("demo", __doc__)
    parser.add_argument("--biela", type=Path, default=command.SOLVER, help="the solver (bin/biela of the project)")
    return parser


def main(words: list[str] | None = None) -> int:
    """Run the demonstration; status 0, or 1 with one line on standard error."""
    args = arguments().parse_args(words)
    from ..demo import demonstrate

    return command.attempt("demo", lambda: demonstrate(args.biela), failed=1)
