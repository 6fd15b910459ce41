"""Estimators of F by blur2view, OpenCV, pycolmap, PoseLib and the paper, on the same matches.

Some methods get the order of every match, which no single photograph gives; some ignore that it is unknown.
The others' thresholds were chosen on the base case's seeds 10000 to 10059 of both kinds of
`tools.evaluation.estimators`, by pose AUC at 10 degrees, from 0.5, 1, 1.5, 2, 3 and 4 px: MAGSAC 1
(0.78; 0.5 gave 0.79 in three times the time), pycolmap 2 (0.71), PoseLib 2 (0.79) and, with K, 3 (0.90).
Their other options are the defaults.

The paper (Tran, Forssen and Viksten, *Robust Fundamental Matrix Estimation from Single Image Motion Blur*,
arXiv 2605.01552) minimises sum min(|m f|, |m f^T|)^2 over seven smears inside Preemptive RANSAC, under
det F = 0 and |F| = 1: m is a smear's row of the epipolar constraint, f and f^T are the entries of F and of
its transpose. Here SLSQP starts once, at random, with the derivatives given. The cost has many local minima,
and zeros that are not the true F.
"""

from collections.abc import Callable
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view import Camera, SmearMatches, estimate_two_view
from blur2view.arrays import TINY, AnyArray, Array
from blur2view.geometry.epipolar import denormalise, fundamental_from_pose, homogeneous, serrmin, unit_norm
from blur2view.two_view.constants import MIN_SMEARS
from blur2view.two_view.fundamental import SmearEstimator, fit_translation
from blur2view.two_view.likelihood import NormalisedSmears
from tools.datasets.synthetic_matches import KnownMatches, with_swaps

Solver = Callable[[AnyArray, AnyArray], "AnyArray | None"]
Method = Callable[[KnownMatches], "AnyArray | None"]

CONFIDENCE, MAX_TRIALS = 0.9999, 100_000
SAMPLE_SIZE = 7  # smears that leave a finite number of F
STEPS, PRECISION = 100, 1e-12  # of SLSQP: SciPy's default, which at its own precision stops beside the zeros
FIT_ERROR_PX, STOP_SHARE = 1.0, 0.9  # root of SErrMin of an inlier; share of inliers that ends the search
BLOCK = 100  # matches scored before half of the models leave, as Nister's


def opencv(points1: AnyArray, points2: AnyArray) -> AnyArray | None:
    """Return the F of OpenCV's MAGSAC; None where it finds none."""
    F, _ = cv2.findFundamentalMat(points1, points2, cv2.USAC_MAGSAC, 1.0, CONFIDENCE, 10_000)
    return None if F is None else np.asarray(F[:3], np.float64)


def pycolmap_ransac(points1: AnyArray, points2: AnyArray) -> AnyArray | None:
    """Return the F of pycolmap's LO-RANSAC."""
    import pycolmap

    options = pycolmap.RANSACOptions()
    options.max_error, options.confidence, options.random_seed = 2.0, CONFIDENCE, 0
    options.min_num_trials, options.max_num_trials = 1000, MAX_TRIALS
    found = pycolmap.estimate_fundamental_matrix(points1, points2, estimation_options=options)
    return None if found is None else np.asarray(found["F"], np.float64)


def poselib_ransac(points1: AnyArray, points2: AnyArray) -> AnyArray | None:
    """Return the F of PoseLib's LO-RANSAC."""
    import poselib

    options = {"max_epipolar_error": 2.0, "success_prob": CONFIDENCE, "max_iterations": MAX_TRIALS}
    F, _ = poselib.estimate_fundamental(points1, points2, options, {})
    return np.asarray(F, np.float64)


def poselib_calibrated(points1: AnyArray, points2: AnyArray, K: AnyArray) -> AnyArray:
    """Return the F of PoseLib's LO-RANSAC for the pose of two views with the same K, without skew."""
    import poselib

    middle, focal = K[:2, 2], np.diag(K)[:2]
    width, height = np.ceil(2 * middle).astype(int)
    camera = {"model": "PINHOLE", "width": width, "height": height, "params": [*focal, *middle]}
    options = {"max_epipolar_error": 3.0, "success_prob": CONFIDENCE}
    pose, _ = poselib.estimate_relative_pose(points1, points2, camera, camera, options, {})
    return fundamental_from_pose(K, pose.R, pose.t)


def two_parameter_fundamental(matches: SmearMatches) -> AnyArray | None:
    """Return F of a pure translation, two parameters, fitted robustly; None from fewer than MIN_SMEARS."""
    if len(matches) < MIN_SMEARS:
        return None
    estimator = SmearEstimator(smears=NormalisedSmears.of(matches))
    point = fit_translation(estimator, np.random.default_rng(0))
    return denormalise(point.matrix(), estimator.smears.T)


def paper_of_matches(matches: SmearMatches, max_iterations: int = 1000) -> Array | None:
    """Return the F of the paper's estimator, of unit norm and rank 2; None from fewer than MIN_SMEARS."""
    ends, rng, found = matches.ends, np.random.default_rng(0), list[Array]()
    if len(ends) < MIN_SMEARS:
        return None
    for _ in range(max_iterations):
        F = minimise_seven(ends[rng.choice(len(ends), SAMPLE_SIZE, replace=False)], rng)
        if F is not None:
            found.append(F)
            if (serrmin(F, ends) < FIT_ERROR_PX**2).mean() >= STOP_SHARE:
                break
    return preemptive_best(np.stack(found), ends[rng.permutation(len(ends))]) if found else None


def preemptive_best(models: Array, ends: Array) -> Array:
    """Return the F of most inliers by Preemptive RANSAC (Nister, ICCV 2003): half leave after each block."""
    inliers = np.zeros(len(models), int)
    for start in range(0, len(ends), BLOCK):
        inliers = inliers + (serrmin(models, ends[start : start + BLOCK]) < FIT_ERROR_PX**2).sum(axis=1)
        kept = np.argsort(-inliers, kind="stable")[: max(len(models) // 2, 1)]
        models, inliers = models[kept], inliers[kept]
    return np.asarray(models[0])


def minimise_seven(ends: Array, rng: np.random.Generator) -> Array | None:
    """Return a local minimum of the paper's cost on seven smears (7, 2, 2); None if it is not finite."""
    from scipy.optimize import minimize

    T = shared_normalisation(ends)
    rows = constraint_rows(ends * T[0, 0] + T[:2, 2])
    constraints = [
        {"type": "eq", "fun": lambda f: f @ f - 1, "jac": lambda f: 2 * f},
        {"type": "eq", "fun": lambda f: f[:3] @ np.cross(f[3:6], f[6:]), "jac": cofactors},
    ]
    options, start = {"maxiter": STEPS, "ftol": PRECISION}, unit_norm(rng.normal(size=(3, 3))).ravel()
    found = minimize(
        ambiguous_cost, start, rows, jac=True, method="SLSQP", constraints=constraints, options=options
    )
    if not (np.isfinite(found.x).all() and found.x.any()):
        return None
    U, singular, Vt = np.linalg.svd(found.x.reshape(3, 3))
    return denormalise(unit_norm((U[:, :2] * singular[:2]) @ Vt[:2]), T)


def shared_normalisation(ends: Array) -> Array:
    """Return T (3, 3), a similarity: all ends' centroid goes to 0, their mean distance to sqrt(2)."""
    points = ends.reshape(-1, 2)
    scale = np.sqrt(2.0) / max(np.linalg.norm(points - points.mean(axis=0), axis=1).mean(), TINY)
    return np.array([*np.c_[scale * np.eye(2), -scale * points.mean(axis=0)], [0, 0, 1.0]])


def constraint_rows(ends: Array) -> tuple[Array, Array]:
    """Return the rows (N, 9) of y^T F x = 0, linear in F, for both orders of ends (N, 2, 2)."""
    x, y = homogeneous(ends[:, 0]), homogeneous(ends[:, 1])
    forward, backward = (np.einsum("ni,nj->nij", *pair).reshape(-1, 9) for pair in ((y, x), (x, y)))
    return forward, backward


def ambiguous_cost(f: Array, forward: Array, backward: Array) -> tuple[float, Array]:
    """Return sum min(|m f|, |m f^T|)^2 and its gradient (9,) at f (9,), of rows m (n, 9) of both orders."""
    nearer = np.abs(forward @ f) < np.abs(backward @ f)
    rows = np.where(nearer[:, None], forward, backward)
    error = rows @ f
    return float(error @ error), 2 * error @ rows


def cofactors(f: Array) -> Array:
    """Return the gradient (9,) of the determinant of the matrix with entries f (9,)."""
    one, two, three = f.reshape(3, 3)
    return np.concatenate([np.cross(two, three), np.cross(three, one), np.cross(one, two)])


def against(ends: AnyArray, displacement: AnyArray) -> NDArray[np.bool_]:
    """Return which smears, of ends (N, 2, 2), run against displacements (N, 2) or (2,)."""
    return np.asarray(((ends[:, 1] - ends[:, 0]) * displacement).sum(1) < 0)


def solve(solver: Solver, ends: AnyArray) -> AnyArray | None:
    """Return a solver's F of ordered ends (N, 2, 2); None where it fails or its F is not finite."""
    if len(ends) < 8:
        return None
    F = solver(np.ascontiguousarray(ends[:, 0]), np.ascontiguousarray(ends[:, 1]))
    return F if F is not None and np.isfinite(F).all() and np.abs(F).max() > 0 else None


def camera_of(known: KnownMatches) -> Camera:
    """Return the true camera."""
    assert known.matches.image_size is not None
    width, height = known.matches.image_size
    return Camera(K=known.K, width=width, height=height)


def scrambled(ends: AnyArray) -> AnyArray:
    """Return ends (N, 2, 2) in random order."""
    return with_swaps(ends, np.random.default_rng(0).random(len(ends)) >= 0.5)


def rightward(ends: AnyArray) -> AnyArray:
    """Return ends (N, 2, 2) ordered by x, so that u > 0 (the convention of Gong et al., CVPR 2017)."""
    return with_swaps(ends, against(ends, np.array([1.0, 0.0])))


def in_true_order(solver: Solver) -> Method:
    """Return the method that gives a solver the true order."""
    return lambda known: solve(solver, known.ordered)


ORDERED: dict[str, Solver] = {
    "true order, OpenCV MAGSAC": opencv,
    "true order, pycolmap": pycolmap_ransac,
    "true order, PoseLib": poselib_ransac,
}
OURS, PAPER = "ours", "the paper's"
METHODS: dict[str, Method] = {
    OURS: lambda known: estimate_two_view(known.matches).F,
    "ours, K given": lambda known: estimate_two_view(known.matches, camera=camera_of(known)).F,
    "two-parameter F": lambda known: two_parameter_fundamental(known.matches),
    PAPER: lambda known: paper_of_matches(known.matches),
    "unordered, OpenCV MAGSAC": lambda known: solve(opencv, scrambled(known.matches.ends)),
    "u > 0 order, OpenCV MAGSAC": lambda known: solve(opencv, rightward(known.matches.ends)),
    **{name: in_true_order(solver) for name, solver in ORDERED.items()},
    "true order and K, PoseLib": lambda known: solve(partial(poselib_calibrated, K=known.K), known.ordered),
}
