"""The command ``blur2view to-colmap``: blurred photographs as images that COLMAP can use."""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from blur2view.cli.batch import CommandRun, manifest_beside
from blur2view.cli.network import CommandNetwork
from blur2view.cli.options import read_run
from blur2view.cli.terminal import QUIET, SHORT, plural, printable
from blur2view.cli.views import (
    KeptViews,
    NamedPhotograph,
    PhotographViews,
    ViewsWork,
    make_views,
    name_photographs,
    with_time,
)
from blur2view.colmap import hloc_files, text_formats
from blur2view.colmap.database import (
    refuse_changed,
    refuse_existing,
    stored_photographs,
    write_database,
)
from blur2view.colmap.link import write_links
from blur2view.documents.document import FailureDocument
from blur2view.documents.to_colmap import (
    DATABASE,
    HLOC,
    MATCHES,
    KeptDocument,
    ToColmapDocument,
    ViewsDocument,
)
from blur2view.errors import DatabaseError, OutputError
from blur2view.exposure.views import OPEN
from blur2view.input_files import read_regular
from blur2view.output_files import prepare_folder, remove_empty

FAILED = 1
SQLITE_FILES = ("-journal", "-wal", "-shm")  # beside a database that is written


def run_to_colmap(options: argparse.Namespace, usage_error: Callable[[str], object]) -> int:
    """Return the exit code, after estimating every photograph and writing all of them at once.

    An interrupted run writes what is done, but nothing into a project of the user's.
    """
    run = read_run(options, usage_error)
    _check_usage(options, usage_error)
    if options.sequence is None and options.inputs.one_video:
        options.sequence = True
    network = CommandNetwork.of(options.model)
    work = ViewsWork(database=options.db, run=run, network=network)
    batch: CommandRun[NamedPhotograph, KeptViews] = CommandRun(
        options, work, _manifest(options), files=_written(options), prints=False
    )
    fresh = options.db is not None and not options.link
    replaces = fresh and batch.replaces(options.db)
    if fresh and not options.resume and batch.manifest is not None and batch.manifest.wrote(options.db):
        raise DatabaseError(
            f"{options.db}: is of an earlier call; add --resume to go on, or choose another --db"
        )
    if fresh and not replaces and batch.manifest is not None and batch.manifest.has_target(options.db):
        refuse_changed(options.db)
    if fresh and not replaces:
        refuse_existing(options.db)
    if options.output is not None:
        (hloc_files if options.format == HLOC else text_formats).refuse_foreign(options.output)
    created = [] if options.output is None or options.dry_run else prepare_folder(options.output)
    photographs, failures = name_photographs(options)
    before = written_before(options) if options.resume else set()
    _refuse_loss(options, before - {photograph.name for photograph in photographs})
    batch.names |= {photograph.path: photograph.name for photograph in photographs}
    made: list[PhotographViews] = []
    if wanted := [photograph for photograph in photographs if not photograph.kept]:
        made, failed = make_views(batch, wanted)
        failures += failed
    skips = options.skip_degenerate
    lost = before - {one.photograph.name for one in made if one.views.geometry.F is not None or not skips}
    if batch.broken or (batch.interrupted and (options.link or not made or lost)):
        remove_empty(created)
        return batch.exit_code
    _refuse_loss(options, lost)
    made = with_time(options, made)
    if options.corrected:
        made = [replace(one, views=one.views.corrected()) for one in made]
    kept = [_kept(one) for one in photographs if one.kept]
    document = _write_document(options, made, kept, failures, replaces)
    if fresh and document.photographs and not options.dry_run and batch.manifest is not None:
        batch.manifest.append_target(options.db)
    remove_empty(created)
    if options.json:
        print(document.to_json())
    elif options.verbosity > QUIET:
        print(summary(document, linked=options.link, verbosity=options.verbosity))
    return FAILED if failures and not batch.interrupted else batch.exit_code


def _written(options: argparse.Namespace) -> list[Path]:
    """Return what is written besides the manifest and the files of single photographs."""
    if options.format == DATABASE:
        return [Path(f"{options.db}{end}") for end in SQLITE_FILES]
    names = hloc_files.NAMES if options.format == HLOC else text_formats.NAMES
    return [options.output / name for name in names]


def _manifest(options: argparse.Namespace) -> Path | None:
    """Return where is written down what is done; nowhere if nothing is to be written."""
    if options.dry_run:
        return None
    return manifest_beside(options.db if options.output is None else options.output / options.command)


def _check_usage(options: argparse.Namespace, usage_error: Callable[[str], object]) -> None:
    """Refuse options that do not go together."""
    if not options.link and (options.replace or options.no_backup):
        usage_error("--replace and --no-backup go with --link")
    if options.link and options.dask is not None:
        usage_error("--link goes without --dask, whose workers see no database")
    if options.link and options.corrected:
        usage_error("--corrected is not for --link, whose views take the place of your features")
    if options.format == DATABASE and options.output is not None:
        usage_error("-o goes with --format matches or hloc; a database is named with --db alone")
    if options.format == DATABASE and options.db is None:
        usage_error("name the database with --db")
    if options.format != DATABASE and (options.output is None or options.db is not None or options.link):
        usage_error(f"--format {options.format} needs -o DIR, and neither --db nor --link")


def _write_document(
    options: argparse.Namespace,
    made: Sequence[PhotographViews],
    kept: list[KeptDocument],
    failures: list[FailureDocument],
    replaces: bool,
) -> ToColmapDocument:
    """Return the document of the call, after writing what is not skipped."""
    skipped = [one for one in made if options.skip_degenerate and one.views.geometry.F is None]
    written = [one for one in made if one not in skipped]
    backup = None if options.dry_run else _write(options, written, replaces)
    return ToColmapDocument(
        format=options.format,
        target=str(options.db or options.output),
        dry_run=options.dry_run,
        backup=None if backup is None else str(backup),
        photographs=[one.document() for one in written],
        skipped=[one.document("skip") for one in skipped],
        kept=kept,
        failures=failures,
    )


def written_before(options: argparse.Namespace) -> set[str]:
    """Return the photographs whose views an earlier call has written, which this one would write anew."""
    if options.link or options.dry_run:
        return set()
    if options.format == DATABASE:
        return stored_photographs(options.db) if options.db.exists() else set()
    path = options.output / (hloc_files.NAMES[-1] if options.format == HLOC else text_formats.NAMES[0])
    words = read_regular(path).decode("utf-8", "replace").split() if path.exists() else []
    return {word.removesuffix(OPEN) for word in words if word.endswith(OPEN)}


def _refuse_loss(options: argparse.Namespace, lost: set[str]) -> None:
    """Refuse to write without photographs whose views are there."""
    if lost:
        told = f"{plural(len(lost), 'photograph')} ({', '.join(sorted(lost)[:3])})"
        target, option = (options.output, "-o") if options.db is None else (options.db, "--db")
        raise OutputError(
            f"{target}: the views of {told} would be lost, as this call names them otherwise (from the "
            f"folder that all share), or not, or skips them; name all as before, or choose another {option}"
        )


def _kept(photograph: NamedPhotograph) -> KeptDocument:
    """Return the document of a photograph whose views stay as they are."""
    return KeptDocument(image=str(photograph.path), name=photograph.name)


def _write(options: argparse.Namespace, made: Sequence[PhotographViews], replaces: bool) -> Path | None:
    """Return the backup, if there is one, after writing everything at once."""
    if options.link:
        return write_links(options.db, [one.job for one in made], backup=not options.no_backup)
    views = [one.views for one in made]
    if options.format == MATCHES:
        text_formats.write_matches_text(options.output, views, [one.photograph.path for one in made])
    elif options.format == HLOC:
        hloc_files.write_hloc(options.output, views)
    elif made:
        write_database(options.db, views, replace=replaces)
    return None


def summary(document: ToColmapDocument, *, linked: bool, verbosity: int = SHORT) -> str:
    """Return a line for each photograph, and one that says what was written or would be."""
    lines = [_line(one, verbosity) for one in document.photographs]
    lines += [f"{printable(one.name)}: {one.config}, skipped: {one.reason}" for one in document.skipped]
    there = "has its views already; --replace makes them anew"
    lines += [f"{printable(one.name)}: {there}" for one in document.kept]
    target, count = printable(document.target), len(document.photographs)
    if not count:
        return "\n".join([*lines, f"{target}: nothing to write"])
    verb = "would write" if document.dry_run else "wrote"
    pairs = plural(count * (3 if linked else 1), "pair")
    total = f"{target}: {verb} {plural(2 * count, 'image')} and {pairs} of {plural(count, 'photograph')}"
    return "\n".join([*lines, total + (f"; backup {printable(document.backup)}" if document.backup else "")])


def _line(one: ViewsDocument, verbosity: int) -> str:
    """Return one line about a photograph that is written, with its reason if there is no match or -v."""
    name = printable(one.name)
    if not one.num_matches:
        return f"{name}: {one.action} {one.config}, no matches: {one.reason}"
    time = f"open first (confidence {one.time_confidence:.0%})" if one.time_known else "open or close first"
    counts = f"{one.num_inliers} inliers of {one.num_matches} matches"
    line = f"{name}: {one.action} {one.config}, parallax {one.parallax}, {counts}, {time}"
    return f"{line}\n  {one.reason}" if verbosity > SHORT else line
