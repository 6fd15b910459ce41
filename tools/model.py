"""The smear network: a structure-tensor stem, a U-Net at stride 4 and factored heads (torch).

A plain U-Net on RGB does not start to learn; gradients' double-angle products as input,
and orientation, log length and uncertainty as separate outputs do, within minutes.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional as nnf

STRIDE = 4
"""Pixels per output cell."""
MULTIPLE_OF = 16
"""Height and width of the input must be multiples of this."""
LEVELS = 4
"""Scales of the stem's luminance pyramid."""


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

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for checkpoints."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> ModelOptions:
        """Invert :meth:`as_dict`."""
        return cls(widths=tuple(values["widths"]), bottom=values["bottom"])


class LagStem(nn.Module):
    """Turn luminance (N, 1, H, W) into features (N, 56, H/4, W/4): how gradients repeat.

    A smear of length L turns every edge across it into a pair of opposite steps L apart, so the gradient
    along the smear correlates negatively with itself at lag L, and not elsewhere. Products of pixels are what
    a small U-Net learns slowest, so they are computed here: per pyramid level, direction and lag, the
    normalised autocorrelation of the derivative in that direction, averaged over about 28 px.
    """

    lags = {1: (2, 3, 5), 2: (4, 6, 9, 13)}
    """Lags in level pixels by pyramid level: 4, 6, 10, 16, 24, 36 and 52 image pixels."""
    directions = 8
    channels = directions * 7

    weights: Tensor

    def __init__(self) -> None:
        super().__init__()
        angles = torch.arange(self.directions) * torch.pi / self.directions
        self.cosines, self.sines = torch.cos(angles).tolist(), torch.sin(angles).tolist()
        self.register_buffer(
            "weights", torch.stack([torch.cos(angles), torch.sin(angles)], 1), persistent=False
        )

    def forward(self, gradients: list[Tensor]) -> Tensor:
        """Compute the features from the gradients (N, 2, h, w) of the pyramid's levels."""
        features = []
        for k, lags in self.lags.items():
            along = nnf.conv2d(gradients[k], self.weights[..., None, None])  # (N, 8, h, w)
            energy = self.pool(along * along, k) + 2e-5
            features += [self.pool(self.lagged_product(along, lag), k) / energy for lag in lags]
        # a long lag reaches beyond the window: next to strong edges the quotient knows no bound by itself
        return torch.clamp(torch.cat(features, 1), -1.0, 1.0)

    def lagged_product(self, along: Tensor, lag: int) -> Tensor:
        """Multiply each directional derivative (N, 8, h, w) by itself, `lag` pixels on in its direction."""
        height, width = along.shape[2:]
        padded = nnf.pad(along, (lag, lag, lag, lag), mode="replicate")
        products = []
        for k, (cosine, sine) in enumerate(zip(self.cosines, self.sines, strict=True)):
            dx, dy = round(lag * cosine), round(lag * sine)
            x, y = lag - dx // 2, lag - dy // 2  # the pair's middle is the pixel itself
            first = padded[:, k : k + 1, y : y + height, x : x + width]
            second = padded[:, k : k + 1, y + dy : y + dy + height, x + dx : x + dx + width]
            products.append(first * second)
        return torch.cat(products, 1)

    @staticmethod
    def pool(products: Tensor, k: int) -> Tensor:
        """Average level k's products to stride 4 and then over 7 x 7 cells."""
        if k < 2:
            products = nnf.avg_pool2d(products, STRIDE // 2**k)
        padded = nnf.pad(products, (3, 3, 3, 3), mode="replicate")
        return nnf.avg_pool2d(nnf.avg_pool2d(padded, (1, 7), stride=1), (7, 1), stride=1)


class StructureStem(nn.Module):
    """Turn RGB (N, 3, H, W) into features (N, 87, H/4, W/4): what blur does to gradients, at four scales.

    Per level of a luminance pyramid: double-angle products of the Sobel gradients, averaged and divided by
    the local gradient energy (orientation and coherence), and log energies, whose falloff between levels
    tells the length; plus the contrast-normalised luminance, pixel-unshuffled, and :class:`LagStem`.
    """

    sobel: Tensor
    binomial: Tensor
    luma: Tensor

    channels = LEVELS * 2 + LEVELS + 3 + STRIDE * STRIDE + LagStem.channels

    def __init__(self) -> None:
        super().__init__()
        self.lags = LagStem()
        sobel = torch.tensor([[-1.0, 0, 1], [-2, 0, 2], [-1, 0, 1]]) / 8
        self.register_buffer("sobel", torch.stack([sobel, sobel.T])[:, None], persistent=False)
        binomial = torch.tensor([1.0, 3, 3, 1])
        self.register_buffer("binomial", (torch.outer(binomial, binomial) / 64)[None, None], persistent=False)
        self.register_buffer(
            "luma", torch.tensor([0.299, 0.587, 0.114])[None, :, None, None], persistent=False
        )

    def forward(self, image: Tensor) -> Tensor:
        """Compute the features."""
        grey = (image * self.luma).sum(1, keepdim=True)
        normalised = self.normalise_contrast(grey)
        features, energies, level, gradients = [nnf.pixel_unshuffle(normalised, STRIDE)], [], grey, []
        for k in range(LEVELS):
            gradients.append(self.gradient(level))
            orientation, energy = self.tensor_at(gradients[k], k)
            features.append(orientation)
            energies.append(torch.log(energy + 1e-6))
            if k + 1 < LEVELS:
                padded = nnf.pad(level, (1, 1, 1, 1), mode="replicate")
                level = nnf.conv2d(padded, self.binomial, stride=2)
        features += [(e + 6) / 3 for e in energies]
        features += [fine - coarse for fine, coarse in zip(energies[:-1], energies[1:], strict=True)]
        return torch.cat([*features, self.lags(gradients)], 1)

    def gradient(self, level: Tensor) -> Tensor:
        """Sobel gradient (N, 2, h, w) of a pyramid level (N, 1, h, w)."""
        return nnf.conv2d(nnf.pad(level, (1, 1, 1, 1), mode="replicate"), self.sobel)

    def tensor_at(self, gradient: Tensor, k: int) -> tuple[Tensor, Tensor]:
        """Give pyramid level k's normalised double angle (N, 2, h, w) and energy (N, 1, h, w) at stride 4."""
        gx, gy = gradient[:, :1], gradient[:, 1:]
        products = torch.cat([gx * gx - gy * gy, 2 * gx * gy, gx * gx + gy * gy], 1)
        if k < 2:
            products = nnf.avg_pool2d(products, STRIDE // 2**k)
        products = nnf.avg_pool2d(nnf.pad(products, (1, 1, 1, 1), mode="replicate"), 3, stride=1)
        if k == 3:
            products = nnf.interpolate(products, scale_factor=2.0, mode="bilinear", align_corners=False)
        energy = products[:, 2:]
        return products[:, :2] / (energy + 2e-5), energy

    @staticmethod
    def normalise_contrast(grey: Tensor) -> Tensor:
        """Subtract the local mean of luminance and divide by its local deviation (about 32 px)."""
        grey = grey - 0.5  # or the variance below loses half of its digits
        small = nnf.avg_pool2d(torch.cat([grey, grey * grey], 1), 16)
        small = nnf.avg_pool2d(nnf.pad(small, (1, 1, 1, 1), mode="replicate"), 3, stride=1)
        local = nnf.interpolate(small, scale_factor=16.0, mode="bilinear", align_corners=False)
        mean, square = local[:, :1], local[:, 1:]
        deviation = torch.sqrt(torch.clamp(square - mean * mean, min=0.0) + 4e-4)
        return torch.clamp((grey - mean) / deviation, -4.0, 4.0) / 2


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
    """Turn RGB (N, 3, H, W) in [0, 1] into raw heads (N, 4, H/4, W/4).

    They are the double angle's x and y (any length), log(1 + length) and log sigma; see :func:`decode`.
    The coarsest level is at stride 16, so that what a pixel sees (about 130 px around it) fits into a
    training crop: with levels at strides 32 and 64 trained on 128-px crops, lengths came out 2.3 times too
    long on 640x480 images (0.86 times on 128-px crops of the same), since there the deep levels meet no zero
    padding.
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
        self.head = nn.Conv2d(widths[0], 4, 1)
        self.head.bias = nn.Parameter(torch.tensor([0.0, 0.0, 2.0, 1.0]))  # 6 px long, 3 px uncertain

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
    """Turn raw heads (N, 4, h, w) into the output (N, 3, h, w): |d| cos 2phi, |d| sin 2phi, sigma, in px.

    Sigma is the root mean square of an end-point error with the mean and the exponential law of the loss.
    """
    direction = raw[:, :2] / torch.sqrt((raw[:, :2] ** 2).sum(1, keepdim=True) + 1e-4)
    length = torch.clamp(torch.exp(torch.clamp(raw[:, 2:3], 0.0, 5.5)) - 1, min=0.0)
    mean_error = torch.exp(torch.clamp(raw[:, 3:4], -3.0, 4.5))  # what the Laplace likelihood fits
    return torch.cat([direction * length, math.sqrt(2) * mean_error], 1)


class ExportedSmear(nn.Module):
    """The network followed by :func:`decode`: what the ONNX file computes."""

    def __init__(self, network: SmearUNet) -> None:
        super().__init__()
        self.network = network

    def forward(self, image: Tensor) -> Tensor:
        """Compute the output named ``smear``."""
        return decode(self.network(image))
