"""F from a dominant plane and the parallax of the smears that lie off it.

A sample of smears of one plane is degenerate for F, and most samples are of that kind where a plane
dominates; but the plane's homography is then well known, and two smears off the plane fix the epipole. With
the generator A both ends of a smear are carried to mid exposure; the line through them passes the epipole e
there, and F = (I - A/2)^T [e]x (I + A/2).

References
----------
Chum, Werner and Matas, Two-view geometry estimation unaffected by a dominant plane, CVPR 2005.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, Array
from blur2view.geometry.epipolar import cross_matrix, homogeneous
from blur2view.geometry.sampson import BatchSampson
from blur2view.robust.calibration import CUTOFF, PAIRS, SCORED
from blur2view.robust.homography import IDENTITY
from blur2view.robust.likelihood import Likelihood
from blur2view.robust.ransac import weighted_samples


def parallax_lines(A: Array, ends: Array) -> Array:
    """Return lines (N, 2, 3) of parallax at mid exposure, for the orders ends[:, 0] and ends[:, 1] first."""
    one, other = homogeneous(ends[:, 0]), homogeneous(ends[:, 1])
    open_side, close_side = (IDENTITY + 0.5 * A).T, (IDENTITY - 0.5 * A).T
    orders = [np.cross(x @ open_side, y @ close_side) for x, y in ((one, other), (other, one))]
    return np.stack(orders, axis=1)


def fundamentals_through(A: Array, epipoles: Array) -> Array:
    """Return F (M, 3, 3) compatible with the homography of A, by the epipoles (M, 3) at mid exposure."""
    compatible: Array = (IDENTITY - 0.5 * A).T @ cross_matrix(epipoles) @ (IDENTITY + 0.5 * A)
    return compatible


def plane_and_parallax(
    A: Array, likelihood: Likelihood, off_plane: NDArray[np.int_], rng: np.random.Generator
) -> Array | None:
    """Return the best F (3, 3), normalised, of a homography's generator A and two smears off its plane.

    None if there are fewer than two of them (``off_plane`` indexes those that the homography leaves).
    """
    if len(off_plane) < 2:
        return None
    lines = parallax_lines(A, likelihood.ends[off_plane])
    first, second = weighted_samples(np.ones(len(off_plane)), 2, PAIRS, rng).T
    epipoles = np.cross(lines[first][:, :, None], lines[second][:, None, :]).reshape(-1, 3)
    length = np.linalg.norm(epipoles, axis=1, keepdims=True)
    models = fundamentals_through(A, epipoles / np.maximum(length, TINY))
    scored = rng.permutation(len(likelihood))[:SCORED]
    precision = np.asarray(1 / likelihood.sigma_px[scored] ** 2, np.float32)
    cost = BatchSampson(likelihood.ends[scored], likelihood.unit_px).costs(models, precision, CUTOFF**2)
    cost[length[:, 0] <= TINY] = np.inf
    best = int(np.argmin(cost))
    return models[best] if np.isfinite(cost[best]) else None
