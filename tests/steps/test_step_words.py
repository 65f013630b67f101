"""`--check` says before a run whether the deck's own step is stable."""

import os
import pathlib
import re
import subprocess

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
BIELA = ROOT / os.environ.get("BIELA", "bin/biela")
ROD = (ROOT / "input" / "slider_crank_elastic.nml").read_text(encoding="utf-8")


def check(folder, transient):
    """Standard output of `--check` for the slider-crank with another &transient group."""
    deck = folder / "rod.nml"
    deck.write_text(re.sub(r"&transient[^/]*/", f"&transient t_end=0.01 {transient} /", ROD), encoding="utf-8")
    done = subprocess.run([BIELA, "--check", deck.name], cwd=folder, capture_output=True, text=True, check=True)
    return done.stdout


def bound(text, method):
    """The safe bound that a check states [s]."""
    return float(re.search(rf"{method}: safe bound +(\S+) s", text).group(1))


@pytest.mark.parametrize(
    ("share", "words"), [(0.5, "0.5 of the safe bound: stable"), (1.25, "1.25 of the safe bound: above that bound")]
)
@pytest.mark.parametrize("method", ["rk4", "dopri5"])
def test_a_fixed_step_is_compared_with_the_safe_bound(tmp_path, method, share, words):
    step = share * bound(check(tmp_path, "method='rk4' step=1e-6"), method)
    text = check(tmp_path, f"method='{method}' step={step:.6e} output_step={step:.6e}")
    assert f"this deck: {method} with step=" in text
    assert words in text.splitlines()[-1]


def test_nothing_limits_the_step_of_a_body_without_vibrations(tmp_path):
    deck = tmp_path / "free.nml"
    deck.write_text("&body name='r' kind='rigid' mass=1.0 inertia=1.0 /\n&transient t_end=1.0 method='rk4' step=0.1 /\n")
    done = subprocess.run([BIELA, "--check", deck.name], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert "this deck: rk4: nothing limits its steps but accuracy" in done.stdout


@pytest.mark.parametrize(
    ("transient", "words"),
    [
        ("method='dopri5' tolerance=1e-8", "dopri5 with tolerance=1e-8: the error control keeps its steps"),
        ("method='generalized_alpha' step=1e-4", "generalized_alpha, stable with any step"),
    ],
)
def test_other_methods_say_what_sets_their_step(tmp_path, transient, words):
    text = check(tmp_path, transient)
    assert words in text.splitlines()[-1]
    assert text.endswith("\n")


SLIDER = "&joint name='r' type='slider' body_a='b' node_a=-1 /"


@pytest.mark.parametrize(("method", "more"), [("rk4", ""), ("rk4", SLIDER), ("dopri5", "")])
def test_a_lost_run_names_the_step_where_that_is_above_a_bound(run_deck, method, more):
    """Joints that open, or masses that a huge deflection made uneven, are what such a step does."""
    deck = f"""&scene gravity=0,-9.81 /
&material name='m' density=2000 young=2e9 /
&section name='s' shape='rectangle' width=0.02 height=0.01 /
&body name='a' kind='beam' length=0.3 elements=2 material='m' section='s' angle=-0.4 /
&body name='b' kind='beam' length=0.3 elements=2 material='m' section='s' position={{0.3*cos(0.4)}},{{-0.3*sin(0.4)}} /
&joint name='p' type='revolute' body_a='a' node_a=1 /
&joint name='q' type='revolute' body_a='b' node_a=1 body_b='a' node_b=-1 /
{more}
&transient t_end=0.1 method='{method}' step=3e-4 accept_unstable=.true. output_step=3e-3 /
"""
    told = run_deck(deck, expect=1).stderr
    assert "the solution diverged at t = " in told
    assert "the step is too large for stability" in told
    assert "cannot be kept closed" not in told
