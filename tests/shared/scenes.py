"""Small scenes for the tests that set the solver beside the oracle: every kind of body, joint, force, spring and drive."""

MATERIALS = """&scene title='twin' gravity=0.7,-9.81 /
&material name='elastic' density=1600.0 young=2.1e9 /
&material name='one' density=1200.0 young=3.0e8 ghm_alpha=0.5 ghm_zeta=1.5 ghm_omega=900.0 /
&material name='two' density=1900.0 young=8.0e8 ghm_alpha=0.4,1.6 ghm_zeta=0.4,2.5 ghm_omega=300.0,7000.0 ghm_frequency_scale=1.3 /
&material name='three' density=1100.0 young=5.0e8 ghm_alpha=0.3,0.4,0.8 ghm_zeta=2.0,1.0,3.0 ghm_omega=300.0,1200.0,6000.0
  rayleigh_mass=1.7 /
&material name='damped' density=2700.0 young=7.0e8 rayleigh_mass=0.9 rayleigh_stiffness=2.0e-5 /
&section name='strip' shape='rectangle' width=0.02 height=0.012 /
&section name='rod' shape='circle' diameter=0.015 /
&section name='pipe' shape='tube' outer=0.03 inner=0.024 /
&section name='plain' area=1.5e-4 inertia=9.0e-9 /
"""
LAYERS = """&material name='tape' density=1000.0 young=1.2e7 poisson=0.49 ghm_alpha=1.5,0.8 ghm_zeta=1.0,0.5 ghm_omega=1500.0,400.0
  rayleigh_stiffness=1.0e-5 /
&section name='thick' shape='rectangle' width=0.02 height=0.05 shear=.true. /
&section name='thick_pipe' shape='tube' outer=0.05 inner=0.03 shear=.true. /
&section name='thick_plain' area=1.5e-4 inertia=9.0e-8 shear=.true. shear_factor=0.7 /
&section name='bonded' layers='elastic','one' thickness=0.004,0.006 width=0.02 /
&section name='bonded_thick' layers='two','elastic','damped' thickness=0.004,0.016,0.01 width=0.02 base=2 shear=.true. /
&section name='bare' layers='elastic' thickness=0.01 width=0.02 /
&section name='clad' layers='elastic','tape','damped' thickness=0.01,0.002,0.004 width=0.02 /
&section name='whole' layers='elastic','tape','two' thickness=0.01,0.003,0.004 width=0.02 core_stretch=.true. /
&section name='sandwich' layers='one','tape','elastic','tape','damped' thickness=0.003,0.002,0.01,0.001,0.004 width=0.02
  base=3 cores=2,4 /
&section name='even' layers='one','tape','elastic','tape','one' thickness=0.003,0.002,0.01,0.002,0.003 width=0.02
  base=3 cores=2,4 /
"""
TRANSIENT = "&transient t_end=1.0e-3 method='rk4' step=1.0e-5 /\n"


def beam(name="b", material="elastic", section="strip", elements=2, length=0.4, rest="position=0.1,0.2 angle=0.6"):
    """Return a &body group of a straight beam."""
    return (
        f"&body name='{name}' kind='beam' length={length} elements={elements} material='{material}' section='{section}' {rest} /\n"
    )


def layered(sections, elements=2, length=0.4, rest=""):
    """Return a &body group of a straight beam of layers: one section, or one for each element."""
    key = "element_section" if "," in sections else "section"
    elements = sections.count(",") + 1 if "," in sections else elements
    return f"&body name='b' kind='beam' length={length} elements={elements} {key}={sections} {rest} /\n"


def frame(name="f", rest="reference='clamped' position=-0.1,0.3 angle=-0.4", materials="'one','elastic','three','damped'"):
    """Return a &body group of a closed frame of four elements, mixed materials and sections."""
    return f"&body name='{name}' kind='frame' node_x=0.0,0.3,0.35,0.05 node_y=0.0,0.02,0.25,0.3 element_nodes=1,2,2,3,3,4,4,1\n" + (
        f"  material={materials} section='strip','rod','pipe','plain' {rest} /\n" if materials else f" section='even' {rest} /\n"
    )


def rigid(name="r", rest="position=-0.2,0.1 angle=1.1"):
    """Return a &body group of a rigid body."""
    return f"&body name='{name}' kind='rigid' mass=0.8 inertia=6.0e-3 com=0.07,-0.03 {rest} /\n"


LUMPS = """&lump body='b' node=2 mass=0.3 inertia=2.0e-3 /
&lump body='b' node=-1 mass=0.05 inertia=4.0e-4 /
"""
PUSHES = """&history name='wave' kind='sine' offset=0.5 amplitude=1.5 frequency=2.1 phase=0.3 /
&history name='rise' kind='ramp' start_value=0.2 end_value=1.4 start=0.1 finish=0.4 /
&history name='burst' kind='pulse' value=2.5 start=0.1 finish=0.3 /
&history name='curve' kind='table' time=0.0,0.1,0.25,0.3,0.45 value=1.0,-0.5,2.0,0.3,0.9 /
&force name='p1' type='force' body='b' node=2 fx=30.0 fy=-20.0 axes='section' history='wave' /
&force name='p2' type='force' body='b' node=-1 fx=-10.0 fy=15.0 axes='body' history='rise' /
&force name='p3' type='force' body='f' node=3 fx=5.0 fy=7.0 history='curve' /
&force name='p4' type='torque' body='b' node=0 moment=2.0 history='burst' /
&force name='p5' type='torque' body='f' node=4 moment=-1.5 /
&force name='p6' type='torque_about' body='b' node=2 centre=-0.3,0.1 moment=4.0 history='curve' /
&force name='p7' type='torque_about' body='r' point=0.1,0.1 centre=0.5,-0.1 moment=-3.0 /
&force name='p8' type='torque' body='r' moment=0.7 history='wave' /
&force name='p9' type='force' body='r' point=0.02,0.04 fx=3.0 fy=-2.0 axes='body' /
"""
SPRINGS = """&spring name='s1' type='linear' body_a='b' node_a=2 body_b='f' node_b=3 stiffness=300.0 damping=4.0 free_length=0.2 /
&spring name='s2' type='linear' body_a='r' point_a=0.1,0.0 point_b=0.3,-0.5 stiffness=500.0 ghm_alpha=0.7,0.2 ghm_zeta=0.8,2.0
  ghm_omega=80.0,300.0 /
&spring name='s3' type='torsional' body_a='b' node_a=-1 body_b='f' node_b=2 stiffness=20.0 damping=0.3 free_angle=0.1 /
&spring name='s4' type='torsional' body_a='f' body_b='r' stiffness=5.0 damping=0.02 ghm_alpha=3.0 ghm_zeta=2.0 ghm_omega=60.0 /
"""

BODIES = {
    "rigid": rigid(),
    "beam_pinned": beam(),
    "beam_clamped": beam(rest="reference='clamped' angle=2.0"),
    "beam_one_element": beam(elements=1, material="one"),
    "beam_one_term": beam(material="one", section="rod", elements=3),
    "beam_two_terms": beam(material="two", section="pipe"),
    "beam_three_terms": beam(material="three", section="plain"),
    "beam_mixed": beam(elements=4, rest="element_material='elastic','two','damped','one' reference='clamped'"),
    "beam_gap": beam(elements=3, rest="element_material='one','elastic','one' reference='clamped'"),
    "beam_rayleigh": beam(material="damped", rest="angle=-1.0") + LUMPS,
    "beam_elastic_twin": beam(material="three", rest="viscoelastic=.false."),
    "beam_stiff": beam(material="two", elements=3, rest="reference='clamped' stiffening=.true."),
    "beam_stiff_rayleigh": beam(material="damped", elements=2, rest="stiffening=.true. angle=0.3") + LUMPS,
    "beam_no_axial": beam(material="two", elements=3, rest="axial=.false. angle=0.3") + LUMPS,
    "beam_no_axial_clamped": beam(rest="axial=.false. reference='clamped'"),
    "beam_as_rigid": beam(material="one", rest="flexible=.false. position=0.3,0.1 angle=1.0") + LUMPS,
    "beam_own_reference": beam(rest="reference_node=2,2,1 reference_dof='u','v','v'", elements=3),
    "beam_thick": beam(material="two", section="thick", rest="angle=0.6") + LUMPS,
    "beam_thick_no_axial": beam(material="two", section="thick_pipe", elements=3, rest="axial=.false. angle=0.3"),
    "beam_thick_stiff": beam(material="three", section="thick_plain", rest="stiffening=.true. reference='clamped'") + LUMPS,
    "beam_bonded": layered("'bonded'", rest="position=0.1,0.2 angle=0.6") + LUMPS,
    "beam_bonded_stiff": layered("'bonded'", rest="reference='clamped' stiffening=.true."),
    "beam_bonded_thick": layered("'bonded_thick'", rest="reference='clamped' angle=1.0"),
    "beam_clad": layered("'clad'", elements=3, rest="reference='clamped' slip_held=1") + LUMPS,
    "beam_clad_stiff": layered("'bare','clad','whole','bare'", rest="stiffening=.true. angle=0.3") + LUMPS,
    "beam_sandwich": layered("'clad'", rest="angle=2.0").replace("'clad'", "'sandwich'"),
    "beam_clad_as_rigid": layered("'clad'", rest="flexible=.false. position=0.3,0.1 angle=1.0") + LUMPS,
    "frame_sandwich": frame(rest="reference='clamped' position=-0.1,0.3", materials=None),
    "beam_overheld": beam(rest="reference_node=1,1,-1,-1 reference_dof='u','v','v','u'", material="one"),
    "frame_closed": frame() + "&lump body='f' node=3 mass=0.3 inertia=2.0e-3 /\n",
    "frame_pinned": frame(rest="position=0.4,0.0", materials="'two'"),
    "frame_stiff": frame(rest="stiffening=.true. reference_node=2,3,2 reference_dof='u','v','v'"),
    "frame_held_twice_along_x": frame(rest="reference_node=2,3,2 reference_dof='u','u','v'"),
    "frame_in_a_line_out_of_order": "&body name='f' kind='frame' node_x=0.0,0.1,0.25,0.4 node_y=0.0,0.0,0.0,0.0\n"
    "  element_nodes=2,3,1,2,3,4 material='one' section='strip' position=0.1,0.2 angle=0.3 /\n",
    "frame_as_rigid": frame(rest="flexible=.false."),
    "all_loads": beam(material="one") + LUMPS + frame() + rigid() + PUSHES,
    "all_springs": beam(material="damped") + frame() + rigid() + SPRINGS,
    "default_springs": beam()
    + rigid()
    + "&spring name='s1' type='linear' body_a='b' node_a=2 body_b='r' point_b=0.1,0.2 stiffness=300.0 /\n"
    + "&spring name='s2' type='torsional' body_a='b' node_a=2 body_b='r' stiffness=20.0 damping=0.1 /\n",
}

FLEXIBLE = beam(material="one") + frame() + rigid()
JOINTS = {
    "revolute_ground": FLEXIBLE + "&joint name='j' type='revolute' body_a='b' node_a=2 point_b=0.3,0.4 /\n",
    "revolute_bodies": FLEXIBLE + "&joint name='j' type='revolute' body_a='f' node_a=3 body_b='b' node_b=-1 /\n",
    "weld_ground": FLEXIBLE + "&joint name='j' type='weld' body_a='b' node_a=-1 point_b=0.3,0.4 /\n",
    "weld_bodies": FLEXIBLE + "&joint name='j' type='weld' body_a='r' point_a=0.1,0.1 body_b='b' node_b=-1 /\n",
    "slider_ground": FLEXIBLE + "&joint name='j' type='slider' body_a='b' node_a=-1 point_b=0.2,0.1 direction=0.4 /\n",
    "slider_flexible": FLEXIBLE + "&joint name='j' type='slider' body_a='r' point_a=0.1,0.1 body_b='b' node_b=2 direction=0.3 /\n",
    "slider_flexible_both": FLEXIBLE + "&joint name='j' type='slider' body_a='f' node_a=3 body_b='b' node_b=2 direction=-0.7 /\n",
    "prismatic_ground": FLEXIBLE + "&joint name='j' type='prismatic' body_a='b' node_a=2 point_b=0.2,0.1 direction=1.4 /\n",
    "prismatic_rigid": FLEXIBLE + "&joint name='j' type='prismatic' body_a='f' node_a=2 body_b='r' point_b=0.1,0.1 /\n",
    "prismatic_flexible": FLEXIBLE + "&joint name='j' type='prismatic' body_a='f' node_a=2 body_b='b' node_b=-1 direction=2.0 /\n",
    "distance_ground": FLEXIBLE + "&joint name='j' type='distance' body_a='b' node_a=2 point_b=0.9,0.4 length=0.6 /\n",
    "distance_default": FLEXIBLE + "&joint name='j' type='distance' body_a='f' node_a=3 body_b='b' node_b=-1 /\n",
    "gear_frames": FLEXIBLE + "&joint name='j' type='gear' body_a='r' body_b='f' ratio=-2.5 /\n",
    "gear_carried": FLEXIBLE + "&joint name='j' type='gear' body_a='b' node_a=-1 body_b='r' body_c='f' node_c=3 ratio=3.0 /\n",
    "drive_frame": FLEXIBLE + "&history name='h' kind='polynomial' coefficients=0.6,2.0,-3.0,4.0 /\n"
    "&drive name='d' type='rotation' body_a='b' history='h' /\n",
    "drive_section": FLEXIBLE + "&history name='h' kind='sine' amplitude=0.3 frequency=1.5 phase=0.2 /\n"
    "&drive name='d' type='rotation' body_a='b' node_a=2 body_b='f' node_b=3 history='h' /\n",
    "drive_between_frames": FLEXIBLE + "&history name='h' kind='ramp' start_value=0.1 end_value=1.2 start=0.05 finish=0.45 /\n"
    "&drive name='d' type='rotation' body_a='r' body_b='f' history='h' /\n",
    "drive_rate": FLEXIBLE + "&history name='h' kind='cycloid' start_value=0.5 end_value=6.0 start=0.1 finish=0.4 /\n"
    "&drive name='d' type='rotation' body_a='r' body_b='b' history='h' rate=.true. /\n",
    "drive_rate_table": FLEXIBLE + "&history name='h' kind='table' time=0.0,0.1,0.25,0.3,0.6 value=1.0,-0.5,2.0,0.3,0.9 /\n"
    "&drive name='d' type='rotation' body_a='f' node_a=2 history='h' rate=.true. /\n",
    "drive_rate_sine": FLEXIBLE + "&history name='h' kind='sine' offset=1.0 amplitude=2.0 frequency=3.0 phase=0.4 /\n"
    "&drive name='d' type='position' body_a='b' node_a=2 direction=0.3 history='h' rate=.true. /\n",
    "drive_rate_ramp": FLEXIBLE + "&history name='h' kind='ramp' start_value=0.5 end_value=3.0 start=0.1 finish=0.4 /\n"
    "&drive name='d' type='position' body_a='b' node_a=2 body_b='r' point_b=0.1,0.0 direction=0.3 history='h' rate=.true. /\n",
    "drive_position": FLEXIBLE + "&history name='h' kind='cycloid' start_value=0.1 end_value=0.3 start=0.0 finish=0.5 /\n"
    "&drive name='d' type='position' body_a='f' node_a=3 body_b='b' node_b=2 direction=0.9 history='h' /\n",
    "drive_polynomial_rate": FLEXIBLE + "&history name='h' kind='polynomial' coefficients=150.0 /\n"
    "&drive name='d' type='rotation' body_a='r' history='h' rate=.true. /\n",
}

CHAIN = rigid(rest="position=0.0,0.0 angle=0.4") + beam(material="two", rest="position=0.2,0.1 angle=-0.3")
LOOPS = {
    "slider_crank": rigid(rest="angle=0.4")
    + beam(material="two", rest="position=0.18,0.08 angle=-0.2")
    + LUMPS
    + """&joint name='a' type='revolute' body_a='r' /
&joint name='b' type='revolute' body_a='b' node_a=1 body_b='r' point_b=0.2,0.0 /
&joint name='c' type='slider' body_a='b' node_a=-1 direction=0.0 /
&force name='t' type='torque' body='r' moment=3.0 /
""",
    "four_bar": rigid(rest="angle=1.2")
    + beam(material="three", rest="position=0.1,0.2 angle=0.2")
    + beam(name="c", material="damped", section="rod", length=0.3, rest="position=0.5,0.0 angle=1.7")
    + """&joint name='a' type='revolute' body_a='r' /
&joint name='b' type='revolute' body_a='b' node_a=1 body_b='r' point_b=0.2,0.0 /
&joint name='c' type='revolute' body_a='b' node_a=-1 body_b='c' node_b=-1 /
&joint name='d' type='revolute' body_a='c' node_a=1 point_b=0.5,0.0 /
&history name='h' kind='sine' offset=1.2 amplitude=0.5 frequency=1.0 /
&drive name='m' type='rotation' body_a='r' history='h' /
""",
    "welded_frames": frame(rest="reference='clamped'")
    + beam(rest="position=0.35,0.25 angle=0.4 reference='clamped'", material="one")
    + """&joint name='a' type='revolute' body_a='f' node_a=1 /
&joint name='b' type='weld' body_a='b' node_a=1 body_b='f' node_b=3 /
&joint name='c' type='slider' body_a='b' node_a=-1 point_b=0.7,0.3 direction=1.3 /
""",
    "moving_line": rigid(rest="angle=0.7")
    + beam(material="one", rest="position=0.5,0.0 angle=1.9", elements=3)
    + """&joint name='a' type='revolute' body_a='r' /
&joint name='b' type='revolute' body_a='b' node_a=1 point_b=0.5,0.0 /
&joint name='c' type='slider' body_a='r' point_a=0.3,0.0 body_b='b' node_b=3 direction=0.1 /
&force name='t' type='torque' body='r' moment=1.0 /
""",
    "star": rigid()
    + "".join(beam(name=f"b{k}", material="one", rest=f"reference='clamped' angle={1.3 * k}") for k in range(4))
    + "".join(f"&joint name='w{k}' type='weld' body_a='b{k}' node_a=1 body_b='r' point_b=0.0{k},0.01 /\n" for k in range(4))
    + "&joint name='hub' type='revolute' body_a='r' /\n",
    "redundant": rigid(rest="angle=0.7")
    + beam(material="one", rest="angle=0.7 reference='clamped'")
    + """&joint name='a' type='revolute' body_a='r' /
&joint name='b' type='weld' body_a='b' node_a=1 body_b='r' /
&joint name='c' type='revolute' body_a='b' node_a=1 /
&force name='t' type='torque' body='r' moment=1.0 /
""",
}

TIP_PUSH = "&force name='p' type='force' body='{}' node={} fx=3.0 fy=-7.0 axes='body' /\n"
MODAL = {
    "modal_pinned": beam(material="two", elements=4, rest="modes=3 position=0.1,0.2 angle=0.6") + TIP_PUSH.format("b", 2),
    "modal_clamped": beam(material="one", elements=4, rest="modes=5 reference='clamped'") + LUMPS + TIP_PUSH.format("b", -1),
    "modal_free": beam(material="damped", elements=4, rest="modes=4 reference='free'") + LUMPS + TIP_PUSH.format("b", 2),
    "modal_mixed": beam(elements=4, rest="element_material='one','elastic','two','one' modes=3 reference='clamped' angle=1.0")
    + TIP_PUSH.format("b", -1),
    "modal_frame": frame(rest="modes=4 reference='free' position=0.2,0.1 angle=0.5")
    + rigid()
    + TIP_PUSH.format("f", 3)
    + "&joint name='j' type='weld' body_a='f' node_a=3 body_b='r' point_b=0.1,0.0 /\n"
    + "&spring name='s' type='torsional' body_a='f' node_a=2 stiffness=5.0 damping=0.1 free_angle=0.2 /\n",
    "modal_thick": beam(material="two", section="thick", elements=4, rest="modes=3 position=0.1,0.2") + TIP_PUSH.format("b", 2),
    "modal_bonded": layered("'bonded_thick'", 4, rest="modes=4 reference='clamped'") + LUMPS + TIP_PUSH.format("b", -1),
    "modal_no_axial": beam(material="two", elements=4, rest="modes=2 axial=.false.") + TIP_PUSH.format("b", 2),
}

LAYERED = [name for name in (*BODIES, *MODAL) if any(word in name for word in ("thick", "bonded", "clad", "sandwich"))]
ALL = {
    name: MATERIALS + (LAYERS if name in LAYERED else "") + text + TRANSIENT
    for group in (BODIES, JOINTS, LOOPS, MODAL)
    for name, text in group.items()
}
