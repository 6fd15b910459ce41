"""The command ``blur2view estimate``: the two-view geometry of each photograph."""

import argparse
from collections.abc import Callable
from pathlib import Path

from blur2view.cli.batch import plan_files, run_each
from blur2view.cli.options import read_run
from blur2view.cli.outputs import OutputFiles, write_results
from blur2view.cli.summary import estimate_summary
from blur2view.documents.document import FailureDocument
from blur2view.documents.estimate import EstimateDocument, EstimatesDocument
from blur2view.networks.smear_network import SmearNetwork
from blur2view.pipeline import estimate_file


def run_estimate(options: argparse.Namespace, usage_error: Callable[[str], object]) -> int:
    """Return the exit code, after estimating every photograph."""
    run = read_run(options, usage_error)
    plan = plan_files(options, OutputFiles)
    network = SmearNetwork(options.model)

    def work(path: Path, files: OutputFiles | None) -> tuple[EstimateDocument, str]:
        """Return the document and the summary of one photograph, after writing its files."""
        one = estimate_file(path, network, run)
        document = EstimateDocument.of(one)
        if files:
            write_results(files, document, one)
        return document, estimate_summary(document, one.estimate, files, options.verbosity)

    def collect(estimates: list[EstimateDocument], failures: list[FailureDocument]) -> EstimatesDocument:
        """Return the document of the call."""
        return EstimatesDocument(estimates=estimates, failures=failures)

    return run_each(options, plan, work, collect)
