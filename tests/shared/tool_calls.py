"""The tools of post/ called inside the tests' own process: a start of Python takes a second, what it does often less."""

from __future__ import annotations

import contextlib
import io
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Callable


@dataclass(frozen=True)
class Said:
    """How a tool ended, under the names that `subprocess.run` gives."""

    returncode: int
    stdout: str
    stderr: str


def call(main: Callable[[list[str]], int], *words: object, cwd: Path) -> Said:
    """Return what a tool says and its exit status when it is called with words in a folder."""
    out, err, before = io.StringIO(), io.StringIO(), Path.cwd()
    os.chdir(cwd)
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            status = main([str(word) for word in words])
    except SystemExit as ended:  # argparse refuses the words
        status = ended.code if isinstance(ended.code, int) else 1
    finally:
        os.chdir(before)
    return Said(status, out.getvalue(), err.getvalue())
