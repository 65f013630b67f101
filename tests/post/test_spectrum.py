"""Spectra, orders, waterfalls and decays of signals whose content is known; tables in other programs' formats."""

from __future__ import annotations

import numpy as np
import pandas
import pytest
from biela import export
from biela import spectrum_work as spectrum
from biela.decays import even_samples, ring_down
from biela.histories import read
from biela.programs import compare as compare_command
from biela.programs import export as export_command
from biela.programs import spectrum as spectrum_command
from conftest import ROOT
from scipy.io import loadmat

HEAD = "# columns: t[s] crank[rad] speed[rad/s] tone[m] chirp[m] ring[m]\n"


@pytest.fixture
def run(tmp_path):
    """Return a results folder: a tone of 12.5 Hz, the third order of a drive that runs up, a decay of ratio 0.03 at 8 Hz."""
    time = np.linspace(0.0, 4.0, 4001)
    speed = 20.0 + 30.0 * time
    crank = 20.0 * time + 15.0 * time**2
    omega = 2.0 * np.pi * 8.0
    ring = 0.4 + np.exp(-0.03 * omega * time) * np.cos(omega * np.sqrt(1.0 - 0.03**2) * time)
    columns = [time, crank, speed, 2.0 + 0.7 * np.sin(2.0 * np.pi * 12.5 * time), 0.3 * np.sin(3.0 * crank), ring]
    (tmp_path / "history.txt").write_text(HEAD + "\n".join(" ".join(f"{x:.16e}" for x in row) for row in zip(*columns)) + "\n")
    return tmp_path


def test_a_tone_has_its_frequency_and_amplitude(run):
    history = read(run)
    frequency, size = spectrum.amplitudes(*even_samples(history.time, history["tone"]))
    k = int(np.argmax(size))
    assert frequency[k] == pytest.approx(12.5, abs=0.13)
    assert size[k] == pytest.approx(0.7, rel=1.0e-2)
    drifting = history["tone"] + np.exp(history.time)
    _, size = spectrum.amplitudes(history.time, drifting)
    assert np.argmax(size) == 1, "a drift stands in the lowest bin"
    assert spectrum.peaks(size, 3)[0] == k
    band, power = spectrum.density(history.time, history["tone"])
    assert np.trapezoid(power, band) == pytest.approx(0.7**2 / 2.0, rel=2.0e-2)


@pytest.mark.parametrize("periods", [2.87, 5.4, 12.5])
def test_a_short_run_tells_its_line_as_surely_as_it_says(tmp_path, capsys, periods):
    """A line between the frequencies of the transform, with a harmonic and a drift, and one shorter than the run with --end."""
    rate = 9.549
    time = np.linspace(0.0, 1.5, 3001)
    tone = np.sin(2.0 * np.pi * rate * time) + 0.2 * np.sin(4.0 * np.pi * rate * time + 1.0) + 0.5 * time
    rows = "".join(f"{t:.17e} {x:.17e}\n" for t, x in zip(time, tone))
    (tmp_path / "history.txt").write_text("# columns: t[s] tone[m]\n" + rows)
    assert spectrum_command.main([str(tmp_path), "--columns", "tone", "--end", repr(periods / rate)]) == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()[:-1]]
    assert len(lines) == (1 if periods < 3 else 2), "a harmonic that is nearer than the window is wide is a shoulder"
    for k, words in enumerate(lines):
        assert words[2] == "±"
        assert abs(float(words[1]) - (k + 1) * rate) <= float(words[3]) <= 0.5 * rate / periods
    assert float(lines[0][6]) == pytest.approx(1.0, rel=0.03)


def test_a_shoulder_is_no_peak():
    """A bump on the flank of a line that rises above the valley beside it by less than 3 dB."""
    size = np.array([0.0, 0.1, 1.0, 10.0, 8.0, 5.0, 5.5, 2.0, 1.0, 4.0, 1.0])
    assert spectrum.peaks(size, 5) == [3, 9]


def test_orders_follow_a_drive_that_runs_up(run, capsys):
    assert spectrum_command.main([str(run), "--columns", "chirp", "--orders", "crank", "--peaks", "1"]) == 0
    words = capsys.readouterr().out.split()
    assert float(words[1]) == pytest.approx(3.0, abs=0.02)
    assert float(words[words.index("amplitude") + 1]) == pytest.approx(0.3, rel=0.03)


@pytest.mark.parametrize(("first", "last"), [("2", "9"), ("5", "5"), ("-1", "-1")])
def test_orders_of_whole_turns_are_exact_and_have_levels(run, capsys, first, last):
    """The third order of a drive that runs up by 51 turns, 0.3 m: over one turn no other has more than interpolation leaves."""
    words = [str(run), "--columns", "chirp", "--orders", "crank", "--turns", first, last, "--reference", "1e-6"]
    assert spectrum_command.main(words) == 0
    line, wrote = capsys.readouterr().out.splitlines()
    assert line == f"chirp: 3 per turn, amplitude 0.3 m, {20.0 * np.log10(0.3 / np.sqrt(2.0) / 1e-6):.1f} dB re 1e-06 m"
    assert wrote == f"wrote {run}/spectrum.png"
    turns = read(run).turns("crank", int(first), int(last))
    assert np.ptp(turns["crank"]) / 2.0 / np.pi == pytest.approx(int(last) - int(first) + 1, abs=1.0e-9)


def test_cycles_and_damage_of_a_history(run, capsys):
    """50 cycles of 0.7 m in a history that repeats; the strength is borne twice, so that each cycle takes half a life."""
    assert spectrum_command.main([str(run), "--columns", "tone", "--life", "0.7", "2", "3"]) == 0
    told = capsys.readouterr().out.split("\n")[0]
    assert told == "tone: 50 cycles, largest range 1.4 m, damage 25: 0.04 such histories"


def test_a_waterfall_follows_the_frequency(run):
    history = read(run)
    frequency, times, size = spectrum.waterfall(history.time, history["chirp"])
    ridge = frequency[np.argmax(size, axis=0)]
    expected = 3.0 * (20.0 + 30.0 * times) / (2.0 * np.pi)
    assert np.abs(ridge - expected).max() < 3.5
    assert spectrum_command.main([str(run), "--columns", "chirp", "--waterfall", "--speed", "speed"]) == 0
    assert (run / "spectrum.png").exists()


def test_a_decay_has_its_damping_ratio(run, capsys):
    history = read(run)
    figure, words = spectrum.draw_decay(history, ["ring"])
    assert len(words) == 1
    assert words[0].startswith("ring: 7.9964 ")  # 8 Hz without damping
    assert "damping ratio 0.03 ±" in words[0]
    rows, above, below = (line.get_xydata() for line in figure.axes[0].lines)
    rows = rows[rows[:, 0] >= above[0, 0]]
    assert np.all(rows[:, 1] <= np.interp(rows[:, 0], *above.T) + 1e-6)
    assert np.all(rows[:, 1] >= np.interp(rows[:, 0], *below.T) - 1e-6)
    omega = 2.0 * np.pi * 8.0
    assert above[0, 1] == pytest.approx(0.4 + np.exp(-0.03 * omega * above[0, 0]))
    assert spectrum_command.main([str(run), "--columns", "ring", "--decay"]) == 0
    assert capsys.readouterr().out.splitlines()[0] == words[0]


@pytest.mark.parametrize("drift", [0.0, 0.1, -0.3])
def test_a_decay_about_a_place_that_moves(drift):
    time = np.linspace(0.0, 2.0, 4001)
    omega = 2.0 * np.pi * 9.0
    values = 0.2 + drift * time + np.exp(-0.02 * omega * time) * np.cos(omega * np.sqrt(1.0 - 0.02**2) * time)
    found = ring_down(time, values)
    one = found.vibrations[0]
    assert one.damping_ratio == pytest.approx(0.02, rel=1.0e-3)
    assert one.amplitude == pytest.approx(np.exp(-0.02 * omega * found.start), rel=1.0e-3)
    assert found.level(time[500:3500]) == pytest.approx(0.2 + drift * time[500:3500], abs=1.0e-6)


def test_vibrations_that_decay_together_are_told_apart():
    """Twenty records with 1 % of noise: frequency to 0.5 %, damping to 5 %, and 95 % intervals that hold."""
    rng = np.random.default_rng(8)
    asked = resolved = right = held = 0
    for _ in range(20):
        count = rng.integers(2, 4)
        frequency = 3.0 * np.cumprod(rng.uniform(1.2, 2.0, count))
        ratio, size = np.exp(rng.uniform(np.log(0.002), np.log(0.1), count)), rng.uniform(0.3, 1.0, count)
        time = np.linspace(0.0, 7.0 / frequency[0], 1000)
        poles = 2.0 * np.pi * frequency * (1j - ratio / np.sqrt(1.0 - ratio**2))
        values = (np.exp(np.outer(time, poles)) @ (size * np.exp(1j * rng.uniform(0.0, 2.0 * np.pi, count)))).real
        found = ring_down(time, values + 0.01 * np.abs(values).max() * rng.standard_normal(time.size)).vibrations
        for f, z in zip(frequency, ratio):
            one = min(found, key=lambda one, f=f: abs(one.frequency - f))
            asked += 1
            held += abs(one.damping_ratio - z) <= one.damping_error
            if one.resolved:
                resolved += 1
                right += abs(one.frequency - f) <= 0.005 * f and abs(one.damping_ratio - z) <= 0.05 * z
    assert resolved >= 0.9 * asked
    assert right >= 0.95 * resolved
    assert 0.85 * asked <= held < asked
    assert asked > 45


def test_vibrations_beyond_the_thinned_rows_are_no_others():
    """Of 5,001 rows every sixth is fitted: 432 and 452 Hz, which they cannot show, appear at no other frequency."""
    time = np.linspace(0.0, 2.0, 5001)
    parts = ((13.0, 2.0), (82.0, 4.7), (432.0, 20.0), (452.0, 30.0))
    values = sum(np.exp(-rate * time) * np.cos(2.0 * np.pi * f * time) for f, rate in parts)
    found = ring_down(time, values)
    assert [one.frequency for one in found.vibrations] == pytest.approx([13.0, 82.0], rel=1e-6)
    assert found.top == pytest.approx(125.0, rel=1e-3)


def test_a_push_before_the_vibration_is_left_out():
    time = np.linspace(0.0, 2.0, 4001)
    free = 2.0 * np.exp(-4.0 * time) * np.cos(60.0 * time) + 0.3 * np.exp(-6.0 * time) * np.sin(200.0 * time)
    values = np.where(time < 0.02, 30.0 * np.sin(50.0 * np.pi * time) + free, free)
    found = ring_down(time, values)
    assert 0.02 <= found.start < 0.2
    assert [one.frequency * 2.0 * np.pi for one in found.vibrations[:2]] == pytest.approx([60.0, 200.0], rel=1e-4)
    assert [one.rate for one in found.vibrations[:2]] == pytest.approx([4.0, 6.0], rel=1e-3)


def test_uneven_rows_are_interpolated():
    axis = np.sort(np.random.default_rng(1).uniform(0.0, 1.0, 2000))
    even, values = even_samples(axis, np.sin(40.0 * axis))
    np.testing.assert_allclose(values, np.sin(40.0 * even), atol=1.0e-4)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--columns", "none"], "no column matches"),
        (["--columns", "tone", "--start", "3.99"], "rows"),
        (["--columns", "t*", "--speed", "speed"], "goes with --waterfall"),
        (["--columns", "tone", "chirp", "--waterfall"], "draws one column"),
        (["--columns", "chirp", "--orders", "tone"], "does not increase"),
        (["--columns", "crank", "--decay"], "no decaying vibration"),
    ],
)
def test_what_cannot_be_drawn_is_told_in_one_line(run, capsys, words, told):
    assert spectrum_command.main([str(run), *words]) == 2
    said = capsys.readouterr().err
    assert told in said
    assert said.count("\n") == 1


def test_tables_keep_every_number_and_name(run):
    history = read(run)
    frame = history.to_dataframe()
    assert list(frame.columns[:3]) == ["t_[s]", "crank_[rad]", "speed_[rad/s]"]
    for form in ("csv", "parquet", "matlab"):
        assert export_command.main([str(run), "--to", form]) == 0
    pandas.testing.assert_frame_equal(pandas.read_csv(run / "history.csv"), frame)
    pandas.testing.assert_frame_equal(pandas.read_parquet(run / "history.parquet"), frame)
    back = loadmat(run / "history.mat", squeeze_me=True)
    np.testing.assert_array_equal(back["ring"], history["ring"])
    assert back["units"]["speed"].item() == "rad/s"


def test_orders_of_a_drive_that_turns_clockwise(run, capsys):
    plain = run / "history.txt"
    words = [str(run), "--columns", "chirp", "--orders", "crank", "--peaks", "1"]
    assert spectrum_command.main(words) == 0
    told = capsys.readouterr().out
    history = read(run)
    columns = [-history[name] if name == "crank" else history[name] for name in history.names]
    plain.write_text(HEAD + "\n".join(" ".join(f"{x:.16e}" for x in row) for row in zip(*columns)) + "\n")
    assert spectrum_command.main(words) == 0
    assert capsys.readouterr().out == told


def test_an_exported_table_reads_back(tmp_path):
    head = "# columns: t[s] units[rad] a_[m/s2] none\n"
    (tmp_path / "history.txt").write_text(head + "0.0 0.1 0.3 1\n0.5 0.7 1e-17 2\n1.0 -1.25 3.5e+100 3\n")
    assert export_command.main([str(tmp_path), "--to", "csv"]) == 0
    found, own = read(tmp_path / "history.csv"), read(tmp_path)
    assert (found.names, found.units) == (own.names, own.units)
    assert np.array_equal(found.data, own.data)
    assert compare_command.main([str(tmp_path), str(tmp_path / "history.csv"), "--tolerance", "0"]) == 0
    assert export_command.main([str(tmp_path), "--to", "matlab"]) == 0
    held = loadmat(tmp_path / "history.mat", squeeze_me=True)
    assert held["units__1"].tolist() == [0.1, 0.7, -1.25]
    assert {name: str(held["units"][name]) for name in held["units"].dtype.names} == {
        "t": "s", "units__1": "rad", "a_": "m/s2", "none": "[]" if str(held["units"]["none"]) == "[]" else ""
    }  # fmt: skip


def test_vtk_files_of_others_stay(tmp_path):
    scene = type("Scene", (), {"time": [0.0], "bodies": {}, "links": [], "springs": []})
    points = np.zeros((2, 3)), np.array([[0, 1]]), np.array([1])
    (tmp_path / "motion_000007.vtu").write_text("mine")
    (tmp_path / "motion_000003.vtu").write_text("of a longer motion")
    (tmp_path / "motion.pvd").write_text('<DataSet timestep="0" file="motion_000003.vtu"/>')
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(export, "lines", lambda *_: points)
        export.write_vtk(scene, tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["motion.pvd", "motion_000000.vtu", "motion_000007.vtu"]
    assert (tmp_path / "motion_000007.vtu").read_text() == "mine"


def test_names_for_matlab_are_unique():
    assert export.matlab_names(["a.x", "a_x", "1b", "ok", "units"]) == ["a_x", "a_x__1", "x1b", "ok", "units__1"]


def test_motion_in_vtk_is_that_of_the_run(run_deck):
    import meshio

    deck = ROOT / "input" / "slider_crank_viscoelastic.nml"
    result = run_deck(deck)
    assert export_command.main([str(result.folder), "--to", "vtk"]) == 0
    files = sorted((result.folder / "vtk").glob("*.vtu"))
    motion = result.motion
    assert len(files) == motion.time.size
    mesh = meshio.read(files[100])
    middle = [motion["rod.2.x"][100], motion["rod.2.y"][100], 0.0]
    assert np.abs(mesh.points - middle).sum(axis=1).min() < 1.0e-12
    assert (result.folder / "vtk" / "motion.pvd").read_text().count("DataSet") == len(files)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--columns", "tone", "--peaks", "-1"], "--peaks -1: 0 or more expected"),
        (["--columns", "chirp", "--waterfall", "--speed", "ring"], "ring has to rise or to fall throughout"),
        (["--columns", "chirp", "--waterfall", "--speed", "none"], "no column 'none'"),
        (["--columns", "chirp", "--waterfall", "--start", "3.9845"], "16 rows: 17 or more are needed for a waterfall"),
    ],
)
def test_options_that_cannot_be_met_are_told(run, capsys, words, told):
    assert spectrum_command.main([str(run), *words]) == 2
    said = capsys.readouterr().err
    assert told in said
    assert said.count("\n") == 1


def test_exports_that_cannot_be_written_are_told(run, capsys):
    (run / "file").write_text("")
    for words, told in (
        ([str(run), str(run), "--output", "x.csv"], "export: --output goes with one RUN\n"),
        ([str(run), "--output", f"{run}/file/x.csv"], f"export: {run}/file/x.csv: cannot be written (Not a directory)\n"),
        ([str(run), "--output", str(run)], f"export: {run}: cannot be written (Is a directory)\n"),
    ):
        assert export_command.main([*words, "--to", "csv"]) == 2
        said = capsys.readouterr().err
        assert said.startswith(told)
        assert said.count("\n") == 1
