"""Measures of smears, of F and of poses: arrays in, arrays out."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blur2view.arrays import TINY, AnyArray, Array
from blur2view.geometry.epipolar import epipoles, homogeneous, sampson, serrmin
from blur2view.geometry.pose import (
    PoseCovariance,
    RigidTransform,
    before_both,
    decompose_essential,
    rotation_vector,
)

CHI_SQUARED_90 = {2: 4.605, 3: 6.251, 5: 9.236}  # 90 % quantiles by degrees of freedom
DIRECTION_MIN_PX = 4.0  # true length from which directions and length ratios are judged
NO_POSE_DEG = 180.0  # the error of no answer
PAPER_INLIER = 3.0  # SErrMin in squared pixels below which the paper counts an inlier


def epe_s(displacement: ArrayLike, true_displacement: ArrayLike) -> Array:
    """EPE-S = min(|d - d*|, |d + d*|): end-point error of smears (..., 2) of unknown sign, pixels."""
    d, truth = np.asarray(displacement, float), np.asarray(true_displacement, float)
    return np.asarray(np.minimum(np.linalg.norm(d - truth, axis=-1), np.linalg.norm(d + truth, axis=-1)))


def direction_error_deg(displacement: ArrayLike, true_displacement: ArrayLike) -> Array:
    """Angle between undirected smears (..., 2), degrees in [0, 90]; 0 where one of them is zero."""
    d, truth = np.asarray(displacement, float), np.asarray(true_displacement, float)
    cross = np.abs(d[..., 0] * truth[..., 1] - d[..., 1] * truth[..., 0])
    return np.asarray(np.degrees(np.arctan2(cross, np.abs((d * truth).sum(-1)))))


def sparsification_area(error: ArrayLike, sigma: ArrayLike, steps: int = 100) -> float:
    """Return the area between the sparsification curves by sigma (N,) and by the error (N,) itself (AUSE).

    A curve is the mean error of what is left after removing the least certain shares, over that of all; the
    area is 0 for a sigma that ranks like the error. Ilg et al., ECCV 2018.
    """
    error, sigma = np.asarray(error, float), np.asarray(sigma, float)
    left = np.maximum(np.rint((1 - np.arange(steps) / steps) * len(error)).astype(int), 1)
    by_sigma, by_error = (
        np.cumsum(error[np.argsort(key, kind="stable")])[left - 1] / left for key in (sigma, error)
    )
    return float((by_sigma - by_error).mean() / max(float(error.mean()), np.finfo(float).tiny))


def rho(F: Array, ends: Array) -> Array:
    """sqrt(SErrMin) / |d|, (..., N), of smears' ends (N, 2, 2): the error of F per length of smear.

    On true smears the true F gives 0; a smear of no length counts as 1e-6 px long.
    """
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=-1)
    return np.asarray(np.sqrt(serrmin(F, ends)) / np.maximum(length, 1e-6))


def epipole_angle_deg(F: Array, F_true: Array, K: Array) -> float:
    """Mean angle between the epipoles' rays by ``K``, degrees in [0, 90]; the better of F and F^T."""
    inverse = np.linalg.inv(K)
    found, true = (np.stack([inverse @ e for e in epipoles(f)]) for f in (F, F_true))
    found, true = (rays / np.linalg.norm(rays, axis=1, keepdims=True) for rays in (found, true))
    cosines = [np.clip(np.abs((rays * true).sum(1)), 0, 1) for rays in (found, found[::-1])]
    return float(min(np.degrees(np.arccos(one)).mean() for one in cosines))


def rotation_error(R: Array, R_true: Array) -> tuple[float, float]:
    """Rotation error in degrees, and over the true rotation's angle; the better of R and R^T."""
    one, other, true = (
        float(np.degrees(np.linalg.norm(rotation_vector(turn))))
        for turn in (R @ R_true.T, R.T @ R_true.T, R_true)
    )
    return min(one, other), min(one, other) / max(true, TINY)


def translation_direction_error_deg(t: Array, t_true: Array) -> float:
    """Angle between undirected translations (3,), degrees in [0, 90]; 90 if the first is zero."""
    if not np.linalg.norm(t) > 0:
        return 90.0
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(t, t_true)), abs(float(np.dot(t, t_true))))))


def pose_error_deg(F: Array, K: Array, R: Array, t: Array, ends: Array) -> float:
    """Return the larger error of rotation and directed translation that F implies, degrees in [0, 180].

    ``K``, ``R``, ``t`` are the true camera and ``cam2_from_cam1``. F orders the ends (N, 2, 2) of the
    matches by their Sampson distances, and F^T the other way; of both, each with its pose by cheirality, the
    smaller error counts.
    """
    back = sampson(F, ends[:, 1], ends[:, 0]) < sampson(F, ends[:, 0], ends[:, 1])
    ordered = np.where(back[:, None, None], ends[:, ::-1], ends)
    errors = []
    for G, points in ((F, ordered), (F.T, ordered[:, ::-1])):
        pose = pose_of(G, K, points)
        across, along = np.linalg.norm(np.cross(pose.translation, t)), pose.translation @ t
        turned, _ = rotation_error(pose.rotation @ R.T, np.eye(3))
        errors.append(max(turned, float(np.degrees(np.arctan2(across, along)))))
    return min(errors)


def pose_of(F: Array, K: Array, ordered: Array) -> RigidTransform:
    """Return the decomposition of K^T F K that has most points (N, 2, 2), pixels, before both cameras."""
    rays = (homogeneous(ordered) @ np.linalg.inv(K).T)[..., :2]  # (N, 2, 2)
    poses = decompose_essential(K.T @ F @ K)
    return max(poses, key=lambda pose: int(before_both(pose, rays[:, 0], rays[:, 1]).sum()))


def pose_auc(errors_deg: Array, bound_deg: float) -> float:
    """Return the area under the recall curve of the pose error up to a bound, over the bound."""
    return float(np.clip(1 - np.asarray(errors_deg, float) / bound_deg, 0, None).mean())


def squared_distance(
    covariance: PoseCovariance, pose: RigidTransform, true: RigidTransform, part: slice = slice(0, 5)
) -> float:
    """Return the squared Mahalanobis distance of a pose to the true one, or to its inverse if that is nearer.

    ``part`` slices the five parameters: ``slice(0, 3)`` for the rotation, ``slice(3, 5)`` for the
    translation's direction. Compare with `CHI_SQUARED_90`.
    """
    inverse = np.linalg.pinv(covariance.matrix[part, part], hermitian=True)
    errors = []
    for flip in (true, true.inverse()):
        across = covariance.tangents @ flip.translation
        length = float(np.linalg.norm(across))
        u = np.arctan2(length, pose.translation @ flip.translation) * across / max(length, TINY)
        errors.append(np.concatenate([rotation_vector(flip.rotation @ pose.rotation.T), u])[part])
    return min(float(error @ inverse @ error) for error in errors)


def average_precision(score: AnyArray, moving: NDArray[np.bool_]) -> float:
    """Return the mean precision at every moving pixel, ranked by score; equal scores share one."""
    if not moving.any():
        return float("nan")
    order = np.argsort(-score, kind="stable")
    ranked, truth = score[order], moving[order]
    last = np.searchsorted(-ranked, -ranked, side="right")  # behind those of equal score
    return float((np.cumsum(truth)[last - 1] / last)[truth].mean())
