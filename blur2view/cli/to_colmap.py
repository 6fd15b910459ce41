"""``blur2view to-colmap``: blurred photographs as images that COLMAP can use; its options, help and work."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from blur2view.camera import EXIF_LOG_FOCAL, Camera, ExifValues
from blur2view.cli.jobs import Job, Outcome
from blur2view.cli.options import Command, Document, Order
from blur2view.cli.parser import flag, rare_option, required
from blur2view.cli.run import Run, estimate_file
from blur2view.cli.terminal import plural, printable, waiting
from blur2view.colmap.database import check_target, plan_links, write_database, write_links
from blur2view.colmap.project import storable
from blur2view.errors import CameraError, DatabaseError
from blur2view.exposure.views import ExposureViews, keypoint_views, views_of
from blur2view.geometry.configuration import Parallax
from blur2view.results.record import Record
from blur2view.two_view.constants import TRANSLATION_RULE

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
    DB.<time>.bak: killed at any moment it leaves the database as before or as after. Views of an earlier
    call are written anew. Where COLMAP has a prior, the project's focal length is a hint; --camera project.db
    takes it for true. Whatever maps the project later sees the views, too, unless it is limited to images
    (image_names) or given the backup
order in time: one photograph does not show which view came first; neighbours in a video do. Where they do not
    decide, one direction is taken and marked unknown
"""
DOCUMENT = f"""
target: (str) The database that was written.
backup: (str or null) The copy of the database from before, with --link.
photographs: (list) Those that were written: the record of blur2view estimate, in which num_matches and
    num_inliers count matches of both views; and image, its path; views, the names of both; action, added or
    replaced; num_keypoints of each view; translation_known, whether there is a translation: it
    is {TRANSLATION_RULE}.
failures: (list) Photographs that failed: image, error.
"""


@dataclass(frozen=True, kw_only=True)
class ToColmapOptions(Command):
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

    db: Path = required("--db DB: the database: a new one, or with --link yours")
    link: bool = flag("--link: add to a database that holds the photographs and their features")
    order: Order = Order()
    document: Document = Document()
    backup: bool = rare_option(
        "--no-backup: with --link: do not copy the database to DB.<time>.bak first", True
    )

    exit_codes = Command.exit_codes | {
        "1": "a photograph failed, with one line on stderr each; views of the others are written",
        "130": "interrupted by Ctrl-C; nothing is written",
    }
    examples = (
        "blur2view to-colmap --db new.db --focal 525 photographs/*.jpg",
        "blur2view to-colmap --db project.db --link --sequence frames/*.png",
    )
    tables = {"what is written": WRITTEN, "JSON document of --json": DOCUMENT}
    as_stored = True  # COLMAP turns nothing upright

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.link and not self.backup:
            raise ValueError("--no-backup goes with --link")
        if self.link and self.many.dask is not None:
            raise ValueError("--link goes without --dask, whose workers see no database")

    def execute(self) -> int:
        """Return the exit code, after estimating every photograph and writing all of them at once.

        A run that ends early writes nothing.
        """
        run, db, backup = Run(self), self.db, None
        run.jobs = view_jobs(run.jobs, db if self.link else None)
        if not self.link:
            check_target(db)
        run.do(views_one, lines=False, checked=db)
        done = [(job, outcome.record, outcome.part) for job, outcome in run.outcomes if outcome.part]
        if run.early_exit_code or not done:
            return run.exit_code
        views = [of_photograph for _, _, of_photograph in done]
        with waiting(f"writing {plural(len(done), 'photograph')} to {db}", hidden=self.printing.quiet):
            if self.link:
                backup = write_links(db, views, backup=self.backup)
            else:
                write_database(db, views)
        records = [views_record(*each) for each in done]
        if self.document.json:
            kept = None if backup is None else str(backup)
            document = {"target": str(db), "backup": kept, "photographs": records}
            print(json.dumps(document | {"failures": run.failures}, indent=2, allow_nan=False))
        elif not self.silent:
            print("\n".join(self._summary(records, backup)))
        return run.exit_code

    def _summary(self, records: list[dict[str, Any]], backup: Path | None) -> list[str]:
        """Return a line for each photograph, and one that says what was written."""
        lines = [views_line(record, verbose=self.printing.verbose) for record in records]
        undecided = sum(record["num_matches"] > 0 and not record["translation_known"] for record in records)
        if undecided:
            why = "nothing is lost, as the depth of their points comes from your other photographs"
            if not self.link:
                why = "COLMAP makes no points from them alone, only beside other photographs (--link)"
            turned = "a rotation or a plane explains their smears as well"
            lines.append(f"translation undecided in {undecided} of {len(records)}: {turned}; {why}")
        count = f"{plural(2 * len(records), 'image')} of {plural(len(records), 'photograph')}"
        kept = "" if backup is None else f"; backup {printable(str(backup))}"
        return [*lines, f"{printable(str(self.db))}: wrote {count}{kept}"]


def views_one(options: ToColmapOptions, job: Job) -> Outcome:
    """Return the record of one photograph, and its views."""
    plan, stated = job.plan, options.stated_camera

    def camera_of(path: Path, size: tuple[int, int], exif: ExifValues) -> Camera | None:
        camera = stated.camera_of(path, size, exif)
        if plan is None:
            return camera
        own = plan.camera
        if (own.width, own.height) != size:
            raise CameraError(
                f"{path}: is of {size[0]}x{size[1]} pixels, in {options.db} of {own.width}x{own.height}"
                "; give the photograph that the features are from"
            )
        hint = plan.prior_focal and not stated.given
        return replace(own, log_focal_sigma=EXIF_LOG_FOCAL) if hint else camera

    file = estimate_file(options, job, camera_of=camera_of)
    views = views_of(job.name, file.estimate)
    if plan is not None:
        views = keypoint_views(job.name, plan.keypoints, file.estimate, options.estimating.robust())
    return Outcome(record=file.record(), part=views)


def view_jobs(jobs: Sequence[Job], project: Path | None) -> list[Job]:
    """Return the jobs, with their images in a user's project if one is given."""
    if project is None:
        rule = "its name is not UTF-8, which a database needs; rename it"
        refusals = [None if storable(job.name) else DatabaseError(f"{job.source}: {rule}") for job in jobs]
        return [replace(job, refusal=job.refusal or why) for job, why in zip(jobs, refusals, strict=True)]
    planned = []
    for job, plan in zip(jobs, plan_links(project, [Path(str(job.source)) for job in jobs]), strict=True):
        if isinstance(plan, DatabaseError):
            planned.append(replace(job, refusal=job.refusal or plan))
        else:
            planned.append(replace(job, name=plan.name, plan=plan))
    return planned


def views_record(job: Job, record: Record, views: ExposureViews) -> dict[str, Any]:
    """Return the entry of a photograph in the JSON document."""
    geometry, plan, count = views.geometry, job.plan, len(views.matched)
    document = record.to_dict() | {
        "image": str(job.source),
        "views": list(views.names),
        "action": "replaced" if plan is not None and plan.linked else "added",
        "num_keypoints": len(views.points_open),
        "num_matches": count,
        "num_inliers": int(geometry.inlier_mask.sum()) if count else 0,
        "translation_known": views.translation_known,
    }
    if plan is not None and not count and not (geometry.F is None and geometry.H is None):
        document["reason"] = "no feature of yours has a smear that can be used"
    return document


def views_line(record: Mapping[str, Any], *, verbose: bool) -> str:
    """Return the line of a photograph."""
    name = printable(record["name"])
    if not record["num_matches"]:
        return f"{name}: {record['action']}, no matches: {record['reason']}"
    moved = "translation undecided"
    if record["translation_known"]:
        moved = "parallax proven" if record["parallax"] == Parallax.PROVEN else "translation known"
    counts = f"{record['num_inliers']} of {record['num_matches']} matches fit"
    sure = int(100 * record["time_confidence"])
    order = f"known by neighbours ({sure} % sure)" if record["time_known"] else "unknown"
    line = f"{name}: {record['action']}, {moved}; {counts}; order in time {order}"
    return f"{line}\n  {record['config']}: {record['reason']}" if verbose else line
