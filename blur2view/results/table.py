"""The table of ``--csv``: one row for each photograph, and what that is of use for."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from typing import TYPE_CHECKING

from blur2view.results.document import Document
from blur2view.results.estimate import EstimateDocument

if TYPE_CHECKING:
    from blur2view.pipeline import FileEstimate

NO_GEOMETRY = ("DEGENERATE", "UNDEFINED")  # configurations with neither F nor H
DIGITS = 6  # significant ones; of times so many decimals, which are of years
TIME = "timestamp_s"


@dataclass(frozen=True, kw_only=True)
class Row(Document):
    """What a table says of a photograph; empty where there is no such value."""

    null = ""
    name: str = ""
    """The photograph, as COLMAP names it: below the folder that was given, or that all share."""
    verdict: str = ""
    """The configuration, a name of COLMAP's TwoViewGeometryConfiguration; empty if the photograph failed."""
    parallax: str = ""
    """proven, undecided or absent."""
    parallax_probability: float | None = None
    """Probability that things at different depths are seen; empty where no models were compared."""
    blur: str = ""
    """What blurred it: sharp, out of focus, camera moved, camera at rest (and something moves), out of focus
    and moved, cannot tell."""
    smear_px: float | None = None
    """Median length of all smears of the picture, pixels; empty where it shows no texture. (That of the
    smears that were used is another: the report has it.)"""
    smear_sigma_px: float | None = None
    """Median standard deviation of their lengths, pixels."""
    smear_percent: float | None = None
    """That over the diagonal of the picture, per cent: the same whatever its size."""
    smear_ground_m: float | None = None
    """With --gsd of blur2view triage: that on the ground, metres."""
    defocus_px: float | None = None
    """Radius of the disc that spreads as widely as the lens does, pixels: about 1 in focus. Of what is in
    focus, if anything is."""
    defocus_sigma_px: float | None = None
    """Its standard deviation over the picture, pixels."""
    width_px: float | None = None
    """Width of all of the blur, as the length of a smear, pixels: what photographs are ranked by."""
    direction_deg: float | None = None
    """Direction of the mean smear, 0 to 180 degrees, from the x axis towards y, which points down."""
    sharpness: float | None = None
    """1 / (1 + width_px): higher is sharper, whatever the texture."""
    rotation_deg: float | None = None
    """Angle of the rotation during the exposure, degrees, with known intrinsics; with --readout that of one
    of both orders in time."""
    frame: int | None = None
    """Number of the frame in its video, from 0."""
    timestamp_s: float | None = None
    """Its time in the video, of --timestamps, or that which a photograph's name is, seconds."""
    wx: float | None = None
    wy: float | None = None
    wz: float | None = None
    sigma_wx: float | None = None
    sigma_wy: float | None = None
    sigma_wz: float | None = None
    rate_unit: str = ""
    """Rates, or without an exposure time the rotation vector, about the camera's axes, with their standard
    deviations and unit, as blur2view estimate --help-all explains them; their sign is that of time."""
    time_confidence: float | None = None
    """How sure neighbouring frames (blur2view estimate and report, of videos or with --sequence) are of the
    order in time, 0 to 1; 0: the sign is arbitrary."""
    inliers: int | None = None
    """Smears that fit the geometry."""
    elapsed_s: float | None = None
    """Seconds that the estimate took, without --no-timings."""
    use: str = ""
    """Of blur2view triage: sharp, blurred (geometry can use it), out of focus, unclear or unusable."""
    reason: str = ""
    """Of blur2view triage: why it is of that use."""
    error: str = ""
    """Why a photograph failed."""
    meaning: str = ""
    """What the configuration says of the camera, in words: the line that is printed."""

    @classmethod
    def of(cls, one: FileEstimate) -> Row:
        """Return the row of a photograph, without a name."""
        document, diagonal_px = EstimateDocument.of(one), math.hypot(*one.estimate.grid.size)
        stated = {
            "verdict": document.config,
            "smear_percent": document.smear_px and 100 * document.smear_px / diagonal_px,
            "inliers": document.num_inliers,
            "reason": "",
            "elapsed_s": document.timings_s and sum(document.timings_s.values()),
        }
        return cls.gathered(document, one.estimate.blur, cls(), **stated)


def table_text(rows: Sequence[Row]) -> bytes:
    """Return the table as CSV (RFC 4180, but for the ends of lines) with a header; names may be no text."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([field.name for field in fields(Row)])
    for one in rows:
        writer.writerow([_shown(name, value) for name, value in asdict(one).items()])
    return text.getvalue().encode("utf-8", "surrogateescape")


def _shown(name: str, value: object) -> object:
    """Return a value as the table has it."""
    if not isinstance(value, float):
        return value
    return round(value, DIGITS) if name == TIME else f"{value:.{DIGITS}g}"
