"""Smears: the path of each pixel during the exposure, known up to the sign of its displacement."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.floating[Any]]


@dataclass(frozen=True, kw_only=True, eq=False)
class SmearField:
    """A smear and its uncertainty at every pixel of an image.

    Parameters
    ----------
    displacement : ndarray of shape (H, W, 2), float32
        Full displacement d = end - start in pixels, (x, y); its sign is arbitrary in every pixel.
    sigma_px : ndarray of shape (H, W), float32
        Standard deviation of the end-point error |d - d*|, in pixels; not negative.
    sigma_rad : ndarray of shape (H, W), float32, optional
        Standard deviation of the smear's direction, radians; not negative. None where the network does not
        predict it.

    Raises
    ------
    ValueError
        If the shapes disagree, a value is not finite or a sigma is negative.
    """

    displacement: NDArray[np.float32]
    sigma_px: NDArray[np.float32]
    sigma_rad: NDArray[np.float32] | None = None

    def __post_init__(self) -> None:
        """Convert to float32 and check shapes and values."""
        displacement = np.asarray(self.displacement, dtype=np.float32)
        sigma_px = np.asarray(self.sigma_px, dtype=np.float32)
        if displacement.shape != (*sigma_px.shape, 2) or sigma_px.ndim != 2 or sigma_px.size == 0:
            got = f"{displacement.shape} and {sigma_px.shape}"
            raise ValueError(f"expected shapes (H, W, 2) and (H, W), got {got}")
        # min and max propagate NaN and need no temporary the size of the field
        if not np.isfinite([displacement.min(), displacement.max(), sigma_px.max()]).all():
            raise ValueError("a smear field must be finite")
        if not sigma_px.min() >= 0:
            raise ValueError(f"sigma_px must not be negative, got {sigma_px.min()}")
        object.__setattr__(self, "displacement", displacement)
        object.__setattr__(self, "sigma_px", sigma_px)
        if self.sigma_rad is not None:
            sigma_rad = np.asarray(self.sigma_rad, dtype=np.float32)
            if sigma_rad.shape != sigma_px.shape or not 0 <= sigma_rad.min() <= sigma_rad.max() < np.inf:
                raise ValueError(f"expected a sigma_rad of shape {sigma_px.shape}, finite and not negative")
            object.__setattr__(self, "sigma_rad", sigma_rad)

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the image."""
        height, width = self.sigma_px.shape
        return height, width

    @property
    def length_px(self) -> NDArray[np.float32]:
        """Length |d| of every smear, (H, W), pixels."""
        return np.hypot(self.displacement[..., 0], self.displacement[..., 1])


def to_double_angle(displacement: ArrayLike) -> Floats:
    """Return |d| (cos 2phi, sin 2phi) of displacements d (..., 2), pixels, the same for d and -d.

    Of the same length and, for floats, the same dtype; zero stays zero.
    """
    d = _vectors(displacement)
    length = np.hypot(d[..., 0], d[..., 1])
    # through the unit vector, so that squares of tiny and huge lengths neither underflow nor overflow
    x, y = np.moveaxis(d / np.where(length > 0, length, 1)[..., None], -1, 0)
    return np.stack([length * (x**2 - y**2), length * (2 * x * y)], -1)


def from_double_angle(double_angle: ArrayLike) -> Floats:
    """Return the displacements (..., 2) of vectors |d| (cos 2phi, sin 2phi), phi in (-90, 90] degrees.

    Their x is not negative, and their y is positive where x is zero.
    """
    u = _vectors(double_angle)
    length = np.hypot(u[..., 0], u[..., 1])
    phi = np.arctan2(u[..., 1] + 0.0, u[..., 0]) / 2  # + 0.0 turns -0.0 into 0.0: phi is 90, never -90
    return np.stack([length * np.cos(phi), length * np.sin(phi)], -1)


def smear_ends(points: ArrayLike, displacement: ArrayLike) -> NDArray[np.float64]:
    """Return both ends (N, 2, 2), p - d/2 and p + d/2, of smears d (N, 2) at mid-exposure pixels p (N, 2).

    Which end is the start is unknown. ValueError if the two arrays are not both (N, 2).
    """
    p = np.asarray(points, dtype=np.float64)
    half = np.asarray(displacement, dtype=np.float64) / 2
    if p.shape != half.shape or p.ndim != 2 or p.shape[1] != 2:
        raise ValueError(f"expected two arrays of shape (N, 2), got {p.shape} and {half.shape}")
    return np.stack([p - half, p + half], axis=1)


def upsample_grid(grid: NDArray[np.float32], stride: int) -> NDArray[np.float32]:
    """Return a grid of cells (h, w, C) resampled to pixels (h*stride, w*stride, C), float32.

    Cell j's centre is at pixel stride*j + (stride-1)/2; outside the outermost centres the nearest cell
    continues. Directions must be in double angle: averaging d and -d would cancel them.
    """
    if grid.ndim != 3 or stride < 1:
        raise ValueError(f"expected shape (h, w, C) and a positive stride, got {grid.shape}, {stride}")
    height, width = grid.shape[:2]
    # OpenCV's pixel centres are at integer + 0.5 of the cell, which is exactly the convention above
    resized = cv2.resize(grid, (width * stride, height * stride), interpolation=cv2.INTER_LINEAR)
    return resized.reshape(height * stride, width * stride, grid.shape[2]).astype(np.float32, copy=False)


def _vectors(values: ArrayLike) -> Floats:
    """Return a float array of shape (..., 2), keeping float32."""
    vectors = np.asarray(values)
    if vectors.ndim == 0 or vectors.shape[-1] != 2:
        raise ValueError(f"expected an array of shape (..., 2), got {vectors.shape}")
    return vectors if np.issubdtype(vectors.dtype, np.floating) else vectors.astype(np.float64)
