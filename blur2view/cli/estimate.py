"""``blur2view estimate``: the two-view geometry of each photograph; its options, help and work."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import ClassVar

from blur2view.cli.arguments.option import Rows, option
from blur2view.cli.outputs import FAILURES, MANIFEST, FolderOptions, estimate_contents, with_files
from blur2view.cli.summary import estimate_summary
from blur2view.cli.work import estimated
from blur2view.networks.smear_network import Detail
from blur2view.results.estimate import EstimateDocument
from blur2view.runs.job import Job, Outcome

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
    --full-field. ends (N, 2, 2), match_sigma_px, inlier_mask, swapped (N): the smears that were used, their
    sigma as the estimator weighs them, whether they fit, and whether ends[:, 1] is the open end
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
            summary = estimate_summary(document, geometry, job.files, verbose=self.verbose)
        contents = partial(estimate_contents, one, full_field=self.full_field)
        return with_files(job, one, document, summary, contents)
