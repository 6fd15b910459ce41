"""What the commands share: parsers filled when they are chosen, common options, the help's format."""

import argparse
import math
from collections.abc import Callable
from typing import Any

from blur2view.cli.arguments.help_text import paragraph
from blur2view.cli.arguments.parser import CommandParser as CommandParser
from blur2view.cli.arguments.parser import output_path as output_path

LONG_S, SHORT_PX = 2.0, 100.0  # an exposure beyond, a focal length below is asked about
FILM_MM = 36.0  # width of 35-mm film


def add_photographs(parser: argparse.ArgumentParser) -> None:
    """Describe the photographs of a call."""
    group = parser.add_argument_group("input")
    add = group.add_argument
    add(
        "images",
        nargs="+",
        metavar="INPUT",
        help="photographs, folders of photographs, videos, or lists of them as @LIST, or - from standard "
        "input; JPEG, PNG, TIFF, WebP and what else Pillow decodes, of 8 or 16 bits, with the extras heic "
        "and raw also HEIC and RAW. Frames of a video are named VIDEO/000120 by their number. A list names "
        "one of these on each line, as seen from here or else from the list's folder (blank lines are passed "
        "over, and those that begin with # and name no file). What is named twice is done once",
    )
    add("--recursive", action="store_true", help="folders stand for their subfolders, too")
    add(
        "--every", type=positive, default=1, metavar="N", help="of a video take one frame in N (default: all)"
    )
    add(
        "--from",
        dest="first",
        type=frame_or_seconds,
        default=0,
        metavar="FRAME",
        help="the first frame of a video: a number from 0, or a time as 12.5s",
    )
    add("--to", dest="last", type=frame_or_seconds, metavar="FRAME", help="the last frame, included")


def add_table(add: Callable[..., Any]) -> None:
    """Describe the table of all photographs."""
    add(
        "--csv",
        type=output_path,
        metavar="FILE",
        help="write a table with a row for each photograph; blur2view triage --help-all names its columns",
    )


def add_timings(add: Callable[..., Any]) -> None:
    """Describe how results come to be equal to the byte."""
    text = "without timings: equal calls give equal bytes"
    add("--no-timings", dest="timings", action="store_false", help=text)


def add_running(parser: argparse.ArgumentParser) -> None:
    """Describe how many photographs are gone through."""
    group = parser.add_argument_group(
        "many photographs",
        paragraph(
            "A manifest beside the results, JSON lines, says what is done. Ctrl-C, a kill or a power cut "
            "loses only the photographs in hand."
        ),
    )
    add = group.add_argument
    either = group.add_mutually_exclusive_group()
    either.add_argument(
        "--jobs",
        type=positive,
        metavar="N",
        help="processes, of one thread each; any number gives the same bytes (default: one per core)",
    )
    either.add_argument(
        "--dask",
        metavar="ADDRESS",
        help="let the workers of a Dask cluster do the work, as of: dask scheduler; dask worker "
        "tcp://HOST:8786; --dask tcp://HOST:8786. Photographs are sent, files are written here; the workers "
        "need this blur2view (pip install '.[dask]'). A scheduler is trusted like a shell: who reaches it "
        "can run programs on the workers and here; blur2view itself listens nowhere. Not with a database's "
        "camera, nor with --link",
    )
    add(
        "--resume",
        action="store_true",
        help="go on: skip photographs that an earlier call has done with the same content, network and "
        "options, whose results are whole; do the others, also over their earlier results",
    )
    add("--max-failures", type=positive, metavar="N", help="stop when as many photographs have failed")


def positive(text: str) -> int:
    """Return a number of 1 or more."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be 1 or more, got {text}")
    return int(text)


def number_and_unit(text: str, *units: str) -> tuple[str, str]:
    """Return a text without the first of these units that it ends with, and that unit, empty if none."""
    unit = next((one for one in units if text.endswith(one)), "")
    return text.removesuffix(unit), unit


def seconds(text: str) -> float:
    """Return seconds, of a number, a fraction as 1/25 or milliseconds as 40ms; a long time needs its unit."""
    number, unit = number_and_unit(text, "ms", "s")
    above, slash, below = number.partition("/")
    try:
        value = float(above) / (float(below) if slash else 1.0) / (1000 if unit == "ms" else 1)
    except (ValueError, ZeroDivisionError):
        raise argparse.ArgumentTypeError(f"expected seconds as 0.04 or 1/25, got {text}") from None
    if not unit and LONG_S < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text} seconds or milliseconds? write {text}s or {text}ms")
    return value


def pixels(text: str) -> float:
    """Return a focal length in pixels; as few as millimetres would be need their unit."""
    number, unit = number_and_unit(text, "px", "mm")
    try:
        value = float(number)
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected pixels as 800, got {text}") from None
    if unit != "px" and (unit or 0 < value < SHORT_PX):
        share = f"{value:g} mm of 35-mm film are {value / FILM_MM:.2f} of the picture's width"
        doubt = f"{text} is not in pixels;" if unit else f"{text} pixels or millimetres?"
        raise argparse.ArgumentTypeError(f"{doubt} {share}; write pixels, as {value:g}px, or --camera exif")
    return value


def frame_or_seconds(text: str) -> int | float:
    """Return a frame's number, or a time in seconds as a float."""
    try:
        number = float(text.removesuffix("s")) if text.endswith("s") else int(text)
    except ValueError:
        number = -1
    if not 0 <= number < math.inf:
        raise argparse.ArgumentTypeError(f"expected a frame as 120 or a time as 12.5s, got {text}")
    return number


def add_verbosity(group: Any) -> None:
    """Describe how much is printed."""
    either = group.add_mutually_exclusive_group()
    add = either.add_argument
    add(
        "-v",
        "--verbose",
        action="store_const",
        dest="verbosity",
        const=1,
        default=0,
        help="print everything: reasons, matrices, the costs of the models, timings",
    )
    add("-q", "--quiet", action="store_const", dest="verbosity", const=-1, help="print failures only")


def add_estimating(parser: argparse.ArgumentParser, *, exposure: bool) -> None:
    """Describe what all commands that estimate have: running, the camera and the estimator."""
    add_running(parser)
    add_camera(parser, exposure=exposure)
    add_estimation(parser)


def add_camera(parser: argparse.ArgumentParser, *, exposure: bool) -> None:
    """Describe the options of the intrinsics, and of the exposure time where a rate is asked for."""
    group = parser.add_argument_group(
        "camera",
        paragraph(
            "Known intrinsics give the essential matrix E and the pose. Without these options the focal "
            "length of EXIF, where there is one, is a hint, and nothing is called calibrated. What is stated "
            "here is believed; if EXIF says 1.4 times as much or as little, a line says so."
        ),
    )
    group.add_argument(
        "--focal",
        type=pixels,
        metavar="PX",
        help="focal length in pixels; the principal point is the photograph's centre",
    )
    group.add_argument(
        "--camera",
        metavar="CAMERA",
        help='instead of --focal: a camera as COLMAP writes it, "MODEL WIDTH HEIGHT PARAMS...", for example '
        '"SIMPLE_RADIAL 640 480 525 320 240 0.05" (any model but EQUIRECTANGULAR, one of another size is '
        'scaled), a COLMAP database as "project.db" (the camera of the image of this name) or '
        '"project.db:ID", or "exif" to take the focal length of EXIF for true',
    )
    if exposure:
        group.add_argument(
            "--exposure",
            type=seconds,
            metavar="S",
            help="exposure time in seconds, as 0.04, 1/25 or 40ms, with --focal or --camera: the angular "
            "velocity is the rotation over it (default: that of EXIF)",
        )
        group.add_argument(
            "--readout",
            type=seconds,
            metavar="S",
            help="of a rolling shutter, with --focal or --camera: seconds from the start of exposure of the "
            "first row to that of the last one; rows are those of the file as stored. A point that moves "
            "with the rows is seen for longer, so the motion differs with the order in time: one is given, "
            "of both that which has less parallax, the other is backward in the JSON document",
        )


def add_estimation(parser: argparse.ArgumentParser) -> None:
    """Describe the options of the estimator; their defaults are those of its dataclasses."""
    from blur2view.input_files import MAX_MEMORY_GIB
    from blur2view.robust.residuals import CUTOFF
    from blur2view.smears.selection import SelectOptions
    from blur2view.two_view.options import EstimatorOptions

    group = parser.add_argument_group(
        "estimation",
        paragraph(
            "A smear is the path of a scene point in the picture while the shutter was open; its two ends "
            "are a match whose order in time is unknown."
        ),
    )
    add = group.add_argument
    add(
        "--beta",
        type=float,
        default=SelectOptions.beta,
        metavar="SHARE",
        help="share, above 0 and at most 1, of the network's smears (one every 32 pixels) that may be used, "
        f"the most certain ones; at most {SelectOptions.max_matches} of them, spread evenly, are "
        "(default: %(default)s)",
    )
    add(
        "--max-error",
        type=float,
        default=EstimatorOptions.max_error_px,
        metavar="PX",
        help="a smear is an inlier if the Sampson distance of its ends from the epipolar geometry, in the "
        "better of both orders, is below this many pixels or below "
        f"{CUTOFF:g} of its own standard deviations "
        f"(default: {EstimatorOptions.max_error_px:.4g}, the square root of the paper's 3 squared pixels)",
    )
    add(
        "--seed",
        type=int,
        default=0,
        metavar="N",
        help="of the random samples, 0 or more; equal seeds give equal results (default: %(default)s)",
    )
    add(
        "--max-memory",
        type=float,
        default=MAX_MEMORY_GIB,
        metavar="GIB",
        help="refuse photographs whose estimate takes more memory of its process, of which --jobs starts "
        "many; masks take up to half as much again (default: %(default)s, enough for 32 megapixels, with "
        "masks for 24)",
    )
    add(
        "--model",
        metavar="ONNX",
        help="a smear network, written by tools/training/export_reader.py (default: the shipped one)",
    )
