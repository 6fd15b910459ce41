"""``blur2view triage``: its options and its help."""

from blur2view.cli.arguments import shared
from blur2view.results.table import Row

MAX_SMEAR_PX = 3.0
"""Longest median smear of a photograph that is called sharp: at most this, half of the SIFT features that a
photograph shares with itself under fresh noise are still matched (``python -m tools.benchmarks.triage``;
chosen on the photographs of Kodak's suite that train networks, shown on the others)."""

ABOUT = "sort photographs by their smears: sharp, blurred but of use, unusable"
DESCRIPTION = """
Look at every photograph and say how long its smears are: a table of all, and a list of those to use for
structure from motion. Smears, unlike the variance of the Laplacian, do not confuse a lack of texture with
blur.
"""
USES = """
sharp: the median of all smears of the picture is at most --max-smear; on the list
blurred: it is longer, but F or H explains the smears, so that the views of the exposure are of use (blur2view
    to-colmap); on the list with --blurred only
unusable: it is longer, and no geometry explains it (DEGENERATE, UNDEFINED), or nothing shows texture; never
    on the list
"""
LIST = """
--keep: names, one on a line, relative to the folder that was given or that all photographs share: what COLMAP
    takes as --image_list_path with that folder as --image_path. Written into that folder, it is also a list
    for blur2view, as @frames/keep.txt, from anywhere. Nothing else is in it; which of them are blurred stands
    in the table
"""
EXAMPLES = (
    "blur2view triage frames --csv triage.csv --keep frames/keep.txt",
    "blur2view triage frames --keep frames/keep.txt --max-smear 3 --blurred",
    "blur2view estimate @frames/keep.txt -o results",
    "colmap feature_extractor --image_path frames --image_list_path frames/keep.txt --database_path a.db",
)


def describe(parser: shared.CommandParser) -> None:
    """Add the options and the help of ``blur2view triage``."""
    parser.description = shared.paragraph(DESCRIPTION)
    shared.add_photographs(parser)
    output = parser.add_argument_group("output")
    add = output.add_argument
    shared.add_table(add)
    add(
        "--keep",
        type=shared.output_path,
        metavar="LIST",
        help="write the list of photographs to use, see below",
    )
    add(
        "--max-smear",
        type=float,
        default=MAX_SMEAR_PX,
        metavar="PX",
        help="the longest median of a sharp photograph (default: %(default)g, up to which half of its "
        "SIFT features are still matched)",
    )
    add("--blurred", action="store_true", help="list the blurred ones, too, that geometry can use")
    add(
        "--overwrite",
        action="store_true",
        help="replace a list that was changed since it was written, too, if it names nothing but these "
        "photographs",
    )
    shared.add_timings(add)
    shared.add_verbosity(output)
    shared.add_estimating(parser, exposure=True)
    parser.epilog = shared.epilog(
        shared.table("uses", USES),
        shared.table("columns of --csv", shared.keys(Row)),
        shared.table("the list", LIST),
        examples=EXAMPLES,
    )
