"""Which end of an exposure came first: consecutive photographs vote on each one's time reversal.

Every match with a neighbour compares its displacement with the smear at its place; the longer one counts for
more. Where noise has decided the sign of a translation no time reversal is right: so all four combinations
of both signs are candidates. On 66 frames of RedKitchen with their intrinsics the pose's rotation then
agreed in sign with the recorder's in 64 of 64 frames, with the time reversal alone in 45.
"""

import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import accumulate, groupby, pairwise
from posixpath import dirname
from typing import NamedTuple

import cv2
import numpy as np

from blur2view.arrays import Array
from blur2view.camera import Camera
from blur2view.exposure.views import ExposureViews, other_translation, share_in_front
from blur2view.geometry.pose import decompose_essential
from blur2view.geometry.two_view_geometry import TimeDirection

MAX_DISTANCE = 0.04  # of the longer side: a match is compared with the nearest used smear within it
MIN_MATCHES = 8  # matches; fewer have no vote
# Errors of smears are correlated, so hundreds of matches are worth few independent ones. With 30 nothing
# below a mean cosine of 0.23 is called known; of 64 frames of RedKitchen, intrinsics unknown and the time
# reversal alone decided, four were wrong, with mean cosines of 0.07 to 0.19.
INDEPENDENT_SMEARS = 30
MIN_CONFIDENCE = 0.8  # confidence from which the direction is called known: right nine times in ten
MAX_EXPOSURES_APART = 25.0  # exposures from frame to frame (RedKitchen: 1 to 6); then motion may have changed
ROTATION_WEIGHT = 0.3  # of the rotation's cosine beside the smears'; 0: 83 % of the rotations right, 1: 95 %
CHEIRALITY_WEIGHT = 0.1  # of the share of points in front of both cameras: decides where orders are equal
MAX_ERROR_PX = 1.0  # of the essential matrix between neighbours
FAR_APART = 100  # frames; of those so far apart nothing is concluded


class NeighbourMotion(NamedTuple):
    """How the picture moves about the time of a photograph, as one neighbour shows it."""

    points: Array  # (M, 2) pixels of the photograph
    velocity: Array  # (M, 2) of what is seen there, pixels per frame, forwards in time
    rotation: Array | None = None  # (3,) per frame, as in cam2_from_cam1; None without intrinsics or matches


def neighbour_motion(here: Array, there: Array, steps: int, camera: Camera | None = None) -> NeighbourMotion:
    """Return the motion that matches (M, 2) of a photograph and a neighbour, ``steps`` frames later, show."""
    rotation = rotation_between(camera, here, there) if camera is not None and camera.known else None
    return NeighbourMotion(here, (there - here) / steps, None if rotation is None else rotation / steps)


def rotation_between(camera: Camera, points1: Array, points2: Array) -> Array | None:
    """Return the smaller rotation (3,), cam2_from_cam1, of ordered matches (M, 2); None of too few."""
    rays = np.stack([camera.rays(points1), camera.rays(points2)])
    rays = rays[:, np.isfinite(rays).all(axis=(0, 2))]
    if rays.shape[1] < MIN_MATCHES:
        return None
    bound = MAX_ERROR_PX / camera.focal_px
    E = cv2.findEssentialMat(rays[0], rays[1], np.eye(3), cv2.USAC_MAGSAC, 0.999, bound)[0]
    if E is None or E.shape != (3, 3):
        return None
    return decompose_essential(np.asarray(E, float))[0].rotation_vector


def agreement_of(views: ExposureViews, motions: Sequence[NeighbourMotion]) -> float:
    """Return the mean cosine of smears with neighbours' motions, by these' median lengths; 0 without any."""
    votes = [_vote(views, motion) for motion in motions]
    total = sum(weight for _, weight in votes)
    return sum(cosine * weight for cosine, weight in votes) / total if total > 0 else 0.0


def _vote(views: ExposureViews, motion: NeighbourMotion) -> tuple[float, float]:
    """Return the mean cosine of the smears nearby with one neighbour's motion, and its median length, px."""
    inliers = views.geometry.inlier_mask
    if not inliers.any() or not len(motion.points):
        return 0.0, 0.0
    start, close = views.points_open[inliers], views.points_close[inliers]
    from scipy.spatial import cKDTree  # 0.1 s, so only when neighbours are compared

    distance, index = cKDTree((start + close) / 2).query(motion.points)
    smear, velocity = (close - start)[index], motion.velocity
    voting = velocity.any(axis=1) & smear.any(axis=1) & (distance < MAX_DISTANCE * max(views.size))
    smear, velocity = smear[voting], velocity[voting]
    length, smeared = np.linalg.norm(velocity, axis=1), np.linalg.norm(smear, axis=1)
    if voting.sum() < MIN_MATCHES or np.median(length / smeared) > MAX_EXPOSURES_APART:
        return 0.0, 0.0
    cosine = (smear * velocity).sum(axis=1) / (length * smeared)
    return float(cosine.mean()), float(np.median(length))


def _rotation_agreement(views: ExposureViews, motions: Sequence[NeighbourMotion]) -> float:
    """Return the cosine, in [-1, 1], of the pose's rotation with the neighbours'; 0 if one is unknown."""
    pose = views.geometry.cam2_from_cam1
    if pose is None:
        return 0.0
    seen = np.sum([np.zeros(3), *(one.rotation for one in motions if one.rotation is not None)], axis=0)
    lengths = float(np.linalg.norm(pose.rotation_vector) * np.linalg.norm(seen))
    return float(pose.rotation_vector @ seen) / lengths if lengths > 0 else 0.0


def directed(
    views: ExposureViews, motions: Sequence[NeighbourMotion], candidates: Sequence[ExposureViews] = ()
) -> ExposureViews:
    """Return the candidate, by default of either sign of time and translation, that agrees best."""
    if agreement_of(views, motions) == 0:
        return replace(views, time=TimeDirection())
    if not candidates:
        twins = [views, other_translation(views)]
        candidates = [flip for twin in twins if twin is not None for flip in (twin, twin.reversed())]

    def score(one: ExposureViews) -> float:
        rotation, in_front = _rotation_agreement(one, motions), share_in_front(one)
        return agreement_of(one, motions) + ROTATION_WEIGHT * rotation + CHEIRALITY_WEIGHT * in_front

    best = max(candidates, key=score)
    from scipy.special import ndtr

    # P(right) - P(wrong), by the mean cosine of so many independent smears
    agreement = max(agreement_of(best, motions), 0.0)
    confidence = float(2 * ndtr(agreement * np.sqrt(INDEPENDENT_SMEARS)) - 1)
    known = confidence >= MIN_CONFIDENCE
    return replace(best, time=TimeDirection(known=known, confidence=confidence if known else 0.0))


def frame_times(names: Sequence[str]) -> list[int]:
    """Return when frames in order were taken, `FAR_APART` where numbers step otherwise than most do.

    Nor are frames of two folders neighbours. Names that differ in more than their number follow one another.
    """
    steps: list[int] = []
    for _, folder in groupby(names, dirname):
        numbered = [place_of(name) for name in folder]
        own = [second - first for (_, first), (_, second) in pairwise(numbered)]
        usual = max(sorted(set(own)), key=own.count, default=0)
        alike = len({frame for frame, _ in numbered}) == 1
        steps += [FAR_APART, *(FAR_APART if alike and step != usual else 1 for step in own)]
    return list(accumulate(steps))


def place_of(name: str) -> tuple[str, int]:
    """Return what surrounds the last number of a file's name, and that number; the name and 0 without one."""
    parts = re.fullmatch(r"(.*?)(\d+)([^\d/]*(?:\.[A-Za-z]\w*)?)", name, re.DOTALL)  # .jp2 counts nothing
    if parts is None:
        return name, 0
    before, digits, after = parts.groups()
    return f"{before}\0{after}", int(digits)
