"""The command ``blur2view triage``: which photographs are sharp, and which blurred ones are of use."""

from collections import Counter
from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from blur2view.cli.options import TriageOptions
from blur2view.cli.run import (
    End,
    begun,
    colmap_names,
    jobs_of,
    manifest_beside,
    refuse_shared,
    run_over,
    write_text,
)
from blur2view.cli.terminal import QUIET, complain, plural, printable
from blur2view.cli.work import EstimatingWork
from blur2view.errors import OutputError
from blur2view.output_files import check_file, prepared
from blur2view.results.table import BLURRED, SHARP, UNUSABLE, Row
from blur2view.runs.job import Job, Made

NO_GEOMETRY = ("DEGENERATE", "UNDEFINED")


@dataclass(frozen=True, kw_only=True)
class TriageWork(EstimatingWork[None, None]):
    """The work on one photograph, of which nothing is kept but its row."""

    def __call__(self, job: Job[None]) -> Made[None]:
        """Return the row of one photograph."""
        one = self.estimated(job)
        row = self.row(one)
        length = "no texture" if row.smear_px is None else f"median of all smears {row.smear_px:.1f} px"
        summary = f"{printable(str(job.path))}: {length}; {row.verdict}"
        return Made(kept=None, summary=summary, row=row, warnings=one.warnings)

    def restored(self, job: Job[None], stored: Any) -> None:
        """Return nothing."""


def run(options: TriageOptions) -> int:
    """Return the exit code, after looking at every photograph and writing table and list."""
    work, keep = TriageWork(**TriageWork.shared(options)), options.keep
    first = options.csv or keep
    path = None if first is None else manifest_beside(first)
    refuse_shared(options, keep, [path], "--keep")
    folders = [] if keep is None else [keep.parent]
    with prepared(*folders), begun(options, work, path, [keep]) as manifest:
        if keep is not None:
            wrote = manifest is not None and manifest.wrote(keep)
            _check_list(options, keep, colmap_names(options.inputs).values(), wrote=wrote)
        finished = run_over(
            options,
            work,
            jobs_of(options),
            manifest,
            take=lambda job, outcome: None,
            judge=lambda row: replace(row, use=use_of(row, options.max_smear)),
        )
        if finished.end is End.BROKEN or not finished.rows:
            return finished.exit_code
        wanted = (SHARP, BLURRED) if options.blurred else (SHARP,)
        listed = [row.name for row in finished.rows if row.use in wanted]
        if keep is not None:
            write_text(keep, list_text(listed))
            if manifest is not None:
                manifest.append_target(keep)
    if options.verbosity > QUIET:
        print(summary(finished.rows, options, has_table=finished.has_table))
        if keep is not None and not listed:
            print(f"the list is empty: {hint(finished.rows, options)}")
    return finished.exit_code


def use_of(row: Row, max_smear_px: float) -> str:
    """Return what a photograph is good for, empty if it failed.

    Sharp if its median smear is at most the limit. A longer one is of use, as views of its exposure, if F or
    H explains its smears; without texture, or without geometry, it is of none.
    """
    if row.error:
        return ""
    if row.smear_px is not None and row.smear_px <= max_smear_px:
        return SHARP
    return UNUSABLE if row.smear_px is None or row.verdict in NO_GEOMETRY else BLURRED


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


def hint(rows: Sequence[Row], options: TriageOptions) -> str:
    """Return what would put photographs on an empty list."""
    if any(row.use == BLURRED for row in rows):
        return "--blurred lists the blurred ones that are of use"
    if all(row.error for row in rows):
        return "no photograph could be read"
    lengths = [row.smear_px for row in rows if row.smear_px is not None]
    if not lengths:
        return "no photograph shows texture"
    return f"the sharpest has a median of {min(lengths):.1f} px, --max-smear is {options.max_smear:g}"


def summary(rows: Sequence[Row], options: TriageOptions, *, has_table: bool) -> str:
    """Return one line: how many photographs are of which use, and what was written."""
    counts = Counter(row.use for row in rows)
    parts = f"{counts[SHARP]} sharp, {counts[BLURRED]} blurred but of use, {counts[UNUSABLE]} unusable"
    parts += f", {counts['']} failed" if counts[""] else ""
    written = (options.csv if has_table else None, options.keep)
    files = " and ".join(printable(str(path)) for path in written if path is not None)
    return f"{plural(len(rows), 'photograph')}: {parts}" + (f"; wrote {files}" if files else "")
