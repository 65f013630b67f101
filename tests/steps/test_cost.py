"""Cost is what the scene asks: unknowns, evaluations, solves and memory allocations, counted.

Allocations are counted by a small library that stands before malloc: two runs that differ in their number of steps alone say what
a step allocates.
"""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

BEAMS = """&scene gravity=0.0,-9.81 /
&material name='plain' density=1600.0 young=2.1e10 /
&material name='damped' density=1600.0 young=2.1e10 ghm_alpha=0.5,0.2 ghm_zeta=1.0,2.0 ghm_omega=5000.0,300.0 /
&section name='s' area=1.6129e-4 inertia=8.6576e-9 /
&body name='rod' kind='beam' length=0.35 elements=4 material='{material}' section='s' {rod} /
&joint name='pin' type='revolute' body_a='rod' node_a=1 /
&sensor name='rod' quantity='angle' body='rod' /
{more}&transient t_end={t_end} method='rk4' step=1.0e-6 output_step=1.0e-4 /
"""
RIGID = """&scene gravity=0.0,-9.81 /
&body name='rod' kind='rigid' mass={mass} inertia={inertia} com=0.175,0.0 /
&joint name='pin' type='revolute' body_a='rod' /
&sensor name='rod' quantity='angle' body='rod' /
&transient t_end=0.001 method='rk4' step=1.0e-6 output_step=1.0e-4 /
"""
IDLE = """&material name='idle' density=1000.0 young=1.0e9 ghm_alpha=1.0 ghm_zeta=1.0 ghm_omega=1.0e9 /
&section name='idle' area=1.0e-4 inertia=1.0e-9 /
&history name='idle' kind='sine' amplitude=1.0 frequency=1.0 /
"""


def beam(material: str = "plain", rod: str = "", more: str = "", t_end: float = 0.001) -> str:
    return BEAMS.format(material=material, rod=rod, more=more, t_end=t_end)


def counts(run) -> dict[str, int]:
    """Return what the summary counts."""
    model, march = run.figures["model"], run.transient
    found = {name: march[key] for name, key in (("steps", "steps"), ("evaluations", "evaluations"), ("solves", "banded_solves"))}
    return found | {
        "coordinates": model["coordinates"],
        "dissipative": model["dissipative_coordinates"],
        "multipliers": model["constraints"],
    }


def rows(run) -> list[str]:
    """Return the rows of the history as written."""
    return [line for line in (run.folder / "history.txt").read_text().splitlines() if not line.startswith("#")]


def test_a_rigid_twin_costs_what_a_rigid_body_costs(run_deck):
    twin = run_deck(beam("damped", "flexible=.false."), name="twin")
    mass = 1600.0 * 1.6129e-4 * 0.35
    rigid = run_deck(RIGID.format(mass=mass, inertia=mass * 0.35**2 / 12), name="rigid")
    assert counts(twin) == counts(rigid)
    assert counts(twin)["solves"] == 0
    assert counts(twin)["coordinates"] == 3
    assert twin.history["rod"][-1] == pytest.approx(rigid.history["rod"][-1], rel=1e-12)


def test_an_elastic_twin_carries_no_dissipative_coordinate(run_deck):
    damped = run_deck(beam("damped"), name="damped")
    twin = run_deck(beam("damped", "viscoelastic=.false."), name="twin")
    plain = run_deck(beam("plain"), name="plain")
    assert counts(damped)["dissipative"] == 2 * 3 * 4
    assert counts(twin) == counts(plain)
    assert counts(twin)["dissipative"] == 0
    assert rows(twin) == rows(plain)


def test_groups_that_nothing_uses_add_nothing(run_deck):
    without = run_deck(beam(), name="without")
    idle = run_deck(beam(more=IDLE), name="idle")
    assert counts(idle) == counts(without)
    assert rows(idle) == rows(without)


def test_options_remove_what_they_name(run_deck):
    full = counts(run_deck(beam("damped"), name="full"))
    bending = counts(run_deck(beam("damped", "axial=.false."), name="bending"))
    modal = counts(run_deck(beam("damped", "modes=2"), name="modal"))
    assert (full["coordinates"], bending["coordinates"], modal["coordinates"]) == (3 + 12, 3 + 8, 3 + 2)
    assert (full["dissipative"], bending["dissipative"], modal["dissipative"]) == (24, 16, 4)
    assert full["evaluations"] == bending["evaluations"] == modal["evaluations"]
    assert modal["solves"] == 0


def test_an_evaluation_solves_twice_for_each_flexible_body(run_deck):
    found = counts(run_deck(beam("damped")))
    assert found["steps"] == 1000
    assert 4 * found["steps"] <= found["evaluations"] <= 4 * found["steps"] + 8
    assert found["solves"] <= 2 * found["evaluations"]


def test_small_steps_look_at_corners_of_loads_when_they_get_there(run_deck):
    """Where a force has a corner the pads that hold are looked at anew: not in each microsecond before."""
    deck = "&scene gravity=0.0,-9.81 /\n&body name='b' mass=1.0 inertia=1.0 /\n"
    deck += "&joint name='rail' type='prismatic' body_a='b' friction=0.3 /\n&force name='f' body='b' fx=1.0 history='h' /\n"
    deck += "&history name='h' kind='table' time=0.0,5.0e-4,1.0e-3 value=0.0,2.0,0.0 /\n"
    deck += "&sensor name='x' quantity='position' body='b' /\n"
    found = counts(run_deck(deck + "&transient method='rk4' t_end=1.0e-3 step=1.0e-6 output_step=1.0e-4 /\n"))
    assert found["steps"] == 1000
    assert 4000 <= found["evaluations"] < 4050


@pytest.mark.skipif(shutil.which("gcc") is None, reason="the counter of allocations is built with gcc")
def test_no_step_allocates(biela: Path, tmp_path: Path):
    """Counts calls of malloc, calloc and realloc of two runs that differ in their steps only, by a library loaded before."""
    if biela.name.endswith("-debug"):
        pytest.skip("the checked build makes temporary arrays")
    source = tmp_path / "counter.c"
    source.write_text(
        """#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
static unsigned long calls;
extern void *__libc_malloc(size_t); extern void *__libc_calloc(size_t, size_t); extern void *__libc_realloc(void *, size_t);
void *malloc(size_t n) { calls++; return __libc_malloc(n); }
void *calloc(size_t n, size_t m) { calls++; return __libc_calloc(n, m); }
void *realloc(void *p, size_t n) { calls++; return __libc_realloc(p, n); }
__attribute__((destructor)) static void tell(void) { fprintf(stderr, "allocations %lu\\n", calls); }
"""
    )
    library = tmp_path / "counter.so"
    subprocess.run(["gcc", "-shared", "-fPIC", "-O1", "-o", str(library), str(source)], check=True, timeout=60)

    def allocations(material: str, rod: str, step: float) -> int:
        deck = beam(material, rod, t_end=0.01).replace("step=1.0e-6 output_step=1.0e-4", f"step={step} output_step=1.0e-3")
        (tmp_path / "deck.nml").write_text(deck)
        done = subprocess.run(
            [str(biela), "--quiet", "--output", "out", "deck.nml"],
            cwd=tmp_path,
            env={"LD_PRELOAD": str(library)},
            capture_output=True,
            text=True,
            check=True,
            timeout=60,
        )
        return int(re.search(r"allocations (\d+)", done.stderr)[1])

    models = [("plain", ""), ("damped", ""), ("damped", "axial=.false."), ("damped", "modes=2"), ("plain", "flexible=.false.")]
    for material, rod in models:
        more = allocations(material, rod, 1.0e-6) - allocations(material, rod, 2.0e-6)
        # the seconds that a summary states are written with as many digits as they need, each trial of which allocates
        assert more <= 250, f"{material} {rod}: {more} allocations in 5000 further steps"


@pytest.mark.parametrize("method", ["rk4", "dopri5", "radau", "generalized_alpha"])
def test_turns_made_cost_nothing(run_deck, method):
    """The last digits of a large angle open a joint; which no correction mends: none is tried. A second chain stays as closed."""

    def run(turns):
        deck = f"""&scene gravity=0,-9.81 /
&body name='a' mass=1 inertia=0.02 com=0.1,0 angle={{-0.5+2*pi*{turns}}} /
&body name='b' mass=0.6 inertia=0.01 com=0.1,0 position={{0.3*cos(0.5)}},{{-0.3*sin(0.5)}} angle={{0.4+2*pi*{turns}}} /
&body name='c' mass=1 inertia=0.01 com=0.2,0 position=2,0 angle=0.3 /
&body name='d' mass=1 inertia=0.01 com=0.1,0 position={{2+0.4*cos(0.3)}},{{0.4*sin(0.3)}} /
&joint name='p' type='revolute' body_a='a' /
&joint name='q' type='revolute' body_a='b' body_b='a' point_b=0.3,0 /
&joint name='r' type='revolute' body_a='c' point_b=2,0 /
&joint name='s' type='revolute' body_a='d' body_b='c' point_b=0.4,0 /
&sensor name='far' quantity='distance' body='d' body_b='c' point_b=0.4,0 /
&transient t_end=0.3 output_step=0.01 method='{method}' step=1e-3 /
"""
        return run_deck(deck, name=f"turns{turns}")

    straight, turned = run(0), run(100000)
    assert turned.transient["evaluations"] <= 1.01 * straight.transient["evaluations"]
    assert turned.history["far"].max() < 1e-14
    assert turned.energy["position_violation"].max() < 4e-16 * 6.3e5
