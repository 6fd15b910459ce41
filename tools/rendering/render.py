"""Render one motion-blurred picture with exact smears from one integer seed.

A scene (`scene`) is painted (`canvas`) and moved along a camera path
(`motion`); sub-frames are averaged in linear light, at least one per pixel of the longest smear;
the truth (`truth`) is computed from the geometry, not from the picture.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from blur2view.arrays import AnyArray
from blur2view.geometry.epipolar import fundamental_from_pose
from tools.rendering.canvas import Canvas, paint
from tools.rendering.exposure import GRID, Exposure, grid_points, knot_weights, pixel_grid, upsample
from tools.rendering.motion import Trajectory, sample_camera_path, sample_object_path
from tools.rendering.scene import Layer, sample_intrinsics, sample_layers
from tools.rendering.sensor import log_uniform
from tools.rendering.textures import photographs
from tools.rendering.truth import SceneTruth, grid_truth, relative_pose

STILL_PX = 1.0  # median smear below which a camera holds still, and objects choose a pace of their own


@dataclass(frozen=True, kw_only=True)
class RenderOptions:
    """What a scene may be; ValueError if a size is no multiple of 4 or the range of lengths is empty.

    ``smear_px`` is the range of the median static smear length, log-uniform; a ``sharp_share`` of scenes has
    median smears under one pixel instead, a ``mover_share`` one or two moving objects (before a still camera
    in sharp scenes). ``straight``: constant velocity only. ``split`` ("train" or "test") says which
    photographs, ``photos`` (a folder) which further ones may be textures; ``detail`` is canvas pixels per
    image pixel.
    """

    size: tuple[int, int] = (320, 240)
    smear_px: tuple[float, float] = (1.5, 72.0)
    sharp_share: float = 0.1
    mover_share: float = 0.45
    straight: bool = False
    split: str = "train"
    photos: Path | None = None
    detail: float = 1.5

    def __post_init__(self) -> None:
        if any(side <= 0 or side % GRID for side in self.size):
            raise ValueError(f"width and height must be positive multiples of {GRID}, got {self.size}")
        if not 0 < self.smear_px[0] <= self.smear_px[1]:
            raise ValueError(f"expected 0 < shortest <= longest, got {self.smear_px}")


@dataclass(frozen=True, kw_only=True)
class Rendering(SceneTruth):
    """One rendered exposure with its truth.

    ``linear`` (H, W, 3) is the float32 mean radiance over the exposure, 0 to about 4 (highlights),
    ``open_image`` and ``close_image`` are its sharp first and last instants; ``middle_offset`` (H/4, W/4, 2)
    is the bend of smears, pixels.
    """

    linear: AnyArray
    middle_offset: AnyArray
    open_image: AnyArray
    close_image: AnyArray


def compose(canvases: list[Canvas], fields: list[AnyArray], size: tuple[int, int]) -> AnyArray:
    """Return one sharp sub-frame (H, W, 3): layers displaced by their fields, composed far to near."""
    frame: AnyArray = np.zeros((size[1], size[0], 3), np.float32)
    pixels = pixel_grid(size)
    for canvas, coarse in zip(canvases, fields, strict=True):
        region = canvas.region(coarse, size)
        if region is None:
            continue
        rgba = canvas.warp((pixels + upsample(coarse, size))[region])
        if canvas.layer.stencil is None:
            frame[region] = rgba[..., :3]
        else:
            frame[region] *= 1 - rgba[..., 3:]
            frame[region] += rgba[..., :3]
    return frame


def scaled_exposure(exposure: Exposure, layers: list[Layer], length_px: float) -> Exposure:
    """Return a unit path scaled to a median smear of `length_px` over all layers, the longest bounded."""

    def at(factor: float) -> Exposure:
        return replace(exposure, camera=exposure.camera.scaled(factor))

    points, factor = grid_points(exposure.size)[::4, ::4], 0.01
    for _ in range(4):
        median = float(np.median(at(factor).smear_lengths(points, layers)))
        factor = min(factor * (length_px / max(median, 1e-3)), 0.6)
    longest = float(np.quantile(at(factor).smear_lengths(points, layers), 0.98))
    return at(factor * min(1.0, (2.5 * length_px + 10) / max(longest, 1e-9)))


def set_in_motion(
    rng: np.random.Generator, layers: list[Layer], camera: Trajectory, share: float
) -> list[Layer]:
    """Return layers with, in a share of the scenes, one or two rather large cards as fast as the camera."""
    if len(layers) < 2 or rng.random() > share:
        return layers
    area = np.array([layer.box[2] * layer.box[3] for layer in layers])  # the background's is zero
    count = min(int(rng.integers(1, 3)), len(layers) - 1)
    chosen = set(rng.choice(len(layers), count, replace=False, p=area / area.sum()).tolist())
    return [
        replace(layer, own_path=sample_object_path(rng, camera)) if k in chosen else layer
        for k, layer in enumerate(layers)
    ]


def render(seed: int, options: RenderOptions | None = None) -> Rendering:
    """Return one rendered scene with its truth; the same seed and options give the same bytes."""
    options = options or RenderOptions()
    rng = np.random.default_rng([seed, 0 if options.split == "train" else 1])
    size, pool = options.size, photographs(options.split, options.photos)
    K = sample_intrinsics(rng, size)
    layers = sample_layers(rng, pool, K, size)
    camera, kind = sample_camera_path(rng, options.straight)
    exposure = Exposure(camera=camera, K=K, size=size)
    sharp = rng.random() < options.sharp_share
    length_px = float(rng.random() ** 2) if sharp else log_uniform(rng, options.smear_px)
    moving = scaled_exposure(exposure, layers, max(length_px, log_uniform(rng, options.smear_px)))
    exposure = scaled_exposure(exposure, layers, length_px)
    pace = exposure if length_px >= STILL_PX else moving
    layers = set_in_motion(rng, layers, pace.camera, options.mover_share)
    return expose(rng, layers, exposure, kind, options.detail)


def expose(
    rng: np.random.Generator, layers: list[Layer], exposure: Exposure, kind: str, detail: float
) -> Rendering:
    """Return the painted layers' average of sub-frames with the truth; `rng` draws the highlights."""
    fields = [exposure.inverse_displacements(layer) for layer in layers]
    margin = min(float(max(np.abs(f).max() for f in fields)), 160.0) + 4
    canvases = [paint(rng, layer, exposure.K, exposure.size, margin, detail) for layer in layers]
    R, t = relative_pose(exposure.camera)
    return Rendering(
        linear=mean_frame(canvases, fields, exposure.size),
        **grid_truth(canvases, fields, exposure),
        K=exposure.K,
        R=R,
        t=t,
        F=fundamental_from_pose(exposure.K, R, t) if np.linalg.norm(t) > 1e-9 else None,
        kind=kind,
        open_image=compose(canvases, [f[0] for f in fields], exposure.size),
        close_image=compose(canvases, [f[-1] for f in fields], exposure.size),
    )


def mean_frame(canvases: list[Canvas], fields: list[AnyArray], size: tuple[int, int]) -> AnyArray:
    """Return the average of sub-frames (H, W, 3) at the centres of 15 to 200 equal parts of the exposure."""
    longest = max(np.linalg.norm(f[-1] - f[0], axis=-1).max() for f in fields)
    count = int(np.clip(np.ceil(longest), 15, 200))
    total: AnyArray = np.zeros((size[1], size[0], 3), np.float32)
    for weights in knot_weights((np.arange(count) + 0.5) / count - 0.5):
        total += compose(canvases, [np.tensordot(weights, f, 1) for f in fields], size)
    return total / np.float32(count)
