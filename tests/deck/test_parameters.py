"""Parameters, expressions, repeated parts, scales of tables: their values, and the flat deck that has the same meaning."""

from __future__ import annotations

import json
import math
import random
import re
import subprocess
from pathlib import Path

import pytest
from conftest import ROOT, Run, wait_for

NAMES = {"pi": math.pi, "deg": math.pi / 180, "rpm": math.pi / 30, "mm": 1e-3, "um": 1e-6, "ms": 1e-3, "us": 1e-6}
NAMES |= {"kN": 1e3, "MPa": 1e6, "GPa": 1e9, "abs": abs, "min": min, "max": max}
NAMES |= {name: getattr(math, name) for name in ["sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sqrt", "exp", "log"]}
STATED = re.compile(r"^&parameter name='(\w+)' value=(\S+) /$", re.MULTILINE)
DISC = "&body name='disc' mass=1 inertia=1 /\n"


def flat(biela: Path, folder: Path, text: str, *options: str) -> str:
    """Return what --flat prints of a deck."""
    (folder / "deck.nml").write_text(text, encoding="utf-8")
    done = subprocess.run([biela, "--flat", *options, "deck.nml"], cwd=folder, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


def values(biela: Path, folder: Path, expressions: dict[str, str], *options: str) -> dict[str, float]:
    """Return the values that parameters have."""
    text = DISC + "".join(f"&parameter name='{name}' value={{{text}}} /\n" for name, text in expressions.items())
    return {name: float(value) for name, value in STATED.findall(flat(biela, folder, text, *options))}


def written(draw: random.Random, depth: int) -> str:
    """Return a random expression."""
    kind = draw.randrange(9) if depth else 0
    if kind == 0:
        return draw.choice(["2", "0.5", "1.25e-1", "3D0", "7.", "pi", "MPA", "a", "B", " 30*deg", "-4"])
    inner = [written(draw, depth - 1) for _ in range(2)]
    if kind < 5:
        return f"({inner[0]}{draw.choice(['+', '-', '*', ' / '])}{inner[1]})"
    if kind == 5:
        return draw.choice(["abs({})^{}", "-abs({})**-{}"]).format(inner[0], draw.choice(["2", "0.5", "3^-1"]))
    if kind == 6:
        return f"{draw.choice(['min', 'max', 'ATAN2'])}({inner[0]},{inner[1]})"
    return f"{draw.choice(['sin', 'cos', 'atan'])}({inner[0]}+1)"


def test_300_random_expressions_have_the_values_that_python_finds(biela, tmp_path):
    draw = random.Random(28)
    known = NAMES | {"MPA": 1e6, "ATAN2": math.atan2, "a": 1.5, "B": -0.75}
    found, wanted = {"a": "1.5", "b": "a/-2"}, {}
    while len(wanted) < 300:
        text = written(draw, 4)
        try:
            value = eval(text.replace("^", "**").replace("D0", "e0"), {"__builtins__": {}}, known)
        except (ArithmeticError, ValueError):
            continue
        if value == 0.0 or 1e-40 < abs(value) < 1e40:
            wanted[f"x{len(wanted)}"] = value
            found[f"x{len(found) - 2}"] = text
    got = values(biela, tmp_path, found)
    assert {name: got[name] for name in wanted} == pytest.approx(wanted, rel=1e-13, abs=1e-13)
    assert len({round(value, 9) for value in wanted.values()}) > 200


def test_powers_bind_from_the_right_and_before_signs(biela, tmp_path):
    texts = {"-2^2": -4, "2^3^2": 512, "2**-1": 0.5, "-2^-2": -0.25, "2*3^2/6": 3, "1-2-3": -4, "8/4/2": 1, "2--3": 5}
    texts |= {"(-2)^3": -8, "(-2)^-3": -0.125, "(-2)^-4": 0.0625, "(-2)^4": 16}
    texts |= {"0^0": 1, "1e-50^2*1e-51": 0, "exp(-1e3)": 0, "min(3,1,2)": 1, "12*mm": 0.012, "atan2(1,-1)/pi": 0.75, "+-+2": -2}
    got = values(biela, tmp_path, {f"x{k}": text for k, text in enumerate(texts)})
    assert list(got.values()) == list(texts.values())


def test_a_value_may_stand_before_its_name(biela, tmp_path):
    text = DISC + "&parameter value={3*a} name='b' /\n&parameter value=2 name='a' /\n"
    assert {name: float(value) for name, value in STATED.findall(flat(biela, tmp_path, text))} == {"a": 2.0, "b": 6.0}


def test_5000_parameters_that_need_each_other_in_any_order(biela, tmp_path):
    chain = {f"p{k}": f"p{k + 1}+1" for k in range(5000)} | {"p5000": "0"}
    assert values(biela, tmp_path, chain)["p0"] == 5000
    assert values(biela, tmp_path, chain, "--set", "P5000=2^3")["p0"] == 5008


def test_parameters_that_nothing_uses_are_listed_by_the_check_alone(run_deck):
    deck = "&parameter name='idle' value=1 /\n&parameter name='m' value=2 /\n&body name='a' mass={m} inertia=1 /\n"
    deck += "&transient t_end=0.1 step=0.1 /\n"
    assert run_deck(deck, "--check").stderr.endswith("/scene.nml:1: parameter/idle: warning: no expression uses it\n")
    assert run_deck(deck, "--quiet").stderr == ""


ARM = """&scene gravity=0,-9.81 /
&parameter name='L' value=0.2 /
&parameter name='w' value={L/10} /
&material name='m' density=1200.0 young={3*GPa} /
&body name='palm' mass=1 inertia=1 /
&joint name='hold' type='revolute' body_a='palm' point_a=0,{w} point_b=0,{w} /
"""
FINGER = """! a link with a tip, hinged to a palm
&parameter name='L' value={4*w} /
&parameter name='n' value=2 /
&section name='s' shape='rectangle' width={w} height={w/4} / ! comments stay
&body name='link' kind='beam' length={L} elements={n*1.0} element_material={n_is}'m' section='s' angle={30*deg} position=2*{0*n} /
&joint name='root' type='revolute' body_a='link' node_a=1 body_b='palm' point_b={side*w},0 /
&include file='tip.nml' prefix='tip_' /
&parameter name='side' value=1 /
""".replace("{n_is}", "2*")
TIP = "&lump body='link' node=-1 mass=0.1 /\n&sensor name='place' quantity='position' body='link' node={n+1} /\n"
END = "&sensor name='r' quantity='reaction' joint='{0}root' /\n&transient t_end={1} step={2} method='radau' /\n"
HAND = (
    ARM
    + "&include file='parts/finger.nml' prefix='left_' set='L=w*3','side=-1' / &include file='parts/finger.nml' prefix='right_' /\n"
    + END.format("left_", "{20*ms}", "{1*ms}")
)


def by_hand() -> str:
    """Return the hand as one deck of numbers."""
    text = "&scene gravity=0,-9.81 /\n&material name='m' density=1200.0 young=3e9 /\n&body name='palm' mass=1 inertia=1 /\n"
    text += "&joint name='hold' type='revolute' body_a='palm' point_a=0,0.02 point_b=0,0.02 /\n"
    for side, x, length in (("left_", -0.02, 0.2 / 10 * 3), ("right_", 0.02, 0.08)):
        text += f"&section name='{side}s' shape='rectangle' width=0.02 height=0.005 /\n"
        text += f"&body name='{side}link' kind='beam' length={length!r} elements=2 material='m' section='{side}s' "
        text += f"angle={math.pi / 180 * 30!r} /\n&joint name='{side}root' type='revolute' body_a='{side}link' node_a=1 "
        text += f"body_b='palm' point_b={x!r},0 /\n&lump body='{side}link' node=-1 mass=0.1 /\n"
        text += f"&sensor name='{side}tip_place' quantity='position' body='{side}link' node=3 /\n"
    return text + END.format("left_", "0.02", "0.001")


def rows(run: Run) -> list[str]:
    """Return the columns and rows of history.txt."""
    lines = (run.folder / "history.txt").read_text(encoding="utf-8").splitlines()
    return [line for line in lines if line.startswith("# columns:") or not line.startswith("#")]


@pytest.fixture
def hand(tmp_path) -> str:
    """Return the deck of a hand, with its parts beside it."""
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "finger.nml").write_text(FINGER)
    (tmp_path / "parts" / "tip.nml").write_text(TIP)
    return HAND


def test_repeated_parts_and_the_flat_deck_are_the_deck_written_by_hand(run_deck, biela, tmp_path, hand):
    wanted = rows(run_deck(by_hand(), "--quiet", name="by_hand"))
    assert len(wanted) == 22
    done = run_deck(hand, "--quiet", name="hand")
    assert rows(done) == wanted
    assert (done.folder / "summary.txt").read_text().count("! comments stay") == 1  # a file that stands there twice is stated once
    text = flat(biela, tmp_path, hand)
    assert "{" not in text
    assert "&parameter name='left_L' value=0.06 /\n" in text
    assert text.count("! comments stay") == 2
    for part in (tmp_path / "parts").iterdir():
        part.unlink()
    assert rows(run_deck(text, "--quiet", name="flat")) == wanted


def test_what_an_include_sets_is_read_where_it_stands(biela, tmp_path):
    """`w` is that of the part between, not of the deck; a quote in the folder of a table stays one in the flat deck."""
    folder = tmp_path / "it's"
    folder.mkdir()
    (folder / "mid.nml").write_text("&parameter name='w' value=2 /\n&include file='leaf.nml' prefix='l_' set='L=w*3' /\n")
    (folder / "leaf.nml").write_text("&parameter name='L' value=0 /\n&history name='h' kind='table' file='t.csv' /\n")
    (folder / "t.csv").write_text("0 1\n1 2\n")
    text = flat(biela, tmp_path, "&parameter name='w' value=1 /\n&include file='it''s/mid.nml' prefix='m_' /\n")
    assert "&parameter name='m_l_L' value=6 /" in text
    assert flat(biela, tmp_path, text) == text
    assert f"file='{str(tmp_path).replace(chr(39), 2 * chr(39))}/it''s/t.csv'" in text


def test_words_in_quotes_stay_words_in_json(biela, tmp_path):
    deck = "&scene title='t' gravity=0,-9.81 /\n&body name='12' kind='rigid' mass=2*mm_ inertia=1 /\n".replace("2*mm_", "{2*mm}")
    deck += "&force name='1e3' body='12' fx=1e3 /\n&transient t_end=1 step=1d-1 method='rk4' accept_unstable=.t. /\n"
    found = json.loads(flat(biela, tmp_path, deck, "--json"))
    assert found[0] == {"group": "scene", "title": ["t"], "gravity": [0, -9.81]}
    assert found[1] == {"group": "body", "name": ["12"], "kind": ["rigid"], "mass": [0.002], "inertia": [1]}
    assert (found[2]["name"], found[2]["fx"], found[3]["step"]) == (["1e3"], [1000], [0.1])
    assert found[3]["accept_unstable"] == [True]


def test_set_reaches_parameters_of_parts_and_is_stated(run_deck, hand):
    run = run_deck(hand, "--quiet", "--set", "left_L=2*L", "--set", "l=0.1", name="set")
    assert "\n! --set L=0.1\n! --set left_L=0.2\n" in run.summary
    plain = run_deck(hand.replace("'L=w*3'", "'L=2*L_'").replace("{L/10}", "{L_/10}").replace("'L'", "'L_'").replace("0.2", "0.1"))
    assert rows(run) == rows(plain)


def test_a_restart_refuses_other_values(biela, tmp_path, run_deck):
    deck = DISC + "&parameter name='k' value=1 /\n&parameter name='g' value=9.81 /\n&scene gravity=0,{-g*k} /\n"
    (tmp_path / "deck.nml").write_text(deck + "&transient t_end=1e6 step=1e-3 output_step=100 checkpoint_interval=100 /\n")
    child = subprocess.Popen([biela, "--quiet", "--set", "k=0.5+0", "deck.nml"], cwd=tmp_path)
    wait_for(tmp_path / "results" / "deck" / "checkpoint", child)
    child.kill()
    child.wait()
    for words in ((), ("--set", "k=2", "--set", "g=1")):
        done = run_deck(tmp_path / "deck.nml", "--restart", *words, expect=2)
        assert "belongs to another deck or other values of --set, or the deck has been changed" in done.stderr


def test_parts_of_parts_without_number_are_refused(run_deck, tmp_path):
    for k in range(20):
        (tmp_path / f"p{k}.nml").write_text("".join(f"&include file='p{k + 1}.nml' prefix='{side}' /\n" for side in "ab"))
    (tmp_path / "p20.nml").write_text("&lump body='disc' mass=1 /\n")
    done = run_deck(DISC + "&include file='p0.nml' /\n", "--check", expect=2)
    assert "include: file='p1.nml' is one file too many, expected at most 5000\n" in done.stderr


def test_tables_are_scaled_and_shifted(run_deck, tmp_path):
    """Milliseconds and degrees; a periodic table a third of its period later."""
    (tmp_path / "cam.csv").write_text("ms;deg\n0;0\n100;30\n200;10\n300;0\n")
    angle = math.pi / 180
    table = "&history name='h' kind='table' interpolation='pchip' periodic=.true. "
    by_file = table + "file='cam.csv' time_scale={1*ms} value_scale={1*deg} time_shift=0.1 /\n"
    by_hand = table + f"time=0.1,0.2,0.3,0.4 value=0,{30 * angle!r},{10 * angle!r},0 /\n"
    shifted = table + f"time=0,0.1,0.2,0.3 value={10 * angle!r},0,{30 * angle!r},{10 * angle!r} /\n"
    rest = DISC + "&joint name='j' type='revolute' body_a='disc' /\n&drive name='d' body_a='disc' history='h' /\n"
    rest += "&sensor name='a' quantity='angle' body='disc' /\n&transient t_end=0.5 step=0.01 /\n"
    runs = [run_deck(text + rest, "--quiet", name=f"d{k}") for k, text in enumerate((by_file, by_hand, shifted))]
    one, two, three = (run.history.data for run in runs)
    assert one == pytest.approx(two, abs=1e-12)
    assert one == pytest.approx(three, abs=1e-12)
    assert one[:, 1].max() == pytest.approx(30 * angle, abs=1e-9)


def test_the_robots_motors_bring_its_platform_to_the_pose_that_is_asked_for(run_deck):
    """Inverse kinematics by expressions; the rods bend by micrometres in the end."""
    run = run_deck(ROOT / "input" / "parallel_robot.nml", "--quiet", "--set", "turn1=10*deg", "--set", "y1=-20*mm")
    last = dict(zip(run.history.names, run.history.data[-1]))
    assert last["platform.x"] == pytest.approx(0.04, abs=1e-5)
    assert last["platform.y"] == pytest.approx(-0.02, abs=1e-5)
    assert last["turn"] == pytest.approx(10 * NAMES["deg"], abs=1e-4)
