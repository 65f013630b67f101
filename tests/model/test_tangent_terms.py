"""Each block of a body's tangent by itself: mass, damping and stiffness against differences of the residual, by name."""

import os
import subprocess

import pytest
from conftest import program
from linearised import DECKS, SENSOR

SUFFIX = "-debug" if "debug" in os.environ.get("PROBE", "") else ""
BENT = DECKS["beam_loads"].replace("reference='clamped'", "reference='clamped' stiffening=.true.")
STATES = {**DECKS, "bent frame with stiffening and terms": BENT}


@pytest.mark.parametrize("seed", [1, 7])
@pytest.mark.parametrize("name", STATES)
def test_every_block_is_the_derivative_of_the_residual(name, seed, tmp_path):
    deck = tmp_path / "deck.nml"
    deck.write_text(SENSOR + STATES[name])
    path = program("TERMS", f"bin/terms{SUFFIX}")
    out = subprocess.run([path, str(deck), str(seed)], check=True, capture_output=True, text=True).stdout
    blocks = [(line.rsplit(" ", 1)[0].strip(), float(line.rsplit(" ", 1)[1])) for line in out.splitlines()]
    wrong = {block: error for block, error in blocks if not error < 1e-7}
    assert blocks
    assert not wrong, wrong
