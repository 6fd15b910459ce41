"""The command ``blur2view triage``: which photographs are sharp, and which blurred ones are of use."""

import hashlib
import json
import os
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path, PurePath

from blur2view.arrays import Array
from blur2view.cli.arguments.triage import TriageOptions
from blur2view.cli.arguments.values import ground_text
from blur2view.cli.run import End, Finished, jobs_of, manifest_of, open_manifest, refuse_shared, run_over
from blur2view.cli.terminal import QUIET, SHORT, complain, plural, printable
from blur2view.errors import Blur2ViewError, OutputError
from blur2view.input_files import read_regular
from blur2view.output_files import check_file, writable_folders, write_text
from blur2view.photographs.image import read_image
from blur2view.photographs.inputs import colmap_names
from blur2view.photographs.selection import (
    extract,
    extracted_names,
    refuse_others,
    sharpest,
    sharpest_of_each,
    thumbnail,
)
from blur2view.results.table import BLURRED, NEAR, OUT_OF_FOCUS, SHARP, UNCLEAR, UNUSABLE, Row, use_of
from blur2view.runs.manifest import Manifest
from blur2view.smears.blur import BlurKind

KEPT = {"--keep-for-poses": (SHARP, BLURRED), "--keep-for-training": (SHARP,)}
"""The uses of what lists other than --keep name."""


def run(options: TriageOptions) -> int:
    """Return the exit code, after looking at every photograph and writing table, list and pictures."""
    lists, names = options.lists, colmap_names(options.inputs)
    # a list knows the call that wrote it whatever the table, and each what was done for the others
    targets = [one for one in (*lists.values(), options.extract, options.csv) if one is not None]
    manifests = [path for one in targets if (path := manifest_of(options, one)) is not None]
    path = manifests[0] if manifests else None
    for name, target in lists.items():
        refuse_shared(options, target, [other for key, other in lists.items() if key != name], name)
    files, classifier = extracted_names(names), Classifier(options)
    with (
        writable_folders(*(one.parent for one in targets)),
        open_manifest(options, path, lists.values(), pointing=manifests[1:]) as manifest,
    ):
        for name, target in lists.items():
            _check_list(options, target, name, names.values(), manifest)
        choice = _choice(options, files, manifest)
        chosen = "" if manifest is None or options.extract is None else manifest.digest_of(options.extract)
        _check_folder(options, files.values() if chosen in ("", choice) else (), manifests)
        finished = run_over(options, jobs_of(options), manifest, classify=classifier, line=classifier.line)
        if finished.end is End.BROKEN or not finished.rows:
            return finished.exit_code
        paths = [one for one, _ in finished.outcomes if not options.inputs.is_folder(one)]
        kept = [paths[index] for index in sorted(selected(options, paths, finished.rows))]
        whole, pictures = finished.end is End.WHOLE, {one: files[one] for one in kept}
        if whole:
            _check_folder(options, pictures.values(), manifests)
        if lists:
            kept = [one for one in kept if listable(names[one])]
        for name, target in written_lists(options, whole=whole).items():
            uses = KEPT.get(name, ())
            of_use = [one for one, row in zip(paths, finished.rows, strict=False) if row.use in uses]
            listed = [names[one] for one in (of_use if uses else kept)]
            write_text(target, "".join(f"{one}\n" for one in listed if one.splitlines() == [one.strip()]))
            if manifest is not None:
                manifest.append_target(target)
        if options.extract is not None and whole:
            if manifest is not None:
                manifest.append_target(options.extract, choice)
            extract(options.extract, pictures)
    if options.verbosity > QUIET:
        print(closing_line(finished, options, len(kept)))
    return finished.exit_code or int(len(kept) < len(pictures))


def written_lists(options: TriageOptions, *, whole: bool) -> dict[str, Path]:
    """Return the lists that are written: none that chooses of neighbours after a run that was ended early."""
    return {
        name: path for name, path in options.lists.items() if name in KEPT or whole or not options.selects
    }


def selected(options: TriageOptions, paths: Sequence[Path], rows: Sequence[Row]) -> set[int]:
    """Return the indices of the photographs to keep."""
    read = [index for index, row in enumerate(rows) if not row.error]
    lengths = [rows[index].width_px for index in read]
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


def listable(name: str) -> bool:
    """Return whether COLMAP's list of images, one a line, can hold a name, after a line if it cannot."""
    if name.splitlines() == [name.strip()]:
        return True
    why = "has a line break in its name, or a blank at its end, which no list holds; rename it"
    complain(OutputError(f"{name}: {why}"))
    return False


def _check_list(
    options: TriageOptions, target: Path, name: str, names: Collection[str], manifest: Manifest | None
) -> None:
    """Refuse a list that would replace what it must not.

    Ours is as the manifest says that an earlier call wrote it; with --overwrite and --resume one that was
    changed since is replaced, too, if it names nothing but these photographs.
    """
    wrote = manifest is not None and manifest.wrote(target)
    if target.is_file() and (options.overwrite or options.resume or len(names) == 1):
        with suppress(OSError, ValueError):
            wrote = wrote or set(read_regular(target).decode().splitlines()) <= set(names)
    if not (target.is_file() and wrote):
        check_file(target, "list", options.inputs.paths, option=name)


def _choice(options: TriageOptions, files: Mapping[Path, str], manifest: Manifest | None) -> str:
    """Return a digest of what decides which photographs are extracted."""
    kinds = "limit", "max_defocus", "blurred", "best", "every_best", "in_order"
    settings = "" if manifest is None else manifest.settings.digest
    text = json.dumps([settings, *(str(getattr(options, kind)) for kind in kinds), *files.values()])
    return hashlib.sha256(text.encode()).hexdigest()


def _check_folder(options: TriageOptions, files: Collection[str], manifests: Sequence[Path]) -> None:
    """Refuse a folder for the pictures that holds others than these, or photographs or files of the call."""
    if options.extract is not None:
        here = {os.path.realpath(path.parent) for path in options.inputs.paths}
        if os.path.realpath(options.extract) in here:
            raise OutputError(f"{options.extract}: holds the photographs themselves; name an empty folder")
        besides = [one for one in (options.csv, *options.lists.values(), *manifests) if one is not None]
        refuse_others(options.extract, files, besides)


class Classifier:
    """Says what photographs are of use for, one after the other: frames follow the one before."""

    def __init__(self, options: TriageOptions) -> None:
        self._options, self._last = options, Row()

    def __call__(self, row: Row) -> Row:
        """Return the row of the next photograph with its use."""
        limit, gsd = self._options.limit, self._options.gsd
        if gsd is not None and row.smear_px is not None:
            row = replace(row, smear_ground_m=gsd * row.smear_px)
        length = row.smear_percent if limit.percent else row.smear_ground_m if limit.metres else row.smear_px
        before = self._last.use if self._follows(row) else ""
        use, reason = use_of(row, length, limit.number, self._options.max_defocus, before, limit.unit)
        classified = replace(row, use=use, reason=reason)
        self._last = classified if use else self._last
        return classified

    def _follows(self, row: Row) -> bool:
        last = self._last
        if PurePath(row.name).parent != PurePath(last.name).parent:
            return False
        if row.frame is None or last.frame is None:
            return self._options.in_order and row.frame is last.frame
        return row.frame == last.frame + 1

    def line(self, path: Path, row: Row) -> str:
        """Return one line about a photograph; with -v what its blur means, too."""
        text = f"{printable(str(path))}: {row.use} ({_length(row, self._options.limit.number)})"
        if row.use in (BLURRED, UNUSABLE):
            text += f" [{row.verdict}]"
        return f"{text}: {row.meaning}" if self._options.verbosity > SHORT else text


def _length(row: Row, limit_px: float) -> str:
    """Return how long the blur is, near the limit with a digit more."""
    if row.smear_px is None or row.blur == BlurKind.CANNOT_TELL:
        return "no texture"
    if row.use == OUT_OF_FOCUS:
        return f"by a radius of {row.defocus_px:.1f} px"
    near = limit_px / NEAR < row.smear_px < limit_px * NEAR
    digits = 2 if near else 1 if row.smear_px < 9.95 else 0
    ground = "" if row.smear_ground_m is None else f", {ground_text(row.smear_ground_m)} on the ground"
    return f"smears of {row.smear_px:.{digits}f} px{ground}"


def hint(rows: Sequence[Row], options: TriageOptions) -> str:
    """Return what would keep photographs where none is kept."""
    if any(row.use == BLURRED for row in rows):
        return "--blurred keeps the blurred ones that are of use, --best 50% the sharper half"
    if all(row.error for row in rows):
        return "no photograph could be read"
    radii = [row.defocus_px for row in rows if row.use == OUT_OF_FOCUS and row.defocus_px is not None]
    if radii:
        return (
            f"the least out of focus is so by {min(radii):.3g} px, --max-defocus is {options.max_defocus:g}"
        )
    lengths = [row.smear_px for row in rows if row.smear_px is not None]
    if not lengths:
        return "no photograph shows texture"
    return f"the sharpest has smears of {min(lengths):.3g} px, --max-smear is {options.limit}"


def closing_line(finished: Finished, options: TriageOptions, kept: int) -> str:
    """Return how many photographs are of which use, and what was written.

    A run that was ended early extracts nothing, and chooses nothing of neighbours.
    """
    rows, whole = finished.rows, finished.end is End.WHOLE
    counts = Counter(row.use for row in rows)
    done_before = f" ({finished.skipped} done before)" * bool(finished.skipped)
    uses = f"{counts[SHARP]} sharp, {counts[BLURRED]} blurred but of use, {counts[UNUSABLE]} unusable"
    uses += f", {counts[OUT_OF_FOCUS]} out of focus" * bool(counts[OUT_OF_FOCUS])
    uses += f", {counts[UNCLEAR]} unclear: smooth or dark" * bool(counts[UNCLEAR])
    parts = [uses + f", {counts['']} failed" * bool(counts[""])]
    if options.keep is not None or options.extract is not None:
        parts.append(f"{kept} kept" if kept else f"none is kept: {hint(rows, options)}")
    for name, listed in KEPT.items():
        if name in options.lists and not any(counts[use] for use in listed):
            parts.append(f"{name} names none, as none is {' or '.join(listed)}")
    table, lists = options.csv if finished.has_table else None, written_lists(options, whole=whole).values()
    written = table, *lists, options.extract if kept and whole else None
    files = " and ".join(printable(str(path)) for path in written if path is not None)
    parts += [f"wrote {files}"] * bool(files)
    return f"{plural(len(rows), 'photograph')}{done_before} in {finished.seconds:.1f} s: {'; '.join(parts)}"
