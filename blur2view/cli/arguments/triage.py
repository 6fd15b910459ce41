"""``blur2view triage``: its options and its help."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from blur2view.cli.arguments.help_text import Rows
from blur2view.cli.arguments.option import option
from blur2view.cli.arguments.shared import PhotographOptions
from blur2view.cli.arguments.values import Amount, best, radius, smear
from blur2view.results.table import Row

MAX_SMEAR = Amount(number=3.0)
"""Longest median smear, pixels, of a photograph that is called sharp: at most this, half of the SIFT features
that a photograph shares with itself under fresh noise are still matched (``python -m
tools.benchmarks.triage``; chosen on the photographs of Kodak's suite that train networks, shown on the
others)."""
MAX_DEFOCUS = 2.0
"""Largest radius out of focus, pixels, of a photograph that is called sharp."""
USES = """
sharp: the median of all smears of the picture is at most --max-smear, and the radius out of focus of what
    is in focus, if anything is, at most --max-defocus; kept
blurred: it is longer, but F or H explains the smears, so that the views of the exposure are of use (blur2view
    to-colmap); kept with --blurred only
unusable: it is longer, and no geometry explains it (DEGENERATE, UNDEFINED); kept by --best and --every-best
    only
out of focus: the lens, not a motion, blurs all of it; kept as unusable ones
unclear: nothing shows texture, or it is too dark: perhaps sharp; kept as unusable ones
near the limit: within a tenth of it a frame is sharp if the one before it in its video is
the same photographs of another size: give the limit in per cent of the diagonal. Frames that were compressed
    much again have shorter smears than those of their video; --extract compresses nothing
"""
LIST = """
--keep: names, one on a line, relative to the folder that was given or that all photographs share: what COLMAP
    takes as --image_list_path with that folder as --image_path. Written into that folder, it is also a list
    for blur2view, as @frames/keep.txt, from anywhere. Nothing else is in it; which of them are blurred stands
    in the table
--extract: files for COLMAP, ns-process-data and blur2view: frame 120 of a video (from 0) is frame_00120.png,
    with the pixels that were looked at, below the video's name if there are several; photographs are copied.
    The folder must hold nothing else, and nothing in it is replaced
--every-best: of every N neighbours in a video or folder one is kept, and another where it shows another view
"""


@dataclass(frozen=True, kw_only=True)
class TriageOptions(PhotographOptions):
    """The options of ``blur2view triage``.

    Look at every photograph and say what blurred it, motion or a lens out of focus, and by how much: a table
    of all, and a list, or a folder, of those to use. Each is sharp; blurred but of use, where geometry
    explains its smears; unusable, where nothing does; out of focus; or unclear, where it is too smooth or too
    dark to show blur, which the variance of the Laplacian would confuse.
    """

    command = "triage"
    keep: Path | None = option(None, "LIST")
    "write the list of photographs to keep, see below"
    extract: Path | None = option(None, "DIR")
    "write the photographs to keep into a folder, frames of videos as PNG, see below"
    max_smear: Amount = option(MAX_SMEAR, "PX", convert=smear)
    """the longest median of a sharp photograph, in pixels, or as 0.3%% of the picture's diagonal (default:
    %(default)s, up to which half of its SIFT features are still matched)"""
    max_defocus: float = option(MAX_DEFOCUS, "PX", convert=radius)
    "the largest radius out of focus of a sharp photograph, in pixels (default: %(default)s)"
    blurred: bool = option(False, either="choice")
    "keep the blurred ones, too, that geometry can use"
    best: Amount | None = option(None, "N", convert=best, either="choice")
    "keep the N sharpest, by the width of all of the blur, or as 50%% of all"
    every_best: int | None = option(None, "N", either="choice")
    "keep the sharpest of every N neighbours, and of each view among them"
    in_order: bool = option(False, names="--sequence")
    """the photographs of a folder are the frames of a video in this order: near the limit each is as sharp as
    the one before, as frames of a video are anyway"""
    overwrite: bool = option(False, rare=True)
    """replace a list that was changed since it was written, too, if it names nothing but these
    photographs"""
    sequence: bool | None = False

    tables: ClassVar[dict[str, Rows]] = {"uses": USES, "columns of --csv": Row, "the list": LIST}
    examples = (
        "blur2view triage clip.mp4 --every-best 6 --extract frames",
        "blur2view triage clip.mp4 --best 300 --extract frames",
        "blur2view triage frames --csv triage.csv --keep frames/keep.txt",
        "blur2view triage frames --keep frames/keep.txt --max-smear 3 --blurred",
        "blur2view estimate @frames/keep.txt -o results",
        "colmap feature_extractor --image_path frames --image_list_path frames/keep.txt --database_path a.db",
    )

    def __post_init__(self) -> None:
        if self.resume and self.csv is None and self.keep is None and self.extract is None:
            raise ValueError("--resume goes on with what --csv, --keep or --extract names; add one")
        if self.selects and self.keep is None and self.extract is None:
            raise ValueError("--best and --every-best choose what --keep LIST names or --extract DIR holds")
        super().__post_init__()

    @property
    def selects(self) -> bool:
        """Whether photographs are kept by their order of blur, whatever they are of use for."""
        return self.best is not None or self.every_best is not None
