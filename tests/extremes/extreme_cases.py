"""A case at an extreme: a deck, what must happen, stated beforehand, and whether it did."""

from __future__ import annotations

import os
import re
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from biela.histories import History, HistoryError, read

TIMEOUT = 60.0
ROOT = Path(__file__).resolve().parents[2]
BIELA = (ROOT / os.environ.get("BIELA", "bin/biela")).resolve()
CRASH = re.compile(r"backtrace|segmentation|sigfpe|runtime error|floating-point exception", re.IGNORECASE)


@dataclass(frozen=True)
class Ran:
    """What one call of the solver left.

    Attributes:
        status: exit status, -1 after the time limit
        told: standard error and output
        summary: text of summary.txt, '' without
        history: sensors, None where nothing readable was written
        energy: energies, as history
    """

    status: int
    told: str
    summary: str
    history: History | None
    energy: History | None

    @property
    def residual(self) -> float:
        """Largest energy residual over the largest energy."""
        energy = self.energy
        largest = max(float(np.abs(energy[name]).max()) for name in ("kinetic", "potential", "dissipated", "work"))
        return float(np.abs(energy["residual"]).max()) / max(largest, 1e-300)


@dataclass(frozen=True)
class Case:
    """A deck at an extreme.

    Attributes:
        factor: what is extreme, e.g. 'Young modulus'
        value: how much
        deck: its text
        expected: what must happen, in words
        status: exit status that is stated
        message: pattern that the messages or the summary must have, '' for none
        measure: figure of a run that ended well, compared with `limit`; None: none
        limit: what the figure may be
        method: of integration
    """

    factor: str
    value: str
    deck: str
    expected: str
    status: int = 0
    message: str = ""
    measure: Callable[[Ran], float] | None = None
    limit: float = 0.0
    method: str = "rk4"


@dataclass(frozen=True)
class Row:
    """What a case did: a figure where one was stated, a sentence, and whether all is as stated."""

    case: Case
    figure: float
    outcome: str
    passed: bool


def call(deck: str, *options: str) -> Ran:
    """Run the solver on a deck's text in a folder of its own."""
    with tempfile.TemporaryDirectory(prefix="extremes") as name:
        folder = Path(name)
        (folder / "deck.nml").write_text(deck, encoding="utf-8")
        command = [str(BIELA), "--quiet", *options, *([] if "--check" in options else ["--output", "out"]), "deck.nml"]
        try:
            done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=TIMEOUT, check=False)
        except subprocess.TimeoutExpired:
            return Ran(-1, f"still running after {TIMEOUT:g} s", "", None, None)
        summary = folder / "out" / "summary.txt"
        text = summary.read_text(encoding="utf-8") if summary.exists() else ""
        return Ran(done.returncode, done.stderr + done.stdout, text, *(_read(folder / "out", k) for k in ("history", "energy")))


def _read(folder: Path, kind: str) -> History | None:
    """Return a results file, None where it is missing or holds something that is no finite number."""
    try:
        return read(folder, kind)
    except HistoryError:
        return None


def judge(case: Case) -> Row:
    """Run a case and hold it to what was stated."""
    ran = call(case.deck)
    lines = [line for line in ran.told.splitlines() if "warning" not in line] or [""]
    if CRASH.search(ran.told):
        return Row(case, float("nan"), f"crashed: {lines[0]}", False)
    if ran.status != case.status:
        return Row(case, float("nan"), f"status {ran.status}: {lines[0][:150]}", False)
    if ran.status in (0, 1) and (ran.history is None or ran.energy is None):
        return Row(case, float("nan"), "the rows are missing or not finite", False)
    if case.message and not re.search(case.message, ran.told + ran.summary):
        return Row(case, float("nan"), f"says nothing of {case.message!r}: {lines[0][:120]}", False)
    if case.measure is None:
        said = re.search(case.message, ran.told + ran.summary) if case.message else None
        return Row(case, float("nan"), f"as stated{': ' + said[0][:100] if said else ''}", True)
    figure = case.measure(ran)
    return Row(case, figure, f"{figure:.1e}", figure <= case.limit)


def safe_bound(deck: str, method: str = "rk4") -> float:
    """Return the advised largest step of an explicit method [s], infinite where nothing limits it."""
    return bounds(deck, method)[0]


def bounds(deck: str, method: str = "rk4") -> tuple[float, float]:
    """Return the safe and the current bound on the step of an explicit method [s], infinite where nothing limits it."""
    told = call(deck, "--check").told
    found = re.search(rf"^  {method}: safe bound +(\S+) s .*current bound +(\S+) s", told, re.MULTILINE)
    return (float(found[1]), float(found[2])) if found else (float("inf"), float("inf"))
