"""The verdict on a photograph, one sentence, and its use, by its record."""

from __future__ import annotations

import math
from enum import StrEnum
from typing import TYPE_CHECKING

from blur2view.geometry.configuration import Configuration, Parallax
from blur2view.smears.blur import DEFOCUSED_PX, BlurKind

if TYPE_CHECKING:
    from blur2view.records.record import Record

STILL = BlurKind.SHARP, BlurKind.OUT_OF_FOCUS, BlurKind.CAMERA_AT_REST
"""Kinds of blur of a camera that did not move."""
MIN_TURNED = 0.1
"""Smallest probability of a rotation at which the verdict names it beside a movement (bound)."""
MAX_DEFOCUS_PX = DEFOCUSED_PX
"""Largest radius of a lens in focus."""
MAX_SMEAR_PX = 3.0
"""Longest smear of a sharp photograph: up to this, half of the SIFT features that it shares with itself under
fresh noise are still matched (``git show ad575bde:tools/results/triage.md``; chosen on the photographs of
Kodak's suite that train networks, shown on the others)."""
DIAGONAL = 0.5
"""Smallest ratio of the parts of a direction that is called diagonal (bound)."""


class Use(StrEnum):
    """The use of a photograph."""

    SHARP = "sharp"
    BLURRED = "blurred"  # and geometry, if asked, explains it, so that the views of its exposure are of use
    UNUSABLE = "unusable"  # blurred, and nothing explains it
    OUT_OF_FOCUS = "out of focus"
    UNCLEAR = "unclear"  # too smooth or too dark to show blur


def decide_use(
    record: Record, max_smear_px: float = MAX_SMEAR_PX, max_defocus_px: float = MAX_DEFOCUS_PX
) -> str:
    """Return the use of a photograph, empty if it failed, given the limits of a sharp one.

    The kind of blur decides first: the length of the smear counts only where the camera moved.
    """
    if record.error:
        return ""
    if record.blur == BlurKind.CANNOT_TELL or record.smear_px is None:
        return Use.UNCLEAR
    if record.blur not in STILL and record.smear_px > max_smear_px:
        return Use.BLURRED if record.has_geometry() or not record.config else Use.UNUSABLE
    soft = record.blur == BlurKind.OUT_OF_FOCUS or (record.defocus_px or 0.0) > max_defocus_px
    return Use.OUT_OF_FOCUS if soft else Use.SHARP


def verdict(record: Record) -> str:
    """Return one sentence: why there is no result, what blurred the photograph, what moved."""
    radius = f"radius {record.defocus_px or 0.0:.1f} px"
    moving = f"{percent(record.moving_share or 0.0)} of the picture moves by itself"
    match record.blur:
        case "":
            return record.error
        case BlurKind.SHARP:
            return "Sharp"
        case BlurKind.OUT_OF_FOCUS:
            return f"Out of focus ({radius})"
        case BlurKind.CAMERA_AT_REST:
            soft = f"; out of focus ({radius})" if (record.defocus_px or 0.0) > MAX_DEFOCUS_PX else ""
            return f"The camera stood still; {moving}{soft}"
        case BlurKind.CANNOT_TELL:
            return f"{record.nothing_seen.capitalize() or 'Smooth'}: cannot tell"
    line = f"Camera {_motion(record, _turned_by(record))}; smears of {rounded(record.smear_px or 0.0)} px"
    if record.blur == BlurKind.OUT_OF_FOCUS_AND_MOVED:
        line += f"; out of focus as well ({radius})"
    return f"{line}; {moving}" if record.moving_share else line


def fit_line(record: Record) -> str:
    """Return how many smears the motion explains, as a sentence; empty without a geometry."""
    if not record.has_geometry():
        return ""
    return f"The motion explains {record.num_inliers} of {record.num_matches} smears"


def rounded(value: float) -> str:
    """Return a number with two significant digits, without an exponent."""
    decimals = max(1 - math.floor(math.log10(max(abs(value), 1e-3))), 0)
    return f"{value:.{decimals}f}"


def percent(share: float) -> str:
    """Return a share in whole per cent; only none is 0, and only all is 100."""
    per_cent = min(round(100 * share), 100 if share >= 1 else 99)
    return f"{per_cent} %" if per_cent or not share else "less than 1 %"


def _motion(record: Record, by: str) -> str:
    """Return how the camera moved, as far as the smears show it; ``by`` is the amount of the rotation.

    Whether parallax is undecided is said by the reason, which -v prints.
    """
    undecided = record.parallax == Parallax.UNDECIDED
    match record.config:
        case "":  # triage, which looks at no geometry
            return "moved"
        case Configuration.UNDEFINED:
            return "moved, and no one motion explains the blur"
        case Configuration.DEGENERATE if undecided:
            return "moved, and too little of the picture shows how"
        case Configuration.DEGENERATE:
            return "turned or moved, with the same blur everywhere"
        case Configuration.PANORAMIC:
            less = (record.rotation_probability or 0.0) < (record.parallax_probability or 0.0)
            return f"{_turned(record)}{by} or moved" if less else f"{_turned(record)}{by}"
        case Configuration.PLANAR_OR_PANORAMIC:
            return f"turned{by} or moved past something flat"
    if record.cam2_from_cam1 is not None:
        towards = _towards(record)
        if not towards:
            return f"turned{by} and moved, in an unknown direction" if by else "moved in an unknown direction"
        return f"moved {towards}, turned{by}" if by else f"moved {towards}"
    if record.config != Configuration.PLANAR:
        return "moved past near and far things"
    if not undecided:
        return "moved past something flat"
    or_turned = " or turned" if (record.rotation_probability or 0.0) > MIN_TURNED else ""
    return f"moved{or_turned}"


def _turned(record: Record) -> str:
    """Return the direction of a rotation; a camera rolled where smears run in many directions."""
    if record.direction_deg is None:
        return "rolled"
    angle = math.radians(record.direction_deg)
    return f"turned {_way(math.cos(angle), math.sin(angle))}"


def turned(record: Record) -> tuple[float, float]:
    """Return by how much the camera turned, in the record's unit, and its standard deviation."""
    rates = [record.wx or 0.0, record.wy or 0.0, record.wz or 0.0]
    sigmas = [record.sigma_wx or 0.0, record.sigma_wy or 0.0, record.sigma_wz or 0.0]
    angle = math.hypot(*rates)
    return angle, math.hypot(*(r / max(angle, 1e-30) * s for r, s in zip(rates, sigmas, strict=True)))


def _turned_by(record: Record) -> str:
    """Return " by" an angle or " at" a rate of rotation, with its error; empty if it is within the error."""
    angle, sigma = turned(record)
    if angle <= sigma:
        return ""
    word, unit, scale = (" at", "rad/s", 1.0) if record.exposure_s else (" by", "degrees", math.degrees(1))
    digits = min(max(-math.floor(math.log10(max(scale * sigma, 1e-3))), 1), 3)
    return f"{word} {scale * angle:.{digits}f} +/- {scale * sigma:.{digits}f} {unit}"


def _towards(record: Record) -> str:
    """Return the direction of a translation with its error, in both orders in time; "" if unknown."""
    x, y, z = record.cam2_from_cam1["translation"] if record.cam2_from_cam1 else (0.0, 0.0, 0.0)
    if not (x or y or z):
        return ""
    sigma = ""
    if record.pose_covariance is not None:
        sigma = f" (+/- {record.pose_covariance['translation_sigma_deg']:.0f} degrees)"
    return ("forward or back" if abs(z) > math.hypot(x, y) else _way(x, y)) + sigma


def _way(x: float, y: float) -> str:
    """Return the name of a direction in the picture, up to sign."""
    short, long = sorted((abs(x), abs(y)))
    if short > DIAGONAL * long:
        return "diagonally"
    return "sideways" if abs(x) > abs(y) else "up or down"
