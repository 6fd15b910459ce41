"""A camera's intrinsics and the rays of its pixels, in COLMAP's conventions.

COLMAP puts (0.5, 0.5) at the centre of the top-left pixel, blur2view puts (0, 0) there: pixels of cameras
pass through `to_colmap` and `from_colmap`, F and H through `geometry.two_view_geometry`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import cached_property
from typing import Any

import numpy as np

from blur2view.arrays import AnyArray, Array
from blur2view.errors import CameraError

HALF_PIXEL = 0.5
MAX_SIDE = 1 << 20  # pixels; far above, COLMAP's own numbers overflow
FOCAL_PX = (0.1, 1e7)  # bounds of focal lengths; a telescope of 10 m before pixels of 2 um has 5e6
FOCAL_RANGE = f"{FOCAL_PX[0]:g} to {FOCAL_PX[1]:g} px"
PINHOLES = ("SIMPLE_PINHOLE", "PINHOLE")
CAMERA_FORM = "MODEL WIDTH HEIGHT PARAMS..., for example SIMPLE_RADIAL 640 480 525 320 240 0.05"
NO_RAYS = ("INVALID", "EQUIRECTANGULAR")  # models of pycolmap whose rays do not meet a plane
OPENCV_MODELS = {0: "PINHOLE", 4: "OPENCV", 8: "FULL_OPENCV"}  # COLMAP's, by coefficients of distortion
SHORT_S, LONG_S = 1e-9, 2.0
"""Bounds of exposure times in seconds: rates of a shorter one may overflow; a longer one needs its unit,
because it is probably stated in milliseconds."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Camera:
    """Intrinsics of one camera, the same at both ends of the exposure.

    Parameters
    ----------
    K : ndarray of shape (3, 3)
        Focal lengths and principal point, pixels, (0, 0) at the centre of the top-left one; of a distorted
        camera, those of its undistorted picture. No skew. ValueError if it is not so.
    width, height : int
        Size in pixels of the camera's pictures.
    model, params : str, tuple of float
        COLMAP's name of the camera model, its parameters in COLMAP's pixels; by default a pinhole's, by K.
        CameraError if the model is unknown or has no rays in a plane, or a parameter is impossible.
    source : str
        "focal", "opencv", "camera string", "database" or "exif", and any scaling since.
    log_focal_sigma : float
        Standard deviation of the natural log of the focal length. 0: known, the geometry is calibrated.
        More: a hint, the prior of an ordinary camera's focal length; nothing is called calibrated with it.
    """

    K: Array
    width: int
    height: int
    model: str = "PINHOLE"
    params: tuple[float, ...] = ()
    source: str = "focal"
    log_focal_sigma: float = 0.0

    def __post_init__(self) -> None:
        K = np.array(self.K, np.float64)
        if K.shape != (3, 3) or not np.isfinite(K).all():
            raise ValueError(f"K must be finite and of shape (3, 3), got shape {K.shape}")
        if not min(K[0, 0], K[1, 1]) > 0 or K[0, 1] or K[1, 0] or K[2].tolist() != [0, 0, 1]:
            raise ValueError(f"K must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], fx, fy > 0, got {K.tolist()}")
        if min(self.width, self.height) < 1 or not 0 <= self.log_focal_sigma < np.inf:
            raise ValueError(f"need a positive size and log_focal_sigma >= 0, got {self}")
        object.__setattr__(self, "K", K)
        if not self.params:
            pinhole = np.concatenate([np.diag(K)[:2], to_colmap(K[:2, 2])])
            object.__setattr__(self, "params", tuple(pinhole.tolist()))
        if self.distorted:
            colmap_camera(self.model, self.width, self.height, self.params)  # which checks them

    @classmethod
    def from_focal(cls, focal_px: float, image_size: tuple[int, int], source: str = "focal") -> Camera:
        """Return a camera of square pixels, no distortion, its principal point at the centre of the image.

        Parameters
        ----------
        focal_px : float
            Focal length, pixels, 0.1 to 1e7.
        image_size : tuple of int
            Width and height, pixels.
        source : str
            Where the focal length is from.

        Returns
        -------
        Camera
            Its focal length is known, so that the geometry is calibrated.

        Raises
        ------
        ValueError
            If the focal length is out of its range, or the size is not a pair.

        Examples
        --------
        >>> from blur2view import Camera
        >>> camera = Camera.from_focal(800.0, (1281, 721))
        >>> camera.K.tolist()
        [[800.0, 0.0, 640.0], [0.0, 800.0, 360.0], [0.0, 0.0, 1.0]]
        """
        if not np.issubdtype(type(focal_px), np.number) or not possible_focal(focal_px):
            raise ValueError(f"focal length must be {FOCAL_RANGE}, got {focal_px!r}")
        width, height = _sides(image_size)
        K = np.array([[focal_px, 0, (width - 1) / 2], [0, focal_px, (height - 1) / 2], [0, 0, 1]])
        params = (float(focal_px), width / 2, height / 2)
        return cls(K=K, width=width, height=height, model="SIMPLE_PINHOLE", params=params, source=source)

    @classmethod
    def from_opencv(cls, K: AnyArray, dist: AnyArray | None, size: tuple[int, int]) -> Camera:
        """Return the camera of ``cv2.calibrateCamera``.

        Parameters
        ----------
        K : ndarray of shape (3, 3)
            Camera matrix, pixels, (0, 0) at the centre of the top-left one.
        dist : ndarray or None
            0, 4, 5 or 8 coefficients k1, k2, p1, p2[, k3[, k4, k5, k6]], in any shape.
        size : tuple of int
            Width and height of the pictures, pixels.

        Returns
        -------
        Camera
            COLMAP's PINHOLE, OPENCV or FULL_OPENCV.

        Raises
        ------
        ValueError, CameraError
            If the matrix, the coefficients or the size are not so.

        Examples
        --------
        >>> import numpy as np
        >>> from blur2view import Camera
        >>> K = np.array([[800.0, 0, 640], [0, 810, 360], [0, 0, 1]])
        >>> Camera.from_opencv(K, np.array([0.1, 0, 0, 0]), (1281, 721)).model
        'OPENCV'
        """
        coefficients = [] if dist is None else np.asarray(dist, float).ravel().tolist()
        if len(coefficients) not in (0, 4, 5, 8, 12, 14) or any(coefficients[8:]):
            raise ValueError(f"expected 0, 4, 5 or 8 distortion coefficients of OpenCV, got {coefficients}")
        width, height = _sides(size)
        pinhole = cls(K=K, width=width, height=height)  # which checks K
        count = 4 if any(coefficients) else 0
        if any(coefficients[4:]):
            count = 8
        params = (*pinhole.params, *[*coefficients, *[0.0] * 8][:count])
        return cls.from_colmap(colmap_camera(OPENCV_MODELS[count], width, height, params), "opencv")

    @classmethod
    def from_string(cls, text: str) -> Camera:
        """Return the camera of a COLMAP string: "PINHOLE 640 480 525 525 320 240", blanks or commas between.

        CameraError if it is not "MODEL WIDTH HEIGHT PARAMS..." or names no possible camera.
        """
        try:
            model, wide, high, *values = text.replace(",", " ").split()
            width, height, params = int(wide), int(high), tuple(map(float, values))
        except ValueError:
            raise CameraError(f"camera {text!r}: is not {CAMERA_FORM}") from None
        return cls.from_colmap(colmap_camera(model.upper(), width, height, params), "camera string")

    @classmethod
    def from_colmap(cls, camera: Any, source: str) -> Camera:
        """Return the camera of a pycolmap.Camera; K is that of its undistorted picture.

        CameraError if its model has no rays in a plane, or a parameter is impossible.
        """
        model, width, height = camera.model_name, camera.width, camera.height
        params = tuple(np.asarray(camera.params, float).tolist())
        K = np.array(colmap_camera(model, width, height, params).calibration_matrix(), float)
        K[:2, 2] = from_colmap(K[:2, 2])
        return cls(K=K, width=width, height=height, model=model, params=params, source=source)

    @property
    def known(self) -> bool:
        """Whether the focal length is known, so that the geometry is calibrated."""
        return self.log_focal_sigma == 0

    @property
    def distorted(self) -> bool:
        """Whether the camera model has a distortion."""
        return self.model not in PINHOLES

    @property
    def focal_px(self) -> float:
        """Geometric mean of both focal lengths, pixels."""
        return float(np.sqrt(self.K[0, 0] * self.K[1, 1]))

    @cached_property
    def _colmap(self) -> Any:
        """The same camera as a pycolmap.Camera."""
        return colmap_camera(self.model, self.width, self.height, self.params)

    def rays(self, points: Array) -> Array:
        """Return the rays x/z, y/z (..., 2) of pixels (..., 2); NaN where the model has no ray."""
        points = np.asarray(points, float)
        if self.distorted:
            return normalised_points(self._colmap, points.reshape(-1, 2)).reshape(points.shape)
        return (points - self.K[:2, 2]) / np.diag(self.K)[:2]

    def undistorted(self, points: Array) -> Array:
        """Return pixels (..., 2) as the pinhole camera K sees them; F and E hold for these."""
        if not self.distorted:
            return np.asarray(points, float)
        return self.rays(points) * np.diag(self.K)[:2] + self.K[:2, 2]

    def for_image(self, image_size: tuple[int, int]) -> Camera:
        """Return the camera of a picture that was resized to (width, height), scaled with it.

        CameraError if the aspect ratios differ by more than a pixel: a cropped or rotated picture has
        another, unknown principal point.
        """
        width, height = image_size
        if (width, height) == (self.width, self.height):
            return self
        scale = width / self.width
        if abs(height - scale * self.height) > max(1.0, scale):
            raise CameraError(
                f"camera ({self.source}) is for {self.width}x{self.height} pixels, but the photograph has "
                f"{width}x{height}: cropped, or turned by EXIF? Give the camera of this picture"
            )
        resized = colmap_camera(self.model, self.width, self.height, self.params)  # not the cached one
        resized.rescale(width, height)
        camera = Camera.from_colmap(resized, f"{self.source}, scaled by {scale:.4g}")
        return replace(camera, log_focal_sigma=self.log_focal_sigma)


def _sides(image_size: tuple[int, int]) -> tuple[int, int]:
    """Return width and height; ValueError of anything but a pair, such as the shape of an array."""
    if np.shape(image_size) != (2,):
        raise ValueError(f"the size must be (width, height), as image.shape[1::-1], got {image_size!r:.99}")
    return image_size


def to_colmap(points: Array) -> Array:
    """Return pixels (..., 2), (0, 0) at the first centre, as COLMAP's, (0.5, 0.5) there."""
    return np.asarray(points, float) + HALF_PIXEL


def from_colmap(points: Array) -> Array:
    """Return COLMAP's pixels (..., 2) with (0, 0) at the first centre."""
    return np.asarray(points, float) - HALF_PIXEL


def possible_focal(focal_px: float) -> bool:
    """Return whether a focal length is within `FOCAL_PX`; products with others over- or underflow."""
    return FOCAL_PX[0] <= focal_px <= FOCAL_PX[1]


def colmap_camera(model: str, width: int, height: int, params: tuple[float, ...]) -> Any:
    """Return a pycolmap.Camera; CameraError if the model is unknown or a value is impossible."""
    import pycolmap  # slow to import, and needed only where a camera has more than a focal length

    models = [name for name in pycolmap.CameraModelId.__members__ if name not in NO_RAYS]
    example = pycolmap.Camera.create_from_model_name(0, model, 1.0, 1, 1) if model in models else None
    if example is None:
        defect = "has no rays in a plane" if model in NO_RAYS else "is an unknown model"
        similar = "".join(f"; did you mean {name}?" for name in get_close_matches(model, models, 1))
        why = f"{model} {defect}{similar or '; known are ' + ', '.join(models)}"
    elif len(params) != len(example.params):
        numbers = f"{len(example.params)} numbers ({example.params_info})"
        why = f"after width and height {model} has {numbers}, got {len(params)}"
    elif not 1 <= min(width, height) <= max(width, height) < MAX_SIDE:
        why = f"needs a positive width and height below {MAX_SIDE} pixels"
    elif not (np.abs(params) <= FOCAL_PX[1]).all():
        why = f"needs finite parameters up to {FOCAL_PX[1]:g}"
    else:
        camera = pycolmap.Camera(model=model, width=width, height=height, params=params)
        if all(map(possible_focal, (camera.focal_length_x, camera.focal_length_y))):
            return camera
        why = f"the focal length must be {FOCAL_RANGE}"
    text = f"{model} {width} {height} {' '.join(f'{value:g}' for value in params)}".strip()
    raise CameraError(f"camera {text!r}: {why}")


def normalised_points(camera: Any, points: Array) -> Array:
    """Return rays x/z, y/z (N, 2) of pixels (N, 2), (0, 0) at the first centre; NaN where there is none."""
    # for a list of points pycolmap returns NaN where it returns None for a single point
    return np.asarray(camera.cam_from_img(to_colmap(points)), float).reshape(-1, 2)
