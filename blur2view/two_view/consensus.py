"""Whether smears show anything: refusals before any F is sought, inliers, and consensus beyond chance."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, Array
from blur2view.geometry.sampson import serrmin
from blur2view.smears.matches import SmearMatches
from blur2view.two_view import constants as c
from blur2view.two_view.constants import MIN_LENGTH_PX, MIN_MATCHES
from blur2view.two_view.fit_homography import HomographyFit
from blur2view.two_view.likelihood import Likelihood
from blur2view.two_view.options import EstimatorOptions

GOLDEN = 0.5 * (5**0.5 - 1)  # turns of half a circle from one smear to the next: evenly spread directions


def still(matches: SmearMatches) -> str | None:
    """Return the reason why nothing moved, or None."""
    median = float(np.median(matches.length_px)) if len(matches) >= MIN_MATCHES else np.inf
    if median >= MIN_LENGTH_PX:
        return None
    return f"no motion: the median smear is {median:.2f} px long, below {MIN_LENGTH_PX:.2f} px"


def moved_as_one(matches: SmearMatches) -> str | None:
    """Return the reason why all moved as one, so that there is no parallax, or None."""
    if len(matches) < MIN_MATCHES or not constant_field(matches):
        return None
    median = float(np.median(matches.length_px))
    return f"constant field: all smears have one displacement ({median:.1f} px), as of any rotation or plane"


def insufficient_data(matches: SmearMatches) -> str | None:
    """Return the reason why too little is seen to look for an F, or None."""
    if len(matches) < MIN_MATCHES:
        return f"too few smears: {len(matches)}, at least {MIN_MATCHES} are needed"
    return _uncovered(matches) or collinear(matches)


def collinear(matches: SmearMatches) -> str | None:
    """Return the reason if the midpoints are collinear, which leaves F and H undetermined, or None."""
    middle = matches.midpoint - matches.midpoint.mean(axis=0)
    short, long = np.sqrt(np.maximum(np.linalg.eigvalsh(middle.T @ middle), 0.0))
    if short > c.LEAST_WIDTH * long:
        return None
    return (
        f"all smears lie along one line: their midpoints are spread {short / max(long, TINY):.1%} across it"
    )


def _uncovered(matches: SmearMatches) -> str | None:
    """Return the reason if the smears cover too little of the image, or None."""
    if matches.image_size is None:
        return None
    block_px = max(matches.image_size) / c.BLOCKS
    blocks = np.ceil(np.array(matches.image_size) / block_px).prod()
    coverage = len(np.unique(np.floor(matches.midpoint / block_px), axis=0)) / blocks
    if coverage >= c.MIN_COVERAGE:
        return None
    return (
        f"the smears cover {coverage:.0%} of the image (at least {c.MIN_COVERAGE:.0%} needed): "
        "perhaps one moving object before a still camera"
    )


def constant_field(matches: SmearMatches, tolerance: float = c.CONSTANT) -> bool:
    """Return whether all displacements agree, up to sign, within a share of their length (95 % of them)."""
    d = matches.displacement
    reference = d[np.argsort(matches.length_px)[len(d) // 2]]
    difference = np.minimum(np.linalg.norm(d - reference, axis=1), np.linalg.norm(d + reference, axis=1))
    return bool(np.quantile(difference, 0.95) <= tolerance * np.linalg.norm(reference))


@dataclass(frozen=True, kw_only=True, eq=False)
class Inliers:
    """Which smears follow a model, and what share would if their directions were random."""

    mask: NDArray[np.bool_]  # (N,)
    by_chance: float

    @property
    def share(self) -> float:
        """Share of the smears that are inliers."""
        return float(self.mask.mean()) if len(self.mask) else 0.0

    @property
    def beyond_chance(self) -> float:
        """Share of inliers of the smears that do not fit by chance; negative if fewer fit than would."""
        return (self.share - self.by_chance) / max(1 - self.by_chance, 1e-9)

    @property
    def figures(self) -> str:
        """The clause that says so; rounded down, as only all are 100%."""
        share = 100 * int(self.mask.sum()) // max(len(self.mask), 1)
        return f"{share}% of {len(self.mask)} smears fit, {self.by_chance:.0%} would by chance"


def no_inliers(count: int) -> Inliers:
    """Return the inliers of no model: none of ``count`` smears."""
    return Inliers(mask=np.zeros(count, bool), by_chance=0.0)


def inliers_of(model: Array | HomographyFit, likelihood: Likelihood, options: EstimatorOptions) -> Inliers:
    """Return the inliers of F (3, 3), of the matches' pixels, or of a displacement field.

    See `EstimatorOptions.tolerance_px`; chance is measured on the same smears in random directions.
    """
    of_field = isinstance(model, HomographyFit)
    sigma_px = 0.5**0.5 * np.hypot(*likelihood.field_sigmas_px) if of_field else likelihood.sigma_px
    tolerance = options.tolerance_px(likelihood.length_px, sigma_px)

    def fitting(likelihood: Likelihood) -> NDArray[np.bool_]:
        if isinstance(model, HomographyFit):
            distance = np.abs(model.orders(likelihood).least) * likelihood.sigma_px
        else:
            distance = np.sqrt(serrmin(model, likelihood.matches.ends))
        return np.asarray(distance < tolerance)

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
