"""Every result file: names and units of all columns, as the description of the deck states them, and what they have in common."""

from __future__ import annotations

import json
import os
import re
import subprocess
import unicodedata

import numpy as np
import pytest
from biela.histories import read

SCENE = """&scene title='all columns' /
&material name='m' density=1200.0 young=1.0e8 rayleigh_stiffness=1.0e-5 /
&section name='shape' shape='rectangle' width=0.02 height=0.012 /
&section name='bare' area=2.4e-4 inertia=2.9e-9 /
&body name='b' kind='beam' length=0.4 elements=2 material='m' section='shape' reference='clamped' /
&body name='c' kind='beam' length=0.4 elements=2 material='m' section='bare' modes=2 position=0.4,0.0 /
&joint name='o' type='weld' body_a='b' node_a=1 /
&joint name='e' type='revolute' body_a='c' node_a=1 body_b='b' node_b=-1 /
&spring name='turn' type='torsional' body_a='c' node_a=1 body_b='b' node_b=-1 stiffness=40.0 /
&spring name='pull' type='linear' body_a='c' node_a=-1 point_b=1.0,0.0 stiffness=40.0 damping=1.0 /
&force name='f' type='force' body='c' node=-1 fy=0.3 /
"""
PLACE = "body='b' node=2"
SENSORS = [
    ("position", PLACE, ["x[m]", "y[m]"]),
    ("velocity", PLACE, ["x[m/s]", "y[m/s]"]),
    ("acceleration", PLACE, ["x[m/s2]", "y[m/s2]"]),
    ("angle", PLACE, ["[rad]"]),
    ("angular_velocity", PLACE, ["[rad/s]"]),
    ("angular_acceleration", PLACE, ["[rad/s2]"]),
    ("deflection", PLACE, ["u[m]", "v[m]", "r[rad]"]),
    ("coordinate", "body='b' index=1", ["q[m]", "qd[m/s]", "qdd[m/s2]"]),
    ("coordinate", "body='b' index=2", ["q[m]", "qd[m/s]", "qdd[m/s2]"]),
    ("coordinate", "body='b' index=3", ["q[rad]", "qd[rad/s]", "qdd[rad/s2]"]),
    ("coordinate", "body='c' index=1", ["q[kg^.5*m]", "qd[kg^.5*m/s]", "qdd[kg^.5*m/s2]"]),
    ("reaction", "joint='o'", ["fx[N]", "fy[N]", "m[Nm]"]),
    (
        "internal",
        "body='b' element=1",
        ["n[N]", "q[N]", "m1[Nm]", "m2[Nm]", "s[Pa]", "n2[N]", "q2[N]", "top[Pa]", "bottom[Pa]", "along[-]"],
    ),
    ("internal", "body='c' element=1", ["n[N]", "q[N]", "m1[Nm]", "m2[Nm]", "n2[N]", "q2[N]"]),
    ("spring", "spring='turn'", ["f[Nm]", "d[rad]"]),
    ("spring", "spring='pull'", ["f[N]", "d[m]"]),
    ("position", "body='c' node=3", ["x[m]", "y[m]"]),
]
NODES = [f"{node}.{axis}[m]" for node in (1, 2, 3) for axis in "xy"]
FRAMES = [f"{body}.{name}" for body in "bc" for name in ("x[m]", "y[m]", "angle[rad]", *NODES)]
ANALYSES = """&static /
&modal modes=3 /
&frequency_response from=1.0 to=20.0 points=3 input='f' /
&transient t_end=0.001 method='rk4' step=1e-5 output_step=1e-4 motion_step=5e-4 /
"""


@pytest.fixture(scope="module")
def run(biela, tmp_path_factory):
    """Return the heads and the rows of every result file of one run with all analyses."""
    folder = tmp_path_factory.mktemp("headers")
    text = SCENE + "".join(f"&sensor name='s{k}' quantity='{q}' {place} /\n" for k, (q, place, _) in enumerate(SENSORS))
    (folder / "scene.nml").write_text(text + ANALYSES, encoding="utf-8")
    subprocess.run([str(biela), "--quiet", "scene.nml"], cwd=folder, check=True, timeout=600)
    found = {}
    for path in (folder / "results" / "scene").glob("*.txt"):
        lines = path.read_text(encoding="utf-8").splitlines()
        found[path.stem] = [x for x in lines if x.startswith("#")], [x.split() for x in lines if not x.startswith("#")]
    return found


def columns(head: list[str]) -> list[str]:
    """Return the names with units of the last comment line."""
    assert head[1:3] == ["# deck: scene", "# title: all columns"]
    assert head[-1].startswith("# columns: ")
    return head[-1].removeprefix("# columns: ").split()


def sensor_columns() -> list[str]:
    """Return the columns of all sensors."""
    return [f"s{k}{'' if n[0] == '[' else '.'}{n}" for k, (_, _, names) in enumerate(SENSORS) for n in names]


def test_files_of_a_transient(run):
    assert columns(run["history"][0]) == ["t[s]", *sensor_columns()]
    energies = [f"{n}[J]" for n in ("kinetic", "potential", "dissipated", "work", "residual")]
    assert columns(run["energy"][0]) == ["t[s]", *energies, "position_violation[m]", "velocity_violation[m/s]"]
    assert columns(run["motion"][0]) == ["t[s]", *FRAMES]
    assert [len(run[name][1]) for name in ("history", "energy", "motion")] == [11, 11, 3]
    assert [float(row[0]) for row in run["motion"][1]] == pytest.approx([0.0, 5e-4, 1e-3])


def test_static_modes_and_response(run):
    expected = ["load[-]", "residual[-]", "newton_steps[-]", *sensor_columns(), *(f"state.{n}" for n in FRAMES)]
    assert columns(run["static"][0]) == expected
    figures = "number[-] mode[-] kind[-] undamped_frequency[Hz] frequency[Hz] damping_ratio[-] loss_factor[-] real[1/s] imag[rad/s]"
    shapes = [n.replace("[", f".{part}[") for n in FRAMES for part in ("re", "im")]
    assert columns(run["modes"][0]) == [*figures.split(), "residual[-]", *shapes]
    expected = ["f[Hz]"]
    for name in sensor_columns():
        unit = name[name.index("[") :]
        stem = name.removesuffix(unit)
        expected += [f"{stem}.re{unit}", f"{stem}.im{unit}", f"{stem}.amplitude{unit}", f"{stem}.phase[rad]"]
    assert columns(run["frequency_response"][0]) == expected


def test_every_row_is_as_long_as_its_head(run):
    for name in ("history", "energy", "motion", "static", "modes", "frequency_response"):
        head, rows = run[name]
        assert rows
        assert {len(row) for row in rows} == {len(columns(head))}


def table(run, name: str) -> dict[str, np.ndarray]:
    """Return the columns of a result file by name without unit."""
    head, rows = run[name]
    names = [column.split("[")[0] for column in columns(head)]
    return dict(zip(names, np.array(rows, dtype=float).T))


def test_nodes_of_the_motion_are_where_the_sensors_are(run):
    """Nodal and modal bodies, deflected by the static stage; in static.txt too."""
    history, motion, static = (table(run, name) for name in ("history", "motion", "static"))
    last = len(SENSORS) - 1
    for sensor, node, rest in ((0, "b.2", [0.2, 0.0]), (last, "c.3", [0.8, 0.0])):
        for k, axis in enumerate("xy"):
            np.testing.assert_allclose(motion[f"{node}.{axis}"], history[f"s{sensor}.{axis}"][::5], rtol=0, atol=1e-15)
            np.testing.assert_allclose(static[f"state.{node}.{axis}"], static[f"s{sensor}.{axis}"], rtol=0, atol=1e-15)
            if axis == "y":
                assert np.abs(motion[f"{node}.y"] - rest[k]).min() > 1e-6


def test_figures_of_a_mode_follow_from_its_pole(run):
    m = table(run, "modes")
    pole = m["real"] + 1j * m["imag"]
    np.testing.assert_array_equal(m["number"], np.arange(1, len(pole) + 1))
    np.testing.assert_allclose(m["frequency"], np.abs(m["imag"]) / (2 * np.pi), rtol=1e-14)
    np.testing.assert_allclose(m["damping_ratio"], -m["real"] / np.abs(pole), rtol=1e-12, atol=0)
    np.testing.assert_allclose(m["loss_factor"], 2 * m["damping_ratio"], rtol=1e-14)
    undamped = {mode: f for mode, kind, f in zip(m["mode"], m["kind"], m["frequency"]) if kind == 0}
    np.testing.assert_allclose(m["undamped_frequency"], [undamped[mode] for mode in m["mode"]], rtol=1e-14)
    vibrations = m["kind"] == 1
    assert vibrations.sum() == 3
    assert (m["damping_ratio"][vibrations] > 1e-4).all()


def test_shapes_close_the_joints_about_a_deflected_state(run_deck):
    """A block hinged to the middle of a sagging beam that rocks on its support: both move alike in every mode."""
    text = """&scene gravity=0.0,-9.81 /
&material name='m' density=1200.0 young=1.0e7 /
&section name='s' shape='rectangle' width=0.02 height=0.012 /
&body name='beam' kind='beam' length=0.4 elements=2 material='m' section='s' /
&body name='block' kind='rigid' mass=0.1 inertia=1e-5 com=0.0,-0.02 position=0.2,0.0 /
&joint name='o' type='revolute' body_a='beam' node_a=1 /
&joint name='e' type='revolute' body_a='block' body_b='beam' node_b=2 /
&spring name='end' type='linear' body_a='beam' node_a=3 point_b=0.4,0.3 stiffness=50.0 /
&spring name='hold' type='torsional' body_a='block' body_b='beam' node_b=2 stiffness=0.5 /
&static /
&modal modes=4 /
"""
    h = read(run_deck(text).folder, "modes")
    static = read(run_deck(text, name="again").folder, "static")
    chord = static["state.beam.angle"][-1]
    assert abs(static["state.beam.2.y"][-1] - 0.2 * np.sin(chord)) > 0.01  # it sags
    assert max(np.abs(h["beam.angle.re"])) > 0.1
    for axis in "xy":
        np.testing.assert_allclose(h[f"block.{axis}.re"], h[f"beam.2.{axis}.re"], rtol=0, atol=1e-9)
    # S is the distance of the two points of the ground, 0.5 m
    parts = [name for name in h.names if name.endswith(".re") and name.count(".") >= 2]
    largest = [
        max(np.hypot(h[n][k], h[n[:-2] + "im"][k]) * (0.5 if ".angle" in n else 1.0) for n in parts) for k in range(len(h.time))
    ]
    np.testing.assert_allclose(largest, 1.0, rtol=1e-12)


@pytest.mark.parametrize("method", ["method='rk4' step=1e-5", "method='dopri5' tolerance=1e-6"])
def test_a_part_of_an_output_interval_is_left_at_the_end(run_deck, method):
    text = f"&body name='b' kind='rigid' mass=1.0 inertia=1.0 /\n&transient t_end=1.05e-3 output_step=1e-4 {method} /\n"
    energy = run_deck(text).energy
    np.testing.assert_allclose(energy.time, [*(1e-4 * np.arange(11)), 1.05e-3], rtol=1e-12)


@pytest.mark.parametrize("title", [b"a\xc2\x85b", b"a\xe2\x80\xa8b", b"caf\xe9", b"caf\xc3\xa9\tb", b"\xed\xa0\x80\xe0\x80\x80"])
def test_a_title_of_any_bytes_is_one_printable_line(title, biela, tmp_path):
    """Every table can be read by numpy, every text file is UTF-8 whose lines end where they should, and JSON loses nothing."""
    name = b"d\x1b\xe9" + title.replace(b"\t", b"") + b".nml"
    groups = "&modal modes=1 /\n&static /\n" + ANALYSES[ANALYSES.index("&transient") :]
    scene = SCENE + groups
    (tmp_path / os.fsdecode(name)).write_bytes(b"&scene title='" + title + b"' /\n" + re.sub(r"&scene[^/]*/", "", scene).encode())
    subprocess.run([str(biela), "--quiet", "-o", "out", os.fsdecode(name)], cwd=tmp_path, check=True)
    for path in (tmp_path / "out").glob("*.txt"):
        text = path.read_bytes().decode("utf-8")
        assert text.splitlines() == text.split("\n")[:-1]
        assert {unicodedata.category(c) for c in text if c not in "\n\t"}.isdisjoint({"Cc", "Cf", "Cs", "Zl", "Zp"})
        if path.name != "summary.txt":
            assert np.loadtxt(path, encoding="utf-8").size > 0
    told = json.loads((tmp_path / "out" / "summary.json").read_bytes().decode("utf-8"))
    assert told["title"] in (title.decode("utf-8", "replace"), title.decode("latin-1"))
