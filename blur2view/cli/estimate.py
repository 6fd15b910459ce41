"""The command ``blur2view estimate``: the two-view geometry of each photograph."""

import os
import shlex
import sys
from dataclasses import dataclass

from blur2view.cli.arguments.estimate import EstimateOptions, EstimateSettings
from blur2view.cli.outputs import ESTIMATE, result_contents, run_with_files
from blur2view.cli.summary import estimate_summary
from blur2view.cli.work import DocumentWork, result_of
from blur2view.networks.smear_network import Detail
from blur2view.output_files import ResultFiles
from blur2view.results.estimate import EstimateDocument, EstimatesDocument
from blur2view.runs.job import Job, Result

MOST_NAMED = 3  # inputs that the next command repeats; of more it names the folders


@dataclass(frozen=True, kw_only=True)
class EstimateWork(EstimateSettings, DocumentWork[EstimateDocument]):
    """The work on one photograph."""

    kind = EstimateDocument

    def __call__(self, job: Job[ResultFiles | None]) -> Result[EstimateDocument | None]:
        """Return the document and the summary of one photograph, with its files."""
        detail = Detail.PIXELS if self.full_field else Detail.GEOMETRY
        one, files = self.estimated(job, detail=detail), job.target
        document = EstimateDocument.of(one)
        summary = estimate_summary(document, one.estimate, files, self.verbosity)
        contents = {} if files is None else result_contents(files, document, one, full_field=self.full_field)
        return result_of(one, document if self.prints_documents else None, summary, contents)


def run(options: EstimateOptions) -> int:
    """Return the exit code, after estimating every photograph."""
    work = EstimateWork.of(options)
    code = run_with_files(
        options, ESTIMATE, work, lambda done, failed: EstimatesDocument(estimates=done, failures=failed)
    )
    if code == 0 and options.prints and sys.stdout.isatty():
        print(f"next: {next_command(options)}")
    return code


def next_command(options: EstimateOptions) -> str:
    """Return the command that may be of use next: which frames to keep, or a page to look at."""
    inputs = options.images
    if len(inputs) > MOST_NAMED:
        inputs = sorted({os.path.dirname(path) or os.curdir for path in options.inputs.paths})
    if options.inputs.one_video:
        return shlex.join(["blur2view", "triage", *inputs, "--every-best", "6", "--extract", "best"])
    if len(options.inputs.paths) > 1:
        return shlex.join(["blur2view", "triage", *inputs, "--csv", "table.csv"])
    return shlex.join(["blur2view", "report", *inputs, "-o", "report.html"])
