"""Draw a mechanism's motion from motion.txt: a moving picture (GIF, MP4) and a sheet of snapshots (PNG); no window is needed.

The run must have written motion.txt (motion_step in the deck's transient). Joints, links, springs and lumps are drawn as the
solver assembled them (summary.json beside motion.txt). A beam is drawn as a smooth curve through its nodes.

Example: post/animate.py results/four_bar --trace coupler.3 --mp4
"""

from pathlib import Path

from .. import command

parser = command.parser("animate", __doc__)
parser.add_argument("run", type=Path, help="results folder or motion.txt")
parser.add_argument("--exaggerate", type=command.finite, default=1.0, metavar="FACTOR", help="multiply the deflections (1)")
parser.add_argument("--frames", type=command.count, default=100, help="largest number of frames (%(default)d)")
parser.add_argument("--seconds", type=command.positive, default=5.0, help="how long the animation lasts (%(default)g)")
parser.add_argument("--pictures", type=command.count, default=6, help="snapshots on the sheet (%(default)d)")
parser.add_argument("--trace", nargs="+", default=[], metavar="NAME", help="draw the path of a BODY, BODY.NODE or sensor")
parser.add_argument("--mp4", action="store_true", help="write STEM.mp4 too")
where = "write STEM.gif and STEM.png, of STEM.gif, STEM.mp4 or STEM.pdf that file alone (motion, in the run's folder)"
parser.add_argument("--output", type=Path, metavar="STEM", help=where)

main = command.program(parser, "animate.animate")
