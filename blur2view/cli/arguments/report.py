"""``blur2view report``: its options and its help."""

from argparse import SUPPRESS
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from blur2view.cli.arguments.help_text import Rows
from blur2view.cli.arguments.option import option, refused
from blur2view.cli.arguments.shared import PhotographOptions

CONTROLS = """
click or tap: a smear: its ends and, where there is no H, both epipolar lines
hover: the values of a smear
pinch, Ctrl and wheel: zoom; also by the keys + and -
arrow keys: walk from smear to smear
"""
TERMS = """
distance from lines: sqrt SErrMin, the root of the squared Sampson distance of a smear's ends from their
    epipolar lines, in the better of both orders: pixels, compared with --max-error
epipole: where epipolar lines meet: the camera moved towards it or from it
P(moves): probability that a pixel moves by itself, of the motion mask
uncertainty: standard deviation (sigma) of a smear that the network predicts, pixels
"""


@dataclass(frozen=True, kw_only=True)
class ReportSettings:
    """Those on which the entry of a photograph depends."""

    mask: bool = option(True)
    "without the motion mask: faster"


@dataclass(frozen=True, kw_only=True)
class ReportOptions(ReportSettings, PhotographOptions):
    """The options of ``blur2view report``.

    Write one HTML file that holds everything and loads nothing: to look at, to send, to archive. An index of
    the photographs, sortable by verdict, length of the smears and name; for each the picture with smears,
    inliers, epipolar lines, uncertainty and motion mask as layers, the verdict with its reason, the models
    that competed, F, the timings, and the JSON document of blur2view estimate to download. A photograph that
    fails is a card with its reason. It needs a browser of 2023 or later.
    """

    command = "report"
    output: Path = option(Path("report.html"), "HTML", names="-o --output")
    "the page (default: %(default)s); one of an earlier call is replaced, unless all fail"
    overwrite: bool = option(False, help=SUPPRESS)  # which does nothing here
    resume: bool = refused()
    "a page is drawn anew, from the photographs"

    def __post_init__(self) -> None:
        if self.output.suffix.lower() not in ("", ".html", ".htm"):
            raise ValueError(f"a report is HTML; name it {self.output.with_suffix('.html')}")
        super().__post_init__()

    tables: ClassVar[dict[str, Rows]] = {"on the page": CONTROLS, "terms of the page": TERMS}
    examples = (
        "blur2view report clip.mp4 --every 10 -o report.html",
        "blur2view report a.jpg --focal 525 --no-mask",
    )
