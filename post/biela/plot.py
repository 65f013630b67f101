"""Columns of one or several runs against time, or against another column."""

from __future__ import annotations

import argparse
import re

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from .histories import History, common_still, read, read_events
from .picture_files import save, subplots
from .result_files import RESULT_FILES, HistoryError

# told apart by colour-blind readers, and in grey by lightness or by line style
COLOURS = ["#0b45b0", "#e0452f", "#009e73", "#e69f00", "#7b3294", "#56b4e9", "#5b3a1e", "#8c8c8c"]
STYLES = ["-", (0, (6, 2)), (0, (1, 1.5)), (0, (6, 2, 1, 2)), (0, (10, 3)), (0, (3, 1.5, 1, 1.5, 1, 1.5))]
FLAT = 50.0
STEADY = 1.0e-9  # share of its size by which a column varies that is constant
ROUNDING = 1.0e-12  # columns that never exceed this share of the largest one of their unit are rounding
PATH = (3.0, 6.0)  # sides of a panel that is drawn to scale [inch]
THINNED = 1200  # parts of a column, more than a panel has dots across
MOST_PANELS = 24  # of one picture
ONE_COLUMN = 5  # more panels stand in two columns
LOOSE = ("open", "forward", "backward", "carried")  # states of stops and joints after an event that holds nothing
LOOK = {
    "font.size": 10,
    "axes.grid": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "axes.formatter.limits": (-3, 4),
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.prop_cycle": mpl.cycler(color=COLOURS),
    "lines.linewidth": 1.2,
    "legend.frameon": False,
    "legend.fontsize": 9,
    "savefig.dpi": 150,
}


def body_look(k: int) -> tuple[str, object]:
    """Return colour and line style of the k-th body of a scene, the same in all pictures; drives, forces, springs have others."""
    colours = [COLOURS[j] for j in (0, 3, 5, 6, 7)]
    return colours[k % len(colours)], STYLES[k // len(colours) % len(STYLES)]


def pretty_unit(unit: str) -> str:
    """Return a unit as text shows it: rad/s2 as rad/s², Nm as N m."""
    for plain, nice in (("^2", "²"), ("s2", "s²"), ("m2", "m²"), ("m3", "m³"), ("Nm", "N m"), ("*", " ")):
        unit = unit.replace(plain, nice)
    return unit


def axis_label(name: str, unit: str) -> str:
    """Return `name [unit]`, or either alone."""
    return " ".join(part for part in (name, f"[{pretty_unit(unit)}]" if unit else "") if part)


def heading_label(heading: str) -> str:
    """Return the label of a heading `name[unit]`: the unit alone is written as units are, a name such as m2 stays."""
    name, _, unit = heading.partition("[")
    return axis_label(name, unit.rstrip("]"))


def unit_of(runs: list[History], name: str) -> str:
    """Return the unit that the first of the runs that knows one states for a column."""
    return next((run.units[name] for run in runs if run.units.get(name)), "")


def panels(runs: list[History], names: list[str]) -> list[list[str]]:
    """Return names by panels: one unit each, no range below a fiftieth of the height, no more than there are line styles."""
    result: list[list[str]] = []
    low, high = (
        {name: pick(run.ends[name][k] for run in runs if name in run) for name in names} for k, pick in ((0, min), (1, max))
    )
    for name in names:
        for panel in result:
            both = [*panel, name]
            least, height = min(high[one] - low[one] for one in both), max(map(high.get, both)) - min(map(low.get, both))
            if unit_of(runs, panel[0]) == unit_of(runs, name) != "" and least * FLAT >= height and len(panel) < len(STYLES):
                panel.append(name)
                break
        else:
            result.append([name])
    return result


def draw(
    runs: list[History], labels: list[str], names: list[str], against: str | None = None, title: str = "", styled: bool = False
) -> Figure:
    """Return a figure of columns of runs against one (time); styled: the line style tells the run, the colour the column."""
    abscissa = against or runs[0].names[0]
    groups = panels(runs, names)
    path = unit_of(runs, abscissa) if against is not None else ""
    columns = 1 if len(groups) <= ONE_COLUMN else 2
    lines = -(-len(groups) // columns)
    with mpl.rc_context(LOOK):
        size = (8.0 if columns == 1 else 12.0, 0.8 + 2.2 * lines)
        if path and len(groups) == 1 and unit_of(runs, groups[0][0]) == path:
            size = _to_scale(runs, groups[0], abscissa)
        figure, axes = stacked(len(groups), columns, size, abscissa=axis_label(abscissa, unit_of(runs, abscissa)))
        for axis, group in zip(axes, groups):
            axis.locator_params(axis="y", nbins=6)
            _panel(axis, runs, labels, group, abscissa, styled)
            _log_scales(axis, runs, group, abscissa)
            if path and unit_of(runs, group[0]) == path:
                axis.set_aspect("equal", adjustable="datalim")
                axis.locator_params(nbins=6)
        if len(runs) > 1:
            looks = [("#333333" if styled else COLOURS[k % len(COLOURS)], STYLES[k % len(STYLES)]) for k in range(len(runs))]
            handles = [Line2D([], [], label=label, color=colour, ls=style) for label, (colour, style) in zip(labels, looks)]
            figure.legend(handles=handles, loc="outside lower center", ncols=min(len(runs), 4))
        if title:
            figure.suptitle(title)
        if size[1] == 0.8 + 2.2 * lines:  # margins are known: to measure them takes a third of the picture's time
            rows = max(-(-len(group) // 4) if len(group) > 1 else 0 for group in groups)  # of legends above panels
            gap, top, bottom = 0.3 + 0.2 * rows, 0.3 + 0.2 * rows + 0.3 * bool(title), 0.55 + 0.3 * (len(runs) > 1)
            tall, wide = (size[1] - top - bottom - gap * (lines - 1)) / lines, (size[0] - 1.1 - 1.1 * (columns - 1)) / columns
            figure.subplots_adjust(
                0.95 / size[0], bottom / size[1], 1.0 - 0.15 / size[0], 1.0 - top / size[1], 1.1 / wide, gap / tall
            )
            figure.placed = True
    return figure


def mark_beyond(axis: Axes, along: np.ndarray, values: np.ndarray, colour: str) -> None:
    """Mark points above or below an axis, whose ends are set, by triangles at its edge."""
    along, values, (low, high) = np.array(along), np.array(values), axis.get_ylim()
    for beyond, edge, mark in ((values > high, high, "^"), (values < low, low, "v")):
        if beyond.any():
            axis.plot(along[beyond], np.full(beyond.sum(), edge), mark, color=colour, ms=4, clip_on=False, zorder=5)


def stacked(
    count: int, columns: int, figsize: tuple[float, float], heights: tuple[int, ...] = (1,), abscissa: str | None = None
) -> tuple[Figure, list[Axes]]:
    """Return a figure and so many axes, or groups of axes of these heights, in columns; they share the abscissa that is named."""
    rows = -(-count // columns)
    figure, grid = subplots(
        rows * len(heights), columns, figsize, squeeze=False, height_ratios=heights * rows, sharex=abscissa is not None
    )
    groups = [group for line in np.split(grid, rows) for group in line.T]
    for axis in np.ravel(groups[count:]):
        axis.remove()
    for group in groups[max(count - columns, 0) : count] if abscissa is not None else ():
        group[-1].tick_params(labelbottom=True)
        group[-1].set_xlabel(abscissa)
        group[-1].margins(x=0.01)
    return figure, list(np.ravel(groups[:count]))


def _to_scale(runs: list[History], group: list[str], abscissa: str) -> tuple[float, float]:
    """Return the size of a picture that paths to scale fill [inch], within what a page takes."""
    wide = max(float(np.ptp(run[abscissa])) for run in runs)
    high = max(run.ends[name][1] for run in runs for name in group) - min(run.ends[name][0] for run in runs for name in group)
    longer = max(wide, high) or 1.0
    width, height = (max(PATH[1] * side / longer, PATH[0]) for side in (wide, high))
    return width + 1.2, height + 1.0


def _panel(axis: Axes, runs: list[History], labels: list[str], group: list[str], abscissa: str, styled: bool) -> None:
    """Draw one panel: the colour tells the run and the line style the column, styled: the other way round."""
    for k, (run, label) in enumerate(zip(runs, labels)):
        for j, name in enumerate(group):
            colour = COLOURS[(k if len(runs) > 1 and not styled else j) % len(COLOURS)]
            style = STYLES[(j if len(group) > 1 and not (styled and len(runs) > 1) else k) % len(STYLES)]
            words = [label] if len(runs) > 1 else []
            words += [name] if len(group) > 1 else []
            axis.plot(*thinned(run[abscissa], run[name]), ls=style, color=colour, label=": ".join(words) or None)
    axis.set_ylabel(axis_label(group[0] if len(group) == 1 else "", unit_of(runs, group[0])))
    if len(group) > 1:
        looks = [
            dict(color=COLOURS[j % len(COLOURS)]) if styled else dict(color="#333333", ls=STYLES[j]) for j in range(len(group))
        ]
        handles = [Line2D([], [], **look) for look in looks] if len(runs) > 1 else axis.lines
        axis.legend(handles, group, ncols=4, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2)


def thinned(along: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows that a picture can show: of a long column its ends, least and largest of many parts; of a path all."""
    part = values.size // THINNED
    if part < 8 or np.any(along[1:] < along[:-1]):
        return along, values
    used = part * (values.size // part)
    parts = values[:used].reshape(-1, part)
    begins = np.arange(0, used, part)
    rows = [begins + parts.argmin(axis=1), begins + parts.argmax(axis=1), np.arange(used, values.size), [0, values.size - 1]]
    rows = np.unique(np.concatenate(rows))
    return along[rows], values[rows]


def _log_scales(axis: Axes, runs: list[History], group: list[str], abscissa: str) -> None:
    """Draw a frequency response on logarithmic axes: frequencies that were spaced so, amplitudes that are never zero."""
    if unit_of(runs, abscissa) != "Hz":
        return
    steps = np.diff(np.log(np.maximum(runs[0][abscissa], 1.0e-300)))
    if steps.size > 1 and np.ptp(steps) <= 1.0e-6 * np.abs(steps).max():
        axis.set_xscale("log")
    amplitudes = [run[name] for run in runs for name in group if name.endswith(".amplitude")]
    if len(amplitudes) == len(group) * len(runs) and min(map(np.min, amplitudes)) > 0.0:
        axis.set_yscale("log")


def usual_columns(run: History) -> list[str]:
    """Return what is drawn where none are named: sensors of an equilibrium, parts of a response, else all; HistoryError."""
    names = [name for name in run.match(None) if run.size(name) > 0.0] or run.match(None)
    if run.path.name == RESULT_FILES["modes"]:
        raise HistoryError(f"{run.path}: its rows are modes, not times: name --columns, or draw them with post/modes.py")
    if run.path.name == RESULT_FILES["static"]:
        return [name for name in names if not name.startswith("state.") and name not in ("residual", "newton_steps")] or names
    if run.path.name == RESULT_FILES["frequency_response"]:
        drawn = {name.rpartition(".")[0] for name in names if name.endswith(".amplitude")}
        shown = [name for name in run.names if name.rpartition(".")[0] in drawn]
        return [name for name in shown if name.endswith((".amplitude", ".phase"))] or names
    return names


def moving(runs: list[History], names: list[str]) -> list[str]:
    """Return the columns that exceed rounding in any run, as the solver says; else, as compared with the largest of their unit."""
    if (still := common_still(runs)) is not None:
        return [name for name in names if still.get(name, 1.0) != 0.0]
    size = {name: max((run.size(name) for run in runs if name in run), default=0.0) for name in names}
    units = {name: unit_of(runs, name) for name in names}
    largest = {unit: max(size[name] for name in names if units[name] == unit) for unit in units.values()}
    time = min((float(np.ptp(run.time)) for run in runs if run.names[0] == "t"), default=0.0) or np.inf
    natural = {"rad": 1.0, "rad/s": 1.0 / time, "rad/s2": 1.0 / time**2, "Nm": largest.get("N", 0.0) * largest.get("m", 0.0)}
    largest = {unit: max(value, natural.get(unit, 0.0)) for unit, value in largest.items()}
    return [name for name in names if size[name] > (ROUNDING * largest[units[name]] if units[name] else 0.0)]


def chosen_columns(runs: list[History], patterns: list[str] | None, against: str | None) -> tuple[list[str], list[str]]:
    """Return what is drawn, and what is not: zero, rounding, or constant in every run; HistoryError: no such column."""
    found = [run.match(patterns) if patterns else usual_columns(run) for run in runs]
    names = [name for name in dict.fromkeys(name for mine in found for name in mine) if name != against]
    for run in runs:
        for name in names:
            run[name]
    if runs[0].path.name == RESULT_FILES["energy"]:  # its residual and violations tell something as rounding, too
        idle = [name for name in runs[0].names[1:] if not any(run.size(name) > 0.0 for run in runs if name in run)]
    else:
        large = moving(runs, runs[0].names[1:])
        idle = [name for name in runs[0].names[1:] if name not in large]
    if patterns:
        return names, []
    names = [name for name in names if name not in idle] or names
    idle = [name for name in idle if name not in names]
    still = common_still(runs) or {}
    steady = [all(run.ends[name][1] - run.ends[name][0] <= STEADY * run.size(name) for run in runs) for name in names]
    constant = [name for name, stands in zip(names, steady) if stands or name in still]
    constants = [f"{name} = {runs[0][name][0]:.6g} {pretty_unit(unit_of(runs, name))}".rstrip() for name in constant]
    return [name for name in names if name not in constant] or names, idle + (constants if len(constant) < len(names) else [])


def mark_events(figure: Figure, runs: list[History]) -> int:
    """Mark the events of the runs in all panels, by dots what lets go. Return how many there are."""
    count, handles = 0, [handle for legend in figure.legends for handle in legend.legend_handles]
    for k, run in enumerate(runs):
        events = read_events(run.path.parent)
        count += len(events)
        colour = COLOURS[k % len(COLOURS)] if len(runs) > 1 else "#b0126e"
        for kind, style in (("touches or sticks", "-"), ("lets go or slips", ":")):
            times = [one.time for one in events if (one.after in LOOSE) == (style == ":")]
            for axis in figure.axes if times else ():
                ends = axis.get_xlim()
                axis.vlines(times, 0.0, 1.0, colour, style, lw=0.6, alpha=0.5, zorder=1, transform=axis.get_xaxis_transform())
                axis.set_xlim(ends)
            handles += [Line2D([], [], color=colour, ls=style, lw=1.0, label=kind)] if times else []
    for legend in figure.legends[:]:
        legend.remove()
    if handles:
        figure.legend(handles=handles, loc="outside lower center", ncols=min(len(handles), 4))
    return count


def plot(args: argparse.Namespace) -> int:
    """Draw as the command line asks and say which files were written; raises HistoryError."""
    runs = [read(source, args.file) for source in args.runs]
    if args.turns:
        try:
            first, last = map(int, args.turns[1:])
        except ValueError:
            raise HistoryError(f"--turns {' '.join(args.turns)}: ANGLE and two whole numbers expected") from None
        runs = [run.turns(args.turns[0], first, last) for run in runs]
    if args.labels and len(args.labels) != len(runs):
        raise HistoryError(f"{len(args.labels)} labels for {len(runs)} runs: one each expected")
    names, idle = chosen_columns(runs, args.columns, args.against)
    own = [run.path.parent.name if run.path.name in RESULT_FILES.values() else "" for run in runs]
    labels = args.labels or [name or run.path.stem for name, run in zip(own, runs)]
    groups = panels(runs, names)
    crowded = [name for group in groups[MOST_PANELS:] for name in group]
    names = [name for name in names if name not in crowded]
    figure = draw(runs, labels, names, args.against, args.title or f"{args.file} of {', '.join(labels)}")
    if args.events:
        if (args.against or runs[0].names[0]) != "t":
            raise HistoryError("--events marks times: the horizontal axis has to be t")
        print(f"events marked: {mark_events(figure, runs)}")
    words = [args.file, *(args.columns or []), *(["against", args.against] if args.against else []), *labels[1:]]
    stem = re.sub(r"[^\w.+-]+", "_", "_".join(words).replace("*", ""))[:100].rstrip("._")
    path = save(figure, args.output or runs[0].path.parent / stem)
    if idle:
        print(f"left out, zero, rounding or constant throughout: {', '.join(idle)}")
    if crowded:
        print(f"left out, {MOST_PANELS} panels are full: {', '.join(crowded)}; --columns chooses")
    print(f"wrote {path}")
    return 0
