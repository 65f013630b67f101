"""The slider-crank of Vaz, Rade & Lima, undamped against viscoelastic: runs the decks, draws, prints the attenuation.

`make demo` calls it from the project's root. Results go to results/<deck name>/, pictures to results/demo/.

Example: post/demo.py
"""

from .. import command

parser = command.parser("demo", __doc__, runs_solver=True)

main = command.program(parser, "demo.demonstrate", failed=1)
