"""``blur2view report``: one page that shows the result of every photograph; its options, help and work."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np

from blur2view import __version__
from blur2view.cli.batch.job import Job, Outcome
from blur2view.cli.batch.photograph import estimate_file
from blur2view.cli.batch.run import Run
from blur2view.cli.batch.summary import print_summary, print_table, print_total
from blur2view.cli.options import Command, InTime, Order
from blur2view.cli.parser import file_path, option
from blur2view.cli.terminal import printable, reason_line, verdict_line
from blur2view.movers.moving import THRESHOLD
from blur2view.output import write_file
from blur2view.pipeline import segment
from blur2view.results.report import report, section


@dataclass(frozen=True, kw_only=True)
class ReportOptions(Command):
    """The options of ``blur2view report``.

    Write one HTML file to look at, to send or to archive. It loads nothing from elsewhere. It has an index of
    the photographs and, for each of them, the verdict, the picture with smears, epipolar lines, motion mask
    and uncertainty as layers, and the record, which can be saved as the JSON document of blur2view estimate.
    Of a video it begins with the smears over time and, where the focal length is known, the turning.
    """

    output: Annotated[Path, file_path] = option(
        """-o, --output HTML: HTML file to write (default: %(default)s); the page of an earlier call is
        replaced, unless every photograph fails""",
        Path("report.html"),
    )
    mask: bool = option("--no-mask: leave out the motion mask, which is faster", True)
    in_time: InTime = InTime()
    order: Order = Order()

    exit_codes = Command.exit_codes | {
        "130": "interrupted by Ctrl-C; the page of the photographs that are done is written"
    }
    examples = (
        "blur2view report clip.mp4 --every 10 -o report.html",
        "blur2view report a.jpg --focal 525 --no-mask",
    )

    def execute(self) -> int:
        """Return the exit code, after estimating every photograph and writing the page of what is done."""
        run, page = Run(self), self.output
        run.do(entry_one, print_summary, output=page)
        print_table(run)
        print_total(run)
        if run.done:
            entries = [(outcome.record, outcome.part) for _, outcome in run.outcomes]
            write_file(page, report(entries, __version__))
            if not self.silent:
                print(f"wrote {printable(str(page))}")
        return run.exit_code


def entry_one(options: ReportOptions, job: Job) -> Outcome:
    """Return the record of one photograph, and its section of the page."""
    file, mask, threshold = estimate_file(options, job), None, None
    if options.mask:
        threshold, rng = THRESHOLD, np.random.default_rng(options.estimating.seed)
        mask = segment(file.estimate, file.image, rng, threshold=threshold)
    record = file.record(mask, threshold)
    summary = verdict_line(record)
    if options.printing.verbose:
        summary += f"\n  {reason_line(record)}"
    part = section(record, file.estimate, file.image, mask)
    return Outcome(record=record, summary=summary, part=part)
