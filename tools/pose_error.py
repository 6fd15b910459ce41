"""Pose of an F by the true camera, and how far it is from the truth; up to the flip of time."""

from __future__ import annotations

import numpy as np

from blur2view.epipolar import TINY, Array, homogeneous, swapped_order
from blur2view.metrics import rotation_error

NO_POSE_DEG = 180.0  # the error of no answer
QUARTER_TURN: Array = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])


def pose_error_deg(F: Array, K: Array, R: Array, t: Array, ends: Array) -> float:
    """Pose error of F, degrees in [0, 180]: the larger of the rotation's and the directed translation's.

    Both flips of time are tried, F with the order it gives the matches and its transpose with the opposite;
    each gets its pose by cheirality; the smaller error counts.

    Parameters
    ----------
    F : ndarray of shape (3, 3)
    K, R, t : ndarray
        The true camera and ``cam2_from_cam1``.
    ends : ndarray of shape (N, 2, 2)
        Observed matches for the test of cheirality; their order is not used.
    """
    swapped = swapped_order(F, ends)[:, None, None]
    ordered = np.where(swapped, ends[:, ::-1], ends)
    flips = (F, ordered), (F.T, ordered[:, ::-1])
    return min(_directed_error_deg(*pose_of(G, K, points), R, t) for G, points in flips)


def _directed_error_deg(R: Array, t: Array, R_true: Array, t_true: Array) -> float:
    between = np.degrees(np.arctan2(np.linalg.norm(np.cross(t, t_true)), t @ t_true))
    return max(rotation_error(R @ R_true.T, np.eye(3))[0], float(between))


def pose_of(F: Array, K: Array, ordered: Array) -> tuple[Array, Array]:
    """Give R (3, 3) and unit t (3,), the decomposition of K^T F K with most points before both cameras.

    ``ordered`` (N, 2, 2) holds the points in view 1 and in view 2, pixels.

    References
    ----------
    Hartley and Zisserman, Multiple View Geometry, 2nd ed., result 9.19.
    """
    U, _, Vt = np.linalg.svd(K.T @ F @ K)
    U, Vt = U * np.sign(np.linalg.det(U)), Vt * np.sign(np.linalg.det(Vt))
    rays = homogeneous(ordered) @ np.linalg.inv(K).T  # (N, 2, 3)
    poses = [(U @ W @ Vt, sign * U[:, 2]) for W in (QUARTER_TURN, QUARTER_TURN.T) for sign in (1.0, -1.0)]
    return max(poses, key=lambda pose: int(before_both(pose[0], pose[1], rays).sum()))


def before_both(R: Array, t: Array, rays: Array) -> np.ndarray:
    """Mark the rays (N, 2, 3) that meet, nearly, at positive depth: depth2 y = depth1 R x + t."""
    x, y = rays[:, 0] @ R.T, rays[:, 1]
    normal = np.cross(y, x)
    scale = np.maximum((normal**2).sum(axis=1), TINY)
    depth1 = (np.cross(t, y) * normal).sum(axis=1) / scale
    depth2 = (np.cross(t, x) * normal).sum(axis=1) / scale
    return np.asarray((depth1 > 0) & (depth2 > 0))


def pose_auc(errors_deg: Array, bound_deg: float) -> float:
    """Area under the recall curve of the pose error up to a bound, over the bound: 1 if all errors are 0."""
    gain = np.clip(1 - np.asarray(errors_deg, float) / bound_deg, 0, None)
    return float(gain.mean()) if len(gain) else 0.0
