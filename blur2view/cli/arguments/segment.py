"""``blur2view segment``: its options and its help."""

from blur2view.cli.arguments import help_text, shared
from blur2view.cli.arguments.parser import CommandParser
from blur2view.results.masks import MaskDocument, MasksDocument

ABOUT = "segment what moves by itself from what the camera's motion explains"
DESCRIPTION = """
Segment what moves by itself from what the camera's motion explains. The camera's motion is one smooth field
through the smears and, where there is one, F. How far a smear departs from both, how sure it is of itself,
and where the photograph is blurred otherwise than the camera's motion blurs it, is weighed by a small network
trained on rendered photographs; outlines follow the photograph's edges. Smears are read in windows of 96
pixels: what is small, or moves much faster than the camera, is mostly not seen, nor is an object that moves
along the camera's epipolar lines, which looks like one at another depth.
"""
FILES = """
<stem>.mask.png: 8-bit grey: 0 static, 255 moving, 128 unobservable (smooth, or its smear is not read, or it
    may as well move as stand still)
<stem>.moving.png: probability of moving, times 255
<stem>.motion.png: the photograph over a caption, pink on what moves, hatched where it is unobservable
masks/...: with --masks: the mask under the name and with the greys that the program reads
<stem>.motion.json: the JSON document of the photograph; written last
"""
EXAMPLES = (
    "blur2view segment street.jpg -o masks",
    "blur2view segment photographs/*.jpg -o results --masks colmap",
)
REFUSED = {
    "--readout": "a rolling shutter lengthens smears along themselves, which masks hardly notice (with a "
    "readout of two exposure times less than 2 % of simulated static scenes is called moving); for the pose "
    "use blur2view estimate or report, which corrects it beside the mask"
}


OUTPUT = """
-o, --output DIR: write DIR/<stem>.mask.png, .moving.png, .motion.png and .motion.json, see below
--masks: also write masks for a program, below DIR/masks: colmap NAME.jpg.png and nerfstudio NAME.png,
    0 where pixels are ignored; instant-ngp dynamic_mask_NAME.png, 255 there
--unobservable: what --masks makes of unobservable pixels (default: keep)
"""


def describe(parser: CommandParser) -> None:
    """Add the options and the help of ``blur2view segment``."""
    shared.add_photographs(parser)
    shared.add_output(
        parser,
        OUTPUT + shared.OVERWRITE + shared.STREAM + shared.TIMINGS + shared.TABLE,
        masks={"choices": ("colmap", "nerfstudio", "instant-ngp")},
        unobservable={"choices": ("keep", "ignore"), "default": "keep"},
    )
    shared.add_estimating(parser, exposure=False)
    tables = {
        "files of -o": FILES + help_text.MANIFEST,
        "JSON document of --json": MasksDocument,
        "JSON document of a photograph": MaskDocument,
        "not here": REFUSED.items(),
    }
    help_text.explain(parser, DESCRIPTION, tables, EXAMPLES)
