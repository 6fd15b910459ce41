"""The paper's own estimator, as a reference: a local optimiser on seven smears inside Preemptive RANSAC.

Tran, Forssen and Viksten minimise sum min(|m f|, |m f^T|)^2 over seven smears (m a smear's row of the
epipolar constraint, f and f^T the entries of F and of its transpose) with SciPy, under det F = 0 and
|F| = 1; here by SLSQP from one random start, with the derivatives given. The cost has many local minima, and
zeros that are not the true F.
"""

import numpy as np

from blur2view.arrays import TINY, Array
from blur2view.geometry.epipolar import denormalise, homogeneous, serrmin, unit_norm
from blur2view.smears.matches import SmearMatches
from blur2view.two_view.consensus import refused
from blur2view.two_view.ransac import weighted_samples

SAMPLE_SIZE = 7  # smears that fix F, up to a finite number of solutions
STEPS = 100  # of SLSQP, SciPy's default
PRECISION = 1e-12  # of SLSQP on the cost; at SciPy's 1e-6 it stops beside the zeros

FIT_ERROR_PX = 1.0  # the root of the SErrMin below which a match fits
STOP_SHARE = 0.9  # of matches that fit, from which on the search stops
BLOCK = 100  # matches scored between two preemptions (Nister's)


def paper_of_matches(matches: SmearMatches, max_iterations: int = 1000) -> Array | None:
    """Return F estimated from unordered smears as the paper does, of seed 0.

    F has unit norm and rank 2 and is not refined; None where we refuse, or no sample of seven gave any.

    References
    ----------
    Tran, Forssen and Viksten, Robust Fundamental Matrix Estimation from Single Image Motion Blur,
    arXiv 2605.01552.
    """
    if refused(matches) is not None:
        return None
    ends, rng, found = matches.ends, np.random.default_rng(0), list[Array]()
    for _ in range(max_iterations):
        F = minimise_seven(ends[weighted_samples(np.ones(len(ends)), SAMPLE_SIZE, 1, rng)[0]], rng)
        if F is not None:
            found.append(F)
            if (serrmin(F, ends) < FIT_ERROR_PX**2).mean() >= STOP_SHARE:
                break
    return preemptive_best(np.stack(found), ends[rng.permutation(len(ends))]) if found else None


def preemptive_best(models: Array, ends: Array) -> Array:
    """Return the model with most inliers as Preemptive RANSAC sees it: half are dropped after every block.

    References
    ----------
    Nister, Preemptive RANSAC for live structure and motion estimation, ICCV 2003.
    """
    inliers = np.zeros(len(models), int)
    for start in range(0, len(ends), BLOCK):
        block = ends[start : start + BLOCK]
        inliers = inliers + (serrmin(models, block) < FIT_ERROR_PX**2).sum(axis=1)
        if len(models) == 1:
            break
        kept = np.argsort(-inliers, kind="stable")[: max(len(models) // 2, 1)]
        models, inliers = models[kept], inliers[kept]
    best: Array = models[int(np.argmax(inliers))]
    return best


def minimise_seven(ends: Array, rng: np.random.Generator) -> Array | None:
    """Return the minimum of the paper's cost on seven smears (7, 2, 2) from a random start.

    Unit norm, rank 2, pixels; a local minimum. None where the optimiser ends without finite numbers.
    """
    from scipy.optimize import minimize

    T = shared_normalisation(ends)
    rows = constraint_rows(ends * T[0, 0] + T[:2, 2])
    constraints = [
        {"type": "eq", "fun": lambda f: f @ f - 1, "jac": lambda f: 2 * f},
        {"type": "eq", "fun": determinant, "jac": cofactors},
    ]
    start = rng.normal(size=9)
    found = minimize(
        lambda f: ambiguous_cost(f, *rows),
        start / np.linalg.norm(start),
        jac=True,
        method="SLSQP",
        constraints=constraints,
        options={"maxiter": STEPS, "ftol": PRECISION},
    )
    if not (np.isfinite(found.x).all() and found.x.any()):
        return None
    return denormalise(nearest_rank_two(found.x.reshape(3, 3)), T)


def shared_normalisation(ends: Array) -> Array:
    """Return one similarity T (3, 3) of ends (N, 2, 2): centroid to 0, mean distance to sqrt(2).

    Two different ones, as for ordered matches, would break the symmetry of swapping the ends of a smear.
    """
    points = ends.reshape(-1, 2)
    spread = np.linalg.norm(points - points.mean(axis=0), axis=1).mean()
    scale = np.sqrt(2.0) / max(spread, TINY)
    return np.array([*np.c_[scale * np.eye(2), -scale * points.mean(axis=0)], [0, 0, 1.0]])


def constraint_rows(ends: Array) -> tuple[Array, Array]:
    """Return the coefficients (N, 9) of F's entries, row by row, in ``points2^T F points1``.

    Of ends (N, 2, 2), for their order and for the opposite one.
    """
    x, y = homogeneous(ends[:, 0]), homogeneous(ends[:, 1])
    forward, backward = (np.einsum("ni,nj->nij", *pair).reshape(-1, 9) for pair in ((y, x), (x, y)))
    return forward, backward


def ambiguous_cost(f: Array, forward: Array, backward: Array) -> tuple[float, Array]:
    """Return sum min(|m f|, |m f^T|)^2 and its gradient (9,) at the entries f (9,) of F.

    ``forward`` and ``backward`` (n, 9) are the rows m of both orders of the smears.
    """
    nearer = np.abs(forward @ f) < np.abs(backward @ f)
    rows = np.where(nearer[:, None], forward, backward)
    error = rows @ f
    return float(error @ error), 2 * error @ rows


def determinant(f: Array) -> float:
    """Return the determinant of the matrix with entries f (9,), row by row."""
    return float(f[:3] @ np.cross(f[3:6], f[6:]))


def cofactors(f: Array) -> Array:
    """Return the gradient (9,) of `determinant`."""
    one, two, three = f.reshape(3, 3)
    return np.concatenate([np.cross(two, three), np.cross(three, one), np.cross(one, two)])


def nearest_rank_two(F: Array) -> Array:
    """Return F (3, 3) with its least singular value set to zero, of unit norm."""
    U, singular, Vt = np.linalg.svd(F)
    return unit_norm((U[:, :2] * singular[:2]) @ Vt[:2])
