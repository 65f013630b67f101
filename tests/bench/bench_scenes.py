"""Decks of the benchmarks: the slider-crank's rod in any number of elements, chains of links, a four-bar."""

LENGTH, DENSITY, YOUNG, AREA, INERTIA = 0.3492, 1600.0, 2.1e10, 1.6129e-4, 8.6576e-9  # the rod [m, kg/m3, Pa, m2, m4]
CRANK = 0.1524  # [m]
TORQUE = 9.01159488  # on the rod's frame [N m]
LINK = 0.1  # length of a chain's link [m]


def transient(step, steps, method="rk4", every=None):
    """The group that asks for `steps` steps of `step` [s], rows each `every` steps (None: at both ends only)."""
    return f"&transient t_end={steps * step:.12g} method='{method}' step={step:.12g} output_step={(every or steps) * step:.12g} /\n"


def materials(terms, law="ghm"):
    """Material and section of the rod, with GHM or Maxwell terms spread by factors of two below 20,000 rad/s."""
    said = ""
    if terms:
        weights = ",".join([f"{0.5 / terms:.6g}"] * terms)
        rates = [20000.0 / 2**k for k in range(terms)]
        said = f" ghm_alpha={weights} ghm_zeta={','.join(['1.0'] * terms)} ghm_omega={','.join(f'{x:.6g}' for x in rates)}"
        if law == "maxwell":
            said = f" prony_alpha={weights} prony_tau={','.join(f'{1 / x:.6g}' for x in rates)}"
    return f"&material name='rod' density={DENSITY} young={YOUNG}{said} /\n&section name='rod' area={AREA} inertia={INERTIA} /\n"


def slider_crank(elements, run, terms=0, modes=0, torque_on_crank=False, law="ghm"):
    """The slider-crank with massless crank and slider; the sensor is the deflection of the rod's middle."""
    basis = f" modes={modes}" if modes else ""
    torque = "type='torque' body='rod' node=0"
    if torque_on_crank:
        torque = "type='torque_about' body='rod' node=1 centre=0.0,0.0"
    return (
        "&scene title='slider-crank' /\n"
        + materials(terms, law)
        + f"&body name='rod' kind='beam' length={LENGTH} elements={elements} material='rod' section='rod' "
        f"position={CRANK},0.0 reference='pinned'{basis} /\n"
        f"&joint name='crank' type='distance' body_a='rod' node_a=1 point_b=0.0,0.0 length={CRANK} /\n"
        "&joint name='slider' type='slider' body_a='rod' node_a=-1 direction=0.0 /\n"
        f"&force name='torque' {torque} moment={TORQUE} /\n"
        f"&sensor name='mid' quantity='deflection' body='rod' node={elements // 2 + 1} /\n" + run
    )


def chain(links, run, elements=0):
    """A pendulum of `links` links let go from the horizontal, rigid, or flexible with so many elements each."""
    text = "&scene title='chain' gravity=0.0,-9.81 /\n"
    if elements:
        text += materials(0)
    near, far = ("node_a=1", "node_b=-1") if elements else ("point_a=0.0,0.0", f"point_b={LINK},0.0")
    for k in range(links):
        body = f"&body name='b{k}' position={k * LINK:.10g},0.0 "
        if elements:
            body += f"kind='beam' length={LINK} elements={elements} material='rod' section='rod' reference='pinned' /\n"
        else:
            body += f"kind='rigid' mass=1.0 inertia={LINK**2 / 12:.10g} com={LINK / 2},0.0 /\n"
        other = f"body_b='b{k - 1}' {far}" if k else "point_b=0.0,0.0"
        text += body + f"&joint name='j{k}' type='revolute' body_a='b{k}' {near} {other} /\n"
    tip = "node=-1" if elements else f"point={LINK},0.0"
    return text + f"&sensor name='tip' quantity='position' body='b{links - 1}' {tip} /\n" + run


def truss(columns, height, run):
    """A grid of points held at its left edge, braced twice in every field: half of its links are redundant."""
    points = [(i, j) for i in range(columns) for j in range(height)]
    text = "&scene title='truss' gravity=0.0,-9.81 /\n"
    for i, j in points:
        text += f"&body name='p{i}_{j}' kind='rigid' mass=1.0 inertia=0.01 position={i},{j} /\n"
        if i == 0:
            text += f"&joint name='g{j}' type='revolute' body_a='p0_{j}' point_b=0.0,{j} /\n"
    for i, j in points:
        for a, b in ((i + 1, j), (i, j + 1), (i + 1, j + 1), (i + 1, j - 1)):
            if a < columns and 0 <= b < height and a + i > 0:
                text += f"&joint name='d{i}_{j}_{a}_{b}' type='distance' body_a='p{i}_{j}' body_b='p{a}_{b}' "
                text += f"length={((a - i) ** 2 + (b - j) ** 2) ** 0.5!r} /\n"
    return text + run


def many_materials(elements, run, spread=1.0, omega=20000.0, count=None):
    """A clamped beam whose elements are in turn of so many GHM materials (None: one each), a little apart."""
    count = count or elements
    text = "&scene title='materials' /\n&section name='rod' area=1.6129e-4 inertia=8.6576e-9 /\n"
    for k in range(count):
        text += f"&material name='m{k}' density={DENSITY} young={YOUNG} "
        text += f"ghm_alpha=0.5 ghm_zeta=1.0 ghm_omega={omega + spread * k} /\n"
    names = ",".join(f"'m{k % count}'" for k in range(elements))
    return (
        text + f"&body name='arm' kind='beam' length={LENGTH} elements={elements} element_material={names} section='rod' "
        "reference='clamped' /\n&joint name='wall' type='weld' body_a='arm' node_a=1 point_b=0.0,0.0 /\n" + run
    )


def lattice(loops, run):
    """Square loops of rigid links in a row, upper and lower rails joined by rungs."""
    text = "&scene title='lattice' gravity=0.0,-9.81 /\n"
    bar = "kind='rigid' mass=1.0 inertia=0.001 com=0.05,0.0"
    pivot = "type='revolute' point_a={},0.0 point_b={} body_a="
    for k in range(loops):
        x = LINK * k
        text += f"&body name='b{k}' {bar} position={x:.10g},0.0 /\n&body name='t{k}' {bar} position={x:.10g},{LINK} /\n"
        text += f"&body name='r{k}' {bar} position={x + LINK:.10g},0.0 angle=1.5707963267948966 /\n"
        for rail, y in (("b", 0.0), ("t", LINK)):
            other = f" body_b='{rail}{k - 1}'" if k else ""
            text += f"&joint name='j{rail}{k}' {pivot.format(0.0, f'{LINK},0.0' if k else f'0.0,{y}')}'{rail}{k}'{other} /\n"
            text += f"&joint name='r{rail}{k}' {pivot.format(y, f'{LINK},0.0')}'r{k}' body_b='{rail}{k}' /\n"
    return text + run


def four_bar(run):
    """A driven rigid crank, a viscoelastic coupler of 4 elements, an elastic rocker of 4."""
    body = "kind='beam' elements=4 material='rod' section='rod' reference='pinned'"
    return (
        "&scene title='four-bar' gravity=0.0,-9.81 /\n" + materials(1) + "&material name='steel' density=7850.0 young=2.1e11 /\n"
        "&body name='crank' kind='rigid' mass=0.2 inertia=2.0e-4 com=0.05,0.0 angle=1.5707963267948966 /\n"
        f"&body name='coupler' {body} length=0.3 position=0.0,0.1 angle=0.3398369094541219 /\n"
        f"&body name='rocker' {body.replace(chr(39) + 'rod' + chr(39), chr(39) + 'steel' + chr(39), 1)} "
        "length=0.2 position=0.2828427124746190,0.0 angle=1.5707963267948966 /\n"
        "&joint name='o' type='revolute' body_a='crank' point_a=0.0,0.0 point_b=0.0,0.0 /\n"
        "&joint name='a' type='revolute' body_a='coupler' node_a=1 body_b='crank' point_b=0.1,0.0 /\n"
        "&joint name='b' type='revolute' body_a='coupler' node_a=-1 body_b='rocker' node_b=-1 /\n"
        "&joint name='c' type='revolute' body_a='rocker' node_a=1 point_b=0.2828427124746190,0.0 /\n"
        "&force name='motor' type='torque' body='crank' moment=1.0 /\n"
        "&sensor name='b' quantity='position' body='rocker' node=-1 /\n" + run
    )


def cantilever(elements, terms, analysis):
    """A clamped beam with a force at its tip, for `&modal` and `&frequency_response`."""
    return (
        "&scene title='cantilever' /\n"
        + materials(terms)
        + f"&body name='arm' kind='beam' length={LENGTH} elements={elements} material='rod' section='rod' reference='clamped' /\n"
        "&joint name='wall' type='weld' body_a='arm' node_a=1 point_b=0.0,0.0 /\n"
        "&history name='tone' kind='sine' amplitude=1.0 frequency=100.0 /\n"
        "&force name='push' type='force' body='arm' node=-1 fy=1.0 history='tone' /\n"
        "&sensor name='tip' quantity='position' body='arm' node=-1 /\n" + analysis
    )


def explicit_step(elements):
    """A stable rk4 step [s] of the slider-crank's rod: bending grows with the square of the elements."""
    return 2.5e-5 / max(elements / 2, 1) ** 2


def driven_rod(elements, option=""):
    """A crank brings a rod to speed that carries a load: everything but what is measured and the analysis."""
    return f"""&scene title='a crank brings a loaded rod to speed' /
&material name='steel' density=7850.0 young=2.1e11 rayleigh_mass=20.0 rayleigh_stiffness=1.0e-7 /
&section name='rod' shape='rectangle' width=0.01 height=0.008 /
&body name='crank' kind='rigid' mass=1.0 inertia=1.0e-3 /
&body name='rod' kind='beam' length=0.3 elements={elements} material='steel' section='rod' position=0.08,0.0 {option} /
&lump body='rod' node=-1 mass=0.3 /
&joint name='shaft' type='revolute' body_a='crank' /
&joint name='crank_pin' type='revolute' body_a='rod' node_a=1 body_b='crank' point_b=0.08,0.0 /
&joint name='cylinder' type='slider' body_a='rod' node_a=-1 /
&history name='turn' kind='cycloid' start_value=0.0 end_value=12.566 start=0.0 finish=0.1 /
&drive name='motor' type='rotation' body_a='crank' history='turn' /
&history name='rise' kind='cycloid' start_value=0.0 end_value=1.0 start=0.01 finish=0.05 /
&force name='load' type='force' body='rod' node={elements // 2} fy=-200.0 history='rise' /
"""
