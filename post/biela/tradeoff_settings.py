"""Integration settings of a deck: method with step or tolerance, on the output times of the comparison."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from .deck import Deck, DeckError
from .programs import METHODS

ROWS = 400  # number of rows to compare, about
# name of a curve: (method, what is varied)
FAMILIES = {
    "rk4": ("rk4", "step"),
    "dopri5": ("dopri5", "tolerance"),
    "generalized_alpha": ("generalized_alpha", "step"),
    "radau": ("radau", "step"),
    "radau adaptive": ("radau", "tolerance"),
}
LEVELS = 41  # of a fixed step: 2**20 steps in the longest one
OTHERS = ("first_step", "max_step", "accept_unstable", "check_error", "accuracy", "most_seconds", "spectral_radius")
OTHERS += ("stabilization", "baumgarte_alpha", "baumgarte_beta")  # keys that belong to other methods


@dataclass(frozen=True)
class TradeoffOptions:
    """What is asked of a trade-off."""

    deck: Path  # its path
    biela: Path  # the solver
    output: Path | None = None  # folder of the results; None: results/tradeoff/<deck name>
    sensor: tuple[str, ...] = ()  # sensors or columns (`tip.v`) to get right; none: all
    tolerance: float = 1.0e-3  # largest error over a column's range [-]
    budget: float = math.inf  # seconds that a recommended run may take [s]
    methods: tuple[str, ...] = METHODS  # that are tried
    jobs: int | None = None  # runs side by side; None: as many as there are cores
    scheduler: str | None = None  # address of a Dask scheduler, in place of this machine's cores
    longest_run: float = 120.0  # seconds that any run may take [s]
    time: float = 600.0  # seconds after which no further runs begin [s]


@dataclass(frozen=True)
class Grid:
    """Times of the comparison."""

    t_end: float  # end of the run [s]
    interval: float  # between compared rows [s]
    stated: float  # the output_step that the deck states, 0 without [s]; fixed steps are no longer


def grid_of(deck: Deck) -> Grid:
    """Return the times at which runs of the deck are compared; DeckError where the deck has no usable transient."""
    transient = deck.one("transient")
    t_end, stated = transient.number("t_end"), transient.number("output_step")
    own = stated or transient.number("step") or t_end / 1000.0
    rows = max(round(t_end / own), 1)
    most = max(1, rows // ROWS)
    group = next((k for k in range(most, most // 3, -1) if rows % k == 0), most)
    return Grid(t_end, own * group, stated)


@dataclass(frozen=True)
class Setting:
    """A method with its step or tolerance: entry `index` of the family's ladder, coarse to fine; two entries halve the step."""

    family: str
    index: int

    @property
    def method(self) -> str:
        """The deck's word for the method."""
        return FAMILIES[self.family][0]

    @property
    def key(self) -> str:
        """What is given: 'step' or 'tolerance'."""
        return FAMILIES[self.family][1]

    def finer(self, by: int = 1) -> Setting:
        """Return the setting that many entries finer (coarser where negative): of a tolerance two are a tenth."""
        return Setting(self.family, self.index + by)

    def exists(self) -> bool:
        """Whether the ladder has that entry."""
        return 0 <= self.index < (21 if self.key == "tolerance" else LEVELS)

    def size(self, grid: Grid) -> float:
        """Return the step [s], a whole part of the interval of output, or the tolerance."""
        if self.key == "tolerance":
            return float(f"{10.0 ** (-2.0 - 0.5 * self.index):.2e}")
        halved, odd = divmod(self.index, 2)
        return (grid.stated or grid.interval) / (3 * 2**halved // 2 if odd and halved else 2 ** (halved + odd))

    def words(self, grid: Grid) -> str:
        """Return the setting in words."""
        return f"{self.method} {self.key} {self.size(grid):.3g}" + " s" * (self.key == "step")


def with_setting(deck: Deck, setting: Setting | None, grid: Grid, output: float) -> Deck:
    """Return the deck with a setting and an interval of output; what belongs to other methods goes.

    Without a setting an accuracy takes its place (`with_accuracy`).
    """
    transient = deck.one("transient")
    values = dict.fromkeys(key for key in (*OTHERS, "method", "step", "tolerance") if key in transient.values)
    explicit = setting is not None and setting.method in ("rk4", "dopri5")
    kept = ("stabilization", "baumgarte_alpha", "baumgarte_beta") if explicit else ()
    kept += ("spectral_radius",) if setting is not None and setting.method == "generalized_alpha" else ()
    values = {key: None for key in values if key not in kept} | {"output_step": output}
    if setting is not None:
        values |= {"method": setting.method, setting.key: setting.size(grid)}
    return deck.set(transient, **values)


def with_accuracy(deck: Deck, accuracy: float, grid: Grid, seconds: float) -> Deck:
    """Return the deck with an accuracy in place of its method and step: the solver's passes end when they have it, or the time."""
    deck = with_setting(deck, None, grid, grid.interval)
    return deck.set(deck.one("transient"), accuracy=accuracy, most_seconds=seconds)


def lean(deck: Deck, asked: set[str]) -> Deck:
    """Return the deck without what a search does not need: other sensors, other analyses than the static one, files of motion."""
    gone = [group for group in deck.groups if group.kind in ("modal", "frequency_response")]
    deck = deck.drop(*gone, *(group for group in deck.all("sensor") if group.name not in asked))
    return deck.set(deck.one("transient"), motion_step=None, checkpoint_interval=None)


def own_setting(deck: Deck) -> str:
    """Return the setting that stands in a deck as text."""
    transient = deck.one("transient")
    if "accuracy" in transient.values or not {"step", "tolerance"} & transient.values.keys():
        return f"accuracy {transient.number('accuracy', 1e-3):.3g}"
    size = "tolerance" if "tolerance" in transient.values else "step"
    return f"{transient.word('method', 'rk4')} {size} {transient.number(size):.3g}" + " s" * (size == "step")


def sensors(deck: Deck, wanted: tuple[str, ...]) -> set[str]:
    """Return the names of the sensors that are wanted, as sensors or columns (`tip.v`), or all; DeckError where there is none."""
    known = [group.name for group in deck.all("sensor")]
    if not known:
        raise DeckError("the deck has no &sensor: nothing to compare")
    for name in wanted:
        if name.lower().split(".")[0] not in known:
            raise DeckError(f"no sensor {name!r} in the deck; it has {', '.join(known)}")
    return {name.lower().split(".")[0] for name in wanted} or set(known)
