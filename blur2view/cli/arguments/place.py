"""``blur2view place``: its options and its help."""

from blur2view.cli.arguments import help_text, shared
from blur2view.cli.arguments.parser import CommandParser

ABOUT = "put the views of a linked project into COLMAP's model of its frames"
DESCRIPTION = """
Put the views that blur2view to-colmap --link has written to a project, NAME#open and NAME#close, into
COLMAP's model of the frames. The frames stay where they are; their poses are the camera's path, on which the
smears say how long an exposure was.
"""
WRITTEN = """
DIR: the model with the views, in COLMAP's binary format, and project.ini, which names the database and the
    folder of the frames. What an earlier call wrote is replaced; a model of another's is not
"""
EXAMPLES = (
    "blur2view to-colmap --db project.db --link --sequence frames",
    "blur2view place project.db model frames -o with_views",
    "blur2view to-transforms with_views",
)


INPUT = """
database DB: the project with the views
model MODEL: folder of COLMAP's model of the frames, or of a mapper's models, of which the largest is taken
photographs FRAMES: folder of the frames, all of one video: COLMAP's --image_path. Where their numbers leave
    some out, no two are taken for neighbours
--fraction F: exposure time over frame interval, if it is known (default: measured from the smears)
"""
OUTPUT = """
-o, --output DIR: where the model goes
"""


def describe(parser: CommandParser) -> None:
    """Add the options and the help of ``blur2view place``."""
    help_text.add_options(parser.add_argument_group("input"), INPUT, fraction={"type": float})
    shared.add_output(parser, OUTPUT, output={"required": True})
    help_text.explain(parser, DESCRIPTION, {"what is written": WRITTEN}, EXAMPLES)
