"""What the commands share: the photographs, how many are gone through, the camera, the estimator."""

import argparse
from typing import Any

from blur2view.cli.arguments.help_text import add_options, paragraph

PHOTOGRAPHS = """
images INPUT: photographs, folders of photographs, videos, or lists of them as @LIST, or - from standard
    input; JPEG, PNG, TIFF, WebP and what else Pillow decodes, of 8 or 16 bits, with the extras heic and raw
    also HEIC and RAW. Frames of a video are named VIDEO/000120 by their number. A list names one of these on
    each line, as seen from here or else from the list's folder (blank lines are passed over, and those that
    begin with # and name no file). What is named twice is done once
--recursive: folders stand for their subfolders, too
--every N: of a video take one frame in N (default: all)
--from FRAME: the first frame of a video: a number from 0, or a time as 12.5s
--to FRAME: the last frame, included
"""
TABLE = """
--csv FILE: write a table with a row for each photograph; blur2view triage --help-all names its columns
"""
TIMINGS = """
--no-timings: without timings: equal calls give equal bytes
"""
STREAM = """
--json: print one JSON document instead of the summaries, see below
--jsonl: instead print the JSON document of each photograph on one line as soon as it is done, in their order;
    of one that fails image and error
"""
SEQUENCE = """
--[no-]sequence: the photographs are a video in this order: those before and after each one show which end of
    its exposure came first, so that rates are one series; with --no-sequence not even the frames of a video
    do (default: those of a video)
"""
OVERWRITE = """
--overwrite: replace results of other photographs, too (those of an earlier call of the same are anyway)
"""
VERBOSITY = """
-v, --verbose: print everything: reasons, matrices, the costs of the models, timings
-q, --quiet: print failures only
"""
MANY = """
A manifest beside the results, JSON lines, says what is done. Ctrl-C, a kill or a power cut loses only the
photographs in hand.
"""
PROCESSES = """
--jobs N: processes, of one thread each; any number gives the same bytes (default: one per core)
--dask ADDRESS: let the workers of a Dask cluster do the work, as of: dask scheduler; dask worker
    tcp://HOST:8786; --dask tcp://HOST:8786. Photographs are sent, files are written here; the workers need
    this blur2view (pip install '.[dask]'). A scheduler is trusted like a shell: who reaches it can run
    programs on the workers and here; blur2view itself listens nowhere. Not with a database's camera, nor with
    --link
"""
RUNNING = """
--resume: go on: skip photographs that an earlier call has done with the same content, network and options,
    whose results are whole; do the others, also over their earlier results
--max-failures N: stop when as many photographs have failed
"""
INTRINSICS = """
Known intrinsics give the essential matrix E and the pose. Without these options the focal length of EXIF,
where there is one, is a hint, and nothing is called calibrated. What is stated here is believed; if EXIF says
1.4 times as much or as little, a line says so.
"""
CAMERA = """
--focal PX: focal length in pixels; the principal point is the photograph's centre
--camera CAMERA: instead of --focal: a camera as COLMAP writes it, "MODEL WIDTH HEIGHT PARAMS...", for example
    "SIMPLE_RADIAL 640 480 525 320 240 0.05" (any model but EQUIRECTANGULAR, one of another size is scaled), a
    COLMAP database as "project.db" (the camera of the image of this name) or "project.db:ID", or "exif" to
    take the focal length of EXIF for true
"""
EXPOSURE = """
--exposure S: exposure time in seconds, as 0.04, 1/25 or 40ms, with --focal or --camera: the angular velocity
    is the rotation over it (default: that of EXIF)
--readout S: of a rolling shutter, with --focal or --camera: seconds from the start of exposure of the first
    row to that of the last one; rows are those of the file as stored. A point that moves with the rows is
    seen for longer, so the motion differs with the order in time: one is given, of both that which has less
    parallax, the other is backward in the JSON document
"""
SMEAR = """
A smear is the path of a scene point in the picture while the shutter was open; its two ends are a match whose
order in time is unknown.
"""
ESTIMATION = """
--beta SHARE: share, above 0 and at most 1, of the network's smears (one every 32 pixels) that may be used,
    the most certain ones; at most {max_matches} of them, spread evenly, are (default: %(default)s)
--max-error PX: a smear is an inlier if the Sampson distance of its ends from the epipolar geometry, in the
    better of both orders, is below this many pixels or below {cutoff:g} of its own standard deviations
    (default: {max_error:.4g}, the square root of the paper's 3 squared pixels)
--seed N: of the random samples, 0 or more; equal seeds give equal results (default: %(default)s)
--max-memory GIB: refuse photographs whose estimate takes more memory of its process, of which --jobs starts
    many; masks take up to half as much again (default: %(default)s, enough for 32 megapixels, with masks for
    24)
--model ONNX: a smear network, written by tools/training/export_reader.py (default: the shipped one)
"""


def add_photographs(parser: argparse.ArgumentParser) -> None:
    """Describe the photographs of a call."""
    add_options(
        parser.add_argument_group("input"),
        PHOTOGRAPHS,
        images={"nargs": "+"},
        every={"default": 1},
        **{"from": {"dest": "first", "default": 0}},
        to={"dest": "last"},
    )


def add_verbosity(group: Any) -> None:
    """Describe how much is printed."""
    level = {"action": "store_const", "dest": "verbosity"}
    either = group.add_mutually_exclusive_group()
    add_options(either, VERBOSITY, verbose={**level, "const": 1, "default": 0}, quiet={**level, "const": -1})


def add_estimating(parser: argparse.ArgumentParser, *, exposure: bool) -> None:
    """Describe what all commands that estimate have: running, the camera and the estimator.

    Without ``exposure`` no rate is asked for. Defaults are those of the options' dataclasses.
    """
    from blur2view.input_files import MAX_MEMORY_GIB
    from blur2view.robust.residuals import CUTOFF
    from blur2view.smears.selection import SelectOptions
    from blur2view.two_view.options import EstimatorOptions

    running = parser.add_argument_group("many photographs", paragraph(MANY))
    add_options(running.add_mutually_exclusive_group(), PROCESSES)
    add_options(running, RUNNING)
    add_options(parser.add_argument_group("camera", paragraph(INTRINSICS)), CAMERA + EXPOSURE * exposure)
    limits = {"max_matches": SelectOptions.max_matches, "cutoff": CUTOFF}
    add_options(
        parser.add_argument_group("estimation", paragraph(SMEAR)),
        ESTIMATION.format(**limits, max_error=EstimatorOptions.max_error_px),
        beta={"type": float, "default": SelectOptions.beta},
        max_error={"type": float, "default": EstimatorOptions.max_error_px},
        seed={"type": int, "default": 0},
        max_memory={"type": float, "default": MAX_MEMORY_GIB},
    )
