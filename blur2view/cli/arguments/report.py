"""``blur2view report``: its options and its help."""

from argparse import SUPPRESS
from pathlib import Path

from blur2view.cli.arguments import help_text, shared
from blur2view.cli.arguments.parser import CommandParser

ABOUT = "write one HTML page that shows the result of each photograph"
DESCRIPTION = """
Write one HTML file that holds everything and loads nothing: to look at, to send, to archive. An index of the
photographs, sortable by verdict, length of the smears and name; for each the picture with smears, inliers,
epipolar lines, uncertainty and motion mask as layers, the verdict with its reason, the models that competed,
F, the timings, and the JSON document of blur2view estimate to download. A photograph that fails is a card
with its reason. It needs a browser of 2023 or later.
"""
CONTROLS = """
click or tap: a smear: its ends and, where there is no H, both epipolar lines
hover: the values of a smear
pinch, Ctrl and wheel: zoom; also by the keys + and -
arrow keys: walk from smear to smear
"""
TERMS = """
distance from lines: sqrt SErrMin, the root of the squared Sampson distance of a smear's ends from their
    epipolar lines, in the better of both orders: pixels, compared with --max-error
epipole: where epipolar lines meet: the camera moved towards it or from it
P(moves): probability that a pixel moves by itself, of the motion mask
uncertainty: standard deviation (sigma) of a smear that the network predicts, pixels
"""
EXAMPLES = (
    "blur2view report clip.mp4 --every 10 -o report.html",
    "blur2view report a.jpg --focal 525 --no-mask",
)


OUTPUT = """
-o, --output HTML: the page (default: %(default)s); one of an earlier call is replaced, unless all fail
--overwrite: which does nothing here
--no-mask: without the motion mask: faster
"""


def describe(parser: CommandParser) -> None:
    """Add the options and the help of ``blur2view report``."""
    parser.description = help_text.paragraph(DESCRIPTION)
    shared.add_photographs(parser)
    output = parser.add_argument_group("output")
    help_text.add_options(
        output,
        OUTPUT + shared.SEQUENCE + shared.TIMINGS + shared.TABLE,
        output={"default": Path("report.html")},
        overwrite={"action": "store_true", "help": SUPPRESS},
    )
    shared.add_verbosity(output)
    shared.add_estimating(parser, exposure=True)
    parser.epilog = help_text.epilog(
        help_text.table("on the page", CONTROLS),
        help_text.table("terms of the page", TERMS),
        examples=EXAMPLES,
    )
