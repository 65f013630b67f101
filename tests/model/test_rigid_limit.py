"""The rigid twin of the slider-crank: its energy integral, and the limit of a very stiff elastic rod."""

import numpy as np
import pytest
from biela.compare import differences
from conftest import REFERENCE
from oracle_parts import read_deck

CRANK, ROD = 0.1524, 0.3492
MASS = 1600.0 * 1.6129e-4 * ROD
ON_CRANK = "type='torque_about' node=1 centre=0.0,0.0 moment=10.0"


def slider_crank(young=2.1e10, flexible=True, moment=ON_CRANK, extra="", step=1e-6, t_end=0.02):
    """Return the deck of the paper's slider-crank."""
    return f"""&material name='m' density=1600.0 young={young!r} /
&section name='s' area=1.6129e-4 inertia=8.6576e-9 /
&body name='rod' kind='beam' length={ROD} elements=2 material='m' section='s' position={CRANK},0.0
  flexible=.{str(flexible).lower()}. /
&joint name='crank' type='distance' body_a='rod' node_a=1 point_b=0.0,0.0 length={CRANK} /
&joint name='slider' type='slider' body_a='rod' node_a=-1 direction=0.0 /
&force name='torque' body='rod' {moment} /
{extra}
&sensor name='pin' quantity='position' body='rod' node=1 /
&sensor name='tip' quantity='position' body='rod' node=-1 /
&sensor name='rod' quantity='angle' body='rod' /
&sensor name='rate' quantity='angular_velocity' body='rod' /
&sensor name='v' quantity='velocity' body='rod' node=1 /
&sensor name='link' quantity='reaction' joint='crank' /
&transient t_end={t_end} method='rk4' step={step} output_step=1.0e-4 /
"""


def inertia(phi, lump=0.0):
    """Return I(phi) [kg m^2] of massless crank, uniform rod and slider mass: 2 T / phi'^2."""
    psi = -np.arcsin(CRANK * np.sin(phi) / ROD)
    slope = -CRANK * np.cos(phi) / (ROD * np.cos(psi))  # d psi / d phi
    start = CRANK * np.array([-np.sin(phi), np.cos(phi)])
    end = start + ROD * slope * np.array([-np.sin(psi), np.cos(psi)])
    rod = MASS / 3 * (start @ start + start @ end + end @ end)  # a linear velocity field
    return rod + lump * (end @ end)


@pytest.mark.parametrize("lump", [0.0, 0.3])
def test_energy_integral_torque_on_crank(lump, run_deck):
    """1/2 I(phi) phi'^2 = M phi along more than a turn."""
    extra = f"&lump body='rod' node=-1 mass={lump} /" if lump else ""
    history = run_deck(slider_crank(flexible=False, extra=extra, step=1e-5, t_end=0.08)).history
    phi = np.unwrap(np.arctan2(history["pin.y"], history["pin.x"]))
    rate = (history["pin.x"] * history["v.y"] - history["pin.y"] * history["v.x"]) / CRANK**2
    kinetic = 0.5 * np.array([inertia(angle, lump) for angle in phi]) * rate**2
    assert phi[-1] > 2 * np.pi
    np.testing.assert_allclose(kinetic, 10.0 * phi, rtol=0, atol=1e-8 * 10.0 * phi[-1])


def test_energy_integral_torque_on_rod(run_deck):
    """A torque on the rod's frame works on the rod's angle psi: 1/2 I phi'^2 = M (psi - psi_0)."""
    history = run_deck(slider_crank(flexible=False, moment="type='torque' node=0 moment=10.0")).history
    phi = np.unwrap(np.arctan2(history["pin.y"], history["pin.x"]))
    rate = (history["pin.x"] * history["v.y"] - history["pin.y"] * history["v.x"]) / CRANK**2
    kinetic = 0.5 * np.array([inertia(angle) for angle in phi]) * rate**2
    work = 10.0 * (history["rod"] - history["rod"][0])
    assert np.ptp(history["rod"]) > 0.3
    np.testing.assert_allclose(kinetic, work, rtol=0, atol=1e-8 * np.abs(work).max())


def test_stiff_rod_moves_as_the_rigid_one(run_deck):
    """E raised ten-thousandfold, step below 3.9e-7 s: all motions agree with the rigid run to 1e-3 of range."""
    rigid = run_deck(slider_crank(flexible=False), name="rigid").history
    stiff = run_deck(slider_crank(young=2.1e14, step=3.8e-7), name="stiff").history
    found = {d.name: d.error for d in differences(stiff, rigid)}
    for column in ("pin.x", "pin.y", "tip.x", "rod", "rate", "v.x", "v.y"):
        assert found[column] < 1e-3, column
    soft = run_deck(slider_crank(), name="soft").history
    assert max(d.error for d in differences(soft, rigid, columns=["rate"])) > 1e-3


def test_same_data_as_the_reference_scene():
    """The deck of this module is the reference scene's: same rod, same torque."""
    deck = read_deck(REFERENCE / "vrl_elastic" / "deck.nml")
    assert deck["body"][0]["length"] == ROD
    assert deck["force"][0]["moment"] == 10.0
    assert abs(MASS - 0.09012) < 1e-5
