"""``blur2view segment``: its options and its help."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from blur2view.cli.arguments.help_text import MANIFEST, Rows
from blur2view.cli.arguments.option import option, refused
from blur2view.cli.arguments.shared import FolderOptions
from blur2view.cli.arguments.values import probability
from blur2view.movers.parts import THRESHOLD
from blur2view.results.masks import MaskDocument, MasksDocument

MASKS = ("colmap", "nerfstudio", "instant-ngp")
FILES = """
<stem>.mask.png: 8-bit grey: 0 static, 255 moving, 128 unobservable (it does not seem to move, and is smooth,
    or its smear is not read)
<stem>.moving.png: probability of moving, times 255
<stem>.motion.png: the photograph over a caption, pink on what moves, hatched where it is unobservable
masks/...: with --masks: the mask under the name and with the greys that each program reads
<stem>.motion.json: the JSON document of the photograph; written last
"""


@dataclass(frozen=True, kw_only=True)
class SegmentSettings:
    """Those on which the files of a photograph depend."""

    threshold: float = option(THRESHOLD, "P", convert=probability)
    """probability from which on a connected part moves (default: %(default)s); a lower one misses less of
    what moves, and marks more of what stands still"""
    masks: list[str] | None = option(None, choices=MASKS)
    """also write masks for a program, below DIR/masks: colmap NAME.jpg.png and nerfstudio NAME.png, 0 where
    pixels are ignored; instant-ngp dynamic_mask_NAME.png, 255 there; may be repeated (blur2view
    to-transforms --masks DIR puts them where these trainers look)"""
    unobservable: str = option("keep", choices=("keep", "ignore"), rare=True)
    "what --masks makes of unobservable pixels (default: keep)"


@dataclass(frozen=True, kw_only=True)
class SegmentOptions(SegmentSettings, FolderOptions):
    """The options of ``blur2view segment``.

    Segment what moves by itself from what the camera's motion explains. The camera's motion is one smooth
    field through the smears and, where there is one, F. How far a smear departs from both, how sure it is of
    itself, and where the photograph is blurred otherwise than the camera's motion blurs it, is weighed by a
    second network; outlines follow the photograph's edges. An object that moves along the camera's epipolar
    lines looks like one at another depth.
    """

    command = "segment"
    output: Path | None = option(None, "DIR", names="-o --output")
    "write DIR/<stem>.mask.png, .moving.png, .motion.png and .motion.json, see below"
    sequence: bool | None = False
    exposure: float | None = None
    readout: float | None = refused()
    """a rolling shutter lengthens smears along themselves, which masks hardly notice (with a readout of two
    exposure times less than 2 % of simulated static scenes is called moving); for the pose use blur2view
    estimate or report, which corrects it beside the mask"""

    tables: ClassVar[dict[str, Rows]] = {
        "files of -o": FILES + MANIFEST,
        "JSON document of --json": MasksDocument,
        "JSON document of a photograph": MaskDocument,
    }
    examples = (
        "blur2view segment street.jpg -o masks",
        "blur2view segment photographs/*.jpg -o results --masks colmap --masks instant-ngp",
    )

    def __post_init__(self) -> None:
        if self.masks is not None and self.output is None:
            raise ValueError("--masks needs a folder; name it with -o")
        for one in MASKS:
            if one in self.images and not os.path.lexists(one):
                raise ValueError(f"--masks takes one program; for {one}, too, add --masks {one}")
        if self.masks is None:
            object.__setattr__(self, "unobservable", "keep")  # what has no effect is no other setting
        super().__post_init__()
