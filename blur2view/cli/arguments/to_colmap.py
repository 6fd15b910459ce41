"""``blur2view to-colmap``: its options and its help."""

from blur2view.cli.arguments import help_text, shared
from blur2view.cli.arguments.parser import CommandParser
from blur2view.results.to_colmap import ToColmapDocument, ViewsDocument

ABOUT = "write each photograph as two virtual images, at shutter-open and shutter-close, for COLMAP"
DESCRIPTION = """
Write each photograph NAME as two virtual images, NAME#open and NAME#close: what the camera saw when the
shutter opened and when it closed. They share the photograph's camera and have a rig and a frame, keypoints
(both ends of the smears), matches, and a two-view geometry with configuration, F, H and, with known
intrinsics, E and the pose. Pixels are those of the file as it is stored, as in all of COLMAP: the orientation
of EXIF is not applied. No files have these names, and mapping needs none; blur2view.mapper_options() has the
mapper's options, as its defaults refuse such short baselines, and help("blur2view.colmap.mapping") the ways
to map. With --link the views join a project of yours; blur2view place puts them into its model.
"""
WRITTEN = """
NAME: the path of a photograph below the one folder that is given, else below the one that all share, as for
    COLMAP with --image_path of that folder; with --link the name in your database
a fresh database: appears whole or not at all. Equal cameras are shared. Photographs without intrinsics get
    COLMAP's guess (SIMPLE_RADIAL, 1.2 times the longer side, no prior), those with EXIF's focal length that
    as a prior. Without F and H a photograph has its configuration and no matches: its ends have no order.
    Where the translation is undecided (no parallax is proven, and known intrinsics leave its direction open)
    the matches are there, but no inliers of the two-view geometry: a mapper looks at no configuration, and
    would make points from a rotation. blur2view.triangulate_exposure refuses such, too
--link: finds the image of each photograph by the longest ending of its path, moves its features k to k -
    d(k)/2 and k + d(k)/2, where d is the smear (matched where it is known to half of its length or to 1.5
    px), and adds the pairs photograph-open, photograph-close and open-close, so that tracks run through all
    three. Rows of yours are read, never written; one transaction, after a copy to DB.<time>.bak: killed at
    any moment it leaves the database as before or as after. A second run changes nothing. Our rows are listed
    in the table blur2view_views, with how sure the direction of time is. Where COLMAP has a prior, the
    project's focal length is a hint; --camera project.db takes it for true. Whatever maps the project later
    sees the views, too, unless it is limited to images (image_names) or given the backup. Databases up to
    COLMAP 4.2 are known; newer, locked, damaged and foreign ones are refused in one line
order in time: one photograph does not show which view came first; neighbours in a video do, by the
    project's matches or by SIFT. Where they do not decide, one direction is taken and marked unknown
"""
EXAMPLES = (
    "blur2view to-colmap --db new.db --focal 525 photographs/*.jpg",
    "blur2view to-colmap --db project.db --link --sequence frames/*.png",
)
REFUSED = {
    "--readout": "COLMAP has one pose for all rows of a view, but a rolling shutter shows each at another "
    "time; a correction of the smears would leave that, the larger error, and would double theirs if the "
    "order in time, which is mostly unknown, is the other; for the pose use blur2view estimate"
}


OUTPUT = """
--db DB: the database: a new one, or with --link yours
--link: add to a database that holds the photographs and their features
--replace: with --link: write anew what an earlier call has written (after new features, a new network)
--no-backup: with --link: do not copy the database to DB.<time>.bak first
--dry-run: estimate, say what would be written, and write nothing
--json: print one JSON document instead of the summaries, see below
"""
VIEWS = """
--skip-movers: with --link: leave features on what moves by itself unmatched, as blur2view segment marks it
--[no-]sequence: the photographs are a video in this order, so that neighbours show which view came first;
    with --no-sequence nothing is concluded from neighbours (default: from those in one folder whose names
    differ by one in their number)
"""


def describe(parser: CommandParser) -> None:
    """Add the options and the help of ``blur2view to-colmap``."""
    shared.add_photographs(parser)
    shared.add_output(parser, OUTPUT + shared.TABLE, db={"required": True})
    help_text.add_options(parser.add_argument_group("views"), VIEWS)
    shared.add_estimating(parser, exposure=False)
    tables = {
        "what is written": WRITTEN,
        "JSON document of --json": ToColmapDocument,
        "JSON object of a photograph": ViewsDocument,
        "not here": REFUSED.items(),
    }
    help_text.explain(parser, DESCRIPTION, tables, EXAMPLES)
