"""biela in Python: `run` makes results, `read` reads those that are there; the programs of post/ as functions.

import biela
run = biela.run("input/four_bar.nml", set={"transient/t_end": 0.5})
run.time, run["coupler_mid.v"], run.summary.transient.steps
history = biela.read("results/four_bar")
"""

import importlib

_MODULES = {
    "BielaError": "result_files",
    "History": "histories",
    "HistoryError": "result_files",
    "Result": "session",
    "SolverError": "session",
    "fit": "session",
    "identify": "session",
    "modes": "session",
    "optimise": "session",
    "read": "histories",
    "read_summary": "histories",
    "report": "session",
    "run": "session",
    "sensitivity": "session",
    "spectrum": "session",
    "sweep": "session",
    "tradeoff": "session",
}
__all__ = list(_MODULES)


def __getattr__(name: str) -> object:
    """Return a name of `__all__`; its module is loaded now, so that `--help` of a program does not wait for numpy."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_MODULES[name]}", __name__), name)
