"""The robust loop: sample, score preemptively, refine the best, stop. It knows no geometry."""

from __future__ import annotations

from dataclasses import dataclass
from operator import itemgetter
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, Array

Models = NDArray[Any]  # (M, ...): one model per entry of the first axis
FIRST_BLOCK = 32  # data scored first
GROWTH = 8  # of the blocks scored later, each with 1 / GROWTH of the models left
SURVIVORS = 4  # models of a batch that are scored on all data
CONTENDERS = 8  # sampled models that are returned


class Estimator(Protocol):
    """What the loop asks of a problem."""

    sample_size: ClassVar[int]  # of a minimal sample

    @property
    def count(self) -> int:
        """Number of data."""

    def generate_models(self, samples: int, rng: np.random.Generator) -> Models:
        """Return all models of newly drawn minimal samples, possibly none."""

    def score(self, models: Models, block: NDArray[np.int_]) -> NDArray[Any]:
        """Return the cost (M,) of every model summed over the data of a block; less is better."""

    def refine(self, model: Models) -> Models:
        """Return a locally better model, or the same one."""

    def inlier_share(self, model: Models) -> float:
        """Return the share of data that follow a model, beyond chance."""


@dataclass(frozen=True, kw_only=True)
class RansacOptions:
    """When the loop stops.

    ``max_iterations`` samples at most (the paper: 1000) and ``min_iterations`` before any other stop;
    ``confidence`` the probability of having drawn one all-inlier sample that ends it; ``batch`` samples drawn
    at once.
    """

    max_iterations: int = 1000
    min_iterations: int = 16
    confidence: float = 0.999
    batch: int = 16

    def __post_init__(self) -> None:
        if min(self.max_iterations, self.batch) < 1 or not 0 < self.confidence < 1:
            raise ValueError(f"counts must be positive, confidence must be in (0, 1), got {self}")


@dataclass(frozen=True, kw_only=True)
class RansacResult:
    """The best model (None if no sample gave any), and the samples drawn.

    ``contenders`` are the best models as sampled, best first: starts for an optimisation that knows more.
    """

    model: Models | None
    iterations: int
    contenders: list[Models]


def ransac(estimator: Estimator, options: RansacOptions, rng: np.random.Generator) -> RansacResult:
    """Return the model of least cost found; deterministic given the state of rng.

    A model is refined when, as sampled, it beats every sampled model before it on all data; refined models
    compete by their cost on all data.

    References
    ----------
    Chum, Matas and Kittler, Locally optimized RANSAC, DAGM 2003.
    """
    order = rng.permutation(estimator.count)
    best: Models | None = None
    sampled: list[tuple[float, Models]] = []
    cost, raw_cost, iterations = np.inf, np.inf, 0
    while iterations < options.max_iterations:
        draw = min(options.batch, options.max_iterations - iterations)
        models = preempt(estimator, estimator.generate_models(draw, rng), order)
        iterations += draw
        sampled = sorted(
            [*sampled, *zip(estimator.score(models, order).tolist(), models, strict=True)], key=itemgetter(0)
        )[:CONTENDERS]
        if sampled and sampled[0][0] < raw_cost:
            raw_cost, candidate = sampled[0]
            refined = estimator.refine(candidate)
            refined_cost = float(estimator.score(refined[None], order)[0])
            if min(refined_cost, raw_cost) < cost:
                best, cost = min((raw_cost, candidate), (refined_cost, refined), key=itemgetter(0))[::-1]
        if best is not None and iterations >= options.min_iterations:
            share = estimator.inlier_share(best)
            if iterations >= needed_iterations(share, estimator.sample_size, options.confidence):
                break
    contenders = [model for _, model in sampled]
    return RansacResult(model=best, iterations=iterations, contenders=contenders)


def preempt(estimator: Estimator, models: Models, order: NDArray[np.int_]) -> Models:
    """Return the SURVIVORS best models after scoring on growing blocks of the data.

    References
    ----------
    Nister, Preemptive RANSAC for live structure and motion estimation, ICCV 2003.
    """
    start, size = 0, FIRST_BLOCK
    total = np.zeros(len(models))
    while len(models) > SURVIVORS and start < len(order):
        total = total + estimator.score(models, order[start : start + size])
        kept = np.argsort(total, kind="stable")[: max(SURVIVORS, len(models) // GROWTH)]
        models, total = models[kept], total[kept]
        start, size = start + size, size * GROWTH
    return models[:SURVIVORS]


def needed_iterations(inlier_share: float, sample_size: int, confidence: float) -> float:
    """Return log(1 - confidence) / log(1 - w^m): samples needed so that one is surely all inliers."""
    good = min(max(inlier_share, 0.0), 1.0) ** sample_size
    if good <= 0:
        return float("inf")
    return 0.0 if good >= 1 else float(np.log1p(-confidence) / np.log1p(-good))


def weighted_samples(weights: Array, size: int, samples: int, rng: np.random.Generator) -> NDArray[np.int_]:
    """Return index sets (samples, size) drawn by weight, without repetition inside a set.

    Sets are drawn with repetition; the few that have one are drawn anew without (Gumbel top-k).

    Raises
    ------
    ValueError
        If there are fewer data than ``size``.
    """
    if len(weights) < size:
        raise ValueError(f"need at least {size} data to sample from, got {len(weights)}")
    cumulative = np.cumsum(np.maximum(weights, TINY))
    drawn: NDArray[np.int_] = np.searchsorted(
        cumulative[:-1], rng.random((samples, size)) * cumulative[-1], side="right"
    )
    repeated = (np.diff(np.sort(drawn, axis=1), axis=1) == 0).any(axis=1)
    keys = np.log(np.maximum(weights, TINY)) + rng.gumbel(size=(int(repeated.sum()), len(weights)))
    drawn[repeated] = np.argpartition(-keys, size - 1, axis=1)[:, :size]
    return drawn
