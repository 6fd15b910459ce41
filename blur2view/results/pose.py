"""What documents and tables hold of a camera, of its pose and of how fast it turned."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from blur2view.results.document import Document, Matrix

if TYPE_CHECKING:
    from blur2view.camera.camera import Camera
    from blur2view.geometry.pose import PoseCovariance, RigidTransform
    from blur2view.geometry.two_view_geometry import TwoViewGeometry
    from blur2view.pipeline import FileEstimate

PER_SECOND, RADIANS = "rad/s", "rad"
RATES = "wx", "wy", "wz", "sigma_wx", "sigma_wy", "sigma_wz"


@dataclass(frozen=True, kw_only=True)
class CameraDocument(Document):
    """The intrinsics that were used.

    Parameters
    ----------
    model : str
        COLMAP's name of the camera model.
    params : list of float
        COLMAP's parameters of the model, in COLMAP's pixels: its principal point is half a pixel more than
        that of K.
    source : str
        Where they are from (focal, camera string, database or exif) and what was done since.
    known : bool
        Whether they are taken for true; otherwise they are a hint, and nothing is called calibrated.
    """

    model: str
    params: list[float]
    source: str
    known: bool

    @classmethod
    def of(cls, camera: Camera) -> CameraDocument:
        """Return the document of a camera."""
        return cls(model=camera.model, params=list(camera.params), source=camera.source, known=camera.known)


@dataclass(frozen=True, kw_only=True)
class PoseDocument(Document):
    """The pose of the close camera from the open one, X2 = R X1 + t, or its inverse: time is not observed.

    Parameters
    ----------
    rotation : 3x3
        The rotation matrix R.
    translation : list of 3 float
        The vector t, of unit length; zero where neither parallax is proven nor its direction known to 30
        degrees.
    """

    rotation: Matrix
    translation: list[float]

    @classmethod
    def of(cls, pose: RigidTransform) -> PoseDocument:
        """Return the document of a pose."""
        return cls(rotation=pose.rotation.tolist(), translation=pose.translation.tolist())


@dataclass(frozen=True, kw_only=True)
class CovarianceDocument(Document):
    """The covariance of the pose.

    Parameters
    ----------
    matrix : 5x5
        Of the rotation vector in radians, then of the translation's direction along both tangents.
    tangents : list of 2 rows
        Two unit vectors at right angles to the translation.
    rotation_sigma_deg : list of 3 float
        Standard deviations of the rotation vector, degrees.
    translation_sigma_deg : float
        Standard deviation of the translation's direction, degrees.
    """

    matrix: Matrix
    tangents: Matrix
    rotation_sigma_deg: list[float]
    translation_sigma_deg: float

    @classmethod
    def of(cls, covariance: PoseCovariance) -> CovarianceDocument:
        """Return the document of a covariance."""
        return cls(
            matrix=covariance.matrix.tolist(),
            tangents=covariance.tangents.tolist(),
            rotation_sigma_deg=covariance.rotation_sigma_deg.tolist(),
            translation_sigma_deg=covariance.translation_sigma_deg,
        )


@dataclass(frozen=True, kw_only=True)
class BackwardDocument(Document):
    """The pose of the other order in time, as that of the first.

    Parameters
    ----------
    config : str
        The configuration.
    cam2_from_cam1 : object
        Rotation and translation.
    rotation_deg : float
        Angle of the rotation, degrees.
    wx, wy, wz : float
        Its rotation vector over the exposure time, or where none is known alone.
    pose_covariance : object
        Covariance of the pose.
    """

    config: str
    cam2_from_cam1: PoseDocument
    rotation_deg: float
    wx: float
    wy: float
    wz: float
    pose_covariance: CovarianceDocument

    @classmethod
    def of(cls, one: FileEstimate) -> BackwardDocument | None:
        """Return the document of a photograph, None where the other order has the inverse pose or none."""
        geometry = one.estimate.geometry.backward
        if geometry is None or geometry.cam2_from_cam1 is None or geometry.covariance is None:
            return None
        wx, wy, wz = (geometry.cam2_from_cam1.rotation_vector / (one.exposure_s or 1.0)).tolist()
        return cls(
            config=geometry.config.name,
            cam2_from_cam1=PoseDocument.of(geometry.cam2_from_cam1),
            rotation_deg=geometry.cam2_from_cam1.angle_deg,
            wx=wx,
            wy=wy,
            wz=wz,
            pose_covariance=CovarianceDocument.of(geometry.covariance),
        )


def rate_of(geometry: TwoViewGeometry, exposure_s: float | None) -> dict[str, Any]:
    """Return wx to sigma_wz and rate_unit of tables and documents: None, and no unit, without a pose.

    The angular velocity, or without an exposure time the rotation vector.
    """
    from blur2view.pipeline import angular_velocity

    velocity = angular_velocity(geometry, exposure_s or 1.0)
    if velocity is None:
        return dict.fromkeys(RATES) | {"rate_unit": ""}
    rates = dict(zip(RATES, [*velocity.mean.tolist(), *velocity.sigma.tolist()], strict=True))
    return rates | {"rate_unit": PER_SECOND if exposure_s else RADIANS}
