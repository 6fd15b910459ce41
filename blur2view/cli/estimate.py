"""The command ``blur2view estimate``: the two-view geometry of each photograph."""

import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace

from blur2view.batch.job import Job, Made
from blur2view.cli.batch import plan_files, run_each
from blur2view.cli.network import CommandNetwork
from blur2view.cli.options import read_run
from blur2view.cli.outputs import OutputFiles, result_contents
from blur2view.cli.summary import estimate_summary
from blur2view.documents.document import FailureDocument
from blur2view.documents.estimate import EstimateDocument, EstimatesDocument
from blur2view.documents.table import facts
from blur2view.pipeline import Run, estimate_file


@dataclass(frozen=True, kw_only=True)
class EstimateWork:
    """The work on one photograph."""

    run: Run
    network: CommandNetwork
    timings: bool
    verbosity: int
    full_field: bool

    def __call__(self, job: Job[OutputFiles | None]) -> Made[EstimateDocument]:
        """Return the document and the summary of one photograph, with its files."""
        one = estimate_file(job.path, self.network.loaded, self.run, job.content)
        document, files = EstimateDocument.of(one), job.target
        document = document if self.timings else replace(document, timings_s=None)
        summary = estimate_summary(document, one.estimate, files, self.verbosity)
        said = facts(one.estimate, one.exposure_s, one.seconds if self.timings else None)
        if files is None:
            return Made(kept=document, summary=summary, row=said, warnings=one.warnings)
        contents = result_contents(files, document, one, full_field=self.full_field)
        return Made(kept=document, summary=summary, files=contents, row=said, warnings=one.warnings)


def run_estimate(options: argparse.Namespace, usage_error: Callable[[str], object]) -> int:
    """Return the exit code, after estimating every photograph."""
    run = read_run(options, usage_error)
    plan = plan_files(options, OutputFiles)
    work = EstimateWork(
        run=run,
        network=CommandNetwork.of(options.model),
        timings=not options.no_timings,
        verbosity=options.verbosity,
        full_field=options.full_field,
    )
    return run_each(options, plan, work, collect)


def collect(estimates: list[EstimateDocument], failures: list[FailureDocument]) -> EstimatesDocument:
    """Return the document of the call."""
    return EstimatesDocument(estimates=estimates, failures=failures)
