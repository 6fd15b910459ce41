"""``blur2view estimate``: the two-view geometry of each photograph; its options, help and work."""

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np

from blur2view.cli.batch.job import Job, Outcome
from blur2view.cli.batch.photograph import EstimatedFile, estimate_file
from blur2view.cli.batch.run import FAILURES, Run, wrote
from blur2view.cli.batch.summary import print_document, print_summary, print_table, print_total
from blur2view.cli.options import Command, Document, Folder, InTime, Order
from blur2view.cli.parser import file_path, flag, rare_option
from blur2view.cli.terminal import reason_line, verdict_line
from blur2view.errors import OutputError
from blur2view.output import write_file
from blur2view.records.record import Record, explanations
from blur2view.records.verdict import fit_line
from blur2view.results.gyroflow import gyroflow_log
from blur2view.results.overlay import draw_overlay, png
from blur2view.smears.grid import stored_smears
from blur2view.smears.kernels import blur_kernels

ENDINGS = (".smear.npz", ".png", ".json")
CONFIGURATIONS = """
UNCALIBRATED: parallax is proven: F
CALIBRATED: the same with known intrinsics: F, E and the pose
PANORAMIC: a rotation explains the smears: H, and also F where parallax is undecided
PLANAR: motion past one plane explains the smears: H, and also F where parallax is undecided
PLANAR_OR_PANORAMIC: a rotation or a plane explains the smears, although "no motion" is the likeliest single
    model with a probability of at most one half: H, and also F where parallax is undecided
DEGENERATE: the smears are too few, too short or collinear, the camera stood still, or the picture is
    constant: no F
UNDEFINED: the best F explains hardly more smears than chance does: no F
"""
FILES = """
<stem>.json: the JSON document of the photograph; it is written last, and --resume reads it
<stem>.smear.npz: smear_grid (h, w, 4), float16, is the grid that the network reads: a cell has stride x
    stride pixels, and the centre of cell j lies at pixel stride j + (stride - 1) / 2. Each cell holds |d| cos
    2phi and |d| sin 2phi of its smear d in pixels, and the standard deviations sigma_px of the smear (pixels)
    and sigma_rad of its direction (radians). blur_grid (h, w, 6), float16, holds the radius of defocus in
    pixels, and the probabilities of sharp, out of focus, smeared, both, and cannot tell. shape is that of the
    photograph. blur2view.load_smears(FILE).at_pixels() returns displacement (H, W, 2), sigma_px and sigma_rad
    (H, W), float32, at every pixel. ends (N, 2, 2) are the smears that were used, match_sigma_px (N) the
    standard deviations by which the estimator weighs them, inlier_mask (N) tells whether they fit, and
    second_end_is_open (N) whether ends[:, 1] is the open end
<stem>.kernels.npz: written with --kernels: whole (K, K) is the blur kernel of the photograph, and
    blur_kernels (h, w, K, K) are those of its cells, in pixels, for linear light, each with sum 1; known (h,
    w) tells whether a cell shows its blur, and a cell has stride x stride pixels. The JSON document has the
    length and the angle of the whole as smear_px and direction_deg
<stem>.png: the photograph with its smears: those that fit are coloured by their direction, the others are
    grey; where there is no H, epipolar lines are white, and a ring marks the epipole, towards or away from
    which the camera moved. The verdict stands below
"""


@dataclass(frozen=True, kw_only=True)
class EstimateOptions(Command):
    """The options of ``blur2view estimate``.

    Estimate how the camera moved during the exposure of each photograph: the fundamental matrix F between
    what it saw when the shutter opened and when it closed and, if its intrinsics are known, the essential
    matrix and the pose. Where no F can be trusted, the configuration and its reason say why. The command
    prints a line for each photograph; -o also writes files.
    """

    folder: Folder = Folder()
    document: Document = Document()
    order: Order = Order()
    in_time: InTime = InTime()
    gyroflow: Annotated[Path | None, file_path] = (
        rare_option("""--gyroflow FILE: write the rates of a video as a log for Gyroflow;
        name FILE like the video, with the ending .gcsv. It needs --focal or --camera, and holds the frames
        whose order in time is known""")
    )

    kernels: bool = flag("""--kernels: also write the blur kernels of the photograph and of its cells, for
        programs that deconvolve; they go into DIR/<stem>.kernels.npz""")

    exit_codes = Command.exit_codes | {
        "0": "done; a photograph without F is a result too, and has its reason"
    }
    examples = (
        "blur2view estimate models/sample.jpg -o out",
        "blur2view estimate photographs --recursive -o results --resume",
        "blur2view estimate clip.mp4 --every 10 --from 2s --json > estimates.json",
        "blur2view estimate clip.mp4 --focal 800 --exposure 1/50 --csv rates.csv",
        'blur2view estimate a.jpg --camera "PINHOLE 640 480 525 525 320 240" --exposure 0.04',
    )
    tables = {
        "configurations, in COLMAP's names": CONFIGURATIONS,
        "files of -o": FILES,
        "JSON document of --json": {"estimates": "(list) One document per photograph.", **FAILURES},
        "JSON document of a photograph": explanations(),
    }

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.gyroflow is not None and not self.stated_camera.given:
            raise ValueError("--gyroflow needs the focal length; add --focal PX or --camera")
        if self.kernels and self.folder.output is None:
            raise ValueError("--kernels needs a folder of results; name it with -o")

    @property
    def endings(self) -> tuple[str, ...]:
        """The endings of a photograph's files, JSON last."""
        return (".kernels.npz", *ENDINGS) if self.kernels else ENDINGS

    def execute(self) -> int:
        """Return the exit code, after estimating every photograph."""
        run, log = Run(self, self.endings), self.gyroflow
        if log is not None and not run.inputs.one_video:
            raise OutputError(
                f"{log}: a log of rates holds one video; name one video only, or omit --gyroflow"
            )
        run.do(estimate_one, print_summary, gyroflow=log)
        print_document(run, "estimates")
        print_table(run)
        print_total(run)
        if log is not None and run.done and not run.early_exit_code:
            video = next(job.source.path.name for job, outcome in run.outcomes if not outcome.error)
            write_file(log, gyroflow_log([outcome.record for outcome in run.done], video).encode())
        return run.exit_code


def estimate_one(options: EstimateOptions, job: Job) -> Outcome:
    """Return the record, the summary and the files of one photograph."""
    file = estimate_file(options, job)
    record = file.record()
    contents = estimate_contents(file, record) if job.files else []
    if options.kernels:
        contents.insert(0, blur_kernels(file.estimate.grid, file.estimate.blur).to_npz())
    said = (fit_line(record) + wrote(job, options.endings)).removeprefix("; ")
    lines = [verdict_line(record), said, reason_line(record) if options.printing.verbose else ""]
    return Outcome(record=record, summary="\n  ".join(filter(None, lines)), contents=contents)


def estimate_contents(file: EstimatedFile, record: Record) -> list[bytes]:
    """Return the arrays and the overlay of a photograph with its record."""
    estimate, arrays = file.estimate, io.BytesIO()
    matches, geometry = estimate.matches, estimate.geometry
    np.savez(
        arrays,
        **stored_smears(estimate.grid),  # type: ignore[arg-type]  # mypy fears for allow_pickle
        ends=matches.ends,
        match_sigma_px=matches.sampson_px,
        inlier_mask=geometry.inlier_mask,
        second_end_is_open=geometry.second_end_is_open,
    )
    return [arrays.getvalue(), png(draw_overlay(file.image, estimate, record))]
