"""Two-view geometry in COLMAP's conventions: F and H of its pixels, whose halves `colmap_camera` explains."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.camera.colmap_camera import HALF_PIXEL


def fundamental_to_colmap(F: Array) -> Array:
    """Return F (3, 3) of our pixels as that of COLMAP's, of unit norm."""
    back = _shift(-HALF_PIXEL)
    shifted: Array = back.T @ F @ back
    return shifted / np.linalg.norm(shifted)


def homography_to_colmap(H: Array) -> Array:
    """Return H (3, 3) of our pixels as that of COLMAP's, of unit norm."""
    shifted: Array = _shift(HALF_PIXEL) @ H @ _shift(-HALF_PIXEL)
    return shifted / np.linalg.norm(shifted)


def _shift(offset: float) -> Array:
    """Return the matrix (3, 3) that moves pixels along both axes."""
    return np.array([[1, 0, offset], [0, 1, offset], [0, 0, 1.0]])


def rigid3d(rotation: Array, translation: Array) -> Any:
    """Return the pycolmap.Rigid3d of a rotation matrix (3, 3) and a translation (3,)."""
    import pycolmap

    return pycolmap.Rigid3d(pycolmap.Rotation3d(rotation), translation)


def colmap_two_view_geometry(
    config: str,
    inliers: NDArray[np.int_],
    *,
    F: Array | None = None,
    E: Array | None = None,
    H: Array | None = None,
    pose: tuple[Array, Array] | None = None,
) -> Any:
    """Return a pycolmap.TwoViewGeometry of index-aligned keypoints.

    ``config`` is a name of TwoViewGeometryConfiguration; ``inliers`` (M,) are indices of keypoints, the same
    in both images; F and H (3, 3) are of our pixels, E of rays, which have no half pixel; ``pose`` is
    rotation (3, 3) and translation (3,) of cam2_from_cam1.
    """
    import pycolmap

    return pycolmap.TwoViewGeometry(
        config=pycolmap.TwoViewGeometryConfiguration.__members__[config],
        inlier_matches=np.stack([inliers, inliers], axis=1).astype(np.uint32),
        F=None if F is None else fundamental_to_colmap(F),
        E=E,
        H=None if H is None else homography_to_colmap(H),
        cam2_from_cam1=None if pose is None else rigid3d(*pose),
    )
