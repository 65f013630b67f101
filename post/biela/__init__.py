"""biela in Python: `run` makes results, `read` reads those there; the programs of post/ as functions (post/EXAMPLES.md)."""

import importlib

_NAMES = {
    "histories": "History read read_summary",
    "result_files": "BielaError HistoryError",
    "session": "Result SolverError fit identify modes optimise report ring_down run sensitivity spectrum sweep tradeoff",
}
_MODULES = {name: module for module, names in _NAMES.items() for name in names.split()}
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
