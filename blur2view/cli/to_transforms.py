"""The command ``blur2view to-transforms``: a model with views as transforms.json."""

import json
import os
from pathlib import Path
from typing import Any

from blur2view import __version__
from blur2view.cli.options import ToTransformsOptions
from blur2view.cli.terminal import QUIET, SHORT, plural, printable
from blur2view.colmap.transforms import transforms
from blur2view.errors import OutputError
from blur2view.output_files import check_file, prepared, unwritable, write_atomically

DONE = 0
MOTION = ("transform_matrix_start", "camera_linear_velocity")  # keys of a frame's motion, one of each dialect


def run(options: ToTransformsOptions) -> int:
    """Return the exit code, after writing the file."""
    target = options.output
    check_file(target, "file")
    images = options.photographs or target.parent / "images"
    content = transforms(
        options.model,
        dialect=options.dialect,
        images=os.path.relpath(images, target.parent),
        exposure_s=options.exposure,
    )
    if options.photographs is not None:
        _check_photographs(target, content)
    _write(target, content)
    if options.verbosity > QUIET:
        print(summary(target, content, options.verbosity))
    return DONE


def _check_photographs(target: Path, content: dict[str, Any]) -> None:
    """Refuse a folder without the photographs: instant-ngp passes over missing ones without a word."""
    paths = [Path(os.path.normpath(target.parent / frame["file_path"])) for frame in content["frames"]]
    missing = [path for path in paths if not path.is_file()]
    if missing:
        raise OutputError(
            f"{missing[0]}: no such photograph ({len(missing)} of {len(paths)} are missing); "
            "name their folder with --images"
        )


def _write(target: Path, content: dict[str, Any]) -> None:
    """Write the file whole or not at all."""
    signed = {"generator": f"blur2view {__version__}", **content}  # which `output_files.is_ours` looks for
    text = json.dumps(signed, indent=2, allow_nan=False) + "\n"
    with prepared(target.parent):
        try:
            write_atomically(target, lambda file: file.write(text.encode()))
        except OSError as error:
            raise unwritable(target.parent, error) from None


def summary(target: Path, content: dict[str, Any], verbosity: int = SHORT) -> str:
    """Return one line about the file; with -v the frames without motion, too."""
    frames = content["frames"]
    still = [frame["file_path"] for frame in frames if not any(any(frame.get(key, ())) for key in MOTION)]
    line = f"{printable(str(target))}: wrote {plural(len(frames), 'frame')}"
    if still:
        line += f", {len(still)} of them without views, as if the camera had stood still"
    if verbosity > SHORT and still:
        line += "\n  " + "\n  ".join(map(printable, still))
    return line
