"""From matches to fitted families: standard deviations and the robust search."""

from __future__ import annotations

import numpy as np

from blur2view.arrays import Array
from blur2view.camera.camera import Camera
from blur2view.robust.estimators import SmearEstimator
from blur2view.robust.problem import SmearProblem, build_problem
from blur2view.robust.ransac import ransac
from blur2view.smears.matches import SmearMatches
from blur2view.two_view.model_selection import Fit, fit_families, fit_translation
from blur2view.two_view.options import EstimatorOptions


def search_and_fit(
    matches: SmearMatches,
    options: EstimatorOptions,
    rng: np.random.Generator,
    camera: Camera | None = None,
) -> tuple[SmearProblem, list[Fit], int]:
    """Return the problem with rescaled sigmas, every model fitted after a robust search, samples drawn.

    With a camera the ends are its undistorted pixels.
    """
    estimator = build_estimator(matches, options, camera)
    searched = ransac(estimator, options.search(), rng)
    return *fit_families(estimator, searched, rng), searched.iterations


def build_estimator(
    matches: SmearMatches, options: EstimatorOptions, camera: Camera | None = None
) -> SmearEstimator:
    """Return the robust search's problem: normalised smears and standard deviations."""
    problem = build_problem(matches.ends, sampson_sigma(matches, options), matches.image_size, camera)
    return SmearEstimator(problem=problem, cutoff=options.cutoff, fit_error_px=options.fit_error_px)


def sampson_sigma(matches: SmearMatches, options: EstimatorOptions) -> Array:
    """Return the standard deviation (N,) of every Sampson distance, pixels.

    An end-point error of standard deviation sigma (both coordinates together) moves the Sampson distance by
    sigma / 2; no smear is believed better than ``relative_sigma`` of its length.
    """
    own = np.hypot(0.5 * matches.sigma_px, options.relative_sigma * matches.length_px)
    return np.maximum(own, options.min_sigma_px)


def two_parameter_fundamental(matches: SmearMatches, rng: np.random.Generator | None = None) -> Array | None:
    """Return the two-parameter F (3, 3), all smears meeting in one point, fitted robustly: a baseline.

    None where there are fewer matches than `EstimatorOptions` asks for. By default ``default_rng(0)``.
    """
    options = EstimatorOptions()
    if len(matches) < options.min_matches:
        return None
    estimator = build_estimator(matches, options)
    point = fit_translation(estimator, np.random.default_rng(0) if rng is None else rng)
    return estimator.problem.pixels(point.matrix())
