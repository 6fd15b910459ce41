"""Where a camera with distortion shows a ray: the inverse of what the package needs."""

from typing import Any

import numpy as np

from blur2view.arrays import Array
from blur2view.camera.camera import from_colmap


def distorted_points(camera: Any, rays: Array) -> Array:
    """Our pixels (N, 2) of rays (N, 2) = (x/z, y/z): the inverse of `normalised_points`."""
    directions = np.concatenate([rays, np.ones((len(rays), 1))], axis=1)
    return from_colmap(np.asarray(camera.img_from_cam(directions), float).reshape(-1, 2))
