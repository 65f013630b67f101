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


main = command.program("demo", arguments, "demo.demonstrate", failed=1)
