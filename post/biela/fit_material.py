"""Fits GHM or Maxwell terms to a measured complex modulus; draws and converts the modulus of a material."""

from __future__ import annotations

import argparse
import html
import sys
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from . import material_data
from .deck import read as read_deck
from .master_curve import MasterCurve, master_curve
from .material_data import DataError, Measurements
from .material_fit import NEAR, Fit, choose_terms, fit, relative_error, rms
from .material_law import GHM_KEYS, MAXWELL_KEYS, SHIFT_KEYS, Material, moved, of_group, shift_keys
from .picture_files import FORMATS, save, stem_of, subplots
from .plot import COLOURS, LOOK
from .result_files import writing

if TYPE_CHECKING:
    import pandas

DECADE = 10.0
MOST_LABELS = 7  # entries of a legend
MARKS = "osD^vP*X<>"
EDGE = 1.0e-9  # rounding of a frequency that stands on the band's end
KEPT = ("poisson", "rayleigh_mass", "rayleigh_stiffness")  # what a conversion takes over as it is


@dataclass(frozen=True)
class Options:
    """How a table is read, shifted and fitted."""

    law: str | None = None  # 'ghm' or 'maxwell'; None: the better one at equal cost
    terms: int | None = None  # number of terms; None: as few as reach the target
    target: float = 0.01  # error |E_fit/E - 1| at which terms are enough [-]
    fastest_pole: float | None = None  # bound of the terms' poles [1/s]; None: a decade above the band
    name: str | None = None  # of the material; None: that of the table's file
    density: float | None = None  # that the deck's lines state [kg/m3]
    band: tuple[float, float] | None = None  # frequencies that are used [Hz]; None: all
    columns: dict[str, str] = field(default_factory=dict)  # names of unusual columns, by the keys of `material_data.USUAL`
    units: str = ""  # of the columns where the table has none: 'Hz,MPa,MPa,C'
    tolerance: float = 0.5  # temperatures this near are one [K]
    shift: str | None = None  # law of the shift, 'free', 'wlf' or 'arrhenius'; None: wlf, of two temperatures free
    reference: float | None = None  # temperature of the terms, in the table's unit; None: the middle one
    temperature: float | None = None  # at which the part is used, in the table's unit; None: the reference

    def __post_init__(self) -> None:
        if self.terms is not None and not 1 <= self.terms <= 12:
            raise DataError(f"--terms {self.terms}: 1 to 12 expected")
        for option in ("target", "fastest_pole", "density"):
            value = getattr(self, option)
            if value is not None and not (np.isfinite(value) and value > 0.0):
                raise DataError(f"--{option.replace('_', '-')} {value:g}: a positive number expected")
        if self.band and not 0.0 < self.band[0] < self.band[1] < np.inf:
            raise DataError(f"--band {self.band[0]:g} {self.band[1]:g}: two positive frequencies expected, the lower one first")
        for option, words in (("law", (None, "ghm", "maxwell")), ("shift", (None, "free", "wlf", "arrhenius"))):
            if getattr(self, option) not in words:
                raise DataError(f"--{option} {getattr(self, option)}: one of {', '.join(words[1:])} expected")


@dataclass(frozen=True)
class MaterialFit:
    """A material whose terms were fitted to a complex modulus."""

    material: Material  # the terms
    name: str  # of the material
    error: float  # root mean square of |E_fit/E - 1| over the rows [-]
    density: float | None  # [kg/m3], None where it was not given
    band: tuple[float, float]  # frequencies of the data [Hz]
    shift: str  # the deck's keys of the temperature
    points: list[tuple[str, np.ndarray, np.ndarray]]  # label, frequencies [Hz], moduli [Pa] of the data, at the reference
    notes: list[str]  # what the deck's comment says: source, errors by decade, shifts
    curve: MasterCurve | None = None  # of several temperatures, None of one
    shear: bool = False  # whether the modulus is that of shear

    @property
    def warnings(self) -> list[str]:
        """What speaks against the data or the fit."""
        return [words.removeprefix("warning: ") for words in self.notes if words.startswith("warning: ")]

    @property
    def text(self) -> str:
        """The lines of a deck: comments, then the `&material` group."""
        values, (low, high) = self.material.assignments(), self.band
        lists = [f"          {key} = {values[key]}" for key in (*GHM_KEYS, *MAXWELL_KEYS) if key in values]
        static = f"{'shear_modulus' if self.shear else 'young'}={values['young']}"
        head = f"&material name='{self.name}' density={self.density or 1000.0:g} {static} "
        lists = "\n".join([f"{head}band={low:.6g},{high:.6g}{self.shift}", *lists])
        return "".join(f"! {note}\n" for note in self.notes) + f"\n{lists} /\n"

    def picture(self) -> Figure:
        """Draw storage modulus, loss factor and the terms over frequency."""
        return picture(self.material, f"{self.name}: {law_of(self.material)}, {100 * self.error:.2g} % rms", self.band, self.points)

    def to_dataframe(self) -> pandas.DataFrame:
        """Return measured and fitted storage moduli and loss factors over frequency, units in the names of the columns."""
        import pandas

        label, frequency, modulus = (np.concatenate([np.atleast_1d(one[k]) for one in self.points]) for k in range(3))
        label = np.repeat(label, [one[1].size for one in self.points])
        fitted = self.material.modulus(frequency)
        columns = {"data": label, "f_[Hz]": frequency, "E_stor_[Pa]": modulus.real, "loss_factor": modulus.imag / modulus.real}
        return pandas.DataFrame({**columns, "fit.E_stor_[Pa]": fitted.real, "fit.loss_factor": fitted.imag / fitted.real})

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(self.text)}</pre>"


def chosen_fit(options: Options, frequency: np.ndarray, modulus: np.ndarray) -> tuple[Fit, list[str]]:
    """Return the fit that the options ask for, and lines that say how it was chosen."""
    fastest = options.fastest_pole or DECADE * 2.0 * np.pi * frequency.max()
    if fastest <= 2.0 * np.pi * frequency.min():
        raise DataError(f"--fastest-pole {fastest:g}: lies below the band, which begins at {2.0 * np.pi * frequency.min():g} 1/s")
    if options.terms:
        if options.law:
            return fit(options.law, options.terms, frequency, modulus, fastest), []
        pairs = (("ghm", options.terms), ("maxwell", 2 * options.terms))
        tried = [fit(law, terms, frequency, modulus, fastest) for law, terms in pairs]
    elif options.law:
        return choose_terms(options.law, frequency, modulus, fastest, options.target, 8), []
    else:
        tried = [choose_terms(law, frequency, modulus, fastest, options.target, most) for law, most in (("ghm", 4), ("maxwell", 8))]
    least = max(options.target, NEAR * min(one.error for one in tried))
    best = min((one for one in tried if one.error <= least), key=lambda one: (one.material.internal_variables, one.error))
    other = tried[0] if best is tried[1] else tried[1]
    words = "{}: {:.3g} % with {} internal variables"
    told = [words.format(law_of(one.material), 100 * one.error, one.material.internal_variables) for one in (best, other)]
    return best, ["law chosen: " + "; ".join(told)]


def law_of(material: Material) -> str:
    """Return the words for a material's terms."""
    return f"{material.alpha.size} GHM terms" if material.alpha.size else f"{material.weight.size} Maxwell terms"


def errors_by_decade(material: Material, frequency: np.ndarray, modulus: np.ndarray) -> list[str]:
    """Return 'low to high Hz: error of the modulus, of the loss factor' for each decade of the data."""
    error, fitted = relative_error(material, frequency, modulus), material.modulus(frequency)
    loss = fitted.imag / fitted.real * modulus.real / modulus.imag - 1.0
    decades, words = np.floor(np.log10(frequency) + 1.0e-9).astype(int), "{:g} to {:g} Hz {:.2g} %, loss factor {:.2g} %"
    parts = [(k, 100 * rms(error[decades == k]), 100 * rms(loss[decades == k])) for k in np.unique(decades)]
    return [words.format(10.0**k, 10.0 ** (k + 1), *both) for k, *both in parts]


def falling_storage(material: Material, band: tuple[float, float]) -> list[str]:
    """Return a note where the storage modulus falls with frequency, which that of a relaxing material never does."""
    wide = np.logspace(np.log10(band[0]) - 1.0, np.log10(band[1]) + 1.0, 400)
    storage = material.modulus(wide).real
    fall = 1.0 - storage / np.maximum.accumulate(storage)
    worst = int(np.argmax(fall))
    if fall[worst] < 0.01:
        return []
    words = f"the storage modulus falls by {100 * fall[worst]:.2g} % up to {wide[worst]:.3g} Hz"
    return [f"{words}: an under-damped term; try Maxwell terms"]


def outside_poles(material: Material, band: tuple[float, float]) -> list[str]:
    """Return a note where poles of the terms lie outside the data, which then hold them loosely."""
    poles = np.concatenate([material.omega / (2.0 * np.pi), 0.5 / np.pi / material.tau])
    outside = poles[(poles < band[0]) | (poles > band[1])]
    if not outside.size:
        return []
    where = ", ".join(f"{pole:.3g}" for pole in np.sort(outside))
    return [f"{outside.size} of {poles.size} terms act outside the band, at {where} Hz: the data see their flanks alone"]


def picture(material: Material, title: str, band: tuple[float, float], points: list[tuple[str, np.ndarray, np.ndarray]]) -> Figure:
    """Draw storage modulus, loss factor and terms over a band [Hz], and points: label, frequencies [Hz], moduli [Pa]."""
    wide = np.logspace(*np.log10(band), 400)
    curve = material.modulus(wide)
    terms = material.term_curves(wide)
    many = len(points) > MOST_LABELS
    colours = mpl.colormaps["viridis"](np.linspace(0.0, 0.92, len(points))) if many else COLOURS
    with mpl.rc_context(LOOK):
        figure, axes = subplots(3, 1, figsize=(8.0, 8.2), sharex=True)
        for k, (label, frequency, modulus) in enumerate(points):
            look = dict(marker=MARKS[k % len(MARKS)], linestyle="none", markersize=4, color=colours[k % len(colours)])
            axes[0].plot(frequency, modulus.real, label=label, **look)
            axes[1].plot(frequency, modulus.imag / modulus.real, **look)
            axes[2].plot(frequency, modulus.imag, **look)
        axes[0].plot(wide, curve.real, color="black", label=law_of(material))
        axes[1].plot(wide, curve.imag / curve.real, color="black")
        axes[2].plot(wide, curve.imag, color="black", label="sum")
        for k, (name, term) in enumerate(terms):
            few = len(terms) <= MOST_LABELS - 1
            look = dict(color=COLOURS[k % len(COLOURS)], linestyle=("--", ":", "-.")[k % 3]) if few else dict(color="#999999")
            axes[2].plot(wide, term.imag, linewidth=1.0, label=name if few else "each term" if k == 0 else None, **look)
        for axis, label in zip(axes, ("storage modulus E' [Pa]", "loss factor E''/E' [-]", "loss modulus E'' [Pa]")):
            axis.set_ylabel(label)
            axis.set_xscale("log")
            axis.set_yscale("log")
            axis.margins(x=0.02)
        losses = np.concatenate([curve.imag, *(modulus.imag for _, _, modulus in points)])
        axes[2].set_ylim(losses.min() / 3.0, losses.max() * 1.5)  # terms far below the sum do not matter
        for axis in (axes[2],) if many else (axes[0], axes[2]):
            axis.legend(ncols=5, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2)
        axes[2].set_xlabel("frequency [Hz]")
        if many:
            figure.legend(handles=axes[0].lines, loc="outside lower center", ncols=8, fontsize=8)
        figure.suptitle(title)
    return figure


def shifted(options: Options, data: Measurements) -> tuple[MasterCurve | None, list[str]]:
    """Return the master curve at the reference temperature and notes about it; no curve where there is one temperature."""
    sets = data.temperatures
    wanted = {option: value for option in ("reference", "temperature") if (value := getattr(options, option)) is not None}
    if sets.size < 2:
        if wanted:
            raise DataError(f"--{next(iter(wanted))}: the table has fewer than two temperatures, between which it could lie")
        return None, []
    for option, value in wanted.items():
        if not sets[0] - options.tolerance <= value + data.zero <= sets[-1] + options.tolerance:
            ends = f"{data.name(sets[0])} to {data.name(sets[-1])}"
            raise DataError(f"--{option} {value:g}: outside the measured temperatures, {ends}; nothing is claimed there")
    reference = float(sets[sets.size // 2]) if options.reference is None else options.reference + data.zero
    law = options.shift or ("wlf" if sets.size > 2 else "free")
    found = master_curve(data, law, reference)
    words = {"wlf": "WLF, C1 = {0:.4g}, C2 = {1:.4g} K", "arrhenius": "Arrhenius, {0:.4g} kJ/mol", "free": "a factor each"}
    notes = [
        f"{sets.size} temperatures (within {options.tolerance:g} K: one); reference {data.name(reference)}; "
        f"shift: {words[law].format(*found.constants)}",
        "   temperature   rows         a_T  known to  a_T by overlap  misfit, rms",
    ]
    for k, temperature in enumerate(sets):
        error = f"{100 * (10.0 ** found.errors[k] - 1):7.2g} %" if np.isfinite(found.errors[k]) else f"{'open':>9}"
        overlap = f"{10.0 ** found.overlaps[k]:15.4g}" if np.isfinite(found.overlaps[k]) else f"{'open':>15}"
        factors = f"{10.0 ** found.shifts[k]:11.4g} {error} {overlap}"
        notes.append(f"  {data.name(temperature):>12} {(data.group == k).sum():6d} {factors} {100 * found.misfits[k]:10.2g} %")
    source = "its neighbours, by kelvin" if law == "free" else "the law"
    for k, low, high in found.open:
        names = " to ".join(data.name(t) for t in sets[k : k + 2])
        ends = [f"above {low:.2f}"] * int(np.isfinite(low)) + [f"below {high:.2f}"] * int(np.isfinite(high))
        words = f"warning: the overlap leaves the shift from {names} open: log10 a_T {' and '.join(ends) or 'of any size'}"
        notes.append(f"{words}; taken from {source}: {found.shifts[k + 1] - found.shifts[k]:.2f}")
    return found, notes


def as_measured(data: Measurements) -> list[str]:
    """Return a note for a set whose storage modulus falls with frequency: by more than its scatter explains, or by a tenth."""
    notes = []
    for k in range(data.group.max() + 1):
        storage = np.log(data.modulus[data.group == k].real)
        scatter = np.median(np.abs(np.diff(storage, 2))) / (0.6745 * np.sqrt(6.0)) if storage.size > 4 else 0.0
        fall = float((np.maximum.accumulate(storage) - storage).max())
        if fall > min(max(0.01, 4.0 * np.sqrt(2.0) * scatter), 0.1):
            where = f" at {data.name(data.temperatures[k])}" if data.temperatures.size else ""
            words = f"warning: the measured storage modulus{where} falls by {100.0 * (1.0 - np.exp(-fall)):.2g} % while the"
            notes.append(f"{words} frequency rises, which that of a relaxing material never does")
    return notes


def fit_table(source: str | Path, options: Options) -> MaterialFit:
    """Fit terms to a table of measured moduli, as material_data.py reads it; DataError: it cannot be used so."""
    source = Path(source)
    data = material_data.read(source, options.columns, options.units, options.tolerance)
    curve, notes = shifted(options, data)
    frequency = curve.frequency if curve else data.frequency
    labels = [data.name(temperature) for temperature in data.temperatures] if curve else ["data"]
    points = [(label, frequency[data.group == k], data.modulus[data.group == k]) for k, label in enumerate(labels)]
    shift, at = "", None if options.temperature is None else options.temperature + data.zero
    if curve and at is not None:
        notes.append(f"at {data.name(at)} times are {10.0 ** curve.shift(at):.4g} of these")
    if curve and curve.law != "free":
        shift = shift_keys(curve.law, curve.constants, curve.reference, at)
    elif curve and at is not None:
        shift = f" ghm_frequency_scale={10.0 ** -curve.shift(at):.6g}"
    notes += as_measured(data)
    options = replace(options, name=options.name or source.stem)
    return replace(fitted(options, source, points, notes, shift, curve), shear=data.shear)


def convert(source: Path, options: Options, biela: Path) -> MaterialFit:
    """Fit terms of another law to the modulus of a deck's material, over a band; DataError, DeckError."""
    group = read_deck(source, biela=biela).one("material", (options.name or "").lower())
    material = of_group(group)
    said = {key: ",".join(f"{value:.8g}" for value in group.numbers(key)) for key in SHIFT_KEYS}
    shift = "".join(f" {key}={values}" for key, values in said.items() if values)
    shift += "".join(f" {key}={group.number(key):.8g}" for key in KEPT if key in group.values)
    stated = tuple(group.number("ghm_frequency_scale", 1.0) * end for end in group.numbers("band"))
    frequency = np.logspace(*np.log10(options.band or stated or band_of(material)), 120)
    points = [("as stated", frequency, material.modulus(frequency))]
    return fitted(replace(options, name=group.word("name"), density=group.number("density")), source, points, [], shift)


def band_of(material: Material) -> tuple[float, float]:
    """Return the frequencies over which a material is drawn where none are asked for: three decades below its fastest pole [Hz]."""
    fastest = material.fastest_pole / (2.0 * np.pi) if material.internal_variables else 1.0e3 / (2.0 * np.pi)
    return 1.0e-3 * fastest, fastest


def fitted(
    options: Options, source: Path, points: list, notes: list[str], shift: str = "", curve: MasterCurve | None = None
) -> MaterialFit:
    """Fit terms to points: label, frequencies [Hz], complex moduli [Pa]; shift: the deck's keys of the temperature."""
    frequency, modulus = (np.concatenate([one[k] for one in points]) for k in (1, 2))
    inside = np.ones(frequency.size, dtype=bool)
    if options.band:
        inside = (frequency >= options.band[0] * (1.0 - EDGE)) & (frequency <= options.band[1] * (1.0 + EDGE))
    if inside.sum() < 2:
        ends = f"{options.band[0]:g} to {options.band[1]:g} Hz"
        raise DataError(f"{source}: fewer than two rows lie inside the band {ends}")
    frequency, modulus = frequency[inside], modulus[inside]
    band = (frequency.min(), frequency.max())
    found, law_notes = chosen_fit(options, frequency, modulus)
    material = found.material
    worst = float(relative_error(material, frequency, modulus).max())
    notes = [
        f"{law_of(material)} fitted to {source.name}, {frequency.size} rows, {band[0]:g} to {band[1]:g} Hz",
        f"relative error |E_fit/E - 1|: {100 * found.error:.3g} % rms, {100 * worst:.3g} % at most; by decade:",
        *(f"  {line}" for line in errors_by_decade(material, frequency, modulus)),
        "outside that band the terms extrapolate: nothing is claimed there",
        f"fastest pole {material.fastest_pole:.4g} 1/s; {material.internal_variables} internal variables a deformation",
        *outside_poles(material, band),
        *falling_storage(material, band),
        *law_notes,
        *notes,
    ]
    if found.error > options.target and not options.terms:
        notes.append(f"warning: no fit reaches --target {options.target:g}, the best has {found.error:.3g}")
    if options.density is None:
        notes.append("no --density was given: set it before use")
    return MaterialFit(material, options.name, found.error, options.density, band, shift, points, notes, curve)


def work(args: argparse.Namespace) -> int:
    """Do what the command line asks: print the lines of the fit, write and draw them; or draw a deck's material."""
    columns = {quantity: name for quantity in material_data.USUAL if (name := getattr(args, f"column_{quantity}"))}
    options = Options(columns=columns, **{one.name: getattr(args, one.name) for one in fields(Options) if one.name != "columns"})
    if args.source.suffix != ".nml":
        found = fit_table(args.source, options)
    elif args.law or args.terms:
        found = convert(args.source, options, args.biela)
    else:
        return show_material(args)
    print(found.text, end="")
    for words in found.warnings:
        print(f"{args.source}: warning: {words}", file=sys.stderr)
    stem = args.output or args.source.with_name(f"{args.source.stem}_fit")
    drawn, lines = write(found, stem)
    print(f"\nwrote {lines} and {drawn}", file=sys.stderr)
    return 0


def write(found: MaterialFit, stem: Path) -> tuple[Path, Path]:
    """Draw a fit and write its lines; returns both paths. DataError, HistoryError: one cannot be written."""
    drawn = save(found.picture(), stem_of(stem, (".nml",)))
    lines = stem_of(stem, (*FORMATS, ".nml"))
    lines = lines.with_name(lines.name + ".nml")
    with writing(lines):
        lines.write_text(found.text, encoding="utf-8")
    return drawn, lines


def show_material(args: argparse.Namespace) -> int:
    """Draw a deck's material and print its modulus; DataError, DeckError."""
    deck = read_deck(args.source, biela=args.biela)
    group = deck.one("material", (args.name or "").lower())
    name, material = group.word("name"), of_group(group, *moved(group, deck))
    band = tuple(args.band or band_of(material))
    stem = args.output or args.source.with_name(f"{args.source.stem}_modulus")
    drawn = save(picture(material, f"{name}: {law_of(material)}", band, []), stem)
    for frequency in np.logspace(*np.log10(band), 7):
        value = material.modulus(np.array([frequency]))[0]
        print(f"{frequency:12.4g} Hz   E' {value.real:11.4e} Pa   loss factor {value.imag / value.real:8.4f}")
    print(f"fastest pole {material.fastest_pole:.4g} 1/s; {material.internal_variables} internal variables a deformation")
    print(f"wrote {drawn}", file=sys.stderr)
    return 0
