"""The command ``blur2view triage``: which photographs are sharp, and which blurred ones are of use."""

import hashlib
import json
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from blur2view.arrays import Array
from blur2view.cli.options import TriageOptions
from blur2view.cli.run import End, begun, colmap_names, jobs_of, manifest_beside, refuse_shared, run_over
from blur2view.cli.terminal import QUIET, complain
from blur2view.cli.uses import Classifier, closing_line
from blur2view.cli.work import EstimatingWork
from blur2view.errors import Blur2ViewError, OutputError
from blur2view.output_files import ResultFiles, check_file, prepared, write_text
from blur2view.photographs.extraction import extract, extracted_names, refuse_others
from blur2view.photographs.image import read_image
from blur2view.photographs.selection import sharpest, sharpest_of_each, thumbnail
from blur2view.results.table import BLURRED, SHARP, Row
from blur2view.runs.job import Job, Made
from blur2view.runs.manifest import Manifest


@dataclass(frozen=True, kw_only=True)
class TriageWork(EstimatingWork[ResultFiles | None, None]):
    """The work on one photograph, of which nothing is kept but its row."""

    def __call__(self, job: Job[ResultFiles | None]) -> Made[None]:
        """Return the row of one photograph."""
        one = self.estimated(job)
        row = self.row(one)
        return Made(kept=None, summary=row.meaning, row=row, warnings=one.warnings)

    def restored(self, job: Job[ResultFiles | None], stored: Any) -> None:
        """Return nothing."""


def run(options: TriageOptions) -> int:
    """Return the exit code, after looking at every photograph and writing table, list and pictures."""
    work, keep = TriageWork.of(options), options.keep
    first = options.csv or keep or options.extract
    path = None if first is None else manifest_beside(first)
    refuse_shared(options, keep, [path], "--keep")
    folders = [one for one in (keep and keep.parent, options.extract and options.extract.parent) if one]
    names = colmap_names(options.inputs)
    files = extracted_names(names)
    classifier = Classifier(options)
    with prepared(*folders), begun(options, work, path, [keep]) as manifest:
        _check_list(options, names.values(), manifest)
        choice = _choice(options, files, manifest)
        earlier = "" if manifest is None or options.extract is None else manifest.digest_of(options.extract)
        _check_folder(options, files.values() if earlier in ("", choice) else (), path)
        finished = run_over(
            options,
            work,
            jobs_of(options),
            manifest,
            take=lambda job, outcome: job.path,
            classify=classifier,
            line=classifier.line,
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
            if manifest is not None:
                manifest.append_target(options.extract, choice)
            extract(options.extract, chosen)
    if options.verbosity > QUIET:
        print(closing_line(finished, options, len(kept)))
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


def _check_list(options: TriageOptions, names: Collection[str], manifest: Manifest | None) -> None:
    """Refuse a list that would replace what it must not.

    Ours is as the manifest says that an earlier call wrote it; with --overwrite and --resume one that was
    changed since is replaced, too, if it names nothing but these photographs.
    """
    target = options.keep
    if target is None:
        return
    wrote = manifest is not None and manifest.wrote(target)
    if target.is_file() and (options.overwrite or options.resume or len(names) == 1):
        with suppress(OSError, ValueError):
            wrote = wrote or set(target.read_text().splitlines()) <= set(names)
    if not (target.is_file() and wrote):
        check_file(target, "list", options.inputs.paths, option="--keep")


def _choice(options: TriageOptions, files: Mapping[Path, str], manifest: Manifest | None) -> str:
    """Return a digest of what decides which photographs are extracted."""
    kinds = options.max_smear, options.blurred, options.best, options.every_best, options.in_order
    settings = "" if manifest is None else manifest.settings.digest
    return hashlib.sha256(json.dumps([settings, *map(str, kinds), *files.values()]).encode()).hexdigest()


def _check_folder(options: TriageOptions, files: Collection[str], manifest: Path | None) -> None:
    """Refuse a folder for the pictures that holds others than these, or files of the call."""
    if options.extract is not None:
        besides = [one for one in (options.csv, options.keep, manifest) if one is not None]
        refuse_others(options.extract, files, besides)
