"""Random 3D scenes: a background of planes or a relief, cards in front of it, some of them moving.

Every layer is described in the mid-exposure camera frame by its inverse depth as a function of the image
point, by where it is (alpha) and by its texture. The renderer moves it along the camera's and its own path.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import AnyArray
from tools.rendering.motion import Trajectory
from tools.rendering.textures import Image, sample_texture, spectral_noise

Alpha = NDArray[np.float32]

SIZE = 160  # side of a stencil in its own cells; a card stretches it over its box
FRACTION_BITS = 3  # OpenCV draws with coordinates in eighths of a cell


def empty() -> Alpha:
    """Return an empty stencil."""
    return np.zeros((SIZE, SIZE), np.float32)


def polygon(rng: np.random.Generator) -> Alpha:
    """Return a random star-shaped polygon of three to eight corners."""
    alpha = empty()
    angles = np.sort(rng.uniform(0, 2 * np.pi, int(rng.integers(3, 9))))
    radius = SIZE * rng.uniform(0.25, 0.5, len(angles))
    corners = SIZE / 2 + radius[:, None] * np.stack([np.cos(angles), np.sin(angles)], 1)
    cv2.fillPoly(alpha, [(corners * 8).astype(np.int32)], 1.0, cv2.LINE_AA, FRACTION_BITS)
    return alpha


def ellipse(rng: np.random.Generator) -> Alpha:
    """Return a random turned ellipse about the centre."""
    alpha, scale = empty(), SIZE * 8
    axes = int(scale * rng.uniform(0.15, 0.48)), int(scale * rng.uniform(0.15, 0.48))
    centre, turn = (scale // 2, scale // 2), rng.uniform(0, 180)
    cv2.ellipse(alpha, centre, axes, turn, 0, 360, 1.0, -1, cv2.LINE_AA, FRACTION_BITS)
    return alpha


def bars(rng: np.random.Generator) -> Alpha:
    """Return one to eight straight bars, thin or thick."""
    alpha = empty()
    for _ in range(int(rng.integers(1, 9))):
        first, last = (rng.uniform(-0.2, 1.2, (2, 2)) * SIZE * 8).astype(int).tolist()
        cv2.line(alpha, first, last, 1.0, int(rng.integers(1, 12)), cv2.LINE_AA, FRACTION_BITS)
    return alpha


def foliage(rng: np.random.Generator) -> Alpha:
    """Return thresholded 1/f noise: blots and holes of all sizes."""
    alpha = spectral_noise(rng, SIZE, rng.uniform(0.8, 1.8)) > rng.uniform(0, 1.0)
    return np.asarray(cv2.GaussianBlur(alpha.astype(np.float32), (0, 0), 0.7), np.float32)


def letters(rng: np.random.Generator) -> Alpha:
    """Return three capital letters or digits."""
    text = "".join(rng.choice(list("ABCDEFGHKMNRSTWXYZ2345789"), 3))
    ink = np.zeros((SIZE, SIZE), np.uint8)
    cv2.putText(ink, text, (8, SIZE // 2 + 20), cv2.FONT_HERSHEY_SIMPLEX, 2.3, 255, 9, cv2.LINE_AA)
    return np.asarray(ink / np.float32(255), np.float32)


def box(rng: np.random.Generator) -> Alpha:
    """Return a stencil filled up to a thin margin; `rng` is not used."""
    alpha = empty()
    alpha[2:-2, 2:-2] = 1.0
    return alpha


OUTLINES: dict[Callable[[np.random.Generator], Alpha], float] = {
    polygon: 0.22, ellipse: 0.2, bars: 0.2, foliage: 0.15, letters: 0.05, box: 0.18
}  # fmt: skip
"""Outlines and their shares."""


def sample_stencil(rng: np.random.Generator) -> Alpha:
    """Return a random alpha mask (SIZE, SIZE) in [0, 1] of one card; its border is empty."""
    outline = list(OUTLINES)[int(rng.choice(len(OUTLINES), p=list(OUTLINES.values())))]
    alpha = outline(rng)
    alpha[[0, -1]] = 0
    alpha[:, [0, -1]] = 0
    return alpha


@dataclass(frozen=True, kw_only=True)
class Plane:
    """A textured plane: unit `normal` (3,) and `offset` > 0 in ``normal . X = offset``, camera frame."""

    normal: AnyArray
    offset: float
    texture: Image
    texels_per_unit: float
    turn: float

    def inverse_depth(self, rays: AnyArray) -> AnyArray:
        """Return 1 / z (...) along rays (..., 3) with z = 1; negative behind the camera."""
        return np.asarray((rays @ self.normal) / self.offset)

    def texel(self, rays: AnyArray) -> AnyArray:
        """Return texture coordinates (..., 2), in texels, where rays (..., 3) meet the plane."""
        seed = np.eye(3)[np.argmin(np.abs(self.normal))]
        first = np.cross(self.normal, seed)
        first /= np.linalg.norm(first)
        axes = np.stack([first, np.cross(self.normal, first)])
        cosine, sine = np.cos(self.turn), np.sin(self.turn)
        axes = np.array([[cosine, -sine], [sine, cosine]]) @ axes * self.texels_per_unit
        points = rays / np.maximum(self.inverse_depth(rays), 1e-3)[..., None]
        return np.asarray(points @ axes.T)


@dataclass(frozen=True, kw_only=True)
class Layer:
    """One opaque surface, back to front in a scene.

    The nearest of ``planes`` along a ray is the surface (a card has one, a room several). ``relief`` (n, n)
    is a log factor of the inverse depth, stretched over the image, zeros for flat surfaces; ``illumination``
    (n, n) are shading factors. ``stencil`` (n, n) is the alpha of a card inside ``box`` (x, y, width, height
    in the mid-exposure image, pixels), None for the background, which is everywhere. ``own_path`` is the
    rigid motion of a moving object about ``pivot`` (3,), a point of the camera frame at mid exposure.
    """

    planes: tuple[Plane, ...]
    relief: AnyArray
    stencil: AnyArray | None = None
    box: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    own_path: Trajectory | None = None
    pivot: AnyArray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    illumination: AnyArray = field(default_factory=lambda: np.ones((2, 2), np.float32))

    def inverse_depth(self, rays: AnyArray, where: AnyArray) -> AnyArray:
        """Return the inverse depth (...) along rays (..., 3) at positions `where` (..., 2) in [0, 1]."""
        nearest = np.max([plane.inverse_depth(rays) for plane in self.planes], axis=0)
        return np.asarray(np.maximum(nearest, 0.02) * np.exp(sample_grid(self.relief, where)))


def sample_grid(grid: AnyArray, where: AnyArray) -> AnyArray:
    """Return a small grid interpolated at positions `where` (..., 2); beyond [0, 1] it is mirrored."""
    if not grid.any():
        return np.zeros(where.shape[:-1], np.float32)
    size = np.array([grid.shape[1] - 1, grid.shape[0] - 1])
    at = (np.clip(where, -1, 2) * size).astype(np.float32)
    flat = at.reshape(-1, 1, 2) if at.ndim == 2 else at
    columns, rows = flat[..., 0], flat[..., 1]
    value = cv2.remap(grid.astype(np.float32), columns, rows, cv2.INTER_LINEAR, None, cv2.BORDER_REFLECT)
    return np.asarray(value).reshape(where.shape[:-1])


def smooth_field(rng: np.random.Generator, amplitude: float, size: int = 33) -> AnyArray:
    """Return a random smooth random grid (size, size) of standard deviation `amplitude`."""
    noise = cv2.GaussianBlur(spectral_noise(rng, 64, exponent=rng.uniform(1.6, 2.6)), (0, 0), 2.0)
    small = np.asarray(cv2.resize(noise, (size, size), interpolation=cv2.INTER_AREA))
    return np.asarray(amplitude * small / (small.std() + 1e-6), np.float32)


def sample_plane(
    rng: np.random.Generator, pool: tuple[Image, ...], focal_px: float, normal: AnyArray, offset: float
) -> Plane:
    """Return a random plane whose texture has about one texel a pixel or finer where it faces the camera."""
    density = focal_px / offset * rng.uniform(0.9, 2.2)
    texture, turn = sample_texture(rng, pool), rng.uniform(0, 2 * np.pi)
    return Plane(normal=normal, offset=offset, texture=texture, texels_per_unit=density, turn=turn)


def tilted_normal(rng: np.random.Generator, largest: float) -> AnyArray:
    """Return a random direction about the optical axis, tilted by up to `largest` radians."""
    angle, azimuth = largest * rng.random(), rng.uniform(0, 2 * np.pi)
    return np.array([np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), np.cos(angle)])


def sample_background(rng: np.random.Generator, pool: tuple[Image, ...], focal_px: float) -> Layer:
    """Return a random wall, relief, wall with a ground, or inside of a room."""
    kind = rng.choice(["wall", "relief", "ground", "room"], p=[0.2, 0.3, 0.3, 0.2])
    planes = [sample_plane(rng, pool, focal_px, tilted_normal(rng, 0.8), 1.0)]
    if kind in ("ground", "room"):
        down = np.array([rng.normal(0, 0.1), 1.0, rng.normal(0, 0.1)])
        planes.append(sample_plane(rng, pool, focal_px, down / np.linalg.norm(down), rng.uniform(0.08, 0.4)))
    if kind == "room":
        for side in (-1.0, 1.0):
            normal = np.array([side, 0.0, rng.uniform(-0.1, 0.6)])
            normal /= np.linalg.norm(normal)
            planes.append(sample_plane(rng, pool, focal_px, normal, rng.uniform(0.2, 0.7)))
    amplitude = rng.uniform(0.1, 0.45) if kind == "relief" else rng.choice([0.0, 0.03])
    relief = smooth_field(rng, amplitude)
    return Layer(planes=tuple(planes), relief=relief, illumination=sample_illumination(rng))


def sample_illumination(rng: np.random.Generator) -> AnyArray:
    """Return smooth shading factors, some strong: light and shadow over a surface."""
    return np.exp(smooth_field(rng, rng.choice([0.05, 0.2, 0.5]), 17))


def sample_card(
    rng: np.random.Generator, pool: tuple[Image, ...], K: AnyArray, size: tuple[int, int], depth: float
) -> Layer:
    """Return a random card at about `depth`, anywhere in an image of `size` (width, height)."""
    width, height = size
    spread = np.exp(rng.uniform(np.log(0.08), np.log(0.75)))
    card = spread * max(size) * np.array([np.exp(rng.normal(0, 0.35)), np.exp(rng.normal(0, 0.35))])
    centre = rng.uniform(-0.1, 1.1, 2) * (width, height)
    normal = tilted_normal(rng, 0.7)
    ray = np.linalg.inv(K) @ np.array([*centre, 1.0])
    plane = sample_plane(rng, pool, K[0, 0], normal, float(normal @ ray) * depth)
    return Layer(
        planes=(plane,),
        relief=smooth_field(rng, rng.choice([0.0, 0.04])),
        stencil=sample_stencil(rng),
        box=(centre[0] - card[0] / 2, centre[1] - card[1] / 2, card[0], card[1]),
        pivot=ray * depth,
        illumination=sample_illumination(rng),
    )


def sample_layers(
    rng: np.random.Generator, pool: tuple[Image, ...], K: AnyArray, size: tuple[int, int]
) -> list[Layer]:
    """Return a random background and zero to fourteen cards, far to near."""
    count = int(rng.choice([0, 1, 2, 3, 4, 6, 9, 14], p=[0.1, 0.16, 0.18, 0.18, 0.15, 0.12, 0.07, 0.04]))
    depths = np.sort(rng.uniform(0.25, 0.8, count))[::-1]
    cards = [sample_card(rng, pool, K, size, float(depth)) for depth in depths]
    return [sample_background(rng, pool, K[0, 0]), *cards]


def sample_intrinsics(rng: np.random.Generator, size: tuple[int, int]) -> AnyArray:
    """Return a random K: focal length 0.6 to 1.6 longer sides, principal point slightly off the centre."""
    width, height = size
    focal = max(size) * np.exp(rng.uniform(np.log(0.6), np.log(1.6)))
    cx, cy = (width - 1) / 2 + rng.normal(0, 0.01) * width, (height - 1) / 2 + rng.normal(0, 0.01) * height
    return np.array([[focal, 0, cx], [0, focal, cy], [0, 0, 1.0]])
