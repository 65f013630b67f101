"""Every program of post/ has a help with an example, from any folder, and a place in post/README.md with its pictures."""

from __future__ import annotations

import os
import re
import subprocess
import sys

import pytest
from biela.programs import PROGRAMS
from conftest import ROOT

POST = ROOT / "post"
TOOLS = sorted(PROGRAMS)
README = (POST / "README.md").read_text(encoding="utf-8")


def help_of(name, capsys):
    """Return what a program prints for --help."""
    with pytest.raises(SystemExit) as end:
        PROGRAMS[name].main(["--help"])
    assert end.value.code == 0
    return capsys.readouterr().out


@pytest.mark.parametrize("name", TOOLS)
def test_help_has_an_example(name, capsys):
    words = help_of(name, capsys)
    assert re.search(rf"(post/)?{name}\.py( |$)", words.partition("\n\n")[2], re.MULTILINE), words


@pytest.mark.parametrize("name", TOOLS)
def test_readme_describes_it(name):
    assert re.search(rf"^## .*\b{name}\.py", README, re.MULTILINE)


def test_options_that_readme_names_exist(capsys):
    for name, rest in re.findall(r"post/(\w+)\.py (.*)", README):
        words = help_of(name, capsys)
        for option in re.findall(r"--[a-z]+", rest):
            assert option in words, f"{name} {option}"


def test_pictures_are_there():
    for path in re.findall(r"\]\((pictures/[^)]+)\)", README):
        assert (POST / path).is_file(), path


def test_a_help_loads_no_large_library():
    words = "import sys\nfrom biela import programs\n"
    words += "print(*{'numpy', 'scipy', 'matplotlib', 'jinja2'} & set(sys.modules))"
    environment = {**os.environ, "PYTHONPATH": str(POST)}
    done = subprocess.run([sys.executable, "-c", words], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""
