"""Small scenes of all terms, and what bin/probe tells of the state and of the linearised matrices of a deck."""

import os
import subprocess

import numpy as np

PROBE = os.environ.get("PROBE", "bin/probe")
MATERIALS = """
&material name='m' density=1500.0 young=3.0e9 ghm_alpha=0.5,0.3 ghm_zeta=1.2,0.6 ghm_omega=900.0,4000.0
  rayleigh_mass=2.0 rayleigh_stiffness=1.0e-5 /
&material name='e' density=2000.0 young=5.0e9 /
&section name='s' shape='rectangle' width=0.02 height=0.01 /
"""
LAYERS = """&material name='t' density=1000.0 shear_modulus=4.0e6 ghm_alpha=1.5 ghm_zeta=1.0 ghm_omega=1500.0 /
&section name='clad' layers='e','t','m' thickness=0.01,0.002,0.004 width=0.02 /
&section name='even' layers='e','t','m','t','e' thickness=0.003,0.002,0.01,0.002,0.003 width=0.02 base=3 cores=2,4 /
"""
BEAM = "&body name='b' kind='beam' length=0.6 elements=2 material='m' section='s' position=0.1,0.2 angle=0.7 {} /\n"
FRAME = """&body name='f' kind='frame' node_x=0.0,0.3,0.35,0.1 node_y=0.0,0.0,0.25,0.3 element_nodes=1,2,2,3,3,4,4,1
  material='e' section='s' element_material='m','e','m','e' reference='clamped' position=-0.2,0.1 angle=-0.4 /
&lump body='f' node=3 mass=0.3 inertia=2.0e-3 /
"""
RIGID = "&body name='r' kind='rigid' mass=0.8 inertia=0.01 com=0.1,-0.05 position=0.5,0.4 angle=1.1 /\n"
SPRINGS = """&spring name='k1' type='linear' body_a='b' node_a=2 body_b='f' node_b=3 stiffness=300.0 damping=4.0 free_length=0.2
  ghm_alpha=0.7 ghm_zeta=0.8 ghm_omega=80.0 /
&spring name='k2' type='torsional' body_a='b' node_a=3 body_b='f' node_b=2 stiffness=20.0 damping=0.3 free_angle=0.1 /
"""
LOADS = """&force name='f1' type='force' body='b' node=2 fx=30.0 fy=-20.0 axes='section' /
&force name='f2' type='force' body='b' node=3 fx=-10.0 fy=15.0 axes='body' /
&force name='f3' type='force' body='f' node=2 fx=5.0 fy=7.0 /
&force name='f4' type='torque_about' body='b' node=1 centre=-0.3,0.1 moment=4.0 /
&force name='f5' type='torque' body='f' node=3 moment=2.0 /
"""
STOPS = """&stop name='s1' type='position' body_a='r' point_a=0.1,0.1 body_b='b' node_b=2 direction=0.3 upper=-0.5
  stiffness=4.0e3 damping=0.05 /
&stop name='s2' type='clearance' body_a='r' point_a=-0.2,0.1 body_b='f' node_b=3 gap=0.01 stiffness=2.0e3 exponent=2.0
  damping=0.03 /
&stop name='s3' type='rotation' body_a='b' node_a=3 body_b='f' node_b=2 lower=2.0 stiffness=30.0 exponent=1.0 damping=0.02 /
&stop name='s4' type='rotation' body_a='r' body_b='f' node_b=3 lower=-2.0 upper=0.3 stiffness=40.0 exponent=3.0 /
&stop name='open' type='position' body_a='r' body_b='f' node_b=3 direction=0.3 lower=-9.0 upper=9.0 stiffness=1.0e6 /
"""
# rollers and faces on circles, laws and points, in penetrations as no run has them; joints beside
PROFILES = """&history name='up' kind='ramp' start_value=0.0 end_value=0.02 start=0.0 finish={pi} /
&history name='down' kind='cycloid' start_value=0.02 end_value=0.0 start=0.0 finish={pi} /
&history name='lift' kind='sequence' histories='up','down' durations={pi},{pi} periodic=.true. /
&history name='swing' kind='sine' offset=0.3 amplitude=0.1 frequency={1/(2*pi)} /
&profile name='circle' kind='circle' radius=0.05 /
&profile name='bowl' kind='circle' radius=0.2 hollow=.true. /
&profile name='disc' kind='law' history='lift' base_radius=0.05 radius=0.02 offset=0.015 clockwise=.true. /
&profile name='flat' kind='law' history='lift' base_radius=0.06 follower='flat' /
&profile name='arm' kind='law' history='swing' pivot=-0.1,0.0 arm=0.12 radius=0.01 /
&profile name='egg' kind='points' x=0.06,0.04,0.0,-0.05,-0.06,-0.03,0.0,0.04 y=0.0,0.04,0.05,0.035,0.0,-0.03,-0.04,-0.03 /
&profile name='rail' kind='points' closed=.false. x=-0.2,-0.1,0.0,0.1,0.2 y=-0.02,-0.004,0.0,-0.005,-0.025 /
"""
FOLLOWER = "type='profile' body_a='{}' node_a={} body_b='{}' {} profile='{}' {} /\n"
TOUCHING = [  # follower, profile, kind of follower
    ("b", 2, "r", "point_b=0.02,0.01", "circle", "radius=0.16"),
    ("b", 2, "r", "point_b=0.02,0.01", "disc", "radius=0.17"),
    ("f", 2, "b", "node_b=2", "egg", "radius=0.5"),
    ("b", 3, "r", "", "arm", "radius=0.2"),
    ("f", 3, "b", "node_b=2", "egg", "face=1.5"),
    ("b", 2, "r", "", "flat", "face=1.2"),
    ("b", 3, "r", "", "bowl", "radius=0.16"),
    ("f", 3, "r", "", "rail", "radius=0.5"),
]
PAIRS = PROFILES + "".join(
    f"&stop name='p{k}' stiffness=3.0e3 exponent=2.0 damping=0.05 {FOLLOWER.format(*words)}" for k, words in enumerate(TOUCHING)
)
SLOTS = PROFILES + "".join(
    f"&joint name='j{k}' {FOLLOWER.format(*words)}"
    for k, words in enumerate(
        [
            ("b", 2, "r", "point_b=0.02,0.01", "disc", "radius=0.05"),
            ("f", 3, "b", "node_b=2", "egg", "face=-0.32"),
            ("b", 3, "r", "", "rail", ""),
            ("b", 1, "f", "node_b=3", "flat", "face=2.49"),
        ]
    )
)
SENSOR = "&scene title='t' gravity=1.0,-9.81 /\n"
DECKS = {
    "free_beam": MATERIALS + BEAM.format(""),
    "beam_loads": MATERIALS + BEAM.format("") + FRAME + SPRINGS + LOADS,
    "stiffening": MATERIALS + BEAM.format("stiffening=.true. reference='clamped'"),
    "no_axial": MATERIALS + BEAM.format("axial=.false."),
    "modal": MATERIALS + BEAM.format("modes=3") + FRAME.replace("reference='clamped'", "reference='free' modes=4") + SPRINGS,
    "stops": MATERIALS + BEAM.format("") + FRAME.replace("reference='clamped'", "reference='free' modes=4") + RIGID + STOPS,
    "joints": MATERIALS
    + BEAM.format("")
    + FRAME
    + RIGID
    + """&joint name='j1' type='slider' body_a='r' point_a=0.1,0.1 body_b='b' node_b=2 direction=0.3 /
&joint name='j2' type='distance' body_a='r' point_a=-0.2,0.1 body_b='f' node_b=3 /
&joint name='j3' type='revolute' body_a='b' node_a=1 point_b=0.1,0.2 /
&joint name='j4' type='gear' body_a='r' body_b='b' node_b=3 body_c='f' node_c=2 ratio=-3.5 /
""",
    "pairs": MATERIALS + BEAM.format("") + FRAME.replace("reference='clamped'", "reference='free' modes=4") + RIGID + PAIRS,
    "joints on profiles": MATERIALS + BEAM.format("") + FRAME + RIGID + SLOTS,
    "layers": MATERIALS
    + LAYERS
    + BEAM.format("stiffening=.true. reference='clamped'").replace("material='m' section='s'", "section='clad'")
    + FRAME.replace("  material='e' section='s' element_material='m','e','m','e'", "  section='even'"),
    "shear": MATERIALS.replace("height=0.01", "height=0.08 shear=.true.") + BEAM.format("stiffening=.true.") + FRAME,
    "welds": MATERIALS
    + BEAM.format("")
    + FRAME
    + RIGID
    + """&joint name='j1' type='weld' body_a='r' point_a=0.1,0.1 body_b='b' node_b=3 /
&joint name='j2' type='prismatic' body_a='f' node_a=2 body_b='b' node_b=2 direction=0.3 /
""",
}


def layout(deck):
    text = subprocess.run([PROBE, "layout", deck], check=True, capture_output=True, text=True).stdout.splitlines()
    numbers = {line.split()[0]: int(line.split()[1]) for line in text[:3]}
    bodies = [int(line.split()[2]) - 1 for line in text if line.startswith("body ")]
    return numbers["coordinates"], numbers["dissipative"], numbers["rows"], bodies


def evaluate(deck, states, word="evaluate"):
    text = "\n".join(" ".join(f"{x:.17g}" for x in row) for row in states) + "\n"
    out = subprocess.run([PROBE, word, deck], input=text, check=True, capture_output=True, text=True).stdout
    results, now = [], []
    for line in out.splitlines():
        if line == "end":
            results.append(now)
            now = []
        else:
            name, *values = line.split()
            now.append((name, np.array([float(x) for x in values])))
    return results
