"""transforms.json read back as its readers do, against pycolmap and the truth of a made-up video."""

from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest

from blur2view.arrays import Array
from blur2view.colmap import transforms
from blur2view.colmap.models import read_model
from blur2view.errors import DatabaseError
from tests.support.walks import Walk

EXPOSURE_S = 0.02
ENDS = ("#open", "", "#close")
NAMES = [f"frame_{k:03d}.png" for k in range(3)]
# a picture every third of a frame: exposures of two thirds of a frame interval each
WALK = Walk(
    names=[f"{name}{end}" for name in NAMES for end in ENDS],
    size=(96, 64),
    focal=90.0,
    turn=np.array([0.002, -0.005, 0.007]),
    move=-np.array([0.02, 0.005, 0.01]),
)
POSES = np.array([WALK.pose_at(k) for k in range(9)]).reshape(3, 3, 3, 4)  # of frames at open, middle, close


GRID = np.stack(np.meshgrid(np.arange(1.5, 96, 4), np.arange(1.5, 64, 4)), -1).reshape(-1, 2)
DEPTH = 1 + 0.3 * np.sin(GRID[:, :1] / 20) * np.cos(GRID[:, 1:] / 15)  # of a wall before the middle frame
POINTS = np.column_stack([(GRID - (47.5, 31.5)) / WALK.focal, np.ones(len(GRID))]) * DEPTH
SMEARS = [WALK.pixels(last, POINTS) - WALK.pixels(first, POINTS) for first, _, last in POSES]  # (N, 2)
SMEAR_PX = [float(np.median(np.linalg.norm(smears, axis=1))) for smears in SMEARS]


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of photographs and models: of photographs and views, of photographs alone."""
    folder = tmp_path_factory.mktemp("video")
    (folder / "images").mkdir()
    for name in NAMES:
        (folder / "images" / name).touch()
    ends = {"model": range(9), "sharp": [1, 4, 7]}
    WALK.write(POINTS, folder / "video.db", {folder / name: of for name, of in ends.items()})
    return folder


def content_of(folder: Path, **options: Any) -> dict[str, Any]:
    """Return the content of the file of a model's folder."""
    model = read_model(folder)
    return transforms.transforms_content(model, folder, transforms.exposed_images(model, folder), **options)


def opengl_pixels(content: dict[str, Any], camera: Array) -> Array:
    """Return COLMAP's pixels of points (N, 3) in a camera that looks along its negative z, y up."""
    focal, centre = ([content[f"{name}{axis}"] for axis in "xy"] for name in ("fl_", "c"))
    return np.asarray(camera[:, :2] / -camera[:, 2:] * [1, -1] * focal + centre)


def in_camera(world_from_camera: Any, world: Array) -> Array:
    """Return points (N, 3) of the world in a camera."""
    return (np.linalg.inv(world_from_camera) @ np.column_stack([world, np.ones(len(world))]).T).T[:, :3]


def test_every_matrix_projects_as_pycolmap_does_and_sharpness_is_that_of_the_true_smears(video: Path) -> None:
    content = content_of(video / "model")
    model = pycolmap.Reconstruction(video / "model")
    keys = ("transform_matrix_start", "transform_matrix", "transform_matrix_end")
    assert content["rolling_shutter"] == [0, 0, 0, 1] and min(SMEAR_PX) > 2
    middle = np.median(content["scale"] * POINTS + content["offset"], axis=0)  # in instant-ngp's unit cube
    np.testing.assert_allclose(middle, 0.5, atol=1e-9)
    for name, frame, smear_px in zip(NAMES, content["frames"], SMEAR_PX, strict=True):
        for key, end in zip(keys, ENDS, strict=True):
            image = model.find_image_with_name(name + end)
            expected = np.array([image.project_point(point) for point in POINTS])
            ours = opengl_pixels(content, in_camera(frame[key], POINTS))
            np.testing.assert_allclose(ours, expected, atol=1e-8)
        assert frame["sharpness"] == pytest.approx(1 / (1 + smear_px))


def test_velocities_over_the_exposure_draw_the_true_smears(video: Path) -> None:
    content = content_of(video / "model", dialect="nerfstudio", exposure_s=EXPOSURE_S)
    assert content["exposure_time"] == EXPOSURE_S and content["rolling_shutter_time"] == 0
    for frame, smears, smear_px in zip(content["frames"], SMEARS, SMEAR_PX, strict=True):
        camera = in_camera(frame["transform_matrix"], POINTS)
        linear, angular = (np.array(frame[f"camera_{kind}_velocity"]) for kind in ("linear", "angular"))
        # a point at rest moves against the camera's motion
        moved = -(linear + np.cross(angular, camera)) * content["exposure_time"]
        drawn = opengl_pixels(content, camera + moved / 2) - opengl_pixels(content, camera - moved / 2)
        assert np.median(np.linalg.norm(drawn - smears, axis=1)) < 0.02 * smear_px


@pytest.mark.parametrize(
    ("kind", "params", "expected"),
    [
        ("SIMPLE_RADIAL", [50, 48, 32, 0.1], {"fl_x": 50, "fl_y": 50, "k1": 0.1, "k2": 0, "p1": 0, "p2": 0}),
        ("SIMPLE_FISHEYE", [50, 48, 32], {"is_fisheye": True, "fl_x": 50, "fl_y": 50, "k1": 0, "k4": 0}),
        ("OPENCV_FISHEYE", [50, 51, 48, 32, 0.1, 0.2, 0.3, 0.4], {"is_fisheye": True, "k4": 0.4}),
    ],
)
def test_lens_keeps_its_numbers(
    video: Path, tmp_path: Path, kind: str, params: list[float], expected: dict[str, Any]
) -> None:
    content = content_of(with_camera(video, tmp_path, kind, params))
    assert {key: content[key] for key in expected} == expected
    assert (content["w"], content["h"], content["cx"], content["cy"]) == (96, 64, 48, 32)
    assert ("p1" in content) != content.get("is_fisheye", False)  # instant-ngp reads p1 into k3's place


def with_camera(video: Path, folder: Path, kind: str, params: list[float]) -> Path:
    """Return a copy of the model whose camera is another."""
    model = pycolmap.Reconstruction(video / "model")
    camera = model.cameras[1]
    camera.model = pycolmap.CameraModelId.__members__[kind]
    camera.params = params
    (folder / "model").mkdir()
    model.write(folder / "model")
    return folder / "model"


def test_names_lead_nowhere_else(video: Path, tmp_path: Path) -> None:
    model = pycolmap.Reconstruction(video / "model")
    model.images[2].name = "../victim/f001.jpg"
    (tmp_path / "model").mkdir()
    model.write(tmp_path / "model")
    with pytest.raises(DatabaseError, match=r"image \.\./victim/f001\.jpg lies outside of the folder"):
        content_of(tmp_path / "model")


def test_what_cannot_be_written_is_one_line(video: Path, tmp_path: Path) -> None:
    with pytest.raises(DatabaseError, match=r"sharp: no photograph has both of its views.*blur2view place"):
        content_of(video / "sharp")
    with pytest.raises(DatabaseError, match="absent: no such folder; name the folder with cameras.bin"):
        content_of(tmp_path / "absent")
    with pytest.raises(DatabaseError, match="has no COLMAP model; name the folder with cameras.bin"):
        content_of(tmp_path)
    with pytest.raises(DatabaseError, match="FOV, which this trainer does not know.*undistort"):
        content_of(with_camera(video, tmp_path, "FOV", [50, 51, 48, 32, 0.1]))
