"""Draw what a modal analysis and a frequency response left in a results folder, as PNG (PDF, SVG by --output).

STEM_modes: the shapes over the mechanism at the place about which they were computed, with joints, links and springs. STEM_poles:
the poles in the complex plane, undamped and damped. STEM_response: amplitude and phase of every sensor.

Example: post/modes.py results/modal_four_bar
"""

from pathlib import Path

from .. import command

parser = command.parser("modes", __doc__)
parser.add_argument("run", type=Path, metavar="RUN", help="results folder with modes.txt, frequency_response.txt or both")
parser.add_argument("--modes", nargs="+", type=int, metavar="N", help="modes whose shapes are drawn (the first six)")
parser.add_argument("--columns", nargs="+", metavar="NAME", help="sensors of the response, wildcards allowed (all)")
parser.add_argument("--title", default="", help="written above the pictures")
parser.add_argument("--output", type=Path, metavar="STEM", help="begin of the pictures' names, STEM.pdf: as PDF (RUN/modal)")

main = command.program(parser, "modes.draw_all")
