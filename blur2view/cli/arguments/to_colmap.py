"""``blur2view to-colmap``: its options and its help."""

from dataclasses import MISSING, dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from blur2view.cli.arguments.option import VIEWS, Rows, option, refused
from blur2view.cli.arguments.shared import PhotographOptions
from blur2view.results.to_colmap import ToColmapDocument, ViewsDocument

if TYPE_CHECKING:
    from blur2view.runs.job import Job, Outcome

WRITTEN = """
NAME: the path of a photograph below the one folder that is given, else below the one that all share, as for
    COLMAP with --image_path of that folder; with --link the name in your database
a fresh database: appears whole or not at all. Equal cameras are shared. Photographs without intrinsics get
    COLMAP's guess (SIMPLE_RADIAL, 1.2 times the longer side, no prior), those with EXIF's focal length that
    as a prior. Without F and H a photograph has its configuration and no matches: its ends have no order.
    Where the translation is undecided (no parallax is proven, and known intrinsics leave its direction open)
    the matches are there, but no inliers of the two-view geometry: a mapper looks at no configuration, and
    would make points from a rotation. blur2view.triangulate_exposure refuses such, too. With --link the
    inliers are written all the same: the depth of your points comes from your other photographs
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


@dataclass(frozen=True, kw_only=True)
class ToColmapOptions(PhotographOptions):
    """The options of ``blur2view to-colmap``.

    Write each photograph NAME as two virtual images, NAME#open and NAME#close: what the camera saw when the
    shutter opened and when it closed. They share the photograph's camera and have a rig and a frame,
    keypoints (both ends of the smears), matches, and a two-view geometry with configuration, F, H and, with
    known intrinsics, E and the pose. Pixels are those of the file as it is stored, as in all of COLMAP: the
    orientation of EXIF is not applied. No files have these names, and mapping needs none;
    blur2view.mapper_options() has the mapper's options, as its defaults refuse such short baselines, and
    help("blur2view.colmap.mapping") the ways to map. With --link the views join a project of yours; blur2view
    place puts them into its model.
    """

    command = "to-colmap"
    replace: bool = option(False, rare=True)
    "with --link: write anew what an earlier call has written (after new features, a new network)"
    backup: bool = option(True, rare=True)
    "with --link: do not copy the database to DB.<time>.bak first"
    dry_run: bool = option(False, rare=True)
    "estimate, say what would be written, and write nothing"
    json: bool = option(False)
    "print one JSON document instead of the summaries, see below"
    db: Path = option(MISSING, "DB", names="--db")
    "the database: a new one, or with --link yours"
    link: bool = option(False, result=True)
    "add to a database that holds the photographs and their features"
    sequence: bool | None = option(None, group=VIEWS)
    """the photographs are a video in this order, whatever they are called: neighbours show which view came
    first. Without it those do that lie in one folder and whose names differ by one in their number, which is
    as good where no frame is left out; with --no-sequence nothing is concluded from neighbours"""
    skip_movers: bool = option(False, group=VIEWS, rare=True, result=True)
    "with --link: leave features on what moves by itself unmatched, as blur2view segment marks it"
    timings: bool = True
    timestamps: Path | None = None
    gyroscope: bool = False
    exposure: float | None = None
    readout: float | None = refused()
    """COLMAP has one pose for all rows of a view, but a rolling shutter shows each at another time; a
    correction of the smears would leave that, the larger error, and would double theirs if the order in time,
    which is mostly unknown, is the other; for the pose use blur2view estimate"""

    tables: ClassVar[dict[str, Rows]] = {
        "what is written": WRITTEN,
        "JSON document of --json": ToColmapDocument,
        "JSON object of a photograph": ViewsDocument,
    }
    examples = (
        "blur2view to-colmap --db new.db --focal 525 photographs/*.jpg",
        "blur2view to-colmap --db project.db --link --sequence frames/*.png",
    )

    def __post_init__(self) -> None:
        if not self.link and (self.replace or self.skip_movers or not self.backup):
            raise ValueError("--replace, --skip-movers and --no-backup go with --link")
        if self.link and self.dask is not None:
            raise ValueError("--link goes without --dask, whose workers see no database")
        super().__post_init__()

    @property
    def prints(self) -> bool:
        """Whether a line is printed for each photograph while they are gone through: all are at the end."""
        return False

    @property
    def in_order(self) -> bool | None:
        """Whether neighbours show which view came first; None: those whose names say so."""
        return True if self.sequence is None and self.inputs.one_video else self.sequence

    def __call__(self, job: "Job") -> "Outcome":
        """Return the views of one photograph."""
        outcome: Outcome = import_module("blur2view.cli.views").views_outcome(self, job)  # which imports this
        return outcome
