"""Options and batches of the trainings of the paper's variants: crops of rendered scenes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from torch import Tensor
from torch.utils.data import DataLoader

from tools.datasets.shards import Scenes
from tools.paper.crops import CropStream
from tools.paper.model import MULTIPLE_OF


@dataclass(frozen=True, kw_only=True)
class TrainOptions:
    """One training run on crops.

    Attributes
    ----------
    train, val, out : Path
        Folders of rendered shards, and of checkpoints and results.
    steps : int
        Length of the whole run.
    batch, side : int
        Crops a step and their side in pixels (a multiple of 16).
    learning_rate : float
        Peak of the schedule (AdamW).
    seed : int
        Decides the initial weights and every crop.
    workers : int
        Processes that make crops; with 0 the training process makes them itself.
    save_every : int
        Steps between checkpoints.

    Raises
    ------
    ValueError
        If `side` is not a positive multiple of 16.
    """

    train: Path
    val: Path
    out: Path
    steps: int = 30000
    batch: int = 12
    side: int = 192
    learning_rate: float = 2e-3
    seed: int = 0
    workers: int = 1
    save_every: int = 250

    def __post_init__(self) -> None:
        """Check the size of crops."""
        if self.side <= 0 or self.side % MULTIPLE_OF:
            raise ValueError(f"side must be a positive multiple of {MULTIPLE_OF}, got {self.side}")


def batches_of(scenes: Scenes, options: TrainOptions, first: int) -> Iterator[tuple[Tensor, Tensor]]:
    """Yield batches from number `first` on, made by `workers` processes."""
    stream = CropStream(scenes, options.seed, options.batch, options.side, first=first)
    ahead = 4 if options.workers else None
    return iter(DataLoader(stream, batch_size=None, num_workers=options.workers, prefetch_factor=ahead))
