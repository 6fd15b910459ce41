"""What a photograph is of use for, by its blur, and why."""

from blur2view.results.table import BLURRED, NO_GEOMETRY, OUT_OF_FOCUS, SHARP, UNCLEAR, UNUSABLE, Row
from blur2view.smears.blur import BlurKind

NEAR = 1.1
"""About the limit by this factor a photograph is as sharp as the one before: compressed again, as Motion JPEG
and as MPEG-4, nine in ten frames of RedKitchen's sequence keep their median within 6 and 8 %."""


def use_of(
    row: Row, length: float | None, limit: float, max_defocus: float, before: str = "", unit: str = " px"
) -> tuple[str, str]:
    """Return the use of a photograph whose median smear has this length, in the limit's unit, and why.

    Both are empty if it failed.

    Unclear if its blur cannot be told; out of focus, and never sharp, if its radius is above that limit.
    Sharp if its median smear is at most the other limit; within `NEAR` of it if the frame ``before`` is. A
    longer one is of use, as views of its exposure, if F or H explains its smears; else it is unusable.
    """
    if row.error:
        return "", ""
    if row.blur == BlurKind.CANNOT_TELL or length is None:
        return UNCLEAR, "smooth or too dark: its blur cannot be told"
    radius = row.defocus_px or 0
    defocused = row.blur == BlurKind.OUT_OF_FOCUS or radius > max_defocus
    beyond = f"radius out of focus {radius:.1f} px" + f", above {max_defocus:g} px" * (radius > max_defocus)
    factor = 1.0 if not before else NEAR if before == SHARP else 1 / NEAR
    short = length <= limit * factor
    smear = f"median smear {length:.3g}{unit}, {'at most' if length <= limit else 'above'} {limit:g}{unit}"
    smear += f", but near it as the frame before is {before}" * ((length <= limit) != short)
    if defocused and (short or row.verdict in NO_GEOMETRY):
        return OUT_OF_FOCUS, beyond
    if short:
        return SHARP, smear
    if row.verdict in NO_GEOMETRY:
        return UNUSABLE, f"{smear}; no motion of the camera explains it"
    return BLURRED, f"{smear}; the camera's motion explains it, so that its views are of use"
