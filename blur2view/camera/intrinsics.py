"""The intrinsics of a photograph: those that the user states, else those of EXIF."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from blur2view.camera.camera import Camera
from blur2view.camera.colmap_camera import FOCAL_RANGE, possible_focal
from blur2view.camera.exif import ExifValues
from blur2view.errors import CameraError

EXIF_LOG_FOCAL = 0.1  # sd of log focal length from EXIF: rounded millimetres, cropped pictures


@dataclass(frozen=True, kw_only=True)
class Intrinsics:
    """The user's statement on the camera of every photograph of a call: none, a focal length or a camera.

    ValueError if both are given or the focal length is not positive, CameraError if the string is no camera.
    """

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

    @property
    def stated(self) -> str | None:
        """Return the option that states a focal length, None if it is left to EXIF."""
        if self.focal_px is not None:
            return "--focal"
        return None if self.camera in (None, "exif") else "--camera"

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
