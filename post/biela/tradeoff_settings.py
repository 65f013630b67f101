"""Integration settings of a deck: method with step or tolerance, on the output times of the comparison.

All runs of a study write rows at the same times. A deck that states `output_step` keeps it in what is recommended; without
one it would write a row each step, and the study chooses an interval.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from .deck_text import DeckError, DeckText

ROWS = 400  # number of rows to compare, about
METHODS = ("rk4", "dopri5", "generalized_alpha", "radau")
# name of a curve: (method, what is varied)
FAMILIES = {
    "rk4": ("rk4", "step"),
    "dopri5": ("dopri5", "tolerance"),
    "generalized_alpha": ("generalized_alpha", "step"),
    "radau": ("radau", "step"),
    "radau adaptive": ("radau", "tolerance"),
}
ORDERS = {"rk4": 4.0, "generalized_alpha": 2.0, "radau": 5.0}
COUNTS = sorted({1, 2, 3} | {base * 2**k for base in (4, 5, 6, 7) for k in range(28)})  # steps in an interval
LENGTHS = ("length", "position", "point_a", "point_b", "com", "node_x", "node_y", "centre")
ONLY_ADAPTIVE = ("first_step", "max_step")


@dataclass(frozen=True)
class TradeoffOptions:
    """What is asked of a trade-off.

    Attributes:
        deck: its path
        biela: the solver
        output: folder of the results; None: results/tradeoff/<deck name>
        sensor: sensors or columns (`tip.v`) to get right; none: all
        tolerance: largest error over a column's range [-]
        budget: seconds that a recommended run may take [s]
        truth: 'deck' or 'refined': what measures errors
        methods: that are tried
        jobs: runs side by side; None: as many as there are cores
        longest_run: seconds that any run may take [s]
        time: seconds that the study may take [s]
        shown: the progress is shown, where standard error is a terminal
        loading_seconds: of the processor, which count as used [s]
    """

    deck: Path
    biela: Path
    output: Path | None = None
    sensor: tuple[str, ...] = ()
    tolerance: float = 1.0e-3
    budget: float = math.inf
    truth: str = "deck"
    methods: tuple[str, ...] = METHODS
    jobs: int | None = None
    longest_run: float = 120.0
    time: float = 600.0
    shown: bool = False
    loading_seconds: float = 0.0


@dataclass(frozen=True)
class Grid:
    """Times of the comparison.

    Attributes:
        t_end: end of the run [s]
        interval: between compared rows [s]
        largest: the largest fixed step [s]: the deck's own output_step where it states one
        stated: the output_step that the deck states, 0 without [s]
    """

    t_end: float
    interval: float
    largest: float
    stated: float

    @property
    def highest(self) -> float:
        """The highest frequency that the compared rows can show [Hz]."""
        return 0.5 / self.interval


@dataclass(frozen=True)
class Setting:
    """A method with its step or tolerance: entry `index` of the family's ladder, coarse to fine."""

    family: str
    index: int

    @property
    def method(self) -> str:
        """The deck's word for the method."""
        return FAMILIES[self.family][0]

    @property
    def adaptive(self) -> bool:
        """Whether a tolerance is given, not a step."""
        return FAMILIES[self.family][1] == "tolerance"

    def finer(self, by: int = 1) -> Setting:
        """Return the setting that many entries finer (coarser where negative)."""
        return Setting(self.family, self.index + by)

    def doubled(self) -> Setting:
        """Return the setting with half the step, or a tenth of the tolerance."""
        return self.finer(2) if self.adaptive else Setting(self.family, COUNTS.index(2 * COUNTS[self.index]))

    def better(self, factor: float) -> Setting:
        """Return the coarsest finer setting whose error should be smaller by a factor, going at most two doublings."""
        if self.adaptive:
            return self.finer(min(max(1, math.ceil(2.0 * math.log10(factor))), 4))
        wanted = COUNTS[self.index] * min(factor ** (1.0 / ORDERS[self.family]), 4.0)
        return Setting(self.family, max(self.index + 1, next(k for k, n in enumerate(COUNTS) if n >= wanted)))

    def exists(self) -> bool:
        """Whether the ladder has that entry."""
        return 0 <= self.index < (21 if self.adaptive else len(COUNTS) - 20)

    def size(self, grid: Grid) -> float:
        """Return the step [s] or the tolerance."""
        return float(f"{10.0 ** (-2.0 - 0.5 * self.index):.2e}") if self.adaptive else grid.largest / COUNTS[self.index]

    def words(self, grid: Grid) -> str:
        """Return the setting in words."""
        return f"{self.method} {'tolerance' if self.adaptive else 'step'} {self.size(grid):.3g}" + " s" * (not self.adaptive)


def grid_of(deck: DeckText) -> Grid:
    """Return the times at which runs of the deck are compared; DeckError where the deck has no usable transient."""
    transient = deck.one("transient")
    t_end, stated = transient.number("t_end"), transient.number("output_step")
    if not t_end > 0.0:
        raise DeckError("the deck's &transient states no t_end")
    own = stated or transient.number("step") or t_end / 1000.0
    rows = max(round(t_end / own), 1)
    most = max(1, rows // ROWS)
    group = next((k for k in range(most, most // 3, -1) if rows % k == 0), most)
    return Grid(t_end, own * group, stated or own * group, stated)


def length_of(deck: DeckText) -> float:
    """Return the largest length that stands in the deck [m], 1 where none does."""
    found = [abs(x) for group in deck.groups for key in LENGTHS for x in group.numbers(key)]
    return max(found, default=0.0) or 1.0


def with_setting(deck: DeckText, setting: Setting, grid: Grid, output: float) -> DeckText:
    """Return the deck with a setting and an interval of output; what belongs to other methods is taken out."""
    transient = deck.one("transient")
    values: dict[str, str | None] = dict.fromkeys((*ONLY_ADAPTIVE, "accept_unstable", "check_error", "accuracy", "most_seconds"))
    if setting.method in ("generalized_alpha", "radau"):
        values |= dict.fromkeys(("stabilization", "baumgarte_alpha", "baumgarte_beta"))
    if setting.method != "generalized_alpha":
        values["spectral_radius"] = None
    values["method"] = f"'{setting.method}'"
    values["tolerance" if setting.adaptive else "step"] = f"{setting.size(grid):.17g}"
    values["step" if setting.adaptive else "tolerance"] = None
    values["output_step"] = f"{output:.17g}"
    return deck.set(transient, **values)


def with_accuracy(deck: DeckText, accuracy: float, grid: Grid, asked: set[str]) -> str:
    """Return the text of the deck with an accuracy in place of its method and step, for the sensors that are asked for."""
    gone = (*ONLY_ADAPTIVE, "method", "step", "tolerance", "accept_unstable", "check_error", "spectral_radius")
    gone += ("stabilization", "baumgarte_alpha", "baumgarte_beta")
    values = {**dict.fromkeys(gone), "accuracy": f"{accuracy:.17g}", "output_step": f"{grid.interval:.17g}"}
    return for_search(deck.set(deck.one("transient"), **values), None, grid, asked)


def with_checks(deck: DeckText, accuracy: float, grid: Grid, asked: set[str]) -> str:
    """Return the same with estimates of what left-out modes and meshes make the columns err; '' where there are neither."""
    bodies, own = deck.all("body"), {**dict.fromkeys(("check_reduction", "check_mesh"))}
    if any(body.number("modes") > 0 for body in bodies if body.word("modes") != "auto"):
        own["check_reduction"] = ".true."
    if any(body.word("kind") == "beam" and body.word("elements") != "auto" for body in bodies):
        own["check_mesh"] = ".true."
    auto = any("auto" in (body.word("modes"), body.word("elements")) for body in bodies)
    text = with_accuracy(deck.set(deck.one("transient"), **own), accuracy, grid, asked)
    return text if auto or any(own.values()) else ""


def for_search(deck: DeckText, setting: Setting | None, grid: Grid, asked: set[str]) -> str:
    """Return the text that a search runs: the asked-for sensors alone, no other analysis but the static one.

    Without a setting the deck's own method and step stay.
    """
    for k in range(len(deck.groups) - 1, -1, -1):
        group = deck.groups[k]
        if group.kind in ("modal", "frequency_response") or (group.kind == "sensor" and group.name not in asked):
            deck = deck.drop(group, "not needed here")
    deck = deck.set(deck.one("transient"), motion_step=None, checkpoint_interval=None)
    if setting:
        deck = with_setting(deck, setting, grid, grid.interval)
    return deck.text


def sensors(deck: DeckText, wanted: list[str]) -> set[str]:
    """Return the names of the sensors that are asked for, all without a wish; DeckError for a name that is no sensor.

    Args:
        deck: the deck
        wanted: names of sensors, or of columns (`tip.v`)
    """
    known = [group.name for group in deck.all("sensor")]
    if not known:
        raise DeckError("the deck has no &sensor: nothing to compare")
    for name in wanted:
        if name.lower().split(".")[0] not in known:
            raise DeckError(f"no sensor {name!r} in the deck; it has {', '.join(known)}")
    return {name.lower().split(".")[0] for name in wanted} or set(known)


def columns(names: Iterable[str], wanted: list[str]) -> frozenset[str]:
    """Return the columns that are compared: those of the sensors asked for, and those named themselves.

    Raises:
        DeckError: a sensor has no such column.
    """
    found = set()
    for word in (name.lower() for name in wanted):
        mine = {name for name in names if word in (name.lower(), name.lower().split(".")[0])}
        if not mine:
            have = ", ".join(name for name in names if name.lower().split(".")[0] == word.split(".")[0])
            raise DeckError(f"no column {word!r}; its sensor has {have}")
        found |= mine
    return frozenset(found)
