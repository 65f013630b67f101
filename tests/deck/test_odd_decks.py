"""Decks that nobody would write, or only by mistake: the right answer or one clear sentence, never a crash or a NaN."""

from __future__ import annotations

import subprocess

import numpy as np
import pytest

GRAVITY = "&scene gravity=0.0,-9.81 /\n"
STEEL = "&material name='m' density=1000.0 young=1.0e9 /\n&section name='s' shape='rectangle' width=0.02 height=0.02 /\n"
BEAM = "&body name='b' kind='beam' length=1.0 elements=2 material='m' section='s' {} /\n"
PIN = "&joint name='j' type='revolute' body_a='b' node_a=1 /\n"
TIP = "&sensor name='p' quantity='position' body='b' node=-1 /\n"
ROD = "&body name='{}' kind='rigid' mass={} inertia={} com=0.5,0.0 position={},0.0 {} /\n"
ENDS = "&joint name='j' type='weld' body_a='b' node_a=1 /\n&joint name='k' type='weld' body_a='b' node_a=-1 point_b=1.0,0.0 /\n"
RUNS = {
    "rk4": "&transient method='rk4' step=1.0e-5 t_end=0.01 output_step=1.0e-3 /\n",
    "dopri5": "&transient method='dopri5' tolerance=1.0e-8 t_end=0.01 output_step=1.0e-3 /\n",
    "fixed": "&transient method='generalized_alpha' step=1.0e-5 t_end=0.01 output_step=1.0e-3 /\n",
    "adaptive": "&transient method='radau' tolerance=1.0e-8 t_end=0.01 output_step=1.0e-3 /\n",
}


def run(biela, folder, deck):
    """Return the status, the messages and the rows of history.txt (None without) of a deck's text."""
    (folder / "d.nml").write_text(deck, encoding="utf-8")
    done = subprocess.run(
        [biela, "--quiet", "--output", "out", "d.nml"], cwd=folder, capture_output=True, text=True, timeout=600, check=False
    )
    told = done.stderr + done.stdout
    assert done.returncode in (0, 1, 2), told
    assert "Backtrace" not in told
    assert "NaN" not in told
    path = folder / "out" / "history.txt"
    rows = np.loadtxt(path, ndmin=2) if path.exists() else None
    assert rows is None or np.isfinite(rows).all()
    return done.returncode, told, rows


@pytest.mark.parametrize("method", RUNS)
def test_a_heavy_beam_on_a_light_link_with_a_doubled_joint_moves_as_with_a_single_one(method, biela, tmp_path):
    """Redundant and very uneven at once: a link a millionth of a millionth of the lump below it."""
    base = GRAVITY + STEEL + ROD.format("c", 1e-9, 1e-10, 0.0, "") + BEAM.format("position=1.0,0.0")
    base += "&lump body='b' node=-1 mass=1.0e3 /\n&joint name='g' type='revolute' body_a='c' /\n" + TIP
    joint = "&joint name='{}' type='revolute' body_a='b' node_a=1 body_b='c' point_b=1.0,0.0 /\n"
    found = []
    for joints in (joint.format("j"), joint.format("j") + joint.format("k")):
        status, told, rows = run(biela, tmp_path, base + joints + RUNS[method])
        assert status == 0, told
        found.append(rows)
    fallen = 1.0 - found[0][:, 2].min()
    assert fallen > 1e-4
    assert np.abs(found[1] - found[0]).max() < 1e-6 * fallen


@pytest.mark.parametrize("method", RUNS)
@pytest.mark.parametrize("more", ["", "axial=.false.", "flexible=.false.", "modes=2", "stiffening=.true."])
def test_a_beam_welded_at_both_ends_stays_and_names_no_absurd_frequency(more, method, biela, tmp_path):
    status, told, rows = run(biela, tmp_path, GRAVITY + STEEL + BEAM.format(more) + ENDS + TIP + RUNS[method])
    assert status == 0, told
    assert np.abs(rows[:, 1:] - [1.0, 0.0]).max() < 1e-12
    assert "E+" not in told


@pytest.mark.parametrize("method", RUNS)
def test_a_body_without_joints_or_places_flies_on(method, biela, tmp_path):
    deck = ROD.format("b", 1.0, 0.1, 0.0, "velocity=1.0,0.0 angular_velocity=2.0")
    deck += "&sensor name='a' quantity='angle' body='b' /\n"
    status, told, rows = run(biela, tmp_path, deck + RUNS[method])
    assert status == 0, told
    assert rows[:, 1] == pytest.approx(2.0 * rows[:, 0], abs=1e-14)


@pytest.mark.parametrize("method", RUNS)
def test_drives_that_contradict_each_other_stop_with_their_names(method, biela, tmp_path):
    deck = ROD.format("b", 1.0, 0.1, 0.0, "") + "&joint name='j' type='revolute' body_a='b' /\n"
    for name, third in (("d", 0.0), ("e", 1.0)):
        deck += f"&history name='{name}' kind='polynomial' coefficients=0.0,1.0,{third} /\n"
        deck += f"&drive name='{name}' type='rotation' body_a='b' history='{name}' /\n"
    status, told, _ = run(biela, tmp_path, deck + RUNS[method])
    assert status == 1
    assert "drives may demand the impossible" in told
    assert '"d"' in told


@pytest.mark.parametrize("method", RUNS)
def test_the_same_drive_twice_turns_as_one(method, biela, tmp_path):
    deck = ROD.format("b", 1.0, 0.1, 0.0, "") + "&joint name='j' type='revolute' body_a='b' /\n"
    deck += "&history name='h' kind='polynomial' coefficients=0.0,3.0 /\n&sensor name='a' quantity='angle' body='b' /\n"
    deck += "".join(f"&drive name='{name}' type='rotation' body_a='b' history='h' /\n" for name in "de")
    status, told, rows = run(biela, tmp_path, deck + RUNS[method])
    assert status == 0, told
    assert rows[:, 1] == pytest.approx(3.0 * rows[:, 0], abs=1e-12)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("&spring name='x' type='linear' body_a='b' node_a=-1 point_b=1.0,0.0 stiffness=1.0 free_length=0.5 /", "no direction"),
        ("&spring name='x' type='linear' body_a='b' node_a=2 body_b='b' node_b=2 stiffness=1.0 /", "cannot move relative"),
        ("&joint name='x' type='distance' body_a='b' node_a=-1 point_b=1.0,0.0 /", "no length"),
        ("&joint name='x' type='revolute' body_a='b' node_a=3 body_b='b' node_b=3 /", "cannot move relative"),
        ("&force name='x' type='force' body='b' node=-1 fy=1.0e300 /", "out of range"),
    ],
)
def test_what_cannot_be_meant_is_refused(more, said, biela, tmp_path):
    status, told, _ = run(biela, tmp_path, GRAVITY + STEEL + BEAM.format("") + PIN + TIP + more + "\n" + RUNS["rk4"])
    assert status == 2
    assert said in told


@pytest.mark.parametrize(("t_end", "rows"), [("0.01", 4), ("1.0e-9", 2)])
def test_rows_where_outputs_do_not_fit(t_end, rows, biela, tmp_path):
    """0.0033 s does not divide the run: the last row is at t_end; a run may be shorter than any step would be."""
    output = "output_step=0.0033" if t_end == "0.01" else "output_step=1.0e-9"
    group = f"&transient method='dopri5' tolerance=1.0e-8 t_end={t_end} {output} /\n"
    status, told, found = run(biela, tmp_path, GRAVITY + STEEL + BEAM.format("") + PIN + TIP + group)
    assert status == 0, told
    assert len(found) == rows + (t_end == "0.01")
    assert found[-1, 0] == pytest.approx(float(t_end))


@pytest.mark.parametrize(
    ("more", "most"),
    [("axial=.false.", 4), ("", 6), ("reference='clamped' axial=.false.", 4), ("reference='clamped'", 6)],
    ids=["free, bending", "free", "clamped, bending", "clamped"],
)
def test_all_elastic_modes_of_a_mesh_may_be_kept_and_no_more(more, most, biela, tmp_path):
    """Three nodes have 6 coordinates in bending, 9 with stretching; two or three of a free body's modes are rigid."""
    reference = "" if "reference" in more else "reference='free'"
    for modes in (most, most + 1):
        status, told, _ = run(biela, tmp_path, STEEL + BEAM.format(f"{reference} {more} modes={modes}") + TIP + RUNS["fixed"])
        assert status == (0 if modes == most else 2)
        assert (f"expected at most {most}" in told) == (modes > most)


@pytest.mark.parametrize("method", ["generalized_alpha' step=0.01", "radau' step=0.01", "radau' tolerance=1e-6"])
@pytest.mark.parametrize("kind", ["mass=1.0 inertia=0.1", "kind='beam' length=1.0 elements=2 material='s' section='q'"])
@pytest.mark.parametrize("joint", ["", "&joint name='j' type='revolute' body_a='b' {} /\n"])
def test_a_body_at_rest_stays_without_a_division_by_what_does_not_move(joint, kind, method, biela, tmp_path):
    """Every correction is 0: its contraction is 0/0 in a build that traps such operations."""
    deck = "&material name='s' density=7850.0 young=2.1e11 /\n&section name='q' area=1e-4 inertia=1e-9 /\n"
    deck += f"&body name='b' {kind} /\n" + joint.format("node_a=1" if "beam" in kind else "")
    deck += "&sensor name='a' quantity='angle' body='b' " + ("node=1" if "beam" in kind else "") + " /\n"
    deck += f"&transient t_end=0.1 output_step=0.05 method='{method} /\n"
    status, told, rows = run(biela, tmp_path, deck)
    assert status == 0, told
    assert np.array_equal(rows[:, 1], [0.0, 0.0, 0.0])


@pytest.mark.parametrize("method", ["dopri5", "radau"])
def test_a_point_that_is_measured_does_not_move_the_scene(method, run_deck):
    """However far away: steps and accuracy are those of the deck without its sensor."""
    deck = f"""&scene gravity=0.0,-9.81 /
&material name='m' density=1000.0 young=1.0e9 /
&section name='s' shape='circle' diameter=0.02 /
&body name='rod' kind='beam' length=0.5 elements=2 material='m' section='s' /
&body name='bar' kind='rigid' mass=1.0 inertia=0.1 position=0.5,0.0 /
&joint name='pin' type='revolute' body_a='rod' node_a=1 /
&joint name='knee' type='revolute' body_a='bar' body_b='rod' node_b=-1 /
&sensor name='bar' quantity='angular_velocity' body='rod' node=-1 /
&transient t_end=0.05 method='{method}' tolerance=1e-6 output_step=0.01 /
"""
    sensor = "&sensor name='far' quantity='position' body='bar' point=0.0,1e12 /\n"
    runs = [run_deck(text, name=name).history for name, text in (("plain", deck), ("far", deck + sensor))]
    np.testing.assert_array_equal(runs[0]["bar"], runs[1]["bar"])


def test_a_frame_far_from_the_origin_of_its_axes(run_deck):
    """Its nodes, 200 km away, hold it as they do near by: u and v of the first one, v of the last one."""
    frame = "&body name='b' kind='frame' node_x=0.0,0.5,0.5 node_y=2.0e5,2.0e5,200000.4 element_nodes=1,2,2,3 position=0.0,-2.0e5\n"
    run_deck(STEEL + frame + "material='m' section='s' reference='pinned' /\n" + PIN + TIP + RUNS["fixed"], "--check")


@pytest.mark.parametrize(("more", "said"), [("", 0), ("reference_node=1,1,-1,-1 reference_dof='u','v','v','u'", 1)])
def test_more_reference_conditions_than_needed_are_told(biela, tmp_path, more, said):
    deck = STEEL + BEAM.format(more) + PIN + TIP + GRAVITY + RUNS["rk4"]
    status, told, _ = run(biela, tmp_path, deck)
    assert status == 0
    assert told.count('body "b" has 1 reference conditions more than needed') == said
    words = (tmp_path / "out" / "summary.txt").read_text(encoding="utf-8").split("deck text")[0]
    assert words.count("; 1 reference conditions more than needed: stiffer than the structure") == said
