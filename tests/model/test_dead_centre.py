"""A slider-crank driven through its slider into the dead centre and held there.

The crank comes to rest with unbounded accelerations, in a position where its joints and the drive are dependent.
"""

import numpy as np
import pytest

CRANK, ROD = 0.2, 0.5
FINISH = 0.3  # of the drive's motion [s]


def deck(gravity, words):
    """Return the mechanism, its crank 1 rad before the dead centre at t = 0."""
    y = CRANK * np.sin(1.0)
    start = CRANK * np.cos(1.0) + np.sqrt(ROD**2 - y**2)
    return f"""&scene gravity=0.0,{gravity} /
&body name='crank' kind='rigid' mass=1.0 inertia=0.01 com={CRANK / 2},0.0 angle=1.0 /
&body name='rod' kind='rigid' mass=1.0 inertia=0.05 com={ROD / 2},0.0
  position={CRANK * np.cos(1.0)},{y} angle={-np.arcsin(y / ROD)} /
&body name='slider' kind='rigid' mass=1.0 inertia=0.01 position={start},0.0 /
&joint name='a' type='revolute' body_a='crank' /
&joint name='b' type='revolute' body_a='rod' body_b='crank' point_b={CRANK},0.0 /
&joint name='c' type='revolute' body_a='slider' body_b='rod' point_b={ROD},0.0 /
&joint name='way' type='prismatic' body_a='slider' /
&history name='h' kind='ramp' start_value={start} end_value={CRANK + ROD} start=0.0 finish={FINISH} /
&drive name='d' type='position' body_a='slider' direction=0.0 history='h' /
&sensor name='crank' quantity='angle' body='crank' /
&sensor name='rate' quantity='angular_velocity' body='crank' /
&sensor name='slider' quantity='position' body='slider' /
&transient t_end=1.0 {words} output_step=1e-2 /
"""


@pytest.mark.parametrize("gravity", [0.0, -9.81])
@pytest.mark.parametrize("words", ["method='rk4' step=1e-3", "method='dopri5' tolerance=1e-4", "method='dopri5' tolerance=1e-8"])
def test_the_crank_rests_in_the_dead_centre(run_deck, gravity, words):
    run = run_deck(deck(gravity, words))
    x = run.history["slider.x"]
    angle = np.arccos(np.minimum((x**2 + CRANK**2 - ROD**2) / (2 * x * CRANK), 1.0))
    moving = run.history.time < FINISH - 1e-9
    np.testing.assert_allclose(run.history["crank"][moving], angle[moving], rtol=0.0, atol=1e-9)
    assert np.all(np.abs(run.history["crank"][~moving]) < 1e-5)  # a double root: half the digits
    assert np.all(run.history["rate"][~moving] == 0.0)
    assert run.transient["evaluations"] < 20_000
