"""From matches to fitted families: standard deviations and the robust search."""

from __future__ import annotations

import numpy as np

from blur2view.camera.camera import Camera
from blur2view.robust.estimators import SmearEstimator
from blur2view.robust.problem import SmearProblem, build_problem
from blur2view.robust.ransac import ransac
from blur2view.smears.matches import SmearMatches
from blur2view.two_view.model_selection import Fit, fit_families
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
    estimator = build_estimator(matches, camera)
    searched = ransac(estimator, options.search(), rng)
    return *fit_families(estimator, searched, rng), searched.iterations


def build_estimator(matches: SmearMatches, camera: Camera | None = None) -> SmearEstimator:
    """Return the robust search's problem: normalised smears and standard deviations."""
    problem = build_problem(matches.ends, matches.sampson_px, matches.image_size, camera, matches.shared)
    return SmearEstimator(problem=problem)
