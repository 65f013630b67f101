"""A beam and a frame in nodal coordinates or in modes, under loads that reach all of them."""

HEAD = """&scene title='modes' gravity=1.0,-9.81 /
&material name='elastic' density=1600.0 young=2.0e9 /
&material name='one' density=1200.0 young=1.0e9 ghm_alpha=0.5 ghm_zeta=1.5 ghm_omega=400.0 /
&material name='two' density=1900.0 young=8.0e8 ghm_alpha=0.4,1.6 ghm_zeta=0.4,2.5 ghm_omega=60.0,700.0 rayleigh_mass=0.8 /
&section name='s' shape='rectangle' width=0.02 height=0.01 /
&section name='t' shape='rectangle' width=0.02 height=0.02 /
"""
BEAM = "&body name='b' kind='beam' length=0.8 elements={n} material='elastic' section='s' angle=-0.3 {more} /\n"
FRAME = """&body name='b' kind='frame' node_x=0.0,0.3,0.6,0.5 node_y=0.0,0.0,0.2,0.4 element_nodes=1,2,2,3,3,4 material='one'
  section='s','t','s' angle=-0.3 {more} /
"""
LUMPS = "&lump body='b' node=2 mass=0.05 inertia=1.0e-4 /\n&lump body='b' node=-1 mass=0.03 inertia=2.0e-5 /\n"
LOADS = """&history name='rise' kind='ramp' start_value=0.0 end_value=1.0 start=0.0 finish=0.02 /
&force name='p' type='force' body='b' node=-1 fx=0.2 fy=0.4 axes='section' history='rise' /
&force name='q' type='torque' body='b' node=2 moment=0.05 /
&spring name='k' type='torsional' body_a='b' node_a=1 body_b='ground' stiffness=0.5 damping=0.001 ghm_alpha=2.0 ghm_zeta=1.0
  ghm_omega=80.0 /
"""
PIN = "&joint name='o' type='revolute' body_a='b' node_a=1 /\n"
SENSORS = """&sensor name='tip' quantity='position' body='b' node=-1 /
&sensor name='u' quantity='deflection' body='b' node=2 /
&sensor name='a' quantity='angle' body='b' node=2 /
&sensor name='acc' quantity='acceleration' body='b' node=-1 /
&sensor name='i' quantity='internal' body='b' element=2 /
&sensor name='r' quantity='reaction' joint='o' /
&sensor name='k' quantity='spring' spring='k' /
"""
TRANSIENT = "&transient t_end=0.015 method='rk4' step={step} output_step=2.0e-4 /\n"
SCENES = {  # body, its options, number of elastic coordinates
    "pinned": (BEAM, "reference='pinned'", 9),
    "clamped": (BEAM, "reference='clamped'", 9),
    "no axial deformation": (BEAM, "reference='pinned' axial=.false.", 6),
    "own reference": (BEAM, "reference_node=2,2,-1 reference_dof='u','v','v'", 9),
    "viscoelastic": (BEAM, "material='two'", 9),
    "partly viscoelastic": (BEAM, "element_material='one','elastic','two'", 9),
    "two elements of each": (BEAM.replace("{n}", "4"), "element_material='one','two','one','two' reference='clamped'", 12),
    "frame": (FRAME, "reference='clamped'", 9),
    "partly viscoelastic frame": (FRAME, "element_material='two','elastic','one'", 9),
}


def text(body: str, more: str, modes: int, n: int = 3) -> str:
    """Return a scene with a body in modes (0: nodal)."""
    if "material='" in more and "element_material" not in more:
        body = body.replace(" material='elastic'", "")
    return HEAD + body.format(n=n, more=f"{more} modes={modes}") + LUMPS
