"""Restart of random scenes by every method: cut off anywhere and continued, a run leaves the bytes of the uninterrupted one.

A limit on the size of files cuts a run off where its history reaches it: at a place that the seed alone decides.
"""

from __future__ import annotations

import json
import random
import resource
import shutil
import subprocess
import time
from math import cos, sin

import numpy as np
import pytest
from conftest import TIMEOUT, caught, untimed

ROWS = 100
CUTS = 2  # of each scene
TERMS = "ghm_alpha=0.5,0.3 ghm_zeta=1.2,0.6 ghm_omega=900.0,4000.0 prony_alpha=0.4 prony_tau=2e-4"
MATERIALS = ["", TERMS, "rayleigh_stiffness=1e-4"]
METHODS = {
    "fixed generalized_alpha": "method='generalized_alpha' step={step:.17g}",
    "fixed radau": "method='radau' step={step:.17g}",
    "controlled radau": "method='radau' tolerance=1e-5",
    "rk4": "method='rk4' step={small:.17g}",
    "fixed dopri5": "method='dopri5' step={small:.17g}",
    "controlled dopri5": "method='dopri5' tolerance=1e-5",
}


def scene(dice: random.Random) -> str:
    """Return a chain of one to three links of random kinds, some hinges with friction or a spring that is not at rest."""
    lines = ["&scene gravity=0.0,-9.81 /"]
    damping = dice.choice(MATERIALS)
    lines.append(f"&material name='m' density={dice.uniform(8e2, 3e3):.17g} young={10 ** dice.uniform(8.5, 10.5):.17g} {damping} /")
    lines.append("&section name='s' shape='rectangle' width=0.02 height=0.02 /")
    x = y = 0.0
    on, at = "", ""
    before = 0.0
    for k in range(dice.randint(1, 3)):
        length, angle = dice.uniform(0.2, 0.5), dice.uniform(-3.0, 3.0)
        rest = f"position={x:.17g},{y:.17g} angle={angle:.17g} angular_velocity={dice.uniform(-5.0, 5.0):.17g}"
        kind = dice.choice(["rigid", "", "modes=3 reference='clamped'", "reference='clamped'", "stiffening=.true."])
        if kind == "rigid":
            lines.append(f"&body name='b{k}' kind='rigid' mass=0.2 inertia=2e-3 com={length / 2:.17g},0.0 {rest} /")
            near, far, end = "", f"point_b={length:.17g},0.0", f"point={length:.17g},0.0"
        else:
            elements = dice.randint(2, 4)
            lines.append(f"&body name='b{k}' kind='beam' length={length:.17g} elements={elements} material='m' section='s'")
            lines.append(f"  {kind} {rest} /")
            near, far, end = "node_a=1", "node_b=-1", "node=-1"
        rubs = f"friction={dice.uniform(0.1, 0.5):.17g} friction_static=0.6 pin_radius={dice.uniform(0.005, 0.05):.17g}"
        lines.append(f"&joint name='j{k}' type='revolute' body_a='b{k}' {near} {on} {at} {dice.choice(['', rubs])} /")
        if dice.random() < 0.7:
            spring = f"stiffness={10 ** dice.uniform(1.0, 3.0):.17g} free_angle={dice.uniform(-0.6, 0.6):.17g}"
            spring += dice.choice(["", " ghm_alpha=1.0 ghm_zeta=1.0 ghm_omega=50.0 prony_alpha=0.7 prony_tau=0.01"])
            lines.append(f"&spring name='k{k}' type='torsional' body_a='b{k}' {near} {on} {at if 'node' in at else ''} {spring} /")
        if dice.random() < 0.4:
            side = at if "node" in at else ""
            relative = angle - before
            limits = f"lower={relative - 10 ** dice.uniform(-4, -2):.17g} upper={relative + 10 ** dice.uniform(-4, -2):.17g}"
            law = f"stiffness={10 ** dice.uniform(2, 6):.17g} exponent={dice.choice([1.0, 1.5, 2.0])}"
            law += f" restitution={dice.uniform(0.1, 1.0):.17g}"
            lines.append(f"&stop name='t{k}' type='rotation' body_a='b{k}' {near} {on} {side} {limits} {law} /")
            lines.append(f"&sensor name='t{k}' quantity='stop' stop='t{k}' /")
        before = angle
        for quantity in ("position", "velocity", "acceleration"):
            lines.append(f"&sensor name='{quantity}{k}' quantity='{quantity}' body='b{k}' {end} /")
        on, at = f"body_b='b{k}'", far
        x, y = x + length * cos(angle), y + length * sin(angle)
    if dice.random() < 0.3:
        lines.append("&history name='h' kind='cycloid' start_value=0.1 end_value=0.5 start=0.0 finish=0.1 /")
        rate = dice.choice([".true.", ".false."])
        lines.append(f"&drive name='d' type='rotation' body_a='b0' history='h' relative=.true. rate={rate} /")
    return "\n".join(lines) + "\n"


def transient(dice: random.Random, method: str) -> str:
    """Return the &transient group: outputs at or between steps, a few checkpoints (each waits for the disk)."""
    output = dice.choice([1e-3, 2e-3, 5e-3]) if method.endswith("alpha") else 1e-4
    words = METHODS[method].format(step=output / dice.choice([1, 2, 3, 10]), small=output / 120)
    end = ROWS * output
    interval = end / dice.uniform(4, 9)
    words += dice.choice(["", "", "", " check_error=.true."])
    return f"&transient t_end={end:.17g} output_step={output:.17g} checkpoint_interval={interval:.17g} {words} /\n"


class Runner:
    """A folder with a deck, and runs of it."""

    def __init__(self, biela, folder, deck):
        """Write the deck."""
        self.biela, self.folder, self.results = biela, folder, folder / "results" / "scene"
        (folder / "scene.nml").write_text(deck, encoding="utf-8")

    def run(self, *options: str, limit: int | None = None) -> int:
        """Return the exit status of a run whose files may not grow beyond the limit."""

        def hold():
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

        return subprocess.run(
            [str(self.biela), "--quiet", *options, "scene.nml"],
            cwd=self.folder,
            capture_output=True,
            timeout=TIMEOUT,
            check=False,
            preexec_fn=hold if limit else None,
        ).returncode

    def killed(self, name: str, size: int) -> bool | None:
        """Kill a run when a result has grown to a size; None: it was faster."""
        file = self.results / name
        shutil.rmtree(self.results)
        process = subprocess.Popen([str(self.biela), "--quiet", "scene.nml"], cwd=self.folder)
        while process.poll() is None and not (file.exists() and file.stat().st_size >= size):
            time.sleep(0.0005)
        process.kill()
        return True if process.wait(timeout=TIMEOUT) else None

    def files(self) -> dict[str, bytes]:
        """Return the bytes of every result, without the lines of times; a checkpoint knows how often the run was restarted."""
        found = {path.name: path.read_bytes() for path in self.results.iterdir() if path.name not in (".lock", "checkpoint")}
        return {name: untimed(text) for name, text in found.items()}


def restarted(biela, folder, seed: int, method: str) -> int:
    """Cut a scene off at random places and continue it each time; return how often a checkpoint was there to continue from."""
    dice = random.Random(seed)
    place = Runner(biela, folder, scene(dice) + transient(dice, method))
    status = place.run()
    assert status in (0, 1), f"seed {seed}"
    whole = place.files()
    continued = 0
    for _ in range(CUTS):
        shutil.rmtree(place.results)
        cut = place.run(limit=int(dice.uniform(0.3, 0.95) * len(whole["history.txt"])))
        if not (place.results / "checkpoint").exists():
            continue
        assert cut != 0, f"seed {seed}"
        assert place.run("--restart") == status, f"seed {seed}"
        found = place.files()
        assert [name for name in whole if found.get(name) != whole[name]] == [], f"seed {seed}"
        continued += 1
    return continued


@pytest.mark.parametrize("method", METHODS)
def test_random_scenes_cut_off_anywhere(method, biela, tmp_path):
    seeds = range(309, 319) if method == "fixed generalized_alpha" else range(300, 303)
    continued = 0
    for seed in seeds:
        folder = tmp_path / str(seed)
        folder.mkdir()
        continued += restarted(biela, folder, seed, method)
    assert continued >= len(seeds)


def whole_after_cuts(place: Runner, parts: tuple[float, ...] = (0.3, 0.5, 0.7, 0.9), second: bool = False) -> dict[str, bytes]:
    """Cut a run off at parts of its history and continue it each time; return the files of the uninterrupted one.

    With `second` at parts of the history of the second run, which tells errors.
    """
    assert place.run() == 0
    whole = place.files()
    for part in parts:
        size = int(part * len(whole["history.txt"]))
        if second:
            caught(lambda size=size: place.killed("history.txt.new1", size))
        else:
            shutil.rmtree(place.results)
            assert place.run(limit=size) != 0
        assert place.run("--restart") == 0
        assert place.files() == whole, f"cut at {part}"
    return whole


@pytest.mark.parametrize("method", ["method='dopri5' tolerance=1e-6", "method='generalized_alpha' step=1e-3"])
def test_between_and_at_events_of_rigid_stops_and_friction(method, biela, tmp_path):
    """Impacts, chatter, rest by friction beside a closed stop: checkpoints in each of these states."""
    deck = f"""&scene gravity=0.0,-9.81 /
&body name='a' mass=1.0 inertia=0.01 com=0.15,0.0 angle=-0.3 angular_velocity=3.0 /
&body name='c' mass=0.6 inertia=0.006 com=0.15,0.0 position={{0.3*cos(-0.3)}},{{0.3*sin(-0.3)}} angle=-0.8 angular_velocity=-4.0 /
&joint name='p' type='revolute' body_a='a' friction=0.3 friction_static=0.4 pin_radius=0.04 /
&joint name='q' type='revolute' body_a='c' body_b='a' point_b=0.3,0.0 friction=0.2 friction_static=0.3 pin_radius=0.03 /
&stop name='elbow' type='rotation' body_a='c' body_b='a' lower=-0.8 upper=0.4 restitution=0.5 /
&stop name='shoulder' type='rotation' body_a='a' lower=-1.2 upper=0.3 restitution=0.3 /
&history name='h' kind='sine' amplitude=4.0 frequency=1.3 /
&force name='f' type='torque' body='a' moment=1.0 history='h' /
&sensor name='a' quantity='angle' body='a' /
&sensor name='c' quantity='angle' body='c' /
&sensor name='rub' quantity='friction' joint='q' /
&sensor name='stop' quantity='stop' stop='shoulder' /
&transient t_end=1.6 output_step=0.01 checkpoint_interval=0.0633 {method} check_error=.true. /
"""
    whole = whole_after_cuts(Runner(biela, tmp_path, deck), second=True)
    words = [line.split()[1:4:2] for line in whole["events.txt"].decode().splitlines() if not line.startswith("#")]
    assert {("p", "stuck"), ("q", "stuck"), ("shoulder", "lower"), ("elbow", "lower_rebound")} <= {tuple(pair) for pair in words}


@pytest.mark.parametrize("stiffness", [150.0, 300.0])
def test_steps_after_the_exact_elastic_block_was_used(stiffness, biela, tmp_path):
    """A beam whose spring pulls it round: Newton's method needs the exact block for a while and then leaves it."""
    deck = f"""&scene gravity=0.0,-9.81 /
&material name='m' density=1500.0 young=3.0e10 /
&section name='s' shape='rectangle' width=0.02 height=0.02 /
&body name='b' kind='beam' length=0.4 elements=3 material='m' section='s' reference='clamped' /
&joint name='j' type='revolute' body_a='b' node_a=1 /
&spring name='k' type='torsional' body_a='b' node_a=1 stiffness={stiffness} free_angle=0.5 /
&sensor name='p' quantity='position' body='b' node=-1 /
&sensor name='a' quantity='acceleration' body='b' node=-1 /
&sensor name='r' quantity='reaction' joint='j' /
&transient t_end=0.6 output_step=2e-3 checkpoint_interval=0.083 method='generalized_alpha' step=2e-3 /
"""
    whole = whole_after_cuts(Runner(biela, tmp_path, deck))
    assert json.loads(whole["summary.json"])["transient"]["exact_factorisations"] > 0


def test_a_checkpoint_between_the_ends_of_a_step(biela, tmp_path):
    """Steps that pass twenty rows: those that are left of the step after the checkpoint are read off it."""
    deck = """&scene gravity=0.0,-9.81 /
&body name='b' kind='rigid' mass=0.2 inertia=2e-3 com=0.5,0.0 /
&joint name='j' type='revolute' body_a='b' /
&sensor name='p' quantity='position' body='b' point=1.0,0.0 /
&transient t_end=3.0 output_step=0.01 checkpoint_interval=0.3 method='dopri5' tolerance=1e-3 /
"""
    whole = whole_after_cuts(Runner(biela, tmp_path, deck))
    assert json.loads(whole["summary.json"])["transient"]["steps"] < 30


CORNERS = """&body name='arm' mass=1.0 inertia=0.1 angular_velocity=1.0 /
&joint name='j' type='revolute' body_a='arm' /
&spring name='k' type='torsional' body_a='arm' stiffness=2.0 damping=0.05 free_angle=0.0 /
&sensor name='a' quantity='angle' body='arm' /
&sensor name='v' quantity='angular_velocity' body='arm' /
&history name='r' kind='pulse' value=1.0 start=0.2 finish=0.5 /
&controller name='pid' argument='a' history='r' kp=4.0 ki=8.0 kd=0.2 filter=0.01 delay=0.03 lower=-1.2 upper=1.5 windup_time=0.2 /
&force name='m' type='torque' body='arm' moment=2.0 controller='pid' /
&controller name='held' argument='v' history='r' kp=0.1 ki=0.5 lower=-0.2 upper=0.2 sample=0.02 /
&force name='s' type='torque' body='arm' moment=1.0 controller='held' /
&sensor name='c' quantity='controller' controller='pid' /
&sensor name='h' quantity='controller' controller='held' /
&body name='disc' mass=1.0 inertia=0.2 position=1.0,0.0 /
&joint name='d' type='revolute' body_a='disc' point_b=1.0,0.0 /
&history name='turn' kind='polynomial' coefficients=0.0,1.0 /
&drive name='d' body_a='disc' history='turn' /
&sensor name='b' quantity='angle' body='disc' /
&profile name='bowl' kind='circle' radius=0.25 hollow=.true. /
&body name='bead' mass=1.0 inertia=6e-4 velocity=0.9,1.3 angular_velocity=40 position=0.0,-0.19 /
&stop name='grip' type='profile' body_a='bead' radius=0.05 profile='bowl'
  friction=0.05 friction_static=0.2 stiffness=4e5 damping=0.3 /
&sensor name='rub' quantity='friction' stop='grip' /
&history name='cam' kind='table' interpolation='linear' time=-1.0,0.1,0.15,0.3,0.38,2.0 value=0.0,0.0,2.0,-1.0,1.0,1.0
  argument='b' /
&history name='to' kind='product' histories='r','cam' /
&history name='fro' kind='sum' histories='cam','r' factors=0.5,0.2 /
&history name='way' kind='switch' argument='v' histories='to','fro' level=0.1 /
&force name='l' type='torque' body='arm' moment=1.0 history='way' /
&sensor name='w' quantity='work' force='l' /
&sensor name='e' quantity='energy' body='arm' /
&body name='ball' mass=1.0 inertia=0.1 velocity=1.0,0.0 /
&stop name='wall' type='position' body_a='ball' upper=0.1 stiffness=1e3 exponent=1.0 restitution=0.8 /
&sensor name='wall' quantity='stop' stop='wall' /
&history name='up' kind='cycloid' start_value=0 end_value=5e-3 start=0 finish=0.3 /
&history name='down' kind='cycloid' start_value=5e-3 end_value=0 start=0 finish={2*pi-0.3} /
&history name='lift' kind='sequence' histories='up','down' durations=0.3,{2*pi-0.3} /
&profile name='cam' kind='law' history='lift' base_radius=0.1 radius=0.02 /
&body name='rod' mass=0.1 inertia=1e-3 position=1.0,0.12 /
&joint name='guide' type='prismatic' body_a='rod' point_b=1.0,0.0 direction={90*deg} /
&joint name='follow' type='profile' body_a='rod' radius=0.02 body_b='disc' profile='cam' /
&sensor name='follow' quantity='contact' joint='follow' /
&sensor name='cam' quantity='reaction' joint='follow' /
&sensor name='shaft' quantity='reaction' joint='d' /
&sensor name='rod' quantity='acceleration' body='rod' /
"""


@pytest.mark.parametrize(
    "method",
    [
        "'rk4' step=1e-3",
        "'dopri5' tolerance=1e-6 check_error=.true.",
        "'radau' tolerance=1e-6",
        "'generalized_alpha' step=2e-3 check_error=.true.",
    ],
)
def test_checkpoints_at_corners_saturations_samples_and_a_stop(method, biela, tmp_path):
    """At 0.1 s (a corner, a sample, a ball strikes), 0.2 s (a jump to a limit) and 0.3 s (a corner), with a delay under way."""
    deck = CORNERS + f"&transient t_end=0.4 method={method} output_step=0.005 checkpoint_interval=0.1 /\n"
    whole = whole_after_cuts(Runner(biela, tmp_path, deck), (0.49, 0.65, 0.9), second="check_error" in method)
    rows = np.loadtxt(whole["history.txt"].decode().splitlines())
    names = [name for line in whole["history.txt"].decode().splitlines() if "columns:" in line for name in line.split()[2:]]
    strikes = [line.split() for line in whole["events.txt"].decode().splitlines() if " wall open " in line]
    assert abs(float(strikes[0][0]) - 0.1) < 1e-14
    assert {-1.0, 0.0} <= set(rows[:, names.index("rub.state[-]")])
    limited = rows[:, names.index("c.limited[-]")]
    assert limited[38] == 0.0
    assert limited[44] == 1.0
    forces = rows[:, names.index("follow.f[N]")]
    (pair,) = json.loads(whole["summary.json"])["transient"]["pairs"]
    assert [pair["least_force"], pair["largest_force"]] == pytest.approx([forces.min(), forces.max()], rel=1e-12)
    assert pair["pulls_at"] == pytest.approx(0.15, abs=5e-3)


@pytest.mark.parametrize(
    "method",
    ["'rk4' step=2e-6", "'dopri5' tolerance=1e-5", "'radau' tolerance=1e-6", "'generalized_alpha' step=2e-5"],
)
def test_layers_that_slip(method, biela, tmp_path):
    """An arm with a damped cover over a part of it, in nodal coordinates with stiffening."""
    deck = f"""&material name='steel' density=7850.0 young=2.1e11 /
&material name='tape' density=1000.0 shear_modulus=4e5 ghm_alpha=1.5 ghm_zeta=1.0 ghm_omega=1500 prony_alpha=0.5 prony_tau=2e-3 /
&section name='bare' layers='steel' thickness=5e-3 width=0.025 /
&section name='clad' layers='steel','tape','steel' thickness=5e-3,0.3e-3,1.5e-3 width=0.025 /
&body name='arm' kind='beam' length=0.4 elements=3 element_section='bare','clad','bare' reference='clamped' stiffening=.true. /
&joint name='pin' type='revolute' body_a='arm' node_a=1 /
&history name='turn' kind='ramp' start_value=0.0 end_value=0.5 start=0.0 finish=0.02 /
&drive name='motor' type='rotation' body_a='arm' history='turn' /
&sensor name='edge' quantity='slip' body='arm' node=2 /
&sensor name='tape' quantity='layer' body='arm' element=2 layer=2 /
&sensor name='arm' quantity='energy' body='arm' /
&transient t_end=4e-3 method={method} output_step=2e-5 checkpoint_interval=3.3e-4 /
"""
    whole_after_cuts(Runner(biela, tmp_path, deck), (0.45, 0.8))
