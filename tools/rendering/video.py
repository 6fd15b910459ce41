"""Videos of a hand that walks slowly and shakes, with the exact pose at every instant of every exposure."""

from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from blur2view.arrays import Array
from blur2view.geometry.pose import rotation_matrix
from blur2view.output import write_file
from tools.rendering.render import Exposure, grid_points, mean_frame, paint, stencil_alpha
from tools.rendering.scene import Layer, Trajectory, sample_layers
from tools.rendering.sensor import sharp_photograph
from tools.rendering.textures import photographs

MARGIN, DETAIL, CARDS = 200.0, 1.2, range(2, 6)
WAVES, WALK = 6, 0.35  # waves of the shake, equally fast; length of the walk, units of depth


@dataclass(frozen=True, kw_only=True)
class Shake(Trajectory):
    """A hand's path about an exposure that lasts ``exposure_s`` about ``middle_s``; at 0 s it is the scene's.

    ``drift`` (3,) is in units of depth per second; every one of ``hertz`` (waves,) has ``phase`` and
    ``height`` (waves, 6), in radians and units of depth.
    """

    drift: Array
    hertz: Array
    phase: Array
    height: Array
    middle_s: float = 0.0
    exposure_s: float = 1.0

    def at(self, tau: float) -> tuple[Array, Array]:
        """Return the rotation (3, 3) and position (3,) at a time in exposures from the middle."""
        time = self.middle_s + tau * self.exposure_s
        turns = 2 * np.pi * self.hertz[:, None] * time + self.phase
        r, c = (self.height * (np.sin(turns) - np.sin(self.phase))).sum(axis=0).reshape(2, 3)
        return rotation_matrix(r), c + self.drift * time

    def pose(self, tau: float) -> Array:
        """Return cam_from_scene (3, 4)."""
        R, centre = self.at(tau)
        return np.column_stack([R, -R @ centre])


@dataclass(frozen=True, kw_only=True)
class VideoOptions:
    """Frames a second, the exposure over the frame interval, how many frames, of which camera.

    The shake has frequencies log-uniform in ``hertz`` and turns the picture by ``shake_px`` a frame (root
    mean square).
    """

    rate: float
    share: float
    frames: int = 12
    size: tuple[int, int] = (480, 360)
    focal_px: float = 450.0
    hertz: tuple[float, float] = (0.7, 10.0)
    shake_px: float = 14.0

    @property
    def K(self) -> Array:
        """The intrinsics (3, 3)."""
        (width, height), f = self.size, self.focal_px
        return np.array([[f, 0, (width - 1) / 2], [0, f, (height - 1) / 2], [0, 0, 1.0]])


def sample_exposures(rng: np.random.Generator, options: VideoOptions) -> list[Shake]:
    """Draw a path and return it about the middle of every exposure."""
    low, high = np.log(options.hertz)
    hertz = np.exp(rng.uniform(low, high, WAVES))
    speed = rng.normal(size=(WAVES, 6)) * np.repeat([1.0, 0.3], 3)
    wanted = options.shake_px * options.rate / options.focal_px
    speed *= wanted / np.sqrt((speed[:, :2] ** 2).sum() / 2)
    direction = rng.normal(size=3) * (1, 0.6, 0.6)
    drift = direction / np.linalg.norm(direction) * WALK * options.rate / options.frames
    phase = rng.uniform(0, 2 * np.pi, speed.shape)
    shake = Shake(drift=drift, hertz=hertz, phase=phase, height=speed / (2 * np.pi * hertz[:, None]))
    middles = (np.arange(options.frames) - (options.frames - 1) / 2) / options.rate
    exposure_s = options.share / options.rate
    return [replace(shake, middle_s=float(middle), exposure_s=exposure_s) for middle in middles]


def _sample_scene(rng: np.random.Generator, options: VideoOptions) -> list[Layer]:
    """Draw the layers of a scene, some of them cards."""
    while len(layers := sample_layers(rng, photographs(), options.K, options.size)) - 1 not in CARDS:
        pass
    return layers


def smear_lengths_px(paths: list[Shake], seed: int, options: VideoOptions) -> list[float]:
    """Return the true length of the smears of each frame of `write_video`, the median over the picture."""
    layers, points = _sample_scene(np.random.default_rng([seed, 1]), options), grid_points(options.size)
    seen = np.zeros(points.shape[:2], int)  # the layer at mid exposure
    for index, layer in enumerate(layers[1:], 1):
        seen[stencil_alpha(layer, points) > 0.5] = index
    lengths = []
    for path in paths:
        exposure = Exposure(camera=path, K=options.K, size=options.size)
        opened, closed = (
            np.stack([exposure.moved(points, layer, tau) for layer in layers]) for tau in (-0.5, 0.5)
        )
        each = np.linalg.norm(closed - opened, axis=-1)
        lengths.append(float(np.median(np.take_along_axis(each, seen[None], axis=0))))
    return lengths


def write_video(
    folder: Path, seed: int, options: VideoOptions, only: Collection[int] | None = None
) -> list[Shake]:
    """Render the frames f_NNN.png that are not there, and return the camera's path about each of the video.

    The share of the exposure changes neither the scene nor the path of a seed. Of those frames alone, if some
    are named; the first one, by whose light all are exposed, is rendered with them.
    """
    paths = sample_exposures(np.random.default_rng([seed, int(options.rate)]), options)
    wanted = range(len(paths)) if only is None else sorted({0, *only})
    targets = {index: folder / f"f_{index:03d}.png" for index in wanted}
    if all(target.exists() for target in targets.values()):
        return paths
    folder.mkdir(parents=True, exist_ok=True)
    rng, size, K, like = np.random.default_rng([seed, 1]), options.size, options.K, None
    layers = _sample_scene(rng, options)
    canvases = [paint(rng, layer, K, size, MARGIN, DETAIL) for layer in layers]
    for index, target in targets.items():
        if index and target.exists():
            continue
        exposure = Exposure(camera=paths[index], K=K, size=size)
        linear = mean_frame(canvases, [exposure.inverse_displacements(one) for one in layers])
        like = linear if like is None else like
        picture = sharp_photograph(np.random.default_rng([seed, 2, index]), linear, like)
        write_file(target, bytes(cv2.imencode(".png", picture[..., ::-1])[1]))
    return paths
