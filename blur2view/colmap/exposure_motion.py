"""The rigid motion of a camera during an exposure, and its pose: fits to smears and to places of points.

Cameras are pycolmap's, of any model: derivatives of its projections are differences.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from blur2view.arrays import TINY, Array
from blur2view.camera import from_colmap
from blur2view.colmap.blur_matching import same_sense
from blur2view.exposure.trajectory import changed
from blur2view.geometry.epipolar import cross_matrix

FIT_STEPS, POSE_STEPS = 12, 20  # of reweighting


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """How points move in an exposure, t from -1/2 to 1/2: by ``rigid`` (6,) t + ``bend`` (3,) t^2."""

    rigid: Array
    bend: Array

    def pose_at(self, t: float, pose: Array) -> Array:
        """Return cam_from_world (3, 4) at an instant, from that of mid exposure."""
        return changed(pose, np.append(self.rigid[:3] * t + self.bend * t * t, self.rigid[3:] * t))


def projected(camera: Any, points: Array) -> Array:
    """Return our pixels (N, 2) of points (N, 3) of a pycolmap.Camera; NaN behind it."""
    pixels = from_colmap(np.asarray(camera.img_from_cam(points), float).reshape(-1, 2))
    return np.where(points[:, 2:] > 0, pixels, np.nan)


def image_flow(camera: Any, points: Array) -> Array:
    """Return how pixels of points (N, 3) move, (N, 2, 6), per unit of a rotation and translation of these."""
    step = 1e-4 * points[:, 2:]
    slopes = [
        (projected(camera, points + step * axis) - projected(camera, points - step * axis)) / (2 * step)
        for axis in np.eye(3)
    ]
    slope = np.stack(slopes, axis=-1)
    return np.concatenate([-slope @ cross_matrix(points), slope], axis=-1)


def doubt_of(expected: Array) -> float:
    """Return the standard deviation of the three parts of the translation of an expected motion (6,)."""
    return float(np.linalg.norm(expected[3:])) + TINY


def fit_smears(flow: Array, smears: Array, sigma: Array, expected: Array) -> Array:
    """Return the rigid motion (6,) of smears (N, 2) without sign, in the sense of an expected one (6,)."""
    length = float(np.median(np.linalg.norm(smears, axis=1)))
    reach = np.linalg.norm(flow[:, :, :3], axis=1).mean(axis=0) + TINY  # (3,) pixels per radian
    share = length / max(float(np.median(np.linalg.norm(flow @ expected, axis=1))), TINY)
    start = expected * min(share, 1.0)
    starts = [start]
    for x, y, z in ((1, 0, 0), (0, 1, 0), (0, 0, 2), (0.7, 0.7, 0), (0.7, -0.7, 0)):
        starts.append(np.append(np.array([x, y, z]) * length / reach, start[3:]))
    precision = np.append(np.zeros(3), np.full(3, doubt_of(expected) ** -2))
    found = [_fit_from(one, flow, smears, sigma, precision) for one in starts]
    motion = min(found, key=lambda one: one[0])[1]
    return -motion if motion[:3] @ expected[:3] < 0 else motion


def _fit_from(
    start: Array, flow: Array, smears: Array, sigma: Array, precision: Array
) -> tuple[float, Array]:
    """Return cost and motion (6,) of `fit_smears` from one start, whose translation is what is expected."""
    motion, prior = start, np.append(np.zeros(3), start[3:])
    for _ in range(FIT_STEPS):
        missed = same_sense(smears, flow @ motion) - flow @ motion
        weight = 1 / (sigma**2 + (missed**2).sum(axis=1))
        weighted = flow * weight[:, None, None]
        normal = np.tensordot(weighted, flow, ((0, 1), (0, 1))) + np.diag(precision)
        right = np.tensordot(weighted, same_sense(smears, flow @ motion), ((0, 1), (0, 1)))
        motion = np.linalg.lstsq(normal, right + precision * prior, rcond=None)[0]
    return float(np.log1p((missed**2).sum(axis=1) / sigma**2).sum()), motion


def fit_pose(camera: Any, pose: Array, world: Array, places: Array, covariance: Array) -> tuple[Array, Array]:
    """Return the pose (3, 4) of points (N, 3) at places (N, 2), by Cauchy's weights, and its information."""
    whiten = np.linalg.inv(np.linalg.cholesky(covariance))
    for _ in range(POSE_STEPS):
        points = world @ pose[:, :3].T + pose[:, 3]
        points[:, 2] = np.maximum(points[:, 2], TINY)
        missed = (whiten @ (places - projected(camera, points))[..., None])[..., 0]
        rows = whiten @ image_flow(camera, points)
        weighted = rows / (1 + (missed**2).sum(axis=1))[:, None, None]
        normal = np.tensordot(weighted, rows, ((0, 1), (0, 1)))
        step = np.linalg.lstsq(normal, np.tensordot(weighted, missed, ((0, 1), (0, 1))), rcond=None)[0]
        pose = changed(pose, step)
        if np.abs(step[:3]).max() < 1e-7:
            break
    return pose, normal
