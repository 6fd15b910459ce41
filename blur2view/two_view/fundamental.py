"""F of smears of unknown order: a robust search, then a fit of the likelihood from several starts.

A photograph's camera is roughly known (`constants.ASSUMED_FOCAL`) and rotates little during an exposure:
F = [t]x (I + [w]x) to first order, and for every direction t of a grid three smears fix w linearly. These
F are approximate, and are refined by local optimisation. (Seven smears determine F without assumptions, but
a sample of seven has more outliers, and noise spoils it.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, Array
from blur2view.geometry.epipolar import EndProducts, cross_matrix, homogeneous, unit_lines
from blur2view.geometry.pose import half_sphere, rotation_flow, rotation_matrix
from blur2view.two_view import constants as c
from blur2view.two_view.least_squares import last_point, levenberg_marquardt, race, reweighted_motion
from blur2view.two_view.likelihood import NormalisedSmears, OrderedResiduals
from blur2view.two_view.models import UNROTATED, FundamentalManifold
from blur2view.two_view.ransac import Report, ransac

MIN_LENGTH = np.float32(1e-6)  # of a smear over the focal length: shorter ones have no direction
ORDERS_OF_THREE: Array = np.array([[1.0, 1, 1], [1, 1, -1], [1, -1, 1], [1, -1, -1]])  # but for F^T


@dataclass(frozen=True, kw_only=True, eq=False)
class FundamentalFit:
    """An F with its cost and derivatives for the smears: a `least_squares.Problem`.

    At every point the smears' orders, and whether they are outliers, have new probabilities, which are the
    weights (expectation-maximisation). The ``sign`` of the translation stays; with it positive depth gives
    prior probabilities to the orders. A sign of 0 takes the better order of each smear as certain: right for
    a search at unknown noise, but it rewards any symmetric part of F as large as the noise (on pure
    translations with 4 degrees of noise median rho 0.022 against 0.010). With 30 % outliers and 1 px of noise
    the mixture of inliers and outliers gives an AUC@10 of the pose of 0.83, Geman and McClure's cost 0.72.
    """

    point: FundamentalManifold
    smears: NormalisedSmears
    sign: float = 0.0

    @classmethod
    def likelier(cls, point: FundamentalManifold, smears: NormalisedSmears) -> FundamentalFit:
        """Return the fit at a point with the sign of the translation of lower cost."""
        fits = (cls(point=point, smears=smears, sign=sign) for sign in (1.0, -1.0))
        return min(fits, key=lambda fit: fit.cost)

    @cached_property
    def residuals(self) -> OrderedResiduals:
        """Residuals in both orders, with the prior probability of the orders."""
        plain = self.smears.residuals(self.point.matrix())
        if not self.sign:
            return plain.decided()
        return replace(plain, order_prior=self.smears.order_odds(*self.point.motion(), self.sign))

    @cached_property
    def cost(self) -> float:
        """Twice the negative log-posterior."""
        prior_residuals, _ = self.point.prior_residuals()
        data = self.residuals.costs.sum()
        return float(self.smears.effective_share * data + prior_residuals @ prior_residuals)

    def normal_equations(self) -> tuple[Array, Array]:
        """Return J^T W J (8, 8) and J^T W r (8,) of both orders of all smears and of the prior."""
        smears, residuals = self.smears, self.residuals
        weight = np.sqrt(smears.effective_share * residuals.weights)
        F, tangents = self.point.matrix(), self.point.tangent()
        jacobian = smears.products.derivatives(F, tangents, residuals.both, residuals.root)
        jacobian *= weight
        jacobian = jacobian.reshape(len(jacobian), -1)
        prior_residuals, prior_jacobian = self.point.prior_residuals()
        normal = jacobian @ jacobian.T + prior_jacobian.T @ prior_jacobian
        gradient = jacobian @ (weight * residuals.both).reshape(-1)
        return normal, gradient + prior_jacobian.T @ prior_residuals

    def moved(self, delta: Array) -> FundamentalFit:
        """Return the point moved by delta (8,)."""
        return replace(self, point=self.point.step(delta))


def fit_best(starts: Sequence[FundamentalManifold], smears: NormalisedSmears) -> FundamentalFit:
    """Return the fit of least cost from several starts, which race (`race`)."""
    fits = [FundamentalFit.likelier(start, smears) for start in starts]
    return race(fits, c.STARTERS, c.STEPS, c.TOLERANCE, c.MIN_STEP)


@dataclass(frozen=True, kw_only=True, eq=False)
class SmearEstimator:
    """F (3, 3) of normalised coordinates from three smears and a grid of directions: a `ransac.Estimator`."""

    smears: NormalisedSmears
    sample_size: ClassVar[int] = 3  # with a direction of translation

    @property
    def count(self) -> int:
        """Number of smears."""
        return len(self.smears)

    @cached_property
    def products(self) -> EndProducts:
        """Products of the ends' coordinates in single precision, for SErrMin of many models at once."""
        return EndProducts(self.smears.ends, self.smears.sigma, np.float32)

    @cached_property
    def quality(self) -> Array:
        """Probabilities (N,) of being drawn: length over standard deviation, squared."""
        weights = (self.smears.matches.length_px / self.smears.sigma_px) ** 2 + TINY
        return np.asarray(weights / weights.sum())

    def generate_models(self, samples: int, rng: np.random.Generator) -> Array:
        """Return candidates (M, 3, 3) of ``samples`` samples of three, for every direction."""
        three = rng.choice(self.count, (samples, self.sample_size), p=self.quality)
        limit = 3 * self.smears.prior_sigma[:3]
        return small_rotation_hypotheses(self.smears.ends[three], half_sphere(c.SEARCH_DIRECTIONS), limit)

    def score(self, models: Array, block: NDArray[np.int_]) -> NDArray[Any]:
        """Return MSAC's cost (M,): SErrMin in squared standard deviations, cut at CUTOFF squared."""
        return self.products.costs(models, c.CUTOFF**2, block)

    def refine(self, model: Array) -> Array:
        """Return F (3, 3) after a few steps, first with larger standard deviations, as it is approximate."""
        some = self.smears.thinned(c.ROUGH_COUNT)
        for smears in (some.rescaled(c.WIDE), some):
            start = FundamentalManifold.from_matrix(model, smears.prior_sigma)
            problem = FundamentalFit(point=start, smears=smears)
            reached = last_point(levenberg_marquardt(problem, c.SEARCH_STEPS, c.SEARCH_TOLERANCE))
            model = reached.point.matrix()
        return model

    def inlier_share(self, model: Array) -> float:
        """Return the share of smears within CUTOFF, by chance or not."""
        return float((self.smears.residuals(model).least < c.CUTOFF).mean())


def small_rotation_hypotheses(ends: Array, directions: Array, limit: Array) -> Array:
    """Return F = [t]x (I + [w]x), (M, 3, 3), for every sample of three smears, direction t and four patterns.

    The order-free equation is |w . (p (t.p) - t (p.p))| = |t . (x x y)|; signs make it linear in w. Samples
    (B, 3, 2, 2) are in coordinates of the assumed camera (K = identity), directions (T, 3) of unit length.
    Rotations w with |w / limit| > 1, ``limit`` (3,), are dropped, as are dependent smears.
    """
    x, y = (np.moveaxis(homogeneous(ends[:, :, i]), -1, 0)[..., None] for i in (0, 1))  # (3, B, 3, 1)
    p, t = 0.5 * (x + y), directions.T[:, None]  # (3, B, 3, 1) and (3, 1, T)
    coefficients = p * (p * t[:, None]).sum(axis=0) - t[:, None] * (p * p).sum(axis=0)  # of w: (3, B, 3, T)
    sides = (np.cross(x, y, axis=0) * t[:, None]).sum(axis=0)  # right-hand sides t . (x x y): (B, 3, T)
    # Cramer's rule: w is the sum over the three smears of their signs times these terms (3, 3, B, T)
    first, second, third = np.moveaxis(coefficients, 2, 0)  # each (3, B, T)
    others = (second, third), (third, first), (first, second)
    cofactors = np.stack([np.cross(*pair, axis=0) for pair in others], axis=1)
    determinant = (first * cofactors[:, 0]).sum(axis=0)  # (B, T)
    regular = np.abs(determinant) >= TINY
    terms = cofactors * (np.moveaxis(sides, 1, 0) / np.where(regular, determinant, np.nan))
    terms = np.moveaxis(terms, 2, 0).swapaxes(1, 2).reshape(len(ends), 3, -1)
    rotations = (ORDERS_OF_THREE @ terms).reshape(len(ends), -1, 3, len(directions))  # (B, 4, 3, T)
    plausible = (rotations**2 * (limit**-2.0)[:, None]).sum(axis=2) <= 1  # NaN, of dependent smears, is not
    sample, pattern, direction = np.nonzero(plausible)
    w, t = rotations[sample, pattern, :, direction], directions[direction]  # (M, 3)
    hypotheses: Array = w[:, :, None] * t[:, None, :]  # because [t]x [w]x = w t^T - (t . w) I
    hypotheses += cross_matrix(directions)[direction]
    hypotheses.reshape(-1, 9)[:, ::4] -= (w * t).sum(axis=1)[:, None]
    return hypotheses


@dataclass(frozen=True, kw_only=True, eq=False)
class DirectionLikelihood:
    """The likelihood of every direction of translation, on a grid over half a sphere.

    A direction determines the epipolar line of every smear and its order (a point before the camera moves
    away from the epipole), and the rotation that brings most smears onto their lines is found linearly.
    Where the camera only turns the likelihood is flat, which no covariance about one optimum shows.
    Coordinates are those of a camera with K = identity; its smears count with all of their correlation.
    """

    smears: NormalisedSmears

    def at(self, directions: Array) -> tuple[Array, Array, Array]:
        """Return the best rotation vectors (G, 3) for directions (G, 3), their costs, and the smears' orders.

        Costs (G,) are twice the negative log-posterior; orders (G, N) are 1 where ends[:, 0] is the open end,
        else -1.
        """
        some = self.smears.thinned(c.GRID_SMEARS)
        middle, displacement = some.middle.astype(np.float32), some.displacement.astype(np.float32)
        length = np.maximum(np.hypot(*displacement.T), MIN_LENGTH)
        unit, flow = displacement.T / length, rotation_flow(middle) / length
        along, across = unit_lines(directions.astype(np.float32), middle)  # (G, 2, N)
        rows = across[:, 0, None] * flow[0] + across[:, 1, None] * flow[1]  # (G, 3, N)
        outwards = np.copysign(np.float32(1), along[:, 0] * unit[0] + along[:, 1] * unit[1])
        target = outwards * (across[:, 0] * unit[0] + across[:, 1] * unit[1])  # (G, N)
        stated = some.field_sigmas_px[1] / (length * some.unit_px)  # error across, over the length
        # `NoiseModel.sampson_px` adds this share of the length, because paths are bent
        share = np.hypot(stated, some.matches.shared.added_sampson).astype(np.float32)
        rotations, residuals = reweighted_motion(
            rows[:, :, None], target[:, None], steps=c.GRID_STEPS, scale=lambda _: share
        )
        data = (c.FREEDOM + 1) * np.log1p((residuals / share) ** 2 / c.FREEDOM).mean(axis=1, dtype=float)
        prior_cost = ((rotations / (c.GRID_ROTATION_SPREAD * float(np.median(length)))) ** 2).sum(axis=1)
        return rotations.astype(float), self.smears.effective_count * data + prior_cost, outwards

    @cached_property
    def grid(self) -> tuple[Array, Array, Array, Array]:
        """Directions (G, 3) over half a sphere, and what `at` returns for them."""
        directions = half_sphere(c.GRID)
        parts = [self.at(some) for some in np.array_split(directions, c.GRID_PARTS)]
        rotations, costs, orders = (np.concatenate(part) for part in zip(*parts, strict=True))
        return directions, rotations, costs, orders

    def likeliest(self, count: int) -> list[tuple[Array, Array]]:
        """Return the likeliest rotation vectors and translations (3,), ``count`` at most.

        No two translations are closer than GRID_APART allows.
        """
        directions, rotations, costs, _ = self.grid
        best: list[int] = []
        for index in np.argsort(costs):
            if len(best) < count and (np.abs(directions[best] @ directions[index]) < c.GRID_APART).all():
                best.append(int(index))
        return [(rotations[index], directions[index]) for index in best]


def search_and_fit(
    smears: NormalisedSmears, rng: np.random.Generator
) -> tuple[NormalisedSmears, FundamentalFit, Report]:
    """Return the smears with noise as the residuals of F show it, F, and the report of the search for it.

    F starts from the search, from a pure translation and, where many smears are independent, from the
    likeliest directions of translation: without these 3 of 46 scenes of exact smears end in another minimum.
    """
    estimator = SmearEstimator(smears=smears)
    search, simple = ransac(estimator, rng), fit_translation(estimator, rng).matrix()
    starts = [simple] if search.model is None else [search.model, simple]
    if smears.has_many_independent:
        grid = DirectionLikelihood(smears=smears.fully_correlated)
        starts += [cross_matrix(t) @ rotation_matrix(w) for w, t in grid.likeliest(c.GRID_STARTS)]
    rough = with_measured_noise(smears.thinned(c.ROUGH_COUNT), starts[0])  # no fitted F is known yet
    points = [FundamentalManifold.from_matrix(F, smears.prior_sigma) for F in starts]
    point = fit_best(points, rough).point
    rescaled_smears = with_measured_noise(smears, point.matrix())
    return rescaled_smears, fit_best([point], rescaled_smears), search


def fit_translation(estimator: SmearEstimator, rng: np.random.Generator) -> FundamentalManifold:
    """Return the two-parameter F [e]x, fitted on the deviations as stated.

    It starts at the best of the points e, unit homogeneous, where the lines of two smears meet.
    """
    some, ends = estimator.smears.thinned(c.ROUGH_COUNT), estimator.smears.ends
    pairs = ends[rng.choice(estimator.count, (c.PAIRS, 2), p=estimator.quality)]
    lines = np.cross(homogeneous(pairs[:, :, 0]), homogeneous(pairs[:, :, 1]))  # (PAIRS, 2, 3)
    points = np.vstack([[0.0, 0.0, 1.0], np.cross(lines[:, 0], lines[:, 1])])
    norm = np.linalg.norm(points, axis=1, keepdims=True)
    points = (points / np.maximum(norm, TINY))[norm[:, 0] > TINY]  # two smears on one line meet nowhere
    costs = SmearEstimator(smears=some).score(cross_matrix(points), np.arange(len(some)))
    start = FundamentalManifold(t=points[int(np.argmin(costs))], R=np.eye(3), prior_sigma=UNROTATED)
    *_, best = levenberg_marquardt(FundamentalFit(point=start, smears=some), c.STEPS, c.TOLERANCE)
    return best.point


def with_measured_noise(smears: NormalisedSmears, F: Array) -> NormalisedSmears:
    """Return the smears with standard deviations as the residuals of F show: 0.1 to 4 times the stated.

    The residuals below CUTOFF, of the better order, are taken for a mixture of half normal inliers and
    uniform outliers, which is fitted by expectation-maximisation.
    """
    residual = smears.residuals(F).least
    squared = residual[residual < c.CUTOFF] ** 2
    if not len(squared):
        return smears
    variance, inliers = max(1.4826**2 * float(np.median(squared)), c.MIN_VARIANCE), 0.5
    for _ in range(c.SCALE_STEPS):
        normal = inliers * (2 / (np.pi * variance)) ** 0.5 * np.exp(-squared / (2 * variance))
        share = normal / (normal + (1 - inliers) / c.CUTOFF)
        total = float(share.sum())
        inliers = min(total / len(squared), 0.999)
        variance = max(float(share @ squared) / max(total, 1e-9), c.MIN_VARIANCE)
    return smears.rescaled(float(np.clip(variance**0.5, 0.1, 4.0)))
