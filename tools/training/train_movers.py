"""Train a network that finds what moves by itself, on scenes of layers that other processes draw beside it.

``python -m tools.training.train_movers unet PHOTOGRAPHS --out runs/unet --things CUTOUTS --first weights.pt``
trains on a GPU, if there is one, and ``blur`` in its place the network that sees blur against the camera's
motion. They write ``last.pt``, which `tools.training.export` exports; stopped, a run goes on. ``--steps 2
--batch 2 --side 128 --workers 1 --held 1`` tries it on a processor. Every seventh photograph is kept for the
figures.
"""

import multiprocessing
import os
from collections import deque
from pathlib import Path
from queue import Queue
from typing import Any, Literal

import cv2
import numpy as np
import torch
from PIL import Image
from torch import Tensor
from torch.nn import functional as nnf

from blur2view.arrays import AnyArray
from blur2view.images.pixels import floats_of, gain_of, rgb_of
from blur2view.movers.moving import (
    LEFT,
    at_cells,
    at_places,
    camera_field,
    cell_values,
    first_axis,
    of_cells,
    of_places,
)
from blur2view.networks.smear_network import SmearNetwork
from blur2view.networks.spectra import STEP
from tools.command import Existing, run
from tools.datasets.shards import Example
from tools.metrics import average_precision, epe_s
from tools.rendering.layer_scenes import KINDS, PLACE_PX, Sources, layer_scene, silhouettes
from tools.rendering.sensor import processed
from tools.rendering.textures import load_photos
from tools.training.mover_networks import BlurNet, UNet
from tools.training.run import Schedule, Task, batched, fit

Which = Literal["unet", "blur"]

HELD_EVERY = 7
POOL = 512
"""Newest pictures that batches are drawn of."""
LONGEST_PX, LONGEST_SHARES = (16.0, 40.0, 90.0), (0.25, 0.4, 0.35)
"""Longest smears of scenes of 512 px, and how often each is drawn."""
EDGE = 0.9, 0.25
"""Share of a place from which on it shows one surface; weight of the smears of others."""
SMEAR_WEIGHT, MOVING_WEIGHT, CAMERA_WEIGHT = 0.5, 5.0, 0.3
LEAST_ERROR = 0.02
"""Of a compressed smear: smaller errors do not matter."""
STUDENT = 4.0
"""Degrees of freedom of the errors, whose deviations are asked."""
READ_WEIGHT = 0.2
"""Of the question whether a smear is read, in the loss of `BlurNet`."""
READ_PX, READ_SHARE = 2.0, 0.25
"""Error of a smear that is still read right: constant, and of its length."""
LEFT_OUT_SHARE = 0.5
"""Share of pictures whose camera motion is fitted with the movers left out, as where the U-Net sees them."""


def example(
    which: Which,
    rng: np.random.Generator,
    sources: Sources,
    size: tuple[int, int],
    network: SmearNetwork,
    device: str = "cpu",
) -> Example:
    """Draw a scene, photograph it, read its smears, and return what a network sees of it, and the truth."""
    longest = float(rng.choice(LONGEST_PX, p=LONGEST_SHARES)) * min(size[0] / 512, 2)
    scene = layer_scene(rng, sources, size, longest_px=longest, device=device)
    image = np.clip(processed(rng, scene.linear)[0], 0, 255).astype(np.uint8)
    grid, moving = network.predict(image), np.clip(scene.moving, 0, 1)
    truth = {"moving": moving, "kind": np.array(KINDS.index(scene.kind))}
    if which == "unet":
        return truth | {
            "image": first_axis(floats_of(image, gain_of(image))),
            "cells": first_axis(cell_values(grid)),
            "displacement": first_axis(scene.displacement),
            "share": scene.share,
            "camera": np.array(scene.camera_moved),
        }
    side = STEP // PLACE_PX
    left_out = (1 - LEFT) * (rng.random() < LEFT_OUT_SHARE)
    motion = camera_field(grid, 1 - left_out * at_cells(moving, grid.cells.shape), rng)
    error = epe_s(np.kron(grid.smears().displacement, np.ones((side, side, 1))), scene.displacement)
    return truth | {
        "places": first_axis(of_places(*at_places(rgb_of(image)), grid, motion)),
        "cells": first_axis(of_cells(grid, motion)),
        "read": error < READ_PX + READ_SHARE * np.linalg.norm(scene.displacement, axis=-1),
    }


def split_sources(photographs: list[Path], things: Path | None) -> tuple[Sources, Sources]:
    """Return what training scenes are made of, and every seventh, of which the held-out ones are."""
    cutouts = [] if things is None else sorted(things.rglob("*.png"))
    shapes = silhouettes() + [np.asarray(Image.open(path).convert("RGBA")) for path in cutouts]
    photos = load_photos(photographs)
    kept = Sources(photographs=photos[::HELD_EVERY], things=shapes[::HELD_EVERY])
    for part in (photos, shapes):
        del part[::HELD_EVERY]
    return Sources(photographs=photos, things=shapes), kept


def draw_examples(
    which: Which, seed: int, queue: "Queue[Example]", sources: Sources, size: tuple[int, int], device: str
) -> None:
    """Draw examples without end, in a process of its own."""
    cv2.setNumThreads(1)
    torch.set_num_threads(1)
    rng, network = np.random.default_rng(seed), SmearNetwork(threads=1)
    while True:
        queue.put(example(which, rng, sources, size, network, device))


def compressed(displacement: Tensor) -> Tensor:
    """Return smears (N, 2, ...) in double angle, of length log(1 + L / 2)."""
    x, y = displacement[:, 0], displacement[:, 1]
    length = torch.hypot(x, y).clamp(min=1e-6)
    scale = torch.log1p(length / 2) / (length * length)
    return torch.stack([scale * (x * x - y * y), scale * 2 * x * y], 1)


def smear_loss(said: Tensor, target: Tensor, weight: Tensor) -> Tensor:
    """Return the mean error of smears, along and across, and Student's loss of their stated deviations.

    ``said`` (N, 4, ...) and ``target`` (N, 2, ...) are of compressed smears. The deviations pull at no smear:
    else places that stand still would count hundreds of times as much as others.
    """
    error, spread = said[:, :2] - target, said[:, 2:4].clamp(-4, 2)
    unit = nnf.normalize(target, dim=1, eps=1e-3)
    along = (error * unit).sum(1)
    across = error[:, 1] * unit[:, 0] - error[:, 0] * unit[:, 1]
    short = target.norm(dim=1) < 1e-2  # of no direction
    parts = torch.where(short, error[:, 0], along), torch.where(short, error[:, 1], across)
    total = torch.sqrt(parts[0] ** 2 + 2 * parts[1] ** 2 + LEAST_ERROR**2)
    fitted = torch.zeros_like(total)
    for part, log_sigma in zip(parts, spread.unbind(1), strict=True):
        squared = (part.detach() ** 2 + LEAST_ERROR**2) * torch.exp(-2 * log_sigma)
        fitted = fitted + log_sigma + (STUDENT + 1) / 2 * torch.log1p(squared / STUDENT)
    loss: Tensor = ((2 * total + 0.3 * fitted) * weight).sum() / weight.sum()
    return loss


def loss_of(said: tuple[Tensor, Tensor] | Tensor, batch: dict[str, Tensor]) -> Tensor:
    """Return the loss of what a network says of places.

    `UNet` says (N, 5, h, w), and (N,) of the camera; of `BlurNet`'s (N, 2, h, w) it is the mean cross-entropy
    of both questions.
    """
    cross_entropy = nnf.binary_cross_entropy_with_logits
    if isinstance(said, Tensor):
        moves, reads = (cross_entropy(said[:, k], batch[name]) for k, name in enumerate(("moving", "read")))
        return moves + READ_WEIGHT * reads
    places, camera = (one.float() for one in said)
    weight = torch.where(batch["share"] > EDGE[0], 1.0, EDGE[1])
    smears = smear_loss(places[:, :4], compressed(batch["displacement"]), weight)
    moving, moved = cross_entropy(places[:, 4], batch["moving"]), cross_entropy(camera, batch["camera"])
    return SMEAR_WEIGHT * smears + MOVING_WEIGHT * moving + CAMERA_WEIGHT * moved


def judged(odds: AnyArray, one: Example) -> tuple[str, float]:
    """Name and return the average precision of log-odds (h, w), or the false area where nothing moves."""
    moves, kind = one["moving"] > 0.5, KINDS[int(one["kind"])]
    if moves.any():
        return f"precision {kind}", average_precision(odds.ravel(), moves.ravel())
    return f"false {kind}", float((odds > 0).mean())


class MoverTask(Task):
    """One of the networks, on the newest examples of a queue."""

    def __init__(
        self, network: UNet | BlurNet, facts: dict[str, Any], queue: "Queue[Example]", held: list[Example]
    ) -> None:
        super().__init__(network, facts)
        self.queue, self.held, self.pool = queue, held, deque[Example](maxlen=POOL)
        self.device = next(network.parameters()).device

    def said(self, network: torch.nn.Module, rows: list[Example]) -> tuple[Any, dict[str, Tensor]]:
        """Return what a network says of examples, and their batch."""
        batch = {name: one.to(self.device) for name, one in batched(rows).items()}
        fine = batch["image"] if "image" in batch else batch["places"]
        with torch.autocast(self.device.type, torch.bfloat16, enabled=self.device.type == "cuda"):
            return network(fine, batch["cells"]), batch

    def loss(self, rng: np.random.Generator, step: int) -> Tensor:
        """Return the loss of a batch of the newest examples; at first it waits for as many."""
        count = self.facts["batch"]
        while len(self.pool) < count or not self.queue.empty():
            self.pool.append(self.queue.get())
        rows = [self.pool[int(k)] for k in rng.permutation(len(self.pool))[:count]]
        return loss_of(*self.said(self.network, rows))

    @torch.no_grad()
    def figures(self, network: torch.nn.Module) -> dict[str, Any]:
        """Return means by kind: average precision, false area where nothing moves, cameras judged rightly."""
        rows: dict[str, list[float]] = {}
        for one in self.held:
            said, _ = self.said(network, [one])
            places = said[0][0, 4] if isinstance(said, tuple) else said[0, 0]
            name, value = judged(places.float().cpu().numpy(), one)
            rows.setdefault(name, []).append(value)
            if isinstance(said, tuple):
                rows.setdefault("camera", []).append((float(said[1]) > 0) == (one["camera"] > 0.5))
        return {name: round(float(np.mean(values)), 3) for name, values in sorted(rows.items())}


def main(
    which: Which,
    photographs: list[Existing],
    *,
    out: Path,
    things: Existing | None = None,
    first: Existing | None = None,
    steps: int = 4000,
    batch: int = 32,
    side: int = 512,
    workers: int = max(1, (os.cpu_count() or 1) - 1),
    rate: float = 1.5e-3,
    held: int = 48,
    seed: int = 0,
) -> None:
    """Train on folders of photographs, on emoji and cut-outs of a folder; ``first`` is a checkpoint."""
    torch.manual_seed(seed)
    sources, kept = split_sources(photographs, things)
    device = "cuda" if torch.cuda.is_available() else "cpu"
    network: UNet | BlurNet = UNet() if which == "unet" else BlurNet()
    size = side, side * 3 // 4 // STEP * STEP
    rng, reader = np.random.default_rng([seed, 1]), SmearNetwork(threads=1)
    apart = [example(which, rng, kept, size, reader, device) for _ in range(held)]
    if first is not None:
        stored = torch.load(first, map_location="cpu", weights_only=True)
        network.load_state_dict(stored.get("average", stored.get("unet")))
    elif isinstance(network, BlurNet):
        network.of_places.learn(torch.from_numpy(np.stack([one["places"] for one in apart])))
        network.of_cells.learn(torch.from_numpy(np.stack([one["cells"] for one in apart])))
    context = multiprocessing.get_context("spawn")
    queue: Any = context.Queue(maxsize=4 * batch)
    for k in range(workers):
        given = which, 1000 * seed + k, queue, sources, size, device
        context.Process(target=draw_examples, args=given, daemon=True).start()
    task = MoverTask(network.to(device), {"batch": batch, "seed": seed}, queue, apart)
    every = min(steps, 200)
    try:
        fit(task, Schedule(out=out, steps=steps, rate=rate, largest_gradient=2.0, seed=seed, every=every))
    finally:
        for process in multiprocessing.active_children():
            process.terminate()


if __name__ == "__main__":
    run(main)
