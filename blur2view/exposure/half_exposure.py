"""The geometry from mid-exposure to shutter-close: half of the motion from open to close.

A feature detected in the photograph itself lies in the middle of its smear. The camera is assumed to move at
constant velocity, as one screw motion: the pose of half the exposure, applied twice, is that of the whole.
`pycolmap.calibrate_view_graph`, which finds focal lengths for the global mapper, refuses a database in which
an uncalibrated pair has no F.
"""

from dataclasses import replace

import numpy as np

from blur2view.arrays import Array
from blur2view.camera.camera import Camera
from blur2view.geometry.epipolar import cross_matrix, fundamental_from_pose, symmetric_skew, unit_norm
from blur2view.geometry.pose import RigidTransform
from blur2view.geometry.rotation import rotation_matrix
from blur2view.geometry.two_view_geometry import TwoViewGeometry


def half_geometry(geometry: TwoViewGeometry, camera: Camera | None, size: tuple[int, int]) -> TwoViewGeometry:
    """Return the geometry from mid-exposure (1) to close (2), of that from open to close; without H.

    With a camera F is exactly that of the halved pose. ``size`` is width and height, pixels.
    """
    whole = geometry.cam2_from_cam1
    pose = None if whole is None else half_pose(whole)
    F = None if geometry.F is None else half_fundamental(geometry.F, size)
    if pose is not None and pose.translation.any() and camera is not None and F is not None:
        F = fundamental_from_pose(camera.K, pose.rotation, pose.translation)
    return replace(geometry, F=F, H=None, cam2_from_cam1=pose, covariance=None)


def half_pose(pose: RigidTransform) -> RigidTransform:
    """Return the pose that applied twice is this one: R^2 is its rotation, (R + I) t its translation.

    Of unit length again.
    """
    R = rotation_matrix(0.5 * pose.rotation_vector)
    t = np.asarray(np.linalg.solve(R + np.eye(3), pose.translation), np.float64)
    return RigidTransform(rotation=R, translation=t / max(float(np.linalg.norm(t)), 1e-30))


def half_fundamental(F: Array, size: tuple[int, int]) -> Array:
    """Return F (3, 3) of half the motion, to first order in the motion; of unit norm and rank 2.

    A smear d about p satisfies p^T S p + a . (d x p) = 0 up to second order, F = S + [a]x; d/2 satisfies
    that of S / 2 + [a]x. The nearest of rank 2, where the picture is of unit size.
    """
    scale = 2.0 / max(size)
    T = np.diag([scale, scale, 1.0])
    T[:2, 2] = -scale * (np.array(size, float) - 1) / 2
    back = np.linalg.inv(T)
    S, a = symmetric_skew(back.T @ F @ back)
    U, singular, Vt = np.linalg.svd(0.5 * S + cross_matrix(a))
    return unit_norm(T.T @ (U * [singular[0], singular[1], 0.0]) @ Vt @ T)
