"""From unordered smears to the two-view geometry that is reported, or the reason why no F is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array, require
from blur2view.camera.camera import Camera
from blur2view.geometry.epipolar import transfer, unit_norm
from blur2view.geometry.rolling_shutter import LEAST, RollingShutter, shortened
from blur2view.geometry.sampson import sampson
from blur2view.geometry.two_view_geometry import Configuration, Parallax, TwoViewGeometry
from blur2view.smears.blur import Blur, BlurKind
from blur2view.smears.matches import SmearMatches
from blur2view.two_view.choice import Choice, choose
from blur2view.two_view.consensus import inliers_of, insufficient_data, moved_as_one, no_inliers, still
from blur2view.two_view.constants import AROUND
from blur2view.two_view.homography import pixel_homography
from blur2view.two_view.likelihood import Likelihood
from blur2view.two_view.options import EstimatorOptions
from blur2view.two_view.order import end_order, open_and_close
from blur2view.two_view.pose import EstimatedPose, estimate_pose
from blur2view.two_view.search import search_and_fit

# Of two orders in time the one that needs less parallax comes first.
LESS_PARALLAX = [Parallax.ABSENT, Parallax.UNDECIDED, Parallax.PROVEN]


def estimate_two_view(
    matches: SmearMatches,
    options: EstimatorOptions | None = None,
    rng: np.random.Generator | int | None = None,
    camera: Camera | None = None,
    shutter: RollingShutter | None = None,
) -> TwoViewGeometry:
    """Return the two-view geometry of unordered smears, or the reason why there is no F.

    Parameters
    ----------
    matches : SmearMatches
    options : EstimatorOptions, optional
    rng : numpy.random.Generator or int, optional
        Source of randomness or its seed, 0 by default. The same state gives the same answer.
    camera : Camera, optional
        Its intrinsics. F, H, E and the pose are then those of its undistorted pixels.
    shutter : RollingShutter, optional
        Of that camera, whose intrinsics must be known. A geometry with F or H is then that of an exposure of
        all rows at once, another one for each order in time (``reversed()``): of both that which has less
        parallax is given.

    Returns
    -------
    TwoViewGeometry
        UNCALIBRATED with F, or CALIBRATED with F, E and the pose if the intrinsics are known; PANORAMIC
        (rotation), PLANAR or, undecided which, PLANAR_OR_PANORAMIC with H, and with F beside it where
        parallax is undecided; DEGENERATE (too few, too short or collinear smears, a still or constant image)
        or UNDEFINED (the best F explains hardly more smears than chance) with neither.

    Raises
    ------
    ValueError
        If the camera is for pictures of another size; if a shutter comes without known intrinsics.
    """
    require("matches", matches, SmearMatches, "as of select_matches(network.predict(image))")
    if shutter is not None and (camera is None or not camera.known):
        raise ValueError("a rolling shutter changes the pose, which needs known intrinsics: give a camera")
    options = options or EstimatorOptions()
    require("options", options, EstimatorOptions, "as EstimatorOptions(max_error_px=2)")
    rng = np.random.default_rng(0 if rng is None else rng)
    geometry = as_recorded(matches, options, rng, camera, rolling=shutter is None)
    without_orders = geometry.F is None and geometry.H is None
    if shutter is None or camera is None or not shutter.readout_s or without_orders:
        return geometry
    flips = []
    for flip in (geometry, geometry.reversed()):
        there = to_global_shutter(matches, flip.second_end_is_open, shutter, (camera.width, camera.height))
        if there is not None:
            other = as_recorded(there, options, rng, camera)
            flips.append(
                other
                if (other.second_end_is_open == flip.second_end_is_open).mean() >= 0.5
                else other.reversed()
            )
    if len(flips) == 1:
        reason = f"{flips[0].reason}; in the other order in time the rows leave no such smears"
        return replace(flips[0], reason=reason)
    first, second = sorted(flips, key=lambda f: (f.cam2_from_cam1 is None, LESS_PARALLAX.index(f.parallax)))
    return replace(first, backward=second)


def without_motion(matches: SmearMatches, blur: Blur) -> TwoViewGeometry:
    """Return the geometry of a photograph whose camera did not move, or does not show whether it did."""
    reason = f"no motion of the camera: {blur.reason}"
    if blur.kind in (BlurKind.OUT_OF_FOCUS, BlurKind.CANNOT_TELL):
        return no_geometry(matches, reason, insufficient_data=True)
    return no_geometry(matches, reason, stood_still=True)


def no_geometry(
    matches: SmearMatches, reason: str, *, stood_still: bool = False, insufficient_data: bool = False
) -> TwoViewGeometry:
    """Return a degenerate geometry."""
    return TwoViewGeometry(
        F=None,
        config=Configuration.DEGENERATE,
        reason=reason,
        inlier_mask=np.zeros(len(matches), bool),
        second_end_is_open=np.zeros(len(matches), bool),
        stood_still=stood_still,
        insufficient_data=insufficient_data,
    )


def to_global_shutter(
    matches: SmearMatches,
    second_end_is_open: NDArray[np.bool_],
    shutter: RollingShutter,
    image_size: tuple[int, int],
) -> SmearMatches | None:
    """Return the matches as an exposure of all rows at once leaves them, in a given order of the ends (N,).

    None where no motion leaves them in this order in time. Every smear is ordered as those around it.
    """
    from scipy.spatial import cKDTree  # 0.1 s, so only for a rolling shutter

    directed = np.where(second_end_is_open, -1.0, 1.0)[:, None] * matches.displacement
    around = cKDTree(matches.midpoint).query(matches.midpoint, min(AROUND, len(matches)))[1]
    backward = (matches.displacement * directed[around].sum(axis=1)).sum(axis=1, keepdims=True) < 0
    exposures = shutter.exposures(np.where(backward, -1.0, 1.0) * matches.displacement, image_size)
    if np.median(exposures) <= LEAST:
        return None
    exposures = np.maximum(exposures, LEAST)
    return replace(
        matches,
        ends=shortened(matches.ends, exposures),
        sigma_px=matches.sigma_px / exposures,
        across_px=matches.across_px / exposures,
    )


def as_recorded(
    matches: SmearMatches,
    options: EstimatorOptions,
    rng: np.random.Generator,
    camera: Camera | None,
    *,
    rolling: bool = False,
) -> TwoViewGeometry:
    """Return the two-view geometry of unordered smears, as `estimate_two_view` without a shutter.

    With ``rolling`` a rolling shutter is one of the models.
    """
    if (reason := still(matches)) is not None:
        return no_geometry(matches, reason, stood_still=True)
    if (reason := moved_as_one(matches)) is not None:
        return no_geometry(matches, reason)
    if (reason := insufficient_data(matches)) is not None:
        return no_geometry(matches, reason, insufficient_data=True)
    straight = matches if camera is None else undistorted(matches, camera)
    likelihood, fit = search_and_fit(Likelihood.of(straight, camera), rng)
    found = inliers_of(likelihood.pixels(fit.point.matrix()), likelihood, options)
    choice = choose(likelihood, fit, rng, agreement=found.beyond_chance, rolling=rolling)
    pose = None
    if likelihood.intrinsics_known and (choice.reports_F or choice.homography is not None):
        pose = estimate_pose(likelihood, choice)
    geometry = geometry_of(choice, pose, likelihood, options)
    reasons = choice.sentence, found.figures if pose is None else f"{found.figures}{pose.sentence}"
    return in_order(replace(geometry, reason=": ".join(reasons)), matches, camera)


def geometry_of(
    choice: Choice, pose: EstimatedPose | None, likelihood: Likelihood, options: EstimatorOptions
) -> TwoViewGeometry:
    """Return the geometry of a choice and a pose with its inliers, without the order of the ends."""
    F, H, inliers = None, None, no_inliers(len(likelihood))
    if choice.homography is not None:
        H = pixel_homography(choice.homography.family.generator(), likelihood.T)
        inliers = inliers_of(choice.homography, likelihood, options)
    if choice.reports_F:
        E = None if pose is None else pose.E
        F = likelihood.pixels(choice.fit.point.matrix() if E is None else E)
        inliers = inliers_of(F, likelihood, options)
    proven = pose is not None and choice.config is Configuration.UNCALIBRATED
    return TwoViewGeometry(
        F=F,
        H=H,
        config=Configuration.CALIBRATED if proven else choice.config,
        reason=choice.sentence,
        inlier_mask=inliers.mask,
        second_end_is_open=np.zeros(len(likelihood), bool),
        cam2_from_cam1=None if pose is None else pose.cam2_from_cam1,
        covariance=None if pose is None else pose.covariance,
        stood_still=choice.config is Configuration.DEGENERATE,
        table=choice.table,
        support_by_chance=inliers.by_chance,
    )


def in_order(geometry: TwoViewGeometry, matches: SmearMatches, camera: Camera | None) -> TwoViewGeometry:
    """Return the geometry with the order of the ends; H, and F beside a rotation alone, run the same way."""
    F, H, pose = geometry.F, geometry.H, geometry.cam2_from_cam1
    if F is None and H is None:
        return geometry
    size = matches.image_size or tuple(np.ptp(matches.ends, axis=(0, 1)).astype(int) + 1)
    order = end_order(geometry, matches.ends, matches.sampson_px, camera, size)
    second = order.second_end_is_open(matches.ends, matches.sampson_px)
    fits = geometry.inlier_mask
    first, last = open_and_close(order.camera.undistorted(matches.ends[fits]), second[fits])
    if H is not None and _runs_back(transfer(H, first, last), transfer(H, last, first)):
        H = unit_norm(np.asarray(np.linalg.inv(H), float))
    rotates = pose is not None and not pose.translation.any()
    if F is not None and rotates and _runs_back(sampson(F, first, last), sampson(F, last, first)):
        F = F.T.copy()
    return replace(geometry, F=F, H=H, second_end_is_open=second)


def _runs_back(ahead: Array, behind: Array) -> bool:
    """Return whether most errors (N,) are less in the opposite order."""
    return len(ahead) > 0 and float((behind < ahead).mean()) > 0.5


def undistorted(matches: SmearMatches, camera: Camera) -> SmearMatches:
    """Return the matches as the camera's undistorted picture shows them; a smear without rays stays as it is.

    Raises
    ------
    ValueError
        If the camera is for pictures of another size; see `Camera.for_image`.
    """
    if matches.image_size not in (None, (camera.width, camera.height)):
        raise ValueError(f"camera is for {camera.width}x{camera.height}, matches for {matches.image_size}")

    straight = camera.undistorted(matches.ends)
    seen = np.isfinite(straight).all(axis=(1, 2), keepdims=True)
    return replace(matches, ends=np.where(seen, straight, matches.ends))
