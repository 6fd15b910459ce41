"""Which end of a smear is the open one, under an estimated motion.

A rotation alone orders all: where RedKitchen's pose has no translation 0.9998 of the smears of 30 frames
right, the F beside it 0.977. F alone leaves the order of most smears ambiguous where the camera hardly
rotates. Cheirality decides it, for which a roughly right focal length is enough: on 8 scenes each of 800
disturbed smears right orders rose from 0.58 to 0.99 in the median for a pure translation, from 0.96 to 1.00
for a general motion (tests/exposure/test_end_order.py).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.camera.camera import Camera
from blur2view.geometry.epipolar import transfer
from blur2view.geometry.pose import RigidTransform, order_before_both, oriented_pose
from blur2view.geometry.rotation import against_rotation
from blur2view.geometry.sampson import sampson
from blur2view.geometry.two_view_geometry import TwoViewGeometry

GUESSED_FOCAL = 1.2  # of the longer side, as COLMAP guesses; cheirality needs no better


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionOrder:
    """A motion, by which any smear of its photograph can be ordered."""

    geometry: TwoViewGeometry
    camera: Camera  # known, approximate (EXIF) or guessed
    pose: RigidTransform | None  # of that camera; None leaves the order to F or H alone

    def swapped(self, ends: Array, sampson_px: Array) -> NDArray[np.bool_]:
        """Return which smears (N,) have ends[:, 1] as their open end; none where neither F nor H is known.

        ``ends`` (N, 2, 2) are finite pixels, ``sampson_px`` (N,) deviations of their Sampson distances.
        """
        if self.pose is not None and not self.pose.translation.any():
            return against_rotation(self.pose.rotation_vector, self.camera.rays(ends))
        forward = forward_share(self.geometry, self.camera.undistorted(ends), sampson_px)
        if self.pose is None or self.geometry.F is None:
            return forward < 0.5
        return order_before_both(self.pose, self.camera.rays(ends), forward)[0]


def open_and_close(ends: Array, swapped: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Return open and close ends (N, 2) of smears whose ends[:, 1] are open where ``swapped`` (N,)."""
    first, second, other = ends[:, 0], ends[:, 1], swapped[:, None]
    return np.where(other, second, first), np.where(other, first, second)


def motion_order(
    geometry: TwoViewGeometry, ends: Array, sampson_px: Array, camera: Camera | None, size: tuple[int, int]
) -> MotionOrder:
    """Return the motion to order smears by: that of F, where the pose is not known.

    ``ends`` (N, 2, 2) and ``sampson_px`` (N,) are of the smears that it was estimated from. Without a camera
    the focal length is the one that COLMAP guesses; ``size`` is width and height of the photograph, pixels.
    """
    camera = camera or Camera.from_focal(GUESSED_FOCAL * max(size), size, "guess")
    pose = geometry.cam2_from_cam1
    if pose is not None or geometry.F is None or len(ends) == 0:
        return MotionOrder(geometry=geometry, camera=camera, pose=pose)
    E, inliers = camera.K.T @ geometry.F @ camera.K, geometry.inlier_mask.astype(float)
    forward = forward_share(geometry, camera.undistorted(ends), sampson_px)
    pose = oriented_pose(E, camera.rays(ends), forward, inliers).pose
    return MotionOrder(geometry=geometry, camera=camera, pose=pose)


def forward_share(geometry: TwoViewGeometry, ends: Array, sampson_px: Array) -> Array:
    """Return the probability (N,) that ends[:, 0] is open, by F or H alone; one half without either."""
    sides = ends, ends[:, ::-1]
    if geometry.F is not None:
        ahead, behind = (sampson(geometry.F, side[:, 0], side[:, 1]) for side in sides)
    elif geometry.H is not None:
        ahead, behind = (transfer(geometry.H, side[:, 0], side[:, 1]) for side in sides)
    else:
        return np.full(len(ends), 0.5)
    return 0.5 * (1 + np.tanh((behind - ahead) / (2 * sampson_px) ** 2))
