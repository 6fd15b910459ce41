"""The U-Net that sees what moves by itself (torch): from a photograph and what the reader says of its cells.

The photograph, in blocks of 4 x 4 pixels, goes down to 1/32, where the cells join it and three blocks of
attention see all of it, and up again to 1/4. There every place has a smear with its deviations, and
log-odds that it moves by itself; the whole picture has log-odds that the camera moved.

References
----------
Ronneberger, Fischer, Brox, U-Net, MICCAI 2015; Vaswani et al., Attention is all you need, NIPS 2017.
"""

import math

import torch
from torch import Tensor, nn
from torch.nn import functional as nnf

from blur2view.networks.mover_networks import CELL_VALUES, PLACE_PX

WIDTHS, BLOCKS, ATTENTION = (32, 64, 96, 160), (1, 2, 2, 2), 3
"""Channels and residual blocks of each size, from 1/4 to 1/32; blocks of attention."""
OUTPUTS = 5
"""Of a place: smear in double angle (2), logarithms of its deviations along and across (2), log-odds."""


class Block(nn.Module):
    """A residual block of two convolutions, at first the identity."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.a, self.b = (nn.Conv2d(channels, channels, 3, padding=1, bias=False) for _ in range(2))
        self.na, self.nb = nn.BatchNorm2d(channels), nn.BatchNorm2d(channels)
        nn.init.zeros_(self.nb.weight)

    def forward(self, x: Tensor) -> Tensor:
        """Return features of the same shape."""
        return torch.relu(x + self.nb(self.b(torch.relu(self.na(self.a(x))))))


class Attention(nn.Module):
    """A block of a transformer over all places of the smallest size."""

    def __init__(self, channels: int, heads: int = 4) -> None:
        super().__init__()
        self.heads, self.norm = heads, nn.GroupNorm(1, channels)
        self.qkv, self.out = nn.Conv2d(channels, 3 * channels, 1), nn.Conv2d(channels, channels, 1)
        self.mlp = nn.Sequential(
            nn.GroupNorm(1, channels),
            nn.Conv2d(channels, 2 * channels, 1),
            nn.ReLU(),
            nn.Conv2d(2 * channels, channels, 1),
        )
        nn.init.zeros_(self.out.weight)

    def forward(self, x: Tensor) -> Tensor:
        """Return features (N, C, h, w) of the same shape."""
        n, c, h, w = x.shape
        q, k, v = self.qkv(self.norm(x)).reshape(n, 3, self.heads, c // self.heads, h * w).unbind(1)
        weight = torch.softmax(q.transpose(-1, -2) @ k / math.sqrt(c // self.heads), -1)  # (N, heads, hw, hw)
        x = x + self.out((v @ weight.transpose(-1, -2)).reshape(n, c, h, w))
        y: Tensor = x + self.mlp(x)
        return y


def convolved(inputs: int, outputs: int, size: int, stride: int = 1) -> nn.Sequential:
    """Return a convolution with its normalisation and rectifier."""
    padding = size // 2 if stride == 1 else 0
    convolution = nn.Conv2d(inputs, outputs, size, stride, padding, bias=False)
    return nn.Sequential(convolution, nn.BatchNorm2d(outputs), nn.ReLU())


class UNet(nn.Module):
    """The network; images have sides of multiples of 32 px."""

    def __init__(self) -> None:
        super().__init__()
        pairs = list(zip(WIDTHS, WIDTHS[1:], strict=False))
        last = WIDTHS[-1]
        self.stem = convolved(3 * PLACE_PX**2, WIDTHS[0], 3)
        self.enc = nn.ModuleList(blocks(c, n) for c, n in zip(WIDTHS, BLOCKS, strict=True))
        self.down = nn.ModuleList(convolved(fine, coarse, 2, 2) for fine, coarse in pairs)
        self.cells = nn.Sequential(*convolved(CELL_VALUES + 2, last, 3), Block(last))
        self.join = convolved(2 * last, last, 1)
        self.att = nn.ModuleList(Attention(last) for _ in range(ATTENTION))
        self.mid = nn.ModuleList(Block(last) for _ in range(ATTENTION))
        self.narrow = nn.ModuleList(nn.Conv2d(coarse, fine, 1) for fine, coarse in pairs)
        self.dec = nn.ModuleList(
            nn.Sequential(convolved(2 * fine, fine, 1), *blocks(fine, n))
            for (fine, _), n in zip(pairs, BLOCKS, strict=False)
        )
        self.head = nn.Conv2d(WIDTHS[0], OUTPUTS, 1)
        self.whole = nn.Linear(2 * last, 1)

    def forward(self, image: Tensor, cells: Tensor) -> tuple[Tensor, Tensor]:
        """Return what is said of places (N, 5, H/4, W/4), and log-odds (N,) that the camera moved.

        ``image`` (N, 3, H, W) has RGB in [0, 1], ``cells`` (N, 70, H/32, W/32) what
        :func:`blur2view.networks.mover_networks.cell_values` gives.
        """
        x, skips = self.stem(nnf.pixel_unshuffle(image - 0.5, PLACE_PX)), list[Tensor]()
        for enc, down in zip(self.enc, self.down, strict=False):
            skips.append(enc(x))
            x = down(skips[-1])
        x = self.join(torch.cat([self.enc[-1](x), self.cells(torch.cat([cells, places(cells)], 1))], 1))
        for att, mid in zip(self.att, self.mid, strict=True):
            x = mid(att(x))
        whole = self.whole(torch.cat([x.mean((2, 3)), x.amax((2, 3))], 1))
        for narrow, dec, skip in zip(self.narrow[::-1], self.dec[::-1], skips[::-1], strict=True):
            x = nnf.interpolate(narrow(x), scale_factor=2.0, mode="bilinear", align_corners=False)
            x = dec(torch.cat([x, skip], 1))
        return self.head(x), whole[:, 0]


class Exported(nn.Module):
    """What the package asks of it: log-odds of places (N, H/4, W/4), and of the camera (N,)."""

    def __init__(self, unet: UNet) -> None:
        super().__init__()
        self.unet = unet

    def forward(self, image: Tensor, cells: Tensor) -> tuple[Tensor, Tensor]:
        """Leave out the smears."""
        said, moved = self.unet(image, cells)
        return said[:, -1], moved


def blocks(channels: int, count: int) -> nn.Sequential:
    """Return so many blocks."""
    return nn.Sequential(*(Block(channels) for _ in range(count)))


def places(cells: Tensor) -> Tensor:
    """Return x and y of every cell (N, 2, h, w), from -1 to 1; -1 where there is one."""
    ones = torch.ones_like(cells[:, :1])
    steps = torch.cat([ones.cumsum(3), ones.cumsum(2)], 1) - 1
    return 2 * steps / steps.amax((2, 3), keepdim=True).clamp(min=1) - 1
