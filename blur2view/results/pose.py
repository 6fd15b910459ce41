"""What documents and tables hold of a pose, and of how fast it turned."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from blur2view.results.document import part

if TYPE_CHECKING:
    from blur2view.geometry.two_view_geometry import TwoViewGeometry
    from blur2view.pipeline import FileEstimate

PER_SECOND, RADIANS = "rad/s", "rad"
RATES = "wx", "wy", "wz", "sigma_wx", "sigma_wy", "sigma_wz"
BACKWARD = "config", "cam2_from_cam1", "rotation_deg", "wx", "wy", "wz", "pose_covariance"
COVARIANCE = "matrix", "tangents", "rotation_sigma_deg", "translation_sigma_deg"


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
