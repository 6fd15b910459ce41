"""When no F can be trusted: nothing to see, or no consensus beyond chance."""

from __future__ import annotations

import numpy as np

from blur2view.arrays import TINY, Array
from blur2view.geometry.sampson import serrmin
from blur2view.robust.problem import SmearProblem
from blur2view.robust.refinement import refine
from blur2view.robust.residuals import RefineOptions
from blur2view.smears.matches import SmearMatches
from blur2view.two_view.model_selection import Fit

CHANCE_RHO = 0.1  # residual over length within which a smear agrees with an F
SURE_COUNT = 150  # independent smears beyond chance: network smears have at most about 100 in all
HELD_OUT_STEPS = 5  # of refinement to half of the image, and matches used of it: a test, not an estimate
HELD_OUT_MATCHES = 300
LEAST_WIDTH = 0.01  # spread of the midpoints across over along the line that fits them
MIN_MATCHES = 20
MIN_LENGTH_PX = 1.0  # median smear
BLOCKS, MIN_COVERAGE = 12, 0.08  # square blocks along the longer side; share of them that hold matches
MIN_AGREEMENT = 0.2  # share of smears that agree with F beyond chance
SURE_AGREEMENT = 0.8  # and the share that needs no second test
MIN_HELD_OUT = 0.06  # share of one half of the image that the other half predicts
CONSTANT = 0.01  # of the length, within which displacements are one


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
    if short > LEAST_WIDTH * long:
        return None
    return (
        f"all smears lie along one line: their midpoints are spread {short / max(long, TINY):.1%} across it"
    )


def _uncovered(matches: SmearMatches) -> str | None:
    """Return the reason if the smears cover too little of the image, or None."""
    if matches.image_size is None:
        return None
    block_px = max(matches.image_size) / BLOCKS
    blocks = np.ceil(np.array(matches.image_size) / block_px).prod()
    coverage = len(np.unique(np.floor(matches.midpoint / block_px), axis=0)) / blocks
    if coverage >= MIN_COVERAGE:
        return None
    return (
        f"the smears cover {coverage:.0%} of the image (at least {MIN_COVERAGE:.0%} needed): "
        "perhaps one moving object before a still camera"
    )


def constant_field(matches: SmearMatches, tolerance: float = CONSTANT) -> bool:
    """Return whether all displacements agree, up to sign, within a share of their length (95 % of them)."""
    d = matches.displacement
    reference = d[np.argsort(matches.length_px)[len(d) // 2]]
    difference = np.minimum(np.linalg.norm(d - reference, axis=1), np.linalg.norm(d + reference, axis=1))
    return bool(np.quantile(difference, 0.95) <= tolerance * np.linalg.norm(reference))


def consensus(
    fit: Fit, problem: SmearProblem, matches: SmearMatches, rng: np.random.Generator
) -> tuple[bool, str]:
    """Return whether there is no consensus on the F of a fit, and the figures behind it.

    F must explain more smears than chance. Between MIN_AGREEMENT and SURE_AGREEMENT each half of
    the image must also predict the other: seven parameters fit a smooth field without any geometry. They
    do not fit SURE_COUNT smears that err independently.
    """
    beyond, share, chance = agreement(problem.pixels(fit.point.matrix()), matches, rng, problem.sigma_px)
    figures = f"{share:.0%} of {len(matches)} smears agree with the best F, {chance:.0%} would by chance"
    if beyond < MIN_AGREEMENT:
        return True, figures
    if beyond >= SURE_AGREEMENT or beyond * problem.independent >= SURE_COUNT:
        return False, figures
    held_out = halves_agreement(fit, problem, matches, rng)
    figures += f"; each half of the image predicts {held_out:.0%} of the other beyond chance"
    return held_out < MIN_HELD_OUT, figures


def halves_agreement(
    fit: Fit, problem: SmearProblem, matches: SmearMatches, rng: np.random.Generator
) -> float:
    """Return the mean agreement beyond chance of each half of the image with a fit to the other."""
    middle = matches.midpoint
    axis = int(np.argmax(np.ptp(middle, axis=0)))
    side = middle[:, axis] > np.median(middle[:, axis])
    refinement = RefineOptions(data_weight=problem.data_weight, max_iterations=HELD_OUT_STEPS)
    beyond = []
    for fitted in (side, ~side):
        train = rng.permutation(np.flatnonzero(fitted))[:HELD_OUT_MATCHES]
        if len(train) < MIN_MATCHES:
            return 0.0
        point, _ = refine(fit.point, problem.subset(train).weighted, refinement)
        F = problem.pixels(point.matrix())
        held_out = np.flatnonzero(~fitted)
        beyond.append(agreement(F, matches.subset(held_out), rng, problem.sigma_px[held_out])[0])
    return float(np.mean(beyond))


def agreement(
    F: Array, matches: SmearMatches, rng: np.random.Generator, sigma_px: Array | float = 0.0
) -> tuple[float, float, float]:
    """Return the agreement beyond chance, and the shares of smears that agree with F, and would by chance.

    A smear agrees when its residual is within CHANCE_RHO of its length, or within a standard deviation
    ``sigma_px``; chance is measured on the same smears, each in a random direction. Beyond chance:
    (share - chance) / (1 - chance).
    """
    length = np.maximum(matches.length_px, 1e-9)
    tolerance = np.maximum(CHANCE_RHO * length, sigma_px)
    angle = rng.uniform(0, np.pi, len(matches))
    half = 0.5 * length[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    random = np.stack([matches.midpoint - half, matches.midpoint + half], axis=1)
    share, chance = (float((np.sqrt(serrmin(F, ends)) < tolerance).mean()) for ends in (matches.ends, random))
    return (share - chance) / max(1 - chance, 1e-9), share, chance
