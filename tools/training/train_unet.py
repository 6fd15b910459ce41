"""Train the U-Net on scenes that are made beside it; a stopped run goes on.

``python -m tools.training.train_unet PHOTOGRAPHS --out runs/unet --things CUTOUTS --first weights.pt`` trains
on a GPU, if there is one, with a process for every core that draws scenes, and writes ``last.pt`` and
``weights.pt``, which `tools.training.export_unet` exports. ``--steps 2 --batch 2 --side 256 --workers 1``
tries it on a processor. Every seventh photograph is kept for the figures.
"""

import multiprocessing
import os
from pathlib import Path
from queue import Queue
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor
from torch.nn import functional as nnf

from blur2view.arrays import AnyArray
from blur2view.networks.brightness import gain_of
from blur2view.networks.mover_networks import cell_values
from blur2view.networks.protocol import Detail
from blur2view.networks.smear_network import SmearNetwork, floats_of
from tools.arguments import Existing, run
from tools.datasets.shards import Example
from tools.metrics import average_precision
from tools.rendering.layer_scenes import KINDS, LayerScene, Sources, layer_scene, silhouettes
from tools.rendering.shaken import ShakeOptions, processed
from tools.rendering.textures import load_photos
from tools.training.run import Schedule, Task, batched, fit, save
from tools.training.unet import UNet

HELD_EVERY = 7
LONGEST_PX, LONGEST_SHARES = (16.0, 40.0, 90.0), (0.25, 0.4, 0.35)
"""Longest smears of scenes of 512 px, and how often each is drawn."""
EDGE = 0.9, 0.25
"""Share of a place from which on it shows one surface; weight of the smears of others."""
SMEAR_WEIGHT, MOVING_WEIGHT, CAMERA_WEIGHT = 0.5, 5.0, 0.3
LEAST_ERROR = 0.02
"""Of a compressed smear: smaller errors do not matter."""
STUDENT = 4.0
"""Degrees of freedom of the errors, whose deviations are asked."""


def example(
    rng: np.random.Generator, sources: Sources, size: tuple[int, int], network: SmearNetwork, device: str
) -> Example:
    """Draw a scene, photograph it and read its smears."""
    scene, picture = photographed(rng, sources, size, device)
    return {
        "image": np.moveaxis(floats_of(picture, gain_of(picture)), -1, 0),
        "cells": np.moveaxis(cell_values(network.predict(picture, detail=Detail.PIXELS)), -1, 0),
        "displacement": np.moveaxis(scene.displacement, -1, 0),
        "moving": np.clip(scene.moving, 0, 1),
        "share": scene.share,
        "camera": np.array(scene.camera_moved),
        "kind": np.array(KINDS.index(scene.kind)),
    }


def photographed(
    rng: np.random.Generator, sources: Sources, size: tuple[int, int], device: str = "cpu"
) -> tuple[LayerScene, NDArray[np.uint8]]:
    """Draw a scene, and a photograph (height, width, 3) of it."""
    longest = float(rng.choice(LONGEST_PX, p=LONGEST_SHARES)) * min(size[0] / 512, 2)
    scene = layer_scene(rng, sources, size, longest_px=longest, device=device)
    picture = processed(rng, scene.linear, ShakeOptions(size=size))[0]
    return scene, np.clip(picture, 0, 255).astype(np.uint8)


def split_sources(photographs: list[Path], things: Path | None) -> tuple[Sources, Sources]:
    """Return what training scenes are made of, and every seventh, of which the held-out ones are."""
    cutouts = [] if things is None else sorted(things.rglob("*.png"))
    shapes = silhouettes() + [np.asarray(Image.open(path).convert("RGBA")) for path in cutouts]
    every = load_photos(photographs), shapes
    used = [[one for k, one in enumerate(part) if k % HELD_EVERY] for part in every]
    kept = [part[::HELD_EVERY] for part in every]
    sources, apart = (Sources(photographs=one, things=other) for one, other in (used, kept))
    return sources, apart


def draw_examples(seed: int, queue: "Queue[Example]", sources: Sources, size: tuple[int, int]) -> None:
    """Draw examples without end, in a process of its own."""
    cv2.setNumThreads(1)
    torch.set_num_threads(1)
    rng, network = np.random.default_rng(seed), SmearNetwork(threads=1)
    device = "cuda" if torch.cuda.is_available() else "cpu"
    while True:
        queue.put(example(rng, sources, size, network, device))


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


def loss_of(outputs: tuple[Tensor, Tensor], batch: dict[str, Tensor]) -> Tensor:
    """Return the loss of what is said of places (N, 5, h, w) and of the camera (N,)."""
    said, camera = (one.float() for one in outputs)
    weight = torch.where(batch["share"] > EDGE[0], 1.0, EDGE[1])
    smears = smear_loss(said[:, :4], compressed(batch["displacement"]), weight)
    moving = nnf.binary_cross_entropy_with_logits(said[:, 4], batch["moving"])
    moved = nnf.binary_cross_entropy_with_logits(camera, batch["camera"])
    return SMEAR_WEIGHT * smears + MOVING_WEIGHT * moving + CAMERA_WEIGHT * moved


def judged(odds: AnyArray, one: Example) -> tuple[str, float]:
    """Name and return the average precision of log-odds (h, w), or the false area where nothing moves."""
    moves, kind = one["moving"] > 0.5, KINDS[int(one["kind"])]
    if moves.any():
        return f"precision {kind}", average_precision(odds.ravel(), moves.ravel())
    return f"false {kind}", float((odds > 0).mean())


def means(rows: list[tuple[str, float]]) -> dict[str, float]:
    """Return the mean of the values of every name."""
    names = sorted({name for name, _ in rows})
    return {one: round(float(np.mean([value for name, value in rows if name == one])), 3) for one in names}


class Movers(Task):
    """The U-Net on examples of a queue."""

    def __init__(
        self, network: UNet, facts: dict[str, Any], queue: "Queue[Example]", batch: int, held: list[Example]
    ) -> None:
        super().__init__(network, facts)
        self.queue, self.batch, self.held = queue, batch, held
        self.device = next(network.parameters()).device

    def outputs(self, network: torch.nn.Module, batch: dict[str, Tensor]) -> tuple[Tensor, Tensor]:
        """Return what a network says of a batch."""
        with torch.autocast(self.device.type, torch.bfloat16, enabled=self.device.type == "cuda"):
            said: tuple[Tensor, Tensor] = network(batch["image"], batch["cells"])
        return said

    def loss(self, rng: np.random.Generator, step: int) -> Tensor:
        """Return the loss of the next examples."""
        rows = [self.queue.get() for _ in range(self.batch)]
        batch = {name: one.to(self.device) for name, one in batched(rows).items()}
        return loss_of(self.outputs(self.network, batch), batch)

    @torch.no_grad()
    def figures(self, network: torch.nn.Module) -> dict[str, Any]:
        """Return average precision by kind, false area where nothing moves, cameras judged rightly."""
        rows = []
        for one in self.held:
            batch = {name: value.to(self.device) for name, value in batched([one]).items()}
            said, camera = self.outputs(network, batch)
            rows.append(judged(said[0, 4].float().cpu().numpy(), one))
            rows.append(("camera", float((float(camera) > 0) == (one["camera"] > 0.5))))
        return means(rows)


def main(
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
    """Train on folders of photographs, on emoji and cut-outs of a folder, from weights if there are any."""
    sources, kept = split_sources(photographs, things)
    device = "cuda" if torch.cuda.is_available() else "cpu"
    network = UNet().to(device)
    if first is not None:
        network.load_state_dict(torch.load(first, map_location=device, weights_only=True)["unet"])
    size = side, side * 3 // 4 // 32 * 32
    rng, reader = np.random.default_rng([seed, 1]), SmearNetwork(threads=1)
    apart = [example(rng, kept, size, reader, device) for _ in range(held)]
    context = multiprocessing.get_context("spawn")
    queue = context.Queue(maxsize=4 * batch)
    drawing = [
        context.Process(target=draw_examples, args=(1000 * seed + k, queue, sources, size), daemon=True)
        for k in range(workers)
    ]
    for process in drawing:
        process.start()
    schedule = Schedule(
        out=out,
        steps=steps,
        rate=rate,
        largest_gradient=2.0,
        seed=seed,
        save_every=min(steps, 200),
        validate_every=min(steps, 200),
    )
    task = Movers(network, {"batch": batch, "seed": seed}, queue, batch, apart)  # type: ignore[arg-type]
    try:
        fit(task, schedule)
    finally:
        for process in drawing:
            process.terminate()
    state = torch.load(out / "last.pt", map_location="cpu", weights_only=True)
    save(out / "weights.pt", {"unet": state["average"], "step": state["step"]})


if __name__ == "__main__":
    run(main)
