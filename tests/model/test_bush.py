"""A linear spring without length between places that coincide, a bush: it holds in every direction, in every analysis."""

import re

import numpy as np
import pytest
from biela.histories import read

MASS, STIFFNESS = 2.0, 100.0
DECK = f"""&scene title='bush' gravity={{gravity}} /
&body name='p' kind='rigid' mass={MASS} inertia=0.05 position=3.0,4.0 /
&spring name='k' type='linear' body_a='p' point_b=3.0,4.0 stiffness={STIFFNESS} {{more}} /
&spring name='t' type='torsional' body_a='p' stiffness=1.0 /
&force name='fx' type='force' body='p' fx=1.0 stage='transient' /
&force name='fy' type='force' body='p' fy=1.0 stage='transient' /
&sensor name='p' quantity='position' body='p' /
"""


@pytest.mark.parametrize("more", ["free_length=0.0", ""])
@pytest.mark.parametrize("gravity", ["0.0,0.0", "0.0,-9.81"])
def test_equilibrium_and_modes(more, gravity, run_deck):
    """It sags by its weight; both translations vibrate with the root of stiffness over mass, where its ends meet and elsewhere."""
    run = run_deck(DECK.format(gravity=gravity, more=more) + "&static /\n&modal modes=3 /\n")
    table, weight = read(run.folder, "static"), MASS * -float(gravity.split(",")[1])
    assert table["p.x"][-1] == pytest.approx(3.0, abs=1e-12)
    assert table["p.y"][-1] == pytest.approx(4.0 - weight / STIFFNESS, abs=1e-12)
    frequencies = np.sort(read(run.folder, "modes")["undamped_frequency"]) * 2 * np.pi
    assert frequencies == pytest.approx([np.sqrt(1.0 / 0.05), *2 * [np.sqrt(STIFFNESS / MASS)]], rel=1e-9)


@pytest.mark.parametrize("axis", ["x", "y"])
def test_response_with_damping_and_ghm(axis, run_deck):
    """Along either axis: 1 over k (1 + alpha (s2 + 2 zeta omega s)/(s2 + 2 zeta omega s + omega2)) + c s + m s2."""
    more = "free_length=0.0 damping=3.0 ghm_alpha=0.5 ghm_zeta=0.7 ghm_omega=20.0"
    deck = DECK.format(gravity="0.0,0.0", more=more) + f"&frequency_response from=0.2 to=5.0 points=5 input='f{axis}' /\n"
    table = read(run_deck(deck).folder, "frequency_response")
    s = 2j * np.pi * table["f"]
    term = s**2 + 2 * 0.7 * 20.0 * s
    exact = 1 / (STIFFNESS * (1 + 0.5 * term / (term + 400.0)) + 3.0 * s + MASS * s**2)
    assert np.max(np.abs(table[f"p.{axis}.re"] + 1j * table[f"p.{axis}.im"] - exact)) < 1e-12


def test_bounds_of_explicit_steps_know_it(run_deck):
    deck = DECK.format(gravity="0.0,0.0", more="free_length=0.0") + "&transient t_end=1.0 step=0.01 /\n"
    told = re.search(r"rk4: safe bound\s+(\S+) s .*current bound\s+(\S+) s", run_deck(deck, "--check").stdout)
    assert [float(x) for x in told.groups()] == pytest.approx(2 * [2.828427 / np.sqrt(STIFFNESS / MASS)], rel=1e-4)
