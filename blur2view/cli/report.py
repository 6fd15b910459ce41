"""The command ``blur2view report``: one page that shows the result of every photograph."""

import argparse
import re
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from blur2view import __version__
from blur2view.batch.job import Job, Made
from blur2view.cli.batch import CommandRun, manifest_beside
from blur2view.cli.network import CommandNetwork
from blur2view.cli.options import read_run
from blur2view.cli.summary import verdict_line
from blur2view.cli.terminal import QUIET, SHORT, printable
from blur2view.documents.table import facts
from blur2view.errors import OutputError
from blur2view.output_files import (
    below_shared_folder,
    check_file,
    prepare_folder,
    remove_empty,
    unwritable,
    write_atomically,
)
from blur2view.pipeline import Run, estimate_file
from blur2view.segmentation.mask import segment
from blur2view.visualization.report import Entry, report

FOLDERS = re.compile(r"(?<!\S)/(?:[^/\s:;,]+/)+")  # of an absolute path within an error's line


@dataclass(frozen=True, kw_only=True)
class ReportWork:
    """The work on one photograph."""

    run: Run
    network: CommandNetwork
    mask: bool
    timings: bool
    verbosity: int

    def __call__(self, job: Job[None]) -> Made[Entry]:
        """Return the entry of one photograph, by its path as it was named."""
        one = estimate_file(job.path, self.network.loaded, self.run, job.content)
        start = time.perf_counter()
        mask = None
        if self.mask:
            mask = segment(one.estimate, one.image, np.random.default_rng(self.run.seed))
        mask_s = None if mask is None else time.perf_counter() - start
        geometry = one.estimate.geometry
        line = verdict_line(str(job.path), geometry)
        summary = line if self.verbosity <= SHORT else f"{line}\n  {geometry.reason}"
        said = facts(one.estimate, one.exposure_s, one.seconds if self.timings else None)
        entry = Entry.of(one, mask, mask_s, timings=self.timings)
        return Made(kept=entry, summary=summary, row=said, warnings=one.warnings)


def run_report(options: argparse.Namespace, usage_error: Callable[[str], object]) -> int:
    """Return the exit code, after estimating every photograph and writing the page.

    A photograph that fails gets a card with its reason; if all fail nothing is written. An interrupted run
    leaves a page of what is done.
    """
    work = ReportWork(
        run=read_run(options, usage_error),
        network=CommandNetwork.of(options.model),
        mask=not options.no_mask,
        timings=not options.no_timings,
        verbosity=options.verbosity,
    )
    overwrite = options.overwrite or options.resume
    check_file(options.output, "page", options.images, overwrite=overwrite)
    run: CommandRun[None, Entry] = CommandRun(options, work, manifest_beside(options.output))
    created = prepare_folder(options.output.parent)
    names = shown_names(options.images)
    shown = {path: name for path, name in zip(options.images, names, strict=True)}
    entries = [
        _failed(result.path, shown[result.path], result.error)
        if result.made is None
        else result.made.kept.renamed(shown[result.path])
        for result in run.results(options.images, [None] * len(names))
        if not options.inputs.is_folder(result.path)
    ]
    if run.broken or all(entry.kind == "failed" for entry in entries):
        remove_empty(created)
        if run.interrupted or run.broken or len(entries) < 2:  # its own line says all
            return run.exit_code
        raise OutputError(f"{options.output}: is not written, as every photograph failed; name others")
    _write(options, entries)
    return run.exit_code


def shown_names(images: Sequence[Path]) -> list[str]:
    """Return names without the folders that all photographs share: a report is made to be sent."""
    return [path.name if ".." in path.parts else str(path) for path in below_shared_folder(images)]


def _failed(path: Path, name: str, error: str) -> Entry:
    """Return the entry of a photograph that could not be estimated, its line without folders."""
    return Entry.failed(name, FOLDERS.sub("", error.replace(str(path), name)))


def _write(options: argparse.Namespace, entries: list[Entry]) -> None:
    """Write the page and print where it is."""
    page = report(entries, __version__)
    try:
        write_atomically(options.output, lambda file: file.write(page))
    except OSError as error:
        raise unwritable(options.output, error) from None
    if options.verbosity > QUIET:
        print(f"wrote {printable(str(options.output))} ({len(page) / 1e6:.2f} MB)")
