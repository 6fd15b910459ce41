"""A video of a slanted, textured plane, exactly blurred, and COLMAP's model of some of its frames."""

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
import pycolmap
from numpy.typing import NDArray

from blur2view.arrays import AnyArray, Array
from blur2view.colmap.blur_matching import GAMMA
from blur2view.colmap.warped_view import projected
from blur2view.geometry.pose import rotation_matrix
from blur2view.smears.grid import SmearGrid, to_double_angle
from tests.support.walks import Shot, model_of, on_plane

SIZE, FOCAL, STRIDE, INSTANTS = (240, 180), 220.0, 32, 25
CENTRE = (np.array(SIZE) - 1) / 2
K = np.array([[FOCAL, 0, CENTRE[0]], [0, FOCAL, CENTRE[1]], [0, 0, 1.0]])
PLANE = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.25, 0.1, 4.0]])  # columns x, y, z of (u, v, 1)
TEXTURE, TEXEL = (500, 400), 0.02  # width and height; units of the plane


@dataclass(frozen=True, kw_only=True)
class BlurredPlane:
    """Frames f_0.png, ... of a camera that shakes, each exposed for ``share`` of the interval."""

    frames: int = 9
    share: float = 0.6

    @property
    def names(self) -> list[str]:
        """The frames."""
        return [f"f_{k}.png" for k in range(self.frames)]

    @property
    def camera(self) -> pycolmap.Camera:
        """The camera, which errs in nothing."""
        width, height = SIZE
        params = [FOCAL, FOCAL, width / 2, height / 2]
        return pycolmap.Camera(model="PINHOLE", width=width, height=height, params=params, camera_id=1)

    def pose(self, time: float) -> Array:
        """Return cam_from_world (3, 4) at a time in frames."""
        waves = np.sin(np.array([1.7, 1.5, 1.2]) * time + np.array([0.0, 1.0, 2.0]))
        R = rotation_matrix(np.array([0.03, 0.05, 0.02]) * waves + np.array([0, 0.012, 0]) * time)
        centre = np.array([0.03, 0.01, 0.015]) * time + 0.02 * waves[::-1]
        return np.column_stack([R, -R @ centre])

    def render(self, time: float) -> AnyArray:
        """Return a frame, uint8 RGB: the mean over instants of its exposure, in linear light."""
        noise = np.random.default_rng(0).normal(size=TEXTURE[::-1]).astype(np.float32)
        fine, coarse = (cv2.GaussianBlur(noise, (0, 0), sigma) * sigma for sigma in (1.5, 4.0))
        texture = np.clip(0.4 + 0.12 * (fine + coarse) / (fine + coarse).std(), 0, 1)
        middle = -TEXEL * np.array(TEXTURE) / 2
        plane = np.array([[TEXEL, 0, middle[0]], [0, TEXEL, middle[1]], [0, 0, 1.0]])
        light = np.zeros(SIZE[::-1], np.float32)
        for t in (np.arange(INSTANTS) + 0.5) / INSTANTS - 0.5:
            pose = self.pose(time + t * self.share)
            H = K @ (pose[:, :3] @ PLANE + np.outer(pose[:, 3], [0, 0, 1])) @ plane
            light += cv2.warpPerspective(texture, H, SIZE, flags=cv2.INTER_CUBIC)
        grey = np.rint(255 * np.clip(light / INSTANTS, 0, 1) ** (1 / GAMMA)).astype(np.uint8)
        return np.repeat(grey[..., None], 3, axis=2)

    def points(self) -> Array:
        """Return points (N, 3) of the plane."""
        u, v = np.meshgrid(np.linspace(-2.5, 2.5, 24), np.linspace(-1.8, 1.8, 18))
        return np.asarray(np.column_stack([u.ravel(), v.ravel(), np.ones(u.size)]) @ PLANE.T)

    def seen(self, pose: Array, world: Array) -> Array:
        """Return our pixels (N, 2) of points (N, 3)."""
        return projected(self.camera, world @ pose[:, :3].T + pose[:, 3])

    def pixels(self, time: float, pose: Array | None = None) -> Array:
        """Return our pixels (N, 2) of the points at a time, or from another pose."""
        return self.seen(self.pose(time) if pose is None else pose, self.points())

    @staticmethod
    def inside(pixels: Array) -> NDArray[np.bool_]:
        """Return which pixels (N, 2) are in the picture."""
        return np.asarray(np.all((pixels > 0) & (pixels < np.array(SIZE) - 1), axis=1))

    def world(self, pixels: Array, time: float) -> Array:
        """Return the points (N, 3) of the plane at pixels (N, 2) of a time."""
        normal = np.cross(PLANE[:, 0], PLANE[:, 1])
        rays = np.column_stack([(pixels - CENTRE) / FOCAL, np.ones(len(pixels))])
        return on_plane(self.pose(time), rays, normal, float(normal @ PLANE[:, 2]))

    def transferred(self, pixels: Array, first: float, second: float) -> Array:
        """Return where pixels (N, 2) of one time are at another."""
        return self.seen(self.pose(second), self.world(pixels, first))

    def smears(self, time: float) -> SmearGrid:
        """Return exact smears of a frame on a network's grid."""
        shape = tuple(-(-side // STRIDE) for side in SIZE[::-1])
        empty = SmearGrid(cells=np.zeros((*shape, 4), np.float32), stride=STRIDE, shape=SIZE[::-1])
        at = empty.points().reshape(-1, 2)
        first, last = (self.transferred(at, time, time + t * self.share) for t in (-0.5, 0.5))
        sigma = np.tile([0.5, 0.05], (len(at), 1))
        cells = np.hstack([to_double_angle(last - first), sigma]).reshape(*shape, 4).astype(np.float32)
        return SmearGrid(cells=cells, stride=STRIDE, shape=SIZE[::-1])

    def write(self, folder: Path, registered: Collection[int]) -> None:
        """Write ``frames``, all of them, and ``model``, of those registered, whose points have tracks."""
        (folder / "frames").mkdir(parents=True)
        for k, name in enumerate(self.names):
            cv2.imwrite(str(folder / "frames" / name), self.render(k))
        seen = {k: self.inside(self.pixels(k)) for k in registered}
        often = np.sum(list(seen.values()), axis=0) > 1
        shots = []
        for k in registered:
            shown = np.flatnonzero(seen[k] & often)
            shots.append(Shot(10 + k, self.names[k], self.pose(k), self.pixels(k)[shown], shown))
        (folder / "model").mkdir()
        model_of(self.camera, self.points(), shots).write(folder / "model")


@dataclass(eq=False)
class ExactSmears:
    """In the place of a network: exact smears of the frames, which are recognised by their pixels."""

    plane: BlurredPlane

    @cached_property
    def known(self) -> dict[bytes, int]:
        """The frames by their pixels."""
        return {self.plane.render(k).tobytes(): k for k in range(self.plane.frames)}

    def predict(self, image: AnyArray) -> SmearGrid:
        """Return the smears of a frame; of any other picture those of the first."""
        return self.plane.smears(self.known.get(image.tobytes(), 0))
