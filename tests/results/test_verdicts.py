"""Verdicts in words: short, right about what is known, and the same everywhere."""

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from blur2view.geometry.pose import PoseCovariance, RigidTransform
from blur2view.geometry.rotation import plane_basis, rotation_matrix
from blur2view.geometry.two_view_geometry import Configuration, TwoViewGeometry
from blur2view.results.report import Entry
from blur2view.results.verdicts import verdict
from blur2view.smears.blur import Blur, BlurKind
from blur2view.smears.matches import SmearMatches
from tests.support.calls import Call
from tests.support.report_scenes import made_up

SIZE = (641, 481)
MOVED = Blur(kind=BlurKind.CAMERA_MOVED)
MIDDLE = np.array([320.0, 240.0])
F, H = np.eye(3), np.eye(3)
SIDEWAYS, FORWARD = np.array([1.0, 0.0, 0.0]), np.array([0.2, 0.1, -1.0])
YAW, ROLL = np.array([0.0, 0.0837758, 0.0]), np.array([0.0, 0.0, 0.05])  # 4.8 and 2.9 degrees


def smears(displacement: Any, **more: Any) -> SmearMatches:
    """Return smears all over a picture, each of its own displacement at a point, either way round."""
    points = np.stack(np.meshgrid(np.arange(20, 620, 60.0), np.arange(20, 460, 60.0)), -1).reshape(-1, 2)
    d = np.broadcast_to(displacement(points) if callable(displacement) else displacement, points.shape)
    d = np.where(np.arange(len(d)) % 2, 1.0, -1.0)[:, None] * d
    matches = SmearMatches.from_points(points - d / 2, points + d / 2, image_size=SIZE)
    return replace(matches, **more)


def turning(points: np.ndarray[Any, Any]) -> Any:
    return 0.05 * (points - MIDDLE)[:, ::-1] * [-1, 1]


def geometry(
    config: str, F: Any = None, H: Any = None, rotation: Any = None, t: Any = None, **more: Any
) -> TwoViewGeometry:
    """Return a geometry that all smears fit, with a pose if a rotation vector is given."""
    pose = covariance = None
    if rotation is not None:
        t = np.zeros(3) if t is None else t / np.linalg.norm(t)
        pose = RigidTransform(rotation=rotation_matrix(rotation), translation=t)
        matrix = np.diag(np.radians([0.3, 0.3, 0.3, 12, 12]) ** 2)
        covariance = PoseCovariance(matrix=matrix, tangents=plane_basis(t if t.any() else SIDEWAYS))
    count = len(smears([1, 0]))
    return TwoViewGeometry(
        F=F, H=H, config=Configuration(config), reason="", inlier_mask=np.ones(count, bool),
        swapped=np.zeros(count, bool), cam2_from_cam1=pose, covariance=covariance, **more,
    )  # fmt: skip


def turned_by(rotation: Any) -> Any:
    """Return the homography of a rotation vector for a focal length of 800 pixels."""
    K = np.array([[800.0, 0, 320], [0, 800, 240], [0, 0, 1]])
    return K @ rotation_matrix(np.asarray(rotation)) @ np.linalg.inv(K)


PAN, ROLLED = turned_by([0, 0.04, 0]), turned_by(ROLL)
NOTHING = geometry("DEGENERATE")
CASES = {
    "Turned or moved, the same blur everywhere: cannot tell": (NOTHING, smears([3, 0])),
    "Too little blur to tell": (NOTHING, smears(turning)),
    "Blur that no one motion explains: cannot tell": (geometry("UNDEFINED"), smears([9, 0])),
    "Several motions: parts of the picture move differently": (geometry("MULTIPLE", F), smears([9, 0])),
    "Camera turned sideways by 5 % of the width": (geometry("PANORAMIC", None, PAN), smears([32, 0])),
    "Camera turned sideways by 4.8 +/- 0.3 degrees": (
        geometry("PANORAMIC", None, turned_by(YAW), YAW), smears([32, 0])
    ),
    "Camera moved past something flat; blur 1.4 % of the width, up or down": (
        geometry("PLANAR", None, H), smears([1, 9])
    ),
    "Camera moved sideways (+/- 12 degrees), turned by 4.8 +/- 0.3 degrees, parallax undecided": (
        geometry("PLANAR", F, H, YAW, SIDEWAYS), smears([9, 0])
    ),
    "Turned by 5 % of the width or moved past something flat: cannot tell": (
        geometry("PLANAR_OR_PANORAMIC", None, H), smears([32, 0])
    ),
    "Camera moved past near and far things; blur 1.4 % of the width, sideways": (
        geometry("UNCALIBRATED", F), smears([9, 0])
    ),
    "Camera moved forward or back (+/- 12 degrees), turned by 4.8 +/- 0.3 degrees": (
        geometry("CALIBRATED", F, None, YAW, FORWARD), smears([9, 0])
    ),
}  # fmt: skip


@pytest.mark.parametrize("expected", CASES)
def test_the_sentence_says_what_is_known_and_no_more(expected: str) -> None:
    given, matches = CASES[expected]
    assert verdict(MOVED, given, matches, SIZE) == expected
    assert verdict(MOVED, given.reversed(), matches, SIZE) == expected  # time has no arrow
    assert len(f"{expected} [{given.config.name}]") <= 100


@pytest.mark.parametrize(
    ("rotation", "way"),
    [((0, 0.035, 0.044), "turned sideways"), ((0.02, 0, 0.05), "rolled"), ((0.03, 0.0, 0.04), "turned up")],
)
def test_a_roll_is_what_moves_the_corners_more_than_the_middle_also_without_a_focal_length(
    rotation: Any, way: str
) -> None:
    H = turned_by(rotation)  # at 400 pixels from the middle a roll moves half as far as a pan of its angle
    for pose in (None, np.array(rotation)):
        for smear in ([32, 0], turning):
            expected = verdict(MOVED, geometry("PANORAMIC", None, H, pose), smears(smear), SIZE)
            assert expected.startswith(f"Camera {way}")


def test_terminal_files_table_and_report_say_the_same(
    run: Call, moving: Path, still: Path, tmp_path: Path
) -> None:
    words = ("--focal", 300, "--exposure", "40ms", "-o", tmp_path / "out", "--csv", tmp_path / "t.csv")
    lines = run(moving, still, *words).out.splitlines()
    with (tmp_path / "t.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    for path, line, row in zip((moving, still), lines[:2], rows, strict=True):
        document = json.loads((tmp_path / "out" / f"{path.stem}.json").read_text())
        assert line == f"{path}: {document['meaning']} [{document['config']}]"
        assert row["meaning"] == document["meaning"]
    assert "rad/s" in lines[0] and "Sharp" in lines[1]
    one = made_up(F=F)
    found = one.estimate
    expected = verdict(found.blur, found.geometry, found.matches, found.grid.size)
    assert Entry.of(one).text == expected
