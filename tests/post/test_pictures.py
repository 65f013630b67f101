"""The pictures: files that are there and not blank, panels and places that are the right ones, faults in one line."""

from __future__ import annotations

import json

import numpy as np
import pytest
from biela import animate, histories, mechanism, picture_files, plot
from biela.histories import HistoryError, read
from biela.programs import animate as animate_command
from biela.programs import plot as plot_command
from PIL import Image

TIME = np.linspace(0.0, 0.01, 21)
ROD = {"name": "Rod", "kind": "beam", "frame": [1, 0, 0], "nodes": [[1, 0], [2, 0], [3, 0]], "elements": [[1, 2], [2, 3]]}
PLATE = {"name": "plate", "kind": "rigid", "frame": [0, 2, 0], "nodes": [], "elements": []}


def at(body, node, *point):
    """Return a place of the assembled scene."""
    return {"body": body, "node": node, "at": point}


SCENE = {
    "bodies": [ROD, PLATE],
    "joints": [
        {"name": "crank", "kind": "distance", "a": at("Rod", 1, 1, 0), "b": at(None, 0, 0, 0), "direction": 0},
        {"name": "guide", "kind": "slider", "a": at("Rod", 3, 3, 0), "b": at(None, 0, 0, 0), "direction": 0},
        {"name": "pin", "kind": "revolute", "a": at("plate", 0, 0.5, 2), "b": at("Rod", 2, 2, 0), "direction": 0},
    ],
    "drives": [],
    "springs": [{"name": "coil", "kind": "linear", "a": at("plate", 0, 0, 2.5), "b": at(None, 0, 0, 3), "direction": 0}],
    "forces": [],
    "lumps": [{"at": at("plate", 0, -0.5, 1.5), "mass": 1}],
    "sensors": [],
}


def written(path, columns, rows):
    path.write_text("# columns: " + " ".join(columns) + "\n" + "\n".join(" ".join(f"{v:.17g}" for v in row) for row in rows) + "\n")
    return path


@pytest.fixture
def runs(tmp_path):
    """Return the folders of two runs: an angle and its rate, a small length beside a large one."""
    columns = ["t[s]", "q.q[rad]", "q.qd[rad/s]", "large[m]", "near[m]", "small[m]"]
    for name, damping in (("elastic", 0.0), ("viscoelastic", 300.0)):
        wave = np.exp(-damping * TIME) * np.sin(2000.0 * TIME)
        folder = tmp_path / "results" / name
        folder.mkdir(parents=True)
        written(folder / "history.txt", columns, np.column_stack([TIME, wave, 2000.0 * wave, TIME, 0.5 * TIME, 1.0e-3 * TIME]))
    return [tmp_path / "results" / name for name in ("elastic", "viscoelastic")]


@pytest.fixture
def motion(tmp_path):
    """Return a motion file (a beam that bends while it turns, a plate beside it); the assembled scene lies beside it."""
    names = ["t[s]", *(f"Rod.{c}" for c in ("x[m]", "y[m]", "angle[rad]")), *(f"Rod.{k}.{c}[m]" for k in (1, 2, 3) for c in "xy")]
    names += [f"plate.{c}" for c in ("x[m]", "y[m]", "angle[rad]")]
    rows = []
    for t in TIME:
        angle = 50.0 * t
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        nodes = [1.0, 0.0] + np.array([[0.0, 0.0], [1.0, 5.0 * t], [2.0, 0.0]]) @ turn.T
        rows.append([t, 1.0, 0.0, angle, *nodes.ravel(), 0.0, 2.0, 0.0])
    (tmp_path / "summary.json").write_text(json.dumps({"scene": SCENE}))
    return written(tmp_path / "motion.txt", names, rows)


def colours_in(path):
    """Return how many pixels of a picture are clearly blue, and clearly red or orange."""
    pixels = np.asarray(Image.open(path).convert("RGB")).astype(int)
    red, green, blue = np.moveaxis(pixels, -1, 0)
    return int(((blue > red + 80) & (blue > green + 80)).sum()), int(((red > blue + 80) & (red > green + 40)).sum())


def test_two_runs_lie_over_each_other_blue_and_red(runs, tmp_path):
    assert plot_command.main([*map(str, runs), "--columns", "q.*", "--output", str(tmp_path / "out" / "both")]) == 0
    blue, red = colours_in(tmp_path / "out" / "both.png")
    assert blue > 500
    assert red > 500
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["both.png"]


def test_the_axes_say_what_they_show(runs):
    histories = [read(run) for run in runs]
    figure = plot.draw(histories, ["undamped", "damped"], ["q.q", "q.qd", "large", "near", "small"])
    assert [axis.get_ylabel() for axis in figure.axes] == ["q.q [rad]", "q.qd [rad/s]", "[m]", "small [m]"]
    assert figure.axes[-1].get_xlabel() == "t [s]"
    assert [text.get_text() for text in figure.axes[2].get_legend().get_texts()] == ["large", "near"]
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["undamped", "damped"]
    np.testing.assert_array_equal(figure.axes[0].lines[1].get_ydata(), histories[1]["q.q"])


def test_a_column_against_another(runs):
    history = read(runs[0])
    figure = plot.draw([history], ["run"], ["q.qd"], against="q.q")
    np.testing.assert_array_equal(figure.axes[0].lines[0].get_xdata(), history["q.q"])
    assert figure.axes[0].get_xlabel() == "q.q [rad]"


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--columns", "nothing"], "no column matches 'nothing'"),
        (["--against", "nothing"], "no column 'nothing'"),
        (["--labels", "a", "b"], "2 labels for 1 runs: one each expected"),
        (["--file", "energy"], "energy.txt: no such file"),
        (["--output", "/dev/null/stem"], "/dev/null/stem.png: cannot be written"),
    ],
)
def test_plot_refuses_in_one_line(runs, capsys, options, told):
    assert plot_command.main([str(runs[0]), *options]) == 2
    message = capsys.readouterr().err
    assert told in message
    assert message.startswith("plot: ")
    assert message.count("\n") == 1


def test_a_response_is_drawn_by_amplitude_and_phase_on_logarithmic_axes(tmp_path):
    f = np.logspace(0.0, 3.0, 31)
    names = ["f[Hz]", *(f"tip.{c}.{part}" for c in "xy" for part in ("re[m]", "im[m]", "amplitude[m]", "phase[rad]"))]
    rows = np.column_stack([f, *[0.0 * f] * 4, 1.0 / f, 0.0 * f, 1.0 / f, 0.0 * f])
    path = written(tmp_path / "frequency_response.txt", names, rows)
    run = read(path)
    assert plot.usual_columns(run) == ["tip.y.amplitude", "tip.y.phase"]
    figure = plot.draw([run], ["run"], plot.usual_columns(run))
    assert [(axis.get_xscale(), axis.get_yscale()) for axis in figure.axes] == [("log", "log"), ("log", "linear")]


def test_an_equilibrium_is_drawn_by_its_sensors_and_modes_are_left_to_modes_py(tmp_path, capsys):
    names = ["load[-]", "residual[-]", "newton_steps[-]", "tip.u[m]", "state.rod.x[m]"]
    static = written(tmp_path / "static.txt", names, [[0.5, 0.0, 2.0, 0.1, 0.0], [1.0, 0.0, 2.0, 0.2, 0.0]])
    assert plot.usual_columns(read(static)) == ["tip.u"]
    written(tmp_path / "modes.txt", ["number[-]", "frequency[Hz]"], [[1.0, 3.0], [2.0, 7.0]])
    assert plot_command.main([str(tmp_path), "--file", "modes"]) == 2
    assert "its rows are modes, not times: name --columns, or draw them with post/modes.py" in capsys.readouterr().err
    assert plot_command.main([str(tmp_path), "--file", "modes", "--columns", "frequency"]) == 0


@pytest.mark.parametrize(("unit", "shown"), [("rad/s2", "rad/s²"), ("Nm", "N m"), ("m/s", "m/s"), ("m^2", "m²"), ("", "")])
def test_units_as_text_shows_them(unit, shown):
    assert plot.pretty_unit(unit) == shown


def test_places_of_the_mechanism(motion):
    scene = mechanism.from_run(read(motion))
    assert list(scene.bodies) == ["rod", "plate"]
    (a, b) = scene.links[0]
    np.testing.assert_allclose([scene.position(a, 9), scene.position(b, 9)], [[1.0, 0.0], [0.0, 0.0]], atol=1.0e-15)
    end, base, direction = scene.sliders[0]
    np.testing.assert_allclose(scene.position(end, 20), [1.0 + 2.0 * np.cos(0.5), 2.0 * np.sin(0.5)])
    assert (base.body, direction) == (None, 0.0)
    np.testing.assert_allclose([scene.position(place, 0) for place in scene.springs[0]], [[0.0, 2.5], [0.0, 3.0]])
    corners = set(map(tuple, scene.outline(scene.bodies["plate"], 0).round(12)))
    assert corners == {(-0.5, 1.5), (0.5, 2.0), (0.0, 2.5)}


@pytest.mark.parametrize("factor", [1.0, 10.0])
def test_deflections_are_exaggerated_in_the_bodys_axes(motion, factor):
    scene = mechanism.from_motion(read(motion), factor)
    rod = scene.bodies["rod"]
    np.testing.assert_allclose(scene.nodes(rod, 20), [[0.0, 0.0], [1.0, factor * 0.05], [2.0, 0.0]], atol=1.0e-14)
    line = scene.outline(rod, 20)
    gaps = np.linalg.norm(line[:, None] - rod.to_global(20, scene.nodes(rod, 20))[None], axis=-1)
    np.testing.assert_allclose(gaps.min(axis=0), 0.0, atol=1.0e-14)


def test_separate_elements_of_a_frame_are_drawn_apart(motion):
    scene = mechanism.from_motion(read(motion))
    rod = scene.bodies["rod"]
    rod.elements = [(0, 1), (1, 2)]
    assert np.isnan(scene.outline(rod, 0)[[2, 5]]).all()


@pytest.mark.parametrize(
    ("points", "outline"),
    [
        ([[0, 0]], [[0, 0]]),
        ([[1, 1], [0, 0], [2, 2]], [[0, 0], [2, 2], [0, 0]]),
        ([[0, 0], [1, 0], [1, 1], [0, 1], [0.5, 0.5], [0, 0]], [[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]),
    ],
)
def test_the_outline_of_points(points, outline):
    found = mechanism.hull(np.array(points, dtype=float))
    forward, back = found.tolist(), found[::-1].tolist()
    assert np.array(outline, dtype=float).tolist() in (forward, back)


def test_animation_and_sheet(motion, tmp_path):
    stem = tmp_path / "film"
    assert animate_command.main([str(motion), "--frames", "5", "--pictures", "4", "--output", str(stem)]) == 0
    with Image.open(stem.with_suffix(".gif")) as film:
        assert film.n_frames == 5
        first = np.asarray(film.convert("RGB")).astype(int)
        film.seek(4)
        assert np.abs(np.asarray(film.convert("RGB")).astype(int) - first).max() > 100
    blue, orange = colours_in(stem.with_suffix(".png"))
    assert blue > 200
    assert orange > 20


@pytest.mark.parametrize(("frames", "seconds"), [(100, 5.0), (300, 5.0), (70, 3.0)])
def test_a_film_is_as_long_as_asked(tmp_path, frames, seconds):
    images = [Image.fromarray(np.full((8, 8, 3), k % 250, dtype=np.uint8)) for k in range(frames)]
    animate.write_gif(images, tmp_path / "film.gif", seconds)
    with Image.open(tmp_path / "film.gif") as film:
        times = []
        for k in range(film.n_frames):
            film.seek(k)
            times.append(film.info["duration"])
    assert sum(times) == 1000.0 * seconds
    assert min(times) >= 20


def test_a_name_with_a_digit_is_no_power():
    assert plot.heading_label("m2[m2]") == "m2 [m²]"
    assert plot.heading_label("m2") == "m2"


def test_animate_refuses_in_one_line(motion, runs, capsys):
    path, other = motion, runs[0] / "motion.txt"
    other.write_text(path.read_text())
    (runs[0] / "summary.json").write_text(json.dumps({"scene": SCENE | {"bodies": [PLATE | {"name": "other"}]}}))
    cases = [
        ([str(runs[0] / "history.txt")], "has no body frames"),
        ([str(other)], "summary.json: has no scene of this motion (its body 'other' is not in the motion)"),
        ([str(path), "--frames", "1"], "at least 2 frames"),
        ([str(path), "--trace", "rod.9"], "no marker 'rod.9' to trace; there are rod.1, plate"),
    ]
    for words, told in cases:
        assert animate_command.main(words) == 2
        message = capsys.readouterr().err
        assert told in message
        assert message.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--exaggerate", "nan"], "'nan': a number expected"),
        (["--exaggerate", "inf"], "'inf': a number expected"),
        (["--seconds", "nan"], "'nan': a number above 0 expected"),
        (["--seconds", "0"], "'0': a number above 0 expected"),
        (["--pictures", "-3"], "'-3': a whole number of at least 1 expected"),
        (["--frames", "many"], "'many': a whole number of at least 1 expected"),
    ],
)
def test_numbers_of_the_command_line_are_refused_with_what_was_expected(motion, capsys, words, told):
    with pytest.raises(SystemExit) as ended:
        animate_command.main([str(motion), *words])
    assert ended.value.code == 2
    assert told in capsys.readouterr().err


def test_lumps_names_and_paths_are_drawn_and_a_film_is_written(motion, tmp_path):
    scene = mechanism.from_run(read(motion))
    np.testing.assert_allclose(scene.position(scene.lumps[0], 0), [-0.5, 1.5])
    mechanism.add_trace(scene, "Rod.3")
    np.testing.assert_allclose(scene.traces[0][20 * mechanism.PER_ELEMENT], [1.0 + 2.0 * np.cos(0.5), 2.0 * np.sin(0.5)])
    figure = animate.sheet(scene, 2)
    first, second = figure.axes
    assert {"rod", "plate"} < {text.get_text().strip() for text in first.texts}
    assert len(second.texts) == 1
    assert any(np.array_equal(line.get_xydata(), scene.traces[0]) for line in first.lines)
    stem = tmp_path / "film"
    assert animate_command.main([str(motion), "--frames", "4", "--pictures", "1", "--mp4", "--output", str(stem)]) == 0
    assert stem.with_suffix(".mp4").read_bytes()[4:8] == b"ftyp"


def test_a_suffix_that_is_given_is_taken(motion, runs, tmp_path, capsys):
    words = ["--frames", "2", "--pictures", "1", "--output"]
    for name, begin in (("d.gif", b"GIF8"), ("d.pdf", b"%PDF"), ("d.1.mp4", b"")):
        folder = tmp_path / name.replace(".", "_")
        assert animate_command.main([str(motion), *words, str(folder / name)]) == 0
        assert [path.name for path in folder.iterdir()] == [name]
        assert (folder / name).read_bytes().startswith(begin)
    for name, found, begin in (("d.png", "d.png", b"\x89PNG"), ("d.PDF", "d.PDF", b"%PDF"), ("d.1", "d.1.png", b"\x89PNG")):
        folder = tmp_path / f"plot_{name}"
        assert plot_command.main([str(runs[0]), "--columns", "q.q", "--output", str(folder / name)]) == 0
        assert capsys.readouterr().out.endswith(f"wrote {folder / found}\n")
        assert [path.name for path in folder.iterdir()] == [found]
        assert (folder / found).read_bytes().startswith(begin)


@pytest.mark.parametrize("count", range(1, 10))
@pytest.mark.parametrize("shape", [(1.0, 0.0), (1.0, 1.0), (0.2, 1.0), (0.0, 0.0)])
def test_panels_of_a_sheet_fill_it(count, shape):
    lines, columns, width, height = animate.tiles(count, np.zeros(2), np.array(shape))
    assert lines * columns >= count > (lines - 1) * columns
    assert animate.SMALLEST <= width <= animate.LARGEST
    assert columns * width <= max(animate.SHEET[0], animate.SMALLEST * columns) + 1e-9
    assert (lines * columns - count) * 3 <= max(3, count)
    assert height > 0.0


def test_columns_of_zeros_are_left_out_and_told_and_shown_where_they_are_named(runs, capsys):
    for folder in runs:
        history = read(folder)
        names = [f"{name}[{history.units[name]}]" for name in history.names]
        written(folder / "history.txt", [*names, "idle.x[N]"], np.column_stack([history.data, 0.0 * history.time]))
    assert plot_command.main([str(runs[0])]) == 0
    assert "left out, zero, rounding or constant throughout: idle.x" in capsys.readouterr().out
    assert plot.chosen_columns([read(run) for run in runs], ["idle.*"], None) == (["idle.x"], [])
    assert "idle.x" not in plot.chosen_columns([read(run) for run in runs], None, None)[0]


def test_columns_that_are_rounding_beside_others_of_their_unit_are_left_out(runs):
    history = read(runs[0])
    names = [f"{name}[{history.units[name]}]" for name in history.names]
    noise = 1e-14 * np.max(np.abs(history["large"])) * np.sin(1e3 * history.time)
    written(runs[0] / "history.txt", [*names, "fixed.y[m]", "alone[N]"], np.column_stack([history.data, noise, noise]))
    drawn, idle = plot.chosen_columns([read(runs[0])], None, None)
    assert idle == ["fixed.y"]
    assert drawn == [*history.names[1:], "alone"]


def test_a_path_fills_its_picture(runs):
    history = read(runs[0])
    figure = plot.draw([history], ["run"], ["near"], against="large")
    figure.draw_without_rendering()
    axis = figure.axes[0]
    shown, whole = np.ptp(axis.get_ylim()) * np.ptp(axis.get_xlim()), np.ptp(history["near"]) * np.ptp(history["large"])
    assert shown < 4.0 * max(whole, (np.ptp(history["large"]) * plot.PATH[0] / plot.PATH[1]) ** 2)


def test_a_run_without_a_column_is_refused_by_name(runs, capsys):
    history = read(runs[1])
    written(runs[1] / "history.txt", [f"{name}[{history.units[name]}]" for name in history.names[:-1]], history.data[:, :-1])
    for words in ([], ["--columns", "small"]):
        assert plot_command.main([*map(str, runs), *words]) == 2
        told = capsys.readouterr().err
        assert str(runs[1] / "history.txt") in told
        assert "small" in told


def test_pictures_are_named_after_what_they_show(runs):
    assert plot_command.main([str(runs[0])]) == 0
    assert plot_command.main([str(runs[0]), "--columns", "q.*"]) == 0
    assert plot_command.main([*map(str, runs), "--columns", "near", "--against", "large"]) == 0
    found = {path.name for path in runs[0].glob("*.png")}
    assert found == {"history.png", "history_q.png", "history_near_against_large_viscoelastic.png"}


def test_a_path_is_drawn_to_scale_and_an_angle_over_a_length_is_not(runs):
    history = read(runs[0])
    for name, aspect in (("near", 1.0), ("q.q", "auto")):
        figure = plot.draw([history], ["run"], [name], against="large")
        assert figure.axes[0].get_aspect() == aspect


def test_lines_of_a_picture_differ_in_colour_and_in_style(runs):
    histories = [read(run) for run in runs]
    for shown, names in ((histories[:1], ["large", "near"]), (histories, ["q.q"]), (histories, ["large", "near"])):
        figure = plot.draw(shown, ["a", "b"][: len(shown)], names)
        lines = figure.axes[0].lines
        looks = {(line.get_color(), str(line._unscaled_dash_pattern)) for line in lines}
        styles = {str(line._unscaled_dash_pattern) for line in lines}
        assert len(looks) == len(lines)
        assert len(styles) > 1


def test_a_motion_without_bodies_is_refused(runs):
    with pytest.raises(HistoryError, match=r"is it a motion\.txt"):
        mechanism.from_motion(read(runs[0]))


def test_panels_of_an_odd_number_fill_two_columns_with_one_time_axis_each(tmp_path):
    names = ["t[s]", *(f"x{k}[u{k}]" for k in range(plot.ONE_COLUMN + 1 + plot.ONE_COLUMN % 2))]
    run = read(written(tmp_path / "history.txt", names, np.outer(TIME, np.arange(1.0, len(names) + 1.0))))
    figure = plot.draw([run], ["run"], run.names[1:], title="odd")
    figure.lay_out()
    boxes = np.array([axis.get_window_extent().extents for axis in figure.axes])
    left, right = boxes[::2], boxes[1::2]
    assert len(left) == len(right) + 1
    for column in (left, right):
        assert np.ptp(column[:, [0, 2]], axis=0).max() < 1.0
    named = [axis.get_xlabel() == "t [s]" and axis.xaxis.get_tick_params()["labelbottom"] for axis in figure.axes]
    assert named == [False] * (len(named) - 2) + [True, True], "the lowest of each column"
    assert figure.get_suptitle() == "odd"


def test_events_are_marked_in_every_panel_and_named_in_the_legend(runs, capsys, monkeypatch):
    """Two touches and an opening, of which one touch lies outside the picture."""
    legends = []
    monkeypatch.setattr(plot.Figure, "legend", lambda _, handles, **__: legends.append([h.get_label() for h in handles]))
    lines = ["# columns: t[s] element from to speed[m/s]", "1e-3 pad open lower 0.5", "2e-3 pad lower open 0"]
    lines.append("0.5 pad open upper 0.1")
    (runs[0] / "events.txt").write_text("\n".join(lines) + "\n")
    picture = runs[0] / "marked.png"
    assert plot_command.main([str(runs[0]), "--columns", "large", "q.q", "--events", "--output", str(picture)]) == 0
    assert picture.is_file()
    assert "events marked: 3" in capsys.readouterr().out
    assert legends == [["touches or sticks", "lets go or slips"]]
    assert [event.after for event in histories.read_events(runs[0])] == ["lower", "open", "upper"]
    assert histories.read_events(runs[1]) == []
    assert plot_command.main([str(runs[0]), "--columns", "large", "--events", "--against", "near", "--output", str(picture)]) == 2
    (runs[0] / "events.txt").write_text("1e-3 pad open\n")
    assert plot_command.main([str(runs[0]), "--columns", "large", "--events", "--output", str(picture)]) == 2
    assert "events.txt:1: is no event" in capsys.readouterr().err


def test_long_columns_keep_their_crests_in_few_points():
    time = np.linspace(0.0, 1.0, 200_001)
    values = np.sin(2.0e4 * time) * (1.0 + time)
    values[77_777] = 9.0
    along, shown = plot.thinned(time, values)
    assert len(shown) < 4 * plot.THINNED
    assert (along[0], along[-1], shown.max(), shown.min()) == (0.0, 1.0, 9.0, values.min())
    assert plot.thinned(np.cos(time), values)[0].size == time.size, "a path that turns back keeps all"


def test_numbers_of_logarithmic_axes_are_plain_and_differ():
    figure, (near, both) = picture_files.subplots(2, 1)
    near.set_yscale("log")
    near.plot([1, 2], [2.3e10, 2.9e10])
    both.set_yscale("symlog", linthresh=10)
    both.plot([1, 2], [-1.0e4, 2.0])
    figure.lay_out()
    assert {text.get_text() for text in near.yaxis.get_minorticklabels()} >= {"2.3×10¹⁰", "2.4×10¹⁰", "2.9×10¹⁰"}
    assert [text.get_text() for text in both.yaxis.get_majorticklabels()][-4:] == ["−10³", "−10²", "−10¹", "0"]
