"""What the robust loop asks of F: samples, models, scores, local optimisation."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, Array
from blur2view.geometry.epipolar import cross_matrix
from blur2view.geometry.rotation import half_sphere
from blur2view.geometry.sampson import BatchSampson, serrmin
from blur2view.robust import calibration as c
from blur2view.robust.likelihood import Likelihood
from blur2view.robust.minimal_solvers import meeting_points, small_rotation_hypotheses
from blur2view.robust.parametrization import GeneralF, TranslationF
from blur2view.robust.ransac import weighted_samples
from blur2view.robust.refinement import refine
from blur2view.robust.residuals import RefineOptions


@dataclass(frozen=True, kw_only=True, eq=False)
class SmearEstimator:
    """F from three smears and a grid of directions (`ransac.Estimator`).

    Models are F (3, 3) in normalised coordinates. The score is MSAC's: squared residuals in standard
    deviations, cut at CUTOFF.
    """

    likelihood: Likelihood
    sample_size: ClassVar[int] = (
        3  # with a camera guessed from the points, if need be, three smears and a direction do
    )

    @property
    def count(self) -> int:
        """Number of smears."""
        return len(self.likelihood)

    @cached_property
    def sampson(self) -> BatchSampson:
        """SErrMin of many models at once, squared pixels."""
        return BatchSampson(self.likelihood.ends, self.likelihood.unit_px)

    @cached_property
    def quality(self) -> Array:
        """Sampling weights (N,): length over standard deviation, squared."""
        weights: Array = (self.likelihood.length_px / self.likelihood.sigma_px) ** 2
        return weights

    @cached_property
    def precision(self) -> NDArray[np.float32]:
        """1 / sigma^2 (N,)."""
        return np.asarray(1 / self.likelihood.sigma_px**2, np.float32)

    def generate_models(self, samples: int, rng: np.random.Generator) -> Array:
        """Return candidates (M, 3, 3) of ``samples`` samples of three, for every direction."""
        limit = 3 * np.array(self.likelihood.prior.rotation)
        three = weighted_samples(self.quality, 3, samples, rng)
        return small_rotation_hypotheses(self.likelihood.ends[three], half_sphere(c.DIRECTIONS), limit)

    def score(self, models: Array, block: NDArray[np.int_]) -> NDArray[Any]:
        """Return MSAC cost (M,)."""
        return self.sampson.costs(models, self.precision, c.CUTOFF**2, block)

    def refine(self, model: Array) -> Array:
        """Return the model after a few steps on all of F, wider sigmas first: it is coarse."""
        options = RefineOptions(max_iterations=c.SEARCH_STEPS, tolerance=c.SEARCH_TOLERANCE, decided=True)
        point = GeneralF.from_matrix(model)
        for likelihood in self.coarse:
            point, _ = refine(point, likelihood, options)
        return point.matrix()

    @cached_property
    def coarse(self) -> list[Likelihood]:
        """Some of the smears, sigmas as they are and, before that, wider."""
        some = self.likelihood.thinned
        return [some.rescaled(c.WIDE), some]

    def shares(self, model: Array) -> tuple[float, float]:
        """Return the share under the paper's threshold, and that of inliers beyond chance.

        A smear of length L and random direction passes a bound on its Sampson distance with probability
        2 / pi asin(sqrt(2) bound / L) in one order; two orders are two chances.
        """
        squared = serrmin(model, self.likelihood.ends) * self.likelihood.unit_px**2
        bound = 2**0.5 * c.CUTOFF * self.likelihood.sigma_px / np.maximum(self.likelihood.length_px, TINY)
        chance = 1 - (1 - 2 / np.pi * np.arcsin(np.minimum(bound, 1.0)).mean()) ** 2
        inside = float((squared * self.precision < c.CUTOFF**2).mean())
        return float((squared < c.FIT_ERROR_PX**2).mean()), (inside - chance) / max(1 - chance, TINY)


def translation_start(estimator: SmearEstimator, samples: int, rng: np.random.Generator) -> TranslationF:
    """Return the best meeting point of pairs of smears: the start of the two-parameter F."""
    drawn = weighted_samples(estimator.quality, 2, samples, rng)
    points = meeting_points(estimator.likelihood.ends[drawn])
    points = points[np.linalg.norm(points, axis=1) > 0.5]
    if not len(points):
        return TranslationF(epipole=np.array([0.0, 0.0, 1.0]))
    order = rng.permutation(estimator.count)[:500]
    cost = estimator.score(cross_matrix(points), order)
    return TranslationF(epipole=points[int(np.argmin(cost))])


@dataclass(frozen=True, kw_only=True, eq=False)
class LocalEstimator(SmearEstimator):
    """`SmearEstimator` whose samples come from one compact part of the image a batch."""

    def generate_models(self, samples: int, rng: np.random.Generator) -> Array:
        """Return candidates (M, 3, 3) of ``samples`` samples of three."""
        middle = self.likelihood.middle
        distance = ((middle - middle[rng.integers(len(middle))]) ** 2).sum(axis=1)
        near = np.argsort(distance, kind="stable")[: max(len(middle) // c.PART, 30)]
        three = near[weighted_samples(np.ones(len(near)), 3, samples, rng)]
        limit = 3 * np.array(self.likelihood.prior.rotation)
        return small_rotation_hypotheses(
            self.likelihood.ends[three], half_sphere(c.DIRECTIONS_OF_PART), limit
        )
