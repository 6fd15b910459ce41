"""The score by which the search compares models is MSAC's, in standard deviations of each smear."""

from __future__ import annotations

import numpy as np

from blur2view.geometry.sampson import serrmin
from blur2view.robust.residuals import CUTOFF
from blur2view.smears.matches import SmearMatches
from blur2view.two_view.model_selection import build_estimator
from tests.support.scenes import IMAGE_SIZE, make_scene


def test_score_is_the_cut_sum_of_squared_distances_in_standard_deviations() -> None:
    rng = np.random.default_rng(0)
    ends = make_scene(rng, count=200, length_px=15).ends
    sigma = rng.uniform(0.3, 3, len(ends))
    matches = SmearMatches.from_points(ends[:, 0], ends[:, 1], sigma_px=sigma, image_size=IMAGE_SIZE)
    estimator = build_estimator(matches)
    models, some = rng.normal(size=(20, 3, 3)), rng.permutation(200)[:150]
    squared = np.stack([serrmin(estimator.problem.pixels(F), ends) for F in models])
    deviations = squared / matches.sampson_px**2
    expected = np.minimum(deviations, CUTOFF**2)[:, some].sum(axis=1)
    np.testing.assert_allclose(estimator.score(models, some), expected, rtol=1e-3)
