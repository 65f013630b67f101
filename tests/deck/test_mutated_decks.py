"""Decks damaged at random: the solver must accept or refuse them, never crash, hang, or show a run-time error."""

from __future__ import annotations

import resource
import subprocess
from pathlib import Path

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

ROOT = Path(__file__).resolve().parents[2]
SECONDS = 300.0
MEMORY = 4 * 1024**3  # bytes of address space
FAILURES = (b"runtime error", b"Backtrace", b"SIG", b"Segmentation", b"core dumped", b"NaN", b"forrtl", b"libgfortran")

WHOLE = b"""! every group of the language
&scene title='all' gravity=0.0,-9.81 /
&material name='steel' density=7850.0 young=2.1e11 rayleigh_mass=0.1 rayleigh_stiffness=1.0e-6 /
&material name='soft' density=1200.0 young=3.0e9 ghm_alpha=0.4,0.6 ghm_zeta=1.5,2.5 ghm_omega=400.0,4000.0 /
&section name='bar' shape='rectangle' width=0.02 height=0.004 /
&section name='pipe' shape='tube' outer=0.02 inner=0.01 /
&section name='plain' area=1.0e-4 inertia=1.0e-9 /
&body name='crank' kind='rigid' mass=0.3 inertia=4.0e-4 com=0.05,0.0 angle=1.5707963267948966 /
&body name='coupler' kind='beam' length=0.35 elements=3 material='soft' section='bar' position=0.0,0.1 angle=0.4 /
&body name='rocker' kind='frame' node_x=0.0,0.14,0.28 node_y=3*0.0 element_nodes=1,2,2,3 material='steel'
      section='plain','pipe' position=0.4,0.0 angle=1.8 reference_node=1,1,-1 reference_dof='u','v','v' /
&lump body='rocker' node=2 mass=0.05 inertia=2.0e-5 /
&joint name='a' type='revolute' body_a='crank' /
&joint name='b' type='revolute' body_a='coupler' node_a=1 body_b='crank' point_b=0.1,0.0 /
&joint name='c' type='revolute' body_a='coupler' node_a=-1 body_b='rocker' node_b=-1 /
&joint name='d' type='revolute' body_a='rocker' node_a=1 point_b=0.4,0.0 /
&history name='spin' kind='ramp' start_value=1.5707963267948966 end_value=7.853981633974483 start=0.0 finish=0.3 /
&history name='gas' kind='table' time=0.0,0.1,0.2,0.3 value=0.0,1.0,0.5,0.0 /
&drive name='motor' type='rotation' body_a='crank' history='spin' /
&force name='push' type='force' body='coupler' node=2 fy=-1.0 axes='section' history='gas' stage='transient' /
&spring name='bush' type='torsional' body_a='rocker' node_a=1 stiffness=2.0 damping=0.01 /
&sensor name='mid' quantity='deflection' body='coupler' node=2 /
&sensor name='pin' quantity='reaction' joint='c' /
&transient t_end=0.003 method='rk4' step=5.0e-6 output_step=1.0e-3 /
"""
CRANK = b"""&material name='m' density=1600.0 young=2.1e10 ghm_alpha=0.5 ghm_zeta=1.0 ghm_omega=5000.0 /
&section name='s' area=1.6129e-4 inertia=8.6576e-9 /
&body name='rod' kind='beam' length=0.3492 elements=2 material='m' section='s' position=0.1524,0.0 /
&joint name='crank' type='distance' body_a='rod' node_a=1 point_b=0.0,0.0 length=0.1524 /
&joint name='slider' type='slider' body_a='rod' node_a=-1 direction=0.0 /
&force name='torque' type='torque_about' body='rod' node=1 centre=0.0,0.0 moment=10.0 /
&sensor name='q4' quantity='coordinate' body='rod' index=4 /
&transient t_end=0.01 step=4.0e-6 /
"""
PIECES = [
    b"&",
    b"/",
    b"'",
    b'"',
    b"=",
    b",",
    b"!",
    b"3*",
    b"99*",
    b"nan",
    b"1e400",
    b"-",
    b".",
    b"\r\n",
    b"\x00",
    b"\xff",
    b"&end",
    b"$",
    b"(1)",
    b"1.0x",
    b"-1",
    b"0",
    b"'rod'",
    b"&body ",
    b"&include file='deck.nml' /",
    b" kind='frame' ",
]


@st.composite
def damaged(draw: st.DrawFn) -> bytes:
    """Return a valid deck after a few deletions, insertions, replacements, doublings, or cut off."""
    deck = draw(st.sampled_from([WHOLE, CRANK]))
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, len(deck)))
        length = draw(st.sampled_from([1, 1, 1, 2, 5, 20, 80]))
        kind = draw(st.sampled_from(["delete", "insert", "replace", "byte", "double", "cut"]))
        if kind == "delete":
            deck = deck[:at] + deck[at + length :]
        elif kind == "insert":
            deck = deck[:at] + draw(st.sampled_from(PIECES)) + deck[at:]
        elif kind == "replace":
            deck = deck[:at] + draw(st.sampled_from(PIECES)) + deck[at + length :]
        elif kind == "byte":
            deck = deck[:at] + draw(st.binary(min_size=1, max_size=2)) + deck[at + 1 :]
        elif kind == "double":
            deck = deck[: at + length] + deck[at:]
        else:
            deck = deck[:at]
    return deck


def limit_memory():
    """Limit the memory of the solver, so that an absurd deck cannot take the machine's."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))


@given(deck=damaged())
@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture], derandomize=True)
def test_damaged_deck(biela: Path, tmp_path: Path, deck: bytes):
    (tmp_path / "deck.nml").write_bytes(deck)
    done = subprocess.run(
        [str(biela), "--check", "deck.nml"],
        cwd=tmp_path,
        capture_output=True,
        timeout=SECONDS,
        check=False,
        preexec_fn=limit_memory,
    )
    told = deck.decode(errors="replace") + "\n" + done.stderr.decode(errors="replace")
    assert done.returncode in (0, 2), told
    assert not any(word in done.stderr + done.stdout for word in FAILURES), told
    assert all(line.startswith(b"deck.nml") for line in done.stderr.splitlines()), told
    assert (done.returncode == 2) == any(b": warning: " not in line for line in done.stderr.splitlines()), told
    assert sorted(path.name for path in tmp_path.iterdir()) == ["deck.nml"]


def test_the_decks_before_the_damage(biela: Path, tmp_path: Path):
    for number, deck in enumerate([WHOLE, CRANK]):
        path = tmp_path / f"deck{number}.nml"
        path.write_bytes(deck)
        done = subprocess.run([str(biela), "--check", path.name], cwd=tmp_path, capture_output=True, timeout=SECONDS, check=False)
        assert done.returncode == 0, done.stderr.decode()
