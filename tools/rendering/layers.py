"""Surfaces of photographs that move along paths: cut, outlined, warped, averaged over an exposure."""

from dataclasses import dataclass

import cv2
import numpy as np

from blur2view.arrays import AnyArray as Array
from tools.rendering.exposure import GRID

DECODE = ((np.arange(256) / 255.0) ** 2.2).astype(np.float32)


@dataclass(frozen=True, kw_only=True)
class Path:
    """How a surface moves: smear d(p) = linear (p - centre) + shift, and the shape of its path."""

    shift: Array
    linear: Array
    bend: Array
    acceleration: float

    def smears(self, points: Array) -> Array:
        """Return smears (..., 2) at points (..., 2), relative to the picture's centre."""
        return points @ self.linear.T + self.shift

    def inverse(self, tau: float) -> tuple[Array, Array]:
        """Return matrix, offset from a pixel at tau in [-0.5, 0.5] to its point's place at mid exposure."""
        s = tau + self.acceleration * (tau * tau - 0.25)
        back = np.linalg.inv(np.eye(2) + s * self.linear)
        return back, back @ -(s * self.shift + self.bend * (tau * tau - 0.25))


def sample_path(rng: np.random.Generator, length: float, side: int) -> Path:
    """Draw a path whose smear at the centre has this length."""
    angle = rng.uniform(0, 2 * np.pi)
    linear = np.zeros((2, 2))
    if rng.random() < 0.75:
        spread = rng.choice([0.08, 0.25, 0.6]) * length / side
        kind = rng.random()
        if kind < 0.3:  # rotation about the axis
            linear = rng.normal(0, 2 * spread) * np.array([[0.0, -1.0], [1.0, 0.0]])
        elif kind < 0.5:  # zoom
            linear = rng.normal(0, 2 * spread) * np.eye(2)
        else:
            linear = rng.normal(0, spread, (2, 2))
        linear = np.clip(linear, -0.5, 0.5)
    return Path(
        shift=length * np.array([np.cos(angle), np.sin(angle)]),
        linear=linear,
        bend=rng.normal(0, 0.1, 2) * length if rng.random() < 0.5 else np.zeros(2),
        acceleration=float(np.clip(rng.normal(0, 0.25), -0.7, 0.7)) if rng.random() < 0.5 else 0.0,
    )


def surface(
    rng: np.random.Generator, source: Array, width: int, height: int, margin: int, tries: int = 1
) -> Array:
    """Cut a piece of a photograph (H, W, 3) uint8, only ever scaled down: linear light, with a margin.

    The smoothest of so many.
    """
    need_w, need_h = width + 2 * margin, height + 2 * margin
    largest = min(source.shape[1] / need_w, source.shape[0] / need_h)
    zoom = float(np.exp(rng.uniform(0, np.log(max(1.0, min(largest, 2.5)))))) if rng.random() < 0.6 else 1.0
    w, h = int(min(zoom * need_w, source.shape[1])), int(min(zoom * need_h, source.shape[0]))
    pieces = []
    for _ in range(tries):
        x, y = int(rng.integers(0, source.shape[1] - w + 1)), int(rng.integers(0, source.shape[0] - h + 1))
        pieces.append(source[y : y + h, x : x + w])
    cut = pieces[0] if tries == 1 else min(pieces, key=roughness)
    if rng.random() < 0.5:
        cut = cut[:, ::-1]
    if rng.random() < 0.3:
        cut = cut[::-1]
    linear = DECODE[cut]
    if zoom > 1.02:
        size = (max(8, round(w / zoom)), max(8, round(h / zoom)))
        linear = np.asarray(cv2.resize(linear, size, interpolation=cv2.INTER_AREA))
    return np.ascontiguousarray(linear)


def roughness(piece: Array) -> float:
    """Return the mean size of the second derivatives of a picture (H, W, 3) uint8."""
    return float(np.abs(cv2.Laplacian(piece[::2, ::2, 1].astype(np.float32), cv2.CV_32F)).mean())


def blob(rng: np.random.Generator, width: int, height: int, area: float) -> Array:
    """Draw an outline (height, width) of about this share of it: polygon or thresholded noise, soft edge."""
    mask = np.zeros((height, width), np.float32)
    centre = rng.uniform(0.1, 0.9, 2) * (width, height)
    radius = np.sqrt(area * width * height / np.pi)
    if rng.random() < 0.75:
        corners = rng.integers(3, 12)
        angles = np.sort(rng.uniform(0, 2 * np.pi, corners))
        reach = radius * rng.uniform(0.7, 1.5, corners)
        stretch = np.exp(rng.normal(0, 0.3)) ** np.array([1, -1])
        points = centre + np.stack([np.cos(angles), np.sin(angles)], 1) * reach[:, None] * stretch
        cv2.fillPoly(mask, [np.round(points * 16).astype(np.int32)], 1.0, cv2.LINE_AA, 4)
    else:
        noise = rng.standard_normal((height, width)).astype(np.float32)
        noise = np.asarray(cv2.GaussianBlur(noise, (0, 0), 0.1 * height))
        mask = (noise > np.quantile(noise, 1 - area)).astype(np.float32)
    return np.asarray(cv2.GaussianBlur(mask, (0, 0), 0.7))


def warp(image: Array, path: Path, tau: float, size: tuple[int, int], border: int) -> Array:
    """Show a surface at time tau: (H, W, C) of the picture's size."""
    width, height = size
    back, offset = path.inverse(tau)
    middle = np.array([image.shape[1] - 1, image.shape[0] - 1]) / 2
    matrix = np.c_[back, middle + offset - back @ (np.array([width - 1, height - 1]) / 2)]
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpAffine(image, matrix, size, flags=flags, borderMode=border))


def averaged(
    layers: list[Array], paths: list[Path], size: tuple[int, int], steps: int
) -> tuple[Array, list[Array]]:
    """Return the mean (H, W, 3) of sub-frames, and how often (H, W) each layer is seen, 0 to 1."""
    width, height = size
    total = np.zeros((height, width, 3), np.float32)
    seen = [np.zeros((height, width), np.float32) for _ in layers]
    pairs = list(zip(layers[1:], paths[1:], strict=True))
    for tau in (np.arange(steps) + 0.5) / steps - 0.5:
        frame = warp(layers[0], paths[0], tau, size, cv2.BORDER_REFLECT)
        left: Array = np.full((height, width), 1 / steps, np.float32)
        tops = [warp(layer, path, tau, size, cv2.BORDER_CONSTANT) for layer, path in pairs]
        for top in tops:
            frame = frame * (1 - top[..., 3:]) + top[..., :3]
        for k, top in reversed(list(enumerate(tops, 1))):
            seen[k] += left * top[..., 3]
            left = left * (1 - top[..., 3])
        seen[0] += left
        total += frame
    return total / np.float32(steps), seen


def smears_of(paths: list[Path], size: tuple[int, int]) -> tuple[Array, float]:
    """Return the smears (paths, H/4, W/4, 2) of surfaces along paths, and the longest, pixels."""
    x, y = (np.arange(side // GRID) * GRID + 1.5 - (side - 1) / 2 for side in size)
    centres = np.stack(np.meshgrid(x, y), -1)
    fields = np.stack([path.smears(centres) for path in paths])
    return fields, float(np.hypot(fields[..., 0], fields[..., 1]).max())


def composed(
    layers: list[Array], paths: list[Path], size: tuple[int, int]
) -> tuple[Array, Array, Array, Array]:
    """Return the picture (H, W, 3) of layers that move, and on the grid (H/4, W/4) what is seen in it.

    The shares (layers, ...) of the exposure of every layer, which one is seen most, and its smears (..., 2).
    """
    fields, longest = smears_of(paths, size)
    steps = max(9, int(1.25 * longest) + 2) if longest > 0.05 else 1
    linear, seen = averaged(layers, paths, size, steps)
    cells = (size[0] // GRID, size[1] // GRID)
    shares = np.stack([cv2.resize(share, cells, interpolation=cv2.INTER_AREA) for share in seen])
    most = shares.argmax(0)
    smears = np.take_along_axis(fields, most[None, ..., None], 0)[0]
    return linear, shares, most, smears.astype(np.float32)
