"""report.py: one page that needs nothing else, with the sections that a run has, and only those."""

from __future__ import annotations

import html
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from biela import engineering
from biela import report_page as report_tool
from biela.histories import HistoryError, read
from biela.programs import report as report_command
from conftest import ROOT
from linear_scenes import FORCE, beam, sweep
from tool_calls import call

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
    return call(report_command.main, *words, cwd=folder)


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
        "Results",
        "Scene",
        "Histories",
        *(["Motion"] if "motion_step" in CRANK else []),
        "Energy",
        "Model and solver",
        "Stable steps",
        "Decks",
    ]


def test_what_a_designer_asks_comes_first(run_deck, tmp_path):
    """A part, a rigid arm, turned by 2 N m at a constant rate of 3 rad/s against a damper: the drive's work is lost in it."""
    part = """&body name='arm' kind='rigid' mass=1.0 inertia=0.1 /
&joint name='pin' type='revolute' body_a='arm' /
&spring name='d' type='torsional' body_a='arm' stiffness=1e-9 damping=0.6666666666666666 /
&history name='h' kind='polynomial' coefficients=0.0,3.0 /
&drive name='motor' type='rotation' body_a='arm' history='h' /
&sensor name='m' quantity='reaction' drive='motor' /
&sensor name='Spent' quantity='work' drive='motor' /
&sensor name='p' quantity='reaction' joint='pin' /
&sensor name='taken' quantity='power' spring='d' /
&material name='rubber' density=1e3 young={1*MPa} prony_alpha=1.0 prony_tau=0.01 band=1.0,100.0 /
&transient t_end=1.0 method='rk4' step=1e-2 output_step=1e-2 motion_step=1e-2 /
"""
    (tmp_path / "part.nml").write_text(part)
    deck = "&include file='part.nml' prefix='a_' /\n"
    run = report_tool.load(run_deck(deck).folder, "arm")
    found = report_tool.findings(run)
    assert re.fullmatch(r"2 N m at t = \S+ s; mean 2 N m", found["torque of drive a_motor"])
    assert found["power of drive a_motor"] == "not measured: a sensor with quantity='power'"
    assert found["work of drive a_motor"] == "6 J"
    assert (found["work of drives and loads"], found["energy lost in spring a_d"]) == ("6 J", "6 J")
    assert re.fullmatch(r"-6 W at t = \S+ s", found["largest power of spring a_d"]), "what it puts into the mechanism"
    both = engineering._power(np.arange(4.0), np.array([0.0, 7505.0, -8772.0, 1.0]))
    assert both == "7505 W at t = 1 s; -8772 W at t = 2 s", "the motor's, and the brake's"
    assert "largest force, a_p" not in found, "rounding"
    late = report_tool.load(run.folder, "arm", 0.25, 0.75)
    assert report_tool.findings(late)["largest kinetic energy"].split("at")[0] == found["largest kinetic energy"].split("at")[0]
    assert report_tool.findings(late)["work of drive a_motor"] == "3 J", "of the rows that count"
    assert report_tool.findings(late)["work of drives and loads"] == "3 J"
    times = [float(time) for words in report_tool.findings(late).values() for time in re.findall(r"t = (\S+) s", words)]
    assert min(times) >= 0.25
    assert "Rows from 0.25 s to 0.75 s count." in report_tool.results([late]).parts[-1].paragraphs
    first = report_tool.results([run])
    assert first.parts[-1].pictures[0].caption == "arm: modulus of material a_rubber"
    assert run.outcome == "done"
    run.figures["warnings"].append("body bends too far")
    assert run.outcome == "done, but with 1 warning"
    assert report_tool.results([run]).parts[0].paragraphs == ["body bends too far"]


def test_the_largest_force_of_a_stop_is_that_of_the_steps_as_in_the_summary(run_deck):
    deck = (ROOT / "input" / "clearance_slider_crank.nml").read_text().replace("tolerance=1.0e-11", "tolerance=1e-6")
    run = report_tool.load(run_deck(deck).folder, "pin")
    force = run.figures["transient"]["stops"][0]["largest_force"]
    assert report_tool.findings(run)["largest force of stop, pin"].startswith(f"{force:.4g} N between rows near t = ")


@pytest.mark.long
@pytest.mark.skipif(not shutil.which("chromium"), reason="needs a browser")
@pytest.mark.parametrize(("width", "printed"), [(390, False), (1920, False), (718, True)])
def test_the_page_is_as_wide_as_its_window_or_its_paper(biela, tmp_path, width, printed):
    """Two runs with long findings; on paper nothing can be scrolled."""
    for deck in ("four_bar", "friction_slider_crank"):
        subprocess.run([biela, "--quiet", "--output", tmp_path / deck, f"{ROOT}/input/{deck}.nml"], check=True, capture_output=True)
    report(tmp_path, tmp_path / "four_bar", tmp_path / "friction_slider_crank", "--output", tmp_path / "both.html")
    page = (tmp_path / "both.html").read_text()
    page = page.replace("@media print", "@media all") if printed else page
    script = "<script>parent.document.body.dataset.width = document.documentElement.scrollWidth</script></body>"
    inner = html.escape(page.replace("</body>", script))  # no window is narrower than 500, a frame is
    frame = f'<body><iframe style="width: {width}px; height: 900px; border: 0" srcdoc="{inner}"></iframe></body>'
    (tmp_path / "page.html").write_text('<meta charset="utf-8">' + frame)
    words = ["--headless", "--no-sandbox", "--disable-gpu", "--window-size=2000,900", "--dump-dom", f"{tmp_path}/page.html"]
    done = subprocess.run(["chromium", *words], capture_output=True, text=True, check=True, timeout=100)
    assert int(re.search(r'data-width="(\d+)"', done.stdout)[1]) <= width


def test_two_runs_have_their_names_and_a_film_stands_beside_its_words(biela, tmp_path):
    for name, young in (("stiff", "2.1e10"), ("soft", "1.1e10")):
        (tmp_path / "deck.nml").write_text(re.sub(r"young=2\.1[ed]10", f"young={young}", CRANK))
        subprocess.run([biela, "--quiet", "--output", tmp_path / name, tmp_path / "deck.nml"], check=True, capture_output=True)
    (tmp_path / "stiff" / "motion.gif").write_bytes(b"GIF89a")
    runs = [report_tool.load(tmp_path / name, name) for name in ("stiff", "soft")]
    section = report_tool.each("Motion", runs, report_tool.motion)
    assert section.pair, "side by side where the page is wide"
    assert [part.film[:15] for part in section.parts] == ["data:image/gif;", ""]
    page = report_tool.page(runs, "two")
    assert page.count('class="showing"') == 1
    assert "soft less stiff" in page
    assert "range of stiff" in page
    Page(page)
    tables = [read(fake(tmp_path / f"run{k}", 0, ["t[s]", "x[m]", "y[m]"]).folder) for k in range(2)]
    figure = report_tool.plot.draw(tables, ["stiff", "soft"], ["x", "y"], styled=True)
    looks = [(line.get_color(), line.get_linestyle()) for line in figure.axes[0].lines]
    assert (looks[0][0], looks[1][0]) == (looks[2][0], looks[3][0]), "a column's colour in both runs"
    assert looks[0][1] == looks[1][1] != looks[2][1] == looks[3][1], "a run's line style in both columns"


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


def test_a_title_in_another_encoding(run_deck, tmp_path):
    deck = ROOT / "input" / "quick_return.nml"
    (tmp_path / "scene.nml").write_bytes(re.sub(rb"title='[^']*'", b"title='b\xf3ia'", deck.read_bytes()))
    run_deck(tmp_path / "scene.nml")
    done = report(tmp_path, "results/scene")
    assert done.returncode == 0, done.stderr
    assert "<h1>b\u00f3ia</h1>" in (tmp_path / "results" / "scene" / "report.html").read_text(encoding="utf-8")


def test_what_is_no_run_is_told_in_a_line(tmp_path):
    (tmp_path / "empty").mkdir()
    for words in (["none"], ["empty"], ["a", "b", "c"]):
        done = report(tmp_path, *words)
        assert done.returncode == 2
        assert len(done.stderr.splitlines()) == 1


@pytest.fixture(scope="module")
def modal_run(biela, tmp_path_factory):
    """Return the results folder of a damped beam with modes and a response."""
    folder = tmp_path_factory.mktemp("modal")
    (folder / "beam.nml").write_text(beam(6, ghm="ghm_alpha=0.5 ghm_zeta=2.0 ghm_omega=1000.0") + FORCE + sweep(1.0, 300.0, 30))
    subprocess.run([biela, "--quiet", "beam.nml"], cwd=folder, check=True, capture_output=True)
    return folder / "results" / "beam"


def test_modes_and_responses_have_their_figures(modal_run, monkeypatch):
    monkeypatch.setattr(report_tool, "embed", lambda _, caption: caption)
    run = report_tool.load(modal_run, "beam")
    part = report_tool.modal(run)
    table = read(modal_run, "modes")
    assert part.pictures == ["beam: shapes", "beam: poles"]
    assert [row[1] for row in part.rows] == [report_tool.table_text(pole["mode"]) for pole in run.figures["modes"]["poles"]]
    assert part.rows[0][2] == f"{table['frequency'][0]:.4g}"
    section = report_tool.each("Frequency response", [run], report_tool.responses)
    assert (section.title, section.parts[0].pictures) == ("Frequency response", ['beam: response to force "tip"'])


def test_runs_are_compared_at_common_rows_and_in_one_unit(tmp_path):
    """A parabola at every row and at every third one: no difference; metres beside metres a second are not compared."""
    time = np.arange(31) * 0.1
    for name, rows, unit in (("fine", time, "m"), ("coarse", time[::3], "m"), ("rate", time, "m/s")):
        table = "".join(f"{t:.17g} {t * t:.17g}\n" for t in rows)
        (tmp_path / name).mkdir()
        (tmp_path / name / "history.txt").write_text(f"# columns: t[s] x[{unit}]\n{table}")
    fine, coarse, rate = (report_tool.Run(tmp_path / name, {}, name) for name in ("fine", "coarse", "rate"))
    (part,) = report_tool.differences([fine, coarse], ["x"])
    assert part.rows == [["x [m]", "9", "0", "0 %"]]
    (part,) = report_tool.differences([fine, rate], ["x"])
    assert part.paragraphs == ["x: x [m] and x [m/s] are not compared."]


def test_two_runs_of_one_name_are_told_apart():
    assert report_tool._names([Path("/a/x/r"), Path("/a/y/r")]) == ["x/r", "y/r"]
    assert report_tool._names([Path("/a/x/r"), Path("/a/x/r")]) == ["r (1)", "r (2)"]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--labels", "one", "two"], "report: 2 labels (one, two) for 1 runs: one each expected, all different\n"),
        (["--output", "."], "report: .: cannot be written (Is a directory)\n"),
        (["--output", "file/page.html"], "report: file/page.html: cannot be written (File exists)\n"),
    ],
)
def test_what_is_wrong_with_the_command_is_told_in_a_line(modal_run, tmp_path, monkeypatch, capsys, words, told):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(report_tool, "page", lambda *_: "<html></html>")
    (tmp_path / "file").write_text("")
    assert report_command.main([str(modal_run), *words]) == 2
    captured = capsys.readouterr()
    assert (captured.out, captured.err) == ("", told)


def fake(folder, status, columns):
    """Return a run with these columns, (time, constant, 2 t, 3 t, ...)."""
    folder.mkdir()
    rows = [" ".join(f"{k * t:.1f}" for k in range(1, len(columns) + 1)) for t in (0.0, 1.0, 2.0)]
    (folder / "history.txt").write_text("\n".join([f"# columns: {' '.join(columns)}", *rows]) + "\n")
    return report_tool.Run(folder, {"status": status, "scene": {}}, "", folder.name)


def test_only_so_many_columns_are_drawn_and_what_one_run_lacks_is_named(tmp_path, monkeypatch):
    seen = []
    monkeypatch.setattr(report_tool, "column_pictures", lambda *words: seen.append(words[2]) or [])
    many = ["t[s]", *(f"c{k}[m]" for k in range(43))]
    section = report_tool.histories([fake(tmp_path / "one", 0, many)])
    assert section.parts[0].paragraphs == ["The first 40 of 43 columns are drawn; history.txt holds all."]
    assert [len(names) for names in seen] == [40]
    runs = [fake(tmp_path / "a", 0, ["t[s]", "x[m]", "y[m]"]), fake(tmp_path / "b", 0, ["t[s]", "z[m]", "x[m]"])]
    section = report_tool.histories(runs)
    assert section.parts[0].paragraphs == ["Not in both runs: y, z."]
    assert section.parts[1].rows == [["x [m]", "4", "2", "50 %"]]


def test_a_damaged_table_is_a_fault_of_a_run_that_ended_well_only(tmp_path):
    for name, status in (("one", 0), ("two", 1)):
        run = fake(tmp_path / name, status, ["t[s]", "x[m]"])
        (run.folder / "history.txt").write_text("# columns: t[s] x[m]\n")
        if run.ok:
            with pytest.raises(HistoryError, match="holds no rows"):
                run.table("history")
        else:
            assert run.table("history") is None
            assert report_tool.histories([run]) is None
    assert run.table("energy") is None


@pytest.mark.parametrize(("figure", "shown"), [(None, "–"), (1234567, "1,234,567"), (0.000123456, "0.0001235"), ("rk4", "rk4")])
def test_figures_of_tables(figure, shown):
    assert report_tool.table_text(figure) == shown
