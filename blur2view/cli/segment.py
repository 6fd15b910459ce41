"""The command ``blur2view segment``: which pixels of a photograph move by themselves."""

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from blur2view.cli.batch import plan_files, run_each
from blur2view.cli.options import read_run
from blur2view.cli.outputs import MaskFiles, write_mask
from blur2view.cli.summary import mask_summary
from blur2view.documents.document import FailureDocument
from blur2view.documents.estimate import EstimateDocument
from blur2view.documents.masks import MaskDocument, MasksDocument
from blur2view.networks.smear_network import SmearNetwork
from blur2view.pipeline import estimate_file
from blur2view.segmentation.mask import SegmentOptions, segment


def run_segment(options: argparse.Namespace, usage_error: Callable[[str], object]) -> int:
    """Return the exit code, after segmenting every photograph."""
    run = read_run(options, usage_error)
    wanted = SegmentOptions(objects=options.objects, estimator=run.options)
    plan = plan_files(options, MaskFiles)
    network = SmearNetwork(options.model)

    def work(path: Path, files: MaskFiles | None) -> tuple[MaskDocument, str]:
        """Return the document and the summary of one photograph, after writing its files."""
        one = estimate_file(path, network, run)
        start = time.perf_counter()
        mask = segment(one.estimate, wanted, np.random.default_rng(run.seed))
        document = MaskDocument.of(EstimateDocument.of(one), mask, time.perf_counter() - start)
        if files:
            write_mask(files, document, one.image, mask)
        return document, mask_summary(document, mask, files, options.verbosity)

    def collect(masks: list[MaskDocument], failures: list[FailureDocument]) -> MasksDocument:
        """Return the document of the call."""
        return MasksDocument(masks=masks, failures=failures)

    return run_each(options, plan, work, collect)
