#!/usr/bin/env python3
"""Starts the program by whose name it is called: the other .py files here are links to this one.

The programs are those of biela/commands/; --help says what each does. The project's own Python runs them where there is one.
"""

import os
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
OWN = HERE.parent / ".venv"
PYTHON = OWN / "bin" / "python"

if __name__ == "__main__":
    name = Path(__file__).stem
    if not (HERE / "biela" / "commands" / f"{name}.py").is_file():
        known = ", ".join(sorted(path.stem for path in HERE.glob("*.py") if path.is_symlink()))
        sys.exit(f"{name}: no program of this name; there are {known}")
    if os.access(PYTHON, os.X_OK) and Path(sys.prefix).resolve() != OWN.resolve():
        os.execv(PYTHON, [str(PYTHON), str(HERE / f"{name}.py"), *sys.argv[1:]])
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # to start threads takes longer than what they would compute
    from biela import tools

    getattr(tools, name)()
