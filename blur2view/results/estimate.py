"""The document of ``blur2view estimate``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from blur2view.results.document import Document, FailureDocument, Matrix
from blur2view.results.pose import BackwardDocument, CameraDocument, CovarianceDocument, PoseDocument, rate_of

if TYPE_CHECKING:
    from blur2view.pipeline import FileEstimate


@dataclass(frozen=True, kw_only=True)
class EstimateDocument(Document):
    """The document of one photograph of ``blur2view estimate``; null where there is no such value.

    Parameters
    ----------
    image : str
        The photograph as it was named.
    width, height : int
        Its size in pixels, upright.
    frame : int or null
        Number of the frame in its video, from 0.
    timestamp_s : float or null
        Its time in the video, seconds.
    F : 3x3 or null
        Fundamental matrix, points2^T F points1 = 0, of Frobenius norm 1; 1 is shutter-open, 2 is
        shutter-close, or the reverse: one photograph does not show the direction of time, so F and its
        transpose are one answer. With lens distortion F, H and E hold for undistorted pixels.
    H : 3x3 or null
        Homography of the same points, points2 ~ H points1, where one explains the smears; beside F parallax
        is undecided.
    config : str
        The configuration, a name of COLMAP's TwoViewGeometryConfiguration.
    meaning : str
        What it says of the camera, in words: the line that is printed.
    parallax : str
        Whether the smears show things at different depths: proven (UNCALIBRATED, CALIBRATED), undecided (F
        may be of errors only, or too little is seen) or absent (H alone, or nothing moved).
    reason : str
        One sentence with the figures that decided. Smears agree with F if their ends lie within a tenth of
        their length, or within a standard deviation, of their epipolar lines.
    motion_model : str
        The family of motions that F is from (translation, camera, general, calibrated), without F that of H
        (rotation, plane, rotation or plane), else none.
    scores : object
        The penalised cost of every family that was fitted; the lowest explains the smears best.
    support : float
        Share of the smears that are inliers of F, without F of H: num_inliers over num_matches.
    K : 3x3 or null
        Calibration matrix of the intrinsics that were used, in pixels with (0, 0) at the centre of the
        top-left one.
    camera : object or null
        These intrinsics as COLMAP has them: model, params (in COLMAP's pixels), source, known.
    E : 3x3 or null
        Essential matrix of known intrinsics.
    cam2_from_cam1 : object or null
        Pose of known intrinsics: rotation (3x3) and translation (unit length or zero), or its inverse. Where
        neither parallax is proven nor the direction of the translation known to 30 degrees it is zero, and
        the rotation the one that explains the smears alone, or the mean over all directions.
    rotation_deg : float or null
        Angle of that rotation, degrees.
    wx, wy, wz : float or null
        Rotation vector of cam2_from_cam1 over the exposure time, radians per second, or where no exposure
        time is known the rotation vector itself, radians, about the camera's axes x (right), y (down) and z
        (forwards), with known intrinsics. A gyroscope, which turns with the camera, shows the negative. The
        sign of all three is that of time: see time_known.
    sigma_wx, sigma_wy, sigma_wz : float or null
        Their standard deviations.
    rate_unit : str
        rad/s or rad; empty without a pose.
    time_known : bool
        Whether neighbouring frames, of a video or with --sequence, decided which end of the exposure came
        first: else F, H, E, the pose, wx, wy, wz and the order of every smear may all be of the reverse.
    time_confidence : float
        How sure that decision is, 0 to 1.
    pose_covariance : object or null
        Covariance of the pose: matrix (5x5: rotation vector in radians, translation's direction along two
        tangents), tangents, rotation_sigma_deg, translation_sigma_deg (43 for a direction that is unknown).
    exposure_s : float or null
        Exposure time in seconds, from --exposure or EXIF.
    readout_s : float or null
        From --readout: all is then that of an exposure of all rows at once.
    backward : object or null
        With --readout the same of the other order in time, which is another motion than the inverse:
        config, cam2_from_cam1, rotation_deg, wx, wy, wz, pose_covariance; null where the rows
        leave no such smears in that order, or it has no pose.
    num_matches : int
        Smears that were used.
    num_inliers : int
        Smears that fit, see --max-error.
    iterations : int
        Random samples that were drawn.
    beta, max_error_px, seed : number
        The options of these names.
    model_id : str
        The weights of the smear network.
    timings_s : object or null
        Seconds per step: read, predict, select, solve; null with --no-timings.
    """

    image: str
    width: int
    height: int
    frame: int | None
    timestamp_s: float | None
    F: Matrix | None
    H: Matrix | None
    config: str
    meaning: str
    parallax: str
    reason: str
    motion_model: str
    scores: dict[str, float]
    support: float
    K: Matrix | None
    camera: CameraDocument | None
    E: Matrix | None
    cam2_from_cam1: PoseDocument | None
    rotation_deg: float | None
    wx: float | None
    wy: float | None
    wz: float | None
    sigma_wx: float | None
    sigma_wy: float | None
    sigma_wz: float | None
    rate_unit: str
    time_known: bool
    time_confidence: float
    pose_covariance: CovarianceDocument | None
    exposure_s: float | None
    readout_s: float | None
    backward: BackwardDocument | None
    num_matches: int
    num_inliers: int
    iterations: int
    beta: float
    max_error_px: float
    seed: int
    model_id: str
    timings_s: dict[str, float] | None

    @classmethod
    def of(cls, one: FileEstimate) -> EstimateDocument:
        """Return the document of one photograph."""
        from blur2view.results.verdicts import meaning

        estimate, geometry, (height, width) = one.estimate, one.estimate.geometry, one.estimate.grid.shape
        pose, covariance = geometry.cam2_from_cam1, geometry.covariance
        return cls(
            image=str(one.path),
            width=width,
            height=height,
            frame=one.frame,
            timestamp_s=one.timestamp_s,
            F=None if geometry.F is None else geometry.F.tolist(),
            H=None if geometry.H is None else geometry.H.tolist(),
            config=geometry.config.name,
            meaning=meaning(one),
            parallax=str(geometry.parallax),
            reason=geometry.reason,
            motion_model=str(geometry.model),
            scores={str(name): cost for name, cost in geometry.scores},
            support=geometry.support,
            K=None if estimate.camera is None else estimate.camera.K.tolist(),
            camera=None if estimate.camera is None else CameraDocument.of(estimate.camera),
            E=None if pose is None or geometry.E is None else geometry.E.tolist(),
            cam2_from_cam1=None if pose is None else PoseDocument.of(pose),
            rotation_deg=None if pose is None else pose.angle_deg,
            **rate_of(geometry, one.exposure_s),
            time_known=estimate.time.known,
            time_confidence=estimate.time.confidence,
            pose_covariance=None if pose is None or covariance is None else CovarianceDocument.of(covariance),
            exposure_s=one.exposure_s,
            readout_s=one.run.readout_s,
            backward=BackwardDocument.of(one),
            num_matches=len(estimate.matches),
            num_inliers=int(geometry.inlier_mask.sum()),
            iterations=geometry.iterations,
            beta=one.run.select.beta,
            max_error_px=one.run.options.max_error_px,
            seed=one.run.seed,
            model_id=estimate.model_id,
            timings_s=one.timings_s,
        )


@dataclass(frozen=True, kw_only=True)
class EstimatesDocument(Document):
    """What ``blur2view estimate --json`` prints.

    Parameters
    ----------
    estimates : list
        One document per photograph.
    failures : list
        Photographs that failed: image, error.
    """

    estimates: list[EstimateDocument]
    failures: list[FailureDocument]
