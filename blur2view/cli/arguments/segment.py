"""``blur2view segment``: its options and its help."""

from blur2view.cli.arguments import shared
from blur2view.documents.masks import MaskDocument, MasksDocument

ABOUT = "segment what moves by itself from what the camera's motion explains"
DESCRIPTION = """
Segment what moves by itself from what the camera's motion explains. Each smear is scored by its squared
distance from the epipolar lines of the camera's F (without F: by its error under the homography; before a
still camera: by its length), over its variance. What moves must contradict the motion of the whole picture
and those of two halves of it that explain as much; where these disagree it is unobservable, and all is where
one has none. Smears are read in windows of 96 pixels: what is small, or moves much faster than the camera,
mostly has no smear of its own, and is not seen, nor is an object that moves along the camera's epipolar
lines, which looks like one at another depth.
"""
FILES = """
<stem>.mask.png: indexed: 0 static, 1 moving, 2 unobservable (the smear is too short or uncertain, or so near
    the epipole that any motion would fit, or the camera's motion is not sure there)
<stem>.moving.png: probability of moving, times 255; above one half where the mask says moving
<stem>.motion.png: the photograph over a caption, pink on what moves, hatched where it is unobservable
<stem>.motion.json: the JSON document of the photograph; written last
"""
EXAMPLES = (
    "blur2view segment street.jpg -o masks",
    "blur2view segment photographs/*.jpg --objects --json > masks.json",
)
REFUSED = {
    "--readout": "a rolling shutter lengthens smears along themselves, which masks hardly notice (with a "
    "readout of two exposure times less than 2 % of simulated static scenes is called moving); for the pose "
    "use blur2view estimate or report, which corrects it beside the mask"
}


def describe(parser: shared.CommandParser) -> None:
    """Add the options and the help of ``blur2view segment``."""
    parser.description = shared.paragraph(DESCRIPTION)
    shared.add_photographs(parser)
    output = parser.add_argument_group("output")
    add = output.add_argument
    add(
        "-o",
        "--output",
        type=shared.output_path,
        metavar="DIR",
        help="write DIR/<stem>.mask.png, .moving.png, .motion.png and .motion.json, see below",
    )
    add("--objects", action="store_true", help="fit an F or a homography to each moving part, too")
    add("--overwrite", action="store_true", help="replace results of an earlier call")
    add("--json", action="store_true", help="print one JSON document instead of the summaries, see below")
    shared.add_timings(add)
    shared.add_table(add)
    shared.add_verbosity(output)
    shared.add_estimating(parser, exposure=False)
    parser.epilog = shared.epilog(
        shared.table("files of -o", FILES + shared.MANIFEST),
        shared.table("JSON document of --json", shared.keys(MasksDocument)),
        shared.table("JSON document of a photograph", shared.keys(MaskDocument)),
        shared.table("not here", REFUSED.items()),
        examples=EXAMPLES,
    )
