"""The command ``blur2view triage``: which photographs are sharp, and which blurred ones are of use."""

import argparse
import math
from collections import Counter
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from blur2view.batch.job import Job, Made
from blur2view.cli.batch import CommandRun, manifest_beside, write_text
from blur2view.cli.network import CommandNetwork
from blur2view.cli.options import read_run
from blur2view.cli.terminal import QUIET, complain, plural, printable
from blur2view.documents.table import BLURRED, SHARP, UNUSABLE, Row, facts
from blur2view.errors import OutputError
from blur2view.output_files import check_file, prepare_folder, remove_empty
from blur2view.pipeline import Run, estimate_file

NO_GEOMETRY = ("DEGENERATE", "UNDEFINED")


@dataclass(frozen=True, kw_only=True)
class TriageWork:
    """The work on one photograph."""

    run: Run
    network: CommandNetwork
    timings: bool

    def __call__(self, job: Job[None]) -> Made[None]:
        """Return the row of one photograph."""
        one = estimate_file(job.path, self.network.loaded, self.run, job.content)
        said = facts(one.estimate, one.exposure_s, one.seconds if self.timings else None)
        median = said["smear_px"]
        length = "no texture" if median is None else f"median of all smears {median:.1f} px"
        summary = f"{printable(str(job.path))}: {length}; {said['verdict']}"
        return Made(kept=None, summary=summary, row=said, warnings=one.warnings)


def run_triage(options: argparse.Namespace, usage_error: Callable[[str], object]) -> int:
    """Return the exit code, after looking at every photograph and writing table and list."""
    if options.csv is None and options.keep is None:
        usage_error("name the table with --csv, the list with --keep, or both")
    if not 0 <= options.max_smear < math.inf:
        usage_error(f"--max-smear must not be negative, got {options.max_smear}")
    work = TriageWork(
        run=read_run(options, usage_error),
        network=CommandNetwork.of(options.model),
        timings=not options.no_timings,
    )
    run: CommandRun[None, None] = CommandRun(options, work, manifest_beside(options.csv or options.keep))
    run.judge = lambda row: replace(row, use=use_of(row, options.max_smear))
    if options.keep is not None:
        wrote = run.manifest is not None and run.manifest.wrote(options.keep)
        _check_list(options, run.names.values(), wrote=wrote)
    created = [] if options.keep is None else prepare_folder(options.keep.parent)
    for _ in run.results(options.images, [None] * len(options.images)):
        pass  # a row is all that is left of a photograph
    if run.broken or not run.rows:
        remove_empty(created)
        return run.exit_code
    wanted = (SHARP, BLURRED) if options.blurred else (SHARP,)
    listed = [row.name for row in run.rows if row.use in wanted]
    if options.keep is not None:
        write_text(options.keep, list_text(listed))
        if run.manifest is not None:
            run.manifest.append_target(options.keep)
    if options.verbosity > QUIET:
        print(summary(run.rows, options, has_table=run.has_table))
        if options.keep is not None and not listed:
            print(f"the list is empty: {hint(run.rows, options)}")
    return run.exit_code


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


def _check_list(options: argparse.Namespace, names: Collection[str], *, wrote: bool) -> None:
    """Refuse a list that would replace what it must not.

    Ours is as the manifest says that an earlier call wrote it, or names nothing but these photographs.
    """
    target: Path = options.keep
    if target.is_file() and (options.overwrite or options.resume):
        try:
            ours = wrote or set(target.read_text().splitlines()) <= set(names)
        except (OSError, ValueError):
            ours = False
        if not ours:
            raise OutputError(
                f"{target}: is no list of an earlier call; name another with --keep or remove it"
            )
    else:
        check_file(target, "list", options.images, overwrite=False, option="--keep")


def hint(rows: Sequence[Row], options: argparse.Namespace) -> str:
    """Return what would put photographs on an empty list."""
    if any(row.use == BLURRED for row in rows):
        return "--blurred lists the blurred ones that are of use"
    if all(row.error for row in rows):
        return "no photograph could be read"
    lengths = [row.smear_px for row in rows if row.smear_px is not None]
    if not lengths:
        return "no photograph shows texture"
    return f"the sharpest has a median of {min(lengths):.1f} px, --max-smear is {options.max_smear:g}"


def summary(rows: Sequence[Row], options: argparse.Namespace, *, has_table: bool) -> str:
    """Return one line: how many photographs are of which use, and what was written."""
    counts = Counter(row.use for row in rows)
    parts = f"{counts[SHARP]} sharp, {counts[BLURRED]} blurred but of use, {counts[UNUSABLE]} unusable"
    parts += f", {counts['']} failed" if counts[""] else ""
    written = (options.csv if has_table else None, options.keep)
    files = " and ".join(printable(str(path)) for path in written if path is not None)
    return f"{plural(len(rows), 'photograph')}: {parts}" + (f"; wrote {files}" if files else "")
