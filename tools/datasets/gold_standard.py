"""The gold-standard F of smears whose order is known: robust, then refined on Sampson distances."""

from __future__ import annotations

import numpy as np

from blur2view.arrays import AnyArray
from blur2view.geometry.epipolar import apply_similarity, denormalise, homogeneous, shared_normalisation
from blur2view.robust.parametrization import GeneralF
from tools.estimators import baselines

MOST = 4000
"""Smears used, evenly chosen."""
NOISE_PX = 0.5
"""Sampson distance from which a smear counts less (Cauchy's loss): the error of computed flow."""


def signed_sampson(F: AnyArray, first: AnyArray, last: AnyArray) -> AnyArray:
    """Return the signed Sampson distances (N,) of points (N, 2)."""
    x, y = homogeneous(first), homogeneous(last)
    lines, back = x @ F.T, y @ F
    value = (y * lines).sum(axis=1)
    weight = np.sqrt((lines[:, :2] ** 2).sum(axis=1) + (back[:, :2] ** 2).sum(axis=1))
    return np.asarray(value / np.maximum(weight, 1e-12))


def gold_standard_fundamental(ends: AnyArray) -> AnyArray | None:
    """Return F estimated from smears in their true order.

    Parameters
    ----------
    ends : ndarray of shape (N, 2, 2)
        First and last positions, pixels; outliers (movers, wrong flow) are allowed.

    Returns
    -------
    ndarray of shape (3, 3) or None
        Unit norm, rank 2; None for fewer than 8 smears or where nothing is found.

    References
    ----------
    Hartley and Zisserman, Multiple View Geometry, 2nd edition, section 11.4.3 (Sampson approximation).
    """
    from scipy.optimize import least_squares

    ends = ends[:: -(-len(ends) // MOST) or 1] if len(ends) else ends
    start = baselines.solve(baselines.opencv_magsac, ends)
    if start is None:
        return None
    T = shared_normalisation(ends)
    points = apply_similarity(T, ends.reshape(-1, 2)).reshape(ends.shape)
    inverse = np.linalg.inv(T)
    family, scale_px = GeneralF.from_matrix(inverse.T @ start @ inverse), 1 / T[0, 0]

    def residuals(delta: AnyArray) -> AnyArray:
        F = family.step(delta).matrix()
        return np.asarray(scale_px * signed_sampson(F, points[:, 0], points[:, 1]))

    found = least_squares(residuals, np.zeros(7), loss="cauchy", f_scale=NOISE_PX, x_scale="jac")
    return denormalise(family.step(found.x).matrix(), T)
