"""``blur2view report IMG... -o report.html``: everything that was found, on one page to look at."""

import argparse
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from blur2view import __version__
from blur2view.cli.options import add_estimator_options, complain, progress, read_run
from blur2view.documents import estimate_file
from blur2view.errors import Blur2ViewError, OutputError
from blur2view.networks.smear_network import SmearNetwork
from blur2view.output_files import prepare_folder, unwritable, write_atomically
from blur2view.pipeline import Run
from blur2view.segmentation.mask import segment
from blur2view.segmentation.network import MotionNetwork
from blur2view.visualization.report import Entry, report

DONE, FAILED = 0, 1


def add_report(commands: Any) -> None:
    """Describe ``blur2view report``."""
    about = "write one self-contained HTML page that shows what was found in each photograph"
    parser = commands.add_parser("report", help=about, description=about)
    add = parser.add_argument
    add("images", nargs="+", type=Path, metavar="IMG", help="photographs: JPEG, PNG, TIFF, ...")
    add(
        "-o",
        "--output",
        type=Path,
        default=Path("report.html"),
        metavar="HTML",
        help="the page (default: %(default)s)",
    )
    add("--overwrite", action="store_true", help="replace a page of an earlier call, unless all fail")
    add("--no-mask", action="store_true", help="without the layers of what moves by itself")
    add("--no-timings", action="store_true", help="without timings: equal calls give equal bytes")
    add("--exposure", type=float, metavar="S", help="exposure time in seconds (default: that of EXIF)")
    add_estimator_options(parser)
    parser.set_defaults(run=lambda options: run_report(options, parser.error))


def run_report(options: argparse.Namespace, usage_error: Callable[[str], object]) -> int:
    """Estimate every photograph and write the page; a failing one gets a card with its reason.

    If all fail, the page of an earlier call is kept.
    """
    run = read_run(options, usage_error)
    _check_output(options)
    network, motion_network = SmearNetwork(options.model), None if options.no_mask else MotionNetwork()
    jobs, say = progress(options.images)
    entries = []
    for image in jobs:
        try:
            entries.append(_entry(image, network, motion_network, run, options))
        except Blur2ViewError as error:
            entries.append(Entry.failed(str(image), str(error)))
            complain(error, say)
        else:
            say(f"{image}: {entries[-1].verdict}", file=sys.stdout)
    if os.path.lexists(options.output) and all(entry.kind == "failed" for entry in entries):
        raise OutputError(f"{options.output}: kept as it was, as every photograph failed; name others")
    page = report(entries, __version__)
    try:
        write_atomically(options.output, lambda file: file.write(page))
    except OSError as error:
        raise unwritable(options.output, error) from None
    print(f"wrote {options.output} ({len(page) / 1e6:.2f} MB)")
    return FAILED if any(entry.kind == "failed" for entry in entries) else DONE


def _check_output(options: argparse.Namespace) -> None:
    """Refuse before any work to replace a photograph, or a page without being asked."""
    target = options.output
    if os.path.realpath(target) in {os.path.realpath(image) for image in options.images}:
        raise OutputError(f"{target}: the page would replace a photograph; name another with -o")
    if target.is_dir():
        raise OutputError(f"{target}: is a folder; name the page, for example -o {target / 'report.html'}")
    if os.path.lexists(target) and not options.overwrite:
        raise OutputError(f"{target}: exists; name another page with -o or add --overwrite")
    prepare_folder(target.parent)


def _entry(
    path: Path,
    network: SmearNetwork,
    motion_network: MotionNetwork | None,
    run: Run,
    options: argparse.Namespace,
) -> Entry:
    """Estimate one photograph and pack it; without a motion segmentation network without a mask."""
    one = estimate_file(path, network, run)
    start = time.perf_counter()
    mask = None if motion_network is None else segment(one.found, one.image, network=motion_network)
    mask_s = None if mask is None else time.perf_counter() - start
    return Entry.of(one, mask, mask_s, timings=not options.no_timings)
