"""The programs as commands of an installed package: `biela-plot` calls `tools.plot`, and so on."""

from __future__ import annotations

import functools
import importlib

from . import command


def __getattr__(name: str) -> functools.partial:
    """Return a program by its name, ready to be called."""
    if name.startswith("_"):
        raise AttributeError(name)
    module = importlib.import_module(f".commands.{name}", __package__)
    return functools.partial(command.run, module.main)
