"""Complex modulus of a viscoelastic material: GHM terms, Maxwell terms, or both, and the lines of a deck that state them.

    E(s) = E_R [1 + sum alpha (s^2 + 2 zeta omega s)/(s^2 + 2 zeta omega s + omega^2) + sum alpha s tau/(1 + s tau)]

(Golla & Hughes 1985; generalised Maxwell solid, a Prony series in time.)
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .deck import Deck, DeckError, Group

NONE = np.zeros(0)
GHM_KEYS = ("ghm_alpha", "ghm_zeta", "ghm_omega")
MAXWELL_KEYS = ("prony_alpha", "prony_tau")
SHIFT_KEYS = ("wlf", "arrhenius", "vertical", "reference_temperature", "temperature")
GAS = 8.314462618  # molar gas constant [J/(mol K)]
ZERO = 273.15  # of the Celsius scale, in which decks state temperatures [K]


@dataclass(frozen=True)
class Material:
    """A complex modulus."""

    young: float  # static modulus E_R [Pa]
    alpha: np.ndarray = field(default_factory=lambda: NONE)  # weights of the GHM terms [-]
    zeta: np.ndarray = field(default_factory=lambda: NONE)  # their damping ratios [-]
    omega: np.ndarray = field(default_factory=lambda: NONE)  # their frequencies [rad/s]
    weight: np.ndarray = field(default_factory=lambda: NONE)  # weights of the Maxwell terms [-]
    tau: np.ndarray = field(default_factory=lambda: NONE)  # their relaxation times [s]

    def modulus(self, frequency: np.ndarray) -> np.ndarray:
        """Return the complex modulus [Pa] at frequencies [Hz]."""
        s = 2j * np.pi * np.asarray(frequency, dtype=float)[:, None]
        return self.young * (1.0 + ghm_shapes(s, self.zeta, self.omega) @ self.alpha + maxwell_shapes(s, self.tau) @ self.weight)

    @property
    def internal_variables(self) -> int:
        """First-order internal variables of one deformation: two a GHM term, one a Maxwell term."""
        return 2 * self.alpha.size + self.weight.size

    @property
    def slowest_pole(self) -> float:
        """Smallest modulus of a pole of E(s) [1/s]; infinite without terms."""
        return min([np.inf, *(self.omega / pole_factor(self.zeta)), *(1.0 / self.tau)])

    @property
    def fastest_pole(self) -> float:
        """Largest modulus of a pole of E(s) [1/s]: with it an explicit step shrinks."""
        return max([0.0, *(self.omega * pole_factor(self.zeta)), *(1.0 / self.tau)])

    def term_curves(self, frequency: np.ndarray) -> list[tuple[str, np.ndarray]]:
        """Return (name, complex modulus [Pa]) of each term by itself at frequencies [Hz]."""
        s = 2j * np.pi * np.asarray(frequency, dtype=float)[:, None]
        ghm = self.young * ghm_shapes(s, self.zeta, self.omega) * self.alpha
        maxwell = self.young * maxwell_shapes(s, self.tau) * self.weight
        laws = (("GHM", ghm), ("Maxwell", maxwell))
        return [(f"{law} {k + 1}", curve) for law, curves in laws for k, curve in enumerate(curves.T)]

    def assignments(self) -> dict[str, str]:
        """Return what a `&material` group says of the modulus, as text by name."""
        lists = dict(zip(GHM_KEYS, (self.alpha, self.zeta, self.omega))) | dict(zip(MAXWELL_KEYS, (self.weight, self.tau)))
        said = {"young": f"{self.young:.8g}"}
        return said | {key: ", ".join(f"{value:.8g}" for value in values) for key, values in lists.items() if values.size}


def pole_factor(zeta: np.ndarray) -> np.ndarray:
    """Return the fastest pole of a GHM term over its omega: zeta + sqrt(zeta^2 - 1), 1 for under-damped terms."""
    return np.where(zeta > 1.0, zeta + np.sqrt(np.maximum(zeta**2, 1.0) - 1.0), 1.0)


def ghm_shapes(s: np.ndarray, zeta: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """Return (s^2 + 2 zeta omega s)/(s^2 + 2 zeta omega s + omega^2), a column a term; s is a column [1/s]."""
    x = s * (s + 2.0 * zeta * omega)
    return x / (x + omega**2)


def maxwell_shapes(s: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Return s tau/(1 + s tau), a column a term; s is a column [1/s], tau in s."""
    return s * tau / (1.0 + s * tau)


def shift_factor(law: str, constants: np.ndarray, temperature: np.ndarray, reference: float) -> np.ndarray:
    """Return log10 a_T of temperatures [K] by 'wlf' (C1 [-], C2 [K]) or 'arrhenius' ([kJ/mol]), with constants at the reference."""
    if law == "wlf":
        return -constants[0] * (temperature - reference) / (constants[1] + temperature - reference)
    return constants[0] * 1.0e3 / (GAS * np.log(10.0)) * (1.0 / temperature - 1.0 / reference)


def shift_keys(law: str, constants: np.ndarray, reference: float, temperature: float | None) -> str:
    """Return what a deck says of a law of temperature; temperatures in kelvin, None where the deck's reader states it."""
    said = f"wlf={constants[0]:.6g},{constants[1]:.6g}" if law == "wlf" else f"arrhenius={constants[0] * 1.0e3:.6g}"
    at = "" if temperature is None else f" temperature={round(temperature - ZERO, 6) + 0.0:.7g}"
    return f" {said} reference_temperature={round(reference - ZERO, 6) + 0.0:.7g}{at}"


def moved(group: Group, deck: Deck) -> tuple[float, float]:
    """Return a_T and b_T of a `&material` or `&spring`, at its own temperature, else that of `&scene`, else at its reference."""
    reference = group.number("reference_temperature")
    temperature = group.number("temperature", [*(one.number("temperature", reference) for one in deck.all("scene")), reference][0])
    factor = 0.0
    for law, scale in (("wlf", 1.0), ("arrhenius", 1.0e-3)):
        if constants := group.numbers(law):
            factor = shift_factor(law, scale * np.array(constants), temperature + ZERO, reference + ZERO)
    return 10.0**factor, 1.0 + group.number("vertical") * (temperature - reference)


def of_group(group: Group, times: float = 1.0, stiffer: float = 1.0) -> Material:
    """Return the modulus of a `&material`, the stiffness of a `&spring`, at a_T and b_T; DeckError where its lists do not fit."""
    ghm = [np.array(group.numbers(key)) for key in GHM_KEYS]
    maxwell = [np.array(group.numbers(key)) for key in MAXWELL_KEYS]
    if len({values.size for values in ghm}) > 1 or len({values.size for values in maxwell}) > 1:
        raise DeckError(f"&{group.kind} {group.name}: the lists of its terms differ in length")
    shear = "shear_modulus" in group.values
    static = "stiffness" if group.kind == "spring" else "shear_modulus" if shear else "young"
    young = group.number(static)
    if young <= 0.0 or any((values <= 0.0).any() for values in (*ghm, *maxwell)):
        raise DeckError(f"&{group.kind} {group.name}: {static} and all terms have to be positive")
    scale = group.number("ghm_frequency_scale", 1.0) / times
    ghm[2], maxwell[1] = ghm[2] * scale, maxwell[1] / scale
    return Material(young * stiffer * (2.0 * (1.0 + group.number("poisson", 0.3)) if shear else 1.0), *ghm, *maxwell)
