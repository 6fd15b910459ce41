"""The command ``blur2view segment``: which pixels of a photograph move by themselves."""

import time
from dataclasses import dataclass, replace

import numpy as np

from blur2view.cli.options import SegmentCommandOptions
from blur2view.cli.outputs import MASK, MaskExport, mask_contents, run_with_files
from blur2view.cli.summary import mask_summary
from blur2view.cli.work import DocumentWork
from blur2view.output_files import ResultFiles
from blur2view.results.estimate import EstimateDocument
from blur2view.results.masks import MaskDocument, MasksDocument
from blur2view.runs.job import Job, Made
from blur2view.segmentation.formats import MaskFormat
from blur2view.segmentation.mask import segment


@dataclass(frozen=True, kw_only=True)
class SegmentWork(DocumentWork[MaskDocument]):
    """The work on one photograph."""

    kind = MaskDocument
    export: MaskExport | None

    def __call__(self, job: Job[ResultFiles | None]) -> Made[MaskDocument | None]:
        """Return the document and the summary of one photograph, with its files."""
        one, files = self.estimated(job), job.target
        start = time.perf_counter()
        mask = segment(one.estimate, one.image, np.random.default_rng(self.run.seed))
        document = MaskDocument.of(EstimateDocument.of(one), mask, time.perf_counter() - start)
        document = document if self.timings else replace(document, timings_s=None)
        return Made(
            kept=document if self.json else None,
            summary=mask_summary(document, mask, files, self.verbosity),
            row=self.row(one),
            files={} if files is None else mask_contents(files, document, one.image, mask, self.export),
            warnings=one.warnings,
        )


def run(options: SegmentCommandOptions) -> int:
    """Return the exit code, after segmenting every photograph."""
    export = None
    if options.masks is not None:
        ignored = options.unobservable == "ignore"
        export = MaskExport(program=MaskFormat(options.masks), ignore_unobservable=ignored)
    work = SegmentWork(**SegmentWork.shared(options), export=export, json=options.json or options.jsonl)
    return run_with_files(
        options,
        MASK,
        work,
        lambda done, failed: MasksDocument(masks=done, failures=failed),
        None if export is None else export.path,
    )
