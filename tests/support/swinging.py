"""A rendered video of a camera that swings before a distant wall, with its true rates."""

from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.geometry.rotation import rotation_matrix, rotation_vector

SIZE, FOCAL_PX, FRAMES_PER_S = (400, 304), 360.0, 25.0
OPEN = 0.8  # of the interval of frames
EXPOSURE_S = OPEN / FRAMES_PER_S
SUBFRAMES, PERIOD = 24, 23.0  # per exposure; frames of a swing
SWING: Array = np.array([0.03, 0.11, 0.05])  # radians about x, y and z
LAG: Array = np.array([1.0, 0.0, 2.0])
WALL = (1400, 1100)


class Swing(NamedTuple):
    """Frames (H, W, 3) uint8, RGB, and the rates (N, 3) of ``cam2_from_cam1``, radians per second."""

    frames: list[NDArray[np.uint8]]
    rates: Array

    def write(self, path: Path) -> Path:
        """Write the video, every frame compressed by itself: else one leaves its traces in the next."""
        video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), FRAMES_PER_S, SIZE)
        for frame in self.frames:
            video.write(np.ascontiguousarray(frame[..., ::-1]))
        video.release()
        return path


def attitude(frame: float) -> Array:
    """Return cam_from_world (3, 3) at a time in frames."""
    return rotation_matrix(SWING * np.sin(2 * np.pi * frame / PERIOD + LAG))


def swing(count: int) -> Swing:
    """Render a video; sub-frames are averaged in linear light."""
    rng = np.random.default_rng(0)
    wall = np.zeros((*WALL[::-1], 3), np.float32)
    for scale, weight in ((1.2, 1.0), (5, 2.0), (20, 3.0)):
        noise = cv2.GaussianBlur(rng.normal(size=wall.shape).astype(np.float32), (0, 0), scale)
        wall += weight * noise / noise.std()
    linear = np.clip(0.5 + 0.14 * wall / wall.std(), 0, 1) ** 2.2
    K, wide = (
        np.array([[FOCAL_PX, 0, (w - 1) / 2], [0, FOCAL_PX, (h - 1) / 2], [0, 0, 1]]) for w, h in (SIZE, WALL)
    )
    frames, rates = [], []
    for index in range(count):
        times = index + OPEN * ((np.arange(SUBFRAMES) + 0.5) / SUBFRAMES - 0.5)
        views = [cv2.warpPerspective(linear, K @ attitude(t) @ np.linalg.inv(wide), SIZE) for t in times]
        frames.append(np.round(255 * np.mean(views, axis=0) ** (1 / 2.2)).astype(np.uint8))
        turned = attitude(index + OPEN / 2) @ attitude(index - OPEN / 2).T
        rates.append(rotation_vector(turned) / EXPOSURE_S)
    return Swing(frames, np.array(rates))
