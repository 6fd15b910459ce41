"""Results in JSON's types come back as they were."""

import json
from dataclasses import replace
from typing import Any

import numpy as np

from blur2view.camera.camera import Camera
from blur2view.exposure.views import ExposureViews
from blur2view.geometry.pose import PoseCovariance, RigidTransform
from blur2view.geometry.two_view_geometry import Configuration, MotionModel, TimeDirection, TwoViewGeometry
from blur2view.input_files import parse_json
from blur2view.results.stored import plain, restore

MASK = np.array([True, False])
GEOMETRY = TwoViewGeometry(
    F=np.arange(9.0).reshape(3, 3).T,  # not contiguous
    config=Configuration.CALIBRATED,
    reason="r",
    inlier_mask=MASK,
    swapped=~MASK,
    scores=((MotionModel.GENERAL, np.float64(3.5)),),
    cam2_from_cam1=RigidTransform(rotation=np.eye(3), translation=np.array([0.0, 0, 1])),
    covariance=PoseCovariance(matrix=np.eye(5), tangents=np.eye(3)[:2]),
)
VIEWS = ExposureViews(
    name="a\udcff.jpg",
    size=(4, 5),
    points_open=np.ones((2, 2)) / 3,
    points_close=np.zeros((2, 2)),
    sigma_px=np.ones(2),
    geometry=GEOMETRY,
    camera=Camera.from_focal(3.0, (4, 5)),
    time=TimeDirection(known=True, confidence=0.5),
)


def through_json(value: Any) -> Any:
    """Return a value as a file gives it."""
    return parse_json(json.dumps(plain(value)))


def test_dataclasses_arrays_and_enums_come_back_as_they_were() -> None:
    back = restore(ExposureViews, through_json(VIEWS))
    assert back.geometry.config is Configuration.CALIBRATED
    assert back.size == (4, 5) and back.name == VIEWS.name
    assert back.geometry.scores == GEOMETRY.scores and back.time == VIEWS.time and back.geometry.H is None
    np.testing.assert_array_equal(back.geometry.F, GEOMETRY.F)
    np.testing.assert_array_equal(back.geometry.inlier_mask, MASK)
    assert json.dumps(plain(back)) == json.dumps(plain(VIEWS))
    back.points_open[0] = 7  # which can be written
    empty = replace(VIEWS, points_open=np.zeros((0, 2)), points_close=np.zeros((0, 2)), sigma_px=np.zeros(0))
    assert restore(ExposureViews, through_json(empty)).points_open.shape == (0, 2)
