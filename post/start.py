"""Starts a program of the package biela, which lies beside this file, by the project's own Python where there is one."""

import os
import sys

HERE = os.path.dirname(os.path.realpath(__file__))
OWN = os.path.join(os.path.dirname(HERE), ".venv")


def start(name: str) -> None:
    """Run a program by its name with the words of the command line; does not return."""
    python = os.path.join(OWN, "bin", "python")
    if os.access(python, os.X_OK) and os.path.realpath(sys.prefix) != os.path.realpath(OWN):
        os.execv(python, [python, os.path.join(HERE, name + ".py"), *sys.argv[1:]])
    sys.path[0] = HERE
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # to start threads takes longer than what they would compute
    from biela import tools

    getattr(tools, name)()
