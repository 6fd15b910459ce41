"""Train a network that ships, on scenes that other processes draw meanwhile; a stopped run goes on.

    python -m tools.training.train smear PHOTOGRAPHS --out runs/smear --first models/smear.onnx
    python -m tools.training.train unet PHOTOGRAPHS --out runs/unet --things CUTOUTS --first weights.pt
    python -m tools.training.train blur PHOTOGRAPHS --out runs/blur

They write ``last.pt``, which `tools.training.export` exports as smear.onnx, unet.onnx or movers.onnx, and
``log.jsonl``. ``--first`` starts from a checkpoint or, of the smear network, an exported file. No picture is
seen twice; every seventh photograph and thing is held out for the figures. ``--steps 2 --batch 2 --side 128
--workers 1 --held 1`` tries a training on a processor; it runs on a GPU, if there is one.
"""

import copy
import json
import math
import os
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from torch import Tensor, nn

from blur2view.errors import ModelError
from blur2view.networks.spectra import STEP
from blur2view.smears.grid import from_double_angle
from blur2view.smears.likelihood import read_smears
from tools.command import Existing, run
from tools.evaluation.evaluate import Smears, smear_figures
from tools.metrics import DIRECTION_MIN_PX, average_precision
from tools.rendering.layer_scenes import KINDS
from tools.training.examples import Batch, Drawing, Which, split_sources
from tools.training.export import load_average
from tools.training.mover_networks import BlurNet, UNet, mover_loss
from tools.training.reader import Circular, Reader, kind_target, losses_of

AVERAGED = 500
"""Steps over which the weights that ship are averaged."""
COARSE_WEIGHT = 0.3
"""Weight of the smaller octaves' own losses."""
LONGEST_PX = 60.0
"""Smears up to this length count in the figures: two octaves read up to 76 px."""
SMEAR_FIGURES = "direction_deg", "direction_deg_top50", "length_ratio", "length_spread"
WEIGHTS = "network."
"""Prefix of the names of the weights in an exported file."""
ROUNDED_PARTS = "quantized", "scale", "zero_point"
"""Parts of a matrix that the export rounded to integers."""

Figures = dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class Schedule:
    """How a training runs: its folder, steps, peak rate, steps between checkpoints with figures."""

    out: Path
    steps: int
    rate: float
    every: int
    max_gradient: float = 2.0
    warm_up: int = 200

    def rate_at(self, step: int) -> float:
        """Return a step's learning rate: to the peak in ``warm_up`` steps, then by a cosine to 1 % of it."""
        warm = min(1.0, (step + 1) / max(1, self.warm_up))
        return self.rate * warm * (0.01 + 0.495 * (1 + math.cos(math.pi * step / self.steps)))


def fit(
    network: nn.Module,
    batches: Callable[[int], Iterator[Batch]],
    loss_of: Callable[[nn.Module, Batch], Tensor],
    figures_of: Callable[[nn.Module], Figures],
    s: Schedule,
    facts: dict[str, Any],
) -> Figures:
    """Train to the schedule's end and return the figures of the moving average of the weights, which ships.

    ``batches(k)`` yields those of steps k and later. ``last.pt``, with the ``facts``, stays fresh; figures
    are printed and lines of ``log.jsonl``.
    """
    s.out.mkdir(parents=True, exist_ok=True)
    checkpoint, average = s.out / "last.pt", copy.deepcopy(network)
    optimiser = torch.optim.AdamW(network.parameters(), weight_decay=1e-4)
    parts: dict[str, Any] = {"network": network, "average": average, "optimiser": optimiser}
    step, figures, losses = 0, Figures(), list[float]()
    if checkpoint.exists():
        state: dict[str, Any] = torch.load(checkpoint, map_location="cpu", weights_only=True)
        for name, part in parts.items():
            part.load_state_dict(state[name])
        step, figures = state["step"], state["figures"]
    for batch in islice(batches(step), max(s.steps - step, 0)):
        network.train()
        for group in optimiser.param_groups:
            group["lr"] = s.rate_at(step)
        optimiser.zero_grad(set_to_none=True)
        loss = loss_of(network, batch)
        torch.autograd.backward(loss)
        nn.utils.clip_grad_norm_(network.parameters(), s.max_gradient)
        optimiser.step()
        step += 1
        follow(average, network, min(1 - 1 / AVERAGED, (1 + step) / (10 + step)))
        losses.append(float(loss.detach()))
        if step == s.steps or step % s.every == 0:
            figures = figures_of(average.eval())
            line = json.dumps({"step": step, "loss": round(float(np.mean(losses)), 4), **figures})
            print(line, flush=True)
            with (s.out / "log.jsonl").open("a") as file:
                file.write(line + "\n")
            losses = []
            stored = {name: part.state_dict() for name, part in parts.items()}
            save(checkpoint, stored | {"step": step, "figures": figures} | facts)
    return figures


def save(path: Path, state: dict[str, Any]) -> None:
    """Write a checkpoint; a run killed meanwhile keeps the one before."""
    temporary = path.with_suffix(".tmp")
    torch.save(state, temporary)
    temporary.replace(path)


@torch.no_grad()
def follow(average: nn.Module, network: nn.Module, decay: float) -> None:
    """Move the exponential average of weights and statistics."""
    for mean, value in zip(average.state_dict().values(), network.state_dict().values(), strict=True):
        if mean.dtype.is_floating_point:
            mean.lerp_(value, 1 - decay)
        else:
            mean.copy_(value)


def smear_loss_of(network: nn.Module, batch: Batch) -> Tensor:
    """Return the loss of all octaves of a batch."""
    (fine, *smaller), _ = losses_of(network, batch, half=True)
    return fine + COARSE_WEIGHT * torch.stack(smaller).sum()


@torch.no_grad()
def smear_figures_of(network: nn.Module, held: list[Batch]) -> Figures:
    """Return the loss on held-out batches, and the errors of all smears and the certain half."""
    losses, parts, kinds = [], [], []
    for batch in held:
        (loss, *_), (logits, _, kind) = losses_of(network, batch, half=False)
        losses.append(float(loss))
        right = kind_target(batch["d0"], batch["r0"], batch["t0"])
        kinds.append(float(right.gather(-1, kind.argmax(-1, keepdim=True)).mean()))
        read = read_smears(logits.flatten(0, 1).numpy()).reshape(*logits.shape[:3], 4)
        true = batch["d0"].numpy().mean(-2)
        length = np.linalg.norm(true, axis=-1)
        keep = (batch["v0"].numpy().min(-1) > 0) & (length >= DIRECTION_MIN_PX) & (length < LONGEST_PX)
        parts.append((read[keep], true[keep]))
    cells, true = (np.concatenate(part) for part in zip(*parts, strict=True))
    sure = cells[:, 3] <= np.median(cells[:, 3])
    every = Smears(found=from_double_angle(cells[:, :2]), true=true, sigma=cells[:, 2], sure=sure)
    figures = {name: figure for name, figure in smear_figures(every).items() if name in SMEAR_FIGURES}
    return {"held_loss": float(np.mean(losses)), **figures, "kinds_right": float(np.mean(kinds))}


def outputs_of(network: nn.Module, batch: Batch) -> tuple[Any, Batch]:
    """Return the outputs of a mover network, and the batch on its device."""
    device = next(network.parameters()).device
    batch = {name: one.to(device) for name, one in batch.items()}
    fine = batch["image"] if "image" in batch else batch["blocks"]
    with torch.autocast(device.type, torch.bfloat16, enabled=device.type == "cuda"):
        return network(fine, batch["cells"]), batch


def mover_loss_of(network: nn.Module, batch: Batch) -> Tensor:
    """Return the loss of a batch."""
    return mover_loss(*outputs_of(network, batch))


@torch.no_grad()
def mover_figures_of(network: nn.Module, held: list[Batch]) -> Figures:
    """Return means by kind: average precision, false area where nothing moves, cameras judged rightly."""
    rows: dict[str, list[float]] = {}
    for batch in held:
        outputs, _ = outputs_of(network, batch)
        log_odds = outputs[0][:, 4] if isinstance(outputs, tuple) else outputs[:, 0]
        rows_of = log_odds.float().cpu().numpy(), batch["moving"].numpy() > 0.5, batch["kind"]
        for odds, moves, kind in zip(*rows_of, strict=True):
            if moves.any():
                name, value = "precision", average_precision(odds.ravel(), moves.ravel())
            else:
                name, value = "false", float((odds > 0).mean())
            rows.setdefault(f"{name} {KINDS[int(kind)]}", []).append(value)
        if isinstance(outputs, tuple):
            right = (outputs[1].cpu() > 0) == (batch["camera"] > 0.5)
            rows.setdefault("camera", []).extend(right.float().tolist())
    return {name: round(float(np.mean(values)), 3) for name, values in sorted(rows.items())}


def first_weights(path: Path, network: nn.Module) -> dict[str, Tensor]:
    """Return the weights of a checkpoint or of an exported smear network; ModelError if a file holds none.

    Those that the export rounded to 8 bits are rounded still.
    """
    if path.suffix != ".onnx":
        averaged: dict[str, Tensor] = load_average(path)["average"]
        return averaged
    stored = {
        tensor.name.removeprefix(WEIGHTS): torch.from_numpy(onnx.numpy_helper.to_array(tensor).copy())
        for tensor in onnx.load(path).graph.initializer
        if tensor.name.startswith(WEIGHTS)
    }
    for name, layer in network.named_modules():
        if isinstance(layer, Circular) and f"{name}.matrix_quantized" in stored:
            whole, scale, _ = (stored.pop(f"{name}.matrix_{part}") for part in ROUNDED_PARTS)
            stored[f"{name}.weight"] = layer.weight_of(whole * scale)
    if not stored:
        raise ModelError(f"{path}: holds no weights to train on from; use a file of tools.training.export")
    return stored


def main(
    which: Which,
    photographs: list[Existing],
    *,
    out: Path,
    things: Existing | None = None,
    first: Existing | None = None,
    steps: int = 4000,
    batch: int = 16,
    side: int = 512,
    workers: int = max(1, (os.cpu_count() or 1) - 1),
    rate: float = 2e-3,
    max_gradient: float = 2.0,
    held: int = 8,
    every: int = 200,
    seed: int = 0,
) -> None:
    """Train; ``held`` batches are of the held-out sources, ``side`` is the width of movers' pictures."""
    torch.manual_seed(seed)
    device = "cuda" if torch.cuda.is_available() and which != "smear" else "cpu"
    network: nn.Module = {"smear": Reader, "unet": UNet, "blur": BlurNet}[which]()
    size = None if which == "smear" else (side, side * 3 // 4 // STEP * STEP)
    sources, kept = split_sources(photographs, things)
    drawing = partial(Drawing, which=which, count=batch, size=size, seed=seed, device=device)
    apart = [drawing(sources=kept)[k] for k in range(held)]
    facts: dict[str, Any] = {"batch": batch, "seed": seed}
    if first is not None:
        try:
            network.load_state_dict(first_weights(first, network))
        except ModelError as error:
            raise SystemExit(str(error)) from None
    if isinstance(network, Reader):
        torch.set_num_threads(1)  # two processes do more than two threads
        facts["widths"] = asdict(network.options)
    loss_of, figures_of = (
        (smear_loss_of, smear_figures_of) if which == "smear" else (mover_loss_of, mover_figures_of)
    )
    schedule = Schedule(out=out, steps=steps, rate=rate, every=min(every, steps), max_gradient=max_gradient)
    batches = partial(drawing(sources=sources).batches, steps=steps, workers=workers)
    fit(network.to(device), batches, loss_of, partial(figures_of, held=apart), schedule, facts)


if __name__ == "__main__":
    run(main)
