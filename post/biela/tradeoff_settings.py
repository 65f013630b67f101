"""What a trade-off varies in a deck: method with step or tolerance, and smaller models of the same scene."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from .deck import Deck, DeckError, Group
from .material_law import GHM_KEYS, MAXWELL_KEYS
from .programs import METHODS

ROWS = 400  # number of rows to compare, about
# method and what is varied, by the name of a curve
FAMILIES = {name: (name, "tolerance" if name == "dopri5" else "step") for name in METHODS} | {
    "radau adaptive": ("radau", "tolerance")
}
LEVELS = 41  # of a fixed step: 2**20 steps in the longest one
OTHERS = ("first_step", "max_step", "accept_unstable", "check_error", "accuracy", "most_seconds", "spectral_radius")
OTHERS += ("stabilization", "baumgarte_alpha", "baumgarte_beta")  # keys that belong to other methods
MODAL = ("modes", "static_shapes")  # taken away together: nodal coordinates have no static shapes
ELASTIC = ("coordinate", "internal", "stress")  # what sensors measure of flexible bodies alone


@dataclass(frozen=True)
class TradeoffOptions:
    """What is asked of a trade-off."""

    deck: Path  # its path
    biela: Path  # the solver
    output: Path | None = None  # folder of the results; None: results/tradeoff/<deck name>
    sensor: tuple[str, ...] = ()  # sensors or columns (`tip.v`) to get right; none: all
    tolerance: float = 1.0e-3  # largest error over a column's range [-]
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
    """Return the deck with a setting, or with none, and an interval of output; what belongs to other methods goes."""
    transient = deck.one("transient")
    values = dict.fromkeys(key for key in (*OTHERS, "method", "step", "tolerance") if key in transient.values)
    explicit = setting is not None and setting.method in ("rk4", "dopri5")
    kept = ("stabilization", "baumgarte_alpha", "baumgarte_beta") if explicit else ()
    kept += ("spectral_radius",) if setting is not None and setting.method == "generalized_alpha" else ()
    values = {key: None for key in values if key not in kept} | {"output_step": output}
    if setting is not None:
        values |= {"method": setting.method, setting.key: setting.size(grid)}
    return deck.set(transient, **values)


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


def coordinates(body: Group) -> int:
    """Return the number of nodal elastic coordinates of a beam or frame."""
    nodes = int(body.number("elements")) + 1 if body.word("kind") == "beam" else len(body.numbers("node_x"))
    kept = "uvr" if body.flag("axial", True) else "vr"
    held = [] if body.word("reference") == "free" else body.words("reference_dof") or ["u", "v", "v"]
    return nodes * len(kept) - sum(dof in kept for dof in held)


def changed(deck: Deck, body: Group, values: dict, asked: set[str]) -> Deck | None:
    """Return the deck with a body's values set (None: a key goes), without sensors that lose their meaning; None: one must stay."""
    lost = ELASTIC if values.get("flexible") is False else ELASTIC[: "modes" in values or "axial" in values]
    gone = [one for one in deck.all("sensor") if one.word("body") == body.name and one.word("quantity") in lost]
    return None if any(one.name in asked for one in gone) else deck.set(body, **values).drop(*gone)


def removals(deck: Deck, asked: set[str]) -> list[tuple[str, Deck]]:
    """Return every single thing that can be taken out of a model, in words, and the deck without it; what cannot is left out."""
    found, used = [], set()
    for body in deck.all("body"):
        if body.word("kind") in ("beam", "frame") and body.flag("flexible", True):
            materials = {*body.words("material"), *body.words("element_material")} if body.flag("viscoelastic", True) else set()
            damped = [one for one in deck.all("material") if one.name in materials and _terms(one)]
            used |= materials
            for what, values in _body_changes(body, bool(damped)):
                if less := changed(deck, body, values, asked):
                    found.append((f"{body.name}: {what}", less))
    for group in deck.all("material", "spring"):
        for words, keys in (("GHM", GHM_KEYS), ("Maxwell", MAXWELL_KEYS)):
            count = len(group.numbers(keys[0])) if group.kind == "spring" or group.name in used else 0
            for k in range(count):
                left = {key: [x for j, x in enumerate(group.numbers(key)) if j != k] or None for key in keys}
                alone = {"ghm_frequency_scale": None} if _terms(group) == 1 else {}
                found.append((f"{group.name}: {words} term {k + 1} of {count}", deck.set(group, **left, **alone)))
    return found


def _terms(group: Group) -> int:
    """Return how many viscoelastic terms a material or spring has."""
    return len(group.numbers(GHM_KEYS[0])) + len(group.numbers(MAXWELL_KEYS[0]))


def _body_changes(body: Group, damped: bool) -> list[tuple[str, dict]]:
    """Return (label, values) of what can be switched off in a flexible body."""
    found: list = [("rigid", {"flexible": False, **dict.fromkeys(("stiffening", *MODAL, "axial", "viscoelastic"))})]
    if damped:
        found.append(("elastic twin", {"viscoelastic": False}))
    if body.flag("stiffening", False):
        return [*found, ("no stiffening", {"stiffening": False})]
    if body.word("kind") == "beam" and body.flag("axial", True):
        found.append(("no axial deformation", {"axial": False}))
    count, shaped = int(body.number("modes")) or coordinates(body), body.flag("static_shapes", False)
    some = {b * 2**j for b in (2, 3) for j in range(8)} | {1, count - 1, count - 2}
    for k in sorted((k for k in some if 0 < k < count), reverse=True):
        if not shaped:
            found.append((f"{k} mode{'s' * (k > 1)} of {count} coordinates", {"modes": k}))
        if shaped or 3 * k <= count:
            found.append((f"{k} mode{'s' * (k > 1)} and static shapes", {"modes": k, "static_shapes": True}))
    return found
