"""Smears: the paths of pixels during the exposure, known up to the sign of their displacements."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.floating[Any]]


@dataclass(frozen=True, kw_only=True, eq=False)
class SmearField:
    """Smears and their uncertainty: of every pixel of an image, or at any points of it.

    Parameters
    ----------
    displacement : ndarray of shape (..., 2), float32
        Full displacement d = end - start in pixels, (x, y); its sign is arbitrary in every place. The shape
        before the last axis is (H, W) for all pixels, (N,) for points.
    sigma_px : ndarray of shape (...), float32
        Standard deviation of the end-point error |d - d*|, in pixels; not negative.
    sigma_rad : ndarray of shape (...), float32
        Standard deviation of the smear's direction, radians; not negative.

    Raises
    ------
    ValueError
        If the shapes disagree, a value is not finite or a sigma is negative.
    """

    displacement: NDArray[np.float32]
    sigma_px: NDArray[np.float32]
    sigma_rad: NDArray[np.float32]

    def __post_init__(self) -> None:
        displacement = np.asarray(self.displacement, dtype=np.float32)
        object.__setattr__(self, "displacement", displacement)
        for name in ("sigma_px", "sigma_rad"):
            sigma = np.asarray(getattr(self, name), dtype=np.float32)
            if displacement.shape != (*sigma.shape, 2):
                got = f"{displacement.shape} and {sigma.shape}"
                raise ValueError(f"expected a displacement (..., 2) and {name} (...), got {got}")
            # min and max propagate NaN and need no temporary the size of the field
            if sigma.size and not 0 <= sigma.min() <= sigma.max() < np.inf:
                raise ValueError(
                    f"{name} must be finite and not negative, got {sigma.min()} to {sigma.max()}"
                )
            object.__setattr__(self, name, sigma)
        if displacement.size and not np.isfinite([displacement.min(), displacement.max()]).all():
            raise ValueError("smears must be finite")

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the sigmas: height and width of the image, or the number of points."""
        return self.sigma_px.shape

    @property
    def length_px(self) -> NDArray[np.float32]:
        """Length |d| of every smear, pixels."""
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
