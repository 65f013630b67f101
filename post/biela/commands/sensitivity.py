"""By how much results change with each free parameter: derivatives with their errors, a table and a tornado picture.

    sensitivity.py STUDY.toml                             at the study's start, else as the deck has its parameters
    sensitivity.py STUDY.toml --at outer=0.015 --at wall=1e-3
    sensitivity.py STUDY.toml --dask tcp://HOST:8786      on the workers of a Dask scheduler that sees this folder

The step of the differences comes from the error that a run measures of itself; the error of a derivative holds that and the step's.
"""

from .. import command

parser = command.study_parser("sensitivity", __doc__)
parser.add_argument(
    "--at", action="append", default=[], metavar="NAME=VALUE", help="value of a parameter; may stand several times"
)

main = command.program(parser, "sensitivity_work.work")
