"""A part of `make extremes`: one factor at a time without the longest runs, and 60 random mixtures."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "extremes"))

import extreme_factors as factors
import extreme_implicit as implicit
import extreme_measures
import friction_shares
from extreme_cases import judge
from extreme_mixtures import implicit_mixture, mixture
from extremes import picture_of_factors, text

QUICK = [
    factors.steps_at_the_limit,
    factors.beams,
    factors.damping,
    factors.masses,
    factors.spins,
    factors.singular_positions,
    factors.loads,
    factors.units,
    factors.drives,
    factors.stops,
    factors.rigid_stops,
    factors.friction,
]
LONG = re.compile(r"^dopri5 \S+ disc$")  # an undamped mode of which dopri5 loses 3e-5 a step


@pytest.mark.parametrize("family", QUICK, ids=lambda family: family.__name__)
def test_every_case_of_a_factor_is_as_stated(family, biela, tmp_path):
    assert biela.exists()
    cases = [case for case in family() if not LONG.search(f"{case.method} {case.value}")]
    part = {factors.masses: 4, factors.steps_at_the_limit: 4, factors.stops: 9, factors.rigid_stops: 13, factors.friction: 9}
    rows = [judge(case) for case in cases[:: part.get(family, 1)]]
    assert len(rows) >= 4
    assert all(row.passed for row in rows), text([row for row in rows if not row.passed], 0, 0.0)
    if family is factors.spins:
        rows.append(replace(rows[0], case=replace(rows[0].case, limit=0.0)))  # a figure that has to be zero
        picture_of_factors(rows, tmp_path / "factors.png")
        assert (tmp_path / "factors.png").stat().st_size > 5000


@pytest.mark.parametrize("method", implicit.METHODS)
@pytest.mark.parametrize(
    "family", [implicit.far_above_the_bound, implicit.beams, implicit.spinning], ids=lambda family: family.__name__
)
def test_every_case_of_the_implicit_methods_is_as_stated(family, method, biela):
    assert biela.exists()
    rows = [judge(case) for case in family(method)]
    assert all(row.passed for row in rows), text([row for row in rows if not row.passed], 0, 0.0)


@pytest.mark.parametrize(("number", "state"), [(9, "moves"), (40, "held"), (203, "moves"), (221, "moves")])
def test_friction_holds_where_a_search_finds_shares(number, state, biela):
    assert biela.exists()
    _, found, excess = friction_shares.judge(number)
    assert found == state
    assert (excess < -0.1) == (found == "held")


def test_the_search_of_shares_runs_by_itself(biela):
    command = [sys.executable, friction_shares.__file__, "31", "31"]
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"} | {"BIELA": str(biela)}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert (done.returncode, done.stdout) == (0, "1 sets, 1 can be held, 1 agree, 0 held wrongly\n"), done.stderr


def test_poles_far_above_the_motion_take_steps_of_the_motion_with_radau(biela):
    assert biela.exists()
    rows = [judge(case) for case in implicit.stiff()]
    assert len(rows) >= 4
    assert all(row.passed for row in rows), text([row for row in rows if not row.passed], 0, 0.0)


def test_damping_of_every_kind_with_radau(biela):
    assert biela.exists()
    rows = [judge(case) for case in implicit.damping(factors.FACTORS)[::2]]
    rows += [judge(implicit.twin(case)) for case in factors.masses()[:12:3]]
    assert all(row.passed for row in rows), text([row for row in rows if not row.passed], 0, 0.0)


def test_random_mixtures_with_the_implicit_method(biela):
    assert biela.exists()
    rows = [judge(implicit_mixture(7, number)) for number in range(20)]
    assert all(row.passed for row in rows), text([row for row in rows if not row.passed], 7, 0.0)


@pytest.mark.parametrize("start", [0, 10, 20, 30])
def test_random_mixtures_are_as_stated(start, biela):
    assert biela.exists()
    rows = [judge(mixture(7, number)) for number in range(start, start + 10)]
    assert all(row.passed for row in rows), text([row for row in rows if not row.passed], 7, 0.0)


def test_a_case_that_is_not_as_stated_fails(biela):
    assert biela.exists()
    good = factors.drives()[0]
    wrong = [
        factors.Case(good.factor, good.value, good.deck, "runs"),
        factors.Case(good.factor, good.value, good.deck, "refuses", 2, "no such words"),
        factors.Case("torque", "1", factors.loads()[5].deck, "turns", measure=extreme_measures.largest, limit=0.0),
    ]
    assert not any(judge(case).passed for case in wrong)
