"""Builds the package `biela` from post/: there scripts import each other by plain names, in the package by `biela.NAME`."""

import re
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

NAMES = "|".join(path.stem for path in Path(__file__).parent.glob("post/*.py") if path.stem != "__init__")


class Build(build_py):
    """Copies the modules with their imports of each other made absolute."""

    def build_module(self, module, module_file, package):
        """Copy one module."""
        target, copied = super().build_module(module, module_file, package)
        text = Path(target).read_text(encoding="utf-8")
        text = re.sub(rf"(?m)^(\s*)from ({NAMES}) import ", r"\1from biela.\2 import ", text)
        text = re.sub(rf"(?m)^(\s*)import ({NAMES})( as \w+)?$", r"\1from biela import \2\3", text)
        Path(target).write_text(text, encoding="utf-8")
        return target, copied


setup(cmdclass={"build_py": Build})
