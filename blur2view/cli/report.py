"""``blur2view report``: one page that shows the result of every photograph; its options, help and work."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from blur2view import __version__
from blur2view.cli.adapter import group
from blur2view.cli.options import Common, InTime
from blur2view.cli.run import End, Photographs
from blur2view.cli.terminal import printable, verdict_line
from blur2view.cli.work import Setup
from blur2view.errors import OutputError
from blur2view.movers.mask import segment
from blur2view.output_files import write_file
from blur2view.results.photograph import Photograph
from blur2view.results.report import report, section, thumbnail
from blur2view.runs.jobs import Job, Outcome

CONTROLS = """
hover: the values of a smear and, where there is no H, its epipolar line
Ctrl and wheel: zoom; a drag moves the picture
click on a head of the index: sort by it
"""
TERMS = """
epipole: where epipolar lines meet: the camera moved towards it or from it
uncertainty: standard deviation (sigma) of a smear that the network predicts, pixels
"""


@dataclass(frozen=True, kw_only=True)
class Page:
    """output.

    -o, --output HTML: the page (default: %(default)s); one of an earlier call is replaced, unless all fail
    --no-mask: without the motion mask: faster
    """

    effect = False
    output: Path = Path("report.html")
    mask: bool = True

    def __post_init__(self) -> None:
        if self.output.suffix.lower() in (".pdf", ".json", ".csv"):
            raise ValueError(f"a report is HTML; name it {self.output.with_suffix('.html')}")


@dataclass(frozen=True, kw_only=True)
class ReportOptions:
    """The options of ``blur2view report``.

    Write one HTML file that holds everything and loads nothing: to look at, to send, to archive. An index of
    the photographs, sortable by verdict, length of the smears and name; for each the picture with smears,
    epipolar lines, uncertainty and motion mask as layers, the verdict with its reason, what else the record
    says, and the JSON document of blur2view estimate to download. A photograph that fails is a line of the
    index with its reason. It needs a browser of 2023 or later.
    """

    common: Common
    page: Page = group(Page)
    in_time: InTime = group(InTime)

    examples = (
        "blur2view report clip.mp4 --every 10 -o report.html",
        "blur2view report a.jpg --focal 525 --no-mask",
    )

    def __post_init__(self) -> None:
        self.in_time.check(self.common.lens)

    @staticmethod
    def tables() -> dict[str, str | Mapping[str, str]]:
        """Return what --help-all lists besides options."""
        return {"on the page": CONTROLS, "terms of the page": TERMS}

    def execute(self) -> int:
        """Return the exit code, after estimating every photograph and writing the page.

        A photograph that fails has a line of the index; if all fail nothing is written. An interrupted run
        leaves a page of what is done.
        """
        photographs, page = Photographs.of("report", self), self.page.output
        with photographs.writing({"-o": (page, "page")}):
            work = partial(entry_one, photographs.setup, mask=self.page.mask)
            finished = photographs.run(photographs.jobs(), work)
            shown = finished.records
            entries = [
                (one.photograph, one.besides["section"], one.besides["thumbnail"])
                if not one.error
                else (Photograph(name=job.name, error=_error(job, one)), "", "")
                for job, one in finished.outcomes
                if job in shown
            ]
            if finished.end is not End.STOPPED and finished.done:
                content = report(entries, __version__)
                write_file(page, content)
                photographs.print_total(finished)
                if not self.common.printing.quiet:
                    print(f"wrote {printable(str(page))} ({len(content) / 1e6:.2f} MB)")
            elif finished.end is End.WHOLE and len(entries) > 1:  # else its own line says all
                raise OutputError(f"{page}: is not written, as every photograph failed; name others")
        return finished.exit_code


def entry_one(setup: Setup, job: Job, *, mask: bool) -> Outcome:
    """Return the record of one photograph, and what the page shows of it, where it has the name of tables."""
    one, found = setup.estimated(job), None
    if mask:
        found = segment(one.estimate, one.image, np.random.default_rng(setup.common.estimating.seed))
    record = setup.record(one, job, mask=found)
    besides = {
        "section": section(record, one.estimate, one.image, found),
        "thumbnail": thumbnail(one.estimate, one.image),
    }
    summary = verdict_line(str(job.source), record)
    summary += f"\n  {record.reason}" * setup.common.printing.verbose
    return Outcome(photograph=record, summary=summary, besides=besides, warnings=one.warnings)


def _error(job: Job, outcome: Outcome) -> str:
    """Return the line of a photograph that failed without the folder where the user keeps it."""
    return outcome.error.replace(str(job.source), job.name).replace(f"{job.source.folder}/", "")
