"""Copies of dull photographs for COLMAP's features, because SIFT finds too few under water and in the dark.

Of 16 frames of a submarine robot, whose greys reach from 20 to 120, COLMAP registers none with
`blurred_options`, and all 16 of their copies, at 0.6 px (with its default options 2)::

    frames, copies = "frames", "copies"
    blur2view.write_stretched(frames, copies)
    features, matching = blur2view.blurred_options()
    pycolmap.extract_features("project.db", copies, extraction_options=features)
    pycolmap.match_exhaustive("project.db", matching_options=matching)
    pycolmap.incremental_mapping("project.db", frames, "models")
"""

import os
import shutil
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from blur2view.arrays import white_level
from blur2view.errors import ImageError, OutputError
from blur2view.exposure.sequence import frame_names
from blur2view.files import open_picture
from blur2view.images.image import read_content, read_picture
from blur2view.output import unwritable

# Between the 1 and 99 % quantiles of the greys, of 255: 65 to 82 in shared/data/underwater, 202 to 217 in
# RedKitchen, 161 to 244 in Kodak's photographs
MIN_RANGE = 128
CONTRAST_LIMIT, TILES = 4.0, (8, 8)  # of cv2.createCLAHE
JPEG_QUALITY = 98


def write_stretched(
    frames: str | os.PathLike[str], folder: str | os.PathLike[str], names: Sequence[str] | None = None
) -> tuple[str, ...]:
    """Write the photographs of a folder to another one, the contrast of dull ones stretched.

    The copies keep the names of the photographs. Those of dull photographs are grey and keep the EXIF data;
    those of all others are links.

    Parameters
    ----------
    frames : path
        Folder of photographs.
    folder : path
        Where the copies go; what is there is not replaced.
    names : sequence of str, optional
        Paths in ``frames``; by default all photographs in it and below it.

    Returns
    -------
    tuple of str
        The names of the photographs that were stretched: those whose greys use less than half of the range.

    Raises
    ------
    ImageError
        If a photograph cannot be read, or is dull and RAW, which cannot be written.
    OutputError
        If a file exists, or cannot be written.

    References
    ----------
    Zuiderveld, Contrast limited adaptive histogram equalization, Graphics Gems IV, 1994.

    Examples
    --------
    >>> from blur2view import write_stretched
    >>> write_stretched("models", "copies", ["desk.jpg", "sample.jpg"])  # none is dull
    ()
    """
    frames, folder, stretched = Path(frames), Path(folder), []
    for name in frame_names(frames) if names is None else names:
        target = folder / name
        if os.path.lexists(target):
            raise OutputError(f"{target}: already exists; name another folder for the copies")
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            if _write_if_dull(frames / name, target):
                stretched.append(name)
            else:
                _link(frames / name, target)
        except (OSError, ValueError) as error:  # ValueError: of EXIF data that Pillow does not write
            why = error if isinstance(error, OSError) else OSError(0, str(error))
            raise unwritable(target.parent, why) from None
    return tuple(stretched)


def _write_if_dull(path: Path, target: Path) -> bool:
    """Write a photograph's copy if its greys use little of their range; return whether they do."""
    content = read_content(path)
    pixels = read_picture(path, as_stored=True, content=content).pixels
    grey = np.asarray(cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY) / (white_level(pixels) / 255), np.uint8)
    low, high = np.quantile(grey[::2, ::2], [0.01, 0.99])
    if high - low >= MIN_RANGE:
        return False
    picture = Image.fromarray(np.asarray(cv2.createCLAHE(CONTRAST_LIMIT, TILES).apply(grey), np.uint8))
    if target.suffix.lower() not in Image.registered_extensions():
        raise ImageError(
            f"{path}: has little contrast, and its copy cannot be a {target.suffix} file; "
            f"develop it to JPEG or PNG"
        )
    picture.save(target, quality=JPEG_QUALITY, exif=open_picture(content).getexif().tobytes())
    return True


def _link(path: Path, target: Path) -> None:
    """Make a link, or a copy where the file system has no links."""
    try:
        target.symlink_to(path.absolute())
    except OSError:
        shutil.copyfile(path, target)
