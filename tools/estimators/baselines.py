"""Fundamental matrices by other means, on the same matches: what ours must be compared with.

Some are given the order of every match, which no single photograph gives; some ignore that it is unknown.
"""

from collections.abc import Callable

import cv2
import numpy as np

from blur2view.arrays import AnyArray
from blur2view.geometry.epipolar import fundamental_from_pose
from blur2view.robust.calibration import MIN_MATCHES
from blur2view.robust.estimators import SmearEstimator
from blur2view.robust.likelihood import Likelihood
from blur2view.smears.matches import SmearMatches
from blur2view.two_view.families import fit_translation

Solver = Callable[[AnyArray, AnyArray], "AnyArray | None"]

MAX_ERROR_PX = 1.0
CONFIDENCE = 0.9999
MAX_ITERATIONS = 10_000


def opencv(
    points1: AnyArray, points2: AnyArray, max_error_px: float = MAX_ERROR_PX, method: int = cv2.USAC_MAGSAC
) -> AnyArray | None:
    """Return the F of OpenCV by a method of its USAC; None where it finds nothing."""
    F, _ = cv2.findFundamentalMat(points1, points2, method, max_error_px, CONFIDENCE, MAX_ITERATIONS)
    return None if F is None else np.asarray(F[:3], np.float64)


def pycolmap_ransac(
    points1: AnyArray,
    points2: AnyArray,
    max_error_px: float = MAX_ERROR_PX,
    trials: tuple[int, int] = (1000, MAX_ITERATIONS),
    confidence: float = CONFIDENCE,
) -> AnyArray | None:
    """Return the F of pycolmap's LO-RANSAC, at least and at most so many trials."""
    import pycolmap

    options = pycolmap.RANSACOptions()
    options.max_error, options.confidence, options.random_seed = max_error_px, confidence, 0
    options.min_num_trials, options.max_num_trials = trials
    found = pycolmap.estimate_fundamental_matrix(points1, points2, estimation_options=options)
    return None if found is None else np.asarray(found["F"], np.float64)


def poselib_ransac(
    points1: AnyArray,
    points2: AnyArray,
    max_error_px: float = MAX_ERROR_PX,
    max_iterations: int = MAX_ITERATIONS,
) -> AnyArray | None:
    """Return the F of PoseLib's LO-RANSAC."""
    import poselib

    options = {
        "max_epipolar_error": max_error_px,
        "success_prob": CONFIDENCE,
        "max_iterations": max_iterations,
    }
    F, _ = poselib.estimate_fundamental(points1, points2, options, {})
    return np.asarray(F, np.float64)


def poselib_calibrated(
    points1: AnyArray, points2: AnyArray, K: AnyArray, max_error_px: float = MAX_ERROR_PX
) -> AnyArray:
    """Return the F of the pose by PoseLib's LO-RANSAC, both views sharing K without skew."""
    import poselib

    middle, focal = K[:2, 2], np.diag(K)[:2]
    width, height = np.ceil(2 * middle).astype(int)
    camera = {"model": "PINHOLE", "width": width, "height": height, "params": [*focal, *middle]}
    options = {"max_epipolar_error": max_error_px, "success_prob": CONFIDENCE}
    pose, _ = poselib.estimate_relative_pose(points1, points2, camera, camera, options, {})
    return fundamental_from_pose(K, pose.R, pose.t)


def two_parameter_fundamental(matches: SmearMatches) -> AnyArray | None:
    """Return the two-parameter F, all smears meeting in one point, fitted robustly; None of too few."""
    if len(matches) < MIN_MATCHES:
        return None
    estimator = SmearEstimator(likelihood=Likelihood.of(matches))
    point = fit_translation(estimator, np.random.default_rng(0))
    return estimator.likelihood.pixels(point.matrix())


def scrambled(ends: AnyArray, rng: np.random.Generator) -> AnyArray:
    """Return ends (N, 2, 2) in random order."""
    return np.where(rng.random(len(ends))[:, None, None] < 0.5, ends, ends[:, ::-1])


def rightward(ends: AnyArray) -> AnyArray:
    """Return ends (N, 2, 2) ordered by x, so that u > 0 (the convention of Gong et al., CVPR 2017)."""
    backwards = ends[:, 1, 0] < ends[:, 0, 0]
    return np.where(backwards[:, None, None], ends[:, ::-1], ends)


def in_true_order(ends: AnyArray, displacement: AnyArray) -> AnyArray:
    """Return ends (N, 2, 2) ordered along true displacements (N, 2)."""
    backwards = ((ends[:, 1] - ends[:, 0]) * displacement).sum(1) < 0
    return np.where(backwards[:, None, None], ends[:, ::-1], ends)


def solve(solver: Solver, ends: AnyArray) -> AnyArray | None:
    """Return a solver's F of ordered ends (N, 2, 2); None too where it fails or its F is not finite."""
    if len(ends) < 8:
        return None
    F = solver(np.ascontiguousarray(ends[:, 0]), np.ascontiguousarray(ends[:, 1]))
    return F if F is not None and np.isfinite(F).all() and np.abs(F).max() > 0 else None
