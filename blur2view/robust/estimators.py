"""What the robust loop asks of F: samples, models, scores, local optimisation."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, Array
from blur2view.geometry.rotation import half_sphere
from blur2view.geometry.sampson import BatchSampson, serrmin
from blur2view.robust import calibration as c
from blur2view.robust.levenberg_marquardt import levenberg_marquardt
from blur2view.robust.likelihood import Likelihood
from blur2view.robust.minimal_solvers import small_rotation_hypotheses
from blur2view.robust.parametrization import GeneralF
from blur2view.robust.ransac import weighted_samples
from blur2view.robust.refinement import WeightedPoint


@dataclass(frozen=True, kw_only=True, eq=False)
class SmearEstimator:
    """F from three smears and a grid of directions (`ransac.Estimator`).

    Models are F (3, 3) in normalised coordinates. The score is MSAC's: squared residuals in standard
    deviations, cut at CUTOFF. ``compact`` samples come from one compact part of the image a batch, which
    mostly holds one motion of several; they say less of the only one.
    """

    likelihood: Likelihood
    compact: bool = False
    sample_size: ClassVar[int] = 3  # with a direction of translation

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
        limit, near = 3 * np.array(self.likelihood.prior.rotation), np.arange(self.count)
        if self.compact:
            middle = self.likelihood.middle
            distance = ((middle - middle[rng.integers(self.count)]) ** 2).sum(axis=1)
            near = np.argsort(distance, kind="stable")[: max(self.count // c.PART, 30)]
        three = near[weighted_samples(self.quality[near], 3, samples, rng)]
        return small_rotation_hypotheses(self.likelihood.ends[three], half_sphere(c.DIRECTIONS), limit)

    def score(self, models: Array, block: NDArray[np.int_]) -> NDArray[Any]:
        """Return MSAC cost (M,)."""
        return self.sampson.costs(models, self.precision, c.CUTOFF**2, block)

    def refine(self, model: Array) -> Array:
        """Return the model after a few steps on all of F, wider sigmas first: it is coarse."""
        some, point = self.likelihood.thinned, GeneralF.from_matrix(model)
        for likelihood in (some.rescaled(c.WIDE), some):
            start = WeightedPoint(point=point, likelihood=likelihood)
            *_, best = levenberg_marquardt(start, c.SEARCH_STEPS, c.SEARCH_TOLERANCE)
            point = best.point
        return point.matrix()

    def inlier_share(self, model: Array) -> float:
        """Return the share of inliers beyond chance.

        A smear of length L and random direction passes a bound on its Sampson distance with probability
        2 / pi asin(sqrt(2) bound / L) in one order; two orders are two chances.
        """
        squared = serrmin(model, self.likelihood.ends) * self.likelihood.unit_px**2
        bound = 2**0.5 * c.CUTOFF * self.likelihood.sigma_px / np.maximum(self.likelihood.length_px, TINY)
        chance = 1 - (1 - 2 / np.pi * np.arcsin(np.minimum(bound, 1.0)).mean()) ** 2
        inside = float((squared * self.precision < c.CUTOFF**2).mean())
        return float((inside - chance) / max(1 - chance, TINY))
