"""The paper's six losses (its Table 1) and its study of alpha, on the features of the network that ships.

    python -m tools.training.reader_data examples --photos FOLDER... --shards 24
    python -m tools.training.reader_data held --photos HELD... --first 900000 --shards 1
    python -m tools.paper.losses examples --held held

trains a small network for every loss and seed (`VARIANTS`, `SEEDS`), all on the same examples and for as many
steps; with ``--out tools/results/paper.md`` it fills that page's table. ``--work`` keeps every training: run
again, the tool goes on where it was.

For every cell of 32 px the network gives a vector v and w, and sigma = softplus(w). Against a true smear d
its loss is ``m L_R + ReLU((1 - m) / sigma^2 - alpha)``, m the cross-check map (without the map m = 1: ``L_R``
alone). L_R is the negative log likelihood of an isotropic normal error of deviation sigma between v and d:

- ``local``: the error is the smaller of v - d and v + d, anew for every smear;
- ``restricted``: v is compared with d turned to the right (u > 0, as Gong et al., CVPR 2017);
- ``double``: v is compared with d in double angle, |d| (cos 2 phi, sin 2 phi).

The paper: Tran, Forssen and Viksten, Robust Fundamental Matrix Estimation from Single Image Motion Blur,
arXiv 2605.01552.
"""

from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Literal, NamedTuple, get_args

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as nnf

from blur2view.smears.grid import from_double_angle
from blur2view.smears.likelihood import DIRECTIONS
from tools.command import Existing, Target, publish, run, table
from tools.datasets.shards import Example, load_shards
from tools.evaluation.evaluate import Smears, smear_figures
from tools.training.reader import Reader, ReaderOptions, doubled
from tools.training.run import Schedule, Task, fit
from tools.training.train_reader import Batch, batch_of

Representation = Literal["local", "restricted", "double"]

MIN_SIGMA_PX = 0.05  # added to softplus(w), so that the likelihood is bounded
START_SIGMA_PX = 8.0  # what softplus(w) is at first
CHANNELS, BATCH, RATE = 16, 8, 2e-3
SEEDS = (0, 1)
MEASURES = ("epe_s_top50", "sparsification_area", "direction_deg_top50")
HEAD = "loss | alpha | seeds | EPE-S top 50 %, px | sparsification area | direction top 50 %, deg"


class Variant(NamedTuple):
    """A loss: what v means, whether it uses the cross-check map, and its alpha."""

    representation: Representation = "double"
    cross_check: bool = True
    alpha: float = 0.01

    @property
    def name(self) -> str:
        """Name of the loss for people."""
        return f"{self.representation}, {'with' if self.cross_check else 'without'} map"


SIX = [Variant(*one) for one in product(get_args(Representation), (False, True))]
VARIANTS = (*SIX, *(Variant(alpha=alpha) for alpha in (0.005, 0.02, 0.05)))


class SmearVectors(nn.Module):
    """The smear network's first layers, a window and its neighbours in two octaves; v and w of every cell."""

    def __init__(self) -> None:
        super().__init__()
        self.reader = Reader(ReaderOptions(window=CHANNELS, region=CHANNELS, round=CHANNELS))
        self.head = nn.Linear(2 * DIRECTIONS * CHANNELS, 3)
        with torch.no_grad():  # at first: no smear, known to START_SIGMA_PX
            self.head.weight.mul_(0.1)
            self.head.bias.copy_(torch.tensor([0.0, 0.0, START_SIGMA_PX]))

    def forward(self, batch: Batch) -> Tensor:
        """Return v and w (N, h, w, 3), px, of the features of a batch."""
        own, smaller = (self.reader.windows(batch[f"C{k}"], batch[f"s{k}"]) for k in range(2))
        both = torch.cat([own, doubled(smaller, own.shape[1:3])], -1)
        vectors: Tensor = self.head(both.flatten(-2))
        return vectors


def sigma_of(raw: Tensor) -> Tensor:
    """Return sigma (...), px, of v and w (..., 3)."""
    return nnf.softplus(raw[..., 2]) + MIN_SIGMA_PX


def squared_error(vector: Tensor, d: Tensor, representation: Representation) -> Tensor:
    """Return the squared error (...), px^2, of vectors (..., 2) against true smears (..., 2)."""
    if representation == "local":
        truth = torch.where((vector * d).sum(-1, keepdim=True) < 0, -d, d)
    elif representation == "restricted":  # upright ones point downward
        x, y = d[..., :1], d[..., 1:]
        truth = torch.where((x < 0) | ((x == 0) & (y < 0)), -d, d)
    else:  # the torch twin of `blur2view.smears.grid.to_double_angle`
        x, y = d[..., 0], d[..., 1]
        length = torch.sqrt(x * x + y * y + 1e-12)
        truth = torch.stack([x * x - y * y, 2 * x * y], -1) / length[..., None]
    return ((vector - truth) ** 2).sum(-1)


def paper_loss(raw: Tensor, d: Tensor, valid: Tensor, variant: Variant) -> Tensor:
    """Return the mean loss, a scalar, of v and w (..., 3) against smears (..., S, 2) in the cell of each.

    ``valid`` (..., S) is the cross-check map, 0 or 1; alpha is what 1 / sigma^2 may be where it is 0.
    """
    sigma = sigma_of(raw)[..., None]
    error = squared_error(raw[..., None, :2], d, variant.representation)
    likelihood = error / (2 * sigma**2) + 2 * torch.log(sigma)
    if not variant.cross_check:
        return likelihood.mean()
    return (valid * likelihood + torch.relu((1 - valid) / sigma**2 - variant.alpha)).mean()


class LossTask(Task):
    """Training with one loss on shards of examples; its figures are of the held-out shards."""

    def __init__(self, variant: Variant, shards: Sequence[Example], held: Sequence[Example]) -> None:
        super().__init__(SmearVectors(), {"loss": variant.name, "alpha": variant.alpha})
        self.variant, self.shards, self.held = variant, list(shards), held

    def loss(self, rng: np.random.Generator, step: int) -> Tensor:
        """Return the loss of a batch."""
        batch = batch_of(self.shards[int(rng.integers(len(self.shards)))], rng, BATCH)
        return paper_loss(self.network(batch), batch["d0"], batch["v0"], self.variant)

    @torch.no_grad()
    def figures(self, network: nn.Module) -> dict[str, float]:
        """Return the MEASURES of a network on all valid smears of the held-out shards."""
        parts = []
        for shard in self.held:
            batch = {key: torch.from_numpy(array).float() for key, array in shard.items()}
            raw, seen = network(batch), shard["v0"] > 0
            v = raw[..., :2].numpy()
            found = from_double_angle(v) if self.variant.representation == "double" else v
            smears = np.broadcast_to(found[..., None, :], shard["d0"].shape)[seen]
            sigma = np.broadcast_to(sigma_of(raw).numpy()[..., None], seen.shape)[seen]
            parts.append((smears, shard["d0"][seen].astype(np.float32), sigma))
        found, true, sigma = (np.concatenate(part) for part in zip(*parts, strict=True))
        sure = sigma <= np.quantile(sigma, 0.5, method="lower")
        figures = smear_figures(Smears(found=found, true=true, sigma=sigma, sure=sure))
        return {name: figures[name] for name in MEASURES}


def trained(
    variant: Variant, shards: Sequence[Example], held: Sequence[Example], work: Path, steps: int
) -> list[str]:
    """Return the row of a loss: means and deviations over seeds."""
    found = []
    for seed in SEEDS:
        torch.manual_seed(seed)
        schedule = Schedule(
            out=work / f"{variant.name}, alpha {variant.alpha:g}, seed {seed}", steps=steps, rate=RATE,
            largest_gradient=2.0, seed=seed, every=steps, warm_up=steps // 10,
        )  # fmt: skip
        figures = fit(LossTask(variant, shards, held), schedule)
        found.append([figures[name] for name in MEASURES])
    cells = (f"{np.mean(one):.3f} ± {np.std(one):.3f}" for one in zip(*found, strict=True))
    return [variant.name, f"{variant.alpha:g}", str(len(SEEDS)), *cells]


def main(
    examples: Existing,
    *,
    held: Existing,
    work: Path = Path("runs/losses"),
    steps: int = 600,
    out: Target | None = None,
) -> None:
    """Train what ``work`` lacks, and write the table."""
    torch.set_num_threads(1)
    shards, others = load_shards(examples), load_shards(held)
    rows = [trained(variant, shards, others, work, steps) for variant in VARIANTS]
    publish(out, table(HEAD, rows))


if __name__ == "__main__":
    run(main)
