"""Cameras of a focal length, a COLMAP string or database, OpenCV or EXIF: rays, and what is refused."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pycolmap
import pytest
from PIL import ExifTags

from blur2view.arrays import Array
from blur2view.camera import Camera, from_colmap, to_colmap
from blur2view.cli.options import CameraStated
from blur2view.colmap.project import camera_of_database
from blur2view.errors import CameraError
from blur2view.images.exif import EXIF_LOG_FOCAL, ExifValues, read_exif
from tests.support.colmap_projects import run_sql
from tests.support.scenes import distorted_points

SIZE = (640, 480)
RADIAL = "SIMPLE_RADIAL 640 480 525 320 240 0.05"
CAMERAS = [
    "SIMPLE_PINHOLE 640 480 525 320 240",
    RADIAL,
    "OPENCV_FISHEYE 640 480 525 520 320 240 0.05 -0.01 0.001 0.002",
    "FULL_OPENCV,640,480,525,520,320,240,0.05,-0.01,0.001,0.002,0.001,0,0,0",
]
POINTS = np.random.default_rng(0).uniform(0, [639, 479], (50, 2))


@pytest.fixture
def database(tmp_path: Path) -> Path:
    """Return a COLMAP database with two cameras, the second of the image walks/b.jpg."""
    path = tmp_path / "project.db"
    with pycolmap.Database.open(path) as opened:
        for k in (0.05, 0.1):
            camera = pycolmap.Camera(model="SIMPLE_RADIAL", width=640, height=480, params=[525, 320, 240, k])
            opened.write_camera(camera)
        opened.write_image(pycolmap.Image(name="walks/b.jpg", camera_id=2))
    return path


@pytest.mark.parametrize("text", CAMERAS)
def test_rays_are_pycolmaps_half_a_pixel_on_also_of_a_resized_picture(text: str) -> None:
    camera = Camera.from_string(text)
    model, *values = text.replace(",", " ").split()
    reference = pycolmap.Camera(model=model, width=640, height=480, params=list(map(float, values[2:])))
    rays = camera.rays(POINTS)
    np.testing.assert_allclose(rays, [reference.cam_from_img(p + 0.5) for p in POINTS], atol=1e-12)
    np.testing.assert_allclose(distorted_points(reference, rays), POINTS, atol=1e-6)
    ideal = np.linalg.inv(camera.K) @ np.c_[camera.undistorted(POINTS), np.ones(50)].T
    np.testing.assert_allclose(ideal[:2].T, rays, atol=1e-12)
    resized = camera.for_image((1280, 960))
    np.testing.assert_allclose(resized.rays(from_colmap(2 * to_colmap(POINTS))), rays, atol=1e-9)
    assert "scaled" in resized.source and camera.for_image(SIZE) is camera
    for size in ((480, 640), (640, 400)):
        with pytest.raises(CameraError, match="is for 640x480 pixels.* cropped, or turned"):
            camera.for_image(size)


def test_a_camera_without_rays_in_a_plane_is_refused_when_it_is_made() -> None:
    panorama = pycolmap.Camera.create_from_model_name(1, "EQUIRECTANGULAR", 1.0, 640, 480)
    with pytest.raises(CameraError, match="EQUIRECTANGULAR has no rays in a plane"):
        Camera(K=np.diag([525.0, 525, 1]), width=640, height=480, model="EQUIRECTANGULAR")
    with pytest.raises(CameraError, match="EQUIRECTANGULAR has no rays in a plane"):
        Camera.from_colmap(panorama, "database")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("nonsense", "is not MODEL WIDTH HEIGHT PARAMS"),
        ("SIMPLE_RADIAL 640 480 525 320 240", "SIMPLE_RADIAL has 4 numbers .f, cx, cy, k., got 3"),
        ("EQUIRECTANGULAR 640 480 640 480", "EQUIRECTANGULAR has no rays in a plane; known are .*RADIAL"),
        ("RADIAN 640 480 640 480", "RADIAN is an unknown model; did you mean RADIAL"),
        ("PINHOLE 640 480 nan 525 320 240", "finite"),
        ("PINHOLE 640 480 -525 525 320 240", "focal length must be"),
        ("PINHOLE 0 480 525 525 320 240", "positive"),
    ],
)
def test_a_wrong_camera_string_is_one_clear_line(text: str, words: str) -> None:
    with pytest.raises(CameraError, match=words) as caught:
        Camera.from_string(text)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("focal", [0.0, -1.0, np.nan, 1e300])
def test_a_focal_length_must_be_possible(focal: float) -> None:
    for make in (lambda: Camera.from_focal(focal, SIZE), lambda: CameraStated(focal=focal)):
        with pytest.raises(ValueError, match="focal length must be"):
            make()


def test_a_camera_that_a_database_has_not_or_that_is_none(database: Path) -> None:
    for camera_id, image, words in ((7, "", "no camera 7; it has"), (None, "a.jpg", "name one as")):
        with pytest.raises(CameraError, match=f"{database}: .*{words}"):
            camera_of_database(database, camera_id, image)
    run_sql(database, "PRAGMA foreign_keys = OFF", "UPDATE cameras SET model = 999")
    with pytest.raises(CameraError, match="update pycolmap"):
        camera_of_database(database, 1, "")


def test_options_choose_the_camera_and_exif_is_a_hint_without_them(database: Path) -> None:
    path, exif = Path("walks/b.jpg"), ExifValues(focal_px=600.0, focal_tags="FocalLengthIn35mmFilm")
    assert CameraStated().camera_for(path, SIZE, ExifValues()) is None
    hint = CameraStated().camera_for(path, SIZE, exif)
    assert hint is not None and not hint.known and hint.log_focal_sigma == EXIF_LOG_FOCAL
    for lens, focal_px, source in (
        (CameraStated(camera="exif"), 600, "exif (FocalLengthIn35mmFilm)"),
        (CameraStated(focal=525.0), 525, "focal"),
        (CameraStated(camera=str(database)), 525, "database, camera 2"),
        (CameraStated(camera=f"{database}:1"), 525, "database, camera 1"),
        (CameraStated(camera=RADIAL), 525, "camera string"),
    ):
        camera = lens.camera_for(path, SIZE, exif)
        assert camera is not None and camera.known and camera.source == source
        assert camera.focal_px == pytest.approx(focal_px)
    with pytest.raises(CameraError, match="EXIF states no focal length; give it"):
        CameraStated(camera="exif").camera_for(path, SIZE, ExifValues())


@pytest.mark.parametrize("count", [0, 4, 5, 8])
def test_camera_of_opencv_has_its_rays(count: int) -> None:
    K = np.array([[500.0, 0, 322.5], [0, 510.0, 238.0], [0, 0, 1]])
    dist = np.array([-0.2, 0.05, 1e-3, -2e-3, 0.01, 0.02, -0.01, 0.003])[:count]
    rays = np.random.default_rng(0).uniform(-0.5, 0.5, (40, 2))
    points = np.column_stack([rays, np.ones(40)])
    distorted = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, dist if count else None)[0]
    pixels: Array = np.asarray(distorted, float)[:, 0]
    found = Camera.from_opencv(K, dist[None] if count else None, SIZE)
    np.testing.assert_allclose(found.rays(pixels), rays, atol=1e-9)
    np.testing.assert_allclose(found.K, K)
    assert found.known and found.source == "opencv"


@pytest.mark.parametrize("stated", [1e-320, 5e-10, 0.0, -0.1, np.inf, np.nan])
def test_an_impossible_exposure_time_of_exif_is_none(stated: float) -> None:
    tags = {ExifTags.Base.ExposureTime.value: stated}
    exif = SimpleNamespace(get_ifd=lambda _: tags, get=lambda _: None)
    photo: Any = SimpleNamespace(getexif=lambda: exif, size=SIZE, info={})
    assert read_exif(photo).exposure_s is None
    tags[ExifTags.Base.ExposureTime.value] = 0.04
    assert read_exif(photo).exposure_s == 0.04
