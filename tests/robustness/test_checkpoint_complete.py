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
    ("time_stepper", "stepper", "time_stepper", "self"): {
        *("trouble", "tried", "trial", "settings", "norm"),
        *("cause", "next_stop", "output_due", "roots", "path", "degree", "inner"),
    },
    ("time_stepper", "root_watch", "time_stepper", "r"): {"end", "zero", "locating"},
    ("fixed_step", "fixed_stepper", "fixed_step", "self"): {"method", "stage"},
    ("step_control", "step_controller", "adaptive_pair", "self%control"): {"order"},
    ("step_control", "error_norm", "adaptive_pair", "self%norm"): {
        *("group", "floor", "rate", "slope", "fastest", "bound", "steady"),
        "scale",
    },
    ("adaptive_pair", "adaptive_stepper", "adaptive_pair", "self"): {
        *("error", "last", "moved", "slope", "reaches_output"),
    },
    ("implicit_march", "implicit_stepper", "implicit_march", "self"): set(),
    ("step_control", "error_norm", "implicit_march", "self%norm"): {
        *("group", "floor", "rate", "slope", "fastest", "bound", "steady", "scale", "steepest", "noise"),
    },
    ("radau_stepper", "step_memory", "radau_stepper", "self%memory"): set(),
    ("alpha_stepper", "alpha_march", "alpha_stepper", "self"): {"spectral_radius"},
    ("alpha_state", "alpha_solver", "alpha_state", "self"): {
        *("method", "nq", "nz", "nzd", "x1", "v1", "vd1", "lambda1", "dx", "dlambda", "needs_factors", "h_tried"),
        *("gaps", "gain", "resolved", "r", "closing", "closing_lambda", "offset1", "by_group", "by_scene"),
    },
    ("alpha_state", "energy_sums", "alpha_state", "self%energy"): {"pairs", "next"},
    ("alpha_state", "newton_memory", "alpha_state", "self%newton"): set(),
    ("radau_stepper", "radau_march", "radau_stepper", "self"): set(),
    ("radau_stages", "radau_stage_values", "radau_stages", "self"): {
        *("method", "nq", "nz", "nzd", "rows", "t", "h", "q", "v", "a", "u", "lambda", "work"),
    },
    ("radau_stages", "inner_values", "radau_stages", "self%inner"): {
        *("viscosity", "inertia", "z", "zd", "dz", "u", "delta0", "delta"),
        *("h", "gain", "start", "real_gain", "rate_gap", "driving"),
    },
    ("results", "result_set", "results", "self"): {"incomplete", "values", "used", "suffix"},
    ("energy_balance", "balance_watch", "energy_balance", "self"): {"least", "strain", "along", "columns"},
    ("stored_pass", "pass_rows", "stored_pass", "self"): {"output_step", "t_end"},
    ("text_file", "result_file", "text_file", "self"): {"buffer", "failed", "handle", "used", "written"},
    ("validity", "validity_watch", "transient", "run%watch"): {"weight"},
    ("step_monitor", "stability_monitor", "transient", "x"): {
        *("active", "every", "steps", "method", "pole_step", "step", "ratio", "fastest", "fast", "motions", "mode"),
    },
}


def source(file: str) -> str:
    """Return the text of a file of the sources."""
    (path,) = (ROOT / "src").rglob(f"{file}.f90")
    return path.read_text(encoding="utf-8")


def components(file: str, name: str) -> set[str]:
    """Return the names of a derived type's components."""
    text = source(file)
    body = re.search(rf"^  type[^\n]*:: {name}\n(.*?)^  (?:contains|end type)", text, re.MULTILINE | re.DOTALL)[1]
    found = set()
    for line in body.splitlines():
        declared = line.split("!")[0]
        if "::" in declared:
            names = re.sub(r"\([^()]*\)", "", declared.split("::")[1])
            found |= {word.split("=")[0].strip() for word in names.split(",") if word.strip()}
    return found


def saved(file: str, prefix: str) -> set[str]:
    """Return the components that the exchange routines of a file name behind the prefix."""
    text = source(file)
    bodies = re.findall(r"subroutine \w*exchange\w*\(self.*?end subroutine", text, re.DOTALL)
    lines = [line for body in bodies for line in body.splitlines() if "exchange" in line]
    return {name for line in lines for name in re.findall(re.escape(prefix) + r"%(\w+)", line)}


@pytest.mark.parametrize("place", LEFT_OUT, ids=lambda place: place[1])
def test_every_component_is_saved_or_known_to_be_made_again(place):
    file, name, routine, prefix = place
    declared = components(file, name)
    assert LEFT_OUT[place] <= declared, "a component that no longer exists"
    assert declared - saved(routine, prefix) == LEFT_OUT[place]
