"""Pose of an F by the true camera, and how far it is from the truth; up to the flip of time."""

import numpy as np

from blur2view.arrays import Array
from blur2view.geometry.epipolar import homogeneous
from blur2view.geometry.pose import RigidTransform, before_both, decompose_essential
from blur2view.geometry.sampson import swapped_order
from tools.metrics import rotation_error

NO_POSE_DEG = 180.0  # the error of no answer


def pose_error_deg(F: Array, K: Array, R: Array, t: Array, ends: Array) -> float:
    """Return the larger error of rotation and directed translation that F implies, degrees in [0, 180].

    Both flips of time are tried, F with the order it gives the matches and its transpose with the opposite;
    each gets its pose by cheirality; the smaller error counts.

    ``K``, ``R``, ``t`` are the true camera and ``cam2_from_cam1``, ``ends`` (N, 2, 2) observed matches for
    the test of cheirality; their order is not used.
    """
    swapped = swapped_order(F, ends)[:, None, None]
    ordered = np.where(swapped, ends[:, ::-1], ends)
    flips = (F, ordered), (F.T, ordered[:, ::-1])
    return min(_directed_error_deg(pose_of(G, K, points), R, t) for G, points in flips)


def _directed_error_deg(pose: RigidTransform, R_true: Array, t_true: Array) -> float:
    t = pose.translation
    between = np.degrees(np.arctan2(np.linalg.norm(np.cross(t, t_true)), t @ t_true))
    return max(rotation_error(pose.rotation @ R_true.T, np.eye(3))[0], float(between))


def pose_of(F: Array, K: Array, ordered: Array) -> RigidTransform:
    """Return the decomposition of K^T F K that has most points before both cameras.

    ``ordered`` (N, 2, 2) holds the points in view 1 and in view 2, pixels.
    """
    rays = (homogeneous(ordered) @ np.linalg.inv(K).T)[..., :2]  # (N, 2, 2)
    poses = decompose_essential(K.T @ F @ K)
    return max(poses, key=lambda pose: int(before_both(pose, rays[:, 0], rays[:, 1]).sum()))


def pose_auc(errors_deg: Array, bound_deg: float) -> float:
    """Return the area under the recall curve of the pose error up to a bound, over the bound."""
    gain = np.clip(1 - np.asarray(errors_deg, float) / bound_deg, 0, None)
    return float(gain.mean()) if len(gain) else 0.0
