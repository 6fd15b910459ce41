"""What the robust loop asks of F: samples, models, scores, local optimisation.

A photograph's camera is roughly known (`constants.ASSUMED_FOCAL`) and rotates little during an exposure:
F = [t]x (I + [w]x) to first order, and for every direction t of a grid three smears fix w linearly. These
starts are approximate; local optimisation makes them exact. (Seven smears fix any F exactly, but one wrong
smear in seven spoils it, and so does noise.)
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, Array
from blur2view.geometry.epipolar import cross_matrix, homogeneous
from blur2view.geometry.rotation import half_sphere
from blur2view.geometry.sampson import EndProducts
from blur2view.two_view import constants as c
from blur2view.two_view.fit_fundamental import (
    FundamentalFit,
    distinct,
    fit_best,
    fit_roughly,
    with_measured_noise,
)
from blur2view.two_view.levenberg_marquardt import levenberg_marquardt
from blur2view.two_view.likelihood import Likelihood
from blur2view.two_view.models import UNROTATED, CameraF, FundamentalModel, GeneralF
from blur2view.two_view.ransac import RansacOptions, ransac, weighted_samples

ORDERS_OF_THREE: Array = np.array([[1.0, 1, 1], [1, 1, -1], [1, -1, 1], [1, -1, -1]])  # but for F^T

SEARCH = RansacOptions(confidence=0.99)  # is enough: a sample yields many starts


@dataclass(frozen=True, kw_only=True, eq=False)
class SmearEstimator:
    """F from three smears and a grid of directions (`ransac.Estimator`).

    Models are F (3, 3) in normalised coordinates. The score is MSAC's: squared residuals in standard
    deviations, cut at CUTOFF.
    """

    likelihood: Likelihood
    sample_size: ClassVar[int] = 3  # with a direction of translation

    @property
    def count(self) -> int:
        """Number of smears."""
        return len(self.likelihood)

    @cached_property
    def products(self) -> EndProducts:
        """Products of the ends' coordinates, for SErrMin of many models at once."""
        sigma = self.likelihood.sigma_px / self.likelihood.unit_px
        return EndProducts(self.likelihood.ends, sigma, np.float32)

    @cached_property
    def quality(self) -> Array:
        """Sampling weights (N,): length over standard deviation, squared."""
        weights: Array = (self.likelihood.length_px / self.likelihood.sigma_px) ** 2
        return weights

    def generate_models(self, samples: int, rng: np.random.Generator) -> Array:
        """Return candidates (M, 3, 3) of ``samples`` samples of three, for every direction."""
        limit = 3 * np.array(self.likelihood.prior.rotation)
        three = weighted_samples(self.quality, 3, samples, rng)
        return small_rotation_hypotheses(self.likelihood.ends[three], half_sphere(c.DIRECTIONS), limit)

    def score(self, models: Array, block: NDArray[np.int_]) -> NDArray[Any]:
        """Return MSAC cost (M,)."""
        return self.products.costs(models, c.CUTOFF**2, block)

    def refine(self, model: Array) -> Array:
        """Return the model after a few steps on all of F, wider sigmas first: it is coarse."""
        some = self.likelihood.thinned
        for likelihood in (some.rescaled(c.WIDE), some):
            start = FundamentalFit(point=GeneralF.from_matrix(model), likelihood=likelihood)
            *_, best = levenberg_marquardt(start, c.SEARCH_STEPS, c.SEARCH_TOLERANCE)
            model = best.point.matrix()
        return model

    def inlier_share(self, model: Array) -> float:
        """Return the share of inliers beyond chance, 1 where every smear is one under any model.

        A smear of length L and random direction passes a bound on its Sampson distance with probability
        2 / pi asin(sqrt(2) bound / L) in one order; two orders are two chances.
        """
        bound = 2**0.5 * c.CUTOFF * self.likelihood.sigma_px / np.maximum(self.likelihood.length_px, TINY)
        chance = 1 - (1 - 2 / np.pi * np.arcsin(np.minimum(bound, 1.0)).mean()) ** 2
        inside = float((np.abs(self.likelihood.residuals(model).least) < c.CUTOFF).mean())
        return float((inside - chance + TINY) / (1 - chance + TINY))


def small_rotation_hypotheses(ends: Array, directions: Array, limit: Array) -> Array:
    """Return F = [t]x (I + [w]x), (M, 3, 3), for every sample of three smears, direction t and four patterns.

    The order-free equation is |w . (p (t.p) - t (p.p))| = |t . (x x y)|; signs make it linear in w. Samples
    (B, 3, 2, 2) are in coordinates of the assumed camera (K = identity), directions (T, 3) of unit length.
    Rotations w with |w / limit| > 1, ``limit`` (3,), are dropped, as are dependent smears.
    """
    x, y = (np.moveaxis(homogeneous(ends[:, :, i]), -1, 0)[..., None] for i in (0, 1))  # (3, B, 3, 1)
    p, t = 0.5 * (x + y), directions.T[:, None]  # and (3, 1, T)
    smears = p * (p * t[:, None]).sum(axis=0) - t[:, None] * (p * p).sum(axis=0)  # rows (3, B, 3, T)
    right = (_cross(x, y) * t[:, None]).sum(axis=0)  # (B, 3, T)
    first, second, third = np.moveaxis(smears, 2, 0)  # each (3, B, T)
    adjugate = np.stack([_cross(second, third), _cross(third, first), _cross(first, second)], axis=1)
    determinant = (first * adjugate[:, 0]).sum(axis=0)  # (B, T)
    regular = np.abs(determinant) >= TINY
    shares = adjugate * (np.moveaxis(right, 1, 0) / np.where(regular, determinant, np.nan))  # (3, 3, B, T)
    rotation = ORDERS_OF_THREE @ np.moveaxis(shares, 2, 0).swapaxes(1, 2).reshape(
        len(ends), 3, -1
    )  # (B, 4, 3 T)
    rotation = rotation.reshape(len(ends), -1, 3, len(directions))
    inside = (rotation**2 * (limit**-2.0)[:, None]).sum(axis=2) <= 1  # False where singular
    sample, pattern, direction = np.nonzero(inside)
    w, along = rotation[sample, pattern, :, direction], directions[direction]
    hypotheses: Array = w[:, :, None] * along[:, None, :]  # [t]x [w]x = w t^T - (t . w) I
    hypotheses += cross_matrix(directions)[direction]
    hypotheses.reshape(-1, 9)[:, ::4] -= (w * along).sum(axis=1)[:, None]
    return hypotheses


def _cross(a: Array, b: Array) -> Array:
    """Return cross products along the first axis."""
    x = a[1] * b[2] - a[2] * b[1]
    return np.stack([x, a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def meeting_points(ends: Array) -> Array:
    """Return the unit homogeneous points (B, 3) where the lines of two smears (B, 2, 2, 2) meet.

    Two parts of one line meet everywhere; the answer is then some point or zero.
    """
    lines = np.cross(homogeneous(ends[:, :, 0]), homogeneous(ends[:, :, 1]))  # (B, 2, 3)
    points = np.cross(lines[:, 0], lines[:, 1])
    unit: Array = points / np.maximum(np.linalg.norm(points, axis=1, keepdims=True), TINY)
    return unit


def search_and_fit(likelihood: Likelihood, rng: np.random.Generator) -> tuple[Likelihood, FundamentalFit]:
    """Return the likelihood with the noise that F leaves, and F, fitted after a robust search.

    Where a camera may be assumed F is that of one (`CameraF`), else any (`GeneralF`). A camera's is refined
    from any F, too, as the rough fit may have ended in another minimum: beside a plane of 80 % in 2 of 16
    scenes, with an epipole 8 degrees off (`test_plane_parallax`).
    """
    estimator = SmearEstimator(likelihood=likelihood)
    searched = ransac(estimator, SEARCH, rng)
    simple = fit_translation(estimator, rng)
    start = simple.matrix() if searched.model is None else searched.model
    rough = with_measured_noise(likelihood.thinned, start)  # as the search's F has it
    starts = distinct([start, simple.matrix(), *searched.contenders])
    point = fit_roughly(starts, simple.matrix(), rough)
    measured = with_measured_noise(likelihood, point.matrix())  # and as the fitted F has it
    camera = fit_best([point], measured)
    if measured.has_camera and measured.effective_count < c.LEAST_INDEPENDENT:
        return measured, camera  # so few do not tell minima apart
    free = fit_best([GeneralF.from_matrix(F) for F in (camera.point.matrix(), *starts)], measured)
    if not measured.has_camera:
        return measured, free
    other = fit_best([CameraF.from_matrix(free.point.matrix(), measured.prior)], measured)
    return measured, min(camera, other, key=lambda fit: fit.cost)


def fit_translation(estimator: SmearEstimator, rng: np.random.Generator) -> FundamentalModel:
    """Return the two-parameter F, fitted on the standard deviations as given."""
    some = estimator.likelihood.thinned
    drawn = weighted_samples(estimator.quality, 2, c.PAIRS, rng)
    points = np.vstack([[0.0, 0.0, 1.0], meeting_points(estimator.likelihood.ends[drawn])])
    points = points[np.linalg.norm(points, axis=1) > 0.5]
    cost = SmearEstimator(likelihood=some).score(cross_matrix(points), np.arange(len(some)))
    start = CameraF(t=points[int(np.argmin(cost))], R=np.eye(3), spread=UNROTATED)
    *_, best = levenberg_marquardt(FundamentalFit(point=start, likelihood=some), c.STEPS, c.TOLERANCE)
    return best.point
