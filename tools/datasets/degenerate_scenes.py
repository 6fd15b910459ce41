"""Synthetic smears of six kinds of scenes, three of which have no F: for the study and tests of degeneracy.

Camera, layered depth and motions are those of :mod:`tools.datasets.synthetic_matches`; 640x480.
"""

from dataclasses import dataclass
from typing import Literal, get_args

import cv2
import numpy as np

from blur2view.arrays import Array
from blur2view.smears.matches import SmearMatches
from tools.datasets.synthetic_matches import (
    FAR,
    IMAGE_SIZE,
    KnownMatches,
    camera,
    layered_depth,
    project_smears,
    random_smears,
    scaled_motion,
    with_swaps,
)

Kind = Literal["no motion", "pure rotation", "plane", "pure translation", "general", "no geometry"]
KINDS: tuple[Kind, ...] = get_args(Kind)
CORRELATIONS_PX = (0.0, 20.0, 40.0, 80.0, 120.0)  # of the directions of fields without any geometry


@dataclass(frozen=True, kw_only=True)
class DegenerateOptions:
    """Ranges from which a scene is drawn, uniform but for the length, which is log-uniform.

    ``noise_px`` is the standard deviation of every coordinate, ``outliers`` the share of smears of random
    direction, 0.3 to 2 medians long, ``length_px`` the median true length, ``count`` the number of smears.
    ``rotation_share`` is the median length of the rotation's smears over that of the translation's, where the
    camera does both.
    """

    noise_px: tuple[float, float] = (0.25, 1.0)
    outliers: tuple[float, float] = (0.0, 0.3)
    length_px: tuple[float, float] = (8.0, 40.0)
    count: tuple[int, int] = (1000, 2000)
    rotation_share: tuple[float, float] = (0.2, 1.0)


def draw_scene(kind: Kind, seed: int, options: DegenerateOptions | None = None) -> KnownMatches:
    """Return a random scene; the same kind, seed and options give the same smears.

    "no motion": a still camera, so that smears are noise. "plane": one plane, tilted by about 20 degrees,
    any motion. "no geometry": smears of one length whose directions are random, correlated over 0 to 120 px.
    """
    options = options or DegenerateOptions()
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    count, length_px = (
        int(rng.integers(*options.count)),
        float(np.exp(rng.uniform(*np.log(options.length_px)))),
    )
    K, points = camera(rng), rng.uniform(0, 1, (count, 2)) * np.array(IMAGE_SIZE)
    depth = tilted_plane(rng, points) if kind == "plane" else layered_depth(rng, points)
    fixed = {"pure rotation": np.inf, "pure translation": 0.0}
    share = fixed.get(kind, rng.uniform(*options.rotation_share))
    R, t = scaled_motion(K, points, depth, rng.normal(size=3), rng.normal(size=3), share, length_px)
    ends = project_smears(K, R, t, points, depth)
    if kind == "no motion":
        ends = np.stack([points, points], axis=1)
    elif kind == "no geometry":
        ends = random_field(rng, points, length_px)
    like = random_smears(
        rng, np.stack([points, points + [length_px, 0.0]], axis=1) if kind == "no motion" else ends
    )
    outlier = rng.random(count) < rng.uniform(*options.outliers)
    noise_px = rng.uniform(*options.noise_px)
    observed = np.where(outlier[:, None, None], like, ends) + noise_px * rng.normal(size=ends.shape)
    swapped = rng.random(count) < 0.5
    sigma_px = np.full(count, 2 * noise_px)
    matches = SmearMatches(ends=with_swaps(observed, swapped), sigma_px=sigma_px, image_size=IMAGE_SIZE)
    return KnownMatches(K=K, R=R, t=t, matches=matches, true_ends=ends, swapped=swapped, outlier=outlier)


def tilted_plane(rng: np.random.Generator, points: Array) -> Array:
    """Return the depth (N,) of one plane at pixels (N, 2), at most 1 / 0.3 of its centre's."""
    slope = rng.normal(0, [0.3, 0.5])
    slope *= min(1.0, 0.7 / (0.5 * np.abs(slope).sum()))
    inverse = 1 + (points / np.array(IMAGE_SIZE) - 0.5) @ slope
    return np.asarray(rng.uniform(*FAR) / inverse)


def random_field(rng: np.random.Generator, points: Array, length_px: float) -> Array:
    """Return smears (N, 2, 2) about pixels, all of one length, of directions without geometry."""
    correlation_px = float(rng.choice(CORRELATIONS_PX))
    vector = np.stack([smooth_noise(rng, points, correlation_px) for _ in range(2)], axis=-1)
    half = 0.5 * length_px * vector / np.linalg.norm(vector, axis=1, keepdims=True)
    return np.stack([points - half, points + half], axis=1)


def smooth_noise(rng: np.random.Generator, points: Array, correlation_px: float) -> Array:
    """Return unit-variance noise (N,) at pixels, Gaussian-correlated over ``correlation_px`` (0: white)."""
    if correlation_px <= 0:
        return rng.normal(size=len(points))
    width, height = IMAGE_SIZE
    white = rng.normal(size=(height // 4 + 1, width // 4 + 1))
    field = cv2.GaussianBlur(white, (0, 0), correlation_px / 4)
    columns, rows = np.clip(np.rint(points / 4).astype(int), 0, [width // 4, height // 4]).T
    return np.asarray((field / field.std())[rows, columns], float)


def with_shared_errors(
    ends: Array, rng: np.random.Generator, direction_deg: float, length_share: float, over_px: float = 40.0
) -> Array:
    """Return smears (N, 2, 2) that err as a network's: turned and stretched as their neighbours are.

    ``direction_deg`` and ``length_share`` are the standard deviations of the direction and of the length's
    natural logarithm.
    """
    middle = ends.mean(axis=1)
    angle = np.radians(direction_deg) * smooth_noise(rng, middle, over_px)
    stretch = np.exp(length_share * smooth_noise(rng, middle, over_px))
    x, y = (ends[:, 1] - middle).T * stretch
    half = np.stack([np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y], axis=1)
    return np.stack([middle - half, middle + half], axis=1)
