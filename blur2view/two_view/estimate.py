"""From unordered smears to the two-view geometry, or the reason why no F is reported."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, Array, require
from blur2view.camera import Camera
from blur2view.geometry.configuration import Cause, Configuration, Parallax, Refusal, Support
from blur2view.geometry.epipolar import denormalise, serrmin, unit_norm
from blur2view.geometry.rolling_shutter import RollingShutter
from blur2view.geometry.two_view_geometry import TwoViewGeometry
from blur2view.smears.blur import Blur, BlurKind
from blur2view.smears.camera_motion import MIN_MEDIAN_PX, too_short
from blur2view.smears.matches import SmearMatches
from blur2view.smears.noise import SAMPSON_SHARE
from blur2view.two_view import constants as c
from blur2view.two_view.choice import choose
from blur2view.two_view.fundamental import search_and_fit
from blur2view.two_view.homography import HomographyFit
from blur2view.two_view.likelihood import NormalisedSmears
from blur2view.two_view.models import cayley
from blur2view.two_view.order import in_order
from blur2view.two_view.pose import estimate_pose

# Times that the smears are put in order, corrected for the rows and estimated again; the estimate with most
# inliers is kept. Of ten draws of the noise of `test_rolling_shutter`, 45 ms, seeds 0 to 9, three end in
# another minimum after two or three rounds, one after four to six.
ROUNDS = 4
GOLDEN = 0.5 * (5**0.5 - 1)  # of half a circle, from the direction of one smear to that of the next
MAX_PX = 1e6  # more than the side of any photograph; bound


@dataclass(frozen=True, kw_only=True)
class EstimatorOptions:
    """Which smears are inliers: those whose Sampson distance is below `tolerance_px`.

    ``max_error_px`` is the largest tolerance, pixels; by default its square is the paper's 3. ValueError if
    it is not positive or larger than any photograph.
    """

    max_error_px: float = 3**0.5

    def __post_init__(self) -> None:
        if not 0 < self.max_error_px <= MAX_PX:
            raise ValueError(f"max_error_px must be positive, at most {MAX_PX:g}, got {self.max_error_px}")

    def tolerance_px(self, length_px: Array, sigma_px: Array) -> Array:
        """Return the Sampson distances (N,), pixels, below which smears are inliers.

        A tenth of the smear's length, at most ``max_error_px``, at least two of its standard deviations. A
        limit in pixels alone would be as large as short smears are, and any F would fit them.
        """
        by_length = np.minimum(c.INLIER_SHARE * length_px, self.max_error_px)
        return np.maximum(by_length, c.INLIER_SIGMAS * sigma_px)


def estimate_two_view(
    matches: SmearMatches,
    options: EstimatorOptions | None = None,
    rng: np.random.Generator | int | None = None,
    camera: Camera | None = None,
    shutter: RollingShutter | None = None,
    *,
    moved: bool = False,
) -> TwoViewGeometry:
    """Return the two-view geometry of unordered smears, or the reason why there is no F.

    Parameters
    ----------
    matches : SmearMatches
        The smears: of `select_matches`, or ``SmearMatches.from_points`` of matches from elsewhere.
    options : EstimatorOptions, optional
        Which smears are inliers.
    rng : numpy.random.Generator or int, optional
        Source of randomness or its seed, 0 by default, so that a call repeats exactly.
    camera : Camera, optional
        With it F and H are those of its undistorted pixels; with known intrinsics E and the pose are added.
    shutter : RollingShutter, optional
        The camera's. The geometry is then the one that a global shutter would have seen. It differs between
        the two orders in time: the one with less parallax is returned, the other is its ``reversed()``.
    moved : bool
        Whether the camera is known to have moved; the model "no motion" is then left out.

    Returns
    -------
    TwoViewGeometry
        UNCALIBRATED with F, or CALIBRATED with F, E and the pose if the intrinsics are known; PANORAMIC
        (rotation) or PLANAR with H, and with F beside it where parallax is undecided; PLANAR_OR_PANORAMIC
        with the same, where "no motion" is the likeliest model at a probability of at most one half;
        DEGENERATE (too few, too short or collinear smears, a still camera) or UNDEFINED (the best F explains
        hardly more smears than chance) with neither.

    Raises
    ------
    ValueError
        If the camera is for pictures of another size, or a shutter is given without known intrinsics.

    References
    ----------
    Tran, Forssen and Viksten, Robust fundamental matrix estimation from single image motion blur.
    Hartley and Zisserman, Multiple view geometry in computer vision, 2003, chapter 11.

    Examples
    --------
    Smears of a camera that goes forward meet in the epipole; which end of each came first is not known.

    >>> import numpy as np
    >>> from blur2view import SmearMatches, estimate_two_view
    >>> rng = np.random.default_rng(0)
    >>> points = rng.uniform(-1, 1, (500, 3)) * [3, 2, 2] + [0, 0, 6]
    >>> first, last = (400 * points[:, :2] / (points[:, 2:] - z) + [320, 240] for z in (0, 0.3))
    >>> geometry = estimate_two_view(SmearMatches.from_points(first, last, image_size=(640, 480)))
    >>> print(geometry.parallax)
    proven
    >>> epipole = np.linalg.svd(geometry.F)[2][-1]
    >>> np.round(epipole[:2] / epipole[2]).tolist()
    [320.0, 240.0]
    """
    require("matches", matches, SmearMatches, "as of select_matches(network.predict(image))")
    if shutter is not None and (camera is None or not camera.known):
        raise ValueError("a rolling shutter changes the pose, which needs known intrinsics: give a camera")
    options = options or EstimatorOptions()
    require("options", options, EstimatorOptions, "as EstimatorOptions(max_error_px=2)")
    rng = np.random.default_rng(0 if rng is None else rng)
    geometry = as_recorded(matches, options, rng, camera, rolling=shutter is None, moved=moved)
    without_orders = geometry.F is None and geometry.H is None
    if shutter is None or camera is None or not shutter.readout_s or without_orders:
        return geometry
    orders = geometry, geometry.reversed()
    estimates = [estimate_global_shutter(matches, options, rng, camera, shutter, order) for order in orders]
    by_parallax = [Parallax.ABSENT, Parallax.UNDECIDED, Parallax.PROVEN].index
    likelier = sorted(
        (geometry for geometry in estimates if geometry is not None),
        key=lambda order: (order.cam2_from_cam1 is None, by_parallax(order.parallax), order.E is not None),
    )
    if len(likelier) == 1:
        return replace(likelier[0], one_way=True)
    return replace(likelier[0], backward=likelier[1])


def estimate_global_shutter(
    matches: SmearMatches,
    options: EstimatorOptions,
    rng: np.random.Generator,
    camera: Camera,
    shutter: RollingShutter,
    recorded: TwoViewGeometry,
) -> TwoViewGeometry | None:
    """Return the geometry that a global shutter would have seen; None where no smears would leave these rows.

    The smears begin with the orders of ``recorded``, the geometry estimated as if all rows were exposed at
    once; of both orders in time the result has that which agrees with most of them.
    """
    rounds, second = [], recorded.second_end_is_open
    for _ in range(ROUNDS):
        exposed_at_once = shutter.all_rows_at_once(matches, second, (camera.width, camera.height))
        if exposed_at_once is None:
            break
        geometry = as_recorded(exposed_at_once, options, rng, camera)
        agrees = (geometry.second_end_is_open == recorded.second_end_is_open).mean() >= 0.5
        rounds.append(geometry if agrees else geometry.reversed())
        second = rounds[-1].second_end_is_open
    return max(reversed(rounds), key=lambda geometry: int(geometry.inlier_mask.sum()), default=None)


def without_motion(matches: SmearMatches, blur: Blur) -> TwoViewGeometry:
    """Return the degenerate geometry of a photograph whose camera did not move, or that shows no motion."""
    causes = {BlurKind.OUT_OF_FOCUS: Cause.NO_BLUR_SEEN, BlurKind.CANNOT_TELL: Cause.UNCLEAR}
    return degenerate_geometry(
        matches, Refusal(cause=causes.get(blur.kind, Cause.CAMERA_AT_REST), blur=blur.reason)
    )


def without_fit(matches: SmearMatches) -> TwoViewGeometry:
    """Return the degenerate geometry of a camera that moved but whose motion is not asked for.

    It says whether the camera stood still, as `estimate_two_view` does where the camera is known to move.
    """
    return degenerate_geometry(matches, find_refusal(matches) or Refusal(cause=Cause.NOT_ASKED_FOR))


def as_recorded(
    matches: SmearMatches,
    options: EstimatorOptions,
    rng: np.random.Generator,
    camera: Camera | None,
    *,
    rolling: bool = False,
    moved: bool = False,
) -> TwoViewGeometry:
    """Return the two-view geometry of smears; with ``rolling`` models of a rolling shutter are added."""
    if (refusal := find_refusal(matches)) is not None:
        return degenerate_geometry(matches, refusal)
    straight = matches if camera is None else undistorted(matches, camera)
    smears, fit, search = search_and_fit(NormalisedSmears.of(straight, camera), rng)
    F = denormalise(fit.point.matrix(), smears.T)
    inliers, by_chance = inliers_and_chance(F, smears, options)
    support = Support(num_inliers=int(inliers.sum()), count=len(inliers), by_chance=by_chance)
    choice = choose(smears, fit, agreement=support.agreement, rolling=rolling, moved=moved)
    field, pose = choice.homography, None
    if smears.lens_sigma == (0.0, 0.0) and (choice.reports_F or field is not None):
        pose = estimate_pose(smears, fit, choice)
        F = F if pose.E is None else denormalise(pose.E, smears.T)
    model = F if choice.reports_F else field
    inliers, by_chance = np.zeros(len(smears), bool), 0.0
    if model is not None:
        inliers, by_chance = inliers_and_chance(model, smears, options)
    H = None
    if field is not None:
        mapped = cayley(field.family.generator()) @ smears.T
        H = unit_norm(np.asarray(np.linalg.solve(smears.T, mapped), float))
    proven = choice.config is Configuration.UNCALIBRATED
    geometry = TwoViewGeometry(
        F=F if choice.reports_F else None,
        H=H,
        config=Configuration.CALIBRATED if proven and pose is not None else choice.config,
        inlier_mask=inliers,
        second_end_is_open=np.zeros(len(smears), bool),
        cam2_from_cam1=None if pose is None else pose.cam2_from_cam1,
        covariance=None if pose is None else pose.covariance,
        refusal=choice.refusal,
        support=support,
        few_follow_F=choice.few_follow_F,
        models=choice.models,
        independent_smears=smears.effective_count,
        support_by_chance=by_chance,
        num_trials=search.iterations,
        inlier_ratio=search.inlier_ratio,
    )
    return in_order(geometry, matches, camera)


def undistorted(matches: SmearMatches, camera: Camera) -> SmearMatches:
    """Return the matches in undistorted pixels of the camera; ends without a ray keep their smear as it is.

    ValueError if the camera is for pictures of another size; see `Camera.for_image`.
    """
    if matches.image_size not in (None, (camera.width, camera.height)):
        raise ValueError(f"camera is for {camera.width}x{camera.height}, matches for {matches.image_size}")
    straight = camera.undistorted(matches.ends)
    has_rays = np.isfinite(straight).all(axis=(1, 2), keepdims=True)
    return replace(matches, ends=np.where(has_rays, straight, matches.ends))


def degenerate_geometry(matches: SmearMatches, refusal: Refusal) -> TwoViewGeometry:
    """Return a DEGENERATE geometry: neither F nor H, and no smear is an inlier."""
    none = np.zeros(len(matches), bool)
    return TwoViewGeometry(
        F=None, config=Configuration.DEGENERATE, inlier_mask=none, second_end_is_open=none, refusal=refusal
    )


def find_refusal(matches: SmearMatches) -> Refusal | None:
    """Return why smears are too few, too short or collinear; None of any others."""
    if len(matches) < c.MIN_SMEARS:
        return Refusal(cause=Cause.FEW_SMEARS, value=len(matches), limit=c.MIN_SMEARS)
    if too_short(matches):
        median = float(np.median(matches.length_px))
        return Refusal(cause=Cause.SHORT_SMEARS, value=median, limit=MIN_MEDIAN_PX)
    share = coverage(matches)
    if share < c.MIN_COVERAGE:
        return Refusal(cause=Cause.SMALL_PART, value=share, limit=c.MIN_COVERAGE)
    short, long = np.linalg.svd(matches.midpoint - matches.midpoint.mean(axis=0), compute_uv=False)[::-1]
    if short <= c.MIN_WIDTH * long:  # midpoints on one line determine neither F nor H
        return Refusal(cause=Cause.ONE_LINE, value=float(short / max(long, TINY)), limit=c.MIN_WIDTH)
    return None


def coverage(matches: SmearMatches) -> float:
    """Return the share of the image's square blocks that hold midpoints; 1 without an image size."""
    if matches.image_size is None:
        return 1.0
    block_px = max(matches.image_size) / c.BLOCKS
    blocks = np.ceil(np.array(matches.image_size) / block_px).prod()
    return float(len(np.unique(np.floor(matches.midpoint / block_px), axis=0)) / blocks)


def inliers_and_chance(
    model: Array | HomographyFit, smears: NormalisedSmears, options: EstimatorOptions
) -> tuple[NDArray[np.bool_], float]:
    """Return the inliers (N,) of F (3, 3) in pixels or of a displacement field, and the share by chance.

    Inliers are nearer than `EstimatorOptions.tolerance_px`; the share by chance is that of the same smears
    turned to evenly spread directions.
    """
    is_field = isinstance(model, HomographyFit)
    sigma_px = SAMPSON_SHARE * np.hypot(*smears.field_sigmas_px) if is_field else smears.sigma_px
    tolerance = options.tolerance_px(smears.matches.length_px, sigma_px)

    def fitting(smears: NormalisedSmears) -> NDArray[np.bool_]:
        if isinstance(model, HomographyFit):
            return model.distances_px(smears) < tolerance
        return np.asarray(np.sqrt(serrmin(model, smears.matches.ends)) < tolerance)

    scattered = replace(smears, matches=in_spread_directions(smears.matches))
    return fitting(smears), float(fitting(scattered).mean())


def in_spread_directions(matches: SmearMatches) -> SmearMatches:
    """Return the matches turned about their midpoints to directions spread evenly by the golden ratio.

    Which of them fit a model, fit by chance.
    """
    angle = np.pi * (GOLDEN * np.arange(len(matches)) % 1.0)
    half = 0.5 * matches.length_px[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return replace(matches, ends=np.stack([matches.midpoint - half, matches.midpoint + half], axis=1))
