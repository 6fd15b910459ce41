"""The sign of the translation, which F and E leave ambiguous: a photograph's views with either sign."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from blur2view.exposure.end_order import MotionOrder, motion_order
from blur2view.exposure.views import ExposureViews, in_order
from blur2view.geometry.pose import RigidTransform, before_both
from blur2view.smears.matches import SmearMatches


def share_in_front(views: ExposureViews) -> float:
    """Return the share of the inliers in front of both cameras (cheirality); 0 without a translation."""
    geometry, camera, pose = views.geometry, views.camera, views.geometry.cam2_from_cam1
    if pose is None or not pose.translation.any() or camera is None or not geometry.inlier_mask.any():
        return 0.0
    rays = (camera.rays(points[geometry.inlier_mask]) for points in (views.points_open, views.points_close))
    return float(before_both(pose, *rays).mean())


def other_translation(views: ExposureViews) -> ExposureViews | None:
    """Return the views with the translation reversed and the rotation kept: smears are ordered anew.

    None without F, and where the pose is a rotation alone. Both have the same F and E, which fix the
    translation but for its sign.
    """
    geometry = views.geometry
    if geometry.F is None:
        return None
    ends = np.stack([views.points_open, views.points_close], axis=1)
    matches = SmearMatches(ends=ends, sigma_px=np.maximum(views.sigma_px, 1e-3))
    order = motion_order(geometry, matches, views.camera, views.size)
    if order.pose is None or not order.pose.translation.any():
        return None
    pose = RigidTransform(rotation=order.pose.rotation, translation=-order.pose.translation)
    swapped = MotionOrder(geometry=geometry, camera=order.camera, pose=pose).swapped(ends, matches.sampson_px)
    points_open, points_close = in_order(ends, swapped)
    known, covariance = geometry.cam2_from_cam1, geometry.covariance
    if known is not None and known.translation.any():
        known = pose
    if covariance is not None:
        covariance = replace(covariance, tangents=-covariance.tangents)
    return replace(
        views,
        points_open=points_open,
        points_close=points_close,
        geometry=replace(
            geometry,
            E=None if geometry.E is None else -geometry.E,
            cam2_from_cam1=known,
            covariance=covariance,
            swapped=geometry.swapped ^ swapped,
        ),
    )
