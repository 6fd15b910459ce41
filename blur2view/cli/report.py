"""``blur2view report``: one page that shows the result of every photograph; its options, help and work."""

import re
import time
from argparse import SUPPRESS
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from blur2view import __version__
from blur2view.cli.arguments.option import Rows, option
from blur2view.cli.arguments.shared import PhotographOptions
from blur2view.cli.run import End, jobs_of, open_manifest, run_over
from blur2view.cli.terminal import printable, verdict_line
from blur2view.cli.work import estimated, outcome_of
from blur2view.errors import OutputError
from blur2view.movers.mask import segment
from blur2view.output_files import below_shared_folder, write_file
from blur2view.results.photograph import Photograph
from blur2view.results.report import report, section, thumbnail
from blur2view.results.verdicts import verdict_of
from blur2view.runs.job import Job, Outcome

CONTROLS = """
hover: the values of a smear and, where there is no H, its epipolar line
Ctrl and wheel: zoom; a drag moves the picture
click on a head of the index: sort by it
"""
TERMS = """
distance from lines: sqrt SErrMin, the root of the squared Sampson distance of a smear's ends from their
    epipolar lines, in the better of both orders: pixels, compared with --max-error
epipole: where epipolar lines meet: the camera moved towards it or from it
P(moves): probability that a pixel moves by itself, of the motion mask
uncertainty: standard deviation (sigma) of a smear that the network predicts, pixels
"""
FOLDERS = re.compile(r"(?<!\S)/(?:[^/\s:;,]+/)+")  # of an absolute path within an error's line


@dataclass(frozen=True, kw_only=True)
class ReportOptions(PhotographOptions):
    """The options of ``blur2view report``.

    Write one HTML file that holds everything and loads nothing: to look at, to send, to archive. An index of
    the photographs, sortable by verdict, length of the smears and name; for each the picture with smears,
    inliers, epipolar lines, uncertainty and motion mask as layers, the verdict with its reason, the models
    that competed, F, the timings, and the JSON document of blur2view estimate to download. A photograph that
    fails is a card with its reason. It needs a browser of 2023 or later.
    """

    command = "report"
    output: Path = option(Path("report.html"), "HTML", names="-o --output")
    "the page (default: %(default)s); one of an earlier call is replaced, unless all fail"
    mask: bool = option(True)
    "without the motion mask: faster"
    overwrite: bool = option(False, help=SUPPRESS)  # which does nothing here
    resume: bool = False

    def __post_init__(self) -> None:
        if self.output.suffix.lower() in (".pdf", ".json", ".csv"):
            raise ValueError(f"a report is HTML; name it {self.output.with_suffix('.html')}")
        super().__post_init__()

    tables: ClassVar[dict[str, Rows]] = {
        "on the page": CONTROLS,
        "terms of the page": TERMS,
        "not here": {"--resume": "a page is drawn anew, from the photographs"},
    }
    examples = (
        "blur2view report clip.mp4 --every 10 -o report.html",
        "blur2view report a.jpg --focal 525 --no-mask",
    )

    @property
    def targets(self) -> dict[str, Path]:
        """The page, and the table."""
        return {"-o": self.output} | super().targets

    @property
    def manifest_path(self) -> None:
        """None, as a page is drawn anew."""

    def __call__(self, job: Job) -> Outcome:
        """Return the entry of one photograph, by the name that the page shows."""
        one, mask = estimated(self, job), None
        start = time.perf_counter()
        if self.mask:
            mask = segment(one.estimate, one.image, np.random.default_rng(self.run.seed))
        found, steps = one.estimate, one.timings_s
        if steps is not None and mask is not None:
            steps["mask"] = time.perf_counter() - start
        record = Photograph.of(found, name=job.target, exposure_s=one.exposure_s, timings_s=steps)
        entry = record, section(record, found, one.image, mask), thumbnail(found, one.image)
        summary = verdict_line(str(job.path), verdict_of(one), one.estimate.geometry.config.name)
        summary += f"\n  {one.estimate.geometry.reason}" * self.verbose
        return outcome_of(one, entry, summary)

    def execute(self) -> int:
        """Return the exit code, after estimating every photograph and writing the page.

        A photograph that fails gets a card with its reason; if all fail nothing is written. An interrupted
        run leaves a page of what is done.
        """
        page, shown = self.output, shown_names(self.inputs.paths)
        with open_manifest(self):
            jobs = [replace(job, target=shown[job.path]) for job in jobs_of(self)]
            finished = run_over(self, jobs, None)
            entries = [
                one.payload or (failed(shown[path], without_folders(one.error, path, shown[path])), "", "")
                for path, one in finished.outcomes
                if not self.inputs.is_folder(path)
            ]
            if finished.end is not End.BROKEN and any(content for _, content, _ in entries):
                content = report(entries, __version__)
                write_file(page, content)
                if not self.quiet:
                    print(f"wrote {printable(str(page))} ({len(content) / 1e6:.2f} MB)")
            elif finished.end in (End.WHOLE, End.STOPPED) and len(entries) > 1:  # else its own line says all
                raise OutputError(f"{page}: is not written, as every photograph failed; name others")
        return finished.exit_code


def failed(name: str, error: str) -> Photograph:
    """Return the record of a photograph that failed."""
    return Photograph(name=name, error=error)


def shown_names(images: Sequence[Path]) -> dict[Path, str]:
    """Return names without the folders that all photographs share: a report is made to be sent."""
    below = zip(images, below_shared_folder(images), strict=True)
    return {image: path.name if ".." in path.parts else str(path) for image, path in below}


def without_folders(error: str, path: Path, name: str) -> str:
    """Return the line of a photograph that failed, in which it has this name, without absolute paths."""
    return FOLDERS.sub("", error.replace(str(path), name))
