"""The command ``blur2view to-colmap``: blurred photographs as images that COLMAP can use."""

from collections.abc import Collection
from pathlib import Path

from blur2view.cli.arguments.to_colmap import ToColmapOptions
from blur2view.cli.run import End, manifest_of, open_manifest, run_over
from blur2view.cli.terminal import QUIET, SHORT, plural, printable
from blur2view.cli.views import document_of, named_jobs, with_time
from blur2view.colmap.connection import BESIDE
from blur2view.colmap.database import holds_views_alone, refuse_existing, stored_photographs, write_database
from blur2view.colmap.link import write_links
from blur2view.errors import OutputError
from blur2view.exposure.views import ExposureViews
from blur2view.geometry.two_view_geometry import Parallax
from blur2view.results.stored import restore
from blur2view.results.to_colmap import ToColmapDocument, ViewsDocument


def run(options: ToColmapOptions) -> int:
    """Return the exit code, after estimating every photograph and writing all of them at once.

    An interrupted run writes what is done, but nothing into a project of the user's.
    """
    jobs, kept = named_jobs(options)
    path = None if options.dry_run else manifest_of(options, options.db)
    files = [options.db, *(Path(f"{options.db}{end}") for end in BESIDE)]
    with open_manifest(options, path, files) as manifest:
        before = _written_before(options)
        of_name = {job.target.name: job for job in jobs if job.refusal is None}
        _refuse_loss(options, before, of_name.keys())
        names = {job.path: job.target.name for job in jobs}
        finished = run_over(options, jobs, manifest, names=names)
        views = [restore(ExposureViews, one.payload) for _, one in finished.outcomes if not one.error]
        written = {one.name for one in views}
        interrupted = finished.end is End.INTERRUPTED
        incomplete = options.link or not views or (before or set()) - written
        if finished.end is End.BROKEN or (interrupted and incomplete):
            return finished.exit_code
        _refuse_loss(options, before, written)
        views = with_time(options, views, {name: one.path for name, one in of_name.items()})
        backup = None
        if options.link and not options.dry_run:
            planned = [(of_name[one.name].target.plan, one) for one in views]
            links = [(plan, one) for plan, one in planned if plan is not None]
            backup = write_links(options.db, links, backup=options.backup)
        elif views and not options.dry_run:
            write_database(options.db, views, replace=before is not None)
    document = ToColmapDocument(
        target=str(options.db),
        dry_run=options.dry_run,
        backup=None if backup is None else str(backup),
        photographs=[document_of(of_name[one.name], one) for one in views],
        kept=[{"image": str(job.path), "name": job.target.name} for job in kept],
        failures=finished.failures,
    )
    if options.json:
        print(document.to_json())
    elif options.verbosity > QUIET:
        print(summary(document, linked=options.link, verbosity=options.verbosity))
    return finished.exit_code


def _written_before(options: ToColmapOptions) -> set[str] | None:
    """Return the photographs whose views an earlier call has written, which this one writes anew.

    None if no database of views alone is replaced; DatabaseError of another one that is there.
    """
    ours = not options.link and options.db.is_file() and holds_views_alone(options.db)
    if not ours and not options.link:
        refuse_existing(options.db)
    return stored_photographs(options.db) if ours and not options.dry_run else None


def _refuse_loss(options: ToColmapOptions, before: set[str] | None, names: Collection[str]) -> None:
    """Refuse to write these photographs alone where views of others are there."""
    lost = sorted((before or set()).difference(names))
    if lost:
        views = f"{plural(len(lost), 'photograph')} ({', '.join(lost[:3])})"
        raise OutputError(
            f"{options.db}: the views of {views} would be lost, as this call names them otherwise (from "
            "the folder that all share), or not, or cannot read them; name all as before, or choose another "
            "--db"
        )


def summary(document: ToColmapDocument, *, linked: bool, verbosity: int = SHORT) -> str:
    """Return a line for each photograph, and one that says what was written or would be."""
    lines = [_line(one, verbosity, linked=linked) for one in document.photographs]
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


def _line(one: ViewsDocument, verbosity: int, *, linked: bool) -> str:
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
    return f"{line}\n  {one.reason}" if verbosity > SHORT else line
