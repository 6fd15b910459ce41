"""The command ``blur2view to-colmap``: blurred photographs as images that COLMAP can use."""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from blur2view.camera.camera import Camera
from blur2view.camera.exif import read_exif
from blur2view.camera.image import read_image
from blur2view.camera.intrinsics import EXIF_LOG_FOCAL
from blur2view.cli.options import add_estimator_options, complain, progress, read_run
from blur2view.colmap.database import inliers, matched, refuse_existing, write_database
from blur2view.colmap.database_matches import DatabaseMatcher, database_names
from blur2view.colmap.hloc_files import write_hloc
from blur2view.colmap.link import LinkJob, LinkStep, Step, plan_links, write_links
from blur2view.colmap.project import storable
from blur2view.colmap.text_formats import write_matches_text
from blur2view.errors import Blur2ViewError, CameraError, DatabaseError
from blur2view.exposure.linked_views import KeypointViews, keypoint_views
from blur2view.exposure.neighbours import PhotographMatcher
from blur2view.exposure.time_direction import consecutive_runs, with_time_direction
from blur2view.exposure.views import ExposureViews, views_of
from blur2view.networks.smear_network import SmearNetwork
from blur2view.pipeline import Run, estimate

DONE, FAILED = 0, 1
DATABASE, MATCHES, HLOC = "database", "matches", "hloc"


@dataclass(frozen=True, kw_only=True, eq=False)
class Subject:
    """One photograph of a call: its path, the name it gets or has, and its plan if it is linked."""

    path: Path
    name: str
    plan: LinkStep | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Made:
    """A photograph's views; linked ones are its features moved, and ``usable`` says which."""

    subject: Subject
    views: ExposureViews
    usable: np.ndarray | None = None

    @property
    def job(self) -> LinkJob:
        """What `write_links` takes."""
        if self.subject.plan is None or self.usable is None:
            raise ValueError(f"{self.subject.name} is not linked")
        return LinkJob(plan=self.subject.plan, linked=KeypointViews(views=self.views, usable=self.usable))

    def facts(self) -> dict[str, Any]:
        """Plain JSON of what is written of it."""
        views = self.views
        count = int(self.usable.sum()) if self.usable is not None else len(matched(views))
        return {
            "image": str(self.subject.path),
            "name": views.name,
            "views": list(views.names),
            "action": "add" if self.subject.plan is None else self.subject.plan.step.value,
            "config": views.geometry.config.name,
            "reason": views.geometry.reason,
            "num_keypoints": len(views.points_open),
            "num_matches": count,
            "num_inliers": int(len(inliers(views))),
            "time_known": views.time.known,
            "time_confidence": views.time.confidence,
        }


def add_to_colmap(commands: Any) -> None:
    """Describe ``blur2view to-colmap``."""
    about = "write each photograph as two virtual images, at shutter-open and shutter-close, for COLMAP"
    parser = commands.add_parser("to-colmap", help=about, description=about)
    add = parser.add_argument
    add("images", nargs="+", type=Path, metavar="IMG", help="photographs: JPEG, PNG, TIFF, ...")
    add("--db", type=Path, metavar="DB", help="the database: a new one, or with --link yours")
    add("--link", action="store_true", help="add to a database that holds the photographs and their features")
    add("--replace", action="store_true", help="with --link: write anew what an earlier call has written")
    add(
        "--no-backup",
        action="store_true",
        help="with --link: do not copy the database to DB.<time>.bak first",
    )
    add("--dry-run", action="store_true", help="estimate, say what would be written, and write nothing")
    add(
        "--corrected",
        action="store_true",
        help="move the ends of the inliers onto their epipolar lines, so that COLMAP's adjustment stays at "
        "the pose that was estimated; not with --link",
    )
    add("--skip-degenerate", action="store_true", help="leave out photographs without F")
    add(
        "--sequence",
        action=argparse.BooleanOptionalAction,
        help="the photographs are a video in this order, so that neighbours tell open from close; with "
        "--no-sequence nothing is concluded from neighbours (default: from those whose names differ by one "
        "in their number)",
    )
    add(
        "--format",
        choices=(DATABASE, MATCHES, HLOC),
        default=DATABASE,
        help="instead of a database write into -o: text for COLMAP's matches_importer, or hloc's HDF5 files "
        "(default: %(default)s)",
    )
    add("-o", "--output", type=Path, metavar="DIR", help="where --format matches and hloc write")
    add("--json", action="store_true", help="print one JSON document instead of the summary")
    add_estimator_options(parser)
    parser.set_defaults(run=lambda options: run_to_colmap(options, parser.error))


def run_to_colmap(options: argparse.Namespace, usage_error: Callable[[str], object]) -> int:
    """Estimate every photograph and write all of them at once; a failing one costs a line on stderr."""
    run = read_run(options, usage_error)
    _check_usage(options, usage_error)
    subjects, failures = _subjects(options)
    made = _make(options, run, [subject for subject in subjects if not _kept(subject)], failures)
    made = _with_time(options, made)
    if options.corrected:
        made = [replace(one, views=one.views.corrected()) for one in made]
    skipped = [one for one in made if options.skip_degenerate and one.views.geometry.F is None]
    written = [one for one in made if one not in skipped]
    backup = None if options.dry_run else _write(options, written)
    kept = [subject for subject in subjects if _kept(subject)]
    _report(options, written, skipped, kept, failures, backup)
    return FAILED if failures else DONE


def _check_usage(options: argparse.Namespace, usage_error: Callable[[str], object]) -> None:
    """Refuse options that do not go together."""
    if not options.link and (options.replace or options.no_backup):
        usage_error("--replace and --no-backup go with --link")
    if options.link and options.corrected:
        usage_error("--corrected is not for --link, whose views take the place of your features")
    if options.format == DATABASE and (options.db is None or options.output is not None):
        usage_error("name the database with --db; -o goes with --format matches or hloc")
    if options.format != DATABASE and (options.output is None or options.db is not None or options.link):
        usage_error(f"--format {options.format} needs -o DIR, and neither --db nor --link")


def _kept(subject: Subject) -> bool:
    """Whether its views are in the project already and stay as they are."""
    return subject.plan is not None and subject.plan.step is Step.KEEP


def _subjects(options: argparse.Namespace) -> tuple[list[Subject], list[dict[str, str]]]:
    """Name the photographs, and look them up if they are to be linked, before any work."""
    failures: list[dict[str, str]] = []
    plans: Sequence[LinkStep | DatabaseError | None] = [None] * len(options.images)
    if options.link:
        plans = plan_links(options.db, options.images, replace=options.replace)
    elif options.db is not None:
        refuse_existing(options.db)
    subjects: list[Subject] = []
    for path, name, plan in zip(options.images, fresh_names(options.images), plans, strict=True):
        if plan is None and any(subject.name == name for subject in subjects):
            plan = DatabaseError(f"{path}: is named twice; name it once")
        if plan is None and not storable(name):
            plan = DatabaseError(f"{path}: its name is no UTF-8, which a database needs; rename it")
        if isinstance(plan, DatabaseError):
            _fail(failures, path, plan)
        else:
            subjects.append(Subject(path=path, name=plan.image.name if plan else name, plan=plan))
    return subjects, failures


def fresh_names(paths: Sequence[Path]) -> list[str]:
    """Name photographs by their paths below the folder that all of them share, with slashes."""
    absolute = [os.path.abspath(path) for path in paths]
    folder = os.path.commonpath([os.path.dirname(path) for path in absolute])
    return [Path(os.path.relpath(path, folder)).as_posix() for path in absolute]


def _make(
    options: argparse.Namespace, run: Run, subjects: list[Subject], failures: list[dict[str, str]]
) -> list[Made]:
    """Estimate the photographs; only their views are kept, as fields are large."""
    if not subjects:
        return []
    network = SmearNetwork(options.model)
    jobs, say = progress(subjects)
    made: list[Made] = []
    for subject in jobs:
        try:
            made.append(_make_one(options.db, subject, network, run))
        except Blur2ViewError as error:
            _fail(failures, subject.path, error, say)
    return made


def _make_one(database: Path | None, subject: Subject, network: SmearNetwork, run: Run) -> Made:
    """Read and estimate one photograph."""
    image = read_image(subject.path, as_stored=True)  # COLMAP does not turn pictures upright
    size = (image.shape[1], image.shape[0])
    camera = _camera(database, subject, run, size)
    rng = np.random.default_rng(run.seed)
    found = estimate(image, network=network, select=run.select, options=run.options, rng=rng, camera=camera)
    if subject.plan is None:
        return Made(subject=subject, views=views_of(subject.name, found))
    linked = keypoint_views(subject.name, subject.plan.image.keypoints, found, run.options)
    return Made(subject=subject, views=linked.views, usable=linked.usable)


def _camera(database: Path | None, subject: Subject, run: Run, size: tuple[int, int]) -> Camera | None:
    """Intrinsics: what the user says; else what the project has, as a hint; else what EXIF says."""
    said = run.intrinsics.of(subject.path, size, read_exif(subject.path))
    if subject.plan is None or database is None:
        return said
    image = subject.plan.image
    own = Camera.from_database(database, image.camera_id)
    if (own.width, own.height) != size:
        raise CameraError(
            f"{subject.path}: is of {size[0]}x{size[1]} pixels, in {database} of {own.width}x{own.height}; "
            "give the photograph that the features are from"
        )
    asked = run.intrinsics.focal_px is not None or run.intrinsics.camera is not None
    return replace(own, log_focal_sigma=EXIF_LOG_FOCAL) if image.prior_focal and not asked else said


def _with_time(options: argparse.Namespace, made: list[Made]) -> list[Made]:
    """Let neighbouring frames decide which end came first."""
    if options.sequence is False:
        return made
    names = [one.subject.name for one in made]
    if options.link and made and not options.sequence:  # photographs that are not linked have a vote too
        names += sorted(set(database_names(options.db)) - set(names))
    runs = consecutive_runs(names, in_order=bool(options.sequence))
    matcher: Callable[[int, int], Any]
    if options.link:
        matcher = DatabaseMatcher(options.db, names)
    else:
        matcher = PhotographMatcher([one.subject.path for one in made])
    views = with_time_direction([one.views for one in made], runs, matcher)
    return [replace(one, views=turned) for one, turned in zip(made, views, strict=True)]


def _write(options: argparse.Namespace, made: Sequence[Made]) -> Path | None:
    """Write everything at once; return the backup."""
    if options.link:
        return write_links(options.db, [one.job for one in made], backup=not options.no_backup)
    views = [one.views for one in made]
    if options.format == MATCHES:
        write_matches_text(options.output, views, [one.subject.path for one in made])
    elif options.format == HLOC:
        write_hloc(options.output, views)
    elif made:
        write_database(options.db, views)
    return None


def _report(
    options: argparse.Namespace,
    written: Sequence[Made],
    skipped: Sequence[Made],
    kept: Sequence[Subject],
    failures: list[dict[str, str]],
    backup: Path | None,
) -> None:
    """Print what was written, or would be."""
    if options.json:
        document = {
            "format": options.format,
            "target": str(options.db or options.output),
            "dry_run": options.dry_run,
            "backup": None if backup is None else str(backup),
            "photographs": [one.facts() for one in written],
            "skipped": [one.facts() | {"action": "skip"} for one in skipped],
            "kept": [{"image": str(one.path), "name": one.name} for one in kept],
            "failures": failures,
        }
        print(json.dumps(document, indent=2, allow_nan=False))
        return
    for one in written:
        print(_line(one))
    for one in skipped:
        print(f"{one.views.name}: {one.views.geometry.config.name}, skipped: {one.views.geometry.reason}")
    for subject in kept:
        print(f"{subject.name}: has its views already")
    if not written:
        print(f"{options.db or options.output}: nothing to write")
        return
    verb = "would write" if options.dry_run else "wrote"
    pairs = len(written) * (3 if options.link else 1)
    counts = f"{2 * len(written)} images and {pairs} pairs of {len(written)} photographs"
    print(f"{options.db or options.output}: {verb} {counts}" + (f"; backup {backup}" if backup else ""))


def _line(one: Made) -> str:
    """Say in one line what is written of a photograph."""
    facts = one.facts()
    time = f"open first ({facts['time_confidence']:.0%})" if facts["time_known"] else "open or close first"
    counts = f"{facts['num_inliers']} inliers of {facts['num_matches']} matches"
    line = f"{facts['name']}: {facts['action']} {facts['config']}, {counts}, {time}"
    return line if one.views.geometry.F is not None else f"{line}: {facts['reason']}"


def _fail(
    failures: list[dict[str, str]], path: Path, error: Blur2ViewError, say: Callable[..., None] = print
) -> None:
    """Note a failure and print its line."""
    failures.append({"image": str(path), "error": str(error)})
    complain(error, say)
