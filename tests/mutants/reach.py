"""A plugin of pytest for `make mutants`: which mistakes does each test reach, and how long does it take?

Each test gets a file of its own, in which the program under test marks the questions that it asks (PLANTED_SEEN).
"""

from __future__ import annotations

import json
import os
import time
from hashlib import sha1
from pathlib import Path

import pytest
from _pytest.runner import runtestprotocol

FOLDER = Path(os.environ["PLANTED_FOLDER"])
PASSED: dict[str, bool] = {}


def pytest_runtest_logreport(report):
    """Remember whether each part of a test passed."""
    PASSED[report.nodeid] = PASSED.get(report.nodeid, True) and report.passed


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item):
    """Name the file, run the test with all of its fixtures, those of its module too, note its name, time and end."""
    record = FOLDER / sha1(item.nodeid.encode()).hexdigest()
    os.environ["PLANTED_SEEN"] = str(record) + ".seen"
    start = time.perf_counter()
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    runtestprotocol(item, nextitem=None)  # as if it were the last one: nothing is left that the next test would not reach
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    test = {"name": item.nodeid, "seconds": time.perf_counter() - start, "passed": PASSED.get(item.nodeid, False)}
    Path(str(record) + ".json").write_text(json.dumps(test), encoding="utf-8")
    return True
