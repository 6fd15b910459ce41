"""A photograph and its estimate made smaller: what is found in it, in the pixels of a smaller copy."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.pipeline import Estimate
from blur2view.smears.field import SmearField


def reduced_shape(shape: tuple[int, ...], longest: int) -> tuple[int, int]:
    """Return height and width of a photograph (H, W) whose longer side is at most ``longest``, 1 at least."""
    scale = min(1.0, longest / max(shape[:2]))
    return max(round(shape[0] * scale), 1), max(round(shape[1] * scale), 1)


def reduced_image(image: NDArray[np.float32], longest: int) -> NDArray[np.float32]:
    """Reduce a photograph (H, W, 3) to a longer side of at most ``longest``; a small one is returned."""
    shape = reduced_shape(image.shape, longest)
    if shape == image.shape[:2]:
        return image
    return np.asarray(cv2.resize(image, shape[::-1], interpolation=cv2.INTER_AREA))


def reduced_estimate(found: Estimate, shape: tuple[int, int]) -> Estimate:
    """Return an estimate in the pixels of a smaller copy of the photograph.

    Parameters
    ----------
    found : Estimate
    shape : (int, int)
        Height and width of the copy.

    Returns
    -------
    Estimate
        With smears, F, H and camera of the copy; its matches, masks and pose are those of the original.
    """
    full = found.field.shape
    if shape == full:
        return found
    back = np.linalg.inv(resizing(full, shape))  # from the copy's pixels to the photograph's
    F, H = found.geometry.F, found.geometry.H
    geometry = replace(
        found.geometry,
        F=None if F is None else back.T @ F @ back,
        H=None if H is None else np.linalg.inv(back) @ H @ back,
    )
    camera = None if found.camera is None else found.camera.for_image((shape[1], shape[0]))
    return replace(found, field=reduced_field(found.field, shape), geometry=geometry, camera=camera)


def resizing(full: tuple[int, int], shape: tuple[int, int]) -> Array:
    """Return the matrix (3, 3) that maps pixels (x, y, 1) of a photograph to those of a copy of another size.

    Borders fall on borders: pixel centres are whole numbers, so corners lie at -1/2.
    """
    (height, width), (rows, columns) = full, shape
    sx, sy = columns / width, rows / height
    return np.array([[sx, 0, 0.5 * sx - 0.5], [0, sy, 0.5 * sy - 0.5], [0, 0, 1.0]])


def reduced_field(field: SmearField, shape: tuple[int, int]) -> SmearField:
    """Sample smears and sigmas at the nearest pixels of a smaller copy, in its pixels."""
    nearest = np.ix_(*(_nearest(have, want) for have, want in zip(field.shape, shape, strict=True)))
    scale = np.array([shape[1] / field.shape[1], shape[0] / field.shape[0]], np.float32)
    return SmearField(
        displacement=field.displacement[nearest] * scale,
        sigma_px=field.sigma_px[nearest] * np.float32(np.sqrt(scale.prod())),
        sigma_rad=None if field.sigma_rad is None else field.sigma_rad[nearest],
    )


def _nearest(have: int, want: int) -> NDArray[np.int_]:
    """Return the indices, of ``have``, nearest the centres of ``want`` pixels."""
    return np.minimum(((np.arange(want) + 0.5) * have / want).astype(np.int_), have - 1)
