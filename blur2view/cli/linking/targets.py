"""Where ``blur2view to-colmap`` writes: a fresh database, one of the user's, or a folder of text or HDF5."""

from collections.abc import Sequence
from pathlib import Path

from blur2view.cli.linking.views import PhotographViews
from blur2view.cli.options import ToColmapOptions
from blur2view.cli.run import manifest_beside
from blur2view.colmap import hloc_files, text_formats
from blur2view.colmap.connection import BESIDE
from blur2view.colmap.database import (
    holds_views_alone,
    refuse_existing,
    stored_photographs,
    write_database,
)
from blur2view.colmap.link import write_links
from blur2view.exposure.views import OPEN
from blur2view.input_files import read_regular


def manifest_path(options: ToColmapOptions) -> Path | None:
    """Return where is written down what is done; nowhere if nothing is to be written."""
    if options.dry_run:
        return None
    return manifest_beside(options.target if options.output is None else options.output / options.command)


def written_files(options: ToColmapOptions) -> list[Path]:
    """Return what is written, besides the manifest."""
    if options.output is None:
        return [options.target, *(Path(f"{options.target}{end}") for end in BESIDE)]
    names = hloc_files.NAMES if options.hloc else text_formats.NAMES
    return [options.output, *(options.output / name for name in names)]


def refuse_others(options: ToColmapOptions) -> bool:
    """Refuse before any work what is not ours; return whether a database of an earlier call is replaced."""
    if options.output is not None:
        (hloc_files if options.hloc else text_formats).refuse_foreign(options.output)
    if options.output is not None or options.link:
        return False
    if options.target.is_file() and holds_views_alone(options.target):
        return True
    refuse_existing(options.target)
    return False


def written_before(options: ToColmapOptions) -> set[str]:
    """Return the photographs whose views an earlier call has written, which this one would write anew."""
    if options.link or options.dry_run:
        return set()
    if options.output is None:
        return stored_photographs(options.target) if options.target.exists() else set()
    path = options.output / (hloc_files.NAMES[-1] if options.hloc else text_formats.NAMES[0])
    words = read_regular(path).decode("utf-8", "replace").split() if path.exists() else []
    return {word.removesuffix(OPEN) for word in words if word.endswith(OPEN)}


def write_views(options: ToColmapOptions, made: Sequence[PhotographViews], *, replace: bool) -> Path | None:
    """Return the backup, if there is one, after writing everything at once."""
    if options.link:
        return write_links(options.target, [one.job for one in made], backup=options.backup)
    views = [one.views for one in made]
    if options.hloc:
        hloc_files.write_hloc(options.target, views)
    elif options.output is not None:
        text_formats.write_matches_text(options.output, views, [one.photograph.path for one in made])
    elif made:
        write_database(options.target, views, replace=replace)
    return None
