"""The command ``blur2view to-transforms``: a model with views as transforms.json."""

import json
import os
from pathlib import Path
from typing import Any

from blur2view import __version__
from blur2view.cli.arguments.to_transforms import ToTransformsOptions
from blur2view.cli.terminal import QUIET, SHORT, plural, printable
from blur2view.colmap.models import pictures_of, read_model
from blur2view.colmap.transforms import PLY_KEY, point_cloud, transforms
from blur2view.errors import OutputError
from blur2view.output_files import check_file, write_files, writing

MOTION = ("transform_matrix_start", "camera_linear_velocity")  # keys of a frame's motion, one of each dialect


def run(options: ToTransformsOptions) -> int:
    """Return the exit code, after writing the file, and the points beside it where it names them."""
    target = options.output
    check_file(target, "file")
    images = options.photographs or pictures_of(options.model) or target.parent / "images"
    model = read_model(options.model)
    content = transforms(
        model,
        options.model,
        dialect=options.dialect,
        images=os.path.relpath(images, target.parent),
        exposure_s=options.exposure,
    )
    frames = _present(target, content["frames"])
    left, content = len(content["frames"]) - len(frames), content | {"frames": frames}
    signed = {"generator": f"blur2view {__version__}", **content}  # which `output_files.is_ours` looks for
    files = {target: (json.dumps(signed, indent=2, allow_nan=False) + "\n").encode()}
    if PLY_KEY in content:
        cloud = target.parent / content[PLY_KEY]
        check_file(cloud, "point cloud")
        files = {cloud: point_cloud(model), **files}
    with writing(target.parent):
        write_files(files)
    if options.verbosity > QUIET:
        print(summary(target, content, options.verbosity))
        if left:
            print(f"{printable(str(images))}: lacks {left} photographs of the model, which are left out")
    return 0


def _present(target: Path, frames: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the frames whose photographs are there; OutputError if none is."""
    paths = [Path(os.path.normpath(target.parent / frame["file_path"])) for frame in frames]
    present = [frame for frame, path in zip(frames, paths, strict=True) if path.is_file()]
    if not present:
        raise OutputError(
            f"{paths[0]}: no such photograph ({len(paths)} of {len(paths)} are missing); "
            "name their folder with --images"
        )
    return present


def summary(target: Path, content: dict[str, Any], verbosity: int = SHORT) -> str:
    """Return one line about the file; with -v the frames without motion, too."""
    frames = content["frames"]
    still = [frame["file_path"] for frame in frames if not any(any(frame.get(key, ())) for key in MOTION)]
    line = f"{printable(str(target))}: wrote {plural(len(frames), 'frame')}"
    line += f" and their points, {content[PLY_KEY]}" if PLY_KEY in content else ""
    if still:
        line += f", {len(still)} of them without views, as if the camera had stood still"
    if verbosity > SHORT and still:
        line += "\n  " + "\n  ".join(map(printable, still))
    return line
