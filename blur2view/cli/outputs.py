"""Commands that write files of each photograph beside each other: which, when, and what they hold."""

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from blur2view.arrays import AnyArray
from blur2view.cli.options import FolderOptions
from blur2view.cli.run import (
    Finished,
    Taken,
    begun,
    jobs_of,
    kept_of,
    manifest_beside,
    refuse_shared,
    run_over,
)
from blur2view.errors import OutputError
from blur2view.file_writing import remove_left_over
from blur2view.output_files import SIGNED_BY, ResultFiles, plan_outputs, prepared
from blur2view.pipeline import FileEstimate
from blur2view.results.document import Document, FailureDocument
from blur2view.results.estimate import EstimateDocument
from blur2view.results.mask_overlay import draw_motion
from blur2view.results.masks import MaskDocument
from blur2view.results.overlay import draw_overlay
from blur2view.runs.job import Job, Outcome, Target, Work
from blur2view.segmentation.formats import GREY, MaskFormat
from blur2view.segmentation.mask import MotionMask
from blur2view.smears.stored import StoredSmears

# The overlay is for looking at: fast deflate (3 of 9) is a third of the time of the best.
_PNG_EFFORT = 3


ESTIMATE = (".smear.npz", ".png", ".json")
MASK = (".mask.png", ".moving.png", ".motion.png", ".motion.json")
"""What the files of a photograph are called after its stem, in the order of writing."""
MASKS = Path("masks")
"""Folder below -o in which masks for another program lie."""


def run_with_files(
    options: FolderOptions,
    endings: Sequence[str],
    work: Work[ResultFiles | None, Taken | None],
    collect: Callable[[list[Taken], list[FailureDocument]], Document],
    beside: Callable[[Path], Path] | None = None,
) -> int:
    """Return the exit code, after the work on every photograph, which has files of its own, with -o.

    With ``--json`` the one document of ``collect`` is printed at the end, with ``--jsonl`` that of each
    photograph. ``beside`` is as of `plan_outputs`.
    """
    folder = options.output
    path = None if options.csv is None else manifest_beside(options.csv)
    path = path if folder is None else folder / f"{options.command}.manifest.jsonl"
    with prepared(folder), begun(options, work, path, [folder]) as manifest:
        plan: Sequence[ResultFiles | OutputError] = ()
        if folder is not None:
            plan = plan_outputs(
                options.inputs.paths,
                folder,
                endings,
                overwrite=options.overwrite,
                names=options.inputs.names,
                beside=beside,
                earlier=manifest,
            )
        jobs = jobs_of(options, plan)
        paths = {path for job in jobs if job.target for path in job.target.paths}
        refuse_shared(options, options.csv, paths, "--csv")
        folders = sorted({path.parent for path in paths})
        with prepared(*folders):
            take = printed if options.jsonl else kept_of
            finished: Finished[Taken | None] = run_over(options, work, jobs, manifest, take=take)
            if options.resume:  # at the end: workers of a killed call live on for a moment
                remove_left_over(paths, folders)
    if options.json:
        print(collect([one for one in finished.taken if one is not None], list(finished.failures)).to_json())
    return finished.exit_code


def printed(job: Job[Target], outcome: Outcome[Taken | None]) -> None:
    """Print the document of a photograph, or of its failure, on one line, at once."""
    made = outcome.made
    document = FailureDocument(image=str(job.path), error=outcome.error) if made is None else made.kept
    if isinstance(document, Document):
        print(document.to_json(indent=None), flush=True)


def result_contents(
    files: ResultFiles, document: EstimateDocument, one: FileEstimate, *, full_field: bool = False
) -> dict[Path, bytes]:
    """Return what is written for a photograph: the arrays, the overlay and the document.

    With ``full_field`` the smears of all pixels, which take much, instead of the network's grid.
    """
    geometry, matches, grid = one.estimate.geometry, one.estimate.matches, one.estimate.grid
    picture = draw_overlay(one.image, grid, matches, geometry, one.run.exposure_s)
    stored = StoredSmears(
        smears=grid.at_pixels() if full_field else grid,
        ends=matches.ends,
        match_sigma_px=matches.sampson_px,
        inlier_mask=geometry.inlier_mask,
        swapped=geometry.swapped,
    )
    arrays = io.BytesIO()
    np.savez(arrays, **stored.arrays())  # type: ignore[arg-type]
    contents = arrays.getvalue(), png(picture), (document.to_json() + "\n").encode()
    return dict(zip(files.paths, contents, strict=True))


@dataclass(frozen=True, kw_only=True)
class MaskExport:
    """For which program masks are written, and whether it leaves out what is unobservable."""

    program: MaskFormat
    ignore_unobservable: bool

    def path(self, photograph: Path) -> Path:
        """Return where the mask of a photograph of this name goes, below the folder of results."""
        return MASKS / self.program.path(photograph)

    def encoded(self, mask: MotionMask) -> bytes:
        """Return the mask as the program reads it."""
        picture = self.program.picture(mask.labels, ignore_unobservable=self.ignore_unobservable)
        return png(picture)


def mask_contents(
    files: ResultFiles,
    document: MaskDocument,
    image: NDArray[np.float32],
    mask: MotionMask,
    export: MaskExport | None = None,
) -> dict[Path, bytes]:
    """Return what is written for a photograph: masks, probabilities, overlay and document."""
    levels = np.round(255 * mask.probability).astype(np.uint8)
    contents = (
        *(() if export is None else (export.encoded(mask),)),
        png(GREY[mask.labels]),
        png(levels),
        png(draw_motion(image, mask)),
        (document.to_json() + "\n").encode(),
    )
    return dict(zip(files.paths, contents, strict=True))


def png(picture: AnyArray) -> bytes:
    """Return a picture as a PNG that says who wrote it, which `output_files.is_ours` looks for."""
    text, stream = PngInfo(), io.BytesIO()
    text.add_text("Software", SIGNED_BY)
    Image.fromarray(picture).save(stream, "PNG", compress_level=_PNG_EFFORT, pnginfo=text)
    return stream.getvalue()
