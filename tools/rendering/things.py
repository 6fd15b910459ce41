"""Photographs of things that move: silhouettes of people, animals, vehicles and plants before photographs.

Silhouettes are those of the emoji of a font with pictures in it (Debian's ``fonts-noto-color-emoji``, SIL
Open Font License), drawn by Pillow; they are filled with pieces of photographs, or with the emoji's own
colours under such a piece's light. A camera follows a thing, moves otherwise, or stands; in some pictures
what is nearer to it only smears longer, or nothing moves at all.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from blur2view.arrays import AnyArray as Array
from tools.rendering.defocus import defocused
from tools.rendering.layers import Path as Motion
from tools.rendering.layers import blob, composed, sample_path, smears_of, surface
from tools.rendering.sensor import log_uniform

FONT = Path("/usr/share/fonts/truetype/noto/NotoColorEmoji.ttf")
FONT_PX = 109
"""The size of that font's bitmaps."""
RANGES = (
    (0x1F400, 0x1F43F), (0x1F466, 0x1F487), (0x1F574, 0x1F57B), (0x1F680, 0x1F6B6), (0x1F6E9, 0x1F6FC),
    (0x1F930, 0x1F93E), (0x1F980, 0x1F9AE), (0x1F9B8, 0x1F9DF), (0x1F330, 0x1F343), (0x1F3A0, 0x1F3CC),
    (0x1F446, 0x1F450), (0x1F339, 0x1F33F), (0x1F6F4, 0x1F6FA), (0x1FAB0, 0x1FABA),
)  # fmt: skip
"""Code points of people, animals, vehicles, plants, hands and things that are carried about."""
LEAST_COVERED, MOST_COVERED = 0.08, 0.85


@dataclass(frozen=True, kw_only=True)
class ThingOptions:
    """What pictures of things of ``size`` (width, height; multiples of 4) may be.

    ``smear_px`` is the range of the camera's or, where it stands, the things' smears, log-uniform; ``area``
    of a thing's share of the picture, log-uniform; ``kinds`` the shares of the kinds of pictures.
    """

    size: tuple[int, int] = (640, 480)
    smear_px: tuple[float, float] = (3.0, 60.0)
    area: tuple[float, float] = (0.008, 0.45)
    part_share: float = 0.35
    clutter_share: float = 0.4
    plain_share: float = 0.25
    blob_share: float = 0.15
    own_colour_share: float = 0.25
    focus_share: float = 0.15
    kinds: tuple[float, ...] = (0.25, 0.18, 0.18, 0.1, 0.2, 0.09)


@dataclass(frozen=True, kw_only=True, eq=False)
class Things:
    """A picture and what moves in it.

    Mean radiance ``linear`` (H, W, 3); on the grid of 4 x 4 pixels (H/4, W/4) the share ``moving`` of the
    exposure during which a place shows what moves by itself, and ``displacement`` (..., 2) of what it shows
    longest; ``kind`` is the name of the kind of picture.
    """

    linear: Array
    moving: Array
    displacement: Array
    kind: str


@lru_cache
def silhouettes(font: Path = FONT) -> tuple[Array, ...]:
    """Return pictures (h, w, 4) uint8 of all things, cut to their outlines."""
    drawn = ImageFont.truetype(str(font), FONT_PX)
    found = []
    for code in (code for first, last in RANGES for code in range(first, last + 1)):
        canvas = Image.new("RGBA", (150, 150))
        ImageDraw.Draw(canvas).text((7, 7), chr(code), font=drawn, embedded_color=True)
        picture = np.asarray(canvas)
        rows, columns = np.nonzero(picture[..., 3] > 127)
        if len(rows) < 500:
            continue
        cut = picture[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
        if LEAST_COVERED < (cut[..., 3] > 127).mean() < MOST_COVERED:
            found.append(cut)
    return tuple(found)


def outlined(
    rng: np.random.Generator, size: tuple[int, int], area: float, centre: Array, options: ThingOptions
) -> tuple[Array, Array | None]:
    """Draw the outline (H, W) of a thing that covers such a share, and the colours (H, W, 3) it may have."""
    width, height = size
    if rng.random() < options.blob_share:
        return blob(rng, width, height, area), None
    every = silhouettes()
    emoji = every[int(rng.integers(len(every)))].astype(np.float32) / 255
    covered = emoji[..., 3].sum()
    scale = np.sqrt(area * width * height / covered)
    stretch = float(np.exp(rng.normal(0, 0.2)))
    angle = rng.normal(0, 0.3)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    linear = turn @ np.diag([scale * stretch * (1 if rng.random() < 0.5 else -1), scale / stretch])
    middle = np.array([emoji.shape[1] - 1, emoji.shape[0] - 1]) / 2
    matrix = np.c_[linear, centre - linear @ middle]
    flags = cv2.INTER_CUBIC if scale > 1 else cv2.INTER_LINEAR
    drawn = np.asarray(cv2.warpAffine(emoji, matrix, size, flags=flags))
    softness = 0.35 * max(scale, 1)
    alpha = cv2.GaussianBlur(drawn[..., 3], (0, 0), softness)
    outline = np.clip((alpha - 0.5) * max(scale, 1.0) + 0.5, 0, 1).astype(np.float32)
    own = rng.random() < options.own_colour_share
    return outline, np.clip(drawn[..., :3], 0, 1) ** 2.2 if own else None


def filled(image: Array, outline: Array, colour: Array | None) -> Array:
    """Give a surface (H, W, 3) in linear light an outline: (H, W, 4), colours multiplied by it."""
    if colour is not None:
        light = image / max(float(image.mean()), 1e-3)
        image = colour * np.clip(light, 0.1, 4).astype(np.float32)
    return np.dstack([image * outline[..., None], outline]).astype(np.float32)


def relative(rng: np.random.Generator, path: Motion, length: float, side: int) -> Motion:
    """Return a path that departs from another by a smear of such a length."""
    own = sample_path(rng, length, side)
    return replace(
        own,
        shift=path.shift + own.shift,
        linear=np.clip(path.linear + 0.5 * own.linear, -0.5, 0.5),
        bend=path.bend + own.bend,
        acceleration=path.acceleration,
    )


Paths = tuple[Motion, list[tuple[Motion, bool]]]
"""The background's path, and those of the layers before it with whether they move by themselves."""


def following(rng: np.random.Generator, options: ThingOptions) -> Paths:
    """Return the paths of a camera that follows one or two things."""
    length, side = log_uniform(rng, options.smear_px), options.size[1]
    camera = sample_path(rng, length, side)
    count = 1 if rng.random() < 0.75 else 2
    rest = length * (rng.uniform(0.1, 0.4) if rng.random() < 0.4 else rng.uniform(0, 0.08))
    thing = sample_path(rng, rest, side)
    return camera, [(replace(thing, linear=thing.linear * 0.5), True)] * count


def crossing(rng: np.random.Generator, options: ThingOptions) -> Paths:
    """Return the paths of a camera that moves, and of one to three things that move otherwise."""
    length, side = log_uniform(rng, options.smear_px), options.size[1]
    camera = sample_path(rng, length, side)
    things = [
        (relative(rng, camera, max(2.0, length * rng.uniform(0.35, 1.6)), side), True)
        for _ in range(rng.integers(1, 4))
    ]
    return camera, things


def standing(rng: np.random.Generator, options: ThingOptions) -> Paths:
    """Return the paths of a camera at rest, and of one to four things before it."""
    side = options.size[1]
    camera = sample_path(rng, 0.0 if rng.random() < 0.7 else rng.uniform(0, 0.8), side)
    count = int(rng.integers(1, 5))
    return camera, [(sample_path(rng, log_uniform(rng, options.smear_px), side), True) for _ in range(count)]


def deep(rng: np.random.Generator, options: ThingOptions) -> Paths:
    """Return the paths of a camera that moves sideways past things that stand, nearer than the rest."""
    camera = replace(
        sample_path(rng, log_uniform(rng, options.smear_px), options.size[1]), linear=np.zeros((2, 2))
    )
    nearer = [float(rng.uniform(1.1, 2.0)) for _ in range(rng.integers(1, 4))]
    return camera, [(replace(camera, shift=k * camera.shift, bend=k * camera.bend), False) for k in nearer]


def unmoved(rng: np.random.Generator, options: ThingOptions) -> Paths:
    """Return the paths of a camera at rest before things at rest, any of them out of focus."""
    rest = sample_path(rng, 0.0, options.size[1])
    return rest, [(rest, False)] * (int(rng.integers(1, 4)) if rng.random() < 0.4 else 0)


def flat(rng: np.random.Generator, options: ThingOptions) -> Paths:
    """Return the path of a camera that moves before one surface with things upon it."""
    camera = sample_path(rng, log_uniform(rng, options.smear_px), options.size[1])
    return camera, [(camera, False)] * int(rng.integers(0, 3))


KINDS = (following, crossing, standing, deep, unmoved, flat)


def photographed_things(rng: np.random.Generator, sources: list[Array], options: ThingOptions) -> Things:
    """Make one picture of photographs (H, W, 3) uint8."""
    width, height = options.size
    kind = KINDS[int(rng.choice(len(KINDS), p=options.kinds))]
    camera, things = kind(rng, options)
    things = with_others(rng, camera, things, options)
    paths = [camera, *(path for path, _ in things)]
    _, longest = smears_of(paths, options.size)
    margin = int(0.75 * longest) + 24
    layers = [surface(rng, pick(rng, sources), width, height, margin, 8 if rng.random() < 0.3 else 1)]
    for k in range(len(things)):
        if k == 0 or things[k][0] is not things[k - 1][0] or rng.random() < 0.7:
            centre = np.array([rng.normal(0.5, 0.2), rng.normal(0.52, 0.18)]) * (width, height)
        area = log_uniform(rng, options.area)
        outline, colour = outlined(rng, options.size, area, centre, options)
        piece = surface(rng, pick(rng, sources), width, height, 0)
        piece = np.asarray(cv2.resize(piece, options.size)) if piece.shape[:2] != (height, width) else piece
        if rng.random() < options.plain_share:  # of less contrast, as walls, furniture and cloth have
            mean = piece.mean(axis=(0, 1), keepdims=True)
            piece = np.asarray(mean + log_uniform(rng, (0.03, 0.5)) * (piece - mean), piece.dtype)
        border = (margin, margin)
        layers.append(np.pad(filled(piece, outline, colour), (border, border, (0, 0))))
    radii = sample_radii(rng, len(layers), still=kind is unmoved, options=options)
    layers = [defocused(rng, layer, radius) for layer, radius in zip(layers, radii, strict=True)]
    linear, shares, most, displacement = composed(layers, paths, options.size)
    moves = np.array([False, *(by_itself for _, by_itself in things)])
    return Things(
        linear=linear,
        moving=shares[moves].sum(0).astype(np.float32) if moves.any() else np.zeros(most.shape, np.float32),
        displacement=displacement,
        kind=kind.__name__,
    )


def with_others(
    rng: np.random.Generator, camera: Motion, things: list[tuple[Motion, bool]], options: ThingOptions
) -> list[tuple[Motion, bool]]:
    """Return things; beside some a part that moves relative to it, among some what stands, but nearer."""
    found = []
    for path, by_itself in things:
        found.append((path, by_itself))
        if by_itself and rng.random() < options.part_share:
            length = 0.5 * log_uniform(rng, options.smear_px)
            found.append((relative(rng, path, length, options.size[1]), True))
    found = found[:5]
    if any(by_itself for _, by_itself in found) and rng.random() < options.clutter_share:
        for _ in range(rng.integers(1, 3)):
            k = float(rng.uniform(1.0, 2.0))
            nearer = replace(camera, shift=k * camera.shift, bend=k * camera.bend)
            found.insert(int(rng.integers(len(found) + 1)), (nearer, False))
    return found


def sample_radii(rng: np.random.Generator, count: int, *, still: bool, options: ThingOptions) -> list[float]:
    """Draw the radii out of focus of layers: none, the background's, or a thing's before it."""
    if rng.random() >= (0.7 if still else options.focus_share):
        return [0.0] * count
    radius = log_uniform(rng, (1.0, 10.0))
    if rng.random() < 0.6:
        return [radius] + [0.0] * (count - 1)
    return [0.0] + [radius * rng.uniform(0.5, 1) for _ in range(count - 1)]


def pick(rng: np.random.Generator, sources: list[Array]) -> Array:
    """Return one of some photographs."""
    return sources[int(rng.integers(len(sources)))]
