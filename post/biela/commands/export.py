"""Write results in the formats of other programs: CSV, HDF5, Parquet, MATLAB, VTK for ParaView.

    export.py results/four_bar --to csv                        history.csv beside history.txt, units in the columns' names
    export.py results/four_bar --to matlab --file energy       energy.mat: a vector a column, the units in `units`
    export.py results/four_bar --to hdf5                       history.h5: a data set a column, its unit as attribute
    export.py results/four_bar --to vtk                      vtk/motion.pvd: the moving mechanism

VTK takes the motion of bodies and nodes: the deck needs a motion_step in its &transient.
"""

from pathlib import Path

from .. import command
from ..result_files import RESULT_FILES, TABLES

parser = command.parser("export", __doc__)
parser.add_argument("runs", nargs="+", type=Path, metavar="RUN", help="results folder or results file")
parser.add_argument("--to", choices=[*TABLES, "vtk"], required=True, help="format")
parser.add_argument("--file", choices=sorted(RESULT_FILES), default="history", help="which file of results folders (history)")
parser.add_argument("--output", type=Path, metavar="PATH", help="file to write (folder for vtk), where there is one RUN")

main = command.program(parser, "export.export")
