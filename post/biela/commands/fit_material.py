"""Fit GHM or Maxwell terms to a measured complex modulus and print the `&material` lines; or draw and convert a deck's material.

    fit_material.py DATA.csv --density 1200                       terms of the law that fits better at equal cost
    fit_material.py DATA.csv --density 1200 --law ghm --terms 3   a law and a number of terms
    fit_material.py DATA.csv --density 1200 --reference 20        sets of several temperatures, shifted to a master curve at 20
    fit_material.py DATA.csv --density 1200 --temperature 35      the same, for a part at 35
    fit_material.py MATERIAL.nml --band 1 1500                    draws the modulus of a material
    fit_material.py MATERIAL.nml --band 1 1500 --law maxwell      the same modulus by terms of the other law

DATA.csv has the header f,E_stor,E_loss[,T[,set]] (or E_stor,eta) and a line of units, such as Hz,MPa,MPa,C; other names of
columns are given by options. Rows of one set, and rows whose temperatures differ by less than --tolerance, are one curve. What
is made small is the relative error |E_fit/E - 1|, root mean square over the rows. Temperatures are in the table's unit.
"""

from pathlib import Path

from .. import command

QUANTITIES = ("frequency", "storage", "loss", "factor", "temperature", "set")  # columns of a table, of material_data.USUAL
parser = command.parser("fit_material", __doc__, runs_solver=True)
parser.add_argument("source", type=Path, metavar="DATA.csv|MATERIAL.nml", help="measurements, or a deck with a material")
parser.add_argument("--law", choices=["ghm", "maxwell"], help="kind of the terms (the better one at equal cost)")
parser.add_argument("--terms", type=int, metavar="N", help="number of terms (as few as reach --target)")
parser.add_argument("--target", type=float, default=0.01, metavar="E", help="error at which terms are enough (%(default)s)")
parser.add_argument("--fastest-pole", type=float, metavar="1/s", help="bound of the terms' poles (a decade above the band)")
parser.add_argument("--name", help="name of the material: printed, or picked from MATERIAL.nml")
parser.add_argument("--density", type=float, metavar="KG/M3", help="density that the printed lines state")
parser.add_argument("--source-note", default="", metavar="TEXT", help="where the data come from, for the printed comment")
parser.add_argument("--output", type=Path, metavar="STEM", help="STEM.nml and STEM.png; STEM.pdf: PDF (beside the source)")
parser.add_argument("--band", nargs=2, type=float, metavar=("LOW", "HIGH"), help="frequencies used [Hz]")
parser.add_argument("--deck", type=Path, help="a deck: tells its stable steps with the fitted terms in its material NAME")
table = parser.add_argument_group("the table")
for quantity in QUANTITIES:
    option = "--temperature-column" if quantity == "temperature" else f"--{quantity}"
    table.add_argument(option, dest=f"column_{quantity}", metavar="COLUMN", help=f"name of the column of {quantity}")
table.add_argument("--units", default="", metavar="LIST", help="units, where it has none: Hz,MPa,MPa,C")
shift = parser.add_argument_group("several temperatures")
shift.add_argument(
    "--tolerance", type=command.positive, default=0.5, metavar="K", help="temperatures this near are one (%(default)s)"
)
shift.add_argument("--shift", choices=["free", "wlf", "arrhenius"], help="law of the shift (wlf; of two temperatures free)")
shift.add_argument("--reference", type=command.finite, metavar="T", help="temperature of the terms (the middle one)")
shift.add_argument("--temperature", type=command.finite, metavar="T", help="temperature at which the part is used (reference)")

main = command.program(parser, "fit_material.work")
