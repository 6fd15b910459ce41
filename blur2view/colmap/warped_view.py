"""A photograph at a pose, and its picture at the pixels of another one, by the depths of points nearby.

Fields are computed on a lattice of every `CELL` pixels. Cameras are pycolmap's, of any model: derivatives of
projections are differences.
"""

from copy import deepcopy
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import cv2
import numpy as np
from scipy.spatial import cKDTree

from blur2view.arrays import Array, Mask
from blur2view.camera import from_colmap, normalised_points
from blur2view.colmap.blur_matching import resampled, shortened
from blur2view.geometry.epipolar import cross_matrix
from blur2view.images.pixels import from_resized
from blur2view.smears.grid import SmearGrid

CELL = 8  # pixels of the lattice on which the warp and the blur are computed
NEAREST, SMOOTH_PX = 8, 8.0  # points whose inverse depths are averaged; weights are 1 / (distance + this)^2
BORDER_PX = 3.0  # points nearer to the border are not used
FAR_PX = 1e4  # bound of the warp and the blur: cv2.remap mirrors what is far outside again and again
FLOOR_SIGMA_PX = 0.3  # of smears, and of pixels beside what the patch itself says


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """A photograph at the size at which it is worked on."""

    image: Any  # (H, W) float32, grey, linear light
    grid: SmearGrid  # smears of the photograph in its own size
    camera: Any  # pycolmap.Camera of the working size
    pose: Array  # (3, 4) cam_from_world, known or expected

    def smears(self, points: Array) -> tuple[Array, Array]:
        """Return displacements (N, 2) and standard deviations (N,) at pixels (N, 2), of the working size."""
        scale = self.camera.width / self.grid.size[0]
        smears = self.grid.at(from_resized(points, scale))
        return smears.displacement * scale, np.maximum(smears.sigma_px * scale, FLOOR_SIGMA_PX)

    def scaled(self, scale: float) -> "View":
        """Return the view in another size."""
        if scale == 1:
            return self
        size = round(self.camera.width * scale), round(self.camera.height * scale)
        camera = deepcopy(self.camera)
        camera.rescale(*size)
        image = cv2.resize(self.image, size, interpolation=cv2.INTER_AREA)
        return replace(self, image=image, camera=camera)

    def points(self, world: Array) -> Array:
        """Return points (N, 3) of the world in this camera's frame."""
        return np.asarray(world @ self.pose[:, :3].T + self.pose[:, 3])

    def project(self, world: Array) -> Array:
        """Return the pixels (N, 2) of points (N, 3) of the world, NaN behind the camera."""
        return projected(self.camera, self.points(world))


def projected(camera: Any, points: Array) -> Array:
    """Project points (N, 3) in the camera's frame to pixels (N, 2); NaN behind it.

    (0, 0) is the centre of the top-left pixel.
    """
    pixels = from_colmap(np.asarray(camera.img_from_cam(points), float).reshape(-1, 2))
    return np.where(points[:, 2:] > 0, pixels, np.nan)


def image_flow(camera: Any, points: Array) -> Array:
    """Return the derivatives (N, 2, 6) of pixels of points (N, 3) by their rotation and translation."""
    step = 1e-4 * points[:, 2:]
    slopes = [
        (projected(camera, points + step * axis) - projected(camera, points - step * axis)) / (2 * step)
        for axis in np.eye(3)
    ]
    slope = np.stack(slopes, axis=-1)
    return np.concatenate([-slope @ cross_matrix(points), slope], axis=-1)


def inverse_depth_at(at: Array, pixels: Array, depth: Array) -> Array:
    """Return smooth inverse depths (N,) at pixels (N, 2) from depths (M,) of points at pixels (M, 2)."""
    near, index = cKDTree(pixels).query(at, k=min(NEAREST, len(pixels)))
    near, index = near.reshape(len(at), -1), index.reshape(len(at), -1)
    weight = 1 / (near + SMOOTH_PX) ** 2
    return np.asarray((weight / depth[index]).sum(axis=1) / weight.sum(axis=1))


def same_sense(vectors: Array, reference: Array) -> Array:
    """Return vectors (N, 2), reversed where they run against a reference (N, 2)."""
    return np.asarray(vectors * np.where((vectors * reference).sum(axis=1) < 0, -1.0, 1.0)[:, None])


def surface_points(view: View, world: Array) -> Array:
    """Return points (h w, 3) in a view's frame at its lattice, as deep as points (N, 3) nearby."""
    points, lattice = view.points(world), _lattice(view.camera)
    depth = 1 / inverse_depth_at(lattice, projected(view.camera, points), points[:, 2])
    rays = np.column_stack([normalised_points(view.camera, lattice), np.ones(len(lattice))])
    return np.asarray(np.nan_to_num(rays) * depth[:, None])


def in_picture(camera: Any, pixels: Array) -> Mask:
    """Return which pixels (N, 2) lie in a camera's picture, `BORDER_PX` or more from its border."""
    last = np.array([camera.width, camera.height]) - 1
    return np.asarray(np.all((pixels > BORDER_PX) & (pixels < last - BORDER_PX), axis=1))


def _lattice(camera: Any) -> Array:
    """Return pixels (h w, 2) in rows, the middles of cells of `CELL` pixels, one more beyond each border."""
    x, y = (
        CELL * np.arange(-1, -(-side // CELL) + 1) + (CELL - 1) / 2 for side in (camera.width, camera.height)
    )
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def _in_rows(camera: Any, field: Array) -> Array:
    """Return a field (h w, C) on the lattice as (h, w, C)."""
    return field.reshape(-(-camera.height // CELL) + 2, -(-camera.width // CELL) + 2, -1)


def everywhere(camera: Any, field: Array) -> Any:
    """Return a field (h w, C) on the lattice at all pixels, (H, W, C), float32, within `FAR_PX`."""
    near = np.clip(_in_rows(camera, field), -FAR_PX, FAR_PX).astype(np.float32)
    height, width = near.shape[:2]
    whole = cv2.resize(near, (CELL * width, CELL * height), interpolation=cv2.INTER_LINEAR)
    return np.ascontiguousarray(whole[CELL : CELL + camera.height, CELL : CELL + camera.width])


class Warp(NamedTuple):
    """A neighbour at the pixels of a view."""

    picture: Any  # (H, W) float32
    pixels: Any  # (H, W, 2) float32 of the neighbour
    smears: Any  # (H, W, 2) float32, `shortened`, in pixels of the view and the sense of its path


def warp_to(neighbour: View, view: View, surface: Array, path: Array) -> Warp:
    """Warp a neighbour to a view."""
    R = neighbour.pose[:, :3] @ view.pose[:, :3].T
    t = neighbour.pose[:, 3] - R @ view.pose[:, 3]
    where = np.nan_to_num(projected(neighbour.camera, surface @ R.T + t), nan=-1e3)
    rows = _in_rows(view.camera, where)
    jacobian = np.stack([np.gradient(rows, CELL, axis=axis) for axis in (1, 0)], axis=-1).reshape(-1, 2, 2)
    own = neighbour.smears(where)[0][..., None]
    smears = np.asarray(np.linalg.solve(jacobian + 1e-6 * np.eye(2), own)[..., 0], float)
    pixels = everywhere(view.camera, where)
    picture = resampled(neighbour.image, pixels, cv2.INTER_CUBIC)
    return Warp(picture, pixels, everywhere(view.camera, same_sense(shortened(smears), path)))
