"""The command ``blur2view segment``: which pixels of a photograph move by themselves."""

import time
from dataclasses import dataclass

import numpy as np

from blur2view.cli.arguments.segment import SegmentOptions, SegmentSettings
from blur2view.cli.outputs import MASK, MASKS, mask_contents, run_with_files
from blur2view.cli.summary import mask_summary
from blur2view.cli.work import DocumentWork, result_of
from blur2view.output_files import ResultFiles
from blur2view.results.estimate import EstimateDocument
from blur2view.results.masks import MaskDocument, MasksDocument
from blur2view.runs.job import Job, Result
from blur2view.segmentation.formats import MaskFormat
from blur2view.segmentation.mask import segment


@dataclass(frozen=True, kw_only=True)
class SegmentWork(SegmentSettings, DocumentWork[MaskDocument]):
    """The work on one photograph."""

    kind = MaskDocument

    def __call__(self, job: Job[ResultFiles | None]) -> Result[MaskDocument | None]:
        """Return the document and the summary of one photograph, with its files."""
        one, files = self.estimated(job), job.target
        start = time.perf_counter()
        rng = np.random.default_rng(self.run.seed)
        mask = segment(one.estimate, one.image, rng, threshold=self.threshold)
        document = MaskDocument.of(EstimateDocument.of(one), mask, time.perf_counter() - start)
        summary = mask_summary(document, mask, files, self.verbosity)
        ignore = self.unobservable == "ignore"
        formats = map(MaskFormat, dict.fromkeys(self.masks or ()))
        further = [one.picture(mask.labels, ignore_unobservable=ignore) for one in formats]
        contents = {} if files is None else mask_contents(files, document, one.image, mask, further)
        return result_of(one, document if self.prints_documents else None, summary, contents)


def run(options: SegmentOptions) -> int:
    """Return the exit code, after segmenting every photograph."""
    formats = [MaskFormat(name) for name in dict.fromkeys(options.masks or ())]
    return run_with_files(
        options,
        MASK,
        SegmentWork.of(options),
        lambda done, failed: MasksDocument(masks=done, failures=failed),
        lambda photograph: tuple(MASKS / one.path(photograph) for one in formats),
    )
