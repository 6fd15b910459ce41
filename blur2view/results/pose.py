"""What documents and tables hold of a camera, of its pose and of how fast it turned."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

from blur2view.results.document import Document, Matrix

if TYPE_CHECKING:
    from blur2view.geometry.two_view_geometry import TwoViewGeometry
    from blur2view.pipeline import FileEstimate

PER_SECOND, RADIANS = "rad/s", "rad"
RATES = "wx", "wy", "wz", "sigma_wx", "sigma_wy", "sigma_wz"


@dataclass(frozen=True, kw_only=True)
class CameraDocument(Document):
    """The intrinsics that were used."""

    model: str
    """COLMAP's name of the camera model."""
    params: list[float]
    """COLMAP's parameters of the model, in COLMAP's pixels: its principal point is half a pixel more than
    that of K."""
    source: str
    """Where they are from (focal, camera string, database or exif) and what was done since."""
    known: bool
    """Whether they are taken for true; otherwise they are a hint, and nothing is called calibrated."""


@dataclass(frozen=True, kw_only=True)
class PoseDocument(Document):
    """The pose of the close camera from the open one, X2 = R X1 + t, or its inverse: time is not observed."""

    rotation: Matrix
    """The rotation matrix R."""
    translation: list[float]
    """The vector t, of unit length; zero where neither parallax is proven nor its direction known to 30
    degrees."""


@dataclass(frozen=True, kw_only=True)
class CovarianceDocument(Document):
    """The covariance of the pose."""

    matrix: Matrix
    """Of the rotation vector in radians, then of the translation's direction along both tangents."""
    tangents: Matrix
    """Two unit vectors at right angles to the translation."""
    rotation_sigma_deg: list[float]
    """Standard deviations of the rotation vector, degrees."""
    translation_sigma_deg: float
    """Standard deviation of the translation's direction, degrees."""


@dataclass(frozen=True, kw_only=True)
class BackwardDocument(Document):
    """The pose of the other order in time, as that of the first."""

    config: str
    """The configuration."""
    cam2_from_cam1: PoseDocument
    """Rotation and translation."""
    rotation_deg: float
    """Angle of the rotation, degrees."""
    wx: float
    wy: float
    wz: float
    """Its rotation vector over the exposure time, or where none is known alone."""
    pose_covariance: CovarianceDocument
    """Covariance of the pose."""

    @classmethod
    def of(cls, one: FileEstimate) -> BackwardDocument | None:
        """Return the document of a photograph, None where the other order has the inverse pose or none."""
        geometry = one.estimate.geometry.backward
        if geometry is None or geometry.cam2_from_cam1 is None or geometry.covariance is None:
            return None
        values = pose_of(geometry, one) | {"config": geometry.config.name}
        return cls(**{field.name: values[field.name] for field in fields(cls)})


def pose_of(geometry: TwoViewGeometry, one: FileEstimate) -> dict[str, Any]:
    """Return the pose of documents, its angle, its rate (see `rate_of`) and its covariance, None without."""
    pose, covariance = geometry.cam2_from_cam1, geometry.covariance
    return rate_of(geometry, one) | {
        "cam2_from_cam1": PoseDocument.from_attributes(pose),
        "rotation_deg": None if pose is None else pose.angle_deg,
        "pose_covariance": CovarianceDocument.from_attributes(covariance),
    }


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
