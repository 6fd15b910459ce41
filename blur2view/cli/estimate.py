"""``blur2view estimate``: the two-view geometry of each photograph; its options, help and work."""

import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from blur2view.cli.jobs import Job, Outcome
from blur2view.cli.options import Command, Document, Folder, InTime, Order
from blur2view.cli.parser import flag, rare_option
from blur2view.cli.run import FAILURES, EstimatedFile, Run, estimate_file, wrote
from blur2view.cli.terminal import reason_line, verdict_line
from blur2view.errors import OutputError
from blur2view.files import write_file
from blur2view.results.gyroflow import gyroflow_log
from blur2view.results.overlay import draw_overlay, png
from blur2view.results.record import Record, explanations
from blur2view.results.verdict import fit_line
from blur2view.smears.grid import stored_smears
from blur2view.smears.kernels import blur_kernels

ENDINGS = (".smear.npz", ".png", ".json")
CONFIGURATIONS = """
UNCALIBRATED: parallax is proven: F
CALIBRATED: the same with known intrinsics: E and the pose, too
PANORAMIC: a rotation explains the smears: H, and F beside it where parallax is undecided
PLANAR: one plane does: the same
PLANAR_OR_PANORAMIC: a rotation or a plane does, but "no motion" is the likeliest single model, with a
    probability of at most one half: the same
DEGENERATE: too few, too short or collinear smears, a still camera or a constant picture: no F
UNDEFINED: the best F explains hardly more smears than chance: none is given
"""
FILES = """
<stem>.json: the JSON document of the photograph; written last: what --resume goes on with
<stem>.smear.npz: smear_grid (h, w, 4), float16: the network's own grid, stride pixels a cell, cell j's
    centre at pixel stride j + (stride - 1) / 2, of a photograph of this shape; a cell holds |d| cos 2phi, |d|
    sin 2phi of its smear d in pixels, sigma_px and sigma_rad, the standard deviations of the whole (pixels)
    and of its direction (radians). blur_grid (h, w, 6), float16: the radius out of focus, pixels, and the
    probabilities of sharp, out of focus, smeared, both, cannot tell. blur2view.load_smears(FILE).at_pixels()
    has displacement (H, W, 2), sigma_px and sigma_rad (H, W), float32, of every pixel. ends (N, 2, 2),
    match_sigma_px, inlier_mask, second_end_is_open (N): the smears that were used, their sigma as the
    estimator weighs them, whether they fit, and whether ends[:, 1] is the open end
<stem>.kernels.npz: with --kernels: whole (K, K), the photograph's blur kernel, and blur_kernels (h, w, K, K),
    every cell's, of sum 1, in linear light, in pixels; known (h, w), whether a cell shows its blur; stride,
    pixels a cell. The length and the angle of the whole are smear_px and direction_deg of the JSON document
<stem>.png: the overlay: inlier smears coloured by orientation, outliers grey, where there is no H epipolar
    lines white and the epipole, to or from which the camera moved, ringed; below it the verdict
"""


@dataclass(frozen=True, kw_only=True)
class EstimateOptions(Command):
    """The options of ``blur2view estimate``.

    Estimate the two-view geometry of the camera's motion during the exposure of each photograph: the
    fundamental matrix F between what the camera saw when the shutter opened and when it closed, with known
    intrinsics the essential matrix and the pose. Where no F can be trusted the configuration and its reason
    say why. Prints two lines about one photograph, one line about each of several; with -o writes files
    beside each other.
    """

    folder: Folder = Folder()
    document: Document = Document()
    order: Order = Order()
    in_time: InTime = InTime()
    gyroflow: Path | None = rare_option("""--gyroflow FILE: write the rates of a video as a log for Gyroflow,
        called as the video but .gcsv, with --focal or --camera: those of frames of which it is known which
        end of the exposure came first""")

    kernels: bool = flag("""--kernels: also write the blur kernels of the photograph and of its cells, for
        programs that deconvolve, as DIR/<stem>.kernels.npz""")

    exit_codes = Command.exit_codes | {"0": "done; a photograph without F is a result, with its reason"}
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
            raise ValueError("--gyroflow is about rates, which need --focal or --camera")
        if self.kernels and self.folder.output is None:
            raise ValueError("--kernels needs a folder; name it with -o")

    @property
    def endings(self) -> tuple[str, ...]:
        """The endings of a photograph's files, JSON last."""
        return (".kernels.npz", *ENDINGS) if self.kernels else ENDINGS

    def execute(self) -> int:
        """Return the exit code, after estimating every photograph."""
        run, log = Run(self, self.endings), self.gyroflow
        if log is not None and not run.inputs.one_video:
            raise OutputError(
                f"{log}: a log of rates is of one video; name its frames alone, or omit --gyroflow"
            )
        run.do(estimate_one, listed="estimates", gyroflow=log)
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
    lines = [verdict_line(record), fit_line(record) + wrote(job, options.endings)]
    if options.printing.verbose:
        lines.append(reason_line(record))
    return Outcome(record=record, summary="\n  ".join(lines), contents=contents)


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
