"""The pose of one blurred photograph, from registered neighbours and the points of the model that they see.

A neighbour is warped to the expected pose by the inverse depth of the model's points, and each of the two
pictures gets the blur of the other one (`blur_matching`): a rigid motion during the exposure, which is fitted
to the smears, with a change of its rotation rate. The differences that remain correct this motion, so that
the pose is that of mid exposure. The centroid of the blur lies 0.15 degrees from it in frames of RedKitchen
with smears of 52 px.

A *motion* (9,) is a rotation vector (3,) and a translation (3,) of points times t, and a rotation vector
(3,), the bend, times t^2, with t from -1/2 at shutter-open to 1/2.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, Array, Mask
from blur2view.camera import normalised_points
from blur2view.colmap.blur_matching import (
    blur_equations,
    blurred_along,
    equalised,
    match_patches,
    resampled,
    shortened,
)
from blur2view.colmap.warped_view import (
    FLOOR_SIGMA_PX,
    View,
    Warp,
    everywhere,
    image_flow,
    in_picture,
    projected,
    same_sense,
    surface_points,
    warp_to,
)
from blur2view.exposure.trajectory import changed

MAX_WARP_PX = 6.0  # between the projection of a point into a neighbour and the warp by the smooth depth
KERNEL_SIGMA = 0.3  # of a correction of the motion, relative to its rotation
MIN_POSE_POINTS = 6  # of a pose
SEARCH_SCALE = 0.25  # of the working size, where a pose is searched
FIT_STEPS, POSE_STEPS = 12, 20  # of reweighting
CONVERGED_RAD = 1e-6  # of a step's rotation, after which a pose is not fitted further


class Round(NamedTuple):
    """How a pose is made better once."""

    scale: float  # of the working size, unless `LEAST_SIDE` is more
    levels: int  # of the tracker's pyramid; with 0 the motion is not corrected any more
    patches: int  # that are searched, about, of all neighbours


# Of RedKitchen's runs of 6 at 52 px the median errors are 0.131 degrees and 0.60 steps. With all points from
# all four neighbours and the second round at full size, which takes three times as long, they are 0.127 and
# 0.56, without the second round 0.136 and 0.60, and with 400 patches in the last one 0.158 and 0.73.
ROUNDS = Round(0.5, 2, 300), Round(0.5, 1, 600), Round(1.0, 0, 3000)
# Of a smear, median: up to it the second round is left out, which takes a quarter of the time. Scenes of
# RedKitchen with runs of 22, 38 and 52 px are off by 0.068, 0.068 and 0.060 degrees, and 0.21, 0.24 and 0.26
# steps; with that round by 0.070, 0.068 and 0.060 degrees, and 0.21, 0.26 and 0.25 steps.
SHORT_PX = 8.0
LEAST_SIDE = 320  # pixels, of the longer side of a reduced picture


class BlurredPose(NamedTuple):
    """The pose of a photograph by its neighbours, with pixels of the working size."""

    pose: Array  # (3, 4) cam_from_world at mid exposure
    information: Array  # (6, 6) of a rotation and translation of points, if all matches were independent
    motion: Array  # (9,)
    motion_covariance: Array  # (9, 9)
    smear_motion: Array  # (6,) the rigid motion by the smears alone
    numbers: NDArray[np.int_]  # (M,) indices of the points that were found, each once
    pixels: Array  # (M, 2) where they were found
    residual_px: float  # median distance of the pixels from the projections
    tried: int  # how many points lie in the picture


def find_pose(
    view: View, neighbours: Sequence[View], world: Array, seen: Sequence[Mask], expected: Array
) -> BlurredPose | None:
    """Return the pose of a photograph that is about where its view is; None if too few points are found.

    Neighbours see some (N,) of the points (N, 3) of the world. ``expected`` (6,) is the change of pose per
    frame interval.
    """
    pixels = view.project(world)
    inside = in_picture(view.camera, pixels)
    if inside.sum() < MIN_POSE_POINTS:
        return None
    flow, pose = image_flow(view.camera, view.points(world)[inside]), view.pose
    smears, sigma = view.smears(pixels[inside])
    smear_motion = fit_smears(flow, smears, sigma, expected)
    motion, motion_covariance = np.append(smear_motion, np.zeros(3)), np.full((9, 9), np.inf)
    least = min(1.0, LEAST_SIDE / max(view.camera.width, view.camera.height))
    short = np.median(np.linalg.norm(smears, axis=1)) <= SHORT_PX
    for step in ROUNDS[::2] if short else ROUNDS:
        here, *there = (one.scaled(max(step.scale, least)) for one in (replace(view, pose=pose), *neighbours))
        matches = _find_matches(here, there, world, seen, motion, step)
        if matches is None:
            return None
        numbers, pixels, covariance, equations = matches
        pose, information = fit_pose(here.camera, pose, world[numbers], pixels, covariance)
        if step.levels:
            motion, motion_covariance = _corrected(motion, equations, expected)
    numbers, pixels = _means(numbers, pixels, covariance)
    residual = np.linalg.norm(pixels - replace(view, pose=pose).project(world[numbers]), axis=1)
    return BlurredPose(
        pose=pose,
        information=information,
        motion=motion,
        motion_covariance=motion_covariance,
        smear_motion=smear_motion,
        numbers=numbers,
        pixels=pixels,
        residual_px=float(np.median(residual)),
        tried=int(inside.sum()),
    )


def pose_at(t: float, pose: Array, motion: Array) -> Array:
    """Return cam_from_world (3, 4) at a time t of an exposure, by its motion (9,) from mid exposure."""
    return changed(pose, np.append(motion[:3] * t + motion[6:] * t * t, motion[3:6] * t))


def fit_smears(flow: Array, smears: Array, sigma: Array, expected: Array) -> Array:
    """Return the rigid motion (6,) of smears (N, 2) of either sign, in the sense of an expected one (6,).

    Least squares by Cauchy's weights, from the signs of the expected motion; the translation is about as long
    as that one's. Five more starts, rotations about other axes, gained nothing in 21 RedKitchen frames with
    smears of 53 px and in 17 rendered ones with shakes of 30 and 60 px.
    """
    precision = np.diag(np.repeat([0.0, 1 / (expected[3:] @ expected[3:] + TINY)], 3))
    motion, missed = expected, np.zeros_like(smears)
    for _ in range(FIT_STEPS):
        target = same_sense(smears, flow @ motion)
        weighted = flow / (sigma**2 + (missed**2).sum(axis=1))[:, None, None]
        normal = np.tensordot(weighted, flow, ((0, 1), (0, 1))) + precision
        right = np.tensordot(weighted, target, ((0, 1), (0, 1)))
        motion = np.linalg.lstsq(normal, right, rcond=None)[0]
        missed = target - flow @ motion
    return -motion if motion[:3] @ expected[:3] < 0 else motion


def fit_pose(camera: Any, pose: Array, world: Array, pixels: Array, covariance: Array) -> tuple[Array, Array]:
    """Return the pose (3, 4) of points (N, 3) at pixels (N, 2), by Cauchy's weights, and its information.

    The pixels err by covariances (N, 2, 2), long along smears, which pycolmap's and OpenCV's refinements do
    not take.
    """
    whiten = np.linalg.inv(np.linalg.cholesky(covariance))
    for _ in range(POSE_STEPS):
        points = world @ pose[:, :3].T + pose[:, 3]
        points[:, 2] = np.maximum(points[:, 2], TINY)
        missed = (whiten @ (pixels - projected(camera, points))[..., None])[..., 0]
        rows = whiten @ image_flow(camera, points)
        weighted = rows / (1 + (missed**2).sum(axis=1))[:, None, None]
        normal = np.tensordot(weighted, rows, ((0, 1), (0, 1)))
        if not np.isfinite(normal).all():  # LAPACK would print of it
            raise np.linalg.LinAlgError("no point projects into the picture")
        step = np.linalg.lstsq(normal, np.tensordot(weighted, missed, ((0, 1), (0, 1))), rcond=None)[0]
        pose = changed(pose, step)
        if np.abs(step[:3]).max() < CONVERGED_RAD:
            break
    return pose, normal


class _Matches(NamedTuple):
    """Points that were found in a photograph, some of them in several neighbours."""

    numbers: NDArray[np.int_]  # (M,) indices of the points
    pixels: Array  # (M, 2) where they were found
    covariance: Array  # (M, 2, 2)
    equations: Array  # (9, 10) for the motion's correction, `blur_equations`


def _shared_out(seen: Mask, patches: int) -> Mask:
    """Return which points (N,) are searched from which neighbours (K, N), of those that these have ``seen``.

    Points are left out in turns, and of each that remains neighbours are, so that there are about so many.
    """
    points = np.flatnonzero(seen.any(axis=0))
    points = points[:: max(1, round(len(points) / patches))]
    choice = seen[:, points]
    rank = (choice.cumsum(axis=0) - 1 - np.arange(len(points))) % choice.sum(axis=0)
    searched = np.zeros_like(seen)
    searched[:, points] = choice & (rank < max(1, patches // max(1, len(points))))
    return searched


def _find_matches(
    view: View, neighbours: Sequence[View], world: Array, seen: Sequence[Mask], motion: Array, step: Round
) -> _Matches | None:
    """Return the points (N, 3) of the world that are found in a view; None of fewer than a pose needs."""
    pixels = view.project(world)
    inside = in_picture(view.camera, pixels)
    if not inside.any():
        return None
    warps, pictures = _blurred_alike(view, neighbours, world[inside], motion, moments=step.levels > 0)
    matches, searched = [], _shared_out(np.stack(seen) & inside, step.patches)
    for neighbour, warp, blurred, own in zip(neighbours, warps, pictures, searched, strict=True):
        numbers = np.flatnonzero(own)
        if len(numbers):
            matches.append(
                _match(view, neighbour, warp, blurred, numbers, pixels[numbers], world, step.levels)
            )
    if not matches or len(np.unique(np.concatenate([one.numbers for one in matches]))) < MIN_POSE_POINTS:
        return None
    numbers, pixels, covariance = (np.concatenate(parts) for parts in list(zip(*matches, strict=True))[:3])
    return _Matches(numbers, pixels, covariance, np.sum([one.equations for one in matches], axis=0))


def _blurred_alike(
    view: View, neighbours: Sequence[View], world: Array, motion: Array, *, moments: bool
) -> tuple[list[Warp], list[list[Any]]]:
    """Return neighbours at the pixels of a view, and their pictures blurred as the view is.

    A motion (w, v, b) smears a pixel along path t + bend t^2, where path = J (w, v), bend = J_w b, and J =
    (J_w, J_v) is the `image_flow` (2, 6) of the surface through the points (N, 3) of the world. Each
    neighbour has a picture, and with ``moments`` also those weighted by t and t^2 (`blurred_along`).
    """
    surface = surface_points(view, world)
    J = image_flow(view.camera, surface)
    path, bend = J @ motion[:6], J[:, :, :3] @ motion[6:]
    warps = [warp_to(neighbour, view, surface, path) for neighbour in neighbours]
    fields = everywhere(view.camera, shortened(path)), everywhere(view.camera, bend) if bend.any() else None
    every = cv2.merge([warp.picture for warp in warps]).reshape(*warps[0].picture.shape, len(warps))
    blurred = blurred_along(every, *fields, moments=moments)
    of_each = [[np.ascontiguousarray(one[..., k]) for one in blurred] for k in range(len(warps))]
    return warps, of_each


def _match(
    view: View,
    neighbour: View,
    warp: Warp,
    pictures: Sequence[Any],
    numbers: NDArray[np.int_],
    at: Array,
    world: Array,
    levels: int,
) -> _Matches:
    """Find the points of a neighbour, those numbered (N,), that a view should have at pixels (N, 2).

    ``pictures`` are the neighbour's, warped and blurred as the view is, by 1, t and t^2.
    """
    other = blurred_along(view.image, warp.smears)[0]
    moved, covariance, matched = match_patches(pictures[0], other, at, levels)
    warped = resampled(warp.pixels, np.asarray(at, np.float32)[:, None])[:, 0]
    off = neighbour.project(world[numbers]) - warped  # where the smooth depth is not the point's
    good = np.flatnonzero(matched & (np.linalg.norm(off, axis=1) < MAX_WARP_PX))  # False of NaN
    equations = np.zeros((9, 10))
    if levels and len(good):
        flow = image_flow(view.camera, view.points(world[numbers[good]]))
        equations = blur_equations(pictures, other, at[good], moved[good], flow)
    covariance = covariance[good] + FLOOR_SIGMA_PX**2 * np.eye(2)
    return _Matches(numbers[good], (at + moved + off)[good], covariance, equations)


def searched_pose(view: View, neighbour: View, world: Array) -> Array | None:
    """Return a view's pose, turned until its picture is about a neighbour's; None if no point is in it.

    Phase correlation of both pictures finds steps of a third of the picture.
    """
    here, there = view.scaled(SEARCH_SCALE), neighbour.scaled(SEARCH_SCALE)
    inside = in_picture(here.camera, here.project(world))
    if not inside.any():
        return None
    surface = surface_points(here, world[inside])
    warped = warp_to(there, here, surface, np.zeros((len(surface), 2))).picture
    first, second = (np.asarray(equalised(picture), np.float32) for picture in (warped, here.image))
    window: Any = cv2.createHanningWindow(first.shape[::-1], cv2.CV_32F)
    shift, _ = cv2.phaseCorrelate(first, second, window)
    middle = (np.array([here.camera.width, here.camera.height]) - 1) / 2
    rays = normalised_points(here.camera, np.stack([middle, middle + shift]))
    before, after = np.column_stack([rays, np.ones(2)]) / np.hypot(1, np.linalg.norm(rays, axis=1))[:, None]
    axis = np.cross(before, after)
    sine = float(np.linalg.norm(axis))
    turn = axis * np.arctan2(sine, before @ after) / (sine + TINY)
    return changed(view.pose, np.append(turn, np.zeros(3)))


def _corrected(motion: Array, equations: Array, expected: Array) -> tuple[Array, Array]:
    """Return a motion (9,) after its correction by `blur_equations`, and its covariance (9, 9).

    The correction is small, as is the bend.
    """
    turned = KERNEL_SIGMA * np.linalg.norm(motion[:3]) + TINY
    moved = KERNEL_SIGMA * np.linalg.norm(expected[3:]) + TINY
    sigma = np.repeat([turned, moved, turned], 3)
    right = equations[:, 9] - sigma**-2.0 * np.append(np.zeros(6), motion[6:])
    normal = equations[:, :9] + np.diag(sigma**-2.0)
    return np.asarray(motion + np.linalg.solve(normal, right)), np.asarray(np.linalg.inv(normal), float)


def _means(numbers: NDArray[np.int_], pixels: Array, covariance: Array) -> tuple[NDArray[np.int_], Array]:
    """Return each point once, and the mean of its pixels (M, 2) by their covariances (M, 2, 2)."""
    numbers, where = np.unique(numbers, return_inverse=True)
    precision = np.linalg.inv(covariance)
    total, right = np.zeros((len(numbers), 2, 2)), np.zeros((len(numbers), 2))
    np.add.at(total, where, precision)
    np.add.at(right, where, (precision @ pixels[..., None])[..., 0])
    return numbers, np.asarray(np.linalg.solve(total, right[..., None])[..., 0], float)
