"""summary.json holds the figures of summary.txt under names, the assembled scene, and how the run ended."""

from __future__ import annotations

import json
import math
import random
import re
import subprocess

import pytest
from biela.histories import read_summary, still_columns
from biela.plot import chosen_columns
from biela.programs import draw, export, plot, report
from biela.result_files import HistoryError, note
from biela.tradeoff_errors import against
from conftest import ROOT

NUMBER = re.compile(r"(?<![\w.+-])[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?(?![\w]|\.\d)")
DECKS = ("four_bar", "modal_four_bar", "frequency_response_cantilever", "quick_return", "slider_crank_joint_both")
DECKS += ("slider_crank_elastic", "end_stop", "controlled_arm", "crank_at_speed")
PENDULUM = """&scene title='a "quoted" title, Größe' gravity=0.0,-9.81 /
&body name='a' kind='rigid' mass=1.0 inertia=0.1 com=0.5,0.0 angle=0.3 /
&joint name='pin' type='revolute' body_a='a' /
&sensor name='tip' quantity='position' body='a' point=1.0,0.0 /
&transient t_end={t_end} method='{method}' step=1e-3 /
"""


def numbers(value):
    """All numbers of a nested figure."""
    if isinstance(value, dict):
        return [x for item in value.values() for x in numbers(item)]
    if isinstance(value, list):
        return [x for item in value for x in numbers(item)]
    return [float(value)] if isinstance(value, (int, float)) and not isinstance(value, bool) else []


def figures(folder):
    return json.loads((folder / "summary.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", DECKS)
def test_words_and_figures_have_the_same_facts(name, run_deck):
    """Each number of summary.json stands in summary.txt, rounded, and each of summary.txt in summary.json."""
    text = (ROOT / "input" / f"{name}.nml").read_text()
    text = re.sub(r"t_end=(1.5|2.0|0.4)\b", "t_end=0.02", text)
    text = text.replace("t_end=0.01 method='rk4' step=4.0e-6", "t_end=1e-3 accuracy=1e-2")
    text = text.replace("output_step=5.0e-4", "output_step=5.0e-4 check_error=.true.")
    text = re.sub(r"file='(?=\w)", f"file='{ROOT}/input/", text)
    run = run_deck(text)
    found = figures(run.folder)
    lines = run.summary.partition("\ndeck text\n")[0].splitlines()
    told = [line for line in lines if not line.startswith(("title", "version", "timing", "deck:")) and "warning: " not in line]
    numbered = re.compile(r"order 3|by 5 degrees|multiplier \d+: ")
    words = [word for line in told for word in NUMBER.findall(numbered.sub("", line))]
    facts = {key: value for key, value in found.items() if key not in ("scene", "groups", "timing")}
    values = numbers(facts)
    literal = {"3", "1", "0.01"}  # coordinates of a frame; the penetration of the examples
    rough = {word: 0.06 if re.fullmatch(r"-?\d\.\dE[-+]\d+|0\.\d\d?", word) else 6e-3 for word in words}
    same = {word: [x for x in values if math.isclose(x, float(word), rel_tol=rough[word], abs_tol=1e-300)] for word in words}
    sentences = json.dumps({key: value for key, value in facts.items() if key != "deck_text"})
    literal |= set(NUMBER.findall(sentences))  # in strings: what damps a body, whether modes are all
    assert [word for word in words if not same[word] and word not in literal] == []
    assert set(values) <= {x for one in same.values() for x in one}
    assert all(warning in "\n".join(lines) for warning in found["warnings"])
    names = [key for key in ("model", "stable_steps", "static", "modes", "frequency_response", "transient") if key in found]
    assert all("\n\n" + key.replace("_", " ") in run.summary for key in names)  # each under a heading that a blank line sets off
    assert found["outcome"] == "done"
    assert found["status"] == 0
    assert found["deck_text"] in run.summary
    assert set(found["timing"]) == {"seconds", "processor_seconds", "restarts", "ended", "host", "compiler"}


def test_names_with_quotes_and_letters_beyond_ascii_are_kept(run_deck):
    found = figures(run_deck(PENDULUM.format(t_end=0.01, method="rk4")).folder)
    assert found["title"] == 'a "quoted" title, Größe'
    assert found["deck_text"].startswith('&scene title=\'a "quoted"')


def test_a_run_that_fails_says_so_with_its_status(run_deck):
    text = PENDULUM.format(t_end=1.0, method="rk4").replace("/\n&joint", "angular_velocity=1e20 /\n&joint")
    run = run_deck(text, expect=1)
    found = figures(run.folder)
    assert found["status"] == 1
    assert f"outcome: {found['outcome']}" in run.summary


def test_a_figure_that_a_damaged_summary_lacks_is_named(tmp_path):
    (tmp_path / "summary.json").write_text('{"modes": {"count": 3}}')
    found = read_summary(tmp_path)
    assert found["modes"].get("poles") is None
    with pytest.raises(HistoryError, match="has no 'poles' where the solver writes it"):
        found["modes"]["poles"]


def test_warnings_are_listed(run_deck):
    text = PENDULUM.format(t_end=0.01, method="rk4").replace("&sensor", "&joint name='pin2' type='revolute' body_a='a' /\n&sensor")
    run = run_deck(text)
    assert any("redundant constraints" in line for line in figures(run.folder)["warnings"])


@pytest.mark.parametrize(("deck", "free", "driven"), [("four_bar", 1, 1), ("engine", 1, None), ("slider_crank_elastic", 1, 0)])
def test_check_tells_the_rigid_mobility(deck, free, driven, biela):
    path = ROOT / "input" / f"{deck}.nml"
    done = subprocess.run([biela, "--check", "--json", path], capture_output=True, text=True, check=True)
    found = json.loads(done.stdout)
    assert found["rigid_mobility"] == free
    assert driven is None or found["driven_freedoms"] == driven
    words = subprocess.run([biela, "--check", path], capture_output=True, text=True, check=True).stdout
    assert f"  rigid mobility: {free} degree" in words


def test_the_scene_stands_where_the_motion_begins(run_deck):
    text = (ROOT / "input" / "four_bar.nml").read_text().replace("t_end=1.5", "t_end=0.002")
    text = text.replace("motion_step=1.0e-2", "motion_step=2e-3").replace("file='", f"file='{ROOT}/input/")
    run = run_deck(text)
    first = run.motion
    for body in figures(run.folder)["scene"]["bodies"]:
        for number, (x, y) in enumerate(body["nodes"], 1):
            assert first[f"{body['name']}.{number}.x"][0] == pytest.approx(x, abs=1e-6)
            assert first[f"{body['name']}.{number}.y"][0] == pytest.approx(y, abs=1e-6)


def test_every_number_of_the_scene_is_given_in_full(run_deck):
    """Angles and points of no few digits come back to the last bit."""
    angle, x, y = 1.0 / 3.0, 0.1234567890123456, 1.0e-7 / 3.0
    text = PENDULUM.format(t_end=0.01, method="rk4").replace("angle=0.3", f"angle={angle!r} position={x!r},{y!r}")
    scene = figures(run_deck(text.replace("body_a='a'", f"body_a='a' point_b={x!r},{y!r}")).folder)["scene"]
    assert scene["bodies"][0]["frame"] == [x, y, angle]
    assert scene["gravity"] == [0.0, -9.81]
    assert scene["joints"][0]["b"]["at"] == [x, y]


@pytest.mark.parametrize("seed", range(3))
def test_the_size_is_the_largest_distance_between_two_points_of_a_body(seed, biela, tmp_path):
    """On a circle, away from the origin, no pair of points is much farther apart than others."""
    draw = random.Random(seed)
    turns = [draw.uniform(0.0, 2 * math.pi) for _ in range(9)]
    points = [(2.0 + math.cos(turn), -1.5 + math.sin(turn)) for turn in turns]
    deck = "&body name='r' mass=1.0 inertia=9.0 com=2.0,-1.5 /\n"
    deck += "".join(f"&force name='f{k}' body='r' point={x!r},{y!r} fx=1.0 /\n" for k, (x, y) in enumerate(points))
    (tmp_path / "a.nml").write_text(deck + "&transient t_end=1.0 step=0.1 /\n")
    done = subprocess.run([biela, "--check", "--json", "a.nml"], cwd=tmp_path, capture_output=True, text=True, check=True)
    farthest = max(math.dist(a, b) for a in points for b in points)
    assert json.loads(done.stdout)["scene"]["size"] == pytest.approx(farthest, rel=1e-5)


def test_every_body_has_its_kind(run_deck):
    deck = "&material name='m' density=1600.0 young=2.1e9 /\n&section name='s' area=1e-4 inertia=1e-9 /\n"
    deck += "&body name='r' mass=1.0 inertia=1.0 /\n"
    beam = "&body name='{}' kind='beam' length=0.4 elements=2 material='m' section='s' {} /\n"
    told = json.loads(run_deck(deck + beam.format("b", "") + beam.format("block", "flexible=.false."), "--check", "--json").stdout)
    assert told["scene"]["bodies"][1]["elements"] == [[1, 2], [2, 3]]
    assert {b["name"]: b["kind"] for b in told["model"]["bodies"]} == {"r": "rigid", "b": "beam", "block": "beam"}


def test_json_goes_with_check(biela):
    done = subprocess.run([biela, "--json", "a.nml"], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "--json goes with --check" in done.stderr


def test_lumps_stand_in_the_scene(run_deck):
    text = PENDULUM.format(t_end=0.002, method="rk4") + "&lump body='a' point=1.0,0.0 mass=2.5 /\n"
    (lump,) = figures(run_deck(text).folder)["scene"]["lumps"]
    assert (lump["mass"], lump["at"]["body"], lump["at"]["node"]) == (2.5, "a", 0)
    assert lump["at"]["at"] == pytest.approx([math.cos(0.3), math.sin(0.3)], abs=1e-5)


def test_a_new_run_removes_what_was_drawn_of_the_former_one_and_nothing_else(run_deck, tmp_path):
    deck = PENDULUM.format(t_end=0.002, method="rk4")
    folder = run_deck(deck, "--output", "out", name="first").folder
    for command, words in ((plot, [folder]), (draw, [folder]), (report, [folder]), (export, [folder, "--to", "csv"])):
        assert command.main([*map(str, words)]) == 0
    assert plot.main([str(folder), "--output", str(folder / "again.pdf")]) == 0
    drawn = {"history.png", "scene.png", "report.html", "history.csv", "again.pdf"}
    assert set((folder / ".drawn").read_text().split()) == drawn
    (folder / "mine.png").write_text("")
    sheets = [folder / "vtk" / name for name in ("motion.pvd", "motion_000000.vtu")]
    sheets[0].parent.mkdir()
    for sheet in sheets:
        sheet.touch()
    note(*sheets)
    with (folder / ".drawn").open("a") as file:
        file.write("../first.nml\n\n./mine.png\nnot there\nhistory.png")
    run_deck(deck, "--output", "out", name="second")
    assert {path.name for path in folder.iterdir()} & {*drawn, ".drawn", "mine.png"} == {"mine.png"}
    assert not any(sheet.exists() for sheet in sheets)
    assert (tmp_path / "first.nml").is_file()


def test_columns_that_only_rounding_moves_are_told_and_left_out(run_deck):
    """A pin on the ground, its moment, a weight that is held; a motion of a ten-millionth of the size is none of them."""
    done = run_deck(
        PENDULUM.format(t_end=1.0, method="rk4")
        + "&body name='block' mass=2.0 inertia=1.0 position=1.0,0.0 /\n"
        + "&joint name='weld' type='weld' body_a='block' point_b=1.0,0.0 /\n"
        + "&sensor name='pin' quantity='reaction' joint='pin' /\n&sensor name='pivot' quantity='position' body='a' /\n"
        + "&sensor name='weight' quantity='reaction' joint='weld' /\n"
        + "&body name='b' mass=1.0 inertia=0.1 position=2.0,0.0 angular_velocity=1e-7 /\n"
        + "&sensor name='b' quantity='angle' body='b' /\n"
        + "&joint name='q' type='revolute' body_a='b' point_b=2.0,0.0 /\n&sensor name='p' quantity='power' joint='pin' /\n"
    )
    told = still_columns(figures(done.folder))
    assert told == pytest.approx(
        {"pin.m": 0, "pivot.x": 0, "pivot.y": 0, "p": 0, "weight.fx": 0, "weight.fy": 19.62, "weight.m": 0}
    )
    assert "constant columns" in done.summary
    drawn, out = chosen_columns([done.history], None, None)
    assert drawn == ["tip.x", "tip.y", "pin.fx", "pin.fy", "b"]
    assert set(out) == (set(told) - {"weight.fy"}) | {"weight.fy = 19.62 N"}
    assert set(against(done.folder, []).columns) == set(drawn)
    short = run_deck(
        "&material name='m' density=1500.0 young=3e9 /\n&section name='s' shape='rectangle' width=0.02 height=0.02 /\n"
        "&body name='a' kind='beam' length=0.5 elements=1 material='m' section='s' reference='clamped' /\n"
        "&joint name='j' type='weld' body_a='a' node_a=1 /\n&force name='f' type='torque' body='a' node=2 moment=10.0 /\n"
        "&sensor name='in' quantity='internal' body='a' element=1 /\n"
        "&transient t_end=1e-4 method='rk4' step=1e-6 output_step=1e-5 /\n",
        name="short",
    )
    assert short.history["in.s"].max() > 1e4  # far above rounding, though the scene's size in so short a time is a large stress
    assert "in.s" not in still_columns(figures(short.folder))
