"""``blur2view triage``: its options and its help."""

import argparse
import math

from blur2view.cli.arguments import help_text, shared
from blur2view.cli.options import Amount
from blur2view.results.table import Row

MAX_SMEAR = Amount(number=3.0)
"""Longest median smear, pixels, of a photograph that is called sharp: at most this, half of the SIFT features
that a photograph shares with itself under fresh noise are still matched (``python -m
tools.benchmarks.triage``; chosen on the photographs of Kodak's suite that train networks, shown on the
others)."""

ABOUT = "sort photographs by their smears: sharp, blurred but of use, unusable"
DESCRIPTION = """
Look at every photograph and say how long its smears are: a table of all, and a list, or a folder, of those to
use for structure from motion: the sharp ones, the sharpest ones, or the sharpest of every few neighbours.
Smears, unlike the variance of the Laplacian, do not confuse a lack of texture with blur.
"""
USES = """
sharp: the median of all smears of the picture is at most --max-smear; kept
blurred: it is longer, but F or H explains the smears, so that the views of the exposure are of use (blur2view
    to-colmap); kept with --blurred only
unusable: it is longer, and no geometry explains it (DEGENERATE, UNDEFINED); kept by --best and --every-best
    only
unclear: the median is below its own standard deviation, or nothing shows texture: smooth or out of focus,
    perhaps sharp; kept as unusable ones
near the limit: within a tenth of it a frame is sharp if the one before it in its video is
the same photographs of another size: give the limit in per cent of the diagonal. Frames that were compressed
    much again have shorter smears than those of their video; --extract compresses nothing
"""
LIST = """
--keep: names, one on a line, relative to the folder that was given or that all photographs share: what COLMAP
    takes as --image_list_path with that folder as --image_path. Written into that folder, it is also a list
    for blur2view, as @frames/keep.txt, from anywhere. Nothing else is in it; which of them are blurred stands
    in the table
--extract: files for COLMAP, ns-process-data and blur2view: frame 120 of a video (from 0) is frame_00120.png,
    with the pixels that were looked at, below the video's name if there are several; photographs are copied.
    The folder must hold nothing else, and nothing in it is replaced
--every-best: of every N neighbours in a video or folder one is kept, and another where it shows another view
"""
EXAMPLES = (
    "blur2view triage clip.mp4 --every-best 6 --extract frames",
    "blur2view triage clip.mp4 --best 300 --extract frames",
    "blur2view triage frames --csv triage.csv --keep frames/keep.txt",
    "blur2view triage frames --keep frames/keep.txt --max-smear 3 --blurred",
    "blur2view estimate @frames/keep.txt -o results",
    "colmap feature_extractor --image_path frames --image_list_path frames/keep.txt --database_path a.db",
)


def amount(text: str) -> Amount:
    """Return a number of 0 or more, or a percentage as 50%."""
    try:
        number = float(text.removesuffix("%"))
    except ValueError:
        number = math.nan
    if not 0 <= number < math.inf:
        raise argparse.ArgumentTypeError(f"expected a number as 3 or a percentage as 50%, got {text}")
    return Amount(number=number, percent=text.endswith("%"))


def best(text: str) -> Amount:
    """Return a number of photographs, 1 or more, or a percentage above 0 and at most 100."""
    value = amount(text)
    whole = value.number.is_integer() or value.percent
    if not whole or not 0 < value.number <= (100 if value.percent else math.inf):
        raise argparse.ArgumentTypeError(f"expected a number of photographs as 300 or 50%, got {text}")
    return value


def describe(parser: shared.CommandParser) -> None:
    """Add the options and the help of ``blur2view triage``."""
    parser.description = help_text.paragraph(DESCRIPTION)
    shared.add_photographs(parser)
    output = parser.add_argument_group("output")
    add = output.add_argument
    shared.add_table(add)
    add(
        "--keep",
        type=shared.output_path,
        metavar="LIST",
        help="write the list of photographs to keep, see below",
    )
    add(
        "--extract",
        type=shared.output_path,
        metavar="DIR",
        help="write the photographs to keep into a folder, frames of videos as PNG, see below",
    )
    add(
        "--max-smear",
        type=amount,
        default=MAX_SMEAR,
        metavar="PX",
        help="the longest median of a sharp photograph, in pixels, or as 0.3%% of the picture's diagonal "
        "(default: %(default)s, up to which half of its SIFT features are still matched)",
    )
    which = output.add_mutually_exclusive_group()
    which.add_argument(
        "--blurred", action="store_true", help="keep the blurred ones, too, that geometry can use"
    )
    which.add_argument("--best", type=best, metavar="N", help="keep the N sharpest, or as 50%% of all")
    which.add_argument(
        "--every-best",
        type=shared.positive,
        metavar="N",
        help="keep the sharpest of every N neighbours, and of each view among them",
    )
    add(
        "--sequence",
        dest="in_order",
        action="store_true",
        help="the photographs of a folder are the frames of a video in this order: near the limit each is as "
        "sharp as the one before, as frames of a video are anyway",
    )
    add(
        "--overwrite",
        action="store_true",
        help="replace a list that was changed since it was written, too, if it names nothing but these "
        "photographs",
    )
    shared.add_timings(add)
    shared.add_verbosity(output)
    shared.add_estimating(parser, exposure=True)
    parser.epilog = help_text.epilog(
        help_text.table("uses", USES),
        help_text.table("columns of --csv", help_text.keys(Row)),
        help_text.table("the list", LIST),
        examples=EXAMPLES,
    )
