"""``blur2view to-colmap``: blurred photographs as images that COLMAP can use; its options, help and work."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

from blur2view.camera import Camera
from blur2view.cli.batch.job import Job, Outcome
from blur2view.cli.batch.photograph import estimate_file
from blur2view.cli.batch.run import Run
from blur2view.cli.batch.summary import print_failure, print_table, print_written_table
from blur2view.cli.options import Command, Document, Order
from blur2view.cli.parser import file_path, flag, rare_option, required
from blur2view.cli.terminal import plural, printable, waiting
from blur2view.colmap.database import check_target, plan_links, write_database, write_links
from blur2view.colmap.project import storable
from blur2view.errors import CameraError, DatabaseError
from blur2view.exposure.views import ExposureViews, keypoint_views, views_of
from blur2view.geometry.configuration import Parallax
from blur2view.images.exif import EXIF_LOG_FOCAL, ExifValues
from blur2view.records.record import Record
from blur2view.two_view.constants import TRANSLATION_RULE

WRITTEN = """
NAME: the path of a photograph, relative to the folder that is given or else to the folder that all
    photographs share; give COLMAP this folder as --image_path. With --link it is the name in your database
a new database: it is written whole or not at all. A photograph without intrinsics gets COLMAP's guess
    (SIMPLE_RADIAL, a focal length of 1.2 times the longer side, no prior); a focal length of EXIF becomes a
    prior. A photograph without F and H has a configuration and no matches, because its ends have no order. A
    photograph whose translation is undecided has matches, but its two-view geometry has no inliers, because a
    mapper does not read the configuration, and would make points from a rotation
--link: the image of a photograph is the one whose name is the longest ending of the photograph's path. A
    feature at k becomes a keypoint at k - d(k)/2 of one view and at k + d(k)/2 of the other one, where d is
    the smear; it is matched if the smear is known to half of its length or to 1.5 px. The pairs
    photograph-open, photograph-close and open-close are added, with all matches as inliers, because depth
    comes from your other photographs. Your rows are read and never written. The database is first copied to
    DB.<time>.bak, and then changed in one transaction, so that a call that is killed leaves it as it was
    before or as it is after. Views of an earlier call are written anew. If COLMAP has a prior, the project's
    focal length is a hint; --camera project.db takes it as exact. Every program that maps the project later
    sees the views, too, unless it is limited to some images (image_names) or reads the backup
order in time: a single photograph does not show which view came first, but its neighbours in a video do.
    Where they do not decide, one order is taken and marked as unknown
"""
DOCUMENT = f"""
target: (str) Path of the database that was written.
backup: (str or null) Path of the copy that --link made before it changed the database.
photographs: (list) The photographs that were written. Each has the record of blur2view estimate, in which
    num_matches and num_inliers count matches of both views, and also: image, its path; views, the names of
    both; action, added or replaced; num_keypoints of each view; translation_known, whether the translation is
    given: it is {TRANSLATION_RULE}.
failures: (list) Photographs that failed: image, error.
"""


@dataclass(frozen=True, kw_only=True)
class ToColmapOptions(Command):
    """The options of ``blur2view to-colmap``.

    Write each photograph NAME into a COLMAP database as two virtual images, NAME#open and NAME#close: what
    the camera saw when the shutter opened and when it closed. Both have the photograph's camera, a rig and a
    frame, keypoints (the ends of the smears), matches, and a two-view geometry with configuration, F, H and,
    if the intrinsics are known, E and the pose. Pixels are those of the file as it is stored, because COLMAP
    does not apply the orientation of EXIF either. No file has these names, and mapping needs none.
    blur2view.mapper_options() returns options for COLMAP's mapper, whose defaults refuse such short
    baselines, and help("blur2view.colmap.mapping") explains how to map. --link adds the views to a project of
    yours, and "blur2view place" puts them into its model.
    """

    db: Annotated[Path, file_path] = required(
        "--db DB: COLMAP database to write; it must be new, unless --link adds to it"
    )
    link: bool = flag("--link: add the views to a database that has the photographs and their features")
    order: Order = Order()
    document: Document = Document()
    backup: bool = rare_option(
        "--no-backup: do not copy the database to DB.<time>.bak before --link changes it", True
    )

    exit_codes = Command.exit_codes | {
        "1": "at least one photograph failed; each has a line on stderr, and the views of all others are "
        "written. Or the call could not begin or go on; the last line says why, and nothing is written",
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
            raise ValueError("--link excludes --dask, because its workers cannot read the database")

    def execute(self) -> int:
        """Return the exit code, after estimating every photograph and writing all of them at once.

        A run that ends early writes nothing.
        """
        run, db, backup = Run(self), self.db, None
        run.jobs = view_jobs(run.jobs, db if self.link else None)
        if not self.link:
            check_target(db)
        run.do(views_one, print_failure, checked=db)
        print_table(run)
        print_written_table(run)
        estimates = [(job, outcome.record, outcome.part) for job, outcome in run.outcomes if outcome.part]
        if run.early_exit_code or not estimates:
            return run.exit_code
        views = [photograph_views for _, _, photograph_views in estimates]
        with waiting(f"writing {plural(len(estimates), 'photograph')} to {db}", hidden=self.printing.quiet):
            if self.link:
                backup = write_links(db, views, backup=self.backup)
            else:
                write_database(db, views)
        records = [views_record(*each) for each in estimates]
        if self.document.json:
            backup_name = None if backup is None else str(backup)
            document = {"target": str(db), "backup": backup_name, "photographs": records}
            print(json.dumps(document | {"failures": run.failures}, indent=2, allow_nan=False))
        elif not self.silent:
            print("\n".join(self._summary(records, backup)))
        return run.exit_code

    def _summary(self, records: list[dict[str, Any]], backup: Path | None) -> list[str]:
        """Return a line for each photograph, and one that says what was written."""
        lines = [views_line(record, verbose=self.printing.verbose) for record in records]
        undecided = sum(record["num_matches"] > 0 and not record["translation_known"] for record in records)
        if undecided:
            why = "nothing is lost, because the depth of their points comes from your other photographs"
            if not self.link:
                why = "COLMAP makes points from them only together with other photographs (--link)"
            cause = "a rotation or a plane explains their smears equally well"
            lines.append(f"translation undecided in {undecided} of {len(records)}: {cause}; {why}")
        count = f"{plural(2 * len(records), 'image')} of {plural(len(records), 'photograph')}"
        backup_note = "" if backup is None else f"; backup {printable(str(backup))}"
        return [*lines, f"{printable(str(self.db))}: wrote {count}{backup_note}"]


def views_one(options: ToColmapOptions, job: Job) -> Outcome:
    """Return the record of one photograph, and its views."""
    plan, stated_camera = job.plan, options.stated_camera

    def find_camera(path: Path, size: tuple[int, int], exif: ExifValues) -> Camera | None:
        camera = stated_camera.camera_for(path, size, exif)
        if plan is None:
            return camera
        project_camera = plan.camera
        if (project_camera.width, project_camera.height) != size:
            raise CameraError(
                f"{path}: has {size[0]}x{size[1]} pixels, but {project_camera.width}x{project_camera.height} "
                f"in {options.db}; give the photograph from which the features were extracted"
            )
        hint = plan.prior_focal and not stated_camera.given
        return replace(project_camera, log_focal_sigma=EXIF_LOG_FOCAL) if hint else camera

    file = estimate_file(options, job, find_camera=find_camera)
    views = views_of(job.name, file.estimate)
    if plan is not None:
        views = keypoint_views(job.name, plan.keypoints, file.estimate, options.estimating.robust())
    return Outcome(record=file.record(), part=views)


def view_jobs(jobs: Sequence[Job], project: Path | None) -> list[Job]:
    """Return the jobs, with their images in a user's project if one is given."""
    if project is None:
        rule = "a database cannot store its name, which is not UTF-8; rename it"
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
        document["reason"] = "none of its features has a smear that can be used"
    return document


def views_line(record: Mapping[str, Any], *, verbose: bool) -> str:
    """Return the line of a photograph."""
    name = printable(record["name"])
    if not record["num_matches"]:
        return f"{name}: {record['action']}, no matches: {record['reason']}"
    translation = "translation undecided"
    if record["translation_known"]:
        translation = "parallax proven" if record["parallax"] == Parallax.PROVEN else "translation known"
    counts = f"{record['num_inliers']} of {record['num_matches']} matches fit"
    sure = int(100 * record["time_confidence"])
    order = f"known by neighbours ({sure} % sure)" if record["time_known"] else "unknown"
    line = f"{name}: {record['action']}, {translation}; {counts}; order in time {order}"
    return f"{line}\n  {record['config']}: {record['reason']}" if verbose else line
