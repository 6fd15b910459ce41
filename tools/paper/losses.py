"""The paper's six losses (its Table 1) and its study of alpha, on the features of the network that ships.

    python -m tools.paper.losses PHOTOGRAPHS

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

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import product
from pathlib import Path
from typing import Literal, NamedTuple, get_args

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as nnf

from blur2view.arrays import AnyArray
from blur2view.smears.grid import from_double_angle
from blur2view.smears.likelihood import DIRECTIONS
from tools.command import Existing, Target, publish, run, table
from tools.evaluation.evaluate import Smears, smear_figures
from tools.training.examples import SMALLEST, Batch, Drawing, split_sources
from tools.training.reader import Reader, ReaderOptions, doubled
from tools.training.train import Schedule, fit

Representation = Literal["local", "restricted", "double"]

MIN_SIGMA_PX = 0.05  # added to softplus(w), so that the likelihood is bounded
START_SIGMA_PX = 8.0  # what softplus(w) is at first
CHANNELS, BATCH, RATE = 16, 8, 2e-3
BATCHES, HELD = 256, 16  # that are drawn
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


@torch.no_grad()
def figures_of(network: nn.Module, held: Sequence[Batch], representation: Representation) -> dict[str, float]:
    """Return the MEASURES of a network on all valid smears of held-out batches."""
    parts = []
    for batch in held:
        raw, smears, seen = network(batch), batch["d0"].numpy(), batch["v0"].numpy() > 0
        v = raw[..., :2].numpy()
        found = from_double_angle(v) if representation == "double" else v
        sigma = sigma_of(raw).numpy()[..., None]
        each = np.broadcast_to(found[..., None, :], smears.shape), smears, np.broadcast_to(sigma, seen.shape)
        parts.append([one[seen] for one in each])
    found, true, sigma = (np.concatenate(part) for part in zip(*parts, strict=True))
    sure = sigma <= np.quantile(sigma, 0.5, method="lower")
    figures = smear_figures(Smears(found=found, true=true, sigma=sigma, sure=sure))
    return {name: figures[name] for name in MEASURES}


def in_order(examples: Sequence[Batch], order: AnyArray, first: int) -> Iterator[Batch]:
    """Yield examples in an order, from its number ``first`` on."""
    return (examples[k] for k in order[first:])


def trained(
    variant: Variant, examples: Sequence[Batch], held: Sequence[Batch], work: Path, steps: int
) -> list[str]:
    """Return the row of a loss: means and deviations over seeds."""
    rows = []
    for seed in SEEDS:
        torch.manual_seed(seed)
        schedule = Schedule(
            out=work / f"{variant.name}, alpha {variant.alpha:g}, seed {seed}", steps=steps, rate=RATE,
            every=steps, warm_up=steps // 10,
        )  # fmt: skip
        figures = fit(
            SmearVectors(),
            partial(in_order, examples, np.random.default_rng(seed).integers(len(examples), size=steps)),
            lambda network, batch: paper_loss(network(batch), batch["d0"], batch["v0"], variant),
            lambda network: figures_of(network, held, variant.representation),
            schedule,
            {"loss": variant.name, "alpha": variant.alpha},
        )
        rows.append([figures[name] for name in MEASURES])
    cells = (f"{np.mean(one):.3f} ± {np.std(one):.3f}" for one in zip(*rows, strict=True))
    return [variant.name, f"{variant.alpha:g}", str(len(SEEDS)), *cells]


def main(
    photographs: list[Existing],
    *,
    work: Path = Path("runs/losses"),
    steps: int = 600,
    out: Target | None = None,
) -> None:
    """Draw examples and train what ``work`` lacks, and write the table."""
    torch.set_num_threads(1)
    drawn = work / "examples.pt"
    if not drawn.exists():
        work.mkdir(parents=True, exist_ok=True)
        pairs = zip(split_sources(photographs), (BATCHES, HELD), strict=True)
        drawings = ((Drawing(which="smear", sources=s, count=BATCH, size=SMALLEST), n) for s, n in pairs)
        torch.save([[drawing[k] for k in range(n)] for drawing, n in drawings], drawn)
    examples, held = torch.load(drawn, weights_only=True)
    publish(out, table(HEAD, [trained(variant, examples, held, work, steps) for variant in VARIANTS]))


if __name__ == "__main__":
    run(main)
