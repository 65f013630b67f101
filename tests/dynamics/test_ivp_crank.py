"""The flexible slider-crank of the IVP test set against its converged history."""

from __future__ import annotations

import numpy as np
import pytest
from biela.histories import read
from conftest import REFERENCE, ROOT

COLUMNS = {"rod": "phi2", "slider.x": "x3", "mid.v": "wmid_local"}
# elements: largest errors of rod angle, slider and mid-rod deflection over their ranges, measured; a factor of 1.5 is allowed
MEASURED = {4: (5.7e-5, 1.2e-4, 3.6e-3), 8: (1.7e-5, 3.6e-5, 3.9e-4)}


@pytest.mark.parametrize("elements", sorted(MEASURED))
def test_errors_against_the_converged_history(run_deck, elements):
    text = (ROOT / "input" / "ivp_slider_crank.nml").read_text().replace("elements=8", f"elements={elements}")
    run = run_deck(text.replace("node=5", f"node={elements // 2 + 1}")).history
    reference = read(REFERENCE / "published" / "crank_conv_lin_ini2.csv")
    assert np.array_equal(np.round(run.time, 12), np.round(reference.time, 12))
    for (ours, theirs), measured in zip(COLUMNS.items(), MEASURED[elements]):
        error = np.abs(run[ours] - reference[theirs]).max() / np.ptp(reference[theirs])
        assert error < 1.5 * measured, f"{ours}: {error:.2e}"


def test_end_values(run_deck):
    run = run_deck((ROOT / "input" / "ivp_slider_crank.nml").read_text()).history
    assert run["rod"][-1] == pytest.approx(-0.33119254, abs=5e-6)
    assert run["slider.x"][-1] == pytest.approx(0.16971977, abs=5e-6)
    assert run["mid.v"][-1] == pytest.approx(-1.42199e-4, abs=1e-6)
