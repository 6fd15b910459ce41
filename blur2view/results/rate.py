"""How fast the camera turned, as the columns and keys that tables and documents share."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypedDict

if TYPE_CHECKING:
    from blur2view.geometry.two_view_geometry import TwoViewGeometry

PER_SECOND, RADIANS = "rad/s", "rad"


class Rate(TypedDict):
    """The angular velocity, or without an exposure time the rotation; nothing without a pose."""

    wx: float | None
    wy: float | None
    wz: float | None
    sigma_wx: float | None
    sigma_wy: float | None
    sigma_wz: float | None
    rate_unit: str


def rate_of(geometry: TwoViewGeometry, exposure_s: float | None) -> Rate:
    """Return the rate of a geometry's pose, and its unit."""
    from blur2view.pipeline import angular_velocity

    velocity = angular_velocity(geometry, exposure_s or 1.0)
    if velocity is None:
        mean, sigma, unit = [None] * 3, [None] * 3, ""
    else:
        mean, sigma = velocity.mean.tolist(), velocity.sigma.tolist()
        unit = PER_SECOND if exposure_s else RADIANS
    return Rate(
        wx=mean[0],
        wy=mean[1],
        wz=mean[2],
        sigma_wx=sigma[0],
        sigma_wy=sigma[1],
        sigma_wz=sigma[2],
        rate_unit=unit,
    )
