"""The command ``blur2view report``: one page that shows the result of every photograph."""

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass

from blur2view import __version__
from blur2view.batch.job import Job, Made
from blur2view.cli.batch import CommandRun, manifest_beside
from blur2view.cli.networks import Networks
from blur2view.cli.options import read_run
from blur2view.cli.summary import verdict_line
from blur2view.cli.terminal import QUIET, SHORT, printable
from blur2view.documents.table import facts
from blur2view.errors import OutputError
from blur2view.output_files import check_file, prepare_folder, remove_empty, unwritable, write_atomically
from blur2view.pipeline import Run, estimate_file
from blur2view.segmentation.mask import segment
from blur2view.visualization.report import Entry, report


@dataclass(frozen=True, kw_only=True)
class ReportWork:
    """The work on one photograph."""

    run: Run
    networks: Networks
    mask: bool
    timings: bool
    verbosity: int

    def __call__(self, job: Job[None]) -> Made[Entry]:
        """Return the entry of one photograph."""
        one = estimate_file(job.path, self.networks.smears, self.run, job.content)
        start = time.perf_counter()
        mask = segment(one.estimate, one.image, network=self.networks.motion) if self.mask else None
        mask_s = None if mask is None else time.perf_counter() - start
        geometry = one.estimate.geometry
        line = verdict_line(str(job.path), geometry)
        summary = line if self.verbosity <= SHORT else f"{line}\n  {geometry.reason}"
        said = facts(one.estimate, one.exposure_s, one.seconds if self.timings else None)
        return Made(kept=Entry.of(one, mask, mask_s, timings=self.timings), summary=summary, row=said)


def run_report(options: argparse.Namespace, usage_error: Callable[[str], object]) -> int:
    """Return the exit code, after estimating every photograph and writing the page.

    A photograph that fails gets a card with its reason; if all fail nothing is written. An interrupted run
    leaves a page of what is done.
    """
    work = ReportWork(
        run=read_run(options, usage_error),
        networks=Networks.of(options.model),
        mask=not options.no_mask,
        timings=not options.no_timings,
        verbosity=options.verbosity,
    )
    overwrite = options.overwrite or options.resume
    check_file(options.output, "page", options.images, overwrite=overwrite)
    created = prepare_folder(options.output.parent)
    run: CommandRun[None, Entry] = CommandRun(options, work, manifest_beside(options.output))
    entries = [
        Entry.failed(str(result.path), result.error) if result.made is None else result.made.kept
        for result in run.results(options.images, [None] * len(options.images))
    ]
    if all(entry.kind == "failed" for entry in entries):
        remove_empty(created)
        if run.interrupted:
            return run.exit_code
        raise OutputError(f"{options.output}: is not written, as every photograph failed; name others")
    _write(options, entries)
    return run.exit_code


def _write(options: argparse.Namespace, entries: list[Entry]) -> None:
    """Write the page and print where it is."""
    page = report(entries, __version__)
    try:
        write_atomically(options.output, lambda file: file.write(page))
    except OSError as error:
        raise unwritable(options.output, error) from None
    if options.verbosity > QUIET:
        print(f"wrote {printable(str(options.output))} ({len(page) / 1e6:.2f} MB)")
