"""What a record means: in one sentence, and what the photograph is of use for; the same everywhere."""

from __future__ import annotations

import math
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
with itself under fresh noise are still matched (``git show ad575bde:tools/results/triage.md``; chosen on the
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


def use_of(one: Record, max_smear_px: float = MAX_SMEAR_PX, max_defocus_px: float = MAX_DEFOCUS_PX) -> str:
    """Return the use of a photograph, empty if it failed, given what a sharp one may have.

    The kind of blur decides first: the length of the smear counts only where the camera moved.
    """
    if one.error:
        return ""
    if one.blur == "cannot tell" or one.smear_px is None:
        return Use.UNCLEAR
    if one.blur not in STILL and one.smear_px > max_smear_px:
        return Use.BLURRED if one.has_geometry else Use.UNUSABLE
    soft = one.blur == "out of focus" or (one.defocus_px or 0.0) > max_defocus_px
    return Use.OUT_OF_FOCUS if soft else Use.SHARP


def verdict(one: Record) -> str:
    """Return the sentence that matters: why there is no result, what blurred the photograph, what moved."""
    soft = (one.defocus_px or 0.0) > MAX_DEFOCUS_PX
    match one.blur:
        case "":
            return one.error
        case "sharp":
            return "Sharp"
        case "out of focus":
            return f"Out of focus ({_radius(one)})"
        case "camera at rest":
            return f"The camera stood still; {_moving(one)}" + f"; out of focus ({_radius(one)})" * soft
        case "cannot tell":
            return f"{one.nothing_seen.capitalize() or 'Smooth'}: cannot tell"
    both = f"; out of focus, too ({_radius(one)})" * (one.blur == "out of focus and moved")
    return _motion(one) + both + f"; {_moving(one)}" * bool(one.moving_share)


def fit_line(one: Record) -> str:
    """Return how many smears fit."""
    if not one.has_geometry:
        return f"{one.num_matches or 0} smears used"
    both = one.F is not None and one.H is not None
    fit = f"{one.num_inliers} of {one.num_matches} smears fit"
    return fit + " F, and a homography explains them as well" * both


def length_text(one: Record) -> str:
    """Return the length of the photograph's smear in pixels and as a share of the width."""
    if one.smear_px is None:
        return "no smears"
    return f"smears of {rounded(one.smear_px)} px, {rounded(one.smear_percent or 0.0)} % of the width"


def rounded(value: float) -> str:
    """Return a number with two significant digits, without an exponent."""
    decimals = max(1 - math.floor(math.log10(max(abs(value), 1e-3))), 0)
    return f"{value:.{decimals}f}"


def percent(share: float) -> str:
    """Return a share in whole per cent, of which none and all are only what they are."""
    whole = min(round(100 * share), 100 if share >= 1 else 99)
    return f"{whole} %" if whole or not share else "less than 1 %"


def _radius(one: Record) -> str:
    return f"radius {one.defocus_px or 0.0:.1f} px"


def _moving(one: Record) -> str:
    return f"{percent(one.moving_share or 0.0)} of the picture moves by itself"


def _motion(one: Record) -> str:
    """Return what a camera that moved did, as far as the smears show it; no turn within its error."""
    undecided, length = ", parallax undecided" * (one.parallax == "undecided"), f"; {length_text(one)}"
    by, length = (f" {turn}", "") if (turn := _turned_by(one)) else ("", length)
    match one.config:
        case "":  # of triage
            return f"Camera moved{length}"
        case "UNDEFINED":
            return f"Camera moved, and no one motion explains the blur{length}"
        case "DEGENERATE" if undecided:
            return f"Camera moved, and too little of the picture shows how{length}"
        case "DEGENERATE":
            return f"Camera turned or moved, with the same blur everywhere{length}"
        case "PANORAMIC":
            return f"Camera {_turned(one)}{by}{undecided}{length}"
        case "PLANAR_OR_PANORAMIC":
            return f"Camera turned{by} or moved past something flat{length}"
    if one.cam2_from_cam1 is not None:
        turned = f", turned{by}" * bool(by)
        return f"Camera moved {_towards(one)}{turned}{undecided * (one.config == 'PLANAR')}{length}"
    if one.config != "PLANAR":
        return f"Camera moved past near and far things{length}"
    if not undecided:
        return f"Camera moved past something flat{length}"
    or_turned = " or turned" * ((one.rotation_probability or 0.0) > MAY_HAVE_TURNED)
    return f"Camera moved{or_turned}{undecided}{length}"


def _turned(one: Record) -> str:
    """Return which way a camera turned: it rolled where smears run in many directions."""
    if one.direction_deg is None:
        return "rolled"
    angle = math.radians(one.direction_deg)
    return f"turned {_way(math.cos(angle), math.sin(angle))}"


def _turned_by(one: Record) -> str:
    """Return by how much, or how fast, a pose turns, with its error along the axis; empty if within it."""
    rates, sigmas = one.rates or [0.0] * 3, one.rate_sigmas or [0.0] * 3
    angle = math.hypot(*rates)
    sigma = math.hypot(*(r / max(angle, 1e-30) * s for r, s in zip(rates, sigmas, strict=True)))
    if angle <= sigma:
        return ""
    word, unit, scale = ("at", "rad/s", 1.0) if one.exposure_s else ("by", "degrees", math.degrees(1))
    digits = min(max(-math.floor(math.log10(max(scale * sigma, 1e-3))), 1), 3)
    return f"{word} {scale * angle:.{digits}f} +/- {scale * sigma:.{digits}f} {unit}"


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
