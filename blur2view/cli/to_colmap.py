"""``blur2view to-colmap``: blurred photographs as images that COLMAP can use; its options, help and work."""

import json
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from blur2view.camera.camera import Camera
from blur2view.camera.intrinsics import EXIF_LOG_FOCAL, ExifValues
from blur2view.cli.options import Common
from blur2view.cli.run import End, Photographs
from blur2view.cli.terminal import plural, printable, waiting
from blur2view.cli.work import Setup
from blur2view.colmap.cameras import camera_of_database
from blur2view.colmap.database import (
    matched,
    refuse_existing,
    translation_known,
    write_database,
    written_photographs,
)
from blur2view.colmap.link import ProjectImage, Step, plan_links, write_links
from blur2view.colmap.project import BESIDE, database_matcher, database_names, storable
from blur2view.errors import CameraError, DatabaseError, OutputError
from blur2view.exposure.features import photograph_matcher
from blur2view.exposure.time_direction import consecutive_runs, with_time_direction
from blur2view.exposure.views import ExposureViews, keypoint_views, views_of
from blur2view.geometry.two_view_geometry import Parallax
from blur2view.images.source import Source
from blur2view.movers.mask import MotionLabel, segment
from blur2view.runs.jobs import Job, Outcome

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
    nothing, except of photographs with new features. Our rows are listed in the table blur2view_views.
    Where COLMAP has a prior, the project's focal
    length is a hint; --camera project.db takes it for true. Whatever maps the project later sees the views,
    too, unless it is limited to images (image_names) or given the backup
order in time: one photograph does not show which view came first; neighbours in a video do, by the
    project's matches or by SIFT. Where they do not decide, one direction is taken and marked unknown
"""
DOCUMENT = """
target: (str) The database that was written.
backup: (str or null) The copy of the database from before, with --link.
photographs: (list) Those that were written: image, name, config, parallax and reason, as of blur2view
    estimate; views, the names of both; action, added or replaced; num_keypoints of each view; num_matches, of
    which num_inliers fit; translation_known, whether parallax is proven or the direction known to 30 degrees;
    time_known and time_confidence, whether neighbours decided which view came first, and how surely.
kept: (list) Photographs whose views are in the database already: image, name.
failures: (list) Photographs that failed: image, error.
"""
NOT_HERE = """
--readout: COLMAP has one pose for all rows of a view, which no correction of the smears mends, and their
    order in time is mostly unknown; for the pose use blur2view estimate
"""


@dataclass(frozen=True, kw_only=True, eq=False)
class LinkJob(Job):
    """A photograph with what linking will do with it in a project, if it is to be linked."""

    plan: ProjectImage | None = None


@dataclass(frozen=True, kw_only=True)
class Database:
    """output.

    --db DB: the database: a new one, or with --link yours
    --json: print one JSON document instead of the summaries, see below
    Rarely:
    --replace: with --link: write anew what an earlier call has written (after a new network)
    --no-backup: with --link: do not copy the database to DB.<time>.bak first
    """

    effect = False
    db: Path
    json: bool = False
    replace: bool = False
    backup: bool = True


@dataclass(frozen=True, kw_only=True)
class ToColmapOptions:
    """The options of ``blur2view to-colmap``.

    Write each photograph NAME as two virtual images, NAME#open and NAME#close: what the camera saw when the
    shutter opened and when it closed. They share the photograph's camera and have a rig and a frame,
    keypoints (both ends of the smears), matches, and a two-view geometry with configuration, F, H and, with
    known intrinsics, E and the pose. Pixels are those of the file as it is stored, as in all of COLMAP: the
    orientation of EXIF is not applied. No files have these names, and mapping needs none;
    blur2view.mapper_options() has the mapper's options, as its defaults refuse such short baselines, and
    help("blur2view.colmap.mapping") the ways to map. With --link the views join a project of yours; blur2view
    place puts them into its model.

    --link: add to a database that holds the photographs and their features
    --sequence: the photographs are a video in this order, whatever they are called: neighbours show which
        view came first. Without it those do that lie in one folder and whose names differ by one in their
        number, which is as good where no frame is left out; with --no-sequence nothing is concluded from
        neighbours
    Rarely:
    --skip-movers: with --link: leave features on what moves by itself unmatched, as blur2view segment marks
        it
    """

    common: Common
    database: Database
    link: bool = False
    sequence: bool | None = None
    skip_movers: bool = False

    examples = (
        "blur2view to-colmap --db new.db --focal 525 photographs/*.jpg",
        "blur2view to-colmap --db project.db --link --sequence frames/*.png",
    )

    def __post_init__(self) -> None:
        if not self.link and (self.database.replace or self.skip_movers or not self.database.backup):
            raise ValueError("--replace, --skip-movers and --no-backup go with --link")
        if self.link and self.common.many.dask is not None:
            raise ValueError("--link goes without --dask, whose workers see no database")

    @staticmethod
    def tables() -> dict[str, str | Mapping[str, str]]:
        """Return what --help-all lists besides options."""
        return {"what is written": WRITTEN, "JSON document of --json": DOCUMENT, "not here": NOT_HERE}

    def execute(self) -> int:
        """Return the exit code, after estimating every photograph and writing all of them at once.

        An interrupted run writes what is done, but nothing into a project of the user's.
        """
        photographs, db = Photographs.of("to-colmap", self), self.database.db
        project = db if self.link else None
        jobs, kept = named_jobs(photographs.jobs(), project, replace_views=self.database.replace)
        beside = [Path(f"{db}{end}") for end in BESIDE]
        with photographs.writing({"--db": (db, "")}, taken=beside):
            before = self._written_before()
            by_name = {job.name: job for job in jobs if job.refusal is None}
            self._refuse_loss(before, by_name.keys())
            work = partial(views_one, photographs.setup, project=project, skip_movers=self.skip_movers)
            finished = photographs.run(jobs, work, show=lambda job, outcome: "")
            views: list[ExposureViews] = [one.besides["views"] for one in finished.done]
            written = {one.name for one in views}
            incomplete = self.link or not views or (before or set()) - written
            if finished.end is End.STOPPED or (finished.end is End.INTERRUPTED and incomplete):
                return finished.exit_code
            self._refuse_loss(before, written)
            in_order = True if self.sequence is None and photographs.inputs.one_video else self.sequence
            sources = {name: job.source for name, job in by_name.items()}
            backup = None
            with waiting(f"writing {plural(len(views), 'photograph')} to {db}"):
                views = with_time(views, sources, project, in_order=in_order)
                if self.link:
                    links = [(one, by_name[one.name].plan) for one in views]
                    planned = [(plan, one) for one, plan in links if plan is not None]
                    backup = write_links(db, planned, backup=self.database.backup)
                elif views:
                    write_database(db, views, replace=before is not None)
        records = [views_record(by_name[one.name], one) for one in views]
        if self.database.json:
            document = {
                "target": str(db),
                "backup": None if backup is None else str(backup),
                "photographs": records,
                "kept": [{"image": str(job.source), "name": job.name} for job in kept],
                "failures": finished.failures,
            }
            print(json.dumps(document, indent=2, allow_nan=False))
        elif not self.common.printing.quiet:
            print(
                self._summary(records, kept, backup) + "; in place of those of an earlier call" * bool(before)
            )
        return finished.exit_code

    def _summary(self, records: list[dict[str, Any]], kept: list[LinkJob], backup: Path | None) -> str:
        """Return a line for each photograph, and one that says what was written."""
        lines = [views_line(one, linked=self.link, verbose=self.common.printing.verbose) for one in records]
        if kept:
            some = ", ".join(printable(job.name) for job in kept[:3]) + ", ..." * (len(kept) > 3)
            there = f"{plural(len(kept), 'photograph')} ({some})"
            lines.append(f"{there}: the views are there already; --replace makes them anew")
        target, count = printable(str(self.database.db)), len(records)
        if not count:
            return "\n".join([*lines, f"{target}: nothing to write"])
        pairs = plural(count * (3 if self.link else 1), "pair")
        total = f"{target}: wrote {plural(2 * count, 'image')} and {pairs} of {plural(count, 'photograph')}"
        total += "" if backup is None else f"; backup {printable(str(backup))}"
        undecided = sum(one["num_matches"] > 0 and not one["translation_known"] for one in records)
        if undecided:
            why = "nothing is lost, as the depth of their points comes from your other photographs"
            if not self.link:
                why = "COLMAP makes no points from them alone, only beside other photographs (--link)"
            turned = "a rotation or a plane explains their smears as well"
            lines.append(f"translation undecided in {undecided} of {count}: {turned}; {why}")
        return "\n".join([*lines, total])

    def _written_before(self) -> set[str] | None:
        """Return the photographs whose views an earlier call has written, which this one writes anew.

        None if no database of views alone is replaced; DatabaseError of another one that is there.
        """
        if self.link:
            return None
        before = written_photographs(self.database.db)
        if before is None:
            refuse_existing(self.database.db)
        return before

    def _refuse_loss(self, before: set[str] | None, names: Collection[str]) -> None:
        """Refuse to write these photographs alone where views of others are there."""
        if lost := sorted((before or set()).difference(names)):
            views = f"{plural(len(lost), 'photograph')} ({', '.join(lost[:3])})"
            raise OutputError(
                f"{self.database.db}: holds the views of {views}, which this call does not write again; name "
                "all that it holds, from the same folder, or choose another --db"
            )


def views_one(setup: Setup, job: LinkJob, *, project: Path | None, skip_movers: bool) -> Outcome:
    """Return the record of one photograph, and its views."""
    plan, lens = job.plan, setup.common.lens

    def camera_of(path: Path, size: tuple[int, int], exif: ExifValues) -> Camera | None:
        stated = lens.intrinsics().of(path, size, exif)
        if plan is None or project is None:
            return stated
        return _project_camera(plan, project, path, size, stated, hint=not lens.stated)

    one = setup.estimated(job, as_stored=True, camera_of=camera_of)  # COLMAP turns no picture upright
    if plan is None:
        views = views_of(job.name, one.estimate)
    else:
        moving = None
        if skip_movers:
            moving = segment(one.estimate, one.image).labels == MotionLabel.MOVING
        views = keypoint_views(
            job.name, plan.keypoints, one.estimate, setup.common.estimating.options(), moving
        )
    record = setup.record(one, job)
    return Outcome(photograph=record, besides={"views": views}, warnings=one.warnings)


def _project_camera(
    plan: ProjectImage, project: Path, path: Path, size: tuple[int, int], stated: Camera | None, *, hint: bool
) -> Camera | None:
    """Return the intrinsics of the options; else the project's, as a hint; else those of EXIF."""
    own = camera_of_database(project, plan.camera_id)
    if (own.width, own.height) != size:
        raise CameraError(
            f"{path}: is of {size[0]}x{size[1]} pixels, in {project} of {own.width}x{own.height}"
            "; give the photograph that the features are from"
        )
    return replace(own, log_focal_sigma=EXIF_LOG_FOCAL) if plan.prior_focal and hint else stated


def named_jobs(
    jobs: Sequence[Job], project: Path | None, *, replace_views: bool = False
) -> tuple[list[LinkJob], list[LinkJob]]:
    """Return the jobs, those that cannot be stored refused, and those whose views are there already.

    ``project`` is the database of a user that they are linked to, if so.
    """
    begun: list[LinkJob] = []
    kept: list[LinkJob] = []
    plans: Sequence[ProjectImage | DatabaseError | None] = [None] * len(jobs)
    if project is not None:
        paths = [Path(str(job.source)) for job in jobs]
        plans = plan_links(project, paths, replace=replace_views)
    for job, plan in zip(jobs, plans, strict=True):
        if plan is None and not storable(job.name):
            plan = DatabaseError(f"{job.source}: its name is no UTF-8, which a database needs; rename it")
        name, refusal = job.name, job.refusal
        if isinstance(plan, DatabaseError):
            refusal, plan = refusal or plan, None
        elif plan is not None:
            name = plan.name
        linked = LinkJob(index=len(begun), source=job.source, name=name, refusal=refusal, plan=plan)
        (kept if plan is not None and plan.step is Step.KEEP else begun).append(linked)
    return begun, kept


def views_record(job: LinkJob, views: ExposureViews) -> dict[str, Any]:
    """Return what is said of a photograph's views, in JSON's types."""
    geometry, plan, count = views.geometry, job.plan, len(matched(views))
    unsure = plan is not None and not count and not (geometry.F is None and geometry.H is None)
    return {
        "image": str(job.source),
        "name": views.name,
        "config": geometry.config.name,
        "parallax": str(geometry.parallax),
        "reason": "no feature of yours has a smear that can be used" if unsure else geometry.reason,
        "views": list(views.names),
        "action": (Step.ADD if plan is None else plan.step).value,
        "num_keypoints": len(views.points_open),
        "num_matches": count,
        "num_inliers": int(geometry.inlier_mask.sum()) if count else 0,
        "translation_known": translation_known(geometry),
        "time_known": views.time.known,
        "time_confidence": views.time.confidence,
    }


def with_time(
    views: list[ExposureViews], sources: Mapping[str, Source], project: Path | None, *, in_order: bool | None
) -> list[ExposureViews]:
    """Return the views with the direction of time that neighbouring frames decide.

    ``sources`` are by name; neighbours are those ``in_order`` or, where that is None, those whose names say
    so, which in a project are also photographs that are not linked.
    """
    if in_order is False:
        return views
    names = [one.name for one in views]
    matcher: Callable[[int, int], Any]
    if project is None:
        matcher = photograph_matcher([sources[name] for name in names])
    else:
        if views and not in_order:
            names += sorted(set(database_names(project)) - set(names))
        matcher = database_matcher(project, names)
    return with_time_direction(views, consecutive_runs(names, in_order=bool(in_order)), matcher)


def views_line(one: Mapping[str, Any], *, linked: bool, verbose: bool) -> str:
    """Return the line of a photograph."""
    name = printable(one["name"])
    if not one["num_matches"]:
        return f"{name}: {one['action']}, no matches: {one['reason']} [{one['config']}]"
    moved, counts = "translation undecided", f"{one['num_inliers']} of {one['num_matches']} matches fit"
    if one["translation_known"]:
        moved = "parallax proven" if one["parallax"] == Parallax.PROVEN else "translation known"
    elif not linked:
        counts = f"{one['num_matches']} matches, none of them an inlier"
    sure = int(100 * one["time_confidence"])
    order = f"known by neighbours ({sure} % sure)" if one["time_known"] else "unknown"
    line = f"{name}: {one['action']}, {moved}; {counts}; order in time {order} [{one['config']}]"
    return f"{line}\n  {one['reason']}" if verbose else line
