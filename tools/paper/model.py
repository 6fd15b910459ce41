"""The smear network: a structure-tensor stem, a U-Net at stride 4 and factored heads (torch).

A plain U-Net on RGB does not start to learn; gradients' double-angle products as input,
and orientation, log length and uncertainty as separate outputs do, within minutes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional as nnf

from tools.paper.stem import StructureStem

MULTIPLE_OF = 16
"""Height and width of the input must be multiples of this."""


@dataclass(frozen=True, kw_only=True)
class ModelOptions:
    """Size of the U-Net.

    Attributes
    ----------
    widths : tuple of int
        Channels at strides 4, 8, 16.
    bottom : int
        Residual blocks at the coarsest level.
    """

    widths: tuple[int, ...] = (48, 80, 144)
    bottom: int = 3


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


class SmearUNet(nn.Module):
    """Turn RGB (N, 3, H, W) in [0, 1] into raw heads (N, 5, H/4, W/4).

    They are the double angle's x and y (any length), log(1 + length), log sigma and the log of the
    mean angular error in radians; see :func:`decode`. The coarsest level is at stride 16, so that what a
    pixel sees (about 130 px around it) fits into a training crop: with levels at strides 32 and 64 trained on
    128-px crops, lengths came out 2.3 times too long on 640x480 images (0.86 times on 128-px crops of the
    same), since there the deep levels meet no zero padding.
    """

    def __init__(self, options: ModelOptions | None = None) -> None:
        super().__init__()
        self.options = options or ModelOptions()
        widths = self.options.widths
        pairs = list(zip(widths[:-1], widths[1:], strict=True))
        self.stem = StructureStem()
        first = Block(StructureStem.channels, widths[0])
        self.encoders = nn.ModuleList([first, *(Block(fine, coarse) for fine, coarse in pairs)])
        bottom = [Block(widths[-1], widths[-1], skip=True) for _ in range(self.options.bottom)]
        self.bottom = nn.Sequential(*bottom)
        self.lifts = nn.ModuleList([nn.Conv2d(coarse, fine, 1) for fine, coarse in pairs])
        self.decoders = nn.ModuleList([Block(fine, fine, skip=True) for fine in widths[:-1]])
        self.head = nn.Conv2d(widths[0], 5, 1)
        self.head.bias = nn.Parameter(torch.tensor([0.0, 0.0, 2.0, 1.0, -1.0]))  # 6 px long, 3 px uncertain

    def forward(self, image: Tensor) -> Tensor:
        """Compute the raw heads; height and width must be multiples of 16."""
        return self.body(self.stem(image))

    def body(self, features: Tensor) -> Tensor:
        """Run the U-Net and heads on the stem's features (the part that may run in bfloat16)."""
        x, skips = features, []
        for k, encoder in enumerate(self.encoders):
            x = encoder(x if k == 0 else nnf.max_pool2d(x, 2))
            skips.append(x)
        x = self.bottom(x)
        for k in reversed(range(len(self.decoders))):
            lifted = nnf.interpolate(self.lifts[k](x), scale_factor=2.0, mode="nearest")
            x = self.decoders[k](skips[k] + lifted)
        heads: Tensor = self.head(x)
        return heads


def decode(raw: Tensor) -> Tensor:
    """Turn raw heads (N, 5, h, w) into the output (N, 4, h, w).

    It is |d| cos 2phi, |d| sin 2phi, sigma of d, in px, and sigma of phi in radians. The sigmas are root mean
    squares of errors with the mean and the exponential law of the loss.
    """
    direction = raw[:, :2] / torch.sqrt((raw[:, :2] ** 2).sum(1, keepdim=True) + 1e-4)
    length = torch.clamp(torch.exp(torch.clamp(raw[:, 2:3], 0.0, 5.5)) - 1, min=0.0)
    mean_error = torch.exp(torch.clamp(raw[:, 3:4], -3.0, 4.5))  # what the Laplace likelihood fits
    mean_angle = torch.exp(torch.clamp(raw[:, 4:5], -5.0, 0.5))
    return torch.cat([direction * length, math.sqrt(2) * mean_error, math.sqrt(2) * mean_angle], 1)
