"""Sharp photographs, blurred in every way that has a name, with the truth; see `tools.evaluation.blur_kinds`.

They are blurred in linear light; a camera's noise, gamma and JPEG follow.
"""

import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from blur2view import BlurKind
from blur2view.arrays import AnyArray
from tools.rendering.sensor import add_noise, log_uniform
from tools.rendering.textures import read_photograph

STILL = BlurKind.SHARP, BlurKind.OUT_OF_FOCUS
MOVED = BlurKind.CAMERA_MOVED, BlurKind.OUT_OF_FOCUS_AND_MOVED
"""Kinds of blur without a smear and with one; of each the first has no radius."""
GAMMA = 2.2
SIDE_PX, MULTIPLE_PX = 640, 32  # the longer side of a picture; what divides both, as cells of the network do
RADII_PX = (2, 3, 4, 5, 6, 7, 8)
SMEARS_PX = (4, 6, 8, 12, 18, 25, 40)
BOTH_PX = ((4, 12), (3, 20))  # radius and smear
DIMMED_PX, GAIN = 12, 8  # the smear that is also tried dim; the divisor of 8-bit values
QUALITY = (85, 95)  # of JPEG, both drawn
READ_NOISE, SHOT_NOISE = (1e-4, 1e-3), (1e-5, 3e-4)  # of `sensor.add_noise`: 0.4 to 2 levels at mid-grey
MOVER_SHARE, MOVER_PX, MAX_MOVERS = (0.03, 0.25), (10.0, 40.0), 3
PLACES = 4  # tried for every cut-out: a mover without texture would be no question
FAINT = 1e-3  # smeared alpha below which nothing moves; a filter's rounding is far below
FINE = 16  # samples of a pixel along each side, at the edge of an aperture


@dataclass(frozen=True, kw_only=True, eq=False)
class Picture:
    """A photograph (H, W, 3), uint8 RGB, and its blur.

    ``angle`` of the smear is in radians; ``coding`` is "" or how dim it is, as "1/8"; ``moving`` is the share
    of the picture that moves before a camera at rest.
    """

    image: AnyArray
    kind: BlurKind
    radius_px: float = 0.0
    smear_px: float = 0.0
    angle: float = 0.0
    coding: str = ""
    moving: float = 0.0

    @property
    def name(self) -> str:
        """Kind and size of the blur."""
        sizes = " and ".join(f"{size:g} px" for size in (self.radius_px, self.smear_px) if size)
        blur = f"{self.kind} {sizes}" if sizes else str(self.kind)
        return f"{blur}, {self.coding}" if self.coding else blur


@functools.lru_cache(maxsize=32)
def radiance_of(path: Path, side_px: int = SIDE_PX) -> AnyArray:
    """Return a photograph, reduced, as linear light (H, W, 3), float32 in [0, 1]; do not write into it."""
    levels = (np.arange(256, dtype=np.float32) / 255) ** np.float32(GAMMA)
    light = cv2.LUT(read_photograph(path), levels)
    if (scale := side_px / max(light.shape[:2])) < 1:
        light = cv2.resize(light, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    height, width = (side // MULTIPLE_PX * MULTIPLE_PX for side in light.shape[:2])
    y, x = (light.shape[0] - height) // 2, (light.shape[1] - width) // 2
    return np.ascontiguousarray(light[y : y + height, x : x + width])


def kernel(length_px: float, angle: float) -> AnyArray:
    """Return a box of this length along a direction, bilinear in its pixels, of sum one."""
    side = int(length_px) + 5 | 1
    weights = np.zeros((side, side), np.float32)
    for t in np.linspace(-0.5, 0.5, 801) * length_px:
        x, y = side // 2 + t * np.cos(angle), side // 2 + t * np.sin(angle)
        j, i = int(x), int(y)
        weights[i : i + 2, j : j + 2] += np.outer([i + 1 - y, y - i], [j + 1 - x, x - j])
    return np.asarray(weights / weights.sum())


def disc(radius_px: float) -> AnyArray:
    """Return a disc as the shares of pixels covered; sum one."""
    side = 2 * int(np.ceil(radius_px + 1)) + 1
    at = (np.arange(side * FINE) + 0.5) / FINE - side / 2
    inside = np.hypot(*np.meshgrid(at, at)) <= radius_px
    cover = inside.reshape(side, FINE, side, FINE).mean((1, 3))
    return np.asarray(cover / cover.sum(), np.float32)


def blurred(light: AnyArray, weights: AnyArray) -> AnyArray:
    """Return linear light, or alpha, under a kernel; beyond its border it is mirrored."""
    return np.asarray(cv2.filter2D(light, -1, weights, borderType=cv2.BORDER_REFLECT))


def taken(rng: np.random.Generator, light: AnyArray, dim: bool, **truth: Any) -> Iterator[Picture]:
    """Yield the photograph, as JPEG codes it, of linear light; with ``dim`` also its values divided."""
    coded = np.asarray(add_noise(rng, light, READ_NOISE, SHOT_NOISE) ** np.float32(1 / GAMMA))[..., ::-1]
    quality = [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(QUALITY[0], QUALITY[1] + 1))]
    jpeg = cv2.imencode(".jpg", (coded * 255).round().astype(np.uint8), quality)[1]
    image = np.asarray(cv2.imdecode(jpeg, cv2.IMREAD_COLOR))[..., ::-1]
    yield Picture(image=image, **truth)
    if dim:
        yield Picture(image=np.round(image / GAIN).astype(np.uint8), coding=f"1/{GAIN}", **truth)


def outline(rng: np.random.Generator, shape: tuple[int, ...]) -> AnyArray:
    """Return the alpha (H, W), float32 in [0, 1], of a blob: soft, of a share of the picture."""
    height, width = shape[:2]
    cover = np.zeros((height, width), np.float32)
    while not MOVER_SHARE[0] <= cover.mean() <= MOVER_SHARE[1]:
        angle = np.arange(128) * 2 * np.pi / 128
        waves = [rng.normal(0, 0.3 / k) * np.cos(k * angle + rng.uniform(0, 6.3)) for k in range(2, 7)]
        radius = np.maximum(1 + np.sum(waves, axis=0), 0.3)
        rim = radius[:, None] * np.stack([np.cos(angle), rng.uniform(0.5, 1) * np.sin(angle)], axis=1)
        area = log_uniform(rng, MOVER_SHARE) * height * width
        rim = rim * np.sqrt(area / cv2.contourArea(rim.astype(np.float32))) + rng.uniform(0, (width, height))
        cover = np.zeros((height, width), np.float32)
        cv2.fillPoly(cover, [(rim * 8).round().astype(np.int32)], 1.0, cv2.LINE_AA, 3)
        cover = np.asarray(cv2.GaussianBlur(cover, (0, 0), rng.uniform(0.7, 2.0)))
    return cover


def texture(rng: np.random.Generator, light: AnyArray, cover: AnyArray) -> AnyArray:
    """Return another photograph's light, mirrored or not, shifted so that some detail is under a cover."""
    places = []
    for _ in range(PLACES):
        x, y = (int(rng.integers(-side, side)) for side in light.shape[1::-1])
        to = np.array([[rng.choice([-1.0, 1.0]), 0, x], [0, 1, y]])
        size = (cover.shape[1], cover.shape[0])
        moved = cv2.warpAffine(light, to, size, flags=cv2.INTER_NEAREST, borderMode=cv2.BORDER_REFLECT)
        detail = np.abs(cv2.Laplacian(np.sqrt(moved.mean(axis=2)), cv2.CV_32F))
        places.append((float((detail * cover).sum()), np.asarray(moved)))
    return max(places, key=lambda place: place[0])[1]


def with_movers(
    rng: np.random.Generator, light: AnyArray, others: Sequence[Path], movers: int
) -> tuple[AnyArray, AnyArray]:
    """Return linear light with smeared cut-outs of other photographs before it, and their smeared alpha."""
    moving = np.zeros(light.shape[:2], np.float32)
    for _ in range(movers):
        cover = outline(rng, light.shape)
        other = radiance_of(others[int(rng.integers(len(others)))], max(light.shape[:2]))
        other = texture(rng, other, cover)
        weights = kernel(rng.uniform(*MOVER_PX), float(rng.uniform(0, np.pi)))
        alpha = blurred(cover, weights)
        alpha = np.where(alpha > FAINT, np.minimum(alpha, 1), 0)
        mover = np.where(alpha[..., None] > 0, blurred(cover[..., None] * other, weights), 0)
        light = (1 - alpha[..., None]) * light + mover
        moving = 1 - (1 - moving) * (1 - alpha)
    return light, moving


def pictures_of(
    rng: np.random.Generator, light: AnyArray, others: Sequence[Path], composites: int
) -> Iterator[Picture]:
    """Yield all pictures of a sharp photograph; what moves before a camera at rest is cut out of others."""
    alone = ((0, 0), *((px, 0) for px in RADII_PX), *((0, px) for px in SMEARS_PX))
    for radius_px, smear_px in (*alone, *BOTH_PX):
        angle = float(rng.uniform(0, np.pi)) if smear_px else 0.0
        soft = blurred(light, disc(radius_px)) if radius_px else light
        moved = blurred(soft, kernel(smear_px, angle)) if smear_px else soft
        kind = (MOVED if smear_px else STILL)[bool(radius_px)]
        truth = {"kind": kind, "radius_px": radius_px, "smear_px": smear_px, "angle": angle}
        yield from taken(rng, moved, not radius_px and smear_px in (0, DIMMED_PX), **truth)
    for _ in range(composites):
        scene, moving = with_movers(rng, light, others, int(rng.integers(1, MAX_MOVERS + 1)))
        yield from taken(rng, scene, False, kind=BlurKind.CAMERA_AT_REST, moving=float((moving > 0).mean()))
