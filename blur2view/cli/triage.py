"""The command ``blur2view triage``: which photographs are sharp, and which blurred ones are of use."""

from collections import Counter
from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path, PurePath
from typing import Any

from blur2view.arrays import Array
from blur2view.cli.options import TriageOptions
from blur2view.cli.run import End, begun, colmap_names, jobs_of, manifest_beside, refuse_shared, run_over
from blur2view.cli.terminal import QUIET, complain, plural, printable
from blur2view.cli.work import EstimatingWork
from blur2view.errors import Blur2ViewError, OutputError
from blur2view.output_files import check_file, prepared, write_text
from blur2view.photographs.extraction import extract, extracted_names, refuse_others
from blur2view.photographs.image import read_image
from blur2view.photographs.selection import sharpest, sharpest_of_each, thumbnail
from blur2view.results.table import BLURRED, SHARP, UNUSABLE, Row
from blur2view.runs.job import Job, Made

NO_GEOMETRY = ("DEGENERATE", "UNDEFINED")
NEAR = 1.1
"""About the limit by this factor a photograph is as sharp as the one before: compressed again, as Motion JPEG
and as MPEG-4, nine in ten frames of RedKitchen's sequence keep their median within 6 and 8 %."""


@dataclass(frozen=True, kw_only=True)
class TriageWork(EstimatingWork[None, None]):
    """The work on one photograph, of which nothing is kept but its row."""

    def __call__(self, job: Job[None]) -> Made[None]:
        """Return the row of one photograph."""
        one = self.estimated(job)
        row = self.row(one)
        length = "no texture" if row.smear_px is None else f"median of all smears {row.smear_px:.3g} px"
        summary = f"{printable(str(job.path))}: {length}; {row.verdict}"
        return Made(kept=None, summary=summary, row=row, warnings=one.warnings)

    def restored(self, job: Job[None], stored: Any) -> None:
        """Return nothing."""


class Judge:
    """Says what photographs are good for, one after the other, as each depends on the one before."""

    def __init__(self, options: TriageOptions) -> None:
        self._limit, self._last = options.max_smear, Row()

    def __call__(self, row: Row) -> Row:
        """Return the row of the next photograph with its use."""
        follows = PurePath(row.name).parent == PurePath(self._last.name).parent
        length = row.smear_percent if self._limit.percent else row.smear_px
        use = use_of(row, length, self._limit.number, self._last.use if follows else "")
        judged = replace(row, use=use)
        if use:
            self._last = judged
        return judged


def use_of(row: Row, length: float | None, limit: float, before: str = "") -> str:
    """Return what a photograph is good for, empty if it failed.

    Sharp if its median smear is at most the limit; within `NEAR` of it if the photograph before is. A longer
    one is of use, as views of its exposure, if F or H explains its smears; without texture, or without
    geometry, it is of none.
    """
    if row.error:
        return ""
    factor = 1.0 if not before else NEAR if before == SHARP else 1 / NEAR
    if length is not None and length <= limit * factor:
        return SHARP
    return UNUSABLE if length is None or row.verdict in NO_GEOMETRY else BLURRED


def run(options: TriageOptions) -> int:
    """Return the exit code, after looking at every photograph and writing table, list and pictures."""
    work, keep = TriageWork(**TriageWork.shared(options)), options.keep
    first = options.csv or keep or options.extract
    path = None if first is None else manifest_beside(first)
    refuse_shared(options, keep, [path], "--keep")
    folders = [one for one in (keep and keep.parent, options.extract and options.extract.parent) if one]
    names = colmap_names(options.inputs)
    files = extracted_names(names)
    with prepared(*folders), begun(options, work, path, [keep]) as manifest:
        if keep is not None:
            wrote = manifest is not None and manifest.wrote(keep)
            _check_list(options, keep, names.values(), wrote=wrote)
        _check_folder(options, files.values(), path)
        finished = run_over(
            options,
            work,
            jobs_of(options),
            manifest,
            take=lambda job, outcome: job.path,
            judge=Judge(options),
        )
        if finished.end is End.BROKEN or not finished.rows:
            return finished.exit_code
        paths = [one for one in finished.taken if not options.inputs.is_folder(one)]
        kept = [paths[index] for index in sorted(selected(options, paths, finished.rows))]
        whole, chosen = finished.end is End.WHOLE, {one: files[one] for one in kept}
        if whole:
            _check_folder(options, chosen.values(), path)
        if keep is not None and (whole or not options.selects):
            write_text(keep, list_text([names[one] for one in kept]))
            if manifest is not None:
                manifest.append_target(keep)
        if options.extract is not None and whole:
            extract(options.extract, chosen)
    if options.verbosity > QUIET:
        print(summary(finished.rows, options, len(kept), has_table=finished.has_table, whole=whole))
        if not kept and (keep is not None or options.extract is not None):
            print(f"nothing is kept: {hint(finished.rows, options)}")
    return finished.exit_code


def selected(options: TriageOptions, paths: Sequence[Path], rows: Sequence[Row]) -> set[int]:
    """Return the indices of the photographs to keep."""
    read = [index for index, row in enumerate(rows) if not row.error]
    lengths = [rows[index].smear_px for index in read]
    if options.best is not None:
        number = options.best.number
        count = max(round(len(read) * number / 100), 1) if options.best.percent else int(number)
        chosen = sharpest(lengths, count)
    elif options.every_best is not None:
        series = [paths[index].parent for index in read]
        chosen = sharpest_of_each(lengths, series, options.every_best, lambda one: _view(paths[read[one]]))
    else:
        wanted = (SHARP, BLURRED) if options.blurred else (SHARP,)
        return {index for index in read if rows[index].use in wanted}
    return {read[index] for index in chosen}


def _view(path: Path) -> Array | None:
    """Return the thumbnail of a photograph, None of one that cannot be read any more."""
    try:
        return thumbnail(read_image(path))
    except Blur2ViewError:
        return None


def list_text(names: Sequence[str]) -> str:
    """Return COLMAP's list of images, one a line; a name with a line break, which none holds, is left out."""
    for name in names:
        if name.splitlines() != [name]:
            complain(OutputError(f"{name}: has a line break in its name, which no list holds; rename it"))
    return "".join(f"{name}\n" for name in names if name.splitlines() == [name])


def _check_list(options: TriageOptions, target: Path, names: Collection[str], *, wrote: bool) -> None:
    """Refuse a list that would replace what it must not.

    Ours is as the manifest says that an earlier call wrote it; with --overwrite and --resume one that was
    changed since is replaced, too, if it names nothing but these photographs.
    """
    if target.is_file() and (options.overwrite or options.resume or len(names) == 1):
        with suppress(OSError, ValueError):
            wrote = wrote or set(target.read_text().splitlines()) <= set(names)
    if not (target.is_file() and wrote):
        check_file(target, "list", options.inputs.paths, option="--keep")


def _check_folder(options: TriageOptions, files: Collection[str], manifest: Path | None) -> None:
    """Refuse a folder for the pictures that holds others than these, or files of the call."""
    if options.extract is not None:
        besides = [one for one in (options.csv, options.keep, manifest) if one is not None]
        refuse_others(options.extract, files, besides)


def hint(rows: Sequence[Row], options: TriageOptions) -> str:
    """Return what would keep photographs where none is kept."""
    if any(row.use == BLURRED for row in rows):
        return "--blurred keeps the blurred ones that are of use, --best 50% the sharper half"
    if all(row.error for row in rows):
        return "no photograph could be read"
    lengths = [row.smear_px for row in rows if row.smear_px is not None]
    if not lengths:
        return "no photograph shows texture"
    return f"the sharpest has a median of {min(lengths):.3g} px, --max-smear is {options.max_smear}"


def summary(rows: Sequence[Row], options: TriageOptions, kept: int, *, has_table: bool, whole: bool) -> str:
    """Return one line: how many photographs are of which use, and what was written.

    A run that was ended early extracts nothing, and chooses nothing of neighbours.
    """
    counts = Counter(row.use for row in rows)
    parts = f"{counts[SHARP]} sharp, {counts[BLURRED]} blurred but of use, {counts[UNUSABLE]} unusable"
    parts += f", {counts['']} failed" if counts[""] else ""
    parts += f"; {kept} kept" if options.keep is not None or options.extract is not None else ""
    keep = options.keep if whole or not options.selects else None
    written = (options.csv if has_table else None, keep, options.extract if kept and whole else None)
    files = " and ".join(printable(str(path)) for path in written if path is not None)
    return f"{plural(len(rows), 'photograph')}: {parts}" + (f"; wrote {files}" if files else "")
