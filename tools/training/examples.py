"""Training examples: scenes of layers, drawn without end, as the networks see them, and their truth.

Batch k of a seed is the same whichever process draws it. Of smear.onnx its pictures have 320x256, 640x512 or
1280x1024 pixels and are read in two, three or four octaves; larger ones are fewer.
"""

import copy
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
import torch
from PIL import Image
from torch import Tensor
from torch.utils.data import DataLoader, Dataset

from blur2view.arrays import AnyArray as Array
from blur2view.images.pixels import as_floats, as_rgb, brightness_gain
from blur2view.movers.moving import (
    BLOCK_PX,
    LEFT,
    block_evidence,
    block_gradients,
    camera_field,
    cell_evidence,
    cell_values,
    channels_first,
    over_cells,
)
from blur2view.networks.smear_network import SmearNetwork
from blur2view.networks.spectra import STEP, polar_cepstra, power_spectra, sliding_windows
from tools.metrics import epe_s
from tools.rendering import textures
from tools.rendering.layer_scenes import KINDS, LayerScene, Sources, layer_scene, silhouettes
from tools.rendering.sensor import processed
from tools.training.reader import clipped_shares

Which = Literal["smear", "unet", "blur"]
"""smear.onnx, unet.onnx, movers.onnx."""
Batch = dict[str, Tensor]
Example = dict[str, Array]
Size = tuple[int, int]

HELD_EVERY = 7
SMALLEST = 320, 256
LONGEST_PX: dict[Size, float] = {SMALLEST: 60.0, (640, 512): 180.0, (1280, 1024): 320.0}
"""Sizes of the smear network's pictures, and their longest smears."""
SIZE_SHARES = 0.35, 0.45, 0.2
SHORT_SHARE, SHORT_PX = 0.5, 14.0
"""Share of pictures whose smears have at most this length."""
TEXTURED_SHARE = 0.25
"""Share of pictures whose surfaces may be a procedural texture."""
FOCUS_SHARE, RADIUS_PX = 0.5, (0.7, 20.0)
"""Share of pictures that are out of focus, and the radii."""
SURFACE = 0.9
"""Share of a block from which on it shows one surface, whose smear is valid."""
SMOOTH_PX = 20.0
"""Deviation of the Gaussian that removes all detail from a picture, so that its noise is left."""
SAMPLES = 4
"""Samples of the truth along a cell of windows."""
LUMA = np.array([0.299, 0.587, 0.114], np.float32)
DIM_SHARE, MAX_DIMMING = 0.15, 20.0
"""Share of pictures coded darker, by up to this factor, log-uniform, and so in fewer levels."""
NARROW_PX, WIDE_PX, EXTENT_PX = 0.75, 1.5, 2.0
"""Deviations of the two Gaussians whose difference is the band of a blur of this extent."""
REGION_PX = 20.0
"""Deviation of the region about a cell's centre, as that of a Hann window of 96 px."""
SIGNAL, MIN_SIGNAL = 2.0, 0.4 / 255
"""Power of a band over that of the noise, and its amplitude, from which on it shows the blur."""
LENGTHS_PX, LENGTH_SHARES = (16.0, 40.0, 90.0), (0.25, 0.4, 0.35)
"""Longest smears of the mover networks' scenes of 512 px, and how often each is drawn."""
READ_PX, READ_SHARE = 2.0, 0.25
"""Error up to which a smear is read right: constant, and per pixel of its length."""
LEFT_OUT_SHARE = 0.5
"""Share of pictures whose camera motion is fitted without the movers, as where the U-Net sees them."""


@dataclass(frozen=True, kw_only=True)
class Drawing(Dataset[Batch]):
    """Batches of a network's examples, by number: ``count`` pictures, or as many cells in larger ones."""

    which: Which
    sources: Sources
    count: int
    size: Size | None = None
    """Width and height; None draws one of the smear network's."""
    seed: int = 0
    device: str = "cpu"
    """Where scenes are drawn."""

    def __getitem__(self, number: int) -> Batch:
        """Draw a batch: float32 tensors by name."""
        rng = np.random.default_rng([self.seed, number])
        sizes = list(LONGEST_PX)
        size = self.size or sizes[rng.choice(len(sizes), p=SIZE_SHARES)]
        if self.which == "smear":
            count = max(1, self.count * math.prod(SMALLEST) // math.prod(size))
            rows = [smear_example(rng, smear_scene(rng, self.sources, size)) for _ in range(count)]
        else:
            drawn = partial(mover_example, self.which, rng, self.sources, size, self.device)
            rows = [drawn() for _ in range(self.count)]
        return {name: torch.from_numpy(np.stack([row[name] for row in rows])).float() for name in rows[0]}

    def batches(self, first: int, steps: int, workers: int) -> Iterator[Batch]:
        """Yield the batches ``first`` to ``steps``, in order, drawn by other processes."""
        yield from DataLoader(
            self,
            batch_size=None,
            sampler=range(first, steps),
            num_workers=workers,
            multiprocessing_context="spawn" if workers else None,
            prefetch_factor=2 if workers else None,
            worker_init_fn=prepare_worker,
        )


def prepare_worker(number: int) -> None:
    """Let OpenCV use one thread in a process that draws, because there are several of these."""
    cv2.setNumThreads(1)


def split_sources(photographs: list[Path], things: Path | None = None) -> tuple[Sources, Sources]:
    """Return the sources of training scenes, and every seventh photograph and thing, held out."""
    cutouts = [] if things is None else sorted(things.rglob("*.png"))
    shapes = silhouettes() + [np.asarray(Image.open(path).convert("RGBA")) for path in cutouts]
    photos = textures.load_photos(photographs)
    kept = Sources(photographs=photos[::HELD_EVERY], things=shapes[::HELD_EVERY])
    for part in (photos, shapes):
        del part[::HELD_EVERY]
    return Sources(photographs=photos, things=shapes), kept


def smear_scene(rng: np.random.Generator, sources: Sources, size: Size) -> LayerScene:
    """Draw a scene of photographs of at least three quarters of a size, or of one and a texture."""
    pool = [p for p in sources.photographs if min(np.array(p.shape[1::-1]) / size) >= 0.75]
    pool = pool or sources.photographs
    if rng.random() < TEXTURED_SHARE:
        linear = np.clip(textures.procedural(rng), 0, 1)
        pool = [(linear ** (1 / 2.2) * 255 + 0.5).astype(np.uint8), pool[int(rng.integers(len(pool)))]]
    longest = SHORT_PX if rng.random() < SHORT_SHARE else LONGEST_PX[size]
    made = Sources(photographs=pool, things=sources.things)
    return layer_scene(rng, made, size, longest_px=longest, focus_share=FOCUS_SHARE, radius_px=RADIUS_PX)


def smear_example(rng: np.random.Generator, scene: LayerScene) -> Example:
    """Photograph a scene and return the inputs and the truth of each octave.

    Features C (h, w, 32, 45), s (h, w, 5); samples of the truth d (h, w, 16, 2), v, r (h, w, 16): smears,
    their validity, radii out of focus with the camera's own spread; t (h, w): whether a cell shows its blur.
    """
    shown, noisy, spread = photographed(rng, scene.linear)
    valid, total = scene.share > SURFACE, np.hypot(scene.radius_px, spread)
    row: Example = {}
    for k in range(2 + round(math.log2(shown.shape[1] / SMALLEST[0]))):
        cepstra, scales = polar_cepstra(power_spectra(sliding_windows(shown)))
        clipped = clipped_shares(torch.from_numpy(shown)[None, None])[0].numpy()
        side = STEP // BLOCK_PX * 2**k
        d, v, r = (cells_of(each, side) for each in (scene.displacement / 2**k, valid, total / 2**k))
        extent = np.maximum(np.hypot(d[..., 0], d[..., 1]), 2 * r).mean(-1)
        row |= {f"C{k}": cepstra, f"s{k}": np.concatenate([scales, clipped], -1)}
        row |= {f"d{k}": d, f"v{k}": v, f"r{k}": r, f"t{k}": shows_blur(shown, noisy, extent)}
        shown, noisy = (each.reshape(len(each) // 2, 2, -1, 2).mean((1, 3)) for each in (shown, noisy))
    return row


def photographed(rng: np.random.Generator, linear: Array) -> tuple[Array, Array, float]:
    """Return the luma of a photograph, that of the same picture without detail, and the camera's spread.

    The spread is the radius of a disc, pixels.
    """
    same = copy.deepcopy(rng)
    image, spread = processed(rng, linear)
    smooth, _ = processed(same, np.asarray(cv2.GaussianBlur(linear, (0, 0), SMOOTH_PX)))
    is_dim = rng.random() < DIM_SHARE
    levels = 255 / math.exp(rng.uniform(math.log(2), math.log(MAX_DIMMING))) if is_dim else 255
    image, smooth = (np.round(each * (levels / 255)) / np.float32(255) for each in (image, smooth))
    gain = brightness_gain(np.asarray(image, np.float32))
    shown = np.minimum(np.asarray(image, np.float32) * np.float32(gain), 1)
    noise = np.asarray(smooth @ LUMA * np.float32(gain), np.float32)
    noise += np.float32(gain / 255 / 12**0.5) * rng.standard_normal(noise.shape, dtype=np.float32)
    return shown @ LUMA, noise, spread


def cells_of(values: Array, side: int) -> Array:
    """Return 16 samples (h, w, 16, ...) of the truth in each cell of ``side`` x ``side`` of its blocks."""
    h, w = (n // side for n in values.shape[:2])
    every = side // SAMPLES
    pick = slice(every // 2, None, every)
    cells = values[: h * side, : w * side].reshape(h, side, w, side, *values.shape[2:])
    cells = cells[:, pick, :, pick].swapaxes(1, 2)
    return cells.reshape(h, w, -1, *values.shape[2:])


def shows_blur(grey: Array, noise: Array, extent_px: Array) -> Array:
    """Return whether cells (h, w) show their blur: the frequencies that it leaves hold more than noise.

    Parameters
    ----------
    grey, noise : ndarray of shape (32 h, 32 w), float32
        Luma of the photograph, and of the same photograph without detail.
    extent_px : ndarray of shape (h, w)
        The length of the smear or the diameter of the disc, pixels.
    """
    levels = 1 + int(np.log2(max(min(grey.shape) / (2 * STEP), 1)))
    wanted = np.log2(np.maximum(extent_px, EXTENT_PX) / EXTENT_PX)
    level = np.minimum(np.round(wanted).astype(int), levels - 1)
    shows = np.zeros(extent_px.shape, bool)
    x, y = np.meshgrid(*(STEP * np.arange(n, dtype=np.float32) + STEP / 2 for n in extent_px.shape[::-1]))
    for k in range(levels):
        at = x / 2**k - 0.5, y / 2**k - 0.5
        region_px, powers = max(REGION_PX / 2**k, 4 * WIDE_PX), []
        for each in (grey, noise):
            narrow, wide = (cv2.GaussianBlur(each, (0, 0), sigma) for sigma in (NARROW_PX, WIDE_PX))
            band = cv2.GaussianBlur(np.asarray((narrow - wide) ** 2), (0, 0), region_px)
            powers.append(cv2.remap(band, *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))
        clear = powers[0] > SIGNAL * powers[1] + MIN_SIGNAL**2
        shows[level == k] = clear[level == k]
        grey, noise = (
            cv2.resize(each, (each.shape[1] // 2, each.shape[0] // 2), interpolation=cv2.INTER_AREA)
            for each in (grey, noise)
        )
    return shows


def mover_example(
    which: Which, rng: np.random.Generator, sources: Sources, size: Size, device: str = "cpu"
) -> Example:
    """Photograph a scene, read its smears, and return the inputs of a mover network and the truth."""
    longest = float(rng.choice(LENGTHS_PX, p=LENGTH_SHARES)) * min(size[0] / 512, 2)
    scene = layer_scene(rng, sources, size, longest_px=longest, device=device)
    image = np.clip(processed(rng, scene.linear)[0], 0, 255).astype(np.uint8)
    grid, moving = SmearNetwork(threads=1).predict(image), np.clip(scene.moving, 0, 1)
    truth = {"moving": moving, "kind": np.array(KINDS.index(scene.kind))}
    if which == "unet":
        return truth | {
            "image": channels_first(as_floats(image, brightness_gain(image))),
            "cells": channels_first(cell_values(grid)),
            "displacement": channels_first(scene.displacement),
            "share": scene.share,
            "camera": np.array(scene.camera_moved),
        }
    left_out, side = (1 - LEFT) * (rng.random() < LEFT_OUT_SHARE), STEP // BLOCK_PX
    motion = camera_field(grid, 1 - left_out * over_cells(moving, grid.cells.shape), rng)
    error = epe_s(np.kron(grid.smears().displacement, np.ones((side, side, 1))), scene.displacement)
    return truth | {
        "blocks": channels_first(block_evidence(*block_gradients(as_rgb(image)), grid, motion)),
        "cells": channels_first(cell_evidence(grid, motion)),
        "read": error < READ_PX + READ_SHARE * np.linalg.norm(scene.displacement, axis=-1),
    }
