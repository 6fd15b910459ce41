"""The two networks that find what moves by itself (torch), both U-Nets over pixel blocks of 4 x 4.

`UNet` sees the photograph. It goes down to 1/32, where the smear network's values of the cells join it and
three blocks of attention see the whole picture, and up again to 1/4. Every pixel block gets a smear with its
deviations, and log-odds that it moves by itself; the picture gets log-odds that the camera moved.

`BlurNet` sees blur against the camera's motion, as :mod:`blur2view.movers.moving` measures it, and
gives every pixel block two log-odds: that it moves by itself, and that its smear is read right.

References
----------
Ronneberger, Fischer, Brox, U-Net, MICCAI 2015; Vaswani et al., Attention is all you need, NIPS 2017.
"""

import math

import torch
from torch import Tensor, nn
from torch.nn import functional as nnf

from blur2view.movers.moving import BLOCK_PX, CELL_VALUES

WIDTHS, BLOCKS, ATTENTION = (32, 64, 96, 160), (1, 2, 2, 2), 3
"""Of `UNet`: channels and residual blocks of each size, from 1/4 to 1/32; blocks of attention."""
OUTPUTS = 5
"""Of a pixel block: smear in double angle (2), log of its deviations along and across (2), log-odds."""
PIXEL_BLOCKS, CELLS, LINES = 15, 16, 3
"""Channels of the inputs of `BlurNet`; those of epipolar lines that it was trained with, which are 0."""
BLUR_WIDTHS, JOINED = (16, 24, 40, 64, 80), 3
"""Its channels at pixel blocks, and at halves of that size down to twice a cell; the level of the cells."""
DROPPED = 0.1
"""Share of the cells' channels that are left out in training."""
EDGE = 0.9, 0.25
"""Share of a pixel block from which on it shows one surface; weight of the smears of others."""
SMEAR_WEIGHT, MOVING_WEIGHT, CAMERA_WEIGHT, READ_WEIGHT = 0.5, 5.0, 0.3, 0.2
"""Of the losses of smears, movers and the camera (`UNet`), and of smears that are read right (`BlurNet`)."""
MIN_ERROR = 0.02
"""Error of a compressed smear below which the loss is flat; bound."""
STUDENT = 4.0
"""Degrees of freedom of the errors whose deviations the network states; bound."""


def convolved(inputs: int, outputs: int, size: int = 3, stride: int = 1, dilation: int = 1) -> nn.Sequential:
    """Return a convolution, normalised over the batch, and max(0, x)."""
    padding = dilation * (size // 2) * (size % 2)
    convolution = nn.Conv2d(inputs, outputs, size, stride, padding, dilation, bias=False)
    return nn.Sequential(convolution, nn.BatchNorm2d(outputs), nn.ReLU())


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
    """A block of a transformer over all positions of the smallest size."""

    def __init__(self, channels: int, heads: int = 4) -> None:
        super().__init__()
        self.heads, self.norm = heads, nn.GroupNorm(1, channels)
        self.qkv, self.out = nn.Conv2d(channels, 3 * channels, 1), nn.Conv2d(channels, channels, 1)
        wide, narrow = nn.Conv2d(channels, 2 * channels, 1), nn.Conv2d(2 * channels, channels, 1)
        self.mlp = nn.Sequential(nn.GroupNorm(1, channels), wide, nn.ReLU(), narrow)
        nn.init.zeros_(self.out.weight)

    def forward(self, x: Tensor) -> Tensor:
        """Return features (N, C, h, w) of the same shape."""
        n, c, h, w = x.shape
        q, k, v = self.qkv(self.norm(x)).reshape(n, 3, self.heads, c // self.heads, h * w).unbind(1)
        weight = torch.softmax(q.transpose(-1, -2) @ k / math.sqrt(c // self.heads), -1)  # (N, heads, hw, hw)
        x = x + self.out((v @ weight.transpose(-1, -2)).reshape(n, c, h, w))
        y: Tensor = x + self.mlp(x)
        return y


class UNet(nn.Module):
    """The network; images have sides of multiples of 32 px."""

    def __init__(self) -> None:
        super().__init__()
        pairs, last = list(zip(WIDTHS, WIDTHS[1:], strict=False)), WIDTHS[-1]
        self.stem = convolved(3 * BLOCK_PX**2, WIDTHS[0])
        self.enc = nn.ModuleList(blocks(c, n) for c, n in zip(WIDTHS, BLOCKS, strict=True))
        self.down = nn.ModuleList(convolved(fine, coarse, 2, 2) for fine, coarse in pairs)
        self.cells = nn.Sequential(*convolved(CELL_VALUES + 2, last), Block(last))
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
        """Return the `OUTPUTS` of pixel blocks (N, 5, H/4, W/4), and log-odds (N,) that the camera moved.

        ``image`` (N, 3, H, W) is RGB in [0, 1], ``cells`` (N, 70, H/32, W/32) are
        :func:`blur2view.movers.moving.cell_values`.
        """
        x, skips = self.stem(nnf.pixel_unshuffle(image - 0.5, BLOCK_PX)), list[Tensor]()
        for enc, down in zip(self.enc, self.down, strict=False):
            skips.append(enc(x))
            x = down(skips[-1])
        x = self.join(torch.cat([self.enc[-1](x), self.cells(torch.cat([cells, positions(cells)], 1))], 1))
        for att, mid in zip(self.att, self.mid, strict=True):
            x = mid(att(x))
        whole = self.whole(torch.cat([x.mean((2, 3)), x.amax((2, 3))], 1))
        for narrow, dec, skip in zip(self.narrow[::-1], self.dec[::-1], skips[::-1], strict=True):
            x = nnf.interpolate(narrow(x), scale_factor=2.0, mode="bilinear", align_corners=False)
            x = dec(torch.cat([x, skip], 1))
        return self.head(x), whole[:, 0]


def blocks(channels: int, count: int) -> nn.Sequential:
    """Return ``count`` residual blocks in a row."""
    return nn.Sequential(*(Block(channels) for _ in range(count)))


def positions(cells: Tensor) -> Tensor:
    """Return x and y of every cell (N, 2, h, w), from -1 to 1; -1 along an axis of one cell."""
    ones = torch.ones_like(cells[:, :1])
    steps = torch.cat([ones.cumsum(3), ones.cumsum(2)], 1) - 1
    return 2 * steps / steps.amax((2, 3), keepdim=True).clamp(min=1) - 1


class BlurNet(nn.Module):
    """The network: encoder, decoder and skip connections."""

    def __init__(self) -> None:
        super().__init__()
        pairs = list(zip(BLUR_WIDTHS, BLUR_WIDTHS[1:], strict=False))
        joined, last, whole = BLUR_WIDTHS[JOINED], BLUR_WIDTHS[-1], CELLS + LINES
        # named as in the checkpoints that exist
        self.of_places, self.of_cells = (nn.BatchNorm2d(n, affine=False) for n in (PIXEL_BLOCKS, whole))
        self.dropout = nn.Dropout2d(DROPPED)
        self.first = convolved(PIXEL_BLOCKS, BLUR_WIDTHS[0])
        self.down = nn.ModuleList(
            nn.Sequential(convolved(before, after, stride=2), convolved(after, after))
            for before, after in pairs
        )
        self.join = nn.Sequential(convolved(joined + whole, joined, 1), convolved(joined, joined))
        self.deepest = nn.Sequential(*(convolved(last, last, dilation=by) for by in (2, 4)))
        self.narrow = nn.ModuleList(convolved(below, above, 1) for above, below in pairs)
        self.up = nn.ModuleList(convolved(2 * width, width) for width in BLUR_WIDTHS[:-1])
        self.last = nn.Conv2d(BLUR_WIDTHS[0], 2, 1)

    def forward(self, pixel_blocks: Tensor, cells: Tensor) -> Tensor:
        """Return log-odds (N, 2, 8 h, 8 w) of pixel blocks (N, 15, 8 h, 8 w) and cells (N, 16, h, w)."""
        lines = torch.zeros_like(cells[:, :1])
        cells = torch.cat([cells[:, :4], lines, lines, cells[:, 4:8], lines, cells[:, 8:]], 1)
        x = self.first(self.of_places(pixel_blocks))
        levels = [x]
        for k, down in enumerate(self.down, 1):
            x = down(x)
            if k == JOINED:
                x = self.join(torch.cat([x, self.dropout(self.of_cells(cells))], 1))
            levels.append(x)
        x = self.deepest(x)
        for k in reversed(range(len(self.up))):
            above = levels[k]
            wide = nnf.interpolate(self.narrow[k](x), scale_factor=2.0, mode="nearest")
            x = self.up[k](torch.cat([wide[:, :, : above.shape[2], : above.shape[3]], above], 1))
        odds: Tensor = self.last(x)
        return odds


def compressed(displacement: Tensor) -> Tensor:
    """Return smears of length L (N, 2, ...), pixels, in double angle, with lengths log(1 + L / 2)."""
    x, y = displacement[:, 0], displacement[:, 1]
    length = torch.hypot(x, y).clamp(min=1e-6)
    scale = torch.log1p(length / 2) / (length * length)
    return torch.stack([scale * (x * x - y * y), scale * 2 * x * y], 1)


def smear_loss(said: Tensor, target: Tensor, weight: Tensor) -> Tensor:
    """Return the mean error of smears, along and across, and Student's loss of their stated deviations.

    ``said`` (N, 4, ...) and ``target`` (N, 2, ...) are `compressed`. The deviations have no gradient in the
    smears: else blocks that stand still would count hundreds of times as much as others.
    """
    error, spread = said[:, :2] - target, said[:, 2:4].clamp(-4, 2)
    unit = nnf.normalize(target, dim=1, eps=1e-3)
    along = (error * unit).sum(1)
    across = error[:, 1] * unit[:, 0] - error[:, 0] * unit[:, 1]
    short = target.norm(dim=1) < 1e-2  # of no direction
    parts = torch.where(short, error[:, 0], along), torch.where(short, error[:, 1], across)
    total = torch.sqrt(parts[0] ** 2 + 2 * parts[1] ** 2 + MIN_ERROR**2)
    fitted = torch.zeros_like(total)
    for part, log_sigma in zip(parts, spread.unbind(1), strict=True):
        squared = (part.detach() ** 2 + MIN_ERROR**2) * torch.exp(-2 * log_sigma)
        fitted = fitted + log_sigma + (STUDENT + 1) / 2 * torch.log1p(squared / STUDENT)
    loss: Tensor = ((2 * total + 0.3 * fitted) * weight).sum() / weight.sum()
    return loss


def mover_loss(said: tuple[Tensor, Tensor] | Tensor, batch: dict[str, Tensor]) -> Tensor:
    """Return the loss of the outputs of `UNet` (N, 5, h, w) and (N,), or of `BlurNet` (N, 2, h, w).

    That of `BlurNet` is the mean cross-entropy of both questions.
    """
    cross_entropy = nnf.binary_cross_entropy_with_logits
    if isinstance(said, Tensor):
        moves, reads = (cross_entropy(said[:, k], batch[name]) for k, name in enumerate(("moving", "read")))
        return moves + READ_WEIGHT * reads
    pixel_blocks, camera = (one.float() for one in said)
    weight = torch.where(batch["share"] > EDGE[0], 1.0, EDGE[1])
    smears = smear_loss(pixel_blocks[:, :4], compressed(batch["displacement"]), weight)
    moving, moved = cross_entropy(pixel_blocks[:, 4], batch["moving"]), cross_entropy(camera, batch["camera"])
    return SMEAR_WEIGHT * smears + MOVING_WEIGHT * moving + CAMERA_WEIGHT * moved
