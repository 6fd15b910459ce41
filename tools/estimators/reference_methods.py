"""F and pose by pycolmap and OpenCV, which are given the order of all matches, and by ours, which is not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.camera.camera import Camera
from blur2view.camera.colmap_camera import colmap_camera, to_colmap
from blur2view.geometry.epipolar import fundamental_from_pose
from blur2view.smears.matches import SmearMatches
from blur2view.two_view.estimate import estimate_two_view

MAX_ERROR_PX = 1.0  # of pycolmap and OpenCV; the noise is 1 px a coordinate, or 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """Matches in an order, and the truth.

    ``unordered`` is what we are given; ``ordered`` (N, 2, 2) the same ends, open then close, for the others;
    ``inlier`` (N,) marks true matches, if that is known; ``true_ends`` (M, 2, 2) are exact.
    """

    unordered: SmearMatches
    ordered: Array
    inlier: NDArray[np.bool_] | None
    true_ends: Array
    camera: Camera
    R: Array
    t: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Answer:
    """What a method found; ``inlier`` (N,) are the matches that it keeps."""

    F: Array | None
    inlier: NDArray[np.bool_]
    R: Array | None = None
    t: Array | None = None
    config: str = "-"


Method = Callable[[Case], Answer]


def ours(case: Case, calibrated: bool = True) -> Answer:
    """Return our answer, without any order."""
    camera = case.camera if calibrated else None
    found = estimate_two_view(case.unordered, rng=np.random.default_rng(0), camera=camera)
    pose = found.cam2_from_cam1
    return Answer(
        F=found.F,
        inlier=found.inlier_mask,
        R=None if pose is None else pose.rotation,
        t=None if pose is None else pose.translation,
        config=found.config.name,
    )


def pycolmap_fundamental(case: Case) -> Answer:
    """Return the answer of ``pycolmap.estimate_fundamental_matrix``; no intrinsics."""
    import pycolmap

    options = pycolmap.RANSACOptions(max_error=MAX_ERROR_PX, random_seed=0)
    found = pycolmap.estimate_fundamental_matrix(case.ordered[:, 0], case.ordered[:, 1], options)
    if found is None:
        return nothing(case)
    return Answer(F=np.asarray(found["F"]), inlier=np.asarray(found["inlier_mask"], bool))


def pycolmap_two_view(case: Case, max_error_px: float) -> Answer:
    """Return that of ``pycolmap.estimate_two_view_geometry``, with its configuration; intrinsics known."""
    import pycolmap

    camera = colmap_camera(case.camera.model, case.camera.width, case.camera.height, case.camera.params)
    camera.has_prior_focal_length = True
    options = pycolmap.TwoViewGeometryOptions(compute_relative_pose=True)
    options.ransac.max_error, options.ransac.random_seed = max_error_px, 0
    points = [to_colmap(case.ordered[:, end]) for end in (0, 1)]
    index = np.repeat(np.arange(len(case.ordered), dtype=np.uint32)[:, None], 2, axis=1)
    found = pycolmap.estimate_two_view_geometry(camera, points[0], camera, points[1], index, options)
    kept = np.zeros(len(case.ordered), bool)
    kept[np.asarray(found.inlier_matches, int).reshape(-1, 2)[:, 0]] = True
    pose, name = found.cam2_from_cam1, pycolmap.TwoViewGeometryConfiguration(found.config).name
    if pose is None or not np.linalg.norm(pose.translation) > 0:
        return Answer(F=None, inlier=kept, config=name)
    R, t = pose.rotation.matrix(), np.asarray(pose.translation)
    return Answer(F=fundamental_from_pose(case.camera.K, R, t), inlier=kept, R=R, t=t, config=name)


def opencv_fundamental(case: Case) -> Answer:
    """Return the answer of OpenCV's USAC_MAGSAC; no intrinsics."""
    first, second = case.ordered[:, 0], case.ordered[:, 1]
    F, kept = _found(cv2.findFundamentalMat(first, second, cv2.USAC_MAGSAC, MAX_ERROR_PX, 0.9999, 10_000))
    return nothing(case) if F is None else Answer(F=np.asarray(F[:3]), inlier=kept.ravel().astype(bool))


def opencv_essential(case: Case) -> Answer:
    """Return the answer of OpenCV's findEssentialMat and recoverPose; intrinsics known."""
    first, second = case.ordered[:, 0], case.ordered[:, 1]
    E, kept = _found(
        cv2.findEssentialMat(first, second, case.camera.K, cv2.USAC_MAGSAC, 0.9999, MAX_ERROR_PX)
    )
    if E is None:
        return nothing(case)
    inlier = kept.ravel().astype(bool)
    pose = cv2.recoverPose(E[:3], first, second, case.camera.K, mask=kept.copy())
    R, t = np.asarray(pose[1], float), np.asarray(pose[2], float).ravel()
    return Answer(F=fundamental_from_pose(case.camera.K, R, t), inlier=inlier, R=R, t=t)


def _found(pair: Any) -> tuple[Array | None, Array]:
    """Return what OpenCV's solvers do, typed: a matrix, None if they find nothing, and a mask."""
    matrix, mask = pair
    return matrix, mask


def nothing(case: Case) -> Answer:
    """Return the answer without F and inliers."""
    return Answer(F=None, inlier=np.zeros(len(case.ordered), bool))


METHODS: dict[str, Method] = {
    "ours, no order given, K known": ours,
    "ours, no order given": lambda case: ours(case, calibrated=False),
    "pycolmap, estimate_fundamental_matrix": pycolmap_fundamental,
    "pycolmap, estimate_two_view_geometry, its 4 px": lambda case: pycolmap_two_view(case, 4.0),
    "pycolmap, estimate_two_view_geometry, 1 px": lambda case: pycolmap_two_view(case, MAX_ERROR_PX),
    "OpenCV, findFundamentalMat MAGSAC": opencv_fundamental,
    "OpenCV, findEssentialMat MAGSAC": opencv_essential,
}
