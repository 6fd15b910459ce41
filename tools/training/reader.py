"""The spectral reader: likelihoods of the blur in every window of a picture, octave by octave (torch).

It turns the polar cepstra of :mod:`blur2view.networks.spectra` into logits over 32 directions and 20
lengths of smears, over 20 radii out of focus, and over five kinds of blur.
Layers are convolutions along the circle of directions, dense in everything else, so that directions
differ only by two channels that state the pixel lattice; cells see their neighbours and the features of the
smaller octave. Values without a direction come from means, extremes and deviations over all directions.
"""

import math
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional as nnf

from blur2view.networks.spectra import LAGS, SCALES, STEP, WINDOW
from blur2view.smears.likelihood import (
    BINS,
    DIRECTIONS,
    KINDS,
    LABEL_SPREAD,
    PER_OCTAVE,
    SHORTEST_PX,
    SMALLEST_RADIUS_PX,
)

SCALARS = SCALES + 2
"""Numbers beside the cepstra of a window: their scales, and :func:`clipped_shares`."""
BLUR_WEIGHT = 0.4  # weight of the losses of radii and of kinds
HIDDEN_WEIGHT = 0.25  # weight of a true smear one of whose ends is hidden
MOVED_PX, DEFOCUSED_PX = (1.5, 2.5), (1.6, 2.4)
"""Ranges of smears, and of radii, over which a cell turns to smeared, and to out of focus, pixels."""
PREVAILS = 0.7, 1.1
"""Range of length over radius out of focus in which a smear becomes visible: a disc hides shorter ones."""


class Circular(nn.Module):
    """A convolution along the circle of directions, dense in channels: (..., 32, C) -> (..., 32, outputs)."""

    matrix: Tensor

    def __init__(self, inputs: int, outputs: int, reach: int) -> None:
        super().__init__()
        self.shifts = range(-reach, reach + 1)
        self.bias = nn.Parameter(torch.zeros(outputs))
        bound = math.sqrt(3 / (inputs * len(self.shifts)))
        self.weight = nn.Parameter(torch.empty(outputs * len(self.shifts), inputs).uniform_(-bound, bound))

    def forward(self, x: Tensor) -> Tensor:
        """Apply it: one matrix product, whose parts are shifted against each other and added.

        ONNX Runtime computes the same faster where directions are gathered first, above all those of 8 bits.
        """
        if torch.onnx.is_in_onnx_export():
            turned = [(torch.arange(DIRECTIONS) - shift) % DIRECTIONS for shift in self.shifts]
            near = torch.index_select(x, -2, torch.stack(turned, 1).flatten())
            return torch.matmul(near.reshape(*x.shape[:-1], -1), self.matrix) + self.bias
        parts = nnf.linear(x, self.weight).chunk(len(self.shifts), -1)
        total = self.bias.to(parts[0].dtype)
        for shift, part in zip(self.shifts, parts, strict=True):
            total = total + (torch.roll(part, shift, -2) if shift else part)
        return total

    def store_matrix(self) -> None:
        """Store the weights also as the one matrix of the exported product."""
        matrix = torch.cat(self.weight.detach().chunk(len(self.shifts)), 1).t()
        self.register_buffer("matrix", matrix.contiguous())

    def weight_of(self, matrix: Tensor) -> Tensor:
        """Return the weights whose `store_matrix` is this matrix."""
        return torch.cat(matrix.t().chunk(len(self.shifts), 1))


def box_sums(reach: int, *fields: Tensor) -> list[Tensor]:
    """Sum fields (N, h, w, D, C) over (2 reach + 1)^2 cells, zeros beyond the border.

    Products with band matrices are six times as fast as adding slices here.
    """
    down, across = (
        torch.ones(n, n, dtype=fields[0].dtype, device=fields[0].device).tril(reach).triu(-reach)
        for n in fields[0].shape[1:3]
    )
    sums = (torch.matmul(down, torch.matmul(across, x.flatten(3)).flatten(2)) for x in fields)
    return [total.view_as(x) for total, x in zip(sums, fields, strict=True)]


class Gathering(nn.Module):
    """Append to each cell's features the means of its neighbours', weighed by a learned gate."""

    def __init__(self, channels: int, reaches: tuple[int, ...]) -> None:
        super().__init__()
        self.gate = nn.Linear(channels, 1)
        self.reaches = reaches

    def forward(self, x: Tensor) -> Tensor:
        """Turn (N, h, w, D, C) into (N, h, w, D, C * (1 + number of reaches))."""
        gate = torch.sigmoid(self.gate(x.mean(-2, keepdim=True)))  # (N, h, w, 1, 1)
        weighed = x * gate
        sums = (box_sums(reach, weighed, gate) for reach in self.reaches)
        return torch.cat([x, *(total / (weight + 1e-2) for total, weight in sums)], -1)


class Context(nn.Module):
    """Add features of far cells to each cell's, passed in few channels; initially zero."""

    def __init__(self, channels: int, said: int, reaches: tuple[int, ...]) -> None:
        super().__init__()
        self.said = nn.Linear(channels, said)
        self.gathering = Gathering(said, reaches)
        self.heard = Circular(channels + said * (1 + len(reaches)), channels, 1)
        self.share = nn.Parameter(torch.zeros(channels))

    def forward(self, x: Tensor) -> Tensor:
        """Return features (N, h, w, D, C) of the same shape."""
        y: Tensor = x + self.share * torch.relu(self.heard(torch.cat([x, self.gathering(self.said(x))], -1)))
        return y


class Isotropic(nn.Module):
    """Add features of all directions together to a window's; initially zero."""

    def __init__(self, inputs: int, hidden: int, channels: int) -> None:
        super().__init__()
        self.seen = nn.Linear(4 * inputs + SCALARS, hidden)
        self.mixed = nn.Linear(hidden, channels)
        nn.init.zeros_(self.mixed.weight)
        nn.init.zeros_(self.mixed.bias)

    def forward(self, cepstra: Tensor, scalars: Tensor) -> Tensor:
        """Turn cepstra (N, h, w, D, L) and scalars (N, h, w, S) into features (N, h, w, 1, C)."""
        mean = cepstra.mean(-2)
        spread = torch.sqrt((cepstra * cepstra).mean(-2) - mean * mean + 1e-2)
        parts = mean, cepstra.amin(-2), cepstra.amax(-2), spread, scalars.to(cepstra.dtype)
        features: Tensor = self.mixed(torch.relu(self.seen(torch.cat(parts, -1))))
        return features[..., None, :]


@dataclass(frozen=True, kw_only=True)
class ReaderOptions:
    """Channels of the layers."""

    window: int = 64  # of one window
    region: int = 64  # of its region
    said: int = 16  # passed to far cells
    round: int = 64  # of a window, without directions
    kind: int = 96  # of the kind of its blur


class Reader(nn.Module):
    """Features of a picture's octaves, finest first -> joint logits of each."""

    lattice: Tensor

    def __init__(self, options: ReaderOptions | None = None) -> None:
        super().__init__()
        self.options = o = options or ReaderOptions()
        angles = torch.arange(DIRECTIONS) * math.pi / DIRECTIONS
        lattice = torch.stack([torch.cos(4 * angles), torch.cos(8 * angles)], 1)
        self.register_buffer("lattice", lattice, persistent=False)
        self.first = Circular(LAGS + 2 + SCALARS, o.window, 2)
        self.second = Circular(o.window, o.window, 1)
        self.gather1 = Gathering(o.window, (1, 2))
        self.third = Circular(3 * o.window, o.region, 1)
        self.fourth = Circular(o.region, o.region, 1)
        self.gather2 = Gathering(o.region, (1,))
        self.fifth = Circular(3 * o.region, o.region, 1)
        self.context = Context(o.region, o.said, (2, 4, 8))
        self.further = Context(o.region, o.said, (1, 3, 6, 12))
        self.last = nn.Linear(o.region, BINS)
        self.isotropic = Isotropic(LAGS, o.round, o.region)
        self.blur = nn.Sequential(
            nn.Linear(2 * o.region, o.kind), nn.ReLU(), nn.Linear(o.kind, BINS + len(KINDS))
        )
        self.norms = nn.ModuleList([nn.LayerNorm(c) for c in (o.window, o.region)])

    def windows(self, cepstra: Tensor, scalars: Tensor) -> Tensor:
        """Compute one octave's features (N, h, w, 32, C) without those of the smaller octave."""
        n, h, w = cepstra.shape[:3]
        lattice = self.lattice.to(cepstra.dtype).expand(n, h, w, -1, -1)
        window = scalars[..., None, :].to(cepstra.dtype).expand(-1, -1, -1, DIRECTIONS, -1)
        x = torch.relu(self.first(torch.cat([cepstra, lattice, window], -1)))
        x = self.norms[0](x + torch.relu(self.second(x)))
        x = torch.relu(self.third(self.gather1(x)))
        windows: Tensor = self.norms[1](x + torch.relu(self.fourth(x))) + self.isotropic(cepstra, scalars)
        return windows

    def store_matrices(self) -> None:
        """Keep the weights of all convolutions also as matrices, as the exported file multiplies them."""
        for layer in self.modules():
            if isinstance(layer, Circular):
                layer.store_matrix()

    def octave(self, own: Tensor, coarser: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Compute logits and features of an octave, given those of the smaller one.

        Of smears (N, h, w, 32, 20), radii (N, h, w, 20) and kinds (N, h, w, 5).
        """
        x = self.context(own + torch.relu(self.fifth(torch.cat([self.gather2(own), coarser], -1))))
        x = self.further(x)
        blur = self.blur(torch.cat([x.mean(-2), x.amax(-2)], -1)).float()
        return self.last(x).float(), blur[..., :BINS], blur[..., BINS:], x

    def forward(self, octaves: list[tuple[Tensor, Tensor]]) -> list[tuple[Tensor, Tensor, Tensor]]:
        """Compute joint logits of every octave where k smaller ones follow.

        Of smears (N, h, w, 32, 20 + 4 k), radii (N, h, w, 20 + 4 k) and kinds (N, h, w, 5).
        """
        joint: list[tuple[Tensor, Tensor, Tensor]] = []
        features: Tensor | None = None
        for cepstra, scalars in reversed(octaves):
            own = self.windows(cepstra, scalars)
            shape = own.shape[1:3]
            above = torch.zeros_like(own) if features is None else doubled(features, shape)
            smears, radii, kinds, features = self.octave(own, above)
            if joint:
                smears, radii = (
                    joined(fine, doubled(coarse, shape))
                    for fine, coarse in zip((smears, radii), joint[0][:2], strict=True)
                )
            joint.insert(0, (smears, radii, kinds))
        return joint


def clipped_shares(grey: Tensor) -> Tensor:
    """Return twice the shares of white and black (N, h, w, 2) of a picture's windows (N, 1, 32 h, 32 w).

    Beyond its border it is mirrored: windows are centred on cells.
    """
    padded = nnf.pad(grey - 0.5, ((WINDOW - STEP) // 2,) * 4, mode="reflect")
    ends = torch.cat([(padded > 0.49).to(padded.dtype), (padded < -0.49).to(padded.dtype)], 1)
    clipped = nnf.avg_pool2d(nnf.avg_pool2d(ends, STEP), WINDOW // STEP, stride=1)
    return 2 * clipped.permute(0, 2, 3, 1)


def doubled(x: Tensor, shape: torch.Size) -> Tensor:
    """Repeat cells (N, h, w, ...) of the smaller octave on the grid (rows, columns) of the larger."""
    return x.repeat_interleave(2, 1).repeat_interleave(2, 2)[:, : shape[0], : shape[1]]


def joined(fine: Tensor, coarse: Tensor) -> Tensor:
    """Sum an octave's logits (..., B) and the smaller's joint ones (..., C), as ``octaves.joined``."""
    bins = torch.arange(coarse.shape[-1] + PER_OCTAVE, device=fine.device)
    return fine[..., bins.clamp(max=fine.shape[-1] - 1)] + coarse[..., (bins - PER_OCTAVE).clamp(min=0)]


def in_bins(place: Tensor, bins: int) -> Tensor:
    """Return Gaussians (..., bins) of 0.6 bins about places (...) on an axis, at most at its ends."""
    apart = torch.arange(bins) - place.clamp(0, bins - 1)[..., None]
    return torch.softmax(-apart * apart / (2 * LABEL_SPREAD**2), -1)


def target_of(displacement: Tensor, valid: Tensor, bins: int) -> tuple[Tensor, Tensor]:
    """Return the distribution (..., 32, bins) of a cell's smears (..., S, 2), and its weight (...).

    Below 2 px the direction becomes uniform.
    """
    length = torch.linalg.norm(displacement, dim=-1)
    centre = torch.atan2(displacement[..., 1], displacement[..., 0]) * (DIRECTIONS / math.pi)
    apart = torch.arange(DIRECTIONS) - centre[..., None]
    apart = torch.remainder(apart + DIRECTIONS / 2, DIRECTIONS) - DIRECTIONS / 2
    along = torch.softmax(-apart * apart / (2 * LABEL_SPREAD**2), -1)
    known = ((length - 0.5) / 1.5).clamp(0, 1)[..., None]
    along = known * along + (1 - known) / DIRECTIONS
    across = in_bins(1 + PER_OCTAVE * torch.log2(length.clamp(min=1e-3) / SHORTEST_PX), bins)
    weight = HIDDEN_WEIGHT + (1 - HIDDEN_WEIGHT) * valid
    mixed = torch.matmul((along * weight[..., None]).transpose(-1, -2), across)
    total = weight.sum(-1)
    return mixed / total[..., None, None], total / weight.shape[-1]


def radius_target(radius: Tensor, bins: int) -> Tensor:
    """Return the distribution (..., bins) of a cell's radii out of focus (..., S), pixels."""
    return in_bins(1 + PER_OCTAVE * torch.log2(radius.clamp(min=1e-3) / SMALLEST_RADIUS_PX), bins).mean(-2)


def kind_target(displacement: Tensor, radius: Tensor, shows: Tensor) -> Tensor:
    """Return the distribution (..., 5) of a cell's kind of blur, of samples (..., S); the last is unseen."""
    length = torch.linalg.norm(displacement, dim=-1)
    prevails = length / radius.clamp(min=1e-3)
    moved, defocused, shown = (
        ((value - low) / (high - low)).clamp(0, 1)
        for value, (low, high) in ((length, MOVED_PX), (radius, DEFOCUSED_PX), (prevails, PREVAILS))
    )
    moved = moved * torch.maximum(shown, 1 - defocused)
    still, focused = 1 - moved, 1 - defocused
    kinds = torch.stack([still * focused, still * defocused, moved * focused, moved * defocused], -1).mean(-2)
    target: Tensor = torch.cat([kinds * shows[..., None], 1 - shows[..., None]], -1)
    return target


def cross_entropy(logits: Tensor, target: Tensor, weight: Tensor, axes: int = 1) -> Tensor:
    """Return the mean cross-entropy of logits (N, h, w, ...), whose last axes are bins, weighed per cell."""
    log_likelihood = torch.log_softmax(logits.flatten(-axes), -1).view_as(logits)
    loss = -(target * log_likelihood).flatten(-axes).sum(-1)
    return (weight * loss).sum() / weight.sum().clamp(min=1e-3)


def losses_of(
    network: nn.Module, batch: dict[str, Tensor], half: bool
) -> tuple[list[Tensor], tuple[Tensor, ...]]:
    """Return the losses of the octaves, finest first, and the joint logits of the finest.

    In order: smears, radii, kinds. Losses of one octave are summed by their weights.
    """
    count = range(sum(key.startswith("v") for key in batch))
    with torch.autocast("cpu", dtype=torch.bfloat16, enabled=half):
        joint = network([(batch[f"C{k}"], batch[f"s{k}"]) for k in count])
    losses = []
    for k, (smears, radii, kinds) in enumerate(joint):
        d, r, shows = (batch[f"{key}{k}"] for key in "drt")
        target, weight = target_of(d, batch[f"v{k}"], smears.shape[-1])
        blur = cross_entropy(radii, radius_target(r, radii.shape[-1]), shows)
        blur = blur + cross_entropy(kinds, kind_target(d, r, shows), torch.ones_like(weight))
        losses.append(cross_entropy(smears, target, weight, axes=2) + BLUR_WEIGHT * blur)
    return losses, joint[0]
