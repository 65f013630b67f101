"""biela in Python: the reader of its results, the runner of its decks, the programs of post/.

import biela
run = biela.read("results/four_bar")
run.time, run["tip.v"]
"""

import importlib

_MODULES = {
    "History": "histories",
    "HistoryError": "result_files",
    "Outcome": "deck_runs",
    "Runner": "deck_runs",
    "read": "histories",
    "read_summary": "histories",
}
__all__ = ["History", "HistoryError", "Outcome", "Runner", "read", "read_summary"]


def __getattr__(name: str) -> object:
    """Return a name of `__all__`; its module is loaded now, so that `--help` of a program does not wait for numpy."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_MODULES[name]}", __name__), name)
