"""A plugin of pytest for `make mutants`: tests are collected once, each mistake meets those that reach it in a child process.

Tests that have noticed most mistakes in the least time come first. The child stops at the first test that fails, and after
MUTANT_SECONDS of a processor, so that a busy machine does not make the tests fewer; one that hangs is killed, and counts as a
failure. Each mistake becomes a line of JSON in the file PLANTED_MET, which several processes share: MUTANT_SHARE=1/2 takes every
second mistake.
"""

from __future__ import annotations

import json
import os
import select
import signal
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest

MET = Path(os.environ["PLANTED_MET"])
TESTS = json.loads(Path(os.environ["PLANTED_TESTS"]).read_text(encoding="utf-8"))
SECONDS = float(os.environ["MUTANT_SECONDS"])
HANG = 600.0  # a test that takes longer, on a busy machine [s]
FAILED: list[str] = []


def pytest_runtest_logreport(report):
    """Remember what failed."""
    if report.failed:
        FAILED.append(report.nodeid)


def meet(items: list[pytest.Item], mistake: str, ended: Callable[[], None]) -> dict:
    """Run tests in this process until one fails or the time is over."""
    os.environ["PLANTED"] = mistake
    met = []
    for item, following in zip(items, [*items[1:], None]):
        met.append(item.nodeid)
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
        ended()
        if FAILED or sum(os.times()[:4]) > SECONDS:  # of this process and of those that it started
            break
    return {"failed": FAILED[:1], "met": met, "of": len(items)}


def in_a_child(items: list[pytest.Item], mistake: str) -> dict:
    """Return what a child process that meets a mistake says; its group ends with it."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        os.setsid()
        os.dup2(os.open(os.devnull, os.O_RDWR), 1)
        os.dup2(1, 2)
        os.write(writer, json.dumps(meet(items, mistake, lambda: os.write(writer, b"."))).encode())
        os._exit(0)
    os.close(writer)
    said, part = b"", b"."
    while part and select.select([reader], [], [], HANG)[0]:
        part = os.read(reader, 65536)
        said = (said + part).lstrip(b".")
    os.close(reader)
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return json.loads(said) if said and not part else {"failed": ["a test that hangs"], "met": [], "of": len(items)}


def pytest_runtestloop(session):
    """Meet the mistakes of this process's share."""
    items = {item.nodeid: item for item in session.items}
    noticed, met, known = Counter(), Counter(), 0
    share, shares = map(int, os.environ["MUTANT_SHARE"].split("/"))

    def worth(test: tuple[float, str]) -> float:
        """Return what a test promises: mistakes noticed a meeting, by itself and by its file, a second."""
        seconds, name = test
        file = name.split("::")[0]
        return (noticed[name] + (noticed[file] + 1) / (met[file] + 4)) / (met[name] + 1) / (seconds + 0.1)

    for mistake in list(TESTS)[share - 1 :: shares]:
        lines = MET.read_text(encoding="utf-8").split("\n")[:-1]  # the last one may not be whole yet
        for line in lines[known:]:
            told = json.loads(line)
            met.update(name for test in told["met"] for name in (test, test.split("::")[0]))
            noticed.update(name for test in told["failed"] for name in (test, test.split("::")[0]))
        known = len(lines)
        tests = sorted(((s, name) for s, name in TESTS[mistake] if name in items), key=worth, reverse=True)
        told = in_a_child([items[name] for _, name in tests], mistake)
        with MET.open("a", encoding="utf-8") as file:
            file.write(json.dumps({"mistake": int(mistake), **told}) + "\n")
    return True
