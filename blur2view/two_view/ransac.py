"""The robust loop: sample, score preemptively, refine the best, stop. It knows no geometry."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

Models = NDArray[Any]  # (M, ...): one model per entry of the first axis
BATCH, MAX_ITERATIONS = 64, 1000  # samples drawn at once, and at most (the paper: 1000)
CONFIDENCE = 0.99  # probability of having drawn a sample of inliers only, at which the loop ends
# Data scored first; each later block is GROWTH times as large, and scores 1 / GROWTH of the models.
FIRST_BLOCK, GROWTH = 32, 8
SURVIVORS = 4  # models of a batch that are scored on all data


class Estimator(Protocol):
    """A problem that the loop solves: how its models are made, scored and refined."""

    sample_size: ClassVar[int]  # of a minimal sample

    @property
    def count(self) -> int:
        """Number of data."""

    def generate_models(self, samples: int, rng: np.random.Generator) -> Models:
        """Return all models of newly drawn minimal samples, possibly none."""

    def score(self, models: Models, block: NDArray[np.int_]) -> NDArray[Any]:
        """Return the cost (M,) of every model summed over the data of a block; less is better."""

    def refine(self, model: Models) -> Models:
        """Return a model of lower cost near the given one, or the given one."""

    def inlier_share(self, model: Models) -> float:
        """Return the share of data that follow a model."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Report:
    """What the loop found, and how."""

    model: Models | None  # of least cost; None if no sample gave a model
    iterations: int  # samples that were drawn
    inlier_ratio: float  # share of the data that follow the model, by `Estimator.inlier_share`


def ransac(estimator: Estimator, rng: np.random.Generator) -> Report:
    """Return the model of least cost, deterministic given the state of rng.

    A model is refined if its cost on all data is below that of every sampled model before it. The cheaper of
    it and the refined one becomes the best if it costs less than the best so far.

    References
    ----------
    Chum, Matas and Kittler, Locally optimized RANSAC, DAGM 2003.
    """
    order = rng.permutation(estimator.count)
    best: Models | None = None
    cost, sampled_cost, ratio = np.inf, np.inf, 0.0
    for iterations in range(BATCH, MAX_ITERATIONS + BATCH, BATCH):
        models = preempt(estimator, estimator.generate_models(BATCH, rng), order)
        costs = estimator.score(models, order)
        if len(models) and costs.min() < sampled_cost:
            sampled_cost = float(costs.min())
            best_sample = models[int(np.argmin(costs))]
            candidates = np.stack([best_sample, estimator.refine(best_sample)])
            candidate_costs = estimator.score(candidates, order)
            if candidate_costs.min() < cost:
                cost, best = float(candidate_costs.min()), candidates[int(np.argmin(candidate_costs))]
        if best is not None:
            ratio = estimator.inlier_share(best)
            if iterations >= needed_iterations(ratio, estimator.sample_size):
                break
    return Report(model=best, iterations=iterations, inlier_ratio=ratio)


def preempt(estimator: Estimator, models: Models, order: NDArray[np.int_]) -> Models:
    """Return the SURVIVORS best models, scored on growing blocks of the data in an order (N,).

    References
    ----------
    Nister, Preemptive RANSAC for live structure and motion estimation, ICCV 2003.
    """
    start, size = 0, FIRST_BLOCK
    total = np.zeros(len(models))
    while len(models) > SURVIVORS and start < len(order):
        total = total + estimator.score(models, order[start : start + size])
        survivors = np.argsort(total, kind="stable")[: max(SURVIVORS, len(models) // GROWTH)]
        models, total = models[survivors], total[survivors]
        start, size = start + size, size * GROWTH
    return models[:SURVIVORS]


def needed_iterations(inlier_share: float, sample_size: int) -> float:
    """Return log(1 - CONFIDENCE) / log(1 - w^m), w the share of inliers, m the sample size.

    With probability CONFIDENCE one of so many samples holds inliers only.
    """
    good = min(max(inlier_share, 0.0), 1.0) ** sample_size
    if good <= 0:
        return float("inf")
    return 0.0 if good >= 1 else float(np.log1p(-CONFIDENCE) / np.log1p(-good))
