"""Decks for the fuzzer: scenes with every group and variable of the language, values that nobody would write, damaged bytes."""

from __future__ import annotations

import math
import random
import re
import sys
from pathlib import Path

from hypothesis import strategies as st

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "shared"))

import random_scenes  # noqa: E402
import scenes  # noqa: E402
from deck_keys import Key, applying, choice_of  # noqa: E402

METHODS = ["rk4", "dopri5", "radau", "generalized_alpha"]
JOINTS = ["revolute", "weld", "slider", "prismatic", "distance", "gear", "profile"]
WILD = re.findall(
    r"\S+",
    """0 -0.0 -1 1 2 3 1e-300 1e-40 1e-30 1e-20 1e-12 1e-5 1e6 1e12 1e15 1e20 1e30 1e40 1e100 1e200 1e300 1e308 -1e308 1e400 nan
    inf 2147483647 2147483648 -2147483648 9223372036854775807 1e-9 0.1 .true. .false. 'rod' '' 3* 2*0.5 99*1 {1/0} {10^60*1e60}
    {-1} {0.5} {1e-40^4} {exp(1e9)} {2^2^2^2^2^2} {tan(pi/2)} {-8^0.5} {(-8)^0.5} {one/zero} {nosuch} {one 3*{7} {1.}{2.}""",
)
PIECES = re.findall(
    r"\S+",
    "& / ' \" = , ! 3* 99* nan 1e400 - . ; $ {one { } {1^ ** ^-1} &parameter set='one=2' prefix='p' &end (1) 1.0x -1 0 'rod' &body "
    "kind='frame' &static/ \x00 \x7f é",
)
MARKS = ["", "=", ",", ",,", "'", '"', "=,", "','", "'='", " ", "2*", "3*", "{", ")"]  # in the place of one in a list
ASSIGNMENT = re.compile(r"(\w+)\s*=\s*('[^'\n]*'|[^\s',/]+)((?:,[^\s,/]+)*)")
NUMBER = re.compile(r"(?<![\w.'])-?\d+\.?\d*(?:[eE][-+]?\d+)?(?![\w'])")
GROUP = re.compile(r"^&.*?(?=^&|\Z)", re.DOTALL | re.MULTILINE)


def some(dice: random.Random, low: float, high: float) -> str:
    """Return a number between two powers of ten."""
    return f"{10.0 ** dice.uniform(low, high):.4g}"


def maybe(dice: random.Random, chance: float, text: str) -> str:
    """Return the text, now and then."""
    return text if dice.random() < chance else ""


DECADES = {"kg/m³": (2.5, 4), "Pa": (7, 10), "kg": (-2, 1), "kg m²": (-4, 0), "m": (-2, 0), "s": (-5, -1), "Hz": (-1, 3)}  # by unit


def value(dice: random.Random, key: Key) -> str:
    """Return a value of a key: in its range, now and then at an end of it; by its unit where the range has no end."""
    words = key.range.split()
    if key.type in ("word", "choice"):
        return f"'{dice.choice(words)}'"
    if key.type == "logical":
        return dice.choice([".true.", ".false."])
    if key.name == "inertia":
        return some(dice, -4, 0)
    if key.type == "pair":
        return ",".join(sorted((some(dice, -2, 1), some(dice, -2, 1)), key=float))
    if key.type in ("integer", "auto"):
        return str(dice.choice([1, 2, 3, int(words[1]) if words[:1] == [">="] else 5]))
    if "to" in words:
        return dice.choice([words[0], words[2], f"{dice.uniform(float(words[0]), float(words[2])):.4g}"])
    if len(words) == 4:  # > 0 < 1
        return some(dice, -6, -0.01)
    sign = dice.choice(["", "-"]) if not words else ""
    return "0" if words[:1] == [">="] and dice.random() < 0.1 else sign + some(dice, *DECADES.get(key.unit.split(",")[0], (-2, 1)))


def group_of(dice: random.Random, name: str, text: str, without: str = "", chance: float = 0.2) -> str:
    """Return a group with the keys given, as far as they apply, those that it needs besides, and now and then others."""
    choice = choice_of(name)
    kind = ""
    if choice:
        found = re.search(rf"\b{choice.name}='(\w+)'", text)
        kind = found[1] if found else choice.default
    keys = applying(name, kind)
    text = ASSIGNMENT.sub(lambda found: found[0] if found[1] in keys else "", text)
    given = re.findall(r"(\w+)=", text)
    for key in keys.values():
        if key.name in given or key.name in without.split() or key.type not in DRAWN or key is choice:
            continue
        if key.required or dice.random() < chance:
            text += f" {key.name}={value(dice, key)}"
    return f"&{name} {text} /\n"


DRAWN = ("real", "pair", "integer", "auto", "logical", "word", "choice")  # what needs nothing else of the deck
SHIFT = "wlf arrhenius vertical reference_temperature temperature thermal_resistance"
PLACES = "point point_a point_b node node_a node_b node_c at at_a at_b at_c"  # of markers: theirs is the body's kind


def terms(dice: random.Random) -> str:
    """Return GHM and Maxwell terms, or none."""
    text = ""
    for names, ranges in (
        (("ghm_alpha", "ghm_zeta", "ghm_omega"), ((-2, 0.5), (-1, 1), (1, 4))),
        (("prony_alpha", "prony_tau"), ((-2, 0.5), (-5, 0))),
    ):
        count = dice.choice([0, 0, 0, 1, 2, 3])
        if count:
            text += "".join(f" {n}={','.join(some(dice, *r) for _ in range(count))}" for n, r in zip(names, ranges))
    return text


def shift(dice: random.Random) -> str:
    """Return a law of temperature and a temperature that is often near its reference, or none."""
    law = dice.choice([f"wlf={some(dice, 0, 1.5)},{some(dice, 1, 2.5)}", f"arrhenius={some(dice, 3, 6)}", "vertical=1e-3"])
    at = maybe(dice, 0.5, f" temperature={dice.uniform(-60, 200):.4g}")
    return maybe(dice, 0.4, f" {law} reference_temperature={dice.uniform(-50, 150):.4g}{at}")


def materials(dice: random.Random) -> str:
    """Return two materials and two sections."""
    text = ""
    for name in "mn":
        law = f"young={some(dice, 7, 11)}{terms(dice)}"
        without = SHIFT + " shear_modulus poisson" + " ghm_frequency_scale" * ("ghm" not in law)
        text += group_of(dice, "material", f"name='{name}' {law}{shift(dice)}", without)
    shapes = [
        "area=1e-4 inertia=1e-9",
        "shape='rectangle' width=0.02 height=0.01",
        "shape='circle' diameter=0.02",
        "shape='tube' outer=0.03 inner=0.02",
    ]
    text += "".join(f"&section name='{name}' {dice.choice(shapes)} /\n" for name in "st")
    cores = dice.randint(0, 4)
    stack = ",".join(["'m'", "'n'"] * cores + ["'m'"])
    thick = ",".join(["1e-3", some(dice, -4, -3)] * cores + ["1e-3"])
    named = ",".join(str(2 * k) for k in range(1, cores + 1)) or "0"
    for name, base in (("v", 1), ("w", dice.choice([1, 2 * cores + 1]))):  # the same cores, or others, as seen from the node line
        text += f"&section name='{name}' width=0.02 layers={stack} thickness={thick} base={base} cores={named} /\n"
    return text


def body(dice: random.Random, name: str) -> tuple[str, str, int]:
    """Return a body, its kind and its number of nodes (0: none; negative: of a stiff one)."""
    kind = dice.choice(["rigid", "beam", "beam", "frame"])
    nodes = 0 if kind == "rigid" else dice.randint(2, 6 if kind == "beam" else 5)
    x = ",".join(f"{0.2 * k + dice.uniform(-0.05, 0.05):.3f}" for k in range(nodes))
    y = ",".join(dice.choice(["0", f"{dice.uniform(-0.3, 0.3):.3f}"]) for _ in range(nodes))
    pairs = ",".join(f"{k},{k + 1}" for k in range(1, nodes)) + maybe(dice, 0.3, f",{nodes},1")
    each = ",".join(dice.choice(["'m'", "'n'"]) for _ in range(nodes - 1))
    option = dice.choice(["", "", "stiffening=.true.", "modes=", "modes=", "flexible=.false.", "viscoelastic=.false."])
    option += maybe(dice, 0.5 * ("visco" in option), " modulus_at=20")
    option += maybe(dice, 0.2 * ("stiff" not in option and kind == "beam"), " axial=.false.")
    option += dice.choice(
        ["", "", " reference='clamped'", " reference='pinned'", " reference_node=1,1,-1 reference_dof='u','v','v'"]
    )
    more = maybe(dice, 0.2, "static_shapes=.true. ") + maybe(dice, 0.3 * ("ref" not in option), "reference='free' ")
    option = option.replace("modes=", f"modes={dice.randint(1, 3)} {more}")
    made = f"length={some(dice, -1.5, 0.5)} elements={nodes - 1} node_x={x} node_y={y} element_nodes={pairs} section='s' {option}"
    made += dice.choice([" material='m'", f" element_material={each}"]) if kind == "beam" else " material='n'"
    if kind == "beam" and dice.random() < 0.25:
        layered = ",".join(dice.choice(["'v'", "'w'"]) for _ in range(nodes - 1))
        made = re.sub(r" (?:element_)?material=\S+| modulus_at=\S+", "", made).replace("section='s'", f"element_section={layered}")
        made += maybe(dice, 0.3, " slip_held=1")
    at = f"position={dice.uniform(-1, 1):.3f},{dice.uniform(-1, 1):.3f} angle={dice.uniform(-3, 3):.3f}"
    without = "flexible viscoelastic modulus_at axial stiffening modes static_shapes reference thermal_resistance"
    text = group_of(dice, "body", f"name='{name}' kind='{kind}' {at} {made if nodes else ''}", without)
    return text, kind, nodes if "flexible" not in option else -nodes


def marker(dice: random.Random, nodes: int, tail: str) -> str:
    """Return a place of a body: one of its nodes, or a point of a rigid one."""
    if nodes == 0:
        return f"point{tail}={dice.choice(['0,0', '0.2,0', '-0.1,0.1'])}"
    return f"node{tail}={dice.choice([1, -1, -1, dice.randint(1, abs(nodes))])}"


def sides(dice: random.Random, bodies: list[tuple[str, int]], k: int | None = None, turns: bool = False) -> str:
    """Return two places: of body k (or any) and of an earlier one, or of the ground; of what turns no points."""
    k = dice.randrange(len(bodies)) if k is None else k
    text = f"body_a='{bodies[k][0]}' {marker(dice, bodies[k][1], '_a')} "
    if k == 0 or dice.random() < 0.3:
        text += maybe(dice, 0.7, f"point_b={dice.uniform(-1, 1):.2f},{dice.uniform(-1, 1):.2f}")
    else:
        other = bodies[dice.randrange(k)]
        text += f"body_b='{other[0]}' {marker(dice, other[1], '_b')}"
    return re.sub(r"point_.=\S+", "", text) if turns else text


def history(dice: random.Random, name: str) -> str:
    """Return a history of any kind."""
    kinds = [
        "kind='polynomial' coefficients=0.1,2.0,-1.0",
        f"kind='sine' frequency={some(dice, -1, 2)}",
        "kind='ramp' start=0.001 finish=0.05",
        "kind='cycloid' start=0 finish=0.02",
        "kind='table' time=0,0.01,0.02,0.5 value=0,1,0.5,0",
        "kind='pulse' start=0.003 finish=0.007",
        f"kind='sum' histories='h0','h1' factors=1,{dice.uniform(-2, 2):.2f}",
        "kind='sequence' histories='h0','h1' durations=0.01,0.02",
    ]
    return group_of(dice, "history", f"name='{name}' {dice.choice(kinds[: 6 if name in ('h0', 'h1') else 8])}", chance=0.25)


def parts(dice: random.Random, bodies: list[tuple[str, int]]) -> str:
    """Return what acts on the bodies, and sensors of all quantities."""
    text = ""
    for k in range(dice.choice([0, 0, 1, 2])):
        kind = dice.choice(["linear", "torsional"])
        law = dice.choice([f"stiffness={some(dice, 0, 4)}", f"stiffness={some(dice, 0, 4)}{terms(dice)}", f"characteristic='h{k}'"])
        where = sides(dice, bodies, turns=kind == "torsional")
        text += group_of(dice, "spring", f"name='k{k}' type='{kind}' {where} {law}{shift(dice)}", f"stiffness {PLACES} {SHIFT}")
    for k in range(dice.choice([0, 1, 1, 2])):
        name, nodes = dice.choice(bodies)
        kind = dice.choice(["force", "torque", "torque_about"])
        more = maybe(dice, 0.5, f" history='h{dice.randint(0, 2)}'")
        columns = ["position.x", "velocity.y", "angle", "angular_velocity", "far", "u.v", "q.qd", "s.d", "acceleration.x"]
        column = dice.choice(columns)
        more += maybe(dice, 0.2, f" argument='{column}'" + ("" if "history" in more else " history='h0'"))
        if dice.random() < 0.25:
            more = " controller='c0'"
        text += group_of(dice, "force", f"name='f{k}' type='{kind}' body='{name}' {marker(dice, nodes, '')}{more}", PLACES, 0.4)
    if dice.random() < 0.3:
        kind = dice.choice(["rotation", "position"])
        where = sides(dice, bodies, turns=kind == "rotation")
        text += group_of(dice, "drive", f"name='d' type='{kind}' {where} history='h{dice.randint(0, 2)}'", PLACES, 0.4)
    name, nodes = dice.choice(bodies)
    text += maybe(dice, 0.3, group_of(dice, "lump", f"body='{name}' {marker(dice, nodes, '')}", PLACES, 0.8))
    for k, quantity in enumerate(["position", "velocity", "acceleration", "angle", "angular_velocity", "angular_acceleration"]):
        name, nodes = dice.choice(bodies)
        place = marker(dice, nodes, "") if k < 3 or (nodes and dice.random() < 0.5) else ""
        other, others = dice.choice(bodies)
        against = maybe(dice, 0.3, f" body_b='{other}' {marker(dice, others, '_b') if k < 3 else ''}")
        text += maybe(dice, 0.6, f"&sensor name='{quantity}' quantity='{quantity}' body='{name}' {place}{against} /\n")
        text += maybe(dice, 0.2 * (k < 1), f"&sensor name='far' quantity='distance' body='{name}' {place}{against} /\n")
    for kind, part in (("spring", "k0"), ("force", "f0"), ("drive", "d")):
        if f"&{kind} name='{part}'" in text:
            quantity = dice.choice(["power", "work"])
            text += maybe(dice, 0.3, f"&sensor name='p{kind}' quantity='{quantity}' {kind}='{part}' /\n")
    text += maybe(dice, 0.2, f"&sensor name='e' quantity='energy' body='{name}' /\n")
    flexible = [b for b in bodies if b[1] > 0]
    if flexible:
        name, nodes = dice.choice(flexible)
        text += f"&sensor name='u' quantity='deflection' body='{name}' node=-1 /\n"
        text += maybe(dice, 0.5, f"&sensor name='i' quantity='internal' body='{name}' element=1 /\n")
        text += maybe(dice, 0.3, f"&sensor name='q' quantity='coordinate' body='{name}' index=1 /\n")
    for k in range(dice.choice([0, 0, 1, 2])):
        text += stop(dice, bodies, f"t{k}") + maybe(dice, 0.6, f"&sensor name='t{k}' quantity='stop' stop='t{k}' /\n")
    text += "&sensor name='s' quantity='spring' spring='k0' /\n" if "'k0'" in text else ""
    text += maybe(dice, 0.3, stroke(dice, text, [b[0] for b in bodies]))
    return text + (controller(dice, text) if "controller='c0'" in text else "")


def controller(dice: random.Random, text: str) -> str:
    """Return a controller of a column that the deck has: gains, filter, limits, windup, samples, delay."""
    found = [name + COLUMNS[name] for name in re.findall(r"&sensor name='(\w+)'", text) if name in COLUMNS]
    gains = " ".join(f"{name}={dice.uniform(-1, 1) * 10 ** dice.uniform(-3, 4):.6g}" for name in dice.sample(["kp", "ki", "kd"], 2))
    limits = dice.choice(["", "", " lower=-1.0", " upper=0.5", " lower=-0.3 upper=0.4"])
    without = "kp ki kd lower upper" + " filter" * ("kd" not in gains) + " windup_time" * (not limits or "ki" not in gains)
    law = f"name='c0' argument='{dice.choice(found or ['angle'])}' history='h{dice.randint(0, 2)}' {gains}{limits}"
    text = group_of(dice, "controller", law, without)
    return text + maybe(dice, 0.5, "&sensor name='c' quantity='controller' controller='c0' /\n")


def lift(dice: random.Random, size: float) -> str:
    """Return a history for laws, by which a cam turns once; now and then one that is none."""
    up, down = dice.sample(["ramp", "cycloid"], 2)
    first, last = sorted(dice.uniform(0.3, 5.5) for _ in range(2))
    high = size * dice.uniform(-0.5, 0.8)
    points = dice.choice([5, 12, 36])
    values = [high * dice.random() for _ in range(points)]
    time = ",".join(f"{{{k}*pi/{points}*2}}" for k in range(points + 1))
    law = dice.choice(
        [
            f"kind='sine' amplitude={high:.5g} frequency={{{dice.randint(1, 3)}/(2*pi)}}",
            "kind='sequence' histories='up','down','rest' durations={a},{b-a},{2*pi-b} periodic=.true.",
            "kind='sequence' histories='up','down' durations={a},{2*pi-a}",
            f"kind='table' time={time} value={','.join(f'{v:.4g}' for v in [*values, values[0]])} periodic=.true."
            f" interpolation='{dice.choice(['spline', 'spline', 'pchip', 'linear'])}'",
            "kind='sum' histories='turn','turn' factors=1,-0.5",
            "kind='product' histories='turn','turn'",
            "kind='polynomial' coefficients=0",
        ]
    )
    return f"""&parameter name='a' value={first:.6g} /
&parameter name='b' value={last:.6g} /
&history name='up' kind='{up}' start_value=0 end_value={high:.5g} start=0 finish={{a}} /
&history name='down' kind='{down}' start_value={high:.5g} end_value=0 start=0 finish={dice.choice(["{b-a}", "{2*pi-a}"])} /
&history name='rest' kind='polynomial' coefficients=0 /
&history name='turn' kind='sine' amplitude={high:.5g} frequency={{1/(2*pi)}} /
&history name='lift' {law} /
"""


def profile(dice: random.Random, name: str, size: float) -> str:
    """Return a profile of any kind; its law is the history lift."""
    count, waves, deep = dice.choice([3, 8, 30, 30]), dice.randint(1, 4), dice.choice([0, 0.02, 0.3])
    turn = dice.choice([1, 1, -1, 0.4]) * 2 * math.pi / count
    polar = [(size * (1 + deep * math.cos(waves * turn * k)), turn * k) for k in range(count)]
    x, y = (",".join(f"{r * f(angle):.6g}" for r, angle in polar) for f in (math.cos, math.sin))
    law = f"kind='law' history='lift'{maybe(dice, 0.3, ' clockwise=.true.')}"
    disc = f"base_radius={size:.4g} radius={size * dice.choice([0.1, 0.3, 1, 5]):.4g}"
    arm = f"radius={size * 0.3:.4g} arm={size * dice.uniform(1, 3):.4g} pivot={2 * size:.4g},{0.5 * size:.4g}"
    kinds = [
        f"kind='circle' radius={size:.4g}" + maybe(dice, 0.4, " hollow=.true."),
        f"kind='points' x={x} y={y}" + maybe(dice, 0.3, " closed=.false."),
        f"{law} follower='flat' base_radius={size:.4g}",
        f"{law} {disc}" + maybe(dice, 0.6, f" offset={size * dice.uniform(-0.3, 0.3):.4g}"),
        f"{law} {arm}",
    ]
    return f"&profile name='{name}' {dice.choice(kinds)} /\n"


def follower(dice: random.Random, size: float) -> str:
    """Return a follower."""
    roller = f"radius={size * dice.choice([0.1, 0.3, 0.5, 2]):.4g}"
    return dice.choice(["", roller, roller, f"face={dice.choice(['{90*deg}', '{90*deg}', '-1', '{pi}'])}"])


def cam(dice: random.Random) -> str:
    """Return a cam that turns, with a follower that is held to it, pushed back by it, or both."""
    size = float(some(dice, -2, 0))
    rigid = f"mass={some(dice, -2, 1)} inertia={some(dice, -5, -2)}"
    made = [
        dice.choice(
            [(rigid, ""), (rigid, ""), (f"kind='beam' length={3 * size:.4g} elements=2 material='m' section='s'", " node{}=1")]
        )
        for _ in range(2)
    ]
    (turns, hub), (slides, end) = made
    touch = end.replace("=1", "=-1").format("_a")
    text = f"&scene gravity=0,{dice.choice(['0', '-9.81'])} /\n" + materials(dice) + lift(dice, size) + profile(dice, "p0", size)
    text += f"&body name='cam' {turns} angle={dice.uniform(-4, 4):.3f} /\n"
    text += f"&joint name='shaft' type='revolute' body_a='cam'{hub.format('_a')} /\n"
    at = f"position=0,{size * dice.choice([1, 1.3, 2, -0.5, 0]):.4g}"
    text += f"&body name='f' {slides} {at} angle={dice.choice(['0', '1.5', '{pi}'])} /\n"
    way = dice.choice(["type='prismatic' direction={90*deg}", f"type='revolute' point_b={2 * size:.4g},{0.5 * size:.4g}", ""])
    text += f"&joint name='guide' {way} body_a='f'{end.format('_a')} /\n" if way else ""
    carrier = dice.choice([f"body_b='cam'{hub.format('_b')}"] * 3 + ["body_b='ground'"])
    pair = f"type='profile' body_a='f'{touch} {carrier} profile='p0' {follower(dice, size)}"
    hard = dice.choice([f"stiffness={some(dice, 2, 8)}", f"stiffness={some(dice, 2, 8)}", f"restitution={dice.random():.2f}"])
    kind = dice.choice(["joint", "stop"])
    text += f"&{kind} name='pair' {pair} {hard * (kind == 'stop')} /\n"
    text += f"&sensor name='contact' quantity='contact' {kind}='pair'" + maybe(dice, 0.5, f" direction={dice.uniform(-3, 3):.3f}")
    text += maybe(dice, 0.2, " modulus={100*GPa} width=0.01") + " /\n"
    text += maybe(dice, 0.3, f"&stop name='other' {pair} stiffness={some(dice, 2, 8)} exponent=1 /\n")
    text += f"&sensor name='position' quantity='position' body='f'{end.format('')} /\n"
    text += "&sensor name='angle' quantity='angle' body='cam' /\n"
    text += f"&history name='speed' coefficients={dice.choice(['0', '1', '-30', '200'])} /\n"
    drive = "&drive name='d' type='rotation' body_a='cam' history='speed' rate=.true. /\n"
    text += dice.choice([drive, "&force name='f0' type='torque' body='cam' moment=1 /\n"]) + stroke(dice, text, ["cam", "f"])
    spring = f"body_a='f'{end.format('_a')} point_b=0,{9 * size:.4g} stiffness={some(dice, 0, 5)}"
    return text + maybe(dice, 0.3, f"&spring name='k0' {spring} /\n")


def stroke(dice: random.Random, text: str, names: list[str]) -> str:
    """Return forces by histories with arguments of their own, products and switches, of columns that the deck has."""
    columns = [name + COLUMNS[name] for name in re.findall(r"&sensor name='(\w+)'", text) if name in COLUMNS] or ["angle"]
    laws = [
        "coefficients=1,-2",
        "kind='sine' amplitude=1 frequency=3",
        "kind='ramp' start_value=1 end_value=-1 start=-0.1 finish=0.2",
        "kind='table' time=-1,0,1,2 value=0,1,0.5,0 interpolation='linear'",
        "kind='sum' histories='s0','s1'",
        "kind='product' histories='s0','s1'",
        "kind='product' histories='s0','s0','s1'",
        "kind='switch' histories='s1','s0' level={}",
        "kind='switch' histories='s0','s2' level={}",
        "kind='sequence' histories='s0','s1' durations=0.01,0.02",
    ]
    made = ""
    for k, kinds in enumerate([4, 4, 8, 10]):
        law = dice.choice(laws[:kinds]).format(dice.choice(["0", f"{dice.uniform(-1, 1):.3f}"]))
        by = f" argument='{dice.choice(columns)}'" if "switch" in law or dice.random() < 0.4 else ""
        made += f"&history name='s{k}' {law}{by} /\n"
    force = f"type='torque' body='{dice.choice(names)}' moment={some(dice, -3, 1)}"
    for k in range(dice.choice([1, 1, 2])):
        by = maybe(dice, 0.2, f" argument='{dice.choice(columns)}'")
        made += f"&force name='fs{k}' {force} history='s{dice.choice([2, 3])}'{by} /\n"
    return made


COLUMNS = {"position": ".x", "velocity": ".y", "angle": "", "angular_velocity": "", "far": "", "u": ".v", "q": ".qd", "s": ".d"}
COLUMNS["contact"] = ".gap"


def cycle(dice: random.Random, text: str) -> str:
    """Return a deck whose motion may repeat, with its &periodic: histories of one period, damped springs, warm parts."""
    period = float(some(dice, -2, -1))
    wave = f"kind='sine' amplitude=1 frequency={1 / period!r}"
    text = re.sub(r"&history name='(h\d|s[01])'(?![^/]*argument)[^/]*/", rf"&history name='\1' {wave} /", text)
    hot = f" thermal_resistance={some(dice, -3, 3)}"
    if dice.random() < 0.3 and "temperature=" in text:
        text = re.sub(r"(&body [^/]*kind='beam')", rf"\1{hot} temperature=30", text)
    names = re.findall(r"&body name='(\w+)'", text)
    for name in names:
        heat = maybe(dice, 0.3, f" arrhenius=1e5 reference_temperature=20 temperature=25{hot} prony_alpha=1 prony_tau=0.01")
        damper = f"stiffness={some(dice, 1, 4)} damping={some(dice, -1, 2)}{heat}"
        text += f"&spring name='z{name}' type='torsional' body_a='{name}' {damper} /\n"
    how = f"{dice.choice(['period', 'period', 'period_guess'])}={period!r} multipliers={dice.randint(0, 4)}"
    how += f" tolerance={some(dice, -8, -2)} most_turns={dice.choice([5, 20, 40])}"
    how += maybe(dice, 0.2, f" moves_on='{names[0]}'" + maybe(dice, 0.5, f" angle_repeats='{names[0]}'"))
    run = f"method='{dice.choice(['rk4', 'dopri5', 'radau', 'radau', 'radau'])}' step={period / dice.choice([10, 40])!r}"
    return text + f"&periodic {how} /\n&transient {run}{maybe(dice, 0.5, f' t_end={period / 4!r}')} /\n"


def stop(dice: random.Random, bodies: list[tuple[str, int]], name: str) -> str:
    """Return a stop of any kind, near what it limits or far from it, soft or hard."""
    kind = dice.choice(["rotation", "position", "clearance", "profile"])
    low = dice.uniform(-1, 1)
    limits = dice.choice([f"lower={low:.4f}", f"upper={low:.4f}", f"lower={low:.4f} upper={low + 10 ** dice.uniform(-6, 0):.7f}"])
    if kind == "clearance":
        limits = f"gap={some(dice, -9, 0)}"
    if kind == "profile":
        limits = f"profile='p0' {follower(dice, 0.1)}"
    law = dice.choice(["", f" damping={some(dice, -3, 2)}", f" restitution={dice.uniform(0.05, 1):.3f}"])
    law = f"stiffness={some(dice, 1, 12)}{law}"
    without = f"lower upper radius face stiffness damping restitution friction friction_static pin_radius {PLACES}"
    rubs = "" if kind == "rotation" else maybe(dice, 0.3, f" friction={some(dice, -3, 0)} pin_radius=0.01")
    if dice.random() < (0.4 if all(nodes <= 0 for _, nodes in bodies) else 0.03):  # rigid stops meet rigid bodies
        law = f"restitution={dice.choice(['0', '1', f'{dice.uniform(0, 1):.3f}'])}"
        wide = f"lower=-{some(dice, -2, 1)} upper={some(dice, -2, 1)}"
        limits = dice.choice([limits, wide]) if "er=" in limits else limits
        rubs = ""
        without += " exponent"
    where = sides(dice, bodies, turns=kind == "rotation")
    return group_of(dice, "stop", f"name='{name}' type='{kind}' {where} {limits} {law}{rubs}", without, 0.4)


def transient(dice: random.Random, text: str) -> str:
    """Return a &transient of some hundred steps at most."""
    end = dice.choice([1e-3, 1e-3, 1e-2])
    method = dice.choice(METHODS)
    explicit = method in ("rk4", "dopri5")
    if dice.random() < 0.1:
        more = maybe(dice, 0.1 * (" modes=" in text), " check_reduction=.true.")
        more += maybe(dice, 0.1 * ("'beam'" in text), " check_mesh=.true.")
        return f"&transient t_end={end} accuracy={some(dice, -3, -1)} most_seconds=60{more} /\n"
    how = f"step={end / dice.choice([20, 50, 200] if explicit else [1, 7, 40, 200]):.6g}"
    if method in ("dopri5", "radau") and dice.random() < 0.6:
        how = f"tolerance={some(dice, -7, -2)}" + maybe(dice, 0.2, " first_step=1e-5") + maybe(dice, 0.2, " max_step=1e-3")
    more = maybe(dice, 0.5, f" output_step={end / dice.choice([1, 2.5, 10]):.6g}") + maybe(dice, 0.2, f" motion_step={end / 3:.6g}")
    more += (
        maybe(dice, 0.2, f" checkpoint_interval={end / 2:.6g}")
        + maybe(dice, 0.15, " check_error=.true.")
        + maybe(dice, 0.1, " accept_unstable=.true." * explicit)
    )
    if method == "generalized_alpha":
        more += maybe(dice, 0.3, f" spectral_radius={dice.uniform(0, 0.99):.2f}")
    elif explicit:
        more += maybe(
            dice, 0.2, dice.choice([" stabilization='baumgarte' baumgarte_alpha=90 baumgarte_beta=90", " stabilization='none'"])
        )
    return f"&transient t_end={end} method='{method}' {how}{more} /\n"


def analyses(dice: random.Random, text: str) -> str:
    """Return analyses of all kinds."""
    modal = group_of(dice, "modal", f"modes={dice.randint(1, 12)}")
    made = maybe(dice, 0.2, group_of(dice, "static", "")) + maybe(dice, 0.2, modal)
    entries = [name for name in ("f0", "d") if f"name='{name}'" in text]
    linear = not re.search("quantity='(?:power|work|energy|stress)'", text)
    if entries and dice.random() < (0.2 if linear else 0.02):
        made += group_of(dice, "frequency_response", f"from=0.5 to={some(dice, 0, 4)} points=5 input='{dice.choice(entries)}'")
    return made + maybe(dice, 0.9, transient(dice, text))


def language(dice: random.Random) -> str:
    """Return a scene of any groups and variables: bodies in a tree, now and then loops."""
    text = f"&scene title='fuzz' gravity=0,{dice.choice(['0', '-9.81'])} /\n" + materials(dice)
    text += lift(dice, 0.1) + profile(dice, "p0", 0.1)
    bodies = []
    for k in range(dice.choice([1, 1, 2, 2, 3])):
        group, _, nodes = body(dice, f"b{k}")
        bodies.append((f"b{k}", nodes))
        text += group
        if dice.random() < 0.9:
            kind = dice.choice([joint for joint in JOINTS if k or joint != "gear"])  # of the first one b and c are the ground
            more = maybe(dice, 0.5, f" body_c='b{dice.randint(0, k)}'") if kind == "gear" else ""
            rubs = kind in ("revolute", "slider", "prismatic") and dice.random() < 0.4
            mu = dice.choice(["0", "10", "1e-12", some(dice, -3, 0)])
            static = maybe(dice, 0.4, f" friction_static={min(10.0, float(mu) * 10 ** dice.uniform(0, 2)):.4g}")
            more += f" friction={mu}{static} pin_radius={some(dice, -6, 0)}" * rubs
            text += maybe(dice, 0.5 * (rubs and mu != "0"), f"&sensor name='rub{k}' quantity='friction' joint='j{k}' /\n")
            more += f" profile='p0' {follower(dice, 0.1)}" * (kind == "profile")
            without = f"{PLACES} radius face friction friction_static preload_static" + " length" * (dice.random() < 0.8)
            without += " preload pad_distance pin_radius" * (not rubs)
            text += group_of(dice, "joint", f"name='j{k}' type='{kind}' {sides(dice, bodies, k)}{more}", without, 0.6)
    text += maybe(dice, 0.2, f"&joint name='loop' type='{dice.choice(JOINTS[:5])}' {sides(dice, bodies)} /\n")
    text += "".join(f"&sensor name='r{j}' quantity='reaction' joint='{j}' /\n" for j in re.findall(r"&joint name='(\w+)'", text))
    text += "".join(history(dice, f"h{k}") for k in range(3)) + parts(dice, bodies)
    return text + maybe(dice, 0.6, watched(dice, text, bodies))


def expressed(dice: random.Random, text: str) -> str:
    """Return a deck with expressions of the same values in the places of some numbers, and now and then a repeated part."""
    forms = ["{{{0}*one}}", "{{({0})/one^2 + zero}}", "{{-(-{0})}}", "{{min({0},one*{0})}}", "{{{0}*cos(zero)}}"]
    quoted = re.split(r"('[^'\n]*'|\{[^}\n]*\})", text)
    for k in range(0, len(quoted), 2):
        quoted[k] = NUMBER.sub(lambda found: dice.choice(forms).format(found[0]) if dice.random() < 0.3 else found[0], quoted[k])
    text = "".join(quoted) + "&parameter name='zero' value={one-1} /\n&parameter name='one' value={exp(0)} /\n"
    part = f"&include file='{ROOT}/tests/fuzz/part.nml' prefix='{{}}' set='mass={some(dice, -2, 1)}','arm=one/4' /\n"
    return text + "".join(part.format(prefix) for prefix in dice.choice([[], ["p_"], ["p_", "q"]]))


def drawn(dice: random.Random) -> str:
    """Return a whole deck that somebody might have written."""
    kind = dice.random()
    if kind < 0.35:
        text = language(dice)
    elif kind < 0.45:
        text = cam(dice)
    elif kind < 0.75:
        text = dice.choice([random_scenes.chain, random_scenes.crank, random_scenes.cantilever])(dice)
        text = "&scene gravity=0,-9.81 /\n" + text + random_scenes.sensors(text)
    else:
        text = dice.choice(list(scenes.ALL.values())).replace(scenes.TRANSIENT, "")
    text = cycle(dice, text) if dice.random() < 0.15 and "&force" in text else text + analyses(dice, text)
    return expressed(dice, text) if dice.random() < 0.25 else text


def watched(dice: random.Random, text: str, bodies: list[tuple[str, int]]) -> str:
    """Return sensors of every quantity on every body and on all that connects and drives them, or some of these."""
    found = []
    for name, nodes in bodies:
        group = re.search(rf"&body name='{name}'[^&]*", text)[0]
        place = f"body='{name}' {marker(dice, nodes, '')}"
        found += [f"{quantity}' {place}" for quantity in ("position", "velocity", "acceleration", "distance")]
        found += [f"{quantity}' body='{name}'" for quantity in ("angle", "angular_velocity", "angular_acceleration", "energy")]
        if nodes <= 0:
            continue
        node, element = dice.randint(1, nodes), dice.randint(1, nodes - 1)
        found += [f"deflection' body='{name}' node={node}", f"coordinate' body='{name}' index=1"]
        found += [f"internal' body='{name}' element={element}"]
        if "element_section" in group:
            layers = len(re.search(r"name='v'.*layers=(\S+)", text)[1].split(","))
            found += [f"layer' body='{name}' element={element} layer={k}" for k in range(1, layers + 1)]
            found += [f"energy' body='{name}' layer={k}" for k in range(1, layers + 1)]
            found += [f"slip' body='{name}' node={k}" for k in range(1, nodes + 1) if layers > 1]
        elif "area=" not in re.search(r"name='s'.*", text)[0]:
            found.append(f"stress' body='{name}'")
    of = {"joint": "reaction power work", "drive": "reaction power work", "force": "power work", "spring": "spring power work"}
    for kind, quantities in (of | {"stop": "stop", "controller": "controller"}).items():
        for group in re.findall(rf"&{kind} (name='\w+'[^&]*)", text):
            name = re.match(r"name='(\w+)'", group)[1]
            also = " contact" * ("type='profile'" in group) + " friction" * (kind != "force" and " friction=" in group)
            found += [f"{quantity}' {kind}='{name}'" for quantity in (quantities + also * (kind in ("joint", "stop"))).split()]
    kept = found if dice.random() < 0.3 else [one for one in found if dice.random() < 0.2]
    return "".join(f"&sensor name='x{k}' quantity='{one} /\n" for k, one in enumerate(kept))


def tokens(dice: random.Random, deck: str) -> str:
    """Return a deck with a mark of a list damaged: one of its commas, quotes or equals signs, or an item of it."""
    lists = list(re.finditer(r"\w+\s*=\s*(?:'[^'\n]*'|[^\s,/'=]+)(?:\s*,\s*(?:'[^'\n]*'|[^\s,/'=]+))+", deck))
    if not lists:
        return deck
    one = dice.choice(lists)
    marks = list(re.finditer(r"[,='\"]|[^,='\"\s]+", one[0]))
    mark = dice.choice(marks)
    new = dice.choice([*MARKS, mark[0] * 2, f"{mark[0]},{mark[0]}"])
    return deck[: one.start() + mark.start()] + new + deck[one.start() + mark.end() :]


def odd(dice: random.Random, deck: str) -> str:
    """Return a deck with a value, an assignment or a group changed, doubled, exchanged or left out."""
    kind = dice.choice(["number", "number", "number", "scale", "drop", "double", "swap", "borrow", "group", "again"])
    found = list((NUMBER if kind in ("number", "scale") else GROUP if kind in ("group", "again") else ASSIGNMENT).finditer(deck))
    if not found:
        return deck
    a, b = dice.choice(found), dice.choice(found)
    new = ""
    if kind == "number":
        new = dice.choice(WILD)
    elif kind == "scale":
        new = f"{float(a[0]) * 10.0 ** dice.choice([-30, -9, -3, -1, 1, 3, 9, 30]) * dice.choice([1, 1, -1]):.6g}"
    elif kind == "double":
        new = a[0] + " " + a[0]
    elif kind == "swap":
        new = f"{a[1]}={b[2]}{b[3]}"
    elif kind == "borrow":
        new = a[0] + " " + b[0]
    elif kind == "again":
        new = a[0] + b[0]
    return deck[: a.start()] + new + deck[a.end() :]


def damaged(dice: random.Random, deck: bytes) -> bytes:
    """Return a deck's bytes after a deletion, insertion, replacement, doubling, or cut off."""
    at, length = dice.randint(0, len(deck)), dice.choice([1, 1, 1, 2, 5, 20, 80])
    kind = dice.choice(["delete", "insert", "replace", "byte", "double", "cut"])
    if kind == "cut":
        return deck[:at]
    if kind == "double":
        return deck[: at + length] + deck[at:]
    new = b"" if kind == "delete" else bytes([dice.randrange(256)]) if kind == "byte" else dice.choice(PIECES).encode()
    return deck[:at] + new + deck[at + (0 if kind == "insert" else length) :]


def shortened(text: str) -> str:
    """Return a shipped deck whose transient takes some tens of steps."""
    step = re.search(r"(?<![\w])step\s*=\s*([-+.\deE]+)", text)
    end = re.search(r"\bt_end\s*=\s*([-+.\deE]+)", text)
    if not end:
        return text
    short = 30 * float(step[1]) if step else float(end[1]) / 500
    text = re.sub(r"\b(t_end\s*=\s*)[-+.\deE]+", rf"\g<1>{min(short, float(end[1])):.6g}", text)
    return re.sub(r"\b(output_step|motion_step|checkpoint_interval)\s*=\s*[-+.\deE]+", "", text)


def shipped() -> list[bytes]:
    """Return every deck of the project, shortened, without those that include others by a path."""
    files = [
        *sorted((ROOT / "input").glob("*.nml")),
        *sorted((ROOT / "tests").glob("reference/**/*.nml")),
        *sorted((ROOT / "tests" / "faulty").glob("*.nml")),
    ]
    return [shortened(path.read_bytes().decode("latin-1")).encode("latin-1") for path in files if path.stat().st_size < 20000]


SHIPPED = shipped()


@st.composite
def decks(draw: st.DrawFn) -> bytes:
    """Return a deck: as somebody might write it, with odd values, or damaged; one number makes it."""
    dice = draw(st.randoms(use_true_random=True))
    kind = dice.random()
    if kind < 0.1:
        deck = dice.choice(SHIPPED)
    else:
        text = drawn(dice)
        for _ in range(dice.choice([1, 1, 2]) if kind < 0.22 else dice.choice([0, 0, 0, 0, 0, 1, 2])):
            text = tokens(dice, text) if kind < 0.22 else odd(dice, text)
        deck = text.encode()
        if kind < 0.97:
            return deck
    for _ in range(dice.randint(1, 3)):
        deck = damaged(dice, deck)
    return deck
