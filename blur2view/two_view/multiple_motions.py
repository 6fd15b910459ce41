"""Several motions: whether two F, each of its own smears, explain much more than one.

With unknown orders one F is flexible: on two halves of an image that move differently it leaves one or two
pixels of error, correlated within each half. Where the errors of the best F are coherent and as large as the
smears' own standard deviations state, two F are fitted at those: samples are drawn from compact
parts of the image, which mostly hold one motion.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, Array
from blur2view.robust.calibration import CUTOFF
from blur2view.robust.estimators import SmearEstimator
from blur2view.robust.field_fit import FieldFit
from blur2view.robust.levenberg_marquardt import levenberg_marquardt
from blur2view.robust.likelihood import Likelihood, mixture
from blur2view.robust.parametrization import GeneralF
from blur2view.robust.ransac import RansacOptions, ransac
from blur2view.robust.refinement import WeightedPoint
from blur2view.two_view.families import residual_scale

SMEARS = 700  # that the two are sought and fitted in
SEARCH = RansacOptions(max_iterations=96, min_iterations=96, batch=16)
BLOCKS = 5  # along the longer side, in which errors are correlated: about 100 px of a picture of 640x480
PLACES = 8  # cells along the longer side, each of which goes to one motion
ATTEMPTS = 3  # of finding two motions
ROUNDS = 2  # of sharing out the smears between the two F
SUSPECT_SCALE = 0.6  # errors over standard deviations from which coherent ones are suspect
COHERENT, FIRMLY = 0.45, 0.5  # independent share of errors below which they are; of an F of compact samples
ALIKE = 0.25  # independent share of directions of outliers below which they are of another motion
MANY_OUTLIERS = 0.2  # share of outliers from which their directions are looked at
WORST_SHARE = 0.35  # of the smears, those that a first F fits worst, in which a second is sought
ONE_EXPLAINS = 0.95  # share of the smears that one F explains from which there is no second motion
LEAST_BALANCE = 0.22  # a smaller second motion is an object, not the camera's
LEAST_GAIN = 50.0  # of two motions over one


@dataclass(frozen=True, kw_only=True, eq=False)
class TwoMotions:
    """Two motions, or one where ``second`` is zero."""

    F: Array  # (3, 3) of the larger one, normalised coordinates
    first: float  # share of all smears that follow it
    second: float  # and that of the smaller one
    single: float  # share that the best single F explains
    gain: float  # log-likelihood of two F over one, twice, of at most SMEARS, times their independent share

    @property
    def balance(self) -> float:
        """Share of the smaller motion among what the two explain, at most 1/2."""
        return self.second / max(self.first + self.second, TINY)

    @property
    def are_several(self) -> bool:
        """Whether they are more than an object and than what one F explains."""
        return self.balance >= LEAST_BALANCE and self.single < ONE_EXPLAINS


def blocks_of(middle: Array, count: int) -> NDArray[np.int_]:
    """Return the square block (N,) of every point, ``count`` along the longer side of their extent."""
    side = np.ptp(middle, axis=0).max() / count + TINY
    index: NDArray[np.int_] = np.floor((middle - middle.min(axis=0)) / side).astype(int) @ np.array(
        [1, count + 1]
    )
    return index


def independence(values: Array, used: NDArray[np.bool_], middle: Array) -> float:
    """Return the share of independent values (K, N), from 1 / (values per block) to 1: K kinds of residuals.

    Within blocks of a fifth of the midpoints' extent those of ``used`` (N,) are summed: the sum of m
    residuals of variance v has variance m v if they are independent, m^2 v if they agree.
    """
    kept, block = np.where(used, values, 0.0), blocks_of(middle, BLOCKS)
    sums = np.stack([np.bincount(block, weights=row) for row in kept])
    return 1 / max(float((sums**2).sum()) / max(float((kept**2).sum()), TINY), 1.0)


def errors_by_order(likelihood: Likelihood, F: Array, backward: NDArray[np.bool_]) -> Array:
    """Return residuals (N,) of F (3, 3) in standard deviations, in orders that neighbours share.

    ``backward`` (N,) marks smears whose ends[:, 1] is the open end, as a homography has it; in every block
    that or the opposite holds for all smears, whichever fits better. F's own choice of every order would,
    where they hardly differ, leave errors that neighbours share for that alone.
    """
    both = likelihood.residuals(F).both
    options = np.where(backward, both[::-1], both)
    block = blocks_of(likelihood.middle, BLOCKS)
    cost = [np.bincount(block, weights=np.minimum(option**2, 9.0))[block] for option in options]
    return np.asarray(np.where(cost[0] <= cost[1], options[0], options[1]))


def leaves_structure(
    likelihood: Likelihood, F: Array, backward: NDArray[np.bool_], level: float = COHERENT
) -> bool:
    """Return whether neighbours share the errors that F leaves, or the directions of its many outliers.

    ``level`` is the share of independent errors below which they do.
    """
    residual, middle = errors_by_order(likelihood, F, backward), likelihood.middle
    if independence(residual[None], np.abs(residual) < CUTOFF, middle) < level:
        return True
    far = np.abs(likelihood.residuals(F).least) >= CUTOFF
    angle = 2 * np.arctan2(*likelihood.displacement.T)
    directions = np.stack([np.cos(angle), np.sin(angle)])
    return bool(far.mean() > MANY_OUTLIERS and independence(directions, far, middle) < ALIKE)


def find_two_motions(
    likelihood: Likelihood, F: Array, plane: FieldFit, rng: np.random.Generator
) -> TwoMotions | None:
    """Return two F that explain much more than one, or one that does; None if neither does.

    F (3, 3) is the best single one, ``plane`` the best homography.
    """
    if likelihood.sigma_fitted < SUSPECT_SCALE:
        return None
    backward = plane.orders(likelihood).swapped
    if not leaves_structure(likelihood, F, backward):
        return None
    for _ in range(ATTEMPTS):
        motions = _two_motions(likelihood, F, backward, rng)
        if motions is not None and motions.gain >= LEAST_GAIN:
            return motions
    return None


def _two_motions(
    likelihood: Likelihood, F: Array, backward: NDArray[np.bool_], rng: np.random.Generator
) -> TwoMotions | None:
    """Return two F at the stated standard deviations; F is the best single one.

    No second share where one F leaves only noise after all, or next to nothing; None
    where no F is found.
    """
    chosen = rng.permutation(len(likelihood))[:SMEARS]
    stated, backward = replace(likelihood.subset(chosen), sigma_fitted=1.0), backward[chosen]
    one = _search(stated, rng)
    if one is None:
        return None
    one = _refit(stated, one)
    stated = stated.rescaled(max(residual_scale(one, stated), 1.0))
    (single, of_F), (alone, reached) = (explained(stated, [f]) for f in (F, one))
    explains = float(max(single[0], alone[0]))
    if explains >= ONE_EXPLAINS or not leaves_structure(stated, one, backward, FIRMLY):
        gain = 2 * (reached - of_F)
        return TwoMotions(F=one, first=float(alone[0]), second=0.0, single=explains, gain=gain)
    other = _search(stated.subset(_worst_places(stated, _squared(stated, one))), rng)
    if other is None:
        return None
    for _ in range(ROUNDS):
        mine = _by_place(stated, _squared(stated, one), _squared(stated, other))
        shares = (mine, one), (~mine, other)
        one, other = (_refit(stated.subset(np.flatnonzero(which)), F) for which, F in shares)
    (first, second), reached_by_two = explained(stated, [one, other])
    mine = _by_place(stated, _squared(stated, one), _squared(stated, other))
    residual = np.where(mine, *(errors_by_order(stated, f, backward) for f in (one, other)))
    own = independence(residual[None], np.abs(residual) < CUTOFF, stated.middle)
    gain = 2 * (reached_by_two - max(of_F, reached)) * min(own, stated.effective_share)
    (second, _), (first, larger) = sorted([(second, other), (first, one)], key=itemgetter(0))
    return TwoMotions(F=larger, first=float(first), second=float(second), single=explains, gain=gain)


def _worst_places(likelihood: Likelihood, squared: Array) -> NDArray[np.int_]:
    """Return the smears of the cells that an F fits worst, a share WORST_SHARE; squared residuals (N,)."""
    cell = blocks_of(likelihood.middle, PLACES)
    mean = np.bincount(cell, weights=np.minimum(squared, CUTOFF**2)) / np.maximum(np.bincount(cell), 1)
    return np.argsort(-mean[cell], kind="stable")[: max(round(WORST_SHARE * len(cell)), 30)]


def _by_place(likelihood: Likelihood, one: Array, other: Array) -> NDArray[np.bool_]:
    """Return whether the smears around each one fit the one motion better: squared residuals (N,) of both."""
    vote = np.minimum(other, CUTOFF**2) - np.minimum(one, CUTOFF**2)
    cell = blocks_of(likelihood.middle, PLACES)
    return np.bincount(cell, weights=vote)[cell] >= 0


def explained(likelihood: Likelihood, models: list[Array]) -> tuple[Array, float]:
    """Return shares (M,) of the smears that follow each of M models F (3, 3), and the log-likelihood.

    A mixture's weights: half normal residuals of the better order, in standard deviations, and for the rest,
    which follow none, what smears of random direction give: near zero an even density of
    4 sqrt(2) sigma / (pi length).
    """
    chance = 4 * 2**0.5 / np.pi * likelihood.sigma_px / np.maximum(likelihood.length_px, likelihood.sigma_px)
    density = [(2 / np.pi) ** 0.5 * np.exp(-0.5 * _squared(likelihood, F)) for F in models]
    weights, log_density = mixture(np.stack([*density, chance], axis=1))
    return weights[:-1], float(log_density.sum())


def _search(likelihood: Likelihood, rng: np.random.Generator) -> Array | None:
    return ransac(SmearEstimator(likelihood=likelihood, compact=True), SEARCH, rng).model


def _refit(likelihood: Likelihood, F: Array) -> Array:
    """Return F (3, 3) refined on the seven-parameter manifold, each smear in its better order."""
    if len(likelihood) < 8:
        return F
    start = WeightedPoint(point=GeneralF.from_matrix(F), likelihood=likelihood)
    *_, best = levenberg_marquardt(start, 6, 1e-5)
    return best.point.matrix()


def _squared(likelihood: Likelihood, F: Array) -> Array:
    """Return squared residuals (N,) of the better order, in standard deviations."""
    squared: Array = likelihood.residuals(F).least ** 2
    return squared
