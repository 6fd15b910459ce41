"""What the commands share: the options of the estimator, progress, one line per error."""

import argparse
import sys
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from blur2view.camera.intrinsics import Intrinsics
from blur2view.errors import Blur2ViewError
from blur2view.pipeline import Run
from blur2view.smears.sampling import SelectOptions
from blur2view.two_view.options import EstimatorOptions


def add_estimator_options(parser: argparse.ArgumentParser) -> None:
    """Describe the options that decide what is estimated; their defaults are those of the dataclasses."""
    add = parser.add_argument
    add(
        "--beta",
        type=float,
        default=SelectOptions.beta,
        metavar="SHARE",
        help="share of the smears, the most certain ones, of which "
        f"at most {SelectOptions.max_matches} are used (default: %(default)s)",
    )
    add(
        "--max-error",
        type=float,
        default=EstimatorOptions.max_error_px,
        metavar="PX",
        help="error in pixels below which a smear is an inlier, however certain it is "
        f"(default: {EstimatorOptions.max_error_px:.4g})",
    )
    add("--focal", type=float, metavar="PX", help="focal length in pixels: gives E and the pose")
    add(
        "--camera",
        metavar="CAMERA",
        help='intrinsics instead of --focal: a COLMAP camera, such as "PINHOLE 640 480 525 525 320 240", '
        'a COLMAP database "DB" or "DB:ID", or "exif" to take the focal length of EXIF for true',
    )
    add("--seed", type=int, default=0, metavar="N", help="of the random samples (default: %(default)s)")
    add(
        "--model",
        metavar="ONNX",
        help='"float": the shipped network in floating point; or a file of tools/training/export_onnx.py',
    )


def read_run(options: argparse.Namespace, usage_error: Callable[[str], object]) -> Run:
    """Turn the options into dataclasses, which check the values; a wrong one is a usage error."""
    exposure_s = getattr(options, "exposure", None)
    try:
        if options.seed < 0:
            raise ValueError(f"seed must not be negative, got {options.seed}")
        if exposure_s is not None and not 0 < exposure_s < np.inf:
            raise ValueError(f"exposure must be positive and finite, got {exposure_s}")
        return Run(
            select=SelectOptions(beta=options.beta),
            options=EstimatorOptions(max_error_px=options.max_error),
            seed=options.seed,
            intrinsics=Intrinsics(focal_px=options.focal, camera=options.camera),
            exposure_s=exposure_s,
        )
    except ValueError as error:
        usage_error(str(error))
        raise


def progress(jobs: list[Any]) -> tuple[Iterable[Any], Callable[..., None]]:
    """Return the jobs, with a progress bar where a person watches, and a print that keeps it whole."""
    if len(jobs) < 2 or not sys.stderr.isatty():
        return jobs, print
    from tqdm import tqdm  # 0.07 s, so only where it is seen

    return tqdm(jobs, unit="photo"), tqdm.write


def complain(error: Blur2ViewError, say: Callable[..., None] = print) -> None:
    """Print one line on stderr."""
    say(f"blur2view: {error}", file=sys.stderr)
