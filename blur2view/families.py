"""Which family of F the smears pay for: the two-parameter F, an ordinary camera's, or the general one."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from blur2view.epipolar import Array
from blur2view.estimators import SmearEstimator, SmearProblem, independent_count, translation_start
from blur2view.manifold import GeneralF, Manifold, TranslationF, camera_from_matrix
from blur2view.ransac import RansacResult
from blur2view.refine import RefineOptions, WeightedEnds, refine

ROUGH_STEP = 3  # every third smear is enough to measure the scale of the noise
PAIRS = 200  # pairs of smears tried for the two-parameter F's start
PARAMETERS = {"translation": 2, "camera": 5, "general": 7}
# Photographs come from ordinary cameras: where one may be assumed, the general F is for those it plainly does
# not fit. At odds of 100 to 1 it won a fifth of the scenes, at worse poses (AUC@10 0.686 instead of 0.706 over
# 30 synthetic scenes with 1 px of noise) and a higher median rho on network smears (0.042 instead of 0.035).
ODDS_AGAINST_GENERAL = 1e12


@dataclass(frozen=True, kw_only=True)
class Fit:
    """A fitted family: its name, its point, its penalised cost.

    The score is twice a negative log-posterior plus Akaike's penalty, see :func:`fit_best`.
    """

    name: str
    point: Manifold
    score: float


def fit_families(
    estimator: SmearEstimator, found: RansacResult, rng: np.random.Generator
) -> tuple[SmearProblem, list[Fit]]:
    """Fit every family from the search's result, on standard deviations rescaled to what is met.

    Returns
    -------
    problem : SmearProblem
        With rescaled standard deviations and the effective number of independent smears.
    fits : list of Fit
        The two-parameter F always; the camera where one may be assumed; the general F.
    """
    problem, cutoff = estimator.problem, estimator.cutoff
    simple = fit_translation(estimator, rng)
    best = simple.matrix() if found.model is None else found.model
    problem = calibrated(problem, best, cutoff)  # the scale of the noise, as the search's F has it
    name, starts = family_starts(problem, best, simple)[1]
    best = fit_best(name, starts, problem.thinned(ROUGH_STEP), cutoff).point.matrix()
    problem = calibrated(estimator.problem, best, cutoff)  # and as the fitted F has it
    return problem, [fit_best(*family, problem, cutoff) for family in family_starts(problem, best, simple)]


def fit_translation(estimator: SmearEstimator, rng: np.random.Generator) -> TranslationF:
    """Fit the two-parameter F robustly, on the standard deviations as given."""
    start = translation_start(estimator, PAIRS, rng)
    return refine(start, estimator.problem.weighted, RefineOptions(cutoff=estimator.cutoff))[0]


def family_starts(problem: SmearProblem, F: Array, simple: TranslationF) -> list[tuple[str, list[Manifold]]]:
    """Give the starting points of every family: the F found, and no rotation."""
    starts: list[tuple[str, list[Manifold]]] = [("translation", [simple])]
    if problem.camera_known:
        starts.append(("camera", [camera_from_matrix(f, problem.prior) for f in (F, simple.matrix())]))
    return [*starts, ("general", [GeneralF.from_matrix(F)])]


def fit_best(name: str, starts: list[Manifold], problem: SmearProblem, cutoff: float) -> Fit:
    """Refine from every start; the least cost wins. The score is Akaike's criterion.

    It aims at the least error on unseen smears, as we do. Schwarz's, which aims at the true family, took the
    two-parameter F in a third of scenes with 8 degrees of noise, at a mean rho of 0.040 instead of 0.037.
    """
    options = RefineOptions(cutoff=cutoff, data_weight=problem.data_weight)
    point, cost = min(
        (refine(start, problem.weighted, options) for start in starts), key=lambda found: found[1]
    )
    score = cost + 2 * PARAMETERS[name]
    if name == "general" and problem.camera_known:
        score += 2 * float(np.log(ODDS_AGAINST_GENERAL))
    return Fit(name=name, point=point, score=score)


def calibrated(problem: SmearProblem, F: Array, cutoff: float) -> SmearProblem:
    """Rescale the standard deviations to the residuals of F and count the independent smears."""
    scaled = problem.rescaled(residual_scale(F, problem.weighted, cutoff))
    return replace(scaled, independent=independent_count(scaled, F, cutoff))


def residual_scale(F: Array, matches: WeightedEnds, cutoff: float) -> float:
    """Robust standard deviation of the residuals over the assumed one, from inliers, in [0.1, 4]."""
    residual = np.abs(matches.residuals(F).least)
    inside = residual[residual < cutoff]
    return float(np.clip(1.4826 * np.median(inside), 0.1, 4.0)) if len(inside) else 1.0
