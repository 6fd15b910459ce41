"""The command ``blur2view report``: one page that shows the result of every photograph."""

import re
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from blur2view import __version__
from blur2view.cli.arguments.report import ReportOptions, ReportSettings
from blur2view.cli.run import End, jobs_of, open_manifest, run_over
from blur2view.cli.summary import verdict_line
from blur2view.cli.terminal import QUIET, SHORT, printable
from blur2view.cli.work import EstimatingWork, result_of
from blur2view.errors import OutputError
from blur2view.output_files import below_shared_folder, check_file, writable_folders, write_files, writing
from blur2view.results.report import Entry, report
from blur2view.results.verdicts import verdict_of
from blur2view.runs.job import Job, Outcome, Result
from blur2view.segmentation.mask import segment

FOLDERS = re.compile(r"(?<!\S)/(?:[^/\s:;,]+/)+")  # of an absolute path within an error's line


@dataclass(frozen=True, kw_only=True)
class ReportWork(ReportSettings, EstimatingWork[None, Entry]):
    """The work on one photograph."""

    def __call__(self, job: Job[None]) -> Result[Entry]:
        """Return the entry of one photograph, by its path as it was named."""
        one = self.estimated(job)
        start = time.perf_counter()
        mask = None
        if self.mask:
            mask = segment(one.estimate, one.image, np.random.default_rng(self.run.seed))
        mask_s = None if mask is None else time.perf_counter() - start
        geometry = one.estimate.geometry
        line = verdict_line(str(job.path), verdict_of(one), geometry)
        summary = line if self.verbosity <= SHORT else f"{line}\n  {geometry.reason}"
        return result_of(one, Entry.of(one, mask, mask_s), summary)


def run(options: ReportOptions) -> int:
    """Return the exit code, after estimating every photograph and writing the page.

    A photograph that fails gets a card with its reason; if all fail nothing is written. An interrupted run
    leaves a page of what is done.
    """
    work = ReportWork.of(options)
    images, page = options.inputs.paths, options.output
    check_file(page, "page", images)
    with writable_folders(page.parent), open_manifest(options, work, None, [page]):
        finished = run_over(options, work, jobs_of(options), None)
        shown = dict(zip(images, shown_names(images), strict=True))
        photographs = [one for one in finished.outcomes if not options.inputs.is_folder(one[0])]
        entries = [entry_of(path, shown[path], outcome) for path, outcome in photographs]
        if finished.end is not End.BROKEN and any(entry.kind != "failed" for entry in entries):
            _write(options, entries)
        elif finished.end in (End.WHOLE, End.STOPPED) and len(entries) > 1:  # else its own line says all
            raise OutputError(f"{page}: is not written, as every photograph failed; name others")
    return finished.exit_code


def entry_of(path: Path, name: str, outcome: Outcome[Entry]) -> Entry:
    """Return the entry of a photograph by the name that the page shows."""
    if outcome.result is not None:
        return outcome.result.payload.renamed(name)
    return Entry.failed(name, FOLDERS.sub("", outcome.error.replace(str(path), name)))


def shown_names(images: Sequence[Path]) -> list[str]:
    """Return names without the folders that all photographs share: a report is made to be sent."""
    return [path.name if ".." in path.parts else str(path) for path in below_shared_folder(images)]


def _write(options: ReportOptions, entries: list[Entry]) -> None:
    page = report(entries, __version__)
    with writing(options.output.parent):
        write_files({options.output: page})
    if options.verbosity > QUIET:
        print(f"wrote {printable(str(options.output))} ({len(page) / 1e6:.2f} MB)")
