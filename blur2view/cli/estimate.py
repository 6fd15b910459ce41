"""``blur2view estimate``: the two-view geometry of each photograph; its options, help and work."""

import io
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from blur2view.arrays import Array
from blur2view.cli.adapter import group
from blur2view.cli.files import FAILURES, Folder, png, run_into_folder, wrote
from blur2view.cli.options import Estimating, InTime, Lens, Many, Printing, Rates, Reading, Resuming, Table
from blur2view.cli.photographs import Photographs
from blur2view.cli.terminal import seconds_lines, verdict_line
from blur2view.cli.work import Setup
from blur2view.geometry.epipolar import epipoles
from blur2view.pipeline import FileEstimate
from blur2view.results.overlay import draw_overlay
from blur2view.results.photograph import Photograph, explanations
from blur2view.runs.job import Job, Outcome
from blur2view.smears.stored import stored_smears

ENDINGS = (".smear.npz", ".png", ".json")
AXES = ("wx", "wy", "wz")
FAR_PX = 1e4  # an epipole that is farther away is given as a direction
CONFIGURATIONS = """
UNCALIBRATED: parallax is proven: F
CALIBRATED: the same with known intrinsics: E and the pose, too
PANORAMIC: a rotation explains the smears: H, and F beside it where parallax is undecided
PLANAR: one plane does: the same
PLANAR_OR_PANORAMIC: one of both does, undecided which, or no motion is about as likely: the same
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
<stem>.png: the overlay: inlier smears coloured by orientation, outliers grey, where there is no H epipolar
    lines white and the epipole, to or from which the camera moved, ringed; below it the verdict and a map of
    uncertainty (sigma)
"""


@dataclass(frozen=True, kw_only=True)
class Log:
    """output.

    Rarely:
    --gyroflow FILE: write the rates of a video as a log for Gyroflow, called as the video but .gcsv, with
        --focal or --camera: those of frames of which it is known which end of the exposure came first
    """

    effect = False
    gyroflow: Path | None = None


@dataclass(frozen=True, kw_only=True)
class EstimateOptions:
    """The options of ``blur2view estimate``.

    Estimate the two-view geometry of the camera's motion during the exposure of each photograph: the
    fundamental matrix F between what the camera saw when the shutter opened and when it closed, with known
    intrinsics the essential matrix and the pose. Where no F can be trusted the configuration and its reason
    say why. Prints two lines about one photograph, one line about each of several; with -o writes files
    beside each other.
    """

    reading: Reading
    folder: Folder = group(Folder)
    table: Table = group(Table)
    in_time: InTime = group(InTime)
    lens: Lens = group(Lens)
    rates: Rates = group(Rates)
    log: Log = group(Log)
    estimating: Estimating = group(Estimating)
    many: Many = group(Many)
    resuming: Resuming = group(Resuming)
    printing: Printing = group(Printing)

    examples = (
        "blur2view estimate models/sample.jpg -o out",
        "blur2view estimate photographs --recursive -o results --resume",
        "blur2view estimate clip.mp4 --every 10 --from 2s --json > estimates.json",
        "blur2view estimate clip.mp4 --focal 800 --exposure 1/50 --csv rates.csv --jsonl | head",
        'blur2view estimate a.jpg --camera "PINHOLE 640 480 525 525 320 240" --exposure 0.04',
    )

    def __post_init__(self) -> None:
        self.rates.check(self.lens)
        self.resuming.check(self.folder.output, self.table.csv)
        if self.log.gyroflow is not None and not self.lens.stated:
            raise ValueError("--gyroflow is about rates, which need --focal or --camera")
        self.many.check(self.lens)

    @staticmethod
    def tables() -> dict[str, str | Mapping[str, str]]:
        """Return what --help-all lists besides options."""
        return {
            "configurations, in COLMAP's names": CONFIGURATIONS,
            "files of -o": FILES,
            "JSON document of --json": {"estimates": "(list) One document per photograph.", **FAILURES},
            "JSON document of a photograph": explanations(),
        }

    def execute(self) -> int:
        """Return the exit code, after estimating every photograph."""
        photographs = Photographs.of("estimate", self)
        work = partial(estimate_one, photographs.setup, verbose=self.printing.verbose)
        return run_into_folder(
            photographs, work, self.folder, listed="estimates", endings=ENDINGS, log=self.log.gyroflow
        )


def estimate_one(setup: Setup, job: Job, *, verbose: bool) -> Outcome:
    """Return the record, the summary and the files of one photograph."""
    one = setup.estimated(job)
    record = setup.record(one, job)
    files = {}
    if job.files:
        written = [*estimate_contents(one, record), (record.to_json() + "\n").encode()]
        files = dict(zip(job.files, written, strict=True))
    summary = estimate_summary(str(job.source), record, verbose=verbose) + wrote(job, ENDINGS)
    return Outcome(photograph=record, summary=summary, files=files, warnings=one.warnings)


def estimate_contents(one: FileEstimate, record: Photograph) -> list[bytes]:
    """Return the arrays and the overlay of a photograph with its record."""
    found, geometry, matches, arrays = one.estimate, one.estimate.geometry, one.estimate.matches, io.BytesIO()
    np.savez(
        arrays,
        **stored_smears(found.grid),  # type: ignore[arg-type]
        ends=matches.ends,
        match_sigma_px=matches.sampson_px,
        inlier_mask=geometry.inlier_mask,
        second_end_is_open=geometry.second_end_is_open,
    )
    return [arrays.getvalue(), png(draw_overlay(one.image, found, record))]


def estimate_summary(name: str, record: Photograph, *, verbose: bool) -> str:
    """Return two lines about one photograph, or everything."""
    lines = [verdict_line(name, record.verdict, record.config), _figures(record)]
    if verbose:
        lines += [record.reason, *_details(record), *_models(record), *seconds_lines(record.timings_s)]
    return "\n  ".join(lines)


def _figures(record: Photograph) -> str:
    """Return one line: how many smears fit, without a pose the epipole, the camera if it was scaled."""
    count = record.num_matches or 0
    if record.F is None and record.H is None:
        return f"{count} smears used"
    fit = f"{record.num_inliers} of {count} smears fit"
    share = 100 * (record.num_inliers or 0) // max(count, 1)  # rounded down: not all are 100%
    by_chance = f"{share}%, {100 * (record.support_by_chance or 0.0):.0f}% would by chance"
    # beside H a share of F would read as certainty
    both = record.F is not None and record.H is not None
    parts = [f"{fit} F, and a homography explains them as well" if both else f"{fit} ({by_chance})"]
    if record.F is not None and record.H is None and record.cam2_from_cam1 is None:
        epipole = f"moved to or from the epipole at {_point(epipoles(np.array(record.F))[0])}"
        parts.append(epipole if record.readout_s else f"{epipole}, if the shutter is global")
    if record.camera is not None and "scaled" in record.camera["source"]:
        parts.append(record.camera["source"])
    return "; ".join(parts)


def _details(record: Photograph) -> list[str]:
    """Return F, H, E, the pose and the intrinsics, as far as there are such."""
    lines = []
    for name in ("F", "H", "E"):
        rows = ["  ".join(f"{value: .6e}" for value in row) for row in getattr(record, name) or ()]
        lines += [f"{name} = {row}" if index == 0 else f"    {row}" for index, row in enumerate(rows)]
    pose, covariance = record.cam2_from_cam1, record.pose_covariance
    if pose is not None:
        what = "angular velocity" if record.rate_unit == "rad/s" else "rotation"
        line = f"{what} {_vector([getattr(record, axis) for axis in AXES])} {record.rate_unit}"
        if record.backward is not None and not record.time_known:
            other = replace(record, cam2_from_cam1=record.backward["cam2_from_cam1"])
            rates = [getattr(other, axis) for axis in AXES]
            line += f" or, in the other order in time, {_vector(rates)}" * (None not in rates)
        if any(pose["translation"]):
            line += f"; translation towards {_vector(pose['translation'])}"
            line += f" (+/- {covariance['translation_sigma_deg']:.1f} degrees)" if covariance else ""
        lines.append(line)
    if record.camera is not None:
        hint = "" if record.camera["known"] else ", a hint"
        lines.append(f"intrinsics: {record.camera['source']}{hint}")
    return lines


def _models(record: Photograph) -> list[str]:
    """Return a line on each model that was compared, likeliest first."""
    return [
        f"{one['model']}: probability {one['probability']:.2f}, {one['parameters']} parameters, "
        f"log likelihood {one['log_likelihood']:.1f}"
        for one in record.models
    ]


def _vector(values: list[Any]) -> str:
    return f"({', '.join(f'{value:z.3f}' for value in values)})"


def _point(epipole: Array) -> str:
    """Return where an epipole lies in the photograph, or its direction if it is far away."""
    x, y, w = epipole
    if abs(w) * FAR_PX > np.hypot(x, y):
        return f"({x / w:z.0f}, {y / w:z.0f})"
    return f"infinity at {np.degrees(np.arctan2(y, x)) % 180:.0f} degrees"
