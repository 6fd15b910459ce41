"""The paper's six losses (its Table 1) and its study of alpha, on the features of the network that ships.

    python -m tools.training.reader_data examples --photos FOLDER... --shards 24
    python -m tools.training.reader_data held --photos HELD... --first 900000 --shards 1 --rendered-share 0
    python -m tools.paper.losses examples --held held

trains a small network for every loss and seed (`VARIANTS`, `SEEDS`), all on the same examples and for as many
steps, and fills the tables of ``tools/results/paper.md``. Each training is kept in ``--work``: run again, the
tool goes on where it was.

For every cell of 32 px the network gives a vector v and w, and sigma = softplus(w). Against a true smear d
its loss is ``m L_R + ReLU((1 - m) / sigma^2 - alpha)``, m the cross-check map (without the map m = 1: ``L_R``
alone). L_R is the negative log likelihood of an isotropic normal error of deviation sigma between v and d:

- ``local``: the error is the smaller of v - d and v + d, anew for every smear;
- ``restricted``: v is compared with d turned to the right (u > 0, as Gong et al., CVPR 2017);
- ``double``: v is compared with d in double angle, |d| (cos 2 phi, sin 2 phi).

References
----------
Tran, Forssen and Viksten, Robust Fundamental Matrix Estimation from Single Image Motion Blur,
arXiv 2605.01552.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as nnf

from blur2view.smears.grid import from_double_angle
from blur2view.smears.likelihood import DIRECTIONS
from tools.arguments import Existing, Target, run
from tools.datasets.shards import Example, load_shards
from tools.evaluation.evaluate import Smears, smear_figures
from tools.pages import fill, table
from tools.training.reader import Reader, ReaderOptions, doubled
from tools.training.run import Schedule, Task, fit
from tools.training.train_reader import Batch, batch_of

Representation = Literal["local", "restricted", "double"]

LEAST_SIGMA_PX = 0.05  # added to softplus(w), so that the likelihood is bounded
START_SIGMA_PX = 8.0  # what softplus(w) is at first
CHANNELS, BATCH, RATE = 16, 8, 2e-3
SEEDS = (0, 1)
PAGE = Path(__file__).resolve().parents[1] / "results/paper.md"
MEASURES = {
    "epe_s_top50": "EPE-S top 50 %, px",
    "sparsification_area": "sparsification area",
    "direction_deg_top50": "direction top 50 %, deg",
}
"""Of all valid smears: EPE-S of the half of smaller sigmas; the area between the
sparsification curves; the direction's error of the surer half of the smears of at least 4 px."""


@dataclass(frozen=True, kw_only=True)
class Variant:
    """A loss: what v is, whether it knows the cross-check map, and the alpha of where the check fails."""

    representation: Representation = "double"
    cross_check: bool = True
    alpha: float = 0.01

    @property
    def name(self) -> str:
        """Name of the loss for people."""
        return f"{self.representation}, {'with' if self.cross_check else 'without'} map"


SIX = tuple(
    Variant(representation=representation, cross_check=check)
    for representation in ("local", "restricted", "double")
    for check in (False, True)
)
ALPHA_STUDY = tuple(Variant(alpha=alpha) for alpha in (0.005, 0.01, 0.02, 0.05))
VARIANTS = tuple(dict.fromkeys((*SIX, *ALPHA_STUDY)))
VERDICTS = "epe_s_top50", "sparsification_area"
BEST = Variant()  # the one that the paper found best


class SmearVectors(nn.Module):
    """The reader's layers that see a window and its neighbours, in two octaves; v and w of every cell."""

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
    return nnf.softplus(raw[..., 2]) + LEAST_SIGMA_PX


def squared_error(vector: Tensor, d: Tensor, representation: Representation) -> Tensor:
    """Return the squared error (...), px^2, of vectors (..., 2) against true smears (..., 2)."""
    if representation == "local":
        truth = torch.where((vector * d).sum(-1, keepdim=True) < 0, -d, d)
    elif representation == "restricted":  # upright ones point downward
        x, y = d[..., :1], d[..., 1:]
        truth = torch.where((x < 0) | ((x == 0) & (y < 0)), -d, d)
    else:  # the torch twin of `field.to_double_angle`
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
    """One loss, shards of examples to learn from, and those that the figures are of."""

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
        every = Smears(found=found, true=true, sigma=sigma, sure=sure)
        return {name: figure for name, figure in smear_figures(every).items() if name in MEASURES}


Found = dict[Variant, list[dict[str, float]]]
"""The figures of every seed."""


def variant_table(found: Found, variants: Sequence[Variant]) -> list[str]:
    """Return means and deviations over seeds as lines of Markdown."""
    rows = []
    for variant in variants:
        values = np.array([[one[name] for name in MEASURES] for one in found[variant]])
        pairs = zip(values.mean(axis=0), values.std(axis=0), strict=True)
        cells = (f"{mean:.3f} ± {deviation:.3f}" for mean, deviation in pairs)
        rows.append((variant.name, f"{variant.alpha:g}", len(values), *cells))
    return table(" | ".join(["loss", "alpha", "seeds", *MEASURES.values()]), rows)


def verdict(found: Found, measure: str) -> str:
    """Say which of the six is best by a measure, and whether it is the paper's."""
    values = {variant: [one[measure] for one in found[variant]] for variant in SIX}
    best, second = sorted(SIX, key=lambda variant: float(np.mean(values[variant])))[:2]
    mean, after = (float(np.mean(values[variant])) for variant in (best, second))
    within = "within" if after - mean <= np.std(values[best]) else "beyond"
    return (
        f"- Best of the six by {MEASURES[measure]}: {best.name} (in the paper: {BEST.name}), {mean:.3f}; "
        f"next {second.name}, {after:.3f}: {within} its deviation over seeds."
    )


def main(
    examples: Existing,
    *,
    held: Existing,
    work: Path = Path("runs/losses"),
    steps: int = 600,
    out: Target = PAGE,
) -> None:
    """Train what is missing, and write the page with its tables."""
    torch.set_num_threads(1)
    shards, others = load_shards(examples), load_shards(held)
    found: Found = {}
    for variant, seed in product(VARIANTS, SEEDS):
        torch.manual_seed(seed)
        schedule = Schedule(
            out=work / f"{variant.name}, alpha {variant.alpha:g}, seed {seed}", steps=steps, rate=RATE,
            largest_gradient=2.0, seed=seed, every=steps, warm_up=steps // 10,
        )  # fmt: skip
        found.setdefault(variant, []).append(fit(LossTask(variant, shards, others), schedule))
    parts = {
        "losses": [*variant_table(found, SIX), "", *(verdict(found, measure) for measure in VERDICTS)],
        "alpha": variant_table(found, ALPHA_STUDY),
    }
    fill(PAGE, parts, out)


if __name__ == "__main__":
    run(main)
