"""What a record means: in one sentence, and what the photograph is of use for; the same everywhere."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

from blur2view.results.record import Record

STILL = ("sharp", "out of focus", "camera at rest")
"""Kinds of blur of a camera that did not move."""
MAY_HAVE_TURNED = 0.1
"""Probability of a rotation from which on it is named beside the movement."""
MAX_DEFOCUS_PX = 2.0
"""Radius above which it is named: `smears.blur.DEFOCUSED_PX`, which takes too long to import for a help."""
MAX_SMEAR_PX = 3.0
"""Longest smear of a photograph that is called sharp: up to this, half of the SIFT features that it shares
with itself under fresh noise are still matched (``python -m tools.evaluation.triage``; chosen on the
photographs of Kodak's suite that train networks, shown on the others)."""
DIAGONAL = 0.5
"""Of a direction, its smaller part over its larger one."""


class Use(StrEnum):
    """What a photograph is of use for."""

    SHARP = "sharp"
    BLURRED = "blurred"
    """Blurred, and geometry explains it, so that the views of its exposure are of use."""
    UNUSABLE = "unusable"
    """Blurred, and nothing explains it."""
    OUT_OF_FOCUS = "out of focus"
    UNCLEAR = "unclear"
    """Too smooth or too dark to show blur."""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Up to where a photograph is called sharp.

    Parameters
    ----------
    max_smear_px : float
        Longest smear.
    max_defocus_px : float
        Largest radius out of focus.
    """

    max_smear_px: float = MAX_SMEAR_PX
    max_defocus_px: float = MAX_DEFOCUS_PX


def use_of(one: Record, limits: Limits) -> tuple[str, str]:
    """Return the use of a photograph, and why; both are empty if it failed.

    The kind of blur decides first: only where the camera moved the length of the smear is compared with the
    limit.
    """
    if one.error:
        return "", ""
    length, radius = one.smear_px, one.defocus_px or 0.0
    if one.blur == "cannot tell" or length is None:
        return Use.UNCLEAR, f"{one.nothing_seen or 'smooth or too dark'}: its blur is unknown"
    still = one.blur in STILL
    short = still or length <= limits.max_smear_px
    soft = radius > limits.max_defocus_px
    why = f"smear {length:.3g} px, {'at most' if short else 'above'} {limits.max_smear_px:g} px"
    why = f"{one.blur}: no motion of the camera" if still else why
    about_focus = f"radius out of focus {radius:.1f} px" + f", above {limits.max_defocus_px:g} px" * soft
    if short and (one.blur == "out of focus" or soft):
        return Use.OUT_OF_FOCUS, about_focus
    if short:
        return Use.SHARP, why
    why += f"; {about_focus}" * soft
    if not one.has_geometry:
        return Use.UNUSABLE, f"{why}; no one motion of the camera explains it"
    return Use.BLURRED, f"{why}; the camera's motion explains it, so that its views are of use"


def verdict(one: Record) -> str:
    """Return the sentence that matters: why there is no result, what blurred the photograph, what moved."""
    match one.blur:
        case "":
            return one.error
        case "sharp":
            return "Sharp"
        case "out of focus":
            return f"Out of focus ({_radius(one)})"
        case "camera at rest":
            soft = f"; out of focus ({_radius(one)})" * ((one.defocus_px or 0.0) > MAX_DEFOCUS_PX)
            return f"The camera stood still; {_moving(one)}{soft}"
        case "cannot tell":
            return f"{one.nothing_seen.capitalize() or 'Smooth'}: cannot tell"
        case "out of focus and moved":
            return f"{_motion(one)}; out of focus, too ({_radius(one)}){_beside(one)}"
    return _motion(one) + _beside(one)


def use_line(one: Record) -> str:
    """Return what a photograph is of use for, and how long its blur is."""
    if one.use == Use.UNCLEAR:
        return f"{one.use} (no texture)"
    if one.use == Use.OUT_OF_FOCUS:
        return f"{one.use} ({_radius(one)})"
    if one.use == Use.SHARP and one.blur in STILL:
        return f"{one.use} (no motion of the camera)"
    length = one.smear_px or 0.0
    return f"{one.use} (smears of {length:.{1 if length < 10 else 0}f} px)"


def fit_line(one: Record) -> str:
    """Return how many smears fit; the camera if it was scaled."""
    count = one.num_matches or 0
    if one.F is None and one.H is None:
        return f"{count} smears used"
    fit = f"{one.num_inliers} of {count} smears fit"
    share = 100 * (one.num_inliers or 0) // max(count, 1)  # rounded down: not all are 100%
    by_chance = f"{share}%, {100 * (one.support_by_chance or 0.0):.0f}% would by chance"
    # beside H a share of F would read as certainty
    both = one.F is not None and one.H is not None
    parts = [f"{fit} F, and a homography explains them as well" if both else f"{fit} ({by_chance})"]
    if one.camera is not None and "scaled" in one.camera["source"]:
        parts.append(one.camera["source"])
    return "; ".join(parts)


def length_text(one: Record) -> str:
    """Return the length of the photograph's smear in pixels and as a share of the width."""
    if one.smear_px is None:
        return "no smears"
    return f"smears of {rounded(one.smear_px)} px, {rounded(one.smear_percent or 0.0)} % of the width"


def rounded(value: float) -> str:
    """Return a number with two significant digits, without an exponent."""
    decimals = max(1 - math.floor(math.log10(max(abs(value), 1e-3))), 0)
    return f"{value:.{decimals}f}"


def _radius(one: Record) -> str:
    return f"radius {one.defocus_px or 0.0:.1f} px"


def _moving(one: Record) -> str:
    return f"{round(100 * (one.moving_share or 0.0)) or 'less than 1'} % of the picture moves by itself"


def _beside(one: Record) -> str:
    """Return what moves before a camera that moved, too, where that was asked."""
    return f"; {_moving(one)}" * bool(one.moving_share)


def _motion(one: Record) -> str:
    """Return what a camera that moved did, as far as the smears show it."""
    undecided = ", parallax undecided" * (one.parallax == "undecided")
    posed = one.cam2_from_cam1 is not None
    if not one.config:  # of triage
        return f"Camera moved; {length_text(one)}"
    by = f" {_turned_by(one)}" if posed else f"; {length_text(one)}"
    match one.config:
        case "UNDEFINED":
            return f"Camera moved, and no one motion explains the blur; {length_text(one)}"
        case "PANORAMIC":
            return f"Camera {_turned(one)}{by if posed else ''}{undecided}{'' if posed else by}"
        case "PLANAR_OR_PANORAMIC":
            return f"Camera turned{by if posed else ''} or moved past something flat{'' if posed else by}"
        case "DEGENERATE" if one.parallax == "undecided":
            return f"Camera moved, and too little of the picture shows how; {length_text(one)}"
        case "DEGENERATE":
            return f"Camera turned or moved, with the same blur everywhere; {length_text(one)}"
    if posed:
        return f"Camera moved {_towards(one)}, turned{by}{undecided * (one.config == 'PLANAR')}"
    if one.config == "PLANAR":
        may_turn = (one.rotation_probability or 0.0) > MAY_HAVE_TURNED and undecided
        flat = "" if undecided else " past something flat"
        return f"Camera moved{' or turned' if may_turn else flat}{undecided}{by}"
    return f"Camera moved past near and far things{by}"


def _turned(one: Record) -> str:
    """Return which way a camera turned.

    It rolled where that moves a corner of the picture by more than pan and tilt move its middle.
    """
    import numpy as np

    if one.H is None or one.width is None or one.height is None:
        return "turned"
    to_middle = np.eye(3)
    to_middle[:2, 2] = (1 - one.width) / 2, (1 - one.height) / 2
    centred = to_middle @ np.array(one.H) @ np.linalg.inv(to_middle)
    centred /= centred[2, 2]
    (a, b), (c, d) = centred[:2, :2]
    pan, roll = centred[:2, 2], abs(math.atan2(c - b, a + d))
    if roll * math.hypot(one.width, one.height) / 2 > math.hypot(*pan):
        return "rolled"
    return f"turned {_way(*pan)}"


def _turned_by(one: Record) -> str:
    """Return by how much, or how fast, a pose turns, with its standard deviation: that along its axis."""
    rate = [one.wx or 0.0, one.wy or 0.0, one.wz or 0.0]
    sigmas = [one.sigma_wx or 0.0, one.sigma_wy or 0.0, one.sigma_wz or 0.0]
    angle = math.hypot(*rate)
    sigma = math.sqrt(sum((r / max(angle, 1e-30) * s) ** 2 for r, s in zip(rate, sigmas, strict=True)))
    if one.rate_unit == "rad":
        return f"by {_with_deviation(math.degrees(angle), math.degrees(sigma))} degrees"
    return f"at {_with_deviation(angle, sigma)} rad/s"


def _towards(one: Record) -> str:
    """Return which way a camera moved: time has no arrow."""
    x, y, z = one.cam2_from_cam1["translation"] if one.cam2_from_cam1 else (0.0, 0.0, 0.0)
    if not (x or y or z):
        return "(direction unknown)"
    sigma = ""
    if one.pose_covariance is not None:
        sigma = f" (+/- {one.pose_covariance['translation_sigma_deg']:.0f} degrees)"
    return ("forward or back" if abs(z) > math.hypot(x, y) else _way(x, y)) + sigma


def _way(x: float, y: float) -> str:
    short, long = sorted((abs(x), abs(y)))
    if short > DIAGONAL * long:
        return "diagonally"
    return "sideways" if abs(x) > abs(y) else "up or down"


def _with_deviation(value: float, sigma: float) -> str:
    """Return a value with its standard deviation, both with the decimals that the latter admits."""
    digits = min(max(-math.floor(math.log10(max(sigma, 1e-3))), 1), 3)
    return f"{value:.{digits}f} +/- {sigma:.{digits}f}"
