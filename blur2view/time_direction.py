"""Which end of an exposure came first: consecutive photographs vote on each one's flip of time.

One photograph does not tell. Its neighbours in a video do: what moves right from the last frame to this one,
and on to the next, moved right during this exposure too. Every match with a neighbour compares its
displacement with the smear at its place; the displacements to both sides together are the velocity at mid
exposure, so that the longer one counts for more.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.special import ndtr

from blur2view.exposure_views import ExposureViews, TimeDirection

Array = NDArray[np.float64]
Matched = Callable[[int, int], tuple[Array, Array]]  # indices of two photographs -> points (M, 2) in both

NEAR = 0.04  # of the longer side: a match takes the order of the nearest used smear within it
ENOUGH = 8  # matches; fewer have no vote
# Smears err together: a vote of hundreds of matches has the noise of about so many independent ones
# (66 frames of RedKitchen: the signs of neighbours are alike over some 80 px).
INDEPENDENT = 30
KNOWN = 0.6  # confidence from which the direction is called known: right in four cases of five


@dataclass(frozen=True, kw_only=True)
class Vote:
    """What a neighbour says of the flip of time.

    Parameters
    ----------
    agreement : float
        Mean cosine, in [-1, 1], between smears, open to close, and the motion of the picture over time.
    motion_px : float
        Median length of that motion per frame.
    count : int
        Matches.
    """

    agreement: float
    motion_px: float
    count: int


NO_VOTE = Vote(agreement=0.0, motion_px=0.0, count=0)


def vote(views: ExposureViews, here: Array, there: Array, steps: int) -> Vote:
    """Compare the smears of a photograph with the motion from or to a neighbour.

    Parameters
    ----------
    views : ExposureViews
        Of the photograph, in either flip of time.
    here, there : ndarray of shape (M, 2)
        Matched pixels in the photograph and in the neighbour.
    steps : int
        Frames from the photograph to the neighbour; negative if the neighbour is earlier.

    Raises
    ------
    ValueError
        If the shapes differ or the neighbour is the photograph itself.
    """
    here, there = np.asarray(here, float).reshape(-1, 2), np.asarray(there, float).reshape(-1, 2)
    if here.shape != there.shape or steps == 0:
        raise ValueError(f"expected points (M, 2) twice and steps, got {here.shape}, {there.shape}, {steps}")
    smear, near = smears_at(views, here)
    motion = (there - here)[near] / steps
    lengths = np.linalg.norm(smear, axis=1) * np.linalg.norm(motion, axis=1)
    moved = lengths > 0
    if moved.sum() < ENOUGH:
        return NO_VOTE
    cosine = (smear * motion).sum(axis=1)[moved] / lengths[moved]
    return Vote(
        agreement=float(cosine.mean()),
        motion_px=float(np.median(np.linalg.norm(motion[moved], axis=1))),
        count=int(moved.sum()),
    )


def smears_at(views: ExposureViews, points: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Give the nearest inlier smears, open to close, (K, 2), and where (M,) of the points one is near."""
    inliers = views.geometry.inlier_mask
    if not inliers.any() or not len(points):
        return np.zeros((0, 2)), np.zeros(len(points), bool)
    start, close = views.points_open[inliers], views.points_close[inliers]
    distance, index = cKDTree((start + close) / 2).query(points)
    near = distance < NEAR * max(views.size)
    displacement: Array = (close - start)[index[near]]
    return displacement, near


def agreement_of(votes: Sequence[Vote]) -> float:
    """Mean agreement in [-1, 1], each neighbour weighted by the motion it shows; 0 without votes."""
    weights = np.array([vote.motion_px for vote in votes])
    if not weights.sum() > 0:
        return 0.0
    return float(weights @ [vote.agreement for vote in votes] / weights.sum())


def confidence_of(agreement: float) -> float:
    """Probability that the direction is right less that it is wrong, of `INDEPENDENT` smears' mean cosine."""
    return float(2 * ndtr(abs(agreement) * np.sqrt(INDEPENDENT)) - 1)


def directed(views: ExposureViews, votes: Sequence[Vote]) -> ExposureViews:
    """Turn a photograph's views into the flip of time that its neighbours vote for, and say how surely.

    Below a confidence of `KNOWN` the flip is still the likelier one, but is not called known.
    """
    agreement = agreement_of(votes)
    turned = views.reversed() if agreement < 0 else views
    confidence = confidence_of(agreement)
    known = confidence >= KNOWN
    return replace(turned, time=TimeDirection(known=known, confidence=confidence if known else 0.0))


def with_time_direction(
    sequence: Sequence[ExposureViews],
    runs: Sequence[Sequence[int]],
    matched: Matched,
    reach: int = 1,
) -> list[ExposureViews]:
    """Decide the flip of time of every photograph that has neighbours in time.

    Parameters
    ----------
    sequence : sequence of ExposureViews
        In any order.
    runs : sequence of sequences of int
        Indices of consecutive photographs, in order of time; see `consecutive_runs`. A photograph in no run,
        or alone in one, keeps its arbitrary direction.
    matched : callable
        Gives matched pixels (M, 2) of two photographs by their indices; see :mod:`blur2view.neighbours`.
    reach : int
        How many frames before and after vote.

    Returns
    -------
    list of ExposureViews
        In the order given.

    Raises
    ------
    ValueError
        If the reach is not positive.
    """
    if reach < 1:
        raise ValueError(f"reach must be positive, got {reach}")
    found = list(sequence)
    for run in runs:
        votes: list[list[Vote]] = [[] for _ in run]
        for first, second in pairs_within(len(run), reach):
            here, there = matched(run[first], run[second])
            steps = second - first
            votes[first].append(vote(sequence[run[first]], here, there, steps))
            votes[second].append(vote(sequence[run[second]], there, here, -steps))
        for index, given in zip(run, votes, strict=True):
            found[index] = directed(sequence[index], given)
    return found


def pairs_within(count: int, reach: int) -> Iterator[tuple[int, int]]:
    """Yield the pairs of positions that are at most `reach` apart, the earlier first."""
    for first in range(count):
        yield from ((first, second) for second in range(first + 1, min(first + reach, count - 1) + 1))


def consecutive_runs(names: Sequence[str], in_order: bool = False) -> list[list[int]]:
    """Group photographs that follow one another in time.

    Parameters
    ----------
    names : sequence of str
        Of the photographs.
    in_order : bool
        They are the frames of one video as they stand. Otherwise those are taken for consecutive whose names
        differ by one in the last number they hold and in nothing else ("frame_0041.jpg", "frame_0042.jpg").

    Returns
    -------
    list of list of int
        Indices in order of time; photographs without a neighbour are in none.
    """
    if in_order:
        return [list(range(len(names)))] if len(names) > 1 else []
    numbered = sorted((*_number(name), index) for index, name in enumerate(names))
    runs: list[list[int]] = [[]]
    last: tuple[str, int] | None = None
    for frame, number, index in numbered:
        if (frame, number - 1) != last:
            runs.append([])
        runs[-1].append(index)
        last = (frame, number)
    return [run for run in runs if len(run) > 1]


def _number(name: str) -> tuple[str, int]:
    """Split a name into what surrounds its last number, and that number; without one it is its own kind."""
    found = re.fullmatch(r"(.*?)(\d+)(\D*)", name, re.DOTALL)
    if found is None:
        return name, 0
    before, digits, after = found.groups()
    return f"{before}\0{after}", int(digits)
