"""The photographs of ``blur2view to-colmap``: their names, their plans if they are linked, their views."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from blur2view.camera.camera import Camera
from blur2view.camera.exif import ExifValues
from blur2view.camera.intrinsics import EXIF_LOG_FOCAL
from blur2view.cli.arguments.to_colmap import ToColmapOptions
from blur2view.cli.summary import verdict_line
from blur2view.cli.work import estimated, outcome_of
from blur2view.colmap.cameras import camera_of_database
from blur2view.colmap.database import matched, translation_known
from blur2view.colmap.link import plan_links
from blur2view.colmap.project import ProjectImage, Step, database_matcher, database_names, storable
from blur2view.errors import CameraError, DatabaseError
from blur2view.exposure.neighbours import photograph_matcher
from blur2view.exposure.time_direction import consecutive_runs, with_time_direction
from blur2view.exposure.views import ExposureViews, keypoint_views, views_of
from blur2view.photographs.inputs import colmap_names
from blur2view.results.stored import plain
from blur2view.results.table import NO_GEOMETRY
from blur2view.results.to_colmap import ViewsDocument
from blur2view.results.verdicts import verdict_of
from blur2view.runs.job import Job, Outcome
from blur2view.segmentation.mask import MotionLabel, segment


@dataclass(frozen=True, kw_only=True, eq=False)
class Named:
    """What a photograph is called in the database, and its plan if it is linked."""

    name: str
    plan: ProjectImage | None = None


def named_jobs(options: ToColmapOptions) -> tuple[list[Job], list[Job]]:
    """Return the jobs, those that cannot be stored refused, and those whose views are there already."""
    jobs: list[Job] = []
    kept: list[Job] = []
    paths, names = options.inputs.paths, colmap_names(options.inputs)
    plans: Sequence[ProjectImage | DatabaseError | None] = [None] * len(paths)
    if options.link:
        plans = plan_links(options.db, paths, replace=options.replace)
    for path, plan in zip(paths, plans, strict=True):
        if plan is None and not storable(names[path]):
            plan = DatabaseError(f"{path}: its name is no UTF-8, which a database needs; rename it")
        if isinstance(plan, DatabaseError):
            jobs.append(Job(index=len(jobs), path=path, target=Named(name=names[path]), refusal=plan))
            continue
        name, source = names[path], names[path]
        if plan is not None:  # views depend on the features that are moved, too
            name, source = plan.name, f"{plan.name} {plan.digest.hex()}"
        job = Job(index=len(jobs), path=path, target=Named(name=name, plan=plan), source=source)
        (kept if plan is not None and plan.step is Step.KEEP else jobs).append(job)
    return jobs, kept


def document_of(job: Job, views: ExposureViews) -> ViewsDocument:
    """Return the document of a photograph's views."""
    geometry, plan, count = views.geometry, job.target.plan, len(matched(views))
    unsure = plan is not None and not count and geometry.config.name not in NO_GEOMETRY
    return ViewsDocument(
        image=str(job.path),
        name=views.name,
        views=views.names,
        action="add" if plan is None else plan.step.value,
        config=geometry.config.name,
        parallax=str(geometry.parallax),
        reason="no feature of yours has a smear that can be used" if unsure else geometry.reason,
        num_keypoints=len(views.points_open),
        num_matches=count,
        num_inliers=int(geometry.inlier_mask.sum()) if count else 0,
        translation_known=translation_known(geometry),
        time_known=views.time.known,
        time_confidence=views.time.confidence,
    )


def views_outcome(options: ToColmapOptions, job: Job) -> Outcome:
    """Return the views of one photograph in JSON's types; its field, which is large, is not kept."""
    name, plan = job.target.name, job.target.plan
    # COLMAP does not turn pictures upright
    one = estimated(options, job, as_stored=True, camera_of=partial(_camera, options, plan))
    if plan is None:
        views = views_of(name, one.estimate)
    else:
        moving = None
        if options.skip_movers:
            moving = segment(one.estimate, one.image).labels == MotionLabel.MOVING
        views = keypoint_views(name, plan.keypoints, one.estimate, options.run.options, moving)
    return outcome_of(one, plain(views), verdict_line(name, verdict_of(one), one.estimate.geometry))


def _camera(
    options: ToColmapOptions, plan: ProjectImage | None, path: Path, size: tuple[int, int], exif: ExifValues
) -> Camera | None:
    """Return the intrinsics: those of the options; else the project's, as a hint; else those of EXIF."""
    stated = options.run.intrinsics.of(path, size, exif)
    if plan is None:
        return stated
    own = camera_of_database(options.db, plan.camera_id)
    if (own.width, own.height) != size:
        raise CameraError(
            f"{path}: is of {size[0]}x{size[1]} pixels, in {options.db} of {own.width}x{own.height}"
            "; give the photograph that the features are from"
        )
    hinted = plan.prior_focal and options.focal is None and options.camera is None
    return replace(own, log_focal_sigma=EXIF_LOG_FOCAL) if hinted else stated


def with_time(
    options: ToColmapOptions, views: list[ExposureViews], paths: Mapping[str, Path]
) -> list[ExposureViews]:
    """Return the views with the direction of time that neighbouring frames decide; ``paths`` are by name."""
    if options.in_order is False:
        return views
    names = [one.name for one in views]
    if options.link and views and not options.in_order:  # photographs that are not linked have a vote too
        names += sorted(set(database_names(options.db)) - set(names))
    runs = consecutive_runs(names, in_order=bool(options.in_order))
    matcher: Callable[[int, int], Any]
    if options.link:
        matcher = database_matcher(options.db, names)
    else:
        matcher = photograph_matcher([paths[name] for name in names])
    return with_time_direction(views, runs, matcher)
