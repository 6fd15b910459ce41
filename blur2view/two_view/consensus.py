"""Whether smears show anything: refusals before any F is sought, inliers, and consensus beyond chance."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.geometry.epipolar import serrmin
from blur2view.geometry.two_view_geometry import Configuration, TwoViewGeometry
from blur2view.smears.matches import SmearMatches
from blur2view.two_view import constants as c
from blur2view.two_view.homography import HomographyFit
from blur2view.two_view.likelihood import Likelihood

GOLDEN = 0.5 * (5**0.5 - 1)  # turns of half a circle from one smear to the next: evenly spread directions
MOST_PX = 1e6  # beyond any photograph, and its square is a number


@dataclass(frozen=True, kw_only=True)
class EstimatorOptions:
    """Which smears follow F: those nearer than `tolerance_px`, of ``max_error_px`` pixels at most.

    By default the paper's 3 squared pixels. ValueError if it is not positive or beyond any photograph.
    """

    max_error_px: float = 3**0.5

    def __post_init__(self) -> None:
        if not 0 < self.max_error_px <= MOST_PX:
            raise ValueError(f"max_error_px must be positive, at most {MOST_PX:g}, got {self.max_error_px}")

    def tolerance_px(self, length_px: Array, sigma_px: Array) -> Array:
        """Return the Sampson distances (N,), pixels, below which smears are inliers: the one definition.

        A tenth of the smear's length, at most ``max_error_px``, but two of its own standard deviations at
        least: a bound in pixels alone is as large as short smears are, and any F would fit them.
        """
        most = np.minimum(c.INLIER_SHARE * length_px, self.max_error_px)
        return np.maximum(most, c.INLIER_SIGMAS * sigma_px)


def no_geometry(matches: SmearMatches, reason: str, **why: Any) -> TwoViewGeometry:
    """Return a degenerate geometry: neither F nor H, and no smear is an inlier."""
    none = np.zeros(len(matches), bool)
    config = Configuration.DEGENERATE
    return TwoViewGeometry(
        F=None, config=config, reason=reason, inlier_mask=none, second_end_is_open=none, **why
    )


def refused(matches: SmearMatches) -> TwoViewGeometry | None:
    """Return the geometry of smears that show no motion or too little; else None."""
    if len(matches) < c.MIN_MATCHES:
        few = f"too few smears: {len(matches)}, at least {c.MIN_MATCHES} are needed"
        return no_geometry(matches, few, insufficient_data=True)
    median = float(np.median(matches.length_px))
    if median < c.MIN_LENGTH_PX:
        short = f"no motion: the median smear is {median:.2f} px long, below {c.MIN_LENGTH_PX:.2f} px"
        return no_geometry(matches, short, stood_still=True)
    share = coverage(matches)
    if share < c.MIN_COVERAGE:
        least = f"at least {100 * c.MIN_COVERAGE:.0f} % needed"
        little = f"the smears cover {100 * share:.0f} % of the image ({least})"
        moved = f"{little}: perhaps one moving object before a still camera"
        return no_geometry(matches, moved, insufficient_data=True)
    short, long = np.linalg.svd(matches.midpoint - matches.midpoint.mean(axis=0), compute_uv=False)[::-1]
    if short <= c.LEAST_WIDTH * long:  # leaves F and H open
        return no_geometry(matches, "all smears lie along one line", insufficient_data=True)
    return None


def coverage(matches: SmearMatches) -> float:
    """Return the share of the image's square blocks that hold midpoints; 1 without an image size."""
    if matches.image_size is None:
        return 1.0
    block_px = max(matches.image_size) / c.BLOCKS
    blocks = np.ceil(np.array(matches.image_size) / block_px).prod()
    return float(len(np.unique(np.floor(matches.midpoint / block_px), axis=0)) / blocks)


@dataclass(frozen=True, kw_only=True, eq=False)
class Inliers:
    """Which smears follow a model, and what share would if their directions were random."""

    mask: NDArray[np.bool_]  # (N,)
    by_chance: float = 0.0

    @property
    def beyond_chance(self) -> float:
        """Share of inliers of the smears that do not fit by chance; negative if fewer fit than would."""
        return (float(self.mask.mean()) - self.by_chance) / max(1 - self.by_chance, 1e-9)

    @property
    def figures(self) -> str:
        """The clause that says so; rounded down, as only all are 100 %."""
        share = 100 * int(self.mask.sum()) // len(self.mask)
        return f"{share} % of {len(self.mask)} smears fit, {100 * self.by_chance:.0f} % would by chance"


def inliers_of(model: Array | HomographyFit, likelihood: Likelihood, options: EstimatorOptions) -> Inliers:
    """Return the inliers of F (3, 3), of the matches' pixels, or of a displacement field.

    See `EstimatorOptions.tolerance_px`; chance is measured on the same smears in random directions.
    """
    of_field = isinstance(model, HomographyFit)
    sigma_px = 0.5**0.5 * np.hypot(*likelihood.field_sigmas_px) if of_field else likelihood.sigma_px
    tolerance = options.tolerance_px(likelihood.length_px, sigma_px)

    def fitting(likelihood: Likelihood) -> NDArray[np.bool_]:
        if isinstance(model, HomographyFit):
            return np.asarray(model.orders(likelihood).least * likelihood.sigma_px < tolerance)
        return np.asarray(np.sqrt(serrmin(model, likelihood.matches.ends)) < tolerance)

    scattered = replace(likelihood, matches=in_random_directions(likelihood.matches))
    return Inliers(mask=fitting(likelihood), by_chance=float(fitting(scattered).mean()))


def in_random_directions(matches: SmearMatches) -> SmearMatches:
    """Return the matches with their midpoints and lengths, in directions that have nothing in common."""
    angle = np.pi * (GOLDEN * np.arange(len(matches)) % 1.0)
    half = 0.5 * matches.length_px[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return replace(matches, ends=np.stack([matches.midpoint - half, matches.midpoint + half], axis=1))


def within_errors(matches: SmearMatches) -> bool:
    """Return whether the shorter smears are as short as errors alone make them, up to half outliers.

    Of displacements that are errors of standard deviation sigma, the squared length over sigma^2 is
    distributed exponentially with mean 1.
    """
    ratio = (matches.length_px / matches.sigma_px) ** 2
    return bool(np.quantile(ratio, c.SHORT_QUANTILE) < -np.log(1 - c.SHORT_QUANTILE / c.SHORT_INLIERS))
