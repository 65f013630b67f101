"""Studies of what was measured and of tolerances: identified parameters, random designs, quantiles, whole periods, levels, life."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace

import biela as package
import numpy as np
import pytest
from biela import fatigue, study_runs, sweep_study, sweep_work
from biela.sweep_picture import draw_identified
from biela.sweep_scalars import Scalar
from conftest import ROOT
from scipy import stats
from scipy.optimize import curve_fit

STUDIES = ROOT / "input" / "studies"
PIN = 0.02 + 1.0 * 0.2**2  # inertia of the arm of ring_down.nml about its pin [kg m2]


@pytest.fixture(autouse=True)
def _inline(monkeypatch, biela):
    """Let studies make their runs in this process."""

    class Inline:
        def submit(self, work, batch):
            future = study_runs.Future()
            future.set_result(work(batch))
            return future

        def shutdown(self, **_: object) -> None:
            pass

    monkeypatch.setattr(study_runs, "executor", lambda _: Inline())
    monkeypatch.setenv("BIELA", str(biela))


def ring_down(t: np.ndarray, stiffness: float, damping: float) -> np.ndarray:
    """Return the turn of the arm by the closed form [rad]."""
    decay, turn = 0.5 * damping / PIN, stiffness / PIN
    rate = np.sqrt(turn - decay**2)
    return -0.05 + 0.05 * np.exp(-decay * t) * (np.cos(rate * t) + decay / rate * np.sin(rate * t))


def test_identified_parameters_are_those_of_a_fit_of_the_closed_form(tmp_path):
    text = (STUDIES / "ring_down.toml").read_text().replace('"ring_down.', f'"{STUDIES}/ring_down.')
    (tmp_path / "study.toml").write_text("starts = 1\n" + text)
    found = package.identify(tmp_path / "study.toml", folder=tmp_path / "out")
    t, turn = np.loadtxt(STUDIES / "ring_down.csv", delimiter=",", skiprows=1).T
    best, covariance = curve_fit(ring_down, t, turn, (40.0, 0.05), np.full(t.size, 5.0e-4), absolute_sigma=True)
    errors = np.sqrt(np.diagonal(covariance))
    values = np.array([*found.parameters.values()])
    assert np.all(np.abs(values - best) < 1.0e-3 * errors)
    for k, (low, high) in enumerate(found.intervals.values()):
        assert (0.5 * (low + high), 0.5 * (high - low)) == pytest.approx((values[k], stats.norm.ppf(0.975) * errors[k]), rel=1.0e-4)
    assert found.untold == []
    left = (ring_down(t, *best) - turn) / 5.0e-4
    assert found.misfit == pytest.approx(math.sqrt(np.sum(left**2) / (t.size - 2)), rel=1.0e-6)
    alone = package.run(tmp_path / "out" / "identified.nml")
    np.testing.assert_allclose(alone["turn"], ring_down(t, *values), atol=1.0e-8)


def test_what_the_data_do_not_tell_is_named(tmp_path):
    """Stiffness, damping and inertia about the pin by one factor leave the motion as it is."""
    text = (STUDIES / "ring_down.toml").read_text().replace('"ring_down.', f'"{STUDIES}/ring_down.').replace("error", "# error")
    (tmp_path / "study.toml").write_text("starts = 1\n" + text + "[[parameter]]\nname = 'inertia'\nfrom = 0.005\nto = 0.04\n")
    found = package.identify(tmp_path / "study.toml", folder=tmp_path / "out")
    (way,) = found.untold
    stiffness, damping, inertia = found.parameters.values()
    along = np.array([stiffness / 60.0, damping / 0.2, (inertia + 0.04) / 0.035])
    np.testing.assert_allclose([*way.values()], along / np.linalg.norm(along) * np.sign(way["inertia"]), atol=1.0e-3)
    assert any("the data do not tell: stiffness" in line for line in found.report)
    assert not found.stated
    assert found.misfit == pytest.approx(5.0e-4, rel=0.2), "the error of a measured value, which was not stated"


@pytest.mark.long
@pytest.mark.parametrize("stated", [False, True])
def test_intervals_hold_what_was_planted_in_95_of_100_draws(tmp_path, stated):
    """`pytest -m long tests/post/test_identify.py`: within the 1 % limits of a binomial distribution, 89 to 99."""
    t, generator, held = np.linspace(0.0, 1.0, 101), np.random.default_rng(20261124 + stated), np.zeros(2)
    text = (STUDIES / "ring_down.toml").read_text().replace('"ring_down.nml', f'"{STUDIES}/ring_down.nml')
    text = text.replace('name = "stiffness"', 'name = "stiffness"\nset = "spring/bush/stiffness"').replace("error = 5e-4", "")
    text = text.replace('name = "damping"', 'name = "damping"\nset = "spring/bush/damping"') + "error = 2e-3\n" * stated
    (tmp_path / "study.toml").write_text("starts = 1\n" + text)
    for k in range(100):
        data = np.column_stack([t, ring_down(t, 40.0, 0.05) + 2.0e-3 * generator.standard_normal(t.size)])
        np.savetxt(tmp_path / "ring_down.csv", data, delimiter=",", header="t,turn", comments="")
        found = package.identify(tmp_path / "study.toml", folder=tmp_path / f"out{k}")
        held += [low <= true <= high for true, (low, high) in zip((40.0, 0.05), found.intervals.values())]
    print(held)
    assert np.all((held >= 89) & (held <= 99))


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (("from = 20.0\nto = 80.0", "values = [30.0, 50.0]"), "parameters with from and to expected, none with a list"),
        (('measure = "misfit"', 'measure = "peak"'), "data belongs to measure = 'misfit'"),
        (('"ring_down.csv"', '"none.csv"'), "none.csv: no such file"),
        (('column = "turn"', 'column = "turning"'), "no column 'turning'"),
        (("deck = ", "runs = 20\ndeck = "), "runs = 20 are too few"),
    ],
)
def test_what_cannot_be_identified_is_told(tmp_path, change, told):
    text = (STUDIES / "ring_down.toml").read_text().replace(*change).replace('"ring_down.', f'"{STUDIES}/ring_down.')
    (tmp_path / "study.toml").write_text(text)
    with pytest.raises(package.BielaError, match=told):
        package.identify(tmp_path / "study.toml", folder=tmp_path / "out")
    with pytest.raises(package.BielaError, match="a result with measure = 'misfit' expected"):
        package.identify(STUDIES / "rod.toml", folder=tmp_path / "out")


def test_a_response_differs_by_both_its_parts():
    f = np.linspace(1.0, 50.0, 200)
    response = 1.0 / (1.0 - (f / 20.0) ** 2 + 0.1j * f)
    at = f[20:90:3]
    off = response[20:90:3] + (3.0e-3 - 4.0e-3j)
    scalar = Scalar("x", "misfit", "tip", "frequency_response", measured=(tuple(at), tuple(off.real), tuple(off.imag)))
    assert scalar.columns == {"tip.amplitude", "tip.phase"}
    assert scalar.of(f, response) == pytest.approx(math.hypot(3.0e-3, 4.0e-3) / math.sqrt(2.0))
    best = SimpleNamespace(differences=[scalar.differences(f, response)])
    figure = draw_identified(SimpleNamespace(scalars=[scalar]), best, ["m"])
    upper, lower = figure.axes
    np.testing.assert_allclose(upper.lines[1].get_ydata(), np.abs(response[20:90:3]))
    np.testing.assert_allclose([line.get_ydata()[0] for line in lower.lines], [-3.0e-3, 4.0e-3])
    shown = upper.get_ylabel(), lower.get_ylabel(), lower.get_xlabel()
    assert shown == ("tip, amplitude [m]", "model less measured [m]", "f [Hz]")
    with pytest.raises(ValueError, match=r"tip runs from 1 to 4\.9397, which is not where it was measured"):
        scalar.of(f[:17], response[:17])


def test_tolerances_give_quantiles_and_shares(tmp_path):
    """The area is height by width: its true quantiles, from many draws, lie in the intervals; the same seed gives the same rods."""
    text = (STUDIES / "rod_tolerances.toml").read_text().partition('[[result]]\nname = "peak"')[0]
    text = text.replace('"slider', f'"{STUDIES}/slider').replace("peak < 2.4e-4", "area < 1.63e-4")
    text = text.replace("samples = 200", "samples = 80")
    (tmp_path / "study.toml").write_text(text)
    found = package.sweep(tmp_path / "study.toml", folder=tmp_path / "out")
    drawn = np.array([row[:2] for row in found.rows])
    assert stats.kstest(drawn[:, 0], stats.norm(0.0254, 2.0e-4).cdf).pvalue > 0.01
    assert stats.kstest(drawn[:, 1], stats.uniform(0.0062, 3.0e-4).cdf).pvalue > 0.01
    generator = np.random.default_rng(5)
    many = generator.normal(0.0254, 2.0e-4, 200_000) * generator.uniform(0.0062, 0.0065, 200_000)
    assert [one.level for one in found.quantiles] == [0.05, 0.5, 0.95]
    assert all(one.low < np.quantile(many, one.level) < one.high for one in found.quantiles)
    (share,) = found.shares()
    assert share.low < np.mean(many < 1.63e-4) < share.high
    again = sweep_study.read(tmp_path / "study.toml")
    assert [tuple(point.values()) for point in again.points] == [tuple(row[:2]) for row in found.rows]
    assert Path(tmp_path / "out" / "quantiles.csv").read_text().count("\n") == 4


def test_quantiles_have_the_intervals_of_order_statistics():
    """Of 100 draws the 40th and the 61st hold the median, none is beyond 99 %; none of 20, and all of 10, in closed form."""
    middle, upper = sweep_work.quantiles_of("x", np.arange(100.0, 0.0, -1.0), (0.5, 0.99))
    assert (middle.value, middle.low, middle.high) == (50.5, 40.0, 61.0)
    assert upper.high == math.inf
    assert sweep_work.quantiles_of("x", np.empty(0), (0.5,)) == []
    none, every = sweep_work.share_of("a", 0, 20), sweep_work.share_of("a", 10, 10)
    assert (none.low, none.high) == (0.0, pytest.approx(1.0 - 0.025**0.05))
    assert (every.low, every.high) == (pytest.approx(0.025**0.1), 1.0)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_orders_and_rms_of_whole_turns_are_exact(way):
    """A speed that grows, 5.7 turns: over all rows the mean would leak into every order."""
    time = np.linspace(0.0, 2.0, 1001)
    turns = 2.0 * time + 0.4271 * time**2
    force = 100.0 + 3.0 * np.cos(4.0 * np.pi * turns + 0.7) + 0.02 * np.sin(14.0 * np.pi * turns)
    for periods in (0, 1, 4):
        words = dict(period="crank", periods=periods)
        for number, size in ((1.0, 0.0), (2.0, 3.0), (7.0, 0.02)):
            found = Scalar("x", "order", "pin.fx", order=number, **words).of(time, force, way * 2.0 * np.pi * turns)
            assert found == pytest.approx(size, abs=2.0e-5)
    level = Scalar("x", "order", "pin.fx", order=2.0, reference=1.0e-6, **words)
    wanted = 20.0 * math.log10(3.0 / math.sqrt(2.0) / 1.0e-6)
    assert level.of(time, force, way * 2.0 * np.pi * turns) == pytest.approx(wanted, abs=1.0e-4)
    assert level.unit("N", "s") == "dB re 1e-06 N"
    with pytest.raises(ValueError, match="5 whole periods, 6 or more expected"):
        Scalar("x", "order", "pin.fx", order=1.0, period="crank", periods=6).of(time, force, 2.0 * np.pi * turns)
    with pytest.raises(ValueError, match=r"order = 1\.5 is none of 1 periods"):
        Scalar("x", "order", "pin.fx", order=1.5, period="crank", periods=1).of(time, force, 2.0 * np.pi * turns)
    wave = np.sin(2.0 * np.pi * time / 0.3)
    assert Scalar("x", "rms", "c", period=0.3).of(time, wave) == pytest.approx(math.sqrt(0.5), rel=1.0e-5)
    assert Scalar("x", "mean", "c", period=0.3, start=0.31).of(time, wave) == pytest.approx(0.0, abs=1.0e-5)


def test_settling_to_a_target():
    time = np.linspace(0.0, 10.0, 10_001)
    values = 2.0 + np.exp(-time)
    assert Scalar("x", "settling_time", "c", target=2.0, within=0.05).of(time, values) == pytest.approx(math.log(20.0), abs=1e-6)
    band = 0.05 / float(np.ptp(values))
    assert Scalar("x", "settling_time", "c", target=2.0, band=band).of(time, values) == pytest.approx(math.log(20.0), abs=1e-6)
    assert math.isnan(Scalar("x", "settling_time", "c", target=1.0, within=0.05).of(time, values))


def test_rainflow_counts_are_those_of_the_standard():
    """ASTM E1049-85, figure 6."""
    counted = fatigue.cycles(np.array([-2.0, 1.0, -3.0, 5.0, -1.0, 3.0, -4.0, 4.0, -2.0]))
    found: dict[float, float] = {}
    for size, _, count in counted:
        found[size] = found.get(size, 0.0) + count
    assert found == {3.0: 0.5, 4.0: 1.5, 6.0: 0.5, 8.0: 1.0, 9.0: 0.5}
    assert sorted(mean for size, mean, count in counted if count == 1.0) == [1.0]


def test_the_damage_of_a_sine_is_known():
    """Five cycles of 60 MPa about 40 MPa: Basquin's line, Goodman's mean."""
    stress = 40.0 + 60.0 * np.sin(np.linspace(0.0, 10.0 * np.pi, 4001))
    words = dict(strength=80.0, cycles=1.0e6, slope=5.0)
    peaks = 5.0 * 60.0**5  # the first and the last quarter are one with those of the next and the last such history
    plain = Scalar("x", "damage", "c", **words).of(np.arange(4001.0), stress)
    for turn in (0.3, 2.0, 4.0):  # wherever it begins
        shifted = 40.0 + 60.0 * np.sin(np.linspace(0.0, 2.0 * np.pi, 4001) + turn)
        one = Scalar("x", "damage", "c", **words).of(np.arange(4001.0), shifted)
        assert one == pytest.approx((60.0 / 80.0) ** 5 / 1.0e6, rel=1e-5)
    assert plain == pytest.approx(peaks / 80.0**5 / 1.0e6, rel=1.0e-9)
    one = fatigue.damage(np.array([[120.0, 40.0, 5.0]]), 80.0, 1.0e6, 5.0, ultimate=400.0)
    assert one == pytest.approx(5.0 * (60.0 / 0.9 / 80.0) ** 5 / 1.0e6)
    assert fatigue.damage(np.array([[120.0, 400.0, 1.0]]), 80.0, 1.0e6, 5.0, ultimate=400.0) == math.inf


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ({"measure": "order", "period": 2.0}, "measure = 'order' needs order"),
        ({"measure": "damage", "strength": 1.0}, "measure = 'damage' needs strength, cycles, slope"),
        ({"measure": "peak", "reference": 1.0}, "reference belongs to measure = 'rms' or 'order'"),
        ({"measure": "settling_time", "within": -1.0}, "within = -1.0: a number expected, 0 or more"),
        ({"measure": "misfit"}, "measure = 'misfit' needs data"),
        ({"measure": "mean", "measured": ((1.0,), (2.0,))}, "data belongs to measure = 'misfit'"),
        ({"measure": "mean", "period": 0.1, "periods": 1.5}, "periods = 1.5: a whole number expected"),
    ],
)
def test_words_that_do_not_go_together(words, told):
    with pytest.raises(ValueError, match=told):
        Scalar("x", column="c", **words)
