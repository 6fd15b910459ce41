"""What a geometry means, in the same words in the terminal, in pictures, in the report and in tables."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from blur2view.arrays import TINY
from blur2view.geometry.two_view_geometry import Configuration, Parallax, TwoViewGeometry
from blur2view.smears.blur import Blur, BlurKind
from blur2view.smears.matches import SmearMatches
from blur2view.two_view.consensus import constant_field
from blur2view.two_view.constants import MIN_LENGTH_PX

if TYPE_CHECKING:
    from blur2view.pipeline import FileEstimate

# Configuration -> kind of verdict: its colour, and its place in the order.
KINDS = {
    Configuration.CALIBRATED: "proven",
    Configuration.UNCALIBRATED: "proven",
    Configuration.MULTIPLE: "undecided",
    Configuration.PLANAR_OR_PANORAMIC: "flat",
    Configuration.PLANAR: "flat",
    Configuration.PANORAMIC: "flat",
    Configuration.DEGENERATE: "none",
    Configuration.UNDEFINED: "none",
}
VERDICT_ORDER = [config.name for config in KINDS]
COMMON_DIRECTION = 0.5  # least length of the smears' mean, in double angle, over their mean length
MAY_HAVE_TURNED = 0.1  # probability of a rotation from which on it is named beside the movement
DIAGONAL = 0.5  # of a direction, its smaller part over its larger one


def kind(geometry: TwoViewGeometry) -> str:
    """Return the kind of a verdict: proven, undecided, flat or none."""
    beside_H = KINDS[geometry.config] == "flat" and geometry.parallax is Parallax.UNDECIDED
    return "undecided" if beside_H else KINDS[geometry.config]


def verdict_of(one: FileEstimate) -> str:
    """Return the `verdict` of a photograph; how fast it turned, if --exposure says how long."""
    estimate = one.estimate
    return verdict(estimate.blur, estimate.geometry, estimate.matches, estimate.grid.size, one.run.exposure_s)


def verdict(
    blur: Blur,
    geometry: TwoViewGeometry,
    matches: SmearMatches,
    size: tuple[int, int],
    exposure_s: float | None = None,
) -> str:
    """Return the one sentence that matters: what blurred the photograph, and what the camera did."""
    match blur.kind:
        case BlurKind.SHARP:
            return "Sharp"
        case BlurKind.OUT_OF_FOCUS:
            return f"Out of focus ({_radius(blur)})"
        case BlurKind.CAMERA_AT_REST:
            return f"Camera at rest, something moves ({blur.moving_share:.0%} of the picture)"
        case BlurKind.CANNOT_TELL:
            return f"{blur.nothing_seen.capitalize() or 'Smooth'}: cannot tell"
        case BlurKind.OUT_OF_FOCUS_AND_MOVED:
            return f"{_motion(geometry, matches, size, exposure_s)}; out of focus, too ({_radius(blur)})"
        case _:
            return _motion(geometry, matches, size, exposure_s)


def _radius(blur: Blur) -> str:
    return f"radius {blur.defocus_px or 0.0:.1f} px"


def _motion(
    geometry: TwoViewGeometry, matches: SmearMatches, size: tuple[int, int], exposure_s: float | None
) -> str:
    """Return what a camera that moved did, or why that cannot be told.

    ``size`` is width and height of the photograph: without intrinsics a rotation is given as a share of the
    width. With an exposure time a rotation is given as an angular velocity.
    """
    config, undecided = geometry.config, geometry.parallax is Parallax.UNDECIDED
    posed, (length, way) = geometry.cam2_from_cam1 is not None, _blur(geometry, matches, size[0])
    match config:
        case Configuration.DEGENERATE | Configuration.UNDEFINED:
            return _nothing(geometry, matches)
        case Configuration.MULTIPLE:
            return "Several motions: parts of the picture move differently"
        case Configuration.PANORAMIC:
            return f"Camera {_turned(geometry, size, exposure_s)}{', parallax undecided' * undecided}"
        case Configuration.PLANAR_OR_PANORAMIC:
            by = _amount(geometry, exposure_s) if posed else f"by {length}"
            return f"Turned {by} or moved past something flat: cannot tell"
    if posed:
        turned = f"turned {_amount(geometry, exposure_s)}"
        depth = ", parallax undecided" * (config is Configuration.PLANAR and undecided)
        return f"Camera moved {_direction(geometry)}, {turned}{depth}"
    if config is Configuration.PLANAR:
        moved = f"Camera moved{', parallax undecided' if undecided else ' past something flat'}"
        if (geometry.rotation_probability or 0.0) > MAY_HAVE_TURNED:
            moved = "Camera moved or turned, parallax undecided"
        return f"{moved}; blur {length}{way}"
    return f"Camera moved past near and far things; blur {length}{way}"


def _blur(geometry: TwoViewGeometry, matches: SmearMatches, width_px: int) -> tuple[str, str]:
    """Return the smears that fit as a share of the picture's width, and which way they run, empty if many."""
    d = matches.displacement[geometry.inlier_mask] if geometry.inlier_mask.any() else np.zeros((1, 2))
    lengths = np.hypot(*d.T)
    doubled = ((d[:, 0] + 1j * d[:, 1]) ** 2 / np.maximum(lengths, TINY)).mean()  # d and -d are one
    way = _way(*(np.sqrt(doubled).real, np.sqrt(doubled).imag))
    common = abs(doubled) > COMMON_DIRECTION * lengths.mean()
    return _share(np.median(lengths), width_px), f", {way}" * bool(common)


def _nothing(geometry: TwoViewGeometry, matches: SmearMatches) -> str:
    if geometry.config is Configuration.UNDEFINED:
        return "Blur that no one motion explains: cannot tell"
    if geometry.insufficient_data:
        return "Too few places show blur: cannot tell"
    if len(matches) and np.median(matches.length_px) >= MIN_LENGTH_PX and constant_field(matches):
        return "Turned or moved, the same blur everywhere: cannot tell"
    return "Too little blur to tell"


def _turned(geometry: TwoViewGeometry, size: tuple[int, int], exposure_s: float | None) -> str:
    """Return which way a camera turned, and how much or how fast.

    It rolled where that moves a corner of the picture by more than pan and tilt move its middle.
    """
    to_middle = np.eye(3)
    to_middle[:2, 2] = (1 - np.array(size)) / 2
    centred = to_middle @ (np.eye(3) if geometry.H is None else geometry.H) @ np.linalg.inv(to_middle)
    centred = centred / centred[2, 2]
    (a, b), (c, d) = centred[:2, :2]
    pan, roll = centred[:2, 2], abs(float(np.arctan2(c - b, a + d)))
    rolled = roll * np.hypot(*size) / 2 > np.hypot(*pan)
    way = "rolled" if rolled else f"turned {_way(*pan)}"
    if geometry.cam2_from_cam1 is not None:
        return f"{way} {_amount(geometry, exposure_s)}"
    by = f"{np.degrees(roll):.2g} degrees" if rolled else _share(np.hypot(*pan), size[0])
    return f"{way} by {by}"


def _amount(geometry: TwoViewGeometry, exposure_s: float | None) -> str:
    """Return by how much, or how fast, a pose turns, with its standard deviation: that along its axis."""
    pose, covariance = geometry.cam2_from_cam1, geometry.covariance
    vector = np.zeros(3) if pose is None else pose.rotation_vector
    angle, sigma = float(np.linalg.norm(vector)), 0.0
    if covariance is not None:
        axis = vector / max(angle, TINY)
        sigma = float(np.sqrt(max(float(axis @ covariance.matrix[:3, :3] @ axis), 0.0)))
    if exposure_s is None:
        return f"by {_with_deviation(np.degrees(angle), np.degrees(sigma))} degrees"
    return f"at {_with_deviation(angle / exposure_s, sigma / exposure_s)} rad/s"


def _direction(geometry: TwoViewGeometry) -> str:
    pose, covariance = geometry.cam2_from_cam1, geometry.covariance
    if pose is None or not pose.translation.any():
        return "(direction unknown)"
    sigma = "" if covariance is None else f" (+/- {covariance.translation_sigma_deg:.0f} degrees)"
    x, y, z = pose.translation
    way = "forward or back" if abs(z) > np.hypot(x, y) else _way(x, y)  # time has no arrow
    return f"{way}{sigma}"


def _way(x: float, y: float) -> str:
    short, long = sorted((abs(x), abs(y)))
    if short > DIAGONAL * long:
        return "diagonally"
    return "sideways" if abs(x) > abs(y) else "up or down"


def _share(length_px: float, width_px: int) -> str:
    return f"{100 * length_px / width_px:.2g} % of the width"


def _with_deviation(value: float, sigma: float) -> str:
    """Return a value with its standard deviation, both with the decimals that the latter admits."""
    digits = int(np.clip(-np.floor(np.log10(max(sigma, 1e-3))), 1, 3))
    return f"{value:.{digits}f} +/- {sigma:.{digits}f}"
