"""``blur2view segment``: which pixels of a photograph move by themselves; its options, help and work."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np

from blur2view.arrays import AnyArray
from blur2view.cli.batch.job import Job, Outcome
from blur2view.cli.batch.photograph import estimate_file
from blur2view.cli.batch.run import FAILURES, Run, wrote
from blur2view.cli.batch.summary import print_document, print_summary, print_table, print_total
from blur2view.cli.options import Command, Document, Folder
from blur2view.cli.parser import OneOf, flag, option, probability
from blur2view.cli.terminal import printable
from blur2view.images.pixels import stored_from_upright
from blur2view.movers.mask import GREY, MaskFormat
from blur2view.movers.moving import THRESHOLD
from blur2view.pipeline import segment
from blur2view.records.record import explanations
from blur2view.results.overlay import draw_blur_map, draw_motion, mask_verdict, png
from blur2view.smears.blur_map import blur_map

ENDINGS = (".mask.png", ".moving.png", ".motion.png", ".motion.json")
FILES = """
<stem>.mask.png: 8-bit grey: 0 static, 255 moving, 128 unobservable (the photograph is smooth there)
<stem>.moving.png: probability of moving, times 65535 (16-bit grey)
<stem>.motion.png: the photograph above a caption; what moves is pink, and what is unobservable is hatched
<stem>.blur.png: written with --blur-map: 8-bit grey: 255 sharp, 170 out of focus, 85 smeared, 0 too smooth to
    tell
<stem>.blur-map.png: written with --blur-map: the photograph with a colour for each of these labels
masks/...: written with --masks: the mask with the name and the greys that each program reads
<stem>.motion.json: the JSON document of the photograph; it is written last, and --resume reads it
"""
FOLDER = Path("masks")  # below -o, of masks for another program


@dataclass(frozen=True, kw_only=True)
class SegmentOptions(Command):
    """The options of ``blur2view segment``.

    Mark what moves by itself, in contrast to what the camera's motion explains. Two networks judge by what
    the photograph shows, and by how its blur departs from a smooth field through the smears, which is the
    camera's motion. Outlines follow the photograph's edges.
    """

    # a field here is part of what --resume compares, unless its type is a Path (`batch.run.options_digest`)
    folder: Folder = Folder()
    document: Document = Document()
    threshold: Annotated[float, probability] = option(
        """--threshold P: probability of moving that a part must reach at its highest place (default:
        %(default)s); a lower threshold misses less of what moves, and marks more of what stands still""",
        THRESHOLD,
    )
    masks: Annotated[list[str] | None, OneOf(*MaskFormat)] = option("""--masks NAME: also write masks for
        colmap, nerfstudio or instant-ngp into DIR/masks; repeat the option for several programs. COLMAP's
        masks are named NAME.jpg.png and nerfstudio's NAME.png, and both are 0 where pixels are ignored; those
        of instant-ngp are named dynamic_mask_NAME.png, and are 255 there. "blur2view to-transforms
        --masks-from DIR" puts them where the trainers look for them""")
    blur_map: bool = flag("""--blur-map: also write which pixels are sharp, smeared, out of focus or too
        smooth to tell, as labels and as a picture""")

    examples = (
        "blur2view segment street.jpg -o masks",
        "blur2view segment photographs/*.jpg -o results --masks colmap --masks instant-ngp",
    )
    tables = {
        "files of -o": FILES,
        "JSON document of --json": {"masks": "(list) One document per photograph.", **FAILURES},
        "JSON document of a photograph": explanations(),
    }

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.masks is not None and self.folder.output is None:
            raise ValueError("--masks needs a folder of results; name it with -o")
        if self.blur_map and self.folder.output is None:
            raise ValueError("--blur-map needs a folder of results; name it with -o")

    @property
    def programs(self) -> list[MaskFormat]:
        """The programs that get masks of their own."""
        return [MaskFormat(name) for name in dict.fromkeys(self.masks or ())]

    @property
    def endings(self) -> tuple[str, ...]:
        """The endings of a photograph's files, JSON last."""
        return (".blur.png", ".blur-map.png", *ENDINGS) if self.blur_map else ENDINGS

    def execute(self) -> int:
        """Return the exit code, after segmenting every photograph."""
        run = Run(self, self.endings, lambda name: [FOLDER / program.path(name) for program in self.programs])
        run.do(segment_one, print_summary)
        print_document(run, "masks")
        print_table(run)
        print_total(run)
        return run.exit_code


def segment_one(options: SegmentOptions, job: Job) -> Outcome:
    """Return the record, the summary and the files of one photograph."""
    file = estimate_file(options, job)
    rng = np.random.default_rng(options.estimating.seed)
    mask = segment(file.estimate, file.image, rng, threshold=options.threshold)
    record = file.record(mask, options.threshold)
    unseen = record.nothing_seen if record.camera_moved is None else ""
    contents = []
    if job.files:
        labels_as_stored = stored_from_upright(
            mask.labels, file.picture.orientation
        )  # programs turn nothing by its EXIF
        masks = [program.picture(labels_as_stored) for program in options.programs]
        levels = np.round(65535 * mask.probability).astype(np.uint16)
        blurs: list[AnyArray] = []
        if options.blur_map:
            labels = blur_map(file.estimate.grid)
            blurs = [labels, draw_blur_map(file.image, labels)]
        pictures: list[AnyArray] = [
            *masks,
            *blurs,
            GREY[mask.labels],
            levels,
            draw_motion(file.image, mask, unseen),
        ]
        contents = [png(picture) for picture in pictures]
    line = f"{printable(job.name)}: {mask_verdict(mask, unseen)}"
    summary = f"{line}\n  {mask.reason}{wrote(job, options.endings)}"
    return Outcome(record=record, summary=summary, contents=contents)
