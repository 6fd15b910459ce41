"""Policy: which family of F the smears pay for, when no F can be trusted, and what is reported."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blur2view.epipolar import Array, cross_matrix, serrmin, swapped_order
from blur2view.estimators import SmearEstimator, SmearProblem, build_problem, occupied_blocks, translation_start
from blur2view.manifold import CameraF, GeneralF, Manifold, camera_from_matrix
from blur2view.matches import SmearMatches
from blur2view.ransac import RansacOptions, RansacResult, ransac
from blur2view.refine import RefineOptions, WeightedEnds, refine, robust_cost

CHANCE_RHO = 0.1  # residual over length within which a smear agrees with an F


class Configuration(str, Enum):
    """What was found; the names are those of COLMAP's TwoViewGeometryConfiguration, the values lower case."""

    UNDEFINED = "undefined"
    DEGENERATE = "degenerate"
    CALIBRATED = "calibrated"
    UNCALIBRATED = "uncalibrated"
    PLANAR = "planar"
    PANORAMIC = "panoramic"
    PLANAR_OR_PANORAMIC = "planar_or_panoramic"
    WATERMARK = "watermark"
    MULTIPLE = "multiple"


@dataclass(frozen=True, kw_only=True)
class EstimatorOptions:
    """How F is estimated and when it is trusted.

    Errors: ``max_error_px`` a match with SErrMin below its square is an inlier (the paper: 3 squared pixels), as is one
    within ``cutoff`` of its own standard deviations; ``relative_sigma`` and ``min_sigma_px`` the least standard deviation
    of a Sampson distance, as a share of the smear's length and in pixels; ``correlation_px`` the distance over
    which errors are alike (smears in one block of this side count as one).
    Search: see `ransac.RansacOptions`; ``fit_error_px`` is the paper's threshold for its stop on ``stop_inlier_share``.
    Trust: ``min_matches``; ``min_length_px`` the least median smear; ``max_still_share`` of the measurable image;
    ``min_coverage`` the least share of the image's blocks with matches; ``min_agreement`` the least share of smears that
    agree with F beyond chance.
    """

    max_error_px: float = 3**0.5
    cutoff: float = 3.0
    relative_sigma: float = 0.03
    min_sigma_px: float = 0.1
    correlation_px: float = 40.0
    max_iterations: int = 1000
    confidence: float = 0.999
    stop_inlier_share: float = 0.9
    fit_error_px: float = 1.0
    min_matches: int = 30
    min_length_px: float = 1.0
    max_still_share: float = 0.6
    min_coverage: float = 0.08
    min_agreement: float = 0.25

    def __post_init__(self) -> None:
        """Refuse options out of range."""
        positive = (self.max_error_px, self.cutoff, self.min_sigma_px, self.correlation_px, self.fit_error_px)
        if not min(positive) > 0 or self.relative_sigma < 0 or self.min_length_px < 0:
            raise ValueError(f"errors, sigmas and distances must be positive, got {self}")
        if self.min_matches < 8:
            raise ValueError(f"min_matches must be at least 8, got {self.min_matches}")
        shares = (self.max_still_share, self.min_coverage, self.min_agreement)
        if min(shares) < 0 or max(shares) > 1:
            raise ValueError(f"shares must be in [0, 1], got {self}")
        self.search()

    def search(self) -> RansacOptions:
        """Options of the robust loop."""
        return RansacOptions(max_iterations=self.max_iterations, confidence=self.confidence,
                             stop_share=self.stop_inlier_share)


@dataclass(frozen=True, kw_only=True, eq=False)
class TwoViewGeometry:
    """Two-view geometry of the exposure: open (1) and close (2).

    Parameters
    ----------
    F : ndarray of shape (3, 3) or None
        ``points2^T F points1 = 0``, pixels, unit norm; F or its transpose, which is which cannot be known. None where
        no F can be trusted.
    config : Configuration
    reason : str
        One sentence with the figures that decided.
    inlier_mask : ndarray of bool, shape (N,)
    swapped : ndarray of bool, shape (N,)
        Where ``ends[:, 1]`` is the open end under F.
    iterations : int
        Samples drawn.
    model : str
        The family F is from: "translation" (2 parameters), "camera" (one ordinary camera, 5 parameters and a prior),
        "general" (7); "none" without F.
    scores : dict of str to float
        Penalised cost of every family that was fitted; the least won.
    """

    F: Array | None
    config: Configuration
    reason: str
    inlier_mask: NDArray[np.bool_]
    swapped: NDArray[np.bool_]
    iterations: int = 0
    model: str = "none"
    scores: dict[str, float] = field(default_factory=dict)

    @property
    def runner_up(self) -> tuple[str, float] | None:
        """Name and penalised cost of the second best family, None if there is none."""
        ranked = sorted(self.scores.items(), key=lambda item: item[1])
        return ranked[1] if len(ranked) > 1 else None


@dataclass(frozen=True, kw_only=True)
class Fit:
    """A fitted family: its name, its point, its penalised cost (twice a negative log-posterior, plus BIC)."""

    name: str
    point: Manifold
    score: float


def estimate_two_view(
    matches: SmearMatches, options: EstimatorOptions | None = None, rng: np.random.Generator | None = None
) -> TwoViewGeometry:
    """Estimate F from unordered smears, or say why none can be trusted.

    Parameters
    ----------
    matches : SmearMatches
    options : EstimatorOptions, optional
    rng : numpy.random.Generator, optional
        Default: seed 0. The same state gives the same answer.

    Returns
    -------
    TwoViewGeometry
        UNCALIBRATED with F; else DEGENERATE (too few or too short smears, a still or constant image) or UNDEFINED (the
        best F explains hardly more smears than chance).
    """
    options = options or EstimatorOptions()
    rng = np.random.default_rng(0) if rng is None else rng
    refusal = refuse(matches, options)
    if refusal is not None:
        return without_F(matches, Configuration.DEGENERATE, refusal)
    problem = build_problem(matches.ends, sampson_sigma(matches, options), matches.image_size,
                            correlation_px=options.correlation_px)
    estimator = SmearEstimator(problem=problem, cutoff=options.cutoff, fit_error_px=options.fit_error_px)
    found = ransac(estimator, options.search(), rng)
    scaled, fits = fit_families(estimator, found, rng)
    return judge(matches, scaled, fits, found.iterations, options, rng)


def sampson_sigma(matches: SmearMatches, options: EstimatorOptions) -> Array:
    """Standard deviation (N,) of every Sampson distance, pixels.

    An end-point error of standard deviation sigma (both coordinates together) moves the Sampson distance by
    sigma / 2; no smear is believed better than ``relative_sigma`` of its length.
    """
    own = np.hypot(0.5 * matches.sigma_px, options.relative_sigma * matches.length_px)
    return np.maximum(own, options.min_sigma_px)


def refuse(matches: SmearMatches, options: EstimatorOptions) -> str | None:
    """Reason to look for no F at all, or None."""
    if matches.still_share > options.max_still_share:
        return (f"no camera motion: {matches.still_share:.0%} of the measurable image shows no smear "
                f"(limit {options.max_still_share:.0%})")
    if len(matches) < options.min_matches:
        return f"too few smears: {len(matches)}, at least {options.min_matches} are needed"
    median = float(np.median(matches.length_px))
    if median < options.min_length_px:
        return f"no motion: the median smear is {median:.2f} px long, below {options.min_length_px:.2f} px"
    if constant_field(matches):
        return f"constant field: all smears are alike ({median:.1f} px), which fits any rotation or plane"
    return _uncovered(matches, options)


def _uncovered(matches: SmearMatches, options: EstimatorOptions) -> str | None:
    """Reason if the smears cover so little of the image that they may be one moving object."""
    if matches.image_size is None:
        return None
    blocks = np.ceil(np.array(matches.image_size) / options.correlation_px).prod()
    coverage = occupied_blocks(matches.midpoint, options.correlation_px) / blocks
    if coverage >= options.min_coverage:
        return None
    return (f"the smears cover {coverage:.0%} of the image (at least {options.min_coverage:.0%} needed): "
            "perhaps one moving object before a still camera")


def constant_field(matches: SmearMatches, tolerance: float = 0.01) -> bool:
    """Whether all displacements agree, up to sign, within a share of their length (95 % of them)."""
    d = matches.displacement
    reference = d[np.argsort(matches.length_px)[len(d) // 2]]
    difference = np.minimum(np.linalg.norm(d - reference, axis=1), np.linalg.norm(d + reference, axis=1))
    return bool(np.quantile(difference, 0.95) <= tolerance * np.linalg.norm(reference))


def fit_families(
    estimator: SmearEstimator, found: RansacResult, rng: np.random.Generator
) -> tuple[SmearProblem, list[Fit]]:
    """Fit every family from the search's result on standard deviations rescaled to what was met.

    Returns
    -------
    problem : SmearProblem
        With the rescaled standard deviations.
    fits : list of Fit
        The two-parameter F always; the camera where it is known to be ordinary; the general F.
    """
    problem, cutoff = estimator.problem, estimator.cutoff
    starts: list[tuple[str, Manifold, int]] = [("translation", translation_start(estimator, 200, rng), 2)]
    if found.model is not None:
        if problem.camera_known:
            starts.append(("camera", camera_from_matrix(found.model, problem.prior), 5))
        starts.append(("general", GeneralF.from_matrix(found.model), 7))
    rough = [refine(start, problem.weighted, RefineOptions(max_iterations=SEARCH_FIT, cutoff=cutoff))[0]
             for _, start, _ in starts]
    scale = min(residual_scale(point.matrix(), problem.weighted, cutoff) for point in rough)
    scaled = problem.rescaled(scale)
    options = RefineOptions(cutoff=cutoff, data_weight=scaled.data_weight)
    fits = []
    for (name, _, parameters), start in zip(starts, rough, strict=True):
        point, cost = refine(start, scaled.weighted, options)
        fits.append(Fit(name=name, point=point, score=cost + parameters * float(np.log(scaled.independent))))
    return scaled, fits


SEARCH_FIT = 10


def residual_scale(F: Array, matches: WeightedEnds, cutoff: float) -> float:
    """Robust standard deviation of the residuals over the assumed one, from inliers, in [0.1, 4]."""
    residual = np.abs(matches.ordered(F)[2])
    inside = residual[residual < cutoff]
    return float(np.clip(1.4826 * np.median(inside), 0.1, 4.0)) if len(inside) else 1.0


def judge(
    matches: SmearMatches, problem: SmearProblem, fits: list[Fit], iterations: int, options: EstimatorOptions,
    rng: np.random.Generator,
) -> TwoViewGeometry:
    """Choose the cheapest family and test it against chance."""
    best = min(fits, key=lambda fit: fit.score)
    scores = {fit.name: fit.score for fit in fits}
    F = problem.pixels(best.point.matrix())
    share, chance = agreement(F, matches, rng)
    beyond = (share - chance) / max(1 - chance, 1e-9)
    figures = f"{share:.0%} of {len(matches)} smears agree with the best F, {chance:.0%} would by chance"
    if beyond < options.min_agreement:
        return without_F(matches, Configuration.UNDEFINED, f"no consensus: {figures}", iterations, scores)
    squared = serrmin(F, matches.ends)
    own = (options.cutoff * problem.sigma_px) ** 2
    others = ", ".join(f"{fit.name} {fit.score - best.score:+.1f}" for fit in fits if fit is not best)
    reason = f"{figures}; the {best.name} model has the least penalised cost (others: {others or 'none'})"
    return TwoViewGeometry(
        F=F, config=Configuration.UNCALIBRATED, reason=reason, inlier_mask=squared < np.maximum(own, options.max_error_px**2),
        swapped=swapped_order(F, matches.ends), iterations=iterations, model=best.name, scores=scores)


def agreement(F: Array, matches: SmearMatches, rng: np.random.Generator) -> tuple[float, float]:
    """Share of smears within CHANCE_RHO of their length of F, and the same for smears turned at random."""
    length = np.maximum(matches.length_px, 1e-9)
    angle = rng.uniform(0, np.pi, len(matches))
    half = 0.5 * length[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    turned = np.stack([matches.midpoint - half, matches.midpoint + half], axis=1)
    shares = [float((np.sqrt(serrmin(F, ends)) < CHANCE_RHO * length).mean()) for ends in (matches.ends, turned)]
    return shares[0], shares[1]


def without_F(
    matches: SmearMatches, config: Configuration, reason: str, iterations: int = 0,
    scores: dict[str, float] | None = None,
) -> TwoViewGeometry:
    """Give the answer that there is no F, with its reason."""
    none = np.zeros(len(matches), bool)
    return TwoViewGeometry(F=None, config=config, reason=reason, inlier_mask=none, swapped=none.copy(),
                           iterations=iterations, scores=scores or {})
