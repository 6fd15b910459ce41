"""Policy: from unordered smears to the two-view geometry that is reported, or why there is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from blur2view.arrays import Array
from blur2view.camera.camera import Camera
from blur2view.geometry.pose import PoseCovariance, RigidTransform
from blur2view.geometry.rolling_shutter import LEAST, RollingShutter
from blur2view.geometry.sampson import serrmin, swapped_order
from blur2view.geometry.two_view_geometry import Configuration, MotionModel, Parallax, TwoViewGeometry
from blur2view.robust.homography import pixel_homography, transfer_orders
from blur2view.robust.parametrization import CameraF, TranslationF
from blur2view.robust.problem import SmearProblem
from blur2view.robust.residuals import RefineOptions
from blur2view.smears.matches import SmearMatches
from blur2view.two_view.acceptance import consensus, still, untold
from blur2view.two_view.calibrated import CalibratedFit, fit_calibrated
from blur2view.two_view.degeneracy import assess
from blur2view.two_view.model_selection import Fit
from blur2view.two_view.options import EstimatorOptions
from blur2view.two_view.rotation_only import RotationFit
from blur2view.two_view.search import search_and_fit
from blur2view.two_view.verdict import Structure, Verdict

# An F goes with PARALLAX and what is open, and with SEVERAL the one that most smears follow.
CONFIGURATIONS = {
    Structure.NOTHING: Configuration.UNDEFINED,
    Structure.STILL: Configuration.DEGENERATE,
    Structure.ROTATION: Configuration.PANORAMIC,
    Structure.PLANE: Configuration.PLANAR,
    Structure.ROTATION_OR_PLANE: Configuration.PLANAR_OR_PANORAMIC,
    Structure.OPEN: Configuration.PLANAR_OR_PANORAMIC,
    Structure.ROTATION_OPEN: Configuration.PANORAMIC,
    Structure.PLANE_OPEN: Configuration.PLANAR,
    Structure.PARALLAX: Configuration.UNCALIBRATED,
    Structure.SEVERAL: Configuration.MULTIPLE,
}


def estimate_two_view(
    matches: SmearMatches,
    options: EstimatorOptions | None = None,
    rng: np.random.Generator | None = None,
    camera: Camera | None = None,
    shutter: RollingShutter | None = None,
) -> TwoViewGeometry:
    """Return the two-view geometry of unordered smears, or the reason why there is no F.

    Parameters
    ----------
    matches : SmearMatches
    options : EstimatorOptions, optional
    rng : numpy.random.Generator, optional
        Default: seed 0. The same state gives the same answer.
    camera : Camera, optional
        Its intrinsics. F, H, E and the pose are then those of its undistorted pixels.
    shutter : RollingShutter, optional
        Of that camera, whose intrinsics must be known. The pose is then that of an exposure of all rows at
        once, another one for each order in time (``reversed()``); all else remains that of the smears.

    Returns
    -------
    TwoViewGeometry
        UNCALIBRATED with F, or CALIBRATED with F, E and the pose if the intrinsics are known; PANORAMIC
        (rotation), PLANAR or, where it is open which, PLANAR_OR_PANORAMIC with H, and with F beside it where
        parallax is open; MULTIPLE with the F
        that most smears follow; DEGENERATE (too few, too short or collinear smears, a still or
        constant image) or UNDEFINED (the best F explains hardly more smears than chance) with neither.

    Raises
    ------
    ValueError
        If the camera is for pictures of another size; if a shutter comes without known intrinsics.
    """
    if shutter is not None and (camera is None or not camera.known):
        raise ValueError("a rolling shutter changes the pose, which needs known intrinsics: give a camera")
    options = options or EstimatorOptions()
    rng = np.random.default_rng(0) if rng is None else rng
    held = still(matches, options)
    refusal = held or untold(matches, options)
    if refusal is not None:
        return replace(without_F(matches, Configuration.DEGENERATE, refusal), untold=held is None)
    recorded = matches.displacement
    if camera is not None:
        matches = undistorted(matches, camera)
    matches = matches.weighed_across()
    problem, fits, iterations = search_and_fit(matches, options, rng, camera)
    geometry = judge(matches, problem, fits, iterations, options, rng)
    if not problem.intrinsics_known:
        return geometry
    geometry = with_pose(geometry, matches, problem, fits, options)
    if shutter is None or camera is None or geometry.cam2_from_cam1 is None:
        return geometry
    exposures = shutter.exposures(
        np.where(geometry.swapped, -1.0, 1.0)[:, None] * recorded, (camera.width, camera.height)
    )
    return at_once(geometry, exposures, problem, fits, options)


def undistorted(matches: SmearMatches, camera: Camera) -> SmearMatches:
    """Return the matches as the camera's undistorted picture shows them; a smear without rays stays as it is.

    Raises
    ------
    ValueError
        If the camera is for pictures of another size; see `Camera.for_image`.
    """
    if matches.image_size not in (None, (camera.width, camera.height)):
        raise ValueError(f"camera is for {camera.width}x{camera.height}, matches for {matches.image_size}")

    def straightened(ends: Array) -> Array:
        straight = camera.undistorted(ends)
        return np.where(np.isfinite(straight).all(axis=(1, 2), keepdims=True), straight, ends)

    sure = None if matches.sure_ends is None else straightened(matches.sure_ends)
    return replace(matches, ends=straightened(matches.ends), sure_ends=sure)


def with_pose(
    geometry: TwoViewGeometry,
    matches: SmearMatches,
    problem: SmearProblem,
    fits: list[Fit],
    options: EstimatorOptions,
) -> TwoViewGeometry:
    """Return a geometry of known intrinsics with the pose and its covariance, with F also E.

    The translation is zero unless parallax is proven.
    """
    if geometry.config is Configuration.MULTIPLE or (geometry.F is None and geometry.H is None):
        return geometry
    if geometry.F is not None:
        geometry = with_essential(geometry, matches, problem, fits, options)
    if geometry.parallax is Parallax.PROVEN:
        return geometry
    pose, covariance = rotation_only_pose(geometry, problem)
    return replace(
        geometry,
        cam2_from_cam1=pose,
        covariance=covariance,
        reason=f"{geometry.reason}; the pose is the rotation that explains the smears without translation",
    )


def rotation_only_pose(
    geometry: TwoViewGeometry, problem: SmearProblem
) -> tuple[RigidTransform, PoseCovariance]:
    """Return the pose without translation of a geometry without proven parallax, and its covariance."""
    translates = geometry.config is not Configuration.PANORAMIC
    return RotationFit(problem=problem).pose(geometry.swapped, translates)


def at_once(
    geometry: TwoViewGeometry,
    exposures: Array,
    problem: SmearProblem,
    fits: list[Fit],
    options: EstimatorOptions,
) -> TwoViewGeometry:
    """Return a geometry with the poses, in both orders in time, of an exposure of all rows at once.

    Parameters
    ----------
    exposures : ndarray of shape (N,)
        For how long the smears were seen in the order of ``geometry`` (`RollingShutter.exposures`).
    """

    def posed(flip: TwoViewGeometry, seen: Array) -> TwoViewGeometry:
        smears = problem.shortened(np.maximum(seen, LEAST))
        if flip.parallax is not Parallax.PROVEN:
            pose, covariance = rotation_only_pose(flip, smears)
        else:
            fit = calibrated_fit(smears, fits, options)
            oriented = fit.oriented()
            pose, covariance = oriented.pose, fit.covariance()
            if (oriented.swapped != flip.swapped).mean() > 0.5:
                pose, covariance = pose.inverse(), covariance.inverse(pose)
        return replace(flip, cam2_from_cam1=pose, covariance=covariance)

    flips = [(geometry, exposures), (geometry.reversed(), 2 - exposures)]
    possible = [posed(flip, seen) for flip, seen in flips if np.median(seen) > LEAST]
    if len(possible) == 2:
        return replace(possible[0], backward=possible[1])
    reason = f"{geometry.reason}; in the other order in time the rows leave no such smears"
    return replace(possible[0], reason=reason)


def with_essential(
    geometry: TwoViewGeometry,
    matches: SmearMatches,
    problem: SmearProblem,
    fits: list[Fit],
    options: EstimatorOptions,
) -> TwoViewGeometry:
    """Return a geometry with F refitted to known intrinsics, E and, of proven parallax, its pose."""
    fit = calibrated_fit(problem, fits, options)
    oriented = fit.oriented()
    F = problem.pixels(oriented.pose.essential)
    tolerance_px = options.tolerance_px(problem.sigma_px)
    proven = geometry.parallax is Parallax.PROVEN
    return replace(
        geometry,
        F=F,
        E=oriented.pose.essential,
        cam2_from_cam1=oriented.pose if proven else None,
        covariance=fit.covariance() if proven else None,
        reason=f"{geometry.reason}; E was then fitted to the known intrinsics",
        config=Configuration.CALIBRATED if proven else geometry.config,
        model=MotionModel.CALIBRATED,
        inlier_mask=serrmin(F, matches.ends) < tolerance_px**2,
        swapped=oriented.swapped,
    )


def calibrated_fit(problem: SmearProblem, fits: list[Fit], options: EstimatorOptions) -> CalibratedFit:
    """Return the pose of known intrinsics, from the fits of the search."""
    points = {fit.model: fit.point for fit in fits}
    start, simple = points.get(MotionModel.CAMERA), points[MotionModel.TRANSLATION]
    if not isinstance(start, CameraF) or not isinstance(simple, TranslationF):
        raise TypeError(f"known intrinsics need a camera's fit, got {sorted(points)}")
    refinement = RefineOptions(cutoff=options.cutoff, data_weight=problem.data_weight)
    return fit_calibrated(problem, start, simple, refinement)


def judge(
    matches: SmearMatches,
    problem: SmearProblem,
    fits: list[Fit],
    iterations: int,
    options: EstimatorOptions,
    rng: np.random.Generator,
) -> TwoViewGeometry:
    """Return the cheapest model, tested against chance, no parallax and several motions."""
    best = min(fits, key=lambda fit: fit.score)
    doubt, figures = consensus(best, problem, matches, options, rng)
    verdict = assess(matches, problem, fits, options, rng, doubt)
    costs = {fit.model: fit.score for fit in fits}
    costs[verdict.fit.model] = verdict.fit.score
    scores = tuple(sorted([*costs.items(), *verdict.scores], key=lambda score: score[1]))
    config, F = CONFIGURATIONS[verdict.structure], verdict.F
    tolerance_px = options.tolerance_px(problem.sigma_px)
    if F is not None:
        F = problem.pixels(F)
        inlier_mask, swapped = serrmin(F, matches.ends) < tolerance_px**2, swapped_order(F, matches.ends)
        reason = f"{verdict.sentence}; {figures}; {chosen(verdict, scores)}"
    elif verdict.A is not None:
        ordered = transfer_orders(verdict.A, problem.weighted)
        inlier_mask = np.abs(ordered.least) * problem.sigma_px < tolerance_px
        swapped = np.abs(ordered.backward) < np.abs(ordered.forward)
        reason = f"{verdict.structure}: {verdict.sentence}"
    else:
        reason = f"{verdict.sentence}: {figures}"
        return without_F(matches, config, reason, iterations, scores)
    return TwoViewGeometry(
        F=F,
        H=None if verdict.A is None else pixel_homography(verdict.A, problem.T),
        config=config,
        reason=reason,
        inlier_mask=inlier_mask,
        swapped=swapped,
        iterations=iterations,
        model=verdict.model,
        scores=scores,
    )


def chosen(verdict: Verdict, scores: tuple[tuple[MotionModel, float], ...]) -> str:
    """Return the clause that names the model of F, with the others' costs above its own."""
    if verdict.structure is Structure.SEVERAL:
        return "F is the best single one"
    own = verdict.fit
    others = ", ".join(f"{model} {cost - own.score:+.1f}" for model, cost in scores if model != own.model)
    return f"F is of the {own.model} family (penalised cost of the others: {others})"


def without_F(
    matches: SmearMatches,
    config: Configuration,
    reason: str,
    iterations: int = 0,
    scores: tuple[tuple[MotionModel, float], ...] = (),
) -> TwoViewGeometry:
    """Return the geometry without F, with its reason."""
    none = np.zeros(len(matches), bool)
    return TwoViewGeometry(
        F=None,
        config=config,
        reason=reason,
        inlier_mask=none,
        swapped=none.copy(),
        iterations=iterations,
        scores=scores,
    )
