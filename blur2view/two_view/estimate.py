"""Policy: from unordered smears to the two-view geometry that is reported, or why there is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import require
from blur2view.camera.camera import Camera
from blur2view.geometry.epipolar import transfer, unit_norm
from blur2view.geometry.rolling_shutter import LEAST, RollingShutter, shortened
from blur2view.geometry.sampson import swapped_order
from blur2view.geometry.two_view_geometry import Configuration, Parallax, TwoViewGeometry
from blur2view.smears.blur import Blur, BlurKind
from blur2view.smears.matches import SmearMatches
from blur2view.two_view.choice import Choice, choose
from blur2view.two_view.consensus import inliers_of, insufficient_data, still
from blur2view.two_view.constants import MIN_AGREEMENT
from blur2view.two_view.fit_fundamental import Fit
from blur2view.two_view.homography import pixel_homography
from blur2view.two_view.likelihood import Likelihood
from blur2view.two_view.options import EstimatorOptions
from blur2view.two_view.pose import with_pose
from blur2view.two_view.search import search_and_fit

AROUND = 16  # smears that decide the order of one in time: a geometry without parallax leaves some open
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
        there = to_global_shutter(matches, flip.swapped, shutter, (camera.width, camera.height))
        if there is not None:
            other = as_recorded(there, options, rng, camera)
            flips.append(other if (other.swapped == flip.swapped).mean() >= 0.5 else other.reversed())
    if len(flips) == 1:
        reason = f"{flips[0].reason}; in the other order in time the rows leave no such smears"
        return replace(flips[0], reason=reason)
    first, second = sorted(flips, key=lambda f: (f.cam2_from_cam1 is None, LESS_PARALLAX.index(f.parallax)))
    return replace(first, backward=second)


def without_motion(matches: SmearMatches, blur: Blur) -> TwoViewGeometry:
    """Return the geometry of a photograph whose camera did not move, or does not show whether it did."""
    return no_geometry(
        matches,
        f"no motion of the camera: {blur.reason}",
        insufficient_data=blur.kind in (BlurKind.OUT_OF_FOCUS, BlurKind.CANNOT_TELL),
    )


def no_geometry(matches: SmearMatches, reason: str, *, insufficient_data: bool) -> TwoViewGeometry:
    """Return a degenerate geometry."""
    return TwoViewGeometry(
        F=None,
        config=Configuration.DEGENERATE,
        reason=reason,
        inlier_mask=np.zeros(len(matches), bool),
        swapped=np.zeros(len(matches), bool),
        insufficient_data=insufficient_data,
    )


def to_global_shutter(
    matches: SmearMatches, swapped: NDArray[np.bool_], shutter: RollingShutter, image_size: tuple[int, int]
) -> SmearMatches | None:
    """Return the matches as an exposure of all rows at once leaves them, if ends[:, 1] is open where swapped.

    None where no motion leaves them in this order in time. Every smear is ordered as those around it.
    """
    from scipy.spatial import cKDTree  # 0.1 s, so only for a rolling shutter

    directed = np.where(swapped, -1.0, 1.0)[:, None] * matches.displacement
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
    nothing_moved = still(matches)
    refusal = nothing_moved or insufficient_data(matches)
    if refusal is not None:
        return no_geometry(matches, refusal, insufficient_data=nothing_moved is None)
    if camera is not None:
        matches = undistorted(matches, camera)
    likelihood, fits, iterations = search_and_fit(Likelihood.of(matches, camera), options, rng)
    best = min(fits, key=lambda fit: fit.score)
    found = inliers_of(likelihood.pixels(best.point.matrix()), likelihood, options)
    has_consensus = found.beyond_chance >= MIN_AGREEMENT
    choice = choose(likelihood, best, rng, has_consensus=has_consensus, rolling=rolling)
    geometry = geometry_of(choice, likelihood, fits, options)
    geometry = replace(geometry, reason=f"{geometry.reason}: {found.figures}", iterations=iterations)
    if likelihood.intrinsics_known:
        field = None if choice.homography is None else choice.homography.family
        geometry = with_pose(geometry, field, likelihood, fits, options)
    return in_one_order(geometry, matches)


def in_one_order(geometry: TwoViewGeometry, matches: SmearMatches) -> TwoViewGeometry:
    """Return a geometry whose H maps the open ends, as F or the pose orders them, to the closed ones."""
    if geometry.H is None or not geometry.inlier_mask.any():
        return geometry
    ends = matches.ends[geometry.inlier_mask]
    first = np.where(geometry.swapped[geometry.inlier_mask, None], ends[:, 1], ends[:, 0])
    last = ends.sum(axis=1) - first
    if (transfer(geometry.H, first, last) <= transfer(geometry.H, last, first)).mean() >= 0.5:
        return geometry
    return replace(geometry, H=unit_norm(np.asarray(np.linalg.inv(geometry.H), float)))


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


def geometry_of(
    choice: Choice, likelihood: Likelihood, fits: list[Fit], options: EstimatorOptions
) -> TwoViewGeometry:
    """Return the geometry of a choice, with its inliers and their orders."""
    costs = {fit.model: fit.score for fit in [*fits, choice.fit]}
    homography, nothing = choice.homography, np.zeros(len(likelihood), bool)
    geometry = TwoViewGeometry(
        F=likelihood.pixels(choice.fit.point.matrix()) if choice.reports_F else None,
        H=None if homography is None else pixel_homography(homography.family.generator(), likelihood.T),
        config=choice.config,
        reason=choice.sentence,
        inlier_mask=nothing,
        swapped=nothing,
        model=choice.model,
        scores=tuple(sorted(costs.items(), key=lambda score: score[1])),
        table=choice.table,
    )
    if geometry.F is not None:
        found = inliers_of(geometry.F, likelihood, options)
        swapped = swapped_order(geometry.F, likelihood.matches.ends)
    elif homography is not None:
        found = inliers_of(homography, likelihood, options)
        swapped = homography.orders(likelihood).swapped
    else:
        return geometry
    return replace(geometry, inlier_mask=found.mask, support_by_chance=found.by_chance, swapped=swapped)
