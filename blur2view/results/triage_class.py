"""What photographs are of use for, by their records: the classes of ``blur2view triage``."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import PurePath

from blur2view.results.photograph import Photograph
from blur2view.results.verdict import MAX_DEFOCUS_PX as MAX_DEFOCUS_PX

NEAR = 1.1
"""About the limit by this factor a frame is as sharp as the one before: compressed again, as Motion JPEG and
as MPEG-4, nine in ten frames of RedKitchen's sequence keep their length within 6 and 8 %."""
MAX_SMEAR_PX = 3.0
"""Longest smear of a photograph that is called sharp: up to this, half of the SIFT features that it shares
with itself under fresh noise are still matched (``python -m tools.evaluation.triage``; chosen on the
photographs of Kodak's suite that train networks, shown on the others)."""


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
    max_smear : float
        Longest smear, in ``unit``.
    unit : str
        "px", "%" of the width, or "m" on the ground, which needs ``gsd_m``.
    max_defocus_px : float
        Largest radius out of focus.
    gsd_m : float or None
        What a pixel shows of the ground, metres.
    """

    max_smear: float = MAX_SMEAR_PX
    unit: str = "px"
    max_defocus_px: float = MAX_DEFOCUS_PX
    gsd_m: float | None = None

    def length_of(self, one: Photograph) -> float | None:
        """Return the length of a photograph's smear in the unit of the limit."""
        return {"%": one.smear_percent, "m": one.smear_ground_m}.get(self.unit, one.smear_px)


def classified(rows: Iterable[Photograph], limits: Limits, *, in_order: bool = False) -> Iterator[Photograph]:
    """Yield records with ``use`` and ``use_reason``; near the limit the frame before decides.

    ``in_order``: the photographs of a folder are frames of a video.
    """
    last: Photograph | None = None
    for row in rows:
        if limits.gsd_m is not None and row.smear_px is not None:
            row = replace(row, smear_ground_m=limits.gsd_m * row.smear_px)
        before = last.use if last is not None and _follows(row, last, in_order=in_order) else ""
        use, reason = use_of(row, limits, before)
        row = replace(row, use=use, use_reason=reason)
        last = row if use else last
        yield row


def use_of(one: Photograph, limits: Limits, before: str = "") -> tuple[str, str]:
    """Return the use of a photograph, and why; both are empty if it failed.

    The kind of blur decides first: only where the camera moved the length of the smear is compared with the
    limit, within `NEAR` of which the use ``before``, of the frame before it, decides.
    """
    if one.error:
        return "", ""
    length, radius = limits.length_of(one), one.defocus_px or 0.0
    if one.blur == "cannot tell" or length is None:
        return Use.UNCLEAR, f"{one.nothing_seen or 'smooth or too dark'}: its blur cannot be told"
    factor = NEAR if before == Use.SHARP else 1 / NEAR if before else 1.0
    text = f"{limits.max_smear:g}{'' if limits.unit == '%' else ' '}{limits.unit}"
    still = one.blur in ("sharp", "out of focus", "camera at rest")
    within, short = length <= limits.max_smear, still or length <= limits.max_smear * factor
    if still:
        why = f"{one.blur}: no motion of the camera"
    else:
        why = f"smear {length:.3g} {limits.unit}, {'at most' if within else 'above'} {text}"
        why += f", but near it as the frame before is {before}" * (within != short)
    if short and (one.blur == "out of focus" or radius > limits.max_defocus_px):
        above = f", above {limits.max_defocus_px:g} px" * (radius > limits.max_defocus_px)
        return Use.OUT_OF_FOCUS, f"radius out of focus {radius:.1f} px{above}"
    if short:
        return Use.SHARP, why
    if not one.has_geometry:
        return Use.UNUSABLE, f"{why}; no one motion of the camera explains it"
    return Use.BLURRED, f"{why}; the camera's motion explains it, so that its views are of use"


def _follows(row: Photograph, last: Photograph, *, in_order: bool) -> bool:
    if PurePath(row.name).parent != PurePath(last.name).parent:
        return False
    if row.frame is None or last.frame is None:
        return in_order and row.frame is last.frame
    return row.frame == last.frame + 1
