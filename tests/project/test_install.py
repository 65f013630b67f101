"""`make install` and `pip install .`: what they put where, and that it works from there."""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys

import biela as package_of_project
import pytest
from conftest import ROOT

try:
    import tomllib
except ImportError:
    import tomli as tomllib

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
OWN = {"biela", "start", "tomllib"}
DISTRIBUTION = {"imageio_ffmpeg": "imageio-ffmpeg", "PIL": "matplotlib"}  # Pillow comes with matplotlib


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    """Return the folder with the package `biela` as pip builds it."""
    pytest.importorskip("setuptools")
    folder = tmp_path_factory.mktemp("package")
    text = "from setuptools import setup; setup()"
    command = [sys.executable, "-c", text, "-q", "egg_info", "-e", folder, "build_py", "--build-lib", folder]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    return folder


def python(folder, text, *words, path=""):
    environment = {**os.environ, "PYTHONPATH": str(folder), "PATH": f"{path}:{os.environ['PATH']}"}
    done = subprocess.run(
        [sys.executable, "-c", text, *words], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_every_module_of_the_package_can_be_imported(package):
    names = [".".join(path.relative_to(package).with_suffix("").parts) for path in package.glob("biela/**/*.py")]
    assert {"biela.histories", "biela.programs", "biela.report_page"} <= set(names)
    text = "import importlib, sys, biela\nfor name in sys.argv[1:]: importlib.import_module(name)\n"
    text += "from biela.histories import HistoryError\nassert HistoryError is biela.HistoryError\n"
    python(package, text, *names)


def test_commands_show_the_help_of_their_tools(package):
    tools = [target.partition(":")[2] for target in PROJECT["scripts"].values()]
    assert [f"biela-{tool.replace('_', '-')}" for tool in tools] == list(PROJECT["scripts"])
    text = """import sys
from biela import programs
for name in sys.argv[1:]:
    sys.argv[1:] = ['--help']
    try:
        getattr(programs, name)()
    except SystemExit as end:
        assert end.code == 0"""
    assert python(package, text, *tools).count("usage:") == len(tools)


def test_the_installed_solver_is_found(package, biela, tmp_path):
    (tmp_path / "biela").symlink_to(biela)
    found = python(package, "from biela import command; print(command.SOLVER)", path=tmp_path)
    assert found.strip() == str(tmp_path / "biela")


@pytest.mark.skipif(sys.version_info < (3, 10), reason="no list of the standard library")
def test_every_library_in_use_is_a_dependency():
    named = {re.split(r"[>=<;\s]", line)[0] for line in PROJECT["dependencies"]}
    named |= {re.split(r"[>=<;\s]", line)[0] for extra in PROJECT["optional-dependencies"].values() for line in extra}
    for path in (ROOT / "post").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            modules = [node.module] if isinstance(node, ast.ImportFrom) and not node.level else []
            modules += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            for top in {module.partition(".")[0] for module in modules} - set(sys.stdlib_module_names) - OWN:
                assert DISTRIBUTION.get(top, top) in named, f"{path.name}: {top}"


@pytest.mark.usefixtures("biela")
def test_make_install_and_uninstall(tmp_path):
    def make(*words):
        subprocess.run(["make", *words, "PREFIX=/opt/b", f"DESTDIR={tmp_path}"], cwd=ROOT, check=True, capture_output=True)

    make("-o", "bin/biela", "install")
    found = {str(path.relative_to(tmp_path / "opt/b")) for path in tmp_path.rglob("*") if path.is_file()}
    shared = {"man/man1/biela.1", "bash-completion/completions/biela", "zsh/site-functions/_biela"}
    assert found == {"bin/biela", *(f"share/{name}" for name in shared)}
    assert os.access(tmp_path / "opt/b/bin/biela", os.X_OK)
    told = subprocess.run([tmp_path / "opt/b/bin/biela", "--version"], capture_output=True, text=True, check=True).stdout
    number = package_of_project.__version__
    assert told == f"biela {PROJECT['version']}\n"
    assert number == PROJECT["version"]
    assert f'"biela {number}"' in (tmp_path / "opt/b/share/man/man1/biela.1").read_text()
    (tmp_path / "opt/b/bin/other").touch()
    make("uninstall")
    assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == ["other"]


@pytest.mark.parametrize("name", ["biela.1", "biela.bash", "_biela"])
def test_manual_and_completions_know_every_option(name, biela):
    told = subprocess.run([biela, "--help"], capture_output=True, text=True, check=True).stdout
    text = (ROOT / "share" / name).read_text().replace("\\-", "-")
    for option in set(re.findall(r"--[a-z]+", told)):
        assert option in text, option
