"""``blur2view place``: its options and its help."""

from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import ClassVar

from blur2view.cli.arguments.option import INPUT, Options, Rows, option
from blur2view.cli.arguments.values import share

WRITTEN = """
DIR: the model with the views, in COLMAP's binary format, and project.ini, which names the database and the
    folder of the frames. What an earlier call wrote is replaced; a model of another's is not
"""


@dataclass(frozen=True, kw_only=True)
class PlaceOptions(Options):
    """The options of ``blur2view place``.

    Put the views that blur2view to-colmap --link has written to a project, NAME#open and NAME#close, into
    COLMAP's model of the frames. The frames stay where they are; their poses are the camera's path, on which
    the smears say how long an exposure was.
    """

    command = "place"
    database: Path = option(MISSING, "DB", group=INPUT)
    "the project with the views"
    model: Path = option(MISSING, "MODEL", group=INPUT)
    "folder of COLMAP's model of the frames, or of a mapper's models, of which the largest is taken"
    photographs: Path = option(MISSING, "FRAMES", group=INPUT)
    """folder of the frames, all of one video: COLMAP's --image_path. Where their numbers leave some out, no
    two are taken for neighbours"""
    fraction: float | None = option(None, "F", group=INPUT, convert=share, rare=True)
    "exposure time over frame interval, at most 1, if it is known (default: measured from the smears)"
    output: Path = option(MISSING, "DIR", names="-o --output")
    "where the model goes"

    tables: ClassVar[dict[str, Rows]] = {"what is written": WRITTEN}
    examples = (
        "blur2view to-colmap --db project.db --link --sequence frames",
        "blur2view place project.db model frames -o with_views",
        "blur2view to-transforms with_views",
    )
