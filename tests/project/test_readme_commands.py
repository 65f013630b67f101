"""The commands that README.md and post/README.md show are run as they are written, in order, in a folder like a fresh clone."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys

import pytest
from biela.programs import PROGRAMS
from conftest import ROOT

PAGES = ("README.md", "post/README.md")
COMMAND = re.compile(r"^    ((?:post/\w+\.py|bin/biela|sed) .*?)(?:\s+#\s.*)?$", re.MULTILINE)
EXAMPLE = re.compile(r"\b[A-Z]{3,}\b|\.\.\.")  # DECK, STUDY.toml: words that stand for something
SHORTER = {"animate": ["--frames", "3"], "tradeoff": ["--time", "1", "--quiet"]}  # the same work on less, for the test's time
STATUS = {"compare": {1}, "tradeoff": {0, 1}}


def commands(page: str) -> list[str]:
    """Return the commands of a page that name files of this project."""
    return [found for found in COMMAND.findall((ROOT / page).read_text(encoding="utf-8")) if not EXAMPLE.search(found)]


@pytest.fixture
def clone(biela, tmp_path, monkeypatch):
    """Return a folder with what the commands use, as a clone has it once it is built; the working folder."""
    shutil.copytree(ROOT / "input", tmp_path / "input")
    catalogue = tmp_path / "input" / "studies" / "tubes.csv"  # a search row by row: three of its rows, for the test's time
    catalogue.write_text("".join(catalogue.read_text().splitlines(keepends=True)[i] for i in (0, 3, 6, 9)))
    rods = tmp_path / "input" / "studies" / "rod_tolerances.toml"
    rods.write_text(rods.read_text().replace("samples = 200", "samples = 20"))
    (tmp_path / "post").symlink_to(ROOT / "post")
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin" / "biela").symlink_to(biela)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(line: str) -> None:
    """Run a command: a program of post/ in this process, which has loaded the libraries, any other by the shell."""
    words = shlex.split(line)
    if not words[0].startswith("post/"):
        assert subprocess.run(line, shell=True, capture_output=True, check=False).returncode == 0, line
        return
    tool = words[0][len("post/") : -len(".py")]
    try:
        status = PROGRAMS[tool].main([*words[1:], *SHORTER.get(tool, [])])
    except SystemExit as end:  # what the command line's parser refuses
        status = end.code
    assert status in STATUS.get(tool, {0}), line


def test_commands_work_as_they_are_written(clone, capsys):
    lines = [commands(page) for page in PAGES]
    assert min(map(len, lines)) > 7
    for line in dict.fromkeys(line for page in lines for line in page):
        run(line)
        told = capsys.readouterr()
        assert "Traceback" not in told.err
        for path in re.findall(r"(?<=wrote )\S+\.\w+|(?<=and )results/\S+\.\w+", told.out):
            assert (clone / path.rstrip(",")).stat().st_size > 0, line


def test_the_examples_in_python_run_as_they_stand(clone, capsys, monkeypatch):
    monkeypatch.setenv("BIELA", str(clone / "bin" / "biela"))
    lines = (ROOT / "post" / "EXAMPLES.md").read_text(encoding="utf-8").splitlines()
    exec("\n".join(line[4:] for line in lines if line.startswith("    ")), {})
    told = capsys.readouterr()
    assert told.err == ""
    assert "N m more for the motor" in told.out
    assert "polymer" in (clone / "page.html").read_text(encoding="utf-8")


def typed(page: str) -> list[str]:
    """Return what a page has typed: its indented lines, a file that `cat` writes as one command."""
    lines = [line[4:] for line in (ROOT / page).read_text(encoding="utf-8").splitlines() if line.startswith("    ") or not line]
    found: list[str] = []
    for line in lines:
        if found and "<<'END'" in found[-1] and not found[-1].endswith("\nEND"):
            found[-1] += f"\n{line}"
        elif line:
            found.append(line)
    return found


def test_the_tutorial_goes_from_an_empty_file_to_a_report(clone):
    lines = typed("input/TUTORIAL.md")
    assert lines[:2] == ["make", "make setup"]  # test_setup.py has these
    for line in lines[2:]:
        run(line)
    page = (clone / "results" / "pump" / "report.html").read_text(encoding="utf-8")
    assert "pump with a plastic rod" in page
    assert "rod without damping" in page
    summary = json.loads((clone / "results" / "pump" / "summary.json").read_text(encoding="utf-8"))
    bound = f"{summary['stable_steps']['rk4']['safe_bound']:.2E} s here"
    assert bound in (ROOT / "input" / "TUTORIAL.md").read_text(encoding="utf-8")


def test_programs_run_from_any_folder_by_the_projects_own_python(tmp_path):
    for tool in PROGRAMS:
        script = ROOT / "post" / f"{tool}.py"
        assert os.access(script, os.X_OK), tool
        assert str(script.readlink()) == "start.py"
    done = subprocess.run([ROOT / "post" / "compare.py", "a", "b"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith("compare: a")


def test_a_python_without_the_packages_is_told_how_to_get_them(tmp_path):
    shutil.copytree(ROOT / "post", tmp_path / "post")  # beside it there is no .venv
    words = [sys.executable, "-S", "-s", tmp_path / "post" / "plot.py", "run"]
    done = subprocess.run(words, env={"PATH": os.environ["PATH"]}, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert re.fullmatch(r"plot: the Python package '(\w+)' is missing: `make setup` installs it, or pip install \1\n", done.stderr)
