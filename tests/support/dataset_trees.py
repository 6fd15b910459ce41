"""Tiny trees of the paper's datasets in their true layouts, whose flow, cameras and F are known."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.geometry.epipolar import fundamental_from_pose
from tools.datasets.exposure import coded
from tools.datasets.sceneflow import FLIP, intrinsics

Floats = NDArray[np.float64]
WIDTH, HEIGHT = 96, 64
PIXELS = np.stack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)), -1).astype(float)


def texture(points: Floats) -> Floats:
    """Linear light (..., 3) of a smooth wall."""
    x, y = points[..., 0], points[..., 1]
    waves = [np.sin(0.31 * x + 0.2 * y), np.sin(0.17 * x - 0.37 * y), np.cos(0.11 * x * 1.7 + 0.05 * y)]
    return 0.5 + 0.3 * np.stack(waves, axis=-1)


def mapped(H: Floats, points: Floats) -> Floats:
    """Map points (..., 2) by a homography."""
    moved = np.concatenate([points, np.ones_like(points[..., :1])], -1) @ H.T
    return np.asarray(moved[..., :2] / moved[..., 2:])


def pfm(path: Path, flow: Floats, big: bool = False) -> None:
    """Write (H, W, 2) as SceneFlow does: three channels, the last empty, rows from the bottom up."""
    three = np.concatenate([flow, np.zeros_like(flow[..., :1])], -1)[::-1]
    path.parent.mkdir(parents=True, exist_ok=True)
    head = f"PF\n{flow.shape[1]} {flow.shape[0]}\n{1.0 if big else -1.0}\n".encode()
    path.write_bytes(head + three.astype(">f4" if big else "<f4").tobytes())


def png(path: Path, linear: Floats) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), coded(linear)[..., ::-1])


def camera_line(letter: str, world_from_camera: Floats) -> str:
    """Write a camera as SceneFlow does, in Blender's axes."""
    blender = world_from_camera.copy()
    blender[:3, :3] = blender[:3, :3] @ FLIP
    return f"{letter} " + " ".join(repr(float(v)) for v in blender.ravel())


SCENES = {"monkaa": "eating_x2", "driving": "15mm_focallength/scene_forwards/fast"}
R = np.asarray(cv2.Rodrigues(np.array([0.01, -0.02, 0.015]))[0], float)
T = np.array([0.05, 0.02, 0.03])
NORMAL, DISTANCE = np.array([0.1, 0.3, 1.0]), 1.0


def homography(scene: str) -> tuple[Floats, Floats]:
    """Homography of the wall from one frame to the next, and F, of the cameras that `sceneflow` writes."""
    K = intrinsics(scene, (WIDTH, HEIGHT))
    H = K @ (R + np.outer(T, NORMAL) / DISTANCE) @ np.linalg.inv(K)
    return H / H[2, 2], fundamental_from_pose(K, R, T)


def sceneflow(root: Path, scene: str, first: int) -> Path:
    """Write a scene of three frames, left and right the same, before a tilted wall.

    The flow beyond both ends, which no exposure needs, is zero.
    """
    step = homography(scene)[0]
    relative = np.vstack([np.c_[R, T], [0, 0, 0, 1]])
    world = np.vstack([np.c_[cv2.Rodrigues(np.array([0.3, 1.1, -0.4]))[0], [1, -2, 3]], [0, 0, 0, 1]])
    cameras = []
    for k in range(3):
        H = np.linalg.matrix_power(step, k)
        cameras += [f"Frame {first + k}", camera_line("L", world), camera_line("R", world), ""]
        world = world @ np.linalg.inv(relative)
        for side, letter in (("left", "L"), ("right", "R")):
            name = f"{first + k:04d}"
            png(
                root / "frames_cleanpass" / scene / side / f"{name}.png",
                texture(mapped(np.linalg.inv(H), PIXELS)),
            )
            for time, way in (("Future", step), ("Past", np.asarray(np.linalg.inv(step), float))):
                folder = root / "optical_flow" / scene / f"into_{time.lower()}" / side
                beyond = (time, k) in (("Future", 2), ("Past", 0))
                moved = 0 * PIXELS if beyond else mapped(way, PIXELS) - PIXELS
                pfm(folder / f"OpticalFlowInto{time}_{name}_{letter}.pfm", moved)
    (root / "camera_data" / scene).mkdir(parents=True)
    (root / "camera_data" / scene / "camera_data.txt").write_text("\n".join(cameras))
    return root


def shifted(pixels: float) -> Floats:
    """Show the wall, textured finely, moved right by some pixels."""
    noise = np.random.default_rng(1).random((HEIGHT * 2, WIDTH * 3, 3)).astype(np.float32)
    large = cv2.GaussianBlur(noise, (0, 0), 2.0)
    large = (large - large.min()) / np.ptp(large)
    move = np.array([[1, 0, pixels - WIDTH], [0, 1, -HEIGHT / 2]])
    return np.asarray(cv2.warpAffine(large, move, (WIDTH, HEIGHT), flags=cv2.INTER_CUBIC).clip(0, 1))
