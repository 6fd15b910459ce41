"""Render one motion-blurred picture with exact smears from one integer seed.

Layers of a scene (`scene`) are painted at mid exposure and moved along the camera's path; sub-frames are
averaged in linear light, at least one per pixel of the longest smear. The truth is computed from the
geometry, not from the picture.
"""

import functools
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from blur2view.arrays import AnyArray
from blur2view.geometry.epipolar import fundamental_from_pose
from blur2view.smears.grid import upsample_grid
from tools.rendering.scene import (
    Layer,
    Plane,
    Trajectory,
    sample_camera_path,
    sample_grid,
    sample_intrinsics,
    sample_layers,
    sample_object_path,
)
from tools.rendering.sensor import log_uniform
from tools.rendering.textures import photographs

KNOTS = (1 - np.cos(np.linspace(0, np.pi, 7))) / 2 - 0.5
"""Chebyshev-Lobatto exposure times at which inverse displacement fields are solved; both ends included."""
GRID = 4
"""Spacing in pixels of those fields and of the stored truth; cell j has its centre at pixel 4 j + 1.5."""
MAX_MARGIN_PX, DETAIL = 160.0, 1.5
"""How far beyond the border layers are painted at most; canvas pixels per image pixel."""
GLINT_SHARE = 0.12  # of layers with specular glints and lamps
CROSS_CHECK_PX = (
    1.0  # largest distance of a cell's point from the point seen at its smear's end: the paper's eps
)

Size = tuple[int, int]
"""Width and height, pixels."""


@dataclass(frozen=True, kw_only=True)
class SceneTruth:
    """The truth of one exposure; of the points seen at mid exposure at the centres of 4 x 4 pixel cells.

    ``displacement`` (H/4, W/4, 2) is d = close - open in pixels, exact. ``valid``: both ends are inside the
    image and visible (the cross-check map). ``static`` is false on moving objects. ``K`` are the intrinsics,
    ``R``, ``t`` is ``cam_close_from_cam_open``, ``F`` of unit norm, ``points_close^T F points_open = 0``,
    None without translation. ``kind`` is that of the camera's path (`scene.PATHS`).
    """

    displacement: AnyArray
    valid: AnyArray
    static: AnyArray
    K: AnyArray
    R: AnyArray
    t: AnyArray
    F: AnyArray | None
    kind: str

    @property
    def median_px(self) -> float:
        """The median length of valid smears."""
        return float(np.median(np.linalg.norm(self.displacement[self.valid], axis=-1)))


@dataclass(frozen=True, kw_only=True)
class Rendering(SceneTruth):
    """One rendered exposure with its truth.

    ``linear`` (H, W, 3) is the float32 mean radiance over the exposure, 0 to about 4 (highlights),
    ``open_image`` and ``close_image`` are its sharp first and last instants.
    """

    linear: AnyArray
    open_image: AnyArray
    close_image: AnyArray


@dataclass(frozen=True, kw_only=True)
class RenderOptions:
    """What a scene may be; the defaults are those of the test split.

    ``size`` are multiples of 4, pixels; ``smear_px`` is the range of the median smear of what stands still,
    log-uniform. A ``mover_share`` of scenes has one or two moving objects. ``photos`` is a folder of further
    textures.
    """

    size: Size = (640, 480)
    smear_px: tuple[float, float] = (4.0, 60.0)
    mover_share: float = 0.45
    photos: Path | None = None


def pixel_rays(points: AnyArray, K: AnyArray) -> AnyArray:
    """Return rays (..., 3) with z = 1 through pixels (..., 2)."""
    xy = (points - K[:2, 2]) / np.array([K[0, 0], K[1, 1]])
    return np.concatenate([xy, np.ones_like(xy[..., :1])], -1)


def grid_points(size: Size, ring: int = 0) -> AnyArray:
    """Return the centres (h, w, 2) of the 4 x 4 cells of an image, with `ring` more cells all round."""
    x, y = (np.arange(-ring, side // GRID + ring) * GRID + (GRID - 1) / 2 for side in size)
    return np.stack(np.meshgrid(x, y), -1)


@functools.lru_cache(maxsize=4)
def pixel_grid(size: Size) -> AnyArray:
    """Return the position (x, y) of every pixel, read-only float32 (H, W, 2)."""
    pixels = np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), -1).astype(np.float32)
    pixels.setflags(write=False)  # shared between all sub-frames
    return pixels


def remapped(values: AnyArray, at: AnyArray, border: int = cv2.BORDER_CONSTANT) -> AnyArray:
    """Return values (h, w, ...) interpolated linearly at positions (..., 2), float32."""
    return np.asarray(cv2.remap(values, at[..., 0], at[..., 1], cv2.INTER_LINEAR, None, border))


@dataclass(frozen=True, kw_only=True)
class Exposure:
    """A pinhole camera that moves while its shutter is open; at tau = 0 its frame is that of the scene."""

    camera: Trajectory
    K: AnyArray
    size: Size

    def moved(self, points: AnyArray, layer: Layer, tau: float) -> AnyArray:
        """Return image positions (h, w, 2) at time tau of surface points seen at `points` at mid exposure."""
        rays = pixel_rays(points, self.K)
        rho = layer.inverse_depth(rays, points / np.array(self.size))[..., None]
        if layer.own_path is not None:
            R_own, shift = layer.own_path.at(tau)
            rays = (rays - rho * layer.pivot) @ R_own.T + rho * (layer.pivot + shift)
        R, centre = self.camera.at(tau)
        homogeneous = (rays - rho * centre) @ (self.K @ R).T
        return np.asarray(homogeneous[..., :2] / np.maximum(homogeneous[..., 2:], 0.05))

    def inverse_displacements(self, layer: Layer) -> AnyArray:
        """Return, per knot, g (h+2, w+2, 2): the point seen at y at that time is at y + g at mid exposure.

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

    def scaled(self, layers: list[Layer], length_px: float) -> "Exposure":
        """Return a path of unit size scaled to a median smear over all layers, the longest bounded."""
        points, factor = grid_points(self.size)[::4, ::4], 0.01

        def at(factor: float) -> Exposure:
            return replace(self, camera=self.camera.scaled(factor))

        def lengths(factor: float) -> AnyArray:
            first, last = ([at(factor).moved(points, layer, tau) for layer in layers] for tau in (-0.5, 0.5))
            return np.asarray(np.linalg.norm(np.subtract(last, first), axis=-1))

        for _ in range(4):
            factor = min(factor * (length_px / max(float(np.median(lengths(factor))), 1e-3)), 0.6)
        longest = float(np.quantile(lengths(factor), 0.98))
        return at(factor * min(1.0, (2.5 * length_px + 10) / max(longest, 1e-9)))


def knot_weights(tau: AnyArray) -> AnyArray:
    """Return the Lagrange weights (N, knots) that interpolate the knots' fields at times tau (N,)."""
    same = np.eye(len(KNOTS), dtype=bool)
    factors = (tau[:, None, None] - KNOTS) / (KNOTS[:, None] - KNOTS + same)
    return np.asarray(np.prod(np.where(same, 1.0, factors), axis=2))


def positions_of(field: AnyArray) -> AnyArray:
    """Return the mid-exposure position (H, W, 2) of each pixel, by inverse displacements (h+2, w+2, 2)."""
    displacement = upsample_grid(field.astype(np.float32), GRID)[GRID:-GRID, GRID:-GRID]
    return pixel_grid(displacement.shape[1::-1]) + displacement


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
        at = (positions - np.array([self.left, self.top], np.float32)) * np.float32(self.detail)
        border = cv2.BORDER_REPLICATE if self.layer.stencil is None else cv2.BORDER_CONSTANT
        return remapped(self.rgba, at, border)


def textured(plane: Plane, rays: AnyArray) -> AnyArray:
    """Return linear RGB (h, w, 3) of a plane along rays, filtered by the level of detail each pixel needs."""
    texel = plane.texel(rays).astype(np.float32)
    spacing: AnyArray = np.zeros(texel.shape[:2], np.float32)
    for axis in (0, 1):  # the largest step in the texture between neighbouring pixels
        step = np.abs(np.diff(texel, axis=axis)).max(-1)
        np.maximum(spacing, np.pad(step, [(0, int(axis == k)) for k in (0, 1)], mode="edge"), out=spacing)
    level = np.clip(np.log2(np.maximum(spacing, 1e-3)), 0, 5)
    pyramid: AnyArray = plane.texture
    result: AnyArray = np.zeros((*rays.shape[:2], 3), np.float32)
    for k in range(int(np.ceil(level.max())) + 1):
        weight = np.clip(1 - np.abs(level - k), 0, 1)
        if weight.max() > 0:
            at = texel * np.float32(0.5**k)
            period = np.array([2 * pyramid.shape[1], 2 * pyramid.shape[0]], np.float32)
            at = at - np.floor(at / period) * period  # remap itself walks back one period at a time
            result += weight[..., None] * remapped(pyramid, at, cv2.BORDER_REFLECT)
        pyramid = np.asarray(cv2.pyrDown(pyramid))
    return result


def surface_colour(layer: Layer, rays: AnyArray) -> AnyArray:
    """Return linear RGB (h, w, 3) along rays: of the nearest plane of the layer."""
    nearest = np.argmax([plane.inverse_depth(rays) for plane in layer.planes], axis=0)[..., None]
    rgb: AnyArray = np.zeros((*rays.shape[:2], 3), np.float32)
    for index in np.unique(nearest):
        rgb = np.where(nearest == index, textured(layer.planes[index], rays), rgb)
    return rgb


def stencil_alpha(layer: Layer, points: AnyArray) -> AnyArray:
    """Return the alpha (h, w) of a layer at image points (h, w, 2), filtered against aliasing."""
    if layer.stencil is None:
        return np.ones(points.shape[:2], np.float32)
    x, y, width, height = layer.box
    stencil = layer.stencil
    scale = len(stencil) / np.array([width, height])
    shrink = float(scale.max()) * float(points[0, 1, 0] - points[0, 0, 0])
    if shrink > 1.2:
        stencil = np.asarray(cv2.GaussianBlur(stencil, (0, 0), 0.4 * shrink))
    return remapped(stencil, ((points - (x, y)) * scale - 0.5).astype(np.float32))


def paint(
    rng: np.random.Generator, layer: Layer, K: AnyArray, size: Size, margin: float, detail: float = DETAIL
) -> Canvas:
    """Return a layer painted over the part of the image that it covers.

    ``margin`` is how far beyond the border motion may reach, pixels; ``detail`` canvas pixels per image
    pixel. `rng` draws highlights.
    """
    left, top, right, bottom = -margin, -margin, size[0] + margin, size[1] + margin
    if layer.stencil is not None:
        x, y, width, height = layer.box
        left, top = max(left, x - 1), max(top, y - 1)
        right, bottom = min(right, x + width + 1), min(bottom, y + height + 1)
    columns, rows = (np.arange(int(max(side, 4) * detail)) / detail for side in (right - left, bottom - top))
    points = np.stack(np.meshgrid(left + columns, top + rows), -1)
    rgb = surface_colour(layer, pixel_rays(points, K).astype(np.float32))
    rgb = rgb * sample_grid(layer.illumination, points / np.array(size))[..., None]
    rgb = np.clip(add_highlights(rng, rgb), 0, 60)
    alpha = stencil_alpha(layer, points)[..., None]
    rgba = np.concatenate([rgb * alpha, alpha], -1).astype(np.float32)
    return Canvas(rgba=rgba, left=left, top=top, detail=detail, layer=layer)


def add_highlights(rng: np.random.Generator, rgb: AnyArray) -> AnyArray:
    """Return a surface with, in one case of eight, specular glints and lamps, far above white."""
    if rng.random() > GLINT_SHARE:
        return rgb
    glow = np.zeros(rgb.shape[:2], np.float32)
    for _ in range(int(rng.integers(1, 25))):
        x, y = rng.uniform(0, rgb.shape[1]), rng.uniform(0, rgb.shape[0])
        radius, light = rng.uniform(0.5, 4), float(rng.uniform(2, 25))
        cv2.circle(glow, (int(x * 8), int(y * 8)), int(radius * 8), light, -1, cv2.LINE_AA, 3)
    return np.asarray(rgb + glow[..., None] * rng.uniform(0.7, 1.0, 3).astype(np.float32))


def compose(canvases: list[Canvas], fields: list[AnyArray]) -> AnyArray:
    """Return one sharp sub-frame (H, W, 3): layers displaced by their fields, composed far to near."""
    frame: AnyArray = np.zeros(3, np.float32)
    for canvas, field in zip(canvases, fields, strict=True):
        rgba = canvas.warp(positions_of(field))
        frame = frame * (1 - rgba[..., 3:]) + rgba[..., :3]
    return frame


def mean_frame(canvases: list[Canvas], fields: list[AnyArray]) -> AnyArray:
    """Return the average of sub-frames (H, W, 3) at the centres of 15 to 200 equal parts of the exposure."""
    longest = max(np.linalg.norm(f[-1] - f[0], axis=-1).max() for f in fields)
    count = int(np.clip(np.ceil(longest), 15, 200))
    total: AnyArray = np.zeros(3, np.float32)
    for weights in knot_weights((np.arange(count) + 0.5) / count - 0.5):
        total = total + compose(canvases, [np.tensordot(weights, f, 1) for f in fields])
    return total / np.float32(count)


def end_visible(canvases: list[Canvas], fields: list[AnyArray], end: AnyArray, points: AnyArray) -> AnyArray:
    """Whether smears' ends (h, w, 2) are inside the image and show the points of the cells.

    ``fields`` are the layers' inverse displacements at that time.
    """
    origin = positions_of(fields[0])  # where the point seen at each pixel is at mid exposure
    for canvas, field in zip(canvases[1:], fields[1:], strict=True):
        positions = positions_of(field)
        visible = canvas.warp(positions)[..., 3] > 0.5
        origin[visible] = positions[visible]
    seen = remapped(origin, end.astype(np.float32), cv2.BORDER_REPLICATE)
    inside = ((end >= 0) & (end <= np.array(origin.shape[1::-1]) - 1)).all(-1)
    return np.asarray(inside & (np.linalg.norm(seen - points, axis=-1) < CROSS_CHECK_PX))


def expose(rng: np.random.Generator, layers: list[Layer], exposure: Exposure, kind: str) -> Rendering:
    """Return the painted layers' average of sub-frames with the truth; `rng` draws the highlights."""
    size, points = exposure.size, grid_points(exposure.size)
    fields = [exposure.inverse_displacements(layer) for layer in layers]
    margin = min(float(max(np.abs(f).max() for f in fields)), MAX_MARGIN_PX) + 4
    canvases = [paint(rng, layer, exposure.K, size, margin) for layer in layers]
    index = np.zeros(points.shape[:2], np.int64)  # of the layer that is seen at mid exposure
    for k, canvas in enumerate(canvases[1:], 1):
        index[canvas.warp(points.astype(np.float32))[..., 3] > 0.5] = k
    ends, instants, valid = [], [], np.ones(index.shape, bool)
    for tau, knot in ((-0.5, 0), (0.5, -1)):
        there, at = [exposure.moved(points, layer, tau) for layer in layers], [f[knot] for f in fields]
        ends.append(np.take_along_axis(np.stack(there), index[None, ..., None], 0)[0])
        valid &= end_visible(canvases, at, ends[-1], points)
        instants.append(compose(canvases, at))
    (R_open, C_open), (R_close, C_close) = exposure.camera.at(-0.5), exposure.camera.at(0.5)
    R, t = R_close @ R_open.T, R_close @ (C_open - C_close)
    return Rendering(
        displacement=(ends[1] - ends[0]).astype(np.float32),
        valid=valid,
        static=np.array([layer.own_path is None for layer in layers])[index],
        K=exposure.K,
        R=R,
        t=t,
        F=fundamental_from_pose(exposure.K, R, t) if np.linalg.norm(t) > 1e-9 else None,
        kind=kind,
        linear=mean_frame(canvases, fields),
        open_image=instants[0],
        close_image=instants[1],
    )


def set_in_motion(rng: np.random.Generator, layers: list[Layer], camera: Trajectory) -> list[Layer]:
    """Return layers, one or two rather large cards of which move as fast as the camera."""
    area = np.array([layer.box[2] * layer.box[3] for layer in layers])  # the background's is zero
    count = min(int(rng.integers(1, 3)), len(layers) - 1)
    chosen = set(rng.choice(len(layers), count, replace=False, p=area / area.sum()).tolist())
    return [
        replace(layer, own_path=sample_object_path(rng, camera)) if k in chosen else layer
        for k, layer in enumerate(layers)
    ]


def render(seed: int, options: RenderOptions) -> Rendering:
    """Return one rendered scene with its truth; the same seed and options give the same bytes."""
    rng, size = np.random.default_rng([seed, 1]), options.size
    K = sample_intrinsics(rng, size)
    layers = sample_layers(rng, photographs(options.photos), K, size)
    camera, kind = sample_camera_path(rng)
    rng.random()  # seeds stand for the scenes of earlier versions, which drew sharp ones and paces here
    length_px, _ = (log_uniform(rng, options.smear_px) for _ in range(2))
    exposure = Exposure(camera=camera, K=K, size=size).scaled(layers, length_px)
    if len(layers) > 1 and rng.random() <= options.mover_share:
        layers = set_in_motion(rng, layers, exposure.camera)
    return expose(rng, layers, exposure, kind)
