"""The programs of post/: their command lines in one table. What stands here is loaded for --help, the work when it is asked for."""

from __future__ import annotations

import argparse
import importlib
import inspect
import math
import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Callable

from . import command
from .command import Progress, count, finite, positive
from .result_files import RESULT_FILES, TABLES

QUANTITIES = ("frequency", "storage", "loss", "factor", "temperature", "set")  # columns of a table, of material_data.USUAL
METHODS = ("rk4", "dopri5", "generalized_alpha", "radau")
STUDY = "deck, parameters and results (see post/README.md)"
ROWS = ("rows before this time do not count", "rows after this time do not count")


class Parser(argparse.ArgumentParser):
    """A command line whose help is laid out as it is written."""

    def __init__(self, name: str, text: str) -> None:
        super().__init__(prog=f"{name}.py", description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
        self.add = self.add_argument

    def add_solver(self) -> None:
        """Add the option that names the solver."""
        self.add("--biela", type=Path, default=command.SOLVER, help="the solver (bin/biela of the project)")

    def add_rows(self, start: str = ROWS[0], end: str = ROWS[1]) -> None:
        """Add the options by which rows count."""
        self.add("--start", type=finite, default=-math.inf, metavar="S", help=start)
        self.add("--end", type=finite, default=math.inf, metavar="S", help=end)

    def add_study(self, tool: str) -> None:
        """Add what all programs have that make the runs of a study."""
        self.add_solver()
        self.add("study", type=Path, metavar="STUDY.toml", help=STUDY)
        self.add("--output", type=Path, metavar="DIR", help=f"folder of the results (results/{tool}/<study name>)")
        self.add("--jobs", type=count, help=f"runs side by side (all cores: {os.cpu_count() or 1})")
        self.add("--scheduler", metavar="ADDRESS", help="address of a Dask scheduler, instead of this machine's cores")
        own = "(results with their own `{}`: that)".format
        self.add_rows(f"{ROWS[0]} {own('from')}", f"{ROWS[1]} {own('to')}")
        self.add("--no-pictures", action="store_true", help="tables only")


@dataclass(frozen=True)
class Program:
    """A program of post/."""

    name: str  # by which it is called
    text: str  # what --help says before the options
    options: Callable[[Parser], None]  # adds them to a parser
    work: str  # MODULE.FUNCTION of this package, which takes what was parsed and returns the exit status
    failed: int  # status after a fault

    def main(self, words: list[str] | None = None) -> int:
        """Do what a command line asks for and return the exit status."""
        parser = Parser(self.name, self.text)
        self.options(parser)
        args = parser.parse_args(words)
        Progress.shown = not getattr(args, "quiet", False)
        module, function = self.work.split(".")
        do = getattr(importlib.import_module(f".{module}", __package__), function)
        return command.attempt(self.name, lambda: do(args), self.failed)

    def __call__(self) -> None:
        """Be the command."""
        command.run(self.name, self.main)


PROGRAMS: dict[str, Program] = {}


def program(work: str, failed: int = 2) -> Callable[[Callable], Program]:
    """Return what makes a program of a function that adds its options; the function's docstring is the help."""

    def made(options: Callable[[Parser], None]) -> Program:
        name = options.__name__
        PROGRAMS[name] = Program(name, inspect.getdoc(options), options, work, failed)
        return PROGRAMS[name]

    return made


def start(called: str) -> None:
    """Run the program by whose name a script is called, with the project's own Python where there is one."""
    script = Path(called)
    name, own = script.stem, script.resolve().parents[1] / ".venv"
    if name not in PROGRAMS:
        sys.exit(f"{name}: no program of this name; there are {', '.join(sorted(PROGRAMS))}")
    python = own / "bin" / "python"
    if os.access(python, os.X_OK) and Path(sys.prefix).resolve() != own.resolve():
        os.execv(python, [str(python), str(script), *sys.argv[1:]])
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # to start threads takes longer than what they would compute
    PROGRAMS[name]()


@program("draw.work")
def draw(p: Parser) -> None:
    """Draw the assembled mechanism of a deck with its names, before any run: bodies, joints, drives, springs, loads, sensors.

    The solver assembles the deck (biela --check --json); a results folder is drawn from its summary.json. Lengths are to scale.

        post/draw.py input/four_bar.nml          writes results/four_bar/scene.png
    """
    p.add_solver()
    p.add("source", type=Path, metavar="DECK", help="a deck, or a results folder")
    p.add("--output", type=Path, metavar="FILE", help="the picture, .png, .pdf or .svg (results/DECK/scene.png)")


@program("plot.plot")
def plot(p: Parser) -> None:
    """Draw columns of one or several runs against time (or against another column), as PNG (PDF, SVG by --output).

    Columns of one unit share a panel; one that would be a flat line beside its neighbours gets a panel of its own. Columns that
    are zero throughout, or rounding beside others of their unit, are left out, unless they are named. Several runs lie over each
    other in one picture: the first blue, the second red (elastic, viscoelastic). Lengths against lengths (a path), forces against
    forces (a bearing's polar diagram) are to one scale.

    Example: post/plot.py results/slider_crank_elastic results/slider_crank_viscoelastic --columns 'qf4.*'
    """
    p.add("runs", nargs="+", type=Path, metavar="RUN", help="results folder, results file or .csv")
    p.add("--columns", nargs="+", metavar="NAME", help="columns, wildcards allowed, e.g. 'qf4.*' (all)")
    p.add("--against", metavar="NAME", help="column of the horizontal axis (the first: time, load, frequency)")
    turns = "rows of whole turns of a column [rad]: 1 is the first turn, -1 the last"
    p.add("--turns", nargs=3, metavar=("ANGLE", "FIRST", "LAST"), help=turns)
    p.add("--file", choices=sorted(RESULT_FILES), default="history", help="which file of results folders (history)")
    p.add("--events", action="store_true", help="mark the events of the runs, e.g. when stops touch, by lines")
    p.add("--labels", nargs="+", metavar="TEXT", help="names of the runs in the legend (those of their folders)")
    p.add("--title", default="", help="written above the picture")
    p.add("--output", type=Path, metavar="FILE", help="the picture, .png, .pdf or .svg (in the first run's folder)")


@program("animate.animate")
def animate(p: Parser) -> None:
    """Draw a mechanism's motion from motion.txt: a moving picture (GIF, MP4) and a sheet of snapshots (PNG); no window is needed.

    The run must have written motion.txt (motion_step in the deck's transient). Joints, links, springs and lumps are drawn as the
    solver assembled them. A beam is drawn as a smooth curve through its nodes.

    Example: post/animate.py results/four_bar --trace coupler.3 --mp4
    """
    p.add("run", type=Path, help="results folder or motion.txt")
    p.add("--exaggerate", type=finite, default=1.0, metavar="FACTOR", help="multiply the deflections (1)")
    p.add("--frames", type=count, default=100, help="largest number of frames (%(default)d)")
    p.add("--seconds", type=positive, default=5.0, help="how long the animation lasts (%(default)g)")
    p.add("--pictures", type=count, default=6, help="snapshots on the sheet (%(default)d)")
    p.add("--trace", nargs="+", default=[], metavar="NAME", help="draw the path of a BODY, BODY.NODE or sensor")
    p.add("--mp4", action="store_true", help="write STEM.mp4 too")
    where = "write STEM.gif and STEM.png, of STEM.gif, STEM.mp4 or STEM.pdf that file alone (motion, in the run's folder)"
    p.add("--output", type=Path, metavar="STEM", help=where)


@program("mode_pictures.draw_all")
def modes(p: Parser) -> None:
    """Draw what a modal analysis and a frequency response left in a results folder, as PNG (PDF, SVG by --output).

    STEM_modes: the shapes over the mechanism at the place about which they were computed, with joints, links and springs.
    STEM_shares: of beams of layers, the parts of the loss and the energy that viscoelastic layers have in each vibration.
    STEM_slip: how their cores shear along the beam.
    STEM_poles: the poles in the complex plane, undamped and damped. STEM_response: amplitude and phase of every sensor.

    Example: post/modes.py results/modal_four_bar
    """
    p.add("run", type=Path, metavar="RUN", help="results folder with modes.txt, frequency_response.txt or both")
    p.add("--modes", nargs="+", type=int, metavar="N", help="modes whose shapes are drawn (the first six)")
    p.add("--columns", nargs="+", metavar="NAME", help="sensors of the response, wildcards allowed (all)")
    p.add("--title", default="", help="written above the pictures")
    p.add("--output", type=Path, metavar="STEM", help="begin of the pictures' names, STEM.pdf: as PDF (RUN/modal)")


@program("spectrum_work.work")
def spectrum(p: Parser) -> None:
    """Draw what frequencies a run holds: amplitude spectrum, power spectral density, waterfall, orders of a drive, decay.

        spectrum.py results/four_bar --columns 'tip.*'                  amplitudes and power spectral density (Welch)
        spectrum.py results/run_up --columns tip.v --waterfall --speed crank.v      against the speed of a drive (else: time)
        spectrum.py results/engine --columns 'main.f?' --orders crank --turns -1 -1    orders of the last whole turn, exact
        spectrum.py results/ring_down --columns tip.v --decay           vibrations that decay, each with its damping
        spectrum.py results/engine --columns shank.top --life 120e6 2e6 5 rainflow cycles and damage

    Rows at uneven times are interpolated to as many even ones. Mean and trend are removed first. Peaks are marked
    and named, each with how surely it is known; two lines need some 4 periods of their difference in the run to be told apart.
    """
    p.add("run", type=Path, metavar="RUN", help="results folder, results file or .csv")
    p.add("--columns", nargs="+", required=True, metavar="NAME", help="columns, wildcards allowed")
    p.add_rows()
    kind = p.add_mutually_exclusive_group()
    kind.add_argument("--waterfall", action="store_true", help="amplitudes against time or --speed (one column)")
    kind.add_argument("--orders", metavar="ANGLE", help="column of a drive's angle [rad]: orders of its rotation")
    kind.add_argument("--decay", action="store_true", help="vibrations that decay: frequency, damping ratio, share of each")
    kind.add_argument("--rainflow", action="store_true", help="cycles by their ranges (ASTM E1049)")
    life = "with cycles and damage: S is the amplitude borne N times, others by Basquin's line of exponent K"
    kind.add_argument("--life", nargs=3, type=positive, metavar=("S", "N", "K"), help=life)
    p.add("--speed", metavar="COLUMN", help="with --waterfall: column of the drive's speed")
    turns = "with --orders: whole turns, 1 the first, -1 the last; no window, no trend removed"
    p.add("--turns", nargs=2, type=int, metavar=("FIRST", "LAST"), help=turns)
    p.add("--reference", type=positive, default=0.0, metavar="X", help="levels in dB against X [unit of the columns]")
    p.add("--peaks", type=int, default=5, metavar="N", help="peaks that are named (%(default)s)")
    p.add("--output", type=Path, metavar="FILE", help="the picture: .png, .pdf, .svg (spectrum.png beside the run)")


@program("report_page.work")
def report(p: Parser) -> None:
    """Write one page (HTML) about a run, or about two runs side by side: it opens from the disk and needs no network.

    It begins with the outcome, warnings, largest deflections, stresses and reactions, drives, where energy was lost, frequencies
    and damping. Then come the scene, histories, motion, modes, responses; what the solver did and the deck stand last. Of two runs
    the differences are drawn and tabulated, too.

        post/report.py results/slider_crank_elastic results/slider_crank_viscoelastic

    writes results/slider_crank_elastic/report.html.
    """
    p.add("runs", nargs="+", type=Path, metavar="RESULTS", help="one results folder, or two to compare")
    p.add("--labels", nargs="+", metavar="TEXT", help="names of the runs (those of their folders)")
    p.add("--title", help="headline (the first deck's title)")
    p.add_rows("largest values: rows before do not count", "largest values: rows after do not count")
    p.add("--output", type=Path, metavar="FILE", help="the page (report.html in the first folder)")


@program("compare.compare")
def compare(p: Parser) -> None:
    """Compare two histories, or a history with a reference: the largest difference of each column, relative to its range.

    The rule, for the tests too:
    - Each time of the reference must be in the run (to a millionth of the reference's shortest interval), and every column;
      further rows and columns of the run do not count.
    - The error of a column is its largest difference over all rows, divided by the range that it has in the reference.
    - A column that is constant in the reference (range below 1e-13 of its size or of the following) is measured by the largest
      range among the reference's columns of the same unit, else by its own size, and one that is zero by 1 of its unit.
    - A column passes when its error is at most its tolerance.

    Exit status: 0 every column within its tolerance, 1 some are not, 2 the files cannot be compared.

    Example: post/compare.py results/slider_crank_elastic expected.csv --tolerance 1e-5
    """
    p.add("run", type=Path, help="results folder, history file or .csv")
    p.add("reference", type=Path, help="results folder, history file or .csv")
    p.add("--tolerance", type=command.tolerance, default=1.0e-6, help="largest error of a column (%(default)g)")
    p.add("--columns", nargs="+", metavar="PATTERN", help="compare these columns only, e.g. 'qf4.*' (all)")
    of_some = "another tolerance, of some columns"
    p.add("--column", type=command.pair, action="append", default=[], metavar="PATTERN=TOLERANCE", help=of_some)
    p.add("--file", choices=["history", "energy", "motion"], default="history", help="which file of results folders")


@program("export.export")
def export(p: Parser) -> None:
    """Write results in the formats of other programs: CSV, HDF5, Parquet, MATLAB, VTK for ParaView.

        export.py results/four_bar --to csv                        history.csv beside history.txt, units in the columns' names
        export.py results/four_bar --to matlab --file energy       energy.mat: a vector a column, the units in `units`
        export.py results/four_bar --to hdf5                       history.h5: a data set a column, its unit as attribute
        export.py results/four_bar --to vtk                      vtk/motion.pvd: the moving mechanism

    VTK takes the motion of bodies and nodes: the deck needs a motion_step in its &transient.
    """
    p.add("runs", nargs="+", type=Path, metavar="RUN", help="results folder or results file")
    p.add("--to", choices=[*TABLES, "vtk"], required=True, help="format")
    p.add("--file", choices=sorted(RESULT_FILES), default="history", help="which file of results folders (history)")
    p.add("--output", type=Path, metavar="PATH", help="file to write (folder for vtk), where there is one RUN")


@program("fit_material.work")
def fit_material(p: Parser) -> None:
    """Fit GHM or Maxwell terms to a measured complex modulus, print the `&material` lines; or draw, convert a deck's material.

        fit_material.py DATA.csv --density 1200                       terms of the law that fits better at equal cost
        fit_material.py DATA.csv --density 1200 --reference 20 --temperature 35    several temperatures; for a part at 35
        fit_material.py MATERIAL.nml --band 1 1500                    draws the modulus of a material
        fit_material.py MATERIAL.nml --band 1 1500 --law maxwell      the same modulus by terms of the other law

    DATA.csv has the header f,E_stor,E_loss[,T[,set]] (or E_stor,eta) and a line of units, such as Hz,MPa,MPa,C; other names of
    columns are given by options. Rows of one set, and rows whose temperatures differ by less than --tolerance, are one curve. What
    is made small is the relative error |E_fit/E - 1|, root mean square over the rows. Temperatures are in the table's unit.
    """
    p.add_solver()
    p.add("source", type=Path, metavar="DATA.csv|MATERIAL.nml", help="measurements, or a deck with a material")
    p.add("--law", choices=["ghm", "maxwell"], help="kind of the terms (the better one at equal cost)")
    p.add("--terms", type=int, metavar="N", help="number of terms (as few as reach --target)")
    p.add("--target", type=float, default=0.01, metavar="E", help="error at which terms are enough (%(default)s)")
    p.add("--fastest-pole", type=float, metavar="1/s", help="bound of the terms' poles (a decade above the band)")
    p.add("--name", help="name of the material: printed, or picked from MATERIAL.nml")
    p.add("--density", type=float, metavar="KG/M3", help="density that the printed lines state")
    p.add("--output", type=Path, metavar="STEM", help="STEM.nml and STEM.png; STEM.pdf: PDF (beside the source)")
    p.add("--band", nargs=2, type=float, metavar=("LOW", "HIGH"), help="frequencies used [Hz]")
    table = p.add_argument_group("the table")
    for quantity in QUANTITIES:
        option = "--temperature-column" if quantity == "temperature" else f"--{quantity}"
        table.add_argument(option, dest=f"column_{quantity}", metavar="COLUMN", help=f"name of the column of {quantity}")
    table.add_argument("--units", default="", metavar="LIST", help="units, where it has none: Hz,MPa,MPa,C")
    shift = p.add_argument_group("several temperatures")
    near = "temperatures this near are one (%(default)s)"
    shift.add_argument("--tolerance", type=positive, default=0.5, metavar="K", help=near)
    shift.add_argument("--shift", choices=["free", "wlf", "arrhenius"], help="law of the shift (wlf; of two temperatures free)")
    shift.add_argument("--reference", type=finite, metavar="T", help="temperature of the terms (the middle one)")
    shift.add_argument("--temperature", type=finite, metavar="T", help="temperature at which the part is used (reference)")


@program("sweep_work.work")
def sweep(p: Parser) -> None:
    """Run a deck over ranges of its parameters and gather numbers of every run into one table.

        sweep.py STUDY.toml                                   all runs on all cores; results/sweep/STUDY/table.csv and pictures
        sweep.py STUDY.toml --best 'min peak' --where 'height < 0.012'

    An interrupted sweep goes on where it was; what was run is not run again. A run that fails stands in the table with its reason.
    """
    p.add_study("sweep")
    p.add("--best", metavar="'min NAME'", help="name the best run: 'min' or 'max' and a result")
    p.add("--where", action="append", default=[], metavar="'NAME < VALUE'", help="condition of the best")
    p.add("--allow-warnings", action="store_true", help="the best run may be one for whose motion the model does not hold")
    p.add("--keep", action="store_true", help="run all anew; keep decks and results in runs/, with all their sensors")


@program("optimise_work.work")
def optimise(p: Parser) -> None:
    """Find the best design: the smallest or largest result within limits, by parameters that are free or from lists.

        optimise.py STUDY.toml --best 'min mass' --where 'peak < 1e-3'

    Searches from several starts at once (SLSQP). History, optimum, sensitivities and pictures go to results/optimise/STUDY/. An
    interrupted search goes on where it was. Status 1: no design meets the limits.
    """
    p.add_study("optimise")
    p.add("--best", metavar="'min NAME'", help="'min' or 'max' and a result (best of the study)")
    p.add("--where", action="append", default=[], metavar="'NAME < VALUE'", help="limit, beside those of the study")
    p.add("--allow-warnings", action="store_true", help="designs count for whose motion the model does not hold")


@program("identify_work.work")
def identify(p: Parser) -> None:
    """Find parameters of a deck from what was measured: values, 95 % intervals, and what the data do not tell.

        identify.py STUDY.toml

    Results of the study with measure = "misfit" name the data. Least squares (scipy's trust region) from the best of runs all over
    the ranges. Exit status 1: there are combinations of parameters of which the data tell no more than their ranges do.
    """
    p.add_study("identify")


@program("sensitivity_work.work")
def sensitivity(p: Parser) -> None:
    """By how much results change with each free parameter: derivatives with their errors, a table and a tornado picture.

        sensitivity.py STUDY.toml --at outer=0.015 --at wall=1e-3     (left out: the study's start, else the deck's values)

    The step of the differences comes from the error that a run measures of itself; a derivative's error holds that and the step's.
    """
    p.add_study("sensitivity")
    p.add("--at", action="append", default=[], metavar="NAME=VALUE", help="value of a parameter; may stand several times")


@program("tradeoff_work.work")
def tradeoff(p: Parser) -> None:
    """Speed against accuracy, measured for a deck: which method, which step, and the smallest model that is good enough.

    Runs variants of the deck, measures the error of its sensors against a converged truth, takes out of the model what the sensors
    do not notice, and writes tradeoff.txt (every run, what each removal changes), recommended.nml (the cheapest adequate deck) and
    work_precision.png (error against seconds) into results/tradeoff/<deck name>/. An interrupted study goes on from there.

    The truth is the deck's own model by passes of the solver until they agree (accuracy=); what its meshes and modes err by is told
    by check_mesh and check_reduction in its &transient.

    Exit status: 0 recommended.nml meets the tolerance, 1 nothing does, 2 the deck or the command line is wrong.

    Example: post/tradeoff.py input/four_bar.nml --sensor rocker motor --tolerance 1e-2
    """
    p.add_solver()
    p.add("deck", type=Path, help="the deck, with a &transient and sensors")
    seconds = {"type": positive, "metavar": "SECONDS"}
    p.add("--sensor", nargs="+", default=[], metavar="NAME", help="sensors or columns (tip.v) to get right (all)")
    p.add("--tolerance", type=positive, default=1.0e-3, help="largest error over the range (%(default)g)")
    p.add("--methods", nargs="+", choices=METHODS, default=list(METHODS), help="methods that are tried (all)")
    p.add("--output", type=Path, help="folder (results/tradeoff/<deck name>)")
    p.add("--jobs", type=count, default=os.cpu_count() or 1, help="runs at a time (%(default)s)")
    p.add("--longest-run", **seconds, default=120.0, help="of any run at most (%(default)g)")
    p.add("--time", **seconds, default=600.0, help="of the whole study (%(default)g)")
    p.add("--scheduler", metavar="ADDRESS", help="address of a Dask scheduler, instead of this machine's cores")
    p.add("--quiet", action="store_true", help="no progress line")
