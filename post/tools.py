"""The tools as commands of an installed package: `biela-plot` calls `tools.plot`, and so on."""

from __future__ import annotations

import functools
import importlib

import command


def __getattr__(name: str) -> functools.partial:
    """Return a tool by the name of its module, ready to be called."""
    if name.startswith("_"):
        raise AttributeError(name)
    module = importlib.import_module(f"{__package__}.{name}" if __package__ else name)
    return functools.partial(command.run, module.main)
