"""Which end of an exposure came first: consecutive photographs vote on each one's flip of time.

One photograph does not tell. Its neighbours in a video do: what moves right from the last frame to this one,
and on to the next, moved right during this exposure too. Every match with a neighbour compares its
displacement with the smear at its place; the displacements to both sides together are the velocity at mid
exposure, so that the longer one counts for more.

The neighbours decide a second sign with it. With E the order of a smear is told by what turns, and by points
lying before the camera, which needs the sign of the translation; where the noise has decided that sign, the
rotation is reversed against the translation, and no flip of time is right. So all four combinations of both
signs are candidates. On 66 frames of RedKitchen with their intrinsics the pose's rotation then agreed in sign
with the recorder's in 64 of 64 frames, with the flip of time alone in 45.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.special import ndtr

from blur2view.arrays import Array
from blur2view.camera.camera import Camera
from blur2view.exposure.translation_sign import other_translation, share_before
from blur2view.exposure.views import ExposureViews, TimeDirection
from blur2view.geometry.pose import decompose_essential

Matched = Callable[[int, int], tuple[Array, Array]]  # indices of two photographs -> points (M, 2) in both
NEAR = 0.04  # of the longer side: a match is compared with the nearest used smear within it
ENOUGH = 8  # matches; fewer have no vote
# Smears err together, so a vote of hundreds of matches is worth few independent ones. With 30 nothing below a
# mean cosine of 0.23 is called known; of 64 frames of RedKitchen, intrinsics unknown and the flip of time
# alone decided, four were wrong, with mean cosines of 0.07 to 0.19.
INDEPENDENT = 30
KNOWN = 0.8  # confidence from which the direction is called known: right nine times in ten
FARTHEST = 25.0  # exposures from frame to frame (RedKitchen: 1 to 6); after more, motion may have changed
TURN_WEIGHT = 0.3  # of the rotation's cosine beside the smears'; 0: 83 % of the rotations right, 1: 95 %
DEPTH_WEIGHT = 0.1  # of the share of points before the camera, which decides where orders are the same
MAX_ERROR_PX = 1.0  # of the essential matrix between neighbours


@dataclass(frozen=True, kw_only=True, eq=False)
class NeighbourMotion:
    """How the picture moves about the time of a photograph, as one neighbour shows it.

    Parameters
    ----------
    points : ndarray of shape (M, 2)
        Pixels of the photograph.
    velocity : ndarray of shape (M, 2)
        Of what is seen there, pixels per frame, forwards in time.
    turn : ndarray of shape (3,) or None
        Rotation vector of the camera per frame, as in ``cam2_from_cam1``; None if its intrinsics or enough
        matches are not known.
    """

    points: Array
    velocity: Array
    turn: Array | None = None


def neighbour_motion(here: Array, there: Array, steps: int, camera: Camera | None = None) -> NeighbourMotion:
    """Turn matches with a neighbour into motion.

    Parameters
    ----------
    here, there : ndarray of shape (M, 2)
        Matched pixels in the photograph and in the neighbour.
    steps : int
        Frames from the photograph to the neighbour; negative if the neighbour is earlier.
    camera : Camera, optional
        Of both; used if it is known.

    Raises
    ------
    ValueError
        If the shapes differ or the neighbour is the photograph itself.
    """
    here, there = np.asarray(here, float).reshape(-1, 2), np.asarray(there, float).reshape(-1, 2)
    if here.shape != there.shape or steps == 0:
        raise ValueError(f"expected points (M, 2) twice and steps, got {here.shape}, {there.shape}, {steps}")
    turn = rotation_between(camera, here, there) if camera is not None and camera.known else None
    velocity = (there - here) / steps
    return NeighbourMotion(points=here, velocity=velocity, turn=None if turn is None else turn / steps)


def rotation_between(camera: Camera, points1: Array, points2: Array) -> Array | None:
    """Rotation vector (3,) of ``cam2_from_cam1`` from ordered matches (M, 2); None from too few.

    Of both rotations of E the smaller. The other is about half a turn away, which no two frames are; where
    there is little parallax, points before both cameras do not tell them apart.
    """
    rays1, rays2 = camera.rays(points1), camera.rays(points2)
    seen = np.isfinite(rays1).all(axis=1) & np.isfinite(rays2).all(axis=1)
    if seen.sum() < ENOUGH:
        return None
    rays1, rays2 = rays1[seen], rays2[seen]
    bound = MAX_ERROR_PX / camera.focal_px
    E = cv2.findEssentialMat(rays1, rays2, np.eye(3), cv2.USAC_MAGSAC, 0.999, bound)[0]
    if E is None or E.shape != (3, 3):
        return None
    return decompose_essential(np.asarray(E, float))[0].rotation_vector


def agreement_of(views: ExposureViews, motions: Sequence[NeighbourMotion]) -> float:
    """Mean cosine, in [-1, 1], between smears, open to close, and what neighbours show; 0 without any.

    Each neighbour counts by the median length of the motion that it shows.
    """
    votes = [_vote(views, motion) for motion in motions]
    total = sum(weight for _, weight in votes)
    return sum(cosine * weight for cosine, weight in votes) / total if total > 0 else 0.0


def _vote(views: ExposureViews, motion: NeighbourMotion) -> tuple[float, float]:
    """Mean cosine with one neighbour's motion, and that motion's median length in pixels."""
    smear, near = smears_at(views, motion.points)
    velocity = motion.velocity[near]
    length = np.linalg.norm(velocity, axis=1)
    moved = (length > 0) & (np.linalg.norm(smear, axis=1) > 0)
    if moved.sum() < ENOUGH:
        return 0.0, 0.0
    smear, velocity, length = smear[moved], velocity[moved], length[moved]
    smeared = np.linalg.norm(smear, axis=1)
    if np.median(length / smeared) > FARTHEST:
        return 0.0, 0.0
    cosine = (smear * velocity).sum(axis=1) / (length * smeared)
    return float(cosine.mean()), float(np.median(length))


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


def turn_agreement(views: ExposureViews, motions: Sequence[NeighbourMotion]) -> float:
    """Cosine, in [-1, 1], between the pose's rotation and that about its time; 0 where one is not known."""
    pose, turns = views.geometry.cam2_from_cam1, [m.turn for m in motions if m.turn is not None]
    if pose is None or not turns:
        return 0.0
    own, seen = pose.rotation_vector, np.sum(turns, axis=0)
    lengths = float(np.linalg.norm(own) * np.linalg.norm(seen))
    return float(own @ seen) / lengths if lengths > 0 else 0.0


def confidence_of(agreement: float) -> float:
    """Probability that the direction is right less that it is wrong, of `INDEPENDENT` smears' mean cosine."""
    return float(2 * ndtr(abs(agreement) * np.sqrt(INDEPENDENT)) - 1)


def directed(views: ExposureViews, motions: Sequence[NeighbourMotion]) -> ExposureViews:
    """Choose the candidate that neighbours agree with most, and say how surely.

    Below a confidence of `KNOWN` it is still the likelier direction, but is not called known. Without
    neighbours the views are returned as they are.
    """
    if agreement_of(views, motions) == 0:
        return replace(views, time=TimeDirection())
    twins = [views, other_translation(views)]
    candidates = [flip for twin in twins if twin is not None for flip in (twin, twin.reversed())]
    best = max(candidates, key=lambda candidate: _score(candidate, motions))
    confidence = confidence_of(max(agreement_of(best, motions), 0.0))
    known = confidence >= KNOWN
    return replace(best, time=TimeDirection(known=known, confidence=confidence if known else 0.0))


def _score(views: ExposureViews, motions: Sequence[NeighbourMotion]) -> float:
    """How well a candidate agrees with what neighbours show, and with itself."""
    turn, depth = turn_agreement(views, motions), share_before(views)
    return agreement_of(views, motions) + TURN_WEIGHT * turn + DEPTH_WEIGHT * depth


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
        Indices of consecutive photographs, in order of time; see `consecutive_runs`. A photograph in no run
        keeps its arbitrary direction. Indices beyond the sequence are photographs without views, sharp ones
        perhaps, that have a vote and no question.
    matched : callable
        Gives matched pixels (M, 2) of two photographs by their indices; see `neighbours`.
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
        motions: dict[int, list[NeighbourMotion]] = {index: [] for index in run if index < len(sequence)}
        for first, second in pairs_within(len(run), reach):
            pair = run[first], run[second]
            if not motions.keys() & set(pair):
                continue
            points = matched(*pair)
            for index, steps, (here, there) in (
                (pair[0], second - first, points),
                (pair[1], first - second, points[::-1]),
            ):
                if index in motions:
                    motions[index].append(neighbour_motion(here, there, steps, sequence[index].camera))
        for index, seen in motions.items():
            found[index] = directed(sequence[index], seen)
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
