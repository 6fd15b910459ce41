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
from blur2view.two_view.consensus import inliers_of
from blur2view.two_view.constants import LEAST_INDEPENDENT, LEAST_VARIANCE, SCALE_STEPS
from blur2view.two_view.fit_fundamental import Fit, FundamentalFit, fit_best
from blur2view.two_view.fit_homography import fit_homography
from blur2view.two_view.homography import HomographyFlow, cayley
from blur2view.two_view.likelihood import Likelihood
from blur2view.two_view.models import CameraF
from blur2view.two_view.options import EstimatorOptions
from blur2view.two_view.translation import KNOWN_DEG, DirectionLikelihood

# The squared distances of the truth are larger by this than their distribution says: with 1, the regions of
# four kinds of independent smears of `tools.evaluation.pose_coverage` hold it in 71 to 80 %, not 90. Chosen
# on the first half of its seeds.
MISSED = 2.0
CURVATURE_STEP = 0.3  # standard deviations over which the gradient is differenced
NARROW_DEG = 8.0  # deviation from which the grid of directions describes the region
ANY_DIRECTION = (np.pi - 2) / 2  # squared radians: variance of an axis of any direction along each tangent
# Deviation, in lengths of smears, of a rotation beside a translation that may account for any part of them:
# past things at one depth, or on a slope.
UNSEEN = 0.5
POSE = [2, 3, 4, 0, 1]  # a camera's parameters, rotation first


def fit_calibrated(
    likelihood: Likelihood, start: CameraF, directions: DirectionLikelihood
) -> tuple[CameraF, OrientedPose]:
    """Return the cheapest E, from a camera's fit or the likeliest direction of translation, and its pose."""
    rotation, t = directions.best
    starts = [start, CameraF(t=t, R=rotation_matrix(rotation), spread=likelihood.prior)]
    fits = [fit_best(MotionModel.CAMERA, [start], likelihood) for start in starts]
    point = cast(CameraF, min(fits, key=lambda fit: fit.score).point)
    residuals = likelihood.residuals(point.matrix())
    inliers = likelihood.order_weights(residuals).sum(axis=0)
    return point, oriented_pose(point.matrix(), likelihood.ends, residuals.forward_share, inliers)


def curvature(likelihood: Likelihood, point: CameraF) -> Array:
    """Return the second derivative (5, 5) of half the cost at E, rotation first, by differences.

    Unlike Gauss and Newton's matrix it knows that a smear whose order or kind is uncertain weighs less.
    """
    state = FundamentalFit.likelier(point, likelihood)
    normal, _ = state.normal_equations()
    steps = CURVATURE_STEP / np.sqrt(np.diag(normal) + TINY) * np.eye(len(normal))
    ahead, behind = ([state.moved(s * steps[k]).normal_equations()[1][POSE] for k in POSE] for s in (1, -1))
    rows = (np.array(ahead) - np.array(behind)) / (2 * np.diag(steps)[POSE, None])
    matrix: Array = 0.5 * (rows + rows.T)
    return matrix if np.linalg.eigvalsh(matrix)[0] > 0 else normal[np.ix_(POSE, POSE)]


def with_scale_of(likelihood: Likelihood, point: CameraF) -> Likelihood:
    """Return the likelihood with deviations as all residuals of E show them, each by its odds.

    Those of the better order alone, of which F was fitted, are by a twentieth smaller, with 30 % outliers by
    a tenth.
    """
    for _ in range(SCALE_STEPS):
        residuals = FundamentalFit.likelier(point, likelihood).residuals
        weight = likelihood.order_weights(residuals)
        variance = float((weight * residuals.both**2).sum() / max(weight.sum(), TINY))
        likelihood = likelihood.rescaled(float(np.sqrt(max(variance, LEAST_VARIANCE))))
    return likelihood


def covariance_of(
    pose: RigidTransform, point: CameraF, likelihood: Likelihood, region: PoseCovariance
) -> PoseCovariance:
    """Return the covariance of the pose of E at a point; ``region`` is that over all directions."""
    likelihood = with_scale_of(likelihood, point)
    precision = curvature(likelihood.fully_correlated, point)
    matrix = np.asarray(MISSED * np.linalg.pinv(precision, hermitian=True), np.float64)
    sign = np.copysign(1.0, pose.translation @ point.t)
    local = PoseCovariance(matrix=matrix, tangents=sign * plane_basis(point.t))
    # orders of the grid are outwards whatever the rotation: among many smears curvature misses less
    wide = (
        0.0
        if likelihood.fully_correlated.effective_count >= LEAST_INDEPENDENT
        else region.translation_sigma_deg
    )
    if max(wide, local.translation_sigma_deg) < NARROW_DEG:
        return local
    own = np.zeros((5, 5))  # of the rotation, whatever the direction: the grid has one rotation for each
    own[:3, :3] = np.linalg.pinv(precision[:3, :3], hermitian=True)
    return replace(region, matrix=region.matrix + own)


def with_pose(
    geometry: TwoViewGeometry,
    field: HomographyFlow | None,
    likelihood: Likelihood,
    fits: list[Fit],
    options: EstimatorOptions,
) -> TwoViewGeometry:
    """Return a geometry of known intrinsics with E and the pose; unchanged where there is neither F nor H.

    ``field`` is the homography's. The translation is given where parallax is proven, or its direction known
    to KNOWN_DEG and no rotation explains the smears alone; else the pose is the rotation, whatever the
    translation.
    """
    if geometry.F is None and geometry.H is None:
        return geometry
    if geometry.config is Configuration.PANORAMIC and field is not None:
        fit, why = (
            fit_homography(field, likelihood.fully_correlated),
            "the rotation that explains the smears alone",
        )
        vector, spread = fit.family.parameters[:3], fit.covariance()[:3, :3]
        return with_rotation_alone(geometry, likelihood, vector, spread, why)
    start = cast(CameraF, next(fit.point for fit in fits if fit.model is MotionModel.CAMERA))
    directions = DirectionLikelihood.of(likelihood)
    point, oriented = fit_calibrated(likelihood, start, directions)
    mean, region = directions.region(oriented.pose)
    covariance = covariance_of(oriented.pose, point, likelihood, region)
    given = geometry.parallax is Parallax.PROVEN or covariance.translation_sigma_deg < KNOWN_DEG
    if given or geometry.F is not None:
        geometry = with_essential(geometry, likelihood, oriented, covariance, options)
    if given:
        return geometry
    off = mean - oriented.pose.rotation_vector
    unseen = UNSEEN * float(np.median(likelihood.length_px)) / likelihood.unit_px
    spread = region.matrix[:3, :3] - np.outer(off, off) + unseen**2 * np.eye(3)
    why = "the mean rotation over all directions of translation"
    return with_rotation_alone(geometry, likelihood, mean, spread, why)


def with_rotation_alone(
    geometry: TwoViewGeometry, likelihood: Likelihood, vector: Array, covariance: Array, why: str
) -> TwoViewGeometry:
    """Return a geometry whose pose is a rotation alone with smears, F and E in the order of that rotation.

    F beside it is undecided and orders such smears no better than by chance; as E its transpose is equal.
    """
    F, E, swapped = geometry.F, geometry.E, against_rotation(vector, likelihood.ends)
    if F is not None and (swapped_order(F, likelihood.matches.ends) == swapped).mean() < 0.5:
        F, E = F.T.copy(), None if E is None else E.T.copy()
    matrix = np.diag([0.0, 0.0, 0.0, ANY_DIRECTION, ANY_DIRECTION])
    matrix[:3, :3] = covariance
    return replace(
        geometry,
        F=F,
        E=E,
        swapped=swapped,
        cam2_from_cam1=RigidTransform(rotation=cayley(cross_matrix(vector)), translation=np.zeros(3)),
        covariance=PoseCovariance(matrix=matrix, tangents=np.eye(3)[:2]),
        reason=f"{geometry.reason}; the pose is {why}",
    )


def with_essential(
    geometry: TwoViewGeometry,
    likelihood: Likelihood,
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
    F = likelihood.pixels(E)
    found = inliers_of(F, likelihood, options)
    return replace(
        geometry, F=F, inlier_mask=found.mask, support_by_chance=found.by_chance, model=MotionModel.CALIBRATED
    )
