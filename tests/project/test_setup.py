"""setup.sh on machines that lack things: what it installs, with what, and what it says where it may not."""

from __future__ import annotations

import shutil
import subprocess

import pytest
from conftest import ROOT

NEEDED = ["sh", "dirname", "mktemp", "cat", "rm", "ln", "chmod", "mkdir", "pwd", "cc", "as", "ld", "collect2"]
DISTRIBUTIONS = {
    "apt-get": (
        "apt-get update; DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends "
        "-o DPkg::Lock::Timeout=300 gfortran libc6-dev liblapack-dev libblas-dev make"
    ),
    "dnf": "dnf install -y gcc-gfortran lapack-devel blas-devel make",
    "pacman": "pacman -Sy --needed --noconfirm gcc-fortran lapack blas make",
    "zypper": "zypper --non-interactive install gcc-fortran lapack-devel blas-devel make",
    "apk": "apk add gfortran musl-dev lapack-dev blas-dev make",
}


class Machine:
    """A folder of programs that stands for a whole machine: its PATH holds nothing else."""

    def __init__(self, folder):
        self.bin = folder / "bin"
        self.bin.mkdir()
        self.log = folder / "log"
        self.log.write_text("")
        self.project = folder / "project"
        self.project.mkdir()
        shutil.copy(ROOT / "setup.sh", self.project)
        for name in NEEDED:
            if shutil.which(name):
                (self.bin / name).symlink_to(shutil.which(name))

    def script(self, name, text):
        """Add a program made of a few lines of shell."""
        path = self.bin / name
        path.write_text(f"#!/bin/sh\n{text}\n")
        path.chmod(0o755)

    def user(self, number):
        """Say who runs the script: 0 is root."""
        self.script("id", f"echo {number}")

    def manager(self, name, effect=":"):
        """Add a package manager that notes how it was called; effect is what an installation does."""
        self.script(name, f'echo "{name} $*" >> {self.log}\ncase "$*" in *install*|add*|-S*) {effect} ;; esac')

    def make(self, *words):
        """Run make in a project of one source file; return what `setup` does."""
        for name in ("make", "find", "nproc", "sed", "awk", "touch", "mv", "ar", "install"):
            if not (self.bin / name).exists():
                (self.bin / name).symlink_to(shutil.which(name))
        for name in ("Makefile", "share", "pyproject.toml"):
            (self.project / name).unlink(missing_ok=True)
            (self.project / name).symlink_to(ROOT / name)
        (self.project / "requirements.txt").write_text("")
        (self.project / "src").mkdir(exist_ok=True)
        (self.project / "src" / "main.f90").write_text("program main\nimplicit none (type, external)\nend program main\n")
        return self.run("make", *words)

    def setup(self, *words, **environment):
        """Run setup.sh and return status, output, and what the package manager was asked."""
        return self.run("sh", "setup.sh", *words, **environment)

    def run(self, program, *words, **environment):
        """Run a program of the machine in the project."""
        done = subprocess.run(
            [str(self.bin / program), *words],
            cwd=self.project,
            env={"PATH": str(self.bin), "TMPDIR": str(self.project), **environment},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=60.0,
            check=False,
        )
        return done.returncode, done.stdout + done.stderr, self.log.read_text().splitlines()


@pytest.fixture
def machine(tmp_path):
    made = Machine(tmp_path)
    made.user(1000)
    return made


def compiler(machine):
    """Return the shell line that makes the real gfortran appear on the machine."""
    return f"ln -s {shutil.which('gfortran')} {machine.bin}/gfortran"


def test_what_is_there_is_left_alone(machine):
    subprocess.run(compiler(machine), shell=True, check=True)
    machine.manager("apt-get")
    assert machine.setup("toolchain") == (0, "", [])


@pytest.mark.parametrize("manager", DISTRIBUTIONS)
def test_root_installs_with_the_distributions_own_manager(machine, manager):
    machine.user(0)
    machine.manager(manager, compiler(machine))
    status, told, asked = machine.setup("toolchain")
    assert status == 0, told
    assert f"setup: gfortran, LAPACK or BLAS is missing: installing it with: {DISTRIBUTIONS[manager]}" in told
    wanted = [part.strip().removeprefix("DEBIAN_FRONTEND=noninteractive ") for part in DISTRIBUTIONS[manager].split(";")]
    assert asked == wanted


def test_sudo_installs_where_it_may(machine):
    machine.manager("apt-get", compiler(machine))
    machine.script("sudo", '[ "$1" = -n ] && exit 0\nexec "$@"')
    status, told, asked = machine.setup("toolchain")
    assert status == 0, told
    assert "installing it with: sudo sh -c 'apt-get update;" in told
    assert asked[-1].startswith("apt-get install -y")


@pytest.mark.parametrize("manager", DISTRIBUTIONS)
def test_others_are_told_the_line_to_type(machine, manager):
    machine.script("python3", "exit 0")
    machine.manager(manager)
    machine.script("sudo", "exit 1")
    status, told, asked = machine.setup("toolchain")
    assert status != 0
    assert asked == []
    line = DISTRIBUTIONS[manager]
    assert told == f"setup: gfortran, LAPACK or BLAS is missing. As an administrator, please type: {line}\n"


PYTHONS = {"apt-get": "python3 python3-venv", "dnf": "python3", "pacman": "python", "zypper": "python3", "apk": "python3"}


@pytest.mark.parametrize("manager", DISTRIBUTIONS)
def test_where_python_lacks_too_one_line_installs_all(machine, manager):
    machine.manager(manager)
    status, told, asked = machine.setup("toolchain")
    assert (status != 0, asked) == (True, [])
    missing = "gfortran, LAPACK or BLAS is missing; so is Python 3.9 or newer with the module venv"
    line = f"{DISTRIBUTIONS[manager]} {PYTHONS[manager]}"
    assert told == f"setup: {missing}. As an administrator, please type: {line}\n"
    assert [path.name for path in machine.project.iterdir()] == ["setup.sh"]


@pytest.mark.parametrize("goal", ["all", "install"])
def test_make_alone_installs_nothing_and_says_what_to_type(machine, goal):
    """As root, who could install: only `make setup` and what needs Python besides does."""
    machine.user(0)
    machine.manager("apt-get", compiler(machine))
    status, told, asked = machine.make(goal)
    assert (status != 0, asked) == (True, [])
    missing = "setup: gfortran, LAPACK or BLAS is missing; biela is compiled with them. "
    assert f"{missing}Please type: make setup, which installs them by: {DISTRIBUTIONS['apt-get']}\n" in told
    machine.script("python3", 'case "$*" in "-m venv .venv") mkdir -p .venv/bin; ln -s "$0" .venv/bin/python ;; esac')
    status, told, asked = machine.make("setup")
    assert status == 0, told
    assert asked[-1].startswith("apt-get install -y")
    status, told, _ = machine.make(goal, "LDLIBS=", "FFLAGS=-O0", f"PREFIX={machine.project}/usr")
    assert status == 0, told


def test_temporary_files_find_a_place(machine):
    """Also where the folder of temporary files cannot be written."""
    subprocess.run(compiler(machine), shell=True, check=True)
    assert machine.setup("toolchain", TMPDIR=str(machine.project / "nowhere")) == (0, "", [])
    assert [path.name for path in machine.project.iterdir()] == ["setup.sh"]


def test_missing_libraries_are_found_out(machine):
    machine.script("python3", "exit 0")
    subprocess.run(compiler(machine), shell=True, check=True)
    machine.manager("apt-get")
    status, told, _ = machine.setup("toolchain", LDLIBS="-lno_such_library")
    assert status != 0
    assert "gfortran, LAPACK or BLAS is missing. As an administrator, please type: apt-get update;" in told


def test_an_installation_that_does_not_help_is_a_failure(machine):
    machine.user(0)
    machine.manager("apt-get")
    status, told, _ = machine.setup("toolchain")
    assert status != 0
    assert told.splitlines()[-1] == "setup: gfortran does not compile and link a program with -llapack -lblas"


def test_another_compiler_is_the_users_to_install(machine):
    machine.user(0)
    machine.manager("apt-get")
    status, told, asked = machine.setup("toolchain", FC="flang")
    assert (status != 0, asked) == (True, [])
    assert told == "setup: FC=flang does not compile and link a program with -llapack -lblas\n"


def test_no_package_manager(machine):
    status, told, _ = machine.setup("toolchain")
    assert status != 0
    assert "no package manager that this script knows was found" in told


def test_python_without_venv_is_installed_then_used(machine):
    machine.user(0)
    working = 'case "$*" in *ensurepip*) exit 0 ;; "-m venv .venv") mkdir -p .venv/bin; ln -s "$0" .venv/bin/python ;; esac'
    machine.script("python3", "exit 1")
    (machine.bin / "python3.new").write_text(f'#!/bin/sh\necho "python3 $*" >> {machine.log}\n{working}\n')
    machine.manager("apt-get", f"cat {machine.bin}/python3.new > {machine.bin}/python3")
    status, told, asked = machine.setup("python")
    assert status == 0, told
    assert "Python 3.9 or newer with the module venv is missing: installing it with: apt-get update;" in told
    assert asked[1] == "apt-get install -y --no-install-recommends -o DPkg::Lock::Timeout=300 python3 python3-venv"
    assert any(line.endswith("--requirement requirements.txt") and " -m pip install " in line for line in asked)


@pytest.mark.parametrize("broken", ["link", "folder"])
def test_a_broken_environment_is_made_anew(machine, broken):
    environment = machine.project / ".venv"
    if broken == "link":
        environment.symlink_to("nowhere")
    else:
        (environment / "bin").mkdir(parents=True)
    making = '"-m venv .venv") [ -e .venv -o -L .venv ] && exit 1; mkdir -p .venv/bin; ln -s "$0" .venv/bin/python ;;'
    machine.script("python3", f'case "$*" in {making} esac')
    status, told, _ = machine.setup("python")
    assert (status, told) == (0, "setup: Python packages into .venv (once)\n")


@pytest.mark.parametrize("words", [[], ["everything"]])
def test_usage(machine, words):
    status, told, _ = machine.setup(*words)
    assert (status != 0, told) == (True, "setup: usage: ./setup.sh check|toolchain|python\n")
