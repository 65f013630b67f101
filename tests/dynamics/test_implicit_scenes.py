"""The implicit method on scenes of many kinds: order 2 in every column towards an explicit run at 1e-10."""

import numpy as np
import pytest
from biela.compare import differences

MATERIALS = """&material name='polymer' density=1200.0 young=3.0e9 {ghm} /
&section name='s' shape='rectangle' width=0.02 height=0.01 /
"""


def crank(ghm="ghm_alpha=0.5 ghm_zeta=1.0 ghm_omega=5e3", rod="elements=2"):
    """Return a slider-crank with a massless crank and a torque on it."""
    return MATERIALS.format(ghm=ghm) + (
        f"&body name='rod' kind='beam' length=0.35 material='polymer' section='s' position=0.15,0.0 {rod} /\n"
        "&joint name='crank' type='distance' body_a='rod' node_a=1 length=0.15 /\n"
        "&joint name='slider' type='slider' body_a='rod' node_a=-1 /\n"
        "&force name='torque' type='torque_about' body='rod' node=1 centre=0.0,0.0 moment=2.0 /\n"
        "&sensor name='pin' quantity='position' body='rod' node=1 /\n"
        "&sensor name='v' quantity='velocity' body='rod' node=1 /\n"
        "&sensor name='link' quantity='reaction' joint='crank' /\n"
    )


def pendulum(extra="", last=1.0):
    """Return three rigid links from horizontal, the last one of another mass."""
    deck = "&scene gravity=0.0,-9.81 /\n"
    for k in range(3):
        mass = last if k == 2 else 1.0
        deck += f"&body name='l{k}' kind='rigid' mass={mass} inertia={mass / 12} com=0.5,0.0 position={k}.0,0.0 /\n"
        hold = f"body_b='l{k - 1}' point_b=1.0,0.0" if k else ""
        deck += f"&joint name='j{k}' type='revolute' body_a='l{k}' {hold} /\n"
    deck += "&sensor name='tip' quantity='position' body='l2' point=1.0,0.0 /\n"
    return deck + "&sensor name='r' quantity='reaction' joint='j0' /\n" + extra


WELDED = MATERIALS.format(ghm="ghm_alpha=0.5 ghm_zeta=1.0 ghm_omega=5e3") + (
    "&scene gravity=0.0,-9.81 /\n"
    "&body name='a' kind='beam' length=0.5 elements=2 material='polymer' section='s' /\n"
    "&body name='b' kind='beam' length=0.5 elements=2 material='polymer' section='s' position=0.5,0.0 /\n"
    "&joint name='g' type='revolute' body_a='a' node_a=1 /\n"
    "&joint name='w' type='weld' body_a='b' node_a=1 body_b='a' node_b=-1 /\n"
    "&sensor name='tip' quantity='position' body='b' node=-1 /\n"
    "&sensor name='w' quantity='reaction' joint='w' /\n"
)
SLIDING = (
    "&scene gravity=0.0,-9.81 /\n"
    "&body name='a' kind='rigid' mass=1.0 inertia=0.1 angular_velocity=5.0 /\n"
    "&body name='b' kind='rigid' mass=0.5 inertia=0.02 position=0.5,0.0 /\n"
    "&joint name='g' type='revolute' body_a='a' /\n"
    "&joint name='s' type='prismatic' body_a='b' body_b='a' /\n"
    "&spring name='k' type='linear' body_a='b' body_b='a' stiffness=300.0 damping=0.5 /\n"
    "&sensor name='b' quantity='position' body='b' /\n"
    "&sensor name='s' quantity='reaction' joint='s' /\n"
)
TORSION = (
    "&spring name='s' type='torsional' body_a='l1' body_b='l0' stiffness={} damping=0.1 "
    "ghm_alpha=1.0,0.3 ghm_zeta=2.0,0.7 ghm_omega=100.0,1000.0 /\n"
)
SCENES = {
    "term of damping ratio 1e-3": (crank("ghm_alpha=0.5 ghm_zeta=1e-3 ghm_omega=5e3"), 5e-3, 1e-6),
    "term of damping ratio 1e3": (crank("ghm_alpha=0.5 ghm_zeta=1e3 ghm_omega=5e3"), 2.5e-3, 1e-6),
    "pole of 1e6 rad/s": (crank("ghm_alpha=0.5 ghm_zeta=1.0 ghm_omega=1e6"), 1e-3, 1e-6),
    "rayleigh": (crank("rayleigh_mass=5.0 rayleigh_stiffness=1e-5"), 5e-3, 1e-6),
    "modes, two terms": (crank("ghm_alpha=0.5,1.0 ghm_zeta=1.0,5.0 ghm_omega=5e3,1e3", "elements=6 modes=3"), 5e-3, 1e-6),
    "free modes": (crank(rod="elements=6 modes=3 reference='free'"), 5e-3, 1e-6),
    "clamped frame": (crank(rod="elements=2 reference='clamped'"), 5e-3, 1e-6),
    "stiffening": (crank(rod="elements=2 stiffening=.true."), 5e-3, 1e-6),
    "rigid, over dead centres": (crank(rod="elements=1 flexible=.false. angular_velocity=0.5"), 0.1, 4e-5),
    "light end": (pendulum(last=1e-6), 1.0, 5e-4),
    "viscoelastic joint": (pendulum(TORSION.format(100.0)), 1.0, 4e-4),
    "welded beams": (WELDED, 0.1, 2e-5),
    "prismatic joint": (SLIDING, 1.0, 5e-4),
}


@pytest.mark.parametrize("radius", [0.0, 0.99])
@pytest.mark.parametrize("scene", SCENES)
def test_order_two(scene, radius, run_deck):
    deck, t_end, step = SCENES[scene]
    rows = f"t_end={t_end} output_step={t_end / 20}"
    exact = run_deck(deck + f"&transient method='dopri5' tolerance=1e-10 {rows} /\n", name="exact").history
    errors = []
    for h in (step, step / 2):
        text = f"&transient method='generalized_alpha' step={h} spectral_radius={radius} {rows} /\n"
        run = run_deck(deck + text, name=f"h{h}")
        assert run.transient["rejected"] == 0
        errors.append({d.name: d.error for d in differences(run.history, exact)})
    for name, error in errors[0].items():
        assert error < 1e-9 or np.log2(error / errors[1][name]) > 1.8, (name, error, errors[1][name])
        assert errors[1][name] < 3e-2
