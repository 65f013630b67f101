"""Checkpoints hold every component of a run's state: each component is saved, or stands in a list that says why it need not be.

Interrupted runs are compared bit for bit elsewhere, at whatever moment the signal falls; a component that matters only next to
a singular position or while a step is divided is hardly ever hit that way.
"""

from __future__ import annotations

import re

import pytest
from conftest import ROOT

# (file of the type, type, file of its exchange routine, what stands before the component there): components left out, because the
# deck gives them again, set-up makes them anew, or the next step does before it reads them.
LEFT_OUT: dict[tuple[str, str, str, str], set[str]] = {
    ("integrate/time_stepper", "stepper", "integrate/time_stepper", "self"): {"trouble", "tried", "trial"},
    ("integrate/fixed_step", "fixed_stepper", "integrate/fixed_step", "self"): {"method", "step"},
    ("integrate/step_control", "step_controller", "integrate/step_control", "self"): {"order"},
    ("integrate/step_control", "error_norm", "integrate/adaptive_dopri5", "self%norm"): {
        *("group", "floor", "rate", "slope", "fastest"),
        "scale",
    },
    ("integrate/adaptive_dopri5", "adaptive_stepper", "integrate/adaptive_dopri5", "self"): {
        *("tolerance", "first_step", "max_step", "stops", "jumps"),
        *("error", "k7", "moved", "slope"),
    },
    ("integrate/generalized_alpha", "step_memory", "integrate/alpha_march", "self%memory"): set(),
    ("integrate/alpha_march", "alpha_steps", "integrate/alpha_march", "self"): {
        *("spectral_radius", "adaptive", "step", "tolerance", "first_step", "max_step", "stops", "jumps"),
        "error",
    },
    ("integrate/alpha_state", "alpha_solver", "integrate/alpha_state", "self"): {
        *("method", "nq", "nz", "nzd", "x1", "v1", "vd1", "lambda1", "dx", "dlambda", "pairs", "stale"),
    },
    ("integrate/alpha_state", "position_measures", "integrate/alpha_state", "self%measure"): {"group", "grows", "weight", "whole"},
    ("integrate/alpha_state", "newton_memory", "integrate/alpha_state", "self%newton"): set(),
    ("integrate/alpha_state", "error_memory", "integrate/alpha_state", "self%error"): {"next"},
    ("output/results", "result_set", "output/results", "self"): {"incomplete", "nodes", "values"},
    ("analysis/energy_balance", "balance_watch", "analysis/energy_balance", "self"): {"least", "strain"},
    ("analysis/error_check", "error_watch", "analysis/error_check", "self"): {"active", "factor"},
    ("output/text_file", "result_file", "output/text_file", "self"): {"buffer", "failed", "handle", "path", "used"},
    ("output/validity", "validity_watch", "output/validity", "self"): {"weight"},
    ("analysis/step_monitor", "stability_monitor", "analysis/step_monitor", "self"): {
        *("active", "every", "steps", "method", "pole_step", "mode_step", "start_lambda", "fastest", "fast"),
        *("covered", "least", "a", "lambda"),
    },
}


def components(path: str, name: str) -> set[str]:
    """Return the names of a derived type's components."""
    text = (ROOT / "src" / f"{path}.f90").read_text(encoding="utf-8")
    body = re.search(rf"^  type[^\n]*:: {name}\n(.*?)^  (?:contains|end type)", text, re.MULTILINE | re.DOTALL)[1]
    found = set()
    for line in body.splitlines():
        declared = line.split("!")[0]
        if "::" in declared:
            names = re.sub(r"\([^()]*\)", "", declared.split("::")[1])
            found |= {word.split("=")[0].strip() for word in names.split(",") if word.strip()}
    return found


def saved(path: str, prefix: str) -> set[str]:
    """Return the components that the exchange routines of a file name behind the prefix."""
    text = (ROOT / "src" / f"{path}.f90").read_text(encoding="utf-8")
    bodies = re.findall(r"subroutine \w*exchange\w*\(self.*?end subroutine", text, re.DOTALL)
    lines = [line for body in bodies for line in body.splitlines() if "exchange" in line]
    return {name for line in lines for name in re.findall(re.escape(prefix) + r"%(\w+)", line)}


@pytest.mark.parametrize("place", LEFT_OUT, ids=lambda place: place[1])
def test_every_component_is_saved_or_known_to_be_made_again(place):
    path, name, routine, prefix = place
    declared = components(path, name)
    assert LEFT_OUT[place] <= declared, "a component that no longer exists"
    assert declared - saved(routine, prefix) == LEFT_OUT[place]
