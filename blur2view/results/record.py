"""The fields of a photograph's record, each with its explanation, and the numbers that follow from them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import MISSING, dataclass, field
from typing import Any

from blur2view.geometry.two_view_geometry import MotionModel

Matrix = list[list[float]]
ALONG_SMEAR = math.sqrt(3)
"""Length of the smear that spreads as widely, along itself, as a disc of radius 1 does."""


def explained(text: str, default: Any = None) -> Any:
    """Return the field of a record with what explains it, optional unless ``default`` is `MISSING`."""
    metadata = {"help": " ".join(text.split())}
    if default == []:
        return field(default_factory=list, metadata=metadata)
    return field(default=default, metadata=metadata)


class derived(property):  # noqa: N801
    """A value of a record that follows from others: written, explained, and never read back."""

    def __init__(self, value: Callable[[Any], Any], text: str = "", kind: str = "float | None") -> None:
        super().__init__(value)
        self.text = " ".join((text or value.__doc__ or "").split())
        self.kind = value.__annotations__.get("return", kind)


def probability_of(text: str, model: MotionModel) -> derived:
    """Return the probability of a model, with a shutter of either kind, explained."""
    return derived(lambda one: one.probability(model), f"Probability: {text}")


def rate_about(axis: int, text: str) -> derived:
    """Return the angular velocity about an axis of the camera, explained."""
    return derived(lambda one: None if one.rates is None else one.rates[axis], text)


def rate_sigma_about(axis: int, text: str) -> derived:
    """Return the standard deviation of the angular velocity about an axis of the camera, explained."""
    return derived(lambda one: None if one.rate_sigmas is None else one.rate_sigmas[axis], text)


@dataclass(frozen=True, kw_only=True)
class Record:
    """What blur2view says of one photograph; null, or in a table empty, where there is no such value.

    Matrices are lists of rows. Points are (x, y) in pixels of the upright photograph with (0, 0) at the
    centre of the top-left one; only the ``params`` of a camera follow COLMAP: that centre is (0.5, 0.5).
    """

    name: str = explained("As COLMAP names it: below the folder that was given, or that all share.", MISSING)
    error: str = explained("Why it failed; then all else is empty.", "")
    width: int | None = explained("Width in pixels, upright.")
    height: int | None = explained("Height in pixels, upright.")
    frame: int | None = explained("Number of the frame in its video, from 0.")
    timestamp_s: float | None = explained("Its time in the video or of its file name, seconds.")

    blur: str = explained(
        """What blurred it: sharp, out of focus, camera moved, camera at rest (and something moves), out of
        focus and moved, cannot tell. Only where the camera moved a geometry is looked for.""",
        "",
    )
    nothing_seen: str = explained("Why its blur is unknown: too dark, overexposed, one colour.", "")
    smear_px: float | None = explained(
        "Length of its smear, pixels: the median, each place weighed by how well it shows its own."
    )
    smear_sigma_px: float | None = explained("Its standard deviation: a smear below it may be none.")
    direction_deg: float | None = explained("Of the smears, from x towards y, 0 to 180; null where in many.")
    defocus_px: float | None = explained("Radius out of focus of what is most in focus, pixels; 1 if sharp.")
    defocus_sigma_px: float | None = explained("Its standard deviation over the picture, pixels.")
    moving_share: float | None = explained("Share of the picture that moves by itself; null if not asked.")
    use: str = explained("sharp, blurred (geometry can use it), out of focus, unclear or unusable.", "")

    K: Matrix | None = explained("Calibration matrix, (0, 0) at the centre of the top-left pixel.")
    camera: dict[str, Any] | None = explained("As COLMAP has it: model, params (its pixels), source, known.")
    config: str = explained(
        """What the camera did: a name of COLMAP's TwoViewGeometryConfiguration. It and all that follows from
        geometry is empty of triage, which looks less closely.""",
        "",
    )
    reason: str = explained("One sentence with the figures that decided on the configuration.", "")
    parallax: str = explained(
        """Whether things at different depths are seen: proven (UNCALIBRATED, CALIBRATED), undecided (F may be
        of errors only, or too little is seen) or absent (H alone, or nothing moved).""",
        "",
    )
    models: list[Any] = explained("Likeliest first: model, parameters, log_likelihood, probability.", [])
    independent_smears: float = explained("How many smears of independent errors weigh as much.", 0.0)
    F: Matrix | None = explained(
        """Fundamental matrix, points2^T F points1 = 0, of Frobenius norm 1; 1 is shutter-open, 2 is
        shutter-close, or the reverse: F and its transpose are one answer. Of a distorting lens F, H and E
        hold for undistorted pixels."""
    )
    H: Matrix | None = explained("Homography, points2 ~ H points1; beside F parallax is undecided.")
    num_matches: int | None = explained("Smears that were used.")
    num_inliers: int | None = explained(
        """Smears that fit: the Sampson distance of their ends, in the better of both orders, is below 1.73 px
        and a tenth of their length, or below two of their own standard deviations."""
    )
    support_by_chance: float | None = explained("Share that would fit if directions were random.")
    E: Matrix | None = explained("Essential matrix of known intrinsics.")
    cam2_from_cam1: dict[str, Any] | None = explained(
        """Pose of known intrinsics: rotation (3x3) and translation (unit length or zero), or its inverse. It
        is zero where neither parallax is proven nor its direction known to 30 degrees; the rotation is then
        the one that explains the smears alone, or the mean over all directions."""
    )
    pose_covariance: dict[str, Any] | None = explained(
        """matrix (5x5: rotation vector in radians, translation's direction along two tangents), tangents,
        rotation_sigma_deg, translation_sigma_deg (43 for an unknown direction)."""
    )
    backward: dict[str, Any] | None = explained(
        """With --readout the geometry of the other order in time: F, H, E, cam2_from_cam1, pose_covariance,
        config, parallax; null where the rows leave no such smears."""
    )

    exposure_s: float | None = explained("Exposure time in seconds, from --exposure or EXIF.")
    readout_s: float | None = explained("From --readout: all is then of an exposure of all rows at once.")
    time_known: bool = explained("Whether neighbouring frames decided which end came first.", False)
    time_confidence: float = explained("How sure that decision is, 0 to 1.", 0.0)
    mask: dict[str, Any] | None = explained(
        """Of segment: reason (what motion was measured against), shares (of the pixels: static, moving,
        unobservable), regions (moving parts: area_px, box (x, y, width, height), centroid, probability)."""
    )
    beta: float | None = explained("The option of this name.")
    max_error_px: float | None = explained("The option --max-error.")
    seed: int | None = explained("The option of this name.")
    version: str = explained("The version of blur2view.", "")
    model_ids: list[str] = explained("The networks that were used, by their weights.", [])
    input_sha256: str = explained("SHA-256 of the photograph's file, or of its video's.", "")
    options_sha256: str = explained("SHA-256 of all else that the result depends on: see --resume.", "")

    @derived
    def smear_percent(self) -> float | None:
        """The smear over the width of the picture, per cent."""
        return None if self.smear_px is None or not self.width else 100 * self.smear_px / self.width

    @derived
    def width_px(self) -> float | None:
        """Width of all of the blur, as the length of a smear, pixels: what photographs are ranked by."""
        if self.smear_px is None:
            return None
        return math.hypot(self.smear_px, ALONG_SMEAR * (self.defocus_px or 0.0))

    @derived
    def model(self) -> str:
        """The likeliest of no motion, rotation, plane and parallax; empty where none were compared."""
        return str(self.models[0]["model"]) if self.models else ""

    @derived
    def model_probability(self) -> float | None:
        """The probability of the likeliest, with a shutter of either kind."""
        return float(self.models[0]["probability"]) if self.models else None

    parallax_probability = probability_of("that depths differ, if compared.", MotionModel.PARALLAX)
    rotation_probability = probability_of("that the camera turned alone.", MotionModel.ROTATION)
    plane_probability = probability_of("that all lies in one plane.", MotionModel.PLANE)

    @derived
    def rotation_deg(self) -> float | None:
        """Angle of the rotation during the exposure, degrees, with known intrinsics."""
        return None if self.rates is None else math.degrees(math.hypot(*self.rates) * self.rated_s)

    wx = rate_about(
        0, "Rotation vector of cam2_from_cam1 over the exposure time, about x (right), rate_unit."
    )
    wy = rate_about(1, "The same about y (down). A gyroscope shows the negative.")
    wz = rate_about(2, "The same about z (forwards). The sign is of time: see time_known.")
    sigma_wx = rate_sigma_about(0, "Standard deviation of wx.")
    sigma_wy = rate_sigma_about(1, "Standard deviation of wy.")
    sigma_wz = rate_sigma_about(2, "Standard deviation of wz.")

    @derived
    def rate_unit(self) -> str:
        """rad/s, or without an exposure time rad; empty without a pose."""
        return "" if self.cam2_from_cam1 is None else "rad/s" if self.exposure_s else "rad"

    @property
    def moved(self) -> bool:
        """Whether the camera moved, so that a geometry was looked for."""
        return self.blur in ("camera moved", "out of focus and moved")

    @property
    def has_geometry(self) -> bool:
        """Whether F or H explains the smears, so that the views of the exposure are of use."""
        return self.F is not None or self.H is not None

    @property
    def rated_s(self) -> float:
        """Time that rates are over: without an exposure time they are rotations, in radians."""
        return self.exposure_s or 1.0

    @property
    def rates(self) -> list[float] | None:
        """The angular velocity about x, y and z; None without a pose."""
        if self.cam2_from_cam1 is None:
            return None
        import numpy as np

        from blur2view.geometry.pose import rotation_vector

        vector = rotation_vector(np.array(self.cam2_from_cam1["rotation"])).tolist()
        return [angle / self.rated_s for angle in vector]

    @property
    def rate_sigmas(self) -> list[float] | None:
        """Its standard deviations; None without a pose."""
        if self.pose_covariance is None:
            return None
        variances = [self.pose_covariance["matrix"][axis][axis] for axis in range(3)]
        return [math.sqrt(max(one, 0.0)) / self.rated_s for one in variances]

    def probability(self, model: str) -> float | None:
        """Return the probability that it is a model; None where none were compared."""
        if not self.models:
            return None
        return float(sum(one["probability"] for one in self.models if one["model"] == model))
