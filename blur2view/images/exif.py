"""What EXIF states of a photograph's camera: focal length, exposure time, direction of the rows."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from PIL import ExifTags, Image

from blur2view.camera import SHORT_S, Camera, possible_focal

# Diagonal of the 36 x 24 mm frame that "35 mm equivalent" refers to (CIPA DCG-001: by the diagonal).
DIAGONAL_35MM = float(np.hypot(36.0, 24.0))
MM_PER_UNIT = {2: 25.4, 3: 10.0, 4: 1.0}  # FocalPlaneResolutionUnit: inch, centimetre, millimetre
EXIF_LOG_FOCAL = 0.1  # standard deviation of EXIF's log focal length (bound): rounded, or of cropped pictures
ROWS_TOWARDS = {3: (0, -1), 4: (0, -1), 5: (1, 0), 6: (-1, 0), 7: (-1, 0), 8: (1, 0)}  # by Orientation


@dataclass(frozen=True, kw_only=True)
class ExifValues:
    """Values of EXIF; None where there is no usable one."""

    focal_px: float | None = None  # of the photograph as it is stored, good to a few per cent
    focal_tags: str = ""  # the tags from which it is computed
    exposure_s: float | None = None
    # direction in the upright picture in which the sensor's rows follow each other, by its orientation
    rows_towards: tuple[int, int] = (0, 1)

    def camera(
        self, image_size: tuple[int, int], *, log_focal_sigma: float = EXIF_LOG_FOCAL
    ) -> Camera | None:
        """Return the camera of this focal length for an upright picture, None without a focal length.

        ``image_size`` is (width, height); by default the camera is a hint, with a ``log_focal_sigma`` of 0
        it is taken for true.
        """
        if self.focal_px is None:
            return None
        camera = Camera.from_focal(self.focal_px, image_size, f"exif ({self.focal_tags})")
        return replace(camera, log_focal_sigma=log_focal_sigma)


def read_exif(photo: Image.Image) -> ExifValues:
    """Return focal length, exposure time and direction of rows, as far as a picture's EXIF states them.

    The focal length is FocalLengthIn35mmFilm times the picture's diagonal over 43.27 mm, or FocalLength times
    FocalPlaneXResolution, scaled if the picture was resized since (CIPA DC-008, EXIF 2.32).
    """
    try:
        exif = photo.getexif()
        tags = dict(exif.get_ifd(ExifTags.IFD.Exif))
        # pillow_heif turns pictures upright and keeps what the tag said
        orientation = photo.info.get("original_orientation") or exif.get(ExifTags.Base.Orientation)
    except Exception:  # Pillow raises errors of any type here; reading the picture itself names what is wrong
        return ExifValues()
    focal_px, focal_tags = _focal(tags, photo.size)
    return ExifValues(
        focal_px=focal_px,
        focal_tags=focal_tags,
        exposure_s=_positive(tags, "ExposureTime", SHORT_S),
        rows_towards=ROWS_TOWARDS.get(orientation or 1, (0, 1)),
    )


def _focal(tags: dict[int, Any], size: tuple[int, int]) -> tuple[float | None, str]:
    """Return the focal length, pixels, and its tags; None and no tags without a possible one."""
    lens_mm, resolution = _positive(tags, "FocalLength"), _positive(tags, "FocalPlaneXResolution")
    unit_mm = MM_PER_UNIT.get(int(_positive(tags, "FocalPlaneResolutionUnit") or 2))
    focal_px, names = 0.0, ""
    if (film_mm := _positive(tags, "FocalLengthIn35mmFilm")) is not None:
        focal_px, names = film_mm * float(np.hypot(*size)) / DIAGONAL_35MM, "FocalLengthIn35mmFilm"
    elif lens_mm is not None and resolution is not None and unit_mm is not None:
        side_when_taken = max(_positive(tags, "ExifImageWidth") or 0, _positive(tags, "ExifImageHeight") or 0)
        focal_px = lens_mm * resolution / unit_mm * (max(size) / side_when_taken if side_when_taken else 1.0)
        names = "FocalLength, FocalPlaneXResolution"
    return (focal_px, names) if possible_focal(focal_px) else (None, "")


def _positive(tags: dict[int, Any], name: str, above: float = 0.0) -> float | None:
    """Return the finite value of a tag that is above a bound; None of any other."""
    try:
        value = float(tags[ExifTags.Base[name].value])
    except (KeyError, TypeError, ValueError, ZeroDivisionError):
        return None
    return value if above < value < np.inf else None
