"""The robust loop on a problem that has nothing to do with geometry: the mean of numbers with outliers."""

from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
import pytest
from numpy.typing import NDArray

from blur2view.two_view.ransac import RansacOptions, needed_iterations, preempt, ransac

Floats = NDArray[Any]


@dataclass
class Location:
    """Location of a cluster at 5 among uniform outliers; a sample is one number."""

    values: Floats
    sample_size: ClassVar[int] = 1
    inliers: float = 0.0
    scored: list[int] = field(default_factory=list)
    refined: int = 0

    @property
    def count(self) -> int:
        """Give the number of values."""
        return len(self.values)

    def generate_models(self, samples: int, rng: np.random.Generator) -> Floats:
        """Draw values."""
        return rng.choice(self.values, samples)

    def score(self, models: Floats, block: NDArray[np.int_]) -> Floats:
        """Give truncated squares and count the work."""
        self.scored.append(len(models) * len(block))
        total: Floats = np.minimum((models[:, None] - self.values[block]) ** 2, 1.0).sum(axis=1)
        return total

    def refine(self, model: Floats) -> Floats:
        """Average the neighbours."""
        self.refined += 1
        return np.asarray(self.values[np.abs(self.values - model) < 1].mean())

    def inlier_share(self, model: Floats) -> float:
        """Give what the test asked for."""
        return self.inliers


def problem(seed: int = 0, **shares: float) -> Location:
    rng = np.random.default_rng(seed)
    return Location(np.concatenate([rng.normal(5, 0.1, 300), rng.uniform(-50, 50, 700)]), **shares)  # type: ignore[arg-type]


def test_finds_the_cluster_and_refines_it() -> None:
    found = ransac(problem(), RansacOptions(max_iterations=64), np.random.default_rng(1))
    assert found.model is not None
    assert abs(float(found.model) - 5) < 0.05


def test_stops_when_a_better_sample_is_unlikely() -> None:
    options = RansacOptions(max_iterations=500, batch=1, min_iterations=1, confidence=0.99)
    found = ransac(problem(inliers=0.1), options, np.random.default_rng(1))
    assert found.iterations == int(np.ceil(np.log(0.01) / np.log(0.9)))


@pytest.mark.parametrize(("share", "size", "expected"), [(0.0, 7, np.inf), (1.0, 7, 0.0), (0.5, 1, 9.9658)])
def test_needed_iterations_follow_the_formula(share: float, size: int, expected: float) -> None:
    assert np.isclose(needed_iterations(share, size, 0.999), expected, rtol=1e-4)


def test_same_seed_same_answer_and_another_seed_another_search() -> None:
    one, two, three = (
        ransac(problem(), RansacOptions(max_iterations=3, batch=1), np.random.default_rng(seed))
        for seed in (4, 4, 5)
    )
    assert one == two
    assert one.model != three.model


def test_preemption_scores_less_and_keeps_the_best() -> None:
    location = problem()
    models, order = np.linspace(-50, 50, 1001), np.random.default_rng(0).permutation(1000)
    kept = preempt(location, models, order)
    assert np.abs(kept - 5).max() < 0.3
    assert sum(location.scored) < 0.3 * 1001 * 1000


def test_an_estimator_without_models_gives_none() -> None:
    class Barren(Location):
        def generate_models(self, samples: int, rng: np.random.Generator) -> Floats:
            """Give something useless."""
            return np.zeros(0)

    found = ransac(
        Barren(np.zeros(5), inliers=1.0), RansacOptions(max_iterations=40), np.random.default_rng(0)
    )
    assert found.model is None
    assert found.iterations == 40


@pytest.mark.parametrize("wrong", [{"max_iterations": 0}, {"confidence": 1.0}, {"batch": 0}])
def test_options_out_of_range_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="must be"):
        RansacOptions(**wrong)
