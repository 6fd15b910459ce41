"""The pose of a camera with known intrinsics: E, the rotation, and the translation where it is known.

E has five parameters and is fitted as F is, started from the camera's fit and from the likeliest direction of
translation. How sure the pose is comes from the likelihood over all directions (`translation`), or, where
that is narrower than its grid, from the curvature at E.
"""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np

from blur2view.arrays import TINY, Array
from blur2view.geometry.epipolar import cross_matrix
from blur2view.geometry.pose import OrientedPose, PoseCovariance, RigidTransform, oriented_pose
from blur2view.geometry.rotation import against_rotation, plane_basis, rotation_matrix
from blur2view.geometry.sampson import swapped_order
from blur2view.geometry.two_view_geometry import Configuration, MotionModel, Parallax, TwoViewGeometry
from blur2view.robust.homography import RotationH, cayley
from blur2view.robust.parametrization import CameraF, CameraPrior
from blur2view.robust.problem import SmearProblem
from blur2view.robust.refinement import WeightedPoint
from blur2view.robust.residuals import RefineOptions
from blur2view.smears.matches import SmearMatches
from blur2view.two_view.flow import FlowData, fit_flow
from blur2view.two_view.model_selection import Fit, fit_best, with_inliers
from blur2view.two_view.options import EstimatorOptions
from blur2view.two_view.translation import KNOWN_DEG, DirectionLikelihood

CURVATURE_STEP = 0.3  # standard deviations over which the gradient is differenced
# Of 40 scenes with independent noise and 20 % outliers (seeds from 2000 of tests/geometry/test_pose.py) the
# squared distances of the truth are larger by this than their distribution says, in the median and at 80 %.
MISSED = 1.7
NARROW_DEG = 8.0  # deviation from which the grid of directions describes the region
ANY_DIRECTION = (np.pi - 2) / 2  # squared radians: variance of an axis of any direction along each tangent
# Deviation, in lengths of smears, of a rotation beside a translation that may account for any part of them:
# past things at one depth, or on a slope.
UNSEEN = 0.5
POSE = [2, 3, 4, 0, 1]  # a camera's parameters, rotation first


def fit_calibrated(
    problem: SmearProblem, start: CameraF, likelihood: DirectionLikelihood
) -> tuple[CameraF, OrientedPose]:
    """Return the cheapest E, from a camera's fit or the likeliest direction of translation, and its pose."""
    rotation, t = likelihood.best
    starts = [start, CameraF(t=t, R=rotation_matrix(rotation), spread=problem.prior)]
    fits = [fit_best(MotionModel.CAMERA, [start], problem) for start in starts]
    point = cast(CameraF, min(fits, key=lambda fit: fit.score).point)
    residuals = problem.weighted.residuals(point.matrix())
    inliers = problem.weighted.order_weights(residuals).sum(axis=0)
    return point, oriented_pose(point.matrix(), problem.ends, residuals.forward_share, inliers)


def curvature(problem: SmearProblem, point: CameraF) -> Array:
    """Return the second derivative (5, 5) of half the cost at E, rotation first, by differences.

    All correlation of neighbours is counted. Unlike Gauss-Newton's matrix it knows that a smear whose order
    or kind is uncertain weighs less.
    """
    options = RefineOptions(data_weight=problem.shared.all_correlation)
    state = WeightedPoint.likelier(point, problem.weighted, options)
    normal, _ = state.normal_equations()
    rows = []
    for k in POSE:
        delta = CURVATURE_STEP / np.sqrt(normal[k, k] + TINY) * np.eye(len(normal))[k]
        ahead, behind = (state.moved(s * delta).reweighted().normal_equations()[1] for s in (1, -1))
        rows.append((ahead - behind)[POSE] / (2 * delta[k]))
    matrix: Array = 0.5 * (np.array(rows) + np.array(rows).T)
    return matrix if np.linalg.eigvalsh(matrix)[0] > 0 else normal[np.ix_(POSE, POSE)]


def covariance_of(
    pose: RigidTransform, point: CameraF, problem: SmearProblem, likelihood: DirectionLikelihood
) -> PoseCovariance:
    """Return the covariance of the pose of E at a point."""
    precision = curvature(problem, point)
    region = likelihood.region(pose).covariance(pose.translation, pose.rotation_vector)
    matrix = np.asarray(MISSED * np.linalg.pinv(precision, hermitian=True), np.float64)
    sign = np.copysign(1.0, pose.translation @ point.t)
    local = PoseCovariance(matrix=matrix, tangents=sign * plane_basis(point.t))
    if max(region.translation_sigma_deg, local.translation_sigma_deg) < NARROW_DEG:
        return local
    own = np.zeros((5, 5))  # of the rotation, whatever the direction: the grid has one rotation for each
    own[:3, :3] = np.linalg.pinv(precision[:3, :3], hermitian=True)
    return replace(region, matrix=region.matrix + own)


def with_pose(
    geometry: TwoViewGeometry,
    matches: SmearMatches,
    problem: SmearProblem,
    fits: list[Fit],
    options: EstimatorOptions,
) -> TwoViewGeometry:
    """Return a geometry of known intrinsics with E and the pose; unchanged where there is neither F nor H.

    The translation is given where parallax is proven, or its direction known to KNOWN_DEG and no rotation
    explains the smears alone; else the pose is the rotation, whatever the translation.
    """
    if geometry.config is Configuration.MULTIPLE or (geometry.F is None and geometry.H is None):
        return geometry
    if geometry.config is Configuration.PANORAMIC:
        pose, covariance = pose_of_rotation(matches, problem, geometry)
        reason = f"{geometry.reason}; the pose is the rotation that explains the smears alone"
        return replace(geometry, cam2_from_cam1=pose, covariance=covariance, reason=reason)
    start = next(fit.point for fit in fits if isinstance(fit.point, CameraF))
    likelihood = DirectionLikelihood.of(problem, matches.bulk_px[1] * problem.noise_scale)
    point, oriented = fit_calibrated(problem, start, likelihood)
    pose = oriented.pose
    covariance = covariance_of(pose, point, problem, likelihood)
    given = geometry.parallax is Parallax.PROVEN or covariance.translation_sigma_deg < KNOWN_DEG
    if given or geometry.F is not None:
        geometry = with_essential(geometry, matches, problem, oriented, covariance, options)
    if given:
        return geometry
    region = likelihood.region(pose)
    flip = 1.0 if (oriented.swapped == geometry.swapped).mean() >= 0.5 else -1.0
    wide = region.covariance(pose.translation, region.rotation).matrix.copy()
    wide[:3, 3:], wide[3:, :3] = 0.0, 0.0
    wide[3:, 3:] = ANY_DIRECTION * np.eye(2)
    unseen = UNSEEN * float(np.median(problem.length_px)) / problem.unit_px
    wide[:3, :3] += unseen**2 * np.eye(3)
    return replace(
        geometry,
        cam2_from_cam1=rotation_alone(flip * region.rotation),
        covariance=PoseCovariance(matrix=wide, tangents=np.eye(3)[:2]),
        reason=f"{geometry.reason}; the pose is the mean rotation over all directions of translation",
    )


def with_essential(
    geometry: TwoViewGeometry,
    matches: SmearMatches,
    problem: SmearProblem,
    oriented: OrientedPose,
    covariance: PoseCovariance,
    options: EstimatorOptions,
) -> TwoViewGeometry:
    """Return a geometry with E, its pose, and F, where there is one, refitted to the known intrinsics."""
    E = oriented.pose.essential
    proven = geometry.parallax is Parallax.PROVEN
    geometry = replace(
        geometry,
        E=E,
        cam2_from_cam1=oriented.pose,
        covariance=covariance,
        reason=f"{geometry.reason}; E was then fitted to the known intrinsics",
        config=Configuration.CALIBRATED if proven else geometry.config,
        swapped=oriented.swapped,
    )
    if geometry.F is None:
        return geometry
    F, inlier_mask = with_inliers(E, matches, problem, options)
    return replace(geometry, F=F, inlier_mask=inlier_mask, model=MotionModel.CALIBRATED)


def in_order_of_rotation(geometry: TwoViewGeometry, matches: SmearMatches, rays: Array) -> TwoViewGeometry:
    """Return a geometry whose pose is a rotation alone with smears, F and E in the order of that rotation.

    F beside it is undecided and orders such smears no better than by chance; as E its transpose is equal.
    ``rays`` (N, 2, 2) are those of the matches' ends. Other geometries stay as they are.
    """
    pose, F, E = geometry.cam2_from_cam1, geometry.F, geometry.E
    if pose is None or pose.translation.any():
        return geometry
    swapped = against_rotation(pose.rotation_vector, rays)
    if F is not None and (swapped_order(F, matches.ends) == swapped).mean() < 0.5:
        F, E = F.T.copy(), None if E is None else E.T.copy()
    return replace(geometry, F=F, E=E, swapped=swapped)


def pose_of_rotation(
    matches: SmearMatches, problem: SmearProblem, geometry: TwoViewGeometry
) -> tuple[RigidTransform, PoseCovariance]:
    """Return the rotation that explains smears alone, ordered as ``swapped``, and its covariance."""
    scale = problem.noise_scale
    along, across = matches.bulk_px
    data = FlowData.of(problem, (scale * along, scale * across))
    fixed = CameraPrior(rotation=problem.prior.rotation, log_focal=0.0, principal=0.0)
    if geometry.H is None:
        raise ValueError("a rotation is refined from its homography, which is missing")
    A = problem.T @ geometry.H @ np.linalg.inv(problem.T)
    A = A / np.cbrt(np.linalg.det(A)) - np.eye(3)
    fit = fit_flow(RotationH.from_generator(A, fixed), data.without_low_frequency())
    swapped = np.where(geometry.swapped, -1.0, 1.0)
    vector = fit.family.rotation * (1.0 if (fit.sign * swapped).sum() >= 0 else -1.0)
    matrix = np.diag([0.0, 0.0, 0.0, ANY_DIRECTION, ANY_DIRECTION])
    matrix[:3, :3] = fit.covariance(problem.shared.all_correlation, data)[:3, :3]
    return rotation_alone(vector), PoseCovariance(matrix=matrix, tangents=np.eye(3)[:2])


def rotation_alone(vector: Array) -> RigidTransform:
    """Return the rotation whose motion of points at mid exposure is that of a vector (3,)."""
    return RigidTransform(rotation=cayley(cross_matrix(vector)), translation=np.zeros(3))
