"""The files that README's recipes name: photographs, frames of a video, a COLMAP project of the frames."""

import shutil
from itertools import combinations
from pathlib import Path

import cv2
import numpy as np
import pycolmap

from blur2view.arrays import Array
from blur2view.geometry.rotation import rotation_matrix
from blur2view.photographs.image import read_image

ROOT = Path(__file__).resolve().parents[2]
SAMPLE = ROOT / "models/sample.jpg"
PHOTOGRAPHS = ("models/sample.jpg", "a.jpg", "b.jpg", "photographs/one.jpg", "photographs/two.jpg")
FRAMES = ("f_000.jpg", "f_010.jpg", "f_020.jpg")  # every tenth of a video
POINTS, FOCAL = 200, 800.0
TURN, MOVE = np.array([0.002, 0.006, -0.001]), np.array([0.9, 0.1, 0.05])  # of the camera, a frame


def make_files(folder: Path) -> None:
    """Copy the sample to every photograph and frame that README names; write the project of the frames."""
    for name in (*PHOTOGRAPHS, *(f"frames/{frame}" for frame in FRAMES)):
        (folder / name).parent.mkdir(exist_ok=True)
        shutil.copy(SAMPLE, folder / name)
    shutil.copy(ROOT / "models/sample_mover.jpg", folder / "models")
    write_video(folder / "video.mp4")
    make_project(folder / "project.db", folder / "model" / "0")


def write_video(path: Path, count: int = 7) -> None:
    """Write the sample as the frames of a video."""
    picture = cv2.imread(str(SAMPLE))
    assert picture is not None
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 10, picture.shape[1::-1])
    for _ in range(count):
        video.write(picture)
    video.release()


def make_project(database: Path, model_folder: Path) -> None:
    """Write features and matches of the frames, and the model of a steady walk with these features."""
    height, width = read_image(SAMPLE).shape[:2]
    rng = np.random.default_rng(0)
    spread = rng.uniform(-1, 1, (POINTS, 3))
    points = spread * (1.5, 1, 2) + (0, 0, 7)
    params = [FOCAL, width / 2, height / 2]
    camera = pycolmap.Camera(model="SIMPLE_PINHOLE", width=width, height=height, params=params, camera_id=1)
    camera.has_prior_focal_length = True
    model = pycolmap.Reconstruction()
    model.add_camera_with_trivial_rig(camera)
    tracks = [pycolmap.Track() for _ in points]
    with pycolmap.Database.open(database) as opened:
        opened.write_camera(camera)
        for number, name in enumerate(FRAMES, 1):
            pose = pose_at(number - 2)  # the second frame is in the middle
            pixels = projected(points, pose) + params[1:]
            opened.write_image(pycolmap.Image(name=name, camera_id=1))
            opened.write_keypoints(number, pixels.astype(np.float32))
            image = pycolmap.Image(name=name, keypoints=pixels, camera_id=1, image_id=number)
            rigid = pycolmap.Rigid3d(pycolmap.Rotation3d(pose[:, :3]), pose[:, 3])
            model.add_image_with_trivial_frame(image, rigid)
            for index, track in enumerate(tracks):
                track.add_element(number, index)
        geometry = pycolmap.TwoViewGeometry()
        geometry.config = pycolmap.TwoViewGeometryConfiguration.CALIBRATED
        geometry.inlier_matches = np.arange(POINTS, dtype=np.uint32)[:, None].repeat(2, axis=1)
        for number, other in combinations(range(1, len(FRAMES) + 1), 2):
            opened.write_matches(number, other, geometry.inlier_matches)
            opened.write_two_view_geometry(number, other, geometry)
    for point, track in zip(points, tracks, strict=True):
        model.add_point3D(point, track)
    model_folder.mkdir(parents=True)
    model.write(model_folder)


def pose_at(time: float) -> Array:
    """Return the pose (3, 4) of the walk, from the world to the camera."""
    R = rotation_matrix(TURN * time)
    return np.column_stack([R, R @ (MOVE * time)])


def projected(points: Array, pose: Array) -> Array:
    """Return points (N, 3) in pixels (N, 2) from the principal point."""
    seen = points @ pose[:, :3].T + pose[:, 3]
    pixels: Array = FOCAL * seen[:, :2] / seen[:, 2:]
    return pixels
