"""Run a deck over ranges of its parameters and gather numbers of every run into one table.

    sweep.py STUDY.toml                                   all runs on all cores; results/sweep/STUDY/table.csv and pictures
    sweep.py STUDY.toml --best 'min peak' --where 'height < 0.012'
    sweep.py STUDY.toml --dask tcp://HOST:8786            on the workers of a Dask scheduler that sees this folder

An interrupted sweep goes on where it was; what was run is not run again. A run that fails stands in the table with its reason.
"""

from .. import command

parser = command.study_parser("sweep", __doc__)
parser.add_argument("--best", metavar="'min NAME'", help="name the best run: 'min' or 'max' and a result")
parser.add_argument("--where", action="append", default=[], metavar="'NAME < VALUE'", help="condition of the best")
parser.add_argument("--keep", action="store_true", help="keep all decks and results, with all their sensors")

main = command.program(parser, "sweep_work.work")
