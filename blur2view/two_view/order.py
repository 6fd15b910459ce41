"""Which end of every smear is the shutter-open one under a geometry: the only place that decides it.

A rotation or a homography orders all smears. F leaves the order of most smears undecided where the camera
hardly rotates; there positive depth decides it (cheirality). Of 8 scenes of 800 smears with noise the median
share of right orders rises from 0.70, by F alone, to 0.997 for a pure translation, and from 0.96 to 0.995
for a general motion (`tests/two_view/test_order.py`). Depth needs the focal length that F was fitted with,
even if another is likelier: in 33 frames of RedKitchen without intrinsics 0.99 of the orders are right, with
1.2 times the longer side 0.87. Where the pose has no translation its rotation gives the right order to 0.9998
of the smears of 30 frames, the F beside it to 0.977.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.camera import Camera
from blur2view.geometry.epipolar import fundamental_from_pose, sampson, transfer, unit_norm
from blur2view.geometry.pose import RigidTransform, before_both, decompose_essential, rotation_flow
from blur2view.geometry.two_view_geometry import TwoViewGeometry
from blur2view.smears.matches import SmearMatches
from blur2view.two_view.constants import ASSUMED_FOCAL, BEHIND


@dataclass(frozen=True, kw_only=True, eq=False)
class EndOrder:
    """A geometry and camera, by which any smear of the photograph can be ordered."""

    camera: Camera  # known, approximate (EXIF) or assumed
    F: Array | None = None  # (3, 3); F and H are of undistorted pixels
    H: Array | None = None
    pose: RigidTransform | None = None

    def second_end_is_open(self, ends: Array, sampson_px: Array) -> NDArray[np.bool_]:
        """Return where (N,) ends[:, 1] is the shutter-open end; nowhere without F, H and pose.

        ``ends`` (N, 2, 2) are finite pixels of the photograph, ``sampson_px`` (N,) the standard deviations of
        the smears' Sampson distances, pixels.
        """
        if self.pose is not None and not self.pose.translation.any():
            rays = self.camera.rays(ends)
            flow = np.tensordot(self.pose.rotation_vector, rotation_flow(rays.mean(axis=1)), (0, 1)).T
            return np.asarray((flow * (rays[:, 1] - rays[:, 0])).sum(axis=1) < 0)
        forward = self.forward_probability(self.camera.undistorted(ends), sampson_px)
        if self.pose is None:
            return forward < 0.5
        return order_before_both(self.pose, self.camera.rays(ends), forward)[0]

    def forward_probability(self, ends: Array, sampson_px: Array) -> Array:
        """Return the probability (N,) that ends[:, 0] is open by F, or else H; one half without either.

        ``ends`` (N, 2, 2) are undistorted pixels.
        """
        error = sampson if self.F is not None else transfer
        model = self.F if self.F is not None else self.H
        if model is None:
            return np.full(len(ends), 0.5)
        ahead, behind = (error(model, side[:, 0], side[:, 1]) for side in (ends, ends[:, ::-1]))
        return 0.5 * (1 + np.tanh((behind - ahead) / (2 * sampson_px) ** 2))


def end_order(
    geometry: TwoViewGeometry, ends: Array, sampson_px: Array, camera: Camera | None, size: tuple[int, int]
) -> EndOrder:
    """Return the `EndOrder` of a geometry, given the smears that it was estimated from.

    ``ends`` (N, 2, 2) are pixels of the photograph, distorted as the camera distorts; ``sampson_px`` (N,) as
    in `EndOrder`; ``size`` is the photograph's width and height. Without a pose in the geometry it is that of
    F and the camera, by default the assumed one; without F, F is that of the pose.
    """
    camera = camera or Camera.from_focal(ASSUMED_FOCAL * max(size), size)
    F, pose, inliers = geometry.F, geometry.cam2_from_cam1, geometry.inlier_mask
    if F is None and pose is not None and pose.translation.any():
        F = fundamental_from_pose(camera.K, pose.rotation, pose.translation)
    order = EndOrder(camera=camera, F=F, H=geometry.H, pose=pose)
    if F is None or pose is not None or not inliers.any():
        return order
    forward = order.forward_probability(camera.undistorted(ends), sampson_px)
    E = camera.K.T @ F @ camera.K
    return replace(order, pose=pose_before_both(E, camera.rays(ends), forward, inliers.astype(float)))


def in_order(geometry: TwoViewGeometry, matches: SmearMatches, camera: Camera | None) -> TwoViewGeometry:
    """Return the geometry with the order of the ends, H in the same direction of time.

    So is F where the pose is a rotation alone, which decides the order.
    """
    F, H, pose = geometry.F, geometry.H, geometry.cam2_from_cam1
    if F is None and H is None:
        return geometry
    size = matches.image_size or tuple(np.ptp(matches.ends, axis=(0, 1)).astype(int) + 1)
    order = end_order(geometry, matches.ends, matches.sampson_px, camera, size)
    second = order.second_end_is_open(matches.ends, matches.sampson_px)
    fits = geometry.inlier_mask
    first, last = open_and_close(order.camera.undistorted(matches.ends[fits]), second[fits])

    def runs_back(ahead: Array, behind: Array) -> bool:
        return len(ahead) > 0 and float((behind < ahead).mean()) > 0.5

    if H is not None and runs_back(transfer(H, first, last), transfer(H, last, first)):
        H = unit_norm(np.asarray(np.linalg.inv(H), float))
    rotates = pose is not None and not pose.translation.any()
    if F is not None and rotates and runs_back(sampson(F, first, last), sampson(F, last, first)):
        F = F.T.copy()
    return replace(geometry, F=F, H=H, second_end_is_open=second)


def open_and_close(ends: Array, second_end_is_open: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Return shutter-open and shutter-close ends, (N, 2) each, of smears (N, 2, 2)."""
    index, second = np.arange(len(ends)), second_end_is_open.astype(int)
    return ends[index, second], ends[index, 1 - second]


def order_before_both(
    pose: RigidTransform, rays: Array, forward: Array
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return where ends[:, 1] is open (N,), and where the point then lies before both cameras (N,).

    ``rays`` (N, 2, 2) are the ends' x/z and y/z, ``forward`` (N,) the probability that ends[:, 0] is open by
    F. The probability of an order that puts the point behind a camera is multiplied by BEHIND.
    """
    front, back = before_both(pose, rays[:, 0], rays[:, 1]), before_both(pose, rays[:, 1], rays[:, 0])
    second = (1 - forward) * np.where(back, 1.0, BEHIND) > forward * np.where(front, 1.0, BEHIND)
    return second, np.where(second, back, front)


def pose_before_both(E: Array, rays: Array, forward: Array, weights: Array) -> RigidTransform:
    """Return the pose of E (3, 3) that puts most of the smears, by weights (N,), before both cameras.

    If several put equally many it is that of the smaller rotation. ``rays`` and ``forward`` are those of
    `order_before_both`. A pose and its inverse, with every order reversed, put equally many: one is given.
    """
    poses = decompose_essential(E)  # those of the smaller rotation first, and max() takes the first of equals
    shares = [weights @ order_before_both(pose, rays, forward)[1] for pose in poses]
    return poses[int(np.argmax(np.round(np.divide(shares, max(weights.sum(), 1e-9)), 9)))]
