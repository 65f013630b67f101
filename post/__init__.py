"""biela in Python: the reader of its results, the runner of its decks, the tools.

    import biela
    run = biela.read("results/four_bar")
    run.time, run["tip.v"]

Modules of this folder import each other by their plain names, as scripts in one folder do; the installed package (setup.py) has
them under `biela`.
"""

from deck_runs import Outcome, Runner
from histories import History, HistoryError, read, read_summary

__all__ = ["History", "HistoryError", "Outcome", "Runner", "read", "read_summary"]
