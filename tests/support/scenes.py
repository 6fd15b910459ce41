"""Seeded synthetic two-view smears with exact truth: the oracle of the geometry tests."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from blur2view import Camera, SmearMatches
from blur2view.arrays import Array
from blur2view.camera import from_colmap
from blur2view.geometry.epipolar import fundamental_from_pose
from blur2view.geometry.pose import rotation_matrix as rotation
from blur2view.smears.grid import smear_ends
from blur2view.smears.noise import NoiseModel
from blur2view.two_view.likelihood import NormalisedSmears
from blur2view.two_view.models import assumed_camera
from tools.datasets.synthetic_matches import (
    IMAGE_SIZE,
    camera,
    layered_depth,
    project_smears,
    random_field,
    random_smears,
    scaled_motion,
    with_shared_errors,
    with_swaps,
)

__all__ = [
    "IMAGE_SIZE", "Scene", "disturb", "make_scene", "noise_field_ends", "project_smears", "rotation",
    "with_outliers", "with_second_motion",
]  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Scene:
    """Smears (N, 2, 2) of a layered scene and a moving camera, ends in random order.

    ``ends`` may be disturbed, ``true_ends`` are exact; ``swapped`` (N,): where ends[:, 1] is the open end;
    ``outlier`` (N,): smears that do not follow the camera's motion.
    """

    K: Array
    R: Array
    t: Array
    F: Array
    ends: Array
    true_ends: Array
    swapped: np.ndarray
    outlier: np.ndarray
    image_size: tuple[int, int] = IMAGE_SIZE

    @property
    def length_px(self) -> Array:
        """Lengths of the smears as given, (N,)."""
        return np.asarray(np.linalg.norm(self.ends[:, 1] - self.ends[:, 0], axis=-1))

    @property
    def ordered(self) -> tuple[Array, Array]:
        """The disturbed points in true order: (points1, points2)."""
        ends = with_swaps(self.ends, self.swapped)
        return ends[:, 0], ends[:, 1]

    @property
    def camera(self) -> Camera:
        """The true camera."""
        return Camera(K=self.K, width=self.image_size[0], height=self.image_size[1])

    def matches(self, sigma_px: float | Array, **more: Any) -> SmearMatches:
        """Return the smears as matches of these standard deviations, one or (N,)."""
        sigma = np.broadcast_to(np.asarray(sigma_px, float), len(self.ends))
        given: dict[str, Any] = {"ends": self.ends, "sigma_px": sigma, "image_size": self.image_size}
        return SmearMatches(**given | more)


def make_scene(
    rng: np.random.Generator,
    *,
    count: int = 2000,
    length_px: float = 15.0,
    rotation_share: float | None = None,
) -> Scene:
    """Draw a camera, motion and scene without noise; ``length_px`` is the median length of the smears.

    ``rotation_share``: median length of the rotation's smears over that of the translation's (default 0.2
    to 1; 0: pure translation; inf: pure rotation).
    """
    share = rng.uniform(0.2, 1.0) if rotation_share is None else rotation_share
    K, points = camera(rng), rng.uniform(0, 1, (count, 2)) * np.array(IMAGE_SIZE)
    depth, axis, heading = layered_depth(rng, points), rng.normal(size=3), rng.normal(size=3)
    R, t = scaled_motion(K, points, depth, axis, heading, share, length_px)
    swapped = rng.random(count) < 0.5
    ends = with_swaps(project_smears(K, R, t, points, depth), swapped)
    F = fundamental_from_pose(K, R, t) if np.any(t) else np.full((3, 3), np.nan)
    truth: dict[str, Any] = {"true_ends": ends.copy(), "swapped": swapped, "outlier": np.zeros(count, bool)}
    return Scene(K=K, R=R, t=t, F=F, ends=ends, **truth)


def disturb(
    scene: Scene,
    rng: np.random.Generator,
    *,
    direction_deg: float = 0.0,
    length_share: float = 0.0,
    noise_px: float = 0.0,
) -> Scene:
    """Turn and stretch the smears about their midpoints as a network errs; add white noise to both ends."""
    ends = with_shared_errors(scene.ends, rng, direction_deg, length_share)
    return replace(scene, ends=ends + noise_px * rng.normal(size=ends.shape))


def with_outliers(scene: Scene, rng: np.random.Generator, share: float) -> Scene:
    """Replace a share of the smears by ones of random direction and a length of 0.3 to 2 of the median."""
    outlier = rng.random(len(scene.ends)) < share
    ends = np.where(outlier[:, None, None], random_smears(rng, scene.ends), scene.ends)
    return replace(scene, ends=ends, outlier=scene.outlier | outlier)


def with_second_motion(scene: Scene, box: tuple[float, float, float, float], displacement: Array) -> Scene:
    """Give every smear with its midpoint in ``box`` (x0, y0, x1, y1; pixels) one constant displacement."""
    middle = scene.ends.mean(axis=1)
    inside = ((middle > np.array(box[:2])) & (middle < np.array(box[2:]))).all(axis=1)
    moved = smear_ends(middle, np.broadcast_to(displacement, middle.shape))
    ends = np.where(inside[:, None, None], moved, scene.ends)
    return replace(scene, ends=ends, outlier=scene.outlier | inside)


def noise_field_ends(rng: np.random.Generator, *, count: int = 2000, correlation_px: float = 0.0) -> Array:
    """Smears of random direction with no geometry behind them, optionally smooth over the image."""
    middle = rng.uniform(0, 1, (count, 2)) * np.array(IMAGE_SIZE)
    return random_field(rng, middle, 12.0, correlation_px)


T = assumed_camera(IMAGE_SIZE)
UNIT_PX = 1 / T[0, 0]
PLAIN = NoiseModel(added_sampson=0.0, added_across=0.0)


def normalised_smears(ends: Array, sigma: float | Array, effective_share: float = 1.0) -> NormalisedSmears:
    """Return that of ends (N, 2, 2) whose Sampson distances have a standard deviation, both normalised."""
    pixels = (np.asarray(ends) - T[:2, 2]) / np.diag(T)[:2]
    sigma_px = np.broadcast_to(2 * UNIT_PX * np.asarray(sigma), len(ends))
    shared = replace(PLAIN, effective_share=effective_share)
    matches = SmearMatches(ends=pixels, sigma_px=sigma_px, image_size=IMAGE_SIZE, shared=shared)
    return NormalisedSmears.of(matches)


def distorted_points(camera: Any, rays: Array) -> Array:
    """Our pixels (N, 2) of rays (N, 2) = (x/z, y/z): the inverse of `normalised_points`."""
    directions = np.concatenate([rays, np.ones((len(rays), 1))], axis=1)
    return from_colmap(np.asarray(camera.img_from_cam(directions), float).reshape(-1, 2))
