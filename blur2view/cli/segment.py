"""``blur2view segment``: which pixels of a photograph move by themselves; its options, help and work."""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from blur2view.cli.arguments.option import Rows, option
from blur2view.cli.arguments.values import probability
from blur2view.cli.outputs import FAILURES, MANIFEST, FolderOptions, png, with_files
from blur2view.cli.terminal import printable, seconds_lines
from blur2view.cli.work import estimated
from blur2view.movers.formats import GREY, MaskFormat, as_stored
from blur2view.movers.mask import MotionMask, segment
from blur2view.movers.moving import THRESHOLD
from blur2view.results.estimate import EstimateDocument
from blur2view.results.mask_overlay import draw_motion, mask_verdict
from blur2view.results.masks import MaskDocument
from blur2view.runs.job import Job, Outcome

FILES = """
<stem>.mask.png: 8-bit grey: 0 static, 255 moving, 128 unobservable (it does not seem to move, and is smooth,
    or its smear is not read)
<stem>.moving.png: probability of moving, times 255
<stem>.motion.png: the photograph over a caption, pink on what moves, hatched where it is unobservable
masks/...: with --masks: the mask under the name and with the greys that each program reads
<stem>.motion.json: the JSON document of the photograph; written last
"""
NOT_HERE = """
--readout: masks hardly notice a rolling shutter (with a readout of two exposure times less than 2 % of
    simulated static scenes is called moving); for the pose use blur2view estimate
"""
FOLDER = Path("masks")  # below -o, of masks for another program


@dataclass(frozen=True, kw_only=True)
class SegmentOptions(FolderOptions):
    """The options of ``blur2view segment``.

    Segment what moves by itself from what the camera's motion explains. The camera's motion is one smooth
    field through the smears and, where there is one, F. How far a smear departs from both, how sure it is of
    itself, and where the photograph is blurred otherwise than the camera's motion blurs it, is weighed by a
    second network; outlines follow the photograph's edges.
    """

    command = "segment"
    listed = "masks"
    endings = (".mask.png", ".moving.png", ".motion.png", ".motion.json")

    output: Path | None = option(None, "DIR", names="-o --output")
    "write DIR/<stem>.mask.png, .moving.png, .motion.png and .motion.json, see below"
    threshold: float = option(THRESHOLD, "P", convert=probability, result=True)
    """probability from which on a connected part moves (default: %(default)s); a lower one misses less of
    what moves, and marks more of what stands still"""
    masks: list[str] | None = option(None, choices=[*map(str, MaskFormat)], result=True)
    """also write masks for a program, below DIR/masks: colmap NAME.jpg.png and nerfstudio NAME.png, 0 where
    pixels are ignored; instant-ngp dynamic_mask_NAME.png, 255 there; may be repeated (blur2view
    to-transforms --masks DIR puts them where these trainers look)"""
    unobservable: str = option("keep", choices=("keep", "ignore"), rare=True, result=True)
    "what --masks makes of unobservable pixels (default: keep)"
    sequence: bool | None = False
    exposure: float | None = None
    readout: float | None = None

    tables: ClassVar[dict[str, Rows]] = {
        "files of -o": FILES + MANIFEST,
        "JSON document of --json": {"masks": "(list) One document per photograph.", **FAILURES},
        "JSON document of a photograph": MaskDocument,
        "not here": NOT_HERE,
    }
    examples = (
        "blur2view segment street.jpg -o masks",
        "blur2view segment photographs/*.jpg -o results --masks colmap --masks instant-ngp",
    )

    def __post_init__(self) -> None:
        if self.masks is not None and self.output is None:
            raise ValueError("--masks needs a folder; name it with -o")
        if self.masks is None:
            object.__setattr__(self, "unobservable", "keep")  # what has no effect is no other setting
        super().__post_init__()

    @property
    def programs(self) -> list[MaskFormat]:
        """The programs that get masks of their own."""
        return [MaskFormat(name) for name in dict.fromkeys(self.masks or ())]

    def beside(self, photograph: Path) -> tuple[Path, ...]:
        """Return the masks for programs of a photograph of this name, below the folder."""
        return tuple(FOLDER / program.path(photograph) for program in self.programs)

    def __call__(self, job: Job) -> Outcome:
        """Return the document, the summary and the files of one photograph."""
        one = estimated(self, job)
        start = time.perf_counter()
        rng = np.random.default_rng(self.run.seed)
        mask = segment(one.estimate, one.image, rng, threshold=self.threshold)
        document = MaskDocument.of(EstimateDocument.of(one), mask, time.perf_counter() - start)
        summary = mask_summary(document, mask, self.ending(job), verbose=self.verbose) if self.prints else ""

        def contents() -> list[bytes]:
            ignore = self.unobservable == "ignore"
            stored = as_stored(mask.labels, job.path)  # programs turn no photograph by its EXIF
            masks = [to.picture(stored, ignore_unobservable=ignore) for to in self.programs]
            levels = np.round(255 * mask.probability).astype(np.uint8)
            return list(map(png, (*masks, GREY[mask.labels], levels, draw_motion(one.image, mask))))

        return with_files(job, one, document, summary, contents)


def mask_summary(document: MaskDocument, mask: MotionMask, ending: str, *, verbose: bool) -> str:
    """Return two lines about one photograph's mask, or everything, with an ending."""
    lines = [f"{printable(document.image)}: {mask_verdict(mask)}"]
    if not verbose:
        return f"{lines[0]}\n  {mask.reason.partition(';')[0]}{ending}"
    lines.append(mask.reason)
    for region in mask.regions:
        x, y, width, height = region.box
        size = f"{region.area_px} px at ({x}, {y}), {width}x{height}"
        lines.append(f"{size}, moves with a probability of {region.probability:.2f}")
    return "\n  ".join([*lines, *seconds_lines(document.timings_s)]) + ending
