"""Pictures of a sweep's table: what stands on which axis, what failed, when there is none."""

from __future__ import annotations

import numpy as np
from biela import plot, sweep_picture, sweep_study
from biela.sweep_scalars import Scalar


def named(name: str, **words: object) -> sweep_study.Parameter:
    return sweep_study.Parameter(**{"name": name, "targets": (), "values": (1.0, 2.0), "log": False, **words})


def drawn(tmp_path, monkeypatch, rows: list[list], *parameters: sweep_study.Parameter, **marks: list) -> list:
    """Return the names of the pictures of a table, and their figures' axes."""
    found = []

    def save(figure, path):
        found.extend([path.name, figure.axes])
        return [path]

    monkeypatch.setattr(sweep_picture, "save", save)
    study = sweep_study.Study("s", tmp_path / "a.nml", parameters, (Scalar("peak", "peak", "tip.v"),), ())
    sweep_picture.draw(study, [*(one.label for one in parameters), "peak[m]", "failure"], rows, tmp_path, **marks)
    return found


def test_pictures_are_curves_over_one_parameter_and_maps_over_two(tmp_path, monkeypatch):
    one, two = named("h", unit="m", log=True), named("w", log=True)
    name, axes = drawn(tmp_path, monkeypatch, [[1.0, 3.0, ""], [2.0, 5.0, ""], [4.0, "", "failed"]], one)
    assert (name, axes[0].get_xlabel(), axes[0].get_xscale()) == ("curves", "h [m]", "log")
    assert axes[0].lines[0].get_xydata().tolist() == [[1.0, 3.0], [2.0, 5.0]]
    name, axes = drawn(
        tmp_path, monkeypatch, [[1.0, 1.0, 3.0, ""], [1.0, 2.0, 4.0, ""], [2.0, 1.0, "", "no"], [2.0, 2.0, 5.0, ""]], one, two
    )
    assert (name, axes[0].get_xscale(), axes[0].get_yscale()) == ("map_peak", "log", "log")
    assert axes[0].lines[0].get_xydata().tolist() == [[2.0, 1.0]], "the failed run is crossed"
    assert [text.get_text() for text in axes[0].figure.legends[0].get_texts()] == ["failed"]
    assert axes[0].get_title() == "s: peak (peak of tip.v), 3 of 4 runs"
    assert np.ma.filled(axes[0].collections[0].get_array(), -1.0).ravel().tolist() == [3.0, -1.0, 4.0, 5.0]
    rows = [[x, y, x * y, ""] for x in (1.0, 2.0, 3.0) for y in (1.0, 2.0)]
    _, axes = drawn(tmp_path, monkeypatch, rows, one, two, best=rows[2], limits=[(2, 3.0), (2, 100.0)])
    assert [text.get_text() for text in axes[0].figure.legends[0].get_texts()] == ["peak [m] = 3", "best: 2 m"]
    assert axes[0].lines[-1].get_xydata().tolist() == [[2.0, 1.0]], "the best run is marked"


def test_what_varies_in_nothing_has_no_picture(tmp_path, monkeypatch):
    assert drawn(tmp_path, monkeypatch, [[1.0, 3.0, ""]], named("h")) == []
    assert drawn(tmp_path, monkeypatch, [[1.0, "", "no"], [2.0, "", "no"]], named("h")) == []


def test_unstable_cycles_are_shaded_and_orders_share_a_panel(tmp_path, monkeypatch):
    scalars = [Scalar(f"o{k}", "order", "pin.fx", order=float(k), period="crank") for k in (1, 2)]
    scalars.append(Scalar("largest", "summary", key="periodic.largest_multiplier"))
    rows = [[float(k), 3.0, 1.0, size, ""] for k, size in enumerate((0.9, 1.2, 1.0, 0.9))] + [[4.0, "", "", "", "no cycle"]]
    seen = []
    monkeypatch.setattr(sweep_picture, "save", lambda figure, path: seen.append(figure) or path)
    study = sweep_study.Study("s", tmp_path / "a.nml", (named("speed"),), tuple(scalars), ())
    sweep_picture.draw(study, ["speed", "o1[N]", "o2[N]", "largest", "failure"], rows, tmp_path)
    upper, lower = seen[0].axes
    assert (upper.get_ylabel(), lower.get_ylabel()) == ("orders of pin.fx [N]", "largest")
    assert [text.get_text() for text in upper.get_legend().get_texts()] == ["o1", "o2", "unstable cycle"]
    for axis in (upper, lower):
        (patch,) = axis.patches
        assert (patch.get_x(), patch.get_x() + patch.get_width()) == (0.5, 1.5)


def test_values_beyond_an_axis_are_marked_at_its_edge():
    _, axis = sweep_picture.subplots()
    axis.set_ylim(0.0, 1.0)
    plot.mark_beyond(axis, [1.0, 2.0, 3.0, 4.0], [0.5, 7.0, -2.0, np.nan], "black")
    assert [(line.get_marker(), line.get_xydata().tolist()) for line in axis.lines] == [("^", [[2.0, 1.0]]), ("v", [[3.0, 0.0]])]
    assert axis.get_ylim() == (0.0, 1.0)
