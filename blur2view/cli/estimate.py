"""``blur2view estimate``: the two-view geometry of each photograph; its options, help and work."""

import io
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import ClassVar

import numpy as np

from blur2view.arrays import Array
from blur2view.cli.arguments.option import Rows, option
from blur2view.cli.outputs import FAILURES, MANIFEST, FolderOptions, png, with_files
from blur2view.cli.terminal import seconds_lines, verdict_line
from blur2view.cli.work import estimated
from blur2view.geometry.epipolar import epipoles
from blur2view.geometry.two_view_geometry import TwoViewGeometry
from blur2view.networks.protocol import Detail
from blur2view.pipeline import FileEstimate
from blur2view.results.estimate import PER_SECOND, EstimateDocument
from blur2view.results.overlay import draw_overlay
from blur2view.results.photograph import Photograph
from blur2view.runs.job import Job, Outcome
from blur2view.smears.stored import stored_smears

AXES = ("wx", "wy", "wz")
FAR_PX = 1e4  # an epipole that is farther away is given as a direction
CONFIGURATIONS = """
UNCALIBRATED: parallax is proven: F
CALIBRATED: the same with known intrinsics: E and the pose, too
MULTIPLE: two motions share the picture: F is that of the one most smears follow; no pose
PANORAMIC: a rotation explains the smears: H, and F beside it where parallax is undecided
PLANAR: one plane does: the same
PLANAR_OR_PANORAMIC: one of both does, undecided which: the same
DEGENERATE: too few, too short or collinear smears, a still camera or a constant picture: no F
UNDEFINED: the best F explains hardly more smears than chance: none is given
"""
FILES = """
<stem>.json: the JSON document of the photograph; written last
<stem>.smear.npz: smear_grid (h, w, 4), float16: the network's own grid, stride pixels a cell, cell j's
    centre at pixel stride j + (stride - 1) / 2, of a photograph of this shape; a cell holds |d| cos 2phi, |d|
    sin 2phi of its smear d in pixels, sigma_px and sigma_rad, the standard deviations of the whole (pixels)
    and of its direction (radians). blur_grid (h, w, 6), float16: the radius out of focus, pixels, and the
    probabilities of sharp, out of focus, smeared, both, cannot tell. blur2view.load_smears(FILE).at_pixels()
    has displacement (H, W, 2), sigma_px and sigma_rad (H, W), float32, of every pixel; so has the file with
    --full-field. ends (N, 2, 2), match_sigma_px, inlier_mask, second_end_is_open (N): the smears that were
    used, their sigma as the estimator weighs them, whether they fit, and whether ends[:, 1] is the open end
<stem>.png: the overlay: inlier smears coloured by orientation, outliers grey, where there is no H epipolar
    lines white and the epipole, to or from which the camera moved, ringed; below it the verdict and a map of
    uncertainty (sigma)
"""


@dataclass(frozen=True, kw_only=True)
class EstimateOptions(FolderOptions):
    """The options of ``blur2view estimate``.

    Estimate the two-view geometry of the camera's motion during the exposure of each photograph: the
    fundamental matrix F between what the camera saw when the shutter opened and when it closed, with known
    intrinsics the essential matrix and the pose. Where no F can be trusted the configuration and its reason
    say why. Prints two lines about one photograph, one line about each of several; with -o writes files
    beside each other.
    """

    command = "estimate"
    listed = "estimates"
    endings = (".smear.npz", ".png", ".json")

    output: Path | None = option(None, "DIR", names="-o --output")
    "write DIR/<stem>.json, .smear.npz and .png, in place of those of an earlier call, see below"
    full_field: bool = option(False, rare=True, result=True)
    """write the smear of every pixel into .smear.npz, for programs that read NumPy arrays only: 16 bytes a
    pixel"""

    tables: ClassVar[dict[str, Rows]] = {
        "configurations, in COLMAP's names": CONFIGURATIONS,
        "files of -o": FILES + MANIFEST,
        "JSON document of --json": {"estimates": "(list) One document per photograph.", **FAILURES},
        "JSON document of a photograph": EstimateDocument,
    }
    examples = (
        "blur2view estimate models/sample.jpg -o out",
        "blur2view estimate photographs --recursive -o results --resume",
        "blur2view estimate clip.mp4 --every 10 --from 2s --json > estimates.json",
        "blur2view estimate clip.mp4 --focal 800 --exposure 1/50 --csv rates.csv --jsonl | head",
        'blur2view estimate a.jpg --camera "PINHOLE 640 480 525 525 320 240" --exposure 0.04',
    )

    def __call__(self, job: Job) -> Outcome:
        """Return the document, the summary and the files of one photograph."""
        one = estimated(self, job, detail=Detail.PIXELS if self.full_field else Detail.GEOMETRY)
        document = EstimateDocument.of(one)
        geometry, summary = one.estimate.geometry, ""
        if self.prints:
            summary = estimate_summary(document, geometry, self.ending(job), verbose=self.verbose)
        contents = partial(estimate_contents, one, full_field=self.full_field)
        return with_files(job, one, document, summary, contents)


def estimate_contents(one: FileEstimate, *, full_field: bool = False) -> list[bytes]:
    """Return the arrays and the overlay of a photograph.

    With ``full_field`` the smears of all pixels, which take much, instead of the network's grid.
    """
    found, geometry, matches, arrays = one.estimate, one.estimate.geometry, one.estimate.matches, io.BytesIO()
    np.savez(
        arrays,
        **stored_smears(found.grid, full_field=full_field),  # type: ignore[arg-type]
        ends=matches.ends,
        match_sigma_px=matches.sampson_px,
        inlier_mask=geometry.inlier_mask,
        second_end_is_open=geometry.second_end_is_open,
    )
    record = Photograph.of(found, name="", exposure_s=one.exposure_s)
    picture = draw_overlay(one.image, found, record)
    return [arrays.getvalue(), png(picture)]


def estimate_summary(
    document: EstimateDocument, geometry: TwoViewGeometry, ending: str, *, verbose: bool
) -> str:
    """Return two lines about one photograph, or everything, with an ending on where the results are."""
    lines = [verdict_line(document.image, document.meaning, document.config), _figures(document, geometry)]
    if verbose:
        lines += [
            document.reason,
            *_details(document),
            *geometry.table.lines(),
            *seconds_lines(document.timings_s),
        ]
    return "\n  ".join(lines) + ending


def _figures(document: EstimateDocument, geometry: TwoViewGeometry) -> str:
    """Return one line: how many smears fit, without a pose the epipole, the camera if it was scaled."""
    if document.F is None and document.H is None:
        return f"{document.num_matches} smears used"
    fit = f"{document.num_inliers} of {document.num_matches} smears fit"
    share = 100 * document.num_inliers // max(document.num_matches, 1)  # rounded down: not all are 100%
    by_chance = f"{share}%, {100 * document.support_by_chance:.0f}% would by chance"
    # beside H a share of F would read as certainty
    both = document.F is not None and document.H is not None
    parts = [f"{fit} F, and a homography explains them as well" if both else f"{fit} ({by_chance})"]
    if geometry.F is not None and document.H is None and document.cam2_from_cam1 is None:
        epipole = f"moved to or from the epipole at {_point(epipoles(geometry.F)[0])}"
        parts.append(epipole if document.readout_s else f"{epipole}, if the shutter is global")
    if document.camera is not None and "scaled" in document.camera["source"]:
        parts.append(document.camera["source"])
    return "; ".join(parts)


def _details(document: EstimateDocument) -> list[str]:
    """Return F, H, E, the pose and the intrinsics, as far as there are such."""
    lines = []
    for name in ("F", "H", "E"):
        rows = ["  ".join(f"{value: .6e}" for value in row) for row in getattr(document, name) or ()]
        lines += [f"{name} = {row}" if index == 0 else f"    {row}" for index, row in enumerate(rows)]
    pose, covariance, backward = document.cam2_from_cam1, document.pose_covariance, document.backward
    if pose is not None:
        what = "angular velocity" if document.rate_unit == PER_SECOND else "rotation"
        line = f"{what} {_vector([getattr(document, axis) for axis in AXES])} {document.rate_unit}"
        if backward is not None and not document.time_known:
            line += f" or, in the other order in time, {_vector([backward[axis] for axis in AXES])}"
        if any(pose["translation"]):
            line += f"; translation towards {_vector(pose['translation'])}"
            line += f" (+/- {covariance['translation_sigma_deg']:.1f} degrees)" if covariance else ""
        lines.append(line)
    if document.camera is not None:
        hint = "" if document.camera["known"] else ", a hint"
        lines.append(f"intrinsics: {document.camera['source']}{hint}")
    return lines


def _vector(values: list[float]) -> str:
    return f"({', '.join(f'{value:z.3f}' for value in values)})"


def _point(epipole: Array) -> str:
    """Return where an epipole lies in the photograph, or its direction if it is far away."""
    x, y, w = epipole
    if abs(w) * FAR_PX > np.hypot(x, y):
        return f"({x / w:z.0f}, {y / w:z.0f})"
    return f"infinity at {np.degrees(np.arctan2(y, x)) % 180:.0f} degrees"
