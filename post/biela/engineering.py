"""What a designer asks of a run: deflections, stresses, drives, reactions, energies, frequencies, the modulus of its materials."""

from __future__ import annotations

from collections.abc import Iterator

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from .deck import Deck
from .histories import History
from .material_law import Material, of_group
from .mechanism import Mechanism
from .picture_files import subplots
from .plot import COLOURS, LOOK, pretty_unit

MODES = 6  # that are listed
LARGEST_VALUES = {
    ("deflection", "v"): ("largest deflection, {}", ("u", "v")),
    ("internal", "s"): ("largest stress, {}", ("s",)),
    ("stress", "s"): ("largest stress, {}", ("s",)),
    ("internal", "m1"): ("largest bending moment, {}", ("m1", "m2")),
    ("reaction", "fx"): ("largest force, {}", ("fx", "fy")),
    ("reaction", "m"): ("largest moment, {}", ("m",)),
    ("spring", "f"): ("largest force of spring, {}", ("f",)),
    ("stop", "f"): ("largest force of stop, {}", ("f",)),
    ("contact", "f"): ("largest contact force, {}", ("f",)),
    ("contact", "p"): ("largest contact pressure, {}", ("p",)),
}  # by kind of sensor and column: in words, and the parts of the vector; of moments the larger one
LOSSES = {"stops": "stop {}", "friction": "friction of joint {}"}  # lists of the summary, and what their items are called


def _peak(time: np.ndarray, values: np.ndarray, unit: str, where: str = "") -> str:
    """Return the value of the largest size with its sign, where it is and its time, '' where all are zero."""
    k = int(np.argmax(np.abs(values)))
    return f"{values[k]:.4g} {pretty_unit(unit)} at {where}t = {time[k]:.4g} s" if values[k] else ""


def _power(time: np.ndarray, values: np.ndarray) -> str:
    """Return the largest power that was put into the mechanism, and the largest that was taken from it, which is negative."""
    ends = [_peak(time, part, "W") for part in (np.maximum(values, 0.0), np.minimum(values, 0.0))]
    return "; ".join(filter(None, ends)) or "0 W"


def of_motion(scene: Mechanism, lengths: dict[str, float]) -> Iterator[tuple[str, str]]:
    """Yield the largest deflection of each flexible body, where and when, with its share of the body's length."""
    for name, body in scene.bodies.items():
        if not len(body.rest):
            continue
        size = np.linalg.norm(body.local - body.rest, axis=2)
        row, node = np.unravel_index(int(np.argmax(size)), size.shape)
        if size[row, node] > 0.0:
            share = f" ({100.0 * size[row, node] / lengths[name]:.2g} % of its length)" if lengths.get(name) else ""
            yield f"largest deflection, {name}", f"{size[row, node]:.4g} m{share} at node {node + 1}, t = {scene.time[row]:.4g} s"


def of_history(table: History, deck: Deck, rounding: set[str], stops: dict[str, float]) -> Iterator[tuple[str, str]]:
    """Yield largest values of sensors, not rounding; `stops`: largest forces by steps, none where rows are left out."""
    groups = {group.name: group for group in deck.all("sensor")}
    for name in table.names[1:]:
        sensor, _, part = name.rpartition(".")
        group = groups.get(sensor.lower())
        words, parts = LARGEST_VALUES.get((group.word("quantity") if group else "", part), ("", ()))
        if not words or all(f"{sensor}.{one}" in rounding for one in parts):
            continue
        columns = np.array([table[f"{sensor}.{one}"] for one in parts])
        alone = part == "m1" or len(parts) == 1  # moments at both ends; what has a sign
        size = columns[np.abs(columns).argmax(axis=0), np.arange(table.time.size)] if alone else np.linalg.norm(columns, axis=0)
        where = f"element {group.word('element')}, " if group.word("element") else ""
        if group.word("quantity") == "stress":
            where = f"node {table[f'{sensor}.node'][int(np.argmax(np.abs(size)))]:.0f}, "
        if peak := _peak(table.time, size, table.units[name], where):
            if (force := stops.get(group.word("stop") or "", 0.0)) > np.abs(size).max():
                peak = f"{force:.4g} {pretty_unit(table.units[name])} between rows near{peak.partition(' at')[2]}"
            yield words.format(sensor), peak


def of_pairs(transient: dict) -> Iterator[tuple[str, str]]:
    """Yield the least and the largest contact force of each joint on a profile, as the summary tells them."""
    for pair in transient.get("pairs", []):
        words = "{least_force:.4g} N at t = {least_at:.4g} s to {largest_force:.4g} N at t = {largest_at:.4g} s".format(**pair)
        pulls = f"; first pulls at t = {pair['pulls_at']:.4g} s" if "pulls_at" in pair else ""
        yield f"contact force, joint {pair['name']}", words + pulls


def turning_drives(scene: dict, deck: Deck) -> dict[str, dict]:
    """Return the rotational drives whose reactions sensors measure, by the sensor's name in lower case."""
    drives = {drive["name"].lower(): drive for drive in scene["drives"] if drive["kind"] == "rotation"}
    measured = {group.name: group.word("drive") for group in deck.all("sensor") if group.word("quantity") == "reaction"}
    return {sensor: drives[name] for sensor, name in measured.items() if name in drives}


def of_drives(table: History, drives: dict[str, dict], deck: Deck) -> Iterator[tuple[str, str]]:
    """Yield what sensors of power and work say, of the rows that count, and torques of rotational drives."""
    names = {name.lower(): name for name in table.names}
    stated = set()
    for group in deck.all("sensor"):
        quantity = group.word("quantity")
        column = names.get(group.name)
        if quantity not in ("power", "work") or column is None:
            continue
        kind = next(one for one in ("drive", "force", "spring", "joint") if group.word(one))
        stated.add((quantity, kind, group.word(kind)))
        size = f"{table[column][-1] - table[column][0]:.4g} J" if quantity == "work" else _power(table.time, table[column])
        yield f"{'largest ' * (quantity == 'power')}{quantity} of {kind} {group.word(kind)}", size
    for sensor, drive in drives.items():
        name, column = drive["name"].lower(), names.get(f"{sensor}.m")
        if column is None:
            continue
        torque = table[column]
        mean = np.trapezoid(torque, table.time) / np.ptp(table.time)
        yield f"torque of drive {drive['name']}", f"{_peak(table.time, torque, 'Nm') or '0 N m'}; mean {mean:.4g} N m"
        missing = [quantity for quantity in ("power", "work") if (quantity, "drive", name) not in stated]
        if missing:
            words = " and ".join(f"quantity='{quantity}'" for quantity in missing)
            yield (
                f"{' and '.join(missing)} of drive {drive['name']}",
                f"not measured: {'sensors' if missing[1:] else 'a sensor'} with {words}",
            )


def of_energy(table: History, transient: dict, end: float) -> Iterator[tuple[str, str]]:
    """Yield largest kinetic energy, losses of the run by cause, the largest first, with their shares, and work until an end [s]."""
    if np.any(table["kinetic"]):
        yield "largest kinetic energy", _peak(table.time, table["kinetic"], "J")
    lost = losses(table, transient)
    total = float(table["dissipated"][-1])
    for cause, parts in sorted(lost.items(), key=lambda one: -abs(sum(one[1].values()))):
        energy = sum(parts.values())
        share = f", {100.0 * energy / total:.3g} % of all" if len(lost) > 1 else ""
        terms = ": " + ", ".join(f"{term} {part:.3g} J" for term, part in parts.items()) if len(parts) > 1 else ""
        yield f"energy lost in {cause}", f"{energy:.4g} J{share}{terms}"
    work = table["work"][table.time <= end]
    if np.any(work):
        yield "work of drives and loads", f"{work[-1] - work[0]:.4g} J"


def losses(table: History, transient: dict) -> dict[str, dict[str, float]]:
    """Return what each cause has lost by the end [J], its parts by name: terms of a material. Zeros and rounding are left out."""
    found: dict[str, dict[str, float]] = {}
    for one in transient.get("losses", []):
        cause = f"spring {one['spring']}" if "spring" in one else f"material {one['material']}"
        if "layer" in one:
            cause = f"layer {one['layer']} of {one['body']} ({one['material']})"
        found.setdefault(cause, {})[f"{one['kind']} term {one['term']}" if "term" in one else ""] = one["lost"]
    for kind, words in LOSSES.items():
        found |= {words.format(one["name"]): {"": one["lost"]} for one in transient.get(kind, []) if one.get("lost")}
    known = sum(sum(parts.values()) for parts in found.values())
    found["Rayleigh damping"] = {"": float(table["dissipated"][-1]) - known}
    rounding = 1e-9 * float(np.abs(table["dissipated"]).max())
    return {cause: parts for cause, parts in found.items() if abs(sum(parts.values())) > rounding}


def of_modes(figures: dict) -> Iterator[tuple[str, str]]:
    """Yield frequency and damping of the lowest modes, of the vibrations where there are such."""
    poles = figures.get("modes", {}).get("poles", [])
    kind = "damped" if any(pole["kind"] == "damped" for pole in poles) else "undamped"
    for pole in [pole for pole in poles if pole["kind"] == kind][:MODES]:
        yield f"mode {pole['mode']}", f"{pole['frequency']:.4g} Hz, damping ratio {pole['damping_ratio']:.3g}"


def materials(deck: Deck, temperatures: list[dict]) -> list[tuple[str, Material, tuple[float, float]]]:
    """Return name, modulus and band [Hz] of each viscoelastic material of a deck, at its temperatures in the summary."""
    found = []
    for group in deck.all("material"):
        states = [one for one in temperatures if one.get("material", "").split(" in ")[0].lower() == group.name]
        for one in states or [{"times": 1.0, "modulus": 1.0}]:
            law, band = of_group(group, one["times"], one["modulus"]), group.numbers("band")
            scale = group.number("ghm_frequency_scale", 1.0) / one["times"]
            if law.internal_variables:
                ends = (scale * band[0], scale * band[1]) if len(band) == 2 else (law.slowest_pole / 20.0, law.fastest_pole / 2.0)
                found.append((f"{one['material']} at {one['temperature']:g} °C" if states else group.name, law, ends))
    return found


def modulus_picture(name: str, law: Material, band: tuple[float, float], frequencies: list[float]) -> Figure:
    """Draw storage modulus and loss factor over the band, with lines at the frequencies of modes [Hz]."""
    wide = np.logspace(*np.log10(band), 300)
    curve = law.modulus(wide)
    inside = [f for f in frequencies if band[0] <= f <= band[1]]
    with mpl.rc_context(LOOK):
        figure, axes = subplots(2, 1, figsize=(8.0, 4.4), sharex=True)
        axes[0].loglog(wide, curve.real)
        axes[1].semilogx(wide, curve.imag / curve.real)
        axes[0].set_ylabel("storage modulus [Pa]")
        axes[1].set(ylabel="loss factor [-]", xlabel="frequency [Hz]", ylim=(0.0, None))
        for axis in axes:
            axis.margins(x=0.0)
            lines = [axis.axvline(frequency, color=COLOURS[1], lw=0.8, ls="--") for frequency in inside]
        if inside:
            axes[0].legend(lines[:1], ["modes"], loc="upper left")
        outside = len(frequencies) - len(inside)
        left_out = f", {outside} of {len(frequencies)} modes outside" if outside else ""
        figure.suptitle(f"{name}: {band[0]:.4g} to {band[1]:.4g} Hz{left_out}", fontsize=10)
    return figure
