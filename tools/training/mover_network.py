"""Torch's twin of `blur2view.segmentation.decoder`, to be fitted; the weights keep its names."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from blur2view.arrays import AnyArray
from blur2view.segmentation.decoder import DILATIONS, GUESSED, Decoder

CELLS, FINE, WIDE, DROPOUT = 32, 24, 20, 0.15
SPECTRA_DROPOUT = 0.15  # of all spectra of a scene
LENGTHS_PX = np.array([1.0, 3.0, 7.0, 14.0, 28.0, 56.0])
SECTORS = 8  # of guessed smears' directions, the first the camera's
CLASSES = 1 + (len(LENGTHS_PX) - 1) * SECTORS  # the shortest have no direction


class Network(nn.Module):
    """The decoder; ``standards`` are means and deviations of the evidence of half cells and of quarters."""

    def __init__(self, standards: Sequence[tuple[AnyArray, AnyArray]], cell_evidence: int) -> None:
        super().__init__()
        self.standards, self.cell_evidence = standards, cell_evidence
        halves, quarters = (len(mean) for mean, _ in standards)
        sizes = {
            "halves": (halves, CELLS, 1),
            "beside": (CELLS, CELLS, 3),
            "quarters": (quarters, FINE, 1),
            "down": (CELLS, FINE, 1),
            "fine1": (FINE, FINE, 3),
            "fine2": (FINE, FINE, 3),
            "smear": (FINE, CLASSES, 1),
            "evidence": (halves, WIDE, 1),
            "joined": (CELLS + FINE + CLASSES, WIDE, 1),
            **dict.fromkeys(DILATIONS, (WIDE, WIDE, 3)),
            "moves": (WIDE, 2, 1),
            "back": (WIDE, FINE, 1),
            "last": (FINE, FINE, 3),
            "outline": (FINE, 2, 1),
        }
        self.layers = nn.ModuleDict(
            {name: nn.Conv2d(*size, dilation=DILATIONS.get(name, 1)) for name, size in sizes.items()}
        )
        self.dropout = nn.Dropout2d(DROPOUT)

    def forward(self, halves: Tensor, quarters: Tensor) -> tuple[Tensor, Tensor]:
        """Return log-odds (N, 2, 2h, 2w) and those of smears' classes, of (N, K, h, w) and (N, L, 2h, 2w)."""
        halves, quarters = (
            (x - torch.tensor(mean, dtype=x.dtype)[:, None, None])
            / torch.tensor(scale, dtype=x.dtype)[:, None, None]
            for x, (mean, scale) in zip((halves, quarters), self.standards, strict=True)
        )
        if self.training:
            kept = (torch.rand(len(halves), 1, 1, 1) > SPECTRA_DROPOUT).to(halves.dtype)
            halves = torch.cat([halves[:, : self.cell_evidence], kept * halves[:, self.cell_evidence :]], 1)
        cells = self.dropout(functional.relu(self._layer("halves", halves)))
        cells = cells + functional.relu(self._layer("beside", cells))
        fine = functional.relu(self._layer("quarters", quarters) + _doubled(self._layer("down", cells)))
        for name in ("fine1", "fine2"):
            fine = fine + functional.relu(self._layer(name, fine))
        smear = self._layer("smear", fine)
        pooled = [functional.avg_pool2d(x, 2) for x in (fine, GUESSED * torch.softmax(smear, 1))]
        joined = self._layer("joined", torch.cat([cells, *pooled], 1))
        wide = self.dropout(functional.relu(self._layer("evidence", halves) + joined))
        for name in DILATIONS:
            wide = functional.relu(self._layer(name, wide))
        last = functional.relu(fine + _doubled(self._layer("back", wide)))
        outline = self._layer("outline", functional.relu(self._layer("last", last)))
        return outline + _doubled(self._layer("moves", wide)), smear

    def _layer(self, name: str, x: Tensor) -> Tensor:
        layer = self.layers[name]
        assert isinstance(layer, nn.Conv2d)
        if layer.kernel_size[0] > 1:
            margin = DILATIONS.get(name, 1)
            x = functional.pad(x, (margin,) * 4, mode="replicate")
        return layer(x)  # type: ignore[no-any-return]

    def coefficients(self) -> dict[str, Any]:
        """Return them by the names that `Decoder.read` looks for."""
        found: dict[str, Any] = {}
        for grid, (mean, scale) in zip(("halves", "quarters"), self.standards, strict=True):
            found |= {f"mean_{grid}": mean.astype(np.float32), f"scale_{grid}": scale.astype(np.float32)}
        for name, tensor in self.layers.state_dict().items():
            layer, kind = name.split(".")
            found[f"{kind}_{layer}"] = tensor.numpy()
        return found


def _doubled(x: Tensor) -> Tensor:
    return functional.interpolate(x, scale_factor=2, mode="bilinear", align_corners=False)


def difference(network: Network, decoder: Decoder, halves: AnyArray, quarters: AnyArray) -> float:
    """Return the largest difference of log-odds between torch and NumPy on one scene's evidence."""
    network.eval()
    with torch.no_grad():
        theirs, _ = network(*(torch.from_numpy(x).permute(2, 0, 1)[None] for x in (halves, quarters)))
    ours = np.stack(decoder.log_odds(halves, quarters))
    return float(np.abs(ours - theirs[0].numpy()).max())


def smear_classes(displacement: AnyArray, camera: AnyArray) -> AnyArray:
    """Return the shares (h, w, CLASSES) of smears (h, w, 2), pixels, in the classes that the decoder guesses.

    By length and by direction from the camera's (h, w, 2); neighbouring classes share a smear linearly.
    """
    length = np.linalg.norm(displacement, axis=-1)
    one, other = (np.arctan2(d[..., 1], d[..., 0]) for d in (displacement, camera))
    place = np.interp(np.log(np.maximum(length, 0.5)), np.log(LENGTHS_PX), np.arange(len(LENGTHS_PX)))
    turn = (one - other) % np.pi / np.pi * SECTORS
    shares = np.zeros((*length.shape, len(LENGTHS_PX), SECTORS), np.float32)
    rows, columns = np.indices(length.shape)
    lower = np.minimum(place.astype(int), len(LENGTHS_PX) - 2)
    first = np.floor(turn).astype(int)
    for k, share in ((0, 1 - (place - lower)), (1, place - lower)):
        for m, part in ((0, 1 - (turn - first)), (1, turn - first)):
            np.add.at(shares, (rows, columns, lower + k, (first + m) % SECTORS), share * part)
    shortest = shares[..., 0, :].sum(axis=-1, keepdims=True)
    return np.concatenate([shortest, shares[..., 1:, :].reshape(*length.shape, -1)], axis=-1)
