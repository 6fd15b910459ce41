"""What photographs are of use for, in the rows, the lines and the sum of ``blur2view triage``."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path, PurePath

from blur2view.cli.arguments.values import METRES, PERCENT, Amount, ground_text
from blur2view.cli.run import Finished
from blur2view.cli.terminal import plural, printable
from blur2view.results.table import BLURRED, NEAR, OUT_OF_FOCUS, SHARP, UNCLEAR, UNUSABLE, Row, use_of
from blur2view.smears.blur import BlurKind

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
        use, reason = use_of(row, length, limit.number, self._max_defocus, before, limit.unit)
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


def use_line(path: Path, row: Row, limit_px: float, *, meaning: bool) -> str:
    """Return one line about a photograph; on demand with what its blur means."""
    text = f"{printable(str(path))}: {row.use} ({_length(row, limit_px)})"
    if row.use in (BLURRED, UNUSABLE):
        text += f" [{row.verdict}]"
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
