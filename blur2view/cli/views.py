"""The photographs of ``blur2view to-colmap``: their names and plans, their order in time, their lines."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from blur2view.cli.terminal import plural, printable
from blur2view.colmap.database import matched, translation_known
from blur2view.colmap.link import ProjectImage, Step, plan_links
from blur2view.colmap.project import database_matcher, database_names, storable
from blur2view.errors import DatabaseError
from blur2view.exposure.features import photograph_matcher
from blur2view.exposure.time_direction import consecutive_runs, with_time_direction
from blur2view.exposure.views import ExposureViews
from blur2view.geometry.two_view_geometry import Parallax
from blur2view.images.inputs import Inputs, colmap_names
from blur2view.results.table import NO_GEOMETRY
from blur2view.results.to_colmap import ToColmapDocument, ViewsDocument
from blur2view.runs.job import Job


def named_jobs(
    inputs: Inputs, project: Path | None, *, replace_views: bool = False
) -> tuple[list[Job], list[Job]]:
    """Return the jobs, those that cannot be stored refused, and those whose views are there already.

    ``project`` is the database of a user that they are linked to, if so.
    """
    jobs: list[Job] = []
    kept: list[Job] = []
    names = colmap_names(inputs)
    plans: Sequence[ProjectImage | DatabaseError | None] = [None] * len(inputs.paths)
    if project is not None:
        plans = plan_links(project, inputs.paths, replace=replace_views)
    for path, plan in zip(inputs.paths, plans, strict=True):
        job = Job(index=len(jobs), path=path, name=names[path], source=names[path])
        if plan is None and not storable(job.name):
            plan = DatabaseError(f"{path}: its name is no UTF-8, which a database needs; rename it")
        if isinstance(plan, ProjectImage):  # views depend on the features that are moved, too
            source = f"{plan.name} {plan.digest.hex()}"
            job = replace(job, name=plan.name, target=plan, source=source)
            (kept if plan.step is Step.KEEP else jobs).append(job)
        else:
            jobs.append(replace(job, refusal=plan))
    return jobs, kept


def document_of(job: Job, views: ExposureViews) -> ViewsDocument:
    """Return the document of a photograph's views."""
    geometry, plan, count = views.geometry, job.target, len(matched(views))
    unsure = plan is not None and not count and geometry.config.name not in NO_GEOMETRY
    return ViewsDocument.gathered(
        geometry,
        views,
        image=str(job.path),
        views=views.names,
        action="add" if plan is None else plan.step.value,
        reason="no feature of yours has a smear that can be used" if unsure else geometry.reason,
        num_keypoints=len(views.points_open),
        num_matches=count,
        num_inliers=int(geometry.inlier_mask.sum()) if count else 0,
        translation_known=translation_known(geometry),
        time_known=views.time.known,
        time_confidence=views.time.confidence,
    )


def with_time(
    views: list[ExposureViews], paths: Mapping[str, Path], project: Path | None, *, in_order: bool | None
) -> list[ExposureViews]:
    """Return the views with the direction of time that neighbouring frames decide.

    ``paths`` are by name; neighbours are those ``in_order`` or, where that is None, those whose names say so,
    which in a project are also photographs that are not linked.
    """
    if in_order is False:
        return views
    names = [one.name for one in views]
    matcher: Callable[[int, int], Any]
    if project is None:
        matcher = photograph_matcher([paths[name] for name in names])
    else:
        if views and not in_order:
            names += sorted(set(database_names(project)) - set(names))
        matcher = database_matcher(project, names)
    return with_time_direction(views, consecutive_runs(names, in_order=bool(in_order)), matcher)


def summary(document: ToColmapDocument, *, linked: bool, verbose: bool = False) -> str:
    """Return a line for each photograph, and one that says what was written or would be."""
    lines = [_line(one, linked=linked, verbose=verbose) for one in document.photographs]
    if document.kept:
        some = ", ".join(printable(one["name"]) for one in document.kept[:3])
        some += ", ..." if len(document.kept) > 3 else ""
        there = plural(len(document.kept), "photograph")
        lines.append(f"{there} ({some}): the views are there already; --replace makes them anew")
    target, count = printable(document.target), len(document.photographs)
    if not count:
        return "\n".join([*lines, f"{target}: nothing to write"])
    verb = "would write" if document.dry_run else "wrote"
    pairs = plural(count * (3 if linked else 1), "pair")
    total = f"{target}: {verb} {plural(2 * count, 'image')} and {pairs} of {plural(count, 'photograph')}"
    total += f"; backup {printable(document.backup)}" if document.backup else ""
    undecided = sum(one.num_matches > 0 and not one.translation_known for one in document.photographs)
    if undecided:
        total += f"; the translation of {undecided} is undecided: "
        total += (
            "the depth of their points comes from your other photographs"
            if linked
            else ("COLMAP makes no points from those")
        )
    return "\n".join([*lines, total])


def _line(one: ViewsDocument, *, linked: bool, verbose: bool) -> str:
    name = printable(one.name)
    if not one.num_matches:
        return f"{name}: {one.action}, no matches: {one.reason} [{one.config}]"
    moved, counts = "translation undecided", f"{one.num_inliers} of {one.num_matches} matches fit"
    if one.translation_known:
        moved = "parallax proven" if one.parallax == Parallax.PROVEN else "translation known"
    elif not linked:
        counts = f"none of {one.num_matches} matches is written as an inlier"
    order = f"known by neighbours ({int(100 * one.time_confidence)} % sure)" if one.time_known else "unknown"
    line = f"{name}: {one.action}, {moved}; {counts}; order in time {order} [{one.config}]"
    return f"{line}\n  {one.reason}" if verbose else line
