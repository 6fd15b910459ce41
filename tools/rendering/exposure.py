"""Where surface points are seen over one exposure: projection along the paths, and its inverse on a grid."""

import functools
from dataclasses import dataclass

import cv2
import numpy as np

from blur2view.arrays import AnyArray
from tools.rendering.motion import Trajectory
from tools.rendering.scene import Layer

KNOTS = (1 - np.cos(np.linspace(0, np.pi, 7))) / 2 - 0.5
"""Chebyshev-Lobatto exposure times at which inverse displacement fields are solved; both ends included."""
GRID = 4
"""Spacing in pixels of those fields and of the stored truth; cell j has its centre at pixel 4 j + 1.5."""


def pixel_rays(points: AnyArray, K: AnyArray) -> AnyArray:
    """Return rays (..., 3) with z = 1 through pixels (..., 2)."""
    xy = (points - K[:2, 2]) / np.array([K[0, 0], K[1, 1]])
    return np.concatenate([xy, np.ones_like(xy[..., :1])], -1)


def grid_points(size: tuple[int, int], ring: int = 0) -> AnyArray:
    """Return the centres (h, w, 2) of the 4 x 4 cells of an image, with `ring` more cells all round."""
    width, height = size
    x = np.arange(-ring, width // GRID + ring) * GRID + (GRID - 1) / 2
    y = np.arange(-ring, height // GRID + ring) * GRID + (GRID - 1) / 2
    return np.stack(np.meshgrid(x, y), -1)


@functools.lru_cache(maxsize=4)
def pixel_grid(size: tuple[int, int]) -> AnyArray:
    """Return the position (x, y) of every pixel, read-only float32 (H, W, 2)."""
    pixels = np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), -1).astype(np.float32)
    pixels.setflags(write=False)  # shared between all sub-frames
    return pixels


@dataclass(frozen=True, kw_only=True)
class Exposure:
    """A pinhole camera that moves while its shutter is open; at tau = 0 its frame is that of the scene."""

    camera: Trajectory
    K: AnyArray
    size: tuple[int, int]

    def moved(self, points: AnyArray, layer: Layer, tau: float) -> AnyArray:
        """Return image positions (..., 2) at time tau of surface points seen at `points` at mid exposure."""
        rays = pixel_rays(points, self.K)
        rho = layer.inverse_depth(rays, points / np.array(self.size))[..., None]
        if layer.own_path is not None:
            R_own, shift = layer.own_path.at(tau)
            rays = (rays - rho * layer.pivot) @ R_own.T + rho * (layer.pivot + shift)
        R, centre = self.camera.at(tau)
        homogeneous = (rays - rho * centre) @ (self.K @ R).T
        return np.asarray(homogeneous[..., :2] / np.maximum(homogeneous[..., 2:], 0.05))

    def ends(self, points: AnyArray, layer: Layer) -> tuple[AnyArray, AnyArray]:
        """Return the positions (..., 2) at shutter-open and shutter-close."""
        return self.moved(points, layer, -0.5), self.moved(points, layer, 0.5)

    def smear_lengths(self, points: AnyArray, layers: list[Layer]) -> AnyArray:
        """Return the smear lengths (layers, ...) at points, as if every layer were visible everywhere."""
        ends = [self.ends(points, layer) for layer in layers]
        return np.stack([np.linalg.norm(close - start, axis=-1) for start, close in ends])

    def inverse_displacements(self, layer: Layer) -> AnyArray:
        """Return, per knot, g (h+2, w+2, 2): what is seen at y at that time was at y + g at mid exposure.

        Fixed-point iteration on y = W(x); it converges because smears vary slowly over a surface. Where it
        has not converged the cross-check of the truth fails and the pixel is marked invalid.
        """
        target = grid_points(self.size, ring=1)
        fields = []
        for tau in KNOTS:
            x = target.copy()
            for _ in range(8):
                x = x - (self.moved(x, layer, tau) - target)
            fields.append(x - target)
        return np.stack(fields)


def knot_weights(tau: AnyArray) -> AnyArray:
    """Return the Lagrange weights (N, knots) that interpolate the knots' fields at times tau (N,)."""
    gaps = KNOTS[:, None] - KNOTS[None] + np.eye(len(KNOTS))
    factors = (tau[:, None, None] - KNOTS[None, None, :]) / gaps[None]
    weights: AnyArray = np.prod(np.where(np.eye(len(KNOTS), dtype=bool), 1.0, factors), axis=2)
    return weights


def upsample(field: AnyArray, size: tuple[int, int]) -> AnyArray:
    """Return a ringed grid field (h+2, w+2, 2) interpolated to pixels: float32 (H, W, 2)."""
    coarse = field.astype(np.float32)
    large = np.asarray(cv2.resize(coarse, None, fx=GRID, fy=GRID, interpolation=cv2.INTER_LINEAR))
    return large[GRID : GRID + size[1], GRID : GRID + size[0]]
