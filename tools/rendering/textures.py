"""Surface textures in linear light: procedural ones, and photographs of scikit-image (CC0) and of folders."""

import functools
import string
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import AnyArray, Floats
from blur2view.errors import ImageError

SIZE = 512  # side of a procedural texture, texels
SUFFIXES = (".png", ".jpg", ".jpeg")
BUNDLED = ("coffee", "gravel", "rocket")  # pictures of scikit-image that no training saw
TEST_EVERY = (
    4  # every fourth photograph of an added folder, by name, is a texture: those of the published sets
)
MAX_SIDE_PX = 3000  # photographs are halved until no side is longer: few are sharper
PHOTO_SHARE = 0.55  # of textures that are photographs
BITS = cv2.LINE_AA, 3  # OpenCV draws smoothly, with coordinates in eighths of a texel


def photographs_of(folders: Iterable[Path]) -> list[Path]:
    """List the photographs of folders by name; SystemExit without any."""
    paths = [
        path for folder in folders for path in sorted(folder.iterdir()) if path.suffix.lower() in SUFFIXES
    ]
    if not paths:
        raise SystemExit(f"no photograph in {', '.join(map(str, folders))}")
    return paths


def read_photograph(path: Path) -> NDArray[np.uint8]:
    """Return an 8-bit RGB photograph (H, W, 3); ImageError names a file that cannot be decoded."""
    bgr = cv2.imread(str(path))
    if bgr is None:
        raise ImageError(f"cannot decode {path}: remove it from the folder of photographs")
    return np.ascontiguousarray(bgr[..., ::-1], np.uint8)


def load_photos(folders: list[Path]) -> list[NDArray[np.uint8]]:
    """Return the photographs of folders by name, halved down to `MAX_SIDE_PX`."""
    photos = [read_photograph(path) for path in photographs_of(folders)]
    for k in range(len(photos)):
        while max(photos[k].shape[:2]) > MAX_SIDE_PX:
            photos[k] = np.asarray(cv2.resize(photos[k], None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA))
    return photos


@functools.lru_cache(maxsize=4)
def photographs(folder: Path | None = None) -> tuple[Floats, ...]:
    """Return photographs (H, W, 3) in linear light, [0, 1]: bundled ones and every fourth of a folder."""
    from skimage import color, data

    coded = [np.asarray(getattr(data, name)()) for name in BUNDLED]
    if folder is not None:
        coded += map(read_photograph, photographs_of([folder])[TEST_EVERY - 1 :: TEST_EVERY])
    rgb = [np.asarray((c if c.ndim == 3 else color.gray2rgb(c)) / 255.0, np.float32) for c in coded]
    # sRGB, IEC 61966-2-1
    return tuple(
        np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4).astype(np.float32) for c in rgb
    )


def photograph(rng: np.random.Generator, pool: tuple[Floats, ...]) -> Floats:
    """Return a photograph of the pool, flipped, turned, reduced by up to 2.5, with other colours."""
    image = np.rot90(pool[rng.integers(len(pool))], int(rng.integers(4)))
    if rng.random() < 0.5:
        image = image[:, ::-1]
    factor = rng.uniform(1.0, 2.5)
    if min(image.shape[:2]) / factor >= 128:
        size = (int(image.shape[1] / factor), int(image.shape[0] / factor))
        image = np.asarray(cv2.resize(np.ascontiguousarray(image), size, interpolation=cv2.INTER_AREA))
    gains = rng.uniform(0.8, 1.25, 3).astype(np.float32)
    if rng.random() < 0.15:
        image = np.repeat(image.mean(2, keepdims=True), 3, axis=2)
    return np.ascontiguousarray(image * gains, dtype=np.float32)


def colour(rng: np.random.Generator) -> Floats:
    """Draw a colour (3,) in linear light; dark and nearly grey ones are frequent, as in photographs."""
    grey = rng.beta(0.9, 1.6)
    return np.clip(grey * (1 + rng.normal(0, 0.3, 3)) + 0.005, 0, 1).astype(np.float32)


def filled(rng: np.random.Generator) -> Floats:
    """Return a texture of one colour."""
    return np.full((SIZE, SIZE, 3), colour(rng), np.float32)


def eighths(points: AnyArray) -> NDArray[np.int32]:
    """Return coordinates in eighths of a texel, as OpenCV draws with `BITS`."""
    return np.asarray(points * 8).astype(np.int32)


def draw_box(image: Floats, box: Sequence[float], fill: AnyArray) -> None:
    """Fill a box (left, top, right, bottom), texels, in place."""
    left, top, right, bottom = eighths(np.array(box)).tolist()
    cv2.rectangle(image, (left, top), (right, bottom), fill.tolist(), -1, *BITS)


def dead_leaves(rng: np.random.Generator) -> Floats:
    """Return occluding discs, triangles and boxes; sizes follow a power law (Lee, Mumford, Huang 2001)."""
    image, smallest = filled(rng), rng.uniform(1.5, 5.0)
    for _ in range(int(rng.integers(250, 900))):
        radius = min(smallest / max(rng.random(), 1e-3) ** 0.6, 130.0)
        centre = rng.uniform(0, SIZE, 2)
        fill, kind = colour(rng).tolist(), rng.integers(3)
        if kind == 0:
            cv2.circle(image, eighths(centre).tolist(), int(radius * 8), fill, -1, *BITS)
            continue
        angles = rng.uniform(0, 2 * np.pi) + np.arange(kind + 2) * 2 * np.pi / (kind + 2)
        squeeze = rng.uniform(0.3, 1)
        corners = centre + np.stack([radius * np.cos(angles), radius * np.sin(angles) * squeeze], 1)
        cv2.fillPoly(image, [eighths(corners)], fill, *BITS)
    return image


def spectral_noise(rng: np.random.Generator, size: int = SIZE, exponent: float | None = None) -> Floats:
    """Return noise (size, size) of amplitude 1 / frequency**exponent, zero mean and unit variance."""
    exponent = rng.uniform(0.7, 1.6) if exponent is None else exponent
    fy, fx = np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size)[None]
    amplitude = (fx * fx + fy * fy + 1.0 / size**2) ** (-exponent / 2)
    phase = rng.uniform(0, 2 * np.pi, amplitude.shape)
    noise = np.fft.irfft2(amplitude * np.exp(1j * phase), (size, size))
    return np.asarray((noise - noise.mean()) / noise.std(), np.float32)


def cloudy(rng: np.random.Generator) -> Floats:
    """Return two or three colours mixed by 1/f noise."""
    mix = 1 / (1 + np.exp(-rng.uniform(1, 4) * spectral_noise(rng)))[..., None]
    image = colour(rng) * mix + colour(rng) * (1 - mix)
    if rng.random() < 0.4:
        fine = (spectral_noise(rng, exponent=rng.uniform(0, 0.6)) > rng.uniform(1, 2.2))[..., None]
        image = np.where(fine, colour(rng), image)
    return np.asarray(image, np.float32)


def printed(rng: np.random.Generator) -> Floats:
    """Return lines of text in several sizes on a plain or cloudy ground."""
    image = np.asarray(cloudy(rng) * 0.3 + 0.5 if rng.random() < 0.3 else filled(rng))
    alphabet = np.array(list(string.ascii_letters + string.digits + "    .,-"))
    fonts, y = [cv2.FONT_HERSHEY_SIMPLEX, cv2.FONT_HERSHEY_DUPLEX, cv2.FONT_HERSHEY_COMPLEX], 0.0
    while y < SIZE:
        height = rng.uniform(7, 60) if rng.random() < 0.3 else rng.uniform(7, 22)
        y += height * 1.5
        text, font = "".join(rng.choice(alphabet, 70)), int(rng.choice(fonts))
        where, line = (int(rng.uniform(-40, 60)), int(y)), np.zeros((SIZE, SIZE), np.uint8)
        cv2.putText(line, text, where, font, height / 30, 255, max(1, int(height / 14)), cv2.LINE_AA)
        rows = slice(max(0, int(y - 1.2 * height)), int(y + 0.5 * height) + 1)
        cover = line[rows, :, None] / np.float32(255)
        image[rows] += cover * (colour(rng) - image[rows])
    return image


def bricks(rng: np.random.Generator) -> Floats:
    """Return courses of bricks or tiles with mortar, each with a colour of its own."""
    image = filled(rng)
    width, height = rng.uniform(12, 90), rng.uniform(8, 45)
    mortar, base = rng.uniform(1, 5), colour(rng)
    stagger = rng.choice([0.0, 0.5, rng.random()])
    for row in range(int(SIZE / height) + 1):
        for column in range(-1, int(SIZE / width) + 1):
            x, y = (column + stagger * (row % 2)) * width, row * height
            fill = np.clip(base * (1 + rng.normal(0, 0.25)) + rng.normal(0, 0.03, 3), 0, 1)
            draw_box(image, (x + mortar, y + mortar, x + width, y + height), fill)
    grain = 1 + rng.uniform(0.02, 0.25) * spectral_noise(rng, exponent=rng.uniform(0.3, 1.2))[..., None]
    return np.clip(image * grain, 0, 1).astype(np.float32)


def strokes(rng: np.random.Generator) -> Floats:
    """Return thin broken lines: cables, branches, scratches."""
    image = cloudy(rng) if rng.random() < 0.5 else filled(rng)
    for _ in range(int(rng.integers(30, 220))):
        start, spread, corners = rng.uniform(0, SIZE, 2), rng.uniform(5, 60), int(rng.integers(2, 7))
        points = start + np.cumsum(rng.normal(0, spread, (corners, 2)), 0)
        fill, thickness = colour(rng).tolist(), int(rng.integers(1, 5))
        cv2.polylines(image, [eighths(points)], False, fill, thickness, *BITS)
    return image


def panels(rng: np.random.Generator) -> Floats:
    """Return a wall of panels with seams, frames, panes and handles: long edges and nothing between them."""
    palette = [colour(rng) for _ in range(int(rng.integers(1, 5)))]
    smallest, seam = rng.uniform(24, 150), rng.uniform(0, 5)
    image = filled(rng)
    for left, top, right, bottom in divided(rng, (0, 0, SIZE, SIZE), smallest):
        fill = palette[rng.integers(len(palette))] * np.float32(np.exp(rng.normal(0, 0.08)))
        draw_box(image, (left + seam, top + seam, right, bottom), fill)
        detail = rng.random()
        if detail < 0.25:  # a frame or a pane
            inset = rng.uniform(0.06, 0.25) * min(right - left, bottom - top)
            draw_box(image, (left + inset, top + inset, right - inset, bottom - inset), colour(rng))
        elif detail < 0.45:  # a handle, a label or a switch
            width, height = np.exp(rng.uniform(np.log(2), np.log(40), 2))
            x, y = rng.uniform(left, max(right - width, left)), rng.uniform(top, max(bottom - height, top))
            draw_box(image, (x, y, x + width, y + height), colour(rng))
    return shaded(rng, image)


def divided(rng: np.random.Generator, box: Sequence[float], smallest: float) -> list[Sequence[float]]:
    """Split a box (left, top, right, bottom) into parts about `smallest` wide."""
    left, top, right, bottom = box
    width, height = right - left, bottom - top
    if max(width, height) < 2 * smallest or (width < SIZE / 2 and rng.random() < 0.12):
        return [box]
    at = rng.uniform(0.3, 0.7) if rng.random() < 0.6 else 0.5
    if width * rng.uniform(0.6, 1.6) > height:
        middle = left + at * width
        halves = [(left, top, middle, bottom), (middle, top, right, bottom)]
    else:
        middle = top + at * height
        halves = [(left, top, right, middle), (left, middle, right, bottom)]
    return [part for half in halves for part in divided(rng, half, smallest)]


def shaded(rng: np.random.Generator, image: Floats) -> Floats:
    """Return a texture under a slow gradient and a faint grain."""
    slow = spectral_noise(rng, exponent=rng.uniform(1.8, 2.6)) * rng.uniform(0, 0.15)
    grain = spectral_noise(rng, exponent=rng.uniform(0, 1.0)) * rng.choice([0.0, 0.01, 0.03])
    return np.asarray(np.clip(image * np.exp(slow + grain)[..., None].astype(np.float32), 0, 1), np.float32)


def plain(rng: np.random.Generator) -> Floats:
    """Return one colour with shading and at most a few marks: walls, sky, floors, cloth."""
    image = filled(rng)
    for _ in range(int(rng.choice([0, 0, 3, 12]))):
        width, height = np.exp(rng.uniform(np.log(2), np.log(30), 2))
        x, y = rng.uniform(0, SIZE, 2)
        draw_box(image, (x, y, x + width, y + height), colour(rng))
    return shaded(rng, image)


PROCEDURAL: dict[Callable[[np.random.Generator], Floats], float] = {
    dead_leaves: 0.22, cloudy: 0.1, printed: 0.12, bricks: 0.1, strokes: 0.12, panels: 0.24, plain: 0.1
}  # fmt: skip
"""Generators of textures and their shares."""


def procedural(rng: np.random.Generator) -> Floats:
    """Return a texture (SIZE, SIZE, 3) of a random generator."""
    return list(PROCEDURAL)[rng.choice(len(PROCEDURAL), p=list(PROCEDURAL.values()))](rng)


def sample_texture(rng: np.random.Generator, pool: tuple[Floats, ...]) -> Floats:
    """Return a random texture (h, w, 3) in linear light, at least 128 texels a side."""
    image = photograph(rng, pool) if rng.random() < PHOTO_SHARE else procedural(rng)
    contrast = rng.uniform(0.55, 1.6)
    image = np.maximum(image, 1e-4) ** np.float32(contrast)
    return np.asarray(image * np.float32(rng.uniform(0.5, 1.2)), np.float32)
