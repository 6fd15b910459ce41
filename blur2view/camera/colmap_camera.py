"""COLMAP's conventions in one place: its pixels, its camera models, F and H of its pixels.

COLMAP puts (0.5, 0.5) at the centre of the top-left pixel, we put (0, 0) there. Every number that goes to or
comes from COLMAP passes through this module. Camera models are those that pycolmap knows, all but
EQUIRECTANGULAR, which has no rays in a plane: another of COLMAP's works without a line here;
`colmap.transforms` names those that readers of transforms.json know.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.errors import CameraError

HALF_PIXEL = 0.5
COLMAP_FROM_PIXEL, PIXEL_FROM_COLMAP = (
    np.array([[1, 0, half], [0, 1, half], [0, 0, 1.0]]) for half in (HALF_PIXEL, -HALF_PIXEL)
)
MAX_SIDE = 1 << 20  # pixels; COLMAP's own numbers overflow far above
FOCAL_PX = (0.1, 1e7)  # focal lengths of cameras; a telescope of 10 m before pixels of 2 um has 5e6
FOCAL_RANGE = f"{FOCAL_PX[0]:g} to {FOCAL_PX[1]:g} px"


def to_colmap(points: Array) -> Array:
    """Return pixels (..., 2), (0, 0) at the first centre, as COLMAP's, (0.5, 0.5) there."""
    return np.asarray(points, float) + HALF_PIXEL


def from_colmap(points: Array) -> Array:
    """Return COLMAP's pixels (..., 2) with (0, 0) at the first centre."""
    return np.asarray(points, float) - HALF_PIXEL


def possible_focal(focal_px: float) -> bool:
    """Return whether a camera may have this focal length; others over- or underflow in products."""
    return FOCAL_PX[0] <= focal_px <= FOCAL_PX[1]


def parse_camera(text: str) -> tuple[str, int, int, tuple[float, ...]]:
    """Return the parts of a COLMAP camera string, "MODEL WIDTH HEIGHT PARAMS...", blanks or commas between.

    As written: `colmap_camera` checks them. CameraError if the string is not of that form.
    """
    try:
        model, width, height, *params = text.replace(",", " ").split()
        return model.upper(), int(width), int(height), tuple(map(float, params))
    except ValueError:
        form = "MODEL WIDTH HEIGHT PARAMS..., for example SIMPLE_RADIAL 640 480 525 320 240 0.05"
        raise CameraError(f"camera {text!r}: is neither a database nor of the form {form}") from None


def colmap_camera(model: str, width: int, height: int, params: tuple[float, ...]) -> Any:
    """Return the pycolmap.Camera; CameraError if the model is unknown or a parameter cannot be."""
    import pycolmap  # 0.7 s, so only where a camera has more than a focal length

    known = [name for name in pycolmap.CameraModelId.__members__ if name != "INVALID"]
    made = pycolmap.Camera.create_from_model_name(0, model, 1.0, 1, 1) if model in known else None
    if made is None:
        why = f"unknown model {model}; COLMAP's are {', '.join(known)}"
    elif len(params) != len(made.params):
        why = f"{model} has the parameters {made.params_info}, got {len(params)} values"
    elif not 1 <= min(width, height) <= max(width, height) < MAX_SIDE:
        why = f"needs a positive width and height below {MAX_SIDE} pixels"
    elif not (np.abs(params) <= FOCAL_PX[1]).all() or model == "EQUIRECTANGULAR":
        why = f"needs finite parameters up to {FOCAL_PX[1]:g} and a planar image"
    else:
        camera = pycolmap.Camera(model=model, width=width, height=height, params=params)
        if all(map(possible_focal, (camera.focal_length_x, camera.focal_length_y))):
            return camera
        why = f"the focal length must be {FOCAL_RANGE}"
    text = f"{model} {width} {height} {' '.join(f'{value:g}' for value in params)}".strip()
    raise CameraError(f"camera {text!r}: {why}")


def normalised_points(camera: Any, points: Array) -> Array:
    """Return rays (N, 2) = (x/z, y/z) of our pixels (N, 2); NaN where the model cannot be inverted."""
    # a point list comes back with NaN where a single point gives None
    return np.asarray(camera.cam_from_img(to_colmap(points)), float).reshape(-1, 2)


def fundamental_to_colmap(F: Array) -> Array:
    """Return F (3, 3) of our pixels as that of COLMAP's, of unit norm."""
    shifted: Array = PIXEL_FROM_COLMAP.T @ F @ PIXEL_FROM_COLMAP
    return shifted / np.linalg.norm(shifted)


def homography_to_colmap(H: Array) -> Array:
    """Return H (3, 3) of our pixels as that of COLMAP's, of unit norm."""
    shifted: Array = COLMAP_FROM_PIXEL @ H @ PIXEL_FROM_COLMAP
    return shifted / np.linalg.norm(shifted)


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
        cam2_from_cam1=None if pose is None else pycolmap.Rigid3d(pycolmap.Rotation3d(pose[0]), pose[1]),
    )
