"""The estimators that `benchmark_estimators` compares, with the options their users would choose.

Thresholds of the others were chosen on the base case's seeds 10000 to 10059 of both kinds, by pose AUC at 10
degrees, from 0.5, 1, 1.5, 2, 3 and 4 px: MAGSAC 1 (0.78; 0.5 gave 0.79 in three times the time), ACCURATE 1.5
(0.75), pycolmap 2 (0.71), PoseLib 2 (0.79) and, with K, 3 (0.90). Everything else is as their functions have
it by default, or for OpenCV as in :mod:`tools.estimators.baselines`.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import cv2
import numpy as np

from blur2view.arrays import AnyArray
from blur2view.camera.camera import Camera
from blur2view.smears.matches import SmearMatches
from blur2view.two_view.estimate import estimate_two_view
from tools.estimators import baselines
from tools.estimators.paper import paper_of_matches


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """Unordered matches, the same ends in their true order, and the truth; pixels.

    ``true_ends`` (M, 2, 2) are exact smears, on which F is judged; ``R``, ``t`` are ``cam2_from_cam1``.
    """

    matches: SmearMatches
    ordered: AnyArray  # (N, 2, 2)
    true_ends: AnyArray
    K: AnyArray
    R: AnyArray
    t: AnyArray
    F: AnyArray


Method = Callable[[Problem], "AnyArray | None"]


def with_camera(problem: Problem) -> AnyArray | None:
    """Return our F, found with the true intrinsics."""
    assert problem.matches.image_size is not None
    width, height = problem.matches.image_size
    return estimate_two_view(problem.matches, camera=Camera(K=problem.K, width=width, height=height)).F


def ordered_with_camera(problem: Problem) -> AnyArray | None:
    """Return the F of PoseLib, given the true order and intrinsics."""
    solver = partial(baselines.poselib_calibrated, K=problem.K, max_error_px=3.0)
    return baselines.solve(solver, problem.ordered)


def rival(solver: baselines.Solver, order: Callable[[Problem], AnyArray]) -> Method:
    """Return another's solver, given the ends in some order."""
    return lambda problem: baselines.solve(solver, order(problem))


ORDERS: dict[str, Callable[[Problem], AnyArray]] = {
    "unordered": lambda problem: baselines.scrambled(problem.matches.ends, np.random.default_rng(0)),
    "u > 0 order": lambda problem: baselines.rightward(problem.matches.ends),
    "true order": lambda problem: problem.ordered,
}
MAGSAC = partial(baselines.opencv, max_error_px=1.0)
PYCOLMAP = partial(baselines.pycolmap_ransac, max_error_px=2.0)
SOLVERS: dict[str, baselines.Solver] = {
    "OpenCV MAGSAC": MAGSAC,
    "OpenCV ACCURATE": partial(baselines.opencv, method=cv2.USAC_ACCURATE, max_error_px=1.5),
    "pycolmap": partial(PYCOLMAP, trials=(1000, 100_000)),
    "pycolmap at COLMAP's trials": partial(PYCOLMAP, trials=(100, 10_000), confidence=0.999),
    "PoseLib": partial(baselines.poselib_ransac, max_error_px=2.0, max_iterations=100_000),
}
OURS, PAPER, PYCOLMAP_NAME = "ours", "the paper's", "true order, pycolmap"
TRUE_ORDER = {f"true order, {name}": rival(one, ORDERS["true order"]) for name, one in SOLVERS.items()}
METHODS: dict[str, Method] = {
    OURS: lambda problem: estimate_two_view(problem.matches).F,
    "ours, no image size": lambda problem: estimate_two_view(replace(problem.matches, image_size=None)).F,
    "ours, K given": with_camera,
    "two-parameter F": lambda problem: baselines.two_parameter_fundamental(problem.matches),
    PAPER: lambda problem: paper_of_matches(problem.matches),
    **{f"{order}, OpenCV MAGSAC": rival(MAGSAC, ORDERS[order]) for order in ("unordered", "u > 0 order")},
    **TRUE_ORDER,
    "true order and K, PoseLib": ordered_with_camera,
}
