"""From matches to fitted families of F: the two-parameter one, an ordinary camera's, the general one."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.camera.camera import Camera
from blur2view.geometry.epipolar import unit_norm
from blur2view.geometry.sampson import serrmin
from blur2view.geometry.two_view_geometry import MotionModel
from blur2view.robust.estimators import SmearEstimator, translation_start
from blur2view.robust.parametrization import GeneralF, Manifold, TranslationF, camera_from_matrix
from blur2view.robust.problem import SmearProblem, build_problem
from blur2view.robust.ransac import ransac
from blur2view.robust.refinement import refine, refining
from blur2view.robust.residuals import CUTOFF, RefineOptions, WeightedEnds
from blur2view.smears.matches import SmearMatches
from blur2view.smears.noise import INDEPENDENT
from blur2view.two_view.options import EstimatorOptions

STEPS = 12  # Levenberg-Marquardt steps; fits start near their end
DISTINCT, STARTS = 0.02, 5  # starts differ by this in an entry of the unit-norm F; their number
REST = 0.2  # standard deviations: a smaller step ends a fit
KEPT = 3, 2  # that take a first and a second step; then the cheapest alone goes on
TOLERANCE = 3e-4  # relative decrease of the cost that ends a fit
FREE_TOLERANCE = 1e-2  # of a fit that takes every smear for independent; another goes on from it
CLEARLY = 6.0  # what that must gain in cost: at 0, 6 more of 210 estimates of network smears fail
SCALE_STEPS = 8  # of expectation-maximisation
LEAST_VARIANCE = 1e-6  # of residuals, in assumed ones: those of exact smears are zero
PAIRS = 100  # pairs of smears tried for the two-parameter F's start
PARAMETERS = {MotionModel.TRANSLATION: 2, MotionModel.CAMERA: 5, MotionModel.GENERAL: 7}
# Photographs come from ordinary cameras: where one may be assumed, the general F is for those it plainly does
# not fit. At odds of 100 to 1 it won a fifth of the scenes, at worse poses (AUC@10 0.686, not 0.706, over 30
# synthetic scenes with 1 px of noise) and a higher median rho on network smears (0.042, not 0.035).
# A camera that does not rotate is rare too: at even odds the two-parameter F won a third of the frames of
# RedKitchen, at a median rho of 0.066 where the camera's had 0.057.
ODDS_AGAINST = {MotionModel.GENERAL: 1e12, MotionModel.TRANSLATION: 1e3, MotionModel.CAMERA: 1.0}


@dataclass(frozen=True, kw_only=True)
class Fit:
    """A fitted model: the point of its family."""

    model: MotionModel
    point: Manifold
    score: float  # twice a negative log-posterior plus Akaike's penalty, see `fit_best`


def search_and_fit(
    matches: SmearMatches, options: EstimatorOptions, rng: np.random.Generator, camera: Camera | None = None
) -> tuple[SmearProblem, list[Fit], int]:
    """Return the problem with measured sigmas, every model fitted after a robust search, samples drawn.

    Of a camera the ends are undistorted pixels. Fitted are the two-parameter F, the richest plausible model
    and, if that is a camera, the general F.
    """
    estimator = build_estimator(matches, camera)
    searched = ransac(estimator, options.search(), rng)
    simple = fit_translation(estimator, rng)
    start = simple.matrix() if searched.model is None else searched.model
    rough = with_measured_noise(estimator.problem.thinned, start)  # as the search's F has it
    model, points = richer_starts(rough, distinct([start, simple.matrix(), *searched.contenders]))
    point = fit_roughly(model, points, richer_starts(rough, [simple.matrix()])[1], rough)
    problem = with_measured_noise(estimator.problem, point.matrix())  # and as the fitted F has it
    richest = fit_best(model, [point], problem)
    fits = [fit_best(MotionModel.TRANSLATION, [simple], problem), richest]
    if model is not MotionModel.GENERAL:
        general = GeneralF.from_matrix(richest.point.matrix())
        fits.append(fit_best(MotionModel.GENERAL, [general], problem))
    return problem, fits, searched.iterations


def build_estimator(matches: SmearMatches, camera: Camera | None = None) -> SmearEstimator:
    """Return the robust search's problem: normalised smears and standard deviations."""
    problem = build_problem(matches.ends, matches.sampson_px, matches.image_size, camera, matches.shared)
    return SmearEstimator(problem=problem)


def fit_translation(estimator: SmearEstimator, rng: np.random.Generator) -> TranslationF:
    """Return the two-parameter F, fitted robustly on the standard deviations as given."""
    options = RefineOptions(max_iterations=STEPS, tolerance=TOLERANCE, decided=True)
    return refine(translation_start(estimator, PAIRS, rng), estimator.problem.thinned.weighted, options)[0]


def distinct(matrices: list[Array]) -> list[Array]:
    """Return matrices (3, 3) without near repetitions, up to scale and transposition."""
    kept: list[Array] = []
    for F in (unit_norm(matrix) for matrix in matrices):
        twins = (min(np.abs(F - G).max(), np.abs(F + G).max()) for G in (H for K in kept for H in (K, K.T)))
        if all(difference > DISTINCT for difference in twins):
            kept.append(F)
    return kept[:STARTS]


def richer_starts(problem: SmearProblem, matrices: list[Array]) -> tuple[MotionModel, list[Manifold]]:
    """Return the richest plausible model, and its points nearest to the matrices (3, 3)."""
    if problem.has_camera:
        return MotionModel.CAMERA, [camera_from_matrix(F, problem.prior) for F in matrices]
    return MotionModel.GENERAL, [GeneralF.from_matrix(F) for F in matrices]


def fit_from(F: Array, problem: SmearProblem) -> Fit:
    """Return the richest plausible model, refined from F (3, 3)."""
    return fit_best(*richer_starts(problem, [F]), problem)


def fit_roughly(
    model: MotionModel, starts: list[Manifold], unrotated: list[Manifold], problem: SmearProblem
) -> Manifold:
    """Return the cheapest refinement of the starts, or that of one without rotation if it is clearly cheaper.

    What a wrong start leaves is correlated over the image, as errors of few independent smears are: depths
    and data then count little against the prior, and the fit stays in a local minimum. So a start without
    rotation is first refined as if every smear were independent. Without that, 7 of 160 scenes with exact
    smears and an image size ended at a rho of 0.0009 to 0.0084; with it all end below 0.0003.
    """
    free = replace(problem, shared=INDEPENDENT)
    far = fit_best(model, unrotated, free, FREE_TOLERANCE).point
    near, other = (fit_best(model, points, problem) for points in (starts, [far]))
    return (other if other.score < near.score - CLEARLY else near).point


def fit_best(
    model: MotionModel, starts: list[Manifold], problem: SmearProblem, tolerance: float = TOLERANCE
) -> Fit:
    """Return the cheapest refinement of the starts. The score is Akaike's criterion.

    It aims at the least error on unseen smears, as we do. Schwarz's, which aims at the true family, took the
    two-parameter F in a third of scenes with 8 degrees of noise, at a mean rho of 0.040 instead of 0.037.
    Of several starts the cheapest KEPT take a step each; only the one that is cheapest then is refined on. To
    refine all is worse: an AUC@10 of 0.721, not 0.735, over 139 synthetic scenes.
    """
    options = RefineOptions(
        data_weight=problem.data_weight, max_iterations=STEPS, tolerance=tolerance, rest=REST
    )
    trials = [(next(run), run) for run in (refining(start, problem.weighted, options) for start in starts)]
    for kept in KEPT:
        trials = sorted(trials, key=lambda trial: trial[0][1])[:kept]
        trials = [(next(run, reached), run) for reached, run in trials]
    reached, run = min(trials, key=lambda trial: trial[0][1])
    *_, (point, cost) = [reached, *run]
    score = cost + 2 * PARAMETERS[model] + 2 * float(np.log(ODDS_AGAINST[model])) * problem.has_camera
    return Fit(model=model, point=point, score=score)


def with_measured_noise(problem: SmearProblem, F: Array) -> SmearProblem:
    """Return the problem with standard deviations as the residuals of F show them."""
    return problem.rescaled(residual_scale(F, problem.weighted))


def with_inliers(
    F: Array, matches: SmearMatches, problem: SmearProblem, options: EstimatorOptions
) -> tuple[Array, NDArray[np.bool_]]:
    """Return F of pixels from a normalised one, and its inliers (N,) by the noise that it leaves itself."""
    measured = with_measured_noise(replace(problem, scale=1.0), F)
    in_pixels = problem.pixels(F)
    return in_pixels, serrmin(in_pixels, matches.ends) < options.tolerance_px(measured.sigma_px) ** 2


def residual_scale(F: Array, matches: WeightedEnds) -> float:
    """Return the robust standard deviation of the residuals over the assumed one, in [0.1, 4].

    Residuals of the better order below CUTOFF are a mixture of a half normal distribution and of a
    uniform one, the outliers; expectation-maximisation separates them.
    """
    residual = np.abs(matches.residuals(F).least)
    squared = residual[residual < CUTOFF] ** 2
    if not len(squared):
        return 1.0
    variance, inliers = max(1.4826**2 * float(np.median(squared)), LEAST_VARIANCE), 0.5
    for _ in range(SCALE_STEPS):
        normal = inliers * (2 / (np.pi * variance)) ** 0.5 * np.exp(-squared / (2 * variance))
        share = normal / (normal + (1 - inliers) / CUTOFF)
        total = float(share.sum())
        inliers = min(total / len(squared), 0.999)
        variance = max(float(share @ squared) / max(total, 1e-9), LEAST_VARIANCE)
    return float(np.clip(variance**0.5, 0.1, 4.0))
