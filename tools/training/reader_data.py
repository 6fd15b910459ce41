"""Make the reader's training examples: pictures with known smears, turned into the features of their windows.

``python -m tools.training.reader_data OUT --photos FOLDER... --shards 400`` writes numbered shards of scenes
of layers of photographs and textures, of 320x256, 640x512 or 1280x1024. Pictures of 320x256 (128 in a shard)
are read in two octaves, those twice as large (32) in three, and so on. Shard k, of 30 MB, depends on k and
the sources only. Run again it goes on; several processes may share the work (``--first 0 --every 2``,
``--first 1 --every 2``).
"""

import copy
import math
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import torch

from blur2view.arrays import AnyArray as Array
from blur2view.images.pixels import gain_of
from blur2view.networks.spectra import STEP, polar_cepstra, power_spectra, windows_of
from tools.command import Existing, run
from tools.datasets.shards import Example, write_shards
from tools.rendering import textures
from tools.rendering.layer_scenes import PLACE_PX, LayerScene, Sources, layer_scene, silhouettes
from tools.rendering.sensor import processed
from tools.training.reader import clipped_shares

SHARD_PX = 128 * 320 * 256
"""Pixels of all the pictures in a shard."""
SMALLEST = 320
"""Width of pictures that are read in two octaves."""
LONGEST_PX = {(320, 256): 60.0, (640, 512): 180.0, (1280, 1024): 320.0}
"""Sizes of pictures, and their longest smears."""
SMALL_SHARE, WIDE_SHARE = 0.35, 0.2
"""Shares of shards of the smallest and of the largest size."""
SHORT_SHARE, SHORT_PX = 0.5, 14.0
"""Share of pictures whose smears have at most this length."""
TEXTURES = 3
"""Procedural textures that the pictures of a shard share."""
TEXTURED_SHARE = 0.25
"""Share of pictures whose surfaces are textures, too."""
FOCUS_SHARE, RADIUS_PX = 0.5, (0.7, 20.0)
"""Share of pictures that are out of focus, and by how much."""
SURFACE = 0.9
"""Share of a place from which on it shows one surface, whose smear is valid."""
SMOOTH_PX = 20.0
"""Deviation of the Gaussian that leaves no detail of a picture, for what noise alone looks like."""
SAMPLES = 4
"""Samples of the truth along a cell of windows."""
LUMA = np.array([0.299, 0.587, 0.114], np.float32)
DIM_SHARE, DIMMEST = 0.15, 20.0
"""Share of pictures that were coded this many times darker at most, log-uniform, and so in fewer levels."""
NARROW_PX, WIDE_PX, EXTENT_PX = 0.75, 1.5, 2.0
"""Deviations of the two Gaussians whose difference is the band of a blur of this extent."""
REGION_PX = 20.0
"""Deviation of the region about a cell's centre, as that of a Hann window of 96 px."""
SIGNAL, LEAST = 2.0, 0.4 / 255
"""Power of a band over that of the noise there, and its amplitude, from which on it shows something."""


def scenes(rng: np.random.Generator, sources: Sources, size: tuple[int, int]) -> Iterator[LayerScene]:
    """Yield scenes of layers of photographs, or of these and procedural textures, without end."""
    drawn = [textures.procedural(rng) for _ in range(TEXTURES)]
    made = [(np.clip(linear, 0, 1) ** (1 / 2.2) * 255 + 0.5).astype(np.uint8) for linear in drawn]
    fitting = [p for p in sources.photographs if min(np.array(p.shape[1::-1]) / size) >= 0.75]
    photographs = fitting or sources.photographs
    while True:
        pool = photographs
        if rng.random() < TEXTURED_SHARE:
            pool = [*made, *(photographs[int(k)] for k in rng.integers(len(photographs), size=TEXTURES))]
        yield layer_scene(
            rng,
            Sources(photographs=pool, things=sources.things),
            size,
            longest_px=SHORT_PX if rng.random() < SHORT_SHARE else LONGEST_PX[size],
            focus_share=FOCUS_SHARE,
            radius_px=RADIUS_PX,
        )


def cells_of(values: Array, side: int) -> Array:
    """Return samples (h, w, 16, ...) of the truth in cells of `side` x `side` of its own cells."""
    h, w = (n // side for n in values.shape[:2])
    every = side // SAMPLES
    pick = slice(every // 2, None, every)
    cells = values[: h * side, : w * side].reshape(h, side, w, side, *values.shape[2:])
    cells = cells[:, pick, :, pick].swapaxes(1, 2)
    return cells.reshape(h, w, -1, *values.shape[2:])


def photographed(rng: np.random.Generator, linear: Array) -> tuple[Array, Array, float]:
    """Return the luma of a photograph, that of the same camera's of what has no detail, and its spread.

    The spread is the radius of a disc, pixels.
    """
    same = copy.deepcopy(rng)
    image, spread = processed(rng, linear)
    smooth, _ = processed(same, np.asarray(cv2.GaussianBlur(linear, (0, 0), SMOOTH_PX)))
    levels = 255 / math.exp(rng.uniform(math.log(2), math.log(DIMMEST))) if rng.random() < DIM_SHARE else 255
    image, smooth = (np.round(each * (levels / 255)) / np.float32(255) for each in (image, smooth))
    gain = gain_of(np.asarray(image, np.float32))
    shown = np.minimum(np.asarray(image, np.float32) * np.float32(gain), 1)
    noise = np.asarray(smooth @ LUMA * np.float32(gain), np.float32)
    noise += np.float32(gain / 255 / 12**0.5) * rng.standard_normal(noise.shape, dtype=np.float32)
    return shown @ LUMA, noise, spread


def example_of(rng: np.random.Generator, scene: LayerScene) -> Example:
    """Return what an example holds of each of the octaves of a picture.

    Features C (h, w, 32, 45), s (h, w, 5); samples of the truth d (h, w, 16, 2), v, r (h, w, 16): smears,
    whether they are valid, radii out of focus with the camera's own spread; t (h, w): whether a cell shows
    its blur at all.
    """
    shown, noisy, spread = photographed(rng, scene.linear)
    valid, total = scene.share > SURFACE, np.hypot(scene.radius_px, spread)
    row: Example = {}
    for k in range(2 + round(math.log2(shown.shape[1] / SMALLEST))):
        cepstra, scales = polar_cepstra(power_spectra(windows_of(shown)))
        clipped = clipped_shares(torch.from_numpy(shown)[None, None])[0].numpy()
        side = STEP // PLACE_PX * 2**k
        d, v, r = (cells_of(each, side) for each in (scene.displacement / 2**k, valid, total / 2**k))
        extent = np.maximum(np.hypot(d[..., 0], d[..., 1]), 2 * r).mean(-1)
        scalars = np.concatenate([scales, clipped], -1)
        row |= {f"C{k}": cepstra.astype(np.float16), f"s{k}": scalars.astype(np.float16)}
        row |= {f"d{k}": d.astype(np.float16), f"v{k}": v, f"r{k}": r.astype(np.float16)}
        row[f"t{k}"] = shows_blur(shown, noisy, extent)
        shown, noisy = (each.reshape(len(each) // 2, 2, -1, 2).mean((1, 3)) for each in (shown, noisy))
    return row


def shows_blur(grey: Array, noise: Array, extent_px: Array) -> Array:
    """Return whether cells (h, w) show their blur: the frequencies that it leaves hold more than noise.

    Parameters
    ----------
    grey, noise : ndarray of shape (32 h, 32 w), float32
        Luma, and that of the same camera's picture of what has no detail.
    extent_px : ndarray of shape (h, w)
        The length of the smear or the diameter of the disc, pixels.
    """
    levels = 1 + int(np.log2(max(min(grey.shape) / (2 * STEP), 1)))
    wanted = np.log2(np.maximum(extent_px, EXTENT_PX) / EXTENT_PX)
    level = np.minimum(np.round(wanted).astype(int), levels - 1)
    shows = np.zeros(extent_px.shape, bool)
    x, y = np.meshgrid(*(STEP * np.arange(n, dtype=np.float32) + STEP / 2 for n in extent_px.shape[::-1]))
    for k in range(levels):
        place = x / 2**k - 0.5, y / 2**k - 0.5
        region_px, powers = max(REGION_PX / 2**k, 4 * WIDE_PX), []
        for each in (grey, noise):
            narrow, wide = (cv2.GaussianBlur(each, (0, 0), sigma) for sigma in (NARROW_PX, WIDE_PX))
            band = cv2.GaussianBlur(np.asarray((narrow - wide) ** 2), (0, 0), region_px)
            powers.append(cv2.remap(band, *place, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))
        power, quiet = powers
        clear = power > SIGNAL * quiet + LEAST**2
        shows[level == k] = clear[level == k]
        grey, noise = (
            cv2.resize(each, (each.shape[1] // 2, each.shape[0] // 2), interpolation=cv2.INTER_AREA)
            for each in (grey, noise)
        )
    return shows


def examples(number: int, sources: Sources) -> Iterator[Example]:
    """Yield the examples of one shard, of pictures of one size."""
    torch.set_num_threads(1)  # the number of threads decides how sums are rounded
    rng, (small, middle, wide) = np.random.default_rng(number), LONGEST_PX
    kind = rng.random()
    size = wide if kind < WIDE_SHARE else small if kind > 1 - SMALL_SHARE else middle
    drawn, count = scenes(rng, sources, size), -(-SHARD_PX // (size[0] * size[1]))
    for _ in range(count):
        yield example_of(rng, next(drawn))


def main(out: Path, *, photos: list[Existing], shards: int = 400, first: int = 0, every: int = 1) -> None:
    """Write shards of scenes of sharp photographs in folders and of emoji."""
    sources = Sources(photographs=textures.load_photos(photos), things=silhouettes())
    write_shards(out, range(first, first + shards, every), partial(examples, sources=sources))


if __name__ == "__main__":
    run(main)
