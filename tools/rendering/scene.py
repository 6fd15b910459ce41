"""Random 3D scenes and motions: a background of planes or a relief, cards before it, paths of rigid bodies.

Every layer is described in the mid-exposure camera frame by its inverse depth as a function of the image
point, by where it is (alpha) and by its texture. The renderer moves it along the camera's and its own path.
"""

from dataclasses import dataclass, field, replace
from functools import partial
from typing import Self

import cv2
import numpy as np

from blur2view.arrays import AnyArray, Array, Floats
from blur2view.geometry.pose import rotation_matrix
from tools.rendering.textures import BITS, eighths, sample_texture, spectral_noise

Pool = tuple[Floats, ...]

STENCIL = 160  # side of a stencil in its own cells; a card stretches it over its box
PATHS = {"rotation": 0.12, "translation": 0.18, "forward": 0.17, "orbit": 0.13, "mixed": 0.4}
"""Kinds of camera paths and their shares."""
OUTLINES = {"polygon": 0.22, "ellipse": 0.2, "bars": 0.2, "foliage": 0.15, "letters": 0.05, "box": 0.18}
"""Outlines of cards and their shares."""
ZEROS = partial(np.zeros, 3)


@dataclass(frozen=True, kw_only=True)
class Trajectory:
    """A smooth rigid path over the exposure time tau in [-1/2, 1/2], the identity at tau = 0.

    With s = tau + acceleration * tau**2 the rotation vector is ``rotation * s + rotation_bend * tau**2``
    (radians) and the position ``translation * s + translation_bend * tau**2`` (scene units), (3,) each.
    """

    rotation: Array = field(default_factory=ZEROS)
    translation: Array = field(default_factory=ZEROS)
    rotation_bend: Array = field(default_factory=ZEROS)
    translation_bend: Array = field(default_factory=ZEROS)
    acceleration: float = 0.0

    def at(self, tau: float) -> tuple[Array, Array]:
        """Return the rotation matrix (3, 3) and position (3,) at exposure time tau."""
        s = tau + self.acceleration * tau**2
        position = self.translation * s + self.translation_bend * tau**2
        return rotation_matrix(self.rotation * s + self.rotation_bend * tau**2), position

    def scaled(self, factor: float) -> Self:
        """Return the path, `factor` times as far."""
        vectors = ("rotation", "translation", "rotation_bend", "translation_bend")
        return replace(self, **{name: getattr(self, name) * factor for name in vectors})


def unit(rng: np.random.Generator, weights: tuple[float, float, float] = (1, 1, 1)) -> Array:
    """Return a random direction in 3D, stretched by `weights` before normalisation."""
    vector = rng.normal(size=3) * weights
    return np.asarray(vector / np.linalg.norm(vector))


def sample_camera_path(rng: np.random.Generator) -> tuple[Trajectory, str]:
    """Return a random camera path of unit size, which the renderer scales, and the name of its kind.

    An ``orbit`` goes sideways, with a rotation that mostly holds the middle distance still, as one does who
    follows something, and in a quarter of the cases moves the image further.
    """
    kind = str(rng.choice(list(PATHS), p=list(PATHS.values())))
    translation = unit(rng, (1, 0.8, 0.8))
    rotation = unit(rng, (1, 1, 0.7)) * rng.uniform(0.1, 1.0)
    if kind == "rotation":
        translation = np.zeros(3)
    elif kind == "translation":
        rotation = np.zeros(3)
    elif kind == "forward":
        translation = unit(rng, (0.25, 0.25, 1))
        rotation *= rng.choice([0.0, 0.15, 0.3])
    elif kind == "orbit":
        translation = unit(rng, (1, 0.8, 0.2))
        follow = rng.uniform(0.4, 1.2) * (1 if rng.random() < 0.75 else -1)
        rotation = np.cross([0, 0, 1], translation) * follow + 0.1 * rotation
    # bent not at all, slightly (a pan) or as much as it moves (a hand)
    ratio = float(rng.choice([0.0, 0.15, 0.6, 1.2], p=[0.3, 0.35, 0.25, 0.1]) * rng.random())
    path = Trajectory(
        rotation=rotation,
        translation=translation,
        rotation_bend=ratio * np.linalg.norm(rotation) * unit(rng),
        translation_bend=ratio * np.linalg.norm(translation) * unit(rng),
        acceleration=float(rng.normal(0, 0.2)),
    )
    return path, kind


def sample_object_path(rng: np.random.Generator, camera: Trajectory) -> Trajectory:
    """Return a moving object's random path: another direction, comparable size, little rotation."""
    speed = np.linalg.norm(camera.translation) + 0.7 * np.linalg.norm(camera.rotation)
    return Trajectory(
        rotation=unit(rng) * speed * rng.uniform(0, 0.5),
        translation=unit(rng, (1, 0.6, 0.5)) * speed * rng.uniform(0.4, 1.5),
    )


def sample_stencil(rng: np.random.Generator) -> Floats:
    """Return a random alpha mask (STENCIL, STENCIL) in [0, 1] of one card; its border is empty."""
    alpha = np.zeros((STENCIL, STENCIL), np.float32)
    match rng.choice(list(OUTLINES), p=list(OUTLINES.values())):
        case "polygon":  # star-shaped, of three to eight corners
            angles = np.sort(rng.uniform(0, 2 * np.pi, int(rng.integers(3, 9))))
            radius = STENCIL * rng.uniform(0.25, 0.5, len(angles))
            corners = STENCIL / 2 + radius[:, None] * np.stack([np.cos(angles), np.sin(angles)], 1)
            cv2.fillPoly(alpha, [eighths(corners)], 1.0, *BITS)
        case "ellipse":
            axes = [int(8 * STENCIL * rng.uniform(0.15, 0.48)) for _ in range(2)]
            cv2.ellipse(alpha, (4 * STENCIL, 4 * STENCIL), axes, rng.uniform(0, 180), 0, 360, 1.0, -1, *BITS)
        case "bars":
            for _ in range(int(rng.integers(1, 9))):
                first, last = eighths(rng.uniform(-0.2, 1.2, (2, 2)) * STENCIL).tolist()
                cv2.line(alpha, first, last, 1.0, int(rng.integers(1, 12)), *BITS)
        case "foliage":  # blots and holes of all sizes
            blots = spectral_noise(rng, STENCIL, rng.uniform(0.8, 1.8)) > rng.uniform(0, 1.0)
            alpha = np.asarray(cv2.GaussianBlur(blots.astype(np.float32), (0, 0), 0.7), np.float32)
        case "letters":
            text, place = "".join(rng.choice(list("ABCDEFGHKMNRSTWXYZ2345789"), 3)), (8, STENCIL // 2 + 20)
            ink = cv2.putText(np.zeros(alpha.shape, np.uint8), text, place, 0, 2.3, 255, 9, cv2.LINE_AA)
            alpha = np.asarray(ink / np.float32(255), np.float32)
        case _:
            alpha[2:-2, 2:-2] = 1.0
    alpha[[0, -1]] = alpha[:, [0, -1]] = 0
    return alpha


@dataclass(frozen=True, kw_only=True)
class Plane:
    """A textured plane: unit `normal` (3,) and `offset` > 0 in ``normal . X = offset``, camera frame."""

    normal: AnyArray
    offset: float
    texture: Floats
    texels_per_unit: float
    turn: float

    def inverse_depth(self, rays: AnyArray) -> AnyArray:
        """Return 1 / z (...) along rays (..., 3) with z = 1; negative behind the camera."""
        return np.asarray((rays @ self.normal) / self.offset)

    def texel(self, rays: AnyArray) -> AnyArray:
        """Return texture coordinates (..., 2), in texels, where rays (..., 3) meet the plane."""
        first = np.cross(self.normal, np.eye(3)[np.argmin(np.abs(self.normal))])
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
    relief: AnyArray = field(default_factory=lambda: np.zeros((2, 2), np.float32))
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
    """Return a small grid interpolated at positions `where` (h, w, 2); beyond [0, 1] it is mirrored."""
    at = (np.clip(where, -1, 2) * [grid.shape[1] - 1, grid.shape[0] - 1]).astype(np.float32)
    flat = grid.astype(np.float32)
    return np.asarray(cv2.remap(flat, at[..., 0], at[..., 1], cv2.INTER_LINEAR, None, cv2.BORDER_REFLECT))


def smooth_field(rng: np.random.Generator, amplitude: float, size: int = 33) -> AnyArray:
    """Return a random smooth grid (size, size) of standard deviation `amplitude`."""
    noise = cv2.GaussianBlur(spectral_noise(rng, 64, exponent=rng.uniform(1.6, 2.6)), (0, 0), 2.0)
    small = np.asarray(cv2.resize(noise, (size, size), interpolation=cv2.INTER_AREA))
    return np.asarray(amplitude * small / (small.std() + 1e-6), np.float32)


def sample_illumination(rng: np.random.Generator) -> AnyArray:
    """Return smooth shading factors, some strong: light and shadow over a surface."""
    return np.exp(smooth_field(rng, rng.choice([0.05, 0.2, 0.5]), 17))


def sample_plane(
    rng: np.random.Generator, pool: Pool, focal_px: float, normal: AnyArray, offset: float
) -> Plane:
    """Return a random plane whose texture has about one texel a pixel or finer where it faces the camera."""
    density = focal_px / offset * rng.uniform(0.9, 2.2)
    texture, turn = sample_texture(rng, pool), rng.uniform(0, 2 * np.pi)
    return Plane(normal=normal, offset=offset, texture=texture, texels_per_unit=density, turn=turn)


def tilted_normal(rng: np.random.Generator, largest: float) -> AnyArray:
    """Return a random direction about the optical axis, tilted by up to `largest` radians."""
    angle, azimuth = largest * rng.random(), rng.uniform(0, 2 * np.pi)
    return np.array([np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), np.cos(angle)])


def sample_background(rng: np.random.Generator, pool: Pool, focal_px: float) -> Layer:
    """Return a random wall, relief, wall with a ground, or inside of a room."""
    kind = rng.choice(["wall", "relief", "ground", "room"], p=[0.2, 0.3, 0.3, 0.2])
    planes = [sample_plane(rng, pool, focal_px, tilted_normal(rng, 0.8), 1.0)]
    if kind in ("ground", "room"):
        down = np.array([rng.normal(0, 0.1), 1.0, rng.normal(0, 0.1)])
        planes.append(sample_plane(rng, pool, focal_px, down / np.linalg.norm(down), rng.uniform(0.08, 0.4)))
    for side in (-1.0, 1.0) if kind == "room" else ():
        normal = np.array([side, 0.0, rng.uniform(-0.1, 0.6)])
        normal /= np.linalg.norm(normal)
        planes.append(sample_plane(rng, pool, focal_px, normal, rng.uniform(0.2, 0.7)))
    amplitude = rng.uniform(0.1, 0.45) if kind == "relief" else rng.choice([0.0, 0.03])
    relief = smooth_field(rng, amplitude)
    return Layer(planes=tuple(planes), relief=relief, illumination=sample_illumination(rng))


def sample_card(
    rng: np.random.Generator, pool: Pool, K: AnyArray, size: tuple[int, int], depth: float
) -> Layer:
    """Return a random card at about `depth`, anywhere in an image of `size` (width, height)."""
    spread = np.exp(rng.uniform(np.log(0.08), np.log(0.75)))
    card = spread * max(size) * np.array([np.exp(rng.normal(0, 0.35)), np.exp(rng.normal(0, 0.35))])
    centre = rng.uniform(-0.1, 1.1, 2) * size
    normal = tilted_normal(rng, 0.7)
    ray = np.linalg.inv(K) @ np.array([*centre, 1.0])
    return Layer(
        planes=(sample_plane(rng, pool, K[0, 0], normal, float(normal @ ray) * depth),),
        relief=smooth_field(rng, rng.choice([0.0, 0.04])),
        stencil=sample_stencil(rng),
        box=(centre[0] - card[0] / 2, centre[1] - card[1] / 2, card[0], card[1]),
        pivot=ray * depth,
        illumination=sample_illumination(rng),
    )


def sample_layers(rng: np.random.Generator, pool: Pool, K: AnyArray, size: tuple[int, int]) -> list[Layer]:
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
