"""What the robust loop asks of F: samples, models, scores, local optimisation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, Array
from blur2view.geometry.epipolar import cross_matrix
from blur2view.geometry.rotation import half_sphere
from blur2view.geometry.sampson import BatchSampson, serrmin
from blur2view.robust.minimal_solvers import (
    SAMPLE_SIZE,
    meeting_points,
    small_rotation_hypotheses,
    solve_seven_smears,
)
from blur2view.robust.parametrization import GeneralF, TranslationF
from blur2view.robust.problem import SmearProblem
from blur2view.robust.ransac import weighted_samples
from blur2view.robust.refinement import refine
from blur2view.robust.residuals import CUTOFF, RefineOptions, WeightedEnds

WIDE, SEARCH_STEPS = 3.0, 3  # Levenberg-Marquardt steps inside the loop; the final fit takes more
SEARCH_TOLERANCE = 1e-2  # relative decrease of the cost that ends them
DIRECTIONS = 80  # of translation tried with every sample of three
DIRECTIONS_OF_PART = 60  # and with one from a part of the image
FIT_ERROR_PX = 1.0  # the paper's, on the root of SErrMin, for the stop on fit
PART = 5  # samples come from the fifth of the smears nearest to one of them


@dataclass(frozen=True, kw_only=True, eq=False)
class SmearEstimator:
    """F from seven smears, or from three and a grid of directions (`ransac.Estimator`).

    Models are F (3, 3) in normalised coordinates. The score is MSAC's: squared residuals in standard
    deviations, cut at CUTOFF.
    """

    problem: SmearProblem
    sample_size: ClassVar[int] = (
        3  # with a camera guessed from the points, if need be, three smears and a direction do
    )

    @property
    def count(self) -> int:
        """Number of smears."""
        return len(self.problem.ends)

    @cached_property
    def sampson(self) -> BatchSampson:
        """SErrMin of many models at once, squared pixels."""
        return BatchSampson(self.problem.ends, self.problem.unit_px)

    @cached_property
    def quality(self) -> Array:
        """Sampling weights (N,): length over standard deviation, squared."""
        weights: Array = (self.problem.length_px / self.problem.sigma_px) ** 2
        return weights

    @cached_property
    def precision(self) -> NDArray[np.float32]:
        """1 / sigma^2 (N,)."""
        return np.asarray(1 / self.problem.sigma_px**2, np.float32)

    def generate_models(self, samples: int, rng: np.random.Generator) -> Array:
        """Return candidates (M, 3, 3) of samples of three and, where no camera is assumed, of seven."""
        ends, limit = self.problem.ends, 3 * np.array(self.problem.prior.rotation)
        three = weighted_samples(self.quality, 3, samples, rng)
        models = small_rotation_hypotheses(ends[three], half_sphere(DIRECTIONS), limit)
        if self.problem.has_camera:
            return models
        seven = weighted_samples(self.quality, SAMPLE_SIZE, samples, rng)
        return np.concatenate([models, solve_seven_smears(ends[seven])])

    def score(self, models: Array, block: NDArray[np.int_]) -> NDArray[Any]:
        """Return MSAC cost (M,)."""
        return self.sampson.costs(models, self.precision, CUTOFF**2, block)

    def refine(self, model: Array) -> Array:
        """Return the model after a few steps on all of F, wider sigmas first: it is coarse."""
        options = RefineOptions(max_iterations=SEARCH_STEPS, tolerance=SEARCH_TOLERANCE, decided=True)
        point = GeneralF.from_matrix(model)
        for matches in self.coarse:
            point, _ = refine(point, matches, options)
        return point.matrix()

    @cached_property
    def coarse(self) -> list[WeightedEnds]:
        """Some of the smears, sigmas as they are and, before that, wider."""
        some = self.problem.thinned.weighted
        return [replace(some, sigma=width * some.sigma) for width in (WIDE, 1.0)]

    def shares(self, model: Array) -> tuple[float, float]:
        """Return the share under the paper's threshold, and that of inliers beyond chance.

        A smear of length L and random direction passes a bound on its Sampson distance with probability
        2 / pi asin(sqrt(2) bound / L) in one order; two orders are two chances.
        """
        squared = serrmin(model, self.problem.ends) * self.problem.unit_px**2
        bound = 2**0.5 * CUTOFF * self.problem.sigma_px / np.maximum(self.problem.length_px, TINY)
        chance = 1 - (1 - 2 / np.pi * np.arcsin(np.minimum(bound, 1.0)).mean()) ** 2
        inside = float((squared * self.precision < CUTOFF**2).mean())
        return float((squared < FIT_ERROR_PX**2).mean()), (inside - chance) / max(1 - chance, TINY)


def translation_start(estimator: SmearEstimator, samples: int, rng: np.random.Generator) -> TranslationF:
    """Return the best meeting point of pairs of smears: the start of the two-parameter F."""
    drawn = weighted_samples(estimator.quality, 2, samples, rng)
    points = meeting_points(estimator.problem.ends[drawn])
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
        middle = self.problem.middle
        distance = ((middle - middle[rng.integers(len(middle))]) ** 2).sum(axis=1)
        near = np.argsort(distance, kind="stable")[: max(len(middle) // PART, 30)]
        three = near[weighted_samples(np.ones(len(near)), 3, samples, rng)]
        limit = 3 * np.array(self.problem.prior.rotation)
        return small_rotation_hypotheses(self.problem.ends[three], half_sphere(DIRECTIONS_OF_PART), limit)
