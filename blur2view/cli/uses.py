"""What photographs are of use for, in the rows, the lines and the sum of ``blur2view triage``."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path, PurePath

from blur2view.cli.arguments.values import METRES, PERCENT, Amount, ground_text
from blur2view.cli.run import Finished
from blur2view.cli.terminal import plural, printable
from blur2view.results.table import NO_GEOMETRY, Row
from blur2view.smears.blur import BlurKind

SHARP, BLURRED, OUT_OF_FOCUS, UNCLEAR, UNUSABLE = "sharp", "blurred", "out of focus", "unclear", "unusable"
NEAR = 1.1
"""About the limit by this factor a photograph is as sharp as the one before: compressed again, as Motion JPEG
and as MPEG-4, nine in ten frames of RedKitchen's sequence keep their median within 6 and 8 %."""
KEPT = {"--keep-for-poses": (SHARP, BLURRED), "--keep-for-training": (SHARP,)}
"""The uses of what lists other than --keep name."""
COUNTED = {SHARP: "sharp", BLURRED: "blurred but of use", UNUSABLE: "unusable"}
COUNTED_IF_ANY = {OUT_OF_FOCUS: "out of focus", UNCLEAR: "unclear: smooth or dark", "": "failed"}


class Classifier:
    """Says what photographs are of use for, one after the other: frames follow the one before."""

    def __init__(self, limit: Amount, max_defocus: float, gsd: float | None, *, in_order: bool) -> None:
        self._limit, self._max_defocus, self._gsd, self._in_order = limit, max_defocus, gsd, in_order
        self._last = Row()

    def __call__(self, row: Row) -> Row:
        """Return the row of the next photograph with its use."""
        limit = self._limit
        if self._gsd is not None and row.smear_px is not None:
            row = replace(row, smear_ground_m=self._gsd * row.smear_px)
        length = {PERCENT: row.smear_percent, METRES: row.smear_ground_m}.get(limit.unit, row.smear_px)
        before = self._last.use if self._follows(row) else ""
        use, reason = use_of(row, length, limit, self._max_defocus, before)
        classified = replace(row, use=use, reason=reason)
        self._last = classified if use else self._last
        return classified

    def _follows(self, row: Row) -> bool:
        last = self._last
        if PurePath(row.name).parent != PurePath(last.name).parent:
            return False
        if row.frame is None or last.frame is None:
            return self._in_order and row.frame is last.frame
        return row.frame == last.frame + 1


def use_of(
    row: Row, length: float | None, limit: Amount, max_defocus: float, before: str = ""
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
    short, text = length <= limit.number * factor, f"{limit.number:g}{limit.unit}"
    within = length <= limit.number
    smear = f"median smear {length:.3g}{limit.unit}, {'at most' if within else 'above'} {text}"
    smear += f", but near it as the frame before is {before}" * (within != short)
    if defocused and (short or row.verdict in NO_GEOMETRY):
        return OUT_OF_FOCUS, beyond
    if short:
        return SHARP, smear
    if row.verdict in NO_GEOMETRY:
        return UNUSABLE, f"{smear}; no motion of the camera explains it"
    return BLURRED, f"{smear}; the camera's motion explains it, so that its views are of use"


def use_line(path: Path, row: Row, limit_px: float, *, meaning: bool) -> str:
    """Return one line about a photograph; on demand with what its blur means."""
    text = f"{printable(str(path))}: {row.use} ({_length(row, limit_px)})"
    return f"{text}: {row.meaning}" if meaning else text


def _length(row: Row, limit_px: float) -> str:
    """Return how long the blur is, near the limit with a digit more."""
    if row.smear_px is None or row.blur == BlurKind.CANNOT_TELL:
        return "no texture"
    if row.use == OUT_OF_FOCUS:
        return f"by a radius of {row.defocus_px:.1f} px"
    near = limit_px / NEAR < row.smear_px < limit_px * NEAR
    digits = 2 if near else 1 if row.smear_px < 9.95 else 0
    ground = "" if row.smear_ground_m is None else f", {ground_text(row.smear_ground_m)} on the ground"
    return f"smears of {row.smear_px:.{digits}f} px{ground}"


def closing_line(finished: Finished, kept: str, lists: Sequence[str], written: Sequence[Path]) -> str:
    """Return how many photographs are of which use, ``kept`` how many are, and what was written.

    ``lists`` are the names of those that were asked for.
    """
    rows = finished.rows
    counts = Counter(row.use for row in rows)
    uses = [f"{counts[use]} {words}" for use, words in COUNTED.items()]
    uses += [f"{counts[use]} {words}" for use, words in COUNTED_IF_ANY.items() if counts[use]]
    parts = [", ".join(uses), *([kept] if kept else [])]
    for name in (name for name in KEPT if name in lists and not any(counts[use] for use in KEPT[name])):
        parts.append(f"{name} names none, as none is {' or '.join(KEPT[name])}")
    files = " and ".join(printable(str(path)) for path in written)
    parts += [f"wrote {files}"] * bool(files)
    before = f" ({finished.skipped} done before)" * bool(finished.skipped)
    return f"{plural(len(rows), 'photograph')}{before} in {finished.seconds:.1f} s: {'; '.join(parts)}"
