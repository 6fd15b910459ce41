"""What ``blur2view triage`` says of photographs: sharp, blurred but of use, unclear or unusable."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path, PurePath
from typing import Any

from blur2view.cli.options import TriageOptions
from blur2view.cli.run import End, Finished
from blur2view.cli.terminal import SHORT, plural, printable
from blur2view.results.table import BLURRED, SHARP, UNCLEAR, UNUSABLE, Row

NO_GEOMETRY = ("DEGENERATE", "UNDEFINED")
NEAR = 1.1
"""About the limit by this factor a photograph is as sharp as the one before: compressed again, as Motion JPEG
and as MPEG-4, nine in ten frames of RedKitchen's sequence keep their median within 6 and 8 %."""


class Classifier:
    """Says what photographs are of use for, one after the other: frames follow the one before."""

    def __init__(self, options: TriageOptions) -> None:
        self._options, self._last = options, Row()

    def __call__(self, row: Row) -> Row:
        """Return the row of the next photograph with its use."""
        limit = self._options.max_smear
        length = row.smear_percent if limit.percent else row.smear_px
        use = use_of(row, length, limit.number, self._last.use if self._follows(row) else "")
        classified = replace(row, use=use)
        if use:
            self._last = classified
        return classified

    def _follows(self, row: Row) -> bool:
        """Return whether a photograph is the next frame of the video of the last one."""
        last = self._last
        if PurePath(row.name).parent != PurePath(last.name).parent:
            return False
        if row.frame is None or last.frame is None:
            return self._options.in_order and row.frame is last.frame
        return row.frame == last.frame + 1

    def line(self, path: Path, row: Row) -> str:
        """Return one line about a photograph; with -v what its blur means, too."""
        limit = self._options.max_smear
        text = f"{printable(str(path))}: {row.use} ({_length(row, limit.number)})"
        if row.use in (BLURRED, UNUSABLE):
            text += f" [{row.verdict}]"
        return f"{text}: {row.meaning}" if self._options.verbosity > SHORT else text


def use_of(row: Row, length: float | None, limit: float, before: str = "") -> str:
    """Return what a photograph is of use for, empty if it failed.

    Sharp if its median smear is at most the limit; within `NEAR` of it if the frame before is. A longer one
    is of use, as views of its exposure, if F or H explains its smears. Else it is unusable, or unclear where
    there may be no smear: without texture, smooth or out of focus.
    """
    if row.error:
        return ""
    factor = 1.0 if not before else NEAR if before == SHARP else 1 / NEAR
    if length is not None and length <= limit * factor:
        return SHARP
    if row.smear_px is not None and row.verdict not in NO_GEOMETRY:
        return BLURRED
    return UNCLEAR if row.smear_px is None or row.smear_px < (row.smear_sigma_px or 0) else UNUSABLE


def _length(row: Row, limit_px: float) -> str:
    """Return how long the blur is, near the limit with a digit more."""
    if row.smear_px is None:
        return "no texture"
    near = limit_px / NEAR < row.smear_px < limit_px * NEAR
    digits = 2 if near else 1 if row.smear_px < 9.95 else 0
    unsure = f" +/- {row.smear_sigma_px:.0f}" if row.use == UNCLEAR else ""
    return f"smears of {row.smear_px:.{digits}f}{unsure} px"


def hint(rows: Sequence[Row], options: TriageOptions) -> str:
    """Return what would keep photographs where none is kept."""
    if any(row.use == BLURRED for row in rows):
        return "--blurred keeps the blurred ones that are of use, --best 50% the sharper half"
    if all(row.error for row in rows):
        return "no photograph could be read"
    lengths = [row.smear_px for row in rows if row.smear_px is not None]
    if not lengths:
        return "no photograph shows texture"
    return f"the sharpest has smears of {min(lengths):.3g} px, --max-smear is {options.max_smear}"


def closing_line(finished: Finished[Any], options: TriageOptions, kept: int) -> str:
    """Return how many photographs are of which use, and what was written.

    A run that was ended early extracts nothing, and chooses nothing of neighbours.
    """
    rows, whole = finished.rows, finished.end is End.WHOLE
    counts = Counter(row.use for row in rows)
    done_before = f" ({finished.skipped} done before)" * bool(finished.skipped)
    uses = f"{counts[SHARP]} sharp, {counts[BLURRED]} blurred but of use, {counts[UNUSABLE]} unusable"
    uses += f", {counts[UNCLEAR]} unclear: smooth or out of focus" * bool(counts[UNCLEAR])
    parts = [uses + f", {counts['']} failed" * bool(counts[""])]
    if options.keep is not None or options.extract is not None:
        parts.append(f"{kept} kept" if kept else f"none is kept: {hint(rows, options)}")
    keep = options.keep if whole or not options.selects else None
    written = (options.csv if finished.has_table else None, keep, options.extract if kept and whole else None)
    files = " and ".join(printable(str(path)) for path in written if path is not None)
    parts += [f"wrote {files}"] * bool(files)
    return f"{plural(len(rows), 'photograph')}{done_before} in {finished.seconds:.1f} s: {'; '.join(parts)}"
