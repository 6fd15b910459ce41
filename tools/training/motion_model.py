"""The motion segmentation network: from a photograph and its smears to a logit per cell (torch)."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional as nnf

from blur2view.segmentation.features import CHANNELS
from tools.training.stem import LEVELS, STRIDE, LagStem, OrientedStem, StructureStem

DIRECTIONS = LagStem.directions
PLAIN, PAIRS = STRIDE * STRIDE, LEVELS * 2
"""Channels of the stem that are pixels, and double angles."""


@dataclass(frozen=True, kw_only=True)
class MotionOptions:
    """Size of the U-Net: channels at strides 4, 8, 16, 32 and residual blocks at the coarsest."""

    widths: tuple[int, ...] = (32, 48, 64, 96)
    bottom: int = 2

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for checkpoints."""
        return asdict(self)


def turned_angles(pairs: Tensor, frame: Tensor) -> Tensor:
    """Turn double angles (N, 2 C, h, w) so that the frame (N, 2, h, w), of length 1, becomes (1, 0)."""
    x, y = pairs[:, ::2], pairs[:, 1::2]
    cosine, sine = frame[:, :1], frame[:, 1:]
    return torch.cat([x * cosine + y * sine, y * cosine - x * sine], 1)


def turned_directions(values: Tensor, frame: Tensor) -> Tensor:
    """Read directional values (N, 8 C, h, w), directions running fastest, from the frame's direction on.

    Between the eight directions, 22.5 degrees apart, values are interpolated.
    """
    steps = torch.atan2(frame[:, 1:], frame[:, :1]) * (DIRECTIONS / (2 * torch.pi))  # of 22.5 degrees, in +-4
    turned = torch.zeros_like(values)
    for k in range(DIRECTIONS):
        distance = (steps - k + 1.5 * DIRECTIONS) % DIRECTIONS - 0.5 * DIRECTIONS
        weight = torch.clamp(1 - distance.abs(), min=0.0)
        turned = turned + weight * rolled(values, k)
    return turned


def rolled(values: Tensor, by: int) -> Tensor:
    """Start each group of eight channels at its channel ``by``."""
    if by == 0:
        return values
    groups = values.shape[1] // DIRECTIONS
    order = [g * DIRECTIONS + (k + by) % DIRECTIONS for g in range(groups) for k in range(DIRECTIONS)]
    return values[:, order]


class Block(nn.Module):
    """Two 3 x 3 convolutions with batch normalisation; the residual path starts at the input if `skip`."""

    def __init__(self, inputs: int, outputs: int, skip: bool = False) -> None:
        super().__init__()
        self.skip = skip
        self.first = nn.Conv2d(inputs, outputs, 3, padding=1, bias=False)
        self.second = nn.Conv2d(outputs, outputs, 3, padding=1, bias=False)
        self.norms = nn.ModuleList([nn.BatchNorm2d(outputs), nn.BatchNorm2d(outputs)])

    def forward(self, x: Tensor) -> Tensor:
        """Apply the block."""
        y = nnf.relu(self.norms[0](self.first(x)))
        return nnf.relu(self.norms[1](self.second(y)) + (x if self.skip else y))


class MotionUNet(nn.Module):
    """Tell cells that move by themselves.

    Everything that has a direction, in the photograph's fixed features as in the smears, is turned into the
    direction that the camera's motion predicts for the cell before anything is learned: across it, what is
    left of fine detail is the camera's blur; along it, another motion's.
    """

    multiple_of = 32  # of the photograph's sides: four levels from stride 4 on

    def __init__(self, options: MotionOptions | None = None) -> None:
        super().__init__()
        self.options = options or MotionOptions()
        widths = self.options.widths
        pairs = list(zip(widths[:-1], widths[1:], strict=True))
        self.stem = StructureStem()
        inputs = StructureStem.channels + 3 + CHANNELS - 1
        self.encoders = nn.ModuleList([Block(inputs, widths[0]), *(Block(*pair) for pair in pairs)])
        self.bottom = nn.Sequential(
            *[Block(widths[-1], widths[-1], skip=True) for _ in range(self.options.bottom)]
        )
        self.lifts = nn.ModuleList([nn.Conv2d(coarse, fine, 1) for fine, coarse in pairs])
        self.decoders = nn.ModuleList([Block(fine, fine, skip=True) for fine in widths[:-1]])
        self.head = nn.Conv2d(widths[0], 1, 1)
        self.head.bias = nn.Parameter(torch.tensor([-2.0]))  # few things move

    def forward(self, image: Tensor, features: Tensor) -> Tensor:
        """Return logits (N, 1, h, w) of RGB (N, 3, H, W) and features (N, CHANNELS, h, w)."""
        return self.body(self.inputs(image, features))

    def inputs(self, image: Tensor, features: Tensor) -> Tensor:
        """Compute what is learned from (N, C, h, w); it has no parameters."""
        predicted = features[:, :2]
        sharpness = torch.sqrt((predicted**2).sum(1, keepdim=True) + 1e-12)
        known = (sharpness > 1e-3).to(predicted.dtype)
        frame = known * predicted / sharpness + (1 - known) * torch.cat(
            [torch.ones_like(known), 0 * known], 1
        )
        stem = self.stem(image)
        plain, pairs, energies, directional = stem.split(
            [PLAIN, PAIRS, 2 * LEVELS - 1, LagStem.channels + OrientedStem.channels], 1
        )
        turned = turned_angles(pairs, frame), turned_directions(directional, frame)
        colour = nnf.avg_pool2d(image, STRIDE)
        return torch.cat([plain, energies, *turned, colour, sharpness, features[:, 2:]], 1)

    def body(self, x: Tensor) -> Tensor:
        """Run the U-Net."""
        skips = []
        for k, encoder in enumerate(self.encoders):
            x = encoder(x if k == 0 else nnf.max_pool2d(x, 2))
            skips.append(x)
        x = self.bottom(x)
        for k in reversed(range(len(self.decoders))):
            lifted = nnf.interpolate(self.lifts[k](x), scale_factor=2.0, mode="nearest")
            x = self.decoders[k](skips[k] + lifted)
        logits: Tensor = self.head(x)
        return logits
