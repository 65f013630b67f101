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
    if name == "__version__":
        return _version()
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_MODULES[name]}", __name__), name)


def _version() -> str:
    """Return the number of this version: of the installed package, or of the project's pyproject.toml."""
    import importlib.metadata
    from pathlib import Path

    project = Path(__file__).resolve().parents[2] / "pyproject.toml"
    if not project.is_file():
        return importlib.metadata.version("biela")
    return next(line.split('"')[1] for line in project.read_text(encoding="utf-8").splitlines() if line.startswith("version = "))
