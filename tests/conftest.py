"""Fixtures of all tests: the solver, a runner of decks, and the folders of the project.

The environment variables BIELA and PROBE name the programs under test (bin/biela and bin/probe): `make test` and
`make test-debug` set them. A helper that a test module needs besides the fixtures is imported: `from conftest import Run`.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Callable

import pytest
from biela.histories import History, read, read_summary

ROOT = Path(__file__).resolve().parent.parent
REFERENCE = ROOT / "tests" / "reference"
TIMEOUT = 1800.0  # of a run that hangs [s]; the checked build takes long on a busy machine


@dataclass(frozen=True)
class Run:
    """What one call of the solver left behind.

    Attributes:
        folder: the results folder that the deck's name (or --output) gives; it need not exist
        status: exit status
        stdout: what was printed
        stderr: warnings and errors
    """

    folder: Path
    status: int
    stdout: str
    stderr: str

    @property
    def history(self) -> History:
        """The sensors."""
        return read(self.folder, "history")

    @property
    def energy(self) -> History:
        """Energies, their residual, and the violations."""
        return read(self.folder, "energy")

    @property
    def motion(self) -> History:
        """Body frames and nodes."""
        return read(self.folder, "motion")

    @property
    def figures(self) -> dict:
        """The figures of summary.json."""
        return read_summary(self.folder)

    @property
    def transient(self) -> dict:
        """Those of the transient."""
        return self.figures["transient"]

    @property
    def summary(self) -> str:
        """The text of summary.txt."""
        return (self.folder / "summary.txt").read_text(encoding="utf-8")


def untimed(text: bytes) -> bytes:
    """Return a result without what two equal runs may differ in: the line of seconds, machine and date of the summaries."""
    return b"\n".join(line for line in text.splitlines() if not line.strip().startswith((b"timing:", b'"timing":')))


def wait_for(file: Path, process: subprocess.Popen) -> None:
    """Wait until a run has made a file; a run that ends without it is a failure, not a reason to wait for ever."""
    while not file.exists():
        assert process.poll() is None or file.exists(), f"ended with status {process.returncode} without {file.name}"
        time.sleep(0.001)


def caught(start: Callable):
    """Call start() until it returns something: on a busy machine a run may end before the signal that should stop it."""
    for _ in range(50):
        found = start()
        if found is not None:
            return found
    pytest.fail("every run was faster than its signal")


def preloaded(name: str, folder: Path, *options: str) -> Path:
    """Return a library built from tests/preload; skip where there is no gfortran, or nothing is preloaded."""
    compiler = os.environ.get("FC", "gfortran")
    if not shutil.which(compiler) or not sys.platform.startswith("linux"):
        pytest.skip("needs gfortran and Linux")
    library = folder / f"{name}.so"
    (source,) = (ROOT / "tests" / "preload").glob(f"{name}.*")
    command = [compiler, "-O1", "-fPIC", "-shared", f"-J{folder}", str(source), *options, "-o", str(library)]
    subprocess.run(command, check=True, capture_output=True)
    return library


def program(variable: str, default: str) -> Path:
    """Return the path of a program under test; the test run ends where it has not been built."""
    path = (ROOT / os.environ.get(variable, default)).resolve()
    if not os.access(path, os.X_OK):
        pytest.exit(f"{path} is missing: `make test` builds it", returncode=3)
    return path


@pytest.fixture(scope="session")
def biela() -> Path:
    """Return the path of the solver."""
    return program("BIELA", "bin/biela")


@pytest.fixture(scope="session")
def probe() -> Path:
    """Return the path of the program that shows the solver's inside."""
    return program("PROBE", "bin/probe")


def runner(biela: Path, folder: Path) -> Callable[..., Run]:
    """Return a function that runs the solver on a deck, in a folder.

    run(deck, *options, expect=0, name='scene', environment=None) takes a deck's path or its text (which is written to
    NAME.nml), asserts the exit status (expect=None: any), and returns a `Run`.
    """

    def run(deck: Path | str, *options: str, expect: int | None = 0, name: str = "scene", environment: dict | None = None) -> Run:
        path = deck
        if isinstance(deck, str):
            path = folder / f"{name}.nml"
            path.write_text(deck, encoding="utf-8")
        done = subprocess.run(
            [str(biela), *options, str(path)],
            cwd=folder,
            env={**os.environ, **(environment or {})},
            capture_output=True,
            text=True,
            timeout=TIMEOUT,
            check=False,
        )
        if expect is not None:
            told = f"{path} ended with status {done.returncode}, not {expect}\n{done.stdout}{done.stderr}"
            assert done.returncode == expect, told
        results = folder / "results" / path.stem
        if "--output" in options:
            results = folder / options[options.index("--output") + 1]
        return Run(results, done.returncode, done.stdout, done.stderr)

    return run


@pytest.fixture
def run_deck(biela: Path, tmp_path: Path) -> Callable[..., Run]:
    """Return a function that runs the solver on a deck (`runner`), in a folder of the test's own."""
    return runner(biela, tmp_path)


@pytest.fixture(scope="module")
def run_deck_once(biela: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Run]:
    """Return the same for runs at which several tests of a module look: a fixture of the module keeps what it returns."""
    return runner(biela, tmp_path_factory.mktemp("once"))


@pytest.fixture(scope="session")
def counters(tmp_path_factory):
    """Return the path of the counting library; skips where it cannot be built or preloaded (another C library)."""
    library = preloaded("counters", tmp_path_factory.mktemp("counters"), "-Wl,-fini=report_counts")
    done = subprocess.run(["true"], env={**os.environ, "LD_PRELOAD": str(library)}, capture_output=True, text=True, check=False)
    if "allocations" not in done.stderr:
        pytest.skip("the C library does not let its allocations be counted")
    return library


@pytest.fixture(scope="session")
def largest(tmp_path_factory):
    """Return a function that gives the environment in which no array has more than some bytes."""
    library = preloaded("largest", tmp_path_factory.mktemp("largest"))
    return lambda size: {**os.environ, "LD_PRELOAD": str(library), "LARGEST": str(int(size))}


@pytest.fixture(autouse=True)
def texts_stand_apart(request, monkeypatch):
    """No two texts of a picture that a test of post/ saves lie on each other: the renderer says where they stand."""
    if request.path.parent.name != "post":
        return
    from biela.labels import overlaps
    from matplotlib.figure import Figure
    from matplotlib.text import Text

    draw, savefig, drawn = Text.draw, Figure.savefig, {}

    def note(text, renderer, *args, **kwargs):
        if text.get_visible() and text.get_text().strip():
            drawn[id(text)] = (text.get_text(), Text.get_window_extent(text, renderer).extents)
        return draw(text, renderer, *args, **kwargs)

    def save(figure, *args, **kwargs):
        drawn.clear()
        done = savefig(figure, *args, **kwargs)
        assert overlaps(list(drawn.values())) == [], args
        return done

    monkeypatch.setattr(Text, "draw", note)
    monkeypatch.setattr(Figure, "savefig", save)
