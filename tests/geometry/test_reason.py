"""Reasons: one sentence for every fact that can decide on a configuration."""

from typing import Any

import numpy as np
import pytest

from blur2view.geometry.configuration import Cause, Configuration, ModelRow, MotionModel, Refusal, Support
from blur2view.geometry.pose import RigidTransform
from blur2view.geometry.two_view_geometry import TwoViewGeometry

SUPPORT = Support(num_inliers=199, count=200, by_chance=0.084)
FIT = "99 % of 200 smears fit F, and 8 % would by chance"
ROWS = tuple(
    ModelRow(model=model, parameters=3, log_likelihood=0.0, probability=probability)
    for model, probability in ((MotionModel.PARALLAX, 0.9), (MotionModel.PLANE, 0.1))
)
TABLE = "(parallax 0.90, plane 0.10)"
TURNED, MOVED = (
    RigidTransform(rotation=np.eye(3), translation=np.array(t)) for t in ([0.0, 0, 0], [1.0, 0, 0])
)


def geometry(config: str, **facts: Any) -> TwoViewGeometry:
    none = np.zeros(200, bool)
    given = {"F": None, "inlier_mask": none, "second_end_is_open": none} | facts
    return TwoViewGeometry(config=Configuration(config), **given)


def refused(cause: Cause, value: float = 0.0, limit: float = 0.0, blur: str = "") -> TwoViewGeometry:
    refusal = Refusal(cause=cause, value=value, limit=limit, blur=blur)
    return geometry("DEGENERATE", refusal=refusal)


F = H = np.eye(3)
CASES = {
    "too few smears: 7 remain, but 20 are needed": refused(Cause.FEW_SMEARS, 7, 20),
    "no motion: the median smear is 0.42 px long, which is below 1.00 px": refused(
        Cause.SHORT_SMEARS, 0.42, 1
    ),
    "the smears cover 5 % of the image, and 8 % are needed; perhaps one object moves before a still camera": (
        refused(Cause.SMALL_PART, 0.05, 0.08)
    ),
    "all smears lie along one line, which determines neither F nor H": refused(Cause.ONE_LINE),
    "no motion: the smears are no longer than their errors": refused(Cause.WITHIN_ERRORS),
    "no motion of the camera is seen: sharp": refused(Cause.CAMERA_AT_REST, blur="sharp"),
    "no motion of the camera is seen: too dark": refused(Cause.NO_BLUR_SEEN, blur="too dark"),
    f"no motion {TABLE}; {FIT}": geometry("DEGENERATE", models=ROWS, support=SUPPORT),
    f"no single motion explains the smears {TABLE}": geometry("UNDEFINED", models=ROWS),
    f"parallax is proven {TABLE}; E was fitted to the known intrinsics": geometry(
        "CALIBRATED", F=F, models=ROWS, cam2_from_cam1=MOVED
    ),
    f"there is no parallax {TABLE}; the pose is the rotation that explains the smears alone": geometry(
        "PANORAMIC", H=H, models=ROWS, cam2_from_cam1=TURNED
    ),
    f"parallax is undecided because few smears follow F {TABLE}": geometry(
        "PLANAR", F=F, H=H, models=ROWS, few_follow_F=True
    ),
    "parallax is undecided; E was fitted to the known intrinsics; the pose is the mean rotation over all "
    "directions of translation; the rolling shutter excludes the other order in time": geometry(
        "PLANAR", F=F, H=H, cam2_from_cam1=TURNED, one_way=True
    ),
}


@pytest.mark.parametrize("expected", CASES)
def test_every_fact_has_its_sentence(expected: str) -> None:
    assert CASES[expected].reason == expected


def test_only_what_leaves_motion_open_is_no_still_camera() -> None:
    still = {cause for cause in Cause if refused(cause).stood_still}
    assert still == {Cause.SHORT_SMEARS, Cause.WITHIN_ERRORS, Cause.CAMERA_AT_REST}
    assert not geometry("UNDEFINED").stood_still


def test_a_geometry_is_printed_in_a_line() -> None:
    mask = np.arange(200) < 150
    found = geometry("PLANAR", F=F, H=H, inlier_mask=mask, support=SUPPORT)
    assert repr(found) == "<TwoViewGeometry PLANAR: F and H; 150 of 200 smears fit>"
