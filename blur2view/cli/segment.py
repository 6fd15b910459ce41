"""The command ``blur2view segment``: which pixels of a photograph move by themselves."""

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from blur2view.batch.job import Job, Made
from blur2view.cli.batch import plan_files, run_each
from blur2view.cli.network import CommandNetwork
from blur2view.cli.options import read_run
from blur2view.cli.outputs import MaskExport, MaskFiles, mask_contents
from blur2view.cli.summary import mask_summary
from blur2view.documents.document import FailureDocument
from blur2view.documents.estimate import EstimateDocument
from blur2view.documents.masks import MaskDocument, MasksDocument
from blur2view.documents.table import facts
from blur2view.errors import OutputError
from blur2view.output_files import check_file
from blur2view.pipeline import Run, estimate_file
from blur2view.segmentation.formats import MaskFormat
from blur2view.segmentation.mask import segment

MASKS = "masks"
"""Folder below -o in which masks for another program lie."""


@dataclass(frozen=True, kw_only=True)
class SegmentWork:
    """The work on one photograph."""

    run: Run
    export: MaskExport | None
    network: CommandNetwork
    timings: bool
    verbosity: int

    def __call__(self, job: Job[MaskFiles | None]) -> Made[MaskDocument]:
        """Return the document and the summary of one photograph, with its files."""
        one = estimate_file(job.path, self.network.loaded, self.run, job.content)
        start = time.perf_counter()
        mask = segment(one.estimate, one.image, np.random.default_rng(self.run.seed))
        document = MaskDocument.of(EstimateDocument.of(one), mask, time.perf_counter() - start)
        document = document if self.timings else replace(document, timings_s=None)
        summary = mask_summary(document, mask, job.target, self.verbosity)
        contents = (
            {} if job.target is None else mask_contents(job.target, document, one.image, mask, self.export)
        )
        said = facts(one.estimate, one.exposure_s, one.seconds if self.timings else None)
        return Made(kept=document, summary=summary, files=contents, row=said, warnings=one.warnings)


def run_segment(options: argparse.Namespace, usage_error: Callable[[str], object]) -> int:
    """Return the exit code, after segmenting every photograph."""
    run = read_run(options, usage_error)
    export = None
    if options.masks is not None:
        if options.output is None:
            usage_error("--masks needs -o")
        export = MaskExport(
            program=MaskFormat(options.masks), ignore_unobservable=options.unobservable == "ignore"
        )
    plan = plan_files(options, MaskFiles)
    if export is not None:
        plan = [exported(options, export.program, *one) for one in zip(options.images, plan, strict=True)]
    work = SegmentWork(
        run=run,
        export=export,
        network=CommandNetwork.of(options.model),
        timings=not options.no_timings,
        verbosity=options.verbosity,
    )
    return run_each(options, plan, work, collect)


def exported(
    options: argparse.Namespace, program: MaskFormat, image: Path, files: MaskFiles | OutputError | None
) -> MaskFiles | OutputError | None:
    """Return a photograph's files with the mask that a program reads, or why that must not be written."""
    if files is None or isinstance(files, OutputError):
        return files
    named = options.inputs.names.get(image, Path(image.name))
    path = files.folder / MASKS / program.path(named)
    try:
        check_file(path, "mask", options.images, overwrite=options.overwrite or options.resume)
    except OutputError as error:
        return error
    return replace(files, exported=path)


def collect(masks: list[MaskDocument], failures: list[FailureDocument]) -> MasksDocument:
    """Return the document of the call."""
    return MasksDocument(masks=masks, failures=failures)
