"""The mover network (torch): a U-Net over places of 4 x 4 pixels, which smears of cells join half way.

Its inputs are those of :mod:`blur2view.movers.blur_evidence`. It gives every place two log-odds: that it
moves by itself, and that its smear is read right.
"""

import torch
from torch import Tensor, nn
from torch.nn import functional

PLACES, CELLS = 15, 19
"""Channels of the inputs."""
WIDTHS = (16, 24, 40, 64, 80)
"""Channels at places, and at halves of them down to twice a cell."""
JOINED = 3
"""The level of the cells."""
DROPPED = 0.1
"""Share of the cells' channels that are left out in training."""


class Norm(nn.Module):
    """Channels (N, C, h, w) less their mean, over their deviation."""

    mean: Tensor
    scale: Tensor

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(channels, 1, 1))
        self.register_buffer("scale", torch.ones(channels, 1, 1))

    def learn(self, values: Tensor) -> None:
        """Take mean and deviation from examples (N, C, h, w)."""
        self.mean.copy_(values.mean((0, 2, 3))[:, None, None])
        self.scale.copy_(values.std((0, 2, 3))[:, None, None].clamp(min=1e-3))

    def forward(self, x: Tensor) -> Tensor:
        """Return them."""
        normed: Tensor = (x - self.mean) / self.scale
        return normed


def layer(inputs: int, outputs: int, size: int = 3, stride: int = 1, dilation: int = 1) -> nn.Sequential:
    """Return a convolution, normalised over the batch, and max(0, x)."""
    convolution = nn.Conv2d(inputs, outputs, size, stride, dilation * (size // 2), dilation, bias=False)
    return nn.Sequential(convolution, nn.BatchNorm2d(outputs), nn.ReLU())


class Movers(nn.Module):
    """The network: encoder, decoder and skip connections."""

    def __init__(self) -> None:
        super().__init__()
        self.of_places, self.of_cells = Norm(PLACES), Norm(CELLS)
        self.dropout = nn.Dropout2d(DROPPED)
        self.first = layer(PLACES, WIDTHS[0])
        self.down = nn.ModuleList(
            nn.Sequential(layer(before, after, stride=2), layer(after, after))
            for before, after in zip(WIDTHS, WIDTHS[1:], strict=False)
        )
        self.join = nn.Sequential(
            layer(WIDTHS[JOINED] + CELLS, WIDTHS[JOINED], 1), layer(WIDTHS[JOINED], WIDTHS[JOINED])
        )
        self.deepest = nn.Sequential(*(layer(WIDTHS[-1], WIDTHS[-1], dilation=by) for by in (2, 4)))
        self.narrow = nn.ModuleList(
            layer(below, above, 1) for above, below in zip(WIDTHS, WIDTHS[1:], strict=False)
        )
        self.up = nn.ModuleList(layer(2 * width, width) for width in WIDTHS[:-1])
        self.last = nn.Conv2d(WIDTHS[0], 2, 1)

    def forward(self, places: Tensor, cells: Tensor) -> Tensor:
        """Return log-odds (N, 2, 8 h, 8 w) of places (N, 15, 8 h, 8 w) and cells (N, 19, h, w)."""
        x = self.first(self.of_places(places))
        levels = [x]
        for k, down in enumerate(self.down, 1):
            x = down(x)
            if k == JOINED:
                x = self.join(torch.cat([x, self.dropout(self.of_cells(cells))], 1))
            levels.append(x)
        x = self.deepest(x)
        for k in reversed(range(len(self.up))):
            above = levels[k]
            wide = functional.interpolate(self.narrow[k](x), scale_factor=2.0, mode="nearest")
            x = self.up[k](torch.cat([wide[:, :, : above.shape[2], : above.shape[3]], above], 1))
        odds: Tensor = self.last(x)
        return odds
