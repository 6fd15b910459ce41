"""The network of the paper's experiments, with its outputs v and w: a U-Net behind a fixed stem."""

import torch
from torch import Tensor, nn
from torch.nn import functional as nnf

from tools.paper.stem import StructureStem

START_SIGMA = 8.0  # what softplus(w) is at first, pixels


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


class StemUNet(nn.Module):
    """Turn RGB (N, 3, H, W) in [0, 1] into v and w (N, 3, H/4, W/4): a U-Net at stride 4 behind our stem.

    A plain U-Net on RGB does not start to learn within minutes; on gradients' double-angle products it does.
    The coarsest level is at stride 16, so that what a pixel sees (about 130 px) fits into a training crop.
    ``widths`` are channels at strides 4, 8 and 16, ``bottom`` residual blocks at the coarsest level.
    """

    def __init__(self, widths: tuple[int, ...] = (48, 80, 144), bottom: int = 3) -> None:
        super().__init__()
        pairs = list(zip(widths[:-1], widths[1:], strict=True))
        self.stem = StructureStem()
        first = Block(StructureStem.channels, widths[0])
        self.encoders = nn.ModuleList([first, *(Block(fine, coarse) for fine, coarse in pairs)])
        self.bottom = nn.Sequential(*(Block(widths[-1], widths[-1], skip=True) for _ in range(bottom)))
        self.lifts = nn.ModuleList([nn.Conv2d(coarse, fine, 1) for fine, coarse in pairs])
        self.decoders = nn.ModuleList([Block(fine, fine, skip=True) for fine in widths[:-1]])
        self.head = nn.Conv2d(widths[0], 3, 1)
        assert self.head.bias is not None
        with torch.no_grad():  # at first: no smear, known to START_SIGMA
            self.head.weight.mul_(0.1)
            nn.init.zeros_(self.head.bias)
            self.head.bias[2] = START_SIGMA  # softplus(8) is 8.0003

    def forward(self, image: Tensor) -> Tensor:
        """Compute v and w; height and width must be multiples of 16."""
        return self.body(self.stem(image))

    def body(self, features: Tensor) -> Tensor:
        """Run the U-Net on the stem's features (the part that may run in bfloat16)."""
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
