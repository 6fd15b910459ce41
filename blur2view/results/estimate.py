"""The document of ``blur2view estimate``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from blur2view.geometry.model_table import MotionModel
from blur2view.results.document import Document, Matrix, part

if TYPE_CHECKING:
    from blur2view.geometry.two_view_geometry import TwoViewGeometry
    from blur2view.pipeline import FileEstimate

PER_SECOND, RADIANS = "rad/s", "rad"
RATES = "wx", "wy", "wz", "sigma_wx", "sigma_wy", "sigma_wz"
BACKWARD = "config", "cam2_from_cam1", "rotation_deg", "wx", "wy", "wz", "pose_covariance"
COVARIANCE = "matrix", "tangents", "rotation_sigma_deg", "translation_sigma_deg"


@dataclass(frozen=True, kw_only=True)
class EstimateDocument(Document):
    """The document of one photograph of ``blur2view estimate``; null where there is no such value."""

    image: str
    """The photograph as it was named."""
    width: int
    height: int
    """Its size in pixels, upright."""
    frame: int | None
    """Number of the frame in its video, from 0."""
    timestamp_s: float | None
    """Its time in the video, of --timestamps, or that which the photograph's name is, seconds."""
    F: Matrix | None
    """Fundamental matrix, points2^T F points1 = 0, of Frobenius norm 1; 1 is shutter-open, 2 is
    shutter-close, or the reverse: one photograph does not show the direction of time, so F and its transpose
    are one answer. With lens distortion F, H and E hold for undistorted pixels."""
    H: Matrix | None
    """Homography of the same points, points2 ~ H points1, where one explains the smears; beside F parallax is
    undecided."""
    config: str
    """The configuration, a name of COLMAP's TwoViewGeometryConfiguration."""
    meaning: str
    """What it says of the camera, in words: the line that is printed."""
    blur: str
    """What blurred the photograph: sharp, out of focus, camera moved, camera at rest (and something moves),
    out of focus and moved, cannot tell. Only where the camera moved a geometry is looked for."""
    smear_px: float | None
    """Median length of all smears of the picture, pixels; null where it shows no texture."""
    defocus_px: float | None
    """Radius of the disc that spreads as widely as the lens does, pixels: about 1 in focus. Of what is in
    focus, if anything is."""
    defocus_sigma_px: float | None
    """Its standard deviation over the picture, pixels."""
    moving_share: float
    """Share of the picture that moves before a camera at rest; 0 where the camera moved, too."""
    parallax: str
    """Whether the smears show things at different depths: proven (UNCALIBRATED, CALIBRATED), undecided (F may
    be of errors only, or too little is seen) or absent (H alone, or nothing moved)."""
    parallax_probability: float | None
    rotation_probability: float | None
    plane_probability: float | None
    """Probabilities that things at different depths are seen, that the camera turned alone (also with a
    rolling shutter), that all lies in one plane; null where no models were compared."""
    models: dict[str, dict[str, float]]
    """Every model that was compared: parameters, log_likelihood, probability."""
    independent_smears: float
    """As many as if each erred for itself: the log-likelihoods are of so many."""
    reason: str
    """One sentence with the figures that decided."""
    motion_model: str
    """The likeliest of these models, none where none were compared."""
    support: float
    """Share of the smears that are inliers of F, without F of H: num_inliers over num_matches."""
    support_by_chance: float
    """Share that would be if the directions of the same smears were random."""
    K: Matrix | None
    """Calibration matrix of the intrinsics that were used, in pixels with (0, 0) at the centre of the
    top-left one."""
    camera: dict[str, Any] | None
    """These intrinsics as COLMAP has them: model, params (in COLMAP's pixels), source, known."""
    E: Matrix | None
    """Essential matrix of known intrinsics."""
    cam2_from_cam1: dict[str, Any] | None
    """Pose of known intrinsics: rotation (3x3) and translation (unit length or zero), or its inverse. Where
    neither parallax is proven nor the direction of the translation known to 30 degrees it is zero, and the
    rotation the one that explains the smears alone, or the mean over all directions."""
    rotation_deg: float | None
    """Angle of that rotation, degrees."""
    wx: float | None
    wy: float | None
    wz: float | None
    """Rotation vector of cam2_from_cam1 over the exposure time, radians per second, or where no exposure time
    is known the rotation vector itself, radians, about the camera's axes x (right), y (down) and z
    (forwards), with known intrinsics. A gyroscope, which turns with the camera, shows the negative, as
    with --gyroscope they do. The sign of all three is that of time: see time_known."""
    sigma_wx: float | None
    sigma_wy: float | None
    sigma_wz: float | None
    """Their standard deviations."""
    rate_unit: str
    """rad/s or rad; empty without a pose."""
    time_known: bool
    """Whether neighbouring frames, of a video or with --sequence, decided which end of the exposure came
    first: else F, H, E, the pose, wx, wy, wz and the order of every smear may all be of the reverse."""
    time_confidence: float
    """How sure that decision is, 0 to 1."""
    pose_covariance: dict[str, Any] | None
    """Covariance of the pose: matrix (5x5: rotation vector in radians, translation's direction along two
    tangents), tangents, rotation_sigma_deg, translation_sigma_deg (43 for a direction that is unknown)."""
    exposure_s: float | None
    """Exposure time in seconds, from --exposure or EXIF."""
    readout_s: float | None
    """From --readout: all is then that of an exposure of all rows at once."""
    backward: dict[str, Any] | None
    """With --readout the same of the other order in time, which is another motion than the inverse: config,
    cam2_from_cam1, rotation_deg, wx, wy, wz, pose_covariance; null where the rows leave no such smears in
    that order, or it has no pose."""
    num_matches: int
    """Smears that were used."""
    num_inliers: int
    """Smears that fit, see --max-error."""
    beta: float
    max_error_px: float
    seed: int
    """The options of these names."""
    model_id: str
    """The weights of the smear network."""
    timings_s: dict[str, float] | None
    """Seconds per step: read, predict, select, solve; null with --no-timings."""

    @classmethod
    def of(cls, one: FileEstimate) -> EstimateDocument:
        """Return the document of one photograph."""
        from blur2view.results.verdicts import verdict_of

        estimate, geometry, (height, width) = one.estimate, one.estimate.geometry, one.estimate.grid.shape
        table, camera = geometry.table, estimate.camera
        figures = "parameters", "log_likelihood", "probability"
        stated = {
            "image": str(one.path),
            "width": width,
            "height": height,
            "meaning": verdict_of(one),
            "blur": estimate.blur.kind,
            "plane_probability": table.probability(MotionModel.PLANE, MotionModel.ROLLING_PLANE),
            "models": {str(row.model): {name: getattr(row, name) for name in figures} for row in table.rows},
            "independent_smears": table.effective_count,
            "motion_model": geometry.model,
            "K": None if camera is None else camera.K,
            "camera": part(camera, "model", "params", "source", "known"),
            "E": geometry.E,
            "time_known": estimate.time.known,
            "time_confidence": estimate.time.confidence,
            "backward": backward_of(geometry.backward, one),
            "num_matches": len(estimate.matches),
            "num_inliers": int(geometry.inlier_mask.sum()),
        }
        stated |= pose_of(geometry, one)
        run = one.run
        return cls.gathered(one, geometry, estimate, estimate.blur, run, run.select, run.options, **stated)


def pose_of(geometry: TwoViewGeometry, one: FileEstimate) -> dict[str, Any]:
    """Return the pose of documents, its angle, its rate (see `rate_of`) and its covariance, None without."""
    pose = geometry.cam2_from_cam1
    return rate_of(geometry, one) | {
        "cam2_from_cam1": part(pose, "rotation", "translation"),
        "rotation_deg": None if pose is None else pose.angle_deg,
        "pose_covariance": part(geometry.covariance, *COVARIANCE),
    }


def backward_of(geometry: TwoViewGeometry | None, one: FileEstimate) -> dict[str, Any] | None:
    """Return the pose of the other order in time, None where that has the inverse pose or none."""
    if geometry is None or geometry.cam2_from_cam1 is None or geometry.covariance is None:
        return None
    values = pose_of(geometry, one) | {"config": geometry.config.name}
    return {name: values[name] for name in BACKWARD}


def rate_of(geometry: TwoViewGeometry, one: FileEstimate) -> dict[str, Any]:
    """Return wx to sigma_wz and rate_unit of tables and documents: None, and no unit, without a pose.

    The angular velocity, or without an exposure time the rotation vector; that of a gyroscope, if the
    options say so.
    """
    velocity = geometry.angular_velocity(one.exposure_s or 1.0)
    if velocity is None:
        return dict.fromkeys(RATES) | {"rate_unit": ""}
    velocity = velocity.of_gyroscope if one.run.gyroscope else velocity
    rates = dict(zip(RATES, [*velocity.mean.tolist(), *velocity.sigma.tolist()], strict=True))
    return rates | {"rate_unit": PER_SECOND if one.exposure_s else RADIANS}
