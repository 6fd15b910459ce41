"""``blur2view to-colmap``: blurred photographs as images that COLMAP can use; its options, help and work."""

from collections.abc import Collection
from dataclasses import MISSING, dataclass, replace
from pathlib import Path
from typing import ClassVar

from blur2view.camera.camera import Camera
from blur2view.camera.exif import ExifValues
from blur2view.camera.intrinsics import EXIF_LOG_FOCAL
from blur2view.cli.arguments.option import VIEWS, Rows, option
from blur2view.cli.arguments.shared import PhotographOptions
from blur2view.cli.run import End, open_manifest, run_over
from blur2view.cli.terminal import plural, verdict_line
from blur2view.cli.views import document_of, named_jobs, summary, with_time
from blur2view.cli.work import estimated, outcome_of
from blur2view.colmap.cameras import camera_of_database
from blur2view.colmap.connection import BESIDE
from blur2view.colmap.database import refuse_existing, write_database, written_photographs
from blur2view.colmap.link import ProjectImage, write_links
from blur2view.errors import CameraError, OutputError
from blur2view.exposure.views import ExposureViews, keypoint_views, views_of
from blur2view.movers.mask import MotionLabel, segment
from blur2view.results.stored import plain, restore
from blur2view.results.to_colmap import ToColmapDocument, ViewsDocument
from blur2view.results.verdicts import verdict_of
from blur2view.runs.job import Job, Outcome

WRITTEN = """
NAME: the path of a photograph below the one folder that is given, else below the one that all share, as for
    COLMAP with --image_path of that folder; with --link the name in your database
a fresh database: appears whole or not at all. Photographs without intrinsics get COLMAP's guess
    (SIMPLE_RADIAL, 1.2 times the longer side, no prior), those with EXIF's focal length that as a prior.
    Without F and H a photograph has its configuration and no matches: its ends have no order. Where the
    translation is undecided the matches are there, but no inliers of the two-view geometry: a mapper looks at
    no configuration, and would make points from a rotation
--link: finds the image of each photograph by the longest ending of its path, moves its features k to k -
    d(k)/2 and k + d(k)/2, where d is the smear (matched where it is known to half of its length or to 1.5
    px), and adds the pairs photograph-open, photograph-close and open-close, with all inliers, as depth comes
    from your other photographs. Rows of yours are read, never written; one transaction, after a copy to
    DB.<time>.bak: killed at any moment it leaves the database as before or as after. A second run changes
    nothing. Our rows are listed in the table blur2view_views. Where COLMAP has a prior, the project's focal
    length is a hint; --camera project.db takes it for true. Whatever maps the project later sees the views,
    too, unless it is limited to images (image_names) or given the backup
order in time: one photograph does not show which view came first; neighbours in a video do, by the
    project's matches or by SIFT. Where they do not decide, one direction is taken and marked unknown
"""
NOT_HERE = """
--readout: COLMAP has one pose for all rows of a view, which no correction of the smears mends, and their
    order in time is mostly unknown; for the pose use blur2view estimate
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
    readout: float | None = None

    tables: ClassVar[dict[str, Rows]] = {
        "what is written": WRITTEN,
        "JSON document of --json": ToColmapDocument,
        "JSON object of a photograph": ViewsDocument,
        "not here": NOT_HERE,
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
    def targets(self) -> dict[str, Path]:
        """The database, which is checked when it is read, and the table."""
        return ({} if self.dry_run else {"--db": self.db}) | super().targets

    @property
    def manifest_path(self) -> Path | None:
        """As of others; of a dry run none is kept."""
        return None if self.dry_run else super().manifest_path

    @property
    def prints(self) -> bool:
        """Whether a line is printed for each photograph while they are gone through: all are at the end."""
        return False

    def __call__(self, job: Job) -> Outcome:
        """Return the views of one photograph in JSON's types; its field, which is large, is not kept."""
        name, plan = job.name, job.target

        def camera_of(path: Path, size: tuple[int, int], exif: ExifValues) -> Camera | None:
            stated = self.run.intrinsics.of(path, size, exif)
            return stated if plan is None else self._project_camera(plan, path, size, stated)

        one = estimated(self, job, as_stored=True, camera_of=camera_of)  # COLMAP turns no picture upright
        if plan is None:
            views = views_of(name, one.estimate)
        else:
            moving = None
            if self.skip_movers:
                moving = segment(one.estimate, one.image).labels == MotionLabel.MOVING
            views = keypoint_views(name, plan.keypoints, one.estimate, self.run.options, moving)
        return outcome_of(
            one, plain(views), verdict_line(name, verdict_of(one), one.estimate.geometry.config.name)
        )

    def _project_camera(
        self, plan: ProjectImage, path: Path, size: tuple[int, int], stated: Camera | None
    ) -> Camera | None:
        """Return the intrinsics of the options; else the project's, as a hint; else those of EXIF."""
        own = camera_of_database(self.db, plan.camera_id)
        if (own.width, own.height) != size:
            raise CameraError(
                f"{path}: is of {size[0]}x{size[1]} pixels, in {self.db} of {own.width}x{own.height}"
                "; give the photograph that the features are from"
            )
        hinted = plan.prior_focal and self.focal is None and self.camera is None
        return replace(own, log_focal_sigma=EXIF_LOG_FOCAL) if hinted else stated

    def execute(self) -> int:
        """Return the exit code, after estimating every photograph and writing all of them at once.

        An interrupted run writes what is done, but nothing into a project of the user's.
        """
        jobs, kept = named_jobs(self.inputs, self.db if self.link else None, replace_views=self.replace)
        with open_manifest(self, [Path(f"{self.db}{end}") for end in BESIDE]) as manifest:
            before = self._written_before()
            of_name = {job.name: job for job in jobs if job.refusal is None}
            self._refuse_loss(before, of_name.keys())
            finished = run_over(self, jobs, manifest)
            views = [restore(ExposureViews, one.payload) for _, one in finished.outcomes if not one.error]
            written = {one.name for one in views}
            incomplete = self.link or not views or (before or set()) - written
            if finished.end is End.BROKEN or (finished.end is End.INTERRUPTED and incomplete):
                return finished.exit_code
            self._refuse_loss(before, written)
            in_order = True if self.sequence is None and self.inputs.one_video else self.sequence
            paths = {name: job.path for name, job in of_name.items()}
            views = with_time(views, paths, self.db if self.link else None, in_order=in_order)
            backup = None
            if self.link and not self.dry_run:
                links = [(of_name[one.name].target, one) for one in views]
                backup = write_links(self.db, links, backup=self.backup)
            elif views and not self.dry_run:
                write_database(self.db, views, replace=before is not None)
        document = ToColmapDocument(
            target=str(self.db),
            dry_run=self.dry_run,
            backup=None if backup is None else str(backup),
            photographs=[document_of(of_name[one.name], one) for one in views],
            kept=[{"image": str(job.path), "name": job.name} for job in kept],
            failures=finished.failures,
        )
        if self.json:
            print(document.to_json())
        elif not self.quiet:
            print(summary(document, linked=self.link, verbose=self.verbose))
        return finished.exit_code

    def _written_before(self) -> set[str] | None:
        """Return the photographs whose views an earlier call has written, which this one writes anew.

        None if no database of views alone is replaced; DatabaseError of another one that is there.
        """
        if self.link:
            return None
        before = written_photographs(self.db)
        if before is None:
            refuse_existing(self.db)
        return None if self.dry_run else before

    def _refuse_loss(self, before: set[str] | None, names: Collection[str]) -> None:
        """Refuse to write these photographs alone where views of others are there."""
        if lost := sorted((before or set()).difference(names)):
            views = f"{plural(len(lost), 'photograph')} ({', '.join(lost[:3])})"
            raise OutputError(
                f"{self.db}: holds the views of {views}, which this call does not write again; name all that "
                "it holds, from the same folder, or choose another --db"
            )
