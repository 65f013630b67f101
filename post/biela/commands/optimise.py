"""Find the best design: the smallest or largest result within limits, by parameters that are free or from lists.

    optimise.py STUDY.toml                                the study says best = 'min mass', where = ['peak < 1e-3']
    optimise.py STUDY.toml --best 'min mass' --where 'peak < 1e-3'
    optimise.py STUDY.toml --dask tcp://HOST:8786         on the workers of a Dask scheduler that sees this folder

Searches from several starts at once (SLSQP). History, optimum, sensitivities and pictures go to results/optimise/STUDY/. An
interrupted search goes on where it was. Status 1: no design meets the limits.
"""

from .. import command

parser = command.study_parser("optimise", __doc__)
parser.add_argument("--best", metavar="'min NAME'", help="'min' or 'max' and a result (best of the study)")
parser.add_argument("--where", action="append", default=[], metavar="'NAME < VALUE'", help="limit, beside those of the study")

main = command.program(parser, "optimise_work.work")
