"""The photographs of ``blur2view to-colmap``: their names and plans, their order in time, their lines."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from blur2view.cli.terminal import printable
from blur2view.colmap.database import matched, translation_known
from blur2view.colmap.link import ProjectImage, Step, plan_links
from blur2view.colmap.project import database_matcher, database_names, storable
from blur2view.errors import DatabaseError
from blur2view.exposure.features import photograph_matcher
from blur2view.exposure.time_direction import consecutive_runs, with_time_direction
from blur2view.exposure.views import ExposureViews
from blur2view.geometry.two_view_geometry import Parallax
from blur2view.images.source import Source
from blur2view.runs.jobs import Job

NO_GEOMETRY = ("DEGENERATE", "UNDEFINED")  # configurations with neither F nor H


@dataclass(frozen=True, kw_only=True, eq=False)
class LinkJob(Job):
    """A photograph with what linking will do with it in a project, if it is to be linked."""

    plan: ProjectImage | None = None


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
    unsure = plan is not None and not count and geometry.config.name not in NO_GEOMETRY
    return {
        "image": str(job.source),
        "name": views.name,
        "config": geometry.config.name,
        "parallax": str(geometry.parallax),
        "reason": "no feature of yours has a smear that can be used" if unsure else geometry.reason,
        "views": list(views.names),
        "action": "add" if plan is None else plan.step.value,
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
