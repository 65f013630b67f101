"""Pictures of modes, poles and frequency responses."""

from __future__ import annotations

import argparse
import itertools
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from . import labels
from .animate import SHEET_LOOK, Picture, panels_to_scale
from .histories import History, read
from .mechanism import Mechanism, from_run
from .picture_files import save, subplots
from .plot import COLOURS, LOOK, STYLES, axis_label, moving, stacked
from .result_files import RESULT_FILES, HistoryError

if TYPE_CHECKING:
    import pandas

UNDAMPED, VIBRATION, FURTHER, REAL = range(4)
SIZE = 0.12
ROUNDED = 1.0e-9  # the part of a pole that is rounding
DECADES = 7  # of the axes of a picture of poles
MARK = 14.0  # poles nearer than this lie over each other [pixel]
MOST_NUMBERS = 60  # poles that are numbered
POSITIONS = "# positions:"
SLIP = re.compile(r"(?P<body>.+)\.(?P<node>\d+)\.slip(?P<core>\d+)\.re")  # shear angle of a core at a node
INPUT = "# input:"
KINDS = {
    UNDAMPED: ("undamped", "o", "none"),
    VIBRATION: ("vibration", "o", COLOURS[0]),
    FURTHER: ("further pole of GHM", "D", COLOURS[3]),
    REAL: ("real pole", "s", COLOURS[1]),
}


def positions(path: Path) -> np.ndarray:
    """Return where frames and nodes are in the order of the shapes' columns [m, rad]; HistoryError: no such line."""
    try:
        return np.array(comment(path, POSITIONS).split(), dtype=float)
    except ValueError as fault:
        raise HistoryError(f"{path}: its line {POSITIONS!r} is damaged ({fault})") from None


def comment(path: Path, lead: str) -> str:
    """Return what stands behind a word in the comments of a results file; HistoryError where that has no such line."""
    with path.open(encoding="utf-8", errors="replace") as file:
        for line in itertools.takewhile(lambda one: one.startswith("#"), file):
            if line.startswith(lead):
                return line[len(lead) :].strip()
    raise HistoryError(f"{path}: has no line {lead!r}")


def shapes(table: History) -> tuple[list[str], np.ndarray]:
    """Return the names of the shapes' columns without .re, and the complex shapes, shape (rows, columns); HistoryError."""
    names = [name[: -len(".re")] for name in table.names if name.endswith(".re") and not SLIP.fullmatch(name)]
    if not names:
        raise HistoryError(f"{table.path}: has no columns of shapes")
    return names, np.column_stack([table[f"{name}.re"] + 1j * table[f"{name}.im"] for name in names])


def chosen_rows(table: History, wanted: list[int] | None, most: int = 6) -> list[int]:
    """Return the rows to draw: of each wanted mode the vibration, or where there is none the undamped mode; HistoryError."""
    rows = []
    modes = table["mode"].astype(int)
    kinds = table["kind"].astype(int)
    for mode in wanted or sorted(set(modes))[:most]:
        mine = [k for k in np.flatnonzero(modes == mode) if kinds[k] in (UNDAMPED, VIBRATION)]
        if not mine:
            raise HistoryError(f"{table.path}: has no mode {mode}, it has 1 to {modes.max()}")
        rows.append(max(mine, key=lambda k: kinds[k]))
    return rows


def moved(table: History, row: int) -> Mechanism:
    """Return the mechanism at rest (row 0) and at the two extremes of a shape (rows 1 and 2); HistoryError: it cannot be read."""
    names, shape = shapes(table)
    rest = positions(table.path)
    if len(rest) != len(names):
        raise HistoryError(f"{table.path}: {len(rest)} positions for {len(names)} shape columns")
    points = np.array([rest[[k, k + 1]] for k, name in enumerate(names) if name.endswith(".x")])
    extent = max(np.max(np.ptp(points, axis=0)), 1.0e-9)
    # an angle counts by how far it moves a rigid body, which has no nodes; those of a flexible body show what it moves
    rigid = [name.endswith(".angle") and f"{name[:-6]}.1.x" not in names for name in names]
    seen = np.array([extent * turns if name.endswith(".angle") else 1.0 for name, turns in zip(names, rigid)]) * shape[row]
    largest = seen[np.argmax(np.abs(seen))] or 1.0
    part = SIZE * extent * (shape[row] / largest).real  # at the instant when the largest displacement is at its extreme
    rows = np.array([[0.0, *rest], [1.0, *(rest + part)], [2.0, *(rest - part)]])
    return from_run(History(table.path, ["t", *names], {}, rows))


def caption(table: History, row: int) -> str:
    """Return frequency and damping ratio of a row in words."""
    frequency, ratio = table["frequency"][row], table["damping_ratio"][row]
    text = f"mode {int(table['mode'][row])}: {frequency:.4g} Hz"
    return text if table["kind"][row] == UNDAMPED else text + f", ζ = {ratio:.3g}"


def draw_shapes(table: History, rows: list[int], title: str = "") -> Figure:
    """Return a figure of the shapes of the given rows, the mechanism at rest in grey."""
    scenes = [moved(table, row) for row in rows]
    corners = np.array([scene.extent() for scene in scenes])
    low, high = corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)
    with mpl.rc_context(SHEET_LOOK):
        figure, axes = panels_to_scale(len(rows), low, high, 0.3, title)
        for axis, row, scene in zip(axes, rows, scenes):
            picture = Picture(axis, scene, (low, high))
            picture.show(2)
            ghosts = [line.get_xydata().copy() for line in picture.bodies]
            picture.show(0)
            ghosts += [line.get_xydata().copy() for line in picture.bodies]
            picture.show_still(1)
            for k, ghost in enumerate(ghosts):
                still = k >= len(picture.bodies)
                axis.plot(*ghost.T, "-" if still else "--", color="#bbbbbb", lw=1.6 if still else 1.0, zorder=1)
            axis.set_title(caption(table, row), fontsize=9)
    return figure


def threshold(values: np.ndarray, poles: np.ndarray) -> float:
    """Return the power of ten below which a part of the poles is drawn linearly: `DECADES` below the largest; less is rounding."""
    size = np.abs(poles)
    largest = size.max(initial=0.0)
    above = np.abs(values)[np.abs(values) > np.maximum(ROUNDED * size, 10.0**-DECADES * largest)]
    return float(10.0 ** np.floor(np.log10(above.min()))) if above.size else float(largest or 1.0)


def decades(interval: tuple[float, float], least: float) -> np.ndarray:
    """Return 0 and the powers of ten of an axis that is linear below the least of them; matplotlib's own crowd about 0."""
    powers = 10.0 ** np.arange(np.log10(least), np.log10(max(np.abs(interval))) + 1.0e-9)
    powers = powers[:: -(-powers.size // DECADES)]
    ticks = np.concatenate([-powers[::-1], [0.0], powers])
    return ticks[(ticks >= interval[0]) & (ticks <= interval[1])]


def number_poles(axis: Axes, modes: np.ndarray, real: np.ndarray, imag: np.ndarray) -> None:
    """Write the numbers of modes beside their poles; one text for poles whose marks lie over each other."""
    at = axis.transData.transform(np.column_stack([real, imag]))
    groups: list[list[int]] = []
    for k in np.argsort(at[:, 1], kind="stable"):
        near = next((g for g in groups if np.hypot(*(at[g[-1]] - at[k])) < MARK), None)
        near.append(k) if near else groups.append([k])
    names = [", ".join(map(str, sorted(set(modes[group])))) for group in groups]
    points = [np.array([real[group].max(), imag[group].max()]) for group in groups]
    labels.write(axis, [labels.Label(point, name, "black") for point, name in zip(points, names)])


def draw_poles(table: History, title: str = "") -> Figure:
    """Return a figure of the poles in the upper half plane, both axes symmetric-logarithmic."""
    kinds = table["kind"].astype(int)
    poles = table["real"] + 1j * table["imag"]
    real, imag = poles.real, poles.imag
    with mpl.rc_context(LOOK):
        figure, axis = subplots(figsize=(7.2, 4.8))
        linear = [threshold(part, poles) for part in (real, imag)]
        axis.set_xscale("symlog", linthresh=linear[0])
        axis.set_yscale("symlog", linthresh=linear[1])
        for kind, (label, marker, fill) in KINDS.items():
            mine = kinds == kind
            if mine.any():
                edge = "#666666" if kind == UNDAMPED else fill
                axis.plot(real[mine], imag[mine], marker, mfc=fill, mec=edge, ls="none", ms=6, label=label)
        axis.axvline(0.0, color="#999999", lw=0.8)
        axis.margins(0.08)
        axis.set_xlim(min(real.min() * 2.0, -linear[0]), max(real.max() * 2.0, 0.3 * linear[0]))
        axis.set_ylim(-0.3 * linear[1], max(imag.max() * 2.0, linear[1]))
        scale = "logarithmic, linear within ±{:.3g}"
        axis.set_xlabel("real part [1/s], " + scale.format(linear[0]))
        axis.set_ylabel("imaginary part [rad/s], " + scale.format(linear[1]))
        axis.set_title(title)
        for one, least in zip((axis.xaxis, axis.yaxis), linear):
            one.set_major_locator(mpl.ticker.FixedLocator(decades(one.get_view_interval(), least)))
        figure.legend(loc="outside upper center", ncols=4)
        figure.lay_out()
        mine = np.flatnonzero(kinds != UNDAMPED if (kinds == VIBRATION).any() else kinds == UNDAMPED)
        if mine.size <= MOST_NUMBERS:
            number_poles(axis, table["mode"][mine].astype(int), real[mine], imag[mine])
    return figure


def draw_shares(table: History, title: str = "") -> Figure | None:
    """Return a figure of the parts of each vibration's loss and energy that viscoelastic layers have; None where there are none."""
    layers = [name[: -len(".loss")] for name in table.names if name.endswith(".loss")]
    rows = np.flatnonzero(table["kind"] == VIBRATION)
    if not layers or not rows.size:
        return None
    with mpl.rc_context(LOOK):
        figure, axes = subplots(2, 1, figsize=(7.2, 4.8), sharex=True)
        for axis, part, words in zip(axes, ("loss", "energy"), ("share of the loss", "share of the energy")):
            below = np.zeros(rows.size)
            for k, layer in enumerate(layers):
                share = table[f"{layer}.{part}"][rows]
                look = dict(color=COLOURS[k % len(COLOURS)], label=layer if part == "loss" else None)
                axis.bar(range(rows.size), share, 0.6, below, **look)
                below += share
            axis.set(ylabel=words, ylim=(0.0, 1.05 * max(below.max(), 1.0e-3)))
            axis.grid(visible=False, axis="x")
        names = [caption(table, row).replace(": ", "\n").replace(", ", "\n") for row in rows]
        axes[1].set_xticks(range(rows.size), names, fontsize=8)
        figure.legend(loc="outside upper center", ncols=4, title=title or None)
    return figure


def draw_slip(table: History, rows: list[int], title: str = "") -> Figure | None:
    """Return a figure of how cores of beams shear along them in modes of rows, where any does; None where there are no cores."""
    cores: dict[tuple[str, str], list[str]] = {}
    for found in filter(None, map(SLIP.fullmatch, table.names)):
        cores.setdefault(found.group("body", "core"), []).append(found.string[: -len(".re")])
    if not cores:
        return None
    rest = dict(zip(shapes(table)[0], positions(table.path)))
    with mpl.rc_context(LOOK):
        figure, axes = subplots(len(cores), 1, figsize=(7.2, 1.0 + 2.4 * len(cores)), squeeze=False)
        for axis, ((body, core), names) in zip(axes[:, 0], cores.items()):
            nodes = np.array([[rest[f"{body}.{k}.{x}"] for x in "xy"] for k in range(1, len(names) + 1)])
            along = np.cumsum([0.0, *np.hypot(*np.diff(nodes, axis=0).T)])
            angles = np.array([table[f"{name}.re"] + 1j * table[f"{name}.im"] for name in names])
            angles[~angles.any(axis=1)] = np.nan
            for k, row in enumerate(rows):
                angle = angles[:, row]
                largest = angle[np.nanargmax(np.abs(angle))] if angle.any() else 1.0
                look = dict(color=COLOURS[k % len(COLOURS)], ls=STYLES[k % len(STYLES)], marker=".")
                axis.plot(along, (angle / largest).real, label=caption(table, row), **look)
            axis.axhline(0.0, color="#bbbbbb", lw=0.8, zorder=1)
            axis.set(ylabel=f"shear of core {core} of {body}\nover its largest", xlabel="place along the nodes [m]")
        handles, labels_ = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels_, loc="outside upper center", ncols=3, fontsize=8, title=title or None)
    return figure


def sensors(table: History, patterns: list[str] | None) -> list[str]:
    """Return the sensor columns of a frequency response that patterns select; without patterns all that are more than rounding."""
    names = table.match([f"{p}.amplitude" for p in patterns or ["*"]])
    return [name[: -len(".amplitude")] for name in (names if patterns else moving([table], names))]


def draw_response(table: History, names: list[str], title: str = "") -> Figure:
    """Return a figure with two panels for each unit: amplitude (logarithmic) above, phase below, per unit of the input."""
    f = table["f"]
    groups: dict[str, list[str]] = {}
    for name in names:
        groups.setdefault(table.units[f"{name}.amplitude"], []).append(name)
    logarithmic = f[0] > 0.0 and f[-1] / f[0] > 5.0
    with mpl.rc_context(LOOK):
        across = -(-len(groups) // 2)  # pairs of panels side by side: a picture is no taller than wide
        down = -(-len(groups) // across)
        size = (8.0 + 5.0 * (across - 1), 0.8 + 3.4 * down)
        figure, axes = stacked(len(groups), across, size, (3, 2), axis_label("f", "Hz"))
        for k, (unit, group) in enumerate(groups.items()):
            upper, lower = axes[2 * k : 2 * k + 2]
            for j, name in enumerate(group):
                amplitude = np.where(table[f"{name}.amplitude"] > 0.0, table[f"{name}.amplitude"], np.nan)
                style = {"color": COLOURS[j % len(COLOURS)], "ls": STYLES[j % len(STYLES)]}
                upper.plot(f, amplitude, label=name, **style)
                lower.plot(f, np.degrees(np.unwrap(table[f"{name}.phase"])), **style)
            upper.set_yscale("log")
            upper.set_ylabel(axis_label("amplitude", unit))
            upper.legend(ncols=min(len(group), 4), loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2)
            lower.set_ylabel("phase [°]")
            middle = np.mean(lower.get_ylim())
            lower.set_ylim(min(lower.get_ylim()[0], middle - 100.0), max(lower.get_ylim()[1], middle + 100.0))
            lower.yaxis.set_major_locator(mpl.ticker.MultipleLocator(90.0 if np.ptp(lower.get_ylim()) < 450.0 else 180.0))
        for axis in axes if logarithmic else []:
            axis.set_xscale("log")
        figure.suptitle(", ".join(filter(None, [title, input_of(table.path)])), fontsize=10)
    return figure


def input_of(path: Path) -> str:
    """Return what the amplitudes of a response belong to, from the file's comment."""
    try:
        return f"response to {comment(path, INPUT).partition(';')[0].strip()}, per unit of its history"
    except (HistoryError, OSError):
        return ""


@dataclass(frozen=True)
class Modes:
    """Modes of a run: undamped ones, vibrations, further poles."""

    table: History  # of modes.txt: kind, frequency [Hz], damping ratio [-], poles [1/s], [rad/s], shapes

    def to_dataframe(self) -> pandas.DataFrame:
        """Return kind, number, frequency [Hz], damping ratio and pole of each mode."""
        import pandas

        names = ["mode", "frequency", "damping_ratio", "real", "imag"]
        columns = {"kind": [KINDS[int(kind)][0] for kind in self.table["kind"]], **{name: self.table[name] for name in names}}
        units = {name: f"{name}_[{self.table.units[name]}]" for name in names if self.table.units[name] not in ("", "-")}
        return pandas.DataFrame(columns).rename(columns=units).astype({"mode": int})

    def picture(self, modes: list[int] | None = None, title: str = "") -> Figure:
        """Draw the shapes of modes by their numbers (the first six) over the mechanism."""
        return draw_shapes(self.table, chosen_rows(self.table, modes), title)

    def poles(self, title: str = "") -> Figure:
        """Draw the poles in the complex plane."""
        return draw_poles(self.table, title)

    def shares(self, title: str = "") -> Figure | None:
        """Draw what viscoelastic layers have of each vibration's loss and energy; None: no body has such layers."""
        return draw_shares(self.table, title)

    def slip(self, modes: list[int] | None = None, title: str = "") -> Figure | None:
        """Draw how cores shear along their beams in modes by their numbers (the first six); None: no body has cores."""
        return draw_slip(self.table, chosen_rows(self.table, modes), title)

    def _repr_html_(self) -> str:
        return self.to_dataframe().to_html(max_rows=20)


def draw_all(args: argparse.Namespace) -> int:
    """Draw what the run has and say which files were written; raises HistoryError."""
    if args.run.name in RESULT_FILES.values() and args.run.is_file():
        args.run = args.run.parent
    stem = args.output or args.run / "modal"
    paths = []
    there = [kind for kind in ("modes", "frequency_response") if (args.run / RESULT_FILES[kind]).is_file()]
    if not there:
        raise HistoryError(f"{args.run}: has neither modes.txt nor frequency_response.txt (has the run been made?)")
    if "modes" in there:
        found, title = Modes(read(args.run, "modes")), args.title
        figures = found.picture(args.modes, title), found.poles(title), found.shares(title), found.slip(args.modes, title)
        paths += [save(figure, stem, name) for figure, name in zip(figures, ("_modes", "_poles", "_shares", "_slip")) if figure]
    if "frequency_response" in there:
        table = read(args.run, "frequency_response")
        figure = draw_response(table, sensors(table, args.columns), args.title)
        paths.append(save(figure, stem, "_response"))
    print("wrote " + ", ".join(map(str, paths)))
    return 0
