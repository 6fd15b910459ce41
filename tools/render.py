"""Render motion-blurred photographs with exact smears: ``python -m tools.render --help``.

A scene (:mod:`tools.scene`) is moved along a camera path (:mod:`tools.motion`); sub-frames are averaged
in linear light, at least one per pixel of the longest smear; the truth is computed from the geometry, not
from the picture. Everything follows from one integer seed.
"""

from __future__ import annotations

import argparse
import multiprocessing
import time
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path as FilePath
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tools.motion import Path, sample_camera_path, sample_object_path
from tools.scene import Layer, sample_grid, sample_intrinsics, sample_layers
from tools.textures import photographs

Array = NDArray[Any]

KNOTS = (1 - np.cos(np.linspace(0, np.pi, 7))) / 2 - 0.5
"""Chebyshev-Lobatto exposure times at which inverse displacement fields are solved; both ends included."""
GRID = 4
"""Spacing in pixels of those fields and of the stored truth; cell j has its centre at pixel 4 j + 1.5."""


@dataclass(frozen=True, kw_only=True)
class RenderOptions:
    """What a scene may be.

    Attributes
    ----------
    size : tuple of int
        Image width and height in pixels, multiples of 4.
    smear_px : tuple of float
        Range of the median static smear length, log-uniform.
    sharp_share : float
        Share of scenes with median smears under one pixel instead.
    mover_share : float
        Share of scenes with one or two moving objects.
    straight : bool
        Constant velocity only.
    split : {"train", "test"}
        Which photographs may be textures.
    photos : Path or None
        Folder of further photographs.
    detail : float
        Canvas pixels per image pixel.
    """

    size: tuple[int, int] = (320, 240)
    smear_px: tuple[float, float] = (2.0, 48.0)
    sharp_share: float = 0.07
    mover_share: float = 0.3
    straight: bool = False
    split: str = "train"
    photos: FilePath | None = None
    detail: float = 1.5


@dataclass(frozen=True, kw_only=True)
class Rendering:
    """One rendered exposure with its truth; the grid truth has shape (H/4, W/4).

    Attributes
    ----------
    linear : ndarray of shape (H, W, 3)
        float32 mean radiance over the exposure, 0 to about 4 (highlights).
    displacement : ndarray of shape (H/4, W/4, 2)
        Exact d = close - open in pixels of the point seen at mid exposure.
    middle_offset : ndarray of shape (H/4, W/4, 2)
        Midpoint of the two ends minus the mid-exposure position, pixels: the smear's bend.
    valid : ndarray of shape (H/4, W/4)
        Both ends are inside the image and visible (cross-check map, eps = 1 px).
    static : ndarray of shape (H/4, W/4)
        False on moving objects.
    K, R, t : ndarray
        Intrinsics; ``cam_close_from_cam_open``.
    F : ndarray of shape (3, 3) or None
        ``points_close^T F points_open = 0``, unit norm; None without translation.
    open_image, close_image : ndarray of shape (H, W, 3)
        Sharp linear first and last sub-frames.
    """

    linear: Array
    displacement: Array
    middle_offset: Array
    valid: Array
    static: Array
    K: Array
    R: Array
    t: Array
    F: Array | None
    kind: str
    straight: bool
    open_image: Array
    close_image: Array


def pixel_rays(points: Array, K: Array) -> Array:
    """Rays (..., 3) with z = 1 through pixels (..., 2)."""
    xy = (points - K[:2, 2]) / np.array([K[0, 0], K[1, 1]])
    return np.concatenate([xy, np.ones_like(xy[..., :1])], -1)


def moved(points: Array, layer: Layer, camera: Path, K: Array, size: tuple[int, int], tau: float) -> Array:
    """Image positions (..., 2) at time tau of the surface points seen at `points` at mid exposure."""
    rays = pixel_rays(points, K)
    rho = layer.inverse_depth(rays, points / np.array(size))[..., None]
    if layer.own_path is not None:
        R_own, shift = layer.own_path.at(tau)
        rays = (rays - rho * layer.pivot) @ R_own.T + rho * (layer.pivot + shift)
    R, centre = camera.at(tau)
    homogeneous = (rays - rho * centre) @ (K @ R).T
    return homogeneous[..., :2] / np.maximum(homogeneous[..., 2:], 0.05)


def grid_points(size: tuple[int, int], ring: int = 0) -> Array:
    """Centres (h, w, 2) of the 4 x 4 cells of an image, with `ring` more cells all round."""
    width, height = size
    x = np.arange(-ring, width // GRID + ring) * GRID + (GRID - 1) / 2
    y = np.arange(-ring, height // GRID + ring) * GRID + (GRID - 1) / 2
    return np.stack(np.meshgrid(x, y), -1)


def inverse_displacements(layer: Layer, camera: Path, K: Array, size: tuple[int, int]) -> Array:
    """Per knot, the field g (h+2, w+2, 2): what is seen at y at that time was at y + g at mid exposure.

    Fixed-point iteration on y = W(x); it converges because smears vary slowly over a surface.
    """
    target = grid_points(size, ring=1)
    fields = []
    for tau in KNOTS:
        x = target.copy()
        for _ in range(8):
            x = x - (moved(x, layer, camera, K, size, tau) - target)
        fields.append(x - target)
    return np.stack(fields)


def knot_weights(tau: Array) -> Array:
    """Lagrange weights (N, knots) that interpolate the knots' fields at times tau (N,)."""
    gaps = KNOTS[:, None] - KNOTS[None] + np.eye(len(KNOTS))
    factors = (tau[:, None, None] - KNOTS[None, None, :]) / gaps[None]
    return np.prod(np.where(np.eye(len(KNOTS), dtype=bool), 1.0, factors), axis=2)


def upsample(field: Array, size: tuple[int, int]) -> Array:
    """Full-resolution float32 field (H, W, 2) from a ringed grid field."""
    large = cv2.resize(field.astype(np.float32), None, fx=GRID, fy=GRID, interpolation=cv2.INTER_LINEAR)
    return large[GRID : GRID + size[1], GRID : GRID + size[0]]


def texel_spacing(texel: Array) -> Array:
    """Largest texture step (h, w) between neighbouring canvas pixels."""
    spacing: Array = np.zeros(texel.shape[:2], np.float32)
    for axis in (0, 1):
        step = np.abs(np.diff(texel, axis=axis))
        padded = np.pad(np.maximum(step[..., 0], step[..., 1]), [(0, int(axis == k)) for k in (0, 1)], mode="edge")
        np.maximum(spacing, padded, out=spacing)
    return spacing


def textured(plane: Any, rays: Array) -> Array:
    """Linear RGB (h, w, 3) of a plane along rays, filtered by the level of detail each pixel needs."""
    texel = plane.texel(rays).astype(np.float32)
    level = np.clip(np.log2(np.maximum(texel_spacing(texel), 1e-3)), 0, 5)
    pyramid, result = plane.texture, np.zeros((*rays.shape[:2], 3), np.float32)
    for k in range(int(np.ceil(level.max())) + 1):
        weight = np.clip(1 - np.abs(level - k), 0, 1)
        if weight.max() > 0:
            period = np.array([2 * pyramid.shape[1], 2 * pyramid.shape[0]], np.float32)
            at = texel * np.float32(0.5**k)
            at -= np.floor(at / period) * period  # mirrored repetition; remap itself walks there one period at a time
            colour = cv2.remap(pyramid, at, None, cv2.INTER_LINEAR, None, cv2.BORDER_REFLECT)
            result += weight[..., None] * colour
        pyramid = cv2.pyrDown(pyramid)
    return result


@dataclass(frozen=True, kw_only=True)
class Canvas:
    """A layer painted at mid exposure: premultiplied linear RGBA; pixel (x, y) lies at (x - left) * detail."""

    rgba: Array
    left: float
    top: float
    detail: float
    layer: Layer

    def warp(self, positions: Array, interpolation: int = cv2.INTER_LINEAR) -> Array:
        """RGBA (h, w, 4) at mid-exposure image positions (h, w, 2)."""
        x = (positions[..., 0] - np.float32(self.left)) * np.float32(self.detail)
        y = (positions[..., 1] - np.float32(self.top)) * np.float32(self.detail)
        border = cv2.BORDER_REPLICATE if self.layer.stencil is None else cv2.BORDER_CONSTANT
        return cv2.remap(self.rgba, x, y, interpolation, None, border)


def stencil_alpha(layer: Layer, points: Array) -> Array:
    """Alpha (h, w) of a card at image points (h, w, 2), filtered against aliasing."""
    if layer.stencil is None:
        return np.ones(points.shape[:2], np.float32)
    x, y, width, height = layer.box
    size = layer.stencil.shape[0]
    scale = np.array([size / width, size / height])
    at = ((points - (x, y)) * scale - 0.5).astype(np.float32)
    shrink = max(1.0, float(scale.max()) * float(points[0, 1, 0] - points[0, 0, 0]))
    stencil = cv2.GaussianBlur(layer.stencil, (0, 0), 0.4 * shrink) if shrink > 1.2 else layer.stencil
    return cv2.remap(stencil, at[..., 0], at[..., 1], cv2.INTER_LINEAR, None, cv2.BORDER_CONSTANT)


def paint(
    rng: np.random.Generator, layer: Layer, K: Array, size: tuple[int, int], margin: float, detail: float
) -> Canvas:
    """Paint a layer over the part of the image (and a margin) that it covers."""
    left, top, right, bottom = -margin, -margin, size[0] + margin, size[1] + margin
    if layer.stencil is not None:
        x, y, width, height = layer.box
        left, top = max(left, x - 1), max(top, y - 1)
        right, bottom = min(right, x + width + 1), min(bottom, y + height + 1)
    columns, rows = int(max(right - left, 4) * detail), int(max(bottom - top, 4) * detail)
    points = np.stack(np.meshgrid(left + np.arange(columns) / detail, top + np.arange(rows) / detail), -1)
    rays = pixel_rays(points, K).astype(np.float32)
    rgb = textured(layer.planes[0], rays)
    if len(layer.planes) > 1:
        depth = np.stack([plane.inverse_depth(rays) for plane in layer.planes])
        nearest = np.argmax(depth, axis=0)
        for index, plane in enumerate(layer.planes[1:], 1):
            if (nearest == index).any():
                rgb = np.where((nearest == index)[..., None], textured(plane, rays), rgb)
    rgb = rgb * sample_grid(layer.illumination, points / np.array(size))[..., None]
    rgb = add_highlights(rng, rgb)
    alpha = stencil_alpha(layer, points)[..., None]
    rgba = np.concatenate([np.clip(rgb, 0, 60) * alpha, alpha], -1)
    return Canvas(rgba=rgba.astype(np.float32), left=left, top=top, detail=detail, layer=layer)


def add_highlights(rng: np.random.Generator, rgb: Array) -> Array:
    """Specular glints and lamps, far above white, on one surface in eight."""
    if rng.random() > 0.12:
        return rgb
    glow = np.zeros(rgb.shape[:2], np.float32)
    for _ in range(int(rng.integers(1, 25))):
        x, y = rng.uniform(0, rgb.shape[1]), rng.uniform(0, rgb.shape[0])
        radius = rng.uniform(0.5, 4)
        cv2.circle(glow, (int(x * 8), int(y * 8)), int(radius * 8), float(rng.uniform(2, 25)), -1, cv2.LINE_AA, 3)
    return rgb + glow[..., None] * rng.uniform(0.7, 1.0, 3).astype(np.float32)


def compose(canvases: list[Canvas], fields: list[Array], size: tuple[int, int], pixels: Array) -> Array:
    """One sharp sub-frame (H, W, 3): layers over each other, far to near."""
    frame: Array = np.zeros((size[1], size[0], 3), np.float32)
    for canvas, coarse in zip(canvases, fields, strict=True):
        region = region_of(canvas, coarse, size)
        if region is None:
            continue
        rgba = canvas.warp((pixels + upsample(coarse, size))[region])
        if canvas.layer.stencil is None:
            frame[region] = rgba[..., :3]
        else:
            frame[region] *= 1 - rgba[..., 3:]
            frame[region] += rgba[..., :3]
    return frame


def region_of(canvas: Canvas, coarse: Array, size: tuple[int, int]) -> tuple[slice, slice] | None:
    """Rows and columns of the image that a canvas can reach with a displacement field; None if none."""
    if canvas.layer.stencil is None:
        return slice(0, size[1]), slice(0, size[0])
    rows, columns = canvas.rgba.shape[:2]
    low, high = coarse.min((0, 1)), coarse.max((0, 1))
    x0, x1 = int(canvas.left - high[0]) - 2, int(canvas.left + columns / canvas.detail - low[0]) + 3
    y0, y1 = int(canvas.top - high[1]) - 2, int(canvas.top + rows / canvas.detail - low[1]) + 3
    x0, x1, y0, y1 = max(x0, 0), min(x1, size[0]), max(y0, 0), min(y1, size[1])
    return (slice(y0, y1), slice(x0, x1)) if x0 < x1 and y0 < y1 else None


def origin_map(canvases: list[Canvas], fields: list[Array], size: tuple[int, int], pixels: Array) -> Array:
    """Mid-exposure position (H, W, 2) of what is visible at each pixel of one sub-frame."""
    origin = pixels.copy()
    for canvas, coarse in zip(canvases, fields, strict=True):
        positions = pixels + upsample(coarse, size)
        visible = canvas.warp(positions)[..., 3] > 0.5
        origin[visible] = positions[visible]
    return origin


def top_layer(canvases: list[Canvas], points: Array) -> Array:
    """Index (h, w) of the layer seen at mid-exposure points (h, w, 2)."""
    index = np.zeros(points.shape[:2], np.int64)
    for k, canvas in enumerate(canvases[1:], 1):
        index[canvas.warp(points.astype(np.float32))[..., 3] > 0.5] = k
    return index


def end_visible(origin: Array, end: Array, points: Array, size: tuple[int, int]) -> Array:
    """Whether the smear's end shows the point itself: inside the image and cross-checked within 1 px."""
    at = end.astype(np.float32)
    seen = cv2.remap(origin, at[..., 0], at[..., 1], cv2.INTER_LINEAR, None, cv2.BORDER_REPLICATE)
    inside = ((end >= 0) & (end <= np.array(size) - 1)).all(-1)
    return np.asarray(inside & (np.linalg.norm(seen - points, axis=-1) < 1.0))


def relative_pose(camera: Path) -> tuple[Array, Array]:
    """Return R, t of cam_close_from_cam_open."""
    (R_open, C_open), (R_close, C_close) = camera.at(-0.5), camera.at(0.5)
    return R_close @ R_open.T, R_close @ (C_open - C_close)


def fundamental_of(R: Array, t: Array, K: Array) -> Array | None:
    """Unit-norm F = K^-T [t]x R K^-1; None where the camera does not translate."""
    if not np.linalg.norm(t) > 1e-9:
        return None
    tx = np.array([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]])
    inverse = np.linalg.inv(K)
    F = inverse.T @ tx @ R @ inverse
    return F / np.linalg.norm(F)


def scale_path(
    camera: Path, layers: list[Layer], K: Array, size: tuple[int, int], length_px: float
) -> tuple[Path, float]:
    """Scale a unit path so that the median smear over all layers is `length_px` and the longest bounded."""
    points = grid_points(size)[::4, ::4]
    factor = 0.01
    for _ in range(4):
        lengths = path_lengths(points, layers, camera.scaled(factor), K, size)
        factor *= length_px / max(float(np.median(lengths)), 1e-3)
        factor = min(factor, 0.6)
    longest = float(np.quantile(path_lengths(points, layers, camera.scaled(factor), K, size), 0.98))
    factor *= min(1.0, (2.5 * length_px + 10) / longest)
    return camera.scaled(factor), factor


def path_lengths(points: Array, layers: list[Layer], camera: Path, K: Array, size: tuple[int, int]) -> Array:
    """Smear lengths (layers, h, w) of all layers at points (h, w, 2), as if each were visible everywhere."""
    ends = [[moved(points, layer, camera, K, size, tau) for tau in (-0.5, 0.5)] for layer in layers]
    return np.stack([np.linalg.norm(close - start, axis=-1) for start, close in ends])


def sample_length(rng: np.random.Generator, options: RenderOptions) -> float:
    """Median smear length of a scene, pixels."""
    if rng.random() < options.sharp_share:
        return float(rng.uniform(0, 1))
    low, high = np.log(options.smear_px)
    return float(np.exp(rng.uniform(low, high)))


def set_in_motion(rng: np.random.Generator, layers: list[Layer], camera: Path, share: float) -> list[Layer]:
    """Give one or two cards a path of their own in a share of the scenes."""
    if len(layers) < 2 or rng.random() > share:
        return layers
    chosen = set(1 + rng.permutation(len(layers) - 1)[: int(rng.integers(1, 3))])
    return [
        replace(layer, own_path=sample_object_path(rng, camera)) if k in chosen else layer
        for k, layer in enumerate(layers)
    ]


def render(seed: int, options: RenderOptions | None = None) -> Rendering:
    """Render one scene with its truth; the same seed and options give the same bytes.

    Parameters
    ----------
    seed : int
        Decides everything.
    options : RenderOptions, optional

    Returns
    -------
    Rendering
    """
    options = options or RenderOptions()
    rng = np.random.default_rng([seed, 0 if options.split == "train" else 1])
    size, pool = options.size, photographs(options.split, options.photos)
    K = sample_intrinsics(rng, size)
    layers = sample_layers(rng, pool, K, size)
    camera, kind = sample_camera_path(rng, options.straight)
    camera, factor = scale_path(camera, layers, K, size, sample_length(rng, options))
    layers = set_in_motion(rng, layers, camera, options.mover_share)
    fields = [inverse_displacements(layer, camera, K, size) for layer in layers]
    margin = min(float(max(np.abs(f).max() for f in fields)), 160.0) + 4
    canvases = [paint(rng, layer, K, size, margin, options.detail) for layer in layers]
    return expose(canvases, fields, camera, K, size, kind)


def expose(
    canvases: list[Canvas], fields: list[Array], camera: Path, K: Array, size: tuple[int, int], kind: str
) -> Rendering:
    """Average the sub-frames and compute the truth."""
    pixels = np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), -1).astype(np.float32)
    longest = max(np.linalg.norm(f[-1] - f[0], axis=-1).max() for f in fields)
    count = int(np.clip(np.ceil(longest), 15, 200))
    times = (np.arange(count) + 0.5) / count - 0.5
    weights = knot_weights(times)
    linear: Array = np.zeros((size[1], size[0], 3), np.float32)
    for row in weights:
        linear += compose(canvases, [np.tensordot(row, f, 1) for f in fields], size, pixels)
    R, t = relative_pose(camera)
    return Rendering(
        linear=linear / np.float32(count),
        **truth(canvases, fields, camera, K, size, pixels),
        K=K,
        R=R,
        t=t,
        F=fundamental_of(R, t, K),
        kind=kind,
        straight=camera.is_straight,
        open_image=compose(canvases, [f[0] for f in fields], size, pixels),
        close_image=compose(canvases, [f[-1] for f in fields], size, pixels),
    )


def truth(
    canvases: list[Canvas], fields: list[Array], camera: Path, K: Array, size: tuple[int, int], pixels: Array
) -> dict[str, Array]:
    """Grid truth: displacement, bend, validity and the static label."""
    points = grid_points(size)
    index = top_layer(canvases, points)
    start, close = np.zeros_like(points), np.zeros_like(points)
    for k, canvas in enumerate(canvases):
        chosen = index == k
        for tau, end in ((-0.5, start), (0.5, close)):
            end[chosen] = moved(points, canvas.layer, camera, K, size, tau)[chosen]
    first = origin_map(canvases, [f[0] for f in fields], size, pixels)
    last = origin_map(canvases, [f[-1] for f in fields], size, pixels)
    static = np.array([canvas.layer.own_path is None for canvas in canvases])[index]
    return {
        "displacement": (close - start).astype(np.float32),
        "middle_offset": ((close + start) / 2 - points).astype(np.float32),
        "valid": end_visible(first, start, points, size) & end_visible(last, close, points, size),
        "static": static,
    }


def encode_linear(linear: Array) -> Array:
    """Radiance (0 to 4) as uint16 of its square root: fine in the dark, room for highlights."""
    return np.asarray(np.sqrt(np.clip(linear, 0, 4) / 4) * 65535 + 0.5).astype(np.uint16)


def decode_linear(coded: Array) -> Array:
    """Invert :func:`encode_linear`: float32."""
    root = coded.astype(np.float32) * np.float32(2 / 65535)
    return np.asarray(root * root)


def training_record(seed: int, options: RenderOptions) -> dict[str, Array]:
    """Compact arrays of one scene for training."""
    rendering = render(seed, options)
    labels = rendering.valid.astype(np.uint8) + 2 * rendering.static.astype(np.uint8)
    return {
        "linear": encode_linear(rendering.linear),
        "displacement": rendering.displacement.astype(np.float16),
        "labels": labels,
    }


def start_worker() -> None:
    """One OpenCV thread a process: scenes run in parallel instead."""
    cv2.setNumThreads(1)


def write_shards(out: FilePath, first_seed: int, scenes: int, options: RenderOptions, jobs: int, shard: int) -> None:
    """Write ``scenes`` seeds in files of ``shard`` scenes; finished files are kept, so a stopped run resumes."""
    out.mkdir(parents=True, exist_ok=True)
    began, done = time.perf_counter(), 0
    with multiprocessing.get_context("spawn").Pool(jobs, start_worker) as pool:
        for start in range(first_seed, first_seed + scenes, shard):
            path = out / f"{options.split}_{start:08d}.npz"
            if path.exists():
                continue
            records = pool.map(partial(training_record, options=options), range(start, start + shard), chunksize=2)
            stacked = {key: np.stack([record[key] for record in records]) for key in records[0]}
            temporary = path.with_suffix(".tmp.npz")
            np.savez(temporary, **stacked)
            temporary.replace(path)
            done += shard
            crops = done * options.size[0] * options.size[1] / 128**2 / (time.perf_counter() - began)
            print(f"{path.name}: {done} scenes, {crops:.0f} crops of 128 px a second", flush=True)


def contact_sheet(seeds: range, options: RenderOptions) -> Array:
    """Rows of pictures (uint8 BGR): blurred image; smears by orientation and length; validity and static label."""
    tiles = []
    for seed in seeds:
        rendering = render(seed, options)
        image = (np.clip(rendering.linear, 0, 1) ** (1 / 2.2) * 255).astype(np.uint8)[..., ::-1]
        truth_pictures = [smear_picture(rendering.displacement), label_picture(rendering)]
        large = [cv2.resize(p, options.size, interpolation=cv2.INTER_NEAREST) for p in truth_pictures]
        tile = np.concatenate([image, *large], 1)
        moved_px = np.median(np.linalg.norm(rendering.displacement, axis=-1))
        text = f"seed {seed} {rendering.kind} {moved_px:.1f} px"
        cv2.putText(tile, text, (6, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (255, 255, 255), 1, cv2.LINE_AA)
        tiles.append(tile)
    return np.concatenate(tiles, 0)


def smear_picture(displacement: Array) -> Array:
    """Colour (uint8 BGR) of a field: hue = orientation, brightness = length up to 40 px."""
    hue = (np.degrees(np.arctan2(displacement[..., 1], displacement[..., 0])) % 180).astype(np.uint8)
    length = np.clip(np.linalg.norm(displacement, axis=-1) / 40, 0, 1) ** 0.5 * 255
    hsv = np.stack([hue, np.full_like(hue, 255), length.astype(np.uint8)], -1)
    return cv2.cvtColor(hsv, cv2.COLOR_HSV2BGR)


def label_picture(rendering: Rendering) -> Array:
    """Grey static, pink moving, dark where an end is hidden (uint8 BGR)."""
    picture = np.where(rendering.static[..., None], (170, 170, 170), (180, 80, 255))
    return np.asarray(np.where(rendering.valid[..., None], picture, picture // 4)).astype(np.uint8)


def parse() -> argparse.Namespace:
    """Command line of the renderer."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["dataset", "sheet"])
    parser.add_argument("--out", type=FilePath, required=True, help="folder of shards, or the sheet's PNG file")
    parser.add_argument("--scenes", type=int, default=12)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--split", choices=["train", "test"], default="train")
    parser.add_argument("--photos", type=FilePath, help="folder of further photographs used as textures")
    parser.add_argument("--size", type=int, nargs=2, default=RenderOptions().size, metavar=("WIDTH", "HEIGHT"))
    parser.add_argument("--jobs", type=int, default=multiprocessing.cpu_count())
    parser.add_argument("--shard", type=int, default=50, help="scenes in one file")
    return parser.parse_args()


def main() -> None:
    """Write a dataset or a contact sheet."""
    arguments = parse()
    options = RenderOptions(size=tuple(arguments.size), split=arguments.split, photos=arguments.photos)
    if arguments.what == "dataset":
        first, scenes = arguments.first_seed, arguments.scenes
        write_shards(arguments.out, first, scenes, options, arguments.jobs, arguments.shard)
    else:
        seeds = range(arguments.first_seed, arguments.first_seed + arguments.scenes)
        cv2.imwrite(str(arguments.out), contact_sheet(seeds, options))


if __name__ == "__main__":
    main()
