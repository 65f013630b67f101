"""report.py: one page that needs nothing else, with the sections that a run has, and only those."""

from __future__ import annotations

import re
import subprocess
import sys
from html.parser import HTMLParser

import pytest
from conftest import ROOT

CRANK = (ROOT / "input" / "slider_crank_elastic.nml").read_text().replace("t_end=0.01", "t_end=2e-4")
VOID = {"meta", "img", "br", "link", "wbr"}


class Page(HTMLParser):
    """What a page refers to, its headings, and whether its elements close."""

    def __init__(self, text):
        super().__init__()
        self.open, self.references, self.headings, self.ids = [], [], [], set()
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        """Note what an element refers to."""
        values = dict(attrs)
        self.references += [values[key] for key in ("src", "href") if key in values]
        self.ids |= {values["id"]} if "id" in values else set()
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        """Elements close in the order in which they opened."""
        assert self.open.pop() == tag

    def handle_data(self, data):
        """Note headings."""
        if self.open and self.open[-1] == "h2":
            self.headings.append(data)


def report(folder, *words):
    done = subprocess.run(
        [sys.executable, ROOT / "post" / "report.py", *words], cwd=folder, capture_output=True, text=True, check=False
    )
    assert "Traceback" not in done.stderr
    return done


@pytest.fixture(scope="module")
def page(biela, tmp_path_factory):
    """Return the page of two runs."""
    folder = tmp_path_factory.mktemp("report")
    (folder / "stiff.nml").write_text(CRANK)
    (folder / "<soft>.nml").write_text(CRANK.replace("young=2.1e10", "young=1.1e10").replace("young=2.1d10", "young=1.1e10"))
    subprocess.run([biela, "--quiet", "stiff.nml", "<soft>.nml"], cwd=folder, check=True, capture_output=True)
    done = report(folder, "results/stiff", "results/<soft>", "--output", "two.html")
    assert done.returncode == 0, done.stderr
    return (folder / "two.html").read_text(encoding="utf-8")


def test_the_page_is_whole_and_self_contained(page):
    parsed = Page(page)
    assert parsed.open == []
    for reference in parsed.references:
        assert reference.startswith(("data:image/", "#")), reference
        assert not reference.startswith("#") or reference[1:] in parsed.ids
    assert not re.search(r"url\(|@import|<script", page)


def test_sections_are_those_that_the_runs_have(page):
    headings = Page(page).headings
    assert headings == [
        "At a glance",
        "Scene and model",
        "Histories",
        *(["Motion"] if "motion_step" in CRANK else []),
        "Energy, accuracy, validity",
        "Stable steps",
        "Decks",
    ]


def test_the_differences_and_both_decks_are_there(page):
    assert "largest difference" in page
    assert "&lt;soft&gt;" in page
    assert "<soft>" not in page
    assert page.count("&amp;transient") >= 2


def test_one_run_with_modes(run_deck, tmp_path):
    run_deck((ROOT / "input" / "modal_four_bar.nml").read_text().replace("file='", f"file='{ROOT}/input/"))
    done = report(tmp_path, "results/scene")
    assert done.returncode == 0, done.stderr
    headings = Page((tmp_path / "results" / "scene" / "report.html").read_text(encoding="utf-8")).headings
    assert {"Equilibrium", "Modes"} <= set(headings)
    assert "Histories" not in headings


def test_what_is_no_run_is_told_in_a_line(tmp_path):
    (tmp_path / "empty").mkdir()
    for words in (["none"], ["empty"], ["a", "b", "c"]):
        done = report(tmp_path, *words)
        assert done.returncode == 2
        assert len(done.stderr.splitlines()) == 1
