"""Whether smears show anything: refusals before any F is sought, inliers, and consensus beyond chance."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, Array
from blur2view.geometry.sampson import serrmin
from blur2view.robust import calibration as c
from blur2view.robust.calibration import MIN_LENGTH_PX, MIN_MATCHES
from blur2view.robust.field_fit import FieldFit
from blur2view.robust.likelihood import Likelihood
from blur2view.robust.refinement import refine
from blur2view.robust.residuals import RefineOptions
from blur2view.smears.matches import SmearMatches
from blur2view.two_view.families import Fit
from blur2view.two_view.options import EstimatorOptions

GOLDEN = 0.5 * (5**0.5 - 1)  # turns of half a circle from one smear to the next: evenly spread directions


def still(matches: SmearMatches) -> str | None:
    """Return the reason why nothing moved, or moved as one, so that there is no parallax; or None."""
    if len(matches) < MIN_MATCHES:
        return None
    median = float(np.median(matches.length_px))
    if median < MIN_LENGTH_PX:
        return f"no motion: the median smear is {median:.2f} px long, below {MIN_LENGTH_PX:.2f} px"
    if constant_field(matches):
        return (
            f"constant field: all smears have one displacement ({median:.1f} px), as of any rotation or plane"
        )
    return None


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


def inliers_of(model: Array | FieldFit[Any], likelihood: Likelihood, options: EstimatorOptions) -> Inliers:
    """Return the inliers of F (3, 3), of the matches' pixels, or of a displacement field.

    See `EstimatorOptions.tolerance_px`; chance is measured on the same smears in random directions.
    """
    sigma_px = likelihood.sigma_px if isinstance(model, np.ndarray) else likelihood.field_sigma_px
    tolerance = options.tolerance_px(likelihood.length_px, sigma_px)

    def fitting(likelihood: Likelihood) -> NDArray[np.bool_]:
        if isinstance(model, FieldFit):
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


def consensus(
    fit: Fit, likelihood: Likelihood, options: EstimatorOptions, rng: np.random.Generator
) -> tuple[bool, str]:
    """Return whether there is consensus on the F of a fit, and the figures behind it.

    F must explain more smears than chance. Between MIN_AGREEMENT and SURE_AGREEMENT each half of the image
    must also predict the other: seven parameters fit a smooth field without any geometry. They do not fit
    SURE_COUNT smears that err independently.
    """
    found = inliers_of(likelihood.pixels(fit.point.matrix()), likelihood, options)
    beyond = found.beyond_chance
    if beyond < c.MIN_AGREEMENT:
        return False, found.figures
    if beyond >= c.SURE_AGREEMENT or beyond * likelihood.effective_count >= c.SURE_COUNT:
        return True, found.figures
    held_out = halves_agreement(fit, likelihood, options, rng)
    figures = f"{found.figures}; each half of the image predicts {held_out:.0%} of the other beyond chance"
    return held_out >= c.MIN_HELD_OUT, figures


def halves_agreement(
    fit: Fit, likelihood: Likelihood, options: EstimatorOptions, rng: np.random.Generator
) -> float:
    """Return the mean agreement beyond chance of each half of the image with a fit to the other."""
    middle = likelihood.matches.midpoint
    axis = int(np.argmax(np.ptp(middle, axis=0)))
    side = middle[:, axis] > np.median(middle[:, axis])
    refinement = RefineOptions(effective_share=likelihood.effective_share, max_iterations=c.HELD_OUT_STEPS)
    beyond = []
    for fitted in (side, ~side):
        train = rng.permutation(np.flatnonzero(fitted))[: c.HELD_OUT_MATCHES]
        if len(train) < MIN_MATCHES:
            return 0.0
        point, _ = refine(fit.point, likelihood.subset(train), refinement)
        held_out = likelihood.subset(np.flatnonzero(~fitted))
        beyond.append(inliers_of(likelihood.pixels(point.matrix()), held_out, options).beyond_chance)
    return float(np.mean(beyond))


def within_errors(matches: SmearMatches) -> bool:
    """Return whether the shorter smears are as short as errors alone make them, up to half outliers.

    Of displacements that are errors of standard deviation sigma, the squared length over sigma^2 is
    distributed exponentially with mean 1.
    """
    ratio = (matches.length_px / matches.sigma_px) ** 2
    return bool(np.quantile(ratio, c.SHORT_QUANTILE) < -np.log(1 - c.SHORT_QUANTILE / c.SHORT_INLIERS))
