"""Seeded synthetic two-view smears with exact truth: the oracle of the geometry tests."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from blur2view.epipolar import Array, fundamental_from_pose, homogeneous

IMAGE_SIZE = (640, 480)


@dataclass(frozen=True, kw_only=True)
class Scene:
    """Smears of a static layered scene seen by a moving camera, ends in random order.

    ``ends`` may be disturbed, ``true_ends`` never is; ``swapped`` marks smears whose ends[:, 1] is the open
    end; ``outlier`` marks smears that do not follow the camera's motion.
    """

    K: Array
    R: Array
    t: Array
    F: Array
    ends: Array  # (N, 2, 2)
    true_ends: Array  # (N, 2, 2) in the same order as ends
    swapped: np.ndarray
    outlier: np.ndarray
    image_size: tuple[int, int] = IMAGE_SIZE

    @property
    def length_px(self) -> Array:
        """Lengths of the smears as given, (N,)."""
        length: Array = np.linalg.norm(self.ends[:, 1] - self.ends[:, 0], axis=-1)
        return length

    @property
    def ordered(self) -> tuple[Array, Array]:
        """The disturbed points in true order: (points1, points2)."""
        index = np.arange(len(self.ends)), self.swapped.astype(int)
        return self.ends[index], self.ends[index[0], 1 - index[1]]


def layered_depth(rng: np.random.Generator, points: Array) -> Array:
    """Depth (N,) of pixels: a tilted background with relief, cards of other depths in front."""
    width, height = IMAGE_SIZE
    x, y = points[:, 0] / width - 0.5, points[:, 1] / height - 0.5
    depth = rng.uniform(3, 6) * np.exp(rng.normal(0, 0.4) * x + rng.normal(0, 0.6) * y)
    depth = depth * np.exp(0.1 * np.sin(9 * x + rng.uniform(0, 6)) * np.cos(7 * y + rng.uniform(0, 6)))
    for _ in range(rng.integers(2, 6)):
        centre, half = rng.uniform(-0.5, 0.5, 2), rng.uniform(0.08, 0.25, 2)
        inside = (np.abs(x - centre[0]) < half[0]) & (np.abs(y - centre[1]) < half[1])
        depth[inside] = rng.uniform(1, 3) * (1 + rng.normal(0, 0.3) * x[inside])
    return depth


def rotation(vector: Array) -> Array:
    """Rotation matrix of a rotation vector (radians)."""
    return np.asarray(cv2.Rodrigues(np.asarray(vector, float))[0], float)


def camera(rng: np.random.Generator) -> Array:
    """K of a 640x480 camera: focal 0.8 to 1.5 widths, principal point within 2 % of the centre."""
    focal = IMAGE_SIZE[0] * rng.uniform(0.8, 1.5)
    centre = (np.array(IMAGE_SIZE) - 1) / 2 + rng.normal(0, 0.01, 2) * np.array(IMAGE_SIZE)
    return np.array([[focal, 0, centre[0]], [0, focal, centre[1]], [0, 0, 1.0]])


def project_smears(K: Array, R: Array, t: Array, points: Array, depth: Array) -> Array:
    """Give the ends (N, 2, 2), open then close, of pixels at the given depths in the open camera."""
    rays = homogeneous(points) @ np.linalg.inv(K).T * depth[:, None]
    close = (rays @ R.T + t) @ K.T
    return np.stack([points, close[:, :2] / close[:, 2:]], axis=1)


def median_length(ends: Array) -> float:
    """Median smear length in pixels."""
    return float(np.median(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=-1)))


def make_scene(
    rng: np.random.Generator,
    *,
    count: int = 2000,
    length_px: float = 15.0,
    rotation_share: float | None = None,
) -> Scene:
    """Random camera, motion and scene without noise.

    ``length_px`` is the median smear length; ``rotation_share`` the median length of the smears of the
    rotation alone over that of the translation alone (default 0.2 to 1; 0: pure translation; inf: pure
    rotation).
    """
    share = rng.uniform(0.2, 1.0) if rotation_share is None else rotation_share
    K, points = camera(rng), rng.uniform(0, 1, (count, 2)) * np.array(IMAGE_SIZE)
    depth, axis, heading = layered_depth(rng, points), rng.normal(size=3), rng.normal(size=3)
    identity, none, small = np.eye(3), np.zeros(3), 1e-3
    turn = small * axis / median_length(project_smears(K, rotation(small * axis), none, points, depth))
    move = small * heading / median_length(project_smears(K, identity, small * heading, points, depth))
    weights = (1.0, 0.0) if np.isinf(share) else (share, 1.0)
    for _ in range(4):  # scale both together to the asked median length
        R, t = rotation(weights[0] * turn), weights[1] * move
        factor = length_px / median_length(project_smears(K, R, t, points, depth))
        turn, move = turn * factor, move * factor
    ends = project_smears(K, R, t, points, depth)
    F = fundamental_from_pose(K, R, t) if np.any(t) else np.full((3, 3), np.nan)
    swapped = rng.random(count) < 0.5
    ends[swapped] = ends[swapped, ::-1]
    return Scene(
        K=K, R=R, t=t, F=F, ends=ends, true_ends=ends.copy(), swapped=swapped, outlier=np.zeros(count, bool)
    )


def smooth_noise(rng: np.random.Generator, points: Array, correlation_px: float) -> Array:
    """Unit-variance noise (N,) at pixels, Gaussian-correlated over ``correlation_px`` (0: white)."""
    if correlation_px <= 0:
        return rng.normal(size=len(points))
    width, height = IMAGE_SIZE
    white = rng.normal(size=(height // 4 + 1, width // 4 + 1))
    field = cv2.GaussianBlur(white, (0, 0), correlation_px / 4)
    col, row = np.clip(np.rint(points / 4).astype(int), 0, [width // 4, height // 4]).T
    return np.asarray((field / field.std())[row, col], float)


def disturb(
    scene: Scene,
    rng: np.random.Generator,
    *,
    direction_deg: float = 0.0,
    length_share: float = 0.0,
    correlation_px: float = 40.0,
    noise_px: float = 0.0,
) -> Scene:
    """Turn and stretch the smears about their midpoints as a network errs; add white noise to both ends."""
    middle = scene.ends.mean(axis=1)
    half = scene.ends[:, 1] - middle
    angle = np.radians(direction_deg) * smooth_noise(rng, middle, correlation_px)
    stretch = np.exp(length_share * smooth_noise(rng, middle, correlation_px))
    turned = (
        np.stack(
            [
                np.cos(angle) * half[:, 0] - np.sin(angle) * half[:, 1],
                np.sin(angle) * half[:, 0] + np.cos(angle) * half[:, 1],
            ],
            axis=-1,
        )
        * stretch[:, None]
    )
    ends = np.stack([middle - turned, middle + turned], axis=1)
    return replace(scene, ends=ends + noise_px * rng.normal(size=ends.shape))


def with_outliers(scene: Scene, rng: np.random.Generator, share: float) -> Scene:
    """Replace a share of the smears by ones of random direction and a length of 0.3 to 2 of the median."""
    outlier = rng.random(len(scene.ends)) < share
    angle = rng.uniform(0, 2 * np.pi, len(scene.ends))
    length = rng.uniform(0.3, 2.0, len(scene.ends)) * median_length(scene.ends)
    half = 0.5 * length[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    middle = scene.ends.mean(axis=1)
    random_ends = np.stack([middle - half, middle + half], axis=1)
    return replace(
        scene, ends=np.where(outlier[:, None, None], random_ends, scene.ends), outlier=scene.outlier | outlier
    )


def with_second_motion(scene: Scene, box: tuple[float, float, float, float], displacement: Array) -> Scene:
    """Give every smear with its midpoint in ``box`` (x0, y0, x1, y1; pixels) one constant displacement."""
    middle = scene.ends.mean(axis=1)
    inside = ((middle > np.array(box[:2])) & (middle < np.array(box[2:]))).all(axis=1)
    half = np.asarray(displacement, float) / 2
    moved = np.stack([middle - half, middle + half], axis=1)
    return replace(
        scene, ends=np.where(inside[:, None, None], moved, scene.ends), outlier=scene.outlier | inside
    )


def noise_field_ends(
    rng: np.random.Generator, *, count: int = 2000, length_px: float = 12.0, correlation_px: float = 0.0
) -> Array:
    """Smears of random direction with no geometry behind them, optionally smooth over the image."""
    middle = rng.uniform(0, 1, (count, 2)) * np.array(IMAGE_SIZE)
    vector = np.stack([smooth_noise(rng, middle, correlation_px) for _ in range(2)], axis=-1)
    half = 0.5 * length_px * vector / np.linalg.norm(vector, axis=1, keepdims=True)
    return np.stack([middle - half, middle + half], axis=1)
