"""The fields of a photograph's record, each with its explanation, and the numbers that follow from them."""

from __future__ import annotations

import math
from dataclasses import MISSING, dataclass, field
from typing import Any

from blur2view.geometry.two_view_geometry import FAMILIES, MotionModel, likeliest_of

Matrix = list[list[float]]
ALONG_SMEAR = math.sqrt(3)
"""Length of the smear that spreads as widely, along itself, as a disc of radius 1 does."""


def explained(text: str, default: Any = None, *, factory: Any = MISSING) -> Any:
    """Return the field of a record, optional unless ``default`` is `MISSING`, with what explains it."""
    metadata = {"help": " ".join(text.split())}
    if factory is not MISSING:
        return field(default_factory=factory, metadata=metadata)
    return field(default=default, metadata=metadata)


class derived(property):  # noqa: N801
    """A value of a record that follows from others: written, explained, and never read back."""


@dataclass(frozen=True, kw_only=True)
class Record:
    """What blur2view says of one photograph; null, or in a table empty, where there is no such value.

    Matrices are lists of rows. Points are (x, y) in pixels of the upright photograph with (0, 0) at the
    centre of the top-left one; only the ``params`` of a camera follow COLMAP: that centre is (0.5, 0.5).
    """

    name: str = explained(
        "The photograph, as COLMAP names it: below the folder that was given, or that all share.", MISSING
    )
    error: str = explained("Why it failed; then all else is empty.", "")
    width: int | None = explained("Width in pixels, upright.")
    height: int | None = explained("Height in pixels, upright.")
    frame: int | None = explained("Number of the frame in its video, from 0.")
    timestamp_s: float | None = explained(
        "Its time in the video, of --timestamps, or the one that its file name states, seconds."
    )

    blur: str = explained(
        """What blurred it: sharp, out of focus, camera moved, camera at rest (and something moves), out of
        focus and moved, cannot tell. Only where the camera moved a geometry is looked for.""",
        "",
    )
    nothing_seen: str = explained("Why its blur is unknown: too dark, overexposed, one colour.", "")
    smear_px: float | None = explained(
        """Length of the photograph's smear: the median over the picture, each place weighed by how well it
        shows its smear, pixels; null where nothing shows texture."""
    )
    smear_sigma_px: float | None = explained(
        "Standard deviation of that length, pixels. A length below it does not say that the camera moved."
    )
    direction_deg: float | None = explained(
        """Direction of the smears, 0 to 180 degrees, from the x axis towards y, which points down; null where
        they run in many."""
    )
    defocus_px: float | None = explained(
        """Radius of the disc that spreads as widely as the lens does, pixels: about 1 in focus. Of what is in
        focus, if anything is."""
    )
    defocus_sigma_px: float | None = explained("Its standard deviation over the picture, pixels.")
    moving_share: float | None = explained(
        "Share of the picture that moves by itself; null where that was not asked."
    )
    use: str = explained(
        """sharp, blurred (geometry can use it), out of focus, unclear or unusable: see uses of triage, whose
        limits hold elsewhere as they are by default.""",
        "",
    )
    use_reason: str = explained("Why it is of that use.", "")

    config: str = explained(
        """What the camera did: a name of COLMAP's TwoViewGeometryConfiguration, see configurations. It and
        all that follows from geometry is not of triage, which looks less closely.""",
        "",
    )
    reason: str = explained("One sentence with the figures that decided on the configuration.", "")
    parallax: str = explained(
        """Whether the smears show things at different depths: proven (UNCALIBRATED, CALIBRATED), undecided (F
        may be of errors only, or too little is seen) or absent (H alone, or nothing moved).""",
        "",
    )
    models: list[dict[str, Any]] = explained(
        """Every model that was compared, likeliest first: model, parameters, log_likelihood, probability.""",
        factory=list,
    )
    independent_smears: float = explained(
        "As many as if each erred for itself: the log-likelihoods are of so many.", 0.0
    )
    F: Matrix | None = explained(
        """Fundamental matrix, points2^T F points1 = 0, of Frobenius norm 1; 1 is shutter-open, 2 is
        shutter-close, or the reverse: one photograph does not show the direction of time, so F and its
        transpose are one answer. With lens distortion F, H and E hold for undistorted pixels."""
    )
    H: Matrix | None = explained(
        """Homography of the same points, points2 ~ H points1, where one explains the smears; beside F
        parallax is undecided."""
    )
    num_matches: int | None = explained("Smears that were used.")
    num_inliers: int | None = explained("Smears that fit, see --max-error.")
    support_by_chance: float | None = explained(
        "Share of the smears that would fit if their directions were random."
    )

    K: Matrix | None = explained(
        """Calibration matrix of the intrinsics that were used, in pixels with (0, 0) at the centre of the
        top-left one."""
    )
    camera: dict[str, Any] | None = explained(
        "These intrinsics as COLMAP has them: model, params (in COLMAP's pixels), source, known."
    )
    E: Matrix | None = explained("Essential matrix of known intrinsics.")
    cam2_from_cam1: dict[str, Any] | None = explained(
        """Pose of known intrinsics: rotation (3x3) and translation (unit length or zero), or its inverse.
        Where neither parallax is proven nor the direction of the translation known to 30 degrees it is zero,
        and the rotation the one that explains the smears alone, or the mean over all directions."""
    )
    pose_covariance: dict[str, Any] | None = explained(
        """Covariance of the pose: matrix (5x5: rotation vector in radians, translation's direction along two
        tangents), tangents, rotation_sigma_deg, translation_sigma_deg (43 for an unknown direction)."""
    )
    exposure_s: float | None = explained("Exposure time in seconds, from --exposure or EXIF.")
    readout_s: float | None = explained("From --readout: all is then of an exposure of all rows at once.")
    backward: dict[str, Any] | None = explained(
        """With --readout the geometry of the other order in time, which is another motion than the inverse:
        F, H, E, cam2_from_cam1, pose_covariance, config, parallax; null where the rows leave no such smears
        in that order."""
    )
    gyroscope: bool = explained("Whether wx, wy and wz have the sign of a gyroscope, see --gyroscope.", False)
    time_known: bool = explained(
        """Whether neighbouring frames, of a video or with --sequence, decided which end of the exposure came
        first: else F, H, E, the pose, wx, wy, wz and the order of every smear may all be of the reverse.""",
        False,
    )
    time_confidence: float = explained("How sure that decision is, 0 to 1.", 0.0)

    mask: dict[str, Any] | None = explained(
        """Of segment: reason (what the motion of a pixel was measured against), shares (of the pixels that
        are static, moving, unobservable), regions (connected moving parts, largest first: area_px, box (x, y,
        width, height), centroid, probability)."""
    )
    beta: float | None = explained("The option of this name.")
    max_error_px: float | None = explained("The option --max-error.")
    seed: int | None = explained("The option of this name.")
    version: str = explained("The version of blur2view.", "")
    model_ids: list[str] = explained("The networks that were used, by their weights.", factory=list)
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
        return str(likeliest_of(self.probability)[0]) if self.models else ""

    @derived
    def model_probability(self) -> float | None:
        """The probability of the likeliest, with a shutter of either kind."""
        return likeliest_of(self.probability)[1] if self.models else None

    @derived
    def parallax_probability(self) -> float | None:
        """Probability that things at different depths are seen; null where no models were compared."""
        return self.probability(MotionModel.PARALLAX)

    @derived
    def rotation_probability(self) -> float | None:
        """Probability that the camera turned alone, also with a rolling shutter."""
        return self.probability(*FAMILIES[MotionModel.ROTATION])

    @derived
    def plane_probability(self) -> float | None:
        """Probability that all lies in one plane, also with a rolling shutter."""
        return self.probability(*FAMILIES[MotionModel.PLANE])

    @derived
    def rotation_deg(self) -> float | None:
        """Angle of the rotation during the exposure, degrees, with known intrinsics."""
        vector = rotation_vector(self.cam2_from_cam1)
        return None if vector is None else math.degrees(math.hypot(*vector))

    @derived
    def wx(self) -> float | None:
        """Rotation vector of cam2_from_cam1 over the exposure time, about the camera's x (right), rate_unit.

        A gyroscope, which turns with the camera, shows the negative. The sign is of time: see time_known.
        """
        return self._rate(0)

    @derived
    def wy(self) -> float | None:
        """The same about y (down)."""
        return self._rate(1)

    @derived
    def wz(self) -> float | None:
        """The same about z (forwards)."""
        return self._rate(2)

    @derived
    def sigma_wx(self) -> float | None:
        """Standard deviation of wx."""
        return self._rate_sigma(0)

    @derived
    def sigma_wy(self) -> float | None:
        """Standard deviation of wy."""
        return self._rate_sigma(1)

    @derived
    def sigma_wz(self) -> float | None:
        """Standard deviation of wz."""
        return self._rate_sigma(2)

    @derived
    def rate_unit(self) -> str:
        """rad/s, or without an exposure time rad; empty without a pose."""
        return "" if self.cam2_from_cam1 is None else "rad/s" if self.exposure_s else "rad"

    @property
    def has_geometry(self) -> bool:
        """Whether F or H explains the smears, so that the views of the exposure are of use."""
        return self.F is not None or self.H is not None

    def probability(self, *models: str) -> float | None:
        """Return the probability that it is one of these models; None where none were compared."""
        if not self.models:
            return None
        return float(sum(one["probability"] for one in self.models if one["model"] in models))

    def _rate(self, axis: int) -> float | None:
        vector = rotation_vector(self.cam2_from_cam1)
        if vector is None:
            return None
        return (-1 if self.gyroscope else 1) * vector[axis] / (self.exposure_s or 1.0)

    def _rate_sigma(self, axis: int) -> float | None:
        if self.pose_covariance is None:
            return None
        variance = self.pose_covariance["matrix"][axis][axis]
        return math.sqrt(max(variance, 0.0)) / (self.exposure_s or 1.0)


def rotation_vector(pose: dict[str, Any] | None) -> list[float] | None:
    """Return axis times angle, (3,), radians, of the rotation of a record's pose; None without one."""
    if pose is None:
        return None
    import numpy as np

    from blur2view.geometry import rotation

    vector: list[float] = rotation.rotation_vector(np.array(pose["rotation"])).tolist()
    return vector
