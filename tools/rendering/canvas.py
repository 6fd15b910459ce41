"""Layers painted at mid exposure: textures at the level of detail each pixel needs, outlines, highlights."""

from dataclasses import dataclass

import cv2
import numpy as np

from blur2view.arrays import AnyArray
from tools.rendering.exposure import pixel_rays
from tools.rendering.scene import Layer, Plane, sample_grid


@dataclass(frozen=True, kw_only=True)
class Canvas:
    """A layer painted at mid exposure.

    ``rgba`` (h, w, 4) is float32, linear, premultiplied; its column c shows image position
    ``left + c / detail``, ``detail`` being canvas pixels per image pixel.
    """

    rgba: AnyArray
    left: float
    top: float
    detail: float
    layer: Layer

    def warp(self, positions: AnyArray) -> AnyArray:
        """Return RGBA (h, w, 4) at mid-exposure image positions (h, w, 2), float32."""
        x = (positions[..., 0] - np.float32(self.left)) * np.float32(self.detail)
        y = (positions[..., 1] - np.float32(self.top)) * np.float32(self.detail)
        border = cv2.BORDER_REPLICATE if self.layer.stencil is None else cv2.BORDER_CONSTANT
        return np.asarray(cv2.remap(self.rgba, x, y, cv2.INTER_LINEAR, None, border))

    def region(self, field: AnyArray, size: tuple[int, int]) -> tuple[slice, slice] | None:
        """Return the rows and columns of the image that a displacement field takes it to; None if none."""
        if self.layer.stencil is None:
            return slice(0, size[1]), slice(0, size[0])
        rows, columns = self.rgba.shape[:2]
        low, high = field.min((0, 1)), field.max((0, 1))
        x0, x1 = int(self.left - high[0]) - 2, int(self.left + columns / self.detail - low[0]) + 3
        y0, y1 = int(self.top - high[1]) - 2, int(self.top + rows / self.detail - low[1]) + 3
        x0, x1, y0, y1 = max(x0, 0), min(x1, size[0]), max(y0, 0), min(y1, size[1])
        return (slice(y0, y1), slice(x0, x1)) if x0 < x1 and y0 < y1 else None


def texel_spacing(texel: AnyArray) -> AnyArray:
    """Return the largest texture step (h, w) between neighbouring canvas pixels (h, w, 2)."""
    spacing: AnyArray = np.zeros(texel.shape[:2], np.float32)
    for axis in (0, 1):
        step = np.abs(np.diff(texel, axis=axis))
        padding = [(0, int(axis == k)) for k in (0, 1)]
        padded = np.pad(np.maximum(step[..., 0], step[..., 1]), padding, mode="edge")
        np.maximum(spacing, padded, out=spacing)
    return spacing


def textured(plane: Plane, rays: AnyArray) -> AnyArray:
    """Return linear RGB (h, w, 3) of a plane along rays, filtered by the level of detail each pixel needs."""
    texel = plane.texel(rays).astype(np.float32)
    level = np.clip(np.log2(np.maximum(texel_spacing(texel), 1e-3)), 0, 5)
    pyramid: AnyArray = plane.texture
    result: AnyArray = np.zeros((*rays.shape[:2], 3), np.float32)
    for k in range(int(np.ceil(level.max())) + 1):
        weight = np.clip(1 - np.abs(level - k), 0, 1)
        if weight.max() > 0:
            at = texel * np.float32(0.5**k)
            period = np.array([2 * pyramid.shape[1], 2 * pyramid.shape[0]], np.float32)
            at = at - np.floor(at / period) * period  # remap itself walks back one period at a time
            columns, rows = at[..., 0], at[..., 1]
            shown = cv2.remap(pyramid, columns, rows, cv2.INTER_LINEAR, None, cv2.BORDER_REFLECT)
            result += weight[..., None] * shown
        pyramid = np.asarray(cv2.pyrDown(pyramid))
    return result


def stencil_alpha(layer: Layer, points: AnyArray) -> AnyArray:
    """Return the alpha (h, w) of a layer at image points (h, w, 2), filtered against aliasing."""
    if layer.stencil is None:
        return np.ones(points.shape[:2], np.float32)
    x, y, width, height = layer.box
    size = layer.stencil.shape[0]
    scale = np.array([size / width, size / height])
    at = ((points - (x, y)) * scale - 0.5).astype(np.float32)
    shrink = max(1.0, float(scale.max()) * float(points[0, 1, 0] - points[0, 0, 0]))
    stencil = layer.stencil
    if shrink > 1.2:
        stencil = np.asarray(cv2.GaussianBlur(stencil, (0, 0), 0.4 * shrink))
    columns, rows = at[..., 0], at[..., 1]
    return np.asarray(cv2.remap(stencil, columns, rows, cv2.INTER_LINEAR, None, cv2.BORDER_CONSTANT))


def surface_colour(layer: Layer, rays: AnyArray) -> AnyArray:
    """Return linear RGB (h, w, 3) along rays: of the nearest plane of the layer."""
    rgb = textured(layer.planes[0], rays)
    if len(layer.planes) == 1:
        return rgb
    nearest = np.argmax(np.stack([plane.inverse_depth(rays) for plane in layer.planes]), axis=0)
    for index, plane in enumerate(layer.planes[1:], 1):
        if (nearest == index).any():
            rgb = np.where((nearest == index)[..., None], textured(plane, rays), rgb)
    return rgb


def canvas_points(layer: Layer, size: tuple[int, int], margin: float, detail: float) -> AnyArray:
    """Return the image positions (h, w, 2) of a canvas: image and margin, as far as the layer covers them."""
    left, top, right, bottom = -margin, -margin, size[0] + margin, size[1] + margin
    if layer.stencil is not None:
        x, y, width, height = layer.box
        left, top = max(left, x - 1), max(top, y - 1)
        right, bottom = min(right, x + width + 1), min(bottom, y + height + 1)
    columns, rows = int(max(right - left, 4) * detail), int(max(bottom - top, 4) * detail)
    return np.stack(np.meshgrid(left + np.arange(columns) / detail, top + np.arange(rows) / detail), -1)


def paint(
    rng: np.random.Generator, layer: Layer, K: AnyArray, size: tuple[int, int], margin: float, detail: float
) -> Canvas:
    """Return a layer painted over the part of the image, and of a margin in pixels, that it covers.

    ``margin`` is how far beyond the border motion may reach, pixels; ``detail`` canvas pixels per image
    pixel.
    """
    points = canvas_points(layer, size, margin, detail)
    rgb = surface_colour(layer, pixel_rays(points, K).astype(np.float32))
    rgb = rgb * sample_grid(layer.illumination, points / np.array(size))[..., None]
    rgb = add_highlights(rng, rgb)
    alpha = stencil_alpha(layer, points)[..., None]
    rgba = np.concatenate([np.clip(rgb, 0, 60) * alpha, alpha], -1)
    left, top = float(points[0, 0, 0]), float(points[0, 0, 1])
    return Canvas(rgba=rgba.astype(np.float32), left=left, top=top, detail=detail, layer=layer)


def add_highlights(rng: np.random.Generator, rgb: AnyArray) -> AnyArray:
    """Return a surface with, in one case of eight, specular glints and lamps, far above white."""
    if rng.random() > 0.12:
        return rgb
    glow = np.zeros(rgb.shape[:2], np.float32)
    for _ in range(int(rng.integers(1, 25))):
        x, y = rng.uniform(0, rgb.shape[1]), rng.uniform(0, rgb.shape[0])
        radius, light = rng.uniform(0.5, 4), float(rng.uniform(2, 25))
        cv2.circle(glow, (int(x * 8), int(y * 8)), int(radius * 8), light, -1, cv2.LINE_AA, 3)
    return np.asarray(rgb + glow[..., None] * rng.uniform(0.7, 1.0, 3).astype(np.float32))
