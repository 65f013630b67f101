"""post/tradeoff.py: what it recommends holds against references that it never saw; what it cannot do is told."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from biela import tradeoff_work
from biela.compare import differences
from biela.deck import read as read_deck
from biela.histories import Event, read, read_summary
from biela.picture_files import save
from biela.programs import tradeoff as tradeoff_command
from biela.tradeoff_errors import against, state_differences
from biela.tradeoff_settings import Grid, Setting, TradeoffOptions, removals
from conftest import REFERENCE, ROOT
from oracle import Scene
from scipy.integrate import solve_ivp
from study_decks import ARGUMENT
from tool_calls import call

CRANK = REFERENCE / "vrl_ghm" / "deck.nml"
AT_LEISURE = ("--quiet", "--time", "1e5", "--longest-run", "1e5")  # a study ends by itself, however busy the machine


@pytest.fixture
def study(biela: Path, tmp_path: Path):
    """Return a function that runs the tool on a deck: (folder, stdout, stderr)."""

    def run(deck: Path, *options: str, status: int = 0) -> tuple[Path, str, str]:
        words = [deck, *AT_LEISURE, *options, "--biela", biela, "--output", "study"]
        done = call(tradeoff_command.main, *words, cwd=tmp_path)
        assert done.returncode == status, done.stdout + done.stderr
        return tmp_path / "study", done.stdout, done.stderr

    return run


@pytest.fixture
def shortened(biela: Path, tmp_path: Path):
    """Return a function that writes a copy of a deck which ends earlier."""

    def write(deck: Path, t_end: float, **values: object) -> Path:
        found = read_deck(deck, biela=biela)
        (tmp_path / "deck.nml").write_text(found.set(found.one("transient"), t_end=t_end, **values).flat(biela))
        return tmp_path / "deck.nml"

    return write


def promised(folder: Path) -> tuple[float, float]:
    """Return error and speed-up in counts from the head of recommended.nml; 1 where the deck as written is kept."""
    words = " ".join(line.lstrip("! ") for line in (folder / "recommended.nml").read_text().splitlines() if line.startswith("!"))
    error = float(re.search(r"[Ii]ts error is ([\d.e+-]+) ", words)[1])
    found = re.search(r"speed-up is \S+ in seconds, ([\d.e+-]+) in evaluations", words)
    return error, float(found[1]) if found else 1.0


@pytest.mark.parametrize("tolerance", [1e-2, 1e-6])
def test_recommended_deck_meets_the_tolerance_against_an_independent_solution(study, run_deck, tolerance):
    words = CRANK, "--sensor", "rod", "pin", "--tolerance", str(tolerance), "--methods", "rk4"
    folder, first, _ = study(*words)
    done = run_deck(folder / "recommended.nml")
    found = differences(done.history, read(REFERENCE / "vrl_ghm" / "expected.csv"), tolerance, columns=["rod", "pin.*"])
    assert all(d.passed for d in found), found
    error, counts = promised(folder)
    assert error == pytest.approx(max(d.error for d in found), rel=0.05, abs=2e-8)
    assert (folder / "work_precision.png").stat().st_size > 10_000
    if tolerance == 1e-2:
        assert counts > 5.0
        journal = (folder / "journal.jsonl").read_text()
        _, second, _ = study(*words)
        assert (folder / "journal.jsonl").read_text() == journal, "what was run is not run again"
        assert second.partition(" is ")[0] == first.partition(" is ")[0]


def test_a_force_keeps_the_sensor_that_it_depends_on(study, run_deck, tmp_path):
    """A mass on the force -9 x let go at x = 1; the sensor of x is there for the force alone, and is not compared."""
    (tmp_path / "deck.nml").write_text(ARGUMENT)
    folder, _, _ = study(tmp_path / "deck.nml", "--sensor", "v", "--tolerance", "1e-3", "--methods", "rk4")
    assert "\ncompared: v.x; rounding alone" in (folder / "tradeoff.txt").read_text()
    done = run_deck(folder / "recommended.nml")
    off = np.abs(done.history["v.x"] + 3.0 * np.sin(3.0 * done.history.time)).max() / 3.0
    assert off < 1e-3
    assert promised(folder)[0] == pytest.approx(off, rel=0.2, abs=1e-7)


@pytest.mark.parametrize("across", [1.2, 1.95, 8.0])
def test_names_of_ticks_stand_apart_however_long_the_runs_take(tmp_path, across):
    """The fixture `texts_stand_apart` looks; the seconds of a study on another machine are not those of this one."""
    found = tradeoff_work.Tradeoff(TradeoffOptions(tmp_path / "deck.nml", tmp_path), tmp_path, Grid(1.0, 0.1, 0.1))
    found.measured = SimpleNamespace(columns=["v.x"])
    for k in range(4):
        values = {"v.x": 0.1**k, "rms": 0.1**k, "seconds": 1.4e-3 * across ** (k / 3)}
        found.points.append(tradeoff_work.Point("", Setting("rk4", k), None, values))
    save(found.picture(), tmp_path / "picture")


def test_at_an_event_the_error_of_its_time_counts_and_not_the_jump(tmp_path):
    """A step from 0 to 1 and a rebound, both late by 0.1 of the time; a run in which the step never comes."""
    times = np.linspace(0.0, 1.0, 101)

    def run(name: str, step: float, rebound: float) -> Path:
        folder = tmp_path / name
        folder.mkdir()
        rows = np.column_stack([times, np.where(times > step, 1.0, 0.0), np.abs(times - rebound)])
        np.savetxt(folder / "history.txt", rows, header="columns: t[s] f[N] x[m]")
        lines = f"0.2 pin stuck forward 0\n{step} pin forward stuck 0\n{rebound} stop open lower_rebound 1\n"
        (folder / "events.txt").write_text(lines)
        (folder / "summary.json").write_text('{"status": null, "transient": {}}')
        return folder

    measured = against(run("truth", 0.5, 0.655), [])
    assert measured.columns == ("f", "x")
    for name, step, rebound, late in (("late", 0.605, 0.655, 0.105), ("later", 0.5, 0.675, 0.02), ("never", 2.0, 0.655, 0.5)):
        f, x, events, _ = measured.errors(run(name, step, rebound))
        assert (f, events) == (0.0, pytest.approx(late))
        assert x == pytest.approx(abs(rebound - 0.655) / 0.65, rel=1e-6)
    events = [Event(0.5, "pin", "stuck", "forward", 0.0)]
    assert state_differences(events, events, times)[1] == 0.0


def start_of(scene_deck: Path, rows: int, times: np.ndarray, columns: list[str]) -> np.ndarray:
    """Return columns of the independent model's motion at the first times, shape (rows, columns)."""
    scene = Scene(scene_deck)
    v, moving = scene.deck_v.copy(), {"velocity", "angular_velocity"}
    free = [scene.offset[b.name] + k for b in scene.bodies if not moving & set(b.record) for k in range(3)]
    v[free] = np.linalg.lstsq(scene.jacobian(scene.q0)[:, free], -scene.phi_rate(0.0, scene.q0, v), rcond=None)[0]
    start = np.concatenate([scene.q0, v, *scene.relaxed(scene.q0)])
    run = solve_ivp(scene.derivative, (0.0, times[rows]), start, "DOP853", t_eval=times[: rows + 1], rtol=1e-8, atol=1e-11)
    values = [scene.sensor_columns(t, *scene.split(run.y[:, k])) for k, t in enumerate(run.t)]
    return np.array([[row[column] for column in columns] for row in values])


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "t_end", "asked", "rows"),
    [("engine", 2e-3, ["piston", "crank_pin"], 4), ("four_bar", 1e-2, ["rocker", "motor", "pin_c"], 1)],
)
def test_recommended_deck_follows_the_independent_model(study, run_deck, shortened, name, t_end, asked, rows):
    deck = shortened(ROOT / "input" / f"{name}.nml", t_end)
    folder, _, _ = study(deck, "--sensor", *asked, "--tolerance", "1e-2")
    run = run_deck(folder / "recommended.nml").history
    columns = [c for c in run.names[1:] if c.split(".")[0] in asked and np.ptp(run[c]) > 1e-9]
    expected = start_of(deck, rows, run.time, columns)
    for k, column in enumerate(columns):
        assert np.abs(run[column][: rows + 1] - expected[:, k]).max() < 1e-2 * np.ptp(run[column]), column


def test_rod_angle_and_slider_of_the_ivp_crank_meet_a_thousandth(study, run_deck, shortened):
    path = shortened(ROOT / "input" / "ivp_slider_crank.nml", 0.02)
    folder, _, _ = study(path, "--sensor", "rod", "slider", "--methods", "radau")
    run, reference = run_deck(folder / "recommended.nml").history, read(REFERENCE / "published" / "crank_conv_lin_ini2.csv")
    for ours, theirs in {"rod": "phi2", "slider.x": "x3"}.items():
        exact = np.interp(run.time, reference.time, reference[theirs])
        assert np.abs(run[ours] - exact).max() < 1e-3 * np.ptp(reference[theirs])
    assert promised(folder)[1] > 5.0


def work(figures: dict) -> float:
    """Return evaluations, residuals of implicit methods among them, times unknowns of a run."""
    run, model = figures["transient"], figures["model"]
    unknowns = 2 * (model["coordinates"] + model["dissipative_coordinates"])
    unknowns -= model.get("dissipative_coordinates_of_first_order", 0)
    return (run["evaluations"] + run.get("residual_evaluations", 0)) * unknowns


OWN = {"five_bar": (0.01, 2.5e-6), "press": (0.008, 2.5e-6), "swing": (0.04, 5e-6)}


@pytest.mark.parametrize("name", ["five_bar", *(pytest.param(name, marks=pytest.mark.long) for name in ("press", "swing"))])
def test_recommended_decks_of_own_mechanisms_keep_their_promise_and_are_no_slower(study, run_deck, monkeypatch, shortened, name):
    monkeypatch.setattr(tradeoff_work, "removals", lambda *words: removals(*words)[::9])  # a part of the search
    t_end, step = OWN[name]
    path = shortened(ROOT / "tests" / "tradeoff" / f"{name}.nml", t_end)
    folder, _, _ = study(path, "--tolerance", "1e-2")
    own = run_deck(path)
    truth = run_deck(shortened(path, t_end, step=step).read_text(), name="truth")
    run = run_deck(folder / "recommended.nml")
    for column in truth.history.names[1:]:
        exact = np.interp(run.history.time, truth.history.time, truth.history[column])
        if np.ptp(exact) > 1e-9 * np.abs(truth.history.data[:, 1:]).max():
            assert np.abs(run.history[column] - exact).max() < 1e-2 * np.ptp(exact), column
    assert work(read_summary(run.folder)) <= work(read_summary(own.folder))


def test_a_radau_run_of_the_elastomer_without_the_terms_that_its_tip_does_not_notice(study, run_deck, monkeypatch, shortened):
    """Explicit steps are bound by a GHM pole of 4.5e5 1/s: radau is the cheapest method."""
    monkeypatch.setattr(tradeoff_work, "removals", lambda *words: [one for one in removals(*words) if "elastomer: " in one[0]])
    path = shortened(ROOT / "input" / "elastomer_cantilever.nml", 0.05)
    folder, _, _ = study(path, "--tolerance", "1e-3", "--sensor", "tip", "--methods", "rk4", "radau")
    assert re.search(r"elastomer: GHM term \d of \d +\d.* too much", (folder / "tradeoff.txt").read_text())
    run, own = run_deck(folder / "recommended.nml"), run_deck(path)
    exact = run_deck(shortened(path, 0.05, method="radau", step=None, tolerance=1e-8).read_text(), name="exact").history
    for column in ("tip.v", "tip.r"):
        truth = np.interp(run.history.time, exact.time, exact[column])
        assert np.abs(run.history[column] - truth).max() < 1e-3 * np.ptp(truth)
    assert 10 * work(read_summary(run.folder)) < work(read_summary(own.folder))


def test_without_time_nothing_is_recommended_and_that_is_told(study):
    folder, told, _ = study(CRANK, "--tolerance", "1e-7", "--time", "0.001", status=1)
    assert "No reference converged within --time 0.001" in told or "No setting that was tried meets" in told
    assert not (folder / "recommended.nml").exists()


@pytest.mark.parametrize(
    ("text", "options", "fault"),
    [
        (None, [], "cannot be read: no such file"),
        ("&scene /\n", [], "no &sensor"),
        ("&scene \n", [], "/"),
        ("&body name='b' mass=1 inertia=1 /\n&sensor name='a' quantity='angle' body='b' /\n", [], "no &transient"),
        ("good", ["--sensor", "nonsense"], "no sensor 'nonsense'"),
        ("good", ["--sensor", "rod.x"], "no column 'rod.x'; its sensor has rod"),
        ("faulty", [], "unknown variable yonug, did you mean young?"),
    ],
)
def test_faults_are_one_line(study, tmp_path, text, options, fault):
    deck = tmp_path / "deck.nml"
    if text in ("good", "faulty"):
        deck.write_text(CRANK.read_text().replace("young=2.1e10", "young=2.1e10" if text == "good" else "yonug=2.1e10"))
    elif text is not None:
        deck.write_text(text)
    _, _, told = study(deck, *options, status=2)
    lines = told.strip().splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("tradeoff: ")
    assert fault in lines[0]


@pytest.mark.parametrize("words", [["--tolerance", "0"], ["--time", "-1"], ["--jobs", "0"], ["--longest-run", "nan"]])
def test_numbers_of_the_command_line_are_refused(words, capsys):
    with pytest.raises(SystemExit) as ended:
        tradeoff_command.main([str(CRANK), *words])
    assert ended.value.code == 2
    assert "expected" in capsys.readouterr().err.splitlines()[-1]


def test_a_run_that_takes_too_long_is_stopped_and_said_to_be(biela, tmp_path):
    from biela.sweep_run import Batch, run_batch

    deck = ROOT / "input" / "four_bar.nml"
    (row,) = run_batch(Batch(str(biela), str(deck), {1: ("transient/t_end=1e4",)}, (), str(tmp_path), longest=0.2))
    assert row.reason == "stopped after 0.2 s"
