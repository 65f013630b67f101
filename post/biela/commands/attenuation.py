"""What took the energy of a run: friction, stops, viscoelastic materials, dampers.

With decks: runs them, prints what each joint, stop, spring and term of a material has lost, and draws it: over time, and by cause
(results/<deck name>/losses.png). Without: damping in the rod, in the joint, in both (the four decks slider_crank_joint_*), a table
of the attenuation and a picture in results/joints/, as `make joints` does.

Example: post/attenuation.py input/friction_slider_crank.nml
"""

from pathlib import Path

from .. import command

parser = command.parser("attenuation", __doc__, runs_solver=True)
parser.add_argument("decks", type=Path, nargs="*", metavar="DECK.nml", help="whose losses are told")

main = command.program(parser, "attenuation.work", failed=1)
