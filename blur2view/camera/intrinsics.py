"""The intrinsics of a photograph, stated or by its EXIF, which also gives exposure time and orientation."""

import os
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import ExifTags

from blur2view.camera.camera import FOCAL_RANGE, Camera, possible_focal
from blur2view.errors import CameraError
from blur2view.input_files import open_picture, read_regular

# Diagonal of the 36 x 24 mm frame that "35 mm equivalent" refers to (CIPA DCG-001: by the diagonal).
DIAGONAL_35MM = float(np.hypot(36.0, 24.0))
ROWS_TOWARDS = {3: (0, -1), 4: (0, -1), 5: (1, 0), 6: (-1, 0), 7: (-1, 0), 8: (1, 0)}  # by Orientation
PNG_MARKS = (b"eXIf", b"Raw profile type", b"XML:com.adobe.xmp")  # what a PNG with EXIF has one of
MM_PER_UNIT = {2: 25.4, 3: 10.0, 4: 1.0}  # FocalPlaneResolutionUnit: inch, centimetre, millimetre
EXIF_LOG_FOCAL = 0.1  # sd of log focal length from EXIF: rounded millimetres, cropped pictures


@dataclass(frozen=True, kw_only=True)
class ExifValues:
    """Values of EXIF; None where there is no usable one."""

    focal_px: float | None = None  # of the photograph as it is stored, good to a few per cent
    focal_tags: str = ""  # the tags it is from
    exposure_s: float | None = None
    # direction in the upright picture in which the sensor's rows follow each other, by its orientation
    rows_towards: tuple[int, int] = (0, 1)


def read_exif(path: str | os.PathLike[str], content: bytes | None = None) -> ExifValues:
    """Return focal length, exposure time and orientation, as far as the EXIF of a photograph states them.

    The focal length is FocalLengthIn35mmFilm times the picture's diagonal over 43.27 mm, or FocalLength times
    FocalPlaneXResolution, scaled if the picture was resized since (CIPA DC-008, EXIF 2.32). ``content`` is
    that of the file, where it has been read already.
    """
    try:
        content = read_regular(path) if content is None else content
        with warnings.catch_warnings(), open_picture(content) as photo:
            warnings.simplefilter("ignore")  # Pillow warns of odd EXIF blocks
            if photo.format == "PNG" and not any(mark in content for mark in PNG_MARKS):
                return ExifValues()  # Pillow would decode the picture to see whether any comes after it
            size = photo.size
            exif = photo.getexif()
            tags = dict(exif.get_ifd(ExifTags.IFD.Exif))
            # pillow_heif turns pictures upright and keeps what the tag said
            orientation = photo.info.get("original_orientation") or exif.get(ExifTags.Base.Orientation)
    except Exception:  # Pillow raises errors of any type here; reading the picture itself names what is wrong
        return ExifValues()
    focal_px, focal_tags = _focal(tags, size)
    possible = possible_focal(focal_px)
    return ExifValues(
        focal_px=focal_px if possible else None,
        focal_tags=focal_tags if possible else "",
        exposure_s=_positive(tags, "ExposureTime"),
        rows_towards=ROWS_TOWARDS.get(orientation or 1, (0, 1)),
    )


def _focal(tags: dict[int, Any], size: tuple[int, int]) -> tuple[float, str]:
    """Return the focal length in pixels, 0 without one, and the tags it is from."""
    film_mm = _positive(tags, "FocalLengthIn35mmFilm")
    if film_mm is not None:
        return film_mm * float(np.hypot(*size)) / DIAGONAL_35MM, "FocalLengthIn35mmFilm"
    lens_mm, resolution = _positive(tags, "FocalLength"), _positive(tags, "FocalPlaneXResolution")
    unit_mm = MM_PER_UNIT.get(int(_positive(tags, "FocalPlaneResolutionUnit") or 2))
    if lens_mm is None or resolution is None or unit_mm is None:
        return 0.0, ""
    taken = max(_positive(tags, "ExifImageWidth") or 0, _positive(tags, "ExifImageHeight") or 0)
    resized = max(size) / taken if taken else 1.0
    return lens_mm * resolution / unit_mm * resized, "FocalLength, FocalPlaneXResolution"


def _positive(tags: dict[int, Any], name: str) -> float | None:
    try:
        value = float(tags[ExifTags.Base[name].value])
    except (KeyError, TypeError, ValueError, ZeroDivisionError):
        return None
    return value if 0 < value < np.inf else None


@dataclass(frozen=True, kw_only=True)
class Intrinsics:
    """The user's statement on the camera of every photograph of a call: none, a focal length or a camera."""

    focal_px: float | None = None
    camera: str | Callable[[Path], Camera] | None = None
    """A COLMAP string, "exif", or what looks it up by a photograph's path: `colmap.cameras.StoredCamera`."""

    def __post_init__(self) -> None:
        if self.focal_px is not None and self.camera is not None:
            raise ValueError("give a focal length or a camera, not both")
        if self.focal_px is not None and not possible_focal(self.focal_px):
            raise ValueError(f"focal length must be {FOCAL_RANGE}, got {self.focal_px}")
        if isinstance(self.camera, str) and self.camera != "exif":
            Camera.from_string(self.camera)

    def of(self, path: Path, image_size: tuple[int, int], exif: ExifValues) -> Camera | None:
        """Return the camera of one photograph; ``image_size`` is its width and height, upright.

        Without instructions EXIF's focal length, if there is one, is a hint; "exif" takes it for true.
        CameraError if EXIF is asked for and has none, a database cannot be used, or the size does not fit.
        """
        if self.focal_px is not None:
            return Camera.from_focal(self.focal_px, image_size)
        if self.camera is None or self.camera == "exif":
            if exif.focal_px is not None:
                camera = Camera.from_focal(exif.focal_px, image_size, f"exif ({exif.focal_tags})")
                return camera if self.camera else replace(camera, log_focal_sigma=EXIF_LOG_FOCAL)
            if self.camera is None:
                return None
            raise CameraError(f"{path}: EXIF names no focal length; give it with --focal PX")
        camera = Camera.from_string(self.camera) if isinstance(self.camera, str) else self.camera(path)
        try:
            return camera.for_image(image_size)
        except CameraError as error:
            raise CameraError(f"{path}: {error}") from None
