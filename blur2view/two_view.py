"""Policy: which family of F the smears pay for, when no F can be trusted, and what is reported."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from blur2view.epipolar import Array, serrmin, swapped_order
from blur2view.estimators import SmearEstimator, SmearProblem, build_problem, occupied_blocks
from blur2view.families import Fit, fit_families, fit_translation
from blur2view.matches import SmearMatches
from blur2view.ransac import RansacOptions, ransac

CHANCE_RHO = 0.1  # residual over length within which a smear agrees with an F
HELD_OUT_ITERATIONS = 16  # samples per half of the image, and matches used of it: a test, not an estimate
HELD_OUT_MATCHES = 400


class Configuration(StrEnum):
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
    of a Sampson distance, as a share of the smear's length and in pixels; ``block_px`` the
    side of the blocks in which coverage is counted.
    Search: see `ransac.RansacOptions`; ``fit_error_px`` is the paper's threshold for its stop on ``stop_inlier_share``.
    Trust: ``min_matches``; ``min_length_px`` the least median smear; ``max_still_share`` of the measurable image;
    ``min_coverage`` the least share of the image's blocks with matches; ``min_agreement`` the least share of smears that
    agree with F beyond chance, ``sure_agreement`` the share that needs no second test, ``min_held_out`` the least share of
    one half of the image that the other half predicts.
    """

    max_error_px: float = 3**0.5
    cutoff: float = 3.0
    relative_sigma: float = 0.03
    min_sigma_px: float = 0.1
    block_px: float = 40.0
    max_iterations: int = 1000
    confidence: float = 0.999
    stop_inlier_share: float = 0.9
    fit_error_px: float = 1.0
    min_matches: int = 30
    min_length_px: float = 1.0
    max_still_share: float = 0.6
    min_coverage: float = 0.08
    min_agreement: float = 0.2
    sure_agreement: float = 0.8
    min_held_out: float = 0.1

    def __post_init__(self) -> None:
        """Refuse options out of range."""
        positive = (self.max_error_px, self.cutoff, self.min_sigma_px, self.block_px, self.fit_error_px)
        if not min(positive) > 0 or self.relative_sigma < 0 or self.min_length_px < 0:
            raise ValueError(f"errors, sigmas and distances must be positive, got {self}")
        if self.min_matches < 8:
            raise ValueError(f"min_matches must be at least 8, got {self.min_matches}")
        shares = (self.max_still_share, self.min_coverage, self.min_agreement, self.sure_agreement, self.min_held_out)
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
    scores : tuple of (str, float)
        Name and penalised cost of every family that was fitted, best first.
    """

    F: Array | None
    config: Configuration
    reason: str
    inlier_mask: NDArray[np.bool_]
    swapped: NDArray[np.bool_]
    iterations: int = 0
    model: str = "none"
    scores: tuple[tuple[str, float], ...] = ()

    @property
    def runner_up(self) -> tuple[str, float] | None:
        """Name and penalised cost of the second best family, None if there is none."""
        return self.scores[1] if len(self.scores) > 1 else None


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
    problem, fits, iterations = search_and_fit(matches, options, rng)
    return judge(matches, problem, fits, iterations, options, rng)


def search_and_fit(
    matches: SmearMatches, options: EstimatorOptions, rng: np.random.Generator
) -> tuple[SmearProblem, list[Fit], int]:
    """Robust search, then every family fitted: (problem with rescaled sigmas, fits, samples drawn)."""
    problem = build_problem(matches.ends, sampson_sigma(matches, options), matches.image_size)
    estimator = SmearEstimator(problem=problem, cutoff=options.cutoff, fit_error_px=options.fit_error_px)
    found = ransac(estimator, options.search(), rng)
    return *fit_families(estimator, found, rng), found.iterations


def sampson_sigma(matches: SmearMatches, options: EstimatorOptions) -> Array:
    """Standard deviation (N,) of every Sampson distance, pixels.

    An end-point error of standard deviation sigma (both coordinates together) moves the Sampson distance by
    sigma / 2; no smear is believed better than ``relative_sigma`` of its length.
    """
    own = np.hypot(0.5 * matches.sigma_px, options.relative_sigma * matches.length_px)
    return np.maximum(own, options.min_sigma_px)


def two_parameter_fundamental(
    matches: SmearMatches, options: EstimatorOptions | None = None, rng: np.random.Generator | None = None
) -> Array | None:
    """Fit the two-parameter F (3, 3), all smears meeting in one point, robustly: the plainest baseline.

    None where there are fewer than ``options.min_matches`` matches.
    """
    options = options or EstimatorOptions()
    if len(matches) < options.min_matches:
        return None
    problem = build_problem(matches.ends, sampson_sigma(matches, options), matches.image_size)
    estimator = SmearEstimator(problem=problem, cutoff=options.cutoff, fit_error_px=options.fit_error_px)
    point = fit_translation(estimator, np.random.default_rng(0) if rng is None else rng)
    return problem.pixels(point.matrix())


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
    blocks = np.ceil(np.array(matches.image_size) / options.block_px).prod()
    coverage = occupied_blocks(matches.midpoint, options.block_px) / blocks
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


def judge(
    matches: SmearMatches, problem: SmearProblem, fits: list[Fit], iterations: int, options: EstimatorOptions,
    rng: np.random.Generator,
) -> TwoViewGeometry:
    """Choose the cheapest family and test it against chance."""
    ranked = sorted(fits, key=lambda fit: fit.score)
    best, scores = ranked[0], tuple((fit.name, fit.score) for fit in ranked)
    F = problem.pixels(best.point.matrix())
    doubt, figures = consensus(F, matches, options, rng)
    if doubt:
        return without_F(matches, Configuration.UNDEFINED, f"no consensus: {figures}", iterations, scores)
    tolerance = np.maximum(options.cutoff * problem.sigma_px, options.max_error_px)
    others = ", ".join(f"{fit.name} {fit.score - best.score:+.1f}" for fit in ranked[1:])
    return TwoViewGeometry(
        F=F, config=Configuration.UNCALIBRATED, inlier_mask=serrmin(F, matches.ends) < tolerance**2,
        reason=f"{figures}; the {best.name} F has the least penalised cost (others: {others})",
        swapped=swapped_order(F, matches.ends), iterations=iterations, model=best.name, scores=scores)


def consensus(
    F: Array, matches: SmearMatches, options: EstimatorOptions, rng: np.random.Generator
) -> tuple[bool, str]:
    """Whether to doubt F, and the figures that say so.

    F must explain more smears than chance. Between ``min_agreement`` and ``sure_agreement`` each half of
    the image must also predict the other: seven parameters fit a smooth field without any geometry.
    """
    beyond, share, chance = agreement(F, matches, rng)
    figures = f"{share:.0%} of {len(matches)} smears agree with the best F, {chance:.0%} would by chance"
    if beyond < options.min_agreement:
        return True, figures
    if beyond >= options.sure_agreement:
        return False, figures
    held_out = halves_agreement(matches, options, rng)
    figures += f"; each half of the image predicts {held_out:.0%} of the other beyond chance"
    return held_out < options.min_held_out, figures


def halves_agreement(matches: SmearMatches, options: EstimatorOptions, rng: np.random.Generator) -> float:
    """Fit each half of the image and test it on the other: mean agreement beyond chance, at most 1."""
    middle = matches.midpoint
    axis = int(np.argmax(np.ptp(middle, axis=0)))
    side = middle[:, axis] > np.median(middle[:, axis])
    search = replace(options, max_iterations=HELD_OUT_ITERATIONS)
    beyond = []
    for fitted in (side, ~side):
        train = rng.permutation(np.flatnonzero(fitted))[:HELD_OUT_MATCHES]
        if len(train) < options.min_matches:
            return 0.0
        problem, fits, _ = search_and_fit(matches.subset(train), search, rng)
        test = matches.subset(np.flatnonzero(~fitted))
        beyond.append(max(agreement(problem.pixels(fit.point.matrix()), test, rng)[0] for fit in fits[:2]))
    return float(np.mean(beyond))


def agreement(F: Array, matches: SmearMatches, rng: np.random.Generator) -> tuple[float, float, float]:
    """Agreement beyond chance, share of smears that agree with F, share that would by chance.

    A smear agrees when its residual is within CHANCE_RHO of its length; chance is measured on the same smears,
    each turned at random. Beyond chance: (share - chance) / (1 - chance).
    """
    length = np.maximum(matches.length_px, 1e-9)
    angle = rng.uniform(0, np.pi, len(matches))
    half = 0.5 * length[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    turned = np.stack([matches.midpoint - half, matches.midpoint + half], axis=1)
    share, chance = (
        float((np.sqrt(serrmin(F, ends)) < CHANCE_RHO * length).mean()) for ends in (matches.ends, turned))
    return (share - chance) / max(1 - chance, 1e-9), share, chance


def without_F(
    matches: SmearMatches, config: Configuration, reason: str, iterations: int = 0,
    scores: tuple[tuple[str, float], ...] = (),
) -> TwoViewGeometry:
    """Give the answer that there is no F, with its reason."""
    none = np.zeros(len(matches), bool)
    return TwoViewGeometry(F=None, config=config, reason=reason, inlier_mask=none, swapped=none.copy(),
                           iterations=iterations, scores=scores)
