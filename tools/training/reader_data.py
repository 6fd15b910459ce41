"""Make the reader's training examples: pictures with known smears, turned into the features of their windows.

``python -m tools.training.reader_data OUT --photos FOLDER... --shards 400`` writes numbered shards of
pictures of one size: rendered scenes of 320x256 or 640x512, or photographs and textures of these or of
1280x1024.
Pictures of 320x256 (128 in a shard) are read in two octaves, those twice as large (32) in three, and so on.
Shard k depends on k and the sources only. Run again it goes on; several processes may share the work
(``--first 0 --every 2``, ``--first 1 --every 2``). A shard has 30 MB. ``--rendered-share 0`` makes no scenes.
"""

import copy
import math
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import torch

from blur2view.arrays import AnyArray as Array
from blur2view.networks.brightness import gain_of
from blur2view.networks.spectra import STEP, polar_cepstra, power_spectra, windows_of
from tools.arguments import Existing, run
from tools.datasets.shards import Example, write_shards
from tools.rendering import textures
from tools.rendering.defocus import defocused
from tools.rendering.exposure import GRID
from tools.rendering.render import Rendering, RenderOptions, render
from tools.rendering.sensor import log_uniform
from tools.rendering.shaken import Shaken, ShakeOptions, processed, shake
from tools.rendering.textures import load_photos
from tools.training.reader import clipped_shares
from tools.training.visible import shows_blur

SHARD_PX = 128 * 320 * 256
"""Pixels of all the pictures in a shard."""
TEXTURES = 3
"""Procedural textures that the pictures of a shard share."""
SMALLEST = 320
"""Width of pictures that are read in two octaves."""
SMALL = ShakeOptions(size=(320, 256), smear_px=(1.2, 60.0))
WIDE = ShakeOptions(size=(1280, 1024), smear_px=(2.0, 320.0))
"""Smaller and larger pictures; the others are as :class:`ShakeOptions` has them."""
SMOOTH_PX = 20.0
"""Deviation of the Gaussian that leaves no detail of a picture, for what noise alone looks like."""
OF_A_SCENE, LARGE_SCENES = 4, 0.2
"""Pictures of each rendered scene; and the share of shards of scenes that are of 640x512."""
SCENE_FOCUS_SHARE = 0.25
"""Share of pictures of rendered scenes that are out of focus."""
SAMPLES = 4
"""Samples of the truth along a cell of windows."""
LONGEST_PX = 400
"""Smears from here on become hidden zeros."""
LUMA = np.array([0.299, 0.587, 0.114], np.float32)
DIM_SHARE, DIMMEST = 0.15, 20.0
"""Share of pictures that were coded this many times darker at most, log-uniform, and so in fewer levels."""


RENDERED_SHARE, PROCEDURAL_SHARE = 0.4, 0.1
"""Shares of shards of rendered scenes, and of pictures that show procedural textures; the rest are
photographs under a moving camera."""
SMALL_SHARE, WIDE_SHARE = 0.35, 0.2
"""Shares of shards of 320x256 and of 1280x1024 among those of no rendered scenes."""


def procedural(rng: np.random.Generator, count: int) -> list[Array]:
    """Return procedural textures as uint8 pictures, most of them turned or seen at a slant."""
    makers, shares = zip(*textures.PROCEDURAL, strict=True)
    pictures = []
    for _ in range(count):
        linear = np.clip(makers[rng.choice(len(makers), p=shares)](rng), 0, 1)
        if rng.random() < 0.7:
            linear = slanted(rng, linear)
        pictures.append((linear ** (1 / 2.2) * 255 + 0.5).astype(np.uint8))
    return pictures


def slanted(rng: np.random.Generator, linear: Array, side: int = 640) -> Array:
    """Return a texture rotated and in perspective, mirrored beyond its border."""
    angle, scale = rng.uniform(0, 2 * np.pi), rng.uniform(0.9, 1.6)
    c, s = np.cos(angle) * scale, np.sin(angle) * scale
    tilt = rng.normal(0, 0.0006, 2) if rng.random() < 0.6 else np.zeros(2)
    view = np.array([[c, -s, 0], [s, c, 0], [*tilt, 1.0]])
    there, back = (np.array([[1, 0, t], [0, 1, t], [0, 0, 1.0]]) for t in (len(linear) / 2, -side / 2))
    flags = cv2.INTER_AREA | cv2.WARP_INVERSE_MAP
    matrix = there @ view @ back
    return np.asarray(
        cv2.warpPerspective(linear, matrix, (side, side), flags=flags, borderMode=cv2.BORDER_REFLECT)
    )


def scene_pictures(rng: np.random.Generator, size: tuple[int, int]) -> Iterator[Shaken]:
    """Yield pictures of rendered scenes, some of each, without end."""
    while True:
        scene = render(int(rng.integers(2**31)), RenderOptions(size=size))
        for _ in range(OF_A_SCENE):
            yield scene_picture(rng, scene)


def scene_picture(rng: np.random.Generator, scene: Rendering) -> Shaken:
    """Return a rendered scene, mirrored at random; some are out of focus as a whole."""
    linear, smears, valid = scene.linear, scene.displacement, scene.valid
    for axis, signs in ((1, (-1, 1)), (0, (1, -1))):
        if rng.random() < 0.5:
            linear, smears, valid = (np.flip(each, axis) for each in (linear, smears, valid))
            smears = smears * np.array(signs, np.float32)
    radius = log_uniform(rng, SMALL.radius_px) if rng.random() < SCENE_FOCUS_SHARE else 0.0
    usable = np.all(np.abs(smears) < LONGEST_PX, axis=-1)  # false for NaN, too
    return Shaken(
        linear=defocused(rng, np.ascontiguousarray(linear), radius),
        displacement=np.where(usable[..., None], smears, 0),
        radius_px=np.full(valid.shape, radius, np.float32),
        valid=valid & usable,
    )


def cells_of(values: Array, side: int) -> Array:
    """Return samples (h, w, 16, ...) of the truth in cells of `side` x `side` of its own cells."""
    h, w = (n // side for n in values.shape[:2])
    every = side // SAMPLES
    pick = slice(every // 2, None, every)
    cells = values[: h * side, : w * side].reshape(h, side, w, side, *values.shape[2:])
    cells = cells[:, pick, :, pick].swapaxes(1, 2)
    return cells.reshape(h, w, -1, *values.shape[2:])


def photographed(
    rng: np.random.Generator, linear: Array, options: ShakeOptions
) -> tuple[Array, Array, float]:
    """Return the luma of a photograph, that of the same camera's of what has no detail, and its spread.

    The spread is the radius of a disc, pixels.
    """
    same = copy.deepcopy(rng)
    image, spread = processed(rng, linear, options)
    smooth, _ = processed(same, np.asarray(cv2.GaussianBlur(linear, (0, 0), SMOOTH_PX)), options)
    levels = 255 / math.exp(rng.uniform(math.log(2), math.log(DIMMEST))) if rng.random() < DIM_SHARE else 255
    image, smooth = (np.round(each * (levels / 255)) / np.float32(255) for each in (image, smooth))
    gain = gain_of(np.asarray(image, np.float32))
    shown = np.minimum(np.asarray(image, np.float32) * np.float32(gain), 1)
    noise = np.asarray(smooth @ LUMA * np.float32(gain), np.float32)
    noise += np.float32(gain / 255 / 12**0.5) * rng.standard_normal(noise.shape, dtype=np.float32)
    return shown @ LUMA, noise, spread


def example_of(rng: np.random.Generator, picture: Shaken, options: ShakeOptions, count: int) -> Example:
    """Return what an example holds of each of so many octaves.

    Features C (h, w, 32, 45), s (h, w, 5); samples of the truth d (h, w, 16, 2), v, r (h, w, 16): smears,
    whether they are valid, radii out of focus with the camera's own spread; t (h, w): whether a cell shows
    its blur at all.
    """
    shown, noisy, spread = photographed(rng, picture.linear, options)
    total = np.hypot(picture.radius_px, spread)
    row: Example = {}
    for k in range(count):
        cepstra, scales = polar_cepstra(power_spectra(windows_of(shown)))
        clipped = clipped_shares(torch.from_numpy(shown)[None, None])[0].numpy()
        side = STEP // GRID * 2**k
        truth = (picture.displacement / 2**k, picture.valid, total / 2**k)
        d, v, r = (cells_of(each, side) for each in truth)
        extent = np.maximum(np.hypot(d[..., 0], d[..., 1]), 2 * r).mean(-1)
        scalars = np.concatenate([scales, clipped], -1)
        row |= {f"C{k}": cepstra.astype(np.float16), f"s{k}": scalars.astype(np.float16)}
        row |= {f"d{k}": d.astype(np.float16), f"v{k}": v, f"r{k}": r.astype(np.float16)}
        row[f"t{k}"] = shows_blur(shown, noisy, extent)
        shown, noisy = (each.reshape(len(each) // 2, 2, -1, 2).mean((1, 3)) for each in (shown, noisy))
    return row


def shaken_picture(
    rng: np.random.Generator, photos: list[Array], made: list[Array], options: ShakeOptions
) -> Shaken:
    """Return a photograph or texture under a moving camera."""
    width, height = options.size
    fitting = [p for p in photos if p.shape[1] >= 0.75 * width and p.shape[0] >= 0.75 * height]
    photos = fitting or photos
    textured = bool(made) and rng.random() * (1 - RENDERED_SHARE) < PROCEDURAL_SHARE
    surfaces = made if textured else photos
    if made and rng.random() < 0.1:  # a photograph before a texture, or the reverse
        surfaces = [*made, *[photos[int(rng.integers(len(photos)))]] * len(made)]
    return shake(rng, surfaces, options)


def examples(number: int, photos: list[Array], rendered_share: float) -> Iterator[Example]:
    """Yield the examples of one shard, of sharp photographs, uint8 RGB, or of rendered scenes."""
    torch.set_num_threads(1)  # the number of threads decides how sums are rounded
    rng, options = np.random.default_rng(number), ShakeOptions()
    draw: Callable[[], Shaken]  # of one size
    if rng.random() < rendered_share:
        options = options if rng.random() < LARGE_SCENES else SMALL
        draw = partial(next, scene_pictures(rng, options.size))
    else:
        kind = rng.random()
        options = WIDE if kind < WIDE_SHARE else options
        options = SMALL if kind > 1 - SMALL_SHARE else options
        made = [] if options is WIDE else procedural(rng, TEXTURES)
        draw = partial(shaken_picture, rng, photos, made, options)
    left = SHARD_PX
    while left > 0:
        picture = draw()
        height, width = picture.linear.shape[:2]
        yield example_of(rng, picture, options, 2 + round(math.log2(width / SMALLEST)))
        left -= width * height


def main(
    out: Path,
    *,
    photos: list[Existing],
    rendered_share: float = RENDERED_SHARE,
    shards: int = 400,
    first: int = 0,
    every: int = 1,
) -> None:
    """Write shards of sharp photographs in folders, and a share of them of rendered scenes."""
    work = partial(examples, photos=load_photos(photos), rendered_share=rendered_share)
    write_shards(out, range(first, first + shards, every), work)


if __name__ == "__main__":
    run(main)
