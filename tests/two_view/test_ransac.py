"""The robust loop on a problem that has nothing to do with geometry: the mean of numbers with outliers."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from blur2view.two_view.ransac import BATCH, MAX_ITERATIONS, ransac

Floats = NDArray[Any]


@dataclass
class Location:
    """Location of a cluster at 5 among uniform outliers; a sample is one number."""

    values: Floats
    sample_size: ClassVar[int] = 1
    inliers: float = 0.0
    refined: int = 0

    @property
    def count(self) -> int:
        """Give the number of values."""
        return len(self.values)

    def generate_models(self, samples: int, rng: np.random.Generator) -> Floats:
        """Draw values."""
        return rng.choice(self.values, samples)

    def score(self, models: Floats, block: NDArray[np.int_]) -> Floats:
        """Give truncated squares."""
        total: Floats = np.minimum((models[:, None] - self.values[block]) ** 2, 1.0).sum(axis=1)
        return total

    def refine(self, model: Floats) -> Floats:
        """Average the neighbours."""
        self.refined += 1
        return np.asarray(self.values[np.abs(self.values - model) < 1].mean())

    def inlier_share(self, model: Floats) -> float:
        """Give what the test asked for."""
        return self.inliers


def problem(**shares: float) -> Location:
    rng = np.random.default_rng(0)
    return Location(np.concatenate([rng.normal(5, 0.1, 300), rng.uniform(-50, 50, 700)]), **shares)  # type: ignore[arg-type]


def test_finds_the_cluster_and_refines_it() -> None:
    location = problem()
    report = ransac(location, np.random.default_rng(1))
    assert report.model is not None and location.refined > 0
    assert abs(float(report.model) - 5) < 0.05


def test_ends_when_a_better_sample_is_unlikely() -> None:
    drawn = []
    for inliers in (1.0, 0.03, 0.0):
        location = problem(inliers=inliers)
        batches = 0

        def generate(samples: int, rng: np.random.Generator, location: Location = location) -> Floats:
            nonlocal batches
            batches += 1
            return rng.choice(location.values, samples)

        location.generate_models = generate  # type: ignore[method-assign]
        report = ransac(location, np.random.default_rng(1))
        assert (report.iterations, report.inlier_ratio) == (batches * BATCH, inliers)
        drawn.append(report.iterations)
    needed = np.log(0.01) / np.log(0.97)
    assert drawn[0] == BATCH and needed <= drawn[1] < needed + BATCH
    assert MAX_ITERATIONS <= drawn[2] < MAX_ITERATIONS + BATCH


def test_the_same_generator_gives_the_same_search() -> None:
    searches: list[list[int]] = [[], []]
    for search in searches:
        location = problem(inliers=1.0)

        def score(
            models: Floats, block: NDArray[np.int_], location: Location = location, search: list[int] = search
        ) -> Floats:
            search.extend(block.tolist())
            return Location.score(location, models, block)

        location.score = score  # type: ignore[method-assign]
        ransac(location, np.random.default_rng(1))
    assert searches[0] == searches[1]
