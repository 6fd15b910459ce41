"""Networks of the paper's experiments: the plain U-Net on RGB, and ours with the paper's three outputs."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as nnf

from tools.paper.model import SmearUNet
from tools.paper.stem import STRIDE

START_SIGMA = 8.0
"""What softplus(w) is at first, pixels."""


def start_outputs(head: nn.Conv2d) -> None:
    """Make a head with outputs v and w say "no smear, known to START_SIGMA" at first."""
    with torch.no_grad():
        head.weight.mul_(0.1)
        assert head.bias is not None
        head.bias.copy_(torch.tensor([0.0, 0.0, START_SIGMA]))  # softplus(8) is 8.0003


class DoubleConvolution(nn.Sequential):
    """Two 3 x 3 convolutions, each with batch normalisation and ReLU."""

    def __init__(self, inputs: int, outputs: int) -> None:
        layers: list[nn.Module] = []
        for channels in (inputs, outputs):
            layers += [
                nn.Conv2d(channels, outputs, 3, padding=1, bias=False),
                nn.BatchNorm2d(outputs),
                nn.ReLU(inplace=True),
            ]
        super().__init__(*layers)


class PlainUNet(nn.Module):
    """The U-Net of Ronneberger et al. (MICCAI 2015), as the paper has it: RGB in, v and w out.

    It works at full resolution; its output is read at pixels [1::4], the centres of our truth's cells.
    """

    def __init__(self, width: int = 64, depth: int = 4) -> None:
        super().__init__()
        widths = [width * 2**k for k in range(depth + 1)]
        pairs = list(zip(widths[:-1], widths[1:], strict=True))
        self.encoders = nn.ModuleList(
            [DoubleConvolution(3, width), *(DoubleConvolution(*pair) for pair in pairs)]
        )
        self.lifts = nn.ModuleList([nn.ConvTranspose2d(coarse, fine, 2, stride=2) for fine, coarse in pairs])
        self.decoders = nn.ModuleList([DoubleConvolution(2 * fine, fine) for fine, _ in pairs])
        self.head = nn.Conv2d(width, 3, 1)
        start_outputs(self.head)

    def forward(self, image: Tensor) -> Tensor:
        """Return (N, 3, H/4, W/4) for RGB (N, 3, H, W), sides multiples of 2^depth."""
        x, skips = image, []
        for k, encoder in enumerate(self.encoders):
            x = encoder(x if k == 0 else nnf.max_pool2d(x, 2))
            skips.append(x)
        for k in reversed(range(len(self.decoders))):
            x = self.decoders[k](torch.cat([skips[k], self.lifts[k](x)], 1))
        heads: Tensor = self.head(x)[..., 1::STRIDE, 1::STRIDE]
        return heads


def stem_network() -> SmearUNet:
    """Return our U-Net behind the structure-tensor stem, with the paper's outputs, not factored ones."""
    network = SmearUNet()
    network.head = nn.Conv2d(network.options.widths[0], 3, 1)
    start_outputs(network.head)
    return network
