"""The photographs of ``blur2view to-colmap``: their names, their plans if they are linked, their views."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from blur2view.batch.job import Job, Made
from blur2view.camera.camera import Camera
from blur2view.camera.exif import ExifFacts, read_exif
from blur2view.camera.image import read_image
from blur2view.camera.intrinsics import EXIF_LOG_FOCAL
from blur2view.cli.batch import CommandRun, colmap_names
from blur2view.cli.network import CommandNetwork
from blur2view.cli.summary import verdict_line
from blur2view.cli.terminal import complain
from blur2view.colmap.cameras import camera_of_database
from blur2view.colmap.database import inliers, matched
from blur2view.colmap.database_matches import DatabaseMatcher, database_names
from blur2view.colmap.link import LinkJob, LinkStep, Step, digest, plan_links
from blur2view.colmap.project import storable
from blur2view.colmap.text_formats import has_blank
from blur2view.documents.document import FailureDocument
from blur2view.documents.table import facts
from blur2view.documents.to_colmap import DATABASE, ViewsDocument
from blur2view.errors import Blur2ViewError, CameraError, DatabaseError, OutputError
from blur2view.exposure.linked_views import KeypointViews, keypoint_views
from blur2view.exposure.neighbours import PhotographMatcher
from blur2view.exposure.time_direction import consecutive_runs, with_time_direction
from blur2view.exposure.views import ExposureViews, views_of
from blur2view.pipeline import Run, contradictions, estimate


@dataclass(frozen=True, kw_only=True, eq=False)
class NamedPhotograph:
    """One photograph of a call: its path, its name in the database, and its plan if it is linked."""

    path: Path
    name: str
    plan: LinkStep | None = None

    @property
    def kept(self) -> bool:
        """Whether its views are in the project already and stay as they are."""
        return self.plan is not None and self.plan.step is Step.KEEP


@dataclass(frozen=True, kw_only=True, eq=False)
class PhotographViews:
    """A photograph's views; linked ones are its features moved, and ``usable`` says which."""

    photograph: NamedPhotograph
    views: ExposureViews
    usable: np.ndarray | None = None

    @property
    def job(self) -> LinkJob:
        """The argument of `write_links`."""
        if self.photograph.plan is None or self.usable is None:
            raise ValueError(f"{self.photograph.name} is not linked")
        linked = KeypointViews(views=self.views, usable=self.usable)
        return LinkJob(plan=self.photograph.plan, linked=linked)

    def document(self, action: str | None = None) -> ViewsDocument:
        """Return the document of the views; by default the action is that of the plan."""
        views, plan = self.views, self.photograph.plan
        return ViewsDocument(
            image=str(self.photograph.path),
            name=views.name,
            views=list(views.names),
            action=action or ("add" if plan is None else plan.step.value),
            config=views.geometry.config.name,
            parallax=str(views.geometry.parallax),
            reason=views.geometry.reason,
            num_keypoints=len(views.points_open),
            num_matches=int(self.usable.sum()) if self.usable is not None else len(matched(views)),
            num_inliers=len(inliers(views)),
            time_known=views.time.known,
            time_confidence=views.time.confidence,
        )


def name_photographs(options: argparse.Namespace) -> tuple[list[NamedPhotograph], list[FailureDocument]]:
    """Return the photographs with their names and plans, and those that cannot be stored, before any work."""
    photographs: list[NamedPhotograph] = []
    failures: list[FailureDocument] = []
    plans: Sequence[LinkStep | DatabaseError | None] = [None] * len(options.images)
    if options.link:
        plans = plan_links(options.db, options.images, replace=options.replace)
    names = colmap_names(options.inputs)
    for path, plan in zip(options.images, plans, strict=True):
        found = refusal(path, names[path], options.format) if plan is None else plan
        if isinstance(found, Blur2ViewError):
            complain(found)
            failures.append(FailureDocument(image=str(path), error=str(found)))
        else:
            name = found.image.name if found else names[path]
            photographs.append(NamedPhotograph(path=path, name=name, plan=found))
    return photographs, failures


def refusal(path: Path, name: str, kind: str) -> Blur2ViewError | None:
    """Return why what is written cannot name a photograph; None if it can."""
    if not storable(name):
        return DatabaseError(f"{path}: its name is no UTF-8, which a database needs; rename it")
    if kind != DATABASE and has_blank(name):
        return OutputError(f"{path}: --format {kind} has no names with a blank; rename it")
    return None


@dataclass(frozen=True, kw_only=True, eq=False)
class KeptViews:
    """A photograph's views as a manifest keeps them."""

    views: ExposureViews
    usable: np.ndarray | None


@dataclass(frozen=True, kw_only=True)
class ViewsWork:
    """The work on one photograph."""

    database: Path | None
    run: Run
    network: CommandNetwork

    def __call__(self, job: Job[NamedPhotograph]) -> Made[KeptViews]:
        """Return the views of one photograph; its field, which is large, is not kept."""
        photograph, run = job.target, self.run
        # COLMAP does not turn pictures upright
        image = read_image(job.path, as_stored=True, max_memory_gib=run.max_memory_gib, content=job.content)
        size = (image.shape[1], image.shape[0])
        exif = read_exif(job.path, job.content)
        camera = _camera(self.database, photograph, run, size, exif)
        rng = np.random.default_rng(run.seed)
        network = self.network.loaded
        result = estimate(
            image, network=network, select=run.select, options=run.options, rng=rng, camera=camera
        )
        if photograph.plan is None:
            kept = KeptViews(views=views_of(photograph.name, result), usable=None)
        else:
            linked = keypoint_views(photograph.name, photograph.plan.image.keypoints, result, run.options)
            kept = KeptViews(views=linked.views, usable=linked.usable)
        said = facts(result, exif.exposure_s, sum(asdict(result.timings).values()))
        summary, warnings = verdict_line(photograph.name, result.geometry), contradictions(run, camera, exif)
        return Made(kept=kept, summary=summary, row=said, warnings=warnings)


def make_views(
    run: CommandRun[NamedPhotograph, KeptViews], photographs: list[NamedPhotograph]
) -> tuple[list[PhotographViews], list[FailureDocument]]:
    """Return the views of the photographs, and those that fail."""
    made: list[PhotographViews] = []
    failures: list[FailureDocument] = []
    sources = [_source(photograph) for photograph in photographs]
    for result in run.results([photograph.path for photograph in photographs], photographs, sources):
        if result.made is None:
            failures.append(FailureDocument(image=str(result.path), error=result.error))
        else:
            kept = result.made.kept
            photograph = photographs[result.index]
            made.append(PhotographViews(photograph=photograph, views=kept.views, usable=kept.usable))
    return made, failures


def _source(photograph: NamedPhotograph) -> str:
    """Return what views depend on besides the picture: their name, and the features that are moved."""
    plan = photograph.plan
    return photograph.name + ("" if plan is None else f" {digest(plan.image).hex()}")


def _camera(
    database: Path | None,
    photograph: NamedPhotograph,
    run: Run,
    size: tuple[int, int],
    exif: ExifFacts,
) -> Camera | None:
    """Return the intrinsics: those of the options; else the project's, as a hint; else those of EXIF."""
    stated = run.intrinsics.of(photograph.path, size, exif)
    if photograph.plan is None or database is None:
        return stated
    image = photograph.plan.image
    own = camera_of_database(database, image.camera_id)
    if (own.width, own.height) != size:
        raise CameraError(
            f"{photograph.path}: is of {size[0]}x{size[1]} pixels, in {database} of {own.width}x{own.height}"
            "; give the photograph that the features are from"
        )
    asked = run.intrinsics.focal_px is not None or run.intrinsics.camera is not None
    return replace(own, log_focal_sigma=EXIF_LOG_FOCAL) if image.prior_focal and not asked else stated


def with_time(options: argparse.Namespace, made: list[PhotographViews]) -> list[PhotographViews]:
    """Return the views with the direction of time that neighbouring frames decide."""
    if options.sequence is False:
        return made
    names = [one.photograph.name for one in made]
    if options.link and made and not options.sequence:  # photographs that are not linked have a vote too
        names += sorted(set(database_names(options.db)) - set(names))
    runs = consecutive_runs(names, in_order=bool(options.sequence))
    matcher: Callable[[int, int], Any]
    if options.link:
        matcher = DatabaseMatcher(options.db, names)
    else:
        matcher = PhotographMatcher([one.photograph.path for one in made])
    views = with_time_direction([one.views for one in made], runs, matcher)
    return [replace(one, views=directed) for one, directed in zip(made, views, strict=True)]
