"""The network of the paper's experiments, with outputs v and w: a U-Net behind fixed arithmetic (torch).

The stem has three views of one pyramid: structure tensors (:class:`StructureStem`), how gradients repeat
along a smear (:class:`LagStem`) and which way the fine detail runs that is left (:class:`OrientedStem`).
"""

import torch
from torch import Tensor, nn
from torch.nn import functional as nnf

STRIDE = 4  # pixels per output cell
LEVELS = 4  # scales of the stem's luminance pyramid


def halved(x: Tensor) -> Tensor:
    """Average 2 x 2 blocks of (N, C, h, w); faster than a pooling layer."""
    return (x[..., ::2, ::2] + x[..., ::2, 1::2] + x[..., 1::2, ::2] + x[..., 1::2, 1::2]) * 0.25


def box_mean(x: Tensor, channels: int, side: int) -> Tensor:
    """Average (N, channels, h, w) over `side` x `side` cells about each, the border repeated.

    A convolution of each channel with a constant does it ten times as fast as a pooling layer. (The exporter
    to ONNX cannot trace a number of channels that is read from the tensor.)
    """
    reach = side // 2
    window = torch.full((channels, 1, side, side), 1 / side**2, dtype=x.dtype, device=x.device)
    return nnf.conv2d(nnf.pad(x, (reach, reach, reach, reach), mode="replicate"), window, groups=channels)


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
            products = [along * along, *(self.lagged_product(along, lag) for lag in lags)]
            cells = torch.cat(products, 1)
            means = box_mean(halved(cells) if k == 1 else cells, self.directions * len(products), 7)
            energy, *lagged = means.split(self.directions, 1)
            features += [product / (energy + 2e-5) for product in lagged]
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


class OrientedStem(nn.Module):
    """Turn a pyramid into features (N, 24, H/4, W/4): which way the fine detail that is left runs.

    Blur along a direction leaves, of the fine detail, only a narrow wedge of spatial frequencies at right
    angles to it. Gradients' double angle knows the mean orientation alone; energies of eight even and odd
    Gabor filters, a quarter cycle a pixel, tell the wedge's shape. Per level and orientation: the log energy,
    against the mean over orientations.
    """

    directions = 8
    levels = 3
    channels = directions * levels
    reach = 4

    bank: Tensor

    def __init__(self) -> None:
        super().__init__()
        y, x = torch.meshgrid(*[torch.arange(-self.reach, self.reach + 1.0)] * 2, indexing="ij")
        envelope = torch.exp(-(x * x + y * y) / (2 * 2.0**2))
        filters = []
        for wave in (torch.cos, torch.sin):
            for k in range(self.directions):
                angle = torch.tensor(torch.pi * k / self.directions)
                kernel = envelope * wave(0.5 * torch.pi * (x * torch.cos(angle) + y * torch.sin(angle)))
                kernel = kernel - envelope * kernel.sum() / envelope.sum()
                filters.append(kernel / kernel.abs().sum())
        self.register_buffer("bank", torch.stack(filters)[:, None], persistent=False)

    def forward(self, levels: list[Tensor]) -> Tensor:
        """Compute the features from the luminance pyramid's levels (N, 1, h, w)."""
        return torch.cat([self.energies(levels[k], k) for k in range(self.levels)], 1)

    def energies(self, level: Tensor, k: int) -> Tensor:
        """Return level k's log energies (N, 8, H/4, W/4)."""
        padded = nnf.pad(level, (self.reach,) * 4, mode="replicate")
        even, odd = nnf.conv2d(padded, self.bank, stride=2 if k == 0 else 1).split(self.directions, 1)
        energy = even * even + odd * odd
        if k < 2:
            energy = halved(energy)
        energy = box_mean(energy, self.directions, 3)
        mean = energy.mean(1, keepdim=True)
        return torch.log((energy + 1e-6) / (mean + 1e-6))


class StructureStem(nn.Module):
    """Turn RGB (N, 3, H, W) into features (N, 111, H/4, W/4): what blur does to gradients, at four scales.

    Per level of a luminance pyramid: double-angle products of the Sobel gradients, averaged and divided by
    the local gradient energy (orientation and coherence), and log energies, whose falloff between levels
    tells the length; plus the contrast-normalised luminance, pixel-unshuffled, :class:`LagStem` and
    :class:`OrientedStem`.
    """

    sobel: Tensor
    binomial: Tensor
    luma: Tensor

    channels = LEVELS * 2 + LEVELS + 3 + STRIDE * STRIDE + LagStem.channels + OrientedStem.channels

    def __init__(self) -> None:
        super().__init__()
        self.lags = LagStem()
        self.oriented = OrientedStem()
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
        features, energies = [nnf.pixel_unshuffle(normalised, STRIDE)], []
        gradients, levels, level = [], [], grey
        for k in range(LEVELS):
            gradients.append(self.gradient(level))
            levels.append(level)
            orientation, energy = self.tensor_at(gradients[k], k)
            features.append(orientation)
            energies.append(torch.log(energy + 1e-6))
            if k + 1 < LEVELS:
                padded = nnf.pad(level, (1, 1, 1, 1), mode="replicate")
                level = nnf.conv2d(padded, self.binomial, stride=2)
        features += [(e + 6) / 3 for e in energies]
        features += [fine - coarse for fine, coarse in zip(energies[:-1], energies[1:], strict=True)]
        return torch.cat([*features, self.lags(gradients), self.oriented(levels)], 1)

    def gradient(self, level: Tensor) -> Tensor:
        """Sobel gradient (N, 2, h, w) of a pyramid level (N, 1, h, w)."""
        return nnf.conv2d(nnf.pad(level, (1, 1, 1, 1), mode="replicate"), self.sobel)

    def tensor_at(self, gradient: Tensor, k: int) -> tuple[Tensor, Tensor]:
        """Return level k's normalised double angle (N, 2, h, w) and energy (N, 1, h, w) at stride 4."""
        gx, gy = gradient[:, :1], gradient[:, 1:]
        products = torch.cat([gx * gx - gy * gy, 2 * gx * gy, gx * gx + gy * gy], 1)
        if k < 2:
            products = nnf.avg_pool2d(products, STRIDE // 2**k)
        products = box_mean(products, 3, 3)
        if k == 3:
            products = nnf.interpolate(products, scale_factor=2.0, mode="bilinear", align_corners=False)
        energy = products[:, 2:]
        return products[:, :2] / (energy + 2e-5), energy

    @staticmethod
    def normalise_contrast(grey: Tensor) -> Tensor:
        """Subtract the local mean of luminance and divide by its local deviation (about 32 px)."""
        grey = grey - 0.5  # or the variance below loses half of its digits
        small = nnf.avg_pool2d(torch.cat([grey, grey * grey], 1), 16)
        small = box_mean(small, 2, 3)
        local = nnf.interpolate(small, scale_factor=16.0, mode="bilinear", align_corners=False)
        mean, square = local[:, :1], local[:, 1:]
        deviation = torch.sqrt(torch.clamp(square - mean * mean, min=0.0) + 4e-4)
        return torch.clamp((grey - mean) / deviation, -4.0, 4.0) / 2


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
