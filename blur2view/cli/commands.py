"""The command line: ``blur2view estimate``, ``segment``, ``to-colmap`` and ``report``."""

import argparse
import io
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from blur2view import __version__
from blur2view.cli.batch import plan_files, run_each
from blur2view.cli.options import add_estimator_options, complain, read_run
from blur2view.cli.outputs import OutputFiles, write_results
from blur2view.cli.report import add_report
from blur2view.cli.segment import add_segment
from blur2view.cli.summary import summary
from blur2view.cli.to_colmap import add_to_colmap
from blur2view.documents import estimate_file
from blur2view.errors import Blur2ViewError
from blur2view.networks.smear_network import SmearNetwork
from blur2view.pipeline import Run

DONE, FAILED, USAGE, INTERRUPTED = 0, 1, 2, 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : sequence of str, optional
        Those of the process by default.

    Returns
    -------
    int
        0 done (a degenerate scene is a result), 1 a named error, 2 usage, 130 interrupted.
    """
    parser = build_parser()
    options = parser.parse_args(arguments)
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # a file name may hold anything
    try:
        code = int(options.run(options))
        sys.stdout.flush()  # here, where a failure can still be told; at exit Python would print a traceback
    except Blur2ViewError as error:
        complain(error)
        return FAILED
    except KeyboardInterrupt:
        print("blur2view: interrupted", file=sys.stderr)
        return INTERRUPTED
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if not isinstance(error, BrokenPipeError):  # whose reader, for example head, wants no more
            print(f"blur2view: cannot print ({error.strerror}); print elsewhere", file=sys.stderr)
        return FAILED
    return code


def build_parser() -> argparse.ArgumentParser:
    """Return the parser; its defaults are those of the option dataclasses."""
    parser = argparse.ArgumentParser(
        prog="blur2view",
        description="One motion-blurred photograph in, the two-view geometry of the camera's motion out.",
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    _add_estimate(commands)
    add_segment(commands)
    add_to_colmap(commands)
    add_report(commands)
    return parser


def _add_estimate(commands: Any) -> None:
    """Describe ``blur2view estimate``."""
    about = "estimate the fundamental matrix between shutter-open and shutter-close of each photograph"
    parser = commands.add_parser("estimate", help=about, description=about)
    add = parser.add_argument
    add("images", nargs="+", type=Path, metavar="IMG", help="photographs: JPEG, PNG, TIFF, ...")
    add("-o", "--output", type=Path, metavar="DIR", help="write DIR/<stem>.json, .smear.npz and .png")
    add("--overwrite", action="store_true", help="replace results of an earlier call")
    add("--json", action="store_true", help="print one JSON document instead of the summary")
    add("--exposure", type=float, metavar="S", help="exposure time in seconds (default: that of EXIF)")
    add_estimator_options(parser)
    parser.set_defaults(run=lambda options: run_estimate(options, parser.error))


def run_estimate(options: argparse.Namespace, usage_error: Callable[[str], object]) -> int:
    """Estimate every photograph; a failing one costs a line on stderr, not the others."""
    run = read_run(options, usage_error)
    plan = plan_files(options, OutputFiles)
    network = SmearNetwork(options.model)
    return run_each(
        options, plan, "estimates", lambda image, files: _estimate_one(image, files, network, run)
    )


def _estimate_one(
    path: Path, files: OutputFiles | None, network: SmearNetwork, run: Run
) -> tuple[dict[str, Any], str]:
    """Read, estimate and write one photograph; return its JSON document and its summary."""
    one = estimate_file(path, network, run)
    if files:
        write_results(files, one.facts, one.image, one.found)
    return one.facts, summary(one.facts, one.found, files)
