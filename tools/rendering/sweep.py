"""All sub-frames of a picture of layers at once: every pixel follows each layer back to mid exposure.

A point x of a layer, the middle of its chord, stands at x + s(t) D(x) + bend (t^2 - 1/4) at times t from -1/2
to 1/2, where s(t) = t + a (t^2 - 1/4) and D is the layer's displacement. Light is summed front to back.
By Triton on a GPU, by Numba on a processor (0.5 s for six layers of 512 x 384 pixels).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numba import njit
from numpy.typing import NDArray

try:
    import triton
    import triton.language as tl
except ImportError:  # comes with torch where there is a GPU
    triton = None

Floats = NDArray[np.float32]

GRID = 16
"""Pixels between values of displacement fields."""
BLOCK = 128  # pixels of a program on a GPU


@dataclass(frozen=True, kw_only=True, eq=False)
class Layers:
    """Surfaces, the furthest first, and how they move during the exposure.

    Parameters
    ----------
    colour : ndarray of shape (L, h, w, 4), float32
        Linear light times coverage, and coverage, ``margin`` pixels wider than the picture on each side.
    displacement : ndarray of shape (L, 2, gh, gw), float32
        Every `GRID` pixels, pixels.
    margin, steps : int
        Pixels; sub-frames.
    bend : ndarray of shape (2,)
        Of all paths, pixels.
    acceleration : float
        The a of s(t).
    """

    colour: Floats
    displacement: Floats
    margin: int
    steps: int
    bend: NDArray[np.float64]
    acceleration: float


def swept(layers: Layers, size: tuple[int, int], device: str = "cpu") -> tuple[Floats, Floats]:
    """Return the light (H, W, 3) of a picture of a size (width, height), and shares (L, H, W) of layers."""
    width, height = size
    count = len(layers.colour)
    path = *map(float, layers.bend), float(layers.acceleration)
    if device == "cpu":
        light = np.zeros((height, width, 3), np.float32)
        seen = np.zeros((count, height, width), np.float32)
        numbers = *path, float(layers.margin), float(GRID)
        on_processor(layers.colour, layers.displacement, layers.steps, *numbers, light, seen)
        return light, seen
    colour, field = (torch.from_numpy(one).to(device) for one in (layers.colour, layers.displacement))
    out = torch.empty(height, width, 4, device=device)
    shares = torch.zeros(count, height, width, device=device)
    sides = height, width, *colour.shape[1:3], *field.shape[2:]
    programs = (-(-height * width // BLOCK),)
    on_gpu[programs](
        colour, field, out, shares, count, layers.steps, *path, *sides, float(layers.margin), GRID, BLOCK
    )
    return out[..., :3].cpu().numpy(), shares.cpu().numpy()


def _bilinear(values: Floats, y: float, x: float) -> tuple[int, int, float, float, float, float]:
    """Return row and column of the pixel above and left of a place in (h, w, ...), and four weights."""
    u = min(max(x, 0.0), values.shape[1] - 1.001)
    v = min(max(y, 0.0), values.shape[0] - 1.001)
    column, row = int(u), int(v)
    fx, fy = u - column, v - row
    return row, column, (1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy


bilinear: Any = njit(fastmath=True, cache=True)(_bilinear)


def _on_processor(
    colour: Floats,
    field: Floats,
    steps: int,
    bend_x: float,
    bend_y: float,
    acceleration: float,
    margin: float,
    grid: float,
    light: Floats,
    seen: Floats,
) -> None:
    """Add up the light and the shares of one picture, both zero before."""
    for py in range(light.shape[0]):
        for px in range(light.shape[1]):
            for k in range(steps):
                t = (k + 0.5) / steps - 0.5
                q = t * t - 0.25
                s = t + acceleration * q
                left = 1.0 / steps
                for layer in range(len(colour) - 1, -1, -1):
                    x, y = px - bend_x * q, py - bend_y * q
                    for _ in range(2):  # x + s D(x) = p, by iteration
                        field_x, field_y = field[layer, 0], field[layer, 1]
                        i, j, a, b, c, d = bilinear(field_x, (y + margin) / grid, (x + margin) / grid)
                        dx = a * field_x[i, j] + b * field_x[i, j + 1]
                        dx += c * field_x[i + 1, j] + d * field_x[i + 1, j + 1]
                        dy = a * field_y[i, j] + b * field_y[i, j + 1]
                        dy += c * field_y[i + 1, j] + d * field_y[i + 1, j + 1]
                        x, y = px - bend_x * q - s * dx, py - bend_y * q - s * dy
                    one = colour[layer]
                    i, j, a, b, c, d = bilinear(one, y + margin, x + margin)
                    alpha = a * one[i, j, 3] + b * one[i, j + 1, 3]
                    alpha += c * one[i + 1, j, 3] + d * one[i + 1, j + 1, 3]
                    if alpha <= 0:
                        continue
                    for n in range(3):
                        value = a * one[i, j, n] + b * one[i, j + 1, n]
                        value += c * one[i + 1, j, n] + d * one[i + 1, j + 1, n]
                        light[py, px, n] += left * value
                    seen[layer, py, px] += left * alpha
                    left -= left * alpha
                    if left < 1e-6:
                        break


on_processor: Any = njit(fastmath=True, cache=True)(_on_processor)
on_gpu: Any = None
if triton is not None:

    @triton.jit  # type: ignore[untyped-decorator]
    def on_gpu(  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201, D103
        colour, field, light, seen, count, steps, bend_x, bend_y, acceleration, H, W, h, w, gh, gw, margin,
        GRID: tl.constexpr, BLOCK: tl.constexpr,
    ):  # fmt: skip
        pixel = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
        mask = pixel < H * W
        py = (pixel // W).to(tl.float32)
        px = (pixel % W).to(tl.float32)
        channel = tl.arange(0, 4)
        total = tl.zeros([BLOCK, 4], tl.float32)
        for k in range(steps):
            t = (k + 0.5) / steps - 0.5
            q = t * t - 0.25
            s = t + acceleration * q
            x0 = px - bend_x * q
            y0 = py - bend_y * q
            left = tl.zeros([BLOCK], tl.float32) + 1.0 / steps
            for n in range(count):
                layer = count - 1 - n
                own = field + layer * 2 * gh * gw
                x = x0
                y = y0
                for _ in tl.static_range(2):
                    gx = tl.minimum(tl.maximum((x + margin) / GRID, 0.0), gw - 1.001)
                    gy = tl.minimum(tl.maximum((y + margin) / GRID, 0.0), gh - 1.001)
                    j = gx.to(tl.int32)
                    i = gy.to(tl.int32)
                    fx = gx - j
                    fy = gy - i
                    o = i * gw + j
                    a = (1 - fx) * (1 - fy)
                    b = fx * (1 - fy)
                    c = (1 - fx) * fy
                    d = fx * fy
                    dx = a * tl.load(own + o) + b * tl.load(own + o + 1)
                    dx += c * tl.load(own + o + gw) + d * tl.load(own + o + gw + 1)
                    o = o + gh * gw
                    dy = a * tl.load(own + o) + b * tl.load(own + o + 1)
                    dy += c * tl.load(own + o + gw) + d * tl.load(own + o + gw + 1)
                    x = x0 - s * dx
                    y = y0 - s * dy
                u = tl.minimum(tl.maximum(x + margin, 0.0), w - 1.001)
                v = tl.minimum(tl.maximum(y + margin, 0.0), h - 1.001)
                j = u.to(tl.int32)
                i = v.to(tl.int32)
                fx = (u - j)[:, None]
                fy = (v - i)[:, None]
                base = colour + ((layer * h + i) * w + j)[:, None] * 4 + channel[None, :]
                shown = (1 - fx) * (1 - fy) * tl.load(base) + fx * (1 - fy) * tl.load(base + 4)
                shown += (1 - fx) * fy * tl.load(base + w * 4) + fx * fy * tl.load(base + w * 4 + 4)
                part = left * tl.sum(tl.where(channel[None, :] == 3, shown, 0.0), 1)
                total += left[:, None] * shown
                here = seen + layer * H * W + pixel
                tl.store(here, tl.load(here, mask=mask, other=0.0) + part, mask=mask)
                left = left - part
        tl.store(light + pixel[:, None] * 4 + channel[None, :], total, mask=mask[:, None])
