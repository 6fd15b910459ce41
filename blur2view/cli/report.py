"""The command ``blur2view report``: one page that shows the result of every photograph."""

import argparse
import os
import re
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from blur2view import __version__
from blur2view.cli.options import read_run
from blur2view.cli.summary import verdict_line
from blur2view.cli.terminal import QUIET, SHORT, complain, printable, progress
from blur2view.errors import Blur2ViewError, OutputError, within_memory
from blur2view.networks.smear_network import SmearNetwork
from blur2view.output_files import (
    below_shared_folder,
    is_ours,
    prepare_folder,
    remove_empty,
    unwritable,
    write_atomically,
)
from blur2view.pipeline import FileEstimate, Run, estimate_file
from blur2view.segmentation.mask import segment
from blur2view.visualization.report import Entry, report

DONE, FAILED = 0, 1
FOLDERS = re.compile(r"(?<!\S)/(?:[^/\s:;,]+/)+")  # of an absolute path within an error's line


def run_report(options: argparse.Namespace, usage_error: Callable[[str], object]) -> int:
    """Return the exit code, after estimating every photograph and writing the page.

    A photograph that fails gets a card with its reason; if all fail nothing is written.
    """
    run = read_run(options, usage_error)
    _check_output(options)
    network = SmearNetwork(options.model)
    created = prepare_folder(options.output.parent)
    entries = _entries(options, run, network)
    failed = sum(entry.kind == "failed" for entry in entries)
    if failed == len(entries):
        remove_empty(created)
        raise OutputError(f"{options.output}: is not written, as every photograph failed; name others")
    _write(options, entries)
    return FAILED if failed else DONE


def _check_output(options: argparse.Namespace) -> None:
    """Refuse before any work to replace a photograph, or a page without being asked."""
    target = options.output
    if os.path.realpath(target) in {os.path.realpath(image) for image in options.images}:
        raise OutputError(f"{target}: the page would replace a photograph; name another with -o")
    if target.is_dir():
        raise OutputError(f"{target}: is a folder; name the page, for example -o {target / 'report.html'}")
    if os.path.lexists(target) and not options.overwrite:
        raise OutputError(f"{target}: exists; name another page with -o or add --overwrite")
    if os.path.lexists(target) and not is_ours(target):
        raise OutputError(f"{target}: is no page of an earlier call; name another with -o or remove it")


def _entries(options: argparse.Namespace, run: Run, network: SmearNetwork) -> list[Entry]:
    """Return the entry of every photograph, and print a line about each."""
    names = shown_names(options.images)
    jobs, say = progress(list(zip(options.images, names, strict=True)))
    entries = []
    for image, name in jobs:
        try:
            with within_memory(image):
                one = estimate_file(image, network, run)
                shown = replace(one, path=Path(name))
                entries.append(_entry(shown, masked=not options.no_mask, timings=not options.no_timings))
        except Blur2ViewError as error:
            entries.append(Entry.failed(name, FOLDERS.sub("", str(error).replace(str(image), name))))
            complain(error, say)
        else:
            if options.verbosity > QUIET:
                line = verdict_line(str(image), one.estimate.geometry)
                say(line if options.verbosity == SHORT else f"{line}\n  {one.estimate.geometry.reason}")
    return entries


def shown_names(images: Sequence[Path]) -> list[str]:
    """Return names without the folders that all photographs share: a report is made to be sent."""
    return [path.name if ".." in path.parts else str(path) for path in below_shared_folder(images)]


def _entry(one: FileEstimate, *, masked: bool, timings: bool) -> Entry:
    """Return the entry of one photograph, with its mask if wanted."""
    start = time.perf_counter()
    mask = segment(one.estimate) if masked else None
    mask_s = None if mask is None else time.perf_counter() - start
    return Entry.of(one, mask, mask_s, timings=timings)


def _write(options: argparse.Namespace, entries: list[Entry]) -> None:
    """Write the page and print where it is."""
    page = report(entries, __version__)
    try:
        write_atomically(options.output, lambda file: file.write(page))
    except OSError as error:
        raise unwritable(options.output, error) from None
    if options.verbosity > QUIET:
        print(f"wrote {printable(str(options.output))} ({len(page) / 1e6:.2f} MB)")
