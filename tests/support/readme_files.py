"""The files that README's recipes name: photographs, frames of a video, a COLMAP project of the frames."""

import shutil
from pathlib import Path

import cv2
import numpy as np

from blur2view.photographs.image import read_image
from tests.support.walks import Walk

ROOT = Path(__file__).resolve().parents[2]
SAMPLE = ROOT / "models/sample.jpg"
PHOTOGRAPHS = ("models/sample.jpg", "a.jpg", "b.jpg", "photographs/one.jpg", "photographs/two.jpg")
FRAMES = ("f_000.jpg", "f_010.jpg", "f_020.jpg")  # every tenth of a video
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
    walk = Walk(names=FRAMES, size=(width, height), focal=800.0, turn=TURN, move=MOVE)
    points = np.random.default_rng(0).uniform(-1, 1, (200, 3)) * (1.5, 1, 2) + (0, 0, 7)
    walk.write(points, database, {model_folder: range(len(FRAMES))})
