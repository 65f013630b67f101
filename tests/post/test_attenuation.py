"""The figures that the demonstrations print, from histories of known size."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from biela import attenuation, demo, loss_picture
from biela.histories import History, read
from biela.programs import attenuation as attenuation_command

TIME = np.linspace(0.0, 0.02, 2001)


def wave(amplitude: float, more: float = 0.0) -> np.ndarray:
    """Return whole periods of a sine, with more of it before the swing's end."""
    return (amplitude + more * (attenuation.SWING > TIME)) * np.sin(2 * np.pi * 1000.0 * TIME)


def write(folder, name: str, columns: dict[str, np.ndarray], file: str = "history") -> None:
    """Write a result file."""
    place = folder / "results" / name
    place.mkdir(parents=True, exist_ok=True)
    head = "# columns: t[s] " + " ".join(columns)
    np.savetxt(place / f"{file}.txt", np.column_stack([TIME, *columns.values()]), header=head.removeprefix("# "))


def numbers(line: str) -> list[float]:
    """Return the numbers after the words of a line."""
    return [float(word) for word in re.findall(r"(?<![\w.])-?\d+\.?\d*(?:[eE][+-]?\d+)?(?![\w.])", line)]


def test_size_is_peak_and_root_mean_square():
    assert demo.size(np.array([3.0, -4.0, 0.0, 0.0])) == (4.0, 2.5)
    assert demo.size(wave(2.0)) == pytest.approx((2.0, np.sqrt(2.0)), rel=1e-3)


def test_the_demonstrations_table(tmp_path, monkeypatch):
    """Peak and root mean square of both runs and the ratio viscoelastic over undamped; the share of the work that is lost."""
    monkeypatch.chdir(tmp_path)
    pair = demo.PAIRS[0]
    for name, size in ((pair.elastic, 4.0), (pair.viscoelastic, 1.0)):
        write(tmp_path, name, {"qf4.q[rad]": wave(1.0), "qf4.qd[rad/s]": wave(size), "qf4.qdd[rad/s2]": wave(100.0 * size)})
    write(tmp_path, "stiff", {"qf4.q[rad]": wave(1.0), "qf4.qd[rad/s]": wave(2.0), "qf4.qdd[rad/s2]": wave(200.0)})
    write(tmp_path, pair.viscoelastic, {"dissipated[J]": 0.3 * TIME / TIME[-1], "work[J]": 2.0 * TIME / TIME[-1]}, "energy")
    title, *lines = demo.attenuation(pair, (Path("stiff.nml"), 1900.0, 1.32))
    assert title.split()[-6:] == ["undamped", "viscoelastic", "ratio", "stiff", "twin", "ratio"]
    root = np.sqrt(0.5)
    expected = [[4.0, 1.0, 0.25, 2.0, 0.5], [4.0 * root, root, 0.25, 2.0 * root, 0.5]]
    expected += [[100.0 * value for value in row[:2]] + [0.25, 100.0 * row[3], 0.5] for row in expected]
    for line, row, measure in zip(lines, expected, ("peak", "RMS", "peak", "RMS")):
        assert measure in line
        assert numbers(line.split(measure)[1]) == pytest.approx(row, rel=2e-3)
    assert numbers(lines[-1]) == pytest.approx([0.3, 15.0, 2.0], rel=1e-3)


def test_the_joints_table_takes_the_ringing_after_the_swing():
    cases = {"none": 4.0, "rod": 2.0, "joint": 1.0}
    runs = {}
    for case, amplitude in cases.items():
        data = np.column_stack([TIME, wave(amplitude, more=3.0)])
        runs[case] = History(None, ["t", "mid.q"], {"t": "s", "mid.q": "m"}, data)
    _, peak, rms = attenuation.table(runs, {"mid.q": "deflection"})
    assert numbers(peak.split("peak")[1]) == pytest.approx([7.0, 1.0, 5.0, 5 / 7, 4.0, 4 / 7], rel=2e-3)
    sizes = [amplitude * np.sqrt(0.5) for amplitude in cases.values()]
    assert numbers(rms.split("RMS")[1]) == pytest.approx([sizes[0], 1.0, sizes[1], 0.5, sizes[2], 0.25], rel=2e-3)


def test_the_joints_energies_are_those_at_the_end_and_the_motors_largest(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    s = TIME / TIME[-1]
    write(tmp_path, attenuation.deck_name("rod"), {"dissipated[J]": 0.25 * s, "work[J]": 8.0 * s * (1 - s)}, "energy")
    dissipated, work = attenuation.energies(["rod"])
    assert numbers(dissipated) == pytest.approx([0.25])
    assert numbers(work) == pytest.approx([2.0], rel=1e-5)
    assert read(tmp_path / "results" / attenuation.deck_name("rod"), "energy")["work"][-1] == 0.0


def test_cases_with_other_rows_are_not_compared(monkeypatch, capsys):
    rows = {case: 3 + (case == "both") for case in attenuation.CASES}
    runs = {attenuation.deck_name(case): np.linspace(0.0, 1.0, count)[:, None] for case, count in rows.items()}
    monkeypatch.setattr(attenuation, "run", lambda *_: None)
    monkeypatch.setattr(attenuation, "read", lambda path: History(path, ["t"], {"t": "s"}, runs[path.name]))
    assert attenuation_command.main([]) == 1
    assert capsys.readouterr() == ("", "attenuation: the four decks do not have the same output times\n")


def test_what_was_lost_is_split_between_friction_stops_and_damping():
    s = TIME / TIME[-1]
    names = ["t", "dissipated", "stops", "friction"]
    table = History(None, names, dict.fromkeys(names, "J") | {"t": "s"}, np.column_stack([TIME, 4.0 * s, 0.0 * s, 3.0 * s]))
    shares = loss_picture.parts(table)
    assert list(shares) == [loss_picture.DAMPING, "friction"]
    assert shares[loss_picture.DAMPING] == pytest.approx(s)
    lost = {"friction": [{"name": "pin", "lost": 3.0}], "losses": [{"material": "m", "kind": "ghm", "term": 1, "lost": 1.0}]}
    figure = loss_picture.draw(table, lost)
    right = figure.axes[1]
    assert [label.get_text() for label in right.get_yticklabels()] == ["friction of joint pin", "material m"]
    assert [text.get_text() for text in right.texts] == [" 3 J, 75 %", " 1 J, 25 %"]
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [f"{loss_picture.DAMPING}: 25 %", "friction: 75 %"]
    attenuation.plt.close(figure)
