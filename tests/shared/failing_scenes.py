"""Scenes whose runs cannot go on, and what such a run must leave."""

import re

import numpy as np
import pytest

CRANK = """&material name='m' density=1600.0 young=2.1e10 ghm_alpha=0.5 ghm_zeta=1.0 ghm_omega=5000.0 /
&section name='s' area=1.6129e-4 inertia=8.6576e-9 /
&body name='rod' kind='beam' length=0.3492 elements=2 material='m' section='s' position=0.1524,0.0 /
&joint name='crank' type='distance' body_a='rod' node_a=1 point_b=0.0,0.0 length=0.1524 /
&joint name='slider' type='slider' body_a='rod' node_a=-1 /
&force name='torque' type='torque_about' body='rod' node=1 centre=0.0,0.0 moment=10.0 /
&sensor name='pin' quantity='position' body='rod' node=1 /
"""
PULL = """&body name='a' kind='rigid' mass=1.0 inertia=0.1 angle=-1.0 /
&body name='b' kind='rigid' mass=1.0 inertia=0.1 position=5.0,0.0 angular_velocity=1.0 /
&joint name='o' type='revolute' body_a='a' /
&joint name='elsewhere' type='revolute' body_a='b' point_b=5.0,0.0 /
&history name='h' kind='ramp' start_value=0.5 end_value=1.5 start=0.0 finish=0.1 /
&drive name='pull' type='position' body_a='a' point_a=1.0,0.0 history='h' /
&sensor name='a' quantity='angle' body='a' /
"""


def failed(run_deck, text):
    """Run a deck that must fail with status 1; check what is on the disk; return the run and the paragraph."""
    run = run_deck(text, "--quiet", expect=1)
    paragraph = next(line for line in run.stderr.splitlines() if "complete" in line)
    last = float(re.search(r"Results up to t = (\S+) s are complete", paragraph)[1])
    for name in ("history", "energy"):
        assert (run.folder / f"{name}.txt").read_bytes().endswith(b"\n")
        table = getattr(run, name)
        assert table.time[-1] == pytest.approx(last, rel=1e-6, abs=1e-12)
        assert np.isfinite(table.data).all()
    assert f"outcome: {paragraph.split(': ', 1)[1]}" in run.summary
    assert "NaN" not in run.stderr + run.summary
    assert "stay within what the model can tell" not in run.summary
    return run, paragraph


BEYOND = "&history name='h' kind='polynomial' coefficients=0,0,0,0,0,0,0,0,1.0e59 /\n"
BENT = CRANK + BEYOND + "&force name='f' type='force' body='rod' node=2 fy=1.0 history='h' /\n"
