#!/usr/bin/env python3
"""Injected faults: system calls that fail, limits, signals at any moment of every method and analysis, damaged checkpoints.

`make faults` calls it; results/faults/report.txt has a line a family. A fault must end a run as the README says: a status, a
message, whole rows, no lock; and a run that goes on or begins again leaves the files of an undisturbed one, to the last bit.
FAULTS= multiplies how many are tried, FAULTS_SEED= draws others.
"""

from __future__ import annotations

import errno
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
REPORT = ROOT / "results" / "faults" / "report.txt"
SCENE = """&scene gravity=0.0,-9.81 /
&material name='m' density=1500.0 young=3.0e9 ghm_alpha=0.5 ghm_zeta=1.2 ghm_omega=900.0 prony_alpha=0.2 prony_tau=1e-3 /
&section name='s' shape='rectangle' width=0.02 height=0.02 /
&body name='crank' kind='rigid' mass=0.2 inertia=1e-3 com=0.05,0.0 angle=1.2 /
&body name='a' kind='beam' length=0.5 elements=3 material='m' section='s' position=0.036,0.093 angle=0.2 /
&body name='b' kind='beam' length=0.4 elements=3 material='m' section='s' position=0.6,0.0 angle=1.9 modes=3 /
&joint name='o' type='revolute' body_a='crank' /
&joint name='p' type='revolute' body_a='a' node_a=1 body_b='crank' point_b=0.1,0.0 /
&joint name='q' type='revolute' body_a='a' node_a=-1 body_b='b' node_b=-1 /
&joint name='r' type='revolute' body_a='b' node_a=1 point_b=0.6,0.0 /
&spring name='k' type='torsional' body_a='crank' stiffness=50.0 ghm_alpha=1.0 ghm_zeta=1.0 ghm_omega=50.0 /
&force name='f' type='force' body='b' node=2 fx=20.0 stage='transient' /
&stop name='t' type='rotation' body_a='crank' lower=1.2405 upper=1.242 stiffness=1e4 restitution=0.7 /
&sensor name='tip' quantity='acceleration' body='b' node=-1 /
&sensor name='pin' quantity='reaction' joint='q' /
&sensor name='t' quantity='stop' stop='t' /
"""
TRANSIENT = "&transient t_end=0.02 output_step=2e-4 motion_step=1e-3 checkpoint_interval=2e-3 {} /\n"
METHODS = {
    "rk4": "method='rk4' step=4e-6",
    "dopri5, fixed steps": "method='dopri5' step=8e-6",
    "dopri5, tolerance": "method='dopri5' tolerance=1e-7",
    "generalized_alpha, fixed steps": "method='generalized_alpha' step=2e-5",
    "radau, fixed steps": "method='radau' step=2e-4",
    "radau, tolerance": "method='radau' tolerance=1e-5",
    "two runs that estimate errors": "method='dopri5' tolerance=1e-6 check_error=.true.",
}
ANALYSES = {
    "static": "&static load_steps=300 /\n",
    "modal": "&modal modes=12 /\n",
    "frequency response": "&frequency_response from=1.0 to=500.0 points=800 input='f' /\n",
}
DECKS = {name: TRANSIENT.format(words) for name, words in METHODS.items()}
DECKS.update(ANALYSES)
DECKS["all analyses"] = "&static /\n&modal modes=5 /\n&frequency_response from=1.0 to=50.0 points=50 input='f' /\n" + DECKS["rk4"]
CALLS = {
    "write": [0, errno.EINTR, errno.ENOSPC, errno.EIO],
    "mkstemp": [errno.ENOSPC, errno.EACCES, errno.EMFILE],
    "mkdir": [errno.ENOSPC, errno.EACCES],
    "rename": [errno.EIO],
    "fsync": [errno.EIO],
    "close": [errno.EIO],
    "flock": [errno.EWOULDBLOCK, errno.ENOLCK],
    "lseek": [errno.EIO],
    "read": [errno.EIO, errno.EINTR],
    "unlink": [errno.EACCES],
    "ftruncate": [errno.EIO],
}


def preload(folder: Path) -> Path:
    """Compile the library that injects faults."""
    library = folder / "faults.so"
    source = Path(__file__).with_name("faults.c")
    subprocess.run(["gcc", "-shared", "-fPIC", "-O1", "-o", str(library), str(source), "-ldl", "-lrt"], check=True)
    return library


def untimed(text: bytes) -> bytes:
    """Return a result without the lines of times, in which equal runs differ."""
    return b"\n".join(line for line in text.splitlines() if not line.strip().startswith((b"timing:", b'"timing":')))


class Place:
    """A folder with a deck, the library, and what an undisturbed run leaves."""

    def __init__(self, biela: Path, folder: Path, groups: str):
        """Write the deck and run it."""
        self.biela, self.folder, self.results = biela, folder, folder / "results" / "scene"
        folder.mkdir()
        (folder / "scene.nml").write_text(SCENE + groups, encoding="utf-8")
        self.library = preload(folder)
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        status, told = self.run()
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        assert status == 0, told
        self.seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        self.whole = self.files()

    def run(self, *options: str, limits: str = "", **environment: str) -> tuple[int, str]:
        """Run the deck under a shell's limits and with faults; the status (negative: a signal's) and what was said."""
        if environment:
            environment["LD_PRELOAD"] = str(self.library)
        done = subprocess.run(
            ["sh", "-c", limits + ' exec "$@"', "sh", str(self.biela), "--quiet", *options, "scene.nml"],
            cwd=self.folder, env={**os.environ, **environment}, capture_output=True, timeout=600, check=False,
        )  # fmt: skip
        return done.returncode, done.stderr.decode(errors="replace")

    def files(self) -> dict[str, bytes]:
        """Return every result, without times."""
        found = self.results.iterdir() if self.results.exists() else []
        return {path.name: untimed(path.read_bytes()) for path in found if path.name not in (".lock", "checkpoint")}

    def clear(self) -> None:
        """Remove the results."""
        shutil.rmtree(self.folder / "results", ignore_errors=True)

    def after(self, status: int, told: str, lock: bool = False) -> str:
        """Return what is wrong with the state that a fault left, and with the run that goes on from it; '' where nothing is."""
        if "Backtrace" in told or "runtime error" in told:
            return f"status {status}: {told}"
        if status not in (0, -signal.SIGKILL) and not told.strip():
            return f"status {status} without a message"
        for path in self.results.glob("*.txt") if status != -signal.SIGKILL else []:
            if not path.read_bytes().endswith(b"\n") and path.stat().st_size > 0 and status > 128:
                return f"{path.name} ends within a line"
        if (self.results / ".lock").exists() and not lock:
            return "a lock is left"
        if status == 0 and self.files() != self.whole:
            return "status 0 and other results"
        if status != 0:
            again, words = self.run(*(["--restart"] if (self.results / "checkpoint").exists() else []))
            if again != 0:
                return f"the run that follows ends with status {again}: {words}"
            unlike = [name for name, text in self.whole.items() if self.files().get(name) != text]
            if unlike:
                return f"the run that follows leaves other {', '.join(unlike)}"
        return ""


def interruptions(place: Place, dice: random.Random, count: int) -> list[str]:
    """Send signals after random processor times until so many have ended a run; what is wrong of each."""
    found: list[str] = []
    for _ in range(10 * count):
        if len(found) == count:
            break
        place.clear()
        number = dice.choice([signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
        after = int(dice.uniform(0.0, 1.05) * place.seconds * 1e9) + 1000
        status, told = place.run(FAULT_SIGNAL=f"{int(number)}:{after}")
        if status == 0:
            continue
        fault = place.after(status, told or "ended at once", lock=number == signal.SIGKILL)
        if status not in (-number, 128 + number) or (
            status < 0 and number != signal.SIGKILL and place.results.exists() and not fault
        ):
            fault = fault or f"signal {number} ended the run with status {status}"
        found.append(fault and f"signal {int(number)} after {after} ns: {fault}")
    return found


def failing_calls(place: Place, dice: random.Random, count: int) -> list[str]:
    """Let the n-th call of each kind fail, in each way."""
    found = []
    for call, errors in CALLS.items():
        for error in errors:
            for n in sorted({1, 2, *(dice.randint(4, 150) for _ in range(count))}):
                place.clear()
                status, told = place.run(FAULT=f"{call}:{n}:{error}")
                fault = place.after(status, told, lock=call in ("unlink", "flock", "lseek", "ftruncate"))
                if status not in (0, 1, 2, 3):
                    fault = fault or f"status {status}: {told}"
                if call == "write" and error in (0, errno.EINTR) and status != 0:
                    fault = fault or "an interrupted write was not repeated"
                found.append(fault and f"{call} {n} with errno {error}: {fault}")
    return found


def limits(place: Place, dice: random.Random, count: int) -> list[str]:
    """Limit files, memory and descriptors."""
    found = []
    libraries = subprocess.run(["ldd", place.biela], capture_output=True, text=True, check=False).stdout
    waits = "openblas" in libraries  # it tries again for ever where it cannot have its 128 MB
    for words in [
        *(f"ulimit -f {dice.randint(1, 60)};" for _ in range(count)),
        *(f"ulimit -v {dice.randint(20000, 80000)};" for _ in range(0 if waits else count)),
        *(f"ulimit -n {n};" for n in (3, 4, 5, 6, 8)),
    ]:
        place.clear()
        status, told = place.run(limits=words)
        if status == 127 and "shared" in told:  # the system could not load the program
            continue
        fault = place.after(status, told, lock="-n" in words)
        found.append(fault and f"{words} status {status}: {fault}")
    return found


def damaged_checkpoints(place: Place, dice: random.Random, count: int) -> list[str]:
    """Damage a checkpoint; a restart must refuse it in one line, and change no file."""
    checkpoint = place.results / "checkpoint"
    for _ in range(50):
        place.clear()
        place.run(FAULT_SIGNAL=f"9:{int(dice.uniform(0.4, 0.8) * place.seconds * 1e9)}")
        if checkpoint.exists():
            break
    good, found = checkpoint.read_bytes(), []
    for _ in range(count):
        bad = bytearray(good)
        at, length = dice.randrange(len(good)), dice.choice([1, 8, 100])
        kind = dice.choice(["bit", "bit", "byte", "cut", "more", "zeros", "swap", "drop", "noise"])
        if kind == "bit":
            bad[at] ^= 1 << dice.randrange(8)
        elif kind == "byte":
            bad[at] = (bad[at] + dice.randint(1, 255)) % 256
        elif kind == "cut":
            del bad[at:]
        elif kind == "more":
            bad += dice.randbytes(length)
        elif kind == "zeros":
            bad[at : at + length] = bytes(len(bad[at : at + length]))
        elif kind == "swap":
            bad = bad[at:] + bad[:at]
        elif kind == "drop":
            del bad[at : at + length]
        else:
            bad[at : at + length] = dice.randbytes(len(bad[at : at + length]))
        if bytes(bad) == good:
            bad[at] ^= 1
        checkpoint.write_bytes(bad)
        before = place.files()
        status, told = place.run("--restart")
        lines = [line for line in told.splitlines() if "warning" not in line]
        good_end = status == 2 and len(lines) == 1 and checkpoint.read_bytes() == bytes(bad) and place.files() == before
        found.append("" if good_end else f"{kind} at {at}, {length} bytes: status {status}: {told}")
    return found


def main() -> int:
    """Inject all faults, write the report; exit status 1 where something is not as stated."""
    biela = Path(os.environ.get("BIELA", "bin/biela")).resolve()
    many, seed = float(os.environ.get("FAULTS", "1")), int(os.environ.get("FAULTS_SEED", "1"))
    folder, began = Path(tempfile.mkdtemp(prefix="faults")), time.monotonic()
    rows = [f"Injected faults; FAULTS={many:g}, FAULTS_SEED={seed}", ""]
    bad = 0
    try:
        for k, (name, groups) in enumerate(DECKS.items()):
            place, dice = Place(biela, folder / str(k), groups), random.Random(f"{seed}/{name}")
            families = {"interrupted": (interruptions, 25)}
            if name in ("rk4", "generalized_alpha, fixed steps", "radau, tolerance"):
                families["damaged checkpoints"] = (damaged_checkpoints, 400)
            if name in ("rk4", "all analyses"):
                families["failing system calls"] = (failing_calls, 3)
                families["limits"] = (limits, 12)
            for family, (inject, count) in families.items():
                found = inject(place, dice, max(1, round(count * many)))
                wrong = [fault for fault in found if fault]
                rows += [f"{family:22} {name:32} {len(found):5d} tried, {len(found) - len(wrong):5d} as stated"]
                rows += [f"    {fault.strip()}" for fault in wrong[:10]]
                print("\n".join(rows[-1 - len(wrong[:10]) :]), flush=True)
                bad += len(wrong)
        rows += ["", f"{bad} not as stated; {time.monotonic() - began:.0f} s"]
        REPORT.parent.mkdir(parents=True, exist_ok=True)
        REPORT.write_text("\n".join(rows) + "\n", encoding="utf-8")
        print(f"{rows[-1]}; {REPORT.relative_to(ROOT)}")
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
