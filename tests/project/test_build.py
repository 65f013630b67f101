"""What make compiles again after a change: the file itself, and what uses it only where the module's interface has changed."""

from __future__ import annotations

import os
import re
import shutil
import subprocess

import pytest
from conftest import ROOT

MODULE = """!> A constant and a function.
module ground
  implicit none (type, external)
  private
  public :: twice
  integer, parameter, public :: width = 3   !! [-]
contains
  !> Twice a number.
  pure integer function twice(n)
    integer, intent(in) :: n   !! [-]
    twice = 2*n
  end function twice
end module ground
"""
USER = """!> Uses the ground.
module floor
  use ground, only: twice, width
  implicit none (type, external)
  private
  public :: area
contains
  !> Twice the width.
  pure integer function area()
    area = twice(width)
  end function area
end module floor
"""
MAIN = """!> Prints a number.
program main
  use floor, only: area
  implicit none (type, external)
  print '(i0)', area()
end program main
"""


@pytest.fixture
def tree(tmp_path):
    """A project of three files under the Makefile of this one."""
    shutil.copy(ROOT / "Makefile", tmp_path)
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    (tmp_path / "src" / "base").mkdir(parents=True)
    (tmp_path / "src" / "base" / "ground.f90").write_text(MODULE)
    (tmp_path / "src" / "floor.f90").write_text(USER)
    (tmp_path / "src" / "main.f90").write_text(MAIN)
    (tmp_path / "setup.sh").write_text("#!/bin/sh\n")
    (tmp_path / "setup.sh").chmod(0o755)
    return tmp_path


def make(tree, *arguments):
    """Run make; return what it says."""
    clean = {name: value for name, value in os.environ.items() if not name.startswith("MAKE") and name != "MFLAGS"}
    done = subprocess.run(["make", "LDLIBS=", *arguments], cwd=tree, env=clean, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_only_a_changed_interface_reaches_what_uses_a_module(tree):
    def compiled():
        return set(re.findall(r"-c (\S+)", make(tree)))

    ground = tree / "src" / "base" / "ground.f90"
    every = {"src/base/ground.f90", "src/floor.f90", "src/main.f90"}
    (tree / "awk").write_text("#!/bin/sh\necho half\nkill -9 0\n")  # make ends while it writes the order of compilation
    (tree / "awk").chmod(0o755)
    killed = {**os.environ, "PATH": f"{tree}:{os.environ['PATH']}"}
    assert subprocess.run(["make"], cwd=tree, env=killed, capture_output=True, start_new_session=True, check=False).returncode == -9
    assert compiled() == {*every, "build/release/output/program_version.f90"}
    assert compiled() == set()
    ground.write_text("! a comment\n" + MODULE)
    assert compiled() == {"src/base/ground.f90"}
    assert compiled() == set()
    ground.write_text(MODULE.replace("2*n", "3*n"))
    assert compiled() == {"src/base/ground.f90"}
    assert subprocess.run(tree / "bin" / "biela", capture_output=True, text=True, check=True).stdout == "9\n"
    ground.write_text(MODULE.replace("width = 3", "width = 5"))
    assert compiled() == {"src/base/ground.f90", "src/floor.f90"}
    assert subprocess.run(tree / "bin" / "biela", capture_output=True, text=True, check=True).stdout == "10\n"


@pytest.mark.parametrize(("given", "used"), [((), 5), (("-j1",), 1), (("-j", "7"), 7)])
def test_all_cores_unless_the_user_says_how_many(tree, given, used, tmp_path, monkeypatch):
    """An own nproc tells of five cores."""
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin" / "nproc").write_text("#!/bin/sh\necho 5\n")
    (tmp_path / "bin" / "nproc").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}/bin:{os.environ['PATH']}")
    text = (tree / "Makefile").read_text(encoding="utf-8")
    (tree / "Makefile").write_text(text + "jobs: ; @echo jobs $(MAKEFLAGS)\n", encoding="utf-8")
    assert re.search(r"^jobs.* -j(\d+)", make(tree, *given, "jobs"), re.MULTILINE)[1] == str(used)
